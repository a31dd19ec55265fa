//! The text of a page: HTML, JSON, and the digests of its script and style.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::{DMat3, DVec3};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use super::lights::Lights;
use super::packing::{Channels, scale};
use super::{LIVE_SCRIPT, PackedLive, Page, Planes, SCRIPT, STYLE};
use crate::annotate::{Entry, Overlay};
use crate::output::SOFTWARE;
use crate::output::film::Components as FileComponents;
use relume_base::number::count;
use relume_colour::spectrum::colour::{LINEAR_SRGB_FROM_XYZ, bradford_cones, d65_white, display_code};
use relume_colour::spectrum::deficiency::Deficiency;
use relume_colour::spectrum::observer::Observer;
use relume_colour::spectrum::{Light, Spectrum};
use relume_scene::Tone;
use relume_scene::film::Components;

/// Version of the data of a page.
const FORMAT: u32 = 2;

/// The HTML of `page`, and its JSON.
pub(super) fn page(
    page: &Page<'_>,
    lights: &Lights,
    planes: &Planes,
    still: &[u8],
    live: Option<&PackedLive>,
) -> (String, String) {
    let script = if live.is_some() { LIVE_SCRIPT } else { SCRIPT };
    let json = json(page, lights, planes);
    let views = planes.views.iter().enumerate().map(|(index, bytes)| {
        format!("<script type=\"text/plain\" id=\"relume-view-{index}\">{}</script>\n", STANDARD.encode(bytes))
    });
    let views: String = views.collect();
    let overlay = overlay(page);
    let style_of_overlay = overlay.as_ref().map_or_else(String::new, |style| format!(" '{}'", digest(style)));
    let policy = format!(
        "default-src 'none'; script-src '{}'; style-src '{}'{style_of_overlay}; img-src data: blob:; base-uri 'none'; \
         form-action 'none'; require-trusted-types-for 'script'",
        digest(script),
        digest(STYLE)
    );
    let overlay = overlay.map_or_else(String::new, |style| format!("<style>{style}</style>\n"));
    let title = escaped(page.title);
    let parts = [
        ("policy", policy.as_str()),
        ("software", SOFTWARE),
        ("title", &title),
        ("style", STYLE),
        ("overlay", &overlay),
        ("legend", &legend(page, lights)),
        ("still", &STANDARD.encode(still)),
        ("page", &json),
        ("views", &views),
        ("live", &live.map_or_else(String::new, PackedLive::html)),
        ("script", script),
    ];
    (filled(include_str!("page.html"), &parts), json)
}

/// Longer side of a picture for which scale bar and letters are drawn at least, in pixels.
const NOMINAL: usize = 800;

/// Style that draws the scale bar and the letters of the film over the picture of every size, if it states them. A turntable has
/// no letters: they turn with it.
fn overlay(page: &Page<'_>) -> Option<String> {
    let mut frame = page.film.scale().filter(|frame| frame.pixel.is_some() || frame.edges.is_some())?;
    if page.views.len() > 1 {
        frame.edges = None;
    }
    // A page enlarges small pictures, and letters would grow with them.
    let [width, height] = page.views.first()?.size;
    let times = NOMINAL.div_ceil(width.max(height).max(1));
    if let Some(pixel) = &mut frame.pixel {
        pixel.units /= count(times);
    }
    let svg = Overlay::default().svg(&frame, [width * times, height * times]);
    Some(format!(
        ".relume .frame::before {{ content: \"\"; position: absolute; inset: 0; pointer-events: none; print-color-adjust: exact; \
         background: url(\"data:image/svg+xml;base64,{}\") 0 0 / 100% 100% no-repeat; }}",
        STANDARD.encode(svg)
    ))
}

/// HTML of a legend: the materials in their colours under the lights with which the page opens; empty with a colour model.
fn legend(page: &Page<'_>, lights: &Lights) -> String {
    let materials = page.film.materials();
    if materials.is_empty() {
        return String::new();
    }
    let entries =
        Overlay::of_surfaces(&materials, lights.opened.positions, &lights.opening, &lights.opened.display).materials;
    let entry = |entry: &Entry| {
        format!(
            "<p><svg width=\"14\" height=\"14\" aria-hidden=\"true\"><rect width=\"14\" height=\"14\" rx=\"3\" fill=\"{}\"/></svg> \
             <bdi>{}</bdi></p>\n",
            display_code(entry.colour),
            escaped(&entry.name)
        )
    };
    format!(
        "<section class=\"relume-legend\" aria-label=\"Materials\">\n<h2>Materials, under the lights with which the page \
         opens</h2>\n{}</section>\n",
        entries.iter().map(entry).collect::<String>()
    )
}

/// `template` with each `{name}` of `parts` replaced by its text, which is not searched again.
fn filled(template: &str, parts: &[(&str, &str)]) -> String {
    let mut text = String::with_capacity(parts.iter().map(|(_, part)| part.len()).sum::<usize>() + template.len());
    let mut rest = template;
    while let Some((before, after)) = rest.split_once('{') {
        text.push_str(before);
        let known = after
            .split_once('}')
            .and_then(|(name, rest)| parts.iter().find(|(known, _)| *known == name).map(|(_, part)| (*part, rest)));
        match known {
            Some((part, behind)) => {
                text.push_str(part);
                rest = behind;
            }
            None => {
                text.push('{');
                rest = after;
            }
        }
    }
    text + rest
}

/// Source of a Content Security Policy that allows exactly this text.
fn digest(text: &str) -> String {
    format!("sha256-{}", STANDARD.encode(Sha256::digest(text.as_bytes())))
}

/// Text for HTML, in an element or an attribute in double quotes. Controls are blanks; those of text direction would reverse what follows.
#[must_use]
pub fn escaped(text: &str) -> String {
    let mut written = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => written.push_str("&amp;"),
            '<' => written.push_str("&lt;"),
            '>' => written.push_str("&gt;"),
            '"' => written.push_str("&quot;"),
            '\'' => written.push_str("&#39;"),
            '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' => {}
            letter if letter.is_control() => written.push(' '),
            letter => written.push(letter),
        }
    }
    written
}

/// A number of seven digits.
fn brief(number: f64) -> f64 {
    format!("{number:.6e}").parse().unwrap_or(number)
}

/// Numbers of seven digits.
fn list<'a>(numbers: impl IntoIterator<Item = &'a f64>) -> Value {
    numbers.into_iter().map(|&number| number_of(brief(number))).collect()
}

/// A number as JSON; whole ones without a fraction.
#[expect(clippy::cast_possible_truncation, reason = "whole numbers below 2⁵³")]
fn number_of(number: f64) -> Value {
    if number.fract() == 0.0 && number.abs() < 1e15 { json!(number as i64) } else { json!(number) }
}

fn spectrum(spectrum: &Spectrum) -> Value {
    list(spectrum.samples())
}

/// Rows of a matrix.
fn rows(matrix: DMat3) -> Value {
    let row = |axis: DVec3| json!((matrix.transpose() * axis).to_array());
    [DVec3::X, DVec3::Y, DVec3::Z].map(row).into_iter().collect()
}

/// The JSON of a page, with no `<` in it.
pub(super) fn json(page: &Page<'_>, lights: &Lights, planes: &Planes) -> String {
    let film = page.film;
    let of_light = |light: &Light| -> Vec<(&'static str, Value)> {
        let mut keys = vec![("spectrum", spectrum(light.spectrum()))];
        if lights.model(0).is_some() {
            let models = (0..Observer::ALL.len()).filter_map(|seen| lights.model(seen));
            let matrices: Vec<_> = models.map(|model| model.matrix(light)).collect();
            let error = matrices.iter().map(|matrix| matrix.worst().max).fold(0.0, f64::max);
            keys.push(("matrices", matrices.iter().map(|matrix| list(matrix.xyz.as_flattened())).collect()));
            keys.push(("error", json!((error * 1e3).round() / 1e3)));
        }
        keys
    };
    let object = |keys: Vec<(&'static str, Value)>| -> Value {
        Value::Object(keys.into_iter().map(|(key, value)| (key.to_owned(), value)).collect())
    };
    let of_film = film.lights.iter().zip(&lights.stated.0).map(|(stored, light)| {
        let mut keys = vec![
            ("name", json!(stored.name)),
            ("position", json!(stored.position)),
            ("weight", json!(brief(light.weight))),
            ("shown", json!(brief(stored.shown.unwrap_or(stored.weight)))),
        ];
        keys.extend(of_light(&light.spectrum));
        object(keys)
    });
    let standards = lights.standards.iter().map(|(name, light)| {
        let mut keys = vec![("name", json!(name))];
        keys.extend(of_light(light));
        object(keys)
    });
    let first = &page.views[0];
    let mut written = json!({
        "format": FORMAT,
        "software": SOFTWARE,
        "title": page.title,
        "size": first.size,
        "views": page.views.len(),
        "columns": page.columns,
        "first": page.first(),
        "tolerance": page.tolerance,
        "largest_error": planes.found.largest.map(|largest| (largest * 1e4).ceil() / 1e4),
        "positions": film.positions.iter().map(|position| &position.name).collect::<Vec<_>>(),
        "lights": of_film.collect::<Vec<_>>(),
        "standards": standards.collect::<Vec<_>>(),
        "dial": film.dial,
        "exposure": film.exposure.unwrap_or(1.0),
        "soft": film.tone == Tone::Soft,
        "adapt": film.adapt,
        "observer": film.observer,
        "observers": Observer::ALL.map(|observer| observer.matching().each_ref().map(spectrum)),
        "srgb": rows(*LINEAR_SRGB_FROM_XYZ),
        "cones": rows(bradford_cones()),
        "white": d65_white().0,
        "deficiencies": Deficiency::ALL.map(|one| json!({"name": one.to_string(), "matrix": rows(one.matrix())})),
        "channels": channels(&planes.channels, planes),
        "large": planes.large,
        "groups": planes.channels.groups.iter().map(|group| json!({
            "first": group.first,
            "matrix": group.rows,
        })).collect::<Vec<_>>(),
    });
    match (&film.components, &lights.observed[0].components) {
        (FileComponents::Surfaces(surfaces), _) => {
            written["components"] = surfaces
                .iter()
                .map(|surface| json!({"name": surface.name, "spectrum": list(&surface.spectrum)}))
                .collect();
            written["background"] = film.background.as_ref().map_or(Value::Null, list);
        }
        (_, Components::Model(model, _)) => {
            let reconstruction = model.reconstruction();
            let errors = reconstruction.errors.iter().map(|(_, error)| error.max).fold(0.0, f64::max);
            written["model"] = json!({
                "k": model.dimension(),
                "description": model.description(),
                "spectra": reconstruction.spectra.iter().map(spectrum).collect::<Vec<_>>(),
                "error": (errors * 1e3).round() / 1e3,
            });
            if let Some(background) = &lights.opened.background {
                written["background"] = spectrum(background.spectrum());
                if lights.behind() > 1 {
                    written["behind"] = list(&model.coefficients(background.spectrum()));
                }
            }
        }
        (FileComponents::Model(_), Components::Surfaces(_)) => {}
    }
    // No end of a script and no comment, whatever names contain; line separators end a line in old scripts.
    written.to_string().replace('<', "\\u003c").replace('\u{2028}', "\\u2028").replace('\u{2029}', "\\u2029")
}

/// Storage of the numbers of each channel.
fn channels(channels: &Channels, planes: &Planes) -> Value {
    let one = |(&gain, kept): (&f64, &super::Channel)| json!({"zero": kept.zero, "scale": scale(gain, planes.found.step), "wide": kept.wide, "empty": kept.empty});
    channels.gains.iter().zip(&planes.kept).map(one).collect()
}
