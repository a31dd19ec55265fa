//! How finished accumulators are stored. `shaders/store.wgsl` is its twin.

use half::f16;

use crate::number::Real;
use crate::plan::{ScenePlan, Transmittance};
use crate::scene::StoreAs;

/// Rounds what a pixel keeps as the plan stores it; one number of what passes stays as it is.
pub fn store<R: Real>(plan: &ScenePlan, sums: &mut [R], passed: &mut [R]) {
    if plan.storage == StoreAs::Single {
        return;
    }
    let passed = match plan.transmittance {
        Transmittance::Grey => &mut [],
        Transmittance::Coloured | Transmittance::Mixed => passed,
    };
    for number in sums.iter_mut().chain(passed) {
        *number = R::from_f64(f16::from_f64(number.to_f64()).to_f64());
    }
}
