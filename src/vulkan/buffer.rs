//! Buffers.

use std::sync::{Arc, Mutex};

use ash::vk;
use gpu_allocator::{MemoryLocation, vulkan::AllocationScheme};

use super::{Device, VulkanError, error::check_limit, handle::Owned, lock, memory::Memory};

/// Use of a host-visible buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HostUse {
    /// Written by the host, read by copies.
    Upload,
    /// Written by copies, read by the host.
    ReadBack,
    /// Written by the host, read by shaders as a uniform.
    Uniform,
    /// Written by the host, read and written by shaders and copies. Host reads may be slow.
    Storage,
}

/// Bytes for shaders and copies. Clones share them.
#[derive(Clone, Debug)]
pub struct Buffer(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    name: String,
    bytes: u64,
    usage: vk::BufferUsageFlags,
    seen_by_host: bool,
    /// Number of unfinished submissions that use the buffer.
    users: Mutex<u32>,
    // Declared before its memory, which must outlive it.
    handle: Owned<vk::Buffer>,
    memory: Memory,
}

impl Buffer {
    /// Creates a host-visible buffer of `bytes`. Its content is undefined.
    ///
    /// # Errors
    ///
    /// [`VulkanError::TooLarge`] over the device's limit for that use, [`VulkanError::OutOfMemory`],
    /// [`VulkanError::Misuse`] for no bytes.
    pub fn host(device: &Device, name: &str, bytes: u64, host_use: HostUse) -> Result<Self, VulkanError> {
        let copied = vk::BufferUsageFlags::TRANSFER_SRC | vk::BufferUsageFlags::TRANSFER_DST;
        let (usage, location) = match host_use {
            // Cached host memory, because memory that is both host-visible and device-local is scarce.
            HostUse::Upload => (vk::BufferUsageFlags::TRANSFER_SRC, MemoryLocation::GpuToCpu),
            HostUse::ReadBack => (vk::BufferUsageFlags::TRANSFER_DST, MemoryLocation::GpuToCpu),
            HostUse::Uniform => (vk::BufferUsageFlags::UNIFORM_BUFFER, MemoryLocation::CpuToGpu),
            HostUse::Storage => (vk::BufferUsageFlags::STORAGE_BUFFER | copied, MemoryLocation::CpuToGpu),
        };
        Self::new(device, name, bytes, usage, location)
    }

    /// Creates a device-only storage buffer of `bytes`, filled by copies and shaders. Its content is undefined.
    ///
    /// # Errors
    ///
    /// As [`Self::host`].
    pub fn device(device: &Device, name: &str, bytes: u64) -> Result<Self, VulkanError> {
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER
            | vk::BufferUsageFlags::TRANSFER_SRC
            | vk::BufferUsageFlags::TRANSFER_DST;
        Self::new(device, name, bytes, usage, MemoryLocation::GpuOnly)
    }

    fn new(
        device: &Device,
        name: &str,
        bytes: u64,
        usage: vk::BufferUsageFlags,
        location: MemoryLocation,
    ) -> Result<Self, VulkanError> {
        let limits = device.limits();
        if bytes == 0 {
            return Err(VulkanError::misuse(name, "a buffer has at least one byte"));
        }
        check_limit(name, "its size in bytes", bytes, limits.max_allocation_bytes)?;
        if usage.contains(vk::BufferUsageFlags::STORAGE_BUFFER) {
            check_limit(name, "its size as a storage buffer in bytes", bytes, limits.max_storage_buffer_bytes)?;
        }
        if usage.contains(vk::BufferUsageFlags::UNIFORM_BUFFER) {
            check_limit(name, "its size as a uniform buffer in bytes", bytes, limits.max_uniform_buffer_bytes)?;
        }
        let raw = device.raw();
        let info = vk::BufferCreateInfo::default().size(bytes).usage(usage).sharing_mode(vk::SharingMode::EXCLUSIVE);
        // SAFETY: `info` is complete; its size is non-zero and within the limits checked above.
        let made = unsafe { raw.functions.create_buffer(&info, None) };
        let handle = Owned::new(raw, name, "vkCreateBuffer", made, ash::Device::destroy_buffer)?;
        // SAFETY: the buffer was just created on this device.
        let requirements = unsafe { raw.functions.get_buffer_memory_requirements(handle.raw()) };
        let memory =
            Memory::new(device, name, requirements, location, AllocationScheme::DedicatedBuffer(handle.raw()))?;
        let (block, offset) = memory.place();
        // SAFETY: the memory was allocated for this buffer's requirements and is bound to no other object. By the field
        // order of `Inner` it outlives the buffer.
        let bound = unsafe { raw.functions.bind_buffer_memory(handle.raw(), block, offset) };
        bound.map_err(VulkanError::call("vkBindBufferMemory", name))?;
        let seen_by_host = location != MemoryLocation::GpuOnly;
        let (name, users) = (name.to_owned(), Mutex::new(0));
        Ok(Self(Arc::new(Inner { name, bytes, usage, seen_by_host, users, handle, memory })))
    }

    /// Name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// Size in bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.0.bytes
    }

    /// Writes `data` from byte `offset` on. Later submissions see it.
    ///
    /// # Errors
    ///
    /// [`VulkanError::Misuse`] past the end or for a buffer that is not host-visible; [`VulkanError::InUse`] while an
    /// unfinished submission uses the buffer.
    pub fn write(&self, offset: u64, data: &[u8]) -> Result<(), VulkanError> {
        let _idle = self.idle()?;
        let place = self.host_place(offset, data.len())?;
        // SAFETY: `host_place` has checked that the `data.len()` bytes at `place` belong to this buffer's mapped
        // memory. `_idle` excludes submissions and other writers. `data` is host memory of another object.
        unsafe { std::ptr::copy_nonoverlapping(data.as_ptr(), place, data.len()) };
        Ok(())
    }

    /// Reads `data.len()` bytes from byte `offset` on.
    ///
    /// Device writes are visible after the submission has finished, if it ended with
    /// [`super::Recorder::transfer_to_host`] or [`super::Recorder::compute_to_host`].
    ///
    /// # Errors
    ///
    /// As [`Self::write`].
    pub fn read(&self, offset: u64, data: &mut [u8]) -> Result<(), VulkanError> {
        let _idle = self.idle()?;
        let place = self.host_place(offset, data.len())?;
        // SAFETY: as in `write`; `data` is borrowed exclusively. A buffer that was never written holds arbitrary bytes;
        // mapped memory, unlike Rust's own, is always initialised.
        unsafe { std::ptr::copy_nonoverlapping(place, data.as_mut_ptr(), data.len()) };
        Ok(())
    }

    /// Locks the buffer against new submissions, or returns an error if one is in progress.
    fn idle(&self) -> Result<impl Drop + '_, VulkanError> {
        let users = lock(&self.0.users);
        if *users > 0 {
            return Err(VulkanError::InUse { object: self.0.name.clone() });
        }
        Ok(users)
    }

    /// Host address of `bytes` bytes from `offset` on.
    fn host_place(&self, offset: u64, bytes: usize) -> Result<*mut u8, VulkanError> {
        self.check_range(offset, bytes as u64)?;
        let start = self.0.memory.host().filter(|_| self.0.seen_by_host);
        let start = start.ok_or_else(|| VulkanError::misuse(&self.0.name, "this buffer is not visible to the host"))?;
        let offset = usize::try_from(offset)
            .map_err(|_| VulkanError::misuse(&self.0.name, "its offset exceeds the address space"))?;
        Ok(start.wrapping_add(offset))
    }

    /// Returns an error if the range exceeds the buffer.
    pub(super) fn check_range(&self, offset: u64, bytes: u64) -> Result<(), VulkanError> {
        if offset.checked_add(bytes).is_none_or(|end| end > self.0.bytes) {
            let mistake = format!("{bytes} bytes at offset {offset} exceed its {} bytes", self.0.bytes);
            return Err(VulkanError::misuse(&self.0.name, mistake));
        }
        Ok(())
    }

    /// Returns an error unless the buffer is on `device` and was made for `usage`.
    pub(super) fn check_use(
        &self,
        device: &Device,
        usage: vk::BufferUsageFlags,
        what: &str,
    ) -> Result<(), VulkanError> {
        if !self.0.handle.is_on(device.raw()) {
            return Err(VulkanError::misuse(&self.0.name, "it belongs to another device"));
        }
        if !self.0.usage.contains(usage) {
            return Err(VulkanError::misuse(&self.0.name, format!("it was not created for use as {what}")));
        }
        Ok(())
    }

    pub(crate) fn raw(&self) -> vk::Buffer {
        self.0.handle.raw()
    }

    /// Counts one more submission that uses the buffer.
    pub(super) fn begin_use(&self) {
        *lock(&self.0.users) += 1;
    }

    /// Counts one submission less.
    pub(super) fn end_use(&self) {
        *lock(&self.0.users) -= 1;
    }
}
