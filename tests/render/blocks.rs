//! Blocks of a volume: the composite of their films is the film of one march.

use glam::DVec3;
use relume::film::Film;
use relume::number::Real;
use relume::progress::Quiet;
use relume::render::{Renderer, SceneRenderer};
use relume::scene::{Aim, Block, Blocks, Camera, Interpolation, Node, Placement, Projection, Scene, low_leaves};
use relume::spectrum::{Layers, ThinFilm, ThinFilmAngle};

use crate::matrix::differences;
use crate::support::rungs::{Rungs, with_renderer};
use crate::support::scenes::{self, SIZE};

/// Composites `films` of the leaves of a tree in the order of its cuts.
fn composited<R: Real>(films: &[Film<R>], low_first: &[bool]) -> Film<R> {
    if let [film] = films {
        return film.clone();
    }
    let (low, high) = films.split_at(low_leaves(films.len()));
    let (is_low_first, cuts) = low_first.split_first().unwrap();
    let (of_low, of_high) = cuts.split_at(low.len() - 1);
    let (low, high) = (composited(low, of_low), composited(high, of_high));
    if *is_low_first { low.over(&high) } else { high.over(&low) }.unwrap()
}

/// Largest difference of a number of two films.
fn difference<R: Real>(one: &Film<R>, other: &Film<R>) -> f64 {
    let numbers = |film: &Film<R>| -> Vec<f64> {
        film.accumulators.iter().chain(&film.transmittance).map(|number| number.to_f64()).collect()
    };
    let (one, other) = (numbers(one), numbers(other));
    assert_eq!(one.len(), other.len(), "numbers of both films");
    assert!(other.iter().any(|number| number.abs() > 0.01 && (number - 1.0).abs() > 0.01), "nothing shows");
    one.iter().zip(&other).map(|(one, other)| (one - other).abs()).fold(0.0, f64::max)
}

/// Blocks of `scene` as scenes, and the order of the cuts.
fn parts(scene: &Scene, size: [usize; 2], leaves: usize) -> (Vec<Scene>, Vec<bool>) {
    let geometry = &scene.frame.geometry;
    let aspect = f64::from(u32::try_from(size[0]).unwrap()) / f64::from(u32::try_from(size[1]).unwrap());
    let view = scene.camera.view(geometry, aspect).unwrap();
    let low_first = Blocks::new(geometry, leaves).unwrap().low_first(geometry, &view);
    let block = |index| Scene { block: Some(Block { index, count: leaves }), ..scene.clone() };
    ((0..leaves).map(block).collect(), low_first)
}

/// A camera at `eye`, relative to the centre in halves of the volume, that looks along `forward`.
fn looking(scene: &Scene, eye: DVec3, forward: DVec3, parallel: bool) -> Camera {
    let geometry = &scene.frame.geometry;
    let half = (DVec3::from_array(geometry.dims.map(|n| f64::from(u32::try_from(n).unwrap()))) - 1.0) / 2.0;
    let world = |place: DVec3| geometry.origin + geometry.direction * (geometry.spacing * half * (place + 1.0));
    let (eye, target) = (world(eye), world(eye + forward));
    let projection = if parallel {
        Projection::Orthographic { height: Some(half.y * geometry.spacing.y * 2.0) }
    } else {
        Projection::Perspective { fov_degrees: 50.0 }
    };
    Camera { projection, aim: Aim::LookAt { position: eye, target }, up: DVec3::new(0.1, -1.0, 0.2) }
}

fn cases() -> Vec<(&'static str, Scene, [usize; 2])> {
    let usual = |name: &str| scenes::named(name);
    let seen = |scene: Scene, eye: [f64; 3], forward: [f64; 3], parallel| {
        let camera = looking(&scene, eye.into(), forward.into(), parallel);
        Scene { camera, ..scene }
    };
    let straight = |scene: Scene, parallel| {
        let mut scene = seen(scene, [0.0, 0.0, if parallel { -3.0 } else { -0.5 }], [0.0, 0.0, 1.0], parallel);
        scene.camera.up = DVec3::NEG_Y;
        scene
    };
    let cropped = |mut scene: Scene| {
        let last = DVec3::from_array(scene.frame.geometry.dims.map(|n| f64::from(u32::try_from(n - 1).unwrap())));
        scene.crop = Some([last * DVec3::new(0.13, 0.3, 0.0), last * DVec3::new(0.9, 1.0, 0.6)]);
        scene
    };
    let shadowed = |mut scene: Scene| {
        for light in scene.lights.iter_mut().filter(|light| matches!(light.placement, Placement::Directional(_))) {
            light.shadows = true;
        }
        scene
    };
    let filmed = |mut scene: Scene| {
        let soap = Layers { index: 1.33, thickness_nm: 400.0, above: 1.0, below: 1.0 };
        scene.materials[0].film = Some(ThinFilm::new(soap, ThinFilmAngle::Facing).unwrap());
        scene
    };
    let odd = [SIZE[0] + 1, SIZE[1] + 1];
    vec![
        ("film", filmed(usual("diffuse_three")), SIZE),
        ("samples", usual("diffuse_three"), SIZE),
        ("specular", usual("specular_three"), SIZE),
        ("coloured", usual("coloured_three"), SIZE),
        ("x-ray", usual("xray"), SIZE),
        ("labels", usual("coloured_labels"), SIZE),
        ("segments", scenes::in_segments(usual("diffuse_three")), SIZE),
        ("coloured segments", scenes::in_segments(usual("coloured_labels")), SIZE),
        ("shadows", shadowed(usual("diffuse_three")), SIZE),
        ("cropped", cropped(usual("diffuse_three")), SIZE),
        ("cropped segments", cropped(scenes::in_segments(usual("diffuse_three"))), SIZE),
        ("parallel", seen(usual("diffuse_three"), [2.0, -2.0, 2.5], [-2.0, 2.0, -2.5], true), SIZE),
        ("inside", seen(usual("coloured_three"), [0.1, 0.2, -0.3], [0.5, -0.3, 1.0], false), SIZE),
        ("parallel in a face", straight(usual("diffuse_three"), true), odd),
        ("inside in a face", straight(usual("diffuse_three"), false), odd),
    ]
}

/// Asserts that films of this many blocks composite to the film of one march.
pub(super) fn composite_is_whole(name: &str, whole: &Rungs, renderer: Option<&Renderer>, counts: &[usize]) {
    let exact = whole.march::<f64>(&whole.exact());
    let on_device = renderer.map(|renderer| whole.gpu(renderer));
    for &leaves in counts {
        let (scenes, low_first) = parts(&whole.scene, whole.size, leaves);
        let block = |scene| Rungs::planned(scene, whole.planned.clone(), whole.size);
        let rungs: Vec<Rungs> = scenes.into_iter().map(block).collect();
        let films: Vec<Film<f64>> = rungs.iter().map(|rungs| rungs.march(&rungs.exact())).collect();
        let worst = difference(&composited(&films, &low_first), &exact);
        assert!(worst <= 1e-12, "{name} in {leaves} blocks: {worst}");
        if let (Some(renderer), Some(expected)) = (renderer, &on_device) {
            let films: Vec<Film<f32>> = rungs.iter().map(|rungs| rungs.gpu(renderer)).collect();
            let film = composited(&films, &low_first);
            let worst = difference(&film, expected);
            let matrices = whole.xyz_matrices();
            let colour = differences(&film.relight(&matrices), &expected.relight(&matrices)).pop().unwrap();
            assert!(worst <= 1e-6, "{name} in {leaves} blocks on the device: {worst}");
            assert!(colour <= 0.01, "{name} in {leaves} blocks on the device: ΔE00 {colour}");
        }
    }
}

#[test]
fn the_composite_of_blocks_is_one_march() {
    for (name, mut scene, size) in cases() {
        scene.accuracy.termination = 0.0;
        let whole = Rungs::new(scene, size);
        let many = ["samples", "coloured segments", "parallel"].contains(&name);
        let counts = if many { &[1, 2, 3, 4, 7, 8][..] } else { &[3, 8] };
        let on_device = with_renderer(|renderer| composite_is_whole(name, &whole, Some(renderer), counts));
        on_device.unwrap_or_else(|| composite_is_whole(name, &whole, None, counts));
    }
}

/// Every block begins with all light, so one behind an opaque block is marched too, and dimmed afterwards.
/// A block does not know the light that is left behind those in front of it, and refines its steps as if all were: blocks of any number
/// composite to the same film, and that of one march is near.
#[test]
fn blocks_refine_steps_alike_and_more_than_one_march() {
    for name in ["refined_three", "refined_coloured", "refined_labels"] {
        let whole = Rungs::new(scenes::named(name), SIZE);
        let composite = |leaves: usize| {
            let (scenes, low_first) = parts(&whole.scene, whole.size, leaves);
            let rungs = scenes.into_iter().map(|scene| Rungs::planned(scene, whole.planned.clone(), whole.size));
            let rungs: Vec<Rungs> = rungs.collect();
            let films: Vec<Film<f64>> = rungs.iter().map(|rungs| rungs.march(&rungs.exact())).collect();
            let on_device = with_renderer(|renderer| {
                let films: Vec<Film<f32>> = rungs.iter().map(|rungs| rungs.gpu(renderer)).collect();
                composited(&films, &low_first)
            });
            (composited(&films, &low_first), on_device)
        };
        let ((two, of_two), (five, of_five)) = (composite(2), composite(5));
        let apart = difference(&two, &five);
        assert!(apart <= 1e-12, "{name}: {apart}");
        if let Some((one, other)) = of_two.zip(of_five) {
            let apart = difference(&one, &other);
            assert!(apart <= 1e-6, "{name} on the device: {apart}");
        }
        let apart = difference(&two, &whole.march::<f64>(&whole.exact()));
        assert!(apart > 0.0 && apart <= 0.02, "{name} as a whole: {apart}");
    }
}

#[test]
fn early_termination_leaves_out_as_much_light_as_in_one_march() {
    let mut scene = scenes::named("diffuse_three");
    let limit = 0.01;
    scene.accuracy.termination = limit;
    let ended = Rungs::new(scene.clone(), SIZE);
    let ended = ended.march::<f64>(&ended.exact());
    let (scenes, low_first) = parts(&scene, SIZE, 4);
    let films: Vec<Film<f64>> =
        scenes.into_iter().map(|scene| Rungs::new(scene, SIZE)).map(|rungs| rungs.march(&rungs.exact())).collect();
    scene.accuracy.termination = 0.0;
    let whole = Rungs::new(scene, SIZE);
    let whole = whole.march::<f64>(&whole.exact());
    assert!(difference(&ended, &whole) > 0.0, "nothing terminates early");
    for (film, blocks) in [(ended, 1.0), (composited(&films, &low_first), 4.0)] {
        let worst = difference(&film, &whole);
        assert!(worst <= limit * blocks, "{worst}, with a termination of {limit} in {blocks} blocks");
    }
}

/// The film of `rungs`, marched block by block from front to back in tiles of `rows` rows, each from what the blocks in
/// front have left.
pub(super) fn relayed(rungs: &Rungs, renderer: &Renderer, leaves: usize, rows: usize) -> Film<f32> {
    let (scenes, low_first) = parts(&rungs.scene, rungs.size, leaves);
    let on_device = |scene: &Scene| {
        let statistics = scene.volume().statistics().unwrap();
        SceneRenderer::with_plan(renderer, scene.clone(), rungs.planned.clone(), statistics, &Quiet).unwrap()
    };
    let first = on_device(&scenes[0]);
    let mut state: Option<Film<f32>> = None;
    for block in Node::top(leaves).front_to_back(&low_first) {
        let own = first.with_scene(scenes[block].clone(), rungs.planned.clone(), &Quiet).unwrap();
        let mut march = own.begin_march(rungs.size, renderer.speed()).unwrap();
        for start in (0..rungs.size[1]).step_by(rows) {
            let tile = start..(start + rows).min(rungs.size[1]);
            let before = state.as_ref().map(|film| film.cut_out([[0, tile.start], [rungs.size[0], tile.end]]));
            march.begin_rows(renderer, tile, before.as_ref()).unwrap();
            while !march.is_done() {
                march.step(renderer, own.uploaded()).unwrap();
            }
        }
        state = Some(march.read_rows(renderer, 0..rungs.size[1]).unwrap());
    }
    state.unwrap()
}

/// Also with an early end, and with the headlight's shadows, which come from the march.
#[test]
fn a_march_that_goes_on_from_block_to_block_is_one_march_to_the_bit() {
    let on_a_device = with_renderer(|renderer| {
        let headlight = {
            let mut scene = scenes::named("diffuse_three");
            for light in scene.lights.iter_mut().filter(|light| light.placement == Placement::Headlight) {
                light.shadows = true;
            }
            assert!(scene.asks_for_shadows(), "a headlight");
            ("shadowed headlight", scene, SIZE)
        };
        for (name, mut scene, size) in cases().into_iter().chain([headlight]) {
            scene.accuracy.termination = 0.02;
            let whole = Rungs::new(scene, size);
            let (film, group) = (whole.filtered(renderer), renderer.group_rows());
            for leaves in if name == "samples" { vec![1, 2, 3, 5, 8] } else { vec![3, 4] } {
                let relayed = relayed(&whole, renderer, leaves, if leaves == 3 { size[1] } else { group });
                assert!(relayed == film, "{name} in {leaves} blocks: {}", difference(&relayed, &film));
            }
        }
        // In bricks too, which are smaller and larger than blocks.
        let mut scene = scenes::named("coloured_three");
        scene.accuracy.interpolation = Interpolation::ExactLinear;
        scene.accuracy.termination = 0.02;
        let whole = Rungs::new(scene, SIZE);
        let (film, bricked) = (whole.gpu(renderer), renderer.clone().always_in_bricks());
        for leaves in [1, 4] {
            assert!(relayed(&whole, &bricked, leaves, renderer.group_rows()) == film, "{leaves} blocks in bricks");
        }
    });
    assert!(on_a_device.is_some() || std::env::var_os("GPU_TESTS").is_some(), "no device");
}
