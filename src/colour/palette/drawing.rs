//! SVG drawing of a solved palette: colour matrix, spectra and table of contrasts.

use std::fmt::Write as _;

use super::{Facts, Member, Solution};
use crate::spectrum::colour::{Xyz, display_code, is_displayable, linear_srgb_from_xyz};
use crate::spectrum::deficiency::Deficiency;
use crate::spectrum::{BANDS, FIRST_NM, LAST_NM, Spectrum, wavelength_nm};
use crate::written::escaped;
use relume_base::number::count;

const MARGIN: f64 = 24.0;
/// Left edge of the first table column.
const LABELS: f64 = 150.0;
/// Size of a matrix cell.
const CELL: [f64; 2] = [128.0, 62.0];
/// Size of a plot.
const PANEL: [f64; 2] = [420.0, 240.0];
/// Height of a row of the contrast table.
const LINE: f64 = 22.0;
/// Width of a column of the contrast table.
const OBSERVER: f64 = 120.0;
/// Largest number of contrasts drawn.
const MOST_LINES: usize = 300;
/// Curve colours that stay distinct under colour vision deficiencies (Okabe and Ito 2008).
const CURVES: [&str; 8] = ["#000000", "#e69f00", "#56b4e9", "#009e73", "#d55e00", "#0072b2", "#cc79a7", "#888888"];
/// Dash patterns, for more curves than colours.
const DASHES: [&str; 4] = ["", "6 3", "2 2", "8 2 2 2"];

impl Solution {
    /// Returns the drawing as SVG.
    #[must_use]
    pub fn to_svg(&self) -> String {
        let mut drawing = Drawing { body: String::new(), width: 0.0, height: MARGIN };
        drawing.heading(&format!("Palette {}", self.palette.source), 18.0);
        let worst = format!("largest ΔE00 {:.3}; left half of a cell: target, right half: solution", self.worst());
        drawing.heading(&worst, 12.0);
        self.draw_matrix(&mut drawing);
        self.draw_verdicts(&mut drawing);
        self.draw_spectra(&mut drawing);
        self.draw_contrasts(&mut drawing);
        let (width, height) = (drawing.width + MARGIN, drawing.height + MARGIN);
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width:.0}\" height=\"{height:.0}\" viewBox=\"0 0 {width:.0} {height:.0}\" \
             font-family=\"DejaVu Sans, Helvetica, Arial, sans-serif\" font-size=\"12\">\n\
             <rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n{}</svg>\n",
            drawing.body
        )
    }

    fn draw_matrix(&self, drawing: &mut Drawing) {
        let top = drawing.height + 30.0;
        for (column, light) in shortened(self.palette.lights.iter().map(titled), 18).iter().enumerate() {
            let x = count(column).mul_add(CELL[0], LABELS);
            drawing.text([x, top - 6.0], 12.0, light);
        }
        for (row, material) in shortened(self.palette.materials.iter().map(titled), 18).iter().enumerate() {
            let y = count(row).mul_add(CELL[1], top);
            drawing.text([MARGIN, y + 24.0], 12.0, material);
        }
        for cell in &self.cells {
            let [x, y] = [count(cell.light).mul_add(CELL[0], LABELS), count(cell.material).mul_add(CELL[1], top)];
            let half = (CELL[0] - 8.0) / 2.0;
            let asked = cell.target.unwrap_or(cell.xyz);
            drawing.swatch([x, y], [half, 40.0], asked);
            drawing.swatch([x + half, y], [half, 40.0], cell.xyz);
            let difference = cell.difference.map_or("free".to_owned(), |difference| format!("ΔE {difference:.3}"));
            let beyond = if is_displayable(linear_srgb_from_xyz(cell.xyz)) { "" } else { ", outside sRGB" };
            drawing.text([x, y + 53.0], 11.0, &format!("{difference}{beyond}"));
        }
        drawing.height = count(self.palette.materials.len()).mul_add(CELL[1], top) + 8.0;
    }

    fn draw_verdicts(&self, drawing: &mut Drawing) {
        for line in self.sentences() {
            for part in wrapped(&line, 120) {
                drawing.heading(&part, 12.0);
            }
        }
    }

    fn draw_spectra(&self, drawing: &mut Drawing) {
        drawing.height += 16.0;
        drawing.heading("Spectra", 15.0);
        let top = drawing.height + 28.0;
        let materials: Vec<&Spectrum> = self.materials.iter().map(|row| row.spectrum()).collect();
        let lights: Vec<Spectrum> = self
            .lights
            .iter()
            .map(|light| {
                let mean = light.spectrum().sum() / count(BANDS);
                light.spectrum().scaled(if mean > 0.0 { 1.0 / mean } else { 1.0 })
            })
            .collect();
        let lights: Vec<&Spectrum> = lights.iter().collect();
        let below = [
            drawing.panel(
                [MARGIN + 30.0, top],
                "reflectance",
                1.0,
                &self.palette.materials,
                &materials,
                &self.material_facts,
            ),
            drawing.panel(
                [MARGIN + PANEL[0] + 90.0, top],
                "light, mean 1",
                1.0,
                &self.palette.lights,
                &lights,
                &self.light_facts,
            ),
        ];
        drawing.height = below[0].max(below[1]);
    }

    fn draw_contrasts(&self, drawing: &mut Drawing) {
        let contrasts = self.contrasts();
        if contrasts.is_empty() {
            return;
        }
        drawing.height += 16.0;
        drawing.heading("Colour differences between materials, ΔE00", 15.0);
        let from = LABELS + 90.0;
        let y = drawing.height + 20.0;
        let observers =
            std::iter::once("normal".to_owned()).chain(Deficiency::ALL.map(|deficiency| deficiency.to_string()));
        for (column, observer) in observers.enumerate() {
            drawing.text([count(column).mul_add(OBSERVER, from), y], 12.0, &observer);
        }
        drawing.height = y;
        let mut light = None;
        let short = shortened(self.palette.materials.iter().map(|material| material.name.clone()), 14);
        for contrast in contrasts.iter().take(MOST_LINES) {
            if light != Some(contrast.light) {
                light = Some(contrast.light);
                drawing.height += LINE;
                drawing.text(
                    [MARGIN, drawing.height],
                    12.0,
                    &format!("under {}", self.palette.lights[contrast.light].name),
                );
            }
            drawing.height += LINE;
            let y = drawing.height;
            let names = contrast.materials.map(|material| &*short[material]);
            drawing.text([MARGIN + 12.0, y], 11.0, &names.join(" – "));
            let colours = contrast
                .materials
                .map(|material| self.cell(material, contrast.light).map_or(Xyz([0.0; 3]), |cell| cell.xyz));
            let values = std::iter::once(contrast.normal).chain(contrast.deficient);
            for (column, value) in values.enumerate() {
                let x = count(column).mul_add(OBSERVER, from);
                for (half, colour) in colours.iter().enumerate() {
                    let linear = linear_srgb_from_xyz(*colour);
                    let seen = match column.checked_sub(1).and_then(|index| Deficiency::ALL.get(index)) {
                        Some(deficiency) => deficiency.seen(linear),
                        None => linear,
                    };
                    drawing.rectangle([count(half).mul_add(22.0, x), y - 13.0], [22.0, 17.0], &display_code(seen));
                }
                drawing.text([x + 50.0, y], 11.0, &format!("{value:.2}"));
            }
        }
        if contrasts.len() > MOST_LINES {
            drawing.heading(&format!("and {} more pairs", contrasts.len() - MOST_LINES), 11.0);
        }
    }

    /// Returns sentences about conflicts, with their reasons and ways out, and about unintended black merges.
    #[must_use]
    pub fn sentences(&self) -> Vec<String> {
        let mut lines = Vec::new();
        for (index, conflict) in self.conflicts.iter().enumerate() {
            lines.push(format!("Not exactly possible: {}.", conflict.reason));
            lines.push(match conflict.ways_out.as_slice() {
                [] => "No single change is known to help.".to_owned(),
                ways => {
                    let ways: Vec<String> = ways.iter().map(ToString::to_string).collect();
                    format!("Changes that may help: {}.", ways.join("; or "))
                }
            });
            // All conflicts of a part share its bound.
            if self.conflicts.get(index + 1).is_none_or(|next| next.part != conflict.part) {
                let has_open_light = conflict
                    .part
                    .iter()
                    .any(|&(_, light)| self.palette.lights.get(light).is_some_and(|light| light.spectrum.is_none()));
                lines.push(format!(
                    "Over all coupled cells, the root mean square ΔE00 (linearised at the targets, therefore too large far from them) is at least {:.2}{}; the solution has {:.2}.",
                    conflict.least,
                    if has_open_light { " (with an open light, the best possible value is unknown)" } else { "" },
                    conflict.reached
                ));
            }
        }
        let name = |(material, light): (usize, usize)| match (
            self.palette.materials.get(material),
            self.palette.lights.get(light),
        ) {
            (Some(row), Some(column)) => format!("{} under {}", row.name, column.name),
            _ => String::new(),
        };
        lines.extend(self.dark_merges.iter().map(|merge| {
            format!(
                "{} matches {} only because both are nearly black; give one of them a target colour.",
                name(merge.cell),
                name(merge.like)
            )
        }));
        lines
    }
}

/// "day (given)"
fn titled(member: &Member) -> String {
    if member.spectrum.is_some() { format!("{} (given)", member.name) } else { member.name.clone() }
}

/// Shortens each name to about `most` characters. Names with a common beginning are cut to where they start to differ.
fn shortened(names: impl Iterator<Item = String>, most: usize) -> Vec<String> {
    let names: Vec<Vec<char>> = names.map(|name| name.chars().collect()).collect();
    let cut = |name: &[char]| -> String {
        let rest = if name.len() > most { "…" } else { "" };
        name.iter().take(most).collect::<String>() + rest
    };
    let short = |name: &Vec<char>| {
        let alike = |other: &&Vec<char>| *other != name && cut(other) == cut(name);
        let common = |other: &Vec<char>| name.iter().zip(other).take_while(|(one, two)| one == two).count();
        match names.iter().filter(alike).map(common).min() {
            Some(common) => format!("…{}", cut(&name[common..])),
            None => cut(name),
        }
    };
    names.iter().map(short).collect()
}

/// Breaks a text at spaces into lines of about `most` characters.
fn wrapped(text: &str, most: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        match lines.last_mut() {
            Some(line) if line.is_empty() => line.push_str(word),
            Some(line) if line.chars().count() + word.chars().count() < most => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// SVG document that grows downwards.
struct Drawing {
    body: String,
    width: f64,
    height: f64,
}

impl Drawing {
    fn reach(&mut self, x: f64) {
        self.width = self.width.max(x);
    }

    /// Adds a line of text below the content.
    fn heading(&mut self, text: &str, size: f64) {
        self.height += size + 6.0;
        self.text([MARGIN, self.height], size, text);
    }

    fn text(&mut self, [x, y]: [f64; 2], size: f64, text: &str) {
        let text = escaped(text);
        // Writing to a String cannot fail. The width of a letter is about 0.6 of its height.
        writeln!(self.body, "<text x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"{size}\">{text}</text>").ok();
        self.reach(0.6f64.mul_add(size * count(text.chars().count()), x));
    }

    fn swatch(&mut self, at: [f64; 2], size: [f64; 2], colour: Xyz) {
        self.rectangle(at, size, &display_code(linear_srgb_from_xyz(colour)));
    }

    fn rectangle(&mut self, [x, y]: [f64; 2], [width, height]: [f64; 2], colour: &str) {
        writeln!(
            self.body,
            "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" fill=\"{colour}\"/>"
        )
        .ok();
        self.reach(x + width);
    }

    fn line(&mut self, from: [f64; 2], to: [f64; 2], colour: &str) {
        let ([x1, y1], [x2, y2]) = (from, to);
        writeln!(self.body, "<line x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\" stroke=\"{colour}\"/>")
            .ok();
    }

    /// Plots spectra over the wavelength, with a legend. Returns its lower edge.
    fn panel(
        &mut self,
        [x, y]: [f64; 2],
        title: &str,
        least_top: f64,
        members: &[Member],
        spectra: &[&Spectrum],
        facts: &[Facts],
    ) -> f64 {
        let extreme = |start: f64, pick: fn(f64, f64) -> f64| {
            spectra
                .iter()
                .flat_map(|spectrum| spectrum.samples())
                .copied()
                .filter(|sample| sample.is_finite())
                .fold(start, pick)
        };
        let (low, high) = (extreme(0.0, f64::min), extreme(least_top, f64::max));
        let at = |nm: f64, value: f64| {
            [
                (nm - FIRST_NM) / (LAST_NM - FIRST_NM) * PANEL[0] + x,
                (high - value.clamp(low, high)) / (high - low) * PANEL[1] + y,
            ]
        };
        self.text([x, y - 6.0], 12.0, title);
        for nm in [400.0, 500.0, 600.0, 700.0] {
            self.line(at(nm, low), at(nm, high), "#dddddd");
            let [label, bottom] = at(nm, low);
            self.text([label - 12.0, bottom + 14.0], 10.0, &format!("{nm} nm"));
        }
        let mut ticks = vec![low, 0.0, least_top, high];
        ticks.dedup_by(|one, two| (*one - *two).abs() < (high - low) * 0.06);
        for tick in ticks {
            self.line(at(FIRST_NM, tick), at(LAST_NM, tick), "#dddddd");
            let [_, height] = at(FIRST_NM, tick);
            self.text([x - 28.0, height + 4.0], 10.0, &format!("{tick:.1}"));
        }
        let mut bottom = y + PANEL[1] + 20.0;
        let names = shortened(members.iter().map(titled), 24);
        for (index, ((name, spectrum), facts)) in names.iter().zip(spectra).zip(facts).enumerate() {
            let colour = CURVES[index % CURVES.len()];
            let dashes = DASHES[(index / CURVES.len()) % DASHES.len()];
            let points = (0..BANDS).map(|band| at(wavelength_nm(band), spectrum.samples()[band]));
            let points: Vec<String> = points.map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
            let style = format!("fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.6\" stroke-dasharray=\"{dashes}\"");
            writeln!(self.body, "<polyline points=\"{}\" {style}/>", points.join(" ")).ok();
            bottom += 16.0;
            writeln!(
                self.body,
                "<polyline points=\"{:.1},{:.1} {:.1},{:.1}\" {style}/>",
                x,
                bottom - 4.0,
                x + 26.0,
                bottom - 4.0
            )
            .ok();
            let negative = if facts.negative > 0.0 {
                format!(", {:.0} % negative", 100.0 * facts.negative)
            } else {
                String::new()
            };
            let range = format!("{name}: {:.2} to {:.2}{negative}", facts.lowest, facts.highest);
            self.text([x + 32.0, bottom], 11.0, &range);
        }
        self.reach(x + PANEL[0]);
        bottom
    }
}
