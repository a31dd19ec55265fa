//! Writer of `add_media`, which adds the densities of all groups of terms: those of further fields with normals of their own apart. It
//! writes straight lines, because a software device branches at the ends of loops only. Twin of `reference::samples`.

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

/// Groups of a further field, from the first to before the last number.
fn groups_of(plan: &ScenePlan, field: usize) -> Option<[usize; 2]> {
    let fields = &plan.groups.fields[..plan.groups.in_tables()];
    let first = fields.iter().position(|of| *of == field)?;
    Some([first, first + fields[first..].iter().take_while(|of| **of == field).count()])
}

/// Lines that add fields which hide one another.
fn hiding(plan: &ScenePlan, order: &[usize]) -> Vec<String> {
    let mut lines = vec![
        "var open = 1.0;".to_owned(),
        "var own = begun;".to_owned(),
        format!("add_groups(fields, key, magnitude, 0u, {}u, &own);", plan.groups.of_first()),
        "own = labelled(place, key.label, key.coordinate, own);".to_owned(),
    ];
    if plan.clip.is_by_field() {
        lines.push("own = left_of_first(own);".to_owned());
    }
    for &field in order {
        let media = if field == 0 { "own".to_owned() } else { format!("media_{field}") };
        if field > 0 {
            let Some([from, to]) = groups_of(plan, field) else { continue };
            lines.push(format!("let {media} = further_media(fields, key, {from}u, {to}u);"));
            if let Some(number) = plan.groups.lit_fields().position(|lit| lit == field) {
                lines.push(format!("add_other(fields, place, {number}u, {from}u, {field}u, open, {media}, &step);"));
                lines.push(format!("open *= open_behind({media});"));
                continue;
            }
        }
        lines.push(format!("add_share(open, {media}, &step);"));
        lines.push(format!("open *= open_behind({media});"));
    }
    lines
}

/// Lines that add all fields.
fn adding(plan: &ScenePlan) -> Vec<String> {
    let groups = plan.groups.in_tables();
    let by_field = plan.clip.is_by_field();
    // Labels replace the first field alone.
    let first = if plan.labels || by_field { plan.groups.of_first() } else { groups };
    let mut lines = Vec::new();
    let (together, mut apart) = runs(plan, 0, first);
    let add = |[from, to]: [usize; 2]| format!("add_groups(fields, key, magnitude, {from}u, {to}u, &step);");
    lines.extend(together.into_iter().map(add));
    lines.push("step = labelled(place, key.label, key.coordinate, step);".to_owned());
    if by_field {
        lines.push("step = left_of_first(step);".to_owned());
    }
    let (together, further) = runs(plan, first, groups);
    lines.extend(together.into_iter().map(add));
    apart.extend(further);
    for (number, [from, to]) in apart.into_iter().enumerate() {
        let field = plan.groups.fields[from];
        let media = format!("further_media(fields, key, {from}u, {to}u)");
        lines.push(format!("add_other(fields, place, {number}u, {from}u, {field}u, 1.0, {media}, &step);"));
    }
    lines
}

/// WGSL of `add_media`.
pub(super) fn text(plan: &ScenePlan) -> String {
    let lines = plan.groups.hiding().map_or_else(|| adding(plan), |order| hiding(plan, &order));
    format!(
        "// Adds the densities of all groups at a sample to `begun`, and their labels.
fn add_media(fields: FieldValues, key: Key, place: vec3f, magnitude: f32, begun: Step) -> Step {{
    var step = begun;
    {}
    return step;
}}
",
        lines.join("\n    ")
    )
}
