//! Windows over the picture.

use egui::style::ScrollStyle;
use egui::{Id, Pos2, Rect, Ui, Vec2, Window, WindowDrag};

/// Where a window belongs.
#[derive(Clone, Copy)]
struct Place {
    /// The picture that it was over last, and where it was.
    picture: Rect,
    shown: Pos2,
    /// Where a hand has put it.
    put: Option<Pos2>,
}

/// Shows a window of this `size` over `picture`, and says whether it stays open. It opens `at` this place and stays where it was
/// put: a picture that is too small for that pushes it aside, and gets it back when there is room again.
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
        // A window that is moved by its title takes no place from here.
        window = window.drag_area(WindowDrag::Anywhere).current_pos(put.unwrap_or(at));
    }
    let shown = window.show(ui.ctx(), |ui| {
        // Where not all fits, a bar says so.
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
