// Grey optical depth of segments. Part of `march.wgsl`.

// Integral of the optical depth up to a bound of the table's cells. Twin of `tables::SegmentTable`.
alias DepthIntegral = i32;

fn depth_integral_at(bound: u32) -> DepthIntegral {
    return bitcast<i32>(table_opacity[bound / 4u][bound % 4u]);
}

fn depth_difference(from_bound: DepthIntegral, to_bound: DepthIntegral) -> Transmittance {
    return f32(to_bound - from_bound);
}

fn mean_depth(whole: Transmittance, a: Transmittance, b: Transmittance, between: Between) -> Transmittance {
    return mean_of(vec4f(whole), vec4f(a), vec4f(b), between).x;
}

fn depth_variation(mean: Transmittance, a: Transmittance, b: Transmittance) -> f32 {
    return abs(mean - a) + abs(b - mean);
}
