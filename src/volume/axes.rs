//! Axes of arrays of numbers: which are x, y and z, which are channels and times.

use std::path::Path;

use super::select::Pick;
use super::{VolumeError, Voxel, Voxels, allocate};
use relume_base::parallel;

/// Meaning of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Axis {
    X,
    Y,
    Z,
    Channel,
    Time,
}

impl Axis {
    /// The axis that files and users call `name`; `None` for another name.
    pub(super) fn named(name: &str) -> Option<Self> {
        Some(match name.trim().to_ascii_lowercase().as_str() {
            "x" => Self::X,
            "y" => Self::Y,
            "z" => Self::Z,
            "c" | "channel" => Self::Channel,
            "t" | "time" => Self::Time,
            _ => return None,
        })
    }
}

/// Axes of an array whose names are not known, slowest first: z, y, x, if at most three are longer than 1.
pub(super) fn unnamed(shape: &[usize]) -> Option<Vec<Option<Axis>>> {
    let is_used = |length: usize| shape.len() <= 3 || length > 1;
    let mut left = vec![Axis::Z, Axis::Y, Axis::X];
    let mut axes: Vec<Option<Axis>> = shape
        .iter()
        .rev()
        .map(|&length| if is_used(length) { left.pop().map_or(Err(()), |axis| Ok(Some(axis))) } else { Ok(None) })
        .collect::<Result<_, ()>>()
        .ok()?;
    axes.reverse();
    Some(axes)
}

/// Axes of an array with these names, slowest first. Axes with other names take the meanings that are left, in the order
/// z, y, x. `None` if there are too many of them, or not one name per axis.
pub(super) fn named(names: &[impl AsRef<str>], shape: &[usize]) -> Option<Vec<Option<Axis>>> {
    if names.len() != shape.len() {
        return None;
    }
    let of = |name: &str| match name.to_ascii_lowercase().as_str() {
        "lon" | "longitude" | "xspace" => Some(Axis::X),
        "lat" | "latitude" | "yspace" => Some(Axis::Y),
        "lev" | "level" | "depth" | "height" | "altitude" | "plev" | "zspace" => Some(Axis::Z),
        name => Axis::named(name),
    };
    let mut axes: Vec<Option<Axis>> = names.iter().map(|name| of(name.as_ref())).collect();
    let is_complete = axes.iter().zip(shape).all(|(axis, &length)| axis.is_some() || length == 1);
    if is_complete && axes.contains(&Some(Axis::X)) && axes.contains(&Some(Axis::Y)) {
        return Some(axes);
    }
    let left: Vec<Axis> = [Axis::Z, Axis::Y, Axis::X].into_iter().filter(|&axis| !axes.contains(&Some(axis))).collect();
    let open: Vec<usize> = (0..axes.len()).filter(|&at| axes[at].is_none()).collect();
    let first = left.len().checked_sub(open.len())?;
    for (&at, &axis) in open.iter().zip(&left[first..]) {
        axes[at] = Some(axis);
    }
    Some(axes)
}

/// The axes that a user states as letters, slowest first, as in `czyx`, for an array of this shape.
///
/// The error is a sentence.
pub(super) fn stated(letters: &str, shape: &[usize]) -> Result<Vec<Option<Axis>>, String> {
    let axes: Vec<Option<Axis>> = letters.chars().map(|letter| Axis::named(letter.encode_utf8(&mut [0; 4]))).collect();
    if axes.len() != shape.len() {
        return Err(format!(
            "the axes {letters} are {}, but the array has {} ({})",
            axes.len(),
            shape.len(),
            by(shape)
        ));
    }
    if let Some(at) = axes.iter().position(Option::is_none) {
        let letter = letters.chars().nth(at).unwrap_or_default();
        return Err(format!("the axes {letters} have the letter {letter}, which is none of x, y, z, c, t"));
    }
    Ok(axes)
}

/// `a×b×c`, in the order of the array.
pub(super) fn by(shape: &[usize]) -> String {
    shape.iter().map(ToString::to_string).collect::<Vec<_>>().join("×")
}

/// An array as volumes of several channels and times.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Arranged {
    /// Lengths of the axes, slowest first.
    pub(super) shape: Vec<usize>,
    /// Meaning of each axis; axes without one have length 1.
    pub(super) axes: Vec<Option<Axis>>,
}

impl Arranged {
    /// An array of this shape with these axes, slowest first.
    ///
    /// The error is a sentence: an axis is there twice, or an axis without a meaning is longer than 1.
    pub(super) fn new(shape: &[usize], axes: Vec<Option<Axis>>) -> Result<Self, String> {
        for (index, axis) in axes.iter().enumerate() {
            let length = shape.get(index).copied().unwrap_or(1);
            if axis.is_none() && length != 1 {
                return Err(format!(
                    "axis {index} of {length} entries ({}) is none of x, y, z, channel and time",
                    by(shape)
                ));
            }
            if axis.is_some() && axes[..index].contains(axis) {
                return Err(format!("axis {index} has the same meaning as an axis before it"));
            }
        }
        Ok(Self { shape: shape.to_vec(), axes })
    }

    /// Index of `axis` in the array.
    pub(super) fn place(&self, axis: Axis) -> Option<usize> {
        self.axes.iter().position(|one| *one == Some(axis))
    }

    /// Number of entries along `axis`; 1 without such an axis.
    pub(super) fn length(&self, axis: Axis) -> usize {
        self.place(axis).map_or(1, |place| self.shape[place])
    }

    /// Voxels along x, y and z.
    pub(super) fn dims(&self) -> [usize; 3] {
        [Axis::X, Axis::Y, Axis::Z].map(|axis| self.length(axis))
    }

    /// The positions along the axes of channels and times, for numbers that are stored with the last axis fastest.
    pub(super) fn picks(&self, channel: usize, time: usize) -> Vec<Pick> {
        let pick = |(axis, index): (Axis, usize)| {
            let place = self.place(axis)?;
            let stride = self.shape[place + 1..].iter().product();
            Some(Pick { stride, length: self.shape[place], index })
        };
        [(Axis::Channel, channel), (Axis::Time, time)].into_iter().filter_map(pick).collect()
    }

    /// The same numbers with the first axis fastest.
    pub(super) fn reversed(mut self) -> Self {
        self.shape.reverse();
        self.axes.reverse();
        self
    }

    /// Distances of neighbours along x, y and z among the numbers of one channel and time, which are stored with the last
    /// axis fastest.
    fn strides(&self) -> [usize; 3] {
        let is_spatial = |place: &usize| !matches!(self.axes[*place], Some(Axis::Channel | Axis::Time));
        [Axis::X, Axis::Y, Axis::Z].map(|axis| {
            let place = self.place(axis).unwrap_or(self.shape.len());
            (place + 1..self.shape.len()).filter(is_spatial).map(|place| self.shape[place]).product()
        })
    }

    /// Whether the numbers of one channel and time have x fastest, then y.
    pub(super) fn is_straight(&self) -> bool {
        let (dims, strides) = (self.dims(), self.strides());
        let straight = [1, dims[0], dims[0] * dims[1]];
        (0..3).all(|axis| dims[axis] == 1 || strides[axis] == straight[axis])
    }

    /// Lays the numbers `part` of one channel and time, from number `first` on, into the `volume` with x fastest.
    pub(super) fn lay<T: Voxel, V: Voxel>(
        &self,
        first: usize,
        part: &[T],
        volume: &mut [V],
        convert: impl Fn(T) -> V + Sync,
    ) {
        let [nx, ny, _] = self.dims();
        let [across, down, deep] = self.strides();
        parallel::rows_mut(volume, nx, &|row, out| {
            let begin = row % ny * down + row / ny * deep;
            // Voxels of the row in the part.
            let low = first.saturating_sub(begin).div_ceil(across).min(nx);
            let high = (first + part.len()).saturating_sub(begin).div_ceil(across).min(nx);
            for (x, voxel) in out.iter_mut().enumerate().take(high).skip(low) {
                *voxel = convert(part[begin + x * across - first]);
            }
        });
    }

    /// The voxels of one channel and time with x fastest, from `stored` with the last axis fastest.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Memory`].
    pub(super) fn straightened<T: Voxel>(&self, source: &str, stored: Vec<T>) -> Result<Voxels, VolumeError> {
        let [nx, ny, _] = self.dims();
        let strides = self.strides();
        if self.is_straight() {
            return Ok(T::into_voxels(stored));
        }
        let mut voxels = allocate::zeroed::<T>(Path::new(source), stored.len())?;
        parallel::rows_mut(&mut voxels, nx, &|row, out| {
            let from = row % ny * strides[1] + row / ny * strides[2];
            for (x, voxel) in out.iter_mut().enumerate() {
                *voxel = stored[from + x * strides[0]];
            }
        });
        Ok(T::into_voxels(voxels))
    }
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
    use super::*;

    #[test]
    fn the_last_axes_are_z_y_x_without_names() {
        use Axis::{X, Y, Z};
        assert_eq!(unnamed(&[4, 5, 6]).unwrap(), [Some(Z), Some(Y), Some(X)]);
        assert_eq!(unnamed(&[5, 6]).unwrap(), [Some(Y), Some(X)]);
        assert_eq!(unnamed(&[1, 4, 1, 5, 6]).unwrap(), [None, Some(Z), None, Some(Y), Some(X)]);
        assert_eq!(unnamed(&[2, 4, 5, 6]), None);
    }

    #[test]
    fn stated_axes_name_every_axis_once() {
        let axes = stated("czyx", &[2, 4, 5, 6]).unwrap();
        let array = Arranged::new(&[2, 4, 5, 6], axes).unwrap();
        assert_eq!((array.dims(), array.length(Axis::Channel), array.length(Axis::Time)), ([6, 5, 4], 2, 1));
        assert_eq!(array.strides(), [1, 6, 30]);
        assert_eq!(array.picks(1, 0), [Pick { stride: 120, length: 2, index: 1 }]);
        assert!(stated("zyx", &[2, 4, 5, 6]).unwrap_err().contains("2×4×5×6"));
        assert!(stated("qzyx", &[2, 4, 5, 6]).unwrap_err().contains("letter q"));
        // x and z apart, with the channels between them.
        let turned = Arranged::new(&[2, 3, 4], stated("xcz", &[2, 3, 4]).unwrap()).unwrap();
        assert_eq!((turned.dims(), turned.strides()), ([2, 1, 4], [4, 1, 1]));
        let straight = turned.straightened("v", vec![1_u8, 2, 3, 4, 5, 6, 7, 8]).unwrap();
        assert_eq!(straight, Voxels::U8(vec![1, 5, 2, 6, 3, 7, 4, 8]));
        let twice = stated("zzyx", &[2, 4, 5, 6]).unwrap();
        assert!(Arranged::new(&[2, 4, 5, 6], twice).unwrap_err().contains("axis 1"));
    }

    #[test]
    fn named_axes_keep_their_meaning_and_others_take_those_left() {
        use Axis::{Time, X, Y, Z};
        let named = |names: &[&str]| named(names, &[12, 64, 128, 5][..names.len()]);
        let all = |axes: &[Axis]| Some(axes.iter().copied().map(Some).collect::<Vec<_>>());
        assert_eq!(named(&["time", "lat", "lon"]), all(&[Time, Y, X]), "no time becomes z");
        assert_eq!(named(&["x", "y", "layer"]), all(&[X, Y, Z]), "the order does not override names");
        assert_eq!(named(&["time", "level", "south", "west"]), all(&[Time, Z, Y, X]));
        assert_eq!(named(&["rows", "columns"]), all(&[Y, X]));
        assert_eq!(named(&["a", "b", "d", "e"]), None, "four without a meaning");
    }
}
