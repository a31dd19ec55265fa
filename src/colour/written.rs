//! Lists of a stated length, positions in text files, suggestions for unknown words, and text in XML.

use std::fmt;
use std::marker::PhantomData;

use serde::de::{Error as _, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use toml::Spanned;

use crate::spectrum::nearest;
use relume_base::number::{in_words, line_and_column};

/// A key that may be stated.
pub type Stated<T, E> = Result<Option<Spanned<T>>, E>;

/// A list of exactly `N`: a reader of TOML into an array leaves out what is too much.
#[derive(Debug)]
pub struct List<T, const N: usize>(pub [T; N]);

impl<'de, T: Deserialize<'de>, const N: usize> Deserialize<'de> for List<T, N> {
    fn deserialize<D: Deserializer<'de>>(stated: D) -> Result<Self, D::Error> {
        struct Of<T, const N: usize>(PhantomData<T>);
        impl<'de, T: Deserialize<'de>, const N: usize> Visitor<'de> for Of<T, N> {
            type Value = List<T, N>;

            fn expecting(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(to, "an array of length {N}")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Self::Value, A::Error> {
                let mut found = Vec::with_capacity(N);
                while let Some(element) = list.next_element()? {
                    found.push(element);
                }
                let length = found.len();
                found.try_into().map(List).map_err(|_| A::Error::invalid_length(length, &self))
            }
        }
        stated.deserialize_tuple(N, Of(PhantomData))
    }
}

/// `of` a value, at its place.
pub fn at<T, U>(stated: Spanned<T>, of: impl FnOnce(T) -> U) -> Spanned<U> {
    let place = stated.span();
    Spanned::new(place, of(stated.into_inner()))
}

/// `N` numbers at their place.
///
/// # Errors
///
/// Those of the deserializer, and another number of them.
pub fn stated_numbers<'de, D: Deserializer<'de>, const N: usize>(stated: D) -> Result<Spanned<[f64; N]>, D::Error> {
    Spanned::<List<f64, N>>::deserialize(stated).map(|stated| at(stated, |list| list.0))
}

/// [`stated_numbers`] of a key that may be left out.
///
/// # Errors
///
/// As there.
pub fn numbers<'de, D: Deserializer<'de>, const N: usize>(stated: D) -> Stated<[f64; N], D::Error> {
    stated_numbers(stated).map(Some)
}

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
