//! What the viewer's panels ask for, and what it does to the document, without a window and without a GPU.
#![cfg(feature = "window")]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use egui::accesskit::Role;
use egui::{Event, Key, Modifiers, MouseWheelUnit, PointerButton, Pos2, Rect, TouchPhase, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use glam::{DVec2, DVec3};
use relume::measure::{Goal, Point, Preset, Setting};
use relume::model::ErrorSummary;
use relume::palette::{Conflict, WayOut};
use relume::progress::Quiet;
use relume::scene::{self, Accuracy, Interval, Mix, Projection, SceneOptions};
use relume::spectrum::colour::{LinearSrgb, OBSERVER, Xyz, bradford, d65_white, display_code, linear_srgb_from_xyz};
use relume::spectrum::observer::{OBSERVER_1964, Observer};
use relume::spectrum::{Spectrum, standard};
use relume::view::action::{File, Leaving, Losing};
use relume::view::camera::{Move, Side};
use relume::view::design::{self, Spectra, Step};
use relume::view::effort::Curve;
use relume::view::load::{Question, Source, Unknown};
use relume::view::probe::{Pixel, Ray};
use relume::view::tour::Tour;
use relume::view::ui::{self, Chooser, Design, Effort, Notice, Shown, Status};
use relume::view::{Action, Cost, Document, Edit, Mixing, Probe};
use relume::volume::{RawLayout, Selection, Several, VoxelType};
use support::program::{DIAL, Folder, SCENE};

fn document() -> Document {
    let text = format!("{SCENE}{DIAL}");
    Document::new(scene::parse("test", &text, Path::new(""), &SceneOptions::default(), &Quiet).unwrap())
}

/// A palette for what it shows.
fn offered(document: &Document) -> Edit {
    Edit::Design(Step::Take(Arc::new(design::wished(&document.state().scene))))
}

/// A document that does what the panels ask for.
struct App {
    document: Option<Document>,
    asked: Vec<Action>,
    panels: bool,
    probe: Option<(DVec2, Option<Probe>)>,
    curve: Option<Curve>,
    design: bool,
    conflicts: Vec<Conflict>,
    notices: Vec<Notice>,
    tour: Option<Tour>,
    several: bool,
    closes: bool,
    losing: Losing,
    chooser: Chooser,
    /// The folder that files are chosen in.
    folder: Folder,
    /// Where the picture is.
    place: Rect,
}

impl App {
    fn open(size: Vec2, document: Option<Document>) -> Harness<'static, Self> {
        let app = Self {
            document,
            asked: Vec::new(),
            panels: size.x >= ui::ROOM_FOR_PANELS,
            probe: None,
            curve: None,
            design: false,
            conflicts: Vec::new(),
            notices: Vec::new(),
            tour: None,
            several: false,
            closes: false,
            losing: Losing::default(),
            chooser: Chooser::default(),
            folder: Folder::new(),
            place: Rect::ZERO,
        };
        Harness::builder().with_size(size).build_ui_state(Self::show, app)
    }

    fn show(ui: &mut egui::Ui, app: &mut Self) {
        let mut asked = Vec::new();
        let shown = Shown {
            document: app.document.as_ref(),
            status: &Status::default(),
            loading: None,
            notices: &app.notices,
            stopped: false,
            several: app.several,
            closes: std::mem::take(&mut app.closes),
            tour: app.tour.as_ref(),
            chooses: app.chooser.is_open(),
            panels: app.panels,
            design: Design { shown: app.design, running: None, conflicts: &app.conflicts },
            effort: Effort { curve: app.curve.as_ref().map(|curve| (curve, true)), ..Effort::default() },
            probe: app.probe.as_ref().map(|(place, probe)| (*place, probe.as_ref())),
            aspect: 1.5,
        };
        app.place = ui::show(ui, &shown, &mut asked);
        asked.extend(app.chooser.show(ui.ctx(), app.losing));
        for action in &asked {
            match (action, &mut app.document) {
                (Action::Edit(edit), Some(document)) => {
                    document.edit(edit);
                }
                (Action::Undo, Some(document)) => {
                    document.undo();
                }
                (Action::Offer, Some(document)) => {
                    document.edit(&offered(document));
                }
                (Action::Choose(file), _) => app.chooser.open(*file, &app.folder.path("relume-0001.png")),
                (Action::Panels(shown), _) => app.panels = *shown,
                (Action::Palette(shown), _) => app.design = *shown,
                (Action::Dismiss(index), _) => drop(app.notices.remove(*index)),
                _ => {}
            }
        }
        app.asked.extend(asked);
    }
}

fn wide(document: Document) -> Harness<'static, App> {
    App::open(Vec2::new(1280.0, 720.0), Some(document))
}

fn light_names(mix: &Mix) -> Vec<&str> {
    mix.0.iter().map(|light| light.name.as_str()).collect()
}

#[test]
fn a_switch_and_solo_of_the_light_panel_decide_which_lights_shine() {
    let mut window = wide(document());
    window.get_by_label("lamp").click();
    window.run();
    let mix = |window: &Harness<'_, App>| window.state().document.as_ref().unwrap().state().mix();
    assert_eq!(light_names(&mix(&window)), ["day"]);
    window.get_by_label("Undo").click();
    window.run();
    assert_eq!(light_names(&mix(&window)).len(), 2);
    window.get_all_by_label("solo").nth(1).unwrap().click();
    window.run();
    assert_eq!(light_names(&mix(&window)), ["lamp"]);
}

#[test]
fn all_lights_off_is_a_notice_that_turns_them_on_again() {
    let mut document = document();
    for light in 0..2 {
        document.edit(&Edit::On(light, false));
    }
    assert!(!document.state().is_lit());
    let mut window = wide(document);
    window.run();
    window.get_by_label("Turn the lights on").click();
    window.run();
    assert!(window.state().document.as_ref().unwrap().state().is_lit());
    assert!(window.query_by_label("Turn the lights on").is_none(), "the notice has gone");
}

#[test]
fn nothing_of_the_light_is_asked_for_that_marches() {
    let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(document()));
    window.run();
    for label in ["lamp", "keep brightness", "eye adapts to the light", "10° (1964)", "evening"] {
        window.get_all_by_label(label).next().unwrap().click();
        window.run();
    }
    let asked = &window.state().asked;
    assert!(asked.len() >= 4, "{asked:?}");
    let costs =
        asked.iter().filter_map(|action| if let Action::Edit(edit) = action { Some(edit.cost()) } else { None });
    assert!(costs.into_iter().all(|cost| cost == Cost::Relight), "{asked:?}");
    window.get_by_label("Top").click();
    window.run();
    assert!(matches!(window.state().asked.last(), Some(Action::Edit(Edit::Camera(Move::Axis(Side::Top), _)))));
}

#[test]
fn the_hand_of_the_dial_is_dragged_and_snaps_onto_a_node() {
    let mut window = wide(document());
    window.run();
    let rect = window.get_by_label("light dial").rect();
    let nodes = ui::node_places(window.state().document.as_ref().unwrap(), rect);
    let to = |window: &mut Harness<'_, App>, place: Pos2| {
        window.event(Event::PointerMoved(place));
        window.run();
    };
    let button = |window: &mut Harness<'_, App>, pos: Pos2, pressed: bool| {
        window.event(Event::PointerButton { pos, button: PointerButton::Primary, pressed, modifiers: Modifiers::NONE });
        window.run();
    };
    to(&mut window, rect.center());
    button(&mut window, rect.center(), true);
    to(&mut window, rect.center() + Vec2::new(30.0, 20.0));
    let light = |window: &Harness<'_, App>| window.state().document.as_ref().unwrap().state().light.clone();
    assert_eq!(light(&window).mixing, Mixing::Dial);
    assert!(light(&window).hand.x > 0.0 && light(&window).hand.y < 0.0, "{}", light(&window).hand);
    to(&mut window, nodes[1] + Vec2::new(4.0, -3.0));
    assert_eq!(light(&window).hand, DVec2::new(0.0, -1.0), "exactly on the node");
    button(&mut window, nodes[1], false);
    let document = window.state_mut().document.as_mut().unwrap();
    assert_eq!(light_names(&document.state().mix()), ["lamp"], "that light alone");
    document.rest();
    document.undo();
    assert_eq!(document.state().light.hand, DVec2::ZERO, "a drag is one step back");
}

#[test]
fn keys_move_the_camera() {
    let mut window = wide(document());
    window.run();
    let keys = [
        (Key::ArrowLeft, Move::Orbit { right: -5.0, up: 0.0 }),
        (Key::Num6, Move::Axis(Side::Top)),
        (Key::P, Move::Projection),
        (Key::R, Move::Reset),
    ];
    for (key, expected) in keys {
        window.key_press(key);
        window.run();
        let last = window.state().asked.last();
        assert!(matches!(last, Some(Action::Edit(Edit::Camera(step, _))) if *step == expected), "{key:?}: {last:?}");
    }
}

/// A document whose histogram is known, in a window that is tall enough for all panels.
fn with_histogram() -> Harness<'static, App> {
    let document = document();
    let statistics = document.opened().volume.statistics().unwrap();
    App::open(Vec2::new(1280.0, 2000.0), Some(document.with_statistics(statistics)))
}

fn intervals(window: &Harness<'_, App>) -> Vec<Interval> {
    let document = window.state().document.as_ref().unwrap();
    document.state().scene.transfer.terms.iter().map(|term| Interval::of(term).unwrap()).collect()
}

#[test]
fn an_interval_below_another_is_brought_to_the_front_by_its_swatch() {
    let mut window = with_histogram();
    window.run();
    let below = intervals(&window)[0];
    let [from, to] = below.range;
    let over = Interval { range: [from - 50.0, to + 50.0], opacity: 1.0, ..intervals(&window)[1] };
    window.state_mut().document.as_mut().unwrap().edit(&Edit::Interval(1, over));
    window.run();
    let drag_below = |window: &mut Harness<'_, App>| {
        window.state_mut().asked.clear();
        // Off the handle in the middle of its top.
        let body = window.get_by_label("interval 0: Body").rect();
        let at = body.left_center().lerp(body.center(), 0.5);
        drag_along(window, &[at, at + Vec2::new(12.0, 0.0)]);
        let moved = |action: &Action| matches!(action, Action::Edit(Edit::Interval(0, _)));
        window.state().asked.iter().any(moved)
    };
    assert!(!drag_below(&mut window), "the other one lies over it");
    let line = window.get_by_label("remove interval 0").rect().center().y;
    let swatches = window.get_all_by_role(Role::ColorWell).map(|node| node.rect());
    let swatch = swatches.into_iter().find(|rect| (rect.center().y - line).abs() < 5.0).unwrap();
    click_at(&mut window, swatch.center());
    assert!(drag_below(&mut window), "it lies over the other one now");
}

#[test]
fn the_top_and_the_ends_of_an_interval_are_dragged_and_a_drag_is_one_step_back() {
    let mut window = with_histogram();
    window.run();
    let before = intervals(&window);
    let drag = |window: &mut Harness<'_, App>, label: &str, by: Vec2| {
        let from = window.get_by_label(label).rect().center();
        let button = PointerButton::Primary;
        let press = |pos, pressed| Event::PointerButton { pos, button, pressed, modifiers: Modifiers::NONE };
        let steps = [Event::PointerMoved(from), press(from, true)];
        let half = Event::PointerMoved(from + by / 2.0);
        for event in steps.into_iter().chain([half, Event::PointerMoved(from + by), press(from + by, false)]) {
            window.event(event);
            window.run();
        }
        window.state_mut().document.as_mut().unwrap().rest();
    };
    drag(&mut window, "interval 0: Top", Vec2::new(0.0, -20.0));
    let raised = intervals(&window);
    assert!(raised[0].opacity > 1.5 * before[0].opacity, "{raised:?}");
    assert_eq!(raised[0], Interval { opacity: raised[0].opacity, ..before[0] });
    drag(&mut window, "interval 0: To", Vec2::new(30.0, 0.0));
    let wider = intervals(&window);
    assert!(wider[0].range[1] > before[0].range[1] + 10.0, "{wider:?}");
    drag(&mut window, "interval 0: Before", Vec2::new(-10.0, 0.0));
    assert!(intervals(&window)[0].ramp > before[0].ramp, "{:?}", intervals(&window));
    for undone in [wider, raised, before] {
        window.get_by_label("Undo").click();
        window.run();
        assert_eq!(intervals(&window), undone);
    }
}

#[test]
fn intervals_are_added_removed_and_brought_back() {
    let mut window = with_histogram();
    window.run();
    let before = intervals(&window);
    window.get_by_label("Add interval").click();
    window.run();
    assert_eq!(intervals(&window).len(), 3);
    window.get_by_label("remove interval 0").click();
    window.run();
    assert_eq!(intervals(&window)[0], before[1]);
    window.get_by_label("Reset transfer").click();
    window.run();
    assert_eq!(intervals(&window), before);
    let marching =
        window.state().asked.iter().all(|action| matches!(action, Action::Edit(edit) if edit.cost() == Cost::March));
    assert!(marching, "{:?}", window.state().asked);
}

#[test]
fn an_empty_window_of_any_size_shows_what_to_do() {
    for size in [[1.0, 1.0], [300.0, 200.0], [1280.0, 720.0]] {
        App::open(Vec2::from(size), None).run();
        App::open(Vec2::from(size), Some(document())).run();
    }
}

#[test]
fn a_slider_takes_over_what_the_dial_made() {
    let mut document = document();
    document.edit(&Edit::Hand(DVec2::new(0.2, 0.4)));
    let by_dial = document.state().mix();
    let share = document.state().shares()[0];
    document.edit(&Edit::Weight(0, share));
    assert_eq!(document.state().light.mixing, Mixing::Sliders);
    for (ours, theirs) in document.state().mix().0.iter().zip(&by_dial.0) {
        assert!((ours.weight - theirs.weight).abs() <= 1e-12 * theirs.weight, "{} {}", ours.weight, theirs.weight);
    }
}

#[test]
fn on_a_node_the_mix_is_that_light_alone_to_the_bit() {
    let mut document = document();
    document.edit(&Edit::HandOnNode(1));
    let on_node = document.state().mix();
    document.edit(&Edit::Solo(Some(1)));
    document.edit(&Edit::Normalise(true));
    assert_eq!(document.state().mix(), on_node);
}

#[test]
fn a_node_that_is_off_keeps_its_place_and_comes_back_to_it() {
    let mut document = document();
    document.edit(&Edit::NodePlace(0, DVec2::new(0.5, 0.25)));
    document.edit(&Edit::NodeOn(0, false));
    document.edit(&Edit::Hand(DVec2::new(0.4, 0.2)));
    assert_eq!(light_names(&document.state().mix()), ["lamp"]);
    document.edit(&Edit::NodeOn(0, true));
    assert_eq!(document.state().scene.dial.nodes[0].place, DVec2::new(0.5, 0.25));
    document.edit(&Edit::ResetDial);
    assert_eq!(document.state().scene.dial, document.opened().dial);
}

#[test]
fn numbers_out_of_range_are_brought_into_it() {
    let mut document = document();
    let strange = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -3.0, 1e300];
    for number in strange {
        for edit in [
            Edit::Weight(0, number),
            Edit::Weight(99, number),
            Edit::Master(number),
            Edit::Exposure(number),
            Edit::Hand(DVec2::new(number, number)),
            Edit::NodePlace(0, DVec2::splat(number)),
            Edit::Camera(Move::Orbit { right: number, up: number }, number),
            Edit::Camera(Move::Pan { right: number, up: number }, 1.0),
            Edit::Camera(Move::Dolly(number), 1.0),
            Edit::Camera(Move::Roll(number), 1.0),
        ] {
            document.edit(&edit);
            let state = document.state();
            assert!(state.mix().0.iter().all(|light| light.weight.is_finite() && light.weight >= 0.0), "{edit:?}");
            assert!(state.scene.camera.view(&state.scene.volume.geometry, 1.0).is_some(), "{edit:?}");
        }
    }
}

#[test]
fn an_edit_costs_what_it_says() {
    let edits = [
        Edit::Weight(0, 0.5),
        Edit::On(0, false),
        Edit::Solo(Some(0)),
        Edit::Normalise(true),
        Edit::Master(0.5),
        Edit::Hand(DVec2::new(0.1, 0.2)),
        Edit::HandOnNode(0),
        Edit::NodePlace(0, DVec2::splat(0.3)),
        Edit::NodeOn(0, false),
        Edit::Situation(0),
        Edit::Exposure(2.0),
        Edit::Adapt(true),
        Edit::Camera(Move::Orbit { right: 10.0, up: 0.0 }, 1.0),
        Edit::Camera(Move::Projection, 1.0),
        Edit::Interval(0, Interval { material: 0, range: [1.0, 2.0], ramp: 0.5, opacity: 0.5, absorption: 0.0 }),
        Edit::AddInterval(Interval { material: 0, range: [1.0, 2.0], ramp: 0.5, opacity: 0.5, absorption: 0.0 }),
        Edit::RemoveTerm(0),
        Edit::Accuracy(Accuracy { step_length: 0.7, ..document().state().scene.accuracy.clone() }),
        Edit::Observer(Observer::Cie1964),
        offered(&document()),
        Edit::Spectra(Arc::new(
            Spectra::standard(&document().state().scene, design::Side::Light, "lamp", "FL11").unwrap(),
        )),
    ];
    for edit in edits {
        let mut document = document();
        assert_eq!(document.edit(&edit), Some(edit.cost()), "{edit:?}");
        assert_eq!(document.undo(), Some(edit.cost()), "{edit:?} undone");
        assert_eq!(document.redo(), Some(edit.cost()), "{edit:?} done again");
    }
}

#[test]
fn steps_back_are_bounded_however_much_is_done() {
    let mut document = document();
    for step in 0..1000 {
        document.edit(&Edit::Exposure(1.0 + f64::from(step)));
        document.rest();
    }
    let mut undone = 0;
    while document.undo().is_some() {
        undone += 1;
    }
    assert_eq!(undone, 200);
    assert!(!document.can_undo() && document.can_redo());
}

#[test]
fn a_click_on_the_picture_looks_at_the_pixel_there() {
    let mut window = wide(document());
    window.run();
    let rect = window.state().place;
    let at = rect.min + rect.size() * Vec2::new(0.25, 0.5);
    window.event(Event::PointerMoved(at));
    window.run();
    for pressed in [true, false] {
        let button = PointerButton::Primary;
        window.event(Event::PointerButton { pos: at, button, pressed, modifiers: Modifiers::NONE });
        window.run();
    }
    let Some(Action::Probe(Some(place))) = window.state().asked.last() else { panic!("{:?}", window.state().asked) };
    assert!((*place - DVec2::new(0.25, 0.5)).length() <= 1e-3, "{place}");
}

/// What a picture of four pixels of the scene has in its first.
fn probed() -> Probe {
    probed_of(&document())
}

fn probed_of(document: &Document) -> Probe {
    let scene = document.state().scene.clone();
    let (planned, size) = (relume::plan::plan(&scene, &Quiet).unwrap(), [2, 2]);
    let rungs = relume::measure::Rungs::planned(scene.clone(), planned.clone(), size).unwrap();
    let marched = rungs.march::<f32>(&rungs.stored(), &Quiet).unwrap();
    let of = |planes: &[f32]| planes.iter().step_by(4).copied().collect();
    let numbers = relume::tables::Accumulation {
        size: [1, 1],
        weights: of(&marched.weights),
        transmittance: of(&marched.transmittance),
    };
    let components = relume::tables::Components::new(&scene, &planned);
    let reflected = relume::tables::Reflected::new(&components, None);
    let ray = Ray::march(&scene, &scene.volume.statistics().unwrap(), [size, [0, 0]], &Quiet).unwrap();
    let pixel = Pixel { place: [0, 0], size, numbers, planned, components };
    Probe::new(&pixel, &scene, &Mix::of_scene(&scene), Some(&reflected), Some(&ray))
}

#[test]
fn the_probe_names_lights_and_materials_and_escape_closes_it() {
    let mut window = wide(document());
    window.state_mut().probe = Some((DVec2::splat(0.5), None));
    window.run();
    assert!(window.query_by_label("The picture is on its way.").is_some());
    window.state_mut().probe = Some((DVec2::splat(0.5), Some(probed())));
    window.run();
    for label in ["Under each light", "What it shows", "Where its light comes from", "Along the ray", "flesh", "now"] {
        assert!(window.query_all_by_label(label).next().is_some(), "{label}");
    }
    window.key_press(Key::Escape);
    window.run();
    assert_eq!(window.state().asked.last(), Some(&Action::Probe(None)));
}

#[test]
fn a_ray_that_misses_the_volume_is_said_to_and_not_to_be_followed_for_ever() {
    let mut document = document();
    document.edit(&Edit::Camera(Move::Dolly(0.1), 1.0));
    let mut window = wide(document.clone());
    window.state_mut().probe = Some((DVec2::splat(0.25), Some(probed_of(&document))));
    window.run();
    assert!(window.query_by_label_contains("The ray misses the volume").is_some());
    assert!(window.query_by_label_contains("following the ray").is_none());
}

#[test]
fn all_that_the_probe_says_is_seen_in_a_window_of_1280_by_720() {
    let mut window = wide(document());
    window.state_mut().probe = Some((DVec2::splat(0.5), Some(probed())));
    window.run();
    window.run();
    let last = window.get_by_label_contains("orange: light that still passes").rect();
    let picture = window.get_by_label("picture").rect();
    assert!(last.bottom() <= picture.bottom() && last.top() > 300.0, "{last:?} in {picture:?}");
}

#[test]
fn a_curve_of_a_material_is_drawn_by_its_handles_and_a_drag_is_one_step_back() {
    let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(document()));
    window.run();
    let samples = |window: &Harness<'_, App>| {
        let document = window.state().document.as_ref().unwrap();
        let flesh = document.state().scene.materials.iter().find(|it| it.name == "flesh").unwrap();
        flesh.reflectance.spectrum().samples().map(f64::to_bits)
    };
    let before = samples(&window);
    assert!(window.query_by_label("flesh at 480 nm").is_none());
    window.get_by_label("draw flesh").click();
    window.run();
    let from = window.get_by_label("flesh at 480 nm").rect().center();
    let press = |pos, pressed| {
        let button = PointerButton::Primary;
        Event::PointerButton { pos, button, pressed, modifiers: Modifiers::NONE }
    };
    let by = |y: f32| Event::PointerMoved(from + Vec2::new(0.0, y));
    for event in
        [by(0.0), press(from, true), by(-15.0), by(-400.0), by(-30.0), press(from + Vec2::new(0.0, -30.0), false)]
    {
        window.event(event);
        window.run();
    }
    window.state_mut().document.as_mut().unwrap().rest();
    let drawn = samples(&window);
    let [was, is] = [before, drawn].map(|samples| f64::from_bits(samples[20]));
    assert!(is > was + 0.2 && is < 1.0, "{is} from {was}");
    assert_eq!(drawn[40..], before[40..], "580 nm and longer: what is far stays, wherever the hand was on its way");
    window.get_by_label("Undo").click();
    window.run();
    assert_eq!(samples(&window), before);
    window.get_by_label("draw flesh").click();
    window.run();
    assert!(window.query_by_label("flesh at 480 nm").is_none(), "a click more puts the curve away");
}

#[test]
fn a_preset_asks_to_measure_and_a_point_of_the_curve_is_taken_by_a_click() {
    let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(document()));
    window.run();
    window.get_by_label("balanced").click();
    window.run();
    assert_eq!(window.state().asked.last(), Some(&Action::Measure(Some(Preset::Balanced.goal()))));
    window.get_by_label("choose by frame within").click();
    window.run();
    assert_eq!(window.state().asked.last(), Some(&Action::Measure(Some(Goal::Budget(50.0)))));
    let scene = document().state().scene.clone();
    let error = |p95: f64| ErrorSummary { mean: p95, p95, max: p95 };
    let point = |frame_ms: f64, p95: f64| Point { frame_ms, error: error(p95), ..Point::default() };
    let mut finer = scene.clone();
    finer.accuracy.step_length = 0.5;
    let mut curve = Curve::new(&scene, [4, 4], &[(Setting::default(), point(2.0, 3.0))]);
    curve.merge(Curve::new(&finer, [4, 4], &[(Setting::default(), point(4.0, 1.0))]));
    window.state_mut().curve = Some(curve);
    window.run();
    window.get_all_by_label("as the scene says").nth(1).unwrap().click();
    window.run();
    assert_eq!(window.state().asked.last(), Some(&Action::Edit(Edit::Accuracy(finer.accuracy.clone()))));
    assert_eq!(window.state().document.as_ref().unwrap().state().scene.accuracy, finer.accuracy);
}

#[test]
fn a_palette_is_offered_its_cells_are_chosen_and_its_spectra_opened() {
    let mut window = wide(document());
    window.run();
    window.get_all_by_label("Palette").next().unwrap().click();
    window.run();
    window.get_by_label("Design a palette").click_accesskit();
    window.run();
    let palette = |window: &Harness<'_, App>| {
        window.state().document.as_ref().unwrap().state().palette.as_deref().cloned().unwrap()
    };
    assert_eq!(palette(&window).materials.len(), 2);
    // As the window does where no button is held: what follows is a step of its own.
    window.state_mut().document.as_mut().unwrap().rest();
    window.get_by_label("flesh under day").click_accesskit();
    window.run();
    assert!(window.query_by_label("weight").is_some(), "what is asked of the cell");
    window.get_by_label("lamp: open").click_accesskit();
    window.run();
    assert_eq!(palette(&window).lights.iter().filter(|light| light.spectrum.is_none()).count(), 1);
    window.get_by_label("Solve").click_accesskit();
    window.run();
    assert_eq!(window.state().asked.last(), Some(&Action::Solve(None)));
    window.get_by_label("Undo").click();
    window.run();
    assert!(palette(&window).lights.iter().all(|light| light.spectrum.is_some()), "a step back");
}

#[test]
fn swatches_are_as_whoever_looks_sees_them_and_a_palette_says_for_whom_it_is() {
    let mut window = wide(document());
    window.run();
    window.get_all_by_label("Palette").next().unwrap().click();
    window.run();
    window.get_by_label("Design a palette").click_accesskit();
    let scene = document().state().scene.clone();
    for (observer, table) in [(Observer::Cie1931, &OBSERVER), (Observer::Cie1964, &OBSERVER_1964)] {
        window.state_mut().document.as_mut().unwrap().edit(&Edit::Observer(observer));
        window.run();
        // By the table as it is published, with daylight white on the screen.
        let raw = |spectrum: &Spectrum| DVec3::from(table.each_ref().map(|matching| matching.dot(spectrum)));
        let white = raw(standard::d65().spectrum());
        let linear = |spectrum: &Spectrum| -> DVec3 {
            let shown = bradford(Xyz((white / white.y).to_array()), d65_white()) * raw(spectrum) / white.y;
            linear_srgb_from_xyz(Xyz(shown.to_array())).0.into()
        };
        let light = |spectrum: &Spectrum| linear(spectrum).max(DVec3::ZERO) / linear(spectrum).max_element();
        let lights: Vec<DVec3> = scene.lights.iter().map(|it| light(it.spectrum.spectrum())).collect();
        let material = |reflectance: &Spectrum| -> DVec3 {
            let under = scene.lights.iter().map(|it| it.intensity * linear(&(it.spectrum.spectrum() * reflectance)));
            under.sum()
        };
        let materials = scene.materials.iter().map(|it| material(it.reflectance.spectrum()));
        for colour in lights.into_iter().chain(materials) {
            let code = display_code(LinearSrgb(colour.to_array()));
            assert!(window.query_all_by_label(&code).next().is_some(), "{observer}: there is no swatch of {code}");
        }
        let told = window.query_all_by_label_contains("palettes are designed").count();
        assert_eq!(told, usize::from(observer == Observer::Cie1964), "{observer}");
    }
}

#[test]
fn reset_transfer_is_there_where_a_label_alone_has_changed() {
    let more = "[labels.2]\nname = \"gut\"\nmaterial = \"bone\"\nopacity = 0.25\n";
    let scene = SCENE.replace("dims =", "phantom_labels = true\ndims =");
    let text = format!("{scene}{more}");
    let opened = scene::parse("test", &text, Path::new(""), &SceneOptions::default(), &Quiet).unwrap();
    let stated = opened.labels.as_ref().unwrap().declared.clone();
    let mut document = Document::new(opened);
    document.edit(&Edit::Label(0, 0, 0.75));
    let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(document));
    window.run();
    window.get_by_label("Reset transfer").click();
    window.run();
    let state = window.state().document.as_ref().unwrap().state();
    assert_eq!(state.scene.labels.as_ref().unwrap().declared, stated);
}

#[test]
fn a_side_of_the_crop_box_is_dragged_on_the_picture() {
    let mut document = document();
    document.edit(&Edit::Camera(Move::Axis(Side::Front), 1.5));
    let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(document));
    window.run();
    window.get_by_label("crop").click();
    window.run();
    let crop = |window: &Harness<'_, App>| window.state().document.as_ref().unwrap().state().crop();
    assert_eq!(crop(&window), Some([DVec3::ZERO, DVec3::ONE]));
    let at = window.get_by_label("crop box: x to").rect().center();
    let across = window.get_by_label("crop box: x from").rect().center() - at;
    let to = at + 0.4 * across;
    window.event(Event::PointerMoved(at));
    window.run();
    for (pos, pressed) in [(at, true), (to, true), (to, false)] {
        window.event(Event::PointerMoved(pos));
        window.run();
        let button = PointerButton::Primary;
        window.event(Event::PointerButton { pos, button, pressed, modifiers: Modifiers::NONE });
        window.run();
    }
    let [low, high] = crop(&window).unwrap();
    assert!((high.x - 0.6).abs() < 0.02, "{high}");
    assert_eq!((low, high.y, high.z), (DVec3::ZERO, 1.0, 1.0), "the other sides stay");
    window.get_by_label("Undo").click();
    window.run();
    window.get_by_label("Reset crop").click();
    window.run();
    assert_eq!(crop(&window), None, "as the scene has it");
}

#[test]
fn situations_are_kept_renamed_and_forgotten() {
    let mut document = document();
    document.edit(&Edit::Hand(DVec2::new(0.2, 0.1)));
    let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(document));
    window.run();
    let names = |window: &Harness<'_, App>| -> Vec<String> {
        let document = window.state().document.as_ref().unwrap();
        document.state().scene.dial.situations.iter().map(|situation| situation.name.clone()).collect()
    };
    let type_name = |window: &mut Harness<'_, App>, name: &str| {
        let field = window.get_by_role(Role::TextInput);
        field.focus();
        window.run();
        window.event(Event::Text(name.to_owned()));
        window.run();
    };
    type_name(&mut window, "dusk");
    window.get_by_label("Keep").click();
    window.run();
    assert_eq!(names(&window), ["evening", "dusk"]);
    type_name(&mut window, "2");
    window.get_by_label("Rename").click();
    window.run();
    assert!(names(&window)[1].contains('2'), "{:?}", names(&window));
    window.get_by_label("Forget").click();
    window.run();
    assert_eq!(names(&window), ["evening"]);
    assert!(matches!(window.state().asked.last(), Some(Action::Edit(Edit::Forget(1)))));
}

/// A press and a release of the first button.
fn click_at(window: &mut Harness<'_, App>, pos: Pos2) {
    window.event(Event::PointerMoved(pos));
    window.run();
    for pressed in [true, false] {
        let button = PointerButton::Primary;
        window.event(Event::PointerButton { pos, button, pressed, modifiers: Modifiers::NONE });
        window.run();
    }
}

/// What a hand types into the field that is called `label`.
fn type_into(window: &mut Harness<'_, App>, label: &str, text: &str) {
    window.get_by_label(label).click();
    window.run();
    for letter in text.chars() {
        window.event(Event::Text(letter.to_string()));
        window.run();
        // As the window does where no button is held.
        window.state_mut().document.as_mut().unwrap().rest();
    }
}

/// Types `text` in place of what is in a field, or in the field at the right of a slider.
fn retype(window: &mut Harness<'_, App>, label: &str, text: &str) {
    let named = window.get_by_label(label).rect();
    let in_line = |place: &Rect| (place.center().y - named.center().y).abs() < 5.0;
    let field = window.get_all_by_role(Role::SpinButton).map(|node| node.rect()).find(in_line).unwrap_or(named);
    click_at(window, field.center());
    window.run();
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.run();
    window.key_press(Key::Delete);
    window.run();
    window.event(Event::Text(text.to_owned()));
    window.run();
    window.key_press(Key::Enter);
    window.run();
}

#[test]
fn the_bar_of_the_panels_lies_over_no_control() {
    let document = document();
    let statistics = document.opened().volume.statistics().unwrap();
    let mut window = wide(document.with_statistics(statistics));
    window.run();
    let solo = window.get_all_by_label("solo").next().unwrap().rect();
    click_at(&mut window, Pos2::new(solo.right() - 1.0, solo.center().y));
    assert_eq!(window.state().asked.last(), Some(&Action::Edit(Edit::Solo(Some(0)))));
    // What is wider than the panel would push the bar out of sight: of its 300 points, margins, the panels' indent and the bar
    // leave 255.
    let left = window.get_by_label("light dial").rect().left();
    for label in ["light dial", "10° (1964)", "Top", "Forget", "remove interval 0", "Measure the curve"] {
        let control = window.get_by_label(label).rect();
        assert!(control.right() <= left + 256.0, "{label}: {control:?} from {left}");
    }
}

#[test]
fn a_typed_number_holds_once_enter_is_pressed_and_is_one_step_back() {
    let mut window = with_histogram();
    window.run();
    let before = intervals(&window);
    type_into(&mut window, "interval 0: to", "85");
    assert_eq!(intervals(&window), before, "not yet");
    window.key_press(Key::Enter);
    window.run();
    assert_eq!(intervals(&window)[0], Interval { range: [before[0].range[0], 85.0], ..before[0] });
    window.get_by_label("Undo").click();
    window.run();
    assert_eq!(intervals(&window), before);
}

#[test]
fn a_number_that_no_hand_may_reach_stays_as_the_scene_has_it() {
    // A step that no field goes down to, and more exposure than its slider has.
    let text = format!("{SCENE}{DIAL}[accuracy]\nstep = 0.001\n[display]\nexposure = 1000\n");
    let scene = scene::parse("test", &text, Path::new(""), &SceneOptions::default(), &Quiet).unwrap();
    let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(Document::new(scene)));
    window.run();
    assert!(window.state().asked.is_empty(), "{:?}", window.state().asked);
    assert!(window.state().document.as_ref().unwrap().is_saved());
}

#[test]
fn a_field_that_is_left_as_it_was_changes_nothing_though_it_shows_fewer_digits() {
    let mut document = document();
    let stated = Interval::of(&document.state().scene.transfer.terms[0]).unwrap();
    document.edit(&Edit::Interval(0, Interval { opacity: 0.123_456_7, ..stated }));
    let mut window = App::open(Vec2::new(1280.0, 2000.0), Some(document));
    window.run();
    type_into(&mut window, "interval 0: opacity", "");
    window.key_press(Key::Enter);
    window.run();
    assert!(window.state().asked.is_empty(), "{:?}", window.state().asked);
}

#[test]
fn an_end_of_an_interval_that_is_typed_past_the_other_takes_it_along() {
    for (end, typed) in [("from", 300.0), ("to", -20.0)] {
        let mut window = with_histogram();
        window.run();
        let before = intervals(&window)[0];
        type_into(&mut window, &format!("interval 0: {end}"), &typed.to_string());
        window.key_press(Key::Enter);
        window.run();
        assert_eq!(intervals(&window)[0], Interval { range: [typed; 2], ..before }, "{end}");
        assert!(is_painted(&window, "along: no interval ends before it begins"), "{end}: and says so");
    }
}

#[test]
fn what_is_typed_and_is_no_number_changes_nothing_and_says_so() {
    for text in ["thick", "0,5", "inf", "1e999", ""] {
        for label in ["interval 0: opacity", "day: strength"] {
            let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(document()));
            window.run();
            retype(&mut window, label, text);
            assert!(window.state().asked.is_empty(), "{label} {text}: {:?}", window.state().asked);
            assert!(is_painted(&window, &format!("“{text}” is no number")), "{label} {text}");
        }
    }
}

#[test]
fn what_is_typed_and_is_too_much_says_what_became_of_it() {
    for (typed, told, opacity) in [("2", "2 is more than is possible here: it became 1.", 1.0), ("0.5", "", 0.5)] {
        let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(document()));
        window.run();
        let before = intervals(&window)[0];
        type_into(&mut window, "interval 0: opacity", typed);
        window.key_press(Key::Enter);
        window.run();
        assert_eq!(intervals(&window)[0], Interval { opacity, ..before });
        assert_eq!(is_painted(&window, "than is possible here"), !told.is_empty(), "{typed}");
        assert!(is_painted(&window, told), "{typed}");
    }
}

/// Types `text` in place of what is in a field, without an end to it.
fn type_unfinished(window: &mut Harness<'_, App>, label: &str, text: &str) {
    window.get_by_label(label).click();
    window.run();
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.run();
    window.event(Event::Text(text.to_owned()));
    window.run();
}

#[test]
fn escape_leaves_a_number_as_it_was() {
    for label in ["master", "interval 0: opacity", "crop x: to", "tour: seconds"] {
        let mut document = document();
        document.edit(&Edit::Crop(Some([DVec3::ZERO, DVec3::splat(0.75)])));
        let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(document));
        window.run();
        type_unfinished(&mut window, label, "0.5");
        window.key_press(Key::Escape);
        window.run();
        window.run();
        assert!(window.state().asked.is_empty(), "{label}: {:?}", window.state().asked);
        assert!(!is_painted(&window, "0.5"), "{label}");
        // The field is none the worse for it.
        type_unfinished(&mut window, "master", "0.25");
        window.key_press(Key::Enter);
        window.run();
        assert_eq!(window.state().asked.last(), Some(&Action::Edit(Edit::Master(0.25))), "{label}");
    }
}

#[test]
fn what_is_typed_holds_before_a_key_saves_opens_or_closes() {
    for (key, action) in [
        (Some(Key::S), Action::SaveSession(None)),
        (Some(Key::P), Action::SavePicture(None)),
        (Some(Key::Q), Action::Close),
        (None, Action::Close),
    ] {
        let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(document()));
        window.run();
        type_unfinished(&mut window, "master", "0.5");
        assert!(window.state().asked.is_empty(), "it is not left yet");
        match key {
            Some(key) => window.key_press_modifiers(Modifiers::COMMAND, key),
            None => window.state_mut().closes = true,
        }
        window.step();
        assert_eq!(window.state().asked, [Action::Edit(Edit::Master(0.5)), action], "{key:?}");
    }
}

#[test]
fn a_step_back_while_a_number_is_typed_takes_what_is_typed_back() {
    let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(document()));
    window.run();
    let master = |window: &Harness<'_, App>| window.state().document.as_ref().unwrap().state().master();
    let before = master(&window);
    type_unfinished(&mut window, "master", "0.5");
    window.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    window.run();
    window.run();
    assert_eq!(master(&window), before);
    assert_eq!(window.state().asked, [Action::Edit(Edit::Master(0.5)), Action::Undo], "nothing comes after it");
}

#[test]
fn what_is_typed_holds_before_what_is_clicked_then() {
    let mut document = document();
    document.edit(&Edit::Hand(DVec2::new(0.2, 0.1)));
    document.edit(&Edit::Keep("dusk".to_owned()));
    document.rest();
    for (button, action) in
        [("Undo", Action::Undo), ("Tour", Action::Tour(Some(8.0))), ("save the tour", Action::SaveTour(None, 50))]
    {
        let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(document.clone()));
        window.run();
        type_unfinished(&mut window, "interval 0: opacity", "0.5");
        assert!(window.state().asked.is_empty());
        window.get_by_label(button).click();
        window.run();
        assert!(
            matches!(&*window.state().asked, [Action::Edit(Edit::Interval(0, _)), last] if *last == action),
            "{button}: {:?}",
            window.state().asked
        );
    }
}

#[test]
fn of_two_handles_on_one_spot_the_nearer_one_is_caught() {
    for (side, near) in [(Side::Front, "−y"), (Side::Back, "+y"), (Side::Left, "−x"), (Side::Top, "+z")] {
        let mut document = document();
        document.edit(&Edit::Camera(Move::Axis(side), 1.5));
        document.edit(&Edit::Crop(Some([DVec3::splat(0.25), DVec3::splat(0.75)])));
        let mut window = wide(document);
        window.run();
        let [from, to] = ["from", "to"].map(|end| format!("crop box: {} {end}", near.trim_start_matches(['−', '+'])));
        let (end, other) = if near.starts_with('−') { (from, to) } else { (to, from) };
        let [at, behind] = [&end, &other].map(|label| window.get_by_label(label).rect().center());
        assert!(at.distance(behind) < 1.0, "{near}: both are on one spot");
        window.event(Event::PointerMoved(at));
        window.run_steps(60);
        let told = format!(
            "faces you: turn the camera to drag it, or type its number: {}",
            end.trim_start_matches("crop box: ")
        );
        assert!(is_painted(&window, &told), "{told}");
    }
}

#[test]
fn a_slider_that_is_typed_below_nothing_says_that_it_became_nothing() {
    for (typed, told, weight) in [("-1", "-1 is less than is possible here: it became 0.", 0.0), ("5", "", 5.0)] {
        let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(document()));
        window.run();
        retype(&mut window, "Exposure", typed);
        let display = &window.state().document.as_ref().unwrap().state().scene.display;
        assert!((display.exposure - weight).abs() < 1e-9, "{typed}: {}", display.exposure);
        assert_eq!(is_painted(&window, "than is possible here"), !told.is_empty(), "{typed}");
        assert!(is_painted(&window, told), "{typed}");
    }
}

#[test]
fn a_side_of_the_crop_box_that_is_typed_past_the_other_stops_there_and_says_so() {
    let mut document = document();
    document.edit(&Edit::Crop(Some([DVec3::splat(0.25), DVec3::splat(0.75)])));
    let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(document));
    window.run();
    type_into(&mut window, "crop x: to", "0.1");
    window.key_press(Key::Enter);
    window.run();
    let [low, high] = window.state().document.as_ref().unwrap().state().crop().unwrap();
    assert!((low.x - 0.25).abs() < 1e-9 && (high.x - 0.25).abs() < 2e-3, "{low} {high}");
    assert!(is_painted(&window, "It stops at “from”, which is 0.2500"));
}

#[test]
fn a_click_that_closes_a_popup_looks_at_no_pixel() {
    let mut window = wide(document());
    window.run();
    let picture = window.get_by_label("picture").rect();
    window.get_by_label("File").click();
    window.run();
    click_at(&mut window, picture.center());
    assert!(window.state().asked.is_empty(), "{:?}", window.state().asked);
    click_at(&mut window, picture.center() + Vec2::new(20.0, 0.0));
    assert!(matches!(window.state().asked.last(), Some(Action::Probe(Some(_)))), "{:?}", window.state().asked);
}

#[test]
fn nodes_that_a_session_has_left_out_are_brought_back() {
    let mut document = document();
    document.edit(&Edit::NodeOn(1, false));
    // As it opens again once it was saved.
    let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(Document::new(document.state().scene.clone())));
    window.run();
    window.get_by_label("Reset nodes").click();
    window.run();
    let on = |window: &Harness<'_, App>| {
        let nodes = &window.state().document.as_ref().unwrap().state().scene.dial.nodes;
        nodes.iter().map(|node| node.on).collect::<Vec<_>>()
    };
    assert_eq!(on(&window), [true, true]);
    window.get_by_label("Undo").click();
    window.run();
    assert_eq!(on(&window), [true, false]);
}

#[test]
fn what_colours_the_light_that_passes_is_named() {
    let text = SCENE.replace(
        "[materials.flesh]",
        "[materials.stain]\nreflectance = 0\nabsorption = { 380 = 1, 560 = 1, 580 = 0, 780 = 0 }\n[materials.flesh]",
    );
    let scene = scene::parse("test", &text, Path::new(""), &SceneOptions::default(), &Quiet).unwrap();
    let mut document = Document::new(scene);
    document.edit(&Edit::AddInterval(Interval {
        material: document.state().scene.materials.iter().position(|material| material.name == "stain").unwrap(),
        range: [-1e6, 1e6],
        ramp: 0.0,
        opacity: 0.0,
        absorption: 0.05,
    }));
    let mut window = wide(document.clone());
    let probe = probed_of(&document);
    assert!(probe.absorbed.iter().sum::<f64>() > 0.1, "{:?}", probe.absorbed);
    window.state_mut().probe = Some((DVec2::splat(0.5), Some(probe)));
    window.run();
    assert!(window.query_by_label("What colours its light").is_some());
    // There, and in the legend of the ray.
    let named = window.query_all_by_label("stain").filter(|node| node.rect().left() > 300.0).count();
    assert_eq!(named, 2);
}

#[test]
fn a_picture_that_nothing_of_the_volume_is_seen_in_says_why_and_what_to_do() {
    let mut thin = document();
    thin.edit(&Edit::Camera(Move::Axis(Side::Front), 1.5));
    thin.edit(&Edit::Crop(Some([DVec3::new(0.0, 0.0, 0.5), DVec3::new(1.0, 1.0, 0.501)])));
    let mut window = wide(thin);
    window.run();
    assert!(window.query_by_label_contains("a thin sheet, seen from its edge").is_some());
    window.get_by_label("Look at its face").click();
    window.run();
    window.run();
    assert!(window.query_by_label_contains("seen from its edge").is_none(), "{:?}", window.state().asked);
    assert!(window.query_by_label_contains("thinner than a step of the rays").is_some());
    window.get_by_label("Show all that way").click();
    window.run();
    assert!(window.query_by_label_contains("thinner than a step").is_none(), "{:?}", window.state().asked);
    // A slab that rays do see, however few voxels it has.
    let mut slab = document();
    slab.edit(&Edit::Accuracy(Accuracy { step_length: 0.02, ..slab.state().scene.accuracy.clone() }));
    slab.edit(&Edit::Crop(Some([DVec3::new(0.0, 0.0, 0.5), DVec3::new(1.0, 1.0, 0.52)])));
    let mut window = wide(slab);
    window.run();
    assert!(window.query_by_label_contains("thinner than a step").is_none());
    let mut beside = document();
    beside.edit(&Edit::Camera(Move::Pan { right: 50.0, up: 0.0 }, 1.5));
    let mut window = wide(beside);
    window.run();
    window.get_by_label("Reset the camera").click();
    window.run();
    window.run();
    assert!(window.query_by_label("Reset the camera").is_none());
    assert!(wide(document()).query_by_label("Reset the camera").is_none(), "nothing is said of what is seen");
}

#[test]
fn a_window_over_a_picture_that_was_small_goes_back_to_where_it_was() {
    let mut window = wide(document());
    window.state_mut().design = true;
    window.state_mut().probe = Some((DVec2::splat(0.5), Some(probed())));
    window.run();
    let title = |window: &Harness<'_, App>, name: &str| window.get_by_role_and_label(Role::Window, name).rect().min;
    for name in ["Probe", "Palette"] {
        let (small, large) = (Vec2::new(640.0, 480.0), Vec2::new(1280.0, 720.0));
        let before = title(&window, name);
        for size in [small, large] {
            window.set_size(size);
            window.run();
            window.run();
        }
        assert_eq!(title(&window, name), before, "{name}");
        let at = before + Vec2::new(40.0, 10.0);
        drag_along(&mut window, &[at, at + Vec2::new(30.0, 40.0), at + Vec2::new(60.0, 90.0)]);
        window.run();
        let put = title(&window, name);
        assert_ne!(put, before, "{name}");
        for size in [small, large] {
            window.set_size(size);
            window.run();
            window.run();
        }
        assert_eq!(title(&window, name), put, "{name}: where a hand has put it");
    }
}

#[test]
fn a_tour_takes_as_long_and_saves_as_many_pictures_as_somebody_says() {
    let mut document = document();
    document.edit(&Edit::Hand(DVec2::new(0.2, 0.1)));
    document.edit(&Edit::Keep("dusk".to_owned()));
    let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(document));
    window.run();
    let press = |window: &mut Harness<'_, App>, button: &str| {
        window.get_by_label(button).click();
        window.run();
        window.state().asked.last().cloned()
    };
    assert_eq!(press(&mut window, "Tour"), Some(Action::Tour(Some(8.0))), "as usual");
    assert_eq!(press(&mut window, "save the tour"), Some(Action::SaveTour(None, 50)), "as usual");
    for (field, typed) in [("tour: seconds", "2.5"), ("tour: pictures", "1")] {
        type_into(&mut window, field, typed);
        window.key_press(Key::Enter);
        window.run();
    }
    assert!(is_painted(&window, "1 is less than is possible here: it became 2."), "both ends of the way");
    assert_eq!(press(&mut window, "Tour"), Some(Action::Tour(Some(2.5))));
    assert_eq!(press(&mut window, "save the tour"), Some(Action::SaveTour(None, 2)));
}

#[test]
fn a_tour_that_is_saved_says_how_far_it_is_and_can_be_given_up() {
    let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(document()));
    window.state_mut().tour = Some(Tour::Saving { path: "tour.png".into(), frames: 50, saved: 12, size: None });
    window.run();
    assert!(window.query_by_label_contains("12 of 50 pictures").is_some());
    assert!(window.state().place.contains_rect(window.get_by_label("Cancel").rect()));
    window.get_by_label("Cancel").click();
    window.run();
    assert_eq!(window.state().asked.last(), Some(&Action::Tour(None)));
}

#[test]
fn a_situation_on_a_node_is_that_light_alone_wherever_the_node_goes() {
    let mut document = document();
    let here = document.state().scene.dial.nodes[1].place;
    assert_eq!(document.state().scene.dial.situations[0].hand, here);
    for edit in [Edit::NodePlace(1, DVec2::new(0.3, 0.2)), Edit::Polygon, Edit::NodePlace(0, here), Edit::ResetDial] {
        document.edit(&edit);
        document.edit(&Edit::Situation(0));
        assert_eq!(light_names(&document.state().mix()), ["lamp"], "{edit:?}");
        let now = document.state().scene.dial.nodes[1].place;
        assert_eq!(document.state().scene.dial.situations[0].hand, now, "{edit:?}");
    }
    // One that is left out for now goes along, too, and what is shown stays it, wherever the other node is.
    document.edit(&Edit::NodePlace(0, DVec2::new(0.7, 0.1)));
    assert_eq!(document.situation(), Some(0));
    document.edit(&Edit::NodeOn(1, false));
    for edit in [Edit::NodePlace(1, DVec2::new(0.3, 0.2)), Edit::Polygon, Edit::ResetDial] {
        document.edit(&edit);
        let dial = &document.state().scene.dial;
        assert_eq!(dial.situations[0].hand, dial.nodes[1].place, "{edit:?}");
    }
}

#[test]
fn the_dial_holds_the_hand_of_every_situation_and_stays_while_nodes_move_within_it() {
    let mut document = document();
    let rect = Rect::from_min_size(Pos2::ZERO, Vec2::new(255.0, 210.0));
    let before = ui::node_places(&document, rect);
    document.edit(&Edit::NodePlace(0, DVec2::new(0.0, 0.2)));
    assert_eq!(ui::node_places(&document, rect)[1], before[1], "the other node stays");
    // Nothing is far away where the hand is far away.
    document.edit(&Edit::Hand(DVec2::new(1e6, 0.0)));
    let far = ui::node_places(&document, rect);
    assert!(far[0].distance(far[1]) > 10.0, "{far:?}");
    let mut window = App::open(Vec2::new(1280.0, 720.0), Some(document));
    window.run();
    let dial = window.get_by_label("light dial").rect();
    let outside = dial.center() + Vec2::new(0.0, 300.0);
    drag_along(&mut window, &[dial.center(), dial.center() + Vec2::new(0.0, 80.0), outside]);
    let state = window.state().document.as_ref().unwrap().state();
    assert!(state.light.hand.y > -2.0, "a hand stays in the dial: {}", state.light.hand);
}

#[test]
fn a_hand_on_a_node_goes_back_with_it() {
    for edit in [Edit::ResetDial, Edit::Polygon] {
        let mut document = document();
        document.edit(&Edit::NodePlace(1, DVec2::new(0.4, 0.2)));
        document.edit(&Edit::HandOnNode(1));
        document.edit(&edit);
        assert_eq!(light_names(&document.state().mix()), ["lamp"], "{edit:?}");
    }
}

#[test]
fn enter_keeps_a_situation_and_moved_nodes_are_told_of_where_it_lies_between_them() {
    let mut document = document();
    document.edit(&Edit::Hand(DVec2::new(0.1, 0.3)));
    let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(document));
    window.run();
    window.get_by_role(Role::TextInput).focus();
    window.run();
    window.event(Event::Text("noon".to_owned()));
    window.run();
    window.key_press(Key::Enter);
    window.run();
    let names = |window: &Harness<'_, App>| -> Vec<String> {
        let dial = &window.state().document.as_ref().unwrap().state().scene.dial;
        dial.situations.iter().map(|situation| situation.name.clone()).collect()
    };
    assert_eq!(names(&window), ["evening", "noon"]);
    assert!(window.query_by_label_contains("Nodes were moved").is_none());
    window.state_mut().document.as_mut().unwrap().edit(&Edit::NodePlace(0, DVec2::new(0.5, 0.5)));
    window.run();
    assert!(window.query_by_label_contains("Nodes were moved").is_some());
}

#[test]
fn nodes_are_put_on_a_regular_polygon() {
    let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(document()));
    window.state_mut().document.as_mut().unwrap().edit(&Edit::NodePlace(0, DVec2::new(0.3, 0.2)));
    window.run();
    window.get_by_label("Polygon").click();
    window.run();
    let nodes = &window.state().document.as_ref().unwrap().state().scene.dial.nodes;
    assert!((nodes[0].place + nodes[1].place).length() < 1e-9 && (nodes[0].place.length() - 1.0).abs() < 1e-9);
}

#[test]
fn values_of_three_hundred_digits_leave_the_panels_as_they_are() {
    let width = |scale: f64| {
        let mut document = document();
        let stated = Interval::of(&document.state().scene.transfer.terms[0]).unwrap();
        document.edit(&Edit::Interval(0, Interval { range: [1.234_567_89 * scale, 2.0 * scale], ..stated }));
        let mut statistics = document.opened().volume.statistics().unwrap();
        (statistics.min, statistics.max) = (-3.0 * scale, 3.0 * scale);
        let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(document.with_statistics(statistics)));
        window.run();
        let left = window.state().place.left();
        // A field that is left as it was changes nothing, though it shows few digits.
        type_into(&mut window, "interval 0: from", "");
        window.key_press(Key::Enter);
        window.run();
        assert!(window.state().asked.is_empty(), "{:?}", window.state().asked);
        left
    };
    for scale in [1e300, 1e12, 1e-12, 1e-300] {
        assert!((width(scale) - width(10.0)).abs() < 0.5, "{scale}");
    }
}

#[test]
fn values_that_differ_in_their_last_digits_alone_can_be_typed() {
    for (low, span, typed) in [(1.0, 1e-5, "1.000004"), (1e9, 1000.0, "1000000123"), (-3e-20, 1e-21, "-2.95e-20")] {
        let mut document = document();
        let stated = Interval::of(&document.state().scene.transfer.terms[0]).unwrap();
        let interval = Interval { range: [low + 0.3 * span, low + 0.6 * span], ramp: 0.0, ..stated };
        document.edit(&Edit::Interval(0, interval));
        let mut statistics = document.opened().volume.statistics().unwrap();
        (statistics.min, statistics.max) = (low, low + span);
        let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(document.with_statistics(statistics)));
        window.run();
        type_into(&mut window, "interval 0: from", typed);
        window.key_press(Key::Enter);
        window.run();
        let from = intervals(&window)[0].range[0];
        assert_eq!(from.to_bits(), typed.parse::<f64>().unwrap().to_bits(), "{typed}: {from}");
    }
}

#[test]
fn a_transfer_function_that_shows_no_value_says_so() {
    let mut window = with_histogram();
    window.run();
    assert!(window.query_by_label_contains("Nothing of the volume is shown").is_none());
    let mut document = document();
    let statistics = document.opened().volume.statistics().unwrap();
    for index in [0, 1] {
        let stated = Interval::of(&document.state().scene.transfer.terms[index]).unwrap();
        document.edit(&Edit::Interval(index, Interval { range: [1e4, 2e4], ..stated }));
    }
    let mut window = wide(document.clone().with_statistics(statistics.clone()));
    window.run();
    assert!(window.query_by_label_contains("Nothing of the volume is shown").is_some());
    window.get_all_by_label("Reset transfer").last().unwrap().click();
    window.run();
    window.run();
    assert!(window.query_by_label_contains("Nothing of the volume is shown").is_none());
    // Where it opened so, there is nothing to go back to.
    let mut window = wide(Document::new(document.state().scene.clone()).with_statistics(statistics));
    window.run();
    window.get_by_label("Show all values").click();
    window.run();
    window.run();
    assert!(window.query_by_label_contains("Nothing of the volume is shown").is_none());
}

#[test]
fn a_side_of_the_crop_box_that_faces_the_eye_says_that_it_cannot_be_dragged() {
    let mut document = document();
    document.edit(&Edit::Camera(Move::Axis(Side::Front), 1.5));
    document.edit(&Edit::Camera(Move::Projection, 1.5));
    document.edit(&Edit::Crop(Some([DVec3::splat(0.25), DVec3::splat(0.75)])));
    let mut window = wide(document);
    window.run();
    let handle = window.get_by_label("crop box: y to").rect().center();
    window.event(Event::PointerMoved(handle));
    window.run_steps(60);
    assert!(is_painted(&window, "faces you: turn the camera to drag it"));
    window.event(Event::PointerMoved(window.get_by_label("crop box: x to").rect().center()));
    window.run_steps(60);
    assert!(is_painted(&window, "Drag this side of the box"));
}

#[test]
fn another_volume_of_a_file_is_asked_for_where_there_are_several() {
    for several in [false, true] {
        let mut window = wide(document());
        window.state_mut().several = several;
        file_menu(&mut window, "Another volume of this file");
        window.run();
        assert_eq!(window.state().asked.contains(&Action::Another), several);
    }
}

#[test]
fn another_time_step_is_looked_at_as_the_one_before() {
    let mut before = document();
    before.edit(&Edit::Camera(Move::Orbit { right: 30.0, up: 10.0 }, 1.5));
    before.edit(&Edit::HandOnNode(1));
    before.edit(&Edit::RemoveTerm(0));
    let scene = before.opened().clone();
    assert!(before.lies_as(&scene));
    let after = before.clone().beside(scene.clone(), false);
    assert!(after.state().cost_from(before.state()).is_none(), "also a transfer function that was changed");
    let mut back = after.clone();
    while back.can_undo() {
        back.undo();
    }
    assert!(
        back.is_saved() && !after.is_saved() && back.state().scene.camera == scene.camera,
        "with the same steps back"
    );
    // What nobody has changed is what the other volume opens with, where its values are others.
    let mut other = scene.clone();
    other.transfer.terms.remove(0);
    let untouched = Document::new(scene.clone());
    for (alike, terms) in [(true, &scene.transfer), (false, &other.transfer)] {
        let after = untouched.clone().beside(other.clone(), alike);
        assert!(after.is_saved() && after.state().scene.transfer == *terms, "{alike}");
    }
    let text = SCENE.replace("dims = [32, 30, 18]", "dims = [16, 15, 9]");
    let smaller = scene::parse("test", &text, Path::new(""), &SceneOptions::default(), &Quiet).unwrap();
    assert!(!before.lies_as(&smaller), "another grid is another thing");
}

#[test]
fn an_end_of_an_interval_that_is_dragged_past_the_other_stops_there() {
    for (end, by, other) in [("from", 3000.0, 1), ("to", -3000.0, 0)] {
        let mut window = with_histogram();
        window.run();
        let before = intervals(&window)[0];
        let at = window.get_by_label(&format!("interval 0: {end}")).rect().center();
        drag_along(&mut window, &[at, at + Vec2::new(by / 2.0, 0.0), at + Vec2::new(by, 0.0)]);
        assert_eq!(intervals(&window)[0], Interval { range: [before.range[other]; 2], ..before }, "{end}");
    }
}

#[test]
fn plus_goes_nearer_with_shift_and_without() {
    let mut window = wide(document());
    window.run();
    for (modifiers, key) in
        [(Modifiers::SHIFT, Key::Plus), (Modifiers::SHIFT, Key::Equals), (Modifiers::NONE, Key::Equals)]
    {
        window.state_mut().asked.clear();
        window.key_press_modifiers(modifiers, key);
        window.run();
        let asked = &window.state().asked;
        assert!(matches!(asked[..], [Action::Edit(Edit::Camera(Move::Dolly(nearer), _))] if nearer > 1.0), "{asked:?}");
    }
}

#[test]
fn the_probe_opens_beside_the_pixel_that_was_clicked() {
    for part in [0.05, 0.5, 0.95] {
        let mut window = wide(document());
        window.state_mut().probe = Some((DVec2::new(part, 0.3), Some(probed())));
        window.run();
        window.run();
        let picture = window.get_by_label("picture").rect();
        let at = picture.left() + picture.width() * narrow(part);
        let left = window.get_by_label("Under each light").rect().left();
        let (left, right) = (left - 12.0, left + 300.0);
        assert!(at < left || at > right, "{at} from {left} to {right}");
    }
}

#[expect(clippy::cast_possible_truncation, reason = "parts of a window")]
fn narrow(number: f64) -> f32 {
    number as f32
}

#[test]
fn the_lights_that_are_turned_on_again_shine_on_the_dial_too() {
    let mut document = document();
    for light in 0..2 {
        document.edit(&Edit::NodeOn(light, false));
        document.edit(&Edit::On(light, false));
    }
    document.edit(&Edit::Hand(DVec2::ZERO));
    let mut window = wide(document);
    window.run();
    window.get_by_label("Turn the lights on").click();
    window.run();
    let document = window.state_mut().document.as_mut().unwrap();
    document.edit(&Edit::Hand(DVec2::new(0.1, 0.2)));
    assert!(document.state().is_lit());
}

#[test]
fn a_node_that_is_moved_moves_no_other() {
    let mut window = wide(document());
    window.run();
    let places = |window: &Harness<'_, App>| {
        ["day on the dial", "lamp on the dial"].map(|label| window.get_by_label(label).rect().center())
    };
    let [day, lamp] = places(&window);
    let button = |window: &mut Harness<'_, App>, pos: Pos2, pressed: bool| {
        let (button, modifiers) = (PointerButton::Primary, Modifiers::SHIFT);
        window.event_modifiers(Event::PointerButton { pos, button, pressed, modifiers }, modifiers);
        window.run();
    };
    let to = |window: &mut Harness<'_, App>, place: Pos2| {
        window.event_modifiers(Event::PointerMoved(place), Modifiers::SHIFT);
        window.run();
    };
    to(&mut window, lamp);
    button(&mut window, lamp, true);
    let end = lamp + Vec2::new(40.0, -60.0);
    to(&mut window, lamp + Vec2::new(20.0, -30.0));
    to(&mut window, end);
    window.run();
    let [day_now, lamp_now] = places(&window);
    assert!((day_now - day).length() < 0.5, "{day_now:?} was at {day:?}");
    assert!((lamp_now - end).length() < 0.5, "{lamp_now:?} is to be under the hand at {end:?}");
    button(&mut window, end, false);
}

#[test]
fn who_decides_is_said_in_a_line_and_the_panels_below_stay_where_they_are() {
    let mut document = document();
    document.edit(&Edit::Mix(Mixing::Sliders));
    let top = |document: Document, line: &str| {
        let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(document));
        window.run();
        assert!(window.query_by_label(line).is_some(), "{line}");
        window.get_by_label("Transfer function").rect().top()
    };
    let by_sliders = top(document.clone(), "The sliders mix: click the dial to let it.");
    document.edit(&Edit::Hand(DVec2::ZERO));
    let by_dial = top(document, "The dial mixes: move a slider to take over.");
    assert!((by_sliders - by_dial).abs() < 0.5, "{by_sliders} and {by_dial}");
}

#[test]
fn the_transfer_function_comes_right_after_the_lights_and_the_camera_says_which_rays_it_has() {
    let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(document()));
    window.run();
    let panels = ["Lights", "Light dial", "Light situations", "Transfer function", "Display", "Camera", "Accuracy"];
    let tops = panels.map(|panel| window.get_all_by_label(panel).next().unwrap().rect().top());
    assert!(tops.is_sorted(), "{tops:?}");
    let is_parallel = |window: &Harness<'_, App>| {
        let document = window.state().document.as_ref().unwrap();
        matches!(document.state().scene.camera.projection, Projection::Orthographic { .. })
    };
    for (choice, parallel) in
        [("Perspective", false), ("Parallel rays", true), ("Parallel rays", true), ("Perspective", false)]
    {
        window.get_by_label(choice).click();
        window.run();
        assert_eq!(is_parallel(&window), parallel, "{choice}");
    }
}

#[test]
fn a_name_that_is_taken_is_said_to_be_replaced() {
    let mut document = document();
    document.edit(&Edit::Hand(DVec2::new(0.2, 0.1)));
    let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(document));
    window.run();
    window.get_by_role(Role::TextInput).focus();
    window.run();
    window.event(Event::Text("evening".to_owned()));
    window.run();
    window.get_by_label("Replace").click();
    window.run();
    let document = window.state().document.as_ref().unwrap();
    let situations = &document.state().scene.dial.situations;
    assert_eq!((situations.len(), situations[0].hand), (1, DVec2::new(0.2, 0.1)));
}

#[test]
fn an_empty_window_offers_the_scene_of_the_program() {
    let mut window = App::open(Vec2::new(1280.0, 720.0), None);
    window.run();
    assert!(
        window.query_by_label_contains("nothing is open  |").is_some()
            && window.query_by_label_contains("preparing").is_none()
    );
    window.get_by_label("Open the built-in scene").click();
    window.run();
    assert_eq!(window.state().asked, [Action::Open(Box::default())]);
}

#[test]
fn what_an_interval_absorbs_is_a_number_where_its_material_absorbs() {
    let text = SCENE.replace(
        "[materials.flesh]",
        "[materials.flesh]\nabsorption = { gaussian = [{ centre = 527, sigma = 17, height = 1.0 }], base = 0.02 }",
    );
    assert_ne!(text, SCENE);
    let opened = scene::parse("test", &text, Path::new(""), &SceneOptions::default(), &Quiet).unwrap();
    let shown = opened.transfer.terms.iter().map(|term| Interval::of(term).unwrap().material);
    let of_flesh = shown.map(|material| opened.materials[material].name == "flesh").collect::<Vec<_>>();
    let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(Document::new(opened)));
    window.run();
    for (index, absorbs) in of_flesh.iter().enumerate() {
        let label = format!("interval {index}: absorption");
        let field = window.query_by_label(&label);
        assert_eq!(field.is_some(), *absorbs, "{index}");
    }
    let index = of_flesh.iter().position(|it| *it).unwrap();
    type_into(&mut window, &format!("interval {index}: absorption"), "0.75");
    window.key_press(Key::Enter);
    window.run();
    assert!((intervals(&window)[index].absorption - 0.75).abs() < 1e-12, "{:?}", intervals(&window));
    assert!(window.query_all_by_label("absorbs").count() >= 2, "beside the interval, and in the spectra");
}

#[test]
fn what_the_probe_says_of_materials_are_parts_of_a_whole() {
    let probe = probed();
    let seen = probe.seen.iter().sum::<f64>() + probe.transmittance;
    assert!((seen - 1.0).abs() < 0.01, "the pixel: {seen}");
    let light = probe.shares.iter().map(|share| share.light).sum::<f64>();
    assert!((light - 1.0).abs() < 1e-9, "its light: {light}");
    let mut window = wide(document());
    window.state_mut().probe = Some((DVec2::splat(0.5), Some(probe)));
    window.run();
    for label in ["of the pixel", "blue: of even light, as a share"] {
        assert!(window.query_by_label(label).is_some(), "{label}");
    }
    assert!(window.query_all_by_label("of its light").count() >= 1);
}

#[test]
fn a_way_out_of_what_cannot_be_had_is_a_button_that_changes_it_and_solves_again() {
    let mut document = document();
    document.edit(&offered(&document));
    document.rest();
    let mut window = wide(document);
    window.state_mut().design = true;
    let open = WayOut::Open { light: "lamp".to_owned() };
    let gone = WayOut::Open { light: "moon".to_owned() };
    window.state_mut().conflicts = vec![Conflict {
        cells: vec![(0, 0)],
        part: vec![(0, 0)],
        least: 1.0,
        reached: 1.0,
        reason: "flesh cannot be black".to_owned(),
        ways_out: vec![open, gone],
    }];
    window.run();
    assert!(window.query_by_label("Not all of this can be had: flesh cannot be black.").is_some());
    assert!(window.query_by_label("Leave the light moon open").is_none(), "there is no such light any more");
    window.get_by_label("Leave the light lamp open").click_accesskit();
    window.run();
    let asked = &window.state().asked;
    let step = Step::Open(design::Side::Light, 1, true);
    assert_eq!(
        asked[..],
        [Action::Solve(Some(step))],
        "both or none: a step back undoes what it changes and what is solved"
    );
}

/// Moves the pointer to each of these places in turn, the first button held from the first to the last.
fn drag_along(window: &mut Harness<'_, App>, places: &[Pos2]) {
    let press = |pos, pressed| {
        let button = PointerButton::Primary;
        Event::PointerButton { pos, button, pressed, modifiers: Modifiers::NONE }
    };
    let (first, last) = (places[0], places[places.len() - 1]);
    let moves = places.iter().map(|&place| Event::PointerMoved(place));
    for event in [Event::PointerMoved(first), press(first, true)].into_iter().chain(moves).chain([press(last, false)]) {
        window.event(event);
        window.run();
    }
    // As the window does where no button is held.
    window.state_mut().document.as_mut().unwrap().rest();
}

#[test]
fn the_body_of_an_interval_is_dragged_with_both_its_ends_and_back_by_one_step() {
    let mut window = with_histogram();
    window.run();
    let before = intervals(&window);
    let body = window.get_by_label("interval 0: Body").rect();
    let by = |x: f32| body.center() + Vec2::new(x, 3.0);
    drag_along(&mut window, &[by(0.0), by(0.3), by(0.6), by(-20.0), by(30.0)]);
    let moved = intervals(&window);
    let [from, to] = [0, 1].map(|end| moved[0].range[end] - before[0].range[end]);
    assert!(from > 10.0 && (from - to).abs() < 1e-9, "{moved:?} from {before:?}");
    assert_eq!(moved[0], Interval { range: moved[0].range, ..before[0] }, "as steep and as opaque as it was");
    assert_eq!(moved[1], before[1]);
    window.get_by_label("Undo").click();
    window.run();
    assert_eq!(intervals(&window), before);
}

/// Whether a text that contains this is painted.
fn is_painted(window: &Harness<'_, App>, text: &str) -> bool {
    window.output().shapes.iter().any(|clipped| match &clipped.shape {
        egui::Shape::Text(shape) => shape.galley.text().contains(text),
        _ => false,
    })
}

#[test]
fn no_tooltip_is_seen_while_a_button_is_held_nor_until_the_pointer_goes_on() {
    let mut window = with_histogram();
    window.run();
    let dial = window.get_by_label("light dial").rect().center();
    window.event(Event::PointerMoved(dial));
    // Longer than a tooltip waits.
    window.run_steps(60);
    let help = "Drag the hand between the lights";
    assert!(is_painted(&window, help), "a pointer that rests is told");
    let button = PointerButton::Primary;
    for place in [dial, dial + Vec2::new(3.0, 2.0), dial + Vec2::new(30.0, 20.0)] {
        window.event(Event::PointerButton { pos: place, button, pressed: true, modifiers: Modifiers::NONE });
        window.event(Event::PointerMoved(place));
        window.run_steps(60);
        assert!(!is_painted(&window, help), "held at {place}");
    }
    let last = dial + Vec2::new(30.0, 20.0);
    window.event(Event::PointerButton { pos: last, button, pressed: false, modifiers: Modifiers::NONE });
    window.run_steps(60);
    assert!(!is_painted(&window, help), "nor where something was moved to just now");
    window.event(Event::PointerMoved(last - Vec2::new(20.0, 0.0)));
    window.run_steps(60);
    assert!(is_painted(&window, help), "who goes on is told again");
}

#[test]
fn lights_that_are_turned_on_again_where_the_dial_mixes_leave_the_dial_and_the_sliders_as_they_are() {
    let mut document = document();
    document.edit(&Edit::Weight(0, 0.3));
    document.edit(&Edit::On(1, false));
    document.edit(&Edit::Hand(DVec2::new(0.1, 0.2)));
    let light = document.state().light.clone();
    for node in 0..2 {
        document.edit(&Edit::NodeOn(node, false));
    }
    assert!(!document.state().is_lit());
    let mut window = wide(document);
    window.run();
    window.get_by_label("Turn the lights on").click();
    window.run();
    let state = window.state().document.as_ref().unwrap().state();
    assert!(state.is_lit());
    assert_eq!(state.light, light, "who decides, the hand and the sliders");
}

#[test]
fn what_ends_where_it_began_is_no_step_back() {
    let mut document = document();
    let places = [0.2, 0.5, 0.2].map(|x| Edit::Hand(DVec2::new(x, 0.1)));
    document.edit(&places[0]);
    document.rest();
    document.edit(&places[1]);
    document.edit(&places[2]);
    document.rest();
    assert!(document.undo().is_some() && !document.can_undo());
}

#[test]
fn after_a_tour_the_situation_that_the_hand_stands_on_is_the_one_that_is_shown() {
    let mut document = document();
    document.edit(&Edit::Hand(DVec2::new(0.2, 0.1)));
    document.edit(&Edit::Keep("dusk".to_owned()));
    document.edit(&Edit::Tour(3, 8));
    assert_eq!(document.state().light.situation, None, "on its way");
    document.edit(&Edit::Tour(8, 8));
    assert_eq!(document.state().light.situation, Some(1), "at its end");
}

#[test]
fn the_names_of_situations_stand_in_their_own_section() {
    let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(document()));
    window.run();
    let top = |label: &str| window.get_by_label(label).rect().top();
    assert!(top("Light situations") < top("evening") && top("evening") < top("Transfer function"));
}

#[test]
fn a_handle_of_the_crop_box_is_caught_within_ten_points_and_says_which_side_it_is() {
    let mut document = document();
    document.edit(&Edit::Camera(Move::Axis(Side::Front), 1.5));
    document.edit(&Edit::Crop(Some([DVec3::splat(0.25), DVec3::splat(0.75)])));
    let mut window = App::open(Vec2::new(1280.0, 720.0), Some(document));
    window.run();
    let handle = window.get_by_label("crop box: x to").rect();
    assert!(handle.width() >= 20.0 && handle.height() >= 20.0, "{handle:?}");
    window.event(Event::PointerMoved(handle.center() + Vec2::new(9.0, -9.0)));
    window.run_steps(60);
    assert!(is_painted(&window, "x to 0.75"));
}

#[test]
fn the_swatch_of_a_material_that_absorbs_is_the_light_seen_through_it() {
    let shapes = [
        "[materials.flesh]\nabsorption = { 380 = 0, 560 = 0, 580 = 1, 780 = 1 }",
        "[materials.flesh]\nabsorption = 0.5",
        "[materials.clear]\nreflectance = 0\nabsorption = { 380 = 0, 560 = 0, 580 = 1, 780 = 1 }\n[materials.flesh]",
    ];
    for (shape, of) in shapes.into_iter().zip(["flesh", "flesh", "clear"]) {
        let text =
            SCENE.replace("[materials.flesh]", shape).replace("material = \"flesh\"", &format!("material = \"{of}\""));
        let opened = scene::parse("test", &text, Path::new(""), &SceneOptions::default(), &Quiet).unwrap();
        let material = opened.materials.iter().find(|material| material.name == of).unwrap();
        let passes = material.absorption.as_ref().unwrap().spectrum().samples().map(|depth| {
            let is_flat = shape.contains("0.5");
            if is_flat { 1.0 } else { 0.1_f64.powf(depth) }
        });
        let reflects = if of == "clear" { Spectrum::constant(1.0) } else { material.reflectance.spectrum().clone() };
        let seen = &Spectrum::from_samples(passes) * &reflects;
        let colour: DVec3 = opened
            .lights
            .iter()
            .map(|light| {
                let sent = light.spectrum.spectrum() * &seen;
                let xyz = OBSERVER.each_ref().map(|matching| matching.dot(&sent));
                light.intensity * DVec3::from_array(linear_srgb_from_xyz(Xyz(xyz)).0)
            })
            .sum();
        let code = display_code(LinearSrgb(colour.to_array()));
        let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(Document::new(opened)));
        window.run();
        assert!(window.query_all_by_label(&code).next().is_some(), "{shape}: there is no swatch of {code}");
    }
}

#[test]
fn whose_brightness_is_kept_is_said_beside_the_switch() {
    let mut document = document();
    for (edit, whose) in [(Edit::Weight(0, 0.5), "by the sliders"), (Edit::Hand(DVec2::ZERO), "by the dial")] {
        document.edit(&edit);
        let mut window = wide(document.clone());
        window.run();
        assert!(window.query_by_label_contains(whose).is_some(), "{whose}");
    }
}

#[test]
fn what_was_done_leaves_by_itself_and_what_went_wrong_stays() {
    let mut window = wide(document());
    let told = |text: &str| Notice::done(text.to_owned());
    window.state_mut().notices = vec![told("The picture is there."), Notice::wrong("It failed.".to_owned())];
    window.run();
    let due = window.output().viewport_output[&egui::ViewportId::ROOT].repaint_delay;
    assert!(due > Duration::from_secs(4) && due <= Duration::from_secs(8), "a window at rest wakes for it: {due:?}");
    let over = |text: &str| Notice { until: Some(Instant::now()), ..told(text) };
    window.state_mut().notices.extend([over("The session is there."), over("Another is there.")]);
    window.run();
    let left: Vec<&str> = window.state().notices.iter().map(|notice| notice.text.as_str()).collect();
    assert_eq!(left, ["The picture is there.", "It failed."]);
}

#[test]
fn a_way_out_and_the_spectra_that_are_solved_by_it_are_one_step_back() {
    let mut document = document();
    document.edit(&offered(&document));
    document.rest();
    let is_open = |document: &Document| document.state().palette.as_ref().unwrap().lights[1].spectrum.is_none();
    let lamp = |document: &Document| document.state().scene.lights[1].spectrum.clone();
    let before = lamp(&document);
    let step = Some(Step::Open(design::Side::Light, 1, true));
    let found = Spectra::standard(&document.state().scene, design::Side::Light, "lamp", "FL11").unwrap();
    document.edit(&Edit::Spectra(Arc::new(Spectra { step, ..found })));
    assert!(is_open(&document) && lamp(&document) != before);
    document.undo();
    assert!(!is_open(&document) && lamp(&document) == before, "both");
    document.redo();
    assert!(is_open(&document) && lamp(&document) != before, "both again");
}

/// Opens the menu of files and clicks a line of it.
fn file_menu(window: &mut Harness<'_, App>, line: &str) {
    window.get_by_label("File").click();
    window.run();
    window.get_by_label_contains(line).click();
    window.step();
}

/// Waits until the dialog has read its folder.
fn until_listed(window: &mut Harness<'_, App>) {
    for _ in 0..50 {
        std::thread::sleep(Duration::from_millis(10));
        window.step();
    }
}

fn saved_or_opened(window: &Harness<'_, App>) -> Vec<Action> {
    let is_file = |action: &&Action| {
        matches!(action, Action::SavePicture(_) | Action::SaveSession(_) | Action::Open(_) | Action::Leave(_))
    };
    window.state().asked.iter().filter(is_file).cloned().collect()
}

#[test]
fn a_picture_is_saved_where_the_dialog_says_and_asks_before_it_replaces_one() {
    let mut window = wide(document());
    let path = window.state().folder.path("relume-0001.png");
    file_menu(&mut window, "Save picture as");
    until_listed(&mut window);
    window.key_press(Key::Enter);
    until_listed(&mut window);
    assert_eq!(saved_or_opened(&window), [Action::SavePicture(Some(path.canonicalize().unwrap_or(path.clone())))]);
    std::fs::write(&path, "another picture").unwrap();
    file_menu(&mut window, "Save picture as");
    until_listed(&mut window);
    window.key_press(Key::Enter);
    until_listed(&mut window);
    assert_eq!(saved_or_opened(&window).len(), 1, "a file that is there is asked for");
    window.key_press(Key::Enter);
    until_listed(&mut window);
    assert_eq!(saved_or_opened(&window).len(), 1, "Enter has chosen the name, and answers nothing");
    window.get_by_label_contains("Overwrite").click();
    until_listed(&mut window);
    assert_eq!(saved_or_opened(&window).len(), 2);
    assert!(!window.state().chooser.is_open());
}

#[test]
fn a_name_without_an_extension_gets_that_of_the_file() {
    let mut window = wide(document());
    file_menu(&mut window, "Save session as");
    until_listed(&mut window);
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.run();
    window.event(Event::Text("mine".to_owned()));
    window.run();
    window.key_press(Key::Enter);
    until_listed(&mut window);
    let path = window.state().folder.path("mine.toml");
    assert_eq!(saved_or_opened(&window), [Action::SaveSession(Some(path))]);
}

#[test]
fn escape_leaves_the_dialog_also_from_its_field_and_files_of_other_kinds_are_not_listed() {
    let mut window = wide(document());
    for name in ["earlier.toml", "picture.png"] {
        std::fs::write(window.state().folder.path(name), "").unwrap();
    }
    file_menu(&mut window, "Save session as");
    until_listed(&mut window);
    assert!(window.query_by_label_contains("earlier.toml").is_some());
    assert!(window.query_by_label_contains("picture.png").is_none(), "no session");
    assert!(window.ctx.memory(|memory| memory.focused().is_some()), "the name can be typed at once");
    window.key_press(Key::Escape);
    window.run();
    assert!(!window.state().chooser.is_open());
    assert_eq!(saved_or_opened(&window), []);
}

#[test]
fn a_scene_without_its_volume_is_shown_the_one_that_is_chosen() {
    let mut window = wide(document());
    for name in ["head.mhd", "notes.pdf"] {
        std::fs::write(window.state().folder.path(name), "").unwrap();
    }
    let (scene, volume) = (window.state().folder.path("scene.toml"), window.state().folder.path("head.mhd"));
    let mut source = Source::of(&scene);
    window.state_mut().chooser.ask_volume(source.clone(), (&scene, false));
    window.run();
    until_listed(&mut window);
    assert!(is_painted(&window, "Which volume is scene.toml to show?"));
    window.get_by_label_contains("head.mhd").click();
    window.run();
    window.get_by_label_contains("  Open").click();
    until_listed(&mut window);
    source.options.volume = Some(volume);
    assert_eq!(saved_or_opened(&window), [Action::Leave(Leaving::Open(Box::new(source)))]);
}

#[test]
fn what_can_be_opened_is_listed_and_keys_are_the_dialogs_own() {
    let mut window = wide(document());
    for name in ["head.mhd", "scene.toml", "notes.pdf"] {
        std::fs::write(window.state().folder.path(name), "").unwrap();
    }
    window.key_press_modifiers(Modifiers::COMMAND, Key::O);
    window.run();
    until_listed(&mut window);
    assert!(window.query_by_label_contains("notes.pdf").is_none(), "no volume and no scene");
    window.get_by_label_contains("head.mhd").click();
    window.run();
    window.key_press(Key::ArrowDown);
    window.run();
    window.key_press(Key::P);
    window.run();
    assert!(!window.state().asked.iter().any(|action| matches!(action, Action::Edit(_))), "the camera stays");
    window.get_by_label_contains("head.mhd").click();
    window.run();
    window.get_by_label_contains("  Open").click();
    until_listed(&mut window);
    let path = window.state().folder.path("head.mhd");
    assert_eq!(saved_or_opened(&window), [Action::Open(Box::new(Source::of(&path)))]);
}

/// What is asked about a file.
fn asked(unknown: Unknown) -> Question {
    Question { file: "/data/beat.nrrd".into(), unknown }
}

#[test]
fn a_file_of_several_volumes_is_opened_by_the_one_that_is_chosen() {
    let several = [
        (Several::Times(4), Selection { time: Some(3), ..Selection::default() }),
        (
            Several::Components { count: 4, kind: String::new() },
            Selection { component: Some(3), ..Selection::default() },
        ),
        (
            Several::Arrays(vec!["ct".to_owned(), "pet".to_owned()]),
            Selection { array: Some("pet".to_owned()), ..Selection::default() },
        ),
    ];
    for (there, chosen) in several {
        let mut window = wide(document());
        // What was said before is kept.
        let mut source = Source::of(Path::new("beat.nrrd"));
        source.options.downsample = Some([2; 3]);
        window.state_mut().chooser.ask(source.clone(), asked(Unknown::Which(there.clone())), &Selection::default());
        window.run();
        match there {
            Several::Arrays(_) => window.get_by_label("pet").click(),
            _ => {
                let what = if chosen.time.is_some() { "Time step" } else { "Component" };
                window.get_by_role_and_label(Role::SpinButton, what).focus();
                window.run();
                window.key_press_modifiers(Modifiers::COMMAND, Key::A);
                window.event(Event::Text("3".to_owned()));
                window.run();
                window.key_press(Key::Enter);
            }
        }
        window.run();
        assert_eq!(saved_or_opened(&window), [], "{there} is asked for");
        window.key_press(Key::Enter);
        window.run();
        source.options.selection = chosen;
        assert_eq!(saved_or_opened(&window), [Action::Leave(Leaving::Open(Box::new(source)))], "{there}");
    }
}

#[test]
fn another_of_several_volumes_is_chosen_from_the_one_that_is_shown() {
    let mut window = wide(document());
    let shown = Selection { time: Some(2), ..Selection::default() };
    let source = Source::of(Path::new("beat.nrrd"));
    window.state_mut().chooser.ask(source.clone(), asked(Unknown::Which(Several::Times(4))), &shown);
    window.run();
    window.key_press(Key::Enter);
    window.run();
    let expected = Source { options: SceneOptions { selection: shown, ..SceneOptions::default() }, ..source };
    assert_eq!(saved_or_opened(&window), [Action::Leave(Leaving::Open(Box::new(expected)))]);
}

#[test]
fn a_file_without_a_header_is_opened_as_somebody_says_that_it_lies() {
    let mut window = wide(document());
    let source = Source::of(Path::new("foot.raw"));
    let guess = RawLayout::guessed("foot.raw", 1000).map(Box::new);
    window.state_mut().chooser.ask(
        source.clone(),
        asked(Unknown::Layout { bytes: 1000, guess }),
        &Selection::default(),
    );
    window.run();
    assert!(window.query_by_label_contains("all 1000 bytes").is_some(), "a cube");
    window.get_by_label("Open").click();
    window.run();
    let cube = RawLayout::new([10; 3], VoxelType::U8);
    let mut said = source.clone();
    said.options.raw = Some(cube.clone());
    assert_eq!(saved_or_opened(&window), [Action::Leave(Leaving::Open(Box::new(said)))]);

    // Too few bytes for it are no volume.
    let guess = Some(Box::new(RawLayout { voxel_type: VoxelType::F64, ..cube }));
    window.state_mut().chooser.ask(source, asked(Unknown::Layout { bytes: 1000, guess }), &Selection::default());
    window.run();
    assert!(window.get_by_label("Open").accesskit_node().is_disabled());
    // What was said is not lost by a click beside it, nor by the key that leaves a field.
    for escapes in 0..2 {
        drag_along(&mut window, &[Pos2::new(900.0, 20.0)]);
        assert!(window.state().chooser.is_open(), "after {escapes}");
        if escapes == 0 {
            window.get_by_role_and_label(Role::SpinButton, "bytes to skip").focus();
            window.run();
        }
        window.key_press(Key::Escape);
        window.run();
    }
    assert!(!window.state().chooser.is_open() && saved_or_opened(&window).len() == 1);
}

#[test]
fn the_sides_of_a_patient_are_called_so() {
    for (anatomical, names) in [(false, ["Left", "Front", "Top"]), (true, ["Right", "Anterior", "Superior"])] {
        let mut scene = document().state().scene.clone();
        Arc::make_mut(&mut scene.volume).anatomical = anatomical;
        let mut window = App::open(Vec2::new(1280.0, 2000.0), Some(Document::new(scene)));
        window.run();
        for (name, side) in names.into_iter().zip([Side::Left, Side::Front, Side::Top]) {
            window.get_by_label(name).click();
            window.run();
            let asked = window.state().asked.last();
            assert!(matches!(asked, Some(Action::Edit(Edit::Camera(Move::Axis(it), _))) if *it == side), "{name}");
        }
    }
}

#[test]
fn what_was_changed_is_left_only_once_somebody_says_so() {
    let leaving = Leaving::Open(Box::new(Source::of(Path::new("other.toml"))));
    let answers = [
        ("Cancel", None),
        ("Open without saving", Some(Action::Leave(leaving.clone()))),
        ("Save session…", Some(Action::Choose(File::Session))),
    ];
    for (button, action) in answers {
        let mut window = wide(document());
        window.state_mut().losing.changes = true;
        window.state_mut().chooser.leave(leaving.clone());
        window.run();
        assert!(window.state().chooser.is_open());
        window.get_by_label(button).click();
        window.step();
        assert_eq!(window.state().asked.last().cloned(), action, "{button}");
        assert_eq!(window.state().chooser.is_open(), button.starts_with("Save"), "{button}");
    }
}

#[test]
fn a_tour_whose_pictures_are_not_all_there_is_left_only_once_somebody_says_so() {
    for (changes, button) in [(false, "Close now"), (true, "Close without saving")] {
        let mut window = wide(document());
        window.state_mut().losing = Losing { changes, tour: true, picture: !changes };
        window.state_mut().chooser.leave(Leaving::Close);
        window.run();
        assert!(is_painted(&window, "A tour is being saved"));
        assert_eq!(is_painted(&window, "not saved as a session"), changes);
        assert_eq!(is_painted(&window, "as fine as it gets"), !changes);
        assert_eq!(window.query_by_label("Save session…").is_some(), changes);
        window.get_by_label(button).click();
        window.step();
        assert_eq!(window.state().asked.last(), Some(&Action::Leave(Leaving::Close)));
    }
    // Once all of it is there, nothing is left to ask.
    let mut window = wide(document());
    window.state_mut().losing.tour = true;
    window.state_mut().chooser.leave(Leaving::Close);
    window.run();
    assert!(window.state().asked.is_empty());
    window.state_mut().losing.tour = false;
    window.run();
    assert_eq!(window.state().asked, [Action::Leave(Leaving::Close)]);
}

#[test]
fn a_dialog_has_the_keyboard_from_what_lies_behind_it() {
    for opens in ["Ctrl+O", "Open…"] {
        let mut window = wide(document());
        window.run();
        for _ in 0..3 {
            window.key_press(Key::Tab);
            window.run();
        }
        if opens == "Ctrl+O" {
            window.key_press_modifiers(Modifiers::COMMAND, Key::O);
        } else {
            window.state_mut().chooser.open(File::Opened, Path::new("."));
        }
        window.step();
        until_listed(&mut window);
        assert!(window.state().chooser.is_open());
        window.key_press(Key::Escape);
        window.run();
        assert!(!window.state().chooser.is_open(), "{opens}");
    }
}

#[test]
fn a_camera_that_is_turned_while_a_tour_is_played_is_a_step_back_and_the_tour_another() {
    let mut document = document();
    document.edit(&Edit::Hand(DVec2::new(0.2, 0.1)));
    document.edit(&Edit::Keep("dusk".to_owned()));
    document.rest();
    let looked = |document: &Document| (document.state().scene.camera.clone(), document.state().light.hand);
    let before = looked(&document);
    for frame in 1..=400 {
        document.edit(&Edit::Tour(frame, 400));
        if (100..300).contains(&frame) {
            document.edit(&Edit::Camera(Move::Orbit { right: 0.5, up: 0.0 }, 1.5));
        }
    }
    document.rest();
    let after = looked(&document);
    document.undo();
    assert_eq!(looked(&document).0, before.0, "the camera is where it was");
    document.undo();
    assert_eq!(looked(&document), before, "and so is the hand");
    assert!(document.can_undo(), "what was done before is not forgotten");
    document.redo();
    document.redo();
    assert_eq!(looked(&document), after);
}

#[test]
fn a_hand_that_lets_go_while_a_tour_is_played_begins_another_step_back() {
    let mut document = document();
    document.edit(&Edit::Hand(DVec2::new(0.2, 0.1)));
    document.edit(&Edit::Keep("dusk".to_owned()));
    document.rest();
    let (terms, hand) = (document.state().scene.transfer.terms.len(), document.state().light.hand);
    for frame in 1..=40 {
        document.edit(&Edit::Tour(frame, 40));
        if frame % 20 == 10 {
            document.edit(&Edit::RemoveTerm(0));
        }
        document.rest_beside_tour();
    }
    document.rest();
    for left in [terms - 1, terms] {
        document.undo();
        assert_eq!(document.state().scene.transfer.terms.len(), left);
    }
    document.undo();
    assert_eq!(document.state().light.hand, hand, "the tour is the step before");
}

#[test]
fn a_side_of_the_crop_box_stops_at_the_other_which_stays() {
    let mut document = document();
    document.edit(&Edit::Crop(Some([DVec3::ZERO, DVec3::splat(0.75)])));
    document.rest();
    let crop = |window: &Harness<'_, App>| window.state().document.as_ref().unwrap().state().crop().unwrap();
    let mut window = wide(document.clone());
    window.run();
    let [from, to] = ["x from", "x to"].map(|end| window.get_by_label(&format!("crop box: {end}")).rect().center());
    let way: Vec<Pos2> = (0..=40_u8).map(|part| from.lerp(to, 1.5 * f32::from(part) / 40.0)).collect();
    drag_along(&mut window, &way);
    let [low, high] = crop(&window);
    assert!((high - DVec3::splat(0.75)).length() < 1e-9 && low.x > 0.74 && low.x < high.x, "{low} {high}");
    let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(document));
    window.run();
    for _ in 0..3 {
        retype(&mut window, "crop x: from", "0.9");
        let [low, high] = crop(&window);
        assert!((high - DVec3::splat(0.75)).length() < 1e-9 && low.x > 0.74 && low.x < high.x, "{low} {high}");
    }
}

#[test]
fn a_long_number_takes_no_room_from_the_picture() {
    let mut window = wide(document());
    window.run();
    let place = window.state().place;
    type_unfinished(&mut window, "master", "0.12345678901234567890123456789012345678901234567890");
    window.run();
    assert_eq!(window.state().place, place);
    window.key_press(Key::Enter);
    window.run();
    assert_eq!(window.state().place, place);
    assert!(matches!(window.state().asked.last(), Some(Action::Edit(Edit::Master(_)))));
}

#[test]
fn what_is_said_of_a_number_is_clicked_through_and_goes_with_it() {
    let told = "2 is more than is possible here";
    let mut window = App::open(Vec2::new(1280.0, 3000.0), Some(document()));
    window.run();
    retype(&mut window, "interval 0: opacity", "2");
    assert!(is_painted(&window, told));
    // The field below it lies under what is said.
    let below = window.get_by_label("remove interval 1").rect().center();
    click_at(&mut window, below);
    window.run();
    assert!(matches!(window.state().asked.last(), Some(Action::Edit(Edit::RemoveTerm(1)))));
    assert!(is_painted(&window, told), "it can still be read");
    for _ in 0..2 {
        window.get_by_label("Undo").click();
        window.run();
    }
    window.run();
    assert!(!is_painted(&window, told), "the number is another one");
}

#[test]
fn a_handle_that_can_be_dragged_lies_over_one_that_cannot() {
    let mut document = document();
    document.edit(&Edit::Camera(Move::Axis(Side::Left), 1.5));
    document.edit(&Edit::Crop(Some([DVec3::new(0.25, 0.25, 0.49), DVec3::new(0.75, 0.75, 0.51)])));
    let mut window = wide(document);
    window.run();
    let [at, facing] = ["crop box: z to", "crop box: x from"].map(|label| window.get_by_label(label).rect().center());
    assert!(at.distance(facing) < 11.0, "one lies over the other");
    window.event(Event::PointerMoved(facing));
    window.run_steps(60);
    assert!(is_painted(&window, "Drag this side of the box: z"), "not the side that faces the eye");
}

#[test]
fn a_document_is_saved_until_it_is_changed_and_again_where_that_is_undone() {
    let mut document = document();
    assert!(document.is_saved());
    document.edit(&Edit::Exposure(2.0));
    assert!(!document.is_saved());
    document.undo();
    assert!(document.is_saved());
    document.redo();
    document.save();
    assert!(document.is_saved());
    document.undo();
    assert!(!document.is_saved(), "what is saved is something else");
    let starting = Document::starting(document.opened().clone(), &Edit::HandOnNode(0));
    assert!(starting.is_saved());
}

#[test]
fn a_wheel_that_was_turned_over_the_panels_moves_no_camera() {
    let mut window = wide(document());
    window.run();
    let place = window.state().place;
    let turned = |window: &mut Harness<'_, App>, at: Pos2| {
        window.state_mut().asked.clear();
        window.event(Event::PointerMoved(at));
        window.step();
        window.event(Event::MouseWheel {
            unit: MouseWheelUnit::Line,
            delta: Vec2::new(0.0, 3.0),
            phase: TouchPhase::Move,
            modifiers: Modifiers::NONE,
        });
        window.step();
        // The rest of it comes while the pointer is over the picture.
        window.event(Event::PointerMoved(place.center()));
        window.run();
        window.state().asked.iter().any(|action| matches!(action, Action::Edit(Edit::Camera(..))))
    };
    assert!(!turned(&mut window, Pos2::new(100.0, 400.0)), "over the panels");
    assert!(turned(&mut window, place.center()), "over the picture");
}

#[test]
fn long_names_do_not_widen_the_panels() {
    let narrow = App::open(Vec2::new(1280.0, 2000.0), Some(document())).state().place.left();
    let text = format!("{SCENE}{DIAL}");
    for name in ["flesh", "day"] {
        let long = format!("{name}-{}", "of-a-very-long-name-".repeat(5));
        let text = text.replace(name, &long);
        let scene = scene::parse("test", &text, Path::new(""), &SceneOptions::default(), &Quiet).unwrap();
        let mut window = App::open(Vec2::new(1280.0, 2000.0), Some(Document::new(scene)));
        window.run();
        assert!((window.state().place.left() - narrow).abs() < 1.0, "{name}: {}", window.state().place.left());
    }
}

#[test]
fn the_edge_of_the_panels_is_dragged() {
    let mut window = wide(document());
    window.run();
    let edge = |window: &Harness<'_, App>| window.state().place.left();
    let narrowest = edge(&window);
    for to in [420.0, narrowest] {
        let at = Pos2::new(edge(&window) + 1.0, 500.0);
        drag_along(&mut window, &[at, Pos2::new(at.x + (to - at.x) / 2.0, 500.0), Pos2::new(to, 500.0)]);
        window.run();
        assert!((edge(&window) - to).abs() < 4.0, "{to}: {}", edge(&window));
        assert!(!window.state().asked.iter().any(|action| matches!(action, Action::Edit(_))), "the camera stays");
    }
}

#[test]
fn nothing_is_offered_to_be_saved_while_nothing_is_open() {
    let mut window = App::open(Vec2::new(1280.0, 720.0), None);
    window.run();
    window.get_by_label("File").click();
    window.run();
    for line in ["Save session as", "Save picture as", "Save accumulators"] {
        assert!(window.get_by_label_contains(line).accesskit_node().is_disabled(), "{line}");
    }
}

#[test]
fn a_linear_picture_is_openexr_whatever_its_name_is_typed_as() {
    let mut window = wide(document());
    file_menu(&mut window, "Save linear picture as");
    until_listed(&mut window);
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.run();
    window.event(Event::Text("light".to_owned()));
    window.run();
    window.key_press(Key::Enter);
    until_listed(&mut window);
    let path = window.state().folder.path("light.exr");
    assert_eq!(saved_or_opened(&window), [Action::SavePicture(Some(path))]);
}

#[test]
fn what_stands_below_the_dial_stays_where_it_is_as_nodes_are_left_out() {
    let mut window = wide(document());
    window.run();
    let below = |window: &Harness<'_, App>| window.get_by_label("Light situations").rect();
    let before = below(&window);
    window.state_mut().document.as_mut().unwrap().edit(&Edit::NodeOn(0, false));
    window.run();
    assert_eq!(below(&window), before);
    window.get_by_label("Reset nodes").click();
    window.run();
    assert!(window.state().document.as_ref().unwrap().state().scene.dial.nodes[0].on);
}

#[test]
fn a_situation_that_looks_as_what_is_seen_is_shown_as_the_one_that_is() {
    let mut document = document();
    document.edit(&Edit::Hand(DVec2::new(0.3, 0.2)));
    document.edit(&Edit::Keep("evening".to_owned()));
    let index = document.situation();
    assert!(index.is_some());
    // As a session opens, which says where the hand is and not what that is called.
    let mut again = Document::new(document.state().scene.clone());
    assert_eq!(again.situation(), None, "sliders mix");
    again.edit(&Edit::Hand(DVec2::new(0.3, 0.2)));
    assert_eq!(again.situation(), index);
    again.edit(&Edit::NodeOn(0, false));
    assert_eq!(again.situation(), None, "another mix");
}
