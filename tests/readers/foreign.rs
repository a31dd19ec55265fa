//! Unsupported formats are refused by name.

use crate::support::volumes;

use std::io::Write as _;
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::write::GzEncoder;
use relume::progress::Quiet;
use relume::volume::{self, Selection, VolumeError};

/// Error message for the file or folder `path`.
fn refusal(path: &Path) -> String {
    match volume::open(path, &Selection::default(), &Quiet) {
        Err(error @ (VolumeError::UnknownFormat { .. } | VolumeError::Empty { .. })) => error.to_string(),
        other => panic!("{}: {:?}", path.display(), other.map(|volume| volume.source)),
    }
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

#[test]
fn every_known_format_is_named_by_how_it_begins() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file");
    let files: [(&[u8], &str); 16] = [
        (&gzip(b"raw_image_stack_by_hpengL"), "a Vaa3D raw file, compressed by gzip"),
        (b"raw_image_stack_by_hpengL", "a Vaa3D raw file"),
        (b"v/1\x01\x02\0\0\0", "an OpenEXR picture"),
        (b"ZISRAWFILE\0\0\0\0\0\0", "a Zeiss CZI file"),
        (b"\xda\xce\xbe\x0a\x20\0\0\0ND2 FILE", "a Nikon ND2 file"),
        (b"\x70\0\0\0\x31\x07\0\0\x2a\x96\x03\0\0<\0L\0", "a Leica LIF file"),
        (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1\0\0", "a file of microscopes"),
        (b"\xef\xbb\xbf<SpimData version=\"0.2\">", "an XML file of BigDataViewer"),
        (b"\x89PNG\r\n\x1a\n", "a PNG picture"),
        (b"\xff\xd8\xff\xe0", "a JPEG picture"),
        (b"PK\x03\x04", "a ZIP archive"),
        (&gzip(b"words"), "gzip data"),
        (b"BZh91AY", "bzip2 data"),
        (b"\x78\x9c\x03\0", "zlib data"),
        (b"<?xml version=\"1.0\"?>\n<plist>", "an XML file"),
        (b"{\n  \"zarr_format\": 2}", "a JSON file"),
    ];
    for (bytes, name) in files {
        std::fs::write(&path, bytes).unwrap();
        let said = refusal(&path);
        assert!(said.contains(&format!("this is {name}")), "{name}: {said}");
        for read in ["MetaImage (.mhd, .mha)", "NRRD (.nrrd, .nhdr)", "(.vti)", "(.raw, "] {
            assert!(said.contains(read), "{said}");
        }
    }
}

#[test]
fn a_name_that_promises_what_is_not_there_is_no_proof() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file.v3draw");
    for bytes in [&[][..], &[0; 400], b"words", &[0x1f, 0x8b, 8]] {
        std::fs::write(&path, bytes).unwrap();
        let said = refusal(&path);
        assert!(!said.contains("this is a Vaa3D"), "{said}");
    }
    std::fs::write(&path, b"words").unwrap();
    let said = refusal(&path);
    assert!(said.contains("unknown volume format") && said.contains("a Vaa3D raw file"), "{said}");
    assert!(said.contains("text file"), "{said}");
    // Cut within a character, as the inspected start of a long file may be.
    std::fs::write(&path, "Übung".repeat(1000).as_bytes()).unwrap();
    assert!(refusal(&path).contains("text file"));
    std::fs::write(&path, b"words\0").unwrap();
    assert!(!refusal(&path).contains("text file"));
}

#[test]
fn folders_that_are_data_sets_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("c.vti");
    std::fs::create_dir(&path).unwrap();
    std::fs::write(path.join("index.json"), "{}").unwrap();
    let said = refusal(&path);
    assert!(said.contains("vtk.js"), "{said}");
}

#[test]
fn a_folder_without_a_volume_says_what_it_holds() {
    let folder = tempfile::tempdir().unwrap();
    let said = refusal(folder.path());
    assert!(
        said.contains("this is a folder with 0 files, none of which") && said.contains("folders of DICOM"),
        "{said}"
    );
    std::fs::create_dir_all(folder.path().join("a/2/3/4/5/6/7/8")).unwrap();
    for name in ["words.txt", "a/words.txt", "a/2/3/4/5/6/7/8/deeper.txt", ".hidden"] {
        std::fs::write(folder.path().join(name), "words").unwrap();
    }
    let said = refusal(folder.path());
    assert!(said.contains("this is a folder with 2 files"), "{said}");
}

/// All files and folders below `folder`.
fn below(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries
        .flat_map(|path| if path.is_dir() { [vec![path.clone()], below(&path)].concat() } else { vec![path] })
        .collect()
}

#[test]
fn every_shared_file_is_read_or_refused_in_one_sentence() {
    let Some(folder) = volumes::shared() else { return };
    let names = [
        ("dcm", ""),
        ("tif", ""),
        ("tiff", ""),
        ("nii", ""),
        ("zarr", ""),
        ("zraw", "zlib data"),
        ("plist", "an XML file"),
        ("v3draw", "Vaa3D"),
        ("gz", "gzip"),
        ("img", ""),
        ("nrrd", ""),
        ("nhdr", ""),
        ("mha", ""),
        ("mhd", ""),
        ("vti", ""),
    ];
    for path in below(&folder) {
        let extension = path.extension().unwrap_or_default().to_string_lossy().into_owned();
        match volume::open(&path, &Selection::default(), &Quiet) {
            Ok(_) => {
                let read = [
                    "nrrd", "nhdr", "mha", "mhd", "vti", "nii", "hdr", "img", "gz", "vtk", "npy", "npz", "mrc", "map",
                    "dcm", "", "tif", "tiff", "h5",
                ];
                // Metadata and chunks open their store.
                let is_in_store = path.components().any(|part| part.as_os_str().to_string_lossy().ends_with(".zarr"));
                assert!(
                    is_in_store
                        || read.contains(&extension.as_str())
                        || path.ends_with("slices")
                        || path.ends_with("png8"),
                    "{}",
                    path.display()
                );
            }
            Err(error) => {
                let said = volumes::whole_message(&error);
                assert!(!said.contains('\n'), "{said}");
                let name = names.iter().find(|(end, _)| *end == extension).map_or("", |(_, name)| name);
                let empty = path.ends_with("minimal.img");
                // Compressed files of a format that is read.
                let file = path.to_string_lossy();
                let is_read = [".nii.gz", ".hdr.gz", ".img.gz"].iter().any(|ending| file.ends_with(ending));
                assert!(said.contains(name) || empty || is_read, "{said}");
            }
        }
    }
}

#[test]
fn stores_and_descriptions_of_other_programs_name_the_way_out() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, text).unwrap();
        path
    };
    let description = |loader: &str| {
        format!(
            "<?xml version=\"1.0\"?>\n<SpimData version=\"0.2\">\n<SequenceDescription><ImageLoader>{loader}</ImageLoader>\
             </SequenceDescription></SpimData>"
        )
    };
    for (loader, words) in [
        ("<hdf5 type=\"relative\">embryo 7.h5</hdf5>", ["embryo 7.h5", "/t00000/s00/0/cells"]),
        ("<n5 type=\"relative\">embryo.n5</n5>", ["the N5 store embryo.n5", "export"]),
        ("<zarr type=\"relative\">embryo.ome.zarr</zarr>", ["open the Zarr store", "embryo.ome.zarr"]),
        ("", ["BigDataViewer", "the HDF5 file beside it"]),
    ] {
        let said = refusal(&write("embryo.xml", &description(loader)));
        assert!(words.iter().all(|word| said.contains(word)), "{said}");
    }
    // A store of N5: its root, an array in it, its metadata, and a root without metadata.
    let array =
        "{\"dimensions\":[8,8,4],\"blockSize\":[4,4,4],\"dataType\":\"uint8\",\"compression\":{\"type\":\"raw\"}}";
    write("a.n5/attributes.json", "{\"n5\":\"2.5.1\"}");
    let inside = write("a.n5/setup0/s0/attributes.json", array);
    write("b.n5/c0/attributes.json", array);
    for path in ["a.n5", "a.n5/setup0/s0", "b.n5"].map(|name| folder.path().join(name)).iter().chain([&inside]) {
        let said = refusal(path);
        assert!(said.contains("an N5 store") && said.contains("OME-Zarr, HDF5 or TIFF"), "{said}");
    }
    let said = refusal(&write("attributes.json", "{\"colour\": \"red\"}"));
    assert!(said.contains("this is a JSON file"), "{said}");
}
