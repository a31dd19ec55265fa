//! Colour models of recent plans. Settings that are compared, searched for or edited in turn often need the same ones.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use super::PlanWarning;
use relume_base::progress::Progress;
use relume_colour::model::{self, ColourModel, Ingredients, ModelError, ModelKind};

/// Most models that are kept; one takes about 2 MB.
const MOST: usize = 8;

/// The coefficients of a model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Coefficients {
    /// As many as stated. The model is checked on spectra not used in its fit, and beside one with fewer.
    Stated(usize),
    /// The fewest that keep a tolerance.
    Keeping(f64),
    /// The fewest that keep a tolerance, if these are at most as many.
    AtMost(usize, f64),
}

/// A model that a scene needs.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Wanted {
    pub(super) ingredients: Ingredients,
    pub(super) kind: ModelKind,
    pub(super) coefficients: Coefficients,
}

/// Result of a fit.
#[derive(Clone, Debug)]
pub(super) struct Fitted {
    /// None if [`Coefficients::AtMost`] keep no tolerance.
    pub(super) model: Option<Arc<ColourModel>>,
    pub(super) warning: Option<PlanWarning>,
}

impl From<ColourModel> for Fitted {
    fn from(model: ColourModel) -> Self {
        Self { model: Some(Arc::new(model)), warning: None }
    }
}

/// The models of the last plans of this process.
pub(super) static RECENT: Recent = Recent(Mutex::new(VecDeque::new()));

/// Models, the latest first.
#[derive(Debug)]
pub(super) struct Recent(Mutex<VecDeque<(Wanted, Fitted)>>);

impl Recent {
    /// The model of `wanted`, fitted unless it is among the recent ones: equal ingredients give equal models.
    ///
    /// # Errors
    ///
    /// Those of the fit.
    pub(super) fn fitted(&self, wanted: Wanted, progress: &dyn Progress) -> Result<Fitted, ModelError> {
        let recent = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        {
            let mut recent = recent();
            if let Some(at) = recent.iter().position(|(known, _)| *known == wanted) {
                recent.make_contiguous()[..=at].rotate_right(1);
                return Ok(recent[0].1.clone());
            }
        }
        // Without the lock: other threads plan meanwhile.
        let found = wanted.fit(progress)?;
        let mut recent = recent();
        recent.push_front((wanted, found.clone()));
        recent.truncate(MOST);
        Ok(found)
    }
}

impl Wanted {
    fn fit(&self, progress: &dyn Progress) -> Result<Fitted, ModelError> {
        let (ingredients, kind) = (&self.ingredients, self.kind);
        match self.coefficients {
            Coefficients::Stated(dimension) => {
                let unseen = model::unseen(ingredients)?;
                let checked = |dimension| -> Result<ColourModel, ModelError> {
                    let mut model = model::fit(ingredients, kind, dimension, progress)?;
                    model.check_on(&unseen)?;
                    Ok(model)
                };
                let model = checked(dimension)?;
                let warning = match dimension {
                    2.. if !kind.is_rgb() => fewer_are_better(&model, &checked(dimension - 1)?),
                    _ => None,
                };
                Ok(Fitted { warning, ..model.into() })
            }
            Coefficients::Keeping(tolerance) => {
                Ok(model::fit_automatic(ingredients, kind, tolerance, progress)?.into())
            }
            Coefficients::AtMost(largest, tolerance) => {
                let model = model::fit_narrow(ingredients, kind, tolerance, largest, progress)?;
                Ok(model.map_or(Fitted { model: None, warning: None }, Fitted::from))
            }
        }
    }
}

/// The warning that a model with one coefficient less is better; negligible errors do not count.
fn fewer_are_better(model: &ColourModel, smaller: &ColourModel) -> Option<PlanWarning> {
    let (stated, fewer) = (model.worst().max, smaller.worst().max);
    (fewer < stated && stated >= 0.0005).then(|| PlanWarning::FewerAreBetter {
        stated: (model.dimension(), stated),
        fewer: (smaller.dimension(), fewer),
    })
}

#[cfg(test)]
#[expect(clippy::unwrap_used, reason = "a test fails by panicking")]
mod tests {
    use super::*;
    use relume_base::progress::Quiet;
    use relume_colour::spectrum::{Spectrum, standard};

    fn wanted(coefficients: Coefficients) -> Wanted {
        let reflectances =
            [500.0, 600.0].map(|edge| Spectrum::from_fn(|nm| if nm < edge { 0.2 } else { 0.8 })).to_vec();
        let lights = vec![("day".to_owned(), standard::d65().clone())];
        Wanted {
            ingredients: Ingredients { reflectances, lights, ..Ingredients::default() },
            kind: ModelKind::Nodes,
            coefficients,
        }
    }

    #[test]
    fn a_recent_model_is_not_fitted_again_and_others_are() {
        let recent = Recent(Mutex::new(VecDeque::new()));
        let fitted = |coefficients| recent.fitted(wanted(coefficients), &Quiet).unwrap().model;
        let two = fitted(Coefficients::Stated(2)).unwrap();
        let fresh = wanted(Coefficients::Stated(2)).fit(&Quiet).unwrap().model.unwrap();
        assert_eq!(two.nodes_nm(), fresh.nodes_nm());
        assert_eq!(two.worst(), fresh.worst());
        assert_eq!(fitted(Coefficients::Stated(3)).unwrap().dimension(), 3);
        assert!(fitted(Coefficients::AtMost(1, 1e-9)).is_none(), "one coefficient keeps no such tolerance");
        assert!(fitted(Coefficients::AtMost(1, 1e-9)).is_none(), "this is known now");
        assert!(Arc::ptr_eq(&two, &fitted(Coefficients::Stated(2)).unwrap()), "the same model, not an equal one");
        let other = Wanted { kind: ModelKind::Bands, ..wanted(Coefficients::Stated(2)) };
        assert_eq!(recent.fitted(other, &Quiet).unwrap().model.unwrap().kind(), ModelKind::Bands);
        // That with two coefficients is used in between, so the one with three goes first.
        for largest in 1..MOST {
            recent.fitted(wanted(Coefficients::AtMost(largest, 1e3)), &Quiet).unwrap();
            fitted(Coefficients::Stated(2));
        }
        let kept = recent.0.lock().unwrap();
        assert_eq!(kept.len(), MOST);
        let is_kept = |dimension| kept.iter().any(|(known, _)| known.coefficients == Coefficients::Stated(dimension));
        assert!(is_kept(2) && !is_kept(3));
    }
}
