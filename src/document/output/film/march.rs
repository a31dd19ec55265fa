//! Conversion of a marched film to a film file.

use std::sync::Arc;

use super::{Component, Components, Dial, FilmFile, FilmPart, Frame, Light, Position, Stored};
use crate::annotate::{self, Edges};
use crate::output::OutputError;
use relume_colour::spectrum::Spectrum;
use relume_scene::film;
use relume_scene::film::Film;
use relume_scene::plan::{Planned, Transmittance};
use relume_scene::{Mix, MixLight, Scene};

impl FilmFile {
    /// Builds the film file of a march of `scene` under `planned`, with all that relighting needs.
    ///
    /// # Errors
    ///
    /// [`OutputError::Matrix`] if the transmittance is a matrix.
    pub fn of_march(
        scene: &Scene,
        planned: &Planned,
        opening: &Mix,
        dial: Dial,
        accumulation: Film<f32>,
    ) -> Result<Self, OutputError> {
        if planned.plan.transmittance == Transmittance::Mixed {
            return Err(OutputError::Matrix);
        }
        let components = match film::Components::new(scene, planned) {
            film::Components::Surfaces(surfaces) => Components::Surfaces(named(scene, planned, &surfaces)),
            film::Components::Model(model, transmittance) => Components::Model(Stored {
                model: Arc::unwrap_or_clone(model),
                coloured: transmittance == Transmittance::Coloured,
                tolerance: scene.accuracy.tolerance,
            }),
        };
        let positions = planned.positions.iter().map(|position| Position {
            name: position.name.clone(),
            placement: position.placement,
            shadows: position.shadows,
        });
        let stated = Mix::of_scene(scene);
        let shown = |light: &MixLight| {
            let weights = opening.0.iter().filter(|one| one.is_same(light)).map(|one| one.weight);
            Some(weights.sum()).filter(|_| *opening != stated)
        };
        let lights = stated.0.iter().map(|light| Light {
            name: light.name.clone(),
            position: light.position,
            weight: light.weight,
            shown: shown(light),
            spectrum: *light.spectrum.spectrum().samples(),
        });
        let mut file = Self {
            width: accumulation.size[0],
            height: accumulation.size[1],
            components,
            positions: positions.collect(),
            lights: lights.collect(),
            background: scene.background.as_ref().map(|surface| *surface.spectrum().samples()),
            exposure: scene.display.exposure,
            tone: scene.display.tone,
            backdrop: scene.display.backdrop,
            adapt: scene.display.adapt,
            observer: scene.display.observer,
            dial: Some(dial),
            frame: Some(Frame::of(&annotate::Frame::of(&scene.camera, &scene.frame, accumulation.size))),
            part: FilmPart::of_scene(scene, accumulation.size),
            accumulators: Vec::new(),
            transmittance: Vec::new(),
        };
        if file.part.is_none() && !accumulation.transmittance.is_empty() {
            file.expose(&accumulation)?;
        }
        (file.accumulators, file.transmittance) = (accumulation.accumulators, accumulation.transmittance);
        Ok(file)
    }
}

impl Frame {
    fn of(frame: &annotate::Frame) -> Self {
        let annotate::Frame { pixel, unit, edges } = frame.clone();
        Self {
            pixel: pixel.map(|it| it.units),
            parallel: pixel.is_some_and(|it| it.exact),
            unit: unit.map(|it| it.to_string()),
            edges: edges.map(|Edges { left, right, top, bottom }| [left, right, top, bottom]),
        }
    }
}

/// Names the materials in use, white, and the terms of films as components.
fn named(scene: &Scene, planned: &Planned, surfaces: &[Spectrum]) -> Vec<Component> {
    let names = planned.materials.iter().filter_map(|&m| scene.materials.get(m)).map(|m| m.name.clone());
    // White needs a unique name, whatever the materials are called.
    let mut names: Vec<String> = names.collect();
    let mut add = |name: String| {
        let mut all = std::iter::once(name.clone()).chain((2..).map(|n| format!("{name} {n}")));
        let unique = all.find(|name| !names.contains(name)).unwrap_or_default();
        names.push(unique);
    };
    if planned.plan.specular().is_some() {
        add("white".to_owned());
    }
    for film in planned.thin_films(scene) {
        (1..=film.terms).for_each(|term| add(format!("{} film {term}", film.material.name)));
    }
    let named = surfaces.iter().zip(names);
    named.map(|(spectrum, name)| Component { name, spectrum: *spectrum.samples() }).collect()
}
