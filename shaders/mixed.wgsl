// Transmittance as a matrix, row by row, because every coefficient behind a step contributes to all in front: a step
// multiplies matrices (Peercy 1993). Part of `march.wgsl`.

alias Transmittance = array<f32, TRANSMITTANCE_NUMBERS>;

fn all_light() -> Transmittance {
    var all: Transmittance;
    for (var row = 0u; row < COMPONENTS; row += 1u) {
        all[row * COMPONENTS + row] = 1.0;
    }
    return all;
}

fn opacity_at(i: u32) -> Transmittance {
    var opacity: Transmittance;
    for (var n = 0u; n < TRANSMITTANCE_NUMBERS; n += 1u) {
        opacity[n] = table_opacity[i * TRANSMITTANCE_LANES + n / 4u][n % 4u];
    }
    return opacity;
}

fn opacity_between(i: u32, fraction: f32) -> Transmittance {
    var between: Transmittance;
    for (var n = 0u; n < TRANSMITTANCE_NUMBERS; n += 1u) {
        let opacity = table_opacity[i * TRANSMITTANCE_LANES + n / 4u][n % 4u];
        between[n] = fma(fraction, table_opacity[(i + 1u) * TRANSMITTANCE_LANES + n / 4u][n % 4u] - opacity, opacity);
    }
    return between;
}

fn opacity_of_label(row: u32) -> Transmittance {
    var opacity: Transmittance;
    for (var n = 0u; n < TRANSMITTANCE_NUMBERS; n += 1u) {
        opacity[n] = label_opacity[row * TRANSMITTANCE_LANES + n / 4u][n % 4u];
    }
    return opacity;
}

fn plus_share(sum: Transmittance, share: f32, opacity: Transmittance) -> Transmittance {
    var blend: Transmittance;
    for (var n = 0u; n < TRANSMITTANCE_NUMBERS; n += 1u) {
        blend[n] = fma(share, opacity[n], sum[n]);
    }
    return blend;
}

// Multiplies the extinction and the scattering of a part of a step by its length `factor`: the power of a matrix is no
// short formula. Plans refuse factors by the gradient magnitude.
fn thin(step: Step, factor: f32) -> Step {
    var thinner = step;
    for (var n = 0u; n < TRANSMITTANCE_NUMBERS; n += 1u) {
        thinner.opacity[n] *= factor;
    }
    for (var lane = 0u; lane < TABLE_LANES; lane += 1u) {
        thinner.source[lane] *= factor;
    }
    return thinner;
}

// Transmittance after a step, T − T·A, not compensated. Twin of `reference::march::attenuate_matrix`.
fn attenuate(transmittance: Transmittance, opacity: Transmittance) -> Transmittance {
    var left = transmittance;
    for (var row = 0u; row < TRANSMITTANCE_NUMBERS; row += COMPONENTS) {
        for (var inner = 0u; inner < COMPONENTS; inner += 1u) {
            let through = -transmittance[row + inner];
            for (var column = 0u; column < COMPONENTS; column += 1u) {
                left[row + column] = fma(through, opacity[inner * COMPONENTS + column], left[row + column]);
            }
        }
    }
    return left;
}

// Returns `sum` plus the transmitted part of `source`, for the components of one lane.
fn received(transmittance: Transmittance, lane: u32, source: array<vec4f, LANES>, sum: vec4f) -> vec4f {
    var all = sum;
    for (var part = 0u; part < min(4u, COMPONENTS - 4u * lane); part += 1u) {
        let row = (4u * lane + part) * COMPONENTS;
        var received = all[part];
        for (var column = 0u; column < COMPONENTS; column += 1u) {
            received = fma(transmittance[row + column], source[column / 4u][column % 4u], received);
        }
        all[part] = received;
    }
    return all;
}

fn brightest(transmittance: Transmittance) -> f32 {
    var most = 0.0;
    for (var n = 0u; n < TRANSMITTANCE_NUMBERS; n += 1u) {
        most = max(most, abs(transmittance[n]));
    }
    return most;
}

fn load_transmittance_from(pixel: vec2u, layer: u32) -> Transmittance {
    var transmittance: Transmittance;
    for (var n = 0u; n < TRANSMITTANCE_NUMBERS; n += 1u) {
        transmittance[n] = textureLoad(transmittances, pixel, layer + n / 4u)[n % 4u];
    }
    return transmittance;
}

fn store_transmittance_to(pixel: vec2u, layer: u32, transmittance: Transmittance) {
    for (var lane = 0u; lane < TRANSMITTANCE_LANES; lane += 1u) {
        var texel: vec4f;
        for (var part = 0u; part < min(4u, TRANSMITTANCE_NUMBERS - 4u * lane); part += 1u) {
            texel[part] = transmittance[4u * lane + part];
        }
        textureStore(transmittances, pixel, layer + lane, texel);
    }
}
