//! Unphysical reflectances: negative ones and metameric blacks.

use glam::DVec3;

use super::bound::BLACK_DELTA_E;
use super::left::{delta_e, worst};
use super::slab::{Picture, Slab};
use super::{Bound, Extreme, ExtremeError, Group};
use relume_colour::spectrum::colour::OBSERVER;
use relume_colour::spectrum::{Reflectance, Spectrum, standard};
use relume_scene::Scene;

/// Amplitudes of metameric blacks: of a surface, a designed one and a pseudo-inverse (docs/theory/numerics.md).
pub(super) const AMPLITUDES: [f64; 3] = [0.7, 4.0, 270.0];

pub(super) fn extremes() -> Vec<Extreme> {
    let mut all = vec![opposites()];
    for accumulate in ["weights", "spectral"] {
        all.push(darker_than_black(accumulate));
    }
    for amplitude in AMPLITUDES {
        let scene = move || Ok(vec![Picture::of(black_slab(amplitude)?)]);
        let slab = slab();
        let name = format!("a metameric black of amplitude {amplitude}, k = 8");
        let bound = Bound::picture(SAMPLES);
        all.push(Extreme::shown(
            Group::Spectra,
            format!("{name}, relative to its terms"),
            bound,
            scene,
            move |lefts| worst(lefts.iter().flat_map(|left| [slab.error(left), slab.picture_error(left)])),
        ));
        let bound = Bound::given(
            "metameric black",
            BLACK_DELTA_E,
            "docs/theory/acceptance.md C18: the rest of cancelling terms, and the error of the model, must be invisible; ΔE00 from \
             black, where 1e-3 of XYZ is ΔE00 8.6",
        );
        all.push(Extreme::shown(Group::Spectra, format!("{name}, relative to black"), bound, scene, |lefts| {
            worst(lefts.iter().map(|left| delta_e(left.xyz(0), DVec3::ZERO)))
        }));
    }
    all
}

/// Samples of the march through [`black_slab`].
const SAMPLES: f64 = 500.0;

/// Slab of [`SAMPLES`] samples and dimension 8.
fn slab() -> Slab {
    let accuracy = "accumulate = \"spectral\"\nk = 8".to_owned();
    Slab { dims: [3, 3, 501], opacity: 0.01, accuracy, ..Slab::default() }
}

/// Returns [`slab`] with a metameric black under D65. Three common materials at values outside the volume are part of
/// the scene, because a model of the black alone could represent it with small coefficients.
pub(super) fn black_slab(amplitude: f64) -> Result<Scene, ExtremeError> {
    let mut scene = slab().scene()?;
    let reflectance = Reflectance::new(metameric_black(amplitude))?;
    scene.materials.iter_mut().for_each(|material| material.reflectance = reflectance.clone());
    let others = scene.materials.first().cloned().zip(scene.transfer.terms.first().cloned());
    for (i, name) in ["blue", "orange", "foliage"].into_iter().enumerate() {
        let Some((mut material, mut term)) = others.clone() else { break };
        material.name = name.to_owned();
        material.reflectance = standard::reflectance(name)?;
        // Values that no voxel has.
        term.opacity.iter_mut().for_each(|point| point.0 += 1000.0);
        term.material.0 = vec![(1000.0, i + 1)];
        scene.materials.push(material);
        scene.transfer.terms.push(term);
    }
    Ok(scene)
}

/// Returns a spectrum of peak `amplitude` that is black under D65: a sine wave minus its projection onto the products
/// of D65 and the colour matching functions.
#[must_use]
pub fn metameric_black(amplitude: f64) -> Spectrum {
    let seen = OBSERVER.iter().map(|matching| standard::d65().spectrum() * matching);
    let mut axes: Vec<Spectrum> = Vec::new();
    let part = |spectrum: Spectrum, axis: &Spectrum| &spectrum + &axis.scaled(-axis.dot(&spectrum));
    // Projects twice to remove rounding residue.
    let less = |spectrum: &Spectrum, axes: &[Spectrum]| axes.iter().chain(axes).fold(spectrum.clone(), part);
    for spectrum in seen {
        let rest = less(&spectrum, &axes);
        axes.push(rest.scaled(1.0 / rest.dot(&rest).sqrt()));
    }
    let wave = less(&Spectrum::from_fn(|nm| (nm / 25.0).sin()), &axes);
    let peak = wave.samples().iter().fold(0.0_f64, |peak, sample| peak.max(sample.abs()));
    wave.scaled(amplitude / peak)
}

/// Two materials of opposite reflectance in equal parts.
fn opposites() -> Extreme {
    let scene = || -> Result<Vec<Picture>, ExtremeError> {
        let slab = Slab { dims: [5, 5, 33], accuracy: "accumulate = \"weights\"".to_owned(), ..Slab::default() };
        let mut scene = slab.scene()?;
        let Some((mut other, mut term)) = scene.materials.first().cloned().zip(scene.transfer.terms.first().cloned())
        else {
            return Ok(Vec::new());
        };
        other.name = "other".into();
        other.reflectance = Reflectance::new(other.reflectance.spectrum().scaled(-1.0))?;
        scene.materials.push(other);
        term.material.0.iter_mut().for_each(|point| point.1 = 1);
        scene.transfer.terms.push(term);
        Ok(vec![Picture::of(scene)])
    };
    Extreme::shown(Group::Spectra, "opposite reflectances cancel", Bound::picture(32.0), scene, |lefts| {
        worst(lefts.iter().map(|left| {
            let hides = 1.0 - 0.81_f64.powi(32);
            let halves = (0..2).map(|c| (left.weight(c, 0) - 0.5 * hides).abs() / (0.5 * hides));
            let size: DVec3 = left.matrices.colours.iter().map(|colour| 0.5 * hides * colour.abs()).sum();
            let shines = left.picture.first().map_or(DVec3::NAN, |colour| colour.abs() / size);
            worst(halves.chain(shines.to_array()))
        }))
    })
}

/// A reflectance of −0.5 at all wavelengths: it removes light, and nothing is clamped.
fn darker_than_black(accumulate: &'static str) -> Extreme {
    let k = if accumulate == "spectral" { "k = 4" } else { "" };
    let accuracy = format!("accumulate = \"{accumulate}\"\n{k}");
    let slab = Slab { reflectance: "-0.5", accuracy, ..Slab::default() };
    let asked = slab.clone();
    let scene = move || Ok(vec![asked.picture()?]);
    let name = format!("a reflectance of -0.5, {accumulate}");
    Extreme::shown(Group::Spectra, name, Bound::picture(8.0), scene, move |lefts| {
        worst(lefts.iter().flat_map(|left| [slab.error(left), slab.picture_error(left)]))
    })
}
