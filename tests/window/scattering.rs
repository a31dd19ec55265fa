//! Light that scatters more than once in the window: rough before it is complete, and waited for only at rest.

use relume::scene::Orders;
use relume::view::Engine;
use relume::volume::HostMemory;

use crate::bricks::{SIZE, azimuth, film, opened, until};
use crate::support::program::Folder;
use crate::support::rungs::with_renderer;

/// A light that turns with the camera, so that each view has scattered light of its own.
const SCENE: &str = r#"version = 1
shading = "none"
[volume]
phantom = "shells"
dims = [30, 30, 30]
[materials.all]
reflectance = 0.9
[transfer]
intervals = [{ material = "all", range = [0.3, 1], ramp = 0.2, opacity = 0.1 }]
[lights.day]
spectrum = "D65"
kind = "three_point"
[scattering]
orders = "multiple"
spacing = 1
directions = 8
"#;

#[test]
fn scattered_light_comes_at_rest_and_a_hand_that_moves_waits_for_none() {
    with_renderer(|renderer| {
        let folder = Folder::new().with("scene.toml", SCENE);
        let path = folder.path("scene.toml");
        let (mut engine, mut state) = opened(renderer, &path, HostMemory::Whole);
        engine.update(&state, SIZE);
        for _ in 0..4 {
            until(&mut engine, |engine| engine.reached().first);
            assert!(!engine.is_finest(), "a first picture waits for no scattered light");
            // Some way into the next one.
            engine.step(true).unwrap();
            assert!(engine.progress().is_some());
            *azimuth(&mut state) += 15.0;
            assert!(engine.update(&state, SIZE), "the camera");
            assert!(engine.progress().is_none(), "it waits no longer for light of the view before");
        }
        until(&mut engine, Engine::is_finest);
        let turned = film(&engine);
        let (mut fresh, mut same) = opened(renderer, &path, HostMemory::Whole);
        *azimuth(&mut same) += 60.0;
        fresh.update(&same, SIZE);
        until(&mut fresh, Engine::is_finest);
        assert!(film(&fresh) == turned, "nothing of the other views is left");

        // Another intensity needs no march.
        let marches = engine.counts().marches;
        state.scene.lights[0].intensity = 0.4;
        assert!(!engine.update(&state, SIZE), "the intensity of a light");
        assert_eq!(engine.counts().marches, marches);
        state.scene.scattering.orders = Orders::Single;
        assert!(engine.update(&state, SIZE), "once");
        until(&mut engine, Engine::is_finest);
        assert!(film(&engine) != turned);
        state.scene.scattering.orders = Orders::Multiple;
        engine.update(&state, SIZE);
        until(&mut engine, Engine::is_finest);
        assert!(film(&engine) == turned, "the same light");
        engine.end();
        fresh.end();
    });
}
