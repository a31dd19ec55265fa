//! Rendering of SVG drawings to PNG.

use std::path::Path;
use std::sync::{Arc, LazyLock};

use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree, fontdb};

use super::{OutputError, write_ready_png};
use relume_colour::spectrum::colour::decode_srgb;

/// Renders the SVG drawing `svg` over white, with `scale` pixels per unit, and writes it to `path` as PNG.
///
/// Uses a system font for text. Returns false if the system has none; the text is then left out.
///
/// # Errors
///
/// [`OutputError::Drawing`] for invalid SVG, [`OutputError::Size`] for a drawing that is too large, and the errors of
/// [`super::write_atomically`].
pub fn write_drawing(path: &Path, svg: &str, scale: f32) -> Result<bool, OutputError> {
    let (picture, has_fonts) = rasterised(path, svg, scale)?;
    let [width, height] = [picture.width(), picture.height()].map(|side| usize::try_from(side).unwrap_or(usize::MAX));
    let over_white = |pixel: &resvg::tiny_skia::PremultipliedColorU8| {
        let white = 255 - pixel.alpha();
        [pixel.red(), pixel.green(), pixel.blue()].map(|part| part.saturating_add(white))
    };
    let samples: Vec<u8> = picture.pixels().iter().flat_map(over_white).collect();
    write_ready_png(path, width, height, &samples)?;
    Ok(has_fonts)
}

/// Draws the SVG drawing `svg` over linear RGBA, whose colours are weighted by opacity, for the file `path`. One unit of the
/// drawing is one of `width` pixels. Returns false if the system has no font; the text is then left out.
///
/// # Errors
///
/// [`OutputError::Drawing`], [`OutputError::Size`].
pub fn draw_over(path: &Path, svg: &str, width: usize, rgba: &mut [f32]) -> Result<bool, OutputError> {
    let (drawn, has_fonts) = rasterised(path, svg, 1.0)?;
    let stride = usize::try_from(drawn.width()).unwrap_or(usize::MAX);
    for (row, drawn) in rgba.chunks_exact_mut(4 * width).zip(drawn.pixels().chunks_exact(stride)) {
        for (pixel, ink) in row.as_chunks_mut::<4>().0.iter_mut().zip(drawn).filter(|(_, ink)| ink.alpha() > 0) {
            let ink = ink.demultiply();
            let opacity = f32::from(ink.alpha()) / 255.0;
            let codes = [ink.red(), ink.green(), ink.blue()];
            for (channel, code) in pixel.iter_mut().zip(codes) {
                *channel = (1.0 - opacity).mul_add(*channel, opacity * linear(code));
            }
            pixel[3] = (1.0 - opacity).mul_add(pixel[3], opacity);
        }
    }
    Ok(has_fonts)
}

/// Linear value of an 8-bit sRGB code.
#[expect(clippy::cast_possible_truncation, reason = "pictures are stored in f32")]
fn linear(code: u8) -> f32 {
    decode_srgb(f64::from(code) / 255.0) as f32
}

/// The fonts of the system, read once.
static FONTS: LazyLock<Arc<fontdb::Database>> = LazyLock::new(|| {
    let mut fonts = fontdb::Database::new();
    fonts.load_system_fonts();
    Arc::new(fonts)
});

/// Renders `svg` for the file `path` with `scale` pixels per unit, and says whether there is a font for its text.
fn rasterised(path: &Path, svg: &str, scale: f32) -> Result<(Pixmap, bool), OutputError> {
    let mut options = Options { fontdb: Arc::clone(&FONTS), ..Options::default() };
    let has_fonts = !options.fontdb.is_empty();
    if let Some(name) = family(&options) {
        options.fontdb_mut().set_sans_serif_family(name.clone());
        options.font_family = name;
    }
    let drawing = |detail: String| OutputError::Drawing { path: path.to_owned(), detail };
    let tree = Tree::from_str(svg, &options).map_err(|error| drawing(error.to_string()))?;
    let size = tree.size().to_int_size().scale_by(scale).ok_or_else(|| drawing("its size is 0".to_owned()))?;
    let [width, height] = [size.width(), size.height()].map(|side| usize::try_from(side).unwrap_or(usize::MAX));
    let too_large = || OutputError::Size { width, height, largest: super::Picture::LARGEST_SIDE };
    let mut picture = Pixmap::new(size.width(), size.height()).ok_or_else(too_large)?;
    resvg::render(&tree, Transform::from_scale(scale, scale), &mut picture.as_mut());
    Ok((picture, has_fonts))
}

/// Chooses a legible font family of the system.
fn family(options: &Options<'_>) -> Option<String> {
    let names: Vec<&str> =
        options.fontdb.faces().filter_map(|face| face.families.first()).map(|(name, _)| name.as_str()).collect();
    let usual = ["DejaVu Sans", "Noto Sans", "Liberation Sans", "Helvetica", "Arial"];
    usual.iter().find(|usual| names.contains(*usual)).or(names.first().as_ref().copied()).map(|name| (*name).to_owned())
}
