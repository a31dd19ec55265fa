//! The largest connected part of a body.

use super::sample::Thinned;
use crate::number::count;

/// Smallest and largest index of the voxels of the volume around the largest connected part of `body`, if other parts
/// are left out by this box.
pub(super) fn largest_part(thinned: &Thinned, body: &[bool], dims: [usize; 3]) -> Option<[[usize; 3]; 2]> {
    /// Fraction of the voxels of the body above which parts outside the box are worth a crop.
    const WORTH: f64 = 0.002;
    /// Fraction of the largest part above which the others are no table: both feet, for instance.
    const BODY: f64 = 0.25;
    let mut part = vec![0_u32; body.len()];
    let (mut number, mut best, mut all) = (0, (0, 0), 0);
    let mut open = Vec::new();
    for place in 0..body.len() {
        if !body[place] || part[place] > 0 {
            continue;
        }
        number += 1;
        part[place] = number;
        open.push(place);
        let mut size = 0;
        while let Some(place) = open.pop() {
            size += 1;
            for next in thinned.neighbours(place) {
                if body[next] && part[next] == 0 {
                    part[next] = number;
                    open.push(next);
                }
            }
        }
        all += size;
        best = best.max((size, number));
    }
    let [mut low, mut high] = [[usize::MAX; 3], [0; 3]];
    for place in (0..part.len()).filter(|&place| best.0 > 0 && part[place] == best.1) {
        for (axis, index) in thinned.position(place).into_iter().enumerate() {
            low[axis] = low[axis].min(index);
            high[axis] = high[axis].max(index);
        }
    }
    let is_outside = |place: &usize| {
        let position = thinned.position(*place);
        body[*place] && (0..3).any(|axis| position[axis] < low[axis] || position[axis] > high[axis])
    };
    let outside = (0..body.len()).filter(is_outside).count();
    if best.0 == 0 || count(outside) < WORTH * count(all) || count(outside) > BODY * count(best.0) {
        return None;
    }
    let low = std::array::from_fn(|axis| (low[axis] * thinned.stride[axis]).saturating_sub(thinned.stride[axis]));
    let high = std::array::from_fn(|axis| ((high[axis] + 1) * thinned.stride[axis]).min(dims[axis] - 1));
    (0..3).all(|axis| dims[axis] == 1 || low[axis] < high[axis]).then_some([low, high])
}
