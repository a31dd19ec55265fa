//! Relight matrices: the colour of each component under a mix.

use std::sync::Arc;

use glam::{DMat3, DVec3};

use super::Film;
use crate::plan::{LANE, Planned, Transmittance};
use crate::{Backdrop, Display, Mix, MixLight, Scene, Tone};
use relume_base::number::{Real, count as count_f64, rounded};
use relume_colour::model::{ColourModel, ModelError, UnplannedLight};
use relume_colour::spectrum::colour::{LINEAR_SRGB_FROM_XYZ, Xyz, bradford, d65_white};
use relume_colour::spectrum::deficiency::Deficiency;
use relume_colour::spectrum::observer::Observer;
use relume_colour::spectrum::{Light, Reflectance, Spectrum};

/// Spectra of the components of accumulators.
#[derive(Clone, Debug)]
pub enum Components {
    /// Reflectances: materials, white for highlights, and terms of thin films.
    Surfaces(Vec<Spectrum>),
    /// Coefficients of a colour model, and the kind of its transmittance.
    Model(Arc<ColourModel>, Transmittance),
}

impl Components {
    /// The components of a plan.
    #[must_use]
    pub fn new(scene: &Scene, planned: &Planned) -> Self {
        if let Some(model) = &planned.model {
            return Self::Model(Arc::clone(model), planned.plan.transmittance);
        }
        let materials = planned.materials.iter().filter_map(|&material| scene.materials.get(material));
        let white = planned.plan.specular().map(|_| Spectrum::constant(1.0));
        let films = planned.thin_films(scene).into_iter();
        let terms = films.flat_map(|film| film.film.terms().spectra.iter().take(film.terms).cloned());
        let own = materials.map(|material| material.reflectance.spectrum().clone());
        Self::Surfaces(own.chain(white).chain(terms).collect())
    }

    /// Number of components.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::Surfaces(surfaces) => surfaces.len(),
            Self::Model(model, _) => model.dimension(),
        }
    }

    /// True without components.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// XYZ of each component under `light` for `observer`.
    fn colours(&self, light: &Light, observer: Observer) -> Vec<DVec3> {
        match self {
            Self::Surfaces(surfaces) => surfaces.iter().map(|surface| xyz_vector(light, surface, observer)).collect(),
            Self::Model(model, _) => model.matrix_for(light, observer).xyz.into_iter().map(DVec3::from_array).collect(),
        }
    }
}

/// Colour of every component at every position under a mix; post-illumination multiplies accumulators by these.
#[derive(Clone, Debug, PartialEq)]
pub struct RelightMatrices {
    /// Linear sRGB, with exposure and adaptation, of component `c` at position `p`: `colours[p·components + c]`.
    pub colours: Vec<DVec3>,
    /// Linear sRGB of the background, for each number of the transmittance.
    pub background: Vec<DVec3>,
    /// Weight of each number of the transmittance in the transmitted light; the weights sum to 1 in empty space.
    pub transmittance_weights: Vec<f64>,
    /// Curve of pictures for the screen; linear pictures are without it.
    pub tone: Tone,
    /// Colours of the screen behind them, if there is no background.
    pub backdrop: Backdrop,
}

impl RelightMatrices {
    /// The matrices of `scene` as `planned`, under `mix`.
    #[must_use]
    pub fn of_scene(scene: &Scene, planned: &Planned, mix: &Mix) -> Self {
        Relightable::new(scene, planned).under(mix)
    }
}

/// The meaning of a film's numbers: all that a picture of them needs beside a mix of lights.
#[derive(Clone, Debug)]
pub struct Relightable {
    /// Spectra of the components of an accumulator.
    pub components: Components,
    /// Number of light positions, each of which has an accumulator.
    pub positions: usize,
    /// Reflectance behind the volume; black if there is none.
    pub background: Option<Reflectance>,
    /// Exposure, adaptation and observer.
    pub display: Display,
}

impl Relightable {
    /// The meaning of a film of `scene` as `planned`.
    #[must_use]
    pub fn new(scene: &Scene, planned: &Planned) -> Self {
        let (components, positions) = (Components::new(scene, planned), planned.positions.len());
        Self { components, positions, background: scene.background.clone(), display: scene.display.clone() }
    }

    /// Sees films by another standard observer; a colour model is fitted to it.
    ///
    /// # Errors
    ///
    /// [`ModelError`].
    pub fn see_by(&mut self, observer: Observer) -> Result<(), ModelError> {
        self.display.observer = observer;
        match &mut self.components {
            Components::Model(model, _) if model.observer() != observer => *model = Arc::new(model.seen_by(observer)?),
            _ => {}
        }
        Ok(())
    }

    /// Fits the colour model, if there is one, to the lights of `mix` that it does not have. Returns those whose largest
    /// error is above `tolerance`.
    ///
    /// # Errors
    ///
    /// [`ModelError::NotFinite`] if a light or the model has values that are not finite.
    pub fn learn(&mut self, mix: &Mix, tolerance: f64) -> Result<Vec<UnplannedLight>, ModelError> {
        let Components::Model(model, _) = &mut self.components else { return Ok(Vec::new()) };
        let lights = mix.0.iter().map(|light| (light.name.as_str(), &light.spectrum));
        Arc::make_mut(model).learn_within(lights, tolerance)
    }

    /// Linear sRGB of every pixel of `film` under `mix`, without a march.
    #[must_use]
    pub fn relight<R: Real>(&self, film: &Film<R>, mix: &Mix) -> Vec<DVec3> {
        film.relight(&self.under(mix))
    }

    /// Luminance of a white surface under `mix`, as displayed at exposure 1.
    pub(super) fn white_under(mix: &Mix, display: &Display) -> f64 {
        let luminance = |light: &MixLight| light.weight * display.observer.xyz_of(light.spectrum.spectrum()).0[1];
        mix.0.iter().map(luminance).sum()
    }

    /// The colours of the components under `mix`, all sums in f64.
    #[must_use]
    pub fn under(&self, mix: &Mix) -> RelightMatrices {
        self.under_on(mix, self.background.as_ref(), &self.display)
    }

    /// [`Self::under`] in front of another `background`, on another `display`.
    #[must_use]
    pub fn under_on(&self, mix: &Mix, background: Option<&Reflectance>, display: &Display) -> RelightMatrices {
        let Self { components, positions, .. } = self;
        let display_from_xyz = display_from_xyz(mix, display);
        let backdrop = if background.is_some() { Backdrop::None } else { display.backdrop };
        let count = components.len();
        let mut colours = vec![DVec3::ZERO; *positions * count];
        let mut everywhere = vec![DVec3::ZERO; count];
        for light in &mix.0 {
            let colours_of_light = components.colours(&light.spectrum, display.observer);
            let here = colours.iter_mut().skip(light.position * count);
            for ((sum, all), &colour) in here.zip(&mut everywhere).zip(&colours_of_light) {
                *sum += light.weight * colour;
                *all += light.weight * colour;
            }
        }
        let (background, transmittance_weights) = match components {
            Components::Model(model, Transmittance::Coloured) => {
                let surface = background.map_or_else(|| vec![0.0; count], |it| model.coefficients(it.spectrum()));
                let behind = everywhere.iter().zip(surface).map(|(&colour, part)| part * colour).collect();
                let luminance: f64 = everywhere.iter().map(|colour| colour.y).sum();
                let share =
                    |colour: &DVec3| if luminance > 0.0 { colour.y / luminance } else { 1.0 / count_f64(count) };
                (behind, everywhere.iter().map(share).collect())
            }
            // The element of row i and column j maps component j of the light behind to component i.
            Components::Model(model, Transmittance::Mixed) => {
                let surface = background.map_or_else(|| vec![0.0; count], |it| model.coefficients(it.spectrum()));
                let behind = everywhere.iter().flat_map(|&colour| surface.iter().map(move |part| part * colour));
                let luminance: f64 = everywhere.iter().map(|colour| colour.y).sum();
                let share =
                    |colour: &DVec3| if luminance > 0.0 { colour.y / luminance } else { 1.0 / count_f64(count) };
                let weights = everywhere.iter().flat_map(|colour| vec![share(colour); count]).collect();
                (behind.collect(), weights)
            }
            _ => {
                let lit = |light: &MixLight, surface: &Reflectance| {
                    light.weight * xyz_vector(&light.spectrum, surface.spectrum(), display.observer)
                };
                let seen = |surface: &Reflectance| mix.0.iter().map(|light| lit(light, surface)).sum();
                (vec![background.map_or(DVec3::ZERO, seen)], vec![1.0])
            }
        };
        let shown = |colours: Vec<DVec3>| colours.into_iter().map(|colour| display_from_xyz * colour).collect();
        RelightMatrices {
            colours: shown(colours),
            background: shown(background),
            transmittance_weights,
            tone: display.tone,
            backdrop,
        }
    }
}

impl RelightMatrices {
    /// Background and weights in the layout of the relight shader: for each vector of the transmittance, red, green and
    /// blue of the background, and the weights.
    #[must_use]
    pub fn transmittance_lanes(&self) -> Vec<[[f32; LANE]; 4]> {
        let lanes = self.background.chunks(LANE).zip(self.transmittance_weights.chunks(LANE));
        let number = |colour: Option<&DVec3>, channel: usize| colour.map_or(0.0, |colour| rounded(colour[channel]));
        lanes
            .map(|(colours, shares)| {
                std::array::from_fn(|channel| {
                    std::array::from_fn(|part| match channel {
                        3 => shares.get(part).map_or(0.0, |&share| rounded(share)),
                        _ => number(colours.get(part), channel),
                    })
                })
            })
            .collect()
    }

    /// Colours in the layout of the relight shader: for each position and lane, three vectors (red, green, blue).
    #[must_use]
    pub fn lanes(&self, components: usize) -> Vec<[[f32; LANE]; 3]> {
        if components == 0 {
            return Vec::new();
        }
        self.colours
            .chunks(components)
            .flat_map(|position| position.chunks(LANE))
            .map(|lane| {
                std::array::from_fn(|channel| {
                    std::array::from_fn(|part| lane.get(part).map_or(0.0, |colour| rounded(colour[channel])))
                })
            })
            .collect()
    }
}

/// XYZ of a surface under a light for `observer`.
fn xyz_vector(light: &Light, surface: &Spectrum, observer: Observer) -> DVec3 {
    DVec3::from_array(observer.xyz_of(&(light.spectrum() * surface)).0)
}

/// Matrix from XYZ to the displayed linear sRGB. Includes exposure, the preview of a colour vision deficiency and, if
/// the display adapts, Bradford adaptation from the white of the mix for the display's observer.
#[must_use]
pub fn display_from_xyz(mix: &Mix, display: &Display) -> DMat3 {
    let (_, light) = mix.light_at(0);
    let white = display.observer.xyz_of(&light);
    let adapted = if display.adapt && white.0[1] > 0.0 {
        let relative = Xyz(white.0.map(|component| component / white.0[1]));
        *LINEAR_SRGB_FROM_XYZ * bradford(relative, d65_white())
    } else {
        *LINEAR_SRGB_FROM_XYZ
    };
    display.deficiency.map_or(DMat3::IDENTITY, Deficiency::matrix) * adapted * display.factor()
}
