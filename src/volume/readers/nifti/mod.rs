//! `NIfTI`-1, `NIfTI`-2 and Analyze 7.5: `.nii`, or a pair `.hdr` and `.img`; each may be compressed by gzip.
//!
//! Fields and meanings follow `nifti1.h` and `nifti2.h` (<https://nifti.nimh.nih.gov>), and Mayo's description of
//! Analyze 7.5. The files are right-anterior-superior; the world here is left-posterior-superior.

mod header;

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};

use super::binary;
use super::foreign;
use crate::data::{self, Data, DataFile};
use crate::geometry::Lattice;
use crate::resample::Grid;
use crate::select::Pick;
use crate::stream::{self, Encoding, Skip, Start, count};
use crate::streamed::Streamed;
use crate::unit::Unit;
use crate::{Selection, Volume, VolumeError, VoxelType, Window};
use header::{Header, Kind, SIZES, Version};
use relume_base::number;
use relume_base::progress::Progress;

/// Whether the first bytes of a file, perhaps compressed by gzip, identify a `NIfTI` or Analyze header.
pub(crate) fn recognises(beginning: &[u8]) -> bool {
    Kind::of(&binary::inside(beginning, SIZES[1])).is_some()
}

/// Whether `path` has an extension of this format and holds another one, which this one does not recognise.
pub(crate) fn is_another(path: &Path) -> Result<bool, VolumeError> {
    let (bytes, ..) = beginning(path)?;
    Ok(Header::of(&bytes).is_none() && (ending(path) != "nii" || foreign::is_known(&bytes)))
}

/// First bytes of the header, their encoding, the header's file, and the image's if `path` is one, for `path` or the pair
/// of which it is one file.
fn beginning(path: &Path) -> Result<(Vec<u8>, Encoding, PathBuf, Option<PathBuf>), VolumeError> {
    let (bytes, encoding) = binary::beginning(path, SIZES[1])?;
    if ending(path) == "img"
        && Kind::of(&bytes).is_none()
        && let Some(header) = partner(path)
    {
        let (bytes, encoding) = binary::beginning(&header, SIZES[1])?;
        return Ok((bytes, encoding, header, Some(path.to_owned())));
    }
    Ok((bytes, encoding, path.to_owned(), None))
}

/// Reads a `NIfTI` or Analyze file, or the pair of which `path` is one file.
pub(crate) fn read(path: &Path, selection: &Selection, progress: &dyn Progress) -> Result<Volume, VolumeError> {
    streamed(path, selection)?.read(&path.display().to_string(), selection, progress)
}

/// Reads the header of a `NIfTI` or Analyze file, or of the pair of which `path` is one file.
pub(crate) fn streamed(path: &Path, selection: &Selection) -> Result<Streamed, VolumeError> {
    let (bytes, encoding, header_path, image_path) = beginning(path)?;
    let Some(header) = Header::of(&bytes) else {
        return Err(no_header(path, &bytes));
    };
    // The file that was asked for has priority over another with the same header.
    let image =
        if header.kind.is_pair { image_path.or_else(|| partner(&header_path)) } else { Some(header_path.clone()) };
    let Some(image) = image else {
        let place = "magic".to_owned();
        let problem =
            format!("the voxels are in a separate image file, but {} is missing", missing(&header_path).display());
        return Err(VolumeError::Field { path: header_path, place, problem });
    };
    let encoding = if header.kind.is_pair { encoding_of_image(&image) } else { encoding };
    Reading { header, path: &header_path, image, encoding }.streamed(selection)
}

/// The encoding of the image of a pair. Voxels may begin with any bytes, so the name decides.
fn encoding_of_image(image: &Path) -> Encoding {
    if without_gz(image).1 { Encoding::Gzip } else { Encoding::Raw }
}

/// The error for a file that begins with `bytes`, which are no header.
fn no_header(path: &Path, bytes: &[u8]) -> VolumeError {
    let place = "sizeof_hdr".to_owned();
    let problem = match bytes {
        &[a, b, c, d, ..] if bytes.len() >= SIZES[0] => format!(
            "the file has no NIfTI header: {} is not the length of a header, {} (NIfTI-2: {}), or the magic word n+1, ni1, n+2 or ni2 is missing",
            i32::from_le_bytes([a, b, c, d]),
            SIZES[0],
            SIZES[1]
        ),
        short => format!(
            "the file has {} bytes, but a NIfTI-1 or Analyze header has {} (NIfTI-2: {})",
            short.len(),
            SIZES[0],
            SIZES[1]
        ),
    };
    VolumeError::Field { path: path.to_owned(), place, problem }
}

/// The extension before `.gz`: `nii`, `hdr`, `img`, or nothing of these.
fn ending(path: &Path) -> &'static str {
    let (name, _) = without_gz(path);
    ["nii", "hdr", "img"]
        .into_iter()
        .find(|known| name.to_ascii_lowercase().ends_with(&format!(".{known}")))
        .unwrap_or("")
}

/// The name of the file without `.gz`, and whether it has it.
fn without_gz(path: &Path) -> (String, bool) {
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let bare = name.len().saturating_sub(3);
    match name.get(bare..) {
        Some(last) if last.eq_ignore_ascii_case(".gz") => (name[..bare].to_owned(), true),
        _ => (name, false),
    }
}

/// The existing other file of a pair: the image of a header, the header of an image. A partner compressed as `path`
/// is has priority.
fn partner(path: &Path) -> Option<PathBuf> {
    partners(path).into_iter().find(|other| other.is_file())
}

/// The names that the other file of a pair may have.
fn partners(path: &Path) -> Vec<PathBuf> {
    let gz = without_gz(path).1;
    let bare = if gz { path.with_extension("") } else { path.to_owned() };
    let upper = bare.extension().is_some_and(|it| it.to_string_lossy().chars().all(|letter| letter.is_uppercase()));
    let other = if ending(path) == "img" { "hdr" } else { "img" };
    let other = if upper { other.to_ascii_uppercase() } else { other.to_owned() };
    let plain = bare.with_extension(&other);
    let packed = bare.with_extension(format!("{other}.gz"));
    if gz { vec![packed, plain] } else { vec![plain, packed] }
}

/// The name that a missing image should have.
fn missing(header: &Path) -> PathBuf {
    let image = partners(header).into_iter().next().unwrap_or_default();
    PathBuf::from(image.file_name().unwrap_or_default())
}

/// A header with its files.
struct Reading<'a> {
    header: Header,
    path: &'a Path,
    image: PathBuf,
    encoding: Encoding,
}

/// The stored numbers of a voxel.
struct Stored {
    voxel_type: VoxelType,
    /// Numbers per voxel that lie side by side.
    interleaved: usize,
}

impl Reading<'_> {
    fn streamed(&self, selection: &Selection) -> Result<Streamed, VolumeError> {
        let header = &self.header;
        let source_name = self.path.display().to_string();
        let Stored { voxel_type, interleaved } = self.stored()?;
        let [nx, ny, nz, times, planes] = self.axes()?;
        if interleaved > 1 && planes > 1 {
            return Err(self.wrong("dim[5]", format!("the voxels have {planes} components of {interleaved} colour channels each; Relume reads components or colour channels, not both")));
        }
        // Fastest first: the colours of a voxel, space, time, and planes of components.
        let all = [interleaved, nx, ny, nz, times, planes];
        data::check_size(&source_name, &all)?;
        selection.no_array(&source_name)?;
        let components = interleaved * planes;
        let component = selection.component(&source_name, components, self.kind_of_components(interleaved))?;
        let time = selection.time(&source_name, times)?;
        let pick = |axis: usize, index| Pick { stride: all[..axis].iter().product(), length: all[axis], index };
        let slices = selection.slices(nz);
        let part = selection.part(nz, 1).filter(|_| selection.middle);
        let mut picks =
            vec![pick(0, component % interleaved.max(1)), pick(4, time), pick(5, component / interleaved.max(1))];
        picks.extend(selection.middle.then(|| pick(3, slices.start)));
        let mut notes = Vec::new();
        let (lattice, is_anatomical) = self.lattice([nx, ny, nz], &mut notes)?;
        let lattice = if selection.middle { lattice.of_slices(&slices) } else { lattice };
        let grid = Grid::of(lattice, &source_name, selection.resample)?;
        let (slope, intercept) = if interleaved > 1 { (1.0, 0.0) } else { self.scale()? };
        let numbers = all.iter().product();
        let start = self.start(count(numbers).saturating_mul(count(voxel_type.bytes())))?;
        let files = vec![DataFile { path: self.image.clone(), numbers }];
        let byte_order = header.kind.byte_order;
        let data = Data { files, start, encoding: self.encoding, voxel_type, byte_order, picks, alone: true };
        let mut files = data.paths();
        if header.kind.is_pair {
            files.push(self.path.to_owned());
        }
        let (dims, has_labels, metadata) = (grid.dims(), header.intent_code == LABELS, self.metadata(times));
        let window = Window::new("window of the file", header.cal_min, header.cal_max);
        let finish = move |voxels, mut notes: Vec<String>| {
            let mut volume = grid.volume(&source_name, voxels, has_labels, slope)?;
            (volume.files, volume.metadata, volume.components) = (files, metadata, components);
            (volume.slope, volume.intercept) = (slope, intercept);
            (volume.anatomical, volume.unit) = (is_anatomical, Some(Unit::Millimetre));
            volume.part = part;
            volume.presets.windows.extend(window);
            notes.append(&mut volume.notes);
            volume.notes = notes;
            Ok(volume)
        };
        Ok(Streamed { data, halves: false, dims, notes, finish: Box::new(finish) })
    }

    fn wrong(&self, place: &str, problem: String) -> VolumeError {
        VolumeError::Field { path: self.path.to_owned(), place: place.to_owned(), problem }
    }

    /// Type of the numbers, and how many of them are a voxel.
    fn stored(&self) -> Result<Stored, VolumeError> {
        let datatype = self.header.datatype;
        let (voxel_type, interleaved) = match datatype {
            2 => (VoxelType::U8, 1),
            4 => (VoxelType::I16, 1),
            8 => (VoxelType::I32, 1),
            16 => (VoxelType::F32, 1),
            64 => (VoxelType::F64, 1),
            128 => (VoxelType::U8, 3),
            256 => (VoxelType::I8, 1),
            512 => (VoxelType::U16, 1),
            768 => (VoxelType::U32, 1),
            1024 => (VoxelType::I64, 1),
            1280 => (VoxelType::U64, 1),
            2304 => (VoxelType::U8, 4),
            refused => {
                let name = match refused {
                    1 => "voxels of 1 bit",
                    32 => "complex numbers of 2 × 32 bits",
                    1536 => "floats of 128 bits",
                    1792 => "complex numbers of 2 × 64 bits",
                    2048 => "complex numbers of 2 × 128 bits",
                    _ => "not a type of the format",
                };
                let known = "2, 4, 8, 16, 64, 128, 256, 512, 768, 1024, 1280 and 2304";
                return Err(
                    self.wrong("datatype", format!("Relume does not read type {refused} ({name}); it reads {known}"))
                );
            }
        };
        let bits = 8 * voxel_type.bytes() * interleaved;
        // A writer that leaves bitpix 0 states nothing.
        if self.header.bitpix != 0 && usize::try_from(self.header.bitpix).ok() != Some(bits) {
            let problem =
                format!("the header states {} bits per voxel, but datatype {datatype} has {bits}", self.header.bitpix);
            return Err(self.wrong("bitpix", problem));
        }
        Ok(Stored { voxel_type, interleaved })
    }

    /// Lengths of the axes x, y, z, time and component.
    fn axes(&self) -> Result<[usize; 5], VolumeError> {
        let [axes, lengths @ ..] = self.header.dim;
        let Some(axes) = usize::try_from(axes).ok().filter(|axes| (1..=7).contains(axes)) else {
            return Err(self.wrong("dim[0]", format!("the header states {axes} axes; a NIfTI file has 1 to 7")));
        };
        let mut all = [1; 7];
        for (axis, (length, &stated)) in all.iter_mut().zip(&lengths[..axes]).enumerate() {
            let stated = usize::try_from(stated).ok().filter(|&stated| stated > 0);
            let problem = || format!("the axis has {} voxels; it must have at least 1", lengths[axis]);
            *length = stated.ok_or_else(|| self.wrong(&format!("dim[{}]", axis + 1), problem()))?;
        }
        match all {
            [x, y, z, times, planes, 1, 1] => Ok([x, y, z, times, planes]),
            _ => {
                let dims: Vec<String> = all[..axes].iter().map(ToString::to_string).collect();
                Err(VolumeError::TooManyAxes { source_name: self.path.display().to_string(), dims: dims.join("×") })
            }
        }
    }

    /// Name of the components, for messages.
    fn kind_of_components(&self, interleaved: usize) -> &'static str {
        match (interleaved, self.header.intent_code) {
            (3, _) => "RGB",
            (4, _) => "RGBA",
            (_, 1004) => "matrix",
            (_, 1005) => "symmetric matrix",
            (_, 1006) => "displacement vector",
            (_, 1007) => "vector",
            _ => "",
        }
    }

    /// Offset of the first voxel; `bytes` is the length of all voxels.
    fn start(&self, bytes: u64) -> Result<Start, VolumeError> {
        let stated = self.header.vox_offset;
        let least = match self.header.kind {
            Kind { is_pair: true, .. } => 0,
            Kind { version: Version::Two, .. } => SIZES[1],
            _ => SIZES[0],
        };
        // The largest offset whose neighbours f64 tells apart.
        let whole = (0.0..=9_007_199_254_740_992.0).contains(&stated) && stated.fract() == 0.0;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a whole number below 2⁵³")]
        let offset = if whole { Some(stated as u64) } else { None };
        let Some(offset) = offset.filter(|&offset| offset >= count(least)) else {
            return Err(self.wrong(
                "vox_offset",
                format!("the voxels begin at byte {stated}, but the header ends at byte {least}"),
            ));
        };
        if self.encoding == Encoding::Raw {
            let length = stream::after_lines(&self.image, Start::at(0))?.1;
            if offset > length {
                let problem = format!("the voxels begin at byte {offset}, but the file has only {length} bytes");
                return Err(self.wrong("vox_offset", problem));
            }
        } else if offset > bytes.saturating_add(data::MOST_SKIPPED) {
            let problem = format!(
                "{offset} bytes come before the {bytes} bytes of voxels; Relume does not skip so many bytes in a compressed file"
            );
            return Err(self.wrong("vox_offset", problem));
        }
        Ok(Start { at: 0, lines: 0, skip: Skip::Bytes(offset) })
    }

    /// Slope and intercept. A slope of 0 means that there is no scaling, whatever the intercept.
    fn scale(&self) -> Result<(f64, f64), VolumeError> {
        let Header { slope, intercept, .. } = self.header;
        if slope == 0.0 || !slope.is_finite() {
            return Ok((1.0, 0.0));
        }
        if intercept.is_finite() {
            return Ok((slope, intercept));
        }
        Err(self
            .wrong("scl_inter", format!("the intercept is {intercept}, which is not finite, and scl_slope is {slope}")))
    }

    /// The grid in left-posterior-superior millimetres, and whether it is anatomical.
    fn lattice(&self, dims: [usize; 3], notes: &mut Vec<String>) -> Result<(Lattice, bool), VolumeError> {
        let header = &self.header;
        let source = self.path.display();
        let by_rows = || {
            let [x, y, z] = header.rows;
            let rows = DMat3::from_cols_array_2d(&[x, y, z].map(|[a, b, c, _]| [a, b, c]));
            (rows.transpose(), DVec3::new(x[3], y[3], z[3]))
        };
        let (rows, first) = by_rows();
        let is_flat = header.sform_code > 0 && first.is_finite() && spans_nothing(with_normal(rows, dims, 1.0));
        if is_flat {
            let lengths = [0, 1, 2].map(|axis| number::brief(rows.col(axis).length()));
            let instead = if header.qform_code > 0 { "the qform" } else { "the spacings of pixdim" };
            notes.push(format!(
                "{source}: the axes of the sform (code {}) span no volume: they are {} long and lie in a plane or a line, or \
                 have no length; Relume uses {instead}",
                header.sform_code,
                lengths.join(", ")
            ));
        }
        let (steps, origin, place, is_anatomical) = if header.sform_code > 0 && !is_flat {
            let (steps, origin) = by_rows();
            (steps, origin, "srow_x, srow_y, srow_z", true)
        } else if header.qform_code > 0 {
            (self.turned(notes), DVec3::from_array(header.offset), "quatern_b to qoffset_z", true)
        } else {
            if is_flat {
                // The note above says so.
            } else if header.kind.version != Version::Analyze {
                notes.push(format!(
                    "{source}: the file has no orientation (sform and qform are not set); Relume uses only the spacings"
                ));
            } else {
                notes.push(format!("{source}: Analyze files state no orientation; Relume uses only the spacings"));
            }
            (DMat3::from_diagonal(self.spacing(notes)), DVec3::ZERO, "pixdim", false)
        };
        if !steps.is_finite() || !origin.is_finite() {
            let numbers: Vec<String> =
                steps.to_cols_array().iter().chain(&origin.to_array()).map(ToString::to_string).collect();
            return Err(self.wrong(
                place,
                format!("the axes and the origin have numbers that are not finite: {}", numbers.join(" ")),
            ));
        }
        let to_mm = match header.units & 7 {
            1 => 1000.0,
            3 => 1e-3,
            _ => 1.0,
        };
        // Right and anterior become left and posterior.
        let turn = if is_anatomical { DVec3::new(-1.0, -1.0, 1.0) } else { DVec3::ONE } * to_mm;
        let lattice = |steps: DMat3, origin: DVec3| {
            let steps = DMat3::from_diagonal(turn) * steps;
            Lattice { dims, origin: turn * origin, steps: with_normal(steps, dims, to_mm) }
        };
        let chosen = lattice(steps, origin);
        if header.sform_code > 0 && !is_flat && header.qform_code > 0 {
            let other = lattice(self.turned(&mut Vec::new()), DVec3::from_array(header.offset));
            if let Some(apart) = apart(&chosen, &other) {
                notes.push(format!(
                    "{source}: the sform and the qform place the same corner {apart:.1} voxels apart; Relume uses the sform"
                ));
            }
        }
        Ok((chosen, is_anatomical))
    }

    /// Steps by the quaternion and the spacings.
    fn turned(&self, notes: &mut Vec<String>) -> DMat3 {
        let [b, c, d] = self.header.quaternion;
        let rest = 1.0 - (b * b + c * c + d * d);
        // As in the library of the format: a rotation by half a turn has a = 0, whatever the rounding.
        let shorten = if rest < 1e-7 { (b * b + c * c + d * d).sqrt() } else { 1.0 };
        let [b, c, d] = [b, c, d].map(|entry| entry / shorten);
        let a = if rest < 1e-7 { 0.0 } else { rest.sqrt() };
        let turn = DMat3::from_cols_array(&[
            a * a + b * b - c * c - d * d,
            2.0 * (b * c + a * d),
            2.0 * (b * d - a * c),
            2.0 * (b * c - a * d),
            a * a + c * c - b * b - d * d,
            2.0 * (c * d + a * b),
            2.0 * (b * d + a * c),
            2.0 * (c * d - a * b),
            a * a + d * d - b * b - c * c,
        ]);
        let hand = if self.header.pixdim[0] < 0.0 { -1.0 } else { 1.0 };
        turn * DMat3::from_diagonal(self.spacing(notes) * DVec3::new(1.0, 1.0, hand))
    }

    /// The spacings of `pixdim`. Their signs mean nothing; an axis without a spacing gets 1.
    fn spacing(&self, notes: &mut Vec<String>) -> DVec3 {
        let stated = DVec3::from_slice(&self.header.pixdim[1..4]).abs();
        if stated.cmpeq(DVec3::ZERO).any() {
            let [x, y, z] = stated.to_array();
            notes.push(format!(
                "{}: pixdim states the spacing {x} {y} {z}; Relume uses 1 in place of 0",
                self.path.display()
            ));
        }
        DVec3::select(stated.cmpeq(DVec3::ZERO), DVec3::ONE, stated)
    }

    /// Texts of the header, and what its codes mean.
    fn metadata(&self, times: usize) -> Vec<(String, String)> {
        let header = &self.header;
        let mut all = header.texts.clone();
        let mut add = |name: &str, value: String| all.push((name.to_owned(), value));
        let code = if header.sform_code > 0 { header.sform_code } else { header.qform_code };
        match code {
            1 => add("space", "scanner (1)".to_owned()),
            2 => add("space", "aligned to another file (2)".to_owned()),
            3 => add("space", "Talairach (3)".to_owned()),
            4 => add("space", "MNI 152 (4)".to_owned()),
            5 => add("space", "another template (5)".to_owned()),
            _ => {}
        }
        if header.intent_code != 0 {
            add("intent_code", header.intent_code.to_string());
        }
        if times > 1 {
            let unit = match header.units & 0x38 {
                8 => " s",
                16 => " ms",
                24 => " µs",
                32 => " Hz",
                40 => " ppm",
                48 => " rad/s",
                _ => "",
            };
            add("time step", format!("{}{unit}", header.pixdim[4]));
        }
        all
    }
}

/// `NIFTI_INTENT_LABEL`.
const LABELS: i32 = 1002;

/// The steps, with a normal of length `length` in place of a z step of 0 if there is one slice.
fn with_normal(steps: DMat3, dims: [usize; 3], length: f64) -> DMat3 {
    let normal = steps.x_axis.cross(steps.y_axis).normalize_or_zero() * length;
    let z = if dims[2] == 1 && steps.z_axis == DVec3::ZERO { normal } else { steps.z_axis };
    DMat3::from_cols(steps.x_axis, steps.y_axis, z)
}

/// Whether axes are of no length, or lie in a plane or a line: their volume is below a millionth of that of a box.
fn spans_nothing(steps: DMat3) -> bool {
    const LEAST: f64 = 1e-6;
    let [x, y, z] = [0, 1, 2].map(|axis| steps.col(axis).normalize_or_zero());
    // Numbers that are not finite have an error of their own.
    steps.is_finite() && x.cross(y).dot(z).abs() < LEAST
}

/// The largest distance between equal corners of two grids, in voxels, if it exceeds a voxel.
fn apart(one: &Lattice, other: &Lattice) -> Option<f64> {
    let corner = |corner: usize| {
        let index = [0, 1, 2].map(|axis| if corner >> axis & 1 == 1 { one.dims[axis] - 1 } else { 0 });
        let index = DVec3::from_array(index.map(number::count));
        one.world_from_index(index).distance(other.world_from_index(index))
    };
    let voxel = [0, 1, 2].map(|axis| one.steps.col(axis).length()).into_iter().fold(f64::INFINITY, f64::min);
    let worst = (0..8).map(corner).fold(0.0, f64::max) / voxel;
    // A qform that is not finite is none.
    (worst > 1.0 && worst.is_finite()).then_some(worst)
}
