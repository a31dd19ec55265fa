//! Edits of the document, what they make stale, and undo.

use std::path::Path;
use std::sync::Arc;

use glam::DVec2;
use relume::document;
use relume::document::SceneOptions;
use relume::document::design::{self, Spectra};
use relume::document::moves::Move;
use relume::document::{Document, Edit};
use relume::plan::Stale;
use relume::progress::Quiet;
use relume::scene::{Accuracy, Backdrop, Form, Interval, Second, Shape, Tone};
use relume::spectrum::observer::Observer;

use crate::app::{document, offered};
use crate::support::program::SCENE;

fn triangle() -> Arc<Shape> {
    let corners = vec![[1.0, 0.0], [0.5, 2.0], [1.5, 2.0]];
    Arc::new(Shape { second: Second::Gradient, form: Form::Polygon { corners, soft: 0.1 } })
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
            Edit::Exposure(Some(number)),
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
            assert!(state.scene.camera.view(&state.scene.frame.geometry, 1.0).is_some(), "{edit:?}");
        }
    }
}

#[test]
fn an_edit_makes_stale_what_it_must() {
    let lights = [
        Edit::Weight(0, 0.5),
        Edit::On(0, false),
        Edit::Solo(Some(0)),
        Edit::Normalise(true),
        Edit::Master(0.5),
        Edit::Hand(DVec2::new(0.1, 0.2)),
        Edit::HandOnNode(0),
        Edit::NodePlace(0, DVec2::splat(0.3)),
        Edit::NodeOn(0, false),
        Edit::DialPreset(0),
        offered(&document()),
    ];
    let display = [
        Edit::Exposure(Some(2.0)),
        Edit::Exposure(None),
        Edit::Tone(Tone::Soft),
        Edit::Backdrop(Backdrop::Dark),
        Edit::Adapt(true),
    ];
    let observer = [Edit::Observer(Observer::Cie1964)];
    let camera = [Edit::Camera(Move::Orbit { right: 10.0, up: 0.0 }, 1.0), Edit::Camera(Move::Projection, 1.0)];
    let tables = [
        Edit::Interval(0, Interval { material: 0, range: [1.0, 2.0], ramp: 0.5, opacity: 0.5, absorption: 0.0 }),
        Edit::TermGradient(0, vec![(1.0, 0.5)]),
        Edit::TermShape(0, Some(triangle())),
        Edit::AddInterval(
            Interval { material: 0, range: [1.0, 2.0], ramp: 0.5, opacity: 0.5, absorption: 0.0 },
            Vec::new(),
        ),
        Edit::RemoveTerm(0),
        Edit::Accuracy(Accuracy { step_length: 0.7, ..document().state().scene.accuracy.clone() }),
    ];
    let spectra = [Edit::Spectra(Arc::new(
        Spectra::standard(&document().state().scene, design::Side::Light, "lamp", "FL11").unwrap(),
    ))];
    // The film of this scene holds material weights, which do not depend on spectra.
    let expected = [
        (&lights[..], Stale::Nothing),
        (&display, Stale::Picture),
        (&spectra, Stale::Picture),
        (&observer, Stale::Matrices),
        (&camera, Stale::Accumulators),
        (&tables, Stale::Tables),
    ];
    for (edits, stale) in expected {
        for edit in edits {
            let mut document = document();
            let before = document.state().scene.clone();
            let planned = relume::plan::plan(&before, &Quiet).unwrap();
            assert!(document.edit(edit), "{edit:?}");
            let after = document.state().scene.clone();
            assert_eq!(Stale::between(&before, &planned, &after), stale, "{edit:?}");
            assert!(document.undo(), "{edit:?} undone");
            assert_eq!(Stale::between(&before, &planned, &document.state().scene), Stale::Nothing, "{edit:?} undone");
            assert!(document.redo(), "{edit:?} redone");
            assert_eq!(Stale::between(&after, &planned, &document.state().scene), Stale::Nothing, "{edit:?} redone");
        }
    }
}

#[test]
fn steps_back_are_bounded_however_much_is_done() {
    let mut document = document();
    for step in 0..1000 {
        document.edit(&Edit::Exposure(Some(1.0 + f64::from(step))));
        document.rest();
    }
    let mut undone = 0;
    while document.undo() {
        undone += 1;
    }
    assert_eq!(undone, 200);
    assert!(!document.can_undo() && document.can_redo());
}

#[test]
fn another_time_step_is_looked_at_as_the_one_before() {
    let mut before = document();
    before.edit(&Edit::Camera(Move::Orbit { right: 30.0, up: 10.0 }, 1.5));
    before.edit(&Edit::HandOnNode(1));
    before.edit(&Edit::RemoveTerm(0));
    let scene = before.opened().clone();
    assert!(before.has_grid_of(&scene.scene));
    let after = before.clone().with_file(scene.clone(), false);
    assert!(after.state().writes_as(before.state()), "also a transfer function that was changed");
    let mut back = after.clone();
    while back.can_undo() {
        back.undo();
    }
    assert!(
        back.is_saved() && !after.is_saved() && back.state().scene.camera == scene.scene.camera,
        "with the same steps back"
    );
    // Without edits, a volume with other values opens with its own transfer function.
    let mut other = scene.clone();
    other.scene.transfer.terms.remove(0);
    let untouched = Document::new(scene.clone());
    for (alike, terms) in [(true, &scene.scene.transfer), (false, &other.scene.transfer)] {
        let after = untouched.clone().with_file(other.clone(), alike);
        assert!(after.is_saved() && after.state().scene.transfer == *terms, "{alike}");
    }
    let text = SCENE.replace("dims = [32, 30, 18]", "dims = [16, 15, 9]");
    let smaller = document::parse("test", &text, Path::new(""), &SceneOptions::default(), &Quiet).unwrap();
    assert!(!before.has_grid_of(&smaller.scene), "another grid is another thing");
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
    assert!(document.undo() && !document.can_undo());
}

#[test]
fn a_document_is_saved_until_it_is_changed_and_again_where_that_is_undone() {
    let mut document = document();
    assert!(document.is_saved());
    document.edit(&Edit::Exposure(Some(2.0)));
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
