//! Label maps of any numbers, alone and over a scan, with their names.

use std::path::{Path, PathBuf};

use crate::support;

use relume::annotate::Entry;
use relume::document::first_look::{Kind, Values};
use relume::document::session;
use relume::document::{Document, Edit, SceneFile, SceneOptions, Source};
use relume::progress::Quiet;
use relume::scene::{LabelEntry, Mix};
use relume::volume::{Selection, Volume, open};
use support::program::Folder;

/// A NRRD of `dims` voxels with the value `of` each, in this type.
fn nrrd(kind: &str, dims: [usize; 3], more: &str, of: impl Fn([usize; 3]) -> f64) -> Vec<u8> {
    let [nx, ny, nz] = dims;
    let header =
        format!("NRRD0004\ntype: {kind}\ndimension: 3\nsizes: {nx} {ny} {nz}\nendian: little\nencoding: raw\n{more}\n");
    let values = (0..nx * ny * nz).map(|index| of([index % nx, index / nx % ny, index / (nx * ny)]));
    let bytes = values.flat_map(|value| -> Vec<u8> {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole numbers of the type")]
        match kind {
            "uint8" => vec![value as u8],
            "int16" => (value as i16).to_le_bytes().into(),
            "uint16" => (value as u16).to_le_bytes().into(),
            "int32" => (value as i32).to_le_bytes().into(),
            "uint32" => (value as u32).to_le_bytes().into(),
            "float" => (value as f32).to_le_bytes().into(),
            _ => value.to_le_bytes().into(),
        }
    });
    header.into_bytes().into_iter().chain(bytes).collect()
}

/// Blocks of `side` voxels with a free border of `side`: the number of each, from 0 on, or `None`.
fn block(place: [usize; 3], dims: [usize; 3], side: usize) -> Option<usize> {
    let inside = (0..3).all(|axis| place[axis] >= side && place[axis] + side < dims[axis]);
    let [x, y, z] = place.map(|at| at / side);
    let [nx, ny, _] = dims.map(|n| n / side);
    inside.then(|| (x - 1) + (nx - 2) * ((y - 1) + (ny - 2) * (z - 1)))
}

fn values_of(path: &Path) -> Values {
    let volume = open(path, &Selection::default(), &Quiet).unwrap();
    Values::of(&volume, &volume.statistics().unwrap())
}

fn looked_at(path: PathBuf, options: SceneOptions) -> SceneFile {
    Source { path: Some(path), options }.read(&Quiet).unwrap().0
}

fn declared(file: &SceneFile) -> &[LabelEntry] {
    file.scene.labels.as_ref().map_or(&[], |labels| &labels.declared)
}

fn ids(file: &SceneFile) -> Vec<i64> {
    declared(file).iter().map(|entry| entry.label).collect()
}

#[test]
fn numbers_of_any_size_and_type_are_labels_and_no_ct() {
    const DIMS: [usize; 3] = [30, 25, 20];
    let of = |ids: &'static [f64], background: f64| {
        move |place: [usize; 3]| block(place, DIMS, 5).map_or(background, |number| ids[number % ids.len()])
    };
    // Ids between 1000 and 1500 look like the offset of a CT; its labels do not.
    let cases: [(&str, &'static [f64], f64); 8] = [
        ("int16", &[1040.0, 1150.0, 1310.0, 1490.0], 0.0),
        ("uint16", &[1024.0, 2048.0], 0.0),
        ("int32", &[7.0, 1003.0, 2031.0, 12_106.0, 14_170.0], 0.0),
        ("float", &[1.0], 0.0),
        ("float", &[4.0, 9.0, 3002.0], 0.0),
        ("double", &[3.0, 2_147_483_648.0, 9_007_199_254_740_991.0], 0.0),
        ("uint32", &[16_777_218.0, 16_777_219.0, 3_000_000_001.0, 5.0], 0.0),
        ("int16", &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0], -1.0),
    ];
    let mut folder = Folder::new();
    for (index, (kind, ids, background)) in cases.iter().enumerate() {
        folder = folder.with(&format!("{index}.nrrd"), nrrd(kind, DIMS, "", of(ids, *background)));
        let found = values_of(&folder.path(&format!("{index}.nrrd"))).kind;
        #[expect(clippy::cast_possible_truncation, reason = "whole numbers")]
        let mut wanted: Vec<i64> = ids.iter().map(|&id| id as i64).collect();
        wanted.sort_unstable();
        assert_eq!(found, Kind::Labels(wanted), "{kind} {ids:?}");
    }
    // Labels that an interval of values cannot tell apart are shown by a label map, each by itself.
    let file = looked_at(folder.path("6.nrrd"), SceneOptions::default());
    assert_eq!(ids(&file), [5, 16_777_218, 16_777_219, 3_000_000_001]);
    let materials: std::collections::BTreeSet<usize> = declared(&file).iter().map(|entry| entry.material).collect();
    assert_eq!(materials.len(), 4);
    // Shading has four values in place of three billion.
    assert!((file.scene.volume().statistics().unwrap().max - 4.0).abs() < 1e-9);
    assert!(file.scene.volume().notes.iter().any(|note| note.contains("ranks")), "{:?}", file.scene.volume().notes);
}

#[test]
fn scans_with_whole_numbers_stay_scans() {
    const DIMS: [usize; 3] = [40, 36, 32];
    let float = |n: usize| f64::from(u32::try_from(n).unwrap());
    let noise = |[x, y, z]: [usize; 3]| float((x * 7919 + y * 104_729 + z * 1_299_709) % 613);
    let from_middle = |place: [usize; 3]| -> f64 {
        (0..3).map(|axis| (float(place[axis]) - float(DIMS[axis]) / 2.0).powi(2)).sum::<f64>().sqrt()
    };
    // Smooth ones, one with neighbours that are mostly equal; one of noise; and one of noise with twice the voxels along each axis.
    let smooth = |place: [usize; 3]| (90.0 - 4.0 * from_middle(place)).max(0.0).round();
    let doubled = |place: [usize; 3]| noise(place.map(|at| at / 2)) % 97.0;
    let folder = Folder::new()
        .with("smooth.nrrd", nrrd("uint8", DIMS, "", smooth))
        .with("noise.nrrd", nrrd("int16", DIMS, "", noise))
        .with("float.nrrd", nrrd("float", DIMS, "", noise))
        .with("slow.nrrd", nrrd("uint8", [240, 10, 9], "", |[x, ..]| float(x / 2)))
        .with("doubled.nrrd", nrrd("int16", DIMS, "", doubled));
    for name in ["smooth.nrrd", "slow.nrrd", "noise.nrrd", "float.nrrd", "doubled.nrrd"] {
        let kind = values_of(&folder.path(name)).kind;
        assert_eq!(kind, Kind::Other(None), "{name}");
    }
}

#[test]
fn thousands_of_labels_share_colours_and_keep_the_plan_small() {
    // 18 × 16 × 14 blocks.
    const DIMS: [usize; 3] = [60, 54, 48];
    let id = |place: [usize; 3]| {
        block(place, DIMS, 3).map_or(0.0, |number| f64::from(u32::try_from(1 + number * 2651 % 4032).unwrap()))
    };
    let folder = Folder::new().with("cells.nrrd", nrrd("int32", DIMS, "", id));
    let file = looked_at(folder.path("cells.nrrd"), SceneOptions::default());
    let wanted: std::collections::BTreeSet<i64> = (0..18 * 16 * 14).map(|number| 1 + number * 2651 % 4032).collect();
    assert_eq!((ids(&file).len(), wanted.len()), (4032, 4032), "2651 and 4032 have no common factor");
    let scene = &file.scene;
    assert!(scene.materials.len() <= 40, "{}", scene.materials.len());
    assert!(file.text.len() < 20_000, "a scene of {} bytes", file.text.len());
    // Neighbours in number differ in colour.
    let entries = declared(&file);
    assert!(entries.windows(2).all(|pair| pair[0].material != pair[1].material));
    assert_eq!(entries[0].name, "label_1");
    // Over a scan too, and a saved scene says the same.
    let folder = folder
        .with("scan.nrrd", nrrd("int16", DIMS, "", |[x, y, z]| f64::from(u32::try_from(x + y * z % 91).unwrap())));
    let options = SceneOptions { labels: Some(folder.path("cells.nrrd")), ..SceneOptions::default() };
    let over = looked_at(folder.path("scan.nrrd"), options);
    assert_eq!(ids(&over), ids(&file));
    // A label that the window changes gets an entry of its own, and no other changes its colour.
    let mut document = Document::new(file.clone());
    document.edit(&Edit::Label(70, 3, 0.25));
    let path = folder.path("session.toml");
    let source = Source::of(&folder.path("cells.nrrd"));
    session::save(&path, &source, document.opened(), document.state()).unwrap();
    let again = looked_at(path, SceneOptions::default());
    let changed: Vec<usize> = (0..4032).filter(|&index| declared(&again)[index] != declared(&file)[index]).collect();
    let entry = &declared(&again)[70];
    assert_eq!((changed, entry.material, entry.opacity), (vec![70], 3, 0.25));
}

#[test]
fn a_hundred_and_eighteen_labels_over_their_ct_have_names_and_a_legend() {
    const DIMS: [usize; 3] = [42, 36, 33];
    let label = |place: [usize; 3]| {
        f64::from(u32::try_from(block(place, DIMS, 3).map_or(0, |number| 1 + number % 117)).unwrap())
    };
    let ct = |[x, y, z]: [usize; 3]| f64::from(i32::try_from(x * y % 900 + 3 * z).unwrap()) - 1000.0;
    let folder =
        Folder::new().with("ct.nrrd", nrrd("int16", DIMS, "", ct)).with("organs.nrrd", nrrd("uint8", DIMS, "", label));
    let options = SceneOptions {
        labels: Some(folder.path("organs.nrrd")),
        label_names: Some("totalsegmentator".into()),
        ..SceneOptions::default()
    };
    let over = looked_at(folder.path("ct.nrrd"), options.clone());
    assert_eq!(ids(&over), (1..=117).collect::<Vec<i64>>());
    let name = |label: usize| declared(&over)[label - 1].name.clone();
    assert_eq!([name(5), name(91), name(117)], ["liver", "skull", "costal_cartilages"]);
    let shown: Vec<usize> = (0..over.scene.materials.len()).filter(|&index| over.scene.shows(index)).collect();
    let legend = Entry::of_labels_and_materials(&over.scene, &shown, &Mix::of_scene(&over.scene));
    let listed: Vec<&str> = legend.iter().map(|entry| entry.name.as_str()).collect();
    assert!(["liver", "rib_left_2", "aorta"].iter().all(|name| listed.contains(name)), "{listed:?}");
    // Alone, by the same names.
    let alone = SceneOptions { label_names: options.label_names.clone(), ..SceneOptions::default() };
    let alone = looked_at(folder.path("organs.nrrd"), alone);
    assert_eq!(declared(&alone).len(), 117);
    assert_eq!(declared(&alone)[51].name, "aorta");
    assert!(alone.guess.as_ref().unwrap().contains("117 labels: spleen, "), "{:?}", alone.guess);
    // The command, and the scene that it saves.
    let arguments = [
        "render",
        "ct.nrrd",
        "--labels",
        "organs.nrrd",
        "--label-names",
        "totalsegmentator",
        "--annotate",
        "-D",
        "accuracy.accumulate=\"weights\"",
    ];
    let err =
        folder.done(&[&arguments[..], &["--size", "24x24", "-o", "p.png", "--save-scene", "s.toml"]].concat()).err;
    assert!(!err.contains("not used"), "{err}");
    let text = std::fs::read_to_string(folder.path("s.toml")).unwrap();
    assert!(text.contains("label_names = \"totalsegmentator\""), "{text}");
    let again = looked_at(folder.path("s.toml"), SceneOptions::default());
    assert_eq!(declared(&again), declared(&over));
}

#[test]
fn labels_that_share_a_material_have_their_own_lines_in_the_legend() {
    let scene = support::program::SCENE.replace("[transfer]", "[labels.1]\nname = \"left\"\nmaterial = \"flesh\"\nopacity = 0.5\n\
         [labels.2]\nname = \"right\"\nmaterial = \"flesh\"\nopacity = 0.5\n[labels.3]\nname = \"off\"\nmaterial = \"flesh\"\nopacity = 0\n[transfer]");
    let scene = scene.replace("dims = [32, 30, 18]", "dims = [32, 30, 18]\nphantom_labels = true");
    let folder = Folder::new().with("s.toml", scene);
    let file = looked_at(folder.path("s.toml"), SceneOptions::default());
    let all: Vec<usize> = (0..file.scene.materials.len()).collect();
    let entries = Entry::of_labels_and_materials(&file.scene, &all, &Mix::of_scene(&file.scene));
    let names: Vec<&str> = entries.iter().map(|entry| entry.name.as_str()).collect();
    assert!(names.contains(&"left") && names.contains(&"right") && !names.contains(&"off"), "{names:?}");
    // Those that values show keep their names.
    let by_value = all.iter().filter(|&&index| file.scene.shows_values_as(index));
    assert_eq!(names.len(), 2 + by_value.count(), "{names:?}");
}

#[test]
fn tables_name_and_colour_labels_and_say_what_they_lack() {
    const DIMS: [usize; 3] = [24, 20, 16];
    let ids = [17.0, 1035.0, 90_210.0];
    let id = |place: [usize; 3]| block(place, DIMS, 4).map_or(0.0, |number| ids[number % 3]);
    let folder = Folder::new()
        .with("map.nrrd", nrrd("int32", DIMS, "", id))
        .with("names.label", "# ITK-SnAP\n0 0 0 0 0 0 0 \"Clear Label\"\n90210 12 34 250 1 1 1 \"the hill\"\n17 9 9 9 1 1 1 \"the dale\"\n")
        .with("bad.csv", "label,name\n1,one\nx,two\n");
    let named = |names: &str| {
        let names = if names.contains('.') { folder.path(names) } else { names.into() };
        looked_at(folder.path("map.nrrd"), SceneOptions { label_names: Some(names), ..SceneOptions::default() })
    };
    let file = named("names.label");
    let names: Vec<&str> = declared(&file).iter().map(|entry| entry.name.as_str()).collect();
    assert_eq!(names, ["the dale", "label_1035", "the hill"]);
    assert!(file.text.contains("# #0c22fa in daylight"), "{}", file.text);
    let notes = &file.scene.labels.as_ref().unwrap().volume.notes;
    assert!(notes.iter().any(|note| note.contains("1 of 3 labels: 1035")), "{notes:?}");
    assert!(file.inputs.contains(&folder.path("names.label")), "{:?}", file.inputs);
    let file = named("freesurfer");
    let names: Vec<&str> = declared(&file).iter().map(|entry| entry.name.as_str()).collect();
    assert_eq!(names, ["Left-Hippocampus", "ctx-lh-insula", "label_90210"]);
    let bad = Source {
        path: Some(folder.path("map.nrrd")),
        options: SceneOptions { label_names: Some(folder.path("bad.csv")), ..SceneOptions::default() },
    };
    let problem = bad.read(&Quiet).unwrap_err().to_string();
    assert!(problem.contains("bad.csv, line 3") && problem.contains("x,two"), "{problem}");
    let info = folder.done(&["info", "map.nrrd", "--label-names", "freesurfer"]).out;
    assert!(info.contains("17 Left-Hippocampus #dcd814") && !info.contains("Left-Putamen"), "{info}");
    // Names without labels are told.
    let folder =
        folder.with("grey.nrrd", nrrd("int16", DIMS, "", |[x, y, z]| f64::from(u32::try_from(x * y + z * z).unwrap())));
    let names = SceneOptions { label_names: Some("freesurfer".into()), ..SceneOptions::default() };
    let grey = looked_at(folder.path("grey.nrrd"), names);
    assert!(
        grey.scene.volume().notes.iter().any(|note| note.contains("freesurfer are not used")),
        "{:?}",
        grey.scene.volume().notes
    );
}

#[test]
fn labels_on_another_anatomical_grid_are_resampled_with_a_note() {
    let placed = |spacing: f64, origin: f64| {
        format!(
            "space: left-posterior-superior\nspace directions: ({spacing},0,0) (0,{spacing},0) (0,0,{spacing})\n\
             space origin: ({origin},{origin},{origin})\n"
        )
    };
    // Boxes of both from -0.5 to 23.5.
    let grey = |[x, y, z]: [usize; 3]| f64::from(u32::try_from((x * x + y * y * z) % 211).unwrap());
    let label = |[x, _, _]: [usize; 3]| if (2..6).contains(&x) { 300.0 } else { 0.0 };
    let plain = |[x, _, _]: [usize; 3]| if x < 3 { 40.0 } else { 0.0 };
    let folder = Folder::new()
        .with("grey.nrrd", nrrd("int16", [24; 3], &placed(1.0, 0.0), grey))
        .with("coarse.nrrd", nrrd("uint16", [8; 3], &placed(3.0, 1.0), label))
        .with("elsewhere.nrrd", nrrd("uint16", [8; 3], &placed(3.0, 500.0), label))
        .with("plain.nrrd", nrrd("int16", [24; 3], "spacings: 1 1 1\n", grey))
        .with("half.nrrd", nrrd("uint8", [12; 3], "spacings: 2 2 2\n", plain));
    let over = |volume: &str, labels: &str| {
        let options = SceneOptions { labels: Some(folder.path(labels)), ..SceneOptions::default() };
        Source { path: Some(folder.path(volume)), options }.read(&Quiet).map(|(file, _)| file)
    };
    let map = |file: &SceneFile| -> Volume { (*file.scene.labels.as_ref().unwrap().volume).clone() };
    let found = map(&over("grey.nrrd", "coarse.nrrd").unwrap());
    assert_eq!(found.geometry.dims, [24; 3]);
    let line: Vec<i64> = (0..24).map(|x| found.label(x).unwrap()).collect();
    let wanted: Vec<i64> = (0..24).map(|x| if (6..18).contains(&x) { 300 } else { 0 }).collect();
    assert_eq!(line, wanted);
    assert!(found.notes.iter().any(|note| note.contains("resampled") && note.contains("8×8×8")), "{:?}", found.notes);
    let problem = over("grey.nrrd", "elsewhere.nrrd").unwrap_err().to_string();
    assert!(problem.contains("elsewhere.nrrd") && problem.contains("same grid"), "{problem}");
    // Files without anatomical axes share a place if they fill the same box.
    let found = map(&over("plain.nrrd", "half.nrrd").unwrap());
    let line: Vec<i64> = (0..24).map(|x| found.label(x).unwrap()).collect();
    assert_eq!(line.iter().filter(|&&label| label == 40).count(), 6, "{line:?}");
}

#[test]
fn blocks_of_labels_have_a_label_and_no_mean() {
    const DIMS: [usize; 3] = [28, 24, 20];
    let id = |place: [usize; 3]| block(place, DIMS, 4).map_or(0.0, |number| [3.0, 90.0, 7.0][number % 3]);
    // Blocks of three voxels lie across the labels.
    let folder = Folder::new().with("map.nrrd", nrrd("int16", DIMS, "", id));
    let file = looked_at(folder.path("map.nrrd"), SceneOptions { downsample: Some([3; 3]), ..SceneOptions::default() });
    let counts = file.scene.volume().label_counts(9).unwrap();
    assert_eq!(counts.keys().copied().collect::<Vec<_>>(), [0, 3, 7, 90]);
    assert!(
        file.scene.volume().notes.iter().any(|note| note.contains("most frequent")),
        "{:?}",
        file.scene.volume().notes
    );
}

#[test]
fn a_map_that_is_none_is_refused_with_its_own_name() {
    let folder = Folder::new()
        .with("grey.nrrd", nrrd("int16", [12; 3], "", |[x, y, z]| f64::from(u32::try_from(x * y + z).unwrap())))
        .with("parts.nrrd", nrrd("float", [12; 3], "", |[x, _, _]| f64::from(u32::try_from(x).unwrap()) / 4.0));
    let options = SceneOptions { labels: Some(folder.path("parts.nrrd")), ..SceneOptions::default() };
    let problem = Source { path: Some(folder.path("grey.nrrd")), options }.read(&Quiet).unwrap_err().to_string();
    assert!(problem.contains("parts.nrrd: voxel 1 holds 0.25") && problem.contains("whole numbers"), "{problem}");
}

#[test]
fn files_in_the_wrong_place_are_refused_or_told() {
    const DIMS: [usize; 3] = [42, 36, 33];
    let placed = |origin: f64| {
        format!(
            "space: left-posterior-superior\nspace directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: ({origin},0,0)\n"
        )
    };
    let number = |place: [usize; 3]| block(place, DIMS, 3).map_or(0, |number| 1 + number % 60);
    let label = move |place: [usize; 3]| f64::from(u32::try_from(number(place)).unwrap());
    let scan = |[x, y, z]: [usize; 3]| f64::from(u32::try_from((x * 7919 + y * 104_729 + z * 1301) % 997).unwrap());
    let folder = Folder::new()
        .with("scan.nrrd", nrrd("int16", DIMS, &placed(0.0), scan))
        .with("organs.nrrd", nrrd("uint8", DIMS, &placed(0.0), label))
        .with("far.nrrd", nrrd("uint8", DIMS, &placed(700.0), label));
    let over = |volume: &str, labels: &str| {
        let options = SceneOptions { labels: Some(folder.path(labels)), ..SceneOptions::default() };
        Source { path: Some(folder.path(volume)), options }.read(&Quiet).map(|(file, _)| file)
    };
    let notes = |file: &SceneFile| {
        let labels = file.scene.labels.iter().flat_map(|labels| &labels.volume.notes);
        file.scene.volume().notes.iter().chain(labels).cloned().collect::<Vec<_>>().join("\n")
    };
    // The label map and the scan in each other's place.
    let problem = over("organs.nrrd", "scan.nrrd").unwrap_err().to_string();
    assert!(problem.contains("organs.nrrd: its values are labels") && problem.contains("name the scan"), "{problem}");
    let twice = notes(&over("scan.nrrd", "scan.nrrd").unwrap());
    assert!(twice.contains("scan.nrrd: its values change from voxel to voxel"), "{twice}");
    let right = notes(&over("scan.nrrd", "organs.nrrd").unwrap());
    assert!(!right.contains("voxel to voxel") && !right.contains("outside"), "{right}");
    let outside = notes(&over("scan.nrrd", "far.nrrd").unwrap());
    assert!(outside.contains("labelled voxels lie outside the volume, so no label is shown"), "{outside}");
    // A film of k numbers has no names.
    let film =
        ["render", "scan.nrrd", "--labels", "organs.nrrd", "--label-names", "TotalSegmentator", "--size", "16x16"];
    let k = folder.done(&[&film[..], &["--accumulators", "k.exr", "--accumulate", "spectral"]].concat()).err;
    assert!(k.contains("no names of labels") && k.contains("--accumulate weights"), "{k}");
    let page = folder.done(&["page", "k.exr", "-o", "k.html"]).err;
    assert!(page.contains("the page names none"), "{page}");
}

#[test]
fn a_label_of_one_slice_has_short_steps_and_a_thick_one_has_not() {
    let map = |slices: usize| nrrd("uint16", [14, 12, 9], "", move |[_, _, z]| if z < slices { 7.0 } else { 0.0 });
    let folder = Folder::new().with("thin.nrrd", map(1)).with("thick.nrrd", map(4));
    let step = |name: &str| looked_at(folder.path(name), SceneOptions::default()).scene.accuracy.step_length;
    // Half of its voxels are inside the box of the volume: with steps of a voxel, one or two samples are in them.
    assert!((step("thin.nrrd") - 0.25).abs() < 1e-12, "a quarter of a voxel");
    assert!((step("thick.nrrd") - 1.0).abs() < 1e-12, "a voxel");
}
