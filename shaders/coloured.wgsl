// Coloured transmittance: one number per coefficient of the colour model. Part of `march.wgsl`.

alias Transmittance = array<vec4f, LANES>;

fn all_light() -> Transmittance {
    var all: Transmittance;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        all[lane] = all_components(lane);
    }
    return all;
}

fn opacity_at(i: u32) -> Transmittance {
    var opacity: Transmittance;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        opacity[lane] = table_opacity[i * LANES + lane];
    }
    return opacity;
}

fn opacity_between(i: u32, after: u32, fraction: f32) -> Transmittance {
    var between: Transmittance;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        let opacity = table_opacity[i * LANES + lane];
        between[lane] = fma(vec4f(fraction), table_opacity[after * LANES + lane] - opacity, opacity);
    }
    return between;
}

fn opacity_of_label(row: u32) -> Transmittance {
    var opacity: Transmittance;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        opacity[lane] = label_opacity[row * LANES + lane];
    }
    return opacity;
}

fn opacity_between_labels(here: u32, next: u32, fraction: f32) -> Transmittance {
    var between: Transmittance;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        let opacity = label_opacity[here * LANES + lane];
        between[lane] = fma(vec4f(fraction), label_opacity[next * LANES + lane] - opacity, opacity);
    }
    return between;
}

fn plus_share(sum: Transmittance, share: f32, opacity: Transmittance) -> Transmittance {
    var blend: Transmittance;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        blend[lane] = fma(vec4f(share), opacity[lane], sum[lane]);
    }
    return blend;
}

// Multiplies the extinction and the scattering of a step by `factor`.
fn thin(step: Step, factor: f32) -> Step {
    var thinner = step;
    if (factor < 1.0) {
        for (var lane = 0u; lane < LANES; lane += 1u) {
            let ratio = thinning(step.opacity[lane], factor);
            thinner.opacity[lane] *= ratio;
            for (var part = lane; part < TABLE_LANES; part += LANES) {
                thinner.source[part] *= ratio;
            }
        }
    }
    return thinner;
}

// Transmittance after a step, rounded once: `T *= 1 − α` drifts over a large number of equal steps.
fn attenuate(transmittance: Transmittance, opacity: Transmittance) -> Transmittance {
    var left: Transmittance;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        if (COMPENSATED) {
            let term = fma(-transmittance[lane], opacity[lane], -lost_transmittance[lane]);
            left[lane] = rounded(transmittance[lane] + term);
            lost_transmittance[lane] = (left[lane] - transmittance[lane]) - term;
        } else {
            left[lane] = fma(-transmittance[lane], opacity[lane], transmittance[lane]);
        }
    }
    return left;
}

// Returns `sum` plus the transmitted part of a lane of `source`.
fn received(transmittance: Transmittance, lane: u32, source: array<vec4f, LANES>, sum: vec4f) -> vec4f {
    return fma(transmittance[lane], source[lane], sum);
}

fn brightest(transmittance: Transmittance) -> f32 {
    var most = vec4f();
    for (var lane = 0u; lane < LANES; lane += 1u) {
        most = max(most, transmittance[lane]);
    }
    return max(max(most.x, most.y), max(most.z, most.w));
}

fn load_transmittance_from(pixel: vec2u, layer: u32) -> Transmittance {
    var transmittance: Transmittance;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        transmittance[lane] = film_transmittance(pixel, layer + lane);
    }
    return transmittance;
}

fn store_transmittance_to(pixel: vec2u, layer: u32, transmittance: Transmittance) {
    for (var lane = 0u; lane < LANES; lane += 1u) {
        set_film_transmittance(pixel, layer + lane, transmittance[lane]);
    }
}
