//! Light that has scattered before, at the nodes of a grid (docs/theory/scattering.md).

use super::rows::{Matrix, Rows};
use super::scatterer::{Numbers, is_sky, lit_from};
use super::shadows::read;
use super::{ReferenceError, Samples};
use crate::plan::{LANE, Planned, Transmittance};
use crate::tables::{LabelMap, LightGrid, Storage};
use crate::{Half, Scene};
use relume_base::number::Real;
use relume_base::parallel;
use relume_base::progress::Progress;

/// Largest part of the light that an iteration may still change when a solution ends.
const RESIDUAL: f64 = 1e-5;
/// Smallest part of its own light that a node is taken to lose: rounding leaves none of a deep cell without absorption.
const LEAST_LOSS: f64 = 1e-6;
/// Most iterations of a solution.
const MOST_ITERATIONS: usize = 2000;

/// Mean intensity of the light that has scattered before, of a unit light at each position, at the nodes of a grid.
#[derive(Clone, Debug, PartialEq)]
pub struct GatheredLight {
    /// The grid.
    pub grid: LightGrid,
    /// The light of each node, x fastest: for each accumulator its components.
    pub layers: Vec<Vec<f64>>,
    /// Components of an accumulator.
    pub components: usize,
    /// Largest number of iterations of a component.
    pub iterations: usize,
}

/// What the nodes of a grid gather from one another and from the lights of a scene, whatever the spectra of these and, in grey media, of its
/// materials.
#[derive(Debug)]
pub struct TransferRows {
    rows: Rows,
    /// Materials of the numbers of factors; empty if these are components.
    materials: Vec<usize>,
    key: String,
}

/// The halves of the rays that are used.
const fn halves(half: Half) -> &'static [usize] {
    match half {
        Half::Both => &[0, 1],
        Half::Even => &[0],
        Half::Odd => &[1],
    }
}

/// Numbers of the factors of a plan.
fn numbers(planned: &Planned) -> Numbers {
    match planned.plan.transmittance {
        Transmittance::Grey => Numbers::Materials,
        Transmittance::Coloured | Transmittance::Mixed => Numbers::Components,
    }
}

/// Coefficients of the reflectances of these materials.
fn reflectances(scene: &Scene, planned: &Planned, materials: &[usize]) -> Vec<Vec<f64>> {
    let Some(model) = &planned.model else { return Vec::new() };
    let used = materials.iter().filter_map(|&material| scene.materials.get(material));
    used.map(|material| model.coefficients(material.reflectance.spectrum())).collect()
}

impl TransferRows {
    /// The rows of `scene`, whose first field is stored so.
    ///
    /// # Errors
    ///
    /// [`ReferenceError::Cancelled`], [`ReferenceError::LightGrid`].
    pub fn new(
        scene: &Scene,
        planned: &Planned,
        storage: &Storage,
        labels: Option<&LabelMap>,
        progress: &dyn Progress,
    ) -> Result<Self, ReferenceError> {
        let numbers = numbers(planned);
        let (rows, materials) = Rows::new(scene, planned, (storage, labels), numbers, progress)?;
        let materials = if numbers == Numbers::Materials { materials } else { Vec::new() };
        Ok(Self { rows, materials, key: Self::key(scene, planned) })
    }

    /// Everything that rows depend on apart from the voxels.
    #[must_use]
    pub fn key(scene: &Scene, planned: &Planned) -> String {
        let media: Vec<_> = scene.materials.iter().map(|material| (material.occludes, &material.absorption)).collect();
        let declared: Vec<_> =
            scene.declared().iter().map(|it| (it.label, it.material, it.opacity, it.absorption, &it.terms)).collect();
        let reflected = match numbers(planned) {
            Numbers::Materials => Vec::new(),
            Numbers::Components => reflectances(scene, planned, &planned.materials),
        };
        let grid = LightGrid::of_middles(scene, scene.scattering_spacing());
        let accuracy = (scene.accuracy.interpolation, scene.accuracy.labels, scene.scattering_directions());
        let fields = (scene.fields.terms(), scene.hidden, scene.overlap);
        let lights = lit_from(scene, planned);
        format!("{:?} {media:?} {declared:?} {fields:?} {grid:?} {accuracy:?} {reflected:?} {lights:?}", scene.transfer)
    }

    /// True if these are the rows of `scene`, of the same voxels.
    #[must_use]
    pub fn are_of(&self, scene: &Scene, planned: &Planned) -> bool {
        self.key == Self::key(scene, planned)
    }

    /// Nodes with a row, those of faces included, and pairs of nodes with a factor.
    #[must_use]
    pub fn counts(&self) -> [usize; 2] {
        [self.rows.nodes.len(), self.rows.factors()]
    }

    /// The light that scatters more than once by the reflectances of `scene`: no ray is sent.
    ///
    /// # Errors
    ///
    /// [`ReferenceError::Cancelled`], [`ReferenceError::Unsolved`].
    pub fn light(
        &self,
        scene: &Scene,
        planned: &Planned,
        progress: &dyn Progress,
    ) -> Result<GatheredLight, ReferenceError> {
        let Self { rows, materials, key: _ } = self;
        let components = planned.plan.components();
        let coefficients = reflectances(scene, planned, materials);
        let halves = halves(scene.scattering.half);
        let pairs = rows.pairs(halves);
        let of_component = |i: usize| -> Result<(Vec<Vec<f64>>, usize), ReferenceError> {
            if progress.cancelled() {
                return Err(ReferenceError::Cancelled);
            }
            let reflected: Vec<f64> =
                coefficients.iter().filter_map(|coefficients| coefficients.get(i)).copied().collect();
            let reflected = (!materials.is_empty()).then_some(&reflected[..]);
            let matrix = pairs.matrix(i, reflected);
            let mut most = 0;
            let of_position = |position: usize| {
                let first = if is_sky(planned, position) {
                    let mut first = vec![0.0; rows.nodes.len()];
                    matrix.apply(&rows.open(halves), &mut first);
                    first
                } else {
                    rows.once(halves, position, i, reflected)
                };
                let (mut light, iterations) = solved(&matrix, &first[..rows.inner])?;
                most = most.max(iterations);
                let mut gathered = vec![0.0; rows.nodes.len()];
                matrix.apply(&light, &mut gathered);
                let of_faces = gathered.iter().zip(&first).skip(rows.inner);
                light.extend(of_faces.map(|(gathered, first)| gathered + first));
                Ok(light)
            };
            let layers = (0..planned.positions.len()).map(of_position).collect::<Result<_, ReferenceError>>()?;
            Ok((layers, most))
        };
        let solutions = parallel::map(components, &of_component).into_iter().collect::<Result<Vec<_>, _>>()?;
        let mut gathers = vec![false; rows.grid.dims.iter().product()];
        rows.nodes.iter().for_each(|&node| gathers[node as usize] = true);
        let dims = rows.grid.dims;
        let layout = Layout { dims, strides: [1, dims[0], dims[0] * dims[1]] };
        let layer = |layer: usize| {
            let mut on_grid = vec![0.0; gathers.len()];
            let light = solutions[layer % components].0[layer / components].iter();
            rows.nodes.iter().zip(light).for_each(|(&node, &light)| on_grid[node as usize] = light);
            layout.interpolated(on_grid, &gathers)
        };
        Ok(GatheredLight {
            layers: (0..planned.positions.len() * components).map(layer).collect(),
            components,
            iterations: solutions.iter().map(|(_, iterations)| *iterations).max().unwrap_or(0),
            grid: rows.grid,
        })
    }
}

impl GatheredLight {
    /// Everything that the light depends on apart from the voxels: that of its rows, and the reflectances.
    #[must_use]
    pub fn key(scene: &Scene, planned: &Planned) -> String {
        let reflected = reflectances(scene, planned, &planned.materials);
        format!("{} {:?} {reflected:?}", TransferRows::key(scene, planned), scene.scattering.half)
    }

    /// Texels of four components as bits of 16-bit floats, node by node, of each accumulator one grid of the first four and those of the next behind.
    #[must_use]
    pub fn texels(&self) -> Vec<[u16; LANE]> {
        let nodes: usize = self.grid.dims.iter().product();
        let lanes = self.layers.chunks(self.components.max(1)).flat_map(|layers| layers.chunks(LANE));
        let texel = |lane: &[Vec<f64>], node: usize| {
            std::array::from_fn(|i| half::f16::from_f64(lane.get(i).map_or(0.0, |layer| layer[node])).to_bits())
        };
        lanes.flat_map(|lane| (0..nodes).map(move |node| texel(lane, node))).collect()
    }
}

/// Part of the difference between the light of a face and the line through the two nodes before it by which the light of the face is
/// raised, so that the mean between face and node is right: light falls steeply before a face (docs/theory/scattering.md).
const RAISED: f64 = 0.7;
/// Part of the second difference that nodes leave out, so that the mean of what is interpolated over a cell is the light of its node.
const SECOND_DIFFERENCE: f64 = 1.0 / 8.0;

/// Nodes of a grid as an array.
struct Layout {
    dims: [usize; 3],
    strides: [usize; 3],
}

impl Layout {
    fn is_beyond(&self, node: usize, axis: usize) -> bool {
        let at = node / self.strides[axis] % self.dims[axis];
        at == 0 || at + 1 == self.dims[axis]
    }

    fn inwards(&self, node: usize, axis: usize) -> usize {
        if (node / self.strides[axis]).is_multiple_of(self.dims[axis]) {
            node + self.strides[axis]
        } else {
            node - self.strides[axis]
        }
    }

    /// Sets the nodes beyond faces to those that give the light `of_faces` on the faces, and those beyond edges and corners by the sum of
    /// the changes along the axes.
    fn extend(&self, layer: &mut [f64], of_faces: &[f64]) {
        for axes in 1..=3 {
            for node in 0..layer.len() {
                let mut outside = (0..3).filter(|&axis| self.is_beyond(node, axis));
                if outside.clone().count() != axes {
                    continue;
                }
                let Some(first) = outside.next() else { continue };
                let one = self.inwards(node, first);
                let light = match outside.next() {
                    None => 2.0 * of_faces[node] - layer[one],
                    Some(second) => layer[one] + layer[self.inwards(node, second)] - layer[self.inwards(one, second)],
                };
                layer[node] = light.max(0.0);
            }
        }
    }

    /// The light that a march interpolates, of `layer`, whose nodes beyond a face hold the light of the face: less a part of the second
    /// difference, and with nodes beyond the faces.
    fn interpolated(&self, mut layer: Vec<f64>, gathers: &[bool]) -> Vec<f64> {
        let mut of_faces = layer.clone();
        for node in 0..layer.len() {
            let mut outside = (0..3).filter(|&axis| self.is_beyond(node, axis));
            let (Some(axis), None) = (outside.next(), outside.next()) else { continue };
            let first = self.inwards(node, axis);
            let second = if self.dims[axis] > 3 { 2 * first - node } else { first };
            if !gathers[node] {
                of_faces[node] = layer[first];
            } else if gathers[second] {
                let line = 1.5_f64.mul_add(layer[first], -0.5 * layer[second]);
                of_faces[node] += RAISED * (line - layer[node]).max(0.0);
            }
        }
        self.extend(&mut layer, &of_faces);
        let is_inner = |node: usize| gathers[node] && !(0..3).any(|axis| self.is_beyond(node, axis));
        let at = |node: usize| {
            if !is_inner(node) {
                return layer[node];
            }
            let second = |stride: &usize| {
                let [before, after] = [node - stride, node + stride];
                if is_inner(before) && is_inner(after) { layer[before] + layer[after] - 2.0 * layer[node] } else { 0.0 }
            };
            (layer[node] - SECOND_DIFFERENCE * self.strides.iter().map(second).sum::<f64>()).max(0.0)
        };
        let mut interpolated: Vec<f64> = (0..layer.len()).map(at).collect();
        self.extend(&mut interpolated, &of_faces);
        interpolated
    }
}

/// The light J = first + A J of a matrix A whose rows have sums below 1, and the number of iterations: the stabilised method of
/// biconjugate gradients (van der Vorst 1992) for rows divided by 1 less their diagonal, whose sums are in the order of the nodes.
fn solved(matrix: &Matrix<'_>, first: &[f64]) -> Result<(Vec<f64>, usize), ReferenceError> {
    let nodes = first.len();
    let scale: Vec<f64> = matrix.diagonal(nodes).iter().map(|own| 1.0 / (1.0 - own).max(LEAST_LOSS)).collect();
    let apply = |light: &[f64], product: &mut [f64]| {
        matrix.apply(light, product);
        let rows = product.iter_mut().zip(light).zip(&scale);
        rows.for_each(|((product, &light), scale)| *product = scale * (light - *product));
    };
    let largest = |numbers: &[f64]| numbers.iter().fold(0.0_f64, |most, number| most.max(number.abs()));
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let first: Vec<f64> = first.iter().zip(&scale).map(|(first, scale)| first * scale).collect();
    let mut light = first.clone();
    let (mut through, mut turned) = (vec![0.0; nodes], vec![0.0; nodes]);
    let mut iterations = 0;
    // The method may break down, and begins again then.
    while iterations < MOST_ITERATIONS {
        apply(&light, &mut through);
        let mut residual: Vec<f64> = first.iter().zip(&through).map(|(first, product)| first - product).collect();
        let (begun, mut towards) = (residual.clone(), residual.clone());
        let mut rho = dot(&begun, &residual);
        while iterations < MOST_ITERATIONS {
            if largest(&residual) <= RESIDUAL * largest(&light) {
                return Ok((light, iterations));
            }
            iterations += 1;
            apply(&towards, &mut through);
            let alpha = rho / dot(&begun, &through);
            residual.iter_mut().zip(&through).for_each(|(residual, through)| *residual -= alpha * through);
            apply(&residual, &mut turned);
            let omega = dot(&turned, &residual) / dot(&turned, &turned).max(f64::MIN_POSITIVE);
            if !alpha.is_finite() || !omega.is_finite() {
                break;
            }
            let sums = light.iter_mut().zip(&towards).zip(&mut residual).zip(&turned);
            for (((light, towards), residual), turned) in sums {
                *light += alpha.mul_add(*towards, omega * *residual);
                *residual -= omega * turned;
            }
            let next = dot(&begun, &residual);
            let beta = (next / rho) * (alpha / omega);
            if !beta.is_finite() {
                break;
            }
            rho = next;
            let sums = towards.iter_mut().zip(&residual).zip(&through);
            sums.for_each(|((towards, &residual), &through)| {
                *towards = beta.mul_add(*towards - omega * through, residual);
            });
        }
    }
    Err(ReferenceError::Unsolved { iterations: MOST_ITERATIONS })
}

/// [`GatheredLight`] as a march reads it.
#[derive(Debug)]
pub(super) struct Gathered<R> {
    grid: LightGrid,
    layers: Vec<Vec<R>>,
    components: usize,
}

impl<R: Real> Gathered<R> {
    /// The light of `gathered`, as `samples` would store it.
    pub(super) fn new(gathered: &GatheredLight, components: usize, samples: &dyn Samples<R>) -> Self {
        let stored = |light: &f64| samples.stored_depth(R::from_f64(*light));
        let layers = gathered.layers.iter().map(|layer| layer.iter().map(stored).collect()).collect();
        Self { grid: gathered.grid, layers, components }
    }

    /// Adds to `source` what `unshaded`, a step's light that is not shaded, scatters of the light of an accumulator at `place`.
    pub(super) fn add(&self, accumulator: usize, place: [R; 3], unshaded: &[R], source: &mut [R]) {
        let layers = self.layers[accumulator * self.components..].iter();
        for ((sum, &own), layer) in source.iter_mut().zip(unshaded).zip(layers) {
            *sum = own.mul_add(read(&self.grid, layer, place), *sum);
        }
    }
}
