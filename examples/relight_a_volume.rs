//! Marches the built-in scene once and writes pictures of it under several lights: `relight_a_volume [FOLDER]`.
#![expect(clippy::print_stdout, reason = "an example prints its result")]

use std::error::Error;
use std::path::PathBuf;

use relume::document::{SceneOptions, load_embedded};
use relume::output::write_ready_png;
use relume::progress::Quiet;
use relume::render::{Renderer, SceneRenderer};
use relume::scene::Mix;
use relume::spectrum::standard::light;
use relume::vulkan::{Device, DeviceChoice, Validation};

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(std::env::args_os().nth(1).unwrap_or_else(|| ".".into()));
    let size = [200, 200];

    // Scene → plan → device → film.
    let scene = load_embedded(&SceneOptions::default(), &Quiet)?.scene;
    let renderer = Renderer::new(Device::open(&DeviceChoice::Auto, Validation::Off)?);
    let on_device = SceneRenderer::new(&renderer, scene, &Quiet)?;
    let film = on_device.march(size, &Quiet)?;

    // Film × light → picture, repeated for every light.
    let relight = renderer.relight_display(&film)?;
    for name in ["D65", "A", "FL11"] {
        let mut mix = Mix::of_scene(on_device.scene());
        for one in &mut mix.0 {
            one.spectrum = light(name)?;
        }
        relight.run(&on_device.matrices(&mix))?;
        let rgba: Vec<u8> = relight.read()?;
        let path = folder.join(format!("{name}.png"));
        write_ready_png(&path, size[0], size[1], &rgba)?;
        println!("{}: {} marches so far", path.display(), renderer.marches());
    }
    Ok(())
}
