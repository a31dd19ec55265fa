//! The CIE 1964 observer and the 1931 observer: colours, and which data depends on the observer.

use crate::support;

use glam::DVec3;
use relume::film::display_from_xyz;
use relume::model::{ColourModel, Ingredients, ModelKind, fit, unseen};
use relume::plan::plan;
use relume::progress::Quiet;
use relume::scene::{Display, Mix, MixLight};
use relume::spectrum::colour::{
    LINEAR_SRGB_FROM_XYZ, Xyz, bradford, ciede2000, d65_white, lab_from_xyz, linear_srgb_from_xyz,
};
use relume::spectrum::observer::{OBSERVER_1964, Observer};
use relume::spectrum::{Light, Spectrum, standard};
use support::exr::Exr;
use support::program::Folder;
use support::rungs::Rungs;
use support::scenes::{self, SIZE};

/// XYZ of a light from the published table.
fn published(light: &Light) -> [f64; 3] {
    OBSERVER_1964.each_ref().map(|matching| matching.dot(light.spectrum()))
}

/// CIE 15; daylight is summed at 1 nm from 360 to 830 nm, from which the grid differs by 2.3e-5.
const CHROMATICITIES: [(&str, [f64; 2], f64); 8] = [
    ("A", [0.45117, 0.40594], 0.6e-5),
    ("D50", [0.34773, 0.35952], 0.6e-5),
    ("D65", [0.31382, 0.33100], 2.4e-5),
    ("LED-B1", [0.46250, 0.40304], 0.6e-5),
    ("LED-B3", [0.38085, 0.36852], 0.6e-5),
    ("LED-B5", [0.31692, 0.32206], 0.6e-5),
    ("LED-RGB1", [0.45704, 0.42538], 0.6e-5),
    ("LED-V1", [0.45360, 0.39820], 0.6e-5),
];

#[test]
fn lights_have_the_chromaticities_that_are_published_for_1964() {
    for (name, [x, y], limit) in CHROMATICITIES {
        let white = published(&standard::light(name).unwrap());
        let sum: f64 = white.iter().sum();
        let found = [white[0] / sum, white[1] / sum];
        assert!((found[0] - x).abs() <= limit && (found[1] - y).abs() <= limit, "{name}: {found:?}");
    }
}

#[test]
fn daylight_is_white_to_both_and_other_lights_are_what_bradford_makes_of_them() {
    assert_eq!(Observer::Cie1931.xyz_of(standard::d65().spectrum()), d65_white(), "the table itself");
    let white = DVec3::from(Observer::Cie1964.xyz_of(standard::d65().spectrum()).0);
    assert!(white.abs_diff_eq(DVec3::from(d65_white().0), 1e-14), "{white}");
    let daylight = published(standard::d65());
    for (name, ..) in CHROMATICITIES {
        let light = standard::light(name).unwrap();
        let adapted = bradford(Xyz(daylight.map(|part| part / daylight[1])), d65_white());
        let expected = adapted * DVec3::from(published(&light)) / daylight[1];
        let found = DVec3::from(Observer::Cie1964.xyz_of(light.spectrum()).0);
        assert!(found.abs_diff_eq(expected, 1e-13), "{name}: {found}, {expected}");
    }
}

#[test]
fn where_the_eye_adapts_the_white_of_a_light_is_that_of_the_screen_to_either_observer() {
    let light = standard::light("A").unwrap();
    let mix = Mix(vec![MixLight { name: "lamp".to_owned(), spectrum: light.clone(), weight: 0.7, position: 0 }]);
    for observer in Observer::ALL {
        let display = Display { adapt: true, observer, ..Display::default() };
        let seen = DVec3::from(observer.xyz_of(light.spectrum()).0);
        let shown = display_from_xyz(&mix, &display) * (seen / seen.y);
        let white = DVec3::from(linear_srgb_from_xyz(d65_white()).0);
        assert!(shown.abs_diff_eq(white, 1e-13), "{observer}: {shown}");
        // Expected result: Bradford adaptation from the light's own white to D65, independent of daylight.
        let own = bradford(Xyz(published(&light).map(|part| part / published(&light)[1])), d65_white());
        let direct = *LINEAR_SRGB_FROM_XYZ * own * DVec3::from(published(&light)) / published(&light)[1];
        assert!(observer == Observer::Cie1931 || shown.abs_diff_eq(direct, 1e-13), "{observer}: {shown}, {direct}");
    }
}

fn difference(one: [f64; 3], two: [f64; 3]) -> f64 {
    let [one, two] = [one, two].map(|xyz| lab_from_xyz(Xyz(xyz), d65_white()));
    ciede2000(one, two)
}

fn ingredients() -> Ingredients {
    let patch = |name| standard::reflectance(name).unwrap().spectrum().clone();
    Ingredients {
        reflectances: vec![patch("orange"), patch("foliage"), patch("cyan")],
        absorptions: vec![Spectrum::gaussian(520.0, 30.0, 1.0).unwrap()],
        lights: ["A", "FL11"].map(|name| (name.to_owned(), standard::light(name).unwrap())).to_vec(),
        largest_depth: 3.0,
        ..Ingredients::default()
    }
}

#[test]
fn a_model_fitted_for_another_observer_reports_the_errors_that_it_has_and_comes_back_to_the_bit() {
    for kind in [ModelKind::Nodes, ModelKind::Bands, ModelKind::Peercy, ModelKind::Rgb] {
        let dimension = if kind.is_rgb() { 3 } else { 6 };
        let mut model = fit(&ingredients(), kind, dimension, &Quiet).unwrap();
        model.check_on(&unseen(&ingredients()).unwrap()).unwrap();
        let seen = model.seen_by(Observer::Cie1964).unwrap();
        assert_eq!((seen.observer(), seen.cloud_vectors()), (Observer::Cie1964, model.cloud_vectors()), "{kind}");
        for (name, light, matrix) in seen.lights() {
            assert_ne!(*matrix, model.matrix(light), "{kind}, {name}");
            assert_eq!(matrix.xyz, model.matrix_for(light, Observer::Cie1964).xyz, "{kind}, {name}");
            let errors = seen.cloud().iter().zip(seen.cloud_vectors()).map(|(spectrum, vector)| {
                let made = (0..3).map(|axis| matrix.xyz.iter().zip(vector).map(|(xyz, part)| xyz[axis] * part).sum());
                let made: Vec<f64> = made.collect();
                let exact = Observer::Cie1964.xyz_of(&(light.spectrum() * spectrum)).0;
                difference([made[0], made[1], made[2]], exact)
            });
            let largest = errors.fold(0.0, f64::max);
            assert!((matrix.error.max - largest).abs() <= 1e-9, "{kind}, {name}: {:?}, {largest}", matrix.error);
            assert!(matrix.unseen.is_some(), "{kind}, {name}");
        }
        assert_eq!(seen.seen_by(Observer::Cie1931).unwrap(), model, "{kind}");
    }
    let full = ColourModel::full_spectrum();
    let light = standard::light("FL2").unwrap();
    let sum = full.matrix_for(&light, Observer::Cie1964).xyz.into_iter().map(DVec3::from).sum::<DVec3>();
    let white = DVec3::from(Observer::Cie1964.xyz_of(light.spectrum()).0);
    assert!(sum.abs_diff_eq(white, 1e-13), "{sum}, {white}");
}

#[test]
fn a_picture_for_1964_is_near_its_own_truth_and_the_plan_does_not_ask_who_looks() {
    for name in ["coloured_background", "unshaded_three"] {
        let mut scene = scenes::named(name);
        let usual = plan(&scene, &Quiet).unwrap();
        scene.display.observer = Observer::Cie1964;
        let rungs = Rungs::new(scene.clone(), SIZE);
        assert_eq!((&rungs.planned.plan, &rungs.planned.materials), (&usual.plan, &usual.materials), "{name}");
        let limit = rungs.planned.model.as_ref().map_or(1e-6, |model| {
            assert_eq!(model.observer(), Observer::Cie1964);
            model.worst().max
        });
        let shown = rungs.lit(&rungs.exact());
        let (mut worst, mut moved) = (0.0_f64, 0.0_f64);
        let as_before = {
            scene.display.observer = Observer::Cie1931;
            Rungs::new(scene, SIZE).truth()
        };
        for (((shown, _), truth), before) in shown.iter().zip(rungs.truth()).zip(as_before) {
            worst = worst.max(difference(shown.to_array(), truth.to_array()));
            moved = moved.max(difference(truth.to_array(), before.to_array()));
        }
        assert!(worst <= limit, "{name}: ΔE00 {worst} of {limit}");
        assert!(moved > 0.5, "{name}: the observers see ΔE00 {moved}");
    }
}

/// Largest difference of two linear pictures.
fn apart(folder: &Folder, names: [&str; 2]) -> f32 {
    let [one, two] = names.map(|name| Exr::read(&folder.path(name)).rgba());
    assert_eq!(one.len(), two.len(), "pictures of one size");
    one.iter().zip(&two).map(|(one, two)| (one - two).abs()).fold(0.0, f32::max)
}

#[test]
fn accumulators_are_relit_for_the_observer_that_they_say_and_for_the_one_that_is_asked_for() {
    let folder = Folder::new();
    for kept in ["weights", "spectral"] {
        let accumulate = format!("accuracy.accumulate=\"{kept}\"");
        let render = |output: &[&str], year: &str| {
            let year = format!("display.observer=\"{year}\"");
            let asked = ["render", "scene.toml", "--size", "24x24", "-D", &accumulate, "-D", &year];
            folder.done(&[&asked, output].concat());
        };
        render(&["-o", "1931.exr", "--accumulators", "a1931.exr"], "1931");
        render(&["-o", "1964.exr", "--accumulators", "a1964.exr"], "1964");
        assert!(apart(&folder, ["1931.exr", "1964.exr"]) > 0.005, "{kept}: they see differently");
        for (file, flags, like) in [
            ("a1931.exr", &[][..], "1931.exr"),
            ("a1964.exr", &[], "1964.exr"),
            ("a1931.exr", &["--observer", "1964"], "1964.exr"),
            ("a1964.exr", &["--observer", "1931"], "1931.exr"),
        ] {
            folder.done(&[&["relight", file, "-o", "relit.exr"], flags].concat());
            let apart = apart(&folder, ["relit.exr", like]);
            assert!(apart <= 1e-5, "{kept}, {file} {flags:?}: {apart}");
        }
    }
    folder.refused(
        2,
        &["relight", "a1964.exr", "-o", "q.exr", "--observer", "1951"],
        &["the observers are 1931, 1964"],
    );
}
