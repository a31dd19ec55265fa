//! Samples of the volume: exact, or with the device's tables and textures.

use super::gradient::{exact_thinning, gradient_factor, thin, thinning};
use crate::number::{Real, count, unit};
use crate::plan::Planned;
use crate::scene::{Interpolation, Lookup, Scene};
use crate::tables::{self, GradientTable, LabelMap, Steps, Storage, StoredVolume, TransferTable};
use crate::volume::Volume;

/// Effect of one step at a sample, in the layout of a table entry.
#[derive(Clone, Debug, Default)]
pub struct Step<R> {
    /// Light added by the step.
    pub source: Vec<R>,
    /// Light removed by the step: as many numbers as the plan's transmittance.
    pub opacity: Vec<R>,
    /// Unit gradient of the data in the volume's axes; 0 if it vanishes or the plan needs none.
    pub normal: [R; 3],
}

impl<R: Real> Step<R> {
    /// Whether the step neither adds nor removes light.
    pub(super) fn does_nothing(&self) -> bool {
        let nothing = R::default();
        self.opacity.iter().chain(&self.source).all(|&number| number == nothing)
    }
}

/// A source of samples.
pub trait Samples<R: Real>: Sync {
    /// Sets `step` to the effect of a step at `place`, in texture coordinates.
    fn sample(&self, place: [R; 3], step: &mut Step<R>);
}

/// The scene itself: transfer function without a table, volume without a texture.
#[derive(Debug)]
pub struct Exact<'a> {
    scene: &'a Scene,
    planned: &'a Planned,
    storage: Storage,
    labels: Option<&'a LabelMap>,
    steps: Steps<'a>,
    label_steps: Vec<tables::Step>,
}

impl<'a> Exact<'a> {
    /// Creates samples of `scene`. `storage` defines the values of NaN and ±∞.
    #[must_use]
    pub fn new(scene: &'a Scene, planned: &'a Planned, storage: Storage, labels: Option<&'a LabelMap>) -> Self {
        let steps = Steps::new(scene, planned);
        let label_steps = steps.of_labels();
        Self { scene, planned, storage, labels, steps, label_steps }
    }

    /// Returns the data value at `place`, in texture coordinates, and the label that overrides it: its index among the
    /// scene's declared labels.
    #[must_use]
    pub fn at(&self, place: [f64; 3]) -> (f64, Option<usize>) {
        let dims = self.scene.volume.geometry.dims;
        let interpolation = self.scene.accuracy.interpolation;
        let normalised = interpolate(place, dims, interpolation, |index| [self.voxel(index)])[0];
        let row = self.labels.map_or(0, |labels| labels.rows[nearest(place, dims)]);
        let [low, high] = self.storage.domain;
        ((high - low).mul_add(normalised, low), usize::from(row).checked_sub(1))
    }

    /// The factor on the medium at `place` by the gradient magnitude; 1 if the plan has none.
    #[must_use]
    pub fn gradient_factor(&self, place: [f64; 3]) -> f64 {
        if self.planned.plan.gradient_opacity == 0 {
            return 1.0;
        }
        let [low, high] = self.storage.domain;
        let gradient = glam::DVec3::from_array(self.gradient_at(place));
        self.scene.transfer.gradient_factor((high - low) * gradient.length())
    }

    /// Derivatives of the normalised value at `place`, per world unit.
    fn gradient_at(&self, place: [f64; 3]) -> [f64; 3] {
        let dims = self.scene.volume.geometry.dims;
        interpolate(place, dims, self.scene.accuracy.interpolation, |index| self.gradient(index))
    }

    /// Normalised value of a voxel; indices are clamped to the grid.
    fn voxel(&self, index: [i64; 3]) -> f64 {
        let volume: &Volume = &self.scene.volume;
        let place = clamped(index, volume.geometry.dims);
        volume.voxels.value(place).map_or(0.0, |stored| self.storage.normalised(stored))
    }

    /// Derivatives of the normalised value at a voxel, per world unit: central, one-sided at faces, 0 along an axis of
    /// one voxel.
    fn gradient(&self, index: [i64; 3]) -> [f64; 3] {
        let geometry = &self.scene.volume.geometry;
        std::array::from_fn(|axis| {
            let last = geometry.dims[axis] as i64 - 1;
            let (mut before, mut after) = (index, index);
            let here = index[axis].clamp(0, last);
            before[axis] = (here - 1).max(0);
            after[axis] = (here + 1).min(last);
            let voxels = match after[axis] - before[axis] {
                0 => return 0.0,
                1 => 1.0,
                _ => 2.0,
            };
            (self.voxel(after) - self.voxel(before)) / (voxels * geometry.spacing[axis])
        })
    }
}

impl Samples<f64> for Exact<'_> {
    fn sample(&self, place: [f64; 3], step: &mut Step<f64>) {
        let (value, label) = self.at(place);
        let found = label.map_or_else(|| self.steps.of_value(value), |label| self.label_steps[label + 1].clone());
        step.source.clone_from(&found.source);
        step.opacity.clone_from(&found.opacity);
        step.opacity.truncate(self.planned.plan.transmittance_numbers());
        if self.planned.plan.gradient() {
            step.normal = unit(self.gradient_at(place));
        }
        if label.is_none() {
            thin(
                [&mut step.source, &mut step.opacity],
                &self.planned.plan,
                self.gradient_factor(place),
                exact_thinning,
            );
        }
    }
}

/// Stored tables and volume, read as in the shader. Twin of `sample` in `shaders/march.wgsl`.
#[derive(Debug)]
pub struct Stored<'a, R> {
    planned: &'a Planned,
    volume: &'a StoredVolume,
    table: &'a TransferTable,
    labels: Option<(&'a LabelMap, &'a TransferTable)>,
    gradients: GradientTable,
    coordinate_scale: R,
    coordinate_offset: R,
    gradient_scale: [R; 3],
}

impl<'a, R: Real> Stored<'a, R> {
    /// Creates samples of stored tables and a stored volume.
    #[must_use]
    pub fn new(
        planned: &'a Planned,
        storage: &Storage,
        volume: &'a StoredVolume,
        table: &'a TransferTable,
        labels: Option<(&'a LabelMap, &'a TransferTable)>,
        gradients: GradientTable,
    ) -> Self {
        let [scale, offset] = table.coordinate_from_texel(storage);
        Self {
            planned,
            volume,
            table,
            labels,
            gradients,
            coordinate_scale: R::from_f64(scale),
            coordinate_offset: R::from_f64(offset),
            gradient_scale: storage.gradient_scale().map(R::from_f64),
        }
    }
}

impl<R: Real> Samples<R> for Stored<'_, R> {
    fn sample(&self, place: [R; 3], step: &mut Step<R>) {
        let volume = self.volume;
        let parts = if volume.has_gradient { 4 } else { 1 };
        let texel = |index| -> [R; 4] {
            let first = clamped(index, volume.dims) * parts;
            std::array::from_fn(|part| {
                R::from_f64(volume.texels.get(first + part.min(parts - 1)).copied().map_or(0.0, f64::from))
            })
        };
        let fetched = interpolate(place, volume.dims, self.planned.plan.interpolation, texel);
        let value = fetched[if volume.has_gradient { 3 } else { 0 }];
        let mut gradient = [R::default(); 3];
        if volume.has_gradient {
            gradient = std::array::from_fn(|axis| fetched[axis] * self.gradient_scale[axis]);
        } else if self.planned.plan.gradient() {
            let at = |place| interpolate(place, volume.dims, self.planned.plan.interpolation, texel)[0];
            gradient = std::array::from_fn(|axis| {
                let voxel = R::from_f64(1.0 / count(volume.dims[axis]));
                let (mut before, mut after) = (place, place);
                before[axis] = place[axis] - voxel;
                after[axis] = place[axis] + voxel;
                (at(after) - at(before)) * self.gradient_scale[axis]
            });
        }
        step.normal = unit(gradient);
        let row = self.labels.map_or(0, |(labels, _)| labels.rows[nearest(place, volume.dims)]);
        if let (Some((_, table)), true) = (self.labels, row > 0) {
            entry(table, usize::from(row), step);
        } else {
            let last = R::from_f64(count(self.table.entries() - 1));
            let coordinate = value.mul_add(self.coordinate_scale, self.coordinate_offset).max(R::default()).min(last);
            self.look_up(coordinate, step);
            if self.planned.plan.gradient_opacity > 0 {
                thin(
                    [&mut step.source, &mut step.opacity],
                    &self.planned.plan,
                    gradient_factor(&self.gradients, gradient),
                    thinning,
                );
            }
        }
        step.opacity.truncate(self.planned.plan.transmittance_numbers());
    }
}

impl<R: Real> Stored<'_, R> {
    /// Reads the table at `coordinate`. Twin of `look_up` in `shaders/march.wgsl`.
    fn look_up(&self, coordinate: R, step: &mut Step<R>) {
        match self.planned.plan.lookup {
            Lookup::Nearest => entry(self.table, (coordinate + R::from_f64(0.5)).floor().index(), step),
            Lookup::Linear => {
                let before = coordinate.floor().index().min(self.table.entries() - 2);
                let fraction = coordinate - R::from_f64(count(before));
                entry(self.table, before, step);
                let mut after = Step::<R>::default();
                entry(self.table, before + 1, &mut after);
                let numbers = step.source.iter_mut().chain(&mut step.opacity);
                for (number, after) in numbers.zip(after.source.into_iter().chain(after.opacity)) {
                    *number = fraction.mul_add(after - *number, *number);
                }
            }
        }
    }
}

/// Sets `step` to entry `i` of a table.
fn entry<R: Real>(table: &TransferTable, i: usize, step: &mut Step<R>) {
    let number = |&number: &f32| R::from_f64(f64::from(number));
    step.source.clear();
    step.source.extend(table.source[i * table.lanes..][..table.lanes].iter().flatten().map(number));
    step.opacity.clear();
    step.opacity.extend(table.opacity[i * table.opacity_numbers..][..table.opacity_numbers].iter().map(number));
}

/// Interpolates `texel` at `place` (texture coordinates), x first, or returns the nearest texel.
fn interpolate<R: Real, const N: usize>(
    place: [R; 3],
    dims: [usize; 3],
    interpolation: Interpolation,
    texel: impl Fn([i64; 3]) -> [R; N],
) -> [R; N] {
    let voxel: [R; 3] =
        std::array::from_fn(|axis| place[axis].mul_add(R::from_f64(count(dims[axis])), R::from_f64(-0.5)));
    if interpolation == Interpolation::Nearest {
        return texel(voxel.map(|place| whole((place + R::from_f64(0.5)).floor())));
    }
    let base = voxel.map(Real::floor);
    let fraction: [R; 3] = std::array::from_fn(|axis| voxel[axis] - base[axis]);
    let base = base.map(whole);
    if interpolation == Interpolation::Cubic {
        let [x, y, z] = fraction.map(cubic_weights);
        let mix = |weights: [R; 4], parts: [[R; N]; 4]| -> [R; N] {
            std::array::from_fn(|i| {
                let sum = |sum: R, (weight, part): (&R, &[R; N])| *weight * part[i] + sum;
                weights.iter().zip(&parts).fold(R::default(), sum)
            })
        };
        let around = |at: i64| [at - 1, at, at + 1, at + 2];
        let line = |y, z| mix(x, around(base[0]).map(|x| texel([x, y, z])));
        let plane = |z| mix(y, around(base[1]).map(|y| line(y, z)));
        return mix(z, around(base[2]).map(plane));
    }
    let lerp = |a: [R; N], b: [R; N], f: R| -> [R; N] { std::array::from_fn(|i| f.mul_add(b[i] - a[i], a[i])) };
    let at = |x: i64, y: i64, z: i64| texel([base[0] + x, base[1] + y, base[2] + z]);
    let line = |y, z| lerp(at(0, y, z), at(1, y, z), fraction[0]);
    let plane = |z| lerp(line(0, z), line(1, z), fraction[1]);
    lerp(plane(0), plane(1), fraction[2])
}

/// Weights of the four voxels around a position in a cubic B-spline.
fn cubic_weights<R: Real>(f: R) -> [R; 4] {
    let number = R::from_f64;
    let rest = number(1.0) - f;
    let first = rest * rest * rest / number(6.0);
    let last = f * f * f / number(6.0);
    let second = (number(3.0) * f - number(6.0)).mul_add(f * f, number(4.0)) / number(6.0);
    [first, second, number(1.0) - first - second - last, last]
}

/// Converts a whole number to an integer.
#[expect(clippy::cast_possible_truncation, reason = "voxel indices are small")]
fn whole<R: Real>(value: R) -> i64 {
    value.to_f64() as i64
}

/// Linear index of the voxel that contains `place`.
fn nearest<R: Real>(place: [R; 3], dims: [usize; 3]) -> usize {
    let index = std::array::from_fn(|axis| whole((place[axis] * R::from_f64(count(dims[axis]))).floor()));
    clamped(index, dims)
}

/// Linear index of a voxel; indices are clamped to the grid.
fn clamped(index: [i64; 3], dims: [usize; 3]) -> usize {
    let on: [usize; 3] = std::array::from_fn(|axis| usize::try_from(index[axis]).unwrap_or(0).min(dims[axis] - 1));
    on[0] + dims[0] * (on[1] + dims[1] * on[2])
}
