//! The choice between samples and segments, and whether refined steps count crossed intervals: whether values change by more than an interval of the
//! transfer function in a step.

use crate::{Scene, Term};
use relume_base::number::count;
use relume_base::progress::Progress;

/// An interval that steps miss.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Narrow {
    /// Width of the interval, in values.
    pub width: f64,
    /// Mean change of the value over a step that touches the interval.
    pub change: f64,
}

/// The interval of the transfer function of `scene` that is narrowest by the change of the values over a step, if it is
/// narrower than that: samples then miss it in most steps, and segments do not (docs/theory/segments.md).
#[must_use]
pub fn narrow(scene: &Scene) -> Option<Narrow> {
    let supports = || scene.transfer.terms.iter().flat_map(supports);
    // Without an end, an interval cannot be missed.
    if !supports().any(|[low, high]| (high - low).is_finite()) {
        return None;
    }
    let pairs = pairs(scene);
    let of_support = |[low, high]: [f64; 2]| {
        let touching = pairs.iter().filter(|[from, to]| *from <= high && *to >= low).map(|[from, to]| to - from);
        let (sum, number) = touching.fold((0.0, 0_usize), |(sum, number), change| (sum + change, number + 1));
        Narrow { width: high - low, change: sum / count(number.max(1)) }
    };
    let missed = supports().map(of_support).filter(|narrow| narrow.width < narrow.change);
    missed.min_by(|a, b| (a.width / a.change).total_cmp(&(b.width / b.change)))
}

/// A range of visible values that steps cross.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossed {
    /// Width of a range of visible values.
    pub width: f64,
    /// Part of the steps that touch it in which the values change by more.
    pub part: f64,
}

/// The range of visible values of `scene` that is crossed by the largest part of the steps that touch it, if that is a tenth or more: two samples
/// that see nothing may then have a medium between them (docs/theory/refinement.md). A range is one of overlapping intervals.
#[must_use]
pub fn crossed(scene: &Scene) -> Option<Crossed> {
    const PART: f64 = 0.1;
    let mut supports: Vec<[f64; 2]> = scene.transfer.terms.iter().flat_map(supports).collect();
    supports.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut ranges: Vec<[f64; 2]> = Vec::new();
    for [low, high] in supports {
        match ranges.last_mut() {
            Some(last) if last[1] >= low => last[1] = last[1].max(high),
            _ => ranges.push([low, high]),
        }
    }
    ranges.retain(|[low, high]| (high - low).is_finite());
    if ranges.is_empty() {
        return None;
    }
    let pairs = pairs(scene);
    let of_range = |[low, high]: [f64; 2]| {
        let touching = pairs.iter().filter(|[from, to]| *from <= high && *to >= low);
        let (all, by) = touching
            .fold((0_usize, 0_usize), |(all, by), [from, to]| (all + 1, by + usize::from(to - from > high - low)));
        Crossed { width: high - low, part: count(by) / count(all.max(1)) }
    };
    ranges.into_iter().map(of_range).filter(|range| range.part >= PART).max_by(|a, b| a.part.total_cmp(&b.part))
}

/// Ranges of values in which `term` scatters or absorbs.
fn supports(term: &Term) -> impl Iterator<Item = [f64; 2]> {
    [&term.opacity, &term.absorption].into_iter().flat_map(|curve| {
        let mut ranges: Vec<[f64; 2]> = Vec::new();
        for (i, point) in curve.iter().enumerate().filter(|(_, point)| point.1 > 0.0) {
            let before = if i == 0 { f64::NEG_INFINITY } else { curve[i - 1].0 };
            let after = curve.get(i + 1).map_or(f64::INFINITY, |next| next.0);
            match ranges.last_mut() {
                Some(last) if last[1] >= point.0 => last[1] = after,
                _ => ranges.push([before, after]),
            }
        }
        ranges
    })
}

/// Lower and higher value at the ends of steps along the axes, from voxels spread over the volume.
fn pairs(scene: &Scene) -> Vec<[f64; 2]> {
    let volume = &scene.fields.first().volume;
    let pair = |(i, ends): (usize, &Option<[f64; 2]>)| {
        let [from, to] = (*ends)?;
        let change = (to - from) * scene.accuracy.step_length / volume.geometry.spacing[i % 3];
        let (middle, half) = (f64::midpoint(from, to), change.abs() / 2.0);
        (middle.is_finite() && half.is_finite()).then_some([middle - half, middle + half])
    };
    volume.neighbours().iter().enumerate().filter_map(pair).collect()
}

/// Reads the voxels that plans of a scene need of a file of bricks, which takes up to seconds the first time. `progress` can
/// cancel it: then the next plan reads them.
pub fn read_ahead(scene: &Scene, progress: &dyn Progress) {
    scene.fields.first().volume.read_neighbours_ahead(progress);
}
