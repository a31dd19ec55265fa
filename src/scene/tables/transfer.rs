//! Transfer function sampled as a table over the range of the data, for one step length.

use super::Storage;
use crate::plan::{Accumulate, LANE, Planned, Shares, Transmittance};
use crate::{Lookup, Material, Medium, Scene, depth_from_opacity};
use relume_base::number::count;
use relume_base::number::rounded;
use relume_colour::model::{Amplification, ColourModel, Matrices, ModelKind, Order};
use relume_colour::spectrum::{BANDS, Spectrum};

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

/// Transfer table: entry `i` of `n` belongs to the value `low + i/(n−1)·(high − low)`.
///
/// An entry describes a step Δs through the medium (docs/theory/march.md), in vectors laid out by the plan: the lost
/// light α = 1 − e^(−τΔs), and the gained light `σ_m (1 − e^(−τΔs))/τ`, or `σ_m Δs` without loss, per material or times
/// its spectrum. X-ray materials count in σ but not in τ.
#[derive(Clone, Debug, PartialEq)]
pub struct TransferTable {
    /// Gained light: `entries × lanes` vectors; unused numbers are zero.
    pub source: Vec<[f32; LANE]>,
    /// Lost light α: [`Self::opacity_numbers`] numbers per entry; unused numbers are zero.
    pub opacity: Vec<f32>,
    /// Vectors per entry of [`Self::source`].
    pub lanes: usize,
    /// Numbers per entry of [`Self::opacity`].
    pub opacity_numbers: usize,
}

/// Effect of one step in f64, laid out like a table entry.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// Gained light.
    pub source: Vec<f64>,
    /// Lost light α.
    pub opacity: Vec<f64>,
}

impl TransferTable {
    /// Builds the table of `scene` over `domain` (lowest and highest value).
    #[must_use]
    pub fn new(scene: &Scene, planned: &Planned, domain: [f64; 2]) -> Self {
        let steps = Steps::new(scene, planned);
        Self::of_steps(planned, Self::values(scene, domain).map(|value| steps.of_value(value)))
    }

    /// Values of the entries of the table of `scene` over `domain`.
    pub(super) fn values(scene: &Scene, domain: [f64; 2]) -> impl Iterator<Item = f64> + use<> {
        let entries = entries(scene, domain);
        let last = count(entries - 1);
        (0..entries).map(move |i| (domain[1] - domain[0]).mul_add(count(i) / last, domain[0]))
    }

    /// Builds a table with one row per declared label, in their order. Row 0 is empty, so that label rows start at 1.
    #[must_use]
    pub fn of_labels(scene: &Scene, planned: &Planned) -> Self {
        Self::of_steps(planned, Steps::new(scene, planned).of_labels().into_iter())
    }

    /// [`Self::of_labels`] with densities in place of steps: scattered light and optical depth per step length.
    #[must_use]
    pub fn densities_of_labels(scene: &Scene, planned: &Planned) -> Self {
        Self::of_steps(planned, Steps::new(scene, planned).densities_of_labels().into_iter())
    }

    fn of_steps(planned: &Planned, steps: impl Iterator<Item = Step>) -> Self {
        let (mut source, mut opacity) = (Vec::new(), Vec::new());
        for step in steps {
            source.extend(step.source.chunks_exact(LANE).map(|lane| std::array::from_fn(|part| rounded(lane[part]))));
            opacity.extend(step.opacity.iter().copied().map(rounded));
        }
        Self { source, opacity, lanes: planned.plan.parts().lanes, opacity_numbers: opacity_numbers(planned) }
    }

    /// Number of entries.
    #[must_use]
    pub fn entries(&self) -> usize {
        self.opacity.len() / self.opacity_numbers
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

    /// Whether each entry has a nonzero number.
    #[must_use]
    pub fn active_entries(&self) -> Vec<bool> {
        (0..self.entries()).map(|i| self.is_active(i)).collect()
    }

    /// Whether entry `i` has any nonzero number.
    pub(crate) fn is_active(&self, i: usize) -> bool {
        let source = &self.source[i * self.lanes..][..self.lanes];
        let opacity = &self.opacity[i * self.opacity_numbers..][..self.opacity_numbers];
        source.iter().flatten().chain(opacity).any(|&number| number != 0.0)
    }
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
        self.of_medium(&self.scene.transfer.medium(value, self.scene.materials.len()))
    }

    /// Returns the extinction at a data value that light with shadows meets: optical depth per unit of length, the smallest
    /// spacing. Depth `number` 0 is that of all that is grey, the others are those of the plan's coloured absorbers, at the peak
    /// of their spectra.
    #[must_use]
    pub fn extinction(&self, value: f64, number: usize) -> f64 {
        self.extinction_of(&self.scene.transfer.medium(value, self.scene.materials.len()), number)
    }

    /// Coefficients of each coloured absorber of shadows.
    #[must_use]
    pub fn absorber_coefficients(&self) -> Vec<Vec<f64>> {
        self.absorbers.iter().filter_map(|&material| self.absorptions.get(material).cloned()).collect()
    }

    /// Returns [`Self::extinction`] of each declared label: label `i` of the scene at index `i + 1`, 0 at 0.
    #[must_use]
    pub fn extinctions_of_labels(&self, number: usize) -> Vec<f64> {
        self.label_media().map(|medium| self.extinction_of(&medium, number)).collect()
    }

    fn extinction_of(&self, medium: &Medium, number: usize) -> f64 {
        let lengths = self.scene.frame.geometry.spacing.min_element() / self.scene.transfer.opacity_length;
        if let Some(&absorber) = number.checked_sub(1).and_then(|absorber| self.absorbers.get(absorber)) {
            return medium.absorption.get(absorber).copied().unwrap_or(0.0) * lengths;
        }
        if !self.absorbers.is_empty() {
            return self.occluding(medium) * lengths;
        }
        self.depths(medium, self.occluding(medium), lengths).first().copied().unwrap_or(0.0)
    }

    /// Returns the density at a data value.
    #[must_use]
    pub fn density(&self, value: f64) -> Step {
        self.density_of(&self.scene.transfer.medium(value, self.scene.materials.len()))
    }

    /// Returns the effects of a step at each declared label: label `i` of the scene at index `i + 1`, none at 0.
    #[must_use]
    pub fn of_labels(&self) -> Vec<Step> {
        self.label_media().map(|medium| self.of_medium(&medium)).collect()
    }

    /// Returns the densities of each declared label: label `i` of the scene at index `i + 1`, 0 at 0.
    #[must_use]
    pub fn densities_of_labels(&self) -> Vec<Step> {
        self.label_media().map(|medium| self.density_of(&medium)).collect()
    }

    /// The media of the labels, one at a time: many labels times many materials are many numbers.
    fn label_media(&self) -> impl Iterator<Item = Medium> {
        let materials = self.scene.materials.len();
        let nothing = Medium { scattering: vec![0.0; materials], absorption: vec![0.0; materials] };
        let declared = self.scene.labels.iter().flat_map(|labels| &labels.declared);
        std::iter::once(None).chain(declared.map(Some)).map(move |entry| {
            let mut medium = nothing.clone();
            if let Some(entry) = entry.filter(|entry| entry.material < materials) {
                medium.scattering[entry.material] = depth_from_opacity(entry.opacity);
                medium.absorption[entry.material] = entry.absorption;
            }
            medium
        })
    }

    /// Returns the density of `medium`, in the layout of a step: the light that it scatters per step length, and its
    /// optical depth per step length, at most [`LARGEST_DEPTH`]. Of a deeper medium, both are reduced by the same factor.
    fn density_of(&self, medium: &Medium) -> Step {
        let scene = self.scene;
        let steps = scene.step_length() / scene.transfer.opacity_length;
        let depths = self.depths(medium, self.occluding(medium), steps);
        let gain = |component: usize| {
            let depth = depths[component.min(depths.len() - 1)];
            if depth > LARGEST_DEPTH { steps * (LARGEST_DEPTH / depth) } else { steps }
        };
        let source = self.source(medium, gain, |m, c, factor| factor * gain(c) * self.reflectances[m][c]);
        let mut opacity: Vec<f64> = depths.iter().map(|depth| depth.min(LARGEST_DEPTH)).collect();
        opacity.resize(opacity_numbers(self.planned), 0.0);
        Step { source, opacity }
    }

    /// Scattering of the materials that occlude: optical depth per opacity length.
    fn occluding(&self, medium: &Medium) -> f64 {
        let occluding = self.scene.materials.iter().zip(&medium.scattering).filter(|(material, _)| !material.xray);
        occluding.map(|(_, depth)| depth).sum()
    }

    /// Returns the effect of a step in `medium`.
    fn of_medium(&self, medium: &Medium) -> Step {
        let scene = self.scene;
        let steps = scene.step_length() / scene.transfer.opacity_length;
        let scattering = self.occluding(medium);
        if let Some(matrices) = &self.matrices {
            return self.mixed(matrices, medium, scattering, steps);
        }
        let depths = self.depths(medium, scattering, steps);
        let mut opacity: Vec<f64> = depths.iter().map(|depth| -(-depth).exp_m1()).collect();
        let gain = |component: usize| {
            let component = component.min(depths.len() - 1);
            if depths[component] > 0.0 { steps * (opacity[component] / depths[component]) } else { steps }
        };
        let source = self.source(medium, gain, |m, c, factor| factor * gain(c) * self.reflectances[m][c]);
        opacity.resize(opacity_numbers(self.planned), 0.0);
        Step { source, opacity }
    }

    /// Returns the effect of a step in `medium` for matrix transmittance: the loss matrix of the light from behind, and
    /// the projected source.
    fn mixed(&self, matrices: &Matrices, medium: &Medium, scattering: f64, steps: f64) -> Step {
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
        let mut opacity = matrices.matrix(&lost);
        opacity.resize(opacity_numbers(self.planned), 0.0);
        Step { source: self.source(medium, |c| white[c], |m, c, factor| factor * reflected[m][c]), opacity }
    }

    /// Optical depth of each transmittance component across a step of `steps` opacity lengths.
    fn depths(&self, medium: &Medium, scattering: f64, steps: f64) -> Vec<f64> {
        if let Some(model) = self.by_step {
            let mut depth = Spectrum::constant(scattering);
            for (&height, material) in medium.absorption.iter().zip(&self.scene.materials) {
                if let Some(shape) = &material.absorption {
                    depth = &depth + &shape.spectrum().scaled(height);
                }
            }
            return model.step_depths(&depth.scaled(steps), Amplification::Held);
        }
        let mut depths = vec![scattering; self.planned.plan.transmittance_numbers()];
        for (&height, shape) in medium.absorption.iter().zip(&self.absorptions) {
            for (sum, part) in depths.iter_mut().zip(shape) {
                *sum += height * part;
            }
        }
        depths.into_iter().map(|depth| depth * steps).collect()
    }

    /// Source of a step. A unit of scattering gives `gain(c)` in component c for white, and f units of material m give
    /// `reflected(m, c, f)`.
    fn source(
        &self,
        medium: &Medium,
        gain: impl Fn(usize) -> f64,
        reflected: impl Fn(usize, usize, f64) -> f64,
    ) -> Vec<f64> {
        let plan = &self.planned.plan;
        let parts = plan.parts();
        let mut source = vec![0.0; parts.lanes * LANE];
        let used = self.planned.materials.iter().map(|&m| (m, medium.scattering[m]));
        let Accumulate::Spectral { shares, .. } = plan.accumulate else {
            for (weight, (_, depth)) in source.iter_mut().zip(used) {
                *weight = depth * gain(0);
            }
            return source;
        };
        // Adds white to part `i` of those that start with the vector `first`.
        let add_white = |first: usize, i: usize, white: f64, source: &mut Vec<f64>| match plan.transmittance {
            Transmittance::Grey => source[first * LANE + i] += white * gain(0),
            Transmittance::Coloured | Transmittance::Mixed => {
                let first = (first + i * plan.lanes()) * LANE;
                for c in 0..plan.components() {
                    source[first + c] += white * gain(c);
                }
            }
        };
        for (m, depth) in used.filter(|&(_, depth)| depth > 0.0) {
            let material = &self.scene.materials[m];
            let phase =
                self.phases.iter().position(|phase| phase.to_bits() == (material.phase + 0.0).to_bits()).unwrap_or(0);
            let spectra: &[(usize, f64)] = match shares {
                Shares::Equal => &[(parts.unshaded + phase * plan.lanes(), 1.0)],
                Shares::Own if plan.light.is_ambient() => {
                    &[(parts.ambient, material.ambient), (parts.diffuse, material.own_diffuse()), (parts.unshaded, 1.0)]
                }
                Shares::Own => &[(parts.ambient, material.ambient), (parts.diffuse, material.own_diffuse())],
            };
            for &(first, share) in spectra {
                for c in 0..plan.components() {
                    source[first * LANE + c] += reflected(m, c, share * depth);
                }
            }
            if let Some(highlight) =
                self.exponents.iter().position(|&e| material.white_specular() > 0.0 && e == material.exponent)
            {
                add_white(parts.highlights, highlight, material.specular * depth, &mut source);
            }
            if let Some(film) = self.thin_films[m] {
                add_white(parts.thin_films, film, depth, &mut source);
            }
        }
        source
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

/// Number of entries: as stated in the scene, else as needed for the narrowest feature.
fn entries(scene: &Scene, [low, high]: [f64; 2]) -> usize {
    if let Some(entries) = scene.transfer.entries {
        return entries;
    }
    if scene.transfer.lookup == Lookup::Nearest {
        return 256;
    }
    let bends: Vec<f64> = scene.transfer.bends().into_iter().filter(|bend| (low..=high).contains(bend)).collect();
    let narrowest = bends.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
    let mut entries = FEWEST;
    while entries < MOST && narrowest / (high - low) * count(entries) < PER_FEATURE {
        entries *= 2;
    }
    entries
}
