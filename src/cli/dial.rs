//! The light dial on the command line: one mix, or the mixes along a path of the hand.

use clap::{Args, ValueEnum};
use glam::{DVec2, DVec3};

use crate::document::Dial;
use crate::measure::equal_steps;
use crate::number::{count, whole};
use crate::scene::Mix;

use super::CliError;

/// Heading in `--help`.
const DIAL: &str = "Light dial (one node per light, at the positions of [dial] in the scene)";

/// The dial and the position or path of its hand.
#[derive(Debug, Args)]
#[group(id = "hand")]
pub(crate) struct DialArgs {
    /// Put the hand of the dial at this position. The weight of a light is proportional to 1/distance from the hand to its
    /// node; on a node, only its light is on. Without [dial], the nodes are the corners of a regular polygon of radius 1
    /// around 0,0, clockwise from 0,1.
    #[arg(long, help_heading = DIAL, value_name = "X,Y", value_parser = place, allow_hyphen_values = true)]
    #[arg(conflicts_with_all = ["lights", "sweep", "closed"])]
    dial: Option<DVec2>,
    /// Mix the lights as in this dial preset; `relume info` lists the presets.
    #[arg(long, alias = "situation", help_heading = DIAL, value_name = "NAME", conflicts_with_all = ["lights", "dial", "sweep", "closed"])]
    dial_preset: Option<String>,
    /// Move the hand straight from the node of light A to the node of light B: one picture per frame. Only these two
    /// lights are on, unless [dial] in the scene places the nodes.
    #[arg(long, help_heading = DIAL, value_name = "A..B", conflicts_with_all = ["lights", "closed"])]
    #[arg(group = "moves")]
    sweep: Option<String>,
    /// Move the hand over all nodes and back to the first: one picture per frame, for a seamless loop.
    #[arg(long = "loop", alias = "tour", help_heading = DIAL, conflicts_with = "lights", group = "moves")]
    closed: bool,
    /// Number of pictures of a sweep or loop: NAME-0001.png and so on, or the frames of NAME.apng.
    #[arg(long, help_heading = DIAL, value_name = "N", default_value_t = 25)]
    #[arg(value_parser = clap::value_parser!(u16).range(1..), requires = "moves")]
    frames: u16,
    /// Spacing of these pictures: equal steps of the hand, or equal visible changes (mean ΔE00 of the visible pixels).
    #[arg(long, help_heading = DIAL, value_enum, default_value = "hand", requires = "moves")]
    steps: Steps,
    /// Switch off the node of the light NAME (repeatable).
    #[arg(long, help_heading = DIAL, value_name = "NAME", conflicts_with = "lights")]
    nodes_off: Vec<String>,
}

/// Spacing of the pictures of a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Steps {
    Hand,
    Visible,
}

/// Number of positions of the path per picture, between which visible changes are measured.
const FINER: usize = 8;
/// Largest number of these positions.
const FINEST: usize = 400;

/// Path of the hand and the dial it belongs to.
pub(crate) struct Hand {
    /// Positions of the hand, one per picture.
    pub(crate) places: Vec<DVec2>,
    dial: Dial,
}

impl DialArgs {
    /// Whether a flag sets the dial.
    pub(crate) fn is_given(&self) -> bool {
        self.dial.is_some() || self.dial_preset.is_some() || self.pictures().is_some() || !self.nodes_off.is_empty()
    }

    /// Number of pictures of a path; `None` for a single position.
    pub(crate) fn pictures(&self) -> Option<u16> {
        (self.sweep.is_some() || self.closed).then_some(self.frames)
    }

    /// Applies the flags to `dial`; `None` without flags for it. For pictures of equal visible change, `shown` relights a
    /// mix.
    pub(crate) fn hand(
        &self,
        dial: &Dial,
        stated: &Mix,
        shown: impl Fn(&Mix) -> Vec<DVec3>,
    ) -> Result<Option<Hand>, CliError> {
        if self.steps == Steps::Hand {
            return self.hand_of(dial.clone(), self.frames.into());
        }
        let finer = (FINER * usize::from(self.frames)).min(FINEST);
        let Some(mut path) = self.hand_of(dial.clone(), finer)? else { return Ok(None) };
        if self.closed {
            path.places.extend(path.places.first().copied());
        }
        let pictures = path.mixes(stated).into_iter().map(|mix| shown(&mix));
        let positions = equal_steps(pictures, self.frames.into(), self.closed);
        let places = positions.into_iter().map(|position| path.at(position)).collect();
        Ok(Some(Hand { places, ..path }))
    }

    /// Applies the flags to `dial` for a path of `frames` positions.
    fn hand_of(&self, mut dial: Dial, frames: usize) -> Result<Option<Hand>, CliError> {
        let mut at = self.dial;
        if let Some(name) = &self.dial_preset {
            let (of_preset, preset) =
                dial.preset(name).map_err(|message| CliError::Usage(format!("--dial-preset {message}")))?;
            (dial, at) = (of_preset, Some(preset.hand));
        }
        // After the preset, which may switch them on.
        for name in &self.nodes_off {
            dial.node_mut(name).map_err(|message| CliError::Usage(format!("--nodes-off {message}")))?.on = false;
        }
        let places = match (&self.sweep, at) {
            (Some(ends), _) => {
                let (from, to) = ends
                    .split_once("..")
                    .ok_or_else(|| CliError::Usage(format!("--sweep {ends}: write A..B, the names of two lights")))?;
                let unknown = |message| CliError::Usage(format!("--sweep {message}"));
                let from = dial.node_mut(from).map_err(unknown)?.clone();
                let to = dial.node_mut(to).map_err(unknown)?.clone();
                if dial.is_regular() {
                    dial.leave_alone(&[&from.light, &to.light]);
                }
                Dial::sweep(&from, &to, frames)
            }
            (None, _) if self.closed => dial.closed_path(frames),
            (None, Some(hand)) => vec![hand],
            (None, None) if self.nodes_off.is_empty() => return Ok(None),
            (None, None) => {
                return Err(CliError::Usage(
                    "--nodes-off needs a position of the hand: add --dial, --dial-preset, --sweep or --loop".into(),
                ));
            }
        };
        if !dial.nodes.iter().any(|node| node.on) {
            tracing::warn!("all nodes of the dial are off: the picture is black");
        }
        Ok(Some(Hand { places, dial }))
    }
}

impl Hand {
    /// Position of the hand at a fraction of the path.
    fn at(&self, fraction: f64) -> DVec2 {
        let last = self.places.len().saturating_sub(1);
        let along = fraction * count(last);
        let leg = whole(along.floor()).min(last.saturating_sub(1));
        match (self.places.get(leg), self.places.get(leg + 1)) {
            (Some(from), Some(to)) => from.lerp(*to, along - count(leg)),
            _ => self.places.first().copied().unwrap_or_default(),
        }
    }

    /// The mix at each position.
    pub(crate) fn mixes(&self, stated: &Mix) -> Vec<Mix> {
        self.places.iter().map(|&place| self.dial.mix(place, stated)).collect()
    }
}

/// `x,y`
fn place(text: &str) -> Result<DVec2, String> {
    let parts: Option<Vec<f64>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    match parts.as_deref() {
        Some(&[x, y]) if x.is_finite() && y.is_finite() => Ok(DVec2::new(x, y)),
        _ => Err("write x,y, such as 0.5,-0.2".to_owned()),
    }
}
