//! The paper's figures, each made from one march, and their intended effects.
#![expect(clippy::print_stdout, reason = "a test shows what it measured")]

use crate::support;

use std::path::Path;

use glam::dvec2;
use relume::document;
use relume::document::SceneOptions;
use relume::progress::Quiet;
use relume::scene::{Mix, Scene};
use relume::spectrum::colour::{Lab, ciede2000, d65_white, lab_from_xyz, xyz_of};
use support::program::Folder;

/// The phantoms at a quarter of their resolution, with the same total opacity of their parts.
const QUARTERED: [&str; 8] = [
    "-D",
    "volume.dims=[62,58,34]",
    "-D",
    "volume.spacing=[4,4,4]",
    "-D",
    "transfer.opacity_length=1",
    "-D",
    "accuracy.step=1",
];

/// Linear sRGB of a picture.
struct Picture(Vec<[f64; 3]>);

impl Picture {
    fn read(path: &Path) -> Self {
        let mut reader =
            png::Decoder::new(std::io::BufReader::new(std::fs::File::open(path).unwrap())).read_info().unwrap();
        let mut codes = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut codes).unwrap();
        let linear = |code: u8| {
            let code = f64::from(code) / 255.0;
            if code <= 0.04045 { code / 12.92 } else { ((code + 0.055) / 1.055).powf(2.4) }
        };
        Self(codes.chunks_exact(3).map(|pixel| [pixel[0], pixel[1], pixel[2]].map(linear)).collect())
    }

    /// Chromaticities (red, green) of the pixels bright enough for their 8-bit codes.
    fn chromaticities(&self) -> Vec<[f64; 2]> {
        let sum = |pixel: &&[f64; 3]| pixel.iter().sum::<f64>();
        let bright = self.0.iter().filter(|pixel| sum(pixel) > 0.15);
        bright.map(|pixel| [pixel[0] / sum(&pixel), pixel[1] / sum(&pixel)]).collect()
    }

    /// Largest distance between two chromaticities.
    fn spread(&self) -> f64 {
        let all = self.chromaticities();
        assert!(all.len() > 100, "only {} pixels are bright", all.len());
        let range = |part: usize| {
            let (low, high) =
                all.iter().fold((1.0_f64, 0.0_f64), |(low, high), c| (low.min(c[part]), high.max(c[part])));
            high - low
        };
        range(0).max(range(1))
    }

    /// Share of pixels that satisfy `is`.
    fn share(&self, is: impl Fn([f64; 3]) -> bool) -> f64 {
        let count = self.0.iter().filter(|pixel| is(**pixel)).count();
        f64::from(u32::try_from(count).unwrap()) / f64::from(u32::try_from(self.0.len()).unwrap())
    }
}

/// 95th percentile of the sRGB codes of smoke alone, which glows in one picture and is black in the other; the least
/// channel
/// of each pixel.
fn smoke(dark: &Picture, glowing: &Picture) -> u8 {
    let code = |pixel: [f64; 3]| relume::spectrum::colour::encode_srgb(pixel.into_iter().fold(1.0, f64::min)) * 255.0;
    let alone = dark.0.iter().zip(&glowing.0).filter(|(dark, glowing)| !is_lit(**dark) && is_lit(**glowing));
    let mut codes: Vec<f64> = alone.map(|(_, glowing)| code(*glowing)).collect();
    assert!(codes.len() > 100, "only {} pixels are of smoke alone", codes.len());
    codes.sort_by(f64::total_cmp);
    let rounded = codes[codes.len() * 95 / 100].round();
    (0..=255).rev().find(|&code| f64::from(code) <= rounded).unwrap()
}

fn is_lit(pixel: [f64; 3]) -> bool {
    pixel.iter().any(|&part| part > 0.01)
}

fn is_orange([red, green, blue]: [f64; 3]) -> bool {
    red > 1.5 * green && red > 3.0 * blue && red > 0.05
}

#[test]
fn the_figures_show_what_the_paper_says() {
    let folder = Folder::new();
    let figures = [&["figures", "-o", "all", "--size", "128x128", "--json"], &QUARTERED[..]].concat();
    let json = folder.done(&figures).json();
    for figure in json["figures"].as_array().unwrap() {
        assert_eq!(figure["marches"], 1);
    }
    let picture = |name: &str| Picture::read(&folder.path(&format!("all/{name}.png")));
    // One colour within the precision of 8 bits, then different colours.
    for name in ["1a", "5a", "6a"] {
        assert!(picture(name).spread() < 0.04, "{name}: {}", picture(name).spread());
    }
    for name in ["1b", "1c", "1d", "5b", "6b", "7c"] {
        assert!(picture(name).spread() > 0.06, "{name}: {}", picture(name).spread());
    }
    let orange = |name: &str| picture(name).share(is_orange);
    assert!(orange("1a") == 0.0 && orange("1c") > 0.01, "the stomach stands out: {} {}", orange("1a"), orange("1c"));
    assert!(orange("7b") == 0.0 && orange("7c") > 0.005, "pistons, off and on: {} {}", orange("7b"), orange("7c"));
    let lit = |name: &str| picture(name).share(is_lit);
    assert!(lit("1c") < 0.8 * lit("1a"), "the flesh goes dark: {} {}", lit("1a"), lit("1c"));
    assert!((0.001..0.02).contains(&lit("5d")), "eyes alone: {}", lit("5d"));
    let smoke = smoke(&picture("6a"), &picture("6c"));
    println!("smoke of figure 6c: p95 {smoke}");
    assert!(smoke > 128, "smoke glows: {smoke}");
    let sheet = std::fs::read_to_string(folder.path("all/figures.html")).unwrap();
    assert_eq!(sheet.matches("<figure>").count(), json["pictures"].as_array().unwrap().len());
}

/// Colour of a material under a mix.
fn colour(scene: &Scene, material: &str, mix: &Mix) -> Lab {
    let reflectance = &scene.materials.iter().find(|each| each.name == material).unwrap().reflectance;
    let (_, light) = mix.light_at(0);
    lab_from_xyz(xyz_of(&(&light * reflectance.spectrum())), d65_white())
}

#[test]
fn the_block_of_figure_6_keeps_its_colour_under_every_mix() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/figures/fig6.toml");
    let definitions = vec![document::Definition::new("volume.dims=[8,8,8]")];
    let file = document::load(&path, &SceneOptions { definitions, ..SceneOptions::default() }, &Quiet).unwrap();
    let (scene, dial) = (file.scene, file.dial);
    let stated = Mix::of_scene(&scene);
    let of = |hand| colour(&scene, "block", &dial.mix(hand, &stated));
    let first = of(dial.nodes[0].place);
    let mut worst = 0.0_f64;
    for step in 0..400_u32 {
        let (x, y) = (f64::from(step % 20) / 8.0 - 1.2, f64::from(step / 20) / 8.0 - 1.2);
        worst = worst.max(ciede2000(first, of(dvec2(x, y))));
    }
    for node in &dial.nodes {
        worst = worst.max(ciede2000(first, of(node.place)));
    }
    println!("block of figure 6 under 400 mixes: at most ΔE00 {worst:.3}");
    assert!(worst <= 1.0, "{worst}");
}

#[test]
fn figure_5_can_be_had() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/figures/fig5.toml");
    let solution = relume::palette::solve(&relume::palette::load(&path).unwrap(), &Quiet).unwrap();
    assert_eq!(solution.conflicts, []);
    assert!(solution.worst() <= 0.1, "{}", solution.worst());
}

#[test]
fn a_volume_that_is_missing_is_told_before_any_picture() {
    let folder = Folder::new();
    let arguments = ["figures", "-o", "all", "--volume-engine", "missing.vti"];
    folder.refused(1, &[&arguments[..], &QUARTERED[..]].concat(), &["missing.vti"]);
    assert_eq!(folder.names(), ["scene.toml"]);
}
