//! Processes that an MPI launcher has started.

use std::collections::VecDeque;
use std::time::Duration;

use mpi::environment::Universe;
use mpi::topology::SimpleCommunicator;
use mpi::traits::{Communicator, Destination, Equivalence, Source};

use super::Ranks;

/// Largest number of bytes of one MPI message; one of several ends with a shorter one. MPI moves bytes while a process asks for
/// messages, which it does without pauses while some arrive: pieces of 1 GiB took 30 times as long as these.
const MOST_BYTES: usize = 1 << 18;

/// Exit code after a panic, as Rust has it.
const PANICKED: i32 = 101;

/// Longest pause before the next look for messages. A process that waits without pauses takes a core from one that marches.
const LONGEST_PAUSE: Duration = Duration::from_millis(1);

/// The processes of `MPI_COMM_WORLD`.
#[expect(missing_debug_implementations, reason = "MPI's handles say nothing")]
pub struct Mpi {
    world: SimpleCommunicator,
    // MPI ends when this is dropped.
    _universe: Universe,
}

impl Mpi {
    /// Starts MPI; `None` if it was started before.
    #[must_use]
    pub fn start() -> Option<Self> {
        // Only the main thread speaks MPI.
        let (universe, _) = mpi::initialize_with_threading(mpi::Threading::Funneled)?;
        Some(Self { world: universe.world(), _universe: universe })
    }

    fn process(&self, rank: usize) -> mpi::topology::Process<'_> {
        self.world.process_at_rank(i32::try_from(rank).unwrap_or(i32::MAX))
    }
}

impl Drop for Mpi {
    fn drop(&mut self) {
        // After a panic the others would wait for this process, and it for them.
        if std::thread::panicking() {
            self.world.abort(PANICKED);
        }
    }
}

/// A message in pieces, of which the last is shorter than all others.
fn pieces(message: &[u8]) -> impl Iterator<Item = &[u8]> {
    let whole = message.len() / MOST_BYTES + 1;
    (0..whole).map(|piece| &message[piece * MOST_BYTES..message.len().min((piece + 1) * MOST_BYTES)])
}

impl Ranks for Mpi {
    fn rank(&self) -> usize {
        usize::try_from(self.world.rank()).unwrap_or(0)
    }

    fn count(&self) -> usize {
        usize::try_from(self.world.size()).unwrap_or(1)
    }

    fn exchange_into(&self, outgoing: &[(usize, &[u8])], from: &[usize], received: &mut Vec<Vec<u8>>) {
        received.resize(from.len(), Vec::new());
        let mut lengths = vec![0; from.len()];
        mpi::request::scope(|scope| {
            let mut sends: Vec<VecDeque<_>> = Vec::new();
            for &(rank, message) in outgoing {
                let send = |piece| self.process(rank).immediate_send(scope, piece);
                sends.push(pieces(message).map(send).collect());
            }
            let mut waiting: Vec<usize> = (0..from.len()).collect();
            let mut pause = Duration::from_micros(1);
            while !(sends.is_empty() && waiting.is_empty()) {
                let mut is_moving = false;
                for pieces in &mut sends {
                    // Pieces to one process are sent in their order.
                    while let Some(piece) = pieces.pop_front() {
                        if let Err(piece) = piece.test() {
                            pieces.push_front(piece);
                            break;
                        }
                        is_moving = true;
                    }
                }
                sends.retain(|pieces| !pieces.is_empty());
                waiting.retain(|&at| {
                    let Some((piece, status)) = self.process(from[at]).immediate_matched_probe() else { return true };
                    let length = usize::try_from(status.count(u8::equivalent_datatype())).unwrap_or(0);
                    let (message, before) = (&mut received[at], lengths[at]);
                    lengths[at] += length;
                    if message.len() < lengths[at] {
                        message.resize(lengths[at], 0);
                    }
                    piece.matched_receive_into(&mut message[before..lengths[at]]);
                    is_moving = true;
                    length == MOST_BYTES
                });
                if is_moving {
                    pause = Duration::from_micros(1);
                } else {
                    std::thread::sleep(pause);
                    pause = (2 * pause).min(LONGEST_PAUSE);
                }
            }
        });
        received.iter_mut().zip(lengths).for_each(|(message, length)| message.truncate(length));
    }

    fn abort(&self, code: u8) -> ! {
        self.world.abort(code.into())
    }
}
