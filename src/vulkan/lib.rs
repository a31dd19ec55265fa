//! Owned Vulkan handles.
//!
//! A [`Device`] is opened once and shared. Every object made from it has one owner and a name, which error messages and
//! validation messages use. The object keeps the device alive and destroys its handle on drop. A [`Submission`] keeps
//! everything that it reads or writes alive until it has finished.
#![expect(unsafe_code, reason = "the one door to the Vulkan API, to Xlib and to window handles")]

mod buffer;
mod commands;
mod device;
mod error;
mod format;
mod handle;
mod image;
mod info;
mod instance;
mod limits;
mod memory;
mod pipeline;
#[cfg(feature = "window")]
pub mod present;
mod record;
mod resources;
mod sampler;
pub mod shader;
mod simulate;
mod submission;

pub use ash;
pub use buffer::{Buffer, HostUse};
pub use device::{Device, LentDevice};
pub use error::VulkanError;
pub use format::Format;
#[cfg(feature = "window")]
pub(crate) use handle::Owned;
pub use image::{Image3d, StorageImage};
#[cfg(feature = "window")]
pub(crate) use image::{STORAGE_LAYOUT, all_layers};
pub use info::{DeviceChoice, DeviceInfo, DeviceKind, devices};
pub use instance::Validation;
pub use limits::Limits;
pub use pipeline::ComputePipeline;
pub use record::Recorder;
pub use resources::{Resource, ResourceSet};
pub use sampler::{Filter, Sampler};
pub use submission::Submission;

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Locks `mutex`. Ignores poisoning: no guarded value is ever half changed.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
