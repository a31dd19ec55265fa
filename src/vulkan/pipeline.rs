//! Compute pipelines, and the resources a dispatch reads and writes.

use std::sync::Arc;

use ash::vk;

use super::{Buffer, Device, Image3d, Sampler, StorageImage, VulkanError, error::check_limit, handle::Owned, image};

/// What a shader expects at a binding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BindingKind {
    /// `var<storage>`
    Storage,
    /// `var<uniform>`
    Uniform,
    /// `texture_3d`
    Texture,
    /// `sampler`
    Sampler,
    /// `texture_storage_2d_array`
    StorageImage,
}

impl BindingKind {
    fn raw(self) -> vk::DescriptorType {
        match self {
            Self::Storage => vk::DescriptorType::STORAGE_BUFFER,
            Self::Uniform => vk::DescriptorType::UNIFORM_BUFFER,
            Self::Texture => vk::DescriptorType::SAMPLED_IMAGE,
            Self::Sampler => vk::DescriptorType::SAMPLER,
            Self::StorageImage => vk::DescriptorType::STORAGE_IMAGE,
        }
    }
}

/// A compute shader, ready to be dispatched. Clones are the same pipeline.
#[derive(Clone, Debug)]
pub struct ComputePipeline(Arc<PipelineInner>);

#[derive(Debug)]
struct PipelineInner {
    name: String,
    bindings: Vec<BindingKind>,
    push_constant_bytes: u32,
    pipeline: Owned<vk::Pipeline>,
    layout: Owned<vk::PipelineLayout>,
    set_layout: Owned<vk::DescriptorSetLayout>,
}

impl ComputePipeline {
    /// The pipeline of the compute shader `spirv`, whose entry point is `main`.
    ///
    /// `spirv` comes from naga, which has validated it. `bindings` are what it expects at bindings 0, 1, … of group 0,
    /// and `push_constant_bytes` (a multiple of 4, possibly 0) is the size of its `var<immediate>`.
    ///
    /// # Errors
    ///
    /// [`VulkanError::TooLarge`] for more push constants than the device has, [`VulkanError::Misuse`] for a number of
    /// bytes that is no multiple of 4, [`VulkanError::Call`] when the driver refuses the shader.
    pub fn new(
        device: &Device,
        name: &str,
        spirv: &[u32],
        bindings: &[BindingKind],
        push_constant_bytes: u32,
    ) -> Result<Self, VulkanError> {
        let limit = device.limits().max_push_constant_bytes;
        check_limit(name, "its push constants in bytes", push_constant_bytes.into(), limit.into())?;
        if !push_constant_bytes.is_multiple_of(4) {
            let mistake = format!("{push_constant_bytes} bytes of push constants are no multiple of 4");
            return Err(VulkanError::misuse(name, mistake));
        }
        let raw = device.raw();

        let info = vk::ShaderModuleCreateInfo::default().code(spirv);
        // SAFETY: `info` borrows `spirv`, which outlives the call; naga has validated the module.
        let made = unsafe { raw.functions.create_shader_module(&info, None) };
        let module = Owned::new(raw, name, "vkCreateShaderModule", made, ash::Device::destroy_shader_module)?;

        let described: Vec<_> = (0..)
            .zip(bindings)
            .map(|(binding, kind)| {
                vk::DescriptorSetLayoutBinding::default()
                    .binding(binding)
                    .descriptor_type(kind.raw())
                    .descriptor_count(1)
                    .stage_flags(vk::ShaderStageFlags::COMPUTE)
            })
            .collect();
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&described);
        // SAFETY: `info` borrows `described`, which outlives the call and has each binding number once.
        let made = unsafe { raw.functions.create_descriptor_set_layout(&info, None) };
        let destroy = ash::Device::destroy_descriptor_set_layout;
        let set_layout = Owned::new(raw, name, "vkCreateDescriptorSetLayout", made, destroy)?;

        let set_layouts = [set_layout.raw()];
        let constants =
            [vk::PushConstantRange::default().stage_flags(vk::ShaderStageFlags::COMPUTE).size(push_constant_bytes)];
        let constants = if push_constant_bytes == 0 { &[] } else { constants.as_slice() };
        let info = vk::PipelineLayoutCreateInfo::default().set_layouts(&set_layouts).push_constant_ranges(constants);
        // SAFETY: `info` borrows arrays that outlive the call; the push constants fit the device, as checked above.
        let made = unsafe { raw.functions.create_pipeline_layout(&info, None) };
        let layout = Owned::new(raw, name, "vkCreatePipelineLayout", made, ash::Device::destroy_pipeline_layout)?;

        let stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(module.raw())
            .name(c"main");
        let info = [vk::ComputePipelineCreateInfo::default().stage(stage).layout(layout.raw())];
        // SAFETY: the module and the layout live past the call, which needs the module no longer than that.
        let made = unsafe { raw.functions.create_compute_pipelines(vk::PipelineCache::null(), &info, None) };
        // One pipeline was asked for: on failure there is none to destroy.
        let made = made
            .map_err(|(_, source)| source)
            .and_then(|pipelines| pipelines.first().copied().ok_or(vk::Result::ERROR_UNKNOWN));
        let pipeline = Owned::new(raw, name, "vkCreateComputePipelines", made, ash::Device::destroy_pipeline)?;

        let (name, bindings) = (name.to_owned(), bindings.to_vec());
        Ok(Self(Arc::new(PipelineInner { name, bindings, push_constant_bytes, pipeline, layout, set_layout })))
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// Refuses a dispatch on `device` with resources or push constants that the shader does not expect.
    pub(super) fn check_dispatch(
        &self,
        device: &Device,
        set: &ResourceSet,
        push_constants: &[u8],
    ) -> Result<(), VulkanError> {
        self.check_device(device)?;
        if set.0.bindings != self.0.bindings {
            let mistake = format!("resources {:?}, and it expects {:?}", set.0.bindings, self.0.bindings);
            return Err(VulkanError::misuse(&self.0.name, mistake));
        }
        if push_constants.len() as u64 != u64::from(self.0.push_constant_bytes) {
            let (given, expected) = (push_constants.len(), self.0.push_constant_bytes);
            let mistake = format!("{given} bytes of push constants, and it expects {expected}");
            return Err(VulkanError::misuse(&self.0.name, mistake));
        }
        if !set.0.pool.is_on(device.raw()) {
            return Err(VulkanError::misuse(&set.0.name, "it belongs to another device"));
        }
        Ok(())
    }

    fn check_device(&self, device: &Device) -> Result<(), VulkanError> {
        if !self.0.pipeline.is_on(device.raw()) {
            return Err(VulkanError::misuse(&self.0.name, "it belongs to another device"));
        }
        Ok(())
    }

    pub(super) fn raw(&self) -> vk::Pipeline {
        self.0.pipeline.raw()
    }

    pub(super) fn layout(&self) -> vk::PipelineLayout {
        self.0.layout.raw()
    }

    /// What keeps it alive.
    pub(super) fn keep(&self) -> Arc<dyn Send + Sync> {
        Arc::clone(&self.0) as _
    }
}

/// Something that a shader reads or writes.
#[derive(Clone, Copy, Debug)]
pub enum Resource<'a> {
    /// A buffer as `var<storage>`.
    Storage(&'a Buffer),
    /// A buffer as `var<uniform>`.
    Uniform(&'a Buffer),
    /// An image as `texture_3d`.
    Texture(&'a Image3d),
    /// A `sampler`.
    Sampler(&'a Sampler),
    /// An image as `texture_storage_2d_array`.
    StorageImage(&'a StorageImage),
}

impl Resource<'_> {
    fn kind(&self) -> BindingKind {
        match self {
            Self::Storage(_) => BindingKind::Storage,
            Self::Uniform(_) => BindingKind::Uniform,
            Self::Texture(_) => BindingKind::Texture,
            Self::Sampler(_) => BindingKind::Sampler,
            Self::StorageImage(_) => BindingKind::StorageImage,
        }
    }

    fn check_use(&self, device: &Device) -> Result<(), VulkanError> {
        match self {
            Self::Storage(buffer) => buffer.check_use(device, vk::BufferUsageFlags::STORAGE_BUFFER, "a storage buffer"),
            Self::Uniform(buffer) => buffer.check_use(device, vk::BufferUsageFlags::UNIFORM_BUFFER, "a uniform buffer"),
            Self::Texture(image) => image.check_device(device),
            Self::Sampler(sampler) => sampler.check_device(device),
            Self::StorageImage(image) => image.check_device(device),
        }
    }

    fn buffer_info(&self) -> vk::DescriptorBufferInfo {
        let info = vk::DescriptorBufferInfo::default().range(vk::WHOLE_SIZE);
        match self {
            Self::Storage(buffer) | Self::Uniform(buffer) => info.buffer(buffer.raw()),
            _ => info,
        }
    }

    fn image_info(&self) -> vk::DescriptorImageInfo {
        let info = vk::DescriptorImageInfo::default();
        match self {
            Self::Texture(image) => info.image_view(image.view()).image_layout(image::SAMPLED_LAYOUT),
            Self::StorageImage(image) => info.image_view(image.view()).image_layout(image::STORAGE_LAYOUT),
            Self::Sampler(sampler) => info.sampler(sampler.raw()),
            _ => info,
        }
    }
}

/// Resources at the bindings of a pipeline. It keeps them alive. Clones are the same set.
#[derive(Clone, Debug)]
pub struct ResourceSet(Arc<SetInner>);

struct SetInner {
    name: String,
    bindings: Vec<BindingKind>,
    set: vk::DescriptorSet,
    /// Owns `set`.
    pool: Owned<vk::DescriptorPool>,
    buffers: Vec<Buffer>,
    /// The pipeline (whose layout the set has), images and samplers.
    _others: Vec<Arc<dyn Send + Sync>>,
}

impl std::fmt::Debug for SetInner {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("SetInner").field("name", &self.name).field("bindings", &self.bindings).finish()
    }
}

impl ResourceSet {
    /// `resources` for bindings 0, 1, … of `pipeline`, and of every pipeline with the same list of bindings.
    ///
    /// # Errors
    ///
    /// [`VulkanError::Misuse`] when a resource is not what the pipeline expects at its place, was not made for that
    /// use, or belongs to another device.
    pub fn new(
        device: &Device,
        name: &str,
        pipeline: &ComputePipeline,
        resources: &[Resource<'_>],
    ) -> Result<Self, VulkanError> {
        let bindings: Vec<_> = resources.iter().map(Resource::kind).collect();
        if bindings != pipeline.0.bindings {
            let mistake =
                format!("resources {bindings:?}, and {:?} expects {:?}", pipeline.name(), pipeline.0.bindings);
            return Err(VulkanError::misuse(name, mistake));
        }
        pipeline.check_device(device)?;
        for resource in resources {
            resource.check_use(device)?;
        }
        let raw = device.raw();

        let sizes: Vec<_> =
            bindings.iter().map(|kind| vk::DescriptorPoolSize::default().ty(kind.raw()).descriptor_count(1)).collect();
        let info = vk::DescriptorPoolCreateInfo::default().max_sets(1).pool_sizes(&sizes);
        // SAFETY: `info` borrows `sizes`, which outlives the call.
        let made = unsafe { raw.functions.create_descriptor_pool(&info, None) };
        let pool = Owned::new(raw, name, "vkCreateDescriptorPool", made, ash::Device::destroy_descriptor_pool)?;

        let layouts = [pipeline.0.set_layout.raw()];
        let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(pool.raw()).set_layouts(&layouts);
        // SAFETY: the pool is new, nobody else uses it, and it has room for just this set.
        let made = unsafe { raw.functions.allocate_descriptor_sets(&info) };
        let set = made
            .and_then(|sets| sets.first().copied().ok_or(vk::Result::ERROR_UNKNOWN))
            .map_err(VulkanError::call("vkAllocateDescriptorSets", name))?;
        raw.set_name(set, name);

        let buffer_infos: Vec<_> = resources.iter().map(|resource| [resource.buffer_info()]).collect();
        let image_infos: Vec<_> = resources.iter().map(|resource| [resource.image_info()]).collect();
        let writes: Vec<_> = (0..)
            .zip(&bindings)
            .zip(buffer_infos.iter().zip(&image_infos))
            .map(|((binding, kind), (buffer, image))| {
                let write =
                    vk::WriteDescriptorSet::default().dst_set(set).dst_binding(binding).descriptor_type(kind.raw());
                match kind {
                    BindingKind::Storage | BindingKind::Uniform => write.buffer_info(buffer),
                    BindingKind::Texture | BindingKind::Sampler | BindingKind::StorageImage => write.image_info(image),
                }
            })
            .collect();
        // SAFETY: the set is new, so no submission uses it; the writes borrow arrays that outlive the call and name
        // live handles of this device, made for this use, which the new set keeps alive.
        unsafe { raw.functions.update_descriptor_sets(&writes, &[]) };

        let mut buffers = Vec::new();
        let mut others = vec![pipeline.keep()];
        for resource in resources {
            match *resource {
                Resource::Storage(buffer) | Resource::Uniform(buffer) => buffers.push(buffer.clone()),
                Resource::Texture(image) => others.push(Arc::new(image.clone())),
                Resource::Sampler(sampler) => others.push(Arc::new(sampler.clone())),
                Resource::StorageImage(image) => others.push(Arc::new(image.clone())),
            }
        }
        Ok(Self(Arc::new(SetInner { name: name.to_owned(), bindings, set, pool, buffers, _others: others })))
    }

    pub(super) fn raw(&self) -> vk::DescriptorSet {
        self.0.set
    }

    pub(super) fn buffers(&self) -> &[Buffer] {
        &self.0.buffers
    }

    /// What keeps it alive.
    pub(super) fn keep(&self) -> Arc<dyn Send + Sync> {
        Arc::clone(&self.0) as _
    }
}
