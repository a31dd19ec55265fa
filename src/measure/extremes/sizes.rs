//! Voxels of all sizes and aspect ratios, pictures of one pixel, row or column, and crop boxes of a voxel or less.

use std::sync::Arc;

use glam::DVec3;

use super::bound::ROUNDING_UNIT;
use super::left::worst;
use super::slab::{Picture, Slab, straight_on};
use super::{Bound, Extreme, ExtremeError, Group};
use relume_scene::{Projection, Scene};

pub(super) fn extremes() -> Vec<Extreme> {
    let mut all: Vec<Extreme> = [1e-40, 1e-6, 1e6, 1e35].map(spacing).into();
    all.push(flat_voxels());
    all.extend([[1, 1], [16384, 1], [1, 16384]].map(picture));
    all.extend(
        [("one voxel", 1.0), ("a quarter of a voxel", 0.25), ("a hundredth of a voxel", 0.01)]
            .map(|(name, width)| crop(name, width)),
    );
    all
}

fn with_spacing(scene: &mut Scene, spacing: DVec3) {
    let mut volume = (**scene.volume()).clone();
    volume.geometry.spacing = spacing;
    scene.camera = straight_on(&volume.geometry);
    scene.set_volume(Arc::new(volume));
}

/// All lengths scale with the voxels, which leaves the picture unchanged.
fn spacing(spacing: f64) -> Extreme {
    let slab = Slab::default();
    let asked = slab.clone();
    let scene = move || -> Result<Vec<Picture>, ExtremeError> {
        let mut scene = asked.scene()?;
        with_spacing(&mut scene, DVec3::splat(spacing));
        scene.accuracy.step_length *= spacing;
        scene.transfer.opacity_length *= spacing;
        Ok(vec![Picture::of(scene)])
    };
    Extreme::shown(Group::Sizes, format!("a spacing of {spacing:e}"), Bound::march(8.0), scene, move |lefts| {
        worst(lefts.iter().map(|left| slab.error(left)))
    })
}

/// Voxels a hundred times longer than wide, viewed along the long side and across it.
fn flat_voxels() -> Extreme {
    let slab = Slab { dims: [9, 5, 9], opacity: 0.01, ..Slab::default() };
    let asked = slab.clone();
    let scene = move || -> Result<Vec<Picture>, ExtremeError> {
        let mut scene = asked.scene()?;
        with_spacing(&mut scene, DVec3::new(1.0, 1.0, 100.0));
        let mut across = scene.clone();
        let position = DVec3::new(-10.0, 2.0, 400.0);
        across.camera.aim = relume_scene::Aim::LookAt { position, target: position + DVec3::X };
        Ok(vec![Picture::of(scene), Picture::of(across)])
    };
    Extreme::shown(Group::Sizes, "a spacing of 1:1:100", Bound::march(800.0), scene, move |lefts| {
        worst(lefts.iter().zip([800.0, 8.0]).map(|(left, length)| slab.error_at(left, 0, length)))
    })
}

/// A picture of `size` pixels, all of them equal.
fn picture(size: [usize; 2]) -> Extreme {
    let slab = Slab::default();
    let asked = slab.clone();
    let scene = move || -> Result<Vec<Picture>, ExtremeError> {
        let mut scene = asked.scene()?;
        // Small enough that the widest picture stays within the volume.
        let height = if size[1] > 1 { 2.0 } else { 1e-4 };
        scene.camera.projection = Projection::Orthographic { height: Some(height) };
        Ok(vec![Picture { size, ..Picture::of(scene) }])
    };
    let name = format!("a picture of {}×{}", size[0], size[1]);
    Extreme::shown(Group::Sizes, name, Bound::march(8.0), scene, move |lefts| {
        worst(lefts.iter().flat_map(|left| {
            let slab = &slab;
            (0..size[0] * size[1]).map(move |i| slab.error_at(left, i, slab.length()))
        }))
    })
}

/// A cube of `width` as crop box, whose faces cut steps.
fn crop(name: &str, width: f64) -> Extreme {
    let slab = Slab { dims: [9, 9, 9], opacity: 0.3, step: 0.25, ..Slab::default() };
    let asked = slab.clone();
    let scene = move || -> Result<Vec<Picture>, ExtremeError> {
        let mut scene = asked.scene()?;
        let half = DVec3::splat(0.5 * width);
        let middle = DVec3::new(4.0, 4.0, 3.21);
        scene.crop = Some([middle - half, middle + half]);
        scene.camera.projection = Projection::Orthographic { height: Some(0.5 * width) };
        Ok(vec![Picture::of(scene)])
    };
    // Of 20 units from the eye, the places of both faces along a ray are rounded, and of 9 voxels in the volume.
    let faces = 2.0 * (20.0 + 9.0) * ROUNDING_UNIT / width;
    let bound =
        Bound::march(width / 0.25 + 2.0).and(faces, "march in a crop box", "the places of its faces are rounded");
    Extreme::shown(Group::Sizes, format!("a crop of {name}"), bound, scene, move |lefts| {
        worst(lefts.iter().map(|left| slab.error_at(left, 0, width)))
    })
}
