//! Designs two reflectances that match in daylight and differ under a light bulb.
#![expect(clippy::print_stdout, reason = "an example prints its result")]

use std::error::Error;
use std::path::Path;

use relume_base::progress::Quiet;
use relume_colour::palette::{parse, solve};

const PALETTE: &str = r##"
version = 1
[lights.day]
spectrum = "D65"
[lights.bulb]
spectrum = "A"
[materials.rock]
[materials.ore]
[cells.rock]
day = "#8f8f8f"
bulb = { lab = [60, 30, 40] }
[cells.ore]
day = "as rock"
bulb = { lab = [60, 2, 40] }
"##;

fn main() -> Result<(), Box<dyn Error>> {
    let solution = solve(&parse("example", PALETTE, Path::new(""))?, &Quiet)?;
    for (material, reflectance) in solution.palette.materials.iter().zip(&solution.materials) {
        let samples = reflectance.spectrum().samples();
        let every_50_nm: Vec<String> = samples.iter().step_by(10).map(|sample| format!("{sample:.2}")).collect();
        println!("{:>5}, 380 to 780 nm: {}", material.name, every_50_nm.join(" "));
    }
    for cell in &solution.cells {
        let (material, light) = (&solution.palette.materials[cell.material], &solution.palette.lights[cell.light]);
        let difference = cell.difference.unwrap_or(0.0);
        println!(
            "{:>5} under {:>4}: Y = {:.3}, ΔE00 {difference:.3} from its target",
            material.name, light.name, cell.xyz.0[1]
        );
    }
    Ok(())
}
