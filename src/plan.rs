//! What one frame computes: what the scene needs at the accuracy asked for.

mod explain;
mod half;
mod needs;
mod stale;

use std::sync::Arc;

pub(crate) use needs::is_constant;
use needs::{exponents, longest_way, transmittance};
pub use stale::Stale;

use crate::model::{self, ColourModel, ModelError, ModelKind};
use crate::progress::Progress;
use crate::scene::{
    AccumulateAs, Accuracy, Gradients, Interpolation, Lookup, Placement, Position, Scene, Shading, StoreAs, VolumeAs,
    positions,
};
use crate::spectrum::Light;
use crate::spectrum::observer::Observer;

/// Numbers in a shader's vector; accumulators and tables come in these.
pub const LANE: usize = 4;

/// The share of the tolerance that numbers may miss which take the place of weights: what is exact is given up for little.
const EXACTNESS: f64 = 0.5;

/// What one frame computes. Discrete choices only, among them the exponent that all highlights share; other numbers travel
/// beside it. Plans that a shader cannot tell apart share its pipeline.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct ScenePlan {
    /// What the pixels store.
    pub accumulate: Accumulate,
    /// Whether what passes has a colour.
    pub transmittance: Transmittance,
    /// Light positions that shading can tell apart: one accumulator each.
    pub positions: PositionCounts,
    /// What tells light positions apart; `None` while every light arrives everywhere alike.
    pub shading: Option<ShadingTerms>,
    /// Whether labels decide over the transfer function.
    pub labels: bool,
    /// Whether anything but black is behind the volume.
    pub background: bool,
    /// How the transfer table is read.
    pub lookup: Lookup,
    /// How values between voxels are made.
    pub interpolation: Interpolation,
    /// How the volume is stored.
    pub volume: VolumeAs,
    /// Where gradients come from; [`Gradients::Packed`] where none are needed.
    pub gradients: Gradients,
    /// Whether empty cells are leapt over.
    pub skipping: bool,
    /// How finished accumulators are stored.
    pub storage: StoreAs,
}

/// What the pixels store.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Accumulate {
    /// One weight per material in use (docs/theory/march.md): exact for every light, because opacity is grey and light scatters
    /// once. With specular materials one more, of white.
    Weights {
        /// Materials in use.
        materials: usize,
    },
    /// A spectrum in the k numbers of a colour model (docs/theory/colour-models.md).
    Spectral {
        /// k.
        dimension: usize,
        /// Which spectra a table entry holds of what a step reflects.
        shares: Shares,
        /// Different exponents of highlights: each has its own part of a table entry.
        exponents: usize,
    },
}

/// How the ambient and diffuse shares of the materials in use compare.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Shares {
    /// All alike: what a step reflects is one spectrum, shaded as a whole.
    Equal,
    /// Each its own: the ambient part of what a step reflects is one spectrum, the diffuse part another.
    Own,
}

/// Whether light that passes keeps its colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Transmittance {
    /// All that absorbs and scatters, summed, does so alike at all wavelengths: one number.
    Grey,
    /// One number per component of the colour model.
    Coloured,
    /// A matrix, row by row: what each component of the light behind adds to each of what comes through (Peercy 1993).
    Mixed,
}

/// Where in a table entry the parts of what a step reflects begin, in vectors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Parts {
    /// What light from everywhere has reflected; per material where weights are accumulated.
    pub unshaded: usize,
    /// The ambient share of a directed light.
    pub ambient: usize,
    /// The share that follows |n·l|.
    pub diffuse: usize,
    /// White, a part for each exponent.
    pub highlights: usize,
    /// Vectors an entry.
    pub lanes: usize,
}

/// Light positions of each kind. Ambient ones come first in the accumulators, then the headlight, directional ones and
/// points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct PositionCounts {
    /// 0 or 1: what shines from everywhere shines alike.
    pub ambient: usize,
    /// 0 or 1.
    pub headlight: usize,
    /// Lights at infinity.
    pub directional: usize,
    /// Lights at a point.
    pub point: usize,
}

/// How shading goes beyond light from everywhere. Without a diffuse and a specular part only the materials' ambient shares
/// are left of it, and no gradient is needed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ShadingTerms {
    /// Some material has a diffuse part.
    pub diffuse: bool,
    /// Some material has a specular part.
    pub specular: Option<Specular>,
}

/// How highlights are computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Specular {
    /// The exponent that serves all materials, compiled in; `None` where they have several.
    pub one_exponent: Option<u32>,
    /// Bits of the largest exponent: squarings per power.
    pub exponent_bits: u32,
}

/// A plan with what it is about: which materials and positions its components stand for.
#[derive(Clone, Debug, PartialEq)]
pub struct Planned {
    /// The choices.
    pub plan: ScenePlan,
    /// Materials in use: indices into [`Scene::materials`], in the order of the weights.
    pub materials: Vec<usize>,
    /// The light positions, in the order of the accumulators.
    pub positions: Vec<Position>,
    /// What carries spectra, where pixels store no weights.
    pub model: Option<Arc<ColourModel>>,
}

impl PositionCounts {
    /// All of them.
    #[must_use]
    pub fn total(&self) -> usize {
        self.ambient + self.headlight + self.directional + self.point
    }
}

impl ScenePlan {
    /// Numbers a pixel keeps per light position.
    #[must_use]
    pub fn components(&self) -> usize {
        match self.accumulate {
            Accumulate::Weights { materials } => materials + usize::from(self.specular().is_some()),
            Accumulate::Spectral { dimension, .. } => dimension,
        }
    }

    /// Numbers that say how much light passes a pixel.
    #[must_use]
    pub fn passed(&self) -> usize {
        match self.transmittance {
            Transmittance::Grey => 1,
            Transmittance::Coloured => self.components(),
            Transmittance::Mixed => self.components().pow(2),
        }
    }

    /// Vectors that hold [`Self::components`].
    #[must_use]
    pub fn lanes(&self) -> usize {
        self.components().div_ceil(LANE)
    }

    /// Vectors that hold [`Self::passed`].
    #[must_use]
    pub fn passed_lanes(&self) -> usize {
        self.passed().div_ceil(LANE)
    }

    /// Vectors that hold the shading coefficients: one per material, or an exponent per kind of highlight.
    #[must_use]
    pub fn shading_lanes(&self) -> usize {
        let numbers = match self.accumulate {
            Accumulate::Weights { materials } => materials,
            Accumulate::Spectral { exponents, .. } => exponents,
        };
        numbers.div_ceil(LANE).max(1)
    }

    /// What a table entry holds of what a step reflects.
    #[must_use]
    pub fn parts(&self) -> Parts {
        match self.accumulate {
            Accumulate::Weights { materials } => {
                Parts { unshaded: 0, ambient: 0, diffuse: 0, highlights: 0, lanes: materials.div_ceil(LANE) }
            }
            Accumulate::Spectral { shares, exponents, .. } => {
                let lanes = self.lanes();
                let own = shares == Shares::Own;
                let unshaded = if own { 2 * lanes } else { 0 };
                let highlights = match (own, self.positions.ambient) {
                    (false, _) => lanes,
                    (true, 0) => 2 * lanes,
                    (true, _) => 3 * lanes,
                };
                let white = match self.transmittance {
                    Transmittance::Grey => exponents.div_ceil(LANE),
                    Transmittance::Coloured | Transmittance::Mixed => exponents * lanes,
                };
                let diffuse = if own { lanes } else { 0 };
                Parts { unshaded, ambient: 0, diffuse, highlights, lanes: highlights + white }
            }
        }
    }

    /// Vectors a pixel keeps: [`Self::lanes`] per position.
    #[must_use]
    pub fn layers(&self) -> usize {
        self.positions.total() * self.lanes()
    }

    /// Bytes a finished pixel keeps on a device. Where one number passes it is never stored in 16 bits: alone in its
    /// texel, it would save little.
    #[must_use]
    pub fn pixel_bytes(&self) -> u64 {
        self.bytes_as(self.storage)
    }

    /// Bytes a pixel takes on a device while it is marched, and its finished form beside it where that is another.
    #[must_use]
    pub fn marched_bytes(&self) -> u64 {
        let finished = if self.storage == StoreAs::Single { 0 } else { self.pixel_bytes() };
        self.bytes_as(StoreAs::Single) + finished
    }

    fn bytes_as(&self, storage: StoreAs) -> u64 {
        let number = match storage {
            StoreAs::Single => size_of::<f32>(),
            StoreAs::Half => size_of::<::half::f16>(),
        };
        let passed = match self.transmittance {
            Transmittance::Grey => size_of::<f32>(),
            Transmittance::Coloured | Transmittance::Mixed => self.passed_lanes() * LANE * number,
        };
        (self.layers() * LANE * number + passed) as u64
    }

    /// Whether the gradient of the data is needed.
    #[must_use]
    pub fn gradient(&self) -> bool {
        self.shading.is_some_and(|terms| terms.diffuse || terms.specular.is_some())
    }

    /// Whether the gradient is stored beside the values.
    #[must_use]
    pub fn stores_gradient(&self) -> bool {
        self.gradient() && self.gradients == Gradients::Packed
    }

    /// Whether the march seeks the next sample that holds something before it looks that up. The same picture to the bit,
    /// and faster where what is looked up of a sample takes longer than fetching its value: with a vector of table on
    /// either side, the loop more costs a tenth of the march; with many it saves up to a fifth.
    #[must_use]
    pub fn seeks(&self) -> bool {
        let voxels = if self.interpolation == Interpolation::Cubic { 64 } else { 8 };
        let passed = if self.transmittance == Transmittance::Grey { 1 } else { self.passed_lanes() * LANE };
        let entries = if self.lookup == Lookup::Nearest { 1 } else { 2 };
        let differences = if self.gradient() && self.gradients == Gradients::Central { 6 * voxels } else { 0 };
        self.skipping && entries * (self.parts().lanes * LANE + passed) + differences >= 2 * voxels
    }

    /// Whether a device that holds the volume for `other` holds it for this plan: the same format, with or without
    /// gradients and labels, and filtered alike.
    #[must_use]
    pub fn is_stored_as(&self, other: &Self) -> bool {
        let kept = |plan: &Self| (plan.volume, plan.gradient(), plan.gradients, plan.labels, plan.interpolation);
        kept(self) == kept(other)
    }

    /// How highlights are computed, if there are any.
    #[must_use]
    pub fn specular(&self) -> Option<Specular> {
        self.shading.and_then(|terms| terms.specular)
    }
}

/// Why a scene has no plan.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlanError {
    /// Weights are asked for where they are not exact.
    #[error(
        "weights of materials are not exact here, because {materials} absorb some wavelengths more than others; take accumulate = \"spectral\" or \"auto\""
    )]
    NotGrey {
        /// What absorbs.
        materials: String,
    },
    /// Storing accumulators in 16 bits would show.
    #[error(
        "storing accumulators in 16 bits may move a colour by ΔE00 {error:.2}, over the tolerance of {tolerance}; take storage = \"f32\", or a tolerance of {kept}"
    )]
    HalfPrecision {
        /// The most, in ΔE00, that it can move a colour by.
        error: f64,
        /// What may be.
        tolerance: f64,
        /// A tolerance that is kept.
        kept: f64,
    },
    /// Accumulators are too large for 16 bits.
    #[error("a pixel of this scene may hold numbers above 65504, the largest of 16 bits; take storage = \"f32\"")]
    HalfRange,
    /// Nothing is known of what 16 bits do to matrices.
    #[error("the model peercy keeps a matrix of what passes, which is not stored in 16 bits; take storage = \"f32\"")]
    HalfMatrix,
    /// No colour model does what is asked for.
    #[error("no colour model fits the scene")]
    Model(#[from] ModelError),
}

/// The plan of `scene`: choices from what it uses and from its accuracy. Fits a colour model where one is needed.
///
/// # Errors
///
/// [`PlanError`].
pub fn plan(scene: &Scene, progress: &dyn Progress) -> Result<Planned, PlanError> {
    plan_for(scene, &[], progress)
}

/// [`plan`], with a colour model for more lights than the scene's own, by name.
///
/// # Errors
///
/// [`PlanError`].
pub fn plan_for(scene: &Scene, lights: &[(String, Light)], progress: &dyn Progress) -> Result<Planned, PlanError> {
    let mut planned = chosen(scene, lights, progress)?;
    half::check(&planned, scene)?;
    planned.be_seen_by(scene.display.observer, scene.accuracy.tolerance)?;
    for told in planned.unused(scene) {
        tracing::warn!("{told}");
    }
    let amplified = planned.amplified(scene).join(" ");
    if !amplified.is_empty() {
        tracing::warn!("{}", amplified.trim_end_matches('.'));
    }
    Ok(planned)
}

/// The plan of `scene`, but for how it is stored.
fn chosen(scene: &Scene, lights: &[(String, Light)], progress: &dyn Progress) -> Result<Planned, PlanError> {
    let weights = planned(scene, None);
    if weights.plan.transmittance == Transmittance::Coloured && scene.accuracy.accumulate == AccumulateAs::Weights {
        let coloured = scene.materials.iter().enumerate().filter(|&(m, material)| {
            scene.absorbs(m)
                && material.absorption.as_ref().is_some_and(|absorption| !is_constant(absorption.spectrum()))
        });
        let materials: Vec<&str> = coloured.map(|(_, material)| material.name.as_str()).collect();
        return Err(PlanError::NotGrey { materials: materials.join(", ") });
    }
    let exact = weights.plan.transmittance == Transmittance::Grey;
    let Accuracy { model: kind, tolerance, dimension, accumulate, .. } = scene.accuracy;
    let narrower = narrower(&weights.plan);
    let ingredients = || {
        let mut ingredients = weights.ingredients(scene);
        for (name, light) in lights {
            if ingredients.lights.iter().all(|(_, known)| known != light) {
                ingredients.lights.push((name.clone(), light.clone()));
            }
        }
        ingredients
    };
    let model = match (accumulate, dimension) {
        (AccumulateAs::Weights, _) => None,
        (AccumulateAs::Auto, Some(dimension)) if exact && dimension > narrower => None,
        (AccumulateAs::Auto, None) if exact && narrower == 0 => None,
        (AccumulateAs::Auto, None) if exact => {
            match model::fit_narrow(&ingredients(), kind, EXACTNESS * tolerance, narrower, progress) {
                Err(stopped @ ModelError::Cancelled) => return Err(stopped.into()),
                // What cannot be fitted has weights.
                fitted => fitted.unwrap_or_default(),
            }
        }
        (AccumulateAs::Auto | AccumulateAs::Spectral, Some(dimension)) => {
            let ingredients = ingredients();
            let unseen = model::unseen(&ingredients)?;
            let checked = |dimension| -> Result<ColourModel, ModelError> {
                let mut model = model::fit(&ingredients, kind, dimension, progress)?;
                model.check_on(&unseen)?;
                Ok(model)
            };
            let model = checked(dimension)?;
            if dimension > 1 && !kind.is_rgb() {
                warn_of_fewer(&model, &checked(dimension - 1)?);
            }
            Some(model)
        }
        (AccumulateAs::Auto | AccumulateAs::Spectral, None) => {
            Some(model::fit_automatic(&ingredients(), kind, tolerance, progress)?)
        }
    };
    Ok(model.map_or(weights, |model| planned(scene, Some(Arc::new(model)))))
}

/// Says where a model with one number less than asked for does better; errors of nothing are all alike.
fn warn_of_fewer(model: &ColourModel, smaller: &ColourModel) {
    let (asked, fewer) = (model.worst().max, smaller.worst().max);
    if fewer < asked && asked >= 0.0005 {
        tracing::warn!(
            "k = {} is better here than k = {}: colours differ by at most ΔE00 {fewer:.3}, not {asked:.3}",
            smaller.dimension(),
            model.dimension()
        );
    }
}

/// The most numbers of a colour model that take fewer vectors than the weights of `plan`.
fn narrower(plan: &ScenePlan) -> usize {
    plan.lanes().saturating_sub(1) * LANE
}

/// The plan that computes all 81 wavelengths: what other plans are measured against.
#[must_use]
pub fn plan_full_spectrum(scene: &Scene) -> Planned {
    let planned = planned(scene, Some(Arc::new(ColourModel::full_spectrum())));
    Planned { plan: ScenePlan { storage: StoreAs::Single, ..planned.plan }, ..planned }
}

/// The plan of `scene` with its spectra carried by `model`, or without one by weights.
fn planned(scene: &Scene, model: Option<Arc<ColourModel>>) -> Planned {
    let materials: Vec<usize> = (0..scene.materials.len()).filter(|&material| scene.shows(material)).collect();
    let positions = positions(scene);
    let count = |kind: fn(&Placement) -> bool| positions.iter().filter(|position| kind(&position.placement)).count();
    let counts = PositionCounts {
        ambient: count(|placement| matches!(placement, Placement::Ambient)),
        headlight: count(|placement| matches!(placement, Placement::Headlight)),
        directional: count(|placement| matches!(placement, Placement::Directional(_))),
        point: count(|placement| matches!(placement, Placement::Point(_))),
    };
    let used = || materials.iter().filter_map(|&material| scene.materials.get(material));
    let directed = scene.shading == Shading::Gradient && counts.total() > counts.ambient;
    let diffuse = directed && used().any(|material| material.diffuse > 0.0);
    let exponents = if directed { exponents(used()) } else { Vec::new() };
    let specular = exponents.last().map(|&largest| Specular {
        one_exponent: Some(largest).filter(|_| exponents.len() == 1),
        exponent_bits: u32::BITS - largest.leading_zeros(),
    });
    let accumulate = match &model {
        None => Accumulate::Weights { materials: materials.len() },
        Some(model) => {
            let mut shares = used().map(|material| [material.ambient, material.diffuse]);
            let first = shares.next();
            let equal = !directed || shares.all(|share| Some(share) == first);
            Accumulate::Spectral {
                dimension: model.dimension(),
                shares: if equal { Shares::Equal } else { Shares::Own },
                exponents: exponents.len(),
            }
        }
    };
    let shading = directed.then_some(ShadingTerms { diffuse, specular });
    let mut plan = ScenePlan {
        accumulate,
        transmittance: match (transmittance(scene), model.as_ref().map(|model| model.kind())) {
            (Transmittance::Coloured, Some(ModelKind::Peercy)) => Transmittance::Mixed,
            (transmittance, _) => transmittance,
        },
        positions: counts,
        shading,
        labels: scene.labels.as_ref().is_some_and(|labels| !labels.declared.is_empty()),
        background: scene.background.is_some(),
        lookup: scene.transfer.lookup,
        interpolation: scene.accuracy.interpolation,
        volume: scene.accuracy.volume,
        gradients: Gradients::Packed,
        skipping: scene.accuracy.skipping,
        storage: scene.accuracy.storage,
    };
    if plan.gradient() {
        plan.gradients = scene.accuracy.gradients;
    }
    Planned { plan, materials, positions, model }
}

impl Planned {
    /// Fits the colour model, where there is one, to `observer`: what pixels keep is the same whoever looks. Warns where that
    /// is over the tolerance.
    fn be_seen_by(&mut self, observer: Observer, tolerance: f64) -> Result<(), ModelError> {
        let Some(model) = self.model.as_mut().filter(|model| model.observer() != observer) else { return Ok(()) };
        let seen = model.seen_by(observer)?;
        let worst = seen.worst().max;
        if worst > tolerance {
            tracing::warn!(
                "the colour model was planned for the observer of 1931: to that of {observer}, colours may differ by ΔE00 {worst:.2}, which is over the tolerance of {tolerance}; take a smaller tolerance, or a larger k"
            );
        }
        *model = Arc::new(seen);
        Ok(())
    }

    /// The plan of `scene`, which is the one that this is of but for its camera, its crop and how it is displayed.
    #[must_use]
    pub fn seen_otherwise(&self, scene: &Scene) -> Self {
        planned(scene, self.model.clone())
    }

    /// The plan of `scene` where it asks for the same colour model as `before`, the scene that this is the plan of: the one
    /// that [`plan`] would make, at once. `None` where a model has to be fitted.
    #[must_use]
    pub fn changed_to(&self, before: &Scene, scene: &Scene) -> Option<Self> {
        let [then, now] = [before, scene].map(|scene| planned(scene, None));
        let asked = |scene: &Scene| {
            let Accuracy { accumulate, model, tolerance, dimension, .. } = scene.accuracy;
            (accumulate, model, tolerance.to_bits(), dimension)
        };
        let alike = then.plan == now.plan
            && asked(before) == asked(scene)
            && then.ingredients(before) == now.ingredients(scene);
        alike.then(|| self.seen_otherwise(scene)).filter(|planned| half::check(planned, scene).is_ok())
    }

    /// The most, in ΔE00, that storing finished accumulators in 16 bits changes a colour of at most white's brightness
    /// under one of the scene's lights; `None` where they are stored as they were summed up. Infinite where a number may
    /// be too large for 16 bits.
    #[must_use]
    pub fn half_precision_error(&self, scene: &Scene) -> Option<f64> {
        (self.plan.storage == StoreAs::Half).then(|| half::error(self, scene))
    }
}
