//! `Palette`: designed spectra.

use std::path::PathBuf;

use pyo3::prelude::*;
use pyo3::types::PyDict;
use relume::palette::{self, Member};
use relume::spectrum::Spectrum;

use crate::errors::Failed;
use crate::spectra;
use crate::tables::text_of;
use crate::work;

/// Target colours of materials under lights; `solve` finds the open spectra.
#[pyclass(frozen, module = "relume")]
pub(crate) struct Palette(palette::Palette);

/// The solved spectra of a palette.
#[pyclass(frozen, module = "relume")]
pub(crate) struct Solution(palette::Solution);

#[pymethods]
impl Palette {
    /// A palette of a dict with the keys of PALETTE.md, or its TOML text.
    #[new]
    #[pyo3(signature = (description, *, base=None, name="palette"))]
    fn new(description: &Bound<'_, PyAny>, base: Option<PathBuf>, name: &str) -> PyResult<Self> {
        let text = text_of(description)?;
        Ok(Self(palette::parse(name, &text, &base.unwrap_or_default()).map_err(Failed::from)?))
    }

    /// The palette of a file: a palette, or a scene with one.
    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        Ok(Self(palette::load(&path).map_err(Failed::from)?))
    }

    /// Solves for the open spectra. A search that starts from another solution is not worse than it.
    #[pyo3(signature = (start=None, *, progress=None))]
    fn solve(
        &self,
        py: Python<'_>,
        start: Option<&Bound<'_, Solution>>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Solution> {
        let start = start.map(|start| start.get().0.with_spectra());
        let found = work::run(py, progress, |progress| {
            Ok(match start {
                Some(start) => palette::solve_from(&self.0, &start, progress)?,
                None => palette::solve(&self.0, progress)?,
            })
        })?;
        Ok(Solution(found))
    }

    fn __repr__(&self) -> String {
        let names = |members: &[Member]| members.iter().map(|it| it.name.clone()).collect::<Vec<_>>().join(", ");
        format!("<relume.Palette {} under {}>", names(&self.0.materials), names(&self.0.lights))
    }
}

#[pymethods]
impl Solution {
    /// Reflectances by name, 81 samples each.
    #[getter]
    fn materials<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let spectra = self.0.materials.iter().map(relume::spectrum::Reflectance::spectrum);
        by_name(py, &self.0.palette.materials, spectra)
    }

    /// Spectra of the lights by name, of luminance 1.
    #[getter]
    fn lights<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let spectra = self.0.lights.iter().map(relume::spectrum::Light::spectrum);
        by_name(py, &self.0.palette.lights, spectra)
    }

    /// ΔE00 from the target of each cell that has one: a dict by (material, light).
    #[getter]
    fn difference<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let all = PyDict::new(py);
        let palette = &self.0.palette;
        for cell in &self.0.cells {
            if let Some(difference) = cell.difference {
                let names = (&palette.materials[cell.material].name, &palette.lights[cell.light].name);
                all.set_item(names, difference)?;
            }
        }
        Ok(all)
    }

    /// Largest ΔE00 between a cell and its target.
    #[getter]
    fn worst(&self) -> f64 {
        self.0.worst()
    }

    /// Targets that no spectra within the bounds reach together, in sentences.
    #[getter]
    fn conflicts(&self) -> Vec<String> {
        self.0.conflicts.iter().map(|conflict| conflict.reason.clone()).collect()
    }

    /// TOML text of a palette file with all spectra, such as `relume design -o` writes.
    #[getter]
    fn toml(&self) -> String {
        self.0.to_toml()
    }

    /// The drawing of the palette in a notebook.
    fn _repr_svg_(&self) -> String {
        self.0.to_svg()
    }

    fn __repr__(&self) -> String {
        format!("<relume.Solution, largest ΔE00 {:.4}>", self.0.worst())
    }
}

fn by_name<'py, 'a>(
    py: Python<'py>,
    members: &[Member],
    spectra: impl Iterator<Item = &'a Spectrum>,
) -> PyResult<Bound<'py, PyDict>> {
    let all = PyDict::new(py);
    for (member, spectrum) in members.iter().zip(spectra) {
        all.set_item(&member.name, spectra::array(py, spectrum))?;
    }
    Ok(all)
}
