//! Opens a scene file, or a volume with a default scene around it.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::file::{Given, InMemory, is_segmentation, parse_around, volume_alone};
use super::import::{self, Import, ImportError};
use super::look::beside::{BesideVolume, beside};
use super::look::channels::{ChannelVolume, channel_name, channels as look_channels};
use super::look::first_look::{
    Channel, ChosenParts, FirstLook, Look, LookError, NoCt, Subject, Wish, first_look, is_speckled, labels_text,
};
use super::{Definition, SceneError, SceneFile, SceneOptions, load, load_embedded, parse};
use relume_base::input;
use relume_base::number::readable;
use relume_base::progress::{Progress, Quiet};
use relume_scene::{Blending, FIELDS};
use relume_volume::{Asked, RawLayout, Selection, Several, Statistics, Volume, VolumeError, has_header, is_volume};

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
pub enum OpenError {
    /// An error of the scene.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// An error of the volume.
    #[error(transparent)]
    Volume(#[from] VolumeError),
    /// A look that these values do not have.
    #[error(transparent)]
    Look(#[from] NoCt),
    /// An error of a preset.
    #[error(transparent)]
    Preset(#[from] ImportError),
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
    /// Whether a volume without a straight grid is resampled to one.
    Grid {
        /// The error of reading it without.
        problem: String,
    },
}

impl OpenError {
    /// Name for programs; it does not change between versions.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Scene(error) => error.code(),
            Self::Volume(error) => error.code(),
            Self::Look(_) => "look",
            Self::Preset(error) => error.code(),
        }
    }

    /// The missing information, if nothing else prevents opening.
    #[must_use]
    pub fn question(&self) -> Option<Question> {
        let (file, unknown) = match self {
            Self::Volume(VolumeError::NoLayout { path, bytes, guesses, .. }) => {
                let guess = guesses.first().cloned().map(Box::new);
                (path.clone(), Unknown::Layout { bytes: *bytes, guess })
            }
            // The scene may answer this, or the user.
            Self::Volume(VolumeError::Choose { source_name, there })
            | Self::Scene(SceneError::Volume { source: VolumeError::Choose { source_name, there }, .. }) => {
                (source_name.into(), Unknown::Which(there.clone()))
            }
            Self::Volume(error) | Self::Scene(SceneError::Volume { source: error, .. }) => match error {
                VolumeError::Lean { source_name, .. } | VolumeError::Uneven { source_name, .. } => {
                    (source_name.into(), Unknown::Grid { problem: error.to_string() })
                }
                _ => return None,
            },
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
        let options = SceneOptions {
            selection: Selection { asks: true, ..Selection::default() },
            channels: None,
            ..self.options.clone()
        };
        Self { options, ..self.clone() }
    }

    /// Whether this was [`Self::reselected`] from `other`, and so may be another volume of its file.
    #[must_use]
    pub fn is_another_of(&self, other: &Self) -> bool {
        self.options.selection.asks && self.reselected() == other.reselected()
    }

    /// Window title: the file and the selected volume.
    #[must_use]
    pub fn title(&self, Selection { component, time, array, series, level, .. }: &Selection) -> String {
        let file = self.path.as_ref().and_then(|path| path.file_name());
        let name = file.map_or_else(|| self.name(), |file| file.to_string_lossy().into_owned());
        let series = series.as_ref().map(|key| format!("series {key}"));
        let numbers = [("component", component), ("time", time), ("level", level)];
        let numbers = numbers.map(|(name, number)| number.map(|number| format!("{name} {number}")));
        let of_it: Vec<String> = array.iter().cloned().chain(series).chain(numbers.into_iter().flatten()).collect();
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
        // A layout describes a volume, unless the file is a scene.
        let is_toml = |path: &Path| path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"));
        let is_laid_out = |path: &Path| {
            if is_toml(path) { is_sidecar(path) } else { self.options.raw.is_some() && self.options.volume.is_none() }
        };
        self.path.as_deref().filter(|path| is_volume(path, &[]) || is_laid_out(path) || has_header(path))
    }

    /// Reads the scene. For a volume without a scene, makes one from its values (docs/theory/first-look.md).
    ///
    /// # Errors
    ///
    /// [`SceneError`], [`VolumeError`].
    pub fn read(&self, progress: &dyn Progress) -> Result<(SceneFile, Statistics), OpenError> {
        // A volume without a scene is never shown by the embedded one, also if it cannot be read.
        let file = match (&self.path, self.alone()) {
            (_, Some(path)) => {
                let options = SceneOptions { volume: Some(path.to_owned()), ..self.options.clone() };
                return look_at(path, None, options, progress);
            }
            (None, None) => load_embedded(&self.options, progress)?,
            (Some(path), None) => load(path, &self.options, progress).map_err(|error| no_scene(path, error))?,
        };
        let statistics = file.scene.volume().statistics()?;
        Ok((file, statistics))
    }

    /// Number of time steps, one of which a selection chooses; 1 if there is no choice.
    ///
    /// # Errors
    ///
    /// As [`Self::read`], for all other choices.
    pub fn times(&self, progress: &dyn Progress) -> Result<usize, OpenError> {
        let opened = match self.alone() {
            Some(path) => {
                let mut options = SceneOptions { volume: Some(path.to_owned()), ..self.options.clone() };
                let name = path.display().to_string();
                let mut read = volume_alone(&name, None, &options, progress).map(drop);
                // All channels have the same times.
                let chosen = read.as_ref().err().map(|error| channels_of(error, &options)).transpose()?.flatten();
                if let Some((component, _)) = chosen.and_then(|chosen| chosen.into_iter().next()) {
                    options.selection.component = Some(component);
                    read = volume_alone(&name, None, &options, progress).map(drop);
                }
                read.map_err(of_volume)
            }
            None => self.read(progress).map(drop),
        };
        match opened {
            Ok(()) => Ok(1),
            Err(error) => match error.question() {
                Some(Question { unknown: Unknown::Which(Several::Times(count)), .. }) => Ok(count),
                _ => Err(error),
            },
        }
    }

    /// The scenes of all `times`. Those of a volume without a scene have one look, made from the largest value of each
    /// voxel over all times.
    ///
    /// # Errors
    ///
    /// As [`Self::read`].
    pub fn series(&self, times: usize, progress: &dyn Progress) -> Result<Series, OpenError> {
        let Some(path) = self.alone() else { return Ok(Series { source: self.clone(), look: None }) };
        if let Some(further) = self.options.beside.first() {
            let problem = format!(
                "all its time steps are shown alone, and {} was named beside them; choose one time step, or state both in a scene",
                further.display()
            );
            return Err(VolumeError::Layout { source_name: path.display().to_string(), problem }.into());
        }
        let name = path.display().to_string();
        let mut options = SceneOptions { volume: Some(path.to_owned()), ..self.options.clone() };
        let mut largest: Option<(Arc<Volume>, ChosenParts)> = None;
        let mut ends = [f64::INFINITY, f64::NEG_INFINITY];
        for time in 0..times {
            options.selection.time = Some(time);
            let ((volume, _), parts) = match volume_alone(&name, None, &options, progress) {
                Ok(found) => found,
                Err(error) => {
                    return match channels_of(&error, &options)? {
                        Some(chosen) => self.series_of_channels(path, options, &chosen, (times, progress)),
                        None => Err(of_volume(error)),
                    };
                }
            };
            let Statistics { min, max, .. } = volume.statistics()?;
            ends = [ends[0].min(min), ends[1].max(max)];
            match &mut largest {
                Some((largest, _)) => Arc::make_mut(largest).raise_to(&volume)?,
                None => largest = Some((volume, parts)),
            }
        }
        let look = match largest {
            Some((volume, parts)) => {
                let subject = Subject { parts, is_of_times: true, has_labels: false };
                let volumes = InMemory { volume, labels: None, further: Vec::new() };
                let Looked { text, guess, .. } = looked(path, volumes, (&mut options, subject), progress)?;
                let [least, most] = ends.map(readable);
                let of_all = format!(
                    "{guess} All {times} time steps have this look, by the largest value of each voxel; their values go \
                     from {least} to {most}."
                );
                Some((text, of_all))
            }
            None => None,
        };
        // Names that the look does not use are not used at any time.
        let options = SceneOptions { label_names: options.label_names, ..self.options.clone() };
        Ok(Series { source: Self { options, ..self.clone() }, look })
    }

    /// The scenes of all `times` of several channels: one look, made from the largest value of each voxel of each channel.
    fn series_of_channels(
        &self,
        path: &Path,
        mut options: SceneOptions,
        chosen: &[(usize, String)],
        (times, progress): (usize, &dyn Progress),
    ) -> Result<Series, OpenError> {
        let blending = blending_of_channels(&mut options);
        let mut largest: Vec<ChannelVolume> = Vec::new();
        for time in 0..times {
            options.selection.time = Some(time);
            let channels = opened_channels(path, &mut options, chosen, progress)?;
            if largest.is_empty() {
                largest = channels;
            } else {
                for (largest, channel) in largest.iter_mut().zip(channels) {
                    Arc::make_mut(&mut largest.volume).raise_to(&channel.volume)?;
                }
            }
        }
        let of_file = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let look = look_channels(&of_file, &mut largest, blending, progress).map_err(of_look)?;
        let guess =
            format!("{} All {times} time steps have this look, by the largest value of each voxel.", look.guess);
        // The text says which further channels there are, and wishes are in it.
        let mut options = SceneOptions { wish: Wish::default(), channels: None, ..self.options.clone() };
        options.selection.component = chosen.first().map(|(component, _)| *component);
        Ok(Series { source: Self { options, ..self.clone() }, look: Some((look.text, guess)) })
    }

    /// The volume that is opened without a scene, if there is one.
    fn alone(&self) -> Option<&Path> {
        self.bare_volume().or(self.options.volume.as_deref().filter(|_| self.path.is_none()))
    }
}

/// Scenes of the time steps of a source.
#[derive(Clone, Debug)]
pub struct Series {
    source: Source,
    /// Text of the scene of all times, and the guess in a sentence, for a volume without a scene.
    look: Option<(String, String)>,
}

impl Series {
    /// The guess, in a sentence, if the scene was made from the volume.
    #[must_use]
    pub fn guess(&self) -> Option<&str> {
        self.look.as_ref().map(|(_, guess)| guess.as_str())
    }

    /// The scene of a time step.
    ///
    /// # Errors
    ///
    /// As [`Source::read`].
    pub fn at(&self, time: usize, progress: &dyn Progress) -> Result<(SceneFile, Statistics), OpenError> {
        let mut source = self.source.clone();
        source.options.selection.time = Some(time);
        let (Some((text, guess)), Some(path)) = (&self.look, self.source.alone()) else { return source.read(progress) };
        let options = SceneOptions { volume: Some(path.to_owned()), ..source.options };
        let file = parse(&path.display().to_string(), text, Path::new(""), &options, progress).map_err(of_volume)?;
        let statistics = file.scene.volume().statistics()?;
        Ok((SceneFile { guess: Some(guess.clone()), ..file }, statistics))
    }
}

/// A volume with its first look.
struct Looked {
    /// The volume, without other parts than the body, as the look says.
    volume: Arc<Volume>,
    /// Text of the scene.
    text: String,
    /// The guess, in a sentence.
    guess: String,
    statistics: Statistics,
}

/// The first look at a volume, which was read from `path`. Labels of the options are read where none are in memory. Names
/// of labels that it does not use leave the options.
fn looked(
    path: &Path,
    InMemory { mut volume, labels, .. }: InMemory,
    (options, subject): (&mut SceneOptions, Subject),
    progress: &dyn Progress,
) -> Result<Looked, OpenError> {
    volume.prepare_coarse(progress)?;
    let notes = volume.notes.len();
    let has_labels = labels.is_some() || options.labels.is_some();
    if let Some(names) = options.label_names.as_ref().filter(|_| !has_labels) {
        let volume = Arc::make_mut(&mut volume);
        volume.name_labels(names)?;
        volume.notes.truncate(notes);
    }
    let statistics = volume.statistics()?;
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let subject = Subject { has_labels, ..subject };
    let look = look_of(&name, (&mut volume, &statistics), (&*options, subject), progress)?;
    let statistics = if look.is_changed { volume.statistics()? } else { statistics };
    // A label map is named again, with the notes.
    if let Some(names) = options.label_names.take_if(|_| !has_labels && !look.is_label_map) {
        let volume = Arc::make_mut(&mut volume);
        volume.notes.push(format!(
            "{}: the values are not shown as labels, so the names in {} are not used",
            path.display(),
            names.display()
        ));
    }
    let (mut text, mut guess) = (look.text, look.guess);
    let others = || match (&labels, &options.labels) {
        (Some(labels), _) => Some(labels.source.clone()),
        (None, file) => file.as_ref().map(|file| file.display().to_string()),
    };
    if let Some(labels) = others().filter(|_| look.is_label_map) {
        let problem = format!(
            "its values are labels, so it takes no others ({labels}); name the scan as the volume, and this file as its labels"
        );
        return Err(VolumeError::Layout { source_name: path.display().to_string(), problem }.into());
    }
    // A label map that cannot be read is an error of the scene.
    let opened = |file: &PathBuf| relume_volume::open(file, &Selection::default(), progress).ok().map(Arc::new);
    if let Some(mut labels) = labels.or_else(|| options.labels.as_ref().and_then(opened)) {
        if let Some(names) = &options.label_names {
            Arc::make_mut(&mut labels).name_labels(names)?;
        }
        let declared = labels_text(&labels, &text)?;
        if is_speckled(&labels) {
            let note = format!("{}: its values change from voxel to voxel, as those of no label map", labels.source);
            Arc::make_mut(&mut volume).notes.push(note);
        }
        guess.push_str(match &declared {
            Some(_) => " Voxels with a label are shown as materials of their own, and all others by their values.",
            None => " The labels are not used: the label map has no label.",
        });
        text.push_str(&declared.unwrap_or_default());
    }
    Ok(Looked { volume, text, guess, statistics })
}

/// The first look at `volume`, or the scene of the preset of the options.
fn look_of(
    name: &str,
    (volume, statistics): (&mut Arc<Volume>, &Statistics),
    (options, subject): (&SceneOptions, Subject),
    progress: &dyn Progress,
) -> Result<FirstLook, OpenError> {
    let mut wish = options.wish;
    let mut of_channel = None;
    if let Some(path) = &options.preset {
        let file = path.display().to_string();
        let channels = match import::read(path)? {
            Import::Preset(preset) => {
                let invalid = |problem| ImportError::Invalid { name: file.clone(), what: "a preset", problem };
                return Ok(import::scene(&preset, &file, (name, &**volume, statistics)).map_err(invalid)?);
            }
            Import::Channels(channels) => channels,
        };
        // The channel of this component, or the first one that is shown.
        let number = volume.selection.component.map(|component| component + 1);
        let same = channels.iter().find(|channel| Some(channel.number) == number);
        if let Some(channel) = same.or_else(|| channels.iter().find(|channel| channel.is_active)) {
            wish =
                Wish { channel: Some(Channel { window: channel.window, colour: channel.colour }), ..Wish::default() };
            let label = channel.label.as_ref().map_or_else(String::new, |label| format!(" ({label})"));
            of_channel =
                Some(format!(" Its window and colour are those of channel {}{label} in {file}.", channel.number));
        }
    }
    let mut look = first_look(name, volume, statistics, (wish, subject), progress).map_err(of_look)?;
    look.guess.extend(of_channel);
    Ok(look)
}

/// The scene of volumes in memory, made from their values (docs/theory/first-look.md), with the statistics of the volume.
/// The scene holds the same volume, unless the look removes a part of it or the `options` change it.
///
/// # Errors
///
/// [`SceneError`], [`VolumeError`], and a look that these values do not have.
pub fn first_look_of(
    volumes: InMemory,
    options: &SceneOptions,
    progress: &dyn Progress,
) -> Result<(SceneFile, Statistics), OpenError> {
    let name = volumes.volume.source.clone();
    look_at(Path::new(&name), Some(volumes), options.clone(), progress)
}

/// The scene of the volume of `options`, which is called by its `path`, or of volumes in memory, made from their values.
fn look_at(
    path: &Path,
    in_memory: Option<InMemory>,
    mut options: SceneOptions,
    progress: &dyn Progress,
) -> Result<(SceneFile, Statistics), OpenError> {
    let whole_name = path.display().to_string();
    let stated_time = options.selection.time;
    let labels = in_memory.as_ref().and_then(|volumes| volumes.labels.clone());
    let further = in_memory.as_ref().map_or_else(Vec::new, |volumes| volumes.further.clone());
    let has_map = labels.is_some();
    let is_of_file = in_memory.is_none();
    let mut alone = volume_alone(&whole_name, in_memory, &options, progress);
    let is_of_other = |error: &SceneError| {
        matches!(error, SceneError::Volume { source: VolumeError::NoSuch { asked: Asked::Time(_), .. }, .. })
    };
    if !options.beside.is_empty() && is_of_file && alone.as_ref().is_err_and(is_of_other) {
        // The time is that of a series beside it.
        options.selection.time = None;
        alone = volume_alone(&whole_name, None, &options, progress);
    }
    let ((volume, stored), parts) = match alone {
        Ok(found) => found,
        Err(error) => {
            let chosen = channels_of(&error, &options)?.filter(|_| is_of_file);
            return match chosen {
                Some(_) if !options.beside.is_empty() => {
                    let problem = "its channels are shown together, and volumes beside them were named too; choose one component of it, or state all of them in [volumes] of a scene";
                    Err(VolumeError::Layout { source_name: whole_name, problem: problem.to_owned() }.into())
                }
                Some(chosen) => look_at_channels(path, options, chosen, progress),
                None => Err(of_volume(error)),
            };
        }
    };
    if let Some(stated) = options.channels.as_ref() {
        let problem = format!("one volume of it is read, and the channels {} were asked for", stated.join(", "));
        return Err(VolumeError::Layout { source_name: whole_name, problem }.into());
    }
    let open = |path: &PathBuf| {
        let selection = Selection { memory: options.selection.memory, ..Selection::default() };
        let mut time = None;
        let volume = match relume_volume::open(path, &selection, progress) {
            // The time is that of the series among them.
            Err(VolumeError::Choose { there: Several::Times(_) | Several::Steps { .. }, .. })
                if stated_time.is_some() =>
            {
                time = stated_time;
                relume_volume::open(path, &Selection { time, ..selection }, progress)
            }
            opened => opened,
        };
        let volume = Arc::new(volume?);
        Ok(BesideVolume { path: path.clone(), time, volume })
    };
    let mut others = options.beside.iter().map(open).collect::<Result<Vec<_>, VolumeError>>()?;
    let mut told = None;
    let is_map = |other: &BesideVolume| is_segmentation(&other.volume);
    if let Some(index) = others.iter().position(is_map).filter(|_| options.labels.is_none() && !has_map) {
        let path = others.remove(index).path;
        let what = "are labels, of which each is shown as a material of its own";
        told = Some(format!(" The values of {} {what}.", path.display()));
        options.labels = Some(path);
    }
    let subject = Subject { parts, is_of_times: false, has_labels: options.labels.is_some() };
    let volumes = InMemory { volume, labels: labels.clone(), further: Vec::new() };
    let Looked { mut volume, text, guess, statistics } = looked(path, volumes, (&mut options, subject), progress)?;
    if volume.geometry != stored {
        Arc::make_mut(&mut volume).geometry = stored;
    }
    let (mut text, mut guess) = (text, guess);
    guess.extend(told);
    if !others.is_empty() {
        let look =
            beside((&text, path), volume.geometry.spacing.min_element(), &mut others, progress).map_err(of_look)?;
        guess.push_str(&look.guess);
        // The scene reads them again, as any scene does that states them.
        text = look.text;
    }
    let given = Some(Given { volumes: InMemory { volume, labels, further }, is_ready: true, has_ready_labels: false });
    let read = parse_around(given, (&whole_name, &text), Path::new(""), &options, progress);
    let file = read.map_err(of_volume)?;
    // Labels may be values by their ranks.
    let own = file.scene.labels.is_some() && options.labels.is_none() && !has_map;
    let statistics = if own { file.scene.volume().statistics()? } else { statistics };
    Ok((SceneFile { guess: Some(guess), ..file }, statistics))
}

/// True if nothing but the largest values of rays is wished for.
fn sees_maximum(options: &SceneOptions) -> bool {
    options.wish == Wish { look: Some(Look::Maximum), ..Wish::default() }
}

/// The channels, by their component and name, that are shown together where a volume of several was not chosen: those that the options
/// name, or else all of a few.
fn channels_of(error: &SceneError, options: &SceneOptions) -> Result<Option<Vec<(usize, String)>>, OpenError> {
    let SceneError::Volume { source: VolumeError::Choose { source_name, there }, .. } = error else { return Ok(None) };
    let Several::Components { count, kind, names } = there else { return Ok(None) };
    // The largest values of all of them are a look, too.
    let wishes = !options.wish.is_none() && !sees_maximum(options);
    let is_one = wishes || options.preset.is_some() || options.labels.is_some() || options.selection.asks;
    let name = |component: usize| names.get(component).cloned().unwrap_or_default();
    if let (Some(_), true) = (&options.channels, wishes || options.preset.is_some()) {
        let problem =
            "several channels have a look of their own, or that of their largest values, the look maximum; omit their names, or the look, window or preset"
                .to_owned();
        return Err(VolumeError::Layout { source_name: source_name.clone(), problem }.into());
    }
    let Some(stated) = &options.channels else {
        // Colours are no channels of their own.
        let all = !is_one && kind.is_empty() && (2..=FIELDS).contains(count);
        return Ok(all.then(|| (0..*count).map(|component| (component, name(component))).collect()));
    };
    let wrong = |problem: String| OpenError::from(VolumeError::Layout { source_name: source_name.clone(), problem });
    let mut chosen: Vec<(usize, String)> = Vec::new();
    for wanted in stated {
        let named = names.iter().position(|name| name == wanted).or_else(|| {
            let alike = |name: &String| name.eq_ignore_ascii_case(wanted);
            names.iter().position(alike).filter(|_| names.iter().filter(|name| alike(name)).count() == 1)
        });
        // As pictures call those without a name.
        let shown = |component: usize| name(component).trim().is_empty() && channel_name(component) == *wanted;
        let named = named.or_else(|| (0..*count).find(|&component| shown(component)));
        let found = named.or_else(|| wanted.parse().ok().filter(|number| number < count));
        let Some(component) = found else {
            let known = match names.is_empty() {
                true => format!("0 to {}", count - 1),
                false => names.join(", "),
            };
            return Err(wrong(format!("it has no channel {wanted:?}; it has {known}")));
        };
        if chosen.iter().any(|(known, _)| *known == component) {
            return Err(wrong(format!("the channel {wanted:?} is named twice")));
        }
        chosen.push((component, name(component)));
    }
    if chosen.len() > FIELDS {
        return Err(wrong(format!("{} channels are named; a picture shows up to {FIELDS}", chosen.len())));
    }
    Ok(Some(chosen))
}

/// The rule by which channels are blended, of a wish that the options then have no more: it is for values that have no look of their own.
fn blending_of_channels(options: &mut SceneOptions) -> Blending {
    let blending = if sees_maximum(options) { Blending::Maximum } else { Blending::Composite };
    options.wish = Wish::default();
    blending
}

/// The `chosen` channels of the volume of `options`.
fn opened_channels(
    path: &Path,
    options: &mut SceneOptions,
    chosen: &[(usize, String)],
    progress: &dyn Progress,
) -> Result<Vec<ChannelVolume>, OpenError> {
    let name = path.display().to_string();
    let mut channels = Vec::new();
    for (component, of_file) in chosen {
        options.selection.component = Some(*component);
        let ((volume, _), _) = volume_alone(&name, None, options, progress).map_err(of_volume)?;
        channels.push(ChannelVolume { component: *component, name: of_file.clone(), volume });
    }
    Ok(channels)
}

/// The scene of several channels of the volume of `options`, made from their values.
fn look_at_channels(
    path: &Path,
    mut options: SceneOptions,
    chosen: Vec<(usize, String)>,
    progress: &dyn Progress,
) -> Result<(SceneFile, Statistics), OpenError> {
    let name = path.display().to_string();
    let blending = blending_of_channels(&mut options);
    let mut channels = opened_channels(path, &mut options, &chosen, progress)?;
    options.selection.component = channels.first().map(|channel| channel.component);
    let of_file = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let look = look_channels(&of_file, &mut channels, blending, progress).map_err(of_look)?;
    // They are in memory by the names of their keys.
    let further = look.names.iter().cloned().zip(channels.iter().map(|channel| Arc::clone(&channel.volume))).skip(1);
    let further = further.collect();
    let Some(first) = channels.into_iter().next() else {
        return Err(OpenError::Scene(SceneError::NoVolume { scene: name }));
    };
    let statistics = first.volume.statistics()?;
    let volumes = InMemory { volume: first.volume, labels: None, further };
    let given = Some(Given { volumes, is_ready: true, has_ready_labels: false });
    let file = parse_around(given, (&name, &look.text), Path::new(""), &options, progress).map_err(of_volume)?;
    Ok((SceneFile { guess: Some(look.guess), ..file }, statistics))
}

fn of_look(error: LookError) -> OpenError {
    match error {
        LookError::NoCt(error) => error.into(),
        LookError::Volume(error) => error.into(),
    }
}

/// The error of a scene around a volume; where the file is the volume itself, it needs no scene.
fn of_volume(error: SceneError) -> OpenError {
    match error {
        SceneError::Volume { source, .. } => source.into(),
        error => OpenError::from(error),
    }
}

/// Longest sidecar, in bytes.
const LONGEST_TOML: u64 = 1 << 16;

/// Whether a TOML file describes voxels and not a scene: by `dims` or `type` at the top level, or by a lone `[volume]`.
#[must_use]
pub fn is_sidecar(path: &Path) -> bool {
    let text = || String::from_utf8(input::read(path, LONGEST_TOML).ok()?).ok();
    let table = text().and_then(|text| text.parse::<toml::Table>().ok());
    table.is_some_and(|it| it.contains_key("dims") || it.contains_key("type") || it.keys().eq(["volume"]))
}

/// True for a text that is not TOML, by its name and its content.
#[must_use]
pub fn is_no_scene(path: &Path) -> bool {
    let is_toml = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"));
    let text = input::read(path, LONGEST_TOML).ok().and_then(|bytes| String::from_utf8(bytes).ok());
    !is_toml && text.is_none_or(|text| text.parse::<toml::Table>().is_err())
}

/// Error for the file `path`, which is not readable as a scene. A file that is not text, too long for a scene, or a text
/// that is not TOML, is reported as a volume of unknown format.
fn no_scene(path: &Path, error: SceneError) -> OpenError {
    let is_all_of_it =
        matches!(error, SceneError::IsVolume { .. } | SceneError::TooLong { .. } | SceneError::NoText { .. });
    if !(is_all_of_it || matches!(error, SceneError::Invalid { .. }) && is_no_scene(path)) {
        return error.into();
    }
    match relume_volume::open(path, &Selection::default(), &Quiet) {
        Err(VolumeError::UnknownFormat { path, what, is_known: false, known }) => {
            let mistake =
                if matches!(error, SceneError::Invalid { .. }) { format!(" ({error})") } else { String::new() };
            let what = format!("this is neither a volume nor a scene{mistake}: {what}");
            VolumeError::UnknownFormat { path, what, is_known: false, known }.into()
        }
        Err(unknown @ VolumeError::UnknownFormat { .. }) => unknown.into(),
        _ => error.into(),
    }
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
        let chosen = Selection { series: Some("7".to_owned()), level: Some(2), ..Selection::default() };
        assert_eq!(title("scans", &chosen), "scans (series 7, level 2) — Relume");
    }
}
