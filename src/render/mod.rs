//! Frames on the GPU.
