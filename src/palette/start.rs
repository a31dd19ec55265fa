//! Where the search for spectra begins: combs of colours, and the paper's pseudo-inverse.

use nalgebra::{DMatrix, DVector};

use super::step::{Side, Spectra, form, of_unit_luminance};
use super::{Palette, Place};
use crate::model::random::Random;
use crate::number::count;
use crate::spectrum::colour::OBSERVER;
use crate::spectrum::{BANDS, Spectrum};

/// How wide the teeth of the combs are, in nm: one start each.
const WIDTHS: [f64; 3] = [8.0, 10.0, 13.0];
/// What an open reflectance is before anything is known of it.
const GREY: f64 = 0.3;
/// Where the teeth of combs lie, in nm.
const TEETH: [f64; 2] = [425.0, 655.0];
/// Colours along directions weaker than this share of the strongest are left out of a pseudo-inverse.
const WEAKEST: f64 = 1e-4;

/// The starts, all with grey for open materials; only one where no light is open.
pub(super) fn starts(palette: &Palette) -> Vec<Spectra> {
    let open: Vec<usize> =
        (0..palette.lights.len()).filter(|&light| palette.lights[light].spectrum.is_none()).collect();
    let of = |lights: Vec<Spectrum>| Spectra {
        materials: palette
            .materials
            .iter()
            .map(|row| row.spectrum.clone().unwrap_or(Spectrum::constant(GREY)))
            .collect(),
        lights,
    };
    let given = |light: usize, otherwise: Spectrum| palette.lights[light].spectrum.clone().unwrap_or(otherwise);
    let with = |open_lights: &dyn Fn(usize) -> Spectrum| {
        let position = |light: usize| open.iter().position(|&other| other == light);
        of((0..palette.lights.len())
            .map(|light| given(light, position(light).map_or(Spectrum::constant(0.0), open_lights)))
            .collect())
    };
    if open.is_empty() {
        return vec![with(&|_| Spectrum::constant(0.0))];
    }
    let mut starts: Vec<Spectra> = WIDTHS.iter().map(|&width| with(&|tooth| comb(tooth, open.len(), width))).collect();
    starts.push(pseudo_inverse(palette, &starts[0]));
    let mut random = Random::new(1);
    let shuffled: Vec<Spectrum> = open.iter().map(|_| random_comb(&mut random)).collect();
    starts.push(with(&|light| shuffled[light].clone()));
    starts
}

/// Every `of`-th of 3·`of` bell curves over the visible, from the one numbered `tooth`: a red, a green and a blue part
/// for each of nearly disjoint lights.
fn comb(tooth: usize, of: usize, width: f64) -> Spectrum {
    let step = (TEETH[1] - TEETH[0]) / count(3 * of - 1).max(1.0);
    let centres: Vec<f64> = (0..3).map(|part| count(tooth + part * of).mul_add(step, TEETH[0])).collect();
    bells(&centres, width)
}

fn random_comb(random: &mut Random) -> Spectrum {
    let third = (TEETH[1] - TEETH[0]) / 3.0;
    let centres = [0.0, 1.0, 2.0].map(|part: f64| (part + random.unit()).mul_add(third, TEETH[0]));
    bells(&centres, random.between(8.0, 20.0))
}

/// A light of luminance 1.
fn bells(centres: &[f64], width: f64) -> Spectrum {
    let bells =
        Spectrum::from_fn(|nm| centres.iter().map(|centre| (-0.5 * ((nm - centre) / width).powi(2)).exp()).sum());
    bells.scaled(1.0 / OBSERVER[1].dot(&bells))
}

/// The start of the paper (§5.2): every open reflectance, then every open light, as near to what it was as makes its
/// column of colours right, without bounds; the lights are then raised to nothing below 0.
fn pseudo_inverse(palette: &Palette, from: &Spectra) -> Spectra {
    let mut spectra = from.clone();
    for side in [Side::Materials, Side::Lights] {
        let members = side.members(palette);
        for index in (0..members.len()).filter(|&index| members[index].spectrum.is_none()) {
            let moved = nearest(palette, side, index, &spectra);
            match side {
                Side::Materials => spectra.materials[index] = moved,
                Side::Lights => {
                    if let Some(light) = of_unit_luminance(*moved.samples(), 0.0) {
                        spectra.lights[index] = light;
                    }
                }
            }
        }
    }
    spectra
}

/// The spectrum with the right colours that is nearest to the one it was.
fn nearest(palette: &Palette, side: Side, index: usize, spectra: &Spectra) -> Spectrum {
    let was = match side {
        Side::Materials => &spectra.materials[index],
        Side::Lights => &spectra.lights[index],
    };
    let mut rows: Vec<Spectrum> = Vec::new();
    let mut missing: Vec<f64> = Vec::new();
    for cell in &palette.cells {
        let place = Place::of(cell);
        let (member, factor) = match side {
            Side::Materials => (place.material, &spectra.lights[place.light]),
            Side::Lights => (place.light, &spectra.materials[place.material]),
        };
        let Some(target) = cell.target.xyz().filter(|_| member == index) else { continue };
        let form = form(cell, |place| spectra.xyz(place));
        let wrong = form * (glam::DVec3::from_array(target.0) - spectra.xyz(place));
        for axis in 0..3 {
            let pull = form.row(axis).to_array();
            let observed = |band: usize| (0..3).map(|part| pull[part] * OBSERVER[part].samples()[band]).sum::<f64>();
            rows.push(Spectrum::from_samples(std::array::from_fn(|band| observed(band) * factor.samples()[band])));
            missing.push(wrong[axis]);
        }
    }
    if rows.is_empty() {
        return was.clone();
    }
    let stacked = DMatrix::from_fn(rows.len(), BANDS, |row, band| rows[row].samples()[band]);
    let weakest = WEAKEST * stacked.norm();
    let change = stacked.pseudo_inverse(weakest).ok().map(|inverse| inverse * DVector::from_vec(missing));
    match change {
        Some(change) if change.len() == BANDS => {
            was + &Spectrum::from_samples(std::array::from_fn(|band| change[band]))
        }
        _ => was.clone(),
    }
}
