// Coloured optical depth of segments: one number per coefficient of the colour model. Part of `march.wgsl`.

// Integrals of the optical depth up to a bound of the table's cells. Twin of `tables::SegmentTable`.
alias DepthIntegral = array<vec4i, LANES>;

fn depth_integral_at(bound: u32) -> DepthIntegral {
    var integral: DepthIntegral;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        integral[lane] = bitcast<vec4i>(table_opacity[bound * LANES + lane]);
    }
    return integral;
}

fn depth_difference(from_bound: DepthIntegral, to_bound: DepthIntegral) -> Transmittance {
    var difference: Transmittance;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        difference[lane] = vec4f(to_bound[lane] - from_bound[lane]);
    }
    return difference;
}

fn mean_depth(whole: Transmittance, a: Transmittance, b: Transmittance, between: Between) -> Transmittance {
    var mean: Transmittance;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        mean[lane] = mean_of(whole[lane], a[lane], b[lane], between);
    }
    return mean;
}

fn depth_variation(mean: Transmittance, a: Transmittance, b: Transmittance) -> f32 {
    var most = vec4f();
    for (var lane = 0u; lane < LANES; lane += 1u) {
        most = max(most, abs(mean[lane] - a[lane]) + abs(b[lane] - mean[lane]));
    }
    return max(max(most.x, most.y), max(most.z, most.w));
}
