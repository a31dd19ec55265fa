//! The scene in numbers a march reads, computed in f64 and rounded once.

mod accumulation;
mod cells;
mod lights;
mod rays;
mod reflected;
mod storage;
mod transfer;

pub use accumulation::Accumulation;
pub use cells::{CELL, Cells, Occupancy};
pub use lights::{Components, PositionTable, RelightMatrices, ShadingTable, display_from_xyz};
pub use rays::{MOST_SAMPLES, RayTable};
pub use reflected::Reflected;
pub use storage::{LabelMap, Storage, StoredVolume, VolumeFormat};
pub use transfer::{Step, Steps, TransferTable};

/// Rounds to the f32 a shader reads.
#[expect(clippy::cast_possible_truncation, reason = "the one rounding of tables")]
#[must_use]
pub(crate) fn rounded(value: f64) -> f32 {
    value as f32
}
