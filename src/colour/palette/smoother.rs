//! Palettes with smoother spectra, and what they cost.

use super::{Palette, PaletteError, Solution, solve};
use relume_base::progress::Progress;

/// A preset of the smoothness of all open spectra.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Smoothing {
    /// Ten times the default.
    Smooth,
    /// A hundred times the default.
    Smoother,
    /// A thousand times the default.
    Smoothest,
}

impl Smoothing {
    /// All presets.
    pub const ALL: [Self; 3] = [Self::Smooth, Self::Smoother, Self::Smoothest];

    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Smooth => "smooth",
            Self::Smoother => "smoother",
            Self::Smoothest => "smoothest",
        }
    }

    /// Its weight of the curvature relative to ΔE00².
    #[must_use]
    pub const fn smoothness(self) -> f64 {
        match self {
            Self::Smooth => 1e-3,
            Self::Smoother => 1e-2,
            Self::Smoothest => 1e-1,
        }
    }
}

/// Solution of a palette with the smoothness of a preset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SmoothCost {
    /// The preset.
    pub smoothing: Smoothing,
    /// Largest ΔE00.
    pub worst: f64,
    /// Largest share of a colour from the ends of the visible range; 0 below the share that is reported.
    pub edge: f64,
}

impl Palette {
    /// The palette with this smoothness of every open spectrum.
    #[must_use]
    pub fn smoothed(&self, smoothness: f64) -> Self {
        let mut palette = self.clone();
        let members = palette.materials.iter_mut().chain(&mut palette.lights);
        members.filter(|member| member.spectrum.is_none()).for_each(|member| member.smoothness = smoothness);
        palette
    }

    /// Largest smoothness of an open spectrum; 0 if all are given.
    fn smoothest(&self) -> f64 {
        let open = self.materials.iter().chain(&self.lights).filter(|member| member.spectrum.is_none());
        open.map(|member| member.smoothness).fold(0.0, f64::max)
    }
}

impl Solution {
    /// Largest share of a colour from the ends of the visible range; 0 below the share that [`Self::edges`] reports.
    #[must_use]
    pub fn largest_edge(&self) -> f64 {
        self.edges().iter().map(|edge| edge.shares[0] + edge.shares[1]).fold(0.0, f64::max)
    }
}

/// Solves `palette` with each preset above its own smoothness.
///
/// # Errors
///
/// As [`solve()`].
pub fn smoother(palette: &Palette, progress: &dyn Progress) -> Result<Vec<SmoothCost>, PaletteError> {
    let now = palette.smoothest();
    let presets = Smoothing::ALL.into_iter().filter(|smoothing| smoothing.smoothness() > now);
    presets
        .map(|smoothing| {
            let solution = solve(&palette.smoothed(smoothing.smoothness()), progress)?;
            Ok(SmoothCost { smoothing, worst: solution.worst(), edge: solution.largest_edge() })
        })
        .collect()
}
