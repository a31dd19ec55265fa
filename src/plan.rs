//! What one frame computes: what the scene needs at the accuracy asked for.

mod half;

use std::sync::Arc;

use crate::model::{self, ColourModel, Ingredients, ModelError};
use crate::number::readable;
use crate::progress::Progress;
use crate::scene::{
    AccumulateAs, Accuracy, Gradients, Interpolation, Lookup, Material, Placement, Position, Scene, Shading, StoreAs,
    VolumeAs, positions,
};
use crate::spectrum::{Light, Spectrum};

/// Numbers in a shader's vector; accumulators and tables come in these.
pub const LANE: usize = 4;

/// What one frame computes. Discrete choices only, among them the exponent that all highlights share; other numbers travel
/// beside it. Equal plans share a pipeline.
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
    /// One weight per material in use (COLOUR.md A4): exact for every light, because opacity is grey and light scatters
    /// once. With specular materials one more, of white.
    Weights {
        /// Materials in use.
        materials: usize,
    },
    /// A spectrum in the k numbers of a colour model (COLOUR.md A2).
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
                    Transmittance::Coloured => exponents * lanes,
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
            Transmittance::Coloured => self.passed_lanes() * LANE * number,
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

    /// Whether the volume is stored as under `other`.
    #[must_use]
    pub fn is_stored_as(&self, other: &Self) -> bool {
        let kept = |plan: &Self| (plan.volume, plan.gradient(), plan.gradients);
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
    let planned = chosen(scene, lights, progress)?;
    half::check(&planned, scene)?;
    for told in planned.amplified(scene) {
        tracing::warn!("{}", told.trim_end_matches('.'));
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
            match model::fit_narrow(&ingredients(), kind, tolerance, narrower, progress) {
                Err(stopped @ ModelError::Cancelled) => return Err(stopped.into()),
                // What cannot be fitted has weights.
                fitted => fitted.unwrap_or_default(),
            }
        }
        (AccumulateAs::Auto | AccumulateAs::Spectral, Some(dimension)) => {
            let ingredients = ingredients();
            let mut model = model::fit(&ingredients, kind, dimension, progress)?;
            model.check_on(&model::unseen(&ingredients)?);
            Some(model)
        }
        (AccumulateAs::Auto | AccumulateAs::Spectral, None) => {
            Some(model::fit_automatic(&ingredients(), kind, tolerance, progress)?)
        }
    };
    Ok(model.map_or(weights, |model| planned(scene, Some(Arc::new(model)))))
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
        transmittance: transmittance(scene),
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

/// Different exponents of the highlights of `materials`, ascending.
fn exponents<'a>(materials: impl Iterator<Item = &'a Material>) -> Vec<u32> {
    let mut exponents: Vec<u32> =
        materials.filter(|material| material.specular > 0.0).map(|material| material.exponent).collect();
    exponents.sort_unstable();
    exponents.dedup();
    exponents
}

/// Grey exactly as long as everything's absorption, summed, is the same at all wavelengths.
fn transmittance(scene: &Scene) -> Transmittance {
    let coloured = |absorption: &[f64]| {
        let mut sum = Spectrum::constant(0.0);
        for (&depth, material) in absorption.iter().zip(&scene.materials) {
            if let Some(shape) = material.absorption.as_ref().filter(|_| depth > 0.0) {
                sum = &sum + &shape.spectrum().scaled(depth);
            }
        }
        !is_constant(&sum)
    };
    // Between two bends the sum is a parabola at each wavelength, which three places settle.
    let bends = scene.transfer.bends();
    let halves = bends.windows(2).map(|pair| f64::midpoint(pair[0], pair[1]));
    let by_value = bends.iter().copied().chain(halves).any(|value| {
        // Beside a jump, too.
        [value.next_down(), value, value.next_up()]
            .into_iter()
            .any(|value| coloured(&scene.transfer.medium(value, scene.materials.len()).absorption))
    });
    let by_label = scene.labels.iter().flat_map(|labels| &labels.declared).any(|entry| {
        let mut absorption = vec![0.0; scene.materials.len()];
        if let Some(depth) = absorption.get_mut(entry.material) {
            *depth = entry.absorption;
        }
        coloured(&absorption)
    });
    if by_value || by_label { Transmittance::Coloured } else { Transmittance::Grey }
}

/// Whether all samples are the same, but for rounding.
fn is_constant(spectrum: &Spectrum) -> bool {
    let samples = spectrum.samples();
    let (low, high) = samples.iter().fold((f64::MAX, f64::MIN), |(low, high), &s| (low.min(s), high.max(s)));
    high - low <= 1e-12 * high.abs()
}

/// The largest optical depth of absorption that a ray can meet: that of the value that absorbs most, by all that shows
/// it, along the volume's diagonal.
fn largest_depth(scene: &Scene) -> f64 {
    let of_value = |value| scene.transfer.medium(value, scene.materials.len()).absorption.iter().sum();
    let of_values = scene.transfer.bends().into_iter().map(of_value);
    let of_labels = scene.labels.iter().flat_map(|labels| &labels.declared).map(|entry| entry.absorption);
    of_values.chain(of_labels).fold(0.0, f64::max) * longest_way(scene)
}

/// The longest way through the volume, its diagonal, in opacity lengths.
fn longest_way(scene: &Scene) -> f64 {
    let geometry = &scene.volume.geometry;
    let diagonal = (geometry.spacing * glam::DVec3::from_array(geometry.dims.map(crate::number::count))).length();
    diagonal / scene.transfer.opacity_length
}

impl Planned {
    /// The plan of `scene`, which is the one that this is of but for its camera, its crop and how it is displayed.
    #[must_use]
    pub fn seen_otherwise(&self, scene: &Scene) -> Self {
        planned(scene, self.model.clone())
    }

    /// What the light of `scene` can meet, under its own lights.
    #[must_use]
    pub fn ingredients(&self, scene: &Scene) -> Ingredients {
        let coloured = self.plan.transmittance == Transmittance::Coloured;
        let absorbing: Vec<usize> =
            (0..scene.materials.len()).filter(|&material| coloured && scene.absorbs(material)).collect();
        let absorptions = absorbing.iter().filter_map(|&m| scene.materials[m].absorption.as_ref());
        Ingredients {
            reflectances: self.materials.iter().map(|&m| scene.materials[m].reflectance.spectrum().clone()).collect(),
            absorptions: absorptions.map(|absorption| absorption.spectrum().clone()).collect(),
            background: scene.background.as_ref().map(|surface| surface.spectrum().clone()),
            highlights: self.plan.specular().is_some(),
            lights: scene.lights.iter().map(|light| (light.name.clone(), light.spectrum.clone())).collect(),
            largest_depth: if coloured { largest_depth(scene) } else { 0.0 },
        }
    }

    /// The largest ΔE00 that the model may add under further lights: the scene's tolerance, or, where k is stated, what
    /// it adds under the scene's own lights, if that is more (to three decimals).
    #[must_use]
    pub fn tolerance(&self, scene: &Scene) -> f64 {
        let Accuracy { tolerance, dimension, .. } = scene.accuracy;
        let own = |light: &Light| scene.lights.iter().any(|known| known.spectrum == *light);
        let lights = self.model.iter().flat_map(|model| model.lights()).filter(|(_, light, _)| own(light));
        let worst = lights.map(|(.., matrix)| matrix.worst().max).fold(tolerance, f64::max);
        if dimension.is_some() { (worst * 1000.0).ceil() / 1000.0 } else { tolerance }
    }

    /// Different exponents of highlights, ascending; none where the plan has no highlights.
    #[must_use]
    pub fn exponents(&self, scene: &Scene) -> Vec<u32> {
        let used = self.materials.iter().filter_map(|&material| scene.materials.get(material));
        if self.plan.specular().is_some() { exponents(used) } else { Vec::new() }
    }

    /// The most, in ΔE00, that storing finished accumulators in 16 bits changes a colour of at most white's brightness
    /// under one of the scene's lights; `None` where they are stored as they were summed up. Infinite where a number may
    /// be too large for 16 bits.
    #[must_use]
    pub fn half_precision_error(&self, scene: &Scene) -> Option<f64> {
        (self.plan.storage == StoreAs::Half).then(|| half::error(self, scene))
    }

    /// A sentence for each material whose absorption the colour model would turn into amplification, and holds at 0.
    #[must_use]
    pub fn amplified(&self, scene: &Scene) -> Vec<String> {
        let coloured = self.plan.transmittance == Transmittance::Coloured;
        let Some(model) = self.model.as_ref().filter(|_| coloured) else { return Vec::new() };
        let absorbing = scene.materials.iter().enumerate().filter(|&(m, _)| scene.absorbs(m));
        let told = absorbing.filter_map(|(_, material)| {
            let told = model.amplification(material.absorption.as_ref()?.spectrum())?;
            Some(format!("Of {}, {told}.", material.name))
        });
        told.collect()
    }

    /// How colours are followed through the volume, what a pixel keeps of them, and how true they stay.
    fn explain_colours(&self, scene: &Scene) -> Vec<String> {
        let plan = &self.plan;
        let name = |material: usize| scene.materials.get(material).map(|material| material.name.as_str());
        let shown = || listed(self.materials.iter().filter_map(|&material| name(material)));
        let absorbs = |material: &usize| scene.absorbs(*material);
        let passes = match plan.transmittance {
            Transmittance::Grey => "All wavelengths pass alike, whatever light meets on its way".to_owned(),
            Transmittance::Coloured => format!(
                "Light changes its colour on its way, as through stained glass, where it meets {}",
                listed((0..scene.materials.len()).filter(absorbs).filter_map(name))
            ),
        };
        let each = if plan.positions.total() > 1 { ", for each of the places that light comes from" } else { "" };
        let kept = plan.components() * plan.positions.total() + plan.passed();
        let mut sentences = Vec::new();
        match &self.model {
            None => {
                let white = if plan.specular().is_some() { " and of white highlights" } else { "" };
                sentences.push(format!("{passes}: a pixel's colour follows exactly, under every light, from how much it shows of each material."));
                sentences.push(format!(
                    "So a pixel keeps how much it shows of {}{white}{each}, and how much light passes through: {kept} numbers in all.",
                    shown()
                ));
            }
            Some(model) => {
                let followed = match model.nodes_nm() {
                    Some(nodes) => format!(
                        "at {} wavelengths ({} nm), chosen for this scene so that they stand for all others",
                        nodes.len(),
                        nodes.iter().map(f64::to_string).collect::<Vec<_>>().join(", ")
                    ),
                    None => format!("by {} in place of all wavelengths", model.description()),
                };
                sentences.push(format!("{passes}. It is followed {followed}."));
                sentences.extend(self.amplified(scene));
                sentences.push(format!(
                    "So a pixel keeps {} numbers of the light that comes back{each}, and {} of what passes through: {kept} in all.",
                    plan.components(),
                    plan.passed()
                ));
            }
        }
        sentences.push(
            "No light's colour is in them: lights can be exchanged later, without computing the picture anew."
                .to_owned(),
        );
        sentences.extend(self.explain_choice(scene));
        if let Some(model) = &self.model {
            let errors = model.lights().iter().map(|(name, _, matrix)| {
                let error = matrix.worst();
                format!("{:.2} and {:.2} under {name}", error.mean, error.max)
            });
            let errors: Vec<String> = errors.collect();
            if !errors.is_empty() {
                sentences.push(format!(
                    "Compared with following all wavelengths, colours are off, on average and at most, by ΔE00 {} (a difference of 1 can just be seen side by side).",
                    errors.join(", ")
                ));
            }
        }
        if let Some(error) = self.half_precision_error(scene) {
            sentences.push(format!(
                "A finished pixel is stored in 16 bits a number, {} bytes in all; that moves no colour by more than ΔE00 {error:.2}.",
                plan.pixel_bytes()
            ));
        }
        let hidden = || (0..scene.materials.len()).filter(|material| !self.materials.contains(material));
        let (filters, unused): (Vec<usize>, Vec<usize>) = hidden().partition(absorbs);
        if !filters.is_empty() {
            let filters = listed(filters.into_iter().filter_map(name));
            sentences.push(format!("Seen only by what they take from the light: {filters}."));
        }
        if !unused.is_empty() {
            let unused = listed(unused.into_iter().filter_map(name));
            sentences.push(format!("Materials that nothing shows are left out: {unused}."));
        }
        sentences
    }

    /// The plan in sentences, for people who know volumes but not this program.
    #[must_use]
    pub fn explain(&self, scene: &Scene) -> Vec<String> {
        let plan = &self.plan;
        let mut sentences = self.explain_colours(scene);
        sentences.push(match plan.positions.total() {
            0 => "There is no light: only what passes is computed.".to_owned(),
            1 if scene.lights.len() == 1 => "There is one light.".to_owned(),
            1 => format!("Shading cannot tell the {} lights apart, so they share their numbers.", scene.lights.len()),
            total => format!(
                "{} lights shine from {total} places that shading can tell apart: {}.",
                scene.lights.len(),
                listed(self.positions.iter().map(|position| position.name.as_str()))
            ),
        });
        sentences.push(match plan.shading.filter(|_| plan.gradient()) {
            None => "Nothing is shaded by the direction of surfaces.".to_owned(),
            Some(terms) => format!(
                "Surfaces get their {} by which way values change there, which is {}.",
                match (terms.diffuse, terms.specular) {
                    (true, None) => "shading",
                    (false, _) => "highlights",
                    (true, Some(_)) => "shading and highlights",
                },
                match plan.gradients {
                    Gradients::Packed => "stored beside each value",
                    Gradients::Central => "taken from six values around each sample",
                }
            ),
        });
        if plan.labels {
            sentences.push("Labels decide what a voxel is; without a label, its value does.".to_owned());
        }
        sentences.push(
            if plan.background {
                "The background is seen through what passes, and relit with everything else."
            } else {
                "The background is black and costs nothing."
            }
            .to_owned(),
        );
        let values = match plan.interpolation {
            Interpolation::Linear => "linear",
            Interpolation::ExactLinear => "linear, in all bits of a number",
            Interpolation::Cubic => "those of a cubic spline",
            Interpolation::Nearest => "those of the nearest voxel",
        };
        let entries = match plan.lookup {
            Lookup::Linear => "what lies between entries of the transfer table is linear",
            Lookup::Nearest => "each takes the nearest entry of the transfer table",
        };
        sentences.push(format!("Values between voxels are {values}; {entries}."));
        let termination = if scene.accuracy.termination > 0.0 {
            format!("A ray ends once less than {} % of the light passes", readable(100.0 * scene.accuracy.termination))
        } else {
            "Every ray is followed to its end".to_owned()
        };
        let skipping = if plan.skipping { "what is empty is leapt over" } else { "what is empty is walked through" };
        sentences.push(format!(
            "{termination}; samples are {} apart, in the volume's own unit of length; {skipping}.",
            readable(scene.accuracy.step_length)
        ));
        sentences
    }

    /// Why numbers of a colour model are kept where weights would be exact, or weights where fewer numbers were tried.
    fn explain_choice(&self, scene: &Scene) -> Option<String> {
        let Accuracy { accumulate, dimension, tolerance, .. } = scene.accuracy;
        let exact = self.plan.transmittance == Transmittance::Grey && accumulate == AccumulateAs::Auto;
        let lanes = self.plan.lanes();
        match &self.model {
            Some(_) if exact => {
                let weights = self.materials.len() + usize::from(self.plan.specular().is_some());
                let wider = weights.div_ceil(LANE);
                Some(format!(
                    "Weights of the materials would be exact, and are had by accumulate = \"weights\", but fill {wider} vectors of four where these fill {lanes}."
                ))
            }
            None if exact && dimension.is_none() && narrower(&self.plan) > 0 => Some(format!(
                "The weights fill {lanes} vectors of four; a colour model that fills fewer would differ by more than ΔE00 {tolerance}."
            )),
            _ => None,
        }
    }
}

/// Names one after the other.
fn listed<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let names: Vec<&str> = names.collect();
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}
