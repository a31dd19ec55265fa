//! Resources of a dispatch.

use std::sync::Arc;

use ash::vk;

use super::{
    Buffer, ComputePipeline, Device, Image3d, Sampler, StorageImage, VulkanError, handle::Owned, image,
    pipeline::descriptor_type,
};
use crate::shader::BindingKind;

/// A resource that a shader reads or writes.
#[derive(Clone, Copy, Debug)]
pub enum Resource<'a> {
    /// A buffer as `var<storage>`.
    Storage(&'a Buffer),
    /// A buffer as `var<uniform>`.
    Uniform(&'a Buffer),
    /// An image as `texture_3d`.
    Texture(&'a Image3d),
    /// An image as `texture_storage_3d`.
    StorageTexture(&'a Image3d),
    /// A `sampler`.
    Sampler(&'a Sampler),
    /// An image as `texture_storage_2d_array`.
    StorageImage(&'a StorageImage),
}

impl Resource<'_> {
    /// Kind of binding that the resource fits.
    #[must_use]
    pub fn kind(&self) -> BindingKind {
        match self {
            Self::Storage(_) => BindingKind::Storage,
            Self::Uniform(_) => BindingKind::Uniform,
            Self::Texture(_) => BindingKind::Texture,
            Self::Sampler(_) => BindingKind::Sampler,
            Self::StorageImage(_) | Self::StorageTexture(_) => BindingKind::StorageImage,
        }
    }

    fn check_use(&self, device: &Device) -> Result<(), VulkanError> {
        match self {
            Self::Storage(buffer) => buffer.check_use(device, vk::BufferUsageFlags::STORAGE_BUFFER, "a storage buffer"),
            Self::Uniform(buffer) => buffer.check_use(device, vk::BufferUsageFlags::UNIFORM_BUFFER, "a uniform buffer"),
            Self::Texture(image) | Self::StorageTexture(image) => image.check_device(device),
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
            Self::Texture(image) | Self::StorageTexture(image) => {
                info.image_view(image.view()).image_layout(image.layout())
            }
            Self::StorageImage(image) => info.image_view(image.view()).image_layout(image::STORAGE_LAYOUT),
            Self::Sampler(sampler) => info.sampler(sampler.raw()),
            _ => info,
        }
    }
}

/// Resources bound to a pipeline. The set keeps them alive. Clones share it.
#[derive(Clone, Debug)]
pub struct ResourceSet(Arc<Inner>);

struct Inner {
    name: String,
    bindings: Vec<BindingKind>,
    set: vk::DescriptorSet,
    /// Owner of `set`.
    pool: Owned<vk::DescriptorPool>,
    buffers: Vec<Buffer>,
    /// The pipeline (whose layout the set uses), images and samplers.
    _others: Vec<Arc<dyn Send + Sync>>,
}

impl std::fmt::Debug for Inner {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Inner").field("name", &self.name).field("bindings", &self.bindings).finish()
    }
}

impl ResourceSet {
    /// Binds `resources` to bindings 0, 1, … of `pipeline`. The set also fits every pipeline with the same bindings.
    ///
    /// # Errors
    ///
    /// [`VulkanError::Misuse`] if a resource does not match the pipeline's binding, was not made for that use, or
    /// belongs to another device.
    pub fn new(
        device: &Device,
        name: &str,
        pipeline: &ComputePipeline,
        resources: &[Resource<'_>],
    ) -> Result<Self, VulkanError> {
        let bindings: Vec<_> = resources.iter().map(Resource::kind).collect();
        pipeline.check_device(device)?;
        pipeline.check_bindings(&bindings)?;
        for resource in resources {
            resource.check_use(device)?;
        }
        let raw = device.raw();

        let sizes: Vec<_> = bindings
            .iter()
            .map(|kind| vk::DescriptorPoolSize::default().ty(descriptor_type(*kind)).descriptor_count(1))
            .collect();
        let info = vk::DescriptorPoolCreateInfo::default().max_sets(1).pool_sizes(&sizes);
        // SAFETY: `info` borrows `sizes`, which outlives the call.
        let made = unsafe { raw.functions.create_descriptor_pool(&info, None) };
        let pool = Owned::new(raw, name, "vkCreateDescriptorPool", made, ash::Device::destroy_descriptor_pool)?;

        let layouts = [pipeline.set_layout()];
        let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(pool.raw()).set_layouts(&layouts);
        // SAFETY: the pool is new and not shared, and has room for exactly this set.
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
                let write = vk::WriteDescriptorSet::default()
                    .dst_set(set)
                    .dst_binding(binding)
                    .descriptor_type(descriptor_type(*kind));
                match kind {
                    BindingKind::Storage | BindingKind::Uniform => write.buffer_info(buffer),
                    BindingKind::Texture | BindingKind::Sampler | BindingKind::StorageImage => write.image_info(image),
                }
            })
            .collect();
        // SAFETY: the set is new, so no submission uses it. The writes borrow arrays that outlive the call, and name
        // live handles of this device, made for this use, which the new set keeps alive.
        unsafe { raw.functions.update_descriptor_sets(&writes, &[]) };

        let mut buffers = Vec::new();
        let mut others = vec![pipeline.keep()];
        for resource in resources {
            match *resource {
                Resource::Storage(buffer) | Resource::Uniform(buffer) => buffers.push(buffer.clone()),
                Resource::Texture(image) | Resource::StorageTexture(image) => others.push(Arc::new(image.clone())),
                Resource::Sampler(sampler) => others.push(Arc::new(sampler.clone())),
                Resource::StorageImage(image) => others.push(Arc::new(image.clone())),
            }
        }
        Ok(Self(Arc::new(Inner { name: name.to_owned(), bindings, set, pool, buffers, _others: others })))
    }

    pub(super) fn raw(&self) -> vk::DescriptorSet {
        self.0.set
    }

    pub(super) fn bindings(&self) -> &[BindingKind] {
        &self.0.bindings
    }

    pub(super) fn check_device(&self, device: &Device) -> Result<(), VulkanError> {
        if !self.0.pool.is_on(device.raw()) {
            return Err(VulkanError::misuse(&self.0.name, "it belongs to another device"));
        }
        Ok(())
    }

    pub(super) fn buffers(&self) -> &[Buffer] {
        &self.0.buffers
    }

    /// A reference that keeps the set alive.
    pub(super) fn keep(&self) -> Arc<dyn Send + Sync> {
        Arc::clone(&self.0) as _
    }
}
