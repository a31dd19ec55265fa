// Uniforms, resources and rays of a march. Part of `march.wgsl`.

struct March {
    base: vec3f,
    eye_distance: f32,
    base_u: vec3f,
    spread_u: f32,
    base_v: vec3f,
    spread_v: f32,
    direction: vec3f,
    step_length: f32,
    direction_u: vec3f,
    termination: f32,
    direction_v: vec3f,
    coordinate_scale: f32,
    low: vec3f,
    coordinate_offset: f32,
    high: vec3f,
    coordinate_last: f32,
    cell_scale: vec3f,
    pixel_width: f32,
    cell_offset: vec3f,
    pixel_height: f32,
    local_scale: vec3f,
    samples: u32,
    gradient_scale: vec3f,
    width: u32,
    cells: vec3u,
    height: u32,
    crop_low: vec3f,
    active_low: f32,
    crop_high: vec3f,
    active_high: f32,
}

// Light positions and the materials' shading coefficients, in lanes (`tables::ShadingTable`).
struct Shading {
    lights: array<vec4f, LIGHT_VECTORS>,
    ambient: array<vec4f, SHADING_LANES>,
    diffuse: array<vec4f, SHADING_LANES>,
    specular: array<vec4f, SHADING_LANES>,
    exponent: array<vec4u, SHADING_LANES>,
}

// Rows of the picture and samples of its rays that one dispatch marches.
struct Band {
    first_row: u32,
    first_sample: u32,
    end_sample: u32,
    // Place of the ray in its pixel, from 0 to 1.
    across: f32,
    down: f32,
}

// Opposite corners of the marched block, far away where it ends with the volume, and the axes along which its upper face
// belongs to the next block (`tables::BlockBox`).
struct Block {
    low: vec3f,
    high: vec3f,
    open: vec3u,
}

@group(0) @binding(0) var<uniform> march_uniform: March;
@group(0) @binding(1) var<uniform> shading_uniform: Shading;
@group(0) @binding(2) var volume: texture_3d<f32>;
@group(0) @binding(3) var volume_sampler: sampler;
@group(0) @binding(6) var<storage, read> occupancy: array<u32>;
@group(0) @binding(7) var labels: texture_3d<u32>;
@group(0) @binding(10) var accumulators: texture_storage_2d_array<rgba32float, read_write>;
@group(0) @binding(11) var transmittances: TransmittanceImage;
@group(0) @binding(25) var<uniform> block: Block;
var<immediate> band: Band;

// Copies of the uniforms, made once per invocation: on a CPU a uniform is otherwise read for each lane at every step.
var<private> march: March;
var<private> shading: Shading;

struct Ray {
    base: vec3f,
    direction: vec3f,
    start: f32,
    // Steps from `start` to the first sample.
    offset: f32,
    samples: u32,
    view: vec3f,
}

struct Step {
    source: array<vec4f, TABLE_LANES>,
    opacity: Transmittance,
    normal: vec3f,
}

// Beyond any box.
const FAR: f32 = 1e30;

fn unit(a: vec3f) -> vec3f {
    let square = dot(a, a);
    return select(vec3f(), a * inverseSqrt(square), square > 0.0);
}

fn between(base: f32, direction: f32, low: f32, high: f32) -> vec2f {
    if (abs(direction) < 1e-30) {
        return select(vec2f(FAR, -FAR), vec2f(-FAR, FAR), low <= base && base <= high);
    }
    let a = (low - base) / direction;
    let b = (high - base) / direction;
    return vec2f(min(a, b), max(a, b));
}

// Where a ray enters and leaves the box, from the eye onwards.
fn clip(eye: f32, base: vec3f, direction: vec3f, low: vec3f, high: vec3f) -> vec2f {
    let x = between(base.x, direction.x, low.x, high.x);
    let y = between(base.y, direction.y, low.y, high.y);
    let z = between(base.z, direction.z, low.z, high.z);
    return vec2f(max(max(eye, x.x), max(y.x, z.x)), min(min(x.y, y.y), z.y));
}

fn first_behind(s: f32, start: f32) -> f32 {
    return max(ceil((s - start) / march.step_length - 0.5), 0.0);
}

fn ray_through(pixel: vec2u) -> Ray {
    let u = (f32(pixel.x) + band.across) * march.pixel_width - 1.0;
    let v = 1.0 - (f32(pixel.y) + band.down) * march.pixel_height;
    let base = fma(vec3f(v), march.base_v, fma(vec3f(u), march.base_u, march.base));
    let slant = fma(vec3f(v), march.direction_v, fma(vec3f(u), march.direction_u, march.direction));
    let length = sqrt(fma(v * v, march.spread_v, fma(u * u, march.spread_u, 1.0)));
    let direction = slant / length;

    // Samples are numbered from the volume's box; the crop box selects some of them. Rays start at the eye.
    let eye = -(march.eye_distance * length);
    let start = clip(eye, base, direction, march.low, march.high).x;
    let shown = clip(eye, base, direction, march.crop_low, march.crop_high);
    let first = first_behind(shown.x, start);
    let steps = max(first_behind(shown.y, start) - first, 0.0);
    let samples = select(0u, min(u32(steps), march.samples), shown.y > shown.x);
    if (BLOCK) {
        // Samples keep their numbers. A ray in the face between two blocks belongs to the upper one.
        let within = abs(direction) < vec3f(1e-30) & base == block.high & block.open != vec3u();
        let leave = first_behind(clip(-FAR, base, direction, block.low, block.high).y, start) - first;
        let end = u32(clamp(leave, 0.0, f32(samples)));
        return Ray(base, direction, start, first + 0.5, select(end, 0u, any(within)), -(direction * march.local_scale));
    }
    return Ray(base, direction, start, first + 0.5, samples, -(direction * march.local_scale));
}

// Number of the first sample of `ray` in the block.
fn first_in_block(ray: Ray) -> u32 {
    let enter = clip(-FAR, ray.base, ray.direction, block.low, block.high).x;
    return u32(clamp(first_behind(enter, ray.start) - (ray.offset - 0.5), 0.0, f32(march.samples)));
}

fn place_of(ray: Ray, n: u32) -> vec3f {
    let s = fma(f32(n) + ray.offset, march.step_length, ray.start);
    return fma(vec3f(s), ray.direction, ray.base);
}
