// Fills a slice of the light grid for one directional light, or sums the light of one direction of the sky: nodes read the
// optical depth of the columns that pass them, and the columns go on to the next slice. For a point light, a ray goes from
// each node to the light. Twin of `reference::shadows`.

// Depth of the columns at a node, linear between four of them.
fn passed(node: vec2u) -> f32 {
    // Rounding may place the first column before 0.
    let column = max(fma(vec2f(f32(slice.number)), sweep.shear, vec2f(node) - sweep.first), vec2f());
    let base = floor(column);
    let fraction = column - base;
    let at = vec2u(base);
    let near_left = depth_seen(at);
    let near = fma(fraction.x, depth_seen(at + vec2u(1u, 0u)) - near_left, near_left);
    let far_left = depth_seen(at + vec2u(0u, 1u));
    let far = fma(fraction.x, depth_seen(at + vec2u(1u, 1u)) - far_left, far_left);
    return fma(fraction.y, far - near, near);
}

// Depth of the four columns `x` of a row, by these weights.
fn depth_of_row(x: vec4u, row: i32, weights: vec4f) -> f32 {
    let start = slice.reads + sweep.columns.x * u32(clamp(row, 0, i32(sweep.columns.y) - 1));
    return weighted(weights, vec4f(columns[start + x.x], columns[start + x.y], columns[start + x.z], columns[start + x.w]));
}

// Depth of the columns at a node, cubic between sixteen of them. `columns` are 0 where none has entered.
fn passed_cubic(node: vec2u) -> f32 {
    // Rounding may place the first column before 0.
    let column = max(fma(vec2f(f32(slice.number)), sweep.shear, vec2f(node) - sweep.first), vec2f());
    let base = floor(column);
    let x_weights = depth_weights(column.x - base.x, SECOND_DIFFERENCE);
    let y_weights = depth_weights(column.y - base.y, SECOND_DIFFERENCE);
    let first = vec2i(base) - 1;
    let x = vec4u(clamp(vec4i(first.x) + vec4i(0, 1, 2, 3), vec4i(), vec4i(i32(sweep.columns.x) - 1)));
    let outer = y_weights.x * depth_of_row(x, first.y, x_weights) + y_weights.w * depth_of_row(x, first.y + 3, x_weights);
    let last = fma(y_weights.z, depth_of_row(x, first.y + 2, x_weights), outer);
    return max(fma(y_weights.y, depth_of_row(x, first.y + 1, x_weights), last), 0.0);
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
    var left = vec2f(-FAR, FAR);
    if (PLANES > 0u) {
        left = left_by_planes(start, sweep.per_slice, left);
    }
    var sum = 0.0;
    let samples = own_samples(column.x);
    for (var i = 0u; i < samples; i += 1u) {
        let slices = fma(f32(i) + 0.5, sweep.step, first);
        let place = fma(vec3f(slices), sweep.per_slice, start);
        let inside = all(sweep.low <= place) && all(place <= sweep.high);
        var extinction = select(0.0, extinction_at(place), inside);
        if (PLANES > 0u) {
            // Of a sample that a plane cuts, the part that is left.
            let half = 0.5 * sweep.step;
            let part = (min(slices + half, left.y) - max(slices - half, left.x)) / sweep.step;
            extinction *= clamp(part, 0.0, 1.0);
        }
        sum += extinction;
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
    var way_left = vec2f(sweep.start, min(min(distance, to_face.x), min(to_face.y, to_face.z)));
    if (PLANES > 0u) {
        way_left = left_by_planes(place, along, way_left);
    }
    let open = max(way_left.y - way_left.x, 0.0);
    // Rounding does not add a part.
    let parts = max(ceil(open / sweep.path - 1e-3), 0.0);
    let of_sample = open / (max(parts, 1.0) * f32(sweep.samples));
    let samples = own_samples(node.x);
    var depth = 0.0;
    for (var part = 0u; part < u32(parts); part += 1u) {
        var sum = 0.0;
        for (var i = 0u; i < samples; i += 1u) {
            let reached = fma(f32(part * sweep.samples + i) + 0.5, of_sample, way_left.x);
            sum += extinction_at(fma(vec3f(reached), along, place));
        }
        depth += min(sum * of_sample, sweep.largest_rise);
    }
    return depth;
}

@compute @workgroup_size(GROUP_WIDTH, GROUP_HEIGHT)
fn main(@builtin(global_invocation_id) id: vec3u) {
    sweep = sweep_uniform;
    read_planes();
    read_fields();
    let at = vec2u(id.x, id.y + slice.first_row);
    if (all(at < sweep.nodes)) {
        var node = vec3u();
        node[sweep.axes.x] = slice.index;
        node[sweep.axes.y] = at.x;
        node[sweep.axes.z] = at.y;
        if (SKY) {
            let i = dot(node, sweep.strides);
            let light = exp(-passed(at));
            let sum = select(sky[i] + light, light, sweep.direction == 0u);
            let depth = clamp(-log(sum / f32(sweep.directions)), 0.0, LARGEST_SKY_DEPTH);
            sky[i] = select(sum, depth, sweep.direction + 1u == sweep.directions);
        } else {
            node.z += sweep.texels;
            if (POINT_LIGHT) {
                store_depth(node, sweep.part, depth_to_point(at));
            } else {
                store_depth(node, sweep.part, passed_cubic(at));
            }
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
