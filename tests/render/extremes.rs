//! The largest or the smallest value along each ray alone: closed forms, what hides, and what is refused.

use std::path::Path;
use std::sync::Arc;

use glam::{DMat3, DVec3};
use relume::document::{self, InMemory, SceneOptions};
use relume::film::Film;
use relume::number::Real;
use relume::plan::{PlanWarning, plan};
use relume::progress::Quiet;
use relume::scene::Scene;
use relume::volume::{Geometry, Volume, Voxels};

use crate::fields::check;
use crate::support::rungs::{Rungs, with_renderer};

const DIMS: [usize; 3] = [9, 9, 40];

/// Values without an order along z.
fn value(x: usize, y: usize, z: usize) -> u8 {
    let number = (x * 7919 + y * 104_729 + z * 1_299_709 + 12_345) * 2_654_435_761 % 4_294_967_296;
    u8::try_from(number >> 24).unwrap()
}

fn volume(value: impl Fn(usize, usize, usize) -> u8) -> Volume {
    let [width, height, depth] = DIMS;
    let all = (0..depth).flat_map(|z| (0..height).flat_map(move |y| (0..width).map(move |x| (x, y, z))));
    let voxels = all.map(|(x, y, z)| value(x, y, z)).collect();
    let geometry = Geometry::new("columns", DIMS, DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
    Volume::new("columns", Voxels::U8(voxels), geometry).unwrap()
}

/// A scene of `volume`, seen along z: the ray of each of 3 × 3 pixels meets the voxels of a column, each at least once.
fn scene(volume: Volume, transfer: &str) -> Scene {
    let text = format!(
        "version = 1\nblending = \"maximum\"\n[camera]\nprojection = \"orthographic\"\nheight = 3\nposition = [4, 4, -10]\ntarget = \
         [4, 4, 0]\n[accuracy]\nstep = 0.6\ninterpolation = \"nearest\"\n[lights.day]\nspectrum = \"D65\"\nkind = \"directional\"\n\
         direction = [0.3, 0.5, 1]\nshadows = true\n[materials.one]\nreflectance = \"orange\"\nspecular = 0.4\n[materials.two]\nreflectance = \
         \"blue\"\n[transfer]\nopacity_length = 3\n{transfer}\n"
    );
    let volumes = InMemory { volume: Arc::new(volume), labels: None, further: Vec::new() };
    document::parse_on(volumes, "columns", &text, Path::new(""), &SceneOptions::default(), &Quiet).unwrap().scene
}

const RAMP: &str = "opacity = [[0, 0], [255, 0.85]]\nmaterial = [[0, \"one\"]]";

/// Opacities of the pixels, row by row.
fn opacities<R: Real>(film: &Film<R>) -> Vec<f64> {
    film.transmittance.iter().map(|left| 1.0 - left.to_f64()).collect()
}

/// The opacities of the nine columns around the middle at their values chosen by `of`.
fn expected(of: impl Fn(&[u8]) -> u8) -> Vec<f64> {
    let mut all = Vec::new();
    // The camera looks along z with y downwards or upwards: rows are compared as sets.
    for y in 3..6 {
        for x in 3..6 {
            let column: Vec<u8> = (0..DIMS[2]).map(|z| value(x, y, z)).collect();
            all.push(0.85 * f64::from(of(&column)) / 255.0);
        }
    }
    all
}

fn sorted(mut numbers: Vec<f64>) -> Vec<f64> {
    numbers.sort_by(f64::total_cmp);
    numbers
}

fn assert_near(what: &str, found: Vec<f64>, expected: Vec<f64>, within: f64) {
    let (found, expected) = (sorted(found), sorted(expected));
    let largest = found.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(found.len() == expected.len() && largest <= within, "{what}: off by {largest}");
}

#[test]
fn a_pixel_has_the_opacity_that_the_transfer_function_states_at_the_extreme_value_of_its_ray() {
    for blending in ["maximum", "minimum"] {
        let mut scene = scene(volume(value), RAMP);
        let extreme =
            |column: &[u8]| *if blending == "maximum" { column.iter().max() } else { column.iter().min() }.unwrap();
        if blending == "minimum" {
            scene.blending = relume::scene::Blending::Minimum;
        }
        let expected = expected(extreme);
        for step in [0.2, 0.6] {
            scene.accuracy.step_length = step;
            let rungs = Rungs::new(scene.clone(), [3, 3]);
            assert_near(blending, opacities(&rungs.march::<f64>(&rungs.exact())), expected.clone(), 1e-12);
            assert_near(blending, opacities(&rungs.march::<f64>(&rungs.stored::<f64>())), expected.clone(), 2e-6);
            with_renderer(|renderer| {
                assert_near(blending, opacities(&rungs.gpu(renderer)), expected.clone(), 2e-6);
            });
        }
    }
}

#[test]
fn a_value_beyond_an_interval_hides_the_interval() {
    let transfer = "intervals = [{ material = \"one\", range = [90, 110], opacity = 0.5 }]";
    // In the columns with an even x the largest value lies in the interval, in the others beyond, and far from it.
    let voxel = |x: usize, _: usize, z: usize| match z {
        3 => 100,
        30 if x % 2 == 1 => 200,
        _ => 10,
    };
    for skipping in [true, false] {
        let mut scene = scene(volume(voxel), transfer);
        scene.accuracy.skipping = skipping;
        let rungs = Rungs::new(scene, [3, 3]);
        let columns = vec![0.0, 0.5, 0.0, 0.0, 0.5, 0.0, 0.0, 0.5, 0.0];
        assert_near("f64", opacities(&rungs.march::<f64>(&rungs.exact())), columns.clone(), 1e-12);
        with_renderer(|renderer| assert_near("device", opacities(&rungs.gpu(renderer)), columns.clone(), 2e-6));
    }
}

#[test]
fn the_media_at_the_largest_values_of_two_fields_add_up_wherever_they_are() {
    let further = "[volumes.other]\nphantom = \"slab\"\ntransfer = { intervals = [{ material = \"two\", range = [90, 110], opacity = 0.3 }] }";
    let transfer = format!("intervals = [{{ material = \"one\", range = [90, 110], opacity = 0.5 }}]\n{further}");
    let at = |place: usize| volume(move |_, _, z| if z == place { 100 } else { 0 });
    let [a, b] = [0.5_f64, 0.3].map(|opacity| -(-opacity).ln_1p());
    let left = (-(a + b)).exp();
    let expected = [a * (1.0 - left) / (a + b), b * (1.0 - left) / (a + b), left];
    for places in [[5, 30], [30, 5], [7, 7]] {
        let mut scene = scene(at(places[0]), &transfer);
        let terms = scene.fields.further()[0].terms.clone();
        let other = relume::scene::Field::new("other".to_owned(), Arc::new(at(places[1])), terms);
        scene.fields = scene.fields.with(vec![other]);
        let rungs = Rungs::new(scene, [3, 3]);
        check("f64", &rungs.march::<f64>(&rungs.exact()), expected, 1e-12);
        with_renderer(|renderer| check("device", &rungs.gpu(renderer), expected, 2e-6));
    }
}

#[test]
fn without_a_term_nothing_is_seen() {
    let scene = scene(volume(value), "");
    let rungs = Rungs::new(scene, [3, 3]);
    assert_near("f64", opacities(&rungs.march::<f64>(&rungs.exact())), vec![0.0; 9], 0.0);
    assert_near("f32", opacities(&rungs.march::<f32>(&rungs.stored::<f32>())), vec![0.0; 9], 0.0);
    with_renderer(|renderer| assert_near("device", opacities(&rungs.gpu(renderer)), vec![0.0; 9], 0.0));
}

#[test]
fn all_light_reaches_the_extreme_value_whole() {
    let scene = scene(volume(value), RAMP);
    let planned = plan(&scene, &Quiet).unwrap();
    assert!(planned.plan.shading.is_none() && !planned.plan.light.is_dimmed() && planned.positions.len() == 1);
    let warnings: Vec<String> = planned.warnings.iter().map(ToString::to_string).collect();
    assert_eq!(planned.warnings.iter().map(PlanWarning::code).collect::<Vec<_>>(), ["shadows-unused"]);
    assert!(warnings[0].contains("lights.day.shadows has no effect"), "{warnings:?}");
    let explained = planned.explain(&scene).join(" ");
    assert!(explained.contains("largest value along its ray") && explained.contains("shadows"), "{explained}");
}

#[test]
fn what_an_extreme_value_cannot_have_is_refused_by_name() {
    let refused = |change: &dyn Fn(&mut Scene)| {
        let mut scene = scene(volume(value), RAMP);
        change(&mut scene);
        plan(&scene, &Quiet).unwrap_err().to_string()
    };
    let factor = refused(&|scene| scene.transfer.gradient_opacity = vec![(0.0, 0.0), (100.0, 1.0)]);
    assert!(factor.contains("blending = \"maximum\"") && factor.contains("gradient_opacity"), "{factor}");
    let segments = refused(&|scene| scene.accuracy.integration = relume::scene::Integration::Segments);
    assert!(segments.contains("segments") && segments.contains("single value"), "{segments}");
}
