//! Phase functions: closed forms of single scattering, reciprocity, plans, and the device against the reference.
#![expect(clippy::float_cmp, reason = "a number is the stated one or another one")]

use crate::shadows::{SINGLE, ball, balls_lit, block, middle, occluded, slabs, towards, weights};
use crate::support;

use std::path::Path;

use glam::DVec3;
use relume::document::{self, Document, Edit, SceneFile, SceneOptions, Source};
use relume::plan::{Accumulate, PlanWarning, Stale, plan};
use relume::progress::Quiet;
use relume::reference;
use relume::scene::{Placement, Scene, Shading, StoreAs};
use relume::tables::sky_direction;
use support::rungs::Rungs;
use support::scenes::{self, SIZE, float};

/// The phase function of Henyey and Greenstein for the cosine of the angle by which a ray turns.
fn phase(g: f64, cosine: f64) -> f64 {
    (1.0 - g * g) / (1.0 + g * g - 2.0 * g * cosine).powf(1.5)
}

/// `scene` with this phase function of all materials.
fn scattering(mut scene: Scene, g: f64) -> Scene {
    scene.materials.iter_mut().for_each(|material| material.phase = g);
    scene
}

/// `scene` with another phase function of each material.
fn with_phases(mut scene: Scene) -> Scene {
    for (material, g) in scene.materials.iter_mut().zip([0.6, -0.3, 0.0, 0.85, 0.6]) {
        material.phase = g;
    }
    scene
}

/// Phase functions from those that send light back to those that send it on.
const PARAMETERS: [f64; 6] = [-0.99, -0.4, 0.1, 0.5, 0.9, 0.99];

#[test]
fn a_slab_scatters_once_by_the_closed_form_of_its_phase_function() {
    for (depth, light, even) in slabs() {
        for g in PARAMETERS {
            // The eye is at −z, and light turns by the angle between −l and v.
            let turned = phase(g, light[2]);
            let scene = block(DVec3::new(40.0, 40.0, 1.0), depth, &towards(light), 1.0 / 200.0, 1.0);
            let found = middle(scattering(scene, g));
            let error = (found - even * turned).abs();
            assert!(
                error <= SINGLE * turned,
                "depth {depth}, light {light:?}, g = {g}: {found}, not {}",
                even * turned
            );
        }
    }
}

#[test]
fn a_ball_scatters_once_by_the_closed_form_of_its_phase_function() {
    let step = 1.0 / 200.0;
    for g in [-0.4, 0.7] {
        for (light, even) in [([0.0, 0.0, -1.0], 0.399_009), ([1.0, 0.0, 0.0], 0.275_937), ([0.0, 0.0, 1.0], 0.119_489)]
        {
            let scene = scattering(block(DVec3::splat(2.0), 1.5, &towards(light), step, 3.0), g);
            let planned = plan(&scene, &Quiet).unwrap();
            let film = reference::march(&scene, &planned, &ball(1.5, step), [3, 3], &Quiet).unwrap();
            let (found, expected) = (0.8 * film.accumulators[4], even * phase(g, light[2]));
            assert!(
                (found - expected).abs() <= SINGLE * expected.max(1.0),
                "g = {g}, {light:?}: {found}, not {expected}"
            );
        }
        // The headlight: back to the eye.
        let scene = scattering(block(DVec3::splat(2.0), 1.5, "", step, 3.0), g);
        let planned = plan(&scene, &Quiet).unwrap();
        let film = reference::march(&scene, &planned, &ball(1.5, step), [3, 3], &Quiet).unwrap();
        let (found, expected) = (0.8 * film.accumulators[4], 0.399_009 * phase(g, -1.0));
        assert!((found - expected).abs() <= SINGLE * expected.max(1.0), "headlight, g = {g}: {found}, not {expected}");
    }
}

/// The block without shadows, lit from this direction.
fn open_block(direction: DVec3) -> Scene {
    let mut scene = block(DVec3::splat(2.0), 1.0, &towards(direction.to_array()), 0.25, 1.0);
    scene.lights[0].shadows = false;
    scene
}

#[test]
fn a_phase_function_is_one_on_average_over_all_directions() {
    /// Directions of the lattice, on which the narrower of the two is summed to 10⁻⁴.
    const DIRECTIONS: usize = 800;
    let even = middle(open_block(DVec3::Z));
    for g in [-0.5, 0.6] {
        let sum: f64 = (0..DIRECTIONS).map(|i| middle(scattering(open_block(sky_direction(i, DIRECTIONS)), g))).sum();
        let mean = sum / float(DIRECTIONS);
        assert!((mean / even - 1.0).abs() <= 1e-3, "g = {g}: {}", mean / even);
    }
    // Ambient light comes from all of them.
    let mut ambient = open_block(DVec3::Z);
    ambient.lights[0].placement = Placement::Ambient;
    assert_eq!(middle(scattering(ambient, 0.6)).to_bits(), even.to_bits(), "ambient light is scattered evenly");
}

#[test]
fn light_and_eye_can_be_exchanged_with_phase_functions() {
    let [one, other] = [DVec3::new(-0.8, 0.6, 0.0), DVec3::new(0.3, 0.5, 0.8)].map(DVec3::normalize);
    let mean = |eye, light, g| {
        let found = weights(scattering(balls_lit(eye, light), g), [40, 40]);
        found.iter().sum::<f64>() / float(found.len())
    };
    for g in [-0.5, 0.6] {
        let [there, back] = [mean(one, other, g), mean(other, one, g)];
        assert!((there / back - 1.0).abs() <= 0.004, "g = {g}: {there} and {back}");
        // The phase function has changed them.
        let even = mean(one, other, 0.0);
        assert!((there / even - phase(g, -one.dot(other))).abs() <= 1e-9, "g = {g}: {there} and {even}");
    }
}

/// A named scene without shading.
fn unshaded(name: &str) -> Scene {
    let mut scene = scenes::named(name);
    scene.shading = Shading::None;
    scene
}

#[test]
fn equal_phase_functions_share_a_part_of_a_table_entry() {
    let of = |changes: &str| plan(&scenes::changed("phases_coloured", changes), &Quiet).unwrap().plan;
    let (apart, shared) = (of(""), of("materials.middle.phase = 0.6"));
    assert!(matches!(shared.accumulate, Accumulate::Spectral { .. }));
    assert_eq!((apart.phases, shared.phases), (3, 2));
    assert_eq!(apart.parts().lanes * 2, shared.parts().lanes * 3);
}

#[test]
fn a_three_point_light_by_phase_functions_equals_three_directional_lights() {
    for shadows in [false, true] {
        let mut scene = with_phases(occluded("none"));
        scene.lights.truncate(1);
        scene.lights[0].shadows = shadows;
        let view = scene.camera.view(&scene.frame.geometry, 1.0).unwrap();
        let lights = relume::scene::three_point(&view);
        let sum: f64 = lights.iter().map(|light| light.1).sum();
        let lit = |placement: Placement| {
            let mut scene = scene.clone();
            scene.lights[0].placement = placement;
            let rungs = Rungs::new(scene, SIZE);
            rungs.march(&rungs.exact()).accumulators
        };
        let apart = lights.map(|(direction, weight)| (lit(Placement::Directional(direction)), weight / sum));
        for (i, found) in lit(Placement::ThreePoint).into_iter().enumerate() {
            let expected: f64 = apart.iter().map(|(light, part)| part * light[i]).sum();
            assert!((found - expected).abs() <= 1e-6 * expected.max(1.0), "shadows {shadows}: {found}, not {expected}");
        }
    }
}

#[test]
fn a_phase_function_marches_again_only_where_it_has_an_effect() {
    let stale = |scene: &Scene, change: fn(&mut Scene)| {
        let mut after = scene.clone();
        change(&mut after);
        Stale::between(scene, &plan(scene, &Quiet).unwrap(), &after)
    };
    let weights = with_phases(occluded("none"));
    assert_eq!(stale(&weights, |scene| scene.materials[0].phase = 0.2), Stale::Accumulators);
    assert_eq!(stale(&weights, |scene| scene.materials.iter_mut().for_each(|it| it.phase = 0.0)), Stale::Tables);
    assert_eq!(stale(&occluded("none"), |scene| scene.materials[0].phase = 0.2), Stale::Tables);
    let coloured = with_phases(unshaded("coloured_three"));
    assert_eq!(stale(&coloured, |scene| scene.materials[0].phase = 0.2), Stale::Tables);
    assert_eq!(stale(&occluded("gradient"), |scene| scene.materials[0].phase = 0.2), Stale::Nothing);
}

#[test]
fn numbers_too_large_for_16_bits_by_a_phase_function_are_refused() {
    let half = |g: f64| {
        let mut scene = scattering(scenes::named("xray"), g);
        (scene.accuracy.storage, scene.accuracy.tolerance) = (StoreAs::Half, 50.0);
        plan(&scene, &Quiet)
    };
    assert!(half(0.5).is_ok());
    let error = half(0.99).unwrap_err();
    assert_eq!(error.code(), "half-overflow", "{error}");
}

/// A scene with a material, of which `keys` are more keys, and one light.
pub(super) fn opened(keys: &str, shading: &str) -> Result<SceneFile, document::SceneError> {
    let text = format!(
        r#"
        version = 1
        shading = "{shading}"
        [volume]
        phantom = "slab"
        dims = [4, 4, 4]
        [materials.wing]
        reflectance = "orange"
        {keys}
        [[transfer.intervals]]
        material = "wing"
        range = [0, 255]
        opacity = 0.1
        [lights.day]
        spectrum = "D65"
        kind = "directional"
        direction = [0, 0, 1]
    "#
    );
    document::parse("test", &text, Path::new(""), &SceneOptions::default(), &Quiet)
}

#[test]
fn the_key_of_a_phase_function_is_read_and_checked() {
    assert_eq!(opened("", "none").unwrap().scene.materials[0].phase, 0.0);
    assert_eq!(opened("phase = -0.99", "none").unwrap().scene.materials[0].phase, -0.99);
    for wrong in ["1", "-1", "0.991", "nan"] {
        let error = opened(&format!("phase = {wrong}"), "none").unwrap_err();
        let told = format!("{error:?} {error}");
        assert!(told.contains("materials.wing.phase") && told.contains("from -0.99 to 0.99"), "{wrong}: {told}");
    }
    let scene = opened("phase = 0.3", "none").unwrap().scene;
    let planned = plan(&scene, &Quiet).unwrap();
    assert_eq!(planned.warnings, []);
    let told = planned.explain(&scene).join("\n");
    assert!(told.contains("phase functions in wing (phase = 0.3, mostly forwards)"), "{told}");
    // With shading by gradients it has no effect, and the plan says so.
    let scene = opened("phase = 0.3", "gradient").unwrap().scene;
    let planned = plan(&scene, &Quiet).unwrap();
    assert_eq!(planned.warnings, [PlanWarning::PhaseUnused { materials: "wing".into(), is_extreme: false }]);
    assert_eq!(planned.warnings[0].code(), "phase-unused");
    let told = planned.warnings[0].to_string();
    assert!(told.contains("wing") && told.contains("shading = \"none\""), "{told}");
}

#[test]
fn a_material_keeps_its_phase_function_in_a_session_and_in_the_history() {
    let mut edited = Document::new(opened("phase = 0.3", "none").unwrap());
    let of = |document: &Document| document.state().scene.materials[0].phase;
    edited.edit(&Edit::Phase(0, -0.25));
    assert_eq!(of(&edited), -0.25);
    assert!(!edited.is_saved());
    let path = Path::new("session.toml");
    let text = document::session::text(path, &Source::default(), edited.opened(), edited.state()).unwrap();
    let again = document::parse("again", &text, Path::new(""), &SceneOptions::default(), &Quiet).unwrap();
    assert_eq!(again.scene.materials[0].phase, -0.25);
    edited.undo();
    assert_eq!(of(&edited), 0.3);
    for (wanted, kept) in [(7.0, 0.99), (f64::NEG_INFINITY, 0.3), (f64::NAN, 0.3), (-3.0, -0.99)] {
        edited.edit(&Edit::Phase(0, wanted));
        assert_eq!(of(&edited), kept, "{wanted}");
        edited.undo();
    }
    edited.edit(&Edit::Phase(9, 0.5));
    assert_eq!(of(&edited), 0.3, "there is no such material");
}
