//! Rounding of finished accumulators to the storage format. Twin of `shaders/store.wgsl`.

use half::f16;

use crate::StoreAs;
use crate::plan::{ScenePlan, Transmittance};
use relume_base::number::Real;

/// Rounds the accumulators and transmittance of a pixel to the plan's storage format. Grey transmittance is not
/// rounded.
pub fn store<R: Real>(plan: &ScenePlan, sums: &mut [R], transmittance: &mut [R]) {
    if plan.storage == StoreAs::Single {
        return;
    }
    let transmittance = match plan.transmittance {
        Transmittance::Grey => &mut [],
        Transmittance::Coloured | Transmittance::Mixed => transmittance,
    };
    for number in sums.iter_mut().chain(transmittance) {
        *number = R::from_f64(f16::from_f64(number.to_f64()).to_f64());
    }
}
