// Integration by point samples, one in the middle of a step, and one more at each end where the medium differs from that of the sample beside
// (docs/theory/refinement.md). Twin of `march_refined` in `reference::march`. Part of `march.wgsl`.

struct Segments {
    unused: f32,
    // Difference of samples above which a step is refined.
    bound: f32,
    // From a table coordinate to a place in the table.
    scale: f32,
    offset: f32,
}

@group(0) @binding(13) var<uniform> segments_uniform: Segments;

// Part of a step with a medium of its own.
struct Part {
    density: Step,
    place: vec3f,
    // In steps.
    length: f32,
}

// A ray between two runs. The sample in the middle of step `known` and its difference to the one before are in `here` and `rise_here`, and
// the last part so far is not added yet: it waits for the fetch of the next sample.
var<private> known: u32 = 0xffffffffu;
// True after the first run: before another one lie empty macrocells, and no sample in them can be visible.
var<private> has_run: bool = false;
var<private> here: Step;
var<private> rise_here: f32;
// Result of `crossing_at` for its value; its coordinate is below 0 if the sample is not known.
var<private> crossing_here: vec3f;
// True if the sample can be visible.
var<private> seen_here: bool;
var<private> waiting: Part;

// Difference of two samples: the largest of the numbers that they scatter and hide and of the interval that their values `crossed`, and half of
// the turn of the normal, times what both scatter.
fn rise_between(a: Step, b: Step, crossed: f32) -> f32 {
    var most = vec4f();
    var lit_a = vec4f();
    var lit_b = vec4f();
    for (var lane = 0u; lane < TABLE_LANES; lane += 1u) {
        most = max(most, abs(a.source[lane] - b.source[lane]));
        if (SHADED) {
            lit_a = max(lit_a, abs(a.source[lane]));
            lit_b = max(lit_b, abs(b.source[lane]));
        }
    }
    var rise = max(max(max(most.x, most.y), max(most.z, most.w)), depth_between(a.opacity, b.opacity));
    if (CROSSINGS) {
        rise = max(rise, crossed);
    }
    if (SHADED) {
        let turn = b.normal - a.normal;
        let both = min(max(max(lit_a.x, lit_a.y), max(lit_a.z, lit_a.w)), max(max(lit_b.x, lit_b.y), max(lit_b.z, lit_b.w)));
        rise = fma(sqrt(dot(turn, turn)) * 0.5, both, rise);
    }
    return rise;
}

// A table coordinate, the sum over the values below it in the table of crossed intervals, and the number there. Twin of `Crossing::at`.
fn crossing_at(coordinate: f32) -> vec3f {
    let place = clamp(fma(coordinate, segments_uniform.scale, segments_uniform.offset), 0.0, f32(CROSSING_CELLS));
    let number = min(u32(place), CROSSING_CELLS - 1u);
    let cell = crossings[number];
    let within = place - f32(number);
    return vec3f(coordinate, fma(within, cell.y, cell.x), fma(within, cell.w - cell.z, cell.z));
}

// Distance of the mean between two values from the range of both numbers; less for values closer than two cells, and 0 within one. Twin of
// `Crossing::between`.
fn crossed_between(a: vec3f, b: vec3f) -> f32 {
    let distance = abs(b.x - a.x) * segments_uniform.scale;
    let mean = abs(b.y - a.y) / max(distance, 1.0);
    let outside = max(mean - max(a.z, b.z), min(a.z, b.z) - mean);
    return select(0.0, max(outside, 0.0) * clamp(distance - 1.0, 0.0, 1.0), a.x >= 0.0);
}

// Lengths of the first and the last part of a step, as parts of it: 0 up to the bound, and a third from one and a half of it on, so that a
// picture depends continuously on the data.
fn outer_parts(rises: vec2f) -> vec2f {
    return clamp((rises / segments_uniform.bound - 1.0) * 2.0, vec2f(), vec2f(1.0)) * (1.0 / 3.0);
}

// The light that is left. A part of a picture does not know it.
fn left_of(transmittance: Transmittance) -> f32 {
    var left = 1.0;
    if (!BLOCK) {
        left = brightest(transmittance);
    }
    return left;
}

// Marches the steps from `first` to before `end`, or until early termination; returns the transmittance.
//
// One loop for steps and their parts, with one fetch and one part that is added in each iteration. A part waits for the sample ahead of its
// step, which decides on the next one, so that a step takes one iteration, and one more for each outer part. A software device
// would take longer for a loop of parts in a loop of steps.
fn march_run(
    ray: Ray,
    first: u32,
    end: u32,
    before: Transmittance,
    sums: ptr<function, array<vec4f, LAYERS>>,
) -> Transmittance {
    var transmittance = before;
    var n = first;
    // Known samples: that before step n, and its own.
    var held = select(0u, 2u, known == first);
    // 0 at the sample ahead, 1 at the first outer part of the step, 2 at the last.
    var stage = 0u;
    // Lengths of the outer parts.
    var outer = vec2f();
    var ahead: Step;
    var rise_ahead = 0.0;
    var crossing_ahead: vec3f;
    var seen_ahead = false;
    if (held == 0u) {
        held = select(0u, 1u, has_run);
        here = Step();
        crossing_here = vec3f(-1.0, 0.0, 0.0);
        seen_here = false;
        rise_here = 0.0;
    }
    has_run = true;
    first_step = part_of(ray, 0u);
    last_step = part_of(ray, ray.samples - 1u);
    loop {
        var place: vec3f;
        var key: Key;
        var seen = false;
        var skipped = false;
        // Of an outer part; the step before it is known.
        let beside = part_within(ray, n, stage, outer);
        if (SKIP_INVISIBLE) {
            // Advances to the next sample that can be visible, or is beside one, in a loop of its own: some devices branch only at
            // the end of a loop, and would otherwise execute the code after an `if` in vain.
            loop {
                if (n >= end) { break; }
                place = place_along(ray, n, held, stage, beside);
                key = key_at(place);
                seen = is_active(key);
                // Two invisible values may have a visible interval between them.
                let crosses = CROSSINGS && (key.coordinate <= march.active_low) != (crossing_here.x <= march.active_low);
                let counts = seen || seen_here || crosses;
                if (counts || held < 2u || stage > 0u || left_of(transmittance) * rise_here > segments_uniform.bound) { break; }
                rise_here = 0.0;
                crossing_here.x = key.coordinate;
                skipped = true;
                n += 1u;
            }
        } else {
            place = place_along(ray, n, held, stage, beside);
            key = key_at(place);
            seen = true;
        }
        if (n >= end) { break; }
        var crossing: vec3f;
        if (CROSSINGS) {
            crossing = crossing_at(key.coordinate);
            if (skipped) {
                crossing_here = crossing_at(crossing_here.x);
            }
        }
        let medium = medium_at(place, key);
        let whole = step_of(ray, n);
        let length = whole.y - whole.x;
        // The part of this iteration.
        var part = waiting;
        if (stage == 1u) {
            part = Part(medium, place, outer.x * length);
        } else if (stage == 2u) {
            part = Part(here, place_within(ray, n, (whole.x + whole.y) * 0.5), (1.0 - outer.x - outer.y) * length);
        }
        transmittance = add_part(ray, part.place, part.density, part.length, transmittance, sums);
        waiting.length = 0.0;
        if (brightest(transmittance) < march.termination) {
            held = 0u;
            break;
        }
        var done = false;
        if (stage == 0u) {
            var crossed = 0.0;
            if (CROSSINGS) {
                crossed = crossed_between(crossing_here, crossing);
            }
            let rise = rise_between(here, medium, crossed);
            if (held < 2u) {
                here = medium;
                rise_here = rise;
                crossing_here = crossing;
                seen_here = seen;
                held += 1u;
            } else {
                outer = outer_parts(left_of(transmittance) * vec2f(rise_here, rise));
                ahead = medium;
                rise_ahead = rise;
                crossing_ahead = crossing;
                seen_ahead = seen;
                stage = select(select(3u, 2u, outer.y > 0.0), 1u, outer.x > 0.0);
            }
        } else if (stage == 1u) {
            stage = select(3u, 2u, outer.y > 0.0);
        } else {
            waiting = Part(medium, place, outer.y * length);
            done = true;
        }
        if (stage == 3u) {
            waiting = Part(here, place_within(ray, n, (whole.x + whole.y) * 0.5), (1.0 - outer.x) * length);
            done = true;
        }
        if (done) {
            here = ahead;
            rise_here = rise_ahead;
            crossing_here = crossing_ahead;
            seen_here = seen_ahead;
            outer = vec2f();
            stage = 0u;
            n += 1u;
        }
    }
    known = select(0xffffffffu, n, held == 2u);
    return transmittance;
}

// Ends of the first and the last step of the ray, in steps from their beginnings; no others are cut.
var<private> first_step: vec2f;
var<private> last_step: vec2f;

fn step_of(ray: Ray, n: u32) -> vec2f {
    return select(select(vec2f(0.0, 1.0), last_step, n + 1u == ray.samples), first_step, n == 0u);
}

// Place of the sample of an outer part, in steps from the beginning of step n.
fn part_within(ray: Ray, n: u32, stage: u32, outer: vec2f) -> f32 {
    let whole = step_of(ray, n);
    let aside = outer * (whole.y - whole.x) * 0.5;
    return select(whole.y - aside.y, whole.x + aside.x, stage == 1u);
}

// Place of the next sample: that ahead of step n, one for each known sample before; or that of an outer part. Beyond the ray, steps are whole.
fn place_along(ray: Ray, n: u32, held: u32, stage: u32, beside: f32) -> vec3f {
    let i = i32(n) + select(0, i32(held) - 1, stage == 0u);
    let cut_last = select(0.5, (last_step.x + last_step.y) * 0.5, i + 1 == i32(ray.samples));
    let middle = select(cut_last, (first_step.x + first_step.y) * 0.5, i == 0);
    let s = fma(f32(i) + select(beside, middle, stage == 0u) + ray.first, march.step_length, ray.start);
    return fma(vec3f(s), ray.direction, ray.base);
}

// Adds the part that waits; returns the transmittance behind it.
fn finished(ray: Ray, transmittance: Transmittance, sums: ptr<function, array<vec4f, LAYERS>>) -> Transmittance {
    let length = waiting.length;
    waiting.length = 0.0;
    return add_part(ray, waiting.place, waiting.density, length, transmittance, sums);
}
