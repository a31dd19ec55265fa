//! Spectra and what is computed with them alone: colours, colour models of few numbers with their error, and palettes of lights and
//! materials that merge, vanish or keep their colour. No volume, no device.
#![forbid(unsafe_code)]

pub mod model;
pub mod palette;
pub mod spectrum;
pub mod written;
