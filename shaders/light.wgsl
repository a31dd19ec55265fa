// Light of a step towards the eye. Part of `march.wgsl`, with `share_grey.wgsl` or `share_coloured.wgsl`. `render::march::light`
// writes the lines that call these functions, for each way by which light arrives: `add_light`. Twin of `reference::light`, and
// of the reading of a grid in `reference::shadows`.

// Place of the light grid.
struct LightPlace {
    // Scale and offset from texture coordinates of the volume to those of the grid of the first four directions.
    scale: vec3f,
    offset: vec3f,
    // Nodes along each axis.
    nodes: vec3f,
    // Distance from the grid of four directions to that of the next four, along z.
    behind: f32,
}

@group(0) @binding(14) var<uniform> light_uniform: LightPlace;
// Optical depths towards four lights a texel; of more lights, one grid behind the other along z. That of ambient light
// stands for the mean over the sky.
@group(0) @binding(15) var light_grid: texture_3d<f32>;
@group(0) @binding(16) var light_sampler: sampler;

// Copy of the uniform, as for `march`.
var<private> light_place: LightPlace;

fn light_line(base: vec3i, x: f32) -> vec4f {
    let before = textureLoad(light_grid, base, 0);
    return fma(vec4f(x), textureLoad(light_grid, base + vec3i(1, 0, 0), 0) - before, before);
}

fn light_plane(base: vec3i, x: f32, y: f32) -> vec4f {
    let before = light_line(base, x);
    return fma(vec4f(y), light_line(base + vec3i(0, 1, 0), x) - before, before);
}

// Four depths at `place`, in texture coordinates of the grid, number 4·`texel` on.
fn depths_from(place: vec3f, texel: u32) -> vec4f {
    var depths: vec4f;
    if (EXACT_LINEAR) {
        let all = vec3f(textureDimensions(light_grid));
        let node = clamp(fma(place, all, vec3f(-0.5)), vec3f(), light_place.nodes - 1.0);
        let base = min(floor(node), light_place.nodes - 2.0);
        let fraction = node - base;
        let first = vec3i(base) + vec3i(0, 0, i32(texel * u32(light_place.nodes.z)));
        let before = light_plane(first, fraction.x, fraction.y);
        let after = light_plane(first + vec3i(0, 0, 1), fraction.x, fraction.y);
        depths = fma(vec4f(fraction.z), after - before, before);
    } else if (GRID_DEPTHS > 4u) {
        // Half a texel from the next grid.
        let edge = 0.5 * light_place.behind / light_place.nodes.z;
        let z = clamp(place.z, edge, light_place.behind - edge);
        let behind = fma(f32(texel), light_place.behind, z);
        depths = textureSampleLevel(light_grid, light_sampler, vec3f(place.xy, behind), 0.0);
    } else {
        depths = textureSampleLevel(light_grid, light_sampler, place, 0.0);
    }
    return depths;
}

// Direction towards a place, in units of length.
fn towards(point: vec3f, place: vec3f) -> vec3f {
    return unit(point - place * march.local_scale);
}

// |n·l|, or max(n·l, 0) with one-sided lighting, of a part ∇v·l/|∇v|.
fn lit(part: f32) -> f32 {
    if (!GRADIENT) {
        return 0.0;
    }
    var facing = abs(part);
    if (ONE_SIDED) {
        facing = max(-part, 0.0);
    }
    return facing;
}

// Light from everywhere, of which this share arrives, and all light without shading.
fn unshaded_part(step: Step, share: Share) -> array<vec4f, LANES> {
    var source = unshaded(step);
    for (var lane = 0u; lane < LANES; lane += 1u) {
        source[lane] *= share_in(share, lane);
    }
    return source;
}

// Adds the highlights of light from the direction `light`.
fn add_highlights(light: vec3f, ray: Ray, step: Step, share: Share, source: ptr<function, array<vec4f, LANES>>) {
    var shine = lit(dot(step.normal, unit(light + ray.view)));
    if (ONE_SIDED) {
        shine = select(0.0, shine, dot(step.normal, light) < 0.0);
    }
    highlight(step, shine, share, source);
}
