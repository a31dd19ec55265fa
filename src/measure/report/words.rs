//! Glossary of a report.

use super::drawing::escaped;
use crate::setting::Knob;

/// A term and its meaning; the page explains it if it contains one of `keys`.
struct Word {
    name: &'static str,
    keys: &'static [&'static str],
    meaning: &'static str,
}

const fn word(name: &'static str, keys: &'static [&'static str], meaning: &'static str) -> Word {
    Word { name, keys, meaning }
}

/// Terms that are column heads of the table of all numbers also give the heads' tooltips.
const WORDS: [Word; 37] = [
    word(
        "ΔE00",
        &["ΔE00"],
        "CIEDE2000 colour difference: below 0.5 invisible, below 1 hardly visible, 1 to 2 visible side by side, 2 to 4 at a glance, more at once",
    ),
    word("mean", &[], "mean ΔE00 of the compared pixels"),
    word("p95", &["p95"], "the 95th percentile of ΔE00 of the compared pixels"),
    word("max", &[], "ΔE00 of the worst compared pixel"),
    word(
        "the truth",
        &["truth"],
        "the same scene with all 81 wavelengths in double precision, without early ray termination, in steps an eighth of the shortest measured step",
    ),
    word(
        "the scene's own",
        &["the scene's own"],
        "the setting in the scene file; other rows change only the knobs in their names. A named model has the scene's k if the file states one, otherwise 8; RGB has 3",
    ),
    word(
        "step",
        &["step"],
        "the distance between two samples along a ray, in voxels; as a cause: structures between samples are missed",
    ),
    word("basis", &["basis"], "as a cause of errors: k coefficients represent spectra of 81 wavelengths"),
    word("k", &["k="], "dimension of the colour model: coefficients per spectrum"),
    word(
        "nodes",
        &["nodes"],
        "the default colour model: the coefficients are samples of a spectrum at k wavelengths chosen for the scene",
    ),
    word(
        "sharpened",
        &["model=sharpened"],
        "a colour model whose componentwise products stand for products of spectra, with light projected after each sample; sharpened-semigroup projects the absorption instead",
    ),
    word("bands", &["bands"], "a colour model of means over k equal intervals from 400 to 700 nm"),
    word("peercy", &["peercy"], "a colour model with full matrices instead of componentwise products (Peercy 1993)"),
    word(
        "rgb-naive",
        &["rgb-naive"],
        "three coefficients, the RGB colours of materials, as in renderers without spectra",
    ),
    word("rgb-prefiltered", &["rgb-prefiltered"], "three coefficients, the colours of materials under daylight (D65)"),
    word("rgb-fitted", &["rgb-fitted"], "the same with a matrix fitted to each light"),
    word(
        "weights",
        &["weights"],
        "a pixel stores one number per material: exact under every light, but only with grey absorption",
    ),
    word(
        "accumulate",
        &["accumulate=", "accumulate = "],
        "whether a pixel stores material weights or k coefficients of a spectrum; auto chooses weights where they are exact",
    ),
    word(
        "tables and storage",
        &["tables and storage"],
        "as a cause of errors: the transfer function is a table, the volume a texture, and the numbers of a pixel may have 16 bits",
    ),
    word(
        "termination",
        &["termination"],
        "a ray ends when its transmittance is below this value; as a cause: the rest of the ray is missed. With fewer coefficients than wavelengths, rays end elsewhere; this difference counts as basis",
    ),
    word(
        "rays",
        &["rays", "pixel area"],
        "rays of a pixel, whose mean it is; as a cause (pixel area): a pixel sees only where its rays go",
    ),
    word(
        "interpolation",
        &["interpolation"],
        "interpolation between voxels: nearest, linear by the device, linear in 32 bits (exact_linear), or by a smooth cubic spline",
    ),
    word(
        "spacing",
        &["spacing=", "light grid"],
        "voxels between two nodes of the light grid, from which shadows are read; as a cause (light grid): the light is interpolated between nodes",
    ),
    word(
        "level",
        &["level"],
        "as a cause of errors: means of blocks of voxels take the place of the voxels, and steps are as long in them",
    ),
    word(
        "voxel_pixels",
        &["voxel_pixels="],
        "largest voxel in the picture, in pixels, for which a coarser level of the volume is taken; 0 takes all voxels",
    ),
    word(
        "resolution",
        &["scale="],
        "as a cause of errors: fewer pixels are marched than shown; scale is the ratio of the widths",
    ),
    word("scale", &["scale="], "width of the marched picture over that of the shown one; the picture is enlarged"),
    word("rounding", &["rounding"], "as a cause of errors: arithmetic with 32 bits instead of 64"),
    word("device", &["device"], "as a cause of errors: results of this device that differ from 32-bit arithmetic"),
    word(
        "frame ms",
        &[],
        "a march and a relight (and enlarging, where fewer pixels are marched): median, shortest and longest run",
    ),
    word("bytes/pixel", &[], "memory of a finished pixel"),
    word("at", &[], "position of the worst pixel: from the left, from the top"),
    word("march", &["march"], "the pass of rays through the volume; its time in ms"),
    word("relight", &["relight"], "the pass from the film to the picture under a mix of lights; its time in ms"),
    word("read-back", &["read-back"], "copying the picture from the device; not part of a frame's time"),
    word("upload", &["upload"], "copying the volume to the device, once; not part of a frame's time"),
    word(
        "MB",
        &["MB"],
        "device memory during a march, including the volume. storage=f16 needs more, not less: pixels are marched in 32 bits, and their 16-bit copies exist at the same time until the march ends",
    ),
];

/// Meaning of a column head. Of a knob without a word here, its own.
pub(super) fn meaning(name: &str) -> Option<&'static str> {
    let word = WORDS.iter().find(|word| word.name == name).map(|word| word.meaning);
    word.or_else(|| Knob::named(name).map(Knob::meaning))
}

/// Explains the terms that occur in `page`.
pub(super) fn words(page: &str) -> String {
    let there = WORDS.iter().filter(|word| word.keys.iter().any(|key| page.contains(key)));
    let knobs = Knob::all().filter(|knob| WORDS.iter().all(|word| word.name != knob.name()));
    let knobs = knobs.filter(|knob| page.contains(&format!("{knob}=")));
    let rows: String = there
        .map(|word| (word.name, word.meaning))
        .chain(knobs.map(|knob| (knob.name(), knob.meaning())))
        .map(|(name, meaning)| format!("<dt>{}</dt><dd>{}.</dd>\n", escaped(name), escaped(meaning)))
        .collect();
    format!("<details>\n<summary>Glossary</summary>\n<dl>\n{rows}</dl>\n</details>\n")
}
