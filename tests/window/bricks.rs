//! Volumes in bricks: a coarse level at once and while a hand moves, all voxels at rest.

use std::path::Path;
use std::time::{Duration, Instant};

use glam::DVec2;
use relume::document::{Source, State};
use relume::output::write_bricks;
use relume::plan::{plan, read_ahead};
use relume::progress::{Progress, Quiet};
use relume::render::{Renderer, SceneRenderer};
use relume::scene::{Aim, Integration, Scene, VolumeAs};
use relume::view::engine::{Refining, ShownLevel};
use relume::view::{Engine, Loaded};
use relume::volume::{HostMemory, RawLayout, Selection, VoxelType};

use crate::support::program::Folder;
use crate::support::rungs::with_renderer;
use crate::support::screen::Screen;

pub(super) const SIZE: [usize; 2] = [48, 36];
/// 3×2×2 bricks, the last ones incomplete.
const DIMS: [usize; 3] = [150, 100, 90];

/// A scene with a shell around a core, whose values differ from voxel to voxel.
const SCENE: &str = r#"version = 1
[volume]
file = "VOLUME"
[materials.shell]
reflectance = "foliage"
[materials.core]
reflectance = "white 9.5"
[transfer]
intervals = [
    { material = "shell", range = [60, 110], ramp = 9, opacity = 0.04 },
    { material = "core", range = [170, 255], ramp = 9, opacity = 0.5 },
]
[lights.day]
spectrum = "D65"
kind = "directional"
direction = [-0.4, -0.7, -0.6]
[lights.lamp]
spectrum = "A"
kind = "ambient"
intensity = 0.5
[accuracy]
interpolation = "exact_linear"
"#;

/// Bytes of a volume of `dims` voxels.
fn voxels(dims: [usize; 3]) -> Vec<u8> {
    let [nx, ny, nz] = dims;
    let place = |at: usize, n: usize| 2 * 256 * at / n;
    let of = |at: usize, n: usize| place(at, n).abs_diff(256);
    let value = |x: usize, y: usize, z: usize| {
        let distance = (of(x, nx).pow(2) + of(y, ny).pow(2) + of(z, nz).pow(2)).isqrt();
        let ripple = (7 * x + 13 * y + 29 * z) % 17;
        u8::try_from(if distance < 110 {
            180 + ripple
        } else if distance < 230 {
            75 + ripple
        } else {
            5
        })
        .unwrap()
    };
    (0..nx * ny * nz).map(|i| value(i % nx, i / nx % ny, i / (nx * ny))).collect()
}

/// A folder with `v.bricks` of `dims` voxels and a scene of it.
fn bricks(dims: [usize; 3]) -> Folder {
    let folder = Folder::new().with("v.raw", voxels(dims)).with("scene.toml", SCENE.replace("VOLUME", "v.bricks"));
    let source = (&*folder.path("v.raw"), Some(&RawLayout::new(dims, VoxelType::U8)));
    write_bricks(&folder.path("v.bricks"), source, &Selection::default(), u64::MAX, &Quiet).unwrap();
    folder
}

pub(super) fn opened(renderer: &Renderer, scene: &Path, memory: HostMemory) -> (Engine, State) {
    let loaded = Loaded::open(renderer, Source::of(scene), memory, &Quiet).unwrap();
    let state = State::new(&loaded.file);
    (Engine::new(loaded), state)
}

/// Steps until `is_there`, at rest.
pub(super) fn until(engine: &mut Engine, mut is_there: impl FnMut(&Engine) -> bool) {
    let begun = Instant::now();
    while !is_there(engine) {
        if !engine.step(true).unwrap().worked {
            std::thread::sleep(Duration::from_millis(1));
        }
        assert!(begun.elapsed() < Duration::from_secs(120), "it rests: {:?}", engine.shown_level());
    }
}

/// The film of the picture, to the bit.
pub(super) fn film(engine: &Engine) -> Vec<u32> {
    let place = |at: usize, n: usize| (float(at) + 0.5) / float(n);
    let pixels = (0..SIZE[0] * SIZE[1]).map(|i| DVec2::new(place(i % SIZE[0], SIZE[0]), place(i / SIZE[0], SIZE[1])));
    let numbers = pixels.flat_map(|place| {
        let film = engine.pixel(place).unwrap().unwrap().numbers;
        film.accumulators.into_iter().chain(film.transmittance).collect::<Vec<f32>>()
    });
    numbers.map(f32::to_bits).collect()
}

fn float(number: usize) -> f64 {
    f64::from(u32::try_from(number).unwrap())
}

pub(super) fn azimuth(state: &mut State) -> &mut f64 {
    match &mut state.scene.camera.aim {
        Aim::Orbit { azimuth, .. } => azimuth,
        Aim::LookAt { .. } => panic!("the camera orbits"),
    }
}

#[test]
fn voxels_in_a_file_are_coarse_at_once_and_at_rest_the_film_of_voxels_in_memory_to_the_bit() {
    with_renderer(|renderer| {
        let folder = bricks(DIMS);
        let (mut engine, mut state) = opened(renderer, &folder.path("scene.toml"), HostMemory::InFile);
        engine.update(&state, SIZE);
        until(&mut engine, |engine| engine.picture().is_some());
        let coarse = engine.shown_level().unwrap();
        assert_eq!((coarse.level, coarse.voxels), (1, 8));
        // A fast device has marched all sizes of the picture in the same step.
        assert!(matches!(coarse.then, Refining::Waits | Refining::Prepares), "{coarse:?}");
        let mut loads = 0;
        until(&mut engine, |engine| {
            let then = engine.shown_level().map(|shown| shown.then);
            loads += usize::from(matches!(then, Some(Refining::Loads(_))));
            engine.is_finest()
        });
        assert!(loads > 0, "the status line tells of bricks");
        assert_eq!(engine.shown_level(), None);
        let first = engine.brick_counts().unwrap();
        assert!(first.loaded > 1 && first.again == 0, "{first:?}");

        // In memory, and whole on the device: the rung above.
        let (mut whole, mut same) = opened(renderer, &folder.path("scene.toml"), HostMemory::Whole);
        whole.update(&same, SIZE);
        until(&mut whole, Engine::is_finest);
        assert!(whole.brick_counts().is_none() && whole.shown_level().is_none());
        assert!(film(&engine) == film(&whole), "the film at rest");

        // A light marches nothing, and a camera or a colour loads no brick that is there.
        let marches = engine.counts().marches;
        state.scene.lights[0].intensity = 0.3;
        assert!(!engine.update(&state, SIZE), "a light");
        until(&mut engine, Engine::is_finest);
        assert_eq!(engine.counts().marches, marches);
        *azimuth(&mut state) += 30.0;
        assert!(engine.update(&state, SIZE), "the camera");
        until(&mut engine, |engine| engine.reached().first);
        assert!(engine.shown_level().is_some(), "a hand moves the coarse level");
        until(&mut engine, Engine::is_finest);
        assert_eq!(engine.brick_counts().unwrap().loaded, 0, "the pool holds all bricks");
        *azimuth(&mut same) += 30.0;
        whole.update(&same, SIZE);
        until(&mut whole, Engine::is_finest);
        assert!(film(&engine) == film(&whole), "the film from another side");
        engine.end();
        whole.end();
    });
}

#[test]
fn a_first_look_at_voxels_in_a_file_finds_the_layers_of_voxels_in_memory() {
    let folder = bricks(DIMS);
    let look = |memory: HostMemory| {
        let mut source = Source::of(&folder.path("v.bricks"));
        source.options.selection.memory = memory;
        let (file, statistics) = source.read(&Quiet).unwrap();
        assert_eq!(statistics.histogram.iter().sum::<u64>(), DIMS.iter().product::<usize>() as u64, "of all voxels");
        assert!(file.guess.is_some());
        file.scene
    };
    let [in_file, whole] = [HostMemory::InFile, HostMemory::Whole].map(look);
    let names = |scene: &Scene| scene.materials.iter().map(|material| material.name.clone()).collect::<Vec<_>>();
    assert_eq!(names(&in_file), names(&whole));
    assert_eq!((in_file.frame.geometry, in_file.transfer.opacity_length), (whole.frame.geometry, 1.0));
    // Outside, in the middle of the shell's values, and of the core's.
    let shown = |scene: &Scene| {
        [5.0, 83.0, 188.0].map(|value| {
            let scattering = scene.transfer.medium(value, scene.materials.len()).scattering;
            scattering.into_iter().map(|depth| depth > 0.0).collect::<Vec<_>>()
        })
    };
    assert_eq!(shown(&in_file), shown(&whole));
    assert!(shown(&whole)[0].iter().all(|shows| !shows) && shown(&whole)[1].contains(&true), "{:?}", shown(&whole));
}

#[test]
fn a_refinement_that_is_stopped_or_fails_leaves_the_coarse_picture_and_says_so() {
    with_renderer(|renderer| {
        let folder = bricks(DIMS);
        let (mut engine, mut state) = opened(renderer, &folder.path("scene.toml"), HostMemory::InFile);
        engine.update(&state, SIZE);
        let loads = |engine: &Engine| matches!(engine.shown_level(), Some(ShownLevel { then: Refining::Loads(_), .. }));
        until(&mut engine, loads);
        engine.stop();
        until(&mut engine, Engine::is_finest);
        assert_eq!(engine.shown_level().unwrap().then, Refining::Stopped);

        // The next change goes on, and a change while bricks are loaded begins anew.
        *azimuth(&mut state) += 20.0;
        engine.update(&state, SIZE);
        until(&mut engine, loads);
        *azimuth(&mut state) += 20.0;
        engine.update(&state, SIZE);
        assert!(!loads(&engine));
        until(&mut engine, Engine::is_finest);
        assert_eq!(engine.shown_level(), None);
        engine.end();

        // The file loses its bricks after the coarse level has been made.
        let (mut engine, state) = opened(renderer, &folder.path("scene.toml"), HostMemory::InFile);
        engine.update(&state, SIZE);
        until(&mut engine, |engine| engine.shown_level().is_some());
        std::fs::File::options().write(true).open(folder.path("v.bricks")).unwrap().set_len(4096).unwrap();
        let begun = Instant::now();
        let error = loop {
            match engine.step(true) {
                Err(error) => break error.to_string(),
                Ok(_) => assert!(begun.elapsed() < Duration::from_secs(60), "the file is damaged"),
            }
        };
        assert!(error.contains("v.bricks"), "{error}");
        assert!(engine.picture().is_some() && engine.is_finest() && !engine.has_work(true));
        assert_eq!(engine.shown_level().unwrap().then, Refining::Failed);
        engine.end();
    });
}

#[test]
fn an_error_or_a_stop_of_bricks_concerns_only_the_scene_that_was_planned_and_keeps_the_pool() {
    with_renderer(|renderer| {
        let folder = bricks(DIMS);
        // Room for all bricks, but not for one around which long segments read: 167 texels along each axis of 8 bytes.
        let renderer = &renderer.clone().with_memory(34_000_000);
        let (mut engine, mut state) = opened(renderer, &folder.path("scene.toml"), HostMemory::InFile);
        state.scene.accuracy.integration = Integration::Segments;
        let prepares = |engine: &Engine| engine.shown_level().is_some_and(|shown| shown.then == Refining::Prepares);
        // The long segments are gone before their plan has failed.
        state.scene.accuracy.step_length = 100.0;
        engine.update(&state, SIZE);
        until(&mut engine, prepares);
        state.scene.accuracy.step_length = 1.0;
        engine.update(&state, SIZE);
        until(&mut engine, Engine::is_finest);
        assert_eq!(engine.shown_level(), None);

        // A plan that is stopped is no error, and a light goes on with it.
        state.scene.accuracy.step_length = 100.0;
        engine.update(&state, SIZE);
        until(&mut engine, prepares);
        engine.stop();
        until(&mut engine, Engine::is_finest);
        assert_eq!(engine.shown_level().unwrap().then, Refining::Stopped);
        state.scene.lights[0].intensity *= 0.5;
        assert!(!engine.update(&state, SIZE), "a light");
        let begun = Instant::now();
        let error = loop {
            match engine.step(true) {
                Err(error) => break error,
                Ok(_) => assert!(begun.elapsed() < Duration::from_secs(60), "there is no room"),
            }
        };
        assert_eq!(error.code(), "volume-memory-exceeded");
        assert_eq!(engine.shown_level().unwrap().then, Refining::Failed);

        // The coarse picture takes other colours.
        let pictures = engine.pictures();
        state.scene.materials[0].reflectance = state.scene.materials[1].reflectance.clone();
        assert!(!engine.update(&state, SIZE), "a colour");
        assert!(engine.pictures() > pictures && engine.show().unwrap(), "it is relit");

        // No brick is loaded again.
        state.scene.accuracy.step_length = 1.0;
        engine.update(&state, SIZE);
        until(&mut engine, Engine::is_finest);
        assert_eq!((engine.shown_level(), engine.brick_counts().unwrap().loaded), (None, 0));

        // An engine that is replaced hands over the thread that plans.
        state.scene.accuracy.step_length = 100.0;
        engine.update(&state, SIZE);
        until(&mut engine, prepares);
        let threads = engine.give_up();
        assert_eq!(threads.len(), 1);
        threads.into_iter().for_each(|thread| thread.join().unwrap());
    });
}

#[test]
fn a_label_map_beside_voxels_in_a_file_is_in_memory_and_coarse_at_once_in_the_window() {
    with_renderer(|renderer| {
        let labels: Vec<u8> = (0..DIMS.iter().product()).map(|i: usize| if i % DIMS[0] < 70 { 7 } else { 0 }).collect();
        let sidecar = format!("dims = {DIMS:?}\ntype = \"uint8\"\n");
        let named =
            SCENE.replace("VOLUME", "v.bricks").replace("[materials.shell]", "labels = \"l.raw\"\n[materials.shell]");
        let seven = "[labels.7]\nname = \"half\"\nmaterial = \"core\"\nopacity = 0.3\n";
        let folder = bricks(DIMS).with("l.raw", labels).with("l.raw.toml", sidecar);
        let folder = folder.with("labelled.toml", format!("{named}{seven}"));
        let [stored, whole] = [HostMemory::InFile, HostMemory::Whole].map(|memory| {
            let mut source = Source::of(&folder.path("labelled.toml"));
            source.options.selection.memory = memory;
            let (file, statistics) = source.read(&Quiet).unwrap();
            let on_device = SceneRenderer::with_statistics(renderer, file.scene, statistics, &Quiet).unwrap();
            assert!(on_device.planned().plan.labels);
            let film = on_device.march(SIZE, &Quiet).unwrap();
            assert_eq!(film.bricks.is_some(), memory == HostMemory::InFile);
            renderer.read(&film).unwrap()
        });
        assert!(stored == whole, "the film of voxels in memory, to the bit");
        let [(at_first, at_rest), (_, whole)] = [HostMemory::InFile, HostMemory::Whole].map(|memory| {
            let (mut engine, state) = opened(renderer, &folder.path("labelled.toml"), memory);
            engine.update(&state, SIZE);
            until(&mut engine, |engine| engine.picture().is_some());
            let level = engine.shown_level().map(|shown| shown.level);
            assert_eq!(level, (memory == HostMemory::InFile).then_some(1));
            let (scene, block) = engine.scene_at_hand();
            until(&mut engine, Engine::is_finest);
            assert_eq!(engine.shown_level(), None);
            ((scene, block), film(&engine))
        });
        assert!(at_rest == whole, "the film at rest");
        // The scene of the first picture and of the probe: blocks of 2×2×2 labels.
        let (scene, block) = at_first;
        let labels = scene.labels.unwrap();
        assert_eq!((block, labels.volume.geometry.dims), (Some([2; 3]), [75, 50, 45]));
        assert_eq!([34, 35].map(|x| labels.volume.voxels.value(x)), [Some(7.0), Some(0.0)]);
    });
}

#[test]
fn shadows_at_rest_are_those_of_a_render_to_the_bit_and_their_level_is_told() {
    with_renderer(|renderer| {
        let folder = bricks(DIMS);
        let (mut engine, mut state) = opened(renderer, &folder.path("scene.toml"), HostMemory::InFile);
        engine.update(&state, SIZE);
        until(&mut engine, Engine::is_finest);
        assert_eq!(engine.light_block(), None);
        state.scene.lights[0].shadows = true;
        engine.update(&state, SIZE);
        until(&mut engine, Engine::is_finest);
        assert_eq!((engine.shown_level(), engine.light_block()), (None, Some([2; 3])));
        let single = SceneRenderer::new(renderer, state.scene.clone(), &Quiet).unwrap();
        let single = renderer.read(&single.march(SIZE, &Quiet).unwrap()).unwrap();
        let pixels = SIZE[0] * SIZE[1];
        let of_pixel = |i: usize| {
            let planes = [&single.accumulators, &single.transmittance];
            planes
                .into_iter()
                .flat_map(move |numbers| numbers.iter().skip(i).step_by(pixels))
                .map(|number| number.to_bits())
        };
        assert!(film(&engine) == (0..pixels).flat_map(of_pixel).collect::<Vec<_>>());
        engine.end();
    });
}

#[test]
fn a_plan_of_voxels_in_a_file_is_cancelled_while_it_reads_them() {
    struct Cancelled;
    impl Progress for Cancelled {
        fn report(&self, _stage: &str, _done: u64, _total: u64) {}

        fn cancelled(&self) -> bool {
            true
        }
    }
    with_renderer(|renderer| {
        let folder = bricks(DIMS);
        let mut source = Source::of(&folder.path("scene.toml"));
        source.options.selection.memory = HostMemory::InFile;
        let (file, statistics) = source.read(&Quiet).unwrap();
        let mut scene = file.scene;
        // Floats: packed gradients are scaled to the largest difference of all voxels.
        scene.accuracy.volume = VolumeAs::Single;
        let read = || scene.fields.first().reads().unwrap().loaded;
        read_ahead(&scene, &Cancelled);
        assert_eq!(read(), 0);
        read_ahead(&scene, &Quiet);
        assert!(read() > 0);
        let planned = plan(&scene, &Quiet).unwrap();
        assert!(planned.plan.stores_gradient());
        let error = SceneRenderer::with_plan(renderer, scene.clone(), planned, statistics, &Cancelled).unwrap_err();
        assert!(error.to_string().contains("v.bricks was cancelled"), "{error}");
    });
}

#[test]
fn the_window_marks_a_coarse_level_saves_only_all_voxels_and_names_memory_that_is_missing() {
    let Some(screen) = Screen::new() else { return };
    let folder = Folder::new()
        .with("v.raw", voxels([250, 210, 20]))
        .with("v.raw.toml", "dims = [250, 210, 20]\ntype = \"uint8\"\n")
        .with("scene.toml", SCENE.replace("VOLUME", "v.raw"));
    let script = "cancel refining
settle
picture coarse.png
slices on
settle
probe 0.5 0.5
slices off
orbit 20 0
settle
picture rest.png
save session rest.toml
settle
";
    std::fs::write(folder.path("script.txt"), script).unwrap();
    let memory = ["--device-memory", "5000KiB"];
    let arguments = [&["scene.toml", "--script", "script.txt"][..], &memory].concat();
    let outcome = screen.run(&folder, &arguments);
    assert_eq!(outcome.code, Some(1), "a picture was not saved: {}", outcome.err);
    let report = outcome.json();
    assert!(outcome.err.contains("coarse.png was not saved"), "{}", outcome.err);
    assert!(!folder.path("coarse.png").exists());
    assert!(report["bricks"]["loaded"].as_u64().unwrap() > 0 && report["volume_level"].is_null(), "{report}");
    let size = format!("{}x{}", report["size"][0], report["size"][1]);
    folder.done(&[&["render", "rest.toml", "-o", "rendered.png", "--size", &size][..], &memory].concat());
    let [rest, rendered] = ["rest.png", "rendered.png"].map(|name| std::fs::read(folder.path(name)).unwrap());
    assert!(rest == rendered, "the picture at rest");

    folder.done(&["bricks", "v.raw", "-o", "v.bricks"]);
    let outcome = screen.run(&folder, &["v.bricks", "--memory", "1MiB", "--frames", "1"]);
    assert_eq!(outcome.code, Some(1), "{}", outcome.err);
    for words in ["at least", "MiB of memory", "more --memory"] {
        assert!(outcome.err.contains(words), "{words}: {}", outcome.err);
    }
}
