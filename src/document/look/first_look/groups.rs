//! Designed lights of groups of labels: daylight through combs, one comb for each group (docs/theory/first-look.md).

use std::fmt::Write as _;

use glam::{DMat3, DVec3};

use relume_base::number::{count, whole};
use relume_colour::spectrum::colour::{LinearSrgb, decode_srgb, xyz_from_linear_srgb, xyz_of};
use relume_colour::spectrum::{BANDS, Spectrum, srgb_code, standard, wavelength_nm};

/// Most groups, each of which has a light of its own.
pub(super) const MOST: usize = 3;
/// Bands in a tooth of a comb.
const TOOTH: usize = 2;
/// Wavelengths in nm that part the three regions in which a reflectance is constant.
const PARTS: [f64; 2] = [490.0, 580.0];
/// Largest intensity of daylight, of which a comb passes only a part.
const BRIGHTEST: f64 = 6.0;

/// Groups of labels.
#[derive(Debug, PartialEq)]
pub(super) struct Groups {
    /// Group of each label.
    of_label: Vec<usize>,
    names: Vec<String>,
}

/// Groups of labels of these `names`, which have the fractions `sizes` of the voxels. Each label is a group of its
/// own up to [`MOST`] of them; otherwise the `outer` one, if there is one, and the others by size.
pub(super) fn of_labels(names: &[String], sizes: &[f64], outer: Option<usize>) -> Groups {
    if names.len() <= MOST {
        return Groups { of_label: (0..names.len()).collect(), names: names.to_vec() };
    }
    let mut order: Vec<usize> = (0..names.len()).filter(|&label| Some(label) != outer).collect();
    // Stable, so that labels of one size keep their order.
    order.sort_by(|&one, &other| sizes[other].total_cmp(&sizes[one]));
    let mut groups: Vec<String> = outer.map(|label| names[label].clone()).into_iter().collect();
    let first = groups.len();
    let by_size = if first == 0 { &["large", "middle", "small"][..] } else { &["large", "small"] };
    groups.extend(by_size.iter().map(|size| format!("{size}_labels")));
    // Equal shares of the sum of the radii, so that few large labels and many small ones are groups alike.
    let radius = |label: usize| sizes[label].cbrt().max(f64::MIN_POSITIVE);
    let all: f64 = order.iter().map(|&label| radius(label)).sum();
    let (mut before, mut found) = (0.0, vec![0; names.len()]);
    for &label in &order {
        found[label] = first + whole(before / all * count(by_size.len())).min(by_size.len() - 1);
        before += radius(label);
    }
    // One large label can leave none in the middle.
    let used: Vec<usize> = (0..groups.len()).filter(|group| found.contains(group)).collect();
    let place = |group: &usize| used.iter().position(|it| it == group).unwrap_or_default();
    Groups {
        of_label: found.iter().map(place).collect(),
        names: used.iter().map(|&group| groups[group].clone()).collect(),
    }
}

/// 1 in the bands of comb `group` of `groups`, 0 elsewhere.
fn comb(group: usize, groups: usize) -> Spectrum {
    Spectrum::from_samples(std::array::from_fn(|band| f64::from(u8::from(band / TOOTH % groups == group))))
}

/// Daylight.
fn daylight() -> &'static Spectrum {
    standard::d65().spectrum()
}

/// Reflectance in each of the three regions of comb `group`, up to a factor, of a surface that has the colour `code` in
/// daylight. A colour that the comb cannot show is mixed with white until it can.
fn weights(code: &str, group: usize, groups: usize) -> DVec3 {
    let linear = srgb_code(code).unwrap_or([128; 3]).map(|byte| decode_srgb(f64::from(byte) / 255.0));
    let of_region = |region: usize| DVec3::from_array(xyz_of(&(daylight() * &regional(region, group, groups))).0);
    let by_region = DMat3::from_cols(of_region(0), of_region(1), of_region(2)).inverse();
    let of = |LinearSrgb(linear): LinearSrgb| by_region * DVec3::from_array(xyz_from_linear_srgb(LinearSrgb(linear)).0);
    let grey = linear.iter().sum::<f64>() / 3.0;
    let (own, white) = (of(LinearSrgb(linear)), of(LinearSrgb([grey.max(1e-3); 3])));
    // Regions in which the colour needs less than nothing limit its share.
    let share = |region: usize| if own[region] < 0.0 { white[region] / (white[region] - own[region]) } else { 1.0 };
    let share = (0..3).map(share).fold(1.0, f64::min);
    (own * share + white * (1.0 - share)).max(DVec3::ZERO)
}

/// 1 in the bands of comb `group` within a region, 0 elsewhere.
fn regional(region: usize, group: usize, groups: usize) -> Spectrum {
    let comb = comb(group, groups);
    let of_band = |band: usize| {
        let is_within = PARTS.iter().filter(|&&nm| wavelength_nm(band) >= nm).count() == region;
        if is_within { comb.samples()[band] } else { 0.0 }
    };
    Spectrum::from_samples(std::array::from_fn(of_band))
}

/// Materials and lights of a scene for labels of these names and sRGB codes.
pub(super) fn text(labels: &[(String, String)], Groups { of_label, names: groups }: &Groups) -> String {
    let weights: Vec<DVec3> =
        labels.iter().zip(of_label).map(|((_, code), &group)| weights(code, group, groups.len())).collect();
    // One factor for all labels, so that they keep their brightness beside each other; daylight makes up for it.
    let largest = weights.iter().map(|it| it.max_element()).fold(1.0, f64::max);
    let intensity = largest.min(BRIGHTEST);
    let mut text = String::from(
        "\n# Each group of labels reflects only in the bands of a comb. Daylight shows all labels. Daylight through the comb of \
         a group\n# shows this group in the same colours, and leaves all other labels black.\n",
    );
    for (((name, code), &group), weights) in labels.iter().zip(of_label).zip(&weights) {
        let reflectance = (0..3).map(|region| (region, weights[region] / largest)).fold(
            Spectrum::constant(0.0),
            |sum, (region, weight)| {
                let part = regional(region, group, groups.len());
                Spectrum::from_samples(std::array::from_fn(|band| {
                    weight.mul_add(part.samples()[band], sum.samples()[band])
                }))
            },
        );
        let key = toml_edit::Key::new(name).display_repr().into_owned();
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            "\n[materials.{key}.reflectance] # {code} in daylight\nsamples = [\n{}]\n",
            rows(&reflectance)
        );
    }
    let _ = write!(text, "\n[lights.day]\nkind = \"three_point\"\nspectrum = \"D65\"\nintensity = {intensity:.4}\n");
    for (group, name) in groups.iter().enumerate() {
        let light = daylight() * &comb(group, groups.len());
        // Lights are scaled to one luminance; the intensity keeps the brightness of daylight.
        let bright = intensity * xyz_of(&light).0[1];
        let key = toml_edit::Key::new(format!("for_{name}")).display_repr().into_owned();
        let relative = Spectrum::from_samples(light.samples().map(|power| 100.0 * power));
        let _ = write!(
            text,
            "\n[lights.{key}]\nkind = \"three_point\"\nintensity = {bright:.4}\n[lights.{key}.spectrum]\nsamples = [\n{}]\n",
            rows(&relative)
        );
    }
    text
}

/// Samples to four decimals, in rows.
fn rows(spectrum: &Spectrum) -> String {
    let samples: Vec<String> =
        spectrum.samples().iter().map(|sample| format!("{:?}", (sample * 1e4).round() / 1e4)).collect();
    let row = |row: &[String]| format!("    {},\n", row.join(", "));
    samples.chunks(BANDS.div_ceil(5)).map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_comb_shows_its_own_group_in_its_daylight_colours_and_no_other() {
        for groups in 2..=MOST {
            for group in 0..groups {
                let weights = weights("#3f9b4f", group, groups);
                let reflectance = (0..3).map(|region| (regional(region, group, groups), weights[region]));
                let seen = |light: &Spectrum| -> DVec3 {
                    let of_region =
                        |(part, weight): (Spectrum, f64)| weight * DVec3::from_array(xyz_of(&(light * &part)).0);
                    reflectance.clone().map(of_region).sum()
                };
                let linear = [0x3f, 0x9b, 0x4f].map(|code| decode_srgb(f64::from(code) / 255.0));
                let wanted = DVec3::from_array(xyz_from_linear_srgb(LinearSrgb(linear)).0);
                assert!((seen(daylight()) - wanted).abs().max_element() < 1e-9, "{group} of {groups}");
                for other in 0..groups {
                    let light = daylight() * &comb(other, groups);
                    let expected = if other == group { wanted } else { DVec3::ZERO };
                    assert!((seen(&light) - expected).abs().max_element() < 1e-9, "{group} under {other} of {groups}");
                }
            }
        }
    }

    #[test]
    fn many_labels_are_grouped_by_size_around_the_outer_one() {
        let names: Vec<String> = (0..6).map(|label| format!("l{label}")).collect();
        let sizes = [900.0, 1.0, 800.0, 1.0, 27.0, 8.0];
        let found = of_labels(&names, &sizes, Some(0));
        assert_eq!(found.names, ["l0", "large_labels", "small_labels"]);
        assert_eq!(found.of_label, [0, 2, 1, 2, 2, 2]);
        let found = of_labels(&names, &sizes, None);
        assert_eq!((found.of_label, found.names.len()), (vec![0, 2, 1, 2, 2, 2], 3));
        let found = of_labels(&names[..4], &[1000.0, 1.0, 1.0, 1.0], None);
        assert_eq!(
            (found.of_label, found.names),
            (vec![0, 1, 1, 1], vec!["large_labels".to_owned(), "small_labels".to_owned()])
        );
        assert_eq!(of_labels(&names[..2], &sizes[..2], None).of_label, [0, 1], "each by itself");
    }
}
