// Depth of a column that a node sees: all of it. Part of `light_grid.wgsl`.

fn depth_seen(column: vec2u) -> f32 {
    return depth_of(column);
}
