//! Depths of light grids that several marches read.

use std::any::Any;
use std::sync::{Arc, Mutex, PoisonError};

use super::ReferenceError;
use crate::tables::{GridLight, LightGrid};
use crate::{Interpolation, ShadowMethod};
use relume_base::memory;
use relume_base::number::Real;

/// Depths of light grids, and rows and solutions of scattered light, kept for further marches: those of exact samples of scenes that differ only in `accuracy` and
/// `shadows`.
#[derive(Debug, Default)]
pub struct KeptDepths<R>(Mutex<Vec<(DepthKey, Arc<Vec<R>>)>>, Mutex<Vec<AnyRows>>);

/// Rows of a type that their reader knows.
type AnyRows = Arc<dyn Any + Send + Sync>;

/// Rows and lights that are kept, of scattered light.
const KEPT_ROWS: usize = 4;

/// [`KeptDepths`], and further inputs of the depths of their samples.
#[derive(Debug)]
pub struct Keeping<'a, R> {
    pub(super) depths: &'a KeptDepths<R>,
    pub(super) interpolation: Interpolation,
    pub(super) smooth_labels: bool,
}

/// Inputs of the depths of one light at the nodes of a grid.
#[derive(Debug, PartialEq)]
pub(super) struct DepthKey {
    pub(super) interpolation: Interpolation,
    pub(super) smooth_labels: bool,
    pub(super) grid: LightGrid,
    /// By rays, the depths of a sky are those of a finer grid; by a grid, they are resampled from a coarser one.
    pub(super) method: ShadowMethod,
    pub(super) light: GridLight,
    pub(super) number: usize,
    pub(super) start: f64,
}

/// Part of the free memory that depths may take.
const KEPT_PART: u64 = 8;

impl<R: Real> KeptDepths<R> {
    /// Rows or light of a `wanted` kind from an earlier march, or `made` now.
    pub(super) fn rows<T: Any + Send + Sync>(
        &self,
        wanted: impl Fn(&T) -> bool,
        made: impl FnOnce() -> Result<T, ReferenceError>,
    ) -> Result<Arc<T>, ReferenceError> {
        let kept = || self.1.lock().unwrap_or_else(PoisonError::into_inner);
        let known = kept().iter().filter_map(|rows| Arc::clone(rows).downcast::<T>().ok()).find(|rows| wanted(rows));
        if let Some(rows) = known {
            return Ok(rows);
        }
        let rows = Arc::new(made()?);
        let mut kept = kept();
        kept.insert(0, Arc::<T>::clone(&rows));
        kept.truncate(KEPT_ROWS);
        Ok(rows)
    }

    /// The depths of `key`, from an earlier march or `filled` now.
    pub(super) fn of(
        &self,
        key: DepthKey,
        filled: impl FnOnce() -> Result<Vec<R>, ReferenceError>,
    ) -> Result<Arc<Vec<R>>, ReferenceError> {
        let kept = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, depths)) = kept().iter().find(|(known, _)| *known == key) {
            return Ok(Arc::clone(depths));
        }
        let depths = Arc::new(filled()?);
        let room = memory::available_bytes().map_or(u64::MAX, |free| free / KEPT_PART);
        let mut kept = kept();
        kept.push((key, Arc::clone(&depths)));
        // The oldest first.
        let bytes = |kept: &[(DepthKey, Arc<Vec<R>>)]| -> u64 {
            kept.iter().map(|(_, depths)| size_of_val(depths.as_slice()) as u64).sum()
        };
        while bytes(&kept) > room {
            kept.remove(0);
        }
        Ok(depths)
    }
}
