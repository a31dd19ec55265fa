//! Stages of rendering that a change of the scene makes obsolete.
#![expect(clippy::float_cmp, reason = "a number is the same or another one")]

use std::sync::Arc;

use super::{Planned, ScenePlan, planned};
use crate::key::{self, Stale};
use crate::{LabelEntry, Labels, Material, ScatteringMethod, Scene, SceneLight, Shadows};

impl Stale {
    /// The stage that the change from `before` to `after` makes stale; `planned` is the plan of `before`.
    ///
    /// Destructures every struct without `..`: a new field does not compile until its stage is decided here.
    #[must_use]
    pub fn between(before: &Scene, planned: &Planned, after: &Scene) -> Self {
        let Scene {
            name: _,
            frame,
            fields,
            labels,
            materials,
            transfer,
            lights,
            // Compared in the plan.
            blending: _,
            overlap: _,
            hidden,
            shading: _,
            lighting: _,
            background,
            camera,
            crop,
            clip,
            block,
            // By their keys.
            accuracy: _,
            shadows,
            // The orders and the method are compared in the plan.
            scattering,
            display: _,
        } = before;
        // Weights do not depend on spectra; a colour model is fitted to them.
        let spectra = if planned.model.is_some() { Self::Tables } else { Self::Picture };
        let mut stale = Self::of_plans(before, after);
        let mut add = |changed: bool, stage: Self| stale = stale.max(if changed { stage } else { Self::Nothing });
        add(!fields.are(&after.fields) || *frame != after.frame, Self::Volume);
        add(fields.terms() != after.fields.terms() || *hidden != after.hidden, Self::Tables);
        add(true, of_labels(labels.as_ref(), after.labels.as_ref()));
        let phases = match planned.plan.phases {
            // A phase function that has an effect in one of the scenes changes the plan.
            0 => Self::Nothing,
            _ if planned.model.is_some() => Self::Tables,
            _ => Self::Accumulators,
        };
        // As of phase functions. Of films, weights depend on the spectra.
        let thin_films = if planned.plan.thin_films.total() > 0 { Self::Tables } else { Self::Nothing };
        add(
            true,
            of_lists(materials, &after.materials, |before, after| {
                of_materials(before, after, [spectra, phases, thin_films])
            }),
        );
        add(*transfer != after.transfer, Self::Tables);
        add(true, of_lists(lights, &after.lights, |before, after| of_lights(before, after, spectra)));
        add(*background != after.background, spectra);
        // A march completes its light grid first: directions of three-point lights turn with the camera.
        add(*camera != after.camera, Self::Accumulators);
        add(*crop != after.crop || !clip.acts_as(&after.clip) || *block != after.block, Self::Accumulators);
        // Only a light grid or rays depend on them, not the shadows of a headlight.
        if planned.plan.light.grid_lights() > 0 {
            // The method and the ambient shares are compared in the plan.
            let Shadows { method: _, spacing, start: _, ambient: _, directions, reach } = *shadows;
            let moved = before.shadow_start() != after.shadow_start();
            let sky = (directions, reach) != (after.shadows.directions, after.shadows.reach);
            let of_sky = planned.plan.light.sky().is_some() && sky;
            add(spacing != after.shadows.spacing || moved || of_sky, Self::Accumulators);
        }
        if let Some(method) = planned.plan.light.gathered {
            let grid = |of: &Scene| (of.scattering_spacing().to_bits(), of.scattering_directions());
            let changed = match method {
                ScatteringMethod::Rows => grid(before) != grid(after),
                ScatteringMethod::Paths => scattering.paths != after.scattering.paths,
            };
            add(changed, Self::Accumulators);
        }
        for part in ["accuracy.", "display."] {
            add(true, key::stale(before, after, part));
        }
        stale
    }

    /// The stage that a change of the plan makes stale, apart from spectra.
    fn of_plans(before: &Scene, after: &Scene) -> Self {
        let [before, after] = [before, after].map(|scene| planned(scene, None));
        let Planned { plan, materials, positions, model: _, warnings: _ } = &before;
        if !plan.is_stored_as(&after.plan) {
            return Self::Volume;
        }
        // Interpolation, storage of the volume and labels are compared above; clip planes in the scene.
        let ScenePlan {
            accumulate,
            transmittance,
            ref light,
            shading,
            phases,
            thin_films,
            groups,
            clip: _,
            labels: _,
            smooth_labels: _,
            labels_by_value,
            background,
            lookup,
            integration,
            blending,
            interpolation: _,
            volume: _,
            gradients: _,
            skipping,
            rays,
            jitter,
            crossings,
            compensated,
            storage,
        } = *plan;
        let later = &after.plan;
        let tables = (
            accumulate,
            transmittance,
            light,
            (shading, phases, thin_films),
            groups,
            (lookup, integration, crossings, blending),
            labels_by_value,
        ) != (
            later.accumulate,
            later.transmittance,
            &later.light,
            (later.shading, later.phases, later.thin_films),
            later.groups,
            (later.lookup, later.integration, later.crossings, later.blending),
            later.labels_by_value,
        );
        if tables || *materials != after.materials || positions.len() != after.positions.len() {
            return Self::Tables;
        }
        let march = (background, skipping, (rays, jitter), compensated, storage)
            != (later.background, later.skipping, (later.rays, later.jitter), later.compensated, later.storage);
        if march { Self::Accumulators } else { Self::Nothing }
    }
}

/// The furthest-reaching stage over elements of equal index; `Tables` if the lengths differ.
fn of_lists<T>(before: &[T], after: &[T], of: impl Fn(&T, &T) -> Stale) -> Stale {
    if before.len() != after.len() {
        return Stale::Tables;
    }
    before.iter().zip(after).map(|(before, after)| of(before, after)).max().unwrap_or_default()
}

fn of_labels(before: Option<&Labels>, after: Option<&Labels>) -> Stale {
    let (Some(Labels { volume, declared }), Some(after)) = (before, after) else {
        return if before.is_some() == after.is_some() { Stale::Nothing } else { Stale::Volume };
    };
    if !Arc::ptr_eq(volume, &after.volume) {
        return Stale::Volume;
    }
    let of_entries = |before: &LabelEntry, after: &LabelEntry| {
        let LabelEntry { label, name: _, material, opacity, absorption, terms } = before;
        let same = (label, material, terms) == (&after.label, &after.material, &after.terms)
            && (*opacity, *absorption) == (after.opacity, after.absorption);
        if same { Stale::Nothing } else { Stale::Tables }
    };
    // The rows of the label map on the device follow the list.
    let listed = |entries: &[LabelEntry]| entries.iter().map(|entry| entry.label).collect::<Vec<_>>();
    if listed(declared) != listed(&after.declared) {
        return Stale::Volume;
    }
    of_lists(declared, &after.declared, of_entries)
}

fn of_materials(before: &Material, after: &Material, [spectra, phases, thin_films]: [Stale; 3]) -> Stale {
    let Material { name: _, reflectance, absorption, ambient, diffuse, specular, exponent, occludes, phase, film } =
        before;
    let same_medium = *absorption == after.absorption
        && (*ambient, *diffuse, *specular) == (after.ambient, after.diffuse, after.specular)
        && *exponent == after.exponent
        && *occludes == after.occludes;
    if !same_medium {
        return Stale::Tables;
    }
    let colour = if *reflectance == after.reflectance { Stale::Nothing } else { spectra };
    let turned = if *phase == after.phase { Stale::Nothing } else { phases };
    let reflected = if *film == after.film { Stale::Nothing } else { thin_films };
    colour.max(turned).max(reflected)
}

fn of_lights(before: &SceneLight, after: &SceneLight, spectra: Stale) -> Stale {
    let SceneLight { name: _, spectrum, intensity, placement, shadows } = before;
    if *placement != after.placement || *shadows != after.shadows {
        Stale::Tables
    } else if *spectrum != after.spectrum {
        spectra
    } else if *intensity != after.intensity {
        Stale::Picture
    } else {
        Stale::Nothing
    }
}
