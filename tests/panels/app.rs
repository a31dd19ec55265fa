//! A document controlled by the panels, and simulated clicks, drags and typing.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use egui::accesskit::Role;
use egui::{Event, Key, Modifiers, PointerButton, Pos2, Rect, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use glam::DVec2;
use relume::document;
use relume::document::SceneOptions;
use relume::document::design::{self, Step};
use relume::document::{Document, Edit, SceneFile};
use relume::palette::{Conflict, SmoothCost};
use relume::progress::Quiet;
use relume::scene::{Interval, Mix};
use relume::view::action::Losing;
use relume::view::effort::Curve;
use relume::view::layout::{Dock, Layout};
use relume::view::probe::{Pixel, Ray};
use relume::view::tour::Tour;
use relume::view::ui::{self, Chooser, Design, Effort, Notice, Shown, Status};
use relume::view::{Action, Probe};

use crate::support::program::{DIAL, Folder, SCENE};

pub(crate) fn document() -> Document {
    let text = format!("{SCENE}{DIAL}");
    Document::new(document::parse("test", &text, Path::new(""), &SceneOptions::default(), &Quiet).unwrap())
}

/// Palette for the document's materials.
pub(crate) fn offered(document: &Document) -> Edit {
    Edit::Design(Step::Take(Arc::new(design::wished(&document.state().scene))))
}

/// Document that executes the panels' actions.
pub(crate) struct App {
    pub(crate) document: Option<Document>,
    pub(crate) asked: Vec<Action>,
    pub(crate) panels: bool,
    pub(crate) layout: Layout,
    pub(crate) recent: Vec<PathBuf>,
    pub(crate) probe: Option<(DVec2, Option<Probe>)>,
    pub(crate) curve: Option<Curve>,
    pub(crate) design: bool,
    pub(crate) conflicts: Vec<Conflict>,
    pub(crate) smoother: Vec<SmoothCost>,
    pub(crate) notices: Vec<Notice>,
    /// Page being written: name, progress and stage.
    pub(crate) page: Option<(String, Option<f32>, String)>,
    pub(crate) tour: Option<Tour>,
    pub(crate) several: bool,
    pub(crate) closes: bool,
    pub(crate) losing: Losing,
    pub(crate) chooser: Chooser,
    /// Current folder of the file dialog.
    pub(crate) folder: Folder,
    /// Rectangle of the picture.
    pub(crate) place: Rect,
    /// Docks whose edges were dragged, and their sizes.
    pub(crate) resized: Vec<(Dock, f32)>,
}

impl App {
    pub(crate) fn open(size: Vec2, document: Option<Document>) -> Harness<'static, Self> {
        let app = Self {
            document,
            asked: Vec::new(),
            panels: size.x >= ui::ROOM_FOR_PANELS,
            layout: Layout::default(),
            recent: Vec::new(),
            probe: None,
            curve: None,
            design: false,
            conflicts: Vec::new(),
            smoother: Vec::new(),
            notices: Vec::new(),
            page: None,
            tour: None,
            several: false,
            closes: false,
            losing: Losing::default(),
            chooser: Chooser::default(),
            folder: Folder::new(),
            place: Rect::ZERO,
            resized: Vec::new(),
        };
        Harness::builder().with_size(size).build_ui_state(Self::show, app)
    }

    fn show(ui: &mut egui::Ui, app: &mut Self) {
        let mut asked = Vec::new();
        let shown = Shown {
            document: app.document.as_ref(),
            title: "body.nrrd — Relume",
            status: &Status::default(),
            loading: None,
            notices: &app.notices,
            page: app.page.as_ref().map(|(name, part, stage)| (name.as_str(), *part, stage.as_str())),
            stopped: false,
            several: app.several,
            closes: std::mem::take(&mut app.closes),
            tour: app.tour.as_ref(),
            chooses: app.chooser.is_open(),
            panels: app.panels,
            layout: &app.layout,
            recent: &app.recent,
            design: Design { shown: app.design, running: None, conflicts: &app.conflicts, smoother: &app.smoother },
            effort: Effort { curve: app.curve.as_ref().map(|curve| (curve, true)), ..Effort::default() },
            probe: app.probe.as_ref().map(|(place, probe)| (*place, probe.as_ref())),
            aspect: 1.5,
        };
        app.place = ui::show(ui, &shown, &mut asked);
        app.resized.extend(ui::resized_dock(ui.ctx()));
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
                (Action::Arrange(change), _) => app.layout.arrange(*change),
                (Action::Palette(shown), _) => app.design = *shown,
                (Action::Dismiss(index), _) => drop(app.notices.remove(*index)),
                _ => {}
            }
        }
        app.asked.extend(asked);
    }
}

pub(crate) fn wide(document: Document) -> Harness<'static, App> {
    App::open(Vec2::new(1280.0, 720.0), Some(document))
}

pub(crate) fn light_names(mix: &Mix) -> Vec<&str> {
    mix.0.iter().map(|light| light.name.as_str()).collect()
}

/// Opens a document with statistics in a window tall enough for all panels.
pub(crate) fn with_histogram() -> Harness<'static, App> {
    let document = document();
    let statistics = document.opened().scene.volume().statistics().unwrap();
    App::open(Vec2::new(1000.0, 2000.0), Some(document.with_statistics(statistics)))
}

pub(crate) fn intervals(window: &Harness<'_, App>) -> Vec<Interval> {
    let document = window.state().document.as_ref().unwrap();
    document.state().scene.transfer.terms.iter().map(|term| term.as_interval().unwrap()).collect()
}

/// Returns the scene file of an edited document, with its opening mix.
pub(crate) fn reopened(document: &Document) -> SceneFile {
    let state = document.state();
    SceneFile { scene: state.scene.clone(), dial: state.dial.clone(), ..document.opened().clone() }
}

pub(crate) fn probed() -> Probe {
    probed_of(&document())
}

pub(crate) fn probed_of(document: &Document) -> Probe {
    let scene = document.state().scene.clone();
    let (planned, size) = (relume::plan::plan(&scene, &Quiet).unwrap(), [2, 2]);
    let rungs = relume::measure::Rungs::planned(scene.clone(), planned.clone(), size).unwrap();
    let marched = rungs.march::<f32>(&rungs.stored(), &Quiet).unwrap();
    let of = |planes: &[f32]| planes.iter().step_by(4).copied().collect();
    let numbers = relume::film::Film {
        size: [1, 1],
        components: marched.components,
        accumulators: of(&marched.accumulators),
        transmittance: of(&marched.transmittance),
    };
    let means = relume::film::Relightable::new(&scene, &planned);
    let reflected = relume::tables::Reflected::new(&means.components, None);
    let ray = Ray::march(&scene, &scene.volume().statistics().unwrap(), [size, [0, 0]], &Quiet).unwrap();
    let pixel = Pixel { place: [0, 0], size, numbers, planned, means };
    Probe::new(&pixel, &scene, &Mix::of_scene(&scene), Some(&reflected), Some(&ray))
}

/// Presses and releases the primary button.
pub(crate) fn click_at(window: &mut Harness<'_, App>, pos: Pos2) {
    window.event(Event::PointerMoved(pos));
    window.run();
    for pressed in [true, false] {
        let button = PointerButton::Primary;
        window.event(Event::PointerButton { pos, button, pressed, modifiers: Modifiers::NONE });
        window.run();
    }
}

/// Types `text` into the field `label`.
pub(crate) fn type_into(window: &mut Harness<'_, App>, label: &str, text: &str) {
    window.get_by_label(label).click();
    window.run();
    for letter in text.chars() {
        window.event(Event::Text(letter.to_string()));
        window.run();
        // As the window does while no button is held.
        window.state_mut().document.as_mut().unwrap().rest();
    }
}

/// Replaces the contents of a field, or of the field at the right of a slider, with `text`.
pub(crate) fn retype(window: &mut Harness<'_, App>, label: &str, text: &str) {
    let named = window.get_by_label(label).rect();
    let in_line = |place: &Rect| (place.center().y - named.center().y).abs() < 5.0;
    let fields: Vec<Rect> = window.get_all_by_role(Role::SpinButton).map(|node| node.rect()).filter(in_line).collect();
    let own = fields.iter().find(|place| place.contains(named.center())).or(fields.first());
    let field = own.copied().unwrap_or(named);
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

/// Moves the pointer along `places` with the primary button held from the first to the last.
pub(crate) fn drag_along(window: &mut Harness<'_, App>, places: &[Pos2]) {
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
    // As the window does while no button is held.
    window.state_mut().document.as_mut().unwrap().rest();
}

/// The texts that are painted inside `place`.
pub(crate) fn painted_in(window: &Harness<'_, App>, place: Rect) -> Vec<String> {
    let text = |clipped: &egui::epaint::ClippedShape| match &clipped.shape {
        egui::Shape::Text(shape) if place.expand(1.0).contains_rect(shape.visual_bounding_rect()) => {
            Some(shape.galley.text().to_owned())
        }
        _ => None,
    };
    window.output().shapes.iter().filter_map(text).collect()
}

/// Whether a painted text contains `text`.
pub(crate) fn is_painted(window: &Harness<'_, App>, text: &str) -> bool {
    window.output().shapes.iter().any(|clipped| match &clipped.shape {
        egui::Shape::Text(shape) => shape.galley.text().contains(text),
        _ => false,
    })
}
