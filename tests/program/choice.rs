//! Choice of settings: goals are met at little more than the least cost, and settings are measured once.

#[path = "../../benches/instruments/goals.rs"]
#[allow(dead_code, reason = "the tests use a part of the instrument")]
mod goals;
use crate::support;

use std::path::Path;
use std::time::Duration;

use goals::{GoalCost, GoalRow, GoalScene, GoalSummary, goal_row};
use relume::measure::{
    Choice, Goal, Limit, MeasureError, Patience, Pixels, Preset, Setting, Value, Wanted, check, check_within,
    choose_within,
};
use relume::plan::plan;
use relume::progress::Quiet;
use relume::render::Renderer;
use relume::scene::{Mix, Scene};
use relume::view::effort;
use relume::vulkan::Format;
use serde_json::json;
use support::device::open;
use support::exr::{Exr, assert_same};
use support::program::Folder;
use support::rungs::{Rungs, with_renderer};

const SIZE: [usize; 2] = [64, 56];

/// Request for any setting that meets `goal` for a test picture.
fn wanted(goal: Goal) -> Wanted {
    Wanted { size: SIZE, goal, pixels: Pixels::Fewer }
}

/// A search without a limit of time, which other programs cannot cut short.
fn choose(
    renderer: &Renderer,
    scene: &Scene,
    mix: &Mix,
    wanted: Wanted,
    cache: Option<&Path>,
    progress: &Quiet,
) -> Result<Choice, MeasureError> {
    choose_within(renderer, scene, mix, (wanted, Patience::ENDLESS), cache, progress)
}

fn scene(seed: u64) -> Scene {
    GoalScene::new(seed).unwrap().scene
}

fn step(choice: &Choice) -> f64 {
    match choice.setting.get("step") {
        Some(Value::Number(step)) => step,
        other => panic!("a step is chosen, not {other:?}"),
    }
}

/// Three random scenes; `cargo bench --bench instruments -- goals --scenes 50` does the same for 50.
#[test]
fn what_was_asked_for_is_kept_at_little_more_than_it_must_cost() {
    const SCENES: u64 = 3;
    let row = |renderer: &Renderer, seed| goal_row(renderer, &GoalScene::new(seed).unwrap(), &Quiet).unwrap();
    with_renderer(|renderer| {
        let rows: Vec<GoalRow> = (0..SCENES).filter_map(|seed| row(renderer, seed)).collect();
        assert!(rows.len() as u64 * 2 > SCENES, "most scenes show something");
        assert!(rows.iter().filter(|row| row.error() > 1.0).count() <= 1, "{rows:?}");
        // Times of small pictures depend on other programs; sample counts do not.
        assert!(rows.iter().all(|row| row.time() >= 1.0 && row.samples >= 1.0), "{rows:?}");
        let found = GoalSummary::of(&rows).unwrap();
        assert!(found.samples.max <= 1.3, "{found:?}");
    });
}

/// The transmittances of coloured absorption need not add up to 1 in empty pixels.
#[test]
fn pixels_that_show_nothing_are_not_looked_at() {
    let scene = scene(1015);
    let empty = vec![0.0; 4 * SIZE[0] * SIZE[1]];
    let checked = check(&scene, &Mix::of_scene(&scene), SIZE, &empty, &Quiet).unwrap().unwrap();
    assert!(checked.pixels < SIZE[0] * SIZE[1] / 2, "it has an empty border: {}", checked.pixels);
    assert!(checked.difference.delta_e.p95 > 1.0, "{checked:?}");
}

#[test]
fn what_was_measured_once_is_not_measured_again() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(0);
    let mix = Mix::of_scene(&scene);
    with_renderer(|renderer| {
        let choose = |goal| choose(renderer, &scene, &mix, wanted(goal), Some(folder.path()), &Quiet).unwrap();
        let first = choose(Goal::MaxError(2.0));
        assert!(!first.from_cache);
        let second = choose(Goal::MaxError(2.0));
        assert_eq!(second, Choice { from_cache: true, ..first.clone() });
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "one file, and nothing unfinished");
        let closer = choose(Goal::MaxError(1.0));
        assert!(step(&closer) <= step(&first), "{} for less error than {}", closer.setting, first.setting);
    });
}

#[test]
fn a_search_and_a_check_without_time_find_less_and_say_so() {
    let scene = scene(0);
    let mix = Mix::of_scene(&scene);
    with_renderer(|renderer| {
        let within = |frames, least_ms| {
            let goal = (wanted(Goal::MaxError(5.0)), Patience { frames, least_ms });
            choose_within(renderer, &scene, &mix, goal, None, &Quiet).unwrap()
        };
        let (hasty, patient) = (within(0.0, 0.0), within(1e9, 1e12));
        assert!(hasty.point.at_most <= 5.0, "{}", hasty.why);
        assert!(hasty.why.contains("did not try") && !hasty.untried.is_empty(), "{}", hasty.why);
        assert!(patient.untried.is_empty() && hasty.tried.len() < patient.tried.len(), "{} {}", hasty.why, patient.why);
    });
    let black = vec![0.0; 4 * SIZE[0] * SIZE[1]];
    let all = check(&scene, &mix, SIZE, &black, &Quiet).unwrap().unwrap();
    let some = check_within(&scene, &mix, SIZE, &black, Limit(0.0), &Quiet).unwrap().unwrap();
    assert!((256..all.pixels).contains(&some.pixels), "{} of {}", some.pixels, all.pixels);
    let [one, other] = [some, all].map(|checked| checked.difference.delta_e.p95);
    assert!((one / other - 1.0).abs() < 0.2, "{one} {other}");
}

#[test]
fn a_budget_takes_the_shortest_step_that_fits() {
    let scene = scene(0);
    let mix = Mix::of_scene(&scene);
    with_renderer(|renderer| {
        let ample = choose(renderer, &scene, &mix, wanted(Goal::Budget(1e9)), None, &Quiet).unwrap();
        assert!((step(&ample) - 0.125).abs() <= 1e-9, "{}", ample.why);
        let none = choose(renderer, &scene, &mix, wanted(Goal::Budget(1e-6)), None, &Quiet).unwrap_err();
        assert!(none.to_string().contains("reaches 0.000001 ms a frame"), "{none}");
        let none = choose(renderer, &scene, &mix, wanted(Goal::MaxError(1e-6)), None, &Quiet).unwrap_err();
        assert!(none.to_string().contains("the nearest is"), "{none}");
    });
}

/// All settings that can be chosen for a scene with material weights: step, scale and name in files.
fn every_setting() -> impl Iterator<Item = (f64, f64, String)> {
    let scales = [1.0, 0.71, 0.5, 0.35, 0.25, 0.18, 0.125];
    let of = move |n: i32| {
        let step: f64 = format!("{:.2e}", 2_f64.powf(f64::from(n) / 8.0)).parse().unwrap();
        let named = move |scale| {
            (step, scale, format!("step={step}") + &if scale < 1.0 { format!(" scale={scale}") } else { String::new() })
        };
        scales.into_iter().map(named)
    };
    (-24..=32).flat_map(of)
}

/// Replaces times and errors in the only file of `folder`, by step and scale.
fn believe(folder: &Path, frame_ms: impl Fn(f64, f64) -> f64, error: impl Fn(f64, f64) -> f64) {
    let path = std::fs::read_dir(folder).unwrap().next().unwrap().unwrap().path();
    let mut file: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    for (step, scale, name) in every_setting() {
        let error = error(step, scale);
        let (ms, error_of) = (frame_ms(step, scale), json!({"mean": error, "p95": error, "max": error}));
        let point = json!({"frame_ms": ms, "cpu_ms": ms, "frames": 9, "error": error_of, "at_most": error});
        file["points"][name] = point;
    }
    std::fs::write(path, file.to_string()).unwrap();
}

/// With known times and errors of every setting, the search finds the result of an exhaustive search.
#[test]
fn the_search_finds_the_best_of_all_settings() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(0);
    let mix = Mix::of_scene(&scene);
    with_renderer(|renderer| {
        let found = |wanted| choose(renderer, &scene, &mix, wanted, Some(folder.path()), &Quiet);
        found(wanted(Goal::MaxError(50.0))).unwrap();
        // Smooth pictures, pictures with edges, and frames with a constant overhead.
        for (edges, overhead) in [(0.02, 0.0), (0.3, 0.0), (3.0, 0.0), (0.02, 4.0), (0.3, 4.0)] {
            let frame_ms = |step: f64, scale: f64| 100.0 * scale * scale / step + overhead;
            let error = |step: f64, scale: f64| 0.3 * step.powf(1.7) + edges * (1.0 / scale - 1.0);
            believe(folder.path(), frame_ms, error);
            // A choice uses up 0.92 of a time budget and 0.97 of an error budget.
            for asked in [5.0, 12.0, 40.0, 90.0, 300.0, 1e4] {
                let best = every_setting()
                    .filter(|&(step, scale, _)| frame_ms(step, scale) <= 0.92 * asked)
                    .min_by(|one, two| error(one.0, one.1).total_cmp(&error(two.0, two.1)));
                let choice = found(wanted(Goal::Budget(asked))).unwrap();
                assert!(choice.from_cache, "{}", choice.why);
                assert_eq!(choice.setting.to_string(), best.unwrap().2, "{asked} ms, {edges}, {overhead}");
            }
            for asked in [0.1, 0.5, 2.0, 10.0] {
                let best = every_setting()
                    .filter(|&(step, scale, _)| error(step, scale) <= 0.97 * asked)
                    .min_by(|one, two| frame_ms(one.0, one.1).total_cmp(&frame_ms(two.0, two.1)));
                let choice = found(wanted(Goal::MaxError(asked))).unwrap();
                assert_eq!(choice.setting.to_string(), best.unwrap().2, "within {asked}, {edges}, {overhead}");
            }
        }
        // All pixels are marched if required.
        for goal in [Goal::Budget(12.0), Goal::MaxError(2.0)] {
            let choice = found(Wanted { pixels: Pixels::All, ..wanted(goal) }).unwrap();
            assert_eq!(choice.setting.get("scale"), None, "{}", choice.why);
        }
    });
}

/// If the device cannot hold a picture of full size, fewer pixels are marched and enlarged.
#[test]
fn a_picture_that_the_device_cannot_hold_is_made_of_fewer_pixels() {
    let scene = scene(0);
    let mix = Mix::of_scene(&scene);
    with_renderer(|renderer| {
        let [widest, _] = renderer.device().limits().max_extent_2d(Format::Rgba32Float);
        let size = [usize::try_from(widest).unwrap() + 16, 8];
        let choose = |goal, pixels| choose(renderer, &scene, &mix, Wanted { size, goal, pixels }, None, &Quiet);
        for goal in [Goal::Budget(1e9), Goal::MaxError(100.0)] {
            let choice = choose(goal, Pixels::Fewer).unwrap();
            assert!(choice.setting.scale() <= 0.71, "{}", choice.why);
            let all = choose(goal, Pixels::All).unwrap_err();
            assert!(all.to_string().contains("is too large for"), "{all}");
        }
        let none = choose(Goal::MaxError(1e-9), Pixels::Fewer).unwrap_err();
        assert!(none.to_string().contains("the nearest is"), "{none}");
    });
}

#[test]
fn presets_are_points_on_the_same_curve() {
    let [Goal::Budget(ms), Goal::MaxError(balanced), Goal::MaxError(reference)] =
        [Preset::Interactive, Preset::Balanced, Preset::Reference].map(Preset::goal)
    else {
        panic!("a time and two errors");
    };
    assert!(ms > 0.0 && reference < balanced);
}

/// A value of a 40×40 picture enlarged from 20×20: bilinear between pixel centres.
fn enlarged(small: &[f32], x: usize, y: usize) -> f32 {
    let along = |at: usize| {
        let (near, far) =
            (at / 2, if at.is_multiple_of(2) { (at / 2).saturating_sub(1) } else { (at / 2 + 1).min(19) });
        [(near, 0.75), (far, 0.25)]
    };
    let parts = along(x).into_iter().flat_map(|column| along(y).map(|row| (column, row)));
    parts.map(|((x, across), (y, down))| across * down * small[20 * y + x]).sum()
}

/// A choice with `error` times the asked error, at `time` and `samples` times the least.
fn measured_row(error: f64, time: f64, samples: f64) -> GoalRow {
    let cost = |p95, ms| GoalCost { setting: Setting::default(), p95, samples: 1.0, ms };
    GoalRow { asked: 2.0, chosen: cost(2.0 * error, 3.0 * time), cheapest: cost(2.0, 3.0), samples }
}

#[test]
fn bars_are_missed_by_what_is_off_and_by_what_is_dear() {
    let good = measured_row(0.5, 1.25, 1.0);
    let with = |others: &[GoalRow], many: usize| {
        let rows = [others, &vec![good.clone(); many - others.len()]].concat();
        GoalSummary::of(&rows).map(|found| found.missed())
    };
    assert_eq!(with(&[], 40), Some(Vec::new()));
    let one_in_twenty = [measured_row(1.5, 2.0, 2.0), measured_row(1.01, 1.5, 1.5)];
    assert_eq!(with(&one_in_twenty, 40), Some(Vec::new()), "95 of 100 are asked for");
    let missed = with(&[&one_in_twenty[..], &[measured_row(f64::NAN, f64::NAN, 1.4)]].concat(), 40).unwrap_or_default();
    assert_eq!(missed.len(), 3, "{missed:?}");
    assert!(missed[0].starts_with("92.5 % of the scenes"), "{missed:?}");
    assert!(missed[1].contains("up to 1.40 times the samples"), "{missed:?}");
    assert_eq!(GoalSummary::of(&[]), None);
}

#[test]
fn a_summary_says_how_many_are_dear() {
    let rows = [measured_row(0.5, 1.0, 1.0), measured_row(0.25, 1.5, 1.25), measured_row(1.5, 1.25, 2.0)];
    let found = GoalSummary::of(&rows);
    let near = |one: f64, two: f64| (one - two).abs() <= 1e-12;
    assert!(found.is_some_and(|it| (it.scenes, it.kept) == (3, 2) && near(it.worst, 1.5)), "{found:?}");
    assert!(found.is_some_and(|it| near(it.time.median, 1.25) && near(it.time.max, 1.5)), "{found:?}");
    assert!(found.is_some_and(|it| (it.time.dear, it.samples.dear) == (1, 1)), "{found:?}");
}

#[test]
fn a_picture_of_fewer_pixels_has_the_size_that_was_asked_for_in_every_file() {
    let folder = Folder::new();
    let cache = folder.path("cache");
    let run = |arguments: &[&str]| {
        let mut command = folder.command(arguments);
        support::program::Outcome::of(command.env("XDG_CACHE_HOME", &cache))
    };
    let render = ["render", "scene.toml", "--size", "40x40", "-o", "p.exr", "-o", "p.png"];
    let first = run(&[&render[..], &["--budget", "1e9"]].concat());
    assert_eq!(first.code, Some(0), "{}", first.err);
    // For each scale, steps of 4, 2, 1 and ½ are just fast enough; their errors are 4, 2.4, 2 and 2.4.
    believe(&cache.join("relume"), |step, scale| 1000.0 * scale * scale / step, |step, scale| step + 1.0 / scale - 1.0);
    let files = ["--accumulators", "a.exr", "--spectral", "s.exr", "--budget", "280"];
    let json = run(&[&render[..], &files, &["--json"]].concat()).json();
    let choice = &json["choice"];
    assert_eq!((&choice["setting"]["step"], &choice["setting"]["scale"]), (&1.0.into(), &0.5.into()), "{choice}");
    assert_eq!((&json["size"], &json["march"]["size"]), (&json!([40, 40]), &json!([20, 20])));
    let why = choice["why"].as_str().unwrap();
    assert!(why.ends_with("20×20 pixels and enlarged to 40×40"), "{why}");
    // A quarter as many of the pixels that were marched show anything.
    assert!(choice["measured"]["pixels"].as_u64().unwrap() > 200, "counted at the full size: {choice}");

    folder.done(&["render", "scene.toml", "--size", "20x20", "-D", "accuracy.step=1", "-o", "small.exr"]);
    let [small, shown, spectra] = ["small.exr", "p.exr", "s.exr"].map(|name| Exr::read(&folder.path(name)));
    assert_eq!((shown.size, spectra.size), ((40, 40), (40, 40)));
    let expected: Vec<f32> = ["R", "G", "B", "A"]
        .iter()
        .flat_map(|name| (0..1600).map(|pixel| enlarged(&small.channels[*name], pixel % 40, pixel / 40)))
        .collect();
    assert_same(&shown.rgba(), &expected, 1e-5);
    // Relighting is linear, so the enlarged accumulators give the same picture.
    folder.done(&["relight", "a.exr", "-o", "q.exr"]);
    assert_same(&Exr::read(&folder.path("q.exr")).rgba(), &shown.rgba(), 1e-5);
    // The colour of a spectrum is linear as well; its luminance is that of the preview.
    let line = |name: &str| spectra.channels.iter().find(|(channel, _)| channel.contains(name)).map(|(_, it)| it);
    assert!(line("555").is_some_and(|samples| samples.len() == 1600), "{:?}", spectra.channels.keys());
    // The 8-bit picture of the enlarged colours has the full size.
    let small_png = std::fs::read(folder.path("p.png")).unwrap();
    assert_eq!(&small_png[16..24], [0, 0, 0, 40, 0, 0, 0, 40], "IHDR has its size");
}

#[test]
fn render_says_what_it_chose_and_what_came_of_it() {
    let folder = Folder::new();
    let cache = folder.path("cache");
    let run = |arguments: &[&str]| {
        let render = ["render", "scene.toml", "--size", "40x40", "-o", "p.png"];
        let mut command = folder.command(&[&render[..], arguments].concat());
        support::program::Outcome::of(command.env("XDG_CACHE_HOME", &cache))
    };
    let first = run(&["--max-error", "4", "--json"]);
    assert_eq!(first.code, Some(0), "{}", first.err);
    let begun = first.err.lines().next().unwrap_or_default();
    assert!(begun.starts_with("note: measuring settings to find the fastest setting within ΔE00 4"), "{}", first.err);
    let json = first.json();
    let choice = &json["choice"];
    assert_eq!((choice["from_cache"].as_bool(), choice["asked_error"].as_f64()), (Some(false), Some(4.0)));
    assert!(choice["measured"]["difference"]["p95"].as_f64().unwrap() <= 4.0, "{choice}");
    let second = run(&["--max-error", "4"]);
    assert!(second.out.contains("asked 4, measured "), "{}", second.out);
    assert!(second.out.contains("is the fastest tried setting within ΔE00 4"), "{}", second.out);
    assert_eq!(run(&["--max-error", "4", "--json"]).json()["choice"]["from_cache"], true);
    let preset = run(&["--preset", "balanced", "--json"]);
    assert_eq!(preset.json()["choice"]["asked_error"], 1.0);
    let both = run(&["--max-error", "4", "--budget", "10"]);
    both.assert_refused(2, &["cannot be used with"]);
    for too_small in ["0", "-1"] {
        run(&["--max-error", too_small]).assert_refused(2, &[too_small, "above 0"]);
    }
}

/// Counts samples per dispatch instead of milliseconds: with a target duration of 0, no dispatch is longer than the
/// first,
/// which has about the length used for an unknown device.
#[test]
fn what_measures_beside_a_window_takes_dispatches_as_short_as_the_windows_own() {
    let (Some(device), Some(other)) = (open(), open()) else { return };
    const FIRST: u64 = 20_000_000 / 32 * 3 / 2;
    let (scene, size) = (scene(2), [320, 300]);
    let usual = Renderer::new(other);
    let planned = plan(&scene, &Quiet).unwrap();
    let rungs = Rungs::planned(scene.clone(), planned, size);
    rungs.gpu_accumulators(&usual);
    assert!(usual.longest_dispatch() > FIRST, "{} samples would hold a window up", usual.longest_dispatch());

    let renderer = Renderer::new(device).with_dispatches_of(Duration::from_nanos(1));
    effort::measure(&renderer, &scene, &Mix::of_scene(&scene), size, Some(Goal::MaxError(2.0)), None, &Quiet).unwrap();
    assert!(renderer.marches() > 4, "{} marches", renderer.marches());
    assert!(renderer.longest_dispatch() <= FIRST, "{} samples", renderer.longest_dispatch());
}

#[test]
fn scattered_light_is_chosen_with_its_stated_error() {
    const SCENE: &str = r#"version = 1
shading = "none"
[volume]
phantom = "gaussian"
dims = [10, 10, 10]
[materials.all]
reflectance = 0.8
[transfer]
intervals = [{ material = "all", range = [0.3, 1], ramp = 0.2, opacity = 0.05 }]
[lights.day]
spectrum = "D65"
kind = "directional"
direction = [1, 0.4, -0.6]
[scattering]
orders = "multiple"
"#;
    let folder = Folder::new().with("often.toml", SCENE);
    let cache = folder.path("cache");
    let run = |arguments: &[&str]| {
        let render = ["render", "often.toml", "--size", "16x16", "-o", "p.png"];
        let mut command = folder.command(&[&render[..], arguments].concat());
        support::program::Outcome::of(command.env("XDG_CACHE_HOME", &cache))
    };
    let chosen = |arguments: &[&str]| {
        let ran = run(arguments);
        assert_eq!(ran.code, Some(0), "{}", ran.err);
        ran.json()["choice"].clone()
    };
    let near = chosen(&["--max-error", "2", "--json"]);
    let number = |value: &serde_json::Value| value.as_f64().unwrap();
    let (of_light, of_rest) = (number(&near["scattered_light"]["p95"]), number(&near["expected"]["at_most"]));
    assert!(
        of_light > 0.0 && of_light + of_rest <= 2.0 && number(&near["setting"]["scattering.spacing"]) > 0.0,
        "{near}"
    );
    assert!(near["why"].as_str().unwrap().contains("; scattered light of scattering.spacing="), "{near}");
    // What the scene states stays, and a budget is for frames.
    let coarse = run(&["--max-error", "0.4", "-D", "scattering.spacing=6"]);
    coarse.assert_refused(1, &["ΔE00 0.4", "its scattered light alone has up to"]);
    let fast = chosen(&["--budget", "1000", "--json"]);
    assert!(
        fast["setting"].get("scattering.spacing").is_none() && number(&fast["scattered_light"]["p95"]) > 0.0,
        "{fast}"
    );
}
