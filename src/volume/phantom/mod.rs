//! Phantoms: volumes given by formulas, among them a frog and an engine.

use std::f64::consts::PI;
use std::fmt;
use std::str::FromStr;

use super::{Geometry, Volume, VolumeError, Voxels};
use relume_base::memory;
use relume_base::parallel;

pub mod engine;
mod field;
pub mod frog;

/// A volume given by a formula, with spacing 1 and origin 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Phantom {
    /// [`slab`] of [`SLAB_VALUE`], 64³.
    Slab,
    /// [`shells`], 64³.
    Shells,
    /// [`gaussian`], 64³.
    Gaussian,
    /// [`marschner_lobb`], 41³ as sampled by its authors.
    MarschnerLobb,
    /// A [`frog`], 250×235×138.
    Frog,
    /// An [`engine`], 250×235×138.
    Engine,
}

impl Phantom {
    /// All phantoms.
    pub const ALL: [Self; 6] =
        [Self::Slab, Self::Shells, Self::Gaussian, Self::MarschnerLobb, Self::Frog, Self::Engine];

    /// Name for files and flags.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Slab => "slab",
            Self::Shells => "shells",
            Self::Gaussian => "gaussian",
            Self::MarschnerLobb => "marschner_lobb",
            Self::Frog => "frog",
            Self::Engine => "engine",
        }
    }

    /// Default number of voxels along x, y and z.
    #[must_use]
    pub fn dims(self) -> [usize; 3] {
        match self {
            Self::Slab | Self::Shells | Self::Gaussian => [64; 3],
            Self::MarschnerLobb => [41; 3],
            Self::Frog => frog::DIMS,
            Self::Engine => engine::DIMS,
        }
    }
}

impl fmt::Display for Phantom {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.name())
    }
}

impl FromStr for Phantom {
    type Err = VolumeError;

    fn from_str(text: &str) -> Result<Self, VolumeError> {
        Self::ALL.into_iter().find(|phantom| phantom.name() == text).ok_or_else(|| VolumeError::UnknownPhantom {
            name: text.to_owned(),
            known: Self::ALL.map(Self::name).join(", "),
        })
    }
}

impl Volume {
    /// Makes a phantom; other `dims` than the default scale it along each axis, and keep its edges two voxels wide.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Dims`] if an axis has no voxels or the voxels cannot be addressed, [`VolumeError::Memory`] if
    /// there is not enough memory.
    pub fn phantom(phantom: Phantom, dims: Option<[usize; 3]>) -> Result<Self, VolumeError> {
        let dims = dims.unwrap_or(phantom.dims());
        match phantom {
            Phantom::Slab => slab(dims, SLAB_VALUE),
            Phantom::Shells => shells(dims),
            Phantom::Gaussian => gaussian(dims),
            Phantom::MarschnerLobb => marschner_lobb(dims),
            Phantom::Frog => made("frog", dims, 1, |dims| Voxels::U8(frog::voxels(dims))),
            Phantom::Engine => made("engine", dims, 1, |dims| Voxels::U8(engine::voxels(dims))),
        }
    }

    /// Makes the labels of [`Phantom::Frog`] for the same `dims`; their names are [`frog::LABELS`].
    ///
    /// # Errors
    ///
    /// [`VolumeError::Dims`] if an axis has no voxels or the voxels cannot be addressed, [`VolumeError::Memory`] if
    /// there is not enough memory.
    pub fn frog_labels(dims: Option<[usize; 3]>) -> Result<Self, VolumeError> {
        made("frog_labels", dims.unwrap_or(frog::DIMS), 1, |dims| Voxels::U8(frog::labels(dims)))
    }
}

/// Makes a phantom with `voxel_bytes` bytes per voxel.
fn made(
    name: &str,
    dims: [usize; 3],
    voxel_bytes: u64,
    make: impl FnOnce([usize; 3]) -> Voxels,
) -> Result<Volume, VolumeError> {
    let geometry = Geometry::unit(name, dims)?;
    // Compares with the available memory, because an allocator may promise more than the system has.
    let bytes = u64::try_from(geometry.voxels()).unwrap_or(u64::MAX).saturating_mul(voxel_bytes);
    if memory::available_bytes().is_some_and(|available| bytes > available) {
        return Err(VolumeError::Memory { source_name: format!("the phantom {name}"), bytes });
    }
    Volume::new(name, make(dims), geometry)
}

/// Value of [`Phantom::Slab`].
pub const SLAB_VALUE: u8 = 128;

/// A constant volume of `value`, `uint8`.
///
/// # Errors
///
/// [`VolumeError::Dims`] if an axis has no voxels or the voxels cannot be addressed, [`VolumeError::Memory`] if there
/// is not enough memory.
pub fn slab(dims: [usize; 3], value: u8) -> Result<Volume, VolumeError> {
    made("slab", dims, 1, |dims| Voxels::U8(vec![value; dims.iter().product()]))
}

/// Number of crests of [`shells`] between the centre and the middle of a face.
pub const SHELLS: u8 = 4;

/// Concentric shells `½ + ½ cos(2π · SHELLS · r)`, `float32`; `r = √(x² + y² + z²)`, and every axis goes from −1 to 1.
///
/// # Errors
///
/// [`VolumeError::Dims`] if an axis has no voxels or the voxels cannot be addressed, [`VolumeError::Memory`] if there
/// is not enough memory.
pub fn shells(dims: [usize; 3]) -> Result<Volume, VolumeError> {
    closed_form("shells", dims, |[x, y, z]| {
        let r = (x * x + y * y + z * z).sqrt();
        0.5 + 0.5 * (2.0 * PI * f64::from(SHELLS) * r).cos()
    })
}

/// Standard deviation of [`gaussian`].
pub const GAUSSIAN_SIGMA: f64 = 0.4;

/// `exp(−(x² + y² + z²) / 2σ²)` with σ = [`GAUSSIAN_SIGMA`], `float32`; every axis goes from −1 to 1.
///
/// # Errors
///
/// [`VolumeError::Dims`] if an axis has no voxels or the voxels cannot be addressed, [`VolumeError::Memory`] if there
/// is not enough memory.
pub fn gaussian(dims: [usize; 3]) -> Result<Volume, VolumeError> {
    closed_form("gaussian", dims, |[x, y, z]| (-(x * x + y * y + z * z) / (2.0 * GAUSSIAN_SIGMA.powi(2))).exp())
}

/// The test signal of Marschner and Lobb (Visualization 1994), `float32`; every axis goes from −1 to 1:
/// `(1 − sin(πz/2) + α(1 + ρ(√(x² + y²)))) / (2(1 + α))`, `ρ(r) = cos(2π f cos(πr/2))`, f = 6, α = ¼.
///
/// # Errors
///
/// [`VolumeError::Dims`] if an axis has no voxels or the voxels cannot be addressed, [`VolumeError::Memory`] if there
/// is not enough memory.
pub fn marschner_lobb(dims: [usize; 3]) -> Result<Volume, VolumeError> {
    const FREQUENCY: f64 = 6.0;
    const ALPHA: f64 = 0.25;
    closed_form("marschner_lobb", dims, |[x, y, z]| {
        let ripple = (2.0 * PI * FREQUENCY * (PI * x.hypot(y) / 2.0).cos()).cos();
        (1.0 - (PI * z / 2.0).sin() + ALPHA * (1.0 + ripple)) / (2.0 * (1.0 + ALPHA))
    })
}

/// Samples `form` with every axis from −1 to 1; an axis of one voxel is at 0.
#[expect(clippy::cast_precision_loss, clippy::cast_possible_truncation, reason = "indices; rounded once to the type")]
fn closed_form(name: &str, dims: [usize; 3], form: impl Fn([f64; 3]) -> f64 + Sync) -> Result<Volume, VolumeError> {
    let place = |index: usize, axis: usize| match dims[axis] {
        1 => 0.0,
        n => (2 * index) as f64 / (n - 1) as f64 - 1.0,
    };
    made(name, dims, 4, |[width, height, _]| {
        let mut voxels = vec![0.0_f32; dims.iter().product()];
        parallel::rows_mut(&mut voxels, width, &|row, out| {
            let (y, z) = (place(row % height, 1), place(row / height, 2));
            for (x, voxel) in out.iter_mut().enumerate() {
                *voxel = form([place(x, 0), y, z]) as f32;
            }
        });
        Voxels::F32(voxels)
    })
}
