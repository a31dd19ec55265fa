//! Scattering that a plan cannot have.

use super::{PlanError, Planned, Transmittance};
use crate::{AccumulateAs, Scene};
use relume_base::number::{brief, readable};
use relume_colour::model::{ModelKind, Order};
use relume_colour::spectrum::wavelength_nm;

/// Largest parameter of a phase function whose deeper orders are gathered as though light scattered evenly.
const NEARLY_EVEN: f64 = 0.3;

/// Refuses models without a spectrum per component, weights, and phase functions whose deeper orders are far from even.
pub(super) fn check(planned: &Planned, scene: &Scene) -> Result<(), PlanError> {
    if planned.plan.light.gathered.is_none() {
        return Ok(());
    }
    let refused = |why: String| Err(PlanError::NoScattering { why });
    if scene.accuracy.accumulate == AccumulateAs::Weights {
        return refused(
            "light that scatters often is a product of many reflectances, which no weights of materials hold; use accumulate = \"auto\""
                .to_owned(),
        );
    }
    let model = scene.accuracy.model;
    let by_step = planned.plan.transmittance != Transmittance::Grey && model == ModelKind::Sharpened(Order::Step);
    if model == ModelKind::Peercy || by_step {
        return refused(format!("the model {model} has no spectrum for each of its numbers; take another model"));
    }
    for material in planned.materials.iter().filter_map(|&material| scene.materials.get(material)) {
        let samples = material.reflectance.spectrum().samples();
        let (band, most) = samples
            .iter()
            .enumerate()
            .fold((0, 0.0_f64), |best, (band, &sample)| if sample > best.1 { (band, sample) } else { best });
        if most > 1.0 + 1e-9 {
            return refused(format!(
                "the material {} reflects {} times the light at {} nm, which would grow with every scattering; take a reflectance of at most 1",
                material.name,
                brief(most),
                readable(wavelength_nm(band))
            ));
        }
    }
    let forwards =
        |&material: &usize| scene.materials.get(material).filter(|material| material.phase.abs() > NEARLY_EVEN);
    if let Some(material) = planned.materials.iter().find_map(forwards) {
        return refused(format!(
            "materials.{}.phase = {}, and light that has scattered before is gathered as though each material scattered nearly evenly, with a phase from -{NEARLY_EVEN} to {NEARLY_EVEN}",
            material.name,
            readable(material.phase)
        ));
    }
    Ok(())
}
