//! Parts of a film: the blocks that they hold, and their composite by a tree that the number of blocks determines.

use std::collections::hash_map::DefaultHasher;
use std::hash::{Hash, Hasher};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::FilmFile;
use crate::output::OutputError;
use relume_base::number::count;
use relume_base::progress::Progress;
use relume_scene::film::composited;
use relume_scene::{Blocks, MOST_BLOCKS, Node, Scene};

/// The blocks of a volume in a film, and what parts must share to composite.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FilmPart {
    /// Number of blocks of the volume.
    pub blocks: usize,
    /// First block of the film, from 1.
    pub first: usize,
    /// Last block of the film.
    pub last: usize,
    /// A letter for each cut of the tree, in preorder: `l` if its low side is in front, `h` otherwise.
    pub order: String,
    /// Version of the program.
    pub program: String,
    /// Digest of the scene.
    pub scene: String,
    /// Digest of its camera.
    pub camera: String,
}

/// A composite of parts.
#[derive(Clone, Debug)]
pub struct Composited {
    /// The film: whole, or a part of more blocks.
    pub film: FilmFile,
    /// Numbers of its first and last block, and the number of blocks.
    pub blocks: [usize; 3],
}

impl FilmPart {
    /// The part that the block of `scene` is in a picture of `size`. `None` without a block, if the block is the
    /// whole volume, or if the scene has no such block or no view.
    #[must_use]
    pub fn of_scene(scene: &Scene, size: [usize; 2]) -> Option<Self> {
        let block = scene.block.filter(|block| block.count > 1)?;
        let aspect = count(size[0]) / count(size[1]);
        let geometry = &scene.frame.geometry;
        let view = scene.camera.view(geometry, aspect)?;
        let front = Blocks::new(geometry, block.count)?.low_first(geometry, &view);
        let mut hasher = DefaultHasher::new();
        format!("{:?}", scene.camera).hash(&mut hasher);
        Some(Self {
            blocks: block.count,
            first: block.index + 1,
            last: block.index + 1,
            order: front.into_iter().map(|is_low| if is_low { 'l' } else { 'h' }).collect(),
            program: env!("CARGO_PKG_VERSION").to_owned(),
            scene: format!("{:016x}", Scene { block: None, ..scene.clone() }.digest()),
            camera: format!("{:016x}", hasher.finish()),
        })
    }

    /// `block 3 of 8`, or `blocks 3 to 4 of 8`.
    #[must_use]
    pub fn named(&self) -> String {
        let Self { blocks, first, last, .. } = *self;
        let noun = if first == last { "block" } else { "blocks" };
        format!("{noun} {} of {blocks}", range([first, last]))
    }

    /// Refuses numbers that no tree has.
    pub(super) fn check(&self) -> Result<(), String> {
        let Self { blocks, first, last, order, .. } = self;
        if !(2..=MOST_BLOCKS).contains(blocks) {
            return Err(format!("[part]: blocks = {blocks} should be 2 to {MOST_BLOCKS}"));
        }
        if !(1..=*blocks).contains(first) || !(*first..=*blocks).contains(last) {
            return Err(format!("[part]: first = {first} and last = {last} should be blocks from 1 to {blocks}"));
        }
        if *first == 1 && last == blocks {
            return Err(format!("[part]: the blocks 1 to {blocks} are all, which is no part"));
        }
        if Node::smallest(*blocks, [*first, *last]).leaves != [*first, *last] {
            return Err(format!("[part]: the blocks {first} to {last} are not a node of the tree of {blocks}"));
        }
        if order.len() != blocks - 1 || !order.chars().all(|letter| "lh".contains(letter)) {
            return Err(format!("[part]: order should be {} letters l or h", blocks - 1));
        }
        Ok(())
    }
}

/// `3` or `3 to 5`.
fn range([first, last]: [usize; 2]) -> String {
    if first == last { first.to_string() } else { format!("{first} to {last}") }
}

/// `block 3 of 8 is` or `blocks 2, 5 to 8 of 8 are`.
pub(in crate::output) fn blocks_are(ranges: &[[usize; 2]], of: usize) -> String {
    let is_one = matches!(ranges, [[first, last]] if first == last);
    let listed = ranges.iter().copied().map(range).collect::<Vec<_>>().join(", ");
    if is_one { format!("block {listed} of {of} is") } else { format!("blocks {listed} of {of} are") }
}

/// A part that is known, without its pixels.
struct Known<'a> {
    path: &'a Path,
    part: FilmPart,
    header: FilmFile,
    /// Bytes of its pixels.
    bytes: u64,
}

/// Reads the part at `path`.
fn part_at(path: &Path) -> Result<(FilmPart, FilmFile), OutputError> {
    let mut film = FilmFile::read(path)?;
    match film.part.take() {
        Some(part) => Ok((part, film)),
        None => Err(refused(path, "this film is whole, not a part")),
    }
}

fn refused(path: &Path, detail: impl Into<String>) -> OutputError {
    OutputError::Parts { path: path.to_owned(), detail: detail.into() }
}

/// Refuses a part that does not belong to `first`.
fn check_same(first: &Known<'_>, other: &Known<'_>) -> Result<(), OutputError> {
    let of = first.path.display();
    let differs = |what: String| Err(refused(other.path, format!("{what}; render all parts alike")));
    let (one, two) = (&first.part, &other.part);
    let [size, expected] = [other, first].map(|it| [it.header.width, it.header.height]);
    if one.program != two.program {
        differs(format!("version {} of Relume made this part, and version {} made {of}", two.program, one.program))
    } else if one.blocks != two.blocks {
        differs(format!("this is a part of {} blocks, and {of} is one of {}", two.blocks, one.blocks))
    } else if size != expected {
        let ([width, height], [w, h]) = (size, expected);
        differs(format!("this part has {width}×{height} pixels, and {of} has {w}×{h}"))
    } else if one.camera != two.camera || one.order != two.order {
        differs(format!("the camera differs from that of {of}"))
    } else if one.scene != two.scene {
        differs(format!("scene {} differs from {}, that of {of}", two.scene, one.scene))
    } else if first.header != other.header {
        differs(format!("lights, materials or colour model differ from those of {of}"))
    } else {
        Ok(())
    }
}

/// Composites the parts at `paths`, in any order. They must hold all blocks of the volume, each once; with `as_part`, all of a
/// node of the tree, for a larger part.
///
/// The operations and their order follow from the tree alone, so the film is the same to the bit for any order and
/// grouping of the parts. Of the pixels, one film a level of the tree is in memory; each file is read twice.
///
/// `available_bytes` is the memory for pixels, if it is known.
///
/// # Errors
///
/// [`OutputError::Missing`] if a block is missing; [`OutputError::Parts`] if one is doubled, or parts differ in version, number of blocks, size, camera,
/// scene or lights, or if they exceed the memory; [`OutputError::Cancelled`]; and those of [`FilmFile::read`].
pub fn composite(
    paths: &[PathBuf],
    as_part: bool,
    available_bytes: Option<u64>,
    progress: &dyn Progress,
) -> Result<Composited, OutputError> {
    let total = paths.len() as u64;
    let mut known: Vec<Known<'_>> = Vec::new();
    for (done, path) in (0_u64..).zip(paths) {
        progress.report("checking parts", done, total);
        if progress.cancelled() {
            return Err(OutputError::Cancelled { path: path.clone() });
        }
        let (part, film) = part_at(path)?;
        let bytes = 4 * (film.accumulators.len() + film.transmittance.len()) as u64;
        let header = FilmFile { accumulators: Vec::new(), transmittance: Vec::new(), ..film };
        let this = Known { path, part, header, bytes };
        if let Some(first) = known.first() {
            check_same(first, &this)?;
        }
        known.push(this);
    }
    known.sort_by_key(|it| (it.part.first, it.part.last));
    let Some((front, back)) = known.first().zip(known.last()) else {
        return Err(refused(Path::new(""), "there are no parts"));
    };
    let blocks = front.part.blocks;
    let node = Node::smallest(blocks, if as_part { [front.part.first, back.part.last] } else { [1, blocks] });
    let mut missing = Vec::new();
    let mut next = node.leaves[0];
    for (at, it) in known.iter().enumerate() {
        if it.part.first < next {
            let before = known[at - 1].path.display();
            let doubled = range([it.part.first, it.part.last.min(next - 1)]);
            return Err(refused(it.path, format!("block {doubled} of {blocks} is also in {before}; leave one out")));
        }
        if it.part.first > next {
            missing.push([next, it.part.first - 1]);
        }
        next = it.part.last + 1;
    }
    if next <= node.leaves[1] {
        missing.push([next, node.leaves[1]]);
    }
    if !missing.is_empty() {
        let there = [front.part.first, back.part.last];
        let are_outside = missing.iter().all(|gap| gap[1] < there[0] || gap[0] > there[1]);
        let is_part = !as_part && are_outside && Node::smallest(blocks, there).leaves == there;
        return Err(OutputError::Missing { path: front.path.to_owned(), missing, blocks, is_part });
    }
    // The front of each level, and the back, their composite and the lines of a file.
    let levels = u64::from(usize::BITS - (blocks - 1).leading_zeros()).min(total);
    let needed = front.bytes.saturating_mul(levels + 3);
    if let Some(available) = available_bytes.filter(|&available| needed > available) {
        return Err(refused(
            front.path,
            format!(
                "to composite {total} parts of this size needs {needed} bytes of memory, and {available} are free; \
                 composite fewer blocks at once or a smaller picture"
            ),
        ));
    }
    let mut done = 0;
    let low_first: Vec<bool> = front.part.order.bytes().map(|letter| letter == b'l').collect();
    let film = composited(node, &low_first, &mut |node| {
        let Some(it) = known.iter().find(|it| [it.part.first, it.part.last] == node.leaves) else { return Ok(None) };
        progress.report("compositing parts", done, total);
        done += 1;
        if progress.cancelled() {
            return Err(OutputError::Cancelled { path: it.path.to_owned() });
        }
        let (part, mut film) = part_at(it.path)?;
        let taken = film.take_film();
        if part != it.part || film != it.header {
            return Err(refused(it.path, "another program changed this part while it was read; composite again"));
        }
        Ok(Some(taken))
    })?;
    let film = film.ok_or_else(|| refused(front.path, "the channels differ from those of the other parts"))?;
    let [first, last] = node.leaves;
    let part = (last + 1 - first < blocks).then(|| FilmPart { first, last, ..front.part.clone() });
    let header = front.header.clone();
    let mut header = FilmFile { part, ..header };
    if header.part.is_none() {
        header.expose(&film)?;
    }
    let film = FilmFile { accumulators: film.accumulators, transmittance: film.transmittance, ..header };
    Ok(Composited { film, blocks: [first, last, blocks] })
}
