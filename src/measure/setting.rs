//! Settings: changes to a scene's own accuracy, knob by knob.

use std::collections::BTreeMap;
use std::fmt;
use std::ops::RangeInclusive;

use serde::{Serialize, Serializer};

use relume_base::number::{count, readable, whole};
use relume_colour::model::{LARGEST_DIMENSION, ModelKind};
use relume_scene::{
    AccumulateAs, Gradients, Integration, Interpolation, LabelInterpolation, Lookup, MOST_RAYS, MOST_VOXEL_PIXELS,
    Scene, StoreAs, VolumeAs,
};

/// An option that trades speed for accuracy.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Knob {
    /// Colour model; selects spectral accumulation in place of weights.
    Model,
    /// Dimension of the colour model.
    K,
    /// Contents of an accumulator: weights, or coefficients of a colour model.
    Accumulate,
    /// Bits of finished accumulators.
    Storage,
    /// Step length, in units of the smallest voxel spacing.
    Step,
    /// Transmittance at which a ray ends.
    Termination,
    /// Rays of a pixel.
    Rays,
    /// Integration along a ray: point samples or segments.
    Integration,
    /// Variation from which a segment is divided.
    Variation,
    /// Spacing of the light grid, in voxels.
    Spacing,
    /// Directions of the sky.
    Directions,
    /// Interpolation between voxels.
    Interpolation,
    /// Labels between voxels.
    Labels,
    /// Storage of the volume.
    Volume,
    /// Source of the gradients.
    Gradients,
    /// Entries of the transfer table.
    Entries,
    /// Lookup in the transfer table.
    Lookup,
    /// Empty-space skipping.
    Skipping,
    /// Largest size of a voxel in the picture, in pixels, for which a coarser level of the volume is taken.
    VoxelPixels,
    /// Marched pixels across as a fraction of those asked for; the picture is enlarged.
    Scale,
}

/// Value of a knob.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Value {
    /// A number.
    Number(f64),
    /// A choice by name.
    Name(&'static str),
}

/// Allowed values of a knob.
pub(super) enum Choices {
    Names(Vec<&'static str>),
    Numbers { range: RangeInclusive<f64>, whole: bool, growth: Growth },
}

/// Progression from one number of a range to the next.
pub(super) enum Growth {
    Plus(f64),
    Times(f64),
}

impl Knob {
    /// All knobs.
    pub const ALL: [Self; 20] = [
        Self::Model,
        Self::K,
        Self::Accumulate,
        Self::Storage,
        Self::Step,
        Self::Termination,
        Self::Rays,
        Self::Integration,
        Self::Variation,
        Self::Spacing,
        Self::Directions,
        Self::Interpolation,
        Self::Labels,
        Self::Volume,
        Self::Gradients,
        Self::Entries,
        Self::Lookup,
        Self::Skipping,
        Self::VoxelPixels,
        Self::Scale,
    ];

    /// Name on the command line and in reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Model => "model",
            Self::K => "k",
            Self::Accumulate => "accumulate",
            Self::Storage => "storage",
            Self::Step => "step",
            Self::Termination => "termination",
            Self::Rays => "rays",
            Self::Integration => "integration",
            Self::Variation => "variation",
            Self::Spacing => "spacing",
            Self::Directions => "directions",
            Self::Interpolation => "interpolation",
            Self::Labels => "labels",
            Self::Volume => "volume",
            Self::Gradients => "gradients",
            Self::Entries => "entries",
            Self::Lookup => "lookup",
            Self::Skipping => "skipping",
            Self::VoxelPixels => "voxel_pixels",
            Self::Scale => "scale",
        }
    }

    /// Description for users.
    #[must_use]
    pub const fn meaning(self) -> &'static str {
        match self {
            Self::Model => "colour model (k = 8; RGB has 3)",
            Self::K => "dimension of the colour model",
            Self::Accumulate => "contents of a pixel: material weights or coefficients",
            Self::Storage => "bits of the stored numbers",
            Self::Step => "distance between two samples along a ray, in voxels",
            Self::Termination => "transmittance at which a ray ends",
            Self::Rays => "rays of a pixel, whose mean it is",
            Self::Integration => "samples of the medium, or segments between two values",
            Self::Spacing => "voxels between nodes of the light grid",
            Self::Directions => "directions of the sky",
            Self::Variation => "variation from which a segment is divided",
            Self::Interpolation => "interpolation between voxels",
            Self::Labels => "labels between voxels: shares of those around, or the nearest",
            Self::Volume => "format of the stored voxels",
            Self::Gradients => "source of the gradients",
            Self::Entries => "entries of the transfer table",
            Self::Lookup => "lookup in the transfer table",
            Self::Skipping => "empty-space skipping",
            Self::VoxelPixels => "largest voxel in the picture, in pixels, by a coarser level; 0: all voxels",
            Self::Scale => "marched pixels across, as a share",
        }
    }

    /// Allowed values of this knob.
    pub(super) fn choices(self) -> Choices {
        let numbers = |range, whole, growth| Choices::Numbers { range, whole, growth };
        match self {
            Self::Model => Choices::Names(ModelKind::ALL.map(ModelKind::name).to_vec()),
            Self::K => numbers(1.0..=count(LARGEST_DIMENSION), true, Growth::Plus(1.0)),
            Self::Accumulate => Choices::Names(vec!["auto", "weights", "spectral"]),
            Self::Storage => Choices::Names(vec!["f32", "f16"]),
            Self::Step => numbers(1e-2..=1e3, false, Growth::Times(2.0)),
            Self::Termination => numbers(0.0..=0.5, false, Growth::Times(10.0)),
            Self::Rays => numbers(1.0..=count(MOST_RAYS), true, Growth::Times(4.0)),
            Self::Integration => Choices::Names(vec!["auto", "segments", "samples"]),
            Self::Variation => numbers(1e-6..=1.0, false, Growth::Times(10.0)),
            Self::Spacing => numbers(0.5..=64.0, false, Growth::Times(2.0)),
            Self::Directions => numbers(8.0..=1024.0, true, Growth::Times(2.0)),
            Self::Interpolation => Choices::Names(vec!["nearest", "linear", "exact-linear", "cubic"]),
            Self::Labels => Choices::Names(vec!["smooth", "nearest"]),
            Self::Volume => Choices::Names(vec!["auto", "f32", "u16"]),
            Self::Gradients => Choices::Names(vec!["packed", "central"]),
            Self::Entries => numbers(2.0..=65536.0, true, Growth::Times(2.0)),
            Self::Lookup => Choices::Names(vec!["nearest", "linear"]),
            Self::Skipping => Choices::Names(vec!["on", "off"]),
            Self::VoxelPixels => numbers(0.0..=MOST_VOXEL_PIXELS, false, Growth::Times(2.0)),
            Self::Scale => numbers(0.05..=1.0, false, Growth::Times(2.0)),
        }
    }

    /// Applies the knob to `scene`. [`Self::Scale`] has no effect, because it is not part of a scene.
    fn turn(self, value: Value, scene: &mut Scene) {
        /// Default dimension of a colour model.
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
                accuracy.step_length = voxels * scene.frame.geometry.spacing.min_element();
            }
            (Self::Termination, Value::Number(share)) => accuracy.termination = share,
            (Self::Rays, Value::Number(rays)) => accuracy.rays = whole(rays),
            (Self::Integration, Value::Name(name)) => {
                accuracy.integration = match name {
                    "segments" => Integration::Segments,
                    "samples" => Integration::Samples,
                    _ => Integration::Auto,
                };
            }
            (Self::Variation, Value::Number(variation)) => accuracy.variation = variation,
            (Self::Spacing, Value::Number(spacing)) => scene.shadows.spacing = spacing,
            (Self::Directions, Value::Number(directions)) => scene.shadows.directions = whole(directions),
            (Self::Interpolation, Value::Name(name)) => {
                accuracy.interpolation = match name {
                    "nearest" => Interpolation::Nearest,
                    "exact-linear" => Interpolation::ExactLinear,
                    "cubic" => Interpolation::Cubic,
                    _ => Interpolation::Linear,
                };
            }
            (Self::Labels, Value::Name(name)) => {
                accuracy.labels =
                    if name == "nearest" { LabelInterpolation::Nearest } else { LabelInterpolation::Smooth };
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
            (Self::VoxelPixels, Value::Number(pixels)) => accuracy.voxel_pixels = pixels,
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

/// Values of some knobs; all others keep the scene's values.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Setting(BTreeMap<Knob, Value>);

impl Setting {
    /// Returns the setting with `knob` at `value`.
    #[must_use]
    pub(super) fn with(mut self, knob: Knob, value: Value) -> Self {
        self.0.insert(knob, value);
        self
    }

    /// Value of `knob`, if the setting states one.
    #[must_use]
    pub fn get(&self, knob: Knob) -> Option<Value> {
        self.0.get(&knob).copied()
    }

    /// The stated knobs and their values.
    pub fn knobs(&self) -> impl Iterator<Item = (Knob, Value)> {
        self.0.iter().map(|(&knob, &value)| (knob, value))
    }

    /// The stated colour model.
    #[must_use]
    pub fn model(&self) -> Option<ModelKind> {
        match self.get(Knob::Model)? {
            Value::Name(name) => name.parse().ok(),
            Value::Number(_) => None,
        }
    }

    /// Whether the setting is consistent: RGB has dimension 3.
    pub(super) fn is_possible(&self) -> bool {
        let three = self.get(Knob::K).is_none_or(|k| k == Value::Number(3.0));
        three || !self.model().is_some_and(ModelKind::is_rgb)
    }

    /// Marched pixels across as a fraction of those displayed.
    #[must_use]
    pub fn scale(&self) -> f64 {
        match self.get(Knob::Scale) {
            Some(Value::Number(scale)) => scale,
            _ => 1.0,
        }
    }

    /// Marched pixels across and down for a picture of `size`.
    #[must_use]
    pub fn marched_size(&self, size: [usize; 2]) -> [usize; 2] {
        size.map(|side| whole((count(side) * self.scale()).round()).max(1))
    }

    /// Returns `scene` with this setting applied.
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
