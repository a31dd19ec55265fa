//! Device memory of one object.

use ash::vk;
use gpu_allocator::{
    AllocationError, MemoryLocation,
    vulkan::{Allocation, AllocationCreateDesc, AllocationScheme},
};

use super::{Device, VulkanError, error::check_limit, lock};

/// A block of device memory, freed on drop.
#[derive(Debug)]
pub(super) struct Memory {
    allocation: Allocation,
    device: Device,
}

impl Memory {
    /// Allocates memory for the object `name`: in a block, or where the device has no memory for another block, `alone`, which
    /// names the buffer or image.
    pub(super) fn new(
        device: &Device,
        name: &str,
        requirements: vk::MemoryRequirements,
        location: MemoryLocation,
        alone: AllocationScheme,
    ) -> Result<Self, VulkanError> {
        let bytes = requirements.size;
        check_limit(name, "its memory in bytes", bytes, device.limits().max_allocation_bytes)?;
        let linear = matches!(alone, AllocationScheme::DedicatedBuffer(_));
        let allocate = |allocation_scheme| {
            if device.simulated().has_no_memory() {
                return Err(AllocationError::OutOfMemory);
            }
            let wanted = AllocationCreateDesc { name, requirements, location, linear, allocation_scheme };
            lock(device.allocator()).allocate(&wanted)
        };
        let allocated = match allocate(AllocationScheme::GpuAllocatorManaged) {
            Err(AllocationError::OutOfMemory) => allocate(alone),
            allocated => allocated,
        };
        let allocation = allocated.map_err(|source| match source {
            AllocationError::OutOfMemory => VulkanError::OutOfMemory {
                object: name.to_owned(),
                bytes,
                heap_bytes: device.limits().device_heap_bytes,
            },
            source => VulkanError::Allocator { object: name.to_owned(), source },
        })?;
        Ok(Self { allocation, device: device.clone() })
    }

    /// The memory to bind an object to, and the offset in it.
    pub(super) fn place(&self) -> (vk::DeviceMemory, u64) {
        // SAFETY: the handle is used to bind an object that is destroyed before `self`, and is not freed by hand.
        let memory = unsafe { self.allocation.memory() };
        (memory, self.allocation.offset())
    }

    /// Host address of the memory, if it is mapped.
    pub(super) fn host(&self) -> Option<*mut u8> {
        self.allocation.mapped_ptr().map(|pointer| pointer.as_ptr().cast())
    }
}

impl Drop for Memory {
    fn drop(&mut self) {
        let allocation = std::mem::take(&mut self.allocation);
        if let Err(error) = lock(self.device.allocator()).free(allocation) {
            tracing::warn!("cannot free device memory: {error}");
        }
    }
}
