//! Generated `MetaImage` files: every element type, byte order, encoding and storage, and invalid files.
#![expect(clippy::float_cmp, reason = "exact in binary")]

use crate::support::volumes;

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

use flate2::Compression;
use flate2::write::ZlibEncoder;
use glam::{DMat3, DVec3};
use relume::progress::Quiet;
use relume::volume::{self, Selection, Volume, VolumeError, Voxels};
use volumes::Files;

/// Header with three axes and 3×2×2 voxels, in which `lines` replace the defaults.
fn header(lines: &[&str]) -> String {
    let defaults = ["NDims = 3", "DimSize = 3 2 2", "ElementType = MET_UCHAR", "ElementDataFile = v.raw"];
    let key = |line: &str| line.split('=').next().unwrap().trim().to_owned();
    let mut text = String::new();
    for default in defaults {
        for line in lines.iter().filter(|line| default.starts_with("ElementDataFile") && key(line) != key(default)) {
            // The data file comes last.
            if !defaults.iter().any(|default| key(default) == key(line)) {
                writeln!(text, "{line}").unwrap();
            }
        }
        let line = lines.iter().find(|line| key(line) == key(default)).copied().unwrap_or(default);
        if !line.ends_with("(none)") {
            writeln!(text, "{line}").unwrap();
        }
    }
    text
}

fn made(header: &str, data: &[u8]) -> Files {
    Files::new("v.mhd", header, data)
}

fn select(lines: &[&str], data: &[u8], component: Option<usize>, time: Option<usize>) -> Result<Volume, VolumeError> {
    let selection = Selection { component, time, ..Selection::default() };
    made(&header(lines), data).select(&selection)
}

fn open(lines: &[&str], data: &[u8]) -> Result<Volume, VolumeError> {
    made(&header(lines), data).open()
}

fn refused(lines: &[&str], data: &[u8], words: &[&str]) -> VolumeError {
    volumes::refused(open(lines, data), words)
}

fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

const TWELVE: [u8; 12] = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12];

#[test]
fn every_element_type_is_read_in_both_byte_orders_raw_and_compressed_local_and_not() {
    macro_rules! check {
        ($($element:literal $type:ident $variant:ident),*) => {$({
            // The ends of the range, and distinct bytes.
            let mut values: Vec<$type> = (1..13).map(|i| i as $type).collect();
            (values[1], values[2]) = ($type::MIN, $type::MAX);
            values[3] = $type::from_le_bytes(std::array::from_fn(|i| 64 - 3 * i as u8));
            for big in [false, true] {
                let bytes: Vec<u8> = values
                    .iter()
                    .flat_map(|value| if big { value.to_be_bytes() } else { value.to_le_bytes() })
                    .collect();
                for (compressed, local) in [(false, false), (false, true), (true, false), (true, true)] {
                    let data = if compressed { zlib(&bytes) } else { bytes.clone() };
                    let order = if big { "ElementByteOrderMSB = True" } else { "BinaryDataByteOrderMSB = False" };
                    let packed = format!("CompressedData = {compressed}");
                    let file = if local { "ElementDataFile = LOCAL" } else { "ElementDataFile = v.raw" };
                    let mut mhd = header(&[concat!("ElementType = ", $element), order, &packed, file]).into_bytes();
                    if local {
                        mhd.extend_from_slice(&data);
                    }
                    let files = made("", if local { &[] } else { &data });
                    let volume = files.with("v.mhd", &mhd).open().unwrap();
                    let what = format!("{} big {big} compressed {compressed} local {local}", $element);
                    assert_eq!(volume.voxels, Voxels::$variant(values.clone()), "{what}");
                    assert!(volume.notes.is_empty(), "{what}: {:?}", volume.notes);
                }
            }
        })*};
    }
    // Sizes from MetaIO's metaTypes.h: MET_LONG has four bytes.
    #[expect(clippy::cast_possible_truncation, clippy::cast_precision_loss, clippy::cast_lossless, reason = "1 to 12")]
    #[expect(clippy::cast_sign_loss, trivial_numeric_casts, reason = "1 to 12")]
    {
        check!("MET_UCHAR" u8 U8, "MET_CHAR" i8 I8, "MET_USHORT" u16 U16, "MET_SHORT" i16 I16, "MET_UINT" u32 U32,
               "MET_INT" i32 I32, "MET_ULONG" u32 U32, "MET_LONG" i32 I32, "MET_ULONG_LONG" u64 U64,
               "MET_LONG_LONG" i64 I64, "MET_FLOAT" f32 F32, "MET_DOUBLE" f64 F64);
    }
}

#[test]
fn keys_are_read_in_any_case_and_unknown_ones_are_kept() {
    let text = "objecttype = Image\nNDIMS=3\ndimsize =3 2 2\r\n\nComment = by = hand\nELEMENTTYPE = met_uchar\n\
                elementdatafile = v.raw";
    let volume = made(text, &TWELVE).open().unwrap();
    assert_eq!(volume.voxels, Voxels::U8(TWELVE.to_vec()));
    assert_eq!(volume.metadata, [("Comment".to_owned(), "by = hand".to_owned())]);
    assert_eq!(volume.value([2, 1, 1]), Some(12.0));
}

#[test]
fn a_file_without_a_known_extension_is_recognised_by_its_beginning() {
    let files = made("", &TWELVE);
    files.with("scan", header(&[]).as_bytes());
    assert!(
        volume::open(&files.folder.path().join("scan"), &Selection::default(), &Quiet).is_ok(),
        "it begins with NDims"
    );
}

#[test]
fn geometry_is_read_axis_by_axis() {
    let turned = "TransformMatrix = 0 1 0  0 0 1  1 0 0";
    let volume = open(&["ElementSpacing = 1 2 3", "ElementSize = 9 9 9", "Offset = 4 5 6", turned], &TWELVE).unwrap();
    let geometry = volume.geometry;
    assert_eq!(geometry.spacing, DVec3::new(1.0, 2.0, 3.0));
    assert_eq!(geometry.direction, DMat3::from_cols(DVec3::Y, DVec3::Z, DVec3::X));
    // Two voxels along the second axis, which is the world z axis.
    assert_eq!(geometry.world_from_index(DVec3::new(0.0, 2.0, 0.0)), DVec3::new(4.0, 5.0, 10.0));
    for (origin, matrix) in [("Origin", "Orientation"), ("Position", "Rotation")] {
        let lines = [&format!("{origin} = 1 2 3")[..], &format!("{matrix} = 0 1 0 1 0 0 0 0 1"), "ElementSize = 4 5 6"];
        let geometry = open(&lines, &TWELVE).unwrap().geometry;
        assert_eq!(geometry.origin, DVec3::new(1.0, 2.0, 3.0));
        assert_eq!(geometry.direction, DMat3::from_cols(DVec3::Y, DVec3::X, DVec3::Z));
        assert_eq!(geometry.spacing, DVec3::new(4.0, 5.0, 6.0));
    }
}

#[test]
fn two_axes_are_a_slice_and_four_are_a_volume_if_the_fourth_is_one() {
    let flat = ["NDims = 2", "DimSize = 6 2", "ElementSpacing = 2 3 4", "Offset = 7 8", "TransformMatrix = 0 1 1 0"];
    let volume = open(&flat, &TWELVE).unwrap();
    assert_eq!(volume.geometry.dims, [6, 2, 1]);
    assert_eq!(volume.geometry.spacing, DVec3::new(2.0, 3.0, 1.0));
    assert_eq!(volume.geometry.origin, DVec3::new(7.0, 8.0, 0.0));
    assert_eq!(volume.geometry.direction, DMat3::from_cols(DVec3::Y, DVec3::X, DVec3::Z));
    assert!(matches!(&volume.notes[..], [note] if note.contains("ElementSpacing has 3 numbers")), "{:?}", volume.notes);

    let four = "TransformMatrix = 0 1 0 0  1 0 0 0  0 0 1 0  0 0 0 1";
    let volume = open(&["NDims = 4", "DimSize = 3 2 2 1", "ElementSpacing = 1 1 2 9", four], &TWELVE).unwrap();
    assert_eq!(volume.geometry.dims, [3, 2, 2]);
    assert_eq!(volume.geometry.direction, DMat3::from_cols(DVec3::Y, DVec3::X, DVec3::Z));

    let error = refused(&["NDims = 5", "DimSize = 3 2 1 1 2"], &TWELVE, &["3×2×1×1×2", "three spatial axes"]);
    assert!(matches!(error, VolumeError::TooManyAxes { .. }), "{error}");
}

#[test]
fn slices_are_found_by_list_and_by_pattern() {
    let list = |kind: &str, names: &str| header(&[&format!("ElementDataFile = {kind}\n{names}")]);
    let halves = made("", &[]);
    halves.with("a1", &TWELVE[..6]).with("a2", &TWELVE[6..]).with("a3", &TWELVE[6..]).with("all", &TWELVE);
    for (index, row) in TWELVE.chunks(3).enumerate() {
        halves.with(&format!("row {index}"), row);
    }
    let headers = [
        list("LIST", "a1\na2\n"),
        list("LIST", "a1\r\na2"),
        list("LIST 2", "a1\na2"),
        list("LIST 2D", "a1\na2"),
        list("LIST 1", "row 0\nrow 1\nrow 2\nrow 3\n"),
        list("LIST 3", "all"),
        header(&["ElementDataFile = a%d"]),
        header(&["ElementDataFile = a%01d 1"]),
        header(&["ElementDataFile = a%d 1 2"]),
        header(&["ElementDataFile = a%d 1 3 2"]),
    ];
    for text in headers {
        let volume = halves.with("v.mhd", text.as_bytes()).open().unwrap();
        assert_eq!(volume.voxels, Voxels::U8(TWELVE.to_vec()), "{text}");
    }
}

#[test]
fn slices_may_be_compressed_one_by_one() {
    let files = made(&header(&["CompressedData = True", "ElementDataFile = LIST\na\nb\n"]), &[]);
    files.with("a", &zlib(&TWELVE[..6])).with("b", &zlib(&TWELVE[6..]));
    assert_eq!(files.open().unwrap().voxels, Voxels::U8(TWELVE.to_vec()));
}

#[test]
fn lists_and_patterns_of_the_wrong_length_are_refused() {
    refused(&["ElementDataFile = LIST\na\n"], &[], &["1 files", "2", "line 4"]);
    refused(&["a letter"], &[], &["\"a letter\" is not key = value, a line of a MetaImage header"]);
    refused(&["ElementDataFile = LIST 4\na\n"], &[], &["1 to 3 axes", "4"]);
    refused(&["ElementDataFile = a%d 1 5"], &[], &["5 slices", "2"]);
    refused(&["ElementDataFile = a%s"], &[], &["a%s", "%d"]);
    let error = refused(&["ElementDataFile = LIST\nnowhere\nelsewhere\n"], &[], &["nowhere"]);
    assert!(matches!(error, VolumeError::Open { .. }), "{error}");
    let error = refused(&["DimSize = 3 2 2000000000", "ElementDataFile = s%d"], &[], &["s1"]);
    assert!(matches!(error, VolumeError::Open { .. }), "{error}");
}

#[test]
fn numbers_written_as_text_are_read() {
    let text = b"1 2 3\n4,5 6\t7 8 9.0 1e1 11\r\n12";
    let volume = open(&["BinaryData = False"], text).unwrap();
    assert_eq!(volume.voxels, Voxels::U8(TWELVE.to_vec()));
    let local = header(&["BinaryData = False", "ElementType = MET_FLOAT", "ElementDataFile = LOCAL"])
        + "1 -2.5 nan 4 5 6 7 8 9 10 11 1e30\n";
    let Voxels::F32(voxels) = made(&local, &[]).open().unwrap().voxels else { panic!("MET_FLOAT is f32") };
    assert!(voxels[1] == -2.5 && voxels[2].is_nan() && voxels[11] == 1e30, "{voxels:?}");
}

#[test]
fn text_that_is_short_or_no_number_is_refused() {
    let error = refused(&["BinaryData = False"], b"1 2 3", &["3 numbers", "12"]);
    assert!(matches!(error, VolumeError::ShortText { .. }), "{error}");
    let error = refused(&["BinaryData = False"], b"1 2  3  4  5  6  7  8  9  10  11", &["11 numbers", "12"]);
    assert!(matches!(error, VolumeError::ShortText { .. }), "{error}");
    for (bad, word) in [("1 2 300 4 5 6 7 8 9 10 11 12", "\"300\""), ("1 2 3.5 4 5 6 7 8 9 10 11 12", "\"3.5\"")] {
        let error = refused(&["BinaryData = False"], bad.as_bytes(), &["voxel 2", word, "uint8"]);
        assert!(matches!(error, VolumeError::Text { .. }), "{error}");
    }
    refused(&["BinaryData = False", "CompressedData = True"], b"", &["compressed text"]);
}

#[test]
fn headers_of_data_files_are_skipped_from_either_end() {
    let mut data = vec![99; 5];
    data.extend_from_slice(&TWELVE);
    for size in ["HeaderSize = 5", "HeaderSize = -1"] {
        let volume = open(&[size], &data).unwrap();
        assert_eq!((volume.voxels, volume.notes.len()), (Voxels::U8(TWELVE.to_vec()), 0), "{size}");
    }
    let mut packed = vec![99; 5];
    packed.extend_from_slice(&zlib(&TWELVE));
    assert!(open(&["HeaderSize = 5", "CompressedData = True"], &packed).is_ok(), "zlib after five bytes");
    refused(&["HeaderSize = -2"], &data, &["-2"]);
    refused(&["HeaderSize = -1", "CompressedData = True"], &packed, &["-1", "uncompressed"]);
    let error = refused(&["HeaderSize = 6"], &data, &["11 bytes", "12"]);
    assert!(matches!(error, VolumeError::Short { found: 11, expected: 12, .. }), "{error}");
    let error = refused(&["HeaderSize = 600"], &data, &["0 bytes", "12"]);
    assert!(matches!(error, VolumeError::Short { found: 0, expected: 12, .. }), "{error}");
}

#[test]
fn a_slope_and_an_intercept_give_values_their_meaning() {
    let lines = ["ElementToIntensityFunctionSlope = 0.5", "ElementToIntensityFunctionOffset = -1"];
    let volume = open(&lines, &TWELVE).unwrap();
    assert_eq!((volume.value([0, 0, 0]), volume.statistics().unwrap().max), (Some(-0.5), 5.0));
    refused(&["ElementToIntensityFunctionSlope = inf"], &TWELVE, &["inf"]);
}

#[test]
fn a_compressed_size_that_lies_is_noted_and_ignored() {
    let packed = zlib(&TWELVE);
    for (said, notes) in [(packed.len(), 0), (3, 1), (100_000, 1)] {
        let line = format!("CompressedDataSize = {said}");
        let volume = open(&["CompressedData = True", &line], &packed).unwrap();
        assert_eq!((&volume.voxels, volume.notes.len()), (&Voxels::U8(TWELVE.to_vec()), notes), "{said}");
    }
}

#[test]
fn damaged_zlib_data_are_refused() {
    let packed = zlib(&TWELVE);
    let error = refused(&["CompressedData = True"], &packed[..packed.len() / 2], &["bytes of voxels", "12"]);
    assert!(matches!(error, VolumeError::Short { expected: 12, .. }), "{error}");
    let error = refused(&["CompressedData = True"], &zlib(&TWELVE[..7]), &["7 bytes", "12"]);
    assert!(matches!(error, VolumeError::Short { found: 7, expected: 12, .. }), "{error}");
    let error = refused(&["CompressedData = True"], &TWELVE, &["damaged zlib data", "no voxel is intact"]);
    assert!(matches!(error, VolumeError::Inflate { .. }), "{error}");
    let mut wrong_sum = packed.clone();
    *wrong_sum.last_mut().unwrap() ^= 1;
    let error = refused(&["CompressedData = True"], &wrong_sum, &["damaged zlib data"]);
    assert!(matches!(error, VolumeError::Inflate { .. }), "{error}");
}

#[test]
fn zlib_data_that_hold_more_are_noted() {
    let volume = open(&["CompressedData = True"], &zlib(&[1; 13])).unwrap();
    assert_eq!(volume.voxels, Voxels::U8(vec![1; 12]));
    assert!(matches!(&volume.notes[..], [note] if note.contains("12 bytes")), "{:?}", volume.notes);
}

#[test]
fn a_header_that_promises_more_than_the_file_can_hold_takes_no_memory() {
    let huge = "DimSize = 1000000 1000000 100";
    let error = refused(&[huge], &TWELVE, &["12 bytes", "100000000000000"]);
    assert!(matches!(error, VolumeError::Short { found: 12, expected: 100_000_000_000_000, .. }), "{error}");
    let error = refused(&[huge, "CompressedData = True"], &zlib(&TWELVE), &["100000000000000", "1032"]);
    assert!(matches!(error, VolumeError::Incredible { .. }), "{error}");
    let error = refused(&[huge, "BinaryData = False"], &TWELVE, &["100000000000000"]);
    assert!(matches!(error, VolumeError::ShortText { .. }), "{error}");
    for overflowing in ["4294967296 4294967296 4294967296", "4294967296 4294967296 1", "1 1 99999999999999999999999"] {
        let error = refused(&[&format!("DimSize = {overflowing}")], &TWELVE, &[&overflowing.replace(' ', "×")]);
        assert!(matches!(error, VolumeError::Dims { .. }), "{error}");
    }
}

#[test]
fn dimensions_without_voxels_are_refused() {
    for dims in ["0 2 2", "3 -2 2"] {
        let error = refused(&[&format!("DimSize = {dims}")], &TWELVE, &[&dims.replace(' ', "×")]);
        assert!(matches!(error, VolumeError::Dims { .. }), "{error}");
    }
    refused(&["DimSize = 3 2"], &TWELVE, &["line 2", "2 numbers", "NDims = 3"]);
    refused(&["NDims = three"], &TWELVE, &["line 1", "three"]);
    refused(&["DimSize = 3 2 2.5"], &TWELVE, &["line 2", "2.5"]);
    refused(&["NDims = 0", "DimSize ="], &TWELVE, &["0"]);
}

#[test]
fn spacings_and_axes_that_make_no_grid_are_refused() {
    for spacing in ["1 -1 1", "1 0 1", "1 1 NaN", "inf 1 1"] {
        let error = refused(&[&format!("ElementSpacing = {spacing}")], &TWELVE, &[spacing]);
        assert!(matches!(error, VolumeError::Spacing { .. }), "{error}");
    }
    refused(&["ElementSpacing = 1 1"], &TWELVE, &["ElementSpacing has 2 numbers", "3"]);
    refused(&["ElementSpacing = 1 1 x"], &TWELVE, &["1 1 x"]);
    for matrix in ["0 0 0 0 0 0 0 0 0", "1 0 0 1 0 0 0 0 1", "2 0 0 0 1 0 0 0 1", "1 0 0 0 1 0 0 0 NaN"] {
        let error = refused(&[&format!("TransformMatrix = {matrix}")], &TWELVE, &["orthonormal", "0.001"]);
        assert!(matches!(error, VolumeError::Direction { .. }), "{error}");
    }
    let leans = "TransformMatrix = 1 0 0 0.6 0.8 0 0 0 1";
    let error = refused(&[leans], &TWELVE, &["lean", "53.130° between x and y"]);
    assert!(matches!(error, VolumeError::Lean { .. }), "{error}");
    assert!(open(&["TransformMatrix = 1 1e-4 0 0 1 0 0 0 -1"], &TWELVE).is_ok(), "few digits, mirrored");
}

#[test]
fn missing_keys_are_named() {
    for key in ["NDims", "DimSize", "ElementType", "ElementDataFile"] {
        let error = refused(&[&format!("{key} = (none)")], &TWELVE, &[key]);
        assert!(matches!(error, VolumeError::MissingKey { .. }), "{error}");
    }
    let error = made("", &TWELVE).open().map(|volume| volume.voxels).unwrap_err();
    assert!(matches!(error, VolumeError::Empty { .. }), "an empty file: {error}");
}

#[test]
fn what_is_no_scalar_image_is_refused() {
    refused(&["ObjectType = Mesh"], &TWELVE, &["Mesh"]);
    refused(&["ElementType = MET_STRING"], &TWELVE, &["line 3", "MET_STRING", "MET_UCHAR"]);
    refused(&["CompressedData = maybe"], &TWELVE, &["maybe"]);
    let error = made("NDims = 3\nwhat is this\n", &[]).open().map(|volume| volume.voxels).unwrap_err();
    assert!(error.to_string().contains("line 2") && error.to_string().contains("what is this"), "{error}");
}

#[test]
fn a_component_and_a_time_step_are_read_alone() {
    // Voxel (x, t) has the components 10·(x + 3t) and that plus one.
    let numbers: Vec<u8> = (0..6).flat_map(|n| [10 * n, 10 * n + 1]).collect();
    let lines = ["NDims = 4", "DimSize = 3 1 1 2", "ElementNumberOfChannels = 2"];
    for (packed, data) in [("CompressedData = False", numbers.clone()), ("CompressedData = True", zlib(&numbers))] {
        let lines = [&lines[..], &[packed]].concat();
        for (component, time, expected) in [(0, 0, [0, 10, 20]), (1, 0, [1, 11, 21]), (1, 1, [31, 41, 51])] {
            let volume = select(&lines, &data, Some(component), Some(time)).unwrap();
            assert_eq!((volume.voxels, volume.components), (Voxels::U8(expected.to_vec()), 2), "{packed}");
        }
    }
    let error = refused(&lines, &numbers, &["2 components per voxel", "choose a component from 0 to 1"]);
    assert!(matches!(error, VolumeError::Choose { .. }), "{error}");
    for (component, time, words) in
        [(0, None, "2 time steps"), (2, Some(0), "component 2"), (0, Some(7), "time step 7")]
    {
        let error = select(&lines, &numbers, Some(component), time).map(|volume| volume.voxels).unwrap_err();
        assert!(error.to_string().contains(words), "{error}");
    }
    assert!(select(&[], &TWELVE, Some(0), Some(0)).is_ok(), "all there is");
    refused(&["ElementNumberOfChannels = 0"], &TWELVE, &["line", "ElementNumberOfChannels"]);
}

#[test]
fn data_outside_the_headers_folder_are_not_read() {
    let files = made("", &TWELVE);
    std::fs::create_dir(files.folder.path().join("sub")).unwrap();
    files.with("sub/v.raw", &TWELVE);
    let absolute = files.folder.path().join("v.raw").display().to_string();
    for name in ["../v.raw", "sub/../../v.raw", &absolute, "LIST\n../v.raw\n../v.raw", "../v%d"] {
        let error =
            refused(&[&format!("ElementDataFile = {name}")], &TWELVE, &["v.mhd", "outside the folder of the header"]);
        assert!(matches!(error, VolumeError::Outside { .. }), "{error}");
    }
    for name in ["sub/v.raw", "./v.raw"] {
        files.with("v.mhd", header(&[&format!("ElementDataFile = {name}")]).as_bytes());
        assert!(files.open().is_ok(), "{name} is inside");
    }
}

#[test]
fn a_missing_or_short_data_file_is_named() {
    let error = refused(&["ElementDataFile = gone.raw"], &TWELVE, &["gone.raw"]);
    assert!(matches!(error, VolumeError::Open { .. }), "{error}");
    let error = refused(&["ElementDataFile = ."], &TWELVE, &["cannot open"]);
    assert!(matches!(error, VolumeError::Open { .. }), "{error}");
    let error = refused(&[], &TWELVE[..11], &["v.raw", "11 bytes", "12"]);
    assert!(matches!(error, VolumeError::Short { .. }), "{error}");
}

#[test]
fn odd_but_harmless_things_are_noted() {
    let notes = |lines: &[&str], data: &[u8]| open(lines, data).unwrap().notes;
    let thirteen = [&TWELVE[..], &[0]].concat();
    assert!(matches!(&notes(&[], &thirteen)[..], [note] if note.contains("13") && note.contains("12")), "spare bytes");
    let again = notes(&["Offset = 1 2 3\nOffset = 4 5 6"], &TWELVE);
    assert!(matches!(&again[..], [note] if note.contains("line 5") && note.contains("Offset")), "{again:?}");
}

#[test]
fn no_beginning_of_a_file_panics() {
    let whole = header(&["CompressedData = True", "ElementDataFile = LOCAL"]).into_bytes();
    let whole = [whole, zlib(&TWELVE)].concat();
    let files = made("", &[]);
    for length in 0..whole.len() {
        // Without its checksum, a stream may still contain every voxel.
        if let Ok(volume) = files.with("v.mhd", &whole[..length]).open() {
            assert_eq!(volume.voxels, Voxels::U8(TWELVE.to_vec()), "{length} bytes of {}", whole.len());
            assert!(length + 8 > whole.len(), "{length} bytes of {}", whole.len());
        }
    }
    assert!(files.with("v.mhd", &whole).open().is_ok(), "the whole file");
    assert!(!Path::new("v.raw").exists(), "paths are relative to the header");
}

#[test]
fn a_world_is_a_patients_where_the_orientation_says_what_the_axes_say() {
    let turned = "TransformMatrix = 0 1 0  0 0 1  1 0 0";
    let mirrored = "TransformMatrix = 1 0 0  0 1 0  0 0 -1";
    for (lines, anatomical) in [
        (&["AnatomicalOrientation = RAI"][..], true),
        (&["AnatomicalOrientation = rai"], true),
        (&["AnatomicalOrientation = RAS"], false),
        (&["AnatomicalOrientation = RAS", mirrored], true),
        (&["AnatomicalOrientation = AIR", turned], true),
        (&["AnatomicalOrientation = ???"], false),
        (&["AnatomicalOrientation = RA"], false),
        (&[], false),
    ] {
        assert_eq!(open(lines, &TWELVE).unwrap().anatomical, anatomical, "{lines:?}");
    }
}

#[test]
fn a_per_cent_sign_in_the_name_of_a_file_is_no_pattern() {
    for name in ["3 Rest 60 %.raw", "100%.raw", "%d.raw", "z %02d 1 9 1"] {
        let files = made(&header(&[&format!("ElementDataFile = {name}")]), &[]);
        let volume = files.with(name, &[5; 12]).open().unwrap();
        assert_eq!(volume.voxels.bytes(), [5; 12], "{name}");
    }
    refused(&["ElementDataFile = 3 Rest 60 %.raw"], &[0; 12], &["there is no file of this name", "60 %.raw"]);
}
