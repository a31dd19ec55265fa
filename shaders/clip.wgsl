// Clip planes: what lies beyond them is not there. The first ones end rays; the others cut each field by itself, or leave what any of them
// keeps. Part of `march.wgsl` and `light_grid.wgsl`. Twin of `reference::clip`.

// `tables::ClipTable`.
struct Clip {
    // Distance beyond each plane, in units of length: of a place in texture coordinates, by the first three numbers, and the fourth.
    planes: array<vec4f, CLIP_VECTORS>,
    // Unit vectors towards the side that goes, in the volume's axes, and a number whose bits are the fields that each cuts.
    outward: array<vec4f, CLIP_VECTORS>,
    // Scale and offset from the value of a texel to the gradient of a fall to the lowest value within two units of length.
    fall: vec4f,
}

@group(0) @binding(26) var<storage, read> clip_planes: Clip;

// In storage: Mesa's software device (22.3) crashes when it compiles a march with planes in a uniform (docs/theory/device.md). Copied as
// `march` is.
var<private> planes: Clip;

fn read_planes() {
    if (PLANES > 0u) {
        planes = clip_planes;
    }
}

// Beyond any box.
const FAR: f32 = 1e30;

// The part of a line from `range.x` to `range.y` that the planes leave at which rays end.
fn left_by_planes(base: vec3f, direction: vec3f, range: vec2f) -> vec2f {
    var left = range;
    for (var i = 0u; i < SHORTENING; i += 1u) {
        let plane = planes.planes[i];
        let beyond = dot(plane.xyz, base) + plane.w;
        let along = dot(plane.xyz, direction);
        // A line along the plane leaves it far away, or never enters.
        let is_parallel = abs(along) < 1e-30;
        let way = select(-beyond, 1.0, is_parallel && beyond <= 0.0);
        let at = way / select(along, 1e-30, is_parallel);
        left.x = select(left.x, max(left.x, at), along <= -1e-30);
        left.y = select(left.y, min(left.y, at), along > -1e-30);
    }
    return left;
}

// For each field, 1 if plane `i` cuts it, else 0.
fn cut_by(i: u32) -> vec4f {
    return vec4f((vec4u(u32(planes.outward[i].w)) >> vec4u(0u, 1u, 2u, 3u)) & vec4u(1u));
}

// For each field, the ends of the part of a line that its planes keep, or remove.
struct Own {
    low: vec4f,
    high: vec4f,
}

// The parts of a line that planes keep, or remove, of each field by itself.
fn own_of(base: vec3f, direction: vec3f) -> Own {
    var own = Own(vec4f(-FAR), vec4f(FAR));
    var cut = vec4f();
    for (var i = SHORTENING; i < PLANES; i += 1u) {
        let plane = planes.planes[i];
        let beyond = dot(plane.xyz, base) + plane.w;
        let along = dot(plane.xyz, direction);
        let is_parallel = abs(along) < 1e-30;
        let at = -beyond / select(along, 1e-30, is_parallel);
        let of_field = cut_by(i) > vec4f();
        cut += cut_by(i);
        let is_low = (along > 0.0) == KEEPS_ANY;
        let is_empty = (beyond > 0.0) != KEEPS_ANY;
        let low = select(select(-FAR, at, is_low), select(-FAR, FAR, is_empty), is_parallel);
        let high = select(select(at, FAR, is_low), select(FAR, -FAR, is_empty), is_parallel);
        own.low = select(own.low, max(own.low, vec4f(low)), of_field);
        own.high = select(own.high, min(own.high, vec4f(high)), of_field);
    }
    if (KEEPS_ANY) {
        // Of a field without planes, nothing is removed.
        own.high = select(vec4f(-FAR), own.high, cut > vec4f());
    }
    return own;
}

// The parts of a range that are left of each field.
fn parts_of(own: Own, range: vec2f) -> vec4f {
    let within = max(min(vec4f(range.y), own.high) - max(vec4f(range.x), own.low), vec4f()) / max(range.y - range.x, 1e-30);
    if (KEEPS_ANY) {
        return 1.0 - within;
    }
    return within;
}

// The part of each field that is left around a place, within half a unit of length of its own planes.
fn parts_at(place: vec3f) -> vec4f {
    var most = vec4f(select(-FAR, FAR, KEEPS_ANY));
    var cut = vec4f();
    for (var i = SHORTENING; i < PLANES; i += 1u) {
        let plane = planes.planes[i];
        let beyond = vec4f(dot(plane.xyz, place) + plane.w);
        let of_field = cut_by(i) > vec4f();
        cut += cut_by(i);
        if (KEEPS_ANY) {
            most = select(most, min(most, beyond), of_field);
        } else {
            most = select(most, max(most, beyond), of_field);
        }
    }
    return select(vec4f(1.0), clamp(0.5 - most, vec4f(), vec4f(1.0)), cut > vec4f());
}

// A gradient of the first field as shading sees it where the texel has this value: near a plane, as though the lowest value lay beyond it.
fn capped(gradient: vec3f, value: f32, place: vec3f) -> vec3f {
    if (CAPS) {
        return capped_by(0u, gradient, fma(value, planes.fall.x, planes.fall.y), place);
    }
    return gradient;
}

// The same of a field with the gradient of a `fall` to the lowest value within two units of length.
fn capped_by(field: u32, gradient: vec3f, fall: f32, place: vec3f) -> vec3f {
    if (CAPS && BY_FIELD) {
        return capped_by_own(field, gradient, fall, place);
    }
    var seen = gradient;
    if (CAPS) {
        for (var i = 0u; i < PLANES; i += 1u) {
            let plane = planes.planes[i];
            let near = clamp(dot(plane.xyz, place) + plane.w + 1.5, 0.0, 1.0);
            seen = fma(vec3f(-(near * fall)), planes.outward[i].xyz, seen);
        }
    }
    return seen;
}

// The same where planes cut each field by itself.
fn capped_by_own(field: u32, gradient: vec3f, fall: f32, place: vec3f) -> vec3f {
    var seen = gradient;
    // The face of what is removed that is next.
    var nearest = FAR;
    var outward = vec3f();
    for (var i = 0u; i < PLANES; i += 1u) {
        let plane = planes.planes[i];
        let beyond = dot(plane.xyz, place) + plane.w;
        let is_cut = ((u32(planes.outward[i].w) >> field) & 1u) != 0u;
        if (KEEPS_ANY) {
            let is_next = is_cut && beyond < nearest;
            nearest = select(nearest, beyond, is_next);
            outward = select(outward, planes.outward[i].xyz, is_next);
        } else {
            let near = select(0.0, clamp(beyond + 1.5, 0.0, 1.0), is_cut);
            seen = fma(vec3f(-(near * fall)), planes.outward[i].xyz, seen);
        }
    }
    if (KEEPS_ANY) {
        seen = fma(vec3f(-(clamp(nearest + 1.5, 0.0, 1.0) * fall)), outward, seen);
    }
    return seen;
}
