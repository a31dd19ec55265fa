//! Results as tables for the terminal.

pub(crate) mod goals;
pub(crate) mod model;
pub(crate) mod needs;
pub(crate) mod palette;
