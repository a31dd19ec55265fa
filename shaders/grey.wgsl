// Grey transmittance: one number for all wavelengths. Part of `march.wgsl`.

alias Transmittance = f32;

fn all_light() -> Transmittance {
    return 1.0;
}

fn opacity_at(i: u32) -> Transmittance {
    return table_opacity[i / 4u][i % 4u];
}

fn opacity_between(i: u32, after: u32, fraction: f32) -> Transmittance {
    let opacity = opacity_at(i);
    return fma(fraction, opacity_at(after) - opacity, opacity);
}

fn opacity_of_label(row: u32) -> Transmittance {
    return label_opacity[row / 4u][row % 4u];
}

fn opacity_between_labels(here: u32, next: u32, fraction: f32) -> Transmittance {
    let opacity = opacity_of_label(here);
    return fma(fraction, opacity_of_label(next) - opacity, opacity);
}

fn plus_share(sum: Transmittance, share: f32, opacity: Transmittance) -> Transmittance {
    return fma(share, opacity, sum);
}

// Multiplies the extinction and the scattering of a step by `factor`.
fn thin(step: Step, factor: f32) -> Step {
    var thinner = step;
    if (factor < 1.0) {
        let ratio = thinning(vec4f(step.opacity), factor).x;
        thinner.opacity *= ratio;
        for (var lane = 0u; lane < TABLE_LANES; lane += 1u) {
            thinner.source[lane] *= ratio;
        }
    }
    return thinner;
}

// Transmittance after a step, rounded once: `T *= 1 − α` drifts over a large number of equal steps.
fn attenuate(transmittance: Transmittance, opacity: Transmittance) -> Transmittance {
    if (COMPENSATED) {
        let term = fma(-transmittance, opacity, -lost_transmittance);
        let total = rounded(vec4f(transmittance + term)).x;
        lost_transmittance = (total - transmittance) - term;
        return total;
    }
    return fma(-transmittance, opacity, transmittance);
}

// Returns `sum` plus the transmitted part of a lane of `source`.
fn received(transmittance: Transmittance, lane: u32, source: array<vec4f, LANES>, sum: vec4f) -> vec4f {
    return fma(vec4f(transmittance), source[lane], sum);
}

fn brightest(transmittance: Transmittance) -> f32 {
    return transmittance;
}

fn load_transmittance_from(pixel: vec2u, layer: u32) -> Transmittance {
    return film_transmittance(pixel, layer).x;
}

fn store_transmittance_to(pixel: vec2u, layer: u32, transmittance: Transmittance) {
    set_film_transmittance(pixel, layer, vec4f(transmittance));
}
