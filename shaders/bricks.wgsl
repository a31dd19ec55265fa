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

fn texel_at(voxel: vec3f) -> vec4f {
    return textureLoad(volume, vec3i(clamp(voxel, vec3f(), bricks.dims - 1.0) + brick_shift), 0);
}

fn fetch(place: vec3f) -> vec4f {
    var texel: vec4f;
    if (EXACT_LINEAR) {
        texel = linear_between(fma(place, bricks.dims, vec3f(-0.5)));
    } else if (CUBIC) {
        texel = cubic_between(fma(place, bricks.dims, vec3f(-0.5)));
    } else if (NEAREST) {
        texel = texel_at(floor(place * bricks.dims));
    } else {
        texel = textureSampleLevel(volume, volume_sampler, fma(place, bricks.dims, brick_shift) * bricks.texel, 0.0);
    }
    return texel;
}

fn central_difference(place: vec3f) -> vec3f {
    let voxel = 1.0 / bricks.dims;
    let x = vec3f(voxel.x, 0.0, 0.0);
    let y = vec3f(0.0, voxel.y, 0.0);
    let z = vec3f(0.0, 0.0, voxel.z);
    return vec3f(
        fetch(place + x).x - fetch(place - x).x,
        fetch(place + y).x - fetch(place - y).x,
        fetch(place + z).x - fetch(place - z).x,
    );
}

fn label_texel(voxel: vec3f) -> u32 {
    return textureLoad(labels, vec3i(clamp(voxel, vec3f(), bricks.dims - 1.0) + brick_shift), 0).x;
}

fn label_at(place: vec3f) -> u32 {
    if (SMOOTH_LABELS) {
        return label_texel(floor(fma(place, bricks.dims, vec3f(-0.5))));
    }
    return label_texel(floor(place * bricks.dims));
}

fn row_of(label: u32) -> u32 {
    if (SMOOTH_LABELS) {
        return label >> 1u;
    }
    return label;
}

// Whether several rows have a share.
fn is_mixed(label: u32) -> bool {
    return SMOOTH_LABELS && (label & 1u) == 1u;
}

// Number of voxels that have a share in the labels at a place with this `label`.
fn sharing(label: u32) -> u32 {
    return select(1u, 8u, is_mixed(label));
}

// A voxel's row in the label table, and its share.
struct Share {
    row: u32,
    share: f32,
}

// Voxel number `i` of those that have a share in the labels at `place`, where the label is `label`.
fn share_of(place: vec3f, label: u32, i: u32) -> Share {
    let voxel = fma(place, bricks.dims, vec3f(-0.5));
    let base = floor(voxel);
    let fraction = voxel - base;
    let side = vec3f(vec3u(i, i >> 1u, i >> 2u) & vec3u(1u));
    let weights = select(1.0 - fraction, fraction, side > vec3f());
    let mixed = is_mixed(label);
    let row = select(row_of(label), row_of(label_texel(base + side)), mixed);
    return Share(row, select(1.0, weights.x * weights.y * weights.z, mixed));
}
