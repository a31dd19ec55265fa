// Texels of a light grid with four depths. Part of `light_grid.wgsl`, `sky.wgsl` and `light_order.wgsl`.

@group(0) @binding(6) var light_grid: texture_storage_3d<rgba16float, read_write>;

fn store_depth(place: vec3u, part: u32, depth: f32) {
    var texel = textureLoad(light_grid, place);
    texel[part] = nearest(depth);
    textureStore(light_grid, place, texel);
}
