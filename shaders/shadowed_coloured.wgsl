// Light of positions with shadows in coloured media: a fraction per coefficient of the colour model. Part of `march.wgsl`, in
// place of `shadowed.wgsl`. Twin of `reference::shadows`.

// Coefficients of each absorber.
struct Absorbers {
    coefficients: array<vec4f, ABSORBER_VECTORS>,
}

@group(0) @binding(18) var<uniform> absorbers: Absorbers;

// Fractions of light number `light` that reach a place in the grid. Its depths follow one another: of all that is grey, and of
// each absorber.
fn reached_by(place: vec3f, light: u32) -> array<vec4f, LANES> {
    var number = light * (1u + ABSORBERS);
    var texel = depths_from(place, number / 4u);
    var depth: array<vec4f, LANES>;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        depth[lane] = vec4f(texel[number % 4u]);
    }
    for (var i = 0u; i < ABSORBERS; i += 1u) {
        number += 1u;
        if (number % 4u == 0u) {
            texel = depths_from(place, number / 4u);
        }
        for (var lane = 0u; lane < LANES; lane += 1u) {
            depth[lane] = fma(vec4f(texel[number % 4u]), absorbers.coefficients[i * LANES + lane], depth[lane]);
        }
    }
    for (var lane = 0u; lane < LANES; lane += 1u) {
        depth[lane] = exp(-depth[lane]);
    }
    return depth;
}

// Coefficients of `source` times those of `factor`.
fn times(source: array<vec4f, LANES>, factor: array<vec4f, LANES>) -> array<vec4f, LANES> {
    var product: array<vec4f, LANES>;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        product[lane] = source[lane] * factor[lane];
    }
    return product;
}

// Light of a step towards the eye: its ambient light, and its diffuse light by a shade per coefficient.
fn reflect_by(step: Step, facing: array<vec4f, LANES>) -> array<vec4f, LANES> {
    var source: array<vec4f, LANES>;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        if (EQUAL_SHARES) {
            let shade = fma(vec4f(shading.diffuse[0].x), facing[lane], vec4f(shading.ambient[0].x));
            source[lane] = step.source[lane] * shade;
        } else {
            source[lane] = fma(step.source[DIFFUSE + lane], facing[lane], step.source[lane]);
        }
    }
    return source;
}

// Adds the highlights of a light from the direction `light`, times these factors.
fn add_shine(
    light: vec3f,
    ray: Ray,
    step: Step,
    factor: array<vec4f, LANES>,
    source: ptr<function, array<vec4f, LANES>>,
) {
    var shine = lit(dot(step.normal, unit(light + ray.view)));
    if (ONE_SIDED) {
        shine = select(0.0, shine, dot(step.normal, light) < 0.0);
    }
    var white: array<vec4f, LANES>;
    highlight(step, shine, &white);
    for (var lane = 0u; lane < LANES; lane += 1u) {
        (*source)[lane] = fma(factor[lane], white[lane], (*source)[lane]);
    }
}

// Adds what thin films reflect from the direction `light`, times these factors.
fn add_thin_films_by(
    light: vec3f,
    ray: Ray,
    step: Step,
    factor: array<vec4f, LANES>,
    source: ptr<function, array<vec4f, LANES>>,
) {
    var reflected: array<vec4f, LANES>;
    add_thin_films(light, ray, step, 1.0, &reflected);
    for (var lane = 0u; lane < LANES; lane += 1u) {
        (*source)[lane] = fma(factor[lane], reflected[lane], (*source)[lane]);
    }
}

// Light of a step towards the eye for light from the direction `light`, of which these fractions arrive; they do not reduce the
// ambient share.
fn shade_from(light: vec3f, ray: Ray, step: Step, reached: array<vec4f, LANES>) -> array<vec4f, LANES> {
    if (PHASES > 0u) {
        return times(scattered_from(light, ray, step, 1.0), reached);
    }
    if (!SHADED) {
        return times(unshaded(step), reached);
    }
    let shade = lit(dot(step.normal, light));
    var facing: array<vec4f, LANES>;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        facing[lane] = reached[lane] * shade;
    }
    var source = reflect_by(step, facing);
    if (SPECULAR) {
        add_shine(light, ray, step, reached, &source);
    }
    if (THIN_FILMS > 0u) {
        add_thin_films_by(light, ray, step, reached, &source);
    }
    return source;
}

// Light of a step towards the eye for the three-point light with shadows.
fn shade_three_shadowed(ray: Ray, step: Step, place: vec3f) -> array<vec4f, LANES> {
    var source: array<vec4f, LANES>;
    var facing: array<vec4f, LANES>;
    var shine: array<vec4f, LANES>;
    // THREE_POINT_PARTS of src/scene/lights.rs.
    var parts = vec3f(18.0, 2.0, 3.0) / 23.0;
    for (var i = 0u; i < 3u; i += 1u) {
        let light = shading.lights[THREE_VECTORS + i];
        let reached = reached_by(place, SHADOWED + i);
        if (SHADED) {
            let shade = light.w * lit(dot(step.normal, light.xyz));
            for (var lane = 0u; lane < LANES; lane += 1u) {
                facing[lane] = fma(reached[lane], vec4f(shade), facing[lane]);
            }
            if (SPECULAR || THIN_FILMS > 0u) {
                var factor = reached;
                for (var lane = 0u; lane < LANES; lane += 1u) {
                    factor[lane] *= light.w;
                }
                if (SPECULAR) {
                    add_shine(light.xyz, ray, step, factor, &shine);
                }
                if (THIN_FILMS > 0u) {
                    add_thin_films_by(light.xyz, ray, step, factor, &shine);
                }
            }
        } else {
            let from_light = shade_from(light.xyz, ray, step, reached);
            for (var lane = 0u; lane < LANES; lane += 1u) {
                source[lane] = fma(vec4f(parts.x), from_light[lane], source[lane]);
            }
            parts = parts.yzx;
        }
    }
    if (SHADED) {
        source = reflect_by(step, facing);
        if (SPECULAR || THIN_FILMS > 0u) {
            for (var lane = 0u; lane < LANES; lane += 1u) {
                source[lane] += shine[lane];
            }
        }
    }
    return source;
}

// Adds the light of a step from all positions.
fn add_shadowed(
    ray: Ray,
    place: vec3f,
    step: Step,
    transmittance: Transmittance,
    sums: ptr<function, array<vec4f, LAYERS>>,
) {
    for (var open = 0u; open < OPEN; open += 1u) {
        let position = open_position(open);
        composite(sums, position * LANES, shade(position, ray, place, step), transmittance);
    }
    if (SHADOWED_HEADLIGHT) {
        // The light takes the way of the eye: its mean over the step.
        var reached: array<vec4f, LANES>;
        for (var lane = 0u; lane < LANES; lane += 1u) {
            reached[lane] = fma(-0.5 * transmittance[lane], step.opacity[lane], transmittance[lane]);
        }
        composite(sums, LAST_HEADLIGHT * LANES, shade_from(ray.view, ray, step, reached), transmittance);
    }
    if (GRID_LIGHTS > 0u) {
        let grid_place = fma(place, light_place.scale, light_place.offset);
        for (var i = 0u; i < SHADOWED; i += 1u) {
            let position = FIRST_SHADOWED + i;
            let source = shade_from(shading.lights[position].xyz, ray, step, reached_by(grid_place, i));
            composite(sums, position * LANES, source, transmittance);
        }
        if (SHADOWED_THREE_POINT) {
            composite(sums, LAST_THREE_POINT * LANES, shade_three_shadowed(ray, step, grid_place), transmittance);
        }
        for (var i = 0u; i < SHADOWED_POINTS; i += 1u) {
            let position = FIRST_SHADOWED_POINT + i;
            let light = unit(shading.lights[position].xyz - place * march.local_scale);
            let source = shade_from(light, ray, step, reached_by(grid_place, FIRST_POINT_NUMBER + i));
            composite(sums, position * LANES, source, transmittance);
        }
    }
}
