//! Measurements: errors by cause against the truth, counts and bytes, and their reports.

use crate::support;

use std::collections::BTreeMap;
use std::error::Error;
use std::iter;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use relume::document::{Definition, SceneOptions, load_embedded, parse};
use relume::measure::{
    Cause, Difference, Findings, Knob, MeasureError, Measured, NodesBesideRgb, Setting, Summary, Survey, SurveyOptions,
    Value, cheapest, html, mark_pareto, settings, to_csv, to_markdown, to_text, trade,
};
use relume::plan::{Integrate, plan_full_spectrum};
use relume::progress::{Progress, Quiet};
use relume::scene::{AmbientShares, Integration, Projection, Scene, Term};
use relume::volume::{Geometry, Volume, Voxels};
use support::program::{Folder, SCENE};
use support::rungs::{Rungs, with_renderer};
use support::scenes::{self, GLASS, glass_straight_on, parsed};

const SIZE: [usize; 2] = [20, 16];
const OPTIONS: SurveyOptions = SurveyOptions { size: SIZE, pixels: 320, runs: 1 };

fn sweep(sweeps: &[&str]) -> Vec<Setting> {
    settings(&sweeps.iter().map(|&sweep| sweep.to_owned()).collect::<Vec<_>>()).unwrap()
}

/// Measures the scene's own setting, then the rows of `sweeps`, and passes them to `test`.
fn measured(scene: &Scene, sweeps: &[&str], test: impl Fn(&Survey<'_>, &[Measured])) {
    let settings = sweep(sweeps);
    with_renderer(|renderer| {
        let mut survey = Survey::new(renderer, scene, &settings, OPTIONS, &Quiet).unwrap();
        let rows: Vec<Measured> = settings.iter().map(|setting| survey.measure(setting, &Quiet).unwrap()).collect();
        test(&survey, &rows);
    });
}

fn by(row: &Measured, cause: Cause) -> Difference {
    row.causes.iter().find(|(known, _)| *known == cause).unwrap().1
}

#[test]
fn the_truth_is_the_full_spectrum_at_an_eighth_of_the_shortest_step_and_skipping_omits_nothing() {
    for text in [SCENE, GLASS] {
        let scene = parsed(text);
        let mut fine = scene.clone();
        fine.accuracy.step_length /= 16.0;
        fine.accuracy.termination = 0.0;
        let full = Rungs::planned(fine.clone(), plan_full_spectrum(&fine), SIZE);
        let plain = full.lit(&full.exact());
        measured(&scene, &["step=0.5"], |survey, _| {
            for (&[x, y], truth) in survey.pixels().iter().zip(survey.truth()) {
                let (expected, _) = plain[x + SIZE[0] * y];
                assert!((*truth - expected).abs().max_element() <= 1e-12, "pixel {x}, {y}: {truth}, {expected}");
            }
            let left_out = (0..SIZE[0] * SIZE[1]).filter(|i| !survey.pixels().contains(&[i % SIZE[0], i / SIZE[0]]));
            for pixel in left_out {
                let apart = (plain[pixel].0 - survey.background()).abs().max_element();
                // A shorter step may hit what a longer one misses.
                assert!(apart <= 0.05, "pixel {pixel} shows something: {apart}");
            }
        });
    }
}

#[test]
fn errors_are_told_apart_by_their_cause() {
    let scene = parsed(GLASS);
    let sweeps =
        ["model=nodes,k=3,16", "termination=0.5", "storage=f16", "entries=8", "scale=0.5", "interpolation=nearest"];
    measured(&scene, &sweeps, |_, rows| {
        let row = |text: &str| rows.iter().find(|row| row.setting.to_string() == text).unwrap();
        let own = &rows[0];
        let mean = |row: &Measured, cause| by(row, cause).delta_e.mean;
        assert!(mean(own, Cause::Termination) <= 0.0, "its rays go to their ends");
        assert!(mean(own, Cause::Rounding) <= 0.01 && mean(own, Cause::Device) <= 0.01, "{own:?}");
        let [few, many] = ["model=nodes k=3", "model=nodes k=16"].map(row);
        assert!(mean(few, Cause::Basis) > 20.0 * mean(many, Cause::Basis), "three numbers and sixteen");
        // Errors of other causes must not change, except those that depend on the picture. The brightest component ends
        // a ray, and
        // a model has other components than a spectrum.
        for (setting, cause, same) in [
            ("termination=0.5", Cause::Termination, &[Cause::Step][..]),
            ("storage=f16", Cause::Tables, &[Cause::Step, Cause::Basis]),
            ("entries=8", Cause::Tables, &[Cause::Step, Cause::Basis]),
            (
                "scale=0.5",
                Cause::Resolution,
                &[Cause::Step, Cause::Basis, Cause::Tables, Cause::Rounding, Cause::Device],
            ),
            ("interpolation=nearest", Cause::Interpolation, &[Cause::Step]),
        ] {
            let row = row(setting);
            let moved = mean(row, cause);
            let before =
                own.causes.iter().find(|(known, _)| *known == cause).map_or(0.0, |(_, error)| error.delta_e.mean);
            assert!(moved > 2.0 * before && moved > 0.0, "{setting}: {moved}, and {before} without");
            for &other in same {
                let apart = (mean(row, other) - mean(own, other)).abs();
                assert!(apart <= 1e-9, "{setting}: {other:?} moved by {apart}");
            }
        }
    });
}

/// The truth has four times as many rays as the setting with most, so a setting with fewer has an error of its own.
#[test]
fn rays_are_measured_against_four_times_as_many() {
    let scene = parsed(GLASS);
    measured(&scene, &["rays=1,4"], |_, rows| {
        let of = |text: &str| rows.iter().find(|row| row.setting.to_string() == text).unwrap();
        let error = |row: &Measured| by(row, Cause::PixelArea).delta_e.mean;
        let [one, four] = ["rays=1", "rays=4"].map(|text| error(of(text)));
        assert!(0.0 < four && 2.0 * four < one, "{four} with four rays, {one} with one");
        assert!(of("rays=4").total_bytes > of("rays=1").total_bytes, "the mean has images of its own");
        assert_eq!(error(&rows[0]).to_bits(), one.to_bits(), "the scene has one ray");
    });
}

/// The slab is two units across, and a picture of 20 × 16 pixels is 16 units high: the slab covers two pixels per axis.
#[test]
fn only_pixels_that_the_volume_covers_are_looked_at_whatever_is_behind_it() {
    for background in ["0.9", "0", "\"blue sky\""] {
        let mut scene = glass_straight_on(background, "step = 1\nk = 8");
        scene.camera.projection = Projection::Orthographic { height: Some(16.0) };
        measured(&scene, &[], |survey, _| {
            let found = survey.pixels();
            assert_eq!(found, [[9, 7], [10, 7], [9, 8], [10, 8]], "background {background}");
        });
    }
}

/// The trapezoidal rule and midpoint sums have errors of order Δs² for smooth functions.
#[test]
fn the_step_error_of_a_smooth_volume_is_of_second_order() {
    measured(&scenes::named("unshaded_one"), &["step=0.5"], |_, rows| {
        for row in rows {
            assert!((1.5..=2.6).contains(&row.order.unwrap()), "{}: {:?}", row.setting, row.order);
        }
    });
}

#[test]
fn counts_and_bytes_are_those_of_the_plan() {
    let scene = parsed(GLASS);
    measured(&scene, &["storage=f16", "k=4", "k=8", "scale=0.5"], |_, rows| {
        let [own, half, four, eight, small] = rows else { panic!("{}", rows.len()) };
        assert_eq!(own.pixel_bytes, 2 * half.pixel_bytes, "coloured transmittance has 16 bits, too");
        // Two positions and the transmittance, with one vector of four f32 each.
        assert_eq!((four.pixel_bytes, eight.pixel_bytes), (3 * 16, 6 * 16));
        assert_eq!((four.components, eight.components), (4, 8));
        assert_eq!(own.volume_bytes, small.volume_bytes);
        assert!(small.total_bytes < own.total_bytes);
        assert!(rows.iter().all(|row| row.dispatches >= 1 && row.frame_ms > 0.0 && row.times.upload.wall_ms.max > 0.0));
        assert!(rows.iter().all(|row| row.times.march.device_ms.is_some()), "software devices have a clock");
    });
}

#[test]
fn eight_nodes_are_at_least_twenty_times_closer_than_any_rgb() {
    let models = "model=nodes,rgb-naive,rgb-prefiltered,rgb-fitted";
    // Six materials of the built-in scene, at an eighth of its resolution along each axis; RGB can represent two.
    let options = SceneOptions { downsample: Some([8, 8, 8]), ..SceneOptions::default() };
    for mut scene in [parsed(GLASS), load_embedded(&options, &Quiet).unwrap().scene] {
        // The division of segments depends on the numbers of a pixel (docs/theory/segments.md), which is no error of a model.
        scene.accuracy.integration = Integration::Samples;
        measured(&scene, &[models], |_, rows| {
            let found = NodesBesideRgb::of(rows).unwrap();
            assert_eq!(found.of.len(), 3, "{found:?}");
            assert!(found.ratio() >= 20.0, "{}", found.sentence());
            assert!(found.sentence().contains(found.best.name()), "{}", found.sentence());
        });
    }
}

#[test]
fn settings_are_timed_in_turn_until_all_have_as_many_runs() {
    let (scene, settings) = (parsed(SCENE), sweep(&["step=1,2", "scale=0.5", "volume=f32"]));
    let options = SurveyOptions { runs: 5, ..OPTIONS };
    with_renderer(|renderer| {
        let mut survey = Survey::new(renderer, &scene, &settings, options, &Quiet).unwrap();
        let mut rows: Vec<Measured> = settings.iter().map(|setting| survey.measure(setting, &Quiet).unwrap()).collect();
        let before = rows.clone();
        assert!(rows.iter().all(|row| row.times.runs == 3), "these are there also where somebody stops soon");
        survey.time_in_turn(&mut rows, &Quiet).unwrap();
        for (row, before) in rows.iter().zip(&before) {
            assert_eq!(row.times.runs, 5, "{}", row.setting);
            assert_eq!((&row.error, &row.causes, row.dispatches), (&before.error, &before.causes, before.dispatches));
            let sum = [Some(row.times.march), Some(row.times.relight), row.times.enlarge].into_iter().flatten();
            let sum: f64 = sum.map(|cost| cost.wall_ms.median).sum();
            assert!((row.frame_ms - sum).abs() <= 1e-9 * sum, "{}: {} is not {sum}", row.setting, row.frame_ms);
            assert_eq!(row.times.enlarge.is_some(), row.setting.scale() < 1.0, "{}", row.setting);
        }
        let of = |name: &str| rows.iter().find(|row| row.setting.to_string() == name).unwrap();
        let upload = |row: &Measured| row.times.upload.wall_ms.median.to_bits();
        assert_eq!(upload(&rows[0]), upload(of("scale=0.5")), "one volume, one upload");
        assert_ne!(upload(&rows[0]), upload(of("volume=f32")), "another one");
        assert_eq!(rows[0].times, of("step=1").times, "what is the same is timed once");
    });
}

#[test]
fn directions_of_the_sky_are_measured_and_no_timed_frame_fills_a_light_grid() {
    let mut scene = parsed(SCENE);
    // Nodes near enough for the directions to have the largest error.
    (scene.shadows.ambient, scene.shadows.spacing) = (AmbientShares::Occluded, 0.5);
    let options = SurveyOptions { pixels: 24, runs: 3, ..OPTIONS };
    let settings = sweep(&["directions=8,32"]);
    with_renderer(|renderer| {
        let mut survey = Survey::new(renderer, &scene, &settings, options, &Quiet).unwrap();
        let mut rows: Vec<Measured> = settings.iter().map(|setting| survey.measure(setting, &Quiet).unwrap()).collect();
        let of = |name: &str| rows.iter().find(|row| row.setting.to_string() == name).unwrap();
        let [few, many] = ["directions=8", "directions=32"].map(|name| by(of(name), Cause::LightGrid).delta_e.mean);
        assert!(many < few && few > 0.0, "ΔE00 {few} from 8 directions, {many} from 32");
        // Asserts in turn that the light grid of each setting is complete before its time is taken.
        survey.time_in_turn(&mut rows, &Quiet).unwrap();
    });
}

#[test]
fn the_front_has_what_no_other_setting_beats() {
    measured(&parsed(SCENE), &["termination=0,0.01,0.1,0.5"], |_, rows| {
        let mut rows = rows.to_vec();
        for (row, (time, error)) in rows.iter_mut().zip([(9.0, 1.0), (4.0, 2.0), (5.0, 2.0), (4.0, 3.0), (10.0, 0.5)]) {
            row.frame_ms = time;
            row.error.delta_e.p95 = error;
        }
        mark_pareto(&mut rows);
        assert_eq!(rows.iter().map(|row| row.pareto).collect::<Vec<_>>(), [true, true, false, false, true]);
        assert_eq!(cheapest(&rows, 2.0).map(|row| row.frame_ms), Some(4.0));
        assert_eq!(cheapest(&rows, 0.4), None);
        let csv = to_csv(&rows);
        let columns: Vec<usize> = csv.lines().map(|line| line.split(',').count()).collect();
        assert_eq!(columns.len(), 6, "a head and a line a setting");
        assert!(columns.iter().all(|&n| n == columns[0]), "{columns:?}");
        let markdown = to_markdown(&rows);
        assert_eq!(markdown.lines().count(), 7);
        assert!(markdown.lines().all(|line| line.starts_with('|') && line.ends_with('|')), "{markdown}");
    });
}

#[test]
fn a_scene_that_shows_nothing_has_no_error_to_measure() {
    let dark = SCENE.replace("opacity = 0.1", "opacity = 0").replace("opacity = 0.9", "opacity = 0");
    let dark = parsed(&dark);
    with_renderer(|renderer| {
        let error = Survey::new(renderer, &dark, &sweep(&["k=3"]), OPTIONS, &Quiet).unwrap_err();
        assert!(matches!(error, MeasureError::Nothing { sampled: 320, .. }), "{error}");
    });
}

#[test]
fn measuring_stops_where_it_is_asked_to() {
    struct Stop;
    impl Progress for Stop {
        fn report(&self, _: &str, _: u64, _: u64) {}
        fn cancelled(&self) -> bool {
            true
        }
    }
    let scene = parsed(SCENE);
    let stopped = |error: &dyn Error| {
        iter::successors(Some(error), |&error| error.source()).any(|error| error.to_string().contains("cancelled"))
    };
    with_renderer(|renderer| {
        let settings = sweep(&["k=3"]);
        let error = Survey::new(renderer, &scene, &settings, OPTIONS, &Stop).unwrap_err();
        assert!(stopped(&error), "{error}");
        let mut survey = Survey::new(renderer, &scene, &settings, OPTIONS, &Quiet).unwrap();
        assert!(stopped(&survey.measure(&settings[0], &Stop).unwrap_err()));
        assert!(survey.measure(&settings[1], &Quiet).is_ok(), "and goes on where it may");
    });
}

// The command line.

const MEASURE: [&str; 8] = ["measure", "scene.toml", "--size", "20x16", "--runs", "1", "--pixels", "100"];

#[test]
fn measure_tells_programs_every_number() {
    let folder = Folder::new();
    let sweeps = ["--sweep", "k=3,step=2", "--sweep", "accumulate=weights", "--json"];
    let outcome = folder.done(&[&MEASURE[..], &sweeps].concat());
    for words in ["note: 3 settings to measure", " s, so a pass over all takes about "] {
        assert!(outcome.err.contains(words), "without a terminal, it says what it does: {}", outcome.err);
    }
    let json = outcome.json();
    let rows = json["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 3);
    assert_eq!(rows[0]["setting"], serde_json::json!({}));
    assert_eq!(rows[1]["setting"], serde_json::json!({"k": 3.0, "step": 2.0}));
    for row in rows {
        assert!(row["error"]["mean"].as_f64().unwrap() <= row["error"]["max"].as_f64().unwrap());
        assert!(row["error"]["at"].as_array().unwrap().len() == 2, "{row}");
        assert!(row["times"]["march"]["wall_ms"]["median"].as_f64().unwrap() > 0.0);
        let causes = row["causes"].as_array().unwrap();
        assert_eq!(
            causes.iter().map(|cause| cause[0].as_str().unwrap()).collect::<Vec<_>>(),
            ["step", "termination", "basis", "tables", "rounding", "device"]
        );
    }
    assert!(rows.iter().any(|row| row["pareto"] == true));
    assert_eq!(json["interrupted"], false);
}

#[test]
fn the_report_is_one_file_that_needs_nothing_else() {
    let folder = Folder::new();
    let sweeps =
        ["--sweep", "k=3,4", "--sweep", "model=nodes,rgb-fitted", "--sweep", "step=0.5,2", "--sweep", "storage=f16"];
    let outputs = ["-o", "report.html", "-o", "trade.svg", "-o", "trade.png"];
    let outcome = folder.done(&[&MEASURE[..], &sweeps, &outputs].concat());
    assert!(outcome.out.contains("Eight nodes have a mean ΔE00 of"), "{}", outcome.out);
    assert!(outcome.out.lines().any(|line| line.starts_with("as the scene says")), "{}", outcome.out);
    let page = std::fs::read_to_string(folder.path("report.html")).unwrap();
    // The relightable page in its frame has scripts, and tests of its own (`page.rs`).
    let (before, framed) = page.split_once("srcdoc='").unwrap();
    assert!(before.ends_with("style=\"width:100%;border:0\" ") && before.contains("<iframe sandbox=\"allow-scripts "));
    let (_, after) = framed.split_once('\'').unwrap();
    let rest = format!("{before}{after}").replace("http://www.w3.org/2000/svg", "");
    for word in ["<script", "http:", "https:", "url(", "@import", "<link", "NaN"] {
        assert!(!rest.contains(word), "the page has {word}");
    }
    for word in [
        "prefers-color-scheme:dark",
        "data:image/png;base64,",
        "Where the error comes from",
        "step=0.5",
        "The worst compared pixel",
        // What was measured, and under what.
        "CIE 1931",
        "median of 1 run,",
        // Definitions to copy.
        "<code>-D accuracy.step=0.5</code>",
        "--max-error 1 -o scene.png",
        "@media print",
        "<details>",
    ] {
        assert!(page.contains(word), "the page has no {word}");
    }
    // The picture, the error map and three close-ups; then the picture, the truth, eight coefficients, RGB, and the errors
    // of both.
    assert_eq!(rest.matches("<img ").count(), 5 + 5);
    for drawing in page.split("<svg").skip(1) {
        assert!(drawing.contains("</svg>"), "{drawing}");
    }
    let svg = std::fs::read_to_string(folder.path("trade.svg")).unwrap();
    assert!(svg.contains("<style>") && !svg.contains("var("), "it brings its own colours");
    assert!(std::fs::read(folder.path("trade.png")).unwrap().starts_with(b"\x89PNG"));
}

/// `rows` with frames of these durations in ms, the longest run `apart` times as long as the shortest.
fn timed(rows: &[Measured], times: &[f64], apart: f64) -> Vec<Measured> {
    let mut rows = rows.to_vec();
    assert_eq!(rows.len(), times.len(), "a time a row");
    for (row, ms) in rows.iter_mut().zip(times) {
        let of = |median: f64| Summary { median, min: median / apart.sqrt(), max: median * apart.sqrt() };
        (row.times.march.wall_ms, row.times.relight.wall_ms) = (of(0.75 * ms), of(0.25 * ms));
        (row.times.enlarge, row.frame_ms) = (None, *ms);
    }
    mark_pareto(&mut rows);
    rows
}

/// Report of the timed rows.
fn page(survey: &Survey<'_>, rows: &[Measured], times: &[f64], apart: f64) -> String {
    let rows = timed(rows, times, apart);
    let findings = Findings {
        rows: &rows,
        refused: &[],
        close_up: None,
        interrupted: false,
        spectra: &BTreeMap::new(),
        relit: "",
    };
    html(survey, &findings).unwrap()
}

fn section<'a>(page: &'a str, head: &str) -> &'a str {
    page.split(&format!("<h2>{head}</h2>")).nth(1).unwrap().split("<h2>").next().unwrap()
}

#[test]
fn nothing_is_chosen_by_rough_times_and_errors_stay_as_they_are() {
    let sweeps = ["step=0.5,2", "skipping=off", "termination=0.001", "model=nodes,rgb-naive"];
    // Segments, which "auto" takes for long steps, would be the most accurate.
    let scene = format!("{SCENE}\n[accuracy]\nintegration = \"samples\"\n");
    measured(&parsed(&scene), &sweeps, |survey, rows| {
        let times = [100.0, 190.0, 50.0, 300.0, 60.0, 200.0, 70.0];
        let [rough, good] = [2.0, 1.02].map(|apart| page(survey, rows, &times, apart));
        // Speed, the Pareto front, its names, bold times, and the uncertainty of differences.
        for word in
            [">faster<", "class=\"front\"", "class=\"best", "±", "instead of 100", "took 2.0 times", "<b>step=2</b>"]
        {
            assert!(!rough.contains(word), "rough times say {word}");
        }
        for word in [">faster<", "class=\"front\"", "class=\"best", "±", "took 2.0 times"] {
            assert!(good.contains(word), "good times do not say {word}");
        }
        assert!(rough.contains("Rough times.") && rough.contains("a factor of up to 2.0"));
        assert!(rough.contains("<span class=\"rough\">≈ 60.0 <small>") && rough.contains("A frame takes ≈ 100 ms."));
        assert!(!good.contains('≈') && !good.contains("class=\"rough\"") && good.contains("<td>60.0 <small>"));
        let causes = [&rough, &good].map(|page| section(page, "Where the error comes from").to_owned());
        assert_eq!(causes[0], causes[1], "errors do not depend on times");
        // The separate drawing follows the same rule.
        let line = |apart| trade(&timed(rows, &times, apart)).contains("class=\"front\"");
        assert!(line(1.02) && !line(2.0));
        let exact = |page: &str| section(page, "Which setting to use").contains("<b>step=0.5</b>");
        assert!(exact(&rough) && exact(&good), "the most exact is so by its errors");
    });
}

#[test]
fn the_most_exact_is_the_fastest_of_those_that_are_as_close() {
    measured(&parsed(SCENE), &["termination=0.001,0.00001", "step=2"], |survey, rows| {
        let mut rows = rows.to_vec();
        for (row, size) in rows.iter_mut().zip([1.0, 1.0, 1.01, 9.0]) {
            let error = &mut row.error.delta_e;
            (error.mean, error.p95, error.max) = (0.1 * size, 0.2 * size, 0.5 * size);
        }
        let chosen = |times: &[f64]| {
            let page = page(survey, &rows, times, 1.1);
            let table = section(&page, "Which setting to use").to_owned();
            let row =
                table.split("<tr>").find(|row| row.contains("most accurate measured setting</td>")).unwrap().to_owned();
            row.split("<b>").nth(1).unwrap().split("</b>").next().unwrap().to_owned()
        };
        assert_eq!(chosen(&[100.0, 50.0, 60.0, 10.0]), "termination=0.001", "faster, and step=2 is not as close");
        assert_eq!(chosen(&[100.0, 95.0, 97.0, 10.0]), "the scene's own", "runs overlap");
    });
}

#[test]
fn a_report_says_by_what_a_pixel_has_its_bytes() {
    measured(&parsed(GLASS), &["model=nodes,rgb-naive"], |survey, rows| {
        let page = page(survey, rows, &[3.0, 2.0, 1.0], 1.0);
        assert!(page.contains("For k = 8: 3 × 8 × 4 = 96."), "{}", section(&page, "Effect of k = 8"));
    });
}

/// Drawings with this label.
fn drawn<'a>(page: &'a str, name: &str) -> Vec<&'a str> {
    page.split("<svg").filter(|it| it.contains(&format!("aria-label=\"{name}\""))).collect()
}

#[test]
fn all_maps_of_errors_have_one_scale() {
    measured(&parsed(GLASS), &["model=nodes,rgb-naive"], |survey, rows| {
        let page = page(survey, rows, &[3.0, 2.0, 1.0], 1.0);
        let scales: Vec<Vec<&str>> = drawn(&page, "scale of ΔE00")
            .into_iter()
            .map(|it| it.split("</text>").filter_map(|text| text.rsplit('>').next()).collect())
            .collect();
        assert_eq!(scales.len(), 2);
        assert_eq!(scales[0], scales[1]);
    });
}

#[test]
fn every_setting_shows_all_parts_of_its_error() {
    let sweeps = ["model=nodes,rgb-naive,rgb-fitted", "step=0.5,4", "scale=0.5"];
    measured(&parsed(GLASS), &sweeps, |survey, rows| {
        let page = page(survey, rows, &[3.0, 2.0, 1.0, 1.5, 9.0, 2.5, 0.5], 1.0);
        let drawing = drawn(&page, "error by cause")[0];
        let number = |bar: &str, name: &str| -> f64 {
            bar.split(&format!(" {name}=\"")).nth(1).unwrap().split('"').next().unwrap().parse().unwrap()
        };
        let mut lines = BTreeMap::new();
        for bar in drawing.split("<rect").skip(1).filter(|bar| number(bar, "height") > 12.0) {
            let line: &mut (f64, Vec<&str>) =
                lines.entry(bar.split(" y=\"").nth(1).unwrap().split('"').next()).or_default();
            line.0 += number(bar, "width");
            line.1.push(bar.split("<title>").nth(1).unwrap().split(':').next().unwrap());
        }
        assert!(lines.len() >= 5, "{lines:?}");
        let longest = lines.values().map(|line| line.0).fold(0.0, f64::max);
        assert!(lines.values().all(|line| (line.0 - longest).abs() <= 2.0), "all bars are the whole: {lines:?}");
        // The legend lists the parts in order.
        let key: Vec<&str> = drawing.split("</text>").filter_map(|text| text.rsplit('>').next()).skip(1).collect();
        for (_, parts) in lines.values() {
            let places: Vec<usize> =
                parts.iter().map(|part| key.iter().position(|name| name == part).unwrap()).collect();
            assert!(places.is_sorted(), "{parts:?} of {key:?}");
        }
    });
}

#[test]
fn all_numbers_begin_with_what_matters_and_print_their_heads_on_every_page() {
    measured(&parsed(SCENE), &["step=1,2"], |survey, rows| {
        let page = page(survey, rows, &[3.0, 2.0, 1.0], 1.0);
        let table = section(&page, "All numbers");
        let heads = table.split("<thead>").nth(1).unwrap().split("</thead>").next().unwrap();
        let heads: Vec<&str> = heads
            .split("</th>")
            .filter_map(|head| head.rsplit('>').next())
            .filter(|head| !head.trim().is_empty())
            .collect();
        assert_eq!(heads[..8], ["mean by cause", "setting", "frame ms", "MB", "bytes/pixel", "mean", "p95", "max"]);
    });
}

#[test]
fn a_report_says_which_knobs_matter_what_saves_memory_and_what_has_another_name() {
    let sweeps = ["termination=0.1", "gradients=central", "step=1,2"];
    measured(&parsed(SCENE), &sweeps, |survey, rows| {
        let mut rows = rows.to_vec();
        let own = rows[0].clone();
        for row in &mut rows[1..3] {
            row.error = own.error;
        }
        rows[1].error.delta_e.max += 1.0;
        rows[2].total_bytes = own.total_bytes / 2;
        rows[4].error.delta_e.p95 = own.error.delta_e.p95 + 1.0;
        let page = page(survey, &rows, &[3.0, 2.0, 4.0, 3.0, 1.0], 1.0);
        let worth = page.split("<b>Which knobs matter.</b>").nth(1).unwrap().split("</p>").next().unwrap();
        assert!(
            worth.contains("step changes p95 by 0.05 or more. termination and gradients change p95 by less than 0.05."),
            "{worth}"
        );
        assert!(worth.contains("gradients=central takes") && worth.contains("at the same accuracy."), "{worth}");
        let knobs = section(&page, "Knob by knob");
        assert_eq!(knobs.matches("<td><b>").count(), 1, "the worst pixel of termination=0.1: {knobs}");
        assert!(section(&page, "Where the error comes from").contains("Equivalent to the scene's own: step=1."));
    });
}

/// The definitions printed by the report reproduce the measured setting.
#[test]
fn a_setting_can_be_written_as_definitions_of_the_scene() {
    let scene = parsed(GLASS);
    let mut all = sweep(&[]);
    all.extend(sweep(&[
        "accumulate=spectral,weights",
        "gradients=packed",
        "volume=u16",
        "k=5,step=0.3,lookup=nearest",
    ]));
    let mut written = 0;
    for setting in all {
        let definitions = setting.definitions(&scene);
        written += usize::from(!definitions.is_empty());
        let options = SceneOptions {
            definitions: definitions.iter().map(|text| Definition::new(text)).collect(),
            ..SceneOptions::default()
        };
        let read = parse("glass", GLASS, Path::new(""), &options, &Quiet).unwrap().scene;
        let meant = setting.applied(&scene);
        assert_eq!((read.accuracy, read.transfer), (meant.accuracy, meant.transfer), "{setting}: {definitions:?}");
    }
    assert!(written > 30, "{written} change something");
}

#[test]
fn a_knob_that_does_nothing_is_named_and_not_drawn() {
    let folder = Folder::new();
    let outputs = ["--sweep", "skipping=off", "--sweep", "step=0.5", "-o", "report.html"];
    folder.done(&[&MEASURE[..], &outputs].concat());
    let page = std::fs::read_to_string(folder.path("report.html")).unwrap();
    let knobs = page.split("<h2>Knob by knob</h2>").nth(1).unwrap().split("<h2>").next().unwrap();
    assert!(!knobs.contains("<h3>skipping") && knobs.contains(">skipping=off<"), "{knobs}");
    let causes = page.split("<h2>Where the error comes from</h2>").nth(1).unwrap().split("<h2>").next().unwrap();
    assert!(causes.contains("Same errors as the scene's own: skipping=off."), "{causes}");
}

#[test]
fn what_a_scene_refuses_is_told_and_all_else_is_measured() {
    let folder = Folder::new().with("scene.toml", GLASS);
    let outcome = folder.done(&[&MEASURE[..], &["--sweep", "accumulate=weights,spectral"]].concat());
    assert!(outcome.out.contains("accumulate=weights: accumulate = \"weights\" is not possible"), "{}", outcome.out);
    assert!(outcome.out.lines().any(|line| line.starts_with("accumulate=spectral")), "{}", outcome.out);
}

#[test]
fn a_sweep_or_a_report_that_cannot_be_is_refused_before_anything_is_read() {
    let folder = Folder::new();
    folder.refused(2, &["measure", "missing.toml", "--sweep", "k=99"], &["--sweep k=99", "from 1 to 31"]);
    folder.refused(2, &["measure", "missing.toml", "-o", "report.pdf"], &[".html, .svg or .png"]);
    folder.refused(2, &["measure", "--csv", "--markdown"], &["cannot be used with"]);
    for other in
        [&["missing.toml"][..], &["--sweep", "k=3"], &["--tolerance", "2"], &["--budget", "40"], &["-o", "r.html"]]
    {
        folder.refused(2, &[&["measure", "--extremes"], other].concat(), &["cannot be used with"]);
    }
    folder.refused(1, &["measure", "missing.toml"], &["cannot read the scene"]);
}

#[test]
fn ctrl_c_keeps_the_rows_that_are_finished() {
    let folder = Folder::new();
    // Far more than can be measured before the signal.
    let sweep = ["--sweep", "k=1..16,step=0.5..8,entries=256..65536", "--csv", "-o", "report.html"];
    let mut command = folder.command(&[&MEASURE[..], &sweep].concat());
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    std::thread::sleep(Duration::from_secs(6));
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{said}");
    let rows = String::from_utf8(output.stdout).unwrap().lines().count();
    assert!((2..700).contains(&rows), "{rows} lines; {said}");
    assert!(std::fs::read_to_string(folder.path("report.html")).unwrap().contains("Interrupted"), "the report, too");
}

/// The rows of `tests/render/stability.rs` that finish within this time.
#[test]
fn extremes_are_rows_and_ctrl_c_keeps_those_that_are_finished() {
    let folder = Folder::new();
    let mut command = folder.command(&["measure", "--extremes", "--json"]);
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    std::thread::sleep(Duration::from_secs(3));
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", String::from_utf8_lossy(&output.stderr));
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&json["interrupted"], &json["holds"]), (&true.into(), &true.into()), "{json}");
    let rows = json["rows"].as_array().unwrap();
    assert!(rows.iter().any(|row| row["rung"] == "gpu" && row["group"] == "opacity"), "{json}");
    for row in rows {
        assert!(row["measured"].as_f64().unwrap() <= row["bound"].as_f64().unwrap() && row["holds"] == true, "{row}");
        assert!(json["bounds"][row["derivation"].as_str().unwrap()].is_string(), "{row} says by what it is bound");
    }
}

#[test]
fn knobs_have_names_and_settings_read_as_they_are_written() {
    for knob in Knob::all() {
        assert!(!knob.meaning().is_empty() && knob.name() == knob.to_string(), "{knob}");
    }
    let setting = &sweep(&["step=0.5,k=4"])[1];
    assert_eq!((setting.get("k"), setting.get("model")), (Some(Value::Number(4.0)), None));
    assert_eq!(setting.to_string(), "k=4 step=0.5");
}

#[test]
fn a_dimension_without_effect_is_neither_advised_nor_drawn_on_the_front() {
    // Two materials and white: from three coefficients on, every k is as exact as the weights.
    measured(&parsed(SCENE), &["k=4,6,7,8"], |survey, rows| {
        for row in rows {
            let [own, error] = [&rows[0], row].map(|row| row.error.delta_e.p95);
            assert!((error - own).abs() <= 1e-3, "{}: {error} beside {own}", row.setting);
        }
        // Some are faster by chance, within the spread of the runs.
        let times = [100.0, 97.0, 99.0, 96.0, 98.0];
        let page = page(survey, rows, &times, 1.1);
        let answers = page.split("<div class=\"short\">").nth(1).unwrap().split("</div>").next().unwrap();
        let which = answers.split("<b>Which setting to use.</b>").nth(1).unwrap().split("</p>").next().unwrap();
        assert!(which.contains("he scene's own") && !which.contains("k="), "{which}");
        let matter = answers.split("<b>Which knobs matter.</b>").nth(1).unwrap().split("</p>").next().unwrap();
        assert!(matter.contains("k changes p95 by less than"), "{matter}");
        let table = section(&page, "Which setting to use");
        assert!(!table.contains("<b>k="), "{table}");
        let on_front = |times: &[f64]| trade(&timed(rows, times, 1.1)).matches("class=\"accent\"").count();
        assert_eq!(on_front(&times), 1, "only the scene's own setting");
        assert_eq!(on_front(&[100.0, 97.0, 99.0, 50.0, 98.0]), 1, "one that is faster for sure replaces it");
    });
    let outcome = Folder::new().done(&[&MEASURE[..], &["--sweep", "k=7,8"]].concat());
    for text in [&outcome.out, &outcome.err] {
        assert!(!text.contains("smaller error") && !text.contains("k = 7"), "{text}");
    }
}

/// A scene of 17×17×17 voxels of 200 where `is_inside`, and 0 elsewhere, seen along z with a pixel for each voxel.
fn straight_on(is_inside: impl Fn([f64; 3]) -> bool) -> Scene {
    let mut scene = parsed(
        r#"
        version = 1
        shading = "none"
        background = 0.2
        [volume]
        phantom = "slab"
        dims = [17, 17, 17]
        [materials.only]
        reflectance = "orange"
        [[transfer.intervals]]
        material = "only"
        range = [100, 250]
        opacity = 0.05
        [lights.day]
        spectrum = "D65"
        [camera]
        projection = "orthographic"
        height = 16
        position = [8, 8, -10]
        target = [8, 8, 0]
        [accuracy]
        termination = 0
        integration = "samples"
        "#,
    );
    let centre = |at: usize| f64::from(u8::try_from(at).unwrap()) - 8.0;
    let place = |i: usize| [i % 17, i / 17 % 17, i / 289].map(centre);
    let voxels = Voxels::U8((0..4913).map(|i| if is_inside(place(i)) { 200 } else { 0 }).collect());
    scene.set_volume(Arc::new(Volume::new("block", voxels, Geometry::unit("block", [17; 3]).unwrap()).unwrap()));
    scene
}

#[test]
fn a_row_whose_integration_is_not_that_of_the_scene_says_so() {
    let mut scene = straight_on(|_| true);
    let values = (0..4913).map(|i: usize| u8::try_from(i % 17 * 12).unwrap()).collect();
    let grid = Geometry::unit("ramp", [17; 3]).unwrap();
    scene.set_volume(Arc::new(Volume::new("ramp", Voxels::U8(values), grid).unwrap()));
    scene.accuracy.integration = Integration::Auto;
    // 16 wide: more than the values change in a step of one voxel on average over the axes, and less than in one of four.
    scene.transfer.terms = vec![Term::interval(0, [90.0, 102.0], 2.0, 0.3, 0.0)];
    let taken = |row: &Measured| (row.integration, row.other_integration);
    measured(&scene, &["step=1,4"], |_, rows| {
        let found: Vec<_> = rows[1..].iter().map(taken).collect();
        assert_eq!(found, [(Integrate::Samples, false), (Integrate::Segments, true)]);
        assert!(!rows[0].other_integration && rows[0].integration == Integrate::Samples);
        let text = to_text(rows);
        assert!(text.contains("step=4 (auto took segments)") && text.matches("auto took").count() == 1, "{text}");
    });
    // What was asked for is no surprise.
    measured(&scene, &["integration=segments"], |_, rows| assert!(!rows[1].other_integration));
}

/// From the first voxels to the last ones, a homogeneous block of 17 has 16 steps, 8 of level 1 and 4 of level 2.
#[test]
fn a_coarser_level_fades_a_thin_shell_and_changes_nothing_in_a_homogeneous_block() {
    let sweeps = ["voxel_pixels=1,2,4"];
    let row = |rows: &[Measured], pixels: f64| {
        let value = Some(Value::Number(pixels));
        rows.iter().find(|row| row.setting.get("voxel_pixels") == value).unwrap().clone()
    };
    let has_level = |row: &Measured| row.causes.iter().any(|(cause, _)| *cause == Cause::Level);
    measured(&straight_on(|_| true), &sweeps, |_, rows| {
        assert!(!has_level(&rows[0]) && !has_level(&row(rows, 1.0)), "a voxel takes a pixel");
        assert_eq!((rows[0].level, row(rows, 1.0).level.map(|level| level.level)), (None, Some(0)));
        let (text, csv) = (to_text(rows), to_csv(rows));
        assert!(text.contains("voxel_pixels=4 (level 2)") && csv.contains("level,frame_ms"), "{text}{csv}");
        for pixels in [2.0, 4.0] {
            // Rounding of f64 alone.
            let error = by(&row(rows, pixels), Cause::Level).delta_e.max;
            assert!(error <= 1e-9, "{pixels}: {error}");
            assert!(row(rows, pixels).volume_bytes < rows[0].volume_bytes / 4, "{:?}", row(rows, pixels));
            let level = row(rows, pixels).level.unwrap();
            assert_eq!((f64::from(1 << level.level), level.allowed), (pixels, pixels), "a voxel takes a pixel");
        }
    });
    let radius = |[x, y, z]: [f64; 3]| (x * x + y * y + z * z).sqrt();
    measured(&straight_on(|place| (5.0..6.0).contains(&radius(place))), &sweeps, |_, rows| {
        let [own, two, four] =
            [0.0, 2.0, 4.0].map(|pixels| if pixels > 0.0 { row(rows, pixels) } else { rows[0].clone() });
        let [two, four] = [two, four].map(|row| (by(&row, Cause::Level).delta_e.p95, row.error.delta_e.p95));
        assert!(two.0 > 1.0 && four.0 > two.0, "{two:?} {four:?}");
        // The error of the picture is that against level 0.
        assert!(own.error.delta_e.p95 < two.1 && two.1 < four.1, "{:?} {two:?} {four:?}", own.error);
    });
}
