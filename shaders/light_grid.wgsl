// Fills a slice of the light grid for one directional light, or sums the light of one direction of the sky: nodes read the
// optical depth of the columns that pass them, and the columns go on to the next slice. For a point light, a ray goes from
// each node to the light. Twin of `reference::shadows`.

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
    // Number of the direction of the sky.
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
@group(0) @binding(6) var light_grid: texture_storage_3d<rgba16float, read_write>;
// Light of the directions so far, at each node.
@group(0) @binding(7) var<storage, read_write> sky: array<f32>;
var<immediate> slice: Slice;

var<private> sweep: Sweep;

fn extinction_entry(i: u32) -> f32 {
    return extinctions[i / 4u][i % 4u];
}

// Optical depth per unit of length.
fn extinction_at(place: vec3f) -> f32 {
    let texel = fetch(place);
    var value = texel.x;
    if (STORED_GRADIENT) {
        value = texel.w;
    }
    let coordinate = clamp(fma(value, sweep.coordinate_scale, sweep.coordinate_offset), 0.0, sweep.coordinate_last);
    var extinction: f32;
    if (NEAREST_LOOKUP) {
        extinction = extinction_entry(u32(coordinate + 0.5));
    } else {
        let i = min(u32(coordinate), u32(sweep.coordinate_last) - 1u);
        let here = extinction_entry(i);
        extinction = fma(coordinate - f32(i), extinction_entry(i + 1u) - here, here);
    }
    if (GRADIENT_OPACITY) {
        var difference = texel.xyz;
        if (!STORED_GRADIENT) {
            difference = central_difference(place);
        }
        extinction *= gradient_factor(difference * sweep.gradient_scale);
    }
    if (LABELS) {
        let label = label_at(place);
        let voxels = sharing(label);
        var own = 0.0;
        var blend = 0.0;
        for (var i = 0u; i < voxels; i += 1u) {
            let voxel = share_of(place, label, i);
            own += select(0.0, voxel.share, voxel.row == 0u);
            blend = fma(voxel.share, extinction_entry(sweep.labels + voxel.row), blend);
        }
        extinction = fma(own, extinction, blend);
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

// Depth of the columns at a node, linear between four of them.
fn passed(node: vec2u) -> f32 {
    // Rounding may place the first column before 0.
    let column = max(fma(vec2f(f32(slice.number)), sweep.shear, vec2f(node) - sweep.first), vec2f());
    let base = floor(column);
    let fraction = column - base;
    let at = vec2u(base);
    let near_left = depth_of(at);
    let near = fma(fraction.x, depth_of(at + vec2u(1u, 0u)) - near_left, near_left);
    let far_left = depth_of(at + vec2u(0u, 1u));
    let far = fma(fraction.x, depth_of(at + vec2u(1u, 1u)) - far_left, far_left);
    return fma(fraction.y, far - near, near);
}

// `sweep.samples`. Mesa's software device compiles a shader with a uniform as the bound of a loop again for every dispatch
// (docs/theory/device.md), so the bound depends on the invocation in form.
fn own_samples(invocation: u32) -> u32 {
    return min(sweep.samples, 0x10000u + invocation);
}

// Optical depth that a column gains over this slice.
fn rise(column: vec2u) -> f32 {
    let start = fma(vec3f(f32(column.x)), sweep.across, fma(vec3f(f32(column.y)), sweep.down, sweep.corner));
    let first = f32(slice.number) - sweep.behind;
    var sum = 0.0;
    let samples = own_samples(column.x);
    for (var i = 0u; i < samples; i += 1u) {
        let slices = fma(f32(i) + 0.5, sweep.step, first);
        let place = fma(vec3f(slices), sweep.per_slice, start);
        let inside = all(sweep.low <= place) && all(place <= sweep.high);
        sum += select(0.0, extinction_at(place), inside);
    }
    return min(sum * sweep.length, sweep.largest_rise);
}

// Optical depth between a node and the point light.
fn depth_to_point(node: vec2u) -> f32 {
    let on_slice = fma(vec3f(f32(slice.index)), sweep.per_slice, sweep.corner);
    let place = fma(vec3f(f32(node.x)), sweep.across, fma(vec3f(f32(node.y)), sweep.down, on_slice));
    let way = sweep.point - place * sweep.local_scale;
    let distance = max(length(way), 1e-6);
    let along = way / (distance * sweep.local_scale);
    let is_parallel = abs(along) < vec3f(1e-30);
    let reach = (select(sweep.low, sweep.high, along > vec3f()) - place) / select(along, vec3f(1.0), is_parallel);
    let to_face = select(reach, vec3f(1e30), is_parallel);
    let open = max(min(min(distance, to_face.x), min(to_face.y, to_face.z)) - sweep.start, 0.0);
    // Rounding does not add a part.
    let parts = max(ceil(open / sweep.path - 1e-3), 0.0);
    let of_sample = open / (max(parts, 1.0) * f32(sweep.samples));
    let samples = own_samples(node.x);
    var depth = 0.0;
    for (var part = 0u; part < u32(parts); part += 1u) {
        var sum = 0.0;
        for (var i = 0u; i < samples; i += 1u) {
            let reached = fma(f32(part * sweep.samples + i) + 0.5, of_sample, sweep.start);
            sum += extinction_at(fma(vec3f(reached), along, place));
        }
        depth += min(sum * of_sample, sweep.largest_rise);
    }
    return depth;
}

@compute @workgroup_size(GROUP_WIDTH, GROUP_HEIGHT)
fn main(@builtin(global_invocation_id) id: vec3u) {
    sweep = sweep_uniform;
    let at = vec2u(id.x, id.y + slice.first_row);
    if (all(at < sweep.nodes)) {
        var node = vec3u();
        node[sweep.axes.x] = slice.index;
        node[sweep.axes.y] = at.x;
        node[sweep.axes.z] = at.y;
        if (SKY) {
            let i = dot(node, sweep.strides);
            let light = exp(-passed(at));
            sky[i] = select(sky[i] + light, light, sweep.direction == 0u);
        } else {
            node.z += sweep.texels;
            var texel = textureLoad(light_grid, node);
            if (POINT_LIGHT) {
                texel[sweep.part] = nearest(depth_to_point(at));
            } else {
                texel[sweep.part] = nearest(passed(at));
            }
            textureStore(light_grid, node, texel);
        }
    }
    if (POINT_LIGHT) {
        return;
    }
    let column = at + slice.window.xy;
    if (all(column < slice.window.zw)) {
        let depth = depth_of(column);
        columns[slice.writes + column.x + sweep.columns.x * column.y] = depth + rise(column);
    }
}
