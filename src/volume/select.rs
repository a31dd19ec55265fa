//! Choice of one scalar volume from a file that holds several.

use super::{Asked, Several, VolumeError};

impl Several {
    /// Returns the index of the alternative `asked`; `source` is the file.
    fn number(self, source: &str, asked: Option<usize>) -> Result<usize, VolumeError> {
        let count = self.count();
        match asked {
            None if count == 1 => Ok(0),
            None => Err(VolumeError::Choose { source_name: source.to_owned(), there: self }),
            Some(index) if index < count => Ok(index),
            Some(index) => {
                let asked = match self {
                    Self::Times(_) => Asked::Time(index),
                    Self::Components { .. } | Self::Arrays(_) => Asked::Component(index),
                };
                Err(VolumeError::NoSuch { source_name: source.to_owned(), asked, there: self.to_string() })
            }
        }
    }
}

/// Choice among the volumes of a file; the default suffices for a file with one volume.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Selection {
    /// Component of a voxel, from 0.
    pub component: Option<usize>,
    /// Time step, from 0.
    pub time: Option<usize>,
    /// Name of the array.
    pub array: Option<String>,
    /// Whether an unspecified choice among several is an error, even if the file marks a default array or the scene
    /// states a choice.
    pub asks: bool,
    /// Whether a volume whose axes lean is resampled to a straight grid; otherwise it is refused.
    pub resample: bool,
}

impl Selection {
    /// Merges two selections; `otherwise` supplies what this one leaves open.
    #[must_use]
    pub fn or(&self, otherwise: &Self) -> Self {
        Self {
            component: self.component.or(otherwise.component),
            time: self.time.or(otherwise.time),
            array: self.array.clone().or_else(|| otherwise.array.clone()),
            asks: self.asks || otherwise.asks,
            resample: self.resample || otherwise.resample,
        }
    }

    /// Returns the component to read of `count` in the file `source`; `kind` is their kind, or empty.
    pub(super) fn component(&self, source: &str, count: usize, kind: &str) -> Result<usize, VolumeError> {
        Several::Components { count, kind: kind.to_owned() }.number(source, self.component)
    }

    /// Returns the time step to read of `count` in the file `source`.
    pub(super) fn time(&self, source: &str, count: usize) -> Result<usize, VolumeError> {
        Several::Times(count).number(source, self.time)
    }

    /// Returns the index of the array to read among `names` in the file `source`.
    pub(super) fn array(&self, source: &str, names: &[&str]) -> Result<usize, VolumeError> {
        let there = Several::Arrays(names.iter().map(|&name| name.to_owned()).collect());
        let Some(asked) = &self.array else { return there.number(source, None) };
        names.iter().position(|name| name == asked).ok_or_else(|| VolumeError::NoSuch {
            source_name: source.to_owned(),
            asked: Asked::Array(asked.clone()),
            there: there.to_string(),
        })
    }

    /// Refuses an array name for the file `source`, whose format has no named arrays.
    pub(super) fn no_array(&self, source: &str) -> Result<(), VolumeError> {
        match &self.array {
            None => Ok(()),
            Some(name) => Err(VolumeError::NoSuch {
                source_name: source.to_owned(),
                asked: Asked::Array(name.clone()),
                there: "one array without a name".to_owned(),
            }),
        }
    }

    /// Refuses any choice but the only scalar volume of `source`.
    pub(crate) fn only(&self, source: &str) -> Result<(), VolumeError> {
        self.component(source, 1, "")?;
        self.time(source, 1)?;
        self.no_array(source)
    }
}

/// The position that is read along one axis of a file's numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Pick {
    /// Distance in numbers between neighbours on the axis: the product of the lengths of the faster axes.
    pub(super) stride: usize,
    /// Length of the axis.
    pub(super) length: usize,
    /// Position that is read.
    pub(super) index: usize,
}

impl Pick {
    /// Distance from number `at` of the file to the next picked number; 0 if `at` itself is picked.
    fn gap(&self, at: usize) -> usize {
        let (place, within) = (at / self.stride % self.length, at % self.stride);
        match (self.index + self.length - place) % self.length {
            0 => 0,
            steps => steps * self.stride - within,
        }
    }
}

/// Returns the start and the length of the first run of numbers, at or after `at`, that all of `picks` select.
pub(super) fn next_run(picks: &[Pick], mut at: usize) -> (usize, usize) {
    while let Some(gap) = picks.iter().map(|pick| pick.gap(at)).find(|&gap| gap > 0) {
        at += gap;
    }
    (at, picks.iter().map(|pick| pick.stride - at % pick.stride).min().unwrap_or(usize::MAX))
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
    use super::*;

    #[test]
    fn runs_are_the_numbers_whose_every_picked_axis_is_at_its_place() {
        // Axes of 3, 4, 2 and 5 numbers; two of them are picked, in any order.
        let lengths = [3_usize, 4, 2, 5];
        for (first, second) in [(0, 3), (0, 1), (1, 2), (3, 0), (2, 3)] {
            let pick = |axis: usize| Pick { stride: lengths[..axis].iter().product(), length: lengths[axis], index: 1 };
            let picks = [pick(first), pick(second)];
            let all = lengths.iter().product();
            let place = |at: usize, axis: usize| at / lengths[..axis].iter().product::<usize>() % lengths[axis];
            let expected: Vec<usize> = (0..all).filter(|&at| place(at, first) == 1 && place(at, second) == 1).collect();
            let (mut found, mut at) = (Vec::new(), 0);
            while let (start, run) = next_run(&picks, at)
                && start < all
            {
                found.extend(start..start + run);
                at = start + run;
            }
            assert_eq!(found, expected, "axes {first} and {second}");
        }
    }

    #[test]
    fn a_choice_is_asked_for_and_held_against_what_there_is() {
        let none = Selection::default();
        let message = none.component("f", 3, "RGB-color").unwrap_err().to_string();
        assert_eq!(message, "f: 3 components per voxel (RGB-color); choose a component from 0 to 2");
        let message = none.array("f", &["ct", "pet"]).unwrap_err().to_string();
        assert!(message.contains("ct, pet") && message.contains("choose one of them"), "{message}");
        assert_eq!((none.time("f", 1).unwrap(), none.array("f", &["ct"]).unwrap()), (0, 0));

        let chosen = Selection {
            component: Some(2),
            time: Some(4),
            array: Some("pet".to_owned()),
            asks: false,
            resample: false,
        };
        assert_eq!(chosen.component("f", 3, "").unwrap(), 2);
        assert_eq!(chosen.array("f", &["ct", "pet"]).unwrap(), 1);
        let message = chosen.time("f", 4).unwrap_err().to_string();
        assert!(message.contains("time step 4") && message.contains("4 time steps"), "{message}");
        assert!(chosen.only("f").is_err(), "component 2 of one");
        assert!(
            Selection { component: Some(0), time: Some(0), array: None, asks: false, resample: false }
                .only("f")
                .is_ok(),
            "all there is"
        );
    }
}
