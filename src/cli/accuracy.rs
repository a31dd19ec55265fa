//! How accurate colours are to be, by flags that take the place of the scene's `[accuracy]`.

use clap::Args;
use clap::builder::PossibleValuesParser;

use relume::model::ModelKind;
use relume::scene::Definition;

/// Where `--help` explains it.
const COLOUR: &str = "Colour accuracy, in place of the scene's [accuracy]";

/// What pixels keep of a spectrum.
#[derive(Debug, Args)]
pub(crate) struct AccuracyArgs {
    /// Let a colour model add at most this ΔE00 (1 is about what an eye can see) to the colours that are tried, in as few numbers
    /// a pixel as that takes.
    #[arg(long, help_heading = COLOUR, value_name = "DE", conflicts_with = "k", allow_negative_numbers = true)]
    tolerance: Option<f64>,
    /// Let a colour model have N numbers, 1 to 31, whatever ΔE00 it adds.
    #[arg(long, help_heading = COLOUR, value_name = "N", allow_negative_numbers = true)]
    k: Option<i64>,
    /// Carry spectra by this model where pixels keep no weights of materials. Others than nodes are for comparison.
    #[arg(long, help_heading = COLOUR, value_parser = PossibleValuesParser::new(ModelKind::ALL.map(ModelKind::name)))]
    model: Option<String>,
    /// Keep weights of the materials (exact where all absorption is grey), or the numbers of a colour model.
    #[arg(long, help_heading = COLOUR, value_parser = PossibleValuesParser::new(["auto", "weights", "spectral"]))]
    accumulate: Option<String>,
}

impl AccuracyArgs {
    /// What the flags change in a scene file.
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
        // TOML writes `nan`; anything else that is no number would be a string.
        if let Some(tolerance) = self.tolerance.map(|tolerance| tolerance.to_string().to_lowercase()) {
            define("--tolerance", &tolerance, format!("accuracy.tolerance={tolerance}"));
            define("--tolerance", &tolerance, "accuracy.k=auto".to_owned());
        }
        definitions
    }

    /// The flags that are given.
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

/// A ΔE00 above 0.
pub(crate) fn tolerance(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|&number: &f64| number > 0.0);
    number.ok_or_else(|| "write a ΔE00 above 0, such as 0.5".to_owned())
}
