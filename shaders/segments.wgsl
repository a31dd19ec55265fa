// Integration in segments: means of the medium over the values between the ends of a segment, in closed form
// (docs/theory/segments.md). Twin of `reference::march` and `Samples::mean`. Part of `march.wgsl`.

struct Segments {
    // Unit of the table's integrals.
    unit: f32,
    // Variation from which a segment is divided.
    variation: f32,
}

@group(0) @binding(13) var<uniform> segments_uniform: Segments;

// The volume at an end of a segment.
struct End {
    texel: vec4f,
    coordinate: f32,
    // 0 without a label.
    label: u32,
}

// Integrals of the groups of terms at a table coordinate: at the first bound of its cell, and their differences to the next.
struct Integrals {
    source: array<vec4i, GROUP_LANES>,
    slope: array<vec4f, GROUP_LANES>,
    depth: array<DepthIntegral, GROUPS>,
    depth_slope: array<Transmittance, GROUPS>,
    // Place within the cell, 0 to 1.
    fraction: f32,
}

// Places of two ends in their cells, and the distance of their coordinates.
struct Between {
    fractions: vec2f,
    distance: f32,
}

// Mean medium between two ends.
struct Mean {
    density: Step,
    variation: f32,
}

// Distance of two coordinates below which the difference of the integrals would lose its digits.
const CLOSE: f32 = 0.0625;

// Place at a fraction of the part of segment `n` inside the crop box.
fn place_at(ray: Ray, n: u32, fraction: f32) -> vec3f {
    let part = part_of(ray, n);
    return place_within(ray, n, fma(part.y - part.x, fraction, part.x));
}

fn label_of(place: vec3f) -> u32 {
    var label = 0u;
    if (LABELS) {
        label = label_at(place);
    }
    return label;
}

fn end_at(place: vec3f) -> End {
    let texel = fetch(place);
    let coordinate = clamp(fma(value_of(texel), march.coordinate_scale, march.coordinate_offset), 0.0, march.coordinate_last);
    return End(texel, coordinate, label_of(place));
}

fn gradient_at(end: End, place: vec3f) -> vec3f {
    var gradient = vec3f();
    if (STORED_GRADIENT) {
        gradient = end.texel.xyz * march.gradient_scale;
    } else if (GRADIENT) {
        gradient = central_difference(place) * march.gradient_scale;
    }
    return gradient;
}

fn integrals_at(coordinate: f32) -> Integrals {
    let cell = min(u32(coordinate), u32(march.coordinate_last) - 1u);
    var integrals: Integrals;
    for (var lane = 0u; lane < GROUP_LANES; lane += 1u) {
        let here = bitcast<vec4i>(table_source[cell * GROUP_LANES + lane]);
        let next = bitcast<vec4i>(table_source[(cell + 1u) * GROUP_LANES + lane]);
        integrals.source[lane] = here;
        integrals.slope[lane] = vec4f(next - here);
    }
    for (var group = 0u; group < GROUPS; group += 1u) {
        let depth = depth_integral_at(cell * GROUPS + group);
        integrals.depth[group] = depth;
        integrals.depth_slope[group] = depth_difference(depth, depth_integral_at((cell + 1u) * GROUPS + group));
    }
    integrals.fraction = coordinate - f32(cell);
    return integrals;
}

// Mean between two places in the table: `whole` is the difference of the integrals at the bounds of their cells, `a` and
// `b` are the differences over the cells.
fn mean_of(whole: vec4f, a: vec4f, b: vec4f, between: Between) -> vec4f {
    let far = (whole + fma(vec4f(between.fractions.y), b, -(between.fractions.x * a))) / between.distance;
    return select(far, (a + b) * 0.5, abs(between.distance) < CLOSE);
}

// Mean between two ends, of the sum of the groups where the data have this `gradient`.
fn mean_between(a: Integrals, b: Integrals, distance: f32, gradient: vec3f) -> Mean {
    let between = Between(vec2f(a.fraction, b.fraction), distance);
    let unit = segments_uniform.unit;
    var magnitude = 0.0;
    if (FACTORS) {
        magnitude = sqrt(dot(gradient, gradient));
    }
    var density: Step;
    var most = 0.0;
    for (var group = 0u; group < GROUPS; group += 1u) {
        var factor = 1.0;
        if (FACTORS) {
            factor = factor_at(magnitude, group);
        }
        var of_source = vec4f();
        for (var lane = 0u; lane < TABLE_LANES; lane += 1u) {
            let i = group * TABLE_LANES + lane;
            let mean = mean_of(vec4f(b.source[i] - a.source[i]), a.slope[i], b.slope[i], between);
            of_source = max(of_source, abs(mean - a.slope[i]) + abs(b.slope[i] - mean));
            if (FACTORS) {
                density.source[lane] = fma(vec4f(factor), mean * unit, density.source[lane]);
            } else {
                density.source[lane] = mean * unit;
            }
        }
        let whole = depth_difference(a.depth[group], b.depth[group]);
        let depth = mean_depth(whole, a.depth_slope[group], b.depth_slope[group], between);
        let of_depth = depth_variation(depth, a.depth_slope[group], b.depth_slope[group]);
        most = max(most, max(max(max(of_source.x, of_source.y), max(of_source.z, of_source.w)), of_depth));
        if (FACTORS) {
            density.opacity = plus_share(density.opacity, factor, scaled_depth(depth, unit));
        } else {
            density.opacity = scaled_depth(depth, unit);
        }
    }
    return Mean(density, most * unit);
}

// Largest number of the scattered light.
fn most_scattered(density: Step) -> f32 {
    var most = vec4f();
    for (var lane = 0u; lane < TABLE_LANES; lane += 1u) {
        most = max(most, abs(density.source[lane]));
    }
    return max(max(most.x, most.y), max(most.z, most.w));
}

// Number of parts of segment `n`, from `a` to `b`: 1 to MOST_PARTS, not necessarily whole.
fn parts_between(ray: Ray, n: u32, a: End, b: End, turn: vec3f, mean: Mean) -> f32 {
    var variation = mean.variation;
    if (LABELS) {
        if (a.label != b.label || label_of(place_at(ray, n, 0.5)) != a.label || is_mixed(a.label)) {
            variation = 1.0;
        } else if (a.label > 0u) {
            variation = 0.0;
        }
    }
    if (GRADIENT) {
        variation = fma(sqrt(dot(turn, turn)), most_scattered(mean.density), variation);
    }
    return clamp(sqrt(min(variation, 1.0) / segments_uniform.variation), 1.0, MOST_PARTS);
}

// Whether a value between two ends can be visible.
fn is_active_between(a: End, b: End) -> bool {
    return (max(a.coordinate, b.coordinate) >= march.active_low && min(a.coordinate, b.coordinate) <= march.active_high)
        || LABELS;
}

// Marches the segments from `first` to before `end`, or until early termination; returns the transmittance.
//
// One loop for segments and their parts, with one fetch in each iteration: the first goes to the far end of the segment.
// If that shows that the segment is to be divided, the iteration adds nothing (its length is 0), and the following ones
// go from part to part. A software device would take twice as long for a loop of parts in a loop of segments.
fn march_run(
    ray: Ray,
    first: u32,
    end: u32,
    before: Transmittance,
    sums: ptr<function, array<vec4f, LAYERS>>,
) -> Transmittance {
    var transmittance = before;
    var a = end_at(place_at(ray, first, 0.0));
    var gradient = gradient_at(a, place_at(ray, first, 0.0));
    var integrals = integrals_at(a.coordinate);
    var n = first;
    // Parts of segment n, or 0 before they are known; the next part, and where it begins.
    var parts = 0.0;
    var part = 1.0;
    var done = 0.0;
    loop {
        var b: End;
        var reach = 1.0;
        if (SKIP_INVISIBLE) {
            // Advances to the next segment that can be visible, in a loop of its own: some devices branch only at the end
            // of a loop, and would otherwise execute the code after an `if` in vain.
            var skipped = false;
            loop {
                if (n >= end) { break; }
                reach = select(min(part / parts, 1.0), 1.0, parts == 0.0);
                b = end_at(place_at(ray, n, reach));
                if (parts > 0.0 || is_active_between(a, b)) { break; }
                a = b;
                skipped = true;
                n += 1u;
            }
            if (skipped) {
                gradient = gradient_at(a, place_at(ray, n, 0.0));
                integrals = integrals_at(a.coordinate);
            }
        } else {
            reach = select(min(part / parts, 1.0), 1.0, parts == 0.0);
            b = end_at(place_at(ray, n, reach));
        }
        if (n >= end) { break; }
        let next = place_at(ray, n, reach);
        let next_gradient = gradient_at(b, next);
        let next_integrals = integrals_at(b.coordinate);
        let half_way = (gradient + next_gradient) * 0.5;
        var mean = mean_between(integrals, next_integrals, b.coordinate - a.coordinate, half_way);
        let middle = place_at(ray, n, (done + reach) * 0.5);
        if (LABELS) {
            // Labels by value have no segments.
            mean.density = labelled(middle, label_of(middle), 0.0, mean.density);
        }
        let inside = part_of(ray, n);
        var length = (reach - done) * (inside.y - inside.x);
        var wanted = 0.0;
        if (parts == 0.0) {
            wanted = parts_between(ray, n, a, b, unit(next_gradient) - unit(gradient), mean);
            length = select(length, 0.0, wanted > 1.0);
        }
        var step = across(mean.density, length);
        if (GRADIENT) {
            step.normal = unit(capped(half_way, (value_of(a.texel) + value_of(b.texel)) * 0.5, middle));
        }
        add_light(ray, middle, step, transmittance, sums);
        transmittance = attenuate(transmittance, step.opacity);
        if (brightest(transmittance) < march.termination) { break; }
        if (wanted > 1.0) {
            parts = wanted;
            part = 1.0;
        } else {
            a = b;
            gradient = next_gradient;
            integrals = next_integrals;
            done = reach;
            part += 1.0;
            if (reach >= 1.0) {
                n += 1u;
                parts = 0.0;
                done = 0.0;
            }
        }
    }
    return transmittance;
}
