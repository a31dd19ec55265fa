//! Compute pipelines.

use std::sync::Arc;

use ash::vk;

use super::{Device, VulkanError, error::check_limit, handle::Owned};
use crate::shader::{BindingKind, Shader};

/// Vulkan descriptor type of a binding.
pub(super) fn descriptor_type(kind: BindingKind) -> vk::DescriptorType {
    match kind {
        BindingKind::Storage => vk::DescriptorType::STORAGE_BUFFER,
        BindingKind::Uniform => vk::DescriptorType::UNIFORM_BUFFER,
        BindingKind::Texture => vk::DescriptorType::SAMPLED_IMAGE,
        BindingKind::Sampler => vk::DescriptorType::SAMPLER,
        BindingKind::StorageImage => vk::DescriptorType::STORAGE_IMAGE,
    }
}

/// A compute pipeline. Clones share it.
#[derive(Clone, Debug)]
pub struct ComputePipeline(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    name: String,
    bindings: Vec<BindingKind>,
    push_constant_bytes: u32,
    pipeline: Owned<vk::Pipeline>,
    layout: Owned<vk::PipelineLayout>,
    set_layout: Owned<vk::DescriptorSetLayout>,
}

impl ComputePipeline {
    /// Creates a pipeline from a compute shader.
    ///
    /// # Errors
    ///
    /// [`VulkanError::TooLarge`] for more push constants than the device has, [`VulkanError::Call`] if the driver rejects
    /// the shader.
    pub fn new(device: &Device, name: &str, shader: &Shader) -> Result<Self, VulkanError> {
        let (bindings, push_constant_bytes) = (shader.bindings(), shader.push_constant_bytes());
        let limit = device.limits().max_push_constant_bytes;
        check_limit(name, "its push constants in bytes", push_constant_bytes.into(), limit.into())?;
        let raw = device.raw();

        let info = vk::ShaderModuleCreateInfo::default().code(shader.words());
        // SAFETY: `info` borrows `shader`, which outlives the call; naga has validated the module.
        let made = unsafe { raw.functions.create_shader_module(&info, None) };
        let module = Owned::new(raw, name, "vkCreateShaderModule", made, ash::Device::destroy_shader_module)?;

        let described: Vec<_> = (0..)
            .zip(bindings)
            .map(|(binding, kind)| {
                vk::DescriptorSetLayoutBinding::default()
                    .binding(binding)
                    .descriptor_type(descriptor_type(*kind))
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
        // SAFETY: the module and the layout outlive the call, and the pipeline does not need the module afterwards.
        let made = unsafe { raw.functions.create_compute_pipelines(vk::PipelineCache::null(), &info, None) };
        // Only one pipeline was requested, so on failure there is none to destroy.
        let made = made
            .map_err(|(_, source)| source)
            .and_then(|pipelines| pipelines.first().copied().ok_or(vk::Result::ERROR_UNKNOWN));
        let pipeline = Owned::new(raw, name, "vkCreateComputePipelines", made, ash::Device::destroy_pipeline)?;

        let (name, bindings) = (name.to_owned(), bindings.to_vec());
        Ok(Self(Arc::new(Inner { name, bindings, push_constant_bytes, pipeline, layout, set_layout })))
    }

    /// Name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// Returns an error if `bindings` or `push_constants` do not match the shader.
    pub(super) fn check_dispatch(&self, bindings: &[BindingKind], push_constants: &[u8]) -> Result<(), VulkanError> {
        self.check_bindings(bindings)?;
        if push_constants.len() as u64 != u64::from(self.0.push_constant_bytes) {
            let (given, expected) = (push_constants.len(), self.0.push_constant_bytes);
            let mistake = format!("it has {given} bytes of push constants, and expects {expected}");
            return Err(VulkanError::misuse(&self.0.name, mistake));
        }
        Ok(())
    }

    /// Returns an error if `bindings` do not match the shader.
    pub(super) fn check_bindings(&self, bindings: &[BindingKind]) -> Result<(), VulkanError> {
        if bindings != self.0.bindings {
            let mistake = format!("it has the bindings {bindings:?}, and expects {:?}", self.0.bindings);
            return Err(VulkanError::misuse(&self.0.name, mistake));
        }
        Ok(())
    }

    pub(super) fn check_device(&self, device: &Device) -> Result<(), VulkanError> {
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

    pub(super) fn set_layout(&self) -> vk::DescriptorSetLayout {
        self.0.set_layout.raw()
    }

    /// A reference that keeps the pipeline alive.
    pub(super) fn keep(&self) -> Arc<dyn Send + Sync> {
        Arc::clone(&self.0) as _
    }
}
