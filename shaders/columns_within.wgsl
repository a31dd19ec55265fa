// Depth of a column that a node sees, up to a distance, the reach of a sky: the depth that it had farther back is
// subtracted. In place of `columns.wgsl`. Twin of `reference::shadows`.

// `tables::Within`, as `Reach` of `render::march::light_grid` writes it.
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

fn depth_seen(column: vec2u) -> f32 {
    let nearer = depth_ago(column, reach.slices);
    let beyond = fma(reach.rest, depth_ago(column, reach.slices + 1u) - nearer, nearer);
    return max(depth_of(column) - beyond, 0.0);
}
