// Sets the depths of ambient light in the light grid, from those at the nodes of a coarser grid over the same box. Twin of
// `reference::shadows`.

struct ToDepths {
    // Nodes of the light grid, and the first slice along z of the texels of ambient light.
    nodes: vec3u,
    texels: u32,
    // Nodes of the coarser grid, and the number of ambient light in its texel.
    summed: vec3u,
    part: u32,
}

@group(0) @binding(0) var<storage, read> sky: array<f32>;
var<immediate> to_depths: ToDepths;

// The four coarser nodes around a place behind node `base` of `last + 1`.
fn around(base: f32, last: f32) -> vec4u {
    return vec4u(clamp(base + vec4f(-1.0, 0.0, 1.0, 2.0), vec4f(), vec4f(last)));
}

fn line(x: vec4u, weights: vec4f, y: u32, z: u32) -> f32 {
    let start = to_depths.summed.x * (y + to_depths.summed.y * z);
    return weighted(weights, vec4f(sky[start + x.x], sky[start + x.y], sky[start + x.z], sky[start + x.w]));
}

@compute @workgroup_size(GROUP_WIDTH, GROUP_HEIGHT)
fn main(@builtin(global_invocation_id) node: vec3u) {
    if (any(node >= to_depths.nodes)) {
        return;
    }
    let last = vec3f(to_depths.summed - 1u);
    let part = last / vec3f(to_depths.nodes - 1u);
    let at = min(vec3f(node) * part, last);
    let base = min(floor(at), last - 1.0);
    let fraction = at - base;
    let second = SECOND_DIFFERENCE * part * part;
    let x = around(base.x, last.x);
    let y = around(base.y, last.y);
    let z = around(base.z, last.z);
    let x_weights = depth_weights(fraction.x, second.x);
    let y_weights = depth_weights(fraction.y, second.y);
    var planes = vec4f();
    for (var k = 0u; k < 4u; k += 1u) {
        let along_y = vec4f(
            line(x, x_weights, y.x, z[k]),
            line(x, x_weights, y.y, z[k]),
            line(x, x_weights, y.z, z[k]),
            line(x, x_weights, y.w, z[k]),
        );
        planes[k] = weighted(y_weights, along_y);
    }
    let depth = weighted(depth_weights(fraction.z, second.z), planes);
    store_depth(node + vec3u(0u, 0u, to_depths.texels), to_depths.part, max(depth, 0.0));
}
