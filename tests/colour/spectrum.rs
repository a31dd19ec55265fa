//! Spectra: embedded tables, sampling, normalisation and text form.

#![expect(clippy::print_stderr, reason = "a test that ran on nothing says so")]

use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};

use relume::spectrum::colour::OBSERVER;
use relume::spectrum::observer::OBSERVER_1964;
use relume::spectrum::{
    Absorption, BANDS, Kind, Light, Reflectance, Spectrum, SpectrumError, SpectrumSource, standard, wavelength_nm,
};
use sha2::{Digest, Sha256};
use tempfile::TempDir;

const OBSERVER_CSV: &str = include_str!("../../data/spectra/cie1931_2deg_cmf_5nm.csv");
const OBSERVER_1964_CSV: &str = include_str!("../../data/spectra/cie1964_10deg_cmf_5nm.csv");
const ILLUMINANTS_CSV: &str = include_str!("../../data/spectra/illuminants_5nm.csv");
const LED_CSV: &str = include_str!("../../data/spectra/led_5nm.csv");
const COLORCHECKER_CSV: &str = include_str!("../../data/spectra/colorchecker_ohta1997_5nm.csv");

/// Table without comment lines.
fn published(csv: &str) -> String {
    csv.split_inclusive('\n').filter(|line| !line.starts_with('#')).collect()
}

/// Named columns of a table with their wavelengths, parsed with the standard library only.
fn columns(csv: &str) -> Vec<(String, Vec<(f64, f64)>)> {
    let body = published(csv);
    let mut lines = body.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let names = lines.next().unwrap();
    let rows: Vec<Vec<f64>> = lines.map(|line| line.iter().map(|cell| cell.parse().unwrap()).collect()).collect();
    let column = |index: usize| rows.iter().map(|row| (row[0], row[index])).collect();
    names.iter().enumerate().skip(1).map(|(index, name)| (String::from(*name), column(index))).collect()
}

/// Largest |fourth difference| of a smooth table. A digit wrong by `e` adds `6 e` to one difference and `4 e` to its
/// neighbours.
fn roughness(values: &[f64]) -> f64 {
    values.windows(5).map(|v| (v[0] - 4.0 * v[1] + 6.0 * v[2] - 4.0 * v[3] + v[4]).abs()).fold(0.0, f64::max)
}

fn standard_spectrum(name: &str) -> Spectrum {
    match standard::find(name).unwrap() {
        standard::Standard::Light(samples) | standard::Standard::Reflectance(samples) => samples,
        standard::Standard::Blackbody(_) => unreachable!("no table has this name"),
    }
}

#[test]
fn the_embedded_tables_are_the_published_ones() {
    // SHA-256 of the extracted tables, header line included.
    for (csv, expected) in [
        (OBSERVER_CSV, "e22e732725635706b49ad1e1c6f64b9f4b353bd4ce53c22f91355b34fa5f969a"),
        (OBSERVER_1964_CSV, "de10ee42e537946867bc7fe60ed52a5543da45355d8d3f0f9f50a4e668d28860"),
        (ILLUMINANTS_CSV, "26cd0bb31f0758c9e1d53612b0436dc53796595054ed0d93281d282bedb601bb"),
        (LED_CSV, "b385aca874d4ee52e12e06931d021a3b875c9bc626e555c5c6b4e6fdc10c40b7"),
        (COLORCHECKER_CSV, "aea9fd799a02a7a900275dfe99483d09bcd410e019f16b604038eb4a84ae7013"),
    ] {
        let digest: String = Sha256::digest(published(csv)).iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(digest, expected, "{}", csv.lines().next().unwrap());
    }
}

#[test]
fn the_embedded_tables_are_the_shared_ones() {
    let shared = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/spectra");
    if !shared.is_dir() {
        eprintln!("shared data not present: {} (this test ran on nothing)", shared.display());
        return;
    }
    for (csv, file) in [
        (OBSERVER_CSV, "cie1931_2deg_cmf_5nm.csv"),
        (ILLUMINANTS_CSV, "illuminants_5nm.csv"),
        (COLORCHECKER_CSV, "colorchecker_ohta1997_5nm.csv"),
    ] {
        assert_eq!(published(csv), fs::read_to_string(shared.join(file)).unwrap(), "{file}");
    }
}

#[test]
fn the_compiled_tables_hold_the_files_numbers() {
    let on_grid = |column: &[(f64, f64)]| -> Vec<f64> {
        column.iter().filter(|(nm, _)| (380.0..=780.0).contains(nm)).map(|&(_, value)| value).collect()
    };
    for (csv, observer) in [(OBSERVER_CSV, &OBSERVER), (OBSERVER_1964_CSV, &OBSERVER_1964)] {
        for ((name, column), spectrum) in columns(csv).iter().zip(observer) {
            assert_eq!(spectrum.samples().as_slice(), on_grid(column), "{name}");
        }
    }
    let tables = [ILLUMINANTS_CSV, LED_CSV, COLORCHECKER_CSV].map(columns);
    for (name, column) in tables.iter().flatten() {
        assert_eq!(standard_spectrum(name).samples().as_slice(), on_grid(column), "{name}");
    }
}

#[test]
fn smooth_tables_have_small_fourth_differences() {
    for (spectrum, limit) in OBSERVER.iter().zip([0.037, 0.020, 0.176]) {
        assert!(roughness(spectrum.samples()) <= limit, "{}", roughness(spectrum.samples()));
    }
    for (spectrum, limit) in OBSERVER_1964.iter().zip([0.020, 0.031, 0.083]) {
        assert!(roughness(spectrum.samples()) <= limit, "{}", roughness(spectrum.samples()));
    }
    assert!(roughness(standard_spectrum("A").samples()) <= 0.007);
    for name in standard::names(Kind::Reflectance) {
        assert!(roughness(standard_spectrum(name).samples()) <= 0.059, "{name}");
    }
}

#[test]
fn a_wrong_digit_shows_in_the_fourth_differences() {
    for (name, digit, limit) in [("A", 0.01, 0.007), ("cyan", 0.02, 0.059), ("white 9.5", 0.02, 0.059)] {
        for band in 2..BANDS - 2 {
            let mut samples = *standard_spectrum(name).samples();
            samples[band] += digit;
            assert!(roughness(&samples) > limit, "{name}, band {band}");
        }
    }
}

#[test]
fn daylight_is_interpolated_between_its_tens() {
    // CIE 15 defines the D series every 10 nm with linear interpolation; the table has three or four decimals.
    for name in ["D65", "D50"] {
        for three in standard_spectrum(name).samples().windows(3).step_by(2) {
            assert!((three[1] - f64::midpoint(three[0], three[2])).abs() <= 0.51e-3, "{name}: {three:?}");
        }
    }
}

#[test]
fn illuminant_a_is_its_formula() {
    // CIE 15:2004: Planck's law at 2848 K with c2 = 1.435e-2 m K, 100 at 560 nm.
    let power = |nm: f64| nm.powi(-5) / (1.435e7 / (2848.0 * nm)).exp_m1();
    for (band, sample) in standard_spectrum("A").samples().iter().enumerate() {
        let expected = 100.0 * power(wavelength_nm(band)) / power(560.0);
        assert!((sample / expected - 1.0).abs() <= 5e-6, "{} nm: {sample} {expected}", wavelength_nm(band));
    }
}

#[test]
fn illuminant_a_is_the_black_body_of_its_exponent() {
    // A is Planck's law with c2/T = 1.435e7/2848 nm.
    let kelvin = 2848.0 * 1.438_776_877 / 1.435;
    let (body, a) = (Light::blackbody(kelvin).unwrap(), standard::light("A").unwrap());
    for (sample, expected) in body.spectrum().samples().iter().zip(a.spectrum().samples()) {
        assert!((sample / expected - 1.0).abs() <= 6e-6, "{sample} {expected}");
    }
}

#[test]
fn a_very_hot_black_body_falls_with_the_fourth_power() {
    let samples = *Light::blackbody(1e12).unwrap().spectrum().samples();
    assert!((samples[0] / samples[80] / (780.0_f64 / 380.0).powi(4) - 1.0).abs() <= 1e-6);
}

#[test]
fn a_black_body_must_have_a_temperature() {
    for kelvin in [0.0, -5.0, 99.9, f64::NAN, f64::INFINITY] {
        assert!(matches!(Light::blackbody(kelvin), Err(SpectrumError::Temperature { .. })), "{kelvin}");
    }
}

#[test]
fn every_typical_led_lamp_of_the_cie_has_its_name() {
    for name in ["B1", "B2", "B3", "B4", "B5", "BH1", "RGB1", "V1", "V2"] {
        assert!(standard::light(&format!("LED-{name}")).is_ok(), "{name}");
    }
}

#[test]
fn names_are_found_however_they_are_spelt() {
    for (spelling, name) in [
        ("d65", "D65"),
        ("fl 11", "FL11"),
        ("led_rgb1", "LED-RGB1"),
        ("Dark Skin", "dark skin"),
        ("dark_skin", "dark skin"),
        ("dark-skin", "dark skin"),
        ("white_9.5_(.05_D)", "white 9.5"),
    ] {
        assert_eq!(standard::find(spelling), standard::find(name), "{spelling}");
    }
    for spelling in ["blackbody 2856", "Blackbody 2856K", "blackbody_2.856e3"] {
        assert_eq!(standard::light(spelling).unwrap(), Light::blackbody(2856.0).unwrap(), "{spelling}");
    }
    for name in ["blackbody -300", "blackbody -3000", "black-body 3e-1", "blackbody-3000 K"] {
        assert!(matches!(standard::light(name), Err(SpectrumError::Temperature { .. })), "{name}");
    }
    for name in ["", "(", "blackbody", "blackbody.csv", "D66"] {
        assert_eq!(standard::find(name), None, "{name}");
    }
}

#[test]
fn a_near_miss_is_answered_with_the_name() {
    assert_eq!(standard::hint("D56", Kind::Light), "did you mean \"D65\"?");
    assert_eq!(standard::hint("purplish_bleu", Kind::Reflectance), "did you mean \"purplish blue\"?");
    assert!(standard::hint("sunshine", Kind::Light).starts_with("the standards are A, D65, "));
    let error = standard::light("FL12").unwrap_err().to_string();
    assert!(error.contains("\"FL12\"") && error.contains("did you mean"), "{error}");
}

#[test]
fn points_are_joined_by_lines_and_held_beyond_their_ends() {
    let spectrum = Spectrum::interpolate(&[(600.0, 3.0), (400.0, 1.0)]).unwrap();
    let expected = Spectrum::from_fn(|nm| 1.0 + ((nm - 400.0) / 100.0).clamp(0.0, 2.0));
    for (sample, expected) in spectrum.samples().iter().zip(expected.samples()) {
        assert!((sample - expected).abs() <= 1e-15, "{sample} {expected}");
    }
    assert_eq!(Spectrum::interpolate(&[(560.0, 0.3)]).unwrap(), Spectrum::constant(0.3));
}

#[test]
fn points_that_are_no_curve_are_refused() {
    for (points, word) in [
        (&[][..], "at least one"),
        (&[(500.0, 1.0), (600.0, 1.0), (500.0, 2.0)], "500 nm is given twice"),
        (&[(500.0, f64::NAN)], "finite"),
        (&[(f64::INFINITY, 1.0)], "positive"),
        (&[(-500.0, 1.0)], "positive"),
        (&[(0.4, 1.0), (0.7, 1.0)], "micrometres"),
        (&[(3800.0, 1.0), (7800.0, 1.0)], "outside 380 to 780"),
    ] {
        for error in [Spectrum::interpolate(points).unwrap_err(), Spectrum::box_average(points).unwrap_err()] {
            assert!(matches!(error, SpectrumError::Points(_)), "{error:?}");
            assert!(error.to_string().contains(word), "{error}");
        }
    }
}

#[test]
fn box_averages_are_the_integrals_of_the_line() {
    // A triangular line of height 1 from 546 to 548 nm: area 1, of which 7/8 lie in the bin from 542.5 to 547.5.
    let line = [(380.0, 0.0), (546.0, 0.0), (547.0, 1.0), (548.0, 0.0), (780.0, 0.0)];
    let spectrum = Spectrum::box_average(&line).unwrap();
    assert!((spectrum.samples()[33] - 0.875 / 5.0).abs() <= 1e-15);
    assert!((spectrum.samples()[34] - 0.125 / 5.0).abs() <= 1e-15);
    assert!((spectrum.sum() - 0.2).abs() <= 1e-15);

    // The line y = nm: every mean is the value in the middle of the part that the table covers.
    let slope = Spectrum::box_average(&[(401.0, 401.0), (599.0, 599.0)]).unwrap();
    for (nm, expected) in
        [(380.0, 401.0), (395.0, 401.0), (400.0, 401.75), (405.0, 405.0), (600.0, 598.25), (780.0, 599.0)]
    {
        let at = (0..BANDS).find(|&band| (wavelength_nm(band) - nm).abs() < 1.0).unwrap();
        assert!((slope.samples()[at] - expected).abs() <= 1e-12, "{nm}: {}", slope.samples()[at]);
    }
}

#[test]
fn gaussians_have_their_height_and_their_width() {
    let spectrum = Spectrum::gaussian(550.0, 20.0, 0.8).unwrap();
    assert!((spectrum.samples()[34] - 0.8).abs() <= 1e-15);
    assert!((spectrum.samples()[38] - 0.8 * (-0.5_f64).exp()).abs() <= 1e-15);
    let narrowest = Spectrum::gaussian(552.0, 2.5, 1.0).unwrap();
    let area = 2.5 * std::f64::consts::TAU.sqrt();
    assert!((5.0 * narrowest.sum() / area - 1.0).abs() <= 0.015);
    for [centre, sigma, height] in
        [[550.0, 2.4, 1.0], [550.0, f64::NAN, 1.0], [f64::NAN, 20.0, 1.0], [550.0, 20.0, f64::INFINITY]]
    {
        assert!(matches!(Spectrum::gaussian(centre, sigma, height), Err(SpectrumError::Gaussian { .. })));
    }
}

#[test]
fn each_kind_has_its_own_normalisation() {
    let ramp = Spectrum::from_fn(|nm| nm / 100.0);
    assert_eq!(Reflectance::new(ramp.clone()).unwrap().spectrum(), &ramp);
    let light = Light::new(ramp.clone()).unwrap();
    assert!((OBSERVER[1].dot(light.spectrum()) - 1.0).abs() <= 1e-14);
    let absorption = Absorption::new(ramp).unwrap();
    assert!((absorption.spectrum().samples()[80] - 1.0).abs() <= 1e-15);
    assert!((absorption.spectrum().samples()[0] - 380.0 / 780.0).abs() <= 1e-15);
}

#[test]
fn lights_of_any_size_are_normalised() {
    for power in [1e-320, 1e-300, 1e300, f64::MAX] {
        let light = Light::new(Spectrum::constant(power)).unwrap();
        assert!((OBSERVER[1].dot(light.spectrum()) - 1.0).abs() <= 1e-14, "{power}");
    }
}

#[test]
fn a_light_without_luminance_is_used_as_it_is() {
    for spectrum in [Spectrum::constant(0.0), Spectrum::constant(-2.0)] {
        assert_eq!(Light::new(spectrum.clone()).unwrap().spectrum(), &spectrum);
    }
}

#[test]
fn only_reflectances_and_lights_may_be_negative() {
    let signed = Spectrum::from_fn(|nm| (nm - 500.0) / 100.0);
    let reflectance = Reflectance::new(signed.clone()).unwrap();
    assert!(!reflectance.is_physical());
    assert!(Reflectance::new(Spectrum::constant(1.0)).unwrap().is_physical());
    assert!(Light::new(signed.clone()).is_ok());
    assert!(matches!(Absorption::new(signed), Err(SpectrumError::NegativeAbsorption { .. })));
    assert!(matches!(Absorption::new(Spectrum::constant(0.0)), Err(SpectrumError::NoAbsorption)));
}

#[test]
fn no_kind_takes_what_is_not_finite() {
    let broken = Spectrum::from_fn(|nm| 1.0 / (nm - 500.0));
    assert!(matches!(Reflectance::new(broken.clone()), Err(SpectrumError::NotFinite { kind: Kind::Reflectance, .. })));
    assert!(matches!(Light::new(broken.clone()), Err(SpectrumError::NotFinite { kind: Kind::Light, .. })));
    assert!(matches!(Absorption::new(broken), Err(SpectrumError::NotFinite { kind: Kind::Absorption, .. })));
}

/// Folder with one file, `x.csv`.
fn folder(contents: impl AsRef<[u8]>) -> (TempDir, PathBuf) {
    let folder = TempDir::new().unwrap();
    fs::write(folder.path().join("x.csv"), contents).unwrap();
    let path = folder.path().to_path_buf();
    (folder, path)
}

fn written(toml: &str) -> SpectrumSource {
    parsed(toml).unwrap()
}

fn parsed(toml: &str) -> Result<SpectrumSource, toml::de::Error> {
    #[derive(serde::Deserialize)]
    struct Scene {
        spectrum: SpectrumSource,
    }
    toml::from_str::<Scene>(&format!("spectrum = {toml}")).map(|scene| scene.spectrum)
}

#[test]
fn text_files_are_read_in_every_usual_form() {
    for contents in [
        "400,1\n600,3\n",
        "400;1\n600;3",
        "400\t1\r\n600\t3\r\n",
        "  400   1\n\n  600   3  \n",
        "# comment\n% another\nwavelength (nm),R\n400, 1\n600, 3,\n",
        "\u{feff}nm;value\n600;3e0\n400;1.0\n",
        "\"nm\",\"value\"\n\"400\",\"1\"\n\"600\",\"3\"\n",
    ] {
        let (_keep, base) = folder(contents);
        let expected = Spectrum::interpolate(&[(400.0, 1.0), (600.0, 3.0)]).unwrap();
        assert_eq!(written("'x.csv'").reflectance(&base).unwrap().spectrum(), &expected, "{contents:?}");
        assert_eq!(written("{ file = 'x.csv' }").reflectance(&base).unwrap().spectrum(), &expected, "{contents:?}");
    }
}

#[test]
fn a_column_is_chosen_by_name_or_number() {
    let (_keep, base) = folder("nm,skin,Bone\n400,1,2\n600,3,4\n");
    let expected = Spectrum::interpolate(&[(400.0, 2.0), (600.0, 4.0)]).unwrap();
    for column in ["3", "'Bone'", "'bone'"] {
        let source = written(&format!("{{ file = 'x.csv', column = {column} }}"));
        assert_eq!(source.reflectance(&base).unwrap().spectrum(), &expected, "{column}");
    }
    for (column, words) in [
        ("", "choose the column of values"),
        (", column = 1", "column 1 holds the wavelengths"),
        (", column = 'nm'", "\"nm\" holds the wavelengths"),
        (", column = 4", "no column 4"),
        (", column = 0", "no column 0"),
        (", column = 'fat'", "no column \"fat\""),
    ] {
        let error = written(&format!("{{ file = 'x.csv'{column} }}")).reflectance(&base).unwrap_err();
        assert!(matches!(error, SpectrumError::Column { .. }), "{error:?}");
        let error = error.to_string();
        assert!(error.contains(words) && error.contains("x.csv") && error.contains("nm, skin, Bone"), "{error}");
    }
}

#[test]
fn a_bad_line_is_named_with_its_number_and_its_text() {
    let long = format!("400,{}", "x".repeat(500));
    for (contents, line, words) in [
        ("400,1\n500,abc\n", 2, "\"abc\" is not a number"),
        ("nm,v\nmore,header\n400,1\n", 2, "\"more\" is not a number"),
        ("400,1\n\n500\n", 3, "column 2 is missing"),
        ("400,1\n500,nan\n", 2, "must be finite"),
        ("400,1\n500,inf\n", 2, "must be finite"),
        ("400,1\n-500,1\n", 2, "positive number of nm"),
        ("400,1\n500,2\n400,1\n", 3, "400 nm was already given on line 1"),
        ("400\t0,5\n", 1, "\"0,5\" is not a number"),
        (&long, 1, "…"),
    ] {
        let (_keep, base) = folder(contents);
        let error = written("'x.csv'").light(&base).unwrap_err();
        let SpectrumError::Line { line: found, .. } = error else { panic!("{contents:?}: {error:?}") };
        let error = error.to_string();
        assert_eq!(found, line, "{error}");
        assert!(error.contains("x.csv") && error.contains(&format!("line {line}")) && error.contains(words), "{error}");
        assert!(error.len() < 400, "{error}");
    }
}

#[test]
fn files_that_are_no_spectra_are_refused() {
    let error_of = |contents: &[u8]| {
        let (_keep, base) = folder(contents);
        written("'x.csv'").reflectance(&base).unwrap_err()
    };
    for contents in [&b""[..], b"\n\n", b"# only a comment\n", b"wavelength,value\n"] {
        assert!(matches!(error_of(contents), SpectrumError::Empty { .. }), "{contents:?}");
    }
    for contents in [&b"\x89PNG\r\n\x1a\n\0\0\0"[..], b"400,1\0", b"\xff\xfe4\x000\x000\x00", b"400,\xb5\n"] {
        assert!(matches!(error_of(contents), SpectrumError::NotText { .. }), "{contents:?}");
    }
    assert!(matches!(error_of(&vec![b' '; 10_000_001]), SpectrumError::TooLarge { .. }));
    assert!(matches!(error_of(&vec![b' '; 10_000_000]), SpectrumError::Empty { .. }));
    let error = error_of(b"0.4 1\n0.7 1\n");
    assert!(matches!(error, SpectrumError::File { .. }), "{error:?}");
    assert!(error.source().unwrap().to_string().contains("micrometres"), "{error:?}");
}

#[test]
fn a_file_that_cannot_be_read_is_named() {
    let folder = TempDir::new().unwrap();
    let error = written("{ file = 'absent.csv' }").light(folder.path()).unwrap_err();
    assert!(matches!(error, SpectrumError::Read { .. }), "{error:?}");
    assert!(error.to_string().contains("absent.csv") && error.source().is_some(), "{error}");
    assert!(matches!(written("''").light(folder.path()), Err(SpectrumError::Read { .. })));

    let error = written("'D56'").light(folder.path()).unwrap_err();
    assert!(matches!(error, SpectrumError::Unknown { .. }), "{error:?}");
    assert!(error.to_string().contains("did you mean \"D65\"?"), "{error}");
}

#[test]
fn lights_finer_than_the_grid_are_averaged_and_reflectances_are_sampled() {
    // A line 1 nm wide between the grid's samples.
    let table = "{ 380 = 0, 546 = 0, 547 = 1, 548 = 0, 780 = 0 }";
    let light = written(table).light(Path::new("")).unwrap();
    assert!(light.spectrum().samples()[33] > 0.0);
    let reflectance = written(table).reflectance(Path::new("")).unwrap();
    assert_eq!(reflectance.spectrum(), &Spectrum::constant(0.0));
    // At the grid's own spacing nothing is averaged.
    let a = standard_spectrum("A");
    let rows: String = (0..BANDS).map(|band| format!("{} {}\n", wavelength_nm(band), a.samples()[band])).collect();
    let (_keep, base) = folder(rows);
    assert_eq!(written("'x.csv'").light(&base).unwrap(), standard::light("A").unwrap());
}

#[test]
fn every_written_form_is_understood() {
    let here = Path::new("");
    let reflectance = |toml: &str| written(toml).reflectance(here).unwrap().spectrum().clone();
    assert_eq!(reflectance("0.25"), Spectrum::constant(0.25));
    assert_eq!(reflectance("1"), Spectrum::constant(1.0));
    assert_eq!(reflectance("'dark skin'"), standard_spectrum("dark skin"));
    assert_eq!(
        reflectance("{ 400 = 0.1, \"500.5\" = 0.3, 600 = 1 }"),
        Spectrum::interpolate(&[(400.0, 0.1), (500.5, 0.3), (600.0, 1.0)]).unwrap()
    );
    let bell = Spectrum::gaussian(550.0, 20.0, 0.8).unwrap();
    let band = "{ centre = 550, sigma = 20, height = 0.8 }";
    assert_eq!(reflectance(&format!("{{ gaussian = [{band}] }}")), bell);
    assert_eq!(
        reflectance(&format!("{{ gaussian = [{band}, {band}], base = 0.05 }}")),
        &(&Spectrum::constant(0.05) + &bell) + &bell
    );
    assert_eq!(reflectance("{ srgb = '#ffffff' }"), Spectrum::constant(1.0));
    assert_eq!(reflectance("{ srgb = '#FF0000' }"), reflectance("{ linear_srgb = [1, 0, 0] }"));
    let samples: Vec<String> = (0..BANDS).map(|band| wavelength_nm(band).to_string()).collect();
    assert_eq!(reflectance(&format!("{{ samples = [{}] }}", samples.join(","))), Spectrum::from_fn(|nm| nm));

    let light = |toml: &str| written(toml).light(here).unwrap();
    assert_eq!(light("'D65'"), standard::light("D65").unwrap());
    assert_eq!(light("{ blackbody = 2856 }"), Light::blackbody(2856.0).unwrap());
    assert_eq!(light("'blackbody 2856K'"), Light::blackbody(2856.0).unwrap());
    assert_eq!(written("2").absorption(here).unwrap().spectrum(), &Spectrum::constant(1.0));
}

#[test]
fn the_command_line_writes_numbers_names_and_files() {
    assert_eq!("0.5".parse::<SpectrumSource>().unwrap(), SpectrumSource::Constant(0.5));
    for name in ["D65", "lamps/x.csv", "inf", ""] {
        assert_eq!(name.parse::<SpectrumSource>().unwrap(), SpectrumSource::Named(name.to_owned()));
    }
}

#[test]
fn a_wrongly_written_spectrum_is_refused_where_it_stands() {
    for (toml, words) in [
        ("true", "expected a spectrum: a number, a name"),
        ("[1, 2]", "expected a spectrum: a number, a name"),
        ("nan", "must be finite"),
        ("{}", "defines no spectrum"),
        ("{ blackbodi = 5000 }", "unknown key `blackbodi`"),
        ("{ blackbodi = 5000 }", "{ blackbody }"),
        ("{ blackbody = 5 }", "at least 100 K"),
        ("{ blackbody = 5000, srgb = '#ffffff' }", "`blackbody` and `srgb` exclude each other"),
        ("{ file = 'x', 400 = 1 }", "exclude each other"),
        ("{ srgb = '#ffffff', file = 'x' }", "exclude each other"),
        ("{ 400 = 1, column = 2 }", "`column` is only allowed with `file`"),
        ("{ column = 2 }", "defines no spectrum"),
        ("{ 400 = 1, base = 2 }", "`base` is only allowed with `gaussian`"),
        ("{ file = 'x', column = 1.5 }", "a column is a name or a number"),
        ("{ 546.1 = 0.5 }", "quote a wavelength"),
        ("{ 400 = 'x' }", "the value at a wavelength is a number"),
        ("{ 400 = 1, \"400.0\" = 1 }", "400 nm is given twice"),
        ("{ 0.4 = 1 }", "quote a wavelength"),
        ("{ 2000 = 1 }", "outside 380 to 780 nm"),
        ("{ srgb = 'red' }", "write \"#rrggbb\""),
        ("{ srgb = '#+12345' }", "write \"#rrggbb\""),
        ("{ linear_srgb = [1, 2] }", "invalid length 2"),
        ("{ linear_srgb = [9, 9, 9] }", "no reflectance between 0 and 1"),
        ("{ samples = [1, 2, 3] }", "3 samples are given"),
        ("{ gaussian = [{ centre = 550, sigma = 0.1, height = 1 }] }", "at least 2.5 nm"),
        ("{ gaussian = [{ center = 550, sigma = 20, height = 1 }] }", "unknown field `center`"),
        ("{ gaussian = [{ centre = 550, sigma = 20 }] }", "missing field `height`"),
    ] {
        let error = parsed(toml).unwrap_err();
        assert!(error.message().contains(words), "{toml}: {}", error.message());
        assert!(error.span().is_some(), "{toml}: no place");
    }
}

#[test]
fn a_spectrum_of_one_kind_is_not_used_as_another() {
    let here = Path::new("");
    let refused = [
        written("'D65'").reflectance(here).map(drop),
        written("'D65'").absorption(here).map(drop),
        written("'blackbody 3000'").reflectance(here).map(drop),
        written("{ blackbody = 3000 }").reflectance(here).map(drop),
        written("'dark skin'").light(here).map(drop),
        written("{ srgb = '#ff0000' }").light(here).map(drop),
    ];
    for result in refused {
        let error = result.unwrap_err();
        assert!(matches!(error, SpectrumError::WrongKind { .. }), "{error:?}");
    }
    let error = written("'D65'").reflectance(here).unwrap_err().to_string();
    assert_eq!(error, "D65 is a light, and cannot be used as a reflectance");
}
