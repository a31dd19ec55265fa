//! Tests of the picture comparison itself.
#![expect(clippy::unwrap_used, clippy::expect_used, reason = "a test fails by panicking")]

use crate::support;

use std::fs;
use std::path::Path;

use support::golden::{Golden, Image, NAMES, compare};
use support::tolerance::{STORED, Tolerance, rounding};

const SIZE: usize = 24;

/// A soft coloured spot, sampled `shift` pixels to the right.
fn picture(source: &str, shift: f64) -> Image {
    let at = |index: usize| f64::from(u32::try_from(index).unwrap());
    let sample = |pixel: usize, sharpness: f64| {
        let (x, y) = (at(pixel % SIZE) + shift - 12.0, at(pixel / SIZE) - 12.0);
        f64_to_f32((-sharpness * x.mul_add(x, y * y)).exp())
    };
    let pixel = |pixel| [0.01, 0.02, 0.03].map(|sharpness| sample(pixel, sharpness));
    Image::rgb(source, SIZE, SIZE, (0..SIZE * SIZE).flat_map(pixel).collect())
}

#[expect(clippy::cast_possible_truncation, reason = "pictures are f32")]
fn f64_to_f32(value: f64) -> f32 {
    value as f32
}

/// Golden images in the test's own folder.
fn golden<'a>(folder: &Path, bless: Option<&str>) -> Golden<'a> {
    let failures = folder.join("failures");
    Golden { folder: folder.join("golden"), failures, names: &["spot"], bless: bless.map(str::to_owned) }
}

/// Folder with the golden image `spot`.
fn blessed() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let said = golden(folder.path(), Some("spot")).check("spot", &picture("reference f64", 0.0), &STORED).unwrap_err();
    assert!(said.contains("was rewritten"), "{said}");
    folder
}

/// Failure message for the spot after `change`, which must be refused.
fn caught(tolerance: &Tolerance, change: impl FnOnce(&mut Image)) -> String {
    let folder = blessed();
    let mut image = picture("reference f32", 0.0);
    change(&mut image);
    golden(folder.path(), None).check("spot", &image, tolerance).expect_err("this should have been caught")
}

#[test]
fn a_picture_that_was_blessed_passes() {
    let folder = blessed();
    golden(folder.path(), None).check("spot", &picture("reference f64", 0.0), &STORED).unwrap();
    golden(folder.path(), None).check("spot", &picture("reference f32", 0.0), &rounding(512)).unwrap();
    assert!(!folder.path().join("failures").exists());
}

#[test]
fn one_wrong_pixel_is_caught_and_named() {
    let said = caught(&rounding(512), |image| image.samples[3 * (5 * SIZE + 7) + 1] += 2e-4);
    assert!(said.contains("worst at (7, 5) G"), "{said}");
}

#[test]
fn half_a_pixel_of_shift_is_caught() {
    let said = caught(&rounding(512), |image| *image = picture("reference f32", 0.5));
    assert!(said.contains("mean"), "{said}");
}

#[test]
fn swapped_channels_are_caught() {
    caught(&rounding(512), |image| image.samples.chunks_exact_mut(3).for_each(|pixel| pixel.swap(0, 2)));
    // The file identifies its channels by name.
    caught(&rounding(512), |image| image.channels.swap(0, 2));
    let said = caught(&rounding(512), |image| image.channels[0] = "X".to_owned());
    assert!(said.contains("pixels of X, G, B"), "{said}");
}

#[test]
fn a_value_that_is_no_number_is_caught_whatever_is_allowed() {
    let anything = Tolerance { largest: 1e300, mean: 1e300, usual: 1e300, exceptions: 1.0, ..rounding(1) };
    caught(&anything, |image| image.samples[0] = f32::NAN);
    caught(&rounding(512), |image| image.samples[0] = f32::NAN);
    let nothing = Tolerance { largest: f64::NAN, ..anything };
    caught(&nothing, |_| ());
}

#[test]
fn too_many_small_errors_are_caught() {
    let often = Tolerance { largest: 1.0, mean: 1.0, usual: 1e-3, exceptions: 0.01, ..rounding(1) };
    let said = caught(&often, |image| image.samples.iter_mut().take(20).for_each(|sample| *sample += 0.01));
    assert!(said.contains("20 of 1728 samples over"), "{said}");
    let lean = Tolerance { largest: 1.0, mean: 1e-5, usual: 1.0, exceptions: 0.0, ..rounding(1) };
    caught(&lean, |image| image.samples.iter_mut().for_each(|sample| *sample += 2e-5));
}

#[test]
fn errors_are_relative_to_the_scale_of_their_sample() {
    let double = |image: &mut Image| {
        image.samples[0] += 1e-3;
        let mut scale = vec![1.0; image.samples.len()];
        scale[0] = 100.0;
        image.scale = Some(scale);
    };
    let folder = blessed();
    let mut image = picture("reference f32", 0.0);
    double(&mut image);
    golden(folder.path(), None).check("spot", &image, &rounding(512)).unwrap();
    caught(&rounding(512), |image| {
        double(image);
        image.scale = Some(vec![1.0; 5]);
    });
}

#[test]
fn another_size_is_caught() {
    let said = caught(&rounding(512), |image| (image.width, image.height) = (SIZE / 2, SIZE * 2));
    assert!(said.contains("12×48 pixels"), "{said}");
    let said = caught(&rounding(512), |image| image.samples.truncate(9));
    assert!(said.contains("has 9 samples, not 1728"), "{said}");
}

#[test]
fn a_missing_golden_image_fails() {
    let folder = tempfile::tempdir().unwrap();
    let said = golden(folder.path(), None).check("spot", &picture("reference f64", 0.0), &STORED).unwrap_err();
    assert!(said.contains("BLESS=spot"), "{said}");
    let said = golden(folder.path(), None).check("stain", &picture("reference f64", 0.0), &STORED).unwrap_err();
    assert!(said.contains("NAMES"), "{said}");
    assert_eq!(golden(folder.path(), None).strays(), ["spot.exr is missing"]);
}

#[test]
fn one_picture_given_as_both_sides_is_caught() {
    let image = picture("reference f64", 0.0);
    assert!(compare(&image, &image, &STORED).unwrap_err().contains("with itself"));
    assert!(compare(&image, &image.clone(), &STORED).unwrap_err().contains("with itself"));
    let mut renamed = image.clone();
    renamed.source = "GPU".to_owned();
    compare(&image, &renamed, &STORED).unwrap();
}

#[test]
fn only_the_one_rung_writes() {
    let folder = blessed();
    let before = fs::read(folder.path().join("golden/spot.exr")).unwrap();
    let wrong = picture("reference f32", 0.5);
    golden(folder.path(), Some("spot")).check("spot", &wrong, &rounding(512)).unwrap_err();
    golden(folder.path(), Some("other")).check("spot", &wrong, &STORED).unwrap_err();
    assert_eq!(fs::read(folder.path().join("golden/spot.exr")).unwrap(), before);
    let mut hole = picture("reference f64", 0.0);
    hole.samples[0] = f32::NAN;
    golden(folder.path(), Some("spot")).check("spot", &hole, &STORED).unwrap_err();
    assert_eq!(fs::read(folder.path().join("golden/spot.exr")).unwrap(), before);
    golden(folder.path(), Some("spot")).check("spot", &wrong, &STORED).unwrap_err();
    assert_ne!(fs::read(folder.path().join("golden/spot.exr")).unwrap(), before);
}

#[test]
fn a_failure_leaves_what_one_needs_to_see_it() {
    let folder = blessed();
    golden(folder.path(), None).check("spot", &picture("reference f32", 0.5), &rounding(512)).unwrap_err();
    for name in ["actual", "expected", "difference"] {
        for kind in ["exr", "png"] {
            let path = folder.path().join(format!("failures/spot.rounding/{name}.{kind}"));
            assert!(fs::metadata(&path).is_ok_and(|file| file.len() > 0), "{}", path.display());
        }
    }
    let numbers = fs::read_to_string(folder.path().join("failures/spot.rounding/numbers.txt")).unwrap();
    assert!(numbers.contains("largest"), "{numbers}");
}

#[test]
fn strays_are_found() {
    let folder = blessed();
    assert_eq!(golden(folder.path(), None).strays(), [""; 0]);
    fs::write(folder.path().join("golden/old.exr"), b"").unwrap();
    assert_eq!(golden(folder.path(), None).strays(), ["old.exr is no golden image"]);
    let said = golden(folder.path(), Some("spto")).strays();
    assert_eq!(said, ["old.exr is no golden image", "BLESS=spto names no golden image"]);
}

#[test]
fn the_golden_images_are_those_on_the_list() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden");
    let failures = folder.clone();
    let strays = Golden { folder, failures, names: NAMES, bless: std::env::var("BLESS").ok() }.strays();
    assert_eq!(strays, [""; 0]);
}
