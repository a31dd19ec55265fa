//! The scene: materials, transfer function, lights, camera, and their volume.
#![forbid(unsafe_code)]

mod blocks;
mod camera;
mod clip;
mod coarse;
mod curve;
mod digest;
mod fields;
pub mod film;
mod frame;
pub mod key;
mod lights;
pub mod plan;
pub mod reference;
mod scattering;
mod shape;
pub mod tables;
mod transfer;
mod turned;

use std::sync::Arc;

use glam::DVec3;

pub use blocks::{Block, Blocks, MOST_BLOCKS, Node, low_leaves};
pub use camera::{Aim, Camera, Fill, Projection, View};
pub use camera::{centre, unit};
pub use clip::{CLIP_PLANES, Clip, ClipPlane, Keep};
pub use coarse::{Coarse, LabelLeft, Level};
pub use curve::factor_at;
pub use fields::{FIELDS, FIRST_FIELD, Field, Fields, MOST_GROUPS};
pub use frame::Frame;
pub use lights::{BRIGHTEST, INTENSITY};
pub use lights::{Direction, LightKind, Mix, MixLight, Placement, Position, positions, three_point};
pub use scattering::{Half, Orders, Scattering, ScatteringMethod, USUAL_DIRECTIONS};
pub use shape::{Form, MOST_CORNERS, Painting, SHAPE_EDGE, SOFT, Second, Shape};
pub use transfer::depth_from_opacity;
pub use transfer::{
    Depths, FACTORS, Factors, FieldFactor, GRADIENT_POINTS, GradientFactor, Interval, Lookup, MaterialCurve, Medium,
    OPAQUE_DEPTH, Term, Transfer, different_factors, stretched,
};
pub use turned::Turned;

use relume_colour::model::ModelKind;
use relume_colour::spectrum::deficiency::Deficiency;
use relume_colour::spectrum::observer::Observer;
use relume_colour::spectrum::{Absorption, Light, Reflectance, ThinFilm, ThinFilmAngle};
use relume_volume::Volume;

/// Everything that affects a picture, resolved: no names to look up, no files to read.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Name, for messages and reports.
    pub name: String,
    /// World, unit and box: where all the following are.
    pub frame: Frame,
    /// The values at each place of the frame.
    pub fields: Fields,
    /// Label map on the grid of the frame, if any.
    pub labels: Option<Labels>,
    /// Materials in the order of their names, which is also the order of a pixel's weights.
    pub materials: Vec<Material>,
    /// Transfer function.
    pub transfer: Transfer,
    /// Lights in the order of their names.
    pub lights: Vec<SceneLight>,
    /// Rule that blends the values along a ray.
    pub blending: Blending,
    /// Rule for places where several fields have a medium.
    pub overlap: Overlap,
    /// Fields that show nothing, by their indices; factors by their values stay.
    pub hidden: [bool; FIELDS],
    /// Whether lights shade by direction.
    pub shading: Shading,
    /// Sides of a surface that directed lights shade.
    pub lighting: Lighting,
    /// Background surface, lit by every light; `None` is black and costs nothing.
    pub background: Option<Reflectance>,
    /// Camera.
    pub camera: Camera,
    /// Crop box: opposite corners in voxel indices; `None` is the whole volume.
    pub crop: Option<[DVec3; 2]>,
    /// Clip planes.
    pub clip: Clip,
    /// The block to march, if only one: a part of the picture. Gradients and shadows are those of the whole volume.
    pub block: Option<Block>,
    /// Accuracy settings.
    pub accuracy: Accuracy,
    /// Computation of shadows; each light states whether it casts them.
    pub shadows: Shadows,
    /// Light that scatters more than once.
    pub scattering: Scattering,
    /// Conversion of colours for the screen.
    pub display: Display,
}

impl Scene {
    /// Step length of a march: that of [`Accuracy`], but no longer than any ray in the volume. The opacity of a longer step
    /// would tell nothing of the part inside.
    #[must_use]
    pub fn step_length(&self) -> f64 {
        let geometry = &self.frame.geometry;
        let longest = (geometry.spacing * DVec3::from_array(geometry.dims.map(relume_base::number::count))).length();
        self.accuracy.step_length.min(longest)
    }

    /// Number of steps, the cut ones included, of the longest ray in the volume.
    #[must_use]
    pub fn most_steps(&self) -> f64 {
        self.steps_across(self.frame.whole_box())
    }

    /// Number of steps, the cut ones included, along the diagonal between two corners in voxel indices.
    pub(crate) fn steps_across(&self, [first, last]: [DVec3; 2]) -> f64 {
        // An axis with a single voxel is one voxel thick.
        let thickness = DVec3::select(self.frame.thin_axes().into(), DVec3::ONE, last - first);
        ((thickness * self.frame.geometry.spacing).length() / self.step_length()).ceil() + 1.0
    }

    /// A scene of `volume` without materials and lights. The step and the opacity length are the smallest spacing; all
    /// other settings are those of a scene file that states none.
    #[must_use]
    pub fn new(name: &str, volume: Arc<Volume>) -> Self {
        let spacing = volume.geometry.spacing.min_element();
        Self {
            name: name.to_owned(),
            frame: Frame::of(&volume),
            fields: Fields::of(volume),
            labels: None,
            materials: Vec::new(),
            transfer: Transfer {
                opacity_length: spacing,
                lookup: Lookup::default(),
                entries: None,
                terms: Vec::new(),
                gradient_opacity: Vec::new(),
            },
            lights: Vec::new(),
            blending: Blending::default(),
            overlap: Overlap::default(),
            hidden: [false; FIELDS],
            shading: Shading::default(),
            lighting: Lighting::default(),
            background: None,
            camera: Camera::default(),
            crop: None,
            clip: Clip::default(),
            block: None,
            accuracy: Accuracy::new(spacing),
            shadows: Shadows::default(),
            scattering: Scattering::default(),
            display: Display::default(),
        }
    }

    /// Why no march can show the scene, as far as that does not depend on its colours.
    #[must_use]
    pub fn refused(&self) -> Option<plan::PlanError> {
        plan::refused(self)
    }

    /// Volume of the first field, whose grid is that of the frame: the one that texts, slices and histograms are about.
    #[must_use]
    pub fn volume(&self) -> &Arc<Volume> {
        &self.fields.first().volume
    }

    /// Puts `volume` in place of all fields, with its frame. All else stays, the step length and labels too; factors by the value of another
    /// field are those outside its box.
    pub fn set_volume(&mut self, volume: Arc<Volume>) {
        self.frame = Frame::of(&volume);
        self.fields = Fields::of(volume);
    }

    /// The scene with `volume` in place of all its fields ([`Self::set_volume`]).
    #[must_use]
    pub fn with_volume(mut self, volume: Arc<Volume>) -> Self {
        self.set_volume(volume);
        self
    }

    /// Terms of field `index`: none if it is hidden.
    #[must_use]
    pub fn terms_of(&self, index: usize) -> &[Term] {
        if self.hidden.get(index).is_some_and(|hidden| *hidden) { &[] } else { self.own_terms_of(index) }
    }

    /// Terms of field `index`, hidden or not.
    #[must_use]
    pub fn own_terms_of(&self, index: usize) -> &[Term] {
        match index.checked_sub(1) {
            None => &self.transfer.terms,
            Some(further) => self.fields.further().get(further).map_or(&[], |field| &field.terms),
        }
    }

    /// Lowest and highest value at a point of the terms of field `index`; `None` without two of them.
    #[must_use]
    pub fn range_of(&self, index: usize) -> Option<[f64; 2]> {
        transfer::range_of(self.own_terms_of(index))
    }

    /// Stretches the terms of field `index` to other values, of which the first is lower. A range without a width has no effect.
    pub fn stretch(&mut self, index: usize, to: [f64; 2]) {
        let Some(terms) = stretched(self.own_terms_of(index), to) else { return };
        match index.checked_sub(1) {
            None => self.transfer.terms = terms,
            Some(further) => self.fields.show(further, terms),
        }
    }

    /// Groups of terms that a march looks up apart, those of the first field first: at least one, even if nothing is shown.
    #[must_use]
    pub fn groups(&self) -> Vec<Group<'_>> {
        let mut groups = Vec::new();
        for field in 0..=self.fields.further().len() {
            // The factor of all is that of the first field.
            let all = if field == 0 { &self.transfer.gradient_opacity[..] } else { &[] };
            let factors = different_factors(self.terms_of(field), all).into_iter();
            groups.extend(factors.map(|factors| Group { field, factors }));
        }
        if groups.is_empty() {
            groups.push(Group { field: 0, factors: Factors::default() });
        }
        groups
    }

    /// Whether the material `index` is visible, through a value of the transfer function or a label.
    #[must_use]
    pub fn shows(&self, index: usize) -> bool {
        self.uses(index, |term| &term.opacity, |entry| entry.opacity)
    }

    /// True if the material `index` has an opacity of 1 at some value or as a label, of hidden fields too.
    #[must_use]
    pub fn has_opaque(&self, index: usize) -> bool {
        let is_opaque = |term: &Term| {
            term.opacity.iter().any(|point| point.1 >= 1.0) && term.material.0.iter().any(|point| point.1 == index)
        };
        let labels = self.declared();
        (0..=self.fields.further().len()).any(|field| self.own_terms_of(field).iter().any(is_opaque))
            || labels.iter().flat_map(|entry| &entry.terms).any(is_opaque)
            || labels.iter().any(|it| it.terms.is_empty() && it.material == index && it.opacity >= 1.0)
    }

    /// Whether the material `index` is visible through a value of the transfer function.
    #[must_use]
    pub fn shows_values_as(&self, index: usize) -> bool {
        self.field_terms().any(|term| shows_as(term, index, |term| &term.opacity))
    }

    /// True if the light `index` casts shadows that change the picture: they take ambient light, light without shading, and
    /// the diffuse and specular parts of shaded light. Light that scatters often is dimmed on all its ways, so every light does.
    #[must_use]
    pub fn casts_shadows(&self, index: usize) -> bool {
        let casts = |light: &&SceneLight| (light.shadows || self.scatters_often()) && !self.blending.is_extreme();
        let Some(light) = self.lights.get(index).filter(casts) else {
            return false;
        };
        let shaded =
            |(i, material): (usize, &Material)| self.shows(i) && (material.diffuse > 0.0 || material.specular > 0.0);
        light.placement == Placement::Ambient
            || self.shading == Shading::None
            || self.materials.iter().enumerate().any(shaded)
    }

    /// Whether phase functions change the picture: those of visible materials without shading.
    #[must_use]
    pub fn has_phases(&self) -> bool {
        self.shading == Shading::None && !self.blending.is_extreme() && self.states_phases().next().is_some()
    }

    /// Visible materials with a phase function other than the even one.
    pub(crate) fn states_phases(&self) -> impl Iterator<Item = &Material> {
        let shown = self.materials.iter().enumerate().filter(|&(index, _)| self.shows(index));
        shown.map(|(_, material)| material).filter(|material| material.phase != 0.0)
    }

    /// Visible materials with a film.
    pub(crate) fn states_thin_films(&self) -> impl Iterator<Item = &Material> {
        let shown = self.materials.iter().enumerate().filter(|&(index, _)| self.shows(index));
        shown.map(|(_, material)| material).filter(|material| material.film.is_some())
    }

    /// True if the scene asks for any shadows, or for scattered light, which casts them.
    #[must_use]
    pub fn asks_for_shadows(&self) -> bool {
        self.scatters_often()
            || self.shadows.ambient == AmbientShares::Occluded
            || self.lights.iter().any(|light| light.shadows)
    }

    /// Distance from a sample within which nothing shades it, in voxels along the axis with the smallest spacing. By default 3 where
    /// gradients shade, because a surface would otherwise shade itself, else 0.
    #[must_use]
    pub fn shadow_start(&self) -> f64 {
        let usual = if self.shading == Shading::Gradient { 3.0 } else { 0.0 };
        self.shadows.start.unwrap_or(usual)
    }

    /// The least [`Shadows::reach`] within which the light grid has a node, in world units: the start of shadows, and a space
    /// of the grid along the axis with the largest spacing.
    #[must_use]
    pub fn least_reach(&self) -> f64 {
        let voxel = self.frame.geometry.spacing;
        self.shadow_start().mul_add(voxel.min_element(), self.shadows.spacing * voxel.max_element())
    }

    /// Whether the material `index` absorbs light, through a value of the transfer function or a label.
    #[must_use]
    pub fn absorbs(&self, index: usize) -> bool {
        self.materials.get(index).is_some_and(|material| material.absorption.is_some())
            && self.uses(index, |term| &term.absorption, |entry| entry.absorption)
    }

    fn uses(
        &self,
        index: usize,
        height: impl Fn(&Term) -> &Vec<(f64, f64)>,
        of_label: impl Fn(&LabelEntry) -> f64,
    ) -> bool {
        let in_transfer = self.all_terms().any(|term| shows_as(term, index, &height));
        let in_labels =
            self.declared().iter().any(|it| it.terms.is_empty() && it.material == index && of_label(it) > 0.0);
        in_transfer || in_labels
    }

    /// The labels that the scene declares.
    #[must_use]
    pub fn declared(&self) -> &[LabelEntry] {
        self.labels.as_ref().map_or(&[], |labels| &labels.declared)
    }

    /// The terms of all fields that are not hidden.
    fn field_terms(&self) -> impl Iterator<Item = &Term> {
        (0..=self.fields.further().len()).flat_map(|field| self.terms_of(field))
    }

    /// The terms of all fields, and those of labels by value.
    pub(crate) fn all_terms(&self) -> impl Iterator<Item = &Term> {
        self.field_terms().chain(self.declared().iter().flat_map(|entry| &entry.terms))
    }
}

/// True if a curve of `term` is anywhere above 0, and its materials have the one with this index.
fn shows_as<'a>(term: &'a Term, index: usize, curve: impl Fn(&'a Term) -> &'a Vec<(f64, f64)>) -> bool {
    curve(term).iter().any(|point| point.1 > 0.0) && term.material.0.iter().any(|point| point.1 == index)
}

/// Terms of a field with equal factors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Group<'a> {
    /// Index of the field.
    pub field: usize,
    /// The factors on them.
    pub factors: Factors<'a>,
}

/// A spectral material.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Its name in the scene.
    pub name: String,
    /// Reflectance of its ambient and diffuse parts.
    pub reflectance: Reflectance,
    /// Absorption spectrum, if it absorbs; the transfer function gives its strength.
    pub absorption: Option<Absorption>,
    /// Ambient factor of a directed light, 0 to 1.
    pub ambient: f64,
    /// Diffuse factor, which multiplies |n·l| or, with one-sided lighting, max(n·l, 0), 0 to 1.
    pub diffuse: f64,
    /// Specular factor, which multiplies |n·h|^exponent in the light's own colour, 0 to 1.
    pub specular: f64,
    /// Exponent of the specular part.
    pub exponent: u32,
    /// Part of its scattering that occludes what is behind, 0 to 1: all of it by default. One of 0 is an X-ray material, which adds light but
    /// occludes nothing (§5.2 of the paper).
    pub occludes: f64,
    /// Mean cosine of the angle by which a scattered ray turns, in [`PHASES`]: 0 scatters evenly in all directions, a
    /// positive number mostly forwards. It has an effect in scenes without shading (docs/theory/phase-functions.md).
    pub phase: f64,
    /// Thin film on its surfaces. With gradient shading, it is the reflectance of directed light in place of the material's
    /// own, or of the white of the highlights (docs/theory/thin-films.md).
    pub film: Option<ThinFilm>,
}

impl Material {
    /// A diffuse material of this `reflectance`: ambient 0.2, diffuse 0.8, without highlights and absorption.
    #[must_use]
    pub fn new(name: &str, reflectance: Reflectance) -> Self {
        Self {
            name: name.to_owned(),
            reflectance,
            absorption: None,
            ambient: 0.2,
            diffuse: 0.8,
            specular: 0.0,
            exponent: 20,
            occludes: 1.0,
            phase: 0.0,
            film: None,
        }
    }

    /// True if light from all directions is alike to it: no diffuse part, no highlight.
    #[must_use]
    pub fn is_flat(&self) -> bool {
        self.diffuse <= 0.0 && self.specular <= 0.0
    }

    /// The film, if it reflects at this angle and its part of the light is not 0.
    pub(crate) fn thin_film_at(&self, angle: ThinFilmAngle) -> Option<&ThinFilm> {
        self.film.as_ref().filter(|film| film.angle() == angle && self.thin_film_factor(angle) > 0.0)
    }

    /// Factor of the light that a film at this angle reflects.
    pub(crate) fn thin_film_factor(&self, angle: ThinFilmAngle) -> f64 {
        match angle {
            ThinFilmAngle::Facing => self.diffuse,
            ThinFilmAngle::Lobe => self.specular,
        }
    }

    /// Diffuse factor of the material's own reflectance: 0 if a film takes its place.
    pub(crate) fn own_diffuse(&self) -> f64 {
        if self.thin_film_at(ThinFilmAngle::Facing).is_some() { 0.0 } else { self.diffuse }
    }

    /// Specular factor of white highlights: 0 if a film takes their place.
    pub(crate) fn white_specular(&self) -> f64 {
        if self.thin_film_at(ThinFilmAngle::Lobe).is_some() { 0.0 } else { self.specular }
    }

    /// True if it occludes nothing.
    #[must_use]
    pub fn is_xray(&self) -> bool {
        self.occludes <= 0.0
    }

    /// `opacity` clamped to the range of this material; an X-ray material never has opacity 1.
    #[must_use]
    pub fn allowed_opacity(&self, opacity: f64) -> f64 {
        let most = if self.is_xray() { 0.999 } else { 1.0 };
        if opacity.is_nan() { 0.0 } else { opacity.clamp(0.0, most) }
    }
}

/// The label map and its declared labels.
#[derive(Clone, Debug)]
pub struct Labels {
    /// One label per voxel, on the grid of the voxel values.
    pub volume: Arc<Volume>,
    /// Labels that the scene declares; undeclared labels follow the transfer function.
    pub declared: Vec<LabelEntry>,
}

/// Medium of a label.
#[derive(Clone, Debug, PartialEq)]
pub struct LabelEntry {
    /// The label.
    pub label: i64,
    /// Display name.
    pub name: String,
    /// Index into [`Scene::materials`].
    pub material: usize,
    /// Opacity: fraction of light lost over the opacity length, 0 to 1.
    pub opacity: f64,
    /// Optical depth of an opacity length at the peak of the material's absorption spectrum.
    pub absorption: f64,
    /// Terms over the values of the first field, in place of its material, opacity and absorption, which then are those of a legend. Empty
    /// shows the same at all values.
    pub terms: Vec<Term>,
}

impl LabelEntry {
    /// True if it shows anything.
    #[must_use]
    pub fn is_visible(&self) -> bool {
        self.opacity > 0.0 || self.absorption > 0.0
    }

    /// Its medium at a `value` of the first field, of a scene with so many `materials`.
    #[must_use]
    pub fn medium(&self, value: f64, materials: usize) -> Medium {
        if !self.terms.is_empty() {
            return transfer::medium_of(&self.terms, value, materials, |_| 1.0);
        }
        let mut medium = Medium::nothing(materials);
        if self.material < materials {
            medium.scattering[self.material] = depth_from_opacity(self.opacity);
            medium.absorption[self.material] = self.absorption;
        }
        medium
    }
}

/// A light of the scene.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneLight {
    /// Its name in the scene.
    pub name: String,
    /// Its spectrum: a perfect reflector under it has Y = 1.
    pub spectrum: Light,
    /// Factor of the spectrum.
    pub intensity: f64,
    /// Origin of the light.
    pub placement: Placement,
    /// Whether the medium between a sample and the light dims it.
    pub shadows: bool,
}

impl SceneLight {
    /// A headlight of this `spectrum` and intensity 1.
    #[must_use]
    pub fn new(name: &str, spectrum: Light) -> Self {
        Self { name: name.to_owned(), spectrum, intensity: 1.0, placement: Placement::Headlight, shadows: false }
    }
}

/// Computation of shadows (docs/theory/shadows.md).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shadows {
    /// Method that finds the light at a sample.
    pub method: ShadowMethod,
    /// Spacing of the light grid in voxels; the error of shadows is proportional to it, memory and time of the grid to
    /// its inverse cube.
    pub spacing: f64,
    /// Distance from a sample within which nothing shades it, in voxels along the axis with the smallest spacing; `None` follows
    /// [`Scene::shadow_start`].
    pub start: Option<f64>,
    /// Ambient shares of directed lights: open, or dimmed like ambient light with shadows.
    pub ambient: AmbientShares,
    /// Directions of an evenly bright sky, of which ambient light with shadows is the mean.
    pub directions: usize,
    /// Distance from a sample in world units beyond which nothing shades it from the sky; `None` for no limit. Other lights have none.
    pub reach: Option<f64>,
}

impl Default for Shadows {
    fn default() -> Self {
        Self {
            method: ShadowMethod::default(),
            spacing: 2.0,
            start: None,
            ambient: AmbientShares::default(),
            directions: 64,
            reach: None,
        }
    }
}

/// Ambient shares of directed lights.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum AmbientShares {
    /// They reach every sample.
    #[default]
    Open,
    /// The medium around a sample dims them: ambient occlusion.
    Occluded,
}

/// Method that finds the light at a sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ShadowMethod {
    /// From a grid of optical depths towards each light, which is filled once.
    #[default]
    Grid,
    /// By a ray from each sample to each light, in steps of a quarter of the smallest spacing, or of a shorter view step.
    /// Ambient light comes from a grid with half the spacing, from four times the directions; for one pixel, by a ray in each
    /// direction. For the reference only.
    Rays,
}

/// Rule that blends the values along a ray.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Blending {
    /// All of them, front to back: each step scatters light, and dims what is behind it.
    #[default]
    Composite,
    /// The largest value of each field, as an opacity length of its medium: a maximum intensity projection.
    Maximum,
    /// The smallest value of each field, likewise: a minimum intensity projection.
    Minimum,
}

impl Blending {
    /// True if a single value of each field is seen. It has no place, so all light reaches it whole: nothing is shaded, and nothing casts
    /// shadows.
    #[must_use]
    pub const fn is_extreme(self) -> bool {
        !matches!(self, Self::Composite)
    }

    /// Marks which of the entries of a table, in the order of their values, can decide a pixel, where these are `active`: a value beyond
    /// them may be the extreme one, and hides them.
    pub fn widen(self, active: &mut [bool]) {
        match self {
            Self::Composite => {}
            Self::Maximum => {
                if let Some(first) = active.iter().position(|&active| active) {
                    active[first..].fill(true);
                }
            }
            Self::Minimum => {
                if let Some(last) = active.iter().rposition(|&active| active) {
                    active[..=last].fill(true);
                }
            }
        }
    }
}

/// Rule for places where several fields have a medium.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Overlap {
    /// Their media together.
    #[default]
    Add,
    /// That of the first of them alone.
    First,
    /// That of the last of them alone: further volumes replace the first one.
    Last,
}

/// Shading of the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Shading {
    /// No shading: every light reaches every point equally.
    None,
    /// Ambient, diffuse and specular parts, by the gradient of the voxel values.
    #[default]
    Gradient,
}

/// Sides of a surface that directed lights shade. The normal n is −∇v/|∇v|: outward, if values fall outward.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Lighting {
    /// Both sides alike: |n·l| and |n·h|.
    #[default]
    TwoSided,
    /// The side towards lower values: max(n·l, 0), and max(n·h, 0) where n·l is positive.
    OneSided,
}

/// Interpolation between voxels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Interpolation {
    /// The value of the nearest voxel.
    Nearest,
    /// Trilinear, by the device's filter.
    #[default]
    Linear,
    /// Trilinear in f32: eight fetches instead of one. Reduces the device's error if its filter has few bits.
    ExactLinear,
    /// Cubic B-spline, 64 fetches: smoother surfaces, and softer details of one or two voxels.
    Cubic,
    /// Cubic B-spline along x alone, linear along the others by the device's filter, two fetches: for slices thicker than
    /// their pixels. Fields on grids of their own are interpolated linearly.
    CubicX,
    /// The same along y.
    CubicY,
    /// The same along z.
    CubicZ,
}

impl Interpolation {
    /// The axis of the grid along which alone the interpolation is cubic.
    #[must_use]
    pub const fn cubic_axis(self) -> Option<usize> {
        match self {
            Self::CubicX => Some(0),
            Self::CubicY => Some(1),
            Self::CubicZ => Some(2),
            Self::Nearest | Self::Linear | Self::ExactLinear | Self::Cubic => None,
        }
    }

    /// Interpolation of a field; linear across slices on a grid of its own.
    #[must_use]
    pub const fn of_field(self, is_placed: bool) -> Self {
        if is_placed && self.cubic_axis().is_some() { Self::Linear } else { self }
    }

    /// True if a value depends on four voxels along some axis.
    #[must_use]
    pub const fn is_cubic(self) -> bool {
        matches!(self, Self::Cubic) || self.cubic_axis().is_some()
    }

    /// True if the filter of the device interpolates.
    #[must_use]
    pub const fn is_filtered(self) -> bool {
        matches!(self, Self::Linear) || self.cubic_axis().is_some()
    }
}

/// Label of a place between voxels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum LabelInterpolation {
    /// The shares of the labels of the eight voxels around, by the weights of linear interpolation: smooth surfaces.
    #[default]
    Smooth,
    /// The label of the nearest voxel: surfaces are the faces of voxels.
    Nearest,
}

/// Integration of the medium along a ray.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Integration {
    /// Segments if an interval of the transfer function is narrower than values change in a step, otherwise samples.
    #[default]
    Auto,
    /// Segments between two values: means of the medium over the values in between, in closed form
    /// (docs/theory/segments.md).
    Segments,
    /// Point samples, one in the middle of each step.
    Samples,
    /// Point samples, and further ones between two that differ (docs/theory/refinement.md); samples alone where the plan
    /// cannot refine them.
    Adaptive,
}

/// Range of the parameter of a phase function.
pub const PHASES: std::ops::RangeInclusive<f64> = -0.99..=0.99;

/// Accuracy settings; each documents its cost and the error it affects. Their ranges are in [`key::SCENE`].
#[derive(Clone, Debug, PartialEq)]
pub struct Accuracy {
    /// Step length Δs in world units; time is proportional to 1/Δs, the step error of a smooth volume to Δs².
    pub step_length: f64,
    /// Termination threshold: a ray ends when its transmittance falls below this fraction. Changes a pixel by at most
    /// this fraction of the brightest light behind (docs/theory/numerics.md): 1/10000 of white behind black is ΔE00
    /// 0.05. 0 marches every ray to its end.
    pub termination: f64,
    /// Rays of a pixel: its accumulators are their mean, which smooths edges and relights as exactly as
    /// one ray. Time is proportional to their number.
    pub rays: usize,
    /// True if the steps of each ray begin at another part of a step (docs/theory/march.md), so that the lattice of the samples is seen as a fine
    /// grain and not as rings; the rays of a pixel then lie evenly between each other's samples.
    pub jitter: bool,
    /// Integration of the medium along a ray.
    pub integration: Integration,
    /// Variation of a segment: the largest change of a step's opacity, and of its shading, between the ends of a segment
    /// that is not divided (docs/theory/segments.md). A smaller one divides more segments. Of adaptive samples, it gives the bound on the
    /// difference to the samples beside, [`plan::refinement_bound`].
    pub variation: f64,
    /// Empty-space skipping; exact, so it affects no error.
    pub skipping: bool,
    /// Interpolation between voxels.
    pub interpolation: Interpolation,
    /// Label of a place between voxels.
    pub labels: LabelInterpolation,
    /// Storage of the volume.
    pub volume: VolumeAs,
    /// Source of gradients, if shading needs them.
    pub gradients: Gradients,
    /// Contents of pixels.
    pub accumulate: AccumulateAs,
    /// Kind of colour model for pixels without weights.
    pub model: ModelKind,
    /// Tolerance: the largest ΔE00 that the colour model may add. A smaller tolerance needs more numbers per pixel.
    pub tolerance: f64,
    /// Dimension k, if stated; `tolerance` is then ignored.
    pub dimension: Option<usize>,
    /// Largest size of a voxel in the picture, in pixels, up to which a coarser level of the volume takes its place
    /// ([`Scene::level`]); 0 always takes the volume itself. A level has an eighth of the voxels of
    /// the one before and half of the steps; its means fade what is thinner than a voxel.
    pub voxel_pixels: f64,
    /// Storage of finished accumulators: 16 bits halve the memory and change colours by at most
    /// [`Planned::half_precision_error`](crate::plan::Planned::half_precision_error).
    pub storage: StoreAs,
}

impl Accuracy {
    /// The default settings with this step length, in world units.
    #[must_use]
    pub fn new(step_length: f64) -> Self {
        Self {
            step_length,
            termination: 1e-4,
            rays: 1,
            jitter: false,
            integration: Integration::default(),
            variation: 1e-3,
            skipping: true,
            interpolation: Interpolation::default(),
            labels: LabelInterpolation::default(),
            volume: VolumeAs::default(),
            gradients: Gradients::default(),
            accumulate: AccumulateAs::default(),
            model: ModelKind::default(),
            tolerance: 1.0,
            dimension: None,
            voxel_pixels: 0.0,
            storage: StoreAs::default(),
        }
    }
}

/// Storage of voxels on a device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum VolumeAs {
    /// 16 bits if that is lossless, otherwise f32.
    #[default]
    Auto,
    /// f32: twice the memory, and gradients without rounding to 16 bits.
    Single,
    /// 16 bits, even with loss: half the memory of f32.
    Short,
}

/// Source of gradients.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Gradients {
    /// Central differences of voxels, stored with the values: four times the memory, one fetch.
    #[default]
    Packed,
    /// Central differences of values one voxel before and after a sample: seven fetches.
    Central,
}

/// Storage of finished accumulators.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum StoreAs {
    /// As accumulated, in f32.
    #[default]
    Single,
    /// Rounded to the nearest 16-bit float.
    Half,
}

/// Contents of pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum AccumulateAs {
    /// Weights if they are exact and need no more vectors than the coefficients of a colour model, otherwise
    /// coefficients.
    #[default]
    Auto,
    /// One weight per material; exact while all absorption is grey.
    Weights,
    /// A spectrum as k coefficients.
    Spectral,
}

/// Largest exposure.
pub const LARGEST_EXPOSURE: f64 = 1e9;
/// Largest automatic exposure, relative to the one at which a white surface is white.
pub const BRIGHTENED: f64 = 3.0;

/// Curve of the displayed colours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Tone {
    /// None: components above 1 are clipped, which changes hues.
    #[default]
    Linear,
    /// Components up to 0.75 as they are; brighter colours approach 1 and keep their hue and saturation.
    Soft,
}

/// Colours of the screen behind the volume, which no light changes and no linear picture has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Backdrop {
    /// Black.
    #[default]
    None,
    /// A dark gradient, against which glass and dark sides stand out.
    Dark,
}

/// Conversion from XYZ to the screen.
#[derive(Clone, Debug, PartialEq)]
pub struct Display {
    /// Factor of linear sRGB; `None` is that of [`film::automatic_exposure`], from the first film on.
    pub exposure: Option<f64>,
    /// Curve of colours near white.
    pub tone: Tone,
    /// Colours of the screen behind a picture without a background.
    pub backdrop: Backdrop,
    /// Bradford adaptation of the white of the mix to D65; without it, a tungsten light looks orange.
    pub adapt: bool,
    /// Standard observer.
    pub observer: Observer,
    /// Colour vision deficiency to preview; `None` is normal colour vision.
    pub deficiency: Option<Deficiency>,
}

impl Display {
    /// Factor of linear sRGB; 1 as long as an automatic one has no film.
    #[must_use]
    pub fn factor(&self) -> f64 {
        self.exposure.unwrap_or(1.0)
    }
}

impl Default for Display {
    fn default() -> Self {
        Self {
            exposure: Some(1.0),
            tone: Tone::Linear,
            backdrop: Backdrop::None,
            adapt: false,
            observer: Observer::default(),
            deficiency: None,
        }
    }
}
