//! Search for the worst colours of a model, for validation and refits.

use rayon::prelude::*;

use super::chain::Chain;
use super::random::Random;
use super::target::{self, Target};
use super::{Amplification, Cloud, ColourModel, ErrorSummary, LightMatrix, ModelError, ModelKind, Samples, cloud};
use crate::spectrum::Light;
use crate::spectrum::observer::Observer;

impl ColourModel {
    /// Measures the errors of the model's lights on spectra not used in the fit: those of `unseen`, and harder ones
    /// found by varying their light paths, because a random path is seldom the hardest of its class. Keeps these
    /// spectra for [`Self::learn`].
    ///
    /// # Errors
    ///
    /// [`ModelError::NotFinite`] when light overflows.
    pub fn check_on(&mut self, unseen: &Cloud) -> Result<(), ModelError> {
        let harder: Vec<Cloud> =
            self.lights.par_iter().map(|(_, light, _)| self.harder(unseen, light)).collect::<Result<_, _>>()?;
        self.mixed = unseen.mixed;
        let clouds = || std::iter::once(unseen).chain(&harder);
        self.unseen = Samples {
            spectra: clouds().flat_map(|cloud| cloud.spectra.iter().cloned()).collect(),
            vectors: clouds().flat_map(|cloud| self.stored_vectors_of(cloud)).collect(),
        };
        let errors = self.lights.par_iter().map(|(_, light, matrix)| self.unseen_error(light, &matrix.xyz));
        let errors: Vec<Option<ErrorSummary>> = errors.collect();
        for ((.., matrix), error) in self.lights.iter_mut().zip(errors) {
            matrix.unseen = error;
        }
        Ok(())
    }

    /// Adds a light to the model, fits it on the cloud, and measures its error on [`Self::unseen`], if any.
    ///
    /// A light already in the model, under any name, stays unchanged.
    ///
    /// # Errors
    ///
    /// [`ModelError::NotFinite`] when the light, or the cloud of stored parts, leads to numbers that are not finite.
    pub fn learn(&mut self, name: &str, light: &Light) -> Result<(), ModelError> {
        if self.lights.iter().any(|(_, known, _)| known == light) {
            return Ok(());
        }
        let mut matrix = self.fitted(light);
        matrix.unseen = self.unseen_error(light, &matrix.xyz);
        let worst = matrix.worst();
        if !worst.max.is_finite() || !matrix.xyz.iter().flatten().all(|part| part.is_finite()) {
            return Err(ModelError::NotFinite);
        }
        self.lights.push((name.to_owned(), light.clone(), matrix));
        Ok(())
    }

    /// Returns the model with its lights' matrices fitted on the cloud for `observer`, and their errors for that
    /// observer. The coefficients of spectra do not change.
    ///
    /// # Errors
    ///
    /// [`ModelError::NotFinite`] when a number is not finite.
    pub fn seen_by(&self, observer: Observer) -> Result<Self, ModelError> {
        if observer == self.observer {
            return Ok(self.clone());
        }
        let mut model = Self { observer, ..self.clone() };
        let fitted: Vec<LightMatrix> = self.lights.par_iter().map(|(_, light, _)| model.fitted(light)).collect();
        for ((.., matrix), fitted) in model.lights.iter_mut().zip(fitted) {
            *matrix = fitted;
        }
        let errors = model.lights.par_iter().map(|(_, light, matrix)| model.unseen_error(light, &matrix.xyz));
        let errors: Vec<Option<ErrorSummary>> = errors.collect();
        for ((.., matrix), error) in model.lights.iter_mut().zip(errors) {
            matrix.unseen = error;
        }
        if model.is_finite() { Ok(model) } else { Err(ModelError::NotFinite) }
    }

    /// Refits the lights' matrices on the cloud and on the hardest paths found from it.
    ///
    /// Skips kinds other than nodes and bands (most have matrices independent of a cloud), and models with errors above
    /// ΔE00 2: a better fit of their worst colours would be worse for all others.
    pub(super) fn refit(&mut self, cloud: &Cloud) -> Result<(), ModelError> {
        const ROUNDS: usize = 2;
        const FAR_OFF: f64 = 2.0;
        if !matches!(self.kind, ModelKind::Nodes | ModelKind::Bands) || self.worst().max > FAR_OFF {
            return Ok(());
        }
        // In an order independent of the scene's.
        let mut lights: Vec<Light> = self.lights.iter().map(|(_, light, _)| light.clone()).collect();
        lights.sort_by(|one, two| cloud::compare(one.spectrum(), two.spectrum()));
        for _ in 0..ROUNDS {
            let harder = lights.par_iter().map(|light| self.harder(cloud, light));
            for harder in harder.collect::<Result<Vec<Cloud>, _>>()? {
                self.vectors.extend(self.stored_vectors_of(&harder));
                self.cloud.extend(harder.spectra);
            }
            let matrices: Vec<LightMatrix> = self.lights.par_iter().map(|(_, light, _)| self.fitted(light)).collect();
            for ((.., matrix), fitted) in self.lights.iter_mut().zip(matrices) {
                *matrix = fitted;
            }
        }
        Ok(())
    }

    /// Returns the hardest paths of `unseen` under a light, each varied repeatedly towards a larger error.
    fn harder(&self, unseen: &Cloud, light: &Light) -> Result<Cloud, ModelError> {
        const WAYS: usize = 16;
        const ROUNDS: usize = 64;
        const SEED: u64 = 3;
        let errors = self.errors(unseen, light, Amplification::Held);
        let mut ways: Vec<(f64, Chain)> = errors.into_iter().zip(unseen.chains.iter().cloned()).collect();
        ways.sort_by(|one, two| two.0.total_cmp(&one.0));
        ways.truncate(WAYS);
        let mut random = Random::new(SEED);
        for _ in 0..ROUNDS {
            let varied = ways.iter().map(|(_, way)| way.varied(unseen.supply, &mut random)).collect();
            let varied = unseen.of(varied)?;
            let errors = self.errors(&varied, light, Amplification::Held);
            for ((way, error), varied) in ways.iter_mut().zip(errors).zip(varied.chains) {
                if error > way.0 {
                    *way = (error, varied);
                }
            }
        }
        unseen.of(ways.into_iter().map(|(_, way)| way).collect())
    }

    /// ΔE00 under `light` on the spectra not used in the fit, for the colour matrix `xyz`; `None` if there are no such
    /// spectra.
    ///
    /// For lights from several positions, it includes sums of a spectrum under this light and another spectrum, as
    /// bright or darker, under each other light of the model: the same error is more visible where the sum has less
    /// colour than its parts.
    fn unseen_error(&self, light: &Light, xyz: &[[f64; 3]]) -> Option<ErrorSummary> {
        const SEED: u64 = 4;
        const PARTNERS: usize = 4;
        let Samples { spectra, vectors } = &self.unseen;
        let target = Target::new(spectra, light, self.observer);
        let mut errors = target.errors(vectors, xyz);
        for (_, other, matrix) in self.lights.iter().filter(|(_, other, _)| self.mixed && other != light) {
            let beside = Target::new(spectra, other, self.observer);
            let mut random = Random::new(SEED);
            for (index, vector) in (0..PARTNERS).flat_map(|_| vectors.iter().enumerate()) {
                let (partner, share) = (random.index(spectra.len()), random.between_magnitudes(0.02, 1.0));
                let sum =
                    |one: [f64; 3], two: [f64; 3]| std::array::from_fn(|axis| share.mul_add(two[axis], one[axis]));
                let made = sum(target::colour(xyz, vector), target::colour(&matrix.xyz, &vectors[partner]));
                errors.push(target::difference(made, sum(target.xyz[index], beside.xyz[partner])));
            }
        }
        (!spectra.is_empty()).then(|| ErrorSummary::of(&errors))
    }
}
