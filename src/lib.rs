//! Spectral volume rendering with post-illumination.
//!
//! A scene is marched once. The march leaves a film: per pixel, weights of the materials or the `k` coefficients of a
//! colour model, independent of the spectra of the lights. A picture under any light is a small matrix product per pixel
//! (Bergner, Möller, Drew, Finlayson: *Interactive Spectral Volume Rendering*, IEEE Visualization 2002).
//!
//! # One march, two lights
//!
//! ```no_run
//! use relume::document::{self, SceneOptions};
//! use relume::output::write_ready_png;
//! use relume::progress::Quiet;
//! use relume::render::{Renderer, SceneRenderer};
//! use relume::scene::Mix;
//! use relume::spectrum::standard;
//! use relume::vulkan::{Device, DeviceChoice, Validation};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // Scene → plan → device → film.
//! let scene = document::load("scene.toml".as_ref(), &SceneOptions::default(), &Quiet)?.scene;
//! let renderer = Renderer::new(Device::open(&DeviceChoice::Auto, Validation::Off)?);
//! let on_device = SceneRenderer::new(&renderer, scene, &Quiet)?;
//! let film = on_device.march([800, 800], &Quiet)?;
//!
//! // Film × light → picture, without another march.
//! let relight = renderer.relight_display(&film)?;
//! for name in ["D65", "A"] {
//!     let mut mix = Mix::of_scene(on_device.scene());
//!     for light in &mut mix.0 {
//!         light.spectrum = standard::light(name)?;
//!     }
//!     relight.run(&on_device.matrices(&mix))?;
//!     write_ready_png(format!("{name}.png").as_ref(), 800, 800, &relight.read::<u8>()?)?;
//! }
//! # Ok(())
//! # }
//! ```
//!
//! `examples/` has this program, and others for voxels in memory, designed metamers and film files.
//!
//! # Modules
//!
//! | to … | use |
//! | --- | --- |
//! | read or make volumes | [`volume`] |
//! | state spectra and colours | [`spectrum`] |
//! | design spectra | [`palette`] |
//! | describe a scene | [`scene`] |
//! | read a scene file, edit, save a session | [`document`] |
//! | see which features a scene needs, and why | [`plan`], [`model`] |
//! | render on a device | [`render`], [`vulkan`] |
//! | render the truth on the CPU | [`mod@reference`] |
//! | composite films, compute relight matrices | [`film`] |
//! | write pictures, read and write film files | [`output`] |
//! | see what the march reads, rounded | [`tables`] |
//! | measure time and error of settings | [`measure`] |
//! | follow or cancel long work | [`progress`] |
//!
//! [`internal`] has what else the program and its tests use; it may change in any release.

pub mod document;
pub mod film;
pub mod internal;
pub mod measure;
pub mod model;
pub mod output;
pub mod palette;
mod parallel;
pub mod plan;
pub mod progress;
pub mod reference;
pub mod render;
pub mod scene;
pub mod spectrum;
pub mod tables;
pub mod volume;
#[expect(unsafe_code, reason = "the one door to the Vulkan API")]
pub mod vulkan;
mod written;

use internal::{annotate, input, memory, number, shader};
#[cfg(feature = "window")]
use internal::{present, view};
