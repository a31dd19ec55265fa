// Light that a step scatters by phase functions, as k coefficients. Part of `march.wgsl`.

// Adds the light of a step towards the eye by phase functions, each of which has a part of the table entry, between directions
// with these `turns`, of light of which this share arrives.
fn scatter(step: Step, turned: vec2f, share: Share, source: ptr<function, array<vec4f, LANES>>) {
    for (var i = 0u; i < PHASES; i += 1u) {
        let part = phase_of(i / 4u, turned)[i % 4u];
        for (var lane = 0u; lane < LANES; lane += 1u) {
            (*source)[lane] = fma(step.source[i * LANES + lane], part * share_in(share, lane), (*source)[lane]);
        }
    }
}
