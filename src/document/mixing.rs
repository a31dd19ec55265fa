//! The mix of a scene's lights, by one slider per light or by the light dial.

use glam::DVec2;

use super::Dial;
use crate::output::film;
use relume_scene::{Mix, SceneLight};

/// State of the mix of a scene's lights.
#[derive(Clone, Debug, PartialEq)]
pub struct LightState {
    /// Source of the mix: the sliders or the dial.
    pub mixing: Mixing,
    /// One slider for each of [`Scene::lights`](relume_scene::Scene::lights).
    pub sliders: Vec<Slider>,
    /// Index of the only light that shines, with sliders.
    pub solo: Option<usize>,
    /// Whether the sliders' mix is scaled so that a white surface has the luminance `master`.
    pub normalise: bool,
    /// Luminance of white if `normalise` is on, otherwise a factor of every slider.
    pub master: f64,
    /// Position of the dial's hand.
    pub hand: DVec2,
    /// Index of the last chosen dial preset; `None` after any other change of the light.
    pub preset: Option<usize>,
}

/// Source of the lights' weights.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mixing {
    /// One slider per light.
    #[default]
    Sliders,
    /// The light dial.
    Dial,
}

/// The slider of a light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slider {
    /// Factor of the intensity that the scene states.
    pub weight: f64,
    /// Whether the light is on.
    pub on: bool,
}

impl LightState {
    /// All lights at the intensities of the scene; `lights` is their number.
    #[must_use]
    pub fn stated(lights: usize) -> Self {
        Self {
            mixing: Mixing::Sliders,
            sliders: vec![Slider { weight: 1.0, on: true }; lights],
            solo: None,
            normalise: false,
            master: 1.0,
            hand: DVec2::ZERO,
            preset: None,
        }
    }

    /// True if all lights shine as the scene states them: nothing mixes them.
    #[must_use]
    pub fn is_of_all(&self) -> bool {
        self.mixing == Mixing::Sliders && self.solo.is_none() && self.sliders.iter().all(|slider| slider.on)
    }

    /// Mix of the current weights. `stated` is the mix of the scene, `lights` its lights and `dial` its dial.
    #[must_use]
    pub fn mix(&self, stated: Mix, lights: &[SceneLight], dial: &Dial) -> Mix {
        if self.mixing == Mixing::Dial {
            return dial.mix(self.hand, &stated);
        }
        let mut mix = stated;
        for light in &mut mix.0 {
            let index = lights.iter().position(|one| one.name == light.name);
            light.weight *= index.map_or(0.0, |index| self.slider(index));
        }
        mix.0.retain(|light| light.weight > 0.0);
        mix.mastered(self.normalise, self.master)
    }

    /// The dial of a film file of a picture in this state.
    #[must_use]
    pub fn dial_of_film(&self, dial: &Dial) -> film::Dial {
        let hand = (self.mixing == Mixing::Dial).then(|| self.hand.to_array());
        film::Dial { hand, ..dial.into() }
    }

    /// Weight of a light's slider; 0 if it is off, or if another light is solo.
    fn slider(&self, index: usize) -> f64 {
        let slider = self.sliders.get(index).filter(|slider| slider.on);
        slider.filter(|_| self.solo.is_none_or(|solo| solo == index)).map_or(0.0, |slider| slider.weight)
    }
}
