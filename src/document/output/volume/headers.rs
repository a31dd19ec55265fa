//! Headers of volume files.

use std::fmt::Write as _;

use glam::{DMat3, DVec3};

use relume_volume::{Geometry, Unit, Volume, VoxelType};

/// Three numbers, separated by `sign`; each is the shortest text that reads back as the same number.
fn three(vector: DVec3, sign: &str) -> String {
    vector.to_array().map(|number| number.to_string()).join(sign)
}

/// Type of the numbers in the file: of the values, or as stored.
pub(super) fn stored(volume: &Volume, as_values: bool) -> VoxelType {
    if as_values { VoxelType::F64 } else { volume.voxels.voxel_type() }
}

/// Pairs by which 3D Slicer and Relume find the labels of a volume, with their names and colours.
fn segments(volume: &Volume) -> String {
    let mut text = String::new();
    for (index, label) in volume.presets.labels.iter().enumerate() {
        // The format writes a backslash as two, and the end of a line as a backslash and `n`.
        let name = label.name.replace('\\', r"\\").replace('\n', r"\n").replace(char::is_control, " ");
        let _ = writeln!(text, "Segment{index}_LabelValue:={}\nSegment{index}_Name:={name}", label.value);
        if let Some(colour) = label.colour {
            let _ = writeln!(text, "Segment{index}_Color:={}", three(DVec3::from_array(colour), " "));
        }
    }
    text
}

/// Header of an NRRD whose voxels follow in gzip.
pub(super) fn nrrd(volume: &Volume, as_values: bool) -> Vec<u8> {
    let Geometry { dims: [x, y, z], spacing, origin, direction } = volume.geometry;
    let name = match stored(volume, as_values) {
        VoxelType::F32 => "float",
        VoxelType::F64 => "double",
        whole => whole.name(),
    };
    let space = if volume.anatomical { "space: left-posterior-superior" } else { "space dimension: 3" };
    let steps = [0, 1, 2].map(|axis| format!("({})", three(direction.col(axis) * spacing[axis], ","))).join(" ");
    let units = volume.unit.map_or_else(String::new, |unit| format!("space units: \"{unit}\" \"{unit}\" \"{unit}\"\n"));
    let mut text = format!("NRRD0005\ntype: {name}\ndimension: 3\n{space}\nsizes: {x} {y} {z}\n{units}");
    let _ = writeln!(text, "space directions: {steps}\nspace origin: ({})", three(origin, ","));
    text.push_str("kinds: domain domain domain\nendian: little\nencoding: gzip\n");
    text.push_str(&segments(volume));
    text.push('\n');
    text.into_bytes()
}

/// The name of a unit in a `MetaImage`; `None` for those that `MetaIO` does not know.
pub(super) fn metaimage_unit(unit: Option<Unit>) -> Option<&'static str> {
    match unit? {
        Unit::Centimetre => Some("cm"),
        Unit::Millimetre => Some("mm"),
        Unit::Micrometre => Some("um"),
        Unit::Nanometre | Unit::Angstrom => None,
    }
}

/// Header of a `MetaImage` whose voxels follow.
pub(super) fn metaimage(volume: &Volume, as_values: bool) -> Vec<u8> {
    let Geometry { dims: [x, y, z], spacing, origin, direction } = volume.geometry;
    let name = match stored(volume, as_values) {
        VoxelType::U8 => "MET_UCHAR",
        VoxelType::I8 => "MET_CHAR",
        VoxelType::U16 => "MET_USHORT",
        VoxelType::I16 => "MET_SHORT",
        VoxelType::U32 => "MET_UINT",
        VoxelType::I32 => "MET_INT",
        VoxelType::U64 => "MET_ULONG_LONG",
        VoxelType::I64 => "MET_LONG_LONG",
        VoxelType::F32 => "MET_FLOAT",
        VoxelType::F64 => "MET_DOUBLE",
    };
    let axes = [0, 1, 2].map(|axis| three(direction.col(axis), " ")).join(" ");
    let mut text = "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n\
                    CompressedData = False\n"
        .to_owned();
    let _ = writeln!(text, "TransformMatrix = {axes}\nOffset = {}", three(origin, " "));
    if volume.anatomical {
        // The side of a patient from which each axis starts.
        let letter = |axis: usize| {
            let vector = direction.col(axis);
            let world = vector.abs().max_position();
            ["R", "L", "A", "P", "I", "S"][2 * world + usize::from(vector[world] < 0.0)]
        };
        let _ = writeln!(text, "AnatomicalOrientation = {}", [0, 1, 2].map(letter).concat());
    }
    if let Some(unit) = metaimage_unit(volume.unit) {
        let _ = writeln!(text, "DistanceUnits = {unit}");
    }
    let spacing = three(spacing, " ");
    let _ = writeln!(
        text,
        "ElementSpacing = {spacing}\nDimSize = {x} {y} {z}\nElementType = {name}\nElementDataFile = LOCAL"
    );
    text.into_bytes()
}

/// Bytes of a header of `NIfTI`, filled at offsets.
struct Bytes(Vec<u8>);

impl Bytes {
    fn put<const N: usize>(&mut self, at: usize, bytes: [u8; N]) {
        self.0[at..at + N].copy_from_slice(&bytes);
    }

    #[expect(clippy::cast_possible_truncation, reason = "the format has 32 bits")]
    fn put_f32(&mut self, at: usize, number: f64) {
        self.put(at, (number as f32).to_le_bytes());
    }
}

/// Fields of both versions of `NIfTI`.
struct Nifti {
    datatype: i16,
    bits: i16,
    spacing: DVec3,
    /// `srow_x`, `srow_y`, `srow_z`.
    rows: [[f64; 4]; 3],
    code: i16,
    units: u8,
    intent: i16,
    window: [f64; 2],
}

/// The code of the axes in `NIfTI`: 1 the scanner's, 2 aligned with something else; 0 where the spacings alone
/// make the grid.
pub(super) fn nifti_code(volume: &Volume) -> i16 {
    let Geometry { origin, direction, .. } = volume.geometry;
    match volume.anatomical {
        true => 1,
        false if direction == DMat3::IDENTITY && origin == DVec3::ZERO => 0,
        false => 2,
    }
}

/// Header of `NIfTI`, with the four bytes behind it that announce no extensions.
pub(super) fn nifti(volume: &Volume, as_values: bool) -> Vec<u8> {
    let Geometry { dims, spacing, origin, direction } = volume.geometry;
    let (datatype, bits) = match stored(volume, as_values) {
        VoxelType::U8 => (2, 8),
        VoxelType::I16 => (4, 16),
        VoxelType::I32 => (8, 32),
        VoxelType::F32 => (16, 32),
        VoxelType::F64 => (64, 64),
        VoxelType::I8 => (256, 8),
        VoxelType::U16 => (512, 16),
        VoxelType::U32 => (768, 32),
        VoxelType::I64 => (1024, 64),
        VoxelType::U64 => (1280, 64),
    };
    // Codes of the format: 0 unknown, 2 millimetres, 3 micrometres.
    let (units, factor) = match volume.unit {
        None => (0, 1.0),
        Some(Unit::Centimetre) => (2, 10.0),
        Some(Unit::Millimetre) => (2, 1.0),
        Some(Unit::Micrometre) => (3, 1.0),
        Some(Unit::Nanometre) => (3, 1e-3),
        Some(Unit::Angstrom) => (3, 1e-4),
    };
    let steps = DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0)) * direction * DMat3::from_diagonal(spacing * factor);
    let origin = origin * factor * DVec3::new(-1.0, -1.0, 1.0);
    let row = |row: usize| [steps.x_axis[row], steps.y_axis[row], steps.z_axis[row], origin[row]];
    let all = Nifti {
        datatype,
        bits,
        spacing: spacing * factor,
        rows: [row(0), row(1), row(2)],
        code: nifti_code(volume),
        units,
        intent: if volume.has_labels { 1002 } else { 0 },
        window: volume.presets.windows.first().map_or([0.0; 2], |window| [window.low, window.high]),
    };
    let scale = if as_values { [1.0, 0.0] } else { [volume.slope, volume.intercept] };
    #[expect(clippy::cast_possible_truncation, clippy::float_cmp, reason = "asks whether 32 bits hold the number")]
    let fits = scale.iter().all(|&number| f64::from(number as f32) == number);
    let short: Option<Vec<i16>> = dims.iter().map(|&side| i16::try_from(side).ok()).collect();
    match short {
        Some(short) if fits => all.version_1(&short, scale),
        _ => all.version_2(dims, scale),
    }
}

impl Nifti {
    fn version_1(&self, dims: &[i16], scale: [f64; 2]) -> Vec<u8> {
        let mut bytes = Bytes(vec![0; 352]);
        bytes.put(0, 348_i32.to_le_bytes());
        let dims = [&[3_i16][..], dims, &[1; 4]].concat();
        dims.iter().enumerate().for_each(|(axis, side)| bytes.put(40 + 2 * axis, side.to_le_bytes()));
        bytes.put(68, self.intent.to_le_bytes());
        bytes.put(70, self.datatype.to_le_bytes());
        bytes.put(72, self.bits.to_le_bytes());
        bytes.put_f32(76, 1.0);
        (0..3).for_each(|axis| bytes.put_f32(80 + 4 * axis, self.spacing[axis]));
        bytes.put_f32(108, 352.0);
        (0..2).for_each(|i| bytes.put_f32(112 + 4 * i, scale[i]));
        bytes.put(123, [self.units]);
        bytes.put_f32(124, self.window[1]);
        bytes.put_f32(128, self.window[0]);
        bytes.put(254, self.code.to_le_bytes());
        let rows = self.rows.iter().flatten().enumerate();
        rows.for_each(|(i, &number)| bytes.put_f32(280 + 4 * i, number));
        bytes.put(344, *b"n+1\0");
        bytes.0
    }

    fn version_2(&self, dims: [usize; 3], scale: [f64; 2]) -> Vec<u8> {
        let mut bytes = Bytes(vec![0; 544]);
        bytes.put(0, 540_i32.to_le_bytes());
        bytes.put(4, *b"n+2\0\r\n\x1a\n");
        bytes.put(12, self.datatype.to_le_bytes());
        bytes.put(14, self.bits.to_le_bytes());
        let [x, y, z] = dims.map(|side| i64::try_from(side).unwrap_or(i64::MAX));
        let dims = [3, x, y, z, 1, 1, 1, 1].into_iter().enumerate();
        dims.for_each(|(axis, side)| bytes.put(16 + 8 * axis, side.to_le_bytes()));
        bytes.put(104, 1.0_f64.to_le_bytes());
        (0..3).for_each(|axis| bytes.put(112 + 8 * axis, self.spacing[axis].to_le_bytes()));
        bytes.put(168, 544_i64.to_le_bytes());
        (0..2).for_each(|i| bytes.put(176 + 8 * i, scale[i].to_le_bytes()));
        bytes.put(192, self.window[1].to_le_bytes());
        bytes.put(200, self.window[0].to_le_bytes());
        bytes.put(348, i32::from(self.code).to_le_bytes());
        let rows = self.rows.iter().flatten().enumerate();
        rows.for_each(|(i, number)| bytes.put(400 + 8 * i, number.to_le_bytes()));
        bytes.put(500, i32::from(self.units).to_le_bytes());
        bytes.put(504, i32::from(self.intent).to_le_bytes());
        bytes.0
    }
}
