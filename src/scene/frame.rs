//! The frame of a scene: world, unit and box. All its places are in this frame: crop box, blocks, camera, light grid.

use glam::DVec3;

use relume_base::number::count;
use relume_volume::{Finest, Geometry, Unit, Volume, coarse_index};

/// World, unit and box of a scene: those of its first field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// The grid whose indices the crop box, blocks and the light grid count, and its place in the world.
    pub geometry: Geometry,
    /// Unit of the world, if known.
    pub unit: Option<Unit>,
    /// True if the world is left-posterior-superior, as in DICOM: x points to a patient's left, y to the back, z to the head.
    pub anatomical: bool,
    /// The grid of which this one is a coarse level, if it is.
    finest: Finest,
}

impl Frame {
    /// The frame that `volume` gives to a scene.
    #[must_use]
    pub fn of(volume: &Volume) -> Self {
        let &Volume { geometry, unit, anatomical, finest, .. } = volume;
        let finest = finest.unwrap_or(Finest { dims: geometry.dims, block: [1; 3] });
        Self { geometry, unit, anatomical, finest }
    }

    /// Opposite corners of the box from the centre of the first voxel to that of the last one, in voxel indices. Of a coarse
    /// level, this is the box of the finest voxels, up to half a block larger than that of its own.
    #[must_use]
    pub fn whole_box(&self) -> [DVec3; 2] {
        let last = DVec3::from_array(self.finest.dims.map(count)) - 1.0;
        [DVec3::ZERO, last].map(|index| coarse_index(index, self.finest.block))
    }

    /// The middle of the box, in the world.
    #[must_use]
    pub fn middle(&self) -> DVec3 {
        let [low, high] = self.whole_box();
        self.geometry.world_from_index((low + high) / 2.0)
    }

    /// Least and largest coordinate of the box along a unit vector of the world; an axis of one voxel is one voxel thick.
    #[must_use]
    pub fn extent_along(&self, direction: DVec3) -> [f64; 2] {
        let half = DVec3::select(self.thin_axes().into(), DVec3::splat(0.5), DVec3::ZERO);
        let [low, high] = self.whole_box();
        let [low, high] = [low - half, high + half].map(|corner| self.geometry.world_from_index(corner));
        let edges =
            self.geometry.direction.transpose() * direction * (self.geometry.direction.inverse() * (high - low));
        let (middle, half) = ((low + high).dot(direction) / 2.0, edges.abs().element_sum() / 2.0);
        [middle - half, middle + half]
    }

    /// Axes along which the grid, or the one of which it is a coarse level, has one voxel.
    #[must_use]
    pub fn thin_axes(&self) -> [bool; 3] {
        self.finest.dims.map(|n| n == 1)
    }
}
