//! What one frame computes: what the scene needs at the accuracy asked for.
