// The media of labels, from the rows of a table. Part of `march.wgsl` and `light_grid.wgsl`. Twin of `tables::LabelTable`.

// Twice the first entry of each row, plus 1 if it has as many entries as the transfer table, over the same values.
@group(0) @binding(29) var<storage, read> label_rows: array<u32>;

// Two entries of the table, and the share of the other one.
struct LabelEntries {
    here: u32,
    next: u32,
    fraction: f32,
}

// The entries of a row where the value has this coordinate in a transfer table that ends at `last`.
fn label_entries(row: u32, coordinate: f32, last: f32) -> LabelEntries {
    var entries = LabelEntries(row, row, 0.0);
    if (LABELS_BY_VALUE) {
        let place = label_rows[row];
        let by_value = (place & 1u) == 1u;
        let i = select(min(u32(coordinate), u32(last) - 1u), u32(coordinate + 0.5), NEAREST_LOOKUP);
        let here = (place >> 1u) + select(0u, i, by_value);
        let between = by_value && !NEAREST_LOOKUP;
        entries = LabelEntries(here, here + select(0u, 1u, between), select(0.0, coordinate - f32(i), between));
    }
    return entries;
}
