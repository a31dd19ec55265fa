//! Recognition of formats without a reader, so that errors can name them.

use std::io::Read;
use std::path::Path;

use flate2::bufread::GzDecoder;

/// A format without a reader.
struct Foreign {
    /// Name that completes "this is …".
    name: &'static str,
    /// File extensions, in lower case.
    extensions: &'static [&'static str],
    recognises: fn(&[u8]) -> bool,
}

/// Known formats; the first that recognises a file names it.
const FOREIGN: [Foreign; 14] = [
    Foreign {
        name: "a Vaa3D raw file",
        extensions: &["v3draw"],
        recognises: |b| b.starts_with(b"raw_image_stack_by_hpeng"),
    },
    Foreign {
        name: "a Zeiss CZI file (export it as OME-TIFF: in ZEN, in Fiji with Bio-Formats, or by bfconvert IN.czi OUT.ome.tiff)",
        extensions: &["czi"],
        recognises: |b| b.starts_with(b"ZISRAWFILE"),
    },
    Foreign {
        name: "a Nikon ND2 file (export it as OME-TIFF: in NIS-Elements, in Fiji with Bio-Formats, or by bfconvert IN.nd2 OUT.ome.tiff)",
        extensions: &["nd2"],
        recognises: |b| b.starts_with(b"\xda\xce\xbe\x0a"),
    },
    Foreign {
        name: "a Leica LIF file (export its image as OME-TIFF: in LAS X, in Fiji with Bio-Formats, or by bfconvert IN.lif OUT.ome.tiff)",
        extensions: &["lif"],
        // A block with a memory description, whose text follows behind its length and a star.
        recognises: |b| b.starts_with(&[0x70, 0, 0, 0]) && b.get(8) == Some(&b'*'),
    },
    Foreign {
        name: "a file of microscopes in OLE format, such as OIB or ZVI (export it as OME-TIFF in Fiji with Bio-Formats)",
        extensions: &["oib", "zvi"],
        recognises: |b| b.starts_with(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"),
    },
    Foreign { name: "an OpenEXR picture", extensions: &["exr"], recognises: |b| b.starts_with(b"v/1\x01") },
    Foreign {
        name: "a PNG picture (open its folder to read slices)",
        extensions: &["png"],
        recognises: |b| b.starts_with(b"\x89PNG"),
    },
    Foreign {
        name: "a JPEG picture (open its folder to read slices)",
        extensions: &["jpg", "jpeg"],
        recognises: |b| b.starts_with(b"\xff\xd8\xff"),
    },
    Foreign {
        name: "a ZIP archive (unpack the volume or the Zarr store in it)",
        extensions: &["zip"],
        recognises: |b| b.starts_with(b"PK\x03\x04"),
    },
    Foreign { name: "gzip data", extensions: &["gz"], recognises: |b| b.starts_with(&[0x1f, 0x8b]) },
    Foreign { name: "bzip2 data", extensions: &["bz2"], recognises: |b| b.starts_with(b"BZh") },
    Foreign {
        name: "zlib data for a MetaImage header (.mhd)",
        extensions: &["zraw"],
        recognises: |b| matches!(b, [0x78, 0x01 | 0x5e | 0x9c | 0xda, ..]),
    },
    Foreign { name: "an XML file other than VTK's", extensions: &["xml"], recognises: |b| b.starts_with(b"<?xml") },
    Foreign {
        name: "a JSON file",
        extensions: &["json"],
        recognises: |b| b.trim_ascii_start().starts_with(b"{") && b.contains(&b'"'),
    },
];

/// Describes the file `path` by its first bytes, or else by its extension.
pub(crate) fn describe(path: &Path, beginning: &[u8]) -> String {
    if let Some(big) = describe_big_data_viewer(beginning) {
        return big;
    }
    if path.file_name().is_some_and(|name| name == N5) && path.parent().is_some_and(is_n5) {
        return format!("this is {N5_STORE}");
    }
    if let Some(name) = name(beginning) {
        let mut inside = Vec::new();
        // Decompresses as much as the truncated stream holds.
        GzDecoder::new(beginning).take(1024).read_to_end(&mut inside).ok();
        return match self::name(&inside) {
            Some(inside) => format!("this is {inside}, compressed by gzip"),
            None => format!("this is {name}"),
        };
    }
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let named = FOREIGN.iter().find(|foreign| foreign.extensions.contains(&extension.as_str()));
    let named = named
        .map_or(String::new(), |foreign| format!(" (the extension suggests {}, the content does not)", foreign.name));
    let text = if is_text(beginning) { " in a text file" } else { "" };
    format!("unknown volume format{text}{named}")
}

/// Whether the first bytes of a file identify a known format without a reader.
pub(crate) fn is_known(beginning: &[u8]) -> bool {
    name(beginning).is_some() || describe_big_data_viewer(beginning).is_some()
}

fn name(beginning: &[u8]) -> Option<&'static str> {
    FOREIGN.iter().find(|foreign| (foreign.recognises)(beginning)).map(|foreign| foreign.name)
}

/// Describes a `path` that is an address on a server; `None` for all others.
pub(crate) fn describe_address(path: &Path) -> Option<String> {
    let (scheme, _) = path.to_str()?.split_once("://")?;
    let is_address = !path.exists() && matches!(scheme, "http" | "https" | "ftp" | "s3" | "gs" | "gcs" | "az" | "abfs");
    is_address
        .then(|| format!("this is an address ({scheme}); Relume reads files of this machine, so download it first"))
}

/// Describes a folder that some programs treat as one file, of a format without a reader.
pub(crate) fn describe_folder(path: &Path) -> Option<String> {
    if path.join("index.json").exists() {
        return Some("this folder is a vtk.js data set".to_owned());
    }
    is_n5(path).then(|| format!("this folder is {N5_STORE}"))
}

/// File of metadata of N5.
const N5: &str = "attributes.json";

/// Name of a store of N5, with the way out.
const N5_STORE: &str =
    "an N5 store, or a part of one (export it as OME-Zarr, HDF5 or TIFF, as Fiji does with its N5 plugin)";

/// Whether the folder `path` is a group or an array of N5: it has the metadata of one, or its name says so and a folder in it
/// has them.
fn is_n5(path: &Path) -> bool {
    /// Longest file that is looked at, and most names of a folder.
    const MOST: usize = 1000;
    let describes = |folder: &Path| {
        let text = relume_base::input::read(&folder.join(N5), 1 << 20).unwrap_or_default();
        let metadata: Option<serde_json::Map<String, serde_json::Value>> = serde_json::from_slice(&text).ok();
        metadata.is_some_and(|metadata| {
            metadata.contains_key("n5") || metadata.contains_key("blockSize") && metadata.contains_key("dimensions")
        })
    };
    let is_named = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("n5"));
    let inside = || std::fs::read_dir(path).into_iter().flatten().flatten().take(MOST);
    describes(path) || is_named && inside().any(|entry| entry.path().join(N5).is_file())
}

/// Describes the XML of `BigDataViewer`, which names the file with the voxels; `None` for other files.
fn describe_big_data_viewer(beginning: &[u8]) -> Option<String> {
    let text = String::from_utf8_lossy(beginning);
    text.trim_start_matches('\u{feff}').trim_start().starts_with('<').then_some(())?;
    text.contains("<SpimData").then_some(())?;
    let named = |tag: &str| {
        let (_, after) = text.split_once(&format!("<{tag}"))?;
        let name = after.split_once('>')?.1.split_once('<')?.0.trim();
        (!name.is_empty()).then(|| super::lengths::printable(name))
    };
    let out = match (named("hdf5"), named("n5"), named("zarr")) {
        (Some(name), ..) => {
            format!("open the HDF5 file that it names, {name}, and choose an array of it, such as /t00000/s00/0/cells")
        }
        (None, Some(name), _) => {
            format!("its voxels are in the N5 store {name}; export them as HDF5, OME-Zarr or TIFF in Fiji")
        }
        (None, None, Some(name)) => format!("open the Zarr store that it names, {name}"),
        _ => "open the HDF5 file beside it, and choose an array of it, such as /t00000/s00/0/cells".to_owned(),
    };
    Some(format!("this is an XML file of BigDataViewer, which describes voxels in another file; {out}"))
}

/// UTF-8 without control characters other than white space; the last character may be truncated.
fn is_text(beginning: &[u8]) -> bool {
    let text = match std::str::from_utf8(beginning) {
        Ok(text) => text,
        Err(error) if error.error_len().is_none() => {
            std::str::from_utf8(&beginning[..error.valid_up_to()]).unwrap_or_default()
        }
        Err(_) => return false,
    };
    !text.is_empty() && !text.contains(|letter: char| letter.is_control() && !letter.is_ascii_whitespace())
}
