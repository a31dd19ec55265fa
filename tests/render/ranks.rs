//! Messages between processes, here threads: rectangles that composite, and tiles that go from block to block.

use std::convert::Infallible;
use std::ops::Range;
use std::sync::Mutex;
use std::sync::mpsc::{Receiver, Sender, channel};

use relume::film::{Film, composited};
use relume::ranks::{Ranks, Relay, all_gather, gather_rows, over, tiles};
use relume::scene::Node;

/// Threads as ranks: from each to each a channel.
struct Threads {
    rank: usize,
    to: Vec<Sender<Vec<u8>>>,
    from: Vec<Mutex<Receiver<Vec<u8>>>>,
}

impl Ranks for Threads {
    fn rank(&self) -> usize {
        self.rank
    }

    fn count(&self) -> usize {
        self.to.len()
    }

    fn exchange_into(&self, outgoing: &[(usize, &[u8])], from: &[usize], received: &mut Vec<Vec<u8>>) {
        for (rank, message) in outgoing {
            assert_ne!(*rank, self.rank, "a message to itself");
            self.to[*rank].send(message.to_vec()).unwrap();
        }
        *received = from.iter().map(|&rank| self.from[rank].lock().unwrap().recv().unwrap()).collect();
    }

    fn abort(&self, code: u8) -> ! {
        panic!("rank {} ends with {code}", self.rank)
    }
}

/// Runs `work` on `count` ranks; returns what each returns.
fn on_ranks<T: Send>(count: usize, work: impl Fn(&dyn Ranks) -> T + Sync) -> Vec<T> {
    let mut ranks: Vec<Threads> = (0..count).map(|rank| Threads { rank, to: Vec::new(), from: Vec::new() }).collect();
    for from in 0..count {
        for to in 0..count {
            let (sender, receiver) = channel();
            ranks[from].to.push(sender);
            ranks[to].from.push(Mutex::new(receiver));
        }
    }
    std::thread::scope(|scope| {
        let work = &work;
        let running: Vec<_> = ranks.into_iter().map(|ranks| scope.spawn(move || work(&ranks))).collect();
        running.into_iter().map(|thread| thread.join().unwrap()).collect()
    })
}

/// Numbers from 0 to 1, the same ones for the same seed.
fn noise(seed: usize) -> f32 {
    let mut bits = u32::try_from(seed % (1 << 31)).unwrap().wrapping_mul(0x9e37_79b9) ^ 0x85eb_ca6b;
    for _ in 0..3 {
        bits ^= bits >> 15;
        bits = bits.wrapping_mul(0x2c1b_3c6d);
    }
    f32::from(u16::try_from(bits >> 16).unwrap()) / 65536.0
}

const WIDTH: usize = 13;
const HEIGHT: usize = 11;

/// A film of two positions with three components that meets a rectangle only; leaf 5 meets nothing.
fn leaf(index: usize, coloured: bool) -> Film<f32> {
    let pixels = WIDTH * HEIGHT;
    let through = if coloured { 3 } else { 1 };
    let (x, y) = (index % 4 * 2, index / 2 % 5);
    let is_met =
        |pixel: usize| index != 5 && (x..x + 6).contains(&(pixel % WIDTH)) && (y..y + 5).contains(&(pixel / WIDTH));
    let plane = |first: usize, nothing: f32, sign: f32| {
        (0..pixels).map(move |pixel| match is_met(pixel) {
            true => sign * noise(1000 * index + 97 * first + pixel),
            false => nothing,
        })
    };
    Film {
        size: [WIDTH, HEIGHT],
        components: 3,
        // Negative coefficients too.
        accumulators: (0..6).flat_map(|n| plane(n, 0.0, if n == 4 { -1.0 } else { 1.0 })).collect(),
        transmittance: (6..6 + through).flat_map(|n| plane(n, 1.0, 1.0)).collect(),
    }
}

/// `film` with each pixel `times` times along its row.
fn widened(film: &Film<f32>, times: usize) -> Film<f32> {
    let widened = |numbers: &[f32]| numbers.iter().flat_map(|&number| std::iter::repeat_n(number, times)).collect();
    let size = [times * film.size[0], film.size[1]];
    let (accumulators, transmittance) = (widened(&film.accumulators), widened(&film.transmittance));
    Film { size, components: film.components, accumulators, transmittance }
}

#[test]
fn rectangles_composite_to_the_film_of_the_tree_for_any_number_of_processes() {
    let low_first = [true, false, true, false, true, true, false];
    // Processes exchange all rows of the narrow pictures at once, and each row of the wide one by itself.
    for (coloured, times) in [(false, 1), (true, 1), (true, 600)] {
        let leaf = |index: usize| widened(&leaf(index, coloured), times);
        let whole = composited::<Infallible>(Node::top(8), &low_first, &mut |node| {
            Ok(node.sides().is_none().then(|| leaf(node.leaves[0] - 1)))
        });
        let whole = whole.unwrap().unwrap();
        for count in [1, 2, 3, 4, 5, 8] {
            let shares = on_ranks(count, |ranks| {
                over::<Infallible>(ranks, 8, &low_first, &mut |index| Ok(leaf(index))).unwrap().unwrap()
            });
            let mut film = whole.map(|_| f32::NAN);
            for share in &shares {
                film.put([0, share.rows.start], &share.film);
            }
            assert!(film == whole, "{count} processes");
            // The largest rectangle has 30 of 143 pixels; dense, every process would send all pixels but its own.
            let sent: usize = shares.iter().map(|share| share.sent_bytes).sum();
            let numbers = if coloured { 9 } else { 7 };
            assert!(sent <= times * 8 * 30 * 4 * numbers, "{sent} bytes by {count} processes");
            assert_eq!(sent == 0, count == 1, "{sent} bytes by {count} processes");
        }
    }
}

/// Goes on with a tile: each rank adds its own light, dimmed by what is in front.
fn add(rank: usize, tile: &Range<usize>, before: Option<&Film<f32>>) -> Film<f32> {
    let cut = |film: &Film<f32>| film.cut_out([[0, tile.start], [WIDTH, tile.end]]);
    let own = cut(&leaf(rank, true));
    before.map_or_else(|| own.clone(), |before| before.clone().over(&own).unwrap())
}

#[test]
fn tiles_go_from_process_to_process_along_the_rays() {
    let order = vec![3, 0, 4, 1, 2];
    let rows: Vec<Range<usize>> = [0..7, 2..11, 5..6, 0..4, 4..9].into();
    let relay = Relay { order, rows, width: WIDTH, components: 3, numbers: [6, 3] };
    for tiles in [tiles(HEIGHT, 1, 5), tiles(HEIGHT, 8, 5), tiles(HEIGHT, HEIGHT, 1)] {
        let mut expected = leaf(0, true).map(|_| f32::NAN);
        for tile in &tiles {
            let chain = relay.chain(tile);
            assert!(chain.is_sorted_by_key(|rank| relay.order.iter().position(|other| other == rank)), "{chain:?}");
            let film = chain.iter().fold(None, |film, &rank| Some(add(rank, tile, film.as_ref())));
            expected.put([0, tile.start], &film.unwrap());
        }
        let ended = on_ranks(5, |ranks| {
            let mut film = leaf(0, true).map(|_| f32::NAN);
            let run = relay.run(ranks, &tiles, |tile, before| -> Result<_, Infallible> {
                let after = add(ranks.rank(), tile, before);
                film.put([0, tile.start], &after);
                Ok(after)
            });
            let (ended, sent) = run.unwrap();
            assert!(sent > 0 || ranks.rank() == 2, "rank {} sends nothing", ranks.rank());
            let cut = |tile: Range<usize>| (tile.start, film.cut_out([[0, tile.start], [WIDTH, tile.end]]));
            ended.into_iter().map(cut).collect::<Vec<_>>()
        });
        let mut film = leaf(0, true).map(|_| f32::NAN);
        for (start, part) in ended.into_iter().flatten() {
            film.put([0, start], &part);
        }
        assert!(film == expected, "{tiles:?}");
    }
    // A tile that no block covers has one process all the same.
    let relay = Relay { rows: vec![0..1; 5], ..relay };
    assert_eq!(relay.chain(&(4..8)), [3]);
}

#[test]
fn every_process_hears_of_all_and_the_first_has_all_rows() {
    for count in 1..=9 {
        let message = |rank: usize| vec![u8::try_from(rank).unwrap(); rank % 4];
        let heard = on_ranks(count, |ranks| all_gather(ranks, message(ranks.rank())));
        let expected: Vec<Vec<u8>> = (0..count).map(message).collect();
        assert!(heard.iter().all(|heard| *heard == expected), "{count}: {heard:?}");
        let rows = on_ranks(count, |ranks| {
            let rank = ranks.rank();
            gather_rows(ranks, vec![(2 * rank..2 * rank + 1, message(rank)), (2 * rank + 1..2 * rank + 2, vec![7])])
        });
        let all = |rank: usize| [(2 * rank..2 * rank + 1, message(rank)), (2 * rank + 1..2 * rank + 2, vec![7])];
        assert_eq!(rows[0], (0..count).flat_map(all).collect::<Vec<_>>(), "{count}");
        assert!(rows[1..].iter().all(Vec::is_empty), "{count}");
    }
}
