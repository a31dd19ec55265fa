// Table of crossed intervals in a storage buffer. Part of `march.wgsl`.

// `tables::CrossingTable`.
@group(0) @binding(31) var<storage, read> crossings: array<vec4f, CROSSING_CELLS>;
