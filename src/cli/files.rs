//! Accumulators and pictures between the renderer and files.

use std::path::{Path, PathBuf};

use clap::ValueEnum;
use glam::DVec3;
use rayon::prelude::*;

use relume::output::accumulators::{Component, Light as FileLight, Position as FilePosition, PositionKind};
use relume::output::{Accumulators as File, Alpha, Depth, Picture, check_writable, write_exr, write_png};
use relume::plan::Planned;
use relume::scene::{Display, Mix, MixLight, Placement, Scene};
use relume::spectrum::{BANDS, Light, Reflectance, Spectrum};
use relume::tables::{Accumulation, Components};

use super::CliError;

/// Bits of a PNG's channels.
#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
pub(crate) enum Bits {
    #[value(name = "8")]
    Eight,
    #[value(name = "16")]
    Sixteen,
}

/// The kinds of picture file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum PictureKind {
    Png,
    Exr,
}

/// What `path` will be, by its extension.
pub(crate) fn picture_kind(path: &Path) -> Result<PictureKind, CliError> {
    match path.extension().and_then(|extension| extension.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("png") => Ok(PictureKind::Png),
        Some("exr") => Ok(PictureKind::Exr),
        _ => Err(CliError::Usage(format!(
            "cannot tell what kind of picture {} is to be: end its name in .png (sRGB) or .exr (linear float)",
            path.display()
        ))),
    }
}

/// Writes linear RGBA to `path`.
pub(crate) fn write_linear(path: &Path, size: [usize; 2], rgba: &[f32], bits: Bits) -> Result<(), CliError> {
    let picture = Picture::new(size[0], size[1], rgba)?;
    match picture_kind(path)? {
        PictureKind::Exr => write_exr(path, &picture)?,
        PictureKind::Png => {
            let depth = if bits == Bits::Sixteen { Depth::Sixteen } else { Depth::Eight };
            write_png(path, &picture, depth, Alpha::OverBlack)?;
        }
    }
    Ok(())
}

/// Linear sRGB and what passes as RGBA in f32.
#[expect(clippy::cast_possible_truncation, reason = "pictures are stored in f32")]
pub(crate) fn rgba(pixels: impl Iterator<Item = (DVec3, f64)>) -> Vec<f32> {
    pixels.flat_map(|(c, opacity)| [c.x as f32, c.y as f32, c.z as f32, opacity as f32]).collect()
}

/// The reflectances that accumulators stand for.
///
/// # Errors
///
/// Pixels that store the numbers of a colour model stand for none.
pub(crate) fn surfaces(scene: &Scene, planned: &Planned) -> Result<Vec<Spectrum>, CliError> {
    match Components::new(scene, planned) {
        Components::Surfaces(surfaces) => Ok(surfaces),
        Components::Model(..) => Err(CliError::Failed(
            "accumulator files and spectral pictures are written from weights of materials only, and this scene is planned with a colour model (see `relume info`): write .png or .exr pictures, or, where all absorption is grey, add -D accuracy.accumulate=weights".into(),
        )),
    }
}

/// The accumulator file of a march of `scene`, whose components are `surfaces`.
pub(crate) fn to_file(
    scene: &Scene,
    planned: &Planned,
    surfaces: &[Spectrum],
    accumulation: Accumulation<f32>,
) -> File {
    let names = planned.materials.iter().filter_map(|&m| scene.materials.get(m)).map(|m| m.name.clone());
    // White has a name of its own, whatever the materials are called.
    let names: Vec<String> = names.collect();
    let white = std::iter::once("white".to_owned()).chain((2..).map(|n| format!("white {n}")));
    let white = white.into_iter().find(|name| !names.contains(name)).unwrap_or_default();
    let components = surfaces
        .iter()
        .zip(names.into_iter().chain([white]))
        .map(|(spectrum, name)| Component { name, spectrum: *spectrum.samples() })
        .collect();
    let positions = planned.positions.iter().map(|position| FilePosition {
        name: position.name.clone(),
        kind: match position.placement {
            Placement::Ambient => PositionKind::Ambient,
            Placement::Headlight => PositionKind::Headlight,
            Placement::Directional(direction) => PositionKind::Directional(direction.to_array()),
            Placement::Point(point) => PositionKind::Point(point.to_array()),
        },
    });
    let lights = Mix::of_scene(scene).0.into_iter().map(|light| FileLight {
        name: light.name,
        position: light.position,
        weight: light.weight,
        spectrum: *light.spectrum.spectrum().samples(),
    });
    File {
        width: accumulation.size[0],
        height: accumulation.size[1],
        components,
        positions: positions.collect(),
        lights: lights.collect(),
        background: scene.background.as_ref().map(|surface| *surface.spectrum().samples()),
        exposure: scene.display.exposure,
        adapt: scene.display.adapt,
        weights: accumulation.weights,
        transmittance: accumulation.transmittance,
    }
}

/// An accumulator file, ready to be relit.
pub(crate) struct Saved {
    pub(crate) components: Components,
    pub(crate) positions: Vec<String>,
    pub(crate) mix: Mix,
    pub(crate) background: Option<Reflectance>,
    pub(crate) display: Display,
    pub(crate) accumulation: Accumulation<f32>,
}

/// Reads the accumulator file `path`.
pub(crate) fn from_file(path: &Path) -> Result<Saved, CliError> {
    let file = File::read(path)?;
    let bad = |error: relume::spectrum::SpectrumError| CliError::Failed(format!("{}: {error}", path.display()));
    let lights = file.lights.into_iter().map(|light| {
        let spectrum = Light::new(Spectrum::from_samples(light.spectrum)).map_err(bad)?;
        Ok(MixLight { name: light.name, spectrum, weight: light.weight, position: light.position })
    });
    let background = file.background.map(|samples| Reflectance::new(Spectrum::from_samples(samples)).map_err(bad));
    Ok(Saved {
        components: Components::Surfaces(
            file.components.iter().map(|component| Spectrum::from_samples(component.spectrum)).collect(),
        ),
        positions: file.positions.into_iter().map(|position| position.name).collect(),
        mix: Mix(lights.collect::<Result<_, CliError>>()?),
        background: background.transpose()?,
        display: Display { exposure: file.exposure, adapt: file.adapt },
        accumulation: Accumulation {
            size: [file.width, file.height],
            weights: file.weights,
            transmittance: file.transmittance,
        },
    })
}

/// Writes the spectrum of every pixel under `mix`.
#[expect(clippy::cast_possible_truncation, reason = "spectra are stored in f32")]
pub(crate) fn write_spectra(
    path: &Path,
    components: &[Spectrum],
    positions: usize,
    background: Option<&Reflectance>,
    mix: &Mix,
    accumulation: &Accumulation<f32>,
    preview: &[f32],
) -> Result<(), CliError> {
    let (light_at, all) = mix.light_at(positions);
    let parts: Vec<Spectrum> =
        light_at.iter().flat_map(|light| components.iter().map(move |component| light * component)).collect();
    let behind = background.map(|surface| &all * surface.spectrum());
    let [width, height] = accumulation.size;
    let pixels = width * height;
    relume::output::write_spectral(path, width, height, |y, row| {
        row.radiance.par_iter_mut().enumerate().for_each(|(x, radiance)| {
            let pixel = y * width + x;
            let mut sum = [0.0; BANDS];
            let passed = f64::from(accumulation.transmittance[pixel]);
            let weights = (0..parts.len()).map(|part| f64::from(accumulation.weights[part * pixels + pixel]));
            for (spectrum, weight) in parts.iter().zip(weights).chain(behind.iter().map(|behind| (behind, passed))) {
                for (sum, sample) in sum.iter_mut().zip(spectrum.samples()) {
                    *sum += weight * sample;
                }
            }
            *radiance = sum.map(|sample| sample as f32);
        });
        for (x, colour) in row.preview.iter_mut().enumerate() {
            colour.copy_from_slice(&preview[(y * width + x) * 4..][..3]);
        }
    })?;
    Ok(())
}

/// Refuses outputs that cannot be written, or would overwrite an input or each other, before work is done for them.
pub(crate) fn check_outputs(outputs: &[&PathBuf], inputs: &[&Path]) -> Result<(), CliError> {
    let mut real = Vec::new();
    for output in outputs {
        let this = std::fs::canonicalize(output).ok().or_else(|| {
            // What is not there yet has a folder that is.
            let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
            Some(std::fs::canonicalize(folder).ok()?.join(output.file_name()?))
        });
        if this.is_some() && inputs.iter().any(|input| std::fs::canonicalize(input).ok() == this) {
            return Err(CliError::Usage(format!("{} is an input; write the result elsewhere", output.display())));
        }
        if this.is_some() && real.contains(&this) {
            return Err(CliError::Usage(format!("{} is named twice as an output", output.display())));
        }
        check_writable(output)?;
        real.push(this);
    }
    Ok(())
}
