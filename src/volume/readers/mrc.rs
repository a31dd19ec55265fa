//! MRC and CCP4 maps of electron microscopy and crystallography, `.mrc`, `.ccp4`, `.map`; also compressed by gzip.
//!
//! Fields and meanings follow the description of MRC2014 (<https://www.ccpem.ac.uk/mrc_format/mrc2014.php>), and IMOD's
//! for unsigned bytes. The unit is the ångström.

use std::path::Path;

use glam::{DMat3, DVec3};

use super::binary::{self, Numbers};
use super::foreign;
use crate::data::{self, Data, DataFile};
use crate::geometry::Lattice;
use crate::resample::Grid;
use crate::select::Pick;
use crate::stream::{self, Encoding, Skip, Start};
use crate::streamed::Streamed;
use crate::{ByteOrder, Selection, Unit, Volume, VolumeError, VoxelType};
use relume_base::progress::Progress;

/// Bytes of the header.
const LENGTH: usize = 1024;

/// Largest length of a side in a file without a machine stamp.
const LARGEST: i32 = 1 << 20;

/// Angles that differ from 90° by less are the rounding of a header.
const RIGHT: f64 = 1e-3;

/// IMOD's stamp, whose files may say that their bytes are unsigned.
const IMOD: i32 = 1_146_047_817;

/// Space groups of stacks of volumes.
const STACKS: std::ops::RangeInclusive<i32> = 401..=630;

/// Whether the first bytes of a file, perhaps compressed by gzip, have the word `MAP` and a plausible header.
pub(crate) fn recognises(beginning: &[u8]) -> bool {
    is_map(&binary::inside(beginning, LENGTH))
}

fn is_map(bytes: &[u8]) -> bool {
    bytes.get(208..211) == Some(b"MAP") && byte_order(bytes).is_some()
}

/// Whether `path` has an extension of this format and holds another one.
pub(crate) fn is_another(path: &Path) -> Result<bool, VolumeError> {
    let (bytes, _) = binary::beginning(path, LENGTH)?;
    Ok(!is_map(&bytes) && foreign::is_known(&bytes))
}

/// Reads an MRC file.
pub(crate) fn read(path: &Path, selection: &Selection, progress: &dyn Progress) -> Result<Volume, VolumeError> {
    streamed(path, selection)?.read(&path.display().to_string(), selection, progress)
}

/// Reads the header of an MRC file.
pub(crate) fn streamed(path: &Path, selection: &Selection) -> Result<Streamed, VolumeError> {
    let (bytes, encoding) = binary::beginning(path, LENGTH)?;
    let wrong =
        |place: &str, problem: String| VolumeError::Field { path: path.to_owned(), place: place.to_owned(), problem };
    if bytes.len() < LENGTH {
        return Err(wrong("header", format!("the file has {} bytes, but an MRC header has {LENGTH}", bytes.len())));
    }
    let Some(byte_order) = byte_order(&bytes) else {
        let mode = i32::from_le_bytes([bytes[12], bytes[13], bytes[14], bytes[15]]);
        return Err(wrong(
            "mode",
            format!(
                "the byte order is unknown: the file has no machine stamp, and neither byte order gives dimensions from 1 to {LARGEST} and a known mode ({mode} in little-endian order)"
            ),
        ));
    };
    let numbers = Numbers { bytes: &bytes, byte_order };
    Reading { path, numbers, encoding }.streamed(selection)
}

/// The byte order by the machine stamp, or else the one in which the header is plausible.
fn byte_order(bytes: &[u8]) -> Option<ByteOrder> {
    match bytes.get(212..214) {
        Some([0x44, 0x44 | 0x41]) => return Some(ByteOrder::Little),
        Some([0x11, 0x11]) => return Some(ByteOrder::Big),
        _ => {}
    }
    [ByteOrder::Little, ByteOrder::Big].into_iter().find(|&byte_order| {
        let numbers = Numbers { bytes, byte_order };
        let sides = [0, 4, 8].iter().all(|&at| (1..=LARGEST).contains(&numbers.i32(at)));
        sides && matches!(numbers.i32(12), 0..=4 | 6 | 12 | 101)
    })
}

/// A header with its file.
struct Reading<'a> {
    path: &'a Path,
    numbers: Numbers<'a>,
    encoding: Encoding,
}

impl Reading<'_> {
    fn streamed(&self, selection: &Selection) -> Result<Streamed, VolumeError> {
        let source_name = self.path.display().to_string();
        let mut notes = Vec::new();
        let (voxel_type, halves) = self.voxel_type()?;
        let sides = self.sides()?;
        let (sections, times) = self.sections(sides[2])?;
        let dims = [sides[0], sides[1], sections];
        data::check_size(&source_name, &sides)?;
        selection.no_array(&source_name)?;
        selection.component(&source_name, 1, "")?;
        let time = selection.time(&source_name, times)?;
        let (lattice, unit) = self.lattice(dims, &mut notes)?;
        let grid = Grid::of(lattice, &source_name, selection.resample)?;
        let numbers = sides.iter().product();
        let picks = vec![Pick { stride: dims.iter().product(), length: times, index: time }];
        let files = vec![DataFile { path: self.path.to_owned(), numbers }];
        let byte_order = self.numbers.byte_order;
        let data =
            Data { files, start: self.start()?, encoding: self.encoding, voxel_type, byte_order, picks, alone: true };
        let (dims, files, metadata) = (grid.dims(), data.paths(), self.metadata());
        let finish = move |voxels, mut notes: Vec<String>| {
            let mut volume = grid.volume(&source_name, voxels, false, 1.0)?;
            (volume.files, volume.unit, volume.metadata) = (files, unit, metadata);
            notes.append(&mut volume.notes);
            volume.notes = notes;
            Ok(volume)
        };
        Ok(Streamed { data, halves, dims, notes, finish: Box::new(finish) })
    }

    fn wrong(&self, place: &str, problem: String) -> VolumeError {
        VolumeError::Field { path: self.path.to_owned(), place: place.to_owned(), problem }
    }

    /// Type of the stored numbers, and whether they are floats of 16 bits.
    fn voxel_type(&self) -> Result<(VoxelType, bool), VolumeError> {
        let unsigned = self.numbers.i32(152) == IMOD && self.numbers.i32(156) & 1 == 0;
        Ok(match self.numbers.i32(12) {
            0 if unsigned => (VoxelType::U8, false),
            0 => (VoxelType::I8, false),
            1 => (VoxelType::I16, false),
            2 => (VoxelType::F32, false),
            6 => (VoxelType::U16, false),
            12 => (VoxelType::U16, true),
            mode => {
                let name = match mode {
                    3 => "complex numbers of 2 × 16 bits",
                    4 => "complex numbers of 2 × 32 bits",
                    101 => "numbers of 4 bits",
                    _ => "not a mode of the format",
                };
                return Err(self
                    .wrong("mode", format!("Relume does not read mode {mode} ({name}); it reads 0, 1, 2, 6 and 12")));
            }
        })
    }

    /// Columns, rows and sections.
    fn sides(&self) -> Result<[usize; 3], VolumeError> {
        let stated = [0, 4, 8].map(|at| self.numbers.i32(at));
        let sides = stated.map(|side| usize::try_from(side).unwrap_or(0));
        if sides.contains(&0) {
            let [x, y, z] = stated;
            return Err(self.wrong(
                "nx, ny, nz",
                format!("the header states {x}×{y}×{z} voxels; every axis must have at least 1"),
            ));
        }
        Ok(sides)
    }

    /// Sections of one volume, and the number of volumes: a stack of them has 400 plus the space group.
    fn sections(&self, all: usize) -> Result<(usize, usize), VolumeError> {
        let (group, each) = (self.numbers.i32(88), self.numbers.i32(36));
        if !STACKS.contains(&group) {
            return Ok((all, 1));
        }
        match usize::try_from(each) {
            Ok(each) if each > 0 && all.is_multiple_of(each) => Ok((each, all / each)),
            _ => {
                Err(self
                    .wrong("mz", format!("the volumes of the stack have {each} sections each, but this does not divide the {all} sections of the file")))
            }
        }
    }

    /// The grid, and its unit if the file states the size of the cell.
    fn lattice(&self, dims: [usize; 3], notes: &mut Vec<String>) -> Result<(Lattice, Option<Unit>), VolumeError> {
        let numbers = &self.numbers;
        let source = self.path.display();
        let axes = self.axes(notes)?;
        let three = |at: usize| DVec3::from_array([0, 4, 8].map(|word| numbers.f32(at + word)));
        let (cell, angles, origin) = (three(40), three(52), three(196));
        let finite = [("cella", cell), ("cellb", angles), ("origin", origin)];
        if let Some((place, vector)) = finite.iter().find(|(_, vector)| !vector.is_finite()) {
            return Err(
                self.wrong(place, format!("the numbers {} {} {} are not all finite", vector.x, vector.y, vector.z))
            );
        }
        // Intervals of the cell along x, y, z; the sides are along columns, rows, sections.
        let mut spacing = DVec3::ONE;
        let stated = cell.cmpgt(DVec3::ZERO).all();
        if stated {
            for (column, &axis) in axes.iter().enumerate() {
                let intervals = numbers.i32(28 + 4 * axis);
                let side = i32::try_from(dims[column]).unwrap_or(i32::MAX);
                spacing[axis] = cell[axis] / f64::from(if intervals > 0 { intervals } else { side });
            }
        } else {
            let [x, y, z] = cell.to_array();
            notes.push(format!("{source}: the cell of {x} {y} {z} Å gives no spacing; Relume uses 1 1 1"));
        }
        if numbers.i32(88) == 0 && dims[2] > 1 {
            notes.push(format!(
                "{source}: the space group 0 marks a stack of images; the spacing between the images may be meaningless"
            ));
        }
        let Some(directions) = directions(angles) else {
            let [a, b, c] = angles.to_array();
            return Err(self.wrong("cellb", format!("no cell has the angles {a}, {b} and {c} degrees")));
        };
        let cell_axes = directions * DMat3::from_diagonal(spacing);
        let steps = axes.map(|axis| cell_axes.col(axis));
        let starts = [16, 20, 24].map(|at| f64::from(numbers.i32(at)));
        let started = (0..3).map(|column| steps[column] * starts[column]).sum();
        let origin = if origin == DVec3::ZERO { started } else { origin };
        let steps = DMat3::from_cols(steps[0], steps[1], steps[2]);
        Ok((Lattice { dims, origin, steps }, stated.then_some(Unit::Angstrom)))
    }

    /// The axis, x, y or z, along which columns, rows and sections run.
    fn axes(&self, notes: &mut Vec<String>) -> Result<[usize; 3], VolumeError> {
        let stated = [64, 68, 72].map(|at| self.numbers.i32(at));
        if stated == [0; 3] {
            notes.push(format!("{}: mapc, mapr and maps are 0; they are taken as 1 2 3", self.path.display()));
            return Ok([0, 1, 2]);
        }
        let axes = stated.map(|axis| match axis {
            1 => 0,
            2 => 1,
            3 => 2,
            _ => 3,
        });
        let mut sorted = axes;
        sorted.sort_unstable();
        if sorted == [0, 1, 2] {
            return Ok(axes);
        }
        let [c, r, s] = stated;
        Err(self.wrong("mapc, mapr, maps", format!("{c} {r} {s} is not a permutation of 1 2 3")))
    }

    /// Where the voxels begin.
    fn start(&self) -> Result<Start, VolumeError> {
        let extended = self.numbers.i32(92);
        let Ok(extended) = u64::try_from(extended) else {
            return Err(self
                .wrong("nsymbt", format!("the extended header has {extended} bytes; the number must be at least 0")));
        };
        let at = stream::count(LENGTH) + extended;
        if self.encoding == Encoding::Raw {
            let length = stream::after_lines(self.path, Start::at(0))?.1;
            if at > length {
                let problem = format!("the voxels begin at byte {at}, but the file has only {length} bytes");
                return Err(self.wrong("nsymbt", problem));
            }
        } else if extended > data::MOST_SKIPPED {
            let problem = format!(
                "the extended header has {extended} bytes, but a compressed file may have at most {} before its voxels",
                data::MOST_SKIPPED
            );
            return Err(self.wrong("nsymbt", problem));
        }
        Ok(Start { at: 0, lines: 0, skip: Skip::Bytes(at) })
    }

    fn metadata(&self) -> Vec<(String, String)> {
        let group = ("space group".to_owned(), self.numbers.i32(88).to_string());
        let labels = usize::try_from(self.numbers.i32(220)).unwrap_or(0).min(10);
        let label = |index: usize| Some((format!("label {index}"), self.numbers.text(224 + 80 * index, 80)?));
        std::iter::once(group).chain((0..labels).filter_map(label)).collect()
    }
}

/// Unit vectors of the axes of a cell with these angles in degrees: between y and z, x and z, x and y. The first lies
/// on the world's x axis, the second in its plane of x and y. `None` if no cell has these angles.
fn directions(angles: DVec3) -> Option<DMat3> {
    let right = |angle: f64| angle == 0.0 || (angle - 90.0).abs() < RIGHT;
    if angles.to_array().into_iter().all(right) {
        return Some(DMat3::IDENTITY);
    }
    let [yz, xz, xy] = angles.to_array().map(|angle| if angle == 0.0 { 0.0 } else { angle.to_radians().cos() });
    let across = (1.0 - xy * xy).sqrt();
    let forward = (yz - xz * xy) / across;
    let up = (1.0 - xz * xz - forward * forward).sqrt();
    // The root of a negative number is NaN, which is not above 0.
    let is_cell = across > 0.0 && up > 0.0;
    is_cell.then(|| DMat3::from_cols(DVec3::X, DVec3::new(xy, across, 0.0), DVec3::new(xz, forward, up)))
}
