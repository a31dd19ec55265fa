// Adds the film of one more ray to the mean of a pixel's rays. Twin of `reference::march`.

@group(0) @binding(0) var one: FilmImage;
@group(0) @binding(1) var mean: FilmImage;
// 1 / number of rays so far.
var<immediate> share: f32;

@compute @workgroup_size(GROUP_WIDTH, 1)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (id.x < textureDimensions(mean).x) {
        let added = textureLoad(one, id.xy, id.z);
        let before = textureLoad(mean, id.xy, id.z);
        // The first ray finds nothing in the image, not even zeros.
        textureStore(mean, id.xy, id.z, select(fma(vec4f(share), added - before, before), added, share == 1.0));
    }
}
