//! Volume files: NRRD, `MetaImage` and `NIfTI`, by the extension.

mod headers;

use std::io::{self, Write};
use std::path::Path;

use flate2::Compression;
use flate2::write::GzEncoder;

use super::{OutputError, write_atomically};
use relume_base::progress::Progress;
use relume_volume::{ByteOrder, Volume, Voxel, VoxelType, with_voxels};

/// Bytes between two progress reports.
const CHUNK: usize = 1 << 20;

/// Kind of a volume file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VolumeKind {
    /// NRRD with attached voxels, compressed by gzip.
    Nrrd,
    /// `MetaImage` with local voxels.
    MetaImage,
    /// `NIfTI` in one file.
    Nifti,
    /// `NIfTI` in one file, compressed by gzip.
    NiftiGzip,
}

impl VolumeKind {
    /// Returns the kind by the extension of `path`.
    ///
    /// # Errors
    ///
    /// [`OutputError::VolumeKind`] for an unknown extension.
    pub fn of(path: &Path) -> Result<Self, OutputError> {
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        let kinds =
            [(".nrrd", Self::Nrrd), (".mha", Self::MetaImage), (".nii", Self::Nifti), (".nii.gz", Self::NiftiGzip)];
        let found = kinds.into_iter().find(|(ending, _)| name.ends_with(ending));
        found.map(|(_, kind)| kind).ok_or_else(|| OutputError::VolumeKind { path: path.to_owned() })
    }
}

/// Contents of a written volume file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Written {
    /// Type of the numbers in the file.
    pub voxel_type: VoxelType,
    /// Differences from the volume and losses, each a sentence without a period.
    pub notes: Vec<String>,
}

impl Written {
    fn of(kind: VolumeKind, volume: &Volume, as_values: bool) -> Self {
        let voxel_type = headers::stored(volume, as_values);
        let is_nifti = matches!(kind, VolumeKind::Nifti | VolumeKind::NiftiGzip);
        let mut notes = Vec::new();
        if as_values {
            let (own, bytes) = (volume.voxels.type_name(), volume.voxels.voxel_type().bytes());
            let growth = voxel_type.bytes() / bytes;
            let size = if growth > 1 { format!(", {growth} times as large as {own}") } else { String::new() };
            notes.push(format!("slope and intercept are applied: the file has {voxel_type}{size}"));
        }
        if is_nifti && headers::nifti_code(volume) == 2 {
            notes.push(
                "NIfTI places every grid with an origin or a direction in a patient: readers take it as anatomical"
                    .to_owned(),
            );
        }
        if kind == VolumeKind::MetaImage
            && let Some(unit) = volume.unit
            && headers::metaimage_unit(volume.unit).is_none()
        {
            notes.push(format!("MetaImage has no name for the unit {unit}: the file has none"));
        }
        let are_named = !volume.presets.labels.is_empty();
        if are_named && kind != VolumeKind::Nrrd {
            notes.push("the file has no names and colours of labels; .nrrd has them".to_owned());
        }
        if volume.has_labels && !is_nifti && (kind == VolumeKind::MetaImage || !are_named) {
            notes.push("the file does not say that its voxels are labels; .nii does".to_owned());
        }
        Self { voxel_type, notes }
    }
}

/// Writes the voxels, the geometry and the scaling of `volume`; the extension of `path` determines the format.
///
/// The stored numbers and their type are kept. NRRD has no slope and intercept, and most readers ignore those of
/// `MetaImage`: with others than 1 and 0, the numbers of both are the values as 64-bit floats. `NIfTI` is right-anterior-
/// superior, in millimetres or micrometres, and its version 1 has floats of 32 bits for the geometry; version 2 is
/// written where an axis is longer than 32767 voxels, or where 32 bits do not hold slope and intercept. A slope of 0
/// means no scaling there, so that the values are written. The first window of the presets goes into `NIfTI` only; names
/// and colours of labels go into NRRD only, as the segments of 3D Slicer. `MetaImage` has no mark of labels, and no
/// name for nanometres and ångströms.
///
/// # Errors
///
/// [`OutputError::VolumeKind`] for an unknown extension, [`OutputError::Cancelled`] if `progress` requests it, otherwise
/// as [`write_atomically`].
pub fn write_volume(path: &Path, volume: &Volume, progress: &dyn Progress) -> Result<Written, OutputError> {
    let kind = VolumeKind::of(path)?;
    let is_scaled = (volume.slope, volume.intercept) != (1.0, 0.0);
    let has_slope = matches!(kind, VolumeKind::Nifti | VolumeKind::NiftiGzip) && volume.slope != 0.0;
    let as_values = is_scaled && !has_slope;
    let header = match kind {
        VolumeKind::Nrrd => headers::nrrd(volume, as_values),
        VolumeKind::MetaImage => headers::metaimage(volume, as_values),
        VolumeKind::Nifti | VolumeKind::NiftiGzip => headers::nifti(volume, as_values),
    };
    let report = |done: u64, all: u64| {
        let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
        progress.report(&format!("writing {name}"), done, all);
        if progress.cancelled() { Err(io::Error::from(io::ErrorKind::Interrupted)) } else { Ok(()) }
    };
    let written = write_atomically(path, |sink| match kind {
        VolumeKind::MetaImage | VolumeKind::Nifti => {
            sink.write_all(&header)?;
            write_voxels(sink, volume, as_values, &report)
        }
        VolumeKind::NiftiGzip => {
            let mut packed = GzEncoder::new(sink, Compression::default());
            packed.write_all(&header)?;
            write_voxels(&mut packed, volume, as_values, &report)?;
            packed.finish().map(drop)
        }
        VolumeKind::Nrrd => {
            sink.write_all(&header)?;
            let mut packed = GzEncoder::new(sink, Compression::default());
            write_voxels(&mut packed, volume, as_values, &report)?;
            packed.finish().map(drop)
        }
    });
    match written {
        Err(_) if progress.cancelled() => Err(OutputError::Cancelled { path: path.to_owned() }),
        written => written.map(|()| Written::of(kind, volume, as_values)),
    }
}

/// Writes all voxels in little-endian order, as stored or as values of 64 bits.
fn write_voxels(
    sink: &mut dyn Write,
    volume: &Volume,
    as_values: bool,
    report: &dyn Fn(u64, u64) -> io::Result<()>,
) -> io::Result<()> {
    let scale = as_values.then_some((volume.slope, volume.intercept));
    with_voxels!(&volume.voxels, stored => match scale {
        None => write_numbers(sink, stored, |voxel| voxel, report),
        Some((slope, intercept)) => {
            write_numbers(sink, stored, |voxel| voxel.to_f64().mul_add(slope, intercept), report)
        }
    })
}

/// Writes `number` of every voxel in little-endian order.
fn write_numbers<T: Voxel, N: Voxel>(
    sink: &mut dyn Write,
    stored: &[T],
    number: impl Fn(T) -> N,
    report: &dyn Fn(u64, u64) -> io::Result<()>,
) -> io::Result<()> {
    let count = |n: usize| u64::try_from(n).unwrap_or(u64::MAX);
    let mut done = 0;
    report(0, count(stored.len()))?;
    for chunk in stored.chunks(CHUNK / size_of::<N>()) {
        let little = |voxel: &T| match ByteOrder::NATIVE {
            ByteOrder::Little => number(*voxel),
            ByteOrder::Big => number(*voxel).with_bytes_swapped(),
        };
        let numbers: Vec<N> = chunk.iter().map(little).collect();
        sink.write_all(bytemuck::cast_slice(&numbers))?;
        done += chunk.len();
        report(count(done), count(stored.len()))?;
    }
    Ok(())
}
