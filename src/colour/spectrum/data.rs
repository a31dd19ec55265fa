//! Parses the tables of `data/spectra/` at compile time, so that a malformed table is a compile error.

use super::{BANDS, FIRST_NM, LAST_NM, STEP_NM};

/// Parses columns 2, 3, … of `csv` on the grid.
///
/// `csv` has comment lines (`#`), one header line, and rows of a wavelength in nm and `N` values at the grid's spacing;
/// rows outside 380–780 nm are skipped.
///
/// # Panics
///
/// On any other text. Called for statics only, where a panic is a compile error.
pub(super) const fn columns<const N: usize>(csv: &str) -> [[f64; BANDS]; N] {
    let text = csv.as_bytes();
    let mut columns = [[0.0; BANDS]; N];
    let mut at = 0;
    while text[at] == b'#' {
        at = next_line(text, at);
    }
    at = next_line(text, at);
    let mut band = 0;
    let mut expected_nm = FIRST_NM;
    while at < text.len() {
        let (nm, after) = decimal(text, at);
        if nm < FIRST_NM || nm > LAST_NM {
            at = next_line(text, at);
            continue;
        }
        assert!((nm - expected_nm).abs() < f64::EPSILON, "the rows are not the grid's wavelengths in order");
        expected_nm += STEP_NM;
        at = after;
        let mut column = 0;
        while column < N {
            assert!(text[at] == b',', "a row has too few values");
            (columns[column][band], at) = decimal(text, at + 1);
            column += 1;
        }
        assert!(text[at] == b'\n', "a row has too many values");
        at += 1;
        band += 1;
    }
    assert!(band == BANDS, "the table does not cover the grid");
    columns
}

/// Index of the byte after the next line feed.
const fn next_line(text: &[u8], mut at: usize) -> usize {
    while text[at] != b'\n' {
        at += 1;
    }
    at + 1
}

/// Parses the unsigned decimal number (`1.5`, `3e-06`) at byte `at`, correctly rounded; returns it with the index of
/// the next byte.
const fn decimal(text: &[u8], mut at: usize) -> (f64, usize) {
    let mut digits: u64 = 0;
    let mut decimals: u32 = 0;
    let mut behind_point = false;
    let start = at;
    loop {
        match text[at] {
            digit @ b'0'..=b'9' => {
                digits = digits * 10 + (digit - b'0') as u64;
                decimals += behind_point as u32;
            }
            b'.' if !behind_point => behind_point = true,
            _ => break,
        }
        at += 1;
    }
    assert!(at > start, "a number is missing");
    if text[at] == b'e' {
        assert!(text[at + 1] == b'-', "only negative exponents are read");
        let (exponent, after) = decimal(text, at + 2);
        let mut unit = 0.0;
        while unit < exponent {
            decimals += 1;
            unit += 1.0;
        }
        at = after;
    }
    // Both operands are exact in f64, so the quotient is correctly rounded.
    assert!(digits < 1 << 53 && decimals <= 22, "a number has too many digits");
    let mut power = 1.0;
    while decimals > 0 {
        power *= 10.0;
        decimals -= 1;
    }
    (exact(digits) / power, at)
}

#[expect(clippy::cast_precision_loss, reason = "asserted by the caller to be below 2^53")]
const fn exact(integer: u64) -> f64 {
    integer as f64
}
