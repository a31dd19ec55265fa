//! The window on a virtual display.
#![cfg(feature = "window")]

#[path = "../support/mod.rs"]
mod support;
mod view;
mod view_storm;
