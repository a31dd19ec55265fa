//! Pages of a TIFF file: their size and type, and where their strips or tiles lie.

use std::fmt;
use std::sync::Arc;

use super::directory::{Directory, Entry, Tiff, tag};
use crate::data;
use crate::stream::{DEFLATE_LIMIT, JPEG_LIMIT, count};
use crate::{VolumeError, VoxelType};

/// Type of the stored numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Sample {
    /// Numbers of whole bytes.
    Number(VoxelType),
    /// Floats of 16 bits.
    Half,
    /// Whole numbers of 1, 2 or 4 bits; the first one is in the highest bits of a byte.
    Bits(u8),
}

impl Sample {
    /// Type of the voxels as they are decoded; floats of 16 bits are decoded as their bits.
    pub(crate) fn voxel_type(self) -> VoxelType {
        match self {
            Self::Number(voxel_type) => voxel_type,
            Self::Half => VoxelType::U16,
            Self::Bits(_) => VoxelType::U8,
        }
    }

    pub(super) fn bits(self) -> usize {
        match self {
            Self::Bits(bits) => usize::from(bits),
            other => 8 * other.voxel_type().bytes(),
        }
    }
}

/// Size and type of a page. The pages of a volume are alike.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Picture {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Numbers per voxel.
    pub(crate) samples: usize,
    pub(crate) sample: Sample,
    /// Code of what the samples mean; 2 is RGB.
    pub(crate) photometric: u64,
}

impl fmt::Display for Picture {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}×{} voxels of ", self.width, self.height)?;
        if self.samples > 1 {
            write!(formatter, "{} × ", self.samples)?;
        }
        match self.sample {
            Sample::Number(voxel_type) => write!(formatter, "{voxel_type}"),
            Sample::Half => formatter.write_str("float16"),
            Sample::Bits(bits) => write!(formatter, "{bits} bit{}", if bits == 1 { "" } else { "s" }),
        }
    }
}

impl Picture {
    /// Whether `other` has as many voxels of the same type.
    pub(crate) fn is_like(&self, other: &Self) -> bool {
        Self { photometric: 0, ..*self } == Self { photometric: 0, ..*other }
    }

    /// Name of the components, for messages.
    pub(crate) fn kind(&self) -> &'static str {
        match (self.photometric, self.samples) {
            (2 | 6, 3) => "RGB",
            (2, 4) => "RGBA",
            (5, 4) => "CMYK",
            (8..=10, 3) => "Lab",
            _ => "",
        }
    }
}

/// Compression of strips and tiles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Compression {
    None,
    Lzw,
    Deflate,
    PackBits,
    Zstd,
    Jpeg,
}

impl Compression {
    /// The compression with this code, or the reason for a refusal.
    fn of(code: u64) -> Result<Self, String> {
        let name = match code {
            1 => return Ok(Self::None),
            5 => return Ok(Self::Lzw),
            7 => return Ok(Self::Jpeg),
            8 | 32946 => return Ok(Self::Deflate),
            32773 => return Ok(Self::PackBits),
            50000 | 34926 => return Ok(Self::Zstd),
            2..=4 => "fax",
            6 => "JPEG of TIFF 6.0",
            32809 => "ThunderScan",
            33003 | 33005 | 34712 => "JPEG 2000",
            34887 => "LERC",
            34892 => "lossy JPEG of DNG",
            34925 => "LZMA",
            34927 | 50001 => "WebP",
            34933 => "PNG",
            34934 | 22610 => "JPEG XR",
            50002 | 52546 => "JPEG XL",
            _ => "an unknown one",
        };
        Err(format!(
            "Relume does not read compression {code} ({name}); it reads none, LZW, deflate, PackBits, zstd and JPEG"
        ))
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::None => "uncompressed",
            Self::Lzw => "LZW",
            Self::Deflate => "deflate",
            Self::PackBits => "PackBits",
            Self::Zstd => "zstd",
            Self::Jpeg => "JPEG",
        }
    }

    /// Largest number of bytes per compressed byte.
    pub(super) fn packing(self) -> u64 {
        match self {
            Self::None => 1,
            // A code of 12 bits yields at most as many bytes as there are codes.
            Self::Lzw => 4096,
            Self::Deflate => DEFLATE_LIMIT,
            // Two bytes yield at most 128.
            Self::PackBits => 64,
            // A block of 4 bytes yields at most 128 KiB.
            Self::Zstd => 1 << 15,
            Self::Jpeg => JPEG_LIMIT,
        }
    }
}

/// Difference that was stored in place of the numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Predictor {
    None,
    /// From the number to the left.
    Horizontal,
    /// From the byte to the left, after the bytes of floats were sorted by significance.
    Float,
}

/// Storage of the numbers of a page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Coding {
    pub(super) picture: Picture,
    pub(super) compression: Compression,
    pub(super) predictor: Predictor,
    /// Whether each sample has strips of its own.
    pub(super) is_planar: bool,
    /// Size of a strip or a tile in voxels. A strip is as wide as the page.
    pub(super) chunk: [usize; 2],
    pub(super) is_tiled: bool,
}

impl Coding {
    /// Strips or tiles along x and y.
    pub(super) fn chunks(&self) -> [usize; 2] {
        let Picture { width, height, .. } = self.picture;
        [width.div_ceil(self.chunk[0]), height.div_ceil(self.chunk[1])]
    }

    /// Numbers per voxel of a strip or a tile.
    pub(super) fn interleaved(&self) -> usize {
        if self.is_planar { 1 } else { self.picture.samples }
    }

    /// Bytes of a row of a strip or a tile.
    pub(super) fn row_bytes(&self) -> usize {
        (self.chunk[0] * self.interleaved() * self.picture.sample.bits()).div_ceil(8)
    }

    /// Rows of the page in row `band` of strips or tiles.
    pub(super) fn rows(&self, band: usize) -> usize {
        self.chunk[1].min(self.picture.height - band * self.chunk[1])
    }

    /// Rows that a strip or a tile of row `band` stores: tiles are always full.
    pub(super) fn stored_rows(&self, band: usize) -> usize {
        if self.is_tiled { self.chunk[1] } else { self.rows(band) }
    }

    /// Whether the decoded bytes of a strip or tile are voxels in their place, apart from byte order and predictor.
    pub(super) fn is_direct(&self) -> bool {
        self.interleaved() == 1
            && self.chunk[0] == self.picture.width
            && self.predictor != Predictor::Float
            && !matches!(self.picture.sample, Sample::Bits(_))
    }

    /// Whether the bytes of a strip are voxels in their place, apart from byte order.
    pub(super) fn is_as_it_is(&self) -> bool {
        self.is_direct() && self.compression == Compression::None
    }

    /// Bytes that the decoded page has at least, of which one component is read.
    pub(super) fn bytes(&self) -> u64 {
        let [across, _] = self.chunks();
        let rows = count(self.picture.height).saturating_mul(count(across));
        let (least, pages) = if self.is_tiled {
            // Tiles may be wider than the page.
            let row = self.picture.width * self.interleaved() * self.picture.sample.bits();
            (count(row.div_ceil(8)), count(self.picture.height))
        } else {
            (count(self.row_bytes()), rows)
        };
        least.saturating_mul(pages)
    }
}

/// Bytes of uncompressed strips that are read together.
pub(super) const GROUP: usize = 1 << 20;

/// Positions of the strips or tiles of a page.
#[derive(Clone, Copy, Debug)]
pub(super) enum Chunks {
    /// Values of tags: offsets, and bytes if they are stated.
    Listed { offsets: Entry, bytes: Option<Entry> },
    /// The page is one strip at this offset.
    Whole(u64),
}

/// A page that can be decoded.
#[derive(Clone, Debug)]
pub(crate) struct Page {
    /// Index of its file among those of the volume.
    pub(crate) file: usize,
    /// Number of the page in its file, from 1, for messages.
    pub(super) number: usize,
    pub(super) coding: Arc<Coding>,
    pub(super) chunks: Chunks,
    /// Tables that all JPEG strips share.
    pub(super) tables: Option<Entry>,
    /// Offsets of the directories of coarser levels.
    pub(super) levels: Option<Entry>,
}

impl Page {
    pub(crate) fn picture(&self) -> &Picture {
        &self.coding.picture
    }
}

/// Reads what a page needs from its directory.
pub(super) struct Reading<'a> {
    pub(super) tiff: &'a mut Tiff,
    pub(super) directory: &'a Directory,
}

/// A tag of a page for messages: many pages have many tags, and nearly all are right.
#[derive(Clone, Copy)]
struct Place<'a> {
    page: usize,
    name: &'a str,
}

impl fmt::Display for Place<'_> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "page {}, {}", self.page, self.name)
    }
}

impl Reading<'_> {
    fn place<'n>(&self, name: &'n str) -> Place<'n> {
        Place { page: self.directory.page, name }
    }

    fn wrong(&self, name: &str, problem: String) -> VolumeError {
        self.tiff.wrong(self.place(name), problem)
    }

    /// The first value of a tag.
    fn whole(&mut self, tag: u16, name: &str) -> Result<Option<u64>, VolumeError> {
        let Some(entry) = self.directory.find(tag) else { return Ok(None) };
        let place = self.place(name);
        let value = self.tiff.whole(entry, 0, place)?;
        match value {
            Some(value) => Ok(Some(value)),
            None => Err(self.wrong(name, "the tag has no whole number".to_owned())),
        }
    }

    fn or(&mut self, tag: u16, name: &str, otherwise: u64) -> Result<u64, VolumeError> {
        Ok(self.whole(tag, name)?.unwrap_or(otherwise))
    }

    /// Whether the page is a smaller copy or a mask of another one.
    pub(super) fn is_extra(&mut self) -> Result<bool, VolumeError> {
        Ok(self.or(tag::SUBFILE_TYPE, "NewSubfileType", 0)? & 0b101 != 0)
    }

    /// The page; `file` is the index of the file, and `like` a page that may share its coding.
    pub(super) fn page(&mut self, file: usize, like: Option<&Page>) -> Result<Page, VolumeError> {
        let picture = self.picture()?;
        let coding = self.coding(picture)?;
        let chunks = self.chunks(&coding)?;
        let (coding, chunks) = self.joined(coding, chunks)?;
        let coding = match like {
            Some(page) if *page.coding == coding => Arc::clone(&page.coding),
            _ => Arc::new(coding),
        };
        let (tables, levels) = (self.directory.find(tag::JPEG_TABLES), self.directory.find(tag::SUB_DIRECTORIES));
        Ok(Page { file, number: self.directory.page, coding, chunks, tables, levels })
    }

    /// A length that a tag states, at least 1.
    fn length(&mut self, tag: u16, name: &str) -> Result<usize, VolumeError> {
        let stated = self.whole(tag, name)?;
        match stated.map(usize::try_from) {
            None => Err(self.wrong(name, "the tag is missing".to_owned())),
            // TIFF has lengths of 32 bits.
            Some(Ok(length)) if length > 0 && u32::try_from(length).is_ok() => Ok(length),
            Some(_) => {
                Err(self
                    .wrong(name, format!("the length is {}; it must be from 1 to {}", stated.unwrap_or(0), u32::MAX)))
            }
        }
    }

    /// The values of a tag for all samples, which must be equal.
    fn equal(&mut self, tag: u16, name: &str, samples: u64, otherwise: u64) -> Result<u64, VolumeError> {
        let first = self.or(tag, name, otherwise)?;
        let Some(entry) = self.directory.find(tag) else { return Ok(first) };
        let place = self.place(name);
        if entry.count.min(samples) > 1 {
            self.tiff.spend(entry, place)?;
        }
        for index in 1..entry.count.min(samples) {
            let other = self.tiff.whole(entry, index, place)?;
            if other != Some(first) {
                let other = other.unwrap_or(0);
                return Err(self.wrong(
                    name,
                    format!("sample 0 has {first}, but sample {index} {other}; Relume reads samples of one type"),
                ));
            }
        }
        Ok(first)
    }

    fn picture(&mut self) -> Result<Picture, VolumeError> {
        let width = self.length(tag::WIDTH, "ImageWidth")?;
        let height = self.length(tag::HEIGHT, "ImageLength")?;
        let stated = self.or(tag::SAMPLES, "SamplesPerPixel", 1)?;
        let samples = usize::try_from(stated).ok().filter(|samples| (1..=usize::from(u16::MAX)).contains(samples));
        let Some(samples) = samples else {
            return Err(self.wrong("SamplesPerPixel", format!("{stated} samples; there must be 1 to {}", u16::MAX)));
        };
        let bits = self.equal(tag::BITS, "BitsPerSample", stated, 1)?;
        let format = self.equal(tag::SAMPLE_FORMAT, "SampleFormat", stated, 1)?;
        let sample = match (format, bits) {
            (1 | 4, 1 | 2 | 4) => Sample::Bits(u8::try_from(bits).unwrap_or(1)),
            (1 | 4, 8) => Sample::Number(VoxelType::U8),
            (1 | 4, 16) => Sample::Number(VoxelType::U16),
            (1 | 4, 32) => Sample::Number(VoxelType::U32),
            (1 | 4, 64) => Sample::Number(VoxelType::U64),
            (2, 8) => Sample::Number(VoxelType::I8),
            (2, 16) => Sample::Number(VoxelType::I16),
            (2, 32) => Sample::Number(VoxelType::I32),
            (2, 64) => Sample::Number(VoxelType::I64),
            (3, 16) => Sample::Half,
            (3, 32) => Sample::Number(VoxelType::F32),
            (3, 64) => Sample::Number(VoxelType::F64),
            (5 | 6, _) => {
                return Err(self.wrong("SampleFormat", format!("Relume does not read complex numbers ({bits} bits)")));
            }
            _ => {
                let kind = match format {
                    1 | 4 => "whole numbers",
                    2 => "signed whole numbers",
                    3 => "floats",
                    _ => "numbers of an unknown format",
                };
                let problem = format!(
                    "Relume does not read {kind} of {bits} bits; it reads whole numbers of 1, 2, 4, 8, 16, 32 and 64 \
                     bits, signed ones of 8 to 64 and floats of 16, 32 and 64"
                );
                return Err(self.wrong("BitsPerSample", problem));
            }
        };
        let photometric = self.or(tag::PHOTOMETRIC, "PhotometricInterpretation", 1)?;
        Ok(Picture { width, height, samples, sample, photometric })
    }

    fn coding(&mut self, picture: Picture) -> Result<Coding, VolumeError> {
        let Picture { width, height, samples, sample, photometric } = picture;
        let code = self.or(tag::COMPRESSION, "Compression", 1)?;
        let compression = Compression::of(code).map_err(|problem| self.wrong("Compression", problem))?;
        let predictor = match self.or(tag::PREDICTOR, "Predictor", 1)? {
            1 => Predictor::None,
            // Predictors belong to these compressions only.
            _ if !matches!(compression, Compression::Lzw | Compression::Deflate | Compression::Zstd) => Predictor::None,
            2 if sample.bits() >= 8 => Predictor::Horizontal,
            3 if matches!(sample, Sample::Half | Sample::Number(VoxelType::F32 | VoxelType::F64)) => Predictor::Float,
            other => {
                let problem = format!(
                    "predictor {other} does not fit {picture}; Relume reads 1, 2 for whole bytes, and 3 for floats"
                );
                return Err(self.wrong("Predictor", problem));
            }
        };
        let is_planar = match self.or(tag::PLANAR, "PlanarConfiguration", 1)? {
            1 => false,
            2 => samples > 1,
            other => return Err(self.wrong("PlanarConfiguration", format!("{other} is not 1 or 2"))),
        };
        let order = self.or(tag::FILL_ORDER, "FillOrder", 1)?;
        if order != 1 {
            return Err(self.wrong("FillOrder", format!("{order}; Relume reads 1, the highest bit first")));
        }
        if photometric == 6 && compression != Compression::Jpeg {
            let problem = "YCbCr colours (6) without JPEG compression; Relume reads RGB and YCbCr in JPEG";
            return Err(self.wrong("PhotometricInterpretation", problem.to_owned()));
        }
        if compression == Compression::Jpeg
            && (sample != Sample::Number(VoxelType::U8) || !matches!(samples, 1 | 3 | 4))
        {
            return Err(
                self.wrong("Compression", format!("{picture} in JPEG; Relume reads 1, 3 or 4 samples of 8 bits"))
            );
        }
        let is_tiled = self.directory.find(tag::TILE_WIDTH).is_some();
        let chunk = if is_tiled {
            [self.length(tag::TILE_WIDTH, "TileWidth")?, self.length(tag::TILE_HEIGHT, "TileLength")?]
        } else {
            let all = u64::from(u32::MAX);
            let rows = self.or(tag::ROWS_PER_STRIP, "RowsPerStrip", all)?;
            let rows = usize::try_from(rows).ok().filter(|&rows| rows > 0);
            let rows = rows.ok_or_else(|| self.wrong("RowsPerStrip", "0 rows".to_owned()))?;
            [width, rows.min(height)]
        };
        data::check_size(self.tiff.path.display(), &[chunk[0], chunk[1], samples])?;
        data::check_size(self.tiff.path.display(), &[width, height, samples])?;
        Ok(Coding { picture, compression, predictor, is_planar, chunk, is_tiled })
    }

    fn chunks(&mut self, coding: &Coding) -> Result<Chunks, VolumeError> {
        let (offsets, bytes, names) = if coding.is_tiled {
            (tag::TILE_OFFSETS, tag::TILE_BYTES, ["TileOffsets", "TileByteCounts"])
        } else {
            (tag::STRIP_OFFSETS, tag::STRIP_BYTES, ["StripOffsets", "StripByteCounts"])
        };
        let (offsets, bytes) = (self.directory.find(offsets), self.directory.find(bytes));
        let Some(offsets) = offsets else {
            return Err(self.wrong(names[0], "the tag is missing".to_owned()));
        };
        if bytes.is_none() && coding.compression != Compression::None {
            return Err(self.wrong(names[1], "the tag is missing".to_owned()));
        }
        let [across, down] = coding.chunks();
        let planes = if coding.is_planar { coding.picture.samples } else { 1 };
        let wanted = count(across).saturating_mul(count(down)).saturating_mul(count(planes));
        for (entry, name) in [Some(offsets), bytes].into_iter().zip(names) {
            let Some(entry) = entry else { continue };
            self.tiff.inside(entry, self.place(name))?;
            if entry.count < wanted {
                let what = if coding.is_tiled { "tiles" } else { "strips" };
                let problem = format!("{} values, but the page has {wanted} {what}", entry.count);
                return Err(self.wrong(name, problem));
            }
        }
        Ok(Chunks::Listed { offsets, bytes })
    }

    /// A page of few small strips that are voxels as they are, and follow each other, as a page of one strip: its decoder
    /// then needs nothing but their place.
    fn joined(&mut self, coding: Coding, chunks: Chunks) -> Result<(Coding, Chunks), VolumeError> {
        /// More strips are looked up when they are decoded.
        const MOST: u64 = 64;
        let [across, down] = coding.chunks();
        let Chunks::Listed { offsets, bytes } = chunks else { return Ok((coding, chunks)) };
        let is_small = coding.bytes() <= count(GROUP) && count(down) <= MOST && !coding.is_tiled;
        let is_near = self.tiff.is_near(0, offsets) && bytes.is_none_or(|bytes| self.tiff.is_near(1, bytes));
        if !(coding.is_as_it_is() && !coding.is_planar && across == 1 && is_small && is_near) {
            return Ok((coding, chunks));
        }
        let place = self.place("strips");
        let (mut first, mut end) = (None, 0);
        for strip in 0..down {
            let wanted = count(coding.row_bytes() * coding.rows(strip));
            let at = self.tiff.next_whole(0, offsets, count(strip), place)?;
            let stated = bytes.map(|bytes| self.tiff.next_whole(1, bytes, count(strip), place)).transpose()?;
            let follows = at.is_some_and(|at| first.is_none() || at == end);
            let (Some(at), true) = (at, follows && stated.is_none_or(|stated| stated == Some(wanted))) else {
                return Ok((coding, chunks));
            };
            first = first.or(Some(at));
            end = at.saturating_add(wanted);
        }
        let whole = [coding.picture.width, coding.picture.height];
        Ok(first.map_or((coding, chunks), |at| (Coding { chunk: whole, ..coding }, Chunks::Whole(at))))
    }
}
