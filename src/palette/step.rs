//! One side of a palette solved while the other rests: a convex program per group of coupled spectra.

use std::collections::BTreeMap;

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::program::{Program, Sum};
use super::{Cell, Member, Palette, Place, Target};
use crate::spectrum::colour::{OBSERVER, Xyz, xyz_of};
use crate::spectrum::metric::difference_matrix;
use crate::spectrum::{BANDS, Spectrum};

/// Rows or columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    Materials,
    Lights,
}

impl Side {
    pub(super) fn members(self, palette: &Palette) -> &[Member] {
        match self {
            Self::Materials => &palette.materials,
            Self::Lights => &palette.lights,
        }
    }

    const fn index(self, place: Place) -> usize {
        match self {
            Self::Materials => place.material,
            Self::Lights => place.light,
        }
    }
}

/// A spectrum for every row and column.
#[derive(Clone, Debug)]
pub(super) struct Spectra {
    pub(super) materials: Vec<Spectrum>,
    /// Of luminance 1.
    pub(super) lights: Vec<Spectrum>,
}

impl Spectra {
    pub(super) fn xyz(&self, place: Place) -> DVec3 {
        xyz_of(&(&self.lights[place.light] * &self.materials[place.material])).0.into()
    }
}

/// The samples of an equal-energy light of luminance 1 are one part in this: the unknowns of lights are multiples of
/// them, so that they are numbers around 1 as those of reflectances are.
pub(super) fn equal_energy() -> f64 {
    OBSERVER[1].sum()
}

/// A colour: fixed, or linear in the unknown spectrum that begins at `first`.
#[derive(Clone, Debug)]
pub(super) enum Seen {
    Fixed(DVec3),
    Linear { first: usize, xyz: Box<[Spectrum; 3]> },
}

impl Seen {
    /// The colour of an unknown spectrum times `factor`.
    pub(super) fn through(first: usize, factor: &Spectrum) -> Self {
        Self::Linear { first, xyz: Box::new(OBSERVER.each_ref().map(|matching| matching * factor)) }
    }
}

/// Asks that two colours differ little where `form` measures differences.
pub(super) fn alike(program: &mut Program, form: DMat3, one: &Seen, two: &Seen) {
    if matches!((one, two), (Seen::Fixed(_), Seen::Fixed(_))) {
        return;
    }
    for axis in 0..3 {
        let pull = form.row(axis);
        let mut value = 0.0;
        let mut factors: BTreeMap<usize, f64> = BTreeMap::new();
        for (seen, sign) in [(one, 1.0), (two, -1.0)] {
            match seen {
                Seen::Fixed(xyz) => value -= sign * pull.dot(*xyz),
                Seen::Linear { first, xyz } => {
                    for band in 0..BANDS {
                        let column = DVec3::from_array(xyz.each_ref().map(|row| row.samples()[band]));
                        *factors.entry(first + band).or_default() += sign * pull.dot(column);
                    }
                }
            }
        }
        program.near(factors.into_iter().collect(), value);
    }
}

/// A new reflectance between `bounds`.
pub(super) fn reflectance(program: &mut Program, [low, high]: [f64; 2]) -> usize {
    let first = program.unknowns(BANDS);
    for unknown in first..first + BANDS {
        program.at_most(vec![(unknown, -1.0)], -low);
        program.at_most(vec![(unknown, 1.0)], high);
    }
    first
}

/// A new light of luminance 1, in multiples of the equal-energy light, within `bounds` times its mean.
pub(super) fn light(program: &mut Program, [low, high]: [f64; 2]) -> usize {
    let first = program.unknowns(BANDS);
    let mean = program.unknowns(1);
    let all = first..first + BANDS;
    let count = crate::number::count(BANDS);
    program.equal(all.clone().map(|unknown| (unknown, 1.0 / count)).chain([(mean, -1.0)]).collect(), 0.0);
    let luminance: Sum = all.clone().zip(OBSERVER[1].samples().map(|matching| matching / equal_energy())).collect();
    program.equal(luminance, 1.0);
    for unknown in all {
        program.at_most(vec![(unknown, -1.0), (mean, low)], 0.0);
        program.at_most(vec![(unknown, 1.0), (mean, -high)], 0.0);
    }
    first
}

/// The metric at a cell: of its target, or between the colours that are to be alike.
pub(super) fn form(cell: &Cell, colour: impl Fn(Place) -> DVec3) -> DMat3 {
    let at = match (cell.target.xyz(), cell.target) {
        (None, Target::Like { material, light }) => {
            let other = colour(Place { material, light });
            Xyz(((colour(Place::of(cell)) + other) / 2.0).to_array())
        }
        (target, _) => target.unwrap_or(Xyz([0.0; 3])),
    };
    difference_matrix(at) * cell.weight
}

/// Open members of one side that cells couple, each group in ascending order.
pub(super) fn groups(palette: &Palette, side: Side) -> Vec<Vec<usize>> {
    let members = side.members(palette);
    let links = palette.cells.iter().map(|cell| Place::both(cell).map(|place| side.index(place)).collect());
    let is_open = |&index: &usize| members.get(index).is_some_and(|member| member.spectrum.is_none());
    connected(members.len(), links)
        .into_iter()
        .filter_map(|group| {
            let open: Vec<usize> = group.into_iter().filter(is_open).collect();
            (!open.is_empty()).then_some(open)
        })
        .collect()
}

/// The parts that `count` things fall into when each of `links` ties some together.
pub(super) fn connected(count: usize, links: impl Iterator<Item = Vec<usize>>) -> Vec<Vec<usize>> {
    let mut of: Vec<usize> = (0..count).collect();
    for link in links {
        for pair in link.windows(2) {
            let (kept, merged) = (of[pair[0]].min(of[pair[1]]), of[pair[0]].max(of[pair[1]]));
            for part in &mut of {
                if *part == merged {
                    *part = kept;
                }
            }
        }
    }
    let mut parts: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (thing, part) in of.into_iter().enumerate() {
        parts.entry(part).or_default().push(thing);
    }
    parts.into_values().collect()
}

/// What a colour model shows in place of colours, and how much that counts.
pub(super) struct Shown {
    /// XYZ over the wavelengths of a reflectance, per light: what the model's matrix makes of its nodes.
    pub(super) xyz: Vec<[Spectrum; 3]>,
    /// Per material, the spectrum that the model takes it for. The model fits its matrix to each light anew; as a light
    /// changes, the colour of this spectrum is what the matrix nearly follows.
    pub(super) rebuilt: Vec<Spectrum>,
    pub(super) weight: f64,
}

impl Shown {
    pub(super) fn colour(&self, place: Place, reflectance: &Spectrum) -> Xyz {
        Xyz(self.xyz[place.light].each_ref().map(|axis| axis.dot(reflectance)))
    }
}

/// The open spectra of one side, for the other side as it is.
pub(super) fn solved(
    palette: &Palette,
    side: Side,
    groups: &[Vec<usize>],
    spectra: &Spectra,
    shown: Option<&Shown>,
) -> Spectra {
    let answers: Vec<Vec<(usize, Spectrum)>> =
        groups.par_iter().map(|group| solved_group(palette, side, group, spectra, shown)).collect();
    let mut solved = spectra.clone();
    for (member, spectrum) in answers.into_iter().flatten() {
        match side {
            Side::Materials => solved.materials[member] = spectrum,
            Side::Lights => solved.lights[member] = spectrum,
        }
    }
    solved
}

fn solved_group(
    palette: &Palette,
    side: Side,
    group: &[usize],
    spectra: &Spectra,
    shown: Option<&Shown>,
) -> Vec<(usize, Spectrum)> {
    let members = side.members(palette);
    let mut program = Program::default();
    let firsts: Vec<usize> = group
        .iter()
        .map(|&member| {
            let member = &members[member];
            let first = match side {
                Side::Materials => reflectance(&mut program, member.bounds),
                Side::Lights => light(&mut program, member.bounds),
            };
            program.smooth(first..first + BANDS, member.smoothness);
            first
        })
        .collect();
    let first = |place: Place| group.iter().position(|&member| member == side.index(place)).map(|at| firsts[at]);
    let seen = |place: Place| match (first(place), side) {
        (None, _) => Seen::Fixed(spectra.xyz(place)),
        (Some(first), Side::Materials) => Seen::through(first, &spectra.lights[place.light]),
        (Some(first), Side::Lights) => {
            Seen::through(first, &spectra.materials[place.material].scaled(1.0 / equal_energy()))
        }
    };
    for cell in palette.cells.iter().filter(|cell| Place::both(cell).any(|place| first(place).is_some())) {
        let place = Place::of(cell);
        let form = form(cell, |place| spectra.xyz(place));
        let wanted = match cell.target {
            Target::Like { material, light } => seen(Place { material, light }),
            target => Seen::Fixed(target.xyz().map_or(DVec3::ZERO, |xyz| xyz.0.into())),
        };
        alike(&mut program, form, &seen(place), &wanted);
        if let (Some(shown), Some(first)) = (shown, first(place)) {
            let model = match side {
                Side::Materials => Seen::Linear { first, xyz: Box::new(shown.xyz[place.light].clone()) },
                Side::Lights => Seen::through(first, &shown.rebuilt[place.material].scaled(1.0 / equal_energy())),
            };
            alike(&mut program, form * shown.weight, &model, &seen(place));
        }
    }
    let Some(answer) = program.solve() else { return Vec::new() };
    let spectrum = |first: usize, member: &Member| {
        let samples: [f64; BANDS] = std::array::from_fn(|band| answer.unknowns[first + band]);
        match side {
            // The solver keeps bounds to its own accuracy.
            Side::Materials => {
                Some(Spectrum::from_samples(samples.map(|sample| sample.clamp(member.bounds[0], member.bounds[1]))))
            }
            Side::Lights => of_unit_luminance(samples, member.bounds[0]),
        }
    };
    let found =
        group.iter().zip(&firsts).filter_map(|(&index, &first)| Some((index, spectrum(first, &members[index])?)));
    found.collect()
}

/// The light with these samples, none below `low` times their mean where that is 0 or more, of luminance 1.
pub(super) fn of_unit_luminance(samples: [f64; BANDS], low: f64) -> Option<Spectrum> {
    let mean = samples.iter().sum::<f64>() / crate::number::count(BANDS);
    let raised = Spectrum::from_samples(samples.map(|sample| if low >= 0.0 { sample.max(low * mean) } else { sample }));
    let luminance = OBSERVER[1].dot(&raised);
    (luminance > 0.0).then(|| raised.scaled(1.0 / luminance)).filter(Spectrum::is_finite)
}
