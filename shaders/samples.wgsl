// Integration by point samples, one in the middle of each step. Twin of `reference::march` and `Samples::sample`. Part of
// `march.wgsl`.

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
        (*step).opacity = opacity_between(i, fraction);
    }
}

// Texel, table coordinate and label of a sample.
struct Key {
    texel: vec4f,
    coordinate: f32,
    // 0 without a label.
    label: u32,
}

fn key_at(place: vec3f) -> Key {
    let texel = fetch(place);
    var value = texel.x;
    if (STORED_GRADIENT) {
        value = texel.w;
    }
    let coordinate = clamp(fma(value, march.coordinate_scale, march.coordinate_offset), 0.0, march.coordinate_last);
    var label = 0u;
    if (LABELS) {
        label = label_at(place);
    }
    return Key(texel, coordinate, label);
}

// Whether the sample can be visible.
fn is_active(key: Key) -> bool {
    return (march.active_low < key.coordinate && key.coordinate < march.active_high) || key.label > 0u;
}

// Decoded differences along the volume's own axes.
fn decoded_gradient(place: vec3f, key: Key) -> vec3f {
    var difference: vec3f;
    if (STORED_GRADIENT) {
        difference = key.texel.xyz;
    } else {
        difference = central_difference(place);
    }
    return difference * march.gradient_scale;
}

fn sample(place: vec3f, key: Key) -> Step {
    var step: Step;
    if (GRADIENT_OPACITY) {
        let gradient = decoded_gradient(place, key);
        step.normal = unit(gradient);
        look_up(key.coordinate, &step);
        step = thin(step, gradient_factor(gradient));
    } else {
        if (STORED_GRADIENT) {
            step.normal = unit(key.texel.xyz * march.gradient_scale);
        } else if (GRADIENT) {
            step.normal = unit(central_difference(place) * march.gradient_scale);
        }
        look_up(key.coordinate, &step);
    }
    if (SMOOTH_LABELS) {
        step = shared_by_labels(place, key.label, step);
    } else if (LABELS) {
        if (key.label > 0u) {
            for (var lane = 0u; lane < TABLE_LANES; lane += 1u) {
                step.source[lane] = label_source[key.label * TABLE_LANES + lane];
            }
            step.opacity = opacity_of_label(key.label);
        }
    }
    return step;
}

// Adds the contribution of sample `n` of a run, at `place`; returns the transmittance after it.
fn add_sample(
    ray: Ray,
    n: u32,
    place: vec3f,
    key: Key,
    transmittance: Transmittance,
    sums: ptr<function, array<vec4f, LAYERS>>,
) -> Transmittance {
    var step = sample(place, key);
    if (CUT_IN_RUNS) {
        let part = part_of(ray, n);
        step = thin(step, part.y - part.x);
    }
    add_light(ray, place, step, transmittance, sums);
    return attenuate(transmittance, step.opacity);
}

// Marches the samples from `first` to before `end`, or until early termination; returns the transmittance.
fn march_run(
    ray: Ray,
    first: u32,
    end: u32,
    before: Transmittance,
    sums: ptr<function, array<vec4f, LAYERS>>,
) -> Transmittance {
    var transmittance = before;
    if (SKIP_INVISIBLE) {
        var n = first;
        loop {
            // Advances to the next sample that can be visible, in a loop of its own: some devices branch only at the
            // end of a loop, and would otherwise execute the code after an `if` in vain.
            var key: Key;
            var found = false;
            loop {
                if (n >= end) { break; }
                key = key_at(place_in_run(ray, n));
                n += 1u;
                found = is_active(key);
                if (found) { break; }
            }
            if (!found) { break; }
            transmittance = add_sample(ray, n - 1u, place_in_run(ray, n - 1u), key, transmittance, sums);
            if (brightest(transmittance) < march.termination) { break; }
        }
    } else {
        for (var n = first; n < end; n += 1u) {
            let place = place_in_run(ray, n);
            transmittance = add_sample(ray, n, place, key_at(place), transmittance, sums);
            if (brightest(transmittance) < march.termination) { break; }
        }
    }
    return transmittance;
}
