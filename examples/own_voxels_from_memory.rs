//! Renders voxels from memory with the f64 reference on the CPU: `own_voxels_from_memory [FOLDER]`.
#![expect(clippy::print_stdout, reason = "an example prints its result")]

use std::error::Error;
use std::path::PathBuf;
use std::sync::Arc;

use relume::film::RelightMatrices;
use relume::output::{Alpha, Depth, Picture, write_png};
use relume::plan::{plan, plan_full_spectrum};
use relume::progress::Quiet;
use relume::reference::{self, Exact};
use relume::scene::{Material, Mix, Scene, SceneLight, Term};
use relume::spectrum::standard;
use relume::tables::Storage;
use relume::volume::{Geometry, Volume, Voxels};

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(std::env::args_os().nth(1).unwrap_or_else(|| ".".into()));

    // A ball whose values fall from its centre to its surface.
    let side = 32_u8;
    let squared = |i: u8| (f64::from(i) - 15.5).powi(2);
    let mut values = Vec::new();
    for z in 0..side {
        for y in 0..side {
            values.extend((0..side).map(|x| 220.0 - 14.0 * (squared(x) + squared(y) + squared(z)).sqrt()));
        }
    }
    let geometry = Geometry::unit("ball", [side.into(); 3])?;
    let volume = Arc::new(Volume::new("ball", Voxels::F64(values), geometry)?);

    // Its shell, from 90 to 110 with ramps of 10, in daylight.
    let mut scene = Scene::new("example", volume);
    scene.materials.push(Material::new("shell", standard::reflectance("orange")?));
    scene.transfer.terms.push(Term::interval(0, [90.0, 110.0], 10.0, 0.6, 0.0));
    scene.lights.push(SceneLight::new("day", standard::light("D65")?));

    // Full-spectrum reference: all 81 bands in f64.
    let planned = plan_full_spectrum(&scene);
    let storage = Storage::new(&planned.plan, scene.volume(), &scene.volume().statistics()?);
    let samples = Exact::new(&scene, &planned, storage, None);
    let matrices = RelightMatrices::of_scene(&scene, &planned, &Mix::of_scene(&scene));
    let size = [96, 96];
    let pixels = reference::render::<f64>(&scene, &planned, &samples, &matrices, size, &Quiet)?;
    #[expect(clippy::cast_possible_truncation, reason = "pictures are stored in f32")]
    let rgba: Vec<f32> = pixels
        .iter()
        .flat_map(|(colour, opacity)| [colour.x as f32, colour.y as f32, colour.z as f32, *opacity as f32])
        .collect();
    let path = folder.join("ball.png");
    write_png(&path, &Picture::new(size[0], size[1], &rgba)?, Depth::Eight, Alpha::Kept)?;
    println!("{}: the plan for a device is {:?}", path.display(), plan(&scene, &Quiet)?.plan.accumulate);
    Ok(())
}
