// Coloured transmittance: one number per coefficient of the colour model. Part of `march.wgsl`.

alias Passed = array<vec4f, LANES>;

fn all_light() -> Passed {
    var all: Passed;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        all[lane] = all_components(lane);
    }
    return all;
}

fn opacity_at(i: u32) -> Passed {
    var opacity: Passed;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        opacity[lane] = table_opacity[i * LANES + lane];
    }
    return opacity;
}

fn opacity_between(i: u32, fraction: f32) -> Passed {
    var between: Passed;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        let opacity = table_opacity[i * LANES + lane];
        between[lane] = fma(vec4f(fraction), table_opacity[(i + 1u) * LANES + lane] - opacity, opacity);
    }
    return between;
}

fn opacity_of_label(row: u32) -> Passed {
    var opacity: Passed;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        opacity[lane] = label_opacity[row * LANES + lane];
    }
    return opacity;
}

// Transmittance after a step, rounded once: `T *= 1 − α` drifts over a large number of equal steps.
fn pass_by(transmittance: Passed, opacity: Passed) -> Passed {
    var passed: Passed;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        passed[lane] = fma(-transmittance[lane], opacity[lane], transmittance[lane]);
    }
    return passed;
}

// Returns `sum` plus the transmitted part of a lane of `source`.
fn received(passed: Passed, lane: u32, source: array<vec4f, LANES>, sum: vec4f) -> vec4f {
    return fma(passed[lane], source[lane], sum);
}

fn brightest(passed: Passed) -> f32 {
    var most = vec4f();
    for (var lane = 0u; lane < LANES; lane += 1u) {
        most = max(most, passed[lane]);
    }
    return max(max(most.x, most.y), max(most.z, most.w));
}

fn load_passed(pixel: vec2u) -> Passed {
    var passed: Passed;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        passed[lane] = textureLoad(transmittances, pixel, lane);
    }
    return passed;
}

fn store_passed(pixel: vec2u, passed: Passed) {
    for (var lane = 0u; lane < LANES; lane += 1u) {
        textureStore(transmittances, pixel, lane, passed[lane]);
    }
}
