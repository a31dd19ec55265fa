//! Overlay of a picture as an SVG drawing without background: scale bar, orientation letters, legend and title.

use std::fmt::Write as _;

use super::{Edges, ScaleBar, material_colours, pixel_length};
use crate::film::display_from_xyz;
use crate::number::count;
use crate::plan::Planned;
use crate::scene::{Camera, Mix, Scene};
use crate::spectrum::Spectrum;
use crate::spectrum::colour::{LinearSrgb, display_code, xyz_of};
use crate::written::escaped;

/// Size of letters as a fraction of the smaller side of the picture, and their smallest size in pixels.
const LETTER: f64 = 1.0 / 36.0;
const SMALLEST: f64 = 11.0;
/// Longest scale bar as a fraction of the width of the picture.
const LONGEST_BAR: f64 = 0.25;
/// Largest part of the height that the legend takes.
const LEGEND: f64 = 0.7;
/// Longest name in the legend, in letters.
const LONGEST_NAME: usize = 28;

/// Content of an overlay.
#[derive(Clone, Copy, Debug)]
pub struct Overlay<'a> {
    /// The scene of the picture.
    pub scene: &'a Scene,
    /// Its plan, which names the visible materials.
    pub planned: &'a Planned,
    /// The lights of the picture.
    pub mix: &'a Mix,
    /// Title above the picture.
    pub title: Option<&'a str>,
    /// Whether the background is bright, so that letters are dark.
    pub bright: bool,
}

/// One line of a legend.
struct Row<'a> {
    name: &'a str,
    colour: LinearSrgb,
    spectrum: &'a Spectrum,
}

impl Overlay<'_> {
    /// The overlay of a picture of `size` (width, height) in pixels by `camera`.
    #[must_use]
    pub fn svg(&self, camera: &Camera, size: [usize; 2]) -> String {
        let [width, height] = size.map(count);
        let letter = (width.min(height) * LETTER).max(SMALLEST);
        let [ink, edge] = if self.bright { ["#111111", "#ffffff"] } else { ["#ffffff", "#000000"] };
        let mut out = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
             font-family=\"sans-serif\" font-size=\"{letter}\" fill=\"{ink}\" stroke=\"{edge}\" \
             stroke-width=\"{}\" stroke-linejoin=\"round\" paint-order=\"stroke\">",
            0.18 * letter
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
        let geometry = &self.scene.volume.geometry;
        if let Some(view) = camera.view(geometry, width / height).filter(|_| self.scene.volume.anatomical) {
            let Edges { left, right, top: above, bottom } = Edges::of(&view);
            text(0.6 * letter, height / 2.0, "start", "", &left);
            text(width - 0.6 * letter, height / 2.0, "end", "", &right);
            text(width / 2.0, top, "middle", "", &above);
            text(width / 2.0, height - 0.6 * letter, "middle", "", &bottom);
        }
        let pixel = pixel_length(camera, geometry, [width, height]);
        let bar = pixel.and_then(|pixel| ScaleBar::new(pixel, LONGEST_BAR * width, self.scene.volume.unit));
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
        self.legend(&mut out, top, letter, (LEGEND * height).min(height - top - 5.0 * letter));
        out + "</svg>"
    }

    /// Appends the legend: visible materials with reflectances, and lights with spectra, in at most `room` pixels.
    fn legend(&self, out: &mut String, top: f64, letter: f64, room: f64) {
        let Self { scene, planned, mix, .. } = *self;
        let colours = material_colours(scene, mix);
        let materials = planned.materials.iter().filter_map(|&index| {
            let (material, &colour) = (scene.materials.get(index)?, colours.get(index)?);
            Some(Row { name: &material.name, colour, spectrum: material.reflectance.spectrum() })
        });
        let to_display = display_from_xyz(mix, &scene.display);
        let lights = mix.0.iter().filter(|light| light.weight > 0.0).map(|light| {
            let spectrum = light.spectrum.spectrum();
            let colour = to_display * glam::DVec3::from(xyz_of(spectrum).0);
            let brightest = colour.max_element().max(f64::MIN_POSITIVE);
            Row { name: &light.name, colour: LinearSrgb((colour / brightest).to_array()), spectrum }
        });
        let line = 1.5 * letter;
        let rows: Vec<Option<Row<'_>>> = materials.map(Some).chain([None]).chain(lights.map(Some)).collect();
        let most = crate::number::whole(room / line).max(1);
        for (index, row) in rows.iter().take(most).enumerate() {
            let (x, y) = (letter, count(index).mul_add(line, top));
            // A gap parts materials and lights.
            let Some(Row { name, colour, spectrum }) = row else { continue };
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
            let curve = curve(spectrum, [1.5_f64.mul_add(letter, x), half.mul_add(0.3, y)], [3.0 * letter, letter]);
            write!(out, "<polyline points=\"{curve}\" fill=\"none\" stroke-width=\"{}\"/>", 0.3 * letter).ok();
            write!(
                out,
                "<polyline points=\"{curve}\" fill=\"none\" stroke=\"{ink}\" stroke-width=\"{}\"/>",
                0.1 * letter
            )
            .ok();
            write!(out, "<text x=\"{}\" y=\"{y}\">{}</text>", 5.0_f64.mul_add(letter, x), escaped(&shortened(name)))
                .ok();
        }
        if rows.len() > most {
            let y = count(most).mul_add(line, top);
            write!(out, "<text x=\"{letter}\" y=\"{y}\">and {} more</text>", rows.len() - most).ok();
        }
    }
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
