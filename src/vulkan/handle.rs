//! Ownership of Vulkan handles.

use std::{ffi::CString, fmt, sync::Arc};

use ash::{ext, prelude::VkResult, vk};

use super::{VulkanError, instance::Instance};

/// The logical device and its functions. Every handle holds a reference, so the device is destroyed last.
pub(crate) struct RawDevice {
    pub(crate) functions: ash::Device,
    /// `vkCmdPipelineBarrier2` of Vulkan 1.3 or of the extension.
    pub(crate) pipeline_barrier2: vk::PFN_vkCmdPipelineBarrier2,
    pub(crate) names: Option<ext::debug_utils::Device>,
    pub(crate) instance: Arc<Instance>,
    /// True if somebody else made the device and destroys it.
    pub(super) is_lent: bool,
}

impl Drop for RawDevice {
    fn drop(&mut self) {
        if !self.is_lent {
            // SAFETY: every object made from the device holds an `Arc` of `self`, so none is left. Its instance is a field
            // of `self`.
            unsafe { self.functions.destroy_device(None) };
        }
        // The validation layer reports leaked objects here, when no caller can read the messages any more.
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

/// Function that destroys a handle of this type.
type Destroy<H> = unsafe fn(&ash::Device, H, Option<&vk::AllocationCallbacks<'_>>);

/// A handle that is destroyed on drop.
pub(crate) struct Owned<H: vk::Handle + Copy> {
    raw: H,
    destroy: Destroy<H>,
    device: Arc<RawDevice>,
}

impl<H: vk::Handle + Copy> Owned<H> {
    /// Takes ownership of the handle that `call` has `made` on `device`, and names it `name`.
    ///
    /// The caller must have created the handle in the same expression, so that it has no other owner. `destroy` must be
    /// the function for its type.
    pub(crate) fn new(
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

    /// The handle, for calls that end before `self` is dropped.
    pub(crate) fn raw(&self) -> H {
        self.raw
    }

    /// Whether the handle was made on `device`.
    pub(crate) fn is_on(&self, device: &Arc<RawDevice>) -> bool {
        Arc::ptr_eq(&self.device, device)
    }
}

impl RawDevice {
    /// Names `object` in validation messages.
    pub(crate) fn set_name<H: vk::Handle>(&self, object: H, name: &str) {
        let Some(functions) = &self.names else { return };
        let Ok(name) = CString::new(name.replace('\0', "")) else { return };
        let info = vk::DebugUtilsObjectNameInfoEXT::default().object_handle(object).object_name(&name);
        // SAFETY: `object` is a live handle of this device, and `name` outlives the call.
        let named = unsafe { functions.set_debug_utils_object_name(&info) };
        // The name is optional, so an error does not matter.
        named.ok();
    }
}

impl<H: vk::Handle + Copy> Drop for Owned<H> {
    fn drop(&mut self) {
        // SAFETY: `self` is the only owner. Submissions keep what they use until their fence has signalled, so the
        // device no longer uses the handle. `destroy` is the function for this type of handle.
        unsafe { (self.destroy)(&self.device.functions, self.raw, None) };
    }
}

impl<H: vk::Handle + Copy + fmt::Debug> fmt::Debug for Owned<H> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.raw.fmt(formatter)
    }
}
