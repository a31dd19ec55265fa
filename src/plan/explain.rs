//! Explains plans in sentences, for people who know volumes but not this program.

use super::{Planned, Transmittance, narrower};
use crate::model::ModelKind;
use crate::number::{brief, readable};
use crate::scene::{AccumulateAs, Accuracy, Gradients, Interpolation, Lookup, Scene};

impl Planned {
    /// Sentences about settings that this plan does not use.
    #[must_use]
    pub fn unused(&self, scene: &Scene) -> Vec<String> {
        let Accuracy { dimension, model, .. } = scene.accuracy;
        let stated = [
            dimension.map(|k| format!("k = {k}")),
            (model != ModelKind::default()).then(|| format!("the model {model}")),
        ];
        let stated = stated.into_iter().flatten().filter(|_| self.model.is_none());
        let told = |what: String| {
            format!(
                "{what} is not used: pixels keep weights of the materials, which are exact here; accumulate = \"spectral\" \
                 (--accumulate spectral) keeps numbers of a colour model in their place"
            )
        };
        stated.map(told).collect()
    }

    /// A sentence for each material whose absorption would amplify light in the colour model, and is clamped at 0.
    #[must_use]
    pub fn amplified(&self, scene: &Scene) -> Vec<String> {
        let coloured = self.plan.transmittance == Transmittance::Coloured;
        let Some(model) = self.model.as_ref().filter(|_| coloured) else { return Vec::new() };
        let absorbing = scene.materials.iter().enumerate().filter(|&(m, _)| scene.absorbs(m));
        let told = absorbing.filter_map(|(_, material)| {
            let told = model.amplification(material.absorption.as_ref()?.spectrum())?;
            Some(format!("Of {}, {told}.", material.name))
        });
        told.collect()
    }

    /// Sentences about the representation of colours, the numbers per pixel, and the colour errors.
    fn explain_colours(&self, scene: &Scene) -> Vec<String> {
        let plan = &self.plan;
        let name = |material: usize| scene.materials.get(material).map(|material| material.name.as_str());
        let shown = || listed(self.materials.iter().filter_map(|&material| name(material)));
        let absorbs = |material: &usize| scene.absorbs(*material);
        let passes = match plan.transmittance {
            Transmittance::Grey => "All wavelengths pass alike, whatever light meets on its way".to_owned(),
            Transmittance::Coloured | Transmittance::Mixed => format!(
                "Light changes its colour on its way, as through stained glass, where it meets {}",
                listed((0..scene.materials.len()).filter(absorbs).filter_map(name))
            ),
        };
        let each = if plan.positions.total() > 1 { ", for each of the places that light comes from" } else { "" };
        let kept = plan.components() * plan.positions.total() + plan.passed();
        let mut sentences = Vec::new();
        match &self.model {
            None => {
                let white = if plan.specular().is_some() { " and of white highlights" } else { "" };
                sentences.push(format!("{passes}: a pixel's colour follows exactly, under every light, from how much it shows of each material."));
                sentences.push(format!(
                    "So a pixel keeps how much it shows of {}{white}{each}, and how much light passes through: {kept} numbers in all.",
                    shown()
                ));
            }
            Some(model) => {
                let followed = match model.nodes_nm() {
                    Some(nodes) => format!(
                        "Its colours are followed at {} wavelengths ({} nm), chosen for this scene so that they stand for all others",
                        nodes.len(),
                        nodes.iter().map(f64::to_string).collect::<Vec<_>>().join(", ")
                    ),
                    None => format!("Its colours are followed by {} in place of all wavelengths", model.description()),
                };
                sentences.push(format!("{passes}. {followed}."));
                sentences.extend(self.amplified(scene));
                sentences.push(format!(
                    "So a pixel keeps {} numbers of the light that comes back{each}, and {} of what passes through: {kept} in all.",
                    plan.components(),
                    plan.passed()
                ));
            }
        }
        sentences.push(
            "No light's colour is in them: lights can be exchanged later, without computing the picture anew."
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
                    "Compared with following all wavelengths, colours are off by {}, in steps of the colour difference CIEDE2000 (ΔE00), of which 1 can just be seen side by side.",
                    errors.join(", ")
                ));
                sentences.push(match scene.accuracy.dimension {
                    Some(k) => format!("That the numbers are {k} was asked for."),
                    None => format!(
                        "Fewer numbers would miss some colours by more than {} that is allowed.",
                        self.allowed(scene)
                    ),
                });
            }
        }
        if let Some(error) = self.half_precision_error(scene) {
            sentences.push(format!(
                "A finished pixel is stored in 16 bits a number, {} bytes in all; that moves no colour by more than ΔE00 {error:.2}.",
                plan.pixel_bytes()
            ));
        }
        let hidden = || (0..scene.materials.len()).filter(|material| !self.materials.contains(material));
        let (filters, unused): (Vec<usize>, Vec<usize>) = hidden().partition(absorbs);
        if !filters.is_empty() {
            let filters = listed(filters.into_iter().filter_map(name));
            sentences.push(format!("Seen only by what they take from the light: {filters}."));
        }
        if !unused.is_empty() {
            let unused = listed(unused.into_iter().filter_map(name));
            sentences.push(format!("Materials that nothing shows are left out: {unused}."));
        }
        sentences
    }

    /// The plan in sentences, for people who know volumes but not this program.
    #[must_use]
    pub fn explain(&self, scene: &Scene) -> Vec<String> {
        let plan = &self.plan;
        let mut sentences = self.explain_colours(scene);
        sentences.push(match plan.positions.total() {
            0 => "There is no light: only what passes is computed.".to_owned(),
            1 if scene.lights.len() == 1 => "There is one light.".to_owned(),
            1 => format!("Shading cannot tell the {} lights apart, so they share their numbers.", scene.lights.len()),
            total => format!(
                "{} lights shine from {total} places that shading can tell apart: {}.",
                scene.lights.len(),
                listed(self.positions.iter().map(|position| position.name.as_str()))
            ),
        });
        sentences.push(match plan.shading.filter(|_| plan.gradient()) {
            None => "Nothing is shaded by the direction of surfaces.".to_owned(),
            Some(terms) => format!(
                "Surfaces get their {} by which way values change there, which is {}.",
                match (terms.diffuse, terms.specular) {
                    (true, None) => "shading",
                    (false, _) => "highlights",
                    (true, Some(_)) => "shading and highlights",
                },
                match plan.gradients {
                    Gradients::Packed => "stored beside each value",
                    Gradients::Central => "taken from six values around each sample",
                }
            ),
        });
        if plan.labels {
            sentences.push("Labels decide what a voxel is; without a label, its value does.".to_owned());
        }
        sentences.push(
            if plan.background {
                "The background is seen through what passes, and relit with everything else."
            } else {
                "The background is black and costs nothing."
            }
            .to_owned(),
        );
        let values = match plan.interpolation {
            Interpolation::Linear => "values change evenly from one to the next",
            Interpolation::ExactLinear => "values change evenly from one to the next, in all bits of a number",
            Interpolation::Cubic => "values follow a smooth curve, a cubic spline",
            Interpolation::Nearest => "a place has the value of the nearest",
        };
        let entries = match plan.lookup {
            Lookup::Linear => "what a value looks like changes evenly with it",
            Lookup::Nearest => "what a value looks like changes with it in small steps",
        };
        sentences.push(format!("Between voxels, {values}; {entries}."));
        let termination = if scene.accuracy.termination > 0.0 {
            format!(
                "until less than {} % of the light behind can still come through",
                readable(100.0 * scene.accuracy.termination)
            )
        } else {
            "to the end of the volume".to_owned()
        };
        let skipping = if plan.skipping { "leapt over" } else { "walked through" };
        sentences.push(format!(
            "From the eye on, the volume is looked at in steps of {} (its own unit of length), {termination}; what is empty is {skipping}.",
            brief(scene.accuracy.step_length)
        ));
        sentences
    }

    /// The allowed error of a colour model, in words.
    fn allowed(&self, scene: &Scene) -> String {
        let Accuracy { accumulate, tolerance, .. } = scene.accuracy;
        let exact = self.plan.transmittance == Transmittance::Grey && accumulate == AccumulateAs::Auto;
        format!("{}the {}", if exact { "half of " } else { "" }, readable(tolerance))
    }

    /// Why coefficients replace exact weights, or why weights remain where fewer coefficients were tried.
    fn explain_choice(&self, scene: &Scene) -> Option<String> {
        let Accuracy { accumulate, dimension, .. } = scene.accuracy;
        let exact = self.plan.transmittance == Transmittance::Grey && accumulate == AccumulateAs::Auto;
        match &self.model {
            Some(_) if exact => {
                let weights = self.materials.len() + usize::from(self.plan.specular().is_some());
                let kept = self.plan.components();
                Some(format!(
                    "To keep how much a pixel shows of each material would be exact (accumulate = \"weights\"), but takes {weights} numbers in place of {kept}, and longer."
                ))
            }
            None if exact && dimension.is_none() && narrower(&self.plan) > 0 => Some(format!(
                "A colour model of fewer numbers would be faster, but would change colours by more than {} that is allowed: in ΔE00 (CIEDE2000), of which 1 can just be seen side by side.",
                self.allowed(scene)
            )),
            _ => None,
        }
    }
}

/// Joins names by commas.
fn listed<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let names: Vec<&str> = names.collect();
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}
