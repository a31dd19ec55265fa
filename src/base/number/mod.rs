//! Counts as numbers and numbers as counts, where a plain cast is right; numbers, places and spellings in
//! words, for messages.

mod real;
mod spelling;

pub use real::Real;
pub use real::{dot, power, unit};
pub use spelling::edit_distance;

/// A count of pixels, voxels, entries or samples; exact below 2⁵³.
#[expect(clippy::cast_precision_loss, reason = "counts are far below 2⁵³")]
#[must_use]
pub fn count(n: usize) -> f64 {
    n as f64
}

/// Rounds to the f32 a shader reads.
#[expect(clippy::cast_possible_truncation, reason = "the one rounding of tables")]
#[must_use]
pub fn rounded(value: f64) -> f32 {
    value as f32
}

/// The whole part of a number as a count; negative ones and NaN are 0.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "casts of floats saturate")]
#[must_use]
pub fn whole(number: f64) -> usize {
    number as usize
}

/// The nearest whole number; NaN is 0.
#[expect(clippy::cast_possible_truncation, reason = "casts of floats saturate")]
#[must_use]
pub fn nearest(number: f64) -> i32 {
    number.round() as i32
}

/// The whole number of a float that is one, and of which all digits are known.
#[must_use]
pub fn nearest_label(number: f64) -> Option<i64> {
    let size = number.abs();
    if number.is_nan() || size.fract() > 0.0 || size > 9_007_199_254_740_992.0 {
        return None;
    }
    let size = i64::try_from(whole(size)).ok()?;
    Some(if number < 0.0 { -size } else { size })
}

/// A whole number as a float; exact below 2⁵³.
#[expect(clippy::cast_precision_loss, reason = "more digits are names, not sizes")]
#[must_use]
pub fn from_label(label: i64) -> f64 {
    label as f64
}

/// A count as a shader has it; one that does not fit is the largest, which every limit refuses.
#[must_use]
pub fn unsigned(n: usize) -> u32 {
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

/// [`readable`] to seven digits: what rounding has left behind them says nothing.
#[must_use]
pub fn brief(number: f64) -> String {
    readable(format!("{number:.6e}").parse().unwrap_or(number))
}

/// [`brief`] for one of the values of a range of the length `span`: with as many digits more as far offsets take, so that
/// values of the range can be told apart.
#[must_use]
pub fn brief_in(number: f64, span: f64) -> String {
    in_range(number, span, 7)
}

/// `number` to this many digits, and those that the offset of a range of the length `span` takes.
pub fn in_range(number: f64, span: f64, digits: usize) -> String {
    /// Digits that all f64 have.
    const ALL: usize = 17;
    let powers = number.abs().log10().floor() - span.abs().log10().floor();
    let offset = if powers.is_finite() { whole(powers) } else { 0 };
    let digits = (digits + offset).min(ALL) - 1;
    readable(format!("{number:.digits$e}").parse().unwrap_or(number))
}

/// The line and the column of a byte of `text`, from 1.
#[must_use]
pub fn line_and_column(text: &str, byte: usize) -> [usize; 2] {
    let before = text.get(..byte).unwrap_or(text);
    let line = before.matches('\n').count() + 1;
    [line, before.rsplit('\n').next().map_or(0, |line| line.chars().count()) + 1]
}

/// A clause as the beginning of a sentence.
#[must_use]
pub fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

/// The end of serde's message about a text in place of three numbers, as in `spacing = "0.9 mm"`, and its replacement.
const WITH_UNIT: [&str; 2] =
    ["\", expected an array of length 3", "\", expected three numbers in brackets without a unit, such as [1, 1, 2]"];

/// A message of serde with its names of Rust's numbers in words.
#[must_use]
pub fn in_words(message: &str) -> String {
    [
        ("a nonzero usize", "a whole number from 1"),
        ("usize", "a whole number from 0"),
        ("u64", "a whole number from 0"),
        ("i64", "a whole number"),
        ("f64", "a number"),
    ]
    .into_iter()
    .fold(message.replace(WITH_UNIT[0], WITH_UNIT[1]), |text, (name, words)| {
        text.replace(&format!("expected {name}"), &format!("expected {words}"))
    })
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
