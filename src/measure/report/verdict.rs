//! Summary of the findings.

use super::Findings;
use super::drawing::escaped;
use super::eight::Carried;
use super::entry::{INVISIBLE, LEAST, seen, told_error};
use super::knobs::{step_in_voxels, worth};
use super::trust::Trust;
use crate::digits::short;
use crate::findings::{by_cause, cheapest, closest};
use crate::ladder::Cause;
use crate::measured::Measured;
use crate::setting::Value;
use relume_base::number::{brief, capital, readable};
use relume_scene::Scene;

/// ΔE00 that is just visible side by side.
const SEEN: f64 = 1.0;

/// Answers to the questions of a report, each after its question.
pub(super) fn verdict(scene: &Scene, findings: &Findings<'_>, carried: &Carried<'_>, trust: Trust) -> String {
    let rows = findings.rows;
    let Some(own) = rows.first() else { return String::new() };
    let rough = trust.rough().map(|times| {
        format!(
            "Times of the same work differ by a factor of up to {times:.1}, because other programs ran. The times are marked with ≈ \
             and choose no setting; errors are not affected. Measure again on an idle machine."
        )
    });
    let error = &own.error.delta_e;
    let ms = trust.ms(own.frame_ms);
    let [mean, p95, max] = [error.mean, error.p95, error.max].map(short);
    let now = format!(
        "A frame takes {ms} ms. The error is ΔE00 {mean} on average, below {p95} in 95 % of the pixels, and {max} in the worst compared pixel: {}.",
        seen(error)
    );
    let answers = [
        ("Rough times", rough),
        ("At the scene's own setting", Some(now)),
        ("Where the error comes from", Some(origin(scene, rows, own, trust))),
        ("Which setting to use", Some(advice(rows, own, trust))),
        ("Which knobs matter", worth(rows, scene, trust)),
        ("Effect of k = 8", bought(carried, trust)),
    ];
    let said = answers.into_iter().filter_map(|(question, answer)| Some((question, answer?)));
    said.map(|(question, answer)| format!("<p><b>{question}.</b> {}</p>\n", escaped(&answer))).collect()
}

/// Names the two largest causes with numbers, the reason for the first, and the causes of the worst pixel.
fn origin(scene: &Scene, rows: &[Measured], own: &Measured, trust: Trust) -> String {
    let mut causes: Vec<(Cause, f64)> = own
        .causes
        .iter()
        .map(|(cause, error)| (*cause, error.delta_e.mean))
        .filter(|(_, mean)| *mean >= LEAST)
        .collect();
    causes.sort_by(|one, two| two.1.total_cmp(&one.1));
    let sum: f64 = own.causes.iter().map(|(_, error)| error.delta_e.mean).sum();
    let told = |(cause, mean): &(Cause, f64)| format!("{} ({} on average)", cause.name(), short(*mean));
    let mut text = match causes.as_slice() {
        [] => return format!("No cause changes colours by {LEAST} or more on average."),
        [only] => format!("The cause is {}", told(only)),
        [first, second, ..] if first.1 > sum / 2.0 => {
            format!("The main cause is {}, followed by {}", told(first), told(second))
        }
        [first, second, ..] => format!("The causes are {} and {}", told(first), told(second)),
    };
    if causes.len() > 1 && sum > own.error.delta_e.mean + LEAST {
        text.push_str("; they partly cancel");
    }
    text.push_str(&format!(". {}.", capital(&why(causes[0].0, scene, own))));
    if causes[0].0 == Cause::Step {
        text.push_str(&halved(scene, rows, own, trust).unwrap_or_default());
    }
    let mut worst: Vec<&(Cause, f64)> = own.worst_by.iter().filter(|(_, error)| *error >= LEAST).collect();
    worst.sort_by(|one, two| two.1.total_cmp(&one.1));
    let worst: Vec<String> =
        worst.iter().take(2).map(|(cause, error)| format!("{} by {}", cause.name(), short(*error))).collect();
    if !worst.is_empty() {
        text.push_str(&format!(" In the worst pixel: {}.", worst.join(", ")));
    }
    text
}

/// Effect of halving the step, if twice the scene's own step was measured.
fn halved(scene: &Scene, rows: &[Measured], own: &Measured, trust: Trust) -> Option<String> {
    let step = step_in_voxels(scene);
    let twice = |row: &&Measured| match row.setting.get("step") {
        Some(Value::Number(number)) => (number / step - 2.0).abs() < 1e-9 && row.setting.knobs().count() == 1,
        _ => false,
    };
    let before = rows.iter().find(twice)?;
    let [ms, ms_before] = [own, before].map(|row| short(row.frame_ms));
    let [p95, p95_before] = [own, before].map(|row| short(row.error.delta_e.p95));
    let took = if trust.is_rough() {
        String::new()
    } else if trust.is_faster(before, own) {
        format!("took {:.1} times as long ({ms_before} → {ms} ms) and ", own.frame_ms / before.frame_ms)
    } else {
        "took no longer within the spread of times and ".to_owned()
    };
    Some(format!(
        " Halving the step, from {} voxels to {}, {took}changed p95 from {p95_before} to {p95}.",
        readable(2.0 * step),
        readable(step)
    ))
}

fn why(cause: Cause, scene: &Scene, own: &Measured) -> String {
    match cause {
        Cause::PixelArea => {
            let (rays, plural) = (scene.accuracy.rays, if scene.accuracy.rays == 1 { "" } else { "s" });
            format!("{rays} ray{plural} miss{} parts of a pixel", if rays == 1 { "es" } else { "" })
        }
        Cause::Step => {
            let step = step_in_voxels(scene);
            if step > 1.0 {
                format!("structures thinner than a step ({} voxels) can be missed", readable(step))
            } else {
                format!(
                    "where the transfer function changes sharply between neighbouring voxels, a coloured layer can be thinner \
                     than a step ({} voxel)",
                    readable(step)
                )
            }
        }
        Cause::Interpolation => "the interpolation between voxels differs from the scene's".to_owned(),
        Cause::Termination => {
            format!("rays end at a transmittance of {}", readable(scene.accuracy.termination))
        }
        Cause::Level => {
            format!("means of blocks take the place of voxels, up to {} pixels", readable(scene.accuracy.voxel_pixels))
        }
        Cause::LightGrid => {
            format!("shadows come from a grid with a node every {} voxels", readable(scene.shadows.spacing))
        }
        Cause::Scattering => format!(
            "scattered light is known at places {} voxels apart, from {} directions",
            brief(scene.scattering_spacing()),
            scene.scattering_directions()
        ),
        Cause::Basis => format!("{} coefficients represent a spectrum of 81 bands", own.components),
        Cause::Tables => "the transfer function is a table, and the volume a texture".to_owned(),
        Cause::Rounding => "the arithmetic has 32 bits".to_owned(),
        Cause::Device => "the device has its own filtering and rounding".to_owned(),
        Cause::Resolution => "fewer pixels are marched than shown".to_owned(),
    }
}

/// Recommends the setting that stays within [`SEEN`].
fn advice(rows: &[Measured], own: &Measured, trust: Trust) -> String {
    let within = |row: &&Measured| row.error.delta_e.p95 <= SEEN;
    let Some(fits) = cheapest(rows, SEEN) else {
        let best = closest(rows).unwrap_or(own);
        return format!(
            "No measured setting is within ΔE00 {SEEN} in 95 % of the pixels; the closest on average is {} (p95 {}). relume render \
             --max-error {SEEN} changes several knobs together, and tries more settings.",
            super::entry::name(&best.setting),
            short(best.error.delta_e.p95)
        );
    };
    let Some(fastest) = trust.cheapest(rows, SEEN) else {
        let best = trust.most_exact(rows).unwrap_or(own);
        let exact = if within(&own) {
            "The scene's own is accurate enough".to_owned()
        } else {
            format!("The scene's own is not within ΔE00 {SEEN}, and {} is", super::entry::name(&best.setting))
        };
        return format!("{exact}; the times are too rough to name a faster setting.");
    };
    let p95 = short(fastest.error.delta_e.p95);
    let [ms, own_ms] = [fastest, own].map(|row| short(row.frame_ms));
    if fastest.times == own.times {
        let maybe = Some(fits).filter(|row| row.times != own.times);
        let beside = maybe.map_or_else(String::new, |row| {
            format!(" ({} was faster, but within the spread of times)", super::entry::name(&row.setting))
        });
        return format!(
            "The scene's own: no measured setting within ΔE00 {SEEN} is faster beyond the spread of times{beside}."
        );
    }
    let exact = if own.error.delta_e.p95 <= INVISIBLE { " The scene's own is accurate enough, too." } else { "" };
    format!(
        "Within ΔE00 {SEEN}, use {}: {ms} ms instead of {own_ms}, and 95 % of the pixels are below ΔE00 {p95} (worst {}).{exact}",
        super::entry::name(&fastest.setting),
        short(fastest.error.delta_e.max)
    )
}

/// Compares the error and cost of k = 8 with RGB.
fn bought(carried: &Carried<'_>, trust: Trust) -> Option<String> {
    let (eight, (rgb, kind, number)) = (carried.eight?, carried.rgb?);
    let [p95, rgb_p95] = [eight, rgb].map(|row| short(row.error.delta_e.p95));
    let [ms, rgb_ms] = [eight, rgb].map(|row| short(row.frame_ms));
    let time = if trust.is_rough() {
        String::new()
    } else {
        let apart = if trust.is_faster(rgb, eight) { "" } else { " (their runs overlap)" };
        format!("{ms} ms instead of {rgb_ms}{apart} and ")
    };
    let of = if number > 1 { format!(", the best of {number} kinds by p95") } else { String::new() };
    Some(format!(
        "95 % of the pixels are below ΔE00 {p95} instead of {rgb_p95} with RGB ({kind}{of}), for {time}{} bytes per pixel instead of {}. \
         The model alone adds {} on average instead of {}.",
        eight.pixel_bytes,
        rgb.pixel_bytes,
        told_error(by_cause(eight, Cause::Basis)),
        told_error(by_cause(rgb, Cause::Basis))
    ))
}
