//! A frog, as in a cryosection.
//!
//! The head points towards +x and the back towards −z, as in the Whole Frog data set. Lengths are voxels of
//! 250×235×138.

use std::f32::consts::{PI, TAU};
use std::ops::RangeInclusive;

use glam::{Vec3, vec3};
use rayon::prelude::*;

use super::field::{Grid, Layer, Slice, Solid, Wave, grain, grain_row, lay, store};

/// Default number of voxels; also the box in which the frog is designed.
pub const DIMS: [usize; 3] = [250, 235, 138];

/// Values of the air around the frog.
pub const AIR: RangeInclusive<u8> = 0..=10;
/// Values of skin and muscle; the skin is brighter.
pub const FLESH: RangeInclusive<u8> = 48..=88;
/// Values of the stomach; label 1.
pub const STOMACH: RangeInclusive<u8> = 104..=128;
/// Values of the intestine; label 2.
pub const INTESTINE: RangeInclusive<u8> = 142..=166;
/// Values of the eyes, higher inside; label 3.
pub const EYES: RangeInclusive<u8> = 180..=200;
/// Values of the bones; label 4.
pub const SKELETON: RangeInclusive<u8> = 216..=250;

/// Names of the labels, from 0.
pub const LABELS: [&str; 5] = ["unlabelled", "stomach", "intestine", "eyes", "skeleton"];

/// y of the plane of symmetry.
const MIDDLE: f32 = 117.5;
const SIZE: [f32; 3] = [250.0, 235.0, 138.0];

/// A point at the signed distance `beside` from the plane of symmetry.
fn at(x: f32, beside: f32, z: f32) -> Vec3 {
    vec3(x, MIDDLE + beside, z)
}

/// Left and right.
const SIDES: [f32; 2] = [-1.0, 1.0];

// Joints and tips: x, distance from the plane of symmetry, z.
const HIP: [f32; 3] = [74.0, 13.0, 76.0];
const KNEE: [f32; 3] = [114.0, 74.0, 84.0];
const HEEL: [f32; 3] = [52.0, 84.0, 98.0];
const SOLE: [f32; 3] = [80.0, 98.0, 107.0];
const TOES: [[f32; 3]; 5] =
    [[106.0, 80.0, 111.0], [127.0, 86.0, 113.0], [141.0, 98.0, 113.0], [128.0, 108.0, 113.0], [108.0, 112.0, 112.0]];
const SHOULDER: [f32; 3] = [162.0, 33.0, 82.0];
const ELBOW: [f32; 3] = [142.0, 60.0, 94.0];
const HAND: [f32; 3] = [172.0, 70.0, 108.0];
const FINGERS: [[f32; 3]; 4] = [[192.0, 54.0, 112.0], [201.0, 66.0, 113.0], [199.0, 80.0, 113.0], [188.0, 90.0, 112.0]];

fn side(place: [f32; 3], side: f32) -> Vec3 {
    at(place[0], side * place[1], place[2])
}

fn flesh() -> Vec<Solid> {
    let mut solids = vec![
        Solid::Ellipsoid { centre: at(116.0, 0.0, 75.0), radii: vec3(56.0, 36.0, 30.0) },
        Solid::Ellipsoid { centre: at(150.0, 0.0, 74.0), radii: vec3(36.0, 37.0, 29.0) },
        Solid::Ellipsoid { centre: at(74.0, 0.0, 72.0), radii: vec3(26.0, 22.0, 21.0) },
        Solid::Ellipsoid { centre: at(190.0, 0.0, 72.0), radii: vec3(32.0, 33.0, 19.0) },
        Solid::Ellipsoid { centre: at(211.0, 0.0, 74.0), radii: vec3(19.0, 20.0, 13.0) },
        Solid::Ellipsoid { centre: at(190.0, 0.0, 86.0), radii: vec3(33.0, 28.0, 9.0) },
    ];
    for s in SIDES {
        solids.extend([
            // Eyelid.
            Solid::ball(at(195.0, s * 19.0, 57.0), 10.5),
            // Thigh and calf bulge.
            Solid::rod(at(80.0, s * 18.0, 76.0), side(KNEE, s), [17.0, 10.5]),
            Solid::rod(at(98.0, s * 80.0, 88.0), side(KNEE, s), [12.5, 10.0]),
            Solid::rod(at(98.0, s * 80.0, 88.0), side(HEEL, s), [12.5, 6.0]),
            Solid::rod(side(HEEL, s), side(SOLE, s), [6.5, 6.0]),
            // Arm.
            Solid::rod(side(SHOULDER, s), side(ELBOW, s), [11.0, 8.0]),
            Solid::rod(side(ELBOW, s), side(HAND, s), [9.0, 6.0]),
        ]);
    }
    solids
}

fn digits() -> Vec<Solid> {
    let rays = TOES.map(|toe| (SOLE, toe)).into_iter().chain(FINGERS.map(|finger| (HAND, finger)));
    let digit = |(from, to): ([f32; 3], [f32; 3])| {
        SIDES.map(|s| [Solid::rod(side(from, s), side(to, s), [4.6, 3.6]), Solid::ball(side(to, s), 4.4)])
    };
    rays.flat_map(digit).flatten().collect()
}

/// Mouth and nostrils.
fn cavities() -> Vec<Solid> {
    let mouth = Solid::Ellipsoid { centre: at(204.0, 0.0, 81.0), radii: vec3(38.0, 38.0, 1.8) };
    let nostril = |s: f32| Solid::ball(at(224.0, s * 7.0, 65.5), 2.6);
    vec![mouth, nostril(-1.0), nostril(1.0)]
}

fn stomach() -> Vec<Solid> {
    let bends = [
        (at(156.0, 4.0, 80.0), 4.5),
        (at(146.0, 10.0, 81.0), 8.0),
        (at(130.0, 18.0, 82.0), 12.5),
        (at(114.0, 19.0, 84.0), 12.0),
        (at(101.0, 14.0, 86.0), 8.5),
        (at(95.0, 6.0, 86.0), 5.5),
    ];
    bends.windows(2).map(|pair| Solid::rod(pair[0].0, pair[1].0, [pair[0].1, pair[1].1])).collect()
}

fn intestine() -> Vec<Solid> {
    const TURNS: f32 = 5.0;
    const PIECES: u16 = 80;
    let coil = |piece: u16| {
        let t = f32::from(piece) / f32::from(PIECES);
        let (sin, cos) = (TAU * TURNS * t).sin_cos();
        // The radius varies, as in peristalsis.
        let radius = 4.0 + 0.5 * (TAU * 22.0 * t).sin();
        (at(136.0 - 46.0 * t, -15.0 + 11.0 * cos, 82.0 + 12.0 * sin), radius)
    };
    let mut path = vec![(at(95.0, 6.0, 86.0), 3.6), (at(104.0, 3.0, 97.0), 3.6), (at(126.0, 0.0, 98.0), 3.6)];
    path.extend((0..=PIECES).map(coil));
    path.extend([(at(80.0, -2.0, 84.0), 6.0), (at(56.0, 0.0, 76.0), 4.0)]);
    path.windows(2).map(|pair| Solid::rod(pair[0].0, pair[1].0, [pair[0].1, pair[1].1])).collect()
}

fn eyes() -> Vec<Solid> {
    SIDES.map(|s| Solid::ball(at(197.0, s * 21.5, 53.5), 9.5)).to_vec()
}

/// A bone with a knob at each end.
fn bone(from: Vec3, to: Vec3, radius: f32) -> [Solid; 3] {
    [Solid::rod(from, to, [radius; 2]), Solid::ball(from, 1.55 * radius), Solid::ball(to, 1.55 * radius)]
}

/// The bones of a finger, separated by joints.
fn finger(from: Vec3, to: Vec3) -> [Solid; 3] {
    [(0.06, 0.42), (0.5, 0.7), (0.78, 0.98)].map(|(a, b)| Solid::rod(from.lerp(to, a), from.lerp(to, b), [1.9, 1.5]))
}

fn skeleton() -> Vec<Solid> {
    let mut solids = Vec::new();
    // Vertebrae, each with its spinous process.
    for index in 0..9_u8 {
        let t = f32::from(index) / 8.0;
        let (x, z) = (172.0 - 70.0 * t, 60.0 - 5.0 * (PI * t).sin());
        solids.push(Solid::Ellipsoid { centre: at(x, 0.0, z), radii: vec3(3.5, 4.2, 4.2) });
        solids.push(Solid::rod(at(x, 0.0, z), at(x - 2.0, 0.0, z - 7.0), [1.6, 1.2]));
        let reach = if index == 8 { 15.0 } else { 9.0 + 6.0 * (PI * (0.15 + 0.7 * t)).sin() };
        let thick = if index == 8 { 2.6 } else { 1.5 };
        solids.extend(SIDES.map(|s| Solid::rod(at(x, s * 2.0, z), at(x - 2.0, s * reach, z + 1.5), [1.9, thick])));
    }
    // Urostyle; breastbone; braincase and nose; hip disc.
    solids.extend([
        Solid::rod(at(97.0, 0.0, 60.0), at(60.0, 0.0, 67.0), [2.8, 1.8]),
        Solid::rod(at(168.0, 0.0, 95.0), at(136.0, 0.0, 98.0), [2.0, 3.2]),
        Solid::rod(at(178.0, 0.0, 62.0), at(204.0, 0.0, 64.0), [6.5, 5.0]),
        Solid::rod(at(204.0, 0.0, 64.0), at(219.0, 0.0, 68.0), [5.0, 3.0]),
        Solid::Ellipsoid { centre: at(70.0, 0.0, 77.0), radii: vec3(9.0, 4.0, 8.0) },
    ]);
    // Jaws: arches between the joints.
    for (z, forward, wide, radius) in [(75.0, 29.0, 24.0, 2.4), (87.0, 26.0, 20.5, 2.1)] {
        let arch = |step: u8| {
            let angle = PI * (f32::from(step) / 14.0 - 0.5) * 1.12;
            at(190.0 + forward * angle.cos(), wide * angle.sin(), z)
        };
        solids.extend((0..14).map(|step| Solid::rod(arch(step), arch(step + 1), [radius; 2])));
    }
    for s in SIDES {
        solids.extend([
            // Cheek, palate, nose to jaw.
            Solid::rod(at(181.0, s * 5.0, 63.0), at(184.0, s * 23.0, 75.0), [3.0, 2.4]),
            Solid::rod(at(184.0, s * 23.0, 75.0), at(185.0, s * 20.0, 87.0), [2.2; 2]),
            Solid::rod(at(206.0, s * 4.0, 65.0), at(210.0, s * 17.0, 74.0), [2.2; 2]),
            // Shoulder blade, collar bones.
            Solid::rod(at(164.0, s * 15.0, 61.0), at(161.0, s * 28.0, 75.0), [3.2, 2.6]),
            Solid::rod(at(161.0, s * 28.0, 75.0), at(160.0, s * 24.0, 91.0), [2.6, 2.2]),
            Solid::rod(at(160.0, s * 24.0, 91.0), at(162.0, 0.0, 96.0), [2.2; 2]),
            Solid::rod(at(159.0, s * 24.0, 91.0), at(151.0, 0.0, 98.0), [2.0; 2]),
            // Hip blade, from the last vertebra to the joint.
            Solid::rod(at(101.0, s * 15.0, 61.0), at(74.0, s * 8.0, 74.0), [2.4, 3.2]),
        ]);
        solids.extend(bone(side(HIP, s), side(KNEE, s), 3.0));
        solids.extend(bone(side(KNEE, s) + vec3(-3.0, s * 4.0, 3.0), side(HEEL, s), 2.6));
        solids.extend(bone(side(SHOULDER, s), side(ELBOW, s), 2.7));
        solids.extend(bone(side(ELBOW, s) + vec3(2.0, s * 2.0, 2.0), side(HAND, s), 2.3));
        // The long ankle has two parallel bones.
        let apart = vec3(-1.4, s * 2.5, 0.0);
        solids.extend([-1.0, 1.0].map(|p| Solid::rod(side(HEEL, s) + apart * p, side(SOLE, s) + apart * p, [1.8; 2])));
        solids.extend(TOES.iter().flat_map(|&toe| finger(side(SOLE, s), side(toe, s))));
        solids.extend(FINGERS.iter().flat_map(|&tip| finger(side(HAND, s), side(tip, s))));
    }
    solids
}

/// All tissues, from the outside in: each covers the earlier ones.
struct Anatomy {
    flesh: Layer,
    cavities: Layer,
    /// Stomach, intestine, eyes, skeleton: labels 1 to 4.
    organs: [Layer; 4],
}

impl Anatomy {
    fn new() -> Self {
        Self {
            flesh: Layer::new(9.0, flesh()).and(4.0, digits()),
            cavities: Layer::new(1.0, cavities()),
            organs: [
                Layer::new(4.0, stomach()),
                Layer::new(1.0, intestine()),
                Layer::new(1.0, eyes()),
                Layer::new(2.0, skeleton()),
            ],
        }
    }
}

/// Voxels of the frog, x fastest.
pub(super) fn voxels(dims: [usize; 3]) -> Vec<u8> {
    let grid = Grid::new(dims, SIZE);
    let anatomy = Anatomy::new();
    // Muscle fibres, spots of the skin, folds of the stomach, grain of bone.
    let waves = [
        Wave::new(&grid, [0.35, 0.16, 0.1], 0.3),
        Wave::new(&grid, [-0.12, 0.42, 0.2], 1.1),
        Wave::new(&grid, [0.17, -0.13, 0.05], 2.0),
        Wave::new(&grid, [0.11, 0.19, -0.08], 0.7),
        Wave::new(&grid, [1.1, 0.35, -0.3], 0.0),
        Wave::new(&grid, [0.3, 0.7, 0.75], 0.0),
    ];
    let [width, height, _] = dims;
    let mut voxels = vec![0; dims.iter().product()];
    voxels.par_chunks_mut(width * height).enumerate().for_each_init(
        || ([(); 6].map(|()| Slice::new(&grid)), [(); 6].map(|()| vec![0.0; width]), vec![0.0; width]),
        |(slices, textures, row), (z, out)| {
            let [skin, holes, organs @ ..] = slices;
            skin.fill(&anatomy.flesh, &grid, z);
            holes.fill(&anatomy.cavities, &grid, z);
            organs.iter_mut().zip(&anatomy.organs).for_each(|(slice, layer)| slice.fill(layer, &grid, z));
            for (y, out) in out.chunks_mut(width).enumerate() {
                let seed = grain_row(y, z);
                for (x, value) in row.iter_mut().enumerate() {
                    *value = f32::from(*AIR.end()) * 0.8 * grain(x, seed);
                }
                // All organs, even the eyes, are near flesh.
                if !skin.row(y).0.is_empty() {
                    let place = [grid.at[1][y], grid.at[2][z]];
                    waves.iter().zip(&mut *textures).for_each(|(wave, row)| wave.row(place[0], place[1], row));
                    paint(row, [&*skin, &*holes], organs, y, grid.edge, textures, seed);
                }
                store(row, out);
            }
        },
    );
    voxels
}

fn paint(
    row: &mut [f32],
    [skin, holes]: [&Slice; 2],
    organs: &[Slice],
    y: usize,
    edge: f32,
    waves: &[Vec<f32>],
    seed: u32,
) {
    let (span, near) = skin.row(y);
    let start = span.start;
    lay(&mut row[span], near, edge, &FLESH, |index, distance| {
        let x = start + index;
        // Skin is a bright rind with dark spots; a dark seam separates it from the muscle.
        let depth = -distance;
        let spots = waves[2][x] * waves[3][x];
        let muscle = 0.55 * waves[0][x] * waves[1][x] - 0.25;
        let rind = if depth < 3.0 { if spots > 0.25 { 0.1 } else { 0.75 } } else { muscle };
        let seam = if (depth - 4.2).abs() < 1.2 { -0.9 } else { rind };
        seam + 0.3 * (grain(x, !seed) - 0.5)
    });
    let (span, near) = holes.row(y);
    let start = span.start;
    lay(&mut row[span], near, edge, &AIR, |index, _| grain(start + index, seed));
    let (span, near) = organs[0].row(y);
    let start = span.start;
    lay(&mut row[span], near, edge, &STOMACH, |index, distance| {
        // A folded wall around the content.
        let x = start + index;
        if distance > -3.5 { 0.35 + 0.5 * waves[4][x] } else { -0.5 + 0.4 * waves[5][x] }
    });
    let (span, near) = organs[1].row(y);
    let start = span.start;
    lay(&mut row[span], near, edge, &INTESTINE, |index, distance| {
        let x = start + index;
        if distance > -2.0 { 0.4 + 0.5 * waves[4][x] * waves[5][x] } else { -0.6 + 0.3 * grain(x, seed) }
    });
    let (span, near) = organs[2].row(y);
    lay(&mut row[span], near, edge, &EYES, |_, distance| if distance > -2.5 { -0.6 } else { 0.6 });
    let (span, near) = organs[3].row(y);
    let start = span.start;
    lay(&mut row[span], near, edge, &SKELETON, |index, distance| {
        // Dense outside, marrow inside.
        let x = start + index;
        let shell = if distance > -1.8 { 0.5 } else { -0.5 };
        shell + 0.3 * waves[5][x] * waves[4][x] + 0.2 * (grain(x, !seed) - 0.5)
    });
}

/// Labels of the frog as in [`LABELS`], x fastest: the predominant organ of each voxel.
pub(super) fn labels(dims: [usize; 3]) -> Vec<u8> {
    let grid = Grid::new(dims, SIZE);
    let anatomy = Anatomy::new();
    let [width, height, _] = dims;
    let mut labels = vec![0; dims.iter().product()];
    labels.par_chunks_mut(width * height).enumerate().for_each_init(
        || Slice::new(&grid),
        |slice, (z, out)| {
            for (label, layer) in (1..).zip(&anatomy.organs) {
                slice.fill(layer, &grid, z);
                for (y, out) in out.chunks_mut(width).enumerate() {
                    let (span, near) = slice.row(y);
                    out[span]
                        .iter_mut()
                        .zip(near)
                        .filter(|(_, distance)| **distance < 0.0)
                        .for_each(|(out, _)| *out = label);
                }
            }
        },
    );
    labels
}
