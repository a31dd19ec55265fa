//! Rendering settings of OMERO (`omero render`) in JSON: windows and colours of channels.

use serde_json::Value;

use super::Channel;
use relume_base::number::readable;
use relume_colour::spectrum::srgb_code;

/// The channels, in the order of their numbers; at least one is active.
pub(super) fn channels(file: &Value) -> Result<Vec<Channel>, String> {
    let table = file["channels"].as_object().ok_or("channels is no table of numbered channels")?;
    let is_grey = file["greyscale"].as_bool().unwrap_or(false);
    let channel = |(key, stated): (&String, &Value)| {
        let number: usize = key
            .parse()
            .ok()
            .filter(|&number| number > 0)
            .ok_or_else(|| format!("the channel {key:?} has no number from 1 on"))?;
        channel(number, stated, is_grey).map_err(|problem| format!("channel {number}: {problem}"))
    };
    let mut channels: Vec<Channel> = table.iter().map(channel).collect::<Result<_, String>>()?;
    channels.sort_by_key(|channel| channel.number);
    if channels.iter().any(|channel| channel.is_active) { Ok(channels) } else { Err("no channel is active".to_owned()) }
}

fn channel(number: usize, stated: &Value, is_grey: bool) -> Result<Channel, String> {
    // Version 1 calls the ends of the window min and max; with start and end, they are those of all values.
    let end = |first: &str, second: &str| {
        let found = [first, second].iter().find_map(|key| stated[*key].as_f64());
        found.ok_or_else(|| format!("it states no window ({first} and {second}, or start and end)"))
    };
    let window = [end("start", "min")?, end("end", "max")?];
    if window[0] >= window[1] {
        return Err(format!("its window ends at {}, and begins at {}", readable(window[1]), readable(window[0])));
    }
    let colour = match stated["color"].as_str().filter(|_| !is_grey) {
        Some(code) => {
            let code = format!("#{}", code.trim_start_matches('#'));
            srgb_code(&code).map_err(|error| error.to_string())?.map(|part| f64::from(part) / 255.0)
        }
        None => [1.0; 3],
    };
    Ok(Channel {
        number,
        label: stated["label"].as_str().map(str::to_owned),
        is_active: stated["active"].as_bool().unwrap_or(true),
        window,
        colour,
    })
}
