//! Pages: films as one HTML file that relights in a browser, without a server or a network.
//!
//! A page holds the accumulators of one or more views as whole numbers ([`Page::packed`] searches the coarsest ones that
//! keep a tolerance under every light of the page for both observers), the spectra of lights and components, and a script
//! that unpacks, relights and shows them. docs/theory/page.md has the encoding and its measurements.

mod check;
mod difference;
mod lights;
mod live;
mod packing;
mod text;

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use glam::DVec3;
use rayon::prelude::*;

use super::film::FilmFile;
use super::picture::check_size;
use super::{OutputError, write_atomically};
use relume_base::number::{count, rounded, whole};
use relume_base::progress::Progress;
use relume_colour::spectrum::observer::Observer;
use relume_scene::Mix;
use relume_scene::film::{Film, RelightMatrices};

use check::Found;
use lights::Lights;
pub use live::{Live, Numbers, PackedLive, camera, frame};
pub use text::escaped;

use packing::{Channel, Channels, Residuals};

/// Script of a page, a JavaScript module; also a widget of anywidget. `scripts/page_script` makes it of `relume.js`.
pub const SCRIPT: &str = include_str!("relume.min.js");

/// Script of a page that marches its volume: [`SCRIPT`], and `live.js`.
pub const LIVE_SCRIPT: &str = include_str!("live.min.js");

/// Style of a page.
pub const STYLE: &str = include_str!("style.css");

/// Title of a page without one of its own.
pub const TITLE: &str = "Relight this picture";

/// Tolerance of packing without one of the user's, in ΔE00.
pub const TOLERANCE: f64 = 0.5;

/// Longer side of the picture that a page shows without JavaScript, in pixels.
const STILL: usize = 300;

/// A picture or a turntable to write as a page.
#[derive(Debug)]
pub struct Page<'a> {
    /// Lights, components, dial and display; its own pixels are not used.
    pub film: &'a FilmFile,
    /// Pixels of each view, rows of the turntable from the top; all of one size.
    pub views: &'a [Film<f32>],
    /// Views in a row of the turntable; 1 for a picture.
    pub columns: usize,
    /// Title.
    pub title: &'a str,
    /// Largest ΔE00 that packing adds to a pixel under any light of the page, for either observer.
    pub tolerance: f64,
}

/// Reason why a page was not made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PageError {
    /// The numbers of the film span too much for two bytes at the tolerance.
    #[error(
        "the film cannot be packed within ΔE00 {tolerance}: two bytes per number keep ΔE00 {kept:.3}; allow a larger tolerance"
    )]
    Tolerance {
        /// Requested tolerance.
        tolerance: f64,
        /// Smallest ΔE00 that can be kept.
        kept: f64,
    },
    /// Numbers of the film are too large for two bytes, whatever the tolerance.
    #[error("the film cannot be packed: its numbers, up to {largest:e}, are too large for two bytes at any tolerance")]
    Range {
        /// Largest number of the film.
        largest: f32,
    },
    /// There are no pixels, or views of different sizes.
    #[error("a page needs views of one size and of one kind: {detail}")]
    Views {
        /// Offending item and number.
        detail: String,
    },
    /// The page is larger than allowed.
    #[error("the page would have {bytes} bytes, and the limit is {limit}; {ways}")]
    TooLarge {
        /// Bytes of the page.
        bytes: usize,
        /// Largest number of bytes.
        limit: usize,
        /// Sizes of smaller requests.
        ways: String,
    },
    /// The name of the file has another ending.
    #[error("{}: the name of a page must end in .html", path.display())]
    Name {
        /// File.
        path: PathBuf,
    },
    /// The films and their packing take more than the free memory.
    #[error(
        "{views} of {}×{} pixels with {numbers} numbers each need {bytes} bytes of memory to be packed, and {available} are free",
        size[0], size[1], views = if *views == 1 { "a view".to_owned() } else { format!("{views} views") }
    )]
    Memory {
        /// Number of views.
        views: usize,
        /// Pixels of a view across and down.
        size: [usize; 2],
        /// Numbers per pixel.
        numbers: usize,
        /// Bytes that are needed.
        bytes: usize,
        /// Bytes that are free.
        available: u64,
    },
    /// The work was cancelled.
    #[error("the page was cancelled")]
    Cancelled,
    /// A file cannot be read or written.
    #[error(transparent)]
    Output(#[from] OutputError),
}

impl PageError {
    /// Name for programs; it does not change between versions.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Tolerance { .. } => "page-tolerance-unreachable",
            Self::Range { .. } => "page-numbers-too-large",
            Self::Views { .. } => "page-views-differ",
            Self::TooLarge { .. } => "page-too-large",
            Self::Name { .. } => "page-name-invalid",
            Self::Memory { .. } => "page-exceeds-memory",
            Self::Cancelled => "cancelled",
            Self::Output(error) => error.code(),
        }
    }
}

/// Refuses a file name without the ending of a page.
///
/// # Errors
///
/// [`PageError::Name`].
pub fn check_name(path: &Path) -> Result<(), PageError> {
    let ends_well = |ending: &OsStr| ["html", "htm"].iter().any(|known| ending.eq_ignore_ascii_case(known));
    if path.extension().is_some_and(ends_well) { Ok(()) } else { Err(PageError::Name { path: path.to_owned() }) }
}

/// Refuses views of `numbers` per pixel that cannot be packed in `available` bytes, if these are known. `held` says whether the
/// films are in memory already.
///
/// # Errors
///
/// [`PageError::Memory`].
pub fn check_memory(
    views: usize,
    size: [usize; 2],
    numbers: usize,
    held: bool,
    available: Option<u64>,
) -> Result<(), PageError> {
    // Per number: itself, a residual in every view, and codes, their parts and those unpacked in one. Per pixel: its colour.
    let film = if held { 0 } else { views.saturating_mul(4) };
    let of_pixel = numbers.saturating_mul(views.saturating_add(8).saturating_add(film)).saturating_add(48);
    let bytes = size[0].saturating_mul(size[1]).saturating_mul(of_pixel);
    match available {
        Some(available) if u64::try_from(bytes).is_ok_and(|bytes| bytes > available) => {
            Err(PageError::Memory { views, size, numbers, bytes, available })
        }
        _ => Ok(()),
    }
}

/// A finished page.
#[derive(Clone, Debug, PartialEq)]
pub struct PackedPage {
    /// The HTML text.
    pub html: String,
    /// Spectra, names, dial and encoding, as the script of the page reads them: for a widget with the same script.
    pub json: String,
    /// Packed pixels of each view, which `json` tells how to unpack.
    pub views: Vec<Vec<u8>>,
    /// Bytes of the parts, and the accuracy.
    pub summary: Summary,
}

/// Size and accuracy of a page.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Summary {
    /// Bytes of the page.
    pub bytes: usize,
    /// Packed bytes of all views, before base64.
    pub packed_bytes: usize,
    /// Bytes of the spectra, names and dial.
    pub text_bytes: usize,
    /// Bytes of the picture without JavaScript, before base64.
    pub still_bytes: usize,
    /// Number of views.
    pub views: usize,
    /// Numbers per pixel.
    pub channels: usize,
    /// Codes per unit of a root.
    pub step: f64,
    /// Largest ΔE00 that packing adds to any pixel, under any light of the page for either observer.
    pub largest_error: f64,
    /// Tolerance of the search.
    pub tolerance: f64,
}

/// Packed views and how to unpack them.
struct Planes {
    channels: Channels,
    kept: Vec<Channel>,
    found: Found,
    views: Vec<Vec<u8>>,
    /// Number of large residuals of each view.
    large: Vec<usize>,
}

impl Page<'_> {
    /// Packs the views and writes the text. The packed numbers are unpacked and compared with the film first.
    ///
    /// # Errors
    ///
    /// [`PageError`].
    pub fn packed(&self, progress: &dyn Progress) -> Result<PackedPage, PageError> {
        self.with_live(None, progress)
    }

    /// [`Self::packed`] with a volume that the page marches, if it is given.
    ///
    /// # Errors
    ///
    /// [`PageError`].
    pub fn with_live(&self, live: Option<&PackedLive>, progress: &dyn Progress) -> Result<PackedPage, PageError> {
        let lights = self.checked()?;
        let planes = self.planes(&lights, None, progress)?;
        let still = self.still(&lights)?;
        let (html, json) = text::page(self, &lights, &planes, &still, live);
        let summary = Summary {
            bytes: html.len(),
            packed_bytes: planes.views.iter().map(Vec::len).sum(),
            text_bytes: json.len(),
            still_bytes: still.len(),
            views: self.views.len(),
            channels: planes.kept.len(),
            step: planes.found.step,
            largest_error: planes.found.largest.unwrap_or(f64::NAN),
            tolerance: self.tolerance,
        };
        Ok(PackedPage { html, json, views: planes.views, summary })
    }

    /// Packs the views for a page that is open, with the `step` of its [`Summary`] or the finest one that two bytes allow, in place of
    /// a search: the errors are not known. Returns the JSON and the views.
    ///
    /// # Errors
    ///
    /// [`PageError`].
    pub fn packed_at(&self, step: f64, progress: &dyn Progress) -> Result<(String, Vec<Vec<u8>>), PageError> {
        let lights = self.checked()?;
        let planes = self.planes(&lights, Some(step), progress)?;
        Ok((text::json(self, &lights, &planes), planes.views))
    }

    /// Index of the view with which the page opens: the first of the middle row.
    fn first(&self) -> usize {
        self.views.len() / self.columns / 2 * self.columns
    }

    /// The lights of the page, if its views are alike.
    fn checked(&self) -> Result<Lights, PageError> {
        let lights = Lights::new(self.film)?;
        let wrong = |detail: String| Err(PageError::Views { detail });
        let Some(first) = self.views.first() else { return wrong("there is no view".to_owned()) };
        check_size(first.size[0], first.size[1])?;
        if self.columns == 0 || !self.views.len().is_multiple_of(self.columns) {
            return wrong(format!("{} views are no rows of {}", self.views.len(), self.columns));
        }
        let accumulators = lights.of_position() * lights.opened.positions;
        for (index, view) in self.views.iter().enumerate() {
            let numbers = [view.accumulators.len(), view.transmittance.len()];
            let expected = [accumulators * first.pixels(), lights.behind() * first.pixels()];
            if view.size != first.size || numbers[0] != expected[0] || numbers[1] < expected[1] {
                return wrong(format!(
                    "view {index} is {}×{} with {numbers:?} numbers, not {}×{} with {expected:?}",
                    view.size[0], view.size[1], first.size[0], first.size[1]
                ));
            }
            if let Some(number) = view.accumulators.iter().chain(&view.transmittance).find(|number| !number.is_finite())
            {
                return wrong(format!("view {index} holds {number}, which is not a finite number"));
            }
        }
        Ok(lights)
    }

    /// Packs all views with `step`, or one that is searched.
    fn planes(&self, lights: &Lights, step: Option<f64>, progress: &dyn Progress) -> Result<Planes, PageError> {
        let total = self.views.len() as u64 + 1;
        let report = |done: usize| {
            progress.report("packing", done as u64, total);
            if progress.cancelled() { Err(PageError::Cancelled) } else { Ok(()) }
        };
        report(0)?;
        let conditions = lights.conditions();
        let channels = Channels::new(self.views, lights, gains(&conditions, lights.planes()));
        let found = match step {
            Some(step) => Found { step: channels.finest(step), largest: None },
            None => check::search(self.views, lights, &channels, &conditions, self.tolerance, progress)?,
        };
        let refused = |what: &str| OutputError::Inconsistent { detail: what.to_owned() };
        let mut kept = channels.at(found.step).ok_or_else(|| refused("its numbers span too much"))?;
        let failed = |error: std::io::Error| refused(&error.to_string());
        let codes =
            |view: &Film<f32>, kept: &[Channel]| channels.all_codes(&packing::planes(view, lights), kept, found.step);
        let mut residuals = Vec::new();
        for (index, view) in self.views.iter().enumerate() {
            report(index)?;
            residuals.push(Residuals::new(&codes(view, &kept), &kept, view.size[0]));
        }
        for (index, channel) in kept.iter_mut().enumerate() {
            channel.empty = residuals.iter().all(|residuals| residuals.is_empty(index));
        }
        let large = residuals.iter().map(Residuals::large).collect();
        let mut views = Vec::new();
        for (view, residuals) in self.views.iter().zip(residuals) {
            report(self.views.len())?;
            let bytes = residuals.packed(&kept).map_err(failed)?;
            // The codes were compared with the film in the search.
            if found.largest.is_some()
                && packing::unpacked(&bytes, &kept, residuals.large(), view.size).map_err(failed)? != codes(view, &kept)
            {
                return Err(refused("its packed numbers do not come back").into());
            }
            views.push(bytes);
        }
        Ok(Planes { channels, kept, found, views, large })
    }

    /// The picture as it opens, at most [`STILL`] pixels wide and high, as a PNG.
    fn still(&self, lights: &Lights) -> Result<Vec<u8>, PageError> {
        let film = &self.views[self.first()];
        let [width, height] = film.size;
        let shrink = (count(STILL) / count(width.max(height))).min(1.0);
        let size = [width, height].map(|side| whole((count(side) * shrink).round()).max(1));
        let linear = film.relight(&lights.matrices(&lights.opening, lights.seen()));
        let tone = self.film.tone;
        let mean = |index: usize| {
            let (x, y) = (index % size[0], index / size[0]);
            let span =
                |at: usize, of: usize, whole: usize| at * whole / of..((at + 1) * whole / of).max(at * whole / of + 1);
            let (columns, rows) = (span(x, size[0], width), span(y, size[1], height));
            let parts = rows.clone().flat_map(|row| columns.clone().map(move |column| row * width + column));
            let sum: DVec3 = parts.map(|pixel| tone.shown(linear[pixel]).clamp(DVec3::ZERO, DVec3::ONE)).sum();
            (sum / count(rows.len() * columns.len())).to_array().map(rounded)
        };
        let shown: Vec<[f32; 3]> = (0..size[0] * size[1]).into_par_iter().map(mean).collect();
        Ok(super::png::small_png(size[0], size[1], shown.as_flattened())?)
    }

    /// Relight matrices of the page under each mix for its observer, as its script must compute them.
    ///
    /// # Errors
    ///
    /// [`PageError`] as in [`Self::packed`].
    pub fn matrices(&self, mixes: &[(Mix, Observer)]) -> Result<Vec<RelightMatrices>, PageError> {
        let lights = self.checked()?;
        let of = |(mix, observer): &(Mix, Observer)| {
            lights.matrices(mix, Observer::ALL.iter().position(|one| one == observer).unwrap_or(0))
        };
        Ok(mixes.iter().map(of).collect())
    }

    /// The films that the packed views stand for.
    ///
    /// # Errors
    ///
    /// [`PageError`] as in [`Self::packed`].
    pub fn shown(&self, progress: &dyn Progress) -> Result<Vec<Film<f32>>, PageError> {
        let lights = self.checked()?;
        let Planes { channels, kept, found, views, large } = self.planes(&lights, None, progress)?;
        let accumulators = lights.of_position() * lights.opened.positions;
        let view = |((bytes, &large), film): ((&Vec<u8>, &usize), &Film<f32>)| {
            let codes = packing::unpacked(bytes, &kept, large, film.size);
            let codes = codes.map_err(|error| OutputError::Inconsistent { detail: error.to_string() })?;
            let mut planes = channels.values(&codes, &kept, found.step);
            let behind = planes.split_off(accumulators.min(planes.len()));
            let transmittance = if behind.is_empty() { film.transmittance.clone() } else { behind.concat() };
            Ok(Film { accumulators: planes.concat(), transmittance, ..film.clone() })
        };
        views.iter().zip(&large).zip(self.views).map(view).collect()
    }
}

/// Square root of the largest linear RGB of a unit of each plane under `conditions`, which are XYZ.
fn gains(conditions: &[Vec<DVec3>], planes: usize) -> Vec<f64> {
    use relume_colour::spectrum::colour::LINEAR_SRGB_FROM_XYZ;
    let largest = |plane: usize| {
        let colours = conditions.iter().filter_map(|colours| colours.get(plane));
        colours.map(|&colour| (*LINEAR_SRGB_FROM_XYZ * colour).abs().max_element()).fold(0.0, f64::max).sqrt()
    };
    (0..planes).map(largest).collect()
}

impl PackedPage {
    /// Refuses a page of more than `limit` bytes, and says what smaller requests would come to.
    ///
    /// # Errors
    ///
    /// [`PageError::TooLarge`].
    pub fn check_size(&self, limit: usize) -> Result<(), PageError> {
        let Summary { bytes, packed_bytes, views, .. } = self.summary;
        if bytes <= limit {
            return Ok(());
        }
        let encoded = count(packed_bytes) * 4.0 / 3.0;
        let room = count(limit) - (count(bytes) - encoded);
        let share = room / encoded;
        let (fewer, side) = (whole(count(views) * share.max(0.0)), whole(100.0 * share.max(0.0).sqrt()));
        let ways = if side == 0 {
            "no size or number of views is small enough".to_owned()
        } else if views > 1 && fewer > 0 {
            format!("{fewer} views would fit, or pictures of {side} % of the width and height")
        } else {
            format!("pictures of {side} % of the width and height would fit")
        };
        Err(PageError::TooLarge { bytes, limit, ways })
    }

    /// The page as a frame of another HTML text, which shares neither style nor script nor names with it; `height` in
    /// CSS pixels.
    #[must_use]
    pub fn framed(&self, title: &str, height: usize) -> String {
        let text = self.html.replace('&', "&amp;").replace('\'', "&#39;");
        format!(
            "<iframe sandbox=\"allow-scripts allow-downloads allow-modals\" title=\"{}\" height=\"{height}\" style=\"width:100%;border:0\" srcdoc='{text}'></iframe>\n",
            escaped(title)
        )
    }

    /// Writes the page to `path`.
    ///
    /// # Errors
    ///
    /// [`PageError::Output`]; `path` is then unchanged.
    pub fn write(&self, path: &Path) -> Result<(), PageError> {
        Ok(write_atomically(path, |sink| sink.write_all(self.html.as_bytes()))?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_that_cannot_be_packed_in_the_free_memory_are_refused_with_the_numbers() {
        let bytes = 100 * 50 * (4 * 9 + 48);
        let check = |held, available| check_memory(1, [100, 50], 4, held, available);
        assert!(check(true, Some(bytes)).is_ok());
        assert!(check(true, None).is_ok());
        let refused = check(true, Some(bytes - 1)).map_err(|error| error.to_string());
        let message = refused.err().unwrap_or_default();
        for part in ["a view of 100×50", "4 numbers", "420000 bytes", "419999 are free"] {
            assert!(message.contains(part), "{message}");
        }
        assert!(check(false, Some(bytes)).is_err(), "the film itself");
    }
}
