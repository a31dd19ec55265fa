//! Choice of one scalar volume from a file that holds several.

use std::ops::Range;

use super::several::Series;
use super::{Asked, Several, VolumeError};
use relume_base::memory;

/// Place of the voxels of a volume: memory or file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum HostMemory {
    /// In memory.
    #[default]
    Whole,
    /// In memory as far as they fit: voxels of a file of bricks that exceed it stay there, and all other volumes are refused.
    Bounded {
        /// Bytes that the voxels may take. Without it, half of the available memory for a file of bricks, and all of it for
        /// other volumes that are read slice by slice.
        bytes: Option<u64>,
    },
    /// In the file, if it is a file of bricks.
    InFile,
}

impl HostMemory {
    /// Refuses voxels of `bytes` bytes that exceed the memory; `source` is their file.
    pub(super) fn check(self, source: &str, bytes: u64) -> Result<(), VolumeError> {
        let Self::Bounded { bytes: stated } = self else { return Ok(()) };
        match stated.or_else(memory::available_bytes) {
            Some(limit) if bytes > limit => Err(VolumeError::Exceeds { source_name: source.to_owned(), bytes, limit }),
            _ => Ok(()),
        }
    }
}

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
                    Self::Times(_) | Self::Steps { .. } => Asked::Time(index),
                    Self::Components { .. } | Self::Arrays(_) => Asked::Component(index),
                    Self::Series(_) => Asked::Series(index.to_string()),
                    Self::Levels(_) => Asked::Level(index),
                };
                Err(VolumeError::NoSuch { source_name: source.to_owned(), asked, there: self.to_string() })
            }
        }
    }
}

/// Slices of a volume that are a part of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    /// Slices of the whole volume.
    pub depth: usize,
    /// Slices that are decoded together: those of a chunk, from a multiple of this number on.
    pub together: usize,
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
    /// Number or identifier of the series.
    pub series: Option<String>,
    /// Level of resolution; 0, the finest, unless it is chosen or `asks` is set.
    pub level: Option<usize>,
    /// Axes of an array whose file does not name them, slowest first, as in `czyx`.
    pub axes: Option<String>,
    /// Whether an unspecified choice among several is an error, even if the file marks a default array or the scene
    /// states a choice.
    pub asks: bool,
    /// Whether a volume whose axes lean is resampled to a straight grid; otherwise it is refused.
    pub resample: bool,
    /// Whether the middle slice of the volume suffices, as for [`Preview`](super::Preview). Readers that find it at once
    /// read no other.
    pub middle: bool,
    /// First slice along z and end of those that suffice, as far as the volume has them. Readers that find them at once read no
    /// other, and state [`Volume::part`](super::Volume::part).
    pub slices: Option<[usize; 2]>,
    /// Place of the voxels.
    pub memory: HostMemory,
}

impl Selection {
    /// Merges two selections; `otherwise` supplies what this one leaves open.
    #[must_use]
    pub fn or(&self, otherwise: &Self) -> Self {
        Self {
            component: self.component.or(otherwise.component),
            time: self.time.or(otherwise.time),
            array: self.array.clone().or_else(|| otherwise.array.clone()),
            series: self.series.clone().or_else(|| otherwise.series.clone()),
            level: self.level.or(otherwise.level),
            axes: self.axes.clone().or_else(|| otherwise.axes.clone()),
            asks: self.asks || otherwise.asks,
            resample: self.resample || otherwise.resample,
            middle: self.middle || otherwise.middle,
            slices: self.slices.or(otherwise.slices),
            memory: if self.memory == HostMemory::Whole { otherwise.memory } else { self.memory },
        }
    }

    /// Chooses the first alternative of `there`.
    pub(super) fn choose_first(&mut self, there: &Several) {
        match there {
            Several::Components { .. } => self.component = Some(0),
            Several::Times(_) | Several::Steps { .. } => self.time = Some(0),
            Several::Arrays(names) => self.array = names.first().cloned(),
            Several::Series(all) => self.series = all.first().map(|series| series.key.clone()),
            Several::Levels(_) => self.level = Some(0),
        }
    }

    /// Returns the slices to read of `depth`: all, the middle one, or those that are chosen.
    pub(super) fn slices(&self, depth: usize) -> Range<usize> {
        match self.slices {
            _ if self.middle => depth / 2..depth / 2 + 1,
            Some([first, end]) => first.min(depth)..end.min(depth),
            None => 0..depth,
        }
    }

    /// The part of `depth` slices that is read, if not all are; `together` of them are decoded at once.
    pub(super) fn part(&self, depth: usize, together: usize) -> Option<Part> {
        (self.middle || self.slices.is_some()).then_some(Part { depth, together })
    }

    /// Returns the component to read of `count` in the file `source`; `kind` is their kind, or empty.
    pub(super) fn component(&self, source: &str, count: usize, kind: &str) -> Result<usize, VolumeError> {
        self.component_of(source, Several::Components { count, kind: kind.to_owned(), names: Vec::new() })
    }

    /// Returns the component to read of `there` in the file `source`.
    pub(super) fn component_of(&self, source: &str, there: Several) -> Result<usize, VolumeError> {
        there.number(source, self.component)
    }

    /// Returns the time step to read of `count` in the file `source`.
    pub(super) fn time(&self, source: &str, count: usize) -> Result<usize, VolumeError> {
        Several::Times(count).number(source, self.time)
    }

    /// Returns the time step to read of `count` in `source`, which differ in `axis`, and have these `values` of it.
    pub(super) fn step(&self, source: &str, count: usize, axis: &str, values: &[String]) -> Result<usize, VolumeError> {
        if count < 2 || values.len() != count {
            return self.time(source, count);
        }
        Several::Steps { axis: axis.to_owned(), values: values.to_vec() }.number(source, self.time)
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

    /// Refuses a choice of series for the file `source`, whose format has no series.
    pub(super) fn no_series(&self, source: &str) -> Result<(), VolumeError> {
        match &self.series {
            None => Ok(()),
            Some(key) => Err(VolumeError::NoSuch {
                source_name: source.to_owned(),
                asked: Asked::Series(key.clone()),
                there: "one series without a number".to_owned(),
            }),
        }
    }

    /// Returns the index of the series to read among `all` in `source`; a series is also chosen by its identifier among
    /// `identifiers`.
    pub(super) fn series(&self, source: &str, all: &[Series], identifiers: &[&str]) -> Result<usize, VolumeError> {
        let Some(asked) = &self.series else { return Several::Series(all.to_vec()).number(source, None) };
        let is_asked = |index: &usize| {
            all[*index].key == *asked || identifiers.get(*index).is_some_and(|identifier| identifier == asked)
        };
        let found: Vec<usize> = (0..all.len()).filter(is_asked).collect();
        match found[..] {
            [one] => Ok(one),
            [] => Err(VolumeError::NoSuch {
                source_name: source.to_owned(),
                asked: Asked::Series(asked.clone()),
                there: Several::Series(all.to_vec()).to_string(),
            }),
            _ => {
                let there = Several::Series(found.iter().map(|&index| all[index].clone()).collect());
                Err(VolumeError::Choose { source_name: source.to_owned(), there })
            }
        }
    }

    /// Returns the level to read in the file `source`, whose levels have these dims, the finest first.
    pub(super) fn level(&self, source: &str, levels: &[[usize; 3]]) -> Result<usize, VolumeError> {
        Several::Levels(levels.to_vec()).number(source, self.level.or((!self.asks).then_some(0)))
    }

    /// Refuses a level other than 0 for the file `source`, whose format has no levels.
    pub(super) fn no_level(&self, source: &str) -> Result<(), VolumeError> {
        match self.level {
            None | Some(0) => Ok(()),
            Some(level) => Err(VolumeError::NoSuch {
                source_name: source.to_owned(),
                asked: Asked::Level(level),
                there: "one level, 0".to_owned(),
            }),
        }
    }

    /// Refuses axes for the file `source`, whose format states them.
    pub(super) fn no_axes(&self, source: &str) -> Result<(), VolumeError> {
        match &self.axes {
            None => Ok(()),
            Some(axes) => Err(VolumeError::NoSuch {
                source_name: source.to_owned(),
                asked: Asked::Axes(axes.clone()),
                there: "axes that it states itself".to_owned(),
            }),
        }
    }

    /// Refuses any choice but the only scalar volume of `source`.
    ///
    /// # Errors
    ///
    /// [`VolumeError`] for the choice that it does not have.
    pub fn only(&self, source: &str) -> Result<(), VolumeError> {
        self.component(source, 1, "")?;
        self.time(source, 1)?;
        self.no_array(source)?;
        self.no_series(source)?;
        self.no_axes(source)?;
        self.no_level(source)
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

        let chosen =
            Selection { component: Some(2), time: Some(4), array: Some("pet".to_owned()), ..Selection::default() };
        assert_eq!(chosen.component("f", 3, "").unwrap(), 2);
        assert_eq!(chosen.array("f", &["ct", "pet"]).unwrap(), 1);
        let message = chosen.time("f", 4).unwrap_err().to_string();
        assert!(message.contains("time step 4") && message.contains("4 time steps"), "{message}");
        assert!(chosen.only("f").is_err(), "component 2 of one");
        assert!(
            Selection { component: Some(0), time: Some(0), level: Some(0), ..Selection::default() }.only("f").is_ok(),
            "all there is"
        );
        let message = Selection { level: Some(1), ..Selection::default() }.only("f").unwrap_err().to_string();
        assert_eq!(message, "f: level 1 does not exist; the file holds one level, 0");
        let message = Selection { series: Some("3".to_owned()), ..Selection::default() }.only("f").unwrap_err();
        assert_eq!(message.to_string(), "f: series 3 does not exist; the file holds one series without a number");
    }

    #[test]
    fn a_series_is_chosen_by_its_number_or_identifier() {
        let series = |key: &str, side| Series {
            key: key.to_owned(),
            description: "«axial» CT".to_owned(),
            dims: [side; 3],
            times: 1,
        };
        let all = [series("3", 4), series("7.1", 5), series("7.2", 6)];
        let identifiers = ["1.2.3", "1.2.7", "1.2.7"];
        let choose = |asked: Option<&str>| {
            let selection = Selection { series: asked.map(str::to_owned), ..Selection::default() };
            selection.series("f", &all, &identifiers).map_err(|error| error.to_string())
        };
        assert_eq!(choose(Some("3")), Ok(0));
        assert_eq!(choose(Some("1.2.3")), Ok(0));
        assert_eq!(choose(Some("7.2")), Ok(2));
        let there = "3 series: 3 «axial» CT 4×4×4, 7.1 «axial» CT 5×5×5, 7.2 «axial» CT 6×6×6";
        assert_eq!(choose(None), Err(format!("f: {there}; choose one of them")));
        assert_eq!(choose(Some("8")), Err(format!("f: series 8 does not exist; the file holds {there}")));
        let two = "f: 2 series: 7.1 «axial» CT 5×5×5, 7.2 «axial» CT 6×6×6; choose one of them";
        assert_eq!(choose(Some("1.2.7")), Err(two.to_owned()), "one identifier for two");
    }

    #[test]
    fn the_finest_level_is_read_unless_another_is_chosen() {
        let levels = [[8, 8, 4], [4, 4, 4]];
        let choose = |level| Selection { level, ..Selection::default() }.level("f", &levels);
        assert_eq!((choose(None).unwrap(), choose(Some(1)).unwrap()), (0, 1));
        let message = choose(Some(2)).unwrap_err().to_string();
        assert_eq!(message, "f: level 2 does not exist; the file holds 2 levels: 0 8×8×4, 1 4×4×4");
    }
}
