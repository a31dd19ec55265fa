//! A volume that exceeds the memory: generated slice by slice, made into bricks, rendered, and compared with its formula.
//!
//! `tests/program/out_of_core.rs` runs the same with a small volume.

use std::error::Error;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde::Serialize;
use serde_json::Value;

use relume::output::FilmFile;

/// Width and height of the picture.
const SIZE: [u16; 2] = [72, 54];
/// Opacity of a voxel with the value [`HIGHEST`].
const OPACITY: f64 = 0.4;
/// Upper end of the ramp of the transfer function; no value exceeds it.
const HIGHEST: f64 = 254.0;
/// Steps of the integral over a voxel.
const FINE: f64 = 4.0;
/// Largest change of a value: rounding to whole numbers, and interpolation between voxels, h²/8 times the second derivatives
/// of the formula: 80 (2π/61)²/8 of the waves and far less of the ellipsoid.
const CHANGE: f64 = 0.5 + 0.12;
/// Error that the march may add: its steps of one voxel against a quarter, the entries of the transfer table, f32, and the end of
/// rays at a transmittance of 1e-3 (`accuracy.termination`).
const MARCH: f64 = 2.5e-3;

/// The picture against the formula, and what it took.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct OutOfCore {
    /// Voxels along each axis, of one byte.
    pub(crate) dims: [usize; 3],
    /// Memory of host and device, in bytes.
    pub(crate) memory: [u64; 2],
    /// Bytes of the bricks in their file.
    pub(crate) file_bytes: u64,
    /// Largest memory of `relume bricks` and of `relume render`, in bytes (`VmHWM`).
    pub(crate) peak: [f64; 2],
    /// Largest memory of `relume render` of a volume of a few voxels.
    pub(crate) beside: f64,
    /// Seconds to make the bricks and to render.
    pub(crate) seconds: [f64; 2],
    /// Bytes of voxels that `relume bricks` takes a second of its CPU time.
    pub(crate) bytes_a_second: f64,
    /// Bricks with visible voxels.
    pub(crate) visible: u64,
    /// Bricks that the device and the host loaded and loaded again.
    pub(crate) loaded: [u64; 4],
    /// Largest distance of a transmittance from those that the formula allows.
    pub(crate) outside: f64,
    /// Largest difference from the formula.
    pub(crate) largest: f64,
    /// Smallest and largest transmittance of the formula.
    pub(crate) range: [f64; 2],
}

impl OutOfCore {
    /// Volume of `mib` MiB, and the memory for it: an eighth on the host, and two thirds of that on the device, at most 512 MiB.
    pub(crate) fn sizes(mib: u16) -> ([usize; 3], [u64; 2]) {
        let side = if mib < 2048 { 1024 } else { 2048 };
        let host = u64::from(mib) << 17;
        ([side, side, (usize::from(mib) << 20) / (side * side)], [host, (host / 3 * 2).min(512 << 20)])
    }

    /// Whether the picture is that of the formula.
    pub(crate) fn is_true(&self) -> bool {
        self.outside <= MARCH && self.range[0] < 0.5 && self.range[1] > 0.95
    }

    /// Bytes of host and device that the render may take beside what a volume of a few voxels takes.
    pub(crate) fn allowed(&self) -> f64 {
        1.25 * self.memory.iter().map(|&bytes| float(bytes)).sum::<f64>()
    }
}

/// The row as text.
pub(crate) fn text(row: &OutOfCore) -> String {
    let mib = |bytes: f64| bytes / float(1 << 20);
    let [x, y, z] = row.dims;
    let [host, device] = row.memory.map(|bytes| mib(float(bytes)));
    let [making, rendering] = row.peak.map(mib);
    let [on_device, on_device_again, read, read_again] = row.loaded;
    format!(
        "{x}×{y}×{z} bytes, {:.0} MiB in bricks; memory {host:.0} MiB on the host, {device:.0} MiB on the device\n\
         bricks: {:.1} s, {:.0} MB of voxels a second of CPU time, at most {making:.0} MiB resident\n\
         render: {:.1} s, at most {rendering:.0} MiB resident, {:.0} MiB of them with a small volume; allowed beside it {:.0}\n\
         {on_device} bricks on the device, {on_device_again} again, of {} visible ones; {read} read from the file, {read_again} again\n\
         transmittance {:.3} to {:.3}: off the formula by at most {:.5}, outside its bounds by {:.5}, allowed {MARCH}\n",
        mib(float(row.file_bytes)),
        row.seconds[0],
        row.bytes_a_second / 1e6,
        row.seconds[1],
        mib(row.beside),
        mib(row.allowed()),
        row.visible,
        row.range[0],
        row.range[1],
        row.largest,
        row.outside
    )
}

#[expect(clippy::cast_precision_loss, reason = "counts of voxels and bytes")]
fn float(number: u64) -> f64 {
    number as f64
}

fn coordinate(index: usize) -> f64 {
    float(index as u64)
}

/// An ellipsoid, brighter inside, with waves.
struct Formula {
    dims: [usize; 3],
}

impl Formula {
    /// Parts of the formula along an axis: of the ellipsoid, and the waves.
    fn along(&self, axis: usize, at: f64) -> [f64; 2] {
        let half = (coordinate(self.dims[axis]) - 1.0) / 2.0;
        let from_centre = (at - half) / (0.96 * half);
        let wave = match axis {
            0 => 40.0 * (std::f64::consts::TAU * at / 61.0).sin(),
            1 => 40.0 * (std::f64::consts::TAU * at / 67.0 + 1.0).sin(),
            _ => 0.0,
        };
        [from_centre * from_centre, wave]
    }

    /// The value at a place in voxels.
    fn at(&self, place: [f64; 3]) -> f64 {
        let parts = [0, 1, 2].map(|axis| self.along(axis, place[axis]));
        let inside = 1.0 - parts.iter().map(|part| part[0]).sum::<f64>();
        inside.max(0.0) * (170.0 + parts.iter().map(|part| part[1]).sum::<f64>())
    }

    /// Writes the voxels to `path`, slice by slice.
    fn write(&self, path: &Path) -> io::Result<()> {
        let table = |axis: usize| -> Vec<[f32; 2]> {
            #[expect(clippy::cast_possible_truncation, reason = "rounded to whole numbers later")]
            let narrow = |part: f64| part as f32;
            (0..self.dims[axis]).map(|at| self.along(axis, coordinate(at)).map(narrow)).collect()
        };
        let [xs, ys, zs] = [table(0), table(1), table(2)];
        let mut out = BufWriter::new(File::create(path)?);
        let mut row = vec![0_u8; xs.len()];
        for z in zs {
            for y in &ys {
                let (rest, wave) = (1.0 - y[0] - z[0], 170.0 + y[1]);
                for (voxel, x) in row.iter_mut().zip(&xs) {
                    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to 250")]
                    let rounded = ((rest - x[0]).max(0.0) * (wave + x[1]) + 0.5) as u8;
                    *voxel = rounded;
                }
                out.write_all(&row)?;
            }
        }
        out.flush()
    }

    /// Position of the eye and its target.
    fn camera(&self) -> [[f64; 3]; 2] {
        let half = self.dims.map(|n| (coordinate(n) - 1.0) / 2.0);
        [[half[0] * 0.4, -half[1] * 0.5, -2.6 * half[2]], half]
    }

    /// Transmittances along the ray of pixel `[x, y]` with values lower by [`CHANGE`], as they are, and higher.
    fn transmittances(&self, [x, y]: [u16; 2], opacity_length: f64) -> [f64; 3] {
        let [eye, target] = self.camera();
        let normalised = |v: [f64; 3]| {
            let length = v.iter().map(|part| part * part).sum::<f64>().sqrt();
            v.map(|part| part / length)
        };
        let cross = |a: [f64; 3], b: [f64; 3]| {
            [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        };
        let forward = normalised([0, 1, 2].map(|axis| target[axis] - eye[axis]));
        let right = normalised(cross(forward, [0.0, -1.0, 0.0]));
        let up = cross(right, forward);
        let tangent = 15_f64.to_radians().tan();
        let [width, height] = SIZE.map(f64::from);
        let across = (2.0 * (f64::from(x) + 0.5) / width - 1.0) * tangent * width / height;
        let above = (1.0 - 2.0 * (f64::from(y) + 0.5) / height) * tangent;
        let ray = normalised([0, 1, 2].map(|axis| forward[axis] + across * right[axis] + above * up[axis]));
        // Steps from the eye to behind the volume, of which only those in the box count.
        let length: f64 = 2.0 * eye.iter().zip(target).map(|(e, t)| (e - t) * (e - t)).sum::<f64>().sqrt();
        let mut depths = [0.0; 3];
        let mut at = 0.0;
        while at < length {
            let place = [0, 1, 2].map(|axis| eye[axis] + at * ray[axis]);
            if place.iter().zip(self.dims).all(|(&place, n)| (0.0..=coordinate(n) - 1.0).contains(&place)) {
                let value = self.at(place);
                for (depth, change) in depths.iter_mut().zip([-CHANGE, 0.0, CHANGE]) {
                    // Outside of the ellipsoid all voxels are 0.
                    let value = if value > 0.0 { (value + change).max(0.0) } else { 0.0 };
                    *depth -= (1.0 - OPACITY * value / HIGHEST).ln() / (FINE * opacity_length);
                }
            }
            at += 1.0 / FINE;
        }
        depths.map(|depth| (-depth).exp())
    }

    fn opacity_length(&self) -> f64 {
        // A ray through the middle has an optical depth of about 1.
        coordinate(self.dims[2]) * 0.25
    }

    fn scene(&self, file: &str) -> String {
        let [[px, py, pz], [tx, ty, tz]] = self.camera();
        format!(
            "version = 1\nshading = \"none\"\n[volume]\nfile = \"{file}\"\n[materials.grey]\nreflectance = \"white 9.5\"\n\
             [transfer]\nopacity_length = {:?}\nintervals = [{{ material = \"grey\", range = [{HIGHEST:?}, 300.0], \
             ramp = {HIGHEST:?}, opacity = {OPACITY:?} }}]\n[lights.day]\nspectrum = \"D65\"\nkind = \"ambient\"\n[camera]\n\
             fov = 30\nup = [0, -1, 0]\nposition = [{px:?}, {py:?}, {pz:?}]\ntarget = [{tx:?}, {ty:?}, {tz:?}]\n[accuracy]\n\
             interpolation = \"exact_linear\"\ntermination = 1e-3\n",
            self.opacity_length()
        )
    }
}

/// A run of the program in `folder`: the JSON of its result.
fn run(program: &Path, folder: &Path, arguments: &[&str]) -> Result<Value, Box<dyn Error>> {
    let output = Command::new(program).args(arguments).arg("--json").current_dir(folder).output()?;
    if !output.status.success() {
        return Err(format!("{arguments:?}: {}", String::from_utf8_lossy(&output.stderr)).into());
    }
    Ok(serde_json::from_slice(&output.stdout)?)
}

/// Interrupts `relume bricks` in the middle of its work, which must leave nothing.
#[cfg(unix)]
fn interrupted(program: &Path, folder: &Path, arguments: &[&str], after: Duration) -> Result<(), Box<dyn Error>> {
    let mut child = Command::new(program).args(arguments).current_dir(folder).stderr(Stdio::null()).spawn()?;
    let begun = Instant::now();
    // The temporary file shows that it writes.
    let is_writing = || -> io::Result<bool> {
        let mut names = std::fs::read_dir(folder)?.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
        Ok(names.any(|name| name.ends_with(".part")))
    };
    while !is_writing()? && begun.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(2));
    }
    std::thread::sleep(after);
    let pid = child.id().to_string();
    Command::new("kill").args(["-INT", &pid]).status()?;
    let code = child.wait()?.code();
    if code != Some(130) || is_writing()? || folder.join("volume.bricks").exists() {
        return Err(format!("interrupted with code {code:?}, and left a file").into());
    }
    Ok(())
}

/// Generates a volume of `dims` voxels in `folder`, makes bricks of it, once interrupted `after` some time, and renders it
/// with `memory` bytes on the host and on the device.
pub(crate) fn out_of_core(
    program: &Path,
    folder: &Path,
    dims: [usize; 3],
    memory: [u64; 2],
    after: Duration,
) -> Result<OutOfCore, Box<dyn Error>> {
    let formula = Formula { dims };
    formula.write(&folder.join("volume.raw"))?;
    std::fs::write(folder.join("scene.toml"), formula.scene("volume.bricks"))?;
    let size = dims.map(|n| n.to_string()).join("x");
    let [host, device] = memory.map(|bytes| bytes.to_string());
    let layout = ["--dims", &size, "--type", "uint8"];
    let bricks = [&["bricks", "volume.raw", "-o", "volume.bricks", "--memory", &host], &layout[..]].concat();
    #[cfg(unix)]
    interrupted(program, folder, &bricks, after)?;
    let clock = Instant::now();
    let made = run(program, folder, &bricks)?;
    let making = clock.elapsed().as_secs_f64();
    // The source is not needed any more.
    std::fs::remove_file(folder.join("volume.raw"))?;
    let picture = SIZE.map(|side| side.to_string()).join("x");
    let common = ["render", "scene.toml", "--size", &picture, "--device-memory", &device];
    let small = ["--volume", "small.raw", "--dims", "4x4x4", "--type", "uint8", "-o", "small.png"];
    std::fs::write(folder.join("small.raw"), [9; 64])?;
    let beside = run(program, folder, &[&common[..], &small].concat())?;
    let clock = Instant::now();
    let rendered = run(program, folder, &[&common[..], &["--memory", &host, "--accumulators", "film.exr"]].concat())?;
    let rendering = clock.elapsed().as_secs_f64();
    let film = FilmFile::read(&folder.join("film.exr"))?;
    let peak = |json: &Value| json["peak_mb"].as_f64().map_or(f64::NAN, |peak| 1e6 * peak);
    let counts = |of: &str, key: &str| rendered["march"][of][key].as_u64().ok_or(format!("no {key} of {of}"));
    let mut row = OutOfCore {
        dims,
        memory,
        file_bytes: made["bytes"].as_u64().unwrap_or(0),
        peak: [peak(&made), peak(&rendered)],
        beside: peak(&beside),
        seconds: [making, rendering],
        bytes_a_second: made["times"]["bricks"]["cpu_ms"]
            .as_f64()
            .map_or(f64::NAN, |ms| 1e3 * dims.iter().map(|&n| coordinate(n)).product::<f64>() / ms),
        visible: counts("bricks", "visible")?,
        loaded: [
            counts("bricks", "loaded")?,
            counts("bricks", "again")?,
            counts("host_bricks", "loaded")?,
            counts("host_bricks", "again")?,
        ],
        outside: 0.0,
        largest: 0.0,
        range: [1.0, 0.0],
    };
    let pixels = (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| [x, y]));
    for (pixel, &found) in pixels.zip(&film.transmittance) {
        let [most, expected, least] = formula.transmittances(pixel, formula.opacity_length());
        let found = f64::from(found);
        // Not `max`, which drops NaN.
        let outside = if found >= least && found <= most { 0.0 } else { (least - found).max(found - most) };
        row.outside = if outside <= row.outside { row.outside } else { outside };
        let off = (found - expected).abs();
        row.largest = if off <= row.largest { row.largest } else { off };
        row.range = [row.range[0].min(expected), row.range[1].max(expected)];
    }
    Ok(row)
}
