//! Counts of `relume bench` and of the instrument for features; timings are not tested.

#[path = "../../benches/instruments/needs.rs"]
#[allow(dead_code, reason = "the tests use a part of the instrument")]
mod needs;
use crate::support;

use std::sync::Arc;

use needs::{NeedRow, need_rows};
use relume::progress::Quiet;
use relume::scene::Scene;
use relume::volume::phantom;
use serde_json::Value;
use support::program::Folder;
use support::rungs::{Rungs, with_renderer};
use support::scenes::{self, SIZE};

/// Dispatches, marches and bytes of a relight of `scene`.
fn relight(scene: Scene) -> [u64; 3] {
    let rungs = Rungs::new(scene, SIZE);
    let mut found = [0; 3];
    with_renderer(|renderer| {
        let accumulators = rungs.gpu_accumulators(renderer);
        let relight = renderer.relight_display(&accumulators).unwrap();
        let before = [renderer.device().dispatches(), renderer.marches()];
        relight.run(&rungs.matrices()).unwrap();
        let after = [renderer.device().dispatches(), renderer.marches()];
        found = [after[0] - before[0], after[1] - before[1], relight.bytes()];
    });
    found
}

/// The scene `diffuse_one` after `change`.
fn changed(change: impl FnOnce(&mut Scene)) -> Scene {
    let mut scene = scenes::named("diffuse_one");
    change(&mut scene);
    scene
}

/// A pixel's four weights (three materials) and the picture's four bytes; without a background the transmittance is not
/// read. The matrices: 48 bytes of header, 64 of transmittance, 48 per position.
#[test]
fn a_relight_is_one_dispatch_and_costs_the_same_whatever_was_marched() {
    let pixels = (SIZE[0] * SIZE[1]) as u64;
    let expected = [1, 0, pixels * (16 + 4) + 48 + 64 + 48];
    assert_eq!(relight(changed(|_| {})), expected);
    let others: [(&str, Scene); 4] = [
        (
            "a volume of other dimensions",
            changed(|scene| scene.set_volume(Arc::new(phantom::slab([9, 7, 5], 200).unwrap()))),
        ),
        ("a shorter step", changed(|scene| scene.accuracy.step_length /= 3.0)),
        (
            "other opacities",
            changed(|scene| {
                for term in &mut scene.transfer.terms {
                    term.opacity.iter_mut().for_each(|point| point.1 *= 0.1);
                }
            }),
        ),
        (
            "five lights more at the same position",
            changed(|scene| {
                for number in 0..5 {
                    let mut light = scene.lights[0].clone();
                    light.name = format!("another {number}");
                    scene.lights.push(light);
                }
            }),
        ),
    ];
    for (what, scene) in others {
        assert_eq!(relight(scene), expected, "{what}");
    }
}

fn measured(folder: &Folder, arguments: &[&str]) -> Value {
    let small = ["--size", "16x16", "--frames", "1", "-D", "volume.dims=[62,58,34]", "--json"];
    folder.done(&[&["bench"], arguments, &small].concat()).json()
}

#[test]
fn the_papers_table_and_its_ratios_come_from_one_command() {
    let folder = Folder::new();
    let json = measured(&folder, &["paper", "-o", "costs.html"]);
    let rows = json["rows"].as_array().unwrap();
    let lines: Vec<&str> = rows.iter().map(|row| row["line"].as_str().unwrap()).collect();
    assert_eq!(lines, ["RGB", "spectra, 4 weights", "spectra, k = 8", "coloured RGB", "coloured spectra, k = 8"]);
    // Per pixel, one vector of f32 and four bytes of transmittance; two vectors for k = 8; if coloured, as many for the
    // transmittance.
    let bytes: Vec<u64> = rows.iter().map(|row| row["counts"]["pixel_bytes"].as_u64().unwrap()).collect();
    assert_eq!(bytes, [20, 20, 36, 32, 64]);
    for row in rows {
        let counts = &row["counts"];
        assert_eq!((&counts["relight_dispatches"], &counts["relight_marches"]), (&1.into(), &0.into()), "{row}");
    }
    assert!(json["device"]["driver"].is_string() && json["interrupted"] == false);
    let page = std::fs::read_to_string(folder.path("costs.html")).unwrap();
    assert!(page.contains("1.29") && page.contains("spectra, k = 8") && !page.contains("<script"), "{page}");
}

/// Amplification by absorption in RGB is a property of the plan, whatever the number of frames and cases.
#[test]
fn what_would_amplify_is_warned_of_once_a_plan() {
    let folder = Folder::new();
    let small = ["--size", "16x16", "--frames", "2", "-D", "volume.dims=[62,58,34]"];
    let bench = |more: &[&str]| folder.done(&[&["bench", "paper", "paper"], &small[..], more].concat()).err;
    let said = bench(&[]);
    let warned: Vec<&str> = said.lines().filter(|line| line.contains("would amplify light")).collect();
    assert_eq!(warned.len(), 1, "{said}");
    assert_eq!(bench(&["-q"]), "");
}

#[test]
fn cost_is_measured_over_k_positions_pixels_and_voxels() {
    let folder = Folder::new();
    let json = measured(&folder, &["scaling", "--largest", "64"]);
    let rows = json["rows"].as_array().unwrap();
    let bytes = |name: &str, line: &str, count: &str| -> Vec<[u64; 2]> {
        let of = |row: &&Value| row["varied"]["name"] == name && row["line"] == line;
        let pair = |row: &Value| [row["varied"]["value"].as_u64().unwrap(), row["counts"][count].as_u64().unwrap()];
        rows.iter().filter(of).map(pair).collect()
    };
    // ⌈k/4⌉ vectors of 16 bytes, and 4 bytes of transmittance; if coloured, as many vectors of it.
    let by_k = [1, 2, 3, 4, 6, 8, 12, 16];
    assert_eq!(bytes("k", "grey", "pixel_bytes"), by_k.map(|k: u64| [k, 16 * k.div_ceil(4) + 4]));
    assert_eq!(bytes("k", "coloured", "pixel_bytes"), by_k.map(|k: u64| [k, 32 * k.div_ceil(4)]));
    // Each position has its own accumulators; the transmittance is shared.
    let by_position = [1, 2, 4, 8].map(|positions: u64| [positions, 16 * positions + 4]);
    assert_eq!(bytes("positions", "grey, 4 weights", "pixel_bytes"), by_position);
    assert_eq!(bytes("pixels", "grey, 4 weights", "pixel_bytes"), [[256, 20]]);
    // 8 bytes per voxel: value and gradient.
    assert_eq!(bytes("voxels", "grey, 4 weights", "volume_bytes"), [[64 * 64 * 64, 8 * 64 * 64 * 64]]);
}

#[test]
fn an_earlier_run_is_kept_to_within_the_budget() {
    let folder = Folder::new();
    let peer = ["peer", "--shading", "none"];
    let mut before = measured(&folder, &peer);
    let against = |stored: &Value, more: &[&str]| {
        std::fs::write(folder.path("before.json"), stored.to_string()).unwrap();
        let small = ["--size", "16x16", "--frames", "1", "-D", "volume.dims=[62,58,34]", "--json"];
        folder.run(&[&["bench"], &peer[..], &["--against", "before.json"], more, &small].concat())
    };
    // Times of small pictures mean nothing, so their budget is a millionfold; that still refuses bytes where there were
    // none.
    let ample = ["--budget-percent", "1e8"];
    let outcome = against(&before, &ample);
    assert_eq!(outcome.code, Some(0), "{}", outcome.err);
    let json = outcome.json();
    assert_eq!((&json["against"]["compared"], &json["holds"]), (&1.into(), &true.into()));
    before["rows"][0]["counts"]["volume_bytes"] = 0.into();
    let outcome = against(&before, &ample);
    assert_eq!(outcome.code, Some(1), "more bytes than there were");
    assert_eq!(outcome.json()["against"]["dearer"][0]["what"], "bytes of the volume");

    before["rows"][0]["device"] = "another".into();
    against(&before, &ample).assert_refused(1, &["before.json: its times are from another,"]);
    before["rows"][0]["device"] = Value::Null;
    before["rows"][0]["id"] = "something else".into();
    against(&before, &ample).assert_refused(1, &["before.json: it has no row of this run"]);
    against(&Value::Null, &ample).assert_refused(1, &["before.json", "no rows"]);
    // Reported before the measurement: this scene could not be measured.
    let nothing = ["bench", "default", "--against", "nothing.json", "-D", "volume.dims=[0,0,0]"];
    folder.refused(1, &nothing, &["--against nothing.json", "`relume bench --json`"]);
    folder.refused(2, &["bench", "load", "--against", "before.json"], &["--against has no effect"]);
    folder.refused(2, &["bench", "peer", "-o", "costs.txt"], &["costs.txt", ".html"]);
}

/// For every feature: the plan with it differs only in that feature; without it, only the cost that the feature saves
/// rises, and the picture equals that of a plan with all features.
#[test]
fn a_scene_pays_only_for_what_it_uses() {
    let mut rows = Vec::new();
    with_renderer(|renderer| rows = need_rows(renderer, &Quiet).unwrap());
    for row in &rows {
        let name = row.name;
        assert!(row.differs_in_it_alone, "{name}");
        let NeedRow { picture_difference, picture_limit, .. } = row;
        assert!(picture_difference <= picture_limit, "{name}: {picture_difference} > {picture_limit}");
        let saves: &[&str] = match name {
            "empty-space skipping" => &["samples"],
            "central gradients" => &["bytes of the volume"],
            // Numbers are stored as they are summed up.
            "pixels in 32 bits" => &["dispatches"],
            _ => &[],
        };
        assert_eq!(row.saves, saves, "{name}");
        let dearer = row.without.named().into_iter().zip(row.with.named()).any(|(without, with)| with.1 > without.1);
        assert!(dearer, "{name} costs nothing");
    }
    assert!(rows.len() > 10, "every feature has a row");
}

#[test]
fn a_coarser_level_is_refused_by_name() {
    let small = ["-D", "volume.dims=[8,8,8]", "--size", "16x16", "--frames", "1"];
    let level = ["bench", "default", "-D", "accuracy.voxel_pixels=1"];
    Folder::new().refused(2, &[&level[..], &small].concat(), &["accuracy.voxel_pixels", "relume measure"]);
}

#[test]
fn a_first_picture_is_timed_by_stages() {
    let ball = |index: i32| {
        let [x, y, z] = [index % 12 - 6, index / 12 % 10 - 5, index / 120 - 4];
        u8::try_from(200 - 5 * (x * x + y * y + z * z)).unwrap_or(0)
    };
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 12 10 8\nencoding: raw\n\n";
    let voxels: Vec<u8> = header.bytes().chain((0..12 * 10 * 8).map(ball)).collect();
    let folder = Folder::new().with("ball.nrrd", voxels);
    let first = ["bench", "first", "--volume", "ball.nrrd", "--size", "16x16", "--frames", "2"];
    let json = folder.done(&[&first[..], &["--json"]].concat()).json();
    let stages = json["first"]["stages"].as_array().unwrap();
    let names: Vec<&str> = stages.iter().map(|stage| stage["name"].as_str().unwrap()).collect();
    let expected =
        ["reading", "statistics", "guess", "scene", "plan", "device", "upload", "march", "relight", "writing"];
    assert_eq!(names, expected);
    assert!(stages.iter().all(|stage| stage["times"]["wall_ms"]["median"].as_f64() >= Some(0.0)), "{stages:?}");
    assert!(json["first"]["startup_ms"].as_f64().unwrap() > 0.0);
    // In a picture of 16 × 16 pixels, to a pixel at either end.
    let spans: Vec<f64> = json["first"]["spans"].as_array().unwrap().iter().map(|it| it.as_f64().unwrap()).collect();
    assert!((spans[0].max(spans[1]) - 0.9).abs() <= 2.0 / 16.0, "{spans:?}");
    assert!(folder.done(&first).out.contains("ball.nrrd, first picture of 16×16 pixels"));
    folder.refused(2, &["bench", "first"], &["first needs --volume"]);
    folder.refused(2, &["bench", "first", "--volume", "scene.toml"], &["scene.toml", "without a scene"]);
}
