//! All choices that a file of several volumes leaves open, one after the other.

use std::path::Path;

use super::open::open_by;
use crate::{RawLayout, Selection, Several, Volume, VolumeError};
use relume_base::progress::Progress;

/// Most choices that a file leaves open one after the other: series, array, level, component and time.
const MOST_CHOICES: usize = 5;

/// The choices that a file or folder leaves open, and its first volume.
#[derive(Debug)]
pub struct Offered {
    /// The choices in the order in which they are asked for; empty for one volume.
    pub choices: Vec<Several>,
    /// The middle slice of the first alternative of each of them, or the whole volume of formats that do not find it at once.
    pub first: Volume,
}

impl Offered {
    /// Reads the file or folder `path`, and answers choices that `selection` leaves open by the first alternative. `layout` is
    /// that of headerless voxels.
    ///
    /// # Errors
    ///
    /// As [`open`](crate::open()).
    pub fn open(
        path: &Path,
        layout: Option<&RawLayout>,
        selection: &Selection,
        progress: &dyn Progress,
    ) -> Result<Self, VolumeError> {
        let mut selection = Selection { middle: true, asks: false, ..selection.clone() };
        let mut choices = Vec::new();
        loop {
            match open_by(path, layout, &selection, progress) {
                Err(VolumeError::Choose { there, .. }) if choices.len() < MOST_CHOICES => {
                    selection.choose_first(&there);
                    choices.push(there);
                }
                read => return Ok(Self { choices, first: read? }),
            }
        }
    }

    /// Voxels along x, y and z of the whole first volume.
    #[must_use]
    pub fn dims(&self) -> [usize; 3] {
        let [x, y, z] = self.first.geometry.dims;
        [x, y, self.first.part.map_or(z, |part| part.depth)]
    }
}
