//! Where in a written text something stands, and which word an unknown one was meant to be.

use crate::spectrum::nearest;

/// `name:line:column` of a byte of `text`.
pub(crate) fn place(name: &str, text: &str, byte: usize) -> String {
    let before = text.get(..byte).unwrap_or(text);
    let line = before.matches('\n').count() + 1;
    let column = before.rsplit('\n').next().map_or(0, |line| line.chars().count()) + 1;
    format!("{name}:{line}:{column}")
}

/// serde's message about an unknown `word`, and which of the words that it expects is nearly that one.
pub(crate) fn with_suggestion(message: &str) -> String {
    let mut words = message.split('`').skip(1).step_by(2);
    match words.next().filter(|_| message.starts_with("unknown")).and_then(|unknown| nearest(unknown, words)) {
        Some(nearest) => format!("{message}; did you mean `{nearest}`?"),
        None => message.to_owned(),
    }
}
