//! The medium of a scene by itself, in which light that has scattered before travels.

use std::sync::Arc;

use super::clip::{FAR, Planes};
use super::closing::across;
use super::samples::Exact;
use super::shadows::{Reaching, to_face};
use super::{ReferenceError, Samples, Step};
use crate::plan::{LANE, LightPlan, Planned, Transmittance, planned};
use crate::tables::{
    CELL, Cells, LabelMap, LabelTable, LightGrid, Occupancy, PlacedField, PositionTable, Storage, StoredScene,
    StoredVolume, TransferTable, occupancy_of_fields,
};
use crate::{Direction, FIELDS, Integration, Position, Scene, Shading, ShadowMethod, Shadows};
use glam::DVec3;
use relume_base::number::{count, whole};
use relume_base::progress::Progress;
use relume_colour::spectrum::Reflectance;
use smallvec::SmallVec;

/// Numbers of the light that a medium scatters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Numbers {
    /// One for each material in use, whatever its reflectance.
    Materials,
    /// One for each component of the plan, of reflected light.
    Components,
}

/// A scene without all that shades: materials scatter evenly, and what occludes nothing scatters nothing.
#[derive(Debug)]
pub(super) struct Scatterer {
    scene: Scene,
    pub(super) planned: Planned,
    /// Positions of the scene with directions, by their accumulators.
    lit: Vec<usize>,
    pub(super) clip: Planes<f64>,
    pub(super) crop: [[f64; 3]; 2],
    pub(super) local_scale: DVec3,
}

/// A straight way through a medium.
pub(super) struct Way {
    base: [f64; 3],
    /// In texture coordinates per unit of length.
    along: [f64; 3],
    /// Distances at which the medium begins and ends.
    pub(super) range: [f64; 2],
}

impl Way {
    /// The place at a distance.
    pub(super) fn at(&self, distance: f64) -> [f64; 3] {
        std::array::from_fn(|axis| distance.mul_add(self.along[axis], self.base[axis]))
    }
}

impl Scatterer {
    /// The medium of `scene`, whose densities are per unit of length.
    pub(super) fn new(scene: &Scene, of: &Planned, numbers: Numbers) -> Self {
        let geometry = &scene.frame.geometry;
        let unit = geometry.spacing.min_element();
        let mut medium =
            Scene { lights: Vec::new(), shading: Shading::None, background: None, block: None, ..scene.clone() };
        medium.accuracy.step_length = unit;
        medium.accuracy.integration = Integration::Samples;
        medium.shadows = Shadows { start: Some(0.0), reach: None, ..scene.shadows };
        for material in &mut medium.materials {
            (material.phase, material.film) = (0.0, None);
            let reflected = material.reflectance.spectrum().scaled(material.occludes);
            if let Ok(reflectance) = Reflectance::new(reflected) {
                material.reflectance = reflectance;
            }
        }
        let model = match numbers {
            Numbers::Materials => None,
            Numbers::Components => of.model.clone(),
        };
        let mut own = planned(&medium, model);
        let (seen, lit) = positions(scene, of);
        let absorbers = if own.plan.transmittance == Transmittance::Coloured { of.plan.light.absorbers } else { 0 };
        own.plan.light = LightPlan::new(&seen, false, medium.shadows.method, absorbers);
        own.positions = seen;
        // A sample is a density, of which a step has any length.
        own.plan.groups.number = own.plan.groups.number.max(1);
        let grid = LightGrid::new(&medium, 1.0);
        Self {
            clip: Planes::new(&grid.clip),
            crop: grid.crop.map(|corner| corner.to_array()),
            local_scale: geometry.spacing / unit * DVec3::from_array(geometry.dims.map(count)),
            scene: medium,
            planned: own,
            lit,
        }
    }

    /// The scene.
    pub(super) const fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The same with light grids of this spacing, in voxels, whatever the scene's method: a ray to each light from each sample of a row would take
    /// hundreds of times as long.
    pub(super) fn with_light_grids_of(mut self, spacing: f64) -> Self {
        self.scene.shadows.spacing = spacing;
        self.scene.shadows.method = ShadowMethod::Grid;
        self.planned.plan.light.method = ShadowMethod::Grid;
        self
    }

    /// Its tables and volume, as a device would store them.
    pub(super) fn stored(&self, storage: &Storage, labels: Option<&LabelMap>) -> StoredScene {
        let volume = self.scene.volume();
        // Gradients that no factor depends on take three quarters of the memory.
        let stored = if self.planned.plan.gradient() { StoredVolume::new } else { StoredVolume::of_values };
        let stored = Arc::new(stored(volume, storage));
        StoredScene::of(&self.scene, &self.planned, (storage.clone(), stored), labels.cloned().map(Arc::new))
    }

    /// Exact samples of its densities.
    pub(super) fn samples<'a>(&'a self, storage: &Storage, labels: Option<&'a LabelMap>) -> Exact<'a> {
        Exact::new(&self.scene, &self.planned, storage.clone(), labels)
    }

    /// Macrocells with any medium.
    pub(super) fn occupancy(&self, storage: &Storage, labels: Option<&LabelMap>) -> Occupancy {
        let further = Storage::of_further(&self.planned.plan, &self.scene);
        let storages: Vec<&Storage> = std::iter::once(storage).chain(&further).collect();
        let domains: Vec<[f64; 2]> = storages.iter().map(|storage| storage.domain).collect();
        let table = TransferTable::new(&self.scene, &self.planned, &domains);
        let first = Cells::new(self.scene.volume(), storage, labels);
        if further.is_empty() {
            return first.occupancy(&table.active_entries());
        }
        let fields = self.scene.fields.further().iter().zip(&further);
        let others: Vec<Cells> = fields.map(|(field, storage)| Cells::new(&field.volume, storage, None)).collect();
        let cells: Vec<&Cells> = std::iter::once(&first).chain(&others).collect();
        occupancy_of_fields(&cells, &PlacedField::of_further(&self.scene), &table)
    }

    /// Largest extinction in each macrocell, or a little less or more: of the first field by its values there, and of others and of labels anywhere.
    pub(super) fn majorants(&self, storage: &Storage, labels: Option<&LabelMap>) -> Majorants {
        let further = Storage::of_further(&self.planned.plan, &self.scene);
        let domains: Vec<[f64; 2]> = std::iter::once(storage).chain(&further).map(|storage| storage.domain).collect();
        let table = TransferTable::new(&self.scene, &self.planned, &domains);
        let largest = |numbers: &[f32]| numbers.iter().fold(0.0_f64, |most, &number| most.max(f64::from(number)));
        let of_field = |field: usize| -> Vec<f64> {
            let of_entry = |entry: usize| {
                let [_, opacity] = table.entry(entry);
                let groups = opacity.chunks_exact(table.opacity_numbers).zip(&table.fields);
                groups.filter(|(_, of)| **of == field).map(|(numbers, _)| largest(numbers)).sum()
            };
            (0..table.entries()).map(of_entry).collect()
        };
        let anywhere: f64 = (1..domains.len()).map(|field| of_field(field).into_iter().fold(0.0, f64::max)).sum();
        let rows = LabelTable::new(&self.scene, &self.planned, storage.domain, table.entries());
        let of_labels = (0..rows.table.entries()).map(|entry| largest(rows.table.entry(entry)[1])).fold(0.0, f64::max);
        let cells = Cells::new(self.scene.volume(), storage, labels);
        Majorants {
            dims: cells.dims,
            values: cells.largest(&of_field(0), of_labels).into_iter().map(|most| most + anywhere).collect(),
            cells_from_texture: self.scene.frame.geometry.dims.map(|voxels| count(voxels) / count(CELL)),
        }
    }

    /// The light that reaches a place from the positions with directions.
    pub(super) fn reaching(
        &self,
        samples: &dyn Samples<f64>,
        pixels: usize,
        progress: &dyn Progress,
    ) -> Result<Arriving, ReferenceError> {
        let vectors = PositionTable::new(&self.scene, &self.planned).0;
        let weights = vectors.into_iter().map(|vector| vector.w).collect();
        let reaching = if self.planned.plan.light.grid_lights() == 0 {
            None
        } else {
            Some(Reaching::new(&self.scene, &self.planned, samples, self.local_scale, pixels, progress)?)
        };
        Ok(Arriving { reaching, weights })
    }

    /// Adds to `light`, whose numbers are as many as a share of light has, what reaches `place` of each position of the scene.
    pub(super) fn arrive(&self, arriving: &Arriving, place: [f64; 3], samples: &dyn Samples<f64>, light: &mut [f64]) {
        let Some(reaching) = &arriving.reaching else { return };
        let shares = self.shares();
        let mut share: SmallVec<[f64; 8]> = smallvec::smallvec![0.0; shares];
        for (number, vector) in self.planned.plan.light.behind().enumerate() {
            let Some(arrival) = self.planned.plan.light.arrivals.get(vector) else { continue };
            reaching.light(number, place, samples, &mut share);
            let position = self.lit[arrival.accumulator];
            for (sum, share) in light[position * shares..][..shares].iter_mut().zip(&share) {
                *sum += arriving.weights[vector] * share;
            }
        }
    }

    /// Numbers of a share of light: one, or one for each component in coloured media.
    pub(super) fn shares(&self) -> usize {
        if self.planned.plan.light.absorbers > 0 { self.planned.plan.components() } else { 1 }
    }

    /// Light that a density scatters, [`Numbers`] of it.
    pub(super) fn scattered<'a>(&self, density: &'a Step<f64>) -> &'a [f64] {
        &density.source[self.planned.plan.parts().unshaded * LANE..][..self.planned.plan.components()]
    }

    /// The way from `place` in a direction, along the volume's axes.
    pub(super) fn way(&self, place: [f64; 3], direction: DVec3) -> Way {
        let along = (direction / self.local_scale).to_array();
        let end = to_face(along, place, &self.crop);
        Way { base: place, along, range: self.clip.left(place, along, [0.0, end.min(FAR)]) }
    }

    /// Sets `density` to the medium at `place`, per unit of length of a step.
    pub(super) fn density(&self, samples: &dyn Samples<f64>, place: [f64; 3], density: &mut Step<f64>) {
        if self.planned.plan.clip.is_by_field() {
            density.parts = (0..FIELDS).map(|field| self.clip.part_at(field, place)).collect();
        }
        samples.sample(place, density);
        // Media that are shaded by normals of their own are lit alike here.
        for other in std::mem::take(&mut density.others) {
            density.source.iter_mut().zip(&other).for_each(|(sum, part)| *sum += part);
        }
    }

    /// Sets `step` to the effect of a `density` over so many steps.
    pub(super) fn cross(&self, density: &Step<f64>, steps: f64, step: &mut Step<f64>) {
        across(density, steps, self.planned.plan.lanes() * LANE, step);
    }
}

/// Largest extinction in each macrocell, per unit of length.
pub(super) struct Majorants {
    pub(super) dims: [usize; 3],
    pub(super) values: Vec<f64>,
    pub(super) cells_from_texture: [f64; 3],
}

impl Majorants {
    /// The largest extinction around a place on a way, and the distance up to which it holds.
    pub(super) fn at(&self, way: &Way, distance: f64) -> (f64, f64) {
        /// Distance beyond a face, so that the next macrocell is another one.
        const BEYOND: f64 = 1e-9;
        let cells = |at: [f64; 3]| -> [f64; 3] {
            std::array::from_fn(|axis| at[axis] * self.cells_from_texture[axis] - 0.5 / count(CELL))
        };
        let (at, next) = (cells(way.at(distance)), cells(way.at(distance + 1.0)));
        let mut leave = f64::INFINITY;
        let cell: [usize; 3] = std::array::from_fn(|axis| {
            let speed = next[axis] - at[axis];
            let last = self.dims[axis] - 1;
            let index = whole((at[axis] + BEYOND * speed.signum()).floor().max(0.0)).min(last);
            if speed.abs() > 1e-30 {
                let face = count(index) + if speed > 0.0 { 1.0 } else { 0.0 };
                let is_inner = if speed > 0.0 { index < last } else { index > 0 };
                if is_inner {
                    leave = leave.min(distance + ((face - at[axis]) / speed).max(BEYOND));
                }
            }
            index
        });
        let index = cell[0] + self.dims[0] * (cell[1] + self.dims[1] * cell[2]);
        (self.values[index], leave)
    }
}

/// Light that reaches places, and the weights of its arrivals.
pub(super) struct Arriving {
    reaching: Option<Reaching<f64>>,
    weights: Vec<f64>,
}

/// The positions of a plan whose light has directions, seen from the medium, and their accumulators.
fn positions(scene: &Scene, planned: &Planned) -> (Vec<Position>, Vec<usize>) {
    let view = scene.camera.view(&scene.frame.geometry, 1.0);
    let lit = planned.positions.iter().enumerate().filter(|(position, _)| !is_sky(planned, *position));
    lit.map(|(accumulator, position)| {
        let placement = position.placement.seen_from_medium(view.as_ref());
        (Position { placement, shadows: true, ..position.clone() }, accumulator)
    })
    .unzip()
}

/// Places of the lights of a plan with directions, seen from the medium.
pub(super) fn lit_from(scene: &Scene, planned: &Planned) -> Vec<(usize, Vec<(DVec3, f64)>)> {
    let (seen, accumulators) = positions(scene, planned);
    let view = scene.camera.view(&scene.frame.geometry, 1.0);
    seen.iter()
        .zip(accumulators)
        .map(|(position, number)| (number, position.placement.vectors(view.as_ref())))
        .collect()
}

/// True if light of a position comes from everywhere.
pub(super) fn is_sky(planned: &Planned, position: usize) -> bool {
    planned.plan.light.of(position).any(|(_, arrival)| arrival.direction == Direction::Everywhere)
}
