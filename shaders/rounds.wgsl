// March of a volume in bricks, in rounds: a ray goes on until it ends or the next brick is missing. It then states which
// brick it wants, and keeps its sums, its transmittance and the number of its next sample for the next round. Part of
// `march.wgsl`.

// Slot of each brick in the pool plus 1, x in bits 0 to 9, y in 10 to 19, z in 20 to 29; 0 if the brick is missing.
@group(0) @binding(20) var<storage, read> pages: array<u32>;
// Next sample of each pixel; FINISHED if there is none.
@group(0) @binding(21) var<storage, read_write> next_samples: array<u32>;
// First and last row with a waiting ray, smallest number of a sample that a ray waits at; then a bit for each wanted brick.
@group(0) @binding(22) var<storage, read_write> wanted: array<atomic<u32>>;

const FINISHED: u32 = 0xffffffffu;
const WANTED_BITS: u32 = 3u;

@compute @workgroup_size(GROUP_WIDTH, GROUP_HEIGHT)
fn main(@builtin(global_invocation_id) id: vec3u) {
    march = march_uniform;
    read_planes();
    read_fields();
    bricks = bricks_uniform;
    read_light();
    let pixel = vec2u(id.x, id.y + band.first_row);
    if (pixel.x >= march.width || pixel.y >= march.height) {
        return;
    }
    let ray = ray_through(pixel);
    let at = pixel.y * march.width + pixel.x;
    let first = next_samples[at];
    // A ray of an earlier slice waits for the next round.
    if (first < band.first_sample || first >= band.end_sample) {
        return;
    }
    var sums: array<vec4f, LAYERS>;
    var transmittance = all_light();
    if (BLOCK) {
        // Written before the march: nothing yet, or the film of the blocks in front.
        load_sums(pixel, &sums);
        transmittance = load_transmittance_from(pixel, 0u);
    } else {
        if (first > 0u) {
            for (var layer = 0u; layer < LAYERS_USED; layer += 1u) {
                sums[layer] = film_layer(pixel, layer);
            }
            transmittance = load_transmittance_from(pixel, 0u);
        }
    }
    if (KEEPS_MORE) {
        if (first > 0u) {
            load_more(pixel);
        }
    }
    var own = vec2u(0u, ray.samples);
    if (BLOCK) {
        own = within_block(ray);
    }
    let end = min(own.y, band.end_sample);
    let samples_per_cell = 1.0 / (max(abs(ray.direction * march.cell_scale), vec3f(1e-30)) * march.step_length);
    let forward = select(vec3f(), vec3f(1.0), ray.direction > vec3f());
    let last_cell = vec3f(march.cells) - 1.0;
    var n = first;
    if (BLOCK) {
        n = select(max(n, own.x), end, brightest(transmittance) < march.termination);
    }
    var dark = false;
    var missing = FINISHED;
    loop {
        // Skips to the next sample in an occupied macrocell.
        var leave = n;
        var cell: vec3f;
        loop {
            if (n >= end) { break; }
            let cells = fma(place_of(ray, n), march.cell_scale, march.cell_offset);
            cell = clamp(floor(cells), vec3f(), last_cell);
            let ahead = abs(cell + forward - cells) * samples_per_cell;
            leave = n + max(1u, u32(ceil(min(min(ahead.x, ahead.y), min(ahead.z, 1e6)))));
            if (SKIPPING) {
                if (is_occupied(cell)) { break; }
                n = leave;
            } else {
                break;
            }
        }
        if (n >= end) { break; }
        let brick = vec3u(cell) / BRICK_CELLS;
        let index = brick.x + bricks.counts.x * (brick.y + bricks.counts.y * brick.z);
        let page = pages[index];
        if (page == 0u) {
            missing = index;
            break;
        }
        let slot = (vec3u(page - 1u) >> vec3u(0u, 10u, 20u)) & vec3u(1023u);
        brick_shift = vec3f(slot * SLOT_EDGE + APRON) - vec3f(brick * BRICK);
        leave = min(leave, end);
        transmittance = march_run(ray, n, leave, transmittance, &sums);
        n = leave;
        dark = brightest(transmittance) < march.termination;
        if (dark) { break; }
    }
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
    // Samples skipped beyond the slice are empty, and the next slice skips them again.
    let next = min(n, end);
    next_samples[at] = select(next, FINISHED, dark || next >= own.y);
    if (missing != FINISHED) {
        atomicMin(&wanted[0], pixel.y);
        atomicMax(&wanted[1], pixel.y);
        atomicMin(&wanted[2], n);
        atomicOr(&wanted[WANTED_BITS + missing / 32u], 1u << (missing % 32u));
    }
}
