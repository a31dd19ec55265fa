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
    // Ranges of the values of texels outside which each of several fields shows nothing.
    active_lows: vec4f,
    active_highs: vec4f,
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
    // Phase of the ray in its pixel, in 2⁻³² of a step.
    phase: u32,
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
@group(0) @binding(25) var<uniform> block: Block;

// Copies of the uniforms, made once per invocation: on a CPU a uniform is otherwise read for each lane at every step.
var<private> march: March;
var<private> shading: Shading;

struct Ray {
    base: vec3f,
    direction: vec3f,
    start: f32,
    // Number of the first step, from `start`.
    first: f32,
    // Ends of the part of the ray that the crop box and the clip planes leave, in steps from the beginning of the first step.
    inside: vec2f,
    samples: u32,
    view: vec3f,
}

// Of the ray, in steps from the beginning of the first.
var<private> own_of_ray: Own;

struct Step {
    source: array<vec4f, TABLE_LANES>,
    opacity: Transmittance,
    normal: vec3f,
}

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

// Part of a step at which the steps of a ray begin: interleaved gradient noise in whole numbers (`tables::ray_phase`).
fn ray_phase(pixel: vec2u) -> f32 {
    let line = pixel.x * 288237661u + pixel.y * 25070368u;
    let noise = line * 52u + (line >> 16u) * 64417u;
    return f32((noise + band.phase) >> 8u) * (1.0 / 16777216.0);
}

fn ray_through(pixel: vec2u) -> Ray {
    let u = (f32(pixel.x) + band.across) * march.pixel_width - 1.0;
    let v = 1.0 - (f32(pixel.y) + band.down) * march.pixel_height;
    let base = fma(vec3f(v), march.base_v, fma(vec3f(u), march.base_u, march.base));
    let slant = fma(vec3f(v), march.direction_v, fma(vec3f(u), march.direction_u, march.direction));
    let length = sqrt(fma(v * v, march.spread_v, fma(u * u, march.spread_u, 1.0)));
    let direction = slant / length;

    // Steps are numbered from the volume's box; crop box and clip planes select some of them, and parts of the first and the last.
    // Rays start at the eye.
    let eye = -(march.eye_distance * length);
    var start = clip(eye, base, direction, march.low, march.high).x;
    if (JITTER) {
        start -= ray_phase(pixel) * march.step_length;
    }
    var shown = clip(eye, base, direction, march.crop_low, march.crop_high);
    if (PLANES > 0u) {
        shown = left_by_planes(base, direction, shown);
    }
    let steps = max((shown - start) / march.step_length, vec2f());
    let first = floor(steps.x);
    let inside = steps - first;
    if (BY_FIELD) {
        let own = own_of(base, direction);
        own_of_ray = Own((own.low - start) / march.step_length - first, (own.high - start) / march.step_length - first);
    }
    let samples = select(0u, min(u32(ceil(inside.y)), march.samples), shown.y > shown.x);
    return Ray(base, direction, start, first, inside, samples, -(direction * march.local_scale));
}

// Where the part of step `n` inside the crop box begins and ends, in steps from the beginning of that step.
fn part_of(ray: Ray, n: u32) -> vec2f {
    return vec2f(max(ray.inside.x - f32(n), 0.0), min(ray.inside.y - f32(n), 1.0));
}

// The part of the step that is left of each field, where planes cut them by themselves.
var<private> parts: vec4f;

fn read_parts(ray: Ray, n: u32) {
    parts = parts_of(own_of_ray, part_of(ray, n) + f32(n));
}

// Place `within` steps behind the beginning of step `n`.
fn place_within(ray: Ray, n: u32, within: f32) -> vec3f {
    let s = fma(f32(n) + within + ray.first, march.step_length, ray.start);
    return fma(vec3f(s), ray.direction, ray.base);
}

// Place of sample `n`: the middle of its step, or of the part of the step inside the crop box.
fn place_of(ray: Ray, n: u32) -> vec3f {
    let part = part_of(ray, n);
    return place_within(ray, n, (part.x + part.y) * 0.5);
}

// Place of sample `n` of a run, in which no step is cut if `cut_steps.wgsl` adds those. A whole step has the same place to the bit either
// way: of at most 2²³ samples, sums of halves are exact.
fn place_in_run(ray: Ray, n: u32) -> vec3f {
    if (CUT_IN_RUNS) {
        return place_of(ray, n);
    }
    let s = fma(f32(n) + (ray.first + 0.5), march.step_length, ray.start);
    return fma(vec3f(s), ray.direction, ray.base);
}

// True if a macrocell holds anything visible.
fn is_occupied(cell: vec3f) -> bool {
    let index = u32(cell.x) + march.cells.x * (u32(cell.y) + march.cells.y * u32(cell.z));
    return ((occupancy[index / 32u] >> (index % 32u)) & 1u) != 0u;
}

// Number of the first sample at or behind `s`.
fn first_behind(ray: Ray, s: f32) -> u32 {
    let steps = (s - ray.start) / march.step_length - ray.first;
    let last = ray.samples - 1u;
    let of_first = part_of(ray, 0u);
    let of_last = part_of(ray, last);
    var n = u32(clamp(ceil(steps - 0.5), 1.0, f32(max(last, 1u))));
    n = select(n, ray.samples, steps > f32(last) + (of_last.x + of_last.y) * 0.5);
    return select(n, 0u, steps <= (of_first.x + of_first.y) * 0.5);
}

// The samples of `ray` in the block: from the first to before the second number. They keep their numbers.
fn within_block(ray: Ray) -> vec2u {
    // A ray in the face between two blocks belongs to the upper one.
    let in_face = (abs(ray.direction) < vec3f(1e-30)) & (ray.base == block.high) & (block.open != vec3u());
    let met = clip(-FAR, ray.base, ray.direction, block.low, block.high);
    let all = vec2u(first_behind(ray, met.x), first_behind(ray, met.y));
    return select(all, vec2u(), any(in_face) || ray.samples == 0u);
}
