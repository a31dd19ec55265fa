//! Command buffers, and the objects that a submission of one needs.

use std::sync::Arc;

use ash::vk;

use super::{
    VulkanError,
    handle::{Owned, RawDevice},
};

/// Largest number of timestamps per submission.
pub(super) const MAX_TIMESTAMPS: u32 = 16;

/// A command buffer with the objects that one submission of it needs. Reused.
#[derive(Debug)]
pub(super) struct CommandSlot {
    /// Owned by `pool`.
    pub(super) commands: vk::CommandBuffer,
    pub(super) pool: Owned<vk::CommandPool>,
    pub(super) fence: Owned<vk::Fence>,
    pub(super) timestamps: Owned<vk::QueryPool>,
}

impl CommandSlot {
    /// Makes a slot for the queues of `queue_family`.
    pub(super) fn new(raw: &Arc<RawDevice>, queue_family: u32) -> Result<Self, VulkanError> {
        let name = "commands";
        let info = vk::CommandPoolCreateInfo::default()
            .flags(vk::CommandPoolCreateFlags::TRANSIENT)
            .queue_family_index(queue_family);
        // SAFETY: the device was opened with this queue family.
        let made = unsafe { raw.functions.create_command_pool(&info, None) };
        let pool = Owned::new(raw, name, "vkCreateCommandPool", made, ash::Device::destroy_command_pool)?;
        let info = vk::CommandBufferAllocateInfo::default().command_pool(pool.raw()).command_buffer_count(1);
        // SAFETY: the pool is new and not shared.
        let made = unsafe { raw.functions.allocate_command_buffers(&info) };
        let commands = made
            .and_then(|buffers| buffers.first().copied().ok_or(vk::Result::ERROR_UNKNOWN))
            .map_err(VulkanError::call("vkAllocateCommandBuffers", name))?;
        raw.set_name(commands, name);
        // SAFETY: a default description is always valid.
        let made = unsafe { raw.functions.create_fence(&vk::FenceCreateInfo::default(), None) };
        let fence = Owned::new(raw, name, "vkCreateFence", made, ash::Device::destroy_fence)?;
        let info = vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(MAX_TIMESTAMPS);
        // SAFETY: the query count is non-zero.
        let made = unsafe { raw.functions.create_query_pool(&info, None) };
        let timestamps = Owned::new(raw, name, "vkCreateQueryPool", made, ash::Device::destroy_query_pool)?;
        Ok(Self { commands, pool, fence, timestamps })
    }
}
