//! VTK XML image data: files that VTK wrote (`tests/tools/make_vti.py`), changed here where they should be refused.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::print_stderr, reason = "a test that cannot run says so")]

#[path = "support/volumes.rs"]
mod volumes;

use std::io::Write as _;
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use relume::progress::{Progress, Quiet};
use relume::volume::{self, Selection, Volume, VolumeError, Voxels};
use tempfile::TempDir;

use volumes::{shared, whole_message};

const POINTS: usize = 5 * 4 * 3;
const CELLS: usize = 4 * 3 * 2;

/// A file that VTK wrote.
fn path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/vti").join(format!("{name}.vti"))
}

fn bytes(name: &str) -> Vec<u8> {
    std::fs::read(path(name)).unwrap()
}

/// A file of our own; the folder goes with the first of the two.
fn file(bytes: &[u8]) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.vti");
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}

fn open(bytes: &[u8]) -> Result<Volume, VolumeError> {
    let (_folder, path) = file(bytes);
    volume::open(&path, &Selection::default(), &Quiet)
}

/// Opens a file that VTK wrote, and reads this array and component of it.
fn choose(name: &str, array: Option<&str>, component: Option<usize>) -> Result<Volume, VolumeError> {
    let selection = Selection { array: array.map(str::to_owned), component, ..Selection::default() };
    volume::open(&path(name), &selection, &Quiet)
}

fn refused(bytes: &[u8], words: &[&str]) -> VolumeError {
    let error = open(bytes).map(|volume| volume.voxels).unwrap_err();
    let message = whole_message(&error);
    assert!(words.iter().all(|word| message.contains(word)), "{message} should contain {words:?}");
    assert!(!message.contains('\n'), "one sentence: {message}");
    error
}

/// `name` with one text in place of another, which must be there.
fn changed(name: &str, from: &str, to: &str) -> Vec<u8> {
    let bytes = bytes(name);
    let at = bytes.windows(from.len()).position(|window| window == from.as_bytes());
    let at = at.unwrap_or_else(|| panic!("{name} has no {from}"));
    [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat()
}

/// The values of `number` points or cells, as the script makes them.
macro_rules! values {
    ($type:ident, $variant:ident, $factor:expr, $first:expr, $number:expr) => {
        Voxels::$variant((0..$number).map(|n| $factor * ((4 * n) as $type + $first)).collect())
    };
}

const WIDE: u32 = 259 * 65539;
const WIDER: u64 = 259 * 65539 * 4_294_967_311;

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_precision_loss,
    reason = "below 240"
)]
fn ramp(kind: &str, number: usize) -> Voxels {
    match kind {
        "UInt8" => values!(u8, U8, 1, 1, number),
        "UInt16" => values!(u16, U16, 259, 1, number),
        "UInt32" => values!(u32, U32, WIDE, 1, number),
        "UInt64" => values!(u64, U64, WIDER, 1, number),
        "Int8" => Voxels::I8((0..number).map(|n| (4 * n as i16 - 118) as i8).collect()),
        "Int16" => values!(i16, I16, 259, -118, number),
        "Int32" => values!(i32, I32, WIDE as i32, -118, number),
        "Int64" => values!(i64, I64, WIDER as i64, -118, number),
        "Float32" => values!(f32, F32, 0.125, -118.0, number),
        "Float64" => values!(f64, F64, 0.125, -118.0, number),
        _ => unreachable!("{kind}"),
    }
}

#[test]
fn every_shared_file_reads_as_vtk_reads_it() {
    let Some(folder) = shared() else { return };
    // A folder of vtk.js is called .vti too.
    let ours = |name: &str| name.ends_with(".vti") && name != "vtkjs/headsq.vti";
    let checked =
        volumes::check_all(&folder, ours, |name, selection| volume::open(&folder.join(name), selection, &Quiet));
    assert!(checked >= 5, "the shared folder has at least 5 such files, {checked} were checked");
}

#[test]
fn every_way_of_storing_is_read() {
    for mode in ["ascii", "binary", "raw", "base64"] {
        for compressor in ["none", "zlib", "lz4", "lzma"] {
            for order in ["little_32", "big_64"] {
                if mode == "ascii" && compressor != "none" {
                    continue;
                }
                let name = format!("{mode}_{compressor}_{order}");
                let volume = choose(&name, None, None).unwrap();
                assert_eq!(volume.voxels, ramp("Int16", POINTS), "{name}");
                assert_eq!(volume.geometry.dims, [5, 4, 3], "{name}");
                assert!(volume.notes.is_empty(), "{name}: {:?}", volume.notes);
            }
        }
    }
}

#[test]
fn every_type_is_read_as_bytes_and_as_text() {
    for bits in ["8", "16", "32", "64"] {
        for kind in ["UInt", "Int", "Float"] {
            let kind = format!("{kind}{bits}");
            if kind != "Float8" && kind != "Float16" {
                for name in [format!("type_{kind}"), format!("ascii_{kind}")] {
                    assert_eq!(choose(&name, None, None).unwrap().voxels, ramp(&kind, POINTS), "{name}");
                }
            }
        }
    }
}

#[test]
fn what_old_files_leave_out_has_its_default() {
    for absent in [" header_type=\"UInt32\"", " Direction=\"1 0 0 0 1 0 0 0 1\"", " Scalars=\"ct\""] {
        let volume = open(&changed("binary_zlib_little_32", absent, "")).unwrap();
        assert_eq!(volume.voxels, ramp("Int16", POINTS), "without {absent}");
        assert_eq!(volume.geometry.direction, DMat3::IDENTITY, "without {absent}");
    }
    let volume = open(&changed("raw_none_little_32", "Origin=\"10 20 30\" Spacing=\"1 2 3\"", "")).unwrap();
    assert_eq!((volume.geometry.origin, volume.geometry.spacing), (DVec3::ZERO, DVec3::ONE));
    let (folder, path) = file(&bytes("raw_zlib_big_64"));
    let bare = folder.path().join("scan");
    std::fs::rename(path, &bare).unwrap();
    assert!(volume::open(&bare, &Selection::default(), &Quiet).is_ok(), "recognised by its beginning");
}

#[test]
fn extents_and_directions_place_voxels_where_vtk_places_them() {
    let turned = choose("turned", None, None).unwrap();
    assert_eq!(turned.voxels, ramp("UInt8", POINTS), "the active array of two");
    assert_eq!(turned.files, [path("turned")], "what must not be written over");
    // vtkImageData::GetPoint(0), and TransformContinuousIndexToPhysicalPoint of (3, -1, 3).
    assert_eq!(turned.geometry.world_from_index(DVec3::ZERO), DVec3::new(12.0, 22.0, 39.0));
    assert_eq!(turned.geometry.world_from_index(DVec3::X), DVec3::new(12.0, 23.0, 39.0));
    let header = |key: &str| &turned.metadata.iter().find(|(name, _)| name == key).unwrap().1;
    assert_eq!(header("array"), "ct of PointData");
    assert_eq!(header("CellData"), "cells (Float32)");
    assert_eq!(header("TimeValue"), "1.5");
}

#[test]
fn pieces_are_put_together() {
    for name in ["pieces", "pieces_binary"] {
        let points = choose(name, None, None).unwrap();
        assert_eq!(points.voxels, ramp("UInt8", POINTS), "{name}");
        assert_eq!(points.geometry, choose("turned", None, None).unwrap().geometry, "{name}");
        assert_eq!(choose(name, Some("cells"), None).unwrap().voxels, ramp("Float32", CELLS), "{name}");
    }
    refused(&changed("pieces", "Piece Extent=\"2 3 -1", "Piece Extent=\"2 3  0"), &["18 bytes of its extent"]);
    refused(&changed("pieces", "\"3 6 0 2 3 5\" ", "\"3 6 -1 1 3 5\""), &["leave out 9 of 60 voxels"]);
    refused(&changed("pieces", "WholeExtent=\"2 6", "WholeExtent=\"2 7"), &["leave out 12 of 72 voxels"]);
    refused(&changed("pieces", "WholeExtent=\"2 6", "WholeExtent=\"2 5"), &["outside the WholeExtent"]);
    refused(&changed("pieces", "type=\"UInt8\"", "type=\"Int8\" "), &["\"ct\"", "differs in type"]);
    refused(&changed("pieces", "Name=\"ct\"", "Name=\"cT\""), &["cT, cells", "--array"]);
    let mut renamed = String::from_utf8(bytes("pieces_binary")).unwrap();
    let last = renamed.rfind("\"ct\"").unwrap();
    renamed.replace_range(last..last + 4, "\"CT\"");
    refused(renamed.as_bytes(), &["\"ct\"", "a piece lacks"]);
}

#[test]
fn cells_lie_at_their_centres() {
    let cells = choose("cells", None, None).unwrap();
    assert_eq!(cells.voxels, ramp("Float32", CELLS), "the only array");
    assert_eq!(cells.geometry.dims, [4, 3, 2]);
    assert_eq!(cells.geometry.origin, DVec3::new(10.5, 21.0, 31.5));
    assert!(matches!(&cells.notes[..], [note] if note.contains("centre")), "{:?}", cells.notes);
    // Half a step along x is half a unit along the world's y; vtkImageData::GetCell(0) spans 10–12, 22–23, 39–42.
    let turned = choose("turned", Some("cells"), None).unwrap();
    assert_eq!(turned.geometry.origin, DVec3::new(11.0, 22.5, 40.5));
    let flat = choose("flat_cells", None, None).unwrap();
    assert_eq!(flat.voxels, ramp("UInt8", 4 * 3), "one layer");
    assert_eq!(flat.geometry.dims, [4, 3, 1]);
    assert_eq!(flat.geometry.origin, DVec3::new(10.5, 21.0, 51.0), "cells without thickness lie in their plane");
}

#[test]
fn one_of_several_arrays_and_components_is_chosen() {
    let message =
        |array, component| choose("several", array, component).map(|volume| volume.voxels).unwrap_err().to_string();
    let which = message(None, None);
    assert!(which.contains("PointData/ct, flow, labels, CellData/ct") && which.contains("--array NAME"), "{which}");
    assert!(message(Some("pet"), None).contains("--array pet"));
    let component = message(Some("flow"), None);
    assert!(component.contains("3 components") && component.contains("--component N, from 0 to 2"), "{component}");
    assert!(message(Some("flow"), Some(3)).contains("--component 3"));
    assert!(message(Some("labels"), Some(1)).contains("--component 1"));

    assert_eq!(choose("several", Some("labels"), None).unwrap().voxels, ramp("UInt8", CELLS));
    assert_eq!(choose("several", Some("PointData/ct"), Some(0)).unwrap().voxels, ramp("UInt16", POINTS));
    assert_eq!(choose("several", Some("CellData/ct"), None).unwrap().voxels, ramp("Int8", CELLS));
    let Voxels::F32(ramp) = ramp("Float32", POINTS) else { unreachable!() };
    for (index, added) in [0.0, 1.0, 2.0].into_iter().enumerate() {
        let flow = choose("several", Some("flow"), Some(index)).unwrap();
        assert_eq!(flow.voxels, Voxels::F32(ramp.iter().map(|value| value + added).collect()));
        assert_eq!(flow.components, 3);
    }
}

#[test]
fn tags_inside_and_between_arrays_change_no_value() {
    for name in ["tags_ascii", "tags_binary"] {
        // The active array of the cells, because none of the points is.
        let labels = choose(name, None, None).unwrap();
        assert_eq!(labels.voxels, ramp("UInt8", CELLS), "{name}");
        assert_eq!(labels.selection.array.as_deref(), Some("labels"), "{name}: it says which of several it is");
        let asking = Selection { asks: true, ..Selection::default() };
        let there = volume::open(&path(name), &asking, &Quiet).map(|volume| volume.voxels).unwrap_err().to_string();
        assert!(there.contains("flow_Float32, flow_UInt16, labels"), "{there}");
        assert!(
            labels
                .metadata
                .contains(&("PointData".to_owned(), "flow_Float32 (3 × Float32), flow_UInt16 (3 × UInt16)".to_owned()))
        );
        assert_eq!(choose(name, Some("flow_Float32"), Some(0)).unwrap().voxels, ramp("Float32", POINTS), "{name}");
        assert_eq!(choose(name, Some("flow_UInt16"), Some(0)).unwrap().voxels, ramp("UInt16", POINTS), "{name}");
        let bits = choose(name, Some("bits"), None).map(|volume| volume.voxels).unwrap_err().to_string();
        assert!(bits.contains("flow_Float32, flow_UInt16, labels"), "{bits}");
    }
}

#[test]
fn one_of_several_times_is_chosen() {
    let at = |name, time| {
        volume::open(&path(name), &Selection { time, ..Selection::default() }, &Quiet).map(|volume| volume.voxels)
    };
    let which = at("times", None).unwrap_err().to_string();
    assert!(which.contains("3 time steps") && which.contains("--time N, from 0 to 2"), "{which}");
    let Voxels::U8(ramp) = ramp("UInt8", POINTS) else { unreachable!() };
    for (index, added) in [0, 1, 2].into_iter().enumerate() {
        let later = ramp.iter().map(|value| value + added).collect();
        assert_eq!(at("times", Some(index)).unwrap(), Voxels::U8(later), "time {index}");
    }
    assert!(at("times", Some(3)).unwrap_err().to_string().contains("--time 3"));
    assert!(matches!(at("turned", Some(1)), Err(VolumeError::NoSuch { .. })), "--time 1");
}

#[test]
fn tags_that_make_no_image_are_refused() {
    let changes: [(&str, &str, &[&str]); 22] = [
        ("type=\"ImageData\"", "type=\"PolyData\"", &["PolyData", "ImageData"]),
        ("type=\"ImageData\"", "type=\"PImageData\"", &["PImageData", "other files"]),
        ("\"LittleEndian\"", "\"MiddleEndian\"", &["MiddleEndian"]),
        ("\"UInt32\"", "\"UInt16\"", &["header_type", "UInt16"]),
        ("vtkZLibDataCompressor", "vtkZstdDataCompressor", &["vtkZstdDataCompressor", "vtkLZ4DataCompressor"]),
        ("<VTKFile", "<xml><VTKFile", &["<xml>", "<VTKFile>"]),
        ("WholeExtent=\"0 4", "WholeExtent=\"0 4.5", &["WholeExtent", "0 4.5"]),
        ("WholeExtent=\"0 4", "WholeExtent=\"0 99999999999", &["WholeExtent", "99999999999", "32 bits"]),
        ("WholeExtent", "HoleExtent", &["no WholeExtent"]),
        ("WholeExtent=\"0 4", "WholeExtent=\"5 4", &["0×4×3"]),
        ("Piece Extent", "Piece Xtent", &["no Extent"]),
        ("Spacing=\"1 2 3", "Spacing=\"1 2", &["Spacing", "3 numbers"]),
        ("Spacing=\"1 2 3", "Spacing=\"1 -2 3", &["spacing 1 -2 3"]),
        ("Origin=\"10 20", "Origin=\"10 NaN", &["origin"]),
        ("Direction=\"1 0 0", "Direction=\"1 1 0", &["orthonormal"]),
        ("<DataArray type=\"Int16\"", "<DataArray type=\"String\"", &["no array of numbers"]),
        ("<DataArray", "<DataArray NumberOfComponents=\"70000\"", &["70000 components"]),
        ("<DataArray", "<DataArray NumberOfComponents=\"-1\"", &["NumberOfComponents", "-1"]),
        ("format=\"binary\"", "format=\"appended\"", &["\"ct\"", "no offset"]),
        ("format=\"binary\"", "offset=\"0\"", &["\"ct\"", "appended"]),
        ("format=\"binary\"", "format=\"binhex\"", &["binhex"]),
        ("</Piece>", "</Peace>", &["no sound XML"]),
    ];
    for (from, to, words) in changes {
        refused(&changed("binary_zlib_little_32", from, to), words);
    }
    refused(b"", &["no <VTKFile>"]);
    refused(b"<VTKFile type='ImageData'/>", &["no <ImageData>"]);
    refused(b"NDims = 3", &["no <VTKFile>"]);
    refused(b"what & where</VTKFile>", &["no sound XML"]);
    refused(&[0x1f, 0x8b, 8, 0, 0xff, 0xfe], &["v.vti"]);
    refused(&[b"\xff\xfe<".as_slice(), &bytes("cells")].concat(), &["v.vti"]);
    let latin = changed("binary_zlib_little_32", "Name=\"ct\"", "Name=\"@\"");
    let latin: Vec<u8> = latin.into_iter().map(|byte| if byte == b'@' { 0xe9 } else { byte }).collect();
    refused(&latin, &["v.vti"]);
}

#[test]
fn xml_has_no_tricks() {
    let vti = bytes("raw_none_little_32");
    let bomb = "<!DOCTYPE a [<!ENTITY a \"aaaa\"><!ENTITY b \"&a;&a;&a;&a;\">]>";
    refused(&[bomb.as_bytes(), &vti].concat(), &["document type"]);
    refused(&changed("raw_none_little_32", "Name=\"ct\"", "Name=\"&file;\""), &["Name"]);
    let named = open(&changed("raw_none_little_32", "Name=\"ct\"", "Name=\"a&lt;&#27;[2J\"")).unwrap();
    assert_eq!(named.metadata[0].1, "a< [2J of PointData", "without what moves a cursor");
    let nested = "<a>".repeat(1 << 20);
    assert!(open(&changed("raw_none_little_32", "<ImageData", &format!("{nested}<ImageData"))).is_ok(), "no recursion");
    refused(&[b"<VTKFile type='ImageData'>".as_slice(), &b"<b/>".repeat(5 << 20)].concat(), &["bytes of tags"]);
    let wide = format!("<VTKFile {}", "a='' ".repeat(1 << 18));
    assert!(open(&changed("raw_none_little_32", "<VTKFile", &wide)).is_ok(), "many attributes take no time");
    let arrays = "<DataArray/>".repeat(1 << 17);
    refused(&changed("raw_none_little_32", "<CellData>", &format!("<CellData>{arrays}")), &["pieces and arrays"]);
}

/// A file of uint8 points, `last` + 1 of them along x: these words and bytes follow the underscore.
fn appended(last: u64, compressor: &str, words: &[u32], values: &[u8]) -> Vec<u8> {
    let mut file = format!(
        "<VTKFile type=\"ImageData\" byte_order=\"LittleEndian\" compressor=\"{compressor}\"><ImageData \
         WholeExtent=\"0 {last} 0 0 0 0\"><Piece Extent=\"0 {last} 0 0 0 0\"><PointData><DataArray type=\"UInt8\" \
         Name=\"ct\" offset=\"0\"/></PointData></Piece></ImageData><AppendedData encoding=\"raw\">_"
    )
    .into_bytes();
    file.extend(words.iter().flat_map(|word| word.to_le_bytes()));
    file.extend_from_slice(values);
    file
}

fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

const ZLIB: &str = "vtkZLibDataCompressor";

#[test]
fn pieces_that_are_all_the_same_bytes_hold_no_more_than_the_file_can() {
    // Mostly zeros, and some that cannot be compressed.
    let noise: Vec<u8> = (0_u64..3200).map(|n| (n.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 56) as u8).collect();
    let block = zlib(&[noise.clone(), vec![0; (1 << 20) - noise.len()]].concat());
    let words = [1, 1 << 20, 0, word(&block)];
    let one = String::from_utf8(appended((1 << 20) - 1, ZLIB, &[], &[])).unwrap();
    let piece = &one[one.find("<Piece").unwrap()..one.find("</ImageData").unwrap()];
    let piece = |k: usize| piece.replace("0 0 0 0\"", &format!("0 0 {k} {k}\""));
    let file = |pieces: usize| {
        let whole = one.replacen("0 0 0 0\"", &format!("0 0 0 {}\"", pieces - 1), 1);
        let (start, end) = (whole.find("<Piece").unwrap(), whole.find("</ImageData").unwrap());
        let pieces: String = (0..pieces).map(piece).collect();
        let mut file = format!("{}{pieces}{}", &whole[..start], &whole[end..]).into_bytes();
        file.extend(words.iter().flat_map(|word| word.to_le_bytes()));
        file.extend_from_slice(&block);
        file
    };
    assert_eq!(open(&file(2)).unwrap().voxels.len(), 2 << 20);
    refused(&file(1000), &["cannot hold 1048576000 bytes"]);
}

/// A length as a word before values.
fn word(bytes: &[u8]) -> u32 {
    u32::try_from(bytes.len()).unwrap()
}

#[test]
fn blocks_that_are_not_what_their_table_says_are_refused() {
    let (first, second) = (zlib(&[1, 2, 3, 4]), zlib(&[5, 6]));
    let values = [&first[..], &second].concat();
    let sizes = [word(&first), word(&second)];
    let file = |head: [u32; 3], sizes: &[u32], values: &[u8]| appended(5, ZLIB, &[&head[..], sizes].concat(), values);
    assert_eq!(open(&file([2, 4, 2], &sizes, &values)).unwrap().voxels, Voxels::U8(vec![1, 2, 3, 4, 5, 6]));
    let three = zlib(&[4, 5, 6]);
    let halves = [zlib(&[1, 2, 3]), three.clone()].concat();
    assert_eq!(open(&file([2, 3, 0], &[word(&three); 2], &halves)).unwrap().voxels.len(), 6, "0 is a whole block");

    // Tables that do not make six bytes.
    for head in [[0, 4, 2], [1, 4, 2], [2, 4, 3], [3, 4, 2], [2, 4, 0], [1, 4, 6], [u32::MAX; 3], [0; 3], [6, 0, 6]] {
        let error = refused(&file(head, &sizes, &values), &["\"ct\"", "6 bytes of its extent", &head[0].to_string()]);
        assert!(matches!(error, VolumeError::VtiArray { decoded: 0, .. }), "{error}");
    }
    // Sizes that cannot be, or are not in the file.
    refused(&file([2, 4, 2], &[0, sizes[1]], &values), &["block 0", "0 compressed bytes"]);
    refused(&file([2, 4, 2], &[u32::MAX, sizes[1]], &values), &["block 0", "4294967295 compressed bytes"]);
    refused(&file([2, 4, 2], &[sizes[0], 999], &values), &["the file has", "1011"]);
    // Blocks that are longer or shorter than they should be, or damaged.
    let block = |bytes: &[u8]| [&zlib(bytes)[..], &second].concat();
    let sized = |bytes: &[u8]| [word(&zlib(bytes)), sizes[1]];
    let long = [1, 2, 3, 4, 5];
    refused(&file([2, 4, 2], &sized(&long), &block(&long)), &["block 0", "after 4 bytes"]);
    refused(&file([2, 4, 2], &sized(&long[..3]), &block(&long[..3])), &["block 0", "3 bytes"]);
    refused(&file([2, 4, 2], &[sizes[0] - 1, sizes[1] + 1], &values), &["block 0"]);
    refused(&file([2, 4, 2], &sizes, &[&first[..], &[0; 20]].concat()), &["block 1"]);
    // One byte a block is allowed, unless the table outgrows what it is a table of.
    let many = vec![9; 1 << 20];
    refused(&appended((1 << 20) - 1, ZLIB, &[&[1 << 20, 1, 1], &many[..]].concat(), &[]), &["more than there can be"]);
}

#[test]
fn a_bomb_decodes_to_no_more_than_is_stated() {
    let bomb = zlib(&vec![0; 64 << 20]);
    let head = |size: u32| [1, size, size, word(&bomb)];
    refused(&appended(999_999, ZLIB, &head(1_000_000), &bomb), &["block 0", "1000000"]);
    // What no compressor reaches is refused before there is memory for it.
    refused(&appended(2_000_000_000, ZLIB, &head(2_000_000_001), &bomb), &["cannot be 2000000001 bytes"]);
    refused(&appended(99_999, "vtkLZ4DataCompressor", &[1, 100_000, 0, 9], &[0; 9]), &["9 compressed bytes"]);
    refused(&appended(99_999, "vtkLZMADataCompressor", &[1, 100_000, 0, 9], &[0; 9]), &["9 compressed bytes"]);
    refused(&appended(9, "vtkLZ4DataCompressor", &[1, 10, 0, 9], &[255; 9]), &["block 0"]);
    refused(&appended(9, "vtkLZMADataCompressor", &[1, 10, 0, 9], &[255; 9]), &["block 0"]);
}

#[test]
fn an_xz_block_that_asks_for_too_much_memory_is_refused() {
    use liblzma::stream::{Check, Filters, LzmaOptions, Stream};
    for (dictionary, fits) in [(64 << 20, true), (256 << 20, false)] {
        let mut options = LzmaOptions::new_preset(1).unwrap();
        let stream = Stream::new_stream_encoder(Filters::new().lzma2(options.dict_size(dictionary)), Check::Crc32);
        let mut encoder = liblzma::write::XzEncoder::new_stream(Vec::new(), stream.unwrap());
        encoder.write_all(&[7; 10]).unwrap();
        let block = encoder.finish().unwrap();
        let file = appended(9, "vtkLZMADataCompressor", &[1, 10, 0, word(&block)], &block);
        if fits {
            assert_eq!(open(&file).unwrap().voxels, Voxels::U8(vec![7; 10]), "VTK's level 9");
        } else {
            refused(&file, &["block 0", "memory"]);
        }
    }
}

#[test]
fn lengths_that_do_not_fit_are_refused() {
    let plain = |said: u32, bytes: usize| appended(5, "", &[said], &vec![1; bytes]);
    assert_eq!(open(&plain(6, 6)).unwrap().voxels, Voxels::U8(vec![1; 6]));
    assert!(open(&plain(6, 9)).is_ok(), "what follows is another array's");
    refused(&plain(5, 6), &["5 bytes", "6"]);
    refused(&plain(u32::MAX, 6), &["4294967295 bytes", "6"]);
    refused(&plain(6, 5), &["\"ct\"", "6 bytes"]);
    refused(&appended(5, "", &[], &[1, 0]), &["\"ct\"", "end before"]);
    refused(&appended(5, "", &[], &[]), &["\"ct\"", "begin at byte"]);
    for offset in ["9999", "18446744073709551615"] {
        let offset = format!("offset=\"{offset}\" was=\"");
        refused(&changed("raw_none_little_32", "offset=\"", &offset), &["\"ct\"", "begin at byte"]);
    }
    refused(&changed("raw_none_little_32", "offset=\"0", "offset=\"-1"), &["offset", "-1"]);
    refused(&changed("raw_none_little_32", "   _", "   x"), &["AppendedData", "_"]);
    refused(&changed("raw_none_little_32", "encoding=\"raw\"", "encoding=\"hex\""), &["hex"]);
    // Extents larger than anything, of few bytes.
    for last in ["2147483646 0 2147483646 0 2147483646", "2147483646 0 2147483646 0 0", "2147483646 0 0 0 0"] {
        let extents = String::from_utf8_lossy(&plain(6, 6)).replace("5 0 0 0 0", last);
        refused(extents.as_bytes(), &["v.vti"]);
        let text = extents.replace("offset=\"0\"", "format=\"ascii\"");
        refused(text.as_bytes(), &["v.vti"]);
    }
}

#[test]
fn text_that_is_no_numbers_or_base64_is_refused() {
    let error = refused(&changed("ascii_Int16", "-29526", "-29526.5"), &["voxel 1", "-29526.5", "int16"]);
    assert!(matches!(error, VolumeError::Text { index: 1, .. }), "{error}");
    refused(&changed("ascii_Int16", "-29526", "40000"), &["voxel 1", "40000"]);
    refused(&changed("ascii_Int16", "-29526", ""), &["59 numbers", "60"]);
    let more = open(&changed("ascii_Int16", "-29526", "-29526 1")).unwrap();
    assert!(matches!(&more.notes[..], [note] if note.contains("more than the 60 numbers")), "{:?}", more.notes);
    let error = refused(&changed("ascii_Int16", "-29526", "<b/>"), &["1 numbers", "60"]);
    assert!(matches!(error, VolumeError::ShortText { .. }), "{error}");

    let text = String::from_utf8(bytes("binary_none_little_32")).unwrap();
    let start = text.find("RangeMax").unwrap();
    let start = start + text[start..].find('>').unwrap() + 1;
    let end = start + text[start..].find('<').unwrap();
    let inner = text[start..end].trim().to_owned();
    let with = |inner: &str| format!("{}{inner}{}", &text[..start], &text[end..]).into_bytes();
    assert!(open(&with(&inner)).is_ok(), "without blanks");
    let blanks: String = inner.chars().flat_map(|character| [character, '\n']).collect();
    assert!(open(&with(&blanks)).is_ok(), "with blanks everywhere");
    // 60 bytes, of which four are the length.
    refused(&with(&inner[..80]), &["56 bytes", "120"]);
    refused(&with(&inner[..81]), &["base64"]);
    refused(&with(""), &["\"ct\"", "end before"]);
    refused(&with(&format!("{}*{}", &inner[..20], &inner[21..])), &["base64"]);
    refused(&with(&format!("{}={}", &inner[..20], &inner[21..])), &["base64"]);
}

#[test]
fn no_beginning_of_a_file_and_no_wrong_byte_panics() {
    let (_folder, path) = file(&[]);
    let attempt = |bytes: &[u8]| {
        // Some file systems wait for the disk when a file is cut and written again.
        std::fs::remove_file(&path).unwrap();
        std::fs::write(&path, bytes).unwrap();
        volume::open(&path, &Selection::default(), &Quiet)
    };
    for name in ["raw_zlib_little_32", "base64_lz4_little_32", "binary_lzma_big_64", "ascii_Float32", "pieces"] {
        let whole = bytes(name);
        let voxels = attempt(&whole).unwrap().voxels;
        for length in 0..whole.len() {
            if let Ok(volume) = attempt(&whole[..length]) {
                // Behind the values, nothing is missed.
                assert_eq!(volume.voxels, voxels, "{length} bytes of {name}");
            }
        }
        for index in 0..whole.len() {
            for flipped in [0x01, 0x20, 0xff] {
                let mut damaged = whole.clone();
                damaged[index] ^= flipped;
                if let Ok(volume) = attempt(&damaged) {
                    assert!(volume.voxels.len() <= 4096, "byte {index} of {name}");
                }
            }
        }
    }
}

#[test]
fn what_is_no_file_is_refused_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let message = |path: &Path| {
        whole_message(&volume::open(path, &Selection::default(), &Quiet).map(|volume| volume.voxels).unwrap_err())
    };
    std::fs::create_dir(at("folder.vti")).unwrap();
    assert!(message(&at("folder.vti")).contains("a folder"));
    assert!(message(&at("none.vti")).contains("none.vti"));
    #[cfg(unix)]
    {
        assert!(std::process::Command::new("mkfifo").arg(at("pipe.vti")).status().unwrap().success());
        std::os::unix::fs::symlink("/dev/zero", at("zero.vti")).unwrap();
        std::os::unix::fs::symlink(path("turned"), at("link.vti")).unwrap();
        assert!(message(&at("pipe.vti")).contains("a pipe"));
        assert!(message(&at("zero.vti")).contains("a device"));
        assert!(volume::open(&at("link.vti"), &Selection::default(), &Quiet).is_ok(), "a link is followed");
    }
}

#[test]
fn reading_is_reported_and_can_be_cancelled() {
    struct Listener(std::sync::Mutex<Vec<(u64, u64)>>, bool);
    impl Progress for Listener {
        fn report(&self, stage: &str, done: u64, total: u64) {
            assert_eq!(stage, "reading turned.vti");
            self.0.lock().unwrap().push((done, total));
        }
        fn cancelled(&self) -> bool {
            self.1
        }
    }
    let listen = |cancel| {
        let listener = Listener(std::sync::Mutex::default(), cancel);
        let volume = volume::open(&path("turned"), &Selection::default(), &listener);
        (volume, listener.0.into_inner().unwrap())
    };
    let (volume, reports) = listen(false);
    assert!(volume.is_ok());
    assert_eq!(reports, [(60, 60)]);
    let (volume, _) = listen(true);
    assert!(matches!(volume, Err(VolumeError::Cancelled { .. })));
}
