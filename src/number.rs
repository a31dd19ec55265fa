//! Counts as numbers and numbers as counts, where a plain cast is right.

/// A count of pixels, voxels, entries or samples; exact below 2⁵³.
#[expect(clippy::cast_precision_loss, reason = "counts are far below 2⁵³")]
#[must_use]
pub(crate) fn count(n: usize) -> f64 {
    n as f64
}

/// The whole part of a number as a count; negative ones and NaN are 0.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "casts of floats saturate")]
#[must_use]
pub(crate) fn whole(number: f64) -> usize {
    number as usize
}

/// A count as a shader has it; one that does not fit is the largest, which every limit refuses.
#[must_use]
pub(crate) fn unsigned(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}

/// A number for people: in digits, or with an exponent where those would be many.
#[must_use]
pub fn readable(number: f64) -> String {
    let size = number.abs();
    if number == 0.0 || !size.is_finite() || (1e-4..1e15).contains(&size) {
        number.to_string()
    } else {
        format!("{number:e}")
    }
}

#[cfg(test)]
mod tests {
    use super::readable;

    #[test]
    fn a_number_far_from_one_has_an_exponent() {
        for (number, text) in [
            (0.0, "0"),
            (-0.5, "-0.5"),
            (1e9, "1000000000"),
            (123_456.75, "123456.75"),
            (1e15, "1e15"),
            (-1.7e308, "-1.7e308"),
            (1e-5, "1e-5"),
            (f64::INFINITY, "inf"),
            (f64::NAN, "NaN"),
        ] {
            assert_eq!(readable(number), text);
        }
    }
}
