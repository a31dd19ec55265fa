//! `Film`: a march's result, relit by any light.

use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};
use numpy::ndarray::Dim;
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods as _, PyReadwriteArray3, PyUntypedArrayMethods as _};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList, PyString, PyTuple, PyType};
use relume::document::{KeptFilm, LightRequest, requested, spread};
use relume::film::{Components, RelightMatrices, Relightable, automatic_exposure};
use relume::measure::Choice;
use relume::output::page::{self, PackedPage, Page};
use relume::output::{Alpha, Depth, FilmFile, Picture, PictureKind, display_codes, png_bytes, write_png};
use relume::scene::key::Named as _;
use relume::scene::{Backdrop, INTENSITY, Mix, MixLight, Tone};
use relume::spectrum::BANDS;
use relume::tables::Reflected;

use crate::errors::{Failed, Made};
use crate::scene::LiveVolume;
use crate::spectra;
use crate::volume::{hash_of, is_path, view};
use crate::work;

/// The film of a march: per pixel, numbers that do not depend on the spectrum of any light.
#[pyclass(frozen, module = "relume")]
pub(crate) struct Film(KeptFilm, Option<Choice>);

/// The error of a name that the film does not have.
fn unknown(message: String) -> PyErr {
    Failed::new("UnknownNameError", "name-unknown", message).into()
}

/// How a film is relit.
struct Lit {
    mix: Mix,
    means: Relightable,
}

impl Film {
    pub(crate) fn of(file: FilmFile) -> Made<Self> {
        if let Some(part) = &file.part {
            work::heard(format!("the film is a part: {}; `relume composite` makes the whole film", part.named()));
        }
        Ok(Self(KeptFilm::new(file)?, None))
    }

    /// The same with the reason of its setting.
    pub(crate) fn chosen(self, choice: Option<Choice>) -> Self {
        Self(self.0, choice)
    }

    /// The film and its meaning.
    pub(crate) const fn kept(&self) -> &KeptFilm {
        &self.0
    }

    fn rows_and_columns(&self) -> [usize; 2] {
        let [width, height] = self.0.film.size;
        [height, width]
    }

    /// The position of a name.
    fn position(&self, name: &Bound<'_, PyAny>) -> PyResult<usize> {
        let name = name.str()?.to_string();
        let kept = &self.0;
        let found = kept.positions.iter().position(|position| *position == name);
        let of_light = || kept.mix.0.iter().find(|light| light.name == name).map(|light| light.position);
        found
            .or_else(of_light)
            .ok_or_else(|| unknown(format!("there is no position {name:?}; there are: {}", kept.positions.join(", "))))
    }

    /// The mix of requests as texts.
    fn mix_of_texts(&self, texts: &[String]) -> PyResult<Vec<MixLight>> {
        let kept = &self.0;
        let requests: Vec<LightRequest> = texts.iter().cloned().map(LightRequest).collect();
        let asked = requested(&kept.mix, &kept.shown, &kept.positions, &requests, Path::new(""));
        asked.map(|asked| asked.mix.0).map_err(|error| unknown(relume::document::chain(&error)))
    }

    /// The lights of one item: a name or a spectrum, with its weight and position.
    fn lights_of(
        &self,
        light: &Bound<'_, PyAny>,
        weight: f64,
        position: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Vec<MixLight>> {
        if !INTENSITY.contains(&weight) {
            let [least, most] = [INTENSITY.start(), INTENSITY.end()];
            return Err(PyValueError::new_err(format!("the weight {weight} is not a number from {least} to {most}")));
        }
        let kept = &self.0;
        let position = position.map(|name| self.position(name)).transpose()?;
        if let Ok(name) = light.cast::<PyString>() {
            let lights = self.mix_of_texts(&[name.to_cow()?.into_owned()])?;
            let with = |light: MixLight| MixLight {
                weight: light.weight * weight,
                position: position.unwrap_or(light.position),
                ..light
            };
            // At a stated position, a light of the scene has its intensity, and any other its plain weight.
            return Ok(match position {
                Some(position) if !kept.mix.0.iter().any(|it| Some(&it.name) == lights.first().map(|it| &it.name)) => {
                    let first = lights.into_iter().next();
                    first.map(|light| MixLight { weight, position, ..light }).into_iter().collect()
                }
                _ => lights.into_iter().map(with).collect(),
            });
        }
        if kept.positions.is_empty() {
            return Err(PyValueError::new_err(
                "the scene has no lights, so there is no position from which a light could shine",
            ));
        }
        let spectrum = spectra::light_of(light)?;
        let light = MixLight { name: "array".to_owned(), spectrum, weight, position: position.unwrap_or(0) };
        Ok(match position {
            Some(_) => vec![light],
            None => spread(light, &kept.mix, &kept.shown, &kept.positions).0,
        })
    }

    /// The mix of `light`: a name, a dict of weights by name, a list, or a spectrum.
    fn mix_of(&self, light: &Bound<'_, PyAny>) -> PyResult<Mix> {
        if let Ok(text) = light.cast::<PyString>() {
            return Ok(Mix(self.mix_of_texts(&[text.to_cow()?.into_owned()])?));
        }
        if let Ok(weights) = light.cast::<PyDict>() {
            let is_mix = !spectra::is_form(weights);
            if is_mix {
                let lights = weights.iter().map(|(name, weight)| self.lights_of(&name, weight.extract()?, None));
                return Ok(Mix(lights.collect::<PyResult<Vec<_>>>()?.concat()));
            }
            return Ok(Mix(self.lights_of(light, 1.0, None)?));
        }
        let is_list = light.cast::<PyList>().is_ok_and(|list| {
            list.iter().any(|item| item.cast::<PyTuple>().is_ok() || item.cast::<PyString>().is_ok())
        });
        if !is_list {
            return Ok(Mix(self.lights_of(light, 1.0, None)?));
        }
        let mut lights = Vec::new();
        for item in light.try_iter()? {
            let item = item?;
            let Ok(parts) = item.cast::<PyTuple>() else {
                lights.extend(self.lights_of(&item, 1.0, None)?);
                continue;
            };
            if parts.is_empty() || parts.len() > 3 {
                return Err(PyTypeError::new_err("a light is (name or spectrum, weight, position)"));
            }
            let weight = parts.get_item(1).ok().map_or(Ok(1.0), |weight| weight.extract())?;
            let position = parts.get_item(2).ok().filter(|position| !position.is_none());
            lights.extend(self.lights_of(&parts.get_item(0)?, weight, position.as_ref())?);
        }
        Ok(Mix(lights))
    }

    /// The mix and the meaning of the numbers under it. A colour model is fitted to a light that it does not have.
    fn lit(&self, py: Python<'_>, asked: &Asked<'_, '_>) -> PyResult<Lit> {
        work::warned(py, || self.lit_by(asked))
    }

    fn lit_by(&self, asked: &Asked<'_, '_>) -> PyResult<Lit> {
        let kept = &self.0;
        let given = [asked.light.is_some(), asked.hand.is_some(), asked.preset.is_some()];
        if given.iter().filter(|it| **it).count() > 1 {
            return Err(PyTypeError::new_err("give one of light, hand and preset"));
        }
        let mix = match (asked.light, asked.hand, asked.preset) {
            (Some(light), ..) => self.mix_of(light)?,
            (_, Some([x, y]), _) => {
                if !(x.is_finite() && y.is_finite()) {
                    return Err(PyValueError::new_err(format!("the hand ({x}, {y}) is no place")));
                }
                kept.dial.mix(DVec2::new(x, y), &kept.mix)
            }
            (_, _, Some(name)) => {
                let (dial, preset) = kept.dial.preset(name).map_err(unknown)?;
                dial.mix(preset.hand, &kept.mix)
            }
            _ => kept.shown.clone(),
        };
        let mut means = kept.means.clone();
        if let Some(year) = asked.observer {
            means.see_by(spectra::observer_of(year)?).map_err(Failed::from)?;
        }
        let exposure = asked.exposure.as_ref().map(Exposure::read).transpose()?;
        if let Some(Some(exposure)) = exposure {
            if !(exposure > 0.0 && exposure <= 1e9) {
                return Err(PyValueError::new_err(format!(
                    "exposure {exposure}: it is a factor above 0 and at most 1e9, or \"auto\""
                )));
            }
            means.display.exposure = Some(exposure);
        }
        means.display.adapt = asked.adapt.unwrap_or(means.display.adapt);
        means.display.tone = asked.tone.map_or(Ok(means.display.tone), tone_of)?;
        for light in means.learn(&mix, kept.tolerance).map_err(Failed::from)? {
            work::heard(light);
        }
        if exposure == Some(None) {
            means.display.exposure = None;
            let picture = kept.film.rgba(&means.under(&mix));
            means.display.exposure = Some(automatic_exposure(&picture, &mix, &means.display));
        }
        Ok(Lit { mix, means })
    }

    /// Linear RGBA under the light of `asked`, as its tone displays it.
    fn displayed(&self, py: Python<'_>, asked: &Asked<'_, '_>) -> PyResult<Vec<f32>> {
        let Lit { mix, means } = self.lit(py, asked)?;
        let film = &self.0.film;
        Ok(work::detached(py, || {
            let mut linear = film.rgba(&means.under(&mix));
            means.display.tone.show(&mut linear);
            let backdrop = means.display.backdrop.colours().filter(|_| means.background.is_none());
            if let Some(colours) = backdrop {
                Backdrop::behind(colours, &mut linear, film.size[0]);
            }
            linear
        }))
    }

    /// Linear RGBA under the light of `asked`.
    fn linear(&self, py: Python<'_>, asked: &Asked<'_, '_>) -> PyResult<Vec<f32>> {
        let Lit { mix, means } = self.lit(py, asked)?;
        let film = &self.0.film;
        Ok(work::detached(py, || film.rgba(&means.under(&mix))))
    }

    fn packed(
        &self,
        title: Option<&str>,
        tolerance: Option<f64>,
        progress: &dyn relume::progress::Progress,
    ) -> Made<PackedPage> {
        Ok(self.as_page(title, tolerance).packed(progress)?)
    }

    /// The film as a page of one view.
    fn as_page<'a>(&'a self, title: Option<&'a str>, tolerance: Option<f64>) -> Page<'a> {
        let kept = &self.0;
        Page {
            film: &kept.header,
            views: std::slice::from_ref(&kept.film),
            columns: 1,
            title: title.unwrap_or(page::TITLE),
            tolerance: tolerance.unwrap_or(page::TOLERANCE),
        }
    }
}

/// Light and display of a picture; what is not given is as rendered.
#[derive(Default)]
struct Asked<'a, 'py> {
    light: Option<&'a Bound<'py, PyAny>>,
    hand: Option<[f64; 2]>,
    preset: Option<&'a str>,
    exposure: Option<Exposure>,
    tone: Option<&'a str>,
    observer: Option<&'a Bound<'py, PyAny>>,
    adapt: Option<bool>,
}

/// A requested exposure.
#[derive(FromPyObject)]
enum Exposure {
    Factor(f64),
    Word(String),
}

impl Exposure {
    /// The factor; `None` is an automatic one.
    fn read(&self) -> PyResult<Option<f64>> {
        match self {
            Self::Factor(factor) => Ok(Some(*factor)),
            Self::Word(word) if word == "auto" => Ok(None),
            Self::Word(word) => Err(PyValueError::new_err(format!(
                "exposure {word:?}: it is a factor above 0 and at most 1e9, or \"auto\""
            ))),
        }
    }
}

/// The tone of this name.
fn tone_of(name: &str) -> PyResult<Tone> {
    Tone::named(name, "the tones").map_err(PyValueError::new_err)
}

#[pymethods]
impl Film {
    /// Width and height in pixels.
    #[getter]
    fn size(&self) -> (usize, usize) {
        (self.0.film.size[0], self.0.film.size[1])
    }

    /// Numbers of the pixels, float32 (positions, components, rows, columns): a view, read-only.
    #[getter]
    fn weights<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        let film = slf.get();
        let [rows, columns] = film.rows_and_columns();
        let shape = [film.0.positions.len(), film.0.film.components, rows, columns];
        Ok(view(slf.clone().into_any(), &film.0.film.accumulators, Dim(shape))?.into_any())
    }

    /// Light from behind that reaches the camera, float32 (1 or components, rows, columns): a view, read-only.
    #[getter]
    fn transmittance<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        let film = slf.get();
        let [rows, columns] = film.rows_and_columns();
        let numbers = &film.0.film.transmittance;
        let shape = [numbers.len() / (rows * columns).max(1), rows, columns];
        Ok(view(slf.clone().into_any(), numbers, Dim(shape))?.into_any())
    }

    /// Names of the light positions.
    #[getter]
    fn positions(&self) -> Vec<String> {
        self.0.positions.clone()
    }

    /// Names of the components: materials, or numbers of the coefficients of a colour model.
    #[getter]
    fn components(&self) -> Vec<String> {
        self.0.header.component_names()
    }

    /// Lights of the scene: a dict by name of `spectrum`, `weight` and `position`.
    #[getter]
    fn lights<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let all = PyDict::new(py);
        for light in &self.0.mix.0 {
            let one = PyDict::new(py);
            one.set_item("spectrum", spectra::array(py, light.spectrum.spectrum()))?;
            one.set_item("weight", light.weight)?;
            one.set_item("position", self.0.positions.get(light.position))?;
            all.set_item(&light.name, one)?;
        }
        Ok(all)
    }

    /// Reflectances of the materials, by name; empty with a colour model.
    #[getter]
    fn materials<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let all = PyDict::new(py);
        for (name, spectrum) in &self.0.materials {
            all.set_item(name, spectra::array(py, spectrum))?;
        }
        Ok(all)
    }

    /// The colour model in words; `None` where pixels hold weights of materials, which are exact under any light.
    #[getter]
    fn model(&self) -> Option<String> {
        match &self.0.means.components {
            Components::Model(model, _) => Some(model.description()),
            Components::Surfaces(_) => None,
        }
    }

    /// The setting of a render with `max_error` or `budget_ms`, as measured: `why` in a sentence, `setting`, and what is
    /// `expected` of time and error; `None` without these, and after a pickle or a file.
    #[getter]
    fn choice<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let Some(choice) = &self.1 else { return Ok(None) };
        let text = serde_json::json!({"why": choice.why, "setting": choice.setting, "expected": choice.point, "scattered_light": choice.scattered, "untried": choice.untried});
        Ok(Some(py.import("json")?.call_method1("loads", (text.to_string(),))?))
    }

    /// The light dial: `nodes` (light, place, on), `presets` (name, caption, hand), `normalise`, `master`.
    #[getter]
    fn dial<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dial = &self.0.dial;
        let of = PyDict::new(py);
        let nodes: Vec<_> =
            dial.nodes.iter().map(|node| (node.light.as_str(), node.place.to_array(), node.on)).collect();
        of.set_item("nodes", nodes)?;
        let presets = dial.presets.iter().map(|it| (it.name.as_str(), it.caption.as_str(), it.hand.to_array()));
        of.set_item("presets", presets.collect::<Vec<_>>())?;
        of.set_item("normalise", dial.normalise)?;
        of.set_item("master", dial.master)?;
        Ok(of)
    }

    /// The picture under a light: linear sRGB and opacity, float32 (rows, columns, 4); or, `encoded`, the codes of the PNG,
    /// uint8 (rows, columns, 3).
    ///
    /// `light` is a name (of the scene, a standard, a file), a dict of weights by name, a list of (name or spectrum, weight,
    /// position), or a spectrum; `hand` and `preset` are of the dial. Without them, the light is as rendered. `out` takes
    /// the place of a new array.
    #[pyo3(signature = (light=None, *, hand=None, preset=None, exposure=None, tone=None, observer=None, adapt=None, encoded=false, out=None))]
    fn relight<'py>(
        &self,
        py: Python<'py>,
        light: Option<&Bound<'py, PyAny>>,
        hand: Option<[f64; 2]>,
        preset: Option<&str>,
        exposure: Option<Exposure>,
        tone: Option<&str>,
        observer: Option<&Bound<'py, PyAny>>,
        adapt: Option<bool>,
        encoded: bool,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let asked = Asked { light, hand, preset, exposure, tone, observer, adapt };
        let [rows, columns] = self.rows_and_columns();
        if tone.is_some() && !encoded {
            return Err(PyTypeError::new_err("tone is for encoded pictures; linear ones have none"));
        }
        if encoded {
            if out.is_some() {
                return Err(PyTypeError::new_err("out is for linear pictures; encoded makes an array of its own"));
            }
            let linear = self.displayed(py, &asked)?;
            let codes = work::detached(py, || -> Made<Vec<u8>> {
                let picture = Picture::new(columns, rows, &linear)?;
                Ok(display_codes(&picture, Depth::Eight, Alpha::OverBlack))
            })?;
            return Ok(PyArray1::from_vec(py, codes).reshape([rows, columns, 3])?.into_any());
        }
        let Some(out) = out else {
            let linear = self.linear(py, &asked)?;
            return Ok(PyArray1::from_vec(py, linear).reshape([rows, columns, 4])?.into_any());
        };
        let array = out.cast::<PyArray3<f32>>().map_err(|_| PyTypeError::new_err("out is an array of float32"))?;
        if array.shape() != [rows, columns, 4] {
            return Err(PyValueError::new_err(format!(
                "out is {:?}, and the picture {:?}",
                array.shape(),
                [rows, columns, 4]
            )));
        }
        let mut numbers: PyReadwriteArray3<'_, f32> =
            array.try_readwrite().map_err(|error| PyValueError::new_err(format!("out: {error}")))?;
        let numbers = numbers.as_slice_mut().map_err(|_| PyValueError::new_err("out is not in C order"))?;
        let Lit { mix, means } = self.lit(py, &asked)?;
        let film = &self.0.film;
        work::detached(py, || film.relight_into(&means.under(&mix), numbers));
        Ok(out.clone())
    }

    /// Linear sRGB per unit of each number under a light: float64 (positions, components, 3) of the weights, and (1 or
    /// components, 3) of the transmittance. A picture is their sum over the numbers of a pixel.
    #[pyo3(signature = (light=None, *, hand=None, preset=None, exposure=None, observer=None, adapt=None))]
    fn matrices<'py>(
        &self,
        py: Python<'py>,
        light: Option<&Bound<'py, PyAny>>,
        hand: Option<[f64; 2]>,
        preset: Option<&str>,
        exposure: Option<Exposure>,
        observer: Option<&Bound<'py, PyAny>>,
        adapt: Option<bool>,
    ) -> PyResult<(Bound<'py, PyArray3<f64>>, Bound<'py, PyArray2<f64>>)> {
        let Lit { mix, means } = self.lit(py, &Asked { light, hand, preset, exposure, tone: None, observer, adapt })?;
        let RelightMatrices { colours, background, .. } = means.under(&mix);
        let numbers = |colours: &[DVec3]| colours.iter().flat_map(|colour| colour.to_array()).collect::<Vec<f64>>();
        let components = self.0.film.components;
        let positions = self.0.positions.len();
        let of_weights = PyArray1::from_vec(py, numbers(&colours)).reshape([positions, components, 3])?;
        let behind = PyArray1::from_vec(py, numbers(&background)).reshape([background.len(), 3])?;
        Ok((of_weights, behind))
    }

    /// Radiance of every pixel under a light, float32 (rows, columns, 81), at `relume.WAVELENGTHS`. With a colour model, spectra
    /// are estimates.
    #[pyo3(signature = (light=None, *, hand=None, preset=None))]
    fn spectra<'py>(
        &self,
        py: Python<'py>,
        light: Option<&Bound<'py, PyAny>>,
        hand: Option<[f64; 2]>,
        preset: Option<&str>,
    ) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let Lit { mix, means } = self.lit(py, &Asked { light, hand, preset, ..Asked::default() })?;
        let film = &self.0.film;
        let numbers = work::detached(py, || {
            let reflected = Reflected::new(&means.components, means.background.as_ref());
            let mut numbers = vec![0.0; film.pixels() * BANDS];
            Reflected::write(&reflected.under(&mix, means.positions), film, 0, &mut numbers);
            numbers
        });
        let [rows, columns] = self.rows_and_columns();
        PyArray1::from_vec(py, numbers).reshape([rows, columns, BANDS])
    }

    /// Writes the film file of `relume render --accumulators`.
    fn to_exr(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        Ok(work::detached(py, || self.0.write(&path).map_err(Failed::from))?)
    }

    /// The bytes of the film file.
    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let bytes = work::detached(py, || self.0.to_bytes().map_err(Failed::from))?;
        Ok(PyBytes::new(py, &bytes))
    }

    /// The film of a film file: its path or its bytes.
    #[classmethod]
    fn from_exr(_class: &Bound<'_, PyType>, py: Python<'_>, file: &Bound<'_, PyAny>) -> PyResult<Self> {
        if is_path(file)? {
            let path: PathBuf = file.extract()?;
            return work::run(py, None, |_| Self::of(FilmFile::read(&path)?));
        }
        let bytes: Vec<u8> =
            file.extract().map_err(|_| PyTypeError::new_err("a film file is given by its path or its bytes"))?;
        work::run(py, None, |_| Self::of(FilmFile::from_bytes(&bytes, "the film")?))
    }

    /// Writes the picture under a light as a PNG, as `relume relight -o FILE.png`.
    #[pyo3(signature = (path, light=None, *, hand=None, preset=None, exposure=None, tone=None, observer=None, adapt=None))]
    fn to_png<'py>(
        &self,
        py: Python<'py>,
        path: PathBuf,
        light: Option<&Bound<'py, PyAny>>,
        hand: Option<[f64; 2]>,
        preset: Option<&str>,
        exposure: Option<Exposure>,
        tone: Option<&str>,
        observer: Option<&Bound<'py, PyAny>>,
        adapt: Option<bool>,
    ) -> PyResult<()> {
        if !matches!(PictureKind::of(&path), Ok(PictureKind::Png)) {
            let message = format!("{}: the name of a PNG must end in .png", path.display());
            return Err(Failed::new("OutputError", "picture-name", message).into());
        }
        let linear = self.displayed(py, &Asked { light, hand, preset, exposure, tone, observer, adapt })?;
        let [rows, columns] = self.rows_and_columns();
        Ok(work::detached(py, || -> Made<()> {
            Ok(write_png(&path, &Picture::new(columns, rows, &linear)?, Depth::Eight, Alpha::OverBlack)?)
        })?)
    }

    /// A page that relights in a browser, as HTML text. Packing adds at most the ΔE00 `tolerance`.
    #[pyo3(signature = (title=None, tolerance=None, *, progress=None))]
    fn html(
        &self,
        py: Python<'_>,
        title: Option<&str>,
        tolerance: Option<f64>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<String> {
        Ok(work::run(py, progress, |progress| self.packed(title, tolerance, progress))?.html)
    }

    /// Writes the page as a file.
    #[pyo3(signature = (path, title=None, tolerance=None, *, progress=None))]
    fn page(
        &self,
        py: Python<'_>,
        path: PathBuf,
        title: Option<&str>,
        tolerance: Option<f64>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        work::run(py, progress, |progress| {
            page::check_name(&path)?;
            Ok(self.packed(title, tolerance, progress)?.write(&path)?)
        })
    }

    /// Writes a page whose reader turns the `volume`, with this as its finished view.
    #[pyo3(signature = (path, volume, title=None, tolerance=None))]
    fn _live_page(
        &self,
        py: Python<'_>,
        path: PathBuf,
        volume: &Bound<'_, LiveVolume>,
        title: Option<&str>,
        tolerance: Option<f64>,
    ) -> PyResult<()> {
        let LiveVolume { packed: volume, of_page } = volume.get();
        work::run(py, None, |progress| {
            of_page.iter().for_each(work::heard);
            page::check_name(&path)?;
            Ok(self.as_page(title, tolerance).with_live(Some(volume), progress)?.write(&path)?)
        })
    }

    /// The parts of a page for a widget: its JSON, its packed view, and the step of its rounding; with a `step`, that of an earlier
    /// page in place of a search.
    #[pyo3(signature = (title, tolerance=None, step=None, *, progress=None))]
    fn _packed<'py>(
        &self,
        py: Python<'py>,
        title: Option<&str>,
        tolerance: Option<f64>,
        step: Option<f64>,
        progress: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<(String, Bound<'py, PyBytes>, f64)> {
        let (json, views, step) = work::run(py, progress, |progress| {
            if let Some(step) = step {
                let (json, views) = self.as_page(title, tolerance).packed_at(step, progress)?;
                return Ok((json, views, step));
            }
            let packed = self.packed(title, tolerance, progress)?;
            Ok((packed.json, packed.views, packed.summary.step))
        })?;
        Ok((json, PyBytes::new(py, views.first().map_or(&[], Vec::as_slice)), step))
    }

    /// The page in a frame of a notebook, and the PNG for front ends without frames.
    #[pyo3(signature = (title=None, tolerance=None, *, height=760))]
    fn frame<'py>(
        &self,
        py: Python<'py>,
        title: Option<&str>,
        tolerance: Option<f64>,
        height: usize,
    ) -> PyResult<Bound<'py, PyAny>> {
        let packed = work::run(py, None, |progress| self.packed(title, tolerance, progress))?;
        let framed = packed.framed(title.unwrap_or(page::TITLE), height);
        py.import("relume._notebook")?.getattr("Frame")?.call1((framed, self._repr_png_(py)?))
    }

    /// The picture as rendered, in a notebook.
    pub(crate) fn _repr_png_<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let linear = self.displayed(py, &Asked::default())?;
        let [rows, columns] = self.rows_and_columns();
        let png = work::detached(py, || -> Made<Vec<u8>> {
            Ok(png_bytes(&Picture::new(columns, rows, &linear)?, Depth::Eight, Alpha::OverBlack)?)
        })?;
        Ok(PyBytes::new(py, &png))
    }

    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        other.cast::<Self>().is_ok_and(|other| {
            let other = &other.get().0;
            self.0.header == other.header && self.0.film == other.film
        })
    }

    fn __hash__(&self) -> u64 {
        let kept = &self.0;
        hash_of(&(kept.film.size, kept.film.components, &kept.positions))
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        let py = slf.py();
        Ok((py.get_type::<Self>().getattr("from_exr")?, (slf.get().to_bytes(py)?,)))
    }

    fn __repr__(&self) -> String {
        let [width, height] = self.0.film.size;
        let lights: Vec<&str> = self.0.mix.0.iter().map(|light| light.name.as_str()).collect();
        format!(
            "<relume.Film {width}×{height}, {} of {} from {}; lights {}>",
            self.0.film.components,
            if self.0.materials.is_empty() { "a colour model" } else { "materials" },
            self.0.positions.join(", "),
            lights.join(", ")
        )
    }
}
