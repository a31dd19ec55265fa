//! Three parts of the spectrum, by whose heights bands have a colour.

use glam::{DMat3, DVec3};
use relume_colour::spectrum::colour::decode_srgb;
use relume_colour::spectrum::wavelength_nm;

/// Bounds of the parts of the spectrum, in nm: blue, green and red.
const PARTS: [f64; 2] = [490.0, 580.0];

/// The part of the spectrum in which a band lies: 0 blue, 1 green, 2 red.
pub(crate) fn part_of(band: usize) -> usize {
    PARTS.iter().filter(|&&bound| wavelength_nm(band) >= bound).count()
}

/// Heights of the three parts, the largest 1, by which parts that are `seen` in linear sRGB at a height of 1 have the chromaticity of these
/// sRGB code values from 0 to 1, as far as heights from 0 give it; `None` if the parts do not span the colours.
pub(crate) fn heights(seen: impl Fn(DVec3) -> DVec3, colour: [f64; 3]) -> Option<DVec3> {
    let parts = DMat3::from_cols(seen(DVec3::X), seen(DVec3::Y), seen(DVec3::Z));
    let scale = parts.x_axis.length() * parts.y_axis.length() * parts.z_axis.length();
    let wanted = DVec3::from_array(colour.map(|code| decode_srgb(code.clamp(0.0, 1.0))));
    let heights = (parts.determinant().abs() > 1e-6 * scale).then(|| (parts.inverse() * wanted).max(DVec3::ZERO))?;
    (heights.max_element() > 0.0).then(|| heights / heights.max_element())
}
