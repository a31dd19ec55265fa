// Clip planes: what lies beyond any of them is not there. Part of `march.wgsl` and `light_grid.wgsl`. Twin of `reference::clip`.

// `tables::ClipTable`.
struct Clip {
    // Distance beyond each plane, in units of length: of a place in texture coordinates, by the first three numbers, and the fourth.
    planes: array<vec4f, CLIP_VECTORS>,
    // Unit vectors towards the side that goes, in the volume's axes.
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

// The part of a line from `range.x` to `range.y` that all planes leave.
fn left_by_planes(base: vec3f, direction: vec3f, range: vec2f) -> vec2f {
    var left = range;
    for (var i = 0u; i < PLANES; i += 1u) {
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

// A gradient as shading sees it where the texel has this value: near a plane, as though the lowest value lay beyond it.
fn capped(gradient: vec3f, value: f32, place: vec3f) -> vec3f {
    if (CAPS) {
        return capped_by(gradient, fma(value, planes.fall.x, planes.fall.y), place);
    }
    return gradient;
}

// The same with the gradient of a `fall` to the lowest value within two units of length.
fn capped_by(gradient: vec3f, fall: f32, place: vec3f) -> vec3f {
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
