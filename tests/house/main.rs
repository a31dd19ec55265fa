//! The repository itself: dependencies of modules, vocabulary, citations.

mod citations;
mod layers;
