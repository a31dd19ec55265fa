// Segments of a whole volume. Part of `march.wgsl`.

// Marches the segments from `first` to before `end`, or until early termination; returns the transmittance.
fn march_steps(
    ray: Ray,
    first: u32,
    end: u32,
    before: Transmittance,
    sums: ptr<function, array<vec4f, LAYERS>>,
) -> Transmittance {
    return march_whole(ray, first, end, before, sums).transmittance;
}
