//! Lights of intensity 0 to 1e6, alone and mixed, and lights of a few spectral lines.

use glam::DVec3;

use super::left::{delta_e, worst};
use super::slab::{GREEN, Picture, Slab};
use super::{Bound, Extreme, ExtremeError, Group};
use relume_colour::spectrum::colour::xyz_of;
use relume_colour::spectrum::{BANDS, Light, Spectrum, SpectrumError, standard};
use relume_scene::{Placement, Scene, SceneLight, Shading};

/// Constructor of a light.
type Spectral = fn() -> Result<Light, SpectrumError>;

pub(super) fn extremes() -> Vec<Extreme> {
    let mut all: Vec<Extreme> = [0.0, 1e-6, 1e6]
        .into_iter()
        .map(|intensity| {
            let bound = if intensity == 0.0 { Bound::EXACT } else { Bound::picture(8.0) };
            single(format!("a light of intensity {intensity:e}"), bound, intensity, || Ok(standard::d65().clone()))
        })
        .collect();
    all.push(single("a light of zeros".to_owned(), Bound::EXACT, 1.0, || Light::new(Spectrum::constant(0.0))));
    let darker = || Light::new(Spectrum::constant(-0.01));
    all.push(single("a light of negative power".to_owned(), Bound::picture(8.0), 1.0, darker));
    all.push(mixed());
    let lines: [(&str, Spectral); 5] = [
        ("one line at 380 nm", || line(0)),
        ("one line at 555 nm", || line(35)),
        ("one line at 780 nm", || line(80)),
        ("FL11", || standard::light("FL11")),
        ("LED-RGB1", || standard::light("LED-RGB1")),
    ];
    for (name, light) in lines {
        all.push(single(format!("a light of {name}"), Bound::picture(8.0), 1.0, light));
    }
    for (name, light) in &lines[1..] {
        // A line at an end of the spectrum shows only that end.
        if *name != "one line at 780 nm" {
            all.push(through_glass(name, *light));
        }
    }
    all.push(unlit());
    all
}

/// Light with all power in one band of 5 nm.
fn line(band: usize) -> Result<Light, SpectrumError> {
    Light::new(Spectrum::from_samples(std::array::from_fn::<_, BANDS, _>(|i| if i == band { 1.0 } else { 0.0 })))
}

/// The orange slab under one light: its opacity times the light on orange, in all 81 bands.
fn single(
    name: String,
    bound: Bound,
    intensity: f64,
    light: impl Fn() -> Result<Light, SpectrumError> + Copy + Send + Sync + 'static,
) -> Extreme {
    let slab = Slab::default();
    let (asked, hides) = (slab.clone(), 1.0 - (1.0 - slab.opacity).powi(8));
    let scene = move || -> Result<Vec<Picture>, ExtremeError> {
        let mut scene = asked.scene()?;
        for shining in &mut scene.lights {
            (shining.spectrum, shining.intensity) = (light()?, intensity);
        }
        Ok(vec![Picture::of(scene)])
    };
    Extreme::shown(Group::Lights, name, bound, scene, move |lefts| {
        worst(lefts.iter().map(|left| {
            let seen = shown(&left.rungs.scene, 0);
            left.colour_error(hides * seen)
        }))
    })
}

/// XYZ of the first material under light `index`, in all 81 bands.
fn shown(scene: &Scene, index: usize) -> DVec3 {
    let [light, material] = [
        scene.lights.get(index).map(|light| light.spectrum.spectrum()),
        scene.materials.first().map(|material| material.reflectance.spectrum()),
    ];
    let seen = light.zip(material).map(|(light, reflectance)| DVec3::from_array(xyz_of(&(light * reflectance)).0));
    scene.lights.get(index).map_or(0.0, |light| light.intensity) * seen.unwrap_or(DVec3::NAN)
}

/// Lights at four positions. Three shade by the gradient, which is zero in a uniform volume, so only the ambient part
/// remains.
fn mixed() -> Extreme {
    const AMBIENT: f64 = 0.25;
    let slab = Slab::default();
    let (asked, hides) = (slab.clone(), 1.0 - (1.0 - slab.opacity).powi(8));
    let scene = move || -> Result<Vec<Picture>, ExtremeError> {
        let mut scene = asked.scene()?;
        scene.shading = Shading::Gradient;
        scene.materials.iter_mut().for_each(|material| material.ambient = AMBIENT);
        let placed = [
            ("A", 1e6, Placement::Ambient),
            ("FL11", 0.0, Placement::Point(DVec3::new(40.0, -5.0, 10.0))),
            ("D65", 1e-6, Placement::Directional(DVec3::new(0.6, 0.0, 0.8))),
            ("LED-RGB1", 1.0, Placement::Directional(DVec3::new(0.0, 0.6, -0.8))),
        ];
        scene.lights = placed
            .into_iter()
            .map(|(name, intensity, placement)| {
                let spectrum = standard::light(name)?;
                Ok(SceneLight { name: name.to_owned(), spectrum, intensity, placement, shadows: false })
            })
            .collect::<Result<_, SpectrumError>>()?;
        Ok(vec![Picture::of(scene)])
    };
    Extreme::shown(
        Group::Lights,
        "lights of 0, 1e-6, 1 and 1e6 at four positions",
        Bound::picture(8.0),
        scene,
        move |lefts| {
            worst(lefts.iter().map(|left| {
                let scene = &left.rungs.scene;
                let lights = scene.lights.iter().enumerate();
                let expected: DVec3 = lights
                .map(|(i, light)| if light.placement == Placement::Ambient { 1.0 } else { AMBIENT } * shown(scene, i))
                .sum();
                let places = left.planned().positions.len();
                if places == 4 { left.colour_error(hides * expected) } else { f64::NAN }
            }))
        },
    )
}

/// A spiky light through coloured glass at the dimension of the plan, compared with all 81 bands.
fn through_glass(name: &str, light: Spectral) -> Extreme {
    let slab = Slab { absorption: Some((GREEN, 0.5)), ..Slab::default() };
    let asked = slab.clone();
    let scene = move || -> Result<Vec<Picture>, ExtremeError> {
        let mut scene = asked.scene()?;
        for shining in &mut scene.lights {
            shining.spectrum = light()?;
        }
        Ok(vec![Picture::of(scene)])
    };
    let bound = Bound::given(
        "tolerance",
        1.0,
        "the plan's limit on the ΔE00 of its colour model, relative to the closed form in 81 bands; roundings are a \
         thousandth of it",
    );
    Extreme::shown(Group::Lights, format!("{name} through coloured glass"), bound, scene, move |lefts| {
        worst(lefts.iter().map(|left| {
            let truth = in_all_bands(&slab, &left.rungs.scene);
            delta_e(left.xyz(0), truth)
        }))
    })
}

/// XYZ of the slab from its closed form at every wavelength.
fn in_all_bands(slab: &Slab, scene: &Scene) -> DVec3 {
    let [Some(light), Some(material)] = [
        scene.lights.first().map(|light| light.spectrum.spectrum()),
        scene.materials.first().map(|material| material.reflectance.spectrum()),
    ] else {
        return DVec3::NAN;
    };
    let shape = scene.materials.first().and_then(|material| material.absorption.as_ref());
    let scattering = -(-slab.opacity).ln_1p();
    let depth = slab.absorption.map_or(0.0, |(_, depth)| depth);
    let seen = std::array::from_fn(|band| {
        let absorbed = shape.map_or(0.0, |shape| shape.spectrum().samples()[band]);
        let extinction = scattering + depth * absorbed;
        let sent = -scattering / extinction * (-extinction * slab.length()).exp_m1();
        light.samples()[band] * material.samples()[band] * sent
    });
    DVec3::from_array(xyz_of(&Spectrum::from_samples(seen)).0)
}

/// No light: the transmittance is right and the picture is black.
fn unlit() -> Extreme {
    let slab = Slab { lights: Vec::new(), ..Slab::default() };
    let scene = move || Ok(vec![slab.picture()?]);
    Extreme::shown(Group::Lights, "no lights", Bound::march(8.0), scene, |lefts| {
        worst(lefts.iter().map(|left| (left.transmittance(0, 0) - 0.9_f64.powi(8)).abs()))
    })
}
