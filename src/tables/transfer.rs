//! The transfer function as a table over the data's range, for one step length.

use super::{Storage, rounded};
use crate::number::count;
use crate::plan::{LANE, Planned};
use crate::scene::{Lookup, Medium, Scene, depth_from_opacity};

/// The least entries a linear table has.
const FEWEST: usize = 1024;
/// The most; a bend every value of 16-bit data is still met.
const MOST: usize = 1 << 16;
/// Entries that the narrowest feature of a transfer function spans at least: its ends then move by an eighth of it.
const PER_FEATURE: f64 = 8.0;

/// Entry `i` of `n` stands for the value `low + i/(n−1)·(high − low)`.
///
/// What a step Δs of the medium there does (COLOUR.md A7): light lost, α = 1 − e^(−τΔs), and light gained per material,
/// `w_m = σ_m (1 − e^(−τΔs))/τ`, which is `σ_m Δs` where nothing is lost. X-ray materials are in σ but not in τ.
#[derive(Clone, Debug, PartialEq)]
pub struct TransferTable {
    /// `entries × lanes` vectors of weights, spare ones zero.
    pub weights: Vec<[f32; LANE]>,
    /// One α an entry.
    pub opacity: Vec<f32>,
    /// Vectors an entry.
    pub lanes: usize,
}

/// What one step does: weights of the materials of a plan, and opacity.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// `w_m`.
    pub weights: Vec<f64>,
    /// α.
    pub opacity: f64,
}

impl TransferTable {
    /// The table of `scene` over `domain` (lowest and highest value).
    #[must_use]
    pub fn new(scene: &Scene, planned: &Planned, domain: [f64; 2]) -> Self {
        let entries = entries(scene, domain);
        let last = count(entries - 1);
        let steps = (0..entries).map(|i| {
            let value = (domain[1] - domain[0]).mul_add(count(i) / last, domain[0]);
            step_of_value(scene, planned, value)
        });
        Self::of_steps(planned, steps)
    }

    /// A table with a row for each declared label, in their order; row 0 is empty, so that label numbers start at 1.
    #[must_use]
    pub fn of_labels(scene: &Scene, planned: &Planned) -> Self {
        Self::of_steps(planned, steps_of_labels(scene, planned).into_iter())
    }

    fn of_steps(planned: &Planned, steps: impl Iterator<Item = Step>) -> Self {
        let lanes = planned.plan.table_lanes();
        let (mut weights, mut opacity) = (Vec::new(), Vec::new());
        for step in steps {
            let first = weights.len();
            weights.resize(first + lanes, [0.0; LANE]);
            for (i, &weight) in step.weights.iter().enumerate() {
                weights[first + i / LANE][i % LANE] = rounded(weight);
            }
            opacity.push(rounded(step.opacity));
        }
        Self { weights, opacity, lanes }
    }

    /// Entries of the table.
    #[must_use]
    pub fn entries(&self) -> usize {
        self.opacity.len()
    }

    /// Scale and offset from a texel's value to a place in the table, 0 to `entries − 1`.
    #[must_use]
    pub fn coordinate_from_texel(&self, storage: &Storage) -> [f64; 2] {
        storage.normalised_from_texel().map(|term| term * count(self.entries() - 1))
    }

    /// Whether entry `i` does anything.
    pub(crate) fn is_active(&self, i: usize) -> bool {
        self.opacity[i] != 0.0
            || self.weights[i * self.lanes..(i + 1) * self.lanes].iter().flatten().any(|&weight| weight != 0.0)
    }
}

/// What a step does at a data value.
#[must_use]
pub fn step_of_value(scene: &Scene, planned: &Planned, value: f64) -> Step {
    step_of_medium(scene, planned, &scene.transfer.medium(value, scene.materials.len()))
}

/// What a step does at each declared label, label `i` of the scene at `i + 1`; nothing at 0.
#[must_use]
pub fn steps_of_labels(scene: &Scene, planned: &Planned) -> Vec<Step> {
    let nothing = Step { weights: vec![0.0; planned.materials.len()], opacity: 0.0 };
    let declared = scene.labels.iter().flat_map(|labels| &labels.declared);
    let steps = declared.map(|entry| {
        let mut scattering = vec![0.0; scene.materials.len()];
        if let Some(depth) = scattering.get_mut(entry.material) {
            *depth = depth_from_opacity(entry.opacity);
        }
        step_of_medium(scene, planned, &Medium { scattering })
    });
    std::iter::once(nothing).chain(steps).collect()
}

/// What a step does in `medium`.
fn step_of_medium(scene: &Scene, planned: &Planned, medium: &Medium) -> Step {
    let steps = scene.accuracy.step_length / scene.transfer.opacity_length;
    let occluding = scene.materials.iter().zip(&medium.scattering).filter(|(material, _)| !material.xray);
    let depth: f64 = occluding.map(|(_, depth)| depth).sum();
    let opacity = -(-depth * steps).exp_m1();
    let gain = if depth > 0.0 { opacity / depth } else { steps };
    let weights = planned.materials.iter().map(|&m| medium.scattering[m] * gain).collect();
    Step { weights, opacity }
}

/// As many entries as the narrowest feature needs, where the scene states no number.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::plan;
    use crate::progress::Quiet;
    use crate::scene::{SceneOptions, parse};

    /// The opacity that a table of `entries` (or as many as it takes) has at voxels of value `value`.
    fn opacity_at(value: f64, entries: &str) -> f64 {
        let text = format!(
            "version = 1\n[volume]\nphantom = \"slab\"\n[materials.m]\nreflectance = 0.5\n[transfer]\n{entries}\n\
             [[transfer.intervals]]\nmaterial = \"m\"\nrange = [31000, 31001]\nopacity = 0.5\n"
        );
        let path = std::path::Path::new("");
        let scene = parse("test", &text, path, &SceneOptions::default(), &Quiet);
        let table = scene.map(|scene| TransferTable::new(&scene, &plan(&scene), [0.0, 65535.0]));
        table.map_or(f64::NAN, |table| {
            let place = value / 65535.0 * count(table.entries() - 1);
            let (before, fraction) = (crate::number::whole(place), place.fract());
            let at = |i: usize| f64::from(table.opacity[i.min(table.entries() - 1)]);
            (at(before + 1) - at(before)).mul_add(fraction, at(before))
        })
    }

    #[test]
    fn an_interval_one_value_wide_survives_in_16_bit_data() {
        for value in [31000.0, 31001.0] {
            assert!((opacity_at(value, "") - 0.5).abs() <= 1e-6, "opacity at {value}: {}", opacity_at(value, ""));
        }
        for value in [30999.0, 31002.0] {
            assert!(opacity_at(value, "").abs() <= 1e-6, "opacity at {value}: {}", opacity_at(value, ""));
        }
        // Fewer entries lose it: that is why they are counted by the narrowest feature.
        for entries in ["entries = 1024", "entries = 4096"] {
            assert!(opacity_at(31000.0, entries) < 0.25, "{entries}: {}", opacity_at(31000.0, entries));
        }
    }
}
