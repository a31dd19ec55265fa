//! Utilities of all crates of Relume: conversions of numbers, parallel loops, progress and cancellation, available memory, and
//! the safe opening of input files.

pub mod input;
pub mod memory;
pub mod number;
pub mod parallel;
pub mod progress;
