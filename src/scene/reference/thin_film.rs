//! Light that thin films reflect (docs/theory/thin-films.md). Twin of `shaders/thin_film.wgsl`.

use super::Step;
use crate::plan::{Accumulate, LANE, ScenePlan, Transmittance};
use crate::tables;
use relume_base::number::{Real, count};

/// A thin film, [`tables::ThinFilmRows`].
#[derive(Clone, Debug)]
pub(super) struct ThinFilm<R> {
    factor: R,
    pub(super) exponent: u32,
    weight: usize,
    angles: Vec<Vec<R>>,
}

impl<R: Real> ThinFilm<R> {
    pub(super) fn new(rows: &tables::ThinFilmRows) -> Self {
        let row = |row: &Vec<f64>| row.iter().copied().map(R::from_f64).collect();
        Self {
            factor: R::from_f64(rows.factor),
            exponent: rows.exponent,
            weight: rows.weight,
            angles: rows.angles.iter().map(row).collect(),
        }
    }

    /// Adds to `source` what this film, number `i` of `plan`, reflects at a `cosine`, by the `shade` of each component.
    pub(super) fn add(
        &self,
        plan: &ScenePlan,
        i: usize,
        step: &Step<R>,
        cosine: R,
        shade: impl Fn(usize) -> R,
        source: &mut [R],
    ) {
        let place = cosine.max(R::default()).min(R::from_f64(1.0)) * R::from_f64(count(self.angles.len() - 1));
        let low = place.index().min(self.angles.len() - 2);
        let part = place - R::from_f64(count(low));
        let first = plan.parts().thin_films * LANE;
        // Light of white: one number, or one per component.
        let white = |component: usize| match (plan.accumulate, plan.transmittance) {
            (Accumulate::Weights { .. }, _) => step.source[self.weight],
            (_, Transmittance::Grey) => step.source[first + i],
            (_, Transmittance::Coloured | Transmittance::Mixed) => {
                step.source[first + i * plan.lanes() * LANE + component]
            }
        };
        let angles = self.angles[low].iter().zip(&self.angles[low + 1]);
        for (component, (sum, (&low, &high))) in source.iter_mut().zip(angles).enumerate() {
            let reflected = part.mul_add(high - low, low);
            *sum = reflected.mul_add(white(component) * (self.factor * shade(component)), *sum);
        }
    }
}
