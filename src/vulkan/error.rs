//! What can go wrong between this program and a Vulkan device.

use ash::vk;

use super::Format;

/// Where a device comes from when the machine has none.
const INSTALL: &str = "on Debian or Ubuntu `apt-get install libvulkan1 mesa-vulkan-drivers` gives a software device";

/// Why something could not be done with Vulkan.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum VulkanError {
    /// `libvulkan.so.1` is not there or cannot be loaded.
    #[error("the Vulkan loader (libvulkan.so.1) cannot be loaded; {INSTALL}")]
    NoLoader {
        /// What the dynamic linker says.
        source: ash::LoadingError,
    },
    /// The loader is there and finds no driver.
    #[error("the Vulkan loader finds no driver; {INSTALL} (VK_DRIVER_FILES, where set, names the drivers to use)")]
    NoDriver,
    /// Drivers are there and none has a device.
    #[error("the Vulkan drivers have no device; {INSTALL}")]
    NoDevice,
    /// No device has the index or the name asked for.
    #[error("no Vulkan device is {wanted}; there are: {}", .names.join(", "))]
    NoMatch {
        /// The index, or the name in quotes.
        wanted: String,
        /// Index and name of every device.
        names: Vec<String>,
    },
    /// The device lacks what the program needs.
    #[error("the Vulkan device {device:?} cannot be used: {}", .missing.join("; "))]
    Unsuitable {
        /// The device's name.
        device: String,
        /// A sentence per missing feature.
        missing: Vec<String>,
    },
    /// The validation layer was asked for and is not installed.
    #[error(
        "the layer VK_LAYER_KHRONOS_validation is not installed; \
         on Debian or Ubuntu `apt-get install vulkan-validationlayers`"
    )]
    NoValidation,
    /// The drivers cannot show anything in a window of this display.
    #[error("the Vulkan drivers show nothing in windows of this display: they lack {lacking}")]
    NoWindow {
        /// The extension.
        lacking: String,
    },
    /// The panels of a window could not be drawn.
    #[cfg(feature = "window")]
    #[error("the panels cannot be drawn")]
    Panels {
        /// What the library that draws them says.
        source: egui_ash_renderer::RendererError,
    },
    /// The device has no such use for the format.
    #[error("{object:?}: this device does not support {format:?} as {purpose}")]
    NoFormat {
        /// The image's name.
        object: String,
        /// Its format.
        format: Format,
        /// What it was to be.
        purpose: &'static str,
    },
    /// Something is larger than the device allows. Nothing was allocated.
    #[error("{object:?}: {quantity} is {asked}, and this device allows {limit}")]
    TooLarge {
        /// The object's name.
        object: String,
        /// What is too large, and its unit.
        quantity: &'static str,
        /// How much was asked for.
        asked: u64,
        /// How much there may be.
        limit: u64,
    },
    /// The device has not enough memory left.
    #[error("{object:?} needs {bytes} bytes, which the device does not have left of its {heap_bytes}")]
    OutOfMemory {
        /// The object's name.
        object: String,
        /// Bytes asked for.
        bytes: u64,
        /// Bytes of the device's largest heap.
        heap_bytes: u64,
    },
    /// A buffer was to be read or written while a submission that uses it has not ended.
    #[error("{object:?} is in use by a submission that has not ended")]
    InUse {
        /// The buffer's name.
        object: String,
    },
    /// Sizes, kinds or places that do not fit together.
    #[error("{object:?}: {mistake}")]
    Misuse {
        /// The object's name.
        object: String,
        /// What does not fit, with the numbers.
        mistake: String,
    },
    /// The device stopped working, and everything on it is gone.
    #[error(
        "the device was lost in {call} on {object:?} (a driver reset, often after a dispatch that ran for seconds); \
         open it again"
    )]
    DeviceLost {
        /// Vulkan's name for the call that noticed.
        call: &'static str,
        /// Our name for what it was called on.
        object: String,
    },
    /// A call failed in another way.
    #[error("{call} on {object:?} failed")]
    Call {
        /// Vulkan's name for the call.
        call: &'static str,
        /// Our name for what it was called on.
        object: String,
        /// Vulkan's reason.
        source: vk::Result,
    },
    /// The allocator failed in another way than by running out.
    #[error("no memory for {object:?}")]
    Allocator {
        /// The object's name.
        object: String,
        /// The allocator's reason.
        source: gpu_allocator::AllocationError,
    },
}

impl VulkanError {
    /// The error of `call` on `object`: what `.map_err` wants.
    pub(super) fn call(call: &'static str, object: &str) -> impl FnOnce(vk::Result) -> Self {
        move |source| {
            let object = object.to_owned();
            match source {
                vk::Result::ERROR_DEVICE_LOST => Self::DeviceLost { call, object },
                source => Self::Call { call, object, source },
            }
        }
    }

    /// `object` was used as it cannot be.
    pub(super) fn misuse(object: &str, mistake: impl Into<String>) -> Self {
        Self::Misuse { object: object.to_owned(), mistake: mistake.into() }
    }
}

/// Refuses `asked` of `quantity` where it is over `limit`.
pub(super) fn check_limit(object: &str, quantity: &'static str, asked: u64, limit: u64) -> Result<(), VulkanError> {
    if asked > limit {
        return Err(VulkanError::TooLarge { object: object.to_owned(), quantity, asked, limit });
    }
    Ok(())
}
