//! Volumes of every format: values, geometry, and refusals.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod arrays;
mod bricks;
mod convert;
mod dicom;
mod dicom_kinds;
mod foreign;
mod levels;
mod metaimage;
mod mgh;
mod mrc;
mod netcdf;
mod nifti;
mod nrrd;
mod numpy;
mod phantom;
mod preview;
mod refusals;
mod slabs;
#[path = "../support/mod.rs"]
mod support;
mod tiff;
mod volume;
mod vti;
mod vtk;
