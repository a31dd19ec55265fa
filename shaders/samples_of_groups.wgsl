// The transfer table of samples as densities of groups of terms, which have factors of their own. Part of `march.wgsl`.

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
        let i = select(min(u32(coordinate), u32(march.coordinate_last) - 1u), u32(coordinate + 0.5), NEAREST_LOOKUP);
        let fraction = coordinate - f32(i);
        var factor = 1.0;
        if (BY_GRADIENT) {
            factor = factor_at(magnitude, group);
        }
        if (PLACED > 0u) {
            factor *= of_field(fields.there, group);
        }
        let entry = i * GROUPS + group;
        for (var lane = 0u; lane < TABLE_LANES; lane += 1u) {
            var source = table_source[entry * TABLE_LANES + lane];
            if (!NEAREST_LOOKUP) {
                let after = table_source[(entry + GROUPS) * TABLE_LANES + lane];
                source = fma(vec4f(fraction), after - source, source);
            }
            (*step).source[lane] = fma(vec4f(factor), source, (*step).source[lane]);
        }
        var depth: Transmittance;
        if (NEAREST_LOOKUP) {
            depth = opacity_at(entry);
        } else {
            depth = opacity_between(entry, entry + GROUPS, fraction);
        }
        (*step).opacity = plus_share((*step).opacity, factor, depth);
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
