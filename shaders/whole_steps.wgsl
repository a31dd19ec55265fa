// Steps of a whole volume that runs cut themselves: segments, and samples of which the extreme values are seen. Part of `march.wgsl`.

// Marches the steps from `first` to before `end`, or until early termination; returns the transmittance.
fn march_steps(
    ray: Ray,
    first: u32,
    end: u32,
    before: Transmittance,
    sums: ptr<function, array<vec4f, LAYERS>>,
) -> Transmittance {
    return march_whole(ray, first, end, before, sums).transmittance;
}
