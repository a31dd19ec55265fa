//! VTK XML image data, `.vti`: tags that describe a grid and its arrays, with values between or after the tags.
//!
//! Tags and meanings follow `vtkXMLImageDataReader` and `vtkXMLDataParser` (VTK 9). The registry's crate for these
//! files, `vtkio`, is not used: it fails on files that VTK wrote, for example `engine.vti` of vtk-js-datasets.

mod bytes;
mod grid;
mod header;

use std::collections::HashSet;
use std::io::{BufRead, Read};
use std::path::Path;

pub use self::bytes::PackedBlocks;
use self::bytes::{Base64, Blocks, Compressor, UntilTag, Words};
use self::grid::{Block, Section};
use self::header::{Array, Header, Place};
use crate::allocate;
use crate::data::{self, Next, SLAB_BYTES};
use crate::layout::ByteOrder;
use crate::stream::{self, count};
use crate::voxels::{with_type, with_voxels};
use crate::{Selection, Volume, VolumeError, Voxel, VoxelType, Voxels};
use relume_base::progress::{Progress, Quiet};

/// Largest ratio of the points in all pieces to those in the image. Neighbouring pieces share points: with pieces of
/// one VTK cell, each axis has nearly twice as many points.
const MOST_SHARED: usize = 8;

/// Largest expansion of text: a digit and its separator take two bytes in the file, and at most eight in memory.
const PLAIN_LIMIT: u64 = 4;

/// Largest number of values of field data in the metadata.
const MOST_SHOWN: usize = 16;

/// Whether the first bytes of a file identify VTK XML.
pub(crate) fn recognises(beginning: &[u8]) -> bool {
    String::from_utf8_lossy(beginning).contains("<VTKFile")
}

/// Reads one component of one array of VTK XML image data.
///
/// Memory is bounded by what the lengths of the values in the file justify, and is allocated only after all pieces have
/// been examined. It holds the volume, one block of compressed values, and, for several pieces, one bit per voxel.
pub(crate) fn read(path: &Path, selection: &Selection, progress: &dyn Progress) -> Result<Volume, VolumeError> {
    let source = path.display().to_string();
    let header = Header::read(path, progress)?;
    let (chosen, name, step) = choose(&header, selection, &source)?;
    let voxel_type = chosen
        .voxel_type()
        .ok_or_else(|| header.wrong(format!("values of type {} are not numbers", chosen.type_name)))?;
    let what = format!("the {voxel_type} array {} of {}", chosen.name, chosen.section.name());
    let component = selection.component(&source, chosen.components, &what)?;
    let geometry = header.frame.geometry(&source, chosen.section)?;
    let whole = header.frame.block(chosen.section, &header.frame.extent);
    let parts = parts(&header, chosen, step)?;
    let mut notes = Vec::new();
    let voxels =
        with_type!(voxel_type, T => read_parts::<T>(&header, &parts, &whole, component, progress, &mut notes))?;

    let mut volume = Volume::new(&source, voxels, geometry)?;
    volume.notes = notes;
    volume.files.push(path.to_owned());
    volume.components = chosen.components;
    volume.selection.array = name;
    volume.metadata = metadata(&header, chosen);
    if chosen.section == Section::Cells {
        volume.notes.push(format!(
            "{source}: {} is CellData; each value becomes a voxel at the centre of its VTK cell, half a spacing from the corners",
            chosen.name
        ));
    }
    Ok(volume)
}

/// Returns the compressed blocks that [`read`] would decode; `None` if the values are not compressed.
pub(crate) fn packed(
    path: &Path,
    selection: &Selection,
    progress: &dyn Progress,
) -> Result<Option<PackedBlocks>, VolumeError> {
    let header = Header::read(path, progress)?;
    let (chosen, _, step) = choose(&header, selection, &path.display().to_string())?;
    let (Some(compressor), false) = (header.compressor, matches!(chosen.place, Place::Text(_))) else {
        return Ok(None);
    };
    let mut all = PackedBlocks::new(compressor);
    for Part { array, block } in parts(&header, chosen, step)? {
        let bytes = chosen.voxel_type().map_or(0, VoxelType::bytes);
        let expected =
            [array.components, bytes].into_iter().try_fold(block.voxels().unwrap_or(usize::MAX), usize::checked_mul);
        let Stored { stream, there, .. } = stored(&header, array)?;
        let words = Words { wide: header.wide, byte_order: header.byte_order };
        let blocks = Blocks::new(stream, compressor, words, count(expected.unwrap_or(usize::MAX)), there);
        blocks.and_then(|blocks| all.add(blocks)).map_err(|source| VolumeError::VtiArray {
            path: path.to_owned(),
            array: array.name.clone(),
            decoded: 0,
            source,
        })?;
    }
    Ok(Some(all))
}

/// Arrays of the first piece with points; all other pieces have the same arrays.
fn arrays(header: &Header) -> impl Iterator<Item = &Array> {
    let pieces = header.pieces.iter().filter(|piece| !header.frame.block(Section::Points, &piece.extent).is_empty());
    pieces.take(1).flat_map(|piece| &piece.arrays)
}

/// Distinct numeric arrays of points and cells.
fn candidates(header: &Header) -> Vec<&Array> {
    let mut seen = HashSet::new();
    let numbers = |array: &&Array| array.section != Section::Fields && array.voxel_type().is_some();
    arrays(header).filter(numbers).filter(|array| seen.insert((array.section, &array.name))).collect()
}

/// Number of time steps of an array: VTK writes them as consecutive arrays of the same name.
fn steps(header: &Header, chosen: &Array) -> usize {
    arrays(header).filter(|array| array.is_same(chosen)).count()
}

/// Returns the selected array, its name if the file has other arrays, and the time step.
fn choose<'a>(
    header: &'a Header,
    selection: &Selection,
    source: &str,
) -> Result<(&'a Array, Option<String>, usize), VolumeError> {
    let (chosen, name) = choose_array(header, selection, source)?;
    Ok((chosen, name, selection.time(source, steps(header, chosen))?))
}

/// Returns the selected array, and its name if the file has other arrays. Without a selection, this is the active array
/// of the points, or of the cells, or the only array.
fn choose_array<'a>(
    header: &'a Header,
    selection: &Selection,
    source: &str,
) -> Result<(&'a Array, Option<String>), VolumeError> {
    let candidates = candidates(header);
    if candidates.is_empty() {
        return Err(header.wrong("neither PointData nor CellData has a numeric array".to_owned()));
    }
    // A point array and a cell array may have the same name.
    let names = |section| -> HashSet<&str> {
        candidates.iter().filter(|array| array.section == section).map(|array| array.name.as_str()).collect()
    };
    let (points, cells) = (names(Section::Points), names(Section::Cells));
    let label = |array: &&Array| match array.name.as_str() {
        name if points.contains(name) && cells.contains(name) => format!("{}/{name}", array.section.name()),
        name => name.to_owned(),
    };
    let labels: Vec<String> = candidates.iter().map(label).collect();
    let active = |section| candidates.iter().position(|array| array.active && array.section == section);
    let usual = active(Section::Points).or_else(|| active(Section::Cells));
    let index = match usual.filter(|_| selection.array.is_none() && !selection.asks) {
        Some(usual) => usual,
        None => selection.array(source, &labels.iter().map(String::as_str).collect::<Vec<_>>())?,
    };
    Ok((candidates[index], labels.get(index).filter(|_| labels.len() > 1).cloned()))
}

/// An array of one piece, with the block that it covers.
struct Part<'a> {
    array: &'a Array,
    block: Block,
}

/// Returns the parts of the array `chosen` at a time step, one per piece that is not empty.
fn parts<'a>(header: &'a Header, chosen: &Array, step: usize) -> Result<Vec<Part<'a>>, VolumeError> {
    let blocks = header.pieces.iter().map(|piece| (piece, header.frame.block(chosen.section, &piece.extent)));
    blocks
        .filter(|(_, block)| !block.is_empty())
        .map(|(piece, block)| {
            let array =
                piece.arrays.iter().filter(|array| array.is_same(chosen)).nth(step).ok_or_else(|| {
                    header.wrong(format!("a Piece lacks the array {:?} of another Piece", chosen.name))
                })?;
            if (array.voxel_type(), array.components) != (chosen.voxel_type(), chosen.components) {
                return Err(
                    header.wrong(format!("the array {:?} differs in type or components between Pieces", chosen.name))
                );
            }
            Ok(Part { array, block })
        })
        .collect()
}

/// Refuses parts outside the whole, excessive overlap, and more values than the file can hold.
fn check_parts<T: Voxel>(header: &Header, parts: &[Part<'_>], whole: &Block) -> Result<(), VolumeError> {
    if parts.iter().any(|part| part.block.runs(whole).is_none()) {
        return Err(header.wrong("a Piece lies outside the WholeExtent".to_owned()));
    }
    let all = whole.voxels().unwrap_or(usize::MAX);
    let sum = parts.iter().try_fold(0_usize, |sum, part| sum.checked_add(part.block.voxels()?));
    let Some(sum) = sum.filter(|sum| sum / MOST_SHARED <= all) else {
        return Err(header.wrong(format!(
            "its Pieces overlap: they have more than {MOST_SHARED} times the values of the WholeExtent"
        )));
    };
    for part in parts {
        Values::open::<T>(header, part)?;
    }
    // Each part fits alone, but several could refer to the same bytes of the file.
    let limit = header.compressor.map_or(PLAIN_LIMIT, Compressor::limit);
    let bytes = count(sum).saturating_mul(count(size_of::<T>()));
    if bytes > header.length.saturating_mul(limit) {
        let length = header.length;
        return Err(header.wrong(format!("a file of {length} bytes cannot hold {bytes} bytes of values")));
    }
    Ok(())
}

/// Refuses parts that do not cover the whole; they must lie in it.
fn check_gaps(header: &Header, parts: &[Part<'_>], whole: &Block) -> Result<(), VolumeError> {
    let all = whole.voxels().unwrap_or(usize::MAX);
    let sum: usize = parts.iter().filter_map(|part| part.block.voxels()).sum();
    let mut left_out = all.saturating_sub(sum);
    if parts.len() > 1 && left_out == 0 {
        let mut covered = allocate::zeroed::<u64>(&header.path, all.div_ceil(64))?;
        for (start, length) in parts.iter().filter_map(|part| part.block.runs(whole)).flatten() {
            for voxel in start..start + length {
                covered[voxel / 64] |= 1 << (voxel % 64);
            }
        }
        left_out = all - covered.iter().map(|word| word.count_ones() as usize).sum::<usize>();
    }
    if left_out > 0 {
        return Err(header.wrong(format!("its Pieces do not cover {left_out} of {all} voxels")));
    }
    Ok(())
}

/// Reads one component of all parts of an array. Harmless oddities are appended to `notes`.
fn read_parts<T: Voxel>(
    header: &Header,
    parts: &[Part<'_>],
    whole: &Block,
    component: usize,
    progress: &dyn Progress,
    notes: &mut Vec<String>,
) -> Result<Voxels, VolumeError> {
    // All parts are checked before memory is allocated.
    check_parts::<T>(header, parts, whole)?;
    check_gaps(header, parts, whole)?;
    let mut voxels = allocate::zeroed::<T>(&header.path, whole.voxels().unwrap_or(usize::MAX))?;
    let all = parts.iter().map(|part| count(part.block.voxels().unwrap_or(0))).sum::<u64>() * count(size_of::<T>());
    let (mut done, mut reported) = (0, 0);
    let mut tuples = Vec::new();
    for part in parts {
        let mut values = Values::open::<T>(header, part)?;
        let components = part.array.components;
        for (start, length) in part.block.runs(whole).into_iter().flatten() {
            let slab = (SLAB_BYTES / size_of::<T>() / components).max(1);
            for slab in voxels[start..start + length].chunks_mut(slab) {
                if components == 1 {
                    values.fill(slab)?;
                } else {
                    tuples.resize(slab.len() * components, T::zeroed());
                    values.fill(&mut tuples)?;
                    for (voxel, tuple) in slab.iter_mut().zip(tuples.chunks_exact(components)) {
                        *voxel = tuple[component];
                    }
                }
                done += count(size_of_val(slab));
                if done == all || done - reported >= count(SLAB_BYTES) {
                    data::report(&header.path, done, all, progress)?;
                    reported = done;
                }
            }
        }
        notes.extend(values.rest()?);
    }
    Ok(T::into_voxels(voxels))
}

/// Reader of the values of one part of an array.
struct Values<'a> {
    header: &'a Header,
    array: &'a Array,
    stream: Stream,
    /// Numbers read so far; `numbers` is the total.
    at: usize,
    numbers: usize,
}

enum Stream {
    Bytes(Box<dyn Read>),
    Text(Box<dyn BufRead>),
}

impl<'a> Values<'a> {
    /// Seeks to the first value, after a check that the file holds enough bytes for all values.
    fn open<T: Voxel>(header: &'a Header, part: &Part<'a>) -> Result<Self, VolumeError> {
        let array = part.array;
        let path = &header.path;
        let numbers = part.block.voxels().and_then(|voxels| voxels.checked_mul(array.components));
        let numbers = numbers.filter(|numbers| numbers.checked_mul(size_of::<T>()).is_some());
        let numbers = numbers.ok_or_else(|| header.wrong(format!("the array {:?} is too large", array.name)))?;
        let expected = count(numbers) * count(size_of::<T>());
        let stream = if let Place::Text(start) = array.place {
            let there = there(header, array, start)?;
            // A number and its separator take two bytes; the last number needs no separator.
            if there.div_ceil(2) < count(numbers) {
                let found = usize::try_from(there.div_ceil(2)).unwrap_or(usize::MAX);
                return Err(VolumeError::ShortText { path: path.clone(), found, expected: numbers });
            }
            Stream::Text(Box::new(UntilTag::new(stream::at(path, start)?)))
        } else {
            let Stored { stream, there } = stored(header, array)?;
            let failed =
                |source| VolumeError::VtiArray { path: path.clone(), array: array.name.clone(), decoded: 0, source };
            Stream::Bytes(unpacked(header, stream, expected, there).map_err(failed)?)
        };
        Ok(Self { header, array, stream, at: 0, numbers })
    }

    /// Reads the next numbers into `slab`.
    fn fill<T: Voxel>(&mut self, slab: &mut [T]) -> Result<(), VolumeError> {
        let path = &self.header.path;
        let next = Next { path, first: self.at, expected: self.numbers };
        match &mut self.stream {
            Stream::Bytes(stream) => {
                let array = &self.array.name;
                let swap = self.header.byte_order != ByteOrder::NATIVE;
                next.decode(slab, stream, swap, |source, decoded| VolumeError::VtiArray {
                    path: path.clone(),
                    array: array.clone(),
                    decoded,
                    source,
                })?;
            }
            Stream::Text(stream) => next.parse(slab, stream)?,
        }
        self.at += slab.len();
        Ok(())
    }

    /// Returns a note if text continues after the last number. Binary lengths are checked before reading.
    fn rest(&mut self) -> Result<Option<String>, VolumeError> {
        let Stream::Text(stream) = &mut self.stream else { return Ok(None) };
        let path = &self.header.path;
        let more = stream::next_word(stream, &mut Vec::new()).map(|word| word.is_some());
        let sentence = || {
            let (name, numbers) = (&self.array.name, self.numbers);
            format!(
                "{}: {name} has more than the {numbers} numbers that its extent requires; the rest is ignored",
                path.display()
            )
        };
        Ok(more.map_err(|source| stream::failed(path, source))?.then(sentence))
    }
}

/// Bytes of a binary array, possibly compressed; `there` is their largest possible number.
struct Stored {
    stream: Box<dyn Read>,
    there: u64,
}

/// Seeks to the bytes of `array`.
fn stored(header: &Header, array: &Array) -> Result<Stored, VolumeError> {
    let (start, base64) = match (array.place, header.appended) {
        (Place::Text(at), _) => (at, false),
        (Place::Base64(at), _) => (at, true),
        (Place::Appended(offset), Some(appended)) => (appended.start.saturating_add(offset), appended.base64),
        (Place::Appended(_), None) => {
            return Err(
                header.wrong(format!("the array {:?} is appended, but the file has no AppendedData", array.name))
            );
        }
    };
    let there = there(header, array, start)?;
    let text = stream::at(&header.path, start)?;
    Ok(if base64 {
        Stored { stream: Box::new(Base64::new(UntilTag::new(text))), there: there / 4 * 3 + 3 }
    } else {
        Stored { stream: Box::new(text), there }
    })
}

/// Number of bytes in the file from offset `start` on, where the values of `array` begin.
fn there(header: &Header, array: &Array, start: u64) -> Result<u64, VolumeError> {
    let length = header.length;
    length.checked_sub(start).filter(|&there| there > 0).ok_or_else(|| {
        header.wrong(format!("the values of {:?} begin at byte {start}, but the file has only {length}", array.name))
    })
}

/// Decodes the `expected` bytes of values from at most `there` stored bytes.
fn unpacked(header: &Header, mut stored: Box<dyn Read>, expected: u64, there: u64) -> std::io::Result<Box<dyn Read>> {
    let words = Words { wide: header.wide, byte_order: header.byte_order };
    if let Some(compressor) = header.compressor {
        return Ok(Box::new(Blocks::new(stored, compressor, words, expected, there)?));
    }
    let said = words.next(&mut stored)?;
    if said != expected {
        return Err(bytes::wrong(format!("its header states {said} bytes, but its extent requires {expected}")));
    }
    let there = there.saturating_sub(words.bytes());
    if there < expected {
        return Err(bytes::wrong(format!("it needs {expected} bytes, but the file has only {there}")));
    }
    Ok(stored)
}

/// Metadata of the file: its arrays, the array that was read, and short field data.
fn metadata(header: &Header, chosen: &Array) -> Vec<(String, String)> {
    let list = |section: Section| {
        let arrays = candidates(header).into_iter().filter(|array| array.section == section);
        let described = arrays.map(|array| match array.components {
            1 => format!("{} ({})", array.name, array.type_name),
            components => format!("{} ({components} × {})", array.name, array.type_name),
        });
        described.collect::<Vec<_>>().join(", ")
    };
    let mut metadata = vec![("array".to_owned(), format!("{} of {}", chosen.name, chosen.section.name()))];
    for section in [Section::Points, Section::Cells] {
        let arrays = list(section);
        if !arrays.is_empty() {
            metadata.push((section.name().to_owned(), arrays));
        }
    }
    for array in &header.fields {
        let numbers = array.tuples.and_then(|tuples| tuples.checked_mul(array.components));
        let numbers = numbers.filter(|numbers| (1..=MOST_SHOWN).contains(numbers));
        if let (Some(numbers), Some(voxel_type)) = (numbers, array.voxel_type()) {
            let row = Block::row(numbers);
            let scalar = Array { components: 1, ..array.clone() };
            let parts = [Part { array: &scalar, block: row }];
            // Errors in field data are ignored, because they are not part of the image.
            if let Ok(values) =
                with_type!(voxel_type, T => read_parts::<T>(header, &parts, &row, 0, &Quiet, &mut Vec::new()))
            {
                let values: Vec<String> =
                    with_voxels!(&values, stored => stored.iter().map(|value| format!("{value:?}")).collect());
                metadata.push((array.name.clone(), values.join(" ")));
            }
        }
    }
    metadata
}
