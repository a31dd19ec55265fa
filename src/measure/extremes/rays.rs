//! Rays along faces, edges and corners; cameras on a face, inside the volume and 1e6 units away.

use glam::DVec3;

use super::left::worst;
use super::slab::{Picture, Slab};
use super::{Bound, Extreme, ExtremeError, Group};
use relume_base::number::count;
use relume_scene::{Aim, Camera, Projection};

pub(super) fn extremes() -> Vec<Extreme> {
    let mut all: Vec<Extreme> = [
        ("in the plane of a face", DVec3::new(0.0, 8.0, 0.0), DVec3::Z, 24.0),
        ("in the plane of the other face", DVec3::new(16.0, 8.0, 0.0), DVec3::Z, 24.0),
        ("a thousandth outside a face", DVec3::new(-1e-3, 8.0, 0.0), DVec3::Z, 0.0),
        ("a thousandth outside the other face", DVec3::new(16.001, 8.0, 0.0), DVec3::Z, 0.0),
        ("along an edge", DVec3::ZERO, DVec3::Z, 24.0),
        ("along the opposite edge", DVec3::new(16.0, 16.0, 0.0), DVec3::Z, 24.0),
        ("a thousandth outside an edge", DVec3::new(-1e-3, -1e-3, 0.0), DVec3::Z, 0.0),
        ("along an edge between macrocells", DVec3::new(8.0, 8.0, 0.0), DVec3::NEG_Z, 24.0),
        ("through opposite corners", DVec3::ZERO, DVec3::new(16.0, 16.0, 24.0), 1088.0_f64.sqrt()),
        ("through opposite corners of a face", DVec3::ZERO, DVec3::new(16.0, 16.0, 0.0), 512.0_f64.sqrt()),
        ("touching one corner", DVec3::ZERO, DVec3::new(1.0, -1.0, 0.0), 0.0),
        ("touching an edge", DVec3::new(0.0, 0.0, 12.0), DVec3::new(1.0, -1.0, 0.0), 0.0),
    ]
    .into_iter()
    .map(|(name, through, direction, length)| ray(name, through, direction, length))
    .collect();
    let middle = DVec3::splat(16.0);
    let oblique = DVec3::new(0.3, 0.2, 1.0);
    all.push(far_away());
    all.extend([
        camera("on a face", DVec3::new(16.0, 16.0, 0.0), DVec3::Z, 60.0),
        camera("on a face, looking away", DVec3::new(16.0, 16.0, 0.0), DVec3::NEG_Z, 60.0),
        camera("in a corner", DVec3::ZERO, DVec3::ONE, 60.0),
        camera("inside", middle, oblique, 70.0),
        camera("inside, with a field of view of 170°", middle, oblique, 170.0),
        camera("a millionth in front of a face", DVec3::new(16.0, 16.0, -1e-6), DVec3::Z, 60.0),
        camera("1e6 away", middle - 1e6 * oblique.normalize(), oblique, 2.0 * (24.0 / 1e6_f64).atan().to_degrees()),
        camera("1e6 away, looking away", middle - 1e6 * oblique.normalize(), -oblique, 60.0),
    ]);
    all
}

/// A ray through a point of a 16 × 16 × 24 volume; `length` of it is inside.
fn ray(name: &str, through: DVec3, direction: DVec3, length: f64) -> Extreme {
    let slab = Slab { dims: [17, 17, 25], ..Slab::default() };
    let asked = slab.clone();
    let scene = move || -> Result<Vec<Picture>, ExtremeError> {
        let mut scene = asked.scene()?;
        // Whole numbers keep the eye exactly on the ray.
        let scale = if direction.length() > 10.0 { 2.0 } else { 50.0 };
        let position = through - scale * direction;
        let up = if direction.z.abs() > direction.x.abs() { DVec3::Y } else { DVec3::Z };
        let aim = Aim::LookAt { position, target: position + direction };
        scene.camera = Camera { projection: Projection::Orthographic { height: Some(0.1) }, aim, up };
        Ok(vec![Picture::of(scene)])
    };
    let bound = if length > 0.0 { Bound::march(length.ceil()) } else { Bound::EXACT };
    Extreme::shown(Group::Rays, format!("a ray {name}"), bound, scene, move |lefts| {
        worst(lefts.iter().map(|left| slab.error_at(left, 0, length)))
    })
}

/// Parallel rays from a camera 1e9 units away, obliquely through the volume.
fn far_away() -> Extreme {
    const SIDE: f64 = 32.0;
    let slab = Slab { dims: [33, 33, 33], opacity: 0.02, step: 0.37, ..Slab::default() };
    let asked = slab.clone();
    let (middle, direction) = (DVec3::splat(16.0), DVec3::new(0.3, 0.2, 1.0).normalize());
    let scene = move || -> Result<Vec<Picture>, ExtremeError> {
        let mut scene = asked.scene()?;
        let aim = Aim::LookAt { position: middle - 1e9 * direction, target: middle };
        scene.camera = Camera { projection: Projection::Orthographic { height: Some(0.1) }, aim, up: DVec3::Y };
        Ok(vec![Picture::of(scene)])
    };
    let bound = Bound::march(100.0).and(1e-6, "march from afar", "the eye, 1e9 away, is a multiple of 2⁻²³ in f64");
    let name = "parallel rays from a camera 1e9 away";
    Extreme::shown(Group::Rays, name, bound, scene, move |lefts| {
        let length = within(middle - 1e3 * direction, direction, SIDE);
        worst(lefts.iter().map(|left| slab.error_at(left, 0, length)))
    })
}

/// A camera at `eye` in or before a cube of 32, with a field of view of `fov_degrees` along `forward`. The length of
/// each pixel's ray in the cube follows from six planes.
fn camera(name: &str, eye: DVec3, forward: DVec3, fov_degrees: f64) -> Extreme {
    const SIZE: [usize; 2] = [9, 6];
    let slab = Slab { dims: [33, 33, 33], opacity: 0.02, step: 0.37, ..Slab::default() };
    let asked = slab.clone();
    let scene = move || -> Result<Vec<Picture>, ExtremeError> {
        let mut scene = asked.scene()?;
        // A near target would round the direction of a distant eye.
        let aim = Aim::LookAt { position: eye, target: eye + 1e6 * forward };
        scene.camera = Camera { projection: Projection::Perspective { fov_degrees }, aim, up: DVec3::Y };
        Ok(vec![Picture { size: SIZE, ..Picture::of(scene) }])
    };
    let forward = forward.normalize();
    let right = forward.cross(DVec3::Y).normalize();
    let up = right.cross(forward);
    let half = 0.5 * fov_degrees.to_radians();
    let direction = move |i: usize| {
        let [width, height] = SIZE.map(count);
        let u = 2.0 * (count(i % SIZE[0]) + 0.5) / width - 1.0;
        let v = 1.0 - 2.0 * (count(i / SIZE[0]) + 0.5) / height;
        (forward + half.tan() * (u * width / height * right + v * up)).normalize()
    };
    let distant = if eye.length() > 1e3 { 1e-14 * eye.length() } else { 0.0 };
    let bound = match Bound::march(150.0) {
        bound if distant > 0.0 => bound.and(distant, "march from afar", "the place of the eye is rounded"),
        bound => bound,
    };
    Extreme::shown(Group::Rays, format!("a camera {name}"), bound, scene, move |lefts| {
        worst(lefts.iter().flat_map(|left| {
            let slab = &slab;
            (0..SIZE[0] * SIZE[1]).map(move |i| slab.error_at(left, i, within(eye, direction(i), 32.0)))
        }))
    })
}

/// Length of the ray from `eye` inside a cube from 0 to `side`.
fn within(eye: DVec3, direction: DVec3, side: f64) -> f64 {
    let (a, b) = (-eye / direction, (side - eye) / direction);
    let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
    for axis in 0..3 {
        if direction[axis] == 0.0 {
            if !(0.0..=side).contains(&eye[axis]) {
                return 0.0;
            }
        } else {
            enter = enter.max(a[axis].min(b[axis]));
            leave = leave.min(a[axis].max(b[axis]));
        }
    }
    (leave - enter).max(0.0)
}
