//! Steps from a thousandth of a voxel to longer than the volume, and a million of them.

use super::left::worst;
use super::slab::{GREEN, Slab};
use super::{Bound, Extreme, Group, Rung};

pub(super) fn extremes() -> Vec<Extreme> {
    let mut all: Vec<Extreme> = [
        ("1e-3 of a voxel", 1e-3, Bound::equal_steps(8000.0)),
        ("longer than the volume, its middle inside", 15.0, Bound::march(1.0)),
        ("longer than the volume, its middle outside", 17.0, Bound::EXACT),
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
    for depth in [1.0, 5.0] {
        all.push(equal_steps("grey", depth, None));
        all.push(equal_steps("coloured", depth, Some((GREEN, 0.5 * depth / 100.0))));
    }
    all.push(million_steps());
    all
}

/// A hundred thousand: more than one dispatch takes.
fn equal_steps(name: &str, depth: f64, absorption: Option<(&'static str, f64)>) -> Extreme {
    const STEPS: f64 = 1e5;
    let slab = Slab {
        dims: [3, 3, 101],
        opacity: -(-depth / 100.0).exp_m1(),
        absorption,
        step: 1e-3,
        accuracy: "k = 4".to_owned(),
        ..Slab::default()
    };
    let asked = slab.clone();
    let name = format!("1e5 equal steps, {name}, depth {depth}");
    Extreme::shown(
        Group::Steps,
        name,
        Bound::equal_steps(STEPS),
        move || Ok(vec![asked.picture()?]),
        move |lefts| {
            worst(lefts.iter().map(|left| {
                let whole = left.rung == Rung::Gpu && left.dispatches < 2;
                if whole { f64::NAN } else { slab.error(left) }
            }))
        },
    )
}

/// A step's opacity is 1e-8, below 2⁻²⁵: 1 − α rounds to 1, and so does T − T·α. What a step adds is not lost.
fn million_steps() -> Extreme {
    let slab = Slab { dims: [1, 1, 2], opacity: 1e-2, step: 1e-6, ..Slab::default() };
    let asked = slab.clone();
    let bound = Bound::equal_steps(1e6).and(
        0.0475,
        "a million thin steps",
        "what passes is off by the whole depth of 0.01 at most; each sum below 2⁻⁶ rounds by 2⁻³¹ at most, 4.7 % of a \
         term, were they all to round one way",
    );
    let name = "1e6 steps so thin that 1 - opacity is 1";
    Extreme::shown(
        Group::Steps,
        name,
        bound,
        move || Ok(vec![asked.picture()?]),
        move |lefts| worst(lefts.iter().map(|left| slab.error(left))),
    )
}
