// The largest or the smallest value of each field along a ray, in place of all its samples. Part of `march.wgsl`. Twin of
// `march_extremes` in `reference::march`.

// The value of a field that the ray has not met yet.
const UNMET: f32 = 3.4e38;

// Extreme values so far; of smallest ones the negatives.
var<private> extremes: vec4f = vec4f(-UNMET);

fn load_more(pixel: vec2u) {
    extremes = film_layer(pixel, LAYERS);
}

fn store_more(pixel: vec2u) {
    set_film_layer(pixel, LAYERS, extremes);
}

// Compares the samples from `first` to before `end`; returns the transmittance as it was.
fn march_run(
    ray: Ray,
    first: u32,
    end: u32,
    before: Transmittance,
    sums: ptr<function, array<vec4f, LAYERS>>,
) -> Transmittance {
    for (var n = first; n < end; n += 1u) {
        let place = place_in_run(ray, n);
        let texel = fetch(place);
        var found = FieldValues(texel, vec4f(1.0));
        if (PLACED > 0u) {
            found = values_at(texel, place);
        }
        let values = found.values * EXTREME_SIGN;
        extremes = select(extremes, max(extremes, values), found.there > vec4f());
    }
    return before;
}

// Sets the sums of a ray to the light of the media at its extreme values, an opacity length of each; returns their transmittance.
fn finished(ray: Ray, before: Transmittance, sums: ptr<function, array<vec4f, LAYERS>>) -> Transmittance {
    let met = select(vec4f(), vec4f(1.0), extremes > vec4f(-UNMET));
    let values = extremes * EXTREME_SIGN;
    var density: Step;
    for (var group = 0u; group < GROUPS; group += 1u) {
        add_group(group, coordinate_of(values, group, march.coordinate_last), of_field(met, group), &density);
    }
    let step = across(density, 1.0);
    *sums = array<vec4f, LAYERS>();
    add_light(ray, vec3f(), step, all_light(), sums);
    return attenuate(all_light(), step.opacity);
}
