//! The light dial: nodes that stand for lights, a hand between them, and the mix of a hand position (§4.3 of the
//! paper).

use std::f64::consts::TAU;

use glam::DVec2;

use crate::output::film;
use relume_base::number::count;
use relume_scene::{Mix, MixLight};

/// Nodes of lights on a plane. A light is the stronger, the nearer the hand is to its node: with the distances `d`, a
/// node weighs `(1/d_i) / Σ 1/d_j` over the nodes that are on.
#[derive(Clone, Debug, PartialEq)]
pub struct Dial {
    /// The nodes; a light without a node does not shine.
    pub nodes: Vec<DialNode>,
    /// Whether the mix is scaled so that a white surface has the luminance `master` at every position of the hand.
    pub normalise: bool,
    /// Luminance of white if `normalise` is on, otherwise a factor of every weight.
    pub master: f64,
    /// Dial presets, in the order of a tour.
    pub presets: Vec<DialPreset>,
}

/// A dial preset: a named position of the hand with the nodes that are on.
#[derive(Clone, Debug, PartialEq)]
pub struct DialPreset {
    /// Its name.
    pub name: String,
    /// Caption of one sentence; may be empty.
    pub caption: String,
    /// Position of the hand.
    pub hand: DVec2,
    /// Lights whose nodes are off, in addition to those off on the dial.
    pub off: Vec<String>,
    /// Lights whose nodes are on, although they are off on the dial.
    pub on: Vec<String>,
}

/// The node of a light.
#[derive(Clone, Debug, PartialEq)]
pub struct DialNode {
    /// Name of the light.
    pub light: String,
    /// Position; the corners of the regular polygon have distance 1 from (0, 0).
    pub place: DVec2,
    /// Whether the node is on; a node keeps its position while it is off.
    pub on: bool,
}

impl DialNode {
    /// Whether the node lies at `place`.
    #[must_use]
    pub fn lies_at(&self, place: DVec2) -> bool {
        self.place.distance(place) < ON_IT
    }
}

impl DialPreset {
    /// Whether this preset has a node on whose state on the dial is `stated`.
    #[must_use]
    pub fn has_on(&self, stated: &DialNode) -> bool {
        (stated.on || self.on.contains(&stated.light)) && !self.off.contains(&stated.light)
    }
}

/// Distance below which a position is on a node. Corners of a polygon are rounded, and so are typed positions.
const ON_IT: f64 = 1e-9;

impl Dial {
    /// Regular polygon of these lights, the first at the top, then clockwise.
    #[must_use]
    pub fn regular<'a>(lights: impl ExactSizeIterator<Item = &'a str>) -> Self {
        let corners = count(lights.len());
        let node = |(corner, light): (usize, &str)| DialNode {
            light: light.to_owned(),
            place: DVec2::from_angle(TAU * (0.25 - count(corner) / corners)),
            on: true,
        };
        Self { nodes: lights.enumerate().map(node).collect(), normalise: true, master: 1.0, presets: Vec::new() }
    }

    /// The dial of a film file; without one, the regular polygon of its lights.
    #[must_use]
    pub fn of_film(file: &film::FilmFile) -> Self {
        let Some(film::Dial { hand: _, normalise, master, nodes, presets }) = file.dial.clone() else {
            return Self::regular(file.lights.iter().map(|light| light.name.as_str()));
        };
        let node = |film::Node { light, place, on }| DialNode { light, place: DVec2::from_array(place), on };
        let preset = |film::DialPreset { name, caption, hand, off, on }| DialPreset {
            name,
            caption,
            hand: DVec2::from_array(hand),
            off,
            on,
        };
        let (nodes, presets) = (nodes.into_iter().map(node), presets.into_iter().map(preset));
        Self { normalise, master, nodes: nodes.collect(), presets: presets.collect() }
    }

    /// Whether the nodes are the corners of the regular polygon, where no scene has placed them.
    #[must_use]
    pub fn is_regular(&self) -> bool {
        let regular = Self::regular(self.nodes.iter().map(|node| node.light.as_str()));
        self.nodes.iter().zip(&regular.nodes).all(|(node, corner)| node.lies_at(corner.place))
    }

    /// Switches all nodes off but those of `lights`.
    pub fn leave_alone(&mut self, lights: &[&str]) {
        for node in &mut self.nodes {
            node.on &= lights.contains(&node.light.as_str());
        }
    }

    /// Moves the nodes to their positions in `nodes`, a list of the same length. A preset whose hand is on a node
    /// follows that node, because the preset means its light. Only nodes that are on in the preset count, judged by the
    /// dial as `stated`, not by its current state.
    pub(crate) fn rearrange(&mut self, nodes: Vec<DialNode>, stated: &[DialNode]) {
        let before = std::mem::replace(&mut self.nodes, nodes);
        for preset in &mut self.presets {
            let mut moved = before.iter().zip(&self.nodes).zip(stated);
            let meant = moved.find(|((node, _), stated)| node.lies_at(preset.hand) && preset.has_on(stated));
            if let Some(((_, now), _)) = meant {
                preset.hand = now.place;
            }
        }
    }

    /// Returns the node of the light `name`.
    ///
    /// # Errors
    ///
    /// A sentence that lists the available names.
    pub fn node_mut(&mut self, name: &str) -> Result<&mut DialNode, String> {
        let names: Vec<&str> = self.nodes.iter().map(|node| node.light.as_str()).collect();
        let unknown = format!("{name}: there is no such light; there are: {}", names.join(", "));
        self.nodes.iter_mut().find(|node| node.light == name).ok_or(unknown)
    }

    /// Returns the preset `name`, and the dial with exactly those nodes on that the preset has on.
    ///
    /// # Errors
    ///
    /// A sentence that lists the available names.
    pub fn preset(&self, name: &str) -> Result<(Self, DialPreset), String> {
        let names: Vec<&str> = self.presets.iter().map(|preset| preset.name.as_str()).collect();
        let found = self.presets.iter().find(|preset| preset.name == name).cloned();
        let unknown = || match names.as_slice() {
            [] => format!("{name}: the dial has no presets; [[dial.presets]] of the scene declares them"),
            names => format!("{name}: there is no such preset; there are: {}", names.join(", ")),
        };
        let preset = found.ok_or_else(unknown)?;
        let mut dial = self.clone();
        for node in &mut dial.nodes {
            node.on = preset.has_on(node);
        }
        Ok((dial, preset))
    }

    /// Weight of each node with the hand at `hand`. The weights sum to 1. With the hand on a node, the weight of that
    /// node is exactly 1 (nodes at one position share it). A node that is off weighs 0, and all weights are 0 if no
    /// node is on.
    #[must_use]
    pub fn weights(&self, hand: DVec2) -> Vec<f64> {
        let distance = |node: &DialNode| {
            let far = (node.place.x - hand.x).hypot(node.place.y - hand.y);
            if far < ON_IT { 0.0 } else { far }
        };
        let nearest = self.nodes.iter().filter(|node| node.on).map(distance).fold(f64::INFINITY, f64::min);
        // Relative to the nearest node, so that no reciprocal overflows; on a node, the quotient would be 0 / 0.
        let nearness = |node: &DialNode| match distance(node) {
            _ if !node.on => 0.0,
            far if far <= nearest => 1.0,
            far => nearest / far,
        };
        let nearness: Vec<f64> = self.nodes.iter().map(nearness).collect();
        let sum: f64 = nearness.iter().sum();
        nearness.into_iter().map(|near| if sum > 0.0 { near / sum } else { 0.0 }).collect()
    }

    /// Mix with the hand at `hand`: the lights of `stated` times the weights of their nodes, without lights of weight
    /// 0.
    #[must_use]
    pub fn mix(&self, hand: DVec2, stated: &Mix) -> Mix {
        let weights = self.weights(hand);
        let weight_of = |light: &MixLight| {
            let nodes = self.nodes.iter().zip(&weights).filter(|(node, _)| node.light == light.name);
            nodes.map(|(_, weight)| weight).sum::<f64>()
        };
        let mixed = stated.0.iter().map(|light| MixLight { weight: light.weight * weight_of(light), ..light.clone() });
        Mix(mixed.filter(|light| light.weight > 0.0).collect()).mastered(self.normalise, self.master)
    }

    /// Straight path of the hand from one node to another in `frames` positions, both ends included.
    #[must_use]
    pub fn sweep(from: &DialNode, to: &DialNode, frames: usize) -> Vec<DVec2> {
        let last = count(frames.saturating_sub(1).max(1));
        (0..frames).map(|frame| between(from.place, to.place, count(frame) / last)).collect()
    }

    /// Closed path of the hand in `frames` positions over the nodes that are on, in their order, with equal time for
    /// each leg. It starts on the first node and ends before it returns there.
    #[must_use]
    pub fn closed_path(&self, frames: usize) -> Vec<DVec2> {
        let stops: Vec<DVec2> = self.nodes.iter().filter(|node| node.on).map(|node| node.place).collect();
        let along = |frame: usize| {
            // Whole legs and the fraction of the next in integers, so that a stop is reached exactly.
            let (leg, rest) = (frame * stops.len() / frames, frame * stops.len() % frames);
            let from = stops.get(leg % stops.len().max(1)).copied()?;
            let to = stops.get((leg + 1) % stops.len()).copied()?;
            Some(between(from, to, count(rest) / count(frames)))
        };
        (0..frames).filter_map(along).collect()
    }
}

/// Index of the last stop reached and position of the hand after `step` of `of` steps along straight legs through
/// `stops`; `None` without stops. Stops are reached exactly.
#[must_use]
pub(crate) fn along(stops: &[DVec2], step: usize, of: usize) -> Option<(usize, DVec2)> {
    let last = stops.len().checked_sub(1)?;
    let (of, step) = (of.max(1), step.min(of.max(1)));
    let (leg, rest) = (step * last / of, step * last % of);
    let (from, to) = (stops[leg], stops[(leg + 1).min(last)]);
    Some((leg, between(from, to, count(rest) / count(of))))
}

/// Interpolates linearly: exactly `from` at 0 and `to` at 1.
fn between(from: DVec2, to: DVec2, part: f64) -> DVec2 {
    from * (1.0 - part) + to * part
}

impl From<&Dial> for film::Dial {
    fn from(dial: &Dial) -> Self {
        let node =
            |node: &DialNode| film::Node { light: node.light.clone(), place: node.place.to_array(), on: node.on };
        let preset = |preset: &DialPreset| film::DialPreset {
            name: preset.name.clone(),
            caption: preset.caption.clone(),
            hand: preset.hand.to_array(),
            off: preset.off.clone(),
            on: preset.on.clone(),
        };
        Self {
            hand: None,
            normalise: dial.normalise,
            master: dial.master,
            nodes: dial.nodes.iter().map(node).collect(),
            presets: dial.presets.iter().map(preset).collect(),
        }
    }
}
