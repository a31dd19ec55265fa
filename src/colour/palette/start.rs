//! Starting points of the search: comb spectra, and the paper's pseudo-inverse.

use nalgebra::{DMatrix, DVector};

use super::step::{Side, Spectra, form, of_unit_luminance};
use super::{Palette, Place};
use crate::model::random::Random;
use crate::spectrum::colour::OBSERVER;
use crate::spectrum::{BANDS, Spectrum};
use relume_base::number::count;

/// Widths of the comb teeth in nm; one start for each.
const WIDTHS: [f64; 3] = [8.0, 10.0, 13.0];
/// Initial value of an open reflectance.
const GREY: f64 = 0.3;
/// Range of the comb teeth in nm.
const TEETH: [f64; 2] = [425.0, 655.0];
/// Wavelengths in nm below and above which the observer sees little.
const ENDS: [f64; 2] = [400.0, 720.0];
/// Luminance of a peaked start at the short end: about the share of blue in white.
const VIOLET: f64 = 0.005;
/// Luminance of a peaked start at the long end.
const RED: f64 = 0.15;
/// Peaks of the peaked starts in nm.
const PEAKS: [f64; 12] = [440.0, 460.0, 480.0, 500.0, 520.0, 540.0, 560.0, 580.0, 600.0, 620.0, 640.0, 660.0];
/// Relative singular value below which the pseudo-inverse drops a direction.
const WEAKEST: f64 = 1e-4;

/// Returns the starts, with grey for open materials; a single start if no light is open.
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

/// Returns starts for a palette that misses its targets: the lights of its convex relaxation, and lights that combine the
/// ends of the visible range with one peak.
///
/// A surface is nearly black under a given light if it reflects only the ends of the range and one narrow band. Its
/// colour under an open light then needs a light of great power there, which the combs do not have.
pub(super) fn further_starts(palette: &Palette, relaxed: &[Option<Spectrum>]) -> Vec<Spectra> {
    let materials: Vec<Spectrum> =
        palette.materials.iter().map(|row| row.spectrum.clone().unwrap_or(Spectrum::constant(GREY))).collect();
    let open = palette.lights.iter().filter(|light| light.spectrum.is_none()).count();
    let with = |open_light: &dyn Fn(usize, usize) -> Spectrum| {
        let mut position = 0;
        let lights = palette.lights.iter().enumerate().map(|(light, member)| {
            member.spectrum.clone().unwrap_or_else(|| {
                position += 1;
                open_light(light, position - 1)
            })
        });
        Spectra { lights: lights.collect(), materials: materials.clone() }
    };
    // The peaks of several open lights are spread over the range.
    let peaked = |start: usize| {
        with(&|_, position| ends_and_peak(PEAKS[(start + position * PEAKS.len() / open.max(1)) % PEAKS.len()]))
    };
    let relaxed_light = |light: usize| relaxed.get(light).cloned().flatten();
    let mut starts =
        vec![with(&|light, position| relaxed_light(light).unwrap_or_else(|| comb(position, open, WIDTHS[0])))];
    starts.extend((0..PEAKS.len()).map(peaked));
    starts
}

/// Light of luminance 1 at the ends of the visible range and around `peak`, in nm.
fn ends_and_peak(peak: f64) -> Spectrum {
    let share = |spectrum: Spectrum, share: f64| spectrum.scaled(share / OBSERVER[1].dot(&spectrum));
    let violet = share(Spectrum::from_fn(|nm| if nm <= ENDS[0] { 1.0 } else { 0.0 }), VIOLET);
    let red = share(Spectrum::from_fn(|nm| if nm >= ENDS[1] { 1.0 } else { 0.0 }), RED);
    &(&violet + &red) + &bells(&[peak], WIDTHS[0]).scaled(1.0 - VIOLET - RED)
}

/// Comb of three of 3·`of` bell curves over the visible range: every `of`-th from number `tooth`. Gives each of `of`
/// nearly disjoint lights a red, a green and a blue part.
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

/// Sum of bell curves, scaled to luminance 1.
fn bells(centres: &[f64], width: f64) -> Spectrum {
    let bells =
        Spectrum::from_fn(|nm| centres.iter().map(|centre| (-0.5 * ((nm - centre) / width).powi(2)).exp()).sum());
    bells.scaled(1.0 / OBSERVER[1].dot(&bells))
}

/// Start of the paper (§5.2): moves every open reflectance, then every open light, by the smallest change that gives
/// its cells their target colours, without bounds. Clamps negative samples of the lights to 0.
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

/// Returns the spectrum with the target colours that is nearest to the current one.
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
