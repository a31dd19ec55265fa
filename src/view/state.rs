//! What is looked at and how: the scene, how its lights are mixed, and what of it can be undone. No GPU, no window.

use std::mem::Discriminant;

use glam::DVec2;

use super::camera::{self, Move};
use crate::scene::{Mix, Scene};

/// Steps that can be undone.
const DEPTH: usize = 200;

/// Everything a person can change, and nothing else.
#[derive(Clone, Debug)]
pub struct State {
    /// The scene as it is now. What edits change of it (camera, crop, dial, display) differs from what was opened.
    pub scene: Scene,
    /// How its lights are mixed.
    pub light: LightState,
}

/// How the lights of a scene are mixed.
#[derive(Clone, Debug, PartialEq)]
pub struct LightState {
    /// What decides: the sliders or the dial.
    pub mixing: Mixing,
    /// A slider for each of [`Scene::lights`].
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
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mixing {
    /// A slider per light.
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

/// A change of the [`State`]. Numbers out of range are brought into it.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Edit {
    /// The slider of a light, by its index. Takes over from the dial what it was at.
    Weight(usize, f64),
    /// Whether a light shines.
    On(usize, bool),
    /// One light alone, or all that are on.
    Solo(Option<usize>),
    /// What decides: the sliders or the dial.
    Mix(Mixing),
    /// Whether brightness is kept, of what decides now.
    Normalise(bool),
    /// How bright, of what decides now.
    Master(f64),
    /// The hand of the dial, which decides from now on.
    Hand(DVec2),
    /// The hand exactly on a node, by its index.
    HandOnNode(usize),
    /// Where a node lies.
    NodePlace(usize, DVec2),
    /// Whether a node takes part; its place is kept.
    NodeOn(usize, bool),
    /// The nodes as the scene has them.
    ResetDial,
    /// A situation of the dial, by its index.
    Situation(usize),
    /// What linear colours are multiplied by.
    Exposure(f64),
    /// Whether the eye adapts to the white of the lights.
    Adapt(bool),
    /// A movement of the camera, before a picture of this width over height.
    Camera(Move, f64),
}

/// What has to be done again after an edit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Cost {
    /// The light of the picture: one small matrix a pixel.
    Relight,
    /// The way of every ray through the volume.
    March,
}

impl Edit {
    /// What tells it from other kinds: the hand on a node is on its way as anywhere else.
    fn kind(&self) -> Discriminant<Self> {
        match self {
            Self::HandOnNode(_) => std::mem::discriminant(&Self::Hand(DVec2::ZERO)),
            other => std::mem::discriminant(other),
        }
    }

    /// What has to be done again after it.
    #[must_use]
    pub fn cost(&self) -> Cost {
        match self {
            Self::Weight(..)
            | Self::On(..)
            | Self::Solo(_)
            | Self::Mix(_)
            | Self::Normalise(_)
            | Self::Master(_)
            | Self::Hand(_)
            | Self::HandOnNode(_)
            | Self::NodePlace(..)
            | Self::NodeOn(..)
            | Self::ResetDial
            | Self::Situation(_)
            | Self::Exposure(_)
            | Self::Adapt(_) => Cost::Relight,
            Self::Camera(..) => Cost::March,
        }
    }
}

/// Largest factor of sliders, master and exposure.
pub const BRIGHTEST: f64 = 1e6;

fn factor(number: f64) -> f64 {
    if number.is_finite() { number.clamp(0.0, BRIGHTEST) } else { 1.0 }
}

fn finite(place: DVec2) -> DVec2 {
    if place.is_finite() { place.clamp(DVec2::splat(-1e6), DVec2::splat(1e6)) } else { DVec2::ZERO }
}

impl State {
    /// The state in which `scene` opens: the picture that `relume render` makes of it.
    #[must_use]
    pub fn new(scene: Scene) -> Self {
        let light = LightState {
            mixing: Mixing::Sliders,
            sliders: vec![Slider { weight: 1.0, on: true }; scene.lights.len()],
            solo: None,
            normalise: false,
            master: 1.0,
            hand: DVec2::ZERO,
            situation: None,
        };
        Self { scene, light }
    }

    /// The lights that shine now, from the positions of the scene.
    #[must_use]
    pub fn mix(&self) -> Mix {
        let stated = Mix::of_scene(&self.scene);
        if self.light.mixing == Mixing::Dial {
            return self.scene.dial.mix(self.light.hand, &stated);
        }
        let mut mix = stated;
        for light in &mut mix.0 {
            let index = self.scene.lights.iter().position(|one| one.name == light.name);
            light.weight *= index.map_or(0.0, |index| self.slider(index));
        }
        mix.0.retain(|light| light.weight > 0.0);
        mix.mastered(self.light.normalise, self.light.master)
    }

    /// What the slider of a light lets through.
    fn slider(&self, index: usize) -> f64 {
        let slider = self.light.sliders.get(index).filter(|slider| slider.on);
        slider.filter(|_| self.light.solo.is_none_or(|solo| solo == index)).map_or(0.0, |slider| slider.weight)
    }

    /// How much each of the scene's lights shines, as a multiple of its stated intensity: what sliders would show.
    #[must_use]
    pub fn shares(&self) -> Vec<f64> {
        let mix = self.mix();
        let share = |light: &crate::scene::SceneLight| {
            // Not `sum`, which makes −0 of nothing.
            let weight = mix.0.iter().filter(|one| one.name == light.name).fold(0.0, |sum, one| sum + one.weight);
            if light.intensity > 0.0 { weight / light.intensity } else { 0.0 }
        };
        self.scene.lights.iter().map(share).collect()
    }

    /// Whether any light arrives.
    #[must_use]
    pub fn is_lit(&self) -> bool {
        self.mix().0.iter().any(|light| light.weight > 0.0) && self.scene.display.exposure > 0.0
    }

    /// Whether brightness is kept by what decides now, and how bright.
    #[must_use]
    pub fn master(&self) -> (bool, f64) {
        match self.light.mixing {
            Mixing::Sliders => (self.light.normalise, self.light.master),
            Mixing::Dial => (self.scene.dial.normalise, self.scene.dial.master),
        }
    }

    /// What has to be done to go from `before` to this state; `None` where both look alike.
    #[must_use]
    pub fn cost_from(&self, before: &Self) -> Option<Cost> {
        let (now, then) = (&self.scene, &before.scene);
        if now.camera != then.camera || now.crop != then.crop || now.transfer != then.transfer {
            return Some(Cost::March);
        }
        let alike = self.light == before.light && now.dial == then.dial && now.display == then.display;
        (!alike).then_some(Cost::Relight)
    }

    fn apply(&mut self, edit: &Edit, opened: &Scene) {
        let shares = self.shares();
        let (light, scene) = (&mut self.light, &mut self.scene);
        match *edit {
            Edit::Weight(index, weight) => {
                if light.mixing == Mixing::Dial {
                    // The picture stays as it is, and the sliders are what makes it.
                    *light = LightState {
                        mixing: Mixing::Sliders,
                        sliders: shares.into_iter().map(|weight| Slider { weight, on: true }).collect(),
                        solo: None,
                        normalise: false,
                        master: 1.0,
                        ..*light
                    };
                }
                if let Some(slider) = light.sliders.get_mut(index) {
                    slider.weight = factor(weight);
                }
            }
            Edit::On(index, on) => {
                if let Some(slider) = light.sliders.get_mut(index) {
                    slider.on = on;
                }
            }
            Edit::Solo(solo) => {
                light.mixing = Mixing::Sliders;
                light.solo = solo.filter(|&index| index < scene.lights.len());
            }
            Edit::Mix(mixing) => light.mixing = mixing,
            Edit::Normalise(on) => match light.mixing {
                Mixing::Sliders => light.normalise = on,
                Mixing::Dial => scene.dial.normalise = on,
            },
            Edit::Master(master) => match light.mixing {
                Mixing::Sliders => light.master = factor(master),
                Mixing::Dial => scene.dial.master = factor(master),
            },
            Edit::Hand(hand) => (light.mixing, light.hand) = (Mixing::Dial, finite(hand)),
            Edit::HandOnNode(index) => {
                if let Some(node) = scene.dial.nodes.get(index) {
                    (light.mixing, light.hand) = (Mixing::Dial, node.place);
                }
            }
            Edit::NodePlace(index, place) => {
                if let Some(node) = scene.dial.nodes.get_mut(index) {
                    node.place = finite(place);
                }
            }
            Edit::NodeOn(index, on) => {
                if let Some(node) = scene.dial.nodes.get_mut(index) {
                    node.on = on;
                }
            }
            Edit::ResetDial => scene.dial.nodes.clone_from(&opened.dial.nodes),
            Edit::Situation(index) => {
                if let Some(situation) = scene.dial.situations.get(index) {
                    let hand = situation.hand;
                    for (node, stated) in scene.dial.nodes.iter_mut().zip(&opened.dial.nodes) {
                        node.on = stated.on && !situation.off.contains(&node.light);
                    }
                    (light.mixing, light.hand) = (Mixing::Dial, hand);
                }
            }
            Edit::Exposure(exposure) => scene.display.exposure = factor(exposure),
            Edit::Adapt(adapt) => scene.display.adapt = adapt,
            Edit::Camera(step, aspect) => {
                scene.camera = camera::moved(&scene.camera, &opened.camera, &scene.volume.geometry, aspect, step);
            }
        }
        light.situation = match *edit {
            Edit::Situation(index) => Some(index).filter(|&index| index < scene.dial.situations.len()),
            Edit::Exposure(_) | Edit::Adapt(_) | Edit::Camera(..) => light.situation,
            _ => None,
        };
    }
}

/// A scene that is looked at, with what was done to it.
#[derive(Clone, Debug)]
pub struct Document {
    opened: Scene,
    now: State,
    past: Vec<State>,
    future: Vec<State>,
    /// The kind of the edits that are one step back together, while a hand is at it.
    gesture: Option<Discriminant<Edit>>,
}

impl Document {
    /// A scene that was just opened.
    #[must_use]
    pub fn new(scene: Scene) -> Self {
        let now = State::new(scene.clone());
        Self { opened: scene, now, past: Vec::new(), future: Vec::new(), gesture: None }
    }

    /// A scene that was just opened, with `edit` made before anybody looks.
    #[must_use]
    pub fn starting(scene: Scene, edit: &Edit) -> Self {
        let mut document = Self::new(scene);
        document.now.apply(edit, &document.opened);
        document
    }

    /// The scene as it was opened.
    #[must_use]
    pub fn opened(&self) -> &Scene {
        &self.opened
    }

    /// How it is now.
    #[must_use]
    pub fn state(&self) -> &State {
        &self.now
    }

    /// Changes it. Edits of one kind in a row are one step back, until [`Self::rest`]. `None` where nothing has changed.
    pub fn edit(&mut self, edit: &Edit) -> Option<Cost> {
        let before = self.now.clone();
        self.now.apply(edit, &self.opened);
        let cost = self.now.cost_from(&before)?;
        let kind = edit.kind();
        if self.gesture != Some(kind) {
            self.gesture = Some(kind);
            self.past.push(before);
            if self.past.len() > DEPTH {
                self.past.remove(0);
            }
        }
        self.future.clear();
        Some(cost)
    }

    /// The hand has let go: the next edit is a step back of its own.
    pub fn rest(&mut self) {
        self.gesture = None;
    }

    /// Whether there is a step back.
    #[must_use]
    pub fn can_undo(&self) -> bool {
        !self.past.is_empty()
    }

    /// Whether there is a step forward.
    #[must_use]
    pub fn can_redo(&self) -> bool {
        !self.future.is_empty()
    }

    /// Goes a step back.
    pub fn undo(&mut self) -> Option<Cost> {
        let before = self.past.pop()?;
        self.gesture = None;
        self.future.push(std::mem::replace(&mut self.now, before));
        self.future.last().and_then(|undone| self.now.cost_from(undone))
    }

    /// Goes a step forward.
    pub fn redo(&mut self) -> Option<Cost> {
        let after = self.future.pop()?;
        self.gesture = None;
        self.past.push(std::mem::replace(&mut self.now, after));
        self.past.last().and_then(|before| self.now.cost_from(before))
    }
}
