//! Where errors are: the picture, the map of ΔE00, and an enlarged view of the worst pixel.

use std::fmt::Write as _;

use glam::DVec3;

use super::drawing::{Drawing, Paint, escaped, middles, tick};
use super::entry::INVISIBLE;
use super::pictures::{Picture, Scale};
use crate::digits::short;
use crate::measured::{CloseUp, Measured};
use crate::survey::Survey;
use relume_base::number::{count, whole};
use relume_document::output::OutputError;

/// A picture of the page.
pub(super) struct Figure {
    picture: Picture,
    size: [usize; 2],
    caption: String,
}

impl Figure {
    fn new(picture: Picture, size: [usize; 2], caption: &str) -> Self {
        Self { picture, size, caption: caption.to_owned() }
    }

    /// Figure of colours at [`Survey::pixels`].
    pub(super) fn of_colours(survey: &Survey<'_>, colours: &[DVec3], caption: &str) -> Result<Self, OutputError> {
        let colour = |i: Option<usize>| i.and_then(|i| colours.get(i)).copied().unwrap_or_else(|| survey.background());
        let dims = survey.lattice().dims();
        Ok(Self::new(Picture::of_colours(dims, cells(survey).into_iter().map(colour))?, dims, caption))
    }

    /// Figure of ΔE00 at [`Survey::pixels`].
    pub(super) fn of_differences(
        survey: &Survey<'_>,
        differences: &[f64],
        scale: Scale,
        caption: &str,
    ) -> Result<Self, OutputError> {
        let difference = |i: Option<usize>| i.and_then(|i| differences.get(i)).copied();
        let dims = survey.lattice().dims();
        let picture = Picture::of_differences(dims, cells(survey).into_iter().map(difference), scale)?;
        Ok(Self::new(picture, dims, caption))
    }

    /// Returns HTML of at most `most` page pixels in width and height, with a ring around the pixel `ringed`.
    pub(super) fn html(&self, most: usize, ringed: Option<[f64; 2]>) -> String {
        let largest = self.size[0].max(self.size[1]);
        let times = count(most) / count(largest);
        let times = if times >= 1.0 { times.floor() } else { times };
        let [width, height] = self.size.map(|side| whole((count(side) * times).round()).max(1));
        // Percentages, because pictures shrink with the page.
        let place = ringed.map(|at| [0, 1].map(|axis| 100.0 * (at[axis] + 0.5) / count(self.size[axis])));
        let ring = place.map_or_else(String::new, |[x, y]| format!("<i style=\"left:{x:.2}%;top:{y:.2}%\"></i>"));
        let (caption, base64) = (escaped(&self.caption), &self.picture.base64);
        format!(
            "<figure><div class=\"at\"><img alt=\"{caption}\" width=\"{width}\" height=\"{height}\" src=\"data:image/png;base64,{base64}\">{ring}</div>\
             <figcaption>{caption}</figcaption></figure>\n"
        )
    }
}

/// Index into [`Survey::pixels`] for each cell of the lattice.
fn cells(survey: &Survey<'_>) -> Vec<Option<usize>> {
    let at = |pixel: &[usize; 2]| survey.pixels().iter().position(|shown| shown == pixel);
    survey.lattice().pixels().iter().map(at).collect()
}

/// Caption suffix that states the stride of the compared pixels.
pub(super) fn mosaic(survey: &Survey<'_>) -> String {
    match survey.lattice().stride {
        1 => String::new(),
        stride => format!(", a mosaic of one in {stride} across and down"),
    }
}

/// Scale that covers all `differences` and the visibility threshold.
pub(super) fn scale_for(differences: impl Iterator<Item = f64>) -> Scale {
    let most = differences.filter(|it| it.is_finite()).fold(2.0 * INVISIBLE, f64::max);
    let decade = 10_f64.powf(most.log10().floor());
    let high = [1.0, 2.0, 5.0, 10.0].map(|times| times * decade).into_iter().find(|high| *high >= most).unwrap_or(most);
    Scale { low: high / 1000.0, high }
}

impl Scale {
    /// Digits 1 to 9 of every power of ten on the scale; the flag marks powers of ten, which get labels.
    fn ticks(self) -> impl Iterator<Item = (f64, bool)> {
        let all =
            (-6..6).flat_map(|power| (1..10).map(move |digit| (f64::from(digit) * 10_f64.powi(power), digit == 1)));
        all.filter(move |(value, _)| (0.999 * self.low..=1.001 * self.high).contains(value))
    }

    /// Returns the scale as a drawing of `width`, with a mark at the visibility threshold.
    pub(super) fn html(self, width: f64) -> String {
        const PARTS: usize = 60;
        const MARGIN: f64 = 16.0;
        let long = width - 2.0 * MARGIN;
        let mut drawing = Drawing::new(width, 78.0);
        drawing.small([MARGIN, 11.0], "start", "ΔE00 (logarithmic)");
        let part = long / count(PARTS);
        for (i, x) in middles(PARTS, MARGIN, long).enumerate() {
            let [red, green, blue] = self.heat(self.at((count(i) + 0.5) / count(PARTS)));
            let colour = format!("#{red:02x}{green:02x}{blue:02x}");
            drawing.bar([x - part / 2.0 - 0.3, 18.0], [part + 0.6, 12.0], Paint::Colour(&colour), "");
        }
        let place = |value: f64| long.mul_add(self.share(value), MARGIN);
        for (value, is_named) in self.ticks() {
            drawing.line([place(value), 30.0], [place(value), if is_named { 34.0 } else { 32.0 }], "axis");
            if is_named {
                drawing.small([place(value), 45.0], "middle", &tick(value));
            }
        }
        drawing.line([place(INVISIBLE), 14.0], [place(INVISIBLE), 50.0], "mark");
        let anchor = if self.share(INVISIBLE) < 0.5 { "start" } else { "end" };
        drawing.small([place(INVISIBLE), 60.0], anchor, &format!("invisible below {INVISIBLE}"));
        drawing.small([MARGIN, 73.0], "start", "grey: no volume visible");
        drawing.inline("scale of ΔE00")
    }
}

/// The picture, the map of ΔE00 and the enlarged worst pixel.
pub(super) fn places(
    survey: &Survey<'_>,
    own: &Measured,
    close_up: Option<&CloseUp>,
    scale: Scale,
) -> Result<String, OutputError> {
    let lattice = survey.lattice();
    let dims = lattice.dims();
    let in_picture = own.error.at.map(|at| at.map(count));
    let in_map = own.error.at.and_then(|at| lattice.pixels().iter().position(|pixel| *pixel == at));
    let in_map = in_map.map(|i| [count(i % dims[0]), count(i / dims[0])]);
    let picture = match close_up {
        Some(close) => {
            let whole = Picture::of_colours(lattice.size, close.whole.iter().copied())?;
            Figure::new(whole, lattice.size, "the picture, every pixel").html(400, in_picture)
        }
        None => Figure::of_colours(survey, survey.truth(), "the truth")?.html(400, in_map),
    };
    let map = Figure::of_differences(survey, &own.differences, scale, &format!("ΔE00{}", mosaic(survey)))?;
    let mut text = format!(
        "<div class=\"pictures\">\n{picture}<div class=\"keep\">{}{}</div>\n</div>\n",
        map.html(400, in_map),
        scale.html(400.0)
    );
    if let (Some(close), Some(at)) = (close_up, own.error.at) {
        let dims = [close.side; 2];
        let ring = Some([0, 1].map(|axis| count(at[axis].saturating_sub(close.first[axis]))));
        let pictures = [
            (Picture::of_colours(dims, close.truth.iter().copied())?, "the truth"),
            (Picture::of_colours(dims, close.shown.iter().copied())?, "this picture"),
            (Picture::of_differences(dims, close.differences.iter().copied().map(Some), scale)?, "ΔE00"),
        ];
        let figures: String = pictures
            .into_iter()
            .map(|(picture, caption)| Figure::new(picture, dims, caption).html(250, ring))
            .collect();
        let [x, y] = at;
        write!(
            text,
            "<div class=\"keep\">\n<p>The worst compared pixel, {x} pixels from the left and {y} from the top, has ΔE00 {}. Its surroundings:</p>\n\
             <div class=\"thirds\">\n{figures}</div>\n</div>\n",
            short(own.error.delta_e.max)
        )
        .ok();
    }
    Ok(text)
}
