// Texels of fields on grids of their own that hold differences and values. Part of `placed.wgsl`.

alias PlacedTexel = vec4f;

// Differences at the last place that was read.
var<private> placed_kept: array<vec3f, PLACED_VECTORS>;

fn placed_numbers(texel: vec4f) -> PlacedTexel {
    return texel;
}

fn placed_value_of(texel: PlacedTexel) -> f32 {
    return texel.w;
}

fn keep_placed(field: u32, texel: PlacedTexel) {
    placed_kept[field] = texel.xyz;
}

// Differences of a field at the last place that was read.
fn placed_differences(field: u32, index: vec3f) -> vec3f {
    return placed_kept[field];
}
