//! File dialog to open and save, and the questions that follow about a file.

use std::fmt;
use std::path::{Path, PathBuf};

use egui::{Align2, Color32, Context, Id, Key, Modal, Theme, Vec2, vec2};
use egui_file_dialog::{DialogState, DirectoryEntry, FileDialog, FileDialogKeyBindings, Filter, OpeningMode};

use super::controls::leave_field;
use super::reading::{Answer, Reading};
use crate::document::Question;
use crate::document::Source;
use crate::view::action::{Action, File, Leaving, Losing};
use crate::volume::{self, Selection};

/// Initial size in points.
const SIZE: Vec2 = vec2(620.0, 380.0);

impl File {
    /// Title of the dialog.
    fn title(self) -> &'static str {
        match self {
            Self::Opened => "Open a scene or a volume",
            Self::Picture => "Save the picture as PNG",
            Self::LinearPicture => "Save the picture as linear OpenEXR",
            Self::Accumulators => "Save the film",
            Self::Page => "Save the picture as a page that relights",
            Self::Session => "Save the session",
        }
    }

    /// Action for the chosen `path`.
    fn action(self, path: PathBuf) -> Action {
        match self {
            Self::Opened => Action::Open(Box::new(Source::of(&path))),
            Self::Picture | Self::LinearPicture => Action::SavePicture(Some(path)),
            Self::Accumulators => Action::SaveAccumulators(Some(path)),
            Self::Page => Action::SavePage(Some(path)),
            Self::Session => Action::SaveSession(Some(path)),
        }
    }

    /// `path`, with the default extension if it has none.
    fn named(self, path: &Path) -> PathBuf {
        match self.kind() {
            Some((_, ending)) if path.extension().is_none() => path.with_extension(ending),
            _ => path.to_owned(),
        }
    }

    /// Name and extension of the kind of file saved.
    fn kind(self) -> Option<(&'static str, &'static str)> {
        match self {
            Self::Opened => None,
            Self::Picture => Some(("PNG pictures", "png")),
            Self::LinearPicture => Some(("OpenEXR pictures", "exr")),
            Self::Accumulators => Some(("Films", "exr")),
            Self::Page => Some(("Pages", "html")),
            Self::Session => Some(("Scenes and sessions", "toml")),
        }
    }
}

/// Current question.
enum Stage {
    /// Which file to open or save.
    File(File, Box<FileDialog>),
    /// Which volume a scene shows, and whether the scene names one, which was moved.
    Volume(Box<Source>, bool, Box<FileDialog>),
    /// How to read a file.
    Reading(Box<Reading>),
    /// What to do with unsaved work.
    Leaving(Leaving),
}

/// The file dialog, if open.
#[derive(Default)]
pub struct Chooser {
    stage: Option<Stage>,
    /// Whether the stage has not been shown yet.
    is_new: bool,
    /// Folder of the last chosen file.
    folder: Option<PathBuf>,
    /// Whether a field had the keyboard focus in the last frame.
    typed: bool,
}

impl fmt::Debug for Chooser {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { stage, folder, .. } = self;
        let mut fields = formatter.debug_struct("Chooser");
        match stage {
            None => {}
            Some(Stage::File(file, _)) => drop(fields.field("file", file)),
            Some(Stage::Volume(source, ..)) => drop(fields.field("source", source)),
            Some(Stage::Reading(reading)) => drop(fields.field("reading", reading)),
            Some(Stage::Leaving(leaving)) => drop(fields.field("leaving", leaving)),
        }
        fields.field("folder", folder).finish_non_exhaustive()
    }
}

impl Chooser {
    /// Whether a question is open; there is only one at a time.
    #[must_use]
    pub fn is_open(&self) -> bool {
        self.stage.is_some()
    }

    fn begin(&mut self, stage: Stage) {
        (self.stage, self.is_new) = (Some(stage), true);
    }

    /// Closes the dialog.
    pub fn close(&mut self) {
        self.stage = None;
    }

    /// Asks how to read the file at `source`. The selection `shown` is the initial answer.
    pub fn ask(&mut self, source: Source, question: Question, shown: &Selection) {
        self.begin(Stage::Reading(Box::new(Reading::new(source, question, shown))));
    }

    /// Asks which volume `scene` at `source` shows, because it names none or one that does not exist.
    pub fn ask_volume(&mut self, source: Source, (scene, is_named): (&Path, bool)) {
        let name = scene.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let folder = self.folder.as_deref().or(scene.parent());
        let mut dialog = dialog(&format!("Which volume should {name} show?"), folder);
        dialog = dialog.add_file_filter(VOLUMES, Filter::new(is_known)).default_file_filter(VOLUMES);
        dialog.pick_file();
        self.begin(Stage::Volume(Box::new(source), is_named, Box::new(dialog)));
    }

    /// Asks what to do with unsaved work.
    pub fn leave(&mut self, leaving: Leaving) {
        self.begin(Stage::Leaving(leaving));
    }

    /// Opens the dialog for `file` in the last folder, or else in the folder of `suggested`, whose file name is the
    /// initial name.
    pub fn open(&mut self, file: File, suggested: &Path) {
        let name = &*suggested.file_name().unwrap_or_default().to_string_lossy();
        let folder = self.folder.as_deref().or(suggested.parent());
        let mut dialog = dialog(file.title(), folder).default_file_name(name);
        if file == File::Opened {
            dialog = dialog.add_file_filter(KNOWN, Filter::new(is_known)).default_file_filter(KNOWN);
            dialog.pick_file();
        } else {
            // The dialog lists files of this kind; another extension must be typed.
            if let Some((kind, ending)) = file.kind() {
                dialog = dialog.add_save_extension(kind, ending).default_save_extension(kind);
            }
            dialog.save_file();
        }
        self.begin(Stage::File(file, Box::new(dialog)));
    }

    /// Shows the dialog. `losing` lists the unsaved work. Returns the action after the last answer.
    pub fn show(&mut self, context: &Context, losing: Losing) -> Option<Action> {
        if std::mem::take(&mut self.is_new) {
            // The widgets behind the dialog lose the keyboard focus.
            leave_field(context);
        }
        // The library uses the first Escape to leave the focused field. In a save dialog that is the name field, and
        // here Escape closes the dialog.
        let escape = self.typed && context.input(|input| input.key_pressed(Key::Escape));
        let picked = match self.stage.as_mut()? {
            Stage::File(file, _) if escape && *file != File::Opened => Some(None),
            Stage::File(file, dialog) => pick(context, *file, dialog),
            Stage::Volume(.., dialog) => pick(context, File::Opened, dialog),
            Stage::Reading(_) | Stage::Leaving(_) => None,
        };
        self.typed = context.memory(|memory| memory.focused().is_some());
        if let Some(picked) = picked {
            let stage = self.stage.take()?;
            return self.picked(stage, picked?);
        }
        match self.stage.as_mut()? {
            Stage::File(..) | Stage::Volume(..) => None,
            Stage::Reading(reading) => {
                let answer = reading.show(context)?;
                self.stage = None;
                match answer {
                    // Unsaved work was already handled before this question.
                    Answer::Open(source) => Some(Action::Leave(Leaving::Open(source))),
                    Answer::GivenUp => None,
                }
            }
            Stage::Leaving(leaving) => {
                let answer = unsaved(context, leaving, losing)?;
                self.stage = None;
                answer
            }
        }
    }

    /// Handles the file that was `picked`.
    fn picked(&mut self, stage: Stage, picked: PathBuf) -> Option<Action> {
        self.folder = picked.parent().map(Path::to_owned);
        match stage {
            Stage::File(file, _) => {
                let path = file.named(&picked);
                // With the extension added, the file may already exist, and the dialog has not asked about replacing
                // it.
                if path != picked && path.exists() {
                    self.open(file, &path);
                    return None;
                }
                Some(file.action(path))
            }
            Stage::Volume(source, is_named, _) => {
                Some(Action::Leave(Leaving::Open(Box::new(source.with_volume(&picked, is_named)))))
            }
            Stage::Reading(_) | Stage::Leaving(_) => None,
        }
    }
}

/// Names of the file filters for all files that can be opened, and for volumes only.
const KNOWN: &str = "Scenes and volumes";
const VOLUMES: &str = "Volumes";

/// Creates a dialog that starts in `folder`, if that exists.
fn dialog(title: &str, folder: Option<&Path>) -> FileDialog {
    let dialog = FileDialog::new()
        .title(title)
        .id("chooser")
        .opening_mode(OpeningMode::AlwaysInitialDir)
        .default_size(SIZE)
        .min_size([240.0, 160.0]);
    match folder.filter(|folder| folder.is_dir()) {
        Some(folder) => dialog.initial_directory(folder.to_owned()),
        None => dialog,
    }
}

/// Shows `dialog`. Returns the picked file, or `Some(None)` on cancel, or `None` while it is open.
fn pick(context: &Context, file: File, dialog: &mut FileDialog) -> Option<Option<PathBuf>> {
    let window = context.content_rect();
    let is_folder = dialog.selected_entry().is_some_and(DirectoryEntry::is_dir);
    let config = dialog.config_mut();
    // The question about replacing a file appears while no field has the focus. The Enter that confirmed the name must
    // not also answer it.
    let answers = file == File::Opened || is_folder || context.memory(|memory| memory.focused().is_some());
    config.keybindings.submit = if answers { FileDialogKeyBindings::default().submit } else { Vec::new() };
    // Centred, also if the window is resized.
    config.anchor = Some((Align2::CENTER_CENTER, Vec2::ZERO));
    // Small windows have no room for the list of places and the title bar.
    config.show_left_panel = window.width() > SIZE.x;
    config.title_bar = window.height() > SIZE.y;
    config.max_size = Some(window.size() - if config.title_bar { vec2(24.0, 48.0) } else { vec2(14.0, 14.0) });
    in_its_colours(context, || {
        dialog.update(context);
    });
    (*dialog.state() != DialogState::Open).then(|| dialog.take_picked())
}

/// Shows the dialog in a readable theme. Its search field is black even in the light theme, and it writes the selected
/// name in the colour of the selection background.
fn in_its_colours(context: &Context, show: impl FnOnce()) {
    let (theme, style) = (context.options(|options| options.theme_preference), context.style_of(Theme::Dark));
    context.set_theme(Theme::Dark);
    context.style_mut_of(Theme::Dark, |style| {
        style.visuals.selection.bg_fill = Color32::from_rgb(90, 160, 240);
        style.visuals.selection.stroke.color = Color32::BLACK;
    });
    show();
    context.set_style_of(Theme::Dark, style);
    context.set_theme(theme);
}

/// Asks what to do with unsaved work. Returns the resulting action, or `Some(None)` on cancel, or `None` without an
/// answer.
fn unsaved(context: &Context, leaving: &Leaving, losing: Losing) -> Option<Option<Action>> {
    let losing = losing.by(leaving);
    if !losing.anything() {
        // Everything has been saved in the meantime.
        return Some(Some(Action::Leave(leaving.clone())));
    }
    let verb = match leaving {
        Leaving::Open(_) => "Open",
        Leaving::Close => "Close",
    };
    let (heading, go_on) = if losing.changes {
        ("Discard the changes?".to_owned(), format!("{verb} without saving"))
    } else {
        (format!("{verb} before everything is saved?"), format!("{verb} now"))
    };
    let escape = context.input(|input| input.key_pressed(Key::Escape));
    let shown = Modal::new(Id::new("unsaved")).show(context, |ui| {
        ui.set_max_width(360.0);
        ui.heading(heading);
        if losing.changes {
            ui.label("The changes are not saved as a session, and will be lost.");
        }
        if losing.tour {
            ui.label("A tour is being saved: its remaining pictures will not be written.");
        }
        if losing.picture {
            ui.label("A picture, film or page waits for the full resolution: it will not be saved.");
        }
        if losing.page {
            ui.label("A page is being written: it will not be saved.");
        }
        ui.add_space(6.0);
        ui.horizontal_wrapped(|ui| {
            if losing.changes && ui.button("Save session…").clicked() {
                return Some(Some(Action::Choose(File::Session)));
            }
            if ui.button(go_on).clicked() {
                return Some(Some(Action::Leave(leaving.clone())));
            }
            (ui.button("Cancel").clicked() || escape).then_some(None)
        })
        .inner
    });
    shown.inner
}

/// Whether the extension of `path` is that of a scene or a volume.
fn is_known(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    volume::extensions().any(|known| name.ends_with(&format!(".{known}")))
}
