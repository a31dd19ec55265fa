//! Exposure from a picture, the curve near white, and the backdrop (docs/theory/tone.md).
#![expect(clippy::float_cmp, reason = "numbers that pass unchanged")]

use relume::film::automatic_exposure;
use relume::scene::{Backdrop, Display, Mix, MixLight, Tone};
use relume::spectrum::colour::decode_srgb;
use relume::spectrum::{Light, Spectrum};

/// A light that shows a white surface with this luminance.
fn mix(weight: f64) -> Mix {
    let spectrum = Light::new(Spectrum::constant(1.0)).unwrap();
    Mix(vec![MixLight { name: "even".to_owned(), spectrum, weight, position: 0 }])
}

fn grey(luminance: f32, opacity: f32) -> [f32; 4] {
    [luminance, luminance, luminance, opacity]
}

/// The exposure of pixels with a white surface of luminance 1 and of `weight`.
fn found(pixels: &[[f32; 4]], weight: f64) -> f64 {
    automatic_exposure(pixels.as_flattened(), &mix(weight), &Display::default())
}

#[test]
fn an_automatic_exposure_makes_97_percent_of_the_object_darker_than_0_72() {
    // Luminances 1/1000 to 1, of which 970 are below 0.97; the surroundings, however bright, do not count.
    let ramp: Vec<[f32; 4]> = (1..=1000_u16).map(|n| grey(f32::from(n) / 1000.0, 1.0)).collect();
    let surroundings = vec![grey(50.0, 0.0); 5000];
    let exposure = found(&[ramp, surroundings].concat(), 1.0);
    assert!((exposure * 0.97 / 0.72 - 1.0).abs() < 0.02, "{exposure}");
    // An object of two halves, one of them nearly transparent.
    let halves = [vec![grey(0.4, 1.0); 100], vec![grey(4.0, 0.02); 100]].concat();
    assert!((found(&halves, 1.0) * 0.4 / 0.72 - 1.0).abs() < 0.02, "by opacity");
}

#[test]
fn dark_objects_are_brightened_to_a_limit_and_darkness_is_not() {
    assert_eq!(found(&[grey(0.01, 1.0)], 1.0), 3.0);
    assert!((found(&[grey(0.01, 1.0)], 1e-3) - 72.0).abs() < 1.5, "under a dim light");
    assert!((found(&[grey(1e6, 1.0)], 1e6) / 0.72e-6 - 1.0).abs() < 0.02, "under a bright one");
    for dark in [&[grey(0.0, 1.0)][..], &[grey(0.5, 0.0)], &[grey(f32::NAN, 1.0)], &[]] {
        assert_eq!(found(dark, 1.0), 1.0);
    }
    assert_eq!(found(&[grey(0.5, 1.0)], 0.0), 1.0, "no light");
}

#[test]
fn a_soft_tone_keeps_ratios_rises_and_stays_below_one() {
    let mut before = 0.0;
    for level in 0..4000_u16 {
        let bright = (f32::from(level) / 250.0).exp2() - 1.0;
        let mut pixel = [bright, 0.5 * bright, -0.1 * bright, 0.3];
        Tone::Soft.show(&mut pixel);
        let [red, green, blue, opacity] = pixel;
        assert!(red >= before - 1e-6 && red <= bright && red < 1.0 + 1e-6, "{bright}: {red}");
        assert!((green - 0.5 * red).abs() <= 1e-6 && (blue + 0.1 * red).abs() <= 1e-6, "{bright}: {pixel:?}");
        assert_eq!(opacity, 0.3);
        if bright <= 0.75 {
            assert_eq!(red, bright, "below the knee");
        }
        before = red;
    }
    let shown = |bright: f32| {
        let mut pixel = grey(bright, 1.0);
        Tone::Soft.show(&mut pixel);
        pixel[0]
    };
    assert!((shown(1.0) - 7.0 / 8.0).abs() < 1e-6 && (shown(2.0) - 23.0 / 24.0).abs() < 1e-6);
    assert!(shown(f32::INFINITY) >= 1.0 && shown(f32::NAN).is_nan() && shown(-1.0) == -1.0);
}

#[test]
fn a_backdrop_shows_through_what_is_transparent() {
    let colours = Backdrop::Dark.colours().unwrap();
    let mut column = [[0.0; 4], grey(0.25, 0.5), grey(0.5, 1.0)].concat();
    Backdrop::behind(colours, &mut column, 1);
    let rows = column.as_chunks::<4>().0;
    let linear = |row: [f64; 3]| row.map(decode_srgb);
    for (channel, top) in linear(colours[0]).into_iter().enumerate() {
        assert!((f64::from(rows[0][channel]) - top).abs() < 1e-7, "the top as it is");
        let middle = f64::midpoint(top.sqrt(), linear(colours[1])[channel].sqrt()).powi(2);
        assert!((f64::from(rows[1][channel]) - (0.25 + 0.5 * middle)).abs() < 1e-7, "half of it");
        assert_eq!(rows[2][channel], 0.5, "none of it");
    }
    assert!(rows.iter().all(|row| row[3] == 1.0), "opaque");
}
