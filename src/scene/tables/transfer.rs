//! Transfer function sampled as a table over the range of the data, for one step length.

use super::Storage;
use crate::plan::{Accumulate, Integrate, LANE, Planned, Shares, Transmittance};
use crate::transfer::{bends, medium_of};
use crate::{Blending, Group, Lookup, Material, Medium, Scene, Second, Term, factor_at};
use relume_base::number::count;
use relume_base::number::rounded;
use relume_colour::model::{Amplification, ColourModel, Matrices, ModelKind, Order};
use relume_colour::spectrum::{BANDS, Spectrum};
use smallvec::{SmallVec, smallvec};

/// Smallest number of entries of a linear table.
const FEWEST: usize = 1024;
/// Largest number of entries; resolves a bend at every value of 16-bit data.
const MOST: usize = 1 << 16;
/// Least number of entries across the narrowest feature of a transfer function, whose ends then move by at most an
/// eighth of its width.
const PER_FEATURE: f64 = 8.0;

/// Largest optical depth per step length of a density: e⁻⁶⁴ of the light is left behind a step. The integral of a
/// density is kept in 32 bits, so a limit of the largest density is one of the rounding of all others.
pub const LARGEST_DEPTH: f64 = 64.0;

/// The same of a density that samples read, in f32: large enough that a factor of a thousandth leaves an opaque medium opaque.
const LARGEST_SAMPLED_DEPTH: f64 = 65_536.0;

/// Transfer table: entry `i` of `n` belongs to the value `low + i/(n−1)·(high − low)`.
///
/// An entry describes a step Δs through the medium (docs/theory/march.md), in vectors laid out by the plan: the lost
/// light α = 1 − e^(−τΔs), and the gained light `σ_m (1 − e^(−τΔs))/τ`, or `σ_m Δs` without loss, per material or times
/// its spectrum. X-ray materials count in σ but not in τ.
///
/// Where factors scale the medium of a sample, an entry is a density in place of a step: the scattered light `σ_m Δs`, and the optical
/// depth τΔs in place of α, for each group of terms, one behind the other. Where a single value of a ray is seen, Δs is an opacity length.
#[derive(Clone, Debug, PartialEq)]
pub struct TransferTable {
    /// Gained light: `entries × groups × lanes` vectors; unused numbers are zero.
    pub source: Vec<[f32; LANE]>,
    /// Lost light α: [`Self::opacity_numbers`] numbers per entry and group; unused numbers are zero.
    pub opacity: Vec<f32>,
    /// Vectors per entry and group of [`Self::source`].
    pub lanes: usize,
    /// Numbers per entry and group of [`Self::opacity`].
    pub opacity_numbers: usize,
    /// Groups of terms per entry.
    pub groups: usize,
    /// The field of each group; empty without groups.
    pub fields: Vec<usize>,
    /// Rule that blends the values along a ray.
    pub blending: Blending,
}

/// Effect of one step in f64, laid out like a table entry.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Step {
    /// Gained light.
    pub source: Vec<f64>,
    /// Lost light α.
    pub opacity: Vec<f64>,
}

impl Step {
    /// The step that `write` sets the source and the opacity of.
    pub(super) fn written(write: impl FnOnce([&mut Vec<f64>; 2])) -> Self {
        let mut step = Self::default();
        write([&mut step.source, &mut step.opacity]);
        step
    }
}

/// A number for each component, without memory of its own for as many as there are wavelengths.
type Components = SmallVec<[f64; BANDS]>;

impl TransferTable {
    /// Builds the table of `scene` over the `domains` (lowest and highest value) of its fields.
    #[must_use]
    pub fn new(scene: &Scene, planned: &Planned, domains: &[[f64; 2]]) -> Self {
        let steps = Steps::new(scene, planned);
        let groups = planned.plan.groups.in_tables();
        let values = Self::values(scene, domains);
        if !planned.plan.groups.any() {
            return Self::of_steps(planned, groups, values.map(|value| steps.of_value(value(0))));
        }
        let table = Self::of_steps(
            planned,
            groups,
            values.map(|value| Step::written(|step| steps.write_densities(&value, step))),
        );
        Self { fields: scene.groups().iter().map(|group| group.field).collect(), ..table }
    }

    /// Values of the entries of the table of `scene` over the `domains` of its fields, by the index of a field.
    pub(super) fn values(scene: &Scene, domains: &[[f64; 2]]) -> impl Iterator<Item = impl Fn(usize) -> f64> {
        let entries = entries(scene, domains);
        (0..entries).map(move |i| {
            move |field: usize| value_of_entry(domains.get(field).copied().unwrap_or_default(), i, entries)
        })
    }

    pub(super) fn of_steps(planned: &Planned, groups: usize, steps: impl Iterator<Item = Step>) -> Self {
        let (mut source, mut opacity) = (Vec::new(), Vec::new());
        for step in steps {
            source.extend(step.source.chunks_exact(LANE).map(|lane| std::array::from_fn(|part| rounded(lane[part]))));
            opacity.extend(step.opacity.iter().copied().map(rounded));
        }
        Self {
            source,
            opacity,
            lanes: planned.plan.parts().lanes,
            opacity_numbers: opacity_numbers(planned),
            groups,
            fields: Vec::new(),
            blending: planned.plan.blending,
        }
    }

    /// Number of entries.
    #[must_use]
    pub fn entries(&self) -> usize {
        self.opacity.len() / (self.groups * self.opacity_numbers)
    }

    /// Scale and offset from a texel's value to a table coordinate, 0 to `entries − 1`.
    #[must_use]
    pub fn coordinate_from_texel(&self, storage: &Storage) -> [f64; 2] {
        storage.normalised_from_texel().map(|term| term * count(self.entries() - 1))
    }

    /// Open interval of table coordinates outside which every lookup is zero.
    #[must_use]
    pub fn active(&self) -> [f64; 2] {
        let first = (0..self.entries()).find(|&i| self.is_active(i));
        let last = (0..self.entries()).rfind(|&i| self.is_active(i));
        // A coordinate between two entries reads both.
        [first.map_or(f64::INFINITY, |i| count(i) - 1.0), last.map_or(f64::NEG_INFINITY, |i| count(i) + 1.0)]
    }

    /// True for each entry that can decide a pixel: those with a nonzero number, and of extreme values those beyond.
    #[must_use]
    pub fn active_entries(&self) -> Vec<bool> {
        let mut active: Vec<bool> = (0..self.entries()).map(|i| self.is_active(i)).collect();
        self.blending.widen(&mut active);
        active
    }

    /// [`Self::active_entries`] of the groups of a `field`.
    #[must_use]
    pub fn active_entries_of(&self, field: usize) -> Vec<bool> {
        let (lanes, numbers) = (self.lanes * LANE, self.opacity_numbers);
        let is_active = |i: usize| {
            let [source, opacity] = self.entry(i);
            self.fields.iter().enumerate().filter(|(_, of)| **of == field).any(|(group, _)| {
                let numbers = source[group * lanes..][..lanes].iter().chain(&opacity[group * numbers..][..numbers]);
                numbers.into_iter().any(|&number| number != 0.0)
            })
        };
        let mut active: Vec<bool> = (0..self.entries()).map(is_active).collect();
        self.blending.widen(&mut active);
        active
    }

    /// Whether entry `i` has any nonzero number.
    pub(crate) fn is_active(&self, i: usize) -> bool {
        self.entry(i).into_iter().flatten().any(|&number| number != 0.0)
    }

    /// The source and the opacity of entry `i`, of all its groups.
    pub(crate) fn entry(&self, i: usize) -> [&[f32]; 2] {
        let (lanes, numbers) = (self.groups * self.lanes, self.groups * self.opacity_numbers);
        [self.source[i * lanes..][..lanes].as_flattened(), &self.opacity[i * numbers..][..numbers]]
    }
}

/// The value of entry `i` of so many over a `domain`.
pub(super) fn value_of_entry([low, high]: [f64; 2], i: usize, entries: usize) -> f64 {
    (high - low).mul_add(count(i) / count(entries.max(2) - 1), low)
}

/// Numbers per entry of the opacity: one, or whole vectors.
pub(super) fn opacity_numbers(planned: &Planned) -> usize {
    match planned.plan.transmittance {
        Transmittance::Grey => 1,
        Transmittance::Coloured | Transmittance::Mixed => planned.plan.transmittance_lanes() * LANE,
    }
}

/// Effects of steps in a scene: converts its materials to the plan's components once, and evaluates any medium.
#[derive(Debug)]
pub struct Steps<'a> {
    scene: &'a Scene,
    planned: &'a Planned,
    /// Coefficients of each material's reflectance, in a colour model.
    reflectances: Vec<Vec<f64>>,
    /// Coefficients of each material's absorption; a single number for grey transmittance; empty without absorption.
    absorptions: Vec<Vec<f64>>,
    /// Exponents of the highlights with components of their own.
    exponents: Vec<u32>,
    /// Phase functions with components of their own.
    phases: Vec<f64>,
    /// Numbers of the films of materials, if entries have parts for them.
    thin_films: Vec<Option<usize>>,
    /// Coloured absorbers of shadows.
    absorbers: Vec<usize>,
    /// The field of each group, and the group of each term of each field.
    groups: (Vec<usize>, Vec<Vec<usize>>),
    /// Model that projects the transmittance of each step (the paper's order).
    by_step: Option<&'a ColourModel>,
    /// Matrices of the model, if the transmittance is a matrix.
    matrices: Option<Matrices>,
}

impl<'a> Steps<'a> {
    /// Prepares the steps of `scene` under `planned`.
    #[must_use]
    pub fn new(scene: &'a Scene, planned: &'a Planned) -> Self {
        let model = planned.model.as_deref();
        let coefficients = |material: &Material| {
            model.map_or_else(Vec::new, |model| model.coefficients(material.reflectance.spectrum()))
        };
        let absorptions = |material: &Material| match (&material.absorption, model, planned.plan.transmittance) {
            (None, ..) => Vec::new(),
            (Some(absorption), Some(model), Transmittance::Coloured) => {
                model.absorption_coefficients(absorption.spectrum())
            }
            // Any band will do: transmittance is grey only if the absorptions add up to the same at every wavelength.
            (Some(absorption), ..) => absorption.spectrum().samples()[..1].to_vec(),
        };
        Self {
            scene,
            planned,
            reflectances: scene.materials.iter().map(coefficients).collect(),
            absorptions: scene.materials.iter().map(absorptions).collect(),
            exponents: planned.exponents(scene),
            phases: planned.phases(scene),
            thin_films: thin_film_numbers(scene, planned),
            absorbers: planned.absorbers(scene),
            groups: groups(scene, planned),
            by_step: model.filter(|model| {
                model.kind() == ModelKind::Sharpened(Order::Step)
                    && planned.plan.transmittance == Transmittance::Coloured
            }),
            matrices: model.filter(|_| planned.plan.transmittance == Transmittance::Mixed).map(Matrices::new),
        }
    }

    /// Returns the effect of a step at a data value.
    #[must_use]
    pub fn of_value(&self, value: f64) -> Step {
        Step::written(|step| self.write(value, step))
    }

    /// Sets a source and an opacity to those of [`Self::of_value`].
    pub fn write(&self, value: f64, step: [&mut Vec<f64>; 2]) {
        let terms = self.scene.terms_of(0);
        self.write_medium(&medium_of(terms, value, self.scene.materials.len(), |_| 1.0), step);
    }

    /// Returns the extinction of the terms of a `group` at a data value that light with shadows meets: optical depth per unit of
    /// length, the smallest spacing. Depth `number` 0 is that of all that is grey, the others are those of the plan's coloured
    /// absorbers, at the peak of their spectra.
    #[must_use]
    pub fn extinction(&self, value: f64, group: usize, number: usize) -> f64 {
        self.extinction_of(&self.of_group(value, group), number)
    }

    /// The medium of the terms of a `group` at a data value of its field, before its factor.
    fn of_group(&self, value: f64, group: usize) -> Medium {
        let (fields, of_terms) = &self.groups;
        let field = fields.get(group).copied().unwrap_or(0);
        let factor = |term: usize| if of_terms[field][term] == group { 1.0 } else { 0.0 };
        medium_of(self.scene.terms_of(field), value, self.scene.materials.len(), factor)
    }

    /// Index of the field whose values a group depends on.
    pub(super) fn field_of(&self, group: usize) -> usize {
        self.groups.0.get(group).copied().unwrap_or(0)
    }

    /// The `share` of the medium of each field, where all have these `values`, NaN outside the box of one, and the gradient of the first has
    /// this `magnitude`.
    pub(crate) fn medium_with(&self, values: &[f64], magnitude: f64, share: impl Fn(usize) -> f64) -> Medium {
        let (scene, materials) = (self.scene, self.scene.materials.len());
        let value_of = |name: &str| {
            let field = scene.fields.iter().position(|field| field.name == name);
            field.and_then(|field| values.get(field)).copied().unwrap_or(f64::NAN)
        };
        let mut medium = Medium::nothing(materials);
        for (field, &value) in values.iter().enumerate() {
            let share = share(field);
            if value.is_nan() || share <= 0.0 {
                continue;
            }
            let terms = scene.terms_of(field);
            let factor = |term: usize| {
                let term = &terms[term];
                let by_gradient = if field == 0 { factor_at(scene.transfer.factor_of(term), magnitude) } else { 1.0 };
                let by_shape = term.shape.as_ref().map_or(1.0, |shape| match &shape.second {
                    Second::Gradient => shape.at(value, magnitude),
                    Second::Field(name) => shape.at(value, value_of(name)),
                });
                let begun = share * by_gradient * by_shape;
                term.by.iter().fold(begun, |factor, by| factor * by.at(value_of(&by.field)))
            };
            medium.add(&medium_of(terms, value, materials, factor));
        }
        medium
    }

    /// Coefficients of each coloured absorber of shadows.
    #[must_use]
    pub fn absorber_coefficients(&self) -> Vec<Vec<f64>> {
        self.absorbers.iter().filter_map(|&material| self.absorptions.get(material).cloned()).collect()
    }

    pub(crate) fn extinction_of(&self, medium: &Medium, number: usize) -> f64 {
        let lengths = self.scene.frame.geometry.spacing.min_element() / self.scene.transfer.opacity_length;
        if let Some(&absorber) = number.checked_sub(1).and_then(|absorber| self.absorbers.get(absorber)) {
            return medium.absorption.get(absorber).copied().unwrap_or(0.0) * lengths;
        }
        if !self.absorbers.is_empty() {
            return self.occluding(medium) * lengths;
        }
        self.depths(medium, self.occluding(medium), lengths).first().copied().unwrap_or(0.0)
    }

    /// Sets a source and an opacity to the densities of the groups of terms, one behind the other, before their factors. `value` is that
    /// of a field.
    pub fn write_densities(&self, value: impl Fn(usize) -> f64, [source, opacity]: [&mut Vec<f64>; 2]) {
        let medium = |group: usize| self.of_group(value(self.field_of(group)), group);
        self.write_density_of(&medium(0), [source, opacity]);
        for group in 1..self.planned.plan.groups.in_tables() {
            let of_group = Step::written(|density| self.write_density_of(&medium(group), density));
            source.extend(of_group.source);
            opacity.extend(of_group.opacity);
        }
    }

    /// Sets a source and an opacity to the density of [`Self::medium_with`].
    pub(crate) fn write_density_with(
        &self,
        values: &[f64],
        magnitude: f64,
        share: impl Fn(usize) -> f64,
        density: [&mut Vec<f64>; 2],
    ) {
        self.write_density_of(&self.medium_with(values, magnitude, share), density);
    }

    /// Sets a source and an opacity to those of a step in the `medium` of a label, or to its density if the plan adds densities.
    pub fn write_label_of(&self, medium: &Medium, step: [&mut Vec<f64>; 2]) {
        if self.planned.plan.adds_densities() {
            self.write_density_of(medium, step);
        } else {
            self.write_medium(medium, step);
        }
    }

    /// Sets a source and an opacity to the density of `medium`: the light that it scatters per step length, and its
    /// optical depth per step length, at most [`LARGEST_DEPTH`] or [`LARGEST_SAMPLED_DEPTH`]. Of a deeper medium, both are reduced by
    /// the same factor.
    fn write_density_of(&self, medium: &Medium, [source, opacity]: [&mut Vec<f64>; 2]) {
        if self.is_nothing(medium) {
            return self.write_nothing([source, opacity]);
        }
        let steps = if self.planned.plan.blending.is_extreme() { 1.0 } else { self.step_in_opacity_lengths() };
        let depths = self.depths(medium, self.occluding(medium), steps);
        let largest = match self.planned.plan.integration {
            Integrate::Samples | Integrate::Refined => LARGEST_SAMPLED_DEPTH,
            Integrate::Segments => LARGEST_DEPTH,
        };
        let of_depth = |&depth: &f64| if depth > largest { steps * (largest / depth) } else { steps };
        let gains: Components = depths.iter().map(of_depth).collect();
        self.write_source(medium, &Gains { gains: &gains, reflected: &self.reflectances }, source);
        opacity.clear();
        opacity.extend(depths.iter().map(|depth| depth.min(largest)));
        opacity.resize(opacity_numbers(self.planned), 0.0);
    }

    /// Whether a step in `medium` has no effect in any model.
    fn is_nothing(&self, medium: &Medium) -> bool {
        self.by_step.is_none() && medium.scattering.iter().chain(&medium.absorption).all(|&depth| depth == 0.0)
    }

    /// Sets a source and an opacity to those of no medium.
    fn write_nothing(&self, [source, opacity]: [&mut Vec<f64>; 2]) {
        for (numbers, length) in
            [(source, self.planned.plan.parts().lanes * LANE), (opacity, opacity_numbers(self.planned))]
        {
            numbers.clear();
            numbers.resize(length, 0.0);
        }
    }

    fn step_in_opacity_lengths(&self) -> f64 {
        self.scene.step_length() / self.scene.transfer.opacity_length
    }

    /// Scattering that occludes: optical depth per opacity length.
    fn occluding(&self, medium: &Medium) -> f64 {
        medium.occluding(&self.scene.materials)
    }

    /// Sets a source and an opacity to those of a step in `medium`.
    fn write_medium(&self, medium: &Medium, [source, opacity]: [&mut Vec<f64>; 2]) {
        if self.is_nothing(medium) {
            return self.write_nothing([source, opacity]);
        }
        let steps = self.step_in_opacity_lengths();
        let scattering = self.occluding(medium);
        if let Some(matrices) = &self.matrices {
            return self.write_mixed(matrices, medium, [scattering, steps], [source, opacity]);
        }
        let depths = self.depths(medium, scattering, steps);
        opacity.clear();
        // Without absorption, all components are as deep.
        let mut before = (0.0_f64, 0.0);
        opacity.extend(depths.iter().map(|&depth| {
            if depth.to_bits() != before.0.to_bits() {
                before = (depth, -(-depth).exp_m1());
            }
            before.1
        }));
        let of_depth = |(&depth, &opacity): (&f64, &f64)| if depth > 0.0 { steps * (opacity / depth) } else { steps };
        let gains: Components = depths.iter().zip(&*opacity).map(of_depth).collect();
        self.write_source(medium, &Gains { gains: &gains, reflected: &self.reflectances }, source);
        opacity.resize(opacity_numbers(self.planned), 0.0);
    }

    /// [`Self::write_medium`] for matrix transmittance: the loss matrix of the light from behind, and the projected
    /// source.
    fn write_mixed(
        &self,
        matrices: &Matrices,
        medium: &Medium,
        [scattering, steps]: [f64; 2],
        [source, opacity]: [&mut Vec<f64>; 2],
    ) {
        let mut depth = [scattering * steps; BANDS];
        for (&height, material) in medium.absorption.iter().zip(&self.scene.materials) {
            if let Some(shape) = material.absorption.as_ref().filter(|_| height > 0.0) {
                depth.iter_mut().zip(shape.spectrum().samples()).for_each(|(sum, part)| *sum += height * steps * part);
            }
        }
        let lost = depth.map(|depth| -(-depth).exp_m1());
        let gain: [f64; BANDS] =
            std::array::from_fn(|band| if depth[band] > 0.0 { steps * (lost[band] / depth[band]) } else { steps });
        let reflected: Vec<Vec<f64>> = (self.scene.materials.iter().zip(&medium.scattering))
            .map(|(material, &height)| match material.reflectance.spectrum().samples() {
                samples if height > 0.0 => matrices.vector(&std::array::from_fn(|band| gain[band] * samples[band])),
                _ => Vec::new(),
            })
            .collect();
        let white = matrices.vector(&gain);
        self.write_source(medium, &Projected { white: &white, reflected: &reflected }, source);
        *opacity = matrices.matrix(&lost);
        opacity.resize(opacity_numbers(self.planned), 0.0);
    }

    /// Optical depth of each transmittance component across a step of `steps` opacity lengths.
    fn depths(&self, medium: &Medium, scattering: f64, steps: f64) -> Components {
        if let Some(model) = self.by_step {
            let mut depth = Spectrum::constant(scattering);
            for (&height, material) in medium.absorption.iter().zip(&self.scene.materials) {
                if let Some(shape) = &material.absorption {
                    depth = &depth + &shape.spectrum().scaled(height);
                }
            }
            return model.step_depths(&depth.scaled(steps), Amplification::Held).into();
        }
        let mut depths: Components = smallvec![scattering; self.planned.plan.transmittance_numbers()];
        for (&height, shape) in medium.absorption.iter().zip(&self.absorptions).filter(|(height, _)| **height > 0.0) {
            for (sum, part) in depths.iter_mut().zip(shape) {
                *sum += height * part;
            }
        }
        depths.iter_mut().for_each(|depth| *depth *= steps);
        depths
    }

    /// Sets `source` to that of a step, by the light that it sends back.
    fn write_source(&self, medium: &Medium, sent: &impl SentBack, source: &mut Vec<f64>) {
        let plan = &self.planned.plan;
        let parts = plan.parts();
        source.clear();
        source.resize(parts.lanes * LANE, 0.0);
        let used = self.planned.materials.iter().map(|&m| (m, medium.scattering[m]));
        let Accumulate::Spectral { shares, .. } = plan.accumulate else {
            for (weight, (_, depth)) in source.iter_mut().zip(used) {
                *weight = depth * sent.white(0);
            }
            return;
        };
        let components = plan.components();
        // Adds white to part `i` of those that start with the vector `first`.
        let add_white = |first: usize, i: usize, white: f64, source: &mut Vec<f64>| match plan.transmittance {
            Transmittance::Grey => source[first * LANE + i] += white * sent.white(0),
            Transmittance::Coloured | Transmittance::Mixed => {
                let first = (first + i * plan.lanes()) * LANE;
                for (c, sum) in source[first..][..components].iter_mut().enumerate() {
                    *sum += white * sent.white(c);
                }
            }
        };
        for (m, depth) in used.filter(|&(_, depth)| depth > 0.0) {
            let material = &self.scene.materials[m];
            let phase =
                self.phases.iter().position(|phase| phase.to_bits() == (material.phase + 0.0).to_bits()).unwrap_or(0);
            let spectra: &[(usize, f64)] = match shares {
                Shares::Equal => &[(parts.unshaded + phase * plan.lanes(), 1.0)],
                Shares::Own if plan.light.is_unshaded() => {
                    &[(parts.ambient, material.ambient), (parts.diffuse, material.own_diffuse()), (parts.unshaded, 1.0)]
                }
                Shares::Own => &[(parts.ambient, material.ambient), (parts.diffuse, material.own_diffuse())],
            };
            for &(first, share) in spectra {
                sent.add_reflected(m, share * depth, &mut source[first * LANE..][..components]);
            }
            if let Some(highlight) =
                self.exponents.iter().position(|&e| material.white_specular() > 0.0 && e == material.exponent)
            {
                add_white(parts.highlights, highlight, material.specular * depth, source);
            }
            if let Some(film) = self.thin_films[m] {
                add_white(parts.thin_films, film, depth, source);
            }
        }
    }
}

/// The light that a step sends back, by components.
trait SentBack {
    /// That of a unit of white scattering, in a component.
    fn white(&self, component: usize) -> f64;

    /// Adds that of so many units of a material to `sums`, component by component.
    fn add_reflected(&self, material: usize, units: f64, sums: &mut [f64]);
}

/// A gain for each component, or one for all, on the reflectances of materials.
struct Gains<'a> {
    gains: &'a [f64],
    reflected: &'a [Vec<f64>],
}

impl SentBack for Gains<'_> {
    fn white(&self, component: usize) -> f64 {
        self.gains[component.min(self.gains.len() - 1)]
    }

    fn add_reflected(&self, material: usize, units: f64, sums: &mut [f64]) {
        let parts = sums.iter_mut().zip(&self.reflected[material]);
        match *self.gains {
            [gain] => parts.for_each(|(sum, reflectance)| *sum += units * gain * reflectance),
            _ => parts.zip(self.gains).for_each(|((sum, reflectance), gain)| *sum += units * gain * reflectance),
        }
    }
}

/// Spectra that a model has projected: of white, and of each material.
struct Projected<'a> {
    white: &'a [f64],
    reflected: &'a [Vec<f64>],
}

impl SentBack for Projected<'_> {
    fn white(&self, component: usize) -> f64 {
        self.white[component]
    }

    fn add_reflected(&self, material: usize, units: f64, sums: &mut [f64]) {
        sums.iter_mut().zip(&self.reflected[material]).for_each(|(sum, reflected)| *sum += units * reflected);
    }
}

/// Number of the film of each material, if entries of `planned` have parts for them.
fn thin_film_numbers(scene: &Scene, planned: &Planned) -> Vec<Option<usize>> {
    let mut numbers = vec![None; scene.materials.len()];
    if planned.model.is_some() {
        for (number, film) in planned.thin_films(scene).iter().enumerate() {
            if let Some(of_material) = planned.materials.get(film.weight).and_then(|&m| numbers.get_mut(m)) {
                *of_material = Some(number);
            }
        }
    }
    numbers
}

/// The field of each group of the plan, and the group of each term of each field; without groups, all terms are of group 0.
fn groups(scene: &Scene, planned: &Planned) -> (Vec<usize>, Vec<Vec<usize>>) {
    if !planned.plan.groups.any() {
        return (vec![0], vec![vec![0; scene.transfer.terms.len()]]);
    }
    let groups = scene.groups();
    let of_field = |field: usize| {
        let all = if field == 0 { &scene.transfer.gradient_opacity[..] } else { &[] };
        let of_term = |term: &Term| {
            let wanted = Group { field, factors: term.factors_among(all) };
            groups.iter().position(|group| *group == wanted).unwrap_or(0)
        };
        scene.terms_of(field).iter().map(of_term).collect()
    };
    (groups.iter().map(|group| group.field).collect(), (0..=scene.fields.further().len()).map(of_field).collect())
}

/// Number of entries: as stated in the scene, else as needed for the narrowest feature.
fn entries(scene: &Scene, domains: &[[f64; 2]]) -> usize {
    if let Some(entries) = scene.transfer.entries {
        return entries;
    }
    if scene.transfer.lookup == Lookup::Nearest {
        return 256;
    }
    // As a part of the domain of its field.
    let of_field = |(field, &[low, high]): (usize, &[f64; 2])| {
        let narrowest = |terms: &[Term]| {
            let bends = bends(terms).into_iter().filter(|bend| (low..=high).contains(bend));
            let bends: Vec<f64> = bends.collect();
            bends.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min)
        };
        // Labels go by the values of the first.
        let labels = scene.declared().iter().filter(|_| field == 0).map(|entry| narrowest(&entry.terms));
        labels.fold(narrowest(scene.terms_of(field)), f64::min) / (high - low)
    };
    let narrowest = domains.iter().enumerate().map(of_field).fold(f64::INFINITY, f64::min);
    let mut entries = FEWEST;
    while entries < MOST && narrowest * count(entries) < PER_FEATURE {
        entries *= 2;
    }
    entries
}
