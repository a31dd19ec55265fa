//! The marches of a picture. They are compiled here, once for f32 and once for f64, and not in every crate that calls them.

use glam::DVec3;

use super::march::{self as generic, Marched, RaySample};
use super::{ReferenceError, Samples};
use crate::Scene;
use crate::film::{Film, RelightMatrices};
use crate::plan::Planned;
use relume_base::number::Real;
use relume_base::progress::Progress;

/// Linear sRGB and opacity of pixels.
type Lit = Vec<(DVec3, f64)>;

/// Observer of the samples of a ray.
type Seen<'a, R> = &'a mut dyn FnMut(&RaySample<'_, R>);

/// The numbers that the reference marches in: f32 and f64.
pub trait Marching: Real {
    /// [`march`] in these numbers.
    #[doc(hidden)]
    fn march(of: &Marched<'_, Self>) -> Result<Film<Self>, ReferenceError>;
    /// [`render`] in these numbers.
    #[doc(hidden)]
    fn render(of: &Marched<'_, Self>, matrices: &RelightMatrices) -> Result<Lit, ReferenceError>;
    /// [`render_pixels`] in these numbers.
    #[doc(hidden)]
    fn render_pixels(
        of: &Marched<'_, Self>,
        matrices: &RelightMatrices,
        wanted: &[[usize; 2]],
    ) -> Result<Lit, ReferenceError>;
    /// [`march_ray`] in these numbers.
    #[doc(hidden)]
    fn march_ray(of: &Marched<'_, Self>, pixel: [usize; 2], seen: Seen<'_, Self>)
    -> Result<Film<Self>, ReferenceError>;
}

macro_rules! marching {
    ($number:ty) => {
        impl Marching for $number {
            fn march(of: &Marched<'_, Self>) -> Result<Film<Self>, ReferenceError> {
                generic::march(of)
            }

            fn render(of: &Marched<'_, Self>, matrices: &RelightMatrices) -> Result<Lit, ReferenceError> {
                generic::render(of, matrices)
            }

            fn render_pixels(
                of: &Marched<'_, Self>,
                matrices: &RelightMatrices,
                wanted: &[[usize; 2]],
            ) -> Result<Lit, ReferenceError> {
                generic::render_pixels(of, matrices, wanted)
            }

            fn march_ray(
                of: &Marched<'_, Self>,
                pixel: [usize; 2],
                seen: Seen<'_, Self>,
            ) -> Result<Film<Self>, ReferenceError> {
                generic::march_ray(of, pixel, seen)
            }
        }
    };
}
marching!(f32);
marching!(f64);

/// Marches every pixel of a picture of `size` (width, height) as planned.
///
/// # Errors
///
/// [`ReferenceError`].
pub fn march<R: Marching>(
    scene: &Scene,
    planned: &Planned,
    samples: &dyn Samples<R>,
    size: [usize; 2],
    progress: &dyn Progress,
) -> Result<Film<R>, ReferenceError> {
    R::march(&Marched { scene, planned, samples, size, progress })
}

/// Marches and relights pixel by pixel: linear sRGB and opacity, rows from the top. Never holds the accumulators of a
/// whole picture. With [`plan_full_spectrum`](crate::plan::plan_full_spectrum) the result is the full-spectrum
/// reference.
///
/// # Errors
///
/// [`ReferenceError`].
pub fn render<R: Marching>(
    scene: &Scene,
    planned: &Planned,
    samples: &dyn Samples<R>,
    matrices: &RelightMatrices,
    size: [usize; 2],
    progress: &dyn Progress,
) -> Result<Lit, ReferenceError> {
    R::render(&Marched { scene, planned, samples, size, progress }, matrices)
}

/// [`render`] for the pixels `wanted`, `[x, y]` with y down: linear sRGB and opacity of each, in the same order.
///
/// # Errors
///
/// [`ReferenceError`].
pub fn render_pixels<R: Marching>(
    scene: &Scene,
    planned: &Planned,
    samples: &dyn Samples<R>,
    matrices: &RelightMatrices,
    size: [usize; 2],
    wanted: &[[usize; 2]],
    progress: &dyn Progress,
) -> Result<Lit, ReferenceError> {
    R::render_pixels(&Marched { scene, planned, samples, size, progress }, matrices, wanted)
}

/// [`march`] for the ray through the centre of pixel `[x, y]`, y down; the film has one pixel. Calls `seen` for each
/// sample, front to back.
///
/// # Errors
///
/// [`ReferenceError`].
pub fn march_ray<R: Marching>(
    scene: &Scene,
    planned: &Planned,
    samples: &dyn Samples<R>,
    [size, pixel]: [[usize; 2]; 2],
    progress: &dyn Progress,
    mut seen: impl FnMut(&RaySample<'_, R>),
) -> Result<Film<R>, ReferenceError> {
    R::march_ray(&Marched { scene, planned, samples, size, progress }, pixel, &mut seen)
}
