//! What a spectrum is.
