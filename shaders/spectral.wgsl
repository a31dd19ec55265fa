// Reflected light of a step as k coefficients of a colour model. Part of `march.wgsl`.

fn unshaded(step: Step) -> array<vec4f, LANES> {
    var source: array<vec4f, LANES>;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        source[lane] = step.source[UNSHADED + lane];
        if (PHASES > 1u) {
            for (var i = 1u; i < PHASES; i += 1u) {
                source[lane] += step.source[i * LANES + lane];
            }
        }
    }
    return source;
}

// Diffuse light by this shade, and the ambient share, of which the fraction `open` arrives.
fn reflect_light(step: Step, facing: Share, open: f32) -> array<vec4f, LANES> {
    var source: array<vec4f, LANES>;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        if (EQUAL_SHARES) {
            let ambient = vec4f(shading.ambient[0].x * open);
            source[lane] = step.source[lane] * fma(vec4f(shading.diffuse[0].x), share_in(facing, lane), ambient);
        } else {
            source[lane] = fma(step.source[DIFFUSE + lane], share_in(facing, lane), step.source[lane] * open);
        }
    }
    return source;
}

// Adds the highlights of each exponent, by this share. White is 1 in every coefficient.
fn highlight(step: Step, facing: f32, share: Share, source: ptr<function, array<vec4f, LANES>>) {
    for (var i = 0u; i < EXPONENTS; i += 1u) {
        var shine = 0.0;
        if (ONE_EXPONENT) {
            shine = power(facing, ONE_EXPONENT_VALUE);
        } else {
            shine = power(facing, shading.exponent[i / 4u][i % 4u]);
        }
        for (var lane = 0u; lane < LANES; lane += 1u) {
            if (COLOURED) {
                let white = step.source[HIGHLIGHTS + i * LANES + lane] * shine;
                (*source)[lane] = fma(share_in(share, lane), white, (*source)[lane]);
            } else {
                let white = all_components(lane) * (step.source[HIGHLIGHTS + i / 4u][i % 4u] * shine);
                (*source)[lane] = fma(share_in(share, lane), white, (*source)[lane]);
            }
        }
    }
}

// 1 in every coefficient of the model, 0 in the unused ones of the last lane.
fn all_components(lane: u32) -> vec4f {
    return select(vec4f(), vec4f(1.0), vec4u(4u * lane) + vec4u(0u, 1u, 2u, 3u) < vec4u(COMPONENTS));
}
