//! Shadows: closed forms of single scattering, occluders, the light grid, and the device against the reference.

#[path = "../../benches/instruments/shadows.rs"]
mod instrument;
use crate::matrix::{bits, differences};
use crate::support;

use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::{DMat3, DVec3};
use relume::document::{self, Document, Edit, SceneFile, SceneOptions, Source};
use relume::plan::{Stale, plan};
use relume::progress::Quiet;
use relume::reference::{self, End, Exact, Keeping, KeptDepths, Samples, Step};
use relume::render::{Dispatching, LightQuality, SceneRenderer};
use relume::scene::{
    Aim, AmbientShares, Interpolation, Lighting, Placement, Projection, Scene, SceneLight, Shading, ShadowMethod,
};
use relume::tables::sky_direction;
use relume::volume::{Geometry, Volume, Voxels};
use support::rungs::{Rungs, with_renderer};
use support::scenes::{self, SIZE, float, of};

/// A box of a constant medium with this optical depth per unit of length, unshaded, seen along +z by parallel rays;
/// `light` is the table of its light.
pub(super) fn block(extent: DVec3, depth: f64, light: &str, step: f64, height: f64) -> Scene {
    let geometry = Geometry::new("block", [2, 2, 2], extent, -extent / 2.0, DMat3::IDENTITY).unwrap();
    let opacity = -(-depth).exp_m1();
    let text = format!(
        r#"
        shading = "none"
        [materials.only]
        reflectance = "orange"
        [transfer]
        opacity_length = 1
        [[transfer.intervals]]
        material = "only"
        range = [0, 255]
        opacity = {opacity:e}
        [lights.day]
        spectrum = "D65"
        shadows = true
        {light}
        [shadows]
        method = "rays"
        start = 0
        [camera]
        projection = "orthographic"
        height = {height}
        position = [0, 0, -10]
        target = [0, 0, 0]
        up = [0, 1, 0]
        [accuracy]
        step = {step}
        termination = 0
    "#
    );
    let mut scene = of(&text, Volume::new("block", Voxels::U8(vec![100; 8]), geometry).unwrap());
    scene.set_volume(Volume::new("block", Voxels::U8(vec![100; 8]), geometry).unwrap().into());
    scene
}

pub(super) fn towards(direction: [f64; 3]) -> String {
    format!("kind = \"directional\"\ndirection = {direction:?}")
}

/// Weights of the first material of a picture.
pub(super) fn weights(scene: Scene, size: [usize; 2]) -> Vec<f64> {
    let rungs = Rungs::new(scene, size);
    rungs.march(&rungs.exact()).accumulators[..size[0] * size[1]].to_vec()
}

pub(super) fn middle(scene: Scene) -> f64 {
    weights(scene, [1, 1])[0]
}

/// Largest error of single scattering at a step of 1/200.
pub(super) const SINGLE: f64 = 2e-3;

/// Slabs seen along their normal: τ, cosine of the light, whether it is behind, and the closed form.
pub(super) fn slabs() -> impl Iterator<Item = (f64, [f64; 3], f64)> {
    [0.5_f64, 2.0].into_iter().flat_map(|depth| {
        [1.0_f64, 0.5].into_iter().flat_map(move |cosine| {
            let sine = (1.0 - cosine * cosine).sqrt();
            let reflected = cosine / (cosine + 1.0) * -(-depth * (1.0 + 1.0 / cosine)).exp_m1();
            let through = if cosine < 1.0 {
                cosine / (cosine - 1.0) * ((-depth / cosine).exp() - (-depth).exp())
            } else {
                depth * (-depth).exp()
            };
            [(depth, [sine, 0.0, -cosine], reflected), (depth, [sine, 0.0, cosine], through)]
        })
    })
}

#[test]
fn a_slab_scatters_once_as_its_closed_form_says() {
    for (depth, light, expected) in slabs() {
        let at = |step: f64| middle(block(DVec3::new(40.0, 40.0, 1.0), depth, &towards(light), step, 1.0)) - expected;
        let error = at(1.0 / 200.0).abs();
        assert!(error <= SINGLE, "depth {depth}, light {light:?}: {expected} is missed by {error:e}");
        let [coarse, fine] = [1.0 / 8.0, 1.0 / 16.0].map(|step| at(step).abs());
        // From behind, the light of all depths may be equal: every step is exact.
        assert!(
            coarse >= 3.5 * fine || coarse < 1e-12,
            "depth {depth}, light {light:?}: {coarse:e} at 1/8, {fine:e} at 1/16"
        );
    }
}

#[test]
fn a_box_lit_from_aside_has_the_brightness_of_its_closed_form() {
    let light = towards([0.6, 0.0, -0.8]);
    let size = [4, 3];
    let found = weights(block(DVec3::splat(2.0), 1.5, &light, 1.0 / 200.0, 3.0), size);
    // Albedo 0.8, at x = 0.5 and −0.5. Columns are half a unit from the middle.
    let [left, right] = [found[4 + 1], found[4 + 2]].map(|weight| 0.8 * weight);
    let sides = if left > right { [left, right] } else { [right, left] };
    for (found, expected) in sides.into_iter().zip([0.390_988, 0.355_139]) {
        assert!((found - expected).abs() <= SINGLE, "{found}, not {expected}");
    }
}

#[test]
fn an_unshaded_slab_under_a_three_point_light_has_the_weighted_mean_of_three_closed_forms() {
    let depth = 2.0_f64;
    // Towards the eye, along the normal, and weights (docs/theory/first-look.md).
    let lights = [([-0.5, 0.6, 1.0], 0.9), ([0.8, 0.1, 0.5], 0.1), ([0.4, 0.8, -0.3], 0.15)];
    let expected = lights.iter().map(|([x, y, z], weight): &([f64; 3], f64)| {
        let cosine = z.abs() / (x * x + y * y + z * z).sqrt();
        let form = if *z > 0.0 {
            cosine / (cosine + 1.0) * -(-depth * (1.0 + 1.0 / cosine)).exp_m1()
        } else {
            cosine / (cosine - 1.0) * ((-depth / cosine).exp() - (-depth).exp())
        };
        weight * form / 1.15
    });
    let expected: f64 = expected.sum();
    let light = "kind = \"three_point\"";
    let found = middle(block(DVec3::new(40.0, 40.0, 1.0), depth, light, 1.0 / 200.0, 1.0));
    assert!((found - expected).abs() <= SINGLE, "{found}, not {expected}");
}

/// Accumulators of `scene` in f64, pixel by pixel, of its only position.
fn of_one_light(scene: &Scene, placement: Placement) -> Vec<f64> {
    let mut scene = scene.clone();
    scene.lights.truncate(1);
    scene.lights[0].placement = placement;
    let rungs = Rungs::new(scene, SIZE);
    assert_eq!(rungs.planned.positions.len(), 1, "one light, one position");
    rungs.march(&rungs.exact()).accumulators
}

#[test]
fn a_three_point_light_with_shadows_equals_three_directional_lights() {
    for (shading, lighting) in
        [("none", Lighting::TwoSided), ("gradient", Lighting::TwoSided), ("gradient", Lighting::OneSided)]
    {
        let mut scene = occluded(shading);
        scene.lighting = lighting;
        scene.materials.iter_mut().for_each(|material| (material.ambient, material.specular) = (0.0, 0.5));
        scene.shadows.start = Some(1.0);
        let view = scene.camera.view(&scene.frame.geometry, 1.0).unwrap();
        let lights = relume::scene::three_point(&view);
        let sum = if shading == "none" { lights.iter().map(|light| light.1).sum() } else { 1.0 };
        let apart = lights.map(|(direction, weight)| (of_one_light(&scene, Placement::Directional(direction)), weight));
        let together = of_one_light(&scene, Placement::ThreePoint);
        let brightest = together.iter().copied().fold(0.0, f64::max);
        assert!(brightest > 0.05, "{shading}: {brightest}");
        for (i, found) in together.iter().enumerate() {
            let expected: f64 = apart.iter().map(|(light, weight)| weight * light[i] / sum).sum();
            assert!((found - expected).abs() <= 1e-6, "{shading}, {lighting:?}: {found}, not {expected}");
        }
    }
}

#[test]
fn nothing_within_the_start_of_shadows_shades() {
    // Light from the eye's side: D = τ·max(z − b, 0).
    let (depth, start) = (2.0_f64, 0.3_f64);
    let mut scene = block(DVec3::new(40.0, 40.0, 1.0), depth, &towards([0.0, 0.0, -1.0]), 1.0 / 200.0, 1.0);
    scene.shadows.start = Some(start);
    let before = -(-depth * start).exp_m1();
    let behind = (depth * start).exp() * ((-2.0 * depth * start).exp() - (-2.0 * depth).exp()) / 2.0;
    let found = middle(scene);
    assert!((found - before - behind).abs() <= SINGLE, "{found}, not {}", before + behind);
}

/// A medium in a box from −1 to 1: where it is seen, its optical depth per unit of length there, and where it casts shadows.
pub(super) struct Medium {
    seen: fn([f64; 3]) -> bool,
    seen_depth: f64,
    casts: fn([f64; 3]) -> bool,
    depth: f64,
    step: f64,
}

/// A ball of radius 1 around the middle, of this optical depth per unit of length.
pub(super) fn ball(depth: f64, step: f64) -> Medium {
    let holds = |place| from_middle(place) <= 1.0;
    Medium { seen: holds, seen_depth: depth, casts: holds, depth, step }
}

/// Square of the distance from the middle; the faces of the box are at 1/4 and 3/4 of its texture.
fn from_middle(place: [f64; 3]) -> f64 {
    place.map(|part| 4.0 * part - 2.0).iter().map(|part| part * part).sum()
}

impl Samples<f64> for Medium {
    fn sample(&self, place: [f64; 3], step: &mut Step<f64>) {
        let opacity = if (self.seen)(place) { -(-self.seen_depth * self.step).exp_m1() } else { 0.0 };
        step.source = vec![opacity, 0.0, 0.0, 0.0];
        step.opacity = vec![opacity];
    }

    fn normal(&self, _: [f64; 3]) -> [f64; 3] {
        [0.0; 3]
    }

    fn end(&self, _: [f64; 3]) -> End<f64> {
        unreachable!("no segments")
    }

    fn mean(&self, _: [&End<f64>; 2], _: [f64; 3], _: &mut Step<f64>) -> f64 {
        unreachable!("no segments")
    }

    // The unit of length is the spacing of the box's two voxels.
    fn extinction(&self, place: [f64; 3], _: usize) -> f64 {
        if (self.casts)(place) { 2.0 * self.depth } else { 0.0 }
    }
}

#[test]
fn a_ball_lit_from_all_sides_has_the_brightness_of_its_closed_form() {
    let step = 1.0 / 200.0;
    let shown = |light: &str, size: [usize; 2]| {
        let scene = block(DVec3::splat(2.0), 1.5, light, step, 3.0);
        let planned = plan(&scene, &Quiet).unwrap();
        let film = reference::march(&scene, &planned, &ball(1.5, step), size, &Quiet).unwrap();
        film.accumulators.iter().map(|weight| 0.8 * weight).collect::<Vec<f64>>()
    };
    for (light, expected) in [([0.0, 0.0, -1.0], 0.399_009), ([1.0, 0.0, 0.0], 0.275_937), ([0.0, 0.0, 1.0], 0.119_489)]
    {
        let found = shown(&towards(light), [3, 3])[4];
        assert!((found - expected).abs() <= SINGLE, "light {light:?}: {found}, not {expected}");
    }
    let found = shown("", [3, 3])[4];
    assert!((found - 0.399_009).abs() <= SINGLE, "headlight: {found}");
    let sides = shown(&towards([1.0, 0.0, 0.0]), [4, 3]);
    let mut sides = [sides[4 + 1], sides[4 + 2]];
    sides.sort_by(f64::total_cmp);
    for (found, expected) in sides.into_iter().zip([0.104_256, 0.467_241]) {
        assert!((found - expected).abs() <= SINGLE, "{found}, not {expected}");
    }
}

#[test]
fn a_headlight_is_exact_at_every_step() {
    for (depth, step) in [(0.5, 0.5), (0.5, 1.0 / 64.0), (2.0, 1.0), (2.0, 0.25)] {
        let found = middle(block(DVec3::new(40.0, 40.0, 1.0), depth, "", step, 1.0));
        let expected = -(-2.0 * depth).exp_m1() / 2.0;
        assert!((found - expected).abs() <= 2e-5, "depth {depth}, step {step}: {found}, not {expected}");
        let cropped = middle(Scene {
            crop: Some([DVec3::ZERO, DVec3::new(1.0, 1.0, 0.5)]),
            ..block(DVec3::new(40.0, 40.0, 1.0), depth, "", step.min(0.5), 1.0)
        });
        let expected = -(-depth).exp_m1() / 2.0;
        assert!((cropped - expected).abs() <= 2e-5, "depth {depth}, step {step}, cropped: {cropped}, not {expected}");
    }
}

/// Two soft balls without shading, one light, seen by parallel rays from the direction `eye`.
pub(super) fn balls_lit(eye: DVec3, light: DVec3) -> Scene {
    let direction = light.to_array();
    let text = format!(
        r#"
        shading = "none"
        [materials.only]
        reflectance = "orange"
        [transfer]
        opacity_length = 1
        opacity = [[2000, 0.0], [60000, 0.5]]
        material = [[0, "only"]]
        [lights.day]
        spectrum = "D65"
        shadows = true
        kind = "directional"
        direction = {direction:?}
        [shadows]
        method = "rays"
        [accuracy]
        step = 0.5
        termination = 0
    "#
    );
    let mut scene = of(&text, scenes::balls());
    let centre = DVec3::new(15.5, 13.5, 12.5);
    scene.camera.projection = Projection::Orthographic { height: Some(50.0) };
    scene.camera.aim = Aim::LookAt { position: centre + 100.0 * eye, target: centre };
    scene.camera.up = DVec3::new(0.1, 0.2, 1.0);
    scene
}

#[test]
fn light_and_eye_can_be_exchanged() {
    let [one, other] = [DVec3::new(-0.8, 0.6, 0.0), DVec3::new(0.3, 0.5, 0.8)].map(DVec3::normalize);
    let mean = |eye, light| {
        let found = weights(balls_lit(eye, light), [40, 40]);
        found.iter().sum::<f64>() / float(found.len())
    };
    let [there, back] = [mean(one, other), mean(other, one)];
    assert!((there / back - 1.0).abs() <= 0.004, "{there} and {back}");
    // Not because every light gives the same.
    let elsewhere = mean(one, one);
    assert!((there / elsewhere - 1.0).abs() > 0.05, "{there} and {elsewhere}");
}

/// A small ball above a large one, lit by two directional lights with shadows.
pub(super) fn occluded(shading: &str) -> Scene {
    scenes::named(if shading == "none" { "shadows_unshaded" } else { "shadows_gradient" })
}

/// Marches of `scene` by rays and by the grid: the accumulators of all positions.
fn both_methods(scene: &Scene) -> [Vec<f64>; 2] {
    [ShadowMethod::Rays, ShadowMethod::Grid].map(|method| {
        let mut scene = scene.clone();
        scene.shadows.method = method;
        let rungs = Rungs::new(scene, SIZE);
        rungs.march(&rungs.exact()).accumulators
    })
}

#[test]
fn a_cropped_occluder_casts_no_shadow() {
    let scene = occluded("none");
    let last = DVec3::new(24.0, 24.0, 39.0);
    // The small ball begins at z = 0.4: voxel 27.
    let cropped = |high: f64| {
        let crop = Some([DVec3::ZERO, DVec3::new(last.x, last.y, high)]);
        Scene { crop, ..scene.clone() }
    };
    let large = scenes::sampled([25, 25, 40], |p| {
        let centre = DVec3::new(0.0, 0.0, -0.4);
        let large = (-(p - centre).length_squared() / (2.0 * 0.4 * 0.4)).exp();
        60000.0 * large * f64::from(p.z < 0.3)
    });
    let removed = cropped(25.0).with_volume(large.into());
    for (with, without) in both_methods(&cropped(25.0)).into_iter().zip(both_methods(&removed)) {
        assert!(with == without, "the ball that is cropped away changes the picture");
    }
    // Not cropped, it does cast one.
    for (whole, cropped) in both_methods(&cropped(39.0)).into_iter().zip(both_methods(&cropped(25.0))) {
        assert!(whole != cropped, "the ball that is shown casts no shadow");
    }
}

#[test]
fn an_xray_material_casts_no_shadow_and_is_lit_through_that_of_others() {
    // Two intervals: an X-ray material at low values, around the other one.
    let shown = |opacity: f64, xray: bool| {
        let mut scene = occluded("none");
        scene.transfer.terms = vec![
            relume::scene::Term::interval(0, [20000.0, 65535.0], 1000.0, 0.3, 0.0),
            relume::scene::Term::interval(1, [5000.0, 19000.0], 1000.0, opacity, 0.0),
        ];
        scene.materials[1].occludes = if xray { 0.0 } else { 1.0 };
        scene
    };
    let pixels = SIZE[0] * SIZE[1];
    let of_material = |found: &[f64], m: usize| -> Vec<f64> {
        (0..2).flat_map(|position| found[(2 * position + m) * pixels..][..pixels].to_vec()).collect()
    };
    for (thin, dense) in both_methods(&shown(0.1, true)).into_iter().zip(both_methods(&shown(0.6, true))) {
        assert!(of_material(&thin, 0) == of_material(&dense, 0), "its opacity changes the light of the other");
        assert!(of_material(&thin, 1) != of_material(&dense, 1), "its own light follows its opacity");
    }
    for (thin, dense) in both_methods(&shown(0.1, false)).into_iter().zip(both_methods(&shown(0.6, false))) {
        assert!(of_material(&thin, 0) != of_material(&dense, 0), "an occluder does cast a shadow");
    }
    // Lit through shadows: without any, the X-ray material is brighter.
    let mut open = shown(0.1, true);
    open.lights.iter_mut().for_each(|light| light.shadows = false);
    let rungs = Rungs::new(open, SIZE);
    let open: f64 = rungs.march(&rungs.exact()).accumulators[pixels..2 * pixels].iter().sum();
    for found in both_methods(&shown(0.1, true)) {
        assert!(of_material(&found, 1)[..pixels].iter().sum::<f64>() < 0.9 * open);
    }
}

#[test]
fn the_light_grid_has_a_number_for_each_direction_and_the_sky() {
    let light = |name: &str, changes: &str| plan(&scenes::changed(name, changes), &Quiet).unwrap().plan.light;
    let three = light("shadows_three_point", "lights.open = { spectrum = 'A', kind = 'ambient' }");
    assert_eq!((three.grid_lights(), three.behind().collect::<Vec<_>>()), (3, vec![1, 2, 3]));
    let occluded = light("shadows_ambient", "materials.large.diffuse = 0");
    assert_eq!((occluded.sky(), occluded.grid_lights()), (Some(0), 1));
}

#[test]
fn shadows_that_cannot_be_computed_are_refused_with_their_light() {
    let lights = |count: usize, more: &str| {
        let directional = "spectrum = 'D65', shadows = true, kind = 'directional', direction";
        let all: String = (0..count).map(|i| format!("lights.l{i} = {{ {directional} = [{i}, 1, 5] }}\n")).collect();
        format!("lights = {{}}\n{all}{more}")
    };
    let [sky, studio] = ["ambient", "three_point"]
        .map(|kind| format!("lights.lamp = {{ spectrum = 'A', shadows = true, kind = '{kind}' }}"));
    let ambient = "shadows.ambient = 'occluded'\nlights.day.shadows = false\nlights.lamp.shadows = false";
    for (name, changes, start, words) in [
        ("stained_unshaded", &*sky, "lights.lamp", "the absorption of large is coloured, and the light of a sky"),
        ("stained_unshaded", "accuracy.model = 'peercy'", "lights.day", "the model peercy has no optical depth"),
        ("stained_unshaded", "accuracy.model = 'sharpened'", "lights.day", "the model sharpened has no optical depth"),
        ("stained_unshaded", &lights(9, ""), "", "9 directions through 1 coloured absorber, which needs 18 depths"),
        ("stained", ambient, "shadows.ambient = \"occluded\" is not possible", ""),
        ("shadows_unshaded", &lights(64, ""), "", "comes from 64 directions, and at most 16 are possible"),
        ("shadows_unshaded", &lights(14, &studio), "", "from 17 directions"),
        // Voxels have a side of 1.
        (
            "shadows_sky_beside_one",
            "shadows.start = 1.5\nshadows.reach = 3.25",
            "shadows.reach = 3.25 is not possible: shadows start 1.5 voxels",
            "a node every 2 voxels, so that it holds no shade nearer than 3.5; set at least this",
        ),
    ] {
        let error = plan(&scenes::changed(name, changes), &Quiet).unwrap_err();
        let start =
            if start.starts_with("lights") { format!("{start}.shadows = true is not possible") } else { start.into() };
        assert_eq!(error.code(), "shadows-impossible", "{error}");
        assert!(error.to_string().starts_with(&start) && error.to_string().contains(words), "{error}: {start} {words}");
    }
    // Light from a direction has no reach.
    assert!(plan(&scenes::changed("shadows_unshaded", "shadows.reach = 0.1"), &Quiet).is_ok());
}

/// [`occluded`] with voxels of these sides, of which the picture shows the same part.
fn with_sides(mut scene: Scene, sides: DVec3) -> Scene {
    let Volume { voxels, geometry, .. } = &**scene.volume();
    let geometry = Geometry::new("sides", geometry.dims, sides, geometry.origin, geometry.direction).unwrap();
    scene.set_volume(Volume::new("sides", voxels.clone(), geometry).unwrap().into());
    scene
}

#[test]
fn the_light_grid_approaches_rays_as_its_spacing_falls() {
    let cubes = DVec3::ONE;
    for (i, point) in POINTS.into_iter().enumerate() {
        let spaced = |spacing: f64| {
            let mut scene = occluded("none");
            scene.lights.truncate(1);
            scene.lights[0].placement = Placement::Point(point);
            scene.shadows.spacing = spacing;
            let [rays, grid] = both_methods(&scene);
            let error: f64 = rays.iter().zip(&grid).map(|(ray, grid)| (ray - grid).abs()).sum();
            error / rays.iter().sum::<f64>()
        };
        let errors = [4.0, 2.0, 1.0].map(spaced);
        assert!(errors[1] < 0.7 * errors[0] && errors[2] < 0.7 * errors[1], "point {i}: {errors:?}");
    }
    for (shading, start, sides) in [
        ("none", 0.0, cubes),
        ("gradient", 0.0, cubes),
        ("none", 2.5, cubes),
        ("none", 0.0, DVec3::new(0.7, 1.9, 1.1)),
        ("none", 2.5, DVec3::new(2.2, 0.8, 1.0)),
    ] {
        let scene = with_sides(occluded(shading), sides);
        let spaced = |spacing: f64| {
            let mut scene = scene.clone();
            scene.shadows.start = Some(start);
            scene.shadows.spacing = spacing;
            let [rays, grid] = both_methods(&scene);
            let error: f64 = rays.iter().zip(&grid).map(|(ray, grid)| (ray - grid).abs()).sum();
            error / rays.iter().sum::<f64>()
        };
        let errors = [4.0, 2.0, 1.0].map(spaced);
        assert!(errors[1] < 0.7 * errors[0] && errors[2] < 0.7 * errors[1], "{shading}, {sides}: {errors:?}");
        // The error goes with the distance of nodes along the longest side.
        assert!(errors[1] < 0.05 * sides.max_element(), "{shading}, {sides}: {errors:?}");
    }
}

/// A sky beside `more` directional lights, all with shadows.
fn under_sky(shading: &str, more: usize) -> Scene {
    let mut scene = scenes::named(["shadows_sky", "shadows_sky_beside_one"][more]);
    scene.shading = if shading == "none" { Shading::None } else { Shading::Gradient };
    scene
}

/// Points in front of [`occluded`], in it and behind it.
pub(super) const POINTS: [DVec3; 3] =
    [DVec3::new(50.0, -30.0, 60.0), DVec3::new(4.2, 12.1, 25.3), DVec3::new(-40.0, 30.0, 5.0)];

#[test]
fn the_sky_is_the_mean_of_its_directions() {
    for (shading, directions) in [("none", 16), ("gradient", 48)] {
        let mut sky = under_sky(shading, 0);
        // Shades of directional lights without shading, or with ambient parts only, are 1.
        sky.materials.iter_mut().for_each(|material| (material.ambient, material.diffuse) = (1.0, 0.0));
        sky.shadows.directions = directions;
        let found = |spacing: f64| {
            let mut scene = sky.clone();
            scene.shadows.spacing = spacing;
            weights(scene, SIZE)
        };
        let mut mean = vec![0.0; SIZE[0] * SIZE[1]];
        for first in (0..directions).step_by(16) {
            let mut scene = sky.clone();
            // Gradient shading does not touch unshaded light.
            scene.shading = Shading::None;
            scene.shadows.start = Some(sky.shadow_start());
            scene.shadows.method = ShadowMethod::Rays;
            let light = scene.lights[0].clone();
            let direction = |i| Placement::Directional(sky_direction(i, directions));
            let lights = (first..first + 16).map(|i| SceneLight {
                name: format!("{i}"),
                placement: direction(i),
                ..light.clone()
            });
            scene.lights = lights.collect();
            let rungs = Rungs::new(scene, SIZE);
            let film = rungs.march::<f64>(&rungs.exact());
            assert_eq!(film.accumulators.len(), 16 * film.components * mean.len());
            for position in film.accumulators.chunks_exact(film.components * mean.len()) {
                mean.iter_mut().zip(position).for_each(|(mean, weight)| *mean += weight / float(directions));
            }
        }
        let total: f64 = mean.iter().sum();
        let error = |found: &[f64]| found.iter().zip(&mean).map(|(a, b)| (a - b).abs()).sum::<f64>() / total;
        let [coarse, fine] = [1.0, 0.5].map(|spacing| error(&found(spacing)));
        assert!(fine < 0.4 * coarse && coarse < 0.03, "{shading}: {coarse} at 2 voxels, {fine} at 1");
    }
}

#[test]
fn a_ball_under_an_even_sky_has_the_brightness_of_its_closed_form() {
    let step = 1.0 / 100.0;
    // In the middle and half a radius from it, with a node of the sky every so many voxels.
    let shown = |spacing: f64| {
        let mut scene = block(DVec3::splat(2.0), 1.5, "kind = \"ambient\"", step, 3.0);
        (scene.shadows.spacing, scene.shadows.directions) = (spacing, 16);
        let planned = plan(&scene, &Quiet).unwrap();
        let of_size = |size: [usize; 2]| {
            let film = reference::march(&scene, &planned, &ball(1.5, step), size, &Quiet).unwrap();
            film.accumulators.iter().map(|weight| 0.8 * weight).collect::<Vec<f64>>()
        };
        [of_size([3, 3])[4], of_size([4, 3])[5]]
    };
    let [coarse, fine] = [0.04, 0.02].map(shown);
    for ((coarse, fine), expected) in coarse.into_iter().zip(fine).zip([0.264_483, 0.286_100]) {
        // The ball has a sharp edge: the error goes with the spacing.
        assert!((fine - expected).abs() <= 0.6 * (coarse - expected).abs(), "{coarse}, {fine}, not {expected}");
        let limit = 2.0 * fine - coarse;
        assert!((limit - expected).abs() <= SINGLE, "{coarse}, {fine}, not {expected}");
    }
}

#[test]
fn an_even_medium_takes_the_part_of_a_sky_that_its_reach_holds() {
    let step = 1.0 / 100.0;
    let (depth, reach) = (1.5, 0.53);
    let shown = |method: ShadowMethod, start: f64, reach: Option<f64>| {
        let mut scene = block(DVec3::splat(2.0), depth, "kind = \"ambient\"", step, 1.0);
        scene.shadows.method = method;
        (scene.shadows.spacing, scene.shadows.directions) = (0.05, 12);
        // In voxels of a side of 2.
        (scene.shadows.start, scene.shadows.reach) = (Some(start / 2.0), reach);
        let planned = plan(&scene, &Quiet).unwrap();
        // A small core is seen of a medium that fills the box.
        let core = Medium { seen: |place| from_middle(place) <= 0.01, seen_depth: 1.0, casts: |_| true, depth, step };
        reference::march(&scene, &planned, &core, [1, 1], &Quiet).unwrap().accumulators[0]
    };
    let open = shown(ShadowMethod::Rays, 0.0, Some(0.1 + 1e-12)) * (0.1 * depth).exp();
    assert!(open > 0.1, "{open}");
    // Whatever the direction, the box goes on for more than the reach: each takes e^(−τ·(reach − start)).
    for (method, start) in
        [(ShadowMethod::Rays, 0.0), (ShadowMethod::Grid, 0.0), (ShadowMethod::Rays, 0.2), (ShadowMethod::Grid, 0.2)]
    {
        let found = shown(method, start, Some(reach));
        let expected = open * (-depth * (reach - start)).exp();
        assert!((found - expected).abs() <= 1e-9, "{method:?}, start {start}: {found}, not {expected}");
    }
    let whole = shown(ShadowMethod::Grid, 0.0, None);
    assert!(whole < 0.7 * open * (-depth * reach).exp(), "without a reach: {whole}");
}

#[test]
fn the_light_grid_approaches_rays_that_end_at_the_reach() {
    for (start, reach, azimuth) in [(0.0, 6.3, 0.0), (0.0, 11.0, 70.0), (1.5, 9.5, 140.0)] {
        let shown = |method: ShadowMethod, spacing: f64, reach: Option<f64>| {
            let mut scene = under_sky("none", 0);
            if let Aim::Orbit { azimuth: turned, .. } = &mut scene.camera.aim {
                *turned = azimuth;
            }
            scene.shadows.method = method;
            (scene.shadows.spacing, scene.shadows.directions) = (spacing, 16);
            (scene.shadows.start, scene.shadows.reach) = (Some(start), reach);
            weights(scene, [1, 1])[0]
        };
        let rays = shown(ShadowMethod::Rays, 2.0, Some(reach));
        let error = |spacing: f64| (shown(ShadowMethod::Grid, spacing, Some(reach)) / rays - 1.0).abs();
        let [coarse, fine] = [2.0, 0.5].map(error);
        assert!(coarse <= 0.12 && fine <= 0.006, "{start} to {reach}: {coarse} at 4 voxels, {fine} at 1");
        let whole = shown(ShadowMethod::Rays, 2.0, None);
        assert!(whole < 0.98 * rays, "the reach is seen: {rays}, {whole} without it");
    }
}

/// Exact samples that count the extinctions which marches ask for.
struct Counting<'a>(Exact<'a>, AtomicUsize);

impl Samples<f64> for Counting<'_> {
    fn sample(&self, place: [f64; 3], step: &mut Step<f64>) {
        self.0.sample(place, step);
    }

    fn normal(&self, place: [f64; 3]) -> [f64; 3] {
        self.0.normal(place)
    }

    fn end(&self, place: [f64; 3]) -> End<f64> {
        self.0.end(place)
    }

    fn mean(&self, ends: [&End<f64>; 2], middle: [f64; 3], density: &mut Step<f64>) -> f64 {
        self.0.mean(ends, middle, density)
    }

    fn extinction(&self, place: [f64; 3], number: usize) -> f64 {
        self.1.fetch_add(1, Ordering::Relaxed);
        self.0.extinction(place, number)
    }

    fn keeping(&self) -> Option<Keeping<'_, f64>> {
        self.0.keeping()
    }
}

#[test]
fn marches_of_one_scene_share_the_light_grids_that_are_equal() {
    let scene = {
        let mut scene = under_sky("gradient", 1);
        scene.shadows.directions = 8;
        scene
    };
    let kept = KeptDepths::default();
    let marched = |change: fn(&mut Scene)| {
        let mut scene = scene.clone();
        change(&mut scene);
        let rungs = Rungs::new(scene, [12, 10]);
        let fresh = bits(&rungs.march::<f64>(&rungs.exact()));
        let counting = Counting(rungs.exact().keeping_depths(&kept), AtomicUsize::new(0));
        let film = rungs.march::<f64>(&counting);
        assert!(bits(&film) == fresh, "the same bytes");
        counting.1.into_inner() > 0
    };
    assert!(marched(|_| {}), "the first march fills");
    assert!(!marched(|scene| scene.accuracy.step_length = 0.5), "another step");
    assert!(!marched(|scene| scene.accuracy.termination = 0.1), "another termination");
    assert!(marched(|scene| scene.accuracy.interpolation = Interpolation::Nearest), "other values between voxels");
    assert!(marched(|scene| scene.shadows.spacing = 3.0), "another spacing");
    assert!(marched(|scene| scene.shadows.start = Some(1.0)), "another start");
    assert!(marched(|scene| scene.shadows.reach = Some(9.0)), "a reach");
    assert!(!marched(|_| {}), "the first ones are still kept");
}

#[test]
fn a_reach_beyond_the_volume_leaves_the_same_bytes() {
    let mut scene = under_sky("gradient", 1);
    scene.shadows.directions = 8;
    // The box of voxels.
    let diagonal = DVec3::new(25.0, 25.0, 40.0).length();
    with_renderer(|renderer| {
        let marched = |reach: Option<f64>| {
            let mut scene = scene.clone();
            scene.shadows.reach = reach;
            let rungs = Rungs::new(scene, SIZE);
            [bits(&rungs.gpu(renderer)), bits(&rungs.march::<f64>(&rungs.stored()))]
        };
        let open = marched(None);
        assert!(marched(Some(diagonal)) == open, "as long as the volume");
        assert!(marched(Some(1e30)) == open, "without an end");
        // Columns that leave the box at its side are as old as this, and hold nothing.
        assert!(marched(Some(0.99 * diagonal)) == open, "longer than all that is dense");
        let short = marched(Some(8.0));
        assert!(short[0] != open[0] && short[1] != open[1], "a short one is seen");
    });
}

#[test]
fn occluded_ambient_shares_are_those_of_ambient_light_with_shadows() {
    let mut both = occluded("gradient");
    both.lights.truncate(1);
    both.lights[0].shadows = false;
    both.materials.iter_mut().for_each(|material| (material.ambient, material.diffuse) = (0.3, 0.6));
    both.shadows.ambient = AmbientShares::Occluded;
    // By grids, the sky of shares is summed at twice the spacing of that of a light.
    both.shadows.method = ShadowMethod::Rays;
    let mut diffuse = both.clone();
    diffuse.materials.iter_mut().for_each(|material| material.ambient = 0.0);
    let mut sky = both.clone();
    sky.lights[0].placement = Placement::Ambient;
    sky.lights[0].shadows = true;
    sky.accuracy = both.accuracy.clone();
    let marched = |scene: Scene| {
        let rungs = Rungs::new(scene, SIZE);
        rungs.march::<f64>(&rungs.exact()).accumulators
    };
    let [both, diffuse, sky] = [both, diffuse, sky].map(marched);
    assert!(both.iter().any(|&weight| weight > 0.1));
    for ((both, diffuse), sky) in both.iter().zip(&diffuse).zip(&sky) {
        assert!((both - (diffuse + 0.3 * sky)).abs() <= 1e-12, "{both}, not {diffuse} + 0.3 · {sky}");
    }
}

#[test]
fn a_distant_point_light_is_a_directional_light() {
    for shading in ["none", "gradient"] {
        let lit = |placement: Placement, method: ShadowMethod| {
            let mut scene = occluded(shading);
            scene.lights.truncate(1);
            scene.lights[0].placement = placement;
            scene.shadows.method = method;
            let rungs = Rungs::new(scene, SIZE);
            rungs.march::<f64>(&rungs.exact()).accumulators
        };
        let direction = DVec3::new(0.6, -0.3, 0.7).normalize();
        for (method, most) in [(ShadowMethod::Rays, 1e-6), (ShadowMethod::Grid, 0.03)] {
            let far = lit(Placement::Point(1e8 * direction), method);
            let parallel = lit(Placement::Directional(direction), method);
            let total: f64 = parallel.iter().sum();
            let error = far.iter().zip(&parallel).map(|(a, b)| (a - b).abs()).sum::<f64>() / total;
            // Rays from nodes and columns differ by their interpolation.
            assert!(error <= most, "{shading}, {method:?}: {error}");
        }
    }
}

/// Largest ΔE00 between pictures in XYZ where white has Y = 1.
pub(super) fn largest_difference(found: &[DVec3], expected: &[DVec3]) -> f64 {
    differences(found, expected).pop().unwrap_or(0.0)
}

#[test]
fn a_light_grid_is_filled_again_only_where_its_depths_change() {
    with_renderer(|renderer| {
        let first = SceneRenderer::new(renderer, occluded("none"), &Quiet).unwrap();
        let fills = |scene: &Scene| {
            let scene = &scene.clone().with_volume(std::sync::Arc::clone(first.scene().volume()));
            let before = renderer.light_fills();
            let planned = plan(scene, &Quiet).unwrap();
            let film = first.with_scene(scene.clone(), planned, &Quiet).unwrap().march(SIZE, &Quiet).unwrap();
            (renderer.light_fills() - before, bits(&renderer.read(&film).unwrap()))
        };
        let changed = |change: fn(&mut Scene)| {
            let mut scene = occluded("none");
            change(&mut scene);
            scene
        };
        let (count, begun) = fills(&occluded("none"));
        assert_eq!(count, 2, "two lights");
        for (what, scene) in [
            (
                "another colour",
                changed(|scene| scene.materials[0].reflectance = scene.materials[1].reflectance.clone()),
            ),
            ("another light", changed(|scene| scene.lights[0].spectrum = scene.lights[1].spectrum.clone())),
            ("another view", changed(|scene| scene.accuracy.step_length = 0.7)),
            ("another camera", changed(|scene| scene.camera.up = DVec3::X)),
        ] {
            assert_eq!(fills(&scene).0, 0, "{what}");
        }
        let moved = changed(|scene| scene.lights[1].placement = Placement::Directional(DVec3::X));
        assert_eq!(fills(&moved).0, 1, "one light moves");
        let (count, back) = fills(&occluded("none"));
        assert_eq!(count, 1, "it moves back");
        assert!(back == begun, "the same grid again");
        assert_eq!(fills(&changed(|scene| scene.transfer.terms[0].opacity[1].1 = 0.5)).0, 2, "another opacity");
        assert_eq!(fills(&changed(|scene| scene.shadows.spacing = 3.0)).0, 2, "another spacing");
        let crop = changed(|scene| scene.crop = Some([DVec3::ZERO, DVec3::splat(20.0)]));
        assert_eq!(fills(&crop).0, 2, "another crop box");
        let xray = |opacity: f64| {
            let mut scene = occluded("none");
            scene.materials[1].occludes = 0.0;
            scene.transfer.terms.push(relume::scene::Term::interval(1, [2000.0, 9000.0], 100.0, opacity, 0.0));
            scene
        };
        assert_eq!(fills(&xray(0.2)).0, 2);
        assert_eq!(fills(&xray(0.4)).0, 0, "the opacity of an X-ray material");
    });
}

#[test]
fn the_light_of_the_sky_is_summed_again_only_where_it_changes() {
    with_renderer(|renderer| {
        let first = SceneRenderer::new(renderer, under_sky("gradient", 1), &Quiet).unwrap();
        let fills = |change: fn(&mut Scene)| {
            let mut scene = first.scene().clone();
            change(&mut scene);
            let before = renderer.light_fills();
            let planned = plan(&scene, &Quiet).unwrap();
            let film = first.with_scene(scene, planned, &Quiet).unwrap().march(SIZE, &Quiet).unwrap();
            (renderer.light_fills() - before, bits(&renderer.read(&film).unwrap()))
        };
        let (count, begun) = fills(|_| {});
        assert_eq!(count, 2, "one light and the sky");
        assert_eq!(fills(|scene| scene.camera.up = DVec3::X).0, 0, "another camera");
        assert_eq!(fills(|scene| scene.shadows.directions = 8).0, 1, "other directions");
        let (count, back) = fills(|_| {});
        assert_eq!(count, 1, "the directions of before");
        assert_eq!(fills(|scene| scene.shadows.reach = Some(1e6)).0, 0, "a reach beyond the volume");
        assert_eq!(fills(|scene| scene.shadows.reach = Some(9.0)).0, 1, "a reach");
        assert_eq!(fills(|scene| scene.shadows.reach = Some(9.0)).0, 0, "the same reach");
        assert_eq!(fills(|_| {}).0, 1, "no reach");
        assert!(back == begun, "the same light again");
        // Its depths move to the first number of the texel.
        assert_eq!(fills(|scene| scene.lights[1].shadows = false).0, 0, "the other light casts none");
        assert_eq!(
            fills(|scene| scene.lights[1].placement = Placement::Directional(DVec3::X)).0,
            1,
            "another direction"
        );
    });
}

#[test]
fn the_light_grid_of_a_three_point_light_is_filled_again_where_the_camera_turns() {
    with_renderer(|renderer| {
        let first = SceneRenderer::new(renderer, scenes::named("shadows_three_point_beside_one"), &Quiet).unwrap();
        let fills = |change: fn(&mut Scene)| {
            let mut scene = first.scene().clone();
            change(&mut scene);
            assert!(Stale::between(first.scene(), first.planned(), &scene) <= Stale::Accumulators);
            let before = renderer.light_fills();
            let planned = plan(&scene, &Quiet).unwrap();
            first.with_scene(scene, planned, &Quiet).unwrap().march(SIZE, &Quiet).unwrap();
            renderer.light_fills() - before
        };
        assert_eq!(fills(|_| {}), 4, "three directions and one");
        assert_eq!(fills(|scene| scene.camera.projection = Projection::Perspective { fov_degrees: 20.0 }), 0, "a zoom");
        let turned = |scene: &mut Scene| {
            if let Aim::Orbit { azimuth, .. } = &mut scene.camera.aim {
                *azimuth += 10.0;
            }
        };
        assert_eq!(fills(turned), 3, "the directional light stays");
        assert_eq!(fills(turned), 0, "the camera stays");
        // The line of sight of a shifted camera differs by rounding.
        let seen = |by: DVec3| {
            let mut scene = first.scene().clone();
            let centre = DVec3::new(0.1, 0.2, 0.3) + by;
            scene.camera.aim = Aim::LookAt { position: centre + DVec3::new(3.3, 7.7, 9.1), target: centre };
            scene
        };
        let marched = |scene: Scene| {
            let before = renderer.light_fills();
            let planned = plan(&scene, &Quiet).unwrap();
            first.with_scene(scene, planned, &Quiet).unwrap().march(SIZE, &Quiet).unwrap();
            renderer.light_fills() - before
        };
        assert_eq!(marched(seen(DVec3::ZERO)), 3);
        assert_eq!(marched(seen(DVec3::new(0.7, -0.3, 1.9))), 0, "shifted");
    });
}

/// Lights with shadows from these directions.
fn lit_from(directions: &[f64]) -> Scene {
    let mut scene = occluded("none");
    let light = scene.lights[0].clone();
    let placed = directions.iter().map(|&x| {
        let placement = Placement::Directional(DVec3::new(x, 1.0, -0.4).normalize());
        SceneLight { name: format!("from {x}"), placement, ..light.clone() }
    });
    scene.lights = placed.collect();
    scene
}

#[test]
fn a_light_whose_shadow_is_switched_leaves_the_depths_of_the_others() {
    with_renderer(|renderer| {
        let first = SceneRenderer::new(renderer, lit_from(&[0.0]), &Quiet).unwrap();
        let fills = |directions: &[f64]| {
            let scene = lit_from(directions).with_volume(std::sync::Arc::clone(first.scene().volume()));
            let before = renderer.light_fills();
            let planned = plan(&scene, &Quiet).unwrap();
            let film = first.with_scene(scene, planned, &Quiet).unwrap().march(SIZE, &Quiet).unwrap();
            (renderer.light_fills() - before, bits(&renderer.read(&film).unwrap()))
        };
        let fresh = |directions: &[f64]| bits(&Rungs::new(lit_from(directions), SIZE).filtered(renderer));
        for (directions, count, what) in [
            (&[0.1, 0.3, 0.5][..], 3, "three lights"),
            (&[0.1, 0.5], 0, "without the second"),
            (&[0.5], 0, "without the first"),
            (&[0.3, 0.5], 1, "another one before it"),
            (&[0.5, 0.3], 0, "in the other order"),
            (&[0.1, 0.2, 0.5, 0.7, 0.3], 3, "five, in two texels"),
            (&[0.3, 0.7], 0, "one of each texel"),
            (&[0.7, 0.2], 1, "a moved light"),
        ] {
            let (filled, film) = fills(directions);
            assert_eq!(filled, count, "{what}");
            assert!(film == fresh(directions), "{what}: the same picture as of a grid of its own");
        }
    });
}

#[test]
fn a_coarse_picture_leaves_the_fill_of_the_fine_light_grid_as_it_is() {
    with_renderer(|renderer| {
        let slow = renderer.clone().with_dispatching(Dispatching { samples: Some(500), ..Dispatching::default() });
        let renderer = SceneRenderer::new(&slow, occluded("none"), &Quiet).unwrap();
        let finish = |mut march: relume::render::March| {
            let mut steps = 0;
            while !march.is_done() {
                steps += usize::from(!march.fill_is_done());
                march.step(&slow, renderer.uploaded()).unwrap();
            }
            (steps, march.finish(&slow).unwrap())
        };
        let mut fine = renderer.begin_march(SIZE, slow.speed()).unwrap();
        let mut begun = 0;
        while slow.light_fills() < 2 {
            fine.step(&slow, renderer.uploaded()).unwrap();
            begun += 1;
        }
        drop(fine);
        for _ in 0..2 {
            let (_, coarse) = finish(renderer.begin_march_of_one_ray(SIZE, slow.speed(), LightQuality::Last).unwrap());
            assert_eq!(slow.light_fills(), 4, "both lights of a coarse grid, once");
            drop(coarse);
        }
        let (rest, film) = finish(renderer.begin_march(SIZE, slow.speed()).unwrap());
        assert_eq!(slow.light_fills(), 4, "the fine grid goes on");
        assert!(begun > 2 && rest > 2, "{begun} and {rest} steps");
        let whole = Rungs::new(occluded("none"), SIZE).filtered(&slow);
        assert!(bits(&slow.read(&film).unwrap()) == bits(&whole));
        // A complete one serves a coarse picture.
        let coarse = renderer.begin_march_of_one_ray(SIZE, slow.speed(), LightQuality::Last).unwrap();
        assert!(coarse.fill_is_done() && slow.light_fills() == 6, "two more of the other renderer's volume");
    });
}

#[test]
fn a_march_that_is_dropped_leaves_its_part_of_the_light_grid_to_the_next() {
    with_renderer(|renderer| {
        let slow = renderer.clone().with_dispatching(Dispatching { samples: Some(500), ..Dispatching::default() });
        let renderer = SceneRenderer::new(&slow, occluded("none"), &Quiet).unwrap();
        let mut steps = 0;
        for _ in 0..200 {
            let mut march = renderer.begin_march(SIZE, slow.speed()).unwrap();
            if march.fill_is_done() {
                break;
            }
            march.step(&slow, renderer.uploaded()).unwrap();
            steps += 1;
        }
        assert!((3..200).contains(&steps), "{steps} steps fill the grid");
        assert_eq!(slow.light_fills(), 2);
        let film = renderer.march(SIZE, &Quiet).unwrap();
        let whole = Rungs::new(occluded("none"), SIZE).filtered(&slow);
        assert!(bits(&slow.read(&film).unwrap()) == bits(&whole));
    });
}

#[test]
fn rays_to_the_light_are_refused_on_a_device() {
    with_renderer(|renderer| {
        let mut scene = occluded("none");
        scene.shadows.method = ShadowMethod::Rays;
        let error = SceneRenderer::new(renderer, scene, &Quiet).unwrap().march(SIZE, &Quiet).unwrap_err();
        assert_eq!(error.code(), "shadow-rays-unsupported");
    });
}

/// A scene with a light of each kind.
const LIGHTS: &str = r#"
    version = 1
    [volume]
    phantom = "slab"
    dims = [4, 4, 4]
    [materials.only]
    reflectance = "orange"
    [[transfer.intervals]]
    material = "only"
    range = [0, 255]
    opacity = 0.1
    [lights.day]
    spectrum = "D65"
    kind = "directional"
    direction = [0, 0, 1]
    [lights.head]
    spectrum = "D65"
    [lights.sky]
    spectrum = "D65"
    kind = "ambient"
    [lights.studio]
    spectrum = "D65"
    kind = "three_point"
"#;

fn opened(more: &str) -> Result<SceneFile, document::SceneError> {
    let text = format!("{LIGHTS}{more}");
    document::parse("test", &text, Path::new(""), &SceneOptions::default(), &Quiet)
}

#[test]
fn keys_of_shadows_are_read_and_checked() {
    let scene = opened("[shadows]\nspacing = 0.5\nstart = 2\nmethod = \"rays\"").unwrap().scene;
    assert_eq!((scene.shadows.spacing, scene.shadow_start(), scene.shadows.method), (0.5, 2.0, ShadowMethod::Rays));
    let sky = opened("[shadows]\nambient = \"occluded\"\ndirections = 16\nreach = 6.5").unwrap().scene;
    assert_eq!((sky.shadows.ambient, sky.shadows.directions), (AmbientShares::Occluded, 16));
    assert_eq!(sky.shadows.reach, Some(6.5));
    let told = plan(&sky, &Quiet).unwrap().explain(&sky).join(" ");
    assert!(told.contains("What is farther than 6.5 from a sample does not dim the sky"), "{told}");
    let mut usual = opened("").unwrap().scene;
    assert_eq!((usual.shadows.ambient, usual.shadows.directions), (AmbientShares::Open, 64));
    assert_eq!((usual.shadows.spacing, usual.shadow_start(), usual.shadows.reach), (2.0, 3.0, None));
    usual.shading = Shading::None;
    assert_eq!((usual.shadows.spacing, usual.shadow_start()), (2.0, 0.0));
    for (wrong, words) in [
        ("spacing = 0", "from 0.5 to 64"),
        ("start = -1", "from 0 to 1000"),
        ("method = \"grids\"", "grids"),
        ("directions = 7", "from 8 to 1024"),
        ("ambient = \"dim\"", "dim"),
        ("reach = 0", "shadows.reach = 0; it must be a finite number above 0"),
        ("reach = -2.5", "shadows.reach = -2.5; it must be a finite number above 0"),
        ("reach = inf", "shadows.reach = inf; it must be a finite number above 0"),
        ("reach = nan", "shadows.reach = NaN; it must be a finite number above 0"),
    ] {
        let error = opened(&format!("[shadows]\n{wrong}")).unwrap_err();
        let told = format!("{error:?} {error}");
        assert!(told.contains(words), "{wrong}: {told}");
    }
}

#[test]
fn a_light_keeps_its_switched_shadows_in_a_session_and_in_the_history() {
    let mut edited = Document::new(opened("").unwrap());
    for light in 0..4 {
        edited.edit(&Edit::Shadows(light, true));
    }
    let cast = |scene: &Scene| scene.lights.iter().map(|light| light.shadows).collect::<Vec<_>>();
    assert_eq!(cast(&edited.state().scene), [true; 4]);
    let path = Path::new("session.toml");
    let text = document::session::text(path, &Source::default(), edited.opened(), edited.state()).unwrap();
    let again = document::parse("again", &text, Path::new(""), &SceneOptions::default(), &Quiet).unwrap();
    assert_eq!(cast(&again.scene), [true; 4]);
    edited.undo();
    edited.undo();
    edited.undo();
    edited.undo();
    assert_eq!(cast(&edited.state().scene), [false; 4]);
}

#[test]
fn a_switched_shadow_marches_and_a_light_spectrum_relights() {
    let scene = occluded("gradient");
    let planned = plan(&scene, &Quiet).unwrap();
    let stale = |change: fn(&mut Scene)| {
        let mut after = scene.clone();
        change(&mut after);
        Stale::between(&scene, &planned, &after)
    };
    assert_eq!(stale(|scene| scene.lights[0].shadows = false), Stale::Tables);
    assert_eq!(stale(|scene| scene.shadows.spacing = 4.0), Stale::Accumulators);
    assert_eq!(stale(|scene| scene.shadows.start = None), Stale::Accumulators);
    assert_eq!(stale(|scene| scene.shadows.reach = Some(9.0)), Stale::Nothing, "without a sky");
    let sky = under_sky("gradient", 1);
    let mut after = sky.clone();
    after.shadows.reach = Some(9.0);
    assert_eq!(Stale::between(&sky, &plan(&sky, &Quiet).unwrap(), &after), Stale::Accumulators);
    assert_eq!(stale(|scene| scene.lights[0].spectrum = scene.lights[1].spectrum.clone()), Stale::Picture);
    assert_eq!(stale(|scene| scene.lights[0].intensity = 3.0), Stale::Picture);
    let mut eye = scene.clone();
    eye.lights.truncate(1);
    eye.lights[0].placement = Placement::Headlight;
    let mut after = eye.clone();
    after.shadows.spacing = 4.0;
    after.shadows.start = Some(7.0);
    let of_eye = plan(&eye, &Quiet).unwrap();
    assert!(of_eye.plan.light.is_dimmed());
    assert_eq!(Stale::between(&eye, &of_eye, &after), Stale::Nothing, "a headlight has no light grid");
    let mut open = scene.clone();
    open.lights.iter_mut().for_each(|light| light.shadows = false);
    let mut after = open.clone();
    after.shadows.spacing = 4.0;
    assert_eq!(Stale::between(&open, &plan(&open, &Quiet).unwrap(), &after), Stale::Nothing, "without shadows");
}

/// The numbers of `cargo bench --bench instruments -- shadows`, on request only: minutes, and times of a busy machine.
#[test]
#[ignore = "takes minutes; times need an idle machine"]
fn shadows_keep_their_errors_and_costs() {
    with_renderer(|renderer| {
        let frog = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/volumes/frog/frog.mhd");
        let rows = instrument::shadow_rows(renderer, Some(frog.as_path()).filter(|frog| frog.exists())).unwrap();
        std::fs::write(concat!(env!("CARGO_TARGET_TMPDIR"), "/shadow_rows"), instrument::text(&rows)).unwrap();
        assert!(rows.iter().all(instrument::ShadowRow::holds), "{rows:?}");
    });
}
