//! Texture storage of the volume: values normalised in f64, with gradients if shading needs them.

use std::collections::BTreeMap;
use std::convert::Infallible;
use std::ops::Range;

use super::boxes::{read_for_box, texels_of_box};
use super::whole::{WholeCodes, neighbours};
use crate::plan::ScenePlan;
use crate::{Gradients, LabelEntry, Labels, Scene, VolumeAs};
use relume_base::number::count;
use relume_base::number::rounded;
use relume_base::parallel;
use relume_base::progress::Progress;
use relume_volume::{BrickCache, MOST_LABELS, Statistics, Volume, VolumeError, Voxel, VoxelType, with_voxels};

/// Texture formats of a volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum VolumeFormat {
    /// 16-bit values.
    R16Unorm,
    /// f32 values, for data that 16 bits would round.
    R32Float,
    /// 16-bit central differences in xyz, value in w.
    Rgba16Snorm,
    /// f32 central differences in xyz, value in w.
    Rgba32Float,
}

impl VolumeFormat {
    /// Bytes per voxel.
    #[must_use]
    pub fn bytes(self) -> usize {
        match self {
            Self::R16Unorm => 2,
            Self::R32Float => 4,
            Self::Rgba16Snorm => 8,
            Self::Rgba32Float => 16,
        }
    }

    /// Whether gradients are stored.
    #[must_use]
    pub fn has_gradient(self) -> bool {
        matches!(self, Self::Rgba16Snorm | Self::Rgba32Float)
    }
}

/// Conversion from voxels to texels, and from texels to values.
///
/// 8-bit data are normalised over the range of their type, other data over their own range. NaN becomes the smallest
/// finite value, ±∞ the ends of the range. In 16-bit formats, whole numbers get codes a whole stride apart, so that
/// they lose nothing, and a difference of zero is code 0, which decodes to exactly 0.
#[derive(Clone, Debug, PartialEq)]
pub struct Storage {
    /// Texture format.
    pub format: VolumeFormat,
    /// Lowest and highest value, after slope and intercept; the domain of the transfer table.
    pub domain: [f64; 2],
    /// Largest change of a value by storing it, in data units; 0 if storage is lossless.
    pub loss: f64,
    slope: f64,
    intercept: f64,
    /// Codes per normalised unit in 16-bit formats, else 1.
    codes: f64,
    /// Codes per unit of difference along each axis; 0 if the data do not change along it.
    difference_codes: [f64; 3],
    /// Factors from decoded differences to the gradient direction, which is then normalised.
    gradient_scale: [f64; 3],
    /// Factor from the length of that direction to the gradient magnitude.
    magnitude_scale: f64,
    /// Codes of the stored numbers, if all are whole.
    whole: Option<WholeCodes>,
    /// Scale and offset from a texel's value to the normalised one, of texels that are numbers.
    of_numbers: Option<[f64; 2]>,
}

/// Texels that are whole numbers, for devices without 16-bit normalised formats: browsers.
#[derive(Clone, Debug, PartialEq)]
pub struct NumberStorage {
    /// The same storage, read from such texels: a value is its number less `shift`, and a difference that of the numbers. Its loss
    /// is that of the numbers.
    pub storage: Storage,
    /// Largest number.
    pub largest: u32,
    /// True if texels are 16-bit floats, which all devices filter, and otherwise of 32 bits.
    pub is_half: bool,
    /// Difference of a number and its value, so that 16-bit floats hold it exactly.
    pub shift: u32,
}

impl NumberStorage {
    /// Numbers up to which 16-bit floats hold all whole numbers.
    const EXACT: u32 = 2048;

    /// Numbers for the values of `volume`, stored as `of` says for a device: whole numbers of at most 16 bits lose nothing, and others are rounded to
    /// 12 bits of their range.
    #[must_use]
    pub fn new(of: &Storage, volume: &Volume) -> Self {
        let span = (of.domain[1] - of.domain[0]) / of.slope.abs();
        let is_whole = !matches!(volume.voxels.voxel_type(), VoxelType::F32 | VoxelType::F64);
        let is_exact = is_whole && span <= UNORM16 && (span - span.round()).abs() < 1e-6;
        let largest =
            if is_exact { relume_base::number::nearest(span).unsigned_abs().max(1) } else { 2 * Self::EXACT - 1 };
        let numbers = f64::from(largest);
        let is_half = largest < 2 * Self::EXACT;
        let shift = if is_half && largest > Self::EXACT { Self::EXACT } else { 0 };
        let full = if of.format == VolumeFormat::Rgba16Snorm { SNORM16 } else { 1.0 };
        let per_difference = if of.format.has_gradient() {
            of.difference_codes.map(|codes| codes / (numbers * full))
        } else {
            [1.0 / (numbers * of.normalised_from_texel()[0]); 3]
        };
        let storage = Storage {
            gradient_scale: std::array::from_fn(|axis| of.gradient_scale[axis] * per_difference[axis]),
            of_numbers: Some([1.0 / numbers, f64::from(shift) / numbers]),
            loss: if is_exact { 0.0 } else { 0.5 * (of.domain[1] - of.domain[0]) / numbers },
            ..of.clone()
        };
        Self { storage, largest, is_half, shift }
    }

    /// The numbers of all voxels of the volume, x fastest.
    #[must_use]
    pub fn numbers(&self, volume: &Volume) -> Vec<u16> {
        let largest = f64::from(self.largest);
        let number = |stored: f64| unsigned_code(self.storage.normalised(stored) * largest);
        let slice = volume.geometry.dims[0] * volume.geometry.dims[1];
        with_voxels!(&volume.voxels, stored => {
            let slices: Vec<_> = stored.chunks(slice.max(1)).collect();
            let of_slice = |z: usize| slices[z].iter().map(|stored| number(stored.to_f64())).collect::<Vec<u16>>();
            parallel::map(slices.len(), &of_slice).concat()
        })
    }
}

const UNORM16: f64 = 65535.0;
const SNORM16: f64 = 32767.0;

impl Storage {
    /// Chooses the storage of `volume`, whose voxels are in memory, under `plan`; `statistics` are those of its values.
    #[must_use]
    pub fn new(plan: &ScenePlan, volume: &Volume, statistics: &Statistics) -> Self {
        let differences = |storage: &Self| Ok::<_, Infallible>(largest_differences(storage, volume));
        let Ok(storage) = Self::chosen(plan, volume, statistics, differences);
        storage
    }

    /// The storages of the further fields of `scene`.
    #[must_use]
    pub fn of_further(plan: &ScenePlan, scene: &Scene) -> Vec<Self> {
        // Fields that share texels have no room for gradients; those of others are stored if any of them needs them.
        let without = ScenePlan { gradients: Gradients::Central, ..plan.clone() };
        let beside = if plan.stores_placed_gradients() { plan } else { &without };
        let sharing = scene.fields.sharing().iter().map(|field| (&without, field));
        let all = sharing.chain(scene.fields.beside().iter().map(|field| (beside, field)));
        all.map(|(plan, field)| Self::new(plan, &field.volume, field.statistics())).collect()
    }

    /// The format of [`Self::new`], which follows from the statistics: no voxel is read.
    #[must_use]
    pub fn format_of(plan: &ScenePlan, volume: &Volume, statistics: &Statistics) -> VolumeFormat {
        let Ok(storage) = Self::chosen(plan, volume, statistics, |_| Ok::<_, Infallible>([0.0; 3]));
        storage.format
    }

    /// As [`Self::new`], also for a volume whose voxels stay in a file of bricks, all of which may be read.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Read`], [`VolumeError::Bricks`], [`VolumeError::Cancelled`].
    pub fn of(
        plan: &ScenePlan,
        volume: &Volume,
        statistics: &Statistics,
        progress: &dyn Progress,
    ) -> Result<Self, VolumeError> {
        Self::chosen(plan, volume, statistics, |storage| match &volume.bricks {
            None => Ok(largest_differences(storage, volume)),
            Some(cache) => largest_in_cache(storage, cache, (&volume.source, volume.geometry.dims), progress),
        })
    }

    fn chosen<E>(
        plan: &ScenePlan,
        volume: &Volume,
        statistics: &Statistics,
        largest: impl FnOnce(&Self) -> Result<[f64; 3], E>,
    ) -> Result<Self, E> {
        let voxel_type = volume.voxels.voxel_type();
        let (slope, intercept) = (volume.slope, volume.intercept);
        let typed = match voxel_type {
            VoxelType::U8 => Some([0.0, 255.0]),
            VoxelType::I8 => Some([-128.0, 127.0]),
            _ => None,
        };
        let domain = typed.map_or([statistics.min, statistics.max], |ends| {
            let ends = ends.map(|stored: f64| stored.mul_add(slope, intercept));
            [ends[0].min(ends[1]), ends[0].max(ends[1])]
        });
        let (domain, cut) = finite_domain(domain);
        let span = (domain[1] - domain[0]) / slope.abs();
        let whole = !matches!(voxel_type, VoxelType::F32 | VoxelType::F64);
        let gradient = plan.stores_gradient();
        let lossless = whole && span <= if gradient { 2.0 * SNORM16 } else { UNORM16 };
        let narrow = match plan.volume {
            VolumeAs::Auto => lossless,
            VolumeAs::Single => false,
            VolumeAs::Short => true,
        };
        let format = match (gradient, narrow) {
            (false, true) => VolumeFormat::R16Unorm,
            (false, false) => VolumeFormat::R32Float,
            (true, true) => VolumeFormat::Rgba16Snorm,
            (true, false) => VolumeFormat::Rgba32Float,
        };
        let (codes, loss) = match format {
            VolumeFormat::R16Unorm if whole => whole_codes(UNORM16, span, slope),
            VolumeFormat::Rgba16Snorm if whole => whole_codes(2.0 * SNORM16, span, slope),
            VolumeFormat::R16Unorm => (UNORM16, 0.5 * span / UNORM16 * slope.abs()),
            VolumeFormat::Rgba16Snorm => (2.0 * SNORM16, 0.25 * span / SNORM16 * slope.abs()),
            // f32 rounds a number from 0 to 1 by at most 2^-25. The normalisation rounds even 24-bit integers and f32
            // data. A single value is an end of the domain, and exact.
            VolumeFormat::R32Float | VolumeFormat::Rgba32Float if statistics.min >= statistics.max => (1.0, 0.0),
            VolumeFormat::R32Float | VolumeFormat::Rgba32Float => (1.0, (domain[1] - domain[0]) * 2.0_f64.powi(-25)),
        };
        let loss = loss + cut + rounded_off(volume) * slope.abs();
        let mut storage = Self {
            format,
            domain,
            loss,
            slope,
            intercept,
            codes,
            difference_codes: [0.0; 3],
            gradient_scale: [0.0; 3],
            magnitude_scale: 0.0,
            whole: None,
            of_numbers: None,
        };
        if gradient {
            storage.scale_differences(volume, largest)?;
        } else if plan.gradient() {
            // For differences between the values one voxel ahead and one voxel behind.
            let spacing = volume.geometry.spacing;
            storage.gradient_scale = (spacing.min_element() / spacing).to_array();
            let [scale, _] = storage.normalised_from_texel();
            storage.magnitude_scale = scale * (domain[1] - domain[0]) / (2.0 * spacing.min_element());
        }
        let lowest = match format {
            VolumeFormat::R16Unorm => Some(0),
            VolumeFormat::Rgba16Snorm => Some(-i32::from(i16::MAX)),
            VolumeFormat::R32Float | VolumeFormat::Rgba32Float => None,
        };
        let codes = [codes, storage.difference_codes[0]];
        let is_even = storage.difference_codes.iter().all(|it| it.to_bits() == codes[1].to_bits());
        storage.whole = lowest
            .filter(|_| is_even)
            .and_then(|lowest| WholeCodes::of(voxel_type, [slope, intercept], domain, lowest, codes));
        Ok(storage)
    }

    /// Sets the codes of differences: a whole number of codes per whole number if the largest possible difference fits,
    /// else scaled to the largest difference in the data.
    fn scale_differences<E>(
        &mut self,
        volume: &Volume,
        largest: impl FnOnce(&Self) -> Result<[f64; 3], E>,
    ) -> Result<(), E> {
        let full = if self.format == VolumeFormat::Rgba16Snorm { SNORM16 } else { 1.0 };
        let span = (self.domain[1] - self.domain[0]) / self.slope.abs();
        // One-sided differences at the faces count twice.
        let whole_codes = (full / (2.0 * span)).floor() * span;
        let codes = if whole_codes > 0.0 {
            [whole_codes; 3]
        } else {
            largest(self)?.map(|largest| if largest > 0.0 { full / largest } else { 0.0 })
        };
        self.difference_codes = codes;
        let spacing = volume.geometry.spacing.to_array();
        let scale: [f64; 3] =
            std::array::from_fn(|axis| if codes[axis] > 0.0 { full / codes[axis] / spacing[axis] } else { 0.0 });
        let largest = scale.iter().fold(f64::MIN_POSITIVE, |a: f64, &b| a.max(b));
        self.gradient_scale = scale.map(|scale| scale / largest);
        self.magnitude_scale = largest * (self.domain[1] - self.domain[0]) / 2.0;
        Ok(())
    }

    /// Normalises a stored value to 0–1 over the domain.
    #[must_use]
    pub fn normalised(&self, stored: f64) -> f64 {
        // No `mul_add`: without hardware support it is a function call, and this runs for every voxel.
        let value = stored * self.slope + self.intercept;
        let normalised = (value - self.domain[0]) / (self.domain[1] - self.domain[0]);
        // Comparisons in this order map NaN to 0.
        if normalised > 0.0 { if normalised < 1.0 { normalised } else { 1.0 } } else { 0.0 }
    }

    /// Scale and offset from a texel's value to 0–1 over the domain.
    #[must_use]
    pub fn normalised_from_texel(&self) -> [f64; 2] {
        if let Some(of_numbers) = self.of_numbers {
            return of_numbers;
        }
        match self.format {
            VolumeFormat::R16Unorm => [UNORM16 / self.codes, 0.0],
            VolumeFormat::Rgba16Snorm => [SNORM16 / self.codes, SNORM16 / self.codes],
            VolumeFormat::R32Float | VolumeFormat::Rgba32Float => [1.0, 0.0],
        }
    }

    /// Factors per axis from decoded differences to a vector along the gradient in the volume's own axes, up to a
    /// common factor.
    #[must_use]
    pub fn gradient_scale(&self) -> [f64; 3] {
        self.gradient_scale
    }

    /// Factor from the length of a decoded difference, times [`Self::gradient_scale`], to the gradient magnitude in data
    /// units per world unit. Differences in the march halve it at the faces, where one of the two values is clamped.
    #[must_use]
    pub fn magnitude_scale(&self) -> f64 {
        self.magnitude_scale
    }

    /// Scale and offset from a texel's value to the gradient of a fall to the lowest value within twice this `length`, in world
    /// units, as decoded differences times [`Self::gradient_scale`] measure.
    #[must_use]
    pub fn fall_from_texel(&self, length: f64) -> [f64; 2] {
        if self.magnitude_scale <= 0.0 {
            return [0.0; 2];
        }
        let fall = (self.domain[1] - self.domain[0]) / (2.0 * length * self.magnitude_scale);
        self.normalised_from_texel().map(|term| term * fall)
    }

    /// Describes the storage of a volume of `dims` voxels in a sentence.
    #[must_use]
    pub fn explain(&self, dims: [usize; 3]) -> String {
        let gradients = if self.format.has_gradient() { ", which way values change included" } else { "" };
        let moves = if self.loss > 0.0 {
            format!("rounds its values by up to {:.1e}", self.loss)
        } else {
            "loses nothing".into()
        };
        let bytes = count(usize::try_from(self.bytes(dims)).unwrap_or(usize::MAX));
        let amount = match bytes {
            ..1e3 => format!("{bytes} bytes"),
            ..1e5 => format!("{:.1} kB", bytes / 1e3),
            _ => format!("{:.1} MB", bytes / 1e6),
        };
        format!("For the device, the volume takes {amount}{gradients}; storing it so {moves}.")
    }

    /// Bytes of the whole texture.
    #[must_use]
    pub fn bytes(&self, dims: [usize; 3]) -> u64 {
        dims.iter().fold(self.format.bytes() as u64, |bytes, &n| bytes.saturating_mul(n as u64))
    }

    /// Encodes the slices `slices` as texture bytes.
    #[must_use]
    pub fn slab(&self, volume: &Volume, slices: Range<usize>) -> Vec<u8> {
        let [nx, ny, _] = volume.geometry.dims;
        let row_bytes = nx * self.format.bytes();
        let mut bytes = vec![0_u8; row_bytes * ny * slices.len()];
        with_voxels!(&volume.voxels, stored => {
            let grid = Grid { stored, dims: volume.geometry.dims };
            parallel::rows_mut(&mut bytes, row_bytes, &|row, out| {
                self.row(&grid, slices.start * ny + row, 0..nx, out);
            });
        });
        bytes
    }

    /// Encodes a box of `edge` voxels along each axis that begins at `first`. Outside the grid, the texels at its faces
    /// are repeated.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Read`], [`VolumeError::Bricks`] if the voxels are in a file of bricks.
    pub fn texels_of_box(&self, volume: &Volume, first: [i64; 3], edge: usize) -> Result<Vec<u8>, VolumeError> {
        let Some(cache) = &volume.bricks else { return Ok(self.texels_in_memory(volume, first, edge)) };
        let [low, high] = read_for_box(volume.geometry.dims, first, edge);
        let part = cache.part(low, high)?;
        let of_part = |axis| first[axis] - i64::try_from(low[axis]).unwrap_or(i64::MAX);
        Ok(self.texels_in_memory(&part, std::array::from_fn(of_part), edge))
    }

    fn texels_in_memory(&self, volume: &Volume, first: [i64; 3], edge: usize) -> Vec<u8> {
        let dims = volume.geometry.dims;
        with_voxels!(&volume.voxels, stored => {
            let grid = Grid { stored, dims };
            texels_of_box(dims, first, edge, self.format.bytes(), |y, z, xs, out| {
                self.row(&grid, y + dims[1] * z, xs, out);
            })
        })
    }

    fn row<T: Voxel>(&self, grid: &Grid<'_, T>, row: usize, xs: Range<usize>, out: &mut [u8]) {
        let size = self.format.bytes();
        let first = xs.start;
        match (self.format, self.whole) {
            (VolumeFormat::R16Unorm, Some(whole)) => whole.values(&grid.line(row)[xs], out),
            (VolumeFormat::Rgba16Snorm, Some(whole)) => {
                let (lines, one_sided) = grid.lines(row);
                whole.gradients(lines, one_sided, xs, out);
            }
            (VolumeFormat::R16Unorm, None) => {
                for (out, value) in out.chunks_exact_mut(size).zip(&grid.line(row)[xs]) {
                    let code = unsigned_code(self.normalised(value.to_f64()) * self.codes);
                    out.copy_from_slice(&code.to_ne_bytes());
                }
            }
            (VolumeFormat::R32Float, _) => {
                for (out, value) in out.chunks_exact_mut(size).zip(&grid.line(row)[xs]) {
                    out.copy_from_slice(&rounded(self.normalised(value.to_f64())).to_ne_bytes());
                }
            }
            (VolumeFormat::Rgba16Snorm, None) => grid.differences(self, row, xs, |x, value, difference| {
                let code = |axis: usize| signed_code(difference[axis] * self.difference_codes[axis]);
                let value = signed_code(value * self.codes - SNORM16);
                let texel = [code(0), code(1), code(2), value];
                out[(x - first) * size..(x - first + 1) * size].copy_from_slice(bytemuck::bytes_of(&texel));
            }),
            (VolumeFormat::Rgba32Float, _) => grid.differences(self, row, xs, |x, value, difference| {
                let code = |axis: usize| rounded(difference[axis] * self.difference_codes[axis]);
                let texel = [code(0), code(1), code(2), rounded(value)];
                out[(x - first) * size..(x - first + 1) * size].copy_from_slice(bytemuck::bytes_of(&texel));
            }),
        }
    }
}

/// Returns a finite domain of finite width, and the largest change of the data's ends. The domain of a single value
/// starts at it, or ends at it if f64 has no room above.
fn finite_domain(data: [f64; 2]) -> ([f64; 2], f64) {
    const HALF: f64 = f64::MAX / 2.0;
    let [low, high] = data.map(|end| end.clamp(f64::MIN, f64::MAX));
    if low >= high {
        let width = low.abs().max(1.0);
        return (if low > HALF { [low - width, low] } else { [low, low + width] }, 0.0);
    }
    if (high - low).is_finite() {
        return ([low, high], 0.0);
    }
    // Clamping each end to half of the range gives a finite span, and moves no value up to 1e307.
    let domain = [low.max(-HALF), high.min(HALF)];
    (domain, (domain[0] - low).max(high - domain[1]))
}

/// Largest rounding error of 64-bit integers converted to f64; 0 for other types.
#[expect(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "whole, and few digits are enough")]
fn rounded_off(volume: &Volume) -> f64 {
    if !matches!(volume.voxels.voxel_type(), VoxelType::U64 | VoxelType::I64) {
        return 0.0;
    }
    if let Some(cache) = &volume.bricks {
        return cache.rounded_off();
    }
    let off = |exact: i128, rounded: f64| exact.abs_diff(rounded as i128);
    with_voxels!(&volume.voxels, stored => {
        const PART: usize = 1 << 20;
        let parts = parallel::map(stored.len().div_ceil(PART), &|part| {
            let values = stored[part * PART..].iter().take(PART);
            values.filter_map(|value| Some(off(value.to_whole()?, value.to_f64()))).max()
        });
        parts.into_iter().flatten().max().unwrap_or(0) as f64
    })
}

/// Rounds to the nearest code from 0 to 65535. Does not use `round`, a function call on baseline processors.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "casts of floats saturate")]
fn unsigned_code(number: f64) -> u16 {
    (number + 0.5) as u16
}

/// Rounds to the nearest code from −32767 to 32767.
#[expect(clippy::cast_possible_truncation, reason = "within ±32767")]
fn signed_code(number: f64) -> i16 {
    (((number + 32768.5) as i32) - 32768) as i16
}

/// Returns the largest central difference of normalised values along each axis.
fn largest_differences(storage: &Storage, volume: &Volume) -> [f64; 3] {
    with_voxels!(&volume.voxels, stored => {
        let grid = Grid { stored, dims: volume.geometry.dims };
        let rows = grid.dims[1] * grid.dims[2];
        let of_rows = parallel::map(rows, &|row| {
            let mut largest = [0.0_f64; 3];
            grid.differences(storage, row, 0..grid.dims[0], |_, _, difference| {
                for (largest, difference) in largest.iter_mut().zip(difference) {
                    *largest = largest.max(difference.abs());
                }
            });
            largest
        });
        of_rows.into_iter().fold([0.0; 3], |a, b| [a[0].max(b[0]), a[1].max(b[1]), a[2].max(b[2])])
    })
}

/// As [`largest_differences`] of the volume in `cache`, given its source and dimensions, brick by brick.
fn largest_in_cache(
    storage: &Storage,
    cache: &BrickCache,
    (source, dims): (&str, [usize; 3]),
    progress: &dyn Progress,
) -> Result<[f64; 3], VolumeError> {
    let mut all = [0.0_f64; 3];
    for [first, end] in cache.boxes() {
        if progress.cancelled() {
            return Err(VolumeError::Cancelled { source_name: source.to_owned() });
        }
        // One voxel more on each side. Rows of these alone would have differences to one side.
        let low: [usize; 3] = first.map(|at| at.saturating_sub(1));
        let high: [usize; 3] = std::array::from_fn(|axis| (end[axis] + 1).min(dims[axis]));
        let part = cache.part(low, high)?;
        let own: [Range<usize>; 3] = std::array::from_fn(|axis| first[axis] - low[axis]..end[axis] - low[axis]);
        with_voxels!(&part.voxels, stored => {
            let grid = Grid { stored, dims: part.geometry.dims };
            for row in own[2].clone().flat_map(|z| own[1].clone().map(move |y| y + part.geometry.dims[1] * z)) {
                grid.differences(storage, row, own[0].clone(), |_, _, difference| {
                    for (largest, difference) in all.iter_mut().zip(difference) {
                        *largest = largest.max(difference.abs());
                    }
                });
            }
        });
    }
    Ok(all)
}

/// Returns the codes over the normalised range, and the loss in data units. If `span` is at most `full`, whole numbers
/// get a whole number of codes each and lose nothing; else the span is scaled to `full` codes and rounded.
fn whole_codes(full: f64, span: f64, slope: f64) -> (f64, f64) {
    let stride = (full / span).floor();
    if stride >= 1.0 { (stride * span, 0.0) } else { (full, 0.5 * span / full * slope.abs()) }
}

/// Rows of voxels in their own type.
struct Grid<'a, T> {
    stored: &'a [T],
    dims: [usize; 3],
}

impl<T: Voxel> Grid<'_, T> {
    /// Row `row` (y + ny·z).
    fn line(&self, row: usize) -> &[T] {
        &self.stored[row * self.dims[0]..(row + 1) * self.dims[0]]
    }

    /// Row `row`, and those before and behind it along y and along z, with whether their differences are one-sided.
    fn lines(&self, row: usize) -> ([&[T]; 5], [bool; 2]) {
        let [_, ny, nz] = self.dims;
        let (y, z) = (row % ny, row / ny);
        let ([y0, y1], [z0, z1]) = (neighbours(y, ny), neighbours(z, nz));
        let line = |y: usize, z: usize| self.line(y + ny * z);
        ([line(y, z), line(y0, z), line(y1, z), line(y, z0), line(y, z1)], [y1 - y0 == 1, z1 - z0 == 1])
    }

    /// Calls `with` for `xs` with x, the normalised value and the central differences v(i+1) − v(i−1) of normalised values along
    /// each axis; they are one-sided and doubled at the faces, and 0 along an axis of one voxel.
    fn differences(&self, storage: &Storage, row: usize, xs: Range<usize>, mut with: impl FnMut(usize, f64, [f64; 3])) {
        let nx = self.dims[0];
        let near = xs.start.saturating_sub(1)..(xs.end + 1).min(nx);
        let first = near.start;
        let (lines, one_sided) = self.lines(row);
        let normalised = |line: &[T]| -> Vec<f64> {
            line[near.clone()].iter().map(|value| storage.normalised(value.to_f64())).collect()
        };
        let factor = |one_sided: bool| if one_sided { 2.0 } else { 1.0 };
        let [here, below, above, behind, before] = lines.map(normalised);
        let [y_factor, z_factor] = one_sided.map(factor);
        for x in xs {
            let [x0, x1] = neighbours(x, nx);
            let x_factor = factor(x1 - x0 == 1);
            let (x, x0, x1) = (x - first, x0 - first, x1 - first);
            let difference = [
                (here[x1] - here[x0]) * x_factor,
                (above[x] - below[x]) * y_factor,
                (before[x] - behind[x]) * z_factor,
            ];
            with(x + first, here[x], difference);
        }
    }
}

/// Stored volume on the host, decoded as on the device; the reference renderer reads it.
#[derive(Clone, Debug)]
pub struct StoredVolume {
    /// Voxels along each axis.
    pub dims: [usize; 3],
    /// Values as decoded, x fastest.
    pub values: Vec<f32>,
    /// Differences along the axes as decoded, if they are stored with the values.
    pub gradients: Option<Vec<[f32; 3]>>,
}

impl StoredVolume {
    /// Encodes and decodes every texel of `volume` under `storage`.
    #[must_use]
    pub fn new(volume: &Volume, storage: &Storage) -> Self {
        Self::with_gradients(volume, storage, storage.format.has_gradient())
    }

    /// The values alone of every texel of `volume` under `storage`.
    #[must_use]
    pub fn of_values(volume: &Volume, storage: &Storage) -> Self {
        Self::with_gradients(volume, storage, false)
    }

    fn with_gradients(volume: &Volume, storage: &Storage, are_wanted: bool) -> Self {
        let dims = volume.geometry.dims;
        let slice = dims[0] * dims[1];
        let mut values = vec![0.0; slice * dims[2]];
        let mut gradients = are_wanted.then(|| vec![[0.0; 3]; values.len()]);
        let of_slices = gradients.iter_mut().flat_map(|all| all.chunks_mut(slice)).map(Some);
        let of_slices = of_slices.chain(std::iter::repeat_with(|| None));
        let mut slices: Vec<_> = values.chunks_mut(slice).zip(of_slices).collect();
        parallel::rows_mut(&mut slices, 1, &|z, slices| {
            let bytes = storage.slab(volume, z..z + 1);
            let snorm = |code: [u8; 2]| (f32::from(i16::from_ne_bytes(code)) / 32767.0).max(-1.0);
            let numbers: Vec<f32> = match storage.format {
                VolumeFormat::R16Unorm => {
                    bytes.as_chunks().0.iter().map(|&code| f32::from(u16::from_ne_bytes(code)) / 65535.0).collect()
                }
                VolumeFormat::Rgba16Snorm => bytes.as_chunks().0.iter().map(|&code| snorm(code)).collect(),
                VolumeFormat::R32Float | VolumeFormat::Rgba32Float => {
                    bytes.as_chunks().0.iter().map(|&bits| f32::from_ne_bytes(bits)).collect()
                }
            };
            for (values, gradients) in slices {
                let Some(gradients) = gradients else {
                    if storage.format.has_gradient() {
                        let texels = numbers.as_chunks().0.iter();
                        values.iter_mut().zip(texels).for_each(|(value, &[_, _, _, number])| *value = number);
                    } else {
                        values.copy_from_slice(&numbers);
                    }
                    continue;
                };
                let places = values.iter_mut().zip(gradients.iter_mut());
                for ((value, gradient), &[x, y, z, number]) in places.zip(numbers.as_chunks().0) {
                    (*value, *gradient) = (number, [x, y, z]);
                }
            }
        });
        Self { dims, values, gradients }
    }
}

/// Row of the label table for each voxel; row 0 follows the transfer function.
#[derive(Clone, Debug)]
pub struct LabelMap {
    /// Row number of each voxel, x fastest.
    pub rows: Vec<u16>,
    /// Labels in the data that the scene does not declare, with their numbers of voxels.
    pub undeclared: BTreeMap<i64, u64>,
    visible: Vec<bool>,
}

impl LabelMap {
    /// Maps `labels` to rows: the i-th declared label (from 0) has row i + 1. Negative labels, and label 0 unless it is declared,
    /// have none.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Layout`] for a voxel that is no whole number, or for more than [`MOST_LABELS`] declared labels.
    pub fn new(labels: &Labels) -> Result<Self, VolumeError> {
        let mut row_of = BTreeMap::new();
        for (i, entry) in labels.declared.iter().enumerate() {
            let row = u16::try_from(i + 1).map_err(|_| VolumeError::Layout {
                source_name: labels.volume.source.clone(),
                problem: format!("{} labels are declared; {MOST_LABELS} can be", labels.declared.len()),
            })?;
            row_of.insert(entry.label, row);
        }
        let mut undeclared = BTreeMap::new();
        let mut rows = Vec::with_capacity(labels.volume.voxels.len());
        labels.volume.each_run_of_labels(|label, length| {
            let row = row_of.get(&label).copied().unwrap_or_else(|| {
                if label > 0 {
                    *undeclared.entry(label).or_insert(0) += length as u64;
                }
                0
            });
            rows.resize(rows.len() + length, row);
        })?;
        let visible = std::iter::once(false).chain(labels.declared.iter().map(LabelEntry::is_visible)).collect();
        Ok(Self { rows, undeclared, visible })
    }

    /// The texels of `slices` of a map of `dims` voxels, and their size in bytes: rows; or, if labels are `smooth`, twice
    /// the row, plus 1 if the labels of this voxel and the next ones along the axes differ.
    #[must_use]
    pub fn texels(&self, dims: [usize; 3], slices: Range<usize>, smooth: bool) -> Vec<u8> {
        let [width, height, _] = dims;
        let bytes = self.texel_bytes(smooth);
        let of_line = |line: usize| self.line(dims, [line % height, line / height], 0..width, smooth);
        let first = slices.start * height;
        let lines = parallel::map(slices.len() * height, &|line| of_line(first + line));
        let mut texels = vec![0; lines.len() * width * bytes];
        for (line, out) in lines.iter().zip(texels.chunks_exact_mut((width * bytes).max(1))) {
            write_texels(line, bytes, out);
        }
        texels
    }

    /// The texels of [`Self::texels`] in a box of `edge` voxels along each axis that begins at `first`. Outside the map,
    /// the texels at its faces are repeated.
    #[must_use]
    pub fn texels_of_box(&self, dims: [usize; 3], first: [i64; 3], edge: usize, smooth: bool) -> Vec<u8> {
        let bytes = self.texel_bytes(smooth);
        texels_of_box(dims, first, edge, bytes, |y, z, xs, out| {
            write_texels(&self.line(dims, [y, z], xs, smooth), bytes, out);
        })
    }

    /// Texels of a part of a row of voxels.
    fn line(&self, dims: [usize; 3], [y, z]: [usize; 2], xs: Range<usize>, smooth: bool) -> Vec<u32> {
        let [width, height, depth] = dims;
        let row = |y: usize, z: usize| &self.rows[width * (y + height * z)..][..width];
        if !smooth {
            return row(y, z)[xs].iter().copied().map(u32::from).collect();
        }
        let around = [y, (y + 1).min(height - 1)].map(|y| [z, (z + 1).min(depth - 1)].map(|z| row(y, z)));
        let texel = |x: usize| {
            let (here, next) = (around[0][0][x], (x + 1).min(width - 1));
            let mixed = around.iter().flatten().any(|row| row[x] != here || row[next] != here);
            2 * u32::from(here) + u32::from(mixed)
        };
        xs.map(texel).collect()
    }

    /// Bytes of a texel of [`Self::texels`].
    #[must_use]
    pub fn texel_bytes(&self, smooth: bool) -> usize {
        // The first row is of no label.
        Self::bytes_of(self.visible.len() - 1, smooth)
    }

    /// [`Self::texel_bytes`] of a map with so many `declared` labels.
    #[must_use]
    pub fn bytes_of(declared: usize, smooth: bool) -> usize {
        let largest = if smooth { 2 * declared + 1 } else { declared };
        match largest {
            0..=0xff => 1,
            0x100..=0xffff => 2,
            _ => 4,
        }
    }

    /// True if voxel `i` has a declared label that shows anything.
    #[must_use]
    pub fn is_visible(&self, i: usize) -> bool {
        self.rows.get(i).and_then(|&row| self.visible.get(usize::from(row))).is_some_and(|&visible| visible)
    }
}

/// Writes the low bytes of `texels` to `out`.
fn write_texels(texels: &[u32], bytes: usize, out: &mut [u8]) {
    for (texel, out) in texels.iter().zip(out.chunks_exact_mut(bytes)) {
        match bytes {
            1 => out.copy_from_slice(&texel.to_le_bytes()[..1]),
            2 => out.copy_from_slice(&u16::try_from(*texel).unwrap_or(u16::MAX).to_ne_bytes()),
            _ => out.copy_from_slice(&texel.to_ne_bytes()),
        }
    }
}
