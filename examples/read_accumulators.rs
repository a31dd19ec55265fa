//! Reads a film file and prints its positions, lights and mean weights: `read_accumulators FILM.exr`.
#![expect(clippy::print_stdout, reason = "an example prints its result")]

use std::error::Error;
use std::path::PathBuf;

use relume::output::FilmFile;
use relume::output::film::Components;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args_os().nth(1).map(PathBuf::from).ok_or("give a film file: read_accumulators FILM.exr")?;
    let film = FilmFile::read(&path)?;
    println!("{}×{} pixels, {} components", film.width, film.height, film.components.len());
    for light in &film.lights {
        println!("light {}", light.name);
    }
    // The weights of component c at position p form one plane.
    let mut planes = film.accumulators.chunks_exact(film.width * film.height);
    for position in &film.positions {
        for component in 0..film.components.len() {
            let plane = planes.next().unwrap_or_default();
            let sum: f64 = plane.iter().map(|&weight| f64::from(weight)).sum();
            let name = match &film.components {
                Components::Surfaces(surfaces) => surfaces[component].name.clone(),
                Components::Model(_) => format!("coefficient {component}"),
            };
            println!("{}.{name}: the weights of all pixels add up to {sum:.1}", position.name);
        }
    }
    Ok(())
}
