//! The transfer function: maps a voxel value to materials, opacity and absorption.

use std::sync::Arc;

use smallvec::{SmallVec, smallvec};

use super::curve::{factor_at, height_at};
use super::{Material, Shape};

/// Optical depth per opacity length for opacity 1. It occludes everything at any step down to a ten-millionth of the
/// opacity length, and stays finite in every product.
pub const OPAQUE_DEPTH: f64 = 1e9;

/// Lookup between table entries.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Lookup {
    /// The nearest entry; with 256 entries, as in most renderers of 8-bit data.
    Nearest,
    /// Linear between the two neighbouring entries; costs 17 to 19 % (docs/theory/device.md), without jumps between
    /// entries.
    #[default]
    Linear,
}

/// The transfer function of a scene. Its terms add as media do: scattering adds, so opacities compose.
#[derive(Clone, Debug, PartialEq)]
pub struct Transfer {
    /// Opacity length, in world units.
    pub opacity_length: f64,
    /// Lookup between table entries.
    pub lookup: Lookup,
    /// Number of table entries, if the scene states it.
    pub entries: Option<usize>,
    /// The terms, which are summed.
    pub terms: Vec<Term>,
    /// Factor on the terms without one of their own. Labels ignore it.
    pub gradient_opacity: GradientFactor,
}

/// Factor on scattering and absorption by the gradient magnitude |∇v|: points (data units per world unit, factor from 0 to 1),
/// magnitudes from 0 ascending; constant beyond the ends. Empty is a factor of 1.
pub type GradientFactor = Vec<(f64, f64)>;

/// Largest number of points of a [`GradientFactor`].
pub const GRADIENT_POINTS: usize = 16;

/// Largest number of different factors on the terms of a scene.
pub const FACTORS: usize = 4;

/// A term: an [`Interval`], or opacity, absorption and material as curves over the values.
#[derive(Clone, Debug, PartialEq)]
pub struct Term {
    /// Width of the ramp on either side of an interval, as stated; `None` for curves. The corners of an interval round it.
    pub ramp: Option<f64>,
    /// Points (value, opacity), values not descending; constant beyond the ends. Two points at one value are a jump,
    /// and the larger opacity applies at the value itself.
    pub opacity: Vec<(f64, f64)>,
    /// Points (value, optical depth per opacity length at the peak of the absorption spectrum), otherwise like the
    /// opacity; empty is none.
    pub absorption: Vec<(f64, f64)>,
    /// Material curve.
    pub material: MaterialCurve,
    /// Factor on this term in place of that of the transfer function; empty takes that one.
    pub gradient: GradientFactor,
    /// Further factors, by the values of other fields.
    pub by: Vec<FieldFactor>,
    /// A further factor, by the value and a second number together.
    pub shape: Option<Arc<Shape>>,
}

/// Factor on scattering and absorption by the value of another field: of a mask, or of a tracer that marks what is to be seen.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldFactor {
    /// Name of the field.
    pub field: String,
    /// Points (value, factor from 0 to 1), values ascending; constant beyond the ends. Outside the box of the field, it is that of the first
    /// point.
    pub points: Vec<(f64, f64)>,
}

impl FieldFactor {
    /// The factor where the field has this value; NaN is outside its box.
    #[must_use]
    pub fn at(&self, value: f64) -> f64 {
        if value.is_nan() { self.points.first().map_or(1.0, |point| point.1) } else { factor_at(&self.points, value) }
    }
}

/// The factors on a term. Terms with equal ones are summed before they are scaled.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Factors<'a> {
    /// By the gradient magnitude; empty is 1.
    pub gradient: &'a [(f64, f64)],
    /// By the values of other fields.
    pub by: &'a [FieldFactor],
    /// By the value and a second number together.
    pub shape: Option<&'a Shape>,
}

/// Material as a function of the value: points (value, index into the scene's materials), values ascending. Between
/// points of two materials they mix linearly; constant beyond the ends.
#[derive(Clone, Debug, PartialEq)]
pub struct MaterialCurve(pub Vec<(f64, usize)>);

/// Scattering and absorption at one value: optical depths per opacity length, one per material in the scene's order.
#[derive(Clone, Debug, PartialEq)]
pub struct Medium {
    /// `σ·opacity_length`.
    pub scattering: Depths,
    /// `κ·opacity_length` at the peak of the material's absorption spectrum, which scales it at other wavelengths.
    pub absorption: Depths,
}

/// An optical depth for each material, without memory of its own for a few.
pub type Depths = SmallVec<[f64; 8]>;

impl Medium {
    /// Nothing of so many materials.
    #[must_use]
    pub fn nothing(materials: usize) -> Self {
        Self { scattering: smallvec![0.0; materials], absorption: smallvec![0.0; materials] }
    }
}

impl Medium {
    /// Scattering that occludes, of these `materials`: optical depth per opacity length.
    #[must_use]
    pub fn occluding(&self, materials: &[Material]) -> f64 {
        materials.iter().zip(&self.scattering).map(|(material, depth)| material.occludes * depth).sum()
    }

    /// Adds `other`, of as many materials.
    pub(crate) fn add(&mut self, other: &Self) {
        self.scattering.iter_mut().zip(&other.scattering).for_each(|(sum, depth)| *sum += depth);
        self.absorption.iter_mut().zip(&other.absorption).for_each(|(sum, depth)| *sum += depth);
    }
}

impl Transfer {
    /// The medium at `value` for `materials` materials: `σ_m = −ln(1 − opacity)·share_m` (docs/theory/march.md), and
    /// the same share of the absorption.
    #[must_use]
    pub fn medium(&self, value: f64, materials: usize) -> Medium {
        medium_of(&self.terms, value, materials, |_| 1.0)
    }

    /// The factor on `term`, its own or that of all others. Empty if it is 1 at all magnitudes.
    #[must_use]
    pub fn factor_of<'a>(&'a self, term: &'a Term) -> &'a [(f64, f64)] {
        term.factor_among(&self.gradient_opacity)
    }

    /// The different factors on the terms, in the order of their first terms.
    #[must_use]
    pub fn factors(&self) -> Vec<Factors<'_>> {
        different_factors(&self.terms, &self.gradient_opacity)
    }

    /// Each of [`Self::factors`] where the gradient has this `magnitude`, in data units per world unit, by it alone.
    #[must_use]
    pub fn factors_at(&self, magnitude: f64) -> SmallVec<[f64; FACTORS]> {
        self.factors().into_iter().map(|factors| factor_at(factors.gradient, magnitude)).collect()
    }

    /// Values at which the function has a corner or a jump, ascending.
    #[must_use]
    pub fn bends(&self) -> Vec<f64> {
        bends(&self.terms)
    }
}

/// The medium of `terms` at `value`, with a factor for each, by its index.
pub(crate) fn medium_of(terms: &[Term], value: f64, materials: usize, factor: impl Fn(usize) -> f64) -> Medium {
    let mut medium = Medium::nothing(materials);
    for (index, term) in terms.iter().enumerate() {
        let factor = factor(index);
        if factor <= 0.0 {
            continue;
        }
        let depths = [depth_from_opacity(height_at(&term.opacity, value)), height_at(&term.absorption, value)];
        let depths = depths.map(|depth| depth * factor);
        for (depth, sums) in depths.into_iter().zip([&mut medium.scattering, &mut medium.absorption]) {
            if depth > 0.0 {
                for (material, share) in term.material.at(value) {
                    if let Some(sum) = sums.get_mut(material) {
                        *sum += share * depth;
                    }
                }
            }
        }
    }
    medium
}

/// Values at which `terms` have a corner or a jump, ascending.
pub(crate) fn bends(terms: &[Term]) -> Vec<f64> {
    let heights = terms.iter().flat_map(|term| term.opacity.iter().chain(&term.absorption)).map(|point| point.0);
    let material = terms.iter().flat_map(|term| term.material.0.iter().map(|point| point.0));
    let mut bends: Vec<f64> = heights.chain(material).collect();
    bends.sort_by(f64::total_cmp);
    bends.dedup();
    bends
}

/// The different factors on `terms`, in the order of their first terms; `all` is that of terms without one of their own.
#[must_use]
pub fn different_factors<'a>(terms: &'a [Term], all: &'a [(f64, f64)]) -> Vec<Factors<'a>> {
    let mut factors = Vec::new();
    for factor in terms.iter().map(|term| term.factors_among(all)) {
        if !factors.contains(&factor) {
            factors.push(factor);
        }
    }
    factors
}

/// Lowest and highest value at a point of `terms`; `None` without two of them.
pub(crate) fn range_of(terms: &[Term]) -> Option<[f64; 2]> {
    let points = terms.iter().flat_map(|term| term.opacity.iter().chain(&term.absorption));
    let [low, high] =
        points.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], &(value, _)| [low.min(value), high.max(value)]);
    (low < high).then_some([low, high])
}

/// `terms` over other values, of which the first is lower; `None` if either range has no width.
#[must_use]
pub fn stretched(terms: &[Term], to: [f64; 2]) -> Option<Vec<Term>> {
    let is_range = to[0] < to[1] && to.iter().all(|end| end.abs() <= f64::MAX / 4.0);
    let from = range_of(terms).filter(|_| is_range)?;
    Some(terms.iter().map(|term| term.stretched(from, to)).collect())
}

/// Optical depth of `opacity` (0 to 1), at most [`OPAQUE_DEPTH`].
#[must_use]
pub fn depth_from_opacity(opacity: f64) -> f64 {
    (-(-opacity).ln_1p()).min(OPAQUE_DEPTH)
}

impl Term {
    /// The factor on the term, its own or that of `all` others. Empty if it is 1 at all magnitudes.
    pub(crate) fn factor_among<'a>(&'a self, all: &'a [(f64, f64)]) -> &'a [(f64, f64)] {
        let factor = if self.gradient.is_empty() { all } else { &self.gradient };
        if factor.iter().all(|point| point.1 >= 1.0) { &[] } else { factor }
    }

    /// All factors on the term.
    pub(crate) fn factors_among<'a>(&'a self, all: &'a [(f64, f64)]) -> Factors<'a> {
        let is_one = |factor: &FieldFactor| factor.points.iter().all(|point| point.1 >= 1.0);
        Factors {
            gradient: self.factor_among(all),
            by: if self.by.iter().all(is_one) { &[] } else { &self.by },
            shape: self.shape.as_deref().filter(|shape| !shape.is_one()),
        }
    }

    /// Optical depth per opacity length at `value`, of scattering and of absorption at its peak.
    pub fn depth(&self, value: f64) -> f64 {
        depth_from_opacity(height_at(&self.opacity, value)) + height_at(&self.absorption, value)
    }

    /// A trapezoid: `opacity` and `absorption` from `low` to `high`, with ramps to 0 over `ramp` on either side.
    #[must_use]
    pub fn interval(material: usize, [low, high]: [f64; 2], ramp: f64, opacity: f64, absorption: f64) -> Self {
        let trapezoid = |height| vec![(low - ramp, 0.0), (low, height), (high, height), (high + ramp, 0.0)];
        let absorption = if absorption > 0.0 { trapezoid(absorption) } else { Vec::new() };
        let material = MaterialCurve(vec![(low, material)]);
        Self {
            ramp: Some(ramp),
            opacity: trapezoid(opacity),
            absorption,
            material,
            gradient: Vec::new(),
            by: Vec::new(),
            shape: None,
        }
    }

    /// The same over other values: what it has at the first value of `from` it has at the first one of `to`, and so with the second.
    #[must_use]
    pub fn stretched(&self, from: [f64; 2], to: [f64; 2]) -> Self {
        let scale = (to[1] - to[0]) / (from[1] - from[0]);
        // The ends are exact.
        let moved = |value: f64| {
            let part = (value - from[0]) / (from[1] - from[0]);
            (1.0 - part).mul_add(to[0], part * to[1])
        };
        let curve = |points: &[(f64, f64)]| points.iter().map(|&(value, height)| (moved(value), height)).collect();
        Self {
            ramp: self.ramp.map(|ramp| ramp * scale),
            opacity: curve(&self.opacity),
            absorption: curve(&self.absorption),
            material: MaterialCurve(
                self.material.0.iter().map(|&(value, material)| (moved(value), material)).collect(),
            ),
            gradient: self.gradient.clone(),
            by: self.by.clone(),
            shape: self.shape.as_ref().map(|shape| Arc::new(shape.stretched(moved))),
        }
    }

    /// The interval, if it is one.
    #[must_use]
    pub fn as_interval(&self) -> Option<Interval> {
        let (ramp, absorption) = (self.ramp?, self.absorption.get(1).map_or(0.0, |point| point.1));
        let (&(low, opacity), &(high, _), &(_, material)) =
            (self.opacity.get(1)?, self.opacity.get(2)?, self.material.0.first()?);
        Some(Interval { material, range: [low, high], ramp, opacity, absorption })
    }
}

/// An interval of the transfer function as scene files state it: one material over a value range, with equal ramps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// Index of its material in the scene's materials.
    pub material: usize,
    /// Value range at full opacity, the lower value first.
    pub range: [f64; 2],
    /// Width of the ramp to 0 on either side, in values.
    pub ramp: f64,
    /// Opacity: fraction of light lost over the opacity length, 0 to 1.
    pub opacity: f64,
    /// Optical depth of an opacity length at the peak of the material's absorption spectrum.
    pub absorption: f64,
}

impl Interval {
    /// The term of this interval.
    #[must_use]
    pub fn term(&self) -> Term {
        Term::interval(self.material, self.range, self.ramp, self.opacity, self.absorption)
    }

    /// The nearest interval that a scene of `materials` may state; `None` for a missing material or numbers that are
    /// not finite.
    #[must_use]
    pub fn allowed(&self, materials: &[Material]) -> Option<Self> {
        let material = materials.get(self.material)?;
        let numbers = [self.range[0], self.range[1], self.ramp, self.absorption];
        let finite = numbers.iter().all(|number| number.abs() <= f64::MAX / 4.0);
        let [low, high] = self.range;
        let absorption = if material.absorption.is_some() { self.absorption.clamp(0.0, OPAQUE_DEPTH) } else { 0.0 };
        finite.then(|| Self {
            range: [low.min(high), low.max(high)],
            ramp: self.ramp.max(0.0),
            opacity: material.allowed_opacity(self.opacity),
            absorption,
            ..*self
        })
    }
}

impl MaterialCurve {
    /// The materials at `value` and their shares, which sum to 1; none for an empty curve.
    pub fn at(&self, value: f64) -> impl Iterator<Item = (usize, f64)> + use<> {
        let after = self.0.partition_point(|point| point.0 <= value);
        let before = after.checked_sub(1).and_then(|i| self.0.get(i)).copied();
        let pair = match (before, self.0.get(after).copied()) {
            (Some((v0, m0)), Some((v1, m1))) if m0 != m1 => {
                let share = (value - v0) / (v1 - v0);
                [Some((m0, 1.0 - share)), Some((m1, share))]
            }
            (Some((_, material)), _) | (None, Some((_, material))) => [Some((material, 1.0)), None],
            (None, None) => [None, None],
        };
        pair.into_iter().flatten()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() <= 1e-15
    }

    #[test]
    fn an_interval_is_a_trapezoid() {
        let term = Term::interval(0, [40.0, 90.0], 8.0, 0.5, 0.0);
        for (value, opacity) in
            [(0.0, 0.0), (32.0, 0.0), (36.0, 0.25), (40.0, 0.5), (90.0, 0.5), (94.0, 0.25), (255.0, 0.0)]
        {
            assert!(close(height_at(&term.opacity, value), opacity), "opacity at {value}");
        }
    }

    #[test]
    fn a_term_is_the_interval_that_was_stated_or_none() {
        for (range, ramp, absorption) in [([100.0, 200.3], 0.1, 0.25), ([0.1, 0.7], 1e6, 0.0), ([5.0, 5.0], 0.0, 0.0)] {
            let interval = Interval { material: 1, range, ramp, opacity: 0.3, absorption };
            assert_eq!(interval.term().as_interval(), Some(interval));
        }
        let curve = Term { ramp: None, ..Term::interval(0, [0.0, 1.0], 1.0, 0.3, 0.0) };
        assert_eq!(curve.as_interval(), None, "a curve, whatever its points");
    }

    #[test]
    fn an_interval_without_ramps_holds_its_ends_and_nothing_beyond() {
        let term = Term::interval(0, [40.0, 41.0], 0.0, 0.5, 0.0);
        for (value, opacity) in [(39.999, 0.0), (40.0, 0.5), (40.5, 0.5), (41.0, 0.5), (41.001, 0.0)] {
            assert!(close(height_at(&term.opacity, value), opacity), "opacity at {value}");
        }
    }

    #[test]
    fn overlapping_terms_add_their_scattering() {
        let term = |material| Term::interval(material, [0.0, 10.0], 0.0, 0.5, 0.0);
        let transfer = Transfer {
            opacity_length: 1.0,
            lookup: Lookup::Linear,
            entries: None,
            terms: vec![term(0), term(1)],
            gradient_opacity: Vec::new(),
        };
        let medium = transfer.medium(5.0, 2);
        assert!(medium.scattering.iter().all(|&depth| close(depth, std::f64::consts::LN_2)), "{medium:?}");
    }

    #[test]
    fn a_term_has_its_own_factor_or_that_of_all() {
        let term = |gradient| Term { gradient, ..Term::interval(0, [0.0, 10.0], 0.0, 0.5, 0.0) };
        let [all, own] = [vec![(2.0, 0.0), (4.0, 1.0)], vec![(0.0, 0.25)]];
        let terms = vec![term(Vec::new()), term(own.clone()), term(vec![(0.0, 1.0), (9.0, 1.0)]), term(Vec::new())];
        let transfer = Transfer {
            opacity_length: 1.0,
            lookup: Lookup::Linear,
            entries: None,
            terms,
            gradient_opacity: all.clone(),
        };
        let factors: Vec<_> = transfer.factors().into_iter().map(|factors| factors.gradient).collect();
        assert_eq!(factors, [&all[..], &own[..], &[]], "each once; 1 everywhere is none");
        let depth = |magnitude| {
            let factor = |term: usize| factor_at(transfer.factor_of(&transfer.terms[term]), magnitude);
            medium_of(&transfer.terms, 5.0, 1, factor).scattering[0] / std::f64::consts::LN_2
        };
        for (magnitude, factors) in [(0.0, 1.25), (3.0, 2.25), (8.0, 3.25)] {
            assert!(close(depth(magnitude), factors), "{} at {magnitude}", depth(magnitude));
        }
    }

    #[test]
    fn materials_mix_between_their_points() {
        let curve = MaterialCurve(vec![(10.0, 0), (20.0, 1)]);
        let shares: Vec<_> = curve.at(12.5).collect();
        assert_eq!(shares, [(0, 0.75), (1, 0.25)], "a quarter of the way");
        assert_eq!(curve.at(30.0).collect::<Vec<_>>(), [(1, 1.0)], "beyond the end");
        assert_eq!(curve.at(5.0).collect::<Vec<_>>(), [(0, 1.0)], "before the start");
    }
}
