//! A thinned copy of a volume, by which values are examined.

use rayon::prelude::*;

use crate::number::{count, rounded, unsigned, whole};
use crate::parallel;
use crate::volume::{Volume, with_voxels};

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
    pub(super) values: Vec<f32>,
}

impl Thinned {
    pub(crate) fn of(volume: &Volume, smallest: f64) -> Self {
        let sides = volume.geometry.dims;
        let stride = whole((count(volume.geometry.voxels()) / count(MOST)).cbrt().ceil()).max(1);
        let stride = sides.map(|side| stride.min(side.div_ceil(32).max(1)));
        let (dims, stride) = bounded(sides, stride);
        let [nx, ny, _] = dims;
        let scale = |stored: f64| {
            let value = stored.mul_add(volume.slope, volume.intercept);
            rounded(if value.is_finite() { value } else { smallest })
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
        Self { dims, stride, values }
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
    fn steps(&self) -> [usize; 3] {
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
    pub(super) fn gradients(&self, step: usize) -> Vec<f32> {
        (0..self.values.len().div_ceil(step)).into_par_iter().map(|index| self.gradient(index * step)).collect()
    }

    /// Size of the gradient at `place`, per voxel of the copy.
    fn gradient(&self, place: usize) -> f32 {
        let (position, steps) = (self.position(place), self.steps());
        let along = |axis: usize| {
            let before = if position[axis] > 0 { place - steps[axis] } else { place };
            let after = if position[axis] + 1 < self.dims[axis] { place + steps[axis] } else { place };
            (self.values[after] - self.values[before]) / 2.0
        };
        let [x, y, z] = [along(0), along(1), along(2)];
        (x * x + y * y + z * z).sqrt()
    }

    /// Faces between voxels from `threshold` on and smaller ones, over the number of the former to the power of 2/3: 6
    /// for a cube, whatever its size.
    pub(super) fn roughness(&self, threshold: f64) -> f64 {
        let [nx, ny, _] = self.dims;
        let is_inside = |value: f32| f64::from(value) >= threshold;
        let (voxels, faces) = self
            .values
            .par_chunks(nx * ny)
            .enumerate()
            .map(|(z, slice)| {
                let next = self.values.get((z + 1) * nx * ny..(z + 2) * nx * ny).unwrap_or_default();
                let mut found = (0, 0);
                for (place, &value) in slice.iter().enumerate() {
                    let inside = is_inside(value);
                    let differs = |other: Option<&f32>| other.is_some_and(|&it| is_inside(it) != inside);
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
        let mut seen = vec![false; self.values.len()];
        let is_inside = |place: usize| f64::from(self.values[place]) >= threshold;
        let (mut all, mut specks) = (0, 0);
        let mut open = Vec::new();
        for start in 0..self.values.len() {
            if seen[start] || !is_inside(start) {
                continue;
            }
            seen[start] = true;
            open.push(start);
            let mut size = 0;
            while let Some(place) = open.pop() {
                size += 1;
                for next in self.neighbours(place) {
                    if !seen[next] && is_inside(next) {
                        seen[next] = true;
                        open.push(next);
                    }
                }
            }
            all += size;
            specks += if size < SPECK { size } else { 0 };
        }
        count(specks) / count(all.max(1))
    }

    /// Values on the faces of the volume, up to some thousands.
    pub(super) fn border(&self) -> Vec<f32> {
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

fn to_f64<T: crate::volume::Voxel>(voxel: T) -> f64 {
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
}
