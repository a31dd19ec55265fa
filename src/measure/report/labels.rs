//! Placement of names next to dots, without overlaps.

/// Average width and height of a letter in the scatter's names.
const LETTER: [f64; 2] = [7.0, 13.0];
/// Average width of a letter in the small names.
const SMALL_LETTER: f64 = 6.0;
/// Free space left and right of a name.
const MARGIN: f64 = 4.0;

/// A rectangle: left, top, right, bottom.
type Rectangle = [f64; 4];
type Segment = [[f64; 2]; 2];

/// Places names one after the other.
pub(super) struct Labels {
    within: Rectangle,
    /// Rectangles that no name may cover.
    taken: Vec<Rectangle>,
    /// Lines that names avoid if possible.
    lines: Vec<Segment>,
}

/// Place of a name.
pub(super) struct Place {
    /// Left end of its baseline.
    pub(super) at: [f64; 2],
    /// Line from the dot to a name at a distance.
    pub(super) leader: Option<Segment>,
}

impl Labels {
    /// Starts with `dots`, each with its radius, and a curve through `points`, all within a rectangle.
    pub(super) fn new(within: Rectangle, dots: &[([f64; 2], f64)], points: &[[f64; 2]]) -> Self {
        let around = |&([x, y], radius): &([f64; 2], f64)| [x - radius, y - radius, x + radius, y + radius];
        let lines = points.windows(2).map(|ends| [ends[0], ends[1]]).collect();
        Self { within, taken: dots.iter().map(around).collect(), lines }
    }

    /// Finds a place for `name` near a dot of `radius` at `[x, y]`; `None` if there is none.
    pub(super) fn place(&mut self, [x, y]: [f64; 2], radius: f64, name: &str) -> Option<Place> {
        let letters = relume_base::number::count(name.chars().count());
        let [wide, high] = [letters * LETTER[0] / 2.0 + MARGIN, LETTER[1] / 2.0];
        let turns = (0..24).map(|i| f64::from(i) * std::f64::consts::TAU / 24.0 - 0.5);
        let found = [2.0, 14.0, 26.0, 40.0, 56.0, 74.0, 96.0, 120.0, 150.0].into_iter().flat_map(|away| {
            turns.clone().map(move |turn| {
                let (sin, cos) = turn.sin_cos();
                let from = [x + cos * radius, y + sin * radius];
                let to = [x + cos * (radius + away), y + sin * (radius + away)];
                let middle = [wide.mul_add(cos, to[0]), high.mul_add(sin, to[1])];
                let place = [middle[0] - wide, middle[1] - high, middle[0] + wide, middle[1] + high];
                (place, (away > 2.0).then_some([from, to]))
            })
        });
        let found: Vec<(Rectangle, Option<Segment>)> = found.collect();
        let fits = |(place, _): &&(Rectangle, Option<Segment>)| {
            let inside = place[0] >= self.within[0]
                && place[1] >= self.within[1]
                && place[2] <= self.within[2]
                && place[3] <= self.within[3];
            inside && self.taken.iter().all(|taken| !overlap(place, taken))
        };
        // A leader begins at the edge of its own dot, which is one of the taken rectangles.
        let others = || self.taken.iter().filter(|it| !holds(it, [x, y]));
        let points_out = |(_, leader): &&(Rectangle, Option<Segment>)| {
            leader.as_ref().is_none_or(|leader| others().all(|taken| !crosses(leader, taken)))
        };
        let clear = |(place, _): &&(Rectangle, Option<Segment>)| self.lines.iter().all(|line| !crosses(line, place));
        let fitting = || found.iter().filter(fits);
        let best = fitting().filter(points_out).find(clear).or_else(|| fitting().find(points_out));
        let &(place, leader) = best.or_else(|| fitting().next())?;
        self.taken.push(place);
        Some(Place { at: [place[0] + MARGIN, place[3] - 3.0], leader })
    }

    /// Returns the left end of the baseline of `name` right or left of a dot of `radius` at `[x, y]`, if the name
    /// covers no dots, names or lines there.
    pub(super) fn beside(&mut self, [x, y]: [f64; 2], radius: f64, name: &str) -> Option<[f64; 2]> {
        let wide = relume_base::number::count(name.chars().count()) * SMALL_LETTER + MARGIN;
        let half = LETTER[1] / 2.0;
        let places = [x + radius, x - radius - wide].map(|left| [left, y - half, left + wide, y + half]);
        let fits = |place: &Rectangle| {
            let inside = place[0] >= self.within[0] && place[2] <= self.within[2];
            let clear = !self.taken.iter().any(|taken| overlap(place, taken));
            inside && clear && !self.lines.iter().any(|line| crosses(line, place))
        };
        let place = places.into_iter().find(fits)?;
        self.taken.push(place);
        Some([place[0] + MARGIN / 2.0, place[3] - 2.5])
    }
}

fn holds([left, top, right, bottom]: &Rectangle, [x, y]: [f64; 2]) -> bool {
    (*left..=*right).contains(&x) && (*top..=*bottom).contains(&y)
}

fn overlap(one: &Rectangle, two: &Rectangle) -> bool {
    one[0] < two[2] && two[0] < one[2] && one[1] < two[3] && two[1] < one[3]
}

/// Whether a segment enters a rectangle, tested in steps shorter than any dot.
fn crosses([from, to]: &Segment, rectangle: &Rectangle) -> bool {
    const STEPS: u32 = 200;
    let at = |i: u32, axis: usize| (to[axis] - from[axis]).mul_add(f64::from(i) / f64::from(STEPS), from[axis]);
    (0..=STEPS).any(|i| holds(rectangle, [at(i, 0), at(i, 1)]))
}

#[cfg(test)]
#[expect(clippy::unwrap_used, reason = "a test fails by panicking")]
mod tests {
    use super::*;

    #[test]
    fn names_cover_neither_dots_nor_each_other_where_dots_crowd() {
        let dots: Vec<([f64; 2], f64)> =
            (0..12).map(|i| ([300.0 + 12.0 * f64::from(i % 4), 200.0 + 12.0 * f64::from(i / 4)], 5.0)).collect();
        let mut labels = Labels::new([0.0, 0.0, 600.0, 400.0], &dots, &[[0.0, 0.0], [300.0, 200.0]]);
        for (dot, radius) in dots.iter().take(5) {
            let before = labels.taken.len();
            let place = labels.place(*dot, *radius, "lookup=nearest").unwrap();
            let (new, others) = labels.taken.split_last().unwrap();
            assert_eq!(others.len(), before);
            assert!(others.iter().all(|other| !overlap(new, other)), "{new:?}");
            assert!(holds(new, [place.at[0], place.at[1]]), "the text begins in its place");
        }
    }

    #[test]
    fn a_lonely_dot_has_its_name_beside_it_and_no_leader() {
        let mut labels = Labels::new([0.0, 0.0, 300.0, 100.0], &[([50.0, 50.0], 5.0)], &[]);
        assert!(labels.place([50.0, 50.0], 5.0, "k=8").unwrap().leader.is_none());
        assert!(labels.place([50.0, 50.0], 5.0, &"x".repeat(60)).is_none(), "no place for that");
    }

    #[test]
    fn a_small_name_is_beside_its_dot_or_nowhere() {
        let dots = [([50.0, 50.0], 5.0), ([62.0, 50.0], 5.0), ([74.0, 50.0], 5.0)];
        let mut labels = Labels::new([0.0, 0.0, 150.0, 100.0], &dots, &[]);
        let [left, right] = [dots[0], dots[2]].map(|(dot, radius)| labels.beside(dot, radius, "k=8").unwrap());
        assert!(left[0] < 45.0 && right[0] > 79.0, "{left:?}, {right:?}");
        assert!(labels.beside(dots[1].0, 5.0, "k=6").is_none(), "dots are on both sides");
    }
}
