//! The ends of the picture that a camera shows of a volume.

use std::sync::atomic::{AtomicU64, Ordering};

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use relume_base::number::{count, unsigned, whole};
use relume_scene::{Frame, Term, View};
use relume_volume::{CELL, Geometry, Volume, Voxel, cell_maxima, macrocells, with_voxels};

/// Optical depth from which a pixel is visible: it is brighter than about 12 of 255 in a first look.
const VISIBLE: f64 = 0.016;

/// Optical depths per world unit by the value.
pub(super) struct Depths {
    range: [f64; 2],
    per_value: f64,
    depths: Vec<f64>,
    /// The first entry whose depth is above 0, if there is one.
    first_visible: usize,
    /// The terms and their length of opacity, if the entries cannot show every bend.
    exact: Option<(Vec<Term>, f64)>,
}

impl Depths {
    /// Those of a transfer function with these terms.
    pub(super) fn of(terms: &[Term], opacity_length: f64) -> Self {
        /// Entries: enough for every bend of almost every transfer function, and at most.
        const ENTRIES: [f64; 2] = [2048.0, 65536.0];
        /// Relative to all values.
        const ROUNDING: f64 = 1e-12;
        let curves = || terms.iter().flat_map(|term| [&term.opacity, &term.absorption]);
        let mut bends: Vec<f64> = curves().flatten().map(|point| point.0).collect();
        bends.sort_unstable_by(f64::total_cmp);
        let (first, last) = bends.first().copied().zip(bends.last().copied()).unwrap_or_default();
        // Bends of two terms at one place may differ by rounding.
        let least = ROUNDING * (last - first);
        let gaps = bends.windows(2).map(|pair| pair[1] - pair[0]).filter(|&gap| gap > least);
        let wanted = 2.0 * (last - first) / gaps.fold(f64::MAX, f64::min);
        let exact = (wanted > ENTRIES[1]).then(|| (terms.to_vec(), opacity_length));
        let entries = wanted.clamp(ENTRIES[0], ENTRIES[1]).ceil();
        let value = |entry: usize| (last - first).mul_add(count(entry) / entries, first);
        let depth = |value: f64| -> f64 { terms.iter().map(|term| term.depth(value)).sum::<f64>() / opacity_length };
        // Ends for the values beyond.
        let beyond = [f64::NEG_INFINITY, f64::INFINITY].map(depth);
        let mut depths = vec![beyond[0]];
        depths.par_extend((0..=whole(entries)).into_par_iter().map(|entry| depth(value(entry))));
        depths.push(beyond[1]);
        let first_visible = depths.iter().position(|&depth| depth > 0.0).unwrap_or(usize::MAX);
        let per_value = if last > first { entries / (last - first) } else { 0.0 };
        Self { range: [first, last], per_value, depths, first_visible, exact }
    }

    /// True unless the optical depth of all values up to `largest` is 0.
    fn may_show(&self, largest: f64) -> bool {
        // Interpolated values round: one entry more.
        self.exact.is_some() || self.entry(largest) + 1 >= self.first_visible
    }

    /// The entry of `value`, which is a number.
    fn entry(&self, value: f64) -> usize {
        let [first, last] = self.range;
        let beyond = self.depths.len() - 1;
        if value < first {
            0
        } else if value > last {
            beyond
        } else {
            whole((value - first) * self.per_value + 1.5).min(beyond - 1)
        }
    }

    /// Optical depth at `value`; none where it is no number.
    pub(super) fn at(&self, value: f64) -> f64 {
        if value.is_nan() {
            return 0.0;
        }
        if let Some((terms, opacity_length)) = &self.exact {
            return terms.iter().map(|term| term.depth(value)).sum::<f64>() / opacity_length;
        }
        self.depths[self.entry(value)]
    }
}

/// The voxels that a camera fits.
pub(super) struct Seen<'a> {
    volume: &'a Volume,
    /// The first and the last of them along each axis, if not all are seen.
    crop: Option<[[usize; 3]; 2]>,
    /// Values between them are interpolated.
    is_interpolated: bool,
    depths: Depths,
    /// Whether each macrocell may be visible, x fastest: whether its largest value is, or a smaller one.
    cells: Vec<bool>,
    /// Macrocells along each axis.
    counts: [usize; 3],
}

impl<'a> Seen<'a> {
    /// Those of `volume` with optical `depths`.
    pub(super) fn new(
        volume: &'a Volume,
        crop: Option<[[usize; 3]; 2]>,
        is_interpolated: bool,
        depths: Depths,
    ) -> Self {
        // Objects are brighter than their surroundings: the smallest values would tell little more.
        let cells = cell_maxima(volume).into_iter().map(|largest| depths.may_show(largest)).collect();
        Self { volume, crop, is_interpolated, depths, cells, counts: macrocells(volume.geometry.dims) }
    }

    /// Grid of the volume.
    pub(super) fn geometry(&self) -> &'a Geometry {
        &self.volume.geometry
    }

    /// Indices of the first and the last of them along each axis.
    fn corners(&self) -> [[usize; 3]; 2] {
        self.crop.unwrap_or([[0; 3], self.volume.geometry.dims.map(|side| side - 1)])
    }

    /// The macrocell of a voxel along each axis.
    fn cell(&self, voxel: [usize; 3]) -> [usize; 3] {
        std::array::from_fn(|axis| (voxel[axis] / CELL).min(self.counts[axis] - 1))
    }

    /// Whether the macrocell at `place` may be visible, and how many samples from there on, a `step` apart, lie in it; both in
    /// voxels.
    fn samples_in_cell(&self, place: DVec3, step: DVec3) -> (bool, usize) {
        let last = self.volume.geometry.dims.map(|side| count(side - 1)).into();
        let cell = self.cell(place.clamp(DVec3::ZERO, last).to_array().map(whole));
        // Steps to the face at which the samples leave it; the outermost macrocells extend as far as the rays.
        let steps = |axis: usize| {
            let is_upward = step[axis] > 0.0;
            let is_outermost = if is_upward { cell[axis] + 1 == self.counts[axis] } else { cell[axis] == 0 };
            if step[axis] == 0.0 || is_outermost {
                return f64::INFINITY;
            }
            (count(CELL * (cell[axis] + usize::from(is_upward))) - place[axis]) / step[axis]
        };
        let further = [0, 1, 2].map(steps).into_iter().fold(f64::INFINITY, f64::min);
        (self.may_show(cell), whole(further).saturating_add(1))
    }

    /// Whether each macrocell along x may be visible, of those in which the row of voxels at these places along y and z lies.
    fn row(&self, [y, z]: [usize; 2]) -> &[bool] {
        let [width, height, _] = self.counts;
        let [_, y, z] = self.cell([0, y, z]);
        &self.cells[width * (y + height * z)..][..width]
    }

    /// True unless all voxels and all values between them in a macrocell are invisible.
    fn may_show(&self, [x, y, z]: [usize; 3]) -> bool {
        let [width, height, _] = self.counts;
        self.cells[x + width * (y + height * z)]
    }
}

/// A rectangle in a picture: low and high ends along width and height, in half pictures from the middle.
type Rectangle = [[f64; 2]; 2];

/// The visible pixels at the ends of a square picture.
pub(super) struct Ends {
    /// World points at the first or the last place that is visible, of lines across and along the picture.
    pub(super) points: Vec<DVec3>,
    /// Nothing extends beyond the frame.
    pub(super) is_whole: bool,
    /// From end to end.
    rectangle: Rectangle,
}

impl Ends {
    /// The ends of a volume that `view` shows with `target` in the middle; `None` if nothing is visible. `outline` are points
    /// around most of its visible voxels.
    pub(super) fn of(view: &View, target: DVec3, seen: &Seen<'_>, outline: &[DVec3]) -> Option<Self> {
        /// Fraction of the outline within which its ends hardly lie.
        const INNER: f64 = 0.75;
        /// Fraction of the picture of a thinned volume within which all ends of the whole volume lie beyond.
        const FOUND: f64 = 0.95;
        /// Half pictures behind the outermost place of a side, where there may be the end from another distance.
        const BAND: f64 = 0.25;
        /// Most voxels that are examined before the ends are known.
        const VOXELS: f64 = 2_097_152.0;
        let [low, high] = seen.corners();
        let lines: [usize; 3] = std::array::from_fn(|axis| high[axis] - low[axis] + 1);
        let stride = whole((lines.map(count).iter().product::<f64>() / VOXELS).cbrt().ceil()).max(1);
        let stride = lines.map(|lines| stride.min(lines.div_ceil(32)));
        let reach = |side: fn(DVec3) -> f64| {
            let of_point = |point: &DVec3| {
                let seen = view.seen(*point);
                (side(seen) / if view.parallel { 1.0 } else { seen.z.max(f64::MIN_POSITIVE) }).abs()
            };
            INNER * outline.iter().map(of_point).fold(0.0, f64::max)
        };
        let mut inner = [reach(|seen| seen.x), reach(|seen| seen.y)].map(|reach| [-reach, reach]);
        let picture = Picture::new(view, target, seen, stride);
        // Voxels in the middle of the picture cannot be its ends, unless the outline is far too large.
        picture.add(stride, inner);
        let is_thinned = stride != [1; 3];
        let band = if is_thinned { 0.0 } else { BAND };
        let found = picture.ends(inner, band).or_else(|| {
            inner = Rectangle::default();
            picture.add(stride, inner);
            picture.ends(inner, band)
        });
        if !is_thinned {
            return found;
        }
        // Vessels thinner than a step.
        let beyond = found.map_or(inner, |found| found.rectangle.map(|ends| ends.map(|end| FOUND * end)));
        picture.add([1; 3], beyond);
        picture.ends(inner, BAND)
    }
}

/// Units of an optical depth of 1.
const UNITS: f64 = 1_048_576.0;
/// Half the width of a [`Picture`], in half widths of that of its view.
const FRAME: f64 = 1.25;

/// A square picture whose ends are searched.
struct Picture<'a> {
    view: &'a View,
    seen: &'a Seen<'a>,
    /// Distance of the middle of the object.
    middle: f64,
    /// Pixels of a side.
    side: usize,
    /// Estimated optical depths of the pixels, in units of 1 / [`UNITS`]: sums of whole numbers do not depend on the order of
    /// the threads.
    sums: Vec<AtomicU64>,
}

impl<'a> Picture<'a> {
    /// An empty picture, whose pixels are about as large as steps of `stride` voxels.
    fn new(view: &'a View, target: DVec3, seen: &'a Seen<'a>, stride: [usize; 3]) -> Self {
        /// Least and most pixels of a side.
        const SIDES: [f64; 2] = [256.0, 512.0];
        let step = seen.volume.geometry.spacing * DVec3::from_array(stride.map(count));
        let middle = view.seen(target).z;
        let pitch = step.element_product().cbrt() / (if view.parallel { 1.0 } else { middle } * view.half[1]);
        let side = whole((2.0 * FRAME / pitch).clamp(SIDES[0], SIDES[1]).ceil());
        let sums = (0..side * side).map(|_| AtomicU64::new(0)).collect();
        Self { view, seen, middle, side, sums }
    }

    /// Pixels of half a width of the view.
    fn pixels(&self) -> f64 {
        count(self.side) / (2.0 * FRAME)
    }

    /// Steps of `step` voxels along each axis of the volume, in coordinates of the picture.
    fn axes(&self, step: [usize; 3]) -> [DVec3; 3] {
        let (geometry, view) = (&self.seen.volume.geometry, self.view);
        [0, 1, 2].map(|axis| {
            let along = geometry.direction.col(axis) * geometry.spacing[axis] * count(step[axis]);
            DVec3::new(along.dot(view.right) / view.half[0], along.dot(view.up) / view.half[1], along.dot(view.forward))
        })
    }

    /// Pixels that a box with these `axes` at distance 1 covers along the width and the height: between those of a face and those of a corner.
    fn footprint(&self, axes: [DVec3; 3]) -> DVec3 {
        let sizes = axes.map(DVec3::abs);
        let (most, sum) = (sizes[0].max(sizes[1]).max(sizes[2]), sizes[0] + sizes[1] + sizes[2]);
        most.midpoint(sum) * self.pixels()
    }

    /// Adds every n-th voxel, n by `stride`, that lies outside the `skipped` part of the picture.
    fn add(&self, stride: [usize; 3], skipped: Rectangle) {
        let Self { view, seen, .. } = *self;
        let Seen { volume, depths, .. } = seen;
        let geometry = &volume.geometry;
        let [nx, ny, _] = geometry.dims;
        let [low, high] = self.seen.corners();
        let lines: [usize; 3] = std::array::from_fn(|axis| high[axis] - low[axis] + 1);
        // The first sampled voxel, and axes of one.
        let origin = view.seen(geometry.world_from_index(DVec3::from_array(low.map(count))));
        let axes = self.axes(stride);
        let footprint = self.footprint(axes);
        // Optical depth of a pixel by a voxel at distance 1 with a depth of 1 per world unit.
        let area = view.half[0] * view.half[1] / self.pixels().powi(2);
        let unit = UNITS * geometry.spacing.element_product() * stride.map(count).iter().product::<f64>() / area;
        let samples: [usize; 3] = std::array::from_fn(|axis| lines[axis].div_ceil(stride[axis]));
        // The first sample of each macrocell along x, and the end.
        let sample_of = |cell: usize| (cell * CELL).saturating_sub(low[0]).div_ceil(stride[0]).min(samples[0]);
        let starts: Vec<usize> = (0..seen.counts[0]).map(sample_of).chain([samples[0]]).collect();
        let of_row = |[y, z]: [usize; 2], row: &mut Vec<f64>| {
            let may_show = seen.row([low[1] + y * stride[1], low[2] + z * stride[2]]);
            if !may_show.contains(&true) {
                return;
            }
            let first = low[0] + nx * (low[1] + y * stride[1] + ny * (low[2] + z * stride[2]));
            let start = origin + axes[1] * count(y) + axes[2] * count(z);
            let [before, after] =
                crossing(start, axes[0], skipped, view.parallel).map_or([samples[0]; 2], |[from, to]| {
                    if to < 0.0 {
                        return [samples[0]; 2];
                    }
                    let from = whole(from.max(0.0).ceil()).min(samples[0]);
                    [from, whole(to).saturating_add(1).clamp(from, samples[0])]
                });
            for range in [0..before, after..samples[0]].into_iter().filter(|range| !range.is_empty()) {
                let mut cell = starts.partition_point(|&it| it <= range.start) - 1;
                let last = starts.partition_point(|&it| it < range.end);
                // Neighbours of which all may be visible, or none.
                for cells in may_show[cell..last].chunk_by(PartialEq::eq) {
                    let (from, end) = (starts[cell].max(range.start), starts[cell + cells.len()].min(range.end));
                    cell += cells.len();
                    if !cells[0] {
                        continue;
                    }
                    values(volume, first + from * stride[0], stride[0], end - from, row);
                    for (x, &value) in (from..end).zip(&*row) {
                        let here = depths.at(value);
                        if here > 0.0 {
                            self.add_voxel(start + axes[0] * count(x), here * unit, footprint);
                        }
                    }
                }
            }
        };
        (0..samples[2]).into_par_iter().for_each(|z| {
            let mut row = Vec::new();
            (0..samples[1]).for_each(|y| of_row([y, z], &mut row));
        });
    }

    /// Adds a voxel to the pixels that its `footprint` at distance 1 covers.
    fn add_voxel(&self, seen: DVec3, units: f64, footprint: DVec3) {
        /// Optical depth that hides all behind it.
        const OPAQUE: f64 = 16.0;
        let by = if self.view.parallel { 1.0 } else { seen.z };
        if by <= 0.0 {
            return;
        }
        let last = count(self.side) - 1.0;
        let ends = |at: f64, width: f64| {
            let at = (at / by + FRAME) * self.pixels();
            // Pixels whose centre lies in the footprint, or the nearest one.
            let [first, end] = [(at - width / by / 2.0 - 0.5).ceil(), (at + width / by / 2.0 - 0.5).floor()];
            let covered = if first <= end { [first, end] } else { [at.floor(); 2] };
            // Beyond the frame, the pixels at its edge.
            covered.map(|pixel| whole(pixel.clamp(0.0, last)))
        };
        let ([left, right], [below, above]) = (ends(seen.x, footprint.x), ends(seen.y, footprint.y));
        let covered = count((right - left + 1) * (above - below + 1));
        let units = u64::from(unsigned(whole((units / (by * by * covered)).min(OPAQUE * UNITS))));
        for y in below..=above {
            for pixel in y * self.side + left..=y * self.side + right {
                self.sums[pixel].fetch_add(units, Ordering::Relaxed);
            }
        }
    }

    /// Pixels that may be visible: voxels near them add to a part of [`VISIBLE`].
    fn candidates(&self) -> Vec<bool> {
        /// Part of [`VISIBLE`].
        const PART: f64 = 0.125;
        let side = self.side;
        let by = if self.view.parallel { 1.0 } else { self.middle };
        // Between voxels, values change up to the centre of the next; nearer ones are larger.
        let near = self.footprint(self.axes([1; 3])) * (0.75 / by);
        let [across, along] = [near.x, near.y].map(|pixels| whole(pixels.ceil()).max(1));
        let least = PART * VISIBLE * UNITS;
        let found: Vec<bool> = self.sums.iter().map(|sum| count_of(sum) >= least).collect();
        let around = |at: usize, by: usize| at.saturating_sub(by)..side.min(at + by + 1);
        let rows: Vec<bool> = found
            .par_chunks(side)
            .flat_map_iter(|row| (0..side).map(move |x| row[around(x, across)].contains(&true)))
            .collect();
        let column = |x: usize, y: usize| around(y, along).any(|y| rows[y * side + x]);
        (0..side).into_par_iter().flat_map_iter(|y| (0..side).map(move |x| column(x, y))).collect()
    }

    /// The ends of the visible part, and places up to `band` half pictures behind them; `None` if there is none outside the
    /// `inner` part.
    fn ends(&self, inner: Rectangle, band: f64) -> Option<Ends> {
        let candidates = self.candidates();
        let mut found = Ends { points: Vec::new(), is_whole: true, rectangle: inner };
        for (axis, end) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            self.add_end([axis, end], [inner[axis][end], band], &candidates, &mut found)?;
        }
        Some(found)
    }

    /// Adds the low or the high end of `axis` to `found`, if any lies beyond `inner`.
    fn add_end(
        &self,
        [axis, end]: [usize; 2],
        [inner, band]: [f64; 2],
        candidates: &[bool],
        found: &mut Ends,
    ) -> Option<()> {
        /// Lines along the axis, as fine as a vessel of one voxel.
        const LINES: f64 = 768.0;
        let side = self.side;
        let outward = if end == 0 { -1.0 } else { 1.0 };
        let place = |pixel: f64| pixel / self.pixels() - FRAME;
        let per_pixel = whole((LINES / count(side)).round()).max(1);
        let mut is_found = vec![false; side * per_pixel];
        let mut outermost: Option<f64> = None;
        for behind in 0..side {
            let pixel = if end == 0 { behind } else { side - 1 - behind };
            let at = place(count(pixel) + 0.5);
            if outward * (at - inner) < 0.0 || outermost.is_some_and(|it| (it - at).abs() > band) {
                break;
            }
            let of_line = |line: usize| if axis == 0 { [pixel, line / per_pixel] } else { [line / per_pixel, pixel] };
            let index = |line: usize| {
                let [x, y] = of_line(line);
                y * side + x
            };
            let lines: Vec<usize> =
                (0..is_found.len()).filter(|&line| !is_found[line] && candidates[index(line)]).collect();
            let across = |line: usize| place((count(line) + 0.5) / count(per_pixel));
            let point = |at: f64, line: usize| if axis == 0 { [at, across(line)] } else { [across(line), at] };
            let visible: Vec<(usize, f64, f64)> = lines
                .into_par_iter()
                .with_min_len(8)
                .filter_map(|line| {
                    if behind == 0 {
                        // Beyond the frame.
                        let is_beyond = count_of(&self.sums[index(line)]) >= VISIBLE * UNITS;
                        return is_beyond.then_some((line, at, self.middle));
                    }
                    let depth = self.visible_at(point(at, line))?;
                    // The first pixels are those that decide.
                    let next = at + outward / self.pixels();
                    let edge = if outermost.is_none() {
                        self.edge(at, next, |at| point(at, line))
                    } else {
                        f64::midpoint(at, next)
                    };
                    Some((line, edge, depth))
                })
                .collect();
            for (line, edge, depth) in visible {
                is_found[line] = true;
                found.is_whole &= behind > 0;
                outermost.get_or_insert(at);
                let farther = if end == 0 { f64::min } else { f64::max };
                let ends = &mut found.rectangle[axis][end];
                *ends = farther(*ends, edge);
                let [x, y] = point(edge, line);
                let there = self.view.eye + depth * self.view.forward;
                found.points.push(self.view.point_at(DVec2::new(1.0 + x, 1.0 - y) / 2.0, there));
            }
        }
        outermost.map(|_| ())
    }

    /// The place between a visible one and an invisible one from which on `point` is invisible.
    fn edge(&self, visible: f64, invisible: f64, point: impl Fn(f64) -> [f64; 2]) -> f64 {
        /// Halvings.
        const HALVINGS: u32 = 3;
        let (mut near, mut far) = (visible, invisible);
        for _ in 0..HALVINGS {
            let middle = f64::midpoint(near, far);
            (near, far) = if self.visible_at(point(middle)).is_some() { (middle, far) } else { (near, middle) };
        }
        f64::midpoint(near, far)
    }

    /// Depth along the line of sight at which the ray through a place of the picture, in half pictures, gets visible: where
    /// the samples of a march add up to [`VISIBLE`].
    fn visible_at(&self, [x, y]: [f64; 2]) -> Option<f64> {
        let (view, volume) = (self.view, self.seen.volume);
        let geometry = &volume.geometry;
        let across = x * view.half[0] * view.right + y * view.half[1] * view.up;
        let (eye, along) =
            if view.parallel { (view.eye + across, view.forward) } else { (view.eye, view.forward + across) };
        let step_length = geometry.spacing.min_element();
        let by_step = step_length / along.length();
        let to_index = geometry.direction.transpose();
        let from = to_index * (eye - geometry.origin) / geometry.spacing;
        let step = to_index * along * by_step / geometry.spacing;
        let near = if view.parallel { f64::NEG_INFINITY } else { 0.0 };
        let clip = |[low, high]: [DVec3; 2]| {
            let (one, other) = ((low - from) / step, (high - from) / step);
            // No number where a ray lies in a face.
            let (enter, leave) = (one.min(other), one.max(other));
            (0..3).fold([near, f64::INFINITY], |[near, far], axis| [near.max(enter[axis]), far.min(leave[axis])])
        };
        // Samples are numbered from the box of the volume; the crop box selects some of them.
        let frame = Frame::of(volume);
        let thin = frame.thin_axes().into();
        let around = |[low, high]: [DVec3; 2]| {
            [DVec3::select(thin, DVec3::splat(-0.5), low), DVec3::select(thin, DVec3::splat(0.5), high)]
        };
        let whole_box = frame.whole_box();
        let [start, _] = clip(around(whole_box));
        let crop = self.seen.crop.map_or(whole_box, |corners| corners.map(|it| DVec3::from_array(it.map(count))));
        let [enter, leave] = clip(around(crop));
        let number = |at: f64| (at - start - 0.5).ceil().max(0.0);
        let samples = whole(number(enter))..if leave > enter { whole(number(leave)) } else { 0 };
        let place = |sample: usize| start + count(sample) + 0.5;
        let limit = VISIBLE / step_length;
        let (mut sum, seen) = (0.0, self.seen);
        with_voxels!(&volume.voxels, stored => {
            let mut sample = samples.start;
            while sample < samples.end {
                let (may_show, in_cell) = seen.samples_in_cell(from + place(sample) * step, step);
                let end = sample.saturating_add(in_cell).min(samples.end);
                for sample in if may_show { sample..end } else { end..end } {
                    let stored = value_at(stored, geometry.dims, from + place(sample) * step, seen.is_interpolated);
                    sum += seen.depths.at(stored * volume.slope + volume.intercept);
                    if sum >= limit {
                        return Some(place(sample) * by_step);
                    }
                }
                sample = end;
            }
        });
        None
    }
}

/// A sum as a number.
fn count_of(sum: &AtomicU64) -> f64 {
    count(usize::try_from(sum.load(Ordering::Relaxed)).unwrap_or(usize::MAX))
}

/// The stored value at `place`, in voxels: linear between voxels, or that of the nearest.
fn value_at<T: Voxel>(stored: &[T], [nx, ny, nz]: [usize; 3], place: DVec3, is_interpolated: bool) -> f64 {
    let at = |x: usize, y: usize, z: usize| stored.get(x + nx * (y + ny * z)).map_or(f64::NAN, |&it| Voxel::to_f64(it));
    let last = DVec3::from_array([nx, ny, nz].map(|side| count(side - 1)));
    let place = place.clamp(DVec3::ZERO, last);
    if !is_interpolated {
        let [x, y, z] = (place + 0.5).to_array().map(whole);
        return at(x, y, z);
    }
    let base = place.floor().min(last - 1.0).max(DVec3::ZERO);
    let [x, y, z] = base.to_array().map(whole);
    let [fx, fy, fz] = (place - base).to_array();
    let [x1, y1, z1] = [(x, nx), (y, ny), (z, nz)].map(|(at, side)| (at + 1).min(side - 1));
    // Without hardware for it, a fused multiplication takes many times as long.
    let mix = |one: f64, other: f64, part: f64| (other - one) * part + one;
    let line = |y: usize, z: usize| mix(at(x, y, z), at(x1, y, z), fx);
    let plane = |z: usize| mix(line(y, z), line(y1, z), fy);
    mix(plane(z), plane(z1), fz)
}

/// Steps along `axis` from `start` between which a row lies in the `inner` part of the picture, in coordinates of
/// [`View::seen`].
fn crossing(start: DVec3, axis: DVec3, inner: Rectangle, parallel: bool) -> Option<[f64; 2]> {
    let (by, by_step) = if parallel { (1.0, 0.0) } else { (start.z, axis.z) };
    let (mut from, mut to) = (f64::NEG_INFINITY, f64::INFINITY);
    for (at, step, ends) in [(start.x, axis.x, inner[0]), (start.y, axis.y, inner[1])] {
        for (sign, end) in [1.0, -1.0].into_iter().zip(ends) {
            // Inside where room + step·room_step is above 0.
            let (room, room_step) = (sign * (at - end * by), sign * (step - end * by_step));
            if room_step > 0.0 {
                from = from.max(-room / room_step);
            } else if room_step < 0.0 {
                to = to.min(-room / room_step);
            } else if room <= 0.0 {
                return None;
            }
        }
    }
    (from < to).then_some([from, to])
}

/// Puts `number` values of `volume` from the voxel at `first`, every n-th by `step`, into `row`.
fn values(volume: &Volume, first: usize, step: usize, number: usize, row: &mut Vec<f64>) {
    row.clear();
    with_voxels!(&volume.voxels, stored => {
        let stored = stored.get(first..).unwrap_or_default().iter().step_by(step).take(number);
        row.extend(stored.map(|&it| Voxel::to_f64(it) * volume.slope + volume.intercept));
    });
}

#[cfg(test)]
#[expect(clippy::expect_used, reason = "a failed step fails the test")]
mod tests {
    use super::*;
    use relume_scene::{Aim, Camera, Fill, Projection};
    use relume_volume::Voxels;

    #[test]
    fn bends_that_differ_by_rounding_are_one() {
        let terms = [[0.3, 0.7], [0.8, 1.2]].map(|range| Term::interval(0, range, 0.1, 0.5, 0.0));
        // The second layer begins to rise where the first begins to fall.
        let apart = (terms[0].opacity[2].0 - terms[1].opacity[0].0).abs();
        assert!(apart > 0.0 && apart < 1e-12, "{apart}");
        let depths = Depths::of(&terms, 1.0);
        assert!(depths.exact.is_none());
        for value in [0.1, 0.25, 0.3, 0.72, 0.75, 0.8, 1.25, 1.4] {
            let expected: f64 = terms.iter().map(|term| term.depth(value)).sum();
            // Values are rounded to entries: by 0.0003 on ramps with a depth of 0.7 over 0.1.
            assert!((depths.at(value) - expected).abs() < 0.01, "{value}: {}, {expected}", depths.at(value));
        }
    }

    #[test]
    fn macrocells_that_are_passed_over_are_invisible() {
        let dims = [45, 38, 51];
        let middle = DVec3::new(20.0, 22.0, 24.0);
        // A thin shell with specks around it, one of them beside a voxel that is no number.
        let value = |index: usize| {
            let [x, y, z] = [index % dims[0], index / dims[0] % dims[1], index / (dims[0] * dims[1])];
            let radius = DVec3::from_array([x, y, z].map(count)).distance(middle);
            match index {
                70_001 => f32::NAN,
                70_002 | 5_003 | 86_000 => 60.0,
                _ => relume_base::number::rounded(100.0 - 20.0 * (radius - 11.0).abs()),
            }
        };
        let geometry = Geometry::new("test", dims, DVec3::new(1.0, 0.8, 1.3), DVec3::ZERO, glam::DMat3::IDENTITY)
            .expect("a box is a grid");
        let voxels = Voxels::F32((0..dims.iter().product()).map(value).collect());
        let volume = Volume::new("test", voxels, geometry).expect("as many voxels as the grid has");
        let target = volume.geometry.world_from_index(middle);
        for (projection, is_interpolated) in [
            (Projection::Perspective { fov_degrees: 40.0 }, true),
            (Projection::Orthographic { height: Some(70.0) }, true),
            (Projection::Perspective { fov_degrees: 40.0 }, false),
        ] {
            let seen = || {
                let depths = Depths::of(&[Term::interval(0, [50.0, 90.0], 5.0, 0.01, 0.0)], 1.0);
                Seen::new(&volume, None, is_interpolated, depths)
            };
            let skipping = seen();
            let everywhere = Seen { cells: vec![true; skipping.cells.len()], ..seen() };
            assert!(skipping.cells.contains(&false) && skipping.cells.contains(&true));
            for (azimuth, elevation) in [(0.0, 0.0), (25.0, 40.0), (200.0, -70.0)] {
                let aim = Aim::Orbit { azimuth, elevation, fill: Fill::of(1.2), front: DVec3::NEG_Y, around: None };
                let view = Camera { projection, aim, up: DVec3::Z }.view(&volume.geometry, 1.0);
                let view = view.expect("it has a line of sight");
                let points = |seen: &Seen<'_>| Ends::of(&view, target, seen, &[]).map(|ends| ends.points);
                let found = points(&skipping);
                assert!(found.as_ref().is_some_and(|points| points.len() > 10), "{projection:?}, {azimuth}");
                assert_eq!(found, points(&everywhere), "{projection:?}, {azimuth}");
            }
        }
    }
}
