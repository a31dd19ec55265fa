//! The palette of the open scene: its edits, the current colours of its cells, and solved spectra.

use std::sync::Arc;

use glam::DVec3;

use super::SceneFile;
use crate::model::LARGEST_DIMENSION;
use crate::number::count;
use crate::palette::{
    self, Cell, LAMP, LARGEST, Member, ModelTerm, NATURAL, Palette, PaletteError, SMOOTHNESS, SMOOTHNESSES, Solution,
    Target,
};
use crate::progress::Progress;
use crate::scene::Scene;
use crate::spectrum::colour::{Lab, Xyz, ciede2000, d65_white, lab_from_xyz, xyz};
use crate::spectrum::{BANDS, Light, Reflectance, Spectrum, standard};

/// Weight of a target that keeps a hue; a target to look alike has weight 1.
const APART: f64 = 0.2;
/// Fraction by which the target colours of an offer move from the achieved colours towards their mean. The margin keeps
/// spectra off their bounds.
const NEARER: f64 = 0.2;
/// Row name of the background.
pub(super) const BACKGROUND: &str = "background";

/// Number of handles of an editable curve: every 50 nm from 380 to 780 nm.
pub const HANDLES: usize = 9;
/// Samples from one handle to the next.
pub const BANDS_PER_HANDLE: usize = (BANDS - 1) / (HANDLES - 1);

/// Fraction of the movement of the handle at `band` that the sample at `at` follows. A virtual handle beyond each end
/// moves with the end handle.
fn goes_along(at: usize, band: usize) -> f64 {
    let kernel = |distance: f64| match distance.abs() {
        t if t < 1.0 => (1.5 * t - 2.5) * t * t + 1.0,
        t if t < 2.0 => ((2.5 - 0.5 * t) * t - 4.0) * t + 2.0,
        _ => 0.0,
    };
    let distance = (count(at) - count(band)) / count(BANDS_PER_HANDLE);
    let beyond = match band {
        0 => kernel(distance + 1.0),
        band if band == BANDS - 1 => kernel(distance - 1.0),
        _ => 0.0,
    };
    kernel(distance) + beyond
}

/// A side of the palette's matrix.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Side {
    /// Rows.
    Material,
    /// Columns.
    Light,
}

/// An edit of a palette. Edits of missing rows, columns and cells have no effect.
#[derive(Clone, Debug, PartialEq)]
pub enum Step {
    /// Replaces the palette.
    Take(Arc<Palette>),
    /// Target colour of a cell, by row and column; `None` leaves it free.
    Target(usize, usize, Option<Target>),
    /// Weight of a cell, by row and column, above 0.
    Weight(usize, usize, f64),
    /// Whether a spectrum is open, to be solved for; a closed spectrum keeps its current samples.
    Open(Side, usize, bool),
    /// Bounds of the samples of an open spectrum; for a light, in multiples of its mean.
    Bounds(Side, usize, [f64; 2]),
    /// Weight of the squared second differences of an open spectrum, relative to squared ΔE00.
    Smoothness(Side, usize, f64),
    /// Colour model that is to reproduce the colours, if it is fixed before the spectra are solved.
    Model(Option<ModelTerm>),
}

/// Spectra that replace those of the scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Spectra {
    /// Reflectances, by material index.
    pub materials: Vec<(usize, Reflectance)>,
    /// Light spectra, by light index.
    pub lights: Vec<(usize, Light)>,
    /// Reflectance of the background.
    pub background: Option<Reflectance>,
    /// Palette edit that goes with the spectra.
    pub step: Option<Step>,
}

/// Current colour and target colour of a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// Colour of the scene's material under the scene's light, if the scene has both.
    pub achieved: Option<Xyz>,
    /// Target colour.
    pub target: Option<Xyz>,
    /// ΔE00 between the two.
    pub difference: Option<f64>,
}

/// The palette of a scene file; `None` also if it cannot be read, in which case the scene would not have opened.
pub(super) fn stated(file: &SceneFile) -> Option<Arc<Palette>> {
    palette::of_scene(&file.scene.name, &file.text, &file.base).ok().flatten().map(Arc::new)
}

/// Reflectance of a row's material, found by name; of the background for its row.
fn reflectance<'a>(scene: &'a Scene, row: &Member) -> Option<&'a Reflectance> {
    let material = scene.materials.iter().find(|material| material.name == row.name).map(|it| &it.reflectance);
    material.or(scene.background.as_ref().filter(|_| row.name == BACKGROUND))
}

fn light<'a>(scene: &'a Scene, column: &Member) -> Option<&'a Light> {
    scene.lights.iter().find(|light| light.name == column.name).map(|light| &light.spectrum)
}

/// Current spectrum of a row or a column in `scene`.
#[must_use]
pub fn spectrum<'a>(scene: &'a Scene, side: Side, member: &Member) -> Option<&'a Spectrum> {
    match side {
        Side::Material => reflectance(scene, member).map(Reflectance::spectrum),
        Side::Light => light(scene, member).map(Light::spectrum),
    }
}

/// Current colour and target colour of a cell in `scene`.
#[must_use]
pub fn look(scene: &Scene, palette: &Palette, row: usize, column: usize) -> Look {
    let achieved = |row: usize, column: usize| {
        let (row, column) = (palette.materials.get(row)?, palette.lights.get(column)?);
        Some(xyz(light(scene, column)?, reflectance(scene, row)?))
    };
    let cell = palette.cells.iter().find(|cell| (cell.material, cell.light) == (row, column));
    let target = cell.and_then(|cell| match cell.target {
        Target::Like { material, light } => achieved(material, light),
        target => target.xyz(),
    });
    let achieved = achieved(row, column);
    let lab = |colour: Xyz| lab_from_xyz(colour, d65_white());
    let difference = achieved.zip(target).map(|(one, two)| ciede2000(lab(one), lab(two)));
    Look { achieved, target, difference }
}

/// Text of `palette` in which open spectra stay open and the others have the samples of `scene`.
#[must_use]
pub fn text(scene: &Scene, palette: &Palette) -> String {
    let nothing = Spectrum::constant(0.0);
    let of = |side: Side, members| -> Vec<Option<Spectrum>> {
        let spectrum = |it: &Member| match (spectrum(scene, side, it), &it.spectrum) {
            (Some(_), None) => None,
            (Some(now), Some(_)) => Some(now.clone()),
            (None, given) => Some(given.as_ref().unwrap_or(&nothing).clone()),
        };
        <[Member]>::iter(members).map(spectrum).collect()
    };
    let (materials, lights) = (of(Side::Material, &palette.materials), of(Side::Light, &palette.lights));
    palette.to_toml(
        &materials.iter().map(Option::as_ref).collect::<Vec<_>>(),
        &lights.iter().map(Option::as_ref).collect::<Vec<_>>(),
    )
}

/// Open spectra of `palette` with their samples in `scene`, by side and name.
pub(super) fn open<'a>(scene: &'a Scene, palette: &'a Palette) -> Vec<(Side, &'a str, &'a Spectrum)> {
    let of = |side: Side, members: &'a [Member]| {
        let open = members.iter().filter(|it| it.spectrum.is_none());
        open.filter_map(move |it| Some((side, it.name.as_str(), spectrum(scene, side, it)?)))
    };
    of(Side::Material, &palette.materials).chain(of(Side::Light, &palette.lights)).collect()
}

impl Side {
    fn members(self, palette: &mut Palette) -> &mut Vec<Member> {
        match self {
            Self::Material => &mut palette.materials,
            Self::Light => &mut palette.lights,
        }
    }
}

impl Step {
    /// Applies the edit to `palette`, which belongs to `scene`; `None` if there is no palette to edit.
    #[must_use]
    pub fn applied(&self, scene: &Scene, palette: Option<&Palette>) -> Option<Palette> {
        if let Self::Take(palette) = self {
            return Some((**palette).clone());
        }
        let mut palette = palette?.clone();
        let at = |cell: &Cell, row: usize, column: usize| (cell.material, cell.light) == (row, column);
        match *self {
            Self::Take(_) => {}
            Self::Target(row, column, target) => {
                let weight = palette.cells.iter().find(|cell| at(cell, row, column)).map_or(1.0, |cell| cell.weight);
                palette.cells.retain(|cell| !at(cell, row, column));
                let there = |row: usize, column: usize| row < palette.materials.len() && column < palette.lights.len();
                let like_another = |target: &Target| match *target {
                    Target::Like { material, light } => there(material, light) && (material, light) != (row, column),
                    _ => true,
                };
                if let (Some(target), true) = (target.filter(like_another), there(row, column)) {
                    palette.cells.push(Cell { material: row, light: column, target, weight });
                }
            }
            Self::Weight(row, column, weight) => {
                if let Some(cell) = palette.cells.iter_mut().find(|cell| at(cell, row, column)) {
                    cell.weight = if weight.is_finite() { weight.clamp(1e-6, 1e6) } else { 1.0 };
                }
            }
            Self::Open(side, index, open) => {
                if let Some(member) = side.members(&mut palette).get_mut(index) {
                    let now = spectrum(scene, side, member).cloned();
                    member.spectrum = if open { None } else { now.or_else(|| member.spectrum.clone()) };
                }
            }
            Self::Bounds(side, index, [low, high]) => {
                if let Some(member) = side.members(&mut palette).get_mut(index) {
                    let wanted = Member { bounds: [low.clamp(-1e3, 1e3), high.clamp(-1e3, 1e3)], ..member.clone() };
                    let [low, high] = wanted.bounds;
                    let kept = low < high && (side == Side::Material || (low < 1.0 && high > 1.0));
                    if kept {
                        *member = wanted;
                    }
                }
            }
            Self::Smoothness(side, index, smoothness) => {
                if let (Some(member), true) = (side.members(&mut palette).get_mut(index), smoothness.is_finite()) {
                    member.smoothness = smoothness.clamp(*SMOOTHNESSES.start(), *SMOOTHNESSES.end());
                }
            }
            Self::Model(term) => {
                palette.model = term.map(|ModelTerm { dimension, weight }| ModelTerm {
                    dimension: dimension.clamp(1, LARGEST_DIMENSION),
                    weight: if weight.is_finite() { weight.clamp(1e-6, 1e6) } else { 1.0 },
                });
            }
        }
        Some(palette)
    }
}

/// Rounds to tenths; finer differences are not visible.
fn in_tenths(number: f64) -> f64 {
    (number * 10.0).round() / 10.0
}

/// Palette with achievable targets for the visible materials of `scene`: all look alike under its second light, and
/// keep as much of their hues as possible under its first.
///
/// # Errors
///
/// [`PaletteError`] for the scene's own spectra, or because `progress` was cancelled.
pub fn offer(scene: &Scene, progress: &dyn Progress) -> Result<Palette, PaletteError> {
    let mut palette = wished(scene);
    let found = palette::solve(&palette, progress)?;
    let colours: Vec<DVec3> =
        found.cells.iter().filter(|cell| cell.light == 0).map(|cell| DVec3::from_array(cell.xyz.0)).collect();
    let mean = colours.iter().sum::<DVec3>() / count(colours.len().max(1));
    for cell in &mut palette.cells {
        if let (Target::Lab(target), Some(had)) = (&mut cell.target, colours.get(cell.material)) {
            *target = Lab(lab_from_xyz(Xyz(had.lerp(mean, NEARER).to_array()), d65_white()).0.map(in_tenths));
        }
    }
    Ok(palette)
}

/// Palette with ideal targets: all visible materials look alike under the second light, and keep their hues at their
/// average lightness under the first.
#[must_use]
pub fn wished(scene: &Scene) -> Palette {
    let shown: Vec<_> = (0..scene.materials.len()).filter(|&index| scene.shows(index)).take(LARGEST).collect();
    let shown: Vec<_> = shown.into_iter().filter_map(|index| scene.materials.get(index)).collect();
    let mut lights: Vec<&crate::scene::SceneLight> = Vec::new();
    for light in &scene.lights {
        if lights.len() < 2 && lights.iter().all(|known| known.spectrum != light.spectrum) {
            lights.push(light);
        }
    }
    let member = |name: &str, spectrum: Option<Spectrum>, bounds: [f64; 2]| Member {
        name: name.to_owned(),
        spectrum,
        bounds,
        smoothness: SMOOTHNESS,
    };
    let mut cells = Vec::new();
    let colour = |light: &crate::scene::SceneLight, material: &crate::scene::Material| {
        lab_from_xyz(xyz(&light.spectrum, &material.reflectance), d65_white()).0.map(in_tenths)
    };
    let lightness = lights.first().map_or(0.0, |light| shown.iter().map(|it| colour(light, it)[0]).sum::<f64>())
        / count(shown.len().max(1));
    for (row, material) in shown.iter().enumerate() {
        for (column, light) in lights.iter().enumerate() {
            let [_, a, b] = colour(light, material);
            let (target, weight) = match (column, row) {
                (0, _) => (Target::Lab(Lab([in_tenths(lightness.clamp(30.0, 80.0)), a, b])), APART),
                // The first material is free under the second light.
                (_, 0) => continue,
                _ => (Target::Like { material: 0, light: column }, 1.0),
            };
            cells.push(Cell { material: row, light: column, target, weight });
        }
    }
    Palette {
        source: scene.name.clone(),
        inputs: Vec::new(),
        materials: shown.iter().map(|it| member(&it.name, None, NATURAL)).collect(),
        lights: lights.iter().map(|it| member(&it.name, Some(it.spectrum.spectrum().clone()), LAMP)).collect(),
        cells,
        model: None,
    }
}

impl Spectra {
    /// The solved spectra of the open rows and columns, for the materials and lights present in `scene`.
    #[must_use]
    pub fn of(scene: &Scene, solution: &Solution) -> Self {
        let palette = &solution.palette;
        let open = |members: &[Member]| -> Vec<usize> {
            (0..members.len()).filter(|&index| members.get(index).is_some_and(|it| it.spectrum.is_none())).collect()
        };
        let mut spectra = Self::default();
        for row in open(&palette.materials) {
            let (Some(member), Some(found)) = (palette.materials.get(row), solution.materials.get(row)) else {
                continue;
            };
            match scene.materials.iter().position(|material| material.name == member.name) {
                Some(index) => spectra.materials.push((index, found.clone())),
                None if member.name == BACKGROUND => spectra.background = Some(found.clone()),
                None => {}
            }
        }
        for column in open(&palette.lights) {
            let (Some(member), Some(found)) = (palette.lights.get(column), solution.lights.get(column)) else {
                continue;
            };
            if let Some(index) = scene.lights.iter().position(|light| light.name == member.name) {
                spectra.lights.push((index, found.clone()));
            }
        }
        spectra
    }

    /// The current spectrum of the material or light `name` of `scene`.
    #[must_use]
    pub fn of_scene(scene: &Scene, side: Side, name: &str) -> Self {
        let mut spectra = Self::default();
        match side {
            Side::Material => {
                let named = scene.materials.iter().enumerate().filter(|(_, it)| it.name == name);
                spectra.materials.extend(named.map(|(index, it)| (index, it.reflectance.clone())));
            }
            Side::Light => {
                let named = scene.lights.iter().enumerate().filter(|(_, it)| it.name == name);
                spectra.lights.extend(named.map(|(index, it)| (index, it.spectrum.clone())));
            }
        }
        spectra
    }

    /// The standard spectrum `standard` for the material or light `name` of `scene`.
    ///
    /// # Errors
    ///
    /// A sentence that lists the available names.
    pub fn standard(scene: &Scene, side: Side, name: &str, standard: &str) -> Result<Self, String> {
        let find = |names: Vec<&str>| {
            let found = names.iter().position(|&one| one == name);
            found.ok_or_else(|| format!("there is no {name:?}; there are: {}", names.join(", ")))
        };
        let mut spectra = Self::default();
        match side {
            Side::Material => {
                let index = find(scene.materials.iter().map(|it| it.name.as_str()).collect())?;
                let found = standard::reflectance(standard).map_err(|error| error.to_string())?;
                spectra.materials.push((index, found));
            }
            Side::Light => {
                let index = find(scene.lights.iter().map(|it| it.name.as_str()).collect())?;
                spectra.lights.push((index, standard::light(standard).map_err(|error| error.to_string())?));
            }
        }
        Ok(spectra)
    }

    /// The spectrum of material `index` after its handle number `handle` was drawn to `value`; `was` is the spectrum
    /// before. Samples near the handle follow the smooth curve through all handles (Catmull and Rom 1974); samples two
    /// or more handles away stay. Moved samples are clamped to 0 to 1.
    #[must_use]
    pub fn drawn(index: usize, was: &Spectrum, handle: usize, value: f64) -> Self {
        let band = handle.min(HANDLES - 1) * BANDS_PER_HANDLE;
        let moved = value.clamp(0.0, 1.0) - was.samples()[band];
        let spectrum = Spectrum::from_samples(std::array::from_fn(|at| {
            let (sample, share) = (was.samples()[at], goes_along(at, band));
            if share == 0.0 { sample } else { moved.mul_add(share, sample).clamp(0.0, 1.0) }
        }));
        let materials = Reflectance::new(spectrum).map(|spectrum| (index, spectrum)).into_iter().collect();
        Self { materials, ..Self::default() }
    }

    /// Replaces the spectra of `scene`.
    pub(super) fn put_into(&self, scene: &mut Scene) {
        for (index, reflectance) in &self.materials {
            if let Some(material) = scene.materials.get_mut(*index) {
                material.reflectance = reflectance.clone();
            }
        }
        for (index, spectrum) in &self.lights {
            if let Some(light) = scene.lights.get_mut(*index) {
                light.spectrum = spectrum.clone();
            }
        }
        if let (Some(background), true) = (&self.background, scene.background.is_some()) {
            scene.background = Some(background.clone());
        }
    }
}

#[cfg(test)]
#[expect(clippy::unwrap_used, reason = "a test fails by panicking")]
mod tests {
    use super::*;
    use crate::document::{SceneOptions, load_embedded, parse};
    use crate::progress::Quiet;

    fn scene() -> Scene {
        let text = "version = 1\n[volume]\nphantom = \"slab\"\ndims = [3, 3, 3]\n[materials.a]\nreflectance = \"orange\"\n\
                    [materials.b]\nreflectance = \"cyan\"\n[materials.unseen]\nreflectance = 0.5\n\
                    [lights.day]\nspectrum = \"D65\"\n[lights.lamp]\nspectrum = \"A\"\n[transfer]\nintervals = [\n\
                    { material = \"a\", range = [0, 9], opacity = 0.1 }, { material = \"b\", range = [10, 20], opacity = 0.1 }]\n";
        parse("test", text, std::path::Path::new(""), &SceneOptions::default(), &Quiet).unwrap().scene
    }

    #[test]
    fn a_handle_that_is_drawn_takes_its_neighbourhood_along_smoothly_and_nothing_leaves_what_surfaces_reflect() {
        let drawn = |was: &Spectrum, handle, value| {
            let spectra = Spectra::drawn(3, was, handle, value);
            assert_eq!((spectra.materials.len(), spectra.materials[0].0), (1, 3));
            *spectra.materials[0].1.spectrum().samples()
        };
        let grey = Spectrum::constant(0.5);
        for handle in 0..HANDLES {
            let samples = drawn(&grey, handle, 0.7);
            for other in 0..HANDLES {
                let wanted = if other == handle { 0.7 } else { 0.5 };
                assert!((samples[other * BANDS_PER_HANDLE] - wanted).abs() <= 1e-15, "{handle}, {other}");
            }
            let bends = samples.windows(3).map(|three| (three[0] - 2.0 * three[1] + three[2]).abs());
            assert!(bends.fold(0.0, f64::max) <= 0.2 * 5.0 / 100.0, "no corner: a second derivative of 5 at most");
            assert!(
                drawn(&grey, handle, 9.0).iter().chain(&drawn(&grey, handle, -1.0)).all(|it| (0.0..=1.0).contains(it))
            );
        }
        // All handles moved by the same amount move the whole curve, including its ends.
        let all = (0..HANDLES).fold(grey, |was, handle| Spectrum::from_samples(drawn(&was, handle, 0.7)));
        assert!(all.samples().iter().all(|sample| (sample - 0.7).abs() <= 1e-12), "{:?}", all.samples());
        let artificial = Spectrum::from_fn(|nm| if nm < 500.0 { -2.0 } else { 0.5 });
        assert_eq!(drawn(&artificial, 8, 0.1)[0].to_bits(), (-2.0_f64).to_bits(), "what is far stays");
    }

    #[test]
    fn what_is_offered_merges_under_one_light_and_parts_under_the_other() {
        let mut scene = scene();
        let palette = offer(&scene, &Quiet).unwrap();
        assert_eq!(palette.materials.iter().map(|row| row.name.as_str()).collect::<Vec<_>>(), ["a", "b"], "what shows");
        let solution = palette::solve(&palette, &Quiet).unwrap();
        Spectra::of(&scene, &solution).put_into(&mut scene);
        for (row, cell) in solution.cells.iter().filter(|cell| cell.light == 0).enumerate() {
            assert_eq!(look(&scene, &palette, row, 0).difference, cell.difference, "as it was solved");
        }
        assert!(look(&scene, &palette, 1, 1).difference.unwrap() <= 1.0, "alike under the lamp");
        let [one, two] = [0, 1].map(|row| look(&scene, &palette, row, 0).achieved.unwrap());
        let apart = ciede2000(lab_from_xyz(one, d65_white()), lab_from_xyz(two, d65_white()));
        assert!(apart > 10.0, "apart by day: {apart}");
    }

    #[test]
    fn what_is_offered_for_the_program_s_own_scene_can_be_had() {
        let options = SceneOptions { downsample: Some([16; 3]), ..Default::default() };
        let scene = load_embedded(&options, &Quiet).unwrap().scene;
        let solution = palette::solve(&offer(&scene, &Quiet).unwrap(), &Quiet).unwrap();
        assert_eq!(solution.conflicts, []);
        assert!(solution.worst() <= 2.0, "ΔE00 {}", solution.worst());
        let day: Vec<Lab> = solution
            .cells
            .iter()
            .filter(|cell| cell.light == 0)
            .map(|cell| lab_from_xyz(cell.xyz, d65_white()))
            .collect();
        let apart = |one: &Lab| day.iter().map(|two| ciede2000(*one, *two)).fold(0.0, f64::max);
        assert!(day.iter().all(|one| apart(one) > 10.0), "by day they are told apart");
    }

    #[test]
    fn steps_change_what_they_say_and_nothing_that_is_not_there() {
        let scene = scene();
        let palette = Step::Take(Arc::new(wished(&scene))).applied(&scene, None).unwrap();
        let after = |step: Step| step.applied(&scene, Some(&palette)).unwrap();
        let white = Some(Target::Srgb([255; 3]));
        assert_eq!(after(Step::Target(1, 1, white)).target_text(1, 1), "#ffffff");
        assert_eq!(after(Step::Target(1, 1, None)).target_text(1, 1), "free");
        let weight =
            after(Step::Weight(1, 1, 3.0)).cells.iter().find(|it| (it.material, it.light) == (1, 1)).unwrap().weight;
        assert!((weight - 3.0).abs() <= 0.0, "{weight}");
        let given = after(Step::Open(Side::Material, 1, false));
        assert_eq!(given.materials[1].spectrum.as_ref(), Some(scene.materials[1].reflectance.spectrum()));
        assert_eq!(after(Step::Open(Side::Light, 1, true)).lights[1].spectrum, None);
        let bounds = after(Step::Bounds(Side::Material, 0, [-1.0, 2.0])).materials[0].bounds;
        assert_eq!(bounds.map(f64::to_bits), [-1.0, 2.0].map(f64::to_bits));
        let smooth = after(Step::Smoothness(Side::Light, 1, 1e9)).lights[1].smoothness;
        assert_eq!(smooth.to_bits(), 1e6_f64.to_bits(), "the largest that a file may say");
        let term = after(Step::Model(Some(ModelTerm { dimension: 99, weight: 2.0 }))).model;
        assert_eq!(term, Some(ModelTerm { dimension: 31, weight: 2.0 }), "the largest that a file may say");
        let itself = Some(Target::Like { material: 0, light: 0 });
        for step in [
            Step::Target(9, 0, white),
            Step::Target(0, 9, white),
            Step::Weight(9, 9, 2.0),
            Step::Open(Side::Light, 9, true),
            Step::Bounds(Side::Light, 0, [2.0, 3.0]),
            Step::Bounds(Side::Material, 0, [1.0, 0.0]),
            Step::Bounds(Side::Material, 0, [f64::NAN, 1.0]),
            Step::Smoothness(Side::Material, 9, 1.0),
            Step::Smoothness(Side::Material, 0, f64::NAN),
        ] {
            assert_eq!(after(step.clone()), palette, "{step:?}");
        }
        assert_eq!(after(Step::Target(0, 0, itself)).target_text(0, 0), "free", "nothing looks as itself");
        assert_eq!(Step::Weight(0, 0, 2.0).applied(&scene, None), None);
    }
}
