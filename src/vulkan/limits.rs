//! Limits of a device.

use ash::vk;

use super::{
    Format, VulkanError,
    format::{SAMPLED_USAGE, STORAGE_USAGE},
    instance::Instance,
};

/// Limits of a device, queried once when it is opened.
#[derive(Clone, Debug)]
pub struct Limits {
    /// Bytes of the largest device-local heap.
    pub device_heap_bytes: u64,
    /// Largest single allocation in bytes.
    pub max_allocation_bytes: u64,
    /// Largest storage buffer binding in bytes.
    pub max_storage_buffer_bytes: u64,
    /// Largest uniform buffer binding in bytes.
    pub max_uniform_buffer_bytes: u64,
    /// Largest total size of push constants in bytes.
    pub max_push_constant_bytes: u32,
    /// Largest number of workgroups per dispatch, per axis.
    pub max_groups: [u32; 3],
    /// Largest number of invocations per workgroup.
    pub max_group_invocations: u32,
    /// Bits of sub-texel precision in linear filtering.
    pub sub_texel_precision_bits: u32,
    /// Nanoseconds per timestamp tick.
    pub timestamp_period_ns: f32,
    /// Valid bits of a timestamp; 0 if the queue has no timestamps.
    pub timestamp_valid_bits: u32,
    /// Invocations per subgroup.
    pub subgroup_size: u32,
    /// Limits per format, in the order of [`Format::ALL`].
    formats: [FormatLimits; Format::ALL.len()],
}

/// Capabilities of one format.
#[derive(Clone, Copy, Debug, Default)]
struct FormatLimits {
    sampled: bool,
    linear_filter: bool,
    storage: bool,
    extent_3d: [u32; 3],
    extent_2d: [u32; 2],
    layers: u32,
}

impl Limits {
    /// Whether shaders can sample a 3D image of `format`.
    #[must_use]
    pub fn sampled(&self, format: Format) -> bool {
        self.of(format).sampled
    }

    /// Whether a sampler can interpolate linearly between texels of `format`.
    #[must_use]
    pub fn linear_filter(&self, format: Format) -> bool {
        self.of(format).linear_filter
    }

    /// Whether shaders can write a 2D image of `format`.
    #[must_use]
    pub fn storage_image(&self, format: Format) -> bool {
        self.of(format).storage
    }

    /// Largest extent of a 3D image of `format` in texels; zero if unsupported.
    #[must_use]
    pub fn max_extent_3d(&self, format: Format) -> [u32; 3] {
        self.of(format).extent_3d
    }

    /// Largest extent of a storage image of `format` in texels; zero if unsupported.
    #[must_use]
    pub fn max_extent_2d(&self, format: Format) -> [u32; 2] {
        self.of(format).extent_2d
    }

    /// Largest number of layers of a storage image of `format`.
    #[must_use]
    pub fn max_layers(&self, format: Format) -> u32 {
        self.of(format).layers
    }

    fn of(&self, format: Format) -> FormatLimits {
        self.formats[format as usize]
    }

    /// Queries `device`, which supports Vulkan 1.2 and whose queue has `timestamp_valid_bits`.
    pub(super) fn of_device(
        instance: &Instance,
        device: vk::PhysicalDevice,
        timestamp_valid_bits: u32,
    ) -> Result<Self, VulkanError> {
        let mut subgroup = vk::PhysicalDeviceSubgroupProperties::default();
        let mut maintenance = vk::PhysicalDeviceMaintenance3Properties::default();
        let mut properties =
            vk::PhysicalDeviceProperties2::default().push_next(&mut subgroup).push_next(&mut maintenance);
        // SAFETY: the chained structures are part of Vulkan 1.1, so a 1.2 device fills them, and they outlive the call.
        unsafe { instance.raw.get_physical_device_properties2(device, &mut properties) };
        let limits = properties.properties.limits;
        // SAFETY: `device` comes from this instance; the result is a plain value.
        let memory = unsafe { instance.raw.get_physical_device_memory_properties(device) };
        let device_heap_bytes = memory
            .memory_heaps_as_slice()
            .iter()
            .filter(|heap| heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL))
            .map(|heap| heap.size)
            .max()
            .unwrap_or(0);
        let mut formats = [FormatLimits::default(); Format::ALL.len()];
        for (entry, format) in formats.iter_mut().zip(Format::ALL) {
            *entry = FormatLimits::of_device(instance, device, &limits, format)?;
        }
        Ok(Self {
            device_heap_bytes,
            max_allocation_bytes: maintenance.max_memory_allocation_size,
            max_storage_buffer_bytes: limits.max_storage_buffer_range.into(),
            max_uniform_buffer_bytes: limits.max_uniform_buffer_range.into(),
            max_push_constant_bytes: limits.max_push_constants_size,
            max_groups: limits.max_compute_work_group_count,
            max_group_invocations: limits.max_compute_work_group_invocations,
            sub_texel_precision_bits: limits.sub_texel_precision_bits,
            timestamp_period_ns: limits.timestamp_period,
            timestamp_valid_bits,
            subgroup_size: subgroup.subgroup_size,
            formats,
        })
    }
}

impl FormatLimits {
    fn of_device(
        instance: &Instance,
        device: vk::PhysicalDevice,
        limits: &vk::PhysicalDeviceLimits,
        format: Format,
    ) -> Result<Self, VulkanError> {
        let features = |format| {
            // SAFETY: `device` comes from this instance; the result is a plain value.
            unsafe { instance.raw.get_physical_device_format_properties(device, format) }.optimal_tiling_features
        };
        let has = |feature| features(format.raw()).contains(feature);
        let image = |kind, usage| {
            // SAFETY: as above. Kind, tiling and usage are those of the images in this crate.
            let found = unsafe {
                instance.raw.get_physical_device_image_format_properties(
                    device,
                    format.raw(),
                    kind,
                    vk::ImageTiling::OPTIMAL,
                    usage,
                    format.flags(),
                )
            };
            match found {
                Ok(properties) => Ok(properties),
                Err(vk::Result::ERROR_FORMAT_NOT_SUPPORTED) => Ok(vk::ImageFormatProperties::default()),
                Err(source) => Err(VulkanError::call("vkGetPhysicalDeviceImageFormatProperties", "device")(source)),
            }
        };
        let volume = image(vk::ImageType::TYPE_3D, SAMPLED_USAGE)?;
        let layered = image(vk::ImageType::TYPE_2D, STORAGE_USAGE)?;
        // Some drivers report more here than their own general limit.
        let within_3d = |texels: u32| texels.min(limits.max_image_dimension3_d);
        let within_2d = |texels: u32| texels.min(limits.max_image_dimension2_d);
        let extent = volume.max_extent;
        Ok(Self {
            sampled: has(vk::FormatFeatureFlags::SAMPLED_IMAGE | vk::FormatFeatureFlags::TRANSFER_DST),
            linear_filter: has(vk::FormatFeatureFlags::SAMPLED_IMAGE_FILTER_LINEAR),
            storage: features(format.viewed()).contains(vk::FormatFeatureFlags::STORAGE_IMAGE),
            extent_3d: [within_3d(extent.width), within_3d(extent.height), within_3d(extent.depth)],
            extent_2d: [within_2d(layered.max_extent.width), within_2d(layered.max_extent.height)],
            layers: layered.max_array_layers.min(limits.max_image_array_layers),
        })
    }
}
