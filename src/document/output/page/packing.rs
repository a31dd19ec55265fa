//! Numbers of a film as whole numbers, predicted from their neighbours and deflated, and back (docs/theory/page.md).

use std::io::{self, Read};

use flate2::read::DeflateDecoder;
use nalgebra::{DMatrix, SymmetricEigen};
use rayon::prelude::*;
use zlib_rs::{DeflateConfig, ReturnCode, Strategy, compress_bound, compress_slice};

use super::lights::Lights;
use relume_base::number::{nearest, rounded};
use relume_scene::film::{Components, Film};

/// Largest code of a channel: two bytes.
const LARGEST_CODE: i32 = 65_535;

/// Pixels that a core works on at a time.
pub(super) const BLOCK: usize = 1 << 10;

/// Largest code of a channel of one byte.
const LARGEST_NARROW: i32 = 255;

/// Channels of the films of a page: their brightness, their rotations and their ranges. Independent of the step.
pub(super) struct Channels {
    /// Square root of the largest linear RGB that a unit of the plane makes under any light of the page.
    pub(super) gains: Vec<f64>,
    /// Groups of planes that are rotated.
    pub(super) groups: Vec<Group>,
    /// Smallest and largest rotated root of each channel in all views.
    ranges: Vec<[f32; 2]>,
}

/// Planes whose roots are rotated together.
pub(super) struct Group {
    /// The first of them.
    pub(super) first: usize,
    /// Orthogonal matrix; row `i` makes channel `first + i` of the roots of the planes.
    pub(super) rows: Vec<Vec<f32>>,
}

/// Storage of the numbers of a channel at a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Channel {
    /// Code of the root 0.
    pub(super) zero: i32,
    /// Whether codes have two bytes.
    pub(super) wide: bool,
    /// Whether all codes of all views are 0; nothing is stored then.
    pub(super) empty: bool,
}

/// Codes of a view: for every channel, one per pixel.
pub(super) type Codes = Vec<Vec<u16>>;

/// Planes of `film` that a page keeps.
pub(super) fn planes<'a>(film: &'a Film<f32>, lights: &Lights) -> Vec<&'a [f32]> {
    let pixels = film.pixels().max(1);
    let all = film.accumulators.chunks_exact(pixels).chain(film.transmittance.chunks_exact(pixels));
    all.take(lights.planes()).collect()
}

/// Signed square root.
fn root(value: f64) -> f64 {
    value.abs().sqrt().copysign(value)
}

/// Inverse of [`root`].
fn square(root: f64) -> f64 {
    root * root.abs()
}

impl Channels {
    /// The channels of `films` under `lights`; `gains` are the square roots of the brightness of each plane.
    pub(super) fn new(films: &[Film<f32>], lights: &Lights, gains: Vec<f64>) -> Self {
        let mut channels = Self { gains, groups: Vec::new(), ranges: Vec::new() };
        if let Components::Model(model, _) = &lights.observed[0].components {
            let k = model.dimension();
            let first = (0..lights.planes()).step_by(k.max(1)).filter(|first| first + k <= lights.planes());
            channels.groups = first.map(|first| channels.group(films, lights, first, k)).collect();
        }
        let wider = |mut ranges: Vec<[f32; 2]>, others: Vec<[f32; 2]>| {
            for ([least, most], [lower, higher]) in ranges.iter_mut().zip(others) {
                (*least, *most) = (least.min(lower), most.max(higher));
            }
            ranges
        };
        let range = |channel: &Vec<f32>| {
            channel.iter().fold([0.0_f32; 2], |[least, most], &root| [least.min(root), most.max(root)])
        };
        let none = || vec![[0.0; 2]; lights.planes()];
        channels.ranges = films.iter().fold(none(), |ranges, film| {
            let of_block = |block: Vec<&[f32]>| channels.turned(&block).iter().map(range).collect();
            wider(ranges, blocks(&planes(film, lights)).map(of_block).reduce(none, wider))
        });
        channels
    }

    /// The rotation of `k` planes from `first` that leaves their roots uncorrelated: eigenvectors of their second moments.
    fn group(&self, films: &[Film<f32>], lights: &Lights, first: usize, k: usize) -> Group {
        // Some ten thousand pixels of all views determine k² moments.
        const PIXELS: usize = 1 << 14;
        let all: usize = films.iter().map(Film::pixels).sum();
        let stride = (all / PIXELS).max(1);
        let mut moments = DMatrix::<f64>::zeros(k, k);
        for film in films {
            let planes = planes(film, lights);
            for pixel in (0..film.pixels()).step_by(stride) {
                let roots: Vec<f64> = (first..first + k).map(|plane| self.root(plane, planes[plane][pixel])).collect();
                for row in 0..k {
                    for column in 0..k {
                        moments[(row, column)] += roots[row] * roots[column];
                    }
                }
            }
        }
        let eigen = SymmetricEigen::new(moments);
        let mut order: Vec<usize> = (0..k).collect();
        order.sort_by(|&one, &two| eigen.eigenvalues[two].total_cmp(&eigen.eigenvalues[one]));
        let row = |&column: &usize| {
            let vector = eigen.eigenvectors.column(column);
            // The sign that makes most roots positive, whatever the solver returned.
            let sign = if vector.sum() < 0.0 { -1.0 } else { 1.0 };
            vector.iter().map(|&part| rounded(sign * part)).collect()
        };
        Group { first, rows: order.iter().map(row).collect() }
    }

    fn root(&self, plane: usize, value: f32) -> f64 {
        root(f64::from(value)) * self.gains[plane]
    }

    /// Rotated roots of a part of the planes of a view.
    fn turned(&self, planes: &[&[f32]]) -> Vec<Vec<f32>> {
        let mut turned = Vec::with_capacity(planes.len());
        while let Some(plane) = planes.get(turned.len()) {
            let index = turned.len();
            let Some(group) = self.group_of(index) else {
                turned.push(plane.iter().map(|&value| rounded(self.root(index, value))).collect());
                continue;
            };
            let of_group = (index..index + group.rows.len()).zip(&planes[index..]);
            let roots: Vec<Vec<f64>> =
                of_group.map(|(index, plane)| plane.iter().map(|&value| self.root(index, value)).collect()).collect();
            for row in &group.rows {
                turned.push(weighted(row.iter().copied().zip(&roots), plane.len()).into_iter().map(rounded).collect());
            }
        }
        turned
    }

    fn group_of(&self, channel: usize) -> Option<&Group> {
        self.groups.iter().find(|group| (group.first..group.first + group.rows.len()).contains(&channel))
    }

    /// Storage of each channel with `step` codes per unit of a root; `None` if two bytes are too few.
    pub(super) fn at(&self, step: f64) -> Option<Vec<Channel>> {
        let channel = |&[least, most]: &[f32; 2]| {
            let [least, most] = [least, most].map(|root| nearest(f64::from(root) * step));
            let span = most.checked_sub(least).filter(|&span| span <= LARGEST_CODE)?;
            Some(Channel { zero: 0_i32.checked_sub(least)?, wide: span > LARGEST_NARROW, empty: false })
        };
        self.ranges.iter().map(channel).collect()
    }

    /// `step`, or a coarser one for which two bytes are enough.
    pub(super) fn finest(&self, step: f64) -> f64 {
        let halved = std::iter::successors(Some(step), |step| Some(step / 2.0));
        halved.take_while(|step| *step > 0.0).find(|step| self.at(*step).is_some()).unwrap_or(step)
    }

    /// Codes of a part of the planes of a view. `kept` is the result of [`Self::at`] for `step`.
    pub(super) fn codes(&self, planes: &[&[f32]], kept: &[Channel], step: f64) -> Codes {
        let code = |root: f32, zero: i32| {
            u16::try_from(nearest(f64::from(root) * step).saturating_add(zero).clamp(0, LARGEST_CODE)).unwrap_or(0)
        };
        let turned = self.turned(planes).into_iter().zip(kept);
        turned.map(|(channel, kept)| channel.into_iter().map(|root| code(root, kept.zero)).collect()).collect()
    }

    /// Codes of all planes of a view.
    pub(super) fn all_codes(&self, planes: &[&[f32]], kept: &[Channel], step: f64) -> Codes {
        let parts: Vec<Codes> = blocks(planes).map(|block| self.codes(&block, kept, step)).collect();
        (0..planes.len()).map(|channel| parts.iter().flat_map(|part| part[channel].iter().copied()).collect()).collect()
    }

    /// The numbers that `codes` stand for.
    pub(super) fn values(&self, codes: &Codes, kept: &[Channel], step: f64) -> Vec<Vec<f32>> {
        let roots = |channel: usize| -> Vec<f64> {
            codes[channel].iter().map(|&code| f64::from(i32::from(code) - kept[channel].zero)).collect()
        };
        let value = |index: usize, root: f64| rounded(square(root) * scale(self.gains[index], step));
        let mut values = Vec::with_capacity(codes.len());
        while values.len() < codes.len() {
            let index = values.len();
            let Some(group) = self.group_of(index) else {
                values.push(roots(index).into_iter().map(|root| value(index, root)).collect());
                continue;
            };
            let turned: Vec<Vec<f64>> = (index..index + group.rows.len()).map(roots).collect();
            for column in 0..group.rows.len() {
                let parts = group.rows.iter().map(|row| row[column]).zip(&turned);
                let back = weighted(parts, codes[index].len());
                values.push(back.into_iter().map(|root| value(index + column, root)).collect());
            }
        }
        values
    }
}

/// Sums of lists of `count` numbers, each with its weight.
fn weighted<'a>(parts: impl Iterator<Item = (f32, &'a Vec<f64>)>, count: usize) -> Vec<f64> {
    let mut sums = vec![0.0_f64; count];
    for (weight, numbers) in parts {
        for (sum, &number) in sums.iter_mut().zip(numbers) {
            *sum += f64::from(weight) * number;
        }
    }
    sums
}

/// Parts of the planes of a view, which a core works on at a time.
pub(super) fn blocks<'a>(planes: &[&'a [f32]]) -> impl IndexedParallelIterator<Item = Vec<&'a [f32]>> + use<'a> {
    let (planes, pixels) = (planes.to_vec(), planes.first().map_or(0, |plane| plane.len()));
    let part = move |block: usize| {
        planes.iter().map(|plane| &plane[block * BLOCK..((block + 1) * BLOCK).min(pixels)]).collect()
    };
    (0..pixels.div_ceil(BLOCK)).into_par_iter().map(part)
}

/// Factor from the signed square of a code to the number of a plane of this gain.
pub(super) fn scale(gain: f64, step: f64) -> f64 {
    let unit = step * gain;
    if unit > 0.0 { (unit * unit).recip() } else { 0.0 }
}

/// The prediction of a code from the ones to its left, above it, and above to the left (MED, as in JPEG-LS).
fn predicted(left: i32, above: i32, corner: i32) -> i32 {
    if corner >= left.max(above) {
        left.min(above)
    } else if corner <= left.min(above) {
        left.max(above)
    } else {
        left + above - corner
    }
}

/// The prediction of pixel `at` of a plane of this width.
fn prediction(plane: &[u16], width: usize, at: usize) -> i32 {
    let code = |at: usize| i32::from(plane[at]);
    match (at % width, at / width) {
        (0, 0) => 0,
        (_, 0) => code(at - 1),
        (0, _) => code(at - width),
        _ => predicted(code(at - 1), code(at - width), code(at - width - 1)),
    }
}

/// Residuals of a view: a byte for every pixel of every channel, 255 for large ones of wide channels, and those.
pub(super) struct Residuals {
    bytes: Vec<Vec<u8>>,
    large: Vec<Vec<u16>>,
}

/// Byte of a wide channel in place of a residual of at least as much.
const LARGE: u16 = 255;

impl Residuals {
    /// Residuals of codes in rows of `width`. Those of wide channels are modulo 65,536, with the sign in the lowest bit.
    pub(super) fn new(codes: &Codes, kept: &[Channel], width: usize) -> Self {
        let of = |(plane, kept): (&Vec<u16>, &Channel)| -> (Vec<u8>, Vec<u16>) {
            let residual = |at: usize| i32::from(plane[at]) - prediction(plane, width, at);
            let low = |residual: i32| residual.to_le_bytes()[0];
            if !kept.wide {
                return ((0..plane.len()).map(|at| low(residual(at))).collect(), Vec::new());
            }
            let mut large = Vec::new();
            let byte = |at| {
                let [low, high, ..] = residual(at).to_le_bytes();
                let wrapped = i16::from_le_bytes([low, high]);
                let folded = u16::from_le_bytes((wrapped.wrapping_shl(1) ^ (wrapped >> 15)).to_le_bytes());
                if folded >= LARGE {
                    large.push(folded);
                }
                folded.min(LARGE).to_le_bytes()[0]
            };
            ((0..plane.len()).map(byte).collect(), large)
        };
        let (bytes, large) = codes.par_iter().zip(kept).map(of).unzip();
        Self { bytes, large }
    }

    /// Whether all residuals of a channel are 0.
    pub(super) fn is_empty(&self, channel: usize) -> bool {
        self.bytes[channel].iter().all(|&byte| byte == 0)
    }

    /// Number of large residuals.
    pub(super) fn large(&self) -> usize {
        self.large.iter().map(Vec::len).sum()
    }

    /// All channels that are not empty, then the large residuals, deflated.
    ///
    /// Residuals are noise with runs of zeros: matches other than runs cost more bytes than they save, and most of the time.
    pub(super) fn packed(&self, kept: &[Channel]) -> io::Result<Vec<u8>> {
        let stored = self.bytes.iter().zip(kept).filter(|(_, kept)| !kept.empty);
        let mut bytes: Vec<u8> = stored.flat_map(|(bytes, _)| bytes).copied().collect();
        bytes.extend(self.large.iter().flatten().flat_map(|residual| residual.to_le_bytes()));
        let config =
            DeflateConfig { window_bits: -15, mem_level: 9, strategy: Strategy::Rle, ..DeflateConfig::default() };
        let mut deflated = vec![0; compress_bound(bytes.len())];
        match compress_slice(&mut deflated, &bytes, config) {
            (written, ReturnCode::Ok) => Ok(written.to_vec()),
            (_, refused) => Err(io::Error::other(format!("deflate: {refused:?}"))),
        }
    }
}

/// Codes of a view of this size, from what [`Residuals::packed`] returned for it and its number of large residuals.
///
/// # Errors
///
/// An error if the stream is damaged, shorter or longer.
pub(super) fn unpacked(bytes: &[u8], kept: &[Channel], large: usize, [width, height]: [usize; 2]) -> io::Result<Codes> {
    let pixels = width * height;
    let stored = kept.iter().filter(|channel| !channel.empty).count() * pixels;
    let expected = stored + 2 * large;
    let mut all = Vec::with_capacity(expected);
    let limit = u64::try_from(expected).unwrap_or(u64::MAX).saturating_add(1);
    DeflateDecoder::new(bytes).take(limit).read_to_end(&mut all)?;
    if all.len() != expected {
        return Err(io::Error::other(format!("the planes have {} bytes, not {expected}", all.len())));
    }
    let (bytes, large) = all.split_at(stored);
    let mut bytes = bytes.chunks_exact(pixels.max(1));
    let mut large = large.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]]));
    // Large residuals are in the order of channels.
    let mut parts: Vec<(&[u8], Vec<u16>)> = Vec::with_capacity(kept.len());
    for kept in kept {
        let low = if kept.empty { None } else { bytes.next() };
        let low = low.unwrap_or(&[]);
        let count = if kept.wide { low.iter().filter(|&&byte| u16::from(byte) == LARGE).count() } else { 0 };
        parts.push((low, large.by_ref().take(count).collect()));
    }
    let plane = |((low, large), kept): (&(&[u8], Vec<u16>), &Channel)| {
        let (mut plane, mut large) = (vec![0_u16; pixels], large.iter());
        for (at, &byte) in low.iter().enumerate() {
            let predicted = prediction(&plane, width, at);
            plane[at] = if kept.wide {
                let folded = u16::from(byte);
                let folded = if folded == LARGE { large.next().copied().unwrap_or(LARGE) } else { folded };
                let residual = (folded >> 1) ^ (folded & 1).wrapping_neg();
                let [low, high, ..] = predicted.to_le_bytes();
                u16::from_le_bytes([low, high]).wrapping_add(residual)
            } else {
                u16::from(u8::from_le_bytes([predicted.to_le_bytes()[0]]).wrapping_add(byte))
            };
        }
        plane
    };
    Ok(parts.par_iter().zip(kept).map(plane).collect())
}
