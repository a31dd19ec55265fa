// Rounding errors that a ray keeps between slices beside its film, if all of its steps are seen. Part of `march.wgsl`.

fn load_more(pixel: vec2u) {
    for (var layer = 0u; layer < LAYERS_USED; layer += 1u) {
        lost_sums[layer] = film_layer(pixel, LAYERS + layer);
    }
    lost_transmittance = load_transmittance_from(pixel, TRANSMITTANCE_LANES);
}

fn store_more(pixel: vec2u) {
    for (var layer = 0u; layer < LAYERS_USED; layer += 1u) {
        set_film_layer(pixel, LAYERS + layer, lost_sums[layer]);
    }
    store_transmittance_to(pixel, TRANSMITTANCE_LANES, lost_transmittance);
}
