//! Files that external links of HDF5 files lead to.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use hdf5_reader::error::Error;
use hdf5_reader::storage::DynStorage;
use hdf5_reader::{ExternalLinkResolver, FileStorage, Hdf5File, OpenOptions};

use crate::data;
use crate::readers::lengths::printable;
use crate::stream;

/// Most files in a chain of links.
const DEEPEST: usize = 3;
/// Most files that the links of one file lead to.
const MOST: usize = 256;

/// What the links of a file met.
#[derive(Debug, Default)]
pub(super) struct Met {
    /// Bytes of the files.
    bytes: AtomicU64,
    /// Number of links.
    links: AtomicUsize,
    /// Clauses about links whose files are not read.
    broken: Mutex<Vec<String>>,
}

impl Met {
    pub(super) fn bytes(&self) -> u64 {
        self.bytes.load(Ordering::Relaxed)
    }

    pub(super) fn links(&self) -> usize {
        self.links.load(Ordering::Relaxed)
    }

    /// The clause about the last link whose file is not read, if there is one.
    pub(super) fn broken(&self) -> Option<String> {
        self.broken.lock().unwrap_or_else(PoisonError::into_inner).last().cloned()
    }

    /// Forgets links whose files are not read.
    pub(super) fn forget(&self) {
        self.broken.lock().unwrap_or_else(PoisonError::into_inner).clear();
    }

    fn tell(&self, problem: String) {
        let mut broken = self.broken.lock().unwrap_or_else(PoisonError::into_inner);
        broken.truncate(MOST);
        broken.push(problem);
    }
}

/// Opens the files of links: those in the folder of the file with the link, and below it.
pub(super) struct Links {
    header: PathBuf,
    options: fn() -> OpenOptions,
    /// Links that may follow.
    depth: usize,
    met: Arc<Met>,
    /// Files by name; `None` for those that are not read.
    opened: Mutex<HashMap<String, Option<Hdf5File>>>,
}

impl Links {
    /// The links of the file `header`; files are opened with `options`.
    pub(super) fn of(header: &Path, options: fn() -> OpenOptions) -> (Arc<Self>, Arc<Met>) {
        let met = Arc::new(Met::default());
        let links = Self::deeper(header.to_owned(), options, DEEPEST, Arc::clone(&met));
        (Arc::new(links), met)
    }

    fn deeper(header: PathBuf, options: fn() -> OpenOptions, depth: usize, met: Arc<Met>) -> Self {
        Self { header, options, depth, met, opened: Mutex::new(HashMap::new()) }
    }

    /// The file called `name`. The error is a clause.
    fn open(&self, name: &str) -> Result<Hdf5File, String> {
        let shown = printable(name);
        let path = data::beside(&self.header, name).map_err(|_| {
            format!(
                "an external link leads to {shown:?}, outside the folder of the file, where untrusted files may not lead; put that \
                 file into the folder"
            )
        })?;
        let failed = |error: &dyn std::fmt::Display| {
            let error = printable(&error.to_string());
            format!("an external link leads to {shown:?}, which is not read: {error}; put that file beside this one")
        };
        let missing =
            || format!("an external link leads to {shown:?}, which is missing; put that file beside this one");
        if self.depth == 0 {
            return Err(format!("external links lead through more than {DEEPEST} files, the last one to {shown:?}"));
        }
        if !path.is_file() {
            return Err(missing());
        }
        let file = stream::open(&path).map_err(|error| failed(&error))?;
        let bytes = file.metadata().map_err(|error| failed(&error))?.len();
        let storage: DynStorage = Arc::new(FileStorage::from_file(file).map_err(|error| failed(&error))?);
        let further = Self::deeper(path, self.options, self.depth - 1, Arc::clone(&self.met));
        let options = (self.options)().with_external_link_resolver(Arc::new(further));
        let opened = Hdf5File::from_storage_with_options(storage, options).map_err(|error| failed(&error))?;
        self.met.bytes.fetch_add(bytes, Ordering::Relaxed);
        Ok(opened)
    }
}

impl ExternalLinkResolver for Links {
    fn resolve_external_link(&self, name: &str) -> Result<Option<Hdf5File>, Error> {
        self.met.links.fetch_add(1, Ordering::Relaxed);
        let known = self.opened.lock().unwrap_or_else(PoisonError::into_inner).get(name).cloned();
        if let Some(known @ Some(_)) = known {
            return Ok(known);
        }
        // A link whose file is not read is none: others may suffice.
        let opened = match self.open(name) {
            Ok(file) => Some(file),
            Err(problem) => {
                self.met.tell(problem);
                None
            }
        };
        let mut all = self.opened.lock().unwrap_or_else(PoisonError::into_inner);
        if all.len() < MOST {
            all.insert(name.to_owned(), opened.clone());
        }
        Ok(opened)
    }
}
