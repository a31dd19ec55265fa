//! Probe of a pixel: its spectrum, its colour under each light, the materials it shows, and the samples along its ray.

use glam::DVec3;
use serde_json::{Value, json};

use crate::film::{Components, Film, RelightMatrices, Relightable};
use crate::number::count;
use crate::plan::{Planned, Transmittance, plan_full_spectrum};
use crate::progress::Progress;
use crate::reference::{Exact, KeptDepths, RaySample, ReferenceError, march_ray};
use crate::scene::{Medium, Mix, MixLight, Scene, ShadowMethod};
use crate::spectrum::colour::{
    Lab, LinearSrgb, OBSERVER, XYZ_FROM_LINEAR_SRGB, Xyz, ciede2000, d65_white, display_code, lab_from_xyz,
};
use crate::spectrum::{BANDS, Spectrum};
use crate::tables::{LabelMap, Reflected, Storage};
use crate::volume::{Statistics, VolumeError, index_of_coarse};

/// Factor by which the steps of the truth are shorter than those of the picture.
const FINER: f64 = 8.0;
/// Largest number of segments kept per ray.
const STRETCHES: usize = 240;

/// Film of one pixel of a picture.
#[derive(Clone, Debug)]
pub struct Pixel {
    /// Pixel coordinates from the left and from the top.
    pub place: [usize; 2],
    /// Pixels of the picture, across and down.
    pub size: [usize; 2],
    /// Film with one pixel.
    pub numbers: Film<f32>,
    /// Plan of the film.
    pub planned: Planned,
    /// Meaning of the film; the background and the display are those of the scene that a probe is made with.
    pub means: Relightable,
}

/// Displayed colour, with exposure and adaptation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shown(
    /// Linear sRGB.
    pub DVec3,
);

impl Shown {
    /// CIE L*a*b* relative to D65.
    #[must_use]
    pub fn lab(self) -> Lab {
        lab_from_xyz(Xyz((*XYZ_FROM_LINEAR_SRGB * self.0).to_array()), d65_white())
    }

    /// `#rrggbb`, the nearest displayable colour.
    #[must_use]
    pub fn code(self) -> String {
        display_code(LinearSrgb(self.0.to_array()))
    }

    /// ΔE00 from `other`.
    #[must_use]
    pub fn difference(self, other: Self) -> f64 {
        if self == other { 0.0 } else { ciede2000(self.lab(), other.lab()) }
    }

    /// CIE luminance, relative to the display white.
    fn luminance(self) -> f64 {
        (*XYZ_FROM_LINEAR_SRGB * self.0).y
    }
}

/// Colour under a light, with its error if known.
#[derive(Clone, Debug, PartialEq)]
pub struct Lit {
    /// Name of the light.
    pub name: String,
    /// The colour.
    pub shown: Shown,
    /// ΔE00 against the truth.
    pub error: Option<Error>,
}

/// Error of a colour against the truth, in ΔE00.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Error {
    /// Total error, against full spectra with steps of an eighth of the picture's length.
    pub all: f64,
    /// Error against full spectra with the picture's own steps: colour model, tables, rounding and early ray
    /// termination.
    pub model: f64,
}

/// Contribution to a pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Share {
    /// Name of the material, light position or other contributor.
    pub name: String,
    /// Visible amount regardless of shading, 1 for a full pixel; `None` for highlights and light positions, and before
    /// the ray
    /// was marched.
    pub seen: Option<f64>,
    /// Sum of the accumulators, 1 for a full pixel; includes the shading for materials, summed over light positions.
    pub weight: f64,
    /// Fraction of the pixel's luminance under the current mix; all fractions add up to 1 unless the pixel is black.
    pub light: f64,
}

/// Everything known about a pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Probe {
    /// Pixel coordinates from the left and from the top.
    pub place: [usize; 2],
    /// Pixels of the picture, across and down.
    pub size: [usize; 2],
    /// Displayed colour under the current mix.
    pub now: Lit,
    /// Colours under each light of the scene alone, at the intensity given in the scene.
    pub lights: Vec<Lit>,
    /// Radiance at the eye under the current mix; `None` until the coefficients of a colour model are reconstructed.
    pub spectrum: Option<Spectrum>,
    /// Radiance of materials and background under light of power 1 at all wavelengths from every light position.
    pub reflectance: Option<Spectrum>,
    /// RMS error of spectra reconstructed from a colour model's coefficients, relative to white. `None` for exact
    /// spectra.
    pub spectral_error: Option<f64>,
    /// Contributions of materials, highlights and background; materials are absent from coefficient films.
    pub shares: Vec<Share>,
    /// Contributions of the light positions.
    pub positions: Vec<Share>,
    /// Transmittance under the current mix.
    pub transmittance: f64,
    /// Visible amount of each material of the scene along the ray, regardless of shading; 1 for a full pixel. Empty
    /// before
    /// the ray was marched.
    pub seen: Vec<f64>,
    /// Light absorbed by each material of the scene that would otherwise reach the eye, weighted by luminance. Empty
    /// before
    /// the ray was marched.
    pub absorbed: Vec<f64>,
    /// Voxels whose mean is one of the coarse level that the ray was marched in; `None` if it is the volume itself. Errors
    /// are unknown then.
    pub level: Option<usize>,
    /// Segments of the ray, from the eye on; empty if it misses the rendered part of the volume. `None` before it was
    /// marched.
    pub ray: Option<Vec<Stretch>>,
}

impl Probe {
    /// Creates the probe of `pixel` of `scene` under `mix`. `reflected` holds the spectra of its components and `ray`
    /// its
    /// marched ray, once available.
    #[must_use]
    pub fn new(pixel: &Pixel, scene: &Scene, mix: &Mix, reflected: Option<&Reflected>, ray: Option<&Ray>) -> Self {
        let (numbers, positions) = (&pixel.numbers, pixel.planned.positions.len());
        let background = scene.background.as_ref();
        let matrices = |mix: &Mix| pixel.means.under_on(mix, background, &scene.display);
        let lit = |name: &str, mix: &Mix| {
            let shown = Shown(only(numbers.relight(&matrices(mix))));
            let error = ray.filter(|ray| ray.level.is_none()).map(|ray| {
                let [all, model] = ray.colours(scene, mix).map(|truth| shown.difference(truth));
                Error { all, model }
            });
            Lit { name: name.to_owned(), shown, error }
        };
        let alone = pixel.planned.positions.iter().enumerate().flat_map(|(position, place)| {
            let lights = place.lights.iter().filter_map(|&light| Some((light, scene.lights.get(light)?)));
            lights.map(move |(index, light)| {
                let (name, spectrum) = (light.name.clone(), light.spectrum.clone());
                (index, MixLight { name, spectrum, weight: light.intensity, position })
            })
        });
        let mut alone: Vec<(usize, MixLight)> = alone.collect();
        alone.sort_by_key(|(index, _)| *index);
        let lights = alone.into_iter().map(|(_, light)| lit(&light.name.clone(), &Mix(vec![light]))).collect();
        let spectrum = |mix: &Mix| reflected.map(|reflected| spectrum(reflected, numbers, mix, positions));
        let now = matrices(mix);
        let through =
            numbers.transmittance.iter().zip(&now.transmittance_weights).map(|(&left, share)| f64::from(left) * share);
        let (shares, of_positions) = shares(pixel, scene, &now, ray);
        Self {
            place: pixel.place,
            size: pixel.size,
            now: lit("now", mix),
            lights,
            spectrum: spectrum(mix),
            reflectance: reflected.map(|reflected| {
                let components = reflected.components.iter().cycle().zip(&numbers.accumulators);
                let sent =
                    components.fold(Spectrum::constant(0.0), |sum, (part, &weight)| &sum + &part.scaled(weight.into()));
                // The background is lit from every light position.
                let behind = reflected.behind.iter().zip(&numbers.transmittance);
                behind.fold(sent, |sum, (part, &left)| &sum + &part.scaled(count(positions) * f64::from(left)))
            }),
            spectral_error: reflected.and_then(|reflected| Some(reflected.reconstruction.as_ref()?.rms)),
            shares,
            positions: of_positions,
            transmittance: through.sum(),
            seen: ray.map_or_else(Vec::new, |ray| ray.seen.clone()),
            absorbed: ray.map_or_else(Vec::new, |ray| ray.absorbed.clone()),
            level: ray.and_then(|ray| ray.level),
            ray: ray.map(|ray| ray.stretches.clone()),
        }
    }

    /// Segment with the most visible scattering; `None` before the ray was marched, or if nothing is visible.
    #[must_use]
    pub fn brightest(&self) -> Option<&Stretch> {
        let seen = |stretch: &&Stretch| stretch.transmittance * stretch.scattering.iter().sum::<f64>();
        let stretches = self.ray.iter().flatten().filter(|stretch| seen(stretch) > 0.0);
        stretches.max_by(|one, two| seen(one).total_cmp(&seen(two)))
    }

    /// Returns the probe as JSON.
    #[must_use]
    pub fn json(&self, scene: &Scene) -> Value {
        let lit = |lit: &Lit| {
            json!({
                "light": lit.name,
                "linear_srgb": lit.shown.0.to_array(),
                "lab": lit.shown.lab().0,
                "code": lit.shown.code(),
                "error": lit.error.map(|error| error.all),
                "model_error": lit.error.map(|error| error.model),
            })
        };
        let share = |share: &Share| json!({"name": share.name, "weight": share.weight, "light": share.light});
        let by_name = |parts: &[f64]| {
            let materials = scene.materials.iter().map(|material| material.name.clone());
            materials.zip(parts.to_vec()).collect::<std::collections::BTreeMap<_, _>>()
        };
        let samples = |spectrum: &Option<Spectrum>| spectrum.as_ref().map(|spectrum| spectrum.samples().to_vec());
        json!({
            "pixel": self.place,
            "size": self.size,
            "now": lit(&self.now),
            "lights": self.lights.iter().map(lit).collect::<Vec<_>>(),
            "spectrum": samples(&self.spectrum),
            "reflectance": samples(&self.reflectance),
            "spectral_error": self.spectral_error,
            "shares": self.shares.iter().map(share).collect::<Vec<_>>(),
            "positions": self.positions.iter().map(share).collect::<Vec<_>>(),
            "transmittance": self.transmittance,
            "voxels_per_sample": self.level,
            "seen": by_name(&self.seen),
            "absorbed": by_name(&self.absorbed),
            "ray": self.ray.iter().flatten().map(|stretch| json!({
                "distance": stretch.distance,
                "value": stretch.value,
                "opacity": stretch.opacity,
                "transmittance": stretch.transmittance,
            })).collect::<Vec<_>>(),
        })
    }
}

/// Colour of a picture with one pixel.
fn only(picture: Vec<DVec3>) -> DVec3 {
    picture.into_iter().next().unwrap_or_default()
}

/// Radiance of the film's pixel under `mix`.
fn spectrum(reflected: &Reflected, numbers: &Film<f32>, mix: &Mix, positions: usize) -> Spectrum {
    let [parts, behind] = reflected.under(mix, positions);
    let kept = parts.iter().zip(&numbers.accumulators).chain(behind.iter().zip(&numbers.transmittance));
    kept.fold(Spectrum::constant(0.0), |sum, (part, &number)| &sum + &part.scaled(f64::from(number)))
}

/// Contributions of materials, highlights and background, and of light positions, to `pixel`.
fn shares(pixel: &Pixel, scene: &Scene, matrices: &RelightMatrices, ray: Option<&Ray>) -> (Vec<Share>, Vec<Share>) {
    let (numbers, planned) = (&pixel.numbers, &pixel.planned);
    let parts = planned.plan.components();
    let sent: Vec<f64> = (numbers.accumulators.iter().zip(&matrices.colours))
        .map(|(&weight, &colour)| f64::from(weight) * Shown(colour).luminance())
        .collect();
    let behind: f64 = (numbers.transmittance.iter().zip(&matrices.background))
        .map(|(&left, &colour)| f64::from(left) * Shown(colour).luminance())
        .sum();
    let all = sent.iter().sum::<f64>() + behind;
    let of = |light: f64| if all > 0.0 { light / all } else { 0.0 };
    let share = |name: &str, seen: Option<f64>, weight: f64, light: f64| Share {
        name: name.to_owned(),
        seen,
        weight,
        light: of(light),
    };
    let mut shares = Vec::new();
    if let Components::Surfaces(_) = pixel.means.components {
        let seen = |material: usize| ray.and_then(|ray| ray.seen.get(material)).copied();
        let named = |&material: &usize| Some((scene.materials.get(material)?.name.as_str(), seen(material)));
        let matter = planned.materials.iter().filter_map(named);
        let all = matter.chain(planned.plan.specular().map(|_| ("highlights", None)));
        for (part, (name, seen)) in all.enumerate() {
            let here = |numbers: &mut dyn Iterator<Item = f64>| numbers.skip(part).step_by(parts.max(1)).sum();
            let weight = here(&mut numbers.accumulators.iter().map(|&weight| f64::from(weight)));
            shares.push(share(name, seen, weight, here(&mut sent.iter().copied())));
        }
        // The first term has nearly all of a film's light; those that follow correct its colour.
        for film in planned.thin_films(scene) {
            let of = |numbers: &[f64], terms: usize| -> f64 {
                let of_position = |numbers: &[f64]| numbers.iter().skip(film.first).take(terms).sum::<f64>();
                numbers.chunks(parts.max(1)).map(of_position).sum()
            };
            let weights: Vec<f64> = numbers.accumulators.iter().map(|&weight| f64::from(weight)).collect();
            let name = format!("{} film", film.material.name);
            shares.push(share(&name, None, of(&weights, 1), of(&sent, film.terms)));
        }
    }
    if planned.plan.background {
        let through: f64 =
            numbers.transmittance.iter().zip(&matrices.transmittance_weights).map(|(&t, p)| f64::from(t) * p).sum();
        shares.push(share("background", Some(through), through, behind));
    }
    let places = planned.positions.iter().enumerate().map(|(position, place)| {
        let here = position * parts..(position + 1) * parts;
        let weight =
            numbers.accumulators.get(here.clone()).map_or(0.0, |weights| weights.iter().copied().map(f64::from).sum());
        let light = sent.get(here).map_or(0.0, |sent| sent.iter().sum());
        share(&place.name, None, weight, light)
    });
    (shares, places.collect())
}

/// Segment of a ray.
#[derive(Clone, Debug, PartialEq)]
pub struct Stretch {
    /// Distance of its middle from the ray's entry point, in world units.
    pub distance: f64,
    /// Its middle in voxel indices; the centre of the first voxel is 0.
    pub place: DVec3,
    /// Mean data value.
    pub value: f64,
    /// Mean gradient magnitude, in data units per world unit.
    pub magnitude: f64,
    /// Opacity of the segment.
    pub opacity: f64,
    /// Transmittance from the segment to the eye.
    pub transmittance: f64,
    /// Optical depth of the scattering of each material of the scene.
    pub scattering: Vec<f64>,
    /// Optical depth of the absorption of each material, at the peak of its spectrum.
    pub absorption: Vec<f64>,
}

/// Ray marched with full spectra: its segments and its true radiance.
#[derive(Clone, Debug)]
pub struct Ray {
    means: Relightable,
    /// Films with an eighth of the picture's step length, and with the picture's own.
    marched: [Film<f64>; 2],
    /// Segments, from the eye on.
    pub stretches: Vec<Stretch>,
    /// Voxels whose mean is one of the coarse level that was marched, if it was not the volume itself.
    level: Option<usize>,
    /// Visible amount of each material of the scene along the ray, regardless of shading; weighted by luminance if the
    /// transmittance is coloured.
    pub seen: Vec<f64>,
    /// Light absorbed by each material of the scene, with the same weighting.
    pub absorbed: Vec<f64>,
}

/// Reason why a ray cannot be marched.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ProbeError {
    /// Error of the reference renderer.
    #[error(transparent)]
    Reference(#[from] ReferenceError),
    /// The labels are unusable.
    #[error(transparent)]
    Volume(#[from] VolumeError),
}

impl ProbeError {
    /// Name for programs; it does not change between versions.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Reference(error) => error.code(),
            Self::Volume(error) => error.code(),
        }
    }
}

impl Ray {
    /// Marches the ray through pixel `place` of a picture of `size` of `scene` in f64, with 81 wavelengths, exact
    /// samples and
    /// no tables: once with the picture's own steps, and once with an eighth of their length and without early ray
    /// termination. If the fine march has too many samples, the own steps serve as the truth.
    ///
    /// # Errors
    ///
    /// [`ProbeError`].
    pub fn march(
        scene: &Scene,
        statistics: &Statistics,
        [size, place]: [[usize; 2]; 2],
        progress: &dyn Progress,
    ) -> Result<Self, ProbeError> {
        // One ray reads few of the nodes of a light grid.
        let mut rays = scene.clone();
        rays.shadows.method = ShadowMethod::Rays;
        let scene = &rays;
        let planned = plan_full_spectrum(scene);
        let labels = scene.labels.as_ref().filter(|_| planned.plan.labels).map(LabelMap::new).transpose()?;
        let storage = || Storage::new(&planned.plan, scene.volume(), statistics);
        // Both marches read the same scattered light.
        let kept = KeptDepths::default();
        let exact = Exact::new(scene, &planned, storage(), labels.as_ref()).keeping_depths(&kept);
        let mut profile = Profile::new(scene);
        let dims = DVec3::from_array(scene.frame.geometry.dims.map(count));
        let own = march_ray(scene, &planned, &exact, [size, place], progress, |sample: &RaySample<'_, f64>| {
            let place = DVec3::from_array(sample.place) * dims - 0.5;
            let magnitude = exact.magnitude_at(sample.place);
            let (value, label) = exact.at(sample.place);
            if scene.blending.is_extreme() {
                // Only the samples of extreme values are seen.
                profile.travelled = count(sample.index);
            }
            let medium = exact.medium_at(sample.place, label);
            profile.add((place, medium), value, [magnitude, sample.length], sample.transmittance);
        })?;
        let mut finer = scene.clone();
        finer.accuracy.step_length /= FINER;
        finer.accuracy.termination = 0.0;
        let exact = Exact::new(&finer, &planned, storage(), labels.as_ref()).keeping_depths(&kept);
        let truth = match march_ray(&finer, &planned, &exact, [size, place], progress, |_| {}) {
            Err(ReferenceError::TooManySamples { .. }) => own.clone(),
            marched => marched?,
        };
        let means = Relightable::new(scene, &planned);
        let Profile { stretches, seen, absorbed, .. } = profile;
        Ok(Self { means, marched: [truth, own], stretches, level: None, seen, absorbed })
    }

    /// The ray of a volume of which a coarse level of blocks of `block` voxels was marched, with its places in voxel indices
    /// of the volume; `None` leaves it as it is.
    pub(super) fn of_blocks(mut self, block: Option<[usize; 3]>) -> Self {
        if let Some(block) = block {
            self.level = Some(block.iter().product());
            self.stretches.iter_mut().for_each(|stretch| stretch.place = index_of_coarse(stretch.place, block));
        }
        self
    }

    /// Colours under `mix`: with an eighth of the picture's step length, and with its own.
    #[must_use]
    pub fn colours(&self, scene: &Scene, mix: &Mix) -> [Shown; 2] {
        let matrices = self.means.under_on(mix, scene.background.as_ref(), &scene.display);
        self.marched.each_ref().map(|marched| Shown(only(marched.relight(&matrices))))
    }
}

/// Accumulates the segments of a ray sample by sample.
struct Profile<'a> {
    scene: &'a Scene,
    /// Luminance weight of each component of the transmittance; the weights add up to 1.
    eye: Vec<f64>,
    /// Samples per segment; doubled when there are too many segments.
    per_stretch: usize,
    samples: usize,
    /// Length of the ray so far, in steps.
    travelled: f64,
    stretches: Vec<Stretch>,
    seen: Vec<f64>,
    absorbed: Vec<f64>,
}

impl<'a> Profile<'a> {
    fn new(scene: &'a Scene) -> Self {
        let planned = plan_full_spectrum(scene);
        let luminance = &OBSERVER[1];
        let eye = match planned.plan.transmittance {
            Transmittance::Grey => vec![1.0],
            Transmittance::Coloured | Transmittance::Mixed => {
                luminance.samples().map(|sample| sample / luminance.sum()).to_vec()
            }
        };
        let none = vec![0.0; scene.materials.len()];
        Self {
            scene,
            eye,
            per_stretch: 1,
            samples: 0,
            travelled: 0.0,
            stretches: Vec::new(),
            seen: none.clone(),
            absorbed: none,
        }
    }

    /// Adds the next sample: its place and the medium there, its value, the gradient magnitude
    /// and the length in steps, and the transmittance to the eye.
    fn add(
        &mut self,
        (place, medium): (DVec3, Medium),
        value: f64,
        [magnitude, length]: [f64; 2],
        transmittance: &[f64],
    ) {
        let scene = self.scene;
        let lengths = if scene.blending.is_extreme() {
            length
        } else {
            length * scene.step_length() / scene.transfer.opacity_length
        };
        let grey = medium.occluding(&scene.materials) * lengths;
        let [scattering, absorption] = [medium.scattering, medium.absorption]
            .map(|depths| depths.into_iter().map(|depth| depth * lengths).collect::<Vec<f64>>());
        let absorbing: Vec<(usize, &Spectrum, f64)> = (scene.materials.iter().zip(&absorption).enumerate())
            .filter_map(|(index, (material, &depth))| Some((index, material.absorption.as_ref()?.spectrum(), depth)))
            .filter(|(_, _, depth)| *depth > 0.0)
            .collect();
        let (mut transmitted, mut hides, mut gain) = (0.0, 0.0, 0.0);
        for ((&eye, &left), band) in self.eye.iter().zip(transmittance).zip(0..BANDS) {
            let depth = absorbing.iter().fold(grey, |sum, (_, shape, depth)| sum + depth * shape.samples()[band]);
            let opacity = -(-depth).exp_m1();
            transmitted += eye * left;
            hides += eye * opacity;
            let each = eye * left * if depth > 0.0 { opacity / depth } else { 1.0 };
            gain += each;
            for &(index, shape, depth) in &absorbing {
                self.absorbed[index] += each * depth * shape.samples()[band];
            }
        }
        for (seen, depth) in self.seen.iter_mut().zip(&scattering) {
            *seen += gain * depth;
        }
        let at = scene.step_length() * (self.travelled + length / 2.0);
        self.travelled += length;
        if self.samples.is_multiple_of(self.per_stretch) {
            if self.stretches.len() == STRETCHES {
                self.halve();
            }
            self.stretches.push(Stretch {
                distance: 0.0,
                place: DVec3::ZERO,
                value: 0.0,
                magnitude: 0.0,
                opacity: 0.0,
                transmittance: transmitted,
                scattering: vec![0.0; scene.materials.len()],
                absorption: vec![0.0; scene.materials.len()],
            });
        }
        let here = count(self.samples % self.per_stretch + 1);
        if let Some(stretch) = self.stretches.last_mut() {
            stretch.distance += (at - stretch.distance) / here;
            stretch.place += (place - stretch.place) / here;
            stretch.value += (value - stretch.value) / here;
            stretch.magnitude += (magnitude - stretch.magnitude) / here;
            stretch.opacity += (1.0 - stretch.opacity) * hides;
            let depths = [(&mut stretch.scattering, &scattering), (&mut stretch.absorption, &absorption)];
            for (sums, depths) in depths {
                sums.iter_mut().zip(depths).for_each(|(sum, depth)| *sum += depth);
            }
        }
        self.samples += 1;
    }

    /// Merges the segments in pairs; their number is even.
    fn halve(&mut self) {
        let sum = |one: &[f64], two: &[f64]| one.iter().zip(two).map(|(one, two)| one + two).collect();
        let pairs = self.stretches.chunks_exact(2).map(|pair| Stretch {
            distance: f64::midpoint(pair[0].distance, pair[1].distance),
            place: pair[0].place.midpoint(pair[1].place),
            value: f64::midpoint(pair[0].value, pair[1].value),
            magnitude: f64::midpoint(pair[0].magnitude, pair[1].magnitude),
            opacity: pair[0].opacity + (1.0 - pair[0].opacity) * pair[1].opacity,
            transmittance: pair[0].transmittance,
            scattering: sum(&pair[0].scattering, &pair[1].scattering),
            absorption: sum(&pair[0].absorption, &pair[1].absorption),
        });
        self.stretches = pairs.collect();
        self.per_stretch *= 2;
    }
}
