//! Light positions and shading coefficients of the march.

use glam::{DVec3, DVec4};

use super::rays::{crop_box, unit_length};
use crate::plan::{Accumulate, LANE, Planned, ScenePlan};
use crate::{Material, Placement, Scene, three_point};
use relume_base::number::{count, rounded};

/// Reciprocal of the smallest turn of a three-point light that changes its light grid.
const FINEST_TURN: f64 = 1e9;

/// Vectors of the light positions, in the order of the plan and along the volume's own axes: unit vectors towards
/// directional lights, coordinates of point lights (in units of length, from the texture's corner), zero for ambient
/// lights and headlights. A three-point light has three unit vectors. The fourth number is a weight.
#[derive(Clone, Debug, PartialEq)]
pub struct PositionTable(pub Vec<DVec4>);

impl PositionTable {
    /// Builds the positions of `planned` relative to the volume of `scene`.
    #[must_use]
    pub fn new(scene: &Scene, planned: &Planned) -> Self {
        let geometry = &scene.volume.geometry;
        let local_from_world = geometry.direction.inverse();
        let one = |vector: DVec3| vec![vector.extend(1.0)];
        let vectors = |placement: Placement| match placement {
            Placement::Ambient | Placement::Headlight => one(DVec3::ZERO),
            Placement::Directional(direction) => one(local_from_world * direction),
            Placement::Point(world) => {
                one((local_from_world * (world - geometry.origin) + geometry.spacing / 2.0) / unit_length(geometry))
            }
            Placement::ThreePoint => {
                // The direction of the picture does not depend on its shape. A march needs a line of sight.
                let lights =
                    scene.camera.view(geometry, 1.0).map_or([(DVec3::ZERO, 0.0); 3], |view| three_point(&view));
                lights.map(|(direction, weight)| (local_from_world * direction).extend(weight)).to_vec()
            }
        };
        Self(planned.positions.iter().flat_map(|position| vectors(position.placement)).collect())
    }

    /// The lights of the light grid of `scene`: those of [`ScenePlan::shadow_vectors`], in their order, and ambient light
    /// if the medium dims it. Directions of a three-point light are rounded, so that its light grid is kept when the camera
    /// moves without a turn.
    #[must_use]
    pub fn grid_lights(&self, scene: &Scene, plan: &ScenePlan) -> Vec<GridLight> {
        let (directional, points) = (plan.shadowed().len(), plan.first_point());
        let light = |(number, vector): (usize, &DVec4)| {
            let vector = vector.truncate();
            if number < directional {
                GridLight::From(vector)
            } else if number < points {
                GridLight::From(((vector * FINEST_TURN).round() / FINEST_TURN).normalize_or_zero())
            } else {
                GridLight::At(vector)
            }
        };
        let sky = GridLight::Sky { directions: scene.shadows.directions, reach: sky_reach(scene) };
        let placed = plan.shadow_vectors().filter_map(|vector| self.0.get(vector)).enumerate().map(light);
        placed.chain(plan.sky().map(|_| sky)).collect()
    }

    /// The depths of [`Self::grid_lights`]: of each light in turn, that of all that is grey, and one per coloured absorber.
    #[must_use]
    pub fn grid_depths(&self, scene: &Scene, plan: &ScenePlan) -> Vec<GridDepth> {
        let lights = self.grid_lights(scene, plan).into_iter();
        lights.flat_map(|light| (0..=plan.absorbers()).map(move |number| GridDepth { light, number })).collect()
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
    let geometry = &scene.volume.geometry;
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
