//! Feeds untrusted bytes to the readers and checks their memory use, for tests and fuzz targets.
#![allow(dead_code, unreachable_pub, reason = "each program uses a part of it, and has it to itself")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::fs::File;
use std::io::{Seek as _, Write as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, AtomicUsize, Ordering};

use relume::document;
use relume::document::{Definition, SceneOptions};
use relume::output::FilmFile;
use relume::palette::{self, Palette};
use relume::plan;
use relume::progress::{Progress, Quiet};
use relume::spectrum::{Column, SpectrumSource};
use relume::volume::{self, Selection, Several, VolumeError};

/// Largest number of bytes a reader may hold; alternatively, twice the size of its result.
const ALLOWED: usize = 64 << 20;

/// Number of cancellation checks after which long work is cancelled: a few of its steps.
const QUESTIONS: u32 = 8;

/// System allocator that counts the bytes held by each thread.
#[derive(Debug)]
pub struct Counting;

thread_local! {
    static HELD: Cell<isize> = const { Cell::new(0) };
    static MOST: Cell<isize> = const { Cell::new(0) };
    /// Parallel loops of the readers run on the thread that counts; those of another thread would not be counted.
    static POOL: rayon::ThreadPool =
        rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build().expect("a pool of this thread");
}

fn count(more: usize, less: usize) {
    let held = HELD.get().wrapping_add_unsigned(more).wrapping_sub_unsigned(less);
    HELD.set(held);
    MOST.set(MOST.get().max(held));
}

#[expect(unsafe_code, reason = "the trait is unsafe; every call is handed on as it came")]
// SAFETY: the system's allocator upholds the contract; counting neither allocates nor unwinds.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size(), 0);
        // SAFETY: the caller upholds the contract.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size(), 0);
        // SAFETY: the caller upholds the contract.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        count(0, layout.size());
        // SAFETY: the caller upholds the contract.
        unsafe { System.dealloc(place, layout) }
    }

    unsafe fn realloc(&self, place: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size, layout.size());
        // SAFETY: the caller upholds the contract.
        unsafe { System.realloc(place, layout, size) }
    }
}

/// Returns the result of `work` and the peak number of bytes this thread allocated for it.
pub fn most_held<T: Send>(work: impl FnOnce() -> T + Send) -> (T, usize) {
    POOL.with(|pool| {
        pool.install(|| {
            let before = HELD.get();
            MOST.set(before);
            let answer = work();
            (answer, (MOST.get() - before).unsigned_abs())
        })
    })
}

/// Reader of untrusted files.
#[derive(Clone, Copy, Debug)]
pub enum Reader {
    MetaImage,
    Nrrd,
    Vti,
    Nifti,
    Mgh,
    Mrc,
    Numpy,
    Archive,
    Vtk,
    Dicom,
    Tiff,
    Slices,
    Zarr,
    Hdf5,
    NetCdf,
    Sidecar,
    Scene,
    Palette,
    Spectrum,
    Accumulators,
    Bricks,
}

impl Reader {
    /// File name with the reader's extension.
    fn file(self) -> &'static str {
        match self {
            Self::MetaImage => "v.mha",
            Self::Nrrd => "v.nrrd",
            Self::Vti => "v.vti",
            Self::Nifti => "v.nii",
            Self::Mgh => "v.mgz",
            Self::Mrc => "v.mrc",
            Self::Numpy => "v.npy",
            Self::Archive => "v.npz",
            Self::Vtk => "v.vtk",
            Self::Dicom => "v.dcm",
            Self::Tiff => "v.tif",
            // The content tells the formats of slices apart.
            Self::Slices => "s1.png",
            // A folder, whose files are in one.
            Self::Zarr => "v.bundle",
            Self::Hdf5 => "v.h5",
            Self::NetCdf => "v.nc",
            Self::Sidecar => "v.raw.toml",
            Self::Scene => "scene.toml",
            Self::Palette => "palette.toml",
            Self::Spectrum => "s.csv",
            Self::Accumulators => "a.exr",
            Self::Bricks => "v.bricks",
        }
    }
}

/// Progress that cancels the work after a number of checks.
struct Patience(AtomicU32);

impl Patience {
    const fn of(questions: u32) -> Self {
        Self(AtomicU32::new(questions))
    }
}

impl Progress for Patience {
    fn report(&self, _stage: &str, _done: u64, _total: u64) {}

    fn cancelled(&self) -> bool {
        self.0.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(1)).is_err()
    }
}

/// Temporary folder, in memory if possible, with voxel files to which headers can refer.
pub struct Place {
    folder: tempfile::TempDir,
    path: PathBuf,
    /// Kept open, because some file systems wait for the disk when a truncated file is closed.
    file: File,
    reader: Reader,
    rarely: u64,
    /// Peak memory of the reading that took most.
    most: AtomicUsize,
}

impl Place {
    /// Work that takes a thousand times as long as reading, such as planning a scene or solving a palette, is done for
    /// one in `rarely` inputs.
    ///
    /// # Panics
    ///
    /// If no folder can be created.
    pub fn new(reader: Reader, rarely: u64) -> Self {
        let memory = Path::new("/dev/shm");
        let parent = if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
        let folder = tempfile::Builder::new().prefix("relume-hostile-").tempdir_in(parent).expect("a folder");
        let voxels: Vec<u8> = (0..=255).collect();
        // A folder of slices has nothing else.
        let beside: &[&str] = if matches!(reader, Reader::Slices) { &[] } else { &["v.raw", "v1", "v2"] };
        for name in beside {
            std::fs::write(folder.path().join(name), &voxels).expect("a file");
        }
        let path = folder.path().join(reader.file());
        let file = File::create(&path).expect("a file");
        Self { folder, path, file, reader, rarely, most: AtomicUsize::new(0) }
    }

    /// Returns whether `bytes` are accepted.
    ///
    /// # Panics
    ///
    /// If reading uses too much memory.
    pub fn read(&self, bytes: &[u8]) -> bool {
        if !matches!(self.reader, Reader::Scene | Reader::Palette) {
            let length = u64::try_from(bytes.len()).expect("a length");
            (&self.file).rewind().expect("a file");
            (&self.file).write_all(bytes).expect("room for a file");
            self.file.set_len(length).expect("a file");
        }
        let (size, most) = most_held(|| match self.reader {
            Reader::MetaImage
            | Reader::Nrrd
            | Reader::Vti
            | Reader::Nifti
            | Reader::Mgh
            | Reader::Mrc
            | Reader::Numpy
            | Reader::Archive
            | Reader::Vtk
            | Reader::Dicom
            | Reader::Tiff
            | Reader::Slices
            | Reader::Hdf5
            | Reader::NetCdf
            | Reader::Bricks
            | Reader::Sidecar => self.volume(),
            Reader::Zarr => self.store(bytes),
            Reader::Scene => self.scene(bytes),
            Reader::Palette => self.palette(bytes),
            Reader::Spectrum => self.spectrum(),
            Reader::Accumulators => {
                FilmFile::read(&self.path).ok().map(|read| 4 * (read.accumulators.len() + read.transmittance.len()))
            }
        });
        self.most.fetch_max(most, Ordering::Relaxed);
        let allowed = ALLOWED.max(2 * size.unwrap_or(0));
        assert!(most <= allowed, "{} bytes took {most} bytes of memory for {size:?}", bytes.len());
        size.is_some()
    }

    /// Peak memory in bytes of the reading that took most.
    pub fn most(&self) -> usize {
        self.most.load(Ordering::Relaxed)
    }

    /// Returns the number of voxel bytes of the store whose files `bytes` list: length of the name (1 byte), name, length of
    /// the content (4 bytes, little-endian), content.
    fn store(&self, mut bytes: &[u8]) -> Option<usize> {
        let store = self.folder.path().join("v.zarr");
        drop(std::fs::remove_dir_all(&store));
        std::fs::create_dir(&store).expect("a folder");
        while let Some((&length, rest)) = bytes.split_first() {
            let (name, rest) = rest.split_at_checked(usize::from(length))?;
            let (length, rest) = rest.split_at_checked(4)?;
            let length = u32::from_le_bytes(length.try_into().ok()?).try_into().unwrap_or(usize::MAX);
            let (content, rest) = rest.split_at(length.min(rest.len()));
            let name = std::str::from_utf8(name).ok()?;
            let is_inside = Path::new(name).components().all(|part| matches!(part, std::path::Component::Normal(_)));
            let path = store.join(name);
            if is_inside && std::fs::create_dir_all(path.parent()?).is_ok() {
                // A damaged name may be that of a folder, or too long.
                drop(std::fs::write(path, content));
            }
            bytes = rest;
        }
        self.opened(&store)
    }

    /// Whether the expensive work is done for `bytes`.
    fn is_chosen(&self, bytes: &[u8]) -> bool {
        // FNV-1a hash.
        let step = |hash: u64, &byte: &u8| (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        let hash = bytes.iter().fold(0xcbf2_9ce4_8422_2325, step);
        (hash >> 32).is_multiple_of(self.rarely)
    }

    /// Returns the number of voxel bytes.
    fn volume(&self) -> Option<usize> {
        self.opened(if matches!(self.reader, Reader::Slices) { self.folder.path() } else { &self.path })
    }

    /// Returns the number of voxel bytes of the file or folder `path`.
    fn opened(&self, path: &Path) -> Option<usize> {
        let open = |selection: &Selection| volume::open(path, selection, &Quiet);
        let first = Selection { component: Some(0), time: Some(0), resample: true, ..Selection::default() };
        let opened = match open(&Selection::default()) {
            Err(VolumeError::Choose { there: Several::Arrays(names), .. }) => {
                open(&Selection { array: names.first().cloned(), ..first })
            }
            Err(
                VolumeError::Choose { .. }
                | VolumeError::Lean { .. }
                | VolumeError::Uneven { .. }
                | VolumeError::Direction { .. },
            ) => open(&first),
            opened => opened,
        };
        opened.ok().map(|volume| volume.voxels.bytes().len())
    }

    /// Reads a scene, followed by zero-separated definitions.
    fn scene(&self, bytes: &[u8]) -> Option<usize> {
        let text = std::str::from_utf8(bytes).ok()?;
        let mut parts = text.split('\0').map(str::to_owned);
        let text = parts.next()?;
        let definitions: Vec<Definition> = parts.map(|text| Definition::new(&text)).collect();
        let is_chosen = self.is_chosen(bytes);
        let says = |what: &str| definitions.iter().any(|definition| definition.text.contains(what));
        // Large phantoms and paths are excluded, and palettes are rarely solved.
        let solves = text.contains("palette") || says("palette");
        if !is_small(&text) || says("volume") || text.contains('/') || solves && !is_chosen {
            return None;
        }
        let options = SceneOptions { definitions, ..SceneOptions::default() };
        let scene =
            document::parse("scene.toml", &text, self.folder.path(), &options, &Patience::of(QUESTIONS)).ok()?.scene;
        let said = plan::plan_full_spectrum(&scene).explain(&scene);
        if is_chosen {
            plan::plan(&scene, &Patience::of(QUESTIONS)).ok();
        }
        Some(said.iter().map(String::len).sum())
    }

    fn palette(&self, bytes: &[u8]) -> Option<usize> {
        let text = std::str::from_utf8(bytes).ok().filter(|text| !text.contains('/'))?;
        let palette: Palette = palette::parse("palette.toml", text, self.folder.path()).ok()?;
        if self.is_chosen(bytes) {
            palette::solve(&palette, &Patience::of(QUESTIONS)).ok();
        }
        Some(palette.cells.iter().map(|cell| palette.target_text(cell.material, cell.light).len()).sum())
    }

    fn spectrum(&self) -> Option<usize> {
        let column = |column| SpectrumSource::File { path: self.path.clone(), column };
        let second = column(Some(Column::Number(2)));
        let read = column(None).reflectance(Path::new("")).is_ok();
        (second.light(Path::new("")).is_ok() || read).then_some(0)
    }
}

/// Whether the scene's phantom, if any, has few voxels.
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
