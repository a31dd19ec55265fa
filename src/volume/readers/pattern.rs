//! Numbered file names such as `slice.%03d`.

/// Largest padding width of a number; wider ones are mistakes.
const WIDEST: usize = 32;

/// A printf pattern with one `%d`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Pattern {
    before: String,
    width: usize,
    zeros: bool,
    after: String,
}

impl Pattern {
    /// Parses a pattern with exactly one of `%d`, `%4d`, `%04d` (or `i`, `u` for `d`); `%%` is a per cent sign. The
    /// error is a sentence for the caller's message.
    pub(crate) fn parse(text: &str) -> Result<Self, String> {
        let wrong =
            || format!("{text:?} is not a pattern of numbered files; write exactly one %d, as in slice%03d.raw");
        let mut pieces = vec![String::new()];
        let (mut width, mut zeros) = (0, false);
        let mut characters = text.chars().peekable();
        while let Some(character) = characters.next() {
            if character != '%' || characters.next_if_eq(&'%').is_some() {
                if let Some(piece) = pieces.last_mut() {
                    piece.push(character);
                }
                continue;
            }
            zeros = characters.next_if_eq(&'0').is_some();
            let mut digits = String::new();
            while let Some(digit) = characters.next_if(char::is_ascii_digit) {
                digits.push(digit);
            }
            width = if digits.is_empty() { 0 } else { digits.parse().map_err(|_| wrong())? };
            if !matches!(characters.next(), Some('d' | 'i' | 'u')) || width > WIDEST {
                return Err(wrong());
            }
            pieces.push(String::new());
        }
        match <[String; 2]>::try_from(pieces) {
            Ok([before, after]) => Ok(Self { before, width, zeros, after }),
            Err(_) => Err(wrong()),
        }
    }

    /// Name of file `number`.
    pub(crate) fn name(&self, number: i64) -> String {
        let Self { before, width, zeros, after } = self;
        if *zeros { format!("{before}{number:0width$}{after}") } else { format!("{before}{number:width$}{after}") }
    }
}

/// `problem` of a name that is no pattern, where no file has the name.
pub(crate) fn no_file(problem: &str) -> String {
    format!("there is no file of this name, and {problem}")
}

/// Number of terms from `first` to `last` in steps of `step`; 0 if the steps lead away from `last`.
pub(crate) fn count([first, last, step]: [i64; 3]) -> usize {
    let steps = if step == 0 { None } else { last.checked_sub(first).and_then(|span| span.checked_div(step)) };
    let away = step < 0 && last > first || step > 0 && last < first;
    steps.filter(|_| !away).and_then(|steps| usize::try_from(steps).ok()).map_or(0, |steps| steps.saturating_add(1))
}

/// Returns `wanted` numbers from `first` to `last` in steps of `step`. The error is a sentence if the range has a
/// different number of terms.
pub(crate) fn numbers([first, last, step]: [i64; 3], wanted: usize) -> Result<impl Iterator<Item = i64>, String> {
    let given = count([first, last, step]);
    if given == wanted {
        Ok((0..).take(wanted).map(move |index: i64| first + index * step))
    } else {
        Err(format!("files {first} to {last} in steps of {step} are {given} slices, but the volume has {wanted}"))
    }
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
    use super::*;

    #[test]
    fn numbers_are_padded_as_printf_pads_them() {
        assert_eq!(Pattern::parse("CThead.%d").unwrap().name(7), "CThead.7");
        assert_eq!(Pattern::parse("a%03d.raw").unwrap().name(7), "a007.raw");
        assert_eq!(Pattern::parse("a%3i").unwrap().name(7), "a  7");
        assert_eq!(Pattern::parse("50%%_%u").unwrap().name(1234), "50%_1234");
    }

    #[test]
    fn patterns_without_one_number_are_refused() {
        for wrong in ["plain", "%s", "%d%d", "%", "%999999999999999999999d", "%99d"] {
            assert!(Pattern::parse(wrong).unwrap_err().contains("%d"), "{wrong}");
        }
    }

    #[test]
    fn steps_run_either_way_and_are_counted() {
        assert_eq!(numbers([1, 9, 4], 3).unwrap().collect::<Vec<_>>(), [1, 5, 9]);
        assert_eq!(numbers([3, 1, -1], 3).unwrap().collect::<Vec<_>>(), [3, 2, 1]);
        assert!(numbers([1, 9, 0], 3).is_err(), "a step of nothing");
        assert!(numbers([i64::MIN, i64::MAX, 1], 3).is_err(), "more than can be counted");
        let message = numbers([1, 93, 1], 64).err().unwrap();
        assert!(message.contains("93 slices") && message.contains("64"), "{message}");
    }
}
