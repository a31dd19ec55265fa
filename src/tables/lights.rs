//! Lights in numbers: directions for the march, and one matrix per position for relighting.

use std::sync::Arc;

use glam::{DMat3, DVec3};

use super::rays::unit_length;
use super::rounded;
use crate::model::ColourModel;
use crate::number::count as count_f64;
use crate::plan::{Accumulate, LANE, Planned, Transmittance};
use crate::scene::{Display, Material, Mix, MixLight, Placement, Scene};
use crate::spectrum::colour::{LINEAR_SRGB_FROM_XYZ, Xyz, bradford, d65_white};
use crate::spectrum::deficiency::Deficiency;
use crate::spectrum::observer::Observer;
use crate::spectrum::{Light, Reflectance, Spectrum};

/// Vectors of the light positions, in the order of the plan, in the volume's own axes: unit vectors towards directional
/// lights, places (in units of length, from the texture's corner) of points, zero for the others.
#[derive(Clone, Debug, PartialEq)]
pub struct PositionTable(pub Vec<DVec3>);

impl PositionTable {
    /// The positions of `planned` as `scene`'s volume lies.
    #[must_use]
    pub fn new(scene: &Scene, planned: &Planned) -> Self {
        let geometry = &scene.volume.geometry;
        let local_from_world = geometry.direction.inverse();
        let vector = |placement: Placement| match placement {
            Placement::Ambient | Placement::Headlight => DVec3::ZERO,
            Placement::Directional(direction) => local_from_world * direction,
            Placement::Point(world) => {
                (local_from_world * (world - geometry.origin) + geometry.spacing / 2.0) / unit_length(geometry)
            }
        };
        Self(planned.positions.iter().map(|position| vector(position.placement)).collect())
    }
}

/// Shading coefficients, in lanes; spare ones zero. Of the materials in use where weights are accumulated; of spectra, the
/// first ambient and diffuse share stand for all materials, and the exponents are those of the highlights.
#[derive(Clone, Debug, PartialEq)]
pub struct ShadingTable {
    /// Ambient share.
    pub ambient: Vec<[f32; LANE]>,
    /// Diffuse share.
    pub diffuse: Vec<[f32; LANE]>,
    /// Specular share.
    pub specular: Vec<[f32; LANE]>,
    /// Exponents of the specular part.
    pub exponent: Vec<[u32; LANE]>,
}

impl ShadingTable {
    /// The coefficients of the materials of `planned`.
    #[must_use]
    pub fn new(scene: &Scene, planned: &Planned) -> Self {
        let used: Vec<&Material> = planned.materials.iter().filter_map(|&m| scene.materials.get(m)).collect();
        let (shown, exponents) = match planned.plan.accumulate {
            Accumulate::Weights { .. } => (used.as_slice(), used.iter().map(|material| material.exponent).collect()),
            Accumulate::Spectral { .. } => (&used[..used.len().min(1)], planned.exponents(scene)),
        };
        let lanes = planned.plan.shading_lanes();
        let share = |of: fn(&Material) -> f64| {
            let mut table = vec![[0.0; LANE]; lanes];
            shown.iter().enumerate().for_each(|(i, material)| table[i / LANE][i % LANE] = rounded(of(material)));
            table
        };
        let mut exponent = vec![[0; LANE]; lanes];
        exponents.iter().enumerate().for_each(|(i, &power)| exponent[i / LANE][i % LANE] = power);
        Self {
            ambient: share(|material| material.ambient),
            diffuse: share(|material| material.diffuse),
            specular: share(|material| material.specular),
            exponent,
        }
    }
}

/// What the components of accumulators stand for.
#[derive(Clone, Debug)]
pub enum Components {
    /// Reflectances: materials, and white for highlights.
    Surfaces(Vec<Spectrum>),
    /// The numbers of a colour model, and whether what passes has a colour in them, too.
    Model(Arc<ColourModel>, Transmittance),
}

impl Components {
    /// Those of a plan.
    #[must_use]
    pub fn new(scene: &Scene, planned: &Planned) -> Self {
        if let Some(model) = &planned.model {
            return Self::Model(Arc::clone(model), planned.plan.transmittance);
        }
        let materials = planned.materials.iter().filter_map(|&material| scene.materials.get(material));
        let white = planned.plan.specular().map(|_| Spectrum::constant(1.0));
        let surfaces = materials.map(|material| material.reflectance.spectrum().clone()).chain(white);
        Self::Surfaces(surfaces.collect())
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::Surfaces(surfaces) => surfaces.len(),
            Self::Model(model, _) => model.dimension(),
        }
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// XYZ of each under `light`, to `observer`.
    fn colours(&self, light: &Light, observer: Observer) -> Vec<DVec3> {
        match self {
            Self::Surfaces(surfaces) => surfaces.iter().map(|surface| xyz_vector(light, surface, observer)).collect(),
            Self::Model(model, _) => model.matrix_for(light, observer).xyz.into_iter().map(DVec3::from_array).collect(),
        }
    }
}

/// The colour of every component of every position under a mix: what post-illumination multiplies accumulators by.
#[derive(Clone, Debug, PartialEq)]
pub struct RelightMatrices {
    /// Linear sRGB (exposure and adaptation in it) of component `c` at position `p`: `colours[p·components + c]`.
    pub colours: Vec<DVec3>,
    /// Linear sRGB of the background, per number of what passes.
    pub background: Vec<DVec3>,
    /// The share that each number of what passes has in the light that passes; where nothing is taken away, it all adds up to 1.
    pub passing: Vec<f64>,
}

impl RelightMatrices {
    /// Colours of `components` at each of `positions` positions under `mix`, in front of `background`, all sums in f64.
    #[must_use]
    pub fn new(
        components: &Components,
        positions: usize,
        background: Option<&Reflectance>,
        mix: &Mix,
        display: &Display,
    ) -> Self {
        let display_from_xyz = display_from_xyz(mix, display);
        let count = components.len();
        let mut colours = vec![DVec3::ZERO; positions * count];
        let mut everywhere = vec![DVec3::ZERO; count];
        for light in &mix.0 {
            let colours_of_light = components.colours(&light.spectrum, display.observer);
            let here = colours.iter_mut().skip(light.position * count);
            for ((sum, all), &colour) in here.zip(&mut everywhere).zip(&colours_of_light) {
                *sum += light.weight * colour;
                *all += light.weight * colour;
            }
        }
        let (background, passing) = match components {
            Components::Model(model, Transmittance::Coloured) => {
                let surface = background.map_or_else(|| vec![0.0; count], |it| model.coefficients(it.spectrum()));
                let behind = everywhere.iter().zip(surface).map(|(&colour, part)| part * colour).collect();
                let luminance: f64 = everywhere.iter().map(|colour| colour.y).sum();
                let share =
                    |colour: &DVec3| if luminance > 0.0 { colour.y / luminance } else { 1.0 / count_f64(count) };
                (behind, everywhere.iter().map(share).collect())
            }
            // The element of row i and column j makes component i of what j is behind.
            Components::Model(model, Transmittance::Mixed) => {
                let surface = background.map_or_else(|| vec![0.0; count], |it| model.coefficients(it.spectrum()));
                let behind = everywhere.iter().flat_map(|&colour| surface.iter().map(move |part| part * colour));
                let luminance: f64 = everywhere.iter().map(|colour| colour.y).sum();
                let share =
                    |colour: &DVec3| if luminance > 0.0 { colour.y / luminance } else { 1.0 / count_f64(count) };
                let passing = everywhere.iter().flat_map(|colour| vec![share(colour); count]).collect();
                (behind.collect(), passing)
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
        Self { colours: shown(colours), background: shown(background), passing }
    }

    /// What passes, as the relight shader reads it: for each vector of it, red, green and blue of the background, and the
    /// share.
    #[must_use]
    pub fn passing_lanes(&self) -> Vec<[[f32; LANE]; 4]> {
        let passing = self.background.chunks(LANE).zip(self.passing.chunks(LANE));
        let number = |colour: Option<&DVec3>, channel: usize| colour.map_or(0.0, |colour| rounded(colour[channel]));
        passing
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

    /// As the relight shader reads them: for each position and lane, three vectors (red, green, blue).
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

/// XYZ of a surface under a light, to `observer`.
fn xyz_vector(light: &Light, surface: &Spectrum, observer: Observer) -> DVec3 {
    DVec3::from_array(observer.xyz_of(&(light.spectrum() * surface)).0)
}

/// From XYZ to linear sRGB times exposure, by Bradford from the white of the mixed lights, as the observer sees it, where the
/// display adapts, as somebody sees it who may lack one kind of cone.
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
    display.deficiency.map_or(DMat3::IDENTITY, Deficiency::matrix) * adapted * display.exposure
}
