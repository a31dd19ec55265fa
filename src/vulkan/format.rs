//! Texel formats and usages of images.

use ash::vk;

/// Usage of a 3D image.
pub(super) const SAMPLED_USAGE: vk::ImageUsageFlags =
    vk::ImageUsageFlags::from_raw(vk::ImageUsageFlags::SAMPLED.as_raw() | vk::ImageUsageFlags::TRANSFER_DST.as_raw());

/// Usage of a storage image.
pub(super) const STORAGE_USAGE: vk::ImageUsageFlags = vk::ImageUsageFlags::from_raw(
    vk::ImageUsageFlags::STORAGE.as_raw()
        | vk::ImageUsageFlags::TRANSFER_SRC.as_raw()
        | vk::ImageUsageFlags::TRANSFER_DST.as_raw(),
);

/// Texel format, and the value that a shader reads from it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Format {
    /// One 16-bit number; 0..=65535 is read as 0..=1.
    R16Unorm,
    /// One f32.
    R32Float,
    /// Four 16-bit numbers; −32767..=32767 is read as −1..=1 (−32768 is also −1). 0 is exactly 0.
    Rgba16Snorm,
    /// Four 16-bit numbers; 0..=65535 is read as 0..=1.
    Rgba16Unorm,
    /// Four 16-bit floats.
    Rgba16Float,
    /// Four f32.
    Rgba32Float,
    /// Four bytes; 0..=255 is read as 0..=1.
    Rgba8Unorm,
    /// Four bytes that shaders write as [`Self::Rgba8Unorm`] and commands read as blue, green, red, alpha: the format
    /// of window images.
    Bgra8Unorm,
    /// One byte, read as an unsigned integer; never filtered.
    R8Uint,
    /// One 16-bit unsigned integer; never filtered.
    R16Uint,
    /// One 32-bit unsigned integer; never filtered.
    R32Uint,
}

impl Format {
    /// All formats, in declaration order.
    pub const ALL: [Self; 11] = [
        Self::R16Unorm,
        Self::R32Float,
        Self::Rgba16Snorm,
        Self::Rgba16Unorm,
        Self::Rgba16Float,
        Self::Rgba32Float,
        Self::Rgba8Unorm,
        Self::Bgra8Unorm,
        Self::R8Uint,
        Self::R16Uint,
        Self::R32Uint,
    ];

    /// Bytes per texel.
    #[must_use]
    pub const fn texel_bytes(self) -> u32 {
        match self {
            Self::R8Uint => 1,
            Self::R16Unorm | Self::R16Uint => 2,
            Self::R32Float | Self::R32Uint | Self::Rgba8Unorm | Self::Bgra8Unorm => 4,
            Self::Rgba16Snorm | Self::Rgba16Unorm | Self::Rgba16Float => 8,
            Self::Rgba32Float => 16,
        }
    }

    /// Whether shaders read unsigned integers from this format.
    pub(super) const fn is_uint(self) -> bool {
        matches!(self, Self::R8Uint | Self::R16Uint | Self::R32Uint)
    }

    /// Vulkan format.
    pub(crate) const fn raw(self) -> vk::Format {
        match self {
            Self::R16Unorm => vk::Format::R16_UNORM,
            Self::R32Float => vk::Format::R32_SFLOAT,
            Self::Rgba16Snorm => vk::Format::R16G16B16A16_SNORM,
            Self::Rgba16Unorm => vk::Format::R16G16B16A16_UNORM,
            Self::Rgba16Float => vk::Format::R16G16B16A16_SFLOAT,
            Self::Rgba32Float => vk::Format::R32G32B32A32_SFLOAT,
            Self::Rgba8Unorm => vk::Format::R8G8B8A8_UNORM,
            Self::Bgra8Unorm => vk::Format::B8G8R8A8_UNORM,
            Self::R8Uint => vk::Format::R8_UINT,
            Self::R16Uint => vk::Format::R16_UINT,
            Self::R32Uint => vk::Format::R32_UINT,
        }
    }

    /// Format of the view that shaders use.
    pub(super) const fn viewed(self) -> vk::Format {
        match self {
            Self::Bgra8Unorm => Self::Rgba8Unorm.raw(),
            format => format.raw(),
        }
    }

    /// Image creation flags that [`Self::viewed`] requires.
    pub(super) const fn flags(self) -> vk::ImageCreateFlags {
        match self {
            Self::Bgra8Unorm => vk::ImageCreateFlags::from_raw(
                vk::ImageCreateFlags::MUTABLE_FORMAT.as_raw() | vk::ImageCreateFlags::EXTENDED_USAGE.as_raw(),
            ),
            _ => vk::ImageCreateFlags::empty(),
        }
    }
}
