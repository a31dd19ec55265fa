// Values and labels of a volume whose bricks lie in the slots of a pool, for a device that cannot hold it whole. Part of
// `march.wgsl`; `whole.wgsl` has the same for a whole volume. Places, weights and texels are those of a whole volume, and so
// are the values to the bit, except where the filter of the device rounds another texture coordinate.

struct Bricks {
    // Voxels of the volume.
    dims: vec3f,
    // Bricks along each axis.
    counts: vec3u,
    // One texel of the pool, in its texture coordinates.
    texel: vec3f,
}

@group(0) @binding(19) var<uniform> bricks_uniform: Bricks;

var<private> bricks: Bricks;
// From a voxel of the volume to the texel of the pool that holds it, in the brick of the present run.
var<private> brick_shift: vec3f;

fn volume_dims() -> vec3f {
    return bricks.dims;
}

fn texel_at(voxel: vec3f) -> vec4f {
    return textureLoad(volume, vec3i(clamp(voxel, vec3f(), bricks.dims - 1.0) + brick_shift), 0);
}

// The texel at a place, by the filter of the device.
fn filtered(place: vec3f) -> vec4f {
    return textureSampleLevel(volume, volume_sampler, fma(place, bricks.dims, brick_shift) * bricks.texel, 0.0);
}

fn fetch(place: vec3f) -> vec4f {
    var texel: vec4f;
    if (EXACT_LINEAR) {
        texel = linear_between(fma(place, volume_dims(), vec3f(-0.5)));
    } else if (CUBIC) {
        texel = cubic_between(fma(place, volume_dims(), vec3f(-0.5)));
    } else if (NEAREST) {
        texel = texel_at(floor(place * volume_dims()));
    } else if (CUBIC_ALONG) {
        texel = cubic_along(place);
    } else {
        texel = filtered(place);
    }
    return texel;
}

fn label_texel(voxel: vec3f) -> u32 {
    return textureLoad(labels, vec3i(clamp(voxel, vec3f(), bricks.dims - 1.0) + brick_shift), 0).x;
}
