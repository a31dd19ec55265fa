// Marches rays through the volume front to back, and writes accumulators and transmittance. No light spectrum enters
// them.
// The reflected light of a step is in `weights.wgsl` or `spectral.wgsl`, its transmittance in `grey.wgsl`,
// `coloured.wgsl` or `mixed.wgsl`, the memory of its tables in `tables_storage.wgsl` or `tables_uniform.wgsl`, the
// factor on its opacity by the gradient magnitude in `gradient_opacity.wgsl`, and the integration of a run of steps in
// `samples.wgsl`, or in `segments.wgsl` with `segments_grey.wgsl` or `segments_coloured.wgsl`.
// Twin of `reference::march` and `reference::samples`. Constants in capitals come from the plan; branches on them are
// resolved before the shader is compiled.

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
}

@group(0) @binding(0) var<uniform> march_uniform: March;
@group(0) @binding(1) var<uniform> shading_uniform: Shading;
@group(0) @binding(2) var volume: texture_3d<f32>;
@group(0) @binding(3) var volume_sampler: sampler;
@group(0) @binding(6) var<storage, read> occupancy: array<u32>;
@group(0) @binding(7) var labels: texture_3d<u32>;
@group(0) @binding(10) var accumulators: texture_storage_2d_array<rgba32float, read_write>;
@group(0) @binding(11) var transmittances: TransmittanceImage;
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
    let u = (f32(pixel.x) + 0.5) * march.pixel_width - 1.0;
    let v = 1.0 - (f32(pixel.y) + 0.5) * march.pixel_height;
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
    return Ray(base, direction, start, first + 0.5, samples, -(direction * march.local_scale));
}

fn place_of(ray: Ray, n: u32) -> vec3f {
    let s = fma(f32(n) + ray.offset, march.step_length, ray.start);
    return fma(vec3f(s), ray.direction, ray.base);
}

// Texel of a voxel; voxels outside the grid are clamped to its faces.
fn texel_at(voxel: vec3f) -> vec4f {
    let last = vec3f(textureDimensions(volume)) - 1.0;
    return textureLoad(volume, vec3i(clamp(voxel, vec3f(), last)), 0);
}

// Linear interpolation along x, then y, then z, in f32, because a device's filter may have only eight bits.
fn linear_line(base: vec3f, x: f32) -> vec4f {
    let before = texel_at(base);
    return fma(vec4f(x), texel_at(base + vec3f(1.0, 0.0, 0.0)) - before, before);
}

fn linear_plane(base: vec3f, x: f32, y: f32) -> vec4f {
    let before = linear_line(base, x);
    return fma(vec4f(y), linear_line(base + vec3f(0.0, 1.0, 0.0), x) - before, before);
}

fn linear_between(voxel: vec3f) -> vec4f {
    let base = floor(voxel);
    let fraction = voxel - base;
    let before = linear_plane(base, fraction.x, fraction.y);
    let after = linear_plane(base + vec3f(0.0, 0.0, 1.0), fraction.x, fraction.y);
    return fma(vec4f(fraction.z), after - before, before);
}

// Weights of four neighbouring voxels in a cubic B-spline. Without loops, like `power`.
fn cubic_weights(f: f32) -> vec4f {
    let rest = 1.0 - f;
    let first = rest * rest * rest / 6.0;
    let last = f * f * f / 6.0;
    let second = (fma(3.0 * f - 6.0, f * f, 4.0)) / 6.0;
    return vec4f(first, second, 1.0 - first - second - last, last);
}

fn cubic_line(base: vec3f, x: vec4f) -> vec4f {
    let step = vec3f(1.0, 0.0, 0.0);
    return x.x * texel_at(base - step) + x.y * texel_at(base) + x.z * texel_at(base + step)
        + x.w * texel_at(base + 2.0 * step);
}

fn cubic_plane(base: vec3f, x: vec4f, y: vec4f) -> vec4f {
    let step = vec3f(0.0, 1.0, 0.0);
    return y.x * cubic_line(base - step, x) + y.y * cubic_line(base, x) + y.z * cubic_line(base + step, x)
        + y.w * cubic_line(base + 2.0 * step, x);
}

fn cubic_between(voxel: vec3f) -> vec4f {
    let base = floor(voxel);
    let fraction = voxel - base;
    let x = cubic_weights(fraction.x);
    let y = cubic_weights(fraction.y);
    let z = cubic_weights(fraction.z);
    let step = vec3f(0.0, 0.0, 1.0);
    return z.x * cubic_plane(base - step, x, y) + z.y * cubic_plane(base, x, y) + z.z * cubic_plane(base + step, x, y)
        + z.w * cubic_plane(base + 2.0 * step, x, y);
}

fn fetch(place: vec3f) -> vec4f {
    var texel: vec4f;
    if (EXACT_LINEAR) {
        texel = linear_between(fma(place, vec3f(textureDimensions(volume)), vec3f(-0.5)));
    } else if (CUBIC) {
        texel = cubic_between(fma(place, vec3f(textureDimensions(volume)), vec3f(-0.5)));
    } else {
        texel = textureSampleLevel(volume, volume_sampler, place, 0.0);
    }
    return texel;
}

// Differences between the next and the previous voxel along each axis.
fn central_difference(place: vec3f) -> vec3f {
    let voxel = 1.0 / vec3f(textureDimensions(volume));
    let x = vec3f(voxel.x, 0.0, 0.0);
    let y = vec3f(0.0, voxel.y, 0.0);
    let z = vec3f(0.0, 0.0, voxel.z);
    return vec3f(
        fetch(place + x).x - fetch(place - x).x,
        fetch(place + y).x - fetch(place - y).x,
        fetch(place + z).x - fetch(place - z).x,
    );
}

// `base^exponent` by repeated squaring, lowest bit first. Unrolled, because a loop would count against the iterations
// that some devices allow per invocation.
fn power(base: f32, exponent: u32) -> f32 {
    var result = 1.0;
    var square = base;
    if (EXPONENT_BITS > 0u) { result *= select(1.0, square, (exponent & 1u) != 0u); square *= square; }
    if (EXPONENT_BITS > 1u) { result *= select(1.0, square, (exponent & 2u) != 0u); square *= square; }
    if (EXPONENT_BITS > 2u) { result *= select(1.0, square, (exponent & 4u) != 0u); square *= square; }
    if (EXPONENT_BITS > 3u) { result *= select(1.0, square, (exponent & 8u) != 0u); square *= square; }
    if (EXPONENT_BITS > 4u) { result *= select(1.0, square, (exponent & 16u) != 0u); square *= square; }
    if (EXPONENT_BITS > 5u) { result *= select(1.0, square, (exponent & 32u) != 0u); square *= square; }
    if (EXPONENT_BITS > 6u) { result *= select(1.0, square, (exponent & 64u) != 0u); square *= square; }
    if (EXPONENT_BITS > 7u) { result *= select(1.0, square, (exponent & 128u) != 0u); square *= square; }
    if (EXPONENT_BITS > 8u) { result *= select(1.0, square, (exponent & 256u) != 0u); square *= square; }
    if (EXPONENT_BITS > 9u) { result *= select(1.0, square, (exponent & 512u) != 0u); square *= square; }
    if (EXPONENT_BITS > 10u) { result *= select(1.0, square, (exponent & 1024u) != 0u); }
    return result;
}

// |n·l|, or max(n·l, 0) with one-sided lighting, of a part ∇v·l/|∇v|.
fn lit(part: f32) -> f32 {
    var facing = abs(part);
    if (ONE_SIDED) {
        facing = max(-part, 0.0);
    }
    return facing;
}

// Light of a step towards the eye for the three directions of the light at `position`, and their weights.
fn shade_three_point(position: u32, ray: Ray, step: Step) -> array<vec4f, LANES> {
    var facing = 0.0;
    for (var i = 0u; i < 3u; i += 1u) {
        let light = shading.lights[position + i];
        facing = fma(light.w, lit(dot(step.normal, light.xyz)), facing);
    }
    var source = reflect_light(step, facing);
    if (SPECULAR) {
        for (var i = 0u; i < 3u; i += 1u) {
            let light = shading.lights[position + i];
            var shine = lit(dot(step.normal, unit(light.xyz + ray.view)));
            if (ONE_SIDED) {
                shine = select(0.0, shine, dot(step.normal, light.xyz) < 0.0);
            }
            var white: array<vec4f, LANES>;
            highlight(step, shine, &white);
            for (var lane = 0u; lane < LANES; lane += 1u) {
                source[lane] = fma(vec4f(light.w), white[lane], source[lane]);
            }
        }
    }
    return source;
}

// Light of a step towards the eye for light from `position`.
fn shade(position: u32, ray: Ray, place: vec3f, step: Step) -> array<vec4f, LANES> {
    if (position < AMBIENT) {
        return unshaded(step);
    }
    if (THREE_POINT > 0u) {
        if (position >= AMBIENT + HEADLIGHT + DIRECTIONAL + POINT) {
            return shade_three_point(position, ray, step);
        }
    }
    var light = ray.view;
    if (DIRECTIONAL > 0u) {
        if (position >= AMBIENT + HEADLIGHT) {
            light = shading.lights[position].xyz;
        }
    }
    if (POINT > 0u) {
        if (position >= AMBIENT + HEADLIGHT + DIRECTIONAL) {
            light = unit(shading.lights[position].xyz - place * march.local_scale);
        }
    }
    var facing = 0.0;
    if (ONE_SIDED) {
        facing = max(-dot(step.normal, light), 0.0);
    } else if (GRADIENT) {
        facing = abs(dot(step.normal, light));
    }
    var source = reflect_light(step, facing);
    if (SPECULAR) {
        let halfway = unit(light + ray.view);
        if (ONE_SIDED) {
            highlight(step, select(0.0, max(-dot(step.normal, halfway), 0.0), facing > 0.0), &source);
        } else {
            highlight(step, abs(dot(step.normal, halfway)), &source);
        }
    }
    return source;
}

// Adds one premultiplied sample front to back, `A += T·s`.
fn composite(
    sums: ptr<function, array<vec4f, LAYERS>>,
    first: u32,
    source: array<vec4f, LANES>,
    transmittance: Transmittance,
) {
    for (var lane = 0u; lane < LANES; lane += 1u) {
        (*sums)[first + lane] = received(transmittance, lane, source, (*sums)[first + lane]);
    }
}

@compute @workgroup_size(GROUP_WIDTH, GROUP_HEIGHT)
fn main(@builtin(global_invocation_id) id: vec3u) {
    march = march_uniform;
    if (SHADED) {
        shading = shading_uniform;
    }
    let pixel = vec2u(id.x, id.y + band.first_row);
    if (pixel.x >= march.width || pixel.y >= march.height) {
        return;
    }
    let ray = ray_through(pixel);
    var sums: array<vec4f, LAYERS>;
    var transmittance = all_light();
    if (band.first_sample > 0u) {
        for (var layer = 0u; layer < LAYERS_USED; layer += 1u) {
            sums[layer] = textureLoad(accumulators, pixel, layer);
        }
        transmittance = load_transmittance(pixel);
    }
    let end = select(min(ray.samples, band.end_sample), 0u, brightest(transmittance) < march.termination);
    var n = band.first_sample;
    if (SKIPPING) {
        // Samples per macrocell along each axis.
        let samples_per_cell = 1.0 / (max(abs(ray.direction * march.cell_scale), vec3f(1e-30)) * march.step_length);
        let forward = select(vec3f(), vec3f(1.0), ray.direction > vec3f());
        let last_cell = vec3f(march.cells) - 1.0;
        loop {
            // Skips to the next sample in an occupied macrocell.
            var leave = n;
            loop {
                if (n >= end) { break; }
                let cells = fma(place_of(ray, n), march.cell_scale, march.cell_offset);
                let cell = clamp(floor(cells), vec3f(), last_cell);
                let ahead = abs(cell + forward - cells) * samples_per_cell;
                leave = n + max(1u, u32(ceil(min(min(ahead.x, ahead.y), min(ahead.z, 1e6)))));
                let index = u32(cell.x) + march.cells.x * (u32(cell.y) + march.cells.y * u32(cell.z));
                if (((occupancy[index / 32u] >> (index % 32u)) & 1u) != 0u) { break; }
                n = leave;
            }
            if (n >= end) { break; }
            leave = min(leave, end);
            transmittance = march_run(ray, n, leave, transmittance, &sums);
            n = select(leave, end, brightest(transmittance) < march.termination);
        }
    } else {
        transmittance = march_run(ray, n, end, transmittance, &sums);
    }
    for (var layer = 0u; layer < LAYERS_USED; layer += 1u) {
        textureStore(accumulators, pixel, layer, sums[layer]);
    }
    store_transmittance(pixel, transmittance);
}
