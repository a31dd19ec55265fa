// Tables of the transfer function and the labels in storage buffers, of any length. Part of `march.wgsl`.

@group(0) @binding(4) var<storage, read> table_source: array<vec4f>;
@group(0) @binding(5) var<storage, read> table_opacity: array<vec4f>;
@group(0) @binding(8) var<storage, read> label_source: array<vec4f>;
@group(0) @binding(9) var<storage, read> label_opacity: array<vec4f>;
