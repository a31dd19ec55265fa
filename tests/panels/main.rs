//! Actions of the viewer's panels and their effect on the document, without a window or a GPU.
#![cfg(feature = "window")]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod accuracy;
mod annotations;
mod app;
mod camera;
mod chooser;
mod clip;
mod crop;
mod dial;
mod dial_presets;
mod docks;
mod document;
mod fields;
mod layout;
mod lights;
mod notices;
mod numbers;
mod palette;
mod probe;
mod slices;
mod spectra;
#[path = "../support/mod.rs"]
mod support;
mod tour;
mod transfer;
