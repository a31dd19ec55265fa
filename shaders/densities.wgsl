// Densities of the medium: light scattered and optical depth per step length, in place of source and opacity of a `Step`. Part of
// `march.wgsl`. Twin of `reference::march::across`.

// Effect of a medium of this density over a `length`, in steps.
fn across(density: Step, length: f32) -> Step {
    var step = density;
    step.opacity = lost_light(scaled_depth(density.opacity, length));
    for (var lane = 0u; lane < TABLE_LANES; lane += 1u) {
        step.source[lane] = density.source[lane] * gain_of(step.opacity, density.opacity, length, lane);
    }
    return step;
}
