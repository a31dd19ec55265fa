// The transfer table of samples as effects of steps. Part of `march.wgsl`.

// Reads source and opacity at `coordinate` in the table.
fn look_up(coordinate: f32, step: ptr<function, Step>) {
    if (NEAREST_LOOKUP) {
        let i = u32(coordinate + 0.5);
        for (var lane = 0u; lane < TABLE_LANES; lane += 1u) {
            (*step).source[lane] = table_source[i * TABLE_LANES + lane];
        }
        (*step).opacity = opacity_at(i);
    } else {
        let i = min(u32(coordinate), u32(march.coordinate_last) - 1u);
        let fraction = coordinate - f32(i);
        for (var lane = 0u; lane < TABLE_LANES; lane += 1u) {
            let source = table_source[i * TABLE_LANES + lane];
            let after = table_source[(i + 1u) * TABLE_LANES + lane];
            (*step).source[lane] = fma(vec4f(fraction), after - source, source);
        }
        (*step).opacity = opacity_between(i, i + 1u, fraction);
    }
}

fn medium_at(place: vec3f, key: Key) -> Step {
    var step: Step;
    if (STORED_GRADIENT) {
        step.normal = unit(capped(key.texel.xyz * march.gradient_scale, value_of(key.texel), place));
    } else if (GRADIENT) {
        step.normal = unit(capped(central_difference(place) * march.gradient_scale, value_of(key.texel), place));
    }
    look_up(key.coordinate, &step);
    return labelled(place, key.label, key.coordinate, step);
}

// Adds the part of a step of this `length`, in steps; returns the transmittance after it.
fn add_part(
    ray: Ray,
    place: vec3f,
    step: Step,
    length: f32,
    transmittance: Transmittance,
    sums: ptr<function, array<vec4f, LAYERS>>,
) -> Transmittance {
    return add_whole(ray, place, thin(step, length), transmittance, sums);
}

fn add_whole(
    ray: Ray,
    place: vec3f,
    step: Step,
    transmittance: Transmittance,
    sums: ptr<function, array<vec4f, LAYERS>>,
) -> Transmittance {
    add_light(ray, place, step, transmittance, sums);
    return attenuate(transmittance, step.opacity);
}
