//! The images of a window, which come and go with its size.

use ash::{khr, vk};

use super::{Device, VulkanError, damage::Panels, handle::Owned, image::all_layers};

/// What errors and the validation layer call it.
const NAME: &str = "swapchain";

/// The format of the window's images: what is written is what is shown, already encoded for the screen.
pub(super) const FORMAT: vk::Format = vk::Format::B8G8R8A8_UNORM;

/// What they are used for: cleared and copied to, drawn on, copied from for screenshots.
const USAGE: vk::ImageUsageFlags = vk::ImageUsageFlags::from_raw(
    vk::ImageUsageFlags::TRANSFER_DST.as_raw()
        | vk::ImageUsageFlags::TRANSFER_SRC.as_raw()
        | vk::ImageUsageFlags::COLOR_ATTACHMENT.as_raw(),
);

/// A surface of the system's, and what asks about it.
pub(super) struct RawSurface {
    pub(super) functions: khr::surface::Instance,
    pub(super) raw: vk::SurfaceKHR,
    /// Keeps the instance.
    pub(super) device: Device,
}

impl Drop for RawSurface {
    fn drop(&mut self) {
        // SAFETY: `self` is the only owner, its swapchains hold a reference to it and have gone, and the instance that it
        // was made from is kept by the device.
        unsafe { self.functions.destroy_surface(self.raw, None) };
    }
}

/// The images that a window shows in turn.
pub(super) struct Swapchain {
    pub(super) extent: vk::Extent2D,
    pub(super) images: Vec<Shown>,
    functions: khr::swapchain::Device,
    raw: vk::SwapchainKHR,
    /// Keeps the device.
    device: Device,
}

/// One of them.
pub(super) struct Shown {
    pub(super) image: vk::Image,
    pub(super) view: Owned<vk::ImageView>,
    /// Signalled when it may be shown; its own, because nobody tells when the screen has waited for it.
    pub(super) drawn: Owned<vk::Semaphore>,
    /// The panels on it, where it holds a whole frame. It keeps that until it is its turn again.
    pub(super) panels: Option<Panels>,
}

impl Swapchain {
    /// Images of `size` pixels, or of the size that the system says the window has. `None` while it has no pixels.
    pub(super) fn new(surface: &RawSurface, size: [u32; 2], old: Option<&Self>) -> Result<Option<Self>, VulkanError> {
        let (device, physical) = (&surface.device, surface.device.physical());
        // SAFETY: the surface and the physical device are of one instance.
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
            return Err(VulkanError::misuse(NAME, format!("the window allows {:?} only", can.supported_usage_flags)));
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
            // The one mode that every device has.
            .present_mode(vk::PresentModeKHR::FIFO)
            // Else pixels that something lies over could be lost between two frames, and are not drawn again.
            .clipped(false)
            .old_swapchain(old.map_or_else(vk::SwapchainKHR::null, |old| old.raw));
        let functions = khr::swapchain::Device::new(&device.raw().instance.raw, &device.raw().functions);
        // SAFETY: the surface shows this format (its owner has asked), the numbers are within what it has just answered,
        // and an old swapchain is of the same surface.
        let made = unsafe { functions.create_swapchain(&info, None) };
        let raw = made.map_err(VulkanError::call("vkCreateSwapchainKHR", NAME))?;
        let mut swapchain = Self { extent, images: Vec::new(), functions, raw, device: device.clone() };
        // SAFETY: the swapchain was made just now.
        let listed = unsafe { swapchain.functions.get_swapchain_images(raw) };
        let images = listed.map_err(VulkanError::call("vkGetSwapchainImagesKHR", NAME))?;
        swapchain.images = images.into_iter().map(|image| Shown::new(device, image)).collect::<Result<_, _>>()?;
        Ok(Some(swapchain))
    }

    /// The number of the next image, and whether it still fits its window; `acquired` is signalled once it can be written.
    /// `None` where it does not fit at all.
    pub(super) fn acquire(&self, acquired: vk::Semaphore) -> Result<Option<(u32, bool)>, VulkanError> {
        // SAFETY: nothing waits on the semaphore, because the frame that did has ended.
        let answer = unsafe { self.functions.acquire_next_image(self.raw, u64::MAX, acquired, vk::Fence::null()) };
        match answer {
            Ok((image, suboptimal)) => Ok(Some((image, !suboptimal))),
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => Ok(None),
            Err(source) => Err(VulkanError::call("vkAcquireNextImageKHR", NAME)(source)),
        }
    }

    /// Shows the image; says whether it still fits its window.
    pub(super) fn present(&self, queue: vk::Queue, image: u32) -> Result<bool, VulkanError> {
        let Some(shown) = self.images.get(image as usize) else { return Ok(false) };
        let (waits, swapchains, images) = ([shown.drawn.raw()], [self.raw], [image]);
        let info = vk::PresentInfoKHR::default().wait_semaphores(&waits).swapchains(&swapchains).image_indices(&images);
        // SAFETY: the image was acquired, the submission that signals the semaphore has been made, and the caller holds
        // the queue's lock.
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
        // SAFETY: the image is of a swapchain that outlives the view, and of this format.
        let made = unsafe { raw.functions.create_image_view(&info, None) };
        let view = Owned::new(raw, NAME, "vkCreateImageView", made, ash::Device::destroy_image_view)?;
        Ok(Self { image, view, drawn: semaphore(device, "drawn")?, panels: None })
    }
}

/// A semaphore of two states.
pub(super) fn semaphore(device: &Device, name: &str) -> Result<Owned<vk::Semaphore>, VulkanError> {
    let raw = device.raw();
    // SAFETY: the description asks for nothing special.
    let made = unsafe { raw.functions.create_semaphore(&vk::SemaphoreCreateInfo::default(), None) };
    Owned::new(raw, name, "vkCreateSemaphore", made, ash::Device::destroy_semaphore)
}

impl Drop for Swapchain {
    fn drop(&mut self) {
        // Showing has no fence.
        self.device.wait_idle();
        self.images.clear();
        // SAFETY: `self` is the only owner, the device is done with it, and its views are gone.
        unsafe { self.functions.destroy_swapchain(self.raw, None) };
    }
}
