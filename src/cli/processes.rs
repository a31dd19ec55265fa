//! `relume render` by several processes, which `mpirun` or another MPI launcher has started.

use std::cell::Cell;
use std::fmt;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::ops::Range;

use serde_json::json;

use crate::film::{Film, RelightMatrices, automatic_exposure};
use crate::measure::{Stopwatch, Timing};
use crate::number::count;
use crate::output::OutputError;
use crate::plan::{Planned, Transmittance};
use crate::progress::Progress;
use crate::ranks::{Alone, Ranks, Relay, all_gather, gather_rows, over, share_of, tiles};
use crate::render::{BrickCounts, DeviceFilm, March, RenderError, SceneRenderer};
use crate::scene::{Block, Blocks, Mix, Node, Scene, View};

use super::CliError;

/// Division of one march among processes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Sharing {
    /// The film goes from block to block along the rays: that of one process, to the byte.
    Relay,
    /// All blocks at once, composited: one film for any number of processes. The number of blocks, if it is stated.
    Over(Option<usize>),
    /// Each process renders by itself.
    Off,
}

/// Reads `relay`, `over`, `over/N` or `off`.
pub(crate) fn sharing(text: &str) -> Result<Sharing, String> {
    let blocks = |number: &str| number.parse().ok().filter(|&blocks| blocks > 0);
    match text.split_once('/') {
        None if text == "relay" => Ok(Sharing::Relay),
        None if text == "over" => Ok(Sharing::Over(None)),
        None if text == "off" => Ok(Sharing::Off),
        Some(("over", number)) if blocks(number).is_some() => Ok(Sharing::Over(blocks(number))),
        _ => Err("write relay, over, over/N with N blocks (such as over/64), or off".to_owned()),
    }
}

fn variable(name: &str) -> Option<usize> {
    std::env::var(name).ok().and_then(|text| text.parse().ok())
}

/// Number of processes of a step of Slurm.
fn of_slurm() -> Option<usize> {
    variable("SLURM_STEP_NUM_TASKS")
}

/// Number of processes that a launcher of MPI says it has started: Open MPI's, that of MPICH and Intel MPI, or Slurm's.
fn started() -> Option<usize> {
    let by_slurm = || std::env::var_os("PMIX_RANK").and_then(|_| of_slurm());
    variable("OMPI_COMM_WORLD_SIZE").or_else(|| variable("PMI_SIZE")).or_else(by_slurm)
}

/// The processes of this run.
pub(crate) struct Processes {
    ranks: Box<dyn Ranks>,
    sharing: Sharing,
    stage: Cell<Stage>,
}

/// Agreement of the processes.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Stage {
    /// Nothing yet.
    Preparing,
    /// All are ready to march the same picture.
    Ready,
    /// One is not, and all know it.
    Refused,
}

#[cfg(feature = "mpi")]
fn ranks() -> Result<Box<dyn Ranks>, CliError> {
    let mpi = crate::ranks::Mpi::start();
    Ok(Box::new(mpi.ok_or_else(|| CliError::Failed("MPI was started twice".to_owned()))?))
}

#[cfg(not(feature = "mpi"))]
fn ranks() -> Result<Box<dyn Ranks>, CliError> {
    Err(CliError::Usage(
        "several processes were started for one picture, and this build of Relume has no MPI; with --mpi off each renders by \
         itself; to share the work, build it with `cargo build --release --features mpi`, or take --part or --block"
            .to_owned(),
    ))
}

/// Status of a process before the march.
const READY: u8 = b'+';

impl Processes {
    /// The processes of this run: those of a launcher, or this one alone if `sharing` is stated. `None` if each process works
    /// by itself.
    pub(crate) fn start(sharing: Option<Sharing>, is_apart: bool) -> Result<Option<Self>, CliError> {
        if sharing == Some(Sharing::Off) || sharing.is_none() && is_apart {
            return Ok(None);
        }
        let told = started();
        if let (None, Some(count @ 2..)) = (told, of_slurm()) {
            if !cfg!(feature = "mpi") {
                ranks()?;
            }
            return Err(CliError::Usage(format!(
                "Slurm started {count} processes that do not know of each other; add srun --mpi=pmix to share the picture, or \
                 --mpi off, with which each renders all of it by itself, as in a shell that srun started"
            )));
        }
        let started = told.unwrap_or(1);
        let ranks: Box<dyn Ranks> = match (started, sharing) {
            (0 | 1, None) => return Ok(None),
            (0 | 1, Some(_)) => Box::new(Alone),
            _ => ranks()?,
        };
        if ranks.count() != started.max(1) {
            return Err(CliError::Failed(format!(
                "{started} processes were started, and MPI knows of {}; take the launcher of the MPI with which Relume was built",
                ranks.count()
            )));
        }
        Ok(Some(Self { ranks, sharing: sharing.unwrap_or(Sharing::Relay), stage: Cell::new(Stage::Preparing) }))
    }

    pub(crate) fn rank(&self) -> usize {
        self.ranks.rank()
    }

    /// True for the process that writes files and speaks.
    pub(crate) fn is_first(&self) -> bool {
        self.rank() == 0
    }

    pub(crate) fn count(&self) -> usize {
        self.ranks.count()
    }

    pub(crate) fn sharing(&self) -> Sharing {
        self.sharing
    }

    /// Blocks into which the volume of `scene` is cut.
    pub(crate) fn blocks(&self, scene: &Scene) -> usize {
        match self.sharing {
            Sharing::Relay | Sharing::Off => self.count(),
            Sharing::Over(blocks) => blocks.unwrap_or_else(|| Blocks::usual(&scene.frame.geometry)),
        }
    }

    /// Returns the blocks once all processes are ready to march. All must render the same, with shadows from means of
    /// `light_block` voxels.
    pub(crate) fn agree(
        &self,
        scene: &Scene,
        planned: &Planned,
        mix: &Mix,
        (size, light_block): ([usize; 2], Option<[usize; 3]>),
        asked: Asked,
    ) -> Result<Cut, CliError> {
        let mut hasher = DefaultHasher::new();
        format!("{:?} {:?} {mix:?} {size:?} {:?} {asked:?}", planned.plan, planned.positions, self.sharing)
            .hash(&mut hasher);
        // Senders and receivers of rows follow from them, and their last bits may differ between machines.
        let cut = self.cut(scene, size)?;
        let rows = |block: usize| cut.tree.rows(block, &scene.frame.geometry, &cut.view, size[1]);
        (&cut.low_first, (0..=cut.low_first.len()).map(rows).collect::<Vec<_>>()).hash(&mut hasher);
        let lights = planned.model.iter().flat_map(|model| model.lights());
        lights.for_each(|(name, _, matrix)| format!("{name} {matrix:?}").hash(&mut hasher));
        let [width, height] = size;
        let about = [
            format!("the version is {}", env!("CARGO_PKG_VERSION")),
            format!("the size is {width}×{height}"),
            format!("the outputs are {asked}"),
            format!("the scene is {:016x}", scene.digest()),
            format!("the shadows come from blocks of {:?} voxels", light_block.unwrap_or([1; 3])),
            format!("the plan is {:016x}", hasher.finish()),
        ];
        let mine = [&[READY], about.join("\n").as_bytes()].concat();
        let all = all_gather(&*self.ranks, mine);
        self.stage.set(Stage::Refused);
        if all.iter().any(|status| status.first() != Some(&READY)) {
            return Err(CliError::Elsewhere);
        }
        let text = |rank: usize| String::from_utf8_lossy(&all[rank][1..]).into_owned();
        match (1..all.len()).find(|&rank| all[rank] != all[0]) {
            None => {
                self.stage.set(Stage::Ready);
                Ok(cut)
            }
            Some(_) if !self.is_first() => Err(CliError::Elsewhere),
            Some(rank) => {
                // The plan differs along with everything else, and says the least.
                let (other, first) = (text(rank), text(0));
                let (other, first) =
                    other.lines().zip(first.lines()).find(|(other, first)| other != first).unwrap_or((&other, &first));
                Err(CliError::Failed(format!(
                    "rank {rank} of {} renders something else than rank 0: {other}, and at rank 0 {first}; give all processes the \
                     same files, the same arguments and the same build, or add --mpi off if each renders by itself",
                    self.count()
                )))
            }
        }
    }

    /// The error that this process tells, after all have heard of it if they were not ready yet: one process tells errors
    /// before the march, and each its own after it.
    pub(crate) fn told(&self, error: CliError) -> CliError {
        if self.stage.get() == Stage::Preparing {
            self.stage.set(Stage::Refused);
            let all = all_gather(&*self.ranks, Vec::new());
            let first = all.iter().position(|status| status.first() != Some(&READY));
            if first != Some(self.rank()) {
                return CliError::Elsewhere;
            }
        }
        match (self.rank(), error) {
            (0, error) | (_, error @ CliError::Elsewhere) => error,
            (rank, error) => CliError::OfRank { rank, count: self.count(), source: Box::new(error) },
        }
    }

    /// Ends all processes after an error of this one while they march: the others wait for it.
    pub(crate) fn end(&self, code: u8) {
        if self.count() > 1 && self.stage.get() == Stage::Ready {
            self.ranks.abort(code);
        }
    }
}

/// The picture, at the first process.
pub(crate) struct Picture {
    pub(crate) film: Option<Film<f32>>,
    /// Linear RGBA.
    pub(crate) linear: Option<Vec<f32>>,
    /// 8-bit sRGB RGBA.
    pub(crate) display: Option<Vec<u8>>,
    /// Exposure of the picture.
    pub(crate) exposure: Option<f64>,
    /// Marches, dispatches and occupied macrocells are those of this process.
    pub(crate) device: DeviceFilm,
    pub(crate) times: Vec<(&'static str, Timing)>,
    pub(crate) details: serde_json::Value,
}

/// Blocks of a volume, and the order in which a view meets them.
pub(crate) struct Cut {
    tree: Blocks,
    /// For each cut, true if the low side is in front.
    low_first: Vec<bool>,
    view: View,
}

/// Data that the outputs need.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Asked {
    pub(crate) film: bool,
    pub(crate) linear: bool,
    pub(crate) display: bool,
}

impl fmt::Display for Asked {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { film, linear, display } = *self;
        let all = [(film, "a film"), (linear, "linear pixels"), (display, "pixels of 8 bits")];
        let asked: Vec<&str> = all.into_iter().filter(|(asked, _)| *asked).map(|(_, name)| name).collect();
        formatter.write_str(&asked.join(" and "))
    }
}

impl Processes {
    /// Marches and relights a picture of `size` together with all other processes. Only the first has the result.
    pub(crate) fn render(
        &self,
        on_device: &SceneRenderer,
        (mix, opening): (&Mix, &Mix),
        (size, cut): ([usize; 2], &Cut),
        asked: Asked,
        progress: &dyn Progress,
    ) -> Result<Option<Picture>, CliError> {
        let clock = Stopwatch::start();
        let (film, rows, mut details) = match self.sharing {
            Sharing::Relay | Sharing::Off => self.relay(on_device, size, cut, progress)?,
            Sharing::Over(_) => self.over(on_device, size, cut, progress)?,
        };
        let march = clock.read();

        let clock = Stopwatch::start();
        let Own { device, stripe } = film;
        let (renderer, mut matrices) = (on_device.renderer(), on_device.matrices(mix));
        let width = size[0];
        let of_rows = |pixels: &[u8], bytes: usize| -> Vec<(Range<usize>, Vec<u8>)> {
            let part = |rows: &Range<usize>| &pixels[rows.start * width * bytes..rows.end * width * bytes];
            rows.iter().map(|rows| (rows.clone(), part(rows).to_vec())).collect()
        };
        let picture = |bytes: usize, parts: Vec<(Range<usize>, Vec<u8>)>| -> Option<Vec<u8>> {
            let mut whole = vec![0; width * size[1] * bytes];
            for (rows, part) in parts {
                whole[rows.start * width * bytes..][..part.len()].copy_from_slice(&part);
            }
            self.is_first().then_some(whole)
        };
        let linear_picture = |matrices: &RelightMatrices| -> Result<Option<Vec<f32>>, CliError> {
            let relight = renderer.relight_linear(&device)?;
            relight.run(matrices)?;
            let parts = of_rows(bytemuck::cast_slice(&relight.read::<f32>()?), 16);
            Ok(picture(16, gather_rows(&*self.ranks, parts)).map(|bytes| bytemuck::pod_collect_to_vec(&bytes)))
        };
        let mut exposure = on_device.scene().display.exposure;
        if exposure.is_none() {
            // The first process has the picture, and the others hear of its exposure.
            let found = linear_picture(&at_exposure(on_device, opening, None))?;
            let found = found.map(|rgba| automatic_exposure(&rgba, opening, &on_device.scene().display));
            let told = all_gather(&*self.ranks, found.map_or_else(Vec::new, |found| found.to_le_bytes().to_vec()));
            exposure = told.first().and_then(|bytes| Some(f64::from_le_bytes(bytes[..].try_into().ok()?)));
            matrices = at_exposure(on_device, mix, exposure);
        }
        let (mut display, mut linear, mut whole) = (None, None, None);
        if asked.display {
            let relight = renderer.relight_display_over(&device, matrices.backdrop)?;
            relight.run(&matrices)?;
            display = picture(4, gather_rows(&*self.ranks, of_rows(&relight.read()?, 4)));
        }
        if asked.linear {
            linear = linear_picture(&matrices)?;
        }
        if asked.film {
            let mut parts = Vec::new();
            for rows in &rows {
                let film = match &stripe {
                    Some(film) => film.clone(),
                    None => renderer.read_rows(&device, rows.clone())?,
                };
                let numbers = [&*film.accumulators, &*film.transmittance].concat();
                parts.push((rows.clone(), bytemuck::cast_slice(&numbers).to_vec()));
            }
            whole = self.film(on_device.planned(), size, gather_rows(&*self.ranks, parts))?;
        }
        if !self.is_first() {
            return Ok(None);
        }
        details["count"] = self.count().into();
        let times = vec![("march", march), ("relight", clock.read())];
        Ok(Some(Picture { film: whole, linear, display, exposure, device, times, details }))
    }

    /// The blocks of the picture.
    fn cut(&self, scene: &Scene, size: [usize; 2]) -> Result<Cut, CliError> {
        let (geometry, blocks) = (&scene.frame.geometry, self.blocks(scene));
        let view = scene.camera.view(geometry, count(size[0]) / count(size[1])).ok_or(RenderError::Camera)?;
        let tree = Blocks::new(geometry, blocks).ok_or_else(|| CliError::Failed(format!("no {blocks} blocks")))?;
        let low_first = tree.low_first(geometry, &view);
        Ok(Cut { tree, low_first, view })
    }

    /// The whole film at the first process.
    fn film(
        &self,
        planned: &Planned,
        size: [usize; 2],
        parts: Vec<(Range<usize>, Vec<u8>)>,
    ) -> Result<Option<Film<f32>>, CliError> {
        if !self.is_first() {
            return Ok(None);
        }
        let mut film = no_medium(planned, size);
        let ([per_pixel, _], components) = (numbers(planned), film.components);
        for (rows, bytes) in parts {
            let size = [size[0], rows.len()];
            let mut accumulators: Vec<f32> = bytemuck::pod_collect_to_vec(&bytes);
            let transmittance = accumulators.split_off(per_pixel * size[0] * size[1]);
            film.put([0, rows.start], &Film { size, components, accumulators, transmittance });
        }
        Ok(Some(film))
    }

    /// Marches the block of this process in the tiles that it covers.
    fn relay(
        &self,
        on_device: &SceneRenderer,
        size: [usize; 2],
        Cut { tree, low_first, view }: &Cut,
        progress: &dyn Progress,
    ) -> Result<(Own, Vec<Range<usize>>, serde_json::Value), CliError> {
        let (scene, planned, renderer) = (on_device.scene(), on_device.planned(), on_device.renderer());
        let geometry = &scene.frame.geometry;
        let relay = Relay {
            order: Node::top(self.count()).front_to_back(low_first),
            rows: (0..self.count()).map(|rank| tree.rows(rank, geometry, view, size[1])).collect(),
            width: size[0],
            components: planned.plan.components(),
            numbers: numbers(planned),
        };
        let own = self.block(on_device, Block { index: self.rank(), count: self.count() }, progress)?;
        let mut march = own.begin_march(size, renderer.speed())?;
        let tiles = tiles(size[1], renderer.group_rows(), self.count());
        let (mut done, total) = (0, size[1] as u64);
        let (rows, sent_bytes) = relay.run(&*self.ranks, &tiles, |tile, state| -> Result<_, CliError> {
            march_rows(&mut march, &own, tile, state, progress)?;
            done += tile.len() as u64;
            progress.report("marching", done, total);
            Ok(march.read_rows(renderer, tile.clone())?)
        })?;
        let details =
            json!({ "sharing": "relay", "blocks": self.count(), "tiles": tiles.len(), "sent_bytes": sent_bytes });
        Ok((Own { device: march.finish(renderer)?, stripe: None }, rows, details))
    }

    /// Marches the blocks of this process, and composites the rows that it owns.
    fn over(
        &self,
        on_device: &SceneRenderer,
        size: [usize; 2],
        Cut { tree, low_first, view }: &Cut,
        progress: &dyn Progress,
    ) -> Result<(Own, Vec<Range<usize>>, serde_json::Value), CliError> {
        let (renderer, planned) = (on_device.renderer(), on_device.planned());
        let (geometry, group) = (&on_device.scene().frame.geometry, renderer.group_rows());
        let blocks = low_first.len() + 1;
        let (mut last, mut speed, mut done) = (None, renderer.speed(), 0);
        let (mut dispatches, mut bricks) = (0, None::<BrickCounts>);
        let owned = share_of(blocks, self.rank(), self.count()).len();
        let share = over(&*self.ranks, blocks, low_first, &mut |index| -> Result<Film<f32>, CliError> {
            let own = self.block(on_device, Block { index, count: blocks }, progress)?;
            let mut march = own.begin_march(size, speed)?;
            // Rays of other rows do not meet the block.
            let rows = tree.rows(index, geometry, view, size[1]);
            let rows = rows.start / group * group..rows.end.next_multiple_of(group).min(size[1]);
            let mut film = no_medium(planned, size);
            if !rows.is_empty() {
                march_rows(&mut march, &own, &rows, None, progress)?;
                speed = march.speed();
                let own = march.finish(renderer)?;
                dispatches += own.dispatches;
                bricks = bricks.into_iter().chain(own.bricks).reduce(BrickCounts::and);
                film.put([0, rows.start], &renderer.read_rows(&own, rows)?);
            }
            done += 1;
            progress.report("marching", done, owned as u64);
            last = Some(own);
            Ok(film)
        })?;
        let (share, own) = share.zip(last).ok_or_else(|| {
            CliError::Failed(
                "the films of the blocks do not fit each other, which is an error of Relume or of MPI".to_owned(),
            )
        })?;
        let mut march = own.begin_march(size, renderer.speed())?;
        if !share.rows.is_empty() {
            march.write_rows(renderer, share.rows.clone(), &share.film)?;
        }
        let details = json!({ "sharing": "over", "blocks": blocks, "sent_bytes": share.sent_bytes });
        let mut device = march.finish(renderer)?;
        (device.dispatches, device.bricks) = (dispatches, bricks);
        Ok((Own { device, stripe: Some(share.film) }, vec![share.rows], details))
    }

    /// The scene with one of its blocks, on the same device.
    fn block(
        &self,
        on_device: &SceneRenderer,
        block: Block,
        progress: &dyn Progress,
    ) -> Result<SceneRenderer, CliError> {
        let scene = Scene { block: Some(block), ..on_device.scene().clone() };
        Ok(on_device.with_scene(scene, on_device.planned().clone(), progress)?)
    }
}

/// The relight matrices of the scene under `mix` at another `exposure`.
pub(crate) fn at_exposure(on_device: &SceneRenderer, mix: &Mix, exposure: Option<f64>) -> RelightMatrices {
    let mut scene = on_device.scene().clone();
    scene.display.exposure = exposure;
    RelightMatrices::of_scene(&scene, on_device.planned(), mix)
}

/// Marches `rows` of a block, from the film of the blocks in front if there is one.
fn march_rows(
    march: &mut March,
    own: &SceneRenderer,
    rows: &Range<usize>,
    state: Option<&Film<f32>>,
    progress: &dyn Progress,
) -> Result<(), CliError> {
    march.begin_rows(own.renderer(), rows.clone(), state)?;
    while !march.is_done() {
        if progress.cancelled() {
            return Err(CliError::Cancelled);
        }
        march.step(own.renderer(), own.uploaded())?;
    }
    Ok(())
}

/// A film after the march: on the device, and if it was composited the rows of this process on the host.
struct Own {
    device: DeviceFilm,
    stripe: Option<Film<f32>>,
}

/// Numbers of all accumulators of a pixel, and of its transmittance.
fn numbers(planned: &Planned) -> [usize; 2] {
    [planned.plan.light.accumulators() * planned.plan.components(), planned.plan.transmittance_numbers()]
}

/// The film of rays that meet no medium.
fn no_medium(planned: &Planned, size: [usize; 2]) -> Film<f32> {
    let [accumulators, transmittance] = numbers(planned).map(|numbers| numbers * size[0] * size[1]);
    Film {
        size,
        components: planned.plan.components(),
        accumulators: vec![0.0; accumulators],
        transmittance: vec![1.0; transmittance],
    }
}

/// Refuses what the processes cannot share.
pub(crate) fn check(processes: &Processes, scene: &Scene, planned: &Planned) -> Result<(), CliError> {
    if planned.plan.transmittance == Transmittance::Mixed {
        return Err(OutputError::Matrix.into());
    }
    let (blocks, count) = (processes.blocks(scene), processes.count());
    if blocks < count {
        return Err(CliError::Failed(format!(
            "{count} processes have only {blocks} blocks to march; start at most {blocks}, or cut the volume into more blocks, \
             such as --mpi over/{count}"
        )));
    }
    Ok(())
}
