//! Overlay of a picture as an SVG drawing without background: scale bar, orientation letters, legend and title.

use std::fmt::Write as _;

use super::{Edges, Frame, ScaleBar, colours, material_colours};
use relume_base::number::count;
use relume_colour::spectrum::Spectrum;
use relume_colour::spectrum::colour::{LinearSrgb, display_code, xyz_of};
use relume_colour::written::escaped;
use relume_scene::film::display_from_xyz;
use relume_scene::plan::Planned;
use relume_scene::{Display, LabelEntry, Mix, MixLight, Scene};

/// Size of letters as a fraction of the smaller side of the picture, and their smallest size in pixels.
const LETTER: f64 = 1.0 / 36.0;
const SMALLEST: f64 = 11.0;
/// Longest scale bar as a fraction of the width of the picture.
const LONGEST_BAR: f64 = 0.25;
/// Largest part of the height that the legend takes.
const LEGEND: f64 = 0.7;
/// Longest name in the legend, in letters.
const LONGEST_NAME: usize = 28;
/// Mean width of a letter of a name, as a fraction of the size of letters.
const LETTER_WIDTH: f64 = 0.6;
/// Distance of the lines of the legend, and width of the edges of letters, in sizes of letters.
const LINE: f64 = 1.5;
const EDGE: f64 = 0.18;
/// Size of the letters of a legend without room for all lines, as a fraction of the usual one.
const SMALL: f64 = 0.6;
/// Largest fraction of the width that the columns of a legend take together.
const COLUMNS: f64 = 0.6;
/// Smallest width of a picture whose legend has curves of spectra, in sizes of letters.
const WITH_CURVES: f64 = 24.0;

/// A line of a legend.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Name of a material or a light.
    pub name: String,
    /// Its colour.
    pub colour: LinearSrgb,
    /// Reflectance, or relative power.
    pub spectrum: Spectrum,
}

impl Entry {
    /// Those of the materials of these `indices` under `mix`, in the order of their names.
    #[must_use]
    pub fn of_materials(scene: &Scene, indices: &[usize], mix: &Mix) -> Vec<Self> {
        let colours = material_colours(scene, mix);
        let entry = |&index: &usize| {
            let (material, &colour) = (scene.materials.get(index)?, colours.get(index)?);
            Some(Self { name: material.name.clone(), colour, spectrum: material.reflectance.spectrum().clone() })
        };
        by_name(indices.iter().filter_map(entry).collect())
    }

    /// Those of the visible labels of `scene` by their own names, and of the materials of these `indices` that it shows otherwise,
    /// under `mix`.
    #[must_use]
    pub fn of_labels_and_materials(scene: &Scene, indices: &[usize], mix: &Mix) -> Vec<Self> {
        let Some(labels) = &scene.labels else { return Self::of_materials(scene, indices, mix) };
        let others: Vec<usize> = indices.iter().copied().filter(|&index| scene.shows_values_as(index)).collect();
        let colours = material_colours(scene, mix);
        let visible = labels.declared.iter().filter(|entry| entry.is_visible());
        let entry = |label: &LabelEntry| {
            let (material, &colour) = (scene.materials.get(label.material)?, colours.get(label.material)?);
            Some(Self { name: label.name.clone(), colour, spectrum: material.reflectance.spectrum().clone() })
        };
        let mut all: Vec<Self> = visible.filter_map(entry).collect();
        all.extend(Self::of_materials(scene, &others, mix));
        by_name(all)
    }

    /// Those of the lights of `mix` that are on, in colours of equal brightness.
    #[must_use]
    pub fn of_lights(mix: &Mix, display: &Display) -> Vec<Self> {
        let to_display = display_from_xyz(mix, display);
        let entry = |light: &MixLight| {
            let spectrum = light.spectrum.spectrum();
            let colour = to_display * glam::DVec3::from(xyz_of(spectrum).0);
            let brightest = colour.max_element().max(f64::MIN_POSITIVE);
            Self {
                name: light.name.clone(),
                colour: LinearSrgb((colour / brightest).to_array()),
                spectrum: spectrum.clone(),
            }
        };
        mix.0.iter().filter(|light| light.weight > 0.0).map(entry).collect()
    }
}

/// Content of an overlay.
#[derive(Clone, Debug, Default)]
pub struct Overlay<'a> {
    /// Visible materials.
    pub materials: Vec<Entry>,
    /// Lights that are on.
    pub lights: Vec<Entry>,
    /// Title above the picture.
    pub title: Option<&'a str>,
    /// Whether the background is bright, so that letters are dark.
    pub bright: bool,
}

impl Overlay<'_> {
    /// The overlay, without a title, of a picture of `scene` by `planned` under `mix`.
    #[must_use]
    pub fn of_scene(scene: &Scene, planned: &Planned, mix: &Mix) -> Self {
        let materials = Entry::of_labels_and_materials(scene, &planned.materials, mix);
        Self { materials, lights: Entry::of_lights(mix, &scene.display), title: None, bright: false }
    }

    /// The overlay, without a title, of a picture of surfaces of these names and reflectances, lit from all of so many
    /// positions.
    #[must_use]
    pub fn of_surfaces(surfaces: &[(String, Spectrum)], positions: usize, mix: &Mix, display: &Display) -> Self {
        let spectra: Vec<Spectrum> = surfaces.iter().map(|(_, spectrum)| spectrum.clone()).collect();
        let colours = colours(spectra, positions, mix, display);
        let entry = |((name, spectrum), colour): (&(String, Spectrum), LinearSrgb)| Entry {
            name: name.clone(),
            colour,
            spectrum: spectrum.clone(),
        };
        let materials = by_name(surfaces.iter().zip(colours).map(entry).collect());
        Self { materials, lights: Entry::of_lights(mix, display), title: None, bright: false }
    }

    /// The overlay of a picture of `size` (width, height) in pixels with this `frame`.
    #[must_use]
    pub fn svg(&self, frame: &Frame, size: [usize; 2]) -> String {
        let [width, height] = size.map(count);
        let letter = (width.min(height) * LETTER).max(SMALLEST);
        let [ink, edge] = if self.bright { ["#111111", "#ffffff"] } else { ["#ffffff", "#000000"] };
        let mut out = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" \
             font-family=\"sans-serif\" font-size=\"{letter}\" fill=\"{ink}\" stroke=\"{edge}\" \
             stroke-width=\"{}\" stroke-linejoin=\"round\" paint-order=\"stroke\">",
            EDGE * letter
        );
        let mut text = |x: f64, y: f64, anchor: &str, more: &str, text: &str| {
            // Writing to a string cannot fail.
            write!(out, "<text x=\"{x}\" y=\"{y}\" text-anchor=\"{anchor}\"{more}>{}</text>", escaped(text)).ok();
        };
        let mut top = 1.4 * letter;
        if let Some(title) = self.title {
            // A letter of a bold font is some 0.7 of its size wide.
            let size = (1.4 * letter).min(0.95 * width / (0.7 * count(title.chars().count().max(1))));
            let style = format!(" font-size=\"{size}\" font-weight=\"bold\"");
            text(width / 2.0, 1.9 * letter, "middle", &style, title);
            top += 2.0 * letter;
        }
        if let Some(Edges { left, right, top: above, bottom }) = &frame.edges {
            text(0.6 * letter, height / 2.0, "start", "", left);
            text(width - 0.6 * letter, height / 2.0, "end", "", right);
            text(width / 2.0, top, "middle", "", above);
            text(width / 2.0, height - 0.6 * letter, "middle", "", bottom);
        }
        let bar = frame.pixel.and_then(|pixel| ScaleBar::new(pixel, LONGEST_BAR * width, frame.unit));
        if let Some(ScaleBar { pixels, text: length, .. }) = bar {
            let (x, y) = (letter, height - letter);
            text(x, y - 0.7 * letter, "start", "", &length);
            let path = format!("M{x} {}v{h}h{pixels}v-{h}", y - 0.4 * letter, h = 0.4 * letter);
            for (colour, line) in [(edge, 0.35), (ink, 0.15)] {
                let line = line * letter;
                write!(out, "<path d=\"{path}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"{line}\"/>").ok();
            }
        }
        // The legend ends above the scale bar.
        let bar = 5.0 * letter;
        let room_from = |top: f64| (LEGEND * height).min(height - top - bar);
        let lines = relume_base::number::whole(room_from(top) / (LINE * letter)).max(1);
        // A long legend has small letters, no curves, and columns.
        let is_long = self.materials.len() + self.lights.len() + 1 > lines;
        let at_edges = letter;
        let letter = if is_long { (SMALL * letter).max(SMALLEST) } else { letter };
        let has_curves = !is_long && width >= WITH_CURVES * letter;
        // Names begin behind the swatches and the curves.
        let indent = if has_curves { 6.0 } else { 2.5 } * letter;
        let longest =
            self.materials.iter().chain(&self.lights).map(|entry| shortened(&entry.name).chars().count()).max();
        let end = (LETTER_WIDTH * letter).mul_add(count(longest.unwrap_or(0)), indent);
        let column = end + letter;
        // Beside the letters in the middle of the left edge, if lines extend as far.
        let needed = (LINE * letter * count(self.materials.len() + self.lights.len() + 1)).min(room_from(top));
        let is_beside = frame.edges.is_some() && top + needed > height / 2.0 - 1.5 * at_edges;
        let left = if is_beside { 1.5 * at_edges } else { 0.0 };
        let columns = if is_long { relume_base::number::whole((COLUMNS * width - left) / column).max(1) } else { 1 };
        // Below the letters in the middle of the upper edge, if names extend as far.
        if frame.edges.is_some() && column.mul_add(count(columns - 1), end) + left > width / 2.0 - 1.5 * letter {
            top += 1.5 * letter;
        }
        // Writing to a string cannot fail.
        let moved = if is_beside { format!(" transform=\"translate({left} 0)\"") } else { String::new() };
        write!(out, "<g font-size=\"{letter}\" stroke-width=\"{}\"{moved}>", EDGE * letter).ok();
        self.legend(&mut out, [top, indent], [letter, room_from(top), column], columns, has_curves);
        out + "</g></svg>"
    }

    /// Appends the legend from `top` on: visible materials with reflectances, and lights with spectra, in at most `room` pixels.
    /// Names begin at `indent`. Materials without room continue in up to so many `columns` of this width.
    fn legend(
        &self,
        out: &mut String,
        [top, indent]: [f64; 2],
        [letter, room, width]: [f64; 3],
        columns: usize,
        has_curves: bool,
    ) {
        let line = LINE * letter;
        let most = relume_base::number::whole(room / line).max(1);
        for ([column, index], row) in self.rows(most, columns) {
            let left = count(column) * width;
            let (x, y) = (letter + left, count(index).mul_add(line, top));
            let Entry { name, colour, spectrum } = match row {
                Row::Gap => continue,
                Row::More(left) => {
                    write!(out, "<text x=\"{x}\" y=\"{y}\">and {left} more</text>").ok();
                    continue;
                }
                Row::Entry(entry) => entry,
            };
            let half = letter / 2.0;
            let ink = if self.bright { "#111111" } else { "#ffffff" };
            write!(
                out,
                "<rect x=\"{x}\" y=\"{}\" width=\"{letter}\" height=\"{letter}\" rx=\"{}\" fill=\"{}\" \
                 stroke=\"{ink}\" stroke-width=\"{}\"/>",
                y - 0.85 * letter,
                0.15 * letter,
                display_code(*colour),
                0.06 * letter
            )
            .ok();
            if has_curves {
                let corner = [1.5_f64.mul_add(letter, x), half.mul_add(0.3, y)];
                let curve = curve(spectrum, corner, [3.0 * letter, letter]);
                for (stroke, line) in [(String::new(), 0.3), (format!(" stroke=\"{ink}\""), 0.1)] {
                    let line = line * letter;
                    write!(out, "<polyline points=\"{curve}\" fill=\"none\"{stroke} stroke-width=\"{line}\"/>").ok();
                }
            }
            write!(out, "<text x=\"{}\" y=\"{y}\">{}</text>", left + indent, escaped(&shortened(name))).ok();
        }
    }

    /// Column and line of the rows of the legend, whose columns have `most` lines or three: materials, a gap, lights. Lights have half
    /// of the lines of the first column at most.
    fn rows(&self, most: usize, columns: usize) -> Vec<([usize; 2], Row<'_>)> {
        fn listed(entries: &[Entry], room: usize) -> Vec<Row<'_>> {
            let shown = if entries.len() <= room { entries.len() } else { room.saturating_sub(1) };
            let left = entries.len() - shown;
            entries.iter().take(shown).map(Row::Entry).chain((left > 0).then_some(Row::More(left))).collect()
        }
        let lights = listed(&self.lights, most / 2);
        let lines = most.saturating_sub(lights.len() + 1);
        let materials = listed(&self.materials, lines * columns);
        let below = materials.len().min(lines.max(1));
        let place = |(index, row): (usize, _)| ([index / lines.max(1), index % lines.max(1)], row);
        let materials = materials.into_iter().enumerate().map(place);
        let lights = [Row::Gap].into_iter().chain(lights).enumerate().map(|(index, row)| ([0, below + index], row));
        materials.chain(lights).collect()
    }
}

/// Entries in the order of their names; numbers at their ends count as numbers: `label_2` before `label_10`.
fn by_name(mut entries: Vec<Entry>) -> Vec<Entry> {
    let parts = |entry: &Entry| {
        let text = entry.name.trim_end_matches(|letter: char| letter.is_ascii_digit());
        (text.to_owned(), entry.name[text.len()..].parse().unwrap_or(0_u64))
    };
    entries.sort_by_cached_key(parts);
    entries
}

/// A line of the legend.
enum Row<'a> {
    Entry(&'a Entry),
    /// An empty line.
    Gap,
    /// So many entries have no line.
    More(usize),
}

/// Points of the curve of `spectrum` in a box with this bottom left corner and size, for SVG.
fn curve(spectrum: &Spectrum, [x, y]: [f64; 2], [width, height]: [f64; 2]) -> String {
    let samples = spectrum.samples();
    let largest = samples.iter().copied().fold(0.0, f64::max);
    // Reflectances are drawn from 0 to 1, lights up to their peak.
    let scale = height / if largest > 1.0 || largest <= 0.1 { largest.max(f64::MIN_POSITIVE) } else { 1.0 };
    let step = width / count(samples.len() - 1);
    let point = |(index, sample): (usize, &f64)| {
        format!("{:.2},{:.2}", count(index).mul_add(step, x), (-scale).mul_add(sample.max(0.0), y))
    };
    samples.iter().enumerate().map(point).collect::<Vec<_>>().join(" ")
}

/// A name cut to the longest that the legend shows.
fn shortened(name: &str) -> String {
    if name.chars().count() <= LONGEST_NAME {
        return name.to_owned();
    }
    name.chars().take(LONGEST_NAME - 1).chain(['…']).collect()
}

#[cfg(test)]
#[expect(clippy::unwrap_used, reason = "a test fails by panicking")]
mod tests {
    use super::super::PixelLength;
    use super::*;

    #[test]
    fn a_legend_without_room_for_all_says_how_many_it_leaves_out_and_keeps_the_lights() {
        let entries = |count: usize, name: &str| -> Vec<Entry> {
            let entry = |index| Entry {
                name: format!("{name}_{index}"),
                colour: LinearSrgb([1.0; 3]),
                spectrum: Spectrum::constant(0.5),
            };
            (0..count).map(entry).collect()
        };
        let overlay =
            Overlay { materials: entries(19, "label"), lights: entries(1, "day"), title: None, bright: false };
        let names = |most| -> Vec<String> {
            let name = |row| match row {
                Row::Entry(entry) => entry.name.clone(),
                Row::Gap => String::new(),
                Row::More(left) => format!("and {left} more"),
            };
            let rows = overlay.rows(most, 1);
            assert!(rows.iter().enumerate().all(|(line, (place, _))| *place == [0, line]), "one below the other");
            rows.into_iter().map(|(_, row)| name(row)).collect()
        };
        let places: Vec<[usize; 2]> = overlay.rows(10, 3).into_iter().map(|(place, _)| place).collect();
        // Eight lines a column: 19 materials in three of them, and the gap and the light below the first.
        assert_eq!((places.len(), places[8], places[18], places[20]), (21, [1, 0], [2, 2], [0, 9]));
        let all = names(21);
        assert_eq!((all.len(), &*all[18], &*all[19], &*all[20]), (21, "label_18", "", "day_0"));
        let some = names(16);
        assert_eq!(
            (some.len(), &*some[12], &*some[13], &*some[14], &*some[15]),
            (16, "label_12", "and 6 more", "", "day_0")
        );
        assert_eq!(names(1), ["and 19 more", "", "and 1 more"]);
        let reversed = entries(11, "label").into_iter().rev().chain(entries(2, "bone")).collect();
        let sorted: Vec<String> = by_name(reversed).into_iter().map(|entry| entry.name).collect();
        assert_eq!((&*sorted[1], &*sorted[4], &*sorted[12]), ("bone_1", "label_2", "label_10"));
    }

    #[test]
    fn a_legend_down_to_the_middle_stands_beside_the_letter_there() {
        let entry = |index: usize| Entry {
            name: format!("label_{index}"),
            colour: LinearSrgb([1.0; 3]),
            spectrum: Spectrum::constant(0.5),
        };
        let [left, right, top, bottom] = ["R", "L", "S", "I"].map(str::to_owned);
        let frame = Frame { edges: Some(Edges { left, right, top, bottom }), pixel: None, unit: None };
        for (entries, is_moved) in [(3, false), (118, true)] {
            let overlay = Overlay {
                materials: (0..entries).map(entry).collect(),
                lights: vec![entry(0)],
                title: None,
                bright: false,
            };
            for side in [400, 1200] {
                let svg = overlay.svg(&frame, [side; 2]);
                assert_eq!(svg.contains("translate("), is_moved, "{entries} entries in {side} pixels");
                let moved =
                    svg.split("translate(").nth(1).map_or(0.0, |it| it.split(' ').next().unwrap().parse().unwrap());
                let letter: f64 = svg.split("font-size=\"").nth(1).unwrap().split('"').next().unwrap().parse().unwrap();
                assert!(!is_moved || moved > 1.3 * letter, "{moved}, letters of {letter}");
            }
        }
    }

    #[test]
    fn letters_at_the_edges_stand_beside_the_names_of_the_legend() {
        let entry = |name: &str| Entry {
            name: name.to_owned(),
            colour: LinearSrgb([1.0; 3]),
            spectrum: Spectrum::constant(0.5),
        };
        for name in ["flesh", "vessel with contrast", "a name of twenty-eight letters"] {
            let overlay =
                Overlay { materials: vec![entry(name)], lights: vec![entry("day")], title: None, bright: false };
            for side in [160, 200, 400, 1200] {
                let [left, right, top, bottom] = ["R", "L", "S", "I"].map(str::to_owned);
                let edges = Some(Edges { left, right, top, bottom });
                let frame = Frame { edges, pixel: Some(PixelLength { units: 1.0, exact: true }), unit: None };
                let svg = overlay.svg(&frame, [side; 2]);
                let number = |element: &str, key: &str| -> f64 {
                    element.split(&format!(" {key}=\"")).nth(1).unwrap().split('"').next().unwrap().parse().unwrap()
                };
                let text = |wanted: &str| {
                    let found = svg.split("<text").find(|it| it.contains(&format!(">{wanted}<"))).unwrap();
                    [number(found, "x"), number(found, "y")]
                };
                let letter = number(&svg, "font-size");
                let ([x, y], [middle, top]) = (text(&shortened(name)), text("S"));
                let end = (0.6 * letter).mul_add(count(shortened(name).chars().count()), x);
                assert!(
                    end < middle - letter || y - top > 1.2 * letter,
                    "{name}, {side}: {end} at {y}, S at {middle}, {top}"
                );
                let has_curve = svg.contains("<polyline");
                assert_eq!(has_curve, side >= 400, "curves in {side} pixels");
                let curves = svg.split("<polyline points=\"").skip(1).map(|it| it.split('"').next().unwrap());
                let ends = curves.flat_map(|points| points.split(' ').map(|it| it.split(',').next().unwrap()));
                let end = ends.map(|x| x.parse().unwrap()).fold(2.0 * letter, f64::max);
                assert!(x > end, "{side}: a name at {x}, a swatch or a curve up to {end}");
            }
        }
    }
}
