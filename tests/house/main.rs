//! The repository itself: dependencies of modules, vocabulary, citations.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod citations;
mod layers;
