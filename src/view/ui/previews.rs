//! Middle slices of the volumes among which a question asks, read in the background, one after the other.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

use egui::{
    Color32, ColorImage, Pos2, Rect, Response, Sense, TextureHandle, TextureOptions, Ui, Vec2, WidgetInfo, WidgetType,
    pos2,
};

use crate::progress::Progress;
use crate::view::task::Task;
use crate::volume::{Preview, RawLayout, Selection};

/// Longer side of a picture in points; its pixels are twice as fine, for dense screens.
const SIDE: f32 = 64.0;
/// Longer side of a picture in pixels.
const PIXELS: usize = 128;
/// Time between two looks at the background task.
const PAUSE: Duration = Duration::from_millis(50);

/// A volume of which a picture is shown.
pub(super) struct Place<'a> {
    pub(super) path: &'a Path,
    /// Layout of headerless voxels.
    pub(super) layout: Option<&'a RawLayout>,
    pub(super) selection: &'a Selection,
}

/// Pictures by the number of their alternative.
#[derive(Default)]
pub(super) struct Previews {
    /// Finished pictures; `None` where the volume cannot be read.
    made: BTreeMap<usize, Option<TextureHandle>>,
    /// The picture that is being read.
    job: Option<(usize, Task<Option<Preview>>)>,
}

impl std::fmt::Debug for Previews {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let reading = self.job.as_ref().map(|(index, _)| index);
        let made: Vec<_> = self.made.keys().collect();
        formatter.debug_struct("Previews").field("made", &made).field("reading", &reading).finish()
    }
}

impl Previews {
    /// Shows the picture of alternative `index`, or an empty frame as long as there is none, and begins to read it if
    /// it is visible and no other is being read.
    pub(super) fn show(&mut self, ui: &mut Ui, index: usize, place: Place<'_>) -> Response {
        self.take(ui);
        let (rect, response) = ui.allocate_exact_size(Vec2::splat(SIDE), Sense::click());
        if !ui.is_rect_visible(rect) {
            return response;
        }
        ui.painter().rect_filled(rect, 2.0, Color32::BLACK);
        match self.made.get(&index) {
            Some(Some(texture)) => {
                let name = format!("middle slice {index}");
                response.widget_info(|| WidgetInfo::labeled(WidgetType::Image, true, &name));
                let size = texture.size_vec2() * (SIDE / texture.size_vec2().max_elem());
                let place = Rect::from_center_size(rect.center(), size);
                let whole = Rect::from_min_max(Pos2::ZERO, pos2(1.0, 1.0));
                ui.painter().image(texture.id(), place, whole, Color32::WHITE);
            }
            Some(None) => {}
            None => self.begin(ui, index, place),
        }
        response
    }

    /// Reads the picture of alternative `index`, unless another one is being read.
    fn begin(&mut self, ui: &Ui, index: usize, Place { path, layout, selection }: Place<'_>) {
        if !path.exists() {
            self.made.insert(index, None);
            return;
        }
        if self.job.is_none() {
            let (path, layout, selection) = (path.to_owned(), layout.cloned(), selection.clone());
            // Errors appear when the volume is opened.
            let read =
                move |progress: &dyn Progress| Preview::open(&path, layout.as_ref(), &selection, PIXELS, progress).ok();
            self.job = Some((index, Task::start(|| {}, read)));
        }
        ui.ctx().request_repaint_after(PAUSE);
    }

    /// Takes over a picture that has been read.
    fn take(&mut self, ui: &Ui) {
        let Some((index, job)) = &mut self.job else { return };
        let Some(made) = job.take() else {
            ui.ctx().request_repaint_after(PAUSE);
            return;
        };
        let texture = made.map(|Preview { width, height, grey }| {
            let image = ColorImage::from_gray([width, height], &grey);
            ui.ctx().load_texture(format!("preview {index}"), image, TextureOptions::LINEAR)
        });
        self.made.insert(*index, texture);
        self.job = None;
        ui.ctx().request_repaint();
    }
}
