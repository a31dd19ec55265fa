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
const FOREIGN: [Foreign; 10] = [
    Foreign {
        name: "a Vaa3D raw file",
        extensions: &["v3draw"],
        recognises: |b| b.starts_with(b"raw_image_stack_by_hpeng"),
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
pub(super) fn describe(path: &Path, beginning: &[u8]) -> String {
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
pub(super) fn is_known(beginning: &[u8]) -> bool {
    name(beginning).is_some()
}

fn name(beginning: &[u8]) -> Option<&'static str> {
    FOREIGN.iter().find(|foreign| (foreign.recognises)(beginning)).map(|foreign| foreign.name)
}

/// Describes a `path` that is an address on a server; `None` for all others.
pub(super) fn describe_address(path: &Path) -> Option<String> {
    let (scheme, _) = path.to_str()?.split_once("://")?;
    let is_address = !path.exists() && matches!(scheme, "http" | "https" | "ftp" | "s3" | "gs" | "gcs" | "az" | "abfs");
    is_address
        .then(|| format!("this is an address ({scheme}); Relume reads files of this machine, so download it first"))
}

/// Describes a folder that some programs treat as one file, of a format without a reader.
pub(super) fn describe_folder(path: &Path) -> Option<&'static str> {
    path.join("index.json").exists().then_some("this folder is a vtk.js data set")
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
