// Values and labels of a volume that the device holds whole. Part of `march.wgsl` and `light_grid.wgsl`, which declare
// `volume`, `volume_sampler` and `labels`. `bricks.wgsl` has the same for a volume in bricks.

fn volume_dims() -> vec3f {
    return vec3f(textureDimensions(volume));
}

// Texel of a voxel; voxels outside the grid are clamped to its faces.
fn texel_at(voxel: vec3f) -> vec4f {
    let last = vec3f(textureDimensions(volume)) - 1.0;
    return textureLoad(volume, vec3i(clamp(voxel, vec3f(), last)), 0);
}

// The texel at a place, by the filter of the device, or without one for texels that it does not filter.
fn filtered(place: vec3f) -> vec4f {
    if (FETCHED) {
        return linear_between(fma(place, volume_dims(), vec3f(-0.5)));
    }
    return textureSampleLevel(volume, volume_sampler, place, 0.0);
}

fn fetch(place: vec3f) -> vec4f {
    var texel: vec4f;
    if (EXACT_LINEAR) {
        texel = linear_between(fma(place, volume_dims(), vec3f(-0.5)));
    } else if (CUBIC) {
        texel = cubic_between(fma(place, volume_dims(), vec3f(-0.5)));
    } else if (NEAREST) {
        // A sampler may round the place to eight bits of a voxel first.
        texel = texel_at(floor(place * volume_dims()));
    } else if (CUBIC_ALONG) {
        texel = cubic_along(place);
    } else {
        texel = filtered(place);
    }
    return texel;
}

fn label_texel(voxel: vec3f) -> u32 {
    let last = vec3f(textureDimensions(labels)) - 1.0;
    return textureLoad(labels, vec3i(clamp(voxel, vec3f(), last)), 0).x;
}
