//! Rows of transfer factors: the light that each node of a grid gathers from the medium around each other node, along rays, whatever
//! the lights and, in grey media, whatever the reflectances (docs/theory/scattering.md).

use super::scatterer::{Arriving, Numbers, Scatterer};
use super::{ReferenceError, Samples, Skipping, Step, Stored};
use crate::Scene;
use crate::plan::Planned;
use crate::tables::{CELL, LabelMap, LightGrid, Occupancy, Storage, StoredScene, sky_direction};
use glam::{DQuat, DVec3};
use relume_base::number::{count, rounded, unsigned, whole};
use relume_base::progress::Progress;
use relume_base::{memory, parallel};
use relume_colour::model::random::Random;
use smallvec::SmallVec;

/// Transmittance at which a ray ends: what is left of it ends as its last step does, so that no light is lost.
const END: f64 = 0.01;
/// Parts of a cell along each axis, within which rays see the same medium; a step of a ray is as long as one.
const PARTS: usize = 2;
/// Spacing of the light grid of the lights with directions, as a part of the spacing of nodes.
const LIGHT_SPACING: f64 = 1.0;
/// Factors of a direction: nodes that a ray passes before it ends, in solids some 3 and in haze some 12.
const FACTORS: f64 = 8.0;
/// Nodes of a task between two checks for cancellation.
const AT_ONCE: usize = 64;

/// Rows of transfer factors between the nodes of a grid that have any medium around them.
#[derive(Debug)]
pub(super) struct Rows {
    /// The grid.
    pub(super) grid: LightGrid,
    /// Nodes with a row, by their indices in the grid: those that others gather from, and then those beyond the faces of the volume,
    /// whose rows are of the face.
    pub(super) nodes: Vec<u32>,
    /// Number of the first ones.
    pub(super) inner: usize,
    /// Numbers of each factor.
    pub(super) numbers: usize,
    /// Factors of the rays with even and with odd numbers: each half gathers all light.
    pub(super) halves: [HalfRows; 2],
}

/// Rows from half of the rays.
#[derive(Debug, Default)]
pub(super) struct HalfRows {
    /// First factor of each row, and one more.
    starts: Vec<usize>,
    /// Number of the node that each factor gathers from.
    columns: Vec<u32>,
    /// Numbers of each factor.
    factors: Vec<f32>,
    /// Light that is gathered from each position with directions once scattered: [`Rows::numbers`] for each position, node by node.
    once: Vec<f64>,
    /// Part of an even sky that is seen from each node.
    open: Vec<f64>,
}

/// Factors of a node, and the nodes that it gathers from.
#[derive(Default)]
struct Row {
    columns: Vec<u32>,
    factors: Vec<f32>,
}

/// The medium in each part of the cells of nodes: numbers of a step within it, and the light that arrives. Rays cross each part hundreds of times,
/// so that looking up the volume, the tables and the lights once is most of what can be saved.
struct Parts {
    /// Numbers of a part: opacity of a step, light that a step scatters by the numbers of factors, and shares of light.
    stride: usize,
    opacities: usize,
    numbers: Vec<f32>,
}

const NONE: u32 = u32::MAX;

/// Part of a step that counts as all of it.
const WHOLE: f64 = 1.0 - 1e-9;

/// Part of a cell, along each axis, over which the rays of its node begin.
const WIDTH: f64 = 0.75;

/// Steps of a sequence that fills a cube evenly (Roberts 2018): powers of the root of x⁴ = x + 1.
const SPREAD: DVec3 = DVec3::new(0.819_172_513_396_164_4, 0.671_043_606_703_789_2, 0.549_700_477_901_970_3);

/// Inputs of a row.
struct Gathering<'a> {
    scatterer: &'a Scatterer,
    samples: &'a dyn Samples<f64>,
    grid: &'a LightGrid,
    /// Number of each node of the grid among those with rows, or none.
    rows: &'a [u32],
    directions: usize,
    positions: usize,
    /// Weight of each number of a density in what a walk scatters.
    occluding: Vec<f64>,
    step: f64,
    parts: Parts,
}

impl Rows {
    /// The rows of `scene`, and the materials of their numbers.
    pub(super) fn new(
        scene: &Scene,
        planned: &Planned,
        (storage, labels): (&Storage, Option<&LabelMap>),
        numbers: Numbers,
        progress: &dyn Progress,
    ) -> Result<(Self, Vec<usize>), ReferenceError> {
        let spacing = scene.scattering_spacing();
        let grid = LightGrid::of_middles(scene, spacing);
        // The light of each component at each node, and marks of nodes.
        let layers = count(planned.plan.components() * planned.positions.len());
        let all: f64 = grid.dims.iter().map(|&nodes| count(nodes)).product();
        check_memory(scene, all * 8.0f64.mul_add(layers, 8.0))?;
        let scatterer = Scatterer::new(scene, planned, numbers).with_light_grids_of(LIGHT_SPACING * spacing);
        let stored = scatterer.stored(storage, labels);
        let occupancy = scatterer.occupancy(storage, labels);
        let samples = Skipping::new(
            Stored::<f64>::new(&scatterer.planned, &stored),
            &occupancy,
            scatterer.scene(),
            &scatterer.planned,
        );
        let arriving = scatterer.reaching(&samples, usize::MAX, progress)?;
        let mut nodes = nodes_around(&grid, (&stored, &occupancy));
        let inner = nodes.len();
        let mut rows = vec![NONE; grid.dims.iter().product()];
        nodes.iter().enumerate().for_each(|(number, &node)| rows[node as usize] = unsigned(number));
        nodes.extend(nodes_beside(&grid, &rows));
        let geometry = &scene.frame.geometry;
        let between = (grid.spacing * geometry.spacing / geometry.spacing.min_element()).min_element();
        let mut gathering = Gathering {
            samples: &samples,
            grid: &grid,
            rows: &rows,
            directions: scene.scattering_directions(),
            positions: planned.positions.len(),
            occluding: match numbers {
                // Reflectances of the components are scaled already.
                Numbers::Components => vec![1.0; scatterer.planned.plan.components()],
                Numbers::Materials => {
                    let occludes = |&material: &usize| scene.materials[material].occludes;
                    scatterer.planned.materials.iter().map(occludes).collect()
                }
            },
            step: between / count(PARTS),
            scatterer: &scatterer,
            parts: Parts { stride: 0, opacities: scatterer.planned.plan.transmittance_numbers(), numbers: Vec::new() },
        };
        let numbers = gathering.occluding.len();
        // Factors are kept as they are found, and once more for the solution.
        let factors = FACTORS * count(gathering.directions * nodes.len());
        let parts = count(8 * inner * (numbers + gathering.parts.opacities + gathering.positions * scatterer.shares()));
        check_memory(scene, (2.0 * factors).mul_add(4.0f64.mul_add(count(numbers), 4.0), 8.0 * parts))?;
        gathering.look_up(&nodes[..inner], &arriving);
        let halves = gathering.halves(&nodes, progress)?;
        Ok((Self { grid, nodes, inner, numbers, halves }, scatterer.planned.materials.clone()))
    }
}

impl Gathering<'_> {
    /// Looks up the medium around `nodes`, and the light that arrives there.
    fn look_up(&mut self, nodes: &[u32], arriving: &Arriving) {
        let Self { scatterer, samples, .. } = *self;
        let opacities = self.parts.opacities;
        let lit = opacities + self.occluding.len();
        let stride = lit + self.positions * scatterer.shares();
        let of_task = |task: usize| -> Vec<f32> {
            let own = &nodes[task * AT_ONCE..((task + 1) * AT_ONCE).min(nodes.len())];
            let mut numbers = vec![0.0; own.len() * PARTS.pow(3) * stride];
            let (mut density, mut step) = (Step::default(), Step::default());
            let mut light = vec![0.0; stride - lit];
            for (part, numbers) in numbers.chunks_exact_mut(stride).enumerate() {
                let at = self.at(own[part / PARTS.pow(3)]);
                let of_axis = |axis: u32| count(part / PARTS.pow(axis) % PARTS) + 0.5;
                let within = DVec3::new(of_axis(0), of_axis(1), of_axis(2)) / count(PARTS) - 0.5;
                let place = ((at + within - self.grid.offset) / self.grid.scale).to_array();
                scatterer.density(samples, place, &mut density);
                if density.does_nothing() {
                    continue;
                }
                scatterer.cross(&density, self.step, &mut step);
                light.fill(0.0);
                scatterer.arrive(arriving, place, samples, &mut light);
                let scattered = scatterer.scattered(&step).iter().zip(&self.occluding).map(|(lit, part)| lit * part);
                let all = step.opacity.iter().copied().chain(scattered).chain(light.iter().copied());
                numbers.iter_mut().zip(all).for_each(|(number, of_part)| *number = rounded(of_part));
            }
            numbers
        };
        let numbers = parallel::map(nodes.len().div_ceil(AT_ONCE), &of_task).concat();
        self.parts = Parts { stride, opacities, numbers };
    }

    /// The rows of `nodes`, from the rays with even and with odd numbers.
    fn halves(&self, nodes: &[u32], progress: &dyn Progress) -> Result<[HalfRows; 2], ReferenceError> {
        let tasks = nodes.len().div_ceil(AT_ONCE);
        let done = std::sync::atomic::AtomicU64::new(0);
        // Place of the factor of each node in a row, or none.
        let places = || vec![NONE; nodes.len()];
        let made = parallel::map_with(tasks, &places, &|places, task| {
            if progress.cancelled() {
                return Err(ReferenceError::Cancelled);
            }
            let mut halves = [(); 2].map(|()| HalfRows::default());
            for &node in &nodes[task * AT_ONCE..((task + 1) * AT_ONCE).min(nodes.len())] {
                self.add_rows_of(node, places, &mut halves);
            }
            let done = done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1;
            progress.report("gathering scattered light", done, tasks as u64);
            Ok(halves)
        });
        let mut halves = [(); 2].map(|()| HalfRows { starts: vec![0], ..HalfRows::default() });
        for rows in made {
            for (half, rows) in halves.iter_mut().zip(rows?) {
                let before = half.columns.len();
                half.starts.extend(rows.starts.iter().map(|end| before + end));
                half.columns.extend(rows.columns);
                half.factors.extend(rows.factors);
                half.once.extend(rows.once);
                half.open.extend(rows.open);
            }
        }
        Ok(halves)
    }

    /// Indices of a node of the grid.
    fn at(&self, node: u32) -> DVec3 {
        let [width, height, _] = self.grid.dims;
        let index = node as usize;
        DVec3::from_array([index % width, index / width % height, index / (width * height)].map(count))
    }

    /// Adds the row of a node of the grid from the rays with even and with odd numbers; [`HalfRows::starts`] are ends.
    fn add_rows_of(&self, node: u32, places: &mut [u32], halves: &mut [HalfRows; 2]) {
        let at = self.at(node);
        // In the middle of a cell, or of its face.
        let last = DVec3::from_array(self.grid.dims.map(count)) - 1.5;
        let middle = at.clamp(DVec3::splat(0.5), last);
        let width = DVec3::select(middle.cmpeq(at), DVec3::splat(WIDTH), DVec3::ZERO);
        let mut random = Random::new(u64::from(node) ^ 0x5ca7_7e12);
        let turn = turn(&mut random);
        let shift = DVec3::from_array([(); 3].map(|()| random.unit()));
        for (first, half) in halves.iter_mut().enumerate() {
            let start = half.columns.len();
            half.once.resize(half.once.len() + self.positions * self.occluding.len(), 0.0);
            half.open.push(0.0);
            for ray in (first..self.directions).step_by(2) {
                let direction = turn * sky_direction(ray, self.directions);
                let within = width * ((shift + count(ray) * SPREAD).fract() - 0.5);
                self.gather(middle + within, direction, random.unit(), places, half);
            }
            for &column in &half.columns[start..] {
                places[column as usize] = NONE;
            }
            half.starts.push(half.columns.len());
        }
    }

    /// Adds to the last row what a ray gathers from a place in the grid, whose steps begin a part `phase` of a step before.
    fn gather(&self, from: DVec3, direction: DVec3, phase: f64, places: &mut [u32], half: &mut HalfRows) {
        let Self { scatterer, step: length, ref parts, grid, .. } = *self;
        let numbers = self.occluding.len();
        let shares = scatterer.shares();
        let share_of_ray = 2.0 / count(self.directions);
        let way = scatterer.way(((from - grid.offset) / grid.scale).to_array(), direction);
        let [begin, end] = way.range;
        let per_step: [f64; 3] = std::array::from_fn(|axis| way.at(length)[axis] - way.at(0.0)[axis]);
        let along = DVec3::from_array(per_step) * grid.scale / length;
        let mut transmittance: SmallVec<[f64; 8]> = smallvec::smallvec![1.0; parts.opacities];
        let of_row = half.once.len() - self.positions * numbers;
        let mut number = 0_usize;
        loop {
            let start = ((count(number) - phase) * length).max(0.0) + begin;
            let stop = ((count(number + 1) - phase) * length + begin).min(end);
            if start >= end {
                break;
            }
            let middle = f64::midpoint(start, stop);
            let Some((column, part)) = self.part(from + middle * along) else {
                let (occupied, ahead) = self.samples.ahead(way.at(middle), per_step);
                number += if occupied { 1 } else { ahead.max(1) };
                continue;
            };
            number += 1;
            let medium = &parts.numbers[part * parts.stride..][..parts.stride];
            let (opacity, medium) = medium.split_at(parts.opacities);
            if opacity.iter().all(|&opacity| opacity <= 0.0) {
                continue;
            }
            // Of the first and the last step there is only a part.
            let length_of_step = ((stop - start) / length).max(f64::MIN_POSITIVE);
            let lost = |opacity: f32| {
                let opacity = f64::from(opacity);
                if length_of_step < WHOLE { -(length_of_step * (-opacity).ln_1p()).exp_m1() } else { opacity }
            };
            let ends = transmittance.iter().zip(opacity).all(|(left, &opacity)| left * (1.0 - lost(opacity)) < END);
            let place = &mut places[column as usize];
            if *place == NONE {
                *place = unsigned(half.columns.len());
                half.columns.push(column);
                half.factors.resize(half.factors.len() + numbers, 0.0);
            }
            let (scattered, light) = medium.split_at(numbers);
            let factors = &mut half.factors[*place as usize * numbers..][..numbers];
            for (i, factor) in factors.iter_mut().enumerate() {
                let number = if parts.opacities == 1 { 0 } else { i };
                let whole = f64::from(opacity[number]).max(f64::MIN_POSITIVE);
                let part = if ends { 1.0 } else { lost(opacity[number]) };
                let gathered = share_of_ray * transmittance[number] * f64::from(scattered[i]) * part / whole;
                *factor += rounded(gathered);
                for position in 0..self.positions {
                    let arrived = light[position * shares + if shares == 1 { 0 } else { i }];
                    half.once[of_row + position * numbers + i] += gathered * f64::from(arrived);
                }
            }
            if ends {
                return;
            }
            transmittance.iter_mut().zip(opacity).for_each(|(left, &opacity)| *left -= *left * lost(opacity));
        }
        if let Some(open) = half.open.last_mut() {
            *open += share_of_ray * transmittance[0];
        }
    }

    /// Number of the node next to a place in the grid, and of the part of its cell; none without a row.
    fn part(&self, place: DVec3) -> Option<(u32, usize)> {
        let [width, height, _] = self.grid.dims;
        let last = DVec3::from_array(self.grid.dims.map(count)) - 2.0;
        let node = (place + 0.5).floor().clamp(DVec3::ONE, last);
        let part = (count(PARTS) * (place - node + 0.5)).floor().clamp(DVec3::ZERO, DVec3::splat(count(PARTS - 1)));
        let [x, y, z] = node.to_array().map(whole);
        let row = self.rows[x + width * (y + height * z)];
        let [i, j, k] = part.to_array().map(whole);
        (row != NONE).then(|| (row, row as usize * PARTS.pow(3) + i + PARTS * (j + PARTS * k)))
    }
}

/// Refuses scattered light that needs more than the free memory.
fn check_memory(scene: &Scene, bytes: f64) -> Result<(), ReferenceError> {
    let needed = whole(bytes) as u64;
    match memory::available_bytes() {
        Some(free) if needed > free => Err(ReferenceError::ScatteredLight {
            spacing: scene.scattering_spacing(),
            directions: scene.scattering_directions(),
            needed_mb: needed.div_ceil(1 << 20),
            free_mb: free >> 20,
        }),
        _ => Ok(()),
    }
}

/// A random turn, all equally likely (Shoemake 1992).
fn turn(random: &mut Random) -> DQuat {
    let [u, v, w] = [(); 3].map(|()| random.unit());
    let (a, b) = ((1.0 - u).sqrt(), u.sqrt());
    let [v, w] = [v, w].map(|part| std::f64::consts::TAU * part);
    DQuat::from_xyzw(a * v.sin(), a * v.cos(), b * w.sin(), b * w.cos())
}

/// Nodes beyond one face of the volume, beside one that gathers light.
fn nodes_beside(grid: &LightGrid, rows: &[u32]) -> Vec<u32> {
    let strides = [1, grid.dims[0], grid.dims[0] * grid.dims[1]];
    let is_beside = |&node: &usize| {
        let at = |axis: usize| node / strides[axis] % grid.dims[axis];
        let mut beyond = (0..3).filter(|&axis| at(axis) == 0 || at(axis) + 1 == grid.dims[axis]);
        let (Some(axis), None) = (beyond.next(), beyond.next()) else { return false };
        let inwards = if at(axis) == 0 { node + strides[axis] } else { node - strides[axis] };
        rows[inwards] != NONE
    };
    (0..rows.len()).filter(is_beside).map(unsigned).collect()
}

/// Nodes in the volume that are read between, where there is any medium, by their indices.
fn nodes_around(grid: &LightGrid, (stored, occupancy): (&StoredScene, &Occupancy)) -> Vec<u32> {
    let dims = stored.volume.dims;
    let [width, height, depth] = dims;
    // Along each axis, the nodes that are read between two voxels.
    let read: [Vec<[usize; 2]>; 3] = std::array::from_fn(|axis| {
        let node = |voxel: usize| {
            let place = (count(voxel) + 0.5) / count(dims[axis]);
            place.mul_add(grid.scale[axis], grid.offset[axis])
        };
        let last = grid.dims[axis] - 2;
        // An axis of one voxel is one voxel thick.
        let between = |voxel: usize| match dims[axis] {
            1 => [1, last],
            _ => {
                let [low, high] = [node(voxel) - 1e-6, node(voxel + 1) + 1e-6];
                [whole(low.floor().max(1.0)).min(last), whole(high.ceil().max(1.0)).min(last)]
            }
        };
        (0..dims[axis].max(2) - 1).map(between).collect()
    });
    let visible = Visible::new(stored);
    let layer = |k: usize| -> Vec<u32> {
        let mut needed = Vec::new();
        let mut marked = vec![false; grid.dims[0] * grid.dims[1]];
        let [first, last] = read[2][k];
        let up = (k + 1).min(depth - 1);
        for j in 0..read[1].len() {
            for i in 0..read[0].len() {
                let cell = [i, j, k].map(|voxel| voxel / CELL);
                let cell = std::array::from_fn(|axis| cell[axis].min(occupancy.dims[axis] - 1));
                let [right, down] = [(i + 1).min(width - 1), (j + 1).min(height - 1)];
                if !occupancy.is_set(cell) || !visible.between([[i, right], [j, down], [k, up]]) {
                    continue;
                }
                for y in read[1][j][0]..=read[1][j][1] {
                    marked[y * grid.dims[0]..][read[0][i][0]..=read[0][i][1]].fill(true);
                }
            }
        }
        for (node, _) in marked.iter().enumerate().filter(|(_, marked)| **marked) {
            needed.extend((first..=last).map(|z| unsigned(node + z * grid.dims[0] * grid.dims[1])));
        }
        needed
    };
    let mut nodes = parallel::map(read[2].len(), &layer).concat();
    nodes.sort_unstable();
    nodes.dedup();
    nodes
}

/// Voxels between which there may be a medium.
struct Visible<'a> {
    stored: &'a StoredScene,
    /// Number of active entries of the table before each; empty where values of other fields or labels decide too.
    before: Vec<u32>,
    coordinate: [f64; 2],
}

impl<'a> Visible<'a> {
    fn new(stored: &'a StoredScene) -> Self {
        let mut before = Vec::new();
        if stored.further.is_empty() && stored.labels.is_none() {
            before.push(0);
            for active in stored.table.active_entries() {
                before.push(before[before.len() - 1] + u32::from(active));
            }
        }
        Self { stored, before, coordinate: stored.table.coordinate_from_texel(&stored.storage) }
    }

    /// True if the values between eight voxels may be visible.
    fn between(&self, [xs, ys, zs]: [[usize; 2]; 3]) -> bool {
        if self.before.is_empty() {
            return true;
        }
        let [width, height, _] = self.stored.volume.dims;
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        for z in zs {
            for y in ys {
                for x in xs {
                    let value = self.stored.volume.values[x + width * (y + height * z)];
                    (low, high) = (low.min(value), high.max(value));
                }
            }
        }
        let last = self.before.len() - 2;
        let [scale, offset] = self.coordinate;
        let entry = |value: f32| f64::from(value).mul_add(scale, offset);
        let first = whole(entry(low).floor().max(0.0)).min(last);
        let end = whole(entry(high).ceil().max(0.0)).min(last);
        self.before[end + 1] > self.before[first]
    }
}

impl Rows {
    /// The factors of `halves` together: one for each pair of nodes, in the order of the nodes that are gathered from.
    pub(super) fn pairs(&self, halves: &[usize]) -> Pairs {
        let part = 1.0 / count(halves.len());
        let numbers = self.numbers;
        let row = |node: usize| -> Row {
            let mut found: Vec<(u32, &[f32])> = Vec::new();
            for half in halves.iter().filter_map(|&half| self.halves.get(half)) {
                let range = half.starts[node]..half.starts[node + 1];
                found.extend(range.map(|factor| (half.columns[factor], &half.factors[factor * numbers..][..numbers])));
            }
            found.sort_by_key(|(column, _)| *column);
            let mut row = Row::default();
            for (column, factor) in found {
                if row.columns.last() != Some(&column) {
                    row.columns.push(column);
                    row.factors.resize(row.factors.len() + numbers, 0.0);
                }
                let first = row.factors.len() - numbers;
                let sums = row.factors[first..].iter_mut().zip(factor);
                sums.for_each(|(sum, &factor)| *sum += rounded(part * f64::from(factor)));
            }
            row
        };
        let mut pairs = Pairs { starts: vec![0], columns: Vec::new(), factors: Vec::new(), numbers };
        for row in parallel::map(self.nodes.len(), &row) {
            pairs.columns.extend(row.columns);
            pairs.factors.extend(row.factors);
            pairs.starts.push(pairs.columns.len());
        }
        pairs
    }

    /// Light of component `i` that each node gathers from a position once scattered.
    pub(super) fn once(&self, halves: &[usize], position: usize, i: usize, reflectances: Option<&[f64]>) -> Vec<f64> {
        let part = 1.0 / count(halves.len());
        let mut light = vec![0.0; self.nodes.len()];
        for half in halves.iter().filter_map(|&half| self.halves.get(half)) {
            let positions = half.once.len() / (self.numbers * self.nodes.len()).max(1);
            for (node, light) in light.iter_mut().enumerate() {
                let numbers = &half.once[(node * positions + position) * self.numbers..][..self.numbers];
                *light += part * number(numbers.iter().copied(), i, reflectances);
            }
        }
        light
    }

    /// Number of factors.
    pub(super) fn factors(&self) -> usize {
        self.halves.iter().map(|half| half.columns.len()).sum()
    }

    /// Part of an even sky that is seen from each node.
    pub(super) fn open(&self, halves: &[usize]) -> Vec<f64> {
        let part = 1.0 / count(halves.len());
        let of_half = |half: &usize, node: usize| self.halves.get(*half).map_or(0.0, |half| half.open[node]);
        (0..self.nodes.len()).map(|node| halves.iter().map(|half| part * of_half(half, node)).sum()).collect()
    }
}

/// Number `i`, or the sum of the numbers of materials by their reflectances.
fn number(mut numbers: impl Iterator<Item = f64>, i: usize, reflectances: Option<&[f64]>) -> f64 {
    match reflectances {
        Some(reflectances) => numbers.zip(reflectances).map(|(number, reflectance)| number * reflectance).sum(),
        None => numbers.nth(i).unwrap_or(0.0),
    }
}

/// Factors between pairs of nodes, row by row.
#[derive(Debug)]
pub(super) struct Pairs {
    starts: Vec<usize>,
    columns: Vec<u32>,
    factors: Vec<f32>,
    numbers: usize,
}

impl Pairs {
    /// The matrix of component `i`: its factors in coloured media, and otherwise those of materials by their reflectances.
    pub(super) fn matrix(&self, i: usize, reflectances: Option<&[f64]>) -> Matrix<'_> {
        let of_pair = |numbers: &[f32]| rounded(number(numbers.iter().copied().map(f64::from), i, reflectances));
        Matrix { pairs: self, factors: self.factors.chunks_exact(self.numbers.max(1)).map(of_pair).collect() }
    }
}

/// A sparse matrix, row by row.
#[derive(Debug)]
pub(super) struct Matrix<'a> {
    pairs: &'a Pairs,
    factors: Vec<f32>,
}

impl Matrix<'_> {
    /// The factors of a row, and the nodes that they gather from.
    fn row(&self, row: usize) -> impl Iterator<Item = (f64, usize)> {
        let range = self.pairs.starts[row]..self.pairs.starts[row + 1];
        let columns = self.pairs.columns[range.clone()].iter();
        self.factors[range].iter().zip(columns).map(|(&factor, &column)| (f64::from(factor), column as usize))
    }

    /// Sets `product` to that with `light`, as many rows as it has numbers.
    pub(super) fn apply(&self, light: &[f64], product: &mut [f64]) {
        for (row, sum) in product.iter_mut().enumerate() {
            *sum = self.row(row).map(|(factor, column)| factor * light[column]).sum();
        }
    }

    /// The factor of each of the first `rows` nodes from itself.
    pub(super) fn diagonal(&self, rows: usize) -> Vec<f64> {
        (0..rows)
            .map(|row| self.row(row).find(|(_, column)| *column == row).map_or(0.0, |(factor, _)| factor))
            .collect()
    }
}
