//! `relume bench load`: speed of reading volumes, compared with only decoding their bytes.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use bzip2::bufread::MultiBzDecoder;
use flate2::Compression;
use flate2::bufread::{MultiGzDecoder, ZlibDecoder};
use flate2::write::GzEncoder;
use serde::Serialize;
use serde_json::json;

use crate::measure::{Stopwatch, Summary, peak_mb};
use crate::progress::Progress;
use crate::volume::{self, Phantom, Selection, Volume, VolumeError, Voxels};

use super::frames::Times;
use super::{CliError, Report};

/// Voxels along each side of the generated volume.
const SIDE: usize = 256;

/// Bytes decoded at a time and discarded; small enough for the cache.
const SCRATCH: usize = 1 << 16;

/// Times of opening a volume and of only decoding its bytes, measured in turn.
#[derive(Serialize)]
struct Row {
    volume: String,
    /// Compression of the decoded bytes; `None` if the files are uncompressed and only read.
    stream: Option<&'static str>,
    /// Voxels in memory, in MB (10⁶ bytes).
    voxels_mb: f64,
    open: Times,
    bare: Times,
    /// MB of voxels per second of CPU time.
    open_mb_s: f64,
    /// MB decoded per second of CPU time.
    bare_mb_s: f64,
    /// CPU time of opening over that of decoding; `None` if fewer bytes were decoded than the voxels have.
    ratio: Option<f64>,
    /// Peak memory of the process after opening the volume once, in MB.
    peak_mb: Option<f64>,
}

/// Reads `file` `times` times after one warm-up; without a file, a gzip NRRD of 256³ 16-bit voxels.
pub(super) fn run(
    file: Option<&Path>,
    selection: &Selection,
    times: u32,
    progress: &dyn Progress,
) -> Result<Report, CliError> {
    let row = match file {
        Some(file) => measure(file, selection, times, progress)?,
        None => {
            let folder = tempfile::tempdir().map_err(|error| failed(&std::env::temp_dir(), &error))?;
            let path = folder.path().join("engine.nrrd");
            write_phantom(&path)?;
            measure(&path, &Selection::default(), times, progress)?
        }
    };
    let text = format!(
        "{}, {:.1} MB of voxels; medians of {times}\n\
         {:<29}  {:>7}  {:>7}  {:>5}\n\
         {:<29}  {:>7.1}  {:>7.1}  {:>5.0}\n\
         {:<29}  {:>7.1}  {:>7.1}  {:>5.0}\n\
         {}peak memory of the program {:.1} MB\n",
        row.volume,
        row.voxels_mb,
        "",
        "wall ms",
        "cpu ms",
        "MB/s",
        "opening it",
        median(row.open.wall_ms),
        median(row.open.cpu_ms),
        row.open_mb_s,
        row.stream.map_or("reading its files' bytes".to_owned(), |stream| format!("inflating its {stream} stream")),
        median(row.bare.wall_ms),
        median(row.bare.cpu_ms),
        row.bare_mb_s,
        row.ratio.map_or_else(String::new, |ratio| format!("ratio {ratio:.2}, ")),
        row.peak_mb.unwrap_or(f64::NAN),
    );
    Ok(Report { text, json: json!({ "load": row }) })
}

fn failed(path: &Path, error: &io::Error) -> CliError {
    CliError::Failed(format!("{}: {error}", path.display()))
}

fn median(times: Option<Summary>) -> f64 {
    times.map_or(f64::NAN, |times| times.median)
}

fn measure(path: &Path, selection: &Selection, times: u32, progress: &dyn Progress) -> Result<Row, CliError> {
    let (mut opens, mut bares) = (Vec::new(), Vec::new());
    let (mut voxel_bytes, mut bare_bytes, mut stream, mut peak) = (0, 0, None, None);
    for time in 0..=times {
        let clock = Stopwatch::start();
        let Volume { voxels, files, .. } = volume::open(path, selection, progress)?;
        let open = clock.read();
        voxel_bytes = voxels.bytes().len();
        drop(voxels);

        // Before the measurement itself allocates anything.
        peak = peak.or_else(peak_mb);
        let packed = volume::packed_blocks(path, selection, progress)?;
        let data = payload(files).map_err(|error| failed(path, &error))?;
        let clock = Stopwatch::start();
        bare_bytes = 0;
        if let Some(packed) = &packed {
            bare_bytes = packed.decode().map_err(|error| failed(path, &error))?;
            stream = Some(packed.compression());
        } else {
            for part in &data {
                bare_bytes += part.pass_over(progress)?;
                stream = part.packing.map(Packing::name);
            }
        }
        if time > 0 {
            bares.push(clock.read());
            opens.push(open);
        }
    }
    let (open, bare) = (Times::of(&opens), Times::of(&bares));
    let (open_ms, bare_ms) = (median(open.cpu_ms), median(bare.cpu_ms));
    #[expect(clippy::cast_precision_loss, reason = "bytes of memory and files are far below 2⁵³")]
    let [voxels_mb, bare_mb] = [voxel_bytes, bare_bytes].map(|bytes| bytes as f64 / 1e6);
    Ok(Row {
        volume: path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned(),
        stream,
        voxels_mb,
        open,
        bare,
        open_mb_s: voxels_mb / open_ms * 1e3,
        bare_mb_s: bare_mb / bare_ms * 1e3,
        ratio: (bare_bytes >= voxel_bytes).then(|| open_ms / bare_ms),
        peak_mb: peak,
    })
}

/// Compression of a stream, as far as this module decodes it.
#[derive(Clone, Copy, Debug)]
enum Packing {
    Gzip,
    Zlib,
    Bzip2,
}

impl Packing {
    fn name(self) -> &'static str {
        match self {
            Self::Gzip => "gzip",
            Self::Zlib => "zlib",
            Self::Bzip2 => "bzip2",
        }
    }
}

/// Bytes of a file from `start` on.
struct Part {
    path: PathBuf,
    start: u64,
    packing: Option<Packing>,
}

impl Part {
    fn decoded(&self) -> io::Result<Box<dyn Read>> {
        let mut file = BufReader::with_capacity(SCRATCH, File::open(&self.path)?);
        file.seek(SeekFrom::Start(self.start))?;
        Ok(match self.packing {
            Some(Packing::Gzip) => Box::new(MultiGzDecoder::new(file)),
            Some(Packing::Zlib) => Box::new(ZlibDecoder::new(file)),
            Some(Packing::Bzip2) => Box::new(MultiBzDecoder::new(file)),
            None => Box::new(file),
        })
    }

    /// Whether the beginning of the bytes can be decoded.
    fn is_sound(&self) -> bool {
        self.decoded().is_ok_and(|mut stream| stream.read_exact(&mut [0; 64]).is_ok())
    }

    /// Decodes and discards all bytes; returns their number.
    fn pass_over(&self, progress: &dyn Progress) -> Result<usize, CliError> {
        let failed = |error: io::Error| failed(&self.path, &error);
        let mut stream = self.decoded().map_err(failed)?;
        let mut scratch = vec![0; SCRATCH];
        let mut bytes = 0;
        loop {
            match stream.read(&mut scratch).map_err(failed)? {
                0 => return Ok(bytes),
                read => bytes += read,
            }
            if progress.cancelled() {
                return Err(VolumeError::Cancelled { source_name: self.path.display().to_string() }.into());
            }
        }
    }
}

/// Returns the compressed part of each file, wherever it begins; all files if none is compressed.
fn payload(mut files: Vec<PathBuf>) -> io::Result<Vec<Part>> {
    files.sort();
    files.dedup();
    let mut packed = Vec::new();
    for path in &files {
        let mut head = Vec::new();
        File::open(path)?.take(1 << 16).read_to_end(&mut head)?;
        // At the beginning of a file, or after the header of an NRRD or MetaImage.
        let ends = [&b"\n\n"[..], b"\r\n\r\n", b"LOCAL\n", b"LOCAL\r\n"];
        let ends =
            ends.iter().filter_map(|end| Some(head.windows(end.len()).position(|bytes| bytes == *end)? + end.len()));
        let part = std::iter::once(0).chain(ends).find_map(|start| {
            let packing = match head[start..] {
                [0x1f, 0x8b, 8, ..] => Packing::Gzip,
                [b'B', b'Z', b'h', b'1'..=b'9', ..] => Packing::Bzip2,
                [0x78, flags, ..] if (0x7800 + u16::from(flags)).is_multiple_of(31) => Packing::Zlib,
                _ => return None,
            };
            let part = Part { path: path.clone(), start: u64::try_from(start).ok()?, packing: Some(packing) };
            part.is_sound().then_some(part)
        });
        packed.extend(part);
    }
    if packed.is_empty() {
        packed.extend(files.into_iter().map(|path| Part { path, start: 0, packing: None }));
    }
    Ok(packed)
}

/// Writes a 12-bit engine whose last four bits are noise, as from a scanner.
fn write_phantom(path: &Path) -> Result<(), CliError> {
    let engine = Volume::phantom(Phantom::Engine, Some([SIDE; 3]))?;
    let Voxels::U8(voxels) = &engine.voxels else {
        return Err(CliError::Failed("the engine phantom does not have 8 bits".to_owned()));
    };
    let write = || -> io::Result<()> {
        let mut file = File::create(path)?;
        write!(
            file,
            "NRRD0004\ntype: uint16\ndimension: 3\nsizes: {SIDE} {SIDE} {SIDE}\nendian: little\nencoding: gzip\n\n"
        )?;
        let mut encoder = GzEncoder::new(file, Compression::default());
        let mut state = 1_u32;
        for slice in voxels.chunks(SIDE * SIDE) {
            let bytes = slice.iter().flat_map(|&value| {
                // The quick generator of Numerical Recipes; its upper bits are the good ones.
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let noise = state.to_le_bytes()[3] & 0xf;
                (u16::from(value) << 4 | u16::from(noise)).to_le_bytes()
            });
            encoder.write_all(&bytes.collect::<Vec<_>>())?;
        }
        encoder.finish()?.flush()
    };
    write().map_err(|error| failed(path, &error))
}
