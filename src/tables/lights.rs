//! Lights in numbers: directions for the march, and one matrix per position for relighting.

use glam::{DMat3, DVec3};

use super::rays::unit_length;
use super::rounded;
use crate::plan::{LANE, Planned};
use crate::scene::{Display, Mix, Placement, Scene};
use crate::spectrum::colour::{LINEAR_SRGB_FROM_XYZ, Xyz, bradford, d65_white, xyz_of};
use crate::spectrum::{Reflectance, Spectrum};

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

/// Shading coefficients of the materials in use, in lanes; spare ones zero.
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
        let lanes = planned.plan.table_lanes();
        let mut table = Self {
            ambient: vec![[0.0; LANE]; lanes],
            diffuse: vec![[0.0; LANE]; lanes],
            specular: vec![[0.0; LANE]; lanes],
            exponent: vec![[0; LANE]; lanes],
        };
        for (i, &material) in planned.materials.iter().enumerate() {
            let (lane, part, material) = (i / LANE, i % LANE, &scene.materials[material]);
            table.ambient[lane][part] = rounded(material.ambient);
            table.diffuse[lane][part] = rounded(material.diffuse);
            table.specular[lane][part] = rounded(material.specular);
            table.exponent[lane][part] = material.exponent;
        }
        table
    }
}

/// The colour of every component of every position under a mix: what post-illumination multiplies accumulators by.
#[derive(Clone, Debug, PartialEq)]
pub struct RelightMatrices {
    /// Linear sRGB (exposure and adaptation in it) of component `c` at position `p`: `colours[p·components + c]`.
    pub colours: Vec<DVec3>,
    /// Linear sRGB of the background.
    pub background: DVec3,
}

impl RelightMatrices {
    /// Colours of `components` at each of `positions` positions under `mix`, in front of `background`, all sums in f64.
    #[must_use]
    pub fn new(
        components: &[Spectrum],
        positions: usize,
        background: Option<&Reflectance>,
        mix: &Mix,
        display: &Display,
    ) -> Self {
        let (light_at, all) = mix.light_at(positions);
        let display_from_xyz = display_from_xyz(mix, display);
        let colour = |light: &Spectrum, surface: &Spectrum| display_from_xyz * xyz_vector(light, surface);
        Self {
            colours: light_at
                .iter()
                .flat_map(|light| components.iter().map(move |component| colour(light, component)))
                .collect(),
            background: background.map_or(DVec3::ZERO, |surface| colour(&all, surface.spectrum())),
        }
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

/// XYZ of a surface under a light, both as plain spectra.
fn xyz_vector(light: &Spectrum, surface: &Spectrum) -> DVec3 {
    DVec3::from_array(xyz_of(&(light * surface)).0)
}

/// From XYZ to linear sRGB times exposure, by Bradford from the white of the mixed lights where the display adapts.
#[must_use]
pub fn display_from_xyz(mix: &Mix, display: &Display) -> DMat3 {
    let (_, light) = mix.light_at(0);
    let white = xyz_of(&light);
    let adapted = if display.adapt && white.0[1] > 0.0 {
        let relative = Xyz(white.0.map(|component| component / white.0[1]));
        *LINEAR_SRGB_FROM_XYZ * bradford(relative, d65_white())
    } else {
        *LINEAR_SRGB_FROM_XYZ
    };
    adapted * display.exposure
}

/// What the components of a plan reflect: its materials, and white for highlights.
#[must_use]
pub fn components(scene: &Scene, planned: &Planned) -> Vec<Spectrum> {
    let materials = planned.materials.iter().filter_map(|&material| scene.materials.get(material));
    let white = planned.plan.specular().map(|_| Spectrum::constant(1.0));
    materials.map(|material| material.reflectance.spectrum().clone()).chain(white).collect()
}
