//! Fields on grids of their own, in texture coordinates of the frame.

use glam::{DMat3, DMat4, DVec3, DVec4};

use super::{Storage, unit_length};
use crate::{Field, Frame, Scene};
use relume_base::number::{Real, count};

/// A field on a grid of its own. Its values count from the centre of its first voxel to that of its last one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacedField {
    /// Its voxel index: each row times texture coordinates of the frame and 1.
    pub rows: [DVec4; 3],
    /// Its voxels along each axis.
    pub dims: [usize; 3],
    /// Factors from a gradient along its own axes to one whose product with the rows, over the edges of the texture in units of length, is
    /// along those of the frame: its spacing in units of length.
    pub lengths: [f64; 3],
    /// Voxels of the frame along each axis.
    frame: [usize; 3],
}

/// Factors on the differences of a further field of this storage, for gradients along its own axes or, with the rows of a place, along those
/// of the frame; then scale and offset from its texels to the gradient of a fall to the lowest value within two `unit`s, in world units.
#[must_use]
pub fn gradient_numbers(storage: &Storage, placed: Option<&PlacedField>, unit: f64) -> [[f64; 3]; 2] {
    let lengths = placed.map_or([1.0; 3], |placed| placed.lengths);
    let scale = storage.gradient_scale();
    let [fall, lowest] = storage.fall_from_texel(unit);
    [std::array::from_fn(|axis| scale[axis] * lengths[axis]), [fall, lowest, 0.0]]
}

impl PlacedField {
    /// The fields of `scene` that do not share the texels of the first, in their order.
    #[must_use]
    pub fn of_scene(scene: &Scene) -> Vec<Self> {
        scene.fields.beside().iter().map(|field| Self::new(&scene.frame, field)).collect()
    }

    /// The same of each further field; `None` of one that shares the texels of the first.
    #[must_use]
    pub fn of_further(scene: &Scene) -> Vec<Option<Self>> {
        let sharing = scene.fields.sharing().iter().map(|_| None);
        sharing.chain(Self::of_scene(scene).into_iter().map(Some)).collect()
    }

    fn new(frame: &Frame, field: &Field) -> Self {
        let (ours, theirs) = (&frame.geometry, &field.volume.geometry);
        let dims = DVec3::from_array(ours.dims.map(count));
        // World point of texture coordinates t: origin + direction·(spacing·(t·dims − ½)).
        let corner = ours.origin - ours.direction * (ours.spacing / 2.0);
        let to_index = |vector: DVec3| theirs.direction.inverse() * vector / theirs.spacing;
        let columns = DVec3::AXES.map(|axis| to_index(ours.direction * (axis * ours.spacing * dims)));
        let first = to_index(corner - theirs.origin);
        let matrix =
            DMat4::from_cols(columns[0].extend(0.0), columns[1].extend(0.0), columns[2].extend(0.0), first.extend(1.0));
        let lengths = (theirs.spacing / unit_length(ours)).to_array();
        Self { rows: [matrix.row(0), matrix.row(1), matrix.row(2)], dims: theirs.dims, lengths, frame: ours.dims }
    }

    /// Its voxel index at `place`, in texture coordinates of the frame; `None` outside its box.
    pub fn index<R: Real>(&self, place: [R; 3]) -> Option<[R; 3]> {
        let index = self.rows.map(|row| {
            let [x, y, z, first] = row.to_array().map(R::from_f64);
            place[0].mul_add(x, place[1].mul_add(y, place[2].mul_add(z, first)))
        });
        let [low, high] = self.ends().map(|end| end.map(R::from_f64));
        (0..3).all(|axis| low[axis] <= index[axis] && index[axis] <= high[axis]).then_some(index)
    }

    /// Its voxel index at a voxel index of the frame.
    #[must_use]
    pub fn index_of_voxel(&self, index: DVec3) -> DVec3 {
        let place = (index + 0.5) / DVec3::from_array(self.frame.map(count));
        DVec3::from_array(self.rows.map(|row| row.dot(place.extend(1.0))))
    }

    /// True for voxels within `margin` of its voxels, along each of its axes, of a place between two corners in voxel indices of the frame.
    pub fn near(&self, [low, high]: [DVec3; 2], margin: f64) -> impl Fn([usize; 3]) -> bool {
        let scale = DVec3::from_array(self.frame.map(count));
        let to_own = DMat3::from_cols_array_2d(&self.rows.map(|row| (row.truncate() / scale).to_array())).transpose();
        let (to_frame, first) = (to_own.inverse(), self.index_of_voxel(DVec3::ZERO));
        // Two boxes meet unless they are apart along a normal of one of their faces or across an edge of each.
        let edges = DVec3::AXES.map(|axis| to_frame * (margin * axis));
        let across = DVec3::AXES.into_iter().flat_map(|axis| edges.map(|edge| axis.cross(edge)));
        let normals = DVec3::AXES.into_iter().chain([0, 1, 2].map(|axis| to_own.row(axis))).chain(across);
        let (middle, half) = (low.midpoint(high), (high - low) / 2.0);
        let limits: Vec<(DVec3, f64)> = normals
            .map(|normal| {
                (normal, normal.abs().dot(half) + edges.iter().map(|&edge| normal.dot(edge).abs()).sum::<f64>())
            })
            .collect();
        move |at| {
            let off = to_frame * (DVec3::from_array(at.map(count)) - first) - middle;
            limits.iter().all(|&(normal, limit)| normal.dot(off).abs() <= limit)
        }
    }

    /// Half the box, in its voxels, around one that extends so many voxels of the frame to either side.
    #[must_use]
    pub fn extent_of_voxels(&self, half: DVec3) -> DVec3 {
        let half = half / DVec3::from_array(self.frame.map(count));
        DVec3::from_array(self.rows.map(|row| row.truncate().abs().dot(half)))
    }

    /// Its lowest and highest voxel indices; an axis of one voxel is one voxel thick.
    #[must_use]
    pub fn ends(&self) -> [[f64; 3]; 2] {
        let thin = |n: usize| n == 1;
        [
            self.dims.map(|n| if thin(n) { -0.5 } else { 0.0 }),
            self.dims.map(|n| if thin(n) { 0.5 } else { count(n) - 1.0 }),
        ]
    }
}
