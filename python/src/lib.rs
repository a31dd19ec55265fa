//! The module `relume._relume`: conversions between Python and the library, which does the work.
#![expect(clippy::too_many_arguments, clippy::type_complexity, reason = "signatures are those of Python")]

mod device;
mod errors;
mod film;
mod palette;
mod scene;
mod spectra;
mod tables;
mod turntable;
mod volume;
mod work;

use std::ffi::OsString;

use pyo3::prelude::*;

/// Runs the command line `arguments`, the first of which is the name of the program; returns the exit code.
#[pyfunction]
fn _command(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| relume::cli::run_on(&arguments))
}

#[pymodule(gil_used = false)]
fn _relume(module: &Bound<'_, PyModule>) -> PyResult<()> {
    work::import();
    let py = module.py();
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("WAVELENGTHS", spectra::wavelengths(py))?;
    module.add_class::<volume::Volume>()?;
    module.add_class::<scene::Scene>()?;
    module.add_class::<scene::LiveVolume>()?;
    module.add_class::<film::Film>()?;
    module.add_class::<palette::Palette>()?;
    module.add_class::<palette::Solution>()?;
    module.add_function(wrap_pyfunction!(scene::open, module)?)?;
    module.add_function(wrap_pyfunction!(scene::example, module)?)?;
    module.add_function(wrap_pyfunction!(scene::_scene_of, module)?)?;
    module.add_function(wrap_pyfunction!(volume::_volume_of, module)?)?;
    module.add_function(wrap_pyfunction!(spectra::spectrum, module)?)?;
    module.add_function(wrap_pyfunction!(spectra::xyz, module)?)?;
    module.add_function(wrap_pyfunction!(spectra::standards, module)?)?;
    module.add_function(wrap_pyfunction!(device::devices, module)?)?;
    module.add_function(wrap_pyfunction!(device::release, module)?)?;
    module.add_function(wrap_pyfunction!(device::_uploads, module)?)?;
    module.add_function(wrap_pyfunction!(turntable::_page_of, module)?)?;
    module.add_function(wrap_pyfunction!(turntable::_apng, module)?)?;
    module.add_function(wrap_pyfunction!(_command, module)?)?;
    Ok(())
}
