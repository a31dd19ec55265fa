// Light that a step scatters by phase functions. Part of `march.wgsl`; only plans with phase functions call it. Twin of
// `reference::phase`.

// Phase functions in lanes (`tables::PhaseTable`).
struct Phases {
    gain: array<vec4f, PHASE_LANES>,
    least: array<vec4f, PHASE_LANES>,
    forward: array<vec4f, PHASE_LANES>,
    backward: array<vec4f, PHASE_LANES>,
}

@group(0) @binding(17) var<uniform> phases_uniform: Phases;

// Copy of the uniform, as for `march`.
var<private> phases: Phases;

// |v + l|² and |v − l|² for the unit vectors v to the eye and l to the light: 0 for light from straight behind, and for
// light from the eye.
fn turns(view: vec3f, light: vec3f) -> vec2f {
    let ahead = view + light;
    let back = view - light;
    return vec2f(dot(ahead, ahead), dot(back, back));
}

// The phase functions of a lane between two directions, by their `turns`.
fn phase_of(lane: u32, turned: vec2f) -> vec4f {
    let square = fma(phases.backward[lane], vec4f(turned.y), fma(phases.forward[lane], vec4f(turned.x), phases.least[lane]));
    return phases.gain[lane] / (square * sqrt(square));
}

// Adds the light of a step towards the eye for light from the direction `light`, of which this share arrives.
fn add_scattered(light: vec3f, ray: Ray, step: Step, share: Share, source: ptr<function, array<vec4f, LANES>>) {
    scatter(step, turns(ray.view, light), share, source);
}
