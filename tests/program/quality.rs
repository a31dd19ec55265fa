//! `--quality`: one word for step, rays, samples, shadows and sky.

use crate::support::program::Folder;

/// A shaded ball under a sun and an ambient light, with a step of its own.
const SUN: &str = r#"version = 1
lighting = "one_sided"
[volume]
phantom = "frog"
[transfer]
intervals = [{ material = "skin", range = [40, 255], ramp = 10, opacity = 0.3 }]
[materials.skin]
reflectance = 0.7
[lights.sun]
spectrum = "D65"
kind = "directional"
direction = [1, -1, 1]
[lights.sky]
spectrum = "D65"
kind = "ambient"
[accuracy]
step = 0.25
interpolation = "cubic"
"#;

/// The scene that `arguments` make of `scene.toml`, as they save it.
fn saved(folder: &Folder, arguments: &[&str]) -> toml::Table {
    folder.done(&[&["render", "scene.toml", "--size", "8x8", "--save-scene", "s.toml"][..], arguments].concat());
    std::fs::read_to_string(folder.path("s.toml")).unwrap().parse().unwrap()
}

/// The value at a dotted key.
fn at<'t>(table: &'t toml::Table, key: &str) -> Option<&'t toml::Value> {
    let mut keys = key.split('.');
    let first = table.get(keys.next()?)?;
    keys.try_fold(first, |value, key| value.get(key))
}

#[test]
fn a_quality_is_one_word_for_samples_rays_shadows_and_sky() {
    let folder = Folder::new().with("scene.toml", SUN);
    let text = |table: &toml::Table, key: &str| at(table, key).map(ToString::to_string).unwrap_or_default();
    for (quality, integration, rays, casts, ambient, spacing) in [
        ("draft", "samples", "1", "false", "open", "4"),
        ("good", "adaptive", "1", "true", "occluded", "4"),
        ("best", "adaptive", "4", "true", "occluded", "2"),
    ] {
        let scene = saved(&folder, &["--quality", quality]);
        assert_eq!(text(&scene, "accuracy.integration"), format!("{integration:?}"), "{quality}");
        assert_eq!(text(&scene, "accuracy.jitter"), "true", "{quality}");
        assert_eq!(text(&scene, "accuracy.rays"), rays, "{quality}");
        assert_eq!(text(&scene, "lights.sun.shadows"), casts, "{quality}");
        assert_eq!(text(&scene, "shadows.ambient"), format!("{ambient:?}"), "{quality}");
        assert_eq!(text(&scene, "shadows.spacing").trim_end_matches(".0"), spacing, "{quality}");
        // The step is that of scenes without one; interpolation and ambient lights stay.
        assert_eq!(at(&scene, "accuracy.step"), None, "{quality}");
        assert_eq!(text(&scene, "accuracy.interpolation"), "\"cubic\"", "{quality}");
        assert_ne!(text(&scene, "lights.sky.shadows"), "true", "{quality}");
    }
    let changed = saved(&folder, &["--quality", "best", "-D", "accuracy.rays=2", "-D", "shadows.ambient=open"]);
    assert_eq!((text(&changed, "accuracy.rays"), text(&changed, "shadows.ambient")), ("2".into(), "\"open\"".into()));
    assert_eq!(text(&changed, "lights.sun.shadows"), "true", "the others stay");
}

#[test]
fn a_quality_is_for_any_scene_and_told() {
    let glass = SUN.replace(
        "reflectance = 0.7",
        "reflectance = 0.7\nabsorption = { gaussian = [{ centre = 540, sigma = 40, height = 1 }] }",
    );
    let folder = Folder::new().with("scene.toml", SUN).with("glass.toml", glass);
    // There is no sky in coloured media.
    for quality in ["draft", "good", "best"] {
        let plan = folder.done(&["info", "glass.toml", "--quality", quality, "--json"]).json();
        let told = plan.to_string();
        assert!(!told.contains("evenly bright sky"), "{quality}: {told}");
        assert_eq!(told.contains("4 rays"), quality == "best", "{quality}: {told}");
    }
    let best = folder.done(&["info", "scene.toml", "--quality", "best"]).out;
    assert!(best.contains("evenly bright sky") && best.contains("4 rays"), "{best}");
    let maximum = ["info", "scene.toml", "--quality", "best", "-D", "blending=maximum"];
    let told = folder.done(&maximum).err;
    assert!(told.contains("adaptive") && told.contains("no effect"), "a key of -D comes later: {told}");
    folder.with("m.toml", SUN.replace("lighting", "blending = \"maximum\"\nlighting")).done(&[
        "render",
        "m.toml",
        "--quality",
        "best",
        "--size",
        "8x8",
        "-o",
        "m.png",
    ]);
}

#[test]
fn unknown_qualities_are_refused_with_the_similar_one() {
    let folder = Folder::new().with("scene.toml", SUN);
    folder.refused(
        2,
        &["render", "scene.toml", "--quality", "goot", "-o", "p.png"],
        &["goot", "good", "draft", "best"],
    );
}
