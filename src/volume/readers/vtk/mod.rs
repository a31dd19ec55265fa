//! Legacy VTK files, `.vtk`: structured points, and rectilinear grids with even axes; text or big-endian numbers.
//!
//! Keywords and meanings follow Kitware's "VTK File Formats", and VTK's reader where the text leaves a choice.

mod parser;

use std::collections::HashSet;
use std::path::Path;

use glam::{DMat3, DVec3};

use crate::data::{self, Data, DataFile};
use crate::select::Pick;
use crate::stream::{Encoding, Start};
use crate::voxels::Voxels;
use crate::{ByteOrder, Geometry, Selection, Volume, VolumeError, VoxelType};
use parser::Parser;
use relume_base::progress::Progress;

/// Whether the first bytes of a file identify a legacy VTK file.
pub(crate) fn recognises(beginning: &[u8]) -> bool {
    beginning.starts_with(b"# vtk DataFile")
}

/// Reads one component of one array of a legacy VTK file.
pub(crate) fn read(path: &Path, selection: &Selection, progress: &dyn Progress) -> Result<Volume, VolumeError> {
    let source = path.display().to_string();
    let parsed = Parser::open(path)?.parse()?;
    let (array, name) = parsed.choose(selection, &source)?;
    selection.time(&source, 1)?;
    let kind = format!("the array {} of {}", array.name, array.section.name());
    let component = selection.component(&source, array.components, &kind)?;
    let Some(stored) = array.stored else {
        let problem =
            format!("the array {:?} has the type {}, which is not a number type", array.name, array.type_name);
        return Err(parsed.wrong(array.line, problem));
    };
    let geometry = parsed.geometry(array.section, &source)?;
    if geometry.voxels() != array.tuples {
        let [x, y, z] = geometry.dims;
        let problem = format!("the array {:?} has {} values, but the grid has {x}×{y}×{z}", array.name, array.tuples);
        return Err(parsed.wrong(array.line, problem));
    }
    let mut notes = Vec::new();
    data::check_size(&source, &[array.tuples, array.components])?;
    let numbers = array.tuples * array.components;
    let files = |numbers| vec![DataFile { path: path.to_owned(), numbers }];
    let picks = vec![Pick { stride: 1, length: array.components, index: component }];
    let stored_as = |voxel_type, numbers, picks| Data {
        files: files(numbers),
        start: Start::at(array.at),
        encoding: if parsed.is_binary { Encoding::Raw } else { Encoding::Text },
        voxel_type,
        byte_order: ByteOrder::Big,
        picks,
        alone: false,
    };
    let voxels = match stored {
        Stored::Bits if parsed.is_binary => {
            let packed = stored_as(VoxelType::U8, numbers.div_ceil(8), Vec::new()).read(progress, &mut notes)?;
            bits(packed, component, array.components, array.tuples)
        }
        Stored::Bits => stored_as(VoxelType::U8, numbers, picks).read(progress, &mut notes)?,
        Stored::Colours if !parsed.is_binary => stored_as(VoxelType::F32, numbers, picks).read(progress, &mut notes)?,
        Stored::Colours => stored_as(VoxelType::U8, numbers, picks).read(progress, &mut notes)?,
        Stored::Numbers(voxel_type) => stored_as(voxel_type, numbers, picks).read(progress, &mut notes)?,
    };
    let mut volume = Volume::new(&source, voxels, geometry)?;
    volume.has_labels = matches!(stored, Stored::Bits);
    volume.files.push(path.to_owned());
    volume.components = array.components;
    volume.selection.array = name;
    if !parsed.title.is_empty() {
        volume.metadata.push(("title".to_owned(), parsed.title.clone()));
    }
    if array.section == Section::Cells {
        notes.push(format!(
            "{source}: {} is CELL_DATA; each value becomes a voxel at the centre of its VTK cell, half a spacing from \
             the corners",
            array.name
        ));
    }
    volume.notes = notes;
    Ok(volume)
}

/// One component of values packed eight to a byte, the first in the highest bit.
fn bits(packed: Voxels, component: usize, components: usize, tuples: usize) -> Voxels {
    let bytes = packed.bytes();
    let bit = |at: usize| bytes.get(at / 8).map_or(0, |byte| byte >> (7 - at % 8) & 1);
    Voxels::U8((0..tuples).map(|tuple| bit(tuple * components + component)).collect())
}

/// The owner of the values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Section {
    Points,
    Cells,
    Field,
}

impl Section {
    fn name(self) -> &'static str {
        match self {
            Self::Points => "POINT_DATA",
            Self::Cells => "CELL_DATA",
            Self::Field => "FIELD",
        }
    }
}

/// How the values of an array are stored.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Stored {
    Numbers(VoxelType),
    /// Packed bits, or 0 and 1 as text.
    Bits,
    /// Bytes, or numbers from 0 to 1 as text.
    Colours,
}

/// An array of the file.
#[derive(Debug)]
struct Array {
    name: String,
    section: Section,
    type_name: String,
    /// `None` if the values are not numbers.
    stored: Option<Stored>,
    components: usize,
    tuples: usize,
    /// Offset of the values.
    at: u64,
    line: usize,
    /// Whether it is the `SCALARS` of its section.
    is_active: bool,
}

/// Everything of a file but its values.
struct Parsed<'a> {
    path: &'a Path,
    title: String,
    is_binary: bool,
    dims: [usize; 3],
    origin: DVec3,
    spacing: DVec3,
    arrays: Vec<Array>,
}

impl Parsed<'_> {
    fn wrong(&self, line: usize, problem: String) -> VolumeError {
        VolumeError::Header { path: self.path.to_owned(), line, problem }
    }

    /// The selected array, and its name if there are others. Without a selection, this is the first `SCALARS` of the
    /// points, or of the cells, or the only array.
    fn choose(&self, selection: &Selection, source: &str) -> Result<(&Array, Option<String>), VolumeError> {
        let mut seen = HashSet::new();
        let of_grid = |array: &&Array| array.section != Section::Field;
        let all: Vec<&Array> =
            self.arrays.iter().filter(of_grid).filter(|array| seen.insert((array.section, &array.name))).collect();
        if all.is_empty() {
            return Err(self.wrong(1, "neither POINT_DATA nor CELL_DATA has an array".to_owned()));
        }
        let in_both = |name: &str| {
            let has = |section| all.iter().any(|array| array.section == section && array.name == name);
            has(Section::Points) && has(Section::Cells)
        };
        let label = |array: &&Array| match &array.name {
            name if in_both(name) => format!("{}/{name}", array.section.name()),
            name => name.clone(),
        };
        let labels: Vec<String> = all.iter().map(label).collect();
        let active = |section| all.iter().position(|array| array.is_active && array.section == section);
        let alone = |section| {
            let mut of = all.iter().enumerate().filter(|(_, array)| array.section == section);
            of.next().map(|(index, _)| index).filter(|_| of.next().is_none())
        };
        let usual = active(Section::Points).or_else(|| active(Section::Cells)).or_else(|| alone(Section::Points));
        let index = match usual.filter(|_| selection.array.is_none() && !selection.asks) {
            Some(usual) => usual,
            None => selection.array(source, &labels.iter().map(String::as_str).collect::<Vec<_>>())?,
        };
        Ok((all[index], labels.get(index).filter(|_| labels.len() > 1).cloned()))
    }

    /// Grid of the points, or of the cell centres. An axis of one point has one layer of cells.
    fn geometry(&self, section: Section, source: &str) -> Result<Geometry, VolumeError> {
        let (mut dims, mut shift) = (self.dims, DVec3::ZERO);
        if section == Section::Cells {
            for axis in (0..3).filter(|&axis| self.dims[axis] > 1) {
                dims[axis] -= 1;
                shift[axis] = 0.5;
            }
        }
        Geometry::new(source, dims, self.spacing, self.origin + self.spacing * shift, DMat3::IDENTITY)
    }
}
