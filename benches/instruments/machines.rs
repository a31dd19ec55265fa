//! A simulated table of one picture by many machines: measured marches of blocks and rates of compositing, and a model of
//! the network.

use std::error::Error;
use std::sync::Arc;

use serde::Serialize;

use relume::document::{SceneOptions, load_peer};
use relume::film::{Film, Rectangle};
use relume::measure::Stopwatch;
use relume::number::count;
use relume::progress::Quiet;
use relume::ranks::{BYTES_AT_ONCE, share_of};
use relume::render::{Renderer, SceneRenderer};
use relume::scene::{Block, Scene};
use relume::volume::{Phantom, Volume};

/// Side of the pictures.
const SIDE: usize = 400;
/// Machines, each with one block.
const MACHINES: [usize; 5] = [1, 4, 16, 64, 1024];
/// Marches of a block, of which the shortest counts: other programs delay the rest.
const RUNS: usize = 3;
/// Largest number of blocks that are marched; of more, some that are equally far apart.
const MARCHED: usize = 64;
/// Latency in s and bandwidth in bytes/s of a fast fabric and of Ethernet (docs/SCALE.md).
const NETWORKS: [(&str, f64, f64); 2] = [("fabric", 2e-6, 12e9), ("Ethernet", 50e-6, 1.1e9)];
/// Bytes of a pixel of a finished picture.
const PICTURE_BYTES: f64 = 4.0;

/// A number of machines.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct MachineRow {
    pub(crate) machines: usize,
    /// Blocks that were marched to measure the next numbers.
    pub(crate) marched: usize,
    /// Median and longest march of a block, in s: measured.
    pub(crate) march: [f64; 2],
    /// Pixels of the largest rectangle and of the mean one: measured.
    pub(crate) pixels: [f64; 2],
    /// Bytes that a machine sends, the most of the measured ones.
    pub(crate) sent_bytes: f64,
    /// Compositing of the rows of a machine, in s: their pixels at the measured rate.
    pub(crate) composite: f64,
    /// Messages and collection of the picture, in s, by network: from the model.
    pub(crate) network: [f64; 2],
}

/// Seconds and rectangle of each of some blocks, and a film.
type Measured = (Vec<(f64, Rectangle)>, Film<f32>);

fn measured(on_device: &SceneRenderer, blocks: usize) -> Result<Measured, Box<dyn Error>> {
    let step = blocks.div_ceil(MARCHED);
    let (mut found, mut last) = (Vec::new(), None);
    for index in (0..blocks).step_by(step) {
        let block = (blocks > 1).then_some(Block { index, count: blocks });
        let scene = Scene { block, ..on_device.scene().clone() };
        let own = on_device.with_scene(scene, on_device.planned().clone(), &Quiet)?;
        // The first march of each kind compiles its shader.
        if index == 0 {
            own.march([SIDE; 2], &Quiet)?;
        }
        let mut shortest = f64::INFINITY;
        for _ in 0..RUNS {
            let watch = Stopwatch::start();
            let film = own.march([SIDE; 2], &Quiet)?;
            last = Some(own.renderer().read(&film)?);
            shortest = shortest.min(watch.read().wall_ms / 1e3);
        }
        found.extend(last.as_ref().map(|film| (shortest, film.met())));
    }
    Ok((found, last.ok_or("no blocks")?))
}

/// Measures and simulates the phantom frog of `edge` voxels along each axis.
pub(crate) fn machine_rows(renderer: &Renderer, edge: usize) -> Result<Vec<MachineRow>, Box<dyn Error>> {
    let mut scene = load_peer(&SceneOptions::default(), &Quiet)?.scene;
    scene.set_volume(Arc::new(Volume::phantom(Phantom::Frog, Some([edge; 3]))?));
    let on_device = SceneRenderer::new(renderer, scene, &Quiet)?;
    let mut rows = Vec::new();
    for machines in MACHINES {
        let (found, film) = measured(&on_device, machines)?;
        let front = film.clone();
        let watch = Stopwatch::start();
        let back = front.over(&film).ok_or("films of one shape composite")?;
        let over = watch.read().wall_ms / 1e3 / count(back.pixels());
        let pixel_bytes = 4.0 * count(film.accumulators.len() + film.transmittance.len()) / count(film.pixels());

        let mut march: Vec<f64> = found.iter().map(|(seconds, _)| *seconds).collect();
        march.sort_by(f64::total_cmp);
        let area = |[low, high]: &Rectangle| count((high[0] - low[0]) * (high[1] - low[1]));
        let areas: Vec<f64> = found.iter().map(|(_, met)| area(met)).collect();
        let mean = areas.iter().sum::<f64>() / count(areas.len());
        // To the owners of the rows that a rectangle covers.
        let receivers = |[low, high]: &Rectangle| -> f64 {
            let covered = |rank: &usize| {
                let rows = share_of(SIDE, *rank, machines);
                rows.start < high[1] && low[1] < rows.end
            };
            count((0..machines).filter(covered).count())
        };
        let sent = |it: &Rectangle| if machines == 1 { 0.0 } else { area(it) * pixel_bytes };
        let most = |number: &dyn Fn(&Rectangle) -> f64| found.iter().map(|(_, met)| number(met)).fold(0.0, f64::max);
        let (sent_bytes, messages) = (most(&sent), if machines == 1 { 0.0 } else { most(&receivers) });
        // Of the rows of a machine, as many as have so many bytes are exchanged at once.
        let rows_at_once = (count(BYTES_AT_ONCE) / (pixel_bytes * count(SIDE))).floor().max(1.0);
        let exchanges = (count(SIDE.div_ceil(machines)) / rows_at_once).ceil();
        let network = NETWORKS.map(|(_, latency, bandwidth)| {
            if machines == 1 {
                return 0.0;
            }
            // On average a machine receives as much as it sends; the first collects the picture.
            let others = count(machines - 1);
            let collected = PICTURE_BYTES * count(SIDE * SIDE) * others / count(machines);
            // Announced rectangles, in rounds that double what is known.
            let announced = count(machines).log2().ceil() * latency + 56.0 * others / bandwidth;
            announced
                + exchanges * messages * latency
                + sent_bytes / bandwidth
                + others * latency
                + collected / bandwidth
        });
        // All nodes of the tree over the rows of a machine, as they are composited.
        let composite = over * count(machines - 1) * count(SIDE * SIDE) / count(machines);
        rows.push(MachineRow {
            machines,
            marched: found.len(),
            march: [march[march.len() / 2], march[march.len() - 1]],
            pixels: [areas.iter().copied().fold(0.0, f64::max), mean],
            sent_bytes,
            composite,
            network,
        });
    }
    Ok(rows)
}

/// The rows as a table.
pub(crate) fn text(rows: &[MachineRow]) -> String {
    let mut text = format!(
        "SIMULATED: {SIDE}×{SIDE} pixels, ms. March of a block: measured here one after the other (median, longest). \
         Composite: measured rate. Network: a model without congestion ({}).\n\
         machines, marched, median, longest, sent kB, composite, fabric, Ethernet, picture by fabric, by Ethernet\n",
        NETWORKS.map(|(name, latency, bandwidth)| format!("{name}: {latency:e} s, {bandwidth:e} bytes/s")).join("; ")
    );
    for row in rows {
        let MachineRow { machines, marched, march, sent_bytes, composite, network, .. } = row;
        let [median, longest, composite] = [march[0], march[1], *composite].map(|seconds| 1e3 * seconds);
        let [fabric, ethernet] = network.map(|seconds| 1e3 * seconds);
        let [by_fabric, by_ethernet] = [fabric, ethernet].map(|network| longest + composite + network);
        text += &format!(
            "{machines}, {marched}, {median:.1}, {longest:.1}, {:.0}, {composite:.1}, {fabric:.2}, {ethernet:.2}, \
             {by_fabric:.0}, {by_ethernet:.0}\n",
            sent_bytes / 1e3
        );
    }
    text
}
