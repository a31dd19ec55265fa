// The medium of a sample as densities of groups of terms, which have factors of their own. Part of `march.wgsl`.

// Adds the densities of the groups from `first` to before `end`, times their factors where the gradient has this `magnitude`.
fn add_groups(
    fields: FieldValues,
    key: Key,
    magnitude: f32,
    first: u32,
    end: u32,
    step: ptr<function, Step>,
) {
    for (var group = first; group < end; group += 1u) {
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
    let magnitude = sqrt(dot(gradient, gradient));
    var fields = FieldValues(key.texel, vec4f(1.0));
    if (PLACED > 0u) {
        fields = values_at(key.texel, place);
    }
    add_groups(fields, key, magnitude, 0u, FIRST_GROUPS, &step);
    step = labelled(place, key.label, key.coordinate, step);
    if (FIRST_GROUPS < GROUPS) {
        add_groups(fields, key, magnitude, FIRST_GROUPS, GROUPS, &step);
    }
    return step;
}

// The effect of a medium of this density over a `length`, in steps.
fn part_of_step(density: Step, length: f32) -> Step {
    return across(density, length);
}
