//! What is said of a colour model: its errors, and those under lights that it was not planned for.

use serde_json::{Value, json};

use relume::model::{ColourModel, ErrorSummary, LightMatrix, ModelError, Reconstruction};
use relume::scene::Mix;
use relume::spectrum::Light;

/// Fits `model` to those lights of `mix` that it does not have, and warns of the ones whose colours may be off by more
/// than `tolerance`, with the `way_out`.
///
/// # Errors
///
/// [`ModelError::NotFinite`] for lights, or stored models, that cannot be computed with.
pub(crate) fn learn(model: &mut ColourModel, mix: &Mix, tolerance: f64, way_out: &str) -> Result<Learnt, ModelError> {
    let planned = model.lights().len();
    for light in &mix.0 {
        model.learn(&light.name, &light.spectrum)?;
    }
    for (name, _, matrix) in &model.lights()[planned..] {
        let ErrorSummary { mean, max, .. } = matrix.worst();
        if max > tolerance {
            tracing::warn!(
                "the colour model was not planned for the light {name}: colours under it may differ by ΔE00 {max:.2} \
                 ({mean:.2} on average), which is over the tolerance of {tolerance}; {way_out}"
            );
        }
    }
    Ok(Learnt { planned })
}

/// Which lights of a model it was planned for.
#[derive(Clone, Copy)]
pub(crate) struct Learnt {
    /// How many they are; the others follow.
    planned: usize,
}

impl Learnt {
    /// A model that was planned for all its lights.
    pub(crate) fn nothing(model: &ColourModel) -> Self {
        Self { planned: model.lights().len() }
    }

    /// A line on each light that the model was not planned for.
    pub(crate) fn text(self, model: &ColourModel) -> String {
        let line = |(name, _, matrix): &(String, Light, LightMatrix)| {
            let ErrorSummary { mean, p95, max } = matrix.worst();
            let tried = match matrix.unseen {
                Some(_) => "",
                None => " on the colours that it was fitted on, and more on others",
            };
            format!(
                "{name} is new to the colour model: ΔE00 {mean:.3} on average, p95 {p95:.3}, at most {max:.3}{tried}\n"
            )
        };
        model.lights()[self.planned..].iter().map(line).collect()
    }

    /// The model for programs.
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

/// How good full spectra of a model's numbers are, for programs and for files.
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
