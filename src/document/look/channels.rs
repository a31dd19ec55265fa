//! The first look at all channels of a file: a channel is a material, and a light is a filter (docs/theory/fields.md).

use std::collections::BTreeSet;
use std::sync::Arc;

use glam::DVec3;
use toml_edit::{Array, DocumentMut, InlineTable, Item, Table, Value, value};

use super::bands::{heights, part_of};
use super::first_look::{Look, LookError, Subject, Wish, first_look};

use relume_base::number::{brief_in, count, readable};
use relume_base::progress::Progress;
use relume_colour::spectrum::colour::{linear_srgb_from_xyz, xyz_of};
use relume_colour::spectrum::{BANDS, Spectrum, standard};
use relume_scene::Blending;
use relume_scene::key::Named;
use relume_volume::Volume;

/// Name of the light that shows all channels.
const ALL: &str = "all";
/// Colours of channels whose file states none, in their order: those of stains from short to long waves.
const COLOURS: [[f64; 3]; 4] = [[0.25, 0.45, 1.0], [0.2, 0.85, 0.3], [1.0, 0.3, 0.2], [0.9, 0.3, 0.9]];

/// Least height of a part of a comb.
const LEAST: f64 = 0.005;

/// A channel of a file.
pub(crate) struct ChannelVolume {
    /// Index of its component in the file.
    pub(crate) component: usize,
    /// Its name in the file; may be empty.
    pub(crate) name: String,
    /// Its values.
    pub(crate) volume: Arc<Volume>,
}

/// The scene of channels, without the file, and the guess in a sentence.
pub(crate) struct ChannelLook {
    pub(crate) text: String,
    pub(crate) guess: String,
    /// Names of the channels in it.
    pub(crate) names: Vec<String>,
}

/// The scene of `channels`, whose file is called `name`: each is an X-ray material that reflects in bands of its own, so that a light of
/// these bands shows it alone, exactly.
///
/// # Errors
///
/// [`LookError`].
pub(crate) fn channels(
    name: &str,
    channels: &mut [ChannelVolume],
    blending: Blending,
    progress: &dyn Progress,
) -> Result<ChannelLook, LookError> {
    let number = channels.len();
    let names = names(channels);
    let mut places: Vec<usize> = channels.iter().map(|channel| channel.component % COLOURS.len()).collect();
    if places.iter().collect::<BTreeSet<_>>().len() < number {
        places = (0..number).collect();
    }
    let mut document = DocumentMut::new();
    let (mut described, mut boxes) = (Vec::new(), Vec::new());
    let (mut materials, mut lights, mut further) = (Table::new(), Table::new(), Table::new());
    let daylight = standard::d65().spectrum();
    let bright = count(number);
    lights.insert(ALL, light(value("D65"), bright));
    for (index, (channel, called)) in channels.iter_mut().zip(&names).enumerate() {
        let statistics = channel.volume.statistics()?;
        let wish = (Wish { look: Some(Look::Fluorescence), ..Wish::default() }, Subject::default());
        let look = first_look(name, &mut channel.volume, &statistics, wish, progress)?;
        let mut looked: DocumentMut = look.text.parse().unwrap_or_default();
        boxes.extend(around(&looked));
        // By its place in the file, so that it keeps its colour among others.
        let colour = channel.volume.presets.colour.unwrap_or(COLOURS[places[index]]);
        let comb = comb(index, number, colour);
        let mut material = looked["materials"]["stain"].as_table().cloned().unwrap_or_default();
        material.insert("reflectance", samples(&comb));
        materials.insert(called, Item::Table(material));
        let own = |band: usize| if band % number == index { daylight.samples()[band] } else { 0.0 };
        // The part of the light of all in these bands; a light of samples has the luminance 1 at intensity 1.
        let part = Spectrum::from_samples(std::array::from_fn(own));
        let luminance = xyz_of(&part).0[1] / xyz_of(daylight).0[1];
        lights.insert(called, light(samples(&part), bright * luminance));
        let mut transfer = looked["transfer"].as_table().cloned().unwrap_or_default();
        rename(&mut transfer, called);
        if blending.is_extreme() {
            brighten(&mut transfer);
        }
        let opacity = transfer["opacity"].as_array();
        let ends =
            opacity.and_then(|points| Some([first_of(points.get(0)?)?, first_of(points.get(points.len() - 1)?)?]));
        if let Some(ends) = ends {
            let span = statistics.max - statistics.min;
            let [low, high] = ends.map(|end| brief_in(end, span));
            described.push(format!("{called} from {low} to {high}"));
        }
        if index == 0 {
            document = std::mem::take(&mut looked);
            document["transfer"] = Item::Table(transfer);
        } else {
            // One opacity length and one lookup for all of them.
            let mut own = Table::new();
            own.insert("component", number_of(channel.component));
            transfer.remove("opacity_length");
            own.insert("transfer", Item::Table(transfer));
            further.insert(called, Item::Table(own));
        }
    }
    fit_all(&mut document, &boxes);
    document["materials"] = Item::Table(materials);
    document["lights"] = Item::Table(lights);
    document["volumes"] = Item::Table(further);
    for name in ["materials", "lights", "volumes"] {
        document[name].as_table_mut().into_iter().for_each(|table| table.set_implicit(true));
    }
    // Factors and clip planes refer to it by its name, as to the others.
    document["volume"]["name"] = value(names.first().map_or("", String::as_str));
    document["volume"]["component"] = number_of(channels.first().map_or(0, |channel| channel.component));
    if blending.is_extreme() {
        document["blending"] = value(blending.name());
    }
    // A sample has several fields.
    document["accuracy"].as_table_mut().and_then(|accuracy| accuracy.remove("integration"));
    // Brightness is that of the lights.
    document["dial"]["normalise"] = value(false);
    // Each channel has a switch, a slider and a colour of its own; the light of all is for the dial.
    document["mix"] = Item::Table(Table::new());
    document["mix"]["by"] = value("sliders");
    document["mix"]["off"] = value([ALL].into_iter().collect::<Array>());
    document["mix"]["hand"] = value(ALL);
    let largest = blending.is_extreme();
    let guess = if number == 1 {
        let values = if largest { "by its largest values: " } else { "" };
        format!("{name} has no scene, so Relume made one: the channel {values}{}.", described.join(", "))
    } else {
        let how = if largest { "of which the largest values add up" } else { "which add up" };
        format!(
            "{name} has no scene, so Relume made one: {number} channels, each in bands of the spectrum of its own, {how}: {}. The light \
             of its name shows one of them alone.",
            described.join(", ")
        )
    };
    // The first look at the first channel describes itself in the second line.
    let text = document.to_string();
    let lines =
        text.lines().enumerate().map(|(line, text)| if line == 1 { format!("# {guess}") } else { text.to_owned() });
    let text: String = lines.map(|line| line + "\n").collect();
    Ok(ChannelLook { text, guess, names })
}

/// Opacities by which the light of an X-ray material rises evenly with the value, to all that falls on it, where one opacity length of it is
/// seen.
pub(super) fn brighten(transfer: &mut Table) {
    /// Parts of the range between whose ends opacities are interpolated.
    const PARTS: usize = 8;
    let points = transfer["opacity"].as_array();
    let ends = points.and_then(|points| Some([first_of(points.get(0)?)?, first_of(points.get(points.len() - 1)?)?]));
    let Some([low, high]) = ends else { return };
    let point = |part: usize| {
        let depth = count(part) / count(PARTS);
        let opacity = format!("{:.4}", -(-depth).exp_m1()).parse().unwrap_or(depth);
        Value::Array([(high - low).mul_add(depth, low), opacity].into_iter().map(Value::from).collect())
    };
    transfer.insert("opacity", value((0..=PARTS).map(point).collect::<Array>()));
}

/// The box that the camera of a first look orbits.
fn around(look: &DocumentMut) -> Option<[DVec3; 2]> {
    let corners = look.get("camera")?.get("around")?.as_array()?;
    let corner = |index: usize| {
        let corner = corners.get(index)?.as_array()?;
        Some(DVec3::new(number_in(corner.get(0)?)?, number_in(corner.get(1)?)?, number_in(corner.get(2)?)?))
    };
    Some([corner(0)?, corner(1)?])
}

/// Lets the camera orbit the box of all channels, if the first one does not fill it.
fn fit_all(document: &mut DocumentMut, boxes: &[[DVec3; 2]]) {
    let Some(&first) = boxes.first() else { return };
    let [low, high] = boxes.iter().fold(first, |[low, high], other| [low.min(other[0]), high.max(other[1])]);
    if [low, high] != first {
        let corner = |corner: DVec3| Value::Array(corner.to_array().into_iter().map(Value::from).collect());
        document["camera"]["around"] = value([low, high].map(corner).into_iter().collect::<Array>());
        // The box spans the picture.
        document["camera"]["fill"] = value(1.0);
    }
}

/// Name of a channel whose file states none.
pub(crate) fn channel_name(component: usize) -> String {
    format!("channel {}", component + 1)
}

/// Names of the channels for keys: those of the file, made different; a number where there is none.
fn names(channels: &[ChannelVolume]) -> Vec<String> {
    let mut taken = BTreeSet::from([ALL.to_owned()]);
    let of = |channel: &ChannelVolume| {
        let stated: String = channel.name.chars().filter(|letter| !letter.is_control()).collect();
        let stated = match stated.trim() {
            "" => channel_name(channel.component),
            name => name.to_owned(),
        };
        let different = (2..).map(|number| format!("{stated} {number}"));
        let free = std::iter::once(stated.clone()).chain(different).find(|name| taken.insert(name.clone()));
        free.unwrap_or(stated)
    };
    channels.iter().map(of).collect()
}

/// The reflectance of channel `index` of `number`: every `number`-th band, in three heights by which it has the chromaticity of `colour`
/// in daylight, as far as heights from 0 to 1 give it.
fn comb(index: usize, number: usize, colour: [f64; 3]) -> Spectrum {
    let daylight = standard::d65().spectrum();
    let seen = |heights: DVec3| {
        let band = |band: usize| {
            if band % number == index { heights[part_of(band)] * daylight.samples()[band] } else { 0.0 }
        };
        DVec3::from_array(linear_srgb_from_xyz(xyz_of(&Spectrum::from_samples(std::array::from_fn(band)))).0)
    };
    let heights = heights(seen, colour).unwrap_or(DVec3::ONE);
    // Enough in each part for a light to show the channel in any other colour, and too little to be seen in daylight.
    let heights = heights.max(DVec3::splat(LEAST));
    let band = |band: usize| if band % number == index { heights[part_of(band)] } else { 0.0 };
    // Five decimals, as written.
    Spectrum::from_samples(std::array::from_fn(|i: usize| (band(i) * 1e5).round() / 1e5))
}

/// A number of a component.
fn number_of(component: usize) -> Item {
    value(i64::try_from(component).unwrap_or(i64::MAX))
}

/// An ambient light.
fn light(spectrum: Item, intensity: f64) -> Item {
    let mut light = Table::new();
    light.insert("spectrum", spectrum);
    light.insert("kind", value("ambient"));
    light.insert("intensity", value(intensity));
    Item::Table(light)
}

/// A spectrum as its samples.
fn samples(spectrum: &Spectrum) -> Item {
    const _: () = assert!(BANDS == 81, "of 5 nm");
    let samples: Array = spectrum.samples().iter().map(|&sample| number(sample)).collect();
    let mut table = InlineTable::new();
    table.insert("samples", Value::Array(samples));
    value(table)
}

/// A number, without decimals if it is whole.
pub(super) fn number(number: f64) -> Value {
    readable(number).parse().unwrap_or_else(|_| number.into())
}

/// Gives the material of a transfer function, all of one, another name.
pub(super) fn rename(transfer: &mut Table, name: &str) {
    if let Some(points) = transfer.get_mut("material").and_then(Item::as_array_mut) {
        for point in points.iter_mut().filter_map(Value::as_array_mut) {
            point.replace(1, name);
        }
    }
    let intervals = transfer.get_mut("intervals").and_then(Item::as_array_mut);
    for interval in intervals.into_iter().flat_map(Array::iter_mut).filter_map(Value::as_inline_table_mut) {
        interval.insert("material", name.into());
    }
}

/// The first number of a point.
fn first_of(point: &Value) -> Option<f64> {
    number_in(point.as_array()?.get(0)?)
}

/// A number of any kind.
pub(super) fn number_in(number: &Value) -> Option<f64> {
    number.as_float().or_else(|| Some(f64::from(i32::try_from(number.as_integer()?).ok()?)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume_colour::spectrum::colour::xyz_of;

    #[test]
    fn combs_keep_the_chromaticity_of_their_colours_and_no_band_is_in_two() {
        let light = standard::d65().spectrum();
        for number in 2..=4 {
            for (index, colour) in COLOURS.iter().enumerate().take(number) {
                let found = comb(index, number, *colour);
                let shown = linear_srgb_from_xyz(xyz_of(&(&found * light))).0.map(|it| it.max(0.0));
                let most = shown.iter().fold(0.0_f64, |a, &b| a.max(b));
                let codes = shown.map(|it| (it / most).powf(1.0 / 2.2));
                let wanted = colour.iter().fold(0.0_f64, |a, &b| a.max(b));
                for (found, wanted) in codes.iter().zip(colour.map(|it| it / wanted)) {
                    assert!((found - wanted).abs() < 0.12, "{index} of {number}: {codes:?} for {colour:?}");
                }
                for other in (0..number).filter(|other| *other != index) {
                    let both = &found * &comb(other, number, *colour);
                    assert!(both.samples().iter().all(|&sample| sample == 0.0), "exactly apart");
                }
            }
        }
    }
}
