//! The volumes of a file that holds several, and a choice among them.

use std::fmt;

/// Alternatives in a file, each of them one volume.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Several {
    /// Components of a voxel.
    Components {
        /// Number of components.
        count: usize,
        /// Their kind, if the file states it.
        kind: String,
    },
    /// Number of time steps.
    Times(usize),
    /// Names of the arrays.
    Arrays(Vec<String>),
}

impl fmt::Display for Several {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let plural = |count: usize| if count == 1 { "" } else { "s" };
        match self {
            Self::Components { count, kind } => {
                write!(formatter, "{count} component{} per voxel", plural(*count))?;
                if kind.is_empty() { Ok(()) } else { write!(formatter, " ({kind})") }
            }
            Self::Times(count) => write!(formatter, "{count} time step{}", plural(*count)),
            Self::Arrays(names) => write!(formatter, "the arrays {}", names.join(", ")),
        }
    }
}

impl Several {
    /// Number of alternatives.
    pub(super) fn count(&self) -> usize {
        match self {
            Self::Components { count, .. } | Self::Times(count) => *count,
            Self::Arrays(names) => names.len(),
        }
    }

    /// The alternatives, for messages.
    pub(super) fn range(&self) -> String {
        let last = self.count().saturating_sub(1);
        match self {
            Self::Components { .. } => format!("a component from 0 to {last}"),
            Self::Times(_) => format!("a time step from 0 to {last}"),
            Self::Arrays(_) => "one of them".to_owned(),
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
}

impl fmt::Display for Asked {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Component(index) => write!(formatter, "component {index}"),
            Self::Time(index) => write!(formatter, "time step {index}"),
            Self::Array(name) => write!(formatter, "the array {name}"),
        }
    }
}
