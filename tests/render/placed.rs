//! Fields on grids of their own: closed forms, turned grids, boxes, transforms and what is refused.

use std::path::Path;
use std::sync::Arc;

use glam::{DMat3, DVec3};
use relume::document::{self, InMemory, SceneOptions};
use relume::progress::Quiet;
use relume::scene::{Aim, Field, FieldFactor, Overlap, Scene};
use relume::volume::{Geometry, Volume, Voxels};

use crate::fields::check;
use crate::support::rungs::{Rungs, with_renderer};
use crate::support::scenes::float;

fn uniform(dims: [usize; 3], spacing: DVec3, origin: DVec3, direction: DMat3) -> Volume {
    let geometry = Geometry::new("uniform", dims, spacing, origin, direction).unwrap();
    Volume::new("uniform", Voxels::U8(vec![100; dims.iter().product()]), geometry).unwrap()
}

/// A scene around `first` with the further field `other`, seen along z.
fn scene(first: Volume, other: Volume, opacities: [f64; 2]) -> Scene {
    let [one, two] = opacities;
    let text = format!(
        "version = 1\nshading = \"none\"\n[camera]\nprojection = \"orthographic\"\nheight = 4\nposition = [10, 10, -10]\ntarget = [10, 10, \
         0]\n[accuracy]\nstep = 0.5\ntermination = 0\n[lights.day]\nspectrum = \"D65\"\nkind = \"ambient\"\n[materials.one]\nreflectance = \
         \"orange\"\n[materials.two]\nreflectance = \"blue\"\n[transfer]\nopacity_length = 1\nintervals = [{{ material = \"one\", range = \
         [90, 110], ramp = 5, opacity = {one} }}]\n[volumes.other]\nphantom = \"slab\"\ntransfer = {{ intervals = [{{ material = \"two\", range = [90, \
         110], ramp = 5, opacity = {two} }}] }}\n"
    );
    let volumes = InMemory { volume: Arc::new(first), labels: None, further: Vec::new() };
    let options = SceneOptions::default();
    let mut scene = document::parse_on(volumes, "placed", &text, Path::new(""), &options, &Quiet).unwrap().scene;
    let terms = scene.fields.further()[0].terms.clone();
    scene.fields = scene.fields.with(vec![Field::new("other".to_owned(), Arc::new(other), terms)]);
    scene
}

#[test]
fn two_boxes_that_overlap_in_part_are_their_closed_form_on_every_rung() {
    let first = || uniform([21, 21, 25], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY);
    // A turned box with other voxels, from z = 5 to 17: whole steps.
    let turned = DMat3::from_rotation_z(0.5);
    let other = uniform([31, 29, 16], DVec3::new(0.9, 0.8, 0.8), DVec3::new(4.0, -3.0, 5.0), turned);
    for opacities in [[0.02, 0.05], [0.3, 0.001]] {
        let scene = scene(first(), other.clone(), opacities);
        assert_eq!((scene.fields.sharing().len(), scene.fields.beside().len()), (0, 1));
        let rungs = Rungs::new(scene, [4, 4]);
        let [a, b] = opacities.map(|opacity| -(-opacity).ln_1p());
        // In front, together, behind.
        let part = |a: f64, b: f64, length: f64| {
            let left = (-(a + b) * length).exp();
            let gained = (1.0 - left) / (a + b);
            ([a * gained, b * gained], left)
        };
        let (mut gained, mut left) = ([0.0; 2], 1.0);
        for (parts, after) in [part(a, 0.0, 5.0), part(a, b, 12.0), part(a, 0.0, 7.0)] {
            gained = [gained[0] + left * parts[0], gained[1] + left * parts[1]];
            left *= after;
        }
        let expected = [gained[0], gained[1], left];
        check("f64", &rungs.march::<f64>(&rungs.exact()), expected, 1e-9);
        check("tables", &rungs.march::<f64>(&rungs.stored::<f64>()), expected, 1e-6);
        check("f32", &rungs.march::<f32>(&rungs.stored::<f32>()), expected, 6e-6);
        with_renderer(|renderer| check("device", &rungs.gpu(renderer), expected, 8e-6));
    }
}

/// Of two boxes, the first or the last alone is seen in their common part.
#[test]
fn boxes_that_hide_one_another_are_their_closed_form_on_every_rung() {
    let turned = DMat3::from_rotation_z(0.5);
    let other = uniform([31, 29, 16], DVec3::new(0.9, 0.8, 0.8), DVec3::new(4.0, -3.0, 5.0), turned);
    let opacities = [0.02, 0.05];
    let [a, b] = opacities.map(|opacity: f64| 1.0 - opacity);
    for overlap in [Overlap::First, Overlap::Last] {
        let first = uniform([21, 21, 25], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY);
        let mut scene = scene(first, other.clone(), opacities);
        scene.overlap = overlap;
        let rungs = Rungs::new(scene, [4, 4]);
        let expected = if overlap == Overlap::First {
            let left = a.powi(24);
            [1.0 - left, 0.0, left]
        } else {
            let (front, middle, behind) = (a.powi(5), b.powi(12), a.powi(7));
            let gained = [1.0 - front + front * middle * (1.0 - behind), front * (1.0 - middle)];
            [gained[0], gained[1], front * middle * behind]
        };
        check("f64", &rungs.march::<f64>(&rungs.exact()), expected, 1e-9);
        check("tables", &rungs.march::<f64>(&rungs.stored::<f64>()), expected, 1e-6);
        check("f32", &rungs.march::<f32>(&rungs.stored::<f32>()), expected, 6e-6);
        with_renderer(|renderer| check("device", &rungs.gpu(renderer), expected, 8e-6));
    }
}

/// A volume is seen where another one is, or where it is not, whose box it overlaps in part.
#[test]
fn a_mask_shows_what_is_inside_its_box_or_outside_on_every_rung() {
    let turned = DMat3::from_rotation_z(0.5);
    let mask = uniform([31, 29, 16], DVec3::new(0.9, 0.8, 0.8), DVec3::new(4.0, -3.0, 5.0), turned);
    // Outside the box a factor is that of its first point.
    for (points, parts) in
        [([(50.0, 0.0), (90.0, 1.0)], [0.0, 12.0, 0.0]), ([(50.0, 1.0), (90.0, 0.25)], [5.0, 3.0, 7.0])]
    {
        let first = uniform([21, 21, 25], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY);
        let mut scene = scene(first, mask.clone(), [0.05, 0.0]);
        scene.transfer.terms[0].by = vec![FieldFactor { field: "other".to_owned(), points: points.to_vec() }];
        scene.fields.show(0, Vec::new());
        let rungs = Rungs::new(scene, [4, 4]);
        let left = 0.95_f64.powf(parts.iter().sum());
        let expected = [1.0 - left, left, f64::NAN];
        check("f64", &rungs.march::<f64>(&rungs.exact()), expected, 1e-9);
        check("tables", &rungs.march::<f64>(&rungs.stored::<f64>()), expected, 1e-6);
        check("f32", &rungs.march::<f32>(&rungs.stored::<f32>()), expected, 6e-6);
        with_renderer(|renderer| check("device", &rungs.gpu(renderer), expected, 8e-6));
    }
}

#[test]
fn a_field_with_its_axes_the_other_way_round_is_the_same_field() {
    let dims = [21, 21, 25];
    let value = |x: usize, y: usize, z: usize| u8::try_from((x * 7 + y * 3 + z * 5) % 120 + 40).unwrap();
    let voxels = |turned: bool| -> Vec<u8> {
        let mut voxels = Vec::new();
        for z in 0..dims[2] {
            for y in 0..dims[1] {
                voxels.extend((0..dims[0]).map(|x| if turned { value(20 - x, y, 24 - z) } else { value(x, y, z) }));
            }
        }
        voxels
    };
    let first = || uniform(dims, DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY);
    let other = |turned: bool| {
        let (origin, direction) = if turned {
            (DVec3::new(20.0, 0.0, 24.0), DMat3::from_diagonal(DVec3::new(-1.0, 1.0, -1.0)))
        } else {
            (DVec3::ZERO, DMat3::IDENTITY)
        };
        let geometry = Geometry::new("other", dims, DVec3::ONE, origin, direction).unwrap();
        Volume::new("other", Voxels::U8(voxels(turned)), geometry).unwrap()
    };
    let [shared, placed] = [false, true].map(|turned| Rungs::new(scene(first(), other(turned), [0.01, 0.3]), [16, 16]));
    assert_eq!([&shared, &placed].map(|rungs| rungs.planned.plan.groups.sharing), [1, 0]);
    let largest = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let [one, two] = [&shared, &placed].map(|rungs| rungs.march::<f64>(&rungs.exact()).accumulators);
    assert!(largest(&one, &two) < 1e-12, "f64: {}", largest(&one, &two));
    with_renderer(|renderer| {
        let [one, two] = [&shared, &placed].map(|rungs| rungs.gpu(renderer).map(f64::from).accumulators);
        assert!(largest(&one, &two) < 2e-5, "device: {}", largest(&one, &two));
    });
}

#[test]
fn a_field_finer_than_a_frame_of_one_voxel_is_marched_on_both_sides_of_it() {
    // A slab of one voxel, 33 units thick; below and above its middle lies half of the other field.
    let first = || uniform([33, 33, 1], DVec3::new(1.0, 1.0, 33.0), DVec3::ZERO, DMat3::IDENTITY);
    for origin in [-16.0, 8.0] {
        let other = uniform([33, 33, 9], DVec3::ONE, DVec3::new(0.0, 0.0, origin), DMat3::IDENTITY);
        let mut scene = scene(first(), other, [0.0, 0.2]);
        scene.camera.aim = Aim::LookAt { position: DVec3::new(10.0, 10.0, -40.0), target: DVec3::new(10.0, 10.0, 0.0) };
        let rungs = Rungs::new(scene, [4, 4]);
        let left = 0.8_f64.powi(8);
        with_renderer(|renderer| check("device", &rungs.gpu(renderer), [1.0 - left, left, f64::NAN], 1e-5));
    }
}

/// A volume given twice, each time with the square root of its transmittance, is the volume once: on one grid, and with its axes the other
/// way round, so that shading, highlights and cut faces are those of the same surfaces.
#[test]
fn a_shaded_volume_given_twice_at_half_its_density_is_itself() {
    let dims = [21, 19, 17];
    let ball = |[x, y, z]: [usize; 3]| {
        let [x, y, z] = [x, y, z].map(float);
        let far = ((x - 9.0).powi(2) + (y - 8.0).powi(2) + 1.5 * (z - 8.0).powi(2)).sqrt();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to 250")]
        let value = (250.0 - 22.0 * far).max(0.0) as u8;
        value
    };
    let grid = |turned: bool| {
        let (origin, direction) = if turned {
            (DVec3::new(20.0, 0.0, 16.0), DMat3::from_diagonal(DVec3::new(-1.0, 1.0, -1.0)))
        } else {
            (DVec3::ZERO, DMat3::IDENTITY)
        };
        let at = |i: usize| {
            let [x, y, z] = [i % dims[0], i / dims[0] % dims[1], i / (dims[0] * dims[1])];
            if turned { [dims[0] - 1 - x, y, dims[2] - 1 - z] } else { [x, y, z] }
        };
        let voxels = (0..dims.iter().product()).map(|i| ball(at(i))).collect();
        let geometry = Geometry::new("ball", dims, DVec3::ONE, origin, direction).unwrap();
        Arc::new(Volume::new("ball", Voxels::U8(voxels), geometry).unwrap())
    };
    let text = |opacity: f64, further: &str| {
        format!(
            "version = 1\nlighting = \"one_sided\"\n[camera]\nazimuth = 30\nelevation = 25\n[accuracy]\nstep = 0.5\ntermination = 0\n\
             gradients = \"central\"\n[clip]\nplanes = [\"x:50%\"]\n[lights.key]\nspectrum = \"D65\"\nkind = \"directional\"\n\
             direction = [-0.4, -0.7, -0.6]\n[lights.eye]\nspectrum = \"A\"\nkind = \"headlight\"\n[materials.one]\nreflectance = \"orange\"\nspecular = 0.3\n\
             [transfer]\nopacity_length = 1\nintervals = [{{ material = \"one\", range = [90, 1000], opacity = {opacity} }}]\n{further}"
        )
    };
    let half = 1.0 - 0.5_f64.sqrt();
    let further = format!(
        "[volumes.other]\nphantom = \"slab\"\ntransfer = {{ intervals = [{{ material = \"one\", range = [90, 1000], opacity = {half} }}] }}\n"
    );
    let scene_of = |text: &str, other: Option<Arc<Volume>>| {
        let volumes = InMemory { volume: grid(false), labels: None, further: Vec::new() };
        let options = SceneOptions::default();
        let mut scene = document::parse_on(volumes, "ball", text, Path::new(""), &options, &Quiet).unwrap().scene;
        if let Some(other) = other {
            let terms = scene.fields.further()[0].terms.clone();
            scene.fields = scene.fields.with(vec![Field::new("other".to_owned(), other, terms)]);
        }
        Rungs::new(scene, [32, 32])
    };
    let once = scene_of(&text(0.5, ""), None);
    let shared = scene_of(&text(half, &further), Some(grid(false)));
    let placed = scene_of(&text(half, &further), Some(grid(true)));
    assert_eq!([&shared, &placed].map(|it| it.planned.plan.groups.beside()), [0, 1]);
    assert!([&shared, &placed].iter().all(|it| it.planned.plan.groups.lit_fields().eq([1])));
    let largest = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let exact = |rungs: &Rungs| rungs.march::<f64>(&rungs.exact()).accumulators;
    assert!(exact(&once).iter().any(|&number| number > 0.1), "it is lit");
    for twice in [&shared, &placed] {
        let found = largest(&exact(&once), &exact(twice));
        assert!(found < 1e-12, "f64: {found}");
    }
    // The table of one field has steps, in which a jump of the opacity lies elsewhere than in densities.
    let [one, two] = [&shared, &placed].map(|rungs| rungs.march::<f64>(&rungs.stored::<f64>()).accumulators);
    assert!(largest(&one, &two) < 1e-9, "tables: {}", largest(&one, &two));
    with_renderer(|renderer| {
        let found = [&shared, &placed].map(|rungs| rungs.gpu(renderer).map(f64::from).accumulators);
        for found in found {
            assert!(largest(&one, &found) < 3e-5, "device: {}", largest(&one, &found));
        }
    });
}
