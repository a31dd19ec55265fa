//! Patients without what they lie on.

use glam::DMat3;

use super::values::{Kind, Values};
use crate::number::count;
use crate::progress::Progress;
use crate::volume::{Modality, Volume, VolumeError};

/// Hounsfield units below water from which soft tissue begins, with the part of a voxel on its surface.
const SOFT: f64 = 300.0;
/// Hounsfield units below water from which a body may be connected with what it lies on, by cushions and clothes.
const FAINT: f64 = 500.0;
/// Fraction of the voxels of all parts above which parts beside the largest are left out.
const WORTH: f64 = 0.002;
/// Fraction of the largest part from which the others are no table: both feet, for instance.
const SEVERAL: f64 = 0.25;

/// How a body is shown without what it lies on.
#[derive(Clone, Copy)]
pub(super) enum Alone {
    /// The largest connected part of the voxels above this value.
    Above(f64),
    /// The first and the last voxel along each axis of the box of that part.
    Box([[usize; 3]; 2]),
}

impl Alone {
    /// The same with another box.
    pub(super) fn of(self, of_box: impl Fn([[usize; 3]; 2]) -> [[usize; 3]; 2]) -> Self {
        match self {
            Self::Box(corners) => Self::Box(of_box(corners)),
            above => above,
        }
    }
}

/// Removes what a body lies on from the volume, or finds the box of the body in voxels that stay in a file; `None` if there is
/// nothing beside the body. The faintest layer has half of its opacity at the value `faintest`.
pub(super) fn alone(
    volume: &mut Volume,
    values: &Values,
    faintest: f64,
    progress: &dyn Progress,
) -> Result<Option<Alone>, VolumeError> {
    // Of the surfaces of other parts, less than half of the opacity of the faintest layer stays.
    let above = match values.kind {
        Kind::Ct { water } => faintest.clamp(water - FAINT, water - SOFT),
        Kind::Other(None | Some(Modality::Ct)) if volume.anatomical => faintest.min(values.surface_from),
        _ => return Ok(None),
    };
    if !matches!(values.kind, Kind::Ct { .. }) && !has_table(volume.geometry.direction, values, above, progress)? {
        return Ok(None);
    }
    let at_hand = volume.at_hand();
    let parts = match at_hand.parts_above(above, progress) {
        // A file may state CT for values without any tissue.
        Err(VolumeError::NothingAbove { .. }) => return Ok(None),
        parts => parts?,
    };
    let [body, others] = parts.sizes.map(count);
    let is_worth = |others: f64| others > WORTH * (body + others) && others < SEVERAL * body;
    if volume.bricks.is_none() {
        if !is_worth(others) {
            return Ok(None);
        }
        volume.keep_largest(&parts);
        return Ok(Some(Alone::Above(above)));
    }
    let bounds = parts.bounds();
    let [low, high] = bounds;
    let high = std::array::from_fn(|axis| (high[axis] + 1).min(at_hand.geometry.dims[axis] - 1));
    let corners = [low.map(|at| at.saturating_sub(1)), high];
    Ok(is_worth(count(parts.outside(bounds))).then_some(Alone::Box(corners)))
}

/// Whether parts of the voxels above a value lie in front of the patient or behind, from the first slice to the last: without a
/// known unit, only the place of a table tells it from vessels or organs.
fn has_table(direction: DMat3, values: &Values, above: f64, progress: &dyn Progress) -> Result<bool, VolumeError> {
    let thinned = values.thinned.to_volume()?;
    let parts = match thinned.parts_above(above, progress) {
        Err(VolumeError::NothingAbove { .. }) => return Ok(false),
        parts => parts?,
    };
    let [to_back, to_head] = [1, 2].map(|axis| direction.row(axis).abs().max_position());
    let [first, last] = parts.bounds();
    let is_table = |[low, high]: [[usize; 3]; 2]| {
        (high[to_back] < first[to_back] || low[to_back] > last[to_back])
            && low[to_head] == 0
            && high[to_head] + 1 == thinned.geometry.dims[to_head]
    };
    let others = parts.others();
    let of_tables: usize = others.iter().filter(|part| is_table(part.bounds)).map(|part| part.voxels).sum();
    Ok(count(of_tables) > WORTH * parts.sizes.map(count).iter().sum::<f64>())
}
