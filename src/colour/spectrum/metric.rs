//! Perceptual size of a small colour difference: ΔE00 as a quadratic form of XYZ.

use glam::{DMat3, DVec3};
use nalgebra::{Matrix3, SymmetricEigen};

use super::colour::{Lab, Xyz, ciede2000, d65_white, lab_from_xyz};

/// Lower clamp of [`quadratic_form`], as a fraction of D65's white; darker differences do not matter.
const DARKEST: f64 = 0.002;

/// Returns the matrix `F` with |F·d| ≈ ΔE00 between `xyz` and `xyz + d`, for small `d`.
///
/// Each component of `xyz` is clamped to at least 0.002 of D65's white; darker and negative components count as that.
/// At |d| = 1e-4 the two agree to 0.02 % in the median and 0.4 % at worst.
pub fn difference_matrix(xyz: Xyz) -> DMat3 {
    let form = quadratic_form(xyz);
    let eigen = SymmetricEigen::new(Matrix3::from_fn(|row, column| form.col(column)[row]));
    DMat3::from_cols_array_2d(&std::array::from_fn(|column| {
        std::array::from_fn(|row| eigen.eigenvalues[row].max(0.0).sqrt() * eigen.eigenvectors[(column, row)])
    }))
}

/// Returns the symmetric matrix `G` = `F`ᵀ`F` of [`difference_matrix`]: d·G·d ≈ ΔE00².
pub fn quadratic_form(xyz: Xyz) -> DMat3 {
    const STEP: f64 = 1e-3;
    let white = d65_white();
    let clamped = Xyz(std::array::from_fn(|axis| xyz.0[axis].max(DARKEST * white.0[axis])));
    let lab = lab_from_xyz(clamped, white);
    // ΔE00² around `lab` by polarisation, because it has no derivatives at a chroma of 0.
    let squared = |step: DVec3| {
        let moved = Lab((DVec3::from(lab.0) + STEP * step).to_array());
        (ciede2000(lab, moved) / STEP).powi(2)
    };
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let single = axes.map(squared);
    let mut of_lab = DMat3::from_diagonal(single.into());
    for (a, b) in [(0, 1), (0, 2), (1, 2)] {
        let mixed = (squared(axes[a] + axes[b]) - single[a] - single[b]) / 2.0;
        of_lab.col_mut(a)[b] = mixed;
        of_lab.col_mut(b)[a] = mixed;
    }
    let lab_of_xyz = lab_slopes(clamped, white);
    lab_of_xyz.transpose() * of_lab * lab_of_xyz
}

/// Derivatives of L*, a*, b* (rows) with respect to X, Y, Z (columns).
fn lab_slopes(xyz: Xyz, white: Xyz) -> DMat3 {
    const KNEE: f64 = 6.0 / 29.0;
    let [x, y, z] = std::array::from_fn(|axis| {
        let t = xyz.0[axis] / white.0[axis];
        let slope = if t > KNEE.powi(3) { 1.0 / (3.0 * t.cbrt().powi(2)) } else { 1.0 / (3.0 * KNEE * KNEE) };
        slope / white.0[axis]
    });
    DMat3::from_cols(
        DVec3::new(0.0, 500.0 * x, 0.0),
        DVec3::new(116.0 * y, -500.0 * y, 200.0 * y),
        DVec3::new(0.0, 0.0, -200.0 * z),
    )
}
