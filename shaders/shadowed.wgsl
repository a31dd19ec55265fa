// Light of positions with shadows. Part of `march.wgsl`; only plans with shadows call it, and their transmittance is
// grey. Twin of `reference::shadows`.

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
// Fraction of the ambient shares of directed lights that reaches the step.
var<private> ambient_light: f32;

fn light_line(base: vec3i, x: f32) -> vec4f {
    let before = textureLoad(light_grid, base, 0);
    return fma(vec4f(x), textureLoad(light_grid, base + vec3i(1, 0, 0), 0) - before, before);
}

fn light_plane(base: vec3i, x: f32, y: f32) -> vec4f {
    let before = light_line(base, x);
    return fma(vec4f(y), light_line(base + vec3i(0, 1, 0), x) - before, before);
}

// Fractions that reach `place`, in texture coordinates of the grid, of four lights, number 4·`texel` on.
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
    } else if (GRID_LIGHTS > 4u) {
        // Half a texel from the next grid.
        let edge = 0.5 * light_place.behind / light_place.nodes.z;
        let z = clamp(place.z, edge, light_place.behind - edge);
        let behind = fma(f32(texel), light_place.behind, z);
        depths = textureSampleLevel(light_grid, light_sampler, vec3f(place.xy, behind), 0.0);
    } else {
        depths = textureSampleLevel(light_grid, light_sampler, place, 0.0);
    }
    if (GRID_LIGHTS == 1u) {
        return vec4f(exp(-depths.x));
    }
    return exp(-depths);
}

// Light of a step towards the eye for light without a direction, of which the fraction `reached` arrives.
fn unshaded_part(step: Step, reached: f32) -> array<vec4f, LANES> {
    var source = unshaded(step);
    for (var lane = 0u; lane < LANES; lane += 1u) {
        source[lane] *= reached;
    }
    return source;
}

// Light of a step towards the eye for light from `position`, of which the fraction `reached` arrives; it does not reduce
// the ambient share.
fn shade_shadowed(position: u32, ray: Ray, step: Step, reached: f32) -> array<vec4f, LANES> {
    if (!SHADED && PHASES == 0u) {
        return unshaded_part(step, reached);
    }
    var light = ray.view;
    if (DIRECTIONAL > 0u) {
        if (position >= AMBIENT + HEADLIGHT) {
            light = shading.lights[position].xyz;
        }
    }
    return shade_from(light, ray, step, reached);
}

// Light of a step towards the eye for light from the direction `light`, of which the fraction `reached` arrives.
fn shade_from(light: vec3f, ray: Ray, step: Step, reached: f32) -> array<vec4f, LANES> {
    if (PHASES > 0u) {
        return scattered_from(light, ray, step, reached);
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

// Light of a step towards the eye for point light `i` of those with shadows, of which the fraction `reached` arrives.
fn shade_point(i: u32, ray: Ray, place: vec3f, step: Step, reached: f32) -> array<vec4f, LANES> {
    if (!SHADED && PHASES == 0u) {
        return unshaded_part(step, reached);
    }
    let light = unit(shading.lights[FIRST_SHADOWED_POINT + i].xyz - place * march.local_scale);
    return shade_from(light, ray, step, reached);
}

// Vector of a direction of the three-point light with shadows: key, fill and rim.
fn of_three(i: u32) -> vec4f {
    return shading.lights[THREE_VECTORS + i];
}

// Diffuse shade of a direction of a three-point light, a vector with a weight, of which the fraction `reached` arrives.
fn facing_of_three(light: vec4f, step: Step, reached: f32) -> f32 {
    return light.w * reached * lit(dot(step.normal, light.xyz));
}

// Adds the highlights of this direction.
fn shine_of_three(light: vec4f, ray: Ray, step: Step, reached: f32, source: ptr<function, array<vec4f, LANES>>) {
    var shine = lit(dot(step.normal, unit(light.xyz + ray.view)));
    if (ONE_SIDED) {
        shine = select(0.0, shine, dot(step.normal, light.xyz) < 0.0);
    }
    var white: array<vec4f, LANES>;
    highlight(step, shine, &white);
    for (var lane = 0u; lane < LANES; lane += 1u) {
        (*source)[lane] = fma(vec4f(light.w * reached), white[lane], (*source)[lane]);
    }
}

// Light of a step towards the eye for the three-point light with shadows, of whose directions these fractions arrive.
// Without loops, like `add_shadowed`.
fn shade_three_shadowed(ray: Ray, step: Step, reached: vec3f) -> array<vec4f, LANES> {
    if (PHASES > 0u) {
        return scattered_from_three(THREE_VECTORS, ray, step, reached);
    }
    if (!SHADED) {
        // THREE_POINT_PARTS of src/scene/lights.rs. As constants of the module they would be in every other shader too.
        return unshaded_part(step, dot(reached, vec3f(18.0, 2.0, 3.0)) / 23.0);
    }
    let key = of_three(0u);
    let fill = of_three(1u);
    let rim = of_three(2u);
    let facing = facing_of_three(key, step, reached.x) + facing_of_three(fill, step, reached.y)
        + facing_of_three(rim, step, reached.z);
    var source = reflect_light(step, facing);
    if (SPECULAR) {
        shine_of_three(key, ray, step, reached.x, &source);
        shine_of_three(fill, ray, step, reached.y, &source);
        shine_of_three(rim, ray, step, reached.z, &source);
    }
    return source;
}

// Fractions that reach a place in the grid from the directions of the three-point light, which follow those of the
// directional lights. `first` are those of the first texel.
fn reached_of_three(place: vec3f, first: vec4f) -> vec3f {
    var here = first;
    if (SHADOWED >= 4u) {
        here = reached_from(place, SHADOWED / 4u);
    }
    var three = here.xyz;
    if (SHADOWED % 4u == 1u) {
        three = here.yzw;
    }
    if (SHADOWED % 4u >= 2u) {
        let next = reached_from(place, SHADOWED / 4u + 1u);
        if (SHADOWED % 4u == 2u) {
            three = vec3f(here.zw, next.x);
        } else {
            three = vec3f(here.w, next.xy);
        }
    }
    return three;
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
    let grid_place = fma(place, light_place.scale, light_place.offset);
    var reached: vec4f;
    if (GRID_LIGHTS > 0u) {
        reached = reached_from(grid_place, 0u);
    }
    if (SKY_DIMMED) {
        var sky = reached;
        if (SKY >= 4u) {
            sky = reached_from(grid_place, SKY / 4u);
        }
        ambient_light = sky[SKY % 4u];
        if (SHADOWED_AMBIENT) {
            composite(sums, LAST_AMBIENT * LANES, unshaded_part(step, ambient_light), transmittance);
        }
    }
    if (OPEN > 0u) {
        for (var open = 0u; open < OPEN; open += 1u) {
            var position = open;
            if (SHADOWED_AMBIENT) {
                position += select(0u, 1u, position >= LAST_AMBIENT);
            }
            if (SHADOWED_HEADLIGHT) {
                position += select(0u, 1u, position >= LAST_HEADLIGHT);
            }
            position += select(0u, SHADOWED, position >= FIRST_SHADOWED);
            if (SHADOWED_POINTS > 0u) {
                position += select(0u, SHADOWED_POINTS, position >= FIRST_SHADOWED_POINT);
            }
            composite(sums, position * LANES, shade(position, ray, place, step), transmittance);
        }
    }
    if (SHADOWED_HEADLIGHT) {
        // The light takes the way of the eye: its mean over the step.
        let left = brightest(transmittance);
        add_light(LAST_HEADLIGHT, ray, step, fma(-0.5 * left, brightest(step.opacity), left), transmittance, sums);
    }
    if (GRID_LIGHTS > 0u) {
        if (SHADOWED > 0u) {
            add_light(FIRST_SHADOWED, ray, step, reached.x, transmittance, sums);
        }
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
        if (SHADOWED_THREE_POINT) {
            let source = shade_three_shadowed(ray, step, reached_of_three(grid_place, reached));
            composite(sums, LAST_THREE_POINT * LANES, source, transmittance);
        }
        if (SHADOWED_POINTS > 0u) {
            for (var i = 0u; i < SHADOWED_POINTS; i += 1u) {
                let number = FIRST_POINT_NUMBER + i;
                let part = reached_from(grid_place, number / 4u)[number % 4u];
                composite(sums, (FIRST_SHADOWED_POINT + i) * LANES, shade_point(i, ray, place, step, part), transmittance);
            }
        }
    }
}
