// Cubic interpolation between four numbers. Twin of `reference::shadows`.

// Weights of four depths, of a place a part `t` of a space behind the second: those of a cubic, less `part` of the second
// difference, so that depths that are linear between nodes have the least error (docs/theory/shadows.md).
fn depth_weights(t: f32, part: f32) -> vec4f {
    let square = t * t;
    let cube = square * t;
    let inner = vec2f(fma(1.5, cube, fma(-2.5, square, 1.0)), fma(-1.5, cube, fma(2.0, square, 0.5 * t)));
    let cubic = vec4f(square - 0.5 * (t + cube), inner, 0.5 * (cube - square));
    let second = vec4f(1.0 - t, fma(3.0, t, -2.0), fma(-3.0, t, 1.0), t);
    return fma(vec4f(-part), second, cubic);
}

fn weighted(weights: vec4f, values: vec4f) -> f32 {
    let outer = weights.x * values.x + weights.w * values.w;
    return fma(weights.y, values.y, fma(weights.z, values.z, outer));
}
