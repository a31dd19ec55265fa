//! Samples of the volume: exact, or with the device's tables and textures.

use std::ops::Range;

use super::clip::Planes;
use super::factors::{coordinates_of, factors_at, sum_groups};
use super::kept::{Keeping, KeptDepths};
use crate::plan::{LANE, Planned};
use crate::tables::{
    self, CROSSING_CELLS, CapTable, CrossingTable, ExtinctionTable, FactorTable, LabelMap, LabelTable, PlacedField,
    SegmentTable, Steps, Storage, StoredScene, StoredVolume, TransferTable, gradient_numbers,
};
use crate::{FIELDS, Interpolation, LabelEntry, Lookup, Medium, Scene};
use relume_base::number::{Real, count, dot, unit};
use relume_volume::Volume;
use smallvec::{SmallVec, smallvec};

/// Effect of one step at a sample, or the density of the medium there, in the layout of a table entry.
#[derive(Clone, Debug, Default)]
pub struct Step<R> {
    /// Light added by the step; of a density, light scattered per step length.
    pub source: Vec<R>,
    /// Light removed by the step, or optical depth per step length: as many numbers as the plan's transmittance.
    pub opacity: Vec<R>,
    /// Light of each further field with normals of its own, which is not in the source.
    pub others: Vec<Vec<R>>,
    /// [`Samples::normal`], where a march needs it.
    pub normal: [R; 3],
    /// Set by a march: the part of the step that planes leave of each field by itself. Empty if they leave all alike.
    pub parts: SmallVec<[R; FIELDS]>,
    /// Memory of [`Exact`] from step to step.
    memory: [tables::Step; 2],
}

impl<R: Real> Step<R> {
    /// Adds `share` of the light and the opacity of `other`.
    fn add(&mut self, share: R, other: &Self) {
        let numbers = self.source.iter_mut().zip(&other.source).chain(self.opacity.iter_mut().zip(&other.opacity));
        numbers.for_each(|(sum, &number)| *sum = share.mul_add(number, *sum));
    }

    /// Multiplies light and opacity by `share`.
    fn scale(&mut self, share: R) {
        self.source.iter_mut().chain(&mut self.opacity).for_each(|number| *number = share * *number);
    }

    /// The part of the step that is left of a field.
    fn part_of(&self, field: usize) -> R {
        self.parts.get(field).copied().unwrap_or_else(|| R::from_f64(1.0))
    }

    /// Adds the opacity of `other`, and keeps its source apart.
    fn add_other(&mut self, other: &mut Self) {
        self.opacity.iter_mut().zip(&other.opacity).for_each(|(sum, &depth)| *sum = *sum + depth);
        self.others.push(std::mem::take(&mut other.source));
    }

    /// Whether the step neither adds nor removes light.
    pub(super) fn does_nothing(&self) -> bool {
        let nothing = R::default();
        let others = self.others.iter().flatten();
        self.opacity.iter().chain(&self.source).chain(others).all(|&number| number == nothing)
    }
}

/// The volume at an end of a segment.
#[derive(Clone, Copy, Debug, Default)]
pub struct End<R> {
    /// The value of the data, or its table coordinate.
    pub value: R,
    /// Gradient of the data in the volume's axes; 0 if the plan needs none.
    pub gradient: [R; 3],
    /// Gradient of a fall from the value to the lowest of the data within two units of length; 0 if the plan needs none.
    pub fall: R,
    /// The labels around.
    pub label: Label,
}

/// The labels around a place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Label {
    /// None.
    #[default]
    None,
    /// The one with this row in the label table.
    Row(usize),
    /// Several, or none for a part.
    Mixed,
}

/// Rows in the label table (0 without a label) and their shares of a place: one row, or those of the eight voxels around.
#[derive(Clone, Copy, Debug)]
enum Shares<R> {
    One(usize),
    Mixed([(usize, R); 8]),
}

impl<R: Real> Shares<R> {
    /// The labels at `place`, in texture coordinates. Twin of `share_of` in `shaders/whole.wgsl`.
    fn at(map: Option<&LabelMap>, planned: &Planned, dims: [usize; 3], place: [R; 3]) -> Self {
        let Some(map) = map else { return Self::One(0) };
        if !planned.plan.smooth_labels {
            return Self::One(usize::from(map.rows[nearest(place, dims)]));
        }
        let voxel: [R; 3] =
            std::array::from_fn(|axis| place[axis].mul_add(R::from_f64(count(dims[axis])), R::from_f64(-0.5)));
        let base = voxel.map(Real::floor);
        let shares: [(usize, R); 8] = std::array::from_fn(|i| {
            let side: [bool; 3] = std::array::from_fn(|axis| i >> axis & 1 == 1);
            let [x, y, z] = std::array::from_fn(|axis| {
                let fraction = voxel[axis] - base[axis];
                if side[axis] { fraction } else { R::from_f64(1.0) - fraction }
            });
            let index = std::array::from_fn(|axis| whole(base[axis]) + i64::from(side[axis]));
            (usize::from(map.rows[clamped(index, dims)]), x * y * z)
        });
        let first = shares[0].0;
        if shares.iter().all(|share| share.0 == first) { Self::One(first) } else { Self::Mixed(shares) }
    }

    fn label(&self) -> Label {
        match self {
            Self::One(0) => Label::None,
            Self::One(row) => Label::Row(*row),
            Self::Mixed(_) => Label::Mixed,
        }
    }

    /// Whether a part of the place has no label.
    fn has_own(&self) -> bool {
        match self {
            Self::One(row) => *row == 0,
            Self::Mixed(shares) => shares.iter().any(|share| share.0 == 0),
        }
    }

    /// Sum of `own` and the numbers of the labels, `of_row(row)`, by their shares.
    fn number(&self, own: impl FnOnce() -> R, of_row: impl Fn(usize) -> R) -> R {
        match self {
            Self::One(0) => own(),
            Self::One(row) => of_row(*row),
            Self::Mixed(shares) => {
                let own_share = self.own_share();
                let labelled = shares.iter().filter(|share| share.0 > 0);
                let sum = labelled.fold(R::default(), |sum, &(row, share)| share.mul_add(of_row(row), sum));
                if self.has_own() { own_share.mul_add(own(), sum) } else { sum }
            }
        }
    }

    fn own_share(&self) -> R {
        match self {
            Self::One(row) => R::from_f64(if *row == 0 { 1.0 } else { 0.0 }),
            Self::Mixed(shares) => {
                shares.iter().filter(|share| share.0 == 0).fold(R::default(), |sum, &(_, share)| sum + share)
            }
        }
    }

    /// Replaces `own`, the step or density without labels, by the sum of it and of those of the labels, by their shares.
    /// `of_row` sets a step to that of a row. Twin of `shared_by_labels` in `shaders/labelled.wgsl`.
    fn mix(&self, own: &mut Step<R>, of_row: impl Fn(usize, &mut Step<R>)) {
        match self {
            Self::One(0) => {}
            Self::One(row) => of_row(*row, own),
            Self::Mixed(shares) => {
                let own_share = self.own_share();
                let mut shared = Step { normal: own.normal, parts: own.parts.clone(), ..Step::default() };
                let mut labelled = Step::default();
                for &(row, share) in shares {
                    of_row(row, &mut labelled);
                    shared.source.resize(labelled.source.len(), R::default());
                    shared.opacity.resize(labelled.opacity.len(), R::default());
                    shared.add(share, &labelled);
                }
                shared.add(own_share, own);
                *own = shared;
            }
        }
    }
}

/// The value of each field at a place, as a source of samples holds it; none outside the box of a field.
pub type Values<R> = SmallVec<[Option<R>; FIELDS]>;

/// A unit vector for each further field with normals of its own.
pub type Normals<R> = SmallVec<[[R; 3]; FIELDS]>;

/// A source of samples.
pub trait Samples<R: Real>: Sync {
    /// Sets the source and the opacity of `step` to those of a step at `place`, in texture coordinates, or of the density there if the
    /// plan adds densities ([`ScenePlan::adds_densities`](crate::plan::ScenePlan::adds_densities)).
    fn sample(&self, place: [R; 3], step: &mut Step<R>);

    /// The values at `place`, in texture coordinates, for plans that see the extreme ones. None without any field.
    fn values(&self, _place: [R; 3]) -> Values<R> {
        Values::new()
    }

    /// Sets `density` to that of the media where the fields have these [`Self::values`].
    fn density_of(&self, _values: &[Option<R>], density: &mut Step<R>) {
        *density = Step::default();
    }

    /// Unit vector along the gradient that shading sees at `place`, in the volume's axes; 0 if it vanishes or the plan needs none.
    fn normal(&self, place: [R; 3]) -> [R; 3];

    /// [`Self::normal`] of each further field with normals of its own.
    fn normals_of_others(&self, _place: [R; 3]) -> Normals<R> {
        Normals::new()
    }

    /// The same in the `middle` between two ends.
    fn normal_between(&self, ends: [&End<R>; 2], _middle: [R; 3]) -> [R; 3] {
        unit(middle_of(ends))
    }

    /// The end of a segment at `place`, in texture coordinates.
    fn end(&self, place: [R; 3]) -> End<R>;

    /// Sets `density` to the mean density between two ends: light scattered per step length, and optical depth per step
    /// length as its opacity. The labels at `middle` have their shares. Returns the variation of the density: the largest
    /// sum over its numbers of the differences between the mean and both ends; 1 where a label begins or ends.
    fn mean(&self, ends: [&End<R>; 2], middle: [R; 3], density: &mut Step<R>) -> R;

    /// The place of the value at `place` in the table of crossed intervals, for plans that count these.
    fn crossing(&self, _place: [R; 3]) -> Crossing<R> {
        Crossing::default()
    }

    /// Optical depth per unit of length (the smallest spacing) at `place`, for shadows: `number` 0 is that of all that is grey,
    /// the others are those of the plan's coloured absorbers.
    fn extinction(&self, place: [R; 3], number: usize) -> R;

    /// True if anything around `place` may be visible, and the number of steps of the ray through it, `step` in texture coordinates
    /// each, for which this holds.
    fn ahead(&self, _place: [R; 3], _step: [R; 3]) -> (bool, usize) {
        (true, usize::MAX)
    }

    /// A depth as the light grid keeps it.
    fn stored_depth(&self, depth: R) -> R {
        depth
    }

    /// Storage of the values of the first field, and labels: what samples of other plans of the same scene need. `None` of samples
    /// that come from no volume.
    fn volume(&self) -> Option<(&Storage, Option<&LabelMap>)> {
        None
    }

    /// Store of depths of light grids for further marches, if there is one.
    fn keeping(&self) -> Option<Keeping<'_, R>> {
        None
    }
}

/// A place in a [`CrossingTable`]. Twin of `crossing_at` in `shaders/refined.wgsl`.
#[derive(Clone, Copy, Debug, Default)]
pub struct Crossing<R> {
    /// In cells of the table.
    place: R,
    /// The sum over the values below.
    sum: R,
    /// The number there.
    own: R,
}

impl<R: Real> Crossing<R> {
    fn at(table: &CrossingTable, place: R) -> Self {
        let inside = place.max(R::default()).min(R::from_f64(count(CROSSING_CELLS)));
        let number = inside.floor().index().min(CROSSING_CELLS - 1);
        let [below, own, low, high] = table.cells[number].map(R::from_f64);
        let within = inside - R::from_f64(count(number));
        Self { place, sum: within.mul_add(own, below), own: within.mul_add(high - low, low) }
    }

    /// Distance of the mean between two values from the range of both numbers; less for values closer than two cells, and 0 within one.
    #[must_use]
    pub fn between(a: &Self, b: &Self) -> R {
        let distance = (b.place - a.place).abs();
        let (zero, one) = (R::default(), R::from_f64(1.0));
        let mean = (b.sum - a.sum).abs() / distance.max(one);
        let outside = (mean - a.own.max(b.own)).max(a.own.min(b.own) - mean).max(zero);
        outside * (distance - one).max(zero).min(one)
    }
}

/// The scene itself: transfer function without a table, volume without a texture.
#[derive(Debug)]
pub struct Exact<'a> {
    scene: &'a Scene,
    /// Of the first field.
    volume: &'a Volume,
    /// Further fields, and the places of those on grids of their own.
    further: Vec<(&'a Volume, Storage, Option<PlacedField>)>,
    planned: &'a Planned,
    storage: Storage,
    labels: Option<&'a LabelMap>,
    steps: Steps<'a>,
    /// Steps or densities of the rows of labels; of those by value, those at 0.
    label_steps: Vec<tables::Step>,
    bends: Vec<f64>,
    crossings: Option<CrossingTable>,
    /// If shading sees cut faces.
    clip: Option<Planes<f64>>,
    kept: Option<&'a KeptDepths<f64>>,
}

impl<'a> Exact<'a> {
    /// Creates samples of `scene`. `storage` defines the values of NaN and ±∞.
    #[must_use]
    pub fn new(scene: &'a Scene, planned: &'a Planned, storage: Storage, labels: Option<&'a LabelMap>) -> Self {
        let steps = Steps::new(scene, planned);
        let nothing = Medium::nothing(scene.materials.len());
        let media =
            std::iter::once(nothing).chain(scene.declared().iter().map(|it| it.medium(0.0, scene.materials.len())));
        let label_step = |medium: Medium| {
            let mut step = tables::Step::default();
            steps.write_label_of(&medium, [&mut step.source, &mut step.opacity]);
            step
        };
        let label_steps = media.map(label_step).collect();
        let bends = scene.transfer.bends();
        let clip = Planes::of_samples(planned, &CapTable::new(scene, &storage));
        let further = scene.fields.further().iter().map(|field| &*field.volume).zip(PlacedField::of_further(scene));
        let crossings = planned.plan.crossings.then(|| CrossingTable::new(scene, planned, storage.domain));
        Self {
            scene,
            volume: scene.volume(),
            further: (further.zip(Storage::of_further(&planned.plan, scene)))
                .map(|((volume, place), storage)| (volume, storage, place))
                .collect(),
            planned,
            storage,
            labels,
            steps,
            label_steps,
            bends,
            crossings,
            clip,
            kept: None,
        }
    }

    /// The same samples; their marches keep the depths of light grids in `kept`.
    #[must_use]
    pub fn keeping_depths(self, kept: &'a KeptDepths<f64>) -> Self {
        Self { kept: Some(kept), ..self }
    }

    /// Returns the data value at `place`, in texture coordinates, and the label of the nearest voxel: its index among
    /// the scene's declared labels.
    #[must_use]
    pub fn at(&self, place: [f64; 3]) -> (f64, Option<usize>) {
        let row = self.labels.map_or(0, |labels| labels.rows[nearest(place, self.scene.frame.geometry.dims)]);
        (self.value_at(place), usize::from(row).checked_sub(1))
    }

    /// The data value at `place`.
    fn value_at(&self, place: [f64; 3]) -> f64 {
        self.value_of((self.volume, &self.storage), self.scene.accuracy.interpolation, place)
    }

    /// The value of a volume at `place`.
    fn value_of(&self, (volume, storage): (&Volume, &Storage), interpolation: Interpolation, place: [f64; 3]) -> f64 {
        let dims = volume.geometry.dims;
        let normalised = interpolate(place, dims, interpolation, |index| [normalised_voxel(volume, storage, index)])[0];
        let [low, high] = storage.domain;
        (high - low).mul_add(normalised, low)
    }

    /// The values of all fields at `place`; NaN outside the box of one.
    fn values_at(&self, place: [f64; 3]) -> SmallVec<[f64; FIELDS]> {
        self.values(place).into_iter().map(|value| value.unwrap_or(f64::NAN)).collect()
    }

    fn shares(&self, place: [f64; 3]) -> Shares<f64> {
        Shares::at(self.labels, self.planned, self.scene.frame.geometry.dims, place)
    }

    /// The label of a row, if it goes by value.
    fn label_by_value(&self, row: usize) -> Option<&LabelEntry> {
        row.checked_sub(1).and_then(|label| self.scene.declared().get(label)).filter(|entry| !entry.terms.is_empty())
    }

    /// Sets `step` to the step or density of a row of labels at `place`.
    fn set_label(&self, step: &mut Step<f64>, row: usize, place: [f64; 3]) {
        match self.label_by_value(row) {
            None => self.set(step, &self.label_steps[row]),
            Some(entry) => {
                let medium = entry.medium(self.value_at(place), self.scene.materials.len());
                self.steps.write_label_of(&medium, [&mut step.source, &mut step.opacity]);
                self.truncate(step);
            }
        }
    }

    /// Sets `step` to `found`, with as many opacities as the plan's transmittance.
    fn set(&self, step: &mut Step<f64>, found: &tables::Step) {
        step.source.clone_from(&found.source);
        step.opacity.clone_from(&found.opacity);
        self.truncate(step);
    }

    /// Leaves as many opacities as the plan's transmittance has.
    fn truncate(&self, step: &mut Step<f64>) {
        step.opacity.truncate(self.planned.plan.transmittance_numbers());
    }

    /// The medium of all fields at `place`, with that of a declared `label`, by its index, in place of the first field's.
    #[must_use]
    pub fn medium_at(&self, place: [f64; 3], label: Option<usize>) -> Medium {
        let values = self.values_at(place);
        let entry = label.and_then(|label| self.scene.declared().get(label));
        let alone = |field: usize| match entry {
            Some(entry) if field == 0 => entry.medium(values[0], self.scene.materials.len()),
            _ => self.steps.medium_with(&values, self.magnitude_of_factors(place), |other| share_of(other == field)),
        };
        if let Some(order) = self.planned.plan.groups.hiding() {
            let nothing = Medium::nothing(self.scene.materials.len());
            return order.into_iter().map(alone).find(|medium| *medium != nothing).unwrap_or(nothing);
        }
        let mut medium = alone(0);
        (1..values.len()).for_each(|field| medium.add(&alone(field)));
        medium
    }

    /// Gradient of normalised values in a fall from `value` to the lowest one within two units of length.
    fn fall(&self, value: f64) -> f64 {
        fall_from(value, &self.storage, self.scene.frame.geometry.spacing.min_element())
    }

    /// The gradient magnitude at `place`, in data units per world unit.
    #[must_use]
    pub fn magnitude_at(&self, place: [f64; 3]) -> f64 {
        self.magnitude_of(self.gradient_at(place))
    }

    /// The magnitude that factors depend on; 0 without any.
    fn magnitude_of_factors(&self, place: [f64; 3]) -> f64 {
        if self.planned.plan.groups.by_gradient() { self.magnitude_at(place) } else { 0.0 }
    }

    /// Length of a gradient of normalised values, in data units per world unit.
    fn magnitude_of(&self, gradient: [f64; 3]) -> f64 {
        let [low, high] = self.storage.domain;
        (high - low) * glam::DVec3::from_array(gradient).length()
    }

    /// Derivatives of the normalised value at `place`, per world unit.
    fn gradient_at(&self, place: [f64; 3]) -> [f64; 3] {
        self.gradient_of((self.volume, &self.storage), self.scene.accuracy.interpolation, place)
    }

    /// The same of a volume at `place`, in its texture coordinates, along its own axes.
    fn gradient_of(&self, of: (&Volume, &Storage), interpolation: Interpolation, place: [f64; 3]) -> [f64; 3] {
        interpolate(place, of.0.geometry.dims, interpolation, |index| gradient_of_voxel(of, index))
    }
}

/// Derivatives of the normalised value at a voxel, per world unit: central, one-sided at faces, 0 along an axis of
/// one voxel.
fn gradient_of_voxel((volume, storage): (&Volume, &Storage), index: [usize; 3]) -> [f64; 3] {
    let geometry = &volume.geometry;
    std::array::from_fn(|axis| {
        let (mut before, mut after) = (index, index);
        before[axis] = index[axis].saturating_sub(1);
        after[axis] = (index[axis] + 1).min(geometry.dims[axis] - 1);
        let voxels = match after[axis] - before[axis] {
            0 => return 0.0,
            1 => 1.0,
            _ => 2.0,
        };
        let [after, before] = [after, before].map(|index| normalised_voxel(volume, storage, index));
        (after - before) / (voxels * geometry.spacing[axis])
    })
}

/// All or nothing.
const fn share_of(is_wanted: bool) -> f64 {
    if is_wanted { 1.0 } else { 0.0 }
}

/// Leaves the medium of one of the fields, if these hide one another: of the first one in their `order` that has any.
fn hide<R: Real>(order: Option<SmallVec<[usize; FIELDS]>>, first: &mut Step<R>, further: &mut [(usize, Step<R>)]) {
    let Some(order) = order else { return };
    let mut is_open = true;
    for wanted in order {
        let step = match further.iter_mut().find(|(field, _)| *field == wanted) {
            Some((_, step)) => step,
            None if wanted == 0 => &mut *first,
            None => continue,
        };
        let is_there = !step.does_nothing();
        if !is_open {
            step.scale(R::default());
        }
        is_open = is_open && !is_there;
    }
}

/// Gradient of normalised values in a fall from `value` to the lowest one within two units of `length`.
fn fall_from(value: f64, storage: &Storage, length: f64) -> f64 {
    let [low, high] = storage.domain;
    if high > low { (value - low) / ((high - low) * 2.0 * length) } else { 0.0 }
}

/// Texture coordinates of a field on a grid of its own at `place`, in those of the frame; `None` outside its box.
fn texture_place<R: Real>(placed: &PlacedField, place: [R; 3]) -> Option<[R; 3]> {
    let index = placed.index(place)?;
    Some(std::array::from_fn(|axis| (index[axis] + R::from_f64(0.5)) * R::from_f64(1.0 / count(placed.dims[axis]))))
}

/// Normalised value of a voxel.
fn normalised_voxel(volume: &Volume, storage: &Storage, [x, y, z]: [usize; 3]) -> f64 {
    let [width, height, _] = volume.geometry.dims;
    volume.voxels.value(x + width * (y + height * z)).map_or(0.0, |stored| storage.normalised(stored))
}

impl Samples<f64> for Exact<'_> {
    fn sample(&self, place: [f64; 3], step: &mut Step<f64>) {
        let shares = self.shares(place);
        let groups = self.planned.plan.groups;
        // Labels replace the medium of the first field; the others are added.
        let by_field = self.planned.plan.clip.is_by_field();
        let several = groups.further > 0;
        let hiding = groups.hiding();
        let apart = by_field
            || several && (hiding.is_some() || self.planned.plan.labels || groups.lit_fields().next().is_some());
        let values = if groups.any() { self.values_at(place) } else { SmallVec::new() };
        if shares.has_own() {
            let into = [&mut step.source, &mut step.opacity];
            if groups.any() {
                let magnitude = self.magnitude_of_factors(place);
                let share = |field| share_of(!apart || field == 0);
                self.steps.write_density_with(&values, magnitude, share, into);
            } else {
                self.steps.write(self.value_at(place), into);
            }
            self.truncate(step);
        } else {
            self.set(step, &self.label_steps[0]);
        }
        shares.mix(step, |row, step| self.set_label(step, row, place));
        step.others.clear();
        if !apart {
            return;
        }
        if by_field {
            step.scale(step.part_of(0));
        }
        let of_field = |field: usize| {
            let mut density = Step::default();
            let share = |other| if other == field { step.part_of(field) } else { 0.0 };
            self.steps.write_density_with(&values, 0.0, share, [&mut density.source, &mut density.opacity]);
            self.truncate(&mut density);
            (field, density)
        };
        let mut further: Vec<(usize, Step<f64>)> = (1..values.len()).map(of_field).collect();
        hide(hiding, step, &mut further);
        for (field, mut density) in further {
            if groups.lit[field] {
                step.add_other(&mut density);
            } else {
                step.add(1.0, &density);
            }
        }
    }

    fn normals_of_others(&self, place: [f64; 3]) -> Normals<f64> {
        let frame = &self.scene.frame.geometry;
        let normal = |field: usize| {
            let (volume, storage, placed) = &self.further[field - 1];
            let own = placed.as_ref().map_or(Some(place), |placed| texture_place(placed, place));
            let Some(own) = own else { return [0.0; 3] };
            let interpolation = self.scene.accuracy.interpolation.of_field(placed.is_some());
            let gradient = glam::DVec3::from_array(self.gradient_of((volume, storage), interpolation, own));
            let gradient = frame.direction.transpose() * (volume.geometry.direction * gradient);
            let value = self.value_of((volume, storage), interpolation, own);
            let fall = fall_from(value, storage, frame.spacing.min_element());
            let gradient = gradient.to_array();
            unit(self.clip.as_ref().map_or(gradient, |clip| clip.capped(field, gradient, fall, place)))
        };
        self.planned.plan.groups.lit_fields().map(normal).collect()
    }

    fn values(&self, place: [f64; 3]) -> Values<f64> {
        let first = self.value_at(place);
        let further = self.further.iter().map(|(volume, storage, placed)| {
            let place = placed.as_ref().map_or(Some(place), |placed| texture_place(placed, place))?;
            let interpolation = self.scene.accuracy.interpolation.of_field(placed.is_some());
            Some(self.value_of((volume, storage), interpolation, place))
        });
        std::iter::once(Some(first)).chain(further).collect()
    }

    fn density_of(&self, values: &[Option<f64>], density: &mut Step<f64>) {
        let values: SmallVec<[f64; FIELDS]> = values.iter().map(|value| value.unwrap_or(f64::NAN)).collect();
        self.steps.write_density_with(&values, 0.0, |_| 1.0, [&mut density.source, &mut density.opacity]);
        self.truncate(density);
    }

    fn normal(&self, place: [f64; 3]) -> [f64; 3] {
        if !self.planned.plan.gradient() {
            return [0.0; 3];
        }
        let gradient = self.gradient_at(place);
        unit(
            self.clip
                .as_ref()
                .map_or(gradient, |clip| clip.capped(0, gradient, self.fall(self.value_at(place)), place)),
        )
    }

    fn normal_between(&self, ends: [&End<f64>; 2], middle: [f64; 3]) -> [f64; 3] {
        normal_between(self.clip.as_ref(), ends, middle)
    }

    fn end(&self, place: [f64; 3]) -> End<f64> {
        let gradient = if self.planned.plan.gradient() { self.gradient_at(place) } else { [0.0; 3] };
        let value = self.value_at(place);
        End { value, gradient, fall: self.fall(value), label: self.shares(place).label() }
    }

    fn crossing(&self, place: [f64; 3]) -> Crossing<f64> {
        let [low, high] = self.storage.domain;
        let of_value = |table| {
            let part = if high > low { (self.value_at(place) - low) / (high - low) } else { 0.0 };
            let [scale, offset] = CrossingTable::place_from_normalised(table);
            Crossing::at(table, part.mul_add(scale, offset))
        };
        self.crossings.as_ref().map_or_else(Crossing::default, of_value)
    }

    fn mean(&self, ends: [&End<f64>; 2], middle: [f64; 3], density: &mut Step<f64>) -> f64 {
        let shares = self.shares(middle);
        let Step { source, opacity, memory: parts, .. } = density;
        tables::mean_density(&self.steps, &self.bends, ends.map(|end| end.value), [source, opacity], &mut parts[0]);
        let variation = variation(ends, shares.label(), || {
            for (part, end) in parts.iter_mut().zip(ends) {
                self.steps.write_densities(|_| end.value, [&mut part.source, &mut part.opacity]);
            }
            let of = |mean: &[f64], numbers: fn(&tables::Step) -> &[f64]| {
                largest_difference(mean, parts.each_ref().map(numbers))
            };
            of(source, |density| &density.source).max(of(opacity, |density| &density.opacity))
        });
        if self.planned.plan.groups.any() {
            sum_groups(
                [&mut density.source, &mut density.opacity],
                &self.scene.transfer.factors_at(self.magnitude_of(middle_of(ends))),
            );
        }
        self.truncate(density);
        shares.mix(density, |row, density| self.set_label(density, row, middle));
        variation
    }

    fn extinction(&self, place: [f64; 3], number: usize) -> f64 {
        let values = self.values_at(place);
        let part_of = |field: usize| self.clip.as_ref().map_or(1.0, |clip| clip.part_at(field, place));
        let extinction = |magnitude: f64, share: &dyn Fn(usize) -> f64| {
            self.steps.extinction_of(&self.steps.medium_with(&values, magnitude, share), number)
        };
        let own = || extinction(self.magnitude_of_factors(place), &|field| share_of(field == 0));
        let materials = self.scene.materials.len();
        let of_label = |row: usize| {
            let entry = row.checked_sub(1).and_then(|label| self.scene.declared().get(label));
            entry.map_or(0.0, |entry| self.steps.extinction_of(&entry.medium(values[0], materials), number))
        };
        let first = part_of(0) * self.shares(place).number(own, of_label);
        let further =
            (1..values.len()).map(|field| part_of(field) * extinction(0.0, &|other| share_of(other == field)));
        let fields: Values<f64> = std::iter::once(first).chain(further).map(Some).collect();
        extinction_of_fields(self.planned, &fields)
    }

    fn volume(&self) -> Option<(&Storage, Option<&LabelMap>)> {
        Some((&self.storage, self.labels))
    }

    fn keeping(&self) -> Option<Keeping<'_, f64>> {
        let Planned { plan, .. } = self.planned;
        let (interpolation, smooth_labels) = (self.scene.accuracy.interpolation, plan.smooth_labels);
        self.kept.map(|depths| Keeping { depths, interpolation, smooth_labels })
    }
}

/// The variation between two ends, with the label `between` in their middle: 1 if labels differ or are mixed, 0 within a
/// label, else `of_values()`.
fn variation<R: Real>([a, b]: [&End<R>; 2], between: Label, of_values: impl FnOnce() -> R) -> R {
    match (a.label == b.label && between == a.label, a.label) {
        (false, _) | (true, Label::Mixed) => R::from_f64(1.0),
        (true, Label::None) => of_values(),
        (true, Label::Row(_)) => R::default(),
    }
}

/// The normal between two ends, capped at these planes.
fn normal_between<R: Real>(clip: Option<&Planes<R>>, ends: [&End<R>; 2], middle: [R; 3]) -> [R; 3] {
    let gradient = middle_of(ends);
    let fall = (ends[0].fall + ends[1].fall) * R::from_f64(0.5);
    unit(clip.map_or(gradient, |clip| clip.capped(0, gradient, fall, middle)))
}

/// The mean of the gradients at both ends.
fn middle_of<R: Real>([a, b]: [&End<R>; 2]) -> [R; 3] {
    std::array::from_fn(|axis| (a.gradient[axis] + b.gradient[axis]) * R::from_f64(0.5))
}

/// The largest sum of differences between `mean` and the numbers at both ends.
fn largest_difference<R: Real>(mean: &[R], [a, b]: [&[R]; 2]) -> R {
    let differences = mean.iter().zip(a).zip(b).map(|((&mean, &a), &b)| (mean - a).abs() + (b - mean).abs());
    differences.fold(R::default(), Real::max)
}

/// Stored tables and volume, read as in the shader. Twin of `sample` in `shaders/samples.wgsl` and `mean_between` in
/// `shaders/segments.wgsl`.
#[derive(Debug)]
pub struct Stored<'a, R> {
    planned: &'a Planned,
    storage: &'a Storage,
    volume: &'a StoredVolume,
    further: Vec<StoredField<'a, R>>,
    table: &'a TransferTable,
    labels: Option<(&'a LabelMap, &'a LabelTable)>,
    factors: &'a FactorTable,
    coordinate_scale: R,
    coordinate_offset: R,
    gradient_scale: [R; 3],
    /// Edges of the texture in units of length.
    lengths: [f64; 3],
    /// If shading sees cut faces.
    clip: Option<Planes<R>>,
    fall: [R; 2],
    segments: Option<Segments<'a, R>>,
    /// With scale and offset from texels to its places.
    crossings: Option<(&'a CrossingTable, [R; 2])>,
    extinctions: &'a [ExtinctionTable],
}

/// A further field as stored.
#[derive(Debug)]
struct StoredField<'a, R> {
    volume: &'a StoredVolume,
    /// Its place, on a grid of its own.
    placed: Option<PlacedField>,
    /// [`gradient_numbers`].
    numbers: [[R; 3]; 2],
}

/// Table of segments, and the scale and offset from texels to its coordinates.
#[derive(Debug)]
struct Segments<'a, R> {
    table: &'a SegmentTable,
    scale: R,
    offset: R,
}

impl<'a, R: Real> Stored<'a, R> {
    /// Creates samples of a scene `stored` for this plan.
    #[must_use]
    pub fn new(planned: &'a Planned, stored: &'a StoredScene) -> Self {
        let StoredScene {
            storage,
            volume,
            further,
            table,
            label_table,
            segments,
            crossings,
            extinctions,
            factors,
            caps,
            labels,
            lengths: _,
            unit: _,
        } = stored;
        let [scale, offset] = table.coordinate_from_texel(storage);
        let of_segments = |table: &'a SegmentTable| {
            let [scale, offset] = table.coordinate_from_texel(storage).map(R::from_f64);
            Segments { table, scale, offset }
        };
        Self {
            planned,
            storage,
            volume,
            further: further
                .iter()
                .map(|(storage, volume, placed)| {
                    let numbers = gradient_numbers(storage, placed.as_ref(), stored.unit);
                    StoredField { volume, placed: *placed, numbers: numbers.map(|numbers| numbers.map(R::from_f64)) }
                })
                .collect(),
            table,
            labels: labels.as_deref().map(|labels| (labels, label_table)),
            factors,
            coordinate_scale: R::from_f64(scale),
            coordinate_offset: R::from_f64(offset),
            gradient_scale: storage.gradient_scale().map(R::from_f64),
            lengths: stored.lengths,
            clip: Planes::of_samples(planned, caps),
            fall: caps.fall.map(R::from_f64),
            segments: segments.as_ref().map(of_segments),
            crossings: crossings.as_ref().map(|table| (table, table.place_from_texel(storage).map(R::from_f64))),
            extinctions,
        }
    }

    /// The numbers of `texels` at `place`.
    fn fetch<const N: usize>(&self, place: [R; 3], texels: &[[f32; N]]) -> [R; N] {
        self.fetch_of((self.volume.dims, false), place, texels)
    }

    /// The numbers of `texels` of a grid at `place`, in its texture coordinates, of a field that is placed there if it is so.
    fn fetch_of<const N: usize>(
        &self,
        (dims, is_placed): ([usize; 3], bool),
        place: [R; 3],
        texels: &[[f32; N]],
    ) -> [R; N] {
        interpolate(place, dims, self.planned.plan.interpolation.of_field(is_placed), |[x, y, z]| {
            let texel = texels.get(x + dims[0] * (y + dims[1] * z)).copied().unwrap_or([0.0; N]);
            texel.map(|number| R::from_f64(f64::from(number)))
        })
    }

    /// The value at `place`, as stored.
    fn value_at(&self, place: [R; 3]) -> R {
        let [value] = self.fetch(place, self.volume.values.as_chunks().0);
        value
    }

    /// [`End::fall`] from a value as stored.
    fn fall(&self, value: R) -> R {
        value.mul_add(self.fall[0], self.fall[1])
    }

    /// Coordinate of the value at `place` in a table with so many `entries`.
    fn coordinate_at(&self, place: [R; 3], entries: usize) -> R {
        let coordinate = self.value_at(place).mul_add(self.coordinate_scale, self.coordinate_offset);
        coordinate.max(R::default()).min(R::from_f64(count(entries - 1)))
    }

    /// The gradient of the data at `place`; 0 if the plan needs none.
    fn gradient_at(&self, place: [R; 3]) -> [R; 3] {
        if let Some(gradients) = &self.volume.gradients {
            let difference = self.fetch(place, gradients);
            return std::array::from_fn(|axis| difference[axis] * self.gradient_scale[axis]);
        }
        if !self.planned.plan.gradient() {
            return [R::default(); 3];
        }
        std::array::from_fn(|axis| {
            let voxel = R::from_f64(1.0 / count(self.volume.dims[axis]));
            let (mut before, mut after) = (place, place);
            before[axis] = place[axis] - voxel;
            after[axis] = place[axis] + voxel;
            (self.value_at(after) - self.value_at(before)) * self.gradient_scale[axis]
        })
    }

    /// The table coordinate of each group whose field has one of these `values`.
    fn coordinates_of(&self, values: &[Option<R>], entries: usize) -> Values<R> {
        let last = R::from_f64(count(entries - 1));
        let of_group = |(field, [scale, offset]): (usize, [R; 2])| {
            values[field].map(|value| value.mul_add(scale, offset).max(R::default()).min(last))
        };
        coordinates_of(self.factors, &self.planned.plan).map(of_group).collect()
    }

    /// Reads the table for each group at the value of its field.
    fn look_up_fields(&self, values: &[Option<R>], step: &mut Step<R>) {
        let (lanes, numbers) = (self.table.lanes * LANE, self.table.opacity_numbers);
        step.source.clear();
        step.opacity.clear();
        let mut read = Step::default();
        for (group, coordinate) in self.coordinates_of(values, self.table.entries()).into_iter().enumerate() {
            let Some(coordinate) = coordinate else {
                step.source.extend(std::iter::repeat_n(R::default(), lanes));
                step.opacity.extend(std::iter::repeat_n(R::default(), numbers));
                continue;
            };
            self.look_up(coordinate, &mut read);
            step.source.extend_from_slice(&read.source[group * lanes..][..lanes]);
            step.opacity.extend_from_slice(&read.opacity[group * numbers..][..numbers]);
        }
    }

    /// Takes the densities of further fields out of that of all groups, and returns them with the indices of the fields, which have these
    /// `values`.
    fn split_further(&self, density: &mut Step<R>, values: &[Option<R>]) -> Vec<(usize, Step<R>)> {
        let (lanes, numbers) = (self.table.lanes * LANE, self.table.opacity_numbers);
        let of_first = self.planned.plan.groups.of_first();
        let source = density.source.split_off(of_first * lanes);
        let opacity = density.opacity.split_off(of_first * numbers);
        if of_first == 0 {
            density.source.resize(lanes, R::default());
            density.opacity.resize(numbers, R::default());
        }
        // Factors by the gradient are those of the first field.
        let factors = factors_at(self.factors, &self.planned.plan, [R::default(); 3], values);
        let nothing =
            || Step { source: vec![R::default(); lanes], opacity: vec![R::default(); numbers], ..Step::default() };
        let mut further = Vec::<(usize, Step<R>)>::new();
        for (group, &field) in self.table.fields[of_first..].iter().enumerate() {
            if further.last().is_none_or(|last| last.0 != field) {
                further.push((field, nothing()));
            }
            let Some((_, sum)) = further.last_mut() else { continue };
            let source = source[group * lanes..][..lanes].to_vec();
            let opacity = opacity[group * numbers..][..numbers].to_vec();
            sum.add(factors[of_first + group], &Step { source, opacity, ..Step::default() });
        }
        further
    }

    /// Gradient of a further field at `place`, along the frame's axes, and that of a fall to its lowest value within two units of length;
    /// `None` outside its box.
    fn gradient_and_fall(&self, field: usize, place: [R; 3]) -> Option<([R; 3], R)> {
        let StoredField { volume, placed, numbers: [scales, falls] } = &self.further[field - 1];
        let own = placed.as_ref().map_or(Some(place), |placed| texture_place(placed, place))?;
        let value = |place: [R; 3]| {
            let [value] = self.fetch_of((volume.dims, placed.is_some()), place, volume.values.as_chunks().0);
            value
        };
        let differences: [R; 3] = match &volume.gradients {
            Some(gradients) => self.fetch_of((volume.dims, placed.is_some()), own, gradients),
            None => std::array::from_fn(|axis| {
                let voxel = R::from_f64(1.0 / count(volume.dims[axis]));
                let (mut before, mut after) = (own, own);
                before[axis] = own[axis] - voxel;
                after[axis] = own[axis] + voxel;
                value(after) - value(before)
            }),
        };
        let gradient: [R; 3] = std::array::from_fn(|axis| differences[axis] * scales[axis]);
        let along = |axis: usize| match placed {
            None => gradient[axis],
            Some(placed) => {
                let across = placed.rows.map(|row| R::from_f64(row.to_array()[axis]));
                dot(across, gradient) * R::from_f64(1.0 / self.lengths[axis])
            }
        };
        Some((std::array::from_fn(along), value(own).mul_add(falls[0], falls[1])))
    }

    /// Sets `step` to a row of the table of labels, where the value has this coordinate in the transfer table.
    fn look_up_label(&self, labels: &LabelTable, row: usize, coordinate: R, step: &mut Step<R>) {
        match labels.rows.rows[row] {
            (first, false) => entry(&labels.table, first, step),
            (first, true) => self.look_up_in(&labels.table, first, coordinate, step),
        }
    }

    /// Leaves the sum of the groups of a density, times their factors by the `gradient`, which is asked for where there is any medium, and by
    /// the `values` of the fields.
    fn scale_groups(&self, density: &mut Step<R>, values: &[Option<R>], gradient: impl FnOnce() -> [R; 3]) {
        let gradient = if density.does_nothing() { [R::default(); 3] } else { gradient() };
        let factors = factors_at(self.factors, &self.planned.plan, gradient, values);
        let groups = density.opacity.len() / self.table.opacity_numbers;
        sum_groups([&mut density.source, &mut density.opacity], &factors[..groups]);
    }

    fn shares(&self, place: [R; 3]) -> Shares<R> {
        Shares::at(self.labels.map(|(labels, _)| labels), self.planned, self.volume.dims, place)
    }
}

impl<R: Real> Samples<R> for Stored<'_, R> {
    fn sample(&self, place: [R; 3], step: &mut Step<R>) {
        let groups = self.planned.plan.groups;
        let values = if groups.further > 0 || groups.shapes[0] > 0 { self.values(place) } else { Values::new() };
        if groups.further > 0 {
            self.look_up_fields(&values, step);
        } else {
            self.look_up(self.coordinate_at(place, self.table.entries()), step);
        }
        let by_field = self.planned.plan.clip.is_by_field();
        let several = groups.further > 0;
        let hiding = groups.hiding();
        let apart =
            several && (by_field || hiding.is_some() || self.labels.is_some() || groups.lit_fields().next().is_some());
        let mut further = if apart { self.split_further(step, &values) } else { Vec::new() };
        step.others.clear();
        if groups.any() {
            self.scale_groups(step, &values, || self.gradient_at(place));
        }
        if let Some((_, table)) = self.labels {
            let coordinate = self.coordinate_at(place, self.table.entries());
            self.shares(place).mix(step, |row, step| self.look_up_label(table, row, coordinate, step));
        }
        if by_field {
            step.scale(step.part_of(0));
        }
        if by_field {
            further.iter_mut().for_each(|(field, density)| density.scale(step.part_of(*field)));
        }
        hide(hiding, step, &mut further);
        for (field, mut density) in further {
            if groups.lit[field] {
                step.add_other(&mut density);
            } else {
                step.add(R::from_f64(1.0), &density);
            }
        }
        step.opacity.truncate(self.planned.plan.transmittance_numbers());
    }

    fn normals_of_others(&self, place: [R; 3]) -> Normals<R> {
        let normal = |field: usize| {
            let Some((gradient, fall)) = self.gradient_and_fall(field, place) else {
                return [R::default(); 3];
            };
            unit(self.clip.as_ref().map_or(gradient, |clip| clip.capped(field, gradient, fall, place)))
        };
        self.planned.plan.groups.lit_fields().map(normal).collect()
    }

    fn values(&self, place: [R; 3]) -> Values<R> {
        let [first] = self.fetch(place, self.volume.values.as_chunks().0);
        let further = self.further.iter().map(|StoredField { volume, placed, .. }| {
            let place = placed.as_ref().map_or(Some(place), |placed| texture_place(placed, place))?;
            let [value] = self.fetch_of((volume.dims, placed.is_some()), place, volume.values.as_chunks().0);
            Some(value)
        });
        std::iter::once(Some(first)).chain(further).collect()
    }

    fn density_of(&self, values: &[Option<R>], density: &mut Step<R>) {
        self.look_up_fields(values, density);
        self.scale_groups(density, values, || [R::default(); 3]);
        density.opacity.truncate(self.planned.plan.transmittance_numbers());
    }

    fn normal(&self, place: [R; 3]) -> [R; 3] {
        let gradient = self.gradient_at(place);
        unit(
            self.clip
                .as_ref()
                .map_or(gradient, |clip| clip.capped(0, gradient, self.fall(self.value_at(place)), place)),
        )
    }

    fn normal_between(&self, ends: [&End<R>; 2], middle: [R; 3]) -> [R; 3] {
        normal_between(self.clip.as_ref(), ends, middle)
    }

    fn end(&self, place: [R; 3]) -> End<R> {
        let (value, gradient) = (self.value_at(place), self.gradient_at(place));
        let fall = self.fall(value);
        let value = self.segments.as_ref().map_or(value, |segments| {
            let last = R::from_f64(count(segments.table.cells()));
            value.mul_add(segments.scale, segments.offset).max(R::default()).min(last)
        });
        End { value, gradient, fall, label: self.shares(place).label() }
    }

    fn crossing(&self, place: [R; 3]) -> Crossing<R> {
        let of_texel = |&(table, [scale, offset]): &(&CrossingTable, [R; 2])| {
            Crossing::at(table, self.value_at(place).mul_add(scale, offset))
        };
        self.crossings.as_ref().map_or_else(Crossing::default, of_texel)
    }

    // Twin of `mean_between` in `shaders/segments.wgsl`.
    fn mean(&self, ends: [&End<R>; 2], middle: [R; 3], density: &mut Step<R>) -> R {
        let Some(Segments { table, .. }) = &self.segments else { return R::default() };
        let [a, b] = ends.map(|end| Integrals::at(table, end.value));
        let between = ends[1].value - ends[0].value;
        let unit = R::from_f64(table.unit);
        let mut most = R::default();
        let mut number = |from: i32, to: i32, slopes: [R; 2]| {
            let mean = if between.abs() < R::from_f64(CLOSE) {
                (slopes[0] + slopes[1]) * R::from_f64(0.5)
            } else {
                let whole = R::from_f64(f64::from(to.wrapping_sub(from)));
                (whole + (b.fraction.mul_add(slopes[1], -(a.fraction * slopes[0])))) / between
            };
            most = most.max(((mean - slopes[0]).abs() + (slopes[1] - mean).abs()) * unit);
            mean * unit
        };
        let bounds = [&a, &b].map(|integrals| [table.bound(integrals.cell), table.bound(integrals.cell + 1)]);
        for (kind, numbers) in [&mut density.source, &mut density.opacity].into_iter().enumerate() {
            numbers.clear();
            let of_end = |[here, next]: &[[&[i32]; 2]; 2], i: usize| {
                (here[kind][i], R::from_f64(f64::from(next[kind][i].wrapping_sub(here[kind][i]))))
            };
            numbers.extend((0..bounds[0][0][kind].len()).map(|i| {
                let ((from, before), (to, after)) = (of_end(&bounds[0], i), of_end(&bounds[1], i));
                number(from, to, [before, after])
            }));
        }
        if self.planned.plan.groups.any() {
            sum_groups(
                [&mut density.source, &mut density.opacity],
                &factors_at(self.factors, &self.planned.plan, middle_of(ends), &[]),
            );
        }
        let shares = self.shares(middle);
        if let Some((_, table)) = self.labels {
            // Segments have no labels by value.
            shares.mix(density, |row, density| self.look_up_label(table, row, R::default(), density));
        }
        density.opacity.truncate(self.planned.plan.transmittance_numbers());
        variation(ends, shares.label(), || most)
    }

    // Twin of `extinction_at` in `shaders/light_medium.wgsl`.
    fn extinction(&self, place: [R; 3], number: usize) -> R {
        let Some(table) = self.extinctions.get(number) else { return R::default() };
        let number = |number: &f32| R::from_f64(f64::from(*number));
        let plan = &self.planned.plan;
        let between = |coordinate: R, entry: &dyn Fn(usize) -> R| match plan.lookup {
            Lookup::Nearest => entry((coordinate + R::from_f64(0.5)).floor().index()),
            Lookup::Linear => {
                let before = coordinate.floor().index().min(table.entries() - 2);
                let [here, next] = [before, before + 1].map(entry);
                (coordinate - R::from_f64(count(before))).mul_add(next - here, here)
            }
        };
        let (values, coordinates) = if plan.groups.further > 0 {
            let values = self.values(place);
            let coordinates = self.coordinates_of(&values, table.entries());
            (values, coordinates)
        } else {
            let coordinate = self.coordinate_at(place, table.entries());
            let values = if plan.groups.shapes[0] > 0 { self.values(place) } else { Values::new() };
            (values, smallvec![Some(coordinate); plan.groups.in_tables()])
        };
        let of_group = |group: usize| {
            let Some(coordinate) = coordinates[group] else { return R::default() };
            between(coordinate, &|entry| number(&table.values[entry * table.groups + group]))
        };
        let part_of =
            |field: usize| self.clip.as_ref().map_or_else(|| R::from_f64(1.0), |clip| clip.part_at(field, place));
        let factors = || factors_at(self.factors, plan, self.gradient_at(place), &values);
        let by_field = plan.clip.is_by_field();
        let sum = |groups: Range<usize>, factors: &[R]| {
            groups.fold(R::default(), |sum, group| factors[group].mul_add(of_group(group), sum))
        };
        let apart = (plan.labels || by_field || plan.groups.hiding().is_some()) && plan.groups.further > 0;
        let of_first = if apart { plan.groups.of_first() } else { table.groups };
        let own = || if plan.groups.any() { sum(0..of_first, &factors()) } else { of_group(0) };
        let of_label = |row: usize| match table.rows.rows[row] {
            (first, false) => number(&table.labels[first]),
            (first, true) => {
                let coordinate = self.coordinate_at(place, table.entries());
                between(coordinate, &|entry| number(&table.labels[first + entry]))
            }
        };
        let first = part_of(0) * self.shares(place).number(own, of_label);
        if !apart {
            return first;
        }
        let mut factors = factors();
        for (factor, &field) in factors.iter_mut().zip(&plan.groups.fields).skip(of_first) {
            *factor = *factor * part_of(field);
        }
        let of_field = |field: usize| {
            let groups = (of_first..table.groups).filter(|&group| plan.groups.fields[group] == field);
            groups.fold(R::default(), |sum, group| factors[group].mul_add(of_group(group), sum))
        };
        let fields: Values<R> =
            std::iter::once(first).chain((1..=plan.groups.further).map(of_field)).map(Some).collect();
        extinction_of_fields(self.planned, &fields)
    }

    fn stored_depth(&self, depth: R) -> R {
        R::from_f64(half::f16::from_f64(depth.to_f64()).to_f64())
    }

    fn volume(&self) -> Option<(&Storage, Option<&LabelMap>)> {
        Some((self.storage, self.labels.map(|(labels, _)| labels)))
    }
}

/// The extinction of several fields: their sum, or that of the one that hides the others.
fn extinction_of_fields<R: Real>(planned: &Planned, fields: &[Option<R>]) -> R {
    let extinction = |field: usize| fields.get(field).copied().flatten().unwrap_or_default();
    match planned.plan.groups.hiding() {
        None => (0..fields.len()).map(extinction).fold(R::default(), |sum, extinction| sum + extinction),
        Some(order) => {
            order.into_iter().map(extinction).find(|extinction| *extinction > R::default()).unwrap_or_default()
        }
    }
}

/// Distance of two table coordinates below which the mean between them is the mean of the densities at both: the
/// difference of the integrals would lose its digits.
const CLOSE: f64 = 0.0625;

/// A place in a table of segments.
#[derive(Clone, Copy, Debug)]
struct Integrals<R> {
    cell: usize,
    fraction: R,
}

impl<R: Real> Integrals<R> {
    fn at(table: &SegmentTable, coordinate: R) -> Self {
        let cell = coordinate.floor().index().min(table.cells() - 1);
        Self { cell, fraction: coordinate - R::from_f64(count(cell)) }
    }
}

impl<R: Real> Stored<'_, R> {
    /// Reads the table at `coordinate`. Twin of `look_up` in `shaders/samples.wgsl`.
    fn look_up(&self, coordinate: R, step: &mut Step<R>) {
        self.look_up_in(self.table, 0, coordinate, step);
    }

    /// Reads a table whose entry `first` is at coordinate 0.
    fn look_up_in(&self, table: &TransferTable, first: usize, coordinate: R, step: &mut Step<R>) {
        match self.planned.plan.lookup {
            Lookup::Nearest => entry(table, first + (coordinate + R::from_f64(0.5)).floor().index(), step),
            Lookup::Linear => {
                let before = coordinate.floor().index().min(self.table.entries() - 2);
                let fraction = coordinate - R::from_f64(count(before));
                entry(table, first + before, step);
                let numbers = [&mut step.source, &mut step.opacity];
                for (numbers, after) in numbers.into_iter().zip(table.entry(first + before + 1)) {
                    for (number, &after) in numbers.iter_mut().zip(after) {
                        *number = fraction.mul_add(R::from_f64(f64::from(after)) - *number, *number);
                    }
                }
            }
        }
    }
}

/// Sets `step` to entry `i` of a table.
fn entry<R: Real>(table: &TransferTable, i: usize, step: &mut Step<R>) {
    for (numbers, of_entry) in [&mut step.source, &mut step.opacity].into_iter().zip(table.entry(i)) {
        numbers.clear();
        numbers.extend(of_entry.iter().map(|&number| R::from_f64(f64::from(number))));
    }
}

/// Interpolates `texel` at `place` (texture coordinates), x first, or returns the nearest texel. Voxels beyond the grid are those at
/// its faces.
fn interpolate<R: Real, const N: usize>(
    place: [R; 3],
    dims: [usize; 3],
    interpolation: Interpolation,
    texel: impl Fn([usize; 3]) -> [R; N],
) -> [R; N] {
    let voxel: [R; 3] =
        std::array::from_fn(|axis| place[axis].mul_add(R::from_f64(count(dims[axis])), R::from_f64(-0.5)));
    let on = |axis: usize, at: i64| usize::try_from(at).unwrap_or(0).min(dims[axis] - 1);
    if interpolation == Interpolation::Nearest {
        let half = R::from_f64(0.5);
        return texel(std::array::from_fn(|axis| on(axis, whole((voxel[axis] + half).floor()))));
    }
    let base = voxel.map(Real::floor);
    let fraction: [R; 3] = std::array::from_fn(|axis| voxel[axis] - base[axis]);
    let base = base.map(whole);
    if interpolation == Interpolation::Cubic {
        let weights = fraction.map(cubic_weights);
        let mix = |axis: usize, parts: [[R; N]; 4]| -> [R; N] {
            std::array::from_fn(|i| {
                let sum = |sum: R, (weight, part): (&R, &[R; N])| *weight * part[i] + sum;
                weights[axis].iter().zip(&parts).fold(R::default(), sum)
            })
        };
        let around = |axis: usize| [-1, 0, 1, 2].map(|step| on(axis, base[axis] + step));
        let line = |y, z| mix(0, around(0).map(|x| texel([x, y, z])));
        let plane = |z| mix(1, around(1).map(|y| line(y, z)));
        return mix(2, around(2).map(plane));
    }
    let lerp = |[a, b]: [[R; N]; 2], f: R| -> [R; N] { std::array::from_fn(|i| f.mul_add(b[i] - a[i], a[i])) };
    if let Some(axis) = interpolation.cubic_axis() {
        let [one, other] = [(axis + 1) % 3, (axis + 2) % 3];
        let at = |places: [usize; 3]| {
            let mut voxel = [0; 3];
            (voxel[axis], voxel[one], voxel[other]) = (places[0], places[1], places[2]);
            texel(voxel)
        };
        let ends = |axis: usize| [0, 1].map(|step| on(axis, base[axis] + step));
        let slice = |along: usize| {
            lerp(ends(other).map(|v| lerp(ends(one).map(|u| at([along, u, v])), fraction[one])), fraction[other])
        };
        let parts = [-1, 0, 1, 2].map(|step| slice(on(axis, base[axis] + step)));
        let weights = cubic_weights(fraction[axis]);
        return std::array::from_fn(|i| {
            let sum = |sum: R, (weight, part): (&R, &[R; N])| *weight * part[i] + sum;
            weights.iter().zip(&parts).fold(R::default(), sum)
        });
    }
    let [xs, ys, zs]: [[usize; 2]; 3] = std::array::from_fn(|axis| [0, 1].map(|step| on(axis, base[axis] + step)));
    let line = |y, z| lerp(xs.map(|x| texel([x, y, z])), fraction[0]);
    let plane = |z| lerp(ys.map(|y| line(y, z)), fraction[1]);
    lerp(zs.map(plane), fraction[2])
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
