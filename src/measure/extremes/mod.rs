//! Extremes: scenes with very large, very small or missing inputs, checked on every rung.
//!
//! Each extreme is defined once: its scenes, its answer (a closed form, or the error where a limit is reached) and its
//! bound. The test `tests/render/stability.rs` and the command `relume measure --extremes` evaluate the same [`Row`]s.

mod bound;
mod half;
mod left;
mod lights;
mod materials;
mod models;
mod opacity;
mod rays;
mod sizes;
mod slab;
mod spectra;
mod steps;
mod table;
mod volumes;

use std::fmt;

use serde::{Serialize, Serializer};

use super::rungs::{RungError, Rungs};
use relume_base::progress::{Progress, unreported};
use relume_colour::spectrum::SpectrumError;
use relume_document::{SceneError, chain};
use relume_render::{RenderError, Renderer};
use relume_volume::VolumeError;

pub use bound::{BLACK_DELTA_E, Bound, EQUAL_STEPS, LINEARITY, OPACITY, ROUNDING_UNIT, TERMINATION_DELTA_E};

pub use spectra::metameric_black;
pub use table::{derivations, to_csv, to_markdown, to_text};

use left::Left;
use slab::Picture;

/// Input that an extreme stresses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Group {
    /// Opacities and optical depths.
    Opacity,
    /// Step lengths and numbers of steps.
    Steps,
    /// Intensities and spectra of lights.
    Lights,
    /// Unphysical reflectances.
    Spectra,
    /// Dimensions of a colour model.
    Models,
    /// Numbers and kinds of materials.
    Materials,
    /// Shapes and values of volumes.
    Volumes,
    /// Rays and cameras.
    Rays,
    /// Spacings, picture sizes and crop boxes.
    Sizes,
    /// Film stored as 16-bit floats.
    Half,
}

impl Group {
    /// All groups, in the order of the table.
    pub const ALL: [Self; 10] = [
        Self::Opacity,
        Self::Steps,
        Self::Lights,
        Self::Spectra,
        Self::Models,
        Self::Materials,
        Self::Volumes,
        Self::Rays,
        Self::Sizes,
        Self::Half,
    ];

    /// Extremes of the group.
    #[must_use]
    pub fn extremes(self) -> Vec<Extreme> {
        match self {
            Self::Opacity => opacity::extremes(),
            Self::Steps => steps::extremes(),
            Self::Lights => lights::extremes(),
            Self::Spectra => spectra::extremes(),
            Self::Models => models::extremes(),
            Self::Materials => materials::extremes(),
            Self::Volumes => volumes::extremes(),
            Self::Rays => rays::extremes(),
            Self::Sizes => sizes::extremes(),
            Self::Half => half::extremes(),
        }
    }

    /// Name in tables.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Opacity => "opacity and depth",
            Self::Steps => "steps",
            Self::Lights => "lights",
            Self::Spectra => "spectra",
            Self::Models => "colour models",
            Self::Materials => "materials",
            Self::Volumes => "volumes",
            Self::Rays => "rays and cameras",
            Self::Sizes => "sizes",
            Self::Half => "16 bits",
        }
    }
}

/// Renderer that gives an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Rung {
    /// The scene itself, in f64.
    #[serde(rename = "f64")]
    Double,
    /// The device's tables and volume, in f32.
    #[serde(rename = "f32")]
    Single,
    /// A device.
    #[serde(rename = "gpu")]
    Gpu,
    /// The planner, before any march.
    #[serde(rename = "plan")]
    Plan,
}

impl Rung {
    /// Name in tables.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Double => "f64",
            Self::Single => "f32",
            Self::Gpu => "GPU",
            Self::Plan => "plan",
        }
    }
}

impl fmt::Display for Rung {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.pad(self.name())
    }
}

/// Result of one extreme on one rung.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Group of the extreme.
    pub group: Group,
    /// Name of the extreme.
    pub name: String,
    /// Rung of the answer.
    pub rung: Rung,
    /// Largest allowed [`Self::measured`].
    #[serde(serialize_with = "finite")]
    pub bound: f64,
    /// Derivation of the bound.
    #[serde(serialize_with = "named")]
    pub derivation: Bound,
    /// Error of the answer; NaN without an answer.
    #[serde(serialize_with = "finite")]
    pub measured: f64,
    /// Whether the error is within its bound and the film is valid: finite, T in [0, 1], black without light.
    pub holds: bool,
    /// Message of the program, or the violation.
    pub said: Option<String>,
}

/// Serialises NaN and infinities as null, because JSON has no such numbers.
fn finite<S: Serializer>(number: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    Some(number).filter(|number| number.is_finite()).serialize(serializer)
}

fn named<S: Serializer>(bound: &Bound, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(bound.name)
}

impl fmt::Display for Row {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, rung, bound, measured, derivation, holds, .. } = self;
        let sign = if *holds { "≤" } else { "is not ≤" };
        write!(out, "{name}, {rung}: {measured:.2e} {sign} {bound:.2e} ({})", derivation.name)?;
        self.said.as_ref().map_or(Ok(()), |said| write!(out, ": {said}"))
    }
}

/// Error that leaves an extreme without an answer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExtremeError {
    /// Invalid scene.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// Invalid volume.
    #[error(transparent)]
    Volume(#[from] VolumeError),
    /// Invalid spectrum.
    #[error(transparent)]
    Spectrum(#[from] SpectrumError),
    /// Failure of a rung.
    #[error(transparent)]
    Rung(#[from] RungError),
}

impl ExtremeError {
    /// Name for programs; it does not change between versions.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Scene(error) => error.code(),
            Self::Volume(error) => error.code(),
            Self::Spectrum(error) => error.code(),
            Self::Rung(error) => error.code(),
        }
    }

    /// Whether a device is too small for the scene, which counts as an answer.
    fn is_limit(&self) -> bool {
        use RenderError::{Bricked, Filter, PictureMemory, PictureSize, Slot};
        let Self::Rung(RungError::Render(error)) = self else { return false };
        matches!(error, Filter { .. } | Bricked { .. } | PictureMemory { .. } | PictureSize { .. } | Slot { .. })
    }
}

/// Answer of one rung.
struct Answer {
    rung: Rung,
    measured: f64,
    said: Option<String>,
}

/// Evaluates an extreme, on a device if one is given.
type Ask = dyn Fn(Option<&Renderer>, &dyn Progress) -> Result<Vec<Answer>, ExtremeError> + Send + Sync;

/// One extreme.
pub struct Extreme {
    group: Group,
    name: String,
    bound: Bound,
    ask: Box<Ask>,
}

impl fmt::Debug for Extreme {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { group, name, bound, .. } = self;
        out.debug_struct("Extreme")
            .field("group", group)
            .field("name", name)
            .field("bound", bound)
            .finish_non_exhaustive()
    }
}

impl Extreme {
    /// Returns an extreme that renders `pictures` on every rung; `measure` returns the error of the results.
    fn shown(
        group: Group,
        name: impl Into<String>,
        bound: Bound,
        pictures: impl Fn() -> Result<Vec<Picture>, ExtremeError> + Send + Sync + 'static,
        measure: impl Fn(&[Left<'_>]) -> f64 + Send + Sync + 'static,
    ) -> Self {
        let ask = move |renderer: Option<&Renderer>, progress: &dyn Progress| {
            let pictures: Vec<_> = pictures()?.into_iter().map(Picture::rungs).collect::<Result<_, _>>()?;
            let rungs = [Rung::Double, Rung::Single].into_iter().chain(renderer.map(|_| Rung::Gpu));
            let answers = rungs.map(|rung| {
                let lefts = pictures.iter().map(|picture| Left::new(picture, rung, renderer, progress));
                let lefts: Vec<_> = match lefts.collect::<Result<_, _>>() {
                    Err(error) if error.is_limit() => {
                        return Ok(Answer { rung, measured: 0.0, said: Some(chain(&error)) });
                    }
                    lefts => lefts?,
                };
                let said = lefts.iter().find_map(Left::problem);
                let measured = if said.is_some() { f64::NAN } else { measure(&lefts) };
                Ok(Answer { rung, measured, said })
            });
            answers.collect()
        };
        Self { group, name: name.into(), bound, ask: Box::new(ask) }
    }

    /// Returns an extreme that the program must refuse with an error for which `expected` returns true.
    fn refused(
        group: Group,
        name: impl Into<String>,
        picture: impl Fn() -> Result<Picture, ExtremeError> + Send + Sync + 'static,
        expected: impl Fn(&ExtremeError) -> bool + Send + Sync + 'static,
    ) -> Self {
        let bound = Bound::given("refused", 0.0, "number of times that the program did not refuse with a reason");
        let ask = move |_: Option<&Renderer>, progress: &dyn Progress| {
            let marched = |rungs: Rungs| Left::new(&rungs, Rung::Double, None, progress).map(drop);
            match picture().and_then(Picture::rungs).and_then(marched) {
                Err(error) if expected(&error) => {
                    Ok(vec![Answer { rung: Rung::Plan, measured: 0.0, said: Some(chain(&error)) }])
                }
                Err(error) => Err(error),
                Ok(()) => Ok(vec![Answer { rung: Rung::Plan, measured: 1.0, said: None }]),
            }
        };
        Self { group, name: name.into(), bound, ask: Box::new(ask) }
    }

    /// Group of the extreme.
    #[must_use]
    pub fn group(&self) -> Group {
        self.group
    }

    /// Name of the extreme.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Error bound of the extreme.
    #[must_use]
    pub fn bound(&self) -> Bound {
        self.bound
    }

    /// Returns one row per rung, with a device row only if `renderer` is given. Without an answer, a single row holds
    /// the error.
    #[must_use]
    pub fn rows(&self, renderer: Option<&Renderer>, progress: &dyn Progress) -> Vec<Row> {
        let none =
            |error: ExtremeError| vec![Answer { rung: Rung::Plan, measured: f64::NAN, said: Some(chain(&error)) }];
        let answers = (self.ask)(renderer, progress).unwrap_or_else(none);
        let row = |Answer { rung, measured, said }| {
            let bound = self.bound.limit(rung);
            Row {
                group: self.group,
                name: self.name.clone(),
                rung,
                bound,
                derivation: self.bound,
                measured,
                holds: measured <= bound,
                said,
            }
        };
        answers.into_iter().map(row).collect()
    }
}

/// Returns the rows of all extremes in the order of the groups, and whether the run is complete. A cancelled run keeps
/// the rows of the finished extremes.
#[must_use]
pub fn run(renderer: Option<&Renderer>, progress: &dyn Progress) -> (Vec<Row>, bool) {
    let extremes: Vec<Extreme> = Group::ALL.into_iter().flat_map(Group::extremes).collect();
    let mut rows = Vec::new();
    for (done, extreme) in extremes.iter().enumerate() {
        progress.report(extreme.group().name(), done as u64, extremes.len() as u64);
        let found = extreme.rows(renderer, &unreported(progress));
        if progress.cancelled() {
            return (rows, false);
        }
        rows.extend(found);
    }
    (rows, true)
}
