// Light of positions with shadows, where all absorption is grey. Part of `march.wgsl`; only plans with shadows call it. Twin
// of `reference::shadows`.

// Fractions that reach `place`, in texture coordinates of the grid, of four lights, number 4·`texel` on.
fn reached_from(place: vec3f, texel: u32) -> vec4f {
    let depths = depths_from(place, texel);
    if (GRID_DEPTHS == 1u) {
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
    if (THIN_FILMS > 0u) {
        add_thin_films(light, ray, step, reached, &source);
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
    if (THIN_FILMS > 0u) {
        add_thin_films(key.xyz, ray, step, key.w * reached.x, &source);
        add_thin_films(fill.xyz, ray, step, fill.w * reached.y, &source);
        add_thin_films(rim.xyz, ray, step, rim.w * reached.z, &source);
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
            let position = open_position(open);
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
