//! Films of blocks, marched by all processes at once and composited by the tree of the volume: rectangles go straight to
//! the process that owns their rows.

use std::ops::Range;

use super::{Ranks, all_gather, numbers, numbers_of, share_of};
use crate::film::{Film, Rectangle, composited};
use crate::scene::Node;

/// Rows of the film that a process owns after [`over`], and what it sent for them.
#[derive(Clone, Debug)]
pub struct Share {
    /// The rows.
    pub rows: Range<usize>,
    /// Their film.
    pub film: Film<f32>,
    /// Bytes that the process sent to others, without those that announce rectangles.
    pub sent_bytes: usize,
}

/// A rectangle of the film of a node.
struct Announced {
    node: Node,
    rank: usize,
    met: Rectangle,
}

/// The part of a node's film in the rows of this process: the rectangle in which rays met something.
struct Part<'a> {
    node: Node,
    /// Of the film's pixels; `None` if rays met nothing in these rows.
    met: Option<Rectangle>,
    numbers: Numbers<'a>,
}

/// The numbers of a part.
enum Numbers<'a> {
    /// Those of a film of all pixels.
    Whole(&'a Film<f32>),
    /// Those of the rectangle, as they were sent.
    Sent(&'a [u8]),
}

impl Part<'_> {
    /// The film of all pixels of `rows`: as `empty` where nothing was met. `numbers` are those of a pixel.
    fn in_rows(&self, rows: &Range<usize>, empty: &Film<f32>, numbers: [usize; 2]) -> Film<f32> {
        let Some((met, part)) = self.met.and_then(|met| Some((met, in_rows(met, rows)?))) else { return empty.clone() };
        let film = match self.numbers {
            Numbers::Whole(film) => film.cut_out(part),
            Numbers::Sent(bytes) => {
                let size = [part[1][0] - part[0][0], part[1][1] - part[0][1]];
                let (plane, line) = (4 * size[0] * (met[1][1] - met[0][1]), 4 * size[0]);
                let lines = (part[0][1] - met[0][1]) * line..(part[1][1] - met[0][1]) * line;
                let of_planes = |planes: Range<usize>| -> Vec<f32> {
                    let mut taken = Vec::with_capacity((planes.end - planes.start) * size[0] * size[1]);
                    for of_plane in bytes[planes.start * plane..planes.end * plane].chunks_exact(plane) {
                        taken.extend(
                            of_plane[lines.clone()].as_chunks().0.iter().map(|&bytes| f32::from_ne_bytes(bytes)),
                        );
                    }
                    taken
                };
                let (accumulators, transmittance) =
                    (of_planes(0..numbers[0]), of_planes(numbers[0]..numbers[0] + numbers[1]));
                Film { size, components: empty.components, accumulators, transmittance }
            }
        };
        if film.size == empty.size {
            return film;
        }
        let mut whole = empty.clone();
        whole.put([part[0][0], part[0][1] - rows.start], &film);
        whole
    }
}

/// Rows that composite at once: their films stay in the caches.
const AT_ONCE: usize = 8;

/// The part of a rectangle in `rows`; `None` if there is none.
fn in_rows([low, high]: Rectangle, rows: &Range<usize>) -> Option<Rectangle> {
    let [first, end] = [low[1].max(rows.start), high[1].min(rows.end)];
    (first < end).then_some([[low[0], first], [high[0], end]])
}

/// Marches the leaves that this process owns by `leaf`, numbered from 0, and composites all. `low_first` has the side in
/// front of each cut of the tree of `blocks` leaves, at least one for each process.
///
/// Each process composites the largest nodes of the tree that are all its own, and sends of each the rectangle in which
/// rays met something. The operations for a pixel and their order follow from the tree alone, so the film is the same to
/// the bit for any number of processes. `None` if a film is without pixels, films differ in shape, or their
/// transmittance is a matrix.
///
/// # Errors
///
/// Those of `leaf`.
pub fn over<E>(
    ranks: &dyn Ranks,
    blocks: usize,
    low_first: &[bool],
    leaf: &mut dyn FnMut(usize) -> Result<Film<f32>, E>,
) -> Result<Option<Share>, E> {
    let top = Node::top(blocks);
    let owned = share_of(blocks, ranks.rank(), ranks.count());
    let mut mine: Vec<(Node, Film<f32>)> = Vec::new();
    for node in top.largest_within([owned.start + 1, owned.end]) {
        let film = composited(node, low_first, &mut |node| match node.sides() {
            None => leaf(node.leaves[0] - 1).map(Some),
            Some(_) => Ok(None),
        })?;
        let Some(film) = film else { return Ok(None) };
        mine.push((node, film));
    }
    let Some((_, shape)) = mine.first() else { return Ok(None) };
    let height = shape.size[1];
    let rows_of = |rank: usize| share_of(height, rank, ranks.count());

    // Rectangles of all processes.
    let announced: Vec<u8> = mine
        .iter()
        .flat_map(|(node, film)| {
            let [low, high] = film.met();
            numbers(&[node.leaves[0], node.leaves[1], node.cut, low[0], low[1], high[0], high[1]])
        })
        .collect();
    let mut all: Vec<Announced> = Vec::new();
    for (rank, bytes) in all_gather(ranks, announced).into_iter().enumerate() {
        for &[first, last, cut, x, y, right, bottom] in numbers_of(&bytes).as_chunks::<7>().0 {
            let node = Node { leaves: [first, last], cut };
            all.push(Announced { node, rank, met: [[x, y], [right, bottom]] });
        }
    }

    // Rectangles to their owners.
    let mut outgoing: Vec<(usize, Vec<u8>)> = Vec::new();
    for rank in (0..ranks.count()).filter(|&rank| rank != ranks.rank()) {
        let rows = rows_of(rank);
        let mut message = Vec::new();
        for (node, film) in &mine {
            let met = all.iter().find(|it| it.node == *node).map_or([[0; 2]; 2], |it| it.met);
            if let Some(part) = in_rows(met, &rows) {
                film.bytes_of(part, &mut message);
            }
        }
        if !message.is_empty() {
            outgoing.push((rank, message));
        }
    }
    let rows = rows_of(ranks.rank());
    let is_sender =
        |rank: usize| rank != ranks.rank() && all.iter().any(|it| it.rank == rank && in_rows(it.met, &rows).is_some());
    let senders: Vec<usize> = (0..ranks.count()).filter(|&rank| is_sender(rank)).collect();
    let sent_bytes = outgoing.iter().map(|(_, message)| message.len()).sum();
    let messages: Vec<(usize, &[u8])> = outgoing.iter().map(|(rank, message)| (*rank, &**message)).collect();
    let received = ranks.exchange(&messages, &senders);
    drop(outgoing);

    // The films of the nodes in these rows, which are dense again only while they composite.
    let Some(mut film) = shape.of_no_medium([shape.size[0], rows.len()]) else { return Ok(None) };
    let per_pixel = [&shape.accumulators, &shape.transmittance].map(|numbers| numbers.len() / shape.pixels().max(1));
    let mut parts: Vec<Part<'_>> = Vec::new();
    let mut left: Vec<&[u8]> = received.iter().map(|message| &**message).collect();
    for it in &all {
        let met = in_rows(it.met, &rows);
        let numbers = match (mine.iter().find(|(node, _)| *node == it.node), met) {
            (Some((_, film)), _) => Numbers::Whole(film),
            (None, None) => Numbers::Sent(&[]),
            (None, Some([low, high])) => {
                let Some(from) = senders.iter().position(|&rank| rank == it.rank) else { return Ok(None) };
                let bytes = 4 * (per_pixel[0] + per_pixel[1]) * (high[0] - low[0]) * (high[1] - low[1]);
                let Some((taken, rest)) = left[from].split_at_checked(bytes) else { return Ok(None) };
                left[from] = rest;
                Numbers::Sent(taken)
            }
        };
        parts.push(Part { node: it.node, met, numbers });
    }
    for start in rows.clone().step_by(AT_ONCE) {
        let some = start..(start + AT_ONCE).min(rows.end);
        let Some(empty) = shape.of_no_medium([shape.size[0], some.len()]) else { return Ok(None) };
        let composite = composited(top, low_first, &mut |node| {
            let part = parts.iter().find(|part| part.node == node);
            Ok(part.map(|part| part.in_rows(&some, &empty, per_pixel)))
        })?;
        let Some(composite) = composite else { return Ok(None) };
        film.put([0, start - rows.start], &composite);
    }
    Ok(Some(Share { rows, film, sent_bytes }))
}
