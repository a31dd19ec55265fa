//! `Scene`: a volume with materials, lights and a camera, and its renders.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::PyArray1;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyType};
use relume::document::moves::{Move, around, moved};
use relume::document::session::with_camera;
use relume::document::{
    Definition, InMemory, Look, Quality, SceneFile, SceneOptions, Source, Wish, first_look_of, load, parse, parse_on,
    parse_ready, redefined,
};
use relume::film::Film as Numbers;
use relume::live::{self, ForReaders, LiveNote};
use relume::measure::{Enlargement, Goal, Pixels, Wanted};
use relume::memory;
use relume::output::FilmFile;
use relume::output::page::PackedLive;
use relume::plan::plan;
use relume::progress::{Progress, unreported};
use relume::render::{Job, Keeps, PlannedJob, RenderWarning};
use relume::scene::{Camera, Mix, Turned};
use relume::spectrum::Light;
use relume::volume::Statistics;

use crate::device;
use crate::errors::{Failed, Made};
use crate::film::Film;
use crate::spectra;
use crate::tables::{check_depth, text_of, value_of};
use crate::volume::{Volume, hash_of, is_path, path_of};
use crate::work::{self, heard};

/// A scene: immutable; `define` makes another one.
#[pyclass(frozen, module = "relume")]
pub(crate) struct Scene {
    file: SceneFile,
    statistics: Statistics,
}

/// The volumes in memory of two arguments.
fn in_memory(volume: &Bound<'_, PyAny>, labels: Option<&Bound<'_, PyAny>>) -> PyResult<InMemory> {
    Ok(InMemory { volume: Volume::of(volume)?, labels: labels.map(Volume::of).transpose()?, further: Vec::new() })
}

/// The quality of this name.
fn quality_of(name: Option<&str>) -> PyResult<Option<Quality>> {
    name.map(|name| Quality::of(name).map_err(PyValueError::new_err)).transpose()
}

/// Definitions of a dict: keys such as `camera.azimuth`, or nested dicts.
fn definitions_of(definitions: Option<&Bound<'_, PyDict>>) -> PyResult<Vec<Definition>> {
    fn add(dict: &Bound<'_, PyDict>, path: &str, found: &mut Vec<Definition>) -> PyResult<()> {
        check_depth(path)?;
        for (key, value) in dict {
            let key = key.str()?.to_string();
            let key = if path.is_empty() { key } else { format!("{path}.{key}") };
            match value.cast::<PyDict>() {
                Ok(dict) if !dict.is_empty() && !spectra::is_form(dict) => add(dict, &key, found)?,
                _ => found.push(Definition::new(&format!("{key}={}", value_of(&value, &key)?))),
            }
        }
        Ok(())
    }
    let mut found = Vec::new();
    if let Some(definitions) = definitions {
        add(definitions, "", &mut found)?;
    }
    Ok(found)
}

impl Scene {
    /// The scene of `file`; statistics of its volume are `known` if they were computed before.
    fn new_of(file: SceneFile, known: Option<Statistics>) -> Made<Self> {
        let statistics = known.map_or_else(|| file.scene.volume().statistics(), Ok)?;
        Ok(Self { file, statistics })
    }

    /// The film of a render.
    fn film(&self, asked: &Asked, progress: &dyn Progress) -> Made<Film> {
        let none = || Failed::new("RelumeError", "film", "there is no film");
        self.films(asked, vec![self.file.scene.camera.clone()], progress)?.into_iter().next().ok_or_else(none)
    }

    /// The films of `cameras`, of one plan and one upload.
    fn films(&self, asked: &Asked, cameras: Vec<Camera>, progress: &dyn Progress) -> Made<Vec<Film>> {
        let &Asked { size, ref device, ref lights, goal } = asked;
        let scene = self.file.scene.clone();
        let of_values = RenderWarning::of_values(&self.statistics).into_iter();
        of_values.chain(RenderWarning::of_scene(&scene, &self.statistics, size)).for_each(heard);
        let mix = self.file.opening_mix();
        let wanted = goal.map(|goal| Wanted { size, goal, pixels: Pixels::Fewer });
        let choice = wanted.map(|wanted| device::chosen(device, &scene, &mix, wanted, progress)).transpose()?;
        let (scene, marched) = choice
            .as_ref()
            .map_or_else(|| (scene.clone(), size), |it| (it.setting.applied(&scene), it.setting.marched_size(size)));
        let job = Job::new(scene, self.statistics.clone()).of_pictures(size, cameras);
        let job = Job { lights: lights.clone(), ..job }.planned(progress)?;
        job.planned.warnings.iter().for_each(heard);
        job.level.as_ref().and_then(RenderWarning::of_level).into_iter().for_each(heard);
        let films = match device.as_str() {
            "cpu" | "reference" => without_device(&job, device, size, &mix, progress)?,
            device => device::marched(device, &job, &mix, marched, progress)?,
        };
        let enlargement = Enlargement::new(marched, size);
        let dial = self.file.light.dial_of_film(&self.file.dial);
        // An automatic exposure is that of the first film.
        let mut exposure = job.scene.display.exposure;
        let made = |(camera, film): (&Camera, Numbers<f32>)| {
            let film = if enlargement.is_none() { film } else { enlargement.accumulation(&film) };
            let mut scene = seen_by(&job.scene, camera);
            scene.display.exposure = exposure;
            let file = FilmFile::of_march(&scene, &job.planned, &mix, dial.clone(), film)?;
            exposure = file.exposure;
            Ok(Film::of(file)?.chosen(choice.clone()))
        };
        job.cameras.iter().zip(films).map(made).collect()
    }
}

/// The volume of a live widget or page.
#[pyclass(frozen, module = "relume")]
pub(crate) struct LiveVolume {
    pub(crate) packed: PackedLive,
    /// What the maker of a page should know of it.
    pub(crate) of_page: Option<LiveNote>,
}

#[pymethods]
impl LiveVolume {
    /// Sizes, names, frame and camera, as the script reads them.
    #[getter]
    fn json(&self) -> &str {
        &self.packed.json
    }

    /// Names and deflated bytes.
    #[getter]
    fn blocks<'py>(&self, py: Python<'py>) -> Vec<(&'static str, Bound<'py, PyBytes>)> {
        self.packed.blocks.iter().map(|(name, bytes)| (*name, PyBytes::new(py, bytes))).collect()
    }
}

/// Settings of a render.
struct Asked {
    size: [usize; 2],
    device: String,
    lights: Vec<(String, Light)>,
    goal: Option<Goal>,
}

/// `scene` with this camera.
fn seen_by(scene: &relume::scene::Scene, camera: &Camera) -> relume::scene::Scene {
    relume::scene::Scene { camera: camera.clone(), ..scene.clone() }
}

/// The films of all cameras by all cores: of stored tables in f32 ("cpu"), or of exact samples in f64 ("reference").
#[expect(clippy::cast_possible_truncation, reason = "films hold f32")]
fn without_device(
    job: &PlannedJob,
    device: &str,
    size: [usize; 2],
    mix: &Mix,
    progress: &dyn Progress,
) -> Made<Vec<Numbers<f32>>> {
    let plan = &job.planned.plan;
    let numbers = plan.light.accumulators() * plan.components() + plan.transmittance_numbers();
    let bytes_of_number = if device == "cpu" { 4 } else { 12 };
    let bytes = [size[0], size[1], numbers, bytes_of_number, job.cameras.len()]
        .into_iter()
        .fold(1, usize::saturating_mul) as u64;
    if let Some(free) = memory::available_bytes().filter(|&free| bytes > free) {
        let message =
            format!("a film of {}×{} pixels needs {bytes} bytes of memory, and {free} are free", size[0], size[1]);
        return Err(Failed::new("DeviceMemoryError", "film-exceeds-memory", message));
    }
    // Several count as films, and one by its rows.
    let each = |index: usize, march: &dyn Fn(&dyn Progress) -> Made<Numbers<f32>>| match job.cameras.len() {
        1 => march(progress),
        number => {
            progress.report("marching", index as u64, number as u64);
            march(&unreported(progress))
        }
    };
    let cameras = job.cameras.iter().enumerate();
    let films: Vec<Numbers<f32>> = if device == "cpu" {
        // Another thread stores its volume for itself.
        let mut kept = device::KEPT_VOLUME.try_lock();
        let on_cpu = job.on_cpu(kept.as_deref_mut().unwrap_or(&mut None))?;
        drop(kept);
        let stored = &on_cpu.stored;
        let of_storage = RenderWarning::of_storage(&job.scene, &stored.storage, stored.labels.as_deref());
        of_storage.into_iter().for_each(heard);
        let film = |(index, camera)| each(index, &|progress| Ok(on_cpu.film(camera, size, progress)?));
        cameras.map(film).collect::<Made<_>>()?
    } else {
        RenderWarning::of_labels(job.reference()?.labels.as_ref()).into_iter().for_each(heard);
        let film = |(index, camera): (usize, &Camera)| {
            let job = PlannedJob { scene: seen_by(&job.scene, camera), ..job.clone() };
            each(index, &|progress| Ok(job.reference()?.film(size, progress)?.map(|number| number as f32)))
        };
        cameras.map(film).collect::<Made<_>>()?
    };
    for film in &films {
        // A ray that loses and gains nothing entered no macrocell with anything visible.
        let is_empty =
            film.accumulators.iter().all(|&sum| sum == 0.0) && film.transmittance.iter().all(|&left| left >= 1.0);
        RenderWarning::of_nothing(&job.scene, &job.planned, mix, is_empty.then_some(0)).into_iter().for_each(heard);
    }
    Ok(films)
}

#[pymethods]
impl Scene {
    /// A scene of a dict with the keys of SCENE.md, or its TOML text. `volume` and `labels` are what `Volume` takes; without a
    /// volume, the scene names one. Paths are relative to `base`.
    #[new]
    #[pyo3(signature = (description, volume=None, labels=None, *, base=None, name="scene", define=None))]
    fn new(
        py: Python<'_>,
        description: &Bound<'_, PyAny>,
        volume: Option<&Bound<'_, PyAny>>,
        labels: Option<&Bound<'_, PyAny>>,
        base: Option<PathBuf>,
        name: &str,
        define: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        if is_path(description)? && description.str()?.to_string().ends_with(".toml") {
            return Err(PyTypeError::new_err("a scene file is read by Scene.load(path) or relume.open(path)"));
        }
        let text = text_of(description)?;
        let given = volume.map(|volume| in_memory(volume, labels)).transpose()?;
        if labels.is_some() && given.is_none() {
            return Err(PyTypeError::new_err("labels need a volume: Scene(description, volume, labels)"));
        }
        let options = SceneOptions { definitions: definitions_of(define)?, ..SceneOptions::default() };
        let base = std::path::absolute(base.unwrap_or_else(|| ".".into()))?;
        work::run(py, None, |progress| {
            let file = match given {
                Some(given) => parse_on(given, name, &text, &base, &options, progress),
                None => parse(name, &text, &base, &options, progress),
            };
            Self::new_of(file?, None)
        })
    }

    /// The scene of a file. A `volume` takes the place of that of the file.
    #[classmethod]
    #[pyo3(signature = (path, volume=None, labels=None, *, define=None, progress=None))]
    fn load(
        _class: &Bound<'_, PyType>,
        py: Python<'_>,
        path: PathBuf,
        volume: Option<&Bound<'_, PyAny>>,
        labels: Option<&Bound<'_, PyAny>>,
        define: Option<&Bound<'_, PyDict>>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let options = SceneOptions { definitions: definitions_of(define)?, ..SceneOptions::default() };
        let given = volume.map(|volume| in_memory(volume, labels)).transpose()?;
        if labels.is_some() && given.is_none() {
            return Err(PyTypeError::new_err("labels need a volume: Scene.load(path, volume, labels)"));
        }
        work::run(py, progress, |progress| {
            let Some(given) = given else { return Self::new_of(load(&path, &options, progress)?, None) };
            let shown = path.display().to_string();
            let text = std::fs::read_to_string(&path).map_err(|error| {
                Failed::new("SceneError", "scene-unreadable", format!("cannot read {shown}: {error}"))
            })?;
            let base = path.parent().map(PathBuf::from).unwrap_or_default();
            Self::new_of(parse_on(given, &shown, &text, &base, &options, progress)?, None)
        })
    }

    /// The scene that Relume makes of the values of a volume, as `relume render VOLUME`; `look` names one of its looks,
    /// `preset` is a file of 3D Slicer or ParaView, and `guess` says why it is what it is.
    #[classmethod]
    #[pyo3(signature = (volume, labels=None, *, look=None, preset=None, define=None, progress=None))]
    fn first_look(
        _class: &Bound<'_, PyType>,
        py: Python<'_>,
        volume: &Bound<'_, PyAny>,
        labels: Option<&Bound<'_, PyAny>>,
        look: Option<&str>,
        preset: Option<PathBuf>,
        define: Option<&Bound<'_, PyDict>>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let options = options_of(look, preset, define)?;
        if is_path(volume)? && labels.is_none() {
            return opened(py, path_of(volume)?, options, progress);
        }
        first_looked(py, volume, labels, &options, progress)
    }

    /// The scene with other values of keys, `{"camera.azimuth": 40}` or nested, on the same volume.
    #[pyo3(signature = (definitions=None, *, quality=None))]
    fn define(&self, py: Python<'_>, definitions: Option<&Bound<'_, PyDict>>, quality: Option<&str>) -> PyResult<Self> {
        let (definitions, quality) = (definitions_of(definitions)?, quality_of(quality)?);
        work::run(py, None, |progress| {
            let changes = (quality, &*definitions);
            Self::new_of(redefined(&self.file, changes, progress)?, Some(self.statistics.clone()))
        })
    }

    /// The scene from a moved camera, as the window moves it: `orbit` in degrees to the right and up about the target, `pan` in
    /// picture heights to the right and up, `dolly` so that the target appears this many times as large, `roll` in degrees
    /// clockwise; in this order. `size` is that of the pictures.
    #[pyo3(signature = (*, orbit=None, pan=None, dolly=None, roll=None, size=None))]
    fn moved(
        &self,
        orbit: Option<&Bound<'_, PyAny>>,
        pan: Option<&Bound<'_, PyAny>>,
        dolly: Option<f64>,
        roll: Option<f64>,
        size: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let pair = |name: &str, stated: Option<&Bound<'_, PyAny>>| -> PyResult<Option<[f64; 2]>> {
            let wrong = |stated: &Bound<'_, PyAny>| {
                PyValueError::new_err(format!("{name}={stated}: two numbers are needed, (to the right, up)"))
            };
            stated.map(|stated| stated.extract().map_err(|_| wrong(stated))).transpose()
        };
        let (orbit, pan) = (pair("orbit", orbit)?, pair("pan", pan)?);
        if let Some(dolly) = dolly.filter(|dolly| !(*dolly > 0.0 && dolly.is_finite())) {
            return Err(PyValueError::new_err(format!(
                "dolly={dolly}: it is how many times as large the target appears, a number above 0"
            )));
        }
        let aspect = aspect(size_of(size)?);
        let steps = [
            orbit.map(|[right, up]| Move::Orbit { right, up }),
            pan.map(|[right, up]| Move::Pan { right, up }),
            dolly.map(Move::Dolly),
            roll.map(Move::Roll),
        ];
        let mut numbers = orbit.into_iter().chain(pan).flatten().chain(roll);
        if let Some(number) = numbers.find(|number| !number.is_finite()) {
            return Err(PyValueError::new_err(format!("a camera cannot move by {number}")));
        }
        let opened = &self.file.scene.camera;
        let mut scene = self.file.scene.clone();
        for step in steps.into_iter().flatten() {
            scene.camera = moved(&scene, opened, aspect, step);
        }
        let file = with_camera(&self.file, scene.camera).map_err(Failed::from)?;
        Ok(Self { file, statistics: self.statistics.clone() })
    }

    /// The scene from a turned camera, as `relume.live` shows it: `azimuth` and `elevation` in degrees (by default those of the scene),
    /// `zoom` as a lens, so that the eye stays, and `pan` in heights of the zoomed picture to the right and up. `size` is that of the pictures.
    #[pyo3(signature = (*, azimuth=None, elevation=None, zoom=1.0, pan=[0.0; 2], size=None))]
    fn turned(
        &self,
        azimuth: Option<f64>,
        elevation: Option<f64>,
        zoom: f64,
        pan: [f64; 2],
        size: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        if !(zoom > 0.0 && zoom.is_finite()) {
            return Err(PyValueError::new_err(format!("zoom={zoom}: it is a number above 0")));
        }
        let opened = &self.file.scene.camera;
        let of = Turned::of(opened);
        let turned =
            Turned { azimuth: azimuth.unwrap_or(of.azimuth), elevation: elevation.unwrap_or(of.elevation), zoom, pan };
        let mut numbers = [turned.azimuth, turned.elevation].into_iter().chain(pan);
        if let Some(number) = numbers.find(|number| !number.is_finite()) {
            return Err(PyValueError::new_err(format!("a camera cannot turn by {number}")));
        }
        if !(-89.9..=89.9).contains(&turned.elevation) {
            let elevation = turned.elevation;
            return Err(PyValueError::new_err(format!("elevation={elevation}: it is a number from -89.9 to 89.9")));
        }
        let camera = turned.camera(opened, &self.file.scene.frame.geometry, aspect(size_of(size)?));
        let camera = camera.ok_or_else(|| Failed::new("SceneError", "camera", "the camera has no line of sight"))?;
        let file = with_camera(&self.file, camera).map_err(Failed::from)?;
        Ok(Self { file, statistics: self.statistics.clone() })
    }

    /// The film with which a live widget opens, and its volume.
    #[pyo3(signature = (size=None, *, device=None, progress=None))]
    fn _live(
        &self,
        py: Python<'_>,
        size: Option<&Bound<'_, PyAny>>,
        device: Option<&Bound<'_, PyAny>>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<(Film, LiveVolume)> {
        let Asked { size, device, .. } = asked(size, device, None)?;
        if ["cpu", "reference"].contains(&device.as_str()) {
            return Err(PyValueError::new_err(format!(
                "device={device}: a live widget needs a Vulkan device for its first view and its light; Film.page and relume.view need none"
            )));
        }
        work::run(py, progress, |progress| {
            let ForReaders { scene, block, notes } = ForReaders::new(&self.file.scene, size, progress)?;
            let (of_page, notes): (Vec<_>, Vec<_>) = notes.into_iter().partition(|note| *note == LiveNote::Body);
            notes.iter().filter(|note| note.is_warning()).for_each(heard);
            let statistics = if block == [1; 3] {
                self.statistics.clone()
            } else {
                scene.volume().statistics().map_err(Failed::from)?
            };
            let camera = scene.camera.clone();
            let job = Job::new(scene, statistics).of_pictures(size, vec![camera]);
            let job = Job { keeps: Keeps::Weights, ..job }.planned(progress)?;
            job.planned.warnings.iter().for_each(heard);
            let mix = self.file.opening_mix();
            let (films, (volume, notes)) =
                device::marched_and(&device, &job, &mix, size, progress, |renderer, uploaded| {
                    Ok(live::packed(renderer, (&job.scene, &job.planned), uploaded, size, block)?)
                })
                .map_err(Failed::of_device_alone)?;
            notes.iter().filter(|note| note.is_warning()).for_each(heard);
            let none = || Failed::new("RelumeError", "film", "there is no film");
            let film = films.into_iter().next().ok_or_else(none)?;
            let dial = self.file.light.dial_of_film(&self.file.dial);
            Ok((
                Film::of(FilmFile::of_march(&job.scene, &job.planned, &mix, dial, film)?)?,
                LiveVolume { packed: volume, of_page: of_page.first().copied() },
            ))
        })
    }

    /// The films of a turntable, `columns` by `rows` of them, row by row from the top.
    #[pyo3(signature = (columns, rows, size, device=None, progress=None))]
    fn _around(
        &self,
        py: Python<'_>,
        columns: u16,
        rows: u16,
        size: Option<&Bound<'_, PyAny>>,
        device: Option<&Bound<'_, PyAny>>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Vec<Film>> {
        let asked = asked(size, device, None)?;
        work::run(py, progress, |progress| {
            let scene = &self.file.scene;
            scene.volume().prepare_coarse(progress)?;
            let none = || Failed::new("SceneError", "camera", "the camera has no line of sight to turn about");
            let cameras = around(scene, aspect(asked.size), [columns, rows]).ok_or_else(none)?;
            self.films(&asked, cameras, progress)
        })
    }

    /// The camera of pictures of `size`: a dict of `position`, the unit vectors `forward`, `right` and `up`, `half` (half the
    /// width and height of the picture, at distance 1 or, with `parallel` rays, in world units).
    #[pyo3(signature = (size=None))]
    fn view<'py>(&self, py: Python<'py>, size: Option<&Bound<'py, PyAny>>) -> PyResult<Bound<'py, PyDict>> {
        let scene = &self.file.scene;
        let view = scene.camera.view(&scene.frame.geometry, aspect(size_of(size)?));
        let view = view.ok_or_else(|| Failed::new("SceneError", "camera", "the camera has no line of sight"))?;
        let of = PyDict::new(py);
        for (name, vector) in
            [("position", view.eye), ("forward", view.forward), ("right", view.right), ("up", view.up)]
        {
            of.set_item(name, vector.to_array())?;
        }
        of.set_item("half", view.half)?;
        of.set_item("parallel", view.parallel)?;
        Ok(of)
    }

    /// Marches the scene once: the film, which any light relights. `size` is (width, height). `device` is "auto", a part of the name of a Vulkan
    /// device, its number, "cpu" (all cores, without Vulkan) or "reference" (f64, slow). `lights` are further lights, by
    /// name, for which a colour model is planned. `max_error` takes the fastest setting within this ΔE00 in 95 % of the pixels,
    /// `budget_ms` the most accurate one of which a frame takes so many milliseconds; both measure first, and `film.choice` says
    /// what was found. `progress(stage, done, total)` may cancel by returning False.
    #[pyo3(signature = (size=None, *, device=None, lights=None, max_error=None, budget_ms=None, progress=None))]
    fn render(
        &self,
        py: Python<'_>,
        size: Option<&Bound<'_, PyAny>>,
        device: Option<&Bound<'_, PyAny>>,
        lights: Option<&Bound<'_, PyDict>>,
        max_error: Option<f64>,
        budget_ms: Option<f64>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Film> {
        let asked = Asked { goal: goal_of(max_error, budget_ms)?, ..asked(size, device, lights)? };
        if asked.goal.is_some() && ["cpu", "reference"].contains(&asked.device.as_str()) {
            return Err(PyValueError::new_err("max_error and budget_ms choose a setting for a Vulkan device"));
        }
        work::run(py, progress, |progress| self.film(&asked, progress))
    }

    /// The volume.
    #[getter]
    fn volume(&self) -> Volume {
        Volume(Arc::clone(&self.file.scene.fields.first().volume))
    }

    /// The label map, if there is one.
    #[getter]
    fn labels(&self) -> Option<Volume> {
        self.file.scene.labels.as_ref().map(|labels| Volume(Arc::clone(&labels.volume)))
    }

    /// TOML text of the scene, with its definitions.
    #[getter]
    fn toml(&self) -> &str {
        &self.file.text
    }

    /// Why a first look is what it is.
    #[getter]
    fn guess(&self) -> Option<&str> {
        self.file.guess.as_deref()
    }

    /// Reflectances of the materials, by name.
    #[getter]
    fn materials<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let of = self.file.scene.materials.iter();
        by_name(py, of.map(|it| (it.name.as_str(), spectra::array(py, it.reflectance.spectrum()))))
    }

    /// Spectra of the lights, by name, of luminance 1.
    #[getter]
    fn lights<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let of = self.file.scene.lights.iter();
        by_name(py, of.map(|it| (it.name.as_str(), spectra::array(py, it.spectrum.spectrum()))))
    }

    /// Features that a march of this scene computes, with reasons, in sentences.
    fn explain(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        work::run(py, None, |progress| {
            let planned = plan(&self.file.scene, progress)?;
            Ok(planned.explain(&self.file.scene))
        })
    }

    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        other.cast::<Self>().is_ok_and(|other| {
            let (ours, theirs) = (&self.file, &other.get().file);
            ours.text == theirs.text && ours.scene.digest() == theirs.scene.digest()
        })
    }

    fn __hash__(&self) -> u64 {
        hash_of(&&*self.file.text)
    }

    fn __reduce__<'py>(
        slf: &Bound<'py, Self>,
    ) -> PyResult<(Bound<'py, PyAny>, (String, Volume, Option<Volume>, PathBuf, String, Vec<(String, Volume)>))> {
        let scene = slf.get();
        let made = slf.py().import("relume._relume")?.getattr("_scene_of")?;
        let (text, base) = (scene.file.text.to_string(), scene.file.base.clone());
        let further = scene.file.scene.fields.further().iter();
        let further = further.map(|field| (field.name.clone(), Volume(Arc::clone(&field.volume)))).collect();
        Ok((made, (text, scene.volume(), scene.labels(), base, scene.file.scene.name.clone(), further)))
    }

    fn __repr__(&self) -> String {
        let names = |names: Vec<&str>| names.join(", ");
        let scene = &self.file.scene;
        format!(
            "<relume.Scene {}: {}; lights {}>",
            scene.name,
            names(scene.materials.iter().map(|it| it.name.as_str()).collect()),
            names(scene.lights.iter().map(|it| it.name.as_str()).collect())
        )
    }

    /// A picture of 256 pixels, in a notebook.
    fn _repr_png_<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let small = |device: &str| Asked { size: [256; 2], device: device.to_owned(), lights: Vec::new(), goal: None };
        let film = work::run(py, None, |progress| match self.film(&small("auto"), progress) {
            Err(failed) if failed.is_of_device() => self.film(&small("cpu"), progress),
            film => film,
        })?;
        film._repr_png_(py)
    }
}

/// Width over height of a picture.
fn aspect(size: [usize; 2]) -> f64 {
    let [width, height] = size.map(|side| u32::try_from(side).map_or(f64::INFINITY, f64::from));
    width / height
}

/// The size of a picture: (width, height), by default 800 × 800.
fn size_of(size: Option<&Bound<'_, PyAny>>) -> PyResult<[usize; 2]> {
    let Some(size) = size else { return Ok([800; 2]) };
    match size.extract::<[i64; 2]>().map(|sides| sides.map(usize::try_from)) {
        Ok([Ok(width), Ok(height)]) if [width, height].iter().all(|side| (1..=65_536).contains(side)) => {
            Ok([width, height])
        }
        _ => Err(PyValueError::new_err(format!(
            "size {size}: write (width, height), whole numbers of pixels from 1 to 65536"
        ))),
    }
}

fn asked(
    size: Option<&Bound<'_, PyAny>>,
    device: Option<&Bound<'_, PyAny>>,
    lights: Option<&Bound<'_, PyDict>>,
) -> PyResult<Asked> {
    let device = device.map_or_else(|| Ok("auto".to_owned()), |device| device.str().map(|name| name.to_string()))?;
    let known = ["cpu", "reference"].into_iter().find(|known| device.eq_ignore_ascii_case(known));
    let device = known.map_or(device, str::to_owned);
    let lights = lights.into_iter().flatten();
    let lights = lights.map(|(name, light)| Ok((name.str()?.to_string(), spectra::light_of(&light)?)));
    Ok(Asked { size: size_of(size)?, device, lights: lights.collect::<PyResult<_>>()?, goal: None })
}

/// The goal of a search for settings.
fn goal_of(max_error: Option<f64>, budget_ms: Option<f64>) -> PyResult<Option<Goal>> {
    let checked = |name: &str, number: f64| match number > 0.0 && number.is_finite() {
        true => Ok(number),
        false => Err(PyValueError::new_err(format!("{name} {number}: it is a number above 0"))),
    };
    match (max_error, budget_ms) {
        (None, None) => Ok(None),
        (Some(error), None) => checked("max_error", error).map(|error| Some(Goal::MaxError(error))),
        (None, Some(ms)) => checked("budget_ms", ms).map(|ms| Some(Goal::Budget(ms))),
        _ => Err(PyTypeError::new_err("give max_error or budget_ms")),
    }
}

fn options_of(
    look: Option<&str>,
    preset: Option<PathBuf>,
    define: Option<&Bound<'_, PyDict>>,
) -> PyResult<SceneOptions> {
    if look.is_some() && preset.is_some() {
        return Err(PyTypeError::new_err("give a look or a preset"));
    }
    let look = look.map(Look::named).transpose().map_err(|message| Failed::new("SceneError", "look", message))?;
    let wish = Wish { look, ..Wish::default() };
    Ok(SceneOptions { definitions: definitions_of(define)?, wish, preset, ..SceneOptions::default() })
}

fn opened(
    py: Python<'_>,
    path: PathBuf,
    options: SceneOptions,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Scene> {
    let source = Source { path: Some(std::path::absolute(path)?), options };
    if source.bare_volume().is_none() && (!source.options.wish.is_none() || source.options.preset.is_some()) {
        return Err(PyTypeError::new_err("a look or a preset is for a volume, and this is a scene"));
    }
    work::run(py, progress, |progress| {
        let (file, statistics) = source.read(progress)?;
        file.scene.volume().notes.iter().for_each(heard);
        Scene::new_of(file, Some(statistics))
    })
}

/// The scene of a file: a scene, or a volume with a first look, as `relume render FILE`; or the first look of an array or an image, as
/// `Scene.first_look`.
#[pyfunction]
#[pyo3(signature = (path, *, look=None, preset=None, define=None, quality=None, progress=None))]
pub(crate) fn open(
    py: Python<'_>,
    path: &Bound<'_, PyAny>,
    look: Option<&str>,
    preset: Option<PathBuf>,
    define: Option<&Bound<'_, PyDict>>,
    quality: Option<&str>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Scene> {
    let options = SceneOptions { quality: quality_of(quality)?, ..options_of(look, preset, define)? };
    if is_path(path)? {
        return opened(py, path_of(path)?, options, progress);
    }
    first_looked(py, path, None, &options, progress)
}

/// The first look of a volume in memory.
fn first_looked(
    py: Python<'_>,
    volume: &Bound<'_, PyAny>,
    labels: Option<&Bound<'_, PyAny>>,
    options: &SceneOptions,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Scene> {
    let given = in_memory(volume, labels)?;
    work::run(py, progress, |progress| {
        let (file, statistics) = first_look_of(given, options, progress)?;
        Scene::new_of(file, Some(statistics))
    })
}

/// The built-in scene.
#[pyfunction]
pub(crate) fn example(py: Python<'_>) -> PyResult<Scene> {
    work::run(py, None, |progress| {
        let (file, statistics) = Source::default().read(progress)?;
        Scene::new_of(file, Some(statistics))
    })
}

/// The scene of a pickle.
#[pyfunction]
pub(crate) fn _scene_of(
    py: Python<'_>,
    text: String,
    volume: &Bound<'_, PyAny>,
    labels: Option<&Bound<'_, PyAny>>,
    base: PathBuf,
    name: &str,
    further: Vec<(String, Bound<'_, PyAny>)>,
) -> PyResult<Scene> {
    let mut given = in_memory(volume, labels)?;
    let of = |(name, volume): (String, Bound<'_, PyAny>)| PyResult::Ok((name, Volume::of(&volume)?));
    given.further = further.into_iter().map(of).collect::<PyResult<_>>()?;
    work::run(py, None, |progress| {
        let file = parse_ready(given, (name, &text), &base, &[], progress)?;
        Scene::new_of(file, None)
    })
}

fn by_name<'py>(
    py: Python<'py>,
    spectra: impl Iterator<Item = (impl AsRef<str>, Bound<'py, PyArray1<f64>>)>,
) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    for (name, spectrum) in spectra {
        dict.set_item(name.as_ref(), spectrum)?;
    }
    Ok(dict)
}
