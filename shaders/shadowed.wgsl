// Light of positions with shadows. Part of `march.wgsl`; only plans with shadows call it, and their transmittance is
// grey. Twin of `reference::shadows`.

// Place of the light grid.
struct LightPlace {
    // Scale and offset from texture coordinates of the volume to those of the grid of the first four lights.
    scale: vec3f,
    offset: vec3f,
    // Nodes along each axis.
    nodes: vec3f,
    // Distance from the grid of four lights to that of the next four, along z.
    behind: f32,
}

@group(0) @binding(14) var<uniform> light_uniform: LightPlace;
// Optical depths towards four directional lights a texel; of more lights, one grid behind the other along z.
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

// Fractions of four lights, from number 4·`texel` on, that reach `place`, in texture coordinates of the grid.
fn reached_from(place: vec3f, texel: u32) -> vec4f {
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
    } else if (SHADOWED > 4u) {
        // Half a texel from the next grid.
        let edge = 0.5 * light_place.behind / light_place.nodes.z;
        let z = clamp(place.z, edge, light_place.behind - edge);
        let behind = fma(f32(texel), light_place.behind, z);
        depths = textureSampleLevel(light_grid, light_sampler, vec3f(place.xy, behind), 0.0);
    } else {
        depths = textureSampleLevel(light_grid, light_sampler, place, 0.0);
    }
    if (SHADOWED == 1u) {
        return vec4f(exp(-depths.x));
    }
    return exp(-depths);
}

// Light of a step towards the eye for light from `position`, of which the fraction `reached` arrives. The ambient part of
// a directed light is not reduced.
fn shade_shadowed(position: u32, ray: Ray, step: Step, reached: f32) -> array<vec4f, LANES> {
    if (!SHADED) {
        var source = unshaded(step);
        for (var lane = 0u; lane < LANES; lane += 1u) {
            source[lane] *= reached;
        }
        return source;
    }
    var light = ray.view;
    if (DIRECTIONAL > 0u) {
        if (position >= AMBIENT + HEADLIGHT) {
            light = shading.lights[position].xyz;
        }
    }
    let facing = lit(dot(step.normal, light));
    var source = reflect_light(step, facing * reached);
    if (SPECULAR) {
        var shine = lit(dot(step.normal, unit(light + ray.view)));
        if (ONE_SIDED) {
            shine = select(0.0, shine, facing > 0.0);
        }
        var white: array<vec4f, LANES>;
        highlight(step, shine, &white);
        for (var lane = 0u; lane < LANES; lane += 1u) {
            source[lane] = fma(vec4f(reached), white[lane], source[lane]);
        }
    }
    return source;
}

// Adds the light of a step from one position with shadows.
fn add_light(
    position: u32,
    ray: Ray,
    step: Step,
    reached: f32,
    transmittance: Transmittance,
    sums: ptr<function, array<vec4f, LAYERS>>,
) {
    composite(sums, position * LANES, shade_shadowed(position, ray, step, reached), transmittance);
}

// Adds the light of a step from all positions. The first four lights have no loop, which would keep its variables in
// memory on a software device.
fn add_shadowed(
    ray: Ray,
    place: vec3f,
    step: Step,
    transmittance: Transmittance,
    sums: ptr<function, array<vec4f, LAYERS>>,
) {
    if (OPEN > 0u) {
        for (var open = 0u; open < OPEN; open += 1u) {
            var position = open;
            if (SHADOWED_HEADLIGHT) {
                position += select(0u, 1u, position >= LAST_HEADLIGHT);
            }
            position += select(0u, SHADOWED, position >= FIRST_SHADOWED);
            composite(sums, position * LANES, shade(position, ray, place, step), transmittance);
        }
    }
    if (SHADOWED_HEADLIGHT) {
        // The light takes the way of the eye: its mean over the step.
        let left = brightest(transmittance);
        add_light(LAST_HEADLIGHT, ray, step, fma(-0.5 * left, brightest(step.opacity), left), transmittance, sums);
    }
    if (SHADOWED > 0u) {
        let grid_place = fma(place, light_place.scale, light_place.offset);
        let reached = reached_from(grid_place, 0u);
        add_light(FIRST_SHADOWED, ray, step, reached.x, transmittance, sums);
        if (SHADOWED > 1u) {
            add_light(FIRST_SHADOWED + 1u, ray, step, reached.y, transmittance, sums);
        }
        if (SHADOWED > 2u) {
            add_light(FIRST_SHADOWED + 2u, ray, step, reached.z, transmittance, sums);
        }
        if (SHADOWED > 3u) {
            add_light(FIRST_SHADOWED + 3u, ray, step, reached.w, transmittance, sums);
        }
        if (SHADOWED > 4u) {
            var more: vec4f;
            for (var light = 4u; light < SHADOWED; light += 1u) {
                if (light % 4u == 0u) {
                    more = reached_from(grid_place, light / 4u);
                }
                add_light(FIRST_SHADOWED + light, ray, step, more.x, transmittance, sums);
                more = more.yzwx;
            }
        }
    }
}
