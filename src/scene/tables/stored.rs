//! All tables of a scene and its volume, as a device stores them.

use std::sync::Arc;

use super::unit_length;
use super::{
    CapTable, CrossingTable, ExtinctionTable, FactorTable, LabelMap, LabelTable, PlacedField, SegmentTable, Storage,
    StoredVolume, TransferTable,
};
use crate::Scene;
use crate::plan::{Integrate, Planned};
use relume_base::number::count;
use relume_volume::{Geometry, Statistics, VolumeError};

/// Volume and tables that a march reads.
#[derive(Clone, Debug)]
pub struct StoredScene {
    /// How the volume is stored.
    pub storage: Storage,
    /// The volume as stored on a device.
    pub volume: Arc<StoredVolume>,
    /// Those of further fields, and the places of those on grids of their own.
    pub further: Vec<(Storage, StoredVolume, Option<PlacedField>)>,
    /// The transfer table.
    pub table: TransferTable,
    /// Table of the media of labels: steps, or densities if the plan adds these.
    pub label_table: LabelTable,
    /// Table of segments, if the plan integrates in segments.
    pub segments: Option<SegmentTable>,
    /// Table of crossed intervals, if the plan counts these.
    pub crossings: Option<CrossingTable>,
    /// Extinction of shadows, if lights with a direction cast them.
    pub extinctions: Vec<ExtinctionTable>,
    /// Table of the factors by the gradient.
    pub factors: FactorTable,
    /// Numbers of the shading of cut faces.
    pub caps: CapTable,
    /// Label of every voxel, if the plan uses labels.
    pub labels: Option<Arc<LabelMap>>,
    /// Edges of the texture in units of length.
    pub lengths: [f64; 3],
    /// The unit of length in world units.
    pub unit: f64,
}

/// Edges of the texture of a grid in units of length.
fn lengths(geometry: &Geometry) -> [f64; 3] {
    let spacing = geometry.spacing / unit_length(geometry);
    std::array::from_fn(|axis| spacing[axis] * count(geometry.dims[axis]))
}

impl StoredScene {
    /// Stores `scene` as `planned`; the values of its volume have these `statistics`.
    ///
    /// # Errors
    ///
    /// [`VolumeError`]: labels that cannot be used.
    pub fn new(scene: &Scene, planned: &Planned, statistics: &Statistics) -> Result<Self, VolumeError> {
        let storage = Storage::new(&planned.plan, scene.volume(), statistics);
        let volume = Arc::new(StoredVolume::new(scene.volume(), &storage));
        let labels = scene.labels.as_ref().filter(|_| planned.plan.labels).map(LabelMap::new).transpose()?;
        Ok(Self::of(scene, planned, (storage, volume), labels.map(Arc::new)))
    }

    /// Stores the tables of `scene` as `planned` around a stored volume, and labels if the plan uses them.
    #[must_use]
    pub fn of(
        scene: &Scene,
        planned: &Planned,
        (storage, volume): (Storage, Arc<StoredVolume>),
        labels: Option<Arc<LabelMap>>,
    ) -> Self {
        let further: Vec<_> = Storage::of_further(&planned.plan, scene)
            .into_iter()
            .zip(scene.fields.further())
            .zip(PlacedField::of_further(scene))
            .map(|((storage, field), placed)| {
                let stored = StoredVolume::new(&field.volume, &storage);
                (storage, stored, placed)
            })
            .collect();
        let storages: Vec<&Storage> = std::iter::once(&storage).chain(further.iter().map(|field| &field.0)).collect();
        let domains: Vec<[f64; 2]> = storages.iter().map(|storage| storage.domain).collect();
        let table = TransferTable::new(scene, planned, &domains);
        Self {
            label_table: LabelTable::new(scene, planned, storage.domain, table.entries()),
            segments: (planned.plan.integration == Integrate::Segments)
                .then(|| SegmentTable::new(scene, planned, storage.domain)),
            crossings: planned.plan.crossings.then(|| CrossingTable::new(scene, planned, storage.domain)),
            extinctions: if planned.plan.light.grid_lights() > 0 {
                ExtinctionTable::of_plan(scene, planned, &domains)
            } else {
                Vec::new()
            },
            factors: FactorTable::new(scene, planned, &storages, table.entries()),
            caps: CapTable::new(scene, &storage),
            table,
            further,
            lengths: lengths(&scene.frame.geometry),
            unit: unit_length(&scene.frame.geometry),
            labels,
            storage,
            volume,
        }
    }
}
