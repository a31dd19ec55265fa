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
/// Length of a step of a ray as a part of the distance of two nodes, and its smallest in units of length.
const STEP: f64 = 0.5;
const LEAST_STEP: f64 = 1.0;
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

/// Row of a node, from half of the rays.
#[derive(Default)]
struct Row {
    columns: Vec<u32>,
    factors: Vec<f32>,
    once: Vec<f64>,
    open: f64,
}

/// Memory of a thread from node to node.
struct Scratch {
    /// Place of the factor of each node in the row, or none.
    places: Vec<u32>,
    density: Step<f64>,
    step: Step<f64>,
    light: Vec<f64>,
}

const NONE: u32 = u32::MAX;

/// Part of a cell, along each axis, over which the rays of its node begin.
const WIDTH: f64 = 0.75;

/// Steps of a sequence that fills a cube evenly (Roberts 2018): powers of the root of x⁴ = x + 1.
const SPREAD: DVec3 = DVec3::new(0.819_172_513_396_164_4, 0.671_043_606_703_789_2, 0.549_700_477_901_970_3);

/// Inputs of a row.
struct Gathering<'a> {
    scatterer: &'a Scatterer,
    samples: &'a dyn Samples<f64>,
    arriving: &'a Arriving,
    grid: &'a LightGrid,
    /// Number of each node of the grid among those with rows, or none.
    rows: &'a [u32],
    directions: usize,
    positions: usize,
    /// Weight of each number of a density in what a walk scatters.
    occluding: Vec<f64>,
    step: f64,
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
        let gathering = Gathering {
            samples: &samples,
            arriving: &arriving,
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
            step: (STEP * between).max(LEAST_STEP.min(0.5 * between)),
            scatterer: &scatterer,
        };
        let numbers = gathering.occluding.len();
        // Factors are kept as they are found, and once more for the solution.
        let factors = FACTORS * count(gathering.directions * nodes.len());
        check_memory(scene, 2.0 * factors * 4.0f64.mul_add(count(numbers), 4.0))?;
        let halves = gathering.halves(&nodes, progress)?;
        Ok((Self { grid, nodes, inner, numbers, halves }, scatterer.planned.materials.clone()))
    }
}

impl Gathering<'_> {
    /// The rows of `nodes`, from the rays with even and with odd numbers.
    fn halves(&self, nodes: &[u32], progress: &dyn Progress) -> Result<[HalfRows; 2], ReferenceError> {
        let numbers = self.occluding.len();
        let tasks = nodes.len().div_ceil(AT_ONCE);
        let done = std::sync::atomic::AtomicU64::new(0);
        let scratch = || Scratch {
            places: vec![NONE; nodes.len()],
            density: Step::default(),
            step: Step::default(),
            light: vec![0.0; self.positions * self.scatterer.shares()],
        };
        let made = parallel::map_with(tasks, &scratch, &|scratch, task| {
            if progress.cancelled() {
                return Err(ReferenceError::Cancelled);
            }
            let own = &nodes[task * AT_ONCE..((task + 1) * AT_ONCE).min(nodes.len())];
            let rows: Vec<[Row; 2]> = own.iter().map(|&node| self.rows_of(node, scratch)).collect();
            let done = done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1;
            progress.report("gathering scattered light", done, tasks as u64);
            Ok(rows)
        });
        let mut halves: [HalfRows; 2] = std::array::from_fn(|_| HalfRows { starts: vec![0], ..HalfRows::default() });
        for rows in made {
            for row in rows? {
                for (half, row) in halves.iter_mut().zip(row) {
                    half.columns.extend(row.columns);
                    half.factors.extend(row.factors);
                    half.starts.push(half.columns.len());
                    half.once.extend(row.once);
                    half.open.push(row.open);
                }
            }
        }
        debug_assert!(halves.iter().all(|half| half.factors.len() == numbers * half.columns.len()), "whole factors");
        Ok(halves)
    }

    /// The row of a node of the grid, from the rays with even and with odd numbers.
    fn rows_of(&self, node: u32, scratch: &mut Scratch) -> [Row; 2] {
        let [width, height, _] = self.grid.dims;
        let index = node as usize;
        let at = [index % width, index / width % height, index / (width * height)];
        // In the middle of a cell, or of its face.
        let last = DVec3::from_array(self.grid.dims.map(count)) - 1.5;
        let middle = DVec3::from_array(at.map(count)).clamp(DVec3::splat(0.5), last);
        let is_inner: [bool; 3] = std::array::from_fn(|axis| at[axis] > 0 && at[axis] + 1 < self.grid.dims[axis]);
        let width = DVec3::from_array(is_inner.map(|is_inner| if is_inner { WIDTH } else { 0.0 }));
        let mut random = Random::new(u64::from(node) ^ 0x5ca7_7e12);
        let turn = turn(&mut random);
        let shift = DVec3::from_array([(); 3].map(|()| random.unit()));
        std::array::from_fn(|half| {
            let mut row = Row { once: vec![0.0; self.positions * self.occluding.len()], ..Row::default() };
            for ray in (half..self.directions).step_by(2) {
                let direction = turn * sky_direction(ray, self.directions);
                let within = width * ((shift + count(ray) * SPREAD).fract() - 0.5);
                let place = ((middle + within - self.grid.offset) / self.grid.scale).to_array();
                self.gather(place, direction, random.unit(), scratch, &mut row);
            }
            for &column in &row.columns {
                scratch.places[column as usize] = NONE;
            }
            row
        })
    }

    /// Adds to `row` what a ray gathers, whose steps begin a part `phase` of a step before `place`.
    fn gather(&self, place: [f64; 3], direction: DVec3, phase: f64, scratch: &mut Scratch, row: &mut Row) {
        let Self { scatterer, samples, step: length, .. } = *self;
        let numbers = self.occluding.len();
        let shares = scatterer.shares();
        let share_of_ray = 2.0 / count(self.directions);
        let way = scatterer.way(place, direction);
        let [begin, end] = way.range;
        let per_step = std::array::from_fn(|axis| way.at(length)[axis] - way.at(0.0)[axis]);
        let mut transmittance: SmallVec<[f64; 8]> =
            smallvec::smallvec![1.0; scatterer.planned.plan.transmittance_numbers()];
        let (mut number, mut leave) = (0_usize, 0_usize);
        loop {
            let from = ((count(number) - phase) * length).max(0.0) + begin;
            let to = ((count(number + 1) - phase) * length + begin).min(end);
            if from >= end {
                break;
            }
            let middle = way.at(f64::midpoint(from, to));
            if number >= leave {
                let (occupied, ahead) = samples.ahead(middle, per_step);
                if !occupied {
                    number += ahead.max(1);
                    continue;
                }
                leave = number.saturating_add(ahead);
            }
            number += 1;
            let Scratch { places, density, step, light } = scratch;
            scatterer.density(samples, middle, density);
            if density.does_nothing() {
                continue;
            }
            scatterer.cross(density, to - from, step);
            let ends = transmittance.iter().zip(&step.opacity).all(|(left, lost)| left * (1.0 - lost) < END);
            let column = self.column(middle);
            if column != NONE {
                let place = &mut places[column as usize];
                if *place == NONE {
                    *place = unsigned(row.columns.len());
                    row.columns.push(column);
                    row.factors.resize(row.factors.len() + numbers, 0.0);
                }
                light.fill(0.0);
                scatterer.arrive(self.arriving, middle, samples, light);
                let factors = &mut row.factors[*place as usize * numbers..][..numbers];
                let source = scatterer.scattered(step);
                for (i, factor) in factors.iter_mut().enumerate() {
                    let number = if transmittance.len() == 1 { 0 } else { i };
                    let part = if ends { step.opacity[number].max(f64::MIN_POSITIVE) } else { 1.0 };
                    let left = transmittance[number] / part;
                    let gathered = share_of_ray * left * source[i] * self.occluding[i];
                    *factor += rounded(gathered);
                    for position in 0..self.positions {
                        let arrived = light[position * shares + if shares == 1 { 0 } else { i }];
                        row.once[position * numbers + i] += gathered * arrived;
                    }
                }
            }
            if ends {
                return;
            }
            for (left, &lost) in transmittance.iter_mut().zip(&step.opacity) {
                *left -= *left * lost;
            }
        }
        row.open += share_of_ray * transmittance[0];
    }

    /// Number of the node next to a place, if it has a row.
    fn column(&self, place: [f64; 3]) -> u32 {
        let [width, height, _] = self.grid.dims;
        let node: [usize; 3] = std::array::from_fn(|axis| {
            let node = place[axis].mul_add(self.grid.scale[axis], self.grid.offset[axis]);
            whole((node + 0.5).floor().max(1.0)).min(self.grid.dims[axis] - 2)
        });
        self.rows[node[0] + width * (node[1] + height * node[2])]
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
