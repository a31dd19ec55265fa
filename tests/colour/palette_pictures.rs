//! Designed palettes in rendered pictures: matches, metameric blacks and constancy hold in every pixel, in the planned
//! model.
#![expect(clippy::print_stdout, reason = "a test shows what it measured")]

use crate::support;

use std::path::Path;

use glam::DVec3;
use relume::document;
use relume::document::SceneOptions;
use relume::progress::Quiet;
use relume::render::Renderer;
use relume::scene::Scene;
use relume::spectrum::colour::{Xyz, ciede2000, d65_white, lab_from_xyz};
use relume::spectrum::{Reflectance, Spectrum};
use support::rungs::{Rungs, in_xyz, with_renderer};

const SIZE: [usize; 2] = [40, 36];

/// Frog with the material `skin` outside and `inside` within, lit by the palette's lights.
fn frog(palette: &str, skin: &str, inside: &str, changes: &[&str]) -> Scene {
    let text = format!(
        r#"version = 1
        shading = "none"
        [palette]
        use = "{palette}.toml"
        [volume]
        phantom = "frog"
        dims = [40, 38, 24]
        [transfer]
        intervals = [
            {{ material = "{skin}", range = [20, 70], ramp = 10, opacity = 0.08 }},
            {{ material = "{inside}", range = [90, 255], ramp = 10, opacity = 0.9 }},
        ]
        "#
    );
    let options = SceneOptions {
        definitions: changes.iter().map(|&change| document::Definition::new(change)).collect(),
        ..SceneOptions::default()
    };
    document::parse(
        "the test's scene",
        &text,
        &Path::new(env!("CARGO_MANIFEST_DIR")).join("data/palettes"),
        &options,
        &Quiet,
    )
    .unwrap()
    .scene
}

/// Renders a scene under one of its lights.
type Seen<'a> = &'a dyn Fn(&Scene, &str) -> Vec<(DVec3, f64)>;

/// Runs `test` on pictures of the f32 reference over the stored tables, and on pictures of the GPU.
fn on_each_rung(test: impl Fn(Seen<'_>)) {
    test(&|scene, light| seen(scene, light, None));
    with_renderer(|renderer| test(&|scene, light| seen(scene, light, Some(renderer))));
}

/// XYZ and opacity of every pixel under one light alone.
fn seen(scene: &Scene, light: &str, renderer: Option<&Renderer>) -> Vec<(DVec3, f64)> {
    let mut scene = scene.clone();
    assert!(scene.lights.iter().any(|other| other.name == light), "there is no light {light}");
    for other in &mut scene.lights {
        other.intensity = if other.name == light { 1.0 } else { 0.0 };
    }
    let rungs = Rungs::new(scene, SIZE);
    let matrices = in_xyz(&rungs.matrices());
    let accumulation = match renderer {
        None => rungs.march::<f32>(&rungs.stored()),
        Some(renderer) => rungs.gpu(renderer),
    };
    accumulation.relight(&matrices).into_iter().zip(accumulation.opacity(&matrices)).collect()
}

/// ΔE00 of the opaque pixels, ascending.
fn differences(one: &[(DVec3, f64)], two: &[(DVec3, f64)]) -> Vec<f64> {
    let lab = |xyz: DVec3| lab_from_xyz(Xyz(xyz.to_array()), d65_white());
    let concerned = one.iter().zip(two).filter(|(one, two)| one.1.max(two.1) > 0.5);
    let mut differences: Vec<f64> = concerned.map(|(one, two)| ciede2000(lab(one.0), lab(two.0))).collect();
    assert!(differences.len() > 100, "{} pixels show anything", differences.len());
    differences.sort_by(f64::total_cmp);
    differences
}

fn largest(one: &[(DVec3, f64)], two: &[(DVec3, f64)]) -> f64 {
    *differences(one, two).last().unwrap()
}

fn p95(one: &[(DVec3, f64)], two: &[(DVec3, f64)]) -> f64 {
    let differences = differences(one, two);
    differences[differences.len() * 95 / 100]
}

/// Films of material weights, and films of the k coefficients of a planned colour model.
const KEPT: [&str; 2] = ["accuracy.accumulate=weights", "accuracy.accumulate=spectral"];

fn material(scene: &Scene, name: &str) -> usize {
    scene.materials.iter().position(|material| material.name == name).unwrap()
}

fn exchanged(scene: &Scene, one: &str, two: &str) -> Scene {
    let mut other = scene.clone();
    let (one, two) = (material(scene, one), material(scene, two));
    other.materials[one].reflectance = scene.materials[two].reflectance.clone();
    other.materials[two].reflectance = scene.materials[one].reflectance.clone();
    other
}

#[test]
fn metamers_can_be_exchanged_under_their_light_only() {
    on_each_rung(|seen| {
        for kept in KEPT {
            let scene = frog("metamers", "rock", "ore", &[kept]);
            let other = exchanged(&scene, "rock", "ore");
            let (merged, parted) = (
                largest(&seen(&scene, "day"), &seen(&other, "day")),
                p95(&seen(&scene, "bulb"), &seen(&other, "bulb")),
            );
            println!("{kept}: at most {merged:.4} under day, p95 {parted:.1} under bulb");
            assert!(merged < 1.0 && parted > 10.0);
            let scene = frog("metamers_two_lights", "rock", "ore", &[kept]);
            let other = exchanged(&scene, "rock", "ore");
            assert!(largest(&seen(&scene, "day"), &seen(&other, "day")) < 1.0);
            assert!(largest(&seen(&scene, "bulb"), &seen(&other, "bulb")) < 1.0);
            assert!(p95(&seen(&scene, "probe"), &seen(&other, "probe")) > 10.0);
        }
    });
}

#[test]
fn an_xray_material_turned_black_is_as_if_it_were_not_there() {
    on_each_rung(|seen| {
        for kept in KEPT {
            let with = frog("xray", "shell", "inside", &[kept, "materials.shell.xray=true"]);
            let without =
                frog("xray", "shell", "inside", &[kept, "materials.shell.xray=true", "transfer.intervals.0.opacity=0"]);
            let off = largest(&seen(&with, "removes"), &seen(&without, "removes"));
            println!("{kept}: {off:.4}");
            assert!(off <= 0.05);
            assert!(p95(&seen(&with, "day"), &seen(&without, "day")) > 1.0, "it shows under the other light");
        }
    });
}

#[test]
fn an_occluding_black_hides_as_much_as_nothing_of_its_opacity() {
    on_each_rung(|seen| {
        for kept in KEPT {
            for (palette, hides) in
                [("metameric_black", &["hides"][..]), ("metameric_black_two_lights", &["hides", "hides_too"])]
            {
                let black = frog(palette, "smoke", "core", &[kept]);
                let mut dark = black.clone();
                let smoke = material(&dark, "smoke");
                dark.materials[smoke].reflectance = Reflectance::new(Spectrum::constant(0.0)).unwrap();
                for light in hides {
                    let off = largest(&seen(&black, light), &seen(&dark, light));
                    println!("{palette} under {light}, {kept}: {off:.4}");
                    assert!(off <= 0.05);
                }
                let clear = frog(palette, "smoke", "core", &[kept, "transfer.intervals.0.opacity=0"]);
                assert!(p95(&seen(&black, hides[0]), &seen(&clear, hides[0])) > 1.0, "its opacity stays");
                assert!(p95(&seen(&black, "shows"), &seen(&dark, "shows")) > 10.0, "it shows under the other light");
            }
            let black = frog("negative", "smoke", "core", &[kept]);
            let mut dark = black.clone();
            let smoke = material(&dark, "smoke");
            dark.materials[smoke].reflectance = Reflectance::new(Spectrum::constant(0.0)).unwrap();
            assert!(largest(&seen(&black, "day"), &seen(&dark, "day")) <= 0.05);
            assert!(p95(&seen(&black, "shows"), &seen(&dark, "shows")) > 10.0);
        }
    });
}

#[test]
fn a_constant_material_stays_while_others_move() {
    on_each_rung(|seen| {
        let stays = frog("constancy", "block", "block", &[]);
        assert!(largest(&seen(&stays, "day"), &seen(&stays, "evening")) <= 1.0);
        let moves = frog("constancy", "valve", "pin", &[]);
        assert!(p95(&seen(&moves, "day"), &seen(&moves, "evening")) > 10.0);
    });
}

#[test]
fn each_light_shows_its_own_material() {
    on_each_rung(|seen| {
        let both = frog("one_light_each", "skin", "bone", &[]);
        let dark = |name: &str| {
            let mut scene = both.clone();
            let index = material(&scene, name);
            scene.materials[index].reflectance = Reflectance::new(Spectrum::constant(0.0)).unwrap();
            scene
        };
        for (light, shown, hidden) in [("for_skin", "skin", "bone"), ("for_bone", "bone", "skin")] {
            assert!(
                largest(&seen(&both, light), &seen(&dark(hidden), light)) <= 0.1,
                "{hidden} is black under {light}"
            );
            assert!(p95(&seen(&both, light), &seen(&dark(shown), light)) > 10.0, "{shown} shows under {light}");
        }
    });
}

#[test]
fn what_merges_with_the_background_leaves_no_trace() {
    on_each_rung(|seen| {
        let scene = frog("background", "tissue", "vessel", &[]);
        let empty = frog(
            "background",
            "tissue",
            "vessel",
            &["transfer.intervals.0.opacity=0", "transfer.intervals.1.opacity=0"],
        );
        assert!(largest(&seen(&scene, "merges"), &seen(&empty, "merges")) <= 0.1);
        assert!(p95(&seen(&scene, "parts"), &seen(&empty, "parts")) > 10.0);
    });
}

#[test]
fn daylight_merges_what_a_bulb_and_designed_lights_part() {
    on_each_rung(|seen| {
        let scene = frog("daylight_and_bulb", "flesh", "eyes", &[]);
        let other = exchanged(&scene, "flesh", "stomach");
        assert!(largest(&seen(&scene, "day"), &seen(&other, "day")) < 1.0);
        assert!(p95(&seen(&scene, "bulb"), &seen(&other, "bulb")) > 5.0);
        let blind = exchanged(&scene, "eyes", "heart");
        assert!(largest(&seen(&scene, "day"), &seen(&blind, "day")) < 1.0);
        assert!(p95(&seen(&scene, "marks_eyes"), &seen(&blind, "marks_eyes")) > 10.0);
    });
}
