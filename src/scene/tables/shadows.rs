//! Extinction and light grid of shadows (docs/theory/shadows.md).

use glam::DVec3;

use super::rays::crop_box;
use super::unit_length;
use super::{ClipTable, LabelRows, Steps, Storage, TransferTable};
use crate::plan::{LightPlan, Planned};
use crate::{Medium, Scene};
use relume_base::number::{brief, count, readable, rounded, whole};

/// Largest optical depth that one spacing of the light grid adds. A node behind a dense surface would otherwise darken
/// the surface, through the interpolation between both.
pub const LARGEST_RISE: f64 = 4.0;

/// Part of the second difference of a depth that nodes leave out (docs/theory/shadows.md).
pub const SECOND_DIFFERENCE: f64 = 1.0 / 12.0;
/// Spacing of the grid on which the light of a sky is summed, as a multiple of that of the light grid. The sum over all
/// directions is smooth.
pub const SKY_SPACING: f64 = 2.0;
/// The same for a sky that dims ambient shares alone, a small part of the light (docs/theory/shadows.md).
const SKY_SPACING_OF_SHARES: f64 = 4.0;

/// Spacing of the grid on which the light of the sky of `light` is summed, as a multiple of that of the light grid.
#[must_use]
pub fn sky_spacing(light: &LightPlan) -> f64 {
    if light.has_sky_light() { SKY_SPACING } else { SKY_SPACING_OF_SHARES }
}

/// Largest optical depth that stands for the mean light of the sky.
pub const LARGEST_SKY_DEPTH: f64 = 20.0;

/// Depths in a texel of the light grid.
pub const GRID_LIGHTS: usize = 4;

/// Extinction that light with shadows meets: optical depth per unit of length (the smallest spacing), of each entry of the
/// transfer table and of each row of the label table. X-ray materials count only with their absorption.
#[derive(Clone, Debug, PartialEq)]
pub struct ExtinctionTable {
    /// By value: one for each group of terms.
    pub values: Vec<f32>,
    /// Groups of terms, whose extinctions have factors of their own.
    pub groups: usize,
    /// Extinctions of the entries of a label table.
    pub labels: Vec<f32>,
    /// Where its rows lie among them.
    pub rows: LabelRows,
}

impl ExtinctionTable {
    /// Builds the tables of `scene` over the `domains` of its fields, with the entries of its transfer table: of all that is grey, and of each
    /// coloured absorber.
    #[must_use]
    pub fn of_plan(scene: &Scene, planned: &Planned, domains: &[[f64; 2]]) -> Vec<Self> {
        let steps = Steps::new(scene, planned);
        let groups = planned.plan.groups.in_tables();
        let domain = domains.first().copied().unwrap_or_default();
        let table = |number: usize| {
            let values: Vec<f32> = TransferTable::values(scene, domains)
                .flat_map(|value| {
                    let of_group = |group| rounded(steps.extinction(value(steps.field_of(group)), group, number));
                    (0..groups).map(of_group).collect::<Vec<f32>>()
                })
                .collect();
            let rows = LabelRows::new(scene, values.len() / groups);
            let of_label = |medium: Medium| rounded(steps.extinction_of(&medium, number));
            Self { values, groups, labels: rows.media(scene, domain).map(of_label).collect(), rows }
        };
        (0..=planned.plan.light.absorbers).map(table).collect()
    }

    /// Number of entries by value.
    #[must_use]
    pub fn entries(&self) -> usize {
        self.values.len() / self.groups
    }

    /// Scale and offset from a texel's value to a coordinate, 0 to `entries − 1`.
    #[must_use]
    pub fn coordinate_from_texel(&self, storage: &Storage) -> [f64; 2] {
        storage.normalised_from_texel().map(|term| term * count(self.entries() - 1))
    }
}

/// The light grid: nodes from the low corner of the crop box to its high corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightGrid {
    /// Nodes along each axis.
    pub dims: [usize; 3],
    /// Distance of two nodes along each axis in voxels: the largest that divides the box, at most the stated one.
    pub spacing: DVec3,
    /// Scale from texture coordinates of the volume to nodes, before `offset` is added.
    pub scale: DVec3,
    /// Node at the corner of the texture.
    pub offset: DVec3,
    /// The crop box in texture coordinates.
    pub crop: [DVec3; 2],
    /// The clip planes.
    pub clip: ClipTable,
    /// Spacing of the voxels in units of length.
    voxel: DVec3,
}

/// The order in which the nodes of a [`LightGrid`] get their depths, slice by slice along one axis.
///
/// For a directional light, slices go from the light's side, and columns one node apart follow the light. For a point
/// light there are no columns: a ray goes from each node to the light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sweep {
    /// The axis of the slices, and the two axes across.
    pub axes: [usize; 3],
    /// Number of slices.
    pub slices: usize,
    /// Whether the first slice has the highest index.
    pub descending: bool,
    /// Nodes across that the light is shifted per slice, against its direction of travel.
    pub shear: [f64; 2],
    /// Texture coordinates of a place on a column: at the first column and slice, and the change per slice and per column
    /// along both axes across.
    pub line: [DVec3; 4],
    /// Node at which the first column passes the first slice.
    pub first: [f64; 2],
    /// Number of columns across.
    pub columns: [usize; 2],
    /// Nodes of a slice.
    pub nodes: [usize; 2],
    /// Length of the way from slice to slice, in units of length.
    pub path: f64,
    /// Samples on this way.
    pub samples: usize,
    /// Slices by which a column stays behind the slice that reads it: the start of shadows.
    pub behind: f64,
    /// Rays to a point light, in place of columns.
    pub to: Option<PointRays>,
    /// True if nodes read the depth of sixteen columns by a cubic, false for four columns, linearly.
    pub cubic: bool,
    /// Distance in slices beyond which nothing dims the light; `None` without a limit.
    pub within: Option<Within>,
}

/// Slices from the depth of a column to that which lies beyond the reach of a sky, and is subtracted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Within {
    /// Whole slices.
    pub slices: usize,
    /// Part of one more slice.
    pub rest: f64,
}

/// Rays from nodes to a point light. `samples` of a [`Sweep`] are then those of a part of a ray of length `path`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointRays {
    /// Coordinates of the light, in units of length from the texture's corner.
    pub point: DVec3,
    /// Distance from a node within which nothing shades it, in units of length.
    pub start: f64,
    /// Units of length per texture coordinate.
    pub local_scale: DVec3,
}

impl LightGrid {
    /// The grid of `scene` with a `spacing` in voxels.
    #[must_use]
    pub fn new(scene: &Scene, spacing: f64) -> Self {
        let geometry = &scene.frame.geometry;
        let dims = DVec3::from_array(geometry.dims.map(count));
        let crop = crop_box(scene);
        let extent = (crop[1] - crop[0]).max(DVec3::splat(1e-12));
        // Rounding of the box does not add a node.
        let spaces = (extent * dims / spacing - 1e-9).ceil().max(DVec3::ONE);
        let scale = spaces / extent;
        Self {
            dims: spaces.to_array().map(|spaces| whole(spaces) + 1),
            spacing: dims / scale,
            scale,
            offset: -crop[0] * scale,
            crop,
            clip: ClipTable::new(scene),
            voxel: geometry.spacing / unit_length(geometry),
        }
    }

    /// The same spaces with a node in the middle of each, and one beyond each face.
    #[must_use]
    pub fn of_middles(scene: &Scene, spacing: f64) -> Self {
        let corners = Self::new(scene, spacing);
        Self { dims: corners.dims.map(|nodes| nodes + 1), offset: corners.offset + 0.5, ..corners }
    }

    /// The grid of so many `lights`, through so many coloured `absorbers`, in a sentence.
    #[must_use]
    pub fn explain(&self, lights: usize, absorbers: usize) -> String {
        let [x, y, z] = self.dims;
        let through = match absorbers {
            0 => String::new(),
            1 => ", through a coloured absorber and all else".to_owned(),
            _ => format!(", through each of {absorbers} coloured absorbers and all else"),
        };
        format!(
            "A light grid of {x}×{y}×{z} nodes, one every {} voxels, keeps the optical depth towards light from {lights} direction{}{through} ({} MB). It is filled again only if the medium, the crop box, a clip plane or a direction changes.",
            brief(self.spacing.max_element()),
            if lights == 1 { "" } else { "s" },
            readable((self.bytes(lights * (1 + absorbers)) / 1e5).ceil() / 10.0)
        )
    }

    /// Bytes of its texels for so many `depths` per node.
    #[must_use]
    pub fn bytes(&self, depths: usize) -> f64 {
        let nodes: f64 = self.dims.iter().map(|&n| count(n)).product();
        let texel = if depths == 1 { 4.0 } else { 8.0 * count(depths.div_ceil(GRID_LIGHTS)) };
        nodes * texel
    }

    /// Most depths of columns of a sky on this grid, which keeps those of as many slices as its `reach` has, in units of
    /// length.
    #[must_use]
    pub fn kept_columns(&self, reach: f64) -> f64 {
        let along = |axis: usize| {
            let nodes = |axis: usize| count(self.dims[axis % 3]);
            let slices = (reach / (self.spacing * self.voxel)[axis] + 3.0).min(nodes(axis) + 1.0);
            slices * (nodes(axis) + nodes(axis + 1)) * (nodes(axis) + nodes(axis + 2))
        };
        (0..3).map(along).fold(0.0, f64::max)
    }

    /// The sweep of a light in `direction` (towards the light, along the volume's axes), with shadows from `start` on,
    /// in units of length.
    #[must_use]
    pub fn sweep(&self, direction: DVec3, start: f64) -> Sweep {
        let voxels = direction / self.voxel;
        let nodes = (voxels / self.spacing).to_array();
        let axis = (1..3).fold(0, |most, axis| if nodes[axis].abs() > nodes[most].abs() { axis } else { most });
        let axes = [axis, (axis + 1) % 3, (axis + 2) % 3];
        let (slices, path) = (self.dims[axis], 1.0 / nodes[axis].abs());
        let shear = [axes[1], axes[2]].map(|across| nodes[across] * path);
        let far = shear.map(|shear| count(slices - 1) * shear);
        let first = far.map(|far| far.min(0.0).floor());
        let across = [self.dims[axes[1]], self.dims[axes[2]]];
        let columns = std::array::from_fn(|i| whole((count(across[i] - 1) + far[i].max(0.0) - first[i]).ceil()) + 1);
        Sweep {
            axes,
            slices,
            descending: nodes[axis] > 0.0,
            shear,
            line: self.line(axes, nodes[axis] > 0.0, first, shear),
            first,
            columns,
            nodes: across,
            path,
            samples: whole((voxels.length() * path - 1e-9).ceil()).max(1),
            behind: start / path,
            to: None,
            cubic: true,
            within: None,
        }
    }

    /// The rays to a light at `point`, in units of length from the texture's corner, with shadows from `start` on.
    #[must_use]
    pub fn rays(&self, point: DVec3, start: f64) -> Sweep {
        let axes = [2, 0, 1];
        let path = (self.spacing * self.voxel).min_element();
        let nodes = [self.dims[0], self.dims[1]];
        // Voxels along each axis.
        let voxels = self.spacing * self.scale;
        Sweep {
            axes,
            slices: self.dims[2],
            descending: false,
            shear: [0.0; 2],
            line: self.line(axes, false, [0.0; 2], [0.0; 2]),
            first: [0.0; 2],
            columns: nodes,
            nodes,
            path,
            samples: whole((path - 1e-9).ceil()).max(1),
            behind: 0.0,
            to: Some(PointRays { point, start, local_scale: voxels * self.voxel }),
            cubic: false,
            within: None,
        }
    }
}

impl LightGrid {
    fn line(&self, axes: [usize; 3], descending: bool, first: [f64; 2], shear: [f64; 2]) -> [DVec3; 4] {
        let on = |axis: usize, node: f64| DVec3::AXES[axes[axis]] * node;
        let last = count(self.dims[axes[0]] - 1);
        let (start, along) = if descending { (last, -1.0) } else { (0.0, 1.0) };
        let corner = on(0, start) + on(1, first[0]) + on(2, first[1]);
        let per_slice = on(0, along) - on(1, shear[0]) - on(2, shear[1]);
        [(corner - self.offset) / self.scale, per_slice / self.scale, on(1, 1.0) / self.scale, on(2, 1.0) / self.scale]
    }

    /// The crop box, with room for the rounding of places on its faces.
    #[must_use]
    pub fn room(&self) -> [DVec3; 2] {
        [self.crop[0] - 1e-3 / self.scale, self.crop[1] + 1e-3 / self.scale]
    }
}

impl Sweep {
    /// The same sweep for a direction of a sky: linear between columns, and dimmed only by what is within `reach` of a node, in units
    /// of length.
    #[must_use]
    pub fn of_sky(mut self, reach: Option<f64>) -> Self {
        self.cubic = false;
        let way = |reach: f64| (reach / self.path - self.behind).max(0.0);
        // A column is not older than the sweep.
        let shorter = reach.map(way).filter(|&way| way < count(self.slices));
        self.within = shorter.map(|way| Within { slices: whole(way.floor()), rest: way.fract() });
        self
    }

    /// Slices whose columns are kept: the last one, the next, and those that a reach subtracts.
    #[must_use]
    pub fn kept(&self) -> usize {
        self.within.map_or(2, |within| (within.slices + 3).min(self.slices + 1))
    }

    /// Approximate number of samples per column, or per node of a point light.
    #[must_use]
    pub fn work(&self) -> usize {
        let parts = self.to.map_or(1.0, |to| (0.5 * to.local_scale.length() / self.path).ceil());
        self.samples * whole(parts).max(1)
    }

    /// Columns, from the first to before the last, that `slice` reads or that advance from it: the others are outside the
    /// crop box. As slices go on, columns enter and leave once.
    #[must_use]
    pub fn window(&self, slice: usize) -> [std::ops::Range<usize>; 2] {
        std::array::from_fn(|i| {
            let ways = [count(slice) - self.behind, count(slice + 1)].map(|slices| slices * self.shear[i]);
            let (low, high) = (ways[0].min(ways[1]), ways[0].max(ways[1]) + count(self.nodes[i] - 1));
            let beside = if self.cubic { 1.0 } else { 0.0 };
            let (low, high) = (low - beside, high + beside);
            let first = whole((low - self.first[i]).floor().max(0.0)).min(self.columns[i]);
            let end = whole((high - self.first[i]).ceil().max(0.0)).saturating_add(1).min(self.columns[i]);
            first..end.max(first)
        })
    }

    /// Index along the axis of the slices.
    #[must_use]
    pub fn index(&self, slice: usize) -> usize {
        if self.descending { self.slices - 1 - slice } else { slice }
    }
}
