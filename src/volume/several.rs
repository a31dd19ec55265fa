//! The volumes of a file that holds several.

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
    /// Name of the flag that chooses one, and the number of alternatives.
    pub(super) fn counted(&self) -> (&'static str, usize) {
        match self {
            Self::Components { count, .. } => ("component", *count),
            Self::Times(count) => ("time", *count),
            Self::Arrays(names) => ("array", names.len()),
        }
    }

    /// The flag that chooses one, with its range, for messages.
    pub(super) fn flag(&self) -> String {
        match (self, self.counted()) {
            (Self::Arrays(_), _) => "--array NAME".to_owned(),
            (_, (name, count)) => format!("--{name} N, from 0 to {}", count.saturating_sub(1)),
        }
    }
}
