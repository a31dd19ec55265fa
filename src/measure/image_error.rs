//! Numerical difference of two linear pictures.

use serde::Serialize;

/// Why two pictures cannot be compared.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ComparisonError {
    /// The pictures differ in their number of samples, or the samples do not fill rows of this width.
    #[error("cannot compare {actual} samples with {expected} ({width} pixels per row, {channels} channels)")]
    Shape {
        /// Samples of the picture under test.
        actual: usize,
        /// Samples of the expected picture.
        expected: usize,
        /// Pixels across.
        width: usize,
        /// Samples per pixel.
        channels: usize,
    },
}

impl ComparisonError {
    /// Name for programs; it does not change between versions.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Shape { .. } => "pictures-differ-in-shape",
        }
    }
}

/// Maximum, mean and 99th percentile of errors; infinite where a sample is NaN.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// The largest error.
    pub largest: f64,
    /// The mean of all errors.
    pub mean: f64,
    /// The error that 99 of 100 samples do not exceed.
    pub p99: f64,
}

/// Error of a picture against the expected one, sample by sample.
///
/// Equal samples have no error, also if infinite. A sample that is NaN in either picture has an infinite error.
#[derive(Clone, Debug)]
pub struct ImageError {
    errors: Vec<f64>,
    relative: Vec<f64>,
    width: usize,
    channels: usize,
}

impl ImageError {
    /// Compares two pictures of `width` pixels across and any number of `channels` per pixel.
    ///
    /// `scale(sample)` is the divisor of the sample's error in [`Self::relative`]: Σ|terms| where terms may cancel, or
    /// the peak for a displayed picture. A scale that is not above 0 makes any error there infinite.
    ///
    /// # Errors
    ///
    /// [`ComparisonError::Shape`].
    pub fn between(
        actual: &[f32],
        expected: &[f32],
        (width, channels): (usize, usize),
        scale: impl Fn(usize) -> f64,
    ) -> Result<Self, ComparisonError> {
        let whole_rows = width.checked_mul(channels).is_some_and(|row| row > 0 && actual.len().is_multiple_of(row));
        if actual.len() != expected.len() || !whole_rows {
            let (actual, expected) = (actual.len(), expected.len());
            return Err(ComparisonError::Shape { actual, expected, width, channels });
        }
        let errors: Vec<f64> =
            actual.iter().zip(expected).map(|(&actual, &expected)| error(actual, expected)).collect();
        let against = |(sample, &error): (usize, &f64)| match error / scale(sample) {
            _ if error <= 0.0 => 0.0,
            relative if relative >= 0.0 => relative,
            _ => f64::INFINITY,
        };
        let relative = errors.iter().enumerate().map(against).collect();
        Ok(Self { errors, relative, width, channels })
    }

    /// Spread of the absolute errors.
    #[must_use]
    pub fn absolute(&self) -> Spread {
        spread(&self.errors)
    }

    /// Spread of the errors divided by the scale of each sample.
    #[must_use]
    pub fn relative(&self) -> Spread {
        spread(&self.relative)
    }

    /// Number of samples with an absolute error over `limit`.
    #[must_use]
    pub fn count_over(&self, limit: f64) -> usize {
        count_over(&self.errors, limit)
    }

    /// Number of samples with a relative error over `limit`.
    #[must_use]
    pub fn relative_count_over(&self, limit: f64) -> usize {
        count_over(&self.relative, limit)
    }

    /// Peak signal-to-noise ratio in dB for a peak of 1: −10·log₁₀ of the mean squared error. Infinite for equal
    /// pictures, −∞ where a sample is NaN.
    #[must_use]
    pub fn psnr_db(&self) -> f64 {
        -10.0 * mean(self.errors.iter().map(|error| error * error)).log10()
    }

    /// The sample with the largest absolute error as (x, y, channel); `None` for pictures without pixels.
    #[must_use]
    pub fn worst(&self) -> Option<(usize, usize, usize)> {
        let (sample, _) = self.errors.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1).then(b.0.cmp(&a.0)))?;
        let pixel = sample / self.channels;
        Some((pixel % self.width, pixel / self.width, sample % self.channels))
    }
}

/// Absolute difference of two samples.
#[expect(clippy::float_cmp, reason = "equal infinities have a NaN difference")]
fn error(actual: f32, expected: f32) -> f64 {
    if actual == expected {
        return 0.0;
    }
    let difference = (f64::from(actual) - f64::from(expected)).abs();
    if difference.is_nan() { f64::INFINITY } else { difference }
}

/// Summarises `errors`, which contain no NaN.
fn spread(errors: &[f64]) -> Spread {
    let mut sorted = errors.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    // The smallest sample that 99 of 100 do not exceed: index ⌈0.99·n⌉ − 1.
    let rank = sorted.len().saturating_mul(99).div_ceil(100).saturating_sub(1);
    Spread {
        largest: sorted.last().copied().unwrap_or(0.0),
        mean: mean(errors.iter().copied()),
        p99: sorted.get(rank).copied().unwrap_or(0.0),
    }
}

/// Mean of `values`; 0 if there are none.
#[expect(clippy::cast_precision_loss, reason = "no picture has 2⁵³ samples")]
fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len().max(1) as f64;
    values.sum::<f64>() / count
}

fn count_over(errors: &[f64], limit: f64) -> usize {
    // Not `error > limit`: a NaN limit would then accept everything.
    errors.iter().filter(|&&error| !matches!(error.partial_cmp(&limit), Some(order) if order.is_le())).count()
}

#[cfg(test)]
#[expect(clippy::unwrap_used, reason = "a test fails by panicking")]
mod tests {
    use super::*;

    fn compare(actual: &[f32], expected: &[f32]) -> ImageError {
        ImageError::between(actual, expected, (2, 1), |_| 2.0).unwrap()
    }

    #[test]
    fn known_differences_give_known_numbers() {
        let found = compare(&[0.0, 0.5, 1.0, 1.0], &[0.0, 0.25, 1.0, 2.0]);
        assert_eq!(found.absolute(), Spread { largest: 1.0, mean: 0.3125, p99: 1.0 });
        assert_eq!(found.relative(), Spread { largest: 0.5, mean: 0.15625, p99: 0.5 });
        assert_eq!((found.count_over(0.25), found.count_over(0.2), found.relative_count_over(0.2)), (1, 2, 1));
        assert_eq!(found.worst(), Some((1, 1, 0)));
        // Mean squared error (1/16 + 1)/4.
        assert!((found.psnr_db() + 10.0 * (17.0_f64 / 64.0).log10()).abs() <= 1e-12, "{}", found.psnr_db());
    }

    #[test]
    fn the_percentile_leaves_out_one_sample_in_a_hundred() {
        let expected = [0.0; 200];
        let mut actual = [0.0; 200];
        actual[7] = 5.0;
        actual[8] = 5.0;
        assert!(compare(&actual, &expected).absolute().p99 <= 0.0);
        actual[9] = 5.0;
        assert!(compare(&actual, &expected).absolute().p99 >= 5.0);
    }

    #[test]
    fn a_number_that_is_none_is_infinitely_wrong() {
        for (actual, expected) in [(f32::NAN, 1.0), (1.0, f32::NAN), (f32::NAN, f32::NAN), (f32::INFINITY, 1.0)] {
            let found = compare(&[0.0, actual], &[0.0, expected]);
            assert_eq!(found.absolute(), Spread { largest: f64::INFINITY, mean: f64::INFINITY, p99: f64::INFINITY });
            assert_eq!((found.count_over(1e300), found.relative_count_over(1e300)), (1, 1));
            assert!(found.psnr_db() <= f64::NEG_INFINITY);
        }
    }

    #[test]
    fn equal_pictures_have_no_error() {
        let picture = [0.0, f32::INFINITY, -1.0, 1e-30];
        let found = ImageError::between(&picture, &picture, (1, 4), |_| 0.0).unwrap();
        assert_eq!(found.absolute(), Spread { largest: 0.0, mean: 0.0, p99: 0.0 });
        assert_eq!(found.relative(), Spread { largest: 0.0, mean: 0.0, p99: 0.0 });
        assert!(found.psnr_db() >= f64::INFINITY);
    }

    #[test]
    fn an_error_against_a_scale_of_nothing_is_infinite() {
        let found = ImageError::between(&[1.0], &[0.0], (1, 1), |_| 0.0).unwrap();
        assert!(found.relative().largest >= f64::INFINITY);
    }

    #[test]
    fn pictures_of_different_shapes_are_not_compared() {
        assert!(ImageError::between(&[0.0; 4], &[0.0; 5], (2, 1), |_| 1.0).is_err());
        assert!(ImageError::between(&[0.0; 5], &[0.0; 5], (2, 1), |_| 1.0).is_err());
        assert!(ImageError::between(&[0.0; 4], &[0.0; 4], (0, 1), |_| 1.0).is_err());
    }
}
