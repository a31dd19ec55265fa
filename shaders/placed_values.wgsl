// Texels of fields on grids of their own that hold values alone. Part of `placed.wgsl`.

alias PlacedTexel = f32;

fn placed_numbers(texel: vec4f) -> PlacedTexel {
    return texel.x;
}

fn placed_value_of(texel: PlacedTexel) -> f32 {
    return texel;
}

fn keep_placed(field: u32, texel: PlacedTexel) {
}

// Differences of a field between the next and the previous voxel along each of its axes.
fn placed_differences(field: u32, index: vec3f) -> vec3f {
    return vec3f(
        placed_between(field, index + vec3f(1.0, 0.0, 0.0)) - placed_between(field, index - vec3f(1.0, 0.0, 0.0)),
        placed_between(field, index + vec3f(0.0, 1.0, 0.0)) - placed_between(field, index - vec3f(0.0, 1.0, 0.0)),
        placed_between(field, index + vec3f(0.0, 0.0, 1.0)) - placed_between(field, index - vec3f(0.0, 0.0, 1.0)),
    );
}
