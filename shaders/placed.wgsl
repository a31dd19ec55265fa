// Fields on grids of their own, in one texture, one behind the other along z. Part of `march.wgsl` and `light_grid.wgsl`. Twin of
// `tables::PlacedField` and `Stored::coordinates_of_groups`.

struct PlacedField {
    // Voxel index: each row times texture coordinates of the volume and 1.
    rows: array<vec4f, 3>,
    // Lowest and highest voxel index, and its first slice in the texture.
    low: vec3f,
    first: f32,
    high: vec3f,
    // Offset of `fall`.
    lowest: f32,
    // Factors on differences, and the scale from a value to the gradient of a fall to the lowest one within two units of length.
    gradient_scale: vec3f,
    fall: f32,
}

// The values of all fields at a place, and 1 where each has one, 0 outside its box.
struct FieldValues {
    values: vec4f,
    there: vec4f,
}

@group(0) @binding(27) var placed_volumes: texture_3d<f32>;
@group(0) @binding(28) var<storage, read> placed_fields: array<PlacedField, PLACED_VECTORS>;

// Copy, as of the planes.
var<private> placed: array<PlacedField, PLACED_VECTORS>;

fn read_fields() {
    if (PLACED > 0u) {
        placed = placed_fields;
    }
}

fn placed_texel(field: u32, voxel: vec3f) -> PlacedTexel {
    let on = clamp(voxel, vec3f(), floor(placed[field].high)) + vec3f(0.0, 0.0, placed[field].first);
    return placed_numbers(textureLoad(placed_volumes, vec3i(on), 0));
}

fn placed_line(field: u32, base: vec3f, x: f32) -> PlacedTexel {
    let before = placed_texel(field, base);
    return fma(PlacedTexel(x), placed_texel(field, base + vec3f(1.0, 0.0, 0.0)) - before, before);
}

fn placed_plane(field: u32, base: vec3f, x: f32, y: f32) -> PlacedTexel {
    let before = placed_line(field, base, x);
    return fma(PlacedTexel(y), placed_line(field, base + vec3f(0.0, 1.0, 0.0), x) - before, before);
}

fn placed_cubic_line(field: u32, base: vec3f, x: vec4f) -> PlacedTexel {
    let step = vec3f(1.0, 0.0, 0.0);
    return x.x * placed_texel(field, base - step) + x.y * placed_texel(field, base)
        + x.z * placed_texel(field, base + step) + x.w * placed_texel(field, base + 2.0 * step);
}

fn placed_cubic_plane(field: u32, base: vec3f, x: vec4f, y: vec4f) -> PlacedTexel {
    let step = vec3f(0.0, 1.0, 0.0);
    return y.x * placed_cubic_line(field, base - step, x) + y.y * placed_cubic_line(field, base, x)
        + y.z * placed_cubic_line(field, base + step, x) + y.w * placed_cubic_line(field, base + 2.0 * step, x);
}

// The texel of a field between its voxels: its value, or its differences along the axes and the value.
fn placed_between(field: u32, index: vec3f) -> PlacedTexel {
    let base = floor(index);
    let fraction = index - base;
    var texel: PlacedTexel;
    if (PLACED_FETCHED) {
        let before = placed_plane(field, base, fraction.x, fraction.y);
        let after = placed_plane(field, base + vec3f(0.0, 0.0, 1.0), fraction.x, fraction.y);
        texel = fma(PlacedTexel(fraction.z), after - before, before);
    } else if (CUBIC) {
        let x = cubic_weights(fraction.x);
        let y = cubic_weights(fraction.y);
        let z = cubic_weights(fraction.z);
        let step = vec3f(0.0, 0.0, 1.0);
        texel = z.x * placed_cubic_plane(field, base - step, x, y) + z.y * placed_cubic_plane(field, base, x, y)
            + z.z * placed_cubic_plane(field, base + step, x, y)
            + z.w * placed_cubic_plane(field, base + 2.0 * step, x, y);
    } else if (NEAREST) {
        texel = placed_texel(field, floor(index + 0.5));
    } else {
        let on = clamp(index, vec3f(), floor(placed[field].high)) + vec3f(0.5, 0.5, 0.5 + placed[field].first);
        let all = vec3f(textureDimensions(placed_volumes));
        texel = placed_numbers(textureSampleLevel(placed_volumes, volume_sampler, on / all, 0.0));
    }
    return texel;
}

// Voxel index of a field at a place of the volume.
fn placed_index(field: u32, place: vec3f) -> vec3f {
    let rows = placed[field].rows;
    let x = vec3f(rows[0].x, rows[1].x, rows[2].x);
    let y = vec3f(rows[0].y, rows[1].y, rows[2].y);
    let z = vec3f(rows[0].z, rows[1].z, rows[2].z);
    let first = vec3f(rows[0].w, rows[1].w, rows[2].w);
    return fma(vec3f(place.x), x, fma(vec3f(place.y), y, fma(vec3f(place.z), z, first)));
}

// Those of the fields that share the `texel`, and of the others at `place`.
fn values_at(texel: vec4f, place: vec3f) -> FieldValues {
    var found = FieldValues(texel, vec4f(1.0));
    found.values.x = value_of(texel);
    for (var i = 0u; i < PLACED; i += 1u) {
        let index = placed_index(i, place);
        let inside = all(placed[i].low <= index & index <= placed[i].high);
        let texel = placed_between(i, index);
        found.values[FIRST_PLACED + i] = placed_value_of(texel);
        keep_placed(i, texel);
        found.there[FIRST_PLACED + i] = select(0.0, 1.0, inside);
    }
    return found;
}
