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

// Copies the uniforms, once per invocation.
fn read_phases() {
    shading = shading_uniform;
    phases = phases_uniform;
}

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

// Light of a step towards the eye for light from the direction `light`, of which the fraction `reached` arrives.
fn scattered_from(light: vec3f, ray: Ray, step: Step, reached: f32) -> array<vec4f, LANES> {
    return scattered(step, turns(ray.view, light), reached);
}

// Light of a step towards the eye for a three-point light, of whose directions these fractions arrive.
fn scattered_from_three(position: u32, ray: Ray, step: Step, reached: vec3f) -> array<vec4f, LANES> {
    // THREE_POINT_PARTS of src/scene/lights.rs.
    let parts = reached * vec3f(18.0, 2.0, 3.0) / 23.0;
    let key = scattered_from(shading.lights[position].xyz, ray, step, parts.x);
    let fill = scattered_from(shading.lights[position + 1u].xyz, ray, step, parts.y);
    let rim = scattered_from(shading.lights[position + 2u].xyz, ray, step, parts.z);
    var source: array<vec4f, LANES>;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        source[lane] = key[lane] + fill[lane] + rim[lane];
    }
    return source;
}
