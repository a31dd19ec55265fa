//! Interference of light in a thin film on a material (docs/theory/thin-films.md).

use std::fmt;
use std::ops::RangeInclusive;
use std::sync::{Arc, OnceLock};

use nalgebra::{Complex, DMatrix};
use rayon::prelude::*;

use super::colour::{OBSERVER, Xyz, ciede2000, d65_white, lab_from_xyz, xyz_of};
use super::observer::Observer;
use super::{BANDS, Light, STEP_NM, Spectrum, standard};
use relume_base::number::{count, whole};

/// Range of refractive indices.
pub const INDICES: RangeInclusive<f64> = 1.0..=5.0;

/// Range of the thickness of a film, in nm. Within a band, a thicker film reflects the mean of several fringes.
pub const THICKNESSES: RangeInclusive<f64> = 0.0..=5000.0;

/// Angles at which tables of a march hold the reflectance of a film: cosines from 0 to 1, evenly spaced.
pub const THIN_FILM_ANGLES: usize = 128;

/// Angles of the tables for all 81 wavelengths, the reference.
pub const FINE_ANGLES: usize = 1025;

/// Most times as bright as under a light of intensity 1 that a dim angle is shown where errors are measured.
const BRIGHTENED: f64 = 10.0;

/// Angles at which errors are measured, of cosines 0.01 to 0.99.
const CHECKED: usize = 99;

/// Most terms of a film.
const MOST_TERMS: usize = 32;

/// Smallest cosine: at grazing incidence both amplitudes are 0 / 0 where all indices are equal.
const GRAZING: f64 = 1e-5;
/// Smallest square of a cosine in a medium, less than that of [`GRAZING`].
const CRITICAL: f64 = 1e-14;

/// A thin film between two media. Indices are real numbers, equal at all wavelengths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layers {
    /// Refractive index of the film.
    pub index: f64,
    /// Its thickness in nm.
    pub thickness_nm: f64,
    /// Refractive index of the medium from which light comes.
    pub above: f64,
    /// Refractive index of the medium behind the film.
    pub below: f64,
}

/// Angle at which a film reflects.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ThinFilmAngle {
    /// The cosine is the mean of |n·l| and |n·v|: the film is the reflectance of the diffuse part.
    #[default]
    Facing,
    /// The cosine is |l·h|: the film is the reflectance of the highlight.
    Lobe,
}

/// Why there is no such film.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("film.{key} = {value}; it must be a number from {least} to {most}")]
pub struct ThinFilmError {
    /// The number, by its key.
    pub key: &'static str,
    /// Its value.
    pub value: f64,
    /// Least value.
    pub least: f64,
    /// Largest value.
    pub most: f64,
}

/// A film of a material. Copies share its spectra, which are computed when they are first needed.
#[derive(Clone)]
pub struct ThinFilm {
    layers: Layers,
    angle: ThinFilmAngle,
    spectra: Arc<Spectra>,
}

/// Computed spectra of a film.
#[derive(Default)]
struct Spectra {
    checked: OnceLock<Vec<Spectrum>>,
    coarse: OnceLock<Vec<Spectrum>>,
    fine: OnceLock<Vec<Spectrum>>,
    terms: OnceLock<ThinFilmTerms>,
}

/// A film's reflectance as a sum of products, `R(c, λ) ≈ Σ_j f_j(c) r_j(λ)`: its singular value decomposition, with weights
/// by the observer.
#[derive(Clone, Debug)]
pub struct ThinFilmTerms {
    /// `r_j`, the most important first; its samples may be negative.
    pub spectra: Vec<Spectrum>,
    /// `f_j` at each of [`THIN_FILM_ANGLES`], at most 1 in magnitude.
    pub factors: Vec<Vec<f64>>,
    /// Largest ΔE00 of the first 0, 1, … terms, interpolated between angles, under D65, A, FL11 and LED-RGB1, where each angle is
    /// shown as bright as white, or ten times as bright as it is.
    pub errors: Vec<f64>,
}

impl ThinFilm {
    /// A film of these layers.
    ///
    /// # Errors
    ///
    /// [`ThinFilmError`] for an index outside [`INDICES`], or a thickness outside [`THICKNESSES`].
    pub fn new(layers: Layers, angle: ThinFilmAngle) -> Result<Self, ThinFilmError> {
        let Layers { index, thickness_nm, above, below } = layers;
        let numbers = [
            ("index", index, INDICES),
            ("thickness", thickness_nm, THICKNESSES),
            ("above", above, INDICES),
            ("below", below, INDICES),
        ];
        for (key, value, range) in numbers {
            if !range.contains(&value) {
                return Err(ThinFilmError { key, value, least: *range.start(), most: *range.end() });
            }
        }
        Ok(Self { layers, angle, spectra: Arc::default() })
    }

    /// Its layers.
    #[must_use]
    pub const fn layers(&self) -> Layers {
        self.layers
    }

    /// The angle at which it reflects.
    #[must_use]
    pub const fn angle(&self) -> ThinFilmAngle {
        self.angle
    }

    /// Reflectance at [`THIN_FILM_ANGLES`].
    #[must_use]
    pub fn at_angles(&self) -> &[Spectrum] {
        self.spectra.coarse.get_or_init(|| evenly(self.layers, THIN_FILM_ANGLES))
    }

    /// Reflectance at [`FINE_ANGLES`].
    #[must_use]
    pub fn at_fine_angles(&self) -> &[Spectrum] {
        self.spectra.fine.get_or_init(|| evenly(self.layers, FINE_ANGLES))
    }

    /// Reflectance at the cosines where errors are measured.
    fn checked(&self) -> impl Iterator<Item = (f64, &Spectrum)> {
        let reflectance = |i: usize| self.layers.reflectance(count(i) / 100.0);
        let spectra =
            self.spectra.checked.get_or_init(|| (1..=CHECKED).into_par_iter().map(reflectance).collect::<Vec<_>>());
        (1..=CHECKED).map(|i| count(i) / 100.0).zip(spectra)
    }

    /// Largest ΔE00 of k coefficients, which `projected` gives for a spectrum, interpolated between [`THIN_FILM_ANGLES`] and shown
    /// by the colours of `matrix` to `observer` under `light`.
    #[must_use]
    pub fn error_of_coefficients(
        &self,
        projected: impl Fn(&Spectrum) -> Vec<f64>,
        light: &Light,
        matrix: &[[f64; 3]],
        observer: Observer,
    ) -> f64 {
        let rows: Vec<Vec<f64>> = self.at_angles().iter().map(projected).collect();
        let lab = |xyz| lab_from_xyz(Xyz(xyz), d65_white());
        let error = |(cosine, spectrum): (f64, &Spectrum)| {
            let lit = light.spectrum() * spectrum;
            let exact = observer.matching().each_ref().map(|matching| matching.dot(&lit));
            let parts = between_angles(&rows, cosine).zip(matrix);
            let found = parts.fold([0.0; 3], |sum, (part, colour)| {
                std::array::from_fn(|axis| part.mul_add(colour[axis], sum[axis]))
            });
            ciede2000(lab(found), lab(exact))
        };
        self.checked().map(error).fold(0.0, f64::max)
    }

    /// Its terms.
    #[must_use]
    pub fn terms(&self) -> &ThinFilmTerms {
        self.spectra.terms.get_or_init(|| ThinFilmTerms::new(self))
    }

    /// The least number of terms with an error of at most `tolerance`, in ΔE00, or with the least error of all.
    #[must_use]
    pub fn terms_within(&self, tolerance: f64) -> usize {
        let errors = &self.terms().errors;
        let least = errors.iter().copied().fold(f64::INFINITY, f64::min);
        errors.iter().position(|&error| error <= tolerance.max(least)).unwrap_or(0)
    }
}

impl PartialEq for ThinFilm {
    fn eq(&self, other: &Self) -> bool {
        (self.layers, self.angle) == (other.layers, other.angle)
    }
}

// Without the spectra, which follow from the rest: the digest of a scene reads this text.
impl fmt::Debug for ThinFilm {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter
            .debug_struct("ThinFilm")
            .field("layers", &self.layers)
            .field("angle", &self.angle)
            .finish_non_exhaustive()
    }
}

fn evenly(layers: Layers, angles: usize) -> Vec<Spectrum> {
    (0..angles).into_par_iter().map(|i| layers.reflectance(count(i) / count(angles - 1))).collect()
}

impl Layers {
    /// Reflectance for light at this cosine of the angle of incidence, averaged over both polarisations, and over each band
    /// from samples 1 nm apart.
    #[must_use]
    pub fn reflectance(&self, cosine: f64) -> Spectrum {
        /// Samples of a band, 1 nm apart.
        const SAMPLES: usize = 5;
        let waves = Waves::new(self, cosine);
        let of_band = |nm: f64| {
            let sample = |i: usize| waves.reflected(nm + count(i) - (STEP_NM - 1.0) / 2.0);
            (0..SAMPLES).map(sample).sum::<f64>() / count(SAMPLES)
        };
        Spectrum::from_fn(of_band)
    }

    /// Reflectance at one wavelength, averaged over both polarisations.
    #[must_use]
    pub fn reflectance_at(&self, cosine: f64, nm: f64) -> f64 {
        Waves::new(self, cosine).reflected(nm)
    }
}

/// Amplitudes of light that the faces of a film reflect, for one angle.
struct Waves {
    /// For polarisation s and p: from the upper face, and from the lower one.
    faces: [[Complex<f64>; 2]; 2],
    /// The path through the film and back, 2·n·d·cos, in nm.
    way_nm: Complex<f64>,
}

impl Waves {
    fn new(layers: &Layers, cosine: f64) -> Self {
        let Layers { index, thickness_nm, above, below } = *layers;
        let cosine = cosine.abs().clamp(GRAZING, 1.0);
        // By Snell's law; imaginary beyond the critical angle. All three the same way, so that equal indices have equal cosines.
        let sine_squared = (-cosine).mul_add(cosine, 1.0);
        // At the critical angle itself the amplitudes of both faces would be 0 / 0.
        let cosine_in = |n: f64| {
            let squared = 1.0 - (above / n).powi(2) * sine_squared;
            Complex::new(if squared.abs() < CRITICAL { CRITICAL } else { squared }, 0.0).sqrt()
        };
        let media = [above, index, below].map(|n| (n, cosine_in(n)));
        let face = |(n, c): (f64, Complex<f64>), (m, d): (f64, Complex<f64>)| {
            [(c * n - d * m) / (c * n + d * m), (c * m - d * n) / (c * m + d * n)]
        };
        let ([upper_s, upper_p], [lower_s, lower_p]) = (face(media[0], media[1]), face(media[1], media[2]));
        Self { faces: [[upper_s, lower_s], [upper_p, lower_p]], way_nm: media[1].1 * (2.0 * index * thickness_nm) }
    }

    fn reflected(&self, nm: f64) -> f64 {
        let turned = (Complex::new(0.0, std::f64::consts::TAU / nm) * self.way_nm).exp();
        let of = |[upper, lower]: [Complex<f64>; 2]| {
            ((upper + lower * turned) / (Complex::new(1.0, 0.0) + upper * lower * turned)).norm_sqr()
        };
        f64::midpoint(of(self.faces[0]), of(self.faces[1])).clamp(0.0, 1.0)
    }
}

impl ThinFilmTerms {
    fn new(film: &ThinFilm) -> Self {
        let (cosines, spectra): (Vec<f64>, Vec<&Spectrum>) = film.checked().unzip();
        let weights: [f64; BANDS] =
            std::array::from_fn(|band| OBSERVER.each_ref().map(|it| it.samples()[band]).iter().sum::<f64>().sqrt());
        let weighted = DMatrix::from_fn(CHECKED, BANDS, |row, band| spectra[row].samples()[band] * weights[band]);
        let rows = weighted.svd(false, true).v_t.unwrap_or_else(|| DMatrix::zeros(0, BANDS));
        let (mut terms, mut factors) = (Vec::new(), vec![Vec::new(); THIN_FILM_ANGLES]);
        for row in rows.row_iter().take(MOST_TERMS) {
            let along = |spectrum: &Spectrum| {
                (0..BANDS).map(|band| spectrum.samples()[band] * weights[band] * row[band]).sum::<f64>()
            };
            let of_angles: Vec<f64> = film.at_angles().iter().map(along).collect();
            // With its sign, so that the largest factor is 1 and the first spectrum is positive.
            let largest = of_angles.iter().fold(0.0_f64, |most, &it| if it.abs() > most.abs() { it } else { most });
            if largest.abs() <= 1e-9 {
                break;
            }
            terms.push(Spectrum::from_samples(std::array::from_fn(|band| row[band] / weights[band] * largest)));
            factors.iter_mut().zip(of_angles).for_each(|(factors, factor)| factors.push(factor / largest));
        }
        let terms = Self { spectra: terms, factors, errors: Vec::new() };
        let errors = terms.largest_errors(&cosines, &spectra);
        Self { errors, ..terms }
    }

    /// Largest ΔE00 of the first 0, 1, … terms from these `spectra`.
    fn largest_errors(&self, cosines: &[f64], spectra: &[&Spectrum]) -> Vec<f64> {
        let lights = ["D65", "A", "FL11", "LED-RGB1"].iter().filter_map(|name| standard::light(name).ok());
        let mut largest = vec![0.0_f64; self.spectra.len() + 1];
        for light in lights {
            let colour = |spectrum: &Spectrum| xyz_of(&(light.spectrum() * spectrum)).0;
            let colours: Vec<[f64; 3]> = self.spectra.iter().map(colour).collect();
            for (&cosine, spectrum) in cosines.iter().zip(spectra) {
                let lab = |xyz| lab_from_xyz(Xyz(xyz), d65_white());
                let exact = colour(spectrum);
                let shown = if exact[1] * BRIGHTENED > 1.0 { exact[1].recip() } else { BRIGHTENED };
                let (exact, mut sum) = (lab(exact.map(|part| part * shown)), [0.0; 3]);
                largest[0] = largest[0].max(ciede2000(lab(sum), exact));
                for ((factor, colour), largest) in
                    between_angles(&self.factors, cosine).zip(&colours).zip(&mut largest[1..])
                {
                    sum = std::array::from_fn(|axis| (factor * shown).mul_add(colour[axis], sum[axis]));
                    *largest = largest.max(ciede2000(lab(sum), exact));
                }
            }
        }
        largest
    }
}

/// Numbers of `rows`, one per angle, at a cosine from 0 to 1, interpolated between two angles.
fn between_angles(rows: &[Vec<f64>], cosine: f64) -> impl Iterator<Item = f64> {
    let place = cosine * count(THIN_FILM_ANGLES - 1);
    let low = whole(place).min(THIN_FILM_ANGLES - 2);
    let part = place - count(low);
    rows[low].iter().zip(&rows[low + 1]).map(move |(low, high)| part.mul_add(high - low, *low))
}
