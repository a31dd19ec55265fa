//! Parallel loops, called through a pointer: the scheduler's code is then compiled once for each type of element, and not
//! once for each loop over it.

use rayon::prelude::*;

/// Returns `part(0)`, `part(1)`, … of `parts` parts.
pub(crate) fn map<T: Send>(parts: usize, part: &(dyn Fn(usize) -> T + Sync)) -> Vec<T> {
    (0..parts).into_par_iter().map(part).collect()
}

/// Calls `each` with the number of every row of `row` elements, and the row; the last may be shorter.
pub(crate) fn rows_mut<T: Send>(elements: &mut [T], row: usize, each: &(dyn Fn(usize, &mut [T]) + Sync)) {
    elements.par_chunks_mut(row).enumerate().for_each(|(number, row)| each(number, row));
}
