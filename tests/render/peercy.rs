//! Peercy's full matrices in the reference: the transmittance of a step is a matrix, composed front to back. No device marches
//! them.

use crate::support;

use nalgebra::{DMatrix, DVector};
use relume::film::Film;
use relume::model::Matrices;
use relume::number::Real;
use relume::plan::{PlanError, Transmittance, plan};
use relume::progress::Quiet;
use relume::render::RenderError;
use relume::scene::{Scene, StoreAs};
use relume::spectrum::{BANDS, Spectrum};
use support::rungs::{Rungs, with_renderer};
use support::scenes::{GLASS, SIZE, glass_straight_on, parsed};

/// The glass in this many coefficients with their matrices.
fn glass(k: usize) -> Scene {
    let accuracy = format!("[accuracy]\nmodel = \"peercy\"\nk = {k}\ninterpolation = \"exact_linear\"");
    parsed(&GLASS.replace("[accuracy]", &accuracy))
}

/// Slab with one value in front of a background, seen along its normal, in 64 steps.
fn slab(k: usize) -> Rungs {
    let accuracy = format!("step = 1\nmodel = \"peercy\"\nk = {k}");
    Rungs::new(glass_straight_on("\"blue sky\"", &accuracy), [1, 1])
}

fn wide<R: Real>(sums: &Film<R>) -> [Vec<f64>; 2] {
    [&sums.accumulators, &sums.transmittance].map(|numbers| numbers.iter().map(|number| number.to_f64()).collect())
}

/// The radiance is (1 + M + … + M⁶³)·s and the transmittance M⁶⁴, with the matrix M and the source s of one step; the
/// powers
/// come from an independent matrix library.
#[test]
fn a_slab_is_the_power_of_its_matrix() {
    for k in [3, 8] {
        let rungs = slab(k);
        let model = rungs.planned.model.clone().unwrap();
        let matrices = Matrices::new(&model);
        let material = &rungs.scene.materials[0];
        let scattering = -(-0.02_f64).ln_1p();
        let absorbed = material.absorption.as_ref().unwrap().spectrum();
        let depth = absorbed.samples().map(|part| 0.04f64.mul_add(part, scattering));
        let reflected = material.reflectance.spectrum().samples();
        let sent: [f64; BANDS] =
            std::array::from_fn(|band| scattering * reflected[band] * -(-depth[band]).exp_m1() / depth[band]);
        let met = DMatrix::from_row_slice(k, k, &matrices.matrix(&depth.map(|depth| (-depth).exp())));
        let source = DVector::from_vec(matrices.vector(&sent));
        let (mut through, mut back) = (DMatrix::identity(k, k), DVector::zeros(k));
        for _ in 0..64 {
            back += &through * &source;
            through *= &met;
        }
        let transmitted: Vec<f64> = through.transpose().as_slice().to_vec();
        let check = |rung: &str, [found, transmittance]: [Vec<f64>; 2], limit: f64| {
            assert_eq!((found.len(), transmittance.len()), (k, k * k), "{rung}");
            for (found, expected) in found.iter().zip(&back).chain(transmittance.iter().zip(&transmitted)) {
                assert!((found - expected).abs() <= limit, "{rung}, k = {k}: {found} for {expected}");
            }
        };
        check("reference f64", wide(&rungs.march::<f64>(&rungs.exact())), 1e-12);
        // A component of T sums k products per step, each rounded once, of numbers up to 1; so does a component of the
        // light.
        let limit = 64.0 * f64::from(u8::try_from(k).unwrap() + 2) * f64::from(f32::EPSILON);
        check("reference f32", wide(&rungs.march::<f32>(&rungs.stored())), limit);
    }
}

/// Everything a plan can have at once: highlights, several positions, a background.
#[test]
fn numbers_of_32_bits_march_matrices_as_those_of_64_do() {
    let rungs = Rungs::new(glass(5), SIZE);
    assert_eq!(rungs.planned.plan.transmittance, Transmittance::Mixed);
    let expected = wide(&rungs.march::<f64>(&rungs.stored()));
    let check = |rung: &str, found: [Vec<f64>; 2]| {
        for (found, expected) in found.iter().flatten().zip(expected.iter().flatten()) {
            // Some 60 samples at places rounded to f32, in ramps 0.05 of the value range wide.
            assert!((found - expected).abs() <= 5e-4, "{rung}: {found} for {expected}");
        }
    };
    check("reference f32", wide(&rungs.march::<f32>(&rungs.stored())));
}

/// White is 1 in every coefficient, no light is a zero matrix, and matrices without amplification stay within 1.
#[test]
fn matrices_are_those_of_an_orthonormal_basis() {
    for k in [1, 4, 8, 16] {
        let planned = plan(&glass(k), &Quiet).unwrap();
        let matrices = Matrices::new(planned.model.as_ref().unwrap());
        let is_one = |found: f64| assert!((found - 1.0).abs() <= 1e-9, "k = {k}: {found}");
        matrices.vector(&[1.0; BANDS]).into_iter().for_each(is_one);
        for (n, part) in matrices.matrix(&[1.0; BANDS]).into_iter().enumerate() {
            is_one(part + if n % (k + 1) == 0 { 0.0 } else { 1.0 });
        }
        let green = Spectrum::gaussian(540.0, 30.0, 1.0).unwrap();
        let met = DMatrix::from_row_slice(k, k, &matrices.matrix(green.samples()));
        assert!((&met - met.transpose()).abs().max() <= 1e-9, "k = {k}: symmetric");
        let most = met.symmetric_eigen().eigenvalues;
        assert!(most.iter().all(|&value| (-1e-9..=1.0 + 1e-9).contains(&value)), "k = {k}: {most}");
    }
}

/// Errors fall with the number of coefficients: 16 are visually equal to all wavelengths.
#[test]
fn the_errors_of_matrices_fall_with_their_size() {
    let error = |k: usize| {
        let planned = plan(&glass(k), &Quiet).unwrap();
        planned.model.as_ref().unwrap().lights().iter().map(|(.., matrix)| matrix.error.mean).fold(0.0, f64::max)
    };
    let errors = [3, 8, 16].map(error);
    assert!(errors[0] > errors[1] && errors[1] > errors[2] && errors[2] <= 0.05, "{errors:?}");
}

#[test]
fn matrices_are_refused_where_they_cannot_be() {
    let mut half = glass(4);
    half.accuracy.storage = StoreAs::Half;
    assert!(matches!(plan(&half, &Quiet), Err(PlanError::HalfMatrix)));
    let rungs = Rungs::new(glass(4), [2, 2]);
    with_renderer(|renderer| {
        let statistics = rungs.scene.volume().statistics().unwrap();
        let uploaded = renderer.upload(&rungs.scene, &rungs.planned, &statistics, &Quiet).unwrap();
        let refused = renderer.march(&rungs.scene, &rungs.planned, &uploaded, [2, 2], &Quiet).unwrap_err();
        assert!(matches!(refused, RenderError::Matrix), "{refused}");
    });
}
