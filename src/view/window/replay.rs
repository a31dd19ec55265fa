//! Execution of scripts.

use std::sync::Arc;

use egui::{Pos2, Rect};
use winit::dpi::PhysicalSize;
use winit::event::WindowEvent;
use winit::event_loop::ActiveEventLoop;

use super::{ViewError, Viewer};
use crate::document::design::Spectra;
use crate::document::{Document, Edit, clip_plane};
use crate::scene::{CLIP_PLANES, Clip, Interval};
use crate::view::action::Action;
use crate::view::engine::Engine;
use crate::view::script::{self, Command, Input};

/// Number of frames for which a script waits for a requested window size.
const PATIENCE: u32 = 120;

/// Progress of a script.
#[derive(Default)]
pub(super) struct Position {
    /// Next command.
    next: usize,
    /// Number of frames that the last command still waits.
    waits: u32,
}

impl Viewer {
    /// Whether all requested work is done.
    fn is_settled(&self) -> bool {
        let finest = self.engine.as_ref().is_none_or(Engine::is_finest);
        // The first frame after opening has not requested a picture yet.
        let looked = self.opened.document.is_none() || self.picture.place != Rect::ZERO;
        self.loading.now.is_none()
            && finest
            && looked
            && self.tour.is_none()
            && self.tasks.measuring.is_none()
            && self.tasks.solving.is_none()
            && !self.is_saving()
            && !self.picture.measures
    }

    /// Whether the script waits for all work to end.
    pub(super) fn settles(&self) -> bool {
        let script = self.options.script.as_ref();
        self.script.waits == 0
            && script.is_some_and(|script| script.command(self.script.next) == Some(&Command::Settle))
    }

    /// Returns the document, or the reason why none is open.
    fn open_document(&self) -> Result<&Document, String> {
        self.opened.document.as_ref().ok_or_else(|| match self.record.report.failures.last() {
            Some(failure) => format!("nothing is open: {failure}"),
            None => "nothing is open".to_owned(),
        })
    }

    /// Runs the next command of the script and returns its input events.
    pub(super) fn run_script(&mut self, events: &ActiveEventLoop) -> Result<Vec<egui::Event>, ViewError> {
        let Some(script) = &self.options.script else { return Ok(Vec::new()) };
        if self.script.waits > 0 {
            self.script.waits -= 1;
            return Ok(Vec::new());
        }
        let at = self.script.next;
        // The first commands refer to the source still being opened.
        let opens = self.opened.document.is_none() && self.loading.now.is_some();
        let Some(command) = script.command(at).cloned() else {
            if !self.is_saving() {
                events.exit();
            }
            return Ok(Vec::new());
        };
        let inputs = match command {
            Command::Settle if !self.is_settled() => return Ok(Vec::new()),
            _ if opens && command.is_about_a_scene() => return Ok(Vec::new()),
            // The next commands refer to the palette being solved.
            Command::Do(Action::Solve(_) | Action::Edit(Edit::Design(_))) if self.tasks.solving.is_some() => {
                return Ok(Vec::new());
            }
            // Saved files must show the state at the time of the request; a page being written already has it.
            _ if self.is_saving_state() => return Ok(Vec::new()),
            Command::Settle => {
                self.record.report.settled.push(self.counts());
                Vec::new()
            }
            Command::Frames(frames) => {
                self.script.waits = frames.saturating_sub(1);
                Vec::new()
            }
            Command::Do(action) => {
                self.ask(action);
                Vec::new()
            }
            Command::Named(about, name) => {
                let edit = self.open_document().and_then(|document| about.edit(document.state(), &name));
                self.ask(Action::Edit(edit.map_err(|message| script.wrong(at, message))?));
                Vec::new()
            }
            Command::Interval(index, [from, to, ramp, opacity]) => {
                let stated = self.open_document().and_then(|document| script::interval(document.state(), index));
                let stated = stated.map_err(|message| script.wrong(at, message))?;
                self.ask(Action::Edit(Edit::Interval(index, Interval { range: [from, to], ramp, opacity, ..stated })));
                Vec::new()
            }
            Command::Spectrum(side, name, standard) => {
                let spectra = self
                    .open_document()
                    .and_then(|document| Spectra::standard(&document.state().scene, side, &name, &standard));
                let spectra = Arc::new(spectra.map_err(|message| script.wrong(at, message))?);
                self.ask(Action::Edit(Edit::Spectra(spectra)));
                Vec::new()
            }
            Command::Clip(planes) => {
                let clip = self.open_document().and_then(|document| {
                    let scene = &document.state().scene;
                    if planes.len() > CLIP_PLANES {
                        return Err(format!("{} clip planes; a scene may have {CLIP_PLANES}", planes.len()));
                    }
                    let planes = planes.iter().map(|text| clip_plane(text, &scene.frame)).collect::<Result<_, _>>()?;
                    Ok(Clip { planes, ..scene.clip })
                });
                self.ask(Action::Edit(Edit::Clip(clip.map_err(|message| script.wrong(at, message))?)));
                Vec::new()
            }
            Command::Camera(step) => {
                let aspect = f64::from(self.picture.place.width() / self.picture.place.height().max(1.0));
                self.ask(Action::Edit(Edit::Camera(step, if aspect > 0.0 { aspect } else { 1.0 })));
                Vec::new()
            }
            Command::Size([width, height]) => {
                let Some(screen) = &self.screen else { return Ok(Vec::new()) };
                let wanted = PhysicalSize::new(width, height);
                if self.options.size != Some([width, height]) {
                    self.options.size = Some([width, height]);
                    // If the size changes at once, the system still sends its usual event.
                    let _given = screen.window.request_inner_size(wanted);
                    self.script.waits = 1;
                    return Ok(Vec::new());
                }
                if screen.window.inner_size() != wanted {
                    self.script.waits = PATIENCE;
                }
                Vec::new()
            }
            Command::Probe(place) => {
                if self.loading.now.is_none() {
                    self.open_document().map_err(|message| script.wrong(at, message))?;
                }
                if self.picture.prober.place() != Some(place) {
                    self.look_at(Some(place));
                }
                if !(self.is_settled() && self.picture.prober.is_done()) {
                    return Ok(Vec::new());
                }
                if let (Some(probe), Some(document)) = (self.picture.prober.probe(), &self.opened.document) {
                    self.record.report.probes.push(probe.json(&document.state().scene));
                }
                Vec::new()
            }
            Command::Ruler(place) => {
                if self.loading.now.is_none() {
                    self.open_document().map_err(|message| script.wrong(at, message))?;
                }
                if !self.is_settled() || self.picture.measures {
                    return Ok(Vec::new());
                }
                self.measure_at(place);
                Vec::new()
            }
            Command::Input(Input::Drop(path)) => {
                self.hear(events, &WindowEvent::DroppedFile(path));
                Vec::new()
            }
            Command::Input(input) => self.input(&input).map_err(|message| script.wrong(at, message))?,
        };
        self.script.next += 1;
        Ok(inputs)
    }

    /// Converts scripted input to egui events.
    fn input(&self, input: &Input) -> Result<Vec<egui::Event>, String> {
        let pointer = self.panels.context.input(|input| input.pointer.latest_pos()).unwrap_or(Pos2::ZERO);
        let modifiers = egui::Modifiers::NONE;
        Ok(match input {
            Input::Pointer(x, y) => vec![egui::Event::PointerMoved(Pos2::new(*x, *y))],
            Input::Button(pressed) => {
                let button = egui::PointerButton::Primary;
                vec![egui::Event::PointerButton { pos: pointer, button, pressed: *pressed, modifiers }]
            }
            Input::Scroll(lines) => vec![egui::Event::MouseWheel {
                unit: egui::MouseWheelUnit::Line,
                delta: egui::vec2(0.0, *lines),
                phase: egui::TouchPhase::Move,
                modifiers,
            }],
            Input::Key(name) => {
                let key = egui::Key::from_name(name).ok_or_else(|| format!("unknown key {name:?}"))?;
                let event = |pressed| egui::Event::Key { key, physical_key: None, pressed, repeat: false, modifiers };
                vec![event(true), event(false)]
            }
            // Handled as a window event.
            Input::Drop(_) => Vec::new(),
        })
    }
}
