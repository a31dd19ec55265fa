// Grey transmittance: one number for all wavelengths. Part of `march.wgsl`.

alias Passed = f32;

fn all_light() -> Passed {
    return 1.0;
}

fn opacity_at(i: u32) -> Passed {
    return table_opacity[i / 4u][i % 4u];
}

fn opacity_between(i: u32, fraction: f32) -> Passed {
    let opacity = opacity_at(i);
    return fma(fraction, opacity_at(i + 1u) - opacity, opacity);
}

fn opacity_of_label(row: u32) -> Passed {
    return label_opacity[row / 4u][row % 4u];
}

// Transmittance after a step, rounded once: `T *= 1 − α` drifts over a large number of equal steps.
fn pass_by(transmittance: Passed, opacity: Passed) -> Passed {
    return fma(-transmittance, opacity, transmittance);
}

// Returns `sum` plus the transmitted part of a lane of `source`.
fn received(passed: Passed, lane: u32, source: array<vec4f, LANES>, sum: vec4f) -> vec4f {
    return fma(vec4f(passed), source[lane], sum);
}

fn brightest(passed: Passed) -> f32 {
    return passed;
}

fn load_passed(pixel: vec2u) -> Passed {
    return textureLoad(transmittances, pixel, 0).x;
}

fn store_passed(pixel: vec2u, passed: Passed) {
    textureStore(transmittances, pixel, 0, vec4f(passed));
}
