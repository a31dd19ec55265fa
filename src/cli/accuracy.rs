//! Flags for colour accuracy that replace keys of the scene's `[accuracy]`.

use clap::Args;
use clap::builder::PossibleValuesParser;

use crate::document::Definition;
use crate::model::ModelKind;
use crate::scene::AccumulateAs;
use crate::scene::key::Named as _;

/// Heading in `--help`.
const COLOUR: &str = "Colour accuracy (overrides [accuracy] of the scene)";

/// What pixels store of a spectrum.
#[derive(Debug, Args)]
pub(crate) struct AccuracyArgs {
    /// Choose the smallest k for which the colour model adds at most this ΔE00 (1 is just visible) to the tested colours.
    #[arg(long, help_heading = COLOUR, value_name = "DE", conflicts_with = "k", allow_negative_numbers = true)]
    tolerance: Option<f64>,
    /// Set the dimension of the colour model, 1 to 31, regardless of the ΔE00 it adds.
    #[arg(long, help_heading = COLOUR, value_name = "N", allow_negative_numbers = true)]
    k: Option<i64>,
    /// Colour model, if pixels do not store material weights. All models except nodes are for comparison.
    #[arg(long, help_heading = COLOUR, value_parser = PossibleValuesParser::new(ModelKind::ALL.map(ModelKind::name)))]
    model: Option<String>,
    /// Store material weights (exact where all absorption is grey), or the coefficients of a colour model.
    #[arg(long, help_heading = COLOUR, value_parser = PossibleValuesParser::new(AccumulateAs::ALL.iter().map(|(_, name)| name)))]
    accumulate: Option<String>,
}

impl AccuracyArgs {
    /// Changes to the scene file.
    pub(crate) fn definitions(&self) -> Vec<Definition> {
        let mut definitions = Vec::new();
        let mut define = |flag: &str, value: &str, text: String| {
            definitions.push(Definition { given: format!("{flag} {value}"), text });
        };
        if let Some(accumulate) = &self.accumulate {
            define("--accumulate", accumulate, format!("accuracy.accumulate={accumulate}"));
        }
        if let Some(model) = &self.model {
            define("--model", model, format!("accuracy.model={model}"));
        }
        if let Some(k) = self.k.map(|k| k.to_string()) {
            define("--k", &k, format!("accuracy.k={k}"));
        }
        // Lower case, because TOML spells it `nan`; `NaN` would become a string.
        if let Some(tolerance) = self.tolerance.map(|tolerance| tolerance.to_string().to_lowercase()) {
            define("--tolerance", &tolerance, format!("accuracy.tolerance={tolerance}"));
            define("--tolerance", &tolerance, "accuracy.k=auto".to_owned());
        }
        definitions
    }

    /// The value of `--tolerance`.
    pub(crate) fn tolerance(&self) -> Option<f64> {
        self.tolerance
    }

    /// Names of the given flags.
    pub(crate) fn given(&self) -> Vec<&'static str> {
        let given = [
            ("--tolerance", self.tolerance.is_some()),
            ("--k", self.k.is_some()),
            ("--model", self.model.is_some()),
            ("--accumulate", self.accumulate.is_some()),
        ];
        given.iter().filter(|(_, given)| *given).map(|(flag, _)| *flag).collect()
    }
}

/// Parses a ΔE00 above 0.
pub(crate) fn tolerance(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|&number: &f64| number > 0.0);
    number.ok_or_else(|| "write a ΔE00 above 0, such as 0.5".to_owned())
}
