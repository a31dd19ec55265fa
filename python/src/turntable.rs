//! Films of a scene from all sides, for `relume.Turntable`: their page and their animation.

use std::path::PathBuf;

use numpy::{PyReadonlyArray3, PyUntypedArrayMethods as _};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use relume::output::page::{self, Page};
use relume::output::{Alpha, Animation, Depth, OutputError, write_apng};

use crate::errors::Failed;
use crate::film::Film;
use crate::work;

/// The HTML of a page of `films`, `columns` in a row, and the page in a frame of `height`; written to `path`, if there is one.
#[pyfunction]
#[pyo3(signature = (films, columns, title=None, tolerance=None, height=760, *, path=None, progress=None))]
pub(crate) fn _page_of(
    py: Python<'_>,
    films: Vec<Bound<'_, Film>>,
    columns: usize,
    title: Option<&str>,
    tolerance: Option<f64>,
    height: usize,
    path: Option<PathBuf>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<(String, String)> {
    let films: Vec<&Film> = films.iter().map(Bound::get).collect();
    work::run(py, progress, |progress| {
        path.as_deref().map_or(Ok(()), page::check_name)?;
        let views: Vec<_> = films.iter().map(|film| film.kept().film.clone()).collect();
        let Some(first) = films.first() else { return Err(Failed::new("OutputError", "page-views-differ", "no film")) };
        let title = title.unwrap_or(page::TITLE);
        let tolerance = tolerance.unwrap_or(page::TOLERANCE);
        let page = Page { film: &first.kept().header, views: &views, columns, title, tolerance };
        let packed = page.packed(progress)?;
        path.as_deref().map_or(Ok(()), |path| packed.write(path))?;
        let framed = packed.framed(title, height);
        Ok((packed.html, framed))
    })
}

/// Writes linear pictures, float32 (rows, columns, 4), as an animated PNG.
#[pyfunction]
pub(crate) fn _apng(
    py: Python<'_>,
    path: PathBuf,
    pictures: Vec<PyReadonlyArray3<'_, f32>>,
    per_second: u16,
) -> PyResult<()> {
    let Some(first) = pictures.first() else { return Err(PyValueError::new_err("there is no picture")) };
    let size = [first.shape()[1], first.shape()[0]];
    let frames = u32::try_from(pictures.len()).map_err(|_| PyValueError::new_err("too many pictures"))?;
    if per_second == 0 || pictures.iter().any(|picture| picture.shape() != first.shape()) {
        return Err(PyValueError::new_err("an animation has pictures of one size, and at least one a second"));
    }
    let pictures = pictures.iter().map(|picture| Ok(picture.as_slice()?.to_vec()));
    let mut pictures: Vec<Vec<f32>> = pictures.collect::<PyResult<_>>()?;
    let animation = Animation { frames, per_second };
    work::detached(py, || {
        write_apng(&path, size, animation, Depth::Eight, Alpha::OverBlack, |index| {
            Ok::<_, OutputError>(std::mem::take(&mut pictures[index]))
        })
    })
    .map_err(|error| Failed::from(error).into())
}
