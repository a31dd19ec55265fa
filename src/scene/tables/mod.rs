//! Scene data that the march reads, computed in f64 and rounded once.

mod boxes;
mod bricks;
mod cells;
mod clip;
mod crossings;
mod factors;
mod hidden;
mod labels;
mod lights;
mod phase;
mod placed;
mod rays;
mod reflected;
mod segments;
mod shadows;
mod storage;
mod stored;
mod thin_film;
mod transfer;
mod whole;

pub use boxes::read_for_box;
pub use bricks::{BRICK, BrickGrid, apron, reach_in_voxels, slot_edge};
pub use cells::{CELL, Cells, Occupancy, occupancy_of_fields};
pub use clip::{CapTable, ClipTable};
pub use crossings::{CROSSING_CELLS, CrossingTable};
pub use factors::FactorTable;
pub use hidden::{read_in_crop, read_of_placed};
pub use labels::{LabelRows, LabelTable};
pub use lights::{GridDepth, GridLight, PositionTable, ShadingTable, sky_direction, sky_reach};
pub use phase::{Phase, PhaseTable};
pub use placed::{PlacedField, gradient_numbers};
pub use rays::{BlockBox, MOST_SAMPLES, RayTable, phase_of_ray, ray_phase, ray_places};
pub use reflected::Reflected;
pub use segments::SegmentTable;
pub(crate) use segments::mean_density;
pub use shadows::{
    ExtinctionTable, GRID_LIGHTS, LARGEST_RISE, LARGEST_SKY_DEPTH, LightGrid, PointRays, SECOND_DIFFERENCE,
    SKY_SPACING, Sweep, Within, sky_spacing,
};
pub use storage::{LabelMap, NumberStorage, Storage, StoredVolume, VolumeFormat};
pub use stored::StoredScene;
pub use thin_film::{FILM_ROWS, ThinFilmRows, ThinFilmTable};
pub use transfer::{LARGEST_DEPTH, Step, Steps, TransferTable};

use relume_volume::Geometry;

/// Unit of length in world units: the smallest spacing.
#[must_use]
fn unit_length(geometry: &Geometry) -> f64 {
    geometry.spacing.min_element()
}
