//! Glossary of a report.

use super::drawing::escaped;

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
const WORDS: [Word; 40] = [
    word(
        "ΔE00",
        &["ΔE00"],
        "how different two colours look (CIEDE2000): below 0.5 nobody sees it, below 1 hardly anybody, 1 to 2 is seen side by side, 2 to 4 at a glance, more at once",
    ),
    word("mean", &[], "ΔE00 on average over the pixels that were compared"),
    word("p95", &["p95"], "the ΔE00 that 95 of 100 of the pixels that were compared stay below"),
    word("max", &[], "ΔE00 of the worst pixel that was compared"),
    word(
        "the truth",
        &["truth"],
        "the same scene with all 81 wavelengths in double precision, rays followed to their ends, in steps an eighth of the shortest measured",
    ),
    word(
        "the scene's own",
        &["the scene's own"],
        "the setting that the scene file states; other rows differ from it in what they name. A model that is named has the scene's k where that is stated, else 8; RGB has 3",
    ),
    word(
        "step",
        &["step"],
        "the distance between two samples along a ray, in voxels; as a cause: what lies between samples is missed",
    ),
    word("basis", &["basis"], "as a cause of errors: spectra are carried in few numbers in place of 81 wavelengths"),
    word("k", &["k="], "how many numbers a pixel keeps in place of a spectrum"),
    word("nodes", &["nodes"], "the usual k numbers: a spectrum at k wavelengths that are chosen for the scene"),
    word(
        "sharpened",
        &["model=sharpened"],
        "k numbers whose products stand for products of spectra, light after each sample brought back to them; sharpened-semigroup brings back the absorption instead",
    ),
    word("bands", &["bands"], "k numbers: means over equal parts of the wavelengths from 400 to 700 nm"),
    word("peercy", &["peercy"], "k numbers with full matrices in place of products (Peercy 1993)"),
    word(
        "rgb-naive",
        &["rgb-naive"],
        "three numbers, the colours of materials as they are, as renderers without spectra have them",
    ),
    word("rgb-prefiltered", &["rgb-prefiltered"], "three numbers, the colours of materials under daylight (D65)"),
    word("rgb-fitted", &["rgb-fitted"], "the same with a matrix fitted to each light"),
    word(
        "weights",
        &["weights"],
        "a pixel keeps how much it shows of each material: exact under every light, but only where all wavelengths are absorbed alike",
    ),
    word(
        "accumulate",
        &["accumulate=", "accumulate = "],
        "whether a pixel keeps weights of materials or k numbers of a spectrum; auto takes weights where they are exact",
    ),
    word(
        "tables and storage",
        &["tables and storage"],
        "as a cause of errors: the transfer function is a table, the volume a texture, and what a pixel keeps may have 16 bits",
    ),
    word("storage", &["storage="], "numbers of 16 or of 32 bits are kept of a finished pixel"),
    word(
        "termination",
        &["termination"],
        "a ray ends once less than this share of light can pass; as a cause: what lies behind is missed. With fewer numbers than wavelengths rays end elsewhere, and that difference counts as basis",
    ),
    word(
        "interpolation",
        &["interpolation"],
        "how values between voxels are made: nearest, linear by the device, linear in 32 bits (exact-linear), or by a smooth cubic spline",
    ),
    word("volume", &["volume="], "how many bits a voxel has on the device"),
    word(
        "gradients",
        &["gradients="],
        "whether the directions that shading needs are stored (packed) or computed as rays go (central)",
    ),
    word("entries", &["entries="], "how many entries the table of the transfer function has"),
    word("lookup", &["lookup="], "whether that table is read between its entries (linear) or at the nearest"),
    word("skipping", &["skipping="], "leaping over empty space, which changes times alone"),
    word(
        "resolution",
        &["scale="],
        "as a cause of errors: fewer pixels are marched than shown. scale is their share across",
    ),
    word("scale", &["scale="], "how many pixels are marched, as a share across; the picture is enlarged"),
    word("model", &["model="], "which k numbers carry spectra"),
    word("rounding", &["rounding"], "as a cause of errors: arithmetic with 32 bits in place of 64"),
    word("device", &["device"], "as a cause of errors: what this device computes otherwise than the arithmetic says"),
    word(
        "frame ms",
        &[],
        "a march and a relight (and enlarging, where fewer pixels are marched): median, shortest and longest run",
    ),
    word("bytes/pixel", &[], "what a finished pixel keeps"),
    word("at", &[], "the worst pixel: from the left, from the top"),
    word("march", &["march"], "the pass of rays through the volume; its time in ms"),
    word("relight", &["relight"], "light put on what rays left, in ms"),
    word("read-back", &["read-back"], "the picture from the device; not part of a frame's time"),
    word("upload", &["upload"], "the volume to the device, once; not part of a frame's time"),
    word(
        "MB",
        &["MB"],
        "all memory while a picture is marched, the volume with it. With storage f16 it is more, not less: pixels are marched in 32 bits and their 16-bit form lies beside them until they are finished",
    ),
];

/// Meaning of a column head.
pub(super) fn meaning(name: &str) -> Option<&'static str> {
    WORDS.iter().find(|word| word.name == name).map(|word| word.meaning)
}

/// Explains the terms that occur in `page`.
pub(super) fn words(page: &str) -> String {
    let there = WORDS.iter().filter(|word| word.keys.iter().any(|key| page.contains(key)));
    let rows: String =
        there.map(|word| format!("<dt>{}</dt><dd>{}.</dd>\n", escaped(word.name), escaped(word.meaning))).collect();
    format!("<details>\n<summary>What the words mean</summary>\n<dl>\n{rows}</dl>\n</details>\n")
}
