// Transmittance as a matrix, row by row, because every coefficient behind a step contributes to all in front: a step
// multiplies matrices (Peercy 1993). Part of `march.wgsl`.

alias Passed = array<f32, PASSED>;

fn all_light() -> Passed {
    var all: Passed;
    for (var row = 0u; row < COMPONENTS; row += 1u) {
        all[row * COMPONENTS + row] = 1.0;
    }
    return all;
}

fn opacity_at(i: u32) -> Passed {
    var opacity: Passed;
    for (var n = 0u; n < PASSED; n += 1u) {
        opacity[n] = table_opacity[i * PASSED_LANES + n / 4u][n % 4u];
    }
    return opacity;
}

fn opacity_between(i: u32, fraction: f32) -> Passed {
    var between: Passed;
    for (var n = 0u; n < PASSED; n += 1u) {
        let opacity = table_opacity[i * PASSED_LANES + n / 4u][n % 4u];
        between[n] = fma(fraction, table_opacity[(i + 1u) * PASSED_LANES + n / 4u][n % 4u] - opacity, opacity);
    }
    return between;
}

fn opacity_of_label(row: u32) -> Passed {
    var opacity: Passed;
    for (var n = 0u; n < PASSED; n += 1u) {
        opacity[n] = label_opacity[row * PASSED_LANES + n / 4u][n % 4u];
    }
    return opacity;
}

// Transmittance after a step, T − T·A. Twin of `reference::march::pass_by_matrix`.
fn pass_by(transmittance: Passed, opacity: Passed) -> Passed {
    var passed = transmittance;
    for (var row = 0u; row < PASSED; row += COMPONENTS) {
        for (var inner = 0u; inner < COMPONENTS; inner += 1u) {
            let through = -transmittance[row + inner];
            for (var column = 0u; column < COMPONENTS; column += 1u) {
                passed[row + column] = fma(through, opacity[inner * COMPONENTS + column], passed[row + column]);
            }
        }
    }
    return passed;
}

// Returns `sum` plus the transmitted part of `source`, for the components of one lane.
fn received(passed: Passed, lane: u32, source: array<vec4f, LANES>, sum: vec4f) -> vec4f {
    var all = sum;
    for (var part = 0u; part < min(4u, COMPONENTS - 4u * lane); part += 1u) {
        let row = (4u * lane + part) * COMPONENTS;
        var received = all[part];
        for (var column = 0u; column < COMPONENTS; column += 1u) {
            received = fma(passed[row + column], source[column / 4u][column % 4u], received);
        }
        all[part] = received;
    }
    return all;
}

fn brightest(passed: Passed) -> f32 {
    var most = 0.0;
    for (var n = 0u; n < PASSED; n += 1u) {
        most = max(most, abs(passed[n]));
    }
    return most;
}

fn load_passed(pixel: vec2u) -> Passed {
    var passed: Passed;
    for (var n = 0u; n < PASSED; n += 1u) {
        passed[n] = textureLoad(transmittances, pixel, n / 4u)[n % 4u];
    }
    return passed;
}

fn store_passed(pixel: vec2u, passed: Passed) {
    for (var lane = 0u; lane < PASSED_LANES; lane += 1u) {
        var texel: vec4f;
        for (var part = 0u; part < min(4u, PASSED - 4u * lane); part += 1u) {
            texel[part] = passed[4u * lane + part];
        }
        textureStore(transmittances, pixel, lane, texel);
    }
}
