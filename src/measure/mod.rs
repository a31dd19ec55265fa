//! What a result costs and how far it is from the truth.

mod clock;
mod consistency;
mod image_error;
mod model;

pub use clock::{Stopwatch, Summary, Timing, peak_mb, summary};
pub use consistency::{HalvedStep, RelitRow, halved_steps, relit_against_rendered};
pub use image_error::{ImageError, MeasureError, Spread};
pub use model::{
    AutomaticRow, AutomaticSummary, LIGHT_GROUPS, ModelRow, ModelSetting, ModelTableError, SpectraKind,
    automatic_dimension, model_row,
};
