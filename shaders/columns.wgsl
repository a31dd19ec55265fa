// Depth of the columns of a light at the nodes of a slice. Part of `light_grid.wgsl`. Twin of `reference::shadows`.

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
