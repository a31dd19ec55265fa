//! Effect of a step through a medium of one density.

use super::samples::Step;
use relume_base::number::Real;
use smallvec::SmallVec;

/// Sets `step` to the effect of a medium of this density over a `length`, in steps: α = 1 − e^(−τ·length), and the
/// scattered light times α/τ. Component c of each `components` numbers of the source has opacity c, or the only one.
pub fn across<R: Real>(density: &Step<R>, length: R, components: usize, step: &mut Step<R>) {
    step.opacity.clear();
    step.opacity.extend(density.opacity.iter().map(|&depth| -(-(depth * length)).exp_m1()));
    let gain = |(&depth, &opacity): (&R, &R)| {
        if depth > R::default() && length > R::default() { opacity / depth } else { length }
    };
    let mut gains: SmallVec<[R; 8]> = density.opacity.iter().zip(&step.opacity).map(gain).collect();
    if gains.len() > 1 {
        gains.resize(components, length);
    }
    let close = |density: &[R], source: &mut Vec<R>| {
        source.clear();
        source.extend(density.iter().zip(gains.iter().cycle()).map(|(&lit, &gain)| lit * gain));
    };
    close(&density.source, &mut step.source);
    step.others.resize_with(density.others.len(), Vec::new);
    density.others.iter().zip(&mut step.others).for_each(|(density, other)| close(density, other));
}
