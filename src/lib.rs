//! Spectral volume rendering with post-illumination.

pub mod input;
pub mod measure;
pub mod memory;
pub mod model;
pub mod number;
pub mod output;
pub mod palette;
pub mod plan;
pub mod progress;
pub mod reference;
pub mod render;
pub mod scene;
pub mod shader;
pub mod spectrum;
pub mod tables;
pub mod view;
pub mod volume;
#[expect(unsafe_code, reason = "the one door to the Vulkan API")]
pub mod vulkan;
mod written;
