//! Pictures of every scene, on the host and on a device.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod blocks;
mod bricks;
mod clip;
mod coloured_shadows;
mod extremes;
mod fields;
mod films;
mod harness;
mod interpolation;
mod labels;
mod ladder;
mod matrix;
mod peercy;
mod phases;
mod placed;
mod plan;
mod probe;
mod properties;
mod ranks;
mod rays;
mod refined;
mod scattering;
mod scenes;
mod segments;
mod shader;
mod shadows;
mod spectral;
mod stability;
mod store;
#[path = "../support/mod.rs"]
mod support;
mod texture;
