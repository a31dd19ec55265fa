//! Removes tables, head rests and specks from first looks.

use std::sync::Arc;

use super::values::{Kind, Values};
use relume_base::number::count;
use relume_base::progress::Progress;
use relume_volume::{Modality, PartBox, Volume, VolumeError};

/// Hounsfield units below water from which soft tissue begins, with the part of a voxel on its surface.
const SOFT: f64 = 300.0;
/// Hounsfield units below water from which a body may be connected with what it lies on, by cushions and clothes.
const FAINT: f64 = 500.0;
/// Fraction of the voxels of all parts above which parts beside the largest are left out.
const WORTH: f64 = 0.002;
/// Fraction of the largest part from which the others are no table: both feet, for instance.
const SEVERAL: f64 = 0.25;

/// Voxels of a part from which it is no speck.
pub(super) const SPECK: usize = 50;
/// Largest part of the voxels of all parts that specks may have: of grains, drops or noise, most parts are small.
const FEW_SPECKS: f64 = 0.1;
/// Most voxels of a volume in which specks are looked for: runs of noise take up to sixteen bytes a voxel.
const MOST_VOXELS: usize = 1 << 27;

/// How a first look leaves parts out.
#[derive(Clone, Copy)]
pub(super) enum Alone {
    /// The largest connected part of the voxels above this value.
    Above(f64),
    /// The first and the last voxel along each axis of the box of that part.
    Box([[usize; 3]; 2]),
    /// Without the parts of fewer than [`SPECK`] voxels above this value.
    Specks(f64),
}

impl Alone {
    /// The same with another box.
    pub(super) fn of(self, of_box: impl Fn([[usize; 3]; 2]) -> [[usize; 3]; 2]) -> Self {
        match self {
            Self::Box(corners) => Self::Box(of_box(corners)),
            Self::Above(_) | Self::Specks(_) => self,
        }
    }
}

/// Removes all parts but the largest from the volume, or finds the box of the largest in voxels that stay in a file; `None` if it
/// removes nothing. The lowest layer is half as opaque as further up at the value `lowest`.
pub(super) fn alone(
    volume: &mut Arc<Volume>,
    values: &Values,
    lowest: f64,
    progress: &dyn Progress,
) -> Result<Option<Alone>, VolumeError> {
    // Of the surfaces of other parts, less than half of the opacity of the lowest layer stays.
    let above = match values.kind {
        Kind::Ct { water } => lowest.clamp(water - FAINT, water - SOFT),
        Kind::Other(None | Some(Modality::Ct)) if volume.anatomical => lowest.min(values.surface_from),
        _ => return Ok(None),
    };
    if !matches!(values.kind, Kind::Ct { .. }) && !has_table(volume, values, above, progress)? {
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
        Arc::make_mut(volume).keep_largest(&parts);
        return Ok(Some(Alone::Above(above)));
    }
    let bounds = parts.bounds();
    let [low, high] = bounds;
    let high = std::array::from_fn(|axis| (high[axis] + 1).min(at_hand.geometry.dims[axis] - 1));
    let corners = [low.map(|at| at.saturating_sub(1)), high];
    Ok(is_worth(count(parts.outside(bounds))).then_some(Alone::Box(corners)))
}

/// Removes the specks of layers from the volume, where they are few beside the rest; `None` if there are none or many. Voxels that
/// stay in a file keep them.
pub(super) fn without_specks(
    volume: &mut Arc<Volume>,
    lowest: f64,
    progress: &dyn Progress,
) -> Result<Option<Alone>, VolumeError> {
    if volume.bricks.is_some() || volume.geometry.dims.iter().product::<usize>() > MOST_VOXELS {
        return Ok(None);
    }
    let parts = match volume.parts_above(lowest, progress) {
        Err(VolumeError::NothingAbove { .. }) => return Ok(None),
        parts => parts?,
    };
    let (specks, all) = (parts.specks(SPECK), parts.sizes.iter().sum::<usize>());
    if specks == 0 || count(specks) > FEW_SPECKS * count(all) {
        return Ok(None);
    }
    Arc::make_mut(volume).remove_smaller(&parts, SPECK);
    Ok(Some(Alone::Specks(lowest)))
}

/// Whether there is a table among the parts of the voxels above a value: parts behind the patient, from the first slice to the
/// last, that are at least a third as wide together. Without a known unit, only its place tells a table from organs and vessels.
fn has_table(volume: &Volume, values: &Values, above: f64, progress: &dyn Progress) -> Result<bool, VolumeError> {
    /// Fewest slices of the thinned copy.
    const SLICES: usize = 8;
    const WIDTH: f64 = 1.0 / 3.0;
    let thinned = values.thinned.to_volume(&volume.source)?;
    let parts = match thinned.parts_above(above, progress) {
        Err(VolumeError::NothingAbove { .. }) => return Ok(false),
        parts => parts?,
    };
    let direction = volume.geometry.direction;
    let [across, to_back, to_head] = [0, 1, 2].map(|axis| direction.row(axis).abs().max_position());
    let slices = thinned.geometry.dims[to_head];
    let (PartBox { bounds: [first, last], .. }, others) = parts.boxes();
    let is_table = |PartBox { bounds: [low, high], .. }: &PartBox| {
        let is_behind =
            if direction.col(to_back).y > 0.0 { low[to_back] > last[to_back] } else { high[to_back] < first[to_back] };
        is_behind && low[to_head] == 0 && high[to_head] + 1 == slices
    };
    let tables: Vec<PartBox> = others.into_iter().filter(is_table).collect();
    let ends = |end: usize| tables.iter().map(move |part| part.bounds[end][across]);
    let (Some(left), Some(right)) = (ends(0).min(), ends(1).max()) else { return Ok(false) };
    let voxels: usize = tables.iter().map(|part| part.voxels).sum();
    let is_wide = count(right - left) > WIDTH * count(last[across] - first[across]);
    Ok(slices >= SLICES && is_wide && count(voxels) > WORTH * parts.sizes.map(count).iter().sum::<f64>())
}
