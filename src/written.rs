//! Where in a written text something stands, and which word an unknown one was meant to be.

use crate::number::{in_words, line_and_column};
use crate::spectrum::nearest;

/// `name:line:column` of a byte of `text`.
pub(crate) fn place(name: &str, text: &str, byte: usize) -> String {
    let [line, column] = line_and_column(text, byte);
    format!("{name}:{line}:{column}")
}

/// serde's message about an unknown `word`, and which of the words that it expects is nearly that one.
pub(crate) fn with_suggestion(message: &str) -> String {
    let mut words = message.split('`').skip(1).step_by(2);
    match words.next().filter(|_| message.starts_with("unknown")).and_then(|unknown| nearest(unknown, words)) {
        Some(nearest) => format!("{message}; did you mean `{nearest}`?"),
        None => in_words(message),
    }
}
