//! Scene data that the march reads, computed in f64 and rounded once.

mod cells;
mod gradient;
mod lights;
mod rays;
mod reflected;
mod segments;
mod storage;
mod transfer;

pub use cells::{CELL, Cells, Occupancy};
pub use gradient::GradientTable;
pub use lights::{PositionTable, ShadingTable};
pub use rays::{MOST_SAMPLES, RayTable};
pub use reflected::Reflected;
pub use segments::SegmentTable;
pub(crate) use segments::mean_density;
pub use storage::{LabelMap, Storage, StoredVolume, VolumeFormat};
pub use transfer::{LARGEST_DEPTH, Step, Steps, TransferTable};
