//! Steps from a thousandth of a voxel to longer than the volume, and a million of them.

use super::left::worst;
use super::slab::{GREEN, Slab};
use super::{Bound, Extreme, ExtremeError, Group, Rung};
use crate::rungs::RungError;
use relume_scene::reference::ReferenceError;

pub(super) fn extremes() -> Vec<Extreme> {
    let mut all: Vec<Extreme> = [
        ("1e-3 of a voxel", 1e-3, Bound::compensated(1.0)),
        ("longer than the volume", 8.5, Bound::march(1.0)),
        ("a million volumes long", 8e6, Bound::march(1.0)),
        ("that is cut by the far face", 3.0, Bound::march(3.0)),
        ("of which a hundredth is inside", 7.99, Bound::march(2.0)),
    ]
    .into_iter()
    .map(|(name, step, bound)| {
        let slab = Slab { step, ..Slab::default() };
        let asked = slab.clone();
        Extreme::shown(
            Group::Steps,
            format!("a step {name}"),
            bound,
            move || Ok(vec![asked.picture()?]),
            move |lefts| worst(lefts.iter().map(|left| slab.error(left))),
        )
    })
    .collect();
    for depth in [1e-3, 0.1, 1.0, 5.0, 20.0] {
        all.push(equal_steps("grey", depth, 1.0));
    }
    all.extend([equal_steps("coloured", 1.0, 0.5), equal_steps("coloured", 5.0, 0.5)]);
    all.push(million_steps());
    let picture = || Slab { step: 1e-7, ..Slab::default() }.picture();
    all.push(Extreme::refused(Group::Steps, "more steps than a ray's limit", picture, |error| {
        matches!(error, ExtremeError::Rung(RungError::Reference(ReferenceError::TooManySamples { .. })))
    }));
    all
}

/// 1e5 steps, more than one dispatch marches, through a hundred voxels of optical `depth`, of which the fraction `scattered` scatters and the rest absorbs.
fn equal_steps(colour: &str, depth: f64, scattered: f64) -> Extreme {
    let along = depth / 100.0;
    let slab = Slab {
        dims: [3, 3, 101],
        opacity: -(-scattered * along).exp_m1(),
        absorption: (scattered < 1.0).then_some((GREEN, (1.0 - scattered) * along)),
        step: 1e-3,
        accuracy: if scattered < 1.0 { "k = 4".to_owned() } else { String::new() },
        ..Slab::default()
    };
    let asked = slab.clone();
    let name = format!("1e5 equal steps, {colour}, depth {depth}");
    Extreme::shown(
        Group::Steps,
        name,
        Bound::compensated(depth),
        move || Ok(vec![asked.picture()?]),
        move |lefts| {
            worst(lefts.iter().map(|left| {
                let in_one_go = left.rung == Rung::Gpu && left.dispatches < 2;
                // Without absorption, scattered and transmitted light add up to 1.
                let whole =
                    if scattered < 1.0 { 0.0 } else { (left.weight(0, 0) + left.transmittance(0, 0) - 1.0).abs() };
                if in_one_go { f64::NAN } else { slab.error(left).max(whole) }
            }))
        },
    )
}

/// A step's opacity is 1e-8, below 2⁻²⁵: 1 − α rounds to 1, and so does T − T·α. The contribution of a step is not
/// lost.
fn million_steps() -> Extreme {
    let slab = Slab { dims: [1, 1, 2], opacity: 1e-2, step: 1e-6, ..Slab::default() };
    let asked = slab.clone();
    let name = "1e6 steps so thin that 1 - opacity rounds to 1";
    Extreme::shown(
        Group::Steps,
        name,
        Bound::compensated(0.01),
        move || Ok(vec![asked.picture()?]),
        move |lefts| worst(lefts.iter().map(|left| slab.error(left))),
    )
}
