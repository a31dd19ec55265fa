//! A setting: what it changes about a scene's own accuracy, knob by knob.

use std::collections::BTreeMap;
use std::fmt;
use std::ops::RangeInclusive;

use serde::{Serialize, Serializer};

use crate::model::{LARGEST_DIMENSION, ModelKind};
use crate::number::{count, readable, whole};
use crate::scene::{AccumulateAs, Gradients, Interpolation, Lookup, Scene, StoreAs, VolumeAs};

/// What speed is traded for accuracy by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Knob {
    /// What carries spectra: a colour model, in place of weights.
    Model,
    /// How many numbers that has.
    K,
    /// What pixels store: weights, or the numbers of a colour model.
    Accumulate,
    /// Bits of finished accumulators.
    Storage,
    /// Samples: how far apart, counted in the smallest spacing of the voxels.
    Step,
    /// How little light ends a ray.
    Termination,
    /// How values between voxels are made.
    Interpolation,
    /// How the volume is stored.
    Volume,
    /// Where gradients come from.
    Gradients,
    /// Entries of the transfer table.
    Entries,
    /// How that is read.
    Lookup,
    /// Whether empty space is leapt over.
    Skipping,
    /// Pixels across that are marched, as a share of those asked for; the picture is enlarged.
    Scale,
}

/// What a knob is set to.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Value {
    /// A number.
    Number(f64),
    /// A choice by name.
    Name(&'static str),
}

/// What a knob can be set to.
pub(super) enum Choices {
    Names(Vec<&'static str>),
    Numbers { range: RangeInclusive<f64>, whole: bool, growth: Growth },
}

/// From one number of a range to the next.
pub(super) enum Growth {
    Plus(f64),
    Times(f64),
}

impl Knob {
    /// All of them.
    pub const ALL: [Self; 13] = [
        Self::Model,
        Self::K,
        Self::Accumulate,
        Self::Storage,
        Self::Step,
        Self::Termination,
        Self::Interpolation,
        Self::Volume,
        Self::Gradients,
        Self::Entries,
        Self::Lookup,
        Self::Skipping,
        Self::Scale,
    ];

    /// Its name on the command line and in reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Model => "model",
            Self::K => "k",
            Self::Accumulate => "accumulate",
            Self::Storage => "storage",
            Self::Step => "step",
            Self::Termination => "termination",
            Self::Interpolation => "interpolation",
            Self::Volume => "volume",
            Self::Gradients => "gradients",
            Self::Entries => "entries",
            Self::Lookup => "lookup",
            Self::Skipping => "skipping",
            Self::Scale => "scale",
        }
    }

    /// What it turns, for people.
    #[must_use]
    pub const fn meaning(self) -> &'static str {
        match self {
            Self::Model => "what carries spectra (k = 8; RGB has 3)",
            Self::K => "numbers a pixel keeps of a spectrum",
            Self::Accumulate => "what pixels keep",
            Self::Storage => "bits of what pixels keep",
            Self::Step => "distance between two samples along a ray, in voxels",
            Self::Termination => "share of light at which a ray ends",
            Self::Interpolation => "values between voxels",
            Self::Volume => "how voxels are stored",
            Self::Gradients => "where gradients come from",
            Self::Entries => "entries of the transfer table",
            Self::Lookup => "reading the transfer table",
            Self::Skipping => "leaping over empty space",
            Self::Scale => "pixels across, as a share",
        }
    }

    /// What it can be set to.
    pub(super) fn choices(self) -> Choices {
        let numbers = |range, whole, growth| Choices::Numbers { range, whole, growth };
        match self {
            Self::Model => Choices::Names(ModelKind::ALL.map(ModelKind::name).to_vec()),
            Self::K => numbers(1.0..=count(LARGEST_DIMENSION), true, Growth::Plus(1.0)),
            Self::Accumulate => Choices::Names(vec!["auto", "weights", "spectral"]),
            Self::Storage => Choices::Names(vec!["f32", "f16"]),
            Self::Step => numbers(1e-2..=1e3, false, Growth::Times(2.0)),
            Self::Termination => numbers(0.0..=0.5, false, Growth::Times(10.0)),
            Self::Interpolation => Choices::Names(vec!["nearest", "linear", "exact-linear", "cubic"]),
            Self::Volume => Choices::Names(vec!["auto", "f32", "u16"]),
            Self::Gradients => Choices::Names(vec!["packed", "central"]),
            Self::Entries => numbers(2.0..=65536.0, true, Growth::Times(2.0)),
            Self::Lookup => Choices::Names(vec!["nearest", "linear"]),
            Self::Skipping => Choices::Names(vec!["on", "off"]),
            Self::Scale => numbers(0.05..=1.0, false, Growth::Times(2.0)),
        }
    }

    /// Sets it in `scene`; all but [`Self::Scale`], which is no scene's.
    fn turn(self, value: Value, scene: &mut Scene) {
        /// The numbers of a model where nobody says how many.
        const USUAL: usize = 8;
        let accuracy = &mut scene.accuracy;
        match (self, value) {
            (Self::Model, Value::Name(name)) => {
                accuracy.accumulate = AccumulateAs::Spectral;
                accuracy.model = name.parse().unwrap_or_default();
                let usual = accuracy.dimension.unwrap_or(USUAL);
                accuracy.dimension = Some(if accuracy.model.is_rgb() { 3 } else { usual });
            }
            (Self::K, Value::Number(k)) => {
                accuracy.accumulate = AccumulateAs::Spectral;
                accuracy.dimension = Some(whole(k));
            }
            (Self::Accumulate, Value::Name(name)) => {
                accuracy.accumulate = match name {
                    "weights" => AccumulateAs::Weights,
                    "spectral" => AccumulateAs::Spectral,
                    _ => AccumulateAs::Auto,
                };
            }
            (Self::Storage, Value::Name(name)) => {
                accuracy.storage = if name == "f16" { StoreAs::Half } else { StoreAs::Single };
            }
            (Self::Step, Value::Number(voxels)) => {
                accuracy.step_length = voxels * scene.volume.geometry.spacing.min_element();
            }
            (Self::Termination, Value::Number(share)) => accuracy.termination = share,
            (Self::Interpolation, Value::Name(name)) => {
                accuracy.interpolation = match name {
                    "nearest" => Interpolation::Nearest,
                    "exact-linear" => Interpolation::ExactLinear,
                    "cubic" => Interpolation::Cubic,
                    _ => Interpolation::Linear,
                };
            }
            (Self::Volume, Value::Name(name)) => {
                accuracy.volume = match name {
                    "f32" => VolumeAs::Single,
                    "u16" => VolumeAs::Short,
                    _ => VolumeAs::Auto,
                };
            }
            (Self::Gradients, Value::Name(name)) => {
                accuracy.gradients = if name == "central" { Gradients::Central } else { Gradients::Packed };
            }
            (Self::Entries, Value::Number(entries)) => scene.transfer.entries = Some(whole(entries)),
            (Self::Lookup, Value::Name(name)) => {
                scene.transfer.lookup = if name == "nearest" { Lookup::Nearest } else { Lookup::Linear };
            }
            (Self::Skipping, Value::Name(name)) => accuracy.skipping = name == "on",
            _ => {}
        }
    }
}

impl fmt::Display for Knob {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.pad(self.name())
    }
}

impl fmt::Display for Value {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(number) => out.pad(&readable(*number)),
            Self::Name(name) => out.pad(name),
        }
    }
}

/// One point of all knobs: those that it names stand there, all others as the scene has them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Setting(BTreeMap<Knob, Value>);

impl Setting {
    /// The same with `knob` at `value`.
    #[must_use]
    pub(super) fn with(mut self, knob: Knob, value: Value) -> Self {
        self.0.insert(knob, value);
        self
    }

    /// Where `knob` stands, if that is not where the scene has it.
    #[must_use]
    pub fn get(&self, knob: Knob) -> Option<Value> {
        self.0.get(&knob).copied()
    }

    /// The knobs it names.
    pub fn knobs(&self) -> impl Iterator<Item = (Knob, Value)> {
        self.0.iter().map(|(&knob, &value)| (knob, value))
    }

    /// The colour model it names.
    #[must_use]
    pub fn model(&self) -> Option<ModelKind> {
        match self.get(Knob::Model)? {
            Value::Name(name) => name.parse().ok(),
            Value::Number(_) => None,
        }
    }

    /// Whether there can be such a thing: RGB has three numbers.
    pub(super) fn is_possible(&self) -> bool {
        let three = self.get(Knob::K).is_none_or(|k| k == Value::Number(3.0));
        three || !self.model().is_some_and(ModelKind::is_rgb)
    }

    /// The share of the pixels across that are marched.
    #[must_use]
    pub fn scale(&self) -> f64 {
        match self.get(Knob::Scale) {
            Some(Value::Number(scale)) => scale,
            _ => 1.0,
        }
    }

    /// The pixels across and down that are marched for a picture of `size`.
    #[must_use]
    pub fn marched_size(&self, size: [usize; 2]) -> [usize; 2] {
        size.map(|side| whole((count(side) * self.scale()).round()).max(1))
    }

    /// `scene` as this setting has it.
    #[must_use]
    pub fn applied(&self, scene: &Scene) -> Scene {
        let mut scene = scene.clone();
        for (knob, value) in self.knobs() {
            knob.turn(value, &mut scene);
        }
        scene
    }
}

impl fmt::Display for Setting {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.is_empty() {
            return out.pad("as the scene says");
        }
        let named: Vec<String> = self.knobs().map(|(knob, value)| format!("{knob}={value}")).collect();
        out.pad(&named.join(" "))
    }
}

impl Serialize for Setting {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.knobs().map(|(knob, value)| (knob.name(), value)))
    }
}
