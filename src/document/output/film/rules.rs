//! Validity rules of films, in memory and in files.

use std::collections::{HashMap, HashSet};

use super::{Components, FilmFile, LARGEST_CLOUD, Stored};
use relume_colour::model::LARGEST_DIMENSION;

impl FilmFile {
    /// Checks all rules of a file with these accumulators and transmittances.
    pub(super) fn check(&self, [accumulators, through]: [&[f32]; 2]) -> Result<(), String> {
        let names = self.channel_names();
        self.check_lists(&names)?;
        if let Components::Model(stored) = &self.components {
            self.check_model(stored)?;
        }
        let pixels = self.width * self.height;
        let transmittances = self.transmittance_numbers() * pixels;
        let expected = names.len() * pixels - transmittances;
        if accumulators.len() != expected {
            return Err(format!("it needs {expected} numbers in the accumulators, and has {}", accumulators.len()));
        }
        if through.len() != transmittances {
            return Err(format!("it needs {transmittances} transmittances, and has {}", through.len()));
        }
        let planes = accumulators.chunks_exact(pixels).chain(through.chunks_exact(pixels));
        check_planes(&names, planes, self.width, "")
    }

    /// Transmittance numbers per pixel.
    pub(super) fn transmittance_numbers(&self) -> usize {
        if self.is_coloured() { self.components.len() } else { 1 }
    }

    /// Checks the names and numbers of the lists; `channels` are the resulting channel names.
    pub(super) fn check_lists(&self, channels: &[String]) -> Result<(), String> {
        if let Components::Surfaces(surfaces) = &self.components {
            check_names("component", surfaces.iter().map(|surface| &*surface.name))?;
            for surface in surfaces {
                check_finite("the component ", &surface.name, &surface.spectrum)?;
            }
        }
        check_names("position", self.positions.iter().map(|position| &*position.name))?;
        check_names("light", self.lights.iter().map(|light| &*light.name))?;
        for name in channels {
            if name.len() > 255 {
                return Err(format!("the channel name {name:?} has {} bytes; OpenEXR allows 255", name.len()));
            }
        }
        let components = self.components.names();
        let pairs =
            self.positions.iter().flat_map(|position| components.iter().map(move |name| (&position.name, name)));
        let mut seen = HashMap::new();
        for (channel, pair) in channels.iter().zip(pairs) {
            if let Some(first) = seen.insert(channel, pair) {
                let [one, other] =
                    [first, pair].map(|(position, component)| format!("{position:?} with {component:?}"));
                return Err(format!(
                    "two pairs of position and component have the channel name {channel:?}: {one}, and {other}"
                ));
            }
        }
        for position in &self.positions {
            if let Some(vector) = position.placement.vector() {
                check_finite("the position ", &position.name, &vector.to_array())?;
            }
        }
        for light in &self.lights {
            check_finite("the light ", &light.name, &light.spectrum)?;
            check_finite("the light ", &light.name, &[light.weight, light.shown.unwrap_or_default()])?;
            if light.position >= self.positions.len() {
                let (name, positions) = (&light.name, self.positions.len());
                return Err(format!(
                    "the light {name:?} is at position {}, but there are {positions} positions",
                    light.position
                ));
            }
        }
        if let Some(dial) = &self.dial {
            check_names("node of the dial", dial.nodes.iter().map(|node| &*node.light))?;
            check_finite("the dial's ", "master", &[dial.master])?;
            check_finite("the dial's ", "hand", dial.hand.as_ref().map_or(&[], |hand| hand))?;
            for node in &dial.nodes {
                check_finite("the dial's node ", &node.light, &node.place)?;
                if !self.lights.iter().any(|light| light.name == node.light) {
                    return Err(format!("the dial has a node {:?}, but no light has this name", node.light));
                }
            }
            check_names("preset of the dial", dial.presets.iter().map(|preset| &*preset.name))?;
            for preset in &dial.presets {
                check_finite("the dial's preset ", &preset.name, &preset.hand)?;
            }
        }
        check_finite("", "background", self.background.as_ref().map_or(&[], |background| background))?;
        check_finite("", "exposure", self.exposure.as_slice())
    }

    /// Checks that a file can hold the model.
    fn check_model(&self, stored: &Stored) -> Result<(), String> {
        check_finite("", "tolerance", &[stored.tolerance])?;
        check_dimension(stored.model.dimension())?;
        check_cloud(stored.model.cloud().len().max(stored.model.unseen().spectra.len()))
    }
}

/// Refuses invalid dimensions of a model.
pub(super) fn check_dimension(dimension: usize) -> Result<(), String> {
    if (1..=LARGEST_DIMENSION).contains(&dimension) {
        Ok(())
    } else {
        Err(format!("its colour model has {dimension} coefficients; the limits are 1 to {LARGEST_DIMENSION}"))
    }
}

/// Refuses empty clouds, and clouds larger than [`LARGEST_CLOUD`].
pub(super) fn check_cloud(spectra: usize) -> Result<(), String> {
    if (1..=LARGEST_CLOUD).contains(&spectra) {
        Ok(())
    } else {
        Err(format!("its colour model was fitted to {spectra} spectra; the limits are 1 to {LARGEST_CLOUD}"))
    }
}

/// Refuses infinite numbers and NaN.
pub(super) fn check_finite(what: &str, name: &str, numbers: &[f64]) -> Result<(), String> {
    match numbers.iter().find(|number| !number.is_finite()) {
        Some(number) => Err(format!("{what}{name:?} holds {number}, which is not a finite number")),
        None => Ok(()),
    }
}

/// Checks that every pixel of `planes` has a finite value. The planes are called `names` and have rows of `width`;
/// messages append `place` to the names.
pub(super) fn check_planes<'a>(
    names: &[String],
    planes: impl Iterator<Item = &'a [f32]>,
    width: usize,
    place: &str,
) -> Result<(), String> {
    let bad = |plane: &[f32]| plane.iter().position(|value| !value.is_finite());
    match names.iter().zip(planes).find_map(|(name, plane)| bad(plane).map(|pixel| (name, pixel))) {
        Some((name, pixel)) => {
            let (x, y) = (pixel % width, pixel / width);
            Err(format!("the channel {name:?}{place} has no finite value at pixel ({x}, {y})"))
        }
        None => Ok(()),
    }
}

/// Refuses names that are empty, contain control characters, or repeat.
fn check_names<'a>(what: &str, names: impl Iterator<Item = &'a str>) -> Result<(), String> {
    let mut seen = HashSet::new();
    for name in names {
        if name.is_empty() {
            return Err(format!("a {what} has an empty name"));
        }
        if name.chars().any(char::is_control) {
            return Err(format!("the name of the {what} {name:?} contains a control character"));
        }
        if !seen.insert(name) {
            return Err(format!("two {what}s have the name {name:?}"));
        }
    }
    Ok(())
}
