//! Requirements of a scene on its plan: transmittance, optical depth, spectra, exponents and phase functions.

use super::{Accumulate, FilmCounts, Planned, Transmittance};
use crate::transfer::{bends, medium_of};
use crate::{Group, LabelEntry, Material, Scene, Term};
use relume_base::number::count;
use relume_colour::model::{ColourModel, Ingredients, LightMatrix};
use relume_colour::spectrum::{Light, Spectrum, ThinFilm, ThinFilmAngle};

/// Distinct exponents of the highlights of `materials`, ascending.
pub(super) fn exponents<'a>(materials: impl Iterator<Item = &'a Material>) -> Vec<u32> {
    let mut exponents: Vec<u32> =
        materials.filter(|material| material.white_specular() > 0.0).map(|material| material.exponent).collect();
    exponents.sort_unstable();
    exponents.dedup();
    exponents
}

/// Materials that absorb.
pub(super) fn absorbers(scene: &Scene) -> impl Iterator<Item = usize> {
    (0..scene.materials.len()).filter(|&material| scene.absorbs(material))
}

/// Distinct phase functions of `materials`, ascending.
pub(super) fn phases<'a>(materials: impl Iterator<Item = &'a Material>) -> Vec<f64> {
    // 0 and −0 scatter alike.
    let mut phases: Vec<f64> = materials.map(|material| material.phase + 0.0).collect();
    phases.sort_unstable_by(f64::total_cmp);
    phases.dedup();
    phases
}

/// Terms of `film` within a tolerance, if pixels keep weights, otherwise 0. `None` for weights of a film that reflects nothing.
fn terms(film: &ThinFilm, tolerance: Option<f64>) -> Option<usize> {
    match tolerance {
        Some(tolerance) => Some(film.terms_within(tolerance)).filter(|&terms| terms > 0),
        None => Some(0),
    }
}

/// Numbers of the films of `materials`; of their terms within a tolerance, if pixels keep weights. Films without terms, which
/// reflect nothing, are not counted then.
pub(super) fn thin_film_counts<'a>(
    materials: impl Iterator<Item = &'a Material>,
    tolerance: Option<f64>,
) -> FilmCounts {
    let mut counts = FilmCounts::default();
    for material in materials {
        let at = |angle| Some(terms(material.thin_film_at(angle)?, tolerance)).flatten();
        let (facing, lobe) = (at(ThinFilmAngle::Facing), at(ThinFilmAngle::Lobe));
        counts.facing += usize::from(facing.is_some());
        counts.lobe += usize::from(lobe.is_some());
        if lobe.is_some() {
            counts.exponent_bits = counts.exponent_bits.max(u32::BITS - material.exponent.leading_zeros());
        }
        counts.terms += facing.or(lobe).unwrap_or(0);
    }
    counts
}

/// Grey if and only if the sum of all absorption is equal at all wavelengths.
pub(super) fn transmittance(scene: &Scene) -> Transmittance {
    let coloured = |absorption: &[f64]| {
        let mut sum = Spectrum::constant(0.0);
        for (&depth, material) in absorption.iter().zip(&scene.materials) {
            if let Some(shape) = material.absorption.as_ref().filter(|_| depth > 0.0) {
                sum = &sum + &shape.spectrum().scaled(depth);
            }
        }
        !is_constant(&sum)
    };
    // Between two bends the sum is quadratic at each wavelength, so three points determine it.
    let any_around = |terms: &[Term], is_coloured: &dyn Fn(f64) -> bool| {
        let bends = bends(terms);
        let halves = bends.windows(2).map(|pair| f64::midpoint(pair[0], pair[1]));
        // Also on both sides of a jump.
        bends
            .iter()
            .copied()
            .chain(halves)
            .any(|value| [value.next_down(), value, value.next_up()].into_iter().any(is_coloured))
    };
    let of_group = |Group { field, factors }: Group<'_>| {
        let (terms, all) = (scene.terms_of(field), if field == 0 { &scene.transfer.gradient_opacity[..] } else { &[] });
        let share = |term: usize| if terms[term].factors_among(all) == factors { 1.0 } else { 0.0 };
        any_around(terms, &|value| coloured(&medium_of(terms, value, scene.materials.len(), share).absorption))
    };
    // Values of fields, and factors, are independent, so each group is grey by itself.
    let by_value = scene.groups().into_iter().any(of_group);
    let by_label = scene.declared().iter().any(|entry| {
        let is_coloured = |value: f64| coloured(&entry.medium(value, scene.materials.len()).absorption);
        if entry.terms.is_empty() { is_coloured(0.0) } else { any_around(&entry.terms, &is_coloured) }
    });
    if by_value || by_label { Transmittance::Coloured } else { Transmittance::Grey }
}

/// Whether all samples are equal up to rounding.
pub fn is_constant(spectrum: &Spectrum) -> bool {
    let samples = spectrum.samples();
    let (low, high) = samples.iter().fold((f64::MAX, f64::MIN), |(low, high), &s| (low.min(s), high.max(s)));
    high - low <= 1e-12 * high.abs()
}

/// Largest optical depth of absorption along a ray: that of the most absorbing value, summed over its materials, along
/// the volume's diagonal.
pub(super) fn largest_depth(scene: &Scene) -> f64 {
    let of_field = |field: usize| {
        let terms = scene.terms_of(field);
        let of_value = |value| medium_of(terms, value, scene.materials.len(), |_| 1.0).absorption.iter().sum();
        bends(terms).into_iter().map(of_value).fold(0.0, f64::max)
    };
    let of_values: f64 = (0..=scene.fields.further().len()).map(of_field).sum();
    let of_label = |entry: &LabelEntry| {
        let values = if entry.terms.is_empty() { vec![0.0] } else { bends(&entry.terms) };
        let of_value = |value| entry.medium(value, scene.materials.len()).absorption.iter().sum();
        values.into_iter().map(of_value).fold(0.0, f64::max)
    };
    scene.declared().iter().map(of_label).fold(of_values, f64::max) * longest_way(scene)
}

/// Longest path through the volume (its diagonal), in opacity lengths; one, where the extreme values of rays are seen.
pub(super) fn longest_way(scene: &Scene) -> f64 {
    if scene.blending.is_extreme() {
        return 1.0;
    }
    let geometry = &scene.frame.geometry;
    let diagonal = (geometry.spacing * glam::DVec3::from_array(geometry.dims.map(count))).length();
    diagonal / scene.transfer.opacity_length
}

/// Angles of a film whose spectra a colour model is fitted to.
const FITTED_ANGLES: usize = 16;

/// A thin film of a plan.
#[derive(Clone, Copy, Debug)]
pub struct PlannedFilm<'a> {
    /// The film.
    pub film: &'a ThinFilm,
    /// Its material.
    pub material: &'a Material,
    /// Number of the material among those in use, which is also that of its weight.
    pub weight: usize,
    /// With weights, the component of the first term.
    pub first: usize,
    /// With weights, the number of terms.
    pub terms: usize,
}

impl PlannedFilm<'_> {
    /// Largest ΔE00 of the film in the coefficients of `model` under its lights.
    pub(super) fn error_in(&self, model: &ColourModel) -> f64 {
        let under = |(_, light, matrix): &(String, Light, LightMatrix)| {
            let projected = |spectrum: &Spectrum| model.coefficients(spectrum);
            self.film.error_of_coefficients(projected, light, &matrix.xyz, model.observer())
        };
        model.lights().iter().map(under).fold(0.0, f64::max)
    }
}

impl Planned {
    /// Spectra that affect the light in `scene`, under its own lights.
    #[must_use]
    pub fn ingredients(&self, scene: &Scene) -> Ingredients {
        let coloured = self.plan.transmittance != Transmittance::Grey;
        let absorbing: Vec<usize> = absorbers(scene).filter(|_| coloured).collect();
        let absorptions = absorbing.iter().filter_map(|&m| scene.materials[m].absorption.as_ref());
        let own = self.materials.iter().map(|&m| scene.materials[m].reflectance.spectrum().clone());
        // A film has a spectrum per angle.
        let thin_films = self.thin_films(scene).into_iter().flat_map(|film| {
            (0..FITTED_ANGLES).map(move |i| film.film.layers().reflectance((count(i) + 0.5) / count(FITTED_ANGLES)))
        });
        Ingredients {
            reflectances: own.chain(thin_films).collect(),
            absorptions: absorptions.map(|absorption| absorption.spectrum().clone()).collect(),
            background: scene.background.as_ref().map(|surface| surface.spectrum().clone()),
            highlights: self.plan.specular().is_some(),
            lights: scene.lights.iter().map(|light| (light.name.clone(), light.spectrum.clone())).collect(),
            mixed: self.positions.len() > 1,
            largest_depth: if coloured { largest_depth(scene) } else { 0.0 },
            two_ways: self.plan.light.absorbers > 0,
            scatters_often: self.plan.light.gathered.is_some(),
        }
    }

    /// Distinct exponents of highlights, ascending; none if the plan has no highlights.
    #[must_use]
    pub fn exponents(&self, scene: &Scene) -> Vec<u32> {
        let used = self.materials.iter().filter_map(|&material| scene.materials.get(material));
        if self.plan.specular().is_some() { exponents(used) } else { Vec::new() }
    }

    /// Thin films of the plan: those of the diffuse part first. With weights, those that reflect nothing are left out.
    #[must_use]
    pub fn thin_films<'a>(&self, scene: &'a Scene) -> Vec<PlannedFilm<'a>> {
        if self.plan.thin_films.total() == 0 {
            return Vec::new();
        }
        let mut first = self.plan.components() - self.plan.thin_films.terms;
        let mut thin_films = Vec::new();
        for angle in [ThinFilmAngle::Facing, ThinFilmAngle::Lobe] {
            for (weight, &material) in self.materials.iter().enumerate() {
                let Some(material) = scene.materials.get(material) else { continue };
                let Some(film) = material.thin_film_at(angle) else { continue };
                let tolerance = self.model.is_none().then_some(scene.accuracy.tolerance);
                let Some(terms) = terms(film, tolerance) else { continue };
                thin_films.push(PlannedFilm { film, material, weight, first, terms });
                first += terms;
            }
        }
        thin_films
    }

    /// The coloured absorbers of shadows: indices into [`Scene::materials`].
    #[must_use]
    pub fn absorbers(&self, scene: &Scene) -> Vec<usize> {
        absorbers(scene).take(self.plan.light.absorbers).collect()
    }

    /// The phase functions of [`ScenePlan::phases`](super::ScenePlan::phases), in the order of the weights or ascending;
    /// none if every material scatters evenly.
    #[must_use]
    pub fn phases(&self, scene: &Scene) -> Vec<f64> {
        let used = self.materials.iter().filter_map(|&material| scene.materials.get(material));
        match self.plan.accumulate {
            _ if self.plan.phases == 0 => Vec::new(),
            Accumulate::Weights { .. } => used.map(|material| material.phase).collect(),
            Accumulate::Spectral { .. } => phases(used),
        }
    }
}
