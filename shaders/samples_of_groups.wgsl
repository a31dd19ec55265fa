// The medium of a sample as densities of groups of terms, which have factors of their own. Part of `march.wgsl`.

// The part that is left of the step of the first field and its labels.
fn left_of_first(step: Step) -> Step {
    var left = step;
    left.opacity = scaled_depth(step.opacity, parts.x);
    for (var lane = 0u; lane < TABLE_LANES; lane += 1u) {
        left.source[lane] = step.source[lane] * parts.x;
    }
    return left;
}

// Adds the densities of the groups from `first` to before `end`, times their factors where the gradient has this `magnitude`.
fn add_groups(
    fields: FieldValues,
    key: Key,
    magnitude: f32,
    first: u32,
    end: u32,
    step: ptr<function, Step>,
) {
    for (var group = first; group < end; group += 1u) {
        var coordinate = key.coordinate;
        if (SEVERAL_FIELDS) {
            coordinate = coordinate_of(fields.values, group, march.coordinate_last);
        }
        var factor = 1.0;
        if (BY_GRADIENT) {
            factor = factor_at(magnitude, group);
        }
        if (PLACED > 0u) {
            factor *= of_field(fields.there, group);
        }
        if (BY_FIELDS > 0u) {
            factor *= factor_by_fields(fields, group);
        }
        if (SHAPES) {
            var value = value_of(key.texel);
            if (SEVERAL_FIELDS) {
                value = of_field(fields.values, group);
            }
            factor *= shape_of(fields, value, magnitude, group);
        }
        if (BY_FIELD) {
            factor *= select(of_field(parts, group), 1.0, group < FIRST_GROUPS);
        }
        add_group(group, coordinate, factor, step);
    }
}

fn medium_at(place: vec3f, key: Key) -> Step {
    var gradient = vec3f();
    if (STORED_GRADIENT) {
        gradient = key.texel.xyz * march.gradient_scale;
    } else if (GRADIENT) {
        gradient = central_difference(place) * march.gradient_scale;
    }
    var step: Step;
    step.normal = unit(capped(gradient, value_of(key.texel), place));
    let magnitude = sqrt(dot(gradient, gradient));
    return add_media(key.fields, key, place, magnitude, step);
}

// Density of a further field with normals of its own: its light is shaded apart.
struct Other {
    source: array<vec4f, TABLE_LANES>,
    normal: vec3f,
}

// Light of a sample by further fields.
var<private> others: array<Other, OTHERS_VECTORS>;

// The normal of a field that shares the texels of the first, whose value has the `fall` in units of `scale`.
fn normal_of_shared(place: vec3f, field: u32, scale: f32, fall: f32) -> vec3f {
    let voxel = 1.0 / volume_dims();
    var along: vec3f;
    for (var axis = 0u; axis < 3u; axis += 1u) {
        var step = vec3f();
        step[axis] = voxel[axis];
        along[axis] = fetch(place + step)[field] - fetch(place - step)[field];
    }
    // Per unit of length.
    let gradient = along * (0.5 * scale) * volume_dims() / march.local_scale;
    return unit(capped_by(field, gradient, fall, place));
}

// The normal of field `i` of those on grids of their own, where it has this `value`.
fn normal_of_placed(place: vec3f, i: u32, value: f32) -> vec3f {
    let field = placed[i];
    let gradient = placed_differences(i, placed_index(i, place)) * field.gradient_scale;
    let before = fma(field.rows[1].xyz, vec3f(gradient.y), field.rows[2].xyz * gradient.z);
    let along = fma(field.rows[0].xyz, vec3f(gradient.x), before);
    let fall = fma(value, field.fall, field.lowest);
    return unit(capped_by(FIRST_PLACED + i, along / march.local_scale, fall, place));
}

// 1 if there is nothing of a field that others would hide behind, else 0.
fn open_behind(media: Step) -> f32 {
    var is_there = is_depth(media.opacity);
    for (var lane = 0u; lane < TABLE_LANES; lane += 1u) {
        is_there |= any(media.source[lane] != vec4f());
    }
    return select(1.0, 0.0, is_there);
}

// Adds the `share` of a field.
fn add_share(share: f32, media: Step, step: ptr<function, Step>) {
    (*step).opacity = plus_share((*step).opacity, share, media.opacity);
    for (var lane = 0u; lane < TABLE_LANES; lane += 1u) {
        (*step).source[lane] = fma(vec4f(share), media.source[lane], (*step).source[lane]);
    }
}

// The densities of the groups of a further field, from `group` to before `end`.
fn further_media(fields: FieldValues, key: Key, group: u32, end: u32) -> Step {
    var media: Step;
    add_groups(fields, key, 0.0, group, end, &media);
    return media;
}

// Adds the `share` of the depth of a further `field`, whose first group is `group`, and keeps its light apart as number `n`.
fn add_other(
    fields: FieldValues,
    place: vec3f,
    n: u32,
    group: u32,
    field: u32,
    share: f32,
    media: Step,
    step: ptr<function, Step>,
) {
    (*step).opacity = plus_share((*step).opacity, share, media.opacity);
    for (var lane = 0u; lane < TABLE_LANES; lane += 1u) {
        others[n].source[lane] = media.source[lane] * share;
    }
    let value = of_field(fields.values, group);
    if (field < FIRST_PLACED) {
        // In units of the table's coordinate, which is 0 at the lowest value.
        let scale = factor_table[group * FACTOR_VECTORS].zw;
        others[n].normal = normal_of_shared(place, field, scale.x, 0.5 * fma(value, scale.x, scale.y));
    } else if (PLACED > 0u) {
        others[n].normal = normal_of_placed(place, field - FIRST_PLACED, value);
    }
}

// Adds a step of the medium of this `density` over a `length`, in steps; returns the transmittance after it.
fn add_part(
    ray: Ray,
    place: vec3f,
    density: Step,
    length: f32,
    transmittance: Transmittance,
    sums: ptr<function, array<vec4f, LAYERS>>,
) -> Transmittance {
    let step = across(density, length);
    add_light(ray, place, step, transmittance, sums);
    if (OTHERS > 0u) {
        for (var n = 0u; n < OTHERS; n += 1u) {
            var other = step;
            other.normal = others[n].normal;
            for (var lane = 0u; lane < TABLE_LANES; lane += 1u) {
                other.source[lane] = others[n].source[lane] * gain_of(step.opacity, density.opacity, length, lane);
            }
            add_light(ray, place, other, transmittance, sums);
        }
    }
    return attenuate(transmittance, step.opacity);
}

fn add_whole(
    ray: Ray,
    place: vec3f,
    density: Step,
    transmittance: Transmittance,
    sums: ptr<function, array<vec4f, LAYERS>>,
) -> Transmittance {
    return add_part(ray, place, density, 1.0, transmittance, sums);
}
