// Point samples of a whole volume: steps that a face of the crop box cuts are added apart, before and behind the others. Part of
// `march.wgsl`. Their opacities take a power, which a software device, that branches at the ends of loops only, would otherwise compute for
// every step.

// Marches the samples from `first` to before `end`, or until early termination; returns the transmittance.
fn march_steps(
    ray: Ray,
    first: u32,
    end: u32,
    before: Transmittance,
    sums: ptr<function, array<vec4f, LAYERS>>,
) -> Transmittance {
    var transmittance = before;
    // A cut first step in an empty macrocell adds nothing.
    let begins = first == 0u && end > 0u && is_cut(ray, 0u);
    var adds = begins;
    if (SKIPPING) {
        let cells = fma(place_of(ray, 0u), march.cell_scale, march.cell_offset);
        adds = begins && is_occupied(clamp(floor(cells), vec3f(), vec3f(march.cells) - 1.0));
    }
    var n = select(first, 1u, begins && !adds);
    let last = ray.samples - 1u;
    let last_cut = min(end, select(ray.samples, last, is_cut(ray, last)));
    // In a first turn the first step alone, if it is cut, in another one all others.
    var turn = select(1u, 0u, adds);
    loop {
        let after = march_whole(ray, n, select(n, last_cut, turn == 1u), transmittance, sums);
        transmittance = after.transmittance;
        n = select(after.n, end, brightest(transmittance) < march.termination);
        if (n < end && n == select(0u, last, turn == 1u) && is_cut(ray, n)) {
            let place = place_of(ray, n);
            let part = part_of(ray, n);
            let step = medium_at(place, key_at(place));
            transmittance = add_part(ray, place, step, part.y - part.x, transmittance, sums);
            n = select(n + 1u, end, brightest(transmittance) < march.termination);
        }
        if (turn == 1u) { break; }
        turn = 1u;
    }
    return transmittance;
}

fn is_cut(ray: Ray, n: u32) -> bool {
    let part = part_of(ray, n);
    return part.y - part.x < 1.0;
}
