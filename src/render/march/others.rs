//! Writer of `add_media`, which adds the densities of all groups of terms: those of further fields with normals of their own apart. It
//! writes straight lines, because a software device branches at the ends of loops only. Twin of `reference::samples`.

use std::fmt::Write as _;

use relume_scene::plan::ScenePlan;

/// Runs of the groups from `first` to before `end` that are not shaded apart, and the groups that are.
fn runs(plan: &ScenePlan, first: usize, end: usize) -> (Vec<[usize; 2]>, Vec<usize>) {
    let (mut together, mut apart) = (Vec::<[usize; 2]>::new(), Vec::new());
    for group in first..end {
        match (plan.groups.is_apart(group), together.last_mut()) {
            (true, _) => apart.push(group),
            (false, Some(last)) if last[1] == group => last[1] += 1,
            (false, _) => together.push([group, group + 1]),
        }
    }
    (together, apart)
}

/// WGSL of `add_media`.
pub(super) fn text(plan: &ScenePlan) -> String {
    let groups = plan.groups.in_tables();
    // Labels replace the first field alone.
    let first = if plan.labels { plan.groups.of_first() } else { groups };
    let mut lines = String::new();
    let mut line = |line: std::fmt::Arguments<'_>| writeln!(lines, "    {line}").unwrap_or_default();
    let (together, mut apart) = runs(plan, 0, first);
    for [from, to] in together {
        line(format_args!("add_groups(fields, key, magnitude, {from}u, {to}u, &step);"));
    }
    line(format_args!("step = labelled(place, key.label, key.coordinate, step);"));
    let (together, further) = runs(plan, first, groups);
    for [from, to] in together {
        line(format_args!("add_groups(fields, key, magnitude, {from}u, {to}u, &step);"));
    }
    apart.extend(further);
    for ((number, group), field) in apart.into_iter().enumerate().zip(plan.groups.lit_fields()) {
        line(format_args!("add_other(fields, key, place, {number}u, {group}u, {field}u, &step);"));
    }
    format!(
        "// Adds the densities of all groups at a sample to `begun`, and their labels.
fn add_media(fields: FieldValues, key: Key, place: vec3f, magnitude: f32, begun: Step) -> Step {{
    var step = begun;
{lines}    return step;
}}
"
    )
}
