//! A thinned copy of a volume, by which values are examined.

use rayon::prelude::*;

use relume_base::number::{count, unsigned, whole};
use relume_base::parallel;
use relume_volume::{Geometry, Volume, VolumeError, Voxels, with_voxels};

/// Most voxels of a thinned copy.
const MOST: usize = 1_200_000;

/// Every n-th voxel of a volume along each axis.
#[derive(Clone, Debug)]
pub(crate) struct Thinned {
    /// Voxels along each axis.
    pub(super) dims: [usize; 3],
    /// Distance of these voxels in the volume, along each axis.
    pub(super) stride: [usize; 3],
    /// Their values; NaN and infinities are the smallest value.
    pub(super) values: Vec<f64>,
    /// Size of the values by which gradients are divided: 1 unless 32 bits do not hold them.
    unit: f64,
}

impl Thinned {
    /// The copy of `volume`, whose finite values lie in this range.
    pub(crate) fn of(volume: &Volume, [smallest, largest]: [f64; 2]) -> Self {
        let unit = unit(smallest.abs().max(largest.abs()));
        let sides = volume.geometry.dims;
        let stride = whole((count(volume.geometry.voxels()) / count(MOST)).cbrt().ceil()).max(1);
        let stride = sides.map(|side| stride.min(side.div_ceil(32).max(1)));
        let (dims, stride) = bounded(sides, stride);
        let [nx, ny, _] = dims;
        let scale = |stored: f64| {
            let value = stored.mul_add(volume.slope, volume.intercept);
            if value.is_finite() { value } else { smallest }
        };
        let mut values = vec![0.0; dims.iter().product()];
        with_voxels!(&volume.voxels, stored => {
            parallel::rows_mut(&mut values, nx * ny, &|z, slice| {
                for (y, row) in slice.chunks_mut(nx).enumerate() {
                    let first = sides[0] * (y * stride[1] + sides[1] * z * stride[2]);
                    for (x, value) in row.iter_mut().enumerate() {
                        *value = stored.get(first + x * stride[0]).map_or(0.0, |&voxel| scale(to_f64(voxel)));
                    }
                }
            });
        });
        Self { dims, stride, values, unit }
    }

    /// The copy as a volume of this name.
    pub(super) fn to_volume(&self, source: &str) -> Result<Volume, VolumeError> {
        Volume::new(source, Voxels::F64(self.values.clone()), Geometry::unit(source, self.dims)?)
    }

    /// Place of voxel `[x, y, z]` in [`Self::values`].
    pub(super) fn at(&self, [x, y, z]: [usize; 3]) -> usize {
        x + self.dims[0] * (y + self.dims[1] * z)
    }

    /// Position of the voxel at `place`.
    pub(super) fn position(&self, place: usize) -> [usize; 3] {
        // Divisions of 32 bits take a fraction of the time, and a copy has few voxels.
        let [nx, ny, place] = [self.dims[0], self.dims[1], place].map(unsigned);
        let row = place / nx;
        [place - row * nx, row % ny, row / ny].map(|it| it as usize)
    }

    /// Steps in [`Self::values`] along each axis.
    pub(super) fn steps(&self) -> [usize; 3] {
        [1, self.dims[0], self.dims[0] * self.dims[1]]
    }

    /// Places of the up to six neighbours of `place`.
    pub(super) fn neighbours(&self, place: usize) -> impl Iterator<Item = usize> {
        let (position, dims, steps) = (self.position(place), self.dims, self.steps());
        (0..3).flat_map(move |axis| {
            let before = (position[axis] > 0).then(|| place - steps[axis]);
            let after = (position[axis] + 1 < dims[axis]).then(|| place + steps[axis]);
            before.into_iter().chain(after)
        })
    }

    /// Sizes of the gradients at every n-th place, per voxel of the copy.
    pub(super) fn gradients(&self, step: usize) -> Vec<f64> {
        (0..self.values.len().div_ceil(step)).into_par_iter().map(|index| self.gradient(index * step)).collect()
    }

    /// Size of the gradient at `place`, per voxel of the copy.
    fn gradient(&self, place: usize) -> f64 {
        let (position, steps) = (self.position(place), self.steps());
        let along = |axis: usize| {
            let before = if position[axis] > 0 { place - steps[axis] } else { place };
            let after = if position[axis] + 1 < self.dims[axis] { place + steps[axis] } else { place };
            (self.values[after] / self.unit - self.values[before] / self.unit) / 2.0
        };
        let [x, y, z] = [along(0), along(1), along(2)];
        (x * x + y * y + z * z).sqrt()
    }

    /// Faces between voxels from `threshold` on and smaller ones, over the number of the former to the power of 2/3: 6
    /// for a cube, whatever its size.
    pub(super) fn roughness(&self, threshold: f64) -> f64 {
        let [nx, ny, _] = self.dims;
        let is_inside = |value: f64| value >= threshold;
        let (voxels, faces) = self
            .values
            .par_chunks(nx * ny)
            .enumerate()
            .map(|(z, slice)| {
                let next = self.values.get((z + 1) * nx * ny..(z + 2) * nx * ny).unwrap_or_default();
                let mut found = (0, 0);
                for (place, &value) in slice.iter().enumerate() {
                    let inside = is_inside(value);
                    let differs = |other: Option<&f64>| other.is_some_and(|&it| is_inside(it) != inside);
                    let right = if place % nx + 1 < nx { slice.get(place + 1) } else { None };
                    let below = slice.get(place + nx);
                    found.0 += usize::from(inside);
                    found.1 += [right, below, next.get(place)].into_iter().filter(|&it| differs(it)).count();
                }
                found
            })
            .reduce(|| (0, 0), |one, other| (one.0 + other.0, one.1 + other.1));
        count(faces) / count(voxels.max(1)).powf(2.0 / 3.0)
    }

    /// Fraction of the voxels from `threshold` on in connected parts of fewer than eight.
    pub(super) fn specks(&self, threshold: f64) -> f64 {
        const SPECK: usize = 8;
        /// Known state of a voxel.
        #[derive(Clone, Copy, PartialEq)]
        enum Part {
            Unknown,
            Found,
            Large,
        }
        let mut parts = vec![Part::Unknown; self.values.len()];
        let is_inside = |place: usize| self.values[place] >= threshold;
        let (mut all, mut specks) = (0, 0);
        let mut found = Vec::new();
        for start in 0..self.values.len() {
            if parts[start] != Part::Unknown || !is_inside(start) {
                continue;
            }
            parts[start] = Part::Found;
            found.clear();
            found.push(start);
            // The search ends where it meets a part that is large, or has become one: parts are counted, not filled.
            let (mut searched, mut is_large) = (0, false);
            while searched < found.len() && !is_large {
                for next in self.neighbours(found[searched]) {
                    if parts[next] == Part::Large {
                        is_large = true;
                        break;
                    }
                    if parts[next] == Part::Unknown && is_inside(next) {
                        parts[next] = Part::Found;
                        found.push(next);
                    }
                }
                is_large |= found.len() >= SPECK;
                searched += 1;
            }
            all += found.len();
            if is_large {
                found.iter().for_each(|&place| parts[place] = Part::Large);
            } else {
                specks += found.len();
            }
        }
        count(specks) / count(all.max(1))
    }

    /// Values on the faces of the volume, up to some thousands.
    pub(super) fn border(&self) -> Vec<f64> {
        let [nx, ny, nz] = self.dims;
        let is_end = |axis: usize, at: usize| self.dims[axis] > 2 && (at == 0 || at + 1 == self.dims[axis]);
        let mut all = Vec::new();
        for (z, y) in (0..nz).flat_map(|z| (0..ny).map(move |y| (z, y))) {
            let row = self.at([0, y, z]);
            if is_end(2, z) || is_end(1, y) {
                all.extend(row..row + nx);
            } else if nx > 2 {
                all.extend([row, row + nx - 1]);
            }
        }
        all.iter().step_by((all.len() / 20_000).max(1)).map(|&place| self.values[place]).collect()
    }
}

/// The size by which values of up to `largest` are divided: 1 if 32 bits hold them, or else a power of two near it.
fn unit(largest: f64) -> f64 {
    const USUAL: std::ops::RangeInclusive<f64> = 1e-30..=3e38;
    if largest == 0.0 || !largest.is_finite() || USUAL.contains(&largest) { 1.0 } else { largest.log2().floor().exp2() }
}

/// The sides of the copy and the strides, of which the one along the longest side grows until the copy is small enough:
/// short axes keep their voxels.
fn bounded(sides: [usize; 3], mut stride: [usize; 3]) -> ([usize; 3], [usize; 3]) {
    loop {
        let dims: [usize; 3] = std::array::from_fn(|axis| sides[axis].div_ceil(stride[axis]));
        if dims.iter().product::<usize>() <= MOST {
            return (dims, stride);
        }
        let longest = (0..3).max_by_key(|&axis| dims[axis]).unwrap_or(0);
        stride[longest] += 1;
    }
}

fn to_f64<T: relume_volume::Voxel>(voxel: T) -> f64 {
    voxel.to_f64()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_copy_is_bounded_for_volumes_of_any_shape() {
        for (sides, stride, expected) in [
            ([512, 512, 300], [5, 5, 5], [5, 5, 5]),
            ([20_000, 20_000, 1], [7, 7, 1], [18, 19, 1]),
            ([1 << 20, 8, 8], [4, 1, 1], [56, 1, 1]),
        ] {
            let (dims, stride) = bounded(sides, stride);
            assert!(dims.iter().product::<usize>() <= MOST, "{sides:?}: {dims:?}");
            assert_eq!(stride, expected, "{sides:?}");
        }
    }
    #[test]
    fn parts_of_fewer_than_eight_voxels_are_specks_and_long_ones_are_not() {
        // A snake of 40 voxels through the volume, two specks of 7 and 1, and a part of 8.
        let dims = [16, 16, 4];
        let mut values = vec![0.0; 16 * 16 * 4];
        let mut set = |x: usize, y: usize, z: usize| values[x + 16 * (y + 16 * z)] = 1.0;
        (0..15).for_each(|x| [0, 2].into_iter().for_each(|y| set(x, y, 0)));
        set(14, 1, 0);
        (3..12).for_each(|y| set(0, y, 0));
        (4..11).for_each(|x| set(x, 6, 2));
        (4..12).for_each(|x| set(x, 9, 2));
        set(15, 15, 3);
        let thinned = Thinned { dims, stride: [1; 3], values, unit: 1.0 };
        let inside = 31.0 + 9.0 + 7.0 + 8.0 + 1.0;
        assert!((thinned.specks(0.5) - 8.0 / inside).abs() < 1e-12, "{}", thinned.specks(0.5) * inside);
    }
}
