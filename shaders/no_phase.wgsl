// In place of `phase.wgsl` in plans without phase functions. Branches that call these functions are not compiled; with the
// declarations of `phase.wgsl`, other parts of the module would be in another order.

fn read_phases() {
}

fn scattered_from(light: vec3f, ray: Ray, step: Step, reached: f32) -> array<vec4f, LANES> {
    return unshaded(step);
}

fn scattered_from_three(position: u32, ray: Ray, step: Step, reached: vec3f) -> array<vec4f, LANES> {
    return unshaded(step);
}
