//! Images.

use std::sync::Arc;

use ash::vk;
use gpu_allocator::{MemoryLocation, vulkan::AllocationScheme};

use super::{
    Device, Format, VulkanError,
    error::check_limit,
    format::{SAMPLED_USAGE, STORAGE_USAGE},
    handle::Owned,
    memory::Memory,
};

/// Layout of a 3D image between recorded commands.
pub(super) const SAMPLED_LAYOUT: vk::ImageLayout = vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL;

/// Permanent layout of a storage image.
pub(crate) const STORAGE_LAYOUT: vk::ImageLayout = vk::ImageLayout::GENERAL;

/// A 3D image that uploads or shaders fill, and shaders read through a [`super::Sampler`]. Clones share it.
#[derive(Clone, Debug)]
pub struct Image3d(Arc<Inner>);

/// Layers of 2D images that shaders read and write per texel. Clones share them.
///
/// Shaders always see it as an array, `texture_storage_2d_array`, even with one layer.
#[derive(Clone, Debug)]
pub struct StorageImage(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    name: String,
    format: Format,
    /// Width, height and depth in texels.
    extent: [u32; 3],
    layers: u32,
    layout: vk::ImageLayout,
    // Drop order: each before the object that it was made from.
    view: Owned<vk::ImageView>,
    handle: Owned<vk::Image>,
    _memory: Memory,
}

impl Image3d {
    /// Creates an image of `extent` texels (width, height, depth). Its content is undefined until it is uploaded.
    ///
    /// # Errors
    ///
    /// [`VulkanError::NoFormat`] if shaders cannot read `format`, [`VulkanError::TooLarge`] over the device's extent or
    /// allocation limit, [`VulkanError::OutOfMemory`], [`VulkanError::Misuse`] for an empty extent.
    pub fn new(device: &Device, name: &str, format: Format, extent: [u32; 3]) -> Result<Self, VulkanError> {
        Self::of(device, name, format, extent, SAMPLED_USAGE, SAMPLED_LAYOUT)
    }

    /// Bytes that [`Self::new`] allocates for such an image: those of its texels, and those that the device adds between them.
    ///
    /// # Errors
    ///
    /// As [`Self::new`], but for [`VulkanError::TooLarge`] over the allocation limit and [`VulkanError::OutOfMemory`].
    pub fn allocated_bytes(device: &Device, format: Format, extent: [u32; 3]) -> Result<u64, VulkanError> {
        Self::check(device, "image", format, extent)?;
        Ok(unbound(device, "image", format, vk::ImageType::TYPE_3D, extent, 1, SAMPLED_USAGE)?.1.size)
    }

    /// [`Self::new`] for an image that shaders write, too. Its content is undefined until written.
    ///
    /// # Errors
    ///
    /// Those of [`Self::new`], and [`VulkanError::NoFormat`] if shaders cannot write `format`.
    pub fn written(device: &Device, name: &str, format: Format, extent: [u32; 3]) -> Result<Self, VulkanError> {
        if !device.limits().storage_image(format) {
            return Err(VulkanError::NoFormat { object: name.to_owned(), format, purpose: "a storage image" });
        }
        Self::of(device, name, format, extent, SAMPLED_USAGE | STORAGE_USAGE, STORAGE_LAYOUT)
    }

    fn of(
        device: &Device,
        name: &str,
        format: Format,
        extent: [u32; 3],
        usage: vk::ImageUsageFlags,
        layout: vk::ImageLayout,
    ) -> Result<Self, VulkanError> {
        Self::check(device, name, format, extent)?;
        let kind = (vk::ImageType::TYPE_3D, vk::ImageViewType::TYPE_3D);
        Inner::new(device, name, format, kind, extent, 1, usage, layout).map(|inner| Self(Arc::new(inner)))
    }

    /// Refuses a format or an extent that the device has no 3D images of.
    fn check(device: &Device, name: &str, format: Format, extent: [u32; 3]) -> Result<(), VulkanError> {
        let limits = device.limits();
        if !limits.sampled(format) {
            return Err(VulkanError::NoFormat { object: name.to_owned(), format, purpose: "a texture" });
        }
        let quantities = ["its width in voxels", "its height in voxels", "its depth in voxels"];
        for (quantity, (asked, limit)) in
            quantities.into_iter().zip(extent.into_iter().zip(limits.max_extent_3d(format)))
        {
            check_limit(name, quantity, asked.into(), limit.into())?;
        }
        Ok(())
    }

    /// Layout between recorded commands.
    pub(super) fn layout(&self) -> vk::ImageLayout {
        self.0.layout
    }

    /// Name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// Format.
    #[must_use]
    pub fn format(&self) -> Format {
        self.0.format
    }

    /// Width, height and depth in texels.
    #[must_use]
    pub fn extent(&self) -> [u32; 3] {
        self.0.extent
    }

    pub(super) fn check_device(&self, device: &Device) -> Result<(), VulkanError> {
        self.0.check_device(device)
    }

    pub(super) fn raw(&self) -> vk::Image {
        self.0.handle.raw()
    }

    pub(super) fn view(&self) -> vk::ImageView {
        self.0.view.raw()
    }
}

impl StorageImage {
    /// Creates `layers` layers of `extent` texels (width, height). Their content is undefined until written or cleared.
    ///
    /// # Errors
    ///
    /// [`VulkanError::NoFormat`] if shaders cannot write `format`, [`VulkanError::TooLarge`] over the device's extent,
    /// layer or allocation limit, [`VulkanError::OutOfMemory`], [`VulkanError::Misuse`] for an empty extent.
    pub fn new(
        device: &Device,
        name: &str,
        format: Format,
        extent: [u32; 2],
        layers: u32,
    ) -> Result<Self, VulkanError> {
        let limits = device.limits();
        if !limits.storage_image(format) {
            return Err(VulkanError::NoFormat { object: name.to_owned(), format, purpose: "a storage image" });
        }
        let [width, height] = extent;
        let [max_width, max_height] = limits.max_extent_2d(format);
        check_limit(name, "its width in pixels", width.into(), max_width.into())?;
        check_limit(name, "its height in pixels", height.into(), max_height.into())?;
        check_limit(name, "its number of layers", layers.into(), limits.max_layers(format).into())?;
        let kind = (vk::ImageType::TYPE_2D, vk::ImageViewType::TYPE_2D_ARRAY);
        Inner::new(device, name, format, kind, [width, height, 1], layers, STORAGE_USAGE, STORAGE_LAYOUT)
            .map(|inner| Self(Arc::new(inner)))
    }

    /// Name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// Format.
    #[must_use]
    pub fn format(&self) -> Format {
        self.0.format
    }

    /// Width and height in texels.
    #[must_use]
    pub fn extent(&self) -> [u32; 2] {
        let [width, height, _] = self.0.extent;
        [width, height]
    }

    /// Number of layers.
    #[must_use]
    pub fn layers(&self) -> u32 {
        self.0.layers
    }

    /// Bytes of one layer: rows from the top, tightly packed.
    #[must_use]
    pub fn layer_bytes(&self) -> u64 {
        let [width, height] = self.extent();
        u64::from(width) * u64::from(height) * u64::from(self.format().texel_bytes())
    }

    /// Bytes of all layers.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.layer_bytes() * u64::from(self.layers())
    }

    pub(crate) fn check_device(&self, device: &Device) -> Result<(), VulkanError> {
        self.0.check_device(device)
    }

    pub(crate) fn raw(&self) -> vk::Image {
        self.0.handle.raw()
    }

    pub(super) fn view(&self) -> vk::ImageView {
        self.0.view.raw()
    }
}

/// An image that no memory is bound to, and the memory that it needs. Its extent is within the device's limits.
fn unbound(
    device: &Device,
    name: &str,
    format: Format,
    kind: vk::ImageType,
    [width, height, depth]: [u32; 3],
    layers: u32,
    usage: vk::ImageUsageFlags,
) -> Result<(Owned<vk::Image>, vk::MemoryRequirements), VulkanError> {
    if [width, height, depth, layers].contains(&0) {
        let mistake = format!("{width}×{height}×{depth} texels in {layers} layers: each must be at least 1");
        return Err(VulkanError::misuse(name, mistake));
    }
    let texels = u64::from(width) * u64::from(height) * u64::from(depth);
    let bytes = texels.saturating_mul(u64::from(layers) * u64::from(format.texel_bytes()));
    check_limit(name, "its size in bytes", bytes, device.limits().max_allocation_bytes)?;

    let raw = device.raw();
    let info = vk::ImageCreateInfo::default()
        .flags(format.flags())
        .image_type(kind)
        .format(format.raw())
        .extent(vk::Extent3D { width, height, depth })
        .mip_levels(1)
        .array_layers(layers)
        .samples(vk::SampleCountFlags::TYPE_1)
        .tiling(vk::ImageTiling::OPTIMAL)
        .usage(usage)
        .sharing_mode(vk::SharingMode::EXCLUSIVE)
        .initial_layout(vk::ImageLayout::UNDEFINED);
    // SAFETY: the extent and the layer count are non-zero and within the device's limits for this format, kind and usage.
    let made = unsafe { raw.functions.create_image(&info, None) };
    let handle = Owned::new(raw, name, "vkCreateImage", made, ash::Device::destroy_image)?;
    // SAFETY: the image was just created on this device.
    let mut requirements = unsafe { raw.functions.get_image_memory_requirements(handle.raw()) };
    requirements.size = device.simulated().padded(requirements.size);
    Ok((handle, requirements))
}

impl Inner {
    #[expect(clippy::too_many_arguments, reason = "the two kinds of image differ in all of them")]
    fn new(
        device: &Device,
        name: &str,
        format: Format,
        kind: (vk::ImageType, vk::ImageViewType),
        extent: [u32; 3],
        layers: u32,
        usage: vk::ImageUsageFlags,
        layout: vk::ImageLayout,
    ) -> Result<Self, VulkanError> {
        let (image_kind, view_kind) = kind;
        let raw = device.raw();
        let (handle, requirements) = unbound(device, name, format, image_kind, extent, layers, usage)?;
        let memory = Memory::new(
            device,
            name,
            requirements,
            MemoryLocation::GpuOnly,
            AllocationScheme::DedicatedImage(handle.raw()),
        )?;
        let (block, offset) = memory.place();
        // SAFETY: the memory was allocated for this image's requirements and is bound to no other object. By the field
        // order of `Inner` it outlives the image.
        let bound = unsafe { raw.functions.bind_image_memory(handle.raw(), block, offset) };
        bound.map_err(VulkanError::call("vkBindImageMemory", name))?;
        let info = vk::ImageViewCreateInfo::default()
            .image(handle.raw())
            .view_type(view_kind)
            .format(format.viewed())
            .subresource_range(all_layers());
        // SAFETY: the image is bound to memory. The view has the image's format or a compatible one, and a type that
        // suits the image. By the field order of `Inner` the image outlives the view.
        let made = unsafe { raw.functions.create_image_view(&info, None) };
        let view = Owned::new(raw, name, "vkCreateImageView", made, ash::Device::destroy_image_view)?;
        let made = Self { name: name.to_owned(), format, extent, layers, layout, view, handle, _memory: memory };
        device.run(name, |recorder| {
            recorder.set_first_layout(made.handle.raw(), layout);
            Ok(())
        })?;
        Ok(made)
    }

    fn check_device(&self, device: &Device) -> Result<(), VulkanError> {
        if !self.handle.is_on(device.raw()) {
            return Err(VulkanError::misuse(&self.name, "it belongs to another device"));
        }
        Ok(())
    }
}

/// Subresource range of a whole image.
pub(crate) fn all_layers() -> vk::ImageSubresourceRange {
    vk::ImageSubresourceRange::default()
        .aspect_mask(vk::ImageAspectFlags::COLOR)
        .level_count(1)
        .layer_count(vk::REMAINING_ARRAY_LAYERS)
}
