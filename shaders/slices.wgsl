// March of a whole volume: a slice of each ray in each dispatch. Part of `march.wgsl`.

@compute @workgroup_size(GROUP_WIDTH, GROUP_HEIGHT)
fn main(@builtin(global_invocation_id) id: vec3u) {
    march = march_uniform;
    read_planes();
    read_fields();
    read_light();
    let pixel = vec2u(id.x, id.y + band.first_row);
    if (pixel.x >= march.width || pixel.y >= march.height) {
        return;
    }
    let ray = ray_through(pixel);
    var sums: array<vec4f, LAYERS>;
    var transmittance = all_light();
    if (BLOCK) {
        // Written before the march: nothing yet, or the film of the blocks in front.
        load_sums(pixel, &sums);
        transmittance = load_transmittance_from(pixel, 0u);
    } else {
        if (band.first_sample > 0u) {
            for (var layer = 0u; layer < LAYERS_USED; layer += 1u) {
                sums[layer] = film_layer(pixel, layer);
            }
            transmittance = load_transmittance_from(pixel, 0u);
        }
    }
    if (KEEPS_MORE) {
        if (band.first_sample > 0u) {
            load_more(pixel);
        }
    }
    var end = min(ray.samples, band.end_sample);
    var n = band.first_sample;
    if (BLOCK) {
        let own = within_block(ray);
        n = max(n, own.x);
        end = min(end, own.y);
    }
    end = select(end, 0u, brightest(transmittance) < march.termination);
    transmittance = march_steps(ray, n, end, transmittance, &sums);
    if (FINISHES) {
        transmittance = finished(ray, transmittance, &sums);
    }
    for (var layer = 0u; layer < LAYERS_USED; layer += 1u) {
        set_film_layer(pixel, layer, sums[layer]);
    }
    store_transmittance_to(pixel, 0u, transmittance);
    if (KEEPS_MORE) {
        store_more(pixel);
    }
}

// A ray so far.
struct Marched {
    // Next sample.
    n: u32,
    transmittance: Transmittance,
}

// Marches the samples from `first` to before `end`, or until early termination, in occupied macrocells.
fn march_whole(
    ray: Ray,
    first: u32,
    end: u32,
    before: Transmittance,
    sums: ptr<function, array<vec4f, LAYERS>>,
) -> Marched {
    var transmittance = before;
    var n = first;
    if (SKIPPING) {
        // Samples per macrocell along each axis.
        let samples_per_cell = 1.0 / (max(abs(ray.direction * march.cell_scale), vec3f(1e-30)) * march.step_length);
        let forward = select(vec3f(), vec3f(1.0), ray.direction > vec3f());
        let last_cell = vec3f(march.cells) - 1.0;
        loop {
            // Skips to the next sample in an occupied macrocell.
            var leave = n;
            loop {
                if (n >= end) { break; }
                let cells = fma(place_in_run(ray, n), march.cell_scale, march.cell_offset);
                let cell = clamp(floor(cells), vec3f(), last_cell);
                let ahead = abs(cell + forward - cells) * samples_per_cell;
                leave = n + max(1u, u32(ceil(min(min(ahead.x, ahead.y), min(ahead.z, 1e6)))));
                if (is_occupied(cell)) { break; }
                n = leave;
            }
            if (n >= end) { break; }
            leave = min(leave, end);
            transmittance = march_run(ray, n, leave, transmittance, sums);
            n = select(leave, end, brightest(transmittance) < march.termination);
        }
    } else {
        transmittance = march_run(ray, n, end, transmittance, sums);
        n = max(n, end);
    }
    return Marched(n, transmittance);
}
