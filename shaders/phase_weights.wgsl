// Light that a step scatters by phase functions, one per weight. Part of `march.wgsl`.

// Adds the light of a step towards the eye by phase functions, between directions with these `turns`, of light of which this
// share arrives.
fn scatter(step: Step, turned: vec2f, share: Share, source: ptr<function, array<vec4f, LANES>>) {
    for (var lane = 0u; lane < TABLE_LANES; lane += 1u) {
        let part = phase_of(lane, turned) * share_in(share, lane);
        (*source)[lane] = fma(step.source[lane], part, (*source)[lane]);
    }
}
