//! TOML text of a film file.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::rules::{check_dimension, check_finite};
use super::{BANDS, Component, Components, Dial, FRAME, FilmFile, FilmPart, Frame, Light, Position, Stored};
use relume_colour::model::{ErrorSummary, LightMatrix, ModelKind};
use relume_colour::spectrum::observer::Observer;
use relume_colour::spectrum::{Light as LightSpectrum, Spectrum};
use relume_scene::key::Named;
use relume_scene::{LightKind, Placement};
use relume_volume::Unit;

/// Version of files with material weights.
const WEIGHTS: i64 = 1;

/// Version of files with a colour model.
const MODEL: i64 = 2;

/// Version of files with a colour model and spectra outside its fit.
const CHECKED: i64 = 3;

/// Largest magnitude in a projection. Those of fits are below a hundred; huge ones would overflow in a fit.
const LARGEST_SHARE: f64 = 1e9;

/// Text of the attribute as TOML.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    version: i64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    part: Option<FilmPart>,
    #[serde(default = "Exposure::usual")]
    exposure: Exposure,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    tone: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    backdrop: Option<String>,
    #[serde(default)]
    adapt: bool,
    #[serde(default, skip_serializing_if = "is_usual")]
    observer: Observer,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    background: Option<Vec<f64>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    model: Option<ModelEntry>,
    #[serde(default)]
    components: Vec<ComponentEntry>,
    #[serde(default)]
    positions: Vec<PositionEntry>,
    #[serde(default)]
    lights: Vec<LightEntry>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    dial: Option<Dial>,
}

/// Version of a text; the only key read of unknown versions.
#[derive(Deserialize)]
struct VersionOnly {
    version: i64,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ModelEntry {
    kind: ModelKind,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    description: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    nodes_nm: Option<Vec<f64>>,
    transmittance: TransmittanceKind,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    mixed: bool,
    #[serde(default = "one")]
    tolerance: f64,
    projection: Vec<Vec<f64>>,
}

#[derive(Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum TransmittanceKind {
    Grey,
    Coloured,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ComponentEntry {
    name: String,
    spectrum: Vec<f64>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PositionEntry {
    name: String,
    kind: LightKind,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    vector: Option<[f64; 3]>,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    shadows: bool,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct LightEntry {
    name: String,
    position: String,
    weight: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    shown: Option<f64>,
    spectrum: Vec<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    matrix: Option<Vec<[f64; 3]>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    error: Option<ErrorSummary>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    unseen: Option<ErrorSummary>,
}

/// Default tolerance.
fn one() -> f64 {
    1.0
}

/// The name of a choice, if it is not the default.
fn stated<N: Named + Default>(choice: N) -> Option<String> {
    (choice != N::default()).then(|| choice.name().to_owned())
}

/// The choice of a key by its name.
fn chosen<N: Named + Default>(key: &str, name: Option<String>) -> Result<N, String> {
    let Some(name) = name else { return Ok(N::default()) };
    N::of_name(&name).ok_or_else(|| format!("unknown {key} {name:?}"))
}

/// Exposure as a number, or a word.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Exposure {
    Factor(f64),
    Word(String),
}

/// The word of an automatic exposure.
const AUTO: &str = "auto";

impl Exposure {
    fn usual() -> Self {
        Self::Factor(1.0)
    }

    fn read(&self, is_part: bool) -> Result<Option<f64>, String> {
        match self {
            Self::Factor(factor) => Ok(Some(*factor)),
            Self::Word(word) if word == AUTO && is_part => Ok(None),
            Self::Word(word) if word == AUTO => Err("only a part may have an exposure of \"auto\"".to_owned()),
            Self::Word(word) => Err(format!("the exposure {word:?} is neither a number nor \"auto\"")),
        }
    }
}

/// Whether this is the default observer.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_usual(observer: &Observer) -> bool {
    *observer == Observer::default()
}

/// Writes the text of `accumulators`.
pub(super) fn written(accumulators: &FilmFile) -> Result<String, String> {
    toml::to_string(&Document::from(accumulators)).map_err(|error| error.to_string())
}

/// The text of the attribute with scale and orientation.
pub(super) fn written_frame(frame: &Frame) -> Result<String, String> {
    check_frame(frame)?;
    toml::to_string(frame).map_err(|error| error.to_string())
}

/// Parses the text of the attribute with scale and orientation.
pub(super) fn parse_frame(text: &str) -> Result<Frame, String> {
    let frame = toml::from_str(text).map_err(|error| format!("{FRAME}: {}", error.message()))?;
    check_frame(&frame).map(|()| frame)
}

/// Refuses lengths, units and letters that no picture has.
fn check_frame(frame: &Frame) -> Result<(), String> {
    const LETTERS: &str = "LRAPSI";
    if let Some(pixel) = frame.pixel.filter(|pixel| !(*pixel > 0.0 && pixel.is_finite())) {
        return Err(format!("{FRAME}: pixel = {pixel} should be above 0 and finite"));
    }
    if let Some(unit) = frame.unit.as_ref().filter(|unit| Unit::named(unit).is_none()) {
        return Err(format!("{FRAME}: the unit {unit:?} is unknown; the units are cm, mm, µm, nm and Å"));
    }
    let is_odd = |text: &&String| text.chars().count() > 3 || !text.chars().all(|letter| LETTERS.contains(letter));
    match frame.edges.iter().flatten().find(is_odd) {
        Some(text) => Err(format!("{FRAME}: the edge {text:?} should be at most three of the letters {LETTERS}")),
        None => Ok(()),
    }
}

impl From<&FilmFile> for Document {
    fn from(accumulators: &FilmFile) -> Self {
        let (surfaces, stored) = match &accumulators.components {
            Components::Surfaces(surfaces) => (surfaces.as_slice(), None),
            Components::Model(stored) => (&[][..], Some(stored)),
        };
        let component = |component: &Component| ComponentEntry {
            name: component.name.clone(),
            spectrum: component.spectrum.to_vec(),
        };
        let position = |Position { name, placement, shadows }: &Position| PositionEntry {
            name: name.clone(),
            kind: placement.kind(),
            vector: placement.vector().map(|vector| vector.to_array()),
            shadows: *shadows,
        };
        let light = |light: &Light| {
            let spectrum = Spectrum::from_samples(light.spectrum);
            let mut known = stored.iter().flat_map(|stored| stored.model.lights());
            let matrix = known.find(|(_, known, _)| *known.spectrum() == spectrum).map(|(.., matrix)| matrix);
            LightEntry {
                name: light.name.clone(),
                position: accumulators.positions[light.position].name.clone(),
                weight: light.weight,
                shown: light.shown,
                spectrum: light.spectrum.to_vec(),
                matrix: matrix.map(|matrix| matrix.xyz.clone()),
                error: matrix.map(|matrix| matrix.error),
                unseen: matrix.and_then(|matrix| matrix.unseen),
            }
        };
        let model = |stored: &Stored| ModelEntry {
            kind: stored.model.kind(),
            description: Some(stored.model.description()),
            nodes_nm: stored.model.nodes_nm(),
            transmittance: if stored.coloured { TransmittanceKind::Coloured } else { TransmittanceKind::Grey },
            mixed: stored.model.is_mixed() && !stored.model.unseen().spectra.is_empty(),
            tolerance: stored.tolerance,
            projection: stored.model.projection().iter().map(|row| row.samples().to_vec()).collect(),
        };
        Self {
            version: if accumulators.part.is_some() { CHECKED } else { 0 }
                + match stored {
                    None => WEIGHTS,
                    Some(stored) if stored.model.unseen().spectra.is_empty() => MODEL,
                    Some(_) => CHECKED,
                },
            part: accumulators.part.clone(),
            exposure: accumulators.exposure.map_or_else(|| Exposure::Word(AUTO.to_owned()), Exposure::Factor),
            tone: stated(accumulators.tone),
            backdrop: stated(accumulators.backdrop),
            adapt: accumulators.adapt,
            observer: accumulators.observer,
            background: accumulators.background.map(|background| background.to_vec()),
            model: stored.map(model),
            components: surfaces.iter().map(component).collect(),
            positions: accumulators.positions.iter().map(position).collect(),
            lights: accumulators.lights.iter().map(light).collect(),
            dial: accumulators.dial.clone(),
        }
    }
}

/// Colour model without the spectra of its fit.
pub(super) struct ModelDraft {
    pub(super) kind: ModelKind,
    pub(super) observer: Observer,
    pub(super) coloured: bool,
    /// Whether the file has spectra outside the fit.
    pub(super) has_unseen: bool,
    /// Whether errors include sums of spectra under several lights.
    pub(super) mixed: bool,
    pub(super) tolerance: f64,
    pub(super) projection: Vec<Spectrum>,
    /// The file's lights that have a matrix.
    pub(super) lights: Vec<(String, LightSpectrum, LightMatrix)>,
}

/// Parses `text` to a film file without pixels. With a colour model, the components are left empty.
pub(super) fn parse(text: &str) -> Result<(FilmFile, Option<ModelDraft>), String> {
    let located = |error: toml::de::Error| match error.span().and_then(|span| text.get(..span.start)) {
        Some(before) => format!("line {}: {}", before.matches('\n').count() + 1, error.message()),
        None => error.message().to_owned(),
    };
    let VersionOnly { version } = toml::from_str(text).map_err(located)?;
    if !(WEIGHTS..=2 * CHECKED).contains(&version) {
        let last = 2 * CHECKED;
        return Err(format!("unknown version {version}; this program reads the versions {WEIGHTS} to {last}"));
    }
    let mut document: Document = toml::from_str(text).map_err(located)?;
    match (&document.part, version > CHECKED) {
        (Some(part), true) => part.check()?,
        (None, false) => {}
        (Some(_), false) => return Err(format!("a file with a `[part]` needs a version above {CHECKED}")),
        (None, true) => return Err(format!("a file of version {version} needs a `[part]`")),
    }
    // Versions of parts follow those of films.
    let version = if version > CHECKED { version - CHECKED } else { version };
    match (version, &document.model) {
        (WEIGHTS, Some(_)) => return Err(format!("a file with a `[model]` needs the version {MODEL} or {CHECKED}")),
        (MODEL | CHECKED, None) => return Err(format!("a file of version {version} needs a `[model]`")),
        (MODEL | CHECKED, Some(_)) if !document.components.is_empty() => {
            return Err("a file with a `[model]` cannot have `[[components]]`".to_owned());
        }
        _ => {}
    }
    let component = |entry: ComponentEntry| {
        let spectrum = bands(&format!("the component {:?}", entry.name), entry.spectrum)?;
        Ok(Component { name: entry.name, spectrum })
    };
    let model = document
        .model
        .take()
        .map(|entry| model_draft(entry, document.observer, &document.lights, version == CHECKED))
        .transpose()?;
    if let Some(light) = document.lights.iter().find(|light| model.is_none() && light.has_matrix()) {
        return Err(format!("the light {:?} has a matrix, but the file has no `[model]`", light.name));
    }
    let components = document.components.into_iter().map(component).collect::<Result<_, String>>()?;
    let positions = document.positions.into_iter().map(position).collect::<Result<Vec<_>, String>>()?;
    let light = |entry: LightEntry| {
        let spectrum = bands(&format!("the light {:?}", entry.name), entry.spectrum)?;
        let Some(position) = positions.iter().position(|position| position.name == entry.position) else {
            return Err(format!(
                "the light {:?} is at the position {:?}, which is not listed",
                entry.name, entry.position
            ));
        };
        Ok(Light { name: entry.name, position, weight: entry.weight, shown: entry.shown, spectrum })
    };
    let lights = document.lights.into_iter().map(light).collect::<Result<_, String>>()?;
    let background = document.background.map(|spectrum| bands("`background`", spectrum)).transpose()?;
    let Document { exposure, tone, backdrop, adapt, observer, dial, part, .. } = document;
    let exposure = exposure.read(part.is_some())?;
    let (tone, backdrop) = (chosen("tone", tone)?, chosen("backdrop", backdrop)?);
    let accumulators = FilmFile {
        positions,
        lights,
        background,
        exposure,
        tone,
        backdrop,
        adapt,
        observer,
        dial,
        part,
        ..FilmFile::empty([0, 0], Components::Surfaces(components))
    };
    Ok((accumulators, model))
}

impl LightEntry {
    fn has_matrix(&self) -> bool {
        self.matrix.is_some() || self.error.is_some() || self.unseen.is_some()
    }
}

/// Converts the spectrum of `owner` to samples.
fn bands(owner: &str, spectrum: Vec<f64>) -> Result<[f64; BANDS], String> {
    <[f64; BANDS]>::try_from(spectrum)
        .map_err(|spectrum| format!("{owner} has {} numbers; a spectrum has {BANDS}", spectrum.len()))
}

fn position(entry: PositionEntry) -> Result<Position, String> {
    let placement = Placement::of(entry.kind, entry.vector.map(DVec3::from_array)).ok_or_else(|| {
        let name = &entry.name;
        match entry.vector {
            Some(_) => format!("the position {name:?} has a `vector`, but its kind has none"),
            None => format!("the position {name:?} needs a `vector` of three numbers"),
        }
    })?;
    Ok(Position { name: entry.name, placement, shadows: entry.shadows })
}

/// Builds the model of `entry` with the matrices of `lights`; `has_unseen` adds spectra outside the fit.
fn model_draft(
    entry: ModelEntry,
    observer: Observer,
    lights: &[LightEntry],
    has_unseen: bool,
) -> Result<ModelDraft, String> {
    check_dimension(entry.projection.len())?;
    check_finite("", "tolerance", &[entry.tolerance])?;
    let dimension = entry.projection.len();
    let row = |(index, row): (usize, Vec<f64>)| {
        let samples = bands(&format!("row {index} of `projection`"), row)?;
        check_finite("", "projection", &samples)?;
        if let Some(sample) = samples.iter().find(|sample| sample.abs() > LARGEST_SHARE) {
            return Err(format!("row {index} of `projection` holds {sample:e}, which is beyond ±{LARGEST_SHARE:e}"));
        }
        Ok(Spectrum::from_samples(samples))
    };
    let projection = entry.projection.into_iter().enumerate().map(row).collect::<Result<_, String>>()?;
    let matrix = |light: &LightEntry| -> Result<Option<(String, LightSpectrum, LightMatrix)>, String> {
        let name = &light.name;
        let (Some(xyz), Some(error)) = (&light.matrix, light.error) else {
            return match light.has_matrix() {
                true => Err(format!("the light {name:?} needs both `matrix` and `error`, or neither")),
                false => Ok(None),
            };
        };
        if xyz.len() != dimension {
            return Err(format!("the matrix of the light {name:?} has {} columns, not {dimension}", xyz.len()));
        }
        check_finite("the matrix of the light ", name, xyz.as_flattened())?;
        for error in [Some(error), light.unseen].into_iter().flatten() {
            check_finite("the error of the light ", name, &[error.mean, error.p95, error.max])?;
        }
        let samples = bands(&format!("the light {name:?}"), light.spectrum.clone())?;
        let spectrum = LightSpectrum::new(Spectrum::from_samples(samples)).map_err(|error| error.to_string())?;
        Ok(Some((name.clone(), spectrum, LightMatrix { xyz: xyz.clone(), error, unseen: light.unseen })))
    };
    let lights = lights.iter().filter_map(|light| matrix(light).transpose()).collect::<Result<_, String>>()?;
    let coloured = entry.transmittance == TransmittanceKind::Coloured;
    Ok(ModelDraft {
        kind: entry.kind,
        observer,
        coloured,
        has_unseen,
        mixed: entry.mixed,
        tolerance: entry.tolerance,
        projection,
        lights,
    })
}
