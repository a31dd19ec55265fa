// Extinctions of values and labels in a storage buffer, of any length. Part of `light_grid.wgsl`.

@group(0) @binding(3) var<storage, read> extinctions: array<vec4f>;
