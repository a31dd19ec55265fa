//! Attributes that tell apart the volumes of a series, and their values in a file.

use dicom_core::Tag;
use dicom_dictionary_std::tags;

use super::dataset::Item;
use relume_base::number::brief;

/// Kind of the values of an attribute.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Number,
    /// Words, whose volumes are in the order of the files.
    Text,
    /// Three numbers, whose volumes are in the order of the files.
    Direction,
    /// A time or count that may differ between the slices of one volume, and orders those at one position.
    Clock,
}

/// An attribute.
#[derive(Debug)]
pub(super) struct Key {
    pub(super) name: &'static str,
    kind: Kind,
    /// Elements that state it, the first one counts: sequences in the functional groups of a frame, and the element. Older
    /// files have the element itself.
    at: &'static [(&'static [Tag], Tag)],
}

const CONTENT: &[Tag] = &[tags::FRAME_CONTENT_SEQUENCE];
const DIFFUSION: &[Tag] = &[tags::MR_DIFFUSION_SEQUENCE];
const GRADIENT: &[Tag] = &[tags::MR_DIFFUSION_SEQUENCE, tags::DIFFUSION_GRADIENT_DIRECTION_SEQUENCE];
const FRAME_TYPES: [&[Tag]; 3] =
    [&[tags::MR_IMAGE_FRAME_TYPE_SEQUENCE], &[tags::CT_IMAGE_FRAME_TYPE_SEQUENCE], &[tags::PET_FRAME_TYPE_SEQUENCE]];
const HEART: &[Tag] = &[tags::CARDIAC_SYNCHRONIZATION_SEQUENCE];
const TIMING: &[Tag] = &[tags::MR_TIMING_AND_RELATED_PARAMETERS_SEQUENCE];

/// All attributes; an earlier one names the volumes where several tell them apart.
pub(super) const KEYS: [Key; 34] = [
    number(
        "temporal position",
        &[(CONTENT, tags::TEMPORAL_POSITION_INDEX), (CONTENT, tags::TEMPORAL_POSITION_IDENTIFIER)],
    ),
    number("acquisition", &[(CONTENT, tags::ACQUISITION_NUMBER), (CONTENT, tags::FRAME_ACQUISITION_NUMBER)]),
    number("b-value", &[(DIFFUSION, tags::DIFFUSION_B_VALUE)]),
    number("echo", &[(CONTENT, tags::ECHO_NUMBERS)]),
    clock("trigger time", &[(HEART, tags::NOMINAL_CARDIAC_TRIGGER_DELAY_TIME), (CONTENT, tags::TRIGGER_TIME)]),
    number("echo time", &[(&[tags::MR_ECHO_SEQUENCE], tags::EFFECTIVE_ECHO_TIME), (&[], tags::ECHO_TIME)]),
    number("inversion time", &[(&[tags::MR_MODIFIER_SEQUENCE], tags::INVERSION_TIMES), (&[], tags::INVERSION_TIME)]),
    number("repetition time", &[(TIMING, tags::REPETITION_TIME)]),
    number("flip angle", &[(TIMING, tags::FLIP_ANGLE)]),
    text("complex component", &[(FRAME_TYPES[0], tags::COMPLEX_IMAGE_COMPONENT)]),
    text(
        "image type",
        &[
            (FRAME_TYPES[0], tags::FRAME_TYPE),
            (FRAME_TYPES[1], tags::FRAME_TYPE),
            (FRAME_TYPES[2], tags::FRAME_TYPE),
            (&[], tags::IMAGE_TYPE),
        ],
    ),
    Key { name: "gradient direction", kind: Kind::Direction, at: &[(GRADIENT, tags::DIFFUSION_GRADIENT_ORIENTATION)] },
    text("diffusion directionality", &[(DIFFUSION, tags::DIFFUSION_DIRECTIONALITY)]),
    clock("frame reference time", &[(CONTENT, tags::FRAME_REFERENCE_DATE_TIME), (&[], tags::FRAME_REFERENCE_TIME)]),
    number("energy window", &[(&[], tags::ENERGY_WINDOW_VECTOR)]),
    number("detector", &[(&[], tags::DETECTOR_VECTOR)]),
    number("phase", &[(&[], tags::PHASE_VECTOR)]),
    number("rotation", &[(&[], tags::ROTATION_VECTOR)]),
    number("R-R interval", &[(&[], tags::RR_INTERVAL_VECTOR)]),
    number("time slot", &[(&[], tags::TIME_SLOT_VECTOR)]),
    number("angular view", &[(&[], tags::ANGULAR_VIEW_VECTOR)]),
    number("time slice", &[(&[], tags::TIME_SLICE_VECTOR)]),
    number("kVp", &[(&[], tags::KVP)]),
    text("kernel", &[(&[], tags::CONVOLUTION_KERNEL)]),
    text("sequence name", &[(&[], tags::SEQUENCE_NAME)]),
    text("series description", &[(&[], tags::SERIES_DESCRIPTION)]),
    text("image comments", &[(&[], tags::IMAGE_COMMENTS)]),
    text("receive coil", &[(&[], tags::RECEIVE_COIL_NAME)]),
    text("corrections", &[(&[], tags::CORRECTED_IMAGE)]),
    text("unit", &[(&[], tags::UNITS)]),
    text("kind of values", &[(&[], tags::RESCALE_TYPE)]),
    number("slice thickness", &[(&[tags::PIXEL_MEASURES_SEQUENCE], tags::SLICE_THICKNESS)]),
    clock(
        "acquisition time",
        &[
            (CONTENT, tags::FRAME_ACQUISITION_DATE_TIME),
            (&[], tags::ACQUISITION_DATE_TIME),
            (&[], tags::ACQUISITION_TIME),
        ],
    ),
    clock("image index", &[(&[], tags::IMAGE_INDEX)]),
];

/// Largest number of dimensions of a file that are attributes.
pub(super) const MOST_DIMENSIONS: usize = 16;

/// Number of all attributes: of the list, and dimensions that a file itself defines.
pub(super) const COUNT: usize = KEYS.len() + MOST_DIMENSIONS;

const fn number(name: &'static str, at: &'static [(&'static [Tag], Tag)]) -> Key {
    Key { name, kind: Kind::Number, at }
}

const fn text(name: &'static str, at: &'static [(&'static [Tag], Tag)]) -> Key {
    Key { name, kind: Kind::Text, at }
}

const fn clock(name: &'static str, at: &'static [(&'static [Tag], Tag)]) -> Key {
    Key { name, kind: Kind::Clock, at }
}

/// Whether the attribute `key` orders the slices at one position, though it may differ between those of a volume.
pub(super) fn is_clock(key: usize) -> bool {
    KEYS.get(key).is_some_and(|key| key.kind == Kind::Clock)
}

/// Value of an attribute.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Mark {
    /// Index in [`KEYS`]; the dimensions of a file follow.
    pub(super) key: usize,
    pub(super) name: String,
    /// Place in the order of the values; NaN for words and directions.
    pub(super) at: f64,
}

/// The attributes in the functional groups of a frame or of all frames.
pub(super) fn of_groups(groups: &Item) -> Vec<Mark> {
    let mut marks = marks(|path, tag| {
        let (&first, rest) = path.split_first()?;
        let holder =
            rest.iter().try_fold(groups.items(first).first()?, |item, &sequence| item.items(sequence).first())?;
        Some((holder, tag))
    });
    let indices = groups.items(tags::FRAME_CONTENT_SEQUENCE).first();
    let indices = indices.map_or(&[][..], |content| content.numbers(tags::DIMENSION_INDEX_VALUES));
    let dimension = |(index, &at): (usize, &f64)| Mark { key: KEYS.len() + index, name: brief(at), at };
    marks.extend(indices.iter().enumerate().take(MOST_DIMENSIONS).map(dimension));
    marks
}

/// The attributes in the elements of a file itself.
pub(super) fn of_file(root: &Item) -> Vec<Mark> {
    let is_vector = |tag: Tag| VECTORS.contains(&tag);
    let mut marks = marks(|_, tag| (!is_vector(tag)).then_some((root, tag)));
    // Midnight may pass during an acquisition.
    let day = root.word(tags::ACQUISITION_DATE).and_then(|date| seconds(&format!("{date}000000")));
    for mark in &mut marks {
        if KEYS[mark.key].name == "acquisition time" && root.word(tags::ACQUISITION_DATE_TIME).is_none() {
            mark.at += day.unwrap_or(0.0);
        }
    }
    marks
}

/// Elements with a number for each frame of an old multi-frame file.
const VECTORS: [Tag; 8] = [
    tags::ENERGY_WINDOW_VECTOR,
    tags::DETECTOR_VECTOR,
    tags::PHASE_VECTOR,
    tags::ROTATION_VECTOR,
    tags::RR_INTERVAL_VECTOR,
    tags::TIME_SLOT_VECTOR,
    tags::ANGULAR_VIEW_VECTOR,
    tags::TIME_SLICE_VECTOR,
];

/// The attributes of the frame `frame` in the vectors among `pointers`.
pub(super) fn of_vectors(root: &Item, pointers: &[Tag], frame: usize) -> Vec<Mark> {
    let mark = |&tag: &Tag| {
        let key = KEYS.iter().position(|key| key.at == [(&[][..], tag)])?;
        let &at = root.numbers(tag).get(frame)?;
        VECTORS.contains(&tag).then(|| Mark { key, name: brief(at), at })
    };
    pointers.iter().filter_map(mark).collect()
}

/// The attributes that `find` finds.
fn marks<'a>(find: impl Fn(&[Tag], Tag) -> Option<(&'a Item, Tag)>) -> Vec<Mark> {
    let mark = |(index, key): (usize, &Key)| {
        let found = |&(path, tag): &(&[Tag], Tag)| {
            let (item, tag) = find(path, tag)?;
            let (name, at) = key.kind.value(item, tag)?;
            Some(Mark { key: index, name, at })
        };
        key.at.iter().find_map(found)
    };
    KEYS.iter().enumerate().filter_map(mark).collect()
}

impl Kind {
    /// Name and place of the value of the element `tag`.
    fn value(self, item: &Item, tag: Tag) -> Option<(String, f64)> {
        let numbers = item.numbers(tag);
        let number = numbers.first().copied().filter(|number| number.is_finite());
        match self {
            Self::Number => number.map(|at| (brief(at), at)),
            Self::Clock => match number {
                Some(at) => Some((at.to_string(), at)),
                None => item.word(tag).and_then(|text| seconds(&text).map(|at| (text, at))),
            },
            Self::Text => item.word(tag).map(|text| (text, f64::NAN)),
            Self::Direction => match numbers {
                &[x, y, z] if numbers.iter().all(|part| part.is_finite()) => {
                    // Rounded numbers of one direction are equal, and −0 is 0.
                    let part = |part: f64| ((part * 1e4).round() / 1e4 + 0.0).to_string();
                    Some(([x, y, z].map(part).join(" "), f64::NAN))
                }
                _ => None,
            },
        }
    }
}

/// Seconds of a time (`HHMMSS.F`, or the old `HH:MM:SS.F`) or of a date with a time (`YYYYMMDDHHMMSS.F&ZZXX`), from some beginning; a
/// month counts as 31 days, which keeps their order.
fn seconds(text: &str) -> Option<f64> {
    let text = text.trim().replace(':', "");
    // Not the zone, which is that of all frames of a file.
    let text = text.split(['+', '-', '&']).next().unwrap_or_default();
    let (digits, part) = text.split_once('.').unwrap_or((text, ""));
    if digits.is_empty() || !digits.bytes().chain(part.bytes()).all(|byte| byte.is_ascii_digit()) {
        return None;
    }
    let (date, time) = if digits.len() >= 8 { digits.split_at(8) } else { ("", digits) };
    let two = |text: &str, at: usize| text.get(at..at + 2).and_then(|two| two.parse::<f64>().ok()).unwrap_or(0.0);
    let days = match date.get(..4).and_then(|year| year.parse::<f64>().ok()) {
        Some(year) => (year * 12.0 + two(date, 4)) * 31.0 + two(date, 6),
        None => 0.0,
    };
    let fraction = if part.is_empty() { 0.0 } else { format!("0.{part}").parse().unwrap_or(0.0) };
    Some(((days * 24.0 + two(time, 0)) * 60.0 + two(time, 2)) * 60.0 + two(time, 4) + fraction)
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
    use super::*;

    #[test]
    fn times_and_dates_are_in_order_and_words_are_none() {
        let all = ["095959.5", "10:00:00", "100000.25", "235959", "20200131235959", "20200201000000.5+0100"];
        let all: Vec<f64> = all.iter().map(|text| seconds(text).unwrap()).collect();
        assert!(all.is_sorted_by(|one, next| one < next), "{all:?}");
        assert!((all[2] - all[1] - 0.25).abs() < 1e-9, "{all:?}");
        assert_eq!([seconds(""), seconds("noon"), seconds("10.x")], [None; 3]);
    }

    #[test]
    fn vectors_are_attributes() {
        for tag in VECTORS {
            assert!(KEYS.iter().any(|key| key.at == [(&[][..], tag)]), "{tag}");
        }
    }
}
