// Grey optical depth. Part of `march.wgsl`.

fn scaled_depth(depth: Transmittance, factor: f32) -> Transmittance {
    return depth * factor;
}

fn lost_light(depth: Transmittance) -> Transmittance {
    return lost(vec4f(depth)).x;
}

// Gain of the light that a length scatters, in the components of a lane.
fn gain_of(lost: Transmittance, depth: Transmittance, length: f32, lane: u32) -> vec4f {
    return vec4f(select(length, lost / depth, depth > 0.0 && length > 0.0));
}

// True if there is any depth.
fn is_depth(depth: Transmittance) -> bool {
    return depth != 0.0;
}

// Difference of two depths.
fn depth_between(a: Transmittance, b: Transmittance) -> f32 {
    return abs(a - b);
}
