//! Options of the viewer's window, and why it cannot open or has to close.

use std::path::PathBuf;

use winit::error::{EventLoopError, OsError};

use super::script::{Script, ScriptError};
use crate::document::Source;
use crate::vulkan::{DeviceChoice, Validation, VulkanError};

/// Options of the viewer.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// First scene or volume.
    pub source: Source,
    /// Width and height of the window in pixels; 1280 by 800 points by default.
    pub size: Option<[u32; 2]>,
    /// Rendering device.
    pub device: DeviceChoice,
    /// Bytes of the host for voxels of a file of bricks; half of the available memory by default.
    pub memory: Option<u64>,
    /// Bytes of the device for a volume; all of its memory by default.
    pub device_memory: Option<u64>,
    /// Use of the validation layer.
    pub validation: Validation,
    /// Folder for cached measurements.
    pub cache: Option<PathBuf>,
    /// Number of frames of the opened scene after which the viewer exits.
    pub frames: Option<u32>,
    /// Script to run; the viewer exits after it.
    pub script: Option<Script>,
    /// Ends the process when the display disappears and the system permits nothing else.
    pub display_gone: Option<fn() -> !>,
}

/// Reason why the window could not open or had to close.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ViewError {
    /// There is no screen.
    #[error("no display for a window; `relume render` needs none, and `xvfb-run` provides a virtual one")]
    NoDisplay,
    /// The system's events ended in an error.
    #[error("the event loop of the window failed")]
    Events(#[source] EventLoopError),
    /// The system gives no window.
    #[error("cannot open a window")]
    NoWindow(#[from] OsError),
    /// Error of the device.
    #[error(transparent)]
    Vulkan(#[from] VulkanError),
    /// Error of the script.
    #[error(transparent)]
    Script(#[from] ScriptError),
}

impl ViewError {
    /// Name for programs; it does not change between versions.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::NoDisplay => "display-missing",
            Self::Events(_) => "event-loop-failed",
            Self::NoWindow(_) => "window-not-openable",
            Self::Vulkan(error) => error.code(),
            Self::Script(error) => error.code(),
        }
    }
}
