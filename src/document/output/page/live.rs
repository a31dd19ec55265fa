//! A volume in a page, and what a browser needs to march it (docs/theory/live.md). `live.js` reads it.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use serde_json::{Value, json};
use zlib_rs::{DeflateConfig, ReturnCode, Strategy, compress_bound, compress_slice};

use super::PageError;
use crate::annotate::{PATIENT, in_unit, letters};
use crate::output::OutputError;
use relume_base::number::count;
use relume_scene::plan::{Accumulate, Integrate, Planned, Transmittance};
use relume_scene::{Aim, Camera, FIELDS, Fill, Projection, Scene, Turned, centre};
use relume_volume::Geometry;

/// A march of a scene as a browser runs it.
#[derive(Debug)]
pub struct Live<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Its plan, and the colour model.
    pub planned: &'a Planned,
    /// Width and height of the picture.
    pub size: [usize; 2],
    /// The march shader as WGSL.
    pub shader: &'a str,
    /// Names of its resources in the order of their bindings, and their kinds: storage, uniform, texture or sampler.
    pub resources: Vec<(&'a str, &'static str)>,
    /// Pixels of a workgroup, across and down.
    pub group: [u32; 2],
    /// Bytes of its buffers by name.
    pub buffers: &'a [(&'static str, Vec<u8>)],
    /// Voxels of each field as numbers; those on grids of their own are the last.
    pub fields: Vec<Numbers<'a>>,
    /// Texels of labels, and bytes of each.
    pub labels: Option<(&'a [u8], usize)>,
    /// Voxels of the file whose mean is one of the page, along each axis.
    pub block: [usize; 3],
    /// Textures of light: names in the shader, texels along each axis, numbers of a texel, and their bits as 16-bit floats.
    pub grids: Vec<(&'a str, [u32; 3], usize, &'a [u16])>,
}

/// The voxels of a field, x fastest, and how a shader reads them: a texel is a number less `shift`.
#[derive(Clone, Copy, Debug)]
pub struct Numbers<'a> {
    /// The numbers.
    pub numbers: &'a [u16],
    /// The largest number that there may be.
    pub largest: u32,
    /// Number that is taken off.
    pub shift: u32,
    /// True if 16-bit floats hold them.
    pub is_half: bool,
    /// Voxels along each axis.
    pub dims: [usize; 3],
    /// True if they lie on a grid of their own.
    pub is_placed: bool,
}

/// The data of a live page: JSON, and blocks of deflated bytes by name.
#[derive(Clone, Debug, PartialEq)]
pub struct PackedLive {
    /// Sizes, names, frame and camera.
    pub json: String,
    /// Deflated bytes.
    pub blocks: Vec<(&'static str, Vec<u8>)>,
}

/// Prediction of a number from those of voxels before it; what it misses is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Prediction {
    /// Nothing.
    None,
    /// The voxel before along x.
    X,
    /// That of a body whose differences along the three axes are independent.
    Xyz,
    /// The median of left, above, and left + above − corner, in each slice.
    Median,
}

impl Prediction {
    const ALL: [Self; 4] = [Self::None, Self::X, Self::Xyz, Self::Median];

    fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::X => "x",
            Self::Xyz => "xyz",
            Self::Median => "median",
        }
    }

    /// Residuals of a slice, and of the slice before; numbers have this mask.
    fn residuals(self, slice: &[u16], before: Option<&[u16]>, width: usize, mask: u16) -> Vec<u16> {
        let at = |slice: &[u16], x: usize, y: usize| slice[x + y * width];
        // Of a place, the differences along x, or along x and y.
        let along_x = |slice: &[u16], x: usize, y: usize| {
            at(slice, x, y).wrapping_sub(if x > 0 { at(slice, x - 1, y) } else { 0 })
        };
        let along_xy = |slice: &[u16], x: usize, y: usize| {
            along_x(slice, x, y).wrapping_sub(if y > 0 { along_x(slice, x, y - 1) } else { 0 })
        };
        let median = |x: usize, y: usize| {
            let guess = match (x, y) {
                (0, 0) => 0,
                (_, 0) => at(slice, x - 1, y),
                (0, _) => at(slice, x, y - 1),
                _ => {
                    let [left, above, corner] =
                        [at(slice, x - 1, y), at(slice, x, y - 1), at(slice, x - 1, y - 1)].map(i32::from);
                    let guess = (left + above - corner).clamp(left.min(above), left.max(above));
                    u16::try_from(guess).unwrap_or_default()
                }
            };
            at(slice, x, y).wrapping_sub(guess)
        };
        let residual = |i: usize| {
            let (x, y) = (i % width, i / width);
            match self {
                Self::None => slice[i],
                Self::X => along_x(slice, x, y),
                Self::Xyz => along_xy(slice, x, y).wrapping_sub(before.map_or(0, |before| along_xy(before, x, y))),
                Self::Median => median(x, y),
            }
        };
        (0..slice.len()).map(|i| signed_last(residual(i) & mask, mask)).collect()
    }
}

/// A residual with its sign in the lowest bit.
fn signed_last(residual: u16, mask: u16) -> u16 {
    let is_negative = residual > mask / 2;
    ((residual << 1) ^ if is_negative { u16::MAX } else { 0 }) & mask
}

impl Live<'_> {
    /// Packs the volume, the shader and its numbers.
    ///
    /// # Errors
    ///
    /// [`PageError`].
    pub fn packed(&self) -> Result<PackedLive, PageError> {
        let geometry = &self.scene.frame.geometry;
        let mut lengths = serde_json::Map::new();
        let (mut blocks, mut fields) = (Vec::new(), Vec::new());
        for (name, field) in VOXELS.into_iter().zip(&self.fields) {
            let is_wide = field.largest > u32::from(u8::MAX);
            let (prediction, voxels) = packed_voxels(field.numbers, field.dims, is_wide)?;
            lengths.insert(name.to_owned(), json!(field.numbers.len() * if is_wide { 2 } else { 1 }));
            blocks.push((name, voxels));
            fields.push(json!({
                "dims": field.dims,
                "largest": field.largest,
                "shift": field.shift,
                "wide": is_wide,
                "prediction": prediction.name(),
            }));
        }
        let tables: Vec<u8> = self.buffers.iter().flat_map(|(_, bytes)| bytes.iter().copied()).collect();
        let mut raw = vec![("shader", self.shader.as_bytes()), ("tables", &tables[..])];
        raw.extend(self.labels.map(|(texels, _)| ("labels", texels)));
        let grids: Vec<u8> = self.grids.iter().flat_map(|(.., texels)| bytemuck::cast_slice(texels).to_vec()).collect();
        if !grids.is_empty() {
            raw.push(("grids", &grids));
        }
        for (name, bytes) in raw {
            lengths.insert(name.to_owned(), json!(bytes.len()));
            blocks.push((name, deflated(bytes, Strategy::Default, BEST)?));
        }
        let plan = &self.planned.plan;
        let twice = if plan.keeps_more() { 2 } else { 1 };
        let transmittances = plan.transmittance_lanes();
        let filter = if plan.interpolation.is_filtered() { "linear" } else { "nearest" };
        let [low, high] = self.scene.crop.unwrap_or_else(|| self.scene.frame.whole_box());
        let json = json!({
            "size": self.size,
            "dims": geometry.dims,
            "fields": fields,
            "textures": self.textures(),
            "filter": filter,
            "group": self.group,
            "lanes": plan.lanes(),
            "table_lanes": plan.parts().lanes,
            "tables": match plan.integration {
                Integrate::Segments => "integrals",
                _ if plan.adds_densities() => "densities",
                _ => "steps",
            },
            "layers": twice * plan.layers().max(1),
            "layers_used": plan.layers(),
            "transmittances": twice * transmittances,
            "transmittances_used": transmittances,
            "resources": self.resources,
            "buffers": self.buffers.iter().map(|(name, bytes)| (name, bytes.len())).collect::<Vec<_>>(),
            "label_bytes": self.labels.map_or(0, |(_, bytes)| bytes),
            "densities": self.densities(),
            "grids": self.grids.iter().map(|(name, dims, numbers, _)| json!([name, dims, numbers])).collect::<Vec<_>>(),
            "lengths": lengths,
            "frame": frame(geometry),
            "camera": camera(&self.scene.camera, geometry),
            "crop": [low.to_array(), high.to_array()],
            "thin": self.scene.frame.thin_axes(),
            "block": self.block,
            "axes": self.axes(),
            "unit": in_unit(1.0, self.scene.frame.unit).trim_start_matches('1').trim_start(),
            "patient": if self.scene.frame.anatomical { json!(PATIENT) } else { Value::Null },
        });
        Ok(PackedLive { json: json.to_string().replace('<', "\\u003c"), blocks })
    }

    /// Names of the axes of the volume, with the sides of a patient that they lead from and to.
    fn axes(&self) -> Vec<String> {
        let frame = &self.scene.frame;
        let name = |(name, axis): (&str, DVec3)| match frame.anatomical {
            true => format!(
                "{name}, {} to {}",
                letters(frame.geometry.direction * -axis),
                letters(frame.geometry.direction * axis)
            ),
            false => name.to_owned(),
        };
        ["x", "y", "z"].into_iter().zip(DVec3::AXES).map(name).collect()
    }

    /// Textures of voxels: their names in the shader, sizes, formats, the numbers of their fields, whether these lie one behind the other along z or
    /// are the numbers of a texel, and whether texels have differences.
    fn textures(&self) -> Vec<Value> {
        let plan = &self.planned.plan;
        let texture = |(name, is_placed, has_differences): (&str, bool, bool)| {
            let fields: Vec<(usize, &Numbers<'_>)> =
                self.fields.iter().enumerate().filter(|(_, field)| field.is_placed == is_placed).collect();
            let along = |axis: usize| fields.iter().map(move |(_, field)| field.dims[axis]);
            let depth = if is_placed { along(2).sum() } else { along(2).max().unwrap_or_default() };
            let has_four = has_differences || !is_placed && fields.len() > 1;
            let is_half = fields.iter().all(|(_, field)| field.is_half);
            (!fields.is_empty()).then(|| {
                json!({
                    "name": name,
                    "dims": [along(0).max(), along(1).max(), Some(depth)],
                    "format": match (has_four, is_half) {
                        (false, true) => "r16float",
                        (false, false) => "r32float",
                        (true, true) => "rgba16float",
                        (true, false) => "rgba32float",
                    },
                    "fields": fields.iter().map(|(index, _)| index).collect::<Vec<_>>(),
                    "behind": is_placed,
                    "gradient": has_differences,
                })
            })
        };
        let of_volume = ("volume", false, plan.stores_gradient());
        let of_placed = ("placed_volumes", true, plan.stores_placed_gradients());
        [of_volume, of_placed].into_iter().filter_map(texture).collect()
    }

    /// For each material by its place among the weights, the part of its scattering that dims light, where a page can change densities: a table whose
    /// numbers are those of materials. Shadows stay as they are.
    fn densities(&self) -> Vec<f64> {
        let plan = &self.planned.plan;
        let changes = matches!(plan.accumulate, Accumulate::Weights { .. })
            && plan.transmittance == Transmittance::Grey
            && !plan.blending.is_extreme()
            && !(0..self.scene.materials.len()).any(|material| self.scene.absorbs(material));
        let of = |&material: &usize| self.scene.materials.get(material).map_or(1.0, |material| material.occludes);
        self.planned.materials.iter().filter(|_| changes).map(of).collect()
    }
}

/// Names of the blocks of voxels of each field.
const VOXELS: [&str; FIELDS] = ["voxels-0", "voxels-1", "voxels-2", "voxels-3"];

impl PackedLive {
    /// The blocks as elements of HTML.
    pub(super) fn html(&self) -> String {
        let block = |(name, bytes): &(&str, Vec<u8>)| {
            format!("<script type=\"text/plain\" id=\"relume-live-{name}\">{}</script>\n", STANDARD.encode(bytes))
        };
        let blocks: String = self.blocks.iter().map(block).collect();
        format!("<script type=\"application/json\" id=\"relume-live\">{}</script>\n{blocks}", self.json)
    }
}

/// Levels of compression: to compare, and to store.
const FAST: i32 = 1;
const BEST: i32 = 9;

/// Raw deflated bytes.
fn deflated(bytes: &[u8], strategy: Strategy, level: i32) -> Result<Vec<u8>, PageError> {
    let config = DeflateConfig { level, window_bits: -15, mem_level: 9, strategy, ..DeflateConfig::default() };
    let mut deflated = vec![0; compress_bound(bytes.len())];
    match compress_slice(&mut deflated, bytes, config) {
        (packed, ReturnCode::Ok) => Ok(packed.to_vec()),
        (_, refused) => Err(OutputError::Inconsistent { detail: format!("deflate: {refused:?}") }.into()),
    }
}

/// Numbers as what the best prediction misses, deflated: low bytes, and those of wide numbers before their high bytes.
fn packed_voxels(
    numbers: &[u16],
    [width, height, _]: [usize; 3],
    is_wide: bool,
) -> Result<(Prediction, Vec<u8>), PageError> {
    let slice = (width * height).max(1);
    let mask = if is_wide { u16::MAX } else { u16::from(u8::MAX) };
    let bytes_of = |prediction: Prediction| -> Vec<u8> {
        let slices = numbers.len().div_ceil(slice);
        let of_slice = |z: usize| {
            let before = z.checked_sub(1).map(|z| &numbers[z * slice..(z + 1) * slice]);
            prediction.residuals(&numbers[z * slice..(z + 1) * slice], before, width, mask)
        };
        let residuals: Vec<u16> = (0..slices).into_par_iter().flat_map_iter(of_slice).collect();
        let low = residuals.iter().map(|code| code.to_le_bytes()[0]);
        let high = residuals.iter().filter(|_| is_wide).map(|code| code.to_le_bytes()[1]);
        low.chain(high).collect()
    };
    // Of noise, matches other than runs cost more than they save.
    let ways: Vec<(Prediction, Strategy)> =
        Prediction::ALL.into_iter().flat_map(|it| [Strategy::Default, Strategy::Rle].map(|way| (it, way))).collect();
    // One prediction after the other: each takes as much memory as the voxels.
    let sizes_of = |prediction: Prediction| {
        let bytes = bytes_of(prediction);
        let size = |strategy| deflated(&bytes, strategy, FAST).map_or(usize::MAX, |packed| packed.len());
        let (matches, runs) = rayon::join(|| size(Strategy::Default), || size(Strategy::Rle));
        [matches, runs]
    };
    let sizes = Prediction::ALL.into_iter().flat_map(sizes_of);
    let best = ways.into_iter().zip(sizes).min_by_key(|(_, size)| *size);
    let (prediction, strategy) = best.map_or((Prediction::None, Strategy::Default), |(way, _)| way);
    Ok((prediction, deflated(&bytes_of(prediction), strategy, BEST)?))
}

/// Numbers that turn places of the world into texture coordinates.
#[must_use]
pub fn frame(geometry: &Geometry) -> Value {
    let rows = |matrix: DMat3| matrix.transpose().to_cols_array_2d();
    let dims = DVec3::from_array(geometry.dims.map(count));
    json!({
        "linear": rows(geometry.texture_from_world()),
        "origin": geometry.origin.to_array(),
        "half": (0.5 / dims).to_array(),
        "unit": geometry.spacing.min_element(),
        "centre": centre(geometry).to_array(),
        "diagonal": (geometry.spacing * dims).length(),
    })
}

/// A camera as one on an orbit: at a distance where it is stated, and otherwise where a box fits.
#[must_use]
pub fn camera(camera: &Camera, geometry: &Geometry) -> Value {
    let corners = camera.aim.corners_from_centre(geometry).map(|corner| corner.to_array());
    let target = camera.aim.target(geometry);
    let Turned { azimuth, elevation, .. } = Turned::of(camera);
    let (front, fill, distance) = match &camera.aim {
        Aim::Orbit { fill, front, .. } => (*front, Some(fill), None),
        Aim::LookAt { position, target } => (*position - *target, None, Some(position.distance(*target))),
    };
    let (tangent, half) = match camera.projection {
        Projection::Perspective { fov_degrees } => (Some((fov_degrees / 2.0).to_radians().tan()), None),
        Projection::Orthographic { height } => (None, height.or(distance).map(|height| height / 2.0)),
    };
    json!({
        "up": camera.up.to_array(),
        "front": front.to_array(),
        "azimuth": azimuth,
        "elevation": elevation,
        "fill": fill.map(Fill::pairs),
        "tangent": tangent,
        "half": half,
        "distance": distance,
        "target": target.to_array(),
        "corners": corners,
    })
}
