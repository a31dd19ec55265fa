// The transfer table as densities of groups of terms. Part of `march.wgsl`.

// Adds the density of a `group` at a table coordinate, times `factor`.
fn add_group(group: u32, coordinate: f32, factor: f32, step: ptr<function, Step>) {
    let i = select(min(u32(coordinate), u32(march.coordinate_last) - 1u), u32(coordinate + 0.5), NEAREST_LOOKUP);
    let fraction = coordinate - f32(i);
    let entry = i * GROUPS + group;
    for (var lane = 0u; lane < TABLE_LANES; lane += 1u) {
        var source = table_source[entry * TABLE_LANES + lane];
        if (!NEAREST_LOOKUP) {
            let after = table_source[(entry + GROUPS) * TABLE_LANES + lane];
            source = fma(vec4f(fraction), after - source, source);
        }
        (*step).source[lane] = fma(vec4f(factor), source, (*step).source[lane]);
    }
    var depth: Transmittance;
    if (NEAREST_LOOKUP) {
        depth = opacity_at(entry);
    } else {
        depth = opacity_between(entry, entry + GROUPS, fraction);
    }
    (*step).opacity = plus_share((*step).opacity, factor, depth);
}
