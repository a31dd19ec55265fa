//! Writer of `add_light` and `read_light`: for each way by which light arrives at a step, the lines that call
//! `shaders/light.wgsl`. They are straight lines, because a loop would keep its variables in memory on a software device; only
//! long rows of lights that differ in nothing but their numbers are a loop. Twin of `reference::light`.

use std::fmt::Write as _;

use relume_scene::plan::{Arrival, ScenePlan, Share};
use relume_scene::{Direction, ScatteringMethod};

/// Most accumulators of equal light without shadows whose lines are written out.
const MOST_STRAIGHT: usize = 4;

/// Number `n` of those in vectors called `name`.
fn numbered(name: &str, n: usize) -> String {
    format!("{name}_{}.{}", n / 4, ["x", "y", "z", "w"][n % 4])
}

/// The share of light number `number` of the light grid.
fn share_behind(plan: &ScenePlan, number: usize) -> String {
    let first = number * (1 + plan.light.absorbers);
    let grey = format!("even_share({})", numbered("depths", first));
    let depth = (0..plan.light.absorbers)
        .fold(grey, |depth, i| format!("absorbed({depth}, {}, {i}u)", numbered("depths", first + 1 + i)));
    format!("behind({depth})")
}

/// The lines that add the light of one accumulator. `ways` are its arrivals with the indices of their vectors.
fn lines(plan: &ScenePlan, accumulator: &str, ways: &[(String, Arrival)]) -> String {
    let mut text = String::new();
    let mut line = |line: std::fmt::Arguments<'_>| writeln!(text, "        {line}").unwrap_or_default();
    let is_even = ways.iter().all(|(_, arrival)| arrival.direction == Direction::Everywhere)
        || plan.shading.is_none() && plan.phases == 0;
    for (i, (vector, Arrival { direction, share, .. })) in ways.iter().enumerate() {
        let share = match share {
            Share::Open => "whole_share()".to_owned(),
            Share::OfRay => "share_of_ray(transmittance, step.opacity)".to_owned(),
            Share::Behind(_) if *direction == Direction::Everywhere => "sky".to_owned(),
            Share::Behind(number) => share_behind(plan, *number),
        };
        if ways.len() > 1 {
            line(format_args!("let share_{i} = scaled_share({share}, shading.lights[{vector}].w);"));
        } else {
            line(format_args!("let share_{i} = {share};"));
        }
        match direction {
            _ if is_even => {}
            Direction::Everywhere | Direction::Eye => line(format_args!("let light_{i} = ray.view;")),
            Direction::Infinity => line(format_args!("let light_{i} = shading.lights[{vector}].xyz;")),
            Direction::Place => line(format_args!("let light_{i} = towards(shading.lights[{vector}].xyz, place);")),
        }
    }
    let gathers = plan.light.gathered == Some(ScatteringMethod::Rows);
    if is_even {
        let all = (1..ways.len()).fold("share_0".to_owned(), |sum, i| format!("plus_shade({sum}, share_{i}, 1.0)"));
        let binding = if gathers { "var" } else { "let" };
        line(format_args!("{binding} source = unshaded_part(step, {all});"));
    } else if plan.phases > 0 {
        line(format_args!("var source: array<vec4f, LANES>;"));
        (0..ways.len()).for_each(|i| line(format_args!("add_scattered(light_{i}, ray, step, share_{i}, &source);")));
    } else {
        let shade = |i: usize| format!("share_{i}, lit(dot(step.normal, light_{i}))");
        let facing = (1..ways.len())
            .fold(format!("scaled_share({})", shade(0)), |sum, i| format!("plus_shade({sum}, {})", shade(i)));
        let open = if plan.light.occluded { "open" } else { "1.0" };
        line(format_args!("var source = reflect_light(step, {facing}, {open});"));
        for (add, is_there) in
            [("add_highlights", plan.specular().is_some()), ("add_thin_films", plan.thin_films.total() > 0)]
        {
            for i in (0..ways.len()).filter(|_| is_there) {
                line(format_args!("{add}(light_{i}, ray, step, share_{i}, &source);"));
            }
        }
    }
    if gathers {
        line(format_args!("add_gathered(gathered_place, {accumulator}, step, &source);"));
    }
    line(format_args!("composite(sums, {accumulator} * LANES, source, transmittance);"));
    text
}

/// Accumulators from `first` on that differ in the numbers of their positions and vectors only: each has one open arrival from
/// the same kind of direction.
fn alike(plan: &ScenePlan, first: usize) -> usize {
    let only = |accumulator: usize| {
        let mut ways = plan.light.of(accumulator);
        ways.next().filter(|(_, way)| ways.next().is_none() && way.share == Share::Open).map(|(_, way)| way.direction)
    };
    let kind = only(first);
    let others = first + 1..plan.light.accumulators();
    if plan.light.gathered.is_some() {
        return 1;
    }
    1 + others.take_while(|&accumulator| kind.is_some() && only(accumulator) == kind).count()
}

/// WGSL of `add_light`, which adds the light of a step, and of `read_light`, which copies the uniforms that it reads.
pub(super) fn text(plan: &ScenePlan) -> String {
    let mut adds = String::new();
    let mut add = |line: &str| adds.push_str(line);
    let light = &plan.light;
    let is_read = plan.layers() > 0;
    if is_read && light.grid_lights() > 0 {
        add("    let grid_place = fma(place, light_place.scale, light_place.offset);\n");
        for texel in 0..light.grid_depths().div_ceil(4) {
            add(&format!("    let depths_{texel} = depths_from(grid_place, {texel}u);\n"));
        }
    }
    let gathers = is_read && light.gathered == Some(ScatteringMethod::Rows);
    if gathers {
        add("    let gathered_place = fma(place, gathered_at.scale, gathered_at.offset);\n");
    }
    if let Some(number) = light.sky().filter(|_| is_read) {
        add(&format!("    let sky = {};\n", share_behind(plan, number)));
        if light.occluded {
            add("    let open = share_in(sky, 0u).x;\n");
        }
    }
    let mut accumulator = 0;
    while is_read && accumulator < light.accumulators() {
        let ways: Vec<(usize, Arrival)> = light.of(accumulator).collect();
        let row = alike(plan, accumulator);
        if row > MOST_STRAIGHT {
            let first = ways.first().map_or(0, |(vector, _)| *vector);
            let ways: Vec<_> = ways.iter().map(|(_, way)| (format!("{first}u + i"), *way)).collect();
            add(&format!("    for (var i = 0u; i < {row}u; i += 1u) {{\n"));
            add(&lines(plan, &format!("({accumulator}u + i)"), &ways));
            accumulator += row;
        } else {
            let ways: Vec<_> = ways.iter().map(|(vector, way)| (format!("{vector}u"), *way)).collect();
            add("    {\n");
            add(&lines(plan, &format!("{accumulator}u"), &ways));
            accumulator += 1;
        }
        add("    }\n");
    }
    let reads = [
        (plan.shading.is_some() || adds.contains("shading."), "    shading = shading_uniform;\n"),
        (is_read && plan.phases > 0, "    phases = phases_uniform;\n"),
        (is_read && plan.thin_films.total() > 0, "    thin_films = thin_films_uniform;\n"),
        (is_read && light.grid_lights() > 0, "    light_place = light_uniform;\n"),
        (gathers, "    gathered_at = gathered_uniform;\n"),
    ];
    let reads: String = reads.iter().filter(|(is_read, _)| *is_read).map(|(_, line)| *line).collect();
    format!(
        "// Copies the uniforms of the light, once per invocation.
fn read_light() {{
{reads}}}

// Adds the light of a step from all positions.
fn add_light(
    ray: Ray,
    place: vec3f,
    step: Step,
    transmittance: Transmittance,
    sums: ptr<function, array<vec4f, LAYERS>>,
) {{
{adds}}}
"
    )
}
