//! Golden images, which were inspected once, and comparison with them.
//!
//! `tests/golden/NAME.exr` holds one picture for each name in [`NAMES`]. `BLESS=NAME cargo test` rewrites it from the
//! one
//! rung with permission, and fails that run: inspect the picture, then run again. A failure writes both pictures, their
//! difference and the numbers to `target/golden/NAME.TOLERANCE/`.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, LayerAttributes, ReadChannels as _, ReadLayers as _,
    WritableImage as _,
};
use relume::measure::ImageError;
use relume::output::{Alpha, Depth, Picture, write_png};

use super::tolerance::Tolerance;

/// Names of all golden images.
pub const NAMES: &[&str] = super::scenes::NAMES;

/// Picture or set of accumulators, with its source.
#[derive(Clone, Debug)]
pub struct Image {
    /// Name of the rung that made it, such as "reference f64" or "GPU".
    pub source: String,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Channel names.
    pub channels: Vec<String>,
    /// Samples, pixel by pixel, rows from the top.
    pub samples: Vec<f32>,
    /// Σ|terms| of each sample, to which its error is relative; without it, errors are absolute.
    pub scale: Option<Vec<f64>>,
}

impl Image {
    /// Creates a linear RGB image.
    pub fn rgb(source: &str, width: usize, height: usize, samples: Vec<f32>) -> Self {
        let channels = ["R", "G", "B"].map(str::to_owned).to_vec();
        Self { source: source.to_owned(), width, height, channels, samples, scale: None }
    }

    /// Checks that the number of samples matches the size.
    fn whole(&self) -> Result<(), String> {
        let (expected, found) = (self.width * self.height * self.channels.len(), self.samples.len());
        if expected == found { Ok(()) } else { Err(format!("{} has {found} samples, not {expected}", self.source)) }
    }
}

/// Compares `image` with the golden image `name`.
///
/// # Panics
///
/// If they differ by more than `tolerance`, if the golden image is missing, or after it was rewritten.
pub fn check(name: &str, image: &Image, tolerance: &Tolerance) {
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().map(|target| target.join("golden"));
    let golden = Golden {
        folder: Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden"),
        failures: target.unwrap_or_else(|| PathBuf::from("target/golden")),
        names: NAMES,
        bless: std::env::var("BLESS").ok(),
    };
    if let Err(message) = golden.check(name, image, tolerance) {
        panic!("{message}");
    }
}

/// Folders of golden images, and the one to rewrite.
#[derive(Debug)]
pub struct Golden<'a> {
    /// Folder of the golden images.
    pub folder: PathBuf,
    /// Folder for the output of failures.
    pub failures: PathBuf,
    /// Names of the golden images that should exist.
    pub names: &'a [&'a str],
    /// Name of the golden image to rewrite.
    pub bless: Option<String>,
}

impl Golden<'_> {
    /// As [`check`], with an error in place of a panic.
    pub fn check(&self, name: &str, image: &Image, tolerance: &Tolerance) -> Result<(), String> {
        if !self.names.contains(&name) {
            return Err(format!("{name:?} is not in the list of golden images: add it to NAMES"));
        }
        image.whole()?;
        let path = self.folder.join(format!("{name}.exr"));
        if tolerance.may_bless && self.bless.as_deref() == Some(name) {
            if image.samples.iter().any(|sample| !sample.is_finite()) {
                return Err(format!("{} holds what is no number: it is not worth keeping", image.source));
            }
            write(&path, image)?;
            return Err(format!("{} was rewritten: look at it, then run again without BLESS", path.display()));
        }
        if !path.is_file() {
            return Err(format!("there is no {}: make it with BLESS={name} cargo test", path.display()));
        }
        let expected = read(&path, &image.channels)?;
        compare(image, &expected, tolerance).map_err(|reason| {
            let folder = self.failures.join(format!("{name}.{}", tolerance.name));
            let mut message = format!("{name}: {reason}");
            match leave(&folder, image, &expected, &message) {
                Ok(()) => _ = write!(message, "\nsee {}", folder.display()),
                Err(error) => _ = write!(message, "\n(nothing could be left in {}: {error})", folder.display()),
            }
            message
        })
    }

    /// Returns messages about unexpected, missing and unknown golden images.
    pub fn strays(&self) -> Vec<String> {
        let files = fs::read_dir(&self.folder).into_iter().flatten().flatten();
        let found: Vec<String> = files.map(|file| file.file_name().to_string_lossy().into_owned()).collect();
        let expected: Vec<String> = self.names.iter().map(|name| format!("{name}.exr")).collect();
        let stray =
            found.iter().filter(|file| !expected.contains(file)).map(|file| format!("{file} is no golden image"));
        let missing = expected.iter().filter(|file| !found.contains(file)).map(|file| format!("{file} is missing"));
        let blessed = self.bless.iter().filter(|name| !self.names.contains(&name.as_str()));
        let unknown = blessed.map(|name| format!("BLESS={name} names no golden image"));
        stray.chain(missing).chain(unknown).collect()
    }
}

/// Compares `actual` with `expected`; the error states the difference.
pub fn compare(actual: &Image, expected: &Image, tolerance: &Tolerance) -> Result<(), String> {
    let shared = std::ptr::eq(actual.samples.as_ptr(), expected.samples.as_ptr());
    if shared || actual.source == expected.source {
        return Err(format!("{} is compared with itself", actual.source));
    }
    let shape = |image: &Image| format!("{}×{} pixels of {}", image.width, image.height, image.channels.join(", "));
    if shape(actual) != shape(expected) {
        return Err(format!("{} has {}, {} has {}", actual.source, shape(actual), expected.source, shape(expected)));
    }
    let size = (actual.width, actual.channels.len());
    let scale =
        |sample: usize| actual.scale.as_ref().map_or(1.0, |scale| scale.get(sample).copied().unwrap_or(f64::NAN));
    let error =
        ImageError::between(&actual.samples, &expected.samples, size, scale).map_err(|error| error.to_string())?;
    let (relative, absolute, samples) = (error.relative(), error.absolute(), actual.samples.len());
    let exceptions = error.relative_count_over(tolerance.usual);
    let share =
        f64::from(u32::try_from(exceptions).unwrap_or(u32::MAX)) / f64::from(u32::try_from(samples).unwrap_or(1));
    // The comparisons fail for NaN.
    if relative.largest <= tolerance.largest && relative.mean <= tolerance.mean && share <= tolerance.exceptions {
        return Ok(());
    }
    let place = error.worst().map_or_else(String::new, |(x, y, channel)| {
        let sample = (y * actual.width + x) * actual.channels.len() + channel;
        let (found, wanted) = (actual.samples[sample], expected.samples[sample]);
        format!("({x}, {y}) {}: {found:e} for {wanted:e}", actual.channels[channel])
    });
    Err(format!(
        "{} is not within the tolerance {:?} of {}\n\
         largest {:.3e} (allowed {:.3e}), mean {:.3e} (allowed {:.3e})\n\
         {exceptions} of {samples} samples over {:.3e} (allowed {:.1} %)\n\
         absolute: largest {:.3e}, mean {:.3e}, 99 % within {:.3e}, {:.1} dB\n\
         worst at {place}",
        actual.source,
        tolerance.name,
        expected.source,
        relative.largest,
        tolerance.largest,
        relative.mean,
        tolerance.mean,
        tolerance.usual,
        100.0 * tolerance.exceptions,
        absolute.largest,
        absolute.mean,
        absolute.p99,
        error.psnr_db(),
    ))
}

/// Writes both pictures, their difference and the numbers to `folder`.
fn leave(folder: &Path, actual: &Image, expected: &Image, numbers: &str) -> Result<(), String> {
    fs::create_dir_all(folder).map_err(|error| error.to_string())?;
    fs::write(folder.join("numbers.txt"), numbers).map_err(|error| error.to_string())?;
    let mut pictures = vec![("actual", actual.clone()), ("expected", expected.clone())];
    if actual.samples.len() == expected.samples.len() {
        let pairs = actual.samples.iter().zip(&expected.samples);
        let samples = pairs.map(|(actual, expected)| (actual - expected).abs()).collect();
        pictures.push(("difference", Image { samples, ..actual.clone() }));
    }
    for (name, picture) in pictures {
        write(&folder.join(format!("{name}.exr")), &picture)?;
        // Shows the first three of many channels; brightens the difference to be visible, and shows NaN as white.
        let first =
            |pixel: &[f32]| [0, 1, 2].map(|channel| pixel.get(channel).or(pixel.last()).copied().unwrap_or(0.0));
        let mut rgb: Vec<f32> = picture.samples.chunks(picture.channels.len().max(1)).flat_map(first).collect();
        if name == "difference" {
            let largest = rgb.iter().copied().filter(|value| value.is_finite()).fold(f32::MIN_POSITIVE, f32::max);
            rgb.iter_mut().for_each(|value| *value = if value.is_finite() { *value / largest } else { 1.0 });
        }
        let rgb = Picture::new(picture.width, picture.height, &rgb).map_err(|error| error.to_string())?;
        write_png(&folder.join(format!("{name}.png")), &rgb, Depth::Eight, Alpha::OverBlack)
            .map_err(|error| error.to_string())?;
    }
    Ok(())
}

/// Writes every channel as f32.
fn write(path: &Path, image: &Image) -> Result<(), String> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(|error| error.to_string())?;
    }
    let count = image.channels.len();
    let plane = |channel: usize| image.samples.iter().skip(channel).step_by(count).copied().collect();
    let named = image.channels.iter().enumerate();
    let list = named.map(|(channel, name)| AnyChannel::new(name.as_str(), FlatSamples::F32(plane(channel)))).collect();
    let layer = exr::prelude::Layer::new(
        (image.width, image.height),
        LayerAttributes::default(),
        Encoding::SMALL_LOSSLESS,
        AnyChannels::sort(list),
    );
    let written = exr::prelude::Image::from_layer(layer).write().to_file(path);
    written.map_err(|error| format!("cannot write {}: {error}", path.display()))
}

/// Reads every channel, in the given order if it contains them all, otherwise in the order of their names.
fn read(path: &Path, order: &[String]) -> Result<Image, String> {
    let reader = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer();
    let image =
        reader.all_attributes().from_file(path).map_err(|error| format!("cannot read {}: {error}", path.display()))?;
    let layer = image.layer_data;
    let mut channels: Vec<&AnyChannel<FlatSamples>> = layer.channel_data.list.iter().collect();
    let place = |channel: &AnyChannel<FlatSamples>| order.iter().position(|name| channel.name == **name);
    if channels.iter().all(|channel| place(channel).is_some()) {
        channels.sort_by_key(|channel| place(channel));
    }
    let planes: Vec<Vec<f32>> = channels.iter().map(|channel| channel.sample_data.values_as_f32().collect()).collect();
    let pixels = layer.size.area();
    Ok(Image {
        source: format!("the golden image {}", path.display()),
        width: layer.size.width(),
        height: layer.size.height(),
        channels: channels.iter().map(|channel| channel.name.to_string()).collect(),
        samples: (0..pixels).flat_map(|pixel| planes.iter().map(move |plane| plane[pixel])).collect(),
        scale: None,
    })
}
