//! Results of the rungs and their errors.

use glam::{DMat3, DVec3};

use super::{ExtremeError, Rung};
use crate::rungs::{RungError, Rungs};
use relume_base::progress::Progress;
use relume_colour::spectrum::colour::{
    LINEAR_SRGB_FROM_XYZ, XYZ_FROM_LINEAR_SRGB, Xyz, ciede2000, d65_white, lab_from_xyz,
};
use relume_render::Renderer;
use relume_scene::film::{Film, RelightMatrices};
use relume_scene::plan::Planned;

/// Film and picture of a scene on one rung.
pub(super) struct Left<'a> {
    pub(super) rungs: &'a Rungs,
    pub(super) rung: Rung,
    pub(super) sums: Film<f64>,
    /// Linear sRGB under the scene's own lights.
    pub(super) picture: Vec<DVec3>,
    pub(super) matrices: RelightMatrices,
    /// Number of dispatches; 0 except on a device.
    pub(super) dispatches: usize,
}

impl<'a> Left<'a> {
    /// Renders `rungs` on `rung`; [`Rung::Gpu`] uses `renderer`.
    pub(super) fn new(
        rungs: &'a Rungs,
        rung: Rung,
        renderer: Option<&Renderer>,
        progress: &dyn Progress,
    ) -> Result<Self, ExtremeError> {
        let matrices = rungs.matrices(&rungs.mix);
        let (sums, picture, dispatches) = match (rung, renderer) {
            (Rung::Gpu, Some(renderer)) => {
                let marched = rungs.render(renderer, progress)?;
                let sums = renderer.read(&marched).map_err(RungError::from)?.map(f64::from);
                let linear = || {
                    let shown = renderer.relight_linear(&marched)?;
                    shown.run(&matrices)?;
                    shown.read::<[f32; 4]>()
                };
                let picture = linear().map_err(RungError::from)?;
                let colour = |&[r, g, b, _]: &[f32; 4]| DVec3::from([r, g, b].map(f64::from));
                (sums, picture.iter().map(colour).collect(), marched.dispatches)
            }
            (Rung::Double, _) => {
                let sums = rungs.march::<f64>(&rungs.exact(), progress)?;
                let picture = sums.relight(&matrices);
                (sums, picture, 0)
            }
            _ => {
                let sums = rungs.march::<f32>(&rungs.stored::<f32>(), progress)?;
                let picture = sums.relight(&matrices);
                (sums.map(f64::from), picture, 0)
            }
        };
        Ok(Self { rungs, rung, sums, picture, matrices, dispatches })
    }

    pub(super) fn planned(&self) -> &Planned {
        &self.rungs.planned
    }

    /// Returns a violation of what holds for every scene: finite numbers, transmittance in [0, 1], black without light.
    pub(super) fn problem(&self) -> Option<String> {
        let Film { accumulators, transmittance, .. } = &self.sums;
        let unlit =
            self.rungs.mix.0.iter().all(|light| {
                light.weight == 0.0 || light.spectrum.spectrum().samples().iter().all(|&power| power == 0.0)
            });
        let find = |numbers: &[f64], wrong: &dyn Fn(f64) -> bool| {
            numbers.iter().enumerate().find(|&(_, &number)| wrong(number)).map(|(i, &number)| (i, number))
        };
        let pixels = self.picture.len();
        if let Some((i, number)) = find(accumulators, &|number| !number.is_finite()) {
            return Some(format!("pixel {} holds {number}", i % pixels));
        }
        if let Some((i, number)) = find(transmittance, &|number| !(0.0..=1.0).contains(&number)) {
            return Some(format!("the transmittance of pixel {} is {number}", i % pixels));
        }
        self.picture.iter().enumerate().find_map(|(i, colour)| match colour {
            _ if !colour.is_finite() => Some(format!("pixel {i} is {colour}")),
            _ if unlit && *colour != DVec3::ZERO => Some(format!("pixel {i} is {colour}, without light")),
            _ => None,
        })
    }

    /// Component `c` of pixel `i`'s accumulator for the first light position.
    pub(super) fn weight(&self, c: usize, i: usize) -> f64 {
        self.sums.accumulators.get(c * self.picture.len() + i).copied().unwrap_or(f64::NAN)
    }

    /// Component `c` of pixel `i`'s transmittance.
    pub(super) fn transmittance(&self, c: usize, i: usize) -> f64 {
        self.sums.transmittance.get(c * self.picture.len() + i).copied().unwrap_or(f64::NAN)
    }

    /// XYZ of pixel `i`.
    pub(super) fn xyz(&self, i: usize) -> DVec3 {
        self.picture.get(i).map_or(DVec3::NAN, |&colour| *XYZ_FROM_LINEAR_SRGB * colour)
    }

    /// Error of pixel 0 in linear sRGB against the XYZ `expected`, relative to Σ|terms| of the conversion.
    pub(super) fn colour_error(&self, expected: DVec3) -> f64 {
        let matrix = *LINEAR_SRGB_FROM_XYZ;
        let terms = DMat3::from_cols(matrix.x_axis.abs(), matrix.y_axis.abs(), matrix.z_axis.abs()) * expected.abs();
        let apart = self.picture.first().map_or(DVec3::NAN, |&colour| (colour - matrix * expected).abs());
        worst((0..3).map(|channel| if apart[channel] == 0.0 { 0.0 } else { apart[channel] / terms[channel] }))
    }

    /// Largest difference from `other`, whose film must be identical.
    pub(super) fn apart(&self, other: &Self) -> f64 {
        let numbers = |left: &Self| [left.sums.accumulators.clone(), left.sums.transmittance.clone()].concat();
        let (ours, theirs) = (numbers(self), numbers(other));
        if ours.len() != theirs.len() {
            return f64::NAN;
        }
        worst(ours.iter().zip(&theirs).map(|(one, other)| (one - other).abs()))
    }
}

/// Largest error; NaN if any error is NaN.
pub(super) fn worst(errors: impl IntoIterator<Item = f64>) -> f64 {
    errors.into_iter().fold(0.0, |worst, error| if error <= worst || worst.is_nan() { worst } else { error })
}

/// Error of `found` relative to `expected`; if `expected` is 0, any other value has an infinite error.
pub(super) fn relative(found: f64, expected: f64) -> f64 {
    let error = (found - expected).abs();
    if error == 0.0 { 0.0 } else { error / expected.abs() }
}

/// ΔE00 between two XYZ.
pub(super) fn delta_e(one: DVec3, other: DVec3) -> f64 {
    let lab = |xyz: DVec3| lab_from_xyz(Xyz(xyz.to_array()), d65_white());
    ciede2000(lab(one), lab(other))
}
