//! The dialog in which a file is chosen: what is opened, and where something is saved.

use std::fmt;
use std::path::{Path, PathBuf};

use egui::{Context, Vec2, vec2};
use egui_file_dialog::{DialogState, FileDialog, Filter, OpeningMode};

use crate::view::action::{Action, File};
use crate::volume;

/// Points that it takes at first.
const SIZE: Vec2 = vec2(620.0, 380.0);

impl File {
    /// What the dialog is called.
    fn title(self) -> &'static str {
        match self {
            Self::Opened => "Open a scene or a volume",
            Self::Picture => "Save the picture as PNG",
            Self::LinearPicture => "Save the picture as linear OpenEXR",
            Self::Accumulators => "Save the accumulators",
            Self::Session => "Save the session",
        }
    }

    /// What is done with `path`, once it is chosen.
    fn action(self, path: PathBuf) -> Action {
        match self {
            Self::Opened => Action::Open(path),
            Self::Picture | Self::LinearPicture => Action::SavePicture(Some(path)),
            Self::Accumulators => Action::SaveAccumulators(Some(path)),
            Self::Session => Action::SaveSession(Some(path)),
        }
    }

    /// What a name ends in that ends in nothing.
    fn ending(self) -> Option<&'static str> {
        match self {
            Self::Opened => None,
            Self::Picture => Some("png"),
            Self::LinearPicture | Self::Accumulators => Some("exr"),
            Self::Session => Some("toml"),
        }
    }
}

/// The dialog, while there is one.
#[derive(Default)]
pub struct Chooser {
    open: Option<(File, FileDialog)>,
    /// The folder that a file was last chosen in.
    folder: Option<PathBuf>,
}

impl fmt::Debug for Chooser {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { open, folder } = self;
        let file = open.as_ref().map(|(file, _)| file);
        formatter.debug_struct("Chooser").field("open", &file).field("folder", folder).finish_non_exhaustive()
    }
}

impl Chooser {
    /// Whether a file is being chosen; nothing else is asked for meanwhile.
    #[must_use]
    pub fn is_open(&self) -> bool {
        self.open.is_some()
    }

    /// Begins to choose `file`, in the folder of the last one, else in that of `suggested`, whose name a file that is saved has
    /// at first.
    pub fn open(&mut self, file: File, suggested: &Path) {
        let name = &*suggested.file_name().unwrap_or_default().to_string_lossy();
        let mut dialog = FileDialog::new()
            .title(file.title())
            .id("chooser")
            .opening_mode(OpeningMode::AlwaysInitialDir)
            .default_file_name(name)
            .default_size(SIZE)
            .min_size([240.0, 160.0]);
        let folder = self.folder.as_deref().or(suggested.parent()).filter(|folder| folder.is_dir());
        if let Some(folder) = folder {
            dialog = dialog.initial_directory(folder.to_owned());
        }
        if file == File::Opened {
            const KNOWN: &str = "Scenes and volumes";
            dialog = dialog.add_file_filter(KNOWN, Filter::new(is_known)).default_file_filter(KNOWN);
            dialog.pick_file();
        } else {
            dialog.save_file();
        }
        self.open = Some((file, dialog));
    }

    /// Shows it. What is to be done with the file, once it is chosen.
    pub fn show(&mut self, context: &Context) -> Option<Action> {
        let (file, dialog) = self.open.as_mut()?;
        let window = context.content_rect();
        let config = dialog.config_mut();
        config.default_pos = Some((window.center() - SIZE / 2.0).max(window.min));
        config.max_size = Some(window.size() - vec2(24.0, 48.0));
        // In small windows there is no room for places.
        config.show_left_panel = window.width() > SIZE.x;
        dialog.update(context);
        if *dialog.state() == DialogState::Open {
            return None;
        }
        let (file, picked) = (*file, dialog.take_picked());
        self.open = None;
        let path = picked?;
        self.folder = path.parent().map(Path::to_owned);
        match file.ending() {
            // With the end that it gets, it may be there already: the dialog has not asked whether it may be replaced.
            Some(ending) if path.extension().is_none() => {
                let path = path.with_extension(ending);
                if path.exists() {
                    self.open(file, &path);
                    return None;
                }
                Some(file.action(path))
            }
            _ => Some(file.action(path)),
        }
    }
}

/// Whether a file of this name may be a scene or a volume.
fn is_known(path: &Path) -> bool {
    let ending = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    volume::extensions().any(|known| known == ending)
}
