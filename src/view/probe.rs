//! What a pixel is: its spectrum, its colour under each light, what it shows, and what its ray meets on the way.

use glam::DVec3;
use serde_json::{Value, json};

use crate::film::{Components, Film, RelightMatrices};
use crate::number::count;
use crate::plan::{Planned, Transmittance, plan_full_spectrum};
use crate::progress::Progress;
use crate::reference::{Exact, RaySample, ReferenceError, march_ray};
use crate::scene::{Mix, MixLight, Scene, depth_from_opacity};
use crate::spectrum::colour::{
    Lab, LinearSrgb, OBSERVER, XYZ_FROM_LINEAR_SRGB, Xyz, ciede2000, d65_white, display_code, lab_from_xyz,
};
use crate::spectrum::{BANDS, Spectrum};
use crate::tables::{LabelMap, Reflected, Storage};
use crate::volume::{Statistics, VolumeError};

/// How many times shorter the steps of the truth are than those of the picture.
const FINER: f64 = 8.0;
/// Stretches of a ray that are kept.
const STRETCHES: usize = 240;

/// What a picture keeps of one of its pixels.
#[derive(Clone, Debug)]
pub struct Pixel {
    /// Which, from the left and from the top.
    pub place: [usize; 2],
    /// Pixels of the picture, across and down.
    pub size: [usize; 2],
    /// Its numbers, as an accumulation of one pixel.
    pub numbers: Film<f32>,
    /// What they are about.
    pub planned: Planned,
    /// What they stand for.
    pub components: Components,
}

/// A colour as it is shown, exposure and adaptation in it.
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

    /// `#rrggbb`, the nearest that a screen can show.
    #[must_use]
    pub fn code(self) -> String {
        display_code(LinearSrgb(self.0.to_array()))
    }

    /// ΔE00 from `other`.
    #[must_use]
    pub fn difference(self, other: Self) -> f64 {
        if self == other { 0.0 } else { ciede2000(self.lab(), other.lab()) }
    }

    /// CIE luminance; the white of the screen has 1.
    fn luminance(self) -> f64 {
        (*XYZ_FROM_LINEAR_SRGB * self.0).y
    }
}

/// A colour, and how far from the truth it is, where that is known.
#[derive(Clone, Debug, PartialEq)]
pub struct Lit {
    /// What lights it.
    pub name: String,
    /// The colour.
    pub shown: Shown,
    /// ΔE00 from the truth.
    pub error: Option<Error>,
}

/// How far a colour is from the truth, in ΔE00.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Error {
    /// All in all: from full spectra at an eighth of the picture's steps.
    pub all: f64,
    /// From full spectra at the picture's own steps: what the colour model, tables and rounding do, and the end of rays.
    pub model: f64,
}

/// What something has to do with a pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Share {
    /// The material, the place that light comes from, or what else it is.
    pub name: String,
    /// How much of the pixel it is, whatever its shade; `None` of what is no matter, and before the ray was marched.
    pub seen: Option<f64>,
    /// How much of it is seen: 1 fills the pixel. Of materials, times their shade, summed over the places of lights.
    pub weight: f64,
    /// Its part in the luminance of the pixel as it is lit now; all parts add up to 1 where there is any.
    pub light: f64,
}

/// What a pixel is.
#[derive(Clone, Debug, PartialEq)]
pub struct Probe {
    /// Which, from the left and from the top.
    pub place: [usize; 2],
    /// Pixels of the picture, across and down.
    pub size: [usize; 2],
    /// Its colour as it is shown now.
    pub now: Lit,
    /// Its colour under each light of the scene alone, as strong as the scene states.
    pub lights: Vec<Lit>,
    /// What reaches the eye as it is lit now; `None` before the numbers of a colour model are turned into spectra.
    pub spectrum: Option<Spectrum>,
    /// What materials and background would send to the eye where light of power 1 at all wavelengths shone from each place.
    pub reflectance: Option<Spectrum>,
    /// Of spectra that are made of a colour model's numbers: the root of their mean squared error, as a share of what white
    /// sends there. `None` where they are exact.
    pub spectral_error: Option<f64>,
    /// The materials, highlights and the background. Where a pixel keeps a colour model's numbers, none of the materials.
    pub shares: Vec<Share>,
    /// The places that light comes from.
    pub positions: Vec<Share>,
    /// How much light passes, as it is lit now.
    pub transmittance: f64,
    /// How much of each material of the scene is seen along the ray, whatever its shade: 1 fills the pixel. Empty before
    /// the ray was marched.
    pub seen: Vec<f64>,
    /// What each material of the scene takes by absorbing of the light that would pass to the eye, as a grey eye sees it. Empty
    /// before the ray was marched.
    pub absorbed: Vec<f64>,
    /// What the ray meets, from the eye on: nothing where it misses what is shown of the volume. `None` before it was marched.
    pub ray: Option<Vec<Stretch>>,
}

impl Probe {
    /// What `pixel` of `scene` is under `mix`. `reflected` is what its numbers stand for, `ray` what is known of its ray,
    /// where they are there yet.
    #[must_use]
    pub fn new(pixel: &Pixel, scene: &Scene, mix: &Mix, reflected: Option<&Reflected>, ray: Option<&Ray>) -> Self {
        let (numbers, positions) = (&pixel.numbers, pixel.planned.positions.len());
        let background = scene.background.as_ref();
        let matrices = |mix: &Mix| RelightMatrices::new(&pixel.components, positions, background, mix, &scene.display);
        let lit = |name: &str, mix: &Mix| {
            let shown = Shown(only(numbers.relight(&matrices(mix))));
            let error = ray.map(|ray| {
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
        let through = numbers
            .transmittance
            .iter()
            .zip(&now.transmittance_weights)
            .map(|(&passed, share)| f64::from(passed) * share);
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
                // The background is lit from every place.
                let behind = reflected.behind.iter().zip(&numbers.transmittance);
                behind.fold(sent, |sum, (part, &passed)| &sum + &part.scaled(count(positions) * f64::from(passed)))
            }),
            spectral_error: reflected.and_then(|reflected| Some(reflected.reconstruction.as_ref()?.rms)),
            shares,
            positions: of_positions,
            transmittance: through.sum(),
            seen: ray.map_or_else(Vec::new, |ray| ray.seen.clone()),
            absorbed: ray.map_or_else(Vec::new, |ray| ray.absorbed.clone()),
            ray: ray.map(|ray| ray.stretches.clone()),
        }
    }

    /// Where along the ray most is seen; `None` before that was marched, and where nothing is.
    #[must_use]
    pub fn brightest(&self) -> Option<&Stretch> {
        let seen = |stretch: &&Stretch| stretch.transmittance * stretch.scattering.iter().sum::<f64>();
        let met = self.ray.iter().flatten().filter(|stretch| seen(stretch) > 0.0);
        met.max_by(|one, two| seen(one).total_cmp(&seen(two)))
    }

    /// The same for programs.
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

/// The colour of a picture of one pixel.
fn only(picture: Vec<DVec3>) -> DVec3 {
    picture.into_iter().next().unwrap_or_default()
}

/// The spectrum that `numbers` send to the eye under `mix`.
fn spectrum(reflected: &Reflected, numbers: &Film<f32>, mix: &Mix, positions: usize) -> Spectrum {
    let [parts, behind] = reflected.under(mix, positions);
    let kept = parts.iter().zip(&numbers.accumulators).chain(behind.iter().zip(&numbers.transmittance));
    kept.fold(Spectrum::constant(0.0), |sum, (part, &number)| &sum + &part.scaled(f64::from(number)))
}

/// What materials, highlights and background, and what places of lights have to do with `pixel`.
fn shares(pixel: &Pixel, scene: &Scene, matrices: &RelightMatrices, ray: Option<&Ray>) -> (Vec<Share>, Vec<Share>) {
    let (numbers, planned) = (&pixel.numbers, &pixel.planned);
    let parts = planned.plan.components();
    let sent: Vec<f64> = (numbers.accumulators.iter().zip(&matrices.colours))
        .map(|(&weight, &colour)| f64::from(weight) * Shown(colour).luminance())
        .collect();
    let behind: f64 = (numbers.transmittance.iter().zip(&matrices.background))
        .map(|(&passed, &colour)| f64::from(passed) * Shown(colour).luminance())
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
    if let Components::Surfaces(_) = pixel.components {
        let seen = |material: usize| ray.and_then(|ray| ray.seen.get(material)).copied();
        let named = |&material: &usize| Some((scene.materials.get(material)?.name.as_str(), seen(material)));
        let matter = planned.materials.iter().filter_map(named);
        let all = matter.chain(planned.plan.specular().map(|_| ("highlights", None)));
        for (part, (name, seen)) in all.enumerate() {
            let here = |numbers: &mut dyn Iterator<Item = f64>| numbers.skip(part).step_by(parts.max(1)).sum();
            let weight = here(&mut numbers.accumulators.iter().map(|&weight| f64::from(weight)));
            shares.push(share(name, seen, weight, here(&mut sent.iter().copied())));
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

/// What a ray meets on a stretch of its way.
#[derive(Clone, Debug, PartialEq)]
pub struct Stretch {
    /// Its middle, in world units behind where the ray enters.
    pub distance: f64,
    /// The same as a place in the volume, in voxels from the middle of the first.
    pub place: DVec3,
    /// The mean of the data values.
    pub value: f64,
    /// What of the light behind it it hides.
    pub opacity: f64,
    /// What of the light in front of it passes to the eye.
    pub transmittance: f64,
    /// Optical depth that each material of the scene scatters with.
    pub scattering: Vec<f64>,
    /// Optical depth that each absorbs with, where it absorbs most.
    pub absorption: Vec<f64>,
}

/// A ray in full spectra: what it meets, and what truly comes back.
#[derive(Clone, Debug)]
pub struct Ray {
    components: Components,
    positions: usize,
    /// At an eighth of the picture's steps, and at its own.
    marched: [Film<f64>; 2],
    /// What it meets, from the eye on.
    pub stretches: Vec<Stretch>,
    /// How much of each material of the scene is seen along it, whatever its shade; to a grey eye, where what passes has a
    /// colour.
    pub seen: Vec<f64>,
    /// What each material of the scene takes of the light by absorbing it, to that eye.
    pub absorbed: Vec<f64>,
}

/// Why a ray cannot be followed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ProbeError {
    /// The reference gave up.
    #[error(transparent)]
    Reference(#[from] ReferenceError),
    /// The labels cannot be used.
    #[error(transparent)]
    Volume(#[from] VolumeError),
}

impl Ray {
    /// Follows the ray through pixel `place` of a picture of `size` of `scene` in f64, with 81 wavelengths, exact samples and
    /// no tables: at the picture's own steps, and at an eighth of them to its end, where so many can be counted.
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
        let planned = plan_full_spectrum(scene);
        let labels = scene.labels.as_ref().filter(|_| planned.plan.labels).map(LabelMap::new).transpose()?;
        let storage = || Storage::new(&planned.plan, &scene.volume, statistics);
        let exact = Exact::new(scene, &planned, storage(), labels.as_ref());
        let mut profile = Profile::new(scene);
        let dims = DVec3::from_array(scene.volume.geometry.dims.map(count));
        let own = march_ray(scene, &planned, &exact, [size, place], progress, |sample: &RaySample<'_, f64>| {
            let place = DVec3::from_array(sample.place) * dims - 0.5;
            profile.add(place, exact.at(sample.place), sample.transmittance);
        })?;
        let mut finer = scene.clone();
        finer.accuracy.step_length /= FINER;
        finer.accuracy.termination = 0.0;
        let exact = Exact::new(&finer, &planned, storage(), labels.as_ref());
        let truth = match march_ray(&finer, &planned, &exact, [size, place], progress, |_| {}) {
            Err(ReferenceError::TooManySamples { .. }) => own.clone(),
            marched => marched?,
        };
        let components = Components::new(scene, &planned);
        let Profile { stretches, seen, absorbed, .. } = profile;
        Ok(Self { components, positions: planned.positions.len(), marched: [truth, own], stretches, seen, absorbed })
    }

    /// Its colour under `mix`: at an eighth of the picture's steps, and at its own.
    #[must_use]
    pub fn colours(&self, scene: &Scene, mix: &Mix) -> [Shown; 2] {
        let background = scene.background.as_ref();
        let matrices = RelightMatrices::new(&self.components, self.positions, background, mix, &scene.display);
        self.marched.each_ref().map(|marched| Shown(only(marched.relight(&matrices))))
    }
}

/// What a ray meets, sample by sample.
struct Profile<'a> {
    scene: &'a Scene,
    /// What a grey eye sees of each wavelength that passes; adds up to 1.
    eye: Vec<f64>,
    /// Samples a stretch; doubled when there are too many stretches.
    per_stretch: usize,
    samples: usize,
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
        Self { scene, eye, per_stretch: 1, samples: 0, stretches: Vec::new(), seen: none.clone(), absorbed: none }
    }

    /// The next sample: where it is, its value, the label that decides in its stead, and what passes from there to the eye.
    fn add(&mut self, place: DVec3, (value, label): (f64, Option<usize>), transmittance: &[f64]) {
        let scene = self.scene;
        let materials = scene.materials.len();
        let entry = label.and_then(|label| scene.labels.as_ref()?.declared.get(label));
        let medium = match entry {
            None => scene.transfer.medium(value, materials),
            Some(entry) => {
                let alone =
                    |depth: f64| (0..materials).map(|at| if at == entry.material { depth } else { 0.0 }).collect();
                let scattering = alone(depth_from_opacity(entry.opacity));
                crate::scene::Medium { scattering, absorption: alone(entry.absorption) }
            }
        };
        let lengths = scene.accuracy.step_length / scene.transfer.opacity_length;
        let occluding = scene.materials.iter().zip(&medium.scattering).filter(|(material, _)| !material.xray);
        let grey: f64 = occluding.map(|(_, depth)| depth * lengths).sum();
        let [scattering, absorption] = [medium.scattering, medium.absorption]
            .map(|depths| depths.into_iter().map(|depth| depth * lengths).collect::<Vec<f64>>());
        let absorbing: Vec<(usize, &Spectrum, f64)> = (scene.materials.iter().zip(&absorption).enumerate())
            .filter_map(|(index, (material, &depth))| Some((index, material.absorption.as_ref()?.spectrum(), depth)))
            .filter(|(_, _, depth)| *depth > 0.0)
            .collect();
        let (mut passes, mut hides, mut gain) = (0.0, 0.0, 0.0);
        for ((&eye, &passed), band) in self.eye.iter().zip(transmittance).zip(0..BANDS) {
            let depth = absorbing.iter().fold(grey, |sum, (_, shape, depth)| sum + depth * shape.samples()[band]);
            let opacity = -(-depth).exp_m1();
            passes += eye * passed;
            hides += eye * opacity;
            let each = eye * passed * if depth > 0.0 { opacity / depth } else { 1.0 };
            gain += each;
            for &(index, shape, depth) in &absorbing {
                self.absorbed[index] += each * depth * shape.samples()[band];
            }
        }
        for (seen, depth) in self.seen.iter_mut().zip(&scattering) {
            *seen += gain * depth;
        }
        let at = scene.accuracy.step_length * (count(self.samples) + 0.5);
        if self.samples.is_multiple_of(self.per_stretch) {
            if self.stretches.len() == STRETCHES {
                self.halve();
            }
            self.stretches.push(Stretch {
                distance: 0.0,
                place: DVec3::ZERO,
                value: 0.0,
                opacity: 0.0,
                transmittance: passes,
                scattering: vec![0.0; materials],
                absorption: vec![0.0; materials],
            });
        }
        let here = count(self.samples % self.per_stretch + 1);
        if let Some(stretch) = self.stretches.last_mut() {
            stretch.distance += (at - stretch.distance) / here;
            stretch.place += (place - stretch.place) / here;
            stretch.value += (value - stretch.value) / here;
            stretch.opacity += (1.0 - stretch.opacity) * hides;
            let depths = [(&mut stretch.scattering, &scattering), (&mut stretch.absorption, &absorption)];
            for (sums, depths) in depths {
                sums.iter_mut().zip(depths).for_each(|(sum, depth)| *sum += depth);
            }
        }
        self.samples += 1;
    }

    /// Makes one stretch of every two; there is an even number.
    fn halve(&mut self) {
        let sum = |one: &[f64], two: &[f64]| one.iter().zip(two).map(|(one, two)| one + two).collect();
        let pairs = self.stretches.chunks_exact(2).map(|pair| Stretch {
            distance: f64::midpoint(pair[0].distance, pair[1].distance),
            place: pair[0].place.midpoint(pair[1].place),
            value: f64::midpoint(pair[0].value, pair[1].value),
            opacity: pair[0].opacity + (1.0 - pair[0].opacity) * pair[1].opacity,
            transmittance: pair[0].transmittance,
            scattering: sum(&pair[0].scattering, &pair[1].scattering),
            absorption: sum(&pair[0].absorption, &pair[1].absorption),
        });
        self.stretches = pairs.collect();
        self.per_stretch *= 2;
    }
}
