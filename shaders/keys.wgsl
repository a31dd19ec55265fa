// Texel, coordinate and label of a sample, read before its medium, and a test of its visibility. Part of `march.wgsl`.

// Texel, table coordinate and label of a sample.
struct Key {
    texel: vec4f,
    fields: FieldValues,
    coordinate: f32,
    // 0 without a label.
    label: u32,
}

fn key_at(place: vec3f) -> Key {
    let texel = fetch(place);
    let coordinate = clamp(fma(value_of(texel), march.coordinate_scale, march.coordinate_offset), 0.0, march.coordinate_last);
    var label = 0u;
    if (LABELS) {
        label = label_at(place);
    }
    var fields = FieldValues(texel, vec4f(1.0));
    if (PLACED > 0u) {
        fields = values_at(texel, place);
    }
    return Key(texel, fields, coordinate, label);
}

// True if the sample can be visible.
fn is_active(key: Key) -> bool {
    if (SEVERAL_FIELDS) {
        let above = key.fields.values > march.active_lows;
        let below = key.fields.values < march.active_highs;
        return any(above & below & (key.fields.there > vec4f())) || key.label > 0u;
    }
    return (march.active_low < key.coordinate && key.coordinate < march.active_high) || key.label > 0u;
}
