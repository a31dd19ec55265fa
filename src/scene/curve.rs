//! Curves of points, linear between them and constant beyond their ends.

/// A factor where the gradient has this `magnitude`; 1 without points.
#[must_use]
pub fn factor_at(factor: &[(f64, f64)], magnitude: f64) -> f64 {
    if factor.is_empty() { 1.0 } else { height_at(factor, magnitude) }
}

/// The height of a curve at `value`, linear between its points; 0 without points.
pub(crate) fn height_at(curve: &[(f64, f64)], value: f64) -> f64 {
    let after = curve.partition_point(|point| point.0 < value);
    let here = curve.iter().skip(after).take_while(|point| point.0 <= value).map(|point| point.1);
    if let Some(highest) = here.reduce(f64::max) {
        return highest;
    }
    match (after.checked_sub(1).and_then(|i| curve.get(i)), curve.get(after)) {
        (Some(&(v0, o0)), Some(&(v1, o1))) => o0 + (o1 - o0) * ((value - v0) / (v1 - v0)),
        (Some(&(_, end)), None) | (None, Some(&(_, end))) => end,
        (None, None) => 0.0,
    }
}
