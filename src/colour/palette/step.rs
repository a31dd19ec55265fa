//! Solution of one side of a palette with the other side fixed: one convex program per group of coupled spectra.

use std::collections::BTreeMap;

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::program::{Program, Sum};
use super::{Cell, Member, Palette, Place, Target};
use crate::spectrum::colour::{OBSERVER, Xyz, xyz_of};
use crate::spectrum::metric::difference_matrix;
use crate::spectrum::{BANDS, Kind, Spectrum};

/// Side of a palette: rows or columns.
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

    pub(super) const fn kind(self) -> Kind {
        match self {
            Self::Materials => Kind::Reflectance,
            Self::Lights => Kind::Light,
        }
    }

    const fn index(self, place: Place) -> usize {
        match self {
            Self::Materials => place.material,
            Self::Lights => place.light,
        }
    }
}

/// Spectra of all rows and columns.
#[derive(Clone, Debug)]
pub(super) struct Spectra {
    pub(super) materials: Vec<Spectrum>,
    /// Lights of luminance 1.
    pub(super) lights: Vec<Spectrum>,
}

impl Spectra {
    pub(super) fn xyz(&self, place: Place) -> DVec3 {
        xyz_of(&(&self.lights[place.light] * &self.materials[place.material])).0.into()
    }
}

/// Inverse of the samples of an equal-energy light of luminance 1. The unknowns of lights are multiples of those
/// samples, which keeps them near 1, like those of reflectances.
pub(super) fn equal_energy() -> f64 {
    OBSERVER[1].sum()
}

/// Colour: fixed, or linear in the unknown spectrum that starts at `first`.
#[derive(Clone, Debug)]
pub(super) enum Seen {
    Fixed(DVec3),
    Linear { first: usize, xyz: Box<[Spectrum; 3]> },
}

impl Seen {
    /// Colour of an unknown spectrum times `factor`.
    pub(super) fn through(first: usize, factor: &Spectrum) -> Self {
        Self::Linear { first, xyz: Box::new(OBSERVER.each_ref().map(|matching| matching * factor)) }
    }
}

/// How the difference of two colours is measured: by the length of `form` times it, plus `offset`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Metric {
    pub(super) form: DMat3,
    pub(super) offset: DVec3,
}

/// Adds the difference of two colours, measured by `form`, to the objective.
pub(super) fn alike(program: &mut Program, form: DMat3, one: &Seen, two: &Seen) {
    alike_with(program, Metric { form, offset: DVec3::ZERO }, one, two);
}

/// Adds the difference of two colours, measured by a metric, to the objective.
pub(super) fn alike_with(program: &mut Program, Metric { form, offset }: Metric, one: &Seen, two: &Seen) {
    if matches!((one, two), (Seen::Fixed(_), Seen::Fixed(_))) {
        return;
    }
    for axis in 0..3 {
        let pull = form.row(axis);
        let mut value = -offset[axis];
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

/// Adds a reflectance within its bounds. Returns the index of its first sample.
pub(super) fn reflectance(program: &mut Program, [low, high]: [f64; 2]) -> usize {
    let first = program.unknowns(BANDS);
    for unknown in first..first + BANDS {
        program.at_most(vec![(unknown, -1.0)], -low);
        program.at_most(vec![(unknown, 1.0)], high);
    }
    first
}

/// Adds a light of luminance 1, in multiples of the equal-energy light, within `bounds` times its mean. Returns the
/// index of its first sample.
pub(super) fn light(program: &mut Program, [low, high]: [f64; 2]) -> usize {
    let first = program.unknowns(BANDS);
    let mean = program.unknowns(1);
    let all = first..first + BANDS;
    let count = relume_base::number::count(BANDS);
    program.equal(all.clone().map(|unknown| (unknown, 1.0 / count)).chain([(mean, -1.0)]).collect(), 0.0);
    let luminance: Sum = all.clone().zip(OBSERVER[1].samples().map(|matching| matching / equal_energy())).collect();
    program.equal(luminance, 1.0);
    for unknown in all {
        program.at_most(vec![(unknown, -1.0), (mean, low)], 0.0);
        program.at_most(vec![(unknown, 1.0), (mean, -high)], 0.0);
    }
    first
}

/// Colour-difference metric of a cell: at its target, or midway between the colours of a relation.
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

/// Groups the open members of one side that cells couple; each group is in ascending order.
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

/// Connected components of `count` items; each of `links` joins the items that it lists.
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

/// Colours of the palette under a colour model, and their weight.
pub(super) struct Shown {
    /// Per light, the model's XYZ as a function of the reflectance: its matrix times its projection.
    pub(super) xyz: Vec<[Spectrum; 3]>,
    /// Per material, the reflectance that the model reconstructs. Its colour approximates the model's response to a
    /// change of the light, for which the model fits a new matrix.
    pub(super) rebuilt: Vec<Spectrum>,
    pub(super) weight: f64,
}

impl Shown {
    pub(super) fn colour(&self, place: Place, reflectance: &Spectrum) -> Xyz {
        Xyz(self.xyz[place.light].each_ref().map(|axis| axis.dot(reflectance)))
    }
}

/// Solves the open spectra of one side for the fixed spectra of the other side. Differences of each cell are measured by its
/// metric in `metrics`.
pub(super) fn solved(
    palette: &Palette,
    side: Side,
    groups: &[Vec<usize>],
    spectra: &Spectra,
    metrics: &[Metric],
    shown: Option<&Shown>,
) -> Spectra {
    let answers: Vec<Vec<(usize, Spectrum)>> =
        groups.par_iter().map(|group| solved_group(palette, side, group, spectra, metrics, shown)).collect();
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
    metrics: &[Metric],
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
    let cells = palette.cells.iter().zip(metrics);
    for (cell, &metric) in cells.filter(|(cell, _)| Place::both(cell).any(|place| first(place).is_some())) {
        let place = Place::of(cell);
        let wanted = match cell.target {
            Target::Like { material, light } => seen(Place { material, light }),
            target => Seen::Fixed(target.xyz().map_or(DVec3::ZERO, |xyz| xyz.0.into())),
        };
        alike_with(&mut program, metric, &seen(place), &wanted);
        if let (Some(shown), Some(first)) = (shown, first(place)) {
            let model = match side {
                Side::Materials => Seen::Linear { first, xyz: Box::new(shown.xyz[place.light].clone()) },
                Side::Lights => Seen::through(first, &shown.rebuilt[place.material].scaled(1.0 / equal_energy())),
            };
            alike(&mut program, metric.form * shown.weight, &model, &seen(place));
        }
    }
    let Some(answer) = program.solve() else { return Vec::new() };
    let spectrum = |first: usize, member: &Member| {
        let samples: [f64; BANDS] = std::array::from_fn(|band| answer.unknowns[first + band]);
        match side {
            // The solver meets the bounds only within its tolerance.
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

/// Scales samples to luminance 1. If `low` is not negative, first raises them to at least `low` times their mean.
pub(super) fn of_unit_luminance(samples: [f64; BANDS], low: f64) -> Option<Spectrum> {
    let mean = samples.iter().sum::<f64>() / relume_base::number::count(BANDS);
    let raised = Spectrum::from_samples(samples.map(|sample| if low >= 0.0 { sample.max(low * mean) } else { sample }));
    let luminance = OBSERVER[1].dot(&raised);
    (luminance > 0.0).then(|| raised.scaled(1.0 / luminance)).filter(Spectrum::is_finite)
}
