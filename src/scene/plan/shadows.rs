//! Shadows that a plan cannot have.

use super::{MOST_SHADOWED, PlanError, Planned, Transmittance, coloured};
use crate::{Placement, Scene, SceneLight};
use relume_base::number::{brief, readable};
use relume_colour::model::{ModelKind, Order};

/// Refuses shadows of an evenly bright sky in coloured media or within a space of the light grid, models without a depth per
/// component, and too many depths.
pub(super) fn check(planned: &Planned, scene: &Scene) -> Result<(), PlanError> {
    let light = &planned.plan.light;
    if !light.is_dimmed() {
        return Ok(());
    }
    // Scattered light casts the shadows of all lights.
    let of_orders = || "scattering.orders = \"multiple\"".to_owned();
    let of_light = |light: &SceneLight| {
        if light.shadows { format!("lights.{}.shadows = true", light.name) } else { of_orders() }
    };
    let of_shares = || "shadows.ambient = \"occluded\"".to_owned();
    let mut casting = scene.lights.iter().filter(|light| light.shadows || scene.scatters_often());
    let setting = casting.clone().next().map_or_else(of_shares, of_light);
    let refused = |setting: String, why: String| Err(PlanError::NoShadows { setting, why });
    if planned.plan.transmittance != Transmittance::Grey {
        let coloured = coloured(scene);
        if light.sky().is_some() {
            let sky = casting.find(|light| light.placement == Placement::Ambient);
            let why = format!(
                "the absorption of {coloured} is coloured, and the light of a sky is dimmed in grey media only"
            );
            return refused(sky.map_or_else(of_shares, of_light), why);
        }
        let model = scene.accuracy.model;
        if matches!(model, ModelKind::Peercy | ModelKind::Sharpened(Order::Step)) {
            let why = format!(
                "the absorption of {coloured} is coloured, and the model {model} has no optical depth for each of its numbers; take another model"
            );
            return refused(setting, why);
        }
    }
    // The number that is told is rounded.
    let is_short = |&reach: &f64| light.sky().is_some() && reach < (1.0 - 1e-6) * scene.least_reach();
    if let Some(reach) = scene.shadows.reach.filter(is_short) {
        let why = format!(
            "shadows start {} voxels from a sample, and the light grid has a node every {} voxels, so that it holds no shade nearer than {}; set at least this, or a smaller shadows.start or shadows.spacing",
            readable(scene.shadow_start()),
            readable(scene.shadows.spacing),
            brief(scene.least_reach())
        );
        return refused(format!("shadows.reach = {}", readable(reach)), why);
    }
    let (directions, depths) = (light.grid_lights(), light.grid_depths());
    if depths > MOST_SHADOWED {
        let why = match light.absorbers {
            0 => format!(
                "light with shadows comes from {directions} directions, and at most {MOST_SHADOWED} are possible"
            ),
            absorbers => format!(
                "light with shadows comes from {directions} directions through {absorbers} coloured absorber{}, which needs {depths} depths per node of the light grid, and at most {MOST_SHADOWED} are possible",
                if absorbers == 1 { "" } else { "s" }
            ),
        };
        return refused(setting, why);
    }
    Ok(())
}
