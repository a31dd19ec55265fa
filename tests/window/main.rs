//! The window on a virtual display.
#![cfg(feature = "window")]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod bricks;
mod scattering;
#[path = "../support/mod.rs"]
mod support;
mod view;
mod view_storm;
