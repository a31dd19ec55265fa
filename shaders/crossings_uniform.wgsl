// Table of crossed intervals in a uniform buffer. Part of `march.wgsl`.

// `tables::CrossingTable`.
@group(0) @binding(31) var<uniform> crossings: array<vec4f, CROSSING_CELLS>;
