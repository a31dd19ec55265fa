//! A three-cylinder engine of cast and bored parts, surrounded by smoke.
//!
//! The crankshaft lies along x and the cylinders along y, with the heads towards −y; the exhaust ports face −z. Lengths
//! are voxels of 250×235×138.

use std::f32::consts::TAU;
use std::ops::RangeInclusive;

use glam::{Vec3, vec3};
use rayon::prelude::*;

use super::field::{Grid, Layer, Slice, Solid, Wave, grain, grain_row, lay, store};

/// Default number of voxels; also the box in which the engine is designed.
pub const DIMS: [usize; 3] = [250, 235, 138];

/// Values of the smoke around and inside the engine: noise.
pub const SMOKE: RangeInclusive<u8> = 0..=40;
/// Values of the cast block, head and pan.
pub const BLOCK: RangeInclusive<u8> = 88..=112;
/// Values of the cylinder liners.
pub const LINERS: RangeInclusive<u8> = 128..=148;
/// Values of the pistons.
pub const PISTONS: RangeInclusive<u8> = 162..=182;
/// Values of the valve guides.
pub const GUIDES: RangeInclusive<u8> = 196..=212;
/// Values of the steel parts: valves, springs, rods, shafts.
pub const STEEL: RangeInclusive<u8> = 228..=250;

const SIZE: [f32; 3] = [250.0, 235.0, 138.0];
/// z of the plane through the cylinder axes.
const MIDDLE: f32 = 69.0;
/// x of the cylinder axes.
const CYLINDERS: [f32; 3] = [58.0, 123.0, 188.0];
const BORE: f32 = 27.0;
/// y of the crankshaft; `THROW` is the radius of its cranks, `ROD` the length of the connecting rods.
const CRANK: f32 = 186.0;
const THROW: f32 = 20.0;
const ROD: f32 = 62.0;
const VALVES: [f32; 2] = [-13.0, 13.0];

fn block(x: f32, y: f32, z: f32, half: [f32; 3], rounding: f32) -> Solid {
    Solid::Block { centre: vec3(x, y, z), half: Vec3::from_array(half), rounding }
}

fn cylinder(axis: usize, x: f32, y: f32, z: f32, radius: f32, half: f32) -> Solid {
    Solid::Cylinder { axis, centre: vec3(x, y, z), radius, half }
}

fn pipe(axis: usize, x: f32, y: f32, z: f32, radius: f32, wall: f32, half: f32) -> Solid {
    Solid::Pipe { axis, centre: vec3(x, y, z), radius, wall, half }
}

/// Crank pin and piston pin of each cylinder.
fn pins() -> [[Vec3; 2]; 3] {
    let mut turn = -1.0;
    CYLINDERS.map(|x| {
        turn += 1.0;
        let (sin, cos) = (TAU * (turn / 3.0 + 0.03)).sin_cos();
        let crank = vec3(x, CRANK - THROW * cos, MIDDLE + THROW * sin);
        let rise = (ROD * ROD - (THROW * sin).powi(2)).sqrt();
        [crank, vec3(x, crank.y - rise, MIDDLE)]
    })
}

/// Bolt holes in the rail of the pan and in the head.
fn bolts() -> impl Iterator<Item = Solid> {
    let rail = (0..6_u8)
        .flat_map(|i| [-43.0, 43.0].map(|z| cylinder(1, 24.0 + 40.0 * f32::from(i), 166.0, MIDDLE + z, 3.2, 12.0)));
    let head = (0..4_u8)
        .flat_map(|i| [-29.0, 29.0].map(|z| cylinder(1, 25.5 + 65.0 * f32::from(i), 52.0, MIDDLE + z, 3.4, 30.0)));
    rail.chain(head)
}

fn casting() -> Vec<Solid> {
    let mut solids = vec![
        block(123.0, 122.0, MIDDLE, [102.0, 46.0, 38.0], 6.0),
        block(123.0, 58.0, MIDDLE, [102.0, 17.0, 36.0], 4.0),
        block(123.0, 34.0, MIDDLE, [95.0, 13.0, 23.0], 8.0),
        block(123.0, 77.0, MIDDLE, [106.0, 3.5, 42.0], 1.5),
        block(123.0, 166.0, MIDDLE, [112.0, 4.5, 50.0], 2.0),
        block(123.0, 194.0, MIDDLE, [99.0, 29.0, 40.0], 9.0),
        // Bell housing, pulley, oil filler.
        cylinder(0, 234.0, CRANK - 6.0, MIDDLE, 46.0, 11.0),
        cylinder(0, 11.0, CRANK, MIDDLE, 25.0, 6.0),
        cylinder(1, 208.0, 20.0, MIDDLE, 8.0, 9.0),
    ];
    for x in CYLINDERS {
        // Exhaust and intake ports, core plugs.
        solids.push(cylinder(2, x, 58.0, 28.0, 12.5, 15.0));
        solids.push(cylinder(2, x, 58.0, 110.0, 11.0, 12.0));
        solids.push(cylinder(2, x, 122.0, 30.0, 12.0, 5.0));
    }
    solids.extend((0..8_u8).map(|i| block(28.0 + 27.2 * f32::from(i), 122.0, 30.0, [2.2, 42.0, 5.0], 2.0)));
    solids
}

fn hollows() -> Vec<Solid> {
    let mut solids = vec![
        // Rocker chamber, crank chamber, bell, grooves of the pulley.
        block(123.0, 36.0, MIDDLE, [89.0, 10.0, 17.0], 4.0),
        block(123.0, 189.0, MIDDLE, [92.0, 29.0, 34.0], 6.0),
        cylinder(0, 236.0, CRANK - 6.0, MIDDLE, 40.0, 10.0),
        pipe(0, 11.0, CRANK, MIDDLE, 25.0, 3.0, 1.5),
        pipe(0, 11.0, CRANK, MIDDLE, 14.0, 4.0, 7.0),
    ];
    for x in CYLINDERS {
        solids.push(cylinder(1, x, 115.0, MIDDLE, BORE + 1.0, 50.0));
        // Water jacket, ports, recesses of the plugs.
        solids.push(pipe(1, x, 112.0, MIDDLE, BORE + 5.4, 1.8, 26.0));
        solids.push(cylinder(2, x, 58.0, 32.0, 8.0, 22.0));
        solids.push(cylinder(2, x, 58.0, 106.0, 7.0, 20.0));
        solids.push(cylinder(2, x, 122.0, 25.0, 8.5, 4.0));
    }
    solids.extend(bolts());
    solids
}

fn liners() -> Vec<Solid> {
    CYLINDERS.map(|x| pipe(1, x, 117.0, MIDDLE, BORE + 1.6, 2.0, 43.0)).to_vec()
}

fn pistons() -> Vec<Solid> {
    // A crown of three lands on a narrower body, with a hollow skirt.
    let piston = |[_, pin]: [Vec3; 2]| {
        let land = |up: f32, half: f32| cylinder(1, pin.x, pin.y - up, pin.z, BORE - 1.2, half);
        let body = cylinder(1, pin.x, pin.y - 8.0, pin.z, BORE - 4.0, 5.0);
        [
            land(12.0, 1.8),
            land(7.5, 1.2),
            land(3.5, 1.2),
            body,
            pipe(1, pin.x, pin.y + 4.0, pin.z, BORE - 3.4, 2.2, 8.5),
        ]
    };
    pins().into_iter().flat_map(piston).collect()
}

/// x of the valve stems.
fn valves() -> impl Iterator<Item = f32> {
    CYLINDERS.into_iter().flat_map(|x| VALVES.map(|beside| x + beside))
}

fn guides() -> Vec<Solid> {
    valves().map(|x| pipe(1, x, 55.0, MIDDLE, 4.2, 1.5, 10.0)).collect()
}

fn steel() -> Vec<Solid> {
    let mut solids = vec![
        // Crankshaft ends, camshaft.
        cylinder(0, 25.0, CRANK, MIDDLE, 8.0, 21.0),
        cylinder(0, 224.0, CRANK, MIDDLE, 8.0, 17.0),
        cylinder(0, 236.0, CRANK, MIDDLE, 33.0, 4.0),
        cylinder(0, 123.0, 31.0, MIDDLE, 3.4, 92.0),
    ];
    for [crank, pin] in pins() {
        solids.extend([
            Solid::rod(pin, crank, [3.4, 4.6]),
            pipe(0, crank.x, crank.y, crank.z, 8.5, 2.0, 4.5),
            pipe(0, pin.x, pin.y, pin.z, 5.2, 1.8, 4.5),
            cylinder(0, crank.x, crank.y, crank.z, 6.5, 10.0),
            cylinder(2, pin.x, pin.y, pin.z, 4.0, BORE - 6.0),
        ]);
        for beside in [-12.5, 12.5] {
            // Webs, with counterweights opposite the pin; journals between them.
            let centre = vec3(crank.x + beside, CRANK, MIDDLE);
            let arm = vec3(0.0, crank.y - CRANK, crank.z - MIDDLE);
            solids.push(cylinder(0, centre.x, CRANK + 0.45 * arm.y, MIDDLE + 0.45 * arm.z, 17.0, 2.6));
            solids.push(cylinder(0, centre.x, CRANK - 0.35 * arm.y, MIDDLE - 0.35 * arm.z, 19.0, 2.6));
            solids.push(cylinder(0, centre.x + 1.6 * beside, CRANK, MIDDLE, 8.0, 20.0));
        }
    }
    for (index, x) in (0_u8..).zip(valves()) {
        let open = if index % 2 == 0 { 0.0 } else { 3.0 };
        solids.extend([
            Solid::rod(vec3(x, 34.0, MIDDLE), vec3(x, 72.0 + open, MIDDLE), [2.2; 2]),
            Solid::Ellipsoid { centre: vec3(x, 73.0 + open, MIDDLE), radii: vec3(11.0, 3.0, 11.0) },
            Solid::Ellipsoid { centre: vec3(x, 32.5, MIDDLE), radii: vec3(3.5, 5.0, 5.0) },
        ]);
        let coil = |step: u8| {
            let t = f32::from(step) / 36.0;
            let (sin, cos) = (TAU * 3.5 * t).sin_cos();
            vec3(x + 7.0 * cos, 35.0 + 11.0 * t, MIDDLE + 7.0 * sin)
        };
        solids.extend((0..36).map(|step| Solid::rod(coil(step), coil(step + 1), [1.2; 2])));
    }
    solids
}

/// Voxels of the engine, x fastest.
pub(super) fn voxels(dims: [usize; 3]) -> Vec<u8> {
    let grid = Grid::new(dims, SIZE);
    let (casting, hollows) = (Layer::new(3.0, casting()), Layer::new(0.5, hollows()));
    let parts = [
        (LINERS, Layer::new(0.5, liners())),
        (PISTONS, Layer::new(0.5, pistons())),
        (GUIDES, Layer::new(0.5, guides())),
        (STEEL, Layer::new(1.5, steel())),
    ];
    // Low frequencies for the smoke, a high frequency for the metal.
    let waves = [
        Wave::new(&grid, [0.045, 0.061, 0.037], 0.4),
        Wave::new(&grid, [-0.072, 0.038, 0.081], 1.7),
        Wave::new(&grid, [0.131, -0.097, 0.12], 0.2),
        Wave::new(&grid, [0.17, 0.12, 0.14], 0.0),
    ];
    let [width, height, _] = dims;
    let mut voxels = vec![0; dims.iter().product()];
    voxels.par_chunks_mut(width * height).enumerate().for_each_init(
        || ([(); 6].map(|()| Slice::new(&grid)), [(); 4].map(|()| vec![0.0; width]), vec![0.0; width]),
        |(slices, textures, row), (z, out)| {
            let [cast, hollow, inner @ ..] = slices;
            cast.fill(&casting, &grid, z);
            hollow.fill(&hollows, &grid, z);
            inner.iter_mut().zip(&parts).for_each(|(slice, (_, layer))| slice.fill(layer, &grid, z));
            for (y, out) in out.chunks_mut(width).enumerate() {
                let seed = grain_row(y, z);
                let place = [grid.at[1][y], grid.at[2][z]];
                waves.iter().zip(&mut *textures).for_each(|(wave, row)| wave.row(place[0], place[1], row));
                let smoke = |x: usize| {
                    let swell = 0.6 * textures[0][x] * textures[1][x] + 0.3 * textures[2][x];
                    0.4 * swell + 0.7 * (grain(x, seed) - 0.5) - 0.25
                };
                let (low, high) = (f32::from(*SMOKE.start()), f32::from(*SMOKE.end()));
                for (x, value) in row.iter_mut().enumerate() {
                    *value = low + (high - low) * (0.5 + 0.5 * smoke(x));
                }
                let metal = |x: usize| 0.6 * textures[3][x] + 0.5 * (grain(x, !seed) - 0.5);
                let (span, near) = cast.row(y);
                let start = span.start;
                lay(&mut row[span], near, grid.edge, &BLOCK, |index, _| metal(start + index));
                let (span, near) = hollow.row(y);
                let start = span.start;
                lay(&mut row[span], near, grid.edge, &SMOKE, |index, _| smoke(start + index));
                for (slice, (values, _)) in inner.iter().zip(&parts) {
                    let (span, near) = slice.row(y);
                    let start = span.start;
                    lay(&mut row[span], near, grid.edge, values, |index, _| metal(start + index));
                }
                store(row, out);
            }
        },
    );
    voxels
}
