//! Reference renderer, written for readability: full spectra in f64, and the planned model in f64 and f32.

mod clip;
mod closing;
mod composite;
mod factors;
mod gathered;
mod kept;
mod light;
mod march;
mod marching;
mod paths;
mod phase;
mod rows;
mod samples;
mod scatterer;
mod shadows;
mod skipping;
mod store;
mod thin_film;

pub use closing::across;
pub use composite::{attenuate, attenuate_matrix, composite, composite_matrix};
pub use gathered::{GatheredLight, TransferRows};
pub use kept::{Keeping, KeptDepths};
pub use march::{Marched, RaySample};
pub use marching::{Marching, march, march_ray, render, render_pixels};
pub use samples::{Crossing, End, Exact, Label, Normals, Samples, Step, Stored, Values};
pub use skipping::Skipping;
pub use store::store;

use relume_base::number::readable;

/// Error of the reference renderer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReferenceError {
    /// Cancelled by the caller.
    #[error("the reference was cancelled")]
    Cancelled,
    /// A ray has more samples than the limit.
    #[error("a ray has more than 8388608 samples of length {}; set a longer step", readable(*step_length))]
    TooManySamples {
        /// Δs in world units.
        step_length: f64,
    },
    /// The camera has no view direction.
    #[error(
        "the camera has no line of sight: its target is its position, or its up direction is parallel to the line of sight"
    )]
    Camera,
    /// Light that scatters often has no stable amount.
    #[error(
        "the light that scatters again and again does not settle within {iterations} iterations; take a larger scattering.spacing, or reflectances below 1"
    )]
    Unsolved {
        /// Number of iterations.
        iterations: usize,
    },
    /// Scattered light does not fit into the free memory.
    #[error(
        "scattered light at places {} voxels apart, from {directions} directions, needs some {needed_mb} MB of memory, and {free_mb} are free; set a larger scattering.spacing, or fewer scattering.directions",
        readable(*spacing)
    )]
    ScatteredLight {
        /// Spacing of its nodes in voxels.
        spacing: f64,
        /// Directions from which a node gathers.
        directions: usize,
        /// Estimated size in MiB.
        needed_mb: u64,
        /// Free memory in MiB.
        free_mb: u64,
    },
    /// Samples come from no volume.
    #[error("light scatters once in samples that come from no volume")]
    Volumeless,
    /// A light grid does not fit into the free memory.
    #[error(
        "a light grid with a node every {} voxels needs {needed_mb} MB of memory, and {free_mb} are free; set a larger shadows.spacing, or shadows.method = \"rays\"",
        readable(*spacing)
    )]
    LightGrid {
        /// Spacing of its nodes in voxels.
        spacing: f64,
        /// Size of its depths in MiB.
        needed_mb: u64,
        /// Free memory in MiB.
        free_mb: u64,
    },
}

impl ReferenceError {
    /// Name for programs; it does not change between versions.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Cancelled => "cancelled",
            Self::TooManySamples { .. } => "samples-too-many",
            Self::Camera => "camera-without-direction",
            Self::Unsolved { .. } => "scattering-unsolved",
            Self::ScatteredLight { .. } => "scattered-light-memory-exceeded",
            Self::Volumeless => "samples-without-volume",
            Self::LightGrid { .. } => "light-grid-memory-exceeded",
        }
    }
}
