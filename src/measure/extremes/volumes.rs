//! Volumes of one voxel, a line, a sheet and one value; voxels of extreme values, NaN and infinities.

use glam::DVec3;

use super::left::{Left, worst};
use super::slab::{Picture, Slab, scene_of, volume};
use super::{Bound, Extreme, ExtremeError, Group};
use crate::rungs::RungError;
use relume_scene::{Aim, Shading};
use relume_volume::{VolumeError, Voxels};

/// Makes four voxels of two values.
type Filled = fn([f64; 2]) -> Voxels;

pub(super) fn extremes() -> Vec<Extreme> {
    let mut all = vec![
        along("1×1×1", Slab { dims: [1, 1, 1], opacity: 0.3, ..Slab::default() }),
        along("1×1×2048, along it", Slab { dims: [1, 1, 2048], opacity: 1e-3, ..Slab::default() }),
        along("2048×1×1, across it", Slab { dims: [2048, 1, 1], opacity: 0.25, ..Slab::default() }),
        along("2048×2048×1, across it", Slab { dims: [2048, 2048, 1], opacity: 0.25, ..Slab::default() }),
        sheet(),
        flat(),
    ];
    let (least, most) = (f32::from_bits(1), f32::MIN_POSITIVE);
    let values: [(&str, [f64; 2], Filled); 13] = [
        ("int32, the whole range", [f64::from(i32::MIN), f64::from(i32::MAX)], whole),
        ("uint64, the whole range", [0.0, 64.0_f64.exp2()], |_| Voxels::U64(vec![0, 0, u64::MAX, u64::MAX])),
        ("float32 of ±1e30", [-1e30, 1e30], single),
        ("float32 from 1e-30 to 1e30", [1e-30, 1e30], single),
        ("float32 of ±1e-30", [-1e-30, 1e-30], single),
        ("float32 of ±3.4e38", [f64::from(f32::MIN), f64::from(f32::MAX)], single),
        ("float64 of ±1.8e308", [f64::MIN, f64::MAX], double),
        ("denormal float32", [f64::from(least), f64::from(most) / 2.0], single),
        ("denormal float64", [0.0, 1e-310], double),
        ("NaN counts as the smallest", [1.0, 2.0], |_| Voxels::F32(vec![1.0, f32::NAN, 2.0, 2.0])),
        ("−inf counts as the smallest", [1.0, 2.0], |_| Voxels::F32(vec![1.0, f32::NEG_INFINITY, 2.0, 2.0])),
        ("inf counts as the largest", [1.0, 2.0], |_| Voxels::F32(vec![1.0, 1.0, f32::INFINITY, 2.0])),
        ("one finite number among NaN and ±inf", [2.0, 2.0], |_| {
            Voxels::F64(vec![f64::NAN, f64::NEG_INFINITY, 2.0, 2.0])
        }),
    ];
    all.extend(values.map(|(name, ends, voxels)| two_values(name, ends, voxels, "nearest")));
    all.push(two_values("denormal float64, interpolated", [0.0, 1e-310], double, "linear"));
    all.extend(["unshaded", "shaded"].map(broken));
    all.push(nothing_finite());
    all
}

fn along(name: &str, slab: Slab) -> Extreme {
    let asked = slab.clone();
    let bound = if slab.samples() > 1000.0 { Bound::equal_steps(slab.samples()) } else { Bound::march(slab.samples()) };
    Extreme::shown(
        Group::Volumes,
        format!("a volume of {name}"),
        bound,
        move || Ok(vec![asked.picture()?]),
        move |lefts| worst(lefts.iter().map(|left| slab.error(left))),
    )
}

/// Edge-on sheet: 2047 voxels deep and one thick.
fn sheet() -> Extreme {
    let slab = Slab { dims: [2048, 2048, 1], opacity: 1e-3, ..Slab::default() };
    let asked = slab.clone();
    let scene = move || -> Result<Vec<Picture>, ExtremeError> {
        let mut scene = asked.scene()?;
        let position = DVec3::new(-10.0, 1000.25, 0.125);
        scene.camera.aim = Aim::LookAt { position, target: position + DVec3::X };
        Ok(vec![Picture::of(scene)])
    };
    Extreme::shown(
        Group::Volumes,
        "a volume of 2048×2048×1, along it",
        Bound::equal_steps(2047.0),
        scene,
        move |lefts| worst(lefts.iter().map(|left| slab.error_at(left, 0, 2047.0))),
    )
}

/// A uniform volume has no gradient: only the ambient part of the shading remains.
fn flat() -> Extreme {
    const AMBIENT: f64 = 0.25;
    let scene = || -> Result<Vec<Picture>, ExtremeError> {
        let mut scene = Slab::default().scene()?;
        scene.shading = Shading::Gradient;
        for material in &mut scene.materials {
            (material.ambient, material.specular) = (AMBIENT, 0.5);
        }
        Ok(vec![Picture::of(scene)])
    };
    Extreme::shown(Group::Volumes, "a volume of one value has no highlights", Bound::march(8.0), scene, |lefts| {
        worst(lefts.iter().flat_map(|left| {
            let ambient = AMBIENT * (1.0 - 0.9_f64.powi(8));
            [(left.weight(0, 0) / ambient - 1.0).abs(), left.weight(1, 0).abs()]
        }))
    })
}

fn whole([low, high]: [f64; 2]) -> Voxels {
    #[expect(clippy::cast_possible_truncation, reason = "the ends of the type")]
    let [low, high] = [low as i32, high as i32];
    Voxels::I32(vec![low, low, high, high])
}

fn single([low, high]: [f64; 2]) -> Voxels {
    #[expect(clippy::cast_possible_truncation, reason = "numbers that f32 represents, or nearly")]
    let [low, high] = [low as f32, high as f32];
    Voxels::F32(vec![low, low, high, high])
}

fn double([low, high]: [f64; 2]) -> Voxels {
    Voxels::F64(vec![low, low, high, high])
}

/// Two invisible voxels of the lower end, then two visible ones of the upper end. With steps of half a voxel, three of the
/// six samples are visible, by either interpolation.
fn two_values(name: &str, ends: [f64; 2], voxels: Filled, interpolation: &'static str) -> Extreme {
    const OPACITY: f64 = 0.3;
    let [low, high] = ends;
    // Halves first, because the span may overflow.
    let middle = 0.5 * low + 0.5 * high;
    // With a single value, the interval starts at that value.
    let first = if low < high { middle } else { low };
    let scene = move || -> Result<Vec<Picture>, ExtremeError> {
        let text = format!(
            r#"
            shading = "none"
            [materials.only]
            reflectance = 0.5
            [transfer]
            opacity_length = 1
            [[transfer.intervals]]
            material = "only"
            range = [{first:e}, {:e}]
            opacity = {OPACITY}
            [lights.l]
            spectrum = "D65"
            [accuracy]
            step = 0.5
            termination = 0
            interpolation = "{interpolation}"
            "#,
            f64::MAX
        );
        Ok(vec![Picture::of(scene_of(&text, volume([1, 1, 4], voxels(ends))?)?)])
    };
    // With a single value, all four voxels are visible.
    let length = if low < high { 1.5 } else { 3.0 };
    Extreme::shown(Group::Volumes, format!("voxels: {name}"), Bound::march(6.0), scene, move |lefts| {
        let slab = Slab { opacity: OPACITY, ..Slab::default() };
        worst(lefts.iter().map(|left| slab.error_at(left, 0, length)))
    })
}

/// Compares whole pictures of a volume with NaN and ±inf and of one with the smallest and largest values in their
/// place.
fn broken(shading: &'static str) -> Extreme {
    const DIMS: [usize; 3] = [16, 16, 16];
    let scene = move |replaced: [f32; 3]| -> Result<Picture, ExtremeError> {
        // Values from 0 to 990, with large differences between neighbours.
        let value = |i: usize| f32::from(u16::try_from(i * 37 % 991).unwrap_or(0));
        let mut voxels: Vec<f32> = (0..DIMS.iter().product()).map(value).collect();
        for (i, voxel) in voxels.iter_mut().enumerate().skip(5).step_by(97) {
            *voxel = replaced[i % 3];
        }
        let shading = if shading == "shaded" { "gradient" } else { "none" };
        let text = format!(
            r#"
            shading = "{shading}"
            [materials.low]
            reflectance = "foliage"
            [materials.high]
            reflectance = "orange"
            [transfer]
            opacity_length = 1
            opacity = [[0, 0.02], [990, 0.2]]
            material = [[0, "low"], [990, "high"]]
            [lights.l]
            spectrum = "D65"
            "#
        );
        let mut scene = scene_of(&text, volume(DIMS, Voxels::F32(voxels))?)?;
        let position = DVec3::new(-20.0, -11.0, -31.0);
        scene.camera.aim = Aim::LookAt { position, target: DVec3::splat(7.5) };
        scene.camera.projection = relume_scene::Projection::Orthographic { height: Some(16.0) };
        Ok(Picture { size: [12, 9], ..Picture::of(scene) })
    };
    let both = move || Ok(vec![scene([f32::NAN, f32::INFINITY, f32::NEG_INFINITY])?, scene([0.0, 990.0, 0.0])?]);
    Extreme::shown(
        Group::Volumes,
        format!("NaN and ±inf become the ends of the finite range, {shading}"),
        Bound::EXACT,
        both,
        |lefts| match lefts {
            [broken, mended] if mended.sums.accumulators.iter().any(|&weight| weight > 0.0) => {
                Left::apart(broken, mended)
            }
            _ => f64::NAN,
        },
    )
}

/// A volume of NaN only.
fn nothing_finite() -> Extreme {
    let scene = || {
        let slab = Slab { dims: [2, 2, 2], ..Slab::default() };
        let mut scene = slab.scene()?;
        scene.set_volume(std::sync::Arc::new(volume([2, 2, 2], Voxels::F32(vec![f32::NAN; 8]))?));
        Ok(Picture::of(scene))
    };
    Extreme::refused(Group::Volumes, "voxels: only NaN", scene, |error| {
        matches!(error, ExtremeError::Rung(RungError::Volume(VolumeError::NothingFinite { .. })))
    })
}
