//! Properties of every scene: linearity in light, independence of order and slicing, and equality of equal media.

use crate::matrix::bits;
use crate::support;

use std::sync::Arc;

use glam::DVec3;
use relume::film::{Film, RelightMatrices};
use relume::render::Renderer;
use relume::scene::{Mix, Placement, Scene};
use support::rungs::{Rungs, magnitudes, with_renderer};
use support::scenes::{self, SIZE};
use support::tolerance::{LINEARITY, STEP_INVARIANCE};

/// The device's linear picture of `rungs` under `mix`.
fn lit(renderer: &Renderer, marched: &relume::render::DeviceFilm, rungs: &Rungs, mix: &Mix) -> Vec<DVec3> {
    let relight = renderer.relight_linear(marched).unwrap();
    relight.run(&rungs.matrices_under(mix)).unwrap();
    relight.read::<[f32; 4]>().unwrap().iter().map(|&[r, g, b, _]| [r, g, b].map(f64::from).into()).collect()
}

/// Mix of light `i` alone, scaled by `factor`.
fn single(mix: &Mix, i: usize, factor: f64) -> Mix {
    let mut light = mix.0[i].clone();
    light.weight *= factor;
    Mix(vec![light])
}

/// Empty pixels are relit once.
#[test]
fn a_picture_that_is_lit_again_is_the_one_that_is_lit_once() {
    with_renderer(|renderer| {
        for (name, scene) in scenes::both_ways(&["diffuse_three", "background", "coloured_three"]) {
            let rungs = Rungs::new(scene, SIZE);
            let marched = rungs.gpu_accumulators(renderer);
            let (dark, lit) = (rungs.matrices_under(&Mix(Vec::new())), rungs.matrices());
            let picture = |matrices: &[&RelightMatrices]| {
                let relight = renderer.relight_display(&marched).unwrap();
                for matrices in matrices {
                    relight.run(matrices).unwrap();
                }
                relight.read::<[u8; 4]>().unwrap()
            };
            let (once, off) = (picture(&[&lit]), picture(&[&dark]));
            assert!(picture(&[&dark, &lit]) == once, "{name}: lit after dark");
            assert!(picture(&[&dark, &lit, &lit]) == once, "{name}: lit twice");
            assert!(picture(&[&lit, &dark]) == off, "{name}: dark after light");
            if name.starts_with("diffuse_three") {
                let black = once.iter().filter(|&&pixel| pixel == [0, 0, 0, 255]).count();
                assert!((1..once.len()).contains(&black), "{name}: {black} of {} pixels show nothing", once.len());
            }
        }
    });
}

/// docs/theory/acceptance.md C12.
#[test]
fn a_mix_is_the_sum_of_its_lights() {
    with_renderer(|renderer| {
        for (name, scene) in scenes::both_ways(&["diffuse_three", "specular_three", "background", "coloured_three"]) {
            let rungs = Rungs::new(scene, SIZE);
            let marched = rungs.gpu_accumulators(renderer);
            let together = lit(renderer, &marched, &rungs, &rungs.mix);
            let alone = (0..rungs.mix.0.len()).map(|i| lit(renderer, &marched, &rungs, &single(&rungs.mix, i, 1.0)));
            let sum = alone.reduce(|sum, one| sum.iter().zip(one).map(|(a, b)| *a + b).collect()).unwrap();
            let scale = magnitudes(&renderer.read(&marched).unwrap(), &rungs.matrices());
            for ((together, sum), scale) in together.iter().zip(&sum).zip(&scale) {
                let error = (*together - *sum).abs();
                assert!(error.cmple(LINEARITY * *scale).all(), "{name}: {together} for {sum}");
            }
        }
    });
}

/// docs/theory/acceptance.md C12.
#[test]
fn light_scales_over_twelve_magnitudes() {
    with_renderer(|renderer| {
        for (name, scene) in scenes::both_ways(&["specular_three", "coloured_three"]) {
            let rungs = Rungs::new(scene, SIZE);
            let marched = rungs.gpu_accumulators(renderer);
            let once = lit(renderer, &marched, &rungs, &rungs.mix);
            let scale = magnitudes(&renderer.read(&marched).unwrap(), &rungs.matrices());
            for intensity in [1e-6, 1e-3, 1e3, 1e6] {
                let mut mix = rungs.mix.clone();
                mix.0.iter_mut().for_each(|light| light.weight *= intensity);
                for ((scaled, once), scale) in lit(renderer, &marched, &rungs, &mix).iter().zip(&once).zip(&scale) {
                    let error = (*scaled / intensity - *once).abs();
                    assert!(error.cmple(LINEARITY * *scale).all(), "{name}, {intensity}: {scaled} for {once}");
                }
            }
        }
    });
}

/// Film of `rungs` from the f32 reference and, if available, the device.
fn marched(rungs: &Rungs) -> Vec<(&'static str, Film<f32>)> {
    let mut all = vec![("reference f32", rungs.march::<f32>(&rungs.stored::<f32>()))];
    with_renderer(|renderer| all.push(("GPU", rungs.gpu(renderer))));
    all
}

#[test]
fn the_order_of_lights_is_the_order_of_their_accumulators_and_nothing_else() {
    let scene = scenes::named("diffuse_three");
    let mut turned = scene.clone();
    turned.lights.reverse();
    let more = |scene: &mut Scene| {
        // Two directional lights keep the order of the scene.
        let mut light = scene.lights.iter().find(|light| light.name == "key").unwrap().clone();
        light.name = "second".into();
        light.placement = Placement::Directional(DVec3::new(0.3, 0.5, -0.8).normalize());
        light
    };
    let (mut scene, mut turned) = (scene, turned);
    let light = more(&mut scene);
    scene.lights.push(light.clone());
    turned.lights.insert(0, light);
    let (one, other) = (Rungs::new(scene, SIZE), Rungs::new(turned, SIZE));
    let names = |rungs: &Rungs| rungs.planned.positions.iter().map(|place| place.name.clone()).collect::<Vec<_>>();
    assert_ne!(names(&one), names(&other), "something changed places");
    assert_eq!(one.planned.plan, other.planned.plan);
    let length = one.planned.plan.components() * SIZE[0] * SIZE[1];
    for ((rung, one_marched), (_, other_marched)) in marched(&one).iter().zip(&marched(&other)) {
        assert_eq!(one_marched.transmittance, other_marched.transmittance, "{rung}");
        for (position, name) in names(&one).iter().enumerate() {
            let there = names(&other).iter().position(|other| other == name).unwrap();
            let part = |sums: &[f32], position: usize| sums[position * length..][..length].to_vec();
            let same = part(&one_marched.accumulators, position) == part(&other_marched.accumulators, there);
            assert!(same, "{rung}: {name}");
        }
    }
}

#[test]
fn the_order_of_materials_is_the_order_of_their_weights_and_nothing_else() {
    let scene = scenes::named("diffuse_one");
    let mut turned = scene.clone();
    turned.materials.reverse();
    let last = scene.materials.len() - 1;
    for term in &mut turned.transfer.terms {
        term.material.0.iter_mut().for_each(|point| point.1 = last - point.1);
    }
    let (one, other) = (Rungs::new(scene, SIZE), Rungs::new(turned, SIZE));
    let pixels = SIZE[0] * SIZE[1];
    for ((rung, one), (_, other)) in marched(&one).iter().zip(&marched(&other)) {
        assert_eq!(one.transmittance, other.transmittance, "{rung}");
        for material in 0..=last {
            let plane = |sums: &Film<f32>, material: usize| sums.accumulators[material * pixels..][..pixels].to_vec();
            assert!(plane(one, material) == plane(other, last - material), "{rung}: material {material}");
        }
    }
}

fn slab(step: f64, material: &str) -> Rungs {
    Rungs::new(scenes::slab_straight_on(step, 0.08, material), [8, 8])
}

/// docs/theory/acceptance.md C13 in grey; `spectral.rs` tests it in colour.
#[test]
fn halving_the_step_leaves_a_slab_as_it_is() {
    for material in ["", "xray = true"] {
        let (whole, half) = (slab(1.0, material), slab(0.5, material));
        for ((rung, whole), (_, half)) in marched(&whole).iter().zip(&marched(&half)) {
            let pairs = whole.accumulators.iter().zip(&half.accumulators);
            for (&one, &other) in pairs.chain(whole.transmittance.iter().zip(&half.transmittance)) {
                let error = f64::from(one - other).abs() / f64::from(one);
                assert!(error <= STEP_INVARIANCE, "{rung}: {material:?}: {one} and {other}");
            }
        }
    }
}

#[test]
fn an_xray_slab_adds_up_and_hides_nothing() {
    let rungs = slab(1.0, "xray = true");
    // 24 steps of −ln(1 − 0.08) each.
    let expected = -24.0 * (-0.08_f64).ln_1p();
    for (rung, sums) in marched(&rungs) {
        assert!(sums.transmittance.iter().all(|&transmitted| (transmitted - 1.0).abs() <= 0.0), "{rung}");
        for &weight in &sums.accumulators {
            let error = (f64::from(weight) - expected).abs() / expected;
            assert!(error <= STEP_INVARIANCE, "{rung}: {weight} for {expected}");
        }
    }
}

#[test]
fn empty_space_skipping_changes_no_byte_around_a_small_object() {
    with_renderer(|renderer| {
        // A small object in a large void, so that much is skipped, off the macrocells' borders.
        let mut scene = scenes::named("rotated");
        scene.set_volume(Arc::new(scenes::sampled([61, 53, 47], |p| {
            60000.0 * (-(p - DVec3::new(0.4, -0.3, 0.2)).length_squared() / 0.01).exp()
        })));
        let skipping = Rungs::new(scene.clone(), SIZE);
        let accumulators = skipping.gpu_accumulators(renderer);
        let [occupied, cells] = accumulators.occupied;
        assert!(occupied * 10 <= cells && occupied > 0, "{occupied} of {cells} cells hold something");
        scene.accuracy.skipping = false;
        let walking = Rungs::new(scene, SIZE);
        assert!(bits(&renderer.read(&accumulators).unwrap()) == bits(&walking.gpu(renderer)));
    });
}

/// A crop box cuts steps into parts (docs/theory/march.md), so films of the two sides of a plane composite to the film of the
/// whole where the medium is uniform, however thin a side is.
#[test]
fn a_march_cut_anywhere_is_the_front_part_over_the_back_part() {
    // A ramp of whole numbers within one interval: a uniform medium with a normal.
    let volume = scenes::sampled([17, 15, 13], |at| 300.0 + 40.0 * at.x + 14.0 * at.y);
    let uniform = |material: &str| {
        let text = format!(
            "shading = \"gradient\"\n[materials.only]\nreflectance = \"orange\"\nspecular = 0.2\n{material}\n[transfer]\n\
             opacity_length = 1\n[[transfer.intervals]]\nmaterial = \"only\"\nrange = [0, 1000]\nopacity = 0.11\nabsorption = {}\n\
             [lights.key]\nspectrum = \"D65\"\nkind = \"directional\"\ndirection = [-0.5, -0.8, -0.4]\n[camera]\nazimuth = 35\n\
             elevation = 28\n[accuracy]\nstep = 0.7\ntermination = 0\n",
            if material.is_empty() { 0.0 } else { 0.05 }
        );
        scenes::of(&text, volume.clone())
    };
    let glass = "absorption = { gaussian = [{ centre = 540, sigma = 40, height = 1 }], base = 0.1 }";
    let scenes = [
        ("grey", uniform("")),
        ("coloured", uniform(glass)),
        ("segments", scenes::in_segments(uniform(""))),
        ("coloured segments", scenes::in_segments(uniform(glass))),
    ];
    for (name, scene) in scenes {
        let whole = Rungs::new(scene.clone(), SIZE);
        let geometry = &scene.frame.geometry;
        let forward = geometry.direction.inverse() * scene.camera.view(geometry, 1.0).unwrap().forward;
        let axis = forward.abs().max_position();
        let last = DVec3::from_array(geometry.dims.map(|n| f64::from(u32::try_from(n).unwrap()))) - 1.0;
        let films = |cut: f64| {
            let (mut low, mut high) = ([DVec3::ZERO, last], [DVec3::ZERO, last]);
            (low[1][axis], high[0][axis]) = (cut * last[axis], cut * last[axis]);
            let parts = if forward[axis] > 0.0 { [low, high] } else { [high, low] };
            parts.map(|crop| Rungs::planned(Scene { crop: Some(crop), ..scene.clone() }, whole.planned.clone(), SIZE))
        };
        let exact = |rungs: &Rungs| rungs.march::<f64>(&rungs.exact());
        for cut in [0.013, 0.21, 0.5, 0.83, 0.97] {
            let parts = films(cut);
            let what = format!("{name}, cut at {cut}");
            same_film(&what, &exact(&parts[0]).over(&exact(&parts[1])).unwrap(), &exact(&whole), 1e-12);
        }
        with_renderer(|renderer| {
            let [front, back] = films(0.21).each_ref().map(|part| part.gpu(renderer));
            let what = format!("{name}, on the device");
            same_film(&what, &front.over(&back).unwrap(), &whole.gpu(renderer), 2e-6);
        });
    }
    let film = Film { size: [1, 1], components: 1, accumulators: vec![0.5_f64], transmittance: vec![0.5] };
    assert_eq!(film.clone().over(&Film { size: [2, 1], ..film }), None, "films of different sizes");
}

/// Numbers of both films differ by `limit` of the largest at most.
fn same_film<R: relume::number::Real>(what: &str, found: &Film<R>, expected: &Film<R>, limit: f64) {
    let numbers = |film: &Film<R>| -> [Vec<f64>; 2] {
        [&film.accumulators, &film.transmittance].map(|numbers| numbers.iter().map(|number| number.to_f64()).collect())
    };
    for (found, expected) in numbers(found).iter().zip(&numbers(expected)) {
        assert_eq!(found.len(), expected.len(), "{what}");
        let largest = expected.iter().fold(0.0_f64, |most, number| most.max(number.abs()));
        assert!(largest > 0.0, "{what}: nothing shows");
        let worst = found.iter().zip(expected).map(|(one, other)| (one - other).abs()).fold(0.0, f64::max);
        assert!(worst <= limit * largest, "{what}: {worst} of {largest}");
    }
}
