//! Plans: the features and sizes that a scene needs at its accuracy settings.

mod explain;
mod fitted;
mod half;
mod integration;
mod light;
mod needs;
mod scattering;
mod shadows;
mod stale;
mod warning;

use std::sync::Arc;

use crate::key::Named;
pub use crate::key::Stale;
use fitted::{Coefficients, RECENT, Wanted};
pub use integration::{Crossed, Narrow, crossed, narrow, read_ahead};
pub use light::{Arrival, LightPlan, MOST_SHADOWED, Share};
pub use needs::PlannedFilm;
pub use needs::is_constant;
use needs::{exponents, longest_way, transmittance};
pub use warning::PlanWarning;

use crate::{
    AccumulateAs, Accuracy, AmbientShares, Blending, FIELDS, Field, Gradients, Integration, Interpolation, Keep,
    LabelInterpolation, Lighting, Lookup, MOST_GROUPS, Material, Overlap, Placement, Position, Scene, Second, Shading,
    StoreAs, VolumeAs, positions,
};
use relume_base::progress::Progress;
use relume_colour::model::{ColourModel, ModelError, ModelKind, Order};
use relume_colour::spectrum::Light;
use relume_colour::spectrum::observer::Observer;
use smallvec::SmallVec;

/// Numbers in a shader's vector, the unit of accumulators and tables.
pub const LANE: usize = 4;

/// Largest number of parts of a segment.
pub const MOST_PARTS: f32 = 4.0;

/// Difference between two samples above which their steps are refined towards each other, of this [`Accuracy::variation`]: 0.02 of the default.
#[must_use]
pub fn refinement_bound(variation: f64) -> f64 {
    (0.4 * variation).sqrt()
}

/// Fraction of the tolerance allowed to coefficients that replace exact weights: exactness is given up only for a small
/// error.
const EXACTNESS: f64 = 0.5;

/// Features and sizes of a frame. Contains discrete choices only, including an exponent that all highlights share;
/// other numbers are passed separately. Plans with the same shader share its pipeline.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct ScenePlan {
    /// Contents of pixels.
    pub accumulate: Accumulate,
    /// Kind of transmittance.
    pub transmittance: Transmittance,
    /// The light of each accumulator: one for each position that shading can distinguish.
    pub light: LightPlan,
    /// Shading of directed lights; `None` if every light reaches every point equally.
    pub shading: Option<ShadingTerms>,
    /// Phase functions by which a step scatters directed light: with weights, one per material in use; otherwise, one per
    /// distinct parameter, with its own part of a table entry. 0 if every material scatters evenly.
    pub phases: usize,
    /// Thin films that reflect directed light.
    pub thin_films: FilmCounts,
    /// Groups of terms whose densities a sample adds.
    pub groups: Groups,
    /// Clip planes.
    pub clip: ClipPlan,
    /// Whether labels take precedence over the transfer function.
    pub labels: bool,
    /// Whether labels are interpolated between voxels.
    pub smooth_labels: bool,
    /// Whether any label shows different media at different values.
    pub labels_by_value: bool,
    /// Whether the background is other than black.
    pub background: bool,
    /// Lookup in the transfer table.
    pub lookup: Lookup,
    /// Integration along a ray.
    pub integration: Integrate,
    /// Rule that blends the values along a ray.
    pub blending: Blending,
    /// Interpolation between voxels.
    pub interpolation: Interpolation,
    /// Storage of the volume.
    pub volume: VolumeAs,
    /// Source of gradients; [`Gradients::Packed`] if none are needed.
    pub gradients: Gradients,
    /// Whether empty macrocells are skipped.
    pub skipping: bool,
    /// Rays of a pixel, whose mean its accumulators are.
    pub rays: usize,
    /// True if each ray has a phase of its own.
    pub jitter: bool,
    /// True if refined steps count intervals between the values of two samples, because steps often cross one.
    pub crossings: bool,
    /// Whether sums keep what rounding takes from them, because a ray may have more than [`MOST_PLAIN_STEPS`].
    pub compensated: bool,
    /// Storage of finished accumulators.
    pub storage: StoreAs,
}

/// Terms of one field with equal factors are a group, whose density is looked up by itself. Without factors and
/// further fields there is no group, unless a single value of a ray is seen, or planes cut fields by themselves: a sample reads the effect of
/// a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Groups {
    /// Number of groups.
    pub number: usize,
    /// Points of the longest factor by the gradient; 0 if every such factor is 1.
    pub points: usize,
    /// Largest number of factors of a group by the values of other fields, and points of the longest of them.
    pub by_fields: [usize; 2],
    /// Groups with a shape, and those of them by the gradient.
    pub shapes: [usize; 2],
    /// Field of each group, in the order of the fields.
    pub fields: [usize; MOST_GROUPS],
    /// Fields besides the first.
    pub further: usize,
    /// Those of them that share its texels; the others have grids of their own.
    pub sharing: usize,
    /// Rule for places where several fields have a medium.
    pub overlap: Overlap,
    /// True for each further field, by its index, whose media are shaded by its own normals.
    pub lit: [bool; FIELDS],
}

/// Vectors of a shape in a [`FactorTable`](crate::tables::FactorTable).
pub const SHAPE_VECTORS: usize = 2;

/// Clip planes as a march meets them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct ClipPlan {
    /// Number of planes that are on.
    pub planes: usize,
    /// Number of those that shorten rays; the others cut each field by itself.
    pub shortening: usize,
    /// True if fields keep what any of their planes keeps.
    pub keeps_any: bool,
    /// True if shading by gradients sees cut faces.
    pub caps: bool,
}

impl ClipPlan {
    /// True if planes cut each field by itself, or leave a part that is not convex: the media of a sample have a weight.
    #[must_use]
    pub const fn is_by_field(self) -> bool {
        self.planes > self.shortening
    }
}

impl Groups {
    fn of(scene: &Scene) -> Self {
        let groups = scene.groups();
        let points = groups.iter().map(|group| group.factors.gradient.len()).max().unwrap_or(0);
        let shapes = || groups.iter().filter_map(|group| group.factors.shape);
        let by_gradient = shapes().filter(|shape| shape.second == Second::Gradient).count();
        let shapes = [shapes().count(), by_gradient];
        let further = scene.fields.further().len();
        if points > 0 || shapes[0] > 0 || further > 0 || scene.blending.is_extreme() || scene.clip.is_by_field() {
            let fields = std::array::from_fn(|group| groups.get(group).map_or(0, |group| group.field));
            let sharing = scene.fields.sharing().len();
            let most_fields = groups.iter().map(|group| group.factors.by.len()).max().unwrap_or(0);
            let longest = groups.iter().flat_map(|group| group.factors.by).map(|factor| factor.points.len());
            let longest = longest.max().unwrap_or(0);
            let by_fields = [most_fields, longest];
            let overlap = if further > 0 { scene.overlap } else { Overlap::Add };
            Self {
                number: groups.len(),
                points,
                by_fields,
                shapes,
                fields,
                further,
                sharing,
                overlap,
                lit: [false; FIELDS],
            }
        } else {
            Self::default()
        }
    }

    /// True if a sample adds densities.
    #[must_use]
    pub const fn any(self) -> bool {
        self.number > 0
    }

    /// True if any factor by the gradient is not 1.
    #[must_use]
    pub const fn by_gradient(self) -> bool {
        self.points > 0 || self.shapes[1] > 0
    }

    /// Indices of the fields in the order in which each hides those behind it; `None` if their media add.
    #[must_use]
    pub fn hiding(self) -> Option<SmallVec<[usize; FIELDS]>> {
        match self.overlap {
            Overlap::Add => None,
            Overlap::First => Some((0..=self.further).collect()),
            Overlap::Last => Some((0..=self.further).rev().collect()),
        }
    }

    /// Vectors of a group in a [`FactorTable`](crate::tables::FactorTable).
    #[must_use]
    pub fn factor_vectors(self) -> usize {
        let [fields, points] = self.by_fields;
        self.points.max(1) + fields * points + if self.shapes[0] > 0 { SHAPE_VECTORS } else { 0 }
    }

    /// Number of groups of the first field, which come first.
    #[must_use]
    pub fn of_first(self) -> usize {
        self.fields[..self.number].iter().filter(|field| **field == 0).count()
    }

    /// True if each field has one group: a march needs not look up which is whose.
    #[must_use]
    pub fn is_one_each(self) -> bool {
        self.number == self.further + 1 && (0..self.number).all(|group| self.fields[group] == group)
    }

    /// True if a group is of a further field with normals of its own.
    #[must_use]
    pub fn is_apart(self, group: usize) -> bool {
        group < self.number && self.lit[self.fields[group]]
    }

    /// Further fields that are shaded by their own normals.
    pub fn lit_fields(self) -> impl Iterator<Item = usize> {
        (0..FIELDS).filter(move |&field| self.lit[field])
    }

    /// Fields on grids of their own.
    #[must_use]
    pub const fn beside(self) -> usize {
        self.further - self.sharing
    }

    /// Groups of numbers in a table entry: at least one.
    #[must_use]
    pub fn in_tables(self) -> usize {
        self.number.max(1)
    }
}

/// Largest number of steps of a ray whose sums in f32 are plain. Rounding may take up to 2⁻²⁶ of a sum in each step, always
/// with the same sign where steps are equal (docs/theory/numerics.md): 2·10⁻⁵ after 1340 steps.
pub const MOST_PLAIN_STEPS: f64 = 1340.0;

/// Integration along a ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Integrate {
    /// The medium at the middle of each step.
    Samples,
    /// Means of the medium over the values between the ends of a segment.
    Segments,
    /// The medium at the middle of each step, and nearer to the next one where they differ.
    Refined,
}

/// Contents of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Accumulate {
    /// One weight per material in use (docs/theory/march.md): exact for every light, because opacity is grey and light
    /// scatters once. Specular materials add a weight for white.
    Weights {
        /// Materials in use.
        materials: usize,
    },
    /// A spectrum as the k coefficients of a colour model (docs/theory/colour-models.md).
    Spectral {
        /// Dimension k.
        dimension: usize,
        /// Spectra of the source in a table entry.
        shares: Shares,
        /// Number of distinct exponents of highlights; each has its own part of a table entry.
        exponents: usize,
    },
}

/// Comparison of the ambient and diffuse factors of the materials in use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Shares {
    /// Equal for all materials: the source is one spectrum, shaded as a whole.
    Equal,
    /// Different: the ambient part of the source is one spectrum, the diffuse part another.
    Own,
}

/// Kind of transmittance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Transmittance {
    /// The sum of all absorption and scattering is equal at all wavelengths: one number.
    Grey,
    /// One number per component of the colour model.
    Coloured,
    /// A matrix, row by row: contribution of each component of the light behind to each transmitted component (Peercy
    /// 1993).
    Mixed,
}

/// Offsets of the parts of the source in a table entry, in vectors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Parts {
    /// Source of ambient light; one number per material if weights are accumulated. With phase functions, the sum of the
    /// parts of all of them, of which this is the first.
    pub unshaded: usize,
    /// Ambient part for a directed light.
    pub ambient: usize,
    /// Diffuse part, which follows |n·l| or max(n·l, 0).
    pub diffuse: usize,
    /// White of the highlights, one part per exponent.
    pub highlights: usize,
    /// White of the light that thin films reflect, one part per film.
    pub thin_films: usize,
    /// Vectors per entry.
    pub lanes: usize,
}

/// Numbers of thin films.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct FilmCounts {
    /// Films in place of a diffuse reflectance.
    pub facing: usize,
    /// Films in place of white highlights.
    pub lobe: usize,
    /// With weights, terms of all films, each of which has a weight; otherwise 0.
    pub terms: usize,
    /// Bits of the largest exponent of their highlights.
    pub exponent_bits: u32,
}

impl FilmCounts {
    /// Number of films.
    #[must_use]
    pub fn total(&self) -> usize {
        self.facing + self.lobe
    }
}

/// Shading terms of directed lights. Without diffuse and specular parts, only the materials' ambient factors remain,
/// and no gradient is needed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ShadingTerms {
    /// Some material has a diffuse part.
    pub diffuse: bool,
    /// Some material has a specular part.
    pub specular: Option<Specular>,
    /// Only surfaces that face the light are lit by these parts.
    pub one_sided: bool,
}

/// Parameters of highlights.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Specular {
    /// Exponent of all materials, compiled into the shader; `None` if there are several.
    pub one_exponent: Option<u32>,
    /// Bits of the largest exponent: the number of squarings per power.
    pub exponent_bits: u32,
}

/// A plan with the materials and light positions of its components.
#[derive(Clone, Debug, PartialEq)]
pub struct Planned {
    /// The plan.
    pub plan: ScenePlan,
    /// Materials in use: indices into [`Scene::materials`], in the order of the weights.
    pub materials: Vec<usize>,
    /// The light positions, in the order of the accumulators.
    pub positions: Vec<Position>,
    /// Colour model, if pixels keep no weights.
    pub model: Option<Arc<ColourModel>>,
    /// Properties that the user may want to change.
    pub warnings: Vec<PlanWarning>,
}

impl ScenePlan {
    /// Components of an accumulator.
    #[must_use]
    pub fn components(&self) -> usize {
        match self.accumulate {
            Accumulate::Weights { materials } => {
                materials + usize::from(self.specular().is_some()) + self.thin_films.terms
            }
            Accumulate::Spectral { dimension, .. } => dimension,
        }
    }

    /// Numbers of the transmittance of a pixel.
    #[must_use]
    pub fn transmittance_numbers(&self) -> usize {
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

    /// Vectors that hold [`Self::transmittance_numbers`].
    #[must_use]
    pub fn transmittance_lanes(&self) -> usize {
        self.transmittance_numbers().div_ceil(LANE)
    }

    /// Vectors that hold the shading coefficients: one number per material, or one per exponent of highlights.
    #[must_use]
    pub fn shading_lanes(&self) -> usize {
        let numbers = match self.accumulate {
            Accumulate::Weights { materials } => materials,
            Accumulate::Spectral { exponents, .. } => exponents,
        };
        numbers.div_ceil(LANE).max(1)
    }

    /// Vectors that hold the phase functions.
    #[must_use]
    pub fn phase_lanes(&self) -> usize {
        self.phases.div_ceil(LANE).max(1)
    }

    /// Vectors that hold a number per thin film.
    #[must_use]
    pub fn thin_film_lanes(&self) -> usize {
        self.thin_films.total().div_ceil(LANE).max(1)
    }

    /// Vectors of an accumulator that hold weights of terms of thin films; none without weights.
    #[must_use]
    pub fn thin_film_vectors(&self) -> std::ops::Range<usize> {
        let first = self.components() - self.thin_films.terms.min(self.components());
        if self.thin_films.terms == 0 { self.lanes()..self.lanes() } else { first / LANE..self.lanes() }
    }

    /// Layout of the source in a table entry.
    #[must_use]
    pub fn parts(&self) -> Parts {
        match self.accumulate {
            Accumulate::Weights { materials } => Parts {
                unshaded: 0,
                ambient: 0,
                diffuse: 0,
                highlights: 0,
                thin_films: 0,
                lanes: materials.div_ceil(LANE),
            },
            Accumulate::Spectral { shares, exponents, .. } => {
                let lanes = self.lanes();
                let own = shares == Shares::Own;
                let unshaded = if own { 2 * lanes } else { 0 };
                let highlights = match (own, self.light.is_unshaded()) {
                    (false, _) => self.phases.max(1) * lanes,
                    (true, false) => 2 * lanes,
                    (true, true) => 3 * lanes,
                };
                let white = |parts: usize| match self.transmittance {
                    Transmittance::Grey => parts.div_ceil(LANE),
                    Transmittance::Coloured | Transmittance::Mixed => parts * lanes,
                };
                let diffuse = if own { lanes } else { 0 };
                let thin_films = highlights + white(exponents);
                Parts {
                    unshaded,
                    ambient: 0,
                    diffuse,
                    highlights,
                    thin_films,
                    lanes: thin_films + white(self.thin_films.total()),
                }
            }
        }
    }

    /// Vectors of a pixel's accumulators: [`Self::lanes`] per position.
    #[must_use]
    pub fn layers(&self) -> usize {
        self.light.accumulators() * self.lanes()
    }

    /// Bytes of a finished pixel on a device. Grey transmittance is never stored in 16 bits: alone in its texel, it
    /// would save little.
    #[must_use]
    pub fn pixel_bytes(&self) -> u64 {
        self.bytes_as(self.storage)
    }

    /// Bytes of a pixel on a device during the march: those of its ray, of the mean of several rays, and of its finished
    /// form if that differs.
    #[must_use]
    pub fn marched_bytes(&self) -> u64 {
        let finished = if self.storage == StoreAs::Single { 0 } else { self.pixel_bytes() };
        let marched = self.bytes_as(StoreAs::Single);
        // A mean has the layers of its ray.
        let marched = marched * if self.keeps_more() { 2 } else { 1 };
        marched + if self.rays > 1 { marched } else { 0 } + finished
    }

    /// True if the images of a march have twice the layers of its film: for what rounding took from sums, or for extreme values.
    #[must_use]
    pub const fn keeps_more(&self) -> bool {
        self.compensated || self.blending.is_extreme()
    }

    fn bytes_as(&self, storage: StoreAs) -> u64 {
        let number = match storage {
            StoreAs::Single => size_of::<f32>(),
            StoreAs::Half => size_of::<::half::f16>(),
        };
        let transmittance = match self.transmittance {
            Transmittance::Grey => size_of::<f32>(),
            Transmittance::Coloured | Transmittance::Mixed => self.transmittance_lanes() * LANE * number,
        };
        (self.layers() * LANE * number + transmittance) as u64
    }

    /// True if a march adds densities before it closes a step, rather than reading the effect of a step at a value.
    #[must_use]
    pub fn adds_densities(&self) -> bool {
        self.integration == Integrate::Segments || self.groups.any() || self.blending.is_extreme()
    }

    /// Whether the gradient of the data is needed.
    #[must_use]
    pub fn gradient(&self) -> bool {
        self.groups.by_gradient() || self.shades_by_gradient()
    }

    /// Whether shading needs the gradient of the data.
    #[must_use]
    pub fn shades_by_gradient(&self) -> bool {
        self.thin_films.total() > 0 || self.shading.is_some_and(|terms| terms.diffuse || terms.specular.is_some())
    }

    /// Whether the gradient is stored with the values.
    #[must_use]
    pub fn stores_gradient(&self) -> bool {
        self.gradient() && self.gradients == Gradients::Packed
    }

    /// True if gradients are stored with the values of fields on grids of their own.
    #[must_use]
    pub fn stores_placed_gradients(&self) -> bool {
        self.stores_gradient() && self.groups.lit_fields().any(|field| field > self.groups.sharing)
    }

    /// Whether the march skips samples whose value is invisible before it looks up the tables. The picture is the same to
    /// the bit. That is faster if the lookup of a sample takes longer than fetching its value: with one vector in
    /// each of the two table entries, the additional loop costs a tenth of the march; with many vectors it saves up to
    /// a fifth.
    #[must_use]
    pub fn skips_invisible(&self) -> bool {
        let voxels = match self.interpolation {
            Interpolation::Cubic => 64,
            it if it.cubic_axis().is_some() => 16,
            _ => 8,
        };
        let opacity = if self.transmittance == Transmittance::Grey { 1 } else { self.transmittance_lanes() * LANE };
        let entries = if self.lookup == Lookup::Nearest { 1 } else { 2 };
        let differences = if self.gradient() && self.gradients == Gradients::Central { 6 * voxels } else { 0 };
        // A fetch of four lights.
        let light = if self.light.reads_grid() { 8 * LANE } else { 0 };
        self.skipping
            && self.groups.in_tables() * entries * (self.parts().lanes * LANE + opacity) + differences + light
                >= 2 * voxels
    }

    /// Whether a volume stored on a device for `other` suits this plan: same format, gradients, labels and filter.
    #[must_use]
    pub fn is_stored_as(&self, other: &Self) -> bool {
        let kept = |plan: &Self| {
            let labels = (plan.labels, plan.smooth_labels);
            (
                plan.volume,
                plan.gradient(),
                plan.gradients,
                labels,
                plan.interpolation,
                (plan.groups.further, plan.groups.sharing, plan.stores_placed_gradients()),
            )
        };
        kept(self) == kept(other)
    }

    /// Parameters of highlights, if there are any.
    #[must_use]
    pub fn specular(&self) -> Option<Specular> {
        self.shading.and_then(|terms| terms.specular)
    }
}

/// Why a scene has no plan.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlanError {
    /// Weights are requested, but are not exact.
    #[error(
        "accumulate = \"weights\" is not possible: the absorption of {materials} is coloured; use \"spectral\" or \"auto\""
    )]
    NotGrey {
        /// The materials with coloured absorption.
        materials: String,
    },
    /// Storing accumulators in 16 bits would exceed the tolerance.
    #[error(
        "storage = \"f16\" may change a colour by ΔE00 {error:.2}, and the tolerance is {tolerance}; use storage = \"f32\", or tolerance = {kept}"
    )]
    HalfPrecision {
        /// The largest change of a colour, in ΔE00.
        error: f64,
        /// The tolerance.
        tolerance: f64,
        /// A sufficient tolerance.
        kept: f64,
    },
    /// Accumulators are too large for 16 bits.
    #[error(
        "storage = \"f16\" is not possible: a pixel may hold numbers above 65504, the largest 16-bit float; use storage = \"f32\""
    )]
    HalfRange,
    /// A matrix of transmittance has no power by a factor that is known from the matrix alone.
    #[error(
        "the model peercy keeps a transmittance matrix, which factors by the gradient cannot scale; take another model, or remove transfer.gradient_opacity and every `gradient`"
    )]
    GradientMatrix,
    /// A step that a plane cuts for a part of its media has no effect that a model could project.
    #[error(
        "the model projects the effect of each step, of which clip planes of single volumes, or keep = \"any\", leave a part; take another model, or leave out clip.keep and `volumes`"
    )]
    ClipProjected,
    /// A march of several fields does not do this yet.
    #[error("a scene of several fields cannot have {what}")]
    Fields {
        /// The feature and the way out.
        what: &'static str,
    },
    /// An extreme value has no place in the volume, and the film of a part of a ray does not hold it.
    #[error("blending = \"{blending}\" is not possible with {what}")]
    Blending {
        /// The name of the rule.
        blending: &'static str,
        /// The feature and the way out.
        what: &'static str,
    },
    /// Terms whose factors differ are summed at each sample, and depths that a model projects step by step have no sum.
    #[error(
        "the model projects the transmittance of each step, so terms with different factors by the gradient have no sum; take another model, or one factor for all: transfer.gradient_opacity"
    )]
    GradientProjected,
    /// A matrix of transmittance has no spectrum per component, by which a film could be multiplied.
    #[error(
        "the model peercy multiplies matrices, and the film of {materials} changes with the angle; take another model, or remove `film`"
    )]
    FilmMatrix {
        /// Names of the materials.
        materials: String,
    },
    /// The effect of 16-bit storage on matrices is not known.
    #[error("the model peercy keeps a transmittance matrix, which is not stored in 16 bits; take storage = \"f32\"")]
    HalfMatrix,
    /// Segments are requested, but have no closed form.
    #[error("integration = \"segments\" is not possible: {why}; use \"samples\" or \"auto\"")]
    NoSegments {
        /// The reason.
        why: &'static str,
    },
    /// Shadows are requested where they cannot be computed.
    #[error("{setting} is not possible: {why}")]
    NoShadows {
        /// The key and its value.
        setting: String,
        /// The reason.
        why: String,
    },
    /// Light cannot scatter more than once.
    #[error("scattering.orders = \"multiple\" is not possible: {why}")]
    NoScattering {
        /// The reason and the way out.
        why: String,
    },
    /// No colour model meets the request.
    #[error("no colour model fits the scene")]
    Model(#[from] ModelError),
}

impl PlanError {
    /// Name for programs; it does not change between versions.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::NotGrey { .. } => "weights-inexact",
            Self::HalfPrecision { .. } => "half-imprecise",
            Self::HalfRange => "half-overflow",
            Self::GradientMatrix => "gradient-opacity-matrix",
            Self::GradientProjected => "gradient-projected",
            Self::ClipProjected => "clip-projected",
            Self::Fields { .. } => "fields-impossible",
            Self::Blending { .. } => "blending-impossible",
            Self::FilmMatrix { .. } => "film-matrix",
            Self::HalfMatrix => "half-matrix",
            Self::NoSegments { .. } => "segments-impossible",
            Self::NoShadows { .. } => "shadows-impossible",
            Self::NoScattering { .. } => "scattering-impossible",
            Self::Model(error) => error.code(),
        }
    }
}

/// Plans `scene` by its contents and its accuracy settings. Fits a colour model if one is needed.
///
/// # Errors
///
/// [`PlanError`].
pub fn plan(scene: &Scene, progress: &dyn Progress) -> Result<Planned, PlanError> {
    plan_for(scene, &[], progress)
}

/// [`plan`] with a colour model for additional lights, by name.
///
/// # Errors
///
/// [`PlanError`].
pub fn plan_for(scene: &Scene, lights: &[(String, Light)], progress: &dyn Progress) -> Result<Planned, PlanError> {
    let mut planned = chosen(scene, lights, progress)?;
    check(&planned, scene)?;
    let observer = planned.be_seen_by(scene.display.observer, scene.accuracy.tolerance)?;
    planned.warnings.extend(observer);
    planned.warnings.extend(planned.unused(scene));
    let sentences = planned.amplified(scene);
    if !sentences.is_empty() {
        planned.warnings.push(PlanWarning::Amplified { sentences });
    }
    Ok(planned)
}

/// Refuses matrices with a factor by the gradient magnitude, and 16-bit storage with an error above the tolerance.
fn check(planned: &Planned, scene: &Scene) -> Result<(), PlanError> {
    let Groups { number, further, .. } = planned.plan.groups;
    if planned.plan.blending.is_extreme() {
        check_extremes(planned, scene)?;
    }
    if further > 0 {
        check_fields(planned, scene)?;
    }
    if planned.plan.clip.is_by_field()
        && (planned.plan.transmittance == Transmittance::Mixed
            || projects_steps(&planned.plan, planned.model.as_deref()))
    {
        return Err(PlanError::ClipProjected);
    }
    if planned.plan.groups.any() && planned.plan.transmittance == Transmittance::Mixed {
        return Err(PlanError::GradientMatrix);
    }
    if number > 1 && projects_steps(&planned.plan, planned.model.as_deref()) {
        return Err(PlanError::GradientProjected);
    }
    if planned.plan.thin_films.total() > 0 && planned.plan.transmittance == Transmittance::Mixed {
        let materials: Vec<&str> = planned.thin_films(scene).iter().map(|film| film.material.name.as_str()).collect();
        return Err(PlanError::FilmMatrix { materials: materials.join(", ") });
    }
    if let (Integration::Segments, Some(why)) = (scene.accuracy.integration, planned.no_segments()) {
        return Err(PlanError::NoSegments { why });
    }
    shadows::check(planned, scene)?;
    half::check(planned, scene)
}

/// Why `scene` has no plan, as far as that does not depend on its colours.
#[must_use]
pub(crate) fn refused(scene: &Scene) -> Option<PlanError> {
    let planned = planned(scene, None);
    let of_extremes = if planned.plan.blending.is_extreme() { check_extremes(&planned, scene).err() } else { None };
    of_extremes.or_else(|| if planned.plan.groups.further > 0 { check_fields(&planned, scene).err() } else { None })
}

/// Refuses what a single value of a ray cannot have.
fn check_extremes(planned: &Planned, scene: &Scene) -> Result<(), PlanError> {
    let plan = &planned.plan;
    let what = if plan.labels {
        "labels, because a value has no label; leave them out"
    } else if plan.groups.by_gradient() {
        "factors by the gradient, because a value has none; remove transfer.gradient_opacity and every `gradient`"
    } else if plan.groups.overlap != Overlap::Add {
        "an overlap other than \"add\", because the largest values have places of their own; leave out `overlap`"
    } else if plan.clip.is_by_field() {
        "clip planes of single volumes, or clip.keep = \"any\"; leave out `volumes` and `keep`"
    } else if plan.groups.shapes[0] > 0 {
        "shapes, because each largest value has a place of its own; remove every `shape`"
    } else if plan.groups.by_fields != [0; 2] {
        "factors by the values of other fields, because each largest value has a place of its own; remove every `by`"
    } else if plan.transmittance == Transmittance::Mixed || projects_steps(plan, planned.model.as_deref()) {
        "a model that projects each step; take another model"
    } else if scene.block.is_some() {
        "blocks, because the film of a part of a ray does not hold its values; render the picture as a whole"
    } else {
        return Ok(());
    };
    Err(PlanError::Blending { blending: plan.blending.name(), what })
}

/// True if shadows do not tell where all media are.
fn hides_unseen(planned: &Planned, scene: &Scene) -> bool {
    let is_xray = |&material: &usize| scene.materials.get(material).is_some_and(Material::is_xray);
    planned.plan.light.absorbers > 0 || planned.materials.iter().any(is_xray)
}

/// Refuses what a march of several fields does not do.
fn check_fields(planned: &Planned, scene: &Scene) -> Result<(), PlanError> {
    let plan = &planned.plan;
    let what = if plan.transmittance == Transmittance::Mixed || projects_steps(plan, planned.model.as_deref()) {
        "the model, which projects each step; take another model"
    } else if scene.accuracy.voxel_pixels > 0.0 {
        "a level by the size of voxels, which is one of a single volume; leave out accuracy.voxel_pixels"
    } else if scene.fields.iter().any(|field| field.bricks().is_some()) {
        "a file of bricks; open the volumes that it was made of"
    } else if plan.groups.overlap != Overlap::Add && plan.light.grid_lights() > 0 && hides_unseen(planned, scene) {
        "an overlap other than \"add\" with shadows and X-ray materials or coloured absorption, whose shadows do not tell where they are; take overlap = \"add\", leave out the shadows, or let these materials occlude"
    } else {
        return Ok(());
    };
    Err(PlanError::Fields { what })
}

/// Names of the materials with coloured absorption.
fn coloured(scene: &Scene) -> String {
    let materials = scene.materials.iter().enumerate().filter(|&(index, material)| {
        scene.absorbs(index)
            && material.absorption.as_ref().is_some_and(|absorption| !is_constant(absorption.spectrum()))
    });
    materials.map(|(_, material)| material.name.as_str()).collect::<Vec<_>>().join(", ")
}

/// The plan of `scene`, before its [`check`].
fn chosen(scene: &Scene, lights: &[(String, Light)], progress: &dyn Progress) -> Result<Planned, PlanError> {
    let weights = planned(scene, None);
    // Before a model is fitted in vain.
    shadows::check(&weights, scene)?;
    scattering::check(&weights, scene)?;
    if weights.plan.transmittance == Transmittance::Coloured && scene.accuracy.accumulate == AccumulateAs::Weights {
        return Err(PlanError::NotGrey { materials: coloured(scene) });
    }
    let exact = weights.plan.transmittance == Transmittance::Grey && weights.plan.light.gathered.is_none();
    let Accuracy { model: kind, tolerance, dimension, accumulate, .. } = scene.accuracy;
    let narrower = narrower(&weights.plan);
    let mut warning = None;
    let model_with = |coefficients| {
        let mut ingredients = weights.ingredients(scene);
        for (name, light) in lights {
            if ingredients.lights.iter().all(|(_, known)| known != light) {
                ingredients.lights.push((name.clone(), light.clone()));
            }
        }
        RECENT.fitted(Wanted { ingredients, kind, coefficients }, progress)
    };
    let model = match (accumulate, dimension) {
        (AccumulateAs::Weights, _) => None,
        (AccumulateAs::Auto, Some(dimension)) if exact && dimension > narrower => None,
        (AccumulateAs::Auto, None) if exact && narrower == 0 => None,
        (AccumulateAs::Auto, None) if exact => {
            match model_with(Coefficients::AtMost(narrower, EXACTNESS * tolerance)) {
                Err(stopped @ ModelError::Cancelled) => return Err(stopped.into()),
                // Without a fit, weights remain; also if the spectra of a film between its fitted angles do not.
                found => found
                    .ok()
                    .and_then(|found| found.model)
                    .filter(|model| weights.thin_films(scene).iter().all(|film| film.error_in(model) <= tolerance)),
            }
        }
        (AccumulateAs::Auto | AccumulateAs::Spectral, Some(dimension)) => {
            let found = model_with(Coefficients::Stated(dimension))?;
            warning = found.warning;
            found.model
        }
        (AccumulateAs::Auto | AccumulateAs::Spectral, None) => model_with(Coefficients::Keeping(tolerance))?.model,
    };
    let mut chosen = model.map_or(weights, |model| planned(scene, Some(model)));
    chosen.warnings.extend(warning);
    Ok(chosen)
}

/// The largest number of coefficients in fewer vectors than the weights of `plan`.
fn narrower(plan: &ScenePlan) -> usize {
    plan.lanes().saturating_sub(1) * LANE
}

/// The plan with all 81 wavelengths, the reference for other plans.
#[must_use]
pub fn plan_full_spectrum(scene: &Scene) -> Planned {
    let planned = planned(scene, Some(Arc::new(ColourModel::full_spectrum())));
    Planned { plan: ScenePlan { storage: StoreAs::Single, ..planned.plan }, ..planned }
}

/// The plan of `scene` with coefficients of `model`, or with weights if there is no model.
pub(crate) fn planned(scene: &Scene, model: Option<Arc<ColourModel>>) -> Planned {
    let materials: Vec<usize> = (0..scene.materials.len()).filter(|&material| scene.shows(material)).collect();
    let positions = positions(scene);
    let is_directed = positions.iter().any(|position| position.placement != Placement::Ambient);
    let used = || materials.iter().filter_map(|&material| scene.materials.get(material));
    let directed = scene.shading == Shading::Gradient && is_directed && !scene.blending.is_extreme();
    let diffuse = directed && used().any(|material| material.own_diffuse() > 0.0);
    let exponents = if directed { exponents(used()) } else { Vec::new() };
    let specular = exponents.last().map(|&largest| Specular {
        one_exponent: Some(largest).filter(|_| exponents.len() == 1),
        exponent_bits: u32::BITS - largest.leading_zeros(),
    });
    let accumulate = match &model {
        None => Accumulate::Weights { materials: materials.len() },
        Some(model) => {
            let mut shares = used().map(|material| [material.ambient, material.own_diffuse()]);
            let first = shares.next();
            let equal = !directed || shares.all(|share| Some(share) == first);
            Accumulate::Spectral {
                dimension: model.dimension(),
                shares: if equal { Shares::Equal } else { Shares::Own },
                exponents: exponents.len(),
            }
        }
    };
    let transmittance = transmittance(scene);
    let coloured = transmittance == Transmittance::Coloured;
    let occluded =
        directed && scene.shadows.ambient == AmbientShares::Occluded && used().any(|material| material.ambient > 0.0);
    let absorbers = if coloured { needs::absorbers(scene).count() } else { 0 };
    let thin_films = if directed {
        needs::thin_film_counts(used(), model.is_none().then_some(scene.accuracy.tolerance))
    } else {
        FilmCounts::default()
    };
    let one_sided = scene.lighting == Lighting::OneSided && (diffuse || specular.is_some() || thin_films.total() > 0);
    let shading = directed.then_some(ShadingTerms { diffuse, specular, one_sided });
    let phases = match accumulate {
        _ if !scene.has_phases() || !is_directed => 0,
        Accumulate::Weights { materials } => materials,
        Accumulate::Spectral { .. } => needs::phases(used()).len(),
    };
    let labels = !scene.declared().is_empty();
    let mut plan = ScenePlan {
        accumulate,
        transmittance: match (transmittance, model.as_ref().map(|model| model.kind())) {
            (Transmittance::Coloured, Some(ModelKind::Peercy)) => Transmittance::Mixed,
            (transmittance, _) => transmittance,
        },
        light: LightPlan {
            gathered: (scene.scatters_often() && !positions.is_empty()).then_some(scene.scattering.method),
            ..LightPlan::new(&positions, occluded, scene.shadows.method, absorbers)
        },
        shading,
        phases,
        thin_films,
        groups: Groups::of(scene),
        clip: ClipPlan {
            planes: scene.clip.in_order().count(),
            shortening: scene.clip.in_order().filter(|plane| scene.clip.shortens(plane)).count(),
            keeps_any: scene.clip.is_by_field() && scene.clip.keep == Keep::Any,
            caps: scene.clip.cap
                && scene.clip.in_force().next().is_some()
                && (diffuse || specular.is_some() || thin_films.total() > 0),
        },
        labels,
        smooth_labels: labels && scene.accuracy.labels == LabelInterpolation::Smooth,
        labels_by_value: scene.declared().iter().any(|entry| !entry.terms.is_empty()),
        background: scene.background.is_some(),
        lookup: scene.transfer.lookup,
        integration: Integrate::Samples,
        blending: scene.blending,
        interpolation: scene.accuracy.interpolation,
        volume: stored_volume(scene),
        gradients: Gradients::Packed,
        skipping: scene.accuracy.skipping,
        rays: scene.accuracy.rays,
        jitter: scene.accuracy.jitter,
        crossings: false,
        compensated: scene.most_steps() > MOST_PLAIN_STEPS && !scene.blending.is_extreme(),
        storage: scene.accuracy.storage,
    };
    if plan.shades_by_gradient() {
        plan.groups.lit = std::array::from_fn(|field| field > 0 && is_lit(scene, field));
    }
    if plan.gradient() {
        // Texels of several fields have no room for gradients.
        plan.gradients = if plan.groups.sharing > 0 { Gradients::Central } else { scene.accuracy.gradients };
    }
    let wants_segments = match scene.accuracy.integration {
        Integration::Samples | Integration::Adaptive => false,
        Integration::Segments => true,
        Integration::Auto => narrow(scene).is_some(),
    };
    if wants_segments && no_segments(&plan, model.as_deref()).is_none() {
        plan.integration = Integrate::Segments;
    }
    if scene.accuracy.integration == Integration::Adaptive && not_refined(&plan, model.as_deref()).is_none() {
        plan.integration = Integrate::Refined;
        plan.crossings = crossed(scene).is_some();
        // Parts of a step are closed from densities.
        plan.groups.number = plan.groups.number.max(1);
    }
    Planned { plan, materials, positions, model, warnings: Vec::new() }
}

/// True if a field shows a material that is shaded.
fn is_lit(scene: &Scene, field: usize) -> bool {
    let mut materials = scene.terms_of(field).iter().flat_map(|term| &term.material.0);
    materials.any(|point| scene.materials.get(point.1).is_some_and(|material| !material.is_flat()))
}

/// Why `plan` cannot integrate in segments, if it cannot: their closed form needs components that decay independently,
/// and values that change continuously.
fn no_segments(plan: &ScenePlan, model: Option<&ColourModel>) -> Option<&'static str> {
    if plan.transmittance == Transmittance::Mixed {
        Some("the model peercy multiplies matrices")
    } else if projects_steps(plan, model) {
        Some("the model projects the transmittance of each step")
    } else if plan.blending.is_extreme() {
        Some("a single value of a ray is seen, and it has no neighbours")
    } else if plan.groups.further > 0 {
        Some("several fields have no common value between the ends of a segment")
    } else if plan.groups.shapes[0] > 0 {
        Some("a shape has no means between two values")
    } else if plan.clip.is_by_field() {
        Some("the part of a segment that clip planes of single volumes, or keep = \"any\", leave is not one segment")
    } else if plan.labels_by_value {
        Some("labels by value have no means between two values")
    } else if plan.interpolation == Interpolation::Nearest {
        Some("the values of nearest interpolation jump")
    } else {
        None
    }
}

/// Why `plan` does not refine steps, if it does not.
fn not_refined(plan: &ScenePlan, model: Option<&ColourModel>) -> Option<&'static str> {
    if plan.transmittance == Transmittance::Mixed {
        Some("the model peercy multiplies matrices")
    } else if projects_steps(plan, model) {
        Some("the model projects the transmittance of each step")
    } else if plan.blending.is_extreme() {
        Some("a single value of a ray is seen")
    } else if plan.groups.further > 0 {
        Some("a sample has several fields")
    } else if plan.clip.is_by_field() {
        Some("clip planes of single volumes, or keep = \"any\", leave parts of a step")
    } else {
        None
    }
}

/// Storage of the values: all fields of a scene have the same, by the types of their voxels.
fn stored_volume(scene: &Scene) -> VolumeAs {
    if scene.fields.further().is_empty() || scene.accuracy.volume != VolumeAs::Auto {
        return scene.accuracy.volume;
    }
    let is_short = |field: &Field| field.volume.voxels.voxel_type().bytes() <= 2;
    if scene.fields.iter().all(is_short) { VolumeAs::Short } else { VolumeAs::Single }
}

/// True if the model projects the transmittance of each step.
fn projects_steps(plan: &ScenePlan, model: Option<&ColourModel>) -> bool {
    plan.transmittance == Transmittance::Coloured
        && model.is_some_and(|model| model.kind() == ModelKind::Sharpened(Order::Step))
}

impl Planned {
    /// Why this plan cannot integrate in segments, if it cannot.
    #[must_use]
    pub fn no_segments(&self) -> Option<&'static str> {
        no_segments(&self.plan, self.model.as_deref())
    }

    /// Why this plan does not refine steps, if it does not.
    #[must_use]
    pub fn not_refined(&self) -> Option<&'static str> {
        not_refined(&self.plan, self.model.as_deref())
    }

    /// Fits the colour model, if any, to `observer`; pixels are the same for every observer. Returns a warning if the
    /// error exceeds the tolerance.
    fn be_seen_by(&mut self, observer: Observer, tolerance: f64) -> Result<Option<PlanWarning>, ModelError> {
        let Some(model) = self.model.as_mut().filter(|model| model.observer() != observer) else { return Ok(None) };
        *model = Arc::new(model.seen_by(observer)?);
        let error = model.worst().max;
        Ok((error > tolerance).then_some(PlanWarning::Observer { observer, error, tolerance }))
    }

    /// The plan of a `scene` that differs from that of this plan only in camera, crop box and display.
    #[must_use]
    pub fn seen_otherwise(&self, scene: &Scene) -> Self {
        planned(scene, self.model.clone())
    }

    /// The plan of `scene` if it needs the same colour model as `before`, the scene of this plan. Equal to the result
    /// of [`plan`], but immediate. `None` if a model has to be fitted, or the plan is refused.
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
        alike.then(|| self.seen_otherwise(scene)).filter(|planned| check(planned, scene).is_ok())
    }

    /// The largest change, in ΔE00, that 16-bit storage of finished accumulators makes to a colour of at most white's
    /// brightness under one of the scene's lights; `None` for storage in f32. Infinite if a number may be too large for
    /// 16 bits.
    #[must_use]
    pub fn half_precision_error(&self, scene: &Scene) -> Option<f64> {
        (self.plan.storage == StoreAs::Half).then(|| half::error(self, scene))
    }
}
