//! Spectra: wavelengths, standards, arrays of 81 samples.

use std::path::Path;

use numpy::PyArray1;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};
use relume::spectrum::colour::Xyz;
use relume::spectrum::observer::Observer;
use relume::spectrum::standard::names;
use relume::spectrum::{BANDS, Kind, Light, Reflectance, Spectrum, SpectrumSource};
use toml::{Table, Value};

use crate::errors::Failed;
use crate::tables;

/// Wavelengths of the samples in nm.
pub(crate) fn wavelengths(py: Python<'_>) -> Bound<'_, PyArray1<f64>> {
    array(py, &Spectrum::from_fn(|nm| nm))
}

/// A spectrum as an array.
pub(crate) fn array<'py>(py: Python<'py>, spectrum: &Spectrum) -> Bound<'py, PyArray1<f64>> {
    PyArray1::from_slice(py, spectrum.samples())
}

/// The form of a spectrum in a file, for a name, a number, an array of 81 samples, a dict, a pair of wavelengths and
/// values, or an object that has both.
pub(crate) fn source_of(spectrum: &Bound<'_, PyAny>) -> PyResult<SpectrumSource> {
    if let Ok(name) = spectrum.cast::<PyString>() {
        let Ok(source) = name.to_cow()?.parse();
        return Ok(source);
    }
    let value = match spectrum.cast::<PyDict>() {
        Ok(dict) => tables::value_of(dict, "")?,
        Err(_) => table_of(spectrum, "")?,
    };
    value.try_into().map_err(|error: toml::de::Error| wrong("", error.message()).into())
}

/// The value of a file for a spectrum that is no name and no dict; `path` is its key.
pub(crate) fn table_of(spectrum: &Bound<'_, PyAny>, path: &str) -> PyResult<Value> {
    if let Ok(number) = spectrum.extract::<f64>() {
        return Ok(Value::Float(number));
    }
    let pair = if spectrum.hasattr("wavelengths")? && spectrum.hasattr("values")? {
        Some((numbers(&spectrum.getattr("wavelengths")?, path)?, numbers(&spectrum.getattr("values")?, path)?))
    } else if spectrum.len().is_ok_and(|parts| parts == 2) {
        Some((numbers(&spectrum.get_item(0)?, path)?, numbers(&spectrum.get_item(1)?, path)?))
    } else {
        None
    };
    if let Some((wavelengths, values)) = pair {
        let [n, m] = [wavelengths.len(), values.len()];
        if n != m {
            return Err(wrong(path, &format!("a spectrum has {n} wavelengths and {m} values")).into());
        }
        let points = wavelengths.iter().zip(values).map(|(nm, value)| (nm.to_string(), Value::Float(value)));
        return Ok(Value::Table(points.collect()));
    }
    let samples = numbers(spectrum, path)?;
    if samples.len() != BANDS {
        let n = samples.len();
        let message = format!(
            "{n} samples are given, and a spectrum has {BANDS}, at relume.WAVELENGTHS; give others as (wavelengths, values)"
        );
        return Err(wrong(path, &message).into());
    }
    let samples = samples.into_iter().map(Value::Float).collect();
    Ok(Value::Table(Table::from_iter([("samples".to_owned(), Value::Array(samples))])))
}

/// The numbers of a sequence.
fn numbers(sequence: &Bound<'_, PyAny>, path: &str) -> PyResult<Vec<f64>> {
    let of = || -> PyResult<Vec<f64>> { sequence.try_iter()?.map(|number| number?.extract()).collect() };
    of().map_err(|_| {
        let kind = sequence.get_type().name().map_or_else(|_| "this".to_owned(), |name| name.to_string());
        let message = format!(
            "{kind} is no spectrum: give a name, a number, {BANDS} samples, (wavelengths, values), or a dict of SCENE.md"
        );
        wrong(path, &message).into()
    })
}

/// The error of a spectrum at a key.
fn wrong(path: &str, message: &str) -> Failed {
    let message = if path.is_empty() { message.to_owned() } else { format!("{path}: {message}") };
    Failed::new("SpectrumError", "spectrum", message).at(path)
}

/// True if a dict states a spectrum: by a key of its forms, or by wavelengths.
pub(crate) fn is_form(dict: &Bound<'_, PyDict>) -> bool {
    const FORMS: [&str; 6] = ["samples", "file", "gaussian", "srgb", "linear_srgb", "blackbody"];
    dict.keys().iter().any(|key| {
        let key = key.str().map_or_else(|_| String::new(), |key| key.to_string());
        FORMS.contains(&key.as_str()) || key.parse::<f64>().is_ok_and(|nm| nm >= 100.0)
    })
}

/// The spectrum of a light, normalised so that white has luminance 1.
pub(crate) fn light_of(spectrum: &Bound<'_, PyAny>) -> PyResult<Light> {
    Ok(source_of(spectrum)?.light(Path::new("")).map_err(Failed::from)?)
}

fn reflectance_of(spectrum: &Bound<'_, PyAny>) -> PyResult<Reflectance> {
    Ok(source_of(spectrum)?.reflectance(Path::new("")).map_err(Failed::from)?)
}

/// An observer by its year.
pub(crate) fn observer_of(year: &Bound<'_, PyAny>) -> PyResult<Observer> {
    let year = year.str()?.to_string();
    let found = Observer::ALL.into_iter().find(|one| one.to_string() == year);
    found.ok_or_else(|| Failed::new("SpectrumError", "observer", "an observer is \"1931\" or \"1964\"").into())
}

/// Samples at `relume.WAVELENGTHS` of a spectrum: a name ("D65", "blackbody 3000", "white 9.5"), a number, samples, a dict
/// of SCENE.md, or (wavelengths, values). `kind` is "reflectance" or "light"; lights are normalised to luminance 1.
#[pyfunction]
#[pyo3(signature = (spectrum, kind=None))]
pub(crate) fn spectrum<'py>(
    py: Python<'py>,
    spectrum: &Bound<'py, PyAny>,
    kind: Option<&str>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let made = match kind {
        Some("light") => light_of(spectrum)?.spectrum().clone(),
        Some("reflectance") => reflectance_of(spectrum)?.spectrum().clone(),
        Some(kind) => return Err(PyTypeError::new_err(format!("kind is \"reflectance\" or \"light\", not {kind:?}"))),
        // A name has one of both, but "E" and numbers, which are alike.
        None => match reflectance_of(spectrum) {
            Ok(found) => found.spectrum().clone(),
            Err(error) => match light_of(spectrum) {
                Ok(found) => found.spectrum().clone(),
                Err(_) => return Err(error),
            },
        },
    };
    Ok(array(py, &made))
}

/// CIE XYZ of a reflectance under a light; Y of white under D65 is 1, and with the 1931 observer under any light.
#[pyfunction]
#[pyo3(signature = (reflectance, light, observer=None))]
pub(crate) fn xyz<'py>(
    py: Python<'py>,
    reflectance: &Bound<'py, PyAny>,
    light: &Bound<'py, PyAny>,
    observer: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let observer = observer.map_or(Ok(Observer::default()), observer_of)?;
    let lit = light_of(light)?.spectrum() * reflectance_of(reflectance)?.spectrum();
    let Xyz(parts) = observer.xyz_of(&lit);
    Ok(PyArray1::from_slice(py, &parts))
}

/// Names of the standard lights and reflectances: `{"lights": […], "reflectances": […]}`.
#[pyfunction]
pub(crate) fn standards(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let all = PyDict::new(py);
    all.set_item("lights", names(Kind::Light).to_vec())?;
    all.set_item("reflectances", names(Kind::Reflectance).to_vec())?;
    Ok(all)
}
