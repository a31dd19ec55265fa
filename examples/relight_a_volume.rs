//! Marches the built-in scene once and writes it under several lights: `relight_a_volume [FOLDER]`.
#![expect(clippy::print_stdout, reason = "an example prints its result")]

use std::error::Error;
use std::path::PathBuf;

use relume::output::write_ready_png;
use relume::plan::plan;
use relume::progress::Quiet;
use relume::render::Renderer;
use relume::scene::{Mix, SceneOptions, load_embedded};
use relume::spectrum::standard::light;
use relume::tables::{Components, RelightMatrices};
use relume::vulkan::{Device, DeviceChoice, Validation};

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(std::env::args_os().nth(1).unwrap_or_else(|| ".".into()));
    let size = [200, 200];

    // Scene → plan → device → film.
    let scene = load_embedded(&SceneOptions::default(), &Quiet)?;
    let planned = plan(&scene, &Quiet)?;
    let renderer = Renderer::new(Device::open(&DeviceChoice::Auto, Validation::Off)?);
    let uploaded = renderer.upload(&scene, &planned, &scene.volume.statistics()?, &Quiet)?;
    let film = renderer.march(&scene, &planned, &uploaded, size, &Quiet)?;

    // Film × light → picture, as often as the light changes.
    let relight = renderer.relight_display(&film)?;
    let components = Components::new(&scene, &planned);
    for name in ["D65", "A", "FL11"] {
        let mut mix = Mix::of_scene(&scene);
        for one in &mut mix.0 {
            one.spectrum = light(name)?;
        }
        let (positions, background) = (planned.positions.len(), scene.background.as_ref());
        relight.run(&RelightMatrices::new(&components, positions, background, &mix, &scene.display))?;
        let rgba: Vec<u8> = relight.read()?;
        let path = folder.join(format!("{name}.png"));
        write_ready_png(&path, size[0], size[1], &rgba)?;
        println!("{}: {} marches so far", path.display(), renderer.marches());
    }
    Ok(())
}
