//! Search for the worst colours of a model, for validation and refits.

use rayon::prelude::*;

use super::chain::Chain;
use super::random::Random;
use super::target::{self, Target};
use super::{
    Amplification, Cloud, ColourModel, ErrorSummary, LightMatrix, ModelError, ModelKind, Samples, UnplannedLight, cloud,
};
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
        self.measure_unseen(0, false);
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
        self.learn_all(&[(name, light)])
    }

    /// [`Self::learn`] for several lights, one after another.
    ///
    /// # Errors
    ///
    /// Those of [`Self::learn`]; the model then learns none of them.
    pub fn learn_all(&mut self, lights: &[(&str, &Light)]) -> Result<(), ModelError> {
        let planned = self.lights.len();
        let mut new: Vec<(&str, &Light)> = Vec::new();
        for &(name, light) in lights {
            let mut known = self.lights.iter().map(|(_, known, _)| known).chain(new.iter().map(|&(_, known)| known));
            if !known.any(|known| known == light) {
                new.push((name, light));
            }
        }
        let fitted = new.par_iter().map(|&(name, light)| (name.to_owned(), light.clone(), self.fitted(light)));
        let fitted: Vec<(String, Light, LightMatrix)> = fitted.collect();
        self.lights.extend(fitted);
        self.measure_unseen(planned, true);
        let is_finite = |(.., matrix): &(String, Light, LightMatrix)| {
            matrix.worst().max.is_finite() && matrix.xyz.iter().flatten().all(|part| part.is_finite())
        };
        if !self.lights[planned..].iter().all(is_finite) {
            self.lights.truncate(planned);
            return Err(ModelError::NotFinite);
        }
        Ok(())
    }

    /// [`Self::learn`] for lights of a mix, by name. Returns those whose largest error is above `tolerance`.
    ///
    /// # Errors
    ///
    /// Those of [`Self::learn`].
    pub fn learn_within<'a>(
        &mut self,
        lights: impl IntoIterator<Item = (&'a str, &'a Light)>,
        tolerance: f64,
    ) -> Result<Vec<UnplannedLight>, ModelError> {
        let planned = self.lights.len();
        for (name, light) in lights {
            self.learn(name, light)?;
        }
        let unplanned = |(name, _, matrix): &(String, Light, LightMatrix)| UnplannedLight {
            name: name.clone(),
            error: matrix.worst(),
            tolerance,
        };
        let new = self.lights[planned..].iter().map(unplanned);
        Ok(new.filter(|light| light.error.max > tolerance).collect())
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
        model.measure_unseen(0, false);
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

    /// Measures the errors of the lights from index `first` on, on the spectra not used in the fit, if there are any.
    ///
    /// For lights from several positions, these include sums of a spectrum under a light and another spectrum, as
    /// bright or darker, under each other light of the model (of those before it if `only_before`): the same error is
    /// more visible where the sum has less colour than its parts.
    fn measure_unseen(&mut self, first: usize, only_before: bool) {
        const SEED: u64 = 4;
        const PARTNERS: usize = 4;
        let Samples { spectra, vectors } = &self.unseen;
        if spectra.is_empty() {
            self.lights[first..].iter_mut().for_each(|(.., matrix)| matrix.unseen = None);
            return;
        }
        let mut random = Random::new(SEED);
        let pairs = (0..PARTNERS).flat_map(|_| 0..vectors.len());
        // The same for each pair of lights.
        let pairs = pairs.map(|index| (index, random.index(spectra.len()), random.between_magnitudes(0.02, 1.0)));
        let pairs: Vec<(usize, usize, f64)> = if self.mixed { pairs.collect() } else { Vec::new() };
        // Exact and modelled colours of the lights that are needed.
        let needed = &self.lights[if self.mixed { 0 } else { first }..];
        let seen = needed.par_iter().map(|(_, light, matrix)| {
            let made = vectors.iter().map(|vector| target::colour(&matrix.xyz, vector));
            (Target::new(spectra, light, self.observer), made.collect())
        });
        let seen: Vec<(Target, Vec<[f64; 3]>)> = seen.collect();
        let of_light = |index: usize| {
            let (exact, made) = &seen[index];
            let mut errors: Vec<f64> = made.iter().enumerate().map(|(one, &made)| exact.error(one, made)).collect();
            let others = 0..if only_before { index } else { needed.len() };
            for other in others.filter(|&other| self.mixed && needed[other].1 != needed[index].1) {
                let (beside, made_beside) = &seen[other];
                errors.extend(pairs.iter().map(|&(one, partner, share)| {
                    let sum = |own: [f64; 3], other: [f64; 3]| {
                        std::array::from_fn(|axis| share.mul_add(other[axis], own[axis]))
                    };
                    let made = sum(made[one], made_beside[partner]);
                    target::difference(made, sum(exact.xyz[one], beside.xyz[partner]))
                }));
            }
            ErrorSummary::of(&errors)
        };
        let measured = needed.len() - (self.lights.len() - first)..needed.len();
        let errors: Vec<ErrorSummary> = measured.into_par_iter().map(of_light).collect();
        for ((.., matrix), error) in self.lights[first..].iter_mut().zip(errors) {
            matrix.unseen = Some(error);
        }
    }
}
