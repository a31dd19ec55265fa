//! Several fields on one grid: closed forms, order, shares, lights as filters, and what is refused.

use std::path::Path;
use std::sync::Arc;

use glam::{DMat3, DVec3};
use relume::document::{self, Definition, Document, Edit, InMemory, SceneOptions};
use relume::film::{Film, RelightMatrices};
use relume::number::Real;
use relume::plan::{Planned, Stale, plan};
use relume::progress::Quiet;
use relume::scene::{ClipPlane, Field, Integration, Keep, Mix, MixLight, Overlap, Scene};
use relume::spectrum::colour::{Xyz, ciede2000, d65_white, lab_from_xyz};
use relume::volume::{Geometry, Volume, Voxels};

use crate::support::rungs::Rungs;
use crate::support::rungs::with_renderer;
use crate::support::scenes::float;

/// A grid of one value, 24 units thick.
fn slab(value: u8) -> Volume {
    let dims = [9, 9, 25];
    let geometry = Geometry::new("slab", dims, DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
    Volume::new("slab", Voxels::U8(vec![value; 9 * 9 * 25]), geometry).unwrap()
}

/// The scene `text` around a slab, with further fields of these values, seen along z.
fn scene(text: &str, value: u8, further: &[(&str, u8)]) -> Scene {
    let view = "version = 1\nshading = \"none\"\n[camera]\nprojection = \"orthographic\"\nheight = 4\nposition = [4, 4, -10]\n\
                target = [4, 4, 0]\n[accuracy]\nstep = 0.7\ntermination = 0\n[lights.day]\nspectrum = \"D65\"\nkind = \"ambient\"\n\
                [materials.one]\nreflectance = \"orange\"\n[materials.two]\nreflectance = \"blue\"\n";
    let text = format!("{view}{text}");
    let volumes = InMemory { volume: Arc::new(slab(value)), labels: None, further: Vec::new() };
    let file = document::parse_on(volumes, "fields", &text, Path::new(""), &SceneOptions::default(), &Quiet).unwrap();
    let mut scene = file.scene;
    let fields = scene.fields.further().iter().map(|field| {
        let value = further.iter().find(|(name, _)| *name == field.name).map_or(0, |found| found.1);
        Field::new(field.name.clone(), Arc::new(slab(value)), field.terms.clone())
    });
    let fields = fields.collect();
    scene.fields = scene.fields.with(fields);
    scene
}

/// A field of an opacity at the values from 90 to 110.
fn field(name: &str, material: &str, opacity: f64) -> String {
    format!(
        "[volumes.{name}]\nphantom = \"slab\"\ntransfer = {{ intervals = [{{ material = \"{material}\", range = [90, 110], \
         opacity = {opacity} }}] }}\n"
    )
}

fn first(opacity: f64) -> String {
    format!(
        "[transfer]\nopacity_length = 1\nintervals = [{{ material = \"one\", range = [90, 110], opacity = {opacity} }}]\n"
    )
}

/// Optical depth of the slab at an opacity.
fn depth(opacity: f64) -> f64 {
    -(-opacity).ln_1p() * 24.0
}

pub(super) fn check<R: Real>(what: &str, film: &Film<R>, expected: [f64; 3], limit: f64) {
    let pixels = film.size[0] * film.size[1];
    let found = film.accumulators.iter().chain(&film.transmittance).map(|number| number.to_f64());
    for (i, found) in found.enumerate() {
        let expected = expected[i / pixels];
        assert!((found - expected).abs() <= limit, "{what}: {found} for {expected}");
    }
}

#[test]
fn overlapping_slabs_are_their_closed_form_on_every_rung() {
    for (one, two) in [(0.02, 0.05), (0.3, 0.001), (1e-6, 1e-6)] {
        let text = [first(one), field("other", "two", two)].concat();
        let rungs = Rungs::new(scene(&text, 100, &[("other", 100)]), [4, 4]);
        let (a, b) = (depth(one), depth(two));
        let left = (-(a + b)).exp();
        let gained = (1.0 - left) / (a + b);
        let expected = [a * gained, b * gained, left];
        check("f64", &rungs.march::<f64>(&rungs.exact()), expected, 1e-12);
        check("tables", &rungs.march::<f64>(&rungs.stored::<f64>()), expected, 1e-6);
        check("f32", &rungs.march::<f32>(&rungs.stored::<f32>()), expected, 4e-6);
        with_renderer(|renderer| check("device", &rungs.gpu(renderer), expected, 6e-6));
    }
}

/// Depths of each slab, the light of both, and what is left, marched on every rung.
fn check_slabs(what: &str, scene: Scene, expected: [f64; 3]) {
    let rungs = Rungs::new(scene, [4, 4]);
    check(&format!("{what}: f64"), &rungs.march::<f64>(&rungs.exact()), expected, 1e-12);
    check(&format!("{what}: tables"), &rungs.march::<f64>(&rungs.stored::<f64>()), expected, 1e-6);
    check(&format!("{what}: f32"), &rungs.march::<f32>(&rungs.stored::<f32>()), expected, 4e-6);
    with_renderer(|renderer| check(&format!("{what}: device"), &rungs.gpu(renderer), expected, 6e-6));
}

/// From a sum, where neither hides, to dyes that hide each other.
#[test]
fn the_part_that_occludes_leads_from_a_sum_to_dyes_that_hide() {
    let [one, two] = [0.03, 0.05];
    for parts in [[0.25, 1.0], [0.5, 0.0], [0.001, 0.6]] {
        let mut scene = scene(&[first(one), field("other", "two", two)].concat(), 100, &[("other", 100)]);
        for (material, part) in scene.materials.iter_mut().zip(parts) {
            material.occludes = part;
        }
        let (a, b) = (depth(one), depth(two));
        let extinction = parts[0] * a + parts[1] * b;
        let left = (-extinction).exp();
        let gained = (1.0 - left) / extinction;
        check_slabs(&format!("{parts:?}"), scene, [a * gained, b * gained, left]);
    }
}

#[test]
fn hidden_fields_are_as_if_they_were_not_there() {
    let [one, two] = [0.03, 0.05];
    let alone = |depth: f64| 1.0 - (-depth).exp();
    let (a, b) = (depth(one), depth(two));
    for (hidden, expected) in [
        ([true, false], vec![alone(b), (-b).exp()]),
        ([false, true], vec![alone(a), (-a).exp()]),
        ([true, true], vec![1.0]),
    ] {
        let mut scene = scene(&[first(one), field("other", "two", two)].concat(), 100, &[("other", 100)]);
        scene.hidden[..2].copy_from_slice(&hidden);
        let rungs = Rungs::new(scene, [4, 4]);
        let numbers = |film: Film<f64>| [film.accumulators, film.transmittance].concat();
        let found = numbers(rungs.march::<f64>(&rungs.exact()));
        for (i, number) in found.iter().enumerate() {
            let expected = expected[i * expected.len() / found.len()];
            assert!((number - expected).abs() <= 1e-12, "{hidden:?}: {number} for {expected}");
        }
        with_renderer(|renderer| {
            let film = rungs.gpu(renderer);
            let on_device: Vec<f32> = [film.accumulators, film.transmittance].concat();
            assert_eq!(on_device.len(), found.len(), "{hidden:?}");
            for (here, there) in found.iter().zip(on_device) {
                assert!((here - f64::from(there)).abs() <= 6e-6, "{hidden:?}: {there} for {here}");
            }
        });
    }
}

#[test]
fn rules_for_several_without_several_are_told_of() {
    let mut scene = scene(&first(0.1), 100, &[]);
    scene.overlap = Overlap::First;
    scene.clip.keep = Keep::Any;
    scene.clip.planes = vec![ClipPlane::new(DVec3::ZERO, DVec3::Z).unwrap()];
    let warnings: Vec<String> = plan(&scene, &Quiet).unwrap().warnings.iter().map(ToString::to_string).collect();
    assert!(
        matches!(&warnings[..], [overlap, keep] if overlap.contains("one field") && keep.contains("one clip plane")),
        "{warnings:?}"
    );
    scene.clip.planes.push(ClipPlane::new(DVec3::ONE, DVec3::X).unwrap());
    assert_eq!(plan(&scene, &Quiet).unwrap().warnings.len(), 1);
}

/// Values of a hidden field still scale others.
#[test]
fn a_hidden_field_keeps_its_factors() {
    let text = first(0.04).replace(" }]", ", by = { other = [[50, 0], [150, 1]] } }]");
    let text = [text, field("other", "two", 0.05)].concat();
    let mut scene = scene(&text, 100, &[("other", 100)]);
    scene.hidden[1] = true;
    let rungs = Rungs::new(scene, [4, 4]);
    let left = (-0.5 * depth(0.04)).exp();
    let film = rungs.march::<f64>(&rungs.exact());
    assert!(
        film.transmittance.iter().all(|found| (found - left).abs() <= 1e-12),
        "{:?} for {left}",
        film.transmittance
    );
}

/// Each field is scaled by half through the value of the other one, which is 100 everywhere.
#[test]
fn factors_by_each_other_are_their_closed_form_on_every_rung() {
    let [one, two] = [0.04, 0.07];
    let scaled = |text: String, by: &str| text.replace(" }]", &format!(", by = {{ {by} }} }}]"));
    let text = [
        scaled(first(one), "other = [[50, 0], [150, 1]]"),
        scaled(field("other", "two", two), "volume = [[0, 0.9], [80, 0.25], [120, 0.75], [200, 0]]"),
    ];
    let rungs = Rungs::new(scene(&text.concat(), 100, &[("other", 100)]), [4, 4]);
    assert_eq!(rungs.planned.plan.groups.by_fields, [1, 4]);
    let (a, b) = (0.5 * depth(one), 0.5 * depth(two));
    let left = (-(a + b)).exp();
    let gained = (1.0 - left) / (a + b);
    let expected = [a * gained, b * gained, left];
    check("f64", &rungs.march::<f64>(&rungs.exact()), expected, 1e-12);
    check("tables", &rungs.march::<f64>(&rungs.stored::<f64>()), expected, 1e-6);
    check("f32", &rungs.march::<f32>(&rungs.stored::<f32>()), expected, 4e-6);
    with_renderer(|renderer| check("device", &rungs.gpu(renderer), expected, 6e-6));
}

/// Both values are 100: a ratio of 1, and a point of a polygon.
#[test]
fn shapes_over_two_fields_are_their_closed_form_on_every_rung() {
    let [one, two] = [0.04, 0.07];
    let scaled = |text: String, shape: &str| text.replace(" }]", &format!(", shape = {{ {shape} }} }}]"));
    let text = [
        scaled(first(one), "by = \"other\", ratio = [[0.5, 0], [1.5, 1]]"),
        // 20 of 200 behind an edge of the polygon's box.
        scaled(
            field("other", "two", two),
            "by = \"volume\", polygon = [[0, 80], [200, 80], [200, 280], [0, 280]], soft = 0.4",
        ),
    ];
    let rungs = Rungs::new(scene(&text.concat(), 100, &[("other", 100)]), [4, 4]);
    assert_eq!(rungs.planned.plan.groups.shapes, [2, 0]);
    let (a, b) = (0.5 * depth(one), 0.25 * depth(two));
    let left = (-(a + b)).exp();
    let gained = (1.0 - left) / (a + b);
    let expected = [a * gained, b * gained, left];
    check("f64", &rungs.march::<f64>(&rungs.exact()), expected, 1e-12);
    // Rows and columns of the tables lie beside the values.
    check("tables", &rungs.march::<f64>(&rungs.stored::<f64>()), expected, 1e-3);
    check("f32", &rungs.march::<f32>(&rungs.stored::<f32>()), expected, 1e-3);
    with_renderer(|renderer| check("device", &rungs.gpu(renderer), expected, 1e-3));
}

#[test]
fn the_tables_of_shapes_move_colours_by_little() {
    for name in ["shape_unshaded", "shape_triangle", "shape_coloured", "shape_ratio", "shape_placed"] {
        let rungs = Rungs::new(crate::support::scenes::named(name), [48, 40]);
        let lab = |colour: DVec3| lab_from_xyz(Xyz(colour.to_array()), d65_white());
        let [exact, tables] = [rungs.lit(&rungs.exact()), rungs.lit(&rungs.stored::<f64>())];
        let pairs = exact.into_iter().zip(tables);
        let mut errors: Vec<f64> = pairs.map(|((a, _), (b, _))| ciede2000(lab(a), lab(b))).collect();
        errors.sort_by(f64::total_cmp);
        let (p95, most) = (errors[errors.len() * 95 / 100], errors[errors.len() - 1]);
        assert!(p95 <= 0.1 && most < 2.0, "{name}: {p95}, {most}");
    }
}

/// A plane takes the far part of one of two slabs, at the end of a step and within one.
#[test]
fn a_plane_of_one_field_leaves_the_other_whole() {
    let [one, two] = [0.04, 0.07];
    let of_length = |opacity: f64, length: f64| -(-opacity).ln_1p() * length;
    for at in [9.8, 10.3] {
        let clip = format!("[clip]\nplanes = [{{ plane = \"z:{at}\", volumes = [\"other\"] }}]\n");
        let text = [first(one), field("other", "two", two), clip].concat();
        let rungs = Rungs::new(scene(&text, 100, &[("other", 100)]), [4, 4]);
        let (a, b) = (of_length(one, at), of_length(two, at));
        let (front, behind) = ((-(a + b)).exp(), (-of_length(one, 24.0 - at)).exp());
        let gained = (1.0 - front) / (a + b);
        let expected = [a * gained + front * (1.0 - behind), b * gained, front * behind];
        // Media within a step are mixed.
        let limit = if at < 10.0 { 1e-9 } else { 1e-3 };
        let film = rungs.march::<f64>(&rungs.exact());
        check("f64", &film, expected, limit);
        check("f64", &film, [film.accumulators[0], film.accumulators[16], expected[2]], 1e-9);
        check("tables", &rungs.march::<f64>(&rungs.stored::<f64>()), expected, limit.max(1e-6));
        check("f32", &rungs.march::<f32>(&rungs.stored::<f32>()), expected, limit.max(4e-6));
        with_renderer(|renderer| check("device", &rungs.gpu(renderer), expected, limit.max(6e-6)));
    }
}

#[test]
fn the_order_of_fields_does_not_matter_and_half_a_field_twice_is_one() {
    let film = |fields: &[(&str, &str, f64)], value: u8| {
        let text: String = std::iter::once(first(0.05))
            .chain(fields.iter().map(|&(name, material, o)| field(name, material, o)))
            .collect();
        let values: Vec<(&str, u8)> = fields.iter().map(|field| (field.0, value)).collect();
        Rungs::new(scene(&text, 100, &values), [4, 4])
    };
    let largest = |a: &Film<f32>, b: &Film<f32>| {
        let pairs = a.accumulators.iter().zip(&b.accumulators).chain(a.transmittance.iter().zip(&b.transmittance));
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    // Fields are in the order of their names.
    let one = film(&[("a", "one", 0.04), ("b", "two", 0.07)], 100);
    let other = film(&[("b", "one", 0.04), ("a", "two", 0.07)], 100);
    let half = 1.0 - (1.0_f64 - 0.09).sqrt();
    let whole = film(&[("a", "two", 0.09)], 100);
    let halves = film(&[("a", "two", half), ("b", "two", half)], 100);
    let single = |rungs: &Rungs| rungs.march::<f32>(&rungs.stored::<f32>());
    assert!(largest(&single(&one), &single(&other)) <= 1e-6);
    assert!(largest(&single(&whole), &single(&halves)) <= 1e-6);
    with_renderer(|renderer| {
        assert!(largest(&one.gpu(renderer), &other.gpu(renderer)) <= 1e-6, "order");
        assert!(largest(&whole.gpu(renderer), &halves.gpu(renderer)) <= 1e-6, "halves");
    });
    // A field whose values show nothing changes nothing.
    let nothing = film(&[("a", "two", 0.09)], 7);
    let alone = Rungs::new(scene(&first(0.05), 100, &[]), [4, 4]);
    let [nothing, alone] = [nothing, alone].map(|rungs| rungs.march::<f64>(&rungs.exact()));
    assert!((nothing.transmittance[5] - alone.transmittance[5]).abs() < 1e-12);
}

/// The matrices under a light of the scene alone.
fn matrices(scene: &Scene, planned: &Planned, index: usize) -> RelightMatrices {
    let light = &scene.lights[index];
    let position = planned.positions.iter().position(|position| position.lights.contains(&index)).unwrap();
    let spectrum = light.spectrum.clone();
    let mix = Mix(vec![MixLight { name: light.name.clone(), spectrum, weight: light.intensity, position }]);
    RelightMatrices::of_scene(scene, planned, &mix)
}

#[test]
fn the_light_of_a_channel_leaves_the_others_black_to_the_bit() {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/tiff/channels.ome.tif");
    let (file, _) = document::Source::of(Path::new(file)).read(&Quiet).unwrap();
    let scene = &file.scene;
    assert_eq!(scene.fields.further().len(), 1);
    assert_eq!(scene.materials.iter().map(|it| it.name.as_str()).collect::<Vec<_>>(), ["DAPI", "GFP"]);
    // It opens in the lights of the channels, each with a switch.
    let mix = file.opening_mix();
    let on: Vec<&str> = mix.0.iter().filter(|it| it.weight > 0.0).map(|it| it.name.as_str()).collect();
    assert_eq!(on, ["DAPI", "GFP"]);
    let planned = plan(scene, &Quiet).unwrap();
    for (index, light) in scene.lights.iter().enumerate() {
        let shown = planned.materials.iter().position(|&material| scene.materials[material].name == light.name);
        let matrices = matrices(scene, &planned, index);
        for (weight, colour) in matrices.colours.iter().enumerate() {
            let is_shown = shown.is_none_or(|shown| shown == weight);
            assert_eq!(
                *colour != DVec3::ZERO,
                is_shown,
                "{} under {}: {colour}",
                planned.materials[weight],
                light.name
            );
        }
    }
    // All channels under the light of all are as bright as each under its own.
    let colours = |name: &str| {
        let index = scene.lights.iter().position(|light| light.name == name).unwrap();
        matrices(scene, &planned, index).colours
    };
    let sum = |name: &str| colours(name).iter().fold(DVec3::ZERO, |sum, colour| sum + *colour);
    assert!((sum("all") - sum("DAPI") - sum("GFP")).abs().max_element() < 1e-9 * float(scene.lights.len()));
    // Another colour is a relight, and leaves the others black, too.
    for light in ["DAPI", "GFP"] {
        let light = &scene.lights.iter().find(|it| it.name == light).unwrap().spectrum;
        let surfaces = scene.materials.iter().map(|material| material.reflectance.spectrum());
        assert!(document::in_colour(light, surfaces, [1.0, 0.0, 0.0]).is_some(), "any colour");
    }
    let index = scene.lights.iter().position(|light| light.name == "GFP").unwrap();
    let mut document = Document::new(file.clone());
    document.edit(&Edit::LightColour(index, [255, 0, 255]));
    let recoloured = &document.state().scene;
    assert_eq!(Stale::between(scene, &planned, recoloured), Stale::Picture);
    let colours = matrices(recoloured, &planned, index).colours;
    let of =
        |name: &str| planned.materials.iter().position(|&material| scene.materials[material].name == name).unwrap();
    assert_eq!(colours[of("DAPI")], DVec3::ZERO);
    let [red, green, blue] = colours[of("GFP")].to_array();
    assert!(green < 0.05 * red && (red - blue).abs() < 0.1 * red, "magenta: {red} {green} {blue}");
}

#[test]
fn a_scene_of_channels_is_defined_anew_on_the_same_voxels() {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/tiff/channels.ome.tif");
    let (file, _) = document::Source::of(Path::new(file)).read(&Quiet).unwrap();
    let define = |text: &str| document::redefined(&file, (None, &[Definition::new(text)]), &Quiet);
    let finer = define("accuracy.step=0.25").unwrap();
    assert!(finer.scene.fields.are(&file.scene.fields), "nothing is read or copied");
    let other = define("volumes.GFP.transfer.opacity=[[0, 0], [9, 0.5]]").unwrap();
    assert!(other.scene.fields.are(&file.scene.fields) && other.scene.terms_of(1) != file.scene.terms_of(1));
    let voxels = define("volumes.GFP.component=0").unwrap_err().to_string();
    assert!(voxels.contains("chooses voxels"), "{voxels}");
    assert_eq!(Stale::between(&file.scene, &plan(&file.scene, &Quiet).unwrap(), &other.scene), Stale::Tables);
}

#[test]
fn what_several_fields_cannot_have_is_refused_with_the_way_out() {
    let text = [first(0.05), field("other", "two", 0.05)].concat();
    let refused = |change: &dyn Fn(&mut Scene), words: &[&str]| {
        let mut scene = scene(&text, 100, &[("other", 100)]);
        change(&mut scene);
        let error = plan(&scene, &Quiet).unwrap_err().to_string();
        assert!(words.iter().all(|word| error.contains(word)), "{words:?} in {error}");
    };
    refused(&|scene| scene.accuracy.voxel_pixels = 2.0, &["several fields", "accuracy.voxel_pixels"]);
    refused(&|scene| scene.accuracy.integration = Integration::Segments, &["segments", "several fields"]);
}
