//! The viewer: a window for exploring a scene under changing light.
//!
//! [`crate::document::State`] is the editable state, [`engine`] renders it in slices, [`load`] opens files in the
//! background. These depend on no window and no toolkit; `window` and `ui`, behind the feature `window`, put them on
//! screen.

pub mod action;
#[cfg(feature = "window")]
mod advice;
pub mod effort;
pub mod engine;
pub mod export;
pub mod layout;
pub mod load;
#[cfg(feature = "window")]
mod options;
pub mod probe;
pub mod prober;
pub mod recent;
#[cfg(feature = "window")]
mod screen;
pub mod script;
pub mod sizes;
pub mod slices;
pub mod task;
pub mod tour;
#[cfg(feature = "window")]
pub mod ui;
#[cfg(feature = "window")]
pub mod window;

pub use action::Action;
pub use engine::{Counts, Engine};
pub use load::{LoadError, Loaded};
#[cfg(feature = "window")]
pub use options::{Options, ViewError};
pub use probe::Probe;
pub use script::{Script, ScriptError};
#[cfg(feature = "window")]
pub use window::{Report, run};
