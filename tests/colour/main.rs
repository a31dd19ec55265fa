//! Spectra, colour models and palettes on the host.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod colour;
mod dial;
mod models;
mod observer;
mod palette;
mod palette_pictures;
mod spectrum;
#[path = "../support/mod.rs"]
mod support;
mod tone;
