//! Phantoms: their formulas, and properties that scenes rely on.
#![expect(clippy::cast_precision_loss, reason = "counts are small")]

use std::ops::RangeInclusive;

use relume::volume::phantom::{self, Phantom, engine, frog};
use relume::volume::{Volume, VolumeError, Voxels};

fn bytes(volume: &Volume) -> &[u8] {
    let Voxels::U8(voxels) = &volume.voxels else { panic!("{} is of bytes", volume.source) };
    voxels
}

fn count(volume: &Volume, values: &RangeInclusive<u8>) -> usize {
    bytes(volume).iter().filter(|value| values.contains(value)).count()
}

#[test]
fn every_phantom_is_found_by_its_name() {
    for phantom in Phantom::ALL {
        assert_eq!(phantom.to_string().parse::<Phantom>().unwrap(), phantom);
        let small = Volume::phantom(phantom, Some([5, 4, 3])).unwrap();
        assert_eq!((small.geometry.dims, small.voxels.len()), ([5, 4, 3], 60), "{phantom}");
        assert_eq!(small.source, phantom.name());
        let one = Volume::phantom(phantom, Some([1, 1, 1])).unwrap();
        assert!(one.value([0; 3]).unwrap().is_finite(), "{phantom} of one voxel");
    }
    let error = "toad".parse::<Phantom>().unwrap_err();
    assert!(matches!(error, VolumeError::UnknownPhantom { .. }), "{error}");
    assert!(error.to_string().contains("toad") && error.to_string().contains("marschner_lobb"), "{error}");
    assert!(matches!(Volume::phantom(Phantom::Frog, Some([4, 0, 4])), Err(VolumeError::Dims { .. })), "no voxel");
}

fn close(volume: &Volume, index: [usize; 3], expected: f64) {
    let value = volume.value(index).unwrap();
    assert!((value - expected).abs() <= 1e-6, "{} at {index:?}: {value}, not {expected}", volume.source);
}

#[test]
fn closed_forms_have_the_values_that_can_be_worked_out_by_hand() {
    assert_eq!(bytes(&phantom::slab([2, 3, 4], 9).unwrap()), [9; 24]);

    let gaussian = phantom::gaussian([5, 5, 5]).unwrap();
    close(&gaussian, [2, 2, 2], 1.0);
    // r = ½: exp(−¼ / 0.32).
    close(&gaussian, [3, 2, 2], 0.457_833_36);

    // Four crests from the centre to a face; a trough lies an eighth further.
    let shells = phantom::shells([17, 1, 1]).unwrap();
    for (x, expected) in [(8, 1.0), (9, 0.0), (10, 1.0), (16, 1.0), (0, 1.0)] {
        close(&shells, [x, 0, 0], expected);
    }

    // On the axis ρ = cos 12π = 1: (1 − sin(πz/2) + ½) / 2.5.
    let signal = phantom::marschner_lobb([3, 3, 3]).unwrap();
    for (z, expected) in [(0, 1.0), (1, 0.6), (2, 0.2)] {
        close(&signal, [1, 1, z], expected);
    }
    // At r = 1 the inner cosine is 0, and ρ = 1 again.
    close(&signal, [2, 1, 1], 0.6);
    // At r = 2/3 the inner cosine is ½: ρ = cos 6π = 1; at r = √2 it is −0.605700.
    close(&phantom::marschner_lobb([7, 3, 3]).unwrap(), [5, 1, 1], 0.6);
    let ripple = (12.0 * std::f64::consts::PI * (std::f64::consts::PI / 2_f64.sqrt()).cos()).cos();
    close(&signal, [0, 0, 1], (1.0 + 0.25 * (1.0 + ripple)) / 2.5);
}

#[test]
fn the_frog_is_made_of_all_its_tissues() {
    let volume = Volume::phantom(Phantom::Frog, None).unwrap();
    assert_eq!(volume.geometry.dims, [250, 235, 138]);
    // Lower limits: the trunk alone, 4π/3 · 56 · 36 · 30; a stomach 25 across and 60 long minus its edges; and so on.
    for (name, values, least) in [
        ("air", frog::AIR, 4_000_000),
        ("flesh", frog::FLESH, 250_000),
        ("stomach", frog::STOMACH, 10_000),
        ("intestine", frog::INTESTINE, 10_000),
        ("eyes", frog::EYES, 5_000),
        ("skeleton", frog::SKELETON, 20_000),
    ] {
        assert!(count(&volume, &values) >= least, "{name}: {}", count(&volume, &values));
    }
}

#[test]
fn the_engine_is_made_of_all_its_parts() {
    let volume = Volume::phantom(Phantom::Engine, None).unwrap();
    assert_eq!(volume.geometry.dims, [250, 235, 138]);
    for (name, values, least) in [
        ("smoke", engine::SMOKE, 3_000_000),
        ("block", engine::BLOCK, 800_000),
        ("liners", engine::LINERS, 50_000),
        ("pistons", engine::PISTONS, 50_000),
        ("guides", engine::GUIDES, 3_000),
        ("steel", engine::STEEL, 50_000),
    ] {
        assert!(count(&volume, &values) >= least, "{name}: {}", count(&volume, &values));
    }
    // Unlike clean air, smoke has many values.
    let values: std::collections::BTreeSet<u8> = bytes(&volume)[..250 * 235].iter().copied().collect();
    assert!(values.len() > 16, "{values:?}");
}

#[test]
fn ranges_are_apart() {
    let frog = [frog::AIR, frog::FLESH, frog::STOMACH, frog::INTESTINE, frog::EYES, frog::SKELETON];
    let engine = [engine::SMOKE, engine::BLOCK, engine::LINERS, engine::PISTONS, engine::GUIDES, engine::STEEL];
    for ranges in [frog, engine] {
        assert!(ranges.windows(2).all(|pair| pair[0].end() + 10 < *pair[1].start()), "{ranges:?}");
    }
}

#[test]
fn labels_name_the_tissue_a_voxel_is_made_of() {
    let (volume, labels) = (Volume::phantom(Phantom::Frog, None).unwrap(), Volume::frog_labels(None).unwrap());
    assert_eq!(labels.geometry, volume.geometry);
    let ranges = [frog::STOMACH, frog::INTESTINE, frog::EYES, frog::SKELETON];
    for (label, values) in (1_u8..).zip(&ranges) {
        let pairs = bytes(&labels).iter().zip(bytes(&volume)).filter(|(found, _)| **found == label);
        let (inside, all) =
            pairs.fold((0, 0), |(inside, all), (_, value)| (inside + usize::from(values.contains(value)), all + 1));
        // The rest are edges, where a voxel is partly another tissue.
        assert!(all > 0 && 3 * inside > all, "{}: {inside} of {all}", frog::LABELS[usize::from(label)]);
    }
    assert_eq!(bytes(&labels).iter().max(), Some(&4));
}

#[test]
fn another_size_keeps_the_shape() {
    // Every tissue fills the same part of the box at half the size, up to its edges.
    let share = |dims| {
        let volume = Volume::frog_labels(dims).unwrap();
        let all = bytes(&volume).len();
        [1, 2, 3, 4].map(|label| count(&volume, &(label..=label)) as f64 / all as f64)
    };
    let (full, half) = (share(None), share(Some([125, 117, 69])));
    for (a, b) in full.iter().zip(half) {
        assert!((a - b).abs() <= 0.1 * a, "{full:?} {half:?}");
    }
}

#[test]
fn a_phantom_is_the_same_every_time() {
    for phantom in Phantom::ALL {
        let dims = Some([60, 50, 40]);
        let [one, other] = [(); 2].map(|()| Volume::phantom(phantom, dims).unwrap());
        assert_eq!(one.voxels.bytes(), other.voxels.bytes(), "{phantom}");
    }
}
