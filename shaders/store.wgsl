// Stores finished accumulators as 16-bit floats. Twin of `reference::store`.

@group(0) @binding(0) var finished: texture_storage_2d_array<rgba32float, read>;
@group(0) @binding(1) var stored: texture_storage_2d_array<rgba16float, write>;

// The nearest 16-bit float, ties to even. A device may round numbers of more bits as it likes when it stores them.
fn nearest(number: vec4f) -> vec4f {
    let bits = bitcast<vec4u>(number);
    let normal = bitcast<vec4f>((bits + 0xfffu + ((bits >> vec4u(13u)) & vec4u(1u))) & vec4u(0xffffe000u));
    // Below 2⁻¹⁴, 16-bit floats are multiples of 2⁻²⁴.
    let small = round(number * 16777216.0) * 5.9604644775390625e-8;
    return select(normal, small, abs(number) < vec4f(6.103515625e-5));
}

@compute @workgroup_size(GROUP_WIDTH, 1)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (id.x < textureDimensions(stored).x) {
        textureStore(stored, id.xy, id.z, nearest(textureLoad(finished, id.xy, id.z)));
    }
}
