//! Blocks of an array, laid into the volume of one channel and time.

use std::ops::Range;

use crate::Voxel;
use crate::axes::{Arranged, Axis};
use crate::stream::count;
use relume_base::parallel;

/// A block of an array: the numbers of a chunk, the last axis fastest, in the byte order of this machine.
pub(crate) struct Block {
    /// Index of its first number along each axis.
    pub(crate) start: Vec<usize>,
    /// Its lengths. It may reach beyond the array.
    pub(crate) lengths: Vec<usize>,
    pub(crate) bytes: Vec<u8>,
}

/// The part of an array with these axes that has the channel and the time `chosen`, and the `slices` along z: first and end
/// index along each axis.
pub(crate) fn region(arranged: &Arranged, chosen: [usize; 2], slices: &Range<usize>) -> Vec<[usize; 2]> {
    let one = |(axis, &length): (&Option<Axis>, &usize)| match axis {
        Some(Axis::Channel) => [chosen[0], chosen[0] + 1],
        Some(Axis::Time) => [chosen[1], chosen[1] + 1],
        Some(Axis::Z) => [slices.start, slices.end],
        _ => [0, length],
    };
    arranged.axes.iter().zip(&arranged.shape).map(one).collect()
}

/// Voxels of `region` along x, y and z.
pub(crate) fn dims(arranged: &Arranged, region: &[[usize; 2]]) -> [usize; 3] {
    [Axis::X, Axis::Y, Axis::Z].map(|axis| arranged.place(axis).map_or(1, |place| region[place][1] - region[place][0]))
}

/// Lays blocks of an array into the volume of `region`, x fastest. Each block touches the region.
pub(crate) fn lay<T: Voxel>(arranged: &Arranged, region: &[[usize; 2]], blocks: &[Block], volume: &mut [T]) {
    let [nx, ny, _] = dims(arranged, region);
    let places = [Axis::X, Axis::Y, Axis::Z].map(|axis| arranged.place(axis));
    let step = |block: &Block, axis: usize| block.lengths[axis + 1..].iter().product::<usize>();
    // Voxels of a block along x, y and z: first voxel in the volume, their number, step in the block.
    let spans = |block: &Block| {
        places.map(|place| match place {
            Some(axis) => {
                let [begin, end] = region[axis];
                let first = block.start[axis].max(begin);
                let last = (block.start[axis] + block.lengths[axis]).min(end);
                (first - begin, last - first, step(block, axis))
            }
            None => (0, 1, 0),
        })
    };
    // First number of the region in the block.
    let first = |block: &Block| -> usize {
        let axes = 0..block.start.len();
        axes.map(|axis| region[axis][0].saturating_sub(block.start[axis]) * step(block, axis)).sum()
    };
    parallel::rows_mut(volume, nx * ny, &|z, plane| {
        for block in blocks {
            let [x, y, depth] = spans(block);
            if z < depth.0 || z >= depth.0 + depth.1 {
                continue;
            }
            let from = first(block) + (z - depth.0) * depth.2;
            for row in 0..y.1 {
                let out = &mut plane[(y.0 + row) * nx + x.0..][..x.1];
                let from = from + row * y.2;
                if x.2 == 1 || x.1 == 1 {
                    let bytes = &block.bytes[from * size_of::<T>()..][..size_of_val(out)];
                    bytemuck::cast_slice_mut(out).copy_from_slice(bytes);
                    continue;
                }
                for (index, voxel) in out.iter_mut().enumerate() {
                    let at = (from + index * x.2) * size_of::<T>();
                    *voxel = bytemuck::pod_read_unaligned(&block.bytes[at..at + size_of::<T>()]);
                }
            }
        }
    });
}

/// Chunks over a part of an array.
pub(crate) struct Grid {
    /// First chunk along each axis.
    first: Vec<usize>,
    /// Number of chunks along each axis.
    sides: Vec<usize>,
}

impl Grid {
    /// The chunks of these lengths over `region`.
    pub(crate) fn over(region: &[[usize; 2]], lengths: &[usize]) -> Self {
        let first = region.iter().zip(lengths).map(|(&[first, _], length)| first / length);
        let ends = region.iter().zip(lengths).map(|(&[_, end], length)| end.div_ceil(*length));
        let first: Vec<usize> = first.collect();
        let sides = ends.zip(&first).map(|(end, first)| end.saturating_sub(*first)).collect();
        Self { first, sides }
    }

    /// Number of chunks.
    pub(crate) fn len(&self) -> u64 {
        self.sides.iter().fold(1, |all, &side| all.saturating_mul(count(side)))
    }

    /// Indices of chunk `number` in the array; the last axis is the fastest.
    pub(crate) fn indices(&self, mut number: u64) -> Vec<usize> {
        let mut indices = self.first.clone();
        for (index, &side) in indices.iter_mut().zip(&self.sides).rev() {
            let side = count(side).max(1);
            *index += usize::try_from(number % side).unwrap_or(0);
            number /= side;
        }
        indices
    }
}
