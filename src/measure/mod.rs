//! What a result costs and how far it is from the truth.

mod clock;
mod image_error;

pub use clock::{Stopwatch, Summary, Timing, peak_mb, summary};
pub use image_error::{ImageError, MeasureError, Spread};
