// Tables of the transfer function and the labels in uniform buffers, if short enough. Part of `march.wgsl`.

@group(0) @binding(4) var<uniform> table_source: array<vec4f, UNIFORM_VECTORS>;
@group(0) @binding(5) var<uniform> table_opacity: array<vec4f, UNIFORM_VECTORS>;
@group(0) @binding(8) var<uniform> label_source: array<vec4f, UNIFORM_VECTORS>;
@group(0) @binding(9) var<uniform> label_opacity: array<vec4f, UNIFORM_VECTORS>;
