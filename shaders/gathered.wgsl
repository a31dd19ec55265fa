// Light that has scattered before, at the nodes of a grid. Part of `march.wgsl`. Twin of `reference::gathered`.

@group(0) @binding(32) var<uniform> gathered_uniform: LightPlace;
// Mean intensity of four components a texel; of more components and accumulators, one grid behind the other along z.
@group(0) @binding(33) var gathered_light: texture_3d<f32>;
@group(0) @binding(34) var gathered_sampler: sampler;

// Copy of the uniform, as for `march`.
var<private> gathered_at: LightPlace;

fn gathered_line(base: vec3i, x: f32) -> vec4f {
    let before = textureLoad(gathered_light, base, 0);
    return fma(vec4f(x), textureLoad(gathered_light, base + vec3i(1, 0, 0), 0) - before, before);
}

fn gathered_plane(base: vec3i, x: f32, y: f32) -> vec4f {
    let before = gathered_line(base, x);
    return fma(vec4f(y), gathered_line(base + vec3i(0, 1, 0), x) - before, before);
}

// Four components at `place`, in texture coordinates of the first grid, of grid `layer`.
fn gathered_from(place: vec3f, layer: u32) -> vec4f {
    if (EXACT_LINEAR) {
        let all = vec3f(textureDimensions(gathered_light));
        let node = clamp(fma(place, all, vec3f(-0.5)), vec3f(), gathered_at.nodes - 1.0);
        let base = min(floor(node), gathered_at.nodes - 2.0);
        let fraction = node - base;
        let first = vec3i(base) + vec3i(0, 0, i32(layer * u32(gathered_at.nodes.z)));
        let before = gathered_plane(first, fraction.x, fraction.y);
        let after = gathered_plane(first + vec3i(0, 0, 1), fraction.x, fraction.y);
        return fma(vec4f(fraction.z), after - before, before);
    }
    // Half a texel from the next grid.
    let edge = 0.5 * gathered_at.behind / gathered_at.nodes.z;
    let z = clamp(place.z, edge, gathered_at.behind - edge);
    return textureSampleLevel(gathered_light, gathered_sampler, vec3f(place.xy, fma(f32(layer), gathered_at.behind, z)), 0.0);
}

// Adds what a step scatters of the light of an accumulator that has scattered before.
fn add_gathered(place: vec3f, accumulator: u32, step: Step, source: ptr<function, array<vec4f, LANES>>) {
    let own = unshaded(step);
    for (var lane = 0u; lane < LANES; lane += 1u) {
        (*source)[lane] = fma(own[lane], gathered_from(place, accumulator * LANES + lane), (*source)[lane]);
    }
}
