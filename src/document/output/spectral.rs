//! Spectral pictures as OpenEXR files, in the layout of Fichet, Pacanowski and Wilkie (JCGT 10(3), 2021).

use std::path::Path;

use super::channels::{self, Part, Target};
use super::{BANDS, FIRST_NM, OutputError, STEP_NM};

/// One row of a spectral picture to fill, from left to right.
#[derive(Debug)]
pub struct SpectralRow<'a> {
    /// Spectral radiance of each pixel, 380–780 nm in steps of 5 nm.
    pub radiance: &'a mut [[f32; BANDS]],
    /// Linear sRGB of each pixel, for programs that do not read spectra.
    pub preview: &'a mut [[f32; 3]],
}

/// Writes a spectral picture to `path`: channels `S0.380,000nm` to `S0.780,000nm` (unpolarised emission) and R, G, B,
/// 32-bit float, with the attributes `spectralLayoutVersion` = "1.0", `emissiveUnits` = "W.m^-2.sr^-1" and
/// `polarisationHandedness` = "right".
///
/// `notes` are further string attributes: names and values.
///
/// `fill(y, row)` is called once per row, from the top down; only the rows of one compressed block are in memory.
///
/// # Errors
///
/// [`OutputError::Size`], and those of [`super::write_atomically`].
pub fn write_spectral(
    path: &Path,
    width: usize,
    height: usize,
    notes: &[(&str, &str)],
    mut fill: impl FnMut(usize, SpectralRow<'_>),
) -> Result<(), OutputError> {
    let wavelengths_nm = (FIRST_NM..).step_by(usize::from(STEP_NM)).take(BANDS);
    let bands = wavelengths_nm.map(|wavelength_nm| format!("S0.{wavelength_nm},000nm"));
    let names: Vec<String> = bands.chain(["R", "G", "B"].map(str::to_owned)).collect();
    let layout =
        [("spectralLayoutVersion", "1.0"), ("emissiveUnits", "W.m^-2.sr^-1"), ("polarisationHandedness", "right")];
    let attributes = [&layout, notes].concat();
    let mut radiance = vec![[0.0; BANDS]; width];
    let mut preview = vec![[0.0; 3]; width];
    let part = Part { name: None, size: (width, height), channels: &names, attributes: &attributes };
    channels::write(Target::File(path), &[part], |_, first, data| {
        for (y, line) in (first..).zip(data.chunks_exact_mut(width * names.len())) {
            fill(y, SpectralRow { radiance: &mut radiance, preview: &mut preview });
            let (bands, colours) = line.split_at_mut(width * BANDS);
            planes_from_pixels(bands, &radiance);
            planes_from_pixels(colours, &preview);
        }
    })
}

/// Splits pixels of `N` values into `N` planes.
fn planes_from_pixels<const N: usize>(planes: &mut [f32], pixels: &[[f32; N]]) {
    for (channel, plane) in planes.chunks_exact_mut(pixels.len()).enumerate() {
        for (value, pixel) in plane.iter_mut().zip(pixels) {
            *value = pixel[channel];
        }
    }
}
