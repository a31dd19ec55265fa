//! Connected parts of the voxels above a value: the largest, and specks.

use std::collections::BTreeMap;
use std::path::Path;

use super::{Volume, VolumeError, Voxel, with_voxels};
use crate::data::check_cancelled;
use relume_base::number::unsigned;
use relume_base::parallel;
use relume_base::progress::Progress;

/// Slices between two reports of the progress.
const SLICES: usize = 32;
/// Voxels that are compared at once: mostly all of them are above the value, or none.
const LANES: usize = 32;

/// Neighbours in a row above the value: the first, and the first behind them.
type Run = [u32; 2];

/// The runs of a slice.
#[derive(Debug)]
struct Slice {
    runs: Vec<Run>,
    /// Number of the first run of each row, and of all runs.
    rows: Vec<usize>,
    /// Number of the first run among those of all slices.
    first: usize,
    /// The finite stored number of the smallest value.
    lowest: f64,
}

impl Slice {
    /// Number of the first run of a row among those of all slices, and its runs.
    fn numbered(&self, y: usize) -> (usize, &[Run]) {
        (self.first + self.rows[y], &self.runs[self.rows[y]..self.rows[y + 1]])
    }

    /// The runs of a row whose number `is_wanted`: the first voxel of each, and the first behind them.
    fn row(&self, y: usize, is_wanted: impl Fn(usize) -> bool) -> impl DoubleEndedIterator<Item = [usize; 2]> {
        let (first, runs) = self.numbered(y);
        let wanted = runs.iter().enumerate().filter(move |&(number, _)| is_wanted(first + number));
        wanted.map(|(_, run)| run.map(|end| end as usize))
    }
}

/// Runs that are connected; of these the first is their root.
struct Joined(Vec<usize>);

impl Joined {
    fn root(&mut self, mut run: usize) -> usize {
        while self.0[run] != run {
            self.0[run] = self.0[self.0[run]];
            run = self.0[run];
        }
        run
    }

    /// Joins the runs of neighbouring rows that share a face.
    fn join(&mut self, (first, mut runs): (usize, &[Run]), (other_first, mut others): (usize, &[Run])) {
        let ends = (first + runs.len(), other_first + others.len());
        while let ([run, further @ ..], [other, others_further @ ..]) = (runs, others) {
            if run[0] < other[1] && other[0] < run[1] {
                let one = self.root(ends.0 - runs.len());
                let two = self.root(ends.1 - others.len());
                self.0[one.max(two)] = one.min(two);
            }
            if run[1] < other[1] {
                runs = further;
            } else {
                others = others_further;
            }
        }
    }
}

/// The place of a part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PartBox {
    /// Number of its voxels.
    pub voxels: usize,
    /// The first and the last of them along each axis.
    pub bounds: [[usize; 3]; 2],
}

/// The connected parts of the voxels above a value.
#[derive(Debug)]
pub struct Parts {
    slices: Vec<Slice>,
    /// The part of each run; those inside the largest part belong to it.
    roots: Vec<usize>,
    /// Number of voxels of each part, by its root.
    voxels: Vec<usize>,
    /// Part of the most voxels.
    largest: usize,
    /// Stored number for the voxels of other parts.
    lowest: f64,
    /// Number of voxels in the largest part with what is inside, and in the others.
    pub sizes: [usize; 2],
}

impl Parts {
    /// The first and the last voxel of the largest part along each axis.
    pub fn bounds(&self) -> [[usize; 3]; 2] {
        self.boxes().0.bounds
    }

    /// The box of the largest part, and those of the others in the order of their first voxels.
    pub fn boxes(&self) -> (PartBox, Vec<PartBox>) {
        let nothing = PartBox { voxels: 0, bounds: [[usize::MAX; 3], [0; 3]] };
        let mut boxes = BTreeMap::from([(self.largest, nothing)]);
        for (z, slice) in self.slices.iter().enumerate() {
            for y in 0..slice.rows.len() - 1 {
                let (number, runs) = slice.numbered(y);
                for (run, ends) in (number..).zip(runs) {
                    let [from, to] = ends.map(|end| end as usize);
                    let PartBox { voxels, bounds: [low, high] } = boxes.entry(self.roots[run]).or_insert(nothing);
                    *voxels += to - from;
                    for (axis, [first, last]) in [[from, to - 1], [y, y], [z, z]].into_iter().enumerate() {
                        low[axis] = low[axis].min(first);
                        high[axis] = high[axis].max(last);
                    }
                }
            }
        }
        let largest = boxes.remove(&self.largest).unwrap_or(nothing);
        (largest, boxes.into_values().collect())
    }

    /// Number of voxels in the parts of fewer than `voxels` voxels, but for those inside the largest part.
    pub fn specks(&self, voxels: usize) -> usize {
        let runs = self.slices.iter().flat_map(|slice| &slice.runs).enumerate();
        runs.filter(|&(run, _)| self.is_smaller(run, voxels)).map(|(_, [from, to])| (to - from) as usize).sum()
    }

    /// True for a run of another part than the largest, of fewer than `voxels` voxels.
    fn is_smaller(&self, run: usize, voxels: usize) -> bool {
        let root = self.roots[run];
        root != self.largest && self.voxels[root] < voxels
    }

    /// Number of voxels of other parts outside a box.
    pub fn outside(&self, [low, high]: [[usize; 3]; 2]) -> usize {
        let mut outside = 0;
        for (z, slice) in self.slices.iter().enumerate() {
            for y in 0..slice.rows.len() - 1 {
                let is_beside = (low[1]..=high[1]).contains(&y) && (low[2]..=high[2]).contains(&z);
                for [from, to] in slice.row(y, |run| self.roots[run] != self.largest) {
                    let within = if is_beside { to.min(high[0] + 1).saturating_sub(from.max(low[0])) } else { 0 };
                    outside += to - from - within;
                }
            }
        }
        outside
    }
}

/// Gives to `largest` the runs of parts of which more than half of the voxels lie between voxels of the largest one in their rows:
/// they are inside it.
fn take_in(slices: &[Slice], roots: &mut [usize], largest: usize, sizes: &[usize]) {
    let mut inside = vec![0; sizes.len()];
    for slice in slices {
        for y in 0..slice.rows.len() - 1 {
            let mut body = slice.row(y, |run| roots[run] == largest);
            let (Some([first, _]), Some([_, last])) = (body.next(), body.next_back()) else { continue };
            let (number, runs) = slice.numbered(y);
            for (run, &[from, to]) in (number..).zip(runs) {
                let [from, to] = [from, to].map(|end| end as usize);
                if roots[run] != largest && first < from && to < last {
                    inside[roots[run]] += to - from;
                }
            }
        }
    }
    for root in roots {
        if 2 * inside[*root] > sizes[*root] {
            *root = largest;
        }
    }
}

impl Volume {
    /// Keeps the largest of the connected parts of the voxels above `value`, and parts inside it: those of which more than half
    /// of the voxels have voxels of the largest one on both sides along x, such as a nodule in a lung. The voxels of all others
    /// get the smallest finite value of the volume, or `value` if that is smaller. Voxels are connected by their faces; of parts
    /// of one size, the first in memory is the largest. Returns the number of changed voxels.
    ///
    /// # Errors
    ///
    /// [`VolumeError::InFile`]; [`VolumeError::NothingAbove`] if no voxel is above `value`; [`VolumeError::Cancelled`].
    pub fn keep_largest_part_above(&mut self, value: f64, progress: &dyn Progress) -> Result<usize, VolumeError> {
        let parts = self.parts_above(value, progress)?;
        self.keep_largest(&parts);
        Ok(parts.sizes[1])
    }

    /// The connected parts of the voxels above `value`.
    ///
    /// # Errors
    ///
    /// Those of [`Self::keep_largest_part_above`].
    pub fn parts_above(&self, value: f64, progress: &dyn Progress) -> Result<Parts, VolumeError> {
        self.require_voxels("volume.largest_part_above")?;
        let slices = self.runs_above(value, progress)?;
        let mut joined = Joined((0..slices.last().map_or(0, |slice| slice.first + slice.runs.len())).collect());
        for (z, slice) in slices.iter().enumerate() {
            check_cancelled(Path::new(&self.source), progress)?;
            for y in 0..slice.rows.len() - 1 {
                if y > 0 {
                    joined.join(slice.numbered(y - 1), slice.numbered(y));
                }
                if z > 0 {
                    joined.join(slices[z - 1].numbered(y), slice.numbered(y));
                }
            }
        }
        let mut roots = joined.0;
        let mut sizes = vec![0; roots.len()];
        for (run, [from, to]) in slices.iter().flat_map(|slice| &slice.runs).enumerate() {
            // An earlier run leads to the root already.
            roots[run] = roots[roots[run]];
            sizes[roots[run]] += (to - from) as usize;
        }
        let Some(largest) = (0..sizes.len()).rev().max_by_key(|&root| sizes[root]) else {
            let most = self.statistics()?.max;
            return Err(VolumeError::NothingAbove { source_name: self.source.clone(), value, most });
        };
        let all = sizes.iter().sum::<usize>();
        take_in(&slices, &mut roots, largest, &sizes);
        let kept = slices.iter().flat_map(|slice| &slice.runs).zip(&roots).filter(|(_, root)| **root == largest);
        let kept = kept.map(|([from, to], _)| (to - from) as usize).sum();
        // Without a slope, all values are equal.
        let limit = if self.slope == 0.0 { f64::INFINITY } else { (value - self.intercept) / self.slope };
        let smaller = if self.slope < 0.0 { f64::max } else { f64::min };
        let lowest = slices.iter().map(|slice| slice.lowest).fold(limit, smaller);
        Ok(Parts { slices, roots, voxels: sizes, largest, lowest, sizes: [kept, all - kept] })
    }

    /// Removes the connected parts of fewer than `voxels` voxels above `value`, as [`Self::keep_largest_part_above`] removes all
    /// others than the largest. Returns the number of changed voxels.
    ///
    /// # Errors
    ///
    /// Those of [`Self::keep_largest_part_above`].
    pub fn remove_specks_above(
        &mut self,
        value: f64,
        voxels: usize,
        progress: &dyn Progress,
    ) -> Result<usize, VolumeError> {
        self.require_voxels("volume.without_specks")?;
        let parts = self.parts_above(value, progress)?;
        self.remove_smaller(&parts, voxels);
        Ok(parts.specks(voxels))
    }

    /// Gives the voxels of all `parts` of this volume but the largest the smallest value.
    pub fn keep_largest(&mut self, parts: &Parts) {
        self.remove_smaller(parts, usize::MAX);
    }

    /// Gives the voxels of those `parts` of this volume that have fewer than `least` voxels the smallest value; the largest stays, with
    /// what is inside.
    pub fn remove_smaller(&mut self, parts: &Parts, least: usize) {
        let [nx, ny, _] = self.geometry.dims;
        with_voxels!(&mut self.voxels, voxels => {
            let lowest = Voxel::nearest(parts.lowest);
            parallel::rows_mut(voxels, nx * ny, &|z, voxels| {
                for (y, row) in voxels.chunks_mut(nx).enumerate() {
                    for [from, to] in parts.slices[z].row(y, |run| parts.is_smaller(run, least)) {
                        row[from..to].fill(lowest);
                    }
                }
            });
        });
    }

    /// The runs of voxels above `value` in each slice.
    fn runs_above(&self, value: f64, progress: &dyn Progress) -> Result<Vec<Slice>, VolumeError> {
        let [nx, ny, nz] = self.geometry.dims;
        let mut slices: Vec<Slice> = Vec::new();
        for from in (0..nz).step_by(SLICES) {
            progress.report("finding connected parts", from as u64, nz as u64);
            check_cancelled(Path::new(&self.source), progress)?;
            let of_slices = with_voxels!(&self.voxels, stored => {
                let above = Above::of(value, self.slope, self.intercept);
                let of_slice = |z: usize| above.slice(&stored[nx * ny * (from + z)..][..nx * ny], nx);
                parallel::map(SLICES.min(nz - from), &of_slice)
            });
            for slice in of_slices {
                let first = slices.last().map_or(0, |last| last.first + last.runs.len());
                slices.push(Slice { first, ..slice });
            }
        }
        Ok(slices)
    }
}

/// The stored numbers of values above a limit.
struct Above<T> {
    limit: T,
    /// The limit is one of them.
    is_limit: bool,
    /// Larger numbers are smaller values.
    is_falling: bool,
}

impl<T: Voxel> Above<T> {
    fn of(value: f64, slope: f64, intercept: f64) -> Self {
        let all = [f64::NEG_INFINITY, f64::INFINITY].map(T::nearest);
        // Without a slope all values are the intercept.
        let limit = match (slope == 0.0, intercept > value) {
            (true, true) => all[0],
            (true, false) => all[1],
            _ => T::nearest((value - intercept) / slope),
        };
        Self { limit, is_limit: limit.to_f64() * slope + intercept > value, is_falling: slope < 0.0 }
    }

    /// The runs of a slice with rows of `width` voxels.
    fn slice(&self, stored: &[T], width: usize) -> Slice {
        let Self { limit, is_limit, is_falling } = *self;
        // Without branches, and without the choice in them, so that vectors of voxels are compared.
        let is_finite = |it: T| it.to_f64().is_finite();
        let (runs, rows) = match (is_falling, is_limit) {
            (false, true) => runs_of_rows(stored, width, |it| (it >= limit) & is_finite(it)),
            (false, false) => runs_of_rows(stored, width, |it| (it > limit) & is_finite(it)),
            (true, true) => runs_of_rows(stored, width, |it| (it <= limit) & is_finite(it)),
            (true, false) => runs_of_rows(stored, width, |it| (it < limit) & is_finite(it)),
        };
        let lowest = if is_falling {
            least(stored, f64::NEG_INFINITY, |one, other| one > other)
        } else {
            least(stored, f64::INFINITY, |one, other| one < other)
        };
        Slice { runs, rows, first: 0, lowest }
    }
}

/// The runs of voxels that `has`, in rows of `width`, and the number of the first run of each row and of all runs.
fn runs_of_rows<T: Voxel>(stored: &[T], width: usize, has: impl Fn(T) -> bool) -> (Vec<Run>, Vec<usize>) {
    let (mut runs, mut rows) = (Vec::new(), vec![0]);
    for row in stored.chunks(width) {
        append_runs(row, &has, &mut runs);
        rows.push(runs.len());
    }
    runs.shrink_to_fit();
    (runs, rows)
}

fn append_runs<T: Voxel>(row: &[T], has: impl Fn(T) -> bool, runs: &mut Vec<Run>) {
    let mut start = None;
    let mut append = |first: usize, voxels: &[T]| {
        for (place, &voxel) in (first..).zip(voxels) {
            match (start, has(voxel)) {
                (None, true) => start = Some(place),
                (Some(from), false) => {
                    runs.push([from, place].map(unsigned));
                    start = None;
                }
                _ => {}
            }
        }
        start.is_some()
    };
    let (chunks, rest) = row.as_chunks::<LANES>();
    let mut is_within = false;
    for (chunk, voxels) in chunks.iter().enumerate() {
        if voxels.iter().fold(false, |any, &voxel| any | (has(voxel) != is_within)) {
            is_within = append(chunk * LANES, voxels);
        }
    }
    append(row.len() - rest.len(), rest);
    runs.extend(start.map(|from| [from, row.len()].map(unsigned)));
}

/// The finite number that `is_less` than all others; that of the type nearest to `nothing` if there is none.
fn least<T: Voxel>(stored: &[T], nothing: f64, is_less: impl Fn(T, T) -> bool) -> f64 {
    let smaller = |least: T, &it: &T| if is_less(it, least) && it.to_f64().is_finite() { it } else { least };
    stored.iter().fold(T::nearest(nothing), smaller).to_f64()
}

#[cfg(test)]
#[expect(clippy::unwrap_used, reason = "a test fails by panicking")]
mod tests {
    use super::super::{Geometry, Voxels};
    use super::*;
    use relume_base::progress::Quiet;

    fn volume(dims: [usize; 3], voxels: Voxels) -> Volume {
        Volume::new("test", voxels, Geometry::unit("test", dims).unwrap()).unwrap()
    }

    /// Sizes of the parts above 0.5, and the part of each voxel, voxel by voxel.
    fn flooded(dims: [usize; 3], is_above: &[bool]) -> (Vec<usize>, Vec<Option<usize>>) {
        let [nx, ny, nz] = dims;
        let (mut sizes, mut part) = (Vec::new(), vec![None; is_above.len()]);
        for seed in 0..is_above.len() {
            if !is_above[seed] || part[seed].is_some() {
                continue;
            }
            let (mut open, number) = (vec![seed], sizes.len());
            part[seed] = Some(number);
            sizes.push(0);
            while let Some(place) = open.pop() {
                sizes[number] += 1;
                let [x, y, z] = [place % nx, place / nx % ny, place / nx / ny];
                let mut neighbours = Vec::new();
                for (at, side, step) in [(x, nx, 1), (y, ny, nx), (z, nz, nx * ny)] {
                    neighbours.extend((at > 0).then(|| place - step));
                    neighbours.extend((at + 1 < side).then(|| place + step));
                }
                for next in neighbours {
                    if is_above[next] && part[next].is_none() {
                        part[next] = Some(number);
                        open.push(next);
                    }
                }
            }
        }
        (sizes, part)
    }

    #[test]
    fn the_largest_part_stays_as_a_flood_from_voxel_to_voxel_finds_it() {
        let mut seed = 7_u64;
        let mut random = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            seed >> 33
        };
        let mut cases: Vec<([usize; 3], Vec<bool>)> = Vec::new();
        for (dims, dense) in [([70, 9, 8], 2), ([33, 1, 40], 4), ([1, 17, 5], 4), ([64, 6, 3], 7), ([5, 4, 1], 3)] {
            cases.push((dims, (0..dims.iter().product()).map(|_| random() % 8 < dense).collect()));
        }
        // Runs that begin and end where groups of 32 voxels do, and beside.
        let ends = [0, 1, 31, 32, 33, 63, 64, 96, 127, 128, 199, 200];
        let dims = [200, 24, 2];
        let row = |row: usize, x: usize| {
            let [from, to] = [ends[row % 12], ends[(row % 12 + 1 + row / 12).min(11)]];
            (from..to).contains(&x) || (row.is_multiple_of(5) && x > 190)
        };
        cases.push((dims, (0..dims.iter().product()).map(|at| row(at / 200, at % 200)).collect()));
        for (dims, is_above) in cases {
            for slope in [1.0, -0.5] {
                let voxels: usize = dims.iter().product();
                let [above, below] = if slope > 0.0 { [30, -20] } else { [-20, 30] };
                let stored: Vec<i16> = is_above.iter().map(|&it| if it { above } else { below }).collect();
                let mut kept = Volume { slope, intercept: 4.0, ..volume(dims, Voxels::I16(stored.clone())) };
                let (sizes, part) = flooded(dims, &is_above);
                let most = *sizes.iter().max().unwrap();
                let largest = sizes.iter().position(|&size| size == most);
                let is_inside = |number: Option<usize>| {
                    let between = |&place: &usize| {
                        let row = place / dims[0] * dims[0];
                        let body = |mut places: std::ops::Range<usize>| {
                            places.any(|at| part[at].is_some() && part[at] == largest)
                        };
                        body(row..place) && body(place..row + dims[0])
                    };
                    let of_it = (0..voxels).filter(|&place| part[place] == number);
                    2 * of_it.filter(between).count() > sizes[number.unwrap()]
                };
                let stays: Vec<bool> =
                    (0..sizes.len()).map(|number| Some(number) == largest || is_inside(Some(number))).collect();
                let is_kept = |place: usize| part[place].is_none_or(|number| stays[number]);
                let expected: Vec<i16> =
                    (0..voxels).map(|place| if is_kept(place) { stored[place] } else { below }).collect();
                let places = (0..voxels).filter(|&place| part[place].is_some() && is_kept(place));
                let at: Vec<[usize; 3]> =
                    places.map(|at| [at % dims[0], at / dims[0] % dims[1], at / dims[0] / dims[1]]).collect();
                let end = |axis: usize| at.iter().map(move |at| at[axis]);
                let low = [0, 1, 2].map(|axis| end(axis).min().unwrap());
                let high = [0, 1, 2].map(|axis| end(axis).max().unwrap());
                let parts = kept.parts_above(1.0, &Quiet).unwrap();
                assert_eq!(parts.bounds(), [low, high], "{dims:?}");
                let others = sizes.iter().sum::<usize>() - at.len();
                let nothing = PartBox { voxels: 0, bounds: [[usize::MAX; 3], [0; 3]] };
                let mut boxes = vec![nothing; sizes.len()];
                for (place, number) in part.iter().enumerate().filter_map(|(place, part)| Some((place, (*part)?))) {
                    let at = [place % dims[0], place / dims[0] % dims[1], place / dims[0] / dims[1]];
                    let PartBox { voxels, bounds: [low, high] } = &mut boxes[number];
                    *voxels += 1;
                    for axis in 0..3 {
                        (low[axis], high[axis]) = (low[axis].min(at[axis]), high[axis].max(at[axis]));
                    }
                }
                let boxes: Vec<PartBox> =
                    boxes.into_iter().zip(&stays).filter(|(_, stays)| !**stays).map(|(found, _)| found).collect();
                assert_eq!(parts.boxes().1, boxes, "{dims:?}");
                assert_eq!(parts.sizes, [at.len(), others]);
                let is_outside = |place: &usize| {
                    let at = [place % dims[0], place / dims[0] % dims[1], place / dims[0] / dims[1]];
                    !is_kept(*place) && (0..3).any(|axis| at[axis] < low[axis] || at[axis] > high[axis])
                };
                assert_eq!(parts.outside([low, high]), (0..voxels).filter(is_outside).count());
                for least in [0, 1, 2, 4, most, most + 1] {
                    let is_speck = |place: usize| !is_kept(place) && sizes[part[place].unwrap()] < least;
                    let without: Vec<i16> =
                        (0..voxels).map(|place| if is_speck(place) { below } else { stored[place] }).collect();
                    let mut fewer = kept.clone();
                    let removed = fewer.remove_specks_above(1.0, least, &Quiet).unwrap();
                    assert_eq!(removed, (0..voxels).filter(|&place| is_speck(place)).count(), "{dims:?} {least}");
                    assert_eq!(fewer.voxels, Voxels::I16(without), "{dims:?} {least}, slope {slope}");
                }
                assert_eq!(kept.keep_largest_part_above(1.0, &Quiet).unwrap(), others);
                assert_eq!(kept.voxels, Voxels::I16(expected), "{dims:?}, slope {slope}");
                assert_eq!(kept.keep_largest_part_above(1.0, &Quiet).unwrap(), 0, "nothing is left to remove");
            }
        }
    }

    #[test]
    fn of_equal_parts_the_first_stays_and_nan_is_no_part() {
        let (nan, infinite) = (f32::NAN, f32::INFINITY);
        let mut kept = volume([7, 1, 1], Voxels::F32(vec![3.0, nan, 2.0, 5.0, infinite, 4.0, 6.0]));
        assert_eq!(kept.keep_largest_part_above(1.0, &Quiet).unwrap(), 3);
        // No value is as low as the limit, which stands for it.
        let expected = Voxels::F32(vec![1.0, nan, 2.0, 5.0, infinite, 1.0, 1.0]);
        assert_eq!(kept.voxels.bytes(), expected.bytes());
    }

    #[test]
    fn a_value_that_no_voxel_exceeds_is_refused_with_the_largest() {
        let voxels = (0..24).map(|it| u16::try_from(it).unwrap()).collect();
        let mut whole = volume([2, 3, 4], Voxels::U16(voxels));
        let message = whole.keep_largest_part_above(23.0, &Quiet).unwrap_err().to_string();
        assert!(message.contains("no voxel is above 23") && message.contains("largest value is 23"), "{message}");
        assert_eq!(whole.keep_largest_part_above(22.0, &Quiet).unwrap(), 0);
        assert!(whole.keep_largest_part_above(1e6, &Quiet).is_err(), "beyond the numbers of the type");
        assert_eq!(whole.keep_largest_part_above(-1e6, &Quiet).unwrap(), 0, "all voxels");
        for (slope, lowest) in [(2.0, 0.0), (-2.0, -46.0)] {
            whole.slope = slope;
            assert_eq!(whole.keep_largest_part_above(lowest - 1.0, &Quiet).unwrap(), 0, "all voxels, slope {slope}");
        }
        whole.slope = 0.0;
        assert!(whole.keep_largest_part_above(0.0, &Quiet).is_err(), "all voxels have the value 0");
        assert_eq!(whole.keep_largest_part_above(-1.0, &Quiet).unwrap(), 0);
    }
}
