//! Clouds of spectra that the light of a scene can have.

use rayon::prelude::*;

use super::chain::{Chain, ChainClass, Supply};
use super::random::Random;
use super::{Ingredients, ModelError};
use crate::spectrum::{BANDS, Spectrum, wavelength_nm};

/// Largest optical depth considered: deeper absorption leaves too little light for a visible colour.
pub const LARGEST_DEPTH: f64 = 20.0;

/// Light-independent spectra of pixels: chains of a scene's ingredients.
///
/// The ingredients are sorted and deduplicated, so that their order does not change the cloud.
#[derive(Clone, Debug)]
pub struct Cloud {
    pub(super) sources: Vec<Spectrum>,
    pub(super) absorptions: Vec<Spectrum>,
    pub(super) supply: Supply,
    pub(super) mixed: bool,
    pub(super) chains: Vec<Chain>,
    pub(super) spectra: Vec<Spectrum>,
}

impl Cloud {
    /// Builds a cloud of every source once and the given number of random chains of each class. Without absorptions,
    /// the classes that need them are left out, and [`ChainClass::Scattered`] where light scatters once.
    ///
    /// # Errors
    ///
    /// [`ModelError::Sample`] for a spectrum that is not finite, or an absorption that is negative somewhere;
    /// [`ModelError::NotFinite`] when light overflows.
    pub fn new(ingredients: &Ingredients, classes: &[(ChainClass, usize)], seed: u64) -> Result<Self, ModelError> {
        check(ingredients)?;
        let mut sources = sorted(&ingredients.reflectances);
        if ingredients.highlights || sources.is_empty() && ingredients.background.is_none() {
            sources.push(Spectrum::constant(1.0));
        }
        let scattering = sources.len();
        sources.extend(ingredients.background.iter().cloned());
        let coloured = is_coloured(ingredients);
        let absorptions = if coloured { sorted(&ingredients.absorptions) } else { Vec::new() };
        let supply = Supply {
            sources: sources.len(),
            scattering,
            absorptions: absorptions.len(),
            largest_depth: ingredients.largest_depth.clamp(0.0, LARGEST_DEPTH),
            two_ways: coloured && ingredients.two_ways,
            deepest: (ingredients.largest_depth * if ingredients.two_ways { 2.0 } else { 1.0 })
                .clamp(0.0, LARGEST_DEPTH),
        };
        let mut random = Random::new(seed);
        let mut chains: Vec<Chain> = (0..sources.len()).map(Chain::reflection).collect();
        for &(class, count) in classes {
            let needs_absorptions =
                matches!(class, ChainClass::Absorbed | ChainClass::SinglyAbsorbed | ChainClass::ColouredRays(_));
            let is_made = class != ChainClass::Scattered || ingredients.scatters_often;
            if is_made && (coloured || !needs_absorptions) {
                chains.extend((0..count).map(|_| Chain::draw(class, supply, &mut random)));
            }
        }
        let mixed = ingredients.mixed;
        Self { sources, absorptions, supply, mixed, chains: Vec::new(), spectra: Vec::new() }.of(chains)
    }

    /// Builds a cloud of other chains from the same ingredients.
    pub(super) fn of(&self, chains: Vec<Chain>) -> Result<Self, ModelError> {
        let (sources, absorptions) = (self.sources.clone(), self.absorptions.clone());
        let mut cloud =
            Self { sources, absorptions, supply: self.supply, mixed: self.mixed, chains, spectra: Vec::new() };
        cloud.spectra = cloud.computed();
        if cloud.spectra.iter().all(Spectrum::is_finite) { Ok(cloud) } else { Err(ModelError::NotFinite) }
    }

    /// Spectra, rounded to f32 so that a file of f32 stores them exactly.
    pub fn spectra(&self) -> &[Spectrum] {
        &self.spectra
    }

    fn computed(&self) -> Vec<Spectrum> {
        let sources: Vec<Vec<f64>> = self.sources.iter().map(|source| source.samples().to_vec()).collect();
        let depths = |absorbed: &[(usize, f64)]| self.depth(absorbed).samples().to_vec();
        let spectrum = |chain: &Chain| {
            let light = chain.walk(BANDS, &sources, &depths);
            Spectrum::from_samples(std::array::from_fn(|band| single(light[band])))
        };
        self.chains.par_iter().map(spectrum).collect()
    }

    /// Optical depth per wavelength of a list of absorptions with their depths.
    pub(super) fn depth(&self, absorbed: &[(usize, f64)]) -> Spectrum {
        let parts = absorbed.iter().map(|&(index, depth)| self.absorptions[index].scaled(depth));
        parts.fold(Spectrum::constant(0.0), |sum, part| &sum + &part)
    }
}

/// Rounds to f32.
#[expect(clippy::cast_possible_truncation, reason = "the rounding is the purpose")]
pub(super) fn single(number: f64) -> f64 {
    f64::from(number as f32)
}

fn is_coloured(ingredients: &Ingredients) -> bool {
    !ingredients.absorptions.is_empty() && ingredients.largest_depth > 0.0
}

/// Sorts and deduplicates spectra; the result does not depend on their order.
pub(super) fn sorted(spectra: &[Spectrum]) -> Vec<Spectrum> {
    let mut sorted = spectra.to_vec();
    sorted.sort_by(compare);
    sorted.dedup();
    sorted
}

/// Order of spectra by the first pair of samples that differ.
pub(super) fn compare(one: &Spectrum, two: &Spectrum) -> std::cmp::Ordering {
    let pairs = one.samples().iter().zip(two.samples());
    pairs.map(|(one, two)| one.total_cmp(two)).find(|order| order.is_ne()).unwrap_or(std::cmp::Ordering::Equal)
}

fn check(ingredients: &Ingredients) -> Result<(), ModelError> {
    let wrong = |spectrum: &Spectrum, what: &str, expected, is_right: fn(f64) -> bool| match (0..BANDS)
        .find(|&band| !is_right(spectrum.samples()[band]))
    {
        Some(band) => Err(ModelError::Sample {
            what: what.to_owned(),
            nm: wavelength_nm(band),
            value: spectrum.samples()[band],
            expected,
        }),
        None => Ok(()),
    };
    for reflectance in &ingredients.reflectances {
        wrong(reflectance, "a reflectance", "it must be finite", f64::is_finite)?;
    }
    if let Some(background) = &ingredients.background {
        wrong(background, "the background", "it must be finite", f64::is_finite)?;
    }
    for absorption in &ingredients.absorptions {
        let is_right = |sample: f64| sample.is_finite() && sample >= 0.0;
        wrong(absorption, "an absorption", "it must be finite and not negative (it would amplify light)", is_right)?;
    }
    for (name, light) in &ingredients.lights {
        wrong(light.spectrum(), &format!("the light {name:?}"), "it must be finite", f64::is_finite)?;
    }
    Ok(())
}
