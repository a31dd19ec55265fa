//! Pages: packing keeps its tolerance, the text is safe, and Chromium shows what `relume relight` writes.

use crate::support;

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::DVec3;
use html5ever::tendril::TendrilSink;
use html5ever::tokenizer::TokenizerOpts;
use html5ever::{ParseOpts, parse_document};
use markup5ever_rcdom::RcDom;
use relume::document::{self, SceneOptions};
use relume::film::Film;
use relume::output::FilmFile;
use relume::output::film::{Component, Components, Frame, Light, Position};
use relume::output::page::{LIVE_SCRIPT, Page, PageError, SCRIPT, STYLE};
use relume::progress::Quiet;
use relume::scene::Placement;
use relume::scene::{Mix, MixLight};
use relume::spectrum::colour::{XYZ_FROM_LINEAR_SRGB, Xyz, ciede2000, d65_white, lab_from_xyz};
use relume::spectrum::observer::Observer;
use relume::spectrum::{BANDS, Kind, standard};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use support::browser::Browser;
use support::program::Folder;
use support::rungs::Rungs;

/// The widgets of the Python module.
const WIDGET: &str = include_str!("../../python/relume/widget.js");
pub(super) const LIVE_WIDGET: &str = include_str!("../../python/relume/live.js");

/// Deterministic numbers from 0 to 1 (Steele et al. 2014).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        f64::from(u32::try_from((mixed ^ (mixed >> 31)) >> 32).unwrap()) / f64::from(u32::MAX)
    }

    fn below(&mut self, limit: usize) -> usize {
        let drawn = self.next() * support::scenes::float(limit);
        (1..limit).rev().find(|&n| support::scenes::float(n) <= drawn).unwrap_or(0)
    }
}

#[expect(clippy::cast_possible_truncation, reason = "films hold f32")]
fn narrow(number: f64) -> f32 {
    number as f32
}

/// A film with material weights: its header, and numbers that `weight` returns for each plane and pixel.
fn film(
    size: [usize; 2],
    components: &[[f64; BANDS]],
    positions: usize,
    mut weight: impl FnMut(usize, usize) -> f64,
) -> (FilmFile, Film<f32>) {
    let pixels = size[0] * size[1];
    let planes = components.len() * positions;
    let component =
        |(index, spectrum): (usize, &[f64; BANDS])| Component { name: format!("m{index}"), spectrum: *spectrum };
    let names = ["D65", "A", "FL11", "LED-B3"];
    let light = |position: usize| Light {
        name: format!("l{position}"),
        position,
        weight: 1.0 / support::scenes::float(position + 1),
        shown: None,
        spectrum: *standard::light(names[position % 4]).unwrap().spectrum().samples(),
    };
    let header = FilmFile {
        positions: (0..positions)
            .map(|index| Position { name: format!("p{index}"), placement: Placement::Ambient, shadows: false })
            .collect(),
        lights: (0..positions).map(light).collect(),
        ..FilmFile::empty(size, Components::Surfaces(components.iter().enumerate().map(component).collect()))
    };
    let accumulators =
        (0..planes).flat_map(|plane| (0..pixels).map(move |pixel| (plane, pixel))).map(|(a, b)| narrow(weight(a, b)));
    let film = Film {
        size,
        components: components.len(),
        accumulators: accumulators.collect(),
        transmittance: vec![0.0; pixels],
    };
    (header, film)
}

fn reflectance(random: &mut Random) -> [f64; BANDS] {
    let (centre, width, base) = (80.0 * random.next(), 4.0 + 20.0 * random.next(), 0.3 * random.next());
    std::array::from_fn(|band| base + 0.7 * (-((support::scenes::float(band) - centre) / width).powi(2)).exp())
}

fn page<'a>(header: &'a FilmFile, views: &'a [Film<f32>], tolerance: f64) -> Page<'a> {
    Page { film: header, views, columns: 1, title: "a test", tolerance }
}

/// Mixes of the page: as it opens, each standard light in place of all, and each light alone, as it is and as each
/// standard light, with the weight that the scene and with the luminance that the dial gives it.
fn mixes(header: &FilmFile) -> Vec<Mix> {
    let stated = header.stated().unwrap();
    let (normalise, master) = header.dial.as_ref().map_or((true, 1.0), |dial| (dial.normalise, dial.master));
    let matching_y = *Observer::ALL[0].matching()[1].samples();
    let alone = stated.0.iter().flat_map(|light| {
        let others = standard::names(Kind::Light).iter().map(|name| standard::light(name).unwrap());
        let spectra: Vec<_> = std::iter::once(light.spectrum.clone()).chain(others).collect();
        spectra
            .into_iter()
            .flat_map(|spectrum| {
                let y: f64 =
                    spectrum.spectrum().samples().iter().zip(&matching_y).map(|(power, part)| power * part).sum();
                let of_dial = if normalise { master / y } else { master * light.weight };
                let own = if light.weight == 0.0 { 1.0 } else { light.weight };
                [own, of_dial].map(|weight| Mix(vec![MixLight { weight, spectrum: spectrum.clone(), ..light.clone() }]))
            })
            .collect::<Vec<_>>()
    });
    let in_place = standard::names(Kind::Light).iter().map(|name| {
        let spectrum = standard::light(name).unwrap();
        Mix(stated.0.iter().map(|light| MixLight { spectrum: spectrum.clone(), ..light.clone() }).collect())
    });
    std::iter::once(header.opening().unwrap()).chain(alone).chain(in_place).collect()
}

/// Largest ΔE00 between `views` and what a page of them shows, over all pixels, lights and observers.
fn largest(header: &FilmFile, views: &[Film<f32>], tolerance: f64) -> f64 {
    let page = page(header, views, tolerance);
    let shown = page.shown(&Quiet).unwrap();
    let lab = |colour: DVec3| lab_from_xyz(Xyz((*XYZ_FROM_LINEAR_SRGB * colour).to_array()), d65_white());
    let mut largest = 0.0_f64;
    let mixes: Vec<(Mix, Observer)> =
        mixes(header).into_iter().flat_map(|mix| Observer::ALL.map(|observer| (mix.clone(), observer))).collect();
    for matrices in page.matrices(&mixes).unwrap() {
        for (view, shown) in views.iter().zip(&shown) {
            let pairs = view.relight(&matrices).into_iter().zip(shown.relight(&matrices));
            for (one, two) in pairs.filter(|(one, two)| one != two) {
                let found = ciede2000(lab(one), lab(two));
                assert!(found.is_finite(), "{one} {two}");
                largest = largest.max(found);
            }
        }
    }
    largest
}

/// Numbers of the pixels that the text of a page holds, by an unpacker of its own.
fn unpacked(html: &str) -> (Value, Vec<Vec<f64>>) {
    let block = |id: &str| {
        let (_, rest) = html.split_once(&format!("id=\"{id}\">")).unwrap();
        rest.split_once("</script>").unwrap().0
    };
    let page: Value = serde_json::from_str(block("relume-page")).unwrap();
    let mut bytes = Vec::new();
    let packed = STANDARD.decode(block("relume-view-0")).unwrap();
    flate2::read::DeflateDecoder::new(&*packed).read_to_end(&mut bytes).unwrap();
    let size = |axis: usize| usize::try_from(page["size"][axis].as_u64().unwrap()).unwrap();
    let (width, pixels) = (size(0), size(0) * size(1));
    let channels = page["channels"].as_array().unwrap();
    let is_empty = |channel: &&Value| channel["empty"] == true;
    let stored = channels.iter().filter(|channel| !is_empty(channel)).count() * pixels;
    let (mut next, mut large) = (0, stored);
    let mut roots = Vec::new();
    for channel in channels {
        let mut codes = vec![0_i64; pixels];
        for at in 0..if is_empty(&channel) { 0 } else { pixels } {
            let around = |back: usize, is_there: bool| if is_there { codes[at - back] } else { 0 };
            let (is_right, is_below) = (at % width > 0, at >= width);
            let (left, above) = (around(1, is_right), around(width, is_below));
            let corner = around(width + 1, is_right && is_below);
            let predicted = match (is_right, is_below) {
                (true, true) => (left + above - corner).clamp(left.min(above), left.max(above)),
                (true, false) => left,
                _ => above,
            };
            let mut byte = i64::from(bytes[next]);
            next += 1;
            codes[at] = if channel["wide"] == true {
                if byte == 255 {
                    byte = i64::from(bytes[large]) + 256 * i64::from(bytes[large + 1]);
                    large += 2;
                }
                let residual = if byte % 2 == 0 { byte / 2 } else { -(byte + 1) / 2 };
                (predicted + residual).rem_euclid(65_536)
            } else {
                (predicted + byte).rem_euclid(256)
            };
        }
        let zero = channel["zero"].as_i64().unwrap();
        roots.push(codes.into_iter().map(|code| f64::from(i32::try_from(code - zero).unwrap())).collect::<Vec<f64>>());
    }
    assert_eq!([next, large], [stored, bytes.len()], "every byte belongs to a channel");
    assert_eq!(page["large"][0], (large - stored) / 2, "large residuals");
    let kept = roots.clone();
    for group in page["groups"].as_array().unwrap() {
        let (first, rows) =
            (usize::try_from(group["first"].as_u64().unwrap()).unwrap(), group["matrix"].as_array().unwrap());
        for column in 0..rows.len() {
            for pixel in 0..pixels {
                let parts = rows.iter().enumerate();
                roots[first + column][pixel] =
                    parts.map(|(row, parts)| parts[column].as_f64().unwrap() * kept[first + row][pixel]).sum();
            }
        }
    }
    let scaled = roots.into_iter().zip(channels).map(|(roots, channel)| {
        let scale = channel["scale"].as_f64().unwrap();
        roots.into_iter().map(|root| root * root.abs() * scale).collect()
    });
    (page.clone(), scaled.collect())
}

fn released(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/0.1.0").join(name)
}

/// A film of version 0.1.0 in this checkout.
fn read(name: &str) -> (FilmFile, Film<f32>) {
    let mut header = FilmFile::read(&released(name)).unwrap();
    let film = header.take_film();
    (header, film)
}

// ---- packing ----

#[test]
fn packing_keeps_its_tolerance_in_fifty_films_under_every_light_for_both_observers() {
    let mut random = Random(28);
    for seed in 0..50_u32 {
        let components: Vec<_> = (0..1 + random.below(5)).map(|_| reflectance(&mut random)).collect();
        let (positions, busy) = (1 + random.below(3), random.next());
        let tolerance = [0.1, 0.5, 2.0][random.below(3)];
        let (mut header, mut film) =
            film(
                [17, 9],
                &components,
                positions,
                |_, _| {
                    if random.next() < busy { random.next().powi(3) } else { 0.0 }
                },
            );
        if seed % 2 == 0 {
            header.background = Some(reflectance(&mut random));
            film.transmittance.iter_mut().for_each(|number| *number = narrow(random.next()));
        }
        header.adapt = seed % 3 == 0;
        let found = largest(&header, std::slice::from_ref(&film), tolerance);
        // The search compares in f32.
        assert!(found <= tolerance * 1.0001, "film {seed}: {found} above {tolerance}");
    }
}

/// A scene file with materials, layers, lights, camera and dial that `random` chooses.
fn random_scene(random: &mut Random, phantom: &str) -> String {
    let surfaces = ["foliage", "dark skin", "orange", "blue sky", "white 9.5", "red", "0.4"];
    let lights = ["D65", "A", "FL11", "LED-B3", "D50"];
    let mut text = String::from("version = 1\n");
    if random.next() < 0.5 {
        text += &format!("background = {:.2}\n", random.next());
    }
    text += &format!("[volume]\nphantom = \"{phantom}\"\ndims = [16, 14, 12]\n");
    let is_coloured = random.next() < 0.15;
    let layers = 1 + random.below(4);
    let mut intervals = String::new();
    for layer in 0..layers {
        let surface = surfaces[random.below(surfaces.len())];
        let surface = if surface == "0.4" { surface.to_owned() } else { format!("\"{surface}\"") };
        text += &format!("[materials.m{layer}]\nreflectance = {surface}\nspecular = {:.2}\n", 0.4 * random.next());
        if is_coloured {
            text += &format!(
                "absorption = {{ gaussian = [{{ centre = {}, sigma = 40, height = 1.0 }}] }}\n",
                450 + 40 * random.below(5)
            );
        }
        let (from, opacity) =
            (0.1 + 0.8 * support::scenes::float(layer) / support::scenes::float(layers), random.next());
        let whole = if phantom == "frog" { 255.0 } else { 1.0 };
        let to = from + 0.6 / support::scenes::float(layers);
        intervals += &format!(
            "[[transfer.intervals]]\nmaterial = \"m{layer}\"\nrange = [{:.3}, {:.3}]\nramp = {:.3}\nopacity = {:.3}\n",
            from * whole,
            to * whole,
            0.05 * whole,
            0.02 + 0.5 * opacity * opacity
        );
        if is_coloured {
            intervals += &format!("absorption = {:.3}\n", 0.3 * random.next());
        }
    }
    text += &intervals;
    for light in 0..1 + random.below(3) {
        let spectrum = lights[random.below(lights.len())];
        text += &format!("[lights.l{light}]\nspectrum = \"{spectrum}\"\nintensity = {:.2}\n", 0.2 + random.next());
        match random.below(3) {
            0 => text += "kind = \"ambient\"\n",
            1 => {
                let [x, y] = [random.next() - 0.5, random.next() - 0.5];
                text += &format!("kind = \"directional\"\ndirection = [{x:.2}, {y:.2}, -0.6]\n");
            }
            _ => {}
        }
    }
    let (azimuth, elevation) = (360.0 * random.next(), 120.0 * random.next() - 60.0);
    text + &format!("[camera]\nazimuth = {azimuth:.0}\nelevation = {elevation:.0}\n")
}

#[test]
fn packing_keeps_its_tolerance_in_fifty_rendered_scenes() {
    let mut random = Random(2028);
    let (mut lit, mut with_model) = (0, 0);
    for seed in 0..50_u32 {
        let phantom = ["frog", "gaussian"][random.below(2)];
        let tolerance = [0.25, 0.5, 1.0][random.below(3)];
        let text = random_scene(&mut random, phantom);
        let opened = document::parse("random", &text, Path::new(""), &SceneOptions::default(), &Quiet).unwrap();
        let rungs = Rungs::new(opened.scene.clone(), [8, 6]);
        let march = rungs.march::<f32>(&rungs.stored());
        let dial = opened.light.dial_of_film(&opened.dial);
        let mut header = FilmFile::of_march(&rungs.scene, &rungs.planned, &opened.opening_mix(), dial, march).unwrap();
        let view = header.take_film();
        lit += u32::from(view.accumulators.iter().any(|&number| number > 0.01));
        with_model += u32::from(matches!(header.components, Components::Model(_)));
        let found = largest(&header, std::slice::from_ref(&view), tolerance);
        // The search compares in f32.
        assert!(found <= tolerance * 1.0001, "scene {seed}: {found} above {tolerance}");
    }
    assert!(lit >= 45 && (3..45).contains(&with_model), "{lit} pictures show something, {with_model} have a model");
}

#[test]
fn packing_keeps_its_tolerance_of_coefficients() {
    let (header, film) = read("glass.exr");
    for tolerance in [0.25, 1.0] {
        let found = largest(&header, std::slice::from_ref(&film), tolerance);
        assert!(found > 0.2 * tolerance && found <= tolerance * 1.0001, "{found} for {tolerance}");
    }
}

#[test]
fn films_of_extreme_shapes_and_numbers_are_packed() {
    let wave = |band: usize| 0.4 + 0.9 * (support::scenes::float(band) * 0.35).sin();
    let surfaces: Vec<[f64; BANDS]> = vec![[0.5; BANDS], std::array::from_fn(wave)];
    let many: Vec<[f64; BANDS]> =
        (0..31).map(|n| std::array::from_fn(|band| if band % 31 == n { 1.0 } else { 0.1 })).collect();
    let cases = [
        ("one pixel", film([1, 1], &surfaces, 1, |_, _| 0.7)),
        ("a row", film([65_536, 1], &surfaces[..1], 1, |_, pixel| support::scenes::float(pixel) / 65_536.0)),
        ("a column", film([1, 300], &surfaces, 2, |plane, pixel| support::scenes::float(pixel * (plane + 1)) / 900.0)),
        ("black", film([5, 4], &surfaces, 2, |_, _| 0.0)),
        (
            "31 components at 4 positions",
            film([3, 3], &many, 4, |plane, pixel| if plane % 9 == pixel { 0.8 } else { 0.0 }),
        ),
        ("bright", film([4, 4], &surfaces[..1], 1, |_, pixel| 100.0 * support::scenes::float(pixel))),
    ];
    for (name, (header, film)) in cases {
        let found = largest(&header, std::slice::from_ref(&film), 0.5);
        assert!(found <= 0.5001, "{name}: {found}");
    }
}

#[test]
fn a_tolerance_that_two_bytes_cannot_keep_is_refused_with_the_one_they_keep() {
    let (header, film) = film([4, 4], &[[0.5; BANDS]], 1, |_, pixel| if pixel == 0 { 1e12 } else { 1e-3 });
    match page(&header, std::slice::from_ref(&film), 1e-6).packed(&Quiet) {
        Err(PageError::Range { largest }) => assert!((largest - 1e12).abs() < 1e6, "{largest}"),
        other => panic!("{:?}", other.map(|page| page.summary)),
    }
    let (header, film) = self::film([4, 4], &[[0.5; BANDS]], 1, |_, pixel| if pixel == 0 { 1e3 } else { 1e-3 });
    match page(&header, std::slice::from_ref(&film), 1e-6).packed(&Quiet) {
        Err(PageError::Tolerance { tolerance, kept }) => assert!(kept > tolerance && kept.is_finite(), "{kept}"),
        other => panic!("{:?}", other.map(|page| page.summary)),
    }
}

#[test]
fn a_light_that_the_scene_has_off_shines_when_it_is_switched_on() {
    let (mut header, film) = film([4, 4], &[[0.5; BANDS]], 2, |_, _| 0.8);
    header.lights[1].weight = 0.0;
    let packed = page(&header, std::slice::from_ref(&film), 0.5).packed(&Quiet).unwrap();
    let (json, _) = unpacked(&packed.html);
    assert_eq!(serde_json::from_str::<Value>(&packed.json).unwrap(), json);
    assert_eq!(packed.views.iter().map(Vec::len).sum::<usize>(), packed.summary.packed_bytes);
    let number = |key: &str| json["lights"][1][key].as_f64().unwrap();
    assert_eq!(
        [number("weight"), number("shown")].map(f64::to_bits),
        [1.0_f64, 0.0].map(f64::to_bits),
        "{}",
        json["lights"][1]
    );
}

#[test]
fn the_text_of_a_page_holds_what_the_page_shows() {
    for name in ["session.exr", "glass.exr"] {
        let (header, film) = read(name);
        let page = page(&header, std::slice::from_ref(&film), 0.5);
        let (_, planes) = unpacked(&page.packed(&Quiet).unwrap().html);
        let shown = page.shown(&Quiet).unwrap().remove(0);
        let pixels = film.pixels();
        let expected: Vec<&[f32]> =
            shown.accumulators.chunks_exact(pixels).chain(shown.transmittance.chunks_exact(pixels)).collect();
        assert!(planes.len() >= shown.accumulators.len() / pixels, "{name}");
        for (index, (plane, expected)) in planes.iter().zip(expected).enumerate() {
            for (one, two) in plane.iter().zip(expected) {
                let two = f64::from(*two);
                assert!((one - two).abs() <= 1e-6 * (1.0 + two.abs()), "{name}, plane {index}: {one}, not {two}");
            }
        }
    }
}

// ---- the text ----

const HOSTILE: [&str; 5] = [
    "</script><img src=x onerror=alert(1)>",
    "\"'&<!-- \u{2028}",
    "🐸\u{202e}gnp.exe",
    "{style}{views}",
    "</title><script>alert(2)</script>",
];

/// A page whose title, lights and materials have hostile names.
fn hostile() -> (FilmFile, Film<f32>) {
    let (mut header, film) =
        film([6, 5], &[[0.5; BANDS], [0.2; BANDS]], 2, |plane, pixel| support::scenes::float(plane + pixel) / 40.0);
    (header.lights[0].name, header.lights[1].name) = (HOSTILE[0].into(), HOSTILE[2].into());
    header.positions[0].name = HOSTILE[1].into();
    if let Components::Surfaces(surfaces) = &mut header.components {
        (surfaces[0].name, surfaces[1].name) = (HOSTILE[4].into(), HOSTILE[3].into());
    }
    (header, film)
}

#[test]
fn names_stay_text_and_the_policy_has_the_digests_of_script_and_style() {
    let (header, film) = hostile();
    let page = Page { title: HOSTILE[4], ..page(&header, std::slice::from_ref(&film), 0.5) };
    let html = page.packed(&Quiet).unwrap().html;
    let tags = |tag: &str| html.replace(SCRIPT, "").matches(tag).count();
    assert_eq!([tags("<script"), tags("</script"), tags("<style"), tags("<title"), tags("<img")], [3, 3, 1, 1, 1]);
    let (json, _) = unpacked(&html);
    assert_eq!(json["lights"][0]["name"], HOSTILE[0]);
    assert_eq!(json["positions"][0], HOSTILE[1]);
    assert_eq!(json["components"][1]["name"], HOSTILE[3]);
    let digest = |text: &str| format!("'sha256-{}'", STANDARD.encode(Sha256::digest(text.as_bytes())));
    assert_eq!(parse_errors(&html), Vec::<String>::new());
    let (_, rest) = html.split_once("<script type=\"module\">").unwrap();
    let script = rest.split_once("</script>").unwrap().0;
    assert!(script == SCRIPT && html.contains(&format!("<style>{STYLE}</style>")), "script and style as they are");
    let policy = html.split_once("content=\"").unwrap().1.split_once('"').unwrap().0;
    let expected = format!(
        "default-src 'none'; script-src {}; style-src {}; img-src data: blob:; base-uri 'none'; form-action 'none'; \
         require-trusted-types-for 'script'",
        digest(script),
        digest(STYLE)
    );
    assert_eq!(policy, expected);
    assert!(html.find("http-equiv").unwrap() < html.find("<title").unwrap(), "the policy comes first");
    for word in ["http://", "https://", "innerHTML", "eval(", "new Function", "localStorage", "cookie"] {
        assert!(!SCRIPT.replace("http://www.w3.org/2000/svg", "").contains(word), "{word}");
    }
}

#[test]
fn a_page_keeps_scale_letters_and_the_names_of_its_materials() {
    let (mut header, film) = hostile();
    let letters = ["R", "LP", "S", "I"].map(str::to_owned);
    header.frame = Some(Frame { pixel: Some(1.25), parallel: true, unit: Some("mm".to_owned()), edges: Some(letters) });
    let size = [48, 32];
    let film = Film { size, ..film };
    let enlarged = |plane: &[f32]| plane.iter().copied().cycle().take(size[0] * size[1]).collect::<Vec<f32>>();
    let accumulators = film.accumulators.chunks_exact(30).flat_map(enlarged).collect();
    let film = Film { accumulators, transmittance: enlarged(&film.transmittance[..30]), ..film };
    let html = page(&header, std::slice::from_ref(&film), 0.5).packed(&Quiet).unwrap().html;
    assert_eq!(parse_errors(&html), Vec::<String>::new());
    // The drawing over the picture: a bar of a quarter of the 60 mm at most, and four letters.
    let style = html.split("<style>").nth(2).unwrap().split("</style>").next().unwrap();
    let drawing = style.split_once("base64,").unwrap().1.split_once('"').unwrap().0;
    let drawing = String::from_utf8(STANDARD.decode(drawing).unwrap()).unwrap();
    for text in [">10 mm<", ">R<", ">LP<", ">S<", ">I<", "viewBox=\"0 0 816 544\""] {
        assert!(drawing.contains(text), "no {text} in {drawing}");
    }
    let digest = STANDARD.encode(Sha256::digest(style.as_bytes()));
    assert!(html.split_once("img-src").unwrap().0.contains(&digest), "the policy allows the style");
    let legend = html.split_once("aria-label=\"Materials\"").unwrap().1.split_once("</section>").unwrap().0;
    assert!(legend.contains("&lt;/title&gt;") && legend.contains("{style}{views}"), "{legend}");
    assert_eq!(legend.matches("<rect").count(), 2);
    // The letters of a turntable turn, and its scale is that of every view.
    let views = [film.clone(), film];
    let html = Page { columns: 2, ..page(&header, &views, 0.5) }.packed(&Quiet).unwrap().html;
    let style = html.split("<style>").nth(2).unwrap().split_once("base64,").unwrap().1.split_once('"').unwrap().0;
    let drawing = String::from_utf8(STANDARD.decode(style).unwrap()).unwrap();
    assert!(drawing.contains(">10 mm<") && !drawing.contains(">LP<"), "{drawing}");
}

/// Errors of the parser of browsers.
fn parse_errors(html: &str) -> Vec<String> {
    let options = ParseOpts {
        tokenizer: TokenizerOpts { exact_errors: true, ..TokenizerOpts::default() },
        ..ParseOpts::default()
    };
    let parsed = parse_document(RcDom::default(), options).one(html);
    let errors = parsed.errors.borrow();
    errors.iter().map(ToString::to_string).collect()
}

#[test]
fn the_parser_of_browsers_finds_errors() {
    assert_eq!(parse_errors("<!DOCTYPE html><title>a</title><p>b"), Vec::<String>::new());
    assert!(!parse_errors("<!DOCTYPE html><title>a</title><p a='1' a='2'>b</i>").is_empty());
    assert!(!parse_errors("<title>a</title>").is_empty());
}

#[test]
fn the_script_of_pages_is_made_of_its_source_and_small() {
    const PAGE: &str = "src/document/output/page/";
    let digest = |files: &[String]| -> String {
        let read = |file: &String| std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join(file)).unwrap();
        let text = files.iter().flat_map(read).collect::<Vec<u8>>();
        Sha256::digest(&text).iter().take(8).map(|byte| format!("{byte:02x}")).collect()
    };
    let of_page = ["relume.js", "style.css"].map(|name| format!("{PAGE}{name}"));
    let of_page_script = of_page[0].clone();
    let own = |name: &str| {
        let mut files: Vec<String> =
            [name, "host.js", "widget.css"].map(|name| format!("python/widget/{name}")).to_vec();
        files.extend(of_page.clone());
        files
    };
    let first = |text: &'static str| text.lines().next().unwrap();
    let run = "run scripts/page_script";
    assert_eq!(first(SCRIPT), format!("// relume.js {}", digest(&of_page[..1])), "{run}");
    assert_eq!(first(WIDGET), format!("// widget.js {}", digest(&own("widget.js"))), "{run}");
    let of_live = [format!("{PAGE}live.js"), of_page_script];
    let of_live_widget = [own("live.js"), of_live[..1].to_vec()].concat();
    assert_eq!(first(LIVE_WIDGET), format!("// live.js {}", digest(&of_live_widget)), "{run}");
    assert_eq!(first(LIVE_SCRIPT), format!("// live.js {}", digest(&of_live)), "{run}");
    assert!(SCRIPT.len() <= 32 * 1024, "{} bytes", SCRIPT.len());
    assert!(LIVE_SCRIPT.len() <= 52 * 1024, "{} bytes", LIVE_SCRIPT.len());
}

#[test]
fn a_small_page_has_the_numbers_of_its_film() {
    let (header, film) = film([4, 4], &[[0.5; BANDS]], 1, |_, pixel| if pixel == 5 { 0.8 } else { 0.0 });
    let (json, planes) = unpacked(&page(&header, std::slice::from_ref(&film), 0.5).packed(&Quiet).unwrap().html);
    // Only one pixel is lit: its code is the largest, and the step reproduces it within the tolerance.
    assert_eq!(planes.len(), 1, "transmittance is left out in front of black");
    let lit: Vec<usize> = (0..16).filter(|&pixel| planes[0][pixel] != 0.0).collect();
    assert_eq!(lit, [5]);
    assert!((planes[0][5] - 0.8).abs() <= 0.02, "{}", planes[0][5]);
    for (key, value) in [
        ("format", json!(2)),
        ("title", json!("a test")),
        ("size", json!([4, 4])),
        ("views", json!(1)),
        ("columns", json!(1)),
        ("observer", json!("1931")),
        ("adapt", json!(false)),
        ("positions", json!(["p0"])),
        ("dial", Value::Null),
        ("background", Value::Null),
        ("groups", json!([])),
    ] {
        assert_eq!(json[key], value, "{key}");
    }
    let known: Vec<&str> =
        json["standards"].as_array().unwrap().iter().map(|one| one["name"].as_str().unwrap()).collect();
    assert_eq!(known, standard::names(Kind::Light));
}

// ---- the command ----

/// A folder with the films of version 0.1.0.
fn with_films() -> Folder {
    let folder = Folder::new();
    for name in ["session.exr", "glass.exr"] {
        std::fs::copy(released(name), folder.path(name)).unwrap();
    }
    folder
}

#[test]
fn bad_input_ends_in_one_error_that_names_the_way_out() {
    let folder = with_films();
    let whole = std::fs::read(folder.path("session.exr")).unwrap();
    let newer = whole.windows(11).position(|bytes| bytes == b"version = 1").unwrap();
    let mut future = whole.clone();
    future[newer + "version = ".len()] = b'9';
    let folder = folder.with("short.exr", &whole[..whole.len() / 2]).with("future.exr", &future);
    folder.refused(1, &["page", "short.exr", "-o", "a.html"], &["short.exr"]);
    folder.refused(1, &["page", "future.exr", "-o", "a.html"], &["future.exr", "unknown version 9"]);
    folder.refused(2, &["page", "session.exr", "-o", "a.png"], &["a.png", ".html"]);
    folder.refused(2, &["page", "session.exr", "-o", "a.html", "--size", "9x9"], &["--size", "already rendered"]);
    folder.refused(2, &["page", "session.exr", "-o", "a.html", "--views", "4"], &["--views", "already rendered"]);
    folder.refused(2, &["page", "session.exr", "-o", "a.html", "--k", "4"], &["--k"]);
    folder.refused(
        1,
        &["page", "session.exr", "-o", "a.html", "--max-bytes", "60000"],
        &["60000", "--tolerance", "--max-bytes"],
    );
    folder.refused(1, &["page", "none.exr", "-o", "a.html"], &["none.exr"]);
    folder.refused(1, &["page", "session.exr", "-o", "no/a.html"], &["no"]);
}

#[test]
fn a_film_says_whether_the_dial_mixed_its_lights() {
    let scene =
        format!("{}{}\n[mix]\nby = \"dial\"\nhand = [0.25, -0.5]\n", support::program::SCENE, support::program::DIAL);
    let folder = Folder::new().with("dial.toml", scene);
    for (name, hand) in [("dial.toml", json!([0.25, -0.5])), ("scene.toml", Value::Null)] {
        folder.done(&["render", name, "--reference", "--size", "6x5", "--accumulators", "acc.exr"]);
        folder.done(&["page", "acc.exr", "-o", "a.html"]);
        let (json, _) = unpacked(&std::fs::read_to_string(folder.path("a.html")).unwrap());
        assert_eq!(json["dial"]["hand"], hand, "{name}");
        assert_eq!(json["lights"].as_array().unwrap().len(), 2);
    }
}

// ---- the browser ----

/// RGB codes of a PNG.
pub(crate) fn png(path: &Path) -> Vec<u8> {
    let mut reader = png::Decoder::new(BufReader::new(File::open(path).unwrap())).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut bytes).unwrap();
    bytes
}

#[test]
fn a_page_shows_the_pictures_of_relight() {
    // A colour model with grey absorption, in front of a background: its transmittance is in no group. Nine numbers and an
    // odd count of pixels leave rests in loops of eight numbers and of four pixels.
    let scene = support::program::SCENE.replace("version = 1\n", "version = 1\nbackground = 0.5\n");
    let folder = with_films().with("grey.toml", scene);
    folder.done(&[
        "render",
        "grey.toml",
        "--accumulate",
        "spectral",
        "--k",
        "9",
        "--size",
        "23x19",
        "--accumulators",
        "grey.exr",
    ]);
    let soft = ["-D", "display.tone=soft", "-D", "display.exposure=4", "--accumulators", "soft.exr"];
    folder.done(&[&["render", "grey.toml", "--size", "23x19"][..], &soft].concat());
    let mut browser = Browser::new();
    for film in ["session.exr", "glass.exr", "grey.exr", "soft.exr"] {
        let header = FilmFile::read(&folder.path(film)).unwrap();
        let names: Vec<&str> = header.lights.iter().map(|light| light.name.as_str()).collect();
        assert!(names.len() >= 2, "{names:?}");
        folder.done(&["page", film, "-o", "page.html", "--tolerance", "0.1"]);
        let (first, second) = (names[0], names[1]);
        let at_first = format!("{first}@{}", header.positions[header.lights[0].position].name);
        let tube = at_first.replacen(first, "FL11", 1) + "=1";
        let body = at_first.replacen(first, "blackbody 3000", 1) + "=1";
        let alone = "{by:'sliders',keep:[false,true],master:[1,1],solo:-1,lights:L.map((light, i) => ({...light, on: i === N, value: 1, source: 'S', kelvin: 3000}))}";
        let alone = |n: usize, source: &str| alone.replace('N', &n.to_string()).replace("'S'", &format!("'{source}'"));
        let with = |part: &str, rest: &str| format!("({{...{part}, {rest}}})");
        let weight = header.lights[0].weight;
        let is_model = matches!(header.components, Components::Model(_));
        let mut cases = vec![
            (vec!["--light", first], with(&alone(0, ""), "")),
            (vec!["--light", second], with(&alone(1, ""), "")),
            (vec!["--dial", "0.3,-0.2"], "({by:'dial',hand:[0.3,-0.2]})".to_owned()),
            (vec!["--light", first, "--observer", "1964"], with(&alone(0, ""), "observer:'1964'")),
            (
                vec!["--light", &tube],
                with(&alone(0, "FL11").replace("value: 1", &format!("value: {}", 1.0 / weight)), ""),
            ),
        ];
        if !is_model {
            // Coefficients are fitted to a black body by the program, and reconstructed by the page.
            let body_case = with(&alone(0, "black body").replace("value: 1", &format!("value: {}", 1.0 / weight)), "");
            cases.push((vec!["--light", &body], body_case));
        }
        for draw in ["cpu", "gl"] {
            let mut page = browser.open(&folder.path("page.html"), &format!("#draw={draw}"), [900, 700]);
            let drawn = page.value("document.getElementById('relume').dataset.ready");
            assert_eq!(drawn, if draw == "gl" { "WebGL" } else { "JavaScript" });
            let observer = format!("{:?}", header.observer.to_string());
            for (flags, state) in &cases {
                folder.done(&[&["relight", film, "-o", "relit.png"], &flags[..]].concat());
                page.value(&format!(
                    "{{ const L = relume.state.lights; relume.set({{observer: {observer}}}); relume.set({state}); }}"
                ));
                let (shown, expected) = (page.pixels(), png(&folder.path("relit.png")));
                assert_eq!(shown.len(), expected.len(), "{film}");
                assert!(expected.iter().any(|&code| code > 40), "a black picture proves nothing: {flags:?}");
                let off = shown.iter().zip(&expected).map(|(one, two)| one.abs_diff(*two)).max().unwrap();
                assert!(off <= 1, "{film}, {draw}, {flags:?}: {off} codes off");
            }
            assert_eq!(page.complaints(), Vec::<String>::new(), "{film}, {draw}");
        }
    }
}

#[test]
fn the_script_computes_the_matrices_of_the_program() {
    let folder = with_films();
    let mut browser = Browser::new();
    for name in ["session.exr", "glass.exr"] {
        folder.done(&["page", name, "-o", "page.html"]);
        let (header, film) = read(name);
        let views = [film];
        let made = page(&header, &views, 0.5);
        let mut shown = browser.open(&folder.path("page.html"), "#draw=cpu", [800, 600]);
        shown.value("relume.set({by:'sliders',keep:[false,true],master:[1,1],adapt:false,stops:0,lights:relume.state.lights.map((light) => ({...light, on: true, value: 1}))})");
        for observer in Observer::ALL {
            shown.value(&format!("relume.set({{observer:'{observer}'}})"));
            let mut plain = header.clone();
            plain.adapt = false;
            let of_page = Page { film: &plain, ..page(&plain, &views, made.tolerance) };
            let expected = of_page.matrices(&[(plain.stated().unwrap(), observer)]).unwrap().remove(0);
            let found: Vec<[f64; 3]> = serde_json::from_value(shown.value("relume.colours")).unwrap();
            assert!(found.len() >= expected.colours.len(), "{name}");
            for (found, expected) in found.iter().zip(expected.colours.iter().chain(&expected.background)) {
                let apart = DVec3::from_array(*found).distance(*expected);
                assert!(apart <= 1e-5 * (0.1 + expected.length()), "{name}, {observer}: {found:?}, not {expected}");
            }
        }
    }
}

#[test]
fn a_page_is_safe_and_asks_for_nothing() {
    let (header, film) = hostile();
    let folder = Folder::new();
    let page = Page { title: HOSTILE[4], ..page(&header, std::slice::from_ref(&film), 0.5) };
    page.packed(&Quiet).unwrap().write(&folder.path("page.html")).unwrap();
    let mut browser = Browser::new();
    let mut shown = browser.open(&folder.path("page.html"), "", [900, 700]);
    assert_eq!(shown.value("document.title"), HOSTILE[4]);
    assert_eq!(shown.value("document.querySelector('h1').textContent"), HOSTILE[4]);
    assert_eq!(shown.value("document.querySelectorAll('script').length"), 3);
    assert_eq!(
        shown.value("[...document.querySelectorAll('li bdi')].map((name) => name.title)"),
        json!([HOSTILE[0], HOSTILE[2]])
    );
    shown.value("document.querySelector('.frame').focus()");
    shown.press("p");
    shown.wait("!document.querySelector('.probe').hidden");
    assert_eq!(shown.complaints(), Vec::<String>::new());
    // The policy holds: nothing is fetched, no markup becomes elements.
    assert_eq!(shown.value("fetch('data:,x').then(() => 'fetched', () => 'refused')"), "refused");
    let inserted = "(() => { try { document.body.insertAdjacentHTML('beforeend', '<b>x</b>'); return 'inserted'; } catch { return 'refused'; } })()";
    assert_eq!(shown.value(inserted), "refused");
}

#[test]
fn a_lost_context_is_restored_once_and_then_replaced() {
    let folder = with_films();
    folder.done(&["page", "session.exr", "-o", "page.html"]);
    let mut browser = Browser::new();
    let mut page = browser.open(&folder.path("page.html"), "#draw=gl", [900, 700]);
    let before = page.pixels();
    for expected in ["WebGL", "JavaScript"] {
        page.value("delete document.getElementById('relume').dataset.ready; document.querySelector('canvas').getContext('webgl2').getExtension('WEBGL_lose_context').loseContext()");
        page.wait(&format!("document.getElementById('relume').dataset.ready === '{expected}'"));
        let off = page.pixels().iter().zip(&before).map(|(one, two)| one.abs_diff(*two)).max().unwrap();
        assert!(off <= 1, "{expected}: {off} codes off");
    }
}

#[test]
fn keys_alone_reach_and_move_everything() {
    let folder = with_films();
    folder.done(&["page", "session.exr", "-o", "page.html"]);
    let mut browser = Browser::new();
    let mut page = browser.open(&folder.path("page.html"), "", [1200, 900]);
    // Every control has a name and is reached by Tab.
    let controls = "[...document.querySelectorAll('.relume button, .relume input, .relume select, .relume summary, .relume [tabindex]')].filter((one) => one.checkVisibility())";
    let count = page.value(&format!("{controls}.length")).as_u64().unwrap();
    page.value(
        "globalThis.reached = new Set(); document.addEventListener('focusin', (event) => reached.add(event.target))",
    );
    for _ in 0..=count {
        page.press("Tab");
    }
    assert_eq!(
        page.value(&format!(
            "{controls}.filter((one) => !one.disabled && !reached.has(one)).map((one) => one.outerHTML)"
        )),
        json!([])
    );
    page.value("document.querySelector('.hand').focus(); relume.set({by:'dial',hand:[0,0]})");
    page.press("ArrowRight");
    let hand = page.value("relume.state.hand");
    assert!(hand[0].as_f64().unwrap() > 0.0 && hand[1] == 0, "{hand}");
    page.press("Home");
    assert_eq!(page.value("relume.state.hand"), json!([0, 0]));
    page.value("document.querySelector('.node').focus()");
    page.press("Enter");
    assert_eq!(page.value("String(relume.state.hand) === String(relume.state.nodes[0].place)"), true);
    page.press(" ");
    assert_eq!(page.value("relume.state.nodes[0].on"), false);
    assert_eq!(page.value("document.querySelector('.node').getAttribute('aria-checked')"), "false");
    let tree = page.send("Accessibility.getFullAXTree", json!({}));
    let nodes = tree["nodes"].as_array().unwrap();
    let named = |role: &str| -> Vec<String> {
        let of_role = nodes.iter().filter(|node| node["role"]["value"] == role && node["ignored"] != true);
        of_role.map(|node| node["name"]["value"].as_str().unwrap_or_default().to_owned()).collect()
    };
    for role in ["slider", "checkbox", "button", "combobox", "image", "textbox"] {
        let names = named(role);
        assert!(!names.is_empty() && names.iter().all(|name| !name.is_empty()), "{role}: {names:?}");
    }
    assert!(named("slider").contains(&"Hand of the light dial".to_owned()));
    assert!(
        named("image").iter().any(|name| name.starts_with("\u{2068}Relight this picture\u{2069}. Light: ")),
        "{:?}",
        named("image")
    );
}

/// axe-core, which tests/data/axe describes.
fn axe() -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/axe/axe.min.js.gz");
    let mut text = String::new();
    flate2::read::GzDecoder::new(File::open(path).unwrap()).read_to_string(&mut text).unwrap();
    text
}

#[test]
fn axe_finds_no_barrier_in_either_theme_on_wide_and_narrow_screens() {
    let folder = with_films();
    folder.done(&["page", "session.exr", "-o", "page.html"]);
    folder.done(&["page", "glass.exr", "-o", "model.html"]);
    let (axe, mut browser) = (axe(), Browser::new());
    // All rules, also those that are merely best practice.
    let findings = "axe.run().then((found) => found.violations.map((one) => `${one.id}: ${one.nodes.map((node) => node.html + ' ' + node.failureSummary).join('; ')}`))";
    for (file, theme, size) in [
        ("page.html", "light", [1280, 900]),
        ("page.html", "dark", [1280, 900]),
        ("page.html", "light", [390, 844]),
        ("model.html", "dark", [390, 844]),
    ] {
        let mut page = browser.open(&folder.path(file), "", size);
        let features = json!([{"name": "prefers-color-scheme", "value": theme}]);
        page.send("Emulation.setEmulatedMedia", json!({"features": features}));
        page.value("document.querySelector('details').open = true; relume.set({pixel: [8, 8], lights: relume.state.lights.map((light, i) => i ? light : {...light, source: 'drawn', curve: Array(81).fill(0.5)})})");
        page.value(&axe);
        assert_eq!(page.value(findings), json!([]), "{file}, {theme}, {size:?}");
        if theme == "dark" {
            continue;
        }
        // It would find one.
        page.value("document.querySelector('.relume select').removeAttribute('aria-label')");
        let found = page.value(findings).to_string();
        assert!(found.contains("select-name"), "{found}");
    }
}

#[test]
fn a_finger_moves_lights_once_they_may_be_moved() {
    let folder = with_films();
    folder.done(&["page", "session.exr", "-o", "page.html"]);
    let mut browser = Browser::new();
    let mut page = browser.open(&folder.path("page.html"), "", [390, 844]);
    let place = "relume.state.nodes[0].place";
    let opened = page.value(place);
    let drag = |page: &mut support::browser::Page<'_>| {
        let at = page.value("(() => { const svg = document.querySelector('.dial'); svg.scrollIntoView({block: 'center'}); const box = document.querySelector('.node .disc').getBoundingClientRect(); return [box.x + box.width / 2, box.y + box.height / 2]; })()");
        let from: [f64; 2] = serde_json::from_value(at).unwrap();
        page.drag(from, [from[0] - 20.0, from[1] + 30.0]);
    };
    drag(&mut page);
    assert_eq!(page.value(place), opened, "the hand was moved instead");
    page.value("[...document.querySelectorAll('button')].find((one) => one.textContent === 'Move lights').click()");
    drag(&mut page);
    assert_ne!(page.value(place), opened);
    page.value("[...document.querySelectorAll('button')].find((one) => one.textContent === 'Reset all').click()");
    assert_eq!(page.value(place), opened);
}

/// Every second pixel of every second row.
fn halved(film: &Film<f32>) -> Film<f32> {
    let [width, height] = film.size;
    let pixels = (0..height / 2).flat_map(|y| (0..width / 2).map(move |x| 2 * (y * width + x)));
    Film { size: [width / 2, height / 2], ..film.of_pixels(&pixels.collect::<Vec<_>>()) }
}

/// A text as a literal of a script in a page.
pub(super) fn in_script(text: &str) -> String {
    json!(text).to_string().replace('<', "\\u003c")
}

/// A page with a cell of a notebook, which shows a widget with these traits: what anywidget hands over, binary ones as views of a buffer by
/// `data(base64)`.
pub(super) fn cell(widget: &str, traits: &str, more: &str) -> String {
    format!(
        "<!DOCTYPE html><html lang=\"en\"><title>cell</title><body><div id=\"cell\"></div><script type=\"module\">\n\
         const data = (text) => new DataView(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);\n\
         const source = {}, cell = document.getElementById('cell'), heard = {{}}, traits = {traits};\n\
         const widget = (await import('data:text/javascript,' + encodeURIComponent(source))).default;\n\
         {more}\n\
         globalThis.saved = 0; globalThis.sent = [];\n\
         globalThis.model = {{get: (name) => traits[name], set: (name, value) => {{ traits[name] = value; heard[`change:${{name}}`]?.(); }}, save_changes: () => {{ saved++; }},\n\
         send: ({{ moves }}) => sent.push(...moves), on: (name, act) => {{ heard[name] = act; }}, off: (name) => {{ delete heard[name]; }},\n\
         tell: (all) => {{ Object.assign(traits, all); for (const name in all) heard[`change:${{name}}`]?.(); }}, say: (content) => heard['msg:custom'](content)}};\n\
         globalThis.leave = widget.render({{model, el: cell}});\n\
         const shadow = cell.firstChild.shadowRoot;\n\
         globalThis.root = shadow.querySelector('.relume');\n\
         document.querySelector = (name) => shadow.querySelector(name);\n\
         document.getElementById = () => root;\n</script></body></html>",
        in_script(widget)
    )
}

#[test]
fn the_widget_of_notebooks_lights_in_the_browser_and_moves_the_camera_in_python() {
    let (header, film) = read("glass.exr");
    let whole = page(&header, std::slice::from_ref(&film), 0.5).packed(&Quiet).unwrap();
    let small = halved(&film);
    let (quick, views) =
        page(&header, std::slice::from_ref(&small), 0.5).packed_at(whole.summary.step, &Quiet).unwrap();
    let quick_page: Value = serde_json::from_str(&quick).unwrap();
    assert_eq!([&quick_page["size"], &quick_page["largest_error"]], [&json!(small.size), &Value::Null]);
    let bytes = |bytes: &[u8]| format!("data({})", json!(STANDARD.encode(bytes)));
    let traits = format!(
        "{{_page: {}, _views: [{}], hand: [0, 0], picked: []}}",
        in_script(&whole.json),
        bytes(&whole.views[0])
    );
    let more = format!("globalThis.quick = {{_page: {}, _views: [{}]}};", in_script(&quick), bytes(&views[0]));
    let stub = cell(WIDGET, &traits, &more);
    let folder = Folder::new().with("cell.html", stub);
    let mut browser = Browser::new();
    let mut cell = browser.open(&folder.path("cell.html"), "", [1200, 900]);
    let before = cell.pixels();
    assert!(before.iter().any(|&code| code > 40), "a black picture proves nothing");
    // Python hears of the light once it rests, and moves the hand.
    let mixed = cell
        .value("[saved, model.get('_mix').map(([spectrum, weight, position]) => [spectrum.length, weight, position])]");
    assert_eq!(mixed[0], 1, "the light as it opens");
    let positions: Vec<&str> = header.positions.iter().map(|position| position.name.as_str()).collect();
    for light in mixed[1].as_array().unwrap() {
        assert_eq!(light[0], BANDS);
        assert!(light[1].as_f64().unwrap() > 0.0 && positions.contains(&light[2].as_str().unwrap()), "{light}");
    }
    cell.value("model.tell({hand: [0.4, -0.3]})");
    assert!(cell.pixels() != before, "the light has not changed");
    cell.value("document.querySelector('.hand').focus()");
    cell.press("Home");
    assert_eq!(cell.value("[saved, sent.length]"), json!([1, 0]), "the light is drawn without a message");
    cell.wait("saved > 1");
    assert_eq!(cell.value("model.get('hand')"), json!([0, 0]));
    // Drags, keys and the wheel move the camera; one message for each picture of the browser.
    let at = cell.value("(() => { const box = document.querySelector('.frame').getBoundingClientRect(); return [box.x + box.width / 2, box.y + box.height / 2, box.height]; })()");
    let [x, y, high]: [f64; 3] = serde_json::from_value(at).unwrap();
    let mouse = |cell: &mut support::browser::Page<'_>, kind: &str, [x, y]: [f64; 2], more: Value| {
        let mut event = json!({"type": kind, "x": x, "y": y, "button": "left", "buttons": 1, "clickCount": 1});
        event.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        cell.send("Input.dispatchMouseEvent", event);
    };
    mouse(&mut cell, "mousePressed", [x, y], json!({}));
    mouse(&mut cell, "mouseMoved", [x + 0.1 * high, y + 0.2 * high], json!({}));
    mouse(&mut cell, "mouseReleased", [x + 0.1 * high, y + 0.2 * high], json!({}));
    cell.wait("sent.length > 0");
    let [right, up] = [1, 2].map(|part| cell.value(&format!("sent[0][{part}]")).as_f64().unwrap());
    assert_eq!(cell.value("sent[0][0]"), "orbit");
    assert!(
        (right + 18.0).abs() < 0.5 && (up - 36.0).abs() < 0.5,
        "{right} {up}: half a turn for the height of the picture"
    );
    assert_eq!(cell.value("model.get('picked').length"), 0, "a drag picks no pixel");
    mouse(&mut cell, "mouseWheel", [x, y], json!({"deltaX": 0, "deltaY": -50}));
    cell.wait("sent.length > 1");
    let closer = cell.value("sent[1][1]").as_f64().unwrap();
    assert!(cell.value("sent[1][0]") == "dolly" && closer > 1.05 && closer < 1.2, "{closer}");
    cell.value("document.querySelector('.frame').focus()");
    cell.press("ArrowLeft");
    cell.wait("sent.length > 2");
    assert_eq!(cell.value("sent[2]"), json!(["orbit", -5, 0]));
    // Another picture takes the place of this one: the same elements under the same light.
    cell.value("model.tell({hand: [0.4, -0.3]}); globalThis.frame = document.querySelector('.frame')");
    cell.value("document.getElementById().removeAttribute('data-ready'); model.tell(quick)");
    cell.wait("document.getElementById().dataset.ready");
    assert_eq!(cell.value("[...document.querySelector('.frame').querySelectorAll('canvas')].map((one) => [one.width, one.height, one.hidden])"), json!([[small.size[0], small.size[1], false]]));
    assert_eq!(cell.value("document.querySelector('.frame') === frame && model.get('hand')"), json!([0.4, -0.3]));
    // As if it had been opened with it.
    let moved = cell.pixels();
    page(&header, std::slice::from_ref(&small), 0.5).packed(&Quiet).unwrap().write(&folder.path("small.html")).unwrap();
    let mut plain = browser.open(&folder.path("small.html"), "", [900, 700]);
    plain.value("relume.set({by: 'dial', hand: [0.4, -0.3]})");
    let off: Vec<u8> = plain.pixels().iter().zip(&moved).map(|(one, two)| one.abs_diff(*two)).collect();
    assert!(off.iter().all(|&off| off <= 4), "{:?} codes off", off.iter().max());
    let mut cell = browser.open(&folder.path("cell.html"), "", [1200, 900]);
    cell.value("model.say({error: 'SceneError: lost'})");
    assert_eq!(cell.value("document.querySelector('.status').textContent"), "SceneError: lost");
    cell.value("leave()");
    assert_eq!(cell.value("document.getElementById().childElementCount"), 0);
    assert_eq!(cell.complaints(), Vec::<String>::new());
}

#[test]
fn names_that_turn_text_are_told_by_numbers_in_the_command() {
    let (header, film) = hostile();
    let folder = Folder::new();
    page(&header, std::slice::from_ref(&film), 0.5).packed(&Quiet).unwrap().write(&folder.path("page.html")).unwrap();
    let mut browser = Browser::new();
    let mut shown = browser.open(&folder.path("page.html"), "", [900, 700]);
    let command = shown.value("document.querySelector('input[readonly]').value");
    let command = command.as_str().unwrap();
    assert!(command.contains("$'🐸\\U0000202egnp.exe="), "{command}");
    // A shell reads the name back.
    let script = format!("relume() {{ printf '%s\\n' \"$@\"; }}; {command}");
    let output = std::process::Command::new("bash").args(["-c", &script]).env("LC_ALL", "C.UTF-8").output().unwrap();
    let read = String::from_utf8(output.stdout).unwrap();
    assert!(read.contains(HOSTILE[2]) && read.contains(HOSTILE[0]), "{read}");
}

#[test]
fn reports_hold_a_page_of_what_they_show() {
    let folder = Folder::new().with("scene.toml", support::program::SCENE).with(
        "palette.toml",
        std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("data/palettes/metamers_two_lights.toml")).unwrap(),
    );
    folder.done(&[
        "measure",
        "scene.toml",
        "--sweep",
        "step=1",
        "--runs",
        "1",
        "--size",
        "40x40",
        "--pixels",
        "16",
        "-o",
        "measured.html",
    ]);
    folder.done(&["design", "palette.toml", "--report", "palette.html"]);
    let mut browser = Browser::new();
    for file in ["measured.html", "palette.html"] {
        let html = std::fs::read_to_string(folder.path(file)).unwrap();
        assert_eq!(parse_errors(&html), Vec::<String>::new(), "{file}");
        assert!(html.contains("kB of this file. Rounding adds at most ΔE00"), "{file} states its size");
        assert_eq!(html.matches("<iframe").count(), 1, "{file}");
        let (start, rest) = html.split_once("srcdoc='").unwrap();
        assert!(rest.find('\'').unwrap() < 1_200_000 && !start.contains("relume-view"), "{file}: one small page");
        let mut page = browser.open_frame(&folder.path(file), [1200, 900]);
        let before = page.pixels();
        assert!(before.iter().any(|&code| code > 40), "{file}: a black picture proves nothing");
        page.value("relume.set({by: 'sliders', keep: [false, true], lights: relume.state.lights.map((light, i) => ({...light, on: i === 1, source: 'FL11', value: 1}))})");
        assert!(page.pixels() != before, "{file}: the light has not changed");
        assert_eq!(page.complaints(), Vec::<String>::new(), "{file}");
    }
}

#[test]
fn the_pages_of_the_documentation_open() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs");
    let mut browser = Browser::new();
    let pages = ["frog", "labelled_frog", "engine", "stained_frog"].map(|name| format!("pages/{name}.html"));
    for name in pages.iter().map(String::as_str).chain(["gallery/cells.html"]) {
        let bytes = std::fs::metadata(folder.join(name)).unwrap().len();
        assert!(bytes <= 2_300_000, "{name} has {bytes} bytes");
        let mut page = browser.open(&folder.join(name), "#draw=cpu", [1280, 900]);
        assert!(page.pixels().iter().any(|&code| code > 100), "{name} is black");
        assert_eq!(page.complaints(), Vec::<String>::new(), "{name}");
    }
}

#[test]
fn the_address_holds_the_mix() {
    let folder = with_films();
    folder.done(&["page", "session.exr", "-o", "page.html"]);
    let mut browser = Browser::new();
    let mut page = browser.open(&folder.path("page.html"), "", [900, 700]);
    page.value("relume.set({by:'dial',hand:[0.25,-0.5],stops:0.5,observer:'1964',vision:'deutan',lights:relume.state.lights.map((light, i) => i ? light : {...light, source:'black body', kelvin:4200})})");
    page.wait("location.hash.includes('hand')");
    let (hash, before, colours) = (page.value("location.hash"), page.pixels(), page.value("relume.colours"));
    assert!(hash.as_str().unwrap().starts_with("#hand=0.25"), "{hash}");
    let mut again = browser.open(&folder.path("page.html"), hash.as_str().unwrap(), [900, 700]);
    assert_eq!(again.value("relume.state.lights[0].kelvin"), 4200);
    assert_eq!(again.value("relume.colours"), colours);
    // One page may be drawn by WebGL and the other by JavaScript.
    let off = again.pixels().iter().zip(&before).map(|(one, two)| one.abs_diff(*two)).max().unwrap();
    assert!(off <= 1, "{off} codes off");
    // Moved nodes are in the address; the command then names the lights instead of the dial.
    let place = again.value("relume.state.nodes[0].place");
    again.value(
        "relume.set({stops: 0, nodes: relume.state.nodes.map((node, n) => n ? node : {...node, place: [0.9, 0.8]})})",
    );
    again.wait("location.hash.includes('node.')");
    let (moved, weights) = (again.value("location.hash"), again.value("relume.colours"));
    let mut third = browser.open(&folder.path("page.html"), moved.as_str().unwrap(), [900, 700]);
    assert_eq!(third.value("relume.state.nodes[0].place"), json!([0.9, 0.8]));
    assert_eq!(third.value("relume.colours"), weights);
    let command = |page: &mut support::browser::Page<'_>| {
        page.value("document.querySelector('input[readonly]').value").as_str().unwrap().to_owned()
    };
    let written = command(&mut third);
    assert!(!written.contains("--dial") && written.contains("--light"), "{written}");
    third.value(&format!("relume.set({{lights: relume.state.lights.map((light) => ({{...light, source: ''}})), nodes: relume.state.nodes.map((node, n) => n ? node : {{...node, place: {place}}})}})"));
    assert!(command(&mut third).contains("--dial 0.25,-0.5"), "{}", command(&mut third));
    // What does not belong there is ignored.
    let mut odd = browser.open(
        &folder.path("page.html"),
        "#hand=x,1&view=1e99&stops=NaN&spectrum.one=9&solo=-7&pixel=1",
        [900, 700],
    );
    assert_eq!(
        odd.value("[relume.state.view, relume.state.stops, relume.state.solo, relume.state.pixel]"),
        json!([0, 0, -1, null])
    );
    assert_eq!(odd.complaints(), Vec::<String>::new());
}

#[test]
fn what_a_page_says_is_what_it_shows() {
    let folder = with_films();
    folder.done(&["page", "session.exr", "-o", "page.html"]);
    let mut browser = Browser::new();
    let mut page = browser.open(&folder.path("page.html"), "", [1200, 900]);
    let pressed = "document.querySelectorAll('.of-dial .buttons [aria-pressed=true]').length";
    let caption = "document.querySelector('.caption').textContent";
    // A preset is pressed, and its caption shown, until a light of it changes.
    for change in [
        "document.querySelector('li input[type=checkbox]').click()",
        "relume.state.lights[0].source = 'A', relume.set({})",
        "relume.set({by:'dial',hand:[0.1,0.1]})",
    ] {
        page.value("[...document.querySelectorAll('button')].find((one) => one.textContent === 'Reset all').click()");
        page.value("document.querySelector('.of-dial .buttons button').click()");
        assert_eq!(page.value(pressed), 1, "before {change}");
        assert_ne!(page.value(caption), "", "before {change}");
        page.value(change);
        assert_eq!(page.value(pressed), 0, "after {change}");
        assert_eq!(page.value(caption), "", "after {change}");
    }
    // On the dial, solo moves the hand to the light.
    page.value("relume.set({by:'dial',hand:[...relume.state.nodes[0].place]}); document.querySelectorAll('li .small')[1].click()");
    assert_eq!(
        page.value("[relume.state.by, document.querySelectorAll('li .head output')[1].textContent]"),
        json!(["dial", "100 %"])
    );
    // The hand stays on the dial.
    page.value("document.querySelector('.hand').focus(); relume.set({by:'dial',hand:[0,0]})");
    for _ in 0..99 {
        page.press("ArrowLeft");
    }
    let [x, least] = [
        "document.querySelector('.hand').getBoundingClientRect().left",
        "document.querySelector('.dial').getBoundingClientRect().left",
    ]
    .map(|text| page.value(text).as_f64().unwrap());
    assert!(x >= least - 30.0, "the hand at {x}, the dial from {least}");
    // Reset is of everything.
    page.value("['Move lights', 'Actual pixels'].forEach((text) => [...document.querySelectorAll('button')].find((one) => one.textContent === text).click())");
    page.value("relume.set({pixel:[1,1]})");
    page.press("Escape");
    assert_eq!(page.value("relume.state.pixel"), json!(null));
    page.value("[...document.querySelectorAll('button')].find((one) => one.textContent === 'Reset all').click()");
    assert_eq!(page.value("document.querySelectorAll('.whole, [aria-pressed=true]').length"), 0);
}

#[test]
fn a_phone_shows_the_whole_page_and_a_printer_the_picture_with_its_light() {
    let folder = with_films();
    folder.done(&["page", "session.exr", "-o", "page.html"]);
    let mut browser = Browser::new();
    let mut page = browser.open(&folder.path("page.html"), "", [390, 844]);
    assert_eq!(page.value("document.documentElement.scrollWidth"), 390);
    let narrow = page.value("document.querySelector('canvas').getBoundingClientRect().width");
    assert!((300.0..=390.0).contains(&narrow.as_f64().unwrap()), "{narrow}");
    let pdf = page.send("Page.printToPDF", json!({}));
    let pdf = STANDARD.decode(pdf["data"].as_str().unwrap()).unwrap();
    assert!(pdf.starts_with(b"%PDF") && pdf.len() > 4000, "{} bytes", pdf.len());
    page.send("Emulation.setEmulatedMedia", json!({"media": "print"}));
    let shown =
        |selector: &str| format!("[...document.querySelectorAll('{selector}')].some((one) => one.checkVisibility())");
    for (selector, is_shown) in
        [("canvas", true), (".words", true), (".curve", true), ("button", false), ("input", false)]
    {
        assert_eq!(page.value(&shown(selector)), is_shown, "{selector}");
    }
    assert!(page.value("document.querySelector('.words').textContent").as_str().unwrap().contains('%'));
}

#[test]
fn a_turntable_turns() {
    let (header, first) = film([8, 6], &[[0.8; BANDS]], 1, |_, pixel| if pixel % 2 == 0 { 0.9 } else { 0.0 });
    let turned = |view: usize| Film {
        accumulators: first
            .accumulators
            .iter()
            .map(|number| number * narrow(1.0 - 0.2 * support::scenes::float(view)))
            .collect(),
        ..first.clone()
    };
    let views: Vec<Film<f32>> = (0..4).map(turned).collect();
    let folder = Folder::new();
    let page = Page { columns: 4, ..page(&header, &views, 0.5) };
    page.packed(&Quiet).unwrap().write(&folder.path("page.html")).unwrap();
    let mut browser = Browser::new();
    let mut shown = browser.open(&folder.path("page.html"), "#draw=cpu", [900, 700]);
    let bright = |pixels: Vec<u8>| pixels.into_iter().max().unwrap();
    let first = bright(shown.pixels());
    // Changes of view before the first is unpacked.
    let source = "addEventListener('DOMContentLoaded', () => { for (const view of [1, 3, 2]) relume.set({view}); globalThis.changed = true; })";
    shown.send("Page.addScriptToEvaluateOnNewDocument", json!({"source": source}));
    shown
        .send("Page.navigate", json!({"url": format!("file://{}?again#draw=cpu", folder.path("page.html").display())}));
    shown.wait("globalThis.changed && document.getElementById('relume').dataset.ready");
    assert!(bright(shown.pixels()) < first);
    shown.value("relume.set({view: 0})");
    shown.value("document.querySelector('.frame').focus()");
    shown.press(".");
    shown.wait("relume.state.view === 1");
    shown.value("new Promise((go) => setTimeout(go, 200))");
    let second = bright(shown.pixels());
    assert!(second < first, "{second} of {first}");
    shown.press(",");
    shown.press(",");
    shown.wait("relume.state.view === 3");
}
