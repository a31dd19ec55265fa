//! Writer of `add_media`, which adds the densities of all groups of terms: those of further fields with normals of their own apart. It
//! writes straight lines, because a software device branches at the ends of loops only. Twin of `reference::samples`.

use std::fmt::Write as _;

use relume_scene::plan::ScenePlan;

/// Runs of the groups from `first` to before `end` that are not shaded apart, and those of each field that is.
fn runs(plan: &ScenePlan, first: usize, end: usize) -> (Vec<[usize; 2]>, Vec<[usize; 2]>) {
    let fields = plan.groups.fields;
    let (mut together, mut apart) = (Vec::<[usize; 2]>::new(), Vec::<[usize; 2]>::new());
    for group in first..end {
        let is_apart = plan.groups.is_apart(group);
        let runs = if is_apart { &mut apart } else { &mut together };
        match runs.last_mut() {
            Some(last) if last[1] == group && !(is_apart && fields[last[0]] != fields[group]) => last[1] += 1,
            _ => runs.push([group, group + 1]),
        }
    }
    (together, apart)
}

/// WGSL of `add_media`.
pub(super) fn text(plan: &ScenePlan) -> String {
    let groups = plan.groups.in_tables();
    // Labels replace the first field alone.
    let by_field = plan.clip.is_by_field();
    let first = if plan.labels || by_field { plan.groups.of_first() } else { groups };
    let mut lines = String::new();
    let mut line = |line: std::fmt::Arguments<'_>| writeln!(lines, "    {line}").unwrap_or_default();
    let (together, mut apart) = runs(plan, 0, first);
    for [from, to] in together {
        line(format_args!("add_groups(fields, key, magnitude, {from}u, {to}u, &step);"));
    }
    line(format_args!("step = labelled(place, key.label, key.coordinate, step);"));
    if by_field {
        line(format_args!("step = left_of_first(step);"));
    }
    let (together, further) = runs(plan, first, groups);
    for [from, to] in together {
        line(format_args!("add_groups(fields, key, magnitude, {from}u, {to}u, &step);"));
    }
    apart.extend(further);
    for (number, [from, to]) in apart.into_iter().enumerate() {
        let field = plan.groups.fields[from];
        line(format_args!("add_other(fields, key, place, {number}u, {from}u, {to}u, {field}u, &step);"));
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
