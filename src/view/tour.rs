//! A tour of the situations: played before the eye, or saved picture by picture.

use std::path::PathBuf;
use std::time::Instant;

use crate::document::Edit;

/// Longest tour, in seconds.
pub const LONGEST: f64 = 3600.0;

/// A tour under way.
#[derive(Clone, Debug)]
pub enum Tour {
    /// The hand moves.
    Playing {
        /// Since when.
        begun: Instant,
        /// How long it takes.
        milliseconds: usize,
    },
    /// Pictures are saved, and the hand stays.
    Saving {
        /// What they are numbered after.
        path: PathBuf,
        /// How many there will be.
        frames: u16,
        /// How many there are.
        saved: u16,
        /// Pixels of the first one, across and down: all are to be of the same size.
        size: Option<[usize; 2]>,
    },
}

impl Tour {
    /// One that is played in `seconds` from now on.
    #[must_use]
    pub fn playing(seconds: f64) -> Self {
        let seconds = if seconds.is_finite() { seconds.clamp(0.0, LONGEST) } else { LONGEST };
        Self::Playing { begun: Instant::now(), milliseconds: crate::number::whole(1000.0 * seconds) }
    }

    /// One that is saved in `frames` pictures named after `path`.
    #[must_use]
    pub fn saving(path: PathBuf, frames: u16) -> Self {
        Self::Saving { path, frames: frames.max(1), saved: 0, size: None }
    }

    /// Whether a picture of this size belongs to a tour that is saved: the first one decides.
    pub fn takes(&mut self, picture: [usize; 2]) -> bool {
        match self {
            Self::Playing { .. } => false,
            Self::Saving { size, .. } => *size.get_or_insert(picture) == picture,
        }
    }

    /// Where the hand is now.
    #[must_use]
    pub fn edit(&self) -> Edit {
        match self {
            Self::Playing { begun, milliseconds } => {
                let spent = usize::try_from(begun.elapsed().as_millis()).unwrap_or(usize::MAX);
                Edit::Tour(spent.min(*milliseconds), *milliseconds)
            }
            Self::Saving { frames, saved, .. } => Edit::Tour((*saved).into(), usize::from(*frames - 1)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pictures_of_a_tour_have_the_size_of_the_first() {
        let mut tour = Tour::saving("tour.png".into(), 3);
        assert!(tour.takes([4, 3]) && tour.takes([4, 3]) && !tour.takes([3, 4]) && tour.takes([4, 3]));
        assert!(!Tour::playing(1.0).takes([4, 3]));
    }
}
