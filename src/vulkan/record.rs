//! Recording commands.

use std::{ops::Range, sync::Arc, time::Duration};

use ash::vk;

use super::{
    Buffer, ComputePipeline, Device, Image3d, ResourceSet, StorageImage, Submission, VulkanError,
    commands::MAX_TIMESTAMPS,
    error::check_limit,
    image,
    submission::{Lease, Used},
};

/// A command list under construction.
///
/// Commands may overlap in time, within a submission and between submissions. If one command writes data that another
/// uses, the barrier named after the two must lie between them. Waiting for a submission replaces a barrier only for
/// the host. Uploads include their own barriers.
#[derive(Debug)]
pub struct Recorder {
    name: String,
    used: Used,
    timestamps: u32,
    lease: Lease,
}

impl Device {
    /// Records commands with `record`, submits them and waits until they have finished.
    ///
    /// # Errors
    ///
    /// Those of `record`, and [`VulkanError::DeviceLost`].
    pub fn run(
        &self,
        name: &str,
        record: impl FnOnce(&mut Recorder) -> Result<(), VulkanError>,
    ) -> Result<(), VulkanError> {
        let mut recorder = Recorder::begin(self, name)?;
        record(&mut recorder)?;
        recorder.submit()?.finish()
    }

    /// Does what [`Self::run`] does and returns the duration by the device's clock; `None` if it has no clock.
    ///
    /// # Errors
    ///
    /// Those of [`Self::run`].
    pub fn run_timed(
        &self,
        name: &str,
        record: impl FnOnce(&mut Recorder) -> Result<(), VulkanError>,
    ) -> Result<Option<Duration>, VulkanError> {
        let mut recorder = Recorder::begin(self, name)?;
        recorder.timestamp()?;
        record(&mut recorder)?;
        recorder.timestamp()?;
        let mut submission = recorder.submit()?;
        while !submission.wait(Duration::MAX)? {}
        Ok(submission.timestamps()?.last().copied())
    }
}

impl Recorder {
    /// Begins a command list; `name` appears in error messages.
    ///
    /// # Errors
    ///
    /// [`VulkanError::DeviceLost`], [`VulkanError::Call`] if the device is out of memory.
    pub fn begin(device: &Device, name: &str) -> Result<Self, VulkanError> {
        let lease = Lease::take(device, name)?;
        let info = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the lease has just reset the command buffer, and only this recorder uses it.
        let begun = unsafe { device.raw().functions.begin_command_buffer(lease.slot.commands, &info) };
        begun.map_err(VulkanError::call("vkBeginCommandBuffer", name))?;
        Ok(Self { name: name.to_owned(), used: Used::default(), timestamps: 0, lease })
    }

    /// Copies slices `z` of `image` from `buffer`, where they start at byte `offset`: x fastest, tightly packed.
    ///
    /// Includes barriers against the dispatches and uploads before and after it that use the image.
    ///
    /// # Errors
    ///
    /// [`VulkanError::Misuse`] for slices outside the image, bytes outside the buffer, or an offset that is not a
    /// multiple of both 4 and the texel size.
    pub fn upload(&mut self, image: &Image3d, z: Range<u32>, buffer: &Buffer, offset: u64) -> Result<(), VulkanError> {
        let [width, height, depth] = image.extent();
        if z.is_empty() || z.end > depth {
            let mistake = format!("slices {}..{} are outside its {depth} slices", z.start, z.end);
            return Err(VulkanError::misuse(image.name(), mistake));
        }
        self.upload_box(image, [0, 0, z.start], [width, height, z.end - z.start], buffer, offset)
    }

    /// [`Self::upload`] of the box of `extent` texels that begins at `first`.
    ///
    /// # Errors
    ///
    /// Those of [`Self::upload`], for a box outside the image.
    pub fn upload_box(
        &mut self,
        image: &Image3d,
        first: [u32; 3],
        extent: [u32; 3],
        buffer: &Buffer,
        offset: u64,
    ) -> Result<(), VulkanError> {
        let inside = |axis: usize| {
            extent[axis] > 0 && first[axis].checked_add(extent[axis]).is_some_and(|end| end <= image.extent()[axis])
        };
        if !(0..3).all(inside) {
            let mistake = format!("{extent:?} texels from {first:?} on are outside its {:?} texels", image.extent());
            return Err(VulkanError::misuse(image.name(), mistake));
        }
        let [width, height, depth] = extent;
        let texel = u64::from(image.format().texel_bytes());
        let bytes = u64::from(width) * u64::from(height) * u64::from(depth) * texel;
        image.check_device(self.device())?;
        check_source(self.device(), buffer)?;
        check_copy(buffer, offset, bytes, texel)?;
        let raw = image.raw();
        self.image_barrier(
            raw,
            (image.layout(), COMPUTE_READS_TEXTURE),
            (vk::ImageLayout::TRANSFER_DST_OPTIMAL, TRANSFER_WRITES),
        );
        let [x, y, z] = first.map(u32::cast_signed);
        let region = vk::BufferImageCopy::default()
            .buffer_offset(offset)
            .image_subresource(one_layer(0))
            .image_offset(vk::Offset3D { x, y, z })
            .image_extent(vk::Extent3D { width, height, depth });
        // SAFETY: recording; the region was checked to lie in both the image and the buffer. Both are kept until the
        // submission ends, and the barrier before has brought the image into this layout.
        unsafe {
            self.functions().cmd_copy_buffer_to_image(
                self.commands(),
                buffer.raw(),
                raw,
                vk::ImageLayout::TRANSFER_DST_OPTIMAL,
                &[region],
            );
        };
        self.image_barrier(
            raw,
            (vk::ImageLayout::TRANSFER_DST_OPTIMAL, TRANSFER_WRITES),
            (image.layout(), COMPUTE_READS_TEXTURE),
        );
        self.used.buffers.push(buffer.clone());
        self.used.others.push(Arc::new(image.clone()));
        Ok(())
    }

    /// Runs `groups` workgroups of `pipeline` on the resources of `set`.
    ///
    /// # Errors
    ///
    /// [`VulkanError::Misuse`] if the set or the push constants do not match the pipeline, [`VulkanError::TooLarge`]
    /// for more workgroups than the device allows.
    pub fn dispatch(
        &mut self,
        pipeline: &ComputePipeline,
        set: &ResourceSet,
        push_constants: &[u8],
        groups: [u32; 3],
    ) -> Result<(), VulkanError> {
        pipeline.check_device(self.device())?;
        set.check_device(self.device())?;
        pipeline.check_dispatch(set.bindings(), push_constants)?;
        for (asked, limit) in groups.into_iter().zip(self.device().limits().max_groups) {
            check_limit(pipeline.name(), "its number of workgroups along an axis", asked.into(), limit.into())?;
        }
        let (functions, commands) = (self.functions(), self.commands());
        let point = vk::PipelineBindPoint::COMPUTE;
        // SAFETY: recording; the pipeline is kept until the submission ends.
        unsafe { functions.cmd_bind_pipeline(commands, point, pipeline.raw()) };
        // SAFETY: recording; the set was made for the same bindings, and is kept with all its resources.
        unsafe { functions.cmd_bind_descriptor_sets(commands, point, pipeline.layout(), 0, &[set.raw()], &[]) };
        if !push_constants.is_empty() {
            let stage = vk::ShaderStageFlags::COMPUTE;
            // SAFETY: recording; the bytes are copied, and their number equals that of the layout.
            unsafe { functions.cmd_push_constants(commands, pipeline.layout(), stage, 0, push_constants) };
        }
        let [x, y, z] = groups;
        // SAFETY: recording; all resources of the shader are bound, the group counts are within limits, buffer accesses
        // are bounded by robustBufferAccess, and images ignore writes outside.
        unsafe { functions.cmd_dispatch(commands, x, y, z) };
        self.device().count_dispatch();
        self.used.buffers.extend_from_slice(set.buffers());
        self.used.others.push(pipeline.keep());
        self.used.others.push(set.keep());
        Ok(())
    }

    /// Sets every texel of every layer to `value`.
    ///
    /// # Errors
    ///
    /// [`VulkanError::Misuse`] for an image of integers.
    pub fn clear(&mut self, image: &StorageImage, value: [f32; 4]) -> Result<(), VulkanError> {
        self.clear_layers(image, 0..image.layers(), value)
    }

    /// Sets every texel of some layers to `value`.
    ///
    /// # Errors
    ///
    /// [`VulkanError::Misuse`] for an image of integers, or layers outside the image.
    pub fn clear_layers(
        &mut self,
        image: &StorageImage,
        layers: Range<u32>,
        value: [f32; 4],
    ) -> Result<(), VulkanError> {
        image.check_device(self.device())?;
        if image.format().is_uint() {
            return Err(VulkanError::misuse(image.name(), "an image of integers cannot be cleared to a number"));
        }
        if layers.is_empty() || layers.end > image.layers() {
            let mistake = format!("layers {layers:?} are outside its {} layers", image.layers());
            return Err(VulkanError::misuse(image.name(), mistake));
        }
        let value = vk::ClearColorValue { float32: value };
        let range = [image::all_layers().base_array_layer(layers.start).layer_count(layers.end - layers.start)];
        // SAFETY: recording; the image is always in this layout, was made as a copy target, and is kept. It has these
        // layers.
        unsafe {
            self.functions().cmd_clear_color_image(self.commands(), image.raw(), image::STORAGE_LAYOUT, &value, &range);
        };
        self.used.others.push(Arc::new(image.clone()));
        Ok(())
    }

    /// Sets every byte of `buffer` to 0.
    ///
    /// # Errors
    ///
    /// [`VulkanError::Misuse`] for a buffer that copies do not write, or of a number of bytes that is no multiple of 4.
    pub fn zero(&mut self, buffer: &Buffer) -> Result<(), VulkanError> {
        check_target(self.device(), buffer)?;
        if !buffer.bytes().is_multiple_of(4) {
            return Err(VulkanError::misuse(buffer.name(), "only whole words are set to 0"));
        }
        // SAFETY: recording; the range is the whole buffer, which copies may write and which is kept.
        unsafe { self.functions().cmd_fill_buffer(self.commands(), buffer.raw(), 0, vk::WHOLE_SIZE, 0) };
        self.used.buffers.push(buffer.clone());
        Ok(())
    }

    /// Copies `bytes` bytes from one buffer to another.
    ///
    /// # Errors
    ///
    /// [`VulkanError::Misuse`] for bytes that a buffer does not have, or a copy within one buffer.
    pub fn copy(
        &mut self,
        from: &Buffer,
        from_offset: u64,
        to: &Buffer,
        to_offset: u64,
        bytes: u64,
    ) -> Result<(), VulkanError> {
        check_source(self.device(), from)?;
        check_target(self.device(), to)?;
        from.check_range(from_offset, bytes)?;
        to.check_range(to_offset, bytes)?;
        if bytes == 0 {
            return Ok(());
        }
        if from.raw() == to.raw() {
            return Err(VulkanError::misuse(from.name(), "a buffer cannot be copied into itself"));
        }
        let region = vk::BufferCopy { src_offset: from_offset, dst_offset: to_offset, size: bytes };
        // SAFETY: recording; the region was checked to lie in both buffers, which do not overlap and are kept.
        unsafe { self.functions().cmd_copy_buffer(self.commands(), from.raw(), to.raw(), &[region]) };
        self.used.buffers.extend([from.clone(), to.clone()]);
        Ok(())
    }

    /// Copies `layer` of `image` to `buffer`, from byte `offset` on: rows from the top, tightly packed.
    ///
    /// # Errors
    ///
    /// [`VulkanError::Misuse`] for a layer outside the image, bytes outside the buffer, or an offset that is not a
    /// multiple of both 4 and the texel size.
    pub fn read_back(
        &mut self,
        image: &StorageImage,
        layer: u32,
        buffer: &Buffer,
        offset: u64,
    ) -> Result<(), VulkanError> {
        self.copy_back(image, layer, [[0, 0], image.extent()], buffer, offset)
    }

    /// Copies `rows` of `layer` of `image` to `buffer`, from byte `offset` on: tightly packed.
    ///
    /// # Errors
    ///
    /// Those of [`Self::read_back`], and [`VulkanError::Misuse`] for rows outside the image.
    pub fn read_back_rows(
        &mut self,
        image: &StorageImage,
        layer: u32,
        rows: Range<u32>,
        buffer: &Buffer,
        offset: u64,
    ) -> Result<(), VulkanError> {
        let rectangle = rows_of(image, rows)?;
        self.copy_back(image, layer, rectangle, buffer, offset)
    }

    /// Copies `rows` of `layer` of `image` from `buffer`, where they begin at byte `offset`: tightly packed.
    ///
    /// # Errors
    ///
    /// Those of [`Self::read_back_rows`].
    pub fn write_rows(
        &mut self,
        image: &StorageImage,
        layer: u32,
        rows: Range<u32>,
        buffer: &Buffer,
        offset: u64,
    ) -> Result<(), VulkanError> {
        let rectangle = rows_of(image, rows)?;
        check_source(self.device(), buffer)?;
        let region = self.rectangle(image, layer, rectangle, buffer, offset)?;
        // SAFETY: recording; the region was checked to lie in both the image and the buffer. Both are kept until the
        // submission ends, and the image is always in this layout.
        unsafe {
            self.functions().cmd_copy_buffer_to_image(
                self.commands(),
                buffer.raw(),
                image.raw(),
                image::STORAGE_LAYOUT,
                &[region],
            );
        };
        self.used.buffers.push(buffer.clone());
        self.used.others.push(Arc::new(image.clone()));
        Ok(())
    }

    /// Copies the texel at `place` (column, row) of `layer` of `image` to byte `offset` of `buffer`.
    ///
    /// # Errors
    ///
    /// Those of [`Self::read_back`], and [`VulkanError::Misuse`] for a texel outside the image.
    pub fn read_back_texel(
        &mut self,
        image: &StorageImage,
        layer: u32,
        place: [u32; 2],
        buffer: &Buffer,
        offset: u64,
    ) -> Result<(), VulkanError> {
        let [width, height] = image.extent();
        if place[0] >= width || place[1] >= height {
            let mistake = format!("texel {place:?} is outside its {width}×{height} texels");
            return Err(VulkanError::misuse(image.name(), mistake));
        }
        self.copy_back(image, layer, [place, [1, 1]], buffer, offset)
    }

    /// Copies all texels of `image`, made by [`Image3d::written`], to `buffer`: slice by slice, tightly packed.
    ///
    /// # Errors
    ///
    /// [`VulkanError::Misuse`] for another image, or bytes outside the buffer.
    pub fn read_back_volume(&mut self, image: &Image3d, buffer: &Buffer) -> Result<(), VulkanError> {
        if image.layout() != image::STORAGE_LAYOUT {
            return Err(VulkanError::misuse(image.name(), "only images that shaders write are read back"));
        }
        image.check_device(self.device())?;
        check_target(self.device(), buffer)?;
        let [width, height, depth] = image.extent();
        let texel = u64::from(image.format().texel_bytes());
        check_copy(buffer, 0, u64::from(width) * u64::from(height) * u64::from(depth) * texel, texel)?;
        let region = vk::BufferImageCopy::default().image_subresource(one_layer(0)).image_extent(vk::Extent3D {
            width,
            height,
            depth,
        });
        // SAFETY: the image has this layout, and the buffer was checked to hold all texels.
        unsafe { self.copy_region(image.raw(), buffer, region) };
        self.used.others.push(Arc::new(image.clone()));
        Ok(())
    }

    /// Copies a region of an image that shaders write to `buffer`, which is kept.
    ///
    /// # Safety
    ///
    /// The image must be in the layout of storage images and kept until the submission ends; the region must lie in both.
    unsafe fn copy_region(&mut self, image: vk::Image, buffer: &Buffer, region: vk::BufferImageCopy) {
        // SAFETY: recording; the caller has checked image and region, and the buffer is kept.
        unsafe {
            self.functions().cmd_copy_image_to_buffer(
                self.commands(),
                image,
                image::STORAGE_LAYOUT,
                buffer.raw(),
                &[region],
            );
        };
        self.used.buffers.push(buffer.clone());
    }

    /// Checks the copy of a rectangle of `image`, which must lie in the image, to or from `buffer`.
    fn rectangle(
        &self,
        image: &StorageImage,
        layer: u32,
        [place, [width, height]]: [[u32; 2]; 2],
        buffer: &Buffer,
        offset: u64,
    ) -> Result<vk::BufferImageCopy, VulkanError> {
        if layer >= image.layers() {
            let mistake = format!("layer {layer} is outside its {} layers", image.layers());
            return Err(VulkanError::misuse(image.name(), mistake));
        }
        image.check_device(self.device())?;
        let texel_bytes = u64::from(image.format().texel_bytes());
        check_copy(buffer, offset, u64::from(width) * u64::from(height) * texel_bytes, texel_bytes)?;
        let [x, y] = place.map(|texel| i32::try_from(texel).unwrap_or(i32::MAX));
        Ok(vk::BufferImageCopy::default()
            .buffer_offset(offset)
            .image_subresource(one_layer(layer))
            .image_offset(vk::Offset3D { x, y, z: 0 })
            .image_extent(vk::Extent3D { width, height, depth: 1 }))
    }

    /// Copies a rectangle of `image`, which must lie in the image.
    fn copy_back(
        &mut self,
        image: &StorageImage,
        layer: u32,
        rectangle: [[u32; 2]; 2],
        buffer: &Buffer,
        offset: u64,
    ) -> Result<(), VulkanError> {
        check_target(self.device(), buffer)?;
        let region = self.rectangle(image, layer, rectangle, buffer, offset)?;
        // SAFETY: the region was checked to lie in both the image, which is always in this layout, and the buffer.
        unsafe { self.copy_region(image.raw(), buffer, region) };
        self.used.others.push(Arc::new(image.clone()));
        Ok(())
    }

    /// Records a timestamp after all earlier commands have finished. See [`Submission::timestamps`].
    ///
    /// # Errors
    ///
    /// [`VulkanError::TooLarge`] for more than 16 timestamps in a submission.
    pub fn timestamp(&mut self) -> Result<(), VulkanError> {
        check_limit(&self.name, "its number of timestamps", (self.timestamps + 1).into(), MAX_TIMESTAMPS.into())?;
        if self.device().limits().timestamp_valid_bits == 0 {
            return Ok(());
        }
        let (functions, commands, pool) = (self.functions(), self.commands(), self.lease.slot.timestamps.raw());
        if self.timestamps == 0 {
            // SAFETY: recording; the pool belongs to this lease and has `MAX_TIMESTAMPS` queries.
            unsafe { functions.cmd_reset_query_pool(commands, pool, 0, MAX_TIMESTAMPS) };
        }
        let stage = vk::PipelineStageFlags::BOTTOM_OF_PIPE;
        // SAFETY: recording; the query was reset above and is used once, and the queue supports timestamps.
        unsafe { functions.cmd_write_timestamp(commands, stage, pool, self.timestamps) };
        self.timestamps += 1;
        Ok(())
    }

    /// Barrier: later dispatches see and may overwrite the writes of earlier dispatches.
    pub fn compute_to_compute(&mut self) {
        self.barrier(COMPUTE_WRITES, COMPUTE_USES);
    }

    /// Barrier: later copies and clears see and may overwrite the writes of earlier dispatches.
    pub fn compute_to_transfer(&mut self) {
        self.barrier(COMPUTE_WRITES, TRANSFER_USES);
    }

    /// Barrier: later dispatches see and may overwrite the writes of earlier copies and clears.
    pub fn transfer_to_compute(&mut self) {
        self.barrier(TRANSFER_WRITES, COMPUTE_USES);
    }

    /// Barrier: later copies and clears see and may overwrite the writes of earlier copies and clears.
    pub fn transfer_to_transfer(&mut self) {
        self.barrier(TRANSFER_WRITES, TRANSFER_USES);
    }

    /// Barrier: the host sees the writes of earlier dispatches after the submission.
    pub fn compute_to_host(&mut self) {
        self.barrier(COMPUTE_WRITES, HOST_READS);
    }

    /// Barrier: the host sees the writes of earlier copies after the submission.
    pub fn transfer_to_host(&mut self) {
        self.barrier(TRANSFER_WRITES, HOST_READS);
    }

    /// Submits the commands to the device.
    ///
    /// # Errors
    ///
    /// [`VulkanError::DeviceLost`], [`VulkanError::Call`] if the device is out of memory.
    pub fn submit(self) -> Result<Submission, VulkanError> {
        let Self { name, used, timestamps, lease } = self;
        // SAFETY: the command buffer is being recorded, and only `self` uses it.
        let ended = unsafe { lease.device.raw().functions.end_command_buffer(lease.slot.commands) };
        ended.map_err(VulkanError::call("vkEndCommandBuffer", &name))?;
        Submission::start(name, used, timestamps, lease)
    }

    /// Brings a new image into its permanent layout.
    pub(super) fn set_first_layout(&mut self, image: vk::Image, layout: vk::ImageLayout) {
        let any = (vk::PipelineStageFlags2::COMPUTE_SHADER | vk::PipelineStageFlags2::ALL_TRANSFER, ALL_ACCESS);
        let none = (vk::PipelineStageFlags2::NONE, vk::AccessFlags2::NONE);
        self.image_barrier(image, (vk::ImageLayout::UNDEFINED, none), (layout, any));
    }

    fn barrier(&mut self, before: Scope, after: Scope) {
        let barrier = [vk::MemoryBarrier2::default()
            .src_stage_mask(before.0)
            .src_access_mask(before.1)
            .dst_stage_mask(after.0)
            .dst_access_mask(after.1)];
        self.record_barrier(&vk::DependencyInfo::default().memory_barriers(&barrier));
    }

    fn image_barrier(&mut self, image: vk::Image, before: (vk::ImageLayout, Scope), after: (vk::ImageLayout, Scope)) {
        let barrier = [vk::ImageMemoryBarrier2::default()
            .image(image)
            .subresource_range(image::all_layers())
            .old_layout(before.0)
            .src_stage_mask(before.1.0)
            .src_access_mask(before.1.1)
            .new_layout(after.0)
            .dst_stage_mask(after.1.0)
            .dst_access_mask(after.1.1)
            .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)];
        self.record_barrier(&vk::DependencyInfo::default().image_memory_barriers(&barrier));
    }

    fn record_barrier(&mut self, dependency: &vk::DependencyInfo<'_>) {
        // SAFETY: recording; the dependency borrows arrays that outlive the call, its image (if any) is kept, and the
        // function belongs to this device, which has synchronization2 enabled.
        unsafe { (self.device().raw().pipeline_barrier2)(self.commands(), dependency) };
    }

    fn device(&self) -> &Device {
        &self.lease.device
    }

    fn functions(&self) -> &ash::Device {
        &self.lease.device.raw().functions
    }

    fn commands(&self) -> vk::CommandBuffer {
        self.lease.slot.commands
    }
}

/// Pipeline stages and their memory accesses.
type Scope = (vk::PipelineStageFlags2, vk::AccessFlags2);

const COMPUTE_WRITES: Scope = (vk::PipelineStageFlags2::COMPUTE_SHADER, vk::AccessFlags2::SHADER_STORAGE_WRITE);
const COMPUTE_READS_TEXTURE: Scope = (vk::PipelineStageFlags2::COMPUTE_SHADER, vk::AccessFlags2::SHADER_SAMPLED_READ);
const COMPUTE_USES: Scope = (
    vk::PipelineStageFlags2::COMPUTE_SHADER,
    vk::AccessFlags2::from_raw(
        vk::AccessFlags2::SHADER_STORAGE_READ.as_raw()
            | vk::AccessFlags2::SHADER_STORAGE_WRITE.as_raw()
            | vk::AccessFlags2::SHADER_SAMPLED_READ.as_raw()
            | vk::AccessFlags2::UNIFORM_READ.as_raw(),
    ),
);
const TRANSFER_WRITES: Scope = (vk::PipelineStageFlags2::ALL_TRANSFER, vk::AccessFlags2::TRANSFER_WRITE);
const TRANSFER_USES: Scope = (
    vk::PipelineStageFlags2::ALL_TRANSFER,
    vk::AccessFlags2::from_raw(vk::AccessFlags2::TRANSFER_READ.as_raw() | vk::AccessFlags2::TRANSFER_WRITE.as_raw()),
);
const HOST_READS: Scope = (vk::PipelineStageFlags2::HOST, vk::AccessFlags2::HOST_READ);
const ALL_ACCESS: vk::AccessFlags2 =
    vk::AccessFlags2::from_raw(vk::AccessFlags2::MEMORY_READ.as_raw() | vk::AccessFlags2::MEMORY_WRITE.as_raw());

fn check_source(device: &Device, buffer: &Buffer) -> Result<(), VulkanError> {
    buffer.check_use(device, vk::BufferUsageFlags::TRANSFER_SRC, "a source of copies")
}

fn check_target(device: &Device, buffer: &Buffer) -> Result<(), VulkanError> {
    buffer.check_use(device, vk::BufferUsageFlags::TRANSFER_DST, "a target of copies")
}

/// Returns an error for bytes outside `buffer` or an offset where an image copy may not start.
fn check_copy(buffer: &Buffer, offset: u64, bytes: u64, texel: u64) -> Result<(), VulkanError> {
    if !offset.is_multiple_of(texel.max(4)) {
        let mistake = format!("the offset {offset} of a copy is not a multiple of {}", texel.max(4));
        return Err(VulkanError::misuse(buffer.name(), mistake));
    }
    buffer.check_range(offset, bytes)
}

/// Place and extent of whole rows.
fn rows_of(image: &StorageImage, rows: Range<u32>) -> Result<[[u32; 2]; 2], VulkanError> {
    let [width, height] = image.extent();
    if rows.is_empty() || rows.end > height {
        let mistake = format!("rows {rows:?} are outside its {height} rows");
        return Err(VulkanError::misuse(image.name(), mistake));
    }
    Ok([[0, rows.start], [width, rows.end - rows.start]])
}

fn one_layer(layer: u32) -> vk::ImageSubresourceLayers {
    vk::ImageSubresourceLayers::default()
        .aspect_mask(vk::ImageAspectFlags::COLOR)
        .base_array_layer(layer)
        .layer_count(1)
}
