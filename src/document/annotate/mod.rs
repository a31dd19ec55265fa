//! Annotations of a picture: scale bar, orientation letters and the colours of a legend, and their drawing.

mod overlay;

pub use overlay::{Entry, Overlay};

use glam::DVec3;

use relume_base::number::{count, readable};
use relume_colour::spectrum::colour::LinearSrgb;
use relume_colour::spectrum::{Absorption, Spectrum};
use relume_scene::film::{Components, Relightable};
use relume_scene::plan::is_constant;
use relume_scene::{Camera, Display, Material, Mix, Scene, View, positions};
use relume_volume::{Geometry, Unit};

/// Letters of the negative and positive ends of x, y and z in an anatomical world (left-posterior-superior).
pub const PATIENT: [[&str; 2]; 3] = [["R", "L"], ["A", "P"], ["I", "S"]];

/// Smallest component of a direction that adds a letter, as a fraction of the largest.
const SECOND_LETTER: f64 = 0.5;

/// Length of a pixel in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelLength {
    /// World units.
    pub units: f64,
    /// Whether it is the same at every depth (parallel rays); otherwise it applies at the depth of the camera's target.
    pub exact: bool,
}

/// Length of a pixel of a picture of `size` (width, height) that `camera` takes of a volume of `geometry`. `None` if
/// the camera has no line of sight, or its target is not in front of it.
#[must_use]
pub fn pixel_length(camera: &Camera, geometry: &Geometry, [width, height]: [f64; 2]) -> Option<PixelLength> {
    let view = camera.view(geometry, width / height)?;
    let depth = (camera.aim.target(geometry) - view.eye).dot(view.forward);
    let by = if view.parallel { 1.0 } else { depth };
    let units = 2.0 * view.half[1] * by / height;
    (units > 0.0 && units.is_finite()).then_some(PixelLength { units, exact: view.parallel })
}

/// The largest of 1, 2 and 5 times a power of ten that is at most `most`; 0 unless `most` is positive and finite.
#[must_use]
pub fn round_length(most: f64) -> f64 {
    if !(most > 0.0 && most.is_finite()) {
        return 0.0;
    }
    // Parsed from text, to be exactly the short decimal. The logarithm may round up across a power of ten.
    let power = most.log10().floor();
    let lengths = [power - 1.0, power].into_iter().flat_map(|power| [1, 2, 5].map(|digit| format!("{digit}e{power}")));
    let lengths = lengths.filter_map(|text| text.parse().ok()).filter(|&length: &f64| length <= most);
    lengths.fold(0.0, f64::max)
}

/// `length` in the unit of the file, with a space; `units` if the file states none.
#[must_use]
pub fn in_unit(length: f64, unit: Option<Unit>) -> String {
    let number = readable(length);
    match unit {
        Some(unit) => format!("{number} {unit}"),
        None => format!("{number} units"),
    }
}

/// A scale bar.
#[derive(Clone, Debug, PartialEq)]
pub struct ScaleBar {
    /// Its length in world units: 1, 2 or 5 times a power of ten.
    pub length: f64,
    /// Its length in pixels, at most that asked for.
    pub pixels: f64,
    /// The length in words, with the depth at which it applies.
    pub text: String,
}

impl ScaleBar {
    /// The longest scale bar of at most `most` pixels; `None` if there is none.
    #[must_use]
    pub fn new(pixel: PixelLength, most: f64, unit: Option<Unit>) -> Option<Self> {
        let length = round_length(most * pixel.units);
        let depth = if pixel.exact { "" } else { " at the target" };
        let text = format!("{}{depth}", in_unit(length, unit));
        (length > 0.0).then(|| Self { length, pixels: length / pixel.units, text })
    }
}

/// Anatomical letters of a world direction, the largest component first: `L`, or `LA` halfway between left and front.
/// A component adds a letter if it is at least half as large as the largest.
#[must_use]
pub fn letters(direction: DVec3) -> String {
    let sizes = direction.abs();
    let mut axes = [0, 1, 2];
    axes.sort_by(|&one, &other| sizes[other].total_cmp(&sizes[one]));
    let large = axes.into_iter().filter(|&axis| sizes[axis] > 0.0 && sizes[axis] >= SECOND_LETTER * sizes[axes[0]]);
    large.map(|axis| PATIENT[axis][usize::from(direction[axis] > 0.0)]).collect()
}

/// Anatomical letters at the edges of a picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Edges {
    /// At the left edge.
    pub left: String,
    /// At the right edge.
    pub right: String,
    /// At the top edge.
    pub top: String,
    /// At the bottom edge.
    pub bottom: String,
}

impl Edges {
    /// Letters at the edges of the picture of `view`; they are true of anatomical volumes only.
    #[must_use]
    pub fn of(view: &View) -> Self {
        Self::along(view.right, view.up)
    }

    /// Letters at the edges of a plane whose right and up directions in the world are given.
    #[must_use]
    pub fn along(right: DVec3, up: DVec3) -> Self {
        Self { left: letters(-right), right: letters(right), top: letters(up), bottom: letters(-up) }
    }
}

/// Scale and orientation of a picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame {
    /// Length of a pixel, if the camera has a target.
    pub pixel: Option<PixelLength>,
    /// Unit of the world, if it is known.
    pub unit: Option<Unit>,
    /// Letters at the edges of the picture of an anatomical volume.
    pub edges: Option<Edges>,
}

impl Frame {
    /// That of a picture of `size` (width, height) in pixels that `camera` takes in the `frame` of a scene.
    #[must_use]
    pub fn of(camera: &Camera, frame: &relume_scene::Frame, size: [usize; 2]) -> Self {
        let [width, height] = size.map(count);
        let view = camera.view(&frame.geometry, width / height).filter(|_| frame.anatomical);
        Self {
            pixel: pixel_length(camera, &frame.geometry, [width, height]),
            unit: frame.unit,
            edges: view.as_ref().map(Edges::of),
        }
    }
}

/// Display colours of the materials of `scene` under `mix`, lit from all positions, in their order: the colours of a
/// legend. A material with coloured absorption has the colour of a layer that transmits a tenth at the absorption peak,
/// times its reflectance unless that is 0.
#[must_use]
pub fn material_colours(scene: &Scene, mix: &Mix) -> Vec<LinearSrgb> {
    colours(scene.materials.iter().map(seen_of).collect(), positions(scene).len(), mix, &scene.display)
}

/// Display colours of surfaces of these `spectra` under `mix`, lit from all of so many positions.
fn colours(spectra: Vec<Spectrum>, positions: usize, mix: &Mix, display: &Display) -> Vec<LinearSrgb> {
    let materials = spectra.len();
    let components = Components::Surfaces(spectra);
    let matrices = Relightable { components, positions, background: None, display: display.clone() }.under(mix);
    let of = |material: usize| -> DVec3 { matrices.colours.iter().skip(material).step_by(materials.max(1)).sum() };
    (0..materials).map(|material| LinearSrgb(of(material).to_array())).collect()
}

/// Spectrum of a material by itself under white light, as [`material_colours`] defines it.
fn seen_of(material: &Material) -> Spectrum {
    let reflected = material.reflectance.spectrum();
    let Some(shape) = material.absorption.as_ref().map(Absorption::spectrum).filter(|it| !is_constant(it)) else {
        return reflected.clone();
    };
    let transmitted = Spectrum::from_samples(shape.samples().map(|depth| 0.1_f64.powf(depth)));
    if *reflected == Spectrum::constant(0.0) { transmitted } else { &transmitted * reflected }
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
    use super::*;
    use relume_scene::{Aim, Projection};

    fn geometry() -> Geometry {
        Geometry::unit("test", [10; 3]).unwrap()
    }

    fn looking(projection: Projection) -> Camera {
        let aim = Aim::LookAt { position: DVec3::new(0.0, -10.0, 0.0), target: DVec3::ZERO };
        Camera { projection, aim, up: DVec3::Z }
    }

    #[test]
    fn a_round_length_is_the_largest_of_one_two_and_five() {
        for (most, length) in [
            (1.0, 1.0),
            (1.999, 1.0),
            (2.0, 2.0),
            (4.99, 2.0),
            (5.0, 5.0),
            (99.0, 50.0),
            (100.0, 100.0),
            (1000.0, 1000.0),
            (0.3, 0.2),
            (1e-5, 1e-5),
            (0.0, 0.0),
            (-3.0, 0.0),
            (f64::NAN, 0.0),
            (f64::INFINITY, 0.0),
        ] {
            assert!(round_length(most).to_bits() == f64::to_bits(length), "{most}: {}", round_length(most));
        }
    }

    #[test]
    fn a_pixel_of_parallel_rays_has_one_length_and_of_a_cone_that_at_its_target() {
        let parallel = looking(Projection::Orthographic { height: Some(80.0) });
        let exact = PixelLength { units: 0.2, exact: true };
        assert_eq!(pixel_length(&parallel, &geometry(), [800.0, 400.0]), Some(exact));
        // At distance 10, a field of view of 90° is 20 units high.
        let cone = looking(Projection::Perspective { fov_degrees: 90.0 });
        let pixel = pixel_length(&cone, &geometry(), [800.0, 400.0]).unwrap();
        assert!((pixel.units - 0.05).abs() < 1e-12 && !pixel.exact, "{pixel:?}");
        let blind = Camera { up: DVec3::Y, ..cone };
        assert_eq!(pixel_length(&blind, &geometry(), [800.0, 400.0]), None);
    }

    #[test]
    fn a_scale_bar_is_as_long_as_it_says() {
        let exact = PixelLength { units: 0.2, exact: true };
        let bar = ScaleBar::new(exact, 150.0, Some(Unit::Millimetre)).unwrap();
        assert_eq!(bar, ScaleBar { length: 20.0, pixels: 100.0, text: "20 mm".to_owned() });
        let bar = ScaleBar::new(PixelLength { units: 0.001, exact: false }, 120.0, None).unwrap();
        assert_eq!(bar.text, "0.1 units at the target");
        assert!((bar.pixels - 100.0).abs() < 1e-9);
        assert_eq!(ScaleBar::new(PixelLength { units: f64::NAN, exact: true }, 120.0, None), None);
    }

    #[test]
    fn letters_name_the_ends_of_a_picture_of_a_patient() {
        // A patient from the front: their left is at the right of the picture.
        let view = looking(Projection::Orthographic { height: None }).view(&geometry(), 1.0).unwrap();
        let [left, right, top, bottom] = ["R", "L", "S", "I"].map(str::to_owned);
        assert_eq!(Edges::of(&view), Edges { left, right, top, bottom });
        for (direction, expected) in [
            (DVec3::NEG_Y, "A"),
            (DVec3::new(1.0, -0.49, 0.0), "L"),
            (DVec3::new(1.0, -0.51, 0.0), "LA"),
            (DVec3::new(-0.6, 0.0, 1.0), "SR"),
            (DVec3::ZERO, ""),
        ] {
            assert_eq!(letters(direction), expected, "{direction}");
        }
    }
}
