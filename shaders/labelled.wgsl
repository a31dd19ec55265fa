// Labels in place of the medium of the values. Part of `march.wgsl`.

fn label_source_at(entries: LabelEntries, lane: u32) -> vec4f {
    let here = label_source[entries.here * TABLE_LANES + lane];
    if (LABELS_BY_VALUE) {
        return fma(vec4f(entries.fraction), label_source[entries.next * TABLE_LANES + lane] - here, here);
    }
    return here;
}

fn label_opacity_at(entries: LabelEntries) -> Transmittance {
    if (LABELS_BY_VALUE) {
        return opacity_between_labels(entries.here, entries.next, entries.fraction);
    }
    return opacity_of_label(entries.here);
}

// The step at `place`, of whose labels those of the voxels around have their shares; what has no label has `step`. Row 0 of
// the label table is empty.
fn shared_by_labels(place: vec3f, label: u32, coordinate: f32, step: Step) -> Step {
    var own = 0.0;
    var blend = step;
    blend.opacity = Transmittance();
    blend.source = array<vec4f, TABLE_LANES>();
    // A software device branches at the ends of loops only: one turn, where all labels agree.
    let voxels = select(1u, 8u, is_mixed(label));
    for (var i = 0u; i < voxels; i += 1u) {
        let voxel = share_of(place, label, i);
        own += select(0.0, voxel.share, voxel.row == 0u);
        let entries = label_entries(voxel.row, coordinate, march.coordinate_last);
        blend.opacity = plus_share(blend.opacity, voxel.share, label_opacity_at(entries));
        for (var lane = 0u; lane < TABLE_LANES; lane += 1u) {
            blend.source[lane] = fma(vec4f(voxel.share), label_source_at(entries, lane), blend.source[lane]);
        }
    }
    blend.opacity = plus_share(blend.opacity, own, step.opacity);
    for (var lane = 0u; lane < TABLE_LANES; lane += 1u) {
        blend.source[lane] = fma(vec4f(own), step.source[lane], blend.source[lane]);
    }
    return blend;
}

// The step at `place` with its label, which is `label`, in place of the medium of the values, which is `step`.
fn labelled(place: vec3f, label: u32, coordinate: f32, step: Step) -> Step {
    var found = step;
    if (SMOOTH_LABELS) {
        found = shared_by_labels(place, label, coordinate, step);
    } else if (LABELS) {
        if (label > 0u) {
            let entries = label_entries(label, coordinate, march.coordinate_last);
            for (var lane = 0u; lane < TABLE_LANES; lane += 1u) {
                found.source[lane] = label_source_at(entries, lane);
            }
            found.opacity = label_opacity_at(entries);
        }
    }
    return found;
}
