//! The volumes of a file that holds several, and a choice among them.

use std::fmt;

/// Alternatives in a file, each of them one volume.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Several {
    /// Components of a voxel.
    Components {
        /// Number of components.
        count: usize,
        /// Their kind, if the file states it.
        kind: String,
        /// Their names, or nothing if the file states none.
        names: Vec<String>,
    },
    /// Number of time steps.
    Times(usize),
    /// Time steps, or other volumes of one series, with what tells them apart.
    Steps {
        /// Attributes that differ, such as echo time.
        axis: String,
        /// Their values for each volume.
        values: Vec<String>,
    },
    /// Names of the arrays.
    Arrays(Vec<String>),
    /// Series, as of a folder of DICOM files.
    Series(Vec<Series>),
    /// Levels of resolution, the finest first, by their dims.
    Levels(Vec<[usize; 3]>),
}

/// One of several series.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Series {
    /// Number or identifier that selects it.
    pub key: String,
    /// Description and kind, for messages; may be empty.
    pub description: String,
    /// Voxels along x, y and z.
    pub dims: [usize; 3],
    /// Number of time steps.
    pub times: usize,
}

impl fmt::Display for Series {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { key, description, dims, times } = self;
        write!(formatter, "{key} ")?;
        if !description.is_empty() {
            write!(formatter, "{description} ")?;
        }
        write!(formatter, "{}", by(dims))?;
        if *times > 1 { write!(formatter, " × {times} time steps") } else { Ok(()) }
    }
}

/// Formats `a×b×c`.
fn by(dims: &[usize; 3]) -> String {
    dims.map(|side| side.to_string()).join("×")
}

impl fmt::Display for Several {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let plural = |count: usize| if count == 1 { "" } else { "s" };
        match self {
            Self::Components { count, kind, names } => {
                write!(formatter, "{count} component{} per voxel", plural(*count))?;
                match (names.iter().any(|name| !name.is_empty()), kind.is_empty()) {
                    (true, _) => write!(formatter, " ({})", names.join(", ")),
                    (false, false) => write!(formatter, " ({kind})"),
                    (false, true) => Ok(()),
                }
            }
            Self::Times(count) => write!(formatter, "{count} time step{}", plural(*count)),
            Self::Steps { values, .. } => write!(formatter, "{} time step{}", values.len(), plural(values.len())),
            Self::Arrays(names) => write!(formatter, "the arrays {}", names.join(", ")),
            Self::Series(all) => {
                let named: Vec<String> = all.iter().map(ToString::to_string).collect();
                write!(formatter, "{} series: {}", all.len(), named.join(", "))
            }
            Self::Levels(all) => {
                let named: Vec<String> =
                    all.iter().enumerate().map(|(level, dims)| format!("{level} {}", by(dims))).collect();
                write!(formatter, "{} level{}: {}", all.len(), plural(all.len()), named.join(", "))
            }
        }
    }
}

impl Several {
    /// Number of alternatives.
    pub(super) fn count(&self) -> usize {
        match self {
            Self::Components { count, .. } | Self::Times(count) => *count,
            Self::Arrays(names) => names.len(),
            Self::Steps { values, .. } => values.len(),
            Self::Series(all) => all.len(),
            Self::Levels(all) => all.len(),
        }
    }

    /// The alternatives, for messages.
    #[must_use]
    pub fn range(&self) -> String {
        let last = self.count().saturating_sub(1);
        match self {
            Self::Components { .. } => format!("a component from 0 to {last}"),
            Self::Times(_) => format!("a time step from 0 to {last}"),
            Self::Steps { axis, values } => {
                /// Values that are listed.
                const LISTED: usize = 8;
                let named = match &values[..] {
                    [first @ .., last] if first.len() > LISTED => format!("{}, …, {last}", first[..LISTED].join(", ")),
                    values => values.join(", "),
                };
                format!("a time step from 0 to {last} ({axis} {named})")
            }
            Self::Arrays(_) | Self::Series(_) => "one of them".to_owned(),
            Self::Levels(_) => format!("a level from 0 to {last}"),
        }
    }
}

/// A choice among the volumes of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Asked {
    /// A component of a voxel, from 0.
    Component(usize),
    /// A time step, from 0.
    Time(usize),
    /// The name of an array.
    Array(String),
    /// The number or identifier of a series.
    Series(String),
    /// A level of resolution, from 0.
    Level(usize),
    /// Axes of an array, slowest first.
    Axes(String),
}

impl fmt::Display for Asked {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Component(index) => write!(formatter, "component {index}"),
            Self::Time(index) => write!(formatter, "time step {index}"),
            Self::Array(name) => write!(formatter, "the array {name}"),
            Self::Series(key) => write!(formatter, "series {key}"),
            Self::Level(level) => write!(formatter, "level {level}"),
            Self::Axes(axes) => write!(formatter, "an array of axes {axes}"),
        }
    }
}
