// Sets the depths of ambient light in the light grid, from the light of a sky that was summed on a coarser grid over the
// same box. Twin of `reference::shadows`.

struct ToDepths {
    // Nodes of the light grid, and the first slice along z of the texels of ambient light.
    nodes: vec3u,
    texels: u32,
    // Nodes of the coarser grid, and the number of ambient light in its texel.
    summed: vec3u,
    part: u32,
    directions: f32,
    largest_depth: f32,
}

@group(0) @binding(0) var<storage, read> sky: array<f32>;
@group(0) @binding(1) var light_grid: texture_storage_3d<rgba16float, read_write>;
var<immediate> to_depths: ToDepths;

// Depth that stands for the mean light at a node of the coarser grid.
fn depth_of(node: vec3u) -> f32 {
    let sum = sky[node.x + to_depths.summed.x * (node.y + to_depths.summed.y * node.z)];
    return clamp(-log(sum / to_depths.directions), 0.0, to_depths.largest_depth);
}

fn line(base: vec3u, x: f32) -> f32 {
    let before = depth_of(base);
    return fma(x, depth_of(base + vec3u(1u, 0u, 0u)) - before, before);
}

fn plane(base: vec3u, x: f32, y: f32) -> f32 {
    let before = line(base, x);
    return fma(y, line(base + vec3u(0u, 1u, 0u), x) - before, before);
}

@compute @workgroup_size(GROUP_WIDTH, GROUP_HEIGHT)
fn main(@builtin(global_invocation_id) node: vec3u) {
    if (any(node >= to_depths.nodes)) {
        return;
    }
    let last = vec3f(to_depths.summed - 1u);
    let at = min(vec3f(node) * last / vec3f(to_depths.nodes - 1u), last);
    let base = min(floor(at), last - 1.0);
    let fraction = at - base;
    let first = vec3u(base);
    let before = plane(first, fraction.x, fraction.y);
    let after = plane(first + vec3u(0u, 0u, 1u), fraction.x, fraction.y);
    let place = node + vec3u(0u, 0u, to_depths.texels);
    var texel = textureLoad(light_grid, place);
    texel[to_depths.part] = nearest(fma(fraction.z, after - before, before));
    textureStore(light_grid, place, texel);
}
