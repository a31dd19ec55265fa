//! The first look at a volume without a scene: a scene made from its values.

mod alone;
mod groups;
mod labels;
mod regions;
mod sample;
mod values;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::sync::Arc;

use glam::DVec3;
use toml_edit::{DocumentMut, Item, TableLike, value};

use values::FEW_LABELS;
pub use values::{Kind, Peak, Values};

pub(crate) use self::labels::{is_speckled, labels_text};

use self::alone::{Alone, SPECK, alone, without_specks};
use self::groups::Groups;
use self::labels::{LABEL_OPACITY, Named, OUTER_DEPTH, label_colour, quoted};
use self::sample::Thinned;
use super::fit;
use super::moves::Side;
use super::silhouette::{Depths, Seen};
use super::transfer_presets::TransferPreset;
use relume_base::number::{brief, brief_in, count, from_label, in_range, nearest_label, whole};
use relume_base::parallel;
use relume_base::progress::Progress;
use relume_colour::written::refused_name;
use relume_scene::{Aim, Camera, Fill, Interval, MaterialCurve, Projection, Term};
use relume_volume::{Geometry, Presets, Statistics, Volume, VolumeError, Window};

/// Designed materials and lights of a first look.
pub(super) const DESIGN: &str = include_str!("../../../../data/scenes/volume.toml");
/// The same for bodies.
pub(super) const TISSUE: &str = include_str!("../../../../data/scenes/tissue.toml");
/// Name of the material of a surface that hides a ragged core.
pub(super) const SURFACE: &str = "surface";
/// Names of their materials, from the faintest to the most solid.
pub(super) const DESIGNED: [&str; 3] = ["faint", "middle", "solid"];

/// A kind of picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Look {
    /// All layers: outer ones like glass, the densest solid.
    Tissue,
    /// The densest values alone; bone in CT.
    Bone,
    /// Vessels with contrast agent, or the brightest values.
    Vessel,
    /// One grey material, more opaque for larger values.
    Grey,
    /// One shining material that hides nothing.
    Fluorescence,
    /// The largest value along each ray, in grey: a maximum intensity projection.
    Maximum,
    /// A transfer preset of the window, with its opacities.
    Preset(TransferPreset),
}

impl Look {
    /// Looks that are no transfer presets.
    const OWN: [Self; 6] = [Self::Tissue, Self::Bone, Self::Vessel, Self::Grey, Self::Fluorescence, Self::Maximum];

    /// All looks.
    #[must_use]
    pub fn all() -> Vec<Self> {
        Self::OWN.into_iter().chain(TransferPreset::ALL.map(Self::Preset)).collect()
    }

    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tissue => "tissue",
            Self::Bone => "bone",
            Self::Vessel => "vessel",
            Self::Grey => "grey",
            Self::Fluorescence => "fluorescence",
            Self::Maximum => "maximum",
            Self::Preset(preset) => preset.word(),
        }
    }

    /// The look of this name.
    ///
    /// # Errors
    ///
    /// The names of all looks, and the most similar one.
    pub fn named(name: &str) -> Result<Self, String> {
        let all = Self::all();
        let found = all.iter().copied().find(|look| look.name() == name);
        let names: Vec<&str> = all.into_iter().map(Self::name).collect();
        found.ok_or_else(|| refused_name(name, "the looks", &names))
    }

    /// Whether it is for CT alone.
    fn is_of_ct(self) -> bool {
        matches!(self, Self::Preset(preset) if preset.is_of_ct())
    }
}

/// Choices of the user for a first look.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wish {
    /// Kind of picture; the values decide if there is none.
    pub look: Option<Look>,
    /// Width and centre of the range of values from transparent to most opaque.
    pub window: Option<[f64; 2]>,
    /// Window and colour of a channel, in place of both.
    pub channel: Option<Channel>,
}

/// The window of a channel, from transparent to most opaque, and its sRGB numbers from 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Channel {
    /// The lower value first.
    pub window: [f64; 2],
    /// Red, green and blue.
    pub colour: [f64; 3],
}

impl Wish {
    /// Whether nothing is asked for.
    #[must_use]
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }
}

/// Choices of connected parts by keys.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ChosenParts {
    /// True if the largest part is kept alone.
    pub(crate) largest: bool,
    /// True if specks are chosen by a key, or go with all parts but the largest.
    pub(crate) specks: bool,
}

/// What a first look is at.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Subject {
    /// Parts of the volume that are chosen already.
    pub(crate) parts: ChosenParts,
    /// The values are the largest ones of several times.
    pub(crate) is_of_times: bool,
    /// Labels are given beside the values.
    pub(crate) has_labels: bool,
}

/// A first look.
#[derive(Clone, Debug)]
pub(crate) struct FirstLook {
    /// Text of its scene, without the volume's file.
    pub(crate) text: String,
    /// The guess, in a sentence.
    pub(crate) guess: String,
    /// Parts were removed from the volume.
    pub(crate) is_changed: bool,
    /// The values are labels, which it shows by a label map.
    pub(crate) is_label_map: bool,
}

/// Share of the highlights of solid layers, and the Phong exponent: wet, as tissue and bone are.
const SPECULAR: f64 = 0.25;
const EXPONENT: i64 = 20;
/// Part of the object that is solid from which its lights cast shadows.
const SOLID_PART: f64 = 1.0 / 3.0;

/// Mean thickness in voxels below which a label is thin.
const THIN: f64 = 1.5;
/// Step where a label is thin, in smallest spacings: at a face, half a voxel of it is inside, where steps may have one or two samples.
const STEP_OF_THIN: f64 = 0.25;

/// A range of values that is shown as one material.
#[derive(Clone, Debug)]
struct Layer {
    name: String,
    /// Colour that stands for a designed spectrum, or a colour of its own.
    colour: Colour,
    range: [f64; 2],
    ramp: f64,
    depth: Depth,
    /// Its description, for a comment.
    what: String,
}

impl Layer {
    /// Its sRGB code, if it has one, or else that of the label of this `index`.
    fn code(&self, index: usize) -> &str {
        match &self.colour {
            Colour::Code(code) => code,
            Colour::Designed(_) => label_colour(index),
        }
    }
}

impl Depth {
    /// True for a layer that hides what is behind it.
    fn is_solid(self) -> bool {
        match self {
            Self::Ray(depth) => depth >= 6.0,
            Self::Voxel(depth) => depth >= 0.1,
        }
    }
}

/// Optical depth of a layer.
#[derive(Clone, Copy, Debug)]
enum Depth {
    /// Along a typical ray: glass if it is below 1, solid from about 8.
    Ray(f64),
    /// Along one voxel: a surface that hides what lies several voxels behind it, however thick the layer is.
    Voxel(f64),
}

#[derive(Clone, Debug)]
enum Colour {
    /// Index into [`DESIGNED`].
    Designed(usize),
    /// An sRGB code.
    Code(String),
}

/// How the opacity of a ramp rises with the value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Rise {
    /// Evenly.
    Even,
    /// Evenly, in a material that shines and hides nothing.
    Shining,
    /// Evenly, of the largest value of a ray.
    Largest,
    /// With the fourth power: the lower half of the range, of which there may be much, hides little of the upper.
    Steep,
}

impl Rise {
    /// Positions in the range, and the fraction of the largest opacity there.
    fn points(self) -> Vec<[f64; 2]> {
        match self {
            Self::Even | Self::Shining | Self::Largest => vec![[0.0, 0.0], [1.0, 1.0]],
            Self::Steep => [0.0, 0.25, 0.5, 0.75, 1.0_f64].map(|place| [place, place.powi(4)]).to_vec(),
        }
    }
}

/// How values become opacity.
enum Shape {
    Layers(Vec<Layer>),
    /// Labels of a label map, whose voxels have values from `from` on.
    Labels {
        labels: Vec<Named>,
        /// The label that is like glass.
        outer: Option<usize>,
        from: f64,
    },
    /// One material whose opacity rises over `range`.
    Ramp {
        layer: Layer,
        rise: Rise,
    },
}

impl Shape {
    /// The value from which the lowest layer has half of its opacity, or from which a ramp begins.
    fn lowest(&self) -> f64 {
        match self {
            Self::Layers(layers) => {
                layers.iter().map(|layer| layer.range[0] - layer.ramp / 2.0).fold(f64::INFINITY, f64::min)
            }
            Self::Ramp { layer, .. } => layer.range[0],
            Self::Labels { from, .. } => *from,
        }
    }
}

/// Layers of a CT for water at `water`.
fn ct_layers(look: Look, water: f64, most: f64) -> Vec<Layer> {
    let hu = |low: f64, high: f64| [water + low, water + high];
    let layer = |name: &str, role, range: [f64; 2], ramp, depth, what: &str| Layer {
        name: name.to_owned(),
        colour: Colour::Designed(role),
        range: [range[0], range[1].max(range[0])],
        ramp,
        depth: Depth::Ray(depth),
        what: what.to_owned(),
    };
    let bone = |from: f64, depth| {
        layer("bone", 2, [water + from, most], 60.0, depth, "bone: about 200 Hounsfield units and more")
    };
    match look {
        Look::Bone => vec![bone(250.0, 12.0)],
        Look::Vessel => vec![
            layer("vessel", 0, hu(150.0, 420.0), 40.0, 6.0, "vessels with contrast agent, and spongy bone"),
            bone(500.0, 3.0),
        ],
        _ => vec![
            layer("skin", 0, hu(-350.0, -150.0), 60.0, 0.5, "skin: between air and fat, -400 to -100 Hounsfield units"),
            layer("flesh", 1, hu(20.0, 130.0), 20.0, 0.35, "muscle and organs: 0 to 150 Hounsfield units"),
            bone(220.0, 10.0),
        ],
    }
}

/// Layers by the peaks of the histogram, or by equal shares, of objects of this `size` ([`size_of_objects`]).
fn layers(values: &Values, size: f64) -> Vec<Layer> {
    /// Peaks with less than this share of the objects' voxels are noise, or values that a converter has cut off.
    const SHARE: f64 = 0.03;
    /// Ratio of the roughness of the inner layers to that of the object from which its surface shows more than its
    /// inside.
    const RAGGED: f64 = 1.75;
    let from = values.objects_from;
    let objects = values.share([from, f64::MAX]);
    let upper = values.most.max(from);
    let span = values.percentile(0.9995) - values.percentile(0.0005);
    // Values that a converter has cut off pile up at the upper end, in a narrow peak.
    let end = values.percentile(0.9995) - 0.03 * span;
    let is_pile = |peak: &Peak| peak.value > end && peak.interval[1] - peak.interval[0] < 0.05 * span;
    let is_material = |peak: &Peak| peak.value > from + 0.02 * span && peak.share > SHARE * objects && !is_pile(peak);
    let peaks: Vec<Peak> = values.peaks.iter().copied().filter(is_material).collect();
    let mut cuts: Vec<f64> = vec![from];
    cuts.extend(peaks.iter().skip(1).map(|peak| peak.interval[0]).filter(|&cut| cut > from + 0.02 * span));
    // Of many peaks, the highest two valleys.
    while cuts.len() > DESIGNED.len() {
        cuts.remove(1);
    }
    if cuts.len() == 1 {
        // One population: nested layers, the inner ones with fewer voxels.
        let inner = [0.6, 0.9].map(|part| values.percentile_of_objects(part));
        cuts.extend(inner.into_iter().filter(|&cut| cut > from + 0.02 * span && cut < upper));
        cuts.dedup();
    }
    if cuts.len() == 1 {
        // Most objects have the largest value, as bright vessels do: thin and faint ones are a layer of their own.
        cuts.extend(Some(f64::midpoint(from, upper)).filter(|&cut| cut > from + 0.02 * span && cut < upper));
    }
    cuts.push(upper);
    let roles: &[usize] = match cuts.len() - 1 {
        1 => &[2],
        2 => &[0, 2],
        _ => &[0, 1, 2],
    };
    let number = cuts.len() - 1;
    let thinned = &values.thinned;
    let has_ragged_core = number > 1 && thinned.roughness(cuts[1]) > RAGGED * thinned.roughness(from);
    if has_ragged_core {
        cuts[0] = values.surface_from;
    }
    let layer = |(index, pair): (usize, &[f64])| {
        let [low, high] = [pair[0], pair[1]];
        let ramp = (0.02 * span).min((high - low) / 2.0).max(0.0);
        let depth = match number - 1 - index {
            0 => Depth::Ray(8.0),
            _ if has_ragged_core && index == 0 => surface_depth(size),
            1 => Depth::Ray(0.8),
            _ => Depth::Ray(0.4),
        };
        let role = roles[index.min(roles.len() - 1)];
        // The outermost layer around a ragged core is no glass.
        let name = if has_ragged_core && index == 0 { SURFACE } else { DESIGNED[role] };
        Layer {
            name: name.to_owned(),
            colour: Colour::Designed(role),
            // The last layer reaches the largest value, of which saturated data have many.
            range: [low + ramp / 2.0, if index + 1 == number { high } else { high - ramp / 2.0 }.max(low + ramp / 2.0)],
            ramp,
            depth,
            what: String::new(),
        }
    };
    cuts.windows(2).enumerate().map(layer).collect()
}

/// Optical depth of a surface around an object of this size, in cubes of the smallest spacing: along the edge of a cube of that size, and along
/// the smallest spacing at least and at most, so that coarse voxels are as sharp as fine ones.
fn surface_depth(size: f64) -> Depth {
    const OF_EDGE: f64 = 22.0;
    const OF_SPACING: [f64; 2] = [0.16, 0.6];
    Depth::Voxel((OF_EDGE / size.cbrt()).clamp(OF_SPACING[0], OF_SPACING[1]))
}

/// Layers of a transfer preset, with its opacities; none if it is for CT and `water` has no value.
fn preset_layers(preset: TransferPreset, statistics: &Statistics, water: Option<f64>) -> Vec<Layer> {
    let role = |words: &[&str], _| DESIGNED.iter().position(|name| words.contains(name)).unwrap_or_default();
    let layer = |(index, interval): (usize, Interval)| Layer {
        name: preset.tissues().get(index).map_or(DESIGNED[interval.material], |name| name).to_owned(),
        colour: Colour::Designed(interval.material),
        // The largest value may lie below the tissue.
        range: [interval.range[0], interval.range[1].max(interval.range[0])],
        ramp: interval.ramp,
        depth: Depth::Voxel(-(-interval.opacity).ln_1p()),
        what: if index == 0 { format!("the transfer preset {:?}", preset.name()) } else { String::new() },
    };
    let intervals = preset.intervals_of(statistics, water, role).unwrap_or_default();
    intervals.into_iter().enumerate().map(layer).collect()
}

/// Layers of a window of the file: nothing below it, three equal parts, and the values above as the highest.
fn window_layers(window: &Window, most: f64) -> Vec<Layer> {
    let third = (window.high - window.low) / 3.0;
    let ramp = third / 4.0;
    let layer = |role: usize| {
        // Ramps lie outside a range; neighbours cross in the middle of theirs.
        let edge = |role: usize| third.mul_add(count(role), window.low);
        let low = edge(role) + if role == 0 { ramp } else { ramp / 2.0 };
        let high = if role == 2 { most.max(window.high) } else { edge(role + 1) - ramp / 2.0 };
        Layer {
            name: DESIGNED[role].to_owned(),
            colour: Colour::Designed(role),
            range: [low, high],
            ramp,
            depth: Depth::Ray([0.4, 0.8, 8.0][role]),
            what: if role == 0 { format!("the window {:?} of the file", window.name) } else { String::new() },
        }
    };
    (0..3).map(layer).collect()
}

/// `#rrggbb` of sRGB code values from 0 to 1.
fn code([red, green, blue]: [f64; 3]) -> String {
    let byte = |part: f64| whole((part.clamp(0.0, 1.0) * 255.0).round());
    format!("#{:02x}{:02x}{:02x}", byte(red), byte(green), byte(blue))
}

/// Layers of a segmentation; a label that hides most of the others is like glass.
fn label_layers(labels: Vec<Named>, outer: Option<usize>) -> Vec<Layer> {
    let layer = |(index, Named { label, name, code, .. }): (usize, Named)| {
        let value = from_label(label);
        Layer {
            name,
            colour: Colour::Code(code),
            range: [value - 0.5, value + 0.5],
            ramp: 0.0,
            depth: Depth::Ray(if outer == Some(index) { OUTER_DEPTH } else { 12.0 }),
            what: String::new(),
        }
    };
    labels.into_iter().enumerate().map(layer).collect()
}

/// The label that more than two thirds of the rays along `axis` meet first and leave last, if there is one.
fn outermost(thinned: &Thinned, from: f64, axis: usize) -> Option<f64> {
    let is_object = |value: f64| value >= from;
    let mut met: BTreeMap<i64, usize> = BTreeMap::new();
    let mut rays = 0;
    for_columns(thinned, axis, |column| {
        let mut objects = column.iter().copied().filter(|&value| is_object(value));
        if let Some(first) = objects.next() {
            rays += 1;
            *met.entry(nearest_label(first.round()).unwrap_or_default()).or_insert(0) += 1;
        }
    });
    met.into_iter().find(|&(_, times)| count(times) > 2.0 / 3.0 * count(rays)).map(|(label, _)| from_label(label))
}

/// The two other axes beside each axis.
const ACROSS: [[usize; 2]; 3] = [[1, 2], [0, 2], [0, 1]];

/// Calls `visit` with the values of each column of voxels along `axis`.
fn for_columns(thinned: &Thinned, axis: usize, mut visit: impl FnMut(&[f64])) {
    (0..planes(thinned, axis)).for_each(|plane| for_columns_of(plane, thinned, axis, &mut visit));
}

/// Number of planes along `axis`.
fn planes(thinned: &Thinned, axis: usize) -> usize {
    thinned.dims[ACROSS[axis][1]]
}

/// The same as [`for_columns`] in one of the [`planes`].
fn for_columns_of(plane: usize, thinned: &Thinned, axis: usize, mut visit: impl FnMut(&[f64])) {
    let [one, other] = ACROSS[axis];
    let mut column = Vec::new();
    for first in 0..thinned.dims[one] {
        let mut position = [0; 3];
        (position[one], position[other]) = (first, plane);
        column.clear();
        let from = &thinned.values[thinned.at(position)..];
        column.extend(from.iter().step_by(thinned.steps()[axis]).take(thinned.dims[axis]));
        visit(&column);
    }
}

/// Voxels of each layer that a ray along `axis` meets, averaged over the rays that meet it.
fn thicknesses(thinned: &Thinned, layers: &[Layer], axis: usize) -> Vec<f64> {
    let nothing = || vec![(0_usize, 0_usize); layers.len()];
    let of_plane = |plane: usize| {
        let mut found = nothing();
        for_columns_of(plane, thinned, axis, |column| {
            for (layer, (voxels, columns)) in layers.iter().zip(&mut found) {
                let [low, high] = layer.range;
                let here = column.iter().filter(|&&value| (low..=high).contains(&value)).count();
                *voxels += here;
                *columns += usize::from(here > 0);
            }
        });
        found
    };
    let parts = parallel::map(planes(thinned, axis), &of_plane);
    let found = parts.into_iter().fold(nothing(), |mut sums, part| {
        sums.iter_mut().zip(part).for_each(|(sum, it)| *sum = (sum.0 + it.0, sum.1 + it.1));
        sums
    });
    found.into_iter().map(|(voxels, columns)| count(voxels) / count(columns.max(1))).collect()
}

/// Part of the rays along `axis` through these layers that meet a solid one.
fn solid_part(thinned: &Thinned, layers: &[Layer], axis: usize) -> f64 {
    let (mut met, mut solid) = (0, 0);
    for_columns(thinned, axis, |column| {
        let meets = |layer: &Layer| column.iter().any(|value| (layer.range[0]..=layer.range[1]).contains(value));
        met += usize::from(layers.iter().any(meets));
        solid += usize::from(layers.iter().any(|layer| layer.depth.is_solid() && meets(layer)));
    });
    count(solid) / count(met.max(1))
}

/// Voxels of the upper half of a window that a ray along `axis` meets, averaged over the rays that meet it; of a steep
/// ramp, all voxels weighted by their fraction of the largest opacity.
fn ramp_thickness(thinned: &Thinned, [low, high]: [f64; 2], rise: Rise, axis: usize) -> f64 {
    let points = rise.points();
    let middle = f64::midpoint(low, high);
    let weight = |value: f64| {
        let place = (value - low) / (high - low).max(f64::MIN_POSITIVE);
        match rise {
            Rise::Steep => {
                let after = points.partition_point(|point| point[0] < place).clamp(1, points.len() - 1);
                let [[from, one], [to, other]] = [points[after - 1], points[after]];
                ((other - one) * (place - from) / (to - from) + one).clamp(0.0, 1.0)
            }
            Rise::Even | Rise::Shining | Rise::Largest => f64::from(u8::from(value >= middle)),
        }
    };
    let (mut sum, mut columns) = (0.0, 0);
    for_columns(thinned, axis, |column| {
        if column.iter().any(|&value| value >= middle) {
            columns += 1;
            sum += column.iter().map(|&value| weight(value)).sum::<f64>();
        }
    });
    sum / count(columns.max(1))
}

/// Ratio of the distance of slices to that of their pixels from which they are thick.
const THICK: f64 = 1.5;

/// The axis across slices that are thicker than their pixels, if there is one: with linear interpolation, each would be a step of a
/// surface.
fn thick_axis(geometry: &Geometry) -> Option<usize> {
    let spacing = geometry.spacing.to_array();
    let is_thick = |axis: usize| {
        let others = spacing.iter().enumerate().filter(|(other, _)| *other != axis).map(|(_, length)| *length);
        geometry.dims[axis] > 3 && spacing[axis] > THICK * others.fold(0.0, f64::max)
    };
    (0..3).find(|&axis| is_thick(axis))
}

/// Ratio of largest to smallest extent from which a volume is viewed as a sheet.
const FLAT: f64 = 20.0;

/// Ratio of length to width and to depth from which a volume is viewed from its end: from the side it would be thinner than
/// some pixels, as a stack of slices is whose distance is stated too large.
const LONG: f64 = 64.0;

/// The axis along which a volume is so long that it is viewed from its end, if there is one.
fn long_axis(geometry: &Geometry) -> Option<usize> {
    let extent = geometry.extent();
    let long = extent.max_position();
    // A line of single voxels has no picture from its end.
    let is_thin = |axis: usize| geometry.dims[axis] > 1 && extent[long] >= LONG * extent[axis];
    (0..3).all(|axis| axis == long || is_thin(axis)).then_some(long)
}

/// Side from which a sheet is viewed, such as a single slice of any thickness, or the end of a needle; slices along z appear
/// as on a screen.
fn flat_side(geometry: &Geometry) -> Option<Side> {
    let extent = geometry.extent();
    let slice = (0..3).find(|&axis| geometry.dims.iter().enumerate().all(|(other, &n)| (n == 1) == (other == axis)));
    let needle = long_axis(geometry).filter(|_| slice.is_none());
    let thin = slice.or(needle).unwrap_or_else(|| extent.min_position());
    let normal = geometry.direction.col(thin).abs().max_position();
    let is_flat = slice.is_some() || needle.is_some() || extent.max_element() >= FLAT * extent[thin];
    is_flat.then(|| [Side::Left, Side::Front, Side::Bottom][normal])
}

/// Whether a CT is a head whose slices begin at the top: its body is cut off at the upper end of z and lies in air at
/// the lower end, or bone encloses the soft tissue, as in a skull, at the lower end alone.
fn is_upside_down(volume: &Volume, values: &Values) -> bool {
    /// Fraction of a slice that the cut body covers at least.
    const CUT: f64 = 0.03;
    /// Fraction of the soft tissue of a slice that bone encloses in a skull, and nowhere else.
    const SKULL: f64 = 0.5;
    let Kind::Ct { water } = values.kind else { return false };
    let vertical = volume.geometry.direction.z_axis.z;
    if vertical.abs() < 0.7 {
        return false;
    }
    let thinned = &values.thinned;
    let [nx, ny, nz] = thinned.dims;
    let slice = |z: usize| thinned.values.get(z * nx * ny..(z + 1) * nx * ny).unwrap_or_default();
    let ends = if vertical < 0.0 { [nz - 1, 0] } else { [0, nz - 1] };
    let [low, high] = ends.map(|z| {
        let body = slice(z).iter().filter(|&&value| value > water - 100.0).count();
        count(body) / count(nx * ny)
    });
    let [enclosed_low, enclosed_high] = ends.map(|z| enclosed(slice(z), nx, water));
    (high > CUT && low < high / 3.0) || (enclosed_low > SKULL && enclosed_high < SKULL / 2.0)
}

/// Fraction of the soft tissue of a slice of a CT with bone on all four sides, in its row and in its column.
fn enclosed(slice: &[f64], width: usize, water: f64) -> f64 {
    let height = slice.len() / width.max(1);
    let is_bone = |value: f64| value > water + 250.0;
    // First and last bone of each row and of each column.
    let (mut rows, mut columns) = (vec![[usize::MAX, 0]; height], vec![[usize::MAX, 0]; width]);
    for (place, _) in slice.iter().enumerate().filter(|&(_, &value)| is_bone(value)) {
        let (x, y) = (place % width, place / width);
        rows[y] = [rows[y][0].min(x), rows[y][1].max(x)];
        columns[x] = [columns[x][0].min(y), columns[x][1].max(y)];
    }
    let (mut soft, mut inside) = (0, 0);
    for (place, _) in slice.iter().enumerate().filter(|&(_, &it)| it > water - 100.0 && !is_bone(it)) {
        let (x, y) = (place % width, place / width);
        let is_within = |[first, last]: [usize; 2], at: usize| first < at && at < last;
        soft += 1;
        inside += usize::from(is_within(rows[y], x) && is_within(columns[x], y));
    }
    count(inside) / count(soft.max(1))
}

/// Elevation of the camera in degrees, where no axis is known.
const ELEVATION: f64 = 20.0;

/// `camera` from higher up, if the object of these points is shallow or elongated along the line of sight: its top then
/// shows more than its front.
fn raised(camera: Camera, outline: &[DVec3]) -> Camera {
    /// Elevation for shallow objects, in degrees.
    const RAISED: f64 = 45.0;
    /// Ratio of depth to height of a shallow object.
    const SHALLOW: f64 = 1.9;
    /// Ratio of depth to width and to height of an elongated one.
    const ELONGATED: f64 = 1.45;
    let ends = outline.iter().copied().reduce(DVec3::min).zip(outline.iter().copied().reduce(DVec3::max));
    let is_shallow = ends.is_some_and(|(low, high)| {
        let DVec3 { x: width, y: depth, z: height } = high - low;
        depth > SHALLOW * height || depth > ELONGATED * width.max(height)
    });
    match camera.aim {
        Aim::Orbit { azimuth, elevation, fill, front, around } if elevation > 0.0 && is_shallow => {
            Camera { aim: Aim::Orbit { azimuth, elevation: RAISED, fill, front, around }, ..camera }
        }
        _ => camera,
    }
}

/// Direction of the camera: sheets face on, patients from the front, and all else a little from the side, z up. Heads
/// whose neck is cut off by the upper end of z are turned over.
fn directions(volume: &Volume, values: &Values) -> Camera {
    let (side, azimuth, elevation) = match flat_side(&volume.geometry) {
        Some(side) => (side, 0.0, 0.0),
        None if volume.anatomical => (Side::Front, 0.0, 0.0),
        None => (Side::Front, -25.0, ELEVATION),
    };
    let front = side.outward();
    let up = match side {
        Side::Top | Side::Bottom => DVec3::NEG_Y,
        _ if !volume.anatomical && is_upside_down(volume, values) => DVec3::NEG_Z,
        _ => DVec3::Z,
    };
    // Of a long volume, rays that diverge would leave all but the near end.
    let projection = match long_axis(&volume.geometry) {
        Some(_) => Projection::Orthographic { height: None },
        None => Projection::Perspective { fov_degrees: 30.0 },
    };
    Camera { projection, aim: Aim::Orbit { azimuth, elevation, fill: Fill::of(1.0), front, around: None }, up }
}

/// Text of the scene that a first look at `volume`, whose file is called `name`, makes; it names no volume.
///
/// Other parts than the body are removed from the volume, as the scene says.
///
/// # Errors
///
/// [`LookError`].
pub fn scene_text(
    name: &str,
    volume: &mut Arc<Volume>,
    statistics: &Statistics,
    wish: Wish,
    progress: &dyn Progress,
) -> Result<String, LookError> {
    first_look(name, volume, statistics, (wish, Subject::default()), progress).map(|look| look.text)
}

/// Why a volume has no first look of a kind.
#[derive(Debug, thiserror::Error)]
#[error(
    "the look {look} is for CT, whose values are Hounsfield units: {name} has values from {} to {}, and no air, water and \
     bone 1000 apart; other looks are {}",
    brief_of(range[0], range),
    brief_of(range[1], range),
    Look::all().into_iter().filter(|look| !look.is_of_ct()).map(Look::name).collect::<Vec<_>>().join(", ")
)]
pub struct NoCt {
    look: &'static str,
    name: String,
    range: [f64; 2],
}

/// Why a volume has no first look.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LookError {
    /// The look is for CT alone.
    #[error(transparent)]
    NoCt(#[from] NoCt),
    /// Its parts were not found.
    #[error(transparent)]
    Volume(#[from] VolumeError),
}

/// The scene for `volume`, whose file is called `name`. Other parts than the body are removed from the volume, as the scene
/// says, unless a definition has chosen parts already.
///
/// # Errors
///
/// [`LookError`].
pub(crate) fn first_look(
    name: &str,
    volume: &mut Arc<Volume>,
    statistics: &Statistics,
    (wish, Subject { parts, is_of_times, has_labels }): (Wish, Subject),
    progress: &dyn Progress,
) -> Result<FirstLook, LookError> {
    // A comment ends with its line.
    let name = &name.replace(char::is_control, " ");
    // Of voxels that stay in a file, a coarse level is examined.
    let at_hand = volume.at_hand();
    let block = volume.block_of(at_hand);
    let mut values = Values::of(at_hand, statistics);
    if has_labels && matches!(&values.kind, Kind::Labels(ids) if ids.len() <= FEW_LABELS) && !volume.has_labels {
        // A scan of few values beside its labels.
        values.kind = Kind::Other(None);
    }
    if is_of_times {
        // Objects are fainter at some of the times than their largest values are.
        values.objects_from = values.surface_from;
    }
    if let Some(look) = wish.look.filter(|look| look.is_of_ct())
        && values.water(statistics).is_none()
    {
        let range = [values.least, values.most];
        return Err(NoCt { look: look.name(), name: name.clone(), range }.into());
    }
    let geometry = &volume.geometry;
    let is_flat = flat_side(geometry).is_some();
    let camera = directions(volume, &values);
    let axis = axis_of_sight(geometry, &camera);
    let (shape, guess) = shape_of(volume, (&values, statistics), wish, axis);
    let stride = count(values.thinned.stride[axis] * block[axis]);
    let scale = stride * geometry.spacing[axis] / geometry.spacing.min_element();
    let thickness = |layers: &[Layer]| -> Vec<f64> {
        thicknesses(&values.thinned, layers, axis).into_iter().map(|voxels| (voxels * scale).max(1.0)).collect()
    };
    let ranges: Vec<[f64; 2]> = match &shape {
        Shape::Layers(layers) => layers.iter().map(|it| [it.range[0] - it.ramp / 2.0, it.range[1]]).collect(),
        // The beginning of a ramp is hardly visible.
        Shape::Labels { from, .. } => vec![[*from, f64::MAX]],
        Shape::Ramp { layer: Layer { range: [low, high], .. }, rise } => {
            let from = if *rise == Rise::Steep { 0.5 } else { 0.3 };
            vec![[(1.0 - from) * low + from * high, f64::MAX]]
        }
    };
    let shows = |value: f64| ranges.iter().any(|&[low, high]| (low..=high).contains(&value));
    let mut alone = if parts.largest { None } else { alone(volume, &values, shape.lowest(), progress)? };
    // Largest values over time hide small moving parts, and a requested look may be at small parts.
    let seeks_specks = !parts.specks && !is_of_times && wish.look.is_none() && matches!(shape, Shape::Layers(_));
    if alone.is_none() && seeks_specks {
        alone = without_specks(volume, shape.lowest(), progress)?;
    }
    let crop = match alone {
        Some(Alone::Box(crop)) => Some(crop),
        _ => None,
    };
    let (at_hand, geometry) = (volume.at_hand(), &volume.geometry);
    let outline = fit::outline(at_hand, values.thinned.stride, crop, |_, value| is_flat || shows(value));
    // A body is known to be upright.
    let camera = if matches!(values.kind, Kind::Ct { .. }) { camera } else { raised(camera, &outline) };
    let opacities: Vec<f64> = match &shape {
        Shape::Layers(layers) => {
            layers.iter().zip(thickness(layers)).map(|(layer, thickness)| opacity(layer.depth, thickness)).collect()
        }
        Shape::Labels { labels, outer, .. } => {
            let glass = outer.and_then(|outer| {
                let mut layers = label_layers(labels.get(outer..=outer)?.to_vec(), Some(0));
                let thickness = thickness(&layers).pop()?;
                Some((outer, opacity(layers.pop()?.depth, thickness)))
            });
            let own = |index: usize| glass.filter(|&(outer, _)| outer == index).map_or(LABEL_OPACITY, |(_, own)| own);
            (0..labels.len()).map(own).collect()
        }
        Shape::Ramp { layer, rise } => {
            let voxels = ramp_thickness(&values.thinned, layer.range, *rise, axis);
            vec![opacity(layer.depth, (scale * voxels).max(1.0))]
        }
    };
    let camera = if is_flat {
        fit::fitted(&camera, &outline, &outline, geometry)
    } else {
        let depths =
            Depths::of(&terms(&shape, &opacities, values.most), geometry.spacing.min_element() / brightness(&shape));
        fit::framed(&camera, &outline, &Seen::new(at_hand, crop, true, depths))
    };
    let of_all = |[low, high]: [[usize; 3]; 2]| {
        let of_block = |axis: usize, at: usize, end: usize| (at * block[axis] + end).min(geometry.dims[axis] - 1);
        let low = std::array::from_fn(|axis| of_block(axis, low[axis], 0));
        [low, std::array::from_fn(|axis| of_block(axis, high[axis], block[axis] - 1))]
    };
    // Behind glass, shadows hide more than they show.
    let casts = match &shape {
        Shape::Layers(layers) => solid_part(&values.thinned, layers, axis) >= SOLID_PART,
        Shape::Labels { .. } | Shape::Ramp { .. } => true,
    };
    let is_changed = matches!(alone, Some(Alone::Above(_) | Alone::Specks(_)));
    let left_out = match alone {
        Some(Alone::Box(_)) => "; only the box of the largest connected part is shown",
        Some(Alone::Above(_)) => "; only the largest connected part is shown",
        Some(Alone::Specks(_)) => &format!("; connected parts of fewer than {SPECK} voxels are left out"),
        None => "",
    };
    let guess = format!("{name} has no scene, so Relume made one: {guess}{left_out}.");
    let groups = match &shape {
        Shape::Labels { labels, outer, .. } if labels.len() > 1 && labels::have_own_materials(labels) => {
            let names: Vec<String> = labels.iter().map(|label| label.name.clone()).collect();
            let all: u64 = values.label_counts.values().sum();
            let size = |label: &Named| {
                let voxels = values.label_counts.get(&label.label).copied().unwrap_or(0);
                count(usize::try_from(voxels).unwrap_or(usize::MAX)) / count(usize::try_from(all).unwrap_or(usize::MAX))
            };
            let sizes: Vec<f64> = labels.iter().map(size).collect();
            Some(groups::of_labels(&names, &sizes, *outer))
        }
        _ => None,
    };
    let is_body = volume.anatomical || matches!(values.kind, Kind::Ct { .. });
    let palette = if is_body { TISSUE } else { DESIGN };
    let surroundings = (alone.map(|it| it.of(of_all)), geometry);
    let mut text = text(name, &guess, (&shape, groups.as_ref(), palette), &opacities, &camera, surroundings, casts);
    // The last table of its text is that of the accuracy.
    let is_thin = |labels: &[Named]| has_thin(&values.thinned, &label_layers(labels.to_vec(), None));
    if matches!(&shape, Shape::Labels { labels, .. } if labels.len() <= FEW_LABELS && is_thin(labels)) {
        let step = geometry.spacing.min_element() * STEP_OF_THIN;
        let _ = writeln!(
            text,
            "# A label is hardly thicker than a voxel, and would have stripes with longer steps.\nstep = {step:?}"
        );
    }
    Ok(FirstLook { text, guess, is_changed, is_label_map: matches!(shape, Shape::Labels { .. }) })
}

/// The view of a transfer function on a volume.
pub(crate) struct Viewed {
    /// The table of its camera in a scene.
    pub(crate) text: String,
    /// True if the volume is a sheet, which is viewed face on.
    pub(crate) is_flat: bool,
}

/// The view of `volume` with the transfer function of these terms, whose opacities refer to `opacity_length`.
pub(crate) fn viewed(
    volume: &Volume,
    statistics: &Statistics,
    terms: &[Term],
    opacity_length: f64,
    is_interpolated: bool,
) -> Viewed {
    /// Part of the largest optical depth from which a value is visible.
    const VISIBLE: f64 = 0.02;
    let (at_hand, geometry) = (volume.at_hand(), &volume.geometry);
    let values = Values::of(at_hand, statistics);
    let is_flat = flat_side(geometry).is_some();
    let depth = |value: f64| terms.iter().map(|term| term.depth(value)).sum::<f64>();
    let bends = terms.iter().flat_map(|term| &term.opacity).map(|point| depth(point.0));
    let least = VISIBLE * bends.fold(0.0, f64::max);
    let camera = directions(volume, &values);
    let stride = values.thinned.stride;
    let outline = fit::outline(at_hand, stride, None, |_, value| is_flat || depth(value) > least);
    // A body is known to be upright.
    let camera = if matches!(values.kind, Kind::Ct { .. }) { camera } else { raised(camera, &outline) };
    let camera = if is_flat {
        fit::fitted(&camera, &outline, &outline, geometry)
    } else {
        let depths = Depths::of(terms, opacity_length);
        fit::framed(&camera, &outline, &Seen::new(at_hand, None, is_interpolated, depths))
    };
    Viewed { text: camera_text(&camera), is_flat }
}

/// What a first look shows of `volume`, which has these values, in words; but for a table that is left out, which only a search of
/// all voxels finds.
#[must_use]
pub fn guess(volume: &Volume, values: &Values, statistics: &Statistics) -> String {
    let axis = axis_of_sight(&volume.geometry, &directions(volume, values));
    shape_of(volume, (values, statistics), Wish::default(), axis).1
}

/// Axis of the grid nearest to the line of sight of a camera.
fn axis_of_sight(geometry: &Geometry, camera: &Camera) -> usize {
    let forward = camera.view(geometry, 1.0).map_or(DVec3::Y, |view| view.forward);
    (geometry.direction.transpose() * forward).abs().max_position()
}

/// The layers of `volume` along `axis`, and the guess in words. A single slice is an image.
fn shape_of(volume: &Volume, (values, statistics): (&Values, &Statistics), wish: Wish, axis: usize) -> (Shape, String) {
    let is_flat = flat_side(&volume.geometry).is_some();
    let wish = match wish {
        Wish { look: None, window: None, channel: None } if is_flat => {
            let [low, high] = [values.percentile(0.01), values.percentile(0.999)];
            let low = low - 0.1 * (high - low);
            Wish { window: Some([high - low, f64::midpoint(low, high)]), ..Wish::default() }
        }
        wish => wish,
    };
    let of_window = if is_flat { Rise::Even } else { Rise::Steep };
    shape((values, size_of_objects(volume, values)), (&volume.presets, statistics), wish, axis, of_window)
}

/// Size of the objects of `volume`, in cubes of its smallest spacing.
fn size_of_objects(volume: &Volume, values: &Values) -> f64 {
    let (spacing, block) = (volume.geometry.spacing, volume.block_of(volume.at_hand()));
    let edges = (0..3).map(|axis| spacing[axis] * count(block[axis] * values.thinned.stride[axis]));
    let voxel = edges.product::<f64>() / spacing.min_element().powi(3);
    voxel * values.share([values.objects_from, f64::MAX]) * count(values.thinned.dims.iter().product())
}

/// A range of values that all voxels have, so that it shows them: `wider` at its low and its high end, in hundredths of the
/// value. Any other range stays.
fn opened(values: &Values, [low, high]: [f64; 2], wider: [f64; 2]) -> [f64; 2] {
    if values.least < values.most || low < high {
        return [low, high];
    }
    let around = if high == 0.0 { 0.5 } else { high.abs() / 100.0 };
    [high - wider[0] * around, low + wider[1] * around]
}

/// The layers, and the guess in words.
fn shape(
    (values, size): (&Values, f64),
    (presets, statistics): (&Presets, &Statistics),
    wish: Wish,
    axis: usize,
    of_window: Rise,
) -> (Shape, String) {
    let alone = |name: &str, colour, range: [f64; 2], depth| Layer {
        name: name.to_owned(),
        colour,
        range,
        ramp: 0.0,
        depth: Depth::Ray(depth),
        what: String::new(),
    };
    let high = values.percentile(0.999).max(values.objects_from);
    let brief_value = |value: f64| brief_in(value, values.most - values.least);
    let kind = match &values.kind {
        Kind::Ct { water } if *water == 0.0 => "a CT in Hounsfield units".to_owned(),
        Kind::Ct { water } => format!("a CT in which water has the value {}", brief(*water)),
        Kind::Labels(labels) if labels.len() == 1 => "a segmentation with 1 label".to_owned(),
        Kind::Labels(labels) => format!("a segmentation with {} labels", labels.len()),
        Kind::Other(Some(modality)) => format!("{}, whose values have no known unit", modality.name()),
        Kind::Other(None) => "values without a known unit".to_owned(),
    };
    // The numbers of labels are names.
    let kind = if values.least < values.most { kind } else { format!("{kind}, all of them {}", brief(values.least)) };
    let kind = match &values.kind {
        Kind::Labels(labels) if !wish.is_none() => {
            kind + if labels.len() == 1 { " as if it were measured" } else { " as if they were measured" }
        }
        _ => kind,
    };
    if let Some(Channel { window, colour }) = wish.channel {
        let code = code(colour);
        let [low, high] = window.map(brief_value);
        return (
            Shape::Ramp { layer: alone("channel", Colour::Code(code.clone()), window, 4.0), rise: Rise::Even },
            format!(
                "{kind}, shown in the colour of the channel, {code}: transparent up to {low}, most opaque from {high}"
            ),
        );
    }
    let window = wish.window.map(|[width, centre]| [centre - width / 2.0, centre + width / 2.0]);
    if window.is_some() || wish.look == Some(Look::Grey) {
        let range = opened(values, window.unwrap_or([values.objects_from, high]), [1.0, 0.0]);
        let layer = alone("grey", Colour::Code("#e8e8e8".to_owned()), range, 4.0);
        let [low, high] = range.map(brief_value);
        let in_units = match &values.kind {
            Kind::Ct { water } if *water != 0.0 && window.is_some() => {
                let [low, high] = range.map(|value| brief(value - water));
                let water = brief(*water);
                format!(" ({low} and {high} Hounsfield units; for a window in these, add {water} to its level)")
            }
            // A window of the user, and not that of a flat image.
            _ if of_window == Rise::Steep && window.is_some_and(|[low, _]| low <= values.least) => {
                format!(
                    "; no value is transparent, because they begin at {}",
                    brief_of(values.least, &[values.least, values.most])
                )
            }
            _ => String::new(),
        };
        return (
            Shape::Ramp { layer, rise: if window.is_some() { of_window } else { Rise::Even } },
            format!("{kind}, shown in grey: transparent up to {low}, most opaque from {high}{in_units}"),
        );
    }
    // Windows of channels often begin at 0, in front of the noise of the surroundings.
    let in_front = |window: &Window| {
        let from = values.objects_from;
        [if from < window.high { window.low.max(from) } else { window.low }, window.high]
    };
    if wish.look == Some(Look::Fluorescence) {
        // The window of a channel, as far as the file states one.
        let stated = presets.windows.iter().find(|window| presets.colour.is_some() && values.are_in(window));
        let range = opened(values, stated.map_or([values.objects_from, high], in_front), [1.0, 0.0]);
        let stain = presets.colour.map_or_else(|| "#46e06a".to_owned(), code);
        let colour = if presets.colour.is_some() { stain.as_str() } else { "green" };
        let [low, high] = range.map(brief_value);
        let told = format!("{kind}, shown as an X-ray material in {colour}, brighter from {low} to {high}");
        let layer = alone("stain", Colour::Code(stain), range, 1.5);
        return (Shape::Ramp { layer, rise: Rise::Shining }, told);
    }
    if wish.look == Some(Look::Maximum) {
        // Most rays meet one of the largest values.
        let most = values.percentile(0.9998).max(values.objects_from);
        let range = opened(values, [values.objects_from, most], [1.0, 0.0]);
        let layer =
            Layer { depth: Depth::Voxel(f64::MAX), ..alone("grey", Colour::Code("#ffffff".to_owned()), range, 0.0) };
        let [low, high] = range.map(brief_value);
        return (
            Shape::Ramp { layer, rise: Rise::Largest },
            format!(
                "{kind}, of which the largest value along each ray is shown in grey: black up to {low}, white from {high}"
            ),
        );
    }
    // Programs that know no window write the range of a byte.
    let unused = |stated: Option<&Window>| match (stated, presets.windows.first()) {
        (None, Some(Window { low, high, .. })) => format!(
            "; the window of the file, {} to {}, is not used, because the values lie beside it",
            brief(*low),
            brief(*high)
        ),
        _ => String::new(),
    };
    if let (Kind::Other(_), None, Some(colour)) = (&values.kind, wish.look, presets.colour) {
        let stated = presets.windows.iter().find(|window| values.are_in(window));
        let range = stated.map_or([values.objects_from, high], in_front);
        let range = opened(values, range, [1.0, 0.0]);
        let code = code(colour);
        let layer = alone("channel", Colour::Code(code.clone()), range, 4.0);
        let [low, high] = range.map(brief_value);
        return (
            Shape::Ramp { layer, rise: Rise::Even },
            format!(
                "{kind}, shown in the colour of the channel, {code}: transparent up to {low}, most opaque from {high}{}",
                unused(stated)
            ),
        );
    }
    // A window of the file says more than the histogram.
    let stated = presets.windows.iter().find(|window| values.are_in(window)).filter(|_| wish.look.is_none());
    if let (Kind::Labels(ids), None) = (&values.kind, wish.look) {
        let (labels, outer, from) = of_labels(values, ids, presets, axis);
        let shown: Vec<&str> = labels.iter().take(4).map(|label| label.name.as_str()).collect();
        let more = labels.len() - shown.len();
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        let guess = format!("{kind}: {}{more}", shown.join(", "));
        return (Shape::Labels { labels, outer, from }, guess);
    }
    let mut layers = match (&values.kind, wish.look) {
        (_, Some(Look::Preset(preset))) => preset_layers(preset, statistics, values.water(statistics)),
        (Kind::Ct { water }, look) => {
            let mut found = ct_layers(look.unwrap_or(Look::Tissue), *water, values.most);
            found.retain(|layer| values.share(layer.range) > 0.0);
            // A file may state CT for values without any tissue.
            if found.is_empty() { layers(values, size) } else { found }
        }
        (_, None | Some(Look::Tissue)) => {
            stated.map_or_else(|| layers(values, size), |it| window_layers(it, values.most))
        }
        (_, look) => {
            let part = if look == Some(Look::Vessel) { 0.97 } else { 0.75 };
            // Interpolation hardly ever reaches the largest value itself.
            let most = values.most - 0.1 * (values.most - values.objects_from);
            let from = values.percentile_of_objects(part).min(most);
            let role = if look == Some(Look::Vessel) { 0 } else { 2 };
            let name = look.map_or("solid", Look::name);
            vec![alone(name, Colour::Designed(role), [from, values.most.max(from)], 8.0)]
        }
    };
    for layer in &mut layers {
        layer.range = opened(values, layer.range, [1.0; 2]);
    }
    let ends = [values.least, values.most];
    let shown: Vec<String> = layers
        .iter()
        .take(4)
        .map(|layer| {
            let [from, to] = layer.range.map(|end| brief_of(end, &ends));
            format!("{} from {from} to {to}", layer.name)
        })
        .collect();
    let more =
        if layers.len() > shown.len() { format!(" and {} more", layers.len() - shown.len()) } else { String::new() };
    let has_windows = matches!((&values.kind, wish.look), (Kind::Other(_), None));
    let unused = if has_windows { unused(stated) } else { String::new() };
    let guess = format!("{kind}, shown as {}{more}{unused}", shown.join(", "));
    (Shape::Layers(layers), guess)
}

/// Names and colours of these labels, the one that is like glass, and a value between the background and them.
fn of_labels(values: &Values, ids: &[i64], presets: &Presets, axis: usize) -> (Vec<Named>, Option<usize>, f64) {
    let labels = labels::named(ids, &presets.labels);
    let first = ids.first().copied().unwrap_or_default();
    let before = values.label_counts.range(..first).next_back().map_or(first - 1, |(&label, _)| label);
    let from = f64::midpoint(from_label(before), from_label(first));
    let outer = outermost(&values.thinned, from, axis).filter(|_| ids.len() > 1);
    let outer = outer.and_then(|outer| ids.iter().position(|&label| (from_label(label) - outer).abs() < 0.5));
    (labels, outer, from)
}

/// A value of a volume with values from `least` to `most`, to four digits behind their offset.
fn brief_of(number: f64, [least, most]: &[f64; 2]) -> String {
    in_range(number, most - least, 4)
}

/// Opacity of an opacity length of a layer that is this many of them thick.
fn opacity(depth: Depth, thickness: f64) -> f64 {
    let depth = match depth {
        Depth::Ray(depth) => depth / thickness,
        Depth::Voxel(depth) => depth,
    };
    let opacity = -(-depth).exp_m1();
    // Three digits are enough, and readable.
    format!("{:.2e}", opacity.clamp(1e-3, 0.95)).parse().unwrap_or(opacity)
}

/// Points of the opacity of a ramp.
fn ramp(layer: &Layer, rise: Rise, opacities: &[f64]) -> Vec<(f64, f64)> {
    let [low, high] = layer.range;
    let most = opacities.first().copied().unwrap_or_default();
    let point = |[place, part]: [f64; 2]| {
        let opacity = part * most;
        ((high - low).mul_add(place, low), format!("{opacity:.3e}").parse().unwrap_or(opacity))
    };
    rise.points().into_iter().map(point).collect()
}

/// Brightness of the colours that the camera fits, in that of the outer layer of a tissue look: a pixel of a brighter material
/// is visible from a smaller optical depth on.
const fn brightness(shape: &Shape) -> f64 {
    match shape {
        Shape::Layers(_) | Shape::Labels { .. } => 1.0,
        // The largest components of the linear colours are 0.75 and 0.33, and what shines is shaded by 1 in place of 0.45.
        Shape::Ramp { rise: Rise::Shining, .. } => 0.75 / 0.33 / 0.45,
        // 0.81 and 0.33 for grey, whose soft edges are darker: the gradients of windows of the tooth and of a soft ball.
        Shape::Ramp { .. } => 1.85,
    }
}

/// The terms of the transfer function of a scene; their materials are those of no scene.
fn terms(shape: &Shape, opacities: &[f64], most: f64) -> Vec<Term> {
    match shape {
        Shape::Labels { from, .. } => vec![Term::interval(0, [*from, most], 0.0, LABEL_OPACITY, 0.0)],
        Shape::Layers(layers) => layers
            .iter()
            .zip(opacities)
            .map(|(layer, &opacity)| Term::interval(0, layer.range, layer.ramp, opacity, 0.0))
            .collect(),
        Shape::Ramp { layer, rise } => {
            let opacity = ramp(layer, *rise, opacities);
            vec![Term {
                ramp: None,
                opacity,
                absorption: Vec::new(),
                material: MaterialCurve(Vec::new()),
                gradient: Vec::new(),
                by: Vec::new(),
                shape: None,
            }]
        }
    }
}

fn text(
    name: &str,
    guess: &str,
    (shape, groups, palette): (&Shape, Option<&Groups>, &str),
    opacities: &[f64],
    camera: &Camera,
    (alone, geometry): (Option<Alone>, &Geometry),
    casts: bool,
) -> String {
    let shines = matches!(shape, Shape::Ramp { rise: Rise::Shining, .. });
    let is_largest = matches!(shape, Shape::Ramp { rise: Rise::Largest, .. });
    // A single slice has no gradient across it to shade.
    let is_flat = flat_side(geometry).is_some();
    let is_lit = !(shines || is_largest || is_flat);
    let shading = if is_largest {
        "blending = \"maximum\"\n"
    } else if is_flat {
        "shading = \"none\"\n"
    } else {
        "lighting = \"one_sided\"\n"
    };
    let mut text = format!(
        "# First look at {name}: Relume made this scene from the values. docs/SCENE.md describes the keys.\n# {guess}\n\
         version = 1\n{shading}\n[volume]\n"
    );
    let mut line = |words: &str| {
        let _ = writeln!(text, "{words}");
    };
    if let Some(Alone::Above(above)) = alone {
        line(
            "# Only the largest connected part of the voxels above this value is kept; others, such as a table, become air.",
        );
        line(&format!("largest_part_above = {above:?}"));
    }
    if let Some(Alone::Specks(above)) = alone {
        line("# Parts of fewer voxels above this value become air, but for those inside the largest part.");
        line(&format!("without_specks = {{ above = {above:?}, voxels = {SPECK} }}"));
    }
    if matches!(shape, Shape::Labels { .. }) {
        line("# The voxels are labels; [labels] states how each is shown.\nare_labels = true");
    }
    line(
        "\n# Opacity is the fraction of light lost over the opacity length: one voxel. Ranges are values of the volume.",
    );
    line("[transfer]");
    line(&format!("opacity_length = {:?}", geometry.spacing.min_element()));
    match shape {
        Shape::Layers(layers) => {
            line("intervals = [");
            for (layer, opacity) in layers.iter().zip(opacities) {
                if !layer.what.is_empty() {
                    line(&format!("    # {}", layer.what));
                }
                let ([low, high], ramp) = (layer.range, layer.ramp);
                line(&format!(
                    "    {{ material = {}, range = [{low:?}, {high:?}], ramp = {ramp:?}, opacity = {opacity:?} }},",
                    quoted(&layer.name)
                ));
            }
            line("]");
        }
        Shape::Labels { .. } => {}
        Shape::Ramp { layer, rise } => {
            let [low, _] = layer.range;
            line(match rise {
                Rise::Steep => {
                    "# A window of values: transparent at the low end, most opaque at the high end. Between them the opacity rises \
                     with the fourth power,\n# so that values of the lower half hide little of the upper."
                }
                _ => "# A window of values: transparent at the low end, most opaque at the high end.",
            });
            let point = |(value, opacity): (f64, f64)| format!("[{value:?}, {opacity:?}]");
            let points: Vec<String> = ramp(layer, *rise, opacities).into_iter().map(point).collect();
            line(&format!("opacity = [{}]", points.join(", ")));
            line(&format!("material = [[{low:?}, {}]]", quoted(&layer.name)));
        }
    }
    let layers = match shape {
        Shape::Layers(layers) => layers.clone(),
        Shape::Ramp { layer, .. } => vec![layer.clone()],
        Shape::Labels { .. } => Vec::new(),
    };
    if let Shape::Labels { labels, .. } = shape {
        if let Some(groups) = groups {
            let labels: Vec<(String, String)> =
                labels.iter().map(|label| (label.name.clone(), label.code.clone())).collect();
            line(&groups::text(&labels, groups));
        } else {
            line(&labels::materials_text(labels));
            line("\n[lights.day]\nspectrum = \"D65\"\nkind = \"three_point\"");
        }
        line("");
        line(labels::entries_text(labels, opacities).trim_end());
    } else if layers.iter().all(|layer| matches!(layer.colour, Colour::Designed(_))) {
        line(
            "\n# In daylight all materials are visible; each of the other lights shows one material and leaves the others black.",
        );
        line(&designed(&layers, palette, is_lit));
    } else if let Some(groups) = groups {
        let code = |(index, layer): (usize, &Layer)| (layer.name.clone(), layer.code(index).to_owned());
        let labels: Vec<(String, String)> = layers.iter().enumerate().map(code).collect();
        line(&groups::text(&labels, groups));
    } else {
        for (index, layer) in layers.iter().enumerate() {
            let key = toml_edit::Key::new(&layer.name).display_repr().into_owned();
            line(&format!("\n[materials.{key}]\nreflectance = {{ srgb = \"{}\" }}", layer.code(index)));
            if shines {
                line("ambient = 1\ndiffuse = 0\nxray = true");
            }
        }
        line("\n[lights.day]\nspectrum = \"D65\"");
        line(if shines || is_largest { "kind = \"ambient\"" } else { "kind = \"three_point\"" });
    }
    line("\n# The hand of the light dial is on daylight.\n[mix]\nby = \"dial\"\nhand = \"day\"");
    if groups.is_some() {
        line(
            "\n# Lights keep their intensities, by which labels are as bright under their own light as in daylight.\n[dial]\nnormalise = false",
        );
    }
    let of_camera = camera_text(camera);
    if !of_camera.is_empty() {
        line(&of_camera);
    }
    if let Some(Alone::Box([low, high])) = alone {
        line("\n# The box of the largest connected part. Parts outside it, such as a table, are cropped.\n[crop]");
        line(&format!("min = {:?}\nmax = {:?}", low.map(count), high.map(count)));
    }
    if !is_lit {
        line("\n[display]\nexposure = 1.3");
    } else {
        line(
            "\n# The brighter parts of the first picture almost white; brighter ones keep their hue.\n[display]\nexposure = \"auto\"\ntone = \"soft\"\nbackdrop = \"dark\"",
        );
        line(
            "\n# Hollows are darker than what is open to all sides. Light behind the medium is found on a coarse grid.\n[shadows]\nambient = \"occluded\"\nspacing = 4\nstart = 6",
        );
    }
    line(
        "\n# A fine grain in place of rings on smooth surfaces, and further samples where the medium changes.\n[accuracy]\njitter = true",
    );
    if !is_largest {
        line("integration = \"adaptive\"");
    }
    if let Some(axis) = thick_axis(geometry).filter(|_| is_lit) {
        let axis = ["x", "y", "z"][axis];
        line(&format!(
            "# Slices along {axis} are thicker than their pixels: a spline across them, in place of steps.\ninterpolation = \"cubic_{axis}\""
        ));
    }
    if is_lit && casts {
        // All lights alike: others would have accumulators of their own.
        let light = "kind = \"three_point\"\n";
        text = text.replace(light, &format!("{light}shadows = true\n"));
    }
    text
}

/// The table of a camera that orbits a box; empty for others.
fn camera_text(camera: &Camera) -> String {
    let Aim::Orbit { azimuth, elevation, fill, front, around } = camera.aim else { return String::new() };
    let mut lines = vec![
        "\n# The camera orbits the box `around`. `fill` is the part of the picture that the box spans, by the aspect ratio (width /\n# height); visible pixels then span 0.9.\n[camera]"
            .to_owned(),
    ];
    if matches!(camera.projection, Projection::Orthographic { .. }) {
        lines.push("projection = \"orthographic\"".to_owned());
    }
    lines.push(format!("azimuth = {azimuth:?}\nelevation = {elevation:?}"));
    lines.push(match fill.pairs() {
        [[_, fill]] => format!("fill = {fill:?}"),
        pairs => format!("fill = {pairs:?}"),
    });
    lines.push(format!("front = {:?}\nup = {:?}", front.to_array(), camera.up.to_array()));
    if let Some([low, high]) = around {
        lines.push(format!("around = [{:?}, {:?}]", low.to_array(), high.to_array()));
    }
    lines.join("\n")
}

/// Whether a layer is thin along an axis.
fn has_thin(thinned: &Thinned, layers: &[Layer]) -> bool {
    let is_thin = |axis: usize| {
        let stride = count(thinned.stride[axis]);
        thinned.dims[axis] > 1
            && thicknesses(thinned, layers, axis).iter().any(|voxels| (0.5..THIN).contains(&(voxels * stride)))
    };
    (0..3).any(is_thin)
}

/// The designed materials and lights of `layers` in a palette. A single one that is solid and lit has highlights: they are white, and
/// would show a material under the lights that leave it black.
fn designed(layers: &[Layer], palette: &str, is_lit: bool) -> String {
    let used = |role: usize| layers.iter().find(|layer| matches!(layer.colour, Colour::Designed(it) if it == role));
    let start = palette.find("[palette]").unwrap_or_default();
    let end = palette.find("[camera]").unwrap_or(palette.len());
    let design = palette.get(start..end).unwrap_or_default();
    let mut document: DocumentMut = design.parse().unwrap_or_default();
    for (role, name) in DESIGNED.into_iter().enumerate().filter(|&(role, _)| used(role).is_none()) {
        let light = format!("for_{name}");
        remove(&mut document, &["palette", "lights"], &light);
        remove(&mut document, &["palette", "materials"], name);
        remove(&mut document, &["palette", "cells"], name);
        remove(&mut document, &["materials"], name);
        remove(&mut document, &["lights"], &light);
        for other in DESIGNED.into_iter().enumerate().filter(|&(other, _)| other != role).map(|(_, name)| name) {
            remove(&mut document, &["palette", "cells", other], &light);
        }
    }
    let shines = |role: usize| layers.len() == 1 && used(role).is_some_and(|layer| layer.depth.is_solid());
    for (_, name) in DESIGNED.into_iter().enumerate().filter(|&(role, _)| is_lit && shines(role)) {
        let material = &mut document["materials"][name];
        (material["specular"], material["exponent"]) = (value(SPECULAR), value(EXPONENT));
    }
    let mut text = document.to_string();
    for (role, name) in DESIGNED.into_iter().enumerate() {
        if let Some(layer) = used(role) {
            text = text.replace(name, &layer.name);
        }
    }
    text.trim_end().to_owned()
}

/// Removes `key` from the table at `path`.
fn remove(document: &mut DocumentMut, path: &[&str], key: &str) {
    let mut table: Option<&mut dyn TableLike> = Some(document.as_table_mut());
    for part in path {
        table = table.and_then(|table| table.get_mut(part)).and_then(Item::as_table_like_mut);
    }
    if let Some(table) = table {
        table.remove(key);
    }
}
