//! Errors of the Vulkan layer.

use ash::vk;

use super::Format;

/// Hint on how to install a Vulkan device.
const INSTALL: &str = "on Debian or Ubuntu `apt-get install libvulkan1 mesa-vulkan-drivers` installs a software device";

/// The environment variable that leaves the loader only some drivers, if one does.
fn only_of_variable() -> String {
    let names = ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"];
    let set = names.into_iter().find_map(|name| Some((name, std::env::var_os(name)?)));
    set.map_or_else(String::new, |(name, value)| {
        format!(" ({name} is set to {}: only its drivers are used)", value.display())
    })
}

/// Error of a Vulkan operation.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum VulkanError {
    /// `libvulkan.so.1` is missing or cannot be loaded.
    #[error("cannot load the Vulkan loader (libvulkan.so.1); {INSTALL}")]
    NoLoader {
        /// Message of the dynamic linker.
        source: ash::LoadingError,
    },
    /// The loader finds no driver.
    #[error("the Vulkan loader finds no driver; {INSTALL}{}", only_of_variable())]
    NoDriver,
    /// No driver has a device.
    #[error("the Vulkan drivers have no device; {INSTALL}")]
    NoDevice,
    /// No device has the requested index or name.
    #[error("no Vulkan device {wanted}; the devices are: {}", .names.join(", "))]
    NoMatch {
        /// The index, or the name in quotes.
        wanted: String,
        /// Index and name of every device.
        names: Vec<String>,
    },
    /// The device lacks required features.
    #[error("the Vulkan device {device:?} cannot be used: {}", .missing.join("; "))]
    Unsuitable {
        /// The device's name.
        device: String,
        /// One sentence per missing feature.
        missing: Vec<String>,
    },
    /// The validation layer was requested but is not installed.
    #[error(
        "the layer VK_LAYER_KHRONOS_validation is not installed; \
         on Debian or Ubuntu `apt-get install vulkan-validationlayers`"
    )]
    NoValidation,
    /// The drivers cannot present to a window of this display.
    #[error("the Vulkan drivers cannot present to windows of this display: they lack {lacking}")]
    NoWindow {
        /// The missing extension.
        lacking: String,
    },
    /// The panels of a window could not be drawn.
    #[error("cannot draw the panels")]
    Panels {
        /// Error of the panel renderer.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// The device does not support this use of the format.
    #[error("{object:?}: this device does not support {format:?} as {purpose}")]
    NoFormat {
        /// The image's name.
        object: String,
        /// Its format.
        format: Format,
        /// The intended use.
        purpose: &'static str,
    },
    /// A size exceeds a device limit. Nothing was allocated.
    #[error("{object:?}: {quantity} is {asked}, and this device allows {limit}")]
    TooLarge {
        /// The object's name.
        object: String,
        /// The quantity that is too large, with its unit.
        quantity: &'static str,
        /// Requested amount.
        asked: u64,
        /// Largest amount that the device allows.
        limit: u64,
    },
    /// The device has not enough free memory.
    #[error("{object:?} needs {bytes} bytes, and the device does not have them free of its {heap_bytes}")]
    OutOfMemory {
        /// The object's name.
        object: String,
        /// Requested bytes.
        bytes: u64,
        /// Bytes of the device's largest heap.
        heap_bytes: u64,
    },
    /// A buffer was accessed while a submission that uses it had not finished.
    #[error("{object:?} is in use by an unfinished submission")]
    InUse {
        /// The buffer's name.
        object: String,
    },
    /// Sizes, kinds or offsets do not match.
    #[error("{object:?}: {mistake}")]
    Misuse {
        /// The object's name.
        object: String,
        /// The mismatch, with its numbers.
        mistake: String,
    },
    /// The device was lost, with everything on it.
    #[error(
        "the device was lost in {call} on {object:?} (a driver reset, often after a dispatch that ran for seconds); \
         open it again"
    )]
    DeviceLost {
        /// Vulkan name of the call that reported the loss.
        call: &'static str,
        /// Relume's name of the object.
        object: String,
    },
    /// A call failed for another reason.
    #[error("{call} on {object:?} failed")]
    Call {
        /// Vulkan name of the call.
        call: &'static str,
        /// Relume's name of the object.
        object: String,
        /// Vulkan's result code.
        source: vk::Result,
    },
    /// The allocator failed for a reason other than lack of memory.
    #[error("no memory for {object:?}")]
    Allocator {
        /// The object's name.
        object: String,
        /// The allocator's error.
        source: gpu_allocator::AllocationError,
    },
}

impl VulkanError {
    /// Name for programs; it does not change between versions.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::NoLoader { .. } => "vulkan-loader-missing",
            Self::NoDriver => "vulkan-driver-missing",
            Self::NoDevice => "device-missing",
            Self::NoMatch { .. } => "device-unknown",
            Self::Unsuitable { .. } => "device-unsuitable",
            Self::NoValidation => "validation-layer-missing",
            Self::NoWindow { .. } => "window-unsupported",
            Self::Panels { .. } => "panels-not-drawn",
            Self::NoFormat { .. } => "format-unsupported",
            Self::TooLarge { .. } => "device-limit-exceeded",
            Self::OutOfMemory { .. } => "device-memory-short",
            Self::InUse { .. } => "buffer-in-use",
            Self::Misuse { .. } => "vulkan-misuse",
            Self::DeviceLost { .. } => "device-lost",
            Self::Call { .. } => "vulkan-call-failed",
            Self::Allocator { .. } => "allocator-failed",
        }
    }

    /// Returns a closure for `map_err` that wraps the error of `call` on `object`.
    pub(crate) fn call(call: &'static str, object: &str) -> impl FnOnce(vk::Result) -> Self {
        move |source| {
            let object = object.to_owned();
            match source {
                vk::Result::ERROR_DEVICE_LOST => Self::DeviceLost { call, object },
                source => Self::Call { call, object, source },
            }
        }
    }

    /// Returns a [`Self::Misuse`] of `object`.
    pub(crate) fn misuse(object: &str, mistake: impl Into<String>) -> Self {
        Self::Misuse { object: object.to_owned(), mistake: mistake.into() }
    }
}

/// Returns an error if `asked` of `quantity` exceeds `limit`.
pub(super) fn check_limit(object: &str, quantity: &'static str, asked: u64, limit: u64) -> Result<(), VulkanError> {
    if asked > limit {
        return Err(VulkanError::TooLarge { object: object.to_owned(), quantity, asked, limit });
    }
    Ok(())
}
