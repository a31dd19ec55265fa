// Factors on the medium by the gradient magnitude and by the values of other fields, for each group of terms. Part of `march.wgsl` and `light_grid.wgsl`. Twin of
// `reference::factors`.

// `tables::FactorTable`.
@group(0) @binding(12) var<uniform> factor_table: array<vec4f, GROUPS * FACTOR_VECTORS>;

// That of the `numbers` of the fields which belongs to the field of a `group`.
fn of_field(numbers: vec4f, group: u32) -> f32 {
    var all = numbers;
    var number: f32;
    if (ONE_GROUP_EACH) {
        // Known once the loop over the groups is unrolled.
        number = all[group];
    } else {
        number = all[u32(factor_table[group * FACTOR_VECTORS].y)];
    }
    return number;
}

// Index of the field of a `group`.
fn field_of(group: u32) -> u32 {
    return select(u32(factor_table[group * FACTOR_VECTORS].y), group, ONE_GROUP_EACH);
}

// Table coordinate of a `group` where the fields have these `values`, of a table that ends at `last`.
fn coordinate_of(values: vec4f, group: u32, last: f32) -> f32 {
    let place = factor_table[group * FACTOR_VECTORS];
    return clamp(fma(of_field(values, group), place.z, place.w), 0.0, last);
}

// The factor of a `group` where the gradient has this `magnitude`.
fn factor_at(magnitude: f32, group: u32) -> f32 {
    var factor = factor_table[group * FACTOR_VECTORS].x;
    for (var i = 1u; i < FACTOR_POINTS; i += 1u) {
        let piece = factor_table[group * FACTOR_VECTORS + i];
        factor = fma(clamp((magnitude - piece.x) * piece.y, 0.0, 1.0), piece.z, factor);
    }
    return factor;
}

// The product of the factors of a `group` by the values of other fields; the first height of each outside the box of its field.
fn factor_by_fields(fields: FieldValues, group: u32) -> f32 {
    var values = fields.values;
    var there = fields.there;
    var product = 1.0;
    for (var i = 0u; i < BY_FIELDS; i += 1u) {
        let first = group * FACTOR_VECTORS + FACTOR_POINTS + i * BY_POINTS;
        let field = u32(factor_table[first].y);
        var rise = 0.0;
        for (var j = 1u; j < BY_POINTS; j += 1u) {
            let piece = factor_table[first + j];
            rise = fma(clamp((values[field] - piece.x) * piece.y, 0.0, 1.0), piece.z, rise);
        }
        product *= fma(rise, there[field], factor_table[first].x);
    }
    return product;
}

// Tables of shapes, row by row.
@group(0) @binding(30) var<storage, read> shapes: array<f32>;

fn shape_row(first: u32, x: f32) -> f32 {
    let column = min(u32(x), SHAPE_EDGE - 2u);
    let here = shapes[first + column];
    return fma(x - f32(column), shapes[first + column + 1u] - here, here);
}

// The shape of a `group` where its own field has this `value`, or 1; the lowest row outside the box of another field.
fn shape_of(fields: FieldValues, value: f32, magnitude: f32, group: u32) -> f32 {
    var values = fields.values;
    var there = fields.there;
    let across = factor_table[(group + 1u) * FACTOR_VECTORS - 2u];
    let up = factor_table[(group + 1u) * FACTOR_VECTORS - 1u];
    let field = u32(max(up.z, 0.0));
    let second = select(values[field], magnitude, up.z < 0.0);
    let inside = select(there[field], 1.0, up.z < 0.0);
    let last = f32(SHAPE_EDGE - 1u);
    let x = clamp(fma(value, across.x, across.y), 0.0, last);
    let y = clamp(fma(second, up.x, up.y), 0.0, last) * inside;
    let row = min(u32(y), SHAPE_EDGE - 2u);
    let first = (u32(max(across.z, 0.0)) * SHAPE_EDGE + row) * SHAPE_EDGE;
    let here = shape_row(first, x);
    return select(1.0, fma(y - f32(row), shape_row(first + SHAPE_EDGE, x) - here, here), across.z >= 0.0);
}
