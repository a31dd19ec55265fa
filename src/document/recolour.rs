//! Lights that show what they light in another colour: the light of a channel as its filter and its colour (docs/theory/fields.md).

use crate::look::bands::{heights, part_of};
use glam::DVec3;
use relume_colour::spectrum::colour::{LinearSrgb, display_code, linear_srgb_from_xyz, xyz_of};
use relume_colour::spectrum::{BANDS, Light, Spectrum, srgb_code, standard};
use relume_scene::{Mix, MixLight};

/// A light in the bands of `light` alone, under which the surface that is brightest under it has the chromaticity of these sRGB code values
/// from 0 to 1, as far as powers from 0 give it, and its factor: the largest linear sRGB component stays. `None` if no surface is bright
/// under it, if several are, or if its bands have no blue, green and red part.
#[must_use]
pub fn in_colour<'a>(
    light: &Light,
    surfaces: impl Iterator<Item = &'a Spectrum>,
    colour: [f64; 3],
) -> Option<(Light, f64)> {
    let powers = light.spectrum();
    let seen = |surface: &Spectrum, powers: &Spectrum| xyz_of(&(surface * powers));
    let surfaces: Vec<&Spectrum> = surfaces.collect();
    let brightest = *surfaces.iter().max_by(|a, b| seen(a, powers).0[1].total_cmp(&seen(b, powers).0[1]))?;
    let largest = |powers: &Spectrum| linear(seen(brightest, powers)).max_element();
    let before = largest(powers);
    let peak = powers.samples().iter().copied().fold(0.0, f64::max);
    let is_on = |band: usize| powers.samples()[band] > 1e-6 * peak;
    let daylight = standard::d65().spectrum();
    let of_parts = |heights: DVec3| {
        let band = |band: usize| if is_on(band) { heights[part_of(band)] * daylight.samples()[band] } else { 0.0 };
        Spectrum::from_samples(std::array::from_fn::<f64, BANDS, _>(band))
    };
    let powers = of_parts(heights(|axis| linear(seen(brightest, &of_parts(axis))), colour)?);
    let after = largest(&powers);
    // In its bands nothing else is seen.
    let others = surfaces.iter().filter(|surface| !std::ptr::eq(**surface, brightest));
    let is_alone = others.map(|surface| seen(surface, &powers).0[1]).all(|seen_too| seen_too <= 1e-6 * after);
    if !(before > 0.0 && after > 0.0 && is_alone) {
        return None;
    }
    let powers = powers.scaled(before / after);
    let luminance = xyz_of(&powers).0[1] / xyz_of(light.spectrum()).0[1];
    Some((Light::new(powers).ok()?, luminance))
}

/// The sRGB code values of the surface that is brightest under a light, as bright as a display can show them; `None` if none is.
#[must_use]
pub fn shown_colour<'a>(light: &Light, surfaces: impl Iterator<Item = &'a Spectrum>) -> Option<[u8; 3]> {
    let seen = surfaces.map(|surface| xyz_of(&(surface * light.spectrum())));
    let brightest = linear(seen.max_by(|a, b| a.0[1].total_cmp(&b.0[1]))?).max(DVec3::ZERO);
    let largest = brightest.max_element();
    (largest > 0.0).then(|| srgb_code(&display_code(LinearSrgb((brightest / largest).to_array()))).ok()).flatten()
}

fn linear(xyz: relume_colour::spectrum::colour::Xyz) -> DVec3 {
    DVec3::from_array(linear_srgb_from_xyz(xyz).0)
}

/// The `stated` mix with lights in other colours: of `requests` such as `GFP:#ff00ff=0.5`, of which `GFP` is a light of the mix. Returns the
/// requests without their colours, too.
///
/// # Errors
///
/// A sentence, if a light has no such colour.
pub fn recoloured(stated: &Mix, requests: &[String], surfaces: &[Spectrum]) -> Result<(Mix, Vec<String>), String> {
    let mut mix = stated.clone();
    let mut plain = Vec::new();
    for request in requests {
        let parted = request.split_once(":#").and_then(|(name, rest)| {
            let is_stated = stated.0.iter().any(|light| light.name == name);
            let digits = rest.find(|letter: char| !letter.is_ascii_hexdigit()).unwrap_or(rest.len());
            is_stated.then(|| (name, rest.split_at(digits)))
        });
        let Some((name, (digits, rest))) = parted else {
            plain.push(request.clone());
            continue;
        };
        let code = srgb_code(&format!("#{digits}")).map_err(|error| format!("{request}: {error}"))?;
        let colour = code.map(|part| f64::from(part) / 255.0);
        for light in mix.0.iter_mut().filter(|light| light.name == name) {
            let (spectrum, factor) = in_colour(&light.spectrum, surfaces.iter(), colour).ok_or_else(|| {
                format!("{request}: the light {name} does not light one material in blue, green and red bands, as that of a channel does; give its spectrum as a file")
            })?;
            *light = MixLight { spectrum, weight: light.weight * factor, ..light.clone() };
        }
        plain.push(format!("{name}{rest}"));
    }
    Ok((mix, plain))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_light_of_bands_shows_its_surface_in_any_hue_and_leaves_the_others_black() {
        let comb =
            |of: usize| Spectrum::from_samples(std::array::from_fn(|band| if band % 3 == of { 0.7 } else { 0.0 }));
        let Ok(light) = Light::new(&comb(1) * standard::d65().spectrum()) else { return };
        let surfaces = [comb(0), comb(1), comb(2)];
        for colour in [[1.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.5, 0.0], [1.0, 1.0, 1.0]] {
            let Some((found, factor)) = in_colour(&light, surfaces.iter(), colour) else { panic!("{colour:?}") };
            let seen = |surface: &Spectrum| linear(xyz_of(&(surface * &found.spectrum().scaled(factor))));
            assert!(seen(&surfaces[0]) == DVec3::ZERO && seen(&surfaces[2]) == DVec3::ZERO, "{colour:?}");
            let shown = seen(&surfaces[1]).max(DVec3::ZERO);
            let before = linear(xyz_of(&(&surfaces[1] * light.spectrum()))).max_element();
            assert!((shown.max_element() / before - 1.0).abs() < 1e-9, "as bright as before");
            let codes = (shown / shown.max_element()).to_array().map(|it| it.powf(1.0 / 2.2));
            let far = codes.iter().zip(colour).map(|(found, wanted)| (found - wanted).abs()).fold(0.0, f64::max);
            assert!(far < 0.12, "{codes:?} for {colour:?}");
        }
    }
}
