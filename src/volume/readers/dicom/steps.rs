//! The volumes of a series whose slices share positions: which slices form each, and what tells them apart.

use std::collections::HashMap;

use super::image::Image;
use super::keys::{self, COUNT, KEYS, Mark};
use super::pixels::Slice;
use relume_base::number::{brief, count};

/// Volumes of one series.
#[derive(Debug, Default)]
pub(super) struct Steps {
    /// Slices of each volume, in the order of the z axis.
    pub(super) times: Vec<Vec<Slice>>,
    /// Names of the attributes that tell the volumes apart; empty for one volume.
    pub(super) axis: String,
    /// Values of these attributes for each volume.
    pub(super) values: Vec<String>,
    /// Whether only the order of the files tells them apart.
    pub(super) is_by_order: bool,
}

/// Slices at one position, several positions.
type Cells = [Vec<Slice>];

/// Index of a value, for each slice of [`Cells`].
type Ids = Vec<Vec<usize>>;

/// Values of an attribute, in the order of the volumes.
struct Values {
    ids: Ids,
    names: Vec<String>,
}

/// The attribute `key` of a slice.
fn mark(images: &[Image], slice: Slice, key: usize) -> Option<&Mark> {
    let image = &images[slice.image];
    image.frame(slice.frame).marks.iter().chain(&image.marks).find(|mark| mark.key == key)
}

/// Place of a slice in the order of files and frames.
fn order(images: &[Image], slice: Slice) -> (f64, usize, usize) {
    (images[slice.image].instance_number.unwrap_or(f64::INFINITY), slice.image, slice.frame)
}

/// Number of different values of `ids`.
fn different(ids: &[usize]) -> usize {
    let mut sorted = ids.to_vec();
    sorted.sort_unstable();
    sorted.dedup();
    sorted.len()
}

/// Whether each position has the same values equally often.
fn are_alike(ids: &Ids) -> bool {
    let sorted = |ids: &Vec<usize>| {
        let mut sorted = ids.clone();
        sorted.sort_unstable();
        sorted
    };
    let first = ids.first().map(sorted);
    ids.iter().all(|ids| Some(sorted(ids)) == first)
}

/// The values of the attribute `key`, if there are several, and each position has the same ones.
fn values(images: &[Image], cells: &Cells, key: usize) -> Option<Values> {
    let mut all: Vec<Option<&Mark>> = Vec::new();
    let mut firsts: Vec<(f64, usize, usize)> = Vec::new();
    let mut index_of: HashMap<Option<&str>, usize> = HashMap::new();
    let mut ids = Ids::new();
    for cell in cells {
        let mut of_cell = Vec::new();
        for &slice in cell {
            let (found, place) = (mark(images, slice, key), order(images, slice));
            let index = *index_of.entry(found.map(|mark| mark.name.as_str())).or_insert_with(|| {
                all.push(found);
                firsts.push(place);
                all.len() - 1
            });
            if earlier(place, firsts[index]) {
                firsts[index] = place;
            }
            of_cell.push(index);
        }
        ids.push(of_cell);
        // Values that differ from slice to slice are no axis.
        if all.len() > cell.len() {
            return None;
        }
    }
    if all.len() < 2 || !are_alike(&ids) {
        return None;
    }
    // None first, then numbers, then words in the order of the files.
    let mut sorted: Vec<usize> = (0..all.len()).collect();
    sorted.sort_by(|&one, &other| {
        let at = |index: usize| all[index].map(|mark| mark.at);
        let is_first = |index: usize| all[index].is_some();
        let number = match (at(one), at(other)) {
            (Some(a), Some(b)) if !a.is_nan() && !b.is_nan() => a.total_cmp(&b),
            _ => std::cmp::Ordering::Equal,
        };
        let by_file =
            if earlier(firsts[one], firsts[other]) { std::cmp::Ordering::Less } else { std::cmp::Ordering::Greater };
        is_first(one).cmp(&is_first(other)).then(number).then(by_file)
    });
    let mut place = vec![0; all.len()];
    sorted.iter().enumerate().for_each(|(rank, &index)| place[index] = rank);
    ids.iter_mut().flatten().for_each(|id| *id = place[*id]);
    let names = sorted.iter().map(|&index| all[index].map_or("none", |mark| mark.name.as_str()).to_owned()).collect();
    Some(Values { ids, names: distinct_parts(names) })
}

fn earlier(one: (f64, usize, usize), other: (f64, usize, usize)) -> bool {
    one.0.total_cmp(&other.0).then(one.1.cmp(&other.1)).then(one.2.cmp(&other.2)).is_lt()
}

/// Values of several words without those that all have.
fn distinct_parts(names: Vec<String>) -> Vec<String> {
    let parts: Vec<Vec<&str>> = names.iter().map(|name| name.split('\\').map(str::trim).collect()).collect();
    let longest = parts.iter().map(Vec::len).max().unwrap_or(0);
    let word = |parts: &Vec<&str>, at: usize| parts.get(at).copied().unwrap_or_default().to_owned();
    let differs = |at: &usize| parts.iter().any(|other| word(other, *at) != word(&parts[0], *at));
    let told: Vec<usize> = (0..longest).filter(differs).collect();
    let short = |parts: &Vec<&str>| {
        let words: Vec<String> = told.iter().map(|&at| word(parts, at)).filter(|word| !word.is_empty()).collect();
        if words.is_empty() { "none".to_owned() } else { words.join(" ") }
    };
    parts.iter().map(short).collect()
}

/// Name of the attribute `key` of the files of `image`.
fn name_of(image: &Image, key: usize) -> String {
    match KEYS.get(key) {
        Some(key) => key.name.to_owned(),
        None => {
            let index = key - KEYS.len();
            let stated = image.dimensions.get(index).filter(|name| !name.is_empty());
            stated.cloned().unwrap_or_else(|| format!("dimension {}", index + 1))
        }
    }
}

/// The volumes of the slices of `cells`, which are equally many at each position; `None` if nothing tells them apart.
///
/// One attribute of which each position has the same values, none twice, makes the volumes. Otherwise several together do, such as
/// echo and kind of image; what they leave is told apart by times, and at last by the order of the files.
pub(super) fn told_apart(images: &[Image], cells: &Cells) -> Option<Steps> {
    let wanted = cells.first()?.len();
    let image = &images[cells.first()?.first()?.image];
    let made = |ids: &Ids, axis: String, values: Vec<String>, is_by_order: bool| Steps {
        times: volumes(cells, ids, wanted),
        axis,
        values,
        is_by_order,
    };
    let mut together: Option<(Ids, Vec<usize>)> = None;
    let mut several = Vec::new();
    for key in 0..COUNT {
        let Some(found) = values(images, cells, key) else { continue };
        if found.names.len() == wanted {
            return Some(made(&found.ids, name_of(image, key), found.names, false));
        }
        several.push((key, found));
    }
    // Each further attribute must split what the others leave, equally at each position.
    for (index, (_, found)) in several.iter().enumerate() {
        let (next, before) = match &together {
            None => (found.ids.clone(), 1),
            Some((ids, _)) => (combined(ids, &found.ids), different(&ids[0])),
        };
        if are_alike(&next) && different(&next[0]) > before {
            let mut keys = together.take().map(|(_, keys)| keys).unwrap_or_default();
            keys.push(index);
            together = Some((next, keys));
        }
    }
    let (ids, keys) = together.unwrap_or_else(|| (cells.iter().map(|cell| vec![0; cell.len()]).collect(), Vec::new()));
    let axis_of = |further: Option<&str>| {
        let names = keys.iter().map(|&index| name_of(image, several[index].0)).chain(further.map(str::to_owned));
        names.collect::<Vec<_>>().join(" and ")
    };
    // Names of the volumes are those of the slices at the first position.
    let named = |ids: &Ids, further: Option<&dyn Fn(Slice) -> String>| -> Vec<String> {
        let name = |at: usize| {
            let words = keys.iter().map(|&index| {
                let values = &several[index].1;
                values.names[values.ids[0][at]].clone()
            });
            let further = further.map(|further| further(cells[0][at]));
            words.chain(further).collect::<Vec<_>>().join(" ")
        };
        let mut names = vec![String::new(); wanted];
        ids[0].iter().enumerate().for_each(|(at, &id)| names[id] = name(at));
        names
    };
    if different(&ids[0]) == wanted {
        return Some(made(&ids, axis_of(None), named(&ids, None), false));
    }
    for key in (0..COUNT).filter(|&key| keys::is_clock(key)) {
        let place = |slice: Slice| mark(images, slice, key).map(|mark| mark.at);
        if let Some(ranked) = ranked(cells, &ids, place) {
            let word = |slice: Slice| mark(images, slice, key).map_or_else(String::new, |mark| mark.name.clone());
            return Some(made(&ranked, axis_of(Some(&name_of(image, key))), named(&ranked, Some(&word)), false));
        }
    }
    let is_one_file = cells.iter().flatten().all(|slice| slice.image == cells[0][0].image);
    // More than the frames of any file.
    let frames = 2_f64.powi(21);
    let place = |Slice { image, frame }: Slice| {
        let image = &images[image];
        let frame = if image.count > 1 { count(frame) } else { 0.0 };
        if is_one_file { Some(frame) } else { image.instance_number.map(|number| number.mul_add(frames, frame)) }
    };
    let ranked = ranked(cells, &ids, place)?;
    let word = |slice: Slice| match images[slice.image].instance_number {
        Some(number) if !is_one_file => brief(number),
        _ => (slice.frame + 1).to_string(),
    };
    let axis = axis_of(Some(if is_one_file { "frame" } else { "InstanceNumber" }));
    Some(made(&ranked, axis, named(&ranked, Some(&word)), true))
}

/// Indices of pairs of values, in their order.
fn combined(one: &Ids, other: &Ids) -> Ids {
    let pairs = || one.iter().flatten().copied().zip(other.iter().flatten().copied());
    let mut all: Vec<(usize, usize)> = pairs().collect();
    all.sort_unstable();
    all.dedup();
    let index = |pair: (usize, usize)| all.binary_search(&pair).unwrap_or(0);
    one.iter()
        .zip(other)
        .map(|(one, other)| one.iter().copied().zip(other.iter().copied()).map(index).collect())
        .collect()
}

/// `ids`, split by the order of the slices of equal index at a position; `None` if a slice has no place, or one of another.
fn ranked(cells: &Cells, ids: &Ids, place: impl Fn(Slice) -> Option<f64>) -> Option<Ids> {
    let mut ranks = Ids::new();
    for (cell, ids) in cells.iter().zip(ids) {
        let places: Vec<f64> = cell.iter().map(|&slice| place(slice)).collect::<Option<_>>()?;
        let mut ranked: Vec<usize> = (0..cell.len()).collect();
        ranked.sort_by(|&a, &b| ids[a].cmp(&ids[b]).then(places[a].total_cmp(&places[b])));
        let is_one = |pair: &[usize]| ids[pair[0]] == ids[pair[1]] && places[pair[0]] >= places[pair[1]];
        if places.iter().any(|place| place.is_nan()) || ranked.windows(2).any(is_one) {
            return None;
        }
        let mut of_cell = vec![0; cell.len()];
        ranked.iter().enumerate().for_each(|(rank, &index)| of_cell[index] = rank);
        ranks.push(of_cell);
    }
    Some(ranks)
}

/// The slices of each of `wanted` indices.
fn volumes(cells: &Cells, ids: &Ids, wanted: usize) -> Vec<Vec<Slice>> {
    let mut all = vec![Vec::new(); wanted];
    for (&slice, &id) in cells.iter().flatten().zip(ids.iter().flatten()) {
        all[id].push(slice);
    }
    all
}

/// Largest number of volumes of different extents in one series.
const MOST_PARTS: usize = 64;

/// Volumes in which positions have equally many slices, of slices of which `cells` has unequally many at the positions: by the first
/// attribute that makes such, each with its name and value. `None` if there is none.
pub(super) fn parts(images: &[Image], cells: &Cells) -> Option<Vec<(String, Vec<Slice>)>> {
    let image = &images[cells.first()?.first()?.image];
    (0..COUNT).filter(|&key| !keys::is_clock(key)).find_map(|key| {
        let mut names: Vec<String> = Vec::new();
        let mut parts: Vec<Vec<Vec<Slice>>> = Vec::new();
        for cell in cells {
            let mut of_cell: Vec<Vec<Slice>> = vec![Vec::new(); parts.len()];
            for &slice in cell {
                let name = mark(images, slice, key).map_or("none", |mark| mark.name.as_str());
                let index = names.iter().position(|known| known == name).unwrap_or_else(|| {
                    names.push(name.to_owned());
                    parts.push(Vec::new());
                    of_cell.push(Vec::new());
                    names.len() - 1
                });
                of_cell[index].push(slice);
            }
            if names.len() > MOST_PARTS {
                return None;
            }
            parts
                .iter_mut()
                .zip(of_cell)
                .for_each(|(part, slices)| part.extend((!slices.is_empty()).then_some(slices)));
        }
        let is_whole = |part: &Vec<Vec<Slice>>| part.iter().all(|cell| cell.len() == part[0].len());
        if names.len() < 2 || !parts.iter().all(is_whole) {
            return None;
        }
        let names = distinct_parts(names).into_iter().map(|name| format!("{} {name}", name_of(image, key)));
        Some(names.zip(parts.into_iter().map(|part| part.concat())).collect())
    })
}

/// The attributes of which the slices at one position have different values, with these values.
pub(super) fn differences(images: &[Image], cells: &Cells) -> Vec<String> {
    const MOST: usize = 4;
    let mut found = Vec::new();
    let Some(image) = cells.first().and_then(|cell| cell.first()).map(|slice| &images[slice.image]) else {
        return found;
    };
    for key in 0..COUNT {
        let names = |cell: &Vec<Slice>| -> Vec<String> {
            let mut names: Vec<String> = Vec::new();
            for &slice in cell {
                let name = mark(images, slice, key).map_or("none", |mark| mark.name.as_str());
                if names.len() <= MOST && !names.iter().any(|known| known == name) {
                    names.push(name.to_owned());
                }
            }
            names
        };
        if let Some(names) = cells.iter().map(names).find(|names| names.len() > 1) {
            let mut names = distinct_parts(names);
            if names.len() > MOST {
                names.truncate(MOST);
                names.push("…".to_owned());
            }
            found.push(format!("{} ({})", name_of(image, key), names.join(", ")));
        }
    }
    found
}
