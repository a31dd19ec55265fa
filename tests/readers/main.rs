//! Volumes of every format: values, geometry, and refusals.

mod arrays;
mod convert;
mod dicom;
mod foreign;
mod metaimage;
mod mrc;
mod nifti;
mod nrrd;
mod numpy;
mod phantom;
#[path = "../support/mod.rs"]
mod support;
mod tiff;
mod volume;
mod vti;
mod vtk;
