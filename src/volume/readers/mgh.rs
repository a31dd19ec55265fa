//! MGH, the volumes of `FreeSurfer`: `.mgh`, and `.mgz` or `.mgh.gz`, compressed by gzip.
//!
//! Fields and meanings follow the description of the format (<https://surfer.nmr.mgh.harvard.edu/fswiki/FsTutorial/MghFormat>).
//! All numbers are big-endian. The files are right-anterior-superior; the world here is left-posterior-superior.

use std::path::Path;

use glam::{DMat3, DVec3};

use super::binary::{self, Numbers};
use crate::data::{self, Data, DataFile};
use crate::geometry::Lattice;
use crate::resample::Grid;
use crate::select::Pick;
use crate::stream::{Skip, Start, count};
use crate::streamed::Streamed;
use crate::{ByteOrder, Selection, Unit, Volume, VolumeError, VoxelType};
use relume_base::number;
use relume_base::progress::Progress;

/// Bytes of the header; the voxels follow.
const LENGTH: usize = 284;

/// Longest axis of a file that its name does not identify.
const LARGEST: i32 = 1 << 16;

/// Whether the first bytes of a file, perhaps compressed by gzip, identify an MGH header.
pub(crate) fn recognises(beginning: &[u8]) -> bool {
    let bytes = binary::inside(beginning, LENGTH);
    let numbers = Numbers { bytes: &bytes, byte_order: ByteOrder::Big };
    let sides = [4, 8, 12, 16].iter().all(|&at| (1..=LARGEST).contains(&numbers.i32(at)));
    bytes.len() == LENGTH && numbers.i32(0) == 1 && sides && voxel_type(numbers.i32(20)).is_ok()
}

/// Reads an MGH file.
pub(crate) fn read(path: &Path, selection: &Selection, progress: &dyn Progress) -> Result<Volume, VolumeError> {
    streamed(path, selection)?.read(&path.display().to_string(), selection, progress)
}

/// Reads the header of an MGH file.
pub(crate) fn streamed(path: &Path, selection: &Selection) -> Result<Streamed, VolumeError> {
    let (bytes, encoding) = binary::beginning(path, LENGTH)?;
    let wrong =
        |place: &str, problem: String| VolumeError::Field { path: path.to_owned(), place: place.to_owned(), problem };
    if bytes.len() < LENGTH {
        return Err(wrong("header", format!("the file has {} bytes, but an MGH header has {LENGTH}", bytes.len())));
    }
    let numbers = Numbers { bytes: &bytes, byte_order: ByteOrder::Big };
    if numbers.i32(0) != 1 {
        return Err(wrong(
            "version",
            format!("the version is {}; Relume reads MGH files of version 1", numbers.i32(0)),
        ));
    }
    let voxel_type = voxel_type(numbers.i32(20)).map_err(|problem| wrong("type", problem))?;
    let stated = [4, 8, 12, 16].map(|at| numbers.i32(at));
    let sides = stated.map(|side| usize::try_from(side).unwrap_or(0));
    if sides.contains(&0) {
        let [width, height, depth, frames] = stated;
        let problem =
            format!("the header states {width}×{height}×{depth} voxels in {frames} frames; each must be at least 1");
        return Err(wrong("width, height, depth, nframes", problem));
    }
    let [nx, ny, nz, times] = sides;
    let source_name = path.display().to_string();
    data::check_size(&source_name, &sides)?;
    selection.no_array(&source_name)?;
    selection.component(&source_name, 1, "")?;
    let time = selection.time(&source_name, times)?;
    let slices = selection.slices(nz);
    let mut picks = vec![Pick { stride: nx * ny * nz, length: times, index: time }];
    picks.extend(selection.middle.then_some(Pick { stride: nx * ny, length: nz, index: slices.start }));
    let mut notes = Vec::new();
    let lattice = lattice(&numbers, [nx, ny, nz], &source_name, &mut notes);
    let is_placed = [lattice.origin, lattice.steps.x_axis, lattice.steps.y_axis, lattice.steps.z_axis];
    if is_placed.iter().any(|vector| !vector.is_finite()) {
        let all: Vec<String> = (0..15).map(|word| number::readable(numbers.f32(30 + 4 * word))).collect();
        let problem = format!("the numbers {} are not all finite", all.join(" "));
        return Err(wrong("delta, Mdc, Pxyz_c", problem));
    }
    let lattice = if selection.middle { lattice.of_slices(&slices) } else { lattice };
    let grid = Grid::of(lattice, &source_name, selection.resample)?;
    let start = Start { at: 0, lines: 0, skip: Skip::Bytes(count(LENGTH)) };
    let files = vec![DataFile { path: path.to_owned(), numbers: sides.iter().product() }];
    // Times and tags follow the voxels.
    let data = Data { files, start, encoding, voxel_type, byte_order: ByteOrder::Big, picks, alone: false };
    let (dims, files) = (grid.dims(), data.paths());
    let finish = move |voxels, mut notes: Vec<String>| {
        let mut volume = grid.volume(&source_name, voxels, false, 1.0)?;
        (volume.files, volume.unit, volume.anatomical) = (files, Some(Unit::Millimetre), true);
        notes.append(&mut volume.notes);
        volume.notes = notes;
        Ok(volume)
    };
    Ok(Streamed { data, halves: false, dims, notes, finish: Box::new(finish) })
}

/// The type with this number. The error is a sentence.
fn voxel_type(number: i32) -> Result<VoxelType, String> {
    Ok(match number {
        0 => VoxelType::U8,
        1 => VoxelType::I32,
        3 => VoxelType::F32,
        4 => VoxelType::I16,
        10 => VoxelType::U16,
        _ => {
            let name = match number {
                2 => "whole numbers whose size depends on the machine",
                5 => "voxels of 1 bit",
                6 => "tensors",
                7 => "complex numbers",
                8 => "floats of 64 bits",
                9 => "RGB",
                _ => "not a type of the format",
            };
            return Err(format!(
                "Relume does not read type {number} ({name}); it reads 0, 1, 3, 4 and 10; mri_convert -odt float writes type 3"
            ));
        }
    })
}

/// The grid in left-posterior-superior millimetres: the centre of the volume lies at `Pxyz_c`, half of the voxels along each
/// axis behind the first.
fn lattice(numbers: &Numbers<'_>, dims: [usize; 3], source: &str, notes: &mut Vec<String>) -> Lattice {
    let three = |at: usize| DVec3::from_array([0, 4, 8].map(|word| numbers.f32(at + word)));
    let is_stated = numbers.i16(28) > 0;
    let (spacing, axes, centre) = if is_stated {
        (three(30), DMat3::from_cols(three(42), three(54), three(66)), three(78))
    } else {
        notes.push(format!(
            "{source}: the header states no placing (goodRASFlag is {}); Relume uses FreeSurfer's default: coronal slices, spacing \
             1 1 1",
            numbers.i16(28)
        ));
        (DVec3::ONE, DMat3::from_cols(DVec3::NEG_X, DVec3::NEG_Z, DVec3::Y), DVec3::ZERO)
    };
    let turn = DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0));
    let steps = turn * axes * DMat3::from_diagonal(spacing);
    let middle = DVec3::from_array(dims.map(number::count)) / 2.0;
    Lattice { dims, origin: turn * centre - steps * middle, steps }
}
