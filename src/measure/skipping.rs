//! Macrocells that the truth may leave out.

use relume_base::number::{count, whole};
use relume_scene::Scene;
use relume_scene::tables::{Cells, LabelMap, Occupancy, Storage};

/// Number of values across the data range at which the transfer function is evaluated, besides its bends.
const PLACES: usize = 1 << 16;

/// Occupancy of the macrocells of `scene`: whether its transfer function or a label scatters or absorbs there. All of them, if it has
/// further fields.
#[must_use]
pub fn occupancy(scene: &Scene, storage: &Storage, labels: Option<&LabelMap>) -> Occupancy {
    let active = if scene.fields.further().is_empty() { visible(scene, storage.domain) } else { vec![true; 2] };
    Cells::new(scene.volume(), storage, labels).occupancy(&active)
}

/// Whether `scene` scatters or absorbs, at values from the lowest to the highest; also at both values around a bend, if
/// it does so at the bend or right beside it, and beyond, where the extreme value of a ray is seen.
fn visible(scene: &Scene, [low, high]: [f64; 2]) -> Vec<bool> {
    let last = count(PLACES - 1);
    let shows = |value: f64| {
        let medium = scene.transfer.medium(value, scene.materials.len());
        medium.scattering.iter().chain(&medium.absorption).any(|&depth| depth > 0.0)
    };
    let mut active: Vec<bool> = (0..PLACES).map(|i| shows((high - low).mul_add(count(i) / last, low))).collect();
    for bend in scene.transfer.bends().into_iter().filter(|bend| (low..=high).contains(bend)) {
        if [bend.next_down(), bend, bend.next_up()].into_iter().any(shows) {
            let place = whole((bend - low) / (high - low) * last);
            active[place] = true;
            active[(place + 1).min(PLACES - 1)] = true;
        }
    }
    scene.blending.widen(&mut active);
    active
}
