//! Reads affine transforms in the text format of ITK (`.tfm`, `.txt`).

use std::path::Path;

use glam::{DMat3, DVec3};
use relume_base::input;

/// Largest size of such a file, in bytes.
const LONGEST: u64 = 1 << 16;

/// The numbers by rows of the transform from the world of a moving volume to that of the fixed one, from a file of ITK. ITK states the other
/// direction, which resamples the moving volume.
pub(super) fn read(path: &Path) -> Result<[f64; 12], String> {
    let named = || path.display();
    let bytes =
        input::read(path, LONGEST).map_err(|error| format!("cannot read the transform {}: {error}", named()))?;
    let text = String::from_utf8_lossy(&bytes);
    let line = |key: &str| text.lines().find_map(|line| line.strip_prefix(key)).map(str::trim);
    let numbers =
        |key: &str| -> Option<Vec<f64>> { line(key)?.split_whitespace().map(|number| number.parse().ok()).collect() };
    let kind =
        line("Transform:").ok_or_else(|| format!("{} is no transform of ITK: it has no line Transform:", named()))?;
    let is_affine = ["AffineTransform", "MatrixOffsetTransformBase"].iter().any(|name| kind.starts_with(name));
    let several = text.lines().filter(|line| line.starts_with("Transform:")).count() > 1;
    if several || !is_affine {
        let what = if several { "several transforms" } else { kind };
        return Err(format!("{} has {what}; save one affine transform", named()));
    }
    let wrong = || format!("{}: an affine transform has 12 finite Parameters and 3 FixedParameters", named());
    let parameters = numbers("Parameters:").ok_or_else(wrong)?;
    let centre = numbers("FixedParameters:").filter(|centre| !centre.is_empty()).unwrap_or_else(|| vec![0.0; 3]);
    let ([.., _], 12, 3) = (&parameters[..], parameters.len(), centre.len()) else { return Err(wrong()) };
    let row = |i: usize| DVec3::new(parameters[3 * i], parameters[3 * i + 1], parameters[3 * i + 2]);
    let matrix = DMat3::from_cols(row(0), row(1), row(2)).transpose();
    let (shift, centre) = (DVec3::from_slice(&parameters[9..]), DVec3::from_slice(&centre));
    let back = matrix.inverse();
    if !back.is_finite() || !shift.is_finite() || !centre.is_finite() {
        return Err(format!("{}: the transform has no inverse", named()));
    }
    // y = M (x − c) + t + c.
    let offset = centre - back * (shift + centre);
    let (x, y, z) = (back.row(0), back.row(1), back.row(2));
    Ok([x.x, x.y, x.z, offset.x, y.x, y.y, y.z, offset.y, z.x, z.y, z.z, offset.z])
}
