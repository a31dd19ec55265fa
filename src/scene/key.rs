//! The table of the scalar keys of a scene: what scene files, edits, sessions, sweeps and scripts may set, and to what.
//!
//! A row states a key once: its path, kind and range, how a scene holds it, and what a change makes stale. Its default is the
//! value in a new part: [`Scene::new`], [`Material::new`], [`SceneLight::new`].
//!
//! ```
//! use relume_scene::key::{self, Value};
//! # use relume_scene::Material;
//! # use relume_colour::spectrum::{Reflectance, Spectrum};
//! let mut bone = Material::new("bone", Reflectance::new(Spectrum::constant(0.9))?);
//! let phase = key::MATERIAL.iter().find(|key| key.path == "phase").ok_or("no such key")?;
//! phase.set(&mut bone, Some(Value::Number(0.5)))?;
//! assert_eq!(phase.get(&bone), Some(Value::Number(0.5)));
//! let refused = phase.set(&mut bone, Some(Value::Number(2.0))).map_err(|error| error.to_string());
//! assert_eq!(refused, Err("phase = 2; it must be a number from -0.99 to 0.99".to_owned()));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use std::fmt;
use std::ops::RangeInclusive;

use relume_base::number::{count, readable, unsigned, whole};
use relume_colour::model::{LARGEST_DIMENSION, ModelKind};
use relume_colour::spectrum::deficiency::Deficiency;
use relume_colour::spectrum::nearest;
use relume_colour::spectrum::observer::Observer;
use relume_colour::written::refused_name;

use Kind::{Number, NumberOr, Switch, Whole};
use Stale::{Accumulators, Matrices, Nothing, Picture, Tables};

use crate::{
    AccumulateAs, Aim, AmbientShares, BRIGHTEST, Backdrop, Blending, Gradients, INTENSITY, Integration, Interpolation,
    LARGEST_EXPOSURE, LabelInterpolation, Lighting, Lookup, Material, Orders, Overlap, PHASES, Projection,
    ScatteringMethod, Scene, SceneLight, Shading, ShadowMethod, StoreAs, Tone, VolumeAs,
};

/// A key of a part `T` of a scene: the scene itself, a material or a light.
#[derive(Debug)]
pub struct Key<T> {
    /// Path in a scene file, such as `accuracy.step`; of a material or light, the name in its table.
    pub path: &'static str,
    /// Allowed values.
    pub kind: Kind,
    /// Default in words, if it depends on other keys or is no value.
    pub otherwise: Option<&'static str>,
    /// Numbers that the window offers and sweeps try, if these are fewer than a file may state.
    pub offered: Option<[f64; 2]>,
    /// True if the offered numbers are in smallest spacings, where a file has world units.
    pub in_voxels: bool,
    /// The stage that a change makes stale, at most; [`Stale::Nothing`] where [`Stale::between`] compares plans.
    pub stale: Stale,
    /// The knob of `relume measure`, if it varies the key.
    pub knob: Option<Knob>,
    get: fn(&T) -> Option<Value<'static>>,
    put: fn(&mut T, Option<Value<'_>>),
}

/// Access of a key to a part.
#[derive(Debug)]
pub struct Access<T> {
    /// The value in a part, if it has one there.
    pub get: fn(&T) -> Option<Value<'static>>,
    /// Sets a value in a part, or none.
    pub put: fn(&mut T, Option<Value<'_>>),
}

/// Allowed values of a key.
#[derive(Clone, Copy, Debug)]
pub enum Kind {
    /// A number of a range and its unit, if it has one.
    Number([f64; 2], &'static str),
    /// A number of a range, or a word in place of one.
    NumberOr([f64; 2], &'static str),
    /// A whole number of a range, or a word in place of one.
    Whole([usize; 2], Option<&'static str>),
    /// One of these names.
    Names(fn() -> Vec<&'static str>),
    /// True or false.
    Switch,
}

/// A value of a key.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value<'a> {
    /// A number, also a whole one.
    Number(f64),
    /// A name.
    Name(&'a str),
    /// True or false.
    Switch(bool),
}

impl fmt::Display for Value<'_> {
    /// As in a scene file.
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(number) => out.pad(&readable(*number)),
            Self::Name(name) => write!(out, "{name:?}"),
            Self::Switch(on) => out.pad(if *on { "true" } else { "false" }),
        }
    }
}

/// Values of a key for `relume measure`.
#[derive(Clone, Copy, Debug)]
pub struct Knob {
    /// The number after one of a range.
    pub next: fn(f64) -> f64,
    /// Values of the sweep without a request; empty for keys that most scenes do not depend on.
    pub tried: &'static str,
    /// Description for users.
    pub meaning: &'static str,
}

/// The earliest stage of rendering with an obsolete result. A stale stage makes all later stages stale.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stale {
    /// The picture is up to date.
    #[default]
    Nothing,
    /// The picture: relights the film.
    Picture,
    /// The matrices of the colour model: fits them again; pixels stay.
    Matrices,
    /// The accumulators: marches again with the same tables.
    Accumulators,
    /// The tables: plans again, with new tables and, if its spectra have changed, a new colour model.
    Tables,
    /// The volume: uploads it again.
    Volume,
}

/// A value that a key may not have.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{key} = {value}; it must be {allowed}")]
pub struct KeyError {
    /// Path of the key.
    pub key: String,
    /// The value in words.
    pub value: String,
    /// The allowed values in words.
    pub allowed: String,
}

/// Any finite number above 0.
const POSITIVE: [f64; 2] = [f64::MIN_POSITIVE, f64::MAX];
/// Any finite number.
const FINITE: [f64; 2] = [f64::MIN, f64::MAX];
const UNIT: [f64; 2] = [0.0, 1.0];

/// The numbers of `range` in words.
#[must_use]
pub fn numbers(range: [f64; 2]) -> String {
    match range {
        POSITIVE => "a finite number above 0".to_owned(),
        FINITE => "a finite number".to_owned(),
        [least, f64::MAX] => format!("a finite number from {}", readable(least)),
        [least, most] => format!("a number from {} to {}", readable(least), readable(most)),
    }
}

impl Kind {
    /// The allowed values in words.
    #[must_use]
    pub fn allowed(&self) -> String {
        match self {
            Self::Number(range, _) => numbers(*range),
            Self::NumberOr(range, word) => format!("{}, or {word:?}", numbers(*range)),
            Self::Whole([least, most], word) => {
                let or = word.map_or_else(String::new, |word| format!(", or {word:?}"));
                format!("a whole number from {least} to {most}{or}")
            }
            Self::Names(names) => format!("one of `{}`", names().join("`, `")),
            Self::Switch => "true or false".to_owned(),
        }
    }

    /// True if `value` is allowed.
    #[must_use]
    pub fn allows(&self, value: Value<'_>) -> bool {
        match (self, value) {
            (Self::Number([least, most], _) | Self::NumberOr([least, most], _), Value::Number(number)) => {
                (*least..=*most).contains(&number)
            }
            (Self::NumberOr(_, word), Value::Name(name)) => *word == name,
            (Self::Whole([least, most], _), Value::Number(number)) => {
                number.fract() == 0.0 && (count(*least)..=count(*most)).contains(&number)
            }
            (Self::Whole(_, word), Value::Name(name)) => *word == Some(name),
            (Self::Names(names), Value::Name(name)) => names().contains(&name),
            (Self::Switch, Value::Switch(_)) => true,
            _ => false,
        }
    }
}

impl<T> Key<T> {
    /// The last part of the path.
    #[must_use]
    pub fn name(&self) -> &'static str {
        self.path.rsplit('.').next().unwrap_or(self.path)
    }

    /// The value in `part`; `None` if it has none there.
    #[must_use]
    pub fn get(&self, part: &T) -> Option<Value<'static>> {
        (self.get)(part)
    }

    /// Sets the value in `part`; `None` is no value.
    ///
    /// # Errors
    ///
    /// [`KeyError`] for a value that it may not have, or no value where it needs one; `part` is then unchanged.
    pub fn set(&self, part: &mut T, value: Option<Value<'_>>) -> Result<(), KeyError> {
        value.map_or(Ok(()), |value| self.check(value))?;
        (self.put)(part, value);
        if self.get(part) == value {
            return Ok(());
        }
        let other = || "left out: it belongs to another kind of camera".to_owned();
        let allowed = if value.is_none() { self.kind.allowed() } else { other() };
        let value = value.map_or_else(|| "nothing".to_owned(), |value| value.to_string());
        Err(KeyError { key: self.path.to_owned(), value, allowed })
    }

    /// Checks a value.
    ///
    /// # Errors
    ///
    /// [`KeyError`] for a value that it may not have.
    pub fn check(&self, value: Value<'_>) -> Result<(), KeyError> {
        if self.kind.allows(value) {
            return Ok(());
        }
        let (mut stated, mut allowed) = (value.to_string(), self.kind.allowed());
        if let (Kind::Names(names), Value::Name(name)) = (self.kind, value) {
            stated = format!("`{name}`");
            if let Some(similar) = nearest(name, names().into_iter()) {
                allowed += &format!("; did you mean `{similar}`?");
            }
        }
        Err(KeyError { key: self.path.to_owned(), value: stated, allowed })
    }

    /// Numbers that the window offers and sweeps try.
    #[must_use]
    pub fn offered(&self) -> RangeInclusive<f64> {
        let [least, most] = match (self.offered, self.kind) {
            (Some(range), _) | (None, Number(range, _) | NumberOr(range, _)) => range,
            (None, Whole(range, _)) => range.map(count),
            (None, Kind::Names(_) | Switch) => FINITE,
        };
        least..=most
    }

    /// A key without a default in words, held as `access` says.
    #[must_use]
    pub const fn new(path: &'static str, kind: Kind, stale: Stale, Access { get, put }: Access<T>) -> Self {
        Self { path, kind, otherwise: None, offered: None, in_voxels: false, stale, knob: None, get, put }
    }

    const fn otherwise(mut self, words: &'static str) -> Self {
        self.otherwise = Some(words);
        self
    }

    const fn offering(mut self, range: [f64; 2], in_voxels: bool) -> Self {
        (self.offered, self.in_voxels) = (Some(range), in_voxels);
        self
    }

    /// The key as a knob whose numbers double in a range, with the values that a sweep without a request tries.
    #[must_use]
    pub const fn knob(mut self, tried: &'static str, meaning: &'static str) -> Self {
        self.knob = Some(Knob { next: |number| 2.0 * number, tried, meaning });
        self
    }

    const fn growing(mut self, next: fn(f64) -> f64) -> Self {
        if let Some(knob) = &mut self.knob {
            knob.next = next;
        }
        self
    }
}

impl Key<Scene> {
    /// The unit of the offered numbers in `scene`, as a number of a file.
    #[must_use]
    pub fn unit(&self, scene: &Scene) -> f64 {
        if self.in_voxels { scene.frame.geometry.spacing.min_element() } else { 1.0 }
    }
}

/// The key of a scene with this path.
#[must_use]
pub fn of_scene(path: &str) -> Option<&'static Key<Scene>> {
    SCENE.iter().find(|key| key.path == path)
}

/// Moves the numbers of the keys of `scene` whose paths begin with `beginning` into the ranges that the window offers; those
/// that are not finite become the defaults.
pub fn clamp(scene: &mut Scene, beginning: &str) {
    let new = Scene::new("", scene.volume().clone());
    for key in SCENE.iter().filter(|key| key.path.starts_with(beginning)) {
        if let Some(Value::Number(number)) = key.get(scene) {
            let [least, most] = [*key.offered().start(), *key.offered().end()].map(|end| end * key.unit(&new));
            let nearest = Some(Value::Number(number.clamp(least, most)));
            (key.put)(scene, if number.is_finite() { nearest } else { key.get(&new) });
        }
    }
}

/// The stage that differences in the keys whose paths begin with `beginning` make stale by themselves.
#[must_use]
pub fn stale(before: &Scene, after: &Scene, beginning: &str) -> Stale {
    let keys = SCENE.iter().filter(|key| key.path.starts_with(beginning) && key.get(before) != key.get(after));
    keys.map(|key| key.stale).max().unwrap_or_default()
}

/// A field that holds the value of a key.
trait Field: Sized {
    fn value(&self) -> Option<Value<'static>>;
    /// `None` for a value of another kind.
    fn of(value: Option<Value<'_>>) -> Option<Self>;
    fn store(&mut self, value: Option<Value<'_>>) {
        if let Some(value) = Self::of(value) {
            *self = value;
        }
    }
}

impl Field for f64 {
    fn value(&self) -> Option<Value<'static>> {
        Some(Value::Number(*self))
    }

    fn of(value: Option<Value<'_>>) -> Option<Self> {
        if let Some(Value::Number(number)) = value { Some(number) } else { None }
    }
}

impl Field for usize {
    fn value(&self) -> Option<Value<'static>> {
        count(*self).value()
    }

    fn of(value: Option<Value<'_>>) -> Option<Self> {
        f64::of(value).map(whole)
    }
}

impl Field for u32 {
    fn value(&self) -> Option<Value<'static>> {
        f64::from(*self).value()
    }

    fn of(value: Option<Value<'_>>) -> Option<Self> {
        usize::of(value).map(unsigned)
    }
}

impl Field for bool {
    fn value(&self) -> Option<Value<'static>> {
        Some(Value::Switch(*self))
    }

    fn of(value: Option<Value<'_>>) -> Option<Self> {
        if let Some(Value::Switch(on)) = value { Some(on) } else { None }
    }
}

impl<F: Field> Field for Option<F> {
    fn value(&self) -> Option<Value<'static>> {
        self.as_ref().and_then(F::value)
    }

    fn of(value: Option<Value<'_>>) -> Option<Self> {
        if value.is_none() { Some(None) } else { F::of(value).map(Some) }
    }
}

/// Choices and their names.
pub type Choices<N> = &'static [(N, &'static str)];

/// A choice by its name.
pub trait Named: Copy + PartialEq + 'static {
    /// All choices, with their names in scene files.
    const ALL: Choices<Self>;

    /// Name in scene files.
    #[must_use]
    fn name(self) -> &'static str {
        Self::ALL.iter().find(|(one, _)| *one == self).map_or("", |(_, name)| name)
    }

    /// The choice of this name, if there is one.
    #[must_use]
    fn of_name(name: &str) -> Option<Self> {
        Self::ALL.iter().find(|(_, one)| *one == name).map(|(choice, _)| *choice)
    }

    /// The choice of this name, of `what`, such as "the tones".
    ///
    /// # Errors
    ///
    /// The names of all choices, and the most similar one.
    fn named(name: &str, what: &str) -> Result<Self, String> {
        let all: Vec<&str> = Self::ALL.iter().map(|(_, name)| *name).collect();
        Self::of_name(name).ok_or_else(|| refused_name(name, what, &all))
    }
}

impl<N: Named> Field for N {
    fn value(&self) -> Option<Value<'static>> {
        Some(Value::Name(Named::name(*self)))
    }

    fn of(value: Option<Value<'_>>) -> Option<Self> {
        if let Some(Value::Name(name)) = value { N::of_name(name) } else { None }
    }
}

const fn names<N: Named>() -> Kind {
    Kind::Names(|| N::ALL.iter().map(|(_, name)| *name).collect())
}

/// The names of choices, in the order of the documentation.
#[rustfmt::skip]
mod choices {
    use super::*;

    impl Named for Overlap { const ALL: Choices<Self> = &[(Self::Add, "add"), (Self::First, "first"), (Self::Last, "last")]; }
    impl Named for Blending { const ALL: Choices<Self> = &[(Self::Composite, "composite"), (Self::Maximum, "maximum"), (Self::Minimum, "minimum")]; }
    impl Named for Shading { const ALL: Choices<Self> = &[(Self::None, "none"), (Self::Gradient, "gradient")]; }
    impl Named for Lighting { const ALL: Choices<Self> = &[(Self::TwoSided, "two_sided"), (Self::OneSided, "one_sided")]; }
    impl Named for AmbientShares { const ALL: Choices<Self> = &[(Self::Open, "open"), (Self::Occluded, "occluded")]; }
    impl Named for ShadowMethod { const ALL: Choices<Self> = &[(Self::Grid, "grid"), (Self::Rays, "rays")]; }
    impl Named for Orders { const ALL: Choices<Self> = &[(Self::Single, "single"), (Self::Multiple, "multiple")]; }
    impl Named for ScatteringMethod { const ALL: Choices<Self> = &[(Self::Rows, "rows"), (Self::Paths, "paths")]; }
    impl Named for Interpolation { const ALL: Choices<Self> = &[(Self::Nearest, "nearest"), (Self::Linear, "linear"), (Self::ExactLinear, "exact_linear"), (Self::Cubic, "cubic"), (Self::CubicX, "cubic_x"), (Self::CubicY, "cubic_y"), (Self::CubicZ, "cubic_z")]; }
    impl Named for LabelInterpolation { const ALL: Choices<Self> = &[(Self::Smooth, "smooth"), (Self::Nearest, "nearest")]; }
    impl Named for Integration { const ALL: Choices<Self> = &[(Self::Auto, "auto"), (Self::Segments, "segments"), (Self::Samples, "samples"), (Self::Adaptive, "adaptive")]; }
    impl Named for VolumeAs { const ALL: Choices<Self> = &[(Self::Auto, "auto"), (Self::Single, "f32"), (Self::Short, "u16")]; }
    impl Named for Gradients { const ALL: Choices<Self> = &[(Self::Packed, "packed"), (Self::Central, "central")]; }
    impl Named for StoreAs { const ALL: Choices<Self> = &[(Self::Single, "f32"), (Self::Half, "f16")]; }
    impl Named for AccumulateAs { const ALL: Choices<Self> = &[(Self::Auto, "auto"), (Self::Weights, "weights"), (Self::Spectral, "spectral")]; }
    impl Named for Lookup { const ALL: Choices<Self> = &[(Self::Nearest, "nearest"), (Self::Linear, "linear")]; }
    impl Named for Backdrop { const ALL: Choices<Self> = &[(Self::None, "none"), (Self::Dark, "dark")]; }
    impl Named for Tone { const ALL: Choices<Self> = &[(Self::Linear, "linear"), (Self::Soft, "soft")]; }
    impl Named for Observer { const ALL: Choices<Self> = &[(Self::Cie1931, "1931"), (Self::Cie1964, "1964")]; }
    impl Named for Deficiency { const ALL: Choices<Self> = &[(Self::Protan, "protan"), (Self::Deutan, "deutan"), (Self::Tritan, "tritan")]; }
}

impl Named for ModelKind {
    const ALL: Choices<Self> = &{
        let (mut all, mut i) = ([(Self::Nodes, ""); Self::ALL.len()], 0);
        while i < all.len() {
            all[i] = (Self::ALL[i], Self::ALL[i].name());
            i += 1;
        }
        all
    };
}

/// Access to a field of a part, or to one of a variant of an enum in it.
macro_rules! field {
    ($part:ty: $($field:ident).+) => {
        Access { get: |it: &$part| it.$($field).+.value(), put: |it: &mut $part, value| it.$($field).+.store(value) }
    };
    ($part:ty: $($field:ident).+, $variant:pat => $number:ident) => {
        Access {
            get: |it: &$part| if let $variant = &it.$($field).+ { $number.value() } else { None },
            put: |it: &mut $part, value| if let $variant = &mut it.$($field).+ { $number.store(value) },
        }
    };
}

/// The keys of a scene. Knobs are in the order in which reports list them.
#[rustfmt::skip]
pub const SCENE: &[Key<Scene>] = &[
    Key::new("blending", names::<Blending>(), Nothing, field!(Scene: blending)),
    Key::new("overlap", names::<Overlap>(), Nothing, field!(Scene: overlap)),
    Key::new("shading", names::<Shading>(), Nothing, field!(Scene: shading)),
    Key::new("lighting", names::<Lighting>(), Nothing, field!(Scene: lighting)),
    Key::new("accuracy.model", names::<ModelKind>(), Tables, field!(Scene: accuracy.model))
        .knob("nodes,sharpened,sharpened-semigroup,bands,rgb-naive,rgb-prefiltered,rgb-fitted", "colour model (k = 8; RGB has 3)"),
    Key::new("accuracy.k", Whole([1, LARGEST_DIMENSION], Some("auto")), Tables, Access {
        get: |it: &Scene| it.accuracy.dimension.value().or(Some(Value::Name("auto"))),
        put: |it: &mut Scene, value| {
            if value.is_some() {
                it.accuracy.dimension = usize::of(value);
            }
        },
    })
        .knob("3,4,6,8,12", "dimension of the colour model").growing(|k| k + 1.0),
    Key::new("accuracy.accumulate", names::<AccumulateAs>(), Tables, field!(Scene: accuracy.accumulate))
        .knob("", "contents of a pixel: material weights or coefficients"),
    Key::new("accuracy.storage", names::<StoreAs>(), Nothing, field!(Scene: accuracy.storage))
        .knob("f16", "bits of the numbers of a finished pixel"),
    // By hand or in a sweep, in voxels: with shorter steps a picture takes hours, and a longer one crosses any volume.
    Key::new("accuracy.step", Number(POSITIVE, "world units"), Tables, field!(Scene: accuracy.step_length))
        .otherwise("the smallest spacing").offering([0.01, 1000.0], true)
        .knob("0.25..4", "distance between two samples along a ray, in voxels"),
    Key::new("accuracy.termination", Number([0.0, 0.5], ""), Accumulators, field!(Scene: accuracy.termination))
        .knob("0,0.001,0.01,0.1", "transmittance at which a ray ends").growing(|number| 10.0 * number),
    Key::new("accuracy.rays", Whole([1, 256], None), Nothing, field!(Scene: accuracy.rays))
        .knob("", "rays of a pixel, whose mean it is").growing(|rays| 4.0 * rays),
    Key::new("accuracy.jitter", Switch, Nothing, field!(Scene: accuracy.jitter))
        .knob("on", "steps of each ray from another part of a step on, in place of the same: a grain in place of rings"),
    Key::new("accuracy.integration", names::<Integration>(), Nothing, field!(Scene: accuracy.integration))
        .knob("segments,adaptive", "medium of a step: at its middle (samples), its mean between the values at both ends (segments), or at up to three places where it differs from the steps beside (adaptive)"),
    Key::new("accuracy.variation", Number([1e-6, 1.0], ""), Accumulators, field!(Scene: accuracy.variation))
        .knob("", "change of opacity and shading above which a step is divided (segments, adaptive)").growing(|number| 10.0 * number),
    Key::new("shadows.spacing", Number([0.5, 64.0], "voxels"), Accumulators, field!(Scene: shadows.spacing))
        .knob("", "voxels between nodes of the light grid"),
    Key::new("shadows.directions", Whole([8, 1024], None), Accumulators, field!(Scene: shadows.directions))
        .knob("", "directions of the sky"),
    Key::new("scattering.spacing", NumberOr([0.05, 64.0], "auto"), Accumulators, Access {
        get: |it: &Scene| it.scattering.spacing.value().or(Some(Value::Name("auto"))),
        put: |it: &mut Scene, value| {
            if value.is_some() {
                it.scattering.spacing = f64::of(value);
            }
        },
    })
        .knob("", "voxels between places where scattered light is known"),
    Key::new("scattering.directions", Whole([2, 1024], Some("auto")), Accumulators, Access {
        get: |it: &Scene| it.scattering.directions.value().or(Some(Value::Name("auto"))),
        put: |it: &mut Scene, value| {
            if value.is_some() {
                it.scattering.directions = usize::of(value);
            }
        },
    })
        .knob("", "directions from which scattered light is gathered"),
    Key::new("accuracy.interpolation", names::<Interpolation>(), Nothing, field!(Scene: accuracy.interpolation))
        .knob("nearest,exact_linear,cubic", "interpolation between voxels"),
    Key::new("accuracy.labels", names::<LabelInterpolation>(), Nothing, field!(Scene: accuracy.labels))
        .knob("", "labels between voxels: shares of those around (smooth), or the nearest"),
    Key::new("accuracy.volume", names::<VolumeAs>(), Nothing, field!(Scene: accuracy.volume))
        .knob("f32", "format of the voxels on the device"),
    Key::new("accuracy.gradients", names::<Gradients>(), Nothing, field!(Scene: accuracy.gradients))
        .knob("central", "gradients for shading: stored (packed), or computed during the march (central)"),
    Key::new("transfer.entries", Whole([2, 1 << 20], None), Tables, field!(Scene: transfer.entries))
        .otherwise("depends on the data").knob("64,256,4096", "entries of the table of the transfer function"),
    Key::new("transfer.lookup", names::<Lookup>(), Nothing, field!(Scene: transfer.lookup))
        .knob("nearest", "table of the transfer function: interpolated (linear), or read at the nearest entry"),
    Key::new("accuracy.skipping", Switch, Nothing, field!(Scene: accuracy.skipping))
        .knob("off", "empty-space skipping, which changes times only"),
    Key::new("accuracy.voxel_pixels", Number([0.0, 64.0], "pixels"), Nothing, field!(Scene: accuracy.voxel_pixels))
        .knob("1,2,4", "largest voxel in the picture, in pixels, by a coarser level; 0: all voxels"),
    Key::new("accuracy.tolerance", Number([1e-3, 100.0], "ΔE00"), Tables, field!(Scene: accuracy.tolerance)),
    Key::new("shadows.method", names::<ShadowMethod>(), Nothing, field!(Scene: shadows.method)),
    Key::new("shadows.start", Number([0.0, 1000.0], "voxels"), Accumulators, field!(Scene: shadows.start))
        .otherwise("3, or 0 with shading = \"none\""),
    Key::new("shadows.ambient", names::<AmbientShares>(), Nothing, field!(Scene: shadows.ambient)),
    Key::new("shadows.reach", Number(POSITIVE, "world units"), Accumulators, field!(Scene: shadows.reach)).otherwise("no limit"),
    Key::new("scattering.orders", names::<Orders>(), Nothing, field!(Scene: scattering.orders)),
    Key::new("scattering.method", names::<ScatteringMethod>(), Nothing, field!(Scene: scattering.method)),
    Key::new("scattering.paths", Whole([1, 1 << 24], None), Accumulators, field!(Scene: scattering.paths)),
    Key::new("transfer.opacity_length", Number(POSITIVE, "world units"), Tables, field!(Scene: transfer.opacity_length))
        .otherwise("the smallest spacing"),
    Key::new("camera.fov", Number([0.001, 179.0], "degrees"), Accumulators,
        field!(Scene: camera.projection, Projection::Perspective { fov_degrees } => fov_degrees)),
    Key::new("camera.height", Number(POSITIVE, "world units"), Accumulators,
        field!(Scene: camera.projection, Projection::Orthographic { height } => height)).otherwise("from `fill`"),
    Key::new("camera.azimuth", Number(FINITE, "degrees"), Accumulators,
        field!(Scene: camera.aim, Aim::Orbit { azimuth, .. } => azimuth)),
    Key::new("camera.elevation", Number([-89.9, 89.9], "degrees"), Accumulators,
        field!(Scene: camera.aim, Aim::Orbit { elevation, .. } => elevation)),
    // By hand, as weights of lights: their products stay in the range of files.
    Key::new("display.exposure", NumberOr([0.0, LARGEST_EXPOSURE], "auto"), Picture, Access {
        get: |it: &Scene| it.display.exposure.value().or(Some(Value::Name("auto"))),
        put: |it: &mut Scene, value| {
            if value.is_some() {
                it.display.exposure = f64::of(value);
            }
        },
    })
        .offering([0.0, BRIGHTEST], false),
    Key::new("display.tone", names::<Tone>(), Picture, field!(Scene: display.tone)),
    Key::new("display.backdrop", names::<Backdrop>(), Picture, field!(Scene: display.backdrop)),
    Key::new("display.adapt", Switch, Picture, field!(Scene: display.adapt)),
    Key::new("display.observer", names::<Observer>(), Matrices, field!(Scene: display.observer)),
    Key::new("display.deficiency", names::<Deficiency>(), Picture, field!(Scene: display.deficiency))
        .otherwise("normal colour vision"),
];

/// The keys of a material.
#[rustfmt::skip]
pub const MATERIAL: &[Key<Material>] = &[
    Key::new("ambient", Number(UNIT, ""), Tables, field!(Material: ambient)),
    Key::new("diffuse", Number(UNIT, ""), Tables, field!(Material: diffuse)),
    Key::new("specular", Number(UNIT, ""), Tables, field!(Material: specular)),
    Key::new("exponent", Whole([1, 1024], None), Tables, field!(Material: exponent)),
    Key::new("occludes", Number(UNIT, ""), Tables, field!(Material: occludes)),
    Key::new("phase", Number([*PHASES.start(), *PHASES.end()], ""), Tables, field!(Material: phase)),
];

/// The keys of a light.
#[rustfmt::skip]
pub const LIGHT: &[Key<SceneLight>] = &[
    Key::new("intensity", Number([*INTENSITY.start(), *INTENSITY.end()], ""), Picture, field!(SceneLight: intensity)),
    Key::new("shadows", Switch, Tables, field!(SceneLight: shadows)),
];
