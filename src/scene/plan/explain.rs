//! Explains plans in sentences, for people who know volumes but not this program.

use super::{
    ClipPlan, Integrate, MOST_PARTS, PlanWarning, Planned, PlannedFilm, Transmittance, crossed, narrow, narrower,
    refinement_bound,
};
use crate::key::Named as _;
use crate::{
    AccumulateAs, Accuracy, AmbientShares, Backdrop, Blending, Field, Gradients, Integration, Interpolation, Keep,
    Lookup, Orders, Overlap, ScatteringMethod, Scene, Shading, ShadowMethod,
};
use relume_base::number::{brief, readable};
use relume_colour::model::ModelKind;
use relume_colour::spectrum::{Layers, THIN_FILM_ANGLES, ThinFilmAngle};

/// Rules for several fields or clip planes, of a scene with one.
fn unused_rules(scene: &Scene) -> impl Iterator<Item = PlanWarning> {
    let overlap = scene.fields.further().is_empty() && scene.overlap != Overlap::default();
    let overlap = overlap.then(|| (format!("overlap = \"{}\"", scene.overlap.name()), "the scene has one field"));
    let keep = scene.clip.keep == Keep::Any && scene.clip.planes.iter().filter(|plane| plane.on).count() == 1;
    let keep = keep.then(|| ("clip.keep = \"any\"".to_owned(), "one clip plane keeps the same by either rule"));
    overlap.into_iter().chain(keep).map(|(setting, why)| PlanWarning::RuleUnused { setting, why })
}

impl Planned {
    /// Settings that this plan does not use.
    #[must_use]
    pub fn unused(&self, scene: &Scene) -> Vec<PlanWarning> {
        let Accuracy { dimension, model, .. } = scene.accuracy;
        let stated = [
            dimension.map(|k| format!("k = {k}")),
            (model != ModelKind::default()).then(|| format!("the model {model}")),
        ];
        let stated = stated.into_iter().flatten().filter(|_| self.model.is_none());
        let phases = listed(scene.states_phases().map(|material| material.name.as_str()));
        let is_extreme = scene.blending.is_extreme();
        let without = (scene.shading == Shading::Gradient || is_extreme) && scene.states_phases().next().is_some();
        let phases = without.then_some(PlanWarning::PhaseUnused { materials: phases, is_extreme });
        let of_lights = scene.lights.iter().filter(|light| light.shadows);
        let of_lights = of_lights.map(|light| format!("lights.{}.shadows", light.name));
        let of_shares = scene.shadows.ambient == AmbientShares::Occluded;
        let of_orders = scene.scattering.orders == Orders::Multiple;
        let of_shares = of_shares.then(|| "shadows.ambient".to_owned());
        let of_orders = of_orders.then(|| "scattering.orders".to_owned());
        let settings: Vec<String> = of_lights.chain(of_shares).chain(of_orders).collect();
        let shadows =
            (is_extreme && !settings.is_empty()).then(|| PlanWarning::ShadowsUnused { settings: settings.join(", ") });
        let thin_films = self.unused_thin_films(scene).into_iter().chain(self.inexact_thin_films(scene));
        let of_model = stated.map(|setting| PlanWarning::Unused { setting });
        let adaptive = (scene.accuracy.integration == Integration::Adaptive).then(|| self.not_refined()).flatten();
        let adaptive =
            adaptive.map(|why| PlanWarning::RuleUnused { setting: "integration = \"adaptive\"".to_owned(), why });
        of_model.chain(unused_rules(scene)).chain(adaptive).chain(phases).chain(shadows).chain(thin_films).collect()
    }

    /// Films without effect.
    fn unused_thin_films(&self, scene: &Scene) -> Vec<PlanWarning> {
        let (mut placeless, mut unshaded, mut without, mut undirected) =
            (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for material in scene.states_thin_films() {
            if scene.blending.is_extreme() {
                placeless.push(material.name.as_str());
            } else if scene.shading == Shading::None {
                unshaded.push(material.name.as_str());
            } else if let Some(film) =
                material.film.as_ref().filter(|film| material.thin_film_at(film.angle()).is_none())
            {
                without.push((material.name.as_str(), film.angle()));
            } else if !self.plan.light.is_directed() {
                undirected.push(material.name.as_str());
            }
        }
        let warning = |names: Vec<&str>, why| {
            (!names.is_empty()).then(|| PlanWarning::FilmUnused { materials: names.join(", "), why })
        };
        let of = |angle: ThinFilmAngle| without.iter().filter(|film| film.1 == angle).map(|film| film.0).collect();
        let warnings = [
            warning(
                placeless,
                "a single value of a ray is seen, and it has no surface; use blending = \"composite\", or remove `film`",
            ),
            warning(unshaded, "without shading no surface has an angle; use shading = \"gradient\", or remove `film`"),
            warning(
                undirected,
                "all lights are ambient, and light without direction meets no film; add a light with a direction, such as \
                 kind = \"three_point\", or remove `film`",
            ),
            warning(of(ThinFilmAngle::Facing), "the diffuse factor is 0; state `diffuse`, or angle = \"lobe\""),
            warning(of(ThinFilmAngle::Lobe), "the specular factor is 0; state `specular`, or angle = \"facing\""),
        ];
        warnings.into_iter().flatten().collect()
    }

    /// Films whose terms exceed the tolerance.
    fn inexact_thin_films(&self, scene: &Scene) -> Vec<PlanWarning> {
        let tolerance = scene.accuracy.tolerance;
        let thin_films = self.thin_films(scene).into_iter();
        let warning = |film: PlannedFilm<'_>| {
            let error = self.thin_film_error(&film);
            let material = film.material.name.clone();
            (error > tolerance).then_some(PlanWarning::FilmInexact { material, error, tolerance })
        };
        thin_films.filter_map(warning).collect()
    }

    /// Largest ΔE00 of a film.
    fn thin_film_error(&self, film: &PlannedFilm<'_>) -> f64 {
        self.model.as_ref().map_or_else(|| film.film.terms().errors[film.terms], |model| film.error_in(model))
    }

    /// Sentences about thin films.
    fn explain_thin_films(&self, scene: &Scene) -> Vec<String> {
        let thin_films = self.thin_films(scene);
        if thin_films.is_empty() {
            return Vec::new();
        }
        let told = thin_films.iter().map(|film| {
            let Layers { index, thickness_nm, above, below } = film.film.layers();
            let part = match film.film.angle() {
                ThinFilmAngle::Facing => "diffuse light, by the mean angle of light and eye to the surface",
                ThinFilmAngle::Lobe => "highlights, by the angle between light and eye",
            };
            let (n, nm) = (readable(index), readable(thickness_nm));
            let around = format!("between {} and {}", readable(above), readable(below));
            format!("{} ({nm} nm of index {n} {around}; {part})", film.material.name)
        });
        let told: Vec<String> = told.collect();
        let mut sentences =
            vec![format!("Thin films reflect by interference in {}.", listed(told.iter().map(String::as_str)))];
        sentences.push(match &self.model {
            None => {
                let terms = thin_films.iter().map(|film| {
                    let (terms, error) = (film.terms, self.thin_film_error(film));
                    format!("{terms} for {} (colour error at most ΔE00 {error:.2})", film.material.name)
                });
                let terms: Vec<String> = terms.collect();
                format!(
                    "The spectrum of a film is a sum of terms, each with a weight by the angle and a spectrum of its own: {}.",
                    listed(terms.iter().map(String::as_str))
                )
            }
            Some(_) => {
                let worst = thin_films.iter().map(|film| self.thin_film_error(film)).fold(0.0, f64::max);
                format!(
                    "The numbers of a film come from a table of {THIN_FILM_ANGLES} angles, with a colour error of at most ΔE00 {worst:.2}; the model was chosen with spectra of each film."
                )
            }
        });
        sentences
    }

    /// A sentence for each material whose absorption would amplify light in the colour model, and is clamped at 0.
    #[must_use]
    pub fn amplified(&self, scene: &Scene) -> Vec<String> {
        let coloured = self.plan.transmittance == Transmittance::Coloured;
        let Some(model) = self.model.as_ref().filter(|_| coloured) else { return Vec::new() };
        let absorbing = scene.materials.iter().enumerate().filter(|&(m, _)| scene.absorbs(m));
        let told = absorbing.filter_map(|(_, material)| {
            let told = model.amplification(material.absorption.as_ref()?.spectrum())?;
            Some(format!("For {}, {told}.", material.name))
        });
        told.collect()
    }

    /// Sentences about the representation of colours, the numbers per pixel, and the colour errors.
    fn explain_colours(&self, scene: &Scene) -> Vec<String> {
        let plan = &self.plan;
        let name = |material: usize| scene.materials.get(material).map(|material| material.name.as_str());
        let shown = || listed(self.materials.iter().filter_map(|&material| name(material)));
        let absorbs = |material: &usize| scene.absorbs(*material);
        let absorption = match plan.transmittance {
            Transmittance::Grey => "All wavelengths are absorbed equally".to_owned(),
            Transmittance::Coloured | Transmittance::Mixed => format!(
                "Light changes its colour, as through stained glass, in {}",
                listed((0..scene.materials.len()).filter(absorbs).filter_map(name))
            ),
        };
        let each = if plan.light.accumulators() > 1 { " for each light position" } else { "" };
        let kept = plan.components() * plan.light.accumulators() + plan.transmittance_numbers();
        let mut sentences = Vec::new();
        match &self.model {
            None => {
                let white = if plan.specular().is_some() { " and of white highlights" } else { "" };
                let (exactly, thin_films) = match plan.thin_films.terms {
                    0 => (" exactly", String::new()),
                    terms => ("", format!(", {terms} weights of terms of thin films")),
                };
                sentences.push(format!(
                    "{absorption}: the colour of a pixel under any light follows{exactly} from the weights of its materials."
                ));
                sentences.push(format!(
                    "A pixel keeps the weights of {}{white}{thin_films}{each}, and the transmittance: {kept} numbers in all.",
                    shown()
                ));
            }
            Some(model) => {
                let followed = match model.nodes_nm() {
                    Some(nodes) => format!(
                        "Colours are computed at {} wavelengths ({} nm), chosen for this scene to represent all others",
                        nodes.len(),
                        nodes.iter().map(f64::to_string).collect::<Vec<_>>().join(", ")
                    ),
                    None => format!("Colours are computed with {} instead of all wavelengths", model.description()),
                };
                sentences.push(format!("{absorption}. {followed}."));
                sentences.extend(self.amplified(scene));
                sentences.push(format!(
                    "A pixel keeps {} numbers of the scattered light{each}, and {} of the transmittance: {kept} in all.",
                    plan.components(),
                    plan.transmittance_numbers()
                ));
            }
        }
        sentences.push(
            "These numbers do not depend on the colours of the lights: lights can be exchanged later, without rendering the volume again."
                .to_owned(),
        );
        sentences.extend(self.explain_choice(scene));
        if let Some(model) = &self.model {
            let errors = model.lights().iter().map(|(name, _, matrix)| {
                let error = matrix.worst();
                format!("{:.2} on average and {:.2} at most under {name}", error.mean, error.max)
            });
            let errors: Vec<String> = errors.collect();
            if !errors.is_empty() {
                sentences.push(format!(
                    "Compared with all wavelengths, the colour error is {}, in units of the colour difference CIEDE2000 (ΔE00), where 1 is just visible side by side.",
                    errors.join(", ")
                ));
                sentences.push(match scene.accuracy.dimension {
                    Some(k) => format!("The {k} numbers were requested."),
                    None => format!("With fewer numbers, some colour errors would exceed {}.", self.allowed(scene)),
                });
            }
        }
        let ClipPlan { planes, keeps_any, caps, .. } = plan.clip;
        if planes > 0 {
            let (planes, are) =
                if planes == 1 { ("A clip plane".to_owned(), "is") } else { (format!("{planes} clip planes"), "are") };
            let caps = if caps { ", and shading sees the cut faces" } else { "" };
            let keeps = if keeps_any { " What any of them keeps is left." } else { "" };
            let by_field = if plan.clip.is_by_field() {
                " Shadows fade over a voxel at planes that cut single fields or leave a corner."
            } else {
                ""
            };
            sentences.push(format!(
                "{planes} {are} cut exactly: of the steps that a plane cuts, the part that is left counts{caps}.{keeps} What goes casts no shadows.{by_field}"
            ));
        }
        if let Some(error) = self.half_precision_error(scene) {
            sentences.push(format!(
                "A finished pixel is stored with 16 bits per number, {} bytes in all; this changes colours by at most ΔE00 {error:.2}.",
                plan.pixel_bytes()
            ));
        }
        let hidden = || (0..scene.materials.len()).filter(|material| !self.materials.contains(material));
        let (filters, unused): (Vec<usize>, Vec<usize>) = hidden().partition(absorbs);
        if !filters.is_empty() {
            let filters = listed(filters.into_iter().filter_map(name));
            sentences.push(format!("Visible only by their absorption: {filters}."));
        }
        if !unused.is_empty() {
            let unused = listed(unused.into_iter().filter_map(name));
            sentences.push(format!("Unused materials are left out: {unused}."));
        }
        sentences
    }

    /// Sentences about light that scatters more than once.
    fn explain_scattering(&self, scene: &Scene) -> Vec<String> {
        let Some(method) = self.plan.light.gathered else { return Vec::new() };
        let mut sentences = vec![match method {
            ScatteringMethod::Rows => {
                format!(
                    "Light scatters any number of times. It is gathered at places {} voxels apart, from {} directions: once for all colours of the lights, and again if the medium, the crop box or a direction of a light changes. Another reflectance sends no ray.",
                    // To two digits: the data choose it.
                    readable((100.0 * scene.scattering_spacing()).round() / 100.0),
                    scene.scattering_directions()
                )
            }
            ScatteringMethod::Paths => format!(
                "Light scatters any number of times, along {} random paths of each pixel: without other errors than their noise, for the reference.",
                scene.scattering.paths
            ),
        }];
        sentences.push(
            "Such light is a product of many reflectances, so pixels keep no exact weights of materials, and every light casts shadows."
                .to_owned(),
        );
        if self.plan.shades_by_gradient() {
            sentences.push(
                "Gradients shade light that scatters for the first time; deeper orders come from everywhere."
                    .to_owned(),
            );
        }
        if self.positions.iter().any(|position| position.placement.follows_camera()) {
            sentences.push(
                "A light that turns with the camera is gathered again for each view; one with a direction of its own, or of the sky, is not.".to_owned(),
            );
        }
        sentences
    }

    /// The plan in sentences, for people who know volumes but not this program.
    #[must_use]
    pub fn explain(&self, scene: &Scene) -> Vec<String> {
        let plan = &self.plan;
        let mut sentences = self.explain_colours(scene);
        sentences.push(match plan.light.accumulators() {
            0 => "There is no light: only the transmittance is computed.".to_owned(),
            1 if scene.lights.len() == 1 => "There is one light.".to_owned(),
            1 => {
                format!("Shading does not distinguish the {} lights, so they share their numbers.", scene.lights.len())
            }
            total => format!(
                "{} lights shine from {total} positions that shading distinguishes: {}.",
                scene.lights.len(),
                listed(self.positions.iter().map(|position| position.name.as_str()))
            ),
        });
        if plan.blending.is_extreme() {
            let size = if plan.blending == Blending::Maximum { "largest" } else { "smallest" };
            sentences.push(format!(
                "A pixel shows the {size} value along its ray, of each field, as an opacity length of its medium ({}). All light reaches it whole: shading, shadows, phase functions and thin films have no effect.",
                brief(scene.transfer.opacity_length)
            ));
        }
        sentences.push(match plan.shading.filter(|_| plan.shades_by_gradient()) {
            None => "Shading does not depend on the direction of surfaces.".to_owned(),
            Some(terms) => format!(
                "Surfaces get their {} from the gradient of the values, which is {}{}.",
                match (terms.diffuse, terms.specular) {
                    (true, None) => "shading",
                    (false, _) => "highlights",
                    (true, Some(_)) => "shading and highlights",
                },
                gradients(plan.gradients),
                if terms.one_sided { "; only the side towards lower values is lit" } else { "" }
            ),
        });
        if plan.phases > 0 {
            let phases = scene.states_phases().map(|material| {
                let side = if material.phase > 0.0 { "forwards" } else { "backwards" };
                format!("{} (phase = {}, mostly {side})", material.name, readable(material.phase))
            });
            let phases: Vec<String> = phases.collect();
            sentences.push(format!(
                "Light is scattered by phase functions in {}: its brightness depends on the angle between the light and the eye, so each direction has numbers of its own in a pixel. Ambient light comes from everywhere, and does not.",
                listed(phases.iter().map(String::as_str))
            ));
        }
        sentences.extend(self.explain_thin_films(scene));
        sentences.extend(self.explain_shadows(scene));
        sentences.extend(self.explain_scattering(scene));
        if plan.groups.further > 0 {
            let names = |fields: &[Field]| listed(fields.iter().map(|field| field.name.as_str()));
            let places = [
                ("on the grid of the volume", scene.fields.sharing()),
                ("on grids of their own", scene.fields.beside()),
            ];
            let told = places.iter().filter(|(_, fields)| !fields.is_empty());
            let told: Vec<String> = told.map(|(place, fields)| format!("{} {place}", names(fields))).collect();
            sentences.push(format!(
                "Beside the volume, a sample reads {}{}.",
                told.join(", and "),
                match plan.groups.overlap {
                    _ if plan.blending.is_extreme() => "",
                    Overlap::Add => ", and adds the densities of all",
                    Overlap::First => "; where several have a medium, the first is seen alone",
                    Overlap::Last => "; where several have a medium, the last is seen alone",
                }
            ));
            let lit = plan.groups.lit_fields().filter_map(|field| scene.fields.further().get(field - 1));
            let lit: Vec<&str> = lit.map(|field| field.name.as_str()).collect();
            if !lit.is_empty() {
                let source = if plan.stores_placed_gradients() { Gradients::Packed } else { Gradients::Central };
                sentences.push(format!(
                    "Shaded by gradients of their own, on grids of their own {}: {}.",
                    gradients(source),
                    listed(lit.into_iter())
                ));
            }
        }
        if plan.groups.by_gradient() {
            let opacity = match plan.groups.number {
                1 => "The opacity follows the magnitude of the gradient".to_owned(),
                groups => format!(
                    "The opacity of terms follows the magnitude of the gradient, in {groups} groups with different factors, which are looked up apart"
                ),
            };
            sentences.push(format!("{opacity}. The gradient is {}; labels are unaffected.", gradients(plan.gradients)));
        }
        if plan.labels {
            sentences.push(
                "Labels determine the materials of voxels; a voxel without a label follows the transfer function."
                    .to_owned(),
            );
            if plan.labels_by_value {
                sentences
                    .push("Some labels have a transfer function of their own, a row of the label table.".to_owned());
            }
            if plan.groups.further > 0 {
                sentences.push("Labels are those of the first volume; the others add to them.".to_owned());
            }
            if plan.smooth_labels {
                sentences.push("Between voxels with different labels, each has its share of the material.".to_owned());
            }
        }
        sentences.push(
            match (plan.background, scene.display.backdrop) {
                (true, Backdrop::None) => {
                    "The background is visible through the volume, and relit with everything else."
                }
                (true, Backdrop::Dark) => {
                    "The background is visible through the volume, and relit with everything else; it hides the backdrop."
                }
                (false, Backdrop::None) => "The background is black and costs nothing.",
                (false, Backdrop::Dark) => {
                    "Behind the volume is the dark backdrop of the screen, which no light changes; it costs nothing."
                }
            }
            .to_owned(),
        );
        let values = match plan.interpolation {
            Interpolation::Linear => "values are interpolated linearly",
            Interpolation::ExactLinear => "values are interpolated linearly in full precision",
            Interpolation::Cubic => "values are interpolated by a cubic spline",
            Interpolation::CubicX => "values are interpolated by a cubic spline along x and linearly along y and z",
            Interpolation::CubicY => "values are interpolated by a cubic spline along y and linearly along x and z",
            Interpolation::CubicZ => "values are interpolated by a cubic spline along z and linearly along x and y",
            Interpolation::Nearest => "the value is that of the nearest voxel",
        };
        let entries = match plan.lookup {
            Lookup::Linear => "the transfer function is interpolated linearly",
            Lookup::Nearest => "the transfer function changes in small steps",
        };
        sentences.push(format!("Between voxels, {values}; {entries}."));
        if plan.interpolation.cubic_axis().is_some() && plan.groups.beside() > 0 {
            sentences.push("Fields on grids of their own are interpolated linearly along all axes.".to_owned());
        }
        let termination = if scene.accuracy.termination > 0.0 && !plan.blending.is_extreme() {
            format!("until the transmittance is below {} %", readable(100.0 * scene.accuracy.termination))
        } else {
            "to the end of the volume".to_owned()
        };
        let skipping = if plan.skipping { "skipped" } else { "sampled, too" };
        if plan.integration == Integrate::Segments {
            sentences.push(format!(
                "Each step takes the mean of the medium over the values between its ends; it is divided, into {MOST_PARTS} parts at most, where opacity or shading change by more than {}.",
                readable(scene.accuracy.variation)
            ));
            if let Some(narrow) = narrow(scene).filter(|_| scene.accuracy.integration == Integration::Auto) {
                sentences.push(format!(
                    "That is because values change by {} in a step, and an interval of the transfer function is {} wide: samples would miss it.",
                    brief(narrow.change),
                    brief(narrow.width)
                ));
            }
        }
        if plan.integration == Integrate::Refined {
            sentences.push(format!(
                "A step has one sample, and one more towards each sample beside it from which its medium or shading differs by more than {}.",
                brief(refinement_bound(scene.accuracy.variation))
            ));
            if let Some(range) = crossed(scene).filter(|_| plan.crossings) {
                sentences.push(format!(
                    "Intervals between the values of two samples count too: in {} % of the steps that touch a range of visible values, the values change by more than its width, {}.",
                    brief(100.0 * range.part),
                    brief(range.width)
                ));
            }
        } else if scene.accuracy.integration == Integration::Adaptive
            && let Some(why) = self.not_refined()
        {
            sentences.push(format!("A step has one sample, wherever the medium changes, because {why}."));
        }
        sentences.push(format!(
            "Rays from the eye sample the volume in steps of {} (its own unit of length), {termination}; empty regions are {skipping}.",
            brief(scene.accuracy.step_length)
        ));
        if plan.jitter {
            sentences.push("The steps of each ray begin at another part of a step.".to_owned());
        }
        if plan.compensated {
            sentences
                .push("A ray may have so many steps that their sums keep what rounding takes from them.".to_owned());
        }
        if plan.rays > 1 {
            sentences.push(format!(
                "A pixel is the mean of {} rays, which takes that many marches and relights as exactly as one ray.",
                plan.rays
            ));
        }
        sentences
    }

    /// The lights that cast shadows, and the method.
    fn explain_shadows(&self, scene: &Scene) -> Vec<String> {
        let light = &self.plan.light;
        if !light.is_dimmed() {
            return Vec::new();
        }
        let casting = self.positions.iter().filter(|position| position.shadows);
        let lights = casting.flat_map(|position| &position.lights).filter_map(|&light| scene.lights.get(light));
        let names: Vec<&str> = lights.map(|light| light.name.as_str()).collect();
        let mut sentences = Vec::new();
        if !names.is_empty() {
            sentences.push(format!(
                "Shadows of {}: the medium between a sample and the light dims it; X-ray materials cast none. The spectra of these lights can be exchanged later, too.",
                listed(names.into_iter())
            ));
        }
        if light.absorbers > 0 {
            let absorbers = self.absorbers(scene);
            let names = absorbers.iter().filter_map(|&m| scene.materials.get(m)).map(|material| material.name.as_str());
            sentences.push(format!(
                "Shadows through {} are coloured: light has a depth of its own through each, whatever its spectrum; an absorption spectrum can be exchanged without a new light grid.",
                listed(names)
            ));
        }
        if light.sky().is_some() {
            let directions = scene.shadows.directions;
            sentences.push(format!(
                "Ambient light is the mean of {directions} directions of an evenly bright sky, each dimmed by the medium. A grid of {} times the spacing is filled along each of them.",
                if light.has_sky_light() { "two" } else { "four" }
            ));
            if let Some(reach) = scene.shadows.reach {
                sentences.push(format!(
                    "What is farther than {} from a sample does not dim the sky (shadows.reach).",
                    readable(reach)
                ));
            }
        }
        if light.occluded {
            sentences.push("The ambient shares of directed lights are dimmed like it (shadows.ambient).".to_owned());
        }
        let apart = self.positions.iter().filter(|position| position.shadows).count();
        if apart > 1 {
            sentences.push(format!("Shadows keep {apart} positions apart; each has numbers of its own in a pixel."));
        }
        if light.is_dimmed_along_rays() {
            sentences.push("The headlight shines along the rays of the eye, so its shadows cost nothing.".to_owned());
            if self.plan.shades_by_gradient() {
                sentences.push(
                    "With gradient shading its shadow takes about half of the light of dense surfaces; a directional light takes less (shadows.start).".to_owned(),
                );
            }
        }
        if self.positions.iter().any(|position| position.shadows && position.placement.turns()) {
            sentences.push(
                "The three directions of a three-point light move with the camera: if it turns, their part of the light grid is filled again.".to_owned(),
            );
        }
        if light.grid_lights() > 0 {
            if light.method == ShadowMethod::Rays {
                sentences.push(
                    "A ray goes from each sample towards each of these lights, ambient light apart; only the reference does this."
                        .to_owned(),
                );
            }
            let start = scene.shadow_start();
            if start > 0.0 {
                sentences.push(format!(
                    "Nothing within {} voxels (along the axis with the smallest spacing) of a sample shades it, so that surfaces do not shade themselves.",
                    readable(start)
                ));
            }
        }
        sentences
    }

    /// The allowed error of a colour model, in words.
    fn allowed(&self, scene: &Scene) -> String {
        let Accuracy { accumulate, tolerance, .. } = scene.accuracy;
        let exact = self.plan.transmittance == Transmittance::Grey && accumulate == AccumulateAs::Auto;
        format!("{}the tolerance of {}", if exact { "half of " } else { "" }, readable(tolerance))
    }

    /// Why coefficients replace exact weights, or why weights remain where fewer coefficients were tried.
    fn explain_choice(&self, scene: &Scene) -> Option<String> {
        let Accuracy { accumulate, dimension, .. } = scene.accuracy;
        let is_exact = self.plan.transmittance == Transmittance::Grey && self.plan.light.gathered.is_none();
        let exact = is_exact && accumulate == AccumulateAs::Auto;
        match &self.model {
            Some(_) if exact => {
                let terms: usize =
                    self.thin_films(scene).iter().map(|film| film.film.terms_within(scene.accuracy.tolerance)).sum();
                let weights = self.materials.len() + usize::from(self.plan.specular().is_some()) + terms;
                let kept = self.plan.components();
                let would = if terms == 0 { "would be exact" } else { "would depend on no light" };
                Some(format!(
                    "Weights of the materials (accumulate = \"weights\") {would}, but need {weights} numbers instead of {kept}, and more time."
                ))
            }
            None if exact && dimension.is_none() && narrower(&self.plan) > 0 => Some(format!(
                "A colour model with fewer numbers would be faster, but some colour errors would exceed {}, in ΔE00 (CIEDE2000), where 1 is just visible side by side.",
                self.allowed(scene)
            )),
            _ => None,
        }
    }
}

/// Source of the gradients, in words.
fn gradients(source: Gradients) -> &'static str {
    match source {
        Gradients::Packed => "stored with each value",
        Gradients::Central => "computed from six values around each sample",
    }
}

/// Joins names by commas.
fn listed<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let names: Vec<&str> = names.collect();
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}
