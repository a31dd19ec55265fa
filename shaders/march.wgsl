// Marches rays through the volume front to back, and writes accumulators and transmittance. No light spectrum enters
// them.
// The reflected light of a step is in `weights.wgsl` or `spectral.wgsl`, its transmittance in `grey.wgsl`,
// `coloured.wgsl`, the memory of its tables in `tables_storage.wgsl` or `tables_uniform.wgsl`, the
// factors on its medium by the gradient magnitude in `factors.wgsl`, and the integration of a run of steps in
// `samples.wgsl` or `refined.wgsl`, with `keys.wgsl` and `samples_of_steps.wgsl` or `samples_of_groups.wgsl`, in `segments.wgsl` with `segments_grey.wgsl` or
// `segments_coloured.wgsl`, or in `extremes.wgsl`; the medium as densities is in `densities.wgsl`, with `densities_grey.wgsl` or `densities_coloured.wgsl`, and `table_of_groups.wgsl`; what a ray keeps from slice to slice beside its film is in `sums.wgsl` or `extremes.wgsl`. The film is in `film_images.wgsl` or `film_buffers.wgsl`, the rays are in
// `rays.wgsl`, the values between voxels in `fetch.wgsl`, the light in `light.wgsl`, its part that arrives in `share_grey.wgsl`
// or `share_coloured.wgsl`, that of phase functions in `phase.wgsl`, with `phase_weights.wgsl` or `phase_spectral.wgsl`, that of
// thin films in `thin_film.wgsl`, and the entry point in `slices.wgsl` for a whole volume or in `rounds.wgsl` for one in bricks.
// Twin of `reference::march` and `reference::samples`. Constants in capitals come from the plan; branches on them are
// resolved before the shader is compiled.

// `base^exponent` by repeated squaring, lowest bit first. Unrolled, because a loop would count against the iterations
// that some devices allow per invocation.
fn power(base: f32, exponent: u32) -> f32 {
    var result = 1.0;
    var square = base;
    if (EXPONENT_BITS > 0u) { result *= select(1.0, square, (exponent & 1u) != 0u); square *= square; }
    if (EXPONENT_BITS > 1u) { result *= select(1.0, square, (exponent & 2u) != 0u); square *= square; }
    if (EXPONENT_BITS > 2u) { result *= select(1.0, square, (exponent & 4u) != 0u); square *= square; }
    if (EXPONENT_BITS > 3u) { result *= select(1.0, square, (exponent & 8u) != 0u); square *= square; }
    if (EXPONENT_BITS > 4u) { result *= select(1.0, square, (exponent & 16u) != 0u); square *= square; }
    if (EXPONENT_BITS > 5u) { result *= select(1.0, square, (exponent & 32u) != 0u); square *= square; }
    if (EXPONENT_BITS > 6u) { result *= select(1.0, square, (exponent & 64u) != 0u); square *= square; }
    if (EXPONENT_BITS > 7u) { result *= select(1.0, square, (exponent & 128u) != 0u); square *= square; }
    if (EXPONENT_BITS > 8u) { result *= select(1.0, square, (exponent & 256u) != 0u); square *= square; }
    if (EXPONENT_BITS > 9u) { result *= select(1.0, square, (exponent & 512u) != 0u); square *= square; }
    if (EXPONENT_BITS > 10u) { result *= select(1.0, square, (exponent & 1024u) != 0u); }
    return result;
}

// What rounding took from the sums and the transmittance so far, if the plan compensates for it.
var<private> lost_sums: array<vec4f, LAYERS>;
var<private> lost_transmittance: Transmittance;

// `sum` as it is rounded: without this, compilers may cancel a sum against its parts.
fn rounded(sum: vec4f) -> vec4f {
    // Fewer samples than 2²⁴, so nothing changes.
    return bitcast<vec4f>(bitcast<vec4u>(sum) ^ vec4u(march.samples >> 24u));
}

// Adds one premultiplied sample front to back, `A += T·s`.
fn composite(
    sums: ptr<function, array<vec4f, LAYERS>>,
    first: u32,
    source: array<vec4f, LANES>,
    transmittance: Transmittance,
) {
    for (var lane = 0u; lane < LANES; lane += 1u) {
        let sum = (*sums)[first + lane];
        if (COMPENSATED) {
            let term = received(transmittance, lane, source, -lost_sums[first + lane]);
            let total = rounded(sum + term);
            lost_sums[first + lane] = (total - sum) - term;
            (*sums)[first + lane] = total;
        } else {
            (*sums)[first + lane] = received(transmittance, lane, source, sum);
        }
    }
}

// Loads the sums of a block's rays.
fn load_sums(pixel: vec2u, sums: ptr<function, array<vec4f, LAYERS>>) {
    for (var layer = 0u; layer < LAYERS_USED; layer += 1u) {
        (*sums)[layer] = film_layer(pixel, layer);
    }
}
