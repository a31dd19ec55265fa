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
//! Each has a crate of its own below `src/`. Hidden modules are what else the program and its tests use; they may change in any release.

#[doc(hidden)]
pub mod cli;
#[doc(hidden)]
pub mod live;
#[doc(hidden)]
pub mod ranks;
#[doc(hidden)]
pub mod view;

pub use relume_base::progress;
#[doc(hidden)]
pub use relume_base::{input, memory, number, parallel};
#[doc(hidden)]
pub use relume_colour::written;
pub use relume_colour::{model, palette, spectrum};
pub use relume_document as document;
#[doc(hidden)]
pub use relume_document::annotate;
pub use relume_document::output;
pub use relume_measure as measure;
pub use relume_render as render;
pub use relume_scene as scene;
pub use relume_scene::{film, plan, reference, tables};
pub use relume_volume as volume;
pub use relume_vulkan as vulkan;
#[cfg(feature = "window")]
#[doc(hidden)]
pub use relume_vulkan::present;
#[doc(hidden)]
pub use relume_vulkan::shader;
