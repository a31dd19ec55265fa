// Light that a step scatters by phase functions, one per weight. Part of `march.wgsl`.

// Light of a step towards the eye by phase functions, between directions with these `turns`, of light of which the fraction
// `reached` arrives.
fn scattered(step: Step, turned: vec2f, reached: f32) -> array<vec4f, LANES> {
    var source: array<vec4f, LANES>;
    for (var lane = 0u; lane < TABLE_LANES; lane += 1u) {
        source[lane] = step.source[lane] * (phase_of(lane, turned) * reached);
    }
    return source;
}
