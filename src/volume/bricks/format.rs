//! A file of bricks: a fixed header, the bricks, a text, an index and the ranges of the macrocells.
//!
//! All numbers are little-endian. The fixed header has [`FIXED`] bytes: the letters `RELUMEBK`, the version, the bytes of the
//! text (u32 each), the place of the text, the number of bricks, the bytes of the macrocells (u64 each), and the CRC-32 of
//! text and index and of the macrocells of level 0. The bricks follow without gaps, slab by slab in the order of
//! `super::grid::slabs`, each x fastest; then the text (TOML), [`ENTRY`] bytes of index per brick, level by level, and the
//! macrocells (`super::cells`) level by level, which end the file. Files of version 1 have level 0 alone.

use std::path::Path;

use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

use super::cells::{self, CellRanges};
use super::grid::{BrickGrid, slabs};
use crate::statistics::{BINS, Extent, Measured};
use crate::stream::count;
use crate::{Geometry, LabelPreset, Presets, Unit, Volume, VolumeError, VoxelType, Window};

/// First bytes of a file of bricks.
pub(super) const MAGIC: [u8; 8] = *b"RELUMEBK";
/// Version that this program writes; it reads this one and those before.
const VERSION: u32 = 2;
/// Bytes before the first brick.
pub(super) const FIXED: usize = 64;
/// Bytes of a brick in the index.
const ENTRY: usize = 32;
/// Keys of metadata about the levels of a file.
pub(super) const LEVELS: [&str; 2] = ["pyramid", "level"];
/// Largest number of bytes of the text: the parser takes a hundred times as much memory.
const LONGEST_TEXT: usize = 1 << 18;
/// Largest number of bytes that LZ4 packs into one: a byte of length stands for 255 bytes.
const LZ4_LIMIT: u64 = 255;

/// Digest of the bytes of a part of the file: the checksum of gzip.
pub(super) fn digest(bytes: &[u8]) -> u32 {
    let mut crc = flate2::Crc::new();
    crc.update(bytes);
    crc.sum()
}

/// The error for the cache `path`.
pub(super) fn damaged(path: &Path, problem: String) -> VolumeError {
    VolumeError::Bricks { path: path.to_owned(), problem }
}

/// A brick in the file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Entry {
    /// Place of its first byte.
    pub(super) offset: u64,
    /// Its bytes: those of its voxels, or fewer of LZ4.
    pub(super) bytes: u32,
    /// [`digest`] of these bytes.
    pub(super) digest: u32,
    /// Smallest and largest finite stored value; NaN if there is none.
    pub(super) ends: [f64; 2],
}

/// Numbers of a header, one behind the other.
struct Numbers<'a>(&'a [u8]);

impl Numbers<'_> {
    fn next<const N: usize>(&mut self) -> [u8; N] {
        let (first, rest) = self.0.split_first_chunk().unwrap_or((&[0; N], &[]));
        self.0 = rest;
        *first
    }

    fn u32(&mut self) -> u32 {
        u32::from_le_bytes(self.next())
    }

    fn u64(&mut self) -> u64 {
        u64::from_le_bytes(self.next())
    }
}

impl Entry {
    fn to_bytes(self) -> [u8; ENTRY] {
        let mut bytes = [0; ENTRY];
        bytes[..8].copy_from_slice(&self.offset.to_le_bytes());
        bytes[8..12].copy_from_slice(&self.bytes.to_le_bytes());
        bytes[12..16].copy_from_slice(&self.digest.to_le_bytes());
        bytes[16..24].copy_from_slice(&self.ends[0].to_le_bytes());
        bytes[24..].copy_from_slice(&self.ends[1].to_le_bytes());
        bytes
    }

    fn of_bytes(bytes: &[u8]) -> Self {
        let mut numbers = Numbers(bytes);
        let (offset, length, digest) = (numbers.u64(), numbers.u32(), numbers.u32());
        Self { offset, bytes: length, digest, ends: [numbers.next(), numbers.next()].map(f64::from_le_bytes) }
    }
}

/// The fixed header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Fixed {
    version: u32,
    text_bytes: u32,
    text_at: u64,
    bricks: u64,
    cells_bytes: u64,
    text_digest: u32,
    cells_digest: u32,
}

impl Fixed {
    /// The fixed header, and text and index behind the bricks, which end at `text_at`; the macrocells of each level follow.
    pub(super) fn made(text_at: u64, text: &str, index: &[Entry], cells: &[Vec<u8>]) -> ([u8; FIXED], Vec<u8>) {
        let cells_bytes: usize = cells.iter().map(Vec::len).sum();
        let mut behind = text.as_bytes().to_vec();
        behind.extend(index.iter().flat_map(|entry| entry.to_bytes()));
        let mut bytes = [0; FIXED];
        bytes[..8].copy_from_slice(&MAGIC);
        bytes[8..12].copy_from_slice(&VERSION.to_le_bytes());
        // At most `LONGEST_TEXT`.
        bytes[12..16].copy_from_slice(&u32::try_from(text.len()).unwrap_or(u32::MAX).to_le_bytes());
        bytes[16..24].copy_from_slice(&text_at.to_le_bytes());
        bytes[24..32].copy_from_slice(&count(index.len()).to_le_bytes());
        bytes[32..40].copy_from_slice(&count(cells_bytes).to_le_bytes());
        bytes[40..44].copy_from_slice(&digest(&behind).to_le_bytes());
        bytes[44..48].copy_from_slice(&digest(&cells[0]).to_le_bytes());
        (bytes, behind)
    }

    /// Reads the fixed header of the cache `path` of `length` bytes, and compares its places with this length.
    pub(super) fn of_bytes(path: &Path, bytes: &[u8], length: u64) -> Result<Self, VolumeError> {
        let wrong = |problem: String| damaged(path, problem);
        if bytes.len() < FIXED || !bytes.starts_with(&MAGIC) {
            return Err(wrong("this is no file of bricks, or its beginning is damaged".to_owned()));
        }
        let mut numbers = Numbers(&bytes[MAGIC.len()..]);
        let version = numbers.u32();
        if !(1..=VERSION).contains(&version) {
            return Err(wrong(format!("the bricks have version {version}; this Relume reads versions 1 to {VERSION}")));
        }
        let text_bytes = numbers.u32();
        let [text_at, bricks, cells_bytes] = [numbers.u64(), numbers.u64(), numbers.u64()];
        let (text_digest, cells_digest) = (numbers.u32(), numbers.u32());
        let index_bytes = bricks.checked_mul(count(ENTRY));
        let behind = index_bytes.and_then(|bytes| bytes.checked_add(u64::from(text_bytes))?.checked_add(cells_bytes));
        let expected = behind.and_then(|bytes| bytes.checked_add(text_at)).unwrap_or(u64::MAX);
        if expected != length || text_at < count(FIXED) {
            return Err(wrong(format!("the file has {length} bytes, but its header makes it {expected} bytes long")));
        }
        if usize::try_from(text_bytes).is_ok_and(|bytes| bytes > LONGEST_TEXT) {
            return Err(wrong(format!("its text has {text_bytes} bytes; at most {LONGEST_TEXT} are read")));
        }
        Ok(Self { version, text_bytes, text_at, bricks, cells_bytes, text_digest, cells_digest })
    }

    /// Place and number of bytes of the text and the index.
    pub(super) fn text_and_index(&self) -> [u64; 2] {
        [self.text_at, u64::from(self.text_bytes) + self.bricks * count(ENTRY)]
    }

    /// Digest of text and index, with the digests of all bricks.
    pub(super) fn digest(&self) -> u32 {
        self.text_digest
    }

    /// Reads text and index of the cache `path` from the bytes of [`Self::text_and_index`].
    pub(super) fn parse(&self, path: &Path, bytes: &[u8]) -> Result<(Text, Vec<Level>), VolumeError> {
        let wrong = |problem: String| damaged(path, problem);
        let found = digest(bytes);
        if found != self.text_digest {
            return Err(wrong(format!(
                "text and index are damaged: their digest is {found:08x}, but should be {:08x}",
                self.text_digest
            )));
        }
        let (text, mut index) = bytes.split_at(bytes.len().min(usize::try_from(self.text_bytes).unwrap_or(usize::MAX)));
        let text = std::str::from_utf8(text).map_err(|_| wrong("its text is not UTF-8".to_owned()))?;
        let text: Text = toml::from_str(text).map_err(|error| wrong(format!("its text: {}", error.message())))?;
        let voxel_type = text.voxel_type(path)?;
        let mut grids = BrickGrid::levels(text.geometry(path, 0)?.dims);
        if self.version == 1 {
            grids.truncate(1);
        }
        let cells: Vec<usize> =
            grids.iter().map(|grid| CellRanges::bytes(cells::macrocells(grid.dims), voxel_type)).collect();
        let [bricks, cells_bytes] = [grids.iter().map(BrickGrid::bricks).sum(), cells.iter().sum::<usize>()];
        if count(bricks) != self.bricks || count(cells_bytes) != self.cells_bytes {
            let [x, y, z] = text.dims;
            return Err(wrong(format!(
                "{x}×{y}×{z} voxels have {bricks} bricks and {cells_bytes} bytes of macrocells, but the file has {} and {}",
                self.bricks, self.cells_bytes
            )));
        }
        let expected = grids.iter().skip(1).map(|grid| grid.dims);
        if !text.levels.iter().map(|level| level.dims).eq(expected.clone()) {
            let found: Vec<_> = text.levels.iter().map(|level| level.dims).collect();
            let expected: Vec<_> = expected.collect();
            return Err(wrong(format!("its coarser levels have {found:?} voxels, but should have {expected:?}")));
        }
        let mut levels = Vec::with_capacity(grids.len());
        let [first, length] = self.text_and_index();
        let mut cells_at = first + length;
        for (number, (&grid, &cells)) in grids.iter().zip(&cells).enumerate() {
            let (own, rest) = index.split_at(index.len().min(grid.bricks() * ENTRY));
            index = rest;
            levels.push(Level {
                grid,
                index: own.chunks_exact(ENTRY).map(Entry::of_bytes).collect(),
                cells: [cells_at, count(cells)],
                cells_digest: number.checked_sub(1).map_or(self.cells_digest, |coarser| text.levels[coarser].cells),
            });
            cells_at += count(cells);
        }
        self.check_places(path, &grids, &levels, voxel_type)?;
        Ok((text, levels))
    }

    /// Whether all bricks follow each other in the cache `path`, and may hold their voxels.
    fn check_places(
        &self,
        path: &Path,
        grids: &[BrickGrid],
        levels: &[Level],
        voxel_type: VoxelType,
    ) -> Result<(), VolumeError> {
        let wrong = |problem: String| damaged(path, problem);
        let mut end = count(FIXED);
        for [level, slab] in slabs(grids) {
            let Level { grid, index, .. } = &levels[level];
            for brick in grid.of_slab(slab) {
                let Entry { offset, bytes, .. } = index[brick];
                let whole = count(grid.voxels(brick) * voxel_type.bytes());
                let bytes = u64::from(bytes);
                let name = || name(level, brick);
                if offset != end {
                    let name = name();
                    let problem = format!("{name} begins at byte {offset}, but the one before it ends at byte {end}");
                    return Err(wrong(problem));
                }
                if bytes > whole || bytes.saturating_mul(LZ4_LIMIT) < whole {
                    let name = name();
                    let problem = format!("{name} has {bytes} bytes, which cannot hold {whole} bytes of voxels");
                    return Err(wrong(problem));
                }
                end += bytes;
            }
        }
        if end != self.text_at {
            return Err(wrong(format!("the bricks end at byte {end}, but the text begins at byte {}", self.text_at)));
        }
        Ok(())
    }
}

/// Name of a brick for messages.
pub(super) fn name(level: usize, brick: usize) -> String {
    if level == 0 { format!("brick {brick}") } else { format!("brick {brick} of level {level}") }
}

/// A level of resolution in the file.
#[derive(Clone, Debug)]
pub(super) struct Level {
    pub(super) grid: BrickGrid,
    /// Its bricks, x fastest.
    pub(super) index: Vec<Entry>,
    /// Place and number of bytes of its macrocells.
    pub(super) cells: [u64; 2],
    /// [`digest`] of these bytes.
    pub(super) cells_digest: u32,
}

/// A level as it was made.
#[derive(Clone, Debug)]
pub(super) struct LevelMade {
    pub(super) dims: [usize; 3],
    /// Statistics of its stored values.
    pub(super) measured: Measured,
    /// Their largest rounding error as f64.
    pub(super) rounded: f64,
    /// [`digest`] of its macrocells.
    pub(super) cells: u32,
}

/// File from which a cache was made.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Origin {
    /// Its path as given.
    pub(super) path: String,
    /// Its bytes.
    pub(super) bytes: u64,
    /// Seconds from 1970 to its last change.
    pub(super) modified: u64,
    /// Choice among its volumes, in words.
    pub(super) chosen: String,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Values {
    mean: f64,
    histogram: Vec<u64>,
    rounded: f64,
    extent: Extent,
}

impl Values {
    fn of(level: &LevelMade) -> Self {
        let Measured { extent, mean, histogram } = &level.measured;
        Self { extent: *extent, mean: *mean, histogram: histogram.to_vec(), rounded: level.rounded }
    }

    /// Statistics of the stored values of `dims` voxels of the cache `path`, and their largest rounding error as f64.
    fn measured(&self, path: &Path, dims: [usize; 3]) -> Result<(Measured, f64), VolumeError> {
        let Self { extent, mean, histogram, rounded } = self;
        let histogram: Option<[u64; BINS]> = histogram.as_slice().try_into().ok();
        let voxels = dims.iter().try_fold(1_u64, |product, &n| product.checked_mul(count(n)));
        let sum = extent.finite.checked_add(extent.not_a_number).and_then(|sum| sum.checked_add(extent.infinite));
        let ends = [extent.min, extent.max, *mean];
        let sound = extent.finite == 0 || ends.iter().all(|end| end.is_finite()) && extent.min <= extent.max;
        match histogram {
            Some(histogram) if sound && sum == voxels && rounded.is_finite() => {
                Ok((Measured { extent: *extent, mean: *mean, histogram }, *rounded))
            }
            _ => Err(damaged(path, format!("its statistics contradict each other: {extent:?}"))),
        }
    }
}

/// A level coarser than level 0.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredLevel {
    dims: [usize; 3],
    /// Digest of its macrocells.
    cells: u32,
    values: Values,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredWindow {
    name: String,
    low: f64,
    high: f64,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredLabel {
    value: i64,
    name: String,
    colour: Option<[f64; 3]>,
}

/// The description of a volume, as TOML.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Text {
    dims: [usize; 3],
    r#type: String,
    spacing: [f64; 3],
    origin: [f64; 3],
    direction: [f64; 9],
    anatomical: bool,
    unit: Option<String>,
    slope: f64,
    intercept: f64,
    components: usize,
    component_names: Vec<String>,
    has_labels: bool,
    colour: Option<[f64; 3]>,
    metadata: Vec<[String; 2]>,
    assumed_spacing: Option<String>,
    notes: Vec<String>,
    source: Origin,
    values: Values,
    windows: Vec<StoredWindow>,
    labels: Vec<StoredLabel>,
    #[serde(default)]
    levels: Vec<StoredLevel>,
}

impl Text {
    /// The text of a `volume` of these `levels`, the finest first, which was made from `source`. Metadata that are too long
    /// are left out, and those of levels of the source.
    pub(super) fn of(volume: &Volume, levels: &[LevelMade], source: Origin) -> Result<String, String> {
        let of_levels = volume.selection.level.is_some();
        let metadata = volume.metadata.iter().filter(|(key, _)| !(of_levels && LEVELS.contains(&key.as_str())));
        let windows = volume.presets.windows.iter();
        let labels = volume.presets.labels.iter();
        let mut text = Self {
            dims: volume.geometry.dims,
            r#type: volume.voxels.type_name().to_owned(),
            spacing: volume.geometry.spacing.to_array(),
            origin: volume.geometry.origin.to_array(),
            direction: volume.geometry.direction.to_cols_array(),
            anatomical: volume.anatomical,
            unit: volume.unit.map(|unit| unit.to_string()),
            slope: volume.slope,
            intercept: volume.intercept,
            components: volume.components,
            component_names: volume.component_names.clone(),
            has_labels: volume.has_labels,
            colour: volume.presets.colour,
            metadata: metadata.map(|(key, value)| [key.clone(), value.clone()]).collect(),
            assumed_spacing: volume.assumed_spacing.clone(),
            notes: volume.notes.clone(),
            source,
            values: Values::of(&levels[0]),
            windows: windows
                .map(|Window { name, low, high }| StoredWindow { name: name.clone(), low: *low, high: *high })
                .collect(),
            labels: labels
                .map(|LabelPreset { value, name, colour }| StoredLabel {
                    value: *value,
                    name: name.clone(),
                    colour: *colour,
                })
                .collect(),
            levels: levels[1..]
                .iter()
                .map(|level| StoredLevel { dims: level.dims, cells: level.cells, values: Values::of(level) })
                .collect(),
        };
        let written = |text: &Self| toml::to_string(text).map_err(|error| error.to_string());
        let all = written(&text)?;
        if all.len() <= LONGEST_TEXT {
            return Ok(all);
        }
        text.notes.push(format!("{}: its metadata are too long for a file of bricks", volume.source));
        text.metadata.clear();
        let rest = written(&text)?;
        if rest.len() <= LONGEST_TEXT { Ok(rest) } else { Err(format!("the text has {} bytes", rest.len())) }
    }

    pub(super) fn voxel_type(&self, path: &Path) -> Result<VoxelType, VolumeError> {
        self.r#type.parse().map_err(|error: VolumeError| damaged(path, error.to_string()))
    }

    /// The grid of a level of the volume.
    pub(super) fn geometry(&self, path: &Path, level: usize) -> Result<Geometry, VolumeError> {
        let [spacing, origin] = [self.spacing, self.origin].map(DVec3::from_array);
        let direction = DMat3::from_cols_array(&self.direction);
        let source = path.display().to_string();
        let finest = Geometry::new(&source, self.dims, spacing, origin, direction)?;
        (0..level).try_fold(finest, |finer, _| finer.halved(&source))
    }

    /// Statistics of the stored values of a level, and their largest rounding error as f64.
    pub(super) fn measured(&self, path: &Path, level: usize) -> Result<(Measured, f64), VolumeError> {
        match level.checked_sub(1).map(|coarser| &self.levels[coarser]) {
            None => self.values.measured(path, self.dims),
            Some(StoredLevel { dims, values, .. }) => values.measured(path, *dims),
        }
    }

    /// The volume of a level of the cache `path`, without its voxels.
    pub(super) fn volume(&self, path: &Path, level: usize) -> Result<Volume, VolumeError> {
        let wrong = |what: &str| damaged(path, format!("its text has no usable {what}"));
        let voxel_type = self.voxel_type(path)?;
        let none = voxel_type.no_voxels();
        let mut volume = Volume::of_voxels(&path.display().to_string(), none, self.geometry(path, level)?)?;
        if !(self.slope.is_finite() && self.intercept.is_finite()) {
            return Err(wrong("slope and intercept"));
        }
        volume.anatomical = self.anatomical;
        volume.unit = match &self.unit {
            Some(name) => Some(Unit::named(name).ok_or_else(|| wrong("unit"))?),
            None => None,
        };
        (volume.slope, volume.intercept) = (self.slope, self.intercept);
        (volume.components, volume.component_names) = (self.components, self.component_names.clone());
        volume.has_labels = self.has_labels;
        let is_colour = |colour: &[f64; 3]| colour.iter().all(|part| (0.0..=1.0).contains(part));
        let windows = self.windows.iter();
        let labels = self.labels.iter();
        volume.presets = Presets {
            windows: windows
                .map(|it| Window::new(&it.name, it.low, it.high).ok_or_else(|| wrong("windows")))
                .collect::<Result<_, _>>()?,
            labels: labels
                .map(|it| LabelPreset { value: it.value, name: it.name.clone(), colour: it.colour.filter(is_colour) })
                .collect(),
            colour: self.colour.filter(is_colour),
        };
        volume.metadata = self.metadata.iter().map(|[key, value]| (key.clone(), value.clone())).collect();
        let Origin { path: source, bytes, modified, chosen } = &self.source;
        let made = format!("{source}, {bytes} bytes, changed {modified} s after 1970{chosen}");
        volume.metadata.push(("bricks of".to_owned(), made));
        volume.assumed_spacing.clone_from(&self.assumed_spacing);
        volume.notes.clone_from(&self.notes);
        volume.files = vec![path.to_owned()];
        Ok(volume)
    }
}
