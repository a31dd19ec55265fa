//! Helpers shared by the integration tests.
#![allow(dead_code, unreachable_pub, reason = "each test program uses a part of it, and has it to itself")]

pub mod bounds;
pub mod browser;
pub mod device;
pub mod dicom;
pub mod exr;
pub mod golden;
pub mod program;
pub mod rungs;
pub mod scenes;
pub mod screen;
pub mod tolerance;
pub mod volumes;
