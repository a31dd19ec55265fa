// Opacities of parts of a step, and of media that a factor thins. Part of `march.wgsl`; `thin` is in `grey.wgsl` and `coloured.wgsl`.
// Twin of `reference::factors`.

// 1 − e^(−depth), with the relative precision of f32 near 0: 2^f − 1 by its series, |f| ≤ ½.
fn lost(depth: vec4f) -> vec4f {
    let x = clamp(depth, vec4f(-80.0), vec4f(80.0)) * -1.4426950408889634;
    let whole = round(x);
    let f = x - whole;
    var series = fma(f, vec4f(1.5252734e-5), vec4f(1.5403530e-4));
    series = fma(f, series, vec4f(1.3333558e-3));
    series = fma(f, series, vec4f(9.6181291e-3));
    series = fma(f, series, vec4f(5.5504109e-2));
    series = fma(f, series, vec4f(2.4022651e-1));
    series = fma(f, series, vec4f(6.9314718e-1));
    let scale = bitcast<vec4f>((vec4i(whole) + 127) << vec4u(23u));
    return fma(-scale, f * series, 1.0 - scale);
}

// Optical depth −ln(1 − opacity), with the relative precision of f32 near 0: 1 − opacity = 2^exponent · (1 + part) with part from √½ − 1
// to √2 − 1, whose logarithm is 2·artanh(part / (2 + part)).
fn depth_of_opacity(opacity: vec4f) -> vec4f {
    let bits = bitcast<vec4i>(1.0 - opacity) + vec4i(0x4afb0d);
    let exponent = (bits >> vec4u(23u)) - vec4i(127);
    let mantissa = bitcast<vec4f>((bits & vec4i(0x7fffff)) + vec4i(0x3f3504f3));
    // The difference from 1 has lost digits where there is no exponent.
    let part = select(mantissa - 1.0, -opacity, exponent == vec4i());
    let z = part / (2.0 + part);
    let square = z * z;
    var series = fma(square, vec4f(0.11111111), vec4f(0.14285715));
    series = fma(square, series, vec4f(0.2));
    series = fma(square, series, vec4f(0.33333334));
    let logarithm = fma(2.0 * z * square, series, 2.0 * z);
    return fma(vec4f(exponent), vec4f(-0.6931472), -logarithm);
}

// α'/α for α' = 1 − (1 − α)^f, f from 0 to below 1; f if α is 0.
fn thinning(opacity: vec4f, factor: f32) -> vec4f {
    let ratio = lost(factor * depth_of_opacity(opacity)) / opacity;
    let thin = select(ratio, vec4f(factor), opacity < vec4f(1e-30));
    return select(select(thin, vec4f(1.0), opacity >= vec4f(1.0)), vec4f(), factor <= 0.0);
}
