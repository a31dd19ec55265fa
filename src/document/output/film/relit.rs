//! The lights and components of a film file, as relighting needs them.

use std::sync::Arc;

use super::{Component, Components, FilmFile, Light, Stored};
use crate::annotate::{self, Edges, PixelLength};
use crate::output::OutputError;
use relume_colour::spectrum::{Light as LightSpectrum, Reflectance, Spectrum, SpectrumError};
use relume_scene::film;
use relume_scene::plan::Transmittance;
use relume_scene::{Display, Mix, MixLight};
use relume_volume::Unit;

impl FilmFile {
    /// The meaning of the numbers of the pixels.
    ///
    /// # Errors
    ///
    /// [`OutputError::Inconsistent`] if the background is not finite.
    pub fn relightable(&self) -> Result<film::Relightable, OutputError> {
        Ok(film::Relightable {
            components: self.spectra(),
            positions: self.positions.len(),
            background: self.behind()?,
            display: self.display(),
        })
    }

    /// Spectra of the components.
    #[must_use]
    pub fn spectra(&self) -> film::Components {
        match &self.components {
            Components::Surfaces(surfaces) => {
                let spectra = surfaces.iter().map(|surface| Spectrum::from_samples(surface.spectrum));
                film::Components::Surfaces(spectra.collect())
            }
            Components::Model(Stored { model, coloured, .. }) => {
                let transmittance = if *coloured { Transmittance::Coloured } else { Transmittance::Grey };
                film::Components::Model(Arc::new(model.clone()), transmittance)
            }
        }
    }

    /// All lights, with their weights in the scene.
    ///
    /// # Errors
    ///
    /// [`OutputError::Inconsistent`] if a spectrum is not finite.
    pub fn stated(&self) -> Result<Mix, OutputError> {
        let light = |light: &Light| {
            let spectrum = LightSpectrum::new(Spectrum::from_samples(light.spectrum)).map_err(inconsistent)?;
            Ok(MixLight { name: light.name.clone(), spectrum, weight: light.weight, position: light.position })
        };
        Ok(Mix(self.lights.iter().map(light).collect::<Result<_, OutputError>>()?))
    }

    /// Lights of the saved picture, with their weights in it.
    ///
    /// # Errors
    ///
    /// [`OutputError::Inconsistent`] if a spectrum is not finite.
    pub fn opening(&self) -> Result<Mix, OutputError> {
        let stated = self.stated()?;
        let lit = stated.0.into_iter().zip(&self.lights).filter(|(_, light)| light.shown != Some(0.0));
        Ok(Mix(lit.map(|(it, light)| MixLight { weight: light.shown.unwrap_or(it.weight), ..it }).collect()))
    }

    /// Makes `mix` the mix of the saved picture. Lights that the file does not have at their position are added to it.
    pub fn open_with(&mut self, mix: &Mix) {
        for light in &mut self.lights {
            light.shown = Some(0.0);
        }
        for asked in &mix.0 {
            let is_it = |light: &&mut Light| {
                light.position == asked.position && Spectrum::from_samples(light.spectrum) == *asked.spectrum.spectrum()
            };
            if let Some(light) = self.lights.iter_mut().find(is_it) {
                light.shown = Some(light.shown.unwrap_or(0.0) + asked.weight);
                continue;
            }
            let taken = |name: &str| self.lights.iter().any(|light| light.name == name);
            let of_position = self.positions.get(asked.position).map_or("", |position| &position.name);
            let names = [asked.name.clone(), format!("{} ({of_position})", asked.name)].into_iter();
            let names = names.chain((2..).map(|n| format!("{} {n}", asked.name)));
            let name = names.into_iter().find(|name| !taken(name)).unwrap_or_default();
            let (position, spectrum) = (asked.position, *asked.spectrum.spectrum().samples());
            self.lights.push(Light { name, position, weight: asked.weight, shown: None, spectrum });
        }
    }

    /// Reflectance behind the volume.
    ///
    /// # Errors
    ///
    /// [`OutputError::Inconsistent`] if it is not finite.
    pub fn behind(&self) -> Result<Option<Reflectance>, OutputError> {
        self.background
            .map(|samples| Reflectance::new(Spectrum::from_samples(samples)).map_err(inconsistent))
            .transpose()
    }

    /// Display of the saved picture.
    #[must_use]
    pub fn display(&self) -> Display {
        let Self { exposure, tone, backdrop, adapt, observer, .. } = *self;
        Display { exposure, tone, backdrop, adapt, observer, deficiency: None }
    }

    /// Makes an automatic exposure that of `film`, the numbers of the pixels, under the lights of the saved picture.
    ///
    /// # Errors
    ///
    /// [`OutputError::Inconsistent`] if a spectrum is not finite.
    pub fn expose(&mut self, film: &film::Film<f32>) -> Result<(), OutputError> {
        if self.exposure.is_none() && film.pixels() > 0 {
            let (means, mix) = (self.relightable()?, self.opening()?);
            let picture = film.rgba(&means.under(&mix));
            self.exposure = Some(film::automatic_exposure(&picture, &mix, &means.display));
        }
        Ok(())
    }

    /// Names and reflectances of the materials; none with a colour model.
    #[must_use]
    pub fn materials(&self) -> Vec<(String, Spectrum)> {
        let Components::Surfaces(surfaces) = &self.components else { return Vec::new() };
        // White for highlights follows the materials.
        let is_white = |it: &&Component| {
            it.name.starts_with("white") && Spectrum::from_samples(it.spectrum) == Spectrum::constant(1.0)
        };
        let materials = surfaces.len() - usize::from(surfaces.last().is_some_and(|it| is_white(&it)));
        surfaces.iter().take(materials).map(|it| (it.name.clone(), Spectrum::from_samples(it.spectrum))).collect()
    }

    /// Scale and orientation of the picture, if the file states them.
    #[must_use]
    pub fn scale(&self) -> Option<annotate::Frame> {
        let frame = self.frame.as_ref()?;
        Some(annotate::Frame {
            pixel: frame.pixel.map(|units| PixelLength { units, exact: frame.parallel }),
            unit: frame.unit.as_deref().and_then(Unit::named),
            edges: frame.edges.clone().map(|[left, right, top, bottom]| Edges { left, right, top, bottom }),
        })
    }

    /// Moves the numbers of the pixels out of the file.
    #[must_use]
    pub fn take_film(&mut self) -> film::Film<f32> {
        film::Film {
            size: [self.width, self.height],
            components: self.components.len(),
            accumulators: std::mem::take(&mut self.accumulators),
            transmittance: std::mem::take(&mut self.transmittance),
        }
    }
}

fn inconsistent(error: SpectrumError) -> OutputError {
    OutputError::Inconsistent { detail: error.to_string() }
}
