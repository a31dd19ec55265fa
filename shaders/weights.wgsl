// Reflected light of a step as one weight per material, and one of white for highlights. Part of `march.wgsl`.

fn unshaded(step: Step) -> array<vec4f, LANES> {
    var source: array<vec4f, LANES>;
    for (var lane = 0u; lane < TABLE_LANES; lane += 1u) {
        source[lane] = step.source[lane];
    }
    return source;
}

// Diffuse light by this shade, and the ambient share, of which the fraction `open` arrives.
fn reflect_light(step: Step, facing: Share, open: f32) -> array<vec4f, LANES> {
    var source: array<vec4f, LANES>;
    for (var lane = 0u; lane < TABLE_LANES; lane += 1u) {
        let ambient = shading.ambient[lane] * open;
        source[lane] = step.source[lane] * fma(shading.diffuse[lane], share_in(facing, lane), ambient);
    }
    return source;
}

// Adds white: Σ weight · specular · facing^exponent over the materials, by this share.
fn highlight(step: Step, facing: f32, share: Share, source: ptr<function, array<vec4f, LANES>>) {
    var white = 0.0;
    if (ONE_EXPONENT) {
        for (var lane = 0u; lane < TABLE_LANES; lane += 1u) {
            white += dot(step.source[lane], shading.specular[lane]);
        }
        white *= power(facing, ONE_EXPONENT_VALUE);
    } else {
        for (var lane = 0u; lane < TABLE_LANES; lane += 1u) {
            let powers = vec4f(
                power(facing, shading.exponent[lane].x),
                power(facing, shading.exponent[lane].y),
                power(facing, shading.exponent[lane].z),
                power(facing, shading.exponent[lane].w),
            );
            white += dot(step.source[lane] * shading.specular[lane], powers);
        }
    }
    (*source)[WHITE_LANE][WHITE_PART] = fma(share_in(share, WHITE_LANE)[WHITE_PART], white, (*source)[WHITE_LANE][WHITE_PART]);
}
