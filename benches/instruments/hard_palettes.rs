//! Seeded palettes that the search for spectra finds hard, with the best results known.

use relume::model::random::Random;
use relume::palette::{Cell, LAMP, Member, NATURAL, Palette, SMOOTHNESS, Target};
use relume::spectrum::Spectrum;
use relume::spectrum::colour::Lab;

/// A seeded palette with its best known result.
#[derive(Clone, Debug)]
pub(crate) struct Hard {
    /// Name in tables.
    pub(crate) name: String,
    /// The palette.
    pub(crate) palette: Palette,
    /// Root mean square ΔE00 over the cells with a target: the least of 120 random starts, each
    /// followed to its end, and of the solver.
    pub(crate) best_known: f64,
}

/// Best known results of the seeds 0, 1, 2 …
const BEST_KNOWN: [f64; 6] = [2.5596, 2.1162, 3.7388, 2.3885, 2.3758, 1.4154];

/// Surfaces that are nearly black under a light with power everywhere and coloured under an open light, alone or beside
/// a surface that keeps its colour. No reflectance from 0 to 1 is exactly black there.
///
/// `light` gives the spectrum of a standard light by name.
pub(crate) fn nearly_black(light: impl Fn(&str) -> Option<Spectrum>) -> Vec<Hard> {
    let palette = |seed: u64, best_known: f64| {
        let mut random = Random::new(seed);
        let given = ["D65", "A", "D50", "E"][random.index(4)];
        let target = Lab([random.between(40.0, 95.0), random.between(-30.0, 30.0), random.between(-30.0, 30.0)]);
        let member =
            |name: &str, bounds| Member { name: name.to_owned(), spectrum: None, bounds, smoothness: SMOOTHNESS };
        let cell = |material, light, target| Cell { material, light, target, weight: 1.0 };
        let mut materials = vec![member("smoke", NATURAL)];
        let mut cells = vec![cell(0, 0, Target::Black), cell(0, 1, Target::Lab(target))];
        if seed % 2 == 1 {
            materials.push(member("core", NATURAL));
            cells.push(cell(1, 0, Target::Lab(Lab([60.0, 25.0, 20.0]))));
            cells.push(cell(1, 1, Target::Like { material: 1, light: 0 }));
        }
        let day = Member { spectrum: light(given), ..member("given", LAMP) };
        let name = format!("nearly black {seed}, {given}");
        let palette = Palette {
            source: name.clone(),
            inputs: Vec::new(),
            materials,
            lights: vec![day, member("open", LAMP)],
            cells,
            model: None,
        };
        Hard { name, palette, best_known }
    };
    (0..).zip(BEST_KNOWN).map(|(seed, best_known)| palette(seed, best_known)).collect()
}
