//! An open device.

use std::{
    ffi::CStr,
    fmt,
    sync::{
        Arc, Mutex,
        atomic::{AtomicU64, Ordering},
    },
};

use ash::{ext, khr, vk};
use gpu_allocator::{
    AllocationSizes, AllocatorDebugSettings,
    vulkan::{Allocator, AllocatorCreateDesc},
};

use super::{
    DeviceChoice, DeviceInfo, DeviceKind, Limits, Validation, VulkanError,
    commands::CommandSlot,
    handle::RawDevice,
    info::{Candidate, Purpose, QueueFamily},
    instance::Instance,
    lock,
    simulate::Simulated,
};

/// Bytes of a memory block in device memory. Larger objects have blocks of their own, which are allocated and freed with them, and of
/// several blocks those that are empty are freed. The images of most films have room beside the volume, and so a march gets the memory
/// of the march before: a GPU took 1 to 2 ms to allocate a film of 41 MB, and 0.3 to march it. Software devices get pages from the system on the first write, and clearing them takes up to a fifth of
/// a march.
const DEVICE_BLOCK: u64 = 256 << 20;
/// Bytes of a memory block in the host memory of a GPU.
const HOST_BLOCK: u64 = 8 << 20;

/// A device that another program part has opened, with one of its queues: what [`Device::from_lent`] takes.
#[derive(Clone)]
pub struct LentDevice {
    /// The loader.
    pub entry: ash::Entry,
    /// The instance.
    pub instance: ash::Instance,
    /// The physical device.
    pub physical: vk::PhysicalDevice,
    /// The logical device.
    pub device: ash::Device,
    /// A queue of it that computes.
    pub queue: vk::Queue,
    /// The family of the queue.
    pub queue_family: u32,
}

impl fmt::Debug for LentDevice {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { physical, queue, queue_family, .. } = self;
        let mut out = formatter.debug_struct("LentDevice");
        out.field("device", &self.device.handle()).field("physical", physical);
        out.field("queue", queue).field("queue_family", queue_family).finish_non_exhaustive()
    }
}

/// An open device. Clones share it, and everything made from it keeps it open.
#[derive(Clone)]
pub struct Device(Arc<Shared>);

/// The device and the state that its objects share, in the order of destruction.
struct Shared {
    info: DeviceInfo,
    limits: Limits,
    simulated: Simulated,
    dispatches: AtomicU64,
    queue_family: u32,
    queue: Mutex<vk::Queue>,
    /// Command buffers that are not in use.
    idle: Mutex<Vec<Arc<CommandSlot>>>,
    allocator: Arc<Mutex<Allocator>>,
    #[cfg_attr(not(feature = "window"), expect(dead_code, reason = "asked about surfaces only"))]
    physical: vk::PhysicalDevice,
    raw: Arc<RawDevice>,
}

impl Device {
    /// Opens the device that `choice` selects. For tests, the environment variable `RELUME_SIMULATE` changes it: `device-lost=N`
    /// or `out-of-memory=N` makes the Nth submission or allocation fail, and with `image-padding=N` images take N per cent more
    /// memory.
    ///
    /// # Errors
    ///
    /// [`VulkanError::NoLoader`], [`VulkanError::NoDriver`], [`VulkanError::NoDevice`] on a machine without Vulkan;
    /// [`VulkanError::NoMatch`], [`VulkanError::Unsuitable`] for a device that is not there or cannot be used;
    /// [`VulkanError::NoValidation`] when the layer is asked for and not installed.
    pub fn open(choice: &DeviceChoice, validation: Validation) -> Result<Self, VulkanError> {
        Self::open_with(choice, validation, Purpose::Compute, &[])
    }

    /// Opens a device as [`Self::open`] does, to present to windows; `extensions` are those that the display needs of the
    /// instance.
    ///
    /// # Errors
    ///
    /// As [`Self::open`], and [`VulkanError::NoWindow`].
    #[cfg(feature = "window")]
    pub(crate) fn open_for_window(
        choice: &DeviceChoice,
        validation: Validation,
        extensions: &[&'static CStr],
    ) -> Result<Self, VulkanError> {
        Self::open_with(choice, validation, Purpose::Window, extensions)
    }

    fn open_with(
        choice: &DeviceChoice,
        validation: Validation,
        purpose: Purpose,
        extensions: &[&'static CStr],
    ) -> Result<Self, VulkanError> {
        let instance = Instance::open(validation, extensions)?;
        let candidate = Candidate::choose(Candidate::all(&instance, purpose)?, choice)?;
        let (Some(queue), true) = (candidate.queue, candidate.info.missing.is_empty()) else {
            let Candidate { info, .. } = candidate;
            return Err(VulkanError::Unsuitable { device: info.name, missing: info.missing });
        };
        let raw = open_raw(&instance, &candidate, queue, purpose)?;
        // SAFETY: the device was created with one queue of this family.
        let raw_queue = unsafe { raw.functions.get_device_queue(queue.index, 0) };
        raw.set_name(raw_queue, "queue");
        Self::of_parts(candidate, raw, (queue, raw_queue))
    }

    /// A device that the caller has opened for purposes of its own, and lends: pictures then lie on it, without copies between
    /// devices. All that is made of the returned device is made on the caller's, through its own memory blocks, command
    /// buffers and fences; none of the caller's objects are touched.
    ///
    /// # Safety
    ///
    /// - The handles are valid and belong together, and `queue` is one of `queue_family` of `device`, and not a protected one.
    /// - The instance has Vulkan 1.2 or newer. The device was created with the features `robustBufferAccess` and
    ///   `synchronization2`, which is the extension `VK_KHR_synchronization2` if the instance or the device is below Vulkan 1.3: no
    ///   function tells this.
    /// - Instance, device and loader outlive the returned device and all that is made of it: buffers, pipelines, renderers,
    ///   films, relights. Dropping these destroys neither.
    /// - Nobody else uses `queue`, or calls `vkDeviceWaitIdle`, which uses all queues, while a function of this library may: a
    ///   queue takes one thread at a time. Dropping objects waits for the queue, too. A queue of its own is the simplest.
    /// - At most one device made of a queue lives at a time. Its clones share it.
    ///
    /// The device cannot present to windows. Its memory is taken to be free for this library: `Renderer::with_memory` bounds what
    /// volumes take. [`DeviceInfo::index`] is 0.
    ///
    /// # Errors
    ///
    /// [`VulkanError::Unsuitable`] for a device that cannot be used, [`VulkanError::Call`] if it cannot be asked.
    pub unsafe fn from_lent(lent: LentDevice) -> Result<Self, VulkanError> {
        let LentDevice { entry, instance, physical, device, queue, queue_family } = lent;
        let instance = Instance::lent(entry, instance);
        let mut candidate = Candidate::new(&instance, physical, 0, Purpose::Compute)?;
        let family = candidate.compute_family(&instance, queue_family);
        if family.is_none() {
            candidate.info.missing.push(format!("its queue family {queue_family} does not compute"));
        }
        let barrier = [c"vkCmdPipelineBarrier2", c"vkCmdPipelineBarrier2KHR"].into_iter().find_map(|name| {
            // SAFETY: device and instance belong together, as the caller promises; the name ends with 0.
            unsafe { instance.raw.get_device_proc_addr(device.handle(), name.as_ptr()) }
        });
        let (Some(family), Some(barrier), true) = (family, barrier, candidate.info.missing.is_empty()) else {
            let DeviceInfo { name, mut missing, .. } = candidate.info;
            if barrier.is_none() && missing.is_empty() {
                missing.push("it was created without synchronization2".to_owned());
            }
            return Err(VulkanError::Unsuitable { device: name, missing });
        };
        // SAFETY: the function of this name has this type.
        let pipeline_barrier2 =
            unsafe { std::mem::transmute::<unsafe extern "system" fn(), vk::PFN_vkCmdPipelineBarrier2>(barrier) };
        let raw = RawDevice { functions: device, pipeline_barrier2, names: None, instance, is_lent: true };
        Self::of_parts(candidate, Arc::new(raw), (family, queue))
    }

    fn of_parts(
        candidate: Candidate,
        raw: Arc<RawDevice>,
        (family, queue): (QueueFamily, vk::Queue),
    ) -> Result<Self, VulkanError> {
        let instance = &raw.instance;
        let limits = Limits::of_device(instance, candidate.raw, family.timestamp_valid_bits)?;
        let of_host = if candidate.info.kind == DeviceKind::Software { DEVICE_BLOCK } else { HOST_BLOCK };
        let blocks = AllocationSizes::new(DEVICE_BLOCK, of_host);
        let allocator = Allocator::new(&AllocatorCreateDesc {
            instance: instance.raw.clone(),
            device: raw.functions.clone(),
            physical_device: candidate.raw,
            debug_settings: AllocatorDebugSettings::default(),
            buffer_device_address: false,
            allocation_sizes: blocks,
        })
        .map_err(|source| VulkanError::Allocator { object: candidate.info.name.clone(), source })?;
        Ok(Self(Arc::new(Shared {
            info: candidate.info,
            limits,
            simulated: Simulated::asked_for(),
            dispatches: AtomicU64::default(),
            queue_family: family.index,
            queue: Mutex::new(queue),
            idle: Mutex::new(Vec::new()),
            allocator: Arc::new(Mutex::new(allocator)),
            physical: candidate.raw,
            raw,
        })))
    }

    /// Properties of the device.
    #[must_use]
    pub fn info(&self) -> &DeviceInfo {
        &self.0.info
    }

    /// Limits of the device.
    #[must_use]
    pub fn limits(&self) -> &Limits {
        &self.0.limits
    }

    /// Number of dispatches recorded for the device so far.
    #[must_use]
    pub fn dispatches(&self) -> u64 {
        self.0.dispatches.load(Ordering::Relaxed)
    }

    /// Returns the validation messages since the last call; none without [`Validation::On`].
    #[must_use]
    pub fn validation_messages(&self) -> Vec<String> {
        self.0.raw.instance.take_messages()
    }

    /// Waits until the queue has finished all submitted work. Errors are ignored: a lost device is idle, too.
    #[expect(clippy::disallowed_methods, reason = "this is the one place, and it holds the queue")]
    pub(crate) fn wait_idle(&self) {
        let queue = lock(&self.0.queue);
        // SAFETY: the lock keeps other threads off the queue, the only one in use.
        unsafe { self.0.raw.functions.queue_wait_idle(*queue) }.ok();
    }

    pub(super) fn count_dispatch(&self) {
        self.0.dispatches.fetch_add(1, Ordering::Relaxed);
    }

    pub(crate) fn simulated(&self) -> &Simulated {
        &self.0.simulated
    }

    pub(crate) fn raw(&self) -> &Arc<RawDevice> {
        &self.0.raw
    }

    pub(crate) fn queue_family(&self) -> u32 {
        self.0.queue_family
    }

    pub(crate) fn queue(&self) -> &Mutex<vk::Queue> {
        &self.0.queue
    }

    pub(super) fn idle(&self) -> &Mutex<Vec<Arc<CommandSlot>>> {
        &self.0.idle
    }

    pub(crate) fn allocator(&self) -> &Arc<Mutex<Allocator>> {
        &self.0.allocator
    }

    #[cfg(feature = "window")]
    pub(crate) fn physical(&self) -> vk::PhysicalDevice {
        self.0.physical
    }
}

impl fmt::Debug for Device {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("Device").field("info", &self.0.info).finish_non_exhaustive()
    }
}

/// Creates the logical device with one queue and the required features.
fn open_raw(
    instance: &Arc<Instance>,
    candidate: &Candidate,
    queue: QueueFamily,
    purpose: Purpose,
) -> Result<Arc<RawDevice>, VulkanError> {
    let priorities = [1.0];
    let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(queue.index).queue_priorities(&priorities)];
    let mut extensions =
        if candidate.needs_extension { vec![khr::synchronization2::NAME.as_ptr()] } else { Vec::new() };
    // Supported by every device: shader accesses past the end of a buffer stay within the buffer.
    let features = vk::PhysicalDeviceFeatures::default().robust_buffer_access(true);
    let mut synchronization2 = vk::PhysicalDeviceSynchronization2Features::default().synchronization2(true);
    let mut rendering = vk::PhysicalDeviceDynamicRenderingFeatures::default().dynamic_rendering(true);
    if purpose != Purpose::Compute {
        extensions.push(khr::swapchain::NAME.as_ptr());
    }
    let mut info = vk::DeviceCreateInfo::default()
        .queue_create_infos(&queues)
        .enabled_extension_names(&extensions)
        .enabled_features(&features)
        .push_next(&mut synchronization2);
    if purpose != Purpose::Compute {
        info = info.push_next(&mut rendering);
    }
    // SAFETY: `info` borrows arrays that outlive the call, and requests only features that the candidate has.
    let made = unsafe { instance.raw.create_device(candidate.raw, &info, None) };
    let functions = made.map_err(VulkanError::call("vkCreateDevice", &candidate.info.name))?;
    let pipeline_barrier2 = if candidate.needs_extension {
        khr::synchronization2::Device::new(&instance.raw, &functions).fp().cmd_pipeline_barrier2_khr
    } else {
        functions.fp_v1_3().cmd_pipeline_barrier2
    };
    let names = instance.has_debug_utils.then(|| ext::debug_utils::Device::new(&instance.raw, &functions));
    let raw = RawDevice { functions, pipeline_barrier2, names, instance: Arc::clone(instance), is_lent: false };
    raw.set_name(raw.functions.handle(), "device");
    Ok(Arc::new(raw))
}
