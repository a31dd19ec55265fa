//! Comparison of real volumes in the shared folder with the results of independent readers.

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use relume::progress::Quiet;
use relume::volume::{self, Geometry, Selection, Volume, VolumeError};
use serde_json::Value;
use sha2::{Digest, Sha256};

/// Folder of real volumes, if the checkout has one.
#[expect(clippy::print_stderr, reason = "a test that cannot run says so")]
pub fn shared() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/volumes");
    if folder.exists() {
        return Some(folder);
    }
    eprintln!("shared data not present: {} is missing, this test ran on nothing", folder.display());
    None
}

pub fn hex(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Error message with all causes.
pub fn whole_message(error: &VolumeError) -> String {
    let mut message = error.to_string();
    let mut source = std::error::Error::source(error);
    while let Some(cause) = source {
        message = format!("{message}: {cause}");
        source = cause.source();
    }
    message
}

/// Returns the error of a file that must be refused in one sentence with these words.
pub fn refused(read: Result<Volume, VolumeError>, words: &[&str]) -> VolumeError {
    let error = read.map(|volume| volume.voxels).unwrap_err();
    let message = whole_message(&error);
    assert!(words.iter().all(|word| message.contains(word)), "{message} should contain {words:?}");
    assert!(!message.contains('\n'), "one sentence: {message}");
    error
}

/// Opens a file called `name` with this content.
pub fn opened(name: &str, bytes: &[u8], selection: &Selection) -> Result<Volume, VolumeError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    volume::open(&path, selection, &Quiet)
}

/// A folder with these files.
pub fn folder(files: &[(&str, Vec<u8>)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
    folder
}

/// The files of a bundle of `tests/tools/make_zarr.py`.
pub fn unbundled(mut bytes: &[u8]) -> Vec<(String, Vec<u8>)> {
    let mut files = Vec::new();
    while let Some((&length, rest)) = bytes.split_first() {
        let (name, rest) = rest.split_at(usize::from(length));
        let (length, rest) = rest.split_at(4);
        let length = usize::try_from(u32::from_le_bytes(length.try_into().unwrap())).unwrap();
        files.push((String::from_utf8(name.to_vec()).unwrap(), rest[..length].to_vec()));
        bytes = &rest[length..];
    }
    files
}

/// The folder of a bundle.
pub fn bundle(path: &Path) -> tempfile::TempDir {
    let files = unbundled(&std::fs::read(path).unwrap());
    folder(&files.iter().map(|(name, bytes)| (name.as_str(), bytes.clone())).collect::<Vec<_>>())
}

/// A folder with a header and its data file `v.raw`.
pub struct Files {
    pub folder: tempfile::TempDir,
    header: &'static str,
}

impl Files {
    /// `name` is the header's.
    pub fn new(name: &'static str, header: &str, data: &[u8]) -> Self {
        let files = Self { folder: tempfile::tempdir().unwrap(), header: name };
        files.with(name, header.as_bytes()).with("v.raw", data);
        files
    }

    pub fn with(&self, name: &str, bytes: &[u8]) -> &Self {
        std::fs::write(self.path(name), bytes).unwrap();
        self
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn select(&self, selection: &Selection) -> Result<Volume, VolumeError> {
        volume::open(&self.path(self.header), selection, &Quiet)
    }

    pub fn open(&self) -> Result<Volume, VolumeError> {
        self.select(&Selection::default())
    }

    pub fn refused(&self, words: &[&str]) -> VolumeError {
        refused(self.open(), words)
    }
}

/// Checks the shared files below the folder `below` against `expected.json`; there are at least `least`.
pub fn check_below(below: &str, least: usize) {
    let Some(folder) = shared() else { return };
    let open = |name: &str, selection: &Selection| volume::open(&folder.join(name), selection, &Quiet);
    let checked = check_all(&folder, |name| name.starts_with(below), open);
    assert!(checked >= least, "the shared folder has at least {least} such files, {checked} were checked");
}

/// Checks every file that is `ours` against `expected.json`; returns their number.
pub fn check_all(
    folder: &Path,
    ours: impl Fn(&str) -> bool,
    open: impl Fn(&str, &Selection) -> Result<Volume, VolumeError>,
) -> usize {
    let json: Value = serde_json::from_str(&std::fs::read_to_string(folder.join("expected.json")).unwrap()).unwrap();
    let files: Vec<_> = json["files"].as_object().unwrap().iter().filter(|(name, _)| ours(name)).collect();
    for (name, expected) in &files {
        if expected["expect"] == "load" {
            check(name, expected, |selection| open(name, selection));
        } else {
            let error = open(name, &Selection::default()).map(|volume| volume.voxels).unwrap_err();
            assert!(!error.to_string().contains('\n'), "{name}: one sentence, not {error}");
        }
    }
    files.len()
}

/// Checks one file, with all its time steps and components, against the expected contents.
pub fn check(name: &str, expected: &Value, open: impl Fn(&Selection) -> Result<Volume, VolumeError>) {
    let dims: Vec<usize> = numbers(&expected["dims"]).iter().map(|&n| format!("{n}").parse().unwrap()).collect();
    let times = dims.get(3).copied().unwrap_or(1);
    let components = expected["components"].as_u64().and_then(|n| usize::try_from(n).ok()).unwrap_or(1);
    if times * components > 1 {
        let error = open(&Selection::default()).map(|volume| volume.voxels).unwrap_err();
        let choice = if components > 1 { "choose a component" } else { "choose a time step" };
        assert!(error.to_string().contains(choice), "{name}: {error} should say what is to be chosen");
    }
    let several = |there: usize, index| (there > 1).then_some(index);
    let part = |time, component| {
        let selection =
            Selection { component: several(components, component), time: several(times, time), ..Selection::default() };
        open(&selection).unwrap_or_else(|error| panic!("{name}: {error}"))
    };
    let volumes: Vec<Vec<Volume>> =
        (0..times).map(|time| (0..components).map(|component| part(time, component)).collect()).collect();
    let mut grid = dims;
    grid.resize(3, 1);
    for volume in volumes.iter().flatten() {
        assert_eq!((&volume.geometry.dims[..], volume.components), (&grid[..], components), "{name}");
        assert_eq!(volume.voxels.type_name(), expected["dtype"].as_str().unwrap(), "{name}");
        // Without a placement in the file, an independent reader centres the volume, and we use the spacings alone.
        let is_placed = volume.anatomical || !name.starts_with("nifti/minimal");
        check_geometry(name, expected, &volume.geometry, is_placed);
    }
    let mut bytes = Vec::new();
    for parts in &volumes {
        let size = parts[0].voxels.bytes().len() / parts[0].voxels.len();
        for index in 0..parts[0].voxels.len() {
            parts.iter().for_each(|part| bytes.extend(&part.voxels.bytes()[index * size..(index + 1) * size]));
        }
    }
    assert_eq!(hex(&bytes), expected["decoded_sha256"].as_str().unwrap(), "{name}");
    let many = |json: &Value| json.as_f64().map_or_else(|| numbers(json), |number| vec![number]);
    for component in 0..components {
        // Statistics are of values; the file's own, where a slope makes them differ from the stored numbers.
        let of = if expected["value"].is_object() { "value" } else { "stored" };
        let stored = |key: &str| many(&expected[of][key])[component];
        let all: Vec<_> = volumes.iter().map(|parts| parts[component].statistics().unwrap()).collect();
        let min = all.iter().map(|one| one.min).fold(f64::INFINITY, f64::min);
        let max = all.iter().map(|one| one.max).fold(f64::NEG_INFINITY, f64::max);
        assert!(same(min, stored("min")) && same(max, stored("max")), "{name}: {min} to {max}");
        let mean = all.iter().map(|one| one.mean / f64::from(u32::try_from(times).unwrap())).sum::<f64>();
        // The rounding error of Σ|x|, in which no voxel exceeds the largest.
        let size = min.abs().max(max.abs());
        assert!((mean - stored("mean")).abs() <= 1e-12 * size, "{name}: {mean}");
        if let (Some(counts), [one]) = (expected["histogram"]["counts"].as_array(), &all[..])
            && components == 1
        {
            let counts: Vec<u64> = counts.iter().map(|n| n.as_u64().unwrap()).collect();
            if expected["dtype"] == "float32" {
                // NumPy rounds the edges of the bins to 32 bits, so that a voxel on an edge may fall to either side.
                assert_eq!(one.histogram.len(), counts.len(), "{name}");
                let mut sum = 0_i64;
                for (ours, theirs) in one.histogram.iter().zip(&counts) {
                    sum += ours.cast_signed() - theirs.cast_signed();
                    assert!(sum.abs() <= 1, "{name}: {:?}", one.histogram);
                }
            } else {
                assert_eq!(one.histogram[..], counts[..], "{name}");
            }
        }
    }
    for sample in expected["samples"].as_array().unwrap() {
        let mut index: Vec<usize> = numbers(&sample["ijk"]).iter().map(|&n| format!("{n}").parse().unwrap()).collect();
        index.resize(4, 0);
        for (component, &stored) in many(&sample["stored"]).iter().enumerate() {
            let volume = &volumes[index[3]][component];
            let value = volume.value([index[0], index[1], index[2]]);
            let expected = sample["value"].as_f64().unwrap_or(stored);
            let place = volume.geometry.linear_index([index[0], index[1], index[2]]).unwrap();
            assert!(same(volume.voxels.value(place).unwrap(), stored), "{name} at {index:?}");
            assert!(same(value.unwrap(), expected), "{name} at {index:?}: {value:?}");
        }
    }
}

fn check_geometry(name: &str, expected: &Value, geometry: &Geometry, is_placed: bool) {
    let Geometry { spacing, origin, direction, .. } = *geometry;
    // An affine matrix of six decimals beside it: spacing, origin and direction are those of a header of f32.
    let affine = expected["affine_ras"].as_array();
    // As in texts of 16 characters, from which steps are computed.
    let is_text = name.starts_with("dicom/");
    let limit = if affine.is_some() || is_text { 1e-6 } else { 1e-14 };
    let close = |ours: f64, theirs: f64| (ours - theirs).abs() <= limit * theirs.abs().max(1e-3);
    let all_close = |ours: &[f64], theirs: &[f64]| ours.iter().zip(theirs).all(|(&a, &b)| close(a, b));
    // In frames named right and anterior, the first two world axes are reversed.
    let frame = expected["frame"].as_str().unwrap_or_default();
    let turn = |word: &str| if frame.contains(word) { -1.0 } else { 1.0 };
    let turn = DVec3::new(turn("right-"), turn("anterior-"), 1.0);
    if expected["spacing"].is_array() {
        assert!(all_close(&spacing.to_array(), &numbers(&expected["spacing"])), "{name}: {spacing}");
    }
    if expected["origin"].is_array() && affine.is_none() {
        assert!(all_close(&(origin * turn).to_array(), &numbers(&expected["origin"])), "{name}: {origin}");
    }
    if expected["direction"].is_array() && affine.is_none() && numbers(&expected["direction"]).len() == 9 {
        // Row by row there, column by column here.
        let rows = direction.transpose().to_cols_array();
        assert!(all_close(&rows, &numbers(&expected["direction"])), "{name}: {direction}");
    }
    if let Some(rows) = affine.filter(|_| is_placed) {
        let turn = [-1.0, -1.0, 1.0];
        for (row, theirs) in rows[..3].iter().map(numbers).enumerate() {
            let ours = (0..3).map(|axis| direction.col(axis)[row] * spacing[axis]).chain([origin[row]]);
            for (column, (ours, theirs)) in ours.zip(theirs).enumerate() {
                let ours = turn[row] * ours;
                // Half a digit of the decimals, and the rounding of f32.
                let limit = 5.1e-7 + 3e-7 * theirs.abs();
                assert!((ours - theirs).abs() <= limit, "{name}: row {row}, column {column}: {ours}, not {theirs}");
            }
        }
    }
    let rows = expected["affine_lps"].as_array().into_iter().flatten().take(3).map(numbers);
    for (row, theirs) in rows.enumerate() {
        let ours = (0..3).map(|axis| direction.col(axis)[row] * spacing[axis]).chain([origin[row]]);
        for (column, (ours, theirs)) in ours.zip(theirs).enumerate() {
            assert!((ours - theirs).abs() <= 1e-6, "{name}: row {row}, column {column}: {ours}, not {theirs}");
        }
    }
    let vectors = expected["space_directions"].as_array().into_iter().flatten().filter(|vector| vector.is_array());
    for (axis, vector) in vectors.enumerate() {
        let ours = DMat3::from_diagonal(turn) * direction.col(axis) * spacing[axis];
        assert!(all_close(&ours.to_array(), &numbers(vector)), "{name}: axis {axis} is {ours}");
    }
}

/// Equal up to the last bit, which may be lost in parsing JSON.
fn same(ours: f64, theirs: f64) -> bool {
    (ours - theirs).abs() <= f64::EPSILON * theirs.abs()
}

/// Numbers of a list; unspecified ones are omitted.
fn numbers(json: &Value) -> Vec<f64> {
    json.as_array().unwrap().iter().filter_map(Value::as_f64).collect()
}
