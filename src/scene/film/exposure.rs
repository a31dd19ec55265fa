//! Exposure from a picture, and the curve that displays colours near white (docs/theory/tone.md).

use glam::DVec3;

use super::Relightable;
use crate::{BRIGHTENED, Backdrop, Display, LARGEST_EXPOSURE, Mix, Tone};
use relume_base::number::{count, rounded, whole};
use relume_colour::spectrum::colour::decode_srgb;

/// Displayed luminance of the brighter pixels.
const BRIGHT: f64 = 0.72;
/// Part of the object, by its opacity, that is darker than the brighter pixels.
const DARKER: f64 = 0.97;
/// Bins of an octave of luminance: pixels that differ by rounding alone are in the same bin, but for few.
const OF_OCTAVE: f64 = 64.0;
/// Octaves of luminance, from 2⁻⁶⁴.
const OCTAVES: f64 = 128.0;
/// Luminances of the primaries of sRGB (IEC 61966-2-1).
const LUMINANCES: DVec3 = DVec3::new(0.2126, 0.7152, 0.0722);

/// Exposure of a picture of linear RGBA at exposure 1, under `mix`: that at which 97 % of the object, by its opacity, are darker
/// than luminance 0.72, with a resolution of 1/64 stop. It is at most [`BRIGHTENED`] times the exposure at which a white surface
/// is white, and 1 for a picture without light.
#[must_use]
pub fn automatic_exposure(picture: &[f32], mix: &Mix, display: &Display) -> f64 {
    let bins = whole(OCTAVES * OF_OCTAVE);
    let mut weights = vec![0.0; bins];
    for &[red, green, blue, opacity] in picture.as_chunks::<4>().0 {
        let luminance = LUMINANCES.dot(DVec3::new(red.into(), green.into(), blue.into()));
        if luminance > 0.0 && luminance.is_finite() && opacity > 0.0 {
            let bin = ((luminance.log2() + OCTAVES / 2.0) * OF_OCTAVE).clamp(0.0, count(bins - 1));
            weights[whole(bin.floor())] += f64::from(opacity.min(1.0));
        }
    }
    let all: f64 = weights.iter().sum();
    let white = Relightable::white_under(mix, display);
    if !(all > 0.0 && white > 0.0) {
        return 1.0;
    }
    let mut below = 0.0;
    let bright = weights.iter().position(|weight| {
        below += weight;
        below >= DARKER * all
    });
    let luminance = (count(bright.unwrap_or_default()) / OF_OCTAVE - OCTAVES / 2.0).exp2();
    let exposure = (BRIGHT / luminance).min(BRIGHTENED / white).min(LARGEST_EXPOSURE);
    // Three digits, as a person would state it.
    let digit = 10.0_f64.powf(2.0 - exposure.log10().floor());
    (exposure * digit).round() / digit
}

impl Backdrop {
    /// Colours at the top and at the bottom of the screen, as parts of the codes of sRGB.
    #[must_use]
    pub fn colours(self) -> Option<[[f64; 3]; 2]> {
        let of_codes = |codes: [u8; 3]| codes.map(|code| f64::from(code) / 255.0);
        match self {
            Self::None => None,
            Self::Dark => Some([[0x2a, 0x2f, 0x38], [0x0c, 0x0d, 0x10]].map(of_codes)),
        }
    }

    /// Square roots of the linear colours: between top and bottom they change evenly, as they look evenly graded.
    #[must_use]
    pub fn roots(colours: [[f64; 3]; 2]) -> [DVec3; 2] {
        colours.map(|codes| DVec3::from_array(codes.map(|code| decode_srgb(code).sqrt())))
    }

    /// Puts these colours, as [`Self::colours`] has them, behind linear RGBA, `width` pixels wide.
    pub fn behind(colours: [[f64; 3]; 2], rgba: &mut [f32], width: usize) {
        let [top, bottom] = Self::roots(colours);
        let rows = rgba.as_chunks_mut::<4>().0.chunks_mut(width.max(1));
        let last = count(rows.len().max(2) - 1);
        for (y, row) in rows.enumerate() {
            let root = top.lerp(bottom, count(y) / last);
            for pixel in row {
                let clear = 1.0 - f64::from(pixel[3]);
                for (part, root) in pixel.iter_mut().zip(root.to_array()) {
                    *part = rounded(clear.mul_add(root * root, f64::from(*part)));
                }
                pixel[3] = 1.0;
            }
        }
    }
}

impl Tone {
    /// Displayed luminance from which the soft curve compresses.
    pub const KNEE: f64 = 0.75;
    /// Largest component that the curve tells apart, so that its quotients are finite in f32.
    pub const BRIGHTEST: f64 = 1e30;

    /// Displays linear RGBA in place: opacity and ratios of colours stay.
    pub fn show(self, picture: &mut [f32]) {
        if self == Self::Linear {
            return;
        }
        for [red, green, blue, _] in picture.as_chunks_mut::<4>().0 {
            let factor: f32 = rounded(self.factor(f64::from(red.max(*green).max(*blue))));
            for part in [red, green, blue] {
                *part *= factor;
            }
        }
    }

    /// Displayed linear sRGB of `colour`.
    #[must_use]
    pub fn shown(self, colour: DVec3) -> DVec3 {
        colour * self.factor(colour.max_element())
    }

    /// Factor of a colour whose largest component is `most`.
    fn factor(self, most: f64) -> f64 {
        if self == Self::Linear || most <= Self::KNEE || most.is_nan() {
            return 1.0;
        }
        let (most, rest) = (most.min(Self::BRIGHTEST), 1.0 - Self::KNEE);
        let over = most - Self::KNEE;
        rest.mul_add(over / (over + rest), Self::KNEE) / most
    }
}
