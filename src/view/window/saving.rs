//! Files written by the window, and the played or saved tour.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::report::keep;
use super::{Viewer, Woken};
use crate::document::Edit;
use crate::document::Source;
use crate::document::session;
use crate::number::count;
use crate::output::numbered;
use crate::output::page::{PageError, Summary};
use crate::progress::Progress;
use crate::view::action::File;
use crate::view::engine::{Engine, Refining};
use crate::view::export::ExportError;
use crate::view::task::Task;
use crate::view::tour::Tour;

/// Files still to be written.
#[derive(Default)]
pub(super) struct Saving {
    /// Exports that wait for the finest picture.
    waiting: Vec<Export>,
    /// Files being written.
    writing: Vec<Writing>,
    /// Reserved file names, which may not exist yet.
    named: Vec<PathBuf>,
    /// File for the window's pixels in this frame.
    pub(super) capture: Option<PathBuf>,
}

impl Saving {
    /// Waits for the files being written.
    pub(super) fn end(&mut self) {
        self.writing.drain(..).for_each(|writing| writing.job.end());
    }

    /// Cancels the pages being written.
    pub(super) fn give_up_pages(&self) {
        self.writing.iter().filter(|writing| writing.page.is_some()).for_each(|writing| writing.job.cancel());
    }

    /// Name and progress of a page being written.
    pub(super) fn page(&self) -> Option<(String, (Option<f32>, String))> {
        self.writing.iter().find_map(|writing| Some((writing.page.clone()?, writing.job.progress())))
    }

    /// Returns the first numbered name after `name` that is neither taken nor reserved; the names of a tour's numbered
    /// pictures
    /// must be free too.
    fn free(&self, name: &str) -> PathBuf {
        let is_free = |path: &PathBuf| !path.exists() && !numbered(path, 1).exists() && !self.named.contains(path);
        let mut names = (1..=u16::MAX).map(|number| numbered(Path::new(name), number));
        names.find(is_free).unwrap_or_else(|| name.into())
    }

    /// Returns `path`, or else reserves a free name.
    fn named(&mut self, path: Option<PathBuf>, name: &str) -> PathBuf {
        path.unwrap_or_else(|| {
            let free = self.free(name);
            self.named.push(free.clone());
            free
        })
    }
}

/// Export of a picture.
enum Export {
    Picture(PathBuf),
    Accumulators(PathBuf),
    Page(PathBuf),
}

/// File being written. Its result is the notice to show.
struct Writing {
    job: Task<Result<Option<String>, ExportError>>,
    /// Name of a page, which takes seconds and can be cancelled.
    page: Option<String>,
}

const PICTURE: &str = "relume.png";
const LINEAR_PICTURE: &str = "relume.exr";
const ACCUMULATORS: &str = "relume-accumulators.exr";
const PAGE: &str = "relume.html";
const SESSION: &str = "relume-session.toml";
const TOUR: &str = "relume-tour.png";

impl Viewer {
    /// Opens the dialog for `file`.
    pub(super) fn choose(&mut self, file: File) {
        let name = match file {
            File::Opened => self.opened.source.path.clone().unwrap_or_default(),
            File::Picture => self.saving.free(PICTURE),
            File::LinearPicture => self.saving.free(LINEAR_PICTURE),
            File::Accumulators => self.saving.free(ACCUMULATORS),
            File::Page => self.saving.free(PAGE),
            File::Session => self.saving.free(SESSION),
        };
        self.panels.chooser.open(file, &name);
    }

    /// Saves the picture once it is the finest.
    pub(super) fn save_picture(&mut self, path: Option<PathBuf>) {
        let path = self.saving.named(path, PICTURE);
        self.saving.waiting.push(Export::Picture(path));
    }

    /// Saves the film once the picture is the finest.
    pub(super) fn save_accumulators(&mut self, path: Option<PathBuf>) {
        let path = self.saving.named(path, ACCUMULATORS);
        self.saving.waiting.push(Export::Accumulators(path));
    }

    /// Saves the page once the picture is the finest.
    pub(super) fn save_page(&mut self, path: Option<PathBuf>) {
        let path = self.saving.named(path, PAGE);
        self.saving.waiting.push(Export::Page(path));
    }

    /// Starts to save a tour in `frames` pictures.
    pub(super) fn begin_tour(&mut self, path: Option<PathBuf>, frames: u16) {
        let path = self.saving.named(path, TOUR);
        self.tour = Some(Tour::saving(path, frames));
    }

    /// Plays a tour for `seconds`; `None` ends the tour being played or saved.
    pub(super) fn tour(&mut self, seconds: Option<f64>) {
        if let Some(Tour::Saving { frames, saved, .. }) = self.tour {
            self.tell_done(format!("The tour was cancelled: {saved} of {frames} pictures are saved."));
            self.end_saved_tour();
        }
        self.tour = seconds.map(Tour::playing);
    }

    /// Stops a playing tour; the hand stays.
    pub(super) fn stop_tour(&mut self) {
        self.tour.take_if(|tour| matches!(tour, Tour::Playing { .. }));
    }

    /// Ends the tour being saved, with a notice of the reason.
    pub(super) fn give_up_tour(&mut self, why: &str) {
        if let Some(Tour::Saving { frames, saved, .. }) = self.tour {
            self.note(format!("{why}: the tour was cancelled after {saved} of {frames} pictures."));
            self.end_saved_tour();
        }
    }

    /// Ends the saved tour and restores the document's light.
    fn end_saved_tour(&mut self) {
        self.tour = None;
        if let (Some(engine), Some(document)) = (&mut self.engine, &self.opened.document) {
            engine.light(document.state());
        }
    }

    pub(super) fn save_session(&mut self, path: Option<PathBuf>) {
        let path = &self.saving.named(path, SESSION);
        let Some(document) = &mut self.opened.document else {
            self.note("No session to save: nothing is open.".to_owned());
            return;
        };
        match session::save(path, &self.opened.source, document.opened(), document.state()) {
            Err(error) => self.tell(&error),
            Ok(()) => {
                document.save();
                self.opened.title = Source::of(path).title(&self.opened.selection);
                let ([width, height], path) = (self.record.report.size, whole_path(path));
                self.tell_done(format!(
                    "Saved the session as {path}. `relume render` with --size {width}x{height} renders the same picture."
                ));
            }
        }
    }

    /// Drops exports of a picture that another scene has replaced.
    pub(super) fn forget_waiting(&mut self) {
        for export in std::mem::take(&mut self.saving.waiting) {
            let (Export::Picture(path) | Export::Accumulators(path) | Export::Page(path)) = export;
            self.note(format!("{} was not saved: another file was opened.", path.display()));
        }
    }

    /// Whether an export waits for the finest picture.
    pub(super) fn is_awaited(&self) -> bool {
        !self.saving.waiting.is_empty()
    }

    /// Starts the exports that wait for the finest picture.
    pub(super) fn save_pictures(&mut self) {
        // A tour being saved shows other light than the document.
        let tours = matches!(self.tour, Some(Tour::Saving { .. }));
        if self.saving.waiting.is_empty() || self.loading.now.is_some() || tours {
            return;
        }
        let (Some(engine), Some(document)) = (&self.engine, &self.opened.document) else {
            self.saving.waiting.clear();
            self.note("No picture to save: nothing is open.".to_owned());
            return;
        };
        if !engine.is_finest() {
            return;
        }
        if let Some(shown) = engine.shown_level() {
            for export in std::mem::take(&mut self.saving.waiting) {
                let (Export::Picture(path) | Export::Accumulators(path) | Export::Page(path)) = export;
                let text = format!(
                    "{} was not saved: the picture shows a coarse level of the volume; {}.",
                    path.display(),
                    refined_by(shown.then)
                );
                keep(&mut self.record.report.failures, text.clone());
                self.note(text);
            }
            return;
        }
        let state = document.state().clone();
        let Some(snapshot) = engine.snapshot().map(Arc::new) else { return };
        for export in std::mem::take(&mut self.saving.waiting) {
            let snapshot = Arc::clone(&snapshot);
            match export {
                Export::Picture(path) => {
                    let there = format!("Saved the picture as {}.", whole_path(&path));
                    self.begin(None, move |_| snapshot.write_picture(&path).map(|()| Some(there)));
                }
                Export::Accumulators(path) => {
                    let there = format!("Saved the film as {}.", whole_path(&path));
                    let state = state.clone();
                    self.begin(None, move |_| snapshot.write_accumulators(&state, &path).map(|()| Some(there)));
                }
                Export::Page(path) => {
                    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
                    let state = state.clone();
                    self.begin(Some(name), move |progress| {
                        let summary = snapshot.write_page(&state, &path, progress)?;
                        Ok(Some(saved_page(&path, &summary, state.scene.frame.anatomical)))
                    });
                }
            }
        }
    }

    /// Runs `write` in the background, which returns the notice of success; `page` is the name of a page.
    fn begin(
        &mut self,
        page: Option<String>,
        write: impl FnOnce(&dyn Progress) -> Result<Option<String>, ExportError> + Send + 'static,
    ) {
        let proxy = self.proxy.clone();
        let wake = move || drop(proxy.send_event(Woken::Progress));
        self.saving.writing.push(Writing { job: Task::start(wake, write), page });
    }

    /// Reports finished files. Returns whether all succeeded.
    pub(super) fn written(&mut self) -> bool {
        let mut all = true;
        for mut writing in std::mem::take(&mut self.saving.writing) {
            match writing.job.take() {
                None => self.saving.writing.push(writing),
                Some(Err(ExportError::Page(PageError::Cancelled))) => {
                    let name = writing.page.unwrap_or_default();
                    self.tell_done(format!("{name} was cancelled, and is not written."));
                }
                Some(Err(error)) => {
                    self.tell(&error);
                    all = false;
                }
                Some(Ok(there)) => there.into_iter().for_each(|there| self.tell_done(there)),
            }
        }
        all
    }

    /// Applies the tour's current position. Returns whether a tour is playing, all of which is one undo step.
    pub(super) fn go_on_tour(&mut self) -> bool {
        let (Some(tour), Some(document)) = (&self.tour, &mut self.opened.document) else { return false };
        let edit = tour.edit();
        let plays = matches!(tour, Tour::Playing { .. });
        if plays {
            let changed = document.edit(&edit);
            if matches!(edit, Edit::Tour(step, of) if step >= of) {
                self.tour = None;
            }
            if changed {
                self.show_tour();
            }
        } else if let Some(engine) = &mut self.engine {
            engine.light(&document.preview(&edit));
        }
        plays
    }

    /// Saves the tour's next finished picture; ends the tour after the last one or after a failure.
    pub(super) fn save_tour(&mut self, failed: bool) {
        let Some(Tour::Saving { path, frames, saved, .. }) = &self.tour else { return };
        if !self.saving.writing.is_empty() {
            return;
        }
        if failed || saved == frames {
            let there =
                format!("Saved the pictures of the tour; the last one is {}.", whole_path(&numbered(path, *saved)));
            self.end_saved_tour();
            if !failed {
                self.tell_done(there);
            }
            return;
        }
        let finest = self.engine.as_ref().filter(|engine| engine.is_finest());
        if let Some(shown) = finest.and_then(Engine::shown_level) {
            let why = format!("The picture shows a coarse level of the volume; {}", refined_by(shown.then));
            self.give_up_tour(&why);
            return;
        }
        let snapshot = finest.and_then(Engine::snapshot);
        let Some(snapshot) = snapshot else { return };
        let fits = self.tour.as_mut().is_some_and(|tour| tour.takes(snapshot.size()));
        if !fits {
            self.give_up_tour("The size of the picture changed");
            return;
        }
        let Some(Tour::Saving { path, saved, .. }) = &mut self.tour else { return };
        *saved += 1;
        let path = numbered(path, *saved);
        self.begin(None, move |_| snapshot.write_picture(&path).map(|()| None));
    }

    /// Whether any export is still to be written.
    pub(super) fn is_saving(&self) -> bool {
        self.is_saving_state() || self.saving.page().is_some()
    }

    /// Whether an export is still to be written that a change of the document could alter or delay.
    pub(super) fn is_saving_state(&self) -> bool {
        !self.saving.waiting.is_empty()
            || self.saving.writing.iter().any(|writing| writing.page.is_none())
            || self.saving.capture.is_some()
            || matches!(self.tour, Some(Tour::Saving { .. }))
    }
}

/// Notice of a saved page.
fn saved_page(path: &Path, summary: &Summary, anatomical: bool) -> String {
    let face = if anatomical { " A page of a head shows a face: send it only if the person agrees." } else { "" };
    format!(
        "Saved the page as {}: {:.1} MB, with at most ΔE00 {:.2} of rounding.{face}",
        whole_path(path),
        count(summary.bytes) / 1e6,
        summary.largest_error
    )
}

/// Absolute path, for display.
fn whole_path(path: &Path) -> String {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned()).display().to_string()
}

/// The way to refine a coarse level after `then`, as the end of a sentence.
fn refined_by(then: Refining) -> &'static str {
    match then {
        Refining::Failed => "its refinement failed: move the camera to try again, or open the file again",
        _ => "its refinement was stopped: change anything, or open the file again, to go on",
    }
}
