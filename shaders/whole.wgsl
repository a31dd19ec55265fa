// Values and labels of a volume that the device holds whole. Part of `march.wgsl` and `light_grid.wgsl`, which declare
// `volume`, `volume_sampler` and `labels`. `bricks.wgsl` has the same for a volume in bricks.

// Texel of a voxel; voxels outside the grid are clamped to its faces.
fn texel_at(voxel: vec3f) -> vec4f {
    let last = vec3f(textureDimensions(volume)) - 1.0;
    return textureLoad(volume, vec3i(clamp(voxel, vec3f(), last)), 0);
}

fn fetch(place: vec3f) -> vec4f {
    var texel: vec4f;
    if (EXACT_LINEAR) {
        texel = linear_between(fma(place, vec3f(textureDimensions(volume)), vec3f(-0.5)));
    } else if (CUBIC) {
        texel = cubic_between(fma(place, vec3f(textureDimensions(volume)), vec3f(-0.5)));
    } else {
        texel = textureSampleLevel(volume, volume_sampler, place, 0.0);
    }
    return texel;
}

// Differences between the next and the previous voxel along each axis.
fn central_difference(place: vec3f) -> vec3f {
    let voxel = 1.0 / vec3f(textureDimensions(volume));
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
    let last = vec3f(textureDimensions(labels)) - 1.0;
    return textureLoad(labels, vec3i(clamp(voxel, vec3f(), last)), 0).x;
}

// Label at `place`: its row in the label table, 0 without one. If labels are smooth: twice the row, plus 1 where the labels
// of the eight voxels around differ.
fn label_at(place: vec3f) -> u32 {
    let dims = vec3f(textureDimensions(labels));
    if (SMOOTH_LABELS) {
        return label_texel(floor(fma(place, dims, vec3f(-0.5))));
    }
    return label_texel(floor(place * dims));
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
    let voxel = fma(place, vec3f(textureDimensions(labels)), vec3f(-0.5));
    let base = floor(voxel);
    let fraction = voxel - base;
    let side = vec3f(vec3u(i, i >> 1u, i >> 2u) & vec3u(1u));
    let weights = select(1.0 - fraction, fraction, side > vec3f());
    let mixed = is_mixed(label);
    let row = select(row_of(label), row_of(label_texel(base + side)), mixed);
    return Share(row, select(1.0, weights.x * weights.y * weights.z, mixed));
}
