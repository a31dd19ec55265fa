//! Texels of a box that may reach beyond the grid.

use std::ops::Range;

use relume_base::parallel;

fn signed(number: usize) -> i64 {
    i64::try_from(number).unwrap_or(i64::MAX)
}

/// Part of a grid of `dims` voxels that the texels of a box of `edge` voxels along each axis depend on, which begins at `first`:
/// from its first voxel to before its end. One voxel more on each side is for differences; beyond it lie only faces of the
/// grid, which are repeated.
#[must_use]
pub fn read_for_box(dims: [usize; 3], first: [i64; 3], edge: usize) -> [[usize; 3]; 2] {
    let within = |at: i64, n: usize| usize::try_from(at.max(0)).unwrap_or(usize::MAX).min(n);
    let low = std::array::from_fn(|axis| within(first[axis] - 1, dims[axis] - 1));
    [low, std::array::from_fn(|axis| within(first[axis] + signed(edge) + 1, dims[axis]))]
}

/// Texels of a box of `edge` voxels along each axis, x fastest, `texel_bytes` each. The box begins at `first` and reaches
/// beyond a grid of `dims` voxels, where the texels at the faces are repeated; one of its voxels lies in the grid.
/// `row(y, z, xs, out)` writes the texels of `xs` in the row of the grid.
pub(super) fn texels_of_box(
    dims: [usize; 3],
    first: [i64; 3],
    edge: usize,
    texel_bytes: usize,
    row: impl Fn(usize, usize, Range<usize>, &mut [u8]) + Sync,
) -> Vec<u8> {
    let within = |at: i64, n: usize| usize::try_from(at.max(0)).unwrap_or(usize::MAX).min(n - 1);
    let row_bytes = edge * texel_bytes;
    let mut bytes = vec![0_u8; row_bytes * edge * edge];
    let xs = within(first[0], dims[0])..within(first[0] + signed(edge) - 1, dims[0]) + 1;
    let before = usize::try_from(signed(xs.start) - first[0]).unwrap_or(0) * texel_bytes;
    parallel::rows_mut(&mut bytes, row_bytes, &|line, out| {
        let y = within(first[1] + signed(line % edge), dims[1]);
        let z = within(first[2] + signed(line / edge), dims[2]);
        let end = before + xs.len() * texel_bytes;
        row(y, z, xs.clone(), &mut out[before..end]);
        for at in (0..before).step_by(texel_bytes) {
            out.copy_within(before..before + texel_bytes, at);
        }
        for at in (end..row_bytes).step_by(texel_bytes) {
            out.copy_within(end - texel_bytes..end, at);
        }
    });
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_repeats_the_faces_of_the_grid() {
        let row = |y: usize, z: usize, xs: Range<usize>, out: &mut [u8]| {
            for (out, x) in out.iter_mut().zip(xs) {
                *out = u8::try_from(x + 10 * y + 100 * z).unwrap_or(u8::MAX);
            }
        };
        let texels = texels_of_box([3, 2, 1], [-2, -1, 0], 6, 1, row);
        assert_eq!(texels.len(), 216);
        assert_eq!(texels[..6], [0, 0, 0, 1, 2, 2], "before the first row");
        assert_eq!(texels[6..12], [0, 0, 0, 1, 2, 2]);
        assert_eq!(texels[12..18], [10, 10, 10, 11, 12, 12]);
        assert_eq!(texels[30..36], [10, 10, 10, 11, 12, 12], "behind the last row");
        assert_eq!(texels[..36], texels[180..], "behind the last slice");
    }
}
