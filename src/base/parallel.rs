//! Parallel loops, called through a pointer: the scheduler's code is then compiled once, and not once for each loop over it
//! and each type of element.

use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

/// Most tasks of a loop; each has neighbouring rows.
const TASKS: usize = 4096;

/// Returns `part(0)`, `part(1)`, … of `parts` parts.
pub fn map<T: Send>(parts: usize, part: &(dyn Fn(usize) -> T + Sync)) -> Vec<T> {
    let mut found: Vec<Option<T>> = (0..parts).map(|_| None).collect();
    rows_mut(&mut found, 1, &|number, place| place.fill_with(|| Some(part(number))));
    found.into_iter().flatten().collect()
}

/// Returns `part(scratch, 0)`, `part(scratch, 1)`, … of `parts` parts, with a scratch for each thread.
pub fn map_with<S: Send, T: Send>(
    parts: usize,
    scratch: &(dyn Fn() -> S + Sync),
    part: &(dyn Fn(&mut S, usize) -> T + Sync),
) -> Vec<T> {
    let free: Mutex<Vec<S>> = Mutex::new(Vec::new());
    let lock = || free.lock().unwrap_or_else(PoisonError::into_inner);
    map(parts, &|number| {
        let taken = lock().pop();
        let mut scratch = taken.unwrap_or_else(scratch);
        let found = part(&mut scratch, number);
        lock().push(scratch);
        found
    })
}

/// Calls `each` with the number of every row of `row` elements, and the row; the last may be shorter.
pub fn rows_mut<T: Send>(elements: &mut [T], row: usize, each: &(dyn Fn(usize, &mut [T]) + Sync)) {
    let rows = elements.len().div_ceil(row).div_ceil(TASKS).max(1);
    let tasks: Vec<Mutex<&mut [T]>> = elements.chunks_mut(rows * row).map(Mutex::new).collect();
    repeat(tasks.len(), &|task| {
        let mut elements = tasks[task].lock().unwrap_or_else(PoisonError::into_inner);
        (rows * task..).zip(elements.chunks_mut(row)).for_each(|(number, row)| each(number, row));
    });
}

/// Calls `each(0)`, `each(1)`, … up to `times`.
fn repeat(times: usize, each: &(dyn Fn(usize) + Sync)) {
    (0..times).into_par_iter().for_each(each);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_part_has_a_scratch_that_no_other_thread_uses() {
        let made = std::sync::atomic::AtomicUsize::new(0);
        let scratch = || made.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        let found = map_with(1000, &scratch, &|scratch, part| [*scratch, part]);
        assert!(found.iter().enumerate().all(|(part, it)| it[1] == part), "in order");
        let made = made.into_inner();
        assert!((1..=rayon::current_num_threads() + 1).contains(&made), "{made} for all parts");
        assert!(found.iter().all(|it| it[0] < made), "one of those made");
    }

    #[test]
    fn every_row_is_visited_once_with_its_number() {
        for (length, row) in [(0, 3), (1, 1), (7, 3), (TASKS, 1), (3 * TASKS + 5, 1), (10 * TASKS - 1, 4)] {
            let mut elements = vec![0; length];
            rows_mut(&mut elements, row, &|number, row| row.iter_mut().for_each(|element| *element += number + 1));
            let expected: Vec<usize> = (0..length).map(|place| place / row + 1).collect();
            assert!(elements == expected, "{length} elements in rows of {row}");
            assert!(map(length, &|number| number) == (0..length).collect::<Vec<_>>(), "{length} parts");
        }
    }
}
