//! `Volume`: an array with its place in the world.

use std::hash::{DefaultHasher, Hash, Hasher as _};
use std::path::PathBuf;
use std::sync::Arc;

use glam::{DMat3, DVec3};
use numpy::ndarray::{ArrayView, IntoDimension};
use numpy::{Element, PyArray, PyArray2, PyArray3, PyArrayMethods as _, PyUntypedArrayMethods as _};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};
use relume::number::brief;
use relume::volume::{Geometry, Selection, Unit, Voxels, with_voxels};
use relume::{memory, volume};

use crate::errors::{Failed, Made};
use crate::work::{self, heard};

/// Voxels on a regular grid, with their place in the world.
#[pyclass(frozen, module = "relume")]
pub(crate) struct Volume(pub(crate) Arc<volume::Volume>);

/// A read-only view of numbers of `owner`, which stays alive as long as the view.
#[expect(unsafe_code, reason = "a view borrows from an object of Python")]
pub(crate) fn view<'py, T: Element, D: IntoDimension>(
    owner: Bound<'py, PyAny>,
    numbers: &[T],
    shape: D,
) -> PyResult<Bound<'py, PyArray<T, D::Dim>>> {
    let view = ArrayView::from_shape(shape.into_dimension(), numbers)
        .map_err(|error| Failed::new("RelumeError", "shape", error.to_string()))?;
    // SAFETY: `owner` is an object of a frozen class that holds the numbers; nothing changes or moves them while it lives, and the
    // array holds a reference to it.
    let array = unsafe { PyArray::borrow_from_array(&view, owner) };
    array.try_readwrite().map_err(|error| PyValueError::new_err(error.to_string()))?.make_nonwriteable();
    Ok(array)
}

/// The voxels of an array (z, y, x) in C order and in the byte order of the machine.
fn voxels_of(array: &Bound<'_, PyAny>) -> PyResult<(Voxels, [usize; 3])> {
    macro_rules! of {
        ($($kind:ident: $number:ty),+) => {$(
            if let Ok(array) = array.cast::<PyArray3<$number>>() {
                let shape = array.shape();
                return Ok((Voxels::$kind(array.try_readonly().map_err(|error| PyValueError::new_err(format!("the array is written to: {error}")))?.as_slice()?.to_vec()), [shape[2], shape[1], shape[0]]));
            }
        )+};
    }
    of!(U8: u8, I8: i8, U16: u16, I16: i16, U32: u32, I32: i32, U64: u64, I64: i64, F32: f32, F64: f64);
    Err(PyTypeError::new_err("a volume is an array of three axes"))
}

/// The value of a key of what `_volumes.recognised` returns.
fn given<'py, T: for<'a> FromPyObject<'a, 'py, Error: Into<PyErr>>>(
    found: &Bound<'py, PyDict>,
    key: &str,
) -> PyResult<Option<T>> {
    match found.get_item(key)? {
        Some(value) if !value.is_none() => value.extract().map(Some).map_err(Into::into),
        _ => Ok(None),
    }
}

/// The volume of what `_volumes.recognised` returns.
fn of_array(found: &Bound<'_, PyDict>) -> PyResult<volume::Volume> {
    let array = found.get_item("array")?.ok_or_else(|| PyTypeError::new_err("there is no array"))?;
    if let (Some(free), Ok(bytes)) = (memory::available_bytes(), array.getattr("nbytes")?.extract::<u64>())
        && bytes > free
    {
        let message = format!("a copy of the array needs {bytes} bytes of memory, and {free} are free");
        return Err(Failed::new("VolumeError", "volume-exceeds-memory", message).into());
    }
    let (voxels, dims) = voxels_of(&array)?;
    let source: String = given(found, "source")?.unwrap_or_else(|| "array".to_owned());
    let triple = |key: &str, default| -> PyResult<DVec3> {
        Ok(given::<[f64; 3]>(found, key)?.map_or(default, DVec3::from_array))
    };
    let direction = given::<[[f64; 3]; 3]>(found, "direction")?;
    // Row by row, as DICOM, ITK and NumPy have it: column i is the direction of axis i.
    let direction = direction.map_or(DMat3::IDENTITY, |rows| DMat3::from_cols_array_2d(&rows).transpose());
    let (spacing, origin) = (triple("spacing", DVec3::ONE)?, triple("origin", DVec3::ZERO)?);
    let made = || -> Made<volume::Volume> {
        let geometry = Geometry::new(&source, dims, spacing, origin, direction)?;
        Ok(volume::Volume::new(&source, voxels, geometry)?)
    };
    let mut made = made()?;
    if let Some(unit) = given::<String>(found, "unit")? {
        let unknown =
            || Failed::new("VolumeError", "volume-unit", format!("unit {unit:?}: the units are cm, mm, µm, nm and Å"));
        made.unit = Some(Unit::named(&unit).ok_or_else(unknown)?);
    }
    made.slope = given(found, "slope")?.unwrap_or(1.0);
    made.intercept = given(found, "intercept")?.unwrap_or(0.0);
    if !(made.slope.is_finite() && made.slope != 0.0 && made.intercept.is_finite()) {
        let message =
            format!("slope {} and intercept {}: they must be finite, and the slope not 0", made.slope, made.intercept);
        return Err(Failed::new("VolumeError", "volume-slope", message).into());
    }
    made.anatomical = given(found, "anatomical")?.unwrap_or(false);
    made.has_labels = given(found, "labels")?.unwrap_or(false);
    Ok(made)
}

/// The choice among several volumes of a file.
fn selection_of(stated: Option<&Bound<'_, PyDict>>) -> PyResult<Selection> {
    let Some(stated) = stated else { return Ok(Selection::default()) };
    let text = |key: &str| -> PyResult<Option<String>> {
        stated.get_item(key)?.filter(|it| !it.is_none()).map(|it| Ok(it.str()?.to_string())).transpose()
    };
    Ok(Selection {
        component: given(stated, "component")?,
        time: given(stated, "time")?,
        array: text("array")?,
        series: text("series")?,
        resample: given(stated, "resample")?.unwrap_or(false),
        ..Selection::default()
    })
}

impl Volume {
    /// The volume of an object: a `Volume`, or what `Volume(…)` takes.
    pub(crate) fn of(object: &Bound<'_, PyAny>) -> PyResult<Arc<volume::Volume>> {
        if let Ok(volume) = object.cast::<Self>() {
            return Ok(Arc::clone(&volume.get().0));
        }
        Ok(Self::new(object.py(), object, None)?.0)
    }
}

#[pymethods]
impl Volume {
    /// An image: an array of NumPy (z, y, x); an image of SimpleITK, ITK, nibabel, xarray, VTK or PyVista with its own geometry; or
    /// a path.
    ///
    /// For arrays and images: `spacing` and `origin` (x, y, z), `direction` (3 × 3, column i is the direction of axis i), or one
    /// `affine` (4 × 4, world from voxel x, y, z); `axes` of the array, slowest first, "zyx" by default; `unit` (cm, mm, µm, nm,
    /// Å); `anatomical`: whether the world is left-posterior-superior; `labels`: whether voxels are labels; `slope` and
    /// `intercept` of the values; `source`, a name. For paths: `series`, `time`, `component`, `array`, `resample`, as the
    /// flags of `relume render`.
    #[new]
    #[pyo3(signature = (image, **geometry))]
    fn new(py: Python<'_>, image: &Bound<'_, PyAny>, geometry: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let found = py.import("relume._volumes")?.getattr("recognised")?.call((image,), geometry)?;
        if let Ok(path) = found.cast::<PyString>() {
            let path = PathBuf::from(path.to_cow()?.as_ref());
            let selection = selection_of(geometry)?;
            let read = work::run(py, None, |progress| {
                let read = volume::open(&path, &selection, progress)?;
                read.notes.iter().for_each(heard);
                Ok(read)
            })?;
            return Ok(Self(Arc::new(read)));
        }
        Ok(Self(Arc::new(of_array(found.cast()?)?)))
    }

    /// Voxels along x, y and z.
    #[getter]
    fn dims(&self) -> (usize, usize, usize) {
        self.0.geometry.dims.into()
    }

    /// Voxels along z, y and x: the shape of `array`.
    #[getter]
    fn shape(&self) -> (usize, usize, usize) {
        let [x, y, z] = self.0.geometry.dims;
        (z, y, x)
    }

    /// Type of the stored voxels.
    #[getter]
    fn dtype<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        Self::array(slf)?.getattr("dtype")
    }

    /// The stored voxels, for NumPy.
    #[pyo3(signature = (dtype=None, copy=None))]
    fn __array__<'py>(
        slf: &Bound<'py, Self>,
        dtype: Option<Bound<'py, PyAny>>,
        copy: Option<bool>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let array = Self::array(slf)?;
        match (dtype, copy) {
            (Some(dtype), _) => array.call_method1("astype", (dtype,)),
            (None, Some(true)) => array.call_method0("copy"),
            _ => Ok(array),
        }
    }

    /// Distance of neighbouring voxels along x, y and z, in world units.
    #[getter]
    fn spacing(&self) -> (f64, f64, f64) {
        self.0.geometry.spacing.into()
    }

    /// Place of the first voxel in the world.
    #[getter]
    fn origin(&self) -> (f64, f64, f64) {
        self.0.geometry.origin.into()
    }

    /// Matrix of 3 × 3 whose column i is the direction of axis i in the world.
    #[getter]
    fn direction<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows = self.0.geometry.direction.transpose().to_cols_array_2d();
        Ok(PyArray2::from_vec2(py, &rows.map(Vec::from))?)
    }

    /// World place from voxel (x, y, z), as a matrix of 4 × 4.
    #[getter]
    fn affine<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let Geometry { spacing, origin, direction, .. } = self.0.geometry;
        let [x, y, z] = [0, 1, 2].map(|axis| direction.col(axis) * spacing[axis]);
        let row = |i: usize| [x[i], y[i], z[i], origin[i]];
        let rows = [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]];
        Ok(PyArray2::from_vec2(py, &rows.map(Vec::from))?)
    }

    /// Unit of the world, if it is known.
    #[getter]
    fn unit(&self) -> Option<String> {
        self.0.unit.map(|unit| unit.to_string())
    }

    /// Slope of the values, slope · stored + intercept.
    #[getter]
    fn slope(&self) -> f64 {
        self.0.slope
    }

    /// Intercept of the values, slope · stored + intercept.
    #[getter]
    fn intercept(&self) -> f64 {
        self.0.intercept
    }

    /// True if the world is left-posterior-superior, as of DICOM.
    #[getter]
    fn anatomical(&self) -> bool {
        self.0.anatomical
    }

    /// Path of the file, or `array`.
    #[getter]
    fn source(&self) -> &str {
        &self.0.source
    }

    /// Sentences about oddities of the file.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.0.notes.clone()
    }

    /// The stored voxels (z, y, x): a view, read-only.
    #[getter]
    fn array<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        let volume = &slf.get().0;
        volume.require_voxels("an array").map_err(Failed::from)?;
        let [x, y, z] = volume.geometry.dims;
        with_voxels!(&volume.voxels, stored => Ok(view(slf.clone().into_any(), stored, [z, y, x])?.into_any()))
    }

    /// Smallest and largest finite value.
    #[getter]
    fn range(&self, py: Python<'_>) -> PyResult<(f64, f64)> {
        let volume = &self.0;
        let statistics = work::detached(py, || volume.statistics()).map_err(Failed::from)?;
        Ok((statistics.min, statistics.max))
    }

    /// Place in the world of a voxel (x, y, z), which need not be whole.
    fn world(&self, index: [f64; 3]) -> (f64, f64, f64) {
        self.0.geometry.world_from_index(DVec3::from_array(index)).into()
    }

    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        other.cast::<Self>().is_ok_and(|other| {
            let other = &other.get().0;
            Arc::ptr_eq(&self.0, other) || {
                let of = |it: &volume::Volume| {
                    (it.geometry, it.unit, it.slope.to_bits(), it.intercept.to_bits(), it.anatomical)
                };
                of(&self.0) == of(other) && self.0.voxels == other.voxels
            }
        })
    }

    fn __hash__(&self) -> u64 {
        let Geometry { dims, spacing, .. } = self.0.geometry;
        hash_of(&(dims, spacing.to_array().map(f64::to_bits)))
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyDict>,))> {
        let (py, volume) = (slf.py(), slf.get());
        let state = PyDict::new(py);
        state.set_item("array", Self::array(slf)?)?;
        state.set_item("spacing", volume.spacing())?;
        state.set_item("origin", volume.origin())?;
        state.set_item("direction", volume.direction(py)?)?;
        state.set_item("unit", volume.unit())?;
        state.set_item("slope", volume.slope())?;
        state.set_item("intercept", volume.intercept())?;
        state.set_item("anatomical", volume.anatomical())?;
        state.set_item("labels", volume.0.has_labels)?;
        state.set_item("source", volume.source())?;
        Ok((py.import("relume._relume")?.getattr("_volume_of")?, (state,)))
    }

    fn __repr__(&self) -> String {
        let [x, y, z] = self.0.geometry.dims;
        let [sx, sy, sz] = self.0.geometry.spacing.to_array().map(brief);
        let unit = self.unit().map_or_else(String::new, |unit| format!(" {unit}"));
        let kind = self.0.voxels.voxel_type();
        format!("<relume.Volume {x}×{y}×{z} {kind}, spacing {sx} × {sy} × {sz}{unit}, {}>", self.source())
    }
}

/// The volume of a pickle.
#[pyfunction]
pub(crate) fn _volume_of(state: &Bound<'_, PyDict>) -> PyResult<Volume> {
    Ok(Volume(Arc::new(of_array(state)?)))
}

/// Hash of what equal objects have in common.
pub(crate) fn hash_of(parts: &impl Hash) -> u64 {
    let mut hasher = DefaultHasher::new();
    parts.hash(&mut hasher);
    hasher.finish()
}

/// A folder as a path of the library.
pub(crate) fn path_of(object: &Bound<'_, PyAny>) -> PyResult<PathBuf> {
    object.extract::<PathBuf>()
}

/// True for a path or a text.
pub(crate) fn is_path(object: &Bound<'_, PyAny>) -> PyResult<bool> {
    Ok(object.cast::<PyString>().is_ok() || object.hasattr("__fspath__")?)
}
