//! Dicts as the tables of scene and palette files.

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyList, PyString, PyTuple};
use toml::{Table, Value};

use crate::spectra;

/// Keys of scenes and palettes whose values are spectra.
const SPECTRAL: [&str; 5] = ["reflectance", "spectrum", "absorption", "background", "emission"];

/// TOML text of a dict, or the text itself.
pub(crate) fn text_of(description: &Bound<'_, PyAny>) -> PyResult<String> {
    if let Ok(text) = description.cast::<PyString>() {
        return Ok(text.to_cow()?.into_owned());
    }
    let Ok(dict) = description.cast::<PyDict>() else {
        return Err(PyTypeError::new_err(format!("a description is a dict or TOML text, not {}", kind(description))));
    };
    let mut table = table_of(dict, "")?;
    // Dicts need not repeat the version of files.
    table.entry("version").or_insert(Value::Integer(1));
    Ok(table.to_string())
}

fn kind(object: &Bound<'_, PyAny>) -> String {
    object.get_type().name().map_or_else(|_| "this".to_owned(), |name| name.to_string())
}

fn table_of(dict: &Bound<'_, PyDict>, path: &str) -> PyResult<Table> {
    check_depth(path)?;
    let mut table = Table::new();
    for (key, value) in dict {
        let Ok(key) = key.str().and_then(|key| Ok(key.to_cow()?.into_owned())) else {
            return Err(PyTypeError::new_err(format!("{path}: a key is no text")));
        };
        // A key without a value is a key that is not there.
        if !value.is_none() {
            let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
            let value = value_of(&value, &path)?;
            table.insert(key, value);
        }
    }
    Ok(table)
}

/// Refuses a key deeper than any of a scene, such as those of a list that holds itself.
pub(crate) fn check_depth(path: &str) -> PyResult<()> {
    const DEEPEST: usize = 32;
    if path.split('.').count() > DEEPEST {
        return Err(PyValueError::new_err(format!("a key is nested deeper than {DEEPEST} levels: {path:.80}…")));
    }
    Ok(())
}

/// A value of a table; `path` is its key.
pub(crate) fn value_of(value: &Bound<'_, PyAny>, path: &str) -> PyResult<Value> {
    if let Ok(flag) = value.cast::<PyBool>() {
        return Ok(Value::Boolean(flag.is_true()));
    }
    if let Ok(text) = value.cast::<PyString>() {
        return Ok(Value::String(text.to_cow()?.into_owned()));
    }
    if value.cast::<PyInt>().is_ok() {
        let number = value.extract();
        return number.map(Value::Integer).map_err(|_| {
            PyValueError::new_err(format!("{path}: {value} does not fit into a whole number of 64 bits"))
        });
    }
    if let Ok(number) = value.cast::<PyFloat>() {
        return Ok(Value::Float(number.value()));
    }
    if let Ok(dict) = value.cast::<PyDict>() {
        return Ok(Value::Table(table_of(dict, path)?));
    }
    let key = path.rsplit('.').next().unwrap_or_default();
    if SPECTRAL.contains(&key) {
        return spectra::table_of(value, path);
    }
    if value.cast::<PyList>().is_ok() || value.cast::<PyTuple>().is_ok() {
        check_depth(path)?;
        let items = value.try_iter()?.enumerate();
        let items = items.map(|(i, item)| value_of(&item?, &format!("{path}.{i}")));
        return Ok(Value::Array(items.collect::<PyResult<_>>()?));
    }
    // Numbers of NumPy, arrays, paths.
    for method in ["tolist", "__fspath__"] {
        if value.hasattr(method)? {
            let plain = value.call_method0(method)?;
            return if plain.is(value) { break } else { value_of(&plain, path) };
        }
    }
    Err(PyTypeError::new_err(format!("{path}: {} is nothing that a scene has", kind(value))))
}
