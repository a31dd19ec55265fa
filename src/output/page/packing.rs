//! Numbers of a film as whole numbers, predicted from their neighbours and deflated, and back (docs/theory/page.md).

use std::io::{self, Read, Write};

use flate2::Compression;
use flate2::read::DeflateDecoder;
use flate2::write::DeflateEncoder;
use nalgebra::{DMatrix, SymmetricEigen};
use rayon::prelude::*;

use super::lights::Lights;
use crate::film::{Components, Film};
use crate::number::{nearest, rounded};

/// Largest code of a channel: two bytes.
const LARGEST_CODE: i32 = 65_535;

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
        if let Components::Model(model, _) = &lights.components[0] {
            let k = model.dimension();
            let first = (0..lights.planes()).step_by(k.max(1)).filter(|first| first + k <= lights.planes());
            channels.groups = first.map(|first| channels.group(films, lights, first, k)).collect();
        }
        channels.ranges = vec![[0.0; 2]; lights.planes()];
        for film in films {
            let turned = channels.turned(&planes(film, lights));
            for (range, channel) in channels.ranges.iter_mut().zip(&turned) {
                *range = channel.iter().fold(*range, |[least, most], &root| [least.min(root), most.max(root)]);
            }
        }
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

    /// Rotated roots of the planes of a view.
    fn turned(&self, planes: &[&[f32]]) -> Vec<Vec<f32>> {
        let channel = |(index, plane): (usize, &&[f32])| match self.group_of(index) {
            None => plane.iter().map(|&value| rounded(self.root(index, value))).collect(),
            Some(group) => {
                let row = &group.rows[index - group.first];
                let mut sums = vec![0.0_f64; plane.len()];
                for (part, &weight) in row.iter().enumerate() {
                    for (sum, &value) in sums.iter_mut().zip(planes[group.first + part]) {
                        *sum += f64::from(weight) * self.root(group.first + part, value);
                    }
                }
                sums.into_iter().map(rounded).collect()
            }
        };
        planes.par_iter().enumerate().map(channel).collect()
    }

    fn group_of(&self, channel: usize) -> Option<&Group> {
        self.groups.iter().find(|group| (group.first..group.first + group.rows.len()).contains(&channel))
    }

    /// Storage of each channel with `step` codes per unit of a root; `None` if two bytes are too few.
    pub(super) fn at(&self, step: f64) -> Option<Vec<Channel>> {
        let channel = |&[least, most]: &[f32; 2]| {
            let [least, most] = [least, most].map(|root| nearest(f64::from(root) * step));
            let span = most.checked_sub(least).filter(|&span| span <= LARGEST_CODE)?;
            Some(Channel { zero: 0_i32.checked_sub(least)?, wide: span > LARGEST_NARROW })
        };
        self.ranges.iter().map(channel).collect()
    }

    /// Codes of the planes of a view. `kept` is the result of [`Self::at`] for `step`.
    pub(super) fn codes(&self, planes: &[&[f32]], kept: &[Channel], step: f64) -> Codes {
        let turned = self.turned(planes);
        let code = |root: f32, zero: i32| {
            u16::try_from(nearest(f64::from(root) * step).saturating_add(zero).clamp(0, LARGEST_CODE)).unwrap_or(0)
        };
        turned
            .par_iter()
            .zip(kept)
            .map(|(channel, kept)| channel.iter().map(|&root| code(root, kept.zero)).collect())
            .collect()
    }

    /// The numbers that `codes` stand for.
    pub(super) fn values(&self, codes: &Codes, kept: &[Channel], step: f64) -> Vec<Vec<f32>> {
        let root_of = |channel: usize, pixel: usize| f64::from(i32::from(codes[channel][pixel]) - kept[channel].zero);
        let pixels = codes.first().map_or(0, Vec::len);
        let plane = |index: usize| -> Vec<f32> {
            let scale = scale(self.gains[index], step);
            let of_root = |root: f64| rounded(square(root) * scale);
            match self.group_of(index) {
                None => (0..pixels).map(|pixel| of_root(root_of(index, pixel))).collect(),
                Some(group) => {
                    let column = index - group.first;
                    let mut sums = vec![0.0_f64; pixels];
                    for (part, row) in group.rows.iter().enumerate() {
                        for (pixel, sum) in sums.iter_mut().enumerate() {
                            *sum += f64::from(row[column]) * root_of(group.first + part, pixel);
                        }
                    }
                    sums.into_iter().map(of_root).collect()
                }
            }
        };
        (0..codes.len()).into_par_iter().map(plane).collect()
    }
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

/// Packs codes of rows of `width`: residuals, the low bytes of all channels first, deflated.
pub(super) fn packed(codes: &Codes, kept: &[Channel], width: usize) -> io::Result<Vec<u8>> {
    let residuals: Vec<[Vec<u8>; 2]> =
        codes.par_iter().zip(kept).map(|(plane, kept)| residuals(plane, *kept, width)).collect();
    let mut encoder = DeflateEncoder::new(Vec::new(), Compression::best());
    for byte in 0..2 {
        for plane in &residuals {
            encoder.write_all(&plane[byte])?;
        }
    }
    encoder.finish()
}

/// Low and high bytes of the residuals of a plane.
fn residuals(plane: &[u16], kept: Channel, width: usize) -> [Vec<u8>; 2] {
    let residual = |at: usize| i32::from(plane[at]) - prediction(plane, width, at);
    if !kept.wide {
        let low = |at| residual(at).to_le_bytes()[0];
        return [(0..plane.len()).map(low).collect(), Vec::new()];
    }
    // Modulo 65,536, with the sign in the lowest bit.
    let folded = |at| {
        let [low, high, ..] = residual(at).to_le_bytes();
        let wrapped = i16::from_le_bytes([low, high]);
        (wrapped.wrapping_shl(1) ^ (wrapped >> 15)).to_le_bytes()
    };
    let all: Vec<[u8; 2]> = (0..plane.len()).map(folded).collect();
    [all.iter().map(|bytes| bytes[0]).collect(), all.iter().map(|bytes| bytes[1]).collect()]
}

/// Unpacks what [`packed`] returned for `pixels` codes a channel.
///
/// # Errors
///
/// An error if the stream is damaged, shorter or longer.
pub(super) fn unpacked(bytes: &[u8], kept: &[Channel], width: usize, pixels: usize) -> io::Result<Codes> {
    let wide = kept.iter().filter(|channel| channel.wide).count();
    let expected = (kept.len() + wide) * pixels;
    let mut all = Vec::with_capacity(expected);
    let limit = u64::try_from(expected).unwrap_or(u64::MAX).saturating_add(1);
    DeflateDecoder::new(bytes).take(limit).read_to_end(&mut all)?;
    if all.len() != expected {
        return Err(io::Error::other(format!("the planes have {} bytes, not {expected}", all.len())));
    }
    let (low, high) = all.split_at(kept.len() * pixels);
    let mut high = high.chunks_exact(pixels.max(1));
    let parts: Vec<(&[u8], Option<&[u8]>)> = (low.chunks_exact(pixels.max(1)).zip(kept))
        .map(|(low, kept)| (low, if kept.wide { high.next() } else { None }))
        .collect();
    let plane = |&(low, high): &(&[u8], Option<&[u8]>)| {
        let mut plane = vec![0_u16; pixels];
        for at in 0..pixels {
            let predicted = prediction(&plane, width, at);
            plane[at] = match high {
                None => u16::from(u8::from_le_bytes([predicted.to_le_bytes()[0]]).wrapping_add(low[at])),
                Some(high) => {
                    let folded = u16::from_le_bytes([low[at], high[at]]);
                    let residual = (folded >> 1) ^ (folded & 1).wrapping_neg();
                    let [low, high, ..] = predicted.to_le_bytes();
                    u16::from_le_bytes([low, high]).wrapping_add(residual)
                }
            };
        }
        plane
    };
    Ok(parts.par_iter().map(plane).collect())
}
