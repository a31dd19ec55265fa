//! Labels in the voxels of a volume: exact whole numbers, also where an f64 has no room for them.

use std::collections::BTreeMap;
use std::path::Path;

use glam::DVec3;

use super::{Geometry, Presets, Volume, VolumeError, Voxel, Voxels, allocate, with_voxels};
use relume_base::number::{count, nearest_label, readable, whole};
use relume_base::parallel;

/// Most labels of a label map.
pub const MOST_LABELS: usize = 65_535;

/// Voxels that are counted together.
const PART: usize = 1 << 18;

/// Numbers of voxels of labels, by label.
pub type LabelCounts = BTreeMap<i64, u64>;

/// Why the voxels of a volume are no labels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NoLabels {
    /// This voxel has this value, which is no whole number of 63 bits.
    Value(usize, f64),
    /// There are more different numbers than the limit.
    Many,
}

/// The label that a voxel stores, on the scale of values of a volume.
fn label_of<T: Voxel>(stored: T, [slope, intercept]: [f64; 2]) -> Option<i64> {
    match stored.to_whole() {
        Some(number) if matches!([slope, intercept], [1.0, 0.0]) => i64::try_from(number).ok(),
        _ => nearest_label(stored.to_f64().mul_add(slope, intercept)),
    }
}

/// Adds the voxels of `stored` to `counts`.
fn add_counts<T: Voxel>(
    stored: &[T],
    first: usize,
    scale: [f64; 2],
    most: usize,
    counts: &mut LabelCounts,
) -> Result<(), NoLabels> {
    let mut place = first;
    // Neighbours along x are alike nearly everywhere.
    for run in stored.chunk_by(|one, other| one == other) {
        let Some(label) = run.first().and_then(|&voxel| label_of(voxel, scale)) else {
            return Err(NoLabels::Value(place, run.first().map_or(f64::NAN, |voxel| voxel.to_f64())));
        };
        *counts.entry(label).or_insert(0) += run.len() as u64;
        if counts.len() > most {
            return Err(NoLabels::Many);
        }
        place += run.len();
    }
    Ok(())
}

/// [`add_counts`] of all voxels.
fn counts_of(voxels: &Voxels, scale: [f64; 2], most: usize) -> Result<LabelCounts, NoLabels> {
    with_voxels!(voxels, stored => {
        let parts = parallel::map(stored.len().div_ceil(PART), &|part| {
            let mut counts = LabelCounts::new();
            let within = &stored[part * PART..stored.len().min((part + 1) * PART)];
            add_counts(within, part * PART, scale, most, &mut counts).map(|()| counts)
        });
        let mut all = LabelCounts::new();
        for part in parts {
            for (label, voxels) in part? {
                *all.entry(label).or_insert(0) += voxels;
            }
        }
        if all.len() > most { Err(NoLabels::Many) } else { Ok(all) }
    })
}

/// The label with the largest share; of equal shares, the first. Shares differ if they do by more than rounding.
fn most_shared<T: Voxel>(around: [(T, f64); 8]) -> T {
    let nearest = around[0].0;
    if around.iter().all(|(label, _)| *label == nearest) {
        return nearest;
    }
    let share_of = |label: T| around.iter().filter(|(other, _)| *other == label).map(|it| it.1).sum::<f64>();
    let all = around.iter().map(|&(label, _)| (label, share_of(label)));
    all.reduce(|most, other| if other.1 > most.1 + 1e-9 { other } else { most }).map_or(nearest, |most| most.0)
}

impl Volume {
    /// Label of the voxel at `index` of [`Self::voxels`]; `None` if it is no whole number of 63 bits.
    #[must_use]
    pub fn label(&self, index: usize) -> Option<i64> {
        let scale = [self.slope, self.intercept];
        with_voxels!(&self.voxels, stored => stored.get(index).and_then(|&voxel| label_of(voxel, scale)))
    }

    /// Calls `with` for the label of each voxel in memory, in their order, with the length of a run of this label.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Layout`] for a voxel that is no label.
    #[expect(clippy::float_cmp, reason = "runs of equal voxels, of any type")]
    pub fn each_run_of_labels(&self, mut with: impl FnMut(i64, usize)) -> Result<(), VolumeError> {
        let scale = [self.slope, self.intercept];
        with_voxels!(&self.voxels, stored => {
            let mut voxel = 0;
            for run in stored.chunk_by(|one, other| one == other) {
                let found = run.first().and_then(|&voxel| label_of(voxel, scale));
                let value = || run.first().map_or(f64::NAN, |voxel| voxel.to_f64());
                with(found.ok_or_else(|| self.no_labels(NoLabels::Value(voxel, value())))?, run.len());
                voxel += run.len();
            }
        });
        Ok(())
    }

    /// The volume with 1 in place of each of these values, and 0 in place of all others.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Layout`] if no voxel has any of them.
    pub fn mask_of(&self, values: &[f64]) -> Result<Self, VolumeError> {
        let is_one = |value: f64| values.iter().any(|wanted| (wanted - value).abs() <= 0.0);
        let mask: Vec<u8> = with_voxels!(&self.voxels, stored => {
            stored.iter().map(|voxel| u8::from(is_one(voxel.to_f64().mul_add(self.slope, self.intercept)))).collect()
        });
        if !mask.contains(&1) {
            let listed: Vec<String> = values.iter().map(|&value| readable(value)).collect();
            let problem = format!("no voxel has the value {}, so a mask of it is empty", listed.join(" or "));
            return Err(VolumeError::Layout { source_name: self.source.clone(), problem });
        }
        Ok(Self {
            voxels: Voxels::U8(mask),
            slope: 1.0,
            intercept: 0.0,
            has_labels: false,
            presets: Presets::default(),
            ..self.clone()
        })
    }

    /// Number of voxels of each label, if there are at most `most`, the background included.
    ///
    /// # Errors
    ///
    /// [`NoLabels`].
    pub fn label_counts(&self, most: usize) -> Result<LabelCounts, NoLabels> {
        counts_of(&self.voxels, [self.slope, self.intercept], most)
    }

    /// The error of a volume that is read as a label map and has `problem`.
    pub fn no_labels(&self, problem: NoLabels) -> VolumeError {
        let problem = match problem {
            NoLabels::Value(voxel, value) => format!(
                "voxel {voxel} holds {}; labels are whole numbers up to {}; round or renumber them",
                readable(value),
                i64::MAX
            ),
            NoLabels::Many => {
                format!("more than {MOST_LABELS} different labels; renumber them, or write a part of them")
            }
        };
        VolumeError::Layout { source_name: self.source.clone(), problem }
    }

    /// Number of voxels of each label of a label map, which may stay in a file.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Read`], [`VolumeError::Bricks`]; [`VolumeError::Layout`] for voxels that are no labels.
    pub fn counts_of_labels(&self) -> Result<LabelCounts, VolumeError> {
        let scale = [self.slope, self.intercept];
        let Some(cache) = &self.bricks else {
            return self.label_counts(usize::MAX).map_err(|problem| self.no_labels(problem));
        };
        let (mut counts, mut problem) = (LabelCounts::new(), None);
        cache.each_brick(|voxels| {
            let added = with_voxels!(voxels, stored => add_counts(stored, 0, scale, usize::MAX, &mut counts));
            problem = problem.or(added.err());
        })?;
        problem.map_or(Ok(counts), |problem| Err(self.no_labels(problem)))
    }

    /// The labels on the voxels of `grid`: each voxel has the label with the largest share of its centre by linear interpolation, of equal
    /// shares that of the nearest voxel, and 0 outside their grid. So surfaces lie where interpolated masks have them, without the
    /// steps of coarse voxels. `None` if no voxel gets a label.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Memory`].
    pub fn labels_resampled_to(&self, grid: &Geometry) -> Result<Option<Self>, VolumeError> {
        let own = self.geometry;
        let to_own =
            |index: DVec3| own.direction.transpose() * (grid.world_from_index(index) - own.origin) / own.spacing;
        let [nx, ny, _] = grid.dims;
        let last = own.dims.map(count);
        let voxels = with_voxels!(&self.voxels, stored => {
            let mut laid = allocate::zeroed(Path::new(&self.source), grid.voxels())?;
            parallel::rows_mut(&mut laid, nx, &|row, line| {
                let at = |x: usize| to_own(DVec3::new(count(x), count(row % ny), count(row / ny)));
                for (x, voxel) in line.iter_mut().enumerate() {
                    // The half is the face of a voxel; rounding decides there.
                    let place = (at(x) + 0.5 + 1e-9).to_array();
                    let is_inside = (0..3).all(|axis| place[axis] >= 0.0 && place[axis] < last[axis]);
                    if is_inside {
                        let nearest = place.map(whole);
                        let of = |[x, y, z]: [usize; 3]| stored[x + own.dims[0] * (y + own.dims[1] * z)];
                        // Of the nearest voxel and the next one along each axis, with their shares.
                        let around: [(_, f64); 8] = std::array::from_fn(|i| {
                            let (mut index, mut share) = (nearest, 1.0);
                            for axis in 0..3 {
                                let beyond = place[axis] - count(nearest[axis]) - 0.5;
                                let is_next = i >> axis & 1 == 1;
                                share *= if is_next { beyond.abs() } else { 1.0 - beyond.abs() };
                                index[axis] = match (is_next, beyond < 0.0) {
                                    (false, _) => index[axis],
                                    (true, true) => index[axis].saturating_sub(1),
                                    (true, false) => (index[axis] + 1).min(own.dims[axis] - 1),
                                };
                            }
                            (of(index), share)
                        });
                        *voxel = most_shared(around);
                    }
                }
            });
            if laid.iter().all(|voxel| matches!(label_of(*voxel, [self.slope, self.intercept]), None | Some(0))) {
                return Ok(None);
            }
            Voxel::into_voxels(laid)
        });
        let mut laid = Self { voxels, geometry: *grid, ..self.clone() };
        let ([x, y, z], [a, b, c]) = (own.dims, grid.dims);
        let lost = match (self.label_counts(MOST_LABELS), laid.label_counts(MOST_LABELS)) {
            (Ok(before), Ok(after)) => {
                let lost: Vec<String> =
                    before.keys().filter(|label| !after.contains_key(label)).map(i64::to_string).collect();
                match lost.len() {
                    0 => String::new(),
                    1..=8 => format!("; no voxel is left of {}", lost.join(", ")),
                    more => format!("; no voxel is left of {more} labels"),
                }
            }
            _ => String::new(),
        };
        laid.notes.push(format!(
            "{}: the labels of {x}×{y}×{z} voxels are resampled to the {a}×{b}×{c} voxels of the volume, by the largest share of those around{lost}",
            self.source
        ));
        Ok(Some(laid))
    }

    /// Ranks of the labels in place of their numbers: 0 for numbers without a rank, and 1 for the first of `ranked`, which ascend.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Layout`] for a voxel that is no label.
    pub fn ranks_of_labels(&self, ranked: &[i64]) -> Result<Self, VolumeError> {
        let mut voxels: Vec<u16> = Vec::with_capacity(self.voxels.len());
        self.each_run_of_labels(|label, length| {
            let rank = ranked.binary_search(&label).map_or(0, |rank| u16::try_from(rank + 1).unwrap_or(u16::MAX));
            voxels.resize(voxels.len() + length, rank);
        })?;
        Ok(Self { voxels: Voxels::U16(voxels), slope: 1.0, intercept: 0.0, ..self.clone() })
    }
}

/// Numbers that stand for no label: negative ones, and 0, unless negative ones are more frequent.
#[must_use]
pub fn is_background(label: i64, counts: &LabelCounts) -> bool {
    let negative: u64 = counts.range(..0).map(|(_, voxels)| voxels).sum();
    label < 0 || label == 0 && negative <= counts.get(&0).copied().unwrap_or(0)
}

#[cfg(test)]
#[expect(clippy::unwrap_used, reason = "a test fails by panicking")]
mod tests {
    use super::*;
    use glam::DMat3;

    fn line(voxels: Voxels) -> Volume {
        let dims = [voxels.len(), 1, 1];
        Volume::new("l", voxels, Geometry::unit("l", dims).unwrap()).unwrap()
    }

    #[test]
    fn labels_are_exact_beyond_the_digits_of_floats() {
        let wide = line(Voxels::U64(vec![0, (1 << 53) + 1, 1 << 53, 1 << 53]));
        let counts = wide.label_counts(9).unwrap();
        assert_eq!(counts.into_iter().collect::<Vec<_>>(), [(0, 1), (1 << 53, 2), ((1 << 53) + 1, 1)]);
        assert_eq!(line(Voxels::U64(vec![3, u64::MAX])).label_counts(9), Err(NoLabels::Value(1, 2.0_f64.powi(64))));
        assert_eq!(line(Voxels::F32(vec![2.0, -1.0, 2.0, 2.5])).label_counts(9), Err(NoLabels::Value(3, 2.5)));
        assert_eq!(line(Voxels::I16(vec![1, 2, 3])).label_counts(2), Err(NoLabels::Many));
        let scaled = Volume { slope: 0.5, intercept: 1.0, ..line(Voxels::U8(vec![4, 6])) };
        assert_eq!((scaled.label(0), scaled.label(1)), (Some(3), Some(4)));
        let ranked = wide.ranks_of_labels(&[1 << 53, (1 << 53) + 1]).unwrap();
        assert!(ranked.voxels == Voxels::U16(vec![0, 2, 1, 1]), "{:?}", ranked.voxels);
    }

    #[test]
    fn the_background_is_the_negative_numbers_and_mostly_zero() {
        let counts = |pairs: &[(i64, u64)]| pairs.iter().copied().collect::<LabelCounts>();
        let unlabelled = counts(&[(-1, 90), (0, 8), (1, 9)]);
        assert!(is_background(-1, &unlabelled) && !is_background(0, &unlabelled) && !is_background(1, &unlabelled));
        let ignored = counts(&[(-1, 3), (0, 80), (1, 9)]);
        assert!(is_background(0, &ignored) && is_background(-1, &ignored) && !is_background(1, &ignored));
    }

    #[test]
    fn labels_of_another_grid_are_those_of_the_nearest_voxel() {
        // Voxels of 2 along x, turned about z, beginning at 5: their centres are 5, 3, 1.
        let turned = DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0));
        let geometry = Geometry::new("l", [3, 1, 1], DVec3::new(2.0, 1.0, 1.0), DVec3::new(5.0, 0.0, 0.0), turned);
        let map = Volume::new("l", Voxels::U16(vec![7, 300, 9]), geometry.unwrap()).unwrap();
        let fine = map.labels_resampled_to(&Geometry::unit("v", [8, 1, 1]).unwrap()).unwrap().unwrap();
        let labels: Vec<i64> = (0..8).map(|index| fine.label(index).unwrap()).collect();
        // Centres 0 and 6 lie on faces, which belong to one side.
        assert_eq!(labels[1..6], [9, 9, 300, 300, 7][..5], "{labels:?}");
        assert_eq!(labels[7], 0);
        let far = Geometry::new("v", [4, 1, 1], DVec3::ONE, DVec3::splat(90.0), DMat3::IDENTITY).unwrap();
        assert!(map.labels_resampled_to(&far).unwrap().is_none());
        let coarse = Geometry::new("v", [1, 1, 1], DVec3::ONE, DVec3::new(3.0, 0.0, 0.0), DMat3::IDENTITY).unwrap();
        let coarse = map.labels_resampled_to(&coarse).unwrap().unwrap();
        assert!(coarse.notes[0].contains("no voxel is left of 7, 9"), "{:?}", coarse.notes);
    }
}
