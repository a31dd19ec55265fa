//! The equations, written to be read.
