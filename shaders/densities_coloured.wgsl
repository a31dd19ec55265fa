// Coloured optical depth: one number per coefficient of the colour model. Part of `march.wgsl`.

fn scaled_depth(depth: Transmittance, factor: f32) -> Transmittance {
    var scaled: Transmittance;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        scaled[lane] = depth[lane] * factor;
    }
    return scaled;
}

fn lost_light(depth: Transmittance) -> Transmittance {
    var all: Transmittance;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        all[lane] = lost(depth[lane]);
    }
    return all;
}

// Gains of the light that a length scatters, in the components of a lane.
fn gain_of(lost: Transmittance, depth: Transmittance, length: f32, lane: u32) -> vec4f {
    let of_lane = depth[lane % LANES];
    return select(vec4f(length), lost[lane % LANES] / of_lane, (of_lane > vec4f()) & vec4<bool>(length > 0.0));
}

// True if there is any depth.
fn is_depth(depth: Transmittance) -> bool {
    var is_any = false;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        is_any |= any(depth[lane] != vec4f());
    }
    return is_any;
}

// Largest difference of two depths.
fn depth_between(a: Transmittance, b: Transmittance) -> f32 {
    var most = vec4f();
    for (var lane = 0u; lane < LANES; lane += 1u) {
        most = max(most, abs(a[lane] - b[lane]));
    }
    return max(max(most.x, most.y), max(most.z, most.w));
}
