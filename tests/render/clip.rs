//! Clip planes: closed forms, crop boxes by planes, moving planes, caps, and shadows of what goes.

use std::path::Path;
use std::sync::Arc;

use glam::{DMat3, DVec3};
use relume::document::{self, InMemory, SceneOptions};
use relume::film::Film;
use relume::number::Real;
use relume::plan::{Integrate, Stale};
use relume::progress::Quiet;
use relume::scene::{Clip, ClipPlane, Keep, Scene, ShadowMethod};
use relume::spectrum::colour::{Xyz, d65_white, lab_from_xyz};
use relume::volume::{Geometry, Phantom, Volume, Voxels};

use crate::support::rungs::{Rungs, with_renderer};
use crate::support::scenes::float;

/// A box of one value: from −½ to 19½ along x and y, 29½ along z, in a world with these axes.
fn medium(direction: DMat3) -> Volume {
    let dims = [20, 20, 30];
    let geometry = Geometry::new("box", dims, DVec3::ONE, DVec3::ZERO, direction).unwrap();
    Volume::new("box", Voxels::U8(vec![100; 20 * 20 * 30]), geometry).unwrap()
}

fn scene_of(volume: Volume, text: &str) -> Scene {
    let text = format!(
        "version = 1\n{text}\n[materials.one]\nreflectance = \"orange\"\nambient = 0\ndiffuse = 1\n[camera]\nprojection = \
         \"orthographic\"\nheight = 26\nposition = [40, 25, -30]\ntarget = [9.5, 9.5, 14.5]\n"
    );
    let volumes = InMemory { volume: Arc::new(volume), labels: None, further: Vec::new() };
    let options = SceneOptions::default();
    document::parse_on(volumes, "clip", &text, Path::new(""), &options, &Quiet).unwrap().scene
}

/// A homogeneous box under ambient light, or without.
fn homogeneous(opacity: f64, step: f64, integration: &str) -> Scene {
    let text = format!(
        "shading = \"none\"\n[transfer]\nopacity_length = 1\nintervals = [{{ material = \"one\", range = [90, 110], opacity = \
         {opacity} }}]\n[lights.day]\nspectrum = \"D65\"\nkind = \"ambient\"\n[accuracy]\nstep = {step}\ntermination = 0\n\
         integration = \"{integration}\"\n"
    );
    scene_of(medium(DMat3::IDENTITY), &text)
}

fn plane(point: [f64; 3], normal: [f64; 3]) -> ClipPlane {
    ClipPlane::new(point.into(), normal.into()).unwrap()
}

fn clip(planes: &[ClipPlane]) -> Clip {
    Clip { planes: planes.to_vec(), ..Clip::default() }
}

/// Planes of several directions, one of which cuts nothing.
fn oblique() -> Vec<ClipPlane> {
    vec![
        plane([9.5, 9.5, 20.3], [0.2, 0.1, 1.0]),
        plane([3.0, 9.0, 9.0], [-3.0, 1.0, 0.5]),
        plane([9.0, 15.7, 4.0], [0.0, 1.0, -0.3]),
        plane([100.0, 0.0, 0.0], [1.0, 0.0, 0.0]),
    ]
}

/// Length of each pixel's ray in the box, cut by these planes.
fn lengths(scene: &Scene, planes: &[ClipPlane], size: [usize; 2]) -> Vec<f64> {
    let view = scene.camera.view(&scene.frame.geometry, float(size[0]) / float(size[1])).unwrap();
    let last = DVec3::new(19.0, 19.0, 29.0);
    (0..size[0] * size[1])
        .map(|pixel| {
            let u = 2.0 * (float(pixel % size[0]) + 0.5) / float(size[0]) - 1.0;
            let v = 1.0 - 2.0 * (float(pixel / size[0]) + 0.5) / float(size[1]);
            let from = view.eye + view.half[0] * u * view.right + view.half[1] * v * view.up;
            let (mut near, mut far) = (f64::NEG_INFINITY, f64::INFINITY);
            // The box is a set of six planes.
            let faces = DVec3::AXES.into_iter().flat_map(|axis| [(axis, last), (-axis, DVec3::ZERO)]);
            let planes = planes.iter().map(|plane| (plane.normal, plane.point));
            for (normal, point) in faces.chain(planes) {
                let (beyond, along) = (normal.dot(from - point), normal.dot(view.forward));
                if along > 0.0 {
                    far = far.min(-beyond / along);
                } else {
                    near = near.max(-beyond / along);
                }
            }
            (far - near).max(0.0)
        })
        .collect()
}

fn check<R: Real>(what: &str, film: &Film<R>, expected: &[f64], limit: f64) {
    let worst = expected.iter().enumerate().map(|(i, left)| {
        let [gained, passed] = [&film.accumulators[i], &film.transmittance[i]].map(|number| number.to_f64());
        (gained - (1.0 - left)).abs().max((passed - left).abs())
    });
    let worst = worst.fold(0.0, f64::max);
    assert!(worst <= limit, "{what}: off by {worst:e}");
}

#[test]
fn a_cut_box_is_its_closed_form_on_every_rung() {
    let size = [24, 20];
    for (opacity, step, integration) in
        [(0.05, 0.7, "samples"), (0.05, 3.1, "samples"), (0.6, 1.0, "samples"), (0.05, 0.7, "segments")]
    {
        let mut scene = homogeneous(opacity, step, integration);
        scene.clip = clip(&oblique());
        let depth = -(-opacity).ln_1p();
        let lengths = lengths(&scene, &oblique(), size);
        assert!(lengths.iter().filter(|&&length| length > 1.0).count() > 100, "the box is seen");
        let expected: Vec<f64> = lengths.iter().map(|length| (-depth * length).exp()).collect();
        let rungs = Rungs::new(scene, size);
        assert_eq!(rungs.planned.plan.integration == Integrate::Segments, integration == "segments");
        let what = |rung: &str| format!("{rung}, opacity {opacity}, step {step}, {integration}");
        check(&what("f64"), &rungs.march::<f64>(&rungs.exact()), &expected, 1e-9);
        check(&what("tables"), &rungs.march::<f64>(&rungs.stored::<f64>()), &expected, 2e-6);
        check(&what("f32"), &rungs.march::<f32>(&rungs.stored::<f32>()), &expected, 3e-5);
        with_renderer(|renderer| check(&what("device"), &rungs.gpu(renderer), &expected, 3e-5));
    }
}

#[test]
fn a_corner_cut_out_is_its_closed_form_on_every_rung() {
    let size = [24, 20];
    for (opacity, step) in [(0.05, 0.7), (0.05, 3.1), (0.6, 1.0)] {
        let mut scene = homogeneous(opacity, step, "samples");
        let planes = [
            plane([9.5, 9.5, 14.3], [0.2, 0.1, 1.0]),
            plane([9.0, 9.0, 9.0], [-3.0, 1.0, 0.5]),
            plane([9.0, 6.7, 4.0], [0.0, 1.0, -0.3]),
        ];
        scene.clip = Clip { keep: Keep::Any, ..clip(&planes) };
        let whole = lengths(&scene, &[], size);
        // The part beyond all planes is the one that the same planes leave, the other way round.
        let turned = planes.map(|plane| ClipPlane { normal: -plane.normal, ..plane });
        let gone = lengths(&scene, &turned, size);
        assert!(gone.iter().filter(|&&length| length > 1.0).count() > 60, "a corner is seen");
        let depth = -(-opacity).ln_1p();
        let expected: Vec<f64> = whole.iter().zip(gone).map(|(whole, gone)| (-depth * (whole - gone)).exp()).collect();
        let rungs = Rungs::new(scene, size);
        assert!(rungs.planned.plan.clip.keeps_any);
        let what = |rung: &str| format!("{rung}, opacity {opacity}, step {step}");
        check(&what("f64"), &rungs.march::<f64>(&rungs.exact()), &expected, 1e-9);
        check(&what("tables"), &rungs.march::<f64>(&rungs.stored::<f64>()), &expected, 2e-6);
        check(&what("f32"), &rungs.march::<f32>(&rungs.stored::<f32>()), &expected, 3e-5);
        with_renderer(|renderer| check(&what("device"), &rungs.gpu(renderer), &expected, 3e-5));
    }
}

/// A plane is the same alone, beside one beyond which all of the box lies, of what either keeps, and as a plane of the first field.
#[test]
fn planes_that_leave_the_same_part_leave_the_same_picture() {
    let size = [24, 20];
    let text = "[transfer]\nopacity_length = 1\nintervals = [{ material = \"one\", range = [90, 110], opacity = 0.2 }]\n[lights.key]\nspectrum \
                = \"D65\"\nkind = \"directional\"\ndirection = [0.6, 0.4, -0.8]\n[accuracy]\nstep = 0.8\ntermination = 0\n";
    for shadows in [false, true] {
        let shown = |clip: Clip| {
            let mut scene = scene_of(medium(DMat3::from_rotation_z(0.4)), text);
            scene.lights[0].shadows = shadows;
            scene.shadows.spacing = 1.0;
            scene.clip = clip;
            Rungs::new(scene, size)
        };
        let cut = plane([4.0, 12.0, 10.0], [0.3, 0.1, -1.0]);
        let behind_all = plane([0.0, 0.0, -90.0], [0.1, 0.2, 1.0]);
        let first = ClipPlane { fields: [true, false, false, false], ..cut };
        let alone = shown(clip(&[cut]));
        let others = [shown(Clip { keep: Keep::Any, ..clip(&[behind_all, cut]) }), shown(clip(&[first]))];
        let brightest = |weights: &[f64]| weights.iter().copied().fold(0.0, f64::max);
        // Of fields alone, shadows fade over a voxel.
        let limits = if shadows { [0.03; 2] } else { [1e-9, 2e-5] };
        let exact = alone.march::<f64>(&alone.exact()).accumulators;
        for other in &others {
            assert!(other.planned.plan.clip.is_by_field() && !alone.planned.plan.clip.is_by_field());
            let found = other.march::<f64>(&other.exact()).accumulators;
            let worst = exact.iter().zip(&found).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(worst <= limits[0] * brightest(&exact), "f64, shadows {shadows}: off by {worst}");
            with_renderer(|renderer| {
                let [one, two] = [&alone, other].map(|rungs| rungs.gpu(renderer).map(f64::from).accumulators);
                let worst = one.iter().zip(&two).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(worst <= limits[1] * brightest(&one), "device, shadows {shadows}: off by {worst}");
            });
        }
    }
}

#[test]
fn planes_in_the_faces_of_a_crop_box_leave_what_the_box_leaves() {
    let mut scene = crate::support::scenes::named("diffuse_three");
    scene.clip.cap = false;
    let [low, high] = [DVec3::new(8.25, 3.5, 4.0), DVec3::new(22.5, 20.0, 13.75)];
    let geometry = scene.frame.geometry;
    let mut cropped = scene.clone();
    cropped.crop = Some([low, high]);
    let mut clipped = scene;
    for axis in 0..3 {
        for (corner, sign) in [(low, -1.0), (high, 1.0)] {
            let normal = geometry.direction.col(axis) * sign;
            clipped.clip.planes.push(ClipPlane::new(geometry.world_from_index(corner), normal).unwrap());
        }
    }
    let [cropped, clipped] = [cropped, clipped].map(|scene| {
        let rungs = Rungs::new(scene, [40, 30]);
        rungs.march::<f64>(&rungs.exact())
    });
    let worst = cropped.accumulators.iter().zip(&clipped.accumulators).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(worst < 1e-9, "off by {worst:e}");
    assert!(clipped.transmittance.iter().any(|&left| left < 0.5), "something is left");
}

/// L* of each pixel in f64.
fn lightness(scene: &Scene, size: [usize; 2]) -> Vec<f64> {
    let rungs = Rungs::new(scene.clone(), size);
    let lightness = |colour: DVec3| lab_from_xyz(Xyz(colour.to_array()), d65_white()).0[0];
    rungs.lit(&rungs.exact()).into_iter().map(|(colour, _)| lightness(colour)).collect()
}

#[test]
fn a_plane_that_moves_through_steps_jumps_no_more_than_the_truth() {
    let size = [24, 20];
    let volume = Volume::phantom(Phantom::Shells, Some([24, 24, 24])).unwrap();
    let text = "shading = \"none\"\n[transfer]\nopacity_length = 1\nintervals = [{ material = \"one\", range = [40, 255], ramp = 60, opacity = \
                0.2 }]\n[lights.day]\nspectrum = \"D65\"\nkind = \"ambient\"\n[accuracy]\nstep = 1\ntermination = 0\n";
    let shells = scene_of(volume, text);
    for (what, scene, limit) in [("box", homogeneous(0.1, 1.0, "samples"), 1e-6), ("shells", shells, 0.01)] {
        let frames = |step: f64| -> Vec<Vec<f64>> {
            let at = |i: u32| {
                let mut scene = scene.clone();
                scene.accuracy.step_length = step;
                let moved = DVec3::new(9.5, 9.5, 9.0) + DVec3::new(0.3, -0.2, 1.0).normalize() * (f64::from(i) / 8.0);
                scene.clip = clip(&[ClipPlane::new(moved, DVec3::new(0.3, -0.2, 1.0)).unwrap()]);
                lightness(&scene, size)
            };
            (0..=16).map(at).collect()
        };
        let [found, truth] = [1.0, 1.0 / 8.0].map(frames);
        // Flicker, as the eye sees it: the second difference from frame to frame, beyond that of the truth.
        let bends = |frames: &[Vec<f64>], pixel: usize| -> Vec<f64> {
            let seen: Vec<f64> = frames.iter().map(|frame| frame[pixel]).collect();
            seen.windows(3).map(|at| at[0] - 2.0 * at[1] + at[2]).collect()
        };
        let mut jumps: Vec<f64> = (0..size[0] * size[1])
            .flat_map(|pixel| {
                let [found, truth] = [&found, &truth].map(|frames| bends(frames, pixel));
                found.into_iter().zip(truth).map(|(a, b)| (a - b).abs()).collect::<Vec<_>>()
            })
            .collect();
        jumps.sort_by(f64::total_cmp);
        let p95 = jumps[jumps.len() * 95 / 100];
        assert!(p95 <= limit, "{what}: {p95}");
    }
}

#[test]
fn shading_sees_a_cut_face_at_every_step() {
    let text = |step: f64, integration: &str| {
        format!(
            "[transfer]\nopacity_length = 1\nintervals = [{{ material = \"one\", range = [90, 110], opacity = 0.5 }}]\n[lights.key]\n\
             spectrum = \"D65\"\nkind = \"directional\"\ndirection = [0.6, 0, -0.8]\n[accuracy]\nstep = {step}\nintegration = \
             \"{integration}\"\ntermination = 0\n"
        )
    };
    // Seen along z: the light of the cut face is the cosine to it, of the part within reach of the plane.
    let turned = DMat3::from_rotation_z(0.4);
    for integration in ["samples", "segments"] {
        for (step, limit) in [(0.25, 0.03), (0.125, 0.015)] {
            let mut scene = scene_of(medium(turned), &text(step, integration));
            scene.camera.aim = relume::scene::Aim::LookAt {
                position: DVec3::new(4.0, 12.0, -30.0),
                target: DVec3::new(4.0, 12.0, 0.0),
            };
            let outward = DVec3::new(0.3, 0.0, -1.0);
            scene.clip = clip(&[ClipPlane::new(DVec3::new(4.0, 12.0, 10.0), outward).unwrap()]);
            let cosine = outward.normalize().dot(DVec3::new(0.6, 0.0, -0.8));
            // Shading ends 1.5 units from the plane; along the ray, that is longer by its slant.
            let reach = 1.5 / -outward.normalize().z;
            let expected = cosine * (1.0 - 0.5_f64.powf(reach));
            let rungs = Rungs::new(scene.clone(), [1, 1]);
            let mut found = vec![
                rungs.march::<f64>(&rungs.exact()).accumulators[0],
                rungs.march::<f32>(&rungs.stored::<f32>()).accumulators[0].into(),
            ];
            with_renderer(|renderer| found.push(rungs.gpu(renderer).accumulators[0].into()));
            for found in found {
                assert!((found - expected).abs() <= limit, "{integration} at {step}: {found} for {expected}");
            }
            scene.clip.cap = false;
            let rungs = Rungs::new(scene, [1, 1]);
            assert!(rungs.march::<f64>(&rungs.exact()).accumulators[0].abs() < 1e-12, "no face without a cap");
        }
    }
}

#[test]
fn what_a_plane_cuts_away_casts_no_shadow() {
    let size = [24, 20];
    let shown = |method: ShadowMethod, (keep, planes): (Keep, &[ClipPlane]), place: &str| {
        let text = format!(
            "shading = \"none\"\n[transfer]\nopacity_length = 1\nintervals = [{{ material = \"one\", range = [90, 110], opacity = 0.05 }}]\n\
             [lights.key]\nspectrum = \"D65\"\nshadows = true\n{place}\n[accuracy]\nstep = 0.5\ntermination = 0\n[shadows]\nspacing = 1\n"
        );
        let mut scene = scene_of(medium(DMat3::IDENTITY), &text);
        scene.shadows.method = method;
        scene.clip = Clip { keep, ..clip(planes) };
        Rungs::new(scene, size)
    };
    // A plane through a part of a sample, and an oblique one.
    let cut = [plane([0.0, 0.0, 12.3], [0.0, 0.0, 1.0]), plane([14.2, 0.0, 0.0], [1.0, 0.0, 0.4])];
    let directional = "kind = \"directional\"\ndirection = [0.5, 0.2, 1]";
    let point = "kind = \"point\"\nposition = [12, 5, 60]";
    let places = [directional, point, "kind = \"ambient\""];
    for (place, keep) in places.into_iter().flat_map(|place| [(place, Keep::All), (place, Keep::Any)]) {
        let exact = |planes: &[ClipPlane]| {
            let rungs = shown(ShadowMethod::Rays, (keep, planes), place);
            rungs.march::<f64>(&rungs.exact()).accumulators
        };
        let (by_rays, uncut) = (exact(&cut), exact(&[]));
        let brightest = |weights: &[f64]| weights.iter().copied().fold(0.0, f64::max);
        let brighter = by_rays.iter().zip(&uncut).filter(|&(cut, uncut)| *cut > 1.05 * uncut).count();
        assert!(brighter > 20, "{place}: light reaches what was behind, in {brighter} pixels");
        let rungs = shown(ShadowMethod::Grid, (keep, &cut), place);
        let by_grid = rungs.march::<f64>(&rungs.exact()).accumulators;
        let off = |found: &[f64]| {
            let mut off: Vec<f64> =
                found.iter().zip(&by_rays).map(|(a, b)| (a - b).abs() / brightest(&by_rays)).collect();
            off.sort_by(f64::total_cmp);
            [off[off.len() * 95 / 100], off[off.len() - 1]]
        };
        let [p95, most] = off(&by_grid);
        assert!(p95 < 0.02 && most < 0.05, "{place}: the grid is off by {p95}, {most}");
        with_renderer(|renderer| {
            let device = rungs.gpu(renderer).accumulators;
            let theirs = rungs.march::<f32>(&rungs.stored::<f32>()).accumulators;
            let worst = device.iter().zip(&theirs).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(worst < 2e-3, "{place}: the device is off by {worst}");
        });
    }
}

#[test]
fn a_plane_makes_a_march_stale_and_one_that_is_off_nothing() {
    let scene = homogeneous(0.1, 1.0, "samples");
    let planned = relume::plan::plan(&scene, &Quiet).unwrap();
    let mut clipped = scene.clone();
    clipped.clip.planes.push(plane([0.0, 0.0, 5.0], [0.0, 0.0, 1.0]));
    assert_eq!(Stale::between(&scene, &planned, &clipped), Stale::Accumulators);
    clipped.clip.planes[0].on = false;
    assert_eq!(Stale::between(&scene, &planned, &clipped), Stale::Nothing);
    clipped.clip.cap = false;
    assert_eq!(Stale::between(&scene, &planned, &clipped), Stale::Nothing, "no face is cut");
    clipped.clip.keep = Keep::Any;
    assert_eq!(Stale::between(&scene, &planned, &clipped), Stale::Nothing, "nor by several planes");
}
