//! Swapchain of a window, recreated when the window changes its size.

use ash::{khr, vk};

use super::damage::Panels;
use crate::{Device, Owned, VulkanError, all_layers};

/// Object name in errors and validation messages.
const NAME: &str = "swapchain";

/// Format of the window's images. Values are already encoded for the screen and shown unchanged.
pub(super) const FORMAT: vk::Format = vk::Format::B8G8R8A8_UNORM;

/// Usage of the images: clear and copy target, colour attachment, copy source for screenshots.
const USAGE: vk::ImageUsageFlags = vk::ImageUsageFlags::from_raw(
    vk::ImageUsageFlags::TRANSFER_DST.as_raw()
        | vk::ImageUsageFlags::TRANSFER_SRC.as_raw()
        | vk::ImageUsageFlags::COLOR_ATTACHMENT.as_raw(),
);

/// A window surface and its functions.
pub(super) struct RawSurface {
    pub(super) functions: khr::surface::Instance,
    pub(super) raw: vk::SurfaceKHR,
    /// Keeps the instance alive.
    pub(super) device: Device,
}

impl Drop for RawSurface {
    fn drop(&mut self) {
        // SAFETY: `self` is the only owner. Its swapchains hold a reference to it, so they are gone. The device keeps
        // the instance of the surface.
        unsafe { self.functions.destroy_surface(self.raw, None) };
    }
}

/// Swapchain and its images.
pub(super) struct Swapchain {
    pub(super) extent: vk::Extent2D,
    pub(super) images: Vec<Shown>,
    functions: khr::swapchain::Device,
    raw: vk::SwapchainKHR,
    /// Keeps the device alive.
    device: Device,
}

/// An image of the swapchain.
pub(super) struct Shown {
    pub(super) image: vk::Image,
    pub(super) view: Owned<vk::ImageView>,
    /// Signalled when the image may be presented. One per image, because Vulkan does not report when the presentation
    /// has waited for it.
    pub(super) drawn: Owned<vk::Semaphore>,
    /// Panels on the image, if it holds a complete frame. The image keeps its content until it is acquired again.
    pub(super) panels: Option<Panels>,
}

impl Swapchain {
    /// Creates images of `size` pixels, or of the window size that the system reports. Returns `None` if the window has
    /// no pixels.
    pub(super) fn new(surface: &RawSurface, size: [u32; 2], old: Option<&Self>) -> Result<Option<Self>, VulkanError> {
        let (device, physical) = (&surface.device, surface.device.physical());
        // SAFETY: the surface and the physical device belong to one instance.
        let asked = unsafe { surface.functions.get_physical_device_surface_capabilities(physical, surface.raw) };
        let can = asked.map_err(VulkanError::call("vkGetPhysicalDeviceSurfaceCapabilitiesKHR", NAME))?;
        let extent = match can.current_extent.width {
            // The window takes the size of its images.
            u32::MAX => vk::Extent2D {
                width: size[0].clamp(can.min_image_extent.width, can.max_image_extent.width),
                height: size[1].clamp(can.min_image_extent.height, can.max_image_extent.height),
            },
            _ => can.current_extent,
        };
        if extent.width == 0 || extent.height == 0 {
            return Ok(None);
        }
        if !can.supported_usage_flags.contains(USAGE) {
            return Err(VulkanError::misuse(
                NAME,
                format!("the window supports only the image usages {:?}", can.supported_usage_flags),
            ));
        }
        let most = if can.max_image_count == 0 { u32::MAX } else { can.max_image_count };
        let alpha = [vk::CompositeAlphaFlagsKHR::OPAQUE, vk::CompositeAlphaFlagsKHR::INHERIT]
            .into_iter()
            .find(|&mode| can.supported_composite_alpha.contains(mode))
            .unwrap_or(vk::CompositeAlphaFlagsKHR::PRE_MULTIPLIED);
        let info = vk::SwapchainCreateInfoKHR::default()
            .surface(surface.raw)
            .min_image_count((can.min_image_count + 1).min(most))
            .image_format(FORMAT)
            .image_color_space(vk::ColorSpaceKHR::SRGB_NONLINEAR)
            .image_extent(extent)
            .image_array_layers(1)
            .image_usage(USAGE)
            .image_sharing_mode(vk::SharingMode::EXCLUSIVE)
            .pre_transform(can.current_transform)
            .composite_alpha(alpha)
            // The only mode that every device supports.
            .present_mode(vk::PresentModeKHR::FIFO)
            // Otherwise, pixels below another window could be lost between two frames, and they are not redrawn.
            .clipped(false)
            .old_swapchain(old.map_or_else(vk::SwapchainKHR::null, |old| old.raw));
        let functions = khr::swapchain::Device::new(&device.raw().instance.raw, &device.raw().functions);
        // SAFETY: the surface supports this format (checked by its owner), the numbers are within the capabilities
        // queried above, and an old swapchain has the same surface.
        let made = unsafe { functions.create_swapchain(&info, None) };
        let raw = made.map_err(VulkanError::call("vkCreateSwapchainKHR", NAME))?;
        let mut swapchain = Self { extent, images: Vec::new(), functions, raw, device: device.clone() };
        // SAFETY: the swapchain was just created.
        let listed = unsafe { swapchain.functions.get_swapchain_images(raw) };
        let images = listed.map_err(VulkanError::call("vkGetSwapchainImagesKHR", NAME))?;
        swapchain.images = images.into_iter().map(|image| Shown::new(device, image)).collect::<Result<_, _>>()?;
        Ok(Some(swapchain))
    }

    /// Returns the index of the next image, and whether its size still fits the window. `acquired` is signalled when
    /// the image can be written. `None` if the swapchain is out of date.
    pub(super) fn acquire(&self, acquired: vk::Semaphore) -> Result<Option<(u32, bool)>, VulkanError> {
        // SAFETY: nothing waits on the semaphore, because the frame that did has finished.
        let answer = unsafe { self.functions.acquire_next_image(self.raw, u64::MAX, acquired, vk::Fence::null()) };
        match answer {
            Ok((image, suboptimal)) => Ok(Some((image, !suboptimal))),
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => Ok(None),
            Err(source) => Err(VulkanError::call("vkAcquireNextImageKHR", NAME)(source)),
        }
    }

    /// Presents the image. Returns whether its size still fits the window.
    pub(super) fn present(&self, queue: vk::Queue, image: u32) -> Result<bool, VulkanError> {
        let Some(shown) = self.images.get(image as usize) else { return Ok(false) };
        let (waits, swapchains, images) = ([shown.drawn.raw()], [self.raw], [image]);
        let info = vk::PresentInfoKHR::default().wait_semaphores(&waits).swapchains(&swapchains).image_indices(&images);
        // SAFETY: the image was acquired, the submission that signals the semaphore was made, and the caller holds the
        // queue's lock.
        match unsafe { self.functions.queue_present(queue, &info) } {
            Ok(suboptimal) => Ok(!suboptimal),
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => Ok(false),
            Err(source) => Err(VulkanError::call("vkQueuePresentKHR", NAME)(source)),
        }
    }
}

impl Shown {
    fn new(device: &Device, image: vk::Image) -> Result<Self, VulkanError> {
        let raw = device.raw();
        let info = vk::ImageViewCreateInfo::default()
            .image(image)
            .view_type(vk::ImageViewType::TYPE_2D)
            .format(FORMAT)
            .subresource_range(all_layers());
        // SAFETY: the image has this format and belongs to a swapchain that outlives the view.
        let made = unsafe { raw.functions.create_image_view(&info, None) };
        let view = Owned::new(raw, NAME, "vkCreateImageView", made, ash::Device::destroy_image_view)?;
        Ok(Self { image, view, drawn: semaphore(device, "drawn")?, panels: None })
    }
}

/// Creates a binary semaphore.
pub(super) fn semaphore(device: &Device, name: &str) -> Result<Owned<vk::Semaphore>, VulkanError> {
    let raw = device.raw();
    // SAFETY: a default description is always valid.
    let made = unsafe { raw.functions.create_semaphore(&vk::SemaphoreCreateInfo::default(), None) };
    Owned::new(raw, name, "vkCreateSemaphore", made, ash::Device::destroy_semaphore)
}

impl Drop for Swapchain {
    fn drop(&mut self) {
        // Presentation has no fence.
        self.device.wait_idle();
        self.images.clear();
        // SAFETY: `self` is the only owner, the device is idle, and the views are gone.
        unsafe { self.functions.destroy_swapchain(self.raw, None) };
    }
}
