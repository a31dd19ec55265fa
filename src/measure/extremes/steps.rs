//! Steps from a thousandth of a voxel to longer than the volume, and a million of them.

use super::bound::ROUNDING_UNIT;
use super::left::worst;
use super::slab::{GREEN, Slab};
use super::{Bound, Extreme, ExtremeError, Group, Rung};
use crate::measure::rungs::RungError;
use crate::reference::ReferenceError;

pub(super) fn extremes() -> Vec<Extreme> {
    let mut all: Vec<Extreme> = [
        ("1e-3 of a voxel", 1e-3, Bound::equal_steps(8000.0)),
        ("longer than the volume, with its midpoint inside", 15.0, Bound::march(1.0)),
        ("longer than the volume, with its midpoint outside", 17.0, Bound::EXACT),
        ("a million volumes long", 8e6, Bound::EXACT),
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
    let bound = Bound::equal_steps(STEPS);
    let deep = |depth: f64| Bound::deep_steps(STEPS, depth);
    all.extend([
        equal_steps("grey", 1.0, 1.0, bound),
        equal_steps("grey", 5.0, 1.0, bound),
        equal_steps("grey", 20.0, 1.0, deep(20.0)),
        equal_steps("coloured", 1.0, 0.5, bound),
        equal_steps("coloured", 5.0, 0.5, deep(5.0)),
    ]);
    all.push(million_steps());
    let picture = || Slab { step: 1e-7, ..Slab::default() }.picture();
    all.push(Extreme::refused(Group::Steps, "more steps than a ray's limit", picture, |error| {
        matches!(error, ExtremeError::Rung(RungError::Reference(ReferenceError::TooManySamples { .. })))
    }));
    all
}

/// More steps than one dispatch marches.
const STEPS: f64 = 1e5;

/// A hundred voxels of optical `depth`, of which the fraction `scattered` scatters and the rest absorbs.
fn equal_steps(colour: &str, depth: f64, scattered: f64, bound: Bound) -> Extreme {
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
        bound,
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
    /// Rounding units lost by a million sums below 2⁻⁶, each by half their spacing, relative to a sum of 0.0098.
    const ROUNDINGS: f64 = 0.0475 / ROUNDING_UNIT;
    let bound = Bound::rounded(
        "a million thin steps",
        ROUNDINGS + 1e3,
        "each sum below 2⁻⁶ has an error of at most 2⁻⁷ roundings of 1, in f32 4.7 % of a term if all have one sign; the \
         error of the transmittance is smaller, in f32 at most the whole depth of 0.01; and √n roundings",
    );
    let name = "1e6 steps so thin that 1 - opacity rounds to 1";
    Extreme::shown(
        Group::Steps,
        name,
        bound,
        move || Ok(vec![asked.picture()?]),
        move |lefts| worst(lefts.iter().map(|left| slab.error(left))),
    )
}
