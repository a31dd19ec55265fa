//! List of devices, and the choice of one.

use std::{convert::Infallible, ffi::CStr, fmt, str::FromStr, sync::Arc};

use ash::{khr, vk};

use super::{Validation, VulkanError, instance::Instance};

/// Kind of device; earlier kinds are preferred.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum DeviceKind {
    /// A graphics card.
    Discrete,
    /// A GPU that shares the processor's memory.
    Integrated,
    /// A GPU passed to a virtual machine.
    Virtual,
    /// Any other kind.
    Other,
    /// The processor itself (lavapipe).
    Software,
}

impl fmt::Display for DeviceKind {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Discrete => "discrete GPU",
            Self::Integrated => "integrated GPU",
            Self::Virtual => "virtual GPU",
            Self::Other => "other device",
            Self::Software => "software",
        })
    }
}

/// Properties of a device.
#[derive(Clone, Debug)]
pub struct DeviceInfo {
    /// Index in [`devices`].
    pub index: usize,
    /// Name.
    pub name: String,
    /// Kind.
    pub kind: DeviceKind,
    /// Driver name and version, as the driver spells them.
    pub driver: String,
    /// Supported Vulkan version: major, minor, patch.
    pub api_version: [u32; 3],
    /// One sentence per required feature that the device lacks. Empty if the device can be opened.
    pub missing: Vec<String>,
}

/// Which device to open.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum DeviceChoice {
    /// The first usable device of the best kind; GPUs come before software.
    #[default]
    Auto,
    /// The device at this index of [`devices`].
    Index(usize),
    /// The first device whose name contains this text, ignoring case.
    Name(String),
}

impl FromStr for DeviceChoice {
    type Err = Infallible;

    /// Parses a number as an index, `auto` as [`Self::Auto`], and any other text as part of a name.
    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(match text.parse() {
            Ok(index) => Self::Index(index),
            Err(_) if text.eq_ignore_ascii_case("auto") => Self::Auto,
            Err(_) => Self::Name(text.to_owned()),
        })
    }
}

/// Returns every Vulkan device of this machine, usable or not.
///
/// # Errors
///
/// [`VulkanError::NoLoader`], [`VulkanError::NoDriver`], [`VulkanError::NoDevice`].
pub fn devices() -> Result<Vec<DeviceInfo>, VulkanError> {
    let instance = Instance::open(Validation::Off, &[])?;
    Ok(Candidate::all(&instance, Purpose::Compute)?.into_iter().map(|candidate| candidate.info).collect())
}

/// Purpose of an open device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    /// Dispatches and copies.
    Compute,
    /// Also presenting to a window.
    #[cfg(feature = "window")]
    Window,
}

impl Purpose {
    fn queue_flags(self) -> vk::QueueFlags {
        match self {
            Self::Compute => vk::QueueFlags::COMPUTE,
            #[cfg(feature = "window")]
            Self::Window => vk::QueueFlags::COMPUTE | vk::QueueFlags::GRAPHICS,
        }
    }

    /// Oldest sufficient Vulkan version: a window needs dynamic rendering, which is part of 1.3.
    fn least_version(self) -> u32 {
        match self {
            Self::Compute => vk::API_VERSION_1_2,
            #[cfg(feature = "window")]
            Self::Window => vk::API_VERSION_1_3,
        }
    }
}

/// A physical device with all that is needed to open it.
pub(super) struct Candidate {
    pub(super) raw: vk::PhysicalDevice,
    pub(super) info: DeviceInfo,
    /// Queue family to use, if one supports the purpose.
    pub(super) queue: Option<QueueFamily>,
    /// Whether `synchronization2` is an extension on this device (before Vulkan 1.3).
    pub(super) needs_extension: bool,
}

#[derive(Clone, Copy)]
pub(super) struct QueueFamily {
    pub(super) index: u32,
    pub(super) timestamp_valid_bits: u32,
}

impl Candidate {
    pub(super) fn all(instance: &Arc<Instance>, purpose: Purpose) -> Result<Vec<Self>, VulkanError> {
        // SAFETY: the call takes only the instance, and the result is copied out.
        let listed = unsafe { instance.raw.enumerate_physical_devices() };
        let raw = match listed {
            // Returned by the loader when every driver fails to start.
            Err(vk::Result::ERROR_INITIALIZATION_FAILED) => Vec::new(),
            other => other.map_err(VulkanError::call("vkEnumeratePhysicalDevices", "instance"))?,
        };
        if raw.is_empty() {
            return Err(VulkanError::NoDevice);
        }
        raw.into_iter().enumerate().map(|(index, device)| Self::new(instance, device, index, purpose)).collect()
    }

    /// Returns the device that `choice` selects.
    pub(super) fn choose(mut all: Vec<Self>, choice: &DeviceChoice) -> Result<Self, VulkanError> {
        let (found, wanted) = match choice {
            DeviceChoice::Auto => {
                // The first device of the best kind. An unusable one is chosen only to report why it is unusable.
                let best = all.iter().min_by_key(|one| (!one.info.missing.is_empty(), one.info.kind));
                (best.map(|one| one.info.index), String::new())
            }
            DeviceChoice::Index(index) => ((*index < all.len()).then_some(*index), format!("has the index {index}")),
            DeviceChoice::Name(part) => {
                let part_of = |one: &Self| one.info.name.to_lowercase().contains(&part.to_lowercase());
                (all.iter().position(part_of), format!("has a name with {part:?}"))
            }
        };
        let Some(index) = found else {
            let names = all.iter().map(|one| format!("{} {:?}", one.info.index, one.info.name)).collect();
            return Err(VulkanError::NoMatch { wanted, names });
        };
        Ok(all.swap_remove(index))
    }

    pub(super) fn new(
        instance: &Arc<Instance>,
        raw: vk::PhysicalDevice,
        index: usize,
        purpose: Purpose,
    ) -> Result<Self, VulkanError> {
        // SAFETY: `raw` comes from this instance; the result is a plain value.
        let properties = unsafe { instance.raw.get_physical_device_properties(raw) };
        let version = properties.api_version;
        let mut candidate = Self {
            raw,
            info: DeviceInfo {
                index,
                name: text(properties.device_name_as_c_str()),
                kind: match properties.device_type {
                    vk::PhysicalDeviceType::DISCRETE_GPU => DeviceKind::Discrete,
                    vk::PhysicalDeviceType::INTEGRATED_GPU => DeviceKind::Integrated,
                    vk::PhysicalDeviceType::VIRTUAL_GPU => DeviceKind::Virtual,
                    vk::PhysicalDeviceType::CPU => DeviceKind::Software,
                    _ => DeviceKind::Other,
                },
                driver: "unknown".to_owned(),
                api_version: [
                    vk::api_version_major(version),
                    vk::api_version_minor(version),
                    vk::api_version_patch(version),
                ],
                missing: Vec::new(),
            },
            queue: None,
            needs_extension: version < vk::API_VERSION_1_3,
        };
        let least = purpose.least_version();
        if version < least {
            let [major, minor, patch] = candidate.info.api_version;
            let [least_major, least_minor] = [vk::api_version_major(least), vk::api_version_minor(least)];
            let missing =
                format!("it has Vulkan {major}.{minor}.{patch}, and Relume needs {least_major}.{least_minor}");
            candidate.info.missing.push(missing);
            return Ok(candidate);
        }

        let mut driver = vk::PhysicalDeviceDriverProperties::default();
        let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut driver);
        // SAFETY: the chained structure is part of Vulkan 1.2, which this device supports, and outlives the call.
        unsafe { instance.raw.get_physical_device_properties2(raw, &mut properties) };
        let driver = [text(driver.driver_name_as_c_str()), text(driver.driver_info_as_c_str())];
        candidate.info.driver = driver.join(" ").trim().to_owned();

        candidate.queue = candidate.families(instance, purpose).next();
        if candidate.queue.is_none() {
            candidate.info.missing.push(format!("it has no queue for {:?}", purpose.queue_flags()));
        }
        if !candidate.has_synchronization2(instance)? {
            candidate.info.missing.push("it lacks synchronization2 (Vulkan 1.3 or VK_KHR_synchronization2)".to_owned());
        }
        Ok(candidate)
    }

    /// Queue families for `purpose`.
    fn families(&self, instance: &Arc<Instance>, purpose: Purpose) -> impl Iterator<Item = QueueFamily> + use<> {
        // SAFETY: the device comes from this instance; the result is copied out.
        let families = unsafe { instance.raw.get_physical_device_queue_family_properties(self.raw) };
        let suits = move |family: &vk::QueueFamilyProperties| family.queue_flags.contains(purpose.queue_flags());
        (0..)
            .zip(families)
            .filter(move |(_, family)| suits(family))
            .map(|(index, family)| QueueFamily { index, timestamp_valid_bits: family.timestamp_valid_bits })
    }

    /// The queue family of this `index`, if it computes.
    pub(super) fn compute_family(&self, instance: &Arc<Instance>, index: u32) -> Option<QueueFamily> {
        self.families(instance, Purpose::Compute).find(|family| family.index == index)
    }

    fn has_synchronization2(&self, instance: &Arc<Instance>) -> Result<bool, VulkanError> {
        if self.needs_extension {
            // SAFETY: the device comes from this instance; the result is copied out.
            let listed = unsafe { instance.raw.enumerate_device_extension_properties(self.raw) };
            let extensions =
                listed.map_err(VulkanError::call("vkEnumerateDeviceExtensionProperties", &self.info.name))?;
            let wanted = Ok(khr::synchronization2::NAME);
            if !extensions.iter().any(|extension| extension.extension_name_as_c_str() == wanted) {
                return Ok(false);
            }
        }
        let mut synchronization2 = vk::PhysicalDeviceSynchronization2Features::default();
        let mut features = vk::PhysicalDeviceFeatures2::default().push_next(&mut synchronization2);
        // SAFETY: the device supports the chained structure, by its version or by the extension found above.
        unsafe { instance.raw.get_physical_device_features2(self.raw, &mut features) };
        Ok(synchronization2.synchronization2 == vk::TRUE)
    }
}

/// Converts a string from a driver; empty if it is not NUL-terminated.
fn text<E>(bytes: Result<&CStr, E>) -> String {
    bytes.map_or_else(|_| String::new(), |text| text.to_string_lossy().into_owned())
}
