//! Images.

use std::sync::Arc;

use ash::vk;
use gpu_allocator::MemoryLocation;

use super::{Device, Format, VulkanError, error::check_limit, handle::Owned, memory::Memory};

/// What a 3D image is for.
pub(super) const SAMPLED_USAGE: vk::ImageUsageFlags =
    vk::ImageUsageFlags::from_raw(vk::ImageUsageFlags::SAMPLED.as_raw() | vk::ImageUsageFlags::TRANSFER_DST.as_raw());

/// What a storage image is for.
pub(super) const STORAGE_USAGE: vk::ImageUsageFlags = vk::ImageUsageFlags::from_raw(
    vk::ImageUsageFlags::STORAGE.as_raw()
        | vk::ImageUsageFlags::TRANSFER_SRC.as_raw()
        | vk::ImageUsageFlags::TRANSFER_DST.as_raw(),
);

/// Where a 3D image is between any two commands recorded here.
pub(super) const SAMPLED_LAYOUT: vk::ImageLayout = vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL;

/// Where a storage image always is.
pub(super) const STORAGE_LAYOUT: vk::ImageLayout = vk::ImageLayout::GENERAL;

/// A 3D image that shaders read through a [`super::Sampler`] and uploads fill. Clones are the same image.
#[derive(Clone, Debug)]
pub struct Image3d(Arc<Inner>);

/// Layers of 2D images that shaders read and write texel by texel. Clones are the same image.
///
/// A shader sees it as an array however many layers there are: `texture_storage_2d_array`.
#[derive(Clone, Debug)]
pub struct StorageImage(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    name: String,
    format: Format,
    /// Width, height, depth in texels.
    extent: [u32; 3],
    layers: u32,
    // Each before what it was made from.
    view: Owned<vk::ImageView>,
    handle: Owned<vk::Image>,
    _memory: Memory,
}

impl Image3d {
    /// An image of `extent` texels (width, height, depth). Its content is undefined until it is uploaded.
    ///
    /// # Errors
    ///
    /// [`VulkanError::NoFormat`] where shaders cannot read `format`, [`VulkanError::TooLarge`] over the device's
    /// extent or allocation limit, [`VulkanError::OutOfMemory`], [`VulkanError::Misuse`] for an empty extent.
    pub fn new(device: &Device, name: &str, format: Format, extent: [u32; 3]) -> Result<Self, VulkanError> {
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
        let kind = (vk::ImageType::TYPE_3D, vk::ImageViewType::TYPE_3D);
        Inner::new(device, name, format, kind, extent, 1, SAMPLED_USAGE, SAMPLED_LAYOUT)
            .map(|inner| Self(Arc::new(inner)))
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// Its format.
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
    /// `layers` layers of `extent` texels (width, height). Their content is undefined until written or cleared.
    ///
    /// # Errors
    ///
    /// [`VulkanError::NoFormat`] where shaders cannot write `format`, [`VulkanError::TooLarge`] over the device's
    /// extent, layer or allocation limit, [`VulkanError::OutOfMemory`], [`VulkanError::Misuse`] for an empty extent.
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

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// Its format.
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

    /// How many layers it has.
    #[must_use]
    pub fn layers(&self) -> u32 {
        self.0.layers
    }

    /// Bytes of one layer, rows from the top, without gaps.
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
        let [width, height, depth] = extent;
        if extent.contains(&0) || layers == 0 {
            let mistake =
                format!("{width}×{height}×{depth} texels in {layers} layers: an image has at least one of each");
            return Err(VulkanError::misuse(name, mistake));
        }
        let texels = u64::from(width) * u64::from(height) * u64::from(depth);
        let bytes = texels.saturating_mul(u64::from(layers) * u64::from(format.texel_bytes()));
        check_limit(name, "its size in bytes", bytes, device.limits().max_allocation_bytes)?;

        let raw = device.raw();
        let info = vk::ImageCreateInfo::default()
            .flags(format.flags())
            .image_type(image_kind)
            .format(format.raw())
            .extent(vk::Extent3D { width, height, depth })
            .mip_levels(1)
            .array_layers(layers)
            .samples(vk::SampleCountFlags::TYPE_1)
            .tiling(vk::ImageTiling::OPTIMAL)
            .usage(usage)
            .sharing_mode(vk::SharingMode::EXCLUSIVE)
            .initial_layout(vk::ImageLayout::UNDEFINED);
        // SAFETY: the extent and the layers are neither zero nor over what the device allows for this format, kind
        // and usage.
        let made = unsafe { raw.functions.create_image(&info, None) };
        let handle = Owned::new(raw, name, "vkCreateImage", made, ash::Device::destroy_image)?;
        // SAFETY: the image was made on this device just now.
        let requirements = unsafe { raw.functions.get_image_memory_requirements(handle.raw()) };
        let memory = Memory::new(device, name, requirements, MemoryLocation::GpuOnly, false)?;
        let (block, offset) = memory.place();
        // SAFETY: the memory was allocated for this image's requirements, is bound to nothing else, and, as the
        // fields of `Inner` are ordered, outlives the image.
        let bound = unsafe { raw.functions.bind_image_memory(handle.raw(), block, offset) };
        bound.map_err(VulkanError::call("vkBindImageMemory", name))?;
        let info = vk::ImageViewCreateInfo::default()
            .image(handle.raw())
            .view_type(view_kind)
            .format(format.viewed())
            .subresource_range(all_layers());
        // SAFETY: the image is bound to memory, of this format or one that may be seen as it, of a kind that such a view may have, and, as the
        // fields of `Inner` are ordered, outlives the view.
        let made = unsafe { raw.functions.create_image_view(&info, None) };
        let view = Owned::new(raw, name, "vkCreateImageView", made, ash::Device::destroy_image_view)?;
        let made = Self { name: name.to_owned(), format, extent, layers, view, handle, _memory: memory };
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

/// The whole of an image.
pub(super) fn all_layers() -> vk::ImageSubresourceRange {
    vk::ImageSubresourceRange::default()
        .aspect_mask(vk::ImageAspectFlags::COLOR)
        .level_count(1)
        .layer_count(vk::REMAINING_ARRAY_LAYERS)
}
