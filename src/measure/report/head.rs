//! Head of the page: what was measured, on which device and under which light.

use std::collections::BTreeMap;
use std::time::{SystemTime, UNIX_EPOCH};

use super::Findings;
use super::drawing::escaped;
use super::knobs::step_in_voxels;
use super::trust::Trust;
use crate::findings::spread;
use crate::measured::Measured;
use crate::survey::Survey;
use crate::written::written;
use relume_base::number::{brief, count, readable};
use relume_colour::spectrum::observer::Observer;
use relume_scene::{Mix, Scene};

/// Scene, light, pixels, times and the scene's own setting, one line each.
pub(super) fn head(survey: &Survey<'_>, findings: &Findings<'_>, trust: Trust) -> String {
    let [width, height] = survey.lattice().size;
    let runs = survey.options().runs;
    let cpu = if survey.is_software() {
        " These are CPU times, without a graphics card: a GPU is faster and may rank settings differently, so measure again there."
    } else {
        ""
    };
    let scene = survey.scene();
    let mut lines = vec![
        format!(
            "<small>{}; Relume {}{}</small>",
            escaped(&scene.name),
            env!("CARGO_PKG_VERSION"),
            SystemTime::now()
                .duration_since(UNIX_EPOCH)
                .map_or_else(|_| String::new(), |now| format!("; {}", day(now.as_secs())))
        ),
        format!("Light: {}. The errors are for this light only.", escaped(&light(scene, findings.spectra))),
        format!(
            "{} in pictures of {width}×{height}, with the truth: the full spectrum in f64, in steps of {} voxels (an eighth of the \
             shortest measured step).",
            compared(survey),
            brief(finest_in_voxels(scene, findings) / 8.0)
        ),
        format!(
            "Times on {}{}: median of {runs} run{}{}.{cpu}",
            escaped(&device(&survey.device().replace(", a software device: times are this CPU's", ""))),
            escaped(&processor().map_or_else(String::new, |name| format!(", {name}"))),
            if runs == 1 { "" } else { "s" },
            if trust.is_rough() {
                ", which are rough".to_owned()
            } else if spread(findings.rows) <= 0.0 {
                ", so the spread of times is unknown".to_owned()
            } else {
                format!(
                    ", with a median spread of ±{:.0} %; two settings whose runs overlap count as equally fast",
                    100.0 * spread(findings.rows)
                )
            }
        ),
    ];
    lines.extend(findings.rows.first().map(|own| setting(scene, own)));
    lines.iter().map(|line| format!("<p class=\"about\">{line}</p>\n")).collect()
}

/// Shortest step measured, in voxels.
fn finest_in_voxels(scene: &Scene, findings: &Findings<'_>) -> f64 {
    let refused = findings.refused.iter().map(|(setting, _)| setting);
    let settings = findings.rows.iter().map(|row| &row.setting).chain(refused);
    settings.map(|setting| step_in_voxels(&setting.applied(scene))).fold(step_in_voxels(scene), f64::min)
}

/// UTC date of a time in seconds since 1970, by the calendar of 400-year eras that begin in March (Hinnant 2013,
/// `civil_from_days`).
fn day(seconds: u64) -> String {
    let days = seconds / 86_400 + 719_468;
    let (era, of_era) = (days / 146_097, days % 146_097);
    let year = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year + year / 4 - year / 100);
    let month = (5 * of_year + 2) / 153;
    let day = of_year - (153 * month + 2) / 5 + 1;
    let month = if month < 10 { month + 3 } else { month - 9 };
    format!("{}-{month:02}-{day:02}", year + 400 * era + u64::from(month <= 2))
}

/// Description of a device, without its name if the driver's text contains it.
fn device(text: &str) -> String {
    let name = text.split(' ').next().unwrap_or("");
    let driver = text.split_once(&format!(" ({name} ")).and_then(|(_, driver)| driver.strip_suffix(')'));
    driver.map_or_else(|| text.to_owned(), |driver| format!("{name} {driver}"))
}

/// Processor name and number of threads, if the system tells the name.
fn processor() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let name = text.lines().find_map(|line| line.strip_prefix("model name")?.split_once(": "))?.1.trim().to_owned();
    let threads = std::thread::available_parallelism().ok()?;
    Some(format!("{name}, {threads} threads"))
}

/// Lights with their intensities, and the observer.
fn light(scene: &Scene, spectra: &BTreeMap<String, String>) -> String {
    let lights: Vec<String> = Mix::of_scene(scene)
        .0
        .iter()
        .filter(|light| light.weight > 0.0)
        .map(|light| {
            let spectrum = spectra.get(&light.name).map_or_else(String::new, |spectrum| format!("{spectrum}, "));
            format!("{} ({spectrum}intensity {})", light.name, readable(light.weight))
        })
        .collect();
    let lights = match lights.len() {
        0 => "none".to_owned(),
        1 => lights.concat(),
        _ => lights.join(" and ") + " together",
    };
    let observer = match scene.display.observer {
        Observer::Cie1931 => "the CIE 1931 observer (2°)",
        Observer::Cie1964 => "the CIE 1964 observer (10°)",
    };
    let adapted = if scene.display.adapt { " (adapted: their white is the screen's white)" } else { "" };
    format!("{lights}{adapted}, seen by {observer}")
}

/// Number of compared pixels, and of all that show the volume.
fn compared(survey: &Survey<'_>) -> String {
    let (found, stride) = (survey.pixels().len(), survey.lattice().stride);
    if stride == 1 {
        return format!("All {found} pixels that show the volume were compared");
    }
    // Two digits, because it is an estimate.
    let all = count(found * stride * stride);
    let digit = 10_f64.powf((all.max(1.0).log10() - 1.0).floor());
    let all = readable((all / digit).round() * digit);
    format!(
        "{found} pixels were compared (a grid, one in {stride} across and down) of about {all} that show the volume,"
    )
}

/// Values of all knobs in the scene.
fn setting(scene: &Scene, own: &Measured) -> String {
    let keys: Vec<String> = written(scene)
        .iter()
        .map(|(path, value)| {
            format!("{} = {value}", path.trim_start_matches("accuracy.").trim_start_matches("shadows."))
        })
        .collect();
    let entries = if scene.transfer.entries.is_none() { "; transfer.entries chosen by the data" } else { "" };
    format!(
        "The scene's own setting: <code>{}</code>{entries}. A pixel stores {} in {} bytes.",
        escaped(&keys.join(", ")),
        escaped(&own.carrier),
        own.pixel_bytes
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_those_of_the_calendar() {
        let days = [0, 951_782_399, 951_782_400, 951_868_800, 4_107_542_400];
        assert_eq!(days.map(day), ["1970-01-01", "2000-02-28", "2000-02-29", "2000-03-01", "2100-03-01"]);
    }

    #[test]
    fn a_device_whose_driver_has_its_name_is_named_once() {
        let software = "llvmpipe (LLVM 15.0.6, 256 bits) (llvmpipe Mesa 22.3.6 (LLVM 15.0.6))";
        assert_eq!(device(software), "llvmpipe Mesa 22.3.6 (LLVM 15.0.6)");
        assert_eq!(device("A Card (a driver 1.2)"), "A Card (a driver 1.2)");
    }
}
