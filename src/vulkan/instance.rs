//! Vulkan loader, instance and validation messages.

use std::{
    ffi::{CStr, c_void},
    sync::{Arc, Mutex},
};

use ash::{ext, vk};

use super::{VulkanError, lock};

const VALIDATION_LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

/// Object name in errors that occur before any object exists.
const INSTANCE: &str = "instance";

/// Whether the Khronos validation layer checks every call.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Validation {
    /// No validation layer.
    #[default]
    Off,
    /// The validation layer with synchronisation validation. See [`super::Device::validation_messages`].
    On,
}

/// A Vulkan instance, the parent of all other objects.
pub(crate) struct Instance {
    pub(crate) raw: ash::Instance,
    /// Whether objects can be named.
    pub(super) has_debug_utils: bool,
    messenger: Option<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    /// Boxed because the messenger holds its address.
    messages: Box<Mutex<Vec<String>>>,
    /// The loaded library, whose functions `raw` calls.
    pub(crate) entry: ash::Entry,
    /// True if somebody else made the instance and destroys it.
    is_lent: bool,
}

impl Instance {
    /// Creates an instance with the extensions `wanted`. An extension that the loader lacks is a
    /// [`VulkanError::NoWindow`].
    pub(super) fn open(validation: Validation, wanted: &[&'static CStr]) -> Result<Arc<Self>, VulkanError> {
        // SAFETY: this runs the initialisers of the system's Vulkan loader, which are safe for any program to run.
        let entry = unsafe { ash::Entry::load() }.map_err(|source| VulkanError::NoLoader { source })?;

        let mut layers = Vec::new();
        let mut extensions = extensions(&entry, None)?;
        if validation == Validation::On {
            if !has_layer(&entry, VALIDATION_LAYER)? {
                return Err(VulkanError::NoValidation);
            }
            layers.push(VALIDATION_LAYER.as_ptr());
            extensions.extend(self::extensions(&entry, Some(VALIDATION_LAYER))?);
        }
        let has = |name: &CStr| extensions.iter().any(|found| found.extension_name_as_c_str() == Ok(name));
        let has_debug_utils = has(ext::debug_utils::NAME);
        if let Some(lacking) = wanted.iter().find(|name| !has(name)) {
            // A missing driver also hides the window extensions; in this case the call returns its more precise error.
            Self::open(validation, &[])?;
            return Err(VulkanError::NoWindow { lacking: lacking.to_string_lossy().into_owned() });
        }
        let mut enabled: Vec<_> = wanted.iter().map(|name| name.as_ptr()).collect();
        if has_debug_utils {
            enabled.push(ext::debug_utils::NAME.as_ptr());
        }
        if validation == Validation::On && has(ext::validation_features::NAME) {
            enabled.push(ext::validation_features::NAME.as_ptr());
        }

        let application = vk::ApplicationInfo::default()
            .application_name(c"relume")
            .engine_name(c"relume")
            // The highest version in use; a device of version 1.2 is sufficient.
            .api_version(vk::API_VERSION_1_3);
        let checks = [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];
        let mut features = vk::ValidationFeaturesEXT::default().enabled_validation_features(&checks);
        let mut info = vk::InstanceCreateInfo::default()
            .application_info(&application)
            .enabled_layer_names(&layers)
            .enabled_extension_names(&enabled);
        if validation == Validation::On {
            info = info.push_next(&mut features);
        }
        // SAFETY: `info` borrows arrays and strings that outlive the call, and names only layers and extensions that
        // the loader has just listed.
        let made = unsafe { entry.create_instance(&info, None) };
        let raw = made.map_err(|source| match source {
            vk::Result::ERROR_INCOMPATIBLE_DRIVER => VulkanError::NoDriver,
            source => VulkanError::call("vkCreateInstance", INSTANCE)(source),
        })?;
        let mut instance = Self {
            raw,
            has_debug_utils,
            messenger: None,
            messages: Box::new(Mutex::new(Vec::new())),
            entry,
            is_lent: false,
        };
        if validation == Validation::On && has_debug_utils {
            instance.listen()?;
        }
        Ok(Arc::new(instance))
    }

    /// An instance that somebody else made and destroys.
    pub(super) fn lent(entry: ash::Entry, raw: ash::Instance) -> Arc<Self> {
        let messages = Box::new(Mutex::new(Vec::new()));
        Arc::new(Self { raw, has_debug_utils: false, messenger: None, messages, entry, is_lent: true })
    }

    /// Starts to collect messages of the validation layer.
    fn listen(&mut self) -> Result<(), VulkanError> {
        let functions = ext::debug_utils::Instance::new(&self.entry, &self.raw);
        let info = vk::DebugUtilsMessengerCreateInfoEXT::default()
            .message_severity(
                vk::DebugUtilsMessageSeverityFlagsEXT::ERROR | vk::DebugUtilsMessageSeverityFlagsEXT::WARNING,
            )
            // Performance advice is not an error.
            .message_type(vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION)
            .pfn_user_callback(Some(on_message))
            .user_data(std::ptr::from_ref::<Mutex<Vec<String>>>(&self.messages).cast_mut().cast());
        // SAFETY: the user data is the boxed `messages`. It does not move, and `Drop` ensures that it outlives the
        // messenger. The callback only makes a shared reference of it.
        let made = unsafe { functions.create_debug_utils_messenger(&info, None) };
        let messenger = made.map_err(VulkanError::call("vkCreateDebugUtilsMessengerEXT", INSTANCE))?;
        self.messenger = Some((functions, messenger));
        Ok(())
    }

    /// Returns the validation messages since the last call.
    pub(super) fn take_messages(&self) -> Vec<String> {
        std::mem::take(&mut *lock(&self.messages))
    }
}

impl std::fmt::Debug for Instance {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Instance").field("raw", &self.raw.handle()).finish_non_exhaustive()
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        if let Some((functions, messenger)) = self.messenger.take() {
            // SAFETY: the messenger came from this instance, and `take` ensures that it is destroyed once.
            unsafe { functions.destroy_debug_utils_messenger(messenger, None) };
        }
        if !self.is_lent {
            // SAFETY: every object made from the instance holds an `Arc` of it, so none is left. `self` is its only owner.
            unsafe { self.raw.destroy_instance(None) };
        }
    }
}

/// Returns the extensions of the loader and the drivers, or those of `layer`.
fn extensions(entry: &ash::Entry, layer: Option<&CStr>) -> Result<Vec<vk::ExtensionProperties>, VulkanError> {
    // SAFETY: `layer` is `None` or a NUL-terminated name that outlives the call; the result is copied out.
    let listed = unsafe { entry.enumerate_instance_extension_properties(layer) };
    listed.map_err(|source| match source {
        vk::Result::ERROR_INCOMPATIBLE_DRIVER => VulkanError::NoDriver,
        source => VulkanError::call("vkEnumerateInstanceExtensionProperties", INSTANCE)(source),
    })
}

fn has_layer(entry: &ash::Entry, name: &CStr) -> Result<bool, VulkanError> {
    // SAFETY: the call takes only the loaded entry, and the result is copied out.
    let listed = unsafe { entry.enumerate_instance_layer_properties() };
    let layers = listed.map_err(VulkanError::call("vkEnumerateInstanceLayerProperties", INSTANCE))?;
    Ok(layers.iter().any(|layer| layer.layer_name_as_c_str() == Ok(name)))
}

/// Stores a message of the validation layer.
unsafe extern "system" fn on_message(
    _severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _types: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    messages: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: `messages` is the pointer from `listen`: a boxed `Mutex` that outlives the messenger that calls this.
    let messages = unsafe { messages.cast::<Mutex<Vec<String>>>().as_ref() };
    // SAFETY: the layer passes a structure that is valid during this call.
    let data = unsafe { data.as_ref() };
    if let (Some(messages), Some(data)) = (messages, data) {
        // SAFETY: `p_message` is null or a NUL-terminated string that is valid during this call.
        let message = unsafe { data.message_as_c_str() };
        lock(messages).push(message.map_or_else(String::new, |text| text.to_string_lossy().into_owned()));
    }
    // Vulkan must not abort the call that caused the message.
    vk::FALSE
}
