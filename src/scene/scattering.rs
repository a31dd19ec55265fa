//! Settings of light that scatters more than once (docs/theory/scattering.md).

use crate::Scene;
use relume_base::number::{count, whole};

/// Light that scatters more than once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scattering {
    /// Number of times that light scatters.
    pub orders: Orders,
    /// Method that finds the light of all orders but the first.
    pub method: ScatteringMethod,
    /// Largest distance in voxels of two nodes at which this light is known; `None` follows [`Scene::scattering_spacing`].
    pub spacing: Option<f64>,
    /// Directions from which light is gathered at a node; `None` for [`USUAL_DIRECTIONS`].
    pub directions: Option<usize>,
    /// The directions that are used.
    pub half: Half,
    /// Paths of a pixel, with [`ScatteringMethod::Paths`].
    pub paths: usize,
}

/// Part of the directions from which light is gathered: pictures of the two halves differ by twice the error of all directions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Half {
    /// All of them.
    #[default]
    Both,
    /// Those with even numbers.
    Even,
    /// Those with odd numbers.
    Odd,
}

/// Directions from which light is gathered at a node by default.
pub const USUAL_DIRECTIONS: usize = 16;

/// Nodes of a grid that follows no stated spacing.
const USUAL_NODES: f64 = 32_768.0;
/// Smallest and largest spacing, in voxels, of a grid that follows no stated one.
const USUAL_SPACINGS: [f64; 2] = [1.0, 8.0];

impl Default for Scattering {
    fn default() -> Self {
        Self {
            orders: Orders::default(),
            method: ScatteringMethod::default(),
            spacing: None,
            directions: None,
            half: Half::Both,
            paths: 256,
        }
    }
}

/// Number of times that light scatters on its way to the eye.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Orders {
    /// Once.
    #[default]
    Single,
    /// Any number of times.
    Multiple,
}

/// Method that finds light that has scattered before.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ScatteringMethod {
    /// At nodes of a grid, from rows of transfer factors between them.
    #[default]
    Rows,
    /// By random paths from each pixel: slow, with noise and without other errors. For the reference only.
    Paths,
}

impl Scene {
    /// True if light scatters more than once.
    #[must_use]
    pub const fn scatters_often(&self) -> bool {
        matches!(self.scattering.orders, Orders::Multiple) && !self.blending.is_extreme()
    }

    /// Largest distance in voxels of two nodes at which scattered light is known: the stated one, or the one that gives a box of the
    /// volume's shape some ten thousand nodes.
    #[must_use]
    pub fn scattering_spacing(&self) -> f64 {
        let [low, high] = self.crop.unwrap_or_else(|| self.frame.whole_box());
        let voxels = (high - low).max(glam::DVec3::ONE).element_product();
        let [least, most] = USUAL_SPACINGS;
        self.scattering.spacing.unwrap_or_else(|| (voxels / USUAL_NODES).cbrt().clamp(least, most))
    }

    /// This scene with scattered light that takes about a thirtieth of the work: at nodes twice as far apart, from half as many directions.
    #[must_use]
    pub fn with_rough_scattering(&self) -> Self {
        let (spacing, directions) = (self.scattering_spacing(), self.scattering_directions());
        let mut rough = self.clone();
        rough.scattering.spacing = Some(2.0 * spacing);
        rough.scattering.directions = Some((directions / 2).max(2));
        rough
    }

    /// Directions from which scattered light is gathered at a node: an even number, so that halves of them can be compared.
    #[must_use]
    pub fn scattering_directions(&self) -> usize {
        let directions = self.scattering.directions.unwrap_or(USUAL_DIRECTIONS);
        2 * whole((count(directions) / 2.0).ceil())
    }
}
