//! Errors of the library as exceptions of `relume._errors`.

use std::error::Error;

use pyo3::prelude::*;
use relume::document::{OpenError, SceneError, SessionError, chain};
use relume::live::LiveError;
use relume::measure::MeasureError;
use relume::model::ModelError;
use relume::output::OutputError;
use relume::output::page::PageError;
use relume::palette::PaletteError;
use relume::plan::PlanError;
use relume::reference::ReferenceError;
use relume::render::RenderError;
use relume::spectrum::SpectrumError;
use relume::volume::VolumeError;
use relume::vulkan::VulkanError;

/// Result of a method: an error of the library becomes an exception.
pub(crate) type Made<T> = Result<T, Failed>;

/// Advice where there is no device.
const ON_CPU: &str = "; or render on the CPU: device=\"cpu\"";
/// What a device may be called beside the names of Vulkan devices.
pub(crate) const BESIDE_DEVICES: &str = ", and \"auto\", \"cpu\", \"reference\"";

/// An exception to be raised: its class, sentence, code, and the key of the scene that is wrong.
#[derive(Debug)]
pub(crate) struct Failed {
    class: &'static str,
    message: String,
    code: &'static str,
    key: Option<String>,
}

impl Failed {
    pub(crate) fn new(class: &'static str, code: &'static str, message: impl Into<String>) -> Self {
        Self { class, message: message.into(), code, key: None }
    }

    /// The same with the key of a scene.
    pub(crate) fn at(self, key: &str) -> Self {
        Self { key: Some(key.to_owned()).filter(|key| !key.is_empty()), ..self }
    }

    /// True if there is no device, or if it failed.
    pub(crate) fn is_of_device(&self) -> bool {
        self.class.starts_with("Device")
    }

    /// The same with a longer sentence.
    pub(crate) fn with(self, more: &str) -> Self {
        Self { message: self.message + more, ..self }
    }

    /// The same without the advice to do without a device.
    pub(crate) fn of_device_alone(self) -> Self {
        let message = self.message.replace(ON_CPU, "").replace(BESIDE_DEVICES, "");
        Self { message, ..self }
    }

    fn of(class: &'static str, code: &'static str, error: &dyn Error) -> Self {
        Self::new(if code == "cancelled" { "Cancelled" } else { class }, code, chain(error))
    }

    pub(crate) fn raised(self, py: Python<'_>) -> PyErr {
        let made = || -> PyResult<PyErr> {
            let class = py.import("relume._errors")?.getattr(self.class)?;
            Ok(PyErr::from_value(class.call1((self.message, self.code, self.key))?))
        };
        made().unwrap_or_else(|error| error)
    }
}

impl From<Failed> for PyErr {
    fn from(failed: Failed) -> Self {
        Python::attach(|py| failed.raised(py))
    }
}

impl From<SceneError> for Failed {
    fn from(error: SceneError) -> Self {
        // The key tells the place; nobody wrote the lines of a dict.
        let keyed = |key: &str, message: &str| {
            let starts = key.is_empty() || message.starts_with(key);
            Self::new("SceneError", error.code(), if starts { message.to_owned() } else { format!("{key}: {message}") })
        };
        let failed = match &error {
            SceneError::Invalid { message, key, .. } => keyed(key, message),
            SceneError::Spectrum { key, what, source, .. } => keyed(key, &format!("{what}: {}", chain(source))),
            SceneError::Define { message, .. } => keyed(error.key().unwrap_or_default(), message),
            SceneError::NoVolume { .. } => {
                Self::new("SceneError", error.code(), format!("{error}, or give one: Scene(description, volume)"))
            }
            SceneError::Volume { source, .. } => Self::of("VolumeError", source.code(), source),
            _ => Self::of("SceneError", error.code(), &error),
        };
        Self { key: error.key().map(str::to_owned), ..failed }
    }
}

impl From<OpenError> for Failed {
    fn from(error: OpenError) -> Self {
        match error {
            OpenError::Scene(error) => error.into(),
            OpenError::Volume(error) => error.into(),
            error => Self::of("SceneError", error.code(), &error),
        }
    }
}

impl From<VulkanError> for Failed {
    fn from(error: VulkanError) -> Self {
        let class = match &error {
            VulkanError::TooLarge { .. } => "DeviceMemoryError",
            _ if error.code().contains("memory") => "DeviceMemoryError",
            _ => "DeviceError",
        };
        let failed = Self::of(class, error.code(), &error);
        match &error {
            VulkanError::NoLoader { .. } | VulkanError::NoDriver | VulkanError::NoDevice => {
                Self { message: format!("{}{ON_CPU}", failed.message), ..failed }
            }
            _ => failed,
        }
    }
}

impl From<RenderError> for Failed {
    fn from(error: RenderError) -> Self {
        match error {
            RenderError::Vulkan(error) => error.into(),
            RenderError::Plan(error) => error.into(),
            RenderError::Volume(error) | RenderError::Labels(error) => error.into(),
            RenderError::Slot { .. } => Self::of("DeviceMemoryError", error.code(), &error),
            error => Self::of("RelumeError", error.code(), &error),
        }
    }
}

impl From<LiveError> for Failed {
    fn from(error: LiveError) -> Self {
        match error {
            LiveError::Plan(error) => error.into(),
            LiveError::Render(error) => error.into(),
            LiveError::Volume(error) => error.into(),
            LiveError::Page(error) => error.into(),
            error => Self::of("OutputError", error.code(), &error),
        }
    }
}

/// An error of the library, by its class.
macro_rules! raised_as {
    ($($error:ty => $class:literal),+ $(,)?) => {$(
        impl From<$error> for Failed {
            fn from(error: $error) -> Self {
                Self::of($class, error.code(), &error)
            }
        }
    )+};
}

raised_as! {
    VolumeError => "VolumeError",
    PlanError => "SceneError",
    MeasureError => "SceneError",
    SessionError => "SceneError",
    ReferenceError => "SceneError",
    OutputError => "OutputError",
    PageError => "OutputError",
    PaletteError => "PaletteError",
    ModelError => "SceneError",
    SpectrumError => "SpectrumError",
}
