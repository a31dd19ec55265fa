//! One frame: the panels are laid out, their actions done, and the picture shown.

use std::time::{Duration, Instant};

use egui::{Rect, Vec2, ViewportId};
use winit::event_loop::ActiveEventLoop;

use super::pace::Turn;
use super::{ViewError, Viewer, beside};
use crate::document::Document;
use crate::number::{unsigned, whole};
use crate::present::Frame;
use crate::view::effort::Curve;
use crate::view::engine::Engine;
use crate::view::export::write_rgba;
use crate::view::load::Loading;
use crate::view::task::Task;
use crate::view::tour::Tour;
use crate::view::ui::{self, Design, Effort, Shown, Status};
use crate::volume::Selection;
use crate::vulkan::VulkanError;

impl Viewer {
    /// Draws one frame and schedules the next one.
    pub(super) fn draw(&mut self, events: &ActiveEventLoop) -> Result<(), ViewError> {
        (self.pace.marches_until, self.pace.turn) = (None, Turn::Drawing);
        let begun = Instant::now();
        if let Some(screen) = &mut self.screen {
            screen.surface.wait()?;
        }
        let inputs = self.run_script(events)?;
        let Some(screen) = &mut self.screen else { return Ok(()) };
        let mut raw = screen.egui.take_egui_input(&screen.window);
        raw.events.extend(inputs);
        let (status, losing) = (self.status(), self.losing());
        let loading = self.loading.now.as_ref().map(Loading::progress).or_else(|| self.first_march());
        let Some(screen) = &mut self.screen else { return Ok(()) };
        // Asking the window again would wait for the screen.
        let (scale, points) = (
            egui_winit::pixels_per_point(&self.panels.context, &screen.window),
            raw.screen_rect.map_or(Vec2::ZERO, |rect| rect.size()),
        );
        let size = [points.x, points.y].map(|points| unsigned(whole(f64::from((points * scale).round()))));
        let wide = points.x >= ui::ROOM_FOR_PANELS;
        let loading = loading.as_ref().map(|(name, part, stage)| (name.as_str(), *part, stage.as_str()));
        let running = self.tasks.measuring.as_ref().map(|job| {
            let (part, stage) = job.progress();
            (part, format!("{stage}, {} s", job.spent().as_secs()))
        });
        let effort = Effort {
            planned: self.engine.as_ref().map(Engine::planned),
            curve: self
                .tasks
                .curve
                .as_ref()
                .zip(self.opened.document.as_ref())
                .map(|(curve, document)| (curve, curve.is_of(&document.state().scene, self.record.report.size))),
            // Shown while the chosen accuracy is in use.
            chosen: (self.tasks.chosen.as_ref().zip(self.opened.document.as_ref()))
                .filter(|((accuracy, _), document)| *accuracy == document.state().scene.accuracy)
                .map(|((_, told), _)| told.as_str()),
            running: running.as_ref().map(|(part, stage)| (*part, stage.as_str())),
        };
        let solving = self.tasks.solving.as_ref().map(Task::progress);
        let solving = solving.as_ref().map(|(part, stage)| (*part, stage.as_str()));
        let page = self.saving.page();
        let page = page.as_ref().map(|(name, (part, stage))| (name.as_str(), *part, stage.as_str()));
        let (mut asked, mut place) = (Vec::new(), Rect::ZERO);
        let aspect = self.picture.place.width() / self.picture.place.height().max(1.0);
        let shown = Shown {
            document: self.opened.document.as_ref(),
            title: &self.opened.title,
            status: &status,
            loading,
            notices: &self.panels.notices,
            page,
            stopped: self.lost.stopped,
            chooses: self.panels.chooser.is_open(),
            closes: std::mem::take(&mut self.ending.asked),
            several: Selection { resample: false, ..self.opened.selection.clone() } != Selection::default(),
            tour: self.tour.as_ref(),
            panels: self.panels.shown.unwrap_or(wide),
            layout: &self.panels.layout,
            recent: self.panels.recent.paths(),
            effort,
            design: Design {
                shown: self.panels.editing,
                running: solving,
                conflicts: beside::conflicts(&self.tasks.verdicts, self.opened.document.as_ref()),
                smoother: beside::smoother(&self.tasks, self.opened.document.as_ref()),
            },
            probe: self
                .picture
                .prober
                .place()
                .filter(|_| !self.picture.measures)
                .map(|place| (place, self.picture.prober.probe())),
            aspect: if aspect > 0.0 { f64::from(aspect) } else { 1.0 },
        };
        self.panels.untold = false;
        let chooser = &mut self.panels.chooser;
        let output = self.panels.context.run_ui(raw, |ui| {
            place = ui::show(ui, &shown, &mut asked);
            asked.extend(chooser.show(ui.ctx(), losing));
        });
        let again = output.viewport_output.get(&ViewportId::ROOT).map_or(Duration::MAX, |view| view.repaint_delay);
        screen.egui.handle_platform_output(&screen.window, output.platform_output);
        self.panels.textures.append(output.textures_delta);

        let [red, green, blue, _] = self.panels.context.global_style().visuals.panel_fill.to_array();
        let background = [red, green, blue].map(|part| f32::from(part) / 255.0);
        asked.into_iter().for_each(|action| self.ask(action));
        self.panels.keep_sizes();
        let plays = self.go_on_tour();
        if !self.panels.context.input(|input| input.pointer.any_down()) {
            self.opened.document.iter_mut().for_each(if plays { Document::rest_during_tour } else { Document::rest });
        }
        self.fit(place, output.pixels_per_point);
        let shown = self.engine.as_mut().map_or(Ok(false), Engine::show);
        self.made(shown)?;
        // The panels were laid out before a playing tour advanced; after its end they are laid out once more.
        let news = self.probe()? | self.follow_probe() | self.measured() | self.solved() | self.tour.is_some() | plays;
        let failed = !self.written();
        self.save_tour(failed);
        self.save_pictures();

        let capture = self.saving.capture.take();
        let place = self.pixels(output.pixels_per_point);
        let picture = self.engine.as_ref().and_then(Engine::picture).map(|picture| (picture, place));
        let Some(screen) = &mut self.screen else { return Ok(()) };
        let shown = screen.surface.show(Frame {
            size,
            background,
            picture,
            textures: &mut self.panels.textures,
            panels: output.shapes,
            context: &self.panels.context,
            pixels_per_point: output.pixels_per_point,
            capture: capture.is_some(),
        });
        let captured = match shown {
            Ok(captured) => captured,
            Err(error @ VulkanError::OutOfMemory { .. }) if capture.is_some() => {
                self.tell(&error);
                self.next(events, Duration::ZERO, news);
                return Ok(());
            }
            Err(error) => return Err(error.into()),
        };
        match (captured, capture) {
            (Some(pixels), Some(path)) => {
                let size = size.map(|pixels| pixels as usize);
                if let Err(error) = write_rgba(&path, size, &pixels) {
                    self.tell(&error);
                }
            }
            // No frame was shown; the next one is captured instead.
            (None, Some(path)) => self.saving.capture = Some(path),
            _ => {}
        }
        self.name_window();
        self.note_reached();
        self.record.report.frames += 1;
        let (took, now) = (1000.0 * begun.elapsed().as_secs_f64(), self.counts());
        self.record.drawn.add(took);
        let before = std::mem::replace(&mut self.record.counted, now);
        if now.relights > before.relights && now.dispatches == before.dispatches {
            self.record.relit.add(took);
        }
        self.next(events, again, news);
        Ok(())
    }

    /// Name and progress of the opened scene until its first picture.
    pub(super) fn first_march(&self) -> Option<(String, Option<f32>, String)> {
        let engine = self.engine.as_ref().filter(|engine| engine.picture().is_none() && engine.has_work(true))?;
        #[expect(clippy::cast_possible_truncation, reason = "for a bar on the screen")]
        let part = engine.progress().map(|part| part as f32);
        Some((self.opened.source.name(), part, "marching the first picture".to_owned()))
    }

    pub(super) fn status(&self) -> Status {
        let engine = self.engine.as_ref();
        let is_held = engine.is_some_and(|it| it.picture().is_some() && !it.is_finest()) && !self.hand_rests();
        Status {
            device: self.record.report.device.clone(),
            shown: engine.and_then(Engine::resolution),
            size: self.record.report.size,
            error: self.error(),
            level: engine.and_then(Engine::shown_level),
            light_block: engine.and_then(Engine::light_block),
            marching: engine.and_then(Engine::progress),
            beside: match (&self.tasks.measuring, &self.tasks.solving, &self.loading.now) {
                (_, _, Some(_)) => Some("opening"),
                (Some(_), _, None) => Some("measuring"),
                (None, Some(_), None) => Some("solving"),
                (None, None, None) if matches!(self.tour, Some(Tour::Saving { .. })) => Some("saving the tour"),
                (None, None, None) => is_held.then_some("coarse while the input lasts"),
            },
            finest: engine.is_some_and(Engine::is_finest),
            frame_ms: self.record.drawn.last(),
        }
    }

    /// Error of the colours in words: as measured for this setting, otherwise that of the colour model.
    fn error(&self) -> Option<String> {
        let planned = self.engine.as_ref().map(Engine::planned)?;
        let document = self.opened.document.as_ref()?;
        let (scene, size) = (&document.state().scene, self.record.report.size);
        let curve = self.tasks.curve.as_ref().filter(|curve| curve.is_of(scene, size));
        let here =
            |curve: &Curve| curve.settings.iter().find(|it| it.accuracy == scene.accuracy).map(|it| it.point.error.p95);
        if let Some(error) = curve.and_then(here) {
            return Some(format!("ΔE00 {error:.2} in 95 % of the pixels"));
        }
        Some(match &planned.model {
            None => "relighting exact".to_owned(),
            Some(model) => format!("colour model ΔE00 {:.2}", model.worst().p95),
        })
    }

    /// Sets the window title, with a mark for unsaved changes.
    pub(super) fn name_window(&mut self) {
        let Some(screen) = &self.screen else { return };
        let changed = self.opened.document.as_ref().is_some_and(|document| !document.is_saved());
        let title = if changed { format!("*{}", self.opened.title) } else { self.opened.title.clone() };
        if self.opened.title_shown != title {
            screen.window.set_title(&title);
            self.opened.title_shown = title;
        }
    }
}
