//! Windows over the picture.

use egui::style::ScrollStyle;
use egui::{Id, Pos2, Rect, Ui, Vec2, Window, WindowDrag};

/// Position of a window.
#[derive(Clone, Copy)]
struct Place {
    /// Picture rectangle and window position in the last frame.
    picture: Rect,
    shown: Pos2,
    /// Position to which the user moved the window.
    put: Option<Pos2>,
}

/// Shows a window of this `size` over `picture`. Returns whether it stays open. It opens at `at` and stays where the
/// user moved it. A picture that is too small pushes it aside, and it returns when there is room again.
pub(super) fn show(
    ui: &Ui,
    (title, id): (&str, Id),
    picture: Rect,
    (at, size): (Pos2, Vec2),
    contents: impl FnOnce(&mut Ui),
) -> bool {
    let mut open = true;
    let kept = id.with("place");
    let known: Option<Place> = ui.data(|data| data.get_temp(kept));
    let put = known.and_then(|place| place.put);
    let is_same_picture = known.is_none_or(|known| known.picture == picture);
    let mut window = Window::new(title)
        .id(id)
        .open(&mut open)
        .default_pos(at)
        .default_size(size)
        .resizable(false)
        .constrain_to(picture);
    if !is_same_picture {
        // A window that is dragged by its title ignores `current_pos`.
        window = window.drag_area(WindowDrag::Anywhere).current_pos(put.unwrap_or(at));
    }
    let shown = window.show(ui.ctx(), |ui| {
        // A visible scroll bar shows that the contents do not fit.
        ui.spacing_mut().scroll = ScrollStyle::solid();
        contents(ui);
    });
    if let Some(shown) = shown.map(|shown| shown.response.rect.min) {
        let is_moved = is_same_picture && known.is_some_and(|known| known.shown != shown);
        let put = if is_moved && ui.input(|input| input.pointer.any_down()) { Some(shown) } else { put };
        ui.data_mut(|data| data.insert_temp(kept, Place { picture, shown, put }));
    }
    open
}
