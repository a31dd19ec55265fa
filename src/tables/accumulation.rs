//! What a march leaves, on the host.

/// What a march leaves: independent of every light's spectrum.
#[derive(Clone, Debug, PartialEq)]
pub struct Accumulation<R> {
    /// Pixels across and down.
    pub size: [usize; 2],
    /// Weight of component `c` at position `p` in pixel `i`: `weights[(p·components + c)·pixels + i]`.
    pub weights: Vec<R>,
    /// Light that passes, one number a pixel or as many as there are components: number `c` of pixel `i` at `c·pixels + i`.
    pub transmittance: Vec<R>,
}
