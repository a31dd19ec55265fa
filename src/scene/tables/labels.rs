//! The media of labels, as a march looks them up.

use super::transfer::value_of_entry;
use super::{Step, Steps, TransferTable};
use crate::plan::Planned;
use crate::{Medium, Scene};
use relume_base::number::unsigned;

/// The media of labels: a row for each declared one in their order, behind row 0, which is empty.
#[derive(Clone, Debug, PartialEq)]
pub struct LabelTable {
    /// Entries of all rows, one behind the other.
    pub table: TransferTable,
    /// Where rows lie in it.
    pub rows: LabelRows,
}

/// Where the rows of a label table lie among its entries.
#[derive(Clone, Debug, PartialEq)]
pub struct LabelRows {
    /// First entry of each row, and true if it has as many entries as the transfer table, over the same values; else it has one. Equal
    /// rows by value share their entries.
    pub rows: Vec<(usize, bool)>,
    /// Indices of the labels that have entries of their own, with as many entries.
    own: Vec<(usize, usize)>,
}

impl LabelRows {
    /// The rows of the labels of `scene` beside a transfer table of so many `entries`.
    #[must_use]
    pub fn new(scene: &Scene, entries: usize) -> Self {
        let mut rows = vec![(0, false)];
        let mut own: Vec<(usize, usize)> = Vec::new();
        // Labels by value with entries of their own: few, where there may be thousands of labels.
        let mut different: Vec<usize> = Vec::new();
        let mut end = 1;
        for (index, entry) in scene.declared().iter().enumerate() {
            let by_value = !entry.terms.is_empty();
            if by_value {
                let equal = different.iter().find(|&&other| scene.declared()[other].terms == entry.terms);
                if let Some(&other) = equal {
                    rows.push(rows[other + 1]);
                    continue;
                }
                different.push(index);
            }
            let length = if by_value { entries } else { 1 };
            rows.push((end, by_value));
            own.push((index, length));
            end += length;
        }
        Self { rows, own }
    }

    /// The numbers of a shader: twice the first entry of each row, plus 1 if it goes by value.
    #[must_use]
    pub fn words(&self) -> Vec<u32> {
        self.rows.iter().map(|&(first, by_value)| 2 * unsigned(first) + u32::from(by_value)).collect()
    }

    /// The media of all entries of the labels of `scene`, over this `domain` of values.
    pub(super) fn media<'a>(&'a self, scene: &'a Scene, domain: [f64; 2]) -> impl Iterator<Item = Medium> + 'a {
        let materials = scene.materials.len();
        let of_label = move |&(index, length): &(usize, usize)| {
            (0..length).map(move |i| scene.declared()[index].medium(value_of_entry(domain, i, length), materials))
        };
        std::iter::once(Medium::nothing(materials)).chain(self.own.iter().flat_map(of_label))
    }
}

impl LabelTable {
    /// Builds the table of `scene` beside a transfer table of so many `entries` over the `domain` of the first field.
    #[must_use]
    pub fn new(scene: &Scene, planned: &Planned, domain: [f64; 2], entries: usize) -> Self {
        let steps = Steps::new(scene, planned);
        let rows = LabelRows::new(scene, entries);
        let of_medium = |medium: Medium| Step::written(|step| steps.write_label_of(&medium, step));
        let table = TransferTable::of_steps(planned, 1, rows.media(scene, domain).map(of_medium));
        Self { table, rows }
    }
}
