//! The ways by which light arrives at a step: the slot Light of a plan.

use crate::{Direction, Position, ScatteringMethod, ShadowMethod};

/// The light of a plan: its arrivals, and what dims them.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub struct LightPlan {
    /// All arrivals. Those of one accumulator follow one another, in the order of the accumulators, and each accumulator
    /// has at least one. The i-th has vector i of [`PositionTable`](crate::tables::PositionTable).
    pub arrivals: Vec<Arrival>,
    /// True if the medium dims the ambient shares of directed lights, as it does the light of a sky.
    pub occluded: bool,
    /// Method that finds the light behind the medium; the default if none is.
    pub method: ShadowMethod,
    /// Materials with coloured absorption, through each of which light has a depth of its own; 0 if all absorption is grey,
    /// or if the medium dims no light.
    pub absorbers: usize,
    /// Method that finds the light of each accumulator that has scattered before; `None` if light scatters once.
    pub gathered: Option<ScatteringMethod>,
}

/// A way of light into a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Arrival {
    /// The accumulator of its position.
    pub accumulator: usize,
    /// Its origin.
    pub direction: Direction,
    /// The part of it that arrives.
    pub share: Share,
}

/// The part of a light that arrives at a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Share {
    /// All of it.
    Open,
    /// The part that the medium in front of the step lets through, of light along the ray of the eye.
    OfRay,
    /// The part that the medium lets through of light number n of the light grid.
    Behind(usize),
}

/// Largest number of depths per node of a light grid.
pub const MOST_SHADOWED: usize = 16;

impl LightPlan {
    /// Light that nothing dims, from one direction for each accumulator.
    #[must_use]
    pub fn open(directions: &[Direction]) -> Self {
        let arrival = |(accumulator, &direction): (usize, _)| Arrival { accumulator, direction, share: Share::Open };
        Self { arrivals: directions.iter().enumerate().map(arrival).collect(), ..Self::default() }
    }

    /// The arrivals of `positions`: each light behind the medium gets the next number of the light grid, and light from
    /// everywhere the last.
    pub(crate) fn new(positions: &[Position], occluded: bool, method: ShadowMethod, absorbers: usize) -> Self {
        let mut arrivals = Vec::new();
        for (accumulator, position) in positions.iter().enumerate() {
            let arrival = |&direction: &Direction| {
                let share = match direction {
                    _ if !position.shadows => Share::Open,
                    Direction::Eye => Share::OfRay,
                    _ => Share::Behind(0),
                };
                Arrival { accumulator, direction, share }
            };
            arrivals.extend(position.placement.directions().iter().map(arrival));
        }
        let mut number = 0;
        for last in [false, true] {
            let own = |arrival: &&mut Arrival| (arrival.direction == Direction::Everywhere) == last;
            for arrival in arrivals.iter_mut().filter(own) {
                if let Share::Behind(own) = &mut arrival.share {
                    *own = number;
                    number += 1;
                }
            }
        }
        let is_dimmed = occluded || arrivals.iter().any(|arrival| arrival.share != Share::Open);
        Self {
            arrivals,
            occluded,
            method: if number > 0 || occluded { method } else { ShadowMethod::default() },
            absorbers: if is_dimmed { absorbers } else { 0 },
            gathered: None,
        }
    }

    /// Number of accumulators: one for each light position.
    #[must_use]
    pub fn accumulators(&self) -> usize {
        self.arrivals.last().map_or(0, |last| last.accumulator + 1)
    }

    /// The arrivals of an accumulator, with the indices of their vectors.
    pub fn of(&self, accumulator: usize) -> impl Iterator<Item = (usize, Arrival)> + Clone + use<'_> {
        let first = self.arrivals.partition_point(|arrival| arrival.accumulator < accumulator);
        let own = self.arrivals[first..].iter().take_while(move |arrival| arrival.accumulator == accumulator);
        own.enumerate().map(move |(i, &arrival)| (first + i, arrival))
    }

    /// True if some light has no direction.
    #[must_use]
    pub fn is_ambient(&self) -> bool {
        self.arrivals.iter().any(|arrival| arrival.direction == Direction::Everywhere)
    }

    /// True if light may come from everywhere: that of a position, or light that has scattered before.
    #[must_use]
    pub fn is_unshaded(&self) -> bool {
        self.is_ambient() || self.gathered.is_some()
    }

    /// True if some light has a direction.
    #[must_use]
    pub fn is_directed(&self) -> bool {
        self.arrivals.iter().any(|arrival| arrival.direction != Direction::Everywhere)
    }

    /// True if the medium dims some light.
    #[must_use]
    pub fn is_dimmed(&self) -> bool {
        self.occluded || self.arrivals.iter().any(|arrival| arrival.share != Share::Open)
    }

    /// True if a light shines along the rays of the eye through the medium, so that its shadows follow from the transmittance.
    #[must_use]
    pub fn is_dimmed_along_rays(&self) -> bool {
        self.arrivals.iter().any(|arrival| arrival.share == Share::OfRay)
    }

    /// Number of the sky among the lights of the light grid, if the medium dims light from everywhere: the last.
    #[must_use]
    pub fn sky(&self) -> Option<usize> {
        let behind = |arrival: &Arrival| arrival.direction == Direction::Everywhere && arrival.share != Share::Open;
        (self.occluded || self.arrivals.iter().any(behind)).then(|| self.behind().count())
    }

    /// True if the medium dims a light from everywhere, and not the ambient shares of directed ones alone.
    #[must_use]
    pub fn has_sky_light(&self) -> bool {
        let is_sky = |arrival: &Arrival| arrival.direction == Direction::Everywhere && arrival.share != Share::Open;
        self.arrivals.iter().any(is_sky)
    }

    /// Indices of the vectors of the lights of the light grid in their order, without the sky.
    pub fn behind(&self) -> impl Iterator<Item = usize> + use<'_> {
        let is_behind =
            |arrival: &Arrival| matches!(arrival.share, Share::Behind(_)) && arrival.direction != Direction::Everywhere;
        self.arrivals.iter().enumerate().filter(move |(_, arrival)| is_behind(arrival)).map(|(vector, _)| vector)
    }

    /// Number of lights of the light grid.
    #[must_use]
    pub fn grid_lights(&self) -> usize {
        self.behind().count() + usize::from(self.sky().is_some())
    }

    /// Number of depths per node of the light grid: of each light through all that is grey, and through each absorber.
    #[must_use]
    pub fn grid_depths(&self) -> usize {
        self.grid_lights() * (1 + self.absorbers)
    }

    /// True if the march reads a light grid.
    #[must_use]
    pub fn reads_grid(&self) -> bool {
        self.grid_lights() > 0 && self.method == ShadowMethod::Grid
    }
}
