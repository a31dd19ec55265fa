//! Reading of film files, with every value checked before use.

use std::collections::HashMap;
use std::io::{BufReader, Cursor, Read, Seek};
use std::path::Path;

use ::exr::block::reader::{ChunksReader, Reader};
use ::exr::block::{self, UncompressedBlock};
use ::exr::error::Error as ExrError;
use ::exr::math::Vec2;
use ::exr::meta::attribute::{AttributeValue, SampleType};
use ::exr::meta::header::Header;
use ::exr::prelude::f16;

use super::rules::{check_cloud, check_planes};
use super::text::{self, ModelDraft};
use super::{
    ATTRIBUTE, BANDS, CLOUD, COEFFICIENTS, Components, FRAME, FilmFile, OutputError, Stored, UNSEEN,
    UNSEEN_COEFFICIENTS, channel_names, coefficient_names, has_coefficients,
};
use crate::output::channels;
use crate::output::picture::check_size;
use relume_base::input;
use relume_colour::model::ColourModel;
use relume_colour::spectrum::Spectrum;

/// Largest expansion of any OpenEXR compression (zlib's limit is 1032).
const LARGEST_EXPANSION: u64 = 1100;

/// Longest accepted text in bytes, enough for hundreds of spectra. The parser takes a hundred times as much memory.
const LONGEST_TEXT: usize = 1 << 19;

/// Names of a part and of its channel.
type PartNames = (&'static str, &'static str);

/// Expected part of the file.
struct Wanted {
    /// Index of the part.
    part: usize,
    /// Suffix of channel names in messages.
    place: String,
    /// Width and height in pixels.
    size: Vec2<usize>,
    /// Names of the planes.
    names: Vec<String>,
    /// Plane of each channel of the file.
    planes: Vec<usize>,
    /// Consecutive planes; values that no block of the file holds stay NaN.
    data: Vec<f32>,
}

impl FilmFile {
    /// Reads the film file described in [the parent module](super).
    ///
    /// Allocates memory for pixels only after the file is known to be long enough to hold them.
    ///
    /// # Errors
    ///
    /// [`OutputError::Read`] if the file cannot be opened or read; [`OutputError::Damaged`] if it is not a complete
    /// OpenEXR file; [`OutputError::NotAccumulators`] if its parts and channels are not those of a film file;
    /// [`OutputError::Attribute`] if its text is invalid.
    pub fn read(path: &Path) -> Result<Self, OutputError> {
        let unreadable = |source| OutputError::Read { path: path.to_owned(), source };
        let file = input::open(path).map_err(unreadable)?;
        let length = file.metadata().map_err(unreadable)?.len();
        Self::read_from(BufReader::new(file), length, path)
    }

    /// Reads the film file of these `bytes`; messages call it `name`.
    ///
    /// # Errors
    ///
    /// Those of [`Self::read`].
    pub fn from_bytes(bytes: &[u8], name: &str) -> Result<Self, OutputError> {
        Self::read_from(Cursor::new(bytes), bytes.len() as u64, Path::new(name))
    }

    /// Reads a film file of `file_bytes` bytes; messages name `path`.
    fn read_from(file: impl Read + Seek, file_bytes: u64, path: &Path) -> Result<Self, OutputError> {
        let damaged = |error| match error {
            ExrError::Io(source) => OutputError::Read { path: path.to_owned(), source },
            ExrError::Invalid(detail) | ExrError::NotSupported(detail) => {
                OutputError::Damaged { path: path.to_owned(), detail: detail.into_owned() }
            }
            ExrError::Aborted => OutputError::Damaged { path: path.to_owned(), detail: "stopped".to_owned() },
        };
        let too_long = |detail| OutputError::Damaged { path: path.to_owned(), detail };
        let foreign = |detail| OutputError::NotAccumulators { path: path.to_owned(), detail };
        let wrong_text = |detail| OutputError::Attribute { path: path.to_owned(), detail };

        let reader = block::read(file, false).map_err(damaged)?;
        let headers = reader.headers();
        let (part, text) = picture_part(headers).map_err(foreign)?;
        let (mut this, model) = text::parse(&text).map_err(wrong_text)?;
        let frame = text_of(&headers[part], FRAME).map_err(foreign)?;
        this.frame = frame.as_deref().map(text::parse_frame).transpose().map_err(wrong_text)?;
        Vec2(this.width, this.height) = headers[part].layer_size;
        check_size(this.width, this.height)?;
        let names = match &model {
            None => this.channel_names(),
            Some(model) => channel_names(&this.positions, &coefficient_names(model.projection.len()), model.coloured),
        };
        this.check_lists(&names).map_err(wrong_text)?;
        let mut wanted = vec![Wanted::new(headers, part, String::new(), names).map_err(foreign)?];
        if let Some(model) = &model {
            wanted.extend(parts_of(model, headers).map_err(foreign)?);
        }
        if wanted.len() < headers.len() {
            let all = headers.len();
            return Err(foreign(format!("it has {all} parts, and {} belong to a film", wanted.len())));
        }
        allocate(&mut wanted, headers, file_bytes).map_err(too_long)?;
        read_blocks(reader, &mut wanted).map_err(damaged)?;
        for part in &wanted {
            part.check().map_err(foreign)?;
        }

        let mut parts = wanted.into_iter().map(|part| part.data);
        let mut numbers = parts.next().unwrap_or_default();
        if let Some(model) = model {
            this.components = Components::Model(model.stored(parts).map_err(wrong_text)?);
        }
        this.transmittance = numbers.split_off(numbers.len() - this.transmittance_numbers() * this.width * this.height);
        this.accumulators = numbers;
        Ok(this)
    }
}

impl Wanted {
    /// Expects part number `part` to have the channels `names` and no others.
    fn new(headers: &[Header], part: usize, place: String, names: Vec<String>) -> Result<Self, String> {
        let header = &headers[part];
        if header.deep {
            return Err("it is a deep picture".to_owned());
        }
        let mut missing: HashMap<&str, usize> =
            names.iter().enumerate().map(|(plane, name)| (&**name, plane)).collect();
        let mut planes = Vec::new();
        for channel in &header.channels.list {
            let name = String::from_utf8_lossy(channel.name.as_slice());
            let Some(plane) = missing.remove(&*name) else {
                let owner = if place.is_empty() { "matches no position and component" } else { "is unknown" };
                return Err(format!("its channel {name:?}{place} {owner}, or occurs twice"));
            };
            if channel.sampling != Vec2(1, 1) {
                return Err(format!("its channel {name:?}{place} is subsampled"));
            }
            if channel.sample_type == SampleType::U32 {
                return Err(format!("its channel {name:?}{place} holds integers, not floating-point numbers"));
            }
            planes.push(plane);
        }
        if let Some((name, _)) = missing.into_iter().min_by_key(|&(_, plane)| plane) {
            return Err(format!("the channel {name:?}{place} is missing"));
        }
        Ok(Self { part, place, size: header.layer_size, names, planes, data: Vec::new() })
    }

    /// Checks that every value is present and finite.
    fn check(&self) -> Result<(), String> {
        let pixels = self.size.0 * self.size.1;
        check_planes(&self.names, self.data.chunks_exact(pixels), self.size.0, &self.place)
    }

    /// Copies a decoded block into the planes of its channels.
    fn copy(&mut self, header: &Header, block: &UncompressedBlock) -> Result<(), ExrError> {
        let Vec2(width, height) = self.size;
        for line in block.lines(&header.channels) {
            let (Vec2(x, y), channel) = (line.location.position, line.location.channel);
            let begin = (self.planes[channel] * height + y) * width + x;
            let Some(row) = self.data.get_mut(begin..begin + line.location.sample_count) else {
                return Err(ExrError::Invalid("a block lies outside the picture".into()));
            };
            match header.channels.list[channel].sample_type {
                SampleType::F32 => line.read_samples_into_slice(row)?,
                SampleType::F16 => {
                    for (value, sample) in row.iter_mut().zip(line.read_samples::<f16>()) {
                        *value = sample?.to_f32();
                    }
                }
                SampleType::U32 => return Err(ExrError::Invalid("a channel holds integers".into())),
            }
        }
        Ok(())
    }
}

/// The text of the attribute `name` of a part; `None` if it has no such attribute.
fn text_of(header: &Header, name: &str) -> Result<Option<String>, String> {
    match header.own_attributes.other.get(&channels::text(name)) {
        Some(AttributeValue::Text(text)) if text.as_slice().len() > LONGEST_TEXT => {
            let length = text.as_slice().len();
            Err(format!("the attribute `{name}` has {length} bytes; the limit is {LONGEST_TEXT}"))
        }
        Some(AttributeValue::Text(text)) => match String::from_utf8(text.as_slice().to_vec()) {
            Ok(text) => Ok(Some(text)),
            Err(error) => Err(format!("the attribute `{name}` is not UTF-8: {error}")),
        },
        Some(_) => Err(format!("the attribute `{name}` is not a string")),
        None => Ok(None),
    }
}

/// Finds the part of the picture, and the text of its attribute.
fn picture_part(headers: &[Header]) -> Result<(usize, String), String> {
    let found =
        headers.iter().enumerate().find_map(|(part, header)| Some((part, text_of(header, ATTRIBUTE).transpose()?)));
    let (part, text) = found.ok_or_else(|| format!("it has no attribute `{ATTRIBUTE}`"))?;
    Ok((part, text?))
}

/// Finds the parts with the spectra in and outside the fit of a model, and with their coefficients.
fn parts_of(model: &ModelDraft, headers: &[Header]) -> Result<Vec<Wanted>, String> {
    let find = |(name, channel): (&'static str, &str), width| {
        let is_it = |header: &Header| header.own_attributes.layer_name == Some(channels::text(name));
        let part = headers.iter().position(is_it).ok_or_else(|| format!("the part {name:?} is missing"))?;
        let place = format!(" of the part {name:?}");
        let wanted = Wanted::new(headers, part, place, vec![channel.to_owned()])?;
        let Vec2(found, spectra) = wanted.size;
        if found != width {
            return Err(format!("its part {name:?} is {found} pixels wide, not {width}"));
        }
        check_cloud(spectra)?;
        Ok(wanted)
    };
    let mut parts = Vec::new();
    for (of_spectra, of_vectors) in model.tables() {
        let spectra = find(*of_spectra, BANDS)?;
        if has_coefficients(model.kind) {
            let vectors = find(*of_vectors, model.projection.len())?;
            let (rows, of_vectors) = ((spectra.size.1, vectors.size.1), of_vectors.0);
            if rows.0 != rows.1 {
                let part = of_spectra.0;
                return Err(format!("its part {part} has {} spectra, and {of_vectors} has {} rows", rows.0, rows.1));
            }
            parts.extend([spectra, vectors]);
        } else {
            parts.push(spectra);
        }
    }
    Ok(parts)
}

/// Allocates all planes if the file is long enough to hold them.
fn allocate(wanted: &mut [Wanted], headers: &[Header], file_bytes: u64) -> Result<(), String> {
    let bytes = |part: &Wanted| {
        let pixels = (part.size.0 as u64).saturating_mul(part.size.1 as u64);
        (headers[part.part].channels.bytes_per_pixel as u64).saturating_mul(pixels)
    };
    let promised = wanted.iter().map(bytes).fold(0, u64::saturating_add);
    if promised > file_bytes.saturating_mul(LARGEST_EXPANSION) {
        return Err(format!("it has {file_bytes} bytes, but its header announces {promised} bytes of pixels"));
    }
    for part in wanted {
        let values = part.names.len().saturating_mul(part.size.0).saturating_mul(part.size.1);
        if part.data.try_reserve_exact(values).is_err() {
            return Err(format!("its {values} values do not fit into memory"));
        }
        part.data.resize(values, f32::NAN);
    }
    Ok(())
}

/// Decodes the expected parts.
fn read_blocks(reader: Reader<impl Read + Seek>, wanted: &mut [Wanted]) -> Result<(), ExrError> {
    reader.filter_chunks(false, |_, tile, _| tile.is_largest_resolution_level())?.decompress_sequential(
        false,
        |meta, block| match wanted.iter_mut().find(|part| part.part == block.index.layer) {
            Some(part) => part.copy(&meta.headers[part.part], &block),
            None => Ok(()),
        },
    )
}

impl ModelDraft {
    /// Parts with spectra and with their coefficients.
    fn tables(&self) -> &'static [(PartNames, PartNames)] {
        const TABLES: [(PartNames, PartNames); 2] = [(CLOUD, COEFFICIENTS), (UNSEEN, UNSEEN_COEFFICIENTS)];
        if self.has_unseen { &TABLES } else { &TABLES[..1] }
    }

    /// Builds the model from the data of the parts found by [`parts_of`].
    fn stored(self, mut parts: impl Iterator<Item = Vec<f32>>) -> Result<Stored, String> {
        let (kind, dimension, has_unseen) = (self.kind, self.projection.len(), self.has_unseen);
        let mixed = self.mixed;
        let mut next = || {
            let spectrum = |row: &[f32]| Spectrum::from_samples(std::array::from_fn(|band| f64::from(row[band])));
            let vector = |row: &[f32]| row.iter().copied().map(f64::from).collect();
            let spectra = parts.next().unwrap_or_default().chunks_exact(BANDS).map(spectrum).collect();
            let vectors = (has_coefficients(kind).then(|| parts.next()).flatten())
                .map(|all: Vec<f32>| all.chunks_exact(dimension).map(vector).collect());
            (spectra, vectors)
        };
        let (cloud, vectors) = next();
        let mut model = ColourModel::from_parts(kind, self.projection, cloud, vectors, self.lights);
        if has_unseen {
            let (spectra, vectors) = next();
            model = model.and_then(|model| model.with_unseen(spectra, vectors, mixed));
        }
        let model = model.map_err(|error| error.to_string())?.with_observer(self.observer);
        Ok(Stored { model, coloured: self.coloured, tolerance: self.tolerance })
    }
}
