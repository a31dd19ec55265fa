//! Palettes: reachable targets are reached, unreachable ones are reported with a proof, and saved palettes reload.
#![expect(clippy::print_stdout, reason = "a test shows what it measured")]

#[path = "../../benches/instruments/palette.rs"]
#[allow(dead_code, reason = "the tests use a part of the instrument")]
mod instrument;
#[path = "../../benches/instruments/nested.rs"]
#[allow(dead_code, reason = "the tests use a part of the instrument")]
mod nested;
use crate::support;

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

use glam::DVec3;
use instrument::hard_palettes;
use nested::{INVISIBLE, nested_levels, nested_row, random_palette};
use relume::document;
use relume::document::SceneFile;
use relume::document::SceneOptions;
use relume::measure::Stopwatch;
use relume::model::random::Random;
use relume::palette::{
    Cell, Conflict, LAMP, Member, ModelTerm, NATURAL, Palette, PaletteError, SMOOTHNESS, Solution, Target, load, parse,
    solve,
};
use relume::progress::{Progress, Quiet};
use relume::scene::Scene;
use relume::spectrum::colour::{
    Lab, LinearSrgb, OBSERVER, Xyz, ciede2000, d65_white, lab_from_xyz, linear_srgb_from_xyz, xyz, xyz_from_lab, xyz_of,
};
use relume::spectrum::deficiency::Deficiency;
use relume::spectrum::metric::difference_matrix;
use relume::spectrum::{Light, Reflectance, Spectrum, standard};
use support::program::Folder;

fn member(name: &str, bounds: [f64; 2]) -> Member {
    Member { name: name.to_owned(), spectrum: None, bounds, smoothness: SMOOTHNESS }
}

fn natural(name: &str) -> Member {
    member(name, NATURAL)
}

fn lamp(name: &str) -> Member {
    member(name, LAMP)
}

fn given(name: &str) -> Member {
    Member { spectrum: Some(standard::light(name).unwrap().spectrum().clone()), ..lamp(name) }
}

fn palette(materials: Vec<Member>, lights: Vec<Member>, cells: &[(usize, usize, Target)]) -> Palette {
    Palette {
        source: "the test's palette".to_owned(),
        inputs: Vec::new(),
        materials,
        lights,
        cells: cells.iter().map(|&(material, light, target)| Cell { material, light, target, weight: 1.0 }).collect(),
        model: None,
    }
}

fn lab(l: f64, a: f64, b: f64) -> Target {
    Target::Lab(Lab([l, a, b]))
}

const fn like(material: usize, light: usize) -> Target {
    Target::Like { material, light }
}

fn apart(one: Xyz, two: Xyz) -> f64 {
    ciede2000(lab_from_xyz(one, d65_white()), lab_from_xyz(two, d65_white()))
}

/// Solves the palette and checks its colours and differences against the integrals of its spectra.
fn solved(palette: &Palette) -> Solution {
    let clock = Stopwatch::start();
    let solution = solve(palette, &Quiet).unwrap();
    let time = clock.read();
    println!(
        "{}: {:.0} ms ({:.0} ms of CPU), worst {:.4}",
        palette.source,
        time.wall_ms,
        time.cpu_ms,
        solution.worst()
    );
    for conflict in &solution.conflicts {
        println!("  {conflict:?}");
    }
    for cell in &solution.cells {
        let seen = xyz(&solution.lights[cell.light], &solution.materials[cell.material]);
        for axis in 0..3 {
            assert!((seen.0[axis] - cell.xyz.0[axis]).abs() <= 1e-12, "{cell:?}");
        }
        if let (Some(target), Some(difference)) = (cell.target, cell.difference) {
            assert!((apart(seen, target) - difference).abs() <= 1e-9, "{cell:?}");
        }
    }
    for (row, spectrum) in palette.materials.iter().zip(&solution.materials) {
        let [low, high] = row.bounds;
        let inside = spectrum.spectrum().samples().iter().all(|sample| (low..=high).contains(sample));
        assert!(inside || row.spectrum.is_some(), "{}", row.name);
    }
    for (column, light) in palette.lights.iter().zip(&solution.lights) {
        assert!((OBSERVER[1].dot(light.spectrum()) - 1.0).abs() <= 1e-12, "{}", column.name);
        let samples = light.spectrum().samples();
        let mean = samples.iter().sum::<f64>() / 81.0;
        let inside = samples
            .iter()
            .all(|sample| *sample >= column.bounds[0] * mean && *sample <= column.bounds[1] * mean * (1.0 + 1e-6));
        assert!(inside || column.spectrum.is_some(), "{}", column.name);
    }
    solution
}

/// One light per material: figure 7 of the paper.
fn diagonal(size: usize) -> Palette {
    let colours = [
        [200, 60, 50],
        [60, 160, 70],
        [60, 90, 190],
        [200, 170, 60],
        [150, 60, 170],
        [70, 170, 180],
        [210, 120, 60],
        [130, 130, 130],
    ];
    let target = |row: usize, column: usize| if row == column { Target::Srgb(colours[row]) } else { Target::Black };
    let cells: Vec<_> =
        (0..size).flat_map(|row| (0..size).map(move |column| (row, column, target(row, column)))).collect();
    let names = |letter: &str| -> Vec<String> { (0..size).map(|index| format!("{letter}{index}")).collect() };
    palette(
        names("m").iter().map(|name| natural(name)).collect(),
        names("l").iter().map(|name| lamp(name)).collect(),
        &cells,
    )
}

#[test]
fn one_light_per_material_is_reached() {
    let solution = solved(&diagonal(4));
    assert!(solution.worst() <= 0.1);
    assert_eq!(solution.conflicts, []);
}

#[test]
fn eight_lights_for_eight_materials_are_nearly_reached() {
    // No limit is set for its colours; the time limit of 20 s is from a measurement (docs/PALETTE.md).
    assert!(solved(&diagonal(8)).worst() <= 0.5);
}

/// Daylight and tungsten are given: one grey under the first, and colours under the second at `distance` from that of a
/// neutral grey; two more lights show one material each.
fn figure5(bounds: [f64; 2], distance: f64) -> Palette {
    let grey = |light: &str| {
        let neutral = Reflectance::new(Spectrum::constant(0.28)).unwrap();
        lab_from_xyz(xyz(&standard::light(light).unwrap(), &neutral), d65_white()).0
    };
    let ([l0, a0, b0], [l1, a1, b1]) = (grey("D65"), grey("A"));
    let mut cells = Vec::new();
    for (row, [a, b]) in [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]].into_iter().enumerate() {
        cells.push((row, 0, lab(l0, a0, b0)));
        cells.push((row, 1, lab(l1, a1 + distance * a, b1 + distance * b)));
        cells.push((row, 2, if row == 3 { lab(60.0, 20.0, 30.0) } else { Target::Black }));
        cells.push((row, 3, if row == 2 { lab(60.0, -20.0, 30.0) } else { Target::Black }));
    }
    let materials = (0..4).map(|row| member(&format!("m{row}"), bounds)).collect();
    palette(materials, vec![given("D65"), given("A"), lamp("l3"), lamp("l4")], &cells)
}

#[test]
fn metamers_in_daylight_part_under_tungsten_and_under_designed_lights() {
    assert!(solved(&figure5(NATURAL, 8.0)).worst() <= 0.7);
    assert!(solved(&figure5([-1.0, 1.0], 8.0)).worst() <= 0.05);
}

/// docs/theory/palettes.md has a proven floor of 3.3 at the worst cell for the same palette.
#[test]
fn metamers_too_far_apart_come_within_a_tenth_of_what_can_be() {
    let solution = solved(&figure5(NATURAL, 16.0));
    let [conflict, others @ ..] = &solution.conflicts[..] else { panic!("nothing is impossible") };
    assert!(conflict.least > 0.5);
    assert!(conflict.reached <= 1.1 * conflict.least);
    assert!(others.iter().all(|other| other.part == conflict.part));
    assert!(solution.worst() > 2.5);
}

/// With open lights the proven bound is not tight, and the report says so.
#[test]
fn how_near_one_can_come_with_an_open_light_is_called_unknown() {
    let near = solved(&figure5(NATURAL, 8.0));
    assert!(near.conflicts[0].reached <= 1.2 * near.conflicts[0].least);
    for solution in [near, solved(&smoke(0.0, vec![given("D65"), lamp("b")]))] {
        let lines = solution.sentences();
        assert!(lines.iter().any(|line| line.contains("open light") && line.contains("unknown")), "{lines:?}");
        assert!(lines.iter().any(|line| line.starts_with("Changes that may help: ")), "{lines:?}");
    }
}

/// All materials that are impossible by themselves are named, not only the first one.
#[test]
fn every_conflict_is_told() {
    let grey = Target::Xyz(Xyz([0.19, 0.2, 0.218]));
    let mut cells = Vec::new();
    for row in 0..3 {
        cells.extend([(row, 0, grey), (row, 1, like(row, 0)), (row, 2, Target::Black)]);
    }
    // The third has no target under the bulb.
    cells.remove(7);
    let rows = vec![natural("one"), natural("two"), natural("three")];
    let solution = solved(&palette(rows, vec![given("D65"), given("A"), lamp("hides")], &cells));
    let cores: Vec<_> = solution.conflicts.iter().map(|conflict| conflict.cells.clone()).collect();
    assert_eq!(cores, [[(0, 0), (0, 1)], [(1, 0), (1, 1)]]);
    for (conflict, name) in solution.conflicts.iter().zip(["one", "two"]) {
        let free = format!("leave {name} under A free");
        assert!(conflict.ways_out.iter().any(|way| way.to_string() == free), "{:?}", conflict.ways_out);
    }
    // A material's target counts for every material that must match it.
    let cells = [(0, 0, grey), (1, 0, like(0, 0)), (1, 1, like(0, 0)), (2, 0, like(0, 0)), (2, 1, like(0, 0))];
    let rows = vec![natural("one"), natural("two"), natural("three")];
    let solution = solved(&palette(rows, vec![given("D65"), given("A")], &cells));
    let cores: Vec<_> = solution.conflicts.iter().map(|conflict| conflict.cells.clone()).collect();
    assert_eq!(cores, [[(0, 0), (1, 0), (1, 1)], [(0, 0), (2, 0), (2, 1)]]);
}

#[test]
fn a_light_that_cannot_dim_is_given_as_the_reason() {
    let row = Member { spectrum: Some(Spectrum::constant(0.4)), ..natural("grey") };
    let solution = solved(&palette(vec![row], vec![lamp("lamp")], &[(0, 0, Target::Black)]));
    let reason = &only(&solution).reason;
    assert!(reason.contains("grey has Y = 0.4 to 0.4, not Y = 0"), "{reason}");
}

fn only(solution: &Solution) -> &Conflict {
    assert_eq!(solution.conflicts.len(), 1, "{:?}", solution.conflicts);
    &solution.conflicts[0]
}

/// Smoke that is black under the first light and white under the second, and two materials that match under both.
fn smoke(low: f64, lights: Vec<Member>) -> Palette {
    let cells = [
        (0, 0, Target::Black),
        (0, 1, Target::Xyz(Xyz([0.475, 0.5, 0.545]))),
        (1, 0, lab(60.0, 30.0, 20.0)),
        (1, 1, like(1, 0)),
        (2, 0, lab(50.0, -30.0, 20.0)),
        (2, 1, like(2, 0)),
    ];
    palette(vec![member("smoke", [low, 1.0]), natural("one"), natural("two")], lights, &cells)
}

#[test]
fn a_metameric_black_is_reached_with_designed_lights_or_with_negative_parts() {
    assert!(solved(&smoke(0.0, vec![lamp("a"), lamp("b")])).worst() <= 0.1);
    let signed = solved(&smoke(-1.0, vec![given("D65"), lamp("b")]));
    assert!(signed.worst() <= 0.1);
    assert!(signed.material_facts[0].negative > 0.05 && signed.material_facts[0].lowest < -0.1);
}

/// Σ ȳ·l·r = 0 with ȳ·l > 0 and r ≥ 0 leaves r = 0 (docs/theory/palettes.md).
#[test]
fn no_surface_is_a_metameric_black_in_daylight() {
    let solution = solved(&smoke(0.0, vec![given("D65"), lamp("b")]));
    let conflict = only(&solution);
    assert_eq!(conflict.cells, [(0, 0), (0, 1)]);
    assert!(conflict.least > 0.5 && conflict.reached >= conflict.least);
    assert!(conflict.reason.contains("D65 has power at every wavelength"), "{}", conflict.reason);
    for way in ["leave smoke under D65 free", "give smoke the bounds [-1.0, 1.0]", "leave the light D65 open"] {
        assert!(conflict.ways_out.iter().any(|said| said.to_string().contains(way)), "{way}: {:?}", conflict.ways_out);
    }
}

/// No reflectance from 0 to 1 is black under D65 and white under another light, but one that reflects only the ends of the
/// range and a narrow band comes near. The combs alone come to ΔE00 17.3; random starts to 6.7 at best.
#[test]
fn a_surface_nearly_black_in_daylight_is_nearly_white_under_a_designed_light() {
    let cells = [(0, 0, Target::Black), (0, 1, lab(95.0, 0.0, 0.0))];
    let solution = solved(&palette(vec![natural("smoke")], vec![given("D65"), lamp("b")], &cells));
    assert!(solution.worst() <= 7.0, "{}", solution.worst());
}

/// Asserts that no peak of the open second light is worse than a smaller one. Every solution within narrow bounds is one
/// within wider bounds.
fn assert_wider_is_never_worse(palette: &Palette, peaks: [f64; 3]) {
    let worst = peaks.map(|most| {
        let mut palette = palette.clone();
        palette.lights[1].bounds[1] = most;
        solved(&palette).worst()
    });
    assert!(worst.is_sorted_by(|narrow, wide| narrow >= wide), "{}: {worst:?}", palette.source);
}

#[test]
fn wider_bounds_of_a_light_are_never_worse() {
    // With the first starts alone: 7.1, 9.1 and 9.1.
    assert_wider_is_never_worse(&smoke(0.0, vec![given("D65"), lamp("b")]), [2.0, 3.0, 10.0]);
    for hard in hard_palettes() {
        assert_wider_is_never_worse(&hard.palette, [3.0, 10.0, 30.0]);
    }
}

/// Random bounds of each spectrum, of a seed where a search without these promises fails. Others: the instrument `nested`.
#[test]
fn neither_wider_bounds_than_the_defaults_nor_a_known_start_are_ever_worse() {
    let row = nested_row(28, |name| Some(standard::light(name).ok()?.spectrum().clone()), &Quiet).unwrap();
    assert!(row.holds(), "{row:?}");
}

/// Targets out of reach, for which the least squares within wider bounds may have a larger maximum: without the search that
/// minimises the maximum, seeds 84 and 67 end worse by 0.15 and 35; seed 28 does by 0.5 with one metric alone.
#[test]
fn wider_bounds_are_not_visibly_worse_where_least_squares_made_them_so() {
    for (seed, narrow, wide) in [(28, 1, 2), (84, 0, 3), (67, 0, 2)] {
        let palette = random_palette(seed, |name| Some(standard::light(name).ok()?.spectrum().clone()));
        let levels = nested_levels(&palette, seed);
        let [narrow, wide] = [narrow, wide].map(|level: usize| solved(&levels[level]).worst());
        assert!(
            narrow > 10.0 && wide <= narrow + INVISIBLE,
            "{seed}: {narrow} within narrow bounds, {wide} within wide ones"
        );
    }
}

/// docs/theory/palettes.md: from D65 to A no surface keeps its colour; from D65 to FL2 a grey of Y = 0.2 does.
#[test]
fn constancy_from_daylight_to_tungsten_is_impossible_and_to_a_tube_possible() {
    let grey = |light: &str| {
        let cells = [(0, 0, Target::Xyz(Xyz([0.19, 0.2, 0.218]))), (0, 1, like(0, 0))];
        solved(&palette(vec![natural("grey")], vec![given("D65"), given(light)], &cells))
    };
    let (bulb, tube) = (grey("A"), grey("FL2"));
    let conflict = only(&bulb);
    assert!(conflict.least > 5.0 && conflict.reached <= 1.01 * conflict.least);
    assert_eq!(conflict.cells, [(0, 0), (0, 1)]);
    assert_eq!(tube.conflicts, []);
    assert!(tube.worst() <= 0.01);
}

/// Without a target colour, black keeps its colour everywhere; the report says so.
#[test]
fn what_looks_alike_by_being_black_is_told() {
    let bright = [(0, 0, like(1, 0)), (1, 0, Target::Xyz(Xyz([0.002, 0.002, 0.002])))];
    let asked = solved(&palette(vec![natural("one"), natural("two")], vec![given("D65")], &bright));
    assert_eq!(asked.dark_merges, []);
    let cells = [(0, 0, like(1, 1)), (1, 0, Target::Black)];
    let dark = solved(&palette(vec![natural("one"), natural("two")], vec![given("D65"), given("A")], &cells));
    assert_eq!(dark.dark_merges.len(), 1);
    assert!(dark.sentences().iter().any(|line| line.contains("one under D65 matches two under A")));
}

/// Random targets under two or three given lights. For a possible palette, the spectra are the proof. For an impossible
/// one, the proof is a half-space: with y = F·(colours − targets) of the spectra found, every reflectance r from 0 to 1
/// has
/// y·F(A·r − c) ≥ Σ min(0, Aᵀ Fᵀ y) − y·F c, a sum that needs no solver.
#[test]
fn random_palettes_under_given_lights_are_judged_rightly() {
    let names = ["D65", "A", "FL2", "FL11", "LED-RGB1", "LED-B3"];
    let mut random = Random::new(7);
    let mut judged = [0, 0];
    for _ in 0..20 {
        let mut lights: Vec<&str> = Vec::new();
        while lights.len() < 2 + random.index(2) {
            let name = names[random.index(names.len())];
            if !lights.contains(&name) {
                lights.push(name);
            }
        }
        let spread = random.between(0.0, 30.0);
        let patch =
            standard::reflectance(["orange", "foliage", "blue sky", "neutral 5 (.70 D)"][random.index(4)]).unwrap();
        let targets: Vec<Xyz> = lights
            .iter()
            .map(|name| {
                let Lab([l, a, b]) = lab_from_xyz(xyz(&standard::light(name).unwrap(), &patch), d65_white());
                let moved = Lab([l, a + random.between(-spread, spread), b + random.between(-spread, spread)]);
                xyz_from_lab(moved, d65_white())
            })
            .collect();
        let cells: Vec<_> =
            targets.iter().enumerate().map(|(column, &target)| (0, column, Target::Xyz(target))).collect();
        let mut row = natural("row");
        row.smoothness = 1e-9;
        let solution = solved(&palette(vec![row], lights.iter().map(|name| given(name)).collect(), &cells));
        judged[usize::from(solution.conflicts.is_empty())] += 1;
        if solution.conflicts.is_empty() {
            assert!(solution.worst() <= 0.1);
            continue;
        }
        let conflict = only(&solution);
        let (mut slopes, mut offset, mut size) = ([0.0; 81], 0.0, 0.0);
        for (cell, target) in solution.cells.iter().zip(&targets) {
            let form = difference_matrix(*target);
            let target = DVec3::from(target.0);
            let residual = form * (DVec3::from(cell.xyz.0) - target);
            let pull = form.transpose() * residual;
            for (band, slope) in slopes.iter_mut().enumerate() {
                let observed: f64 = (0..3).map(|axis| pull[axis] * OBSERVER[axis].samples()[band]).sum();
                *slope += observed * solution.lights[cell.light].spectrum().samples()[band];
            }
            offset += pull.dot(target);
            size += residual.length_squared();
        }
        let least = slopes.iter().map(|slope| slope.min(0.0)).sum::<f64>() - offset;
        let count: f64 = targets.iter().map(|_| 1.0).sum();
        let proved = least / size.sqrt() / count.sqrt();
        assert!(proved >= 0.97 * conflict.least && proved > 0.0, "{proved} for {}", conflict.least);
        assert!(conflict.reached <= 1.05 * conflict.least);
        // With the default smoothness of spectra.
        let mut smooth = solution.palette.clone();
        smooth.materials[0].smoothness = SMOOTHNESS;
        let smooth = solved(&smooth);
        assert!(only(&smooth).reached <= 1.1 * only(&smooth).least);
    }
    assert!(judged[0] >= 5 && judged[1] >= 5, "{judged:?} are impossible and possible");
}

#[test]
fn colours_outside_every_gamut_are_reached_as_far_as_can_be_and_told() {
    let cases = [
        (Target::Xyz(Xyz([1.9, 2.0, 2.1])), "cannot reach Y = 2"),
        (lab(50.0, 0.0, 150.0), "has this colour"),
        (Target::Xyz(Xyz([-0.2, 0.3, 0.1])), "has this colour"),
    ];
    for (target, words) in cases {
        for light in [given("D65"), lamp("open")] {
            let solution = solved(&palette(vec![natural("one")], vec![light], &[(0, 0, target)]));
            let conflict = only(&solution);
            assert!(conflict.reason.contains(words), "{}", conflict.reason);
            assert!(conflict.reached <= 1.1 * conflict.least, "{conflict:?}");
            assert!(solution.worst() > 1.0);
        }
    }
}

#[test]
fn cells_that_contradict_each_other_share_the_error() {
    let cells = [(0, 0, lab(50.0, 0.0, 0.0)), (1, 0, lab(60.0, 0.0, 0.0)), (0, 1, like(1, 0)), (1, 1, like(0, 0))];
    let mut contradictory = palette(vec![natural("one"), natural("two")], vec![given("D65"), given("D65")], &cells);
    contradictory.lights[1].name = "again".to_owned();
    let solution = solved(&contradictory);
    // Each material with the other's colour.
    assert_eq!(solution.conflicts.len(), 2);
    assert!(solution.conflicts.iter().all(|conflict| conflict.least > 1.0));
    assert!(solution.cells.iter().all(|cell| cell.difference.unwrap() > 1.0));
}

#[test]
fn given_spectra_are_not_touched() {
    let foliage = standard::reflectance("foliage").unwrap();
    let row = Member { spectrum: Some(foliage.spectrum().clone()), ..natural("leaf") };
    let solution =
        solved(&palette(vec![row, natural("other")], vec![given("D65")], &[(0, 0, Target::Black), (1, 0, like(0, 0))]));
    assert_eq!(solution.materials[0], foliage);
    assert!(!solution.material_facts[0].open && solution.material_facts[1].open);
    assert!(solution.cell(0, 0).unwrap().difference.unwrap() > 10.0);
    assert!(solution.cell(1, 0).unwrap().difference.unwrap() <= 0.01);
}

#[test]
fn a_model_settled_beforehand_shows_the_colours_it_was_designed_for() {
    let plain = load(&examples().join("metamers_two_lights.toml")).unwrap();
    let with = |weight| solved(&Palette { model: Some(ModelTerm { dimension: 8, weight }), ..plain.clone() });
    let off = |solution: &Solution| solution.cells.iter().map(|cell| cell.shown.unwrap().1).fold(0.0, f64::max);
    let (asked, hardly) = (with(1.0), with(1e-6));
    println!("the model is off by {:.2}, and by {:.2} where it hardly counts", off(&asked), off(&hardly));
    // docs/theory/palettes.md: 53 without the term and 1.6 with it.
    assert!(off(&asked) <= 1.6 && asked.worst() <= 0.5);
    assert!(off(&hardly) > 10.0);
}

#[test]
fn equal_palettes_have_equal_solutions_on_any_number_of_threads() {
    let palette = figure5(NATURAL, 8.0);
    let on = |threads| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap()
            .install(|| solve(&palette, &Quiet).unwrap())
    };
    assert_eq!(on(1), on(3));
}

#[test]
fn the_order_of_rows_and_columns_does_not_change_the_spectra() {
    let straight = figure5(NATURAL, 8.0);
    let (rows, columns) = ([2, 0, 3, 1], [3, 1, 0, 2]);
    let mut turned = straight.clone();
    for (from, &to) in rows.iter().enumerate() {
        turned.materials[to] = straight.materials[from].clone();
    }
    for (from, &to) in columns.iter().enumerate() {
        turned.lights[to] = straight.lights[from].clone();
    }
    for cell in &mut turned.cells {
        (cell.material, cell.light) = (rows[cell.material], columns[cell.light]);
    }
    turned.cells.reverse();
    let (straight, turned) = (solved(&straight), solved(&turned));
    for (from, &to) in rows.iter().enumerate() {
        assert_eq!(straight.materials[from], turned.materials[to]);
    }
    for (from, &to) in columns.iter().enumerate() {
        assert_eq!(straight.lights[from], turned.lights[to]);
    }
    let told = |solution: &Solution| -> Vec<(f64, f64)> {
        solution.conflicts.iter().map(|conflict| (conflict.least, conflict.reached)).collect()
    };
    assert_eq!(told(&straight), told(&turned));
    assert_eq!(straight.cell(1, 2).unwrap().difference, turned.cell(rows[1], columns[2]).unwrap().difference);
}

#[test]
fn work_that_is_cancelled_stops() {
    struct Impatient(AtomicU64);
    impl Progress for Impatient {
        fn report(&self, _stage: &str, _done: u64, _total: u64) {
            self.0.fetch_add(1, Ordering::Relaxed);
        }
        fn cancelled(&self) -> bool {
            self.0.load(Ordering::Relaxed) >= 3
        }
    }
    let outcome = solve(&figure5(NATURAL, 8.0), &Impatient(AtomicU64::new(0)));
    assert!(matches!(outcome, Err(PaletteError::Cancelled)));
}

#[test]
fn a_palette_that_cannot_be_is_told_so() {
    let refused = |palette: &Palette, words: &str| {
        let error = solve(palette, &Quiet).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    };
    refused(&palette(vec![natural("one")], Vec::new(), &[]), "it has no lights");
    refused(&palette(Vec::new(), vec![given("D65")], &[]), "it has no materials");
    let many: Vec<Member> = (0..100).map(|index| natural(&format!("m{index}"))).collect();
    let lamps: Vec<Member> = (0..100).map(|index| lamp(&format!("l{index}"))).collect();
    refused(&palette(many, lamps, &[]), "it has 100 materials, but at most 32 can be designed together");
    let one = |target| palette(vec![natural("one")], vec![given("D65")], &[(0, 0, target)]);
    refused(&one(lab(f64::NAN, 0.0, 0.0)), "one under D65 is not finite");
    refused(&one(Target::Xyz(Xyz([1e9; 3]))), "1000 times white");
    refused(&one(like(0, 0)), "is the cell itself");
    refused(&one(like(3, 0)), "missing material or light");
    refused(&palette(vec![member("one", [1.0, 0.0])], vec![given("D65")], &[]), "the bounds of one are 1 to 0");
    refused(
        &palette(vec![natural("one")], vec![member("dim", [0.0, 0.5])], &[]),
        "the lower from -1000 to below 1 and the upper from above 1 to 1000",
    );
    let mut uneven = palette(vec![natural("one")], vec![given("D65")], &[(0, 0, Target::Black)]);
    uneven.cells[0].weight = 1e300;
    refused(&uneven, "the weight of the cell one under D65 is 1e300; it must be a number from 1e-6 to 1000000");
    uneven.materials[0].smoothness = 1e300;
    refused(&uneven, "the smoothness of one is 1e300; it must be a number from 1e-12 to 1000000");
}

// ---- files ----

fn examples() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("data/palettes")
}

fn example(name: &str) -> Solution {
    solved(&load(&examples().join(name)).unwrap())
}

/// ΔE00 between two cells, by name.
fn between(solution: &Solution, one: (&str, &str), two: (&str, &str)) -> f64 {
    let seen = |(row, column): (&str, &str)| {
        let index = |members: &[Member], name: &str| members.iter().position(|member| member.name == name).unwrap();
        let palette = &solution.palette;
        solution.cell(index(&palette.materials, row), index(&palette.lights, column)).unwrap().xyz
    };
    apart(seen(one), seen(two))
}

#[test]
fn every_example_has_its_effect() {
    let mut seen = 0;
    let mut check = |name: &str, worst: f64, alike: &[[(&str, &str); 2]], unlike: &[[(&str, &str); 2]]| {
        let solution = example(name);
        assert!(solution.worst() <= worst, "{name}: {}", solution.worst());
        for &[one, two] in alike {
            assert!(between(&solution, one, two) <= worst, "{name}: {one:?} {two:?}");
        }
        for &[one, two] in unlike {
            assert!(between(&solution, one, two) >= 10.0, "{name}: {one:?} {two:?}");
        }
        seen += 1;
    };
    check("metamers.toml", 0.1, &[[("rock", "day"), ("ore", "day")]], &[[("rock", "bulb"), ("ore", "bulb")]]);
    check(
        "metamers_two_lights.toml",
        0.1,
        &[[("rock", "day"), ("ore", "day")], [("rock", "bulb"), ("ore", "bulb")]],
        &[[("rock", "probe"), ("ore", "probe")]],
    );
    check(
        "metameric_black.toml",
        0.1,
        &[[("core", "hides"), ("core", "shows")]],
        &[[("smoke", "hides"), ("smoke", "shows")]],
    );
    check(
        "metameric_black_two_lights.toml",
        0.1,
        &[[("smoke", "hides"), ("smoke", "hides_too")]],
        &[[("smoke", "hides"), ("smoke", "shows")]],
    );
    check("xray.toml", 0.1, &[[("inside", "removes"), ("inside", "day")]], &[[("shell", "removes"), ("shell", "day")]]);
    check(
        "constancy.toml",
        0.1,
        &[[("block", "day"), ("block", "evening")]],
        &[[("valve", "day"), ("valve", "evening")], [("pin", "day"), ("pin", "evening")]],
    );
    check(
        "one_light_each.toml",
        0.1,
        &[],
        &[[("skin", "for_skin"), ("skin", "for_bone")], [("bone", "for_bone"), ("skin", "for_bone")]],
    );
    check("negative.toml", 0.1, &[[("core", "day"), ("core", "shows")]], &[[("smoke", "day"), ("smoke", "shows")]]);
    check(
        "background.toml",
        0.1,
        &[[("vessel", "merges"), ("background", "merges")], [("tissue", "parts"), ("background", "parts")]],
        &[[("vessel", "parts"), ("background", "parts")]],
    );
    check(
        "daylight_and_bulb.toml",
        0.7,
        &[[("flesh", "day"), ("eyes", "day")], [("heart", "day"), ("stomach", "day")]],
        &[[("flesh", "bulb"), ("stomach", "bulb")], [("eyes", "marks_eyes"), ("flesh", "marks_eyes")]],
    );
    check("one_light_each_of_eight.toml", 0.5, &[], &[[("m0", "l0"), ("m0", "l1")], [("m7", "l7"), ("m0", "l7")]]);
    assert_eq!(std::fs::read_dir(examples()).unwrap().count(), seen, "an example is not tested");
}

#[test]
fn a_solved_palette_comes_back_with_the_very_colours() {
    let solution = example("metameric_black.toml");
    let text = solution.to_toml();
    let back = parse("solved.toml", &text, Path::new("")).unwrap();
    assert!(back.materials.iter().chain(&back.lights).all(|member| member.spectrum.is_some()));
    assert_eq!(back.cells, solution.palette.cells);
    let again = solved(&back);
    for (one, two) in solution.cells.iter().zip(&again.cells) {
        for axis in 0..3 {
            assert!((one.xyz.0[axis] - two.xyz.0[axis]).abs() <= 1e-12);
        }
    }
    assert_eq!(again.conflicts, []);
}

#[test]
fn names_of_any_letters_survive_a_file() {
    let mut odd = diagonal(1);
    odd.materials[0].name = "a \"quoted\" [name] with ü = and\nlines".to_owned();
    odd.lights[0].name = String::new();
    let back = parse("odd", &solved(&odd).to_toml(), Path::new("")).unwrap();
    assert_eq!((&back.materials[0].name, &back.lights[0].name), (&odd.materials[0].name, &odd.lights[0].name));
}

const SMALL: &str = r##"version = 1
[lights.day]
spectrum = "D65"
[lights.lamp]
[materials.flesh]
bounds = [0, 0.9]
[materials.bone]
reflectance = "white 9.5"
[cells.flesh]
day = "#808080"
lamp = { target = "as bone under day", weight = 2 }
[cells.bone]
lamp = "free"
"##;

#[test]
fn a_palette_file_says_what_it_says() {
    let palette = parse("small.toml", SMALL, Path::new("")).unwrap();
    assert_eq!(palette.materials[0], member("flesh", [0.0, 0.9]));
    assert!(palette.materials[1].spectrum.is_some() && palette.lights[1] == lamp("lamp"));
    let cells = [
        Cell { material: 0, light: 0, target: Target::Srgb([128; 3]), weight: 1.0 },
        Cell { material: 0, light: 1, target: like(1, 0), weight: 2.0 },
    ];
    assert_eq!(palette.cells, cells);
    let texts = [(0, 0, "#808080"), (0, 1, "as bone under day"), (1, 0, "free"), (1, 1, "free")];
    for (row, column, text) in texts {
        assert_eq!(palette.target_text(row, column), text);
    }
    let open = parse("small.toml", &SMALL.replace("\"D65\"", "\"open\""), Path::new("")).unwrap();
    assert_eq!(open.lights[0], lamp("day"));
}

#[test]
fn what_is_wrong_with_a_palette_file_is_told_where_it_stands() {
    let cases = [
        ("version = 1", "version = 2", "small.toml:1:11: version = 2; this program reads version 1"),
        ("version = 1\n", "", "small.toml:1:1: missing field `version`"),
        ("[cells.flesh]", "[cells.flash]", "small.toml:9:1: there is no material \"flash\"; did you mean \"flesh\"?"),
        ("lamp = \"free\"", "lmap = \"free\"", "small.toml:13:8: there is no light \"lmap\"; did you mean \"lamp\"?"),
        ("\"#808080\"", "\"#80808\"", "small.toml:10:7: cells.flesh.day:"),
        ("\"#808080\"", "\"grey\"", "small.toml:10:7: cells.flesh.day: \"grey\" is not a target"),
        ("\"#808080\"", "{ xyz = [0.1, nan, 0.2] }", "is not a colour; a colour has three finite numbers"),
        ("\"#808080\"", "{ xyz = [0.1, 0.1, 0.2], target = \"black\" }", "exactly one of `target`, `xyz` and `lab`"),
        ("\"#808080\"", "3", "small.toml:10:7: a cell is a string"),
        ("weight = 2", "weight = 0", "small.toml:11:8: cells.flesh.lamp: weight = 0"),
        ("as bone under day", "as bones", "there is no material \"bones\"; did you mean \"bone\"?"),
        ("as bone under day", "as under dya", "there is no light \"dya\"; did you mean \"day\"?"),
        ("[0, 0.9]", "[0.9, 0]", "small.toml:6:10: materials.flesh.bounds: 0.9 to 0"),
        ("[0, 0.9]", "[0.9, nan]", "materials.flesh.bounds: 0.9 to NaN"),
        ("bounds", "bonds", "small.toml:6:1: unknown field `bonds`"),
        ("\"white 9.5\"", "\"whit 9.5\"", "small.toml:8:15: materials.bone.reflectance"),
        (
            "[lights.lamp]",
            "[lights.lamp]\nsmoothness = 0",
            "lights.lamp.smoothness: 0; it must be a number from 1e-12 to 1000000",
        ),
        ("[0, 0.9]", "[0, 1e300]", "materials.flesh.bounds: 0 to 1e300; they must be two numbers from -1000 to 1000"),
        (
            "[lights.lamp]",
            "[lights.lamp]\nbounds = [0, 1e300]",
            "the lower from -1000 to below 1 and the upper from above 1 to 1000",
        ),
        ("weight = 2", "weight = 1e300", "weight = 1e300; it must be a number from 1e-6 to 1000000"),
        ("weight = 2", "wieght = 2", "cells.flesh.lamp: unknown field `wieght`"),
        ("weight = 2", "weight = \"two\"", "cells.flesh.lamp: invalid type: string \"two\", expected a number"),
        ("version = 1", "version = 1\nmodel = { k = 32 }", "model.k = 32; it must be a whole number from 1 to 31"),
        ("version = 1", "version = 1\nuse = \"x\"", "`use` is only allowed in the [palette] of a scene"),
    ];
    for (from, to, words) in cases {
        assert!(SMALL.contains(from), "{from}");
        let error = parse("small.toml", &SMALL.replacen(from, to, 1), Path::new("")).unwrap_err().to_string();
        assert!(error.contains(words), "{to}: {error}");
    }
}

// ---- scenes ----

fn scene(palette: &str, rest: &str) -> Result<SceneFile, document::SceneError> {
    let text = format!("version = 1\n{rest}\n[volume]\nphantom = \"slab\"\ndims = [4, 4, 4]\n{palette}\n");
    document::parse("a scene", &text, &examples(), &SceneOptions::default(), &Quiet)
}

#[test]
fn a_scene_takes_its_spectra_from_a_palette() {
    let palette = example("background.toml");
    let used = scene(
        "[palette]\nuse = \"background.toml\"\n[materials.vessel]\nxray = true\n[materials.tissue]\nreflectance = 0.5\n[lights.parts]\nintensity = 2\n",
        "",
    )
    .unwrap();
    assert_eq!(used.inputs, [examples().join("background.toml")]);
    let used = used.scene;
    let names: Vec<&str> = used.materials.iter().map(|material| material.name.as_str()).collect();
    assert_eq!(names, ["tissue", "vessel"]);
    assert!(used.materials[1].is_xray() && used.materials[1].reflectance == palette.materials[2]);
    // Definitions in the scene itself take precedence.
    assert_eq!(used.materials[0].reflectance, Reflectance::new(Spectrum::constant(0.5)).unwrap());
    assert_eq!(used.background.as_ref(), Some(&palette.materials[0]));
    let lights: Vec<(&str, f64)> = used.lights.iter().map(|light| (light.name.as_str(), light.intensity)).collect();
    assert_eq!(lights, [("merges", 1.0), ("parts", 2.0)]);
    for axis in 0..3 {
        let seen = xyz(&used.lights[1].spectrum, &used.materials[1].reflectance).0[axis];
        assert!((seen - palette.cell(2, 1).unwrap().xyz.0[axis]).abs() <= 1e-12);
    }
}

#[test]
fn a_palette_stands_in_a_scene_too() {
    let text = SMALL.replace("version = 1\n", "").replace('[', "[palette.").replace("= [palette.", "= [");
    let used = scene(&text, "").unwrap().scene;
    assert_eq!(used.materials.len(), 2);
    assert_eq!(used.materials[0].reflectance, standard::reflectance("white 9.5").unwrap());
    let define = |definition: &str| {
        let text = format!("version = 1\n[volume]\nphantom = \"slab\"\ndims = [4, 4, 4]\n{text}");
        let options =
            SceneOptions { definitions: vec![document::Definition::new(definition)], ..SceneOptions::default() };
        document::parse("a scene", &text, Path::new(""), &options, &Quiet)
    };
    let dark = define("palette.cells.flesh.day=#202020").unwrap().scene;
    let seen = |scene: &Scene| xyz(&scene.lights[0].spectrum, &scene.materials[1].reflectance).0[1];
    assert!(seen(&dark) < 0.5 * seen(&used));
    let error = define("palette.cells.flesh.day=gray").unwrap_err().to_string();
    assert!(error.contains("palette.cells.flesh.day=gray"), "{error}");
}

#[test]
fn a_definition_that_says_nothing_new_leaves_a_designed_scene_as_it_is() {
    let text = r##"version = 1
        [volume]
        phantom = "slab"
        dims = [4, 4, 4]
        [palette.lights.zeta]
        [palette.lights.alpha]
        [palette.materials.skin]
        [palette.materials.bone]
        [palette.cells]
        skin = { zeta = "#8f8f8f", alpha = "#40a040" }
        bone = { zeta = "as skin" }
        "##;
    let with = |definitions: Vec<document::Definition>| {
        let options = SceneOptions { definitions, ..SceneOptions::default() };
        document::parse("a scene", text, Path::new(""), &options, &Quiet).unwrap().scene
    };
    let (plain, defined) = (with(Vec::new()), with(vec![document::Definition::new("display.exposure=1")]));
    assert_eq!(plain.lights, defined.lights);
    assert_eq!(plain.materials, defined.materials);
    // The designed palette is that of the scene.
    let designed = solve(&parse("a scene", text, Path::new("")).unwrap(), &Quiet).unwrap();
    assert_eq!(designed.palette.lights[0].name, "zeta");
    let skin = plain.materials.iter().find(|material| material.name == "skin").unwrap();
    assert_eq!(skin.reflectance, designed.materials[0]);
}

#[test]
fn what_is_wrong_with_a_scenes_palette_is_told() {
    let refused = |palette: &str, words: &str| {
        let error = scene(palette, "").unwrap_err();
        let mut told = error.to_string();
        let mut cause = std::error::Error::source(&error);
        while let Some(error) = cause {
            told.push_str(&format!("\n{error}"));
            cause = error.source();
        }
        assert!(told.contains(words), "{told}");
    };
    refused("[palette]\nuse = \"nothing.toml\"", "cannot read the palette");
    refused("[palette]\nuse = \"xray.toml\"\n[palette.lights.x]\n", "`use` has no other keys");
    refused("[palette.materials.x]\n", "it has no lights");
    refused("[palette.lights.x]\nspectrum = \"D66\"", "a scene:7:12: lights.x.spectrum");
    refused("[palette]\nuse = \"xray.toml\"\n[materials.other]\n", "missing field `reflectance`");
    refused("[palette]\nuse = \"xray.toml\"\n[lights.other]\n", "missing field `spectrum`");
}

// ---- the command line ----

#[test]
fn the_program_designs_saves_and_draws() {
    let folder = Folder::new().with("small.toml", SMALL);
    let done = folder.done(&[
        "design",
        "small.toml",
        "-o",
        "solved.toml",
        "--report",
        "r.svg",
        "--report",
        "r.html",
        "--report",
        "r.png",
    ]);
    for words in
        ["flesh", "#808080 → #808080", "as bone under day → ", "The largest ΔE00 is", "wrote solved.toml, r.svg"]
    {
        assert!(done.out.contains(words), "no {words:?} in {}", done.out);
    }
    let text = |name: &str| std::fs::read_to_string(folder.path(name)).unwrap();
    assert!(text("r.svg").starts_with("<svg") && text("r.html").contains("<svg") && text("r.svg").contains("tritan"));
    assert!(std::fs::read(folder.path("r.png")).unwrap().starts_with(b"\x89PNG"));
    let json = |folder: &Folder, file: &str| folder.done(&["design", file, "--json"]).json();
    let (open, closed) = (json(&folder, "small.toml"), json(&folder, "solved.toml"));
    for (one, two) in open["cells"].as_array().unwrap().iter().zip(closed["cells"].as_array().unwrap()) {
        for axis in 0..3 {
            let [one, two] = [one, two].map(|cell| cell["reached"]["xyz"][axis].as_f64().unwrap());
            assert!((one - two).abs() <= 1e-6);
        }
    }
    let scene = r#"version = 1
        [volume]
        phantom = "slab"
        [palette]
        use = "small.toml""#;
    let folder = folder.with("used.toml", scene);
    assert_eq!(folder.done(&["design", "used.toml", "--json"]).json()["cells"], open["cells"]);
    folder.refused(2, &["design", "used.toml", "-o", "small.toml"], &["small.toml is an input"]);
    assert_eq!(open["materials"][0]["open"], true);
    assert_eq!(closed["lights"][1]["open"], false);
}

/// A red that D65 does not show comes from the end of the range alone. Broad spectra lean on nothing.
#[test]
fn design_tells_what_leans_on_the_edge_of_the_visible_range() {
    let leaning = r##"version = 1
        [lights.day]
        spectrum = "D65"
        [lights.reveals]
        [materials.hidden]
        [cells.hidden]
        day = "black"
        reveals = { lab = [50, 60, 40] }"##;
    let plain = r##"version = 1
        [lights.day]
        spectrum = "D65"
        [materials.grey]
        [cells.grey]
        day = "#808080""##;
    let folder = Folder::new().with("leaning.toml", leaning).with("plain.toml", plain);
    let done = folder.done(&["design", "leaning.toml"]);
    for words in ["hidden under reveals leans on the edge", "smoothness = 0.001: largest ΔE00", "smoothness = 0.1"] {
        assert!(done.out.contains(words), "no {words:?} in {}", done.out);
    }
    let json = folder.done(&["design", "leaning.toml", "--json"]).json();
    let worst = |value: &serde_json::Value| value["worst"].as_f64().unwrap();
    assert!(json["edges"][0]["above_690_nm"].as_f64().unwrap() > 0.25, "{json}");
    assert!(worst(&json["smoother"][2]) > worst(&json), "smoothness costs nothing: {json}");
    let plain = |more: &[&str]| folder.done(&[&["design", "plain.toml", "--json"], more].concat()).json();
    let json = plain(&[]);
    assert_eq!((json["edges"].as_array().unwrap().len(), json["smoother"].as_array().unwrap().len()), (0, 0));
    let compared = plain(&["--compare-smoothness"])["smoother"].clone();
    let names = compared.as_array().unwrap().iter().map(|one| one["name"].as_str().unwrap()).collect::<Vec<_>>();
    assert_eq!(names, ["smooth", "smoother", "smoothest"]);
    assert_eq!(plain(&["--smoothness", "smooth", "--compare-smoothness"])["smoother"].as_array().unwrap().len(), 2);
    let text = folder.done(&["design", "plain.toml", "--smoothness", "1", "--compare-smoothness"]).out;
    assert!(text.contains("No preset is smoother"), "{text}");
}

/// Compares presets: smoother spectra, and their price.
#[test]
fn a_preset_of_smoothness_costs_what_the_comparison_says_and_bends_less() {
    let folder = Folder::new().with(
        "two.toml",
        r##"version = 1
        [lights.day]
        spectrum = "D65"
        [lights.lamp]
        spectrum = "FL11"
        [materials.one]
        [cells.one]
        day = "#c04040"
        lamp = "#40c040""##,
    );
    let design = |more: &[&str]| folder.done(&[&["design", "two.toml", "--json"], more].concat()).json();
    let compared = design(&["--compare-smoothness"])["smoother"].clone();
    let bending = |json: &serde_json::Value| -> f64 {
        let samples = json["materials"][0]["samples"].as_array().unwrap();
        let samples: Vec<f64> = samples.iter().map(|sample| sample.as_f64().unwrap()).collect();
        samples.windows(3).map(|three| (three[0] - 2.0 * three[1] + three[2]).powi(2)).sum()
    };
    let stated = design(&[]);
    let (least, mut bent) = (stated["worst"].as_f64().unwrap(), bending(&stated));
    for (index, name) in ["smooth", "smoother", "smoothest"].into_iter().enumerate() {
        let json = design(&["--smoothness", name]);
        let worst = json["worst"].as_f64().unwrap();
        assert_eq!(compared[index]["worst"].as_f64(), Some(worst), "{name}");
        assert!(bending(&json) < bent, "{name}: {} after {bent}", bending(&json));
        assert!(name != "smoothest" || worst > least, "{name}: ΔE00 {worst}, {least} as stated");
        bent = bending(&json);
    }
    let refused = folder.run(&["design", "two.toml", "--smoothness", "silky"]);
    assert_eq!(refused.code, Some(2), "{}", refused.err);
    assert!(refused.err.contains("smooth, smoother, smoothest, or a number"), "{}", refused.err);
}

#[test]
fn the_program_starts_from_a_solved_palette_too() {
    let smoke = |peak: f64| {
        format!(
            "version = 1\n[lights.day]\nspectrum = \"D65\"\n[lights.lamp]\nbounds = [0, {peak}]\n[materials.smoke]\n\
             [cells.smoke]\nday = \"black\"\nlamp = \"#e0e0e0\"\n"
        )
    };
    let folder = Folder::new().with("a.toml", smoke(4.0)).with("b.toml", smoke(5.0)).with("small.toml", SMALL);
    let folder = folder.with("a.nrrd", "NRRD0001\ntype: uint8\ndimension: 3\nsizes: 1 1 1\nencoding: raw\n\n7");
    let worst = |command: &[&str]| folder.done(command).json()["worst"].as_f64().unwrap();
    let narrow = worst(&["design", "a.toml", "-o", "solved.toml", "--json"]);
    let wide = worst(&["design", "b.toml", "--start", "solved.toml", "--json"]);
    assert!(wide <= narrow, "{wide} after {narrow}");
    for unsolved in ["small.toml", "a.toml"] {
        let why = format!("{unsolved} has no spectrum for smoke, lamp; --start takes a palette file with spectra");
        folder.refused(2, &["design", "b.toml", "--start", unsolved], &[&why]);
    }
    folder.refused(2, &["design", "b.toml", "--start", "a.nrrd"], &["a.nrrd is a volume; --start takes a palette"]);
    let solved = std::fs::read_to_string(folder.path("solved.toml")).unwrap();
    std::fs::write(folder.path("part.toml"), solved.replace("lamp", "bulb")).unwrap();
    let warned = folder.done(&["design", "b.toml", "--start", "part.toml"]).err;
    assert!(warned.contains("--start part.toml has no spectrum for lamp"), "{warned}");
    // Rough spectra are nearer to the targets than smooth ones may be.
    let smooth = worst(&["design", "b.toml", "--smoothness", "smoothest", "--start", "solved.toml", "--json"]);
    assert!(smooth > 1.05 * narrow, "{smooth} smoothly, {narrow} roughly");
    folder.refused(1, &["design", "b.toml", "--start", "c.toml"], &["cannot read the palette c.toml"]);
    folder.refused(
        2,
        &["design", "b.toml", "--start", "solved.toml", "-o", "solved.toml"],
        &["solved.toml is an input"],
    );
}

#[test]
fn the_palettes_in_data_reach_their_targets() {
    let rows = instrument::palette_rows(1, &Quiet).unwrap();
    let (hard, others): (Vec<_>, Vec<_>) = rows.iter().partition(|row| row.best_known.is_some());
    assert_eq!(hard.len(), hard_palettes().len());
    for row in hard {
        assert!(row.residual <= 1.2 * row.best_known.unwrap(), "{row:?}");
    }
    for row in others {
        assert!(row.worst <= 0.7, "{row:?}");
        assert!(row.solve.cpu_ms.unwrap().median > 0.0, "{row:?}");
        // docs/theory/palettes.md: a floor that open lights change little.
        if let (Some(least), Some(reached)) = (row.least, row.reached) {
            assert!(reached <= 1.2 * least, "{row:?}");
        }
    }
    let figure_7 = rows.iter().find(|row| row.palette == "figure 7").unwrap();
    assert!(figure_7.worst <= 0.1, "{figure_7:?}");
}

#[test]
fn the_program_refuses_what_it_should() {
    let folder = Folder::new().with("small.toml", SMALL);
    folder.refused(2, &["design", "small.toml", "-o", "small.toml"], &["small.toml is an input"]);
    folder.refused(2, &["design", "small.toml", "-o", "a.svg", "--report", "a.svg"], &["a.svg is named twice"]);
    folder.refused(2, &["design", "small.toml", "--report", "r.pdf"], &["end its name in .html, .svg or .png"]);
    folder.refused(1, &["design", "none.toml"], &["cannot read the palette none.toml"]);
    folder.refused(1, &["design", "scene.toml"], &["scene.toml:", "no [palette]"]);
    folder.refused(1, &["design", "small.toml", "-o", "no/where.toml"], &["there is no folder no"]);
}

// ---- colour vision deficiencies ----

/// Rows of the published matrices sum to 1; colours that differ only for a missing cone become one.
#[test]
fn dichromats_see_greys_as_they_are_and_confuse_what_they_should() {
    let shown = |rgb: [f64; 3]| LinearSrgb(rgb);
    for deficiency in Deficiency::ALL {
        for grey in [0.0, 0.2, 1.0] {
            let seen = deficiency.seen(shown([grey; 3])).0;
            assert!(seen.iter().all(|part| (part - grey).abs() <= 2e-6), "{deficiency}: {seen:?}");
        }
    }
    let lab_of =
        |LinearSrgb(rgb)| lab_from_xyz(relume::spectrum::colour::xyz_from_linear_srgb(LinearSrgb(rgb)), d65_white());
    let gap = |deficiency: Option<Deficiency>, [one, two]: [[f64; 3]; 2]| {
        let [one, two] =
            [one, two].map(|rgb| lab_of(deficiency.map_or(shown(rgb), |deficiency| deficiency.seen(shown(rgb)))));
        ciede2000(one, two)
    };
    let red_and_green = [[0.4, 0.1, 0.05], [0.1, 0.2, 0.05]];
    assert!(gap(Some(Deficiency::Deutan), red_and_green) < 0.4 * gap(None, red_and_green));
    assert!(gap(Some(Deficiency::Tritan), red_and_green) > 0.7 * gap(None, red_and_green));
    let solution = example("metamers.toml");
    let contrast = solution.contrasts()[1];
    assert!(contrast.normal > 10.0 && contrast.deficient[1] < 0.5 * contrast.normal);
}

/// Values of the paper's table, and the inverse of Lab.
#[test]
fn colours_come_back_from_lab() {
    for rgb in [[0.0, 0.0, 0.0], [0.001, 0.002, 0.0], [0.2, 0.5, 0.9], [1.0, 1.0, 1.0]] {
        let there = relume::spectrum::colour::xyz_from_linear_srgb(LinearSrgb(rgb));
        let back = linear_srgb_from_xyz(xyz_from_lab(lab_from_xyz(there, d65_white()), d65_white()));
        assert!((0..3).all(|axis| (back.0[axis] - rgb[axis]).abs() <= 1e-12));
    }
    let unit = Light::new(Spectrum::constant(1.0)).unwrap();
    assert!((xyz_of(unit.spectrum()).0[1] - 1.0).abs() <= 1e-12);
}
