//! The table of the scalar keys of a scene, its fields, and its documentation.

use crate::support;

use std::path::Path;

use relume::document::{self, Definition, SceneOptions};
use relume::progress::Quiet;
use relume::scene::key::{self, Key, Kind, Value};
use relume::scene::{Accuracy, Display, Material, Projection, Scene, SceneLight, Shadows};
use support::program::SCENE;

fn with(definition: &str) -> Result<Scene, String> {
    let options = SceneOptions { definitions: vec![Definition::new(definition)], ..SceneOptions::default() };
    let read = document::parse("test", SCENE, Path::new(""), &options, &Quiet);
    read.map(|file| file.scene).map_err(|error| error.to_string())
}

fn scene() -> Scene {
    with("version=1").unwrap()
}

/// Some allowed values of a key.
fn allowed(kind: Kind) -> Vec<Value<'static>> {
    match kind {
        Kind::Number([least, most], _) => {
            let inner = 0.5_f64.clamp(least, most);
            [least, inner, most].map(Value::Number).to_vec()
        }
        Kind::NumberOr([least, most], word) => {
            vec![Value::Number(least), Value::Number(0.5_f64.clamp(least, most)), Value::Name(word)]
        }
        Kind::Whole([least, most], word) => {
            let ends = [least, most].map(|end| Value::Number(relume::number::count(end)));
            ends.into_iter().chain(word.map(Value::Name)).collect()
        }
        Kind::Names(names) => names().into_iter().map(Value::Name).collect(),
        Kind::Switch => vec![Value::Switch(false), Value::Switch(true)],
    }
}

/// Some values that a key refuses.
fn refused(kind: Kind) -> Vec<Value<'static>> {
    let beyond = match kind {
        Kind::Number([least, most], _) | Kind::NumberOr([least, most], _) => {
            vec![(least - 1.0).next_down(), most * 2.0, f64::NAN, f64::INFINITY]
        }
        Kind::Whole([least, most], _) => [least, most].map(relume::number::count).map(|end| end * 1.5 - 0.75).to_vec(),
        Kind::Names(_) | Kind::Switch => vec![1.0],
    };
    let word = if matches!(kind, Kind::Switch) { None } else { Some(Value::Switch(true)) };
    beyond.into_iter().map(Value::Number).chain([Value::Name("nothing")]).chain(word).collect()
}

/// Asserts that the `keys` of `part` hold what is set, and refuse the rest.
fn holds<'k, T: Clone + 'static>(keys: impl IntoIterator<Item = &'k Key<T>>, part: &T) {
    for key in keys {
        for value in allowed(key.kind) {
            let mut changed = part.clone();
            key.set(&mut changed, Some(value)).unwrap();
            assert_eq!(key.get(&changed), Some(value), "{}", key.path);
            // Without a value it is left out, or stays as it is.
            let is_left = key.set(&mut changed, None).is_ok();
            assert_eq!(key.get(&changed), Some(value).filter(|_| !is_left), "{}", key.path);
        }
        for value in refused(key.kind) {
            let mut changed = part.clone();
            let error = key.set(&mut changed, Some(value)).unwrap_err().to_string();
            assert_eq!(key.get(&changed), key.get(part), "{}", key.path);
            let stated = value.to_string();
            let stated = stated.trim_matches('"');
            for word in [&format!("{} = ", key.path), stated, &key.kind.allowed()] {
                assert!(error.contains(word), "{error} has no {word}");
            }
        }
    }
}

#[test]
fn every_key_holds_what_is_set_and_refuses_the_rest_by_name_and_range() {
    let scene = scene();
    holds(key::MATERIAL, &scene.materials[0]);
    holds(key::LIGHT, &scene.lights[0]);
    let (height, others): (Vec<_>, Vec<_>) = key::SCENE.iter().partition(|key| key.path == "camera.height");
    holds(others, &scene);
    let mut parallel = scene.clone();
    parallel.camera.projection = Projection::Orthographic { height: None };
    holds(height.iter().copied(), &parallel);
    let wrong = height[0].set(&mut scene.clone(), Some(Value::Number(3.0))).unwrap_err().to_string();
    assert!(wrong.contains("camera.height = 3") && wrong.contains("another kind of camera"), "{wrong}");
    let missing = key::of_scene("accuracy.rays").unwrap().set(&mut scene.clone(), None).unwrap_err().to_string();
    assert_eq!(missing, "accuracy.rays = nothing; it must be a whole number from 1 to 256");
    key::of_scene("shadows.reach").unwrap().set(&mut scene.clone(), None).unwrap();
}

#[test]
fn a_file_refuses_what_the_table_refuses_and_suggests_a_name() {
    for key in key::SCENE.iter().filter(|key| key.path != "camera.height") {
        for value in allowed(key.kind).into_iter().filter(|value| *value != Value::Number(f64::MAX)) {
            let scene = with(&format!("{}={value}", key.path)).unwrap();
            assert_eq!(key.get(&scene), Some(value), "{}", key.path);
        }
        for value in refused(key.kind).into_iter().filter(|value| !value.to_string().contains("NaN")) {
            let error = with(&format!("{}={value}", key.path)).unwrap_err();
            assert!(error.contains(key.path) && error.contains(&key.kind.allowed()), "{error}");
        }
    }
    let misspelt = with("accuracy.integration=segmets").unwrap_err();
    assert!(misspelt.contains("did you mean `segments`?"), "{misspelt}");
    let misspelt = with("accuracy.terminaton=0.1").unwrap_err();
    assert!(misspelt.contains("did you mean `termination`?"), "{misspelt}");
    for definition in ["accuracy.rays=[1]", "lights.day.intensity={}", "materials.flesh.phase=[0.5]"] {
        let error = with(definition).unwrap_err();
        assert!(error.contains("number from"), "{error}");
    }
}

/// The fields of the parts that have keys alone. A new field does not compile until it is listed here, and then needs a key.
fn fields(scene: &Scene) -> Vec<String> {
    let Accuracy {
        step_length,
        termination,
        rays,
        jitter,
        integration,
        variation,
        skipping,
        interpolation,
        labels,
        volume,
        gradients,
        accumulate,
        model,
        tolerance,
        dimension,
        voxel_pixels,
        storage,
    } = &scene.accuracy;
    let Shadows { method, spacing, start, ambient, directions, reach } = scene.shadows;
    let Display { exposure, tone, backdrop, adapt, observer, deficiency } = &scene.display;
    vec![
        format!("{step_length}"),
        format!("{termination}"),
        format!("{rays}"),
        format!("{jitter}"),
        format!("{integration:?}"),
        format!("{variation}"),
        format!("{skipping}"),
        format!("{interpolation:?}"),
        format!("{labels:?}"),
        format!("{volume:?}"),
        format!("{gradients:?}"),
        format!("{accumulate:?}"),
        format!("{model:?}"),
        format!("{tolerance}"),
        format!("{dimension:?}"),
        format!("{voxel_pixels}"),
        format!("{storage:?}"),
        format!("{method:?}"),
        format!("{spacing}"),
        format!("{start:?}"),
        format!("{ambient:?}"),
        format!("{directions}"),
        format!("{reach:?}"),
        format!("{exposure:?}"),
        format!("{tone:?}"),
        format!("{backdrop:?}"),
        format!("{adapt}"),
        format!("{observer:?}"),
        format!("{deficiency:?}"),
    ]
}

#[test]
fn every_field_of_accuracy_shadows_and_display_has_a_key_of_its_own() {
    let scene = scene();
    let before = fields(&scene);
    let mut found: Vec<usize> = Vec::new();
    let tables = ["accuracy.", "shadows.", "display."];
    for key in key::SCENE.iter().filter(|key| tables.iter().any(|table| key.path.starts_with(table))) {
        let mut changed = scene.clone();
        let other = allowed(key.kind).into_iter().find(|value| Some(*value) != key.get(&scene)).unwrap();
        key.set(&mut changed, Some(other)).unwrap();
        let after = fields(&changed);
        let differ: Vec<usize> = (0..before.len()).filter(|&field| before[field] != after[field]).collect();
        assert_eq!(differ.len(), 1, "{} changes one field", key.path);
        found.extend(differ);
    }
    found.sort_unstable();
    assert_eq!(found, (0..before.len()).collect::<Vec<_>>(), "a field without a key, or two keys of one");
}

/// The example of docs/SCENE.md: tables, keys, and the text of each key with its comment in one line.
fn documented() -> Vec<(String, String, String)> {
    let text = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/SCENE.md")).unwrap();
    let (mut table, mut found) = (String::new(), Vec::<(String, String, String)>::new());
    for line in text.split("```toml\n").nth(1).unwrap().split("```").next().unwrap().lines() {
        let key =
            line.trim_start_matches("# ").split_once(" = ").filter(|(key, _)| !key.contains([' ', '#', '{', '[']));
        match (line.trim_start(), key) {
            (header, _) if header.starts_with('[') => {
                table = header.trim_matches('[').split(']').next().unwrap().to_owned();
            }
            (more, _) if more.starts_with('#') && line.starts_with("    ") => {
                let last = found.last_mut().unwrap();
                last.2 += &format!(" {}", more.trim_start_matches("# "));
            }
            (_, Some((key, rest))) => found.push((table.clone(), key.to_owned(), rest.to_owned())),
            _ => {}
        }
    }
    found
}

/// Asserts that docs/SCENE.md states the `keys` of a table with their names, range and default, that of `new`.
fn documents<T>(keys: &[Key<T>], table: impl Fn(&str) -> (String, String), new: &T) {
    let documented = documented();
    for key in keys {
        let (table, name) = table(key.path);
        let found = documented.iter().find(|(in_table, key, _)| (in_table, key) == (&table, &name));
        let text = &found.unwrap_or_else(|| panic!("[{table}] {name} is not in docs/SCENE.md")).2;
        let states = |words: &str| assert!(text.contains(words), "{table}.{name} does not state {words}: {text}");
        let words: Vec<&str> = text.split(' ').map(|word| word.trim_end_matches([',', ';', ':', '.', ')'])).collect();
        let ranges = |least: f64, most: f64| {
            let is_range = words.windows(3).any(|part| {
                let end = |word: &str| word.trim_start_matches('(').parse::<f64>().ok();
                part[1] == "to" && end(part[0]) == Some(least) && end(part[2]) == Some(most)
            });
            assert!(is_range, "{table}.{name} does not state {least} to {most}: {text}");
        };
        match key.kind {
            Kind::Number([least, most], _) if most < f64::MAX => ranges(least, most),
            Kind::NumberOr([least, most], word) => {
                ranges(least, most);
                states(&format!("{word:?}"));
            }
            Kind::Number([least, _], _) if least > 0.0 => states("above 0"),
            Kind::Whole([least, most], _) => ranges(relume::number::count(least), relume::number::count(most)),
            Kind::Names(names) => names().into_iter().for_each(|name| states(&format!("{name:?}"))),
            Kind::Number(..) | Kind::Switch => {}
        }
        let default = key.get(new).map_or_else(String::new, |value| value.to_string());
        match key.otherwise {
            Some(words) => states(words),
            None if words[0] == default => {}
            None => states(&format!("{default}, the default")),
        }
    }
}

#[test]
fn the_documentation_states_every_key_with_its_range_and_default() {
    let scene = scene();
    let new = Scene::new("", scene.volume().clone());
    let parts = |path: &str| {
        path.split_once('.')
            .map_or((String::new(), path.to_owned()), |(table, name)| (table.to_owned(), name.to_owned()))
    };
    documents(key::SCENE, parts, &new);
    let material = Material::new("", scene.materials[0].reflectance.clone());
    documents(key::MATERIAL, |name| ("materials.flesh".to_owned(), name.to_owned()), &material);
    let light = SceneLight::new("", scene.lights[0].spectrum.clone());
    documents(key::LIGHT, |name| ("lights.day".to_owned(), name.to_owned()), &light);
}

#[test]
fn a_list_of_a_stated_length_has_no_number_too_much() {
    for (definition, length) in [
        ("camera.up=[0, 0, 1, 5]", 3),
        ("camera.around=[[0, 0, 0], [1, 1, 1], [2, 2, 2]]", 2),
        ("camera.around=[[0, 0, 0], [1, 1, 1, 9]]", 3),
        ("crop={min=[1, 1, 1, 1], max=[3, 3, 3]}", 3),
        ("volume.spacing=[1, 1, 1, 1]", 3),
        ("volume.direction=[1, 0, 0, 0, 1, 0, 0, 0, 1, 0]", 9),
        ("volume.downsample=[2, 2, 2, 2]", 3),
        ("transfer.intervals=[{material=\"bone\", range=[1, 2, 3], opacity=0.1}]", 2),
        ("transfer.gradient_opacity=[[0, 0.1], [1, 0.2, 0.3]]", 2),
        ("transfer.intervals=[{material=\"bone\", range=[1, 2], opacity=0.1, gradient=[[0, 0.1, 1]]}]", 2),
        ("transfer.opacity=[[0, 0.1, 1], [9, 1]]", 2),
        ("transfer.material=[[0, \"bone\", 1]]", 2),
        ("dial.nodes.day=[0, 1, 2]", 2),
        ("lights.day.direction=[0, 0, -1, 5]", 3),
        ("palette={lights={a={bounds=[0, 1, 2]}}, materials={}, cells={}}", 2),
    ] {
        let error = with(definition).unwrap_err();
        assert!(error.contains(&format!("expected an array of length {length}")), "{definition}: {error}");
    }
}
