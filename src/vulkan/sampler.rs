//! Samplers.

use std::sync::Arc;

use ash::vk;

use super::{Device, VulkanError, handle::Owned};

/// Interpolation between texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filter {
    /// The nearest texel.
    Nearest,
    /// Linear interpolation. The format must support it ([`super::Limits::linear_filter`]).
    Linear,
}

/// Sampler for an [`super::Image3d`]: coordinates 0..1 over the image, clamped to the edge texels outside.
#[derive(Clone, Debug)]
pub struct Sampler(Arc<(String, Owned<vk::Sampler>)>);

impl Sampler {
    /// Creates a sampler with `filter`.
    ///
    /// # Errors
    ///
    /// [`VulkanError::Call`] when the device has no room for one.
    pub fn new(device: &Device, name: &str, filter: Filter) -> Result<Self, VulkanError> {
        let filter = match filter {
            Filter::Nearest => vk::Filter::NEAREST,
            Filter::Linear => vk::Filter::LINEAR,
        };
        let edge = vk::SamplerAddressMode::CLAMP_TO_EDGE;
        let info = vk::SamplerCreateInfo::default()
            .mag_filter(filter)
            .min_filter(filter)
            .address_mode_u(edge)
            .address_mode_v(edge)
            .address_mode_w(edge);
        // SAFETY: `info` uses nothing that requires a feature.
        let made = unsafe { device.raw().functions.create_sampler(&info, None) };
        let handle = Owned::new(device.raw(), name, "vkCreateSampler", made, ash::Device::destroy_sampler)?;
        Ok(Self(Arc::new((name.to_owned(), handle))))
    }

    pub(super) fn check_device(&self, device: &Device) -> Result<(), VulkanError> {
        if !self.0.1.is_on(device.raw()) {
            return Err(VulkanError::misuse(&self.0.0, "it belongs to another device"));
        }
        Ok(())
    }

    pub(super) fn raw(&self) -> vk::Sampler {
        self.0.1.raw()
    }
}
