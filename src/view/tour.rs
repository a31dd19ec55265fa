//! A tour of the dial presets: played in the window, or saved picture by picture.

use std::path::PathBuf;
use std::time::Instant;

use crate::document::Edit;

/// Duration of the longest tour, in seconds.
pub const LONGEST: f64 = 3600.0;

/// Tour in progress.
#[derive(Clone, Debug)]
pub enum Tour {
    /// The hand moves in the window.
    Playing {
        /// Start time.
        begun: Instant,
        /// Duration.
        milliseconds: usize,
    },
    /// Pictures are saved while the hand of the document stays.
    Saving {
        /// Path from which the numbered names are derived.
        path: PathBuf,
        /// Number of pictures.
        frames: u16,
        /// Number of pictures saved.
        saved: u16,
        /// Size of the first picture, in pixels; all pictures must have it.
        size: Option<[usize; 2]>,
    },
}

impl Tour {
    /// Starts a tour that plays for `seconds`.
    #[must_use]
    pub fn playing(seconds: f64) -> Self {
        let seconds = if seconds.is_finite() { seconds.clamp(0.0, LONGEST) } else { LONGEST };
        Self::Playing { begun: Instant::now(), milliseconds: crate::number::whole(1000.0 * seconds) }
    }

    /// Starts a tour that is saved in `frames` pictures named after `path`.
    #[must_use]
    pub fn saving(path: PathBuf, frames: u16) -> Self {
        Self::Saving { path, frames: frames.max(1), saved: 0, size: None }
    }

    /// Whether a picture of this size fits the saved tour; the first picture sets the size.
    pub fn takes(&mut self, picture: [usize; 2]) -> bool {
        match self {
            Self::Playing { .. } => false,
            Self::Saving { size, .. } => *size.get_or_insert(picture) == picture,
        }
    }

    /// Edit that moves the hand to the tour's current position.
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
