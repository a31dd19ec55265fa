//! The palette of the open scene, and the current colours of its cells.

mod offer;
mod spectra;
mod step;

use std::sync::Arc;

pub use offer::{offer, wished};
pub use spectra::{BANDS_PER_HANDLE, HANDLES, Spectra};
pub use step::Step;

use super::SceneFile;
use relume_colour::palette::{self, Member, Palette, Target};
use relume_colour::spectrum::colour::{
    Xyz, ciede2000, d65_white, display_code, lab_from_xyz, linear_srgb_from_xyz, xyz,
};
use relume_colour::spectrum::{Light, Reflectance, Spectrum};
use relume_scene::Scene;

/// Row name of the background.
pub const BACKGROUND: &str = "background";

/// A side of the palette's matrix.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Side {
    /// Rows.
    Material,
    /// Columns.
    Light,
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

/// A cell whose target colour differs clearly from that of the spectra that the scene file stores.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "[palette.cells]: {material} under {light} is to be {wanted}, but the spectra in the scene show {shown} (ΔE00 {difference:.0}), \
     since the cell or the spectra were changed, or designed for another palette"
)]
pub struct Unlike {
    /// Name of the material.
    pub material: String,
    /// Name of the light.
    pub light: String,
    /// Target colour as `#rrggbb`.
    pub wanted: String,
    /// Colour of the stored spectra as `#rrggbb`.
    pub shown: String,
    /// ΔE00 between the two.
    pub difference: f64,
}

/// The cell with the largest difference, if the file states the reflectance of its material and the difference exceeds
/// ΔE00 10: more than solved palettes miss, less than an edited colour.
#[must_use]
pub fn unlike(file: &SceneFile) -> Option<Unlike> {
    const CLEAR: f64 = 10.0;
    let palette = stated(file)?;
    let text: toml::Table = file.text.parse().ok()?;
    let stores = |row: &Member| {
        let material = text.get("materials").and_then(|all| all.get(&row.name));
        material.is_some_and(|material| material.get("reflectance").is_some())
    };
    let clear = palette.cells.iter().filter_map(|cell| {
        let (row, column) = (palette.materials.get(cell.material)?, palette.lights.get(cell.light)?);
        let look = look(&file.scene, &palette, cell.material, cell.light);
        let difference = look.difference.filter(|&it| it > CLEAR && stores(row))?;
        let code = |colour: Xyz| display_code(linear_srgb_from_xyz(colour));
        Some(Unlike {
            material: row.name.clone(),
            light: column.name.clone(),
            wanted: code(look.target?),
            shown: code(look.achieved?),
            difference,
        })
    });
    clear.max_by(|one, two| one.difference.total_cmp(&two.difference))
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

#[cfg(test)]
#[expect(clippy::unwrap_used, reason = "a test fails by panicking")]
mod tests {
    use super::*;
    use crate::{SceneOptions, load_embedded, parse};
    use relume_base::progress::Quiet;
    use relume_colour::palette::ModelTerm;
    use relume_colour::spectrum::colour::Lab;

    fn scene() -> Scene {
        let text = "version = 1\n[volume]\nphantom = \"slab\"\ndims = [3, 3, 3]\n[materials.a]\nreflectance = \"orange\"\n\
                    [materials.b]\nreflectance = \"cyan\"\n[materials.unseen]\nreflectance = 0.5\n\
                    [lights.day]\nspectrum = \"D65\"\n[lights.lamp]\nspectrum = \"A\"\n[transfer]\nintervals = [\n\
                    { material = \"a\", range = [0, 9], opacity = 0.1 }, { material = \"b\", range = [10, 20], opacity = 0.1 }]\n";
        parse("test", text, std::path::Path::new(""), &SceneOptions::default(), &Quiet).unwrap().scene
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
        let all = after(Step::SmoothAll(1e9));
        let open = all.materials.iter().map(|row| row.smoothness.to_bits());
        assert!(open.eq([1e6_f64.to_bits(); 2]) && all.lights == palette.lights, "open ones alone: {all:?}");
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
            Step::SmoothAll(f64::NAN),
        ] {
            assert_eq!(after(step.clone()), palette, "{step:?}");
        }
        assert_eq!(after(Step::Target(0, 0, itself)).target_text(0, 0), "free", "nothing looks as itself");
        assert_eq!(Step::Weight(0, 0, 2.0).applied(&scene, None), None);
    }
}
