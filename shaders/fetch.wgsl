// Values and labels between voxels. Part of `march.wgsl` and `light_grid.wgsl`; the voxels are in `whole.wgsl` or
// `bricks.wgsl`.

// The value in a texel.
fn value_of(texel: vec4f) -> f32 {
    var value = texel.x;
    if (STORED_GRADIENT) {
        value = texel.w;
    }
    return value;
}

// Linear interpolation along x, then y, then z, in f32, because a device's filter may have only eight bits.
fn linear_line(base: vec3f, x: f32) -> vec4f {
    let before = texel_at(base);
    return fma(vec4f(x), texel_at(base + vec3f(1.0, 0.0, 0.0)) - before, before);
}

fn linear_plane(base: vec3f, x: f32, y: f32) -> vec4f {
    let before = linear_line(base, x);
    return fma(vec4f(y), linear_line(base + vec3f(0.0, 1.0, 0.0), x) - before, before);
}

fn linear_between(voxel: vec3f) -> vec4f {
    let base = floor(voxel);
    let fraction = voxel - base;
    let before = linear_plane(base, fraction.x, fraction.y);
    let after = linear_plane(base + vec3f(0.0, 0.0, 1.0), fraction.x, fraction.y);
    return fma(vec4f(fraction.z), after - before, before);
}

// Weights of four neighbouring voxels in a cubic B-spline. Without loops, like `power`.
fn cubic_weights(f: f32) -> vec4f {
    let rest = 1.0 - f;
    let first = rest * rest * rest / 6.0;
    let last = f * f * f / 6.0;
    let second = (fma(3.0 * f - 6.0, f * f, 4.0)) / 6.0;
    return vec4f(first, second, 1.0 - first - second - last, last);
}

fn cubic_line(base: vec3f, x: vec4f) -> vec4f {
    let step = vec3f(1.0, 0.0, 0.0);
    return x.x * texel_at(base - step) + x.y * texel_at(base) + x.z * texel_at(base + step)
        + x.w * texel_at(base + 2.0 * step);
}

fn cubic_plane(base: vec3f, x: vec4f, y: vec4f) -> vec4f {
    let step = vec3f(0.0, 1.0, 0.0);
    return y.x * cubic_line(base - step, x) + y.y * cubic_line(base, x) + y.z * cubic_line(base + step, x)
        + y.w * cubic_line(base + 2.0 * step, x);
}

fn cubic_between(voxel: vec3f) -> vec4f {
    let base = floor(voxel);
    let fraction = voxel - base;
    let x = cubic_weights(fraction.x);
    let y = cubic_weights(fraction.y);
    let z = cubic_weights(fraction.z);
    let step = vec3f(0.0, 0.0, 1.0);
    return z.x * cubic_plane(base - step, x, y) + z.y * cubic_plane(base, x, y) + z.z * cubic_plane(base + step, x, y)
        + z.w * cubic_plane(base + 2.0 * step, x, y);
}

// A cubic B-spline along one axis, linear along the others, by two fetches: the filter mixes each pair of slices by their weights.
fn cubic_along(place: vec3f) -> vec4f {
    let slices = volume_dims()[CUBIC_AXIS];
    let slice = fma(place[CUBIC_AXIS], slices, -0.5);
    let base = floor(slice);
    let weights = cubic_weights(slice - base);
    let before = weights.x + weights.y;
    let after = weights.z + weights.w;
    var first = place;
    var second = place;
    first[CUBIC_AXIS] = (base - 0.5 + weights.y / before) / slices;
    second[CUBIC_AXIS] = (base + 1.5 + weights.w / after) / slices;
    return fma(vec4f(before), filtered(first), after * filtered(second));
}

// Differences between the next and the previous voxel along each axis.
fn central_difference(place: vec3f) -> vec3f {
    let voxel = 1.0 / volume_dims();
    let x = vec3f(voxel.x, 0.0, 0.0);
    let y = vec3f(0.0, voxel.y, 0.0);
    let z = vec3f(0.0, 0.0, voxel.z);
    return vec3f(
        fetch(place + x).x - fetch(place - x).x,
        fetch(place + y).x - fetch(place - y).x,
        fetch(place + z).x - fetch(place - z).x,
    );
}

// Label at `place`: its row in the label table, 0 without one. If labels are smooth: twice the row, plus 1 where the labels
// of the eight voxels around differ.
fn label_at(place: vec3f) -> u32 {
    if (SMOOTH_LABELS) {
        return label_texel(floor(fma(place, volume_dims(), vec3f(-0.5))));
    }
    return label_texel(floor(place * volume_dims()));
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

// A voxel's row in the label table, and its share.
struct LabelShare {
    row: u32,
    share: f32,
}

// Voxel number `i` of those that have a share in the labels at `place`, where the label is `label`.
fn share_of(place: vec3f, label: u32, i: u32) -> LabelShare {
    let voxel = fma(place, volume_dims(), vec3f(-0.5));
    let base = floor(voxel);
    let fraction = voxel - base;
    let side = vec3f(vec3u(i, i >> 1u, i >> 2u) & vec3u(1u));
    let weights = select(1.0 - fraction, fraction, side > vec3f());
    let mixed = is_mixed(label);
    let row = select(row_of(label), row_of(label_texel(base + side)), mixed);
    return LabelShare(row, select(1.0, weights.x * weights.y * weights.z, mixed));
}
