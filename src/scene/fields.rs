//! The fields of a scene: values at each place of its frame.

use std::sync::{Arc, OnceLock};

use super::{FACTORS, Term};
use relume_base::progress::Progress;
use relume_volume::{BrickCache, CacheCounts, Statistics, Volume, VolumeError};

/// A field: the values of a volume, wherever its voxels reside.
#[derive(Clone, Debug)]
pub struct Field {
    /// Its name in the scene; that of the first is [`FIRST_FIELD`] unless the scene gives it another one.
    pub name: String,
    /// Voxel values and their grid.
    pub volume: Arc<Volume>,
    /// What a further field shows: terms as of [`Transfer`](super::Transfer), by its own values. The first has those of the scene.
    pub terms: Vec<Term>,
    statistics: Arc<OnceLock<Statistics>>,
}

impl Field {
    /// The further field of `volume`, which shows `terms`.
    #[must_use]
    pub fn new(name: String, volume: Arc<Volume>, terms: Vec<Term>) -> Self {
        Self { name, volume, terms, statistics: Arc::default() }
    }

    /// Statistics of its values; of a volume without a finite value, those of zeros.
    #[must_use]
    pub fn statistics(&self) -> &Statistics {
        self.statistics.get_or_init(|| match self.volume.statistics() {
            Ok(statistics) => statistics,
            Err(VolumeError::NothingFinite { not_a_number, infinite, .. }) => {
                Statistics { not_a_number, infinite, ..Statistics::of_nothing() }
            }
            Err(_) => Statistics::of_nothing(),
        })
    }

    /// The file of bricks with the voxels, unless these are in memory.
    #[must_use]
    pub fn bricks(&self) -> Option<&BrickCache> {
        self.volume.bricks.as_deref()
    }

    /// Bricks that were read of the file so far, if the voxels stay in one.
    #[must_use]
    pub fn reads(&self) -> Option<CacheCounts> {
        self.bricks().map(BrickCache::counts)
    }

    /// The voxels in memory, and how many of the field's each stands for along each axis: all voxels, or the coarse level of
    /// those that stay in a file. These have none before [`Volume::prepare_coarse`].
    #[must_use]
    pub fn at_hand(&self) -> (&Volume, [usize; 3]) {
        let at_hand = self.volume.at_hand();
        (at_hand, self.volume.block_of(at_hand))
    }

    /// True if both have the same voxels, so that results from one serve the other.
    #[must_use]
    pub fn is(&self, other: &Self) -> bool {
        // Complete on purpose: a new part does not compile until somebody decides.
        let Self { name: _, volume, terms: _, statistics: _ } = self;
        Arc::ptr_eq(volume, &other.volume)
    }
}

/// Largest number of fields of a scene: their values make a vector.
pub const FIELDS: usize = 4;

/// Largest number of groups of terms with equal factors, of all fields.
pub const MOST_GROUPS: usize = FACTORS + FIELDS - 1;

/// Name of the first field, unless the scene gives it another one.
pub const FIRST_FIELD: &str = "volume";

/// All fields of a scene. Further fields on the grid of the first share its texels; others have grids of their own.
#[derive(Clone, Debug)]
pub struct Fields {
    first: Field,
    further: Vec<Field>,
}

impl Fields {
    /// The field of `volume` alone.
    #[must_use]
    pub fn of(volume: Arc<Volume>) -> Self {
        Self { first: Field::new(FIRST_FIELD.to_owned(), volume, Vec::new()), further: Vec::new() }
    }

    /// The same with another name of the first.
    #[must_use]
    pub fn called(mut self, name: &str) -> Self {
        name.clone_into(&mut self.first.name);
        self
    }

    /// The same with further fields: those on the grid of the first before those on grids of their own, otherwise in this order.
    #[must_use]
    pub fn with(self, mut further: Vec<Field>) -> Self {
        let grid = self.first.volume.geometry;
        further.sort_by_key(|field| field.volume.geometry != grid);
        Self { further, ..self }
    }

    /// The same with `first`, a coarse level of the first, the same level of those on its grid, and those on grids of their own as they are.
    ///
    /// # Errors
    ///
    /// [`VolumeError`].
    pub fn at_level(&self, first: Arc<Volume>, level: u32, progress: &dyn Progress) -> Result<Self, VolumeError> {
        let coarse = |field: &Field| -> Result<Field, VolumeError> {
            let volume = field.volume.coarser_by(level, field.volume.has_labels, progress)?;
            Ok(Field::new(field.name.clone(), Arc::new(volume), field.terms.clone()))
        };
        let further = self.sharing().iter().map(coarse).chain(self.beside().iter().cloned().map(Ok));
        let further = further.collect::<Result<_, _>>()?;
        Ok(Self { first: Field::new(self.first.name.clone(), first, Vec::new()), further })
    }

    /// The field whose volume gives the scene its frame.
    #[must_use]
    pub const fn first(&self) -> &Field {
        &self.first
    }

    /// The others.
    #[must_use]
    pub fn further(&self) -> &[Field] {
        &self.further
    }

    /// Further fields on the grid of the first, and those on grids of their own.
    fn split(&self) -> (&[Field], &[Field]) {
        let grid = self.first.volume.geometry;
        self.further.split_at(self.further.partition_point(|field| field.volume.geometry == grid))
    }

    /// Further fields that share the texels of the first.
    #[must_use]
    pub fn sharing(&self) -> &[Field] {
        self.split().0
    }

    /// Fields on grids of their own.
    #[must_use]
    pub fn beside(&self) -> &[Field] {
        self.split().1
    }

    /// All of them in their order.
    pub fn iter(&self) -> impl Iterator<Item = &Field> {
        std::iter::once(&self.first).chain(&self.further)
    }

    /// What the further ones show.
    #[must_use]
    pub fn terms(&self) -> Vec<&[Term]> {
        self.further.iter().map(|field| field.terms.as_slice()).collect()
    }

    /// Lets the further field `index` show other terms.
    pub fn show(&mut self, index: usize, terms: Vec<Term>) {
        if let Some(field) = self.further.get_mut(index) {
            field.terms = terms;
        }
    }

    /// True if both have the same voxels in the same order.
    #[must_use]
    pub fn are(&self, other: &Self) -> bool {
        self.further.len() == other.further.len() && self.iter().zip(other.iter()).all(|(ours, theirs)| ours.is(theirs))
    }
}
