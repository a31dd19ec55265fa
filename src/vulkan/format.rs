//! The texel formats that images may have.

use ash::vk;

/// What a texel holds, and what a shader reads from it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Format {
    /// One 16-bit number, 0..=65535 read as 0..=1.
    R16Unorm,
    /// One f32.
    R32Float,
    /// Four 16-bit numbers, −32767..=32767 read as −1..=1 (−32768 too is −1); 0 is exactly 0.
    Rgba16Snorm,
    /// Four 16-bit floats.
    Rgba16Float,
    /// Four f32.
    Rgba32Float,
    /// Four bytes, 0..=255 read as 0..=1.
    Rgba8Unorm,
    /// The same four bytes, which a shader writes as those, and which commands take for blue, green, red and alpha: a window's.
    Bgra8Unorm,
    /// One byte, read as an unsigned integer; never filtered.
    R8Uint,
    /// One 16-bit unsigned integer; never filtered.
    R16Uint,
    /// One 32-bit unsigned integer; never filtered.
    R32Uint,
}

impl Format {
    /// Every format, in the order of declaration.
    pub const ALL: [Self; 10] = [
        Self::R16Unorm,
        Self::R32Float,
        Self::Rgba16Snorm,
        Self::Rgba16Float,
        Self::Rgba32Float,
        Self::Rgba8Unorm,
        Self::Bgra8Unorm,
        Self::R8Uint,
        Self::R16Uint,
        Self::R32Uint,
    ];

    /// Bytes of a texel.
    #[must_use]
    pub const fn texel_bytes(self) -> u32 {
        match self {
            Self::R8Uint => 1,
            Self::R16Unorm | Self::R16Uint => 2,
            Self::R32Float | Self::R32Uint | Self::Rgba8Unorm | Self::Bgra8Unorm => 4,
            Self::Rgba16Snorm | Self::Rgba16Float => 8,
            Self::Rgba32Float => 16,
        }
    }

    /// Whether a shader reads unsigned integers from it.
    pub(super) const fn is_uint(self) -> bool {
        matches!(self, Self::R8Uint | Self::R16Uint | Self::R32Uint)
    }

    /// Vulkan's name for it.
    pub(super) const fn raw(self) -> vk::Format {
        match self {
            Self::R16Unorm => vk::Format::R16_UNORM,
            Self::R32Float => vk::Format::R32_SFLOAT,
            Self::Rgba16Snorm => vk::Format::R16G16B16A16_SNORM,
            Self::Rgba16Float => vk::Format::R16G16B16A16_SFLOAT,
            Self::Rgba32Float => vk::Format::R32G32B32A32_SFLOAT,
            Self::Rgba8Unorm => vk::Format::R8G8B8A8_UNORM,
            Self::Bgra8Unorm => vk::Format::B8G8R8A8_UNORM,
            Self::R8Uint => vk::Format::R8_UINT,
            Self::R16Uint => vk::Format::R16_UINT,
            Self::R32Uint => vk::Format::R32_UINT,
        }
    }

    /// What shaders see it as.
    pub(super) const fn viewed(self) -> vk::Format {
        match self {
            Self::Bgra8Unorm => Self::Rgba8Unorm.raw(),
            format => format.raw(),
        }
    }

    /// What an image must allow for that.
    pub(super) const fn flags(self) -> vk::ImageCreateFlags {
        match self {
            Self::Bgra8Unorm => vk::ImageCreateFlags::from_raw(
                vk::ImageCreateFlags::MUTABLE_FORMAT.as_raw() | vk::ImageCreateFlags::EXTENDED_USAGE.as_raw(),
            ),
            _ => vk::ImageCreateFlags::empty(),
        }
    }
}
