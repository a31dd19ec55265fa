//! Tells segmentations with many labels from scans with whole numbers, by voxels and their neighbours (docs/theory/first-look.md).

use relume_base::number::{count, from_label, whole};
use relume_volume::{LabelCounts, Volume};

/// Places that are examined.
const PLACES: usize = 40_000;
/// Least part of the objects' voxels that have at most as many other neighbours as equal ones.
const ALIKE: f64 = 0.6;
/// Least part of the pairs of different neighbours whose values differ by more than 1, the step of a smooth scan.
const JUMPS: f64 = 0.5;
/// Most voxels of a value in voxels of the box around a place, of labels. A scan has each value in many places.
const SPREAD: f64 = 32.0;

/// The volume's values at places of a grid.
struct Places<'a> {
    volume: &'a Volume,
    dims: [usize; 3],
}

impl Places<'_> {
    fn value(&self, [x, y, z]: [usize; 3]) -> f64 {
        self.volume.voxels.value(x + self.dims[0] * (y + self.dims[1] * z)).unwrap_or(f64::NAN)
    }

    /// Every n-th voxel whose value is not `background`.
    fn objects(&self, background: f64) -> impl Iterator<Item = ([usize; 3], f64)> {
        let [nx, ny, nz] = self.dims;
        let all = nx * ny * nz;
        // An odd number of voxels, not to meet the same places of each row.
        let step = (all / PLACES).max(1) | 1;
        (0..all).step_by(step).filter_map(move |index| {
            let place = [index % nx, index / nx % ny, index / (nx * ny)];
            let value = self.value(place);
            differs(value, background).then_some((place, value))
        })
    }

    /// Voxels beside `place` along `axis`, of which there are up to two.
    fn beside(&self, place: [usize; 3], axis: usize) -> impl Iterator<Item = [usize; 3]> {
        let at = |moved: Option<usize>| {
            let moved = moved.filter(|&moved| moved < self.dims[axis])?;
            let mut other = place;
            other[axis] = moved;
            Some(other)
        };
        [at(place[axis].checked_sub(1)), at(Some(place[axis] + 1))].into_iter().flatten()
    }

    /// Number of voxels along `axis` around `place` with the same value.
    fn run(&self, place: [usize; 3], axis: usize, value: f64) -> usize {
        let is_same = |at: usize| {
            let mut other = place;
            other[axis] = at;
            !differs(self.value(other), value)
        };
        let before = (0..place[axis]).rev().take_while(|&at| is_same(at)).count();
        before + 1 + (place[axis] + 1..self.dims[axis]).take_while(|&at| is_same(at)).count()
    }
}

fn differs(one: f64, other: f64) -> bool {
    (one - other).abs() > 0.0
}

/// The smaller value of two opposite corners.
fn background(volume: &Volume) -> f64 {
    let first = volume.voxels.value(0).unwrap_or_default();
    let last = volume.voxels.value(volume.voxels.len().saturating_sub(1)).unwrap_or_default();
    first.min(last)
}

/// Whether the stored numbers of `volume` may be labels: neighbours are mostly equal, and otherwise differ by any number.
pub(super) fn may_be_labels(volume: &Volume) -> bool {
    let places = Places { volume, dims: volume.geometry.dims };
    let (mut objects, mut alike, mut pairs, mut jumps) = (0, 0, 0, 0);
    for (place, value) in places.objects(background(volume)) {
        let (mut all, mut other) = (0, 0);
        for axis in 0..3 {
            for beside in places.beside(place, axis) {
                let difference = (places.value(beside) - value).abs();
                all += 1;
                other += usize::from(difference > 0.0);
                jumps += usize::from(difference > 1.0);
            }
        }
        pairs += other;
        objects += 1;
        alike += usize::from(2 * other <= all);
    }
    objects > 0 && count(alike) >= ALIKE * count(objects) && count(jumps) >= JUMPS * count(pairs)
}

/// True for a label map: few regions a label (`counts` are their voxels), and neighbours that differ by any number of labels.
pub(super) fn are_labels(volume: &Volume, counts: &LabelCounts) -> bool {
    let places = Places { volume, dims: volume.geometry.dims };
    let labels: Vec<f64> = counts.keys().map(|&label| from_label(label)).collect();
    let rank = |value: f64| labels.partition_point(|&label| label < value);
    let (mut pairs, mut jumps) = (0, 0);
    for (place, value) in places.objects(background(volume)) {
        for beside in (0..3).flat_map(|axis| places.beside(place, axis)) {
            // A scan of few values, such as a ramp, has steps from one of them to the next, however large they are.
            let apart = rank(places.value(beside)).abs_diff(rank(value));
            pairs += usize::from(apart > 0);
            jumps += usize::from(apart > 1);
        }
    }
    if count(jumps) < JUMPS * count(pairs) {
        return false;
    }
    let mut spreads: Vec<f64> = Vec::new();
    for (index, (place, value)) in places.objects(background(volume)).enumerate() {
        // A tenth of them tells as much.
        if !index.is_multiple_of(10) {
            continue;
        }
        let label = volume.label(place[0] + places.dims[0] * (place[1] + places.dims[1] * place[2]));
        let all = label.and_then(|label| counts.get(&label)).copied().unwrap_or(0);
        let around: usize = (0..3).map(|axis| places.run(place, axis, value)).product();
        spreads.push(count(usize::try_from(all).unwrap_or(usize::MAX)) / count(around));
    }
    spreads.sort_by(f64::total_cmp);
    spreads.get(whole(0.5 * count(spreads.len()))).is_some_and(|&median| median <= SPREAD)
}
