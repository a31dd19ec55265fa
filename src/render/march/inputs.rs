//! Inputs of a march beside textures: its rays, and the bytes of its buffers by their names in the shader.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use crate::{RenderError, Uploaded};
use relume_base::number::{count, rounded, unsigned};
use relume_scene::plan::{Integrate, LANE, Planned, refinement_bound};
use relume_scene::tables::{
    BlockBox, CapTable, ClipTable, CrossingTable, FactorTable, LabelTable, Occupancy, PhaseTable, PlacedField,
    PositionTable, RayTable, SegmentTable, ShadingTable, Steps, Storage, ThinFilmTable, TransferTable,
    gradient_numbers, occupancy_of_fields, reach_in_voxels,
};
use relume_scene::{FIELDS, Scene};

/// Bytes of buffers, by their names in the shader.
pub(crate) type Bytes = Vec<(&'static str, Vec<u8>)>;

/// Everything that a march of a picture reads beside textures.
pub(crate) struct Inputs {
    pub(crate) rays: RayTable,
    pub(crate) occupancy: Occupancy,
    pub(crate) uniforms: Bytes,
    pub(crate) storages: Bytes,
    /// Tables of values and labels, and that of crossings of refined plans: uniforms or storage.
    pub(crate) tables: Bytes,
}

/// Uniform of a frame, in the layout of `shaders/march.wgsl`.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
#[expect(missing_docs, reason = "named and explained in the shader and in `RayTable`")]
pub struct MarchUniform {
    pub base: [f32; 3],
    pub eye_distance: f32,
    pub base_u: [f32; 3],
    pub spread_u: f32,
    pub base_v: [f32; 3],
    pub spread_v: f32,
    pub direction: [f32; 3],
    pub step_length: f32,
    pub direction_u: [f32; 3],
    pub termination: f32,
    pub direction_v: [f32; 3],
    pub coordinate_scale: f32,
    pub low: [f32; 3],
    pub coordinate_offset: f32,
    pub high: [f32; 3],
    pub coordinate_last: f32,
    pub cell_scale: [f32; 3],
    pub pixel_width: f32,
    pub cell_offset: [f32; 3],
    pub pixel_height: f32,
    pub local_scale: [f32; 3],
    pub samples: u32,
    pub gradient_scale: [f32; 3],
    pub width: u32,
    pub cells: [u32; 3],
    pub height: u32,
    pub crop_low: [f32; 3],
    pub active_low: f32,
    pub crop_high: [f32; 3],
    pub active_high: f32,
    pub active_lows: [f32; FIELDS],
    pub active_highs: [f32; FIELDS],
}

/// Uniform of the division of steps, in the layout of `shaders/segments.wgsl` and `shaders/refined.wgsl`; whole vectors.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
struct SegmentUniform {
    unit: f32,
    variation: f32,
    scale: f32,
    offset: f32,
}

/// Uniform of a block, in the layout of `shaders/rays.wgsl`.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
struct BlockUniform {
    low: [f32; 3],
    unused: u32,
    high: [f32; 3],
    unused_too: u32,
    open: [u32; 3],
    unused_as_well: u32,
}

impl BlockUniform {
    fn new(block: Option<BlockBox>) -> Self {
        block.map_or_else(Self::default, |BlockBox { low, high, open }| Self {
            low: low.to_array().map(rounded),
            high: high.to_array().map(rounded),
            open: open.map(u32::from),
            ..Self::default()
        })
    }
}

/// The table of the transfer function.
enum Values {
    /// Effects of steps, or densities at samples.
    Steps(TransferTable),
    /// Integrals of densities.
    Segments(SegmentTable),
}

impl Values {
    /// Builds the tables of `scene`: of values, and of labels.
    fn new(scene: &Scene, planned: &Planned, domains: &[[f64; 2]]) -> (Self, LabelTable) {
        let domain = domains.first().copied().unwrap_or_default();
        let values = match planned.plan.integration {
            Integrate::Samples | Integrate::Refined => Self::Steps(TransferTable::new(scene, planned, domains)),
            Integrate::Segments => Self::Segments(SegmentTable::new(scene, planned, domain)),
        };
        // Segments have no labels by value.
        let entries = if let Self::Steps(table) = &values { table.entries() } else { 0 };
        (values, LabelTable::new(scene, planned, domain, entries))
    }

    /// Source and opacity as bytes.
    fn bytes(&self) -> [&[u8]; 2] {
        match self {
            Self::Steps(table) => [bytemuck::cast_slice(&table.source), bytemuck::cast_slice(&table.opacity)],
            Self::Segments(table) => [bytemuck::cast_slice(&table.source), bytemuck::cast_slice(&table.depth)],
        }
    }
}

/// Occupancy of the macrocells of `uploaded` under the table `values`.
fn occupancy_of(scene: &Scene, planned: &Planned, uploaded: &Uploaded, values: &Values) -> Occupancy {
    let reach = reach_in_voxels(scene, &planned.plan);
    match values {
        Values::Steps(table) if planned.plan.groups.further > 0 => {
            occupancy_of_fields(&uploaded.all_cells(), &uploaded.places, table)
        }
        Values::Steps(table) => uploaded.cells.occupancy_within(scene, reach, &table.active_entries()),
        Values::Segments(table) => uploaded.cells.occupancy_within(scene, reach, &table.active_entries()),
    }
}

/// Ranges of the values of texels beyond which each of several fields shows nothing; nothing lies in that of a field that is not there.
fn active_values(uploaded: &Uploaded, storages: &[&Storage], values: &Values) -> [[f32; FIELDS]; 2] {
    let mut ranges = [[f32::INFINITY; FIELDS], [f32::NEG_INFINITY; FIELDS]];
    let Values::Steps(table) = values else { return ranges };
    if uploaded.places.is_empty() {
        return ranges;
    }
    for (field, storage) in storages.iter().enumerate().take(FIELDS) {
        let active = table.active_entries_of(field);
        let (Some(first), Some(last)) = (active.iter().position(|&it| it), active.iter().rposition(|&it| it)) else {
            continue;
        };
        let [scale, offset] = table.coordinate_from_texel(storage);
        // Wider by more than rounding takes: what shows nothing adds nothing. Values beyond the table are those at its ends.
        let value = |coordinate: f64| if scale > 0.0 { rounded((coordinate - offset) / scale) } else { f32::NAN };
        let [low, high] = [value(count(first) - 1.5), value(count(last) + 1.5)];
        let is_first = first <= 1 || low.is_nan();
        let is_last = last + 2 >= active.len() || high.is_nan();
        ranges[0][field] = if is_first { f32::NEG_INFINITY } else { low };
        ranges[1][field] = if is_last { f32::INFINITY } else { high };
    }
    ranges
}

impl MarchUniform {
    fn new(
        scene: &Scene,
        (uploaded, storages): (&Uploaded, &[&Storage]),
        rays: &RayTable,
        values: &Values,
        size: [usize; 2],
    ) -> Self {
        let storage = storages.first().copied().unwrap_or(&uploaded.storage);
        let vector = |vector: DVec3| vector.to_array().map(rounded);
        let (coordinate_last, [scale, offset], [active_low, active_high]) = match values {
            Values::Steps(table) => (table.entries() - 1, table.coordinate_from_texel(storage), table.active()),
            Values::Segments(table) => (table.cells(), table.coordinate_from_texel(storage), table.active()),
        };
        let [active_lows, active_highs] = active_values(uploaded, storages, values);
        Self {
            base: vector(rays.base),
            eye_distance: rounded(rays.eye_distance),
            base_u: vector(rays.base_u),
            spread_u: rounded(rays.spread_u),
            base_v: vector(rays.base_v),
            spread_v: rounded(rays.spread_v),
            direction: vector(rays.direction),
            step_length: rounded(rays.step_length),
            direction_u: vector(rays.direction_u),
            // A ray to an extreme value goes on to its end.
            termination: if scene.blending.is_extreme() { 0.0 } else { rounded(scene.accuracy.termination) },
            direction_v: vector(rays.direction_v),
            coordinate_scale: rounded(scale),
            low: vector(rays.low),
            coordinate_offset: rounded(offset),
            high: vector(rays.high),
            coordinate_last: rounded(count(coordinate_last)),
            cell_scale: vector(rays.cell_scale),
            pixel_width: rounded(2.0 / count(size[0])),
            cell_offset: vector(rays.cell_offset),
            pixel_height: rounded(2.0 / count(size[1])),
            local_scale: vector(rays.local_scale),
            samples: rays.samples,
            gradient_scale: storage.gradient_scale().map(rounded),
            width: unsigned(size[0]),
            cells: uploaded.cells.dims.map(unsigned),
            height: unsigned(size[1]),
            crop_low: vector(rays.crop_low),
            active_low: rounded(active_low),
            crop_high: vector(rays.crop_high),
            active_high: rounded(active_high),
            active_lows,
            active_highs,
        }
    }
}

impl Inputs {
    /// Those of a picture of `size` (width, height) of the `uploaded` volume, the texels of whose fields are as `storages` say.
    pub(crate) fn new(
        scene: &Scene,
        planned: &Planned,
        (uploaded, storages): (&Uploaded, &[&Storage]),
        size: [usize; 2],
    ) -> Result<Self, RenderError> {
        let storage = storages.first().copied().unwrap_or(&uploaded.storage);
        let plan = &planned.plan;
        let aspect = count(size[0]) / count(size[1]);
        let view = scene.camera.view(&scene.frame.geometry, aspect).ok_or(RenderError::Camera)?;
        let step_length = scene.accuracy.step_length;
        let rays = RayTable::new(scene, &view).ok_or(RenderError::TooManySamples { step_length })?;
        let (values, label_table) = Values::new(scene, planned, &uploaded.domains());
        let occupancy = occupancy_of(scene, planned, uploaded, &values);
        let march = MarchUniform::new(scene, (uploaded, storages), &rays, &values, size);
        let film_table = ThinFilmTable::new(scene, planned);
        let entries = match &values {
            Values::Steps(table) => table.entries(),
            Values::Segments(table) => table.cells() + 1,
        };
        let factor_table = FactorTable::new(scene, planned, storages, entries);
        let unit = scene.frame.geometry.spacing.min_element();
        let placed = placed_bytes(&uploaded.places, storages, unit);
        let caps = CapTable::new(scene, storage);
        let unit = match &values {
            Values::Steps(_) => 0.0,
            Values::Segments(table) => rounded(table.unit),
        };
        let variation = match plan.integration {
            Integrate::Refined => refinement_bound(scene.accuracy.variation),
            Integrate::Samples | Integrate::Segments => scene.accuracy.variation,
        };
        let mut segments = SegmentUniform { unit, variation: rounded(variation), ..SegmentUniform::default() };
        // One cell for plans that do not read it.
        let mut cells = vec![0.0_f32; 4];
        if let (true, Values::Steps(table)) = (plan.crossings, &values) {
            let crossings = CrossingTable::new(scene, planned, storage.domain);
            // From coordinates of the table of values, which come from texels as the places do.
            let [scale, offset] = crossings.place_from_texel(storage);
            let [of_value, offset_of_value] = table.coordinate_from_texel(storage);
            let ratio = scale / of_value;
            [segments.scale, segments.offset] = [ratio, ratio.mul_add(-offset_of_value, offset)].map(rounded);
            cells = crossings.cells.into_iter().flatten().map(rounded).collect();
        }
        let [source, opacity] = values.bytes();
        let mut tables = vec![
            ("table_source", source.to_vec()),
            ("table_opacity", opacity.to_vec()),
            ("label_source", bytemuck::cast_slice(&label_table.table.source).to_vec()),
            ("label_opacity", bytemuck::cast_slice(&label_table.table.opacity).to_vec()),
        ];
        if plan.integration == Integrate::Refined {
            tables.push(("crossings", bytemuck::cast_slice(&cells).to_vec()));
        }
        let uniforms = vec![
            ("march_uniform", bytemuck::bytes_of(&march).to_vec()),
            ("block", bytemuck::bytes_of(&BlockUniform::new(rays.block)).to_vec()),
            ("shading_uniform", shading_bytes(scene, planned)),
            ("absorbers", absorber_bytes(scene, planned)),
            ("phases_uniform", phase_bytes(scene, planned)),
            ("thin_films_uniform", film_bytes(&film_table)),
            ("segments_uniform", bytemuck::bytes_of(&segments).to_vec()),
            ("factor_table", bytemuck::cast_slice(&factor_table.vectors).to_vec()),
        ];
        let storages = vec![
            ("thin_film_angles", bytemuck::cast_slice(&film_table.angles).to_vec()),
            ("shapes", shape_bytes(&factor_table).to_vec()),
            ("clip_planes", clip_bytes(&rays.clip, &caps, DVec3::ONE)),
            ("placed_fields", placed),
            ("occupancy", bytemuck::cast_slice(&occupancy.words).to_vec()),
            ("label_rows", bytemuck::cast_slice(&label_table.rows.words()).to_vec()),
        ];
        Ok(Self { rays, occupancy, uniforms, storages, tables })
    }
}

/// Bytes of the shader's struct `Shading`: positions, then ambient, diffuse, specular and exponents of the materials.
fn shading_bytes(scene: &Scene, planned: &Planned) -> Vec<u8> {
    let positions = PositionTable::new(scene, planned).0;
    let mut lights: Vec<[f32; LANE]> = positions.iter().map(|light| light.to_array().map(rounded)).collect();
    lights.resize(lights.len().max(1), [0.0; LANE]);
    let mut table = ShadingTable::new(scene, planned);
    let lanes = table.ambient.len().max(1);
    let mut bytes = bytemuck::cast_slice(&lights).to_vec();
    for coefficients in [&mut table.ambient, &mut table.diffuse, &mut table.specular] {
        coefficients.resize(lanes, [0.0; LANE]);
        bytes.extend_from_slice(bytemuck::cast_slice(coefficients));
    }
    table.exponent.resize(lanes, [0; LANE]);
    bytes.extend_from_slice(bytemuck::cast_slice(&table.exponent));
    bytes
}

/// Bytes of the shader's struct `Clip`, for texture coordinates that are `scale` times those of the volume.
pub(super) fn clip_bytes(planes: &ClipTable, caps: &CapTable, scale: DVec3) -> Vec<u8> {
    let bits =
        |fields: &[bool; FIELDS]| fields.iter().rev().fold(0.0, |bits, &cuts| 2.0 * bits + f32::from(u8::from(cuts)));
    let fields: Vec<f32> = planes.fields().iter().map(bits).collect();
    let planes = planes.planes().iter().map(|plane| (plane.truncate() / scale).extend(plane.w));
    let mut planes: Vec<[f32; LANE]> = planes.map(|plane| plane.to_array().map(rounded)).collect();
    let mut outward: Vec<[f32; LANE]> =
        caps.outward.iter().map(|outward| outward.extend(0.0).to_array().map(rounded)).collect();
    let vectors = planes.len().max(1);
    planes.resize(vectors, [0.0; LANE]);
    outward.resize(vectors, [0.0; LANE]);
    outward.iter_mut().zip(fields).for_each(|(outward, bits)| outward[LANE - 1] = bits);
    let fall = [caps.fall[0], caps.fall[1], 0.0, 0.0].map(rounded);
    [planes, outward, vec![fall]].iter().flat_map(|vectors| bytemuck::cast_slice(vectors).to_vec()).collect()
}

/// Bytes of the tables of shapes; a buffer is not empty.
pub(super) fn shape_bytes(factors: &FactorTable) -> &[u8] {
    if factors.shapes.is_empty() { &[0; 4] } else { bytemuck::cast_slice(&factors.shapes) }
}

/// Bytes of the shader's structs `PlacedField`.
pub(super) fn placed_bytes(places: &[Option<PlacedField>], storages: &[&Storage], unit: f64) -> Vec<u8> {
    let mut first = 0.0;
    let mut vectors: Vec<[f32; LANE]> = Vec::new();
    // The first storage is that of the first field.
    for (field, storage) in places.iter().zip(storages.iter().skip(1)) {
        let Some(field) = field else { continue };
        let [[x, y, z], high] = field.ends();
        let [scale, [fall, lowest, _]] = gradient_numbers(storage, Some(field), unit);
        vectors.extend(field.rows.map(|row| row.to_array().map(rounded)));
        vectors.push([x, y, z, first].map(rounded));
        vectors.push([high[0], high[1], high[2], lowest].map(rounded));
        vectors.push([scale[0], scale[1], scale[2], fall].map(rounded));
        first += count(field.dims[2]);
    }
    vectors.resize(vectors.len().max(6), [0.0; LANE]);
    bytemuck::cast_slice(&vectors).to_vec()
}

/// Bytes of the shader's struct `Phases`.
fn phase_bytes(scene: &Scene, planned: &Planned) -> Vec<u8> {
    let PhaseTable { gain, least, forward, backward } = PhaseTable::new(scene, planned);
    [gain, least, forward, backward].iter().flat_map(|lanes| bytemuck::cast_slice(lanes).to_vec()).collect()
}

/// Bytes of the shader's struct `Absorbers`: the coefficients of each coloured absorber of shadows, in lanes.
fn absorber_bytes(scene: &Scene, planned: &Planned) -> Vec<u8> {
    let lanes = planned.plan.lanes();
    let mut vectors = Vec::new();
    if planned.plan.light.absorbers > 0 {
        for coefficients in Steps::new(scene, planned).absorber_coefficients() {
            let number = |i: usize| coefficients.get(i).map_or(0.0, |&number| rounded(number));
            vectors
                .extend((0..lanes).map(|lane| std::array::from_fn::<f32, LANE, _>(|part| number(lane * LANE + part))));
        }
    }
    vectors.resize(vectors.len().max(1), [0.0; LANE]);
    bytemuck::cast_slice(&vectors).to_vec()
}

/// Bytes of the shader's struct `Films`.
fn film_bytes(ThinFilmTable { factor, exponent, weight, film, angles: _ }: &ThinFilmTable) -> Vec<u8> {
    let bytes: [&[u8]; 4] = [
        bytemuck::cast_slice(factor),
        bytemuck::cast_slice(exponent),
        bytemuck::cast_slice(weight),
        bytemuck::cast_slice(film),
    ];
    bytes.concat()
}
