//! Reports on a colour model: its errors, also under lights that were not in its plan.

use serde_json::{Value, json};

use crate::model::{ColourModel, ErrorSummary, LightMatrix, ModelError, Reconstruction};
use crate::plan::{PlanWarning, Planned};
use crate::scene::Mix;
use crate::spectrum::Light;

/// Prints the warnings of a plan, with the flags and keys that help.
pub(crate) fn warn_of_plan(planned: &Planned) {
    for warning in &planned.warnings {
        let help = match warning {
            PlanWarning::Unused { .. } => {
                "; accumulate = \"spectral\" (--accumulate spectral) keeps the coefficients of a colour model instead"
            }
            PlanWarning::Observer { .. } => "; use a smaller tolerance or a larger k",
            _ => "",
        };
        tracing::warn!("{warning}{help}");
    }
}

/// Fits `model` to the lights of `mix` that it does not have. Warns of each one with errors above `tolerance`, with the
/// remedy `way_out`.
///
/// # Errors
///
/// [`ModelError::NotFinite`] if a light or a stored model has values that are not finite.
pub(crate) fn learn(model: &mut ColourModel, mix: &Mix, tolerance: f64, way_out: &str) -> Result<Learnt, ModelError> {
    let planned = model.lights().len();
    let lights = mix.0.iter().map(|light| (light.name.as_str(), &light.spectrum));
    for light in model.learn_within(lights, tolerance)? {
        tracing::warn!("{light}; {way_out}");
    }
    Ok(Learnt { planned })
}

/// Number of a model's lights that were in its plan.
#[derive(Clone, Copy)]
pub(crate) struct Learnt {
    /// Planned lights; the others follow them.
    planned: usize,
}

impl Learnt {
    /// For a model without additional lights.
    pub(crate) fn nothing(model: &ColourModel) -> Self {
        Self { planned: model.lights().len() }
    }

    /// Returns a line for each light that was not in the model's plan.
    pub(crate) fn text(self, model: &ColourModel) -> String {
        let line = |(name, _, matrix): &(String, Light, LightMatrix)| {
            let ErrorSummary { mean, p95, max } = matrix.worst();
            let tried = match matrix.unseen {
                Some(_) => "",
                None => " on the colours of its fit, more on others",
            };
            format!(
                "{name} is new to the colour model: ΔE00 {mean:.3} on average, p95 {p95:.3}, at most {max:.3}{tried}\n"
            )
        };
        model.lights()[self.planned..].iter().map(line).collect()
    }

    /// The model as JSON.
    pub(crate) fn json(self, model: &ColourModel) -> Value {
        let light = |(index, (name, _, matrix)): (usize, &(String, Light, LightMatrix))| {
            let mut json = error_json(name, matrix.worst());
            json["planned"] = json!(index < self.planned);
            json["on_unseen_colours"] = json!(matrix.unseen.is_some());
            json
        };
        let worst = model.worst();
        json!({
            "kind": model.kind(),
            "observer": model.observer(),
            "description": model.description(),
            "k": model.dimension(),
            "nodes_nm": model.nodes_nm(),
            "mean": worst.mean,
            "p95": worst.p95,
            "max": worst.max,
            "lights": model.lights().iter().enumerate().map(light).collect::<Vec<_>>(),
        })
    }
}

/// Errors of full spectra reconstructed from a model's coefficients, as JSON for reports and files.
pub(crate) fn reconstruction_json(model: &ColourModel, reconstruction: &Reconstruction) -> Value {
    let lights: Vec<Value> = reconstruction.errors.iter().map(|(name, error)| error_json(name, *error)).collect();
    json!({
        "model": model.description(),
        "rms": reconstruction.rms,
        "rms_unit": "share of white at the same wavelength",
        "lights": lights,
        "lights_unit": "CIEDE2000",
    })
}

fn error_json(light: &str, error: ErrorSummary) -> Value {
    json!({ "name": light, "mean": error.mean, "p95": error.p95, "max": error.max })
}
