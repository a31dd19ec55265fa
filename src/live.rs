//! Live pages: a scene as browsers march it, and its volume packed for a page or a widget (docs/theory/live.md).

use std::fmt;
use std::sync::Arc;

use crate::number::{count, whole};
use crate::output::page::{Live, Numbers, PackedLive, PageError};
use crate::plan::{PlanError, Planned, plan};
use crate::progress::Progress;
use crate::render::{BrowserMarch, RenderError, Renderer, Uploaded};
use crate::scene::{Coarse, Field, Scene};
use crate::tables::NumberStorage;
use crate::volume::{VolumeError, VoxelType};

/// Most bytes of a texture of voxels with four numbers in a texel, and with one: 2²⁴ and 2²⁷ voxels of numbers that 16-bit floats hold.
const MOST_BYTES: [usize; 2] = [1 << 27, 1 << 28];
/// Bytes of a texel of four 32-bit floats.
const LARGEST_TEXEL: usize = 16;
/// Most voxels along an axis, on every device with WebGPU.
const LONGEST_AXIS: usize = 2048;

/// Reason why a scene was not packed.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// Volumes on grids of their own leave too little room for the first one, whose level can be coarser.
    #[error(
        "volumes on grids of their own, one behind the other, need {}×{}×{} texels of {bytes} bytes, and a page has room for {most} texels of them, and {LONGEST_AXIS} along an axis; crop or coarsen their files, or leave some out",
        dims[0], dims[1], dims[2]
    )]
    TooLarge {
        /// Texels along each axis.
        dims: [usize; 3],
        /// Bytes of a texel.
        bytes: usize,
        /// Texels that there may be.
        most: usize,
    },
    /// The scene cannot be planned.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// Browsers do not march it, or its light was not found.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// No coarse level was made.
    #[error(transparent)]
    Volume(#[from] VolumeError),
    /// Nothing was packed.
    #[error(transparent)]
    Page(#[from] PageError),
}

impl LiveError {
    /// Name for programs; it does not change between versions.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::TooLarge { .. } => "page-volume-too-large",
            Self::Plan(error) => error.code(),
            Self::Render(error) => error.code(),
            Self::Volume(error) => error.code(),
            Self::Page(error) => error.code(),
        }
    }
}

/// Difference of a live page from a render, or what its maker should know of it. [`fmt::Display`] says it in a sentence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LiveNote {
    /// The voxels show a body.
    Body,
    /// Fewer rays a pixel.
    Rays {
        /// Rays of a pixel of the scene.
        rays: usize,
    },
    /// The voxels themselves, where the scene allows means of them.
    Voxels {
        /// Pixels of a voxel of the level that the scene allows.
        pixels: f64,
    },
    /// Means of blocks in place of voxels.
    Means {
        /// Voxels of a block along each axis.
        block: [usize; 3],
        /// Blocks along each axis.
        dims: [usize; 3],
        /// Blocks that there may be.
        most: usize,
    },
    /// Values are rounded.
    Rounded {
        /// Largest change of a value.
        loss: f64,
    },
    /// No voxel is left out.
    Whole,
    /// Voxels of which nothing is seen have no values.
    Blanked {
        /// Their part in percent.
        percent: f64,
    },
}

impl LiveNote {
    /// True if the page is less exact than a render, or tells more than its maker may wish.
    #[must_use]
    pub fn is_warning(&self) -> bool {
        matches!(self, Self::Body | Self::Means { .. } | Self::Rounded { .. })
    }
}

impl fmt::Display for LiveNote {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Body => out.write_str(
                "a live page holds the voxels of a body, and of a head the face: send it only where the person agrees; a crop box leaves out what is beyond it",
            ),
            Self::Rays { rays } => write!(out, "a live page marches one ray a pixel, not {rays}"),
            Self::Voxels { pixels } => write!(
                out,
                "a live page holds no level of its volume for accuracy.voxel_pixels = {pixels}, as a reader comes nearer"
            ),
            Self::Means { block: [a, b, c], dims: [x, y, z], most } => write!(
                out,
                "the page holds means of blocks of {a}×{b}×{c} voxels, {x}×{y}×{z} in all: devices of readers hold {most} of them, and {LONGEST_AXIS} along an axis"
            ),
            Self::Rounded { loss } => {
                write!(out, "values are kept with 12 bits: they are rounded by up to {loss:.2e}")
            }
            Self::Whole => out.write_str(
                "all voxels in the crop box are in the page, seen or not: with labels, several channels, extremes or segments, none are left out",
            ),
            Self::Blanked { percent } => {
                write!(out, "values of {percent:.0} % of the voxels are left out, of which nothing is seen")
            }
        }
    }
}

/// A scene as a live page marches it.
#[derive(Clone, Debug)]
pub struct ForReaders {
    /// The scene: of one ray a pixel, and of means of blocks of too many voxels.
    pub scene: Scene,
    /// Voxels of the volume whose mean is one of the scene, along each axis.
    pub block: [usize; 3],
    /// How it differs from the scene that was given.
    pub notes: Vec<LiveNote>,
}

impl ForReaders {
    /// `scene` for a page with pictures of `size`.
    ///
    /// # Errors
    ///
    /// [`LiveError`].
    pub fn new(scene: &Scene, size: [usize; 2], progress: &dyn Progress) -> Result<Self, LiveError> {
        let (mut scene, mut notes) = (scene.clone(), Vec::new());
        if scene.frame.anatomical {
            notes.push(LiveNote::Body);
        }
        if scene.accuracy.rays > 1 {
            notes.push(LiveNote::Rays { rays: scene.accuracy.rays });
            scene.accuracy.rays = 1;
        }
        if scene.accuracy.voxel_pixels > 0.0 {
            notes.push(LiveNote::Voxels { pixels: scene.accuracy.voxel_pixels });
            scene.accuracy.voxel_pixels = 0.0;
        }
        let dims = scene.frame.geometry.dims;
        let along = |axis: usize| scene.fields.beside().iter().map(move |field| field.volume.geometry.dims[axis]);
        let of_beside = [along(0).max().unwrap_or(0), along(1).max().unwrap_or(0), along(2).sum()];
        let fits = |dims: [usize; 3], most: usize| voxels(dims) <= most && dims.iter().all(|&n| n <= LONGEST_AXIS);
        // Only what may be too large is planned for it.
        let surely = MOST_BYTES[0] / (2 * LARGEST_TEXEL);
        let (mut level, mut held) = (0, surely);
        if !(fits(dims, surely) && fits(of_beside, surely)) {
            let plan = plan(&scene, progress)?.plan;
            let first = || std::iter::once(scene.fields.first()).chain(scene.fields.sharing());
            let (bytes, of_first) = room(first(), plan.stores_gradient() || plan.groups.sharing > 0);
            let (beside_bytes, beside_room) = room(scene.fields.beside().iter(), plan.stores_placed_gradients());
            let most = beside_room / 2 / beside_bytes;
            if !fits(of_beside, most) {
                return Err(LiveError::TooLarge { dims: of_beside, bytes: beside_bytes, most });
            }
            let left = 1.0 - count(voxels(of_beside) * beside_bytes) / count(beside_room);
            let most = whole(left * count(of_first / bytes));
            let halved = |level: u32| dims.map(|n| n.div_ceil(1 << level));
            level = (0..16).find(|&level| fits(halved(level), most)).unwrap_or(16);
            held = most;
        }
        if level == 0 {
            return Ok(Self { scene, block: [1; 3], notes });
        }
        let mut fewer = Coarse::of_level(&scene, level, progress)?.scene_in(&scene, size);
        fewer.fields = scene.fields.at_level(Arc::clone(&fewer.fields.first().volume), level, progress)?;
        let block = scene.volume().block_of(fewer.volume());
        notes.push(LiveNote::Means { block, dims: fewer.frame.geometry.dims, most: held });
        Ok(Self { scene: fewer, block, notes })
    }
}

/// Voxels of a grid.
fn voxels(dims: [usize; 3]) -> usize {
    dims.iter().fold(1, |all, &n| all.saturating_mul(n))
}

/// Bytes of a texel of these fields, and of the largest texture of such texels.
fn room<'a>(mut fields: impl Iterator<Item = &'a Field>, has_four: bool) -> (usize, usize) {
    let is_narrow = |field: &Field| matches!(field.volume.voxels.voxel_type(), VoxelType::U8 | VoxelType::I8);
    let bytes = if fields.all(is_narrow) { 2 } else { 4 };
    if has_four { (4 * bytes, MOST_BYTES[0]) } else { (bytes, MOST_BYTES[1]) }
}

/// Packs the `uploaded` volume of `scene`, whose voxels are means of `block`s, and what a browser needs to march it in pictures of `size`, with
/// the light that `renderer` finds for it.
///
/// # Errors
///
/// [`LiveError`]; [`RenderError::Browser`] names what browsers do not march.
pub fn packed(
    renderer: &Renderer,
    (scene, planned): (&Scene, &Planned),
    uploaded: &Uploaded,
    size: [usize; 2],
    block: [usize; 3],
) -> Result<(PackedLive, Vec<LiveNote>), LiveError> {
    let march = BrowserMarch::new(renderer, scene, planned, uploaded, size)?;
    let numbers = march.fields.iter().map(|field| Numbers {
        numbers: &field.numbers,
        largest: field.storage.largest,
        shift: field.storage.shift,
        is_half: field.storage.is_half,
        dims: field.dims,
        is_placed: field.is_placed,
    });
    let live = Live {
        scene,
        planned,
        size,
        shader: &march.shader.text,
        resources: march.resources(),
        group: march.group,
        block,
        buffers: &march.buffers,
        fields: numbers.collect(),
        labels: march.labels.as_ref().map(|(texels, bytes)| (&texels[..], *bytes)),
        grids: march.grids.iter().map(|grid| (grid.name, grid.dims, grid.numbers, &grid.texels[..])).collect(),
    };
    let packed = live.packed()?;
    let mut notes = Vec::new();
    let loss = march.fields.iter().map(|field| field.storage.storage.loss).fold(0.0, f64::max);
    if loss > 0.0 {
        notes.push(LiveNote::Rounded { loss });
    }
    let percent = 100.0 * count(march.blanked) / count(scene.volume().voxels.len());
    if !NumberStorage::blanks(&planned.plan) {
        notes.push(LiveNote::Whole);
    } else if percent >= 0.5 {
        notes.push(LiveNote::Blanked { percent });
    }
    Ok((packed, notes))
}
