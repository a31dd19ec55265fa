//! The scene in numbers a march reads, computed in f64 and rounded once.
