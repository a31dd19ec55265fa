//! Colours against published tables and closed forms.

use glam::{DMat3, DVec3};
use nalgebra::{DMatrix, DVector};
use relume::film::display_from_xyz;
use relume::scene::{Display, Mix};
use relume::spectrum::colour::{
    LINEAR_SRGB_FROM_XYZ, Lab, LinearSrgb, OBSERVER, XYZ_FROM_LINEAR_SRGB, Xyz, bradford, ciede2000, d65_white,
    decode_srgb, display_code, encode_srgb, lab_from_xyz, linear_srgb_from_xyz, xyz, xyz_from_linear_srgb, xyz_of,
};
use relume::spectrum::deficiency::Deficiency;
use relume::spectrum::{BANDS, Kind, Reflectance, Spectrum, SpectrumError, smooth_reflectance, standard};

fn assert_close(actual: [f64; 3], expected: [f64; 3], limit: f64) {
    let error = std::array::from_fn::<f64, 3, _>(|axis| (actual[axis] - expected[axis]).abs());
    // Not `max`, which ignores NaN.
    assert!(error.iter().all(|&error| error <= limit), "{actual:?} is not {expected:?} to {limit}");
}

fn rows(matrix: DMat3) -> [[f64; 3]; 3] {
    matrix.transpose().to_cols_array_2d()
}

/// L*, a*, b* of two colours and their ΔE00: Sharma, Wu and Dalal 2005, Color Research and Application 30, 21, table 1.
const SHARMA_2005: [[f64; 7]; 34] = [
    [50.0000, 2.6772, -79.7751, 50.0000, 0.0000, -82.7485, 2.0425],
    [50.0000, 3.1571, -77.2803, 50.0000, 0.0000, -82.7485, 2.8615],
    [50.0000, 2.8361, -74.0200, 50.0000, 0.0000, -82.7485, 3.4412],
    [50.0000, -1.3802, -84.2814, 50.0000, 0.0000, -82.7485, 1.0000],
    [50.0000, -1.1848, -84.8006, 50.0000, 0.0000, -82.7485, 1.0000],
    [50.0000, -0.9009, -85.5211, 50.0000, 0.0000, -82.7485, 1.0000],
    [50.0000, 0.0000, 0.0000, 50.0000, -1.0000, 2.0000, 2.3669],
    [50.0000, -1.0000, 2.0000, 50.0000, 0.0000, 0.0000, 2.3669],
    [50.0000, 2.4900, -0.0010, 50.0000, -2.4900, 0.0009, 7.1792],
    [50.0000, 2.4900, -0.0010, 50.0000, -2.4900, 0.0010, 7.1792],
    [50.0000, 2.4900, -0.0010, 50.0000, -2.4900, 0.0011, 7.2195],
    [50.0000, 2.4900, -0.0010, 50.0000, -2.4900, 0.0012, 7.2195],
    [50.0000, -0.0010, 2.4900, 50.0000, 0.0009, -2.4900, 4.8045],
    [50.0000, -0.0010, 2.4900, 50.0000, 0.0010, -2.4900, 4.8045],
    [50.0000, -0.0010, 2.4900, 50.0000, 0.0011, -2.4900, 4.7461],
    [50.0000, 2.5000, 0.0000, 50.0000, 0.0000, -2.5000, 4.3065],
    [50.0000, 2.5000, 0.0000, 73.0000, 25.0000, -18.0000, 27.1492],
    [50.0000, 2.5000, 0.0000, 61.0000, -5.0000, 29.0000, 22.8977],
    [50.0000, 2.5000, 0.0000, 56.0000, -27.0000, -3.0000, 31.9030],
    [50.0000, 2.5000, 0.0000, 58.0000, 24.0000, 15.0000, 19.4535],
    [50.0000, 2.5000, 0.0000, 50.0000, 3.1736, 0.5854, 1.0000],
    [50.0000, 2.5000, 0.0000, 50.0000, 3.2972, 0.0000, 1.0000],
    [50.0000, 2.5000, 0.0000, 50.0000, 1.8634, 0.5757, 1.0000],
    [50.0000, 2.5000, 0.0000, 50.0000, 3.2592, 0.3350, 1.0000],
    [60.2574, -34.0099, 36.2677, 60.4626, -34.1751, 39.4387, 1.2644],
    [63.0109, -31.0961, -5.8663, 62.8187, -29.7946, -4.0864, 1.2630],
    [61.2901, 3.7196, -5.3901, 61.4292, 2.2480, -4.9620, 1.8731],
    [35.0831, -44.1164, 3.7933, 35.0232, -40.0716, 1.5901, 1.8645],
    [22.7233, 20.0904, -46.6940, 23.0331, 14.9730, -42.5619, 2.0373],
    [36.4612, 47.8580, 18.3852, 36.2715, 50.5065, 21.2231, 1.4146],
    [90.8027, -2.0831, 1.4410, 91.1528, -1.6435, 0.0447, 1.4441],
    [90.9257, -0.5406, -0.9208, 88.6381, -0.8985, -0.7239, 1.5381],
    [6.7747, -0.2908, -2.4247, 5.8714, -0.0985, -2.2286, 0.6377],
    [2.0776, 0.0795, -1.1350, 0.9033, -0.0636, -0.5514, 0.9082],
];

#[test]
fn what_is_no_number_is_no_difference_of_zero() {
    for part in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e60] {
        let odd = Lab([50.0, part, 0.0]);
        assert!(ciede2000(odd, Lab([50.0, 0.0, 0.0])).is_nan(), "{part}");
    }
}

/// docs/theory/acceptance.md C2.
#[test]
fn ciede2000_gives_the_published_differences_both_ways() {
    for [l1, a1, b1, l2, a2, b2, expected] in SHARMA_2005 {
        let (one, two) = (Lab([l1, a1, b1]), Lab([l2, a2, b2]));
        // The table has four decimals.
        assert!((ciede2000(one, two) - expected).abs() <= 0.51e-4, "{one:?} {two:?}: {}", ciede2000(one, two));
        assert!((ciede2000(two, one) - ciede2000(one, two)).abs() <= 1e-12, "{one:?} {two:?}");
    }
}

#[test]
fn a_colour_does_not_differ_from_itself() {
    for colour in [[0.0; 3], [50.0, 0.0, 0.0], [40.0, -30.0, 20.0], [100.0, 300.0, -400.0], [-5.0, 1.0, 1.0]] {
        assert_eq!(ciede2000(Lab(colour), Lab(colour)).to_bits(), 0.0_f64.to_bits(), "{colour:?}");
    }
}

/// Sums in numpy over the tables of colour-science 0.4.7, independent of this crate.
const PLAIN_SUMS: [(&str, &str, [f64; 3]); 18] = [
    ("A", "dark skin", [0.1478674168920798, 0.10978159704108989, 0.019901079986315063]),
    ("A", "cyan", [0.11935965045631412, 0.15938571419485886, 0.13303855122628563]),
    ("A", "white 9.5", [0.9751774418128878, 0.8875122524952448, 0.3132822264237239]),
    ("D65", "dark skin", [0.109706928179644, 0.09702791237500934, 0.06054814147757279]),
    ("D65", "cyan", [0.14476455266919047, 0.19866824104043326, 0.3953418982050589]),
    ("D65", "blue", [0.08412084230918895, 0.062302782912371166, 0.3000599486461645]),
    ("FL11", "dark skin", [0.1216465536585141, 0.10111125973176643, 0.03590143573748504]),
    ("FL11", "cyan", [0.13303059239719062, 0.16756061299314443, 0.22409464985813685]),
    ("FL11", "blue", [0.06872366811861859, 0.05174427902119593, 0.17566383113197512]),
    ("LED-RGB1", "dark skin", [0.15223322129362452, 0.108188546674955, 0.0165110394740104]),
    ("LED-RGB1", "white 9.5", [0.9620506385070323, 0.8878945038917219, 0.2589087763697977]),
    ("LED-RGB1", "blue", [0.055438685000847934, 0.05333536306789911, 0.07485740291806015]),
    ("LED-V1", "dark skin", [0.15184895459959438, 0.11050798485882248, 0.020238268025558653]),
    ("LED-V1", "cyan", [0.11886051346469437, 0.15914615461793488, 0.12440832116420693]),
    ("LED-V1", "blue", [0.05796504135322803, 0.05113027466508058, 0.08388668189601596]),
    ("LED-B2", "dark skin", [0.13891280122006505, 0.10822640834316444, 0.02223288204485047]),
    ("LED-B4", "blue", [0.08221302123815864, 0.05481552737682395, 0.26644811570775845]),
    ("LED-V2", "cyan", [0.12534863926809237, 0.18182452165189034, 0.23694084510014077]),
];

/// L*a*b* relative to D65 and sRGB codes of [`PLAIN_SUMS`], by the formulas of CIE 15 and IEC 61966-2-1 in plain
/// Python.
const PLAIN_CODES: [([f64; 3], [u8; 3]); 18] = [
    ([39.543661, 29.506265, 43.081658], [149, 71, 20]),
    ([46.893793, -20.704584, 9.193088], [78, 120, 95]),
    ([95.476359, 23.801073, 60.164585], [255, 222, 125]),
    ([37.303642, 13.691940, 15.563651], [116, 79, 63]),
    ([51.686305, -24.727033, -25.982234], [0, 137, 167]),
    ([29.986159, 24.609121, -50.865234], [46, 62, 151]),
    ([38.041139, 19.042435, 29.040945], [129, 77, 43]),
    ([47.951191, -16.046208, -7.823324], [70, 122, 126]),
    ([27.226038, 21.985433, -34.350649], [67, 55, 117]),
    ([39.273685, 33.290947, 45.795639], [153, 67, 13]),
    ([95.492361, 21.459074, 68.321123], [255, 224, 107]),
    ([27.664626, 5.700753, -6.649153], [69, 63, 76]),
    ([39.665897, 31.371713, 42.996532], [152, 70, 21]),
    ([46.862267, -20.918209, 11.332886], [79, 120, 91]),
    ([27.054382, 11.232985, -10.871310], [73, 59, 81]),
    ([39.280132, 25.100318, 40.645180], [143, 74, 24]),
    ([28.064873, 31.193105, -49.124390], [63, 52, 143]),
    ([49.716659, -28.752417, -6.994004], [23, 132, 129]),
];

/// docs/theory/acceptance.md C1.
#[test]
fn patches_under_lights_have_the_colours_of_another_implementation() {
    for ((light, patch, expected), (lab, codes)) in PLAIN_SUMS.into_iter().zip(PLAIN_CODES) {
        let colour = xyz(&standard::light(light).unwrap(), &standard::reflectance(patch).unwrap());
        assert_close(colour.0, expected, 1e-12);
        assert_close(lab_from_xyz(colour, d65_white()).0, lab, 1e-6);
        let code = format!("#{}", codes.map(|code| format!("{code:02x}")).concat());
        assert_eq!(display_code(linear_srgb_from_xyz(colour)), code, "{patch} under {light}");
    }
}

#[test]
fn the_perfect_reflector_has_luminance_1_under_every_light() {
    let white = Reflectance::new(Spectrum::constant(1.0)).unwrap();
    let names = standard::names(Kind::Light).iter().copied();
    for name in names.chain(["blackbody 100", "blackbody 2856", "blackbody 1e9"]) {
        let Xyz([_, y, _]) = xyz(&standard::light(name).unwrap(), &white);
        assert!((y - 1.0).abs() <= 1e-14, "{name}: {y}");
    }
}

/// x, y as published by the CIE to four digits (CIE 15:2004, CIE 015:2018), here to five digits from independent sums
/// at
/// 5 nm.
const CHROMATICITIES: [(&str, [f64; 2]); 10] = [
    ("A", [0.44758, 0.40745]),
    ("D65", [0.31272, 0.32903]),
    ("E", [0.33333, 0.33333]),
    ("FL2", [0.37207, 0.37512]),
    ("FL11", [0.38054, 0.37692]),
    ("LED-B1", [0.45595, 0.40780]),
    ("LED-B3", [0.37561, 0.37229]),
    ("LED-B2", [0.43566, 0.40118]),
    ("LED-B4", [0.34218, 0.35016]),
    ("LED-V2", [0.37811, 0.37750]),
];

#[test]
fn lights_have_their_chromaticities() {
    for (name, [x, y]) in CHROMATICITIES {
        let white = xyz_of(standard::light(name).unwrap().spectrum()).0;
        let sum: f64 = white.iter().sum();
        assert!((white[0] / sum - x).abs() <= 0.6e-5 && (white[1] / sum - y).abs() <= 0.6e-5, "{name}: {white:?}");
    }
}

#[test]
fn the_srgb_matrix_has_the_published_digits() {
    let published =
        [[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560], [0.0556434, -0.2040259, 1.0572252]];
    for (row, expected) in rows(*LINEAR_SRGB_FROM_XYZ).into_iter().zip(published) {
        assert_close(row, expected, 0.51e-7);
    }
    let product = *LINEAR_SRGB_FROM_XYZ * *XYZ_FROM_LINEAR_SRGB;
    assert!(product.abs_diff_eq(DMat3::IDENTITY, 1e-14), "{product}");
}

#[test]
fn daylight_is_srgb_white() {
    assert_close(linear_srgb_from_xyz(d65_white()).0, [1.0; 3], 1.2e-4);
    assert_close(linear_srgb_from_xyz(Xyz([0.95047, 1.0, 1.08883])).0, [1.0; 3], 1e-14);
}

#[test]
fn linear_srgb_goes_there_and_back() {
    for rgb in [[0.0; 3], [1.0, 0.0, 0.0], [0.2, 0.7, -0.3], [5.0, 0.5, 0.05]] {
        assert_close(linear_srgb_from_xyz(xyz_from_linear_srgb(LinearSrgb(rgb))).0, rgb, 1e-14);
    }
}

#[test]
fn the_transfer_function_goes_there_and_back() {
    for step in -10_000..=110_000 {
        let encoded = f64::from(step) / 1e5;
        // The published constants leave a gap of 3e-8 between the two branches.
        assert!((encode_srgb(decode_srgb(encoded)) - encoded).abs() <= 3e-8, "{encoded}");
    }
    // IEC 61966-2-1: the linear segment, and 18 % grey, which is 118 of 255.
    assert!((encode_srgb(0.001) - 0.01292).abs() <= 1e-15);
    assert!((255.0 * encode_srgb(0.18) - 117.6).abs() <= 0.1);
    assert_close([encode_srgb(1.0), decode_srgb(1.0), decode_srgb(0.0)], [1.0, 1.0, 0.0], 1e-15);
}

#[test]
fn lab_takes_its_linear_branch_below_the_knee() {
    let white = d65_white();
    assert_close(lab_from_xyz(white, white).0, [100.0, 0.0, 0.0], 1e-12);
    assert_close(lab_from_xyz(Xyz([0.0; 3]), white).0, [0.0; 3], 1e-12);
    // CIE 15: L* = 903.3 Y up to Y = 0.008856, including Y < 0, and 116 ∛Y − 16 above.
    let lightness = |y: f64| lab_from_xyz(Xyz([y * white.0[0], y, y * white.0[2]]), white).0;
    let slope = (29.0_f64 / 3.0).powi(3);
    for y in [-0.1, 1e-6, 0.008] {
        assert_close(lightness(y), [slope * y, 0.0, 0.0], 1e-12);
    }
    assert_close(lightness(0.125), [42.0, 0.0, 0.0], 1e-12);
    assert_close(lightness(0.184_186_518_9), [50.0, 0.0, 0.0], 1e-6);
}

#[test]
fn bradford_takes_one_white_to_the_other() {
    let whites = standard::names(Kind::Light).iter().map(|name| xyz_of(standard::light(name).unwrap().spectrum()));
    for white in whites {
        let adapted = bradford(white, d65_white()) * DVec3::from(white.0);
        assert_close(adapted.to_array(), d65_white().0, 1e-14);
    }
    assert!(bradford(d65_white(), d65_white()).abs_diff_eq(DMat3::IDENTITY, 1e-14));
}

#[test]
fn bradford_has_the_published_digits() {
    // D65 to D50, B. Lindbloom, "Chromatic Adaptation".
    let published =
        [[1.0478112, 0.0228866, -0.0501270], [0.0295424, 0.9904844, -0.0170491], [-0.0092345, 0.0150436, 0.7521316]];
    let matrix = bradford(Xyz([0.95047, 1.0, 1.08883]), Xyz([0.96422, 1.0, 0.82521]));
    for (row, expected) in rows(matrix).into_iter().zip(published) {
        assert_close(row, expected, 0.51e-7);
    }
}

#[test]
fn smooth_reflectances_have_their_colour_inside_0_and_1() {
    let levels = [0.0, 1e-6, 0.001, 0.05, 0.3, 0.7, 0.95, 1.0];
    for red in levels {
        for green in levels {
            for blue in levels {
                let rgb = [red, green, blue];
                if rgb.iter().all(|&part| part <= 0.0) || rgb.iter().all(|&part| part >= 1.0) {
                    continue;
                }
                let reflectance = smooth_reflectance(LinearSrgb(rgb)).unwrap();
                let inside = reflectance.spectrum().samples().iter().all(|&sample| sample > 0.0 && sample < 1.0);
                assert!(inside, "{rgb:?}: {reflectance:?}");
                let colour = xyz(standard::d65(), &reflectance);
                assert_close(colour.0, xyz_from_linear_srgb(LinearSrgb(rgb)).0, 1e-9);
            }
        }
    }
}

#[test]
fn no_smoother_curve_has_the_colour() {
    // Lagrange condition: the gradient of the sum of squared slopes of z = atanh(2 r − 1) is a linear combination of
    // the
    // gradients of X, Y and Z.
    let reflectance = smooth_reflectance(LinearSrgb([0.6, 0.2, 0.05])).unwrap();
    let r = reflectance.spectrum().samples();
    let z = r.map(|r| 0.5 * (r / (1.0 - r)).ln());
    let light = standard::d65().spectrum();
    let gradients = DMatrix::from_fn(BANDS, 3, |band, axis| {
        2.0 * r[band] * (1.0 - r[band]) * OBSERVER[axis].samples()[band] * light.samples()[band]
    });
    let slope = |band: usize| if (1..BANDS).contains(&band) { z[band] - z[band - 1] } else { 0.0 };
    let roughness = DVector::from_fn(BANDS, |band, _| slope(band) - slope(band + 1));
    let mixture = gradients.clone().svd(true, true).solve(&roughness, 0.0).unwrap();
    let rest = (&gradients * mixture - &roughness).amax();
    assert!(rest <= 1e-9 && roughness.amax() > 1e-3, "{rest} of {}", roughness.amax());
}

#[test]
fn the_smooth_reflectance_of_a_grey_is_flat_to_the_whites_difference() {
    // The colour of D65 on the grid gives the perfect reflector; half of it gives the grey 0.5.
    let white = linear_srgb_from_xyz(d65_white());
    let grey = smooth_reflectance(LinearSrgb(white.0.map(|part| 0.5 * part))).unwrap();
    assert!(grey.spectrum().samples().iter().all(|sample| (sample - 0.5).abs() <= 1e-9), "{grey:?}");
}

#[test]
fn black_and_white_are_exact_constants() {
    for constant in [0.0, 1.0] {
        let reflectance = smooth_reflectance(LinearSrgb([constant; 3])).unwrap();
        assert_eq!(reflectance.spectrum(), &Spectrum::constant(constant));
    }
}

#[test]
fn colours_brighter_or_purer_than_any_reflectance_are_refused() {
    for rgb in
        [[1.1, 1.1, 1.1], [0.5, -0.5, 0.5], [-0.1, 0.0, 0.0], [1.0, 1.0, 1.5], [f64::NAN, 0.0, 0.0], [3.0, 0.0, 0.0]]
    {
        let error = smooth_reflectance(LinearSrgb(rgb)).unwrap_err();
        assert!(matches!(error, SpectrumError::Unattainable { .. }), "{rgb:?}: {error}");
        assert!(error.to_string().contains(&rgb[0].to_string()), "{error}");
    }
}

#[test]
fn a_display_for_a_deficiency_shows_the_published_columns_of_the_primaries_and_leaves_greys() {
    let display = |deficiency| Display { exposure: Some(2.0), deficiency, ..Display::default() };
    let of = |deficiency| display_from_xyz(&Mix(Vec::new()), &display(deficiency)) * *XYZ_FROM_LINEAR_SRGB;
    // Machado, Oliveira and Fernandes 2009, table 1, severity 1: red as seen by deuteranopes.
    assert_close((of(Some(Deficiency::Deutan)) * DVec3::X).to_array(), [0.734644, 0.560170, -0.023640], 1e-12);
    for deficiency in Deficiency::ALL {
        assert_close((of(Some(deficiency)) * DVec3::ONE).to_array(), [2.0; 3], 1e-5);
    }
    assert_close((of(None) * DVec3::new(0.1, 0.2, 0.3)).to_array(), [0.2, 0.4, 0.6], 1e-12);
}
