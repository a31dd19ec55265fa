//! The program as its users run it: commands, files and messages.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod accuracy;
mod bad_input;
mod bench;
mod blocks;
mod bricks;
mod choice;
mod cli;
mod compatibility;
mod examples;
mod failures;
mod figures;
mod first_look;
mod flags;
mod in_memory;
mod keys;
mod label_maps;
mod level;
mod live;
mod measure;
mod model_files;
#[cfg(feature = "mpi")]
mod mpi;
mod out_of_core;
mod output;
mod page;
mod parts;
mod presets;
mod quality;
mod session;
mod shell;
mod slice;
#[path = "../support/mod.rs"]
mod support;
mod tutorials;
