//! Text headers: lines with fields of a name and a value.

use std::collections::HashSet;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::str::FromStr;

use crate::VolumeError;
use crate::stream;

/// Largest size of a header in bytes; longer files are not headers.
const LONGEST: u64 = 4 << 20;

/// Largest number of lines of a header.
const MOST_LINES: usize = 1 << 16;

/// Largest size of a list of files in bytes; longer ones are mistakes.
const LONGEST_LIST: u64 = 32 << 20;

/// Largest number of files in a list.
const MOST_FILES: usize = 1 << 17;

/// One `name = value`.
pub(crate) struct Field {
    pub(crate) line: usize,
    pub(crate) key: String,
    pub(crate) value: String,
}

/// The fields of a header.
pub(crate) struct Fields<'a> {
    pub(crate) path: &'a Path,
    /// Separator between a name and its value, as shown in messages.
    pub(crate) sign: &'static str,
    pub(crate) all: Vec<Field>,
}

impl Fields<'_> {
    /// Returns the field of the first of `names` that occurs; of repeated fields, the last counts.
    pub(crate) fn find(&self, names: &[&str]) -> Option<&Field> {
        names.iter().find_map(|name| self.all.iter().rev().find(|field| field.key.eq_ignore_ascii_case(name)))
    }

    pub(crate) fn require(&self, names: &[&'static str; 1]) -> Result<&Field, VolumeError> {
        self.find(names).ok_or_else(|| VolumeError::MissingKey { path: self.path.to_owned(), key: names[0] })
    }

    pub(crate) fn wrong(&self, field: &Field, problem: impl Into<String>) -> VolumeError {
        VolumeError::Header { path: self.path.to_owned(), line: field.line, problem: problem.into() }
    }

    /// The error for a field that should be `what`.
    pub(crate) fn should_be(&self, field: &Field, what: &str) -> VolumeError {
        self.wrong(field, format!("{}{}{} should be {what}", field.key, self.sign, field.value))
    }

    /// Parses the numbers of a field.
    pub(crate) fn numbers<T: FromStr>(&self, field: &Field, what: &str) -> Result<Vec<T>, VolumeError> {
        let parsed = field.value.split_whitespace().map(str::parse).collect::<Result<Vec<T>, _>>();
        parsed.map_err(|_| self.should_be(field, what))
    }

    /// Parses the single number of an optional field.
    pub(crate) fn number<T: FromStr + Copy>(&self, names: &[&str], what: &str) -> Result<Option<T>, VolumeError> {
        let Some(field) = self.find(names) else { return Ok(None) };
        match self.numbers(field, what)?[..] {
            [number] => Ok(Some(number)),
            _ => Err(self.should_be(field, what)),
        }
    }

    /// Returns the lengths of all axes from the field `sizes`; the field `number` must state their count.
    pub(crate) fn axes(
        &self,
        number: &[&'static str; 1],
        sizes: &[&'static str; 1],
    ) -> Result<Vec<usize>, VolumeError> {
        let field = self.require(sizes)?;
        let lengths: Vec<i128> = self.numbers(field, "whole numbers")?;
        let stated = self.require(number)?;
        if self.number::<usize>(number, "a whole number")? != Some(lengths.len()) || lengths.is_empty() {
            return Err(self.wrong(
                field,
                format!(
                    "{}{sign}{} has {} numbers, but {}{sign}{}",
                    field.key,
                    field.value,
                    lengths.len(),
                    number[0],
                    stated.value,
                    sign = self.sign
                ),
            ));
        }
        let axes: Vec<usize> = lengths.iter().filter_map(|&n| usize::try_from(n).ok().filter(|&n| n > 0)).collect();
        if axes.len() == lengths.len() {
            return Ok(axes);
        }
        let dims = field.value.split_whitespace().collect::<Vec<_>>().join("×");
        Err(VolumeError::Dims { source_name: self.path.display().to_string(), dims })
    }

    /// Returns the fields that are not in `known`, as pairs of name and value.
    pub(crate) fn uninterpreted(&self, known: &[&[&str]]) -> Vec<(String, String)> {
        let is_known =
            |name: &str| known.iter().any(|names| names.iter().any(|known| known.eq_ignore_ascii_case(name)));
        let unknown = self.all.iter().filter(|field| !is_known(&field.key));
        unknown.map(|field| (field.key.clone(), field.value.clone())).collect()
    }

    /// Returns a note for each repeated field.
    pub(crate) fn repeated(&self) -> impl Iterator<Item = String> {
        let mut seen = HashSet::new();
        let again = self.all.iter().filter(move |field| !seen.insert(field.key.to_ascii_lowercase()));
        again.map(|field| {
            format!("{}, line {}: {} is repeated; the last value is used", self.path.display(), field.line, field.key)
        })
    }
}

/// The text of a header: UTF-8, or else Latin-1, in which every byte is a letter.
fn text(bytes: &[u8]) -> String {
    match std::str::from_utf8(bytes) {
        Ok(text) => text.to_owned(),
        Err(_) => bytes.iter().map(|&byte| char::from(byte)).collect(),
    }
}

/// Line reader of a header.
pub(crate) struct Lines<'a> {
    path: &'a Path,
    stream: std::io::Take<BufReader<std::fs::File>>,
    line: Vec<u8>,
    /// Number of the last line read, from 1.
    pub(crate) number: usize,
}

impl<'a> Lines<'a> {
    pub(crate) fn of(path: &'a Path) -> Result<Self, VolumeError> {
        let stream = BufReader::new(stream::open(path)?).take(LONGEST);
        Ok(Self { path, stream, line: Vec::new(), number: 0 })
    }

    /// Reads the next line without its line end; `None` at the end of the file.
    pub(crate) fn next(&mut self) -> Result<Option<String>, VolumeError> {
        self.line.clear();
        let read = self.stream.read_until(b'\n', &mut self.line);
        if read.map_err(|source| stream::failed(self.path, source))? == 0 {
            return Ok(None);
        }
        self.number += 1;
        if self.number > MOST_LINES {
            let problem = format!("a header has at most {MOST_LINES} lines");
            return Err(VolumeError::Header { path: self.path.to_owned(), line: self.number, problem });
        }
        Ok(Some(text(&self.line).trim_end().to_owned()))
    }

    /// The error for a line that is not of the form `form`.
    pub(crate) fn wrong(&self, line: &str, form: &str) -> VolumeError {
        let start: String = line.trim().chars().take(40).collect();
        let problem = format!("{start:?} is not {form}");
        VolumeError::Header { path: self.path.to_owned(), line: self.number, problem }
    }

    /// Number of bytes up to the end of the last line read.
    pub(crate) fn bytes(&self) -> u64 {
        LONGEST - self.stream.limit()
    }

    /// Reads the remaining non-blank lines as a list of files.
    pub(crate) fn list(self) -> Result<Vec<String>, VolumeError> {
        let mut files = Vec::new();
        for line in self.stream.into_inner().take(LONGEST_LIST).split(b'\n') {
            let line = text(&line.map_err(|source| stream::failed(self.path, source))?);
            if files.len() == MOST_FILES {
                let problem = format!("a list has at most {MOST_FILES} files");
                return Err(VolumeError::Header { path: self.path.to_owned(), line: self.number, problem });
            }
            files.extend(Some(line.trim()).filter(|line| !line.is_empty()).map(str::to_owned));
        }
        Ok(files)
    }
}
