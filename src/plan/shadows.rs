//! Shadows that a plan cannot have.

use super::{MOST_SHADOWED, PlanError, Planned, Transmittance, coloured};
use crate::scene::Scene;

/// Refuses shadows in coloured media, and of too many lights.
pub(super) fn check(planned: &Planned, scene: &Scene) -> Result<(), PlanError> {
    let Some(shadows) = planned.plan.shadows else { return Ok(()) };
    let casting = scene.lights.iter().find(|light| light.shadows);
    let setting = casting.map_or_else(
        || "shadows.ambient = \"occluded\"".to_owned(),
        |light| format!("lights.{}.shadows = true", light.name),
    );
    let refused = |why: String| Err(PlanError::NoShadows { setting: setting.clone(), why });
    if planned.plan.transmittance != Transmittance::Grey {
        return refused(format!("the absorption of {} is coloured, and shadows are grey", coloured(scene)));
    }
    let directions = shadows.grid_lights();
    if directions > MOST_SHADOWED {
        return refused(format!(
            "light with shadows comes from {directions} directions, and at most {MOST_SHADOWED} are possible"
        ));
    }
    Ok(())
}
