//! One picture by several processes: messages between them, and the two ways to share a march (docs/SCALE.md).
//!
//! A rank is the number of a process, from 0. All processes call the functions of this module in the same order.

#[cfg(feature = "mpi")]
mod mpi;
mod over;
mod relay;

use std::ops::Range;

#[cfg(feature = "mpi")]
pub use mpi::Mpi;
pub use over::{BYTES_AT_ONCE, Share, over};
pub use relay::{Relay, tiles};

/// The processes of a run, as one of them sees them.
pub trait Ranks {
    /// Number of this process.
    fn rank(&self) -> usize;

    /// Number of processes.
    fn count(&self) -> usize;

    /// Sends each message to its rank, and replaces `received` by one message from each rank of `from`, in their order, in the
    /// memory of those before. Returns when all have arrived. Messages between two ranks keep their order.
    fn exchange_into(&self, outgoing: &[(usize, &[u8])], from: &[usize], received: &mut Vec<Vec<u8>>);

    /// As [`Self::exchange_into`]; returns the messages.
    fn exchange(&self, outgoing: &[(usize, &[u8])], from: &[usize]) -> Vec<Vec<u8>> {
        let mut received = Vec::new();
        self.exchange_into(outgoing, from, &mut received);
        received
    }

    /// Ends all processes, this one with `code`.
    fn abort(&self, code: u8) -> !;
}

/// The only process of a run.
#[derive(Clone, Copy, Debug)]
pub struct Alone;

impl Ranks for Alone {
    fn rank(&self) -> usize {
        0
    }

    fn count(&self) -> usize {
        1
    }

    fn exchange_into(&self, _: &[(usize, &[u8])], _: &[usize], received: &mut Vec<Vec<u8>>) {
        received.clear();
    }

    fn abort(&self, code: u8) -> ! {
        std::process::exit(code.into())
    }
}

/// The part of 0 to `total` that is the share of `rank`: contiguous, in the order of the ranks, and as equal as can be.
#[must_use]
pub fn share_of(total: usize, rank: usize, count: usize) -> Range<usize> {
    let at = |rank: usize| total / count * rank + total % count * rank / count;
    at(rank)..at(rank + 1)
}

/// Sends `mine` to every rank; returns what each has sent, in the order of the ranks. Takes as many rounds as the number of
/// processes has binary digits, and no process handles more than all messages once (Bruck et al. 1997).
pub fn all_gather(ranks: &dyn Ranks, mine: Vec<u8>) -> Vec<Vec<u8>> {
    let (rank, count) = (ranks.rank(), ranks.count());
    // Those of this rank and of the ones behind it.
    let mut held = vec![mine];
    while held.len() < count {
        let distance = held.len();
        let message = packed(&held[..distance.min(count - distance)]);
        let (to, from) = ((rank + count - distance) % count, (rank + distance) % count);
        let received = ranks.exchange(&[(to, &message)], &[from]);
        held.extend(received.first().map(|message| unpacked(message)).unwrap_or_default());
        held.resize(count.min(2 * distance), Vec::new());
    }
    held.rotate_right(rank);
    held
}

/// Sends rows of a picture, each range with its bytes, to rank 0, which returns those of all ranks.
pub fn gather_rows(ranks: &dyn Ranks, mine: Vec<(Range<usize>, Vec<u8>)>) -> Vec<(Range<usize>, Vec<u8>)> {
    if ranks.rank() > 0 {
        let parts: Vec<Vec<u8>> =
            mine.into_iter().flat_map(|(rows, bytes)| [numbers(&[rows.start, rows.end]), bytes]).collect();
        ranks.exchange(&[(0, &packed(&parts))], &[]);
        return Vec::new();
    }
    let others: Vec<usize> = (1..ranks.count()).collect();
    let mut all = mine;
    for message in ranks.exchange(&[], &others) {
        let parts = unpacked(&message);
        for pair in parts.chunks_exact(2) {
            if let [start, end] = numbers_of(&pair[0])[..] {
                all.push((start..end, pair[1].clone()));
            }
        }
    }
    all
}

/// Messages as one: the length of each before it.
fn packed(parts: &[Vec<u8>]) -> Vec<u8> {
    parts.iter().flat_map(|part| numbers(&[part.len()]).into_iter().chain(part.iter().copied())).collect()
}

/// The messages of [`packed`].
fn unpacked(mut bytes: &[u8]) -> Vec<Vec<u8>> {
    let mut parts = Vec::new();
    while let Some((length, rest)) = bytes.split_first_chunk::<8>() {
        let length = usize::try_from(u64::from_le_bytes(*length)).unwrap_or(usize::MAX).min(rest.len());
        let (part, rest) = rest.split_at(length);
        parts.push(part.to_vec());
        bytes = rest;
    }
    parts
}

/// Counts as bytes.
fn numbers(counts: &[usize]) -> Vec<u8> {
    counts.iter().flat_map(|&n| (n as u64).to_le_bytes()).collect()
}

/// The counts of [`numbers`].
fn numbers_of(bytes: &[u8]) -> Vec<usize> {
    let (counts, _) = bytes.as_chunks::<8>();
    counts.iter().map(|&count| usize::try_from(u64::from_le_bytes(count)).unwrap_or(usize::MAX)).collect()
}

#[cfg(test)]
mod tests {
    use super::share_of;

    #[test]
    fn shares_are_equal_and_complete() {
        for (total, count) in [(8, 3), (600, 7), (4096, 1024), (5, 5), (2, 3)] {
            let shares: Vec<_> = (0..count).map(|rank| share_of(total, rank, count)).collect();
            assert_eq!((shares[0].start, shares[count - 1].end), (0, total));
            assert!(shares.windows(2).all(|pair| pair[0].end == pair[1].start), "{shares:?}");
            let lengths = shares.iter().map(|share| share.len());
            assert!(lengths.clone().max().unwrap_or(0) - lengths.min().unwrap_or(0) <= 1, "{shares:?}");
        }
    }
}
