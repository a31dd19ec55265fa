//! Description of the pages of a TIFF file: axes, names, spacing and unit.

use crate::readers::lengths::converted;
use crate::{Unit, Window};

/// Axes, units and names of the pages.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Stated {
    /// Pages along z, channel and time.
    pub(super) sizes: [usize; 3],
    /// Distances of voxels along x, y and z in `unit`, each as far as it is stated.
    pub(super) spacing: [Option<f64>; 3],
    pub(super) unit: Option<Unit>,
    /// Names of the channels; empty if none is stated.
    pub(super) names: Vec<String>,
    /// Window of each channel; the last one is for all further channels.
    pub(super) windows: Vec<Option<Window>>,
    /// Colour of each channel, `#rrggbb`, as far as it is stated.
    pub(super) colours: Vec<Option<String>>,
    /// Slope and intercept of the values.
    pub(super) scale: Option<[f64; 2]>,
    /// Further keys and values.
    pub(super) metadata: Vec<(String, String)>,
    /// Sentences about oddities, without the name of the file.
    pub(super) notes: Vec<String>,
}

impl Stated {
    /// Converts the distance `length` of `unit` along axis `axis` to the unit of the volume, which is that of x. A distance
    /// that is not a positive number is not stated.
    pub(super) fn set_spacing(&mut self, axis: usize, length: f64, unit: Option<(Unit, f64)>) {
        if !(length.is_finite() && length > 0.0) {
            return;
        }
        let Some((unit, factor)) = unit else {
            self.spacing[axis] = Some(length);
            return;
        };
        let own = *self.unit.get_or_insert(unit);
        self.spacing[axis] = Some(converted(length, (unit, factor), own));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::readers::lengths::unit;

    #[test]
    fn all_axes_take_the_unit_of_x() {
        let mut stated = Stated::default();
        stated.set_spacing(0, 0.5, unit("µm"));
        stated.set_spacing(1, 5e-7, unit("m"));
        stated.set_spacing(2, 1500.0, unit("nm"));
        assert_eq!(stated.unit, Some(Unit::Micrometre));
        let [x, y, z] = stated.spacing.map(Option::unwrap_or_default);
        assert!((x - 0.5).abs() < 1e-15 && (y - 0.5).abs() < 1e-15 && (z - 1.5).abs() < 1e-15, "{x} {y} {z}");
        stated.set_spacing(2, f64::NAN, unit("nm"));
        stated.set_spacing(1, 0.0, None);
        assert_eq!(stated.spacing, [Some(x), Some(y), Some(z)], "lengths that are none change nothing");
    }
}
