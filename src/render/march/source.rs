//! The march shader of a plan: its texts, constants and images.

use std::borrow::Cow;

use super::dispatching::{Dispatching, TableMemory, Target};
use super::{light, others};
use crate::pool::Residence;
use crate::{Part, Source};
use relume_base::number::{rounded, unsigned};
use relume_scene::plan::{Accumulate, Integrate, LANE, MOST_PARTS, ScenePlan, Shares, Transmittance};
use relume_scene::tables::{BRICK, CELL, CROSSING_CELLS, FILM_ROWS, LARGEST_SKY_DEPTH, SECOND_DIFFERENCE, slot_edge};
use relume_scene::{Blending, Gradients, Interpolation, Lookup, Overlap, SHAPE_EDGE, StoreAs};
use relume_vulkan::Format;
use relume_vulkan::shader::Constants;

/// Bytes of a table in a uniform buffer, the limit of most devices.
pub(super) const UNIFORM_BYTES: u32 = 65_536;
/// Bytes of a table's vector.
pub(super) const VECTOR_BYTES: u32 = 16;

/// A shader text by its name.
macro_rules! text {
    ($name:literal) => {
        (concat!("shaders/", $name), Cow::Borrowed(include_str!(concat!("../../../shaders/", $name))))
    };
}

/// Shader text for texels of fields on grids of their own.
fn placed_texels(plan: &ScenePlan) -> Part {
    if plan.stores_placed_gradients() { text!("placed_gradients.wgsl") } else { text!("placed_values.wgsl") }
}

/// Shader texts by name: source, transmittance, memory of tables, factors on the medium, the march through a whole volume
/// or through bricks, and its integration.
fn parts(plan: &ScenePlan, Dispatching { tables, residence, target, .. }: Dispatching) -> Vec<Part> {
    let mut parts = vec![
        match plan.accumulate {
            Accumulate::Weights { .. } => text!("weights.wgsl"),
            Accumulate::Spectral { .. } => text!("spectral.wgsl"),
        },
        match plan.transmittance {
            Transmittance::Grey => text!("grey.wgsl"),
            // The reference alone marches matrices; `Renderer::begin_march` refuses them.
            Transmittance::Coloured | Transmittance::Mixed => text!("coloured.wgsl"),
        },
        match tables {
            TableMemory::Storage => text!("tables_storage.wgsl"),
            TableMemory::Uniform => text!("tables_uniform.wgsl"),
        },
        match target {
            Target::Device => text!("film_images.wgsl"),
            Target::Browser { .. } => text!("film_buffers.wgsl"),
        },
        text!("thinning.wgsl"),
        text!("factors.wgsl"),
        text!("clip.wgsl"),
        text!("rays.wgsl"),
        text!("fetch.wgsl"),
        placed_texels(plan),
        text!("placed.wgsl"),
        text!("labels.wgsl"),
        text!("labelled.wgsl"),
    ];
    let steps = if cuts_in_runs(plan) { text!("whole_steps.wgsl") } else { text!("cut_steps.wgsl") };
    parts.extend(match residence {
        Residence::Whole => vec![text!("whole.wgsl"), text!("march.wgsl"), text!("slices.wgsl"), steps],
        Residence::Bricked { .. } => vec![text!("bricks.wgsl"), text!("march.wgsl"), text!("rounds.wgsl")],
    });
    let grey = plan.transmittance == Transmittance::Grey;
    if plan.adds_densities() {
        parts.push(if grey { text!("densities_grey.wgsl") } else { text!("densities_coloured.wgsl") });
        parts.push(text!("densities.wgsl"));
    }
    match plan.integration {
        Integrate::Samples if plan.blending.is_extreme() => {
            parts.push(text!("table_of_groups.wgsl"));
        }
        Integrate::Samples if plan.groups.any() => {
            parts.extend([text!("keys.wgsl"), text!("samples.wgsl")]);
            parts.extend(samples_of_groups(plan));
        }
        Integrate::Samples => parts.extend([text!("keys.wgsl"), text!("samples.wgsl"), text!("samples_of_steps.wgsl")]),
        Integrate::Refined => {
            parts.extend([text!("keys.wgsl"), text!("refined.wgsl")]);
            parts.push(match tables {
                TableMemory::Storage => text!("crossings_storage.wgsl"),
                TableMemory::Uniform => text!("crossings_uniform.wgsl"),
            });
            parts.extend(samples_of_groups(plan));
        }
        Integrate::Segments => {
            parts.push(if grey { text!("segments_grey.wgsl") } else { text!("segments_coloured.wgsl") });
            parts.push(text!("segments.wgsl"));
        }
    }
    parts.push(if plan.blending.is_extreme() { text!("extremes.wgsl") } else { text!("sums.wgsl") });
    if !finishes(plan) {
        parts.push(text!("unfinished.wgsl"));
    }
    parts.push(match plan.light.absorbers {
        0 => text!("share_grey.wgsl"),
        _ => text!("share_coloured.wgsl"),
    });
    parts.push(text!("light.wgsl"));
    if plan.light.gathered.is_some() {
        parts.push(text!("gathered.wgsl"));
    }
    if plan.phases > 0 {
        parts.push(match plan.accumulate {
            Accumulate::Weights { .. } => text!("phase_weights.wgsl"),
            Accumulate::Spectral { .. } => text!("phase_spectral.wgsl"),
        });
        parts.push(text!("phase.wgsl"));
    }
    if plan.thin_films.total() > 0 {
        parts.push(text!("thin_film.wgsl"));
    }
    parts.push(("the light of the plan", light::text(plan).into()));
    parts
}

/// Shader texts for the medium of a sample as densities of groups of terms.
fn samples_of_groups(plan: &ScenePlan) -> [Part; 3] {
    let media = ("the media of the plan", others::text(plan).into());
    [text!("samples_of_groups.wgsl"), text!("table_of_groups.wgsl"), media]
}

/// True if a ray adds light after its last step.
fn finishes(plan: &ScenePlan) -> bool {
    plan.integration == Integrate::Refined || plan.blending.is_extreme()
}

/// True if the steps that a face cuts are marched among the others.
fn cuts_in_runs(plan: &ScenePlan) -> bool {
    plan.integration != Integrate::Samples || plan.blending.is_extreme() || plan.clip.is_by_field()
}

/// Formats of accumulators and transmittance.
pub(crate) fn formats(plan: &ScenePlan, storage: StoreAs) -> [Format; 2] {
    let vectors = match storage {
        StoreAs::Single => Format::Rgba32Float,
        StoreAs::Half => Format::Rgba16Float,
    };
    match plan.transmittance {
        Transmittance::Grey => [vectors, Format::R32Float],
        Transmittance::Coloured | Transmittance::Mixed => [vectors, vectors],
    }
}

/// WGSL types of the images of accumulators and transmittance.
pub(crate) fn images(plan: &ScenePlan, storage: StoreAs, access: &str) -> [String; 2] {
    formats(plan, storage).map(|format| {
        let format = match format {
            Format::R32Float => "r32float",
            Format::Rgba16Float => "rgba16float",
            _ => "rgba32float",
        };
        format!("texture_storage_2d_array<{format}, {access}>")
    })
}

/// Constants of both the march and the relight shader.
pub(crate) fn common(plan: &ScenePlan) -> Constants {
    Constants::new().u32("LAYERS", unsigned(plan.layers().max(1))).u32("LAYERS_USED", unsigned(plan.layers()))
}

/// Adds the constants of `bricks.wgsl` and `rounds.wgsl`.
fn bricked(constants: Constants, residence: Residence) -> Constants {
    let Residence::Bricked { apron } = residence else { return constants };
    constants
        .u32("BRICK", BRICK)
        .u32("BRICK_CELLS", BRICK / unsigned(CELL))
        .u32("APRON", apron)
        .u32("SLOT_EDGE", slot_edge(apron))
}

/// Adds the constants of `thin_film.wgsl`. Constants are in a module even where nothing reads them.
fn filmed(constants: Constants, plan: &ScenePlan) -> Constants {
    if plan.thin_films.total() == 0 {
        return constants;
    }
    constants
        .u32("FACING_THIN_FILMS", unsigned(plan.thin_films.facing))
        .u32("FILM_LANES", unsigned(plan.thin_film_lanes()))
        .u32("THIN_FILM_ANGLES", unsigned(FILM_ROWS))
        .u32("THIN_FILM_PARTS", unsigned(plan.parts().thin_films))
        // With weights, the vectors of their terms, which are the last ones.
        .u32("FILM_VECTORS", unsigned(plan.thin_film_vectors().len().max(1)))
        .u32("FIRST_FILM_VECTOR", unsigned(plan.thin_film_vectors().start))
        .bool("FILM_WEIGHTS", matches!(plan.accumulate, Accumulate::Weights { .. }))
}

/// Adds the constants of `factors.wgsl`, `placed.wgsl`, and of whoever reads groups of terms.
fn grouped(constants: Constants, plan: &ScenePlan) -> Constants {
    constants
        .bool("FACTORS", plan.groups.any())
        .u32("GROUPS", unsigned(plan.groups.in_tables()))
        .bool("BY_GRADIENT", plan.groups.by_gradient())
        .bool("SEVERAL_FIELDS", plan.groups.further > 0)
        .bool("ONE_GROUP_EACH", plan.groups.is_one_each())
        .u32("FURTHER", unsigned(plan.groups.further))
        .bool("HIDES", plan.groups.overlap != Overlap::Add)
        .bool("LAST_HIDES", plan.groups.overlap == Overlap::Last)
        .u32("PLACED", unsigned(plan.groups.beside()))
        .u32("PLACED_VECTORS", unsigned(plan.groups.beside().max(1)))
        .u32("FIRST_PLACED", unsigned(1 + plan.groups.sharing))
        // Those of the first field, which labels replace.
        .u32("FIRST_GROUPS", unsigned(plan.groups.of_first()))
        .u32("OTHERS", unsigned(plan.groups.lit_fields().count()))
        .u32("OTHERS_VECTORS", unsigned(plan.groups.lit_fields().count().max(1)))
        .bool("LABELS_BY_VALUE", plan.labels_by_value)
        .u32("FACTOR_VECTORS", unsigned(plan.groups.factor_vectors()))
        .u32("FACTOR_POINTS", unsigned(plan.groups.points.max(1)))
        .u32("BY_FIELDS", unsigned(plan.groups.by_fields[0]))
        .u32("BY_POINTS", unsigned(plan.groups.by_fields[1]))
        .bool("SHAPES", plan.groups.shapes[0] > 0)
        .u32("SHAPE_EDGE", unsigned(SHAPE_EDGE))
}

/// Adds the constants of `refined.wgsl`.
fn refined(constants: Constants, plan: &ScenePlan) -> Constants {
    if plan.integration != Integrate::Refined {
        return constants;
    }
    let cells = if plan.crossings { unsigned(CROSSING_CELLS) } else { 1 };
    constants.bool("CROSSINGS", plan.crossings).u32("CROSSING_CELLS", cells)
}

/// Adds the constants of `clip.wgsl`.
fn clipped(constants: Constants, plan: &ScenePlan) -> Constants {
    constants
        .u32("PLANES", unsigned(plan.clip.planes))
        .u32("SHORTENING", unsigned(plan.clip.shortening))
        .bool("BY_FIELD", plan.clip.is_by_field())
        .bool("KEEPS_ANY", plan.clip.keeps_any)
        .u32("CLIP_VECTORS", unsigned(plan.clip.planes.max(1)))
        .bool("CAPS", plan.clip.caps)
}

/// Constants of the march shader for `plan`.
fn constants(plan: &ScenePlan, Dispatching { group, block, residence, target, .. }: Dispatching) -> Constants {
    let is_fetched = target == Target::Browser { filters: false } && plan.interpolation.is_filtered();
    let (specular, parts) = (plan.specular(), plan.parts());
    let [_, transmittance] = images(plan, StoreAs::Single, "read_write");
    let table_lanes = unsigned(parts.lanes.max(1));
    let one_exponent = specular.and_then(|specular| specular.one_exponent);
    let (materials, dimension, shares, exponents) = match plan.accumulate {
        Accumulate::Weights { materials } => (materials, 0, Shares::Own, 0),
        Accumulate::Spectral { dimension, shares, exponents } => (0, dimension, shares, exponents),
    };
    refined(clipped(grouped(filmed(bricked(common(plan), residence), plan), plan), plan), plan)
        .bool("BLOCK", block)
        .bool("COMPENSATED", plan.compensated)
        .u32("LANES", unsigned(plan.lanes().max(1)))
        .u32("COMPONENTS", unsigned(dimension))
        .u32("TABLE_LANES", table_lanes)
        // Of all groups of terms.
        .u32("GROUP_LANES", table_lanes * unsigned(plan.groups.in_tables()))
        .u32("SHADING_LANES", unsigned(plan.shading_lanes()))
        .u32("UNSHADED", unsigned(parts.unshaded))
        .u32("DIFFUSE", unsigned(parts.diffuse))
        .u32("HIGHLIGHTS", unsigned(parts.highlights))
        .u32("EXPONENTS", unsigned(exponents))
        .bool("EQUAL_SHARES", shares == Shares::Equal)
        .bool("COLOURED", plan.transmittance != Transmittance::Grey)
        .u32("TRANSMITTANCE_LANES", unsigned(plan.transmittance_lanes()))
        .alias("TransmittanceImage", &transmittance)
        .u32("LIGHT_VECTORS", unsigned(plan.light.arrivals.len().max(1)))
        .u32("GRID_DEPTHS", unsigned(plan.light.grid_depths()))
        .u32("ABSORBER_VECTORS", unsigned((plan.light.absorbers * plan.lanes()).max(1)))
        .u32("PHASES", unsigned(if plan.layers() == 0 { 0 } else { plan.phases }))
        .u32("PHASE_LANES", unsigned(plan.phase_lanes()))
        .u32("THIN_FILMS", unsigned(if plan.layers() == 0 { 0 } else { plan.thin_films.total() }))
        .bool("GRADIENT", plan.gradient())
        .bool("STORED_GRADIENT", plan.stores_gradient())
        .bool("ONE_SIDED", plan.shading.is_some_and(|terms| terms.one_sided))
        .bool("SPECULAR", specular.is_some())
        .bool("ONE_EXPONENT", one_exponent.is_some())
        .u32("ONE_EXPONENT_VALUE", one_exponent.unwrap_or(0))
        .u32("EXPONENT_BITS", specular.map_or(0, |specular| specular.exponent_bits).max(plan.thin_films.exponent_bits))
        // Position of the weight of white after those of the materials, if there is one.
        .u32("WHITE_LANE", unsigned(specular.map_or(0, |_| materials / LANE)))
        .u32("WHITE_PART", unsigned(specular.map_or(0, |_| materials % LANE)))
        .bool("LABELS", plan.labels)
        .bool("SMOOTH_LABELS", plan.smooth_labels)
        .bool("NEAREST", plan.interpolation == Interpolation::Nearest)
        .bool("EXACT_LINEAR", plan.interpolation == Interpolation::ExactLinear)
        .bool("FETCHED", is_fetched)
        .bool("PLACED_FETCHED", is_fetched || plan.interpolation == Interpolation::ExactLinear)
        .bool("CUBIC", plan.interpolation == Interpolation::Cubic)
        .bool("CUBIC_ALONG", plan.interpolation.cubic_axis().is_some())
        .u32("CUBIC_AXIS", unsigned(plan.interpolation.cubic_axis().unwrap_or(0)))
        .bool("NEAREST_LOOKUP", plan.lookup == Lookup::Nearest)
        .f32("MOST_PARTS", MOST_PARTS)
        .bool("SKIPPING", plan.skipping)
        .bool("KEEPS_MORE", plan.keeps_more())
        .bool("JITTER", plan.jitter)
        .bool("FINISHES", finishes(plan))
        .bool("SHADED", plan.shades_by_gradient())
        .f32("EXTREME_SIGN", if plan.blending == Blending::Minimum { -1.0 } else { 1.0 })
        // Otherwise `cut_steps.wgsl` adds the steps that a face cuts.
        .bool("CUT_IN_RUNS", cuts_in_runs(plan) || residence != Residence::Whole)
        .bool("SKIP_INVISIBLE", plan.skips_invisible())
        // Beside the fetches of differences, a software device may round values of several fields otherwise than alone.
        .bool("KEY_AGAIN", plan.groups.further > 0 && plan.gradient() && plan.gradients == Gradients::Central)
        .u32("GROUP_WIDTH", group[0])
        .u32("GROUP_HEIGHT", group[1])
        .u32("UNIFORM_VECTORS", UNIFORM_BYTES / VECTOR_BYTES)
}

/// Result of a sweep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fill {
    /// The depths of a directional light.
    Directional,
    /// The depths of a point light.
    Point,
    /// The sums over the directions of the sky.
    Sky {
        /// True if depths beyond the reach are subtracted.
        within: bool,
    },
}

/// Depths in a texel of a light grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Texel {
    One,
    Four,
}

impl Texel {
    fn text(self) -> Part {
        match self {
            Self::One => text!("light_texel_one.wgsl"),
            Self::Four => text!("light_texel_four.wgsl"),
        }
    }
}

/// Source of the shader that fills a light grid for `plan`, with the extinctions in this memory.
pub(super) fn light_grid_source(
    plan: &ScenePlan,
    group: [u32; 2],
    tables: TableMemory,
    fill: Fill,
    texel: Texel,
) -> Source {
    let constants = clipped(grouped(Constants::new(), plan), plan)
        .bool("SKY", matches!(fill, Fill::Sky { .. }))
        .bool("POINT_LIGHT", fill == Fill::Point)
        .bool("STORED_GRADIENT", plan.stores_gradient())
        .bool("LABELS", plan.labels)
        .bool("SMOOTH_LABELS", plan.smooth_labels)
        .bool("NEAREST", plan.interpolation == Interpolation::Nearest)
        .bool("EXACT_LINEAR", plan.interpolation == Interpolation::ExactLinear)
        .bool("FETCHED", false)
        .bool("PLACED_FETCHED", plan.interpolation == Interpolation::ExactLinear)
        .bool("CUBIC", plan.interpolation == Interpolation::Cubic)
        .bool("CUBIC_ALONG", plan.interpolation.cubic_axis().is_some())
        .u32("CUBIC_AXIS", unsigned(plan.interpolation.cubic_axis().unwrap_or(0)))
        .bool("NEAREST_LOOKUP", plan.lookup == Lookup::Nearest)
        .u32("GROUP_WIDTH", group[0])
        .u32("GROUP_HEIGHT", group[1])
        .u32("UNIFORM_VECTORS", UNIFORM_BYTES / VECTOR_BYTES)
        .f32("SECOND_DIFFERENCE", rounded(SECOND_DIFFERENCE))
        .f32("LARGEST_SKY_DEPTH", rounded(LARGEST_SKY_DEPTH));
    let extinctions = match tables {
        TableMemory::Storage => text!("extinctions_storage.wgsl"),
        TableMemory::Uniform => text!("extinctions_uniform.wgsl"),
    };
    let half = text!("nearest_half.wgsl");
    let parts = vec![
        extinctions,
        text!("factors.wgsl"),
        text!("clip.wgsl"),
        text!("fetch.wgsl"),
        placed_texels(plan),
        text!("placed.wgsl"),
        text!("labels.wgsl"),
        text!("whole.wgsl"),
        half,
        text!("light_medium.wgsl"),
        if fill == (Fill::Sky { within: true }) { text!("columns_within.wgsl") } else { text!("columns.wgsl") },
        text!("depth_weights.wgsl"),
        texel.text(),
        text!("light_grid.wgsl"),
    ];
    Source { name: "light grid", constants, parts }
}

/// Source of the shader that sets the depths of ambient light.
pub(super) fn sky_source(group: [u32; 2], texel: Texel) -> Source {
    let constants = Constants::new()
        .u32("GROUP_WIDTH", group[0])
        .u32("GROUP_HEIGHT", group[1])
        .f32("SECOND_DIFFERENCE", rounded(SECOND_DIFFERENCE));
    let parts = vec![text!("nearest_half.wgsl"), texel.text(), text!("depth_weights.wgsl"), text!("sky.wgsl")];
    Source { name: "sky", constants, parts }
}

/// Source of the shader that gives depths of a light grid other numbers.
pub(super) fn light_order_source(group: [u32; 2], texel: Texel) -> Source {
    let constants = Constants::new().u32("GROUP_WIDTH", group[0]).u32("GROUP_HEIGHT", group[1]);
    Source {
        name: "light order",
        constants,
        parts: vec![text!("nearest_half.wgsl"), texel.text(), text!("light_order.wgsl")],
    }
}

/// Source of the march shader of `plan`.
pub(crate) fn source(plan: &ScenePlan, dispatching: Dispatching) -> Source {
    let parts = parts(plan, dispatching);
    Source { name: "march", constants: constants(plan, dispatching), parts }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::march::MarchUniform;
    use relume_scene::plan::{ClipPlan, FilmCounts, Groups, LightPlan, ShadingTerms};
    use relume_scene::{Direction, ScatteringMethod, VolumeAs};

    fn plan_of(materials: usize) -> ScenePlan {
        ScenePlan {
            accumulate: Accumulate::Weights { materials },
            transmittance: Transmittance::Grey,
            light: LightPlan::open(&[Direction::Infinity]),
            shading: Some(ShadingTerms { diffuse: true, specular: None, one_sided: false }),
            phases: 0,
            thin_films: FilmCounts::default(),
            groups: Groups::default(),
            clip: ClipPlan::default(),
            labels: false,
            smooth_labels: false,
            labels_by_value: false,
            background: false,
            lookup: Lookup::Nearest,
            integration: Integrate::Samples,
            blending: Blending::Composite,
            interpolation: Interpolation::Linear,
            volume: VolumeAs::Auto,
            gradients: Gradients::Packed,
            skipping: true,
            rays: 1,
            jitter: false,
            crossings: false,
            compensated: false,
            storage: StoreAs::Single,
        }
    }

    #[test]
    fn march_uniform_lies_where_the_shader_reads_it() {
        macro_rules! lies {
            ($($field:ident),*) => {
                vec![$((stringify!($field).to_owned(), std::mem::offset_of!(MarchUniform, $field))),*]
            };
        }
        let ours = lies!(
            base,
            eye_distance,
            base_u,
            spread_u,
            base_v,
            spread_v,
            direction,
            step_length,
            direction_u,
            termination,
            direction_v,
            coordinate_scale,
            low,
            coordinate_offset,
            high,
            coordinate_last,
            cell_scale,
            pixel_width,
            cell_offset,
            pixel_height,
            local_scale,
            samples,
            gradient_scale,
            width,
            cells,
            height,
            crop_low,
            active_low,
            crop_high,
            active_high,
            active_lows,
            active_highs
        );
        let source = source(&plan_of(4), Dispatching::default());
        let theirs = relume_vulkan::shader::struct_layout(&source.texts(), &source.constants, "March").ok();
        let fields = theirs.as_ref().map(|layout| {
            layout.fields.iter().map(|field| (field.name.clone(), field.offset as usize)).collect::<Vec<_>>()
        });
        assert_eq!(fields, Some(ours), "names and offsets");
        assert_eq!(theirs.map(|layout| layout.size as usize), Some(size_of::<MarchUniform>()), "size");
    }

    /// An RGB renderer accumulates three weights; a fourth is free, for any spectra.
    #[test]
    fn four_spectral_materials_march_with_the_shader_of_three_colours() {
        let words = |materials| {
            source(&plan_of(materials), Dispatching::default()).compile().map(|shader| shader.words().to_vec()).ok()
        };
        assert!(words(3).is_some(), "the shader compiles");
        assert_eq!(words(3), words(4), "the same words for three weights and four");
        assert_ne!(words(4), words(5), "a fifth needs another vector");
    }

    #[test]
    fn plans_share_the_pipelines_of_shaders_that_do_not_know_what_tells_them_apart() {
        let linear = plan_of(4);
        let cubic = ScenePlan { interpolation: Interpolation::Cubic, ..linear.clone() };
        let behind = ScenePlan { background: true, ..linear.clone() };
        let marched = |plan| source(plan, Dispatching::default());
        let relit = |plan| crate::relight::source(plan, crate::relight::Target::Display { backdrop: false });
        assert!(marched(&linear) != marched(&cubic) && relit(&linear) == relit(&cubic), "values between voxels");
        assert!(marched(&linear) == marched(&behind) && relit(&linear) != relit(&behind), "what is behind the volume");
        let gathered = LightPlan { gathered: Some(ScatteringMethod::Rows), ..linear.light.clone() };
        let scattering = ScenePlan { light: gathered, ..linear.clone() };
        assert!(marched(&linear) != marched(&scattering) && relit(&linear) == relit(&scattering), "scattered light");
        // Another memory of tables needs other bindings.
        let of = |tables, group| source(&linear, Dispatching { tables, group, ..Dispatching::default() });
        let [storage, uniform] = [TableMemory::Storage, TableMemory::Uniform].map(|tables| of(tables, [8, 8]));
        assert!(storage != uniform && storage != of(TableMemory::Storage, [16, 4]) && storage == storage.clone());
    }
}
