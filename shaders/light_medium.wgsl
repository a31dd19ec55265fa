// Input of fills of the light grid: the sweep, its columns, and the extinction at a place. Part of `light_grid.wgsl`. Twin of
// `reference::shadows`.

// `tables::Sweep` and the lookup of extinctions.
struct Sweep {
    // Texture coordinates of the first column at the first slice, and their changes.
    corner: vec3f,
    behind: f32,
    per_slice: vec3f,
    // Length of a sample of a column.
    length: f32,
    across: vec3f,
    // Slices from sample to sample.
    step: f32,
    down: vec3f,
    samples: u32,
    // The crop box.
    low: vec3f,
    coordinate_scale: f32,
    high: vec3f,
    coordinate_offset: f32,
    gradient_scale: vec3f,
    coordinate_last: f32,
    shear: vec2f,
    first: vec2f,
    columns: vec2u,
    nodes: vec2u,
    // Axis of the slices, and the axes across.
    axes: vec3u,
    // Number of the light in its texel.
    part: u32,
    // First slice along z of its texels.
    texels: u32,
    // First label in the table.
    labels: u32,
    largest_rise: f32,
    // Number of the direction of the sky. After the last one, its sums become depths.
    direction: u32,
    // Distances in `sky` from a node to the next along each axis.
    strides: vec3u,
    // Length of a part of a ray to a point light, with `samples`.
    path: f32,
    // The point light and the start of its shadows, in units of length.
    point: vec3f,
    start: f32,
    // Units of length per texture coordinate.
    local_scale: vec3f,
    // Number of directions of the sky.
    directions: u32,
}

// Rows of a slice that one dispatch fills.
struct Slice {
    // Columns in use: of this slice, and of the slice before.
    window: vec4u,
    before: vec4u,
    // Number of the slice from the light, and its index along its axis.
    number: u32,
    index: u32,
    first_row: u32,
    // First column of the depths that this dispatch reads, and of those that it writes.
    reads: u32,
    writes: u32,
}

@group(0) @binding(0) var<uniform> sweep_uniform: Sweep;
@group(0) @binding(1) var volume: texture_3d<f32>;
@group(0) @binding(2) var volume_sampler: sampler;
@group(0) @binding(4) var labels: texture_3d<u32>;
@group(0) @binding(5) var<storage, read_write> columns: array<f32>;
// Light of the directions so far, at each node; after the last one, the depth that stands for their mean.
@group(0) @binding(7) var<storage, read_write> sky: array<f32>;
var<immediate> slice: Slice;

var<private> sweep: Sweep;

fn extinction_entry(i: u32) -> f32 {
    return extinctions[i / 4u][i % 4u];
}

// Extinction of a `group` of terms, before its factor, at a table coordinate.
fn extinction_of(coordinate: f32, group: u32) -> f32 {
    var extinction: f32;
    if (NEAREST_LOOKUP) {
        extinction = extinction_entry(u32(coordinate + 0.5) * GROUPS + group);
    } else {
        let i = min(u32(coordinate), u32(sweep.coordinate_last) - 1u);
        let here = extinction_entry(i * GROUPS + group);
        extinction = fma(coordinate - f32(i), extinction_entry((i + 1u) * GROUPS + group) - here, here);
    }
    return extinction;
}

// Extinction of a row of labels, where the value has this coordinate in the table.
fn label_extinction(row: u32, coordinate: f32) -> f32 {
    let entries = label_entries(row, coordinate, sweep.coordinate_last);
    let here = extinction_entry(sweep.labels + entries.here);
    if (LABELS_BY_VALUE) {
        return fma(entries.fraction, extinction_entry(sweep.labels + entries.next) - here, here);
    }
    return here;
}

// The extinction of the field that hides the others.
fn first_of(extinctions: vec4f) -> f32 {
    var fields = extinctions;
    var extinction = 0.0;
    for (var i = 0u; i < FURTHER + 1u; i += 1u) {
        let own = fields[select(i, FURTHER - i, LAST_HIDES)];
        extinction = select(extinction, own, extinction <= 0.0);
    }
    return extinction;
}

// Optical depth per unit of length.
fn extinction_at(place: vec3f) -> f32 {
    let texel = fetch(place);
    let coordinate = clamp(fma(value_of(texel), sweep.coordinate_scale, sweep.coordinate_offset), 0.0, sweep.coordinate_last);
    var extinction = 0.0;
    var further = 0.0;
    var of_fields = vec4f();
    var parts = vec4f(1.0);
    if (BY_FIELD) {
        parts = parts_at(place);
    }
    if (FACTORS) {
        var magnitude = 0.0;
        if (BY_GRADIENT) {
            var difference = texel.xyz;
            if (!STORED_GRADIENT) {
                difference = central_difference(place);
            }
            let gradient = difference * sweep.gradient_scale;
            magnitude = sqrt(dot(gradient, gradient));
        }
        var fields = FieldValues(texel, vec4f(1.0));
        if (PLACED > 0u) {
            fields = values_at(texel, place);
        }
        for (var group = 0u; group < GROUPS; group += 1u) {
            var of_group = coordinate;
            if (SEVERAL_FIELDS) {
                of_group = coordinate_of(fields.values, group, sweep.coordinate_last);
            }
            var factor = 1.0;
            if (BY_GRADIENT) {
                factor = factor_at(magnitude, group);
            }
            if (PLACED > 0u) {
                factor *= of_field(fields.there, group);
            }
            if (BY_FIELDS > 0u) {
                factor *= factor_by_fields(fields, group);
            }
            if (SHAPES) {
                var value = value_of(texel);
                if (SEVERAL_FIELDS) {
                    value = of_field(fields.values, group);
                }
                factor *= shape_of(fields, value, magnitude, group);
            }
            if (BY_FIELD) {
                factor *= select(of_field(parts, group), 1.0, group < FIRST_GROUPS);
            }
            if ((LABELS || BY_FIELD || HIDES) && SEVERAL_FIELDS) {
                // Labels replace the first field alone.
                if (group < FIRST_GROUPS) {
                    extinction = fma(factor, extinction_of(of_group, group), extinction);
                } else if (HIDES) {
                    let field = field_of(group);
                    of_fields[field] = fma(factor, extinction_of(of_group, group), of_fields[field]);
                } else {
                    further = fma(factor, extinction_of(of_group, group), further);
                }
            } else {
                extinction = fma(factor, extinction_of(of_group, group), extinction);
            }
        }
    } else {
        extinction = extinction_of(coordinate, 0u);
    }
    if (LABELS) {
        let label = label_at(place);
        let voxels = select(1u, 8u, is_mixed(label));
        var own = 0.0;
        var blend = 0.0;
        for (var i = 0u; i < voxels; i += 1u) {
            let voxel = share_of(place, label, i);
            own += select(0.0, voxel.share, voxel.row == 0u);
            blend = fma(voxel.share, label_extinction(voxel.row, coordinate), blend);
        }
        extinction = fma(own, extinction, blend);
    }
    if (BY_FIELD) {
        extinction *= parts.x;
    }
    if (HIDES) {
        of_fields.x = extinction;
        return first_of(of_fields);
    }
    if ((LABELS || BY_FIELD) && SEVERAL_FIELDS) {
        extinction += further;
    }
    return extinction;
}

// Depth of a column at this slice; 0 before it enters.
fn depth_of(column: vec2u) -> f32 {
    let on = min(column, sweep.columns - 1u);
    if (any(on < slice.before.xy) || any(on >= slice.before.zw)) {
        return 0.0;
    }
    return columns[slice.reads + on.x + sweep.columns.x * on.y];
}
