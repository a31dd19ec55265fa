//! Spectra that replace those of a scene: solved, standard or drawn by hand.

use super::step::Step;
use super::{BACKGROUND, Side};
use relume_base::number::count;
use relume_colour::palette::{Member, Solution};
use relume_colour::spectrum::{BANDS, Light, Reflectance, Spectrum, standard};
use relume_scene::Scene;

/// Number of handles of an editable curve: every 50 nm from 380 to 780 nm.
pub const HANDLES: usize = 9;
/// Samples from one handle to the next.
pub const BANDS_PER_HANDLE: usize = (BANDS - 1) / (HANDLES - 1);

/// Fraction of the movement of the handle at `band` that the sample at `at` follows. A virtual handle beyond each end
/// moves with the end handle.
fn goes_along(at: usize, band: usize) -> f64 {
    let kernel = |distance: f64| match distance.abs() {
        t if t < 1.0 => (1.5 * t - 2.5) * t * t + 1.0,
        t if t < 2.0 => ((2.5 - 0.5 * t) * t - 4.0) * t + 2.0,
        _ => 0.0,
    };
    let distance = (count(at) - count(band)) / count(BANDS_PER_HANDLE);
    let beyond = match band {
        0 => kernel(distance + 1.0),
        band if band == BANDS - 1 => kernel(distance - 1.0),
        _ => 0.0,
    };
    kernel(distance) + beyond
}

/// Spectra that replace those of the scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Spectra {
    /// Reflectances, by material index.
    pub materials: Vec<(usize, Reflectance)>,
    /// Light spectra, by light index.
    pub lights: Vec<(usize, Light)>,
    /// Reflectance of the background.
    pub background: Option<Reflectance>,
    /// Palette edit that goes with the spectra.
    pub step: Option<Step>,
}

impl Spectra {
    /// The solved spectra of the open rows and columns, for the materials and lights present in `scene`.
    #[must_use]
    pub fn of(scene: &Scene, solution: &Solution) -> Self {
        let palette = &solution.palette;
        let open = |members: &[Member]| -> Vec<usize> {
            (0..members.len()).filter(|&index| members.get(index).is_some_and(|it| it.spectrum.is_none())).collect()
        };
        let mut spectra = Self::default();
        for row in open(&palette.materials) {
            let (Some(member), Some(found)) = (palette.materials.get(row), solution.materials.get(row)) else {
                continue;
            };
            match scene.materials.iter().position(|material| material.name == member.name) {
                Some(index) => spectra.materials.push((index, found.clone())),
                None if member.name == BACKGROUND => spectra.background = Some(found.clone()),
                None => {}
            }
        }
        for column in open(&palette.lights) {
            let (Some(member), Some(found)) = (palette.lights.get(column), solution.lights.get(column)) else {
                continue;
            };
            if let Some(index) = scene.lights.iter().position(|light| light.name == member.name) {
                spectra.lights.push((index, found.clone()));
            }
        }
        spectra
    }

    /// The current spectrum of the material or light `name` of `scene`.
    #[must_use]
    pub fn of_scene(scene: &Scene, side: Side, name: &str) -> Self {
        let mut spectra = Self::default();
        match side {
            Side::Material => {
                let named = scene.materials.iter().enumerate().filter(|(_, it)| it.name == name);
                spectra.materials.extend(named.map(|(index, it)| (index, it.reflectance.clone())));
            }
            Side::Light => {
                let named = scene.lights.iter().enumerate().filter(|(_, it)| it.name == name);
                spectra.lights.extend(named.map(|(index, it)| (index, it.spectrum.clone())));
            }
        }
        spectra
    }

    /// The standard spectrum `standard` for the material or light `name` of `scene`.
    ///
    /// # Errors
    ///
    /// A sentence that lists the available names.
    pub fn standard(scene: &Scene, side: Side, name: &str, standard: &str) -> Result<Self, String> {
        let find = |names: Vec<&str>| {
            let found = names.iter().position(|&one| one == name);
            found.ok_or_else(|| format!("there is no {name:?}; there are: {}", names.join(", ")))
        };
        let mut spectra = Self::default();
        match side {
            Side::Material => {
                let index = find(scene.materials.iter().map(|it| it.name.as_str()).collect())?;
                let found = standard::reflectance(standard).map_err(|error| error.to_string())?;
                spectra.materials.push((index, found));
            }
            Side::Light => {
                let index = find(scene.lights.iter().map(|it| it.name.as_str()).collect())?;
                spectra.lights.push((index, standard::light(standard).map_err(|error| error.to_string())?));
            }
        }
        Ok(spectra)
    }

    /// The spectrum of material `index` after its handle number `handle` was drawn to `value`; `was` is the spectrum
    /// before. Samples near the handle follow the smooth curve through all handles (Catmull and Rom 1974); samples two
    /// or more handles away stay. Moved samples are clamped to 0 to 1.
    #[must_use]
    pub fn drawn(index: usize, was: &Spectrum, handle: usize, value: f64) -> Self {
        let band = handle.min(HANDLES - 1) * BANDS_PER_HANDLE;
        let moved = value.clamp(0.0, 1.0) - was.samples()[band];
        let spectrum = Spectrum::from_samples(std::array::from_fn(|at| {
            let (sample, share) = (was.samples()[at], goes_along(at, band));
            if share == 0.0 { sample } else { moved.mul_add(share, sample).clamp(0.0, 1.0) }
        }));
        let materials = Reflectance::new(spectrum).map(|spectrum| (index, spectrum)).into_iter().collect();
        Self { materials, ..Self::default() }
    }

    /// Replaces the spectra of `scene`.
    pub(crate) fn put_into(&self, scene: &mut Scene) {
        for (index, reflectance) in &self.materials {
            if let Some(material) = scene.materials.get_mut(*index) {
                material.reflectance = reflectance.clone();
            }
        }
        for (index, spectrum) in &self.lights {
            if let Some(light) = scene.lights.get_mut(*index) {
                light.spectrum = spectrum.clone();
            }
        }
        if let (Some(background), true) = (&self.background, scene.background.is_some()) {
            scene.background = Some(background.clone());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_handle_that_is_drawn_takes_its_neighbourhood_along_smoothly_and_nothing_leaves_what_surfaces_reflect() {
        let drawn = |was: &Spectrum, handle, value| {
            let spectra = Spectra::drawn(3, was, handle, value);
            assert_eq!((spectra.materials.len(), spectra.materials[0].0), (1, 3));
            *spectra.materials[0].1.spectrum().samples()
        };
        let grey = Spectrum::constant(0.5);
        for handle in 0..HANDLES {
            let samples = drawn(&grey, handle, 0.7);
            for other in 0..HANDLES {
                let wanted = if other == handle { 0.7 } else { 0.5 };
                assert!((samples[other * BANDS_PER_HANDLE] - wanted).abs() <= 1e-15, "{handle}, {other}");
            }
            let bends = samples.windows(3).map(|three| (three[0] - 2.0 * three[1] + three[2]).abs());
            assert!(bends.fold(0.0, f64::max) <= 0.2 * 5.0 / 100.0, "no corner: a second derivative of 5 at most");
            assert!(
                drawn(&grey, handle, 9.0).iter().chain(&drawn(&grey, handle, -1.0)).all(|it| (0.0..=1.0).contains(it))
            );
        }
        // All handles moved by the same amount move the whole curve, including its ends.
        let all = (0..HANDLES).fold(grey, |was, handle| Spectrum::from_samples(drawn(&was, handle, 0.7)));
        assert!(all.samples().iter().all(|sample| (sample - 0.7).abs() <= 1e-12), "{:?}", all.samples());
        let artificial = Spectrum::from_fn(|nm| if nm < 500.0 { -2.0 } else { 0.5 });
        assert_eq!(drawn(&artificial, 8, 0.1)[0].to_bits(), (-2.0_f64).to_bits(), "what is far stays");
    }
}
