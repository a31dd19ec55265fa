// Depth of the columns at the nodes of a slice up to a distance, the reach of a sky: the depth that they had farther back is
// subtracted. In place of `columns.wgsl`. Twin of `reference::shadows`.

// `tables::Within`.
struct Reach {
    // Whole slices, and the part of one more.
    slices: u32,
    rest: f32,
    // Slices whose depths are in `columns`.
    kept: u32,
}

@group(0) @binding(8) var<uniform> reach: Reach;

// Depth of a column so many slices ago; 0 before the first slice.
fn depth_ago(column: vec2u, slices: u32) -> f32 {
    if (slices > slice.number) {
        return 0.0;
    }
    let on = min(column, sweep.columns - 1u);
    let plane = (slice.number - slices) % reach.kept;
    return columns[on.x + sweep.columns.x * (on.y + sweep.columns.y * plane)];
}

fn depth_within(column: vec2u) -> f32 {
    let nearer = depth_ago(column, reach.slices);
    let beyond = fma(reach.rest, depth_ago(column, reach.slices + 1u) - nearer, nearer);
    return max(depth_of(column) - beyond, 0.0);
}

// Depth of the columns at a node, linear between four of them.
fn passed(node: vec2u) -> f32 {
    // Rounding may place the first column before 0.
    let column = max(fma(vec2f(f32(slice.number)), sweep.shear, vec2f(node) - sweep.first), vec2f());
    let base = floor(column);
    let fraction = column - base;
    let at = vec2u(base);
    let near_left = depth_within(at);
    let near = fma(fraction.x, depth_within(at + vec2u(1u, 0u)) - near_left, near_left);
    let far_left = depth_within(at + vec2u(0u, 1u));
    let far = fma(fraction.x, depth_within(at + vec2u(1u, 1u)) - far_left, far_left);
    return fma(fraction.y, far - near, near);
}
