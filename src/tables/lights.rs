//! Lights in numbers: positions and shading coefficients for the march.

use glam::DVec3;

use super::rays::unit_length;
use crate::number::rounded;
use crate::plan::{Accumulate, LANE, Planned};
use crate::scene::{Material, Placement, Scene};

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
