//! Windows of a file that show nothing of its values.

use rayon::prelude::*;

use super::{Volume, Voxel, Window, with_voxels};
use crate::number::brief;

/// Voxels per parallel task.
const CHUNK: usize = 1 << 20;

impl Volume {
    /// Leaves out the windows that tell none of the values apart, with a note: programs that know no window write the range of a
    /// byte. Such a window holds no value, or none but the smallest, which is that of the surroundings.
    pub(super) fn leave_out_windows(&mut self) {
        // A part of the slices does not have all values.
        if self.presets.windows.is_empty() || self.part.is_some() {
            return;
        }
        let [least, most] = match self.value_range() {
            Some(range) => range,
            None => return,
        };
        let windows = std::mem::take(&mut self.presets.windows);
        let (shown, beside): (Vec<Window>, Vec<Window>) =
            windows.into_iter().partition(|window| self.is_shown(window, [least, most]));
        self.presets.windows = shown;
        for Window { name, low, high } in beside {
            let [low, high, least, most] = [low, high, least, most].map(brief);
            self.notes.push(format!(
                "{}: the window {name:?} from {low} to {high} is not used: the values, from {least} to {most}, lie beside it",
                self.source
            ));
        }
    }

    /// The smallest and the largest finite value; `None` without one.
    fn value_range(&self) -> Option<[f64; 2]> {
        let [least, most] = match &self.bricks {
            Some(cache) => [cache.measured().extent.min, cache.measured().extent.max],
            None => with_voxels!(&self.voxels, stored => range(stored)),
        };
        let [one, other] = [least, most].map(|stored| stored.mul_add(self.slope, self.intercept));
        (least <= most).then_some([one.min(other), one.max(other)])
    }

    /// Whether a window holds values, and others than the `least`, unless this is the only one.
    fn is_shown(&self, window: &Window, [least, most]: [f64; 2]) -> bool {
        if window.high < least || window.low > most {
            return false;
        }
        if least >= most || window.high >= most || self.bricks.is_some() {
            return true;
        }
        let value = |stored: f64| stored.mul_add(self.slope, self.intercept);
        let is_in = |value: f64| value > least && window.low <= value && value <= window.high;
        with_voxels!(&self.voxels, stored => stored.iter().any(|voxel| is_in(value(voxel.to_f64()))))
    }
}

/// The smallest and the largest finite stored number; the first is the larger one if there are none.
fn range<T: Voxel>(stored: &[T]) -> [f64; 2] {
    let nothing = [f64::INFINITY, f64::NEG_INFINITY];
    let join = |[least, most]: [f64; 2], other: [f64; 2]| [least.min(other[0]), most.max(other[1])];
    let of_chunk = |chunk: &[T]| {
        let finite = chunk.iter().map(|voxel| voxel.to_f64()).filter(|value| value.is_finite());
        finite.fold(nothing, |range, value| join(range, [value; 2]))
    };
    stored.par_chunks(CHUNK).map(of_chunk).reduce(|| nothing, join)
}
