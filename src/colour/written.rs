//! Positions in text files, suggestions for unknown words, and text in XML.

use crate::spectrum::nearest;
use relume_base::number::{in_words, line_and_column};

/// Position of a byte of `text` as `name:line:column`.
pub fn place(name: &str, text: &str, byte: usize) -> String {
    let [line, column] = line_and_column(text, byte);
    format!("{name}:{line}:{column}")
}

/// Escapes a text for XML and removes control characters other than line breaks.
pub fn escaped(text: &str) -> String {
    let plain: String = text.chars().filter(|letter| *letter == '\n' || !letter.is_control()).collect();
    plain.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// The one of `names` that is most similar to `name`, or begins as it does; `None` if none is.
pub fn similar<'a>(name: &str, names: &[&'a str]) -> Option<&'a str> {
    let begins = |it: &&&str| name.len() > 1 && (it.starts_with(name) || name.starts_with(**it));
    names.iter().find(begins).copied().or_else(|| nearest(name, names.iter().copied()))
}

/// The refusal of the name `name`: the allowed `names` of `what`, and the similar one.
pub fn refused_name(name: &str, what: &str, names: &[&str]) -> String {
    let similar = similar(name, names).map_or_else(String::new, |it| format!("; did you mean {it}?"));
    format!("{what} are {}{similar}", names.join(", "))
}

/// Adds the most similar expected word to serde's message about an unknown word; rewrites other messages by
/// [`in_words`].
pub fn with_suggestion(message: &str) -> String {
    let mut words = message.split('`').skip(1).step_by(2);
    match words.next().filter(|_| message.starts_with("unknown")).and_then(|unknown| nearest(unknown, words)) {
        Some(nearest) => format!("{message}; did you mean `{nearest}`?"),
        None => in_words(message),
    }
}
