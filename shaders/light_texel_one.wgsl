// Texels of a light grid with one depth, which has the bits of a 16-bit float too. Part of `light_grid.wgsl`, `sky.wgsl` and
// `light_order.wgsl`.

@group(0) @binding(6) var light_grid: texture_storage_3d<r32float, write>;

fn store_depth(place: vec3u, part: u32, depth: f32) {
    textureStore(light_grid, place, vec4f(nearest(depth), 0.0, 0.0, 0.0));
}
