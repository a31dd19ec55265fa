//! Sessions: a saved session is a scene that restores the document, without a window or a GPU.

use crate::support;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DVec2, DVec3};
use relume::document;
use relume::document::Source;
use relume::document::design::{self, Spectra, Step};
use relume::document::moves::{Move, Side};
use relume::document::session;
use relume::document::{Definition, SceneFile, SceneOptions};
use relume::document::{Document, Edit, Mixing, SessionError, State};
use relume::document::{Question, Unknown};
use relume::palette::{Member, ModelTerm};
use relume::progress::Quiet;
use relume::scene::{
    AccumulateAs, Accuracy, Backdrop, Clip, ClipPlane, FIELDS, Form, Interval, Keep, Lighting, Overlap, Scene, Second,
    Shape, Tone,
};
use relume::spectrum::deficiency::Deficiency;
use relume::spectrum::observer::Observer;
use relume::spectrum::{Reflectance, Spectrum};
use relume::volume::{Selection, Several};
use support::program::{Folder, SCENE, labelled};

fn scene() -> SceneFile {
    parse(&format!("# a frog\n{}", labelled()))
}

fn parse(text: &str) -> SceneFile {
    document::parse("test", text, Path::new(""), &SceneOptions::default(), &Quiet).unwrap()
}

/// Text of the session, and the scene parsed from it.
fn saved(document: &Document) -> (String, SceneFile) {
    let text =
        session::text(Path::new("session.toml"), &Source::default(), document.opened(), document.state()).unwrap();
    let scene = parse(&text);
    (text, scene)
}

fn interval(material: usize) -> Interval {
    Interval { material, range: [100.1, 160.7], ramp: 0.3, opacity: 0.07, absorption: 0.0 }
}

fn accuracy(step_length: f64, dimension: Option<usize>) -> Accuracy {
    let accumulate = if dimension.is_some() { AccumulateAs::Spectral } else { AccumulateAs::Auto };
    Accuracy { step_length, dimension, accumulate, ..scene().scene.accuracy }
}

fn polygon(corners: &[[f64; 2]]) -> Arc<Shape> {
    let form = Form::Polygon { corners: corners.to_vec(), soft: 0.15 };
    Arc::new(Shape { second: Second::Gradient, form })
}

fn planes(numbers: &[(DVec3, DVec3)]) -> Vec<ClipPlane> {
    numbers
        .iter()
        .map(|&(point, normal)| ClipPlane { point, normal, on: point.x >= 1.0, fields: [true; FIELDS] })
        .collect()
}

/// A sequence of edits of every kind.
fn edits() -> Vec<Edit> {
    vec![
        Edit::Lighting(Lighting::OneSided),
        Edit::Weight(1, 0.3),
        Edit::On(0, false),
        Edit::On(0, true),
        Edit::Solo(Some(1)),
        Edit::Normalise(true),
        Edit::Master(0.7),
        Edit::Hand(DVec2::new(0.1, -0.7)),
        Edit::NodePlace(0, DVec2::new(0.3, 0.1)),
        Edit::NodeOn(1, false),
        Edit::Normalise(false),
        Edit::Master(1.5),
        Edit::NodeOn(1, true),
        Edit::DialPreset(0),
        Edit::Keep("dusk".to_owned()),
        Edit::Rename(1, "night".to_owned()),
        Edit::Tour(1, 3),
        Edit::Forget(0),
        Edit::Deficiency(Some(Deficiency::Deutan)),
        Edit::Observer(Observer::Cie1964),
        Edit::Crop(Some([DVec3::new(0.1, 0.2, 0.3), DVec3::new(0.7, 1.0, 0.9)])),
        Edit::Exposure(Some(1.7)),
        Edit::Tone(Tone::Soft),
        Edit::Backdrop(Backdrop::Dark),
        Edit::Deficiency(None),
        Edit::Observer(Observer::Cie1931),
        Edit::Adapt(true),
        Edit::Camera(Move::Orbit { right: 33.3, up: 7.7 }, 1.5),
        Edit::Camera(Move::Roll(11.1), 1.5),
        Edit::Camera(Move::Projection, 1.5),
        Edit::Camera(Move::Dolly(1.3), 1.5),
        Edit::Camera(Move::Axis(Side::Top), 1.5),
        Edit::Interval(0, Interval { range: [31.7, 88.8], ..interval(1) }),
        Edit::AddInterval(interval(1), vec![(4.0, 0.5)]),
        Edit::GradientOpacity(vec![(100.0, 0.1), (50.0, 2.0), (50.0, 0.4), (f64::NAN, 0.3)]),
        Edit::TermGradient(1, vec![(9.0, 1.0), (4.5, 0.25)]),
        Edit::TermShape(1, Some(polygon(&[[40.5, 0.1], [30.0, 9.0], [77.7, 9.0]]))),
        Edit::TermShape(1, Some(polygon(&[[f64::NAN, 0.1], [30.0, 9.0], [77.7, 9.0]]))),
        Edit::Interval(1, Interval { range: [41.0, 66.0], ..interval(1) }),
        Edit::RemoveTerm(0),
        Edit::Overlap(Overlap::Last),
        Edit::LightColour(0, [10, 200, 30]),
        Edit::Crop(Some([DVec3::NAN, DVec3::splat(-1.0)])),
        Edit::Clip(Clip {
            planes: planes(&[(DVec3::new(1.0 / 3.0, 2.0, 7.7), DVec3::new(0.1, -2.0, 0.3))]),
            keep: Keep::Any,
            cap: false,
        }),
        Edit::Clip(Clip {
            planes: planes(&[(DVec3::ONE, DVec3::Z), (DVec3::NAN, DVec3::Z), (DVec3::ZERO, DVec3::ZERO)]),
            ..Clip::default()
        }),
        Edit::Intervals(vec![interval(0), interval(1)]),
        Edit::ResetCrop,
        Edit::Clip(Clip::default()),
        Edit::Label(0, 0, 0.6),
        Edit::ResetTransfer,
        Edit::Accuracy(accuracy(1.3, None)),
        Edit::Accuracy(accuracy(0.7, Some(5))),
        Edit::Design(Step::Take(Arc::new(design::wished(&scene().scene)))),
        Edit::Design(Step::Open(design::Side::Material, 0, false)),
        Edit::Design(Step::Open(design::Side::Light, 1, true)),
        Edit::Design(Step::Bounds(design::Side::Light, 1, [0.0, 4.0])),
        Edit::Design(Step::Smoothness(design::Side::Material, 1, 0.003)),
        Edit::Design(Step::Model(Some(ModelTerm { dimension: 6, weight: 0.5 }))),
        Edit::Spectra(Arc::new(Spectra {
            materials: vec![(1, Reflectance::new(Spectrum::from_fn(|nm| nm / 1000.0)).unwrap())],
            ..Spectra::default()
        })),
        Edit::Mix(Mixing::Sliders),
    ]
}

#[test]
fn ranges_of_fields_are_saved_as_stretched_terms() {
    let text = "version = 1\nshading = \"none\"\n[volume]\nphantom = \"frog\"\ndims = [9, 9, 9]\n[materials]\na.reflectance = \
                \"red\"\nb.reflectance = \"blue\"\n[transfer]\nintervals = [{ material = \"a\", range = [50, 90], ramp = 5, opacity = \
                0.1, by = { one = [[20, 0.25], [60, 1]] }, shape = { by = \"gradient\", polygon = [[50, 0], [30, 9], [80, 9]] } }]\n\
                [clip]\nkeep = \"any\"\nplanes = [\"z:50%\", { plane = \"x:25%\", volumes = [\"volume\", \"two\"] }]\n\
                [volumes.one]\nphantom = \"frog\"\ntransfer = { opacity = [[10, 0], [90, 0.1], [200, 0.3]], material = [[10, \"a\"], \
                [200, \"b\"]], by = { volume = [[10, 1], [30, 0]] } }\n[volumes.two]\nphantom = \"frog\"\n[volumes.two.transfer]\nby = { one = [[3, 0], [4, 1]] }\nintervals = [{ material = \"b\", range = [100, \
                150], opacity = 0.2, by = {}, shape = { by = \"volume\", ratio = [[0.5, 0], [1.5, 1]] } }]\n[lights.day]\nspectrum = \"D65\"\nkind = \"ambient\"\n";
    let mut document = Document::new(parse(text));
    let ranges = [[40.0, 80.5], [20.5, 150.25], [-3.0, 200.0]];
    for (index, range) in ranges.into_iter().enumerate() {
        document.edit(&Edit::Hidden(index, index != 1));
        document.edit(&Edit::Hidden(7, true));
        document.edit(&Edit::Occludes(index % 2, [0.25, f64::NAN, 0.0][index]));
        document.edit(&Edit::FieldRange(index, range));
        assert_eq!(document.state().scene.range_of(index), Some(range));
        document.edit(&Edit::FieldRange(index, [7.0, 7.0]));
        document.edit(&Edit::FieldRange(index, [f64::NAN, 9.0]));
        assert_eq!(document.state().scene.range_of(index), Some(range), "no range");
        let (text, file) = saved(&document);
        assert_eq!(
            (file.scene.hidden, &file.scene.materials),
            (document.state().scene.hidden, &document.state().scene.materials)
        );
        for field in 0..3 {
            assert_eq!(file.scene.own_terms_of(field), document.state().scene.own_terms_of(field), "{field}: {text}");
        }
        let clip = Clip { cap: index == 1, ..document.state().scene.clip.clone() };
        document.edit(&Edit::Clip(clip.clone()));
        assert_eq!(saved(&document).1.scene.clip, clip, "planes of two volumes");
    }
    assert!(!document.is_saved(), "ranges are a part of a session");
    document.edit(&Edit::ResetTransfer);
    assert_eq!(document.state().scene.range_of(2), Some([100.0, 150.0]));
}

#[test]
fn a_session_opens_as_it_was_saved_to_the_bit() {
    let mut document = Document::new(scene());
    for edit in edits() {
        document.edit(&edit);
        let (text, file) = saved(&document);
        let (state, opened) = (document.state(), Document::new(file));
        let (ours, theirs) = (&state.scene, opened.state());
        let view = |scene: &Scene| scene.camera.view(&scene.frame.geometry, 1.5).unwrap();
        assert_eq!(view(&theirs.scene), view(ours), "{edit:?}: {text}");
        assert_eq!(theirs.scene.transfer, ours.transfer, "{edit:?}: {text}");
        let labels = |scene: &Scene| scene.labels.as_ref().unwrap().declared.clone();
        assert_eq!(labels(&theirs.scene), labels(ours), "{edit:?}: {text}");
        assert_eq!(theirs.scene.crop, ours.crop, "{edit:?}: {text}");
        assert_eq!(theirs.scene.clip, ours.clip, "{edit:?}: {text}");
        assert_eq!(theirs.dial, state.dial, "{edit:?}: {text}");
        assert_eq!(theirs.scene.display, ours.display, "{edit:?}: {text}");
        assert_eq!(theirs.scene.accuracy, ours.accuracy, "{edit:?}: {text}");
        assert_eq!(theirs.scene.materials, ours.materials, "{edit:?}: {text}");
        let asked = |state: &State| {
            let palette = state.palette.as_ref()?;
            let members = palette.materials.iter().chain(&palette.lights);
            let members = members.map(|it| (it.name.clone(), it.spectrum.is_none(), it.bounds, it.smoothness));
            Some((palette.cells.clone(), members.collect::<Vec<_>>(), palette.model))
        };
        assert_eq!(asked(theirs), asked(state), "{edit:?}: {text}");
        assert_eq!(theirs.mix(), state.mix(), "{edit:?}: {text}");
        assert_eq!(opened.opened().opening_mix(), state.mix(), "{edit:?}: {text}");
        assert_eq!(theirs.light.sliders, state.light.sliders, "{edit:?}: {text}");
        assert_eq!(saved(&opened).0, text, "saved again, after {edit:?}");
        assert!(text.starts_with("# a frog\n"), "comments are kept: {text}");
    }
}

#[test]
fn nothing_changed_is_the_scene_itself() {
    let document = Document::new(scene());
    assert_eq!(saved(&document).0, &*document.opened().text);
}

#[test]
fn paths_of_a_session_start_where_those_of_the_scene_did() {
    let opened = SceneFile { base: PathBuf::from("/data/frogs"), ..scene() };
    let document = Document::new(opened);
    let text =
        |path: &str| session::text(Path::new(path), &Source::default(), document.opened(), document.state()).unwrap();
    assert!(!text("/data/frogs/session.toml").contains("base ="));
    let elsewhere = text("/elsewhere/session.toml");
    assert!(elsewhere.contains("base = \"/data/frogs\"\n"), "{elsewhere}");
    let scene = document::parse("test", &elsewhere, Path::new("/elsewhere"), &SceneOptions::default(), &Quiet).unwrap();
    assert_eq!(scene.base, Path::new("/data/frogs"));
    // Folders of which one contains the other can be moved together.
    let above = text("/data/session.toml");
    assert!(above.contains("base = \"frogs\"\n"), "{above}");
}

#[test]
fn what_the_command_line_has_changed_is_saved() {
    let definitions = vec![Definition::new("display.exposure=3"), Definition::new("accuracy.k=5")];
    let options = SceneOptions { definitions, ..SceneOptions::default() };
    let opened = document::parse("test", SCENE, Path::new(""), &options, &Quiet).unwrap();
    let scene = saved(&Document::new(opened)).1.scene;
    assert_eq!((scene.display.exposure, scene.accuracy.dimension), (Some(3.0), Some(5)));

    let smaller = SceneOptions { downsample: Some([2, 2, 1]), ..SceneOptions::default() };
    let opened = document::parse("test", SCENE, Path::new(""), &smaller, &Quiet).unwrap();
    let document = Document::new(opened);
    let source = Source { path: None, options: smaller };
    let refused = session::text(Path::new("session.toml"), &source, document.opened(), document.state());
    assert!(matches!(refused, Err(SessionError::Downsampled)), "{refused:?}");
}

#[test]
fn a_curve_of_the_transfer_function_stays_or_goes() {
    let curve = "[transfer]\nopacity = [[0, 0], [9, 0.5]]\nmaterial = [[0, \"bone\"]]\n";
    let mut document = Document::new(parse(&SCENE.replace("[transfer]\n", curve)));
    assert_eq!(document.state().scene.transfer.terms.len(), 3);
    document.edit(&Edit::AddInterval(interval(0), Vec::new()));
    let (text, scene) = saved(&document);
    assert_eq!(scene.scene.transfer, document.state().scene.transfer, "{text}");
    document.edit(&Edit::RemoveTerm(3));
    let (text, scene) = saved(&document);
    assert_eq!(scene.scene.transfer, document.state().scene.transfer, "{text}");
}

#[test]
fn intervals_that_no_scene_may_state_are_not_made() {
    let strange = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -3.0, 1e300, 0.0];
    let mut document = Document::new(scene());
    for number in strange {
        for changed in [
            Interval { range: [number, 50.0], ..interval(0) },
            Interval { range: [50.0, number], ..interval(0) },
            Interval { ramp: number, ..interval(0) },
            Interval { opacity: number, ..interval(0) },
            Interval { absorption: number, ..interval(0) },
            interval(9),
        ] {
            document.edit(&Edit::Interval(0, changed));
            document.edit(&Edit::AddInterval(changed, Vec::new()));
            document.edit(&Edit::Label(0, 0, number));
            document.edit(&Edit::Label(7, 9, number));
            let (text, scene) = saved(&document);
            assert_eq!(scene.scene.transfer, document.state().scene.transfer, "{changed:?}: {text}");
        }
    }
}

#[test]
fn a_tour_meets_every_preset_and_is_straight_between_them() {
    let mut document = Document::new(scene());
    let places = [DVec2::new(0.1, 0.3), DVec2::new(-0.5, 0.25), DVec2::new(0.3, -0.7)];
    document.edit(&Edit::Forget(0));
    for (name, place) in ["one", "two", "three"].into_iter().zip(places) {
        document.edit(&Edit::Hand(place));
        document.edit(&Edit::Keep(name.to_owned()));
    }
    let hand = |step| document.preview(&Edit::Tour(step, 12)).light.hand;
    assert_eq!([hand(0), hand(6), hand(12), hand(99)], [places[0], places[1], places[2], places[2]]);
    let quarter = places[0] * 0.75 + places[1] * 0.25;
    assert!(hand(1).distance(places[0] + (places[1] - places[0]) / 6.0) < 1e-15, "{}", hand(1));
    assert!(document.preview(&Edit::Tour(3, 24)).light.hand.distance(quarter) < 1e-15, "a quarter of the first leg");
    assert_eq!(document.state().light.preset, Some(2), "a preview changes nothing");
}

#[test]
fn a_preset_keeps_its_name_to_itself_and_which_nodes_are_out() {
    let mut document = Document::new(scene());
    document.edit(&Edit::NodeOn(0, false));
    document.edit(&Edit::Hand(DVec2::new(0.2, 0.1)));
    document.edit(&Edit::Keep("dusk".to_owned()));
    document.edit(&Edit::Keep(String::new()));
    document.edit(&Edit::Rename(0, "dusk".to_owned()));
    let names = |document: &Document| -> Vec<String> {
        document.state().dial.presets.iter().map(|preset| preset.name.clone()).collect()
    };
    assert_eq!(names(&document), ["evening", "dusk"], "an empty name is none, and one that is taken is not given");
    document.edit(&Edit::NodeOn(0, true));
    document.edit(&Edit::DialPreset(1));
    assert!(!document.state().dial.nodes[0].on, "the node is out again");
    document.edit(&Edit::Hand(DVec2::new(0.3, 0.1)));
    document.edit(&Edit::Keep("dusk".to_owned()));
    assert_eq!(document.state().dial.presets[1].hand, DVec2::new(0.3, 0.1));
    assert_eq!(names(&document).len(), 2);
    document.undo();
    assert_eq!(document.state().dial.presets[1].hand, DVec2::new(0.2, 0.1));
}

#[test]
fn a_preset_restores_exactly_which_nodes_take_part_whatever_the_dial_had_when_it_was_saved() {
    let mut document = Document::new(scene());
    let on = |state: &State| state.dial.nodes.iter().map(|node| node.on).collect::<Vec<_>>();
    document.edit(&Edit::Hand(DVec2::new(0.2, 0.1)));
    document.edit(&Edit::Keep("all".to_owned()));
    document.edit(&Edit::NodeOn(1, false));
    document.edit(&Edit::Keep("one".to_owned()));
    document.edit(&Edit::DialPreset(1));
    assert_eq!(on(document.state()), [true, true]);
    document.edit(&Edit::NodeOn(0, false));
    document.edit(&Edit::NodeOn(1, false));
    let mut opened = Document::new(saved(&document).1);
    assert_eq!(on(opened.state()), [false, false], "the dial itself has both off now");
    for (preset, expected) in [(1, [true, true]), (2, [true, false]), (1, [true, true])] {
        opened.edit(&Edit::DialPreset(preset));
        assert_eq!(on(opened.state()), expected);
        let name = opened.state().dial.presets[preset].name.clone();
        let (dial, _) = opened.opened().dial.preset(&name).unwrap();
        assert_eq!(dial.nodes.iter().map(|node| node.on).collect::<Vec<_>>(), expected, "on the command line, too");
    }
}

#[test]
fn a_crop_is_what_a_scene_may_state_whatever_is_asked_for() {
    let mut document = Document::new(scene());
    for number in [f64::NAN, f64::INFINITY, -1.0, 0.0, 0.5, 1.0, 7.0] {
        for other in [0.0, 0.5, 1.0] {
            document.edit(&Edit::Crop(Some([DVec3::splat(number), DVec3::splat(other)])));
            let (text, scene) = saved(&document);
            assert_eq!(scene.scene.crop, document.state().scene.crop, "{number} to {other}: {text}");
        }
    }
    document.edit(&Edit::Crop(Some([DVec3::splat(0.25), DVec3::splat(0.75)])));
    let [low, high] = document.state().crop().unwrap();
    assert!(low.distance(DVec3::splat(0.25)) < 1e-15 && high.distance(DVec3::splat(0.75)) < 1e-15, "{low} {high}");
}

#[test]
fn a_volume_that_takes_a_word_to_be_read_is_asked_about_and_saved_with_the_answer() {
    let folder = Folder::new();
    let header = "NRRD0004\ntype: uint8\ndimension: 4\nsizes: 4 4 4 2\nspace: left-posterior-superior-time\nspace directions: (1,0,0,0) (0,1,0,0) (0,0,1,0) (0,0,0,1)\nencoding: raw\n\n";
    let steps: Vec<u8> = header.bytes().chain(0..128).collect();
    let folder = folder.with("steps.nrrd", steps).with("foot_8x4x2.raw", (0..64).collect::<Vec<u8>>());
    let saved_of = |source: &Source| {
        let (scene, _) = source.read(&Quiet).unwrap();
        let document = Document::new(scene);
        let text = session::text(&folder.path("s.toml"), source, document.opened(), document.state()).unwrap();
        // The session names the volume beside it by its name.
        let again = document::parse("s.toml", &text, &folder.path(""), &SceneOptions::default(), &Quiet).unwrap();
        (document.opened().scene.clone(), again.scene)
    };

    let mut source = Source::of(&folder.path("steps.nrrd"));
    let error = source.read(&Quiet).unwrap_err();
    let there = Unknown::Which(Several::Times(2));
    assert_eq!(error.question(), Some(Question { file: folder.path("steps.nrrd"), unknown: there.clone() }));
    let scene = SCENE.replace("phantom = \"frog\"", "file = \"steps.nrrd\"");
    std::fs::write(folder.path("of_steps.toml"), scene).unwrap();
    let question = Source::of(&folder.path("of_steps.toml")).read(&Quiet).unwrap_err().question();
    assert_eq!(question, Some(Question { file: folder.path("steps.nrrd"), unknown: there }), "and not the scene");
    // The question is about the volume; labels are not asked about.
    let mut labelled = Source::of(&folder.path("scene.toml"));
    labelled.options.labels = Some(folder.path("steps.nrrd"));
    let error = labelled.read(&Quiet).unwrap_err();
    assert_eq!(error.question(), None, "{error}");
    source.options.selection.time = Some(1);
    let (opened, again) = saved_of(&source);
    assert_eq!((opened.volume().value([0; 3]), again.volume().value([0; 3])), (Some(64.0), Some(64.0)));
    let view = opened.camera.view(&opened.volume().geometry, 1.0).unwrap();
    assert_eq!((view.forward, view.up), (DVec3::Y, DVec3::Z), "a patient is looked at from the front");

    let mut source = Source::of(&folder.path("foot_8x4x2.raw"));
    let question = source.read(&Quiet).unwrap_err().question().map(|question| question.unknown);
    let Some(Unknown::Layout { bytes: 64, guess: Some(guess) }) = question else { panic!("{question:?}") };
    assert_eq!(guess.dims, [8, 4, 2]);
    source.options.raw = Some(*guess);
    let (opened, again) = saved_of(&source);
    assert_eq!(opened.volume().voxels, again.volume().voxels);

    // A layout describes a volume, not the scene that names it.
    let mut scene = Source::of(&folder.path("scene.toml"));
    scene.options.raw = source.options.raw.clone();
    assert_eq!(scene.bare_volume(), None);

    let error = Source::of(&folder.path("none.raw")).read(&Quiet).unwrap_err();
    assert_eq!(error.question(), None, "{error}");
}

#[test]
fn a_volume_alone_shows_all_of_it_in_daylight_and_one_material_under_each_other_light() {
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nencoding: raw\n\n";
    let folder = Folder::new().with("v.nrrd", header.bytes().chain(0..64).collect::<Vec<u8>>());
    let (scene, _) = Source::of(&folder.path("v.nrrd")).read(&Quiet).unwrap();
    let state = State::new(&scene);
    let palette = state.palette.as_deref().unwrap();
    let name = |members: &[Member], index: usize| members[index].name.clone();
    for row in 0..palette.materials.len() {
        for column in 0..palette.lights.len() {
            let (material, light) = (name(&palette.materials, row), name(&palette.lights, column));
            let look = design::look(&state.scene, palette, row, column);
            let off = look.difference.unwrap();
            assert!(off < 0.05, "{material} under {light} is ΔE00 {off} from what is asked");
            let bright = look.achieved.unwrap().0[1];
            let shows = light == "day" || light == format!("for_{material}");
            assert_eq!(bright > 0.05, shows, "{material} under {light}: Y = {bright}");
        }
    }
}

#[test]
fn another_time_step_than_a_session_states_is_asked_for_and_saved() {
    let header = "NRRD0004\ntype: uint8\ndimension: 4\nsizes: 4 4 4 2\nencoding: raw\n\n";
    let steps: Vec<u8> = header.bytes().chain(0..128).collect();
    let text = SCENE.replace("phantom = \"frog\"\ndims = [32, 30, 18]", "file = \"steps.nrrd\"\ntime = 1");
    let folder = Folder::new().with("steps.nrrd", steps).with("steps.toml", text);
    let stated = Source::of(&folder.path("steps.toml"));
    let (scene, _) = stated.read(&Quiet).unwrap();
    let time = |time| Selection { time: Some(time), ..Selection::default() };
    assert_eq!(scene.scene.volume().selection, time(1));
    assert_eq!(parse(SCENE).scene.volume().selection, Selection::default());
    let mut other = stated.reselected();
    let question = other.read(&Quiet).unwrap_err().question();
    assert_eq!(question.map(|question| question.unknown), Some(Unknown::Which(Several::Times(2))));
    other.options.selection.time = Some(0);
    assert!(other.is_another_of(&stated) && !stated.is_another_of(&other));
    let (first, statistics) = other.read(&Quiet).unwrap();
    assert!(statistics.min.abs() < 1e-9 && (statistics.max - 63.0).abs() < 1e-9, "the first half: {statistics:?}");
    assert_eq!(first.scene.volume().selection, time(0));
    let document = Document::new(scene).with_file(first, true);
    let text = session::text(&folder.path("session.toml"), &other, document.opened(), document.state()).unwrap();
    assert!(text.contains("time = 0") && !text.contains("time = 1"), "{text}");
}

#[test]
fn a_scene_whose_volume_is_not_there_is_known_to_lack_that_alone() {
    let without = SCENE.replace("phantom = \"frog\"\ndims = [32, 30, 18]", "");
    let missing = SCENE.replace("phantom = \"frog\"\ndims = [32, 30, 18]", "file = \"gone.nrrd\"");
    let folder = Folder::new().with("without.toml", without).with("missing.toml", missing);
    for (name, is_named) in [("without.toml", false), ("missing.toml", true)] {
        let path = folder.path(name);
        let error = Source::of(&path).read(&Quiet).unwrap_err();
        assert_eq!(error.scene_without_volume(), Some((&*path, is_named)), "{error}");
    }
    let error = Source::of(&folder.path("gone.toml")).read(&Quiet).unwrap_err();
    assert_eq!(error.scene_without_volume(), None, "{error}");
}

#[test]
fn a_volume_that_was_moved_is_read_as_the_scene_says_and_keeps_its_labels() {
    let text = labelled().replace(
        "phantom = \"frog\"\nphantom_labels = true\ndims = [32, 30, 18]",
        "file = \"gone.raw\"\ntype = \"uint8\"\ndims = [4, 4, 4]\nlabels = \"labels.nrrd\"",
    );
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nencoding: raw\n\n";
    let labels: Vec<u8> = header.bytes().chain([2; 64]).collect();
    let folder = Folder::new().with("moved.raw", [7; 64]).with("labels.nrrd", labels).with("moved.toml", text);
    let source = Source::of(&folder.path("moved.toml"));
    let error = source.read(&Quiet).unwrap_err();
    let (_, is_named) = error.scene_without_volume().unwrap();
    assert!(is_named, "{error}");
    let (scene, _) = source.with_volume(&folder.path("moved.raw"), is_named).read(&Quiet).unwrap();
    assert_eq!(scene.scene.frame.geometry.dims, [4; 3]);
    assert!(scene.scene.labels.is_some());
    assert!(scene.text.contains("moved.raw"), "{}", scene.text);
}
