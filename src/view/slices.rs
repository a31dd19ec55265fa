//! Orthogonal slices of a volume: their planes, and their pixels.

use std::collections::BTreeMap;

use glam::{DVec2, DVec3};
use serde_json::{Value, json};

use crate::annotate::Edges;
use crate::document::transfer_presets::ct_windows;
use crate::number::{count, whole};
use crate::scene::{LabelEntry, Labels, Scene};
use crate::spectrum::colour::{LinearSrgb, encode_srgb};
use crate::volume::{Geometry, Statistics, Volume, Voxel, Window, with_voxels};

/// Entries of the table of an overlay, for voxels that are not small whole numbers.
const ENTRIES: usize = 4096;
/// Largest number of entries, one per value of 16-bit integers.
const MOST_ENTRIES: usize = 1 << 16;
/// Opacity of a label over its slice.
const LABEL: f64 = 0.5;
/// Fraction of the voxels below and above the window of a volume without one.
const OUTSIDE: f64 = 0.005;

/// Slices as the user has them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Slices {
    /// Whether they are visible.
    pub shown: bool,
    /// Crosshair in voxel indices; the middle of the volume before the first choice.
    pub at: Option<DVec3>,
    /// Values shown black and white; [`window_of`] before the first choice.
    pub window: Option<[f64; 2]>,
    /// Factor of enlargement above 1, and the voxel index in the middle of the views; `None` shows whole slices.
    pub zoom: Option<(f64, DVec3)>,
    /// Whether the materials lie over the values, in their colours under the present light.
    pub materials: bool,
    /// Whether the labels lie over the values.
    pub labels: bool,
}

impl Slices {
    /// Crosshair in a volume of `geometry`, in voxel indices inside it.
    #[must_use]
    pub fn crosshair(&self, geometry: &Geometry) -> DVec3 {
        let last = DVec3::from_array(geometry.dims.map(count)) - 1.0;
        let at = self.at.unwrap_or(last / 2.0);
        DVec3::select(at.is_finite_mask(), at, last / 2.0).clamp(DVec3::ZERO, last)
    }

    /// Crosshair in voxel indices, the value there, and the window if it was chosen, as JSON; `None` if hidden.
    #[must_use]
    pub fn json(&self, volume: &Volume) -> Option<Value> {
        let at = self.crosshair(&volume.geometry);
        // A voxel that cannot be read has no value; the march has told why.
        let value = || volume.read_value(voxel(at)).ok().flatten();
        self.shown.then(|| json!({ "at": at.to_array(), "value": value(), "window": self.window }))
    }
}

/// Voxel nearest to an index inside the volume.
#[must_use]
pub fn voxel(index: DVec3) -> [usize; 3] {
    index.to_array().map(|along| whole(along.round()))
}

/// Fractional voxel index of a world point: the inverse of [`Geometry::world_from_index`].
#[must_use]
pub fn index_from_world(geometry: &Geometry, world: DVec3) -> DVec3 {
    geometry.direction.inverse() * (world - geometry.origin) / geometry.spacing
}

/// A plane along two axes of the grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Plane {
    /// `axial`, `coronal` or `sagittal` of an anatomical volume, the closest one if it is oblique; otherwise the axes
    /// of the plane.
    pub name: &'static str,
    /// Axis of the grid across the plane.
    pub normal: usize,
    /// Axis of the grid to the right of the picture, and whether its indices ascend there.
    pub right: (usize, bool),
    /// Axis of the grid towards the bottom of the picture, and whether its indices ascend there.
    pub down: (usize, bool),
    /// Letters at its edges, for an anatomical volume.
    pub edges: Option<Edges>,
}

/// The three planes: axial, coronal and sagittal of an anatomical volume, in radiological convention (axial from the
/// feet, coronal from the front, sagittal from the left); otherwise XY with y downwards, XZ and YZ with z upwards.
#[must_use]
pub fn planes(volume: &Volume) -> [Plane; 3] {
    if !volume.anatomical {
        let plane = |name, normal, right, down| Plane { name, normal, right: (right, true), down, edges: None };
        return [plane("XY", 2, 0, (1, true)), plane("XZ", 1, 0, (2, false)), plane("YZ", 0, 1, (2, false))];
    }
    let axes = closest_axes(&volume.geometry);
    let direction = volume.geometry.direction;
    // The axis of the grid closest to an axis of the world, and whether it ascends along it.
    let along = |world: usize, positive: bool| {
        let axis = axes[world];
        (axis, (direction.col(axis)[world] > 0.0) == positive)
    };
    let plane = |name, normal: usize, right: (usize, bool), down: (usize, bool)| {
        let outward = |(axis, ascends): (usize, bool)| direction.col(axis) * if ascends { 1.0 } else { -1.0 };
        let edges = Some(Edges::along(outward(right), -outward(down)));
        Plane { name, normal: axes[normal], right, down, edges }
    };
    [
        plane("axial", 2, along(0, true), along(1, true)),
        plane("coronal", 1, along(0, true), along(2, false)),
        plane("sagittal", 0, along(1, true), along(2, false)),
    ]
}

/// The axis of the grid closest to each axis of the world; each is taken once, the best match first.
fn closest_axes(geometry: &Geometry) -> [usize; 3] {
    let (mut axes, mut pairs) = ([0, 1, 2], Vec::new());
    for world in 0..3 {
        pairs.extend((0..3).map(|axis| (geometry.direction.col(axis)[world].abs(), world, axis)));
    }
    pairs.sort_by(|one, other| other.0.total_cmp(&one.0));
    let (mut worlds, mut taken) = ([false; 3], [false; 3]);
    for (_, world, axis) in pairs {
        if !worlds[world] && !taken[axis] {
            (worlds[world], taken[axis], axes[world]) = (true, true, axis);
        }
    }
    axes
}

impl Plane {
    /// Size of the slices in world units, across and down.
    #[must_use]
    pub fn size(&self, geometry: &Geometry) -> DVec2 {
        let extent = geometry.extent();
        DVec2::new(extent[self.right.0], extent[self.down.0])
    }

    /// Position of a voxel index in the slice, in fractions from the top left.
    #[must_use]
    pub fn place_of(&self, geometry: &Geometry, index: DVec3) -> DVec2 {
        let part = |(axis, ascends): (usize, bool)| {
            let part = (index[axis] + 0.5) / count(geometry.dims[axis]);
            if ascends { part } else { 1.0 - part }
        };
        DVec2::new(part(self.right), part(self.down))
    }

    /// Voxel index at a position of the slice through `through`, in fractions from the top left; inside the volume.
    #[must_use]
    pub fn index_at(&self, geometry: &Geometry, place: DVec2, through: DVec3) -> DVec3 {
        let mut index = through;
        for ((axis, ascends), part) in [(self.right, place.x), (self.down, place.y)] {
            let part = if ascends { part } else { 1.0 - part };
            let length = count(geometry.dims[axis]);
            index[axis] = (part * length - 0.5).clamp(0.0, length - 1.0);
        }
        index
    }
}

/// Windows that the file of the volume asks for, or else those of a CT.
#[must_use]
pub fn windows(volume: &Volume, statistics: &Statistics) -> Vec<Window> {
    match &volume.presets.windows[..] {
        [] => ct_windows(statistics),
        stated => stated.to_vec(),
    }
}

/// Codes of colours from 0 to 1, to 8 bits as a display shows them.
#[must_use]
pub fn codes(colours: &[LinearSrgb]) -> Vec<[f64; 3]> {
    let code = |part: f64| (255.0 * encode_srgb(part.clamp(0.0, 1.0))).round() / 255.0;
    colours.iter().map(|colour| colour.0.map(code)).collect()
}

/// Values shown black and white before a choice: the first of `windows`, otherwise the values without half a percent of
/// the voxels at either end.
#[must_use]
pub fn window_of(windows: &[Window], statistics: &Statistics) -> [f64; 2] {
    if let Some(first) = windows.first() {
        return [first.low, first.high];
    }
    let Statistics { min, max, histogram, .. } = statistics;
    let voxels: Vec<f64> = histogram.iter().map(|&bin| count(usize::try_from(bin).unwrap_or(usize::MAX))).collect();
    let (width, outside) = ((max - min) / count(voxels.len()), OUTSIDE * voxels.iter().sum::<f64>());
    let bins_outside = |bins: &mut dyn Iterator<Item = &f64>| {
        let mut sum = 0.0;
        count(
            bins.take_while(|&&bin| {
                sum += bin;
                sum <= outside
            })
            .count(),
        )
    };
    let low = min + width * bins_outside(&mut voxels.iter());
    let high = max - width * bins_outside(&mut voxels.iter().rev());
    if low < high { [low, high] } else { [*min, *max] }
}

/// Colours over the grey of the values: sRGB code values and opacity, from 0 to 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Overlay {
    low: f64,
    step: f64,
    table: Vec<[f64; 4]>,
}

impl Overlay {
    /// The materials at each value, in `colours` (sRGB codes from 0 to 1): their mean, weighted by optical depth, with
    /// the square root of the opacity over an opacity length, as in the graph of the transfer function.
    #[must_use]
    pub fn new(scene: &Scene, statistics: &Statistics, colours: &[[f64; 3]]) -> Self {
        let Statistics { min, max, .. } = *statistics;
        let span = max - min;
        let by_one = matches!(scene.volume().slope, 1.0) && scene.volume().voxels.voxel_type().bytes() <= 2;
        let entries = if by_one && span < count(MOST_ENTRIES) { whole(span) + 1 } else { ENTRIES };
        let step = if entries > 1 { span / count(entries - 1) } else { 1.0 };
        let at = |entry: usize| {
            let medium = scene.transfer.medium(min + step * count(entry), scene.materials.len());
            let depths: Vec<f64> =
                medium.scattering.iter().zip(&medium.absorption).map(|(one, two)| one + two).collect();
            let all: f64 = depths.iter().sum();
            let mean = |channel: usize| {
                let parts = depths.iter().zip(colours).map(|(depth, colour)| depth * colour[channel]);
                parts.sum::<f64>() / all.max(f64::MIN_POSITIVE)
            };
            [mean(0), mean(1), mean(2), (-(-all).exp_m1()).sqrt()]
        };
        Self { low: min, step, table: (0..entries).map(at).collect() }
    }

    fn of(&self, value: f64) -> [f64; 4] {
        let entry = whole(((value - self.low) / self.step).round().max(0.0));
        self.table[entry.min(self.table.len() - 1)]
    }
}

/// Colour of each declared label by its number.
fn label_colours(labels: &Labels, colours: &[[f64; 3]]) -> BTreeMap<i64, [f64; 3]> {
    let colour = |entry: &LabelEntry| Some((entry.label, *colours.get(entry.material)?));
    labels.declared.iter().filter_map(colour).collect()
}

/// Content of a slice.
#[derive(Debug)]
pub struct Painted<'a> {
    /// The volume.
    pub volume: &'a Volume,
    /// Values shown black and white.
    pub window: [f64; 2],
    /// Materials over the values.
    pub overlay: Option<&'a Overlay>,
    /// Labels over the values, and the index of the slice in their grid, which may be finer; in the colours of their
    /// materials: sRGB codes from 0 to 1.
    pub labels: Option<(&'a Labels, usize, &'a [[f64; 3]])>,
}

impl Painted<'_> {
    /// RGB codes of the slice of `plane` at index `at`, in a picture of `size` (width, height), rows from the top. Each
    /// pixel shows the nearest voxel; NaN is black.
    #[must_use]
    pub fn pixels(&self, plane: &Plane, at: usize, size: [usize; 2]) -> Vec<[u8; 3]> {
        let places = |dims: [usize; 3], at: usize| -> Vec<usize> {
            let strides = [1, dims[0], dims[0] * dims[1]];
            // Offsets of the voxels of each column and each row.
            let offsets = |(axis, ascends): (usize, bool), pixels: usize| -> Vec<usize> {
                let length = dims[axis];
                let nearest =
                    |pixel: usize| whole((count(pixel) + 0.5) / count(pixels) * count(length)).min(length - 1);
                let along = |pixel| if ascends { nearest(pixel) } else { length - 1 - nearest(pixel) };
                (0..pixels).map(|pixel| along(pixel) * strides[axis]).collect()
            };
            let (columns, rows) = (offsets(plane.right, size[0]), offsets(plane.down, size[1]));
            let first = at.min(dims[plane.normal] - 1) * strides[plane.normal];
            rows.iter().flat_map(|row| columns.iter().map(move |column| first + row + column)).collect()
        };
        let voxels = places(self.volume.geometry.dims, at);
        let mut pixels = Vec::with_capacity(voxels.len());
        with_voxels!(&self.volume.voxels, stored => {
            pixels.extend(voxels.into_iter().map(|voxel| {
                let value = stored.get(voxel).map_or(f64::NAN, |value| value.to_f64());
                self.colour(value.mul_add(self.volume.slope, self.volume.intercept))
            }));
        });
        if let Some((labels, at, colours)) = self.labels {
            let colours = label_colours(labels, colours);
            for (pixel, voxel) in pixels.iter_mut().zip(places(labels.volume.geometry.dims, at)) {
                let label = labels.volume.label(voxel);
                if let Some([red, green, blue]) = label.and_then(|label| colours.get(&label)) {
                    *pixel = over(pixel.map(|code| f64::from(code) / 255.0), [*red, *green, *blue, LABEL]);
                }
            }
        }
        pixels
    }

    fn colour(&self, value: f64) -> [u8; 3] {
        let [low, high] = self.window;
        let grey = ((value - low) / (high - low).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        let over_it = self.overlay.filter(|_| value.is_finite()).map_or([0.0; 4], |overlay| overlay.of(value));
        over([grey; 3], over_it)
    }
}

/// Code values of a colour with opacity over another.
fn over(below: [f64; 3], [red, green, blue, opacity]: [f64; 4]) -> [u8; 3] {
    let [one, two, three] = below;
    [(one, red), (two, green), (three, blue)].map(|(below, above)| {
        let code = 255.0 * (below + (above - below) * opacity);
        // NaN becomes 0.
        u8::try_from(whole(code.round().clamp(0.0, 255.0))).unwrap_or(u8::MAX)
    })
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
    use std::sync::Arc;

    use glam::DMat3;

    use super::*;
    use crate::scene::{Material, Term};
    use crate::spectrum::{Reflectance, Spectrum};
    use crate::volume::Voxels;

    /// Voxel `[x, y, z]` holds x + 10·y + 100·z.
    fn volume(dims: [usize; 3], direction: DMat3) -> Volume {
        let geometry = Geometry::new("test", dims, DVec3::new(1.0, 2.0, 4.0), DVec3::ZERO, direction).unwrap();
        let [nx, ny, nz] = dims;
        let value = |i: usize| u16::try_from(i % nx + 10 * (i / nx % ny) + 100 * (i / nx / ny)).unwrap();
        let values = (0..nx * ny * nz).map(value).collect();
        Volume::new("test", Voxels::U16(values), geometry).unwrap()
    }

    fn greys(volume: &Volume, plane: &Plane, at: usize, size: [usize; 2]) -> Vec<u8> {
        let painted = Painted { volume, window: [0.0, 255.0], overlay: None, labels: None };
        let pixels = painted.pixels(plane, at, size);
        assert!(pixels.iter().all(|[red, green, blue]| red == green && green == blue));
        pixels.into_iter().map(|[grey, ..]| grey).collect()
    }

    #[test]
    fn slices_of_axes_show_the_voxels_of_their_plane() {
        let volume = volume([3, 2, 2], DMat3::IDENTITY);
        let [xy, xz, yz] = planes(&volume);
        assert_eq!([xy.name, xz.name, yz.name], ["XY", "XZ", "YZ"]);
        assert_eq!(greys(&volume, &xy, 1, [3, 2]), [100, 101, 102, 110, 111, 112], "y downwards");
        assert_eq!(greys(&volume, &xz, 1, [3, 2]), [110, 111, 112, 10, 11, 12], "z upwards");
        assert_eq!(greys(&volume, &yz, 2, [2, 2]), [102, 112, 2, 12]);
        assert_eq!(greys(&volume, &xy, 0, [6, 2])[..6], [0, 0, 1, 1, 2, 2], "a pixel shows the nearest voxel");
        assert_eq!(xy.size(&volume.geometry), DVec2::new(3.0, 4.0));
    }

    #[test]
    fn slices_of_a_patient_lie_as_radiologists_expect() {
        // Axes as of many NIfTI files: x to the right, y to the front, z to the head; the world is left-posterior-superior.
        let mut head = volume([3, 2, 2], DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0)));
        head.anatomical = true;
        let [axial, coronal, sagittal] = planes(&head);
        assert_eq!([axial.name, coronal.name, sagittal.name], ["axial", "coronal", "sagittal"]);
        let letters = |plane: &Plane| {
            let edges = plane.edges.clone().unwrap();
            [edges.left, edges.right, edges.top, edges.bottom].concat()
        };
        // The patient's right at the left of the picture; from the left, the face at the left.
        assert_eq!([&axial, &coronal, &sagittal].map(letters), ["RLAP", "RLSI", "APSI"]);
        // The right-most voxel (largest x) at the left, the front-most (largest y) at the top.
        assert_eq!(greys(&head, &axial, 0, [3, 2]), [12, 11, 10, 2, 1, 0]);
        assert_eq!(greys(&head, &coronal, 0, [3, 2]), [102, 101, 100, 2, 1, 0]);
        assert_eq!(greys(&head, &sagittal, 0, [2, 2]), [110, 100, 10, 0]);
    }

    #[test]
    fn an_oblique_grid_has_the_closest_names_and_each_axis_once() {
        // Sagittal slices, tilted by 30° about the axis from left to right.
        let (sin, cos) = 30.0_f64.to_radians().sin_cos();
        let columns = [DVec3::new(0.0, cos, sin), DVec3::new(0.0, sin, -cos), DVec3::NEG_X];
        let mut tilted = volume([3, 2, 2], DMat3::from_cols(columns[0], columns[1], columns[2]));
        tilted.anatomical = true;
        let [axial, coronal, sagittal] = planes(&tilted);
        assert_eq!([axial.normal, coronal.normal, sagittal.normal], [1, 0, 2]);
        assert_eq!((sagittal.right, sagittal.down), ((0, true), (1, true)));
        assert_eq!(sagittal.edges.unwrap().right, "PS", "tan 30° is above a half");
    }

    #[test]
    fn a_place_of_a_slice_is_that_of_its_voxel() {
        let mut head = volume([3, 2, 2], DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0)));
        for anatomical in [false, true] {
            head.anatomical = anatomical;
            for plane in planes(&head) {
                let index = DVec3::new(2.0, 1.0, 0.0);
                let place = plane.place_of(&head.geometry, index);
                let mut other = index;
                other[plane.right.0] = 0.0;
                assert!(plane.index_at(&head.geometry, place, other).distance(index) < 1e-12, "{plane:?}");
            }
        }
        let [axial, ..] = planes(&head);
        let outside = axial.index_at(&head.geometry, DVec2::new(-3.0, 7.0), DVec3::ZERO);
        assert_eq!(outside, DVec3::new(2.0, 0.0, 0.0), "the nearest voxel");
        assert_eq!(Slices::default().crosshair(&head.geometry), DVec3::new(1.0, 0.5, 0.5));
        let lost = Slices { at: Some(DVec3::new(f64::NAN, 9.0, -1.0)), ..Slices::default() };
        assert_eq!(lost.crosshair(&head.geometry), DVec3::new(1.0, 1.0, 0.0));
    }

    #[test]
    fn a_point_of_the_world_has_the_index_that_lies_there() {
        let (sin, cos) = 30.0_f64.to_radians().sin_cos();
        let direction = DMat3::from_cols(DVec3::new(cos, sin, 0.0), DVec3::new(-sin, cos, 0.0), DVec3::NEG_Z);
        let origin = DVec3::new(-3.0, 5.0, 7.0);
        let geometry = Geometry::new("test", [9; 3], DVec3::new(0.5, 2.0, 3.0), origin, direction).unwrap();
        let index = DVec3::new(1.25, 4.0, 8.0);
        assert!(index_from_world(&geometry, geometry.world_from_index(index)).distance(index) < 1e-12);
    }

    #[test]
    fn a_window_leaves_half_a_percent_at_either_end() {
        let mut histogram = [0; crate::volume::BINS];
        // Of 10,000 voxels, 50 at either end may be left out: bins 0 and 1, and bin 63.
        for (bin, voxels) in [(0, 30), (1, 20), (10, 9900), (63, 50)] {
            histogram[bin] = voxels;
        }
        let statistics = Statistics { min: 0.0, max: 64.0, mean: 0.0, histogram, not_a_number: 0, infinite: 0 };
        assert_eq!(window_of(&[], &statistics).to_vec(), [10.0, 11.0]);
        let stated = Window::new("soft", -160.0, 240.0).unwrap();
        assert_eq!(window_of(&[stated], &statistics).to_vec(), [-160.0, 240.0]);
        let flat = Statistics { max: 0.0, ..statistics };
        assert_eq!(window_of(&[], &flat).to_vec(), [0.0, 0.0]);
    }

    #[test]
    fn materials_and_labels_lie_over_the_grey_with_their_opacity() {
        let volume = Arc::new(volume([3, 1, 1], DMat3::IDENTITY));
        let statistics = volume.statistics().unwrap();
        let mut scene = Scene::new("test", Arc::clone(&volume));
        let white = || Reflectance::new(Spectrum::constant(1.0)).unwrap();
        scene.materials = vec![Material::new("one", white()), Material::new("two", white())];
        // Value 1 has opacity 0.25, and value 2 opacity 1.
        scene.transfer.terms =
            vec![Term::interval(0, [1.0, 1.0], 0.0, 0.25, 0.0), Term::interval(1, [2.0, 2.0], 0.0, 1.0, 0.0)];
        let colours = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
        let overlay = Overlay::new(&scene, &statistics, &colours);
        let painted = Painted { volume: &volume, window: [0.0, 2.0], overlay: Some(&overlay), labels: None };
        let [plane, ..] = planes(&volume);
        // Grey 0, 127.5 and 255; half of red over the second, all of blue over the third.
        assert_eq!(painted.pixels(&plane, 0, [3, 1]), [[0, 0, 0], [191, 64, 64], [0, 0, 255]]);
        let of = Arc::new(Volume::new("labels", Voxels::U8(vec![7, 3, 0]), volume.geometry).unwrap());
        let entry = LabelEntry {
            label: 7,
            name: "seven".to_owned(),
            material: 1,
            opacity: 0.1,
            absorption: 0.0,
            terms: Vec::new(),
        };
        let labels = Labels { volume: of, declared: vec![entry] };
        let painted = Painted { overlay: None, labels: Some((&labels, 0, &colours)), ..painted };
        assert_eq!(painted.pixels(&plane, 0, [3, 1]), [[0, 0, 128], [128, 128, 128], [255, 255, 255]]);
        // The second slice of finer labels: half of blue over grey 128.
        let grid = Geometry::unit("labels", [6, 1, 2]).unwrap();
        let stored = vec![7, 7, 7, 7, 7, 7, 0, 0, 0, 7, 7, 0];
        let volume = Arc::new(Volume::new("labels", Voxels::U8(stored), grid).unwrap());
        let finer = Labels { volume, declared: labels.declared.clone() };
        let painted = Painted { labels: Some((&finer, 1, &colours)), ..painted };
        assert_eq!(painted.pixels(&plane, 0, [3, 1]), [[0, 0, 0], [64, 64, 192], [255, 255, 255]]);
    }
}
