//! Names, colours and materials of labels.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::sync::LazyLock;

use super::code;
use relume_base::number::count;
use relume_volume::{LabelPreset, MOST_LABELS, NoLabels, Volume, VolumeError, Voxel, is_background, with_voxels};

/// Opacity of labels of a label map, per voxel: a surface that shows what is in front of it.
pub(super) const LABEL_OPACITY: f64 = 0.5;
/// Optical depth along a typical ray of a label around the others.
pub(super) const OUTER_DEPTH: f64 = 0.6;
/// Most labels with a material of their own. More of them share those of their colours.
const MOST_MATERIALS: usize = 255;
/// Most colours of a file or a table that become materials.
const MOST_STATED: usize = 2000;
/// Names of the materials of the colours that labels take in turn begin so.
const IN_TURN: &str = "label colour";

/// Colours that more labels than [`MOST_MATERIALS`] take in turn.
const SHARED: usize = 32;

/// Colours of labels that can be told apart: any two of the first [`SHARED`] differ by ΔE00 11 or more, any two of all by 7.
static LABEL_COLOURS: LazyLock<Vec<&str>> = LazyLock::new(|| {
    let text = include_str!("../../../../data/labels/colours.txt");
    text.lines().filter(|line| line.len() == "#rrggbb".len()).collect()
});

/// Colour of the label of this `index`.
pub(super) fn label_colour(index: usize) -> &'static str {
    LABEL_COLOURS[index % LABEL_COLOURS.len()]
}

/// A label with its name and colour.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Named {
    pub(super) label: i64,
    pub(super) name: String,
    /// sRGB code.
    pub(super) code: String,
    /// Whether a file or a table states the colour.
    pub(super) is_stated: bool,
}

/// The labels with the names and colours of `presets`, and others without. No two have one name.
pub(super) fn named(labels: &[i64], presets: &[LabelPreset]) -> Vec<Named> {
    // A name of a file may have any character but those that end a line.
    let clean = |name: &str| name.chars().filter(|it| !it.is_control()).collect::<String>().trim().to_owned();
    let stated: BTreeMap<i64, &LabelPreset> = presets.iter().map(|preset| (preset.value, preset)).collect();
    let mut times: BTreeMap<String, usize> = BTreeMap::new();
    for preset in stated.values() {
        *times.entry(clean(&preset.name)).or_insert(0) += 1;
    }
    let of_label = |(index, &label): (usize, &i64)| {
        let preset = stated.get(&label);
        let name = preset.map_or_else(String::new, |preset| clean(&preset.name));
        // Labels without a name are called so.
        let name = if name.is_empty() || name.starts_with("label_") {
            format!("label_{label}")
        } else if times.get(&name).is_some_and(|&times| times > 1) {
            format!("{name} ({label})")
        } else {
            name
        };
        let colour = preset.and_then(|preset| preset.colour).map(code);
        let is_stated = colour.is_some();
        Named { label, name, code: colour.unwrap_or_else(|| label_colour(index).to_owned()), is_stated }
    };
    labels.iter().enumerate().map(of_label).collect()
}

/// Whether each label has a material of its own.
pub(super) fn have_own_materials(labels: &[Named]) -> bool {
    labels.len() <= MOST_MATERIALS
}

/// Labels that keep their stated colours where labels share materials.
fn keeps_colour(labels: &[Named]) -> bool {
    let codes: BTreeSet<&str> =
        labels.iter().filter(|label| label.is_stated).map(|label| label.code.as_str()).collect();
    codes.len() <= MOST_STATED && labels.iter().filter(|label| label.is_stated).count() <= MOST_STATED
}

/// Name of the material of a label.
fn material(label: &Named, are_own: bool) -> String {
    if are_own { label.name.clone() } else { format!("label {}", label.code) }
}

/// A name as a string of TOML.
pub(super) fn quoted(name: &str) -> String {
    toml_edit::value(name).to_string().trim().to_owned()
}

/// Materials of these labels, each in the sRGB code of its colour.
pub(super) fn materials_text(labels: &[Named]) -> String {
    let are_own = have_own_materials(labels);
    let keeps = are_own || keeps_colour(labels);
    let stated = labels.iter().filter(|label| are_own || keeps && label.is_stated);
    let mut all: BTreeMap<String, &str> = stated.map(|label| (material(label, are_own), label.code.as_str())).collect();
    let in_turn: Vec<(String, &str)> =
        (0..SHARED).map(|index| (format!("{IN_TURN} {}", index + 1), label_colour(index))).collect();
    if !are_own && labels.iter().any(|label| !(keeps && label.is_stated)) {
        all.extend(in_turn);
    }
    let mut text = String::new();
    for (name, code) in all {
        let key = toml_edit::Key::new(&name).display_repr().into_owned();
        // Writing to a string cannot fail.
        let _ = writeln!(text, "[materials.{key}]\nreflectance = {{ srgb = \"{code}\" }}");
    }
    text
}

/// Entries of these labels, with these opacities.
pub(super) fn entries_text(labels: &[Named], opacities: &[f64]) -> String {
    let are_own = have_own_materials(labels);
    let keeps = are_own || keeps_colour(labels);
    let mut text = String::new();
    let mut others = None;
    for (label, &opacity) in labels.iter().zip(opacities) {
        let is_glass = opacity < LABEL_OPACITY / 2.0;
        if !(are_own || keeps && label.is_stated || is_glass) {
            others = Some(opacity);
            continue;
        }
        let material =
            if are_own || keeps && label.is_stated { material(label, are_own) } else { format!("{IN_TURN} 1") };
        let (name, material) = (quoted(&label.name), quoted(&material));
        let _ = writeln!(text, "[labels.{}]\nname = {name}\nmaterial = {material}\nopacity = {opacity:?}", label.label);
    }
    if let Some(opacity) = others {
        let names: Vec<String> = (1..=SHARED).map(|index| quoted(&format!("{IN_TURN} {index}"))).collect();
        let _ = writeln!(
            text,
            "# All other labels take these materials in turn.\n[labels.others]\nmaterials = [{}]\nopacity = {opacity:?}",
            names.join(", ")
        );
    }
    text
}

/// Materials and declarations of the labels of a label map, to be appended to the text of a `scene`: names and colours of its
/// file, or else numbers. `None` if it has no label.
///
/// # Errors
///
/// [`VolumeError::Layout`] for a volume that is no label map, or has too many labels.
pub(crate) fn labels_text(map: &Volume, scene: &str) -> Result<Option<String>, VolumeError> {
    map.require_voxels("a label map")?;
    let counts = map.label_counts(MOST_LABELS + 1).map_err(|problem| map.no_labels(problem))?;
    let ids: Vec<i64> = counts.keys().copied().filter(|&label| !is_background(label, &counts)).collect();
    if ids.len() > MOST_LABELS {
        return Err(map.no_labels(NoLabels::Many));
    }
    let mut labels = named(&ids, &map.presets.labels);
    for label in &mut labels {
        let key = toml_edit::Key::new(&label.name).display_repr().into_owned();
        if scene.contains(&format!("[materials.{key}]")) || scene.contains(&format!("[materials.{key}.")) {
            label.name = format!("{} ({})", label.name, label.label);
        }
    }
    let opacities = vec![LABEL_OPACITY; labels.len()];
    let text = format!(
        "\n# Labels of the label map; their voxels do not follow the transfer function.\n{}{}",
        materials_text(&labels),
        entries_text(&labels, &opacities)
    );
    Ok((!labels.is_empty()).then_some(text))
}

/// True for a scan in place of a label map: hardly a labelled voxel has the label of its neighbour along x.
pub(crate) fn is_speckled(map: &Volume) -> bool {
    /// Labels in regions have 0.5 and more, noisy scans 0.1 and less.
    const FEWEST_ALIKE: f64 = 0.25;
    let [nx, ..] = map.geometry.dims;
    let [alike, all] = with_voxels!(&map.voxels, stored => {
        let pairs = stored.chunks(nx).flat_map(|row| row.windows(2)).filter(|pair| pair[0].to_f64() > 0.0);
        pairs.fold([0, 0], |[alike, all], pair| [alike + usize::from(pair[0].to_f64().total_cmp(&pair[1].to_f64()).is_eq()), all + 1])
    });
    count(alike) < FEWEST_ALIKE * count(all)
}

#[cfg(test)]
#[expect(clippy::unwrap_used, reason = "a test fails by panicking")]
mod tests {
    use super::*;
    use relume_colour::spectrum::colour::{
        LinearSrgb, ciede2000, d65_white, decode_srgb, lab_from_xyz, xyz_from_linear_srgb,
    };

    #[test]
    fn colours_of_labels_can_be_told_apart() {
        let lab = |code: &str| {
            let part = |at: usize| u8::from_str_radix(&code[at..at + 2], 16).unwrap();
            let linear = [1, 3, 5].map(|at| decode_srgb(f64::from(part(at)) / 255.0));
            lab_from_xyz(xyz_from_linear_srgb(LinearSrgb(linear)), d65_white())
        };
        assert_eq!(LABEL_COLOURS.len(), MOST_MATERIALS);
        for (index, one) in LABEL_COLOURS.iter().enumerate() {
            for other in &LABEL_COLOURS[..index] {
                let least = if index < SHARED { 11.0 } else { 7.0 };
                assert!(ciede2000(lab(one), lab(other)) >= least, "{one} and {other}");
            }
        }
    }
}
