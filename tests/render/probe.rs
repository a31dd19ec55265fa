//! The probe against closed forms, the picture, and the film on a device.

use crate::support;

use glam::{DMat3, DVec3};
use relume::film::{Film, Relightable, display_from_xyz};
use relume::plan::{Planned, ScenePlan};
use relume::progress::Quiet;
use relume::reference::march_ray;
use relume::scene::{Mix, Scene, StoreAs};
use relume::spectrum::Spectrum;
use relume::spectrum::colour::xyz_of;
use relume::tables::Reflected;
use relume::view::probe::{Pixel, Probe, Ray};

use support::rungs::{Rungs, with_renderer};
use support::scenes::{self, SIZE};

/// Slab with one value, 64 units deep, seen along its normal by parallel rays: two media in front of a background.
fn slab(absorption: f64, accuracy: &str) -> Scene {
    let text = format!(
        r#"
        version = 1
        shading = "none"
        background = "yellow green"
        [volume]
        phantom = "slab"
        dims = [3, 3, 65]
        [materials.a]
        reflectance = "orange"
        absorption = {{ gaussian = [{{ centre = 560, sigma = 50, height = 1.0 }}] }}
        [materials.b]
        reflectance = "cyan"
        [transfer]
        opacity_length = 1
        intervals = [
            {{ material = "a", range = [-1e9, 1e9], opacity = 0.02, absorption = {absorption} }},
            {{ material = "b", range = [-1e9, 1e9], opacity = 0.01 }},
        ]
        [lights.day]
        spectrum = "D65"
        [lights.lamp]
        spectrum = "A"
        intensity = 0.5
        [display]
        exposure = 1.5
        adapt = true
        [camera]
        projection = "orthographic"
        height = 1
        azimuth = 0
        elevation = 0
        [accuracy]
        termination = 0
        {accuracy}
        "#
    );
    scenes::parsed(&text)
}

/// The only pixel of a picture of `rungs`, rounded only by its storage.
fn pixel(rungs: &Rungs) -> Pixel {
    let marched: Film<f64> =
        march_ray(&rungs.scene, &rungs.planned, &rungs.exact(), [[1, 1], [0, 0]], &Quiet, |_| {}).unwrap();
    #[expect(clippy::cast_possible_truncation, reason = "film files hold f32")]
    let numbers = marched.map(|number| number as f32);
    Pixel {
        place: [0, 0],
        size: [1, 1],
        numbers,
        planned: rungs.planned.clone(),
        means: Relightable::new(&rungs.scene, &rungs.planned),
    }
}

fn probe(rungs: &Rungs) -> Probe {
    let scene = &rungs.scene;
    let pixel = pixel(rungs);
    let reflected = Reflected::new(&pixel.means.components, scene.background.as_ref());
    let ray = Ray::march(scene, &scene.volume().statistics().unwrap(), [[1, 1], [0, 0]], &Quiet).unwrap();
    Probe::new(&pixel, scene, &Mix::of_scene(scene), Some(&reflected), Some(&ray))
}

/// σ of the two media of [`slab`].
fn scattering() -> [f64; 2] {
    [0.02, 0.01].map(|opacity: f64| -(-opacity).ln_1p())
}

fn near(what: &str, found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{what}: {found} for {expected}");
}

#[test]
fn two_media_in_one_place_share_a_pixel_by_how_much_they_scatter() {
    let probe = probe(&Rungs::new(slab(0.0, ""), [1, 1]));
    let [a, b] = scattering();
    let hidden = -(-64.0 * (a + b)).exp_m1();
    let expected = [("a", hidden * a / (a + b)), ("b", hidden * b / (a + b)), ("background", 1.0 - hidden)];
    for ((share, seen), (name, weight)) in probe.shares.iter().zip([Some(0), Some(1), None]).zip(expected) {
        assert_eq!(share.name, name);
        near(name, share.weight, weight, 1e-6);
        if let Some(seen) = seen {
            near("as the ray has it", probe.seen[seen], weight, 1e-12);
        }
    }
    near("transmittance", probe.transmittance, 1.0 - hidden, 1e-6);
    near("all parts of the light", probe.shares.iter().map(|share| share.light).sum(), 1.0, 1e-12);
    // The only light position contributes the materials' light; the rest is from the background.
    assert_eq!(probe.positions.len(), 1);
    near("the only place", probe.positions[0].light, 1.0 - probe.shares[2].light, 1e-12);
}

#[test]
fn a_material_may_be_called_what_is_behind_it() {
    let mut scene = slab(0.0, "");
    scene.materials[0].name = "background".to_owned();
    let [a, b] = scattering();
    let hidden = -(-64.0 * (a + b)).exp_m1();
    let expected = [hidden * a / (a + b), hidden * b / (a + b), 1.0 - hidden];
    for (share, expected) in probe(&Rungs::new(scene, [1, 1])).shares.iter().zip(expected) {
        near(&share.name, share.seen.unwrap(), expected, 1e-6);
    }
}

#[test]
fn the_spectrum_of_a_pixel_is_what_its_media_reflect_and_its_colour_is_the_one_shown() {
    let scene = slab(0.0, "");
    let probe = probe(&Rungs::new(scene.clone(), [1, 1]));
    let [a, b] = scattering();
    let hidden = -(-64.0 * (a + b)).exp_m1();
    let of = |material: usize| scene.materials[material].reflectance.spectrum();
    let reflected = &of(0).scaled(hidden * a / (a + b)) + &of(1).scaled(hidden * b / (a + b));
    let mix = Mix::of_scene(&scene);
    let (_, light) = mix.light_at(1);
    let behind = scene.background.as_ref().unwrap().spectrum().scaled(1.0 - hidden);
    let expected = &(&reflected + &behind) * &light;
    let spectrum = probe.spectrum.as_ref().unwrap();
    for (found, expected) in spectrum.samples().iter().zip(expected.samples()) {
        near("power", *found, *expected, 1e-6 * light.sum());
    }
    // Under an equal-energy light, reflectance is the pixel's radiance.
    let even = &reflected + &behind;
    for (found, expected) in probe.reflectance.as_ref().unwrap().samples().iter().zip(even.samples()) {
        near("reflectance", *found, *expected, 1e-6);
    }
    assert_eq!(probe.spectral_error, None, "exact");
    let integrated = shown(&scene, &mix, spectrum);
    assert!((integrated - probe.now.shown.0).abs().max_element() <= 1e-12, "{integrated} for {:?}", probe.now.shown);
    // Each light alone, as after `solo`.
    assert_eq!(probe.lights.iter().map(|lit| lit.name.as_str()).collect::<Vec<_>>(), ["day", "lamp"]);
    for (lit, light) in probe.lights.iter().zip(&scene.lights) {
        let alone = Mix(mix.0.iter().filter(|one| one.name == light.name).cloned().collect());
        let sent = &(&reflected + &behind) * &light.spectrum.spectrum().scaled(light.intensity);
        let expected = shown(&scene, &alone, &sent);
        assert!((expected - lit.shown.0).abs().max_element() <= 1e-5, "{}: {expected} for {:?}", light.name, lit.shown);
    }
}

fn shown(scene: &Scene, mix: &Mix, spectrum: &Spectrum) -> DVec3 {
    let display: DMat3 = display_from_xyz(mix, &scene.display);
    display * DVec3::from_array(xyz_of(spectrum).0)
}

#[test]
fn what_is_exact_errs_by_its_rounding_alone_and_a_colour_model_by_what_it_says() {
    let exact = probe(&Rungs::new(slab(0.0, ""), [1, 1]));
    for lit in exact.lights.iter().chain([&exact.now]) {
        let error = lit.error.unwrap();
        assert!(error.all <= 1e-3 && error.model <= 1e-3, "{}: {error:?}", lit.name);
    }
    let rungs = Rungs::new(slab(0.04, "k = 4"), [1, 1]);
    let coloured = probe(&rungs);
    assert!(coloured.shares.iter().all(|share| share.name == "background"), "{:?}", coloured.shares);
    let model = rungs.planned.model.clone().unwrap();
    // A model states its error for surfaces as bright as white under a light of luminance 1.
    for lit in &coloured.lights {
        let (error, most) = (lit.error.unwrap(), 2.0 * model.worst().max.max(0.01));
        assert!(error.model <= most && error.all <= most, "{}: {error:?} for {most}", lit.name);
    }
    let rms = coloured.spectral_error.unwrap();
    let full = probe(&rungs.full_spectrum());
    assert_eq!(full.spectral_error, None);
    let [found, truth] = [&coloured, &full].map(|probe| probe.reflectance.clone().unwrap());
    let pairs = found.samples().iter().zip(truth.samples());
    let squares: f64 = pairs.map(|(found, truth)| (found - truth).powi(2)).sum();
    assert!((squares / 81.0).sqrt() <= 4.0 * rms, "{rms}: one spectrum is within a few times of the mean of many");
    let all = full.now.error.unwrap();
    assert!(all.model <= 1e-3, "all bands are the truth: {all:?}");
}

#[test]
fn light_that_passes_falls_along_the_ray_as_its_closed_form() {
    for absorption in [0.0, 0.04] {
        let scene = slab(absorption, "step = 0.0625");
        let statistics = scene.volume().statistics().unwrap();
        let ray = Ray::march(&scene, &statistics, [[1, 1], [0, 0]], &Quiet).unwrap();
        assert!((100..=240).contains(&ray.stretches.len()), "{}", ray.stretches.len());
        let grey: f64 = scattering().iter().sum();
        let shape = scene.materials[0].absorption.as_ref().unwrap().spectrum();
        let luminance = &relume::spectrum::colour::OBSERVER[1];
        let transmittance_at = |distance: f64| {
            let at = |band: usize| (-(absorption * shape.samples()[band] + grey) * distance).exp();
            let parts = (0..81).map(|band| luminance.samples()[band] / luminance.sum() * at(band));
            parts.sum::<f64>()
        };
        let taken = |band: usize| {
            let (absorbed, extinct) = (absorption * shape.samples()[band], absorption * shape.samples()[band] + grey);
            luminance.samples()[band] / luminance.sum() * absorbed / extinct * -(-extinct * 64.0).exp_m1()
        };
        near("what is absorbed", ray.absorbed[0], (0..81).map(taken).sum(), 1e-9);
        near("what absorbs nothing", ray.absorbed[1], 0.0, 0.0);
        let all = ray.seen.iter().sum::<f64>() + ray.absorbed.iter().sum::<f64>() + transmittance_at(64.0);
        near("seen, absorbed and transmitted light", all, 1.0, 1e-9);
        let long = 64.0 / f64::from(u32::try_from(ray.stretches.len()).unwrap());
        for (number, stretch) in ray.stretches.iter().enumerate() {
            let begins = long * f64::from(u32::try_from(number).unwrap());
            near("distance", stretch.distance, begins + long / 2.0, 1e-9);
            let world = |place| scene.frame.geometry.world_from_index(place);
            let along = (world(stretch.place) - world(ray.stretches[0].place)).length();
            near("the place", along, begins, 1e-9);
            near("transmittance", stretch.transmittance, transmittance_at(begins), 1e-9);
            near("scattering of a", stretch.scattering[0], scattering()[0] * long, 1e-12);
        }
        let bare = |scattering: f64| -> f64 {
            let of = |band: usize| {
                let all = absorption * shape.samples()[band] + grey;
                luminance.samples()[band] / luminance.sum() * scattering * -(-all * 64.0).exp_m1() / all
            };
            (0..81).map(of).sum()
        };
        for (seen, scattering) in ray.seen.iter().zip(scattering()) {
            near("what is seen", *seen, bare(scattering), 1e-9);
        }
    }
}

#[test]
fn a_pixel_of_a_device_is_that_of_the_whole_picture() {
    with_renderer(|renderer| {
        for name in ["specular_three", "background", "coloured_background"] {
            for storage in [StoreAs::Single, StoreAs::Half] {
                let rungs = Rungs::new(scenes::named(name), SIZE);
                let plan = ScenePlan { storage, ..rungs.planned.plan.clone() };
                let rungs = Rungs::planned(rungs.scene.clone(), Planned { plan, ..rungs.planned.clone() }, SIZE);
                let accumulators = rungs.gpu_accumulators(renderer);
                let all = renderer.read(&accumulators).unwrap();
                let pixels = SIZE[0] * SIZE[1];
                for place in
                    [[0, 0], [SIZE[0] / 2, SIZE[1] / 2], [SIZE[0] / 2, SIZE[1] / 3], [SIZE[0] - 1, SIZE[1] - 1]]
                {
                    let at = place[1] * SIZE[0] + place[0];
                    let of = |planes: &[f32]| planes.iter().skip(at).step_by(pixels).copied().collect::<Vec<_>>();
                    let pixel = renderer.read_pixel(&accumulators, place).unwrap();
                    assert_eq!(pixel.accumulators, of(&all.accumulators), "{name} {storage:?} {place:?}");
                    assert_eq!(pixel.transmittance, of(&all.transmittance), "{name} {storage:?} {place:?}");
                }
            }
        }
    });
}

#[test]
fn the_probe_of_a_medium_thinned_by_its_gradient_is_that_of_a_thinner_medium() {
    let probed = |scene: &Scene| {
        let statistics = scene.volume().statistics().unwrap();
        Ray::march(scene, &statistics, [[1, 1], [0, 0]], &Quiet).unwrap()
    };
    let mut thinned = slab(0.04, "step = 0.0625");
    thinned.transfer.gradient_opacity = vec![(0.0, 0.25)];
    // A quarter of each optical depth.
    let mut thinner = slab(0.04, "step = 0.0625");
    thinner.transfer.opacity_length *= 4.0;
    let [thinned, thinner] = [thinned, thinner].map(|scene| probed(&scene));
    for (one, other) in thinned.seen.iter().chain(&thinned.absorbed).zip(thinner.seen.iter().chain(&thinner.absorbed)) {
        near("light of a material", *one, *other, 1e-12);
    }
    for (one, other) in thinned.stretches.iter().zip(&thinner.stretches) {
        near("transmittance", one.transmittance, other.transmittance, 1e-12);
        near("scattering", one.scattering[0], other.scattering[0], 1e-12);
        near("opacity", one.opacity, other.opacity, 1e-12);
    }
}
