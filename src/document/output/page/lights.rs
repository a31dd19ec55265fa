//! Lights of a page: those of its film and the standard lights, with their colours for both observers.

use std::sync::Arc;

use glam::DVec3;

use crate::output::film::{Dial, DialPreset, Node};
use crate::output::{FilmFile, OutputError};
use relume_colour::model::{ColourModel, ModelError};
use relume_colour::spectrum::colour::XYZ_FROM_LINEAR_SRGB;
use relume_colour::spectrum::observer::Observer;
use relume_colour::spectrum::{Kind, Light, standard};
use relume_scene::film::{Components, RelightMatrices, Relightable};
use relume_scene::plan::Transmittance;
use relume_scene::{Display, Mix, MixLight};

/// Everything that the colours of a page depend on.
pub(super) struct Lights {
    /// The meaning of the film for each observer of [`Observer::ALL`].
    pub(super) observed: Vec<Relightable>,
    /// The meaning of the film for the observer of the picture as it opens.
    pub(super) opened: Relightable,
    /// Lights of the film with their weights in the scene; a weight of 0 is 1 here.
    pub(super) stated: Mix,
    /// Mix of the picture as it opens.
    pub(super) opening: Mix,
    /// The dial of the film.
    dial: Option<Dial>,
    /// Standard lights, by name.
    pub(super) standards: Vec<(&'static str, Light)>,
}

impl Lights {
    /// The lights of `film`. A colour model is fitted to every standard light for both observers.
    pub(super) fn new(film: &FilmFile) -> Result<Self, OutputError> {
        let names = standard::names(Kind::Light).iter();
        let standards: Vec<(&str, Light)> =
            names.filter_map(|name| Some((*name, standard::light(name).ok()?))).collect();
        let mut stated = film.stated()?;
        let unfit = |error: ModelError| OutputError::Inconsistent { detail: error.to_string() };
        let opened = film.relightable()?;
        let components: Vec<Components> =
            match opened.components.clone() {
                surfaces @ Components::Surfaces(_) => vec![surfaces.clone(), surfaces],
                Components::Model(model, transmittance) => {
                    let lights = stated.0.iter().map(|light| (light.name.as_str(), &light.spectrum));
                    let lights: Vec<(&str, &Light)> =
                        lights.chain(standards.iter().map(|(name, light)| (*name, light))).collect();
                    let mut known = ColourModel::clone(&model);
                    known.learn_all(&lights).map_err(unfit)?;
                    let seen = Observer::ALL.map(|observer| known.seen_by(observer).map_err(unfit));
                    seen.into_iter()
                        .map(|model| Ok(Components::Model(Arc::new(model?), transmittance)))
                        .collect::<Result<_, OutputError>>()?
                }
            };
        for light in stated.0.iter_mut().filter(|light| light.weight == 0.0) {
            light.weight = 1.0;
        }
        let observed = components.into_iter().zip(Observer::ALL).map(|(components, observer)| {
            let display = Display { observer, ..opened.display.clone() };
            Relightable { components, display, ..opened.clone() }
        });
        Ok(Self {
            observed: observed.collect(),
            opened,
            stated,
            opening: film.opening()?,
            dial: film.dial.clone(),
            standards,
        })
    }

    /// Number of planes of a page: accumulators, and the transmittance unless it is in front of black.
    pub(super) fn planes(&self) -> usize {
        self.of_position() * self.opened.positions + self.behind()
    }

    /// Planes of a position.
    pub(super) fn of_position(&self) -> usize {
        self.opened.components.len()
    }

    /// Planes of the transmittance.
    pub(super) fn behind(&self) -> usize {
        match (&self.opened.components, &self.opened.background) {
            (_, None) => 0,
            (Components::Model(model, Transmittance::Coloured), _) => model.dimension(),
            _ => 1,
        }
    }

    /// Colour model for the observer of index `seen`.
    pub(super) fn model(&self, seen: usize) -> Option<&ColourModel> {
        match &self.observed[seen].components {
            Components::Model(model, _) => Some(model),
            Components::Surfaces(_) => None,
        }
    }

    /// Relight matrices under `mix` for the observer of index `seen`.
    pub(super) fn matrices(&self, mix: &Mix, seen: usize) -> RelightMatrices {
        self.observed[seen].under(mix)
    }

    /// Index in [`Observer::ALL`] of the observer of the picture as it opens.
    pub(super) fn seen(&self) -> usize {
        Observer::ALL.iter().position(|observer| *observer == self.opened.display.observer).unwrap_or(0)
    }

    /// Mixes under which packing keeps its tolerance: the picture as it opens, the presets of the dial, each standard
    /// light in place of all, and each light alone, as it is and as each standard light, with its own weight and as bright
    /// as the dial makes it. Neither of the two has the larger error in every pixel.
    pub(super) fn mixes(&self) -> Vec<Mix> {
        let single = |light: &MixLight| -> Vec<Mix> {
            let at_hand = self.on_dial(vec![light.clone()]);
            let differs = (at_hand.0[0].weight - light.weight).abs() > 1e-9 * light.weight;
            std::iter::once(Mix(vec![light.clone()])).chain(differs.then_some(at_hand)).collect()
        };
        let as_standard = |light: &MixLight| -> Vec<Mix> {
            let other =
                |(_, standard): &(&str, Light)| single(&MixLight { spectrum: standard.clone(), ..light.clone() });
            self.standards.iter().flat_map(other).collect()
        };
        let alone = self.stated.0.iter().flat_map(|light| single(light).into_iter().chain(as_standard(light)));
        let in_place = self.standards.iter().map(|(_, standard)| {
            let light = |light: &MixLight| MixLight { spectrum: standard.clone(), ..light.clone() };
            Mix(self.stated.0.iter().map(light).collect())
        });
        std::iter::once(self.opening.clone()).chain(self.presets()).chain(alone).chain(in_place).collect()
    }

    /// `mix` with the brightness of the dial; the page makes a dial of luminance 1 where the film has none.
    fn on_dial(&self, mix: Vec<MixLight>) -> Mix {
        let (normalise, master) = self.dial.as_ref().map_or((true, 1.0), |dial| (dial.normalise, dial.master));
        Mix(mix).mastered(normalise, master)
    }

    /// Mixes of the presets of the dial.
    fn presets(&self) -> Vec<Mix> {
        let Some(dial) = &self.dial else { return Vec::new() };
        let of_preset = |preset: &DialPreset| {
            let is_on =
                |node: &&Node| (node.on || preset.on.contains(&node.light)) && !preset.off.contains(&node.light);
            // Inverse distances; their sum is divided out where the dial normalises, and here where it does not.
            let near =
                |node: &Node| (node.place[0] - preset.hand[0]).hypot(node.place[1] - preset.hand[1]).max(1e-9).recip();
            let nodes: Vec<&Node> = dial.nodes.iter().filter(is_on).collect();
            let sum: f64 = nodes.iter().map(|node| near(node)).sum();
            let lit = nodes.iter().flat_map(|node| {
                let lights = self.stated.0.iter().filter(|light| light.name == node.light);
                lights.map(|light| MixLight { weight: light.weight * near(node) / sum, ..light.clone() })
            });
            self.on_dial(lit.collect())
        };
        dial.presets.iter().map(of_preset).collect()
    }

    /// XYZ of each plane under each of [`Self::mixes`], for each observer.
    pub(super) fn conditions(&self) -> Vec<Vec<DVec3>> {
        let mixes = self.mixes();
        let of = |(seen, mix): (usize, &Mix)| {
            let matrices = self.matrices(mix, seen);
            let colours = matrices.colours.iter().chain(&matrices.background).take(self.planes());
            colours.map(|&colour| *XYZ_FROM_LINEAR_SRGB * colour).collect()
        };
        (0..Observer::ALL.len()).flat_map(|seen| mixes.iter().map(move |mix| (seen, mix))).map(of).collect()
    }
}
