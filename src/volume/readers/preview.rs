//! Small pictures of the middle slices of volumes, to choose among them.

use std::path::Path;

use crate::{Geometry, Offered, RawLayout, Selection, Volume, VolumeError};
use relume_base::number::{count, whole};
use relume_base::progress::Progress;

/// A grey picture of the middle slice of a volume.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Preview {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Grey of each pixel, row by row from the top.
    pub grey: Vec<u8>,
}

impl Preview {
    /// The middle slice along z of the volume of `selection` in the file or folder `path`, whose longer side has `side`
    /// pixels. Choices that are still open are answered by the first alternative. `layout` is that of headerless voxels.
    ///
    /// DICOM, TIFF, folders of slices, Zarr, HDF5 and uncompressed `NIfTI` read no other slice, and files of bricks only the
    /// bricks around it; other formats read the volume.
    ///
    /// # Errors
    ///
    /// As [`open`](crate::open()).
    pub fn open(
        path: &Path,
        layout: Option<&RawLayout>,
        selection: &Selection,
        side: usize,
        progress: &dyn Progress,
    ) -> Result<Self, VolumeError> {
        Offered::open(path, layout, selection, progress).map(|offered| Self::of(&offered.first, side))
    }

    /// The middle slice of `volume`: in its first window, or from the 1st to the 99th percentile of the slice. A slice of a
    /// patient is upright, as radiologists see it.
    #[must_use]
    pub fn of(volume: &Volume, side: usize) -> Self {
        let Geometry { dims: [nx, ny, nz], spacing, .. } = volume.geometry;
        let lengths = [count(nx) * spacing.x, count(ny) * spacing.y];
        let longer = lengths[0].max(lengths[1]);
        let [width, height] =
            lengths.map(|length| whole((length / longer * count(side)).round()).clamp(1, side.max(1)));
        let [low, high] = window(volume, nz / 2);
        let flips = flips(volume);
        // Voxels from the first to the last of a pixel, one at least.
        let span = |pixel: usize, pixels: usize, voxels: usize, flips: bool| {
            let pixel = if flips { pixels - 1 - pixel } else { pixel };
            let first = pixel * voxels / pixels;
            first..((pixel + 1) * voxels / pixels).max(first + 1)
        };
        let mut grey = Vec::with_capacity(width * height);
        for row in 0..height {
            for column in 0..width {
                let (mut sum, mut number) = (0.0, 0.0);
                for y in span(row, height, ny, flips[1]) {
                    for x in span(column, width, nx, flips[0]) {
                        let value = volume.value([x, y, nz / 2]).filter(|value| value.is_finite());
                        sum += value.unwrap_or(0.0);
                        number += f64::from(u8::from(value.is_some()));
                    }
                }
                let part = if number > 0.0 { ((sum / number - low) / (high - low)).clamp(0.0, 1.0) } else { 0.0 };
                grey.push(u8::try_from(whole((255.0 * part).round())).unwrap_or(u8::MAX));
            }
        }
        Self { width, height, grey }
    }
}

/// Values that are black and white in the slice `z`.
fn window(volume: &Volume, z: usize) -> [f64; 2] {
    if let Some(window) = volume.presets.windows.first() {
        return [window.low, window.high];
    }
    let [nx, ny, _] = volume.geometry.dims;
    let all = (0..ny).flat_map(|y| (0..nx).map(move |x| [x, y, z]));
    let mut values: Vec<f64> = all.filter_map(|place| volume.value(place)).filter(|value| value.is_finite()).collect();
    values.sort_by(f64::total_cmp);
    let Some(last) = values.len().checked_sub(1) else { return [0.0, 1.0] };
    let [low, high] = if volume.has_labels { [0, last] } else { [last / 100, last - last / 100] };
    let [low, high] = [values[low], values[high]];
    // Few bright voxels may be above the percentile.
    let high = if high > low { high } else { values[last] };
    if high > low { [low, high] } else { [low, low + 1.0] }
}

/// Whether the columns and the rows of a slice of a patient are shown from their ends: the left of the patient is on the
/// right, posterior and inferior are below, and in a sagittal slice posterior is on the right.
fn flips(volume: &Volume) -> [bool; 2] {
    if !volume.anatomical {
        return [false; 2];
    }
    let direction = volume.geometry.direction;
    let [x, y] = [direction.x_axis, direction.y_axis];
    let [across, down] = [x.abs().max_position(), y.abs().max_position()];
    // Left and posterior grow to the right and below; superior grows upwards.
    [x[across] < 0.0, if down == 2 { y.z > 0.0 } else { y[down] < 0.0 }]
}
