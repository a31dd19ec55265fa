//! The state of a document: the scene, dial, mix and palette, and the edits that change them.

use std::mem::Discriminant;
use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::design::{self, Spectra, Step};
use super::look::moves::{self, Move};
use super::{Dial, DialNode, DialPreset, LightState, Mixing, SceneFile, Slider, along, in_colour};
use relume_base::number::count;
use relume_colour::palette::Palette;
use relume_colour::spectrum::deficiency::Deficiency;
use relume_colour::spectrum::observer::Observer;
use relume_colour::spectrum::{Spectrum, ThinFilm};
use relume_scene::{
    Accuracy, AmbientShares, BRIGHTEST, Backdrop, Blending, Clip, FACTORS, GRADIENT_POINTS, GradientFactor, INTENSITY,
    Interval, LabelEntry, Lighting, MOST_GROUPS, Mix, Orders, Overlap, PHASES, Scene, Shape, Term, Tone, key,
};

/// Least part of its scattering that occludes, of a material with an opacity of 1.
const LEAST_OF_OPAQUE: f64 = 0.001;

/// All editable state of a document.
#[derive(Clone, Debug)]
pub struct State {
    /// The scene as edited.
    pub scene: Scene,
    /// The light dial.
    pub dial: Dial,
    /// The mix of the lights.
    pub light: LightState,
    /// The palette of the spectra that are designed together, if any.
    pub palette: Option<Arc<Palette>>,
}

/// A change of the [`State`]. Numbers out of range are clamped.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Edit {
    /// Sets the slider of a light, by its index. If the dial is in use, the sliders take over its mix.
    Weight(usize, f64),
    /// Switches a light on or off.
    On(usize, bool),
    /// Shadows of a light, by its index: on or off.
    Shadows(usize, bool),
    /// Phase function of a material, by its index; numbers beyond [`PHASES`] become its ends.
    Phase(usize, f64),
    /// Thin film of a material, by its index, or none.
    Film(usize, Option<ThinFilm>),
    /// Rule that blends the values along a ray.
    Blending(Blending),
    /// Sides of surfaces that lights shade.
    Lighting(Lighting),
    /// Ambient shares of directed lights: open or occluded.
    AmbientShares(AmbientShares),
    /// Number of times that light scatters.
    Orders(Orders),
    /// Distance in world units beyond which nothing dims the sky, at least [`Scene::least_reach`], or none.
    Reach(Option<f64>),
    /// Selects a single light, or all lights that are on.
    Solo(Option<usize>),
    /// Selects the sliders or the dial.
    Mix(Mixing),
    /// Whether the sliders or the dial, whichever is in use, keep the luminance of white.
    Normalise(bool),
    /// Master of the sliders or the dial, whichever is in use.
    Master(f64),
    /// Moves the hand of the dial, and selects the dial.
    Hand(DVec2),
    /// Moves the hand exactly onto a node, by its index, and selects the dial.
    HandOnNode(usize),
    /// Moves a node.
    NodePlace(usize, DVec2),
    /// Switches a node on or off; it keeps its position.
    NodeOn(usize, bool),
    /// Moves the nodes to the scene's positions, and switches all of them on.
    ResetDial,
    /// Moves the nodes to the corners of a regular polygon, and switches all of them on.
    Polygon,
    /// Selects a dial preset, by its index.
    DialPreset(usize),
    /// Saves the hand and the nodes that are on as a dial preset of this name; replaces a preset of the same name.
    Keep(String),
    /// Renames a dial preset, by its index, unless the name is taken.
    Rename(usize, String),
    /// Removes a dial preset, by its index.
    Forget(usize),
    /// Moves the hand to a step of a tour: the first number of steps out of the second, through all dial presets.
    Tour(usize, usize),
    /// Factor of linear colours.
    Exposure(Option<f64>),
    /// Whether colours are adapted to the white of the lights.
    Adapt(bool),
    /// Curve of the displayed colours.
    Tone(Tone),
    /// Colours of the screen behind the volume.
    Backdrop(Backdrop),
    /// Standard observer.
    Observer(Observer),
    /// Colour vision deficiency to preview.
    Deficiency(Option<Deficiency>),
    /// Opposite corners of the crop box, in fractions of the volume from 0 to 1.
    Crop(Option<[DVec3; 2]>),
    /// Restores the crop box of the scene.
    ResetCrop,
    /// Rule for places where several fields have a medium.
    Overlap(Overlap),
    /// Hides a field, by its index, or shows it again.
    Hidden(usize, bool),
    /// Part of the scattering of a material, by its index, that occludes what is behind it.
    Occludes(usize, f64),
    /// Gives a light, by its index, the bands in which what it lights has this sRGB code. A light without such bands stays.
    LightColour(usize, [u8; 3]),
    /// Replaces the clip planes.
    Clip(Clip),
    /// Replaces all terms by these intervals.
    Intervals(Vec<Interval>),
    /// Lowest and highest value of what a field shows, by its index; its terms are stretched.
    FieldRange(usize, [f64; 2]),
    /// Moves the camera, for a picture of this width over height.
    Camera(Move, f64),
    /// Changes an interval of the transfer function, by the index of its term. An interval that no scene may state has
    /// no effect.
    Interval(usize, Interval),
    /// Adds an interval, before the scene's curves.
    AddInterval(Interval, GradientFactor),
    /// Removes a term of the transfer function, by its index.
    RemoveTerm(usize),
    /// Points of the factor on the opacity by the gradient magnitude; none is a factor of 1.
    GradientOpacity(GradientFactor),
    /// Factor of a term by the gradient magnitude, in place of that; without points, the term takes that one.
    TermGradient(usize, GradientFactor),
    /// Shape of a term, or none. One that no scene may state has no effect.
    TermShape(usize, Option<Arc<Shape>>),
    /// Material and opacity of a label, by its index among the declared labels.
    Label(usize, usize, f64),
    /// Restores the transfer function, the labels and what further fields show.
    ResetTransfer,
    /// Accuracy settings.
    Accuracy(Accuracy),
    /// Edits the palette. The picture does not change.
    Design(Step),
    /// Replaces spectra. Film with material weights needs no march; a colour model is fitted again.
    Spectra(Arc<Spectra>),
}

impl Edit {
    /// Kind of the edit for the undo history; a hand on a node is of the same kind as any other position of the hand.
    pub(super) fn kind(&self) -> Discriminant<Self> {
        match self {
            Self::HandOnNode(_) => std::mem::discriminant(&Self::Hand(DVec2::ZERO)),
            other => std::mem::discriminant(other),
        }
    }

    /// True if the edit mixes lights alone, which any plan has.
    fn leaves_march(&self) -> bool {
        matches!(
            self,
            Self::Weight(..)
                | Self::On(..)
                | Self::Solo(_)
                | Self::Normalise(_)
                | Self::Master(_)
                | Self::Hand(_)
                | Self::HandOnNode(_)
                | Self::NodePlace(..)
                | Self::Camera(..)
                | Self::Exposure(_)
                | Self::Tone(_)
                | Self::Backdrop(_)
        )
    }

    /// Whether the edit does not affect the lights and their mix.
    #[must_use]
    pub fn leaves_light(&self) -> bool {
        match self {
            Self::Camera(..)
            | Self::Shadows(..)
            | Self::Phase(..)
            | Self::Film(..)
            | Self::Blending(_)
            | Self::Lighting(_)
            | Self::AmbientShares(_)
            | Self::Orders(_)
            | Self::Reach(_)
            | Self::Interval(..)
            | Self::AddInterval(..)
            | Self::RemoveTerm(_)
            | Self::GradientOpacity(_)
            | Self::TermGradient(..)
            | Self::TermShape(..)
            | Self::Intervals(_)
            | Self::FieldRange(..)
            | Self::Crop(_)
            | Self::ResetCrop
            | Self::Clip(_)
            | Self::Label(..)
            | Self::ResetTransfer
            | Self::Accuracy(_)
            | Self::LightColour(..)
            | Self::Overlap(_)
            | Self::Hidden(..)
            | Self::Occludes(..)
            | Self::Spectra(_) => true,
            Self::Weight(..)
            | Self::On(..)
            | Self::Solo(_)
            | Self::Mix(_)
            | Self::Normalise(_)
            | Self::Master(_)
            | Self::Hand(_)
            | Self::HandOnNode(_)
            | Self::NodePlace(..)
            | Self::NodeOn(..)
            | Self::ResetDial
            | Self::Polygon
            | Self::DialPreset(_)
            | Self::Keep(_)
            | Self::Rename(..)
            | Self::Forget(_)
            | Self::Tour(..)
            | Self::Exposure(_)
            | Self::Tone(_)
            | Self::Backdrop(_)
            | Self::Adapt(_)
            | Self::Observer(_)
            | Self::Deficiency(_)
            | Self::Design(_) => false,
        }
    }
}

/// The nodes of the dial as in `opened`, all of them on; a session may have some off.
#[must_use]
pub fn reset_nodes(opened: &SceneFile) -> Vec<DialNode> {
    opened.dial.nodes.iter().map(|node| DialNode { on: true, ..node.clone() }).collect()
}

/// The nodes of `dial` at the corners of a regular polygon, all of them on.
#[must_use]
pub fn polygon(dial: &Dial) -> Vec<DialNode> {
    Dial::regular(dial.nodes.iter().map(|node| node.light.as_str())).nodes
}

/// Switches the nodes of a dial preset on or off, by its index, relative to the dial as opened.
fn take_part(dial: &mut Dial, opened: &SceneFile, index: usize) {
    let Some(preset) = dial.presets.get(index) else { return };
    for (node, stated) in dial.nodes.iter_mut().zip(&opened.dial.nodes) {
        node.on = preset.has_on(stated);
    }
}

fn redesign(palette: &mut Option<Arc<Palette>>, step: &Step, scene: &Scene) {
    if let Some(next) = step.applied(scene, palette.as_deref()) {
        *palette = Some(Arc::new(next));
    }
}

/// Declared labels of `scene`.
fn declared(scene: &Scene) -> &[LabelEntry] {
    scene.labels.as_ref().map_or(&[], |labels| &labels.declared)
}

fn factor(number: f64) -> f64 {
    if number.is_finite() { number.clamp(0.0, BRIGHTEST) } else { 1.0 }
}

/// The nearest points that a scene may state as `gradient_opacity`.
fn gradient_points(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let finite = points.iter().filter(|point| point.0.is_finite() && point.1.is_finite());
    let mut points: Vec<_> = finite.map(|&(magnitude, factor)| (magnitude.max(0.0), factor.clamp(0.0, 1.0))).collect();
    points.sort_by(|one, other| one.0.total_cmp(&other.0));
    points.dedup_by(|next, one| next.0 <= one.0);
    points.truncate(GRADIENT_POINTS);
    points
}

fn finite(place: DVec2) -> DVec2 {
    if place.is_finite() { place.clamp(DVec2::splat(-1e6), DVec2::splat(1e6)) } else { DVec2::ZERO }
}

/// Smallest fraction of an axis in a crop box.
pub const THINNEST: f64 = 1e-3;

/// Opposite corners of a crop box in voxel indices, from fractions of a volume of `dims` voxels.
fn crop_from_parts([low, high]: [DVec3; 2], dims: [usize; 3]) -> [DVec3; 2] {
    let last = DVec3::from_array(dims.map(count)) - 1.0;
    let part = |part: f64| if part.is_nan() { 0.0 } else { part.clamp(0.0, 1.0) };
    let [low, high] = [low, high].map(|corner| DVec3::from_array(corner.to_array().map(part)));
    let (low, high) = (low.min(high).min(DVec3::splat(1.0 - THINNEST)), low.max(high));
    [low * last, high.max(low + THINNEST).min(DVec3::ONE) * last]
}

impl State {
    /// Opposite corners of the crop box in fractions of the volume, from 0 to 1; `None` is the whole volume.
    #[must_use]
    pub fn crop(&self) -> Option<[DVec3; 2]> {
        let last = DVec3::from_array(self.scene.frame.geometry.dims.map(count)) - 1.0;
        // An axis of one voxel is always complete.
        let part =
            |corner: DVec3, of_one: f64| DVec3::select(last.cmpgt(DVec3::ZERO), corner / last, DVec3::splat(of_one));
        self.scene.crop.map(|[low, high]| [part(low, 0.0), part(high, 1.0)])
    }

    /// Initial state of a scene, which `relume render` renders.
    #[must_use]
    pub fn new(file: &SceneFile) -> Self {
        let SceneFile { scene, dial, light, .. } = file.clone();
        Self { scene, dial, light, palette: design::stated(file) }
    }

    /// Current mix, at the light positions of the scene.
    #[must_use]
    pub fn mix(&self) -> Mix {
        self.light.mix(Mix::of_scene(&self.scene), &self.scene.lights, &self.dial)
    }

    /// Weight of each of the scene's lights as a multiple of its stated intensity: the equivalent sliders.
    #[must_use]
    pub fn shares(&self) -> Vec<f64> {
        let mix = self.mix();
        let share = |light: &relume_scene::SceneLight| {
            // Not `sum`, which is −0 for no terms.
            let weight = mix.0.iter().filter(|one| one.name == light.name).fold(0.0, |sum, one| sum + one.weight);
            if light.intensity > 0.0 { weight / light.intensity } else { 0.0 }
        };
        self.scene.lights.iter().map(share).collect()
    }

    /// Whether any light shines, at an exposure above 0.
    #[must_use]
    pub fn is_lit(&self) -> bool {
        self.mix().0.iter().any(|light| light.weight > 0.0) && self.scene.display.factor() > 0.0
    }

    /// The light of swatches: the current one, or in the dark that of the scene, because black swatches tell nothing.
    #[must_use]
    pub fn mix_of_swatches(&self) -> Mix {
        if self.is_lit() { self.mix() } else { Mix::of_scene(&self.scene) }
    }

    /// Normalisation and master of the sliders or the dial, whichever is in use.
    #[must_use]
    pub fn master(&self) -> (bool, f64) {
        match self.light.mixing {
            Mixing::Sliders => (self.light.normalise, self.light.master),
            Mixing::Dial => (self.dial.normalise, self.dial.master),
        }
    }

    /// Whether both states save the same session.
    #[must_use]
    pub fn writes_as(&self, other: &Self) -> bool {
        let Self { scene, dial, light, palette } = self;
        // Destructured without `..`: a new field does not compile until this function decides whether sessions contain
        // it.
        let Scene {
            name: _,
            frame: _,
            fields,
            labels: _,
            materials,
            transfer,
            lights,
            blending,
            overlap,
            hidden,
            shading: _,
            lighting,
            background,
            camera,
            crop,
            clip,
            block: _,
            accuracy,
            shadows,
            scattering,
            display,
        } = scene;
        let to = &other.scene;
        (dial, light, palette) == (&other.dial, &other.light, &other.palette)
            && (camera, crop, clip) == (&to.camera, &to.crop, &to.clip)
            && (accuracy, display) == (&to.accuracy, &to.display)
            && (*blending, *overlap, *lighting, *shadows) == (to.blending, to.overlap, to.lighting, to.shadows)
            && (*scattering, *hidden) == (to.scattering, to.hidden)
            && (materials, lights, background) == (&to.materials, &to.lights, &to.background)
            && (transfer, declared(scene)) == (&to.transfer, declared(to))
            && fields.terms() == to.fields.terms()
    }

    pub(super) fn apply(&mut self, edit: &Edit, opened: &SceneFile) {
        let shares = self.shares();
        let (light, dial, scene) = (&mut self.light, &mut self.dial, &mut self.scene);
        let before = (!edit.leaves_march()).then(|| scene.clone());
        match *edit {
            Edit::Weight(index, weight) => {
                if light.mixing == Mixing::Dial {
                    // The picture does not change: the sliders take over the mix of the dial.
                    *light = LightState {
                        mixing: Mixing::Sliders,
                        sliders: shares.into_iter().map(|weight| Slider { weight, on: true }).collect(),
                        solo: None,
                        normalise: false,
                        master: 1.0,
                        ..*light
                    };
                }
                if let Some(slider) = light.sliders.get_mut(index) {
                    slider.weight = factor(weight);
                }
            }
            Edit::On(index, on) => {
                if let Some(slider) = light.sliders.get_mut(index) {
                    slider.on = on;
                }
            }
            Edit::Shadows(index, shadows) => {
                if let Some(light) = scene.lights.get_mut(index) {
                    light.shadows = shadows;
                }
            }
            Edit::Phase(index, phase) => {
                if let Some(material) = scene.materials.get_mut(index).filter(|_| phase.is_finite()) {
                    material.phase = phase.clamp(*PHASES.start(), *PHASES.end());
                }
            }
            Edit::Film(index, ref film) => {
                if let Some(material) = scene.materials.get_mut(index) {
                    material.film.clone_from(film);
                }
            }
            Edit::Blending(blending) => scene.blending = blending,
            Edit::Lighting(lighting) => scene.lighting = lighting,
            Edit::AmbientShares(ambient) => scene.shadows.ambient = ambient,
            Edit::Orders(orders) => scene.scattering.orders = orders,
            Edit::Reach(reach) => {
                let finite = reach.filter(|reach| reach.is_finite());
                scene.shadows.reach = finite.map(|reach| reach.max(scene.least_reach()));
            }
            Edit::Solo(solo) => {
                light.mixing = Mixing::Sliders;
                light.solo = solo.filter(|&index| index < scene.lights.len());
            }
            Edit::Mix(mixing) => light.mixing = mixing,
            Edit::Normalise(on) => match light.mixing {
                Mixing::Sliders => light.normalise = on,
                Mixing::Dial => dial.normalise = on,
            },
            Edit::Master(master) => match light.mixing {
                Mixing::Sliders => light.master = factor(master),
                Mixing::Dial => dial.master = factor(master),
            },
            Edit::Hand(hand) => (light.mixing, light.hand) = (Mixing::Dial, finite(hand)),
            Edit::HandOnNode(index) => {
                if let Some(node) = dial.nodes.get(index) {
                    (light.mixing, light.hand) = (Mixing::Dial, node.place);
                }
            }
            Edit::NodePlace(index, place) => {
                let mut nodes = dial.nodes.clone();
                if let Some(node) = nodes.get_mut(index) {
                    node.place = finite(place);
                    dial.rearrange(nodes, &opened.dial.nodes);
                }
            }
            Edit::NodeOn(index, on) => {
                if let Some(node) = dial.nodes.get_mut(index) {
                    node.on = on;
                }
            }
            Edit::ResetDial | Edit::Polygon => {
                let nodes = if *edit == Edit::Polygon { polygon(dial) } else { reset_nodes(opened) };
                // A hand on a node stays on it.
                if let Some(node) = dial.nodes.iter().position(|node| node.on && node.lies_at(light.hand)) {
                    light.hand = nodes.get(node).map_or(light.hand, |node| node.place);
                }
                dial.rearrange(nodes, &opened.dial.nodes);
            }
            Edit::DialPreset(index) => {
                if let Some(hand) = dial.presets.get(index).map(|preset| preset.hand) {
                    take_part(dial, opened, index);
                    (light.mixing, light.hand) = (Mixing::Dial, hand);
                }
            }
            Edit::Keep(ref name) => {
                // All nodes, because the dial's own selection may differ when the session is opened again.
                let (on, off): (Vec<_>, Vec<_>) = dial.nodes.iter().partition(|node| node.on);
                let [on, off] = [on, off].map(|nodes| nodes.into_iter().map(|node| node.light.clone()).collect());
                let kept = |caption| DialPreset { name: name.clone(), caption, hand: light.hand, off, on };
                match dial.presets.iter_mut().find(|preset| preset.name == *name) {
                    Some(preset) => *preset = kept(std::mem::take(&mut preset.caption)),
                    None if name.is_empty() => {}
                    None => dial.presets.push(kept(String::new())),
                }
            }
            Edit::Rename(index, ref name) => {
                let is_free = !name.is_empty() && dial.presets.iter().all(|one| one.name != *name);
                if let Some(preset) = dial.presets.get_mut(index).filter(|_| is_free) {
                    preset.name.clone_from(name);
                }
            }
            Edit::Forget(index) => {
                if index < dial.presets.len() {
                    dial.presets.remove(index);
                }
            }
            Edit::Tour(step, of) => {
                let stops: Vec<DVec2> = dial.presets.iter().map(|preset| preset.hand).collect();
                if let Some((at, hand)) = along(&stops, step, of) {
                    take_part(dial, opened, at);
                    (light.mixing, light.hand) = (Mixing::Dial, hand);
                }
            }
            Edit::Observer(observer) => scene.display.observer = observer,
            Edit::Deficiency(deficiency) => scene.display.deficiency = deficiency,
            Edit::Crop(parts) => {
                scene.crop = parts.map(|parts| crop_from_parts(parts, scene.frame.geometry.dims));
            }
            Edit::ResetCrop => scene.crop = opened.scene.crop,
            Edit::Overlap(overlap) => scene.overlap = overlap,
            Edit::Hidden(index, hides) => {
                if let Some(hidden) = scene.hidden.get_mut(index).filter(|_| index < scene.fields.iter().count()) {
                    *hidden = hides;
                }
            }
            Edit::Occludes(index, part) => {
                // A dense material that occludes nothing would scatter infinite light.
                let is_opaque = scene.has_opaque(index);
                if let Some(material) = scene.materials.get_mut(index) {
                    let least = if is_opaque { LEAST_OF_OPAQUE } else { 0.0 };
                    material.occludes = if part.is_nan() { 1.0 } else { part.clamp(least, 1.0) };
                }
            }
            Edit::LightColour(index, code) => {
                let surfaces: Vec<Spectrum> =
                    scene.materials.iter().map(|material| material.reflectance.spectrum().clone()).collect();
                let colour = code.map(|part| f64::from(part) / 255.0);
                if let Some(light) = scene.lights.get_mut(index)
                    && let Some((spectrum, factor)) = in_colour(&light.spectrum, surfaces.iter(), colour)
                {
                    light.intensity = (light.intensity * factor).clamp(*INTENSITY.start(), *INTENSITY.end());
                    light.spectrum = spectrum;
                }
            }
            Edit::Clip(ref clip) => scene.clip = clip.allowed(),
            Edit::Intervals(ref intervals) => {
                let allowed = intervals.iter().filter_map(|interval| interval.allowed(&scene.materials));
                scene.transfer.terms = allowed.map(|interval| interval.term()).collect();
            }
            Edit::FieldRange(index, range) => scene.stretch(index, range),
            Edit::Exposure(exposure) => {
                scene.display.exposure = exposure;
                key::clamp(scene, "display.");
            }
            Edit::Tone(tone) => scene.display.tone = tone,
            Edit::Backdrop(backdrop) => scene.display.backdrop = backdrop,
            Edit::Adapt(adapt) => scene.display.adapt = adapt,
            Edit::Camera(step, aspect) => {
                scene.camera = moves::moved(scene, &opened.scene.camera, aspect, step);
            }
            Edit::Interval(index, interval) => {
                if let (Some(interval), Some(term)) =
                    (interval.allowed(&scene.materials), scene.transfer.terms.get_mut(index))
                {
                    let (gradient, by) = (std::mem::take(&mut term.gradient), std::mem::take(&mut term.by));
                    *term = Term { gradient, by, shape: term.shape.take(), ..interval.term() };
                }
            }
            Edit::AddInterval(interval, ref gradient) => {
                let terms = &mut scene.transfer.terms;
                // A file states its intervals before its curves, and sums follow the order of the file.
                let end = terms.iter().position(|term| term.as_interval().is_none()).unwrap_or(terms.len());
                if let Some(interval) = interval.allowed(&scene.materials) {
                    terms.insert(end, Term { gradient: gradient_points(gradient), ..interval.term() });
                }
            }
            Edit::RemoveTerm(index) => {
                if index < scene.transfer.terms.len() {
                    scene.transfer.terms.remove(index);
                }
            }
            Edit::GradientOpacity(ref points) => scene.transfer.gradient_opacity = gradient_points(points),
            Edit::TermGradient(index, ref points) => {
                // Files state one for intervals alone; the others would lose theirs in a session.
                let term = scene.transfer.terms.get_mut(index).filter(|term| term.as_interval().is_some());
                if let Some(term) = term {
                    term.gradient = gradient_points(points);
                }
            }
            Edit::TermShape(index, ref shape) => {
                let term = scene.transfer.terms.get_mut(index).filter(|term| term.as_interval().is_some());
                let is_allowed = shape.as_ref().is_none_or(|shape| shape.is_allowed());
                if let Some(term) = term.filter(|_| is_allowed) {
                    term.shape.clone_from(shape);
                }
            }
            Edit::Label(index, material, opacity) => {
                let entry = scene.labels.as_mut().and_then(|labels| labels.declared.get_mut(index));
                // Those by value keep their terms.
                let entry = entry.filter(|entry| entry.terms.is_empty());
                if let (Some(entry), Some(shown)) = (entry, scene.materials.get(material)) {
                    (entry.material, entry.opacity) = (material, shown.allowed_opacity(opacity));
                    if shown.absorption.is_none() {
                        entry.absorption = 0.0;
                    }
                }
            }
            Edit::ResetTransfer => {
                scene.transfer.clone_from(&opened.scene.transfer);
                scene.labels.clone_from(&opened.scene.labels);
                let further = opened.scene.fields.further().iter().enumerate();
                further.for_each(|(index, field)| scene.fields.show(index, field.terms.clone()));
            }
            Edit::Design(ref step) => redesign(&mut self.palette, step, scene),
            Edit::Spectra(ref spectra) => {
                spectra.put_into(scene);
                spectra.step.iter().for_each(|step| redesign(&mut self.palette, step, scene));
            }
            Edit::Accuracy(ref accuracy) => {
                scene.accuracy.clone_from(accuracy);
                key::clamp(scene, "accuracy.");
            }
        }
        // More would be no scene that a file may state.
        if scene.transfer.factors().len() > FACTORS || scene.groups().len() > MOST_GROUPS {
            before.iter().for_each(|before| scene.transfer.clone_from(&before.transfer));
        }
        // Nor one that no march can show: a session of it could not be opened.
        if let Some(before) = before
            && scene.refused().is_some()
            && before.refused().is_none()
        {
            *scene = before;
        }
        light.preset = match *edit {
            Edit::DialPreset(index) => Some(index).filter(|&index| index < dial.presets.len()),
            Edit::Keep(ref name) => dial.presets.iter().position(|preset| preset.name == *name),
            Edit::Tour(..) => dial.presets.iter().rposition(|preset| preset.hand == light.hand),
            // On a node only its light shines, whatever the positions of the others.
            Edit::NodePlace(..) | Edit::ResetDial | Edit::Polygon => light.preset.filter(|&index| {
                let is_on = dial.nodes.iter().any(|node| node.on && node.lies_at(light.hand));
                is_on && dial.presets.get(index).is_some_and(|preset| preset.hand == light.hand)
            }),
            Edit::Exposure(_)
            | Edit::Tone(_)
            | Edit::Backdrop(_)
            | Edit::Adapt(_)
            | Edit::Observer(_)
            | Edit::Deficiency(_)
            | Edit::Rename(..)
            | Edit::Design(_) => light.preset,
            _ if edit.leaves_light() => light.preset,
            _ => None,
        };
    }
}
