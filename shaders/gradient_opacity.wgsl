// Factor on the opacity by the gradient magnitude. Part of `march.wgsl`; `thin` is in `grey.wgsl` and `coloured.wgsl`.
// Twin of `reference::gradient`.

// `tables::GradientTable`.
@group(0) @binding(12) var<uniform> gradient_table: array<vec4f, GRADIENT_PIECES + 1u>;

fn gradient_factor(gradient: vec3f) -> f32 {
    let magnitude = sqrt(dot(gradient, gradient));
    var factor = gradient_table[0].x;
    for (var i = 1u; i <= GRADIENT_PIECES; i += 1u) {
        let piece = gradient_table[i];
        factor = fma(clamp((magnitude - piece.x) * piece.y, 0.0, 1.0), piece.z, factor);
    }
    return factor;
}
