// Extinctions of values and labels in a uniform buffer, if short enough. Part of `light_grid.wgsl`.

@group(0) @binding(3) var<uniform> extinctions: array<vec4f, UNIFORM_VECTORS>;
