//! NRRD files: real ones from the shared folder, and generated ones of every type, encoding, layout and space; invalid
//! files.

use crate::support::volumes;

use std::fmt::Write as _;
use std::io::Write as _;

use flate2::Compression;
use flate2::write::GzEncoder;
use glam::{DMat3, DVec3};
use relume::document::SceneOptions;
use relume::progress::Quiet;
use relume::volume::{self, LabelPreset, Selection, Unit, Volume, VolumeError, Voxels};
use volumes::Files;

#[test]
fn every_shared_file_reads_as_an_independent_reader_found_it() {
    let Some(folder) = volumes::shared() else { return };
    let ours = |name: &str| name.ends_with(".nrrd") || name.ends_with(".nhdr") || name == "ct/headsq";
    let checked = volumes::check_all(&folder, ours, |name, selection| {
        let name = if name == "ct/headsq" { "ct/headsq/quarter.nhdr" } else { name };
        volume::open(&folder.join(name), selection, &Quiet)
    });
    assert!(checked >= 23, "the shared folder has at least 23 such files, {checked} were checked");
}

/// Header for 3×2×2 bytes in `v.raw`, in which `lines` replace the defaults.
fn header(lines: &[&str]) -> String {
    let defaults = ["type: uchar", "dimension: 3", "sizes: 3 2 2", "encoding: raw", "data file: v.raw"];
    let key = |line: &str| line.split(':').next().unwrap().to_owned();
    let stated = |default: &str| lines.iter().any(|line| key(line) == key(default));
    let mut text = "NRRD0005\n".to_owned();
    // The list of files comes last.
    for line in defaults.iter().filter(|default| !stated(default)).chain(lines).filter(|line| !line.contains("LIST")) {
        if !line.ends_with("(none)") {
            writeln!(text, "{line}").unwrap();
        }
    }
    lines.iter().filter(|line| line.contains("LIST")).for_each(|line| writeln!(text, "{line}").unwrap());
    text
}

fn made(header: &str, data: &[u8]) -> Files {
    Files::new("v.nhdr", header, data)
}

fn open(lines: &[&str], data: &[u8]) -> Result<Volume, VolumeError> {
    made(&header(lines), data).open()
}

fn refused(lines: &[&str], data: &[u8], words: &[&str]) -> VolumeError {
    made(&header(lines), data).refused(words)
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn bzip2(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::best());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn hex(bytes: &[u8]) -> Vec<u8> {
    // Split into lines, in upper and lower case.
    let digits = bytes.iter().enumerate().map(|(index, byte)| match index % 5 {
        0 => format!("{byte:02X}\n"),
        _ => format!("{byte:02x}"),
    });
    digits.collect::<String>().into_bytes()
}

const TWELVE: [u8; 12] = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12];

#[test]
fn every_type_is_read_by_each_of_its_names_in_every_encoding_and_byte_order() {
    macro_rules! check {
        ($($type:ident $variant:ident $names:expr;)*) => {$({
            // The ends of the range, and distinct bytes.
            let mut values: Vec<$type> = (1..13).map(|i| i as $type).collect();
            (values[1], values[2]) = ($type::MIN, $type::MAX);
            values[3] = $type::from_le_bytes(std::array::from_fn(|i| 64 - 3 * i as u8));
            for name in $names {
                for big in [false, true] {
                    let bytes: Vec<u8> = values
                        .iter()
                        .flat_map(|value| if big { value.to_be_bytes() } else { value.to_le_bytes() })
                        .collect();
                    let text: String = values.iter().map(|value| format!("{value}\n")).collect();
                    let encoded = [
                        ("raw", bytes.clone()), ("gzip", gzip(&bytes)), ("gz", gzip(&bytes)), ("bzip2", bzip2(&bytes)),
                        ("bz2", bzip2(&bytes)), ("hex", hex(&bytes)), ("ascii", text.clone().into_bytes()),
                        ("text", text.clone().into_bytes()), ("TXT", text.clone().into_bytes()),
                    ];
                    for (encoding, data) in encoded {
                        let endian = if big { "endian: big" } else { "endian: little" };
                        let lines = [&format!("type: {name}")[..], endian, &format!("encoding: {encoding}")];
                        let what = format!("{lines:?}");
                        let volume = open(&lines, &data).unwrap();
                        assert_eq!(volume.voxels, Voxels::$variant(values.clone()), "{what}");
                        assert!(volume.notes.is_empty(), "{what}: {:?}", volume.notes);
                        let attached = header(&[&lines[..], &["data file: (none)"]].concat()) + "\n";
                        let attached = [attached.as_bytes(), &data].concat();
                        let volume = made("", &[]).with("v.nhdr", &attached).open().unwrap();
                        assert_eq!(volume.voxels, Voxels::$variant(values.clone()), "{what}, attached");
                    }
                }
            }
        })*};
    }
    // Names from the format definition.
    #[expect(clippy::cast_possible_truncation, clippy::cast_precision_loss, clippy::cast_lossless, reason = "1 to 12")]
    #[expect(clippy::cast_sign_loss, trivial_numeric_casts, reason = "1 to 12")]
    {
        check!(
            i8 I8 ["signed char", "int8", "int8_t"];
            u8 U8 ["uchar", "unsigned char", "uint8", "uint8_t"];
            i16 I16 ["short", "short int", "signed short", "signed short int", "int16", "int16_t"];
            u16 U16 ["ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"];
            i32 I32 ["int", "signed int", "int32", "int32_t"];
            u32 U32 ["uint", "unsigned int", "uint32", "uint32_t"];
            i64 I64 ["longlong", "long long", "long long int", "signed long long", "signed long long int", "int64",
                     "int64_t"];
            u64 U64 ["ulonglong", "unsigned long long", "unsigned long long int", "uint64", "uint64_t"];
            f32 F32 ["float"];
            f64 F64 ["double"];
        );
    }
}

#[test]
fn fields_are_read_however_they_are_spaced_and_pairs_are_kept() {
    let text = "NRRD0004\r\n# by hand\r\nTYPE: UChar\r\nDimension:3\r\nsizes:  3 2 2 \r\nEncoding: raw\r\n\
                byteskip: 1\r\ncontent: frog: a\r\nITK_Filter:=a := b\r\ndatafile: v.raw\r\n";
    let volume = made(text, &[&[0], &TWELVE[..]].concat()).open().unwrap();
    assert_eq!(volume.voxels, Voxels::U8(TWELVE.to_vec()));
    let pair = |key: &str, value: &str| (key.to_owned(), value.to_owned());
    assert_eq!(volume.metadata, [pair("content", "frog: a"), pair("ITK_Filter", "a := b")]);
    assert_eq!(volume.value([2, 1, 1]), Some(12.0));
    let files = made("", &TWELVE);
    files.with("scan", header(&[]).as_bytes());
    assert!(
        volume::open(&files.folder.path().join("scan"), &Selection::default(), &Quiet).is_ok(),
        "it begins with NRRD"
    );
    let not_utf8 = [header(&[]).as_bytes(), b"content: \xff\xfe\n"].concat();
    assert!(made("", &TWELVE).with("v.nhdr", &not_utf8).open().is_ok(), "what is not UTF-8 matters to nobody");
}

#[test]
fn lines_are_skipped_before_inflating_and_bytes_after() {
    let behind = |bytes: &[u8]| [&b"one\ntwo\n"[..], bytes].concat();
    let padded = [&[99; 5], &TWELVE[..]].concat();
    let text = b"xxxxx1 2 3 4 5 6 7 8 9 10 11 12";
    for (encoding, data) in [
        ("raw", padded.clone()),
        ("gzip", gzip(&padded)),
        ("bzip2", bzip2(&padded)),
        ("text", text.to_vec()),
        ("hex", [b"zzzzz", &hex(&TWELVE)[..]].concat()),
    ] {
        let lines = [&format!("encoding: {encoding}")[..], "line skip: 2", "byte skip: 5"];
        let volume = open(&lines, &behind(&data)).unwrap();
        assert_eq!((volume.voxels, volume.notes.len()), (Voxels::U8(TWELVE.to_vec()), 0), "{encoding}");
    }
    for (encoding, data) in [("raw", padded.clone()), ("gzip", gzip(&padded)), ("bzip2", bzip2(&padded))] {
        let volume = open(&[&format!("encoding: {encoding}"), "byte skip: -1"], &data).unwrap();
        assert_eq!(volume.voxels, Voxels::U8(TWELVE.to_vec()), "{encoding}");
    }
    let attached = header(&["encoding: gzip", "byte skip: -1", "data file: (none)"]) + "\n";
    let attached = [attached.as_bytes(), &gzip(&padded)].concat();
    assert!(made("", &[]).with("v.nhdr", &attached).open().is_ok(), "behind an attached header");
    refused(&["byte skip: -5"], &padded, &["line 7", "-5", "-1"]);
    refused(&["encoding: text", "byte skip: -1"], text, &["-1", "text"]);
    let error = refused(&["line skip: 9"], &behind(&TWELVE), &["0 bytes", "12"]);
    assert!(matches!(error, VolumeError::Short { found: 0, expected: 12, .. }), "{error}");
    let error = refused(&["byte skip: 9000000000000000000"], &TWELVE, &["0 bytes", "12"]);
    assert!(matches!(error, VolumeError::Short { .. }), "{error}");
    let error = refused(&["encoding: gzip", "byte skip: 9000000000000000000"], &gzip(&TWELVE), &["1032"]);
    assert!(matches!(error, VolumeError::Incredible { .. }), "{error}");
    let error = refused(&["encoding: gzip", "byte skip: -1"], &gzip(&TWELVE[..7]), &["7 bytes", "12"]);
    assert!(matches!(error, VolumeError::Short { found: 7, expected: 12, .. }), "{error}");
}

#[test]
fn samples_are_found_in_lists_patterns_slices_and_slabs() {
    let files = made("", &[]);
    files.with("a1", &TWELVE[..6]).with("a2", &TWELVE[6..]).with("a3", &TWELVE[6..]).with("all", &TWELVE);
    for (index, row) in TWELVE.chunks(3).enumerate() {
        files.with(&format!("row {index}"), row).with(&format!("r{:02}", 9 - 3 * index), row);
    }
    for data in [
        "LIST\na1\na2",
        "LIST\r\na1\r\na2\r\n",
        "LIST 2\na1\na2",
        "LIST 1\nrow 0\nrow 1\nrow 2\nrow 3",
        "LIST 3\na1\na2",
        "LIST 3\nall",
        "a%d 1 2 1",
        "a%01d 1 3 2",
        "a%d 1 2 1 3",
        "r%02d 9 0 -3 1",
        "all",
    ] {
        let volume = files.with("v.nhdr", header(&[&format!("data file: {data}")]).as_bytes()).open().unwrap();
        assert_eq!(volume.voxels, Voxels::U8(TWELVE.to_vec()), "{data}");
    }
    files.with("a1", &gzip(&TWELVE[..6])).with("a2", &gzip(&TWELVE[6..]));
    files.with("v.nhdr", header(&["encoding: gzip", "data file: a%d 1 2 1"]).as_bytes());
    assert_eq!(files.open().unwrap().voxels, Voxels::U8(TWELVE.to_vec()), "each compressed");
    for (data, words) in [
        ("LIST\na1", &["1 files", "2", "line"][..]),
        ("LIST 4\na1", &["1 to 3 axes", "4"]),
        ("LIST 3\na1\na2\na3", &["3 files", "divisor of 2"]),
        ("LIST 3", &["0 files"]),
        ("a%d 1 5 1", &["5 files", "2"]),
        ("a%d 5 1 1", &["0 files", "2"]),
        ("a%d 1 2 0", &["0 files", "2"]),
        ("a%s 1 2 1", &["a%s", "%d"]),
        ("LIST\ngone\nelsewhere", &["gone"]),
        ("gone%d 1 2 1", &["gone1"]),
        ("gone%d -9223372036854775808 9223372036854775807 1", &["files"]),
    ] {
        files.with("v.nhdr", header(&[&format!("data file: {data}")]).as_bytes()).refused(words);
    }
}

#[test]
fn anatomical_spaces_are_turned_to_left_posterior_superior_and_others_kept() {
    let geometry = |space: &str, vectors: &str, origin: &str| {
        let lines = [space, &format!("space directions: {vectors}"), &format!("space origin: {origin}")];
        open(&lines, &TWELVE).unwrap().geometry
    };
    let sheet = "(0,2,0) (3,0,0) (0, 0, -4)";
    // Directions of the axes of each space relative to L, P and S.
    for (space, x, y) in [
        ("space: left-posterior-superior", 1.0, 1.0),
        ("space: LPS", 1.0, 1.0),
        ("space: right-anterior-superior", -1.0, -1.0),
        ("space: RAS", -1.0, -1.0),
        ("space: left-anterior-superior", 1.0, -1.0),
        ("space: scanner-xyz", 1.0, 1.0),
        ("space: 3D-left-handed", 1.0, 1.0),
        ("space: 3D-right-handed", 1.0, 1.0),
        ("space dimension: 3", 1.0, 1.0),
    ] {
        let geometry = geometry(space, sheet, "(5,6,7)");
        assert_eq!(geometry.spacing, DVec3::new(2.0, 3.0, 4.0), "{space}");
        assert_eq!(geometry.origin, DVec3::new(5.0 * x, 6.0 * y, 7.0), "{space}");
        let axes = [DVec3::Y * y, DVec3::X * x, DVec3::NEG_Z].map(|axis| axis.to_array());
        assert_eq!(geometry.direction, DMat3::from_cols_array_2d(&axes), "{space}");
    }
    assert!(geometry("space: LPS", "(1,0,0) (0,1,0) (0,0,-1)", "(0,0,0)").direction.determinant() < 0.0, "mirrored");
    assert_eq!(geometry("space: LPS", sheet, "(nan,nan,nan)").origin, DVec3::ZERO);
    refused(&["space: upside-down"], &TWELVE, &["upside-down", "right-anterior-superior"]);
    refused(&["space: LPS", "space directions: (1,0) (0,1) (1,1)"], &TWELVE, &["2 numbers", "3 axes"]);
    refused(&["space: LPS", "space directions: (1,0,0) (0,1,0)"], &TWELVE, &["2 entries", "3"]);
    refused(&["space directions: (1,0,0) (0,1,0) 7"], &TWELVE, &["(1,0,0)", "none"]);
    refused(&["space directions: (1,0,0) (0,1,0) (0,0,1"], &TWELVE, &["vectors"]);
    refused(&["space directions: (1,0,0) (1,0,0) (0,0,1)"], &TWELVE, &["orthonormal"]);
    refused(&["space directions: (1,0,0) (0,0,0) (0,0,1)"], &TWELVE, &["spacing is 1 0 1"]);
    refused(&["space directions: (1,0,0) (0.6,0.8,0) (0,0,1)"], &TWELVE, &["lean", "53.130° between x and y"]);
}

#[test]
fn spacings_and_axis_mins_place_a_volume_without_a_space() {
    let spacings = "spacings: 1 2 3";
    let geometry = open(&[spacings], &TWELVE).unwrap().geometry;
    assert_eq!((geometry.spacing, geometry.origin), (DVec3::new(1.0, 2.0, 3.0), DVec3::ZERO));
    // A cell starts half a spacing before its sample; ITK agrees.
    for (centerings, origin) in [
        ("centerings: cell cell cell", DVec3::new(10.5, 21.0, 31.5)),
        ("centers: node node cell", DVec3::new(10.0, 20.0, 31.5)),
        ("centerings: ??? ??? ???", DVec3::new(10.5, 21.0, 31.5)),
    ] {
        let geometry = open(&[spacings, "axis mins: 10 20 30", centerings], &TWELVE).unwrap().geometry;
        assert_eq!(geometry.origin, origin, "{centerings}");
    }
    assert_eq!(open(&[spacings, "axis mins: 1 nan 1"], &TWELVE).unwrap().geometry.origin, DVec3::ZERO);
    assert_eq!(open(&["spacings: nan 2 3"], &TWELVE).unwrap().geometry.spacing, DVec3::new(1.0, 2.0, 3.0));
    refused(&["spacings: 1 -2 3"], &TWELVE, &["spacing is 1 -2 3"]);
    refused(&["spacings: 1 2"], &TWELVE, &["2 entries", "3"]);
    refused(&["spacings: 1 2 x"], &TWELVE, &["1 2 x"]);
}

#[test]
fn one_axis_is_a_line_and_two_are_a_slice() {
    let volume = open(&["dimension: 1", "sizes: 12", "spacings: 2"], &TWELVE).unwrap();
    assert_eq!((volume.geometry.dims, volume.geometry.spacing), ([12, 1, 1], DVec3::new(2.0, 1.0, 1.0)));
    let flat = ["dimension: 2", "sizes: 6 2", "space dimension: 2", "space directions: (0,2) (3,0)"];
    let geometry = open(&[&flat[..], &["space origin: (4,5)"]].concat(), &TWELVE).unwrap().geometry;
    assert_eq!((geometry.dims, geometry.origin), ([6, 2, 1], DVec3::new(4.0, 5.0, 0.0)));
    assert_eq!(geometry.direction, DMat3::from_cols(DVec3::Y, DVec3::X, DVec3::Z));
    let tilted = ["dimension: 2", "sizes: 6 2", "space: RAS", "space directions: (0,2,0) (0,0,3)"];
    let geometry = open(&tilted, &TWELVE).unwrap().geometry;
    assert_eq!(geometry.direction, DMat3::from_cols(DVec3::NEG_Y, DVec3::Z, DVec3::NEG_X));
}

#[test]
fn a_component_is_read_alone_wherever_its_axis_lies() {
    // Component c of voxel x is 10·c + x.
    let voxel = |c: u8, x: u8| 10 * c + x;
    let interleaved: Vec<u8> = (0..6).flat_map(|x| (0..3).map(move |c| voxel(c, x))).collect();
    let planar: Vec<u8> = (0..3).flat_map(|c| (0..6).map(move |x| voxel(c, x))).collect();
    for kind in ["vector", "RGB-color", "3-color", "XYZ-color", "list", "point", "3-gradient", "covariant-vector"] {
        for (sizes, kinds, data) in [
            ("sizes: 3 6 1 1", format!("kinds: {kind} space space space"), &interleaved),
            ("sizes: 6 1 1 3", format!("kinds: domain domain domain {kind}"), &planar),
        ] {
            for encoding in ["raw", "gzip", "text"] {
                let data = match encoding {
                    "raw" => data.clone(),
                    "gzip" => gzip(data),
                    _ => data.iter().map(|number| format!("{number} ")).collect::<String>().into_bytes(),
                };
                let lines = ["dimension: 4", sizes, &kinds, &format!("encoding: {encoding}")];
                let files = made(&header(&lines), &data);
                for component in 0..3 {
                    let selection = Selection { component: Some(component), ..Selection::default() };
                    let volume = files.select(&selection).unwrap();
                    let expected = (0..6).map(|x| voxel(u8::try_from(component).unwrap(), x)).collect();
                    assert_eq!((volume.voxels, volume.components), (Voxels::U8(expected), 3), "{lines:?}");
                    assert_eq!(volume.geometry.dims, [6, 1, 1], "{lines:?}");
                }
                let kind = kind.to_ascii_lowercase();
                let error = files.refused(&["3 components", &kind, "choose a component from 0 to 2"]);
                assert!(matches!(error, VolumeError::Choose { .. }), "{error}");
                let selection = Selection { component: Some(3), ..Selection::default() };
                let error = files.select(&selection).map(|volume| volume.voxels).unwrap_err();
                assert!(error.to_string().contains("component 3 does not exist"), "{error}");
            }
        }
    }
}

#[test]
fn an_axis_without_direction_is_no_axis_of_space() {
    let lines = ["dimension: 4", "sizes: 3 2 1 2", "space: RAS", "space directions: none (1,0,0) (0,1,0) (0,0,1)"];
    let files = made(&header(&lines), &TWELVE);
    let volume = files.select(&Selection { component: Some(1), ..Selection::default() }).unwrap();
    assert_eq!(volume.voxels, Voxels::U8(vec![2, 5, 8, 11]));
    assert_eq!(volume.geometry.direction, DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0)));
}

#[test]
fn a_time_step_is_read_alone_wherever_its_axis_lies() {
    for (lines, expected) in [
        (&["sizes: 3 2 1 2", "kinds: space space space time"][..], [7, 8, 9, 10, 11, 12]),
        (&["sizes: 2 3 2 1", "kinds: time space space space"], [2, 4, 6, 8, 10, 12]),
        (&["sizes: 3 2 2 1", "kinds: space time space space"], [4, 5, 6, 10, 11, 12]),
        (&["sizes: 3 2 1 2"], [7, 8, 9, 10, 11, 12]),
        (
            &["sizes: 3 2 1 2", "space: RAST", "space directions: (1,0,0,0) (0,1,0,0) (0,0,1,0) (0,0,0,2)"],
            [7, 8, 9, 10, 11, 12],
        ),
    ] {
        let files = made(&header(&[&["dimension: 4"], lines].concat()), &TWELVE);
        files.refused(&["2 time steps", "choose a time step from 0 to 1"]);
        let volume = files.select(&Selection { time: Some(1), ..Selection::default() }).unwrap();
        assert_eq!(volume.voxels, Voxels::U8(expected.to_vec()), "{lines:?}");
    }
    let both = ["dimension: 5", "sizes: 2 3 1 1 2", "kinds: complex space space space time"];
    let files = made(&header(&both), &TWELVE);
    files.refused(&["2 components", "complex"]);
    let error =
        files.select(&Selection { component: Some(1), ..Selection::default() }).map(|it| it.voxels).unwrap_err();
    assert!(error.to_string().contains("choose a time step from 0 to 1"), "one after the other is asked for: {error}");
    let volume = files.select(&Selection { component: Some(1), time: Some(1), ..Selection::default() }).unwrap();
    assert_eq!(volume.voxels, Voxels::U8(vec![8, 10, 12]));
    let stub = ["dimension: 5", "sizes: 2 6 1 1 1", "kinds: vector space space space stub"];
    let volume = made(&header(&stub), &TWELVE).select(&Selection { component: Some(1), ..Selection::default() });
    assert_eq!(volume.unwrap().components, 2, "an axis of one place is none");
    let many = ["dimension: 5", "sizes: 3 1 1 2 2"];
    let error = refused(&many, &TWELVE, &["3×1×1×2×2"]);
    assert!(matches!(error, VolumeError::TooManyAxes { .. }), "{error}");
    let all = Selection { component: Some(0), time: Some(0), ..Selection::default() };
    assert!(made(&header(&[]), &TWELVE).select(&all).is_ok(), "all there is");
    let named = Selection { array: Some("ct".to_owned()), ..Selection::default() };
    let error = made(&header(&[]), &TWELVE).select(&named).map(|volume| volume.voxels).unwrap_err();
    assert!(error.to_string().contains("the array ct"), "{error}");
}

#[test]
fn a_time_step_is_read_of_the_file_that_has_it() {
    let lines = ["dimension: 4", "sizes: 3 2 1 2", "encoding: gzip", "data file: LIST\na\nb"];
    let files = made(&header(&lines), &[]);
    // The file of the other time step is damaged but not read.
    files.with("a", &[0; 40]).with("b", &gzip(&TWELVE[6..]));
    let volume = files.select(&Selection { time: Some(1), ..Selection::default() }).unwrap();
    assert_eq!(volume.voxels, Voxels::U8(TWELVE[6..].to_vec()));
}

#[test]
fn headers_that_lie_are_refused_before_memory_is_taken() {
    let huge = "sizes: 1000000 1000000 100";
    let error = refused(&[huge], &TWELVE, &["12 bytes", "100000000000000"]);
    assert!(matches!(error, VolumeError::Short { found: 12, expected: 100_000_000_000_000, .. }), "{error}");
    for (encoding, data) in [("gzip", gzip(&TWELVE)), ("bzip2", bzip2(&TWELVE))] {
        let error = refused(&[huge, &format!("encoding: {encoding}")], &data, &[encoding, "100000000000000"]);
        assert!(matches!(error, VolumeError::Incredible { .. }), "{error}");
    }
    refused(&[huge, "encoding: hex"], &hex(&TWELVE), &["100000000000000"]);
    refused(&[huge, "encoding: ascii"], b"1 2 3", &["100000000000000"]);
    for sizes in ["4294967296 4294967296 4294967296", "1 1 99999999999999999999999", "0 2 2", "3 -2 2"] {
        let error = refused(&[&format!("sizes: {sizes}")], &TWELVE, &[&sizes.replace(' ', "×")]);
        assert!(matches!(error, VolumeError::Dims { .. }), "{error}");
    }
    let error = refused(
        &["dimension: 4", "sizes: 4294967296 4294967296 1 1", "kinds: vector space space space"],
        &TWELVE,
        &["4294967296×4294967296"],
    );
    assert!(matches!(error, VolumeError::Dims { .. }), "{error}");
    refused(&["sizes: 3 2"], &TWELVE, &["2 numbers", "dimension: 3"]);
    refused(&["sizes: 3 2 2.5"], &TWELVE, &["2.5"]);
    refused(&["dimension: 0", "sizes:"], &TWELVE, &["0"]);
}

#[test]
fn short_and_damaged_data_are_refused() {
    for (encoding, data) in
        [("raw", TWELVE[..7].to_vec()), ("gzip", gzip(&TWELVE[..7])), ("bzip2", bzip2(&TWELVE[..7]))]
    {
        let error = refused(&[&format!("encoding: {encoding}")], &data, &["7 bytes", "12"]);
        assert!(matches!(error, VolumeError::Short { found: 7, expected: 12, .. }), "{error}");
    }
    refused(&["encoding: hex"], &hex(&TWELVE)[..18], &["bytes", "12"]);
    refused(&["encoding: hex"], b"0102030405060708090a0bxy", &["damaged hex"]);
    refused(&["encoding: text"], b"1 2  3  4  5  6  7  8  9  10  11", &["11 numbers", "12"]);
    refused(&["encoding: text"], b"1 2 300 4 5 6 7 8 9 10 11 12", &["voxel 2", "\"300\"", "uint8"]);
    for (stated, data) in [("gzip", bzip2(&TWELVE)), ("bzip2", gzip(&TWELVE)), ("gzip", TWELVE.to_vec())] {
        let error = refused(&[&format!("encoding: {stated}")], &data, &["damaged", stated]);
        assert!(matches!(error, VolumeError::Inflate { .. }), "{error}");
    }
    let mut wrong_sum = gzip(&TWELVE);
    let end = wrong_sum.len() - 8;
    wrong_sum[end] ^= 1;
    refused(&["encoding: gzip"], &wrong_sum, &["damaged gzip"]);
}

#[test]
fn a_bomb_is_left_where_the_voxels_end() {
    // 64 MiB of zeros for 12 bytes of data.
    let zeros = vec![0; 64 << 20];
    for (encoding, data) in [("gzip", gzip(&zeros)), ("bzip2", bzip2(&zeros))] {
        let started = std::time::Instant::now();
        let volume = open(&[&format!("encoding: {encoding}")], &data).unwrap();
        assert_eq!(volume.voxels, Voxels::U8(vec![0; 12]), "{encoding}");
        assert!(matches!(&volume.notes[..], [note] if note.contains("12 bytes")), "{:?}", volume.notes);
        assert!(started.elapsed().as_secs() < 5, "{encoding}");
    }
}

#[test]
fn data_outside_the_headers_folder_are_not_read() {
    let files = made("", &TWELVE);
    std::fs::create_dir(files.folder.path().join("sub")).unwrap();
    files.with("sub/v.raw", &TWELVE);
    let absolute = files.folder.path().join("v.raw").display().to_string();
    for name in ["../v.raw", "sub/../v.raw", &absolute, "LIST\n../a\n../b", "../v%d 1 2 1", "/dev/zero"] {
        let error = refused(&[&format!("data file: {name}")], &TWELVE, &["v.nhdr", "outside the folder of the header"]);
        assert!(matches!(error, VolumeError::Outside { .. }), "{error}");
    }
    for name in ["sub/v.raw", "./v.raw"] {
        files.with("v.nhdr", header(&[&format!("data file: {name}")]).as_bytes());
        assert!(files.open().is_ok(), "{name} is inside");
    }
}

#[test]
#[cfg(unix)]
fn what_is_no_regular_file_is_refused_and_never_waited_for() {
    use std::os::unix::fs::symlink;
    let files = made(&header(&["data file: data"]), &TWELVE);
    let data = files.folder.path().join("data");
    for (target, word) in
        [("/dev/zero", "device"), ("/", "folder"), ("pipe", "pipe"), ("data", "data"), ("gone", "data")]
    {
        if target == "pipe" {
            let made = std::process::Command::new("mkfifo").arg(files.folder.path().join("pipe")).status().unwrap();
            assert!(made.success(), "mkfifo");
        }
        symlink(target, &data).unwrap();
        let error = files.refused(&["cannot open", "data"]);
        let cause = std::error::Error::source(&error).unwrap().to_string();
        assert!(error.to_string().contains(word) || cause.contains(word), "{target}: {error}: {cause}");
        std::fs::remove_file(&data).unwrap();
    }
    symlink("v.raw", &data).unwrap();
    assert!(files.open().is_ok(), "a link to a file");
    // The header itself may be a special file.
    let pipe = files.folder.path().join("pipe");
    assert!(volume::open(&pipe, &Selection::default(), &Quiet).is_err(), "a pipe as a header");
}

#[test]
fn a_header_that_names_itself_is_data_like_any_other() {
    let files = made(&header(&["data file: v.nhdr"]), &[]);
    let Voxels::U8(voxels) = files.open().unwrap().voxels else { panic!("bytes") };
    assert_eq!(voxels, b"NRRD0005\ntyp");
}

#[test]
fn missing_and_senseless_fields_are_named() {
    for key in ["type", "dimension", "sizes", "encoding"] {
        let error = refused(&[&format!("{key}: (none)")], &TWELVE, &[key]);
        assert!(matches!(error, VolumeError::MissingKey { .. }), "{error}");
    }
    let error = refused(&["type: short", "sizes: 3 2 1"], &TWELVE, &["endian"]);
    assert!(matches!(error, VolumeError::MissingKey { .. }), "{error}");
    refused(&["type: block"], &TWELVE, &["block"]);
    refused(&["type: char"], &TWELVE, &["char", "uchar", "int8"]);
    refused(&["type: int128"], &TWELVE, &["int128", "int16"]);
    refused(&["encoding: zrl"], &TWELVE, &["zrl", "gzip"]);
    refused(&["endian: middle"], &TWELVE, &["middle", "little or big"]);
    refused(&["kinds: space space"], &TWELVE, &["2 entries", "3"]);
    made("NRRD0004\nwhat is this\n", &[]).refused(&["line 2", "what is this"]);
    made("", &[]).refused(&["empty", "0 bytes"]);
    made("\n", &[]).refused(&["NRRD0001"]);
    made("P5 3 2 255\n", &[]).refused(&["P5", "NRRD0001"]);
    let twice = open(&["content: a\ncontent: b"], &TWELVE).unwrap().notes;
    assert!(matches!(&twice[..], [note] if note.contains("content is repeated")), "{twice:?}");
}

#[test]
fn no_beginning_of_a_file_panics() {
    let attached = header(&["encoding: gzip", "data file: (none)", "space: RAS", "space origin: (1,2,3)"]) + "\n";
    let whole = [attached.as_bytes(), &gzip(&TWELVE)].concat();
    let files = made("", &[]);
    for length in 0..whole.len() {
        // Without its checksum and length, and the marker of its last block, a stream may still contain every voxel.
        if let Ok(volume) = files.with("v.nhdr", &whole[..length]).open() {
            assert_eq!(volume.voxels, Voxels::U8(TWELVE.to_vec()), "{length} bytes of {}", whole.len());
            assert!(length + 11 > whole.len(), "{length} bytes of {}", whole.len());
        }
    }
    assert!(files.with("v.nhdr", &whole).open().is_ok(), "the whole file");
}

#[test]
fn a_world_is_a_patients_where_the_space_says_so() {
    let spaces = [
        ("space: right-anterior-superior", true),
        ("space: LAS", true),
        ("space: left-posterior-superior", true),
        ("space: scanner-xyz", false),
        ("space: 3D-right-handed", false),
        ("space dimension: 3", false),
    ];
    for (space, anatomical) in spaces {
        let volume = open(&[space, "space directions: (1,0,0) (0,1,0) (0,0,1)"], &TWELVE).unwrap();
        assert_eq!(volume.anatomical, anatomical, "{space}");
        assert_eq!(volume.downsample([1, 2, 1]).unwrap().anatomical, anatomical, "{space}, in larger voxels");
    }
    let volume = open(&["space: right-anterior-superior", "spacings: 1 2 3"], &TWELVE).unwrap();
    assert!(!volume.anatomical, "where the axes point is not said");
    let files = made(&header(&[spaces[0].0, "space directions: (1,0,0) (0,1,0) (0,0,1)"]), &TWELVE);
    for (direction, anatomical) in [("", true), ("direction = [0, 1, 0, 1, 0, 0, 0, 0, 1]", false)] {
        let scene = format!(
            "version = 1\n[volume]\nfile = \"v.nhdr\"\n{direction}\n[materials.bone]\nreflectance = 0.5\n[transfer]\n\
             intervals = [{{ material = \"bone\", range = [1, 9], opacity = 0.9 }}]\n[lights.day]\nspectrum = \"D65\"\n\
             kind = \"ambient\"\n"
        );
        files.with("scene.toml", scene.as_bytes());
        let scene = relume::document::load(&files.folder.path().join("scene.toml"), &SceneOptions::default(), &Quiet)
            .unwrap()
            .scene;
        assert_eq!(scene.frame.anatomical, anatomical, "what a scene says of its axes is not said by the file");
    }
}

#[test]
fn units_and_segments_are_kept() {
    let unit = |units: &str| open(&["space: left-posterior-superior", units], &TWELVE).unwrap().unit;
    assert_eq!(unit("space units: \"mm\" \"mm\" \"mm\""), Some(Unit::Millimetre));
    assert_eq!(unit("space units: \"microns\" \"um\" \"µm\""), Some(Unit::Micrometre));
    assert_eq!(unit("space units: \"mm\" \"um\" \"mm\""), None, "not one unit");
    assert_eq!(unit("space units: \"furlongs\" \"furlongs\" \"furlongs\""), None);
    let lines = [
        "Segment0_Name:=bone of the leg",
        "Segment0_LabelValue:=3",
        "Segment0_Color:=1 0.5 0",
        "Segment1_LabelValue:=4",
        "Segment1_Color:=red",
        "Segment3_LabelValue:=9",
    ];
    let volume = open(&lines, &TWELVE).unwrap();
    let label = |value, name: &str, colour| LabelPreset { value, name: name.to_owned(), colour };
    assert_eq!(volume.presets.labels, [label(3, "bone of the leg", Some([1.0, 0.5, 0.0])), label(4, "", None)]);
    assert!(volume.has_labels && !open(&[], &TWELVE).unwrap().has_labels);
}

#[test]
fn a_leaning_grid_is_resampled_where_it_is_asked_for() {
    let lines = ["space dimension: 3", "space directions: (1,0,0) (0.5,1,0) (0,0,1)", "space origin: (0,0,0)"];
    let ten: Vec<u8> = TWELVE.iter().map(|byte| 10 * byte).collect();
    let files = made(&header(&lines), &ten);
    files.refused(&["lean", "63.435° between x and y"]);
    let volume = files.select(&Selection { resample: true, ..Selection::default() }).unwrap();
    // The second row lies half a voxel to the right.
    assert_eq!((volume.geometry.dims, volume.geometry.spacing), ([4, 2, 2], DVec3::ONE));
    assert_eq!(volume.voxels.bytes()[..8], [10, 20, 30, 10, 10, 45, 55, 10]);
    assert!(volume.notes.iter().any(|note| note.contains("4×2×2")), "{:?}", volume.notes);
}

#[test]
fn ends_of_axes_give_spacing_and_origin() {
    let of = |lines: &[&str]| open(lines, &[0; 12]).unwrap();
    let node = of(&["axis mins: -1 4 10", "axis maxs: 2 5 10.5", "centers: node node node"]);
    assert_eq!(node.geometry.spacing, DVec3::new(1.5, 1.0, 0.5), "two steps between three nodes");
    assert_eq!(node.geometry.origin, DVec3::new(-1.0, 4.0, 10.0));
    let cell = of(&["axis mins: -1 4 10", "axis maxs: 2 5 10.5", "centerings: cell cell cell"]);
    assert_eq!(cell.geometry.spacing, DVec3::new(1.0, 0.5, 0.25));
    assert_eq!(cell.geometry.origin, DVec3::new(-0.5, 4.25, 10.125));
    // An axis that runs backwards, and spacings, which count more.
    let back = of(&["axis mins: 2 4 10", "axis maxs: -1 5 10.5", "centers: node node node"]);
    assert_eq!((back.geometry.spacing.x, back.geometry.direction.x_axis), (1.5, DVec3::NEG_X));
    assert_eq!(back.geometry.origin, DVec3::new(2.0, 4.0, 10.0));
    let stated = of(&["spacings: 3 3 3", "axis mins: 0 0 0", "axis maxs: 2 5 10.5", "centers: node node node"]);
    assert_eq!(stated.geometry.spacing, DVec3::splat(3.0));
    refused(&["axis maxs: 2 5"], &[0; 12], &["axismaxs", "2 entries", "3"]);
}

#[test]
fn an_axis_of_nan_in_front_of_numbers_is_no_axis_of_space() {
    let data: Vec<u8> = (0..24).collect();
    for lines in [
        ["dimension: 4", "sizes: 2 3 2 2", "spacings: nan 0.5 0.25 2", "kinds: (none)"],
        ["dimension: 4", "sizes: 2 3 2 2", "axis mins: NaN 0 0 0", "axis maxs: NaN 1.5 0.5 4"],
    ] {
        let files = made(&header(&lines), &data);
        files.refused(&["2 components"]);
        let second = files.select(&Selection { component: Some(1), ..Selection::default() }).unwrap();
        assert_eq!((second.geometry.dims, second.geometry.spacing), ([3, 2, 2], DVec3::new(0.5, 0.25, 2.0)));
        assert_eq!(second.value([1, 0, 0]), Some(3.0), "{lines:?}");
    }
    // A last axis without a spacing may be one of space.
    let last = open(&["spacings: 0.5 0.25 nan"], &data[..12]).unwrap();
    assert_eq!((last.geometry.dims, last.geometry.spacing), ([3, 2, 2], DVec3::new(0.5, 0.25, 1.0)));
}

#[test]
fn headers_in_latin_1_and_units_of_axes_are_read() {
    let bytes =
        |text: &str| -> Vec<u8> { text.chars().map(|letter| u8::try_from(u32::from(letter)).unwrap()).collect() };
    let units = |units: &str| {
        let text = header(&["spacings: 0.5 0.25 2", "axis mins: 0 0 10", units, "Gerät:=Größe 3"]);
        let files = made("", &[0; 12]);
        files.with("v.nhdr", &bytes(&text)).open().unwrap()
    };
    let volume = units("units: \"µm\" \"µm\" \"µm\"");
    assert_eq!(volume.unit, Some(Unit::Micrometre));
    assert!(volume.metadata.contains(&("Gerät".to_owned(), "Größe 3".to_owned())), "{:?}", volume.metadata);
    // All axes take the unit of x.
    let mixed = units("units: \"µm\" \"µm\" \"nm\"");
    assert_eq!((mixed.unit, mixed.geometry.spacing.z), (Some(Unit::Micrometre), 0.002));
    assert!(
        (mixed.geometry.origin.z - 0.011).abs() < 1e-12,
        "half a spacing behind the edge: {}",
        mixed.geometry.origin
    );
    let unknown = units("units: \"µm\" \"µm\" \"s\"");
    assert_eq!((unknown.unit, unknown.geometry.spacing.z), (None, 2.0));
    // A list of files in Latin-1.
    let list = made("", &[0; 6]);
    list.with("a.raw", &[0; 6]).with("v.nhdr", &bytes(&(header(&["# ü", "data file: LIST"]) + "v.raw\na.raw\n# ü\n")));
    volumes::refused(list.open(), &["3 files"]);
}

#[test]
fn a_per_cent_sign_in_the_name_of_a_file_is_no_pattern() {
    let twelve: Vec<u8> = (1..13).collect();
    for name in ["scan 40% 1 2 1", "50 % b.raw 0 1 1", "s%02d.raw 1 2 1"] {
        let files = made(&header(&[&format!("data file: {name}")]), &[]);
        assert_eq!(files.with(name, &twelve).open().unwrap().voxels, Voxels::U8(twelve.clone()), "{name}");
    }
    refused(&["data file: scan 40% 1 2 1"], &twelve, &["there is no file of this name", "scan 40%"]);
}
