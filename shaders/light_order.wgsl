// Copies depths of a light grid to another one with the same nodes, where lights have other numbers.

// A texel of four lights in the new grid.
struct Order {
    // Number of each of its lights in the old grid; NONE leaves 0.
    from_numbers: vec4u,
    // Nodes along each axis.
    nodes: vec3u,
    texel: u32,
}

const NONE: u32 = 0xffffffffu;

@group(0) @binding(0) var depths: texture_3d<f32>;
var<immediate> order: Order;

fn depth_of(node: vec3u, number: u32) -> f32 {
    if (number == NONE) {
        return 0.0;
    }
    return textureLoad(depths, node + vec3u(0u, 0u, number / 4u * order.nodes.z), 0)[number % 4u];
}

@compute @workgroup_size(GROUP_WIDTH, GROUP_HEIGHT)
fn main(@builtin(global_invocation_id) node: vec3u) {
    if (any(node >= order.nodes)) {
        return;
    }
    let to = node + vec3u(0u, 0u, order.texel * order.nodes.z);
    let numbers = order.from_numbers;
    let copied = vec4f(
        depth_of(node, numbers.x),
        depth_of(node, numbers.y),
        depth_of(node, numbers.z),
        depth_of(node, numbers.w),
    );
    textureStore(light_grid, to, copied);
}
