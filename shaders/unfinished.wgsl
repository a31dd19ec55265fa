// The end of a ray whose steps are all in its sums. Part of `march.wgsl`.

fn finished(ray: Ray, transmittance: Transmittance, sums: ptr<function, array<vec4f, LAYERS>>) -> Transmittance {
    return transmittance;
}
