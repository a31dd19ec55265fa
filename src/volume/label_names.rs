//! Tables of names and colours of labels: those of ITK-SNAP, 3D Slicer and FreeSurfer, and CSV.

use std::collections::BTreeMap;
use std::io;
use std::path::Path;

use super::{LabelPreset, MOST_LABELS, Volume, VolumeError, is_background};
use relume_base::input;

/// Built-in tables, by name.
pub const BUILT_IN_NAMES: [&str; 2] = ["freesurfer", "totalsegmentator"];
const TABLES: [&str; 2] =
    [include_str!("../../data/labels/freesurfer.txt"), include_str!("../../data/labels/totalsegmentator.csv")];
/// Longest table in bytes: a long line for each of the most labels.
const LONGEST: u64 = 1 << 25;

/// Words for the columns of a CSV.
const NUMBER: [&str; 8] = ["label", "labelvalue", "label_value", "index", "id", "value", "labelid", "label_id"];
const NAME: [&str; 7] = ["name", "structure", "label_name", "labelname", "region", "description", "class"];
const COLOUR: [&str; 4] = ["color", "colour", "hex", "color_hex"];
const CHANNELS: [[&str; 3]; 3] = [["r", "red", "color_r"], ["g", "green", "color_g"], ["b", "blue", "color_b"]];

/// Whether `path` is the name of a built-in table.
#[must_use]
pub fn is_built_in(path: &Path) -> bool {
    BUILT_IN_NAMES.iter().any(|name| is_called(path, name))
}

/// Comparison of `path` with a name, in letters of any case.
fn is_called(path: &Path, name: &str) -> bool {
    path.to_str().is_some_and(|path| path.eq_ignore_ascii_case(name))
}

/// Names and colours of labels of the table `path`, or of a built-in one of this name, ascending by their numbers.
///
/// # Errors
///
/// [`VolumeError::Open`]; [`VolumeError::Layout`] without such a table; [`VolumeError::Header`] with the line.
pub fn label_names(path: &Path) -> Result<Vec<LabelPreset>, VolumeError> {
    let built_in = BUILT_IN_NAMES.iter().zip(TABLES).find(|(name, _)| is_called(path, name));
    if let Some((_, text)) = built_in {
        return parse(path, text);
    }
    let bytes = input::read(path, LONGEST).map_err(|source| match source.kind() {
        io::ErrorKind::NotFound => VolumeError::Layout {
            source_name: path.display().to_string(),
            problem: format!("there is no such table of label names; {} are built in", BUILT_IN_NAMES.join(" and ")),
        },
        _ => VolumeError::Open { path: path.to_owned(), source },
    })?;
    parse(path, &decoded(&bytes))
}

/// A text in UTF-8, or else in Latin-1.
fn decoded(bytes: &[u8]) -> String {
    let text = std::str::from_utf8(bytes);
    text.map_or_else(|_| bytes.iter().copied().map(char::from).collect(), str::to_owned)
}

/// The labels of a table.
fn parse(path: &Path, text: &str) -> Result<Vec<LabelPreset>, VolumeError> {
    let refuse = |line: usize, problem: String| VolumeError::Header { path: path.to_owned(), line, problem };
    let lines = text.trim_start_matches('\u{feff}').lines().enumerate().map(|(index, line)| (index + 1, line.trim()));
    let lines: Vec<(usize, &str)> = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#')).collect();
    let Some(&(_, first)) = lines.first() else {
        return Err(refuse(1, "the table of label names has no line with a label".to_owned()));
    };
    let separator = [',', '\t', ';'].into_iter().find(|&separator| fields(first, separator).len() > 1);
    let mut found: BTreeMap<i64, (usize, LabelPreset)> = BTreeMap::new();
    let columns = separator.map(|separator| Columns::of(&fields(first, separator)));
    for (at, &(line, text)) in lines.iter().enumerate() {
        let preset = match (separator, &columns) {
            (Some(_), Some(Some(_))) if at == 0 => continue,
            (Some(separator), Some(columns)) => {
                let columns = columns.clone().unwrap_or_default();
                columns.preset(&fields(text, separator))
            }
            _ => of_words(text),
        };
        let preset = preset.ok_or_else(|| {
            let problem = "expected a label: its number, its name and perhaps its colour, as in \"17 Left-Hippocampus 220 216 20 0\" \
                           (FreeSurfer, 3D Slicer), '1 255 0 0 1 1 1 \"tumour\"' (ITK-SNAP) or \"1,tumour\" (CSV, perhaps with a line \
                           of column names: label, name, r, g, b, color)";
            refuse(line, format!("{problem}; found {:?}", text.chars().take(80).collect::<String>()))
        })?;
        match found.get(&preset.value) {
            Some((before, other)) if *other != preset => {
                return Err(refuse(
                    line,
                    format!("label {} has another name or colour in line {before}", preset.value),
                ));
            }
            _ => drop(found.insert(preset.value, (line, preset))),
        }
    }
    if found.is_empty() {
        return Err(refuse(1, "the table of label names has column names and no label".to_owned()));
    }
    Ok(found.into_values().map(|(_, preset)| preset).collect())
}

/// Parts of a line between separators; quotes protect them.
fn fields(line: &str, separator: char) -> Vec<String> {
    let (mut all, mut field, mut is_quoted) = (Vec::new(), String::new(), false);
    let mut letters = line.chars().peekable();
    while let Some(letter) = letters.next() {
        match letter {
            '"' if is_quoted && letters.peek() == Some(&'"') => field.extend(letters.next()),
            '"' => is_quoted = !is_quoted,
            letter if letter == separator && !is_quoted => all.push(std::mem::take(&mut field).trim().to_owned()),
            letter => field.push(letter),
        }
    }
    all.push(field.trim().to_owned());
    all
}

/// A whole number, also as spreadsheets write it.
fn number(text: &str) -> Option<i64> {
    text.parse().ok().or_else(|| text.strip_suffix(".0")?.parse().ok())
}

/// Code values of red, green and blue, from 0 to 1: all of them from 0 to 255, or with a point from 0 to 1.
fn colour(parts: [&str; 3]) -> Option<[f64; 3]> {
    let numbers = parts.map(str::parse::<f64>);
    let [Ok(red), Ok(green), Ok(blue)] = numbers else { return None };
    let numbers = [red, green, blue];
    let scale = if parts.iter().any(|part| part.contains('.')) && numbers.iter().all(|&part| part <= 1.0) {
        1.0
    } else {
        255.0
    };
    numbers.iter().all(|part| (0.0..=scale).contains(part)).then(|| numbers.map(|part| part / scale))
}

/// `#rrggbb`, with or without the sign.
fn hexadecimal(text: &str) -> Option<[f64; 3]> {
    let digits = text.strip_prefix('#').unwrap_or(text);
    let part = |index: usize| u8::from_str_radix(digits.get(2 * index..2 * index + 2)?, 16).ok();
    let parts = [part(0)?, part(1)?, part(2)?];
    (digits.len() == 6 || digits.len() == 8).then(|| parts.map(|part| f64::from(part) / 255.0))
}

/// The label of a line of words: number, name, red, green, blue, alpha (FreeSurfer, 3D Slicer), or number, red, green, blue, alpha,
/// two switches and a name in quotes (ITK-SNAP).
fn of_words(line: &str) -> Option<LabelPreset> {
    let (first, rest) = line.split_once(char::is_whitespace)?;
    let (value, rest) = (number(first)?, rest.trim());
    if let Some(unquoted) = rest.strip_suffix('"') {
        let (numbers, name) = unquoted.split_once('"')?;
        let numbers: Vec<&str> = numbers.split_whitespace().collect();
        let colour = numbers.get(..3).map(|parts| colour([parts[0], parts[1], parts[2]]));
        // A colour that is none is an error.
        return match (colour, numbers.len()) {
            (None, 0) => Some(LabelPreset { value, name: name.to_owned(), colour: None }),
            (Some(Some(colour)), _) => Some(LabelPreset { value, name: name.to_owned(), colour: Some(colour) }),
            _ => None,
        };
    }
    let words: Vec<&str> = rest.split_whitespace().collect();
    let numbers = words.iter().rev().take_while(|word| word.parse::<f64>().is_ok()).count();
    // Names may have spaces and end with a number; four numbers are a colour and its opacity, three a colour.
    let of_colour = if numbers >= 4 && words.len() > 4 {
        4
    } else if numbers >= 3 && words.len() > 3 {
        3
    } else {
        0
    };
    let (name, of_colour) = words.split_at(words.len() - of_colour);
    let colour = match of_colour {
        [red, green, blue, ..] => Some(colour([red, green, blue])?),
        _ => None,
    };
    let name = name.join(" ").trim_matches('"').to_owned();
    (!name.is_empty()).then_some(LabelPreset { value, name, colour })
}

/// Columns of a CSV.
#[derive(Clone, Debug)]
struct Columns {
    number: usize,
    name: usize,
    channels: Option<[usize; 3]>,
    colour: Option<usize>,
}

impl Default for Columns {
    /// Those of a CSV without column names.
    fn default() -> Self {
        Self { number: 0, name: 1, channels: Some([2, 3, 4]), colour: Some(2) }
    }
}

impl Columns {
    /// The columns of a line of column names; `None` if it has none.
    fn of(names: &[String]) -> Option<Self> {
        let lower: Vec<String> = names.iter().map(|name| name.to_lowercase().replace([' ', '-'], "_")).collect();
        let find = |words: &[&str]| words.iter().find_map(|word| lower.iter().position(|name| name == word));
        let name = find(&NAME);
        let number = find(&NUMBER);
        let channels = CHANNELS.map(|words| find(&words));
        let channels = match channels {
            [Some(red), Some(green), Some(blue)] => Some([red, green, blue]),
            _ => None,
        };
        match (number, name) {
            (Some(number), Some(name)) => Some(Self { number, name, channels, colour: find(&COLOUR) }),
            // "id,label": the other one is the name.
            (Some(number), None) if lower.iter().filter(|name| NUMBER.contains(&name.as_str())).count() > 1 => {
                let label = lower.iter().position(|name| name == "label")?;
                let number =
                    lower.iter().position(|name| name != "label" && NUMBER.contains(&name.as_str())).unwrap_or(number);
                Some(Self { number, name: label, channels, colour: find(&COLOUR) })
            }
            _ => None,
        }
    }

    fn preset(&self, fields: &[String]) -> Option<LabelPreset> {
        let field = |index: usize| fields.get(index).map(String::as_str).filter(|text| !text.is_empty());
        let value = number(field(self.number)?)?;
        let name = field(self.name)?.to_owned();
        let by_channels =
            self.channels.and_then(|[red, green, blue]| colour([field(red)?, field(green)?, field(blue)?]));
        let colour = by_channels.or_else(|| hexadecimal(field(self.colour?)?));
        Some(LabelPreset { value, name, colour })
    }
}

/// `presets` with the names of `table`, and its colours where it states them.
fn renamed(presets: &[LabelPreset], table: Vec<LabelPreset>) -> Vec<LabelPreset> {
    let mut all: BTreeMap<i64, LabelPreset> = presets.iter().map(|preset| (preset.value, preset.clone())).collect();
    for preset in table {
        let before = all.get(&preset.value).and_then(|before| before.colour);
        all.insert(preset.value, LabelPreset { colour: preset.colour.or(before), ..preset });
    }
    all.into_values().collect()
}

impl Volume {
    /// Names and colours of labels of the table `path`, or of a built-in one of this name, in place of those of the file.
    ///
    /// # Errors
    ///
    /// As [`label_names`].
    pub fn name_labels(&mut self, path: &Path) -> Result<(), VolumeError> {
        let mut table = label_names(path)?;
        let counts = self.label_counts(MOST_LABELS + 1);
        if let Ok(counts) = &counts {
            let is_named = |label: &&i64| table.binary_search_by_key(*label, |preset| preset.value).is_ok();
            let labels = counts.keys().filter(|&&label| !is_background(label, counts));
            let unnamed: Vec<i64> = labels.clone().filter(|label| !is_named(label)).copied().collect();
            let listed: Vec<String> = unnamed.iter().take(8).map(i64::to_string).collect();
            let more = if unnamed.len() > 8 { format!(" and {} more", unnamed.len() - 8) } else { String::new() };
            if !unnamed.is_empty() {
                self.notes.push(format!(
                    "{}: no name in {} for {} of {} labels: {}{more}",
                    self.source,
                    path.display(),
                    unnamed.len(),
                    labels.count(),
                    listed.join(", ")
                ));
            }
        }
        if let Ok(counts) = &counts {
            table.retain(|preset| counts.contains_key(&preset.value));
        }
        self.presets.labels = renamed(&self.presets.labels, table);
        if !is_built_in(path) {
            self.files.push(path.to_owned());
        }
        Ok(())
    }
}

#[cfg(test)]
#[expect(clippy::unwrap_used, reason = "a test fails by panicking")]
mod tests {
    use super::*;

    fn read(text: &str) -> Vec<(i64, String, Option<[u32; 3]>)> {
        let code = |part: f64| relume_base::number::unsigned(relume_base::number::whole((255.0 * part).round()));
        let presets = parse(Path::new("t"), text).unwrap();
        presets.into_iter().map(|it| (it.value, it.name, it.colour.map(|parts| parts.map(code)))).collect()
    }

    #[test]
    fn tables_of_several_programs_name_and_colour_the_same_labels() {
        let wanted =
            vec![(3, "left lung".to_owned(), Some([10, 200, 51])), (70_001, "rib-12".to_owned(), Some([0, 0, 255]))];
        for text in [
            "# ITK-SnAP Label Description File\n3 10 200 51 1 1 1 \"left lung\"\r\n70001 0 0 255 0.5 0 1 \"rib-12\"\r\n",
            "# Slicer\n3 left lung 10 200 51 255\n70001 rib-12 0 0 255 255\n",
            "#No. Label Name:   R G B A\n\n3   left lung    10 200 51 0\n70001  rib-12 0 0 255 0\n",
            "label,name,r,g,b\n3,\"left lung\",10,200,51\n70001,rib-12,0,0,255\n",
            "\u{feff}index\tname\tabbreviation\tcolor\n3\tleft lung\tLL\t#0ac833\n70001\trib-12\tR12\t#0000FF\n",
            "LabelValue,Name,Color_R,Color_G,Color_B,Color_A\n3,left lung,10,200,51,255\n70001,rib-12,0,0,255,255\n",
            "70001;rib-12;0;0;255\n3;left lung;10;200;51\n",
            "name,id,colour\nleft lung,3,0ac833\nrib-12,70001,0000ff\n",
        ] {
            assert_eq!(read(text), wanted, "{text}");
        }
        assert_eq!(read("label,name\n1,\"a, \"\"b\"\"\"\n"), [(1, "a, \"b\"".to_owned(), None)]);
        assert_eq!(read("id,label\n4,caudate\n"), [(4, "caudate".to_owned(), None)]);
        assert_eq!(read("1 tumour 2\n"), [(1, "tumour 2".to_owned(), None)], "a name may end with a number");
    }

    #[test]
    fn a_line_that_is_no_label_is_named() {
        let problem = |text: &str| parse(Path::new("names.txt"), text).unwrap_err().to_string();
        for (text, words) in [
            ("1,one\n2\n", "line 2"),
            ("one 1 2 3\n", "line 1"),
            ("# nothing\n", "no line with a label"),
            ("label,name\n", "no label"),
            ("5 a 1 2 3 0\n\n5 b 1 2 3 0\n", "line 3: label 5 has another name or colour in line 1"),
            ("1 one 300 0 0 255\n", "line 1"),
        ] {
            let problem = problem(text);
            assert!(problem.contains("names.txt") && problem.contains(words), "{text:?}: {problem}");
        }
    }

    #[test]
    fn built_in_numberings_have_their_published_names() {
        let names = |name: &str| label_names(Path::new(name)).unwrap();
        let of = |all: &[LabelPreset], value: i64| all.iter().find(|it| it.value == value).unwrap().clone();
        let brain = names("freesurfer");
        for (value, name) in [
            (17, "Left-Hippocampus"),
            (54, "Right-Amygdala"),
            (1035, "ctx-lh-insula"),
            (2022, "ctx-rh-postcentral"),
            (3024, "wm-lh-precentral"),
            (11_146, "ctx_lh_S_central"),
            (14_175, "wm_rh_S_temporal_transverse"),
        ] {
            let found = of(&brain, value);
            assert_eq!(found.name, name);
            assert!(found.colour.is_some(), "{name}");
        }
        // Hemispheres and white matter repeat names and colours, the latter as complement in wmparc.
        let tail = |name: &str| name.splitn(3, ['-', '_']).nth(2).unwrap_or_default().to_owned();
        let pairs = (1000..=1035).flat_map(|at| [(at, at + 1000, false), (at, at + 2000, true), (at, at + 3000, true)]);
        let others = (11_101..=11_175).flat_map(|at| [1000, 2000, 3000].map(|more| (at, at + more, false)));
        for (one, other, is_complement) in pairs.chain(others) {
            let (one, other) = (of(&brain, one), of(&brain, other));
            let expected = one.colour.unwrap().map(|part| if is_complement { 1.0 - part } else { part });
            let difference = expected.iter().zip(other.colour.unwrap()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(difference < 1e-9 && tail(&one.name) == tail(&other.name), "{} {}", one.name, other.name);
        }
        // One changed digit or letter changes the sum.
        let code = |part: f64| i64::try_from(relume_base::number::whole((255.0 * part).round())).unwrap();
        let letters = |name: &str| name.bytes().map(i64::from).sum::<i64>();
        let sum: i64 = brain
            .iter()
            .map(|it| {
                let [red, green, blue] = it.colour.unwrap().map(code);
                it.value * (red + 2 * green + 3 * blue + 5 * letters(&it.name))
            })
            .sum();
        assert_eq!((brain.len(), sum), (507, 52838797956));
        let body = names("totalsegmentator");
        assert_eq!((body.len(), body[0].value, body[116].value), (117, 1, 117));
        let weighted = |name: &str| name.bytes().zip(1..).map(|(letter, at)| at * i64::from(letter)).sum::<i64>();
        assert_eq!(body.iter().map(|it| it.value * weighted(&it.name)).sum::<i64>(), 74480055);
        for (value, name) in
            [(5, "liver"), (25, "sacrum"), (43, "vertebrae_T1"), (52, "aorta"), (91, "skull"), (115, "rib_right_12")]
        {
            assert_eq!(of(&body, value).name, name);
        }
    }
}
