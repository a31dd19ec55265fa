//! Pictures and accumulators as files.
