//! Colours of spectra: XYZ, linear sRGB, Lab and colour differences.
//!
//! Matrices act on columns: `xyz_from_linear_srgb * rgb`. The wavelength integral is the plain sum on the grid.

use std::sync::LazyLock;

use glam::{DMat3, DVec2, DVec3};

pub use super::matching::OBSERVER;
use super::{Light, Reflectance, Spectrum, standard};

/// CIE 1931 tristimulus values X, Y, Z; the perfect reflector under one [`Light`] has Y = 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Xyz(pub [f64; 3]);

/// Red, green and blue of IEC 61966-2-1 before its transfer function; (1, 1, 1) is its white. Values below 0 or above 1
/// are colours that a display cannot show.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinearSrgb(pub [f64; 3]);

/// CIE 1976 L*, a*, b*.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lab(pub [f64; 3]);

/// Colour of a reflectance under a light.
pub fn xyz(light: &Light, reflectance: &Reflectance) -> Xyz {
    xyz_of(&(light.spectrum() * reflectance.spectrum()))
}

/// Colour of a spectrum that reaches the eye: the sums of its products with [`OBSERVER`].
///
/// The colour of a light itself is `xyz_of(light.spectrum())`.
pub fn xyz_of(spectrum: &Spectrum) -> Xyz {
    Xyz(OBSERVER.each_ref().map(|matching| matching.dot(spectrum)))
}

/// White of D65 on the grid, at Y = 1.
pub fn d65_white() -> Xyz {
    static WHITE: LazyLock<Xyz> = LazyLock::new(|| xyz_of(standard::d65().spectrum()));
    *WHITE
}

/// Matrix from linear sRGB to XYZ: the primaries' chromaticities of IEC 61966-2-1, scaled so that their sum is D65's
/// white of ASTM E308, (0.95047, 1, 1.08883).
///
/// In linear sRGB, the white of D65 on the grid is within 1.2e-4 of (1, 1, 1).
pub static XYZ_FROM_LINEAR_SRGB: LazyLock<DMat3> = LazyLock::new(|| {
    let primary = |x: f64, y: f64| DVec3::new(x, y, 1.0 - x - y);
    let primaries = DMat3::from_cols(primary(0.64, 0.33), primary(0.30, 0.60), primary(0.15, 0.06));
    primaries * DMat3::from_diagonal(primaries.inverse() * DVec3::new(0.95047, 1.0, 1.08883))
});

/// Matrix from XYZ to linear sRGB, the inverse of [`XYZ_FROM_LINEAR_SRGB`].
pub static LINEAR_SRGB_FROM_XYZ: LazyLock<DMat3> = LazyLock::new(|| XYZ_FROM_LINEAR_SRGB.inverse());

/// Converts XYZ to linear sRGB, without adaptation or clipping.
pub fn linear_srgb_from_xyz(xyz: Xyz) -> LinearSrgb {
    LinearSrgb((*LINEAR_SRGB_FROM_XYZ * DVec3::from(xyz.0)).to_array())
}

/// Inverse of [`linear_srgb_from_xyz`].
pub fn xyz_from_linear_srgb(rgb: LinearSrgb) -> Xyz {
    Xyz((*XYZ_FROM_LINEAR_SRGB * DVec3::from(rgb.0)).to_array())
}

/// Transfer function of IEC 61966-2-1, from linear 0..=1 to display values 0..=1; it extends beyond both ends.
pub fn encode_srgb(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055f64.mul_add(linear.powf(1.0 / 2.4), -0.055) }
}

/// Inverse of [`encode_srgb`], to 3e-8 (the published constants leave a step of that size at the end of the linear
/// segment).
pub fn decode_srgb(encoded: f64) -> f64 {
    if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// Display code `#rrggbb` of a colour, clipped to the displayable range.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole numbers from 0 to 255")]
pub fn display_code(colour: LinearSrgb) -> String {
    let parts = colour.0.map(|part| (255.0 * encode_srgb(part.clamp(0.0, 1.0))).round());
    format!("#{:02x}{:02x}{:02x}", parts[0] as u8, parts[1] as u8, parts[2] as u8)
}

/// Whether a display can show the colour, to half a step of 8 bits.
pub fn is_displayable(colour: LinearSrgb) -> bool {
    colour.0.iter().all(|&part| (-0.5..=255.5).contains(&(255.0 * encode_srgb(part))))
}

/// L*a*b* relative to `white`, usually [`d65_white`].
///
/// Components at or below (6/29)³ of the white's, including negative ones, take the linear branch.
pub fn lab_from_xyz(xyz: Xyz, white: Xyz) -> Lab {
    const KNEE: f64 = 6.0 / 29.0;
    let compress = |t: f64| if t > KNEE.powi(3) { t.cbrt() } else { t / (3.0 * KNEE * KNEE) + 4.0 / 29.0 };
    let [x, y, z] = std::array::from_fn(|axis| compress(xyz.0[axis] / white.0[axis]));
    Lab([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)])
}

/// Inverse of [`lab_from_xyz`].
pub fn xyz_from_lab(lab: Lab, white: Xyz) -> Xyz {
    const KNEE: f64 = 6.0 / 29.0;
    let expand = |f: f64| if f > KNEE { f.powi(3) } else { 3.0 * KNEE * KNEE * (f - 4.0 / 29.0) };
    let [l, a, b] = lab.0;
    let y = (l + 16.0) / 116.0;
    let parts = [y + a / 500.0, y, y - b / 200.0].map(expand);
    Xyz(std::array::from_fn(|axis| parts[axis] * white.0[axis]))
}

/// Colour difference ΔE00 (CIEDE2000, kL = kC = kH = 1), in the formulation and notation of Sharma, Wu and Dalal 2005.
/// NaN for colours that are not finite, or too far from white to compute with (a chroma above 1e44).
pub fn ciede2000(one: Lab, two: Lab) -> f64 {
    const POW25_7: f64 = 6_103_515_625.0;
    let [l1, a1, b1] = one.0;
    let [l2, a2, b2] = two.0;
    let saturation = |c: f64| (c.powi(7) / (c.powi(7) + POW25_7)).sqrt();
    // Not hypot and rem_euclid, which took a fifth of the time: chromas far from 1 need no care.
    let chroma = |a: f64, b: f64| DVec2::new(a, b).length();
    let g = 0.5 * (1.0 - saturation(f64::midpoint(chroma(a1, b1), chroma(a2, b2))));
    let (a1, a2) = ((1.0 + g) * a1, (1.0 + g) * a2);
    let (c1, c2) = (chroma(a1, b1), chroma(a2, b2));
    let hue = |a: f64, b: f64| match b.atan2(a).to_degrees() {
        below if below < 0.0 => below + 360.0,
        above => above,
    };
    let (h1, h2) = (hue(a1, b1), hue(a2, b2));
    let achromatic = c1 * c2 <= 0.0;
    let dh = match h2 - h1 {
        _ if achromatic => 0.0,
        d if d > 180.0 => d - 360.0,
        d if d < -180.0 => d + 360.0,
        d => d,
    };
    let (dl, dc) = (l2 - l1, c2 - c1);
    let dh = 2.0 * (c1 * c2).sqrt() * (dh / 2.0).to_radians().sin();

    let l = f64::midpoint(l1, l2);
    let c = f64::midpoint(c1, c2);
    let h = match h1 + h2 {
        sum if achromatic => sum,
        sum if (h1 - h2).abs() <= 180.0 => sum / 2.0,
        sum if sum < 360.0 => f64::midpoint(sum, 360.0),
        sum => (sum - 360.0) / 2.0,
    };
    // T = 1 − 0.17 cos(h − 30°) + 0.24 cos 2h + 0.32 cos(3h + 6°) − 0.20 cos(4h − 63°), by powers of e^(ih).
    let once = DVec2::from_angle(h.to_radians());
    let twice = once.rotate(once);
    let along = |degrees: f64, power: DVec2| DVec2::from_angle(degrees.to_radians()).dot(power);
    let t = 1.0 - 0.17 * along(30.0, once) + 0.24 * twice.x + 0.32 * along(-6.0, twice.rotate(once))
        - 0.20 * along(63.0, twice.rotate(twice));
    let sl = 1.0 + 0.015 * (l - 50.0).powi(2) / (20.0 + (l - 50.0).powi(2)).sqrt();
    let sc = 1.0 + 0.045 * c;
    let sh = 1.0 + 0.015 * c * t;
    let rotation = (60.0 * (-((h - 275.0) / 25.0).powi(2)).exp()).to_radians().sin();
    let (l, c, h) = (dl / sl, dc / sc, dh / sh);
    let square = l * l + c * c + h * h - 2.0 * saturation(f64::midpoint(c1, c2)) * rotation * c * h;
    // Rounding below zero gives zero; NaN stays NaN.
    if square < 0.0 { 0.0 } else { square.sqrt() }
}

/// Cone responses of the Bradford adaptation from XYZ.
const CONES_FROM_XYZ: DMat3 = DMat3::from_cols_array(&[
    // Lam 1985, as in the ICC profile format; listed by columns.
    0.8951, -0.7502, 0.0389, //
    0.2664, 1.7135, -0.0685, //
    -0.1614, 0.0367, 1.0296,
]);

/// Matrix from XYZ to the cone responses of [`bradford`].
#[must_use]
pub const fn bradford_cones() -> DMat3 {
    CONES_FROM_XYZ
}

/// Matrix of the Bradford adaptation on XYZ from `from_white` to `to_white`.
///
/// Both whites must have positive cone responses, like the whites of real lights; otherwise the matrix is not finite.
pub fn bradford(from_white: Xyz, to_white: Xyz) -> DMat3 {
    let cones = |white: Xyz| CONES_FROM_XYZ * DVec3::from(white.0);
    CONES_FROM_XYZ.inverse() * DMat3::from_diagonal(cones(to_white) / cones(from_white)) * CONES_FROM_XYZ
}
