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

fn term(series: vec4f, part: vec4f, factor: f32, n: f32) -> vec4f {
    return fma(series * part, vec4f((n - factor) / (n + 1.0)), vec4f(1.0));
}

fn square(thin: vec4f) -> vec4f {
    return thin * (2.0 - thin);
}

// α'/α for α' = 1 − (1 − α)^f, f from 0 to below 1. Without loops, like `power`.
fn thinning(opacity: vec4f, factor: f32) -> vec4f {
    var left = sqrt(1.0 - opacity);
    var part = opacity / (1.0 + left);
    left = sqrt(left); part /= 1.0 + left;
    left = sqrt(left); part /= 1.0 + left;
    left = sqrt(left); part /= 1.0 + left;
    left = sqrt(left); part /= 1.0 + left;
    left = sqrt(left); part /= 1.0 + left;
    var series = term(vec4f(1.0), part, factor, 7.0);
    series = term(series, part, factor, 6.0);
    series = term(series, part, factor, 5.0);
    series = term(series, part, factor, 4.0);
    series = term(series, part, factor, 3.0);
    series = term(series, part, factor, 2.0);
    series = term(series, part, factor, 1.0);
    let thin = square(square(square(square(square(square(factor * part * series))))));
    let ratio = select(thin / opacity, vec4f(factor), opacity < vec4f(1e-30));
    return select(select(ratio, vec4f(1.0), opacity >= vec4f(1.0)), vec4f(), factor <= 0.0);
}
