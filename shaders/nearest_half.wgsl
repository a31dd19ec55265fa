// The nearest 16-bit float, as in `store.wgsl`.
fn nearest(number: f32) -> f32 {
    let bits = bitcast<u32>(number);
    let normal = bitcast<f32>((bits + 0xfffu + ((bits >> 13u) & 1u)) & 0xffffe000u);
    let small = round(number * 16777216.0) * 5.9604644775390625e-8;
    return select(normal, small, number < 6.103515625e-5);
}
