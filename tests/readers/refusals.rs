//! Refusals at the limits of readers: large files, long lists, and lengths that few bytes claim.
//!
//! Refusals that a format has by itself are in the tests of that format; each has its number in the message:
//!
//! | refused | test |
//! | --- | --- |
//! | several series, components, times, arrays, until one is chosen | `dicom::one_of_two_series_…`, `volumes::check`, `numpy::the_arrays_of_an_archive_…` |
//! | a grid that leans, with its angles | `nifti::a_leaning_grid_…`, `dicom::a_missing_slice_…`, `mrc::a_leaning_cell_…`, `nrrd::a_leaning_grid_…` |
//! | missing and uneven slices, with the distances | `dicom::a_missing_slice_…`, `dicom::rounded_positions_…` |
//! | two slices at one position, with their names | `dicom::two_slices_at_one_place_…`, `dicom::slices_at_one_place_…` |
//! | a panic of a decoder | `volume::guard::tests` (library) |
//! | NIfTI: types, `bitpix`, axes, `vox_offset`, placement, short data | `nifti::headers_that_contradict_…`, `nifti::compressed_files_that_lie_…` |
//! | DICOM: lengths beyond their parents, nesting, a value over 1 MiB | `dicom::damaged_structure_…` |
//! | DICOM: rows, bits, frames, codings, sizes of codestreams, fragments | `dicom::what_cannot_be_read_…`, here |
//! | DICOM segmentations: kinds, places, fractions | `dicom::segments_are_labels_…`, here |
//! | TIFF: tags, compressions, sizes of numbers, two sizes of pages, circles | `tiff::every_refusal_…`, `tiff::pages_of_two_sizes_…`, here |
//! | OME-XML: entities, contradictions, files elsewhere; ImageJ: images that are not there | `volume::tiff::ome::tests` (library), `tiff::descriptions_of_ome_…`, `tiff::planes_of_an_ome_file_…`, `tiff::imagej_images_…` |
//! | slices of two sizes or types, the first that differs | `tiff::slices_that_differ_…` |
//! | legacy VTK: meshes by name, short data, words, a line over 64 KiB | `vtk::files_that_contradict_…` |
//! | NumPy: objects, strings, structures, complex numbers, four axes, a header over 64 KiB | `numpy::headers_of_no_numbers_…`, `numpy::pictures_lines_…`, `numpy::damaged_headers_…` |
//! | MRC: modes 3, 4, 101, dims, extended header | `mrc::headers_that_contradict_…` |
//! | Zarr: codecs, chunks, paths out of the store, plates | `arrays::what_zarr_does_not_mean_…`, `arrays::damaged_chunks_…`, here |
//! | HDF5: several arrays, four axes, filters by number, damaged chunks | `arrays::sizes_of_elements_…`, `arrays::an_array_of_four_axes_…`, `arrays::damaged_hdf5_…`, here |
//! | more voxels than the bytes can hold | each format, here for DICOM and TIFF |
//! | more voxels than memory holds | `program::bad_input::volumes_that_no_memory_holds_…` |
//! | files outside the folder of the header | `nrrd::data_outside_…`, `tiff::planes_of_an_ome_file_…`, `arrays::what_zarr_does_not_mean_…` |
//! | more than 100 000 names in a folder, folders below eight levels | here, `dicom::a_folder_is_read_eight_levels_…` |
#![expect(clippy::cast_possible_truncation, reason = "numbers are made to fit their types")]

use std::fs::File;
use std::io::Write as _;
use std::path::Path;

use relume::progress::Quiet;
use relume::volume::{self, Selection, Volume, VolumeError};

use crate::support::dicom::{DEFLATED, EXPLICIT, Elements, RLE, Value, file, segmentation, slice};
use crate::support::volumes::{self, opened, refused};

fn open(path: &Path) -> Result<Volume, VolumeError> {
    volume::open(path, &Selection::default(), &Quiet)
}

/// Writes a file that begins with `bytes`, with a hole up to `length`.
fn with_hole(path: &Path, bytes: &[u8], length: u64) {
    let mut file = File::create(path).unwrap();
    file.write_all(bytes).unwrap();
    file.set_len(length).unwrap();
}

fn dicom(elements: &Elements, syntax: &str) -> Result<Volume, VolumeError> {
    opened("v.dcm", &file(elements, syntax), &Selection::default())
}

#[test]
fn a_folder_of_more_names_than_100_000_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let one = folder.path().join("one");
    std::fs::create_dir(&one).unwrap();
    // With the folder itself, one name too many.
    for number in 0..100_000 {
        File::create(one.join(number.to_string())).unwrap();
    }
    let error = refused(open(folder.path()), &["more than 100000 files"]);
    assert_eq!(error.code(), "volume-folder-too-large");
}

#[test]
fn headers_of_dicom_end_at_their_limits() {
    let meta = file(&Elements::default(), EXPLICIT);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.dcm");
    // A private value of 70 MB before the pixels, which is in the file.
    let private = [&meta[..], &[0x09, 0, 1, 0x10, b'O', b'B', 0, 0], &70_000_000_u32.to_le_bytes()].concat();
    with_hole(&path, &private, 80_000_000);
    refused(open(&path), &["v.dcm, byte", "more than 67108864 bytes before the pixel data"]);
    // The same in a stream whose length is not known.
    let stated = Elements::default().with(0x0009_1001, "OB", Value::Bytes(vec![0; 70_000_000]));
    refused(dicom(&stated, DEFLATED), &["more than 67108864 bytes before the pixel data"]);
    // Items of a sequence that nobody wants.
    let mut items = [&meta[..], &[0x09, 0, 1, 0x10, b'S', b'Q', 0, 0, 0xff, 0xff, 0xff, 0xff]].concat();
    items.extend([0xfe, 0xff, 0x00, 0xe0, 0, 0, 0, 0].repeat(1_000_001));
    refused(opened("v.dcm", &items, &Selection::default()), &["has more than 1000000 items"]);
}

#[test]
fn frames_of_dicom_hold_what_their_bytes_can() {
    let sides = |side: u16| slice(0.0, 0).short(0x0028_0010, &[side]).short(0x0028_0011, &[side]);
    let coded = |elements: Elements, bytes: Vec<u8>| {
        elements.with(0x7fe0_0010, "OB", Value::Fragments(vec![Vec::new(), bytes]))
    };
    for (syntax, side, words) in [
        ("1.2.840.10008.1.2.4.70", 9000, ["162000000 bytes", "JPEG", "at most 512"]),
        (RLE, 9000, ["162000000 bytes", "RLE", "at most 64"]),
        ("1.2.840.10008.1.2.4.80", 8000, ["128000000 bytes", "JPEG-LS", "at most 131072"]),
        ("1.2.840.10008.1.2.4.90", 8000, ["128000000 bytes", "JPEG 2000", "at most 131072"]),
    ] {
        refused(dicom(&coded(sides(side), vec![0; 8]), syntax), &words);
    }
    refused(dicom(&sides(20_000), DEFLATED), &["800000", "deflate", "at most 1032"]);
    // A frame that no decoder gets, whatever the bytes.
    refused(dicom(&coded(sides(65_000), vec![0; 8]), RLE), &["8450000000 bytes", "at most 268435456"]);
}

/// The beginning of a JPEG 2000 codestream of one tile: the marker of its size.
fn size_of_jpeg_2000(width: u32, height: u32, components: u16) -> Vec<u8> {
    let mut bytes = vec![0xff, 0x4f, 0xff, 0x51, 0, 38 + 3 * components as u8, 0, 0];
    for word in [width, height, 0, 0, width, height, 0, 0] {
        bytes.extend(word.to_be_bytes());
    }
    bytes.extend(components.to_be_bytes());
    bytes.extend([15, 1, 1].repeat(components.into()));
    bytes
}

#[test]
fn codestreams_of_another_size_or_kind_are_refused_before_they_are_decoded() {
    let coded = |elements: Elements, syntax: &str, bytes: Vec<u8>, words: &[&str]| {
        let elements = elements.with(0x7fe0_0010, "OB", Value::Fragments(vec![Vec::new(), bytes]));
        let read = opened("v.dcm", &file(&elements, syntax), &Selection { component: Some(0), ..Selection::default() });
        refused(read, &[&["v.dcm, frame 1"], words].concat());
    };
    let lossless = "1.2.840.10008.1.2.4.90";
    let grey = || slice(0.0, 0);
    coded(grey(), lossless, size_of_jpeg_2000(4, 9, 1), &["4×9 pixels, but the header states 4×3"]);
    coded(grey(), lossless, size_of_jpeg_2000(40_000, 40_000, 1), &["40000×40000 pixels, but the header states 4×3"]);
    coded(grey(), lossless, size_of_jpeg_2000(4, 3, 3), &["3 components, but the header states 1"]);
    // A panic or an error of the decoder, behind a size that fits.
    coded(grey(), lossless, size_of_jpeg_2000(4, 3, 1), &["damaged JPEG 2000 data"]);
    let colour = grey().short(0x0028_0002, &[3]).text(0x0028_0004, "CS", "RGB");
    let frame = vec![0xff, 0xd8, 0xff, 0xf7, 0, 17, 12, 0, 3, 0, 4, 3, 1, 0x11, 0, 2, 0x11, 0, 3, 0x11, 0];
    coded(colour, "1.2.840.10008.1.2.4.80", frame, &["JPEG-LS with 3 components; Relume decodes one"]);
}

#[test]
fn segmentations_of_few_frames_far_apart_are_refused() {
    let far = segmentation("BINARY", &[(1, 0.0, [1; 9]), (1, 1e-2, [1; 9]), (1, 1e6, [1; 9])]);
    refused(dicom(&far, EXPLICIT), &["100000001 slices between the first and the last of 3 frames"]);
    let aside = segmentation("BINARY", &[(1, 0.0, [1; 9]), (1, 2.0, [1; 9]), (1, 5.0, [1; 9])]);
    refused(dicom(&aside, EXPLICIT), &["lies", "steps of", "which is on no grid"]);
}

/// Tags of a page: code, type and four bytes each.
fn page(tags: &[(u16, u16, u32)]) -> Vec<u8> {
    let mut bytes = (tags.len() as u16).to_le_bytes().to_vec();
    for (code, kind, value) in tags {
        bytes.extend(code.to_le_bytes());
        bytes.extend(kind.to_le_bytes());
        bytes.extend(1_u32.to_le_bytes());
        bytes.extend(value.to_le_bytes());
    }
    bytes
}

#[test]
fn lists_and_tags_of_tiff_end_at_their_limits() {
    // A million small copies, which are no slices, and one more.
    let copy = page(&[(254, 3, 1)]);
    let mut bytes = b"II*\0\x08\0\0\0".to_vec();
    for _ in 0..=1_000_000 {
        let next = (bytes.len() + copy.len() + 4) as u32;
        bytes.extend(&copy);
        bytes.extend(next.to_le_bytes());
    }
    refused(opened("v.tif", &bytes, &Selection::default()), &["page 1000001", "more than 1000000 pages"]);
    // A description of 65 MiB, which is in the file.
    let mut bytes = b"II*\0\x08\0\0\0".to_vec();
    let mut tags = page(&[(256, 3, 4), (257, 3, 3), (270, 2, 1000)]);
    tags[2 + 24 + 4..][..4].copy_from_slice(&(65_u32 << 20).to_le_bytes());
    bytes.extend(tags);
    bytes.extend([0; 4]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.tif");
    with_hole(&path, &bytes, 80 << 20);
    refused(open(&path), &["page 1, ImageDescription", "68157440 bytes of values", "at most 67108864"]);
}

#[test]
fn strips_of_tiff_hold_what_their_bytes_can() {
    for (code, name, limit) in [
        (5, "LZW", "4096"),
        (8, "deflate", "1032"),
        (32773, "PackBits", "64"),
        (50000, "zstd", "32768"),
        (7, "JPEG", "512"),
    ] {
        let mut bytes = b"II*\0\x08\0\0\0".to_vec();
        let side = 60_000;
        bytes.extend(page(&[
            (256, 4, side),
            (257, 4, side),
            (258, 3, 8),
            (259, 3, code),
            (262, 3, 1),
            (273, 4, 8),
            (278, 4, side),
            (279, 4, 100),
        ]));
        bytes.extend([0; 4]);
        refused(opened("v.tif", &bytes, &Selection::default()), &["3600000000", name, limit]);
    }
}

#[test]
fn metadata_of_zarr_end_at_their_limits() {
    let folder = volumes::folder(&[(".zgroup", b"{\"zarr_format\": 2}".to_vec())]);
    with_hole(&folder.path().join(".zattrs"), b"{", (64 << 20) + 1);
    refused(open(folder.path()), &[".zattrs", "longer than 67108864 bytes"]);
    let chunk = "{\"name\": \"sharding_indexed\", \"configuration\": {\"chunk_shape\": [2, 2, 2], \"codecs\": [CODECS], \
                 \"index_codecs\": [{\"name\": \"bytes\", \"configuration\": {\"endian\": \"little\"}}]}}";
    let array = |shape: &str, side: &str, codecs: &str| {
        let text = format!(
            "{{\"zarr_format\": 3, \"node_type\": \"array\", \"shape\": {shape}, \"data_type\": \"uint8\", \"fill_value\": 0, \
             \"chunk_grid\": {{\"name\": \"regular\", \"configuration\": {{\"chunk_shape\": {side}}}}}, \
             \"chunk_key_encoding\": {{\"name\": \"default\"}}, \"codecs\": [{codecs}]}}"
        );
        let folder = volumes::folder(&[("zarr.json", text.into_bytes())]);
        open(folder.path())
    };
    let bytes = "{\"name\": \"bytes\"}";
    let inner = chunk.replace("CODECS", bytes);
    refused(array("[8, 8, 8]", "[4, 4, 4]", &chunk.replace("CODECS", &inner)), &["shards inside shards", "one level"]);
    let nine = "[1, 1, 1, 1, 1, 1, 1, 1, 1]";
    refused(array(nine, nine, bytes), &["9 axes; Relume reads 1 to 8"]);
    let index = chunk.replace("CODECS", bytes).replace("[2, 2, 2]", "[1, 1, 1]");
    refused(array("[256, 256, 256]", "[256, 256, 256]", &index), &["its index has more than 67108864 bytes"]);
    // A codec that a reader need not understand is unknown nevertheless.
    let optional = format!("{bytes}, {{\"name\": \"pcodec\", \"must_understand\": false}}");
    refused(array("[8, 8, 8]", "[4, 4, 4]", &optional), &["pcodec", "blosc, gzip"]);
}

#[test]
fn stores_that_are_no_folder_are_named() {
    refused(opened("cells.zarr.zip", b"PK\x03\x04 and more", &Selection::default()), &["a ZIP archive", "unpack"]);
    for address in ["https://example.org/cells.zarr", "s3://cells/cells.zarr"] {
        refused(open(Path::new(address)), &[address, "address", "download"]);
    }
}

#[test]
fn filters_of_hdf5_that_have_no_decoder_are_refused_by_their_numbers() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/hdf5/codings.h5");
    let mut bytes = std::fs::read(path).unwrap();
    // Deflate, 1, becomes zstd, 32015, in the pipelines of all arrays.
    let deflate = b"\x01\0\x08\0\x01\0\x01\0deflate\0";
    let places: Vec<usize> = (0..bytes.len() - deflate.len()).filter(|&at| bytes[at..].starts_with(deflate)).collect();
    assert!(!places.is_empty(), "arrays with deflate");
    for at in places {
        bytes[at..at + 2].copy_from_slice(&32015_u16.to_le_bytes());
    }
    let gzip = Selection { array: Some("/gzip".to_owned()), ..Selection::default() };
    refused(opened("v.h5", &bytes, &gzip), &["array /gzip", "32015", "deflate, shuffle, Fletcher-32, LZF"]);
    // A chunk of more than a GiB: its lengths are 32 bits in the layout of the array.
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/hdf5/codings.h5");
    let mut bytes = std::fs::read(path).unwrap();
    let sides: Vec<u8> = [3_u32, 4, 5, 2].iter().flat_map(|side| side.to_le_bytes()).collect();
    let places: Vec<usize> = (0..bytes.len() - 16).filter(|&at| bytes[at..].starts_with(&sides)).collect();
    assert!(!places.is_empty(), "arrays of chunks");
    for at in places {
        bytes[at..at + 4].copy_from_slice(&100_000_000_u32.to_le_bytes());
    }
    let chunked = Selection { array: Some("/chunked".to_owned()), ..Selection::default() };
    refused(opened("v.h5", &bytes, &chunked), &["array /chunked", "4000000000 bytes", "up to 1073741824"]);
}
