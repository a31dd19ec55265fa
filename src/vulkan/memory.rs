//! Device memory for one object.

use ash::vk;
use gpu_allocator::{
    AllocationError, MemoryLocation,
    vulkan::{Allocation, AllocationCreateDesc, AllocationScheme},
};

use super::{Device, VulkanError, error::check_limit, lock};

/// A piece of device memory, given back when dropped.
#[derive(Debug)]
pub(super) struct Memory {
    allocation: Allocation,
    device: Device,
}

impl Memory {
    /// Memory for the object `name`; `linear` for buffers, not for images.
    pub(super) fn new(
        device: &Device,
        name: &str,
        requirements: vk::MemoryRequirements,
        location: MemoryLocation,
        linear: bool,
    ) -> Result<Self, VulkanError> {
        let bytes = requirements.size;
        check_limit(name, "its memory in bytes", bytes, device.limits().max_allocation_bytes)?;
        let wanted = AllocationCreateDesc {
            name,
            requirements,
            location,
            linear,
            allocation_scheme: AllocationScheme::GpuAllocatorManaged,
        };
        let allocated = if device.simulated().has_no_memory() {
            Err(AllocationError::OutOfMemory)
        } else {
            lock(device.allocator()).allocate(&wanted)
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

    /// What to bind an object to: the memory and the offset in it.
    pub(super) fn place(&self) -> (vk::DeviceMemory, u64) {
        // SAFETY: the handle is used to bind an object that is destroyed before `self`, and is not freed by hand.
        let memory = unsafe { self.allocation.memory() };
        (memory, self.allocation.offset())
    }

    /// Where the host sees it, if it does.
    pub(super) fn host(&self) -> Option<*mut u8> {
        self.allocation.mapped_ptr().map(|pointer| pointer.as_ptr().cast())
    }
}

/// Gives memory that was freed back to the system, where the system's allocator does not do that by itself: of glibc, every
/// thread has a heap of its own, which keeps what it once had. A software device makes its shaders there, too.
pub fn give_back_freed() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        unsafe extern "C" {
            /// `malloc_trim(3)`.
            fn malloc_trim(keep: usize) -> std::ffi::c_int;
        }
        // SAFETY: glibc's own function of this signature, which locks what it looks at and moves nothing that is in use.
        unsafe { malloc_trim(0) };
    }
}

impl Drop for Memory {
    fn drop(&mut self) {
        let allocation = std::mem::take(&mut self.allocation);
        if let Err(error) = lock(self.device.allocator()).free(allocation) {
            tracing::warn!("device memory could not be freed: {error}");
        }
    }
}
