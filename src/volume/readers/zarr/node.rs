//! Nodes of a Zarr store: folders with metadata in JSON.

use std::path::{Component, Path, PathBuf};

use serde::Deserialize;
use serde_json::{Map, Value};

use crate::VolumeError;
use crate::readers::lengths::printable;
use relume_base::input;

/// Longest file of metadata in bytes.
const LONGEST: u64 = 64 << 20;

/// Files of metadata: an array or group of version 3, an array, a group and their attributes of version 2.
const FILES: [&str; 5] = ["zarr.json", ".zarray", ".zgroup", ".zattrs", ".zmetadata"];

/// Whether the folder `path` has metadata of Zarr.
pub(crate) fn is_node(path: &Path) -> bool {
    FILES.iter().any(|name| path.join(name).is_file())
}

/// The node that the file `path` belongs to: a file of metadata, or a chunk of an array.
pub(crate) fn node_of(path: &Path) -> Option<PathBuf> {
    /// Folders between a chunk and its array: one for each axis, and `c`.
    const DEEPEST: usize = 9;
    let name = path.file_name()?.to_str()?;
    if FILES.contains(&name) {
        return path.parent().map(or_here);
    }
    let is_key = |name: &str| !name.is_empty() && name.chars().all(|letter| letter.is_ascii_digit() || letter == '.');
    let is_chunk = is_key(name) || name.strip_prefix("c.").is_some_and(is_key);
    let mut folders = path.ancestors().skip(1).take(DEEPEST);
    if is_chunk { folders.find(|folder| folder.join(".zarray").is_file() || is_array(folder)) } else { None }
        .map(or_here)
}

/// The folder, or the current one for an empty path.
fn or_here(folder: &Path) -> PathBuf {
    if folder.as_os_str().is_empty() { PathBuf::from(".") } else { folder.to_owned() }
}

/// Whether `folder` is an array of version 3.
fn is_array(folder: &Path) -> bool {
    Node::read(folder).is_ok_and(|node| node.array.is_some())
}

/// A group or an array.
#[derive(Debug)]
pub(super) struct Node {
    /// Its folder.
    pub(super) path: PathBuf,
    /// File of its description, for messages.
    pub(super) file: PathBuf,
    /// Description of an array; `None` for a group.
    pub(super) array: Option<Description>,
    /// Attributes of OME-Zarr, or all of them.
    pub(super) attributes: Map<String, Value>,
    /// File of the attributes, for messages.
    pub(super) attributes_file: PathBuf,
}

/// Description of an array.
#[derive(Debug)]
pub(super) enum Description {
    V2(Box<V2>),
    V3(Box<V3>),
}

/// `.zarray`.
#[derive(Debug, Deserialize)]
pub(super) struct V2 {
    pub(super) zarr_format: u64,
    pub(super) shape: Vec<usize>,
    pub(super) chunks: Vec<usize>,
    pub(super) dtype: Value,
    #[serde(default)]
    pub(super) compressor: Value,
    #[serde(default)]
    pub(super) fill_value: Value,
    pub(super) order: Option<String>,
    pub(super) filters: Option<Vec<Value>>,
    pub(super) dimension_separator: Option<String>,
}

/// `zarr.json`.
#[derive(Debug, Deserialize)]
pub(super) struct V3 {
    zarr_format: u64,
    node_type: String,
    #[serde(default)]
    attributes: Map<String, Value>,
    #[serde(default)]
    pub(super) shape: Vec<usize>,
    #[serde(default)]
    pub(super) data_type: Value,
    #[serde(default)]
    pub(super) chunk_grid: Value,
    #[serde(default)]
    pub(super) chunk_key_encoding: Value,
    #[serde(default)]
    pub(super) fill_value: Value,
    #[serde(default)]
    pub(super) codecs: Vec<Value>,
    pub(super) dimension_names: Option<Vec<Option<String>>>,
    #[serde(default)]
    pub(super) storage_transformers: Vec<Value>,
}

/// `.zgroup`.
#[derive(Debug, Deserialize)]
struct Group {
    zarr_format: u64,
}

impl Node {
    /// Reads the metadata of the folder `path`.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Field`] if there are none, or if they are invalid or too long; [`VolumeError::Open`].
    pub(super) fn read(path: &Path) -> Result<Self, VolumeError> {
        let file = path.join("zarr.json");
        if file.is_file() {
            let mut node: V3 = json(&file)?;
            let version = |node: &V3| format!("zarr_format is {}, not 3", node.zarr_format);
            if node.zarr_format != 3 {
                return Err(wrong(&file, "zarr_format", version(&node)));
            }
            let mut attributes = std::mem::take(&mut node.attributes);
            // OME-Zarr 0.5 has a key of its own.
            if let Some(Value::Object(ome)) = attributes.remove("ome") {
                attributes = ome;
            }
            let array = match node.node_type.as_str() {
                "array" => Some(Description::V3(Box::new(node))),
                "group" => None,
                other => {
                    let problem = format!("node_type is {:?}, not \"array\" or \"group\"", printable(other));
                    return Err(wrong(&file, "node_type", problem));
                }
            };
            return Ok(Self { path: path.to_owned(), attributes_file: file.clone(), file, array, attributes });
        }
        let attributes_file = path.join(".zattrs");
        let attributes = if attributes_file.is_file() { json(&attributes_file)? } else { Map::new() };
        let of_version = |file: &Path, version: u64| match version {
            2 => Ok(()),
            _ => Err(wrong(file, "zarr_format", format!("zarr_format is {version}, not 2"))),
        };
        let file = path.join(".zarray");
        if file.is_file() {
            let array: V2 = json(&file)?;
            of_version(&file, array.zarr_format)?;
            let array = Some(Description::V2(Box::new(array)));
            return Ok(Self { path: path.to_owned(), file, array, attributes, attributes_file });
        }
        let file = path.join(".zgroup");
        if file.is_file() {
            of_version(&file, json::<Group>(&file)?.zarr_format)?;
        } else if !is_node(path) {
            let problem = "the folder has no metadata of Zarr (zarr.json, .zarray or .zgroup)".to_owned();
            return Err(wrong(path, "metadata", problem));
        }
        Ok(Self { path: path.to_owned(), file, array: None, attributes, attributes_file })
    }

    /// Reads the node that the metadata of this node call `name`, a path below its folder.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Outside`] for a path that leaves the folder; otherwise as [`Self::read`].
    pub(super) fn inside(&self, name: &str) -> Result<Self, VolumeError> {
        let outside = || VolumeError::Outside { header: self.attributes_file.clone(), name: printable(name) };
        let parts = Path::new(name).components();
        if name.contains(['\\', ':'])
            || parts.clone().any(|part| !matches!(part, Component::Normal(_) | Component::CurDir))
        {
            return Err(outside());
        }
        let path = self.path.join(name);
        // Links may lead elsewhere.
        if let (Ok(real), Ok(own)) = (path.canonicalize(), self.path.canonicalize())
            && !real.starts_with(own)
        {
            return Err(outside());
        }
        Self::read(&path)
    }

    /// The error for the attribute `place`.
    pub(super) fn wrong(&self, place: &str, problem: String) -> VolumeError {
        wrong(&self.attributes_file, place, problem)
    }
}

/// The error for `place` in the file `path`.
pub(super) fn wrong(path: &Path, place: &str, problem: String) -> VolumeError {
    VolumeError::Field { path: path.to_owned(), place: place.to_owned(), problem }
}

/// Parses the file `path`.
fn json<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T, VolumeError> {
    let bytes = input::read(path, LONGEST).map_err(|source| VolumeError::Open { path: path.to_owned(), source })?;
    if bytes.len() as u64 > LONGEST {
        return Err(wrong(path, "metadata", format!("the file is longer than {LONGEST} bytes")));
    }
    serde_json::from_slice(&bytes)
        .map_err(|error| wrong(path, "metadata", format!("invalid JSON: {}", printable(&error.to_string()))))
}
