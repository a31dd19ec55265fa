//! Which devices there are, and which one is meant.

use std::{convert::Infallible, ffi::CStr, fmt, str::FromStr, sync::Arc};

use ash::{khr, vk};

use super::{Validation, VulkanError, instance::Instance};

/// What kind of device it is; earlier kinds are preferred.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum DeviceKind {
    /// A graphics card.
    Discrete,
    /// Graphics that share the processor's memory.
    Integrated,
    /// Graphics lent to a virtual machine.
    Virtual,
    /// None of the others.
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

/// What a device says of itself.
#[derive(Clone, Debug)]
pub struct DeviceInfo {
    /// Its place in [`devices`].
    pub index: usize,
    /// Its name.
    pub name: String,
    /// Its kind.
    pub kind: DeviceKind,
    /// Its driver's name and version, as the driver spells them.
    pub driver: String,
    /// The Vulkan version it has: major, minor, patch.
    pub api_version: [u32; 3],
    /// A sentence for each thing that this program needs and the device lacks. Empty: it can be opened.
    pub missing: Vec<String>,
}

/// Which device to open.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum DeviceChoice {
    /// The first usable one of the best kind there is: graphics before software.
    #[default]
    Auto,
    /// The one at this place in [`devices`].
    Index(usize),
    /// The first whose name contains this, in any case of letters.
    Name(String),
}

impl FromStr for DeviceChoice {
    type Err = Infallible;

    /// A number is an index, `auto` is [`Self::Auto`], anything else part of a name.
    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(match text.parse() {
            Ok(index) => Self::Index(index),
            Err(_) if text.eq_ignore_ascii_case("auto") => Self::Auto,
            Err(_) => Self::Name(text.to_owned()),
        })
    }
}

/// Every Vulkan device of this machine, usable or not.
///
/// # Errors
///
/// [`VulkanError::NoLoader`], [`VulkanError::NoDriver`], [`VulkanError::NoDevice`].
pub fn devices() -> Result<Vec<DeviceInfo>, VulkanError> {
    let instance = Instance::open(Validation::Off, &[])?;
    Ok(Candidate::all(&instance, Purpose::Compute)?.into_iter().map(|candidate| candidate.info).collect())
}

/// What a device is opened for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    /// Dispatches and copies.
    Compute,
    /// A window's frames too.
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

    /// The oldest version of Vulkan that will do: drawing without render passes is part of 1.3.
    fn least_version(self) -> u32 {
        match self {
            Self::Compute => vk::API_VERSION_1_2,
            #[cfg(feature = "window")]
            Self::Window => vk::API_VERSION_1_3,
        }
    }
}

/// A device that could be opened, with what opening needs.
pub(super) struct Candidate {
    pub(super) raw: vk::PhysicalDevice,
    pub(super) info: DeviceInfo,
    /// The family of queues to use, where one can compute.
    pub(super) queue: Option<QueueFamily>,
    /// Whether `synchronization2` is an extension here, and not yet part of Vulkan.
    pub(super) needs_extension: bool,
}

#[derive(Clone, Copy)]
pub(super) struct QueueFamily {
    pub(super) index: u32,
    pub(super) timestamp_valid_bits: u32,
}

impl Candidate {
    pub(super) fn all(instance: &Arc<Instance>, purpose: Purpose) -> Result<Vec<Self>, VulkanError> {
        // SAFETY: the call takes nothing but the instance, and the answer is copied out.
        let listed = unsafe { instance.raw.enumerate_physical_devices() };
        let raw = match listed {
            // A loader whose drivers all gave up answers like this.
            Err(vk::Result::ERROR_INITIALIZATION_FAILED) => Vec::new(),
            other => other.map_err(VulkanError::call("vkEnumeratePhysicalDevices", "instance"))?,
        };
        if raw.is_empty() {
            return Err(VulkanError::NoDevice);
        }
        raw.into_iter().enumerate().map(|(index, device)| Self::new(instance, device, index, purpose)).collect()
    }

    /// The device that `choice` means.
    pub(super) fn choose(mut all: Vec<Self>, choice: &DeviceChoice) -> Result<Self, VulkanError> {
        let (found, wanted) = match choice {
            DeviceChoice::Auto => {
                // The first of the best; an unusable one only to say why it is.
                let best = all.iter().min_by_key(|one| (!one.info.missing.is_empty(), one.info.kind));
                (best.map(|one| one.info.index), String::new())
            }
            DeviceChoice::Index(index) => ((*index < all.len()).then_some(*index), format!("number {index}")),
            DeviceChoice::Name(part) => {
                let part_of = |one: &Self| one.info.name.to_lowercase().contains(&part.to_lowercase());
                (all.iter().position(part_of), format!("called {part:?}"))
            }
        };
        let Some(index) = found else {
            let names = all.iter().map(|one| format!("{} {:?}", one.info.index, one.info.name)).collect();
            return Err(VulkanError::NoMatch { wanted, names });
        };
        Ok(all.swap_remove(index))
    }

    fn new(
        instance: &Arc<Instance>,
        raw: vk::PhysicalDevice,
        index: usize,
        purpose: Purpose,
    ) -> Result<Self, VulkanError> {
        // SAFETY: `raw` comes from this instance; the answer is a plain value.
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
            let missing = format!("it has Vulkan {major}.{minor}.{patch}, and {least_major}.{least_minor} is needed");
            candidate.info.missing.push(missing);
            return Ok(candidate);
        }

        let mut driver = vk::PhysicalDeviceDriverProperties::default();
        let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut driver);
        // SAFETY: the chain holds a structure of Vulkan 1.2, which this device has, and which outlives the call.
        unsafe { instance.raw.get_physical_device_properties2(raw, &mut properties) };
        let driver = [text(driver.driver_name_as_c_str()), text(driver.driver_info_as_c_str())];
        candidate.info.driver = driver.join(" ").trim().to_owned();

        // SAFETY: `raw` comes from this instance; the answer is copied out.
        let families = unsafe { instance.raw.get_physical_device_queue_family_properties(raw) };
        let computes = |family: &vk::QueueFamilyProperties| family.queue_flags.contains(purpose.queue_flags());
        candidate.queue = (0..)
            .zip(&families)
            .find(|(_, family)| computes(family))
            .map(|(index, family)| QueueFamily { index, timestamp_valid_bits: family.timestamp_valid_bits });
        if candidate.queue.is_none() {
            candidate.info.missing.push(format!("none of its queues does {:?}", purpose.queue_flags()));
        }
        if !candidate.has_synchronization2(instance)? {
            candidate.info.missing.push("it lacks synchronization2 (Vulkan 1.3 or VK_KHR_synchronization2)".to_owned());
        }
        Ok(candidate)
    }

    fn has_synchronization2(&self, instance: &Arc<Instance>) -> Result<bool, VulkanError> {
        if self.needs_extension {
            // SAFETY: the device comes from this instance; the answer is copied out.
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
        // SAFETY: the device knows the chained structure, by its version or by the extension found above.
        unsafe { instance.raw.get_physical_device_features2(self.raw, &mut features) };
        Ok(synchronization2.synchronization2 == vk::TRUE)
    }
}

/// A fixed array of bytes from a driver, as far as it is text.
fn text<E>(bytes: Result<&CStr, E>) -> String {
    bytes.map_or_else(|_| String::new(), |text| text.to_string_lossy().into_owned())
}
