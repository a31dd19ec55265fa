//! Dimensions of headerless voxels, suggested by the likeness of neighbours.

use std::collections::BTreeMap;

use relume_base::number::count;

/// Pairs of voxels that are compared for one distance.
const PAIRS: usize = 3000;
/// Sides of a suggested volume.
const SIDES: std::ops::RangeInclusive<usize> = 8..=4096;
/// Largest ratio of the sides of a suggested slice.
const OBLONG: usize = 4;
/// Most divisors of the number of voxels that are considered; highly composite numbers have hundreds.
const MOST_DIVISORS: usize = 96;
/// Most suggestions.
pub(crate) const GUESSES: usize = 3;
/// Suggested dimensions have differences below this fraction of those of the stated dimensions.
const CLEARLY: f64 = 0.7;

/// Mean differences of voxels at distances in the file.
struct Differences<F> {
    value: F,
    voxels: usize,
    known: BTreeMap<usize, f64>,
}

impl<F: Fn(usize) -> f64> Differences<F> {
    /// Mean |difference| of two voxels that are `distance` apart in the file; infinite beyond its end.
    fn at(&mut self, distance: usize) -> f64 {
        let (value, voxels) = (&self.value, self.voxels);
        *self.known.entry(distance).or_insert_with(|| {
            let Some(places) = voxels.checked_sub(distance).filter(|&places| places > 0) else { return f64::INFINITY };
            // Weyl's sequence: places spread evenly, and the same in every run.
            let place = |pair: usize| pair.wrapping_mul(0x9E37_79B9_7F4A_7C15) % places;
            let sum: f64 = (0..PAIRS).map(place).map(|at| (value(at + distance) - value(at)).abs()).sum();
            sum / count(PAIRS)
        })
    }

    /// Difference between neighbouring rows plus that between neighbouring slices.
    fn of(&mut self, [nx, ny, nz]: [usize; 3]) -> f64 {
        let rows = if ny > 1 { self.at(nx) } else { 0.0 };
        let slices = if nz > 1 { self.at(nx * ny) } else { 0.0 };
        rows + slices
    }
}

/// Dimensions for `voxels` headerless voxels whose neighbouring rows and slices differ clearly less than those of the
/// `stated` dimensions; `None` if there are none. `value` is the value of a voxel by its place in the file.
pub(crate) fn better(value: impl Fn(usize) -> f64, voxels: usize, stated: [usize; 3]) -> Option<[usize; 3]> {
    let mut differences = Differences { value, voxels, known: BTreeMap::new() };
    let own = differences.of(stated);
    let &(best, least) = likeliest(&mut differences, voxels).first()?;
    (best != stated && least < CLEARLY * own).then_some(best)
}

/// Dimensions of `voxels` voxels with the smallest differences between rows and between slices, the best first, and the
/// ratios of these and of the differences within rows to those of voxels that are far apart; none for a constant. Only
/// `known` voxels from the beginning have values. Halves of numbers, read as whole ones, differ much within rows.
pub(crate) fn guessed(value: impl Fn(usize) -> f64, known: usize, voxels: usize) -> Vec<([usize; 3], f64)> {
    let mut differences = Differences { value, voxels: known, known: BTreeMap::new() };
    let far = differences.at(known / 2 + 1).max(differences.at(known / 3 + 1));
    let within = differences.at(1);
    let found = likeliest(&mut differences, voxels).into_iter().filter(|(_, least)| far > 0.0 && *least > 0.0);
    found.map(|(dims, least)| (dims, (least + within) / far)).collect()
}

/// At most [`GUESSES`] dimensions with the smallest differences, and these differences.
fn likeliest<F: Fn(usize) -> f64>(differences: &mut Differences<F>, voxels: usize) -> Vec<([usize; 3], f64)> {
    let divisors: Vec<usize> = SIDES.filter(|side| voxels.is_multiple_of(*side)).take(MOST_DIVISORS).collect();
    let mut best: Vec<([usize; 3], f64)> = Vec::new();
    for &nx in &divisors {
        let oblong = |ny: &usize| nx.max(*ny) <= OBLONG * nx.min(*ny) && voxels.is_multiple_of(nx * ny);
        for &ny in divisors.iter().filter(|ny| oblong(ny)) {
            let dims = [nx, ny, voxels / (nx * ny)];
            if dims[2] < *SIDES.start() || dims[2] > *SIDES.end() {
                continue;
            }
            let difference = differences.of(dims);
            let rank = best.partition_point(|&(_, least)| least <= difference);
            if rank < GUESSES {
                best.insert(rank, (dims, difference));
                best.truncate(GUESSES);
            }
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A smooth body, x fastest.
    fn body([nx, ny, nz]: [usize; 3]) -> impl Fn(usize) -> f64 {
        move |at| {
            let [x, y, z] = [at % nx, at / nx % ny, at / (nx * ny)];
            let along = |index: usize, of: usize| (count(index) / count(of) - 0.5).powi(2);
            (1.0 - 3.0 * (along(x, nx) + 2.0 * along(y, ny) + along(z, nz))).max(0.0)
        }
    }

    #[test]
    fn stated_dimensions_are_doubted_only_if_others_fit_clearly_better() {
        let dims = [48, 64, 36];
        let voxels = dims.iter().product();
        assert_eq!(better(body(dims), voxels, [64, 48, 36]), Some(dims));
        assert_eq!(better(body(dims), voxels, [36, 64, 48]), Some(dims));
        assert_eq!(better(body(dims), voxels, dims), None);
        assert_eq!(better(|_| 7.0, voxels, [64, 48, 36]), None, "a constant fits all");
    }
}
