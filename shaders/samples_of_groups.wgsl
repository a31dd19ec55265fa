// The medium of a sample as densities of groups of terms, which have factors of their own. Part of `march.wgsl`.

// Reads the sum of the densities of a sample, times their factors where the data have this `gradient`.
fn look_up(place: vec3f, key: Key, gradient: vec3f, step: ptr<function, Step>) {
    let magnitude = sqrt(dot(gradient, gradient));
    var fields = FieldValues(key.texel, vec4f(1.0));
    if (PLACED > 0u) {
        fields = values_at(key.texel, place);
    }
    for (var group = 0u; group < GROUPS; group += 1u) {
        var coordinate = key.coordinate;
        if (SEVERAL_FIELDS) {
            coordinate = coordinate_of(fields.values, group, march.coordinate_last);
        }
        var factor = 1.0;
        if (BY_GRADIENT) {
            factor = factor_at(magnitude, group);
        }
        if (PLACED > 0u) {
            factor *= of_field(fields.there, group);
        }
        add_group(group, coordinate, factor, step);
    }
}

fn medium_at(place: vec3f, key: Key) -> Step {
    var gradient = vec3f();
    if (STORED_GRADIENT) {
        gradient = key.texel.xyz * march.gradient_scale;
    } else if (GRADIENT) {
        gradient = central_difference(place) * march.gradient_scale;
    }
    var step: Step;
    step.normal = unit(capped(gradient, value_of(key.texel), place));
    look_up(place, key, gradient, &step);
    return step;
}

// The effect of a medium of this density over a `length`, in steps.
fn part_of_step(density: Step, length: f32) -> Step {
    return across(density, length);
}
