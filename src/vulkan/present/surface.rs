//! Frames of a window: a picture with panels over it.

use std::fmt;
use std::mem::ManuallyDrop;
use std::sync::Arc;

use ash::{khr, vk};
use egui::epaint::{ClippedShape, ImageDelta};
use egui::{ClippedPrimitive, Context, TextureId, TexturesDelta};
use egui_ash_renderer::{DynamicRendering, Options, RenderMode, Renderer, RendererError, allocator::GpuAllocator};
use glam::IVec2;
use winit::raw_window_handle::{HasDisplayHandle, HasWindowHandle};
use winit::window::Window;

use super::damage::{Area, Ground, Panels};
use super::swapchain::{FORMAT, RawSurface, Swapchain, semaphore};
use crate::{Buffer, Device, HostUse, Owned, STORAGE_LAYOUT, StorageImage, VulkanError, all_layers, lock};

/// Object name in errors and validation messages.
const NAME: &str = "window";

/// Content of a window.
pub struct Frame<'a> {
    /// Window size in pixels. Nothing is shown if a side is 0.
    pub size: [u32; 2],
    /// Background colour: red, green and blue, encoded for the screen.
    pub background: [f32; 3],
    /// Picture and its place in the window in pixels: left, top, width, height.
    pub picture: Option<(&'a StorageImage, [u32; 4])>,
    /// Changes of the panels' textures. They are taken out even if nothing is shown.
    pub textures: &'a mut TexturesDelta,
    /// Shapes of the panels.
    pub panels: Vec<ClippedShape>,
    /// The egui context that laid out the panels.
    pub context: &'a Context,
    /// Window pixels per panel point.
    pub pixels_per_point: f32,
    /// Whether to return the pixels shown.
    pub capture: bool,
}

impl fmt::Debug for Frame<'_> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("Frame").field("size", &self.size).finish_non_exhaustive()
    }
}

/// Draw list of a frame.
struct Drawing<'a> {
    picture: Option<(&'a StorageImage, Part)>,
    ground: Ground,
    /// Areas to fill with the background, under the panels.
    cleared: Vec<Area>,
    panels: Vec<ClippedPrimitive>,
    /// Whether the previous content of the image is discarded.
    anew: bool,
}

/// A window that shows frames.
pub struct Surface {
    // Fields in drop order; the device is idle by then.
    panels: ManuallyDrop<Renderer<GpuAllocator>>,
    swapchain: Option<Swapchain>,
    /// Whether the swapchain no longer fits the window.
    stale: bool,
    /// Textures that the current frame may still read.
    freed: Vec<TextureId>,
    /// The picture of the current frame.
    picture: Option<StorageImage>,
    acquired: Owned<vk::Semaphore>,
    fence: Owned<vk::Fence>,
    commands: vk::CommandBuffer,
    /// Owns `commands`.
    pool: Owned<vk::CommandPool>,
    raw: RawSurface,
    device: Device,
    /// The window of the surface.
    _window: Arc<Window>,
}

impl fmt::Debug for Surface {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("Surface").field("device", &self.device).finish_non_exhaustive()
    }
}

impl Surface {
    /// Creates the surface of `window`. The device must have been opened for windows of its display.
    ///
    /// # Errors
    ///
    /// [`VulkanError::NoWindow`] if the device cannot present to the window.
    pub fn new(device: &Device, window: Arc<Window>) -> Result<Self, VulkanError> {
        let raw = raw_surface(device, &window)?;
        let functions = &device.raw().functions;
        let info = vk::CommandPoolCreateInfo::default()
            .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER)
            .queue_family_index(device.queue_family());
        // SAFETY: the device was opened with this queue family.
        let made = unsafe { functions.create_command_pool(&info, None) };
        let pool = Owned::new(device.raw(), NAME, "vkCreateCommandPool", made, ash::Device::destroy_command_pool)?;
        let info = vk::CommandBufferAllocateInfo::default().command_pool(pool.raw()).command_buffer_count(1);
        // SAFETY: the pool is new and not shared.
        let made = unsafe { functions.allocate_command_buffers(&info) };
        let commands = made
            .and_then(|buffers| buffers.first().copied().ok_or(vk::Result::ERROR_UNKNOWN))
            .map_err(VulkanError::call("vkAllocateCommandBuffers", NAME))?;
        let info = vk::FenceCreateInfo::default().flags(vk::FenceCreateFlags::SIGNALED);
        // SAFETY: a default description with one flag is always valid.
        let made = unsafe { functions.create_fence(&info, None) };
        let fence = Owned::new(device.raw(), NAME, "vkCreateFence", made, ash::Device::destroy_fence)?;
        let mode = RenderMode::DynamicRendering(DynamicRendering {
            color_attachment_format: FORMAT,
            depth_attachment_format: None,
            stencil_attachment_format: None,
        });
        let allocator = Arc::clone(device.allocator());
        let panels = Renderer::with_gpu_allocator(allocator, functions.clone(), mode, Options::default());
        let panels = ManuallyDrop::new(panels.map_err(of_panels)?);
        Ok(Self {
            panels,
            swapchain: None,
            stale: true,
            freed: Vec::new(),
            picture: None,
            acquired: semaphore(device, "acquired")?,
            fence,
            commands,
            pool,
            raw,
            device: device.clone(),
            _window: window,
        })
    }

    /// Shows `frame` after the previous frame has finished. With [`Frame::capture`], returns RGBA pixels, rows from the
    /// top.
    ///
    /// # Errors
    ///
    /// [`VulkanError::DeviceLost`], [`VulkanError::Panels`], [`VulkanError::OutOfMemory`].
    pub fn show(&mut self, frame: Frame<'_>) -> Result<Option<Vec<u8>>, VulkanError> {
        self.wait()?;
        if frame.textures.set.values().flatten().any(ImageDelta::is_whole) {
            // A new texture may look different. Partial updates only add glyphs that no earlier frame used.
            self.swapchain.iter_mut().flat_map(|it| &mut it.images).for_each(|image| image.panels = None);
        }
        self.update_textures(frame.textures)?;
        if frame.size.contains(&0) {
            return Ok(None);
        }
        let fits = self.swapchain.as_ref().is_some_and(|it| [it.extent.width, it.extent.height] == frame.size);
        if self.stale || !fits {
            self.swapchain = Swapchain::new(&self.raw, frame.size, self.swapchain.as_ref())?;
            self.stale = false;
        }
        let Some(swapchain) = &mut self.swapchain else { return Ok(None) };
        let extent = swapchain.extent;
        // Allocated before an image is acquired, so that a failure leaves the next frame possible.
        let capture = if frame.capture {
            let bytes = 4 * u64::from(extent.width) * u64::from(extent.height);
            Some(Buffer::host(&self.device, "screenshot", bytes, HostUse::ReadBack)?)
        } else {
            None
        };
        let Some((index, fits)) = swapchain.acquire(self.acquired.raw())? else {
            self.stale = true;
            return Ok(None);
        };
        self.stale = !fits;
        let Some(image) = swapchain.images.get_mut(index as usize) else { return Ok(None) };
        // The image has no complete frame until this one is drawn.
        let before = image.panels.take();
        let part = frame.picture.and_then(|(picture, place)| part(picture.extent(), place, extent));
        let ground = Ground {
            extent: IVec2::new(extent.width.cast_signed(), extent.height.cast_signed()),
            pixels_per_point: frame.pixels_per_point,
            picture: part.map(|part| part.shown),
            background: frame.background,
        };
        // `Panels::within` already culls; egui's own culling uses bounds that are too small.
        frame.context.tessellation_options_mut(|options| options.coarse_tessellation_culling = false);
        let panels = Panels::new(frame.panels, ground);
        let cleared = panels.damage(before.as_ref());
        let drawn = cleared.iter().copied().chain(ground.picture).flat_map(|area| panels.within(area)).collect();
        let picture = frame.picture.map(|(picture, _)| picture).zip(part);
        let drawing = Drawing {
            picture,
            ground,
            cleared,
            panels: frame.context.tessellate(drawn, frame.pixels_per_point),
            anew: before.is_none(),
        };
        self.record(&drawing, index, capture.as_ref())?;
        self.picture = picture.map(|(picture, _)| picture.clone());
        self.submit(index, panels)?;
        let Some(capture) = capture else { return Ok(None) };
        self.wait()?;
        let mut pixels = vec![0; usize::try_from(capture.bytes()).unwrap_or_default()];
        capture.read(0, &mut pixels)?;
        for pixel in pixels.chunks_exact_mut(4) {
            pixel.swap(0, 2);
            pixel[3] = u8::MAX;
        }
        Ok(Some(pixels))
    }

    /// Waits until the previous frame has been drawn, so that its picture may be written again.
    ///
    /// # Errors
    ///
    /// [`VulkanError::DeviceLost`].
    pub fn wait(&mut self) -> Result<(), VulkanError> {
        let fences = [self.fence.raw()];
        // SAFETY: the fence is signalled or belongs to a submission.
        let waited = unsafe { self.device.raw().functions.wait_for_fences(&fences, true, u64::MAX) };
        waited.map_err(VulkanError::call("vkWaitForFences", NAME))?;
        self.picture = None;
        for texture in std::mem::take(&mut self.freed) {
            self.panels.free_texture(texture).map_err(of_panels)?;
        }
        Ok(())
    }

    fn update_textures(&mut self, textures: &mut TexturesDelta) -> Result<(), VulkanError> {
        let queue = lock(self.device.queue());
        for (texture, deltas) in textures.set.drain() {
            for delta in deltas {
                self.panels.set_texture(*queue, self.pool.raw(), texture, &delta).map_err(of_panels)?;
            }
        }
        self.freed.extend(textures.free.drain());
        Ok(())
    }

    fn record(&mut self, drawing: &Drawing<'_>, index: u32, capture: Option<&Buffer>) -> Result<(), VulkanError> {
        let Some(swapchain) = &self.swapchain else { return Ok(()) };
        let Some(shown) = swapchain.images.get(index as usize) else { return Ok(()) };
        let (raw, commands, extent) = (self.device.raw(), self.commands, swapchain.extent);
        let info = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the previous frame has finished, so the commands are not in use, and beginning resets them.
        let begun = unsafe { raw.functions.begin_command_buffer(commands, &info) };
        begun.map_err(VulkanError::call("vkBeginCommandBuffer", NAME))?;

        let barrier = |from: Use, to: Use| {
            // Makes dispatch writes, also of earlier submissions, visible to the copy.
            let memory = [vk::MemoryBarrier2::default()
                .src_stage_mask(vk::PipelineStageFlags2::COMPUTE_SHADER)
                .src_access_mask(vk::AccessFlags2::SHADER_STORAGE_WRITE)
                .dst_stage_mask(vk::PipelineStageFlags2::ALL_TRANSFER)
                .dst_access_mask(vk::AccessFlags2::TRANSFER_READ)];
            let image = [vk::ImageMemoryBarrier2::default()
                .image(shown.image)
                .subresource_range(all_layers())
                .old_layout(from.layout)
                .src_stage_mask(from.stage)
                .src_access_mask(from.access)
                .new_layout(to.layout)
                .dst_stage_mask(to.stage)
                .dst_access_mask(to.access)
                .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
                .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)];
            let info = vk::DependencyInfo::default().memory_barriers(&memory).image_memory_barriers(&image);
            // SAFETY: recording; the info borrows arrays that outlive the call, the image belongs to the swapchain,
            // which is kept until its frames have finished, and the function belongs to this device.
            unsafe { (raw.pipeline_barrier2)(commands, &info) };
        };
        barrier(if drawing.anew { UNDEFINED } else { ACQUIRED }, COPIED_TO);
        if let Some((picture, part)) = &drawing.picture {
            picture.check_device(&self.device)?;
            let (from, to) = ((picture.raw(), STORAGE_LAYOUT), (shown.image, COPIED_TO.layout));
            if part.seen == part.shown.size() && picture.format().raw() == FORMAT {
                // A copy without conversion takes a software device a fraction of the time of a blit.
                let region = [part.copy()];
                // SAFETY: recording; both images have one format and these layouts, the region lies in both, and both
                // are kept until the frame has finished.
                unsafe { raw.functions.cmd_copy_image(commands, from.0, from.1, to.0, to.1, &region) };
            } else {
                let (region, filter) = ([part.blit()], vk::Filter::LINEAR);
                // SAFETY: as above, except for the formats, between which a blit converts.
                unsafe { raw.functions.cmd_blit_image(commands, from.0, from.1, to.0, to.1, &region, filter) };
            }
        }
        barrier(COPIED_TO, DRAWN_ON);
        let attachments = [vk::RenderingAttachmentInfo::default()
            .image_view(shown.view.raw())
            .image_layout(DRAWN_ON.layout)
            .load_op(vk::AttachmentLoadOp::LOAD)
            .store_op(vk::AttachmentStoreOp::STORE)];
        let info = vk::RenderingInfo::default()
            .render_area(vk::Rect2D::default().extent(extent))
            .layer_count(1)
            .color_attachments(&attachments);
        // SAFETY: recording; the view has the colour format of the panels' pipeline, is in this layout, and is kept.
        unsafe { raw.functions.cmd_begin_rendering(commands, &info) };
        let [red, green, blue] = drawing.ground.background;
        let background = [vk::ClearAttachment::default()
            .aspect_mask(vk::ImageAspectFlags::COLOR)
            .clear_value(vk::ClearValue { color: vk::ClearColorValue { float32: [red, green, blue, 1.0] } })];
        let cleared: Vec<_> = drawing.cleared.iter().map(|&area| clear(area)).collect();
        if !cleared.is_empty() {
            // SAFETY: recording, between the begin and the end of rendering; the areas are not empty and lie in the
            // render area.
            unsafe { raw.functions.cmd_clear_attachments(commands, &background, &cleared) };
        }
        self.panels.cmd_draw(commands, extent, drawing.ground.pixels_per_point, &drawing.panels).map_err(of_panels)?;
        // SAFETY: recording; rendering was begun above.
        unsafe { raw.functions.cmd_end_rendering(commands) };
        if let Some(buffer) = capture {
            barrier(DRAWN_ON, COPIED_FROM);
            let layers = vk::ImageSubresourceLayers::default().aspect_mask(vk::ImageAspectFlags::COLOR).layer_count(1);
            let region = vk::BufferImageCopy::default().image_subresource(layers).image_extent(vk::Extent3D {
                width: extent.width,
                height: extent.height,
                depth: 1,
            });
            // SAFETY: recording; the buffer has four bytes per pixel and is kept until the frame has finished, and the
            // barrier has brought the image into this layout.
            unsafe {
                raw.functions.cmd_copy_image_to_buffer(
                    commands,
                    shown.image,
                    COPIED_FROM.layout,
                    buffer.raw(),
                    &[region],
                );
            };
            let memory = [vk::MemoryBarrier2::default()
                .src_stage_mask(vk::PipelineStageFlags2::ALL_TRANSFER)
                .src_access_mask(vk::AccessFlags2::TRANSFER_WRITE)
                .dst_stage_mask(vk::PipelineStageFlags2::HOST)
                .dst_access_mask(vk::AccessFlags2::HOST_READ)];
            let info = vk::DependencyInfo::default().memory_barriers(&memory);
            // SAFETY: recording; the info borrows an array that outlives the call.
            unsafe { (raw.pipeline_barrier2)(commands, &info) };
            barrier(COPIED_FROM, PRESENTED);
        } else {
            barrier(DRAWN_ON, PRESENTED);
        }
        // SAFETY: recording was begun above, and rendering has ended.
        let ended = unsafe { raw.functions.end_command_buffer(commands) };
        ended.map_err(VulkanError::call("vkEndCommandBuffer", NAME))
    }

    /// Submits the recorded commands of image `index`, which then holds `panels`, and presents it.
    fn submit(&mut self, index: u32, panels: Panels) -> Result<(), VulkanError> {
        let Some(swapchain) = &mut self.swapchain else { return Ok(()) };
        let Some(shown) = swapchain.images.get_mut(index as usize) else { return Ok(()) };
        let functions = &self.device.raw().functions;
        // SAFETY: `wait` has seen the fence signalled, so no submission uses it.
        let reset = unsafe { functions.reset_fences(&[self.fence.raw()]) };
        reset.map_err(VulkanError::call("vkResetFences", NAME))?;
        let (commands, waits, signals) = ([self.commands], [self.acquired.raw()], [shown.drawn.raw()]);
        let stages = [vk::PipelineStageFlags::TRANSFER];
        let info = [vk::SubmitInfo::default()
            .command_buffers(&commands)
            .wait_semaphores(&waits)
            .wait_dst_stage_mask(&stages)
            .signal_semaphores(&signals)];
        let queue = lock(self.device.queue());
        let submitted = if self.device.simulated().loses_device() {
            Err(vk::Result::ERROR_DEVICE_LOST)
        } else {
            // SAFETY: the lock keeps other threads off the queue. The fence is reset, the semaphores belong to this
            // frame, and `self` keeps the objects of the commands until the fence has signalled.
            unsafe { functions.queue_submit(*queue, &info, self.fence.raw()) }
        };
        submitted.map_err(VulkanError::call("vkQueueSubmit", NAME))?;
        shown.panels = Some(panels);
        self.stale |= !swapchain.present(*queue, index)?;
        Ok(())
    }
}

impl Drop for Surface {
    fn drop(&mut self) {
        self.device.wait_idle();
        // SAFETY: `self` is being dropped, so the panels are dropped once, and the device is idle.
        unsafe { ManuallyDrop::drop(&mut self.panels) };
    }
}

fn raw_surface(device: &Device, window: &Window) -> Result<RawSurface, VulkanError> {
    let instance = &device.raw().instance;
    let lacking = |_| VulkanError::NoWindow { lacking: "a handle of the window".to_owned() };
    let display = window.display_handle().map_err(lacking)?.as_raw();
    let handle = window.window_handle().map_err(lacking)?.as_raw();
    // SAFETY: both handles belong to a window that the caller keeps longer than the surface.
    let made = unsafe { ash_window::create_surface(&instance.entry, &instance.raw, display, handle, None) };
    let raw = made.map_err(VulkanError::call("vkCreateSurfaceKHR", NAME))?;
    let functions = khr::surface::Instance::new(&instance.entry, &instance.raw);
    let surface = RawSurface { functions, raw, device: device.clone() };
    let (functions, physical) = (&surface.functions, device.physical());
    // SAFETY: the surface and the physical device belong to one instance, and the family to the device.
    let asked = unsafe { functions.get_physical_device_surface_support(physical, device.queue_family(), raw) };
    let supported = asked.map_err(VulkanError::call("vkGetPhysicalDeviceSurfaceSupportKHR", NAME))?;
    // SAFETY: as above.
    let asked = unsafe { functions.get_physical_device_surface_formats(physical, raw) };
    let formats = asked.map_err(VulkanError::call("vkGetPhysicalDeviceSurfaceFormatsKHR", NAME))?;
    if !supported || formats.iter().all(|format| format.format != FORMAT) {
        return Err(VulkanError::NoWindow { lacking: format!("{FORMAT:?} on the queue of {}", device.info().name) });
    }
    Ok(surface)
}

fn of_panels(error: RendererError) -> VulkanError {
    match error {
        RendererError::Vulkan(result) => VulkanError::call("drawing", "panels")(result),
        source => VulkanError::Panels { source: Box::new(source) },
    }
}

/// Visible part of a picture.
#[derive(Clone, Copy)]
struct Part {
    /// Visible pixels of the picture, from its top left.
    seen: IVec2,
    /// Window pixels that it covers.
    shown: Area,
}

/// Visible part of a picture of `from` pixels at `place` in a window of `extent`; `None` if no pixel is visible.
fn part(from: [u32; 2], place: [u32; 4], extent: vk::Extent2D) -> Option<Part> {
    let [left, top, width, height] = place;
    let shown = [width.min(extent.width.checked_sub(left)?), height.min(extent.height.checked_sub(top)?)];
    if shown.contains(&0) {
        return None;
    }
    // For a cropped picture, the visible share of its pixels.
    let of = |from: u32, shown: u32, whole: u32| {
        u32::try_from((u64::from(from) * u64::from(shown)).div_ceil(u64::from(whole))).unwrap_or(from)
    };
    let pixels = |numbers: [u32; 2]| IVec2::from(numbers.map(u32::cast_signed));
    let seen = pixels([of(from[0], shown[0], width), of(from[1], shown[1], height)]);
    let (min, shown) = (pixels([left, top]), pixels(shown));
    Some(Part { seen, shown: Area { min, max: min + shown } })
}

impl Part {
    /// Copy region; requires equal sizes of source and target.
    fn copy(&self) -> vk::ImageCopy {
        let size = self.seen.as_uvec2();
        vk::ImageCopy::default()
            .src_subresource(LAYER)
            .dst_subresource(LAYER)
            .dst_offset(offset(self.shown.min, 0))
            .extent(vk::Extent3D { width: size.x, height: size.y, depth: 1 })
    }

    /// Blit region, which scales.
    fn blit(&self) -> vk::ImageBlit {
        vk::ImageBlit::default()
            .src_subresource(LAYER)
            .src_offsets([offset(IVec2::ZERO, 0), offset(self.seen, 1)])
            .dst_subresource(LAYER)
            .dst_offsets([offset(self.shown.min, 0), offset(self.shown.max, 1)])
    }
}

fn offset(at: IVec2, z: i32) -> vk::Offset3D {
    vk::Offset3D { x: at.x, y: at.y, z }
}

fn clear(area: Area) -> vk::ClearRect {
    let size = area.size().as_uvec2();
    let rect = vk::Rect2D {
        offset: vk::Offset2D { x: area.min.x, y: area.min.y },
        extent: vk::Extent2D { width: size.x, height: size.y },
    };
    vk::ClearRect::default().rect(rect).layer_count(1)
}

/// The single layer of a picture or a window image.
const LAYER: vk::ImageSubresourceLayers = vk::ImageSubresourceLayers {
    aspect_mask: vk::ImageAspectFlags::COLOR,
    mip_level: 0,
    base_array_layer: 0,
    layer_count: 1,
};

/// Use of a window image between two barriers.
#[derive(Clone, Copy)]
struct Use {
    layout: vk::ImageLayout,
    stage: vk::PipelineStageFlags2,
    access: vk::AccessFlags2,
}

/// Discards the previous content.
const UNDEFINED: Use = Use { layout: vk::ImageLayout::UNDEFINED, ..ACQUIRED };
/// State after acquisition. The submission waits for the acquisition in this stage.
const ACQUIRED: Use = Use {
    layout: vk::ImageLayout::PRESENT_SRC_KHR,
    stage: vk::PipelineStageFlags2::ALL_TRANSFER,
    access: vk::AccessFlags2::NONE,
};
const COPIED_TO: Use = Use {
    layout: vk::ImageLayout::TRANSFER_DST_OPTIMAL,
    stage: vk::PipelineStageFlags2::ALL_TRANSFER,
    access: vk::AccessFlags2::TRANSFER_WRITE,
};
const DRAWN_ON: Use = Use {
    layout: vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL,
    stage: vk::PipelineStageFlags2::COLOR_ATTACHMENT_OUTPUT,
    access: vk::AccessFlags2::from_raw(
        vk::AccessFlags2::COLOR_ATTACHMENT_READ.as_raw() | vk::AccessFlags2::COLOR_ATTACHMENT_WRITE.as_raw(),
    ),
};
const COPIED_FROM: Use = Use {
    layout: vk::ImageLayout::TRANSFER_SRC_OPTIMAL,
    stage: vk::PipelineStageFlags2::ALL_TRANSFER,
    access: vk::AccessFlags2::TRANSFER_READ,
};
const PRESENTED: Use = Use {
    layout: vk::ImageLayout::PRESENT_SRC_KHR,
    stage: vk::PipelineStageFlags2::NONE,
    access: vk::AccessFlags2::NONE,
};
