//! Bytes that anybody may have made, given to a reader, and what reading them took; for tests and fuzz targets.
#![allow(dead_code, unreachable_pub, reason = "each program uses a part of it, and has it to itself")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::path::{Path, PathBuf};

use relume::output::Accumulators;
use relume::progress::Quiet;
use relume::scene::{self, Definition, SceneOptions};
use relume::spectrum::{Column, SpectrumSource};
use relume::volume::{self, Selection, VolumeError};

/// What a reader may hold, whatever it reads; or twice what comes back, if that is more.
const ALLOWED: usize = 64 << 20;

/// The system's allocator, which counts what the thread holds.
#[derive(Debug)]
pub struct Counting;

thread_local! {
    static HELD: Cell<isize> = const { Cell::new(0) };
    static MOST: Cell<isize> = const { Cell::new(0) };
}

fn count(more: usize, less: usize) {
    let held = HELD.get().wrapping_add_unsigned(more).wrapping_sub_unsigned(less);
    HELD.set(held);
    MOST.set(MOST.get().max(held));
}

#[expect(unsafe_code, reason = "the trait is unsafe; every call is handed on as it came")]
// SAFETY: the system's allocator keeps the contract, and counting neither allocates nor unwinds.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size(), 0);
        // SAFETY: as the caller promised.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size(), 0);
        // SAFETY: as the caller promised.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        count(0, layout.size());
        // SAFETY: as the caller promised.
        unsafe { System.dealloc(place, layout) }
    }

    unsafe fn realloc(&self, place: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size, layout.size());
        // SAFETY: as the caller promised.
        unsafe { System.realloc(place, layout, size) }
    }
}

/// What `work` answers, and the most bytes that this thread held in it beyond those it held before.
pub fn most_held<T>(work: impl FnOnce() -> T) -> (T, usize) {
    let before = HELD.get();
    MOST.set(before);
    let answer = work();
    (answer, (MOST.get() - before).unsigned_abs())
}

/// Something that reads files from anywhere.
#[derive(Clone, Copy, Debug)]
pub enum Reader {
    MetaImage,
    Nrrd,
    Vti,
    Sidecar,
    Scene,
    Spectrum,
    Accumulators,
}

impl Reader {
    /// What its files are called.
    fn file(self) -> &'static str {
        match self {
            Self::MetaImage => "v.mha",
            Self::Nrrd => "v.nrrd",
            Self::Vti => "v.vti",
            Self::Sidecar => "v.raw.toml",
            Self::Scene => "scene.toml",
            Self::Spectrum => "s.csv",
            Self::Accumulators => "a.exr",
        }
    }
}

/// A folder of its own, in memory where the system has such a place, with some voxels for headers to name.
pub struct Place {
    folder: tempfile::TempDir,
    file: PathBuf,
    reader: Reader,
}

impl Place {
    /// # Panics
    ///
    /// Where no folder can be made.
    pub fn new(reader: Reader) -> Self {
        let memory = Path::new("/dev/shm");
        let parent = if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
        let folder = tempfile::Builder::new().prefix("relume-hostile-").tempdir_in(parent).expect("a folder");
        let voxels: Vec<u8> = (0..=255).collect();
        for name in ["v.raw", "v1", "v2"] {
            std::fs::write(folder.path().join(name), &voxels).expect("a file");
        }
        let file = folder.path().join(reader.file());
        Self { folder, file, reader }
    }

    /// Whether `bytes` are accepted.
    ///
    /// # Panics
    ///
    /// Where reading them takes more memory than it may.
    pub fn read(&self, bytes: &[u8]) -> bool {
        if !matches!(self.reader, Reader::Scene) {
            // Some file systems wait for the disk when a file is cut and written again.
            std::fs::remove_file(&self.file).ok();
            std::fs::write(&self.file, bytes).expect("a file");
        }
        let (size, most) = most_held(|| match self.reader {
            Reader::MetaImage | Reader::Nrrd | Reader::Vti | Reader::Sidecar => self.volume(),
            Reader::Scene => self.scene(bytes),
            Reader::Spectrum => self.spectrum(),
            Reader::Accumulators => {
                Accumulators::read(&self.file).ok().map(|read| 4 * (read.weights.len() + read.transmittance.len()))
            }
        });
        let allowed = ALLOWED.max(2 * size.unwrap_or(0));
        assert!(most <= allowed, "{} bytes took {most} bytes of memory for {size:?}", bytes.len());
        size.is_some()
    }

    /// Bytes of what comes back.
    fn volume(&self) -> Option<usize> {
        let open = |selection: &Selection| volume::open(&self.file, selection, &Quiet);
        let first = Selection { component: Some(0), time: Some(0), array: None };
        let opened = match open(&Selection::default()) {
            Err(VolumeError::Choose { .. }) => open(&first),
            opened => opened,
        };
        opened.ok().map(|volume| volume.voxels.bytes().len())
    }

    /// A scene, and behind zero bytes what is defined of it.
    fn scene(&self, bytes: &[u8]) -> Option<usize> {
        let text = std::str::from_utf8(bytes).ok()?;
        let mut parts = text.split('\0').map(str::to_owned);
        let text = parts.next()?;
        let definitions: Vec<Definition> = parts.map(|text| Definition::new(&text)).collect();
        // No large phantom and no file of this machine.
        if !is_small(&text)
            || definitions.iter().any(|definition| definition.text.contains("volume"))
            || text.contains('/')
        {
            return None;
        }
        let options = SceneOptions { definitions, ..SceneOptions::default() };
        scene::parse("scene.toml", &text, self.folder.path(), &options, &Quiet).ok().map(|_| 0)
    }

    fn spectrum(&self) -> Option<usize> {
        let column = |column| SpectrumSource::File { path: self.file.clone(), column };
        let second = column(Some(Column::Number(2)));
        let read = column(None).reflectance(Path::new("")).is_ok();
        (second.light(Path::new("")).is_ok() || read).then_some(0)
    }
}

/// Whether a scene's phantom, if it has one, is of few voxels.
fn is_small(text: &str) -> bool {
    let Ok(table) = text.parse::<toml::Table>() else { return true };
    let Some(toml::Value::Table(volume)) = table.get("volume") else { return true };
    if !volume.contains_key("phantom") {
        return true;
    }
    let Some(toml::Value::Array(dims)) = volume.get("dims") else { return false };
    let product = dims.iter().map(|n| n.as_integer().unwrap_or(0)).fold(1_i64, i64::saturating_mul);
    product <= 512
}
