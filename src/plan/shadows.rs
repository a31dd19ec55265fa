//! Shadows that a plan cannot have.

use super::{MOST_SHADOWED, PlanError, Planned, Transmittance, coloured};
use crate::scene::{Placement, Scene};

/// Refuses shadows of lights without a direction of their own, in coloured media, and of too many lights.
pub(super) fn check(planned: &Planned, scene: &Scene) -> Result<(), PlanError> {
    let Some(light) = scene.lights.iter().find(|light| light.shadows) else { return Ok(()) };
    let refused = |light: &str, why: String| Err(PlanError::NoShadows { light: light.to_owned(), why });
    let undirected = scene.lights.iter().find_map(|light| {
        let kind = match light.placement {
            Placement::Headlight | Placement::Directional(_) | Placement::ThreePoint => return None,
            Placement::Ambient => "ambient",
            Placement::Point(_) => "point",
        };
        light.shadows.then_some((light, kind))
    });
    if let Some((light, kind)) = undirected {
        let why = format!("it is {kind}; only directional lights, three-point lights and headlights cast shadows");
        return refused(&light.name, why);
    }
    let Some(shadows) = planned.plan.shadows else { return Ok(()) };
    if planned.plan.transmittance != Transmittance::Grey {
        let why = format!("the absorption of {} is coloured, and shadows are grey", coloured(scene));
        return refused(&light.name, why);
    }
    let directions = shadows.directions();
    if directions > MOST_SHADOWED {
        let why =
            format!("light with shadows comes from {directions} directions, and at most {MOST_SHADOWED} are possible");
        return refused(&light.name, why);
    }
    Ok(())
}
