//! Headerless voxels, described by a layout from a sidecar, a scene or the command line.

use std::io::Read;
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use serde::Deserialize;

use super::hint;
use super::pattern::{self, Pattern};
use crate::data::{self, Data, DataFile};
use crate::stream::{self, Encoding, Start};
use crate::streamed::Streamed;
use crate::{ByteOrder, Geometry, RawLayout, Selection, Volume, VolumeError, VoxelType, Voxels};
use relume_base::number::{in_words, line_and_column};
use relume_base::progress::Progress;

/// Largest size of a sidecar in bytes; a layout is a few lines. The TOML parser takes a hundred times as much memory.
const LONGEST_SIDECAR: u64 = 1 << 16;

impl RawLayout {
    /// Reads a sidecar: the keys of a layout, at the top level or in a table `[volume]`.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Open`], [`VolumeError::Read`], and [`VolumeError::Sidecar`] with line and column if the text is
    /// not a layout.
    pub fn from_sidecar(path: &Path) -> Result<Self, VolumeError> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Wrapped {
            volume: RawLayout,
        }
        let mut text = String::new();
        let read = stream::open(path)?.take(LONGEST_SIDECAR).read_to_string(&mut text);
        read.map_err(|source| stream::failed(path, source))?;
        let wrong = |error: toml::de::Error| {
            let place = line_and_column(&text, error.span().map_or(0, |span| span.start));
            VolumeError::Sidecar { path: path.to_owned(), place, problem: in_words(error.message()) }
        };
        let table: toml::Table = toml::from_str(&text).map_err(wrong)?;
        let layout = if table.contains_key("volume") {
            toml::from_str::<Wrapped>(&text).map(|wrapped| wrapped.volume)
        } else {
            toml::from_str(&text)
        };
        layout.map_err(wrong)
    }
}

/// Reads the volume that `layout` describes; its `file` is relative to the folder `base`.
pub(crate) fn read(
    layout: &RawLayout,
    base: &Path,
    selection: &Selection,
    progress: &dyn Progress,
) -> Result<Volume, VolumeError> {
    let streamed = streamed(layout, base, selection)?;
    let source_name = base.join(layout.file.iter().collect::<PathBuf>()).display().to_string();
    streamed.read(&source_name, selection, progress)
}

/// The volume that `layout` describes, before its voxels are read; as [`read`].
pub(crate) fn streamed(layout: &RawLayout, base: &Path, selection: &Selection) -> Result<Streamed, VolumeError> {
    let Some(file) = &layout.file else {
        let problem = "the layout names no file of voxels; add the key file".to_owned();
        return Err(VolumeError::Layout { source_name: base.display().to_string(), problem });
    };
    let source_name = base.join(file).display().to_string();
    let wrong = |problem| VolumeError::Layout { source_name: source_name.clone(), problem };
    let stated = Selection { component: layout.component, time: layout.time, ..Selection::default() };
    selection.or(&stated).only(&source_name)?;
    let geometry = Geometry::new(
        &source_name,
        layout.dims,
        DVec3::from_array(layout.spacing),
        DVec3::from_array(layout.origin),
        DMat3::from_cols_array(&layout.direction),
    )?;
    let [nx, ny, nz] = layout.dims;
    // A name with a per cent sign is a pattern, unless a file of exactly this name exists.
    let name = file.to_string_lossy();
    let files = if layout.slices.is_some() || name.contains('%') && !base.join(file).exists() {
        let last = i64::try_from(nz).unwrap_or(i64::MAX);
        let range = match layout.slices.as_deref() {
            None => [1, last, 1],
            Some(&[first, last]) => [first, last, 1],
            Some(&[first, last, step]) => [first, last, step],
            Some(other) => {
                return Err(wrong(format!("slices = {other:?} should be [first, last] or [first, last, step]")));
            }
        };
        let pattern = Pattern::parse(&name).map_err(wrong)?;
        let numbers = pattern::numbers(range, nz).map_err(wrong)?;
        numbers.map(|number| DataFile::found(base.join(pattern.name(number)), nx * ny)).collect::<Result<_, _>>()?
    } else {
        vec![DataFile { path: base.join(file), numbers: geometry.voxels() }]
    };
    let data = Data {
        files,
        start: Start::at(layout.header_bytes),
        encoding: Encoding::Raw,
        voxel_type: layout.voxel_type,
        byte_order: layout.byte_order,
        picks: Vec::new(),
        alone: true,
    };
    let (files, unit, downsample) = (data.paths(), layout.unit, layout.downsample);
    let dims = if downsample.is_some() { Err("its sidecar averages blocks of voxels") } else { Ok(layout.dims) };
    let finish = move |voxels: Voxels, mut notes: Vec<String>| {
        let value = |at| voxels.value(at).unwrap_or(f64::NAN);
        if !voxels.is_empty()
            && let Some([x, y, z]) = hint::better(value, voxels.len(), [nx, ny, nz])
        {
            notes.push(format!(
                "{source_name}: neighbouring rows and slices are more alike with dims {x}×{y}×{z} than with the stated \
                 {nx}×{ny}×{nz}; if the picture is sheared or striped, try these dims"
            ));
        }
        let mut volume = Volume::of_voxels(&source_name, voxels, geometry)?;
        (volume.files, volume.notes, volume.unit) = (files, notes, unit);
        match downsample {
            Some(blocks) => volume.downsample(blocks),
            None => Ok(volume),
        }
    };
    Ok(Streamed { data, halves: false, dims, notes: Vec::new(), finish: Box::new(finish) })
}

/// Reads the volume that the sidecar `path` describes; without the key `file`, `NAME.toml` describes `NAME`.
pub(crate) fn read_sidecar(path: &Path, selection: &Selection, progress: &dyn Progress) -> Result<Volume, VolumeError> {
    streamed_by_sidecar(path, selection)?.read(&path.display().to_string(), selection, progress)
}

/// The volume that the sidecar `path` describes, before its voxels are read.
pub(crate) fn streamed_by_sidecar(path: &Path, selection: &Selection) -> Result<Streamed, VolumeError> {
    let mut layout = RawLayout::from_sidecar(path)?;
    if let Some(file) = &layout.file {
        data::beside(path, &file.to_string_lossy())?;
    }
    layout.file = layout.file.or_else(|| path.file_stem().map(PathBuf::from));
    streamed_by(path, &layout, selection)
}

/// Reads a file of headerless voxels by its sidecar in the same folder, `NAME.raw.toml` or `NAME.toml`.
pub(crate) fn read_beside_sidecar(
    path: &Path,
    selection: &Selection,
    progress: &dyn Progress,
) -> Result<Volume, VolumeError> {
    streamed_beside_sidecar(path, selection)?.read(&path.display().to_string(), selection, progress)
}

/// The sidecar beside the file of voxels `path`, if there is one.
pub(crate) fn sidecar(path: &Path) -> Option<PathBuf> {
    sidecars(path).into_iter().find(|sidecar| sidecar.exists())
}

/// Places of the sidecar of the file of voxels `path`.
fn sidecars(path: &Path) -> [PathBuf; 2] {
    let mut appended = path.as_os_str().to_owned();
    appended.push(".toml");
    [PathBuf::from(appended), path.with_extension("toml")]
}

/// The volume of a file of headerless voxels, before these are read; as [`read_beside_sidecar`].
pub(crate) fn streamed_beside_sidecar(path: &Path, selection: &Selection) -> Result<Streamed, VolumeError> {
    let name = PathBuf::from(path.file_name().unwrap_or_default());
    let Some(sidecar) = sidecar(path) else {
        // A missing file is reported before a missing sidecar.
        let file = stream::open(path)?;
        let bytes = file.metadata().map_err(|source| stream::failed(path, source))?.len();
        let [sidecar, _] = sidecars(path);
        let by_name = RawLayout::guessed(&name.to_string_lossy(), bytes);
        // A cube may be a guess by the size alone.
        let is_named = by_name.as_ref().is_some_and(|RawLayout { dims: [x, y, z], .. }| x != y || y != z);
        let mut guesses = if is_named { Vec::new() } else { guessed_by_content(path, bytes) };
        if guesses.is_empty() {
            guesses.extend(by_name);
        }
        return Err(VolumeError::NoLayout { path: path.to_owned(), sidecar, bytes, guesses });
    };
    let mut layout = RawLayout::from_sidecar(&sidecar)?;
    if let Some(other) = layout.file.as_ref().filter(|&file| *file != name) {
        let problem = format!(
            "the sidecar describes {other}, not {name}; open the sidecar itself to read {other}",
            other = other.display(),
            name = name.display()
        );
        return Err(VolumeError::Layout { source_name: sidecar.display().to_string(), problem });
    }
    layout.file = Some(name);
    streamed_by(&sidecar, &layout, selection)
}

/// Bytes from the beginning of a file by which its dimensions are guessed.
const EXAMINED: u64 = 1 << 26;
/// Neighbours along the three axes of a guess differ together less than this fraction of voxels that are far apart.
const ALIKE: f64 = 0.75;

/// Guesses at the layout of the file `path` by the likeness of neighbours along its axes, the best first.
fn guessed_by_content(path: &Path, bytes: u64) -> Vec<RawLayout> {
    let mut beginning = Vec::new();
    if stream::open(path).ok().and_then(|file| file.take(EXAMINED).read_to_end(&mut beginning).ok()).is_none() {
        return Vec::new();
    }
    let little = |at: usize| Some(u16::from_le_bytes(*beginning.get(2 * at..)?.first_chunk()?));
    let big = |at: usize| Some(u16::from_be_bytes(*beginning.get(2 * at..)?.first_chunk()?));
    let float = |at: usize| Some(f32::from_le_bytes(*beginning.get(4 * at..)?.first_chunk()?));
    type Read<'a> = Box<dyn Fn(usize) -> f64 + 'a>;
    let mut readings: Vec<(VoxelType, ByteOrder, Read<'_>)> = vec![
        (VoxelType::U8, ByteOrder::Little, Box::new(|at| beginning.get(at).map_or(f64::NAN, |&it| it.into()))),
        (VoxelType::U16, ByteOrder::Little, Box::new(|at| little(at).map_or(f64::NAN, f64::from))),
        (VoxelType::U16, ByteOrder::Big, Box::new(|at| big(at).map_or(f64::NAN, f64::from))),
        (VoxelType::F32, ByteOrder::Little, Box::new(|at| float(at).map_or(f64::NAN, f64::from))),
    ];
    // Without a sign bit, signed numbers are the unsigned ones.
    let has_sign = |byte: usize| beginning.chunks_exact(2).any(|pair| pair[byte] >= 0x80);
    if has_sign(1) {
        let value = |at| little(at).map_or(f64::NAN, |it| it.cast_signed().into());
        readings.push((VoxelType::I16, ByteOrder::Little, Box::new(value)));
    }
    if has_sign(0) {
        let value = |at| big(at).map_or(f64::NAN, |it| it.cast_signed().into());
        readings.push((VoxelType::I16, ByteOrder::Big, Box::new(value)));
    }
    let of_type = |(voxel_type, byte_order, value): (VoxelType, ByteOrder, Read<'_>)| {
        let voxels = usize::try_from(bytes).unwrap_or_default();
        let voxels = if voxels.is_multiple_of(voxel_type.bytes()) { voxels / voxel_type.bytes() } else { 0 };
        let layout = move |(dims, ratio)| (RawLayout { byte_order, ..RawLayout::new(dims, voxel_type) }, ratio);
        hint::guessed(value, beginning.len() / voxel_type.bytes(), voxels).into_iter().map(layout)
    };
    let mut guesses: Vec<(RawLayout, f64)> =
        readings.into_iter().flat_map(of_type).filter(|(_, ratio)| *ratio < ALIKE).collect();
    guesses.sort_by(|one, two| one.1.total_cmp(&two.1));
    guesses.into_iter().take(hint::GUESSES).map(|(layout, _)| layout).collect()
}

/// The volume that `layout`, from the sidecar `path`, describes, before its voxels are read.
fn streamed_by(path: &Path, layout: &RawLayout, selection: &Selection) -> Result<Streamed, VolumeError> {
    let Streamed { data, halves, dims, notes, finish } =
        streamed(layout, path.parent().unwrap_or(Path::new("")), selection)?;
    let sidecar = path.to_owned();
    let with_sidecar = move |voxels, notes| {
        let mut volume = finish(voxels, notes)?;
        volume.files.push(sidecar);
        Ok(volume)
    };
    Ok(Streamed { data, halves, dims, notes, finish: Box::new(with_sidecar) })
}

#[cfg(test)]
#[expect(clippy::unwrap_used, reason = "a test fails by panicking")]
mod tests {
    use super::*;
    use crate::VoxelType;

    #[test]
    fn a_name_and_a_size_suggest_how_voxels_lie() {
        let guessed = |name: &str, bytes| RawLayout::guessed(name, bytes).map(|it| (it.dims, it.voxel_type));
        assert_eq!(guessed("foot_256x128x64_uint8.raw", 256 * 128 * 64), Some(([256, 128, 64], VoxelType::U8)));
        assert_eq!(guessed("8x8x8_unsigned_char.raw", 512), Some(([8; 3], VoxelType::U8)), "not a signed one");
        assert_eq!(
            guessed("byte_swapped_4x5x6_uint16.raw", 240),
            Some(([4, 5, 6], VoxelType::U16)),
            "the last that is one"
        );
        assert_eq!(guessed("CT-4x5x6.int16.dat", 240), Some(([4, 5, 6], VoxelType::I16)));
        assert_eq!(guessed("ct_4x5x6.raw", 240), Some(([4, 5, 6], VoxelType::U16)), "the size says how wide they are");
        assert_eq!(guessed("foot.raw", 1000), Some(([10; 3], VoxelType::U8)), "a cube");
        assert_eq!(guessed("foot.raw", 2000), Some(([10; 3], VoxelType::U16)), "a cube of wider ones");
        let behind = RawLayout::guessed("foot_4x5x6_uint8.raw", 129);
        assert_eq!(behind.map(|layout| layout.header_bytes), Some(9), "what comes before the voxels");
        for (name, bytes) in
            [("foot.raw", 1001), ("foot_4x5x6_uint8.raw", 119), ("foot_4x5x6.raw", 121), ("foot.raw", 0)]
        {
            assert_eq!(guessed(name, bytes), None, "{name} of {bytes} bytes");
        }
    }

    #[test]
    fn the_content_tells_signed_numbers_and_single_bytes() {
        let dims = [48, 40, 36];
        // A ball with a coarse texture: 0 outside, up to 3000 inside.
        let value = |at: usize| {
            let [x, y, z] = [at % dims[0], at / dims[0] % dims[1], at / (dims[0] * dims[1])];
            let off = [(x, 24), (y, 20), (z, 18)].map(|(at, middle)| at.abs_diff(middle).pow(2)).iter().sum::<usize>();
            u16::try_from(if off < 200 { 10 * (200 - off) + 10 * (x * y * z % 97) } else { 0 }).unwrap()
        };
        let voxels: Vec<u16> = (0..dims.iter().product()).map(value).collect();
        let folder = tempfile::tempdir().unwrap();
        let guess = |bytes: Vec<u8>| {
            let path = folder.path().join("v");
            std::fs::write(&path, &bytes).unwrap();
            let guesses = guessed_by_content(&path, bytes.len().try_into().unwrap());
            guesses.first().map(|it| (it.dims, it.voxel_type, it.byte_order))
        };
        let signed = |it: &u16| i16::try_from(*it).unwrap() - 1024;
        let little = voxels.iter().flat_map(|it| signed(it).to_le_bytes()).collect();
        assert_eq!(guess(little), Some((dims, VoxelType::I16, ByteOrder::Little)));
        let big = voxels.iter().flat_map(|it| signed(it).to_be_bytes()).collect();
        assert_eq!(guess(big), Some((dims, VoxelType::I16, ByteOrder::Big)));
        let unsigned = voxels.iter().flat_map(|it| it.to_le_bytes()).collect();
        assert_eq!(guess(unsigned), Some((dims, VoxelType::U16, ByteOrder::Little)));
        let bytes = voxels.iter().map(|it| u8::try_from(it / 12).unwrap()).collect();
        assert_eq!(guess(bytes), Some((dims, VoxelType::U8, ByteOrder::Little)));
    }

    #[test]
    fn more_bytes_than_can_be_counted_are_none() {
        let layout = RawLayout::new([usize::MAX, 1, 1], VoxelType::F64);
        assert_eq!(layout.bytes(), None);
        let layout = RawLayout { header_bytes: u64::MAX, ..RawLayout::new([1; 3], VoxelType::U8) };
        assert_eq!(layout.bytes(), None);
    }
}
