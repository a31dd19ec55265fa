//! How the lights of a scene are mixed: by a slider each, or by the light dial.

use glam::DVec2;

use super::Dial;
use crate::scene::{Mix, SceneLight};

/// How the lights of a scene are mixed.
#[derive(Clone, Debug, PartialEq)]
pub struct LightState {
    /// What decides: the sliders or the dial.
    pub mixing: Mixing,
    /// A slider for each of [`Scene::lights`](crate::scene::Scene::lights).
    pub sliders: Vec<Slider>,
    /// The only light that the sliders let shine, by its index.
    pub solo: Option<usize>,
    /// Whether the sliders' mix is scaled so that a white surface has the luminance `master`.
    pub normalise: bool,
    /// That luminance; where `normalise` is off, what every slider is multiplied by.
    pub master: f64,
    /// Where the hand of the dial is.
    pub hand: DVec2,
    /// The situation that the hand was last brought to, by its index, until something else is changed about the light.
    pub situation: Option<usize>,
}

/// What decides how much each light shines.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mixing {
    /// A slider per light.
    #[default]
    Sliders,
    /// The light dial.
    Dial,
}

/// How much a light shines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slider {
    /// What the intensity that the scene states is multiplied by.
    pub weight: f64,
    /// Whether it shines at all.
    pub on: bool,
}

impl LightState {
    /// All of `lights` as strong as the scene states them.
    #[must_use]
    pub fn stated(lights: usize) -> Self {
        Self {
            mixing: Mixing::Sliders,
            sliders: vec![Slider { weight: 1.0, on: true }; lights],
            solo: None,
            normalise: false,
            master: 1.0,
            hand: DVec2::ZERO,
            situation: None,
        }
    }

    /// Of the lights of `stated`, which are `lights` of a scene with this `dial`, those that shine, and how strongly.
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

    /// What the slider of a light lets through.
    fn slider(&self, index: usize) -> f64 {
        let slider = self.sliders.get(index).filter(|slider| slider.on);
        slider.filter(|_| self.solo.is_none_or(|solo| solo == index)).map_or(0.0, |slider| slider.weight)
    }
}
