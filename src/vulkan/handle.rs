//! One owner for each handle.

use std::{ffi::CString, fmt, sync::Arc};

use ash::{ext, prelude::VkResult, vk};

use super::{VulkanError, instance::Instance};

/// The logical device and its functions. Every handle holds it, so it goes last.
pub(super) struct RawDevice {
    pub(super) functions: ash::Device,
    /// `vkCmdPipelineBarrier2`, of Vulkan 1.3 or of the extension.
    pub(super) pipeline_barrier2: vk::PFN_vkCmdPipelineBarrier2,
    pub(super) names: Option<ext::debug_utils::Device>,
    pub(super) instance: Arc<Instance>,
}

impl Drop for RawDevice {
    fn drop(&mut self) {
        // SAFETY: everything made from the device holds an `Arc` of `self`, so nothing is left of it, and the
        // instance it came from is a field of `self`.
        unsafe { self.functions.destroy_device(None) };
        // The layer speaks up here about what was not destroyed, and nobody can ask any more.
        for message in self.instance.take_messages() {
            tracing::warn!("validation: {message}");
        }
    }
}

impl fmt::Debug for RawDevice {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("RawDevice").field("raw", &self.functions.handle()).finish_non_exhaustive()
    }
}

/// Destroys a handle of its type.
type Destroy<H> = unsafe fn(&ash::Device, H, Option<&vk::AllocationCallbacks<'_>>);

/// A handle and the duty to destroy it.
pub(super) struct Owned<H: vk::Handle + Copy> {
    raw: H,
    destroy: Destroy<H>,
    device: Arc<RawDevice>,
}

impl<H: vk::Handle + Copy> Owned<H> {
    /// Takes what `call` has just `made` on `device`, and names it `name`.
    ///
    /// The caller has made it in this expression (nobody else owns it), and `destroy` is the function for its type.
    pub(super) fn new(
        device: &Arc<RawDevice>,
        name: &str,
        call: &'static str,
        made: VkResult<H>,
        destroy: Destroy<H>,
    ) -> Result<Self, VulkanError> {
        let raw = made.map_err(VulkanError::call(call, name))?;
        let owned = Self { raw, destroy, device: Arc::clone(device) };
        owned.device.set_name(raw, name);
        Ok(owned)
    }

    /// The handle, for calls that end before `self` goes.
    pub(super) fn raw(&self) -> H {
        self.raw
    }

    /// Whether it was made on `device`.
    pub(super) fn is_on(&self, device: &Arc<RawDevice>) -> bool {
        Arc::ptr_eq(&self.device, device)
    }
}

impl RawDevice {
    /// Gives `object` a name for messages.
    pub(super) fn set_name<H: vk::Handle>(&self, object: H, name: &str) {
        let Some(functions) = &self.names else { return };
        let Ok(name) = CString::new(name.replace('\0', "")) else { return };
        let info = vk::DebugUtilsObjectNameInfoEXT::default().object_handle(object).object_name(&name);
        // SAFETY: `object` is a live handle of this device, and `name` outlives the call.
        let named = unsafe { functions.set_debug_utils_object_name(&info) };
        // An object without a name works as well.
        named.ok();
    }
}

impl<H: vk::Handle + Copy> Drop for Owned<H> {
    fn drop(&mut self) {
        // SAFETY: `self` is the only owner; submissions hold what they use until their fence has signalled, so the
        // device is done with it; and `destroy` is the function of this type of handle.
        unsafe { (self.destroy)(&self.device.functions, self.raw, None) };
    }
}

impl<H: vk::Handle + Copy + fmt::Debug> fmt::Debug for Owned<H> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.raw.fmt(formatter)
    }
}
