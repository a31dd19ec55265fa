//! Shapes: factors on the medium of a term by two numbers of a place together, its value and the gradient magnitude or the value of another
//! field.

use std::sync::Arc;

use relume_base::number::count;

use super::curve::factor_at;

/// A factor on scattering and absorption over a plane: the value of the term's field along one axis, a second number along the other.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// The second number.
    pub second: Second,
    /// The factor over the plane.
    pub form: Form,
}

/// The second number of a [`Shape`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Second {
    /// The gradient magnitude of the first field, in data units per world unit.
    Gradient,
    /// The value of the field with this name.
    Field(String),
}

/// The factor of a [`Shape`], from 0 to 1.
#[derive(Clone, Debug, PartialEq)]
pub enum Form {
    /// 1 inside a polygon, 0 outside.
    Polygon {
        /// Corners (value, second number) in order, at least three.
        corners: Vec<[f64; 2]>,
        /// Width of the rise behind the edges, as a part of the polygon's box, from 0 to 0.5.
        soft: f64,
    },
    /// By the second number divided by the value: points (ratio, factor), ratios ascending; constant beyond the ends.
    Ratio(Vec<(f64, f64)>),
    /// By a picture.
    Painted(Painting),
}

/// A picture of factors over ranges of both numbers; linear between the centres of its pixels, constant beyond them.
#[derive(Clone, Debug, PartialEq)]
pub struct Painting {
    /// Its file, as the scene states it.
    pub file: String,
    /// Values at the left and at the right edge.
    pub values: [f64; 2],
    /// Second numbers at the lower and at the upper edge.
    pub second: [f64; 2],
    /// Pixels of a row.
    pub columns: usize,
    /// Factors row by row, the lowest first.
    pub heights: Arc<[f32]>,
}

/// Usual rise behind the edges of a polygon, as a part of its box.
pub const SOFT: f64 = 0.1;

/// Most corners of a polygon.
pub const MOST_CORNERS: usize = 64;

/// Rows and columns of the table of a shape.
pub const SHAPE_EDGE: usize = 256;

impl Shape {
    /// The factor at a value and a second number; NaN, outside the box of another field, is the lowest one.
    #[must_use]
    pub fn at(&self, value: f64, second: f64) -> f64 {
        let second = if second.is_nan() { f64::NEG_INFINITY } else { second };
        match &self.form {
            // No gradient is below 0, so nothing fades there.
            Form::Polygon { corners, soft } => {
                in_polygon(corners, *soft, [value, second], self.second == Second::Gradient)
            }
            Form::Ratio(points) => {
                let ratio = match (second > 0.0, value > 0.0) {
                    (false, _) => 0.0,
                    (true, false) => f64::INFINITY,
                    (true, true) => second / value,
                };
                factor_at(points, ratio)
            }
            Form::Painted(painting) => painting.at(value, second),
        }
    }

    /// Ranges of both numbers beyond which the factor is constant, or which data with these `domains` do not leave.
    #[must_use]
    pub fn extent(&self, domains: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
        match &self.form {
            // With a frame of zeros.
            Form::Polygon { corners, .. } => around(corners).map(|[low, high]| {
                let cell = (high - low) / (count(SHAPE_EDGE) - 3.0);
                [low - cell, high + cell]
            }),
            Form::Ratio(_) => domains,
            Form::Painted(painting) => [painting.values, painting.second],
        }
    }

    /// True if a scene may state it, of a polygon: 3 to [`MOST_CORNERS`] finite corners that are not on a line along an axis.
    #[must_use]
    pub fn is_allowed(&self) -> bool {
        let Form::Polygon { corners, soft } = &self.form else { return true };
        let are_finite = corners.iter().flatten().all(|number| number.is_finite());
        let has_area = || around(corners).iter().all(|[low, high]| low < high);
        (3..=MOST_CORNERS).contains(&corners.len()) && are_finite && has_area() && (0.0..=0.5).contains(soft)
    }

    /// The same over other values.
    pub(crate) fn stretched(&self, moved: impl Fn(f64) -> f64) -> Self {
        let mut shape = self.clone();
        match &mut shape.form {
            Form::Polygon { corners, .. } => corners.iter_mut().for_each(|corner| corner[0] = moved(corner[0])),
            Form::Ratio(_) => {}
            Form::Painted(painting) => painting.values = painting.values.map(moved),
        }
        shape
    }

    /// True if the factor is 1 everywhere.
    pub(crate) fn is_one(&self) -> bool {
        match &self.form {
            Form::Polygon { .. } => false,
            Form::Ratio(points) => points.iter().all(|point| point.1 >= 1.0),
            Form::Painted(painting) => painting.heights.iter().all(|&height| height >= 1.0),
        }
    }
}

/// The box of a polygon.
fn around(corners: &[[f64; 2]]) -> [[f64; 2]; 2] {
    std::array::from_fn(|axis| {
        let numbers = corners.iter().map(|corner| corner[axis]);
        [numbers.clone().fold(f64::INFINITY, f64::min), numbers.fold(f64::NEG_INFINITY, f64::max)]
    })
}

/// The factor of a polygon at a point; at an edge along a second number of 0 it may stay.
fn in_polygon(corners: &[[f64; 2]], soft: f64, point: [f64; 2], stays_at_0: bool) -> f64 {
    let ranges = around(corners);
    let unit = |point: [f64; 2]| -> [f64; 2] {
        std::array::from_fn(|axis| (point[axis] - ranges[axis][0]) / (ranges[axis][1] - ranges[axis][0]))
    };
    let [x, y] = unit(point);
    if !((0.0..=1.0).contains(&x) && (0.0..=1.0).contains(&y)) {
        return 0.0;
    }
    let corners: Vec<[f64; 2]> = corners.iter().map(|&corner| unit(corner)).collect();
    let edges = || corners.iter().zip(corners.iter().cycle().skip(1));
    let crosses = |(a, b): &(&[f64; 2], &[f64; 2])| {
        (a[1] > y) != (b[1] > y) && x < a[0] + (b[0] - a[0]) * ((y - a[1]) / (b[1] - a[1]))
    };
    if edges().filter(crosses).count() % 2 == 0 {
        return 0.0;
    }
    let distance = |(a, b): (&[f64; 2], &[f64; 2])| {
        let (along, from) = ([b[0] - a[0], b[1] - a[1]], [x - a[0], y - a[1]]);
        let square = along[0].mul_add(along[0], along[1] * along[1]);
        let part =
            if square > 0.0 { (along[0].mul_add(from[0], along[1] * from[1]) / square).clamp(0.0, 1.0) } else { 0.0 };
        (from[0] - part * along[0]).hypot(from[1] - part * along[1])
    };
    let at_0 = -ranges[1][0] / (ranges[1][1] - ranges[1][0]);
    let fades = |(a, b): &(&[f64; 2], &[f64; 2])| !(stays_at_0 && a[1] <= at_0 && b[1] <= at_0);
    let nearest = edges().filter(fades).map(distance).fold(f64::INFINITY, f64::min);
    if soft > 0.0 { (nearest / soft).min(1.0) } else { 1.0 }
}

impl Painting {
    fn at(&self, value: f64, second: f64) -> f64 {
        let rows = self.heights.len() / self.columns;
        let place = |[low, high]: [f64; 2], number: f64, pixels: usize| {
            ((number - low) / (high - low) * count(pixels) - 0.5).clamp(0.0, count(pixels - 1))
        };
        let [x, y] = [place(self.values, value, self.columns), place(self.second, second, rows)];
        let height = |column: usize, row: usize| {
            let [column, row] = [column.min(self.columns - 1), row.min(rows - 1)];
            f64::from(self.heights[row * self.columns + column])
        };
        let [left, low] = [x, y].map(|place| relume_base::number::Real::index(place.floor()));
        let [across, up] = [x - x.floor(), y - y.floor()];
        let row = |row: usize| across.mul_add(height(left + 1, row) - height(left, row), height(left, row));
        up.mul_add(row(low + 1) - row(low), row(low))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() <= 1e-12
    }

    #[test]
    fn a_triangle_rises_behind_its_edges() {
        let corners = vec![[100.0, 0.0], [50.0, 200.0], [150.0, 200.0]];
        let shape = |soft| Shape { second: Second::Gradient, form: Form::Polygon { corners: corners.clone(), soft } };
        for (value, second, factor) in
            [(100.0, 150.0, 1.0), (100.0, -1.0, 0.0), (60.0, 100.0, 0.0), (76.0, 100.0, 1.0), (100.0, 201.0, 0.0)]
        {
            assert!(close(shape(0.0).at(value, second), factor), "{value}, {second}");
        }
        // 20 of 200 below the upper edge.
        assert!(close(shape(0.2).at(100.0, 180.0), 0.5));
        assert!(close(shape(0.2).at(100.0, f64::NAN), 0.0));
        // A box on the axis of gradients fades at three sides.
        let corners = vec![[0.0, 0.0], [100.0, 0.0], [100.0, 50.0], [0.0, 50.0]];
        let on_axis = Shape { second: Second::Gradient, form: Form::Polygon { corners, soft: 0.2 } };
        assert!(
            close(on_axis.at(50.0, 0.0), 1.0)
                && close(on_axis.at(10.0, 0.0), 0.5)
                && close(on_axis.at(50.0, 45.0), 0.5)
        );
    }

    #[test]
    fn a_ratio_is_the_second_number_by_the_value() {
        let points = vec![(0.5, 0.0), (1.5, 1.0)];
        let shape = Shape { second: Second::Field("b".to_owned()), form: Form::Ratio(points) };
        for (value, second, factor) in [
            (10.0, 10.0, 0.5),
            (10.0, 20.0, 1.0),
            (0.0, 1.0, 1.0),
            (0.0, 0.0, 0.0),
            (-4.0, -8.0, 0.0),
            (10.0, f64::NAN, 0.0),
        ] {
            assert!(close(shape.at(value, second), factor), "{value}, {second}");
        }
    }

    #[test]
    fn a_painting_is_linear_between_its_pixels() {
        let painting = Painting {
            file: String::new(),
            values: [0.0, 20.0],
            second: [0.0, 4.0],
            columns: 2,
            heights: [0.0, 1.0, 0.5, 0.5].into(),
        };
        let shape = Shape { second: Second::Gradient, form: Form::Painted(painting) };
        for (value, second, factor) in [
            (5.0, 1.0, 0.0),
            (15.0, 1.0, 1.0),
            (10.0, 1.0, 0.5),
            (15.0, 2.0, 0.75),
            (100.0, -9.0, 1.0),
            (-9.0, 9.0, 0.5),
        ] {
            assert!(close(shape.at(value, second), factor), "{value}, {second}");
        }
    }
}
