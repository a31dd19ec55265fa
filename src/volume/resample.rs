//! Downsampling, and the resampling of leaning grids.

use std::path::Path;

use glam::{DMat3, DVec3};

use super::allocate;
use super::geometry::Lattice;
use super::{Geometry, Volume, VolumeError, Voxel, Voxels, with_voxels};
use relume_base::number::{count, whole};
use relume_base::parallel;
use relume_base::progress::{Progress, Quiet};

impl Volume {
    /// Averages blocks of `block` voxels; the mean is rounded to the stored type (integers half up: ⌊x + ½⌋). Volumes of
    /// labels are reduced by [`Self::downsample_labels`].
    ///
    /// Incomplete blocks at the end of an axis are dropped, with a note. A new voxel lies at the centre of its block;
    /// the new spacing is the size of a block. NaN is excluded from a mean unless the whole block is NaN.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Block`] if a side of the block is 0 or longer than the volume.
    pub fn downsample(&self, block: [usize; 3]) -> Result<Self, VolumeError> {
        self.whole_blocks(block, self.has_labels)
    }

    /// Reduces every block to its most frequent voxel, the smallest one among ties, because labels have no mean.
    /// Otherwise as [`Self::downsample`].
    ///
    /// # Errors
    ///
    /// [`VolumeError::Block`] if a side of the block is 0 or longer than the volume.
    pub fn downsample_labels(&self, block: [usize; 3]) -> Result<Self, VolumeError> {
        self.whole_blocks(block, true)
    }

    fn whole_blocks(&self, block: [usize; 3], labels: bool) -> Result<Self, VolumeError> {
        self.require_voxels("averaging blocks")?;
        let geometry = self.coarser(block)?;
        let voxels = with_voxels!(&self.voxels, stored => {
            Voxel::into_voxels(reduce(stored, self.geometry.dims, geometry.dims, block, labels, &Quiet))
        });
        Ok(self.resampled(voxels, geometry, block))
    }

    /// The labels on the voxels of `grid`, if these are those of their own grid, shifted by whole voxels within a
    /// thousandth: a segmentation may cover a part of its volume. Voxels outside their own grid get 0. `None` if the
    /// grids do not share their voxels.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Memory`].
    pub fn labels_laid_into(&self, grid: &Geometry) -> Result<Option<Self>, VolumeError> {
        let own = &self.geometry;
        let last = own.dims.map(|n| count(n) - 1.0);
        let shift = |corner: usize| {
            let index = DVec3::from_array([0, 1, 2].map(|axis| if corner >> axis & 1 == 1 { last[axis] } else { 0.0 }));
            grid.direction.transpose() * (own.world_from_index(index) - grid.origin) / grid.spacing - index
        };
        let offset = shift(0).round();
        // Positions are rounded in files, as `Geometry::lies_on` grants.
        let slack = 1e-3 + 1e-6 * own.origin.length() / grid.spacing.min_element();
        let is_there = (0..8).all(|corner| (shift(corner) - offset).abs().cmple(DVec3::splat(slack)).all());
        if !is_there || !offset.is_finite() {
            return Ok(None);
        }
        #[expect(clippy::cast_possible_truncation, reason = "saturates; a shift beyond the grid leaves no voxel")]
        let offset = offset.to_array().map(|voxels| voxels as i64);
        let (voxels, lost, all) = with_voxels!(&self.voxels, stored => {
            let mut laid = allocate::zeroed(Path::new(&self.source), grid.voxels())?;
            let lost = lay(stored, own.dims, offset, &mut laid, grid.dims);
            let all = lost > 0 && laid.iter().all(|voxel| voxel.to_f64() == 0.0);
            (Voxel::into_voxels(laid), lost, all)
        });
        let mut laid = Self { voxels, geometry: *grid, ..self.clone() };
        let ([x, y, z], [a, b, c], [i, j, k]) = (own.dims, grid.dims, offset);
        laid.notes.push(format!(
            "{}: the labels of {x}×{y}×{z} voxels are laid into the {a}×{b}×{c} voxels of the volume, from voxel {i}, {j}, {k} on",
            self.source
        ));
        if all {
            laid.notes.push(format!(
                "{}: all {lost} labelled voxels lie outside the volume, so no label is shown",
                self.source
            ));
        } else if lost > 0 {
            laid.notes.push(format!("{}: {lost} labelled voxels lie outside the volume, and are dropped", self.source));
        }
        Ok(Some(laid))
    }

    /// The grid of complete blocks.
    fn coarser(&self, block: [usize; 3]) -> Result<Geometry, VolumeError> {
        let dims = self.geometry.dims;
        if (0..3).any(|axis| block[axis] == 0 || block[axis] > dims[axis]) {
            return Err(VolumeError::Block { source_name: self.source.clone(), block, dims });
        }
        self.geometry.of_blocks(&self.source, block, std::array::from_fn(|axis| dims[axis] / block[axis]))
    }

    fn resampled(&self, voxels: Voxels, geometry: Geometry, block: [usize; 3]) -> Self {
        let mut resampled = self.reduced(voxels, geometry, block);
        let dims = self.geometry.dims;
        let dropped: [usize; 3] = std::array::from_fn(|axis| dims[axis] % block[axis]);
        if dropped != [0; 3] {
            let [x, y, z] = dropped;
            resampled.notes.push(format!(
                "{}: {x}, {y}, {z} voxels at the ends of x, y, z do not fill a block and are dropped",
                self.source
            ));
        }
        resampled
    }

    /// This volume with `voxels`, one for each block, on their grid.
    pub(super) fn reduced(&self, voxels: Voxels, geometry: Geometry, block: [usize; 3]) -> Self {
        let Self { source, files, metadata, presets, notes, assumed_spacing, .. } = self;
        let (source, files, metadata, presets) = (source.clone(), files.clone(), metadata.clone(), presets.clone());
        let (notes, assumed_spacing) = (notes.clone(), assumed_spacing.clone());
        let blocks = std::array::from_fn(|axis| self.blocks[axis] * block[axis]);
        let (selection, component_names) = (self.selection.clone(), self.component_names.clone());
        Self {
            voxels,
            bricks: None,
            part: None,
            finest: None,
            geometry,
            selection,
            component_names,
            presets,
            blocks,
            source,
            files,
            metadata,
            assumed_spacing,
            notes,
            ..*self
        }
    }
}

/// Copies the voxels `stored` to their places in `laid`, which are shifted by `offset`; returns the number of voxels other
/// than 0 that have no place.
fn lay<T: Voxel>(stored: &[T], [nx, ny, nz]: [usize; 3], offset: [i64; 3], laid: &mut [T], dims: [usize; 3]) -> usize {
    let place = |index: usize, axis: usize| {
        let moved = i64::try_from(index).ok()?.checked_add(offset[axis])?;
        usize::try_from(moved).ok().filter(|&moved| moved < dims[axis])
    };
    let mut lost = 0;
    for row in 0..ny * nz {
        let out = place(row % ny, 1).zip(place(row / ny, 2)).map(|(y, z)| dims[0] * (y + dims[1] * z));
        for (x, &label) in stored[row * nx..][..nx].iter().enumerate() {
            match out.zip(place(x, 0)) {
                Some((start, x)) => laid[start + x] = label,
                None => lost += usize::from(label != T::zeroed()),
            }
        }
    }
    lost
}

/// The means of blocks of `block` voxels of a grid of `dims`, or their most frequent numbers if these are `labels`. Blocks at
/// the end of an axis may be incomplete.
pub(super) fn of_blocks<T: Voxel>(
    stored: &[T],
    dims: [usize; 3],
    block: [usize; 3],
    labels: bool,
    progress: &dyn Progress,
) -> Vec<T> {
    reduce(stored, dims, std::array::from_fn(|axis| dims[axis].div_ceil(block[axis])), block, labels, progress)
}

/// As [`of_blocks`], of the first `coarse` blocks along each axis.
fn reduce<T: Voxel>(
    stored: &[T],
    [nx, ny, nz]: [usize; 3],
    coarse: [usize; 3],
    [bx, by, bz]: [usize; 3],
    labels: bool,
    progress: &dyn Progress,
) -> Vec<T> {
    let [width, height, depth] = coarse;
    let mut voxels = vec![T::zeroed(); width * height * depth];
    parallel::rows_mut(&mut voxels, width, &|row, out| {
        if progress.cancelled() {
            return;
        }
        let mut values = Vec::with_capacity(bx * by * bz);
        let (first_y, first_z) = (row % height * by, row / height * bz);
        // Most blocks are eight voxels. The compiler knows their number, so that no division is left.
        let is_eight = [bx, by, bz] == [2; 3] && first_y + 2 <= ny && first_z + 2 <= nz;
        let eights = if is_eight { (nx / 2).min(out.len()) } else { 0 };
        let (of_eight, others) = out.split_at_mut(eights);
        if is_eight {
            let lines = [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[y, z]| {
                let line = &stored[nx * (first_y + y + ny * (first_z + z))..][..2 * eights];
                line.as_chunks::<2>().0
            });
            let [line, below, behind, below_behind] = lines;
            let pairs = line.iter().zip(below).zip(behind.iter().zip(below_behind));
            for (voxel, ((&[a, b], &[c, d]), (&[e, f], &[g, h]))) in of_eight.iter_mut().zip(pairs) {
                *voxel = of_block(&mut [a, b, c, d, e, f, g, h], labels);
            }
        }
        for (block, voxel) in (eights..).zip(others) {
            let first_x = bx * block;
            values.clear();
            for z in first_z..(first_z + bz).min(nz) {
                for y in first_y..(first_y + by).min(ny) {
                    let row = nx * (y + ny * z);
                    values.extend_from_slice(&stored[row + first_x..row + (first_x + bx).min(nx)]);
                }
            }
            *voxel = of_block(&mut values, labels);
        }
    });
    voxels
}

/// The voxel in place of those of a block, which are at least one.
#[inline]
fn of_block<T: Voxel>(values: &mut [T], labels: bool) -> T {
    let one = if labels { most_frequent(values) } else { T::mean(values.iter().copied()) };
    one.unwrap_or(T::zeroed())
}

/// The most frequent value, the smallest one among ties.
fn most_frequent<T: Voxel>(values: &mut [T]) -> Option<T> {
    // Labels are numbers; NaN is not a valid label, so its order does not matter.
    values.sort_unstable_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
    let runs = values.chunk_by(|a, b| a == b);
    // `max_by_key` returns the last of equal maxima; in reverse order, this is the smallest value.
    runs.rev().max_by_key(|run| run.len()).map(|run| run[0])
}

/// Grid of a volume about to be read.
pub(super) enum Grid {
    /// The grid of the file.
    Own(Geometry),
    /// A straight grid, in which the voxels of a leaning one are resampled.
    Straightened(Lattice, Geometry),
}

impl Grid {
    /// The grid of `lattice`; with `resample`, a straight one if it leans.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Lean`] if the axes are not orthogonal and `resample` is false, or if they are too flat.
    pub(super) fn of(lattice: Lattice, source: &str, resample: bool) -> Result<Self, VolumeError> {
        match lattice.geometry(source) {
            Err(VolumeError::Lean { .. }) if resample => Ok(Self::Straightened(lattice, lattice.straightened(source)?)),
            made => made.map(Self::Own),
        }
    }

    /// Voxels along each axis, or the reason why they are not those of the file.
    pub(super) fn dims(&self) -> Result<[usize; 3], &'static str> {
        match self {
            Self::Own(geometry) => Ok(geometry.dims),
            Self::Straightened(..) => Err("its sheared grid is resampled"),
        }
    }

    /// The grid of a file that states spacing and directions apart; otherwise as [`Self::of`].
    ///
    /// # Errors
    ///
    /// As [`Geometry::new`]; [`VolumeError::Lean`] if the axes have unit length and are not orthogonal, but can be
    /// resampled, and `resample` is false, or if `resample` is true and they are too flat.
    pub(super) fn placed(
        source: &str,
        (dims, spacing): ([usize; 3], DVec3),
        (origin, direction): (DVec3, DMat3),
        resample: bool,
    ) -> Result<Self, VolumeError> {
        match Geometry::new(source, dims, spacing, origin, direction) {
            Err(error @ VolumeError::Direction { .. }) if direction.is_finite() => {
                let lattice = Lattice { dims, origin, steps: direction * DMat3::from_diagonal(spacing) };
                let can_be = || are_unit(direction) && lattice.straightened(source).is_ok();
                if resample || can_be() { Self::of(lattice, source, resample) } else { Err(error) }
            }
            made => made.map(Self::Own),
        }
    }

    /// The volume of `voxels` in this grid. Resampling is trilinear, rounded to the stored type; `has_labels` selects
    /// the nearest voxel instead. A voxel outside the leaning grid gets the smallest value, which is the largest stored
    /// number if `slope` is negative.
    pub(super) fn volume(
        self,
        source: &str,
        voxels: Voxels,
        has_labels: bool,
        slope: f64,
    ) -> Result<Volume, VolumeError> {
        self.volume_around(source, voxels, has_labels, slope, None)
    }

    /// As [`Self::volume`]; a voxel outside the leaning grid gets the first stored number of the range `padding`, if there is one.
    /// Beside a voxel of this range, which stands for no value, it gets the nearest voxel.
    pub(super) fn volume_around(
        self,
        source: &str,
        voxels: Voxels,
        has_labels: bool,
        slope: f64,
        padding: Option<[f64; 2]>,
    ) -> Result<Volume, VolumeError> {
        let (lattice, straight) = match self {
            Self::Own(geometry) => {
                return Ok(Volume { has_labels, ..Volume::of_voxels(source, voxels, geometry)? });
            }
            Self::Straightened(lattice, straight) => (lattice, straight),
        };
        let voxels = with_voxels!(&voxels, stored => {
            let outside = padding.map_or_else(|| outermost(stored, slope < 0.0), |[first, _]| Voxel::nearest(first));
            // A straight grid may have several times the voxels of the leaning one.
            let voxels = allocate::zeroed(Path::new(source), straight.voxels())?;
            straightened((stored, &lattice), (voxels, &straight), (outside, padding), has_labels)
        });
        let mut volume = Volume { has_labels, ..Volume::new(source, voxels, straight)? };
        let ([x, y, z], [a, b, c]) = (lattice.dims, straight.dims);
        volume.notes.push(format!(
            "{source}: its axes lean; {x}×{y}×{z} voxels are resampled to a straight grid of {a}×{b}×{c}"
        ));
        Ok(volume)
    }
}

/// Whether the columns have unit length, up to the digits of a header.
fn are_unit(direction: DMat3) -> bool {
    [0, 1, 2].iter().all(|&axis| (direction.col(axis).length_squared() - 1.0).abs() <= 1e-3)
}

/// The smallest number, or the largest one; NaN only if there is no other.
fn outermost<T: Voxel>(stored: &[T], largest: bool) -> T {
    let is_further = |voxel: &T, best: &T| if largest { voxel > best } else { voxel < best };
    // NaN is not equal to itself.
    #[expect(clippy::eq_op, reason = "asks for NaN, in any type")]
    let numbers = stored.iter().copied().filter(|voxel| voxel == voxel);
    let found = numbers.reduce(|best, voxel| if is_further(&voxel, &best) { voxel } else { best });
    found.or_else(|| stored.first().copied()).unwrap_or(T::zeroed())
}

/// Fills the `voxels` of the grid `straight`, interpolated between the voxels `stored` of `lattice`.
fn straightened<T: Voxel>(
    (stored, lattice): (&[T], &Lattice),
    (mut voxels, straight): (Vec<T>, &Geometry),
    (outside, padding): (T, Option<[f64; 2]>),
    nearest: bool,
) -> Voxels {
    let padding = padding.map(|[one, other]| [one.min(other), one.max(other)]);
    let [nx, ny, nz] = lattice.dims;
    let last = DVec3::from_array(lattice.dims.map(|n| count(n - 1)));
    let index_from_world = lattice.steps.inverse();
    let at = |[x, y, z]: [usize; 3]| stored[x.min(nx - 1) + nx * (y.min(ny - 1) + ny * z.min(nz - 1))];
    let sample = |world: DVec3| {
        let index = index_from_world * (world - lattice.origin);
        // A voxel at the end of an axis is inside, whatever the rounding.
        let margin = if nearest { 0.5 } else { 1e-6 };
        if !(index.cmpge(DVec3::splat(-margin)).all() && index.cmple(last + margin).all()) {
            return outside;
        }
        let index = index.clamp(DVec3::ZERO, last);
        if nearest {
            return at(index.round().to_array().map(whole));
        }
        let (low, part) = (index.floor().to_array().map(whole), index - index.floor());
        let (mut sum, mut is_padded) = (0.0, false);
        for corner in 0..8_usize {
            let bits = [corner & 1, corner >> 1 & 1, corner >> 2];
            let weights = [0, 1, 2].map(|axis| if bits[axis] == 1 { part[axis] } else { 1.0 - part[axis] });
            let weight: f64 = weights.iter().product();
            // A weight of 0 excludes NaN as well.
            if weight > 0.0 {
                let number = at([0, 1, 2].map(|axis| low[axis] + bits[axis])).to_f64();
                is_padded |= padding.is_some_and(|[least, most]| number >= least && number <= most);
                sum += weight * number;
            }
        }
        // A mean of padding and values is neither.
        if is_padded { at(index.round().to_array().map(whole)) } else { T::nearest(sum) }
    };
    let [width, height, _] = straight.dims;
    parallel::rows_mut(&mut voxels, width, &|row, out| {
        for (x, voxel) in out.iter_mut().enumerate() {
            let index = [x, row % height, row / height].map(count);
            *voxel = sample(straight.world_from_index(DVec3::from_array(index)));
        }
    });
    T::into_voxels(voxels)
}
