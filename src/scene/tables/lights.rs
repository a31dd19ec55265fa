//! Light positions and shading coefficients of the march.

use glam::{DVec3, DVec4};

use super::rays::crop_box;
use super::unit_length;
use crate::plan::{Accumulate, LANE, Planned};
use crate::{Direction, Material, Scene};
use relume_base::number::{count, rounded};

/// Reciprocal of the smallest turn of a three-point light that changes its light grid.
const FINEST_TURN: f64 = 1e9;

/// A vector for each arrival of the plan, in their order and along the volume's own axes: unit vectors towards infinity,
/// coordinates of places (in units of length, from the texture's corner), zero for light from everywhere and from the eye.
/// The fourth number is the weight of the arrival; where nothing shades, the weights of an accumulator add up to 1.
#[derive(Clone, Debug, PartialEq)]
pub struct PositionTable(pub Vec<DVec4>);

impl PositionTable {
    /// Builds the vectors of `planned` relative to the volume of `scene`.
    #[must_use]
    pub fn new(scene: &Scene, planned: &Planned) -> Self {
        let geometry = &scene.frame.geometry;
        let local_from_world = geometry.direction.inverse();
        // The direction of the picture does not depend on its shape. A march needs a line of sight.
        let view = scene.camera.view(geometry, 1.0);
        let is_shaded = planned.plan.shading.is_some() && planned.plan.phases == 0;
        let vectors = planned.positions.iter().flat_map(|position| {
            let placement = position.placement;
            let whole = if is_shaded { 1.0 } else { placement.largest_shade() };
            let directions = placement.directions().iter().zip(placement.vectors(view.as_ref()));
            directions.map(move |(direction, (vector, weight))| {
                let vector = match direction {
                    Direction::Everywhere | Direction::Eye => DVec3::ZERO,
                    Direction::Infinity => local_from_world * vector,
                    Direction::Place => {
                        (local_from_world * (vector - geometry.origin) + geometry.spacing / 2.0) / unit_length(geometry)
                    }
                };
                vector.extend(weight / whole)
            })
        });
        Self(vectors.collect())
    }

    /// The lights of the light grid of `scene`, in the order of their numbers. Directions that turn with the camera are
    /// rounded, so that their depths are kept when the camera moves without a turn.
    #[must_use]
    pub fn grid_lights(&self, scene: &Scene, planned: &Planned) -> Vec<GridLight> {
        let light = &planned.plan.light;
        let of_vector = |i: usize| {
            let (arrival, vector) = (light.arrivals.get(i)?, self.0.get(i)?.truncate());
            let turns = planned.positions.get(arrival.accumulator)?.placement.turns();
            Some(match arrival.direction {
                Direction::Place => GridLight::At(vector),
                _ if turns => GridLight::From(((vector * FINEST_TURN).round() / FINEST_TURN).normalize_or_zero()),
                _ => GridLight::From(vector),
            })
        };
        let sky = GridLight::Sky { directions: scene.shadows.directions, reach: sky_reach(scene) };
        light.behind().filter_map(of_vector).chain(light.sky().map(|_| sky)).collect()
    }

    /// The depths of [`Self::grid_lights`]: of each light in turn, that of all that is grey, and one per coloured absorber.
    #[must_use]
    pub fn grid_depths(&self, scene: &Scene, planned: &Planned) -> Vec<GridDepth> {
        let lights = self.grid_lights(scene, planned).into_iter();
        lights
            .flat_map(|light| (0..=planned.plan.light.absorbers).map(move |number| GridDepth { light, number }))
            .collect()
    }
}

/// An optical depth at each node of a light grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridDepth {
    /// Its light.
    pub light: GridLight,
    /// 0: the depth of all that is grey; i: that of the coloured absorber i − 1.
    pub number: usize,
}

/// A light whose dimming by the medium a light grid holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GridLight {
    /// From infinity: a unit vector towards the light, along the volume's own axes.
    From(DVec3),
    /// From a point: its coordinates in units of length along the volume's own axes, from the texture's corner.
    At(DVec3),
    /// From a sky of even brightness: the mean over so many directions.
    Sky {
        /// Number of directions.
        directions: usize,
        /// Distance in units of length beyond which nothing dims it; `None` if it is longer than the crop box.
        reach: Option<f64>,
    },
}

/// Distance in units of length beyond which nothing dims the sky of `scene`; `None` if it is longer than the crop box.
#[must_use]
pub fn sky_reach(scene: &Scene) -> Option<f64> {
    let geometry = &scene.frame.geometry;
    let unit = unit_length(geometry);
    let [low, high] = crop_box(scene);
    let longest = ((high - low) * DVec3::from_array(geometry.dims.map(count)) * geometry.spacing).length() / unit;
    scene.shadows.reach.map(|reach| reach / unit).filter(|&reach| reach < longest)
}

/// Unit vector `i` of `directions` that are evenly spread over the sphere: a Fibonacci lattice.
#[must_use]
pub fn sky_direction(i: usize, directions: usize) -> DVec3 {
    let golden_angle = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let z = 1.0 - (2.0 * count(i) + 1.0) / count(directions);
    let (sine, cosine) = (count(i) * golden_angle).sin_cos();
    let radius = z.mul_add(-z, 1.0).max(0.0).sqrt();
    DVec3::new(radius * cosine, radius * sine, z)
}

/// Shading coefficients, in lanes; unused numbers are zero.
///
/// With material weights, one entry per material in use. With accumulated spectra, the first ambient and diffuse factor
/// apply to all materials, and the exponents are those of the highlights.
#[derive(Clone, Debug, PartialEq)]
pub struct ShadingTable {
    /// Ambient factors.
    pub ambient: Vec<[f32; LANE]>,
    /// Diffuse factors.
    pub diffuse: Vec<[f32; LANE]>,
    /// Specular factors.
    pub specular: Vec<[f32; LANE]>,
    /// Specular exponents.
    pub exponent: Vec<[u32; LANE]>,
}

impl ShadingTable {
    /// Builds the coefficients of the materials of `planned`.
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
            diffuse: share(Material::own_diffuse),
            specular: share(Material::white_specular),
            exponent,
        }
    }
}
