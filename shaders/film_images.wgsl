// The film in storage images, and the band of a dispatch in its command. Part of `march.wgsl`; `film_buffers.wgsl` has the same for browsers.

@group(0) @binding(10) var accumulators: texture_storage_2d_array<rgba32float, read_write>;
@group(0) @binding(11) var transmittances: TransmittanceImage;
var<immediate> band: Band;

fn film_layer(pixel: vec2u, layer: u32) -> vec4f {
    return textureLoad(accumulators, pixel, layer);
}

fn set_film_layer(pixel: vec2u, layer: u32, sums: vec4f) {
    textureStore(accumulators, pixel, layer, sums);
}

// A grey transmittance is the first number.
fn film_transmittance(pixel: vec2u, layer: u32) -> vec4f {
    return textureLoad(transmittances, pixel, layer);
}

fn set_film_transmittance(pixel: vec2u, layer: u32, transmittance: vec4f) {
    textureStore(transmittances, pixel, layer, transmittance);
}
