//! The slab: a uniform volume under parallel rays along an axis, a scene with a closed form.

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;

use super::ExtremeError;
use super::left::{Left, relative, worst};
use crate::rungs::Rungs;
use relume_base::number::count;
use relume_base::progress::Quiet;
use relume_document::{SceneOptions, parse};
use relume_scene::plan::plan_full_spectrum;
use relume_scene::{Aim, Camera, Projection, Scene};
use relume_volume::{Geometry, Volume, Voxels};

/// A scene and its picture size.
pub(super) struct Picture {
    pub(super) scene: Scene,
    pub(super) size: [usize; 2],
    /// Whether to compute all 81 bands, regardless of the plan.
    pub(super) full_spectrum: bool,
}

impl Picture {
    /// Returns a picture of one pixel.
    pub(super) fn of(scene: Scene) -> Self {
        Self { scene, size: [1, 1], full_spectrum: false }
    }

    pub(super) fn rungs(self) -> Result<Rungs, ExtremeError> {
        Ok(if self.full_spectrum {
            let planned = plan_full_spectrum(&self.scene);
            Rungs::planned(self.scene, planned, self.size)?
        } else {
            Rungs::new(self.scene, self.size)?
        })
    }
}

/// Value of all voxels; the material's interval contains it.
const VALUE: u16 = 150;

/// Uniform volume; lengths are in world units, which are voxels. See the [module](self).
#[derive(Clone, Debug)]
pub(super) struct Slab {
    pub(super) dims: [usize; 3],
    /// Per [`Self::opacity_length`].
    pub(super) opacity: f64,
    pub(super) opacity_length: f64,
    /// Additional absorption: the spectrum in scene-file syntax, and its depth per unit length.
    pub(super) absorption: Option<(&'static str, f64)>,
    pub(super) step: f64,
    /// In scene-file syntax.
    pub(super) reflectance: &'static str,
    /// One entry per light, in scene-file syntax.
    pub(super) lights: Vec<String>,
    /// Lines of `[accuracy]`, in scene-file syntax.
    pub(super) accuracy: String,
}

impl Default for Slab {
    /// Eight steps of one voxel with an opacity of 0.1 each, under D65.
    fn default() -> Self {
        Self {
            dims: [5, 5, 9],
            opacity: 0.1,
            opacity_length: 1.0,
            absorption: None,
            step: 1.0,
            reflectance: "\"orange\"",
            lights: vec!["spectrum = \"D65\"".to_owned()],
            accuracy: String::new(),
        }
    }
}

/// Absorption spectrum with a base at every wavelength and a peak in the green.
pub(super) const GREEN: &str = "{ gaussian = [{ centre = 540, sigma = 40, height = 1 }], base = 0.1 }";

impl Slab {
    /// Length of a ray in the volume: from the first voxel to the last, or 1 for a single voxel.
    pub(super) fn length(&self) -> f64 {
        let along = self.dims[2];
        if along == 1 { 1.0 } else { count(along - 1) }
    }

    /// Number of samples of a ray.
    pub(super) fn samples(&self) -> f64 {
        (self.length() / self.step).ceil()
    }

    pub(super) fn scene(&self) -> Result<Scene, ExtremeError> {
        let Self { opacity, opacity_length, step, reflectance, accuracy, .. } = self;
        let (shape, depth) =
            self.absorption.map_or((String::new(), 0.0), |(shape, depth)| (format!("absorption = {shape}"), depth));
        let lights: String =
            self.lights.iter().enumerate().map(|(i, light)| format!("[lights.l{i}]\n{light}\n")).collect();
        let text = format!(
            r#"
            shading = "none"
            [materials.only]
            reflectance = {reflectance}
            {shape}
            [transfer]
            opacity_length = {opacity_length}
            [[transfer.intervals]]
            material = "only"
            range = [100, 200]
            opacity = {opacity}
            absorption = {depth}
            {lights}
            [accuracy]
            step = {step}
            termination = 0
            {accuracy}
            "#
        );
        scene_of(&text, slab(self.dims)?)
    }

    pub(super) fn picture(&self) -> Result<Picture, ExtremeError> {
        Ok(Picture::of(self.scene()?))
    }

    /// Returns the accumulator and the transmittance along `length`, per component.
    pub(super) fn closed_form(&self, left: &Left<'_>, length: f64) -> [Vec<f64>; 2] {
        let Some(material) = left.rungs.scene.materials.first() else { return [Vec::new(), vec![1.0]] };
        let planned = left.planned();
        let scattering = -(-self.opacity).ln_1p() / self.opacity_length;
        let (reflectance, shape) = (material.reflectance.spectrum(), material.absorption.as_ref());
        let (reflected, absorbed) = match &planned.model {
            None => (vec![1.0; planned.plan.components()], vec![1.0]),
            Some(model) => (
                model.coefficients(reflectance),
                shape.map_or_else(Vec::new, |shape| model.absorption_coefficients(shape.spectrum())),
            ),
        };
        let depth = self.absorption.map_or(0.0, |(_, depth)| depth);
        let extinction: Vec<f64> = (0..planned.plan.transmittance_numbers())
            .map(|c| scattering + depth * absorbed.get(c).copied().unwrap_or(0.0))
            .collect();
        let weight = |(c, part): (usize, &f64)| {
            let extinction = extinction[c.min(extinction.len() - 1)];
            if extinction.is_infinite() {
                *part
            } else {
                -part * scattering / extinction * (-extinction * length).exp_m1()
            }
        };
        let weights = reflected.iter().enumerate().map(weight).collect();
        [weights, extinction.iter().map(|extinction| (-extinction * length).exp()).collect()]
    }

    /// Returns the largest error of pixel 0 against the closed form. Accumulators have relative errors. Transmittance
    /// has an absolute error where a step's opacity exceeds 0.5, because rounding α changes 1 − α by more; otherwise
    /// its error is relative to the value, or to √[`f32::MIN_POSITIVE`] if that is larger.
    pub(super) fn error(&self, left: &Left<'_>) -> f64 {
        self.error_at(left, 0, self.length())
    }

    /// Returns the same error for pixel `i`, whose ray has this `length` in the volume.
    pub(super) fn error_at(&self, left: &Left<'_>, i: usize, length: f64) -> f64 {
        let [weights, transmittance] = self.closed_form(left, length);
        let plan = &left.planned().plan;
        if [weights.len(), transmittance.len()] != [plan.components(), plan.transmittance_numbers()] {
            return f64::NAN;
        }
        let weights = weights.iter().enumerate().map(|(c, &expected)| relative(left.weight(c, i), expected));
        let transmittance = transmittance.iter().enumerate().map(|(c, &expected)| {
            let of_step = expected.powf(self.step.min(length) / length);
            let size = if of_step < 0.5 { 1.0 } else { expected.max(f64::from(f32::MIN_POSITIVE).sqrt()) };
            (left.transmittance(c, i) - expected).abs() / size
        });
        worst(weights.chain(transmittance))
    }

    /// Returns the error of pixel 0 in linear sRGB against the closed form relit in f64, relative to Σ|terms|.
    pub(super) fn picture_error(&self, left: &Left<'_>) -> f64 {
        let [weights, transmittance] = self.closed_form(left, self.length());
        let numbers =
            weights.iter().zip(&left.matrices.colours).chain(transmittance.iter().zip(&left.matrices.background));
        let (mut expected, mut size) = (DVec3::ZERO, DVec3::ZERO);
        for (&number, &colour) in numbers {
            expected += number * colour;
            size += (number * colour).abs();
        }
        let apart = left.picture.first().map_or(DVec3::NAN, |&colour| (colour - expected).abs());
        worst((0..3).map(|channel| if apart[channel] == 0.0 { 0.0 } else { apart[channel] / size[channel] }))
    }
}

/// Parses the scene in `text` and gives it `volume`, viewed along z.
pub(super) fn scene_of(text: &str, volume: Volume) -> Result<Scene, ExtremeError> {
    let text = format!("version = 1\n{text}\n[volume]\nphantom = \"slab\"\ndims = [2, 2, 2]\n");
    let mut scene = parse("an extreme", &text, Path::new(""), &SceneOptions::default(), &Quiet)?.scene;
    scene.camera = straight_on(&volume.geometry);
    scene.set_volume(Arc::new(volume));
    Ok(scene)
}

/// Camera with parallel rays along z through the middle of the volume of `geometry`.
pub(super) fn straight_on(geometry: &Geometry) -> Camera {
    let [x, y, _] = geometry.dims;
    let middle = DVec3::new(0.5 * (count(x) - 1.0), 0.5 * (count(y) - 1.0), 0.0) * geometry.spacing;
    let smallest = geometry.spacing.min_element();
    Camera {
        projection: Projection::Orthographic { height: Some(0.5 * smallest) },
        aim: Aim::LookAt { position: middle - DVec3::Z * 10.0 * smallest, target: middle },
        up: DVec3::Y,
    }
}

/// Uniform volume.
pub(super) fn slab(dims: [usize; 3]) -> Result<Volume, ExtremeError> {
    volume(dims, Voxels::U16(vec![VALUE; dims.iter().product()]))
}

/// Volume of spacing 1.
pub(super) fn volume(dims: [usize; 3], voxels: Voxels) -> Result<Volume, ExtremeError> {
    Ok(Volume::new("an extreme", voxels, Geometry::unit("an extreme", dims)?)?)
}
