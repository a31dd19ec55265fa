//! What a picture is of: materials, transfer function, lights, camera and the volume they belong to.

mod camera;
mod lights;
mod transfer;

use std::sync::Arc;

pub use camera::{Aim, Camera, Projection, View};
pub(crate) use camera::{centre, unit};
pub(crate) use lights::INTENSITY;
pub use lights::{Mix, MixLight, Placement, Position, positions};
pub(crate) use transfer::depth_from_opacity;
pub use transfer::{Interval, Lookup, MaterialCurve, Medium, OPAQUE_DEPTH, Term, Transfer};

use crate::model::ModelKind;
use crate::spectrum::deficiency::Deficiency;
use crate::spectrum::observer::Observer;
use crate::spectrum::{Absorption, Light, Reflectance};
use crate::volume::Volume;

/// Everything a picture depends on, resolved: no names to look up, no files to read.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Name, for messages and reports.
    pub name: String,
    /// The grey values.
    pub volume: Arc<Volume>,
    /// Labels on the same grid, where the scene has them.
    pub labels: Option<Labels>,
    /// In the order of their names. Weights of a pixel are in this order too.
    pub materials: Vec<Material>,
    /// Which values scatter how much, as which material.
    pub transfer: Transfer,
    /// In the order of their names.
    pub lights: Vec<SceneLight>,
    /// Whether lights shade by direction at all.
    pub shading: Shading,
    /// A surface behind everything, lit by every light; `None` is black and costs nothing.
    pub background: Option<Reflectance>,
    /// Where the picture is taken from.
    pub camera: Camera,
    /// The part of the volume that is shown, in voxel indices, corner to corner; `None` is all of it.
    pub crop: Option<[glam::DVec3; 2]>,
    /// The trade of speed for accuracy.
    pub accuracy: Accuracy,
    /// How colours reach the screen.
    pub display: Display,
}

impl Scene {
    /// Whether anything can show the material `index`: a value of the transfer function, or a label.
    #[must_use]
    pub fn shows(&self, index: usize) -> bool {
        self.uses(index, |term| &term.opacity, |entry| entry.opacity)
    }

    /// Whether the material `index` absorbs light anywhere, by a value of the transfer function or a label.
    #[must_use]
    pub fn absorbs(&self, index: usize) -> bool {
        self.materials.get(index).is_some_and(|material| material.absorption.is_some())
            && self.uses(index, |term| &term.absorption, |entry| entry.absorption)
    }

    fn uses(
        &self,
        index: usize,
        height: impl Fn(&Term) -> &Vec<(f64, f64)>,
        of_label: impl Fn(&LabelEntry) -> f64,
    ) -> bool {
        let in_transfer = self.transfer.terms.iter().any(|term| {
            height(term).iter().any(|point| point.1 > 0.0) && term.material.0.iter().any(|point| point.1 == index)
        });
        let in_labels = self
            .labels
            .as_ref()
            .is_some_and(|labels| labels.declared.iter().any(|entry| entry.material == index && of_label(entry) > 0.0));
        in_transfer || in_labels
    }
}

/// A spectral material.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Its name in the scene.
    pub name: String,
    /// Colour of its ambient and diffuse part.
    pub reflectance: Reflectance,
    /// The shape of what it absorbs, where it does; how much is said by the transfer function.
    pub absorption: Option<Absorption>,
    /// Share of a directed light that arrives from everywhere, 0 to 1.
    pub ambient: f64,
    /// Share that follows |n·l|, 0 to 1.
    pub diffuse: f64,
    /// Share that follows |n·h|^exponent, in the light's own colour, 0 to 1.
    pub specular: f64,
    /// Exponent of the specular part.
    pub exponent: u32,
    /// Adds light but occludes nothing (§5.2 of the paper).
    pub xray: bool,
}

impl Material {
    /// `opacity`, or the nearest one that this material can have: what shines through everything never hides all.
    #[must_use]
    pub fn allowed_opacity(&self, opacity: f64) -> f64 {
        let most = if self.xray { 0.999 } else { 1.0 };
        if opacity.is_nan() { 0.0 } else { opacity.clamp(0.0, most) }
    }
}

/// Labels of the voxels and what they mean.
#[derive(Clone, Debug)]
pub struct Labels {
    /// One label a voxel, on the grid of the grey values.
    pub volume: Arc<Volume>,
    /// What the scene declares; label 0, and labels that are not declared, follow the transfer function.
    pub declared: Vec<LabelEntry>,
}

/// What one label shows as.
#[derive(Clone, Debug, PartialEq)]
pub struct LabelEntry {
    /// The label, never 0.
    pub label: u32,
    /// A name for people.
    pub name: String,
    /// Index into [`Scene::materials`].
    pub material: usize,
    /// What one opacity length of it hides, 0 to 1.
    pub opacity: f64,
    /// Optical depth of one opacity length of it where its material absorbs most.
    pub absorption: f64,
}

/// A light of the scene.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneLight {
    /// Its name in the scene.
    pub name: String,
    /// Its spectrum: a perfect reflector under it has Y = 1.
    pub spectrum: Light,
    /// What the spectrum is multiplied by.
    pub intensity: f64,
    /// Where it shines from.
    pub placement: Placement,
}

/// Whether the picture is shaded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shading {
    /// Every light arrives everywhere alike.
    None,
    /// Ambient, diffuse and specular parts, by the gradient of the data.
    #[default]
    Gradient,
}

/// Between voxels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Interpolation {
    /// The value of the nearest voxel.
    Nearest,
    /// Trilinear, by the device's own filter.
    #[default]
    Linear,
    /// Trilinear in f32: eight fetches in place of one. Moves the device's error where its filter has few bits.
    ExactLinear,
    /// A cubic B-spline, 64 fetches: smoother surfaces, and details of a voxel or two softer.
    Cubic,
}

/// The knobs; each says what it costs and which error it moves.
#[derive(Clone, Debug, PartialEq)]
pub struct Accuracy {
    /// Δs in world units; time goes with 1/Δs, the step error of a smooth volume with Δs².
    pub step_length: f64,
    /// A ray ends once less than this share of light can pass; moves a pixel by at most this share of the brightest
    /// thing behind (docs/theory/numerics.md): a ten-thousandth of white behind black is ΔE00 0.05. 0 follows every ray to its end.
    pub termination: f64,
    /// Leaping over cells that hold nothing; exact, so it moves no error.
    pub skipping: bool,
    /// How values between voxels are made.
    pub interpolation: Interpolation,
    /// How the volume is stored.
    pub volume: VolumeAs,
    /// Where gradients come from, where shading needs them.
    pub gradients: Gradients,
    /// What pixels store.
    pub accumulate: AccumulateAs,
    /// What carries spectra where pixels store no weights.
    pub model: ModelKind,
    /// The largest ΔE00 that the colour model may add; a smaller one takes more numbers a pixel.
    pub tolerance: f64,
    /// k, where it is stated; then `tolerance` is not looked at.
    pub dimension: Option<usize>,
    /// How finished accumulators are stored: 16 bits take half the memory and move colours by up to what
    /// [`Planned::half_precision_error`](crate::plan::Planned::half_precision_error) says.
    pub storage: StoreAs,
}

/// How voxels are stored on a device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Deserialize, serde::Serialize)]
pub enum VolumeAs {
    /// In 16 bits where that loses nothing, else in f32.
    #[default]
    #[serde(rename = "auto")]
    Auto,
    /// In f32: twice the memory, and gradients that are not rounded to 16 bits.
    #[serde(rename = "f32")]
    Single,
    /// In 16 bits, whatever that loses: half the memory of f32.
    #[serde(rename = "u16")]
    Short,
}

/// Where gradients come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Gradients {
    /// Central differences of voxels, stored beside the values: four times the memory, one fetch.
    #[default]
    Packed,
    /// Central differences of values a voxel before and behind a sample: seven fetches.
    Central,
}

/// How the numbers of finished accumulators are stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Deserialize, serde::Serialize)]
pub enum StoreAs {
    /// As they were summed up.
    #[default]
    #[serde(rename = "f32")]
    Single,
    /// Rounded to the nearest 16-bit float.
    #[serde(rename = "f16")]
    Half,
}

/// What pixels store.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum AccumulateAs {
    /// Weights where they are exact and fill no more vectors than the numbers of a colour model, else those.
    #[default]
    Auto,
    /// One weight per material: exact, where all that absorbs is grey.
    Weights,
    /// A spectrum in k numbers.
    Spectral,
}

/// The way from XYZ to the screen.
#[derive(Clone, Debug, PartialEq)]
pub struct Display {
    /// What linear sRGB is multiplied by.
    pub exposure: f64,
    /// Bradford adaptation of the mixed lights' white to D65; off, a tungsten light looks orange.
    pub adapt: bool,
    /// Whose eyes make colours of spectra.
    pub observer: Observer,
    /// Which cones are missing in those whom it is a preview for; `None` has all.
    pub deficiency: Option<Deficiency>,
}
