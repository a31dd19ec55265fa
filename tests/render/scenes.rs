//! Bundled scene files: each loads and shows all its materials.

use crate::support;

use std::path::{Path, PathBuf};

use glam::DVec3;
use relume::document;
use relume::document::{Definition, SceneOptions};
use relume::plan::{Accumulate, Shares, Transmittance, plan};
use relume::progress::Quiet;
use relume::render::Job;
use relume::scene::{AccumulateAs, Material, Scene, SceneLight, Term, positions};
use relume::spectrum::colour::{Lab, Xyz, ciede2000, d65_white, lab_from_xyz, xyz, xyz_of};
use relume::spectrum::{Spectrum, standard};
use relume::tables::TransferTable;
use relume::volume::phantom::Phantom;

use support::rungs::{Rungs, with_renderer};
use support::tolerance::WEIGHTS_DEVICE;

/// Folder of its own for a test.
fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("relume-scenes-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// `MetaImage` of zeros in `folder`.
fn zeros(folder: &Path, name: &str, dims: [usize; 3]) -> PathBuf {
    let [x, y, z] = dims;
    let header = format!("NDims = 3\nDimSize = {x} {y} {z}\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n");
    let mut bytes = header.into_bytes();
    bytes.resize(bytes.len() + x * y * z, 0);
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

/// A phantom at a quarter of its resolution, with the same total opacity of its parts.
fn quartered(dims: [usize; 3]) -> SceneOptions {
    let dims = format!("volume.dims={:?}", dims.map(|voxels| voxels.div_ceil(4)));
    let definitions =
        [&dims, "volume.spacing=[4,4,4]", "transfer.opacity_length=1", "accuracy.step=1"].map(Definition::new).to_vec();
    SceneOptions { definitions, ..SceneOptions::default() }
}

fn load(name: &str, options: &SceneOptions) -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/scenes").join(name);
    document::load(&path, options, &Quiet).unwrap().scene
}

/// Asserts two distinguishable lights and no invisible material.
fn check(scene: &Scene) {
    assert_eq!(positions(scene).len(), 2, "{}", scene.name);
    let used = plan(scene, &Quiet).unwrap().materials;
    let unused: Vec<_> = (0..scene.materials.len())
        .filter(|material| !used.contains(material))
        .map(|material| &scene.materials[material].name)
        .collect();
    assert_eq!(unused, [""; 0], "{}", scene.name);
}

#[test]
fn a_scene_in_code_has_the_defaults_of_a_scene_file() {
    let text = r#"
        version = 1
        [volume]
        phantom = "slab"
        dims = [3, 4, 5]
        spacing = [2, 3, 4]
        [materials.shell]
        reflectance = "orange"
        [transfer]
        intervals = [{ material = "shell", range = [90, 110], ramp = 10, opacity = 0.6 }]
        [lights.day]
        spectrum = "D65"
    "#;
    let filed = support::scenes::parsed(text);
    let mut scene = Scene::new(&filed.name, filed.volume().clone());
    scene.materials.push(Material::new("shell", standard::reflectance("orange").unwrap()));
    scene.transfer.terms.push(Term::interval(0, [90.0, 110.0], 10.0, 0.6, 0.0));
    scene.lights.push(SceneLight::new("day", standard::light("D65").unwrap()));
    assert_eq!(format!("{scene:?}"), format!("{filed:?}"));
}

#[test]
fn the_default_scene_shows_all_its_materials() {
    check(&document::load_embedded(&quartered(Phantom::Frog.dims()), &Quiet).unwrap().scene);
}

#[test]
fn the_made_engine_shows_all_its_materials() {
    check(&load("engine.toml", &quartered(Phantom::Engine.dims())));
}

#[test]
fn the_frog_shows_all_its_materials_with_labels_and_a_few_without() {
    let folder = folder("frog");
    let volume = Some(zeros(&folder, "frog.mha", [5, 4, 3]));
    let labels = Some(zeros(&folder, "labels.mha", [5, 4, 3]));
    let labelled = load("frog.toml", &SceneOptions { volume: volume.clone(), labels, ..SceneOptions::default() });
    check(&labelled);
    assert_eq!(labelled.labels.unwrap().declared.len(), 15);
    let plain = load("frog.toml", &SceneOptions { volume, ..SceneOptions::default() });
    assert_eq!(plan(&plain, &Quiet).unwrap().materials.len(), 4);
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn the_scanned_engine_shows_all_its_materials() {
    let folder = folder("engine");
    let volume = Some(zeros(&folder, "engine.mha", [256, 256, 128]));
    check(&load("engine_ct.toml", &SceneOptions { volume, ..SceneOptions::default() }));
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn the_chest_has_one_colour_in_daylight_and_shows_only_its_skeleton_under_the_last_light() {
    let folder = folder("chest");
    let volume = Some(zeros(&folder, "chest.mha", [256, 256, 133]));
    let scene = load("chest.toml", &SceneOptions { volume, ..SceneOptions::default() });
    assert_eq!(plan(&scene, &Quiet).unwrap().materials.len(), 4, "all materials are shown");
    let lab = |material: &str, light: &str| {
        let material = scene.materials.iter().find(|it| it.name == material).unwrap();
        let light = scene.lights.iter().find(|it| it.name == light).unwrap();
        lab_from_xyz(xyz(&light.spectrum, &material.reflectance), d65_white())
    };
    let black = lab_from_xyz(Xyz([0.0; 3]), d65_white());
    for tissue in ["body", "organs", "blood"] {
        // The tutorial promises differences that nobody sees: a tenth of a just visible one.
        assert!(ciede2000(lab(tissue, "day"), lab("bone", "day")) <= 0.1, "{tissue} in daylight");
        assert!(ciede2000(lab(tissue, "for_bone"), black) <= 0.1, "{tissue} under the light for bone");
        assert!(ciede2000(lab(tissue, "for_organs"), lab("bone", "for_organs")) >= 20.0, "{tissue} stands out");
    }
    assert!(ciede2000(lab("bone", "for_bone"), black) >= 50.0, "bone under its light");
    std::fs::remove_dir_all(folder).unwrap();
}

/// Accumulators, transmittance and light positions in the plan of a scene.
fn planned(rungs: &Rungs) -> (Accumulate, Transmittance, usize) {
    let plan = &rungs.planned.plan;
    (plan.accumulate, plan.transmittance, plan.light.accumulators())
}

/// Asserts that the device's picture matches all 81 bands in every pixel: within the scene's tolerance, or up to
/// rounding.
fn shows_its_colours(rungs: &Rungs) {
    let truth = rungs.stored_truth();
    assert!(truth.iter().any(|colour| colour.y > 0.1), "{} is dark", rungs.scene.name);
    with_renderer(|renderer| {
        let shown = rungs.gpu(renderer).relight(&rungs.xyz_matrices());
        let worst = shown.iter().zip(&truth).map(|(one, other)| difference(*one, *other)).fold(0.0, f64::max);
        let limit = if rungs.planned.model.is_some() { rungs.scene.accuracy.tolerance } else { WEIGHTS_DEVICE };
        assert!(worst <= limit, "{}: ΔE00 {worst}", rungs.scene.name);
    });
}

fn difference(one: DVec3, other: DVec3) -> f64 {
    let lab = |colour: DVec3| lab_from_xyz(Xyz(colour.to_array()), d65_white());
    ciede2000(lab(one), lab(other))
}

fn dimension(rungs: &Rungs) -> usize {
    rungs.planned.model.as_ref().map_or(0, |model| model.dimension())
}

#[test]
fn the_wedge_is_beer_and_lamberts_law() {
    let rungs = Rungs::new(load("wedge.toml", &SceneOptions::default()), [40, 40]);
    let expected = Accumulate::Spectral { dimension: dimension(&rungs), shares: Shares::Equal, exponents: 0 };
    assert_eq!(planned(&rungs), (expected, Transmittance::Coloured, 1));
    let light = rungs.mix.0[0].spectrum.spectrum();
    let truth = rungs.truth();
    let mut hues = Vec::new();
    // The middle of each strip: its material, and its peak's optical depth at the right edge.
    for (name, row, peak) in
        [("tea", 6, 20.0), ("pumpkin_oil", 14, 18.0), ("chlorophyll", 23, 20.0), ("methylene_blue", 32, 20.0)]
    {
        let material = rungs.scene.materials.iter().find(|material| material.name == name).unwrap();
        let shape = material.absorption.as_ref().unwrap().spectrum();
        for x in 0..40 {
            // Path length through the box.
            let way = 256.0 * (f64::from(x) + 0.5) / 40.0;
            let transmitted = |band: usize| light.samples()[band] * (-peak * way / 256.0 * shape.samples()[band]).exp();
            let expected = DVec3::from(xyz_of(&Spectrum::from_samples(std::array::from_fn(transmitted))).0);
            let found = truth[usize::try_from(x).unwrap() + 40 * row];
            assert!((found - expected).length() <= 1e-3, "{name}, {x}: {found} for {expected}");
            if [2, 39].contains(&x) {
                let Lab([_, a, b]) = lab_from_xyz(Xyz(found.to_array()), d65_white());
                hues.push(b.atan2(a).to_degrees());
            }
        }
    }
    // Each changes its hue; the oil changes from green to red.
    assert!(hues.chunks(2).all(|pair| (pair[0] - pair[1]).abs() > 10.0), "{hues:?}");
    assert!(hues[2] > 100.0 && hues[3] < 60.0, "{hues:?}");
    shows_its_colours(&rungs);
}

#[test]
fn glass_shells_shine_and_colour_what_is_behind() {
    let rungs = Rungs::new(load("glass_shells.toml", &quartered([128; 3])), [36, 32]);
    let expected = Accumulate::Spectral { dimension: dimension(&rungs), shares: Shares::Own, exponents: 1 };
    assert_eq!(planned(&rungs), (expected, Transmittance::Coloured, 2));
    assert!(rungs.planned.plan.background && rungs.planned.plan.specular().is_some());
    check(&rungs.scene);
    shows_its_colours(&rungs);
}

#[test]
fn the_stained_frog_is_planned_in_k_numbers_with_labels_and_without() {
    let folder = folder("stained");
    let rungs = Rungs::new(load("stained_frog.toml", &quartered(Phantom::Frog.dims())), [36, 32]);
    let expected = Accumulate::Spectral { dimension: dimension(&rungs), shares: Shares::Equal, exponents: 0 };
    assert_eq!(planned(&rungs), (expected, Transmittance::Coloured, 2));
    check(&rungs.scene);
    shows_its_colours(&rungs);
    let volume = Some(zeros(&folder, "frog.mha", [5, 4, 3]));
    let labels = Some(zeros(&folder, "labels.mha", [5, 4, 3]));
    let labelled = load("stained_frog.toml", &SceneOptions { volume, labels, ..SceneOptions::default() });
    check(&labelled);
    assert_eq!(labelled.labels.unwrap().declared.len(), 15);
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn the_inked_frog_is_the_same_by_weights_and_by_k_numbers() {
    let by = |accumulate: AccumulateAs| {
        let mut scene = load("inked_frog.toml", &quartered(Phantom::Frog.dims()));
        scene.accuracy.accumulate = accumulate;
        Rungs::new(scene, [36, 32])
    };
    let (weights, spectral) = (by(AccumulateAs::Weights), by(AccumulateAs::Spectral));
    assert_eq!(planned(&weights), (Accumulate::Weights { materials: 6 }, Transmittance::Grey, 2));
    let expected = Accumulate::Spectral { dimension: dimension(&spectral), shares: Shares::Equal, exponents: 0 };
    assert_eq!(planned(&spectral), (expected, Transmittance::Grey, 2));
    check(&weights.scene);
    shows_its_colours(&weights);
    shows_its_colours(&spectral);
}

/// Builds a table with `entries` (default: automatic) for an interval one value wide, from 31000.
fn table(entries: &str) -> Option<TransferTable> {
    let text = format!(
        "version = 1\n[volume]\nphantom = \"slab\"\n[materials.m]\nreflectance = 0.5\n[transfer]\n{entries}\n\
         [[transfer.intervals]]\nmaterial = \"m\"\nrange = [31000, 31001]\nopacity = 0.5\n"
    );
    let scene = document::parse("test", &text, Path::new(""), &SceneOptions::default(), &Quiet);
    scene.ok().and_then(|file| {
        let scene = file.scene;
        plan(&scene, &Quiet).ok().map(|planned| TransferTable::new(&scene, &planned, &[[0.0, 65535.0]]))
    })
}

/// Opacity of [`table`] at the voxel value `value`.
fn opacity_at(value: f64, entries: &str) -> f64 {
    table(entries).map_or(f64::NAN, |table| {
        // One entry for each of the 65,536 values, or fewer.
        let last = u32::try_from(table.entries() - 1).unwrap();
        let place = value / 65535.0 * f64::from(last);
        let before = (0..last).rev().find(|&entry| f64::from(entry) <= place).unwrap_or(0);
        let at = |entry: u32| f64::from(table.opacity[entry as usize]);
        (at(before + 1) - at(before)).mul_add(place - f64::from(before), at(before))
    })
}

#[test]
fn active_are_the_places_that_an_active_entry_counts_at() {
    assert_eq!(table("").map(|table| (table.entries(), table.active())), Some((65536, [30999.0, 31002.0])));
}

#[test]
fn an_interval_one_value_wide_survives_in_16_bit_data() {
    for value in [31000.0, 31001.0] {
        assert!((opacity_at(value, "") - 0.5).abs() <= 1e-6, "opacity at {value}: {}", opacity_at(value, ""));
    }
    for value in [30999.0, 31002.0] {
        assert!(opacity_at(value, "").abs() <= 1e-6, "opacity at {value}: {}", opacity_at(value, ""));
    }
    // Fewer entries lose the interval: the narrowest feature determines their number.
    for entries in ["entries = 1024", "entries = 4096"] {
        assert!(opacity_at(31000.0, entries) < 0.25, "{entries}: {}", opacity_at(31000.0, entries));
    }
}

/// Marches on all cores leave out empty macrocells, in steps and in segments.
#[test]
fn a_march_without_a_device_has_the_numbers_of_all_samples() {
    const SIZE: [usize; 2] = [10, 8];
    let mut compared = 0;
    let mut kept = None;
    for (name, row) in support::scenes::all() {
        let scene = support::scenes::named(name);
        let statistics = scene.volume().statistics().unwrap();
        let Ok(job) = Job::new(scene, statistics).planned(&Quiet) else { continue };
        let found = job.on_cpu(&mut kept).unwrap().film(&job.cameras[0], SIZE, &Quiet).unwrap();
        let rungs = Rungs::planned(job.scene.clone(), job.planned.clone(), SIZE);
        assert_eq!(found, rungs.march::<f32>(&rungs.stored::<f32>()), "{name}: {}", row.plan);
        compared += 1;
    }
    assert!(compared > 150, "{compared} scenes");
}
