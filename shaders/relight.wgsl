// Post-illumination: turns accumulators into colours without a march. Twin of `src/scene/film/relight.rs`.

struct Relight {
    width: u32,
    height: u32,
    // Whether these accumulators were relit before.
    again: u32,
    // 1 for a soft curve near white, or else 0.
    soft: u32,
    // Square roots of the colours of the backdrop at the top and at the bottom.
    backdrop: array<vec4f, 2>,
    // Per lane of the transmittance: red, green and blue of the background, and the weights in the total transmittance.
    background: array<array<vec4f, 4>, TRANSMITTANCE_LANES>,
    // Per layer of the accumulators: red, green and blue of its components.
    colours: array<array<vec4f, 3>, LAYERS>,
}

@group(0) @binding(0) var<uniform> relight: Relight;
@group(0) @binding(1) var accumulators: AccumulatorImage;
@group(0) @binding(2) var transmittances: TransmittanceImage;
@group(0) @binding(3) var display: texture_storage_2d_array<rgba8unorm, write>;
@group(0) @binding(4) var linear: texture_storage_2d_array<rgba32float, write>;
// Nonzero if any accumulator of a column of ROWS pixels is; otherwise only the background changes the column.
@group(0) @binding(5) var nonzero: texture_storage_2d_array<r32uint, read_write>;

// The transfer curve of IEC 61966-2-1 to 1.5e-4 of a code. With u the fourth root of x, 1.055 x^(1/2.4) - 0.055 is
// 1.055 u^(5/3) - 0.055, here its minimax polynomial. `pow` takes several times as long on a software device.
fn encode(colour: vec3f) -> vec3f {
    let clipped = clamp(colour, vec3f(), vec3f(1.0));
    let u = sqrt(sqrt(clipped));
    var curve = fma(vec3f(-0.07621052), u, vec3f(0.39471427));
    curve = fma(curve, u, vec3f(-0.8984146));
    curve = fma(curve, u, vec3f(1.2091517));
    curve = fma(curve, u, vec3f(-1.1558964));
    curve = fma(curve, u, vec3f(1.4615259));
    curve = fma(curve, u, vec3f(0.12357587));
    curve = fma(curve, u, vec3f(-0.05844659));
    return select(curve, 12.92 * clipped, clipped <= vec3f(0.0031308));
}

// Twin of `Tone::show`.
fn shown_softly(colour: vec3f) -> vec3f {
    let most = min(max(colour.r, max(colour.g, colour.b)), BRIGHTEST);
    let over = most - KNEE;
    let curve = KNEE + (1.0 - KNEE) * over / (over + (1.0 - KNEE));
    return select(colour, colour * (curve / most), most > KNEE);
}

@compute @workgroup_size(GROUP_WIDTH, GROUP_HEIGHT)
fn main(@builtin(global_invocation_id) id: vec3u) {
    // Reads uniforms once per column of pixels: on a CPU each read costs as much as a multiplication of all lanes.
    var colours: array<array<vec4f, 3>, LAYERS>;
    if (FEW_LAYERS) {
        colours = relight.colours;
    }
    let background = relight.background;
    let begin = id.y * ROWS;
    var end = min(begin + ROWS, relight.height);
    if (id.x >= relight.width || begin >= end) {
        return;
    }
    // Loop bounds instead of branches: a software device skips a loop of no iterations.
    var found = vec4u();
    var shown = 1u;
    if (SKIP_EMPTY) {
        if (relight.again != 0u) {
            shown = min(textureLoad(nonzero, id.xy, 0).x, 1u);
        }
        if (!BACKGROUND) {
            end = begin + shown * (end - begin);
        }
    }
    for (var y = begin; y < end; y += 1u) {
        let pixel = vec2u(id.x, y);
        var colour = vec3f();
        for (var once = 0u; once < shown; once += 1u) {
            for (var layer = 0u; layer < LAYERS_USED; layer += 1u) {
                let weights = textureLoad(accumulators, pixel, layer);
                if (SKIP_EMPTY) {
                    found |= bitcast<vec4u>(weights);
                }
                var shine: array<vec4f, 3>;
                if (FEW_LAYERS) {
                    shine = colours[layer];
                } else {
                    shine = relight.colours[layer];
                }
                colour += vec3f(dot(shine[0], weights), dot(shine[1], weights), dot(shine[2], weights));
            }
        }
        var total = 0.0;
        if (READS_TRANSMITTANCE) {
            for (var lane = 0u; lane < TRANSMITTANCE_LANES; lane += 1u) {
                let transmittance = textureLoad(transmittances, pixel, lane);
                total += dot(background[lane][3], transmittance);
                if (BACKGROUND) {
                    let behind = background[lane];
                    colour += vec3f(dot(behind[0], transmittance), dot(behind[1], transmittance), dot(behind[2], transmittance));
                }
            }
        }
        if (DISPLAY) {
            for (var once = 0u; once < relight.soft; once += 1u) {
                colour = shown_softly(colour);
            }
            if (BACKDROP) {
                let root = mix(relight.backdrop[0].rgb, relight.backdrop[1].rgb, f32(y) / f32(max(relight.height, 2u) - 1u));
                colour += total * root * root;
            }
            // Rounded here: devices may convert to a code that is off by 0.6, and some do.
            textureStore(display, pixel, 0, vec4f(round(255.0 * encode(colour)) * (1.0 / 255.0), 1.0));
        } else {
            textureStore(linear, pixel, 0, vec4f(colour, 1.0 - total));
        }
    }
    if (SKIP_EMPTY) {
        if (relight.again == 0u) {
            textureStore(nonzero, id.xy, 0, vec4u(found.x | found.y | found.z | found.w));
        }
    }
}
