// The film in storage buffers, layer by layer, and the band of a dispatch in a uniform: WebGPU has neither storage images of four floats that
// are read and written, nor numbers in commands. Part of `march.wgsl` for browsers.

@group(0) @binding(10) var<storage, read_write> accumulators: array<vec4f>;
@group(0) @binding(11) var<storage, read_write> transmittances: array<vec4f>;
@group(0) @binding(40) var<uniform> band: Band;

fn place_in_film(pixel: vec2u, layer: u32) -> u32 {
    return (layer * march.height + pixel.y) * march.width + pixel.x;
}

fn film_layer(pixel: vec2u, layer: u32) -> vec4f {
    return accumulators[place_in_film(pixel, layer)];
}

fn set_film_layer(pixel: vec2u, layer: u32, sums: vec4f) {
    accumulators[place_in_film(pixel, layer)] = sums;
}

fn film_transmittance(pixel: vec2u, layer: u32) -> vec4f {
    return transmittances[place_in_film(pixel, layer)];
}

fn set_film_transmittance(pixel: vec2u, layer: u32, transmittance: vec4f) {
    transmittances[place_in_film(pixel, layer)] = transmittance;
}
