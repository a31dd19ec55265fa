//! What is opened: a scene file, or a volume that gets a scene of its own.

use std::path::{Path, PathBuf};

use super::moves::{Move, Side, moved};
use super::{Definition, SceneError, SceneFile, SceneOptions, load, load_embedded, parse};
use crate::number::count;
use crate::progress::{Progress, Quiet};
use crate::scene::Term;
use crate::volume::{self, Geometry, RawLayout, Selection, Several, Statistics, VolumeError, has_header, is_volume};

/// The scene around a volume that has none.
const AROUND: &str = include_str!("../../data/scenes/volume.toml");

/// What to open.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Source {
    /// A scene file or a volume; without one, the scene that is part of the program.
    pub path: Option<PathBuf>,
    /// What is changed about it.
    pub options: SceneOptions,
}

/// Why something cannot be opened.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OpenError {
    /// The scene.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// Its volume.
    #[error(transparent)]
    Volume(#[from] VolumeError),
}

/// What has to be said before a file can be read.
#[derive(Clone, Debug, PartialEq)]
pub struct Question {
    /// The file.
    pub file: PathBuf,
    /// What of it is not known.
    pub unknown: Unknown,
}

/// What a file does not say itself.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Unknown {
    /// Which of several volumes is meant.
    Which(Several),
    /// How the voxels of a file without a header lie.
    Layout {
        /// Bytes of the file.
        bytes: u64,
        /// What its name and its size suggest, where they do.
        guess: Option<Box<RawLayout>>,
    },
}

impl OpenError {
    /// What would have to be said for it to be opened, where that is all.
    #[must_use]
    pub fn question(&self) -> Option<Question> {
        let (file, unknown) = match self {
            Self::Volume(VolumeError::NoLayout { path, bytes, guess, .. }) => {
                (path.clone(), Unknown::Layout { bytes: *bytes, guess: guess.clone() })
            }
            // A scene may say it too, or whoever opens it.
            Self::Volume(VolumeError::Choose { source_name, there })
            | Self::Scene(SceneError::Volume { source: VolumeError::Choose { source_name, there }, .. }) => {
                (source_name.into(), Unknown::Which(there.clone()))
            }
            _ => return None,
        };
        Some(Question { file, unknown })
    }

    /// The scene that has no volume, and whether it names one, which is not there.
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
    /// What is at `path`, unchanged.
    #[must_use]
    pub fn of(path: &Path) -> Self {
        Self { path: Some(path.to_owned()), options: SceneOptions::default() }
    }

    /// The same, but for a volume that is to be shown in no scene that is named: that is opened as one that has none.
    #[must_use]
    pub fn or_its_volume(self) -> Self {
        let options = SceneOptions { volume: None, ..self.options.clone() };
        let alone = Self { path: self.options.volume.clone(), options };
        if self.path.is_none() && alone.bare_volume().is_some() { alone } else { self }
    }

    /// The same with the volume at `path`: where the scene names one, in the place of that file, which was moved; what the scene
    /// says of it, its labels too, still holds.
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

    /// The same where it is yet to be said which of the volumes in its file is meant.
    #[must_use]
    pub fn reselected(&self) -> Self {
        let options =
            SceneOptions { selection: Selection { asks: true, ..Selection::default() }, ..self.options.clone() };
        Self { options, ..self.clone() }
    }

    /// Whether it was [`Self::reselected`] from `other`, and is perhaps another of the volumes in its file.
    #[must_use]
    pub fn is_another_of(&self, other: &Self) -> bool {
        self.options.selection.asks && self.reselected() == other.reselected()
    }

    /// What a window is called that shows it, or what was chosen of it.
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

    /// How it is called.
    #[must_use]
    pub fn name(&self) -> String {
        self.path.as_ref().map_or_else(|| "the default scene".to_owned(), |path| path.display().to_string())
    }

    /// The volume that it is, where it is no scene.
    #[must_use]
    pub fn bare_volume(&self) -> Option<&Path> {
        self.path.as_deref().filter(|path| is_volume(path, &[]) || has_header(path))
    }

    /// Reads the scene. A volume without one gets a transfer function made from its histogram.
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
                    // Of a file that is the volume, there is no scene to speak of.
                    Err(SceneError::Volume { source, .. }) => return Err(source.into()),
                    parsed => parsed?,
                }
            }
            (Some(path), None) => load(path, &self.options, progress).map_err(|error| no_scene(path, error))?,
        };
        let scene = &mut file.scene;
        let statistics = scene.volume.statistics()?;
        if without_scene.is_some() {
            scene.transfer.terms = terms(&statistics, scene.materials.len());
            scene.transfer.opacity_length *= thickness(&scene.volume.geometry);
            // Patients stand upright and face whoever looks.
            let patient = scene.volume.anatomical.then_some(Side::Front);
            if let Some(side) = flat_side(&scene.volume.geometry).or(patient) {
                scene.camera = moved(&scene.camera, &scene.camera, &scene.volume.geometry, 1.0, Move::Axis(side));
            }
        }
        Ok((file, statistics))
    }
}

/// What is wrong with the file `path`, which could not be read as a scene. One that is no text of a scene's length is told of as
/// a volume that is not known.
fn no_scene(path: &Path, error: SceneError) -> OpenError {
    // Of what is wrong in a scene's text, the line is said.
    let is_all_of_it = matches!(&error, SceneError::Invalid { at, .. } if *at == path.display().to_string());
    match volume::open(path, &Selection::default(), &Quiet) {
        Err(unknown @ VolumeError::UnknownFormat { .. }) if is_all_of_it => unknown.into(),
        _ => error.into(),
    }
}

/// Opacities of the materials of a volume that has no scene, from the rarest-valued air up.
const OPACITIES: [f64; 3] = [0.01, 0.06, 0.4];

/// Voxels deep that a thing is which [`OPACITIES`] show well.
const DEPTH: f64 = 100.0;
/// How many times as long as it is thick a volume is that is looked at as a sheet.
const FLAT: f64 = 20.0;

/// What [`OPACITIES`] are of in a volume of this thickness, as a part of a voxel: what is thin, as one slice is, is to hide as
/// much as if it were not.
fn thickness(geometry: &Geometry) -> f64 {
    let depth = geometry.extent().min_element() / geometry.spacing.min_element();
    (depth / DEPTH).min(1.0)
}

/// The side from which a volume that is a sheet is looked at: of slices along z, as they lie on a screen.
fn flat_side(geometry: &Geometry) -> Option<Side> {
    let extent = geometry.extent();
    let thin = extent.min_position();
    let normal = geometry.direction.col(thin).abs().max_position();
    (extent.max_element() >= FLAT * extent[thin]).then(|| [Side::Left, Side::Front, Side::Bottom][normal])
}

/// A first transfer function: what surrounds things is left out, and the rest is cut into ranges of values that hold
/// about as much each, where a value counts by the logarithm of how often it occurs.
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

/// The bin above which a voxel belongs to a thing and not to what surrounds it: the cut into two classes of values with
/// the largest variance between them (Otsu 1979).
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
