//! Numbers with few digits, and sizes in MB.

use relume_base::number::count;

/// Bytes in MB of 10⁶ bytes.
pub(super) fn megabytes(bytes: u64) -> f64 {
    count(usize::try_from(bytes).unwrap_or(usize::MAX)) / 1e6
}

/// Formats a number with about three digits.
pub(super) fn short(number: f64) -> String {
    let size = number.abs();
    if number == 0.0 {
        "0".to_owned()
    } else if size < 1e-3 {
        format!("{number:.0e}")
    } else {
        // Thresholds include the rounding: 9.998 is printed as 10.0.
        let decimals = if size < 0.0995 {
            3
        } else if size < 9.995 {
            2
        } else {
            usize::from(size < 99.95)
        };
        format!("{number:.decimals$}")
    }
}

#[cfg(test)]
mod tests {
    use super::short;

    #[test]
    fn numbers_have_about_three_digits() {
        for (number, text) in
            [(0.0, "0"), (1234.5, "1234"), (99.94, "99.9"), (1.234, "1.23"), (0.0123, "0.012"), (1.26e-5, "1e-5")]
                .into_iter()
                .chain([(99.96, "100"), (9.998, "10.0"), (0.0997, "0.10")])
        {
            assert_eq!(short(number), text);
        }
    }
}
