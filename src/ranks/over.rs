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

/// The part of a node's film in some rows: a rectangle of the film.
struct Part<'a> {
    met: Rectangle,
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
    /// The film of all pixels of the rows from `first` on: as `empty` outside of the rectangle.
    fn film(&self, first: usize, empty: &Film<f32>) -> Film<f32> {
        let [low, high] = self.met;
        let film = match self.numbers {
            Numbers::Whole(film) => film.cut_out(self.met),
            Numbers::Sent(bytes) => {
                let size = [high[0] - low[0], high[1] - low[1]];
                let accumulators = empty.accumulators.len() / empty.pixels().max(1) * 4 * size[0] * size[1];
                let (accumulators, transmittance) = bytes.split_at(accumulators.min(bytes.len()));
                Film {
                    size,
                    components: empty.components,
                    accumulators: numbers_of_bytes(accumulators),
                    transmittance: numbers_of_bytes(transmittance),
                }
            }
        };
        if film.size == empty.size {
            return film;
        }
        let mut whole = empty.clone();
        whole.put([low[0], low[1] - first], &film);
        whole
    }
}

/// Numbers as [`Film::bytes_of`] has them.
fn numbers_of_bytes(bytes: &[u8]) -> Vec<f32> {
    bytes.as_chunks().0.iter().map(|&bytes| f32::from_ne_bytes(bytes)).collect()
}

/// Most bytes of a process's rows that are exchanged and composite at once, unless one row has more. Messages and films of these
/// rows stay in the caches, and their memory serves for the next ones.
pub const BYTES_AT_ONCE: usize = 1 << 18;

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

    // Rectangles to their owners, and their composite, some rows of each process at a time.
    let (width, rank) = (shape.size[0], ranks.rank());
    let rows = rows_of(rank);
    let Some(mut film) = shape.of_no_medium([width, rows.len()]) else { return Ok(None) };
    let numbers = (shape.accumulators.len() + shape.transmittance.len()) / shape.pixels().max(1);
    let step = (BYTES_AT_ONCE / (4 * numbers * width).max(1)).max(1);
    let (mut outgoing, mut received) = (vec![Vec::new(); ranks.count()], Vec::new());
    let mut sent_bytes = 0;
    for before in (0..height.div_ceil(ranks.count())).step_by(step) {
        let some_of = |rank: usize| {
            let rows = rows_of(rank);
            (rows.start + before).min(rows.end)..(rows.start + before + step).min(rows.end)
        };
        for (to, message) in outgoing.iter_mut().enumerate().filter(|&(to, _)| to != rank) {
            message.clear();
            for it in all.iter().filter(|it| it.rank == rank) {
                let part = in_rows(it.met, &some_of(to));
                let film = mine.iter().find(|(node, _)| *node == it.node);
                if let Some((part, (_, film))) = part.zip(film) {
                    film.bytes_of(part, message);
                }
            }
        }
        let messages: Vec<(usize, &[u8])> =
            outgoing.iter().map(|message| &**message).enumerate().filter(|(_, message)| !message.is_empty()).collect();
        sent_bytes += messages.iter().map(|(_, message)| message.len()).sum::<usize>();
        let some = some_of(rank);
        let sends =
            |from: usize| from != rank && all.iter().any(|it| it.rank == from && in_rows(it.met, &some).is_some());
        let senders: Vec<usize> = (0..ranks.count()).filter(|&from| sends(from)).collect();
        ranks.exchange_into(&messages, &senders, &mut received);
        // The part of each node in these rows.
        let mut left: Vec<&[u8]> = received.iter().map(|message| &**message).collect();
        let mut parts: Vec<(Node, Option<Part<'_>>)> = Vec::with_capacity(all.len());
        for it in &all {
            let part = match (in_rows(it.met, &some), mine.iter().find(|(node, _)| *node == it.node)) {
                (None, _) => None,
                (Some(met), Some((_, film))) => Some(Part { met, numbers: Numbers::Whole(film) }),
                (Some(met), None) => {
                    let [low, high] = met;
                    let bytes = 4 * numbers * (high[0] - low[0]) * (high[1] - low[1]);
                    let Some(from) = senders.iter().position(|&from| from == it.rank) else { return Ok(None) };
                    let Some((taken, rest)) = left[from].split_at_checked(bytes) else { return Ok(None) };
                    left[from] = rest;
                    Some(Part { met, numbers: Numbers::Sent(taken) })
                }
            };
            parts.push((it.node, part));
        }
        // They are dense only while they composite.
        let Some(empty) = shape.of_no_medium([width, some.len()]) else { return Ok(None) };
        let composite = composited(top, low_first, &mut |node| {
            let part = parts.iter().find(|(other, _)| *other == node);
            Ok(part.map(|(_, part)| part.as_ref().map_or_else(|| empty.clone(), |part| part.film(some.start, &empty))))
        })?;
        let Some(composite) = composite else { return Ok(None) };
        film.put([0, some.start - rows.start], &composite);
    }
    Ok(Some(Share { rows, film, sent_bytes }))
}
