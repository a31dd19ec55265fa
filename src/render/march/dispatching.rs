//! Division of a march into workgroups and dispatches, and the memory of its tables.

use crate::pool::Residence;
use relume_vulkan::{Device, DeviceKind};

/// Largest number of samples along a ray per dispatch.
pub(crate) const SLICE: u32 = 16_384;

/// Division of a march into workgroups and dispatches. It affects time only: accumulators are the same to the byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Dispatching {
    /// Pixels of a workgroup, across and down.
    pub group: [u32; 2],
    /// Largest number of samples per dispatch, unless the smallest part of one row of workgroups has more; `None` aims
    /// at about 50 ms.
    pub samples: Option<u32>,
    /// Largest number of samples along a ray per dispatch, 1 to 16,384.
    pub slice: u32,
    /// Memory of the tables, if they fit there.
    pub tables: TableMemory,
    /// True if a block of the volume is marched; a march sets it.
    pub block: bool,
    /// Residence of the volume; a march sets it.
    pub residence: Residence,
    /// Runner of the shader.
    pub target: Target,
}

/// Runner of the shader of a march.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// A Vulkan device, with the film in storage images.
    Device,
    /// WebGPU in a browser, with the film in storage buffers.
    Browser {
        /// Whether its devices filter the texels of values; others are fetched and mixed by the shader.
        filters: bool,
    },
}

/// Memory of the tables of the transfer function and of the labels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TableMemory {
    /// Storage buffers of any length. The lanes of a GPU read different entries at once.
    Storage,
    /// Uniform buffers of 64 KiB; longer tables stay in storage buffers. Lavapipe reads storage lane by lane with a
    /// branch for each, and uniforms without branches. A GPU would read the entries of its lanes one after the other.
    Uniform,
}

impl TableMemory {
    /// The memory with the fastest march on `device`.
    pub(crate) fn fastest(device: &Device) -> Self {
        if device.info().kind == DeviceKind::Software { Self::Uniform } else { Self::Storage }
    }
}

impl Default for Dispatching {
    fn default() -> Self {
        // Lavapipe's lanes are eight neighbours in x.
        Self {
            group: [8, 8],
            samples: None,
            slice: SLICE,
            tables: TableMemory::Storage,
            block: false,
            residence: Residence::Whole,
            target: Target::Device,
        }
    }
}
