//! `relume measure --extremes`: scenes with very large, very small or missing inputs.

use serde_json::{Map, json};

use crate::measure::extremes::{self, derivations, to_csv, to_markdown, to_text};
use crate::progress::Progress;
use crate::render::Renderer;
use crate::vulkan::{Device, DeviceChoice, Validation};

use super::{CliError, Report};

/// Evaluates every extreme. After a cancellation, the finished ones are printed.
pub(super) fn run(
    device: &DeviceChoice,
    csv: bool,
    markdown: bool,
    progress: &dyn Progress,
) -> Result<Report, CliError> {
    let renderer = Renderer::new(Device::open(device, Validation::Off)?);
    let (rows, all) = extremes::run(Some(&renderer), progress);
    if rows.is_empty() {
        return Err(CliError::Cancelled);
    }
    let info = renderer.device().info();
    let text = match (csv, markdown) {
        (true, _) => to_csv(&rows),
        (_, true) => to_markdown(&rows),
        _ => {
            let end = if all { "" } else { "\ninterrupted: only the finished extremes are listed\n" };
            format!("The extremes on {}\n\n{}{end}", info.name, to_text(&rows))
        }
    };
    let bounds: Map<_, _> = derivations(&rows).into_iter().map(|[name, why]| (name.to_owned(), why.into())).collect();
    let json = json!({
        "device": info.name,
        "holds": rows.iter().all(|row| row.holds),
        "rows": rows,
        "bounds": bounds,
        "interrupted": !all,
    });
    Ok(Report { text, json })
}
