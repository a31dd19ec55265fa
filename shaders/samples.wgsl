// Integration by point samples, one in the middle of each step. Twin of `reference::march` and `Samples::sample`. Part of
// `march.wgsl`. The medium of a sample is in `samples_of_steps.wgsl`, or in `samples_of_groups.wgsl` where factors scale it.

// Adds the contribution of sample `n` of a run, at `place`; returns the transmittance after it.
fn add_sample(
    ray: Ray,
    n: u32,
    place: vec3f,
    key: Key,
    transmittance: Transmittance,
    sums: ptr<function, array<vec4f, LAYERS>>,
) -> Transmittance {
    if (BY_FIELD) {
        read_parts(ray, n);
    }
    let step = medium_at(place, key);
    if (CUT_IN_RUNS) {
        let part = part_of(ray, n);
        return add_part(ray, place, step, part.y - part.x, transmittance, sums);
    }
    return add_whole(ray, place, step, transmittance, sums);
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
            let place = place_in_run(ray, n - 1u);
            if (KEY_AGAIN) {
                key = key_at(place);
            }
            transmittance = add_sample(ray, n - 1u, place, key, transmittance, sums);
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
