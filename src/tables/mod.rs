//! Scene data that the march reads, computed in f64 and rounded once.

mod cells;
mod gradient;
mod lights;
mod rays;
mod reflected;
mod storage;
mod transfer;

pub use cells::{CELL, Cells, Occupancy};
pub use gradient::GradientTable;
pub use lights::{PositionTable, ShadingTable};
pub use rays::{MOST_SAMPLES, RayTable};
pub use reflected::Reflected;
pub use storage::{LabelMap, Storage, StoredVolume, VolumeFormat};
pub use transfer::{Step, Steps, TransferTable};
