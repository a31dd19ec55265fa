//! Charts as SVG: axes, curves and bars, coloured by CSS class for light and dark pages.

use std::fmt::Write as _;

use relume_base::number::count;

/// Colours of parts for all kinds of colour vision, on white and on black (after Okabe and Ito 2008).
pub(super) const PARTS: [&str; 12] = [
    "#7a4fa3", "#0072b2", "#56b4e9", "#009e73", "#8c510a", "#f0e442", "#d55e00", "#e69f00", "#cc79a7", "#999999",
    "#b8a800", "#4d4d4d",
];

/// Style of the classes in a standalone drawing, on white.
const LIGHT: &str = "svg{font-family:'DejaVu Sans',Helvetica,Arial,sans-serif;font-size:12px}\
    .paper{fill:#fff}.ink{fill:#1c1c1c}.soft{fill:#5f6368}.ink,.soft{paint-order:stroke;stroke:#fff;stroke-width:3px;stroke-linejoin:round}\
    .grid{stroke:#e3e3e3}.axis{stroke:#767b81}.accent{fill:#0b62c4}.front{fill:none;stroke:#0b62c4;stroke-width:2}.dot{fill:#8a9097}\
    .own{fill:none;stroke:#1c1c1c;stroke-width:1.6}";

/// An SVG drawing under construction.
pub(super) struct Drawing {
    body: String,
    width: f64,
    height: f64,
}

pub(super) use relume_colour::written::escaped;

impl Drawing {
    pub(super) fn new(width: f64, height: f64) -> Self {
        Self { body: String::new(), width, height }
    }

    /// Returns the SVG for a page that defines the classes.
    pub(super) fn inline(&self, name: &str) -> String {
        let Self { body, width, height } = self;
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" width=\"{width:.0}\" height=\"{height:.0}\" role=\"img\" aria-label=\"{}\">\n{body}</svg>\n",
            escaped(name)
        )
    }

    /// Returns a standalone SVG.
    pub(super) fn standalone(&self) -> String {
        let Self { body, width, height } = self;
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" width=\"{width:.0}\" height=\"{height:.0}\">\n\
             <style>{LIGHT}</style>\n<rect class=\"paper\" width=\"100%\" height=\"100%\"/>\n{body}</svg>\n"
        )
    }

    // Writing to a String cannot fail.

    pub(super) fn text(&mut self, [x, y]: [f64; 2], class: &str, anchor: &str, text: &str) {
        let text = escaped(text);
        writeln!(self.body, "<text class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{text}</text>")
            .ok();
    }

    pub(super) fn small(&mut self, [x, y]: [f64; 2], anchor: &str, text: &str) {
        let text = escaped(text);
        writeln!(
            self.body,
            "<text class=\"soft\" x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" font-size=\"10.5\">{text}</text>"
        )
        .ok();
    }

    pub(super) fn line(&mut self, [x1, y1]: [f64; 2], [x2, y2]: [f64; 2], class: &str) {
        writeln!(self.body, "<line class=\"{class}\" x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\"/>")
            .ok();
    }

    pub(super) fn path(&mut self, points: &[[f64; 2]], class: &str) {
        let points: Vec<String> = points.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        writeln!(self.body, "<polyline class=\"{class}\" points=\"{}\"/>", points.join(" ")).ok();
    }

    /// Adds a circle with the tooltip `title`.
    pub(super) fn circle(&mut self, [x, y]: [f64; 2], radius: f64, class: &str, title: &str) {
        let title = escaped(title);
        writeln!(
            self.body,
            "<circle class=\"{class}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\"><title>{title}</title></circle>"
        )
        .ok();
    }

    /// Adds a curve of its own colour, thin or normal.
    pub(super) fn coloured_path(&mut self, points: &[[f64; 2]], colour: &str, thin: bool) {
        let points: Vec<String> = points.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        let (width, points) = (if thin { 1.0 } else { 1.8 }, points.join(" "));
        writeln!(
            self.body,
            "<polyline fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\" points=\"{points}\"/>"
        )
        .ok();
    }

    /// Adds a dot or a ring of its own colour, with the tooltip `title`.
    pub(super) fn marker(&mut self, [x, y]: [f64; 2], colour: &str, ring: bool, title: &str) {
        let (fill, title) = (if ring { "none" } else { colour }, escaped(title));
        writeln!(
            self.body,
            "<circle fill=\"{fill}\" stroke=\"{colour}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.6\"><title>{title}</title></circle>"
        )
        .ok();
    }

    /// Adds a bar in a class or a colour of its own, with the tooltip `title`.
    pub(super) fn bar(&mut self, [x, y]: [f64; 2], [width, height]: [f64; 2], paint: Paint<'_>, title: &str) {
        let paint = match paint {
            Paint::Class(class) => format!("class=\"{class}\""),
            Paint::Colour(colour) => format!("fill=\"{colour}\""),
        };
        let title = escaped(title);
        writeln!(
            self.body,
            "<rect {paint} x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\"><title>{title}</title></rect>"
        )
        .ok();
    }
}

/// Paint of a bar.
#[derive(Clone, Copy)]
pub(super) enum Paint<'a> {
    Class(&'a str),
    Colour(&'a str),
}

/// A logarithmic axis between two coordinates of the drawing.
#[derive(Clone, Copy)]
pub(super) struct Logarithmic {
    low: f64,
    high: f64,
    from: f64,
    to: f64,
}

impl Logarithmic {
    /// Axis that covers all finite `values` above 0 with a margin; from 1 to 10 without values.
    pub(super) fn of(values: impl Iterator<Item = f64>, from: f64, to: f64) -> Self {
        let ends = values.filter(|value| *value > 0.0 && value.is_finite());
        let (low, high) = ends.fold((f64::MAX, 0.0_f64), |(low, high), value| (low.min(value), high.max(value)));
        let (low, high) = if low > high { (1.0, 10.0) } else { (low / 1.25, high * 1.25) };
        // At least a factor of two, or the axis would show noise.
        let more = (2.0 / (high / low)).max(1.0).sqrt();
        Self { low: (low / more).log10(), high: (high * more).log10(), from, to }
    }

    /// Coordinate of `value`; values beyond the axis are at its ends.
    pub(super) fn at(&self, value: f64) -> f64 {
        let share = (value.max(1e-300).log10().clamp(self.low, self.high) - self.low) / (self.high - self.low);
        (self.to - self.from).mul_add(share, self.from)
    }

    /// Values to label: powers of ten, and multiples of them on short axes.
    pub(super) fn ticks(&self) -> Vec<f64> {
        // An axis spans at least a factor of two; the last list is denser than that.
        let factors: &[f64] = match self.high - self.low {
            decades if decades > 2.5 => &[1.0],
            decades if decades > 0.7 => &[1.0, 2.0, 5.0],
            _ => &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0],
        };
        let mut ticks = Vec::new();
        let mut decade = self.low.floor();
        while decade <= self.high {
            let power = 10_f64.powf(decade);
            let within = |tick: &f64| (self.low..=self.high).contains(&tick.log10());
            ticks.extend(factors.iter().map(|factor| factor * power).filter(within));
            decade += 1.0;
        }
        ticks
    }
}

/// Formats a number on an axis.
pub(super) fn tick(value: f64) -> String {
    if (1e-3..1e5).contains(&value) {
        let decimals = if value < 0.01 {
            3
        } else if value < 0.1 {
            2
        } else {
            usize::from(value < 1.0)
        };
        format!("{value:.decimals$}")
    } else {
        format!("{value:.0e}")
    }
}

/// Centres of `number` equal parts of `width`.
pub(super) fn middles(number: usize, from: f64, width: f64) -> impl Iterator<Item = f64> {
    (0..number).map(move |i| (count(i) + 0.5) / count(number) * width + from)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_axis_has_its_ends_where_they_are_asked_for() {
        let axis = Logarithmic::of([0.08, 125.0, 0.0, f64::INFINITY].into_iter(), 100.0, 0.0);
        assert!((axis.at(0.064) - 100.0).abs() <= 1e-9 && (axis.at(156.25)).abs() <= 1e-9);
        assert!((axis.at(0.0) - 100.0).abs() <= 1e-9, "what has no logarithm is at the low end");
        assert_eq!(axis.ticks().iter().map(|&value| tick(value)).collect::<Vec<_>>(), ["0.1", "1", "10", "100"]);
        let narrow = Logarithmic::of([3.0].into_iter(), 0.0, 1.0);
        assert!(narrow.at(3.0).is_finite() && !narrow.ticks().is_empty());
        assert!(!Logarithmic::of(std::iter::empty(), 0.0, 1.0).ticks().is_empty());
    }

    #[test]
    fn a_name_cannot_leave_its_text() {
        let mut drawing = Drawing::new(10.0, 10.0);
        drawing.text([0.0, 0.0], "ink", "start", "</text><script>&\"");
        assert!(!drawing.inline("<b>").contains("<script>") && !drawing.inline("<b>").contains("<b>"));
    }
}
