//! Owned Vulkan handles.
//!
//! A [`Device`] is opened once and shared. Every object made from it has one owner and a name, which error messages and
//! validation messages use. The object keeps the device alive and destroys its handle on drop. A [`Submission`] keeps
//! everything that it reads or writes alive until it has finished.

mod buffer;
#[cfg(feature = "window")]
mod damage;
mod device;
#[cfg(all(feature = "window", target_os = "linux"))]
mod display;
mod error;
mod format;
mod handle;
mod image;
mod info;
mod instance;
mod limits;
mod memory;
mod pipeline;
mod record;
mod resources;
mod sampler;
mod simulate;
mod submission;
#[cfg(feature = "window")]
mod surface;
#[cfg(feature = "window")]
mod swapchain;

pub use buffer::{Buffer, HostUse};
pub use device::Device;
#[cfg(all(feature = "window", target_os = "linux"))]
pub use display::when_display_is_gone;
pub use error::VulkanError;
pub use format::Format;
pub use image::{Image3d, StorageImage};
pub use info::{DeviceChoice, DeviceInfo, DeviceKind, devices};
pub use instance::Validation;
pub use limits::Limits;
pub use memory::give_back_freed;
pub use pipeline::ComputePipeline;
pub use record::Recorder;
pub use resources::{Resource, ResourceSet};
pub use sampler::{Filter, Sampler};
pub use submission::Submission;
#[cfg(feature = "window")]
pub use surface::{Frame, Surface};

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Locks `mutex`. Ignores poisoning: no guarded value is ever half changed.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
