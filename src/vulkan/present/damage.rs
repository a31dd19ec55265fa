//! Damage tracking of a window: only regions whose panels changed since the previous frame are redrawn. On a software
//! device, redrawing all panels takes longer than relighting a picture.

use std::sync::Arc;

use egui::Rect;
use egui::emath::Rot2;
use egui::epaint::{ClippedShape, Mesh, Shape, TessellationOptions, Tessellator, TextShape};
use glam::{IVec2, Vec2};

/// Margin around the reported bounds of a shape, in points or pixels, whichever is larger. It covers antialiased edges,
/// the strokes of circles, which lie outside the bounds, and mitred corners of lines.
const MARGIN: f32 = 3.0;
/// Pixels that joining two areas may add to the redraw. Each separate area costs a scan of all shapes.
const IN_VAIN: i64 = 4096;

/// A rectangle of pixels; `max` is exclusive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Area {
    pub(super) min: IVec2,
    pub(super) max: IVec2,
}

impl Area {
    const NONE: Self = Self { min: IVec2::ZERO, max: IVec2::ZERO };

    pub(super) fn is_empty(self) -> bool {
        self.min.cmpge(self.max).any()
    }

    pub(super) fn size(self) -> IVec2 {
        self.max - self.min
    }

    fn pixels(self) -> i64 {
        let size = self.size().max(IVec2::ZERO);
        i64::from(size.x) * i64::from(size.y)
    }

    fn common(self, other: Self) -> Self {
        Self { min: self.min.max(other.min), max: self.max.min(other.max) }
    }

    fn around(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Parts outside `other`: above, below, left and right of it.
    fn without(self, other: Self) -> impl Iterator<Item = Self> {
        let both = self.common(other);
        let both = if both.is_empty() { Self { min: self.max, max: self.max } } else { both };
        let parts = [
            Self { max: IVec2::new(self.max.x, both.min.y), ..self },
            Self { min: IVec2::new(self.min.x, both.max.y), ..self },
            Self { min: IVec2::new(self.min.x, both.min.y), max: IVec2::new(both.min.x, both.max.y) },
            Self { min: IVec2::new(both.max.x, both.min.y), max: IVec2::new(self.max.x, both.max.y) },
        ];
        parts.into_iter().filter(|part| !part.is_empty())
    }

    /// Pixels of the scissor rectangle that the panel renderer makes of `clip`. It truncates and does not round.
    fn of_clip(clip: Rect, pixels_per_point: f32, extent: IVec2) -> Self {
        let (low, high) = (vector(clip.min) * pixels_per_point, vector(clip.max) * pixels_per_point);
        let min = low.as_ivec2().max(IVec2::ZERO);
        let max = min.saturating_add((high - low).min(extent.as_vec2()).as_ivec2()).min(extent);
        Self { min, max }
    }

    /// The clip rectangle whose scissor covers exactly these pixels.
    fn clip(self, pixels_per_point: f32) -> Rect {
        let min = (self.min.as_vec2() + 0.25) / pixels_per_point;
        let max = (self.max.as_vec2() + 0.5) / pixels_per_point;
        Rect::from_min_max(min.to_array().into(), max.to_array().into())
    }
}

fn vector(point: egui::Pos2) -> Vec2 {
    Vec2::new(point.x, point.y)
}

/// The panels of a frame, and the ground that they cover.
pub(super) struct Panels {
    shapes: Vec<ClippedShape>,
    /// Pixels that each shape may cover.
    areas: Vec<Area>,
    ground: Ground,
}

/// The content below the panels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ground {
    /// Window size in pixels.
    pub(super) extent: IVec2,
    pub(super) pixels_per_point: f32,
    /// Pixels of the picture, if there is one.
    pub(super) picture: Option<Area>,
    /// Colour outside the picture.
    pub(super) background: [f32; 3],
}

impl Panels {
    pub(super) fn new(shapes: Vec<ClippedShape>, ground: Ground) -> Self {
        let areas = shapes.iter().map(|shape| area(shape, &ground)).collect();
        Self { shapes, areas, ground }
    }

    /// Returns disjoint areas outside the picture whose pixels differ from those of `before`.
    pub(super) fn damage(&self, before: Option<&Self>) -> Vec<Area> {
        let picture = self.ground.picture.unwrap_or(Area::NONE);
        let mut damage = Vec::new();
        match before.filter(|before| before.ground == self.ground) {
            None => damage.push(Area { min: IVec2::ZERO, max: self.ground.extent }),
            Some(before) => {
                let (gone, new) = changed(&before.shapes, &self.shapes);
                let areas = gone.into_iter().map(|at| before.areas[at]).chain(new.into_iter().map(|at| self.areas[at]));
                areas.flat_map(|area| area.without(picture)).for_each(|area| join(&mut damage, area));
            }
        }
        damage.into_iter().flat_map(|area| area.without(picture)).collect()
    }

    /// Shapes that intersect `area`, clipped to it.
    pub(super) fn within(&self, area: Area) -> impl Iterator<Item = ClippedShape> {
        let ground = self.ground;
        self.shapes.iter().zip(&self.areas).filter(move |(_, covered)| !covered.common(area).is_empty()).map(
            move |(shape, _)| {
                let seen = Area::of_clip(shape.clip_rect, ground.pixels_per_point, ground.extent).common(area);
                ClippedShape { clip_rect: seen.clip(ground.pixels_per_point), shape: shape.shape.clone() }
            },
        )
    }
}

/// Adds `area`, joined with the areas that it touches or nearly touches.
fn join(areas: &mut Vec<Area>, mut area: Area) {
    let one = |a: Area, b: Area| !a.common(b).is_empty() || a.around(b).pixels() <= a.pixels() + b.pixels() + IN_VAIN;
    while let Some(index) = areas.iter().position(|&other| one(other, area)) {
        area = areas.swap_remove(index).around(area);
    }
    areas.push(area);
}

/// Pixels that `shape` may cover.
fn area(shape: &ClippedShape, ground: &Ground) -> Area {
    let (bounds, scale) = (bounds(&shape.shape, ground.pixels_per_point), ground.pixels_per_point);
    let margin = Vec2::splat(MARGIN * scale.max(1.0));
    let covered = Area {
        min: (vector(bounds.min) * scale - margin).floor().as_ivec2(),
        max: (vector(bounds.max) * scale + margin).ceil().as_ivec2(),
    };
    covered.common(Area::of_clip(shape.clip_rect, scale, ground.extent))
}

/// Bounds of `shape` in points, without the margin.
fn bounds(shape: &Shape, pixels_per_point: f32) -> Rect {
    match shape {
        Shape::Vec(shapes) => {
            shapes.iter().map(|shape| bounds(shape, pixels_per_point)).fold(Rect::NOTHING, Rect::union)
        }
        // Selected text has a background that is higher than its letters.
        Shape::Text(text) => {
            let turn = Rot2::from_angle(text.angle);
            let rows = text.galley.rows.iter().filter(|row| !row.visuals.mesh.is_empty());
            let rows = rows.map(|row| row.visuals.mesh_bounds.translate(row.pos.to_vec2()).rotate_bb(turn));
            rows.fold(Rect::NOTHING, Rect::union).translate(text.pos.to_vec2())
        }
        // Sharp corners of a filled path may extend arbitrarily far.
        Shape::Path(path) if path.closed => {
            let options = TessellationOptions { coarse_tessellation_culling: false, ..TessellationOptions::default() };
            let mut mesh = Mesh::default();
            Tessellator::new(pixels_per_point, options, [1; 2], Vec::new()).tessellate_path(path, &mut mesh);
            mesh.calc_bounds()
        }
        shape => shape.visual_bounding_rect(),
    }
}

/// Indices in both lists of the shapes that differ.
fn changed(before: &[ClippedShape], now: &[ClippedShape]) -> (Vec<usize>, Vec<usize>) {
    if before.len() == now.len() {
        let pairs = before.iter().zip(now).enumerate();
        let places: Vec<usize> = pairs.filter(|(_, (a, b))| !same(a, b)).map(|(index, _)| index).collect();
        return (places.clone(), places);
    }
    let ahead = before.iter().zip(now).take_while(|(a, b)| same(a, b)).count();
    let (rest, of_now) = (&before[ahead..], &now[ahead..]);
    let behind = rest.iter().rev().zip(of_now.iter().rev()).take_while(|(a, b)| same(a, b)).count();
    ((ahead..before.len() - behind).collect(), (ahead..now.len() - behind).collect())
}

/// Whether both shapes look the same. Text with a new layout and shapes with NaN coordinates count as different.
fn same(a: &ClippedShape, b: &ClippedShape) -> bool {
    let shapes = match (&a.shape, &b.shape) {
        (Shape::Text(a), Shape::Text(b)) => same_text(a, b),
        // With debug assertions, egui panics on a comparison of NaN coordinates.
        (a, _) if is_nowhere(a) => false,
        (_, b) if is_nowhere(b) => false,
        (a, b) => a == b,
    };
    shapes && !a.clip_rect.any_nan() && !b.clip_rect.any_nan() && a.clip_rect == b.clip_rect
}

/// Whether a coordinate of `shape` is NaN.
fn is_nowhere(shape: &Shape) -> bool {
    match shape {
        Shape::Noop | Shape::Callback(_) => false,
        Shape::Vec(shapes) => shapes.iter().any(is_nowhere),
        Shape::Circle(circle) => circle.center.any_nan(),
        Shape::Ellipse(ellipse) => ellipse.center.any_nan() || ellipse.radius.any_nan(),
        Shape::LineSegment { points, .. } => points.iter().any(|point| point.any_nan()),
        Shape::Path(path) => path.points.iter().any(|point| point.any_nan()),
        Shape::Rect(rect) => rect.rect.any_nan(),
        Shape::Text(text) => text.pos.any_nan(),
        Shape::Mesh(mesh) => mesh.vertices.iter().any(|vertex| vertex.pos.any_nan() || vertex.uv.any_nan()),
        Shape::QuadraticBezier(curve) => curve.points.iter().any(|point| point.any_nan()),
        Shape::CubicBezier(curve) => curve.points.iter().any(|point| point.any_nan()),
    }
}

#[expect(clippy::float_cmp, reason = "what differs by anything is drawn anew")]
fn same_text(a: &TextShape, b: &TextShape) -> bool {
    let TextShape { pos, galley, underline, fallback_color, override_text_color, opacity_factor, angle } = a;
    // egui keeps a layout while it is visible. Comparing all glyphs would be slow.
    Arc::ptr_eq(galley, &b.galley)
        && !pos.any_nan()
        && !b.pos.any_nan()
        && *pos == b.pos
        && *underline == b.underline
        && *fallback_color == b.fallback_color
        && *override_text_color == b.override_text_color
        && *opacity_factor == b.opacity_factor
        && *angle == b.angle
}

#[cfg(test)]
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_precision_loss,
    clippy::cast_sign_loss,
    clippy::unwrap_used,
    reason = "pixels of a small window; the panels' renderer casts in the same way; a test fails by panicking"
)]
mod tests {
    use egui::epaint::Shadow;
    use egui::text_selection::{CCursorRange, visuals::paint_text_selection};
    use egui::{Color32, Context, CornerRadius, FontId, Pos2, RawInput, Stroke, Visuals};

    use super::*;

    const EXTENT: IVec2 = IVec2::new(97, 61);
    const PICTURE: Area = Area { min: IVec2::new(30, 0), max: IVec2::new(97, 52) };

    /// Pseudo-random numbers below a bound, with sufficient uniformity.
    struct Numbers(u64);

    impl Numbers {
        fn below(&mut self, bound: u64) -> u64 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 33) % bound
        }

        /// A rectangle in points, on a grid of 1/16, with sides below `most`.
        fn rect(&mut self, most: u64) -> Rect {
            let mut number = |bound| self.below(16 * bound) as f32 / 16.0;
            let min = Pos2::new(number(100) - 8.0, number(64) - 8.0);
            Rect::from_min_max(min, min + egui::vec2(number(most), number(most)))
        }

        fn shape(&mut self) -> ClippedShape {
            let (clip_rect, rect, colour) = (self.rect(90), self.rect(24), self.below(1 << 24));
            let [_, red, green, blue] = (colour as u32).to_be_bytes();
            let fill = Color32::from_rgb(red, green, blue);
            ClippedShape { clip_rect, shape: Shape::rect_filled(rect, CornerRadius::ZERO, fill) }
        }
    }

    /// Stack of colours drawn in each pixel.
    type Pixels = Vec<Vec<Color32>>;

    fn pixels(area: Area) -> impl Iterator<Item = usize> {
        (area.min.y..area.max.y).flat_map(move |y| (area.min.x..area.max.x).map(move |x| (y * EXTENT.x + x) as usize))
    }

    /// Imitates the panel renderer: it truncates clip rectangles to whole pixels and smooths edges over the next pixel.
    fn draw(on: &mut Pixels, shapes: impl IntoIterator<Item = ClippedShape>, scale: f32) {
        for ClippedShape { clip_rect: clip, shape } in shapes {
            let Shape::Rect(rect) = shape else { panic!("{shape:?}") };
            let edge = |low: f32, high: f32, most: i32| {
                let at = low * scale;
                let first = (at as i32).max(0);
                (first, (first + ((high * scale - at).min(most as f32) as u32) as i32).min(most))
            };
            let (left, right) = edge(clip.min.x, clip.max.x, EXTENT.x);
            let (top, bottom) = edge(clip.min.y, clip.max.y, EXTENT.y);
            let bounds = rect.rect * scale;
            let covered = Area {
                min: IVec2::new(left.max(bounds.min.x as i32 - 1), top.max(bounds.min.y as i32 - 1)),
                max: IVec2::new(right.min(bounds.max.x as i32 + 2), bottom.min(bounds.max.y as i32 + 2)),
            };
            if rect.rect.is_positive() {
                pixels(covered).for_each(|pixel| on[pixel].push(rect.fill));
            }
        }
    }

    #[test]
    fn what_is_drawn_anew_makes_the_frame_that_is_drawn_whole() {
        let mut numbers = Numbers(1);
        for scale in [1.0, 1.25, 1.5, 2.0, 0.8] {
            let ground = |picture| Ground { extent: EXTENT, pixels_per_point: scale, picture, background: [0.1; 3] };
            let mut shapes: Vec<_> = (0..40).map(|_| numbers.shape()).collect();
            let mut before: Option<Panels> = None;
            let mut shown: Pixels = vec![Vec::new(); (EXTENT.x * EXTENT.y) as usize];
            let (mut most, mut drawn) = (0, 0);
            for frame in 0..200 {
                let at = numbers.below(shapes.len() as u64) as usize;
                match numbers.below(8) {
                    0 => shapes.insert(at, numbers.shape()),
                    1 => drop(shapes.remove(at)),
                    2 => shapes[at].clip_rect = numbers.rect(90),
                    3 => {}
                    _ => shapes[at] = numbers.shape(),
                }
                // The picture appears late and disappears for a while.
                let picture = (frame > 20 && frame % 50 != 0).then_some(PICTURE);
                let panels = Panels::new(shapes.clone(), ground(picture));
                let damage = panels.damage(before.as_ref());
                for (index, area) in damage.iter().enumerate() {
                    assert!(!area.is_empty() && area.common(PICTURE).is_empty() | picture.is_none(), "{area:?}");
                    assert!(damage[..index].iter().all(|other| other.common(*area).is_empty()), "{damage:?}");
                }
                // Damaged areas are cleared before they are drawn.
                for area in damage.iter().copied().chain(picture) {
                    pixels(area).for_each(|pixel| shown[pixel].clear());
                }
                for area in damage.iter().copied().chain(picture) {
                    draw(&mut shown, panels.within(area), scale);
                }
                let mut whole: Pixels = vec![Vec::new(); shown.len()];
                draw(&mut whole, shapes.iter().cloned(), scale);
                let wrong = (0..whole.len()).find(|&pixel| whole[pixel] != shown[pixel]);
                assert_eq!(wrong, None, "frame {frame} at {scale}: {damage:?}");
                (most, drawn) =
                    (most + whole.len(), drawn + damage.iter().map(|area| area.pixels() as usize).sum::<usize>());
                before = Some(panels);
            }
            assert!(drawn < most / 2, "{drawn} of {most} pixels at {scale}");
        }
    }

    /// A fully selected text.
    fn selected(context: &Context, text: &str) -> Shape {
        let mut galley = None;
        let mut output = context.run_ui(RawInput::default(), |ui| {
            let text = text.to_owned();
            galley = Some(ui.painter().layout_no_wrap(text, FontId::proportional(13.0), Color32::WHITE));
        });
        output.textures_delta.clear();
        let mut galley = galley.unwrap();
        let all = CCursorRange::select_all(&galley);
        paint_text_selection(&mut galley, &Visuals::dark(), &all, None);
        Shape::galley(Pos2::new(40.3, 30.7), galley, Color32::WHITE)
    }

    #[test]
    fn what_is_drawn_of_a_shape_lies_in_its_area() {
        let context = Context::default();
        let at = |x: f32, y: f32| Pos2::new(x, y);
        let (ink, middle) = (Color32::from_rgb(1, 2, 3), at(40.0, 30.0));
        let spike = vec![at(40.0, 55.0), at(40.7, 15.0), at(41.5, 55.0)];
        let shadow = Shadow { offset: [2, 4], blur: 20, spread: 3, color: ink };
        let shapes = [
            ("selected text", selected(&context, "mnu 42\nnext")),
            ("selected spaces", selected(&context, "   ")),
            ("a spike", Shape::convex_polygon(spike.clone(), ink, Stroke::NONE)),
            ("its outline", Shape::closed_line(spike.clone(), Stroke::new(2.0, ink))),
            ("a sharp line", Shape::line(spike, Stroke::new(2.5, ink))),
            ("a line", Shape::line_segment([middle, at(60.0, 30.0)], Stroke::new(3.0, ink))),
            ("a ring", Shape::circle_stroke(middle, 8.0, Stroke::new(2.0, ink))),
            ("a disc", Shape::circle_filled(middle, 3.5, ink)),
            ("a shadow", shadow.as_shape(Rect::from_min_max(middle, at(60.0, 40.0)), CornerRadius::same(3)).into()),
            (
                "two",
                Shape::Vec(vec![Shape::circle_filled(middle, 2.0, ink), Shape::circle_filled(at(70.0, 9.0), 2.0, ink)]),
            ),
        ];
        for scale in [0.8, 1.0, 1.5, 3.0] {
            let extent = IVec2::splat(400);
            let ground = Ground { extent, pixels_per_point: scale, picture: None, background: [0.0; 3] };
            for (name, shape) in &shapes {
                let shape = ClippedShape { clip_rect: Rect::EVERYTHING, shape: shape.clone() };
                let (area, covered) = (area(&shape, &ground), shape.shape.clone());
                let options =
                    TessellationOptions { coarse_tessellation_culling: false, ..TessellationOptions::default() };
                let mut mesh = Mesh::default();
                Tessellator::new(scale, options, [1; 2], Vec::new()).tessellate_shape(covered, &mut mesh);
                assert!(!mesh.vertices.is_empty(), "{name}");
                for vertex in &mesh.vertices {
                    // Vertices outside the window are invisible.
                    let pixel = (vector(vertex.pos) * scale).clamp(Vec2::ZERO, extent.as_vec2());
                    let inside = pixel.cmpge(area.min.as_vec2()).all() && pixel.cmple(area.max.as_vec2()).all();
                    assert!(inside, "{name} at {scale}: {pixel} is not in {area:?}");
                }
            }
        }
    }

    #[test]
    fn places_that_are_no_numbers_are_compared_without_a_panic() {
        let nowhere = Shape::line_segment([Pos2::new(f32::NAN, 0.0); 2], Stroke::new(1.0, Color32::WHITE));
        let shape = || ClippedShape { clip_rect: Rect::EVERYTHING, shape: nowhere.clone() };
        assert!(!same(&shape(), &shape()));
    }

    #[test]
    fn nothing_is_drawn_anew_where_nothing_changed() {
        let mut numbers = Numbers(2);
        let shapes: Vec<_> = (0..10).map(|_| numbers.shape()).collect();
        let ground = Ground { extent: EXTENT, pixels_per_point: 1.0, picture: Some(PICTURE), background: [0.0; 3] };
        let before = Panels::new(shapes.clone(), ground);
        assert_eq!(Panels::new(shapes.clone(), ground).damage(Some(&before)), []);
        let moved = Ground { background: [1.0; 3], ..ground };
        let all: i64 = Panels::new(shapes, moved).damage(Some(&before)).iter().map(|area| area.pixels()).sum();
        assert_eq!(all, i64::from(EXTENT.x * EXTENT.y) - PICTURE.pixels(), "another background is everywhere");
    }
}
