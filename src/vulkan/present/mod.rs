//! Frames in a window: the surface and its swapchain, the picture with egui's panels over it, and the loss of the display.
//!
//! `vulkan` knows neither egui nor winit; this module joins the three.

mod damage;
#[cfg(target_os = "linux")]
mod display;
mod surface;
mod swapchain;

use std::ffi::CStr;

#[cfg(target_os = "linux")]
pub use display::when_display_is_gone;
pub use surface::{Frame, Surface};

use winit::raw_window_handle::RawDisplayHandle;

use crate::{Device, DeviceChoice, Validation, VulkanError};

/// Opens a device for a [`Surface`] on `display`.
///
/// # Errors
///
/// As [`Device::open`], and [`VulkanError::NoWindow`].
pub fn open_device(
    choice: &DeviceChoice,
    validation: Validation,
    display: RawDisplayHandle,
) -> Result<Device, VulkanError> {
    let lacking = |_| VulkanError::NoWindow { lacking: "VK_KHR_surface".to_owned() };
    let names = ash_window::enumerate_required_extensions(display).map_err(lacking)?;
    // SAFETY: the pointers are string literals of the crate that names Vulkan's extensions.
    let names: Vec<&CStr> = names.iter().map(|&name| unsafe { CStr::from_ptr(name) }).collect();
    Device::open_for_window(choice, validation, &names)
}
