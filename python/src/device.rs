//! Devices: one renderer of each, and the scene that it holds.

use std::collections::HashMap;
use std::process;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, LazyLock, Mutex, PoisonError, TryLockError};

use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use relume::film::Film;
use relume::measure::{Choice, Wanted, cache_folder, choose};
use relume::progress::Progress;
use relume::render::{KeptVolume, PlannedJob, RenderWarning, Renderer, SceneRenderer, Uploaded};
use relume::scene::{Mix, Scene};
use relume::vulkan::{self, Device, DeviceChoice, Validation, VulkanError};

use crate::errors::{BESIDE_DEVICES, Failed, Made};
use crate::work::heard;

/// The renderer of a device, with the scene that it marched last.
struct Kept {
    renderer: Renderer,
    on_device: Option<SceneRenderer>,
    /// Volumes uploaded so far.
    uploads: u64,
}

/// Renderers by the name of their device.
static KEPT: LazyLock<Mutex<HashMap<String, Arc<Mutex<Kept>>>>> = LazyLock::new(Mutex::default);

/// The volume of the last render without a device.
pub(crate) static KEPT_VOLUME: Mutex<Option<KeptVolume>> = Mutex::new(None);

/// The process that opened a device; 0 before one has.
static OWNER: AtomicU32 = AtomicU32::new(0);

/// True in a process that was forked from one with an open device, whose locks may be held for ever.
fn is_forked() -> bool {
    ![0, process::id()].contains(&OWNER.load(Ordering::Acquire))
}

/// The renderer of `device`, opened at its first use.
fn kept(device: &str) -> Made<Arc<Mutex<Kept>>> {
    if is_forked() {
        return Err(Failed::new(
            "DeviceError",
            "device-forked",
            "this process was forked from one that has a Vulkan device open, which cannot be shared; start it by \
             multiprocessing.set_start_method(\"spawn\"), or render with device=\"cpu\"",
        ));
    }
    let known = || KEPT.lock().unwrap_or_else(PoisonError::into_inner).get(device).cloned();
    if let Some(kept) = known() {
        return Ok(kept);
    }
    // Without the lock: a driver takes its time.
    let opened = Arc::new(Mutex::new(opened(device)?));
    OWNER.store(process::id(), Ordering::Release);
    let mut all = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
    Ok(Arc::clone(all.entry(device.to_owned()).or_insert(opened)))
}

fn opened(device: &str) -> Made<Kept> {
    let Ok(choice) = device.parse::<DeviceChoice>();
    let opened = Device::open(&choice, Validation::Off);
    let renderer = Renderer::new(opened.map_err(|error| match error {
        VulkanError::NoMatch { .. } => Failed::from(error).with(BESIDE_DEVICES),
        error => error.into(),
    })?);
    Ok(Kept { renderer, on_device: None, uploads: 0 })
}

/// Runs `work` with the renderer of `device`; one of its own, where another thread uses it.
fn with_renderer<T>(device: &str, work: impl FnOnce(&mut Kept) -> Made<T>) -> Made<T> {
    let shared = kept(device)?;
    match shared.try_lock() {
        Ok(mut kept) => work(&mut kept),
        Err(TryLockError::Poisoned(poisoned)) => {
            let mut kept = poisoned.into_inner();
            *kept = opened(device)?;
            shared.clear_poison();
            work(&mut kept)
        }
        Err(TryLockError::WouldBlock) => work(&mut opened(device)?),
    }
}

/// The setting of `scene` for the picture `wanted`.
pub(crate) fn chosen(device: &str, scene: &Scene, mix: &Mix, wanted: Wanted, progress: &dyn Progress) -> Made<Choice> {
    scene.volume().require_voxels("a search for settings")?;
    with_renderer(device, |kept| Ok(choose(&kept.renderer, scene, mix, wanted, cache_folder().as_deref(), progress)?))
}

/// Marches the cameras of `job` on `device`; the volume that it marched last is not uploaded again.
pub(crate) fn marched(
    device: &str,
    job: &PlannedJob,
    mix: &Mix,
    size: [usize; 2],
    progress: &dyn Progress,
) -> Made<Vec<Film<f32>>> {
    Ok(marched_and(device, job, mix, size, progress, |_, _| Ok(()))?.0)
}

/// [`marched`], and what `then` does with the renderer and the volume.
pub(crate) fn marched_and<T>(
    device: &str,
    job: &PlannedJob,
    mix: &Mix,
    size: [usize; 2],
    progress: &dyn Progress,
    then: impl FnOnce(&Renderer, &Uploaded) -> Made<T>,
) -> Made<(Vec<Film<f32>>, T)> {
    with_renderer(device, |kept| {
        let Kept { renderer, on_device, uploads } = kept;
        renderer.check_picture(&job.planned.plan, size, 0)?;
        if !on_device.as_ref().is_some_and(|before| before.holds(&job.scene, &job.planned)) {
            *uploads += 1;
        }
        job.clone().put(on_device, renderer, progress)?;
        let Some(on_device) = on_device else {
            return Err(Failed::new("DeviceError", "device", "the scene is not on the device"));
        };
        let uploaded = on_device.uploaded();
        for warning in RenderWarning::of_storage(&job.scene, &uploaded.storage, uploaded.labels.as_deref()) {
            heard(warning);
        }
        let films = job.films(on_device, size, progress, |on_device, film| {
            RenderWarning::of_film(on_device, film, mix).into_iter().for_each(heard);
        })?;
        Ok((films, then(renderer, on_device.uploaded())?))
    })
}

/// Vulkan devices of this machine: dicts with `name`, `kind`, `driver` and `missing`, which is empty for a usable one.
#[pyfunction]
pub(crate) fn devices(py: Python<'_>) -> PyResult<Bound<'_, PyList>> {
    let found = py.detach(vulkan::devices).map_err(Failed::from)?;
    let list = PyList::empty(py);
    for device in found {
        let of = PyDict::new(py);
        of.set_item("name", device.name.clone())?;
        of.set_item("kind", device.kind.to_string())?;
        of.set_item("driver", device.driver.clone())?;
        of.set_item("missing", device.missing.clone())?;
        list.append(of)?;
    }
    Ok(list)
}

/// Frees all devices and the volumes that are kept for them.
#[pyfunction]
pub(crate) fn release(py: Python<'_>) {
    // In a forked process, a thread that is not there may hold it.
    if let Ok(mut kept) = KEPT_VOLUME.try_lock() {
        *kept = None;
    }
    if !is_forked() {
        py.detach(|| KEPT.lock().unwrap_or_else(PoisonError::into_inner).clear());
    }
}

/// Volumes uploaded so far to `device`: for tests.
#[pyfunction]
pub(crate) fn _uploads(device: &str) -> PyResult<u64> {
    let shared = kept(device)?;
    let kept = shared.lock().unwrap_or_else(PoisonError::into_inner);
    Ok(kept.uploads)
}
