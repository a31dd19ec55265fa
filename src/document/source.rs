//! Opens a scene file, or a volume with a default scene around it.

use std::path::{Path, PathBuf};

use super::moves::{Move, Side, moved};
use super::presets::{OPACITIES, of_window};
use super::{Definition, SceneError, SceneFile, SceneOptions, load, load_embedded, parse};
use crate::number::count;
use crate::progress::{Progress, Quiet};
use crate::scene::{Interval, Term};
use crate::volume::{self, Geometry, RawLayout, Selection, Several, Statistics, VolumeError, has_header, is_volume};

/// The scene around a volume without a scene.
const AROUND: &str = include_str!("../../data/scenes/volume.toml");

/// A file to open, with options.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Source {
    /// Scene file or volume; `None` is the scene embedded in the program.
    pub path: Option<PathBuf>,
    /// Changes by the command line.
    pub options: SceneOptions,
}

/// Why a source cannot be opened.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OpenError {
    /// An error of the scene.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// An error of the volume.
    #[error(transparent)]
    Volume(#[from] VolumeError),
}

/// Information that is missing to read a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Question {
    /// The file.
    pub file: PathBuf,
    /// The missing information.
    pub unknown: Unknown,
}

/// Information that a file does not contain.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Unknown {
    /// The choice among several volumes.
    Which(Several),
    /// The voxel layout of a headerless file.
    Layout {
        /// Size of the file in bytes.
        bytes: u64,
        /// Layout suggested by the file's name and size, if any.
        guess: Option<Box<RawLayout>>,
    },
}

impl OpenError {
    /// Name for programs; it does not change between versions.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Scene(error) => error.code(),
            Self::Volume(error) => error.code(),
        }
    }

    /// The missing information, if nothing else prevents opening.
    #[must_use]
    pub fn question(&self) -> Option<Question> {
        let (file, unknown) = match self {
            Self::Volume(VolumeError::NoLayout { path, bytes, guess, .. }) => {
                (path.clone(), Unknown::Layout { bytes: *bytes, guess: guess.clone() })
            }
            // The scene may answer this, or the user.
            Self::Volume(VolumeError::Choose { source_name, there })
            | Self::Scene(SceneError::Volume { source: VolumeError::Choose { source_name, there }, .. }) => {
                (source_name.into(), Unknown::Which(there.clone()))
            }
            _ => return None,
        };
        Some(Question { file, unknown })
    }

    /// The scene without a volume, and whether it names a volume that cannot be opened.
    #[must_use]
    pub fn scene_without_volume(&self) -> Option<(&Path, bool)> {
        match self {
            Self::Scene(SceneError::NoVolume { scene }) => Some((Path::new(scene), false)),
            Self::Scene(SceneError::Volume { scene, source: VolumeError::Open { .. } }) => {
                Some((Path::new(scene), true))
            }
            _ => None,
        }
    }
}

impl Source {
    /// The file at `path`, without options.
    #[must_use]
    pub fn of(path: &Path) -> Self {
        Self { path: Some(path.to_owned()), options: SceneOptions::default() }
    }

    /// The same source; a volume of the options without a scene file is opened as a volume without a scene.
    #[must_use]
    pub fn or_its_volume(self) -> Self {
        let options = SceneOptions { volume: None, ..self.options.clone() };
        let alone = Self { path: self.options.volume.clone(), options };
        if self.path.is_none() && alone.bare_volume().is_some() { alone } else { self }
    }

    /// The same source with the volume at `path`. If the scene names a volume (`is_named`), which was moved, `path`
    /// replaces its name, and the scene's other keys for the volume and its labels still hold.
    #[must_use]
    pub fn with_volume(mut self, path: &Path, is_named: bool) -> Self {
        let name = path.to_str().filter(|_| is_named && self.options.volume.is_none());
        match name {
            Some(name) => {
                let text = format!("volume.file={}", toml_edit::value(name).to_string().trim());
                self.options.definitions.push(Definition::new(&text));
            }
            None => self.options.volume = Some(path.to_owned()),
        }
        self
    }

    /// The same source with an open choice among the volumes of its file.
    #[must_use]
    pub fn reselected(&self) -> Self {
        let options =
            SceneOptions { selection: Selection { asks: true, ..Selection::default() }, ..self.options.clone() };
        Self { options, ..self.clone() }
    }

    /// Whether this was [`Self::reselected`] from `other`, and so may be another volume of its file.
    #[must_use]
    pub fn is_another_of(&self, other: &Self) -> bool {
        self.options.selection.asks && self.reselected() == other.reselected()
    }

    /// Window title: the file and the selected volume.
    #[must_use]
    pub fn title(&self, Selection { component, time, array, .. }: &Selection) -> String {
        let file = self.path.as_ref().and_then(|path| path.file_name());
        let name = file.map_or_else(|| self.name(), |file| file.to_string_lossy().into_owned());
        let numbers = [("component", component), ("time", time)];
        let numbers = numbers.map(|(name, number)| number.map(|number| format!("{name} {number}")));
        let of_it: Vec<String> = array.iter().cloned().chain(numbers.into_iter().flatten()).collect();
        if of_it.is_empty() {
            format!("{name} — Relume")
        } else {
            format!("{name} ({}) — Relume", of_it.join(", "))
        }
    }

    /// Display name.
    #[must_use]
    pub fn name(&self) -> String {
        self.path.as_ref().map_or_else(|| "the default scene".to_owned(), |path| path.display().to_string())
    }

    /// The path, if it is a volume and not a scene.
    #[must_use]
    pub fn bare_volume(&self) -> Option<&Path> {
        self.path.as_deref().filter(|path| is_volume(path, &[]) || has_header(path))
    }

    /// Reads the scene. A volume without a scene gets a transfer function from the first window of its file, or else from
    /// its histogram.
    ///
    /// # Errors
    ///
    /// [`SceneError`], [`VolumeError`].
    pub fn read(&self, progress: &dyn Progress) -> Result<(SceneFile, Statistics), OpenError> {
        let without_scene = self.bare_volume();
        let mut file = match (&self.path, without_scene) {
            (None, _) => load_embedded(&self.options, progress)?,
            (_, Some(volume)) => {
                let options = SceneOptions { volume: Some(volume.to_owned()), ..self.options.clone() };
                match parse(&volume.display().to_string(), AROUND, Path::new(""), &options, progress) {
                    // The file is the volume itself, so the error needs no scene.
                    Err(SceneError::Volume { source, .. }) => return Err(source.into()),
                    parsed => parsed?,
                }
            }
            (Some(path), None) => load(path, &self.options, progress).map_err(|error| no_scene(path, error))?,
        };
        let scene = &mut file.scene;
        let statistics = scene.volume.statistics()?;
        if without_scene.is_some() {
            let window = scene.volume.presets.windows.first();
            let layers = window.and_then(|window| of_window(window, &statistics, &scene.materials));
            scene.transfer.terms = match layers {
                Some(layers) => layers.iter().map(term).collect(),
                None => terms(&statistics, scene.materials.len()),
            };
            scene.transfer.opacity_length *= thickness(&scene.volume.geometry);
            // Patients stand upright and face the viewer.
            let patient = scene.volume.anatomical.then_some(Side::Front);
            if let Some(side) = flat_side(&scene.volume.geometry).or(patient) {
                scene.camera = moved(&scene.camera, &scene.camera, &scene.volume.geometry, 1.0, Move::Axis(side));
            }
        }
        Ok((file, statistics))
    }
}

/// Error for the file `path`, which is not readable as a scene. A file that is not text, or too long for a scene, is
/// reported as a volume of unknown format.
fn no_scene(path: &Path, error: SceneError) -> OpenError {
    let is_all_of_it =
        matches!(error, SceneError::IsVolume { .. } | SceneError::TooLong { .. } | SceneError::NoText { .. });
    match volume::open(path, &Selection::default(), &Quiet) {
        Err(unknown @ VolumeError::UnknownFormat { .. }) if is_all_of_it => unknown.into(),
        _ => error.into(),
    }
}

/// Depth in voxels of an object for which [`OPACITIES`] are suitable.
const DEPTH: f64 = 100.0;
/// Ratio of largest to smallest extent from which a volume is viewed as a sheet.
const FLAT: f64 = 20.0;

/// Factor of the opacity length: below 1 for a thin volume, so that a single slice occludes as much as a thick volume.
fn thickness(geometry: &Geometry) -> f64 {
    let depth = geometry.extent().min_element() / geometry.spacing.min_element();
    (depth / DEPTH).min(1.0)
}

/// Side from which a sheet is viewed; slices along z appear as on a screen.
fn flat_side(geometry: &Geometry) -> Option<Side> {
    let extent = geometry.extent();
    let thin = extent.min_position();
    let normal = geometry.direction.col(thin).abs().max_position();
    (extent.max_element() >= FLAT * extent[thin]).then(|| [Side::Left, Side::Front, Side::Bottom][normal])
}

/// The term of an interval.
fn term(interval: &Interval) -> Term {
    let Interval { material, range, ramp, opacity, absorption } = *interval;
    Term::interval(material, range, [ramp; 2], opacity, absorption)
}

/// Initial transfer function. Omits the surroundings, and cuts the other values into ranges of about equal weight; the
/// weight of a value is the logarithm of its frequency.
fn terms(statistics: &Statistics, materials: usize) -> Vec<Term> {
    let bins = &statistics.histogram;
    let width = (statistics.max - statistics.min) / count(bins.len());
    if width <= 0.0 || !width.is_finite() {
        return vec![Term::interval(0, [statistics.min, statistics.max], [0.0; 2], OPACITIES[1], 0.0)];
    }
    let edge = |bin: usize| statistics.min + width * count(bin);
    let first = threshold(bins);
    let weight = |bin: usize| bins.get(bin).map_or(0.0, |&n| count(usize::try_from(n).unwrap_or(usize::MAX)).ln_1p());
    let total: f64 = (first..bins.len()).map(weight).sum();
    let ranges = materials.clamp(1, OPACITIES.len());
    let mut cuts = vec![first];
    let mut sum = 0.0;
    for bin in first..bins.len() {
        sum += weight(bin);
        if sum >= total * count(cuts.len()) / count(ranges) && cuts.len() < ranges && bin + 1 < bins.len() {
            cuts.push(bin + 1);
        }
    }
    cuts.push(bins.len());
    let term = |(material, cut): (usize, &[usize])| {
        let [low, high] = [edge(cut[0]), edge(cut[1])];
        let ramp = (high - low).min(4.0 * width) / 2.0;
        let opacity = OPACITIES.get(material).copied().unwrap_or(OPACITIES[1]);
        Term::interval(material, [low + ramp / 2.0, high - ramp / 2.0], [ramp; 2], opacity, 0.0)
    };
    cuts.windows(2).enumerate().map(term).collect()
}

/// First histogram bin of objects as opposed to their surroundings: the cut into two classes with the largest variance
/// between them (Otsu 1979).
pub(crate) fn threshold(bins: &[u64]) -> usize {
    let weight = |&n: &u64| count(usize::try_from(n).unwrap_or(usize::MAX));
    let total: f64 = bins.iter().map(weight).sum();
    let moment: f64 = bins.iter().enumerate().map(|(bin, n)| count(bin) * weight(n)).sum();
    let (mut below, mut moment_below, mut best) = (0.0, 0.0, (0.0, 1));
    for (bin, n) in bins.iter().enumerate() {
        below += weight(n);
        moment_below += count(bin) * weight(n);
        let above = total - below;
        if below > 0.0 && above > 0.0 {
            let apart = moment_below / below - (moment - moment_below) / above;
            let between = below * above * apart * apart;
            if between > best.0 {
                best = (between, bin + 1);
            }
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_is_called_by_the_file_that_it_shows() {
        let title = |file: &str, chosen: &Selection| Source::of(Path::new(file)).title(chosen);
        let all = Selection::default();
        assert_eq!(title("data/stained_frog.toml", &all), "stained_frog.toml — Relume");
        assert_eq!(Source::default().title(&all), "the default scene — Relume");
        let chosen = Selection { time: Some(3), array: Some("ct".to_owned()), ..Selection::default() };
        assert_eq!(title("beat.nrrd", &chosen), "beat.nrrd (ct, time 3) — Relume");
    }
}
