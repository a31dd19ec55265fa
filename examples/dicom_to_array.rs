//! Reads a folder of DICOM slices, or any other volume, into an array of f32 with its frame.
//!
//! `cargo run -p relume-volume --example dicom_to_array -- FOLDER`
#![expect(clippy::print_stdout, reason = "an example prints its result")]

use std::error::Error;
use std::path::PathBuf;

use relume_base::progress::Quiet;
use relume_volume::{Selection, Volume, open};

/// The values of `volume`, x fastest: value (x, y, z) is number x + width·(y + height·z).
#[expect(clippy::cast_possible_truncation, reason = "an array of f32 is asked for")]
fn array(volume: &Volume) -> Vec<f32> {
    (0..volume.voxels.len()).map(|i| volume.voxels.value(i).map_or(f32::NAN, |value| value as f32)).collect()
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(std::env::args_os().nth(1).ok_or("name a folder of DICOM slices")?);
    let volume = open(&folder, &Selection::default(), &Quiet)?;
    let values = array(&volume);
    let frame = &volume.geometry;
    let (low, high) =
        values.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), &value| (low.min(value), high.max(value)));
    println!("{:?} voxels from {low} to {high}", frame.dims);
    println!("spacing {}, origin {}", frame.spacing, frame.origin);
    // Voxel (x, y, z) lies at origin + direction · (spacing · (x, y, z)).
    println!("axes x {}, y {}, z {}", frame.direction.x_axis, frame.direction.y_axis, frame.direction.z_axis);
    Ok(())
}
