//! Palettes: what is reachable is reached, what is not is told with a proof, and what is saved comes back.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use relume::palette::{Cell, LAMP, Member, NATURAL, Palette, SMOOTHNESS, Solution, Target, solve};
use relume::progress::Quiet;
use relume::spectrum::colour::{Lab, Xyz};
use relume::spectrum::standard;

fn member(name: &str, bounds: [f64; 2]) -> Member {
    Member { name: name.to_owned(), spectrum: None, bounds, smoothness: SMOOTHNESS }
}

fn given(name: &str) -> Member {
    Member { spectrum: Some(standard::light(name).unwrap().spectrum().clone()), ..member(name, LAMP) }
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

fn solved(palette: &Palette) -> Solution {
    let begun = std::time::Instant::now();
    let solution = solve(palette, &Quiet).unwrap();
    println!("{:.2} s, worst {:.4}", begun.elapsed().as_secs_f64(), solution.worst());
    for cells in solution.cells.chunks(palette.lights.len()) {
        let row: Vec<String> =
            cells.iter().map(|cell| cell.difference.map_or("free".to_owned(), |d| format!("{d:.4}"))).collect();
        println!("  {}", row.join(" "));
    }
    for conflict in &solution.conflicts {
        println!(
            "  least {:.3}, reached {:.3}: {}; {:?}",
            conflict.least, conflict.reached, conflict.reason, conflict.ways_out
        );
    }
    for facts in solution.material_facts.iter().chain(&solution.light_facts) {
        println!("  {facts:?}");
    }
    solution
}

/// One light per material: the figure 7 of the paper.
fn diagonal(size: usize, bounds: [f64; 2]) -> Palette {
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
    let cells: Vec<_> = (0..size)
        .flat_map(|row| {
            (0..size).map(move |column| {
                (row, column, if row == column { Target::Srgb(colours[row]) } else { Target::Black })
            })
        })
        .collect();
    palette(
        (0..size).map(|row| member(&format!("m{row}"), bounds)).collect(),
        (0..size).map(|column| member(&format!("l{column}"), LAMP)).collect(),
        &cells,
    )
}

#[test]
fn one_light_per_material_is_reached() {
    let solution = solved(&diagonal(4, NATURAL));
    assert!(solution.worst() <= 0.1);
    assert!(solution.conflicts.is_empty());
}

#[test]
fn eight() {
    solved(&diagonal(8, NATURAL));
}

/// Daylight and tungsten are given: one grey under the first, apart under the second, around the colour that a neutral
/// grey has there; two more lights show one material each.
fn figure5(bounds: [f64; 2], apart: f64) -> Palette {
    let grey = |light: &str| {
        let neutral = relume::spectrum::Reflectance::new(relume::spectrum::Spectrum::constant(0.28)).unwrap();
        let xyz = relume::spectrum::colour::xyz(&standard::light(light).unwrap(), &neutral);
        relume::spectrum::colour::lab_from_xyz(xyz, relume::spectrum::colour::d65_white()).0
    };
    let ([l0, a0, b0], [l1, a1, b1]) = (grey("D65"), grey("A"));
    let mut cells = Vec::new();
    for (row, [a, b]) in [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]].into_iter().enumerate() {
        cells.push((row, 0, lab(l0, a0, b0)));
        cells.push((row, 1, lab(l1, a1 + apart * a, b1 + apart * b)));
        cells.push((row, 2, if row == 3 { lab(60.0, 20.0, 30.0) } else { Target::Black }));
        cells.push((row, 3, if row == 2 { lab(60.0, -20.0, 30.0) } else { Target::Black }));
    }
    let materials = (0..4).map(|row| member(&format!("m{row}"), bounds)).collect();
    palette(materials, vec![given("D65"), given("A"), member("l3", LAMP), member("l4", LAMP)], &cells)
}

#[test]
fn fig5() {
    solved(&figure5(NATURAL, 8.0));
    solved(&figure5([-1.0, 1.0], 8.0));
    solved(&figure5(NATURAL, 16.0));
}

#[test]
fn black() {
    let smoke = |low| vec![member("smoke", [low, 1.0]), member("one", NATURAL), member("two", NATURAL)];
    let cells = |white: f64| {
        vec![
            (0, 0, Target::Black),
            (0, 1, Target::Xyz(Xyz([0.95 * white, white, 1.09 * white]))),
            (1, 0, lab(60.0, 30.0, 20.0)),
            (1, 1, Target::Like { material: 1, light: 0 }),
            (2, 0, lab(50.0, -30.0, 20.0)),
            (2, 1, Target::Like { material: 2, light: 0 }),
        ]
    };
    println!("open");
    solved(&palette(smoke(0.0), vec![member("a", LAMP), member("b", LAMP)], &cells(0.5)));
    println!("D65 signed");
    solved(&palette(smoke(-1.0), vec![given("D65"), member("b", LAMP)], &cells(0.5)));
    println!("D65 natural");
    solved(&palette(smoke(0.0), vec![given("D65"), member("b", LAMP)], &cells(0.5)));
    println!("D65 A natural");
    solved(&palette(smoke(0.0), vec![given("D65"), given("A")], &cells(0.5)));
}

#[test]
fn constancy() {
    for (name, feasible) in [("A", false), ("FL2", true)] {
        println!("{name}");
        let cells = [(0, 0, Target::Xyz(Xyz([0.19, 0.2, 0.218]))), (0, 1, Target::Like { material: 0, light: 0 })];
        let solution = solved(&palette(vec![member("grey", NATURAL)], vec![given("D65"), given(name)], &cells));
        assert_eq!(solution.conflicts.is_empty(), feasible);
    }
    println!("open");
    let cells = [
        (0, 0, lab(60.0, 20.0, 20.0)),
        (0, 1, Target::Like { material: 0, light: 0 }),
        (1, 0, lab(50.0, 50.0, 30.0)),
        (1, 1, lab(50.0, 0.0, -45.0)),
        (2, 0, lab(50.0, -30.0, 30.0)),
        (2, 1, Target::Black),
    ];
    solved(&palette(
        vec![member("a", NATURAL), member("b", NATURAL), member("c", NATURAL)],
        vec![given("D65"), member("l", LAMP)],
        &cells,
    ));
}
