//! The open document: its state, the state last saved, and the undo history.

use std::mem::Discriminant;
use std::sync::{Arc, OnceLock};

use super::{DialPreset, Edit, Mixing, SceneFile, State};
use relume_scene::{Labels, Scene};
use relume_volume::{JointHistogram, Statistics};

/// Largest number of undo steps.
const DEPTH: usize = 200;

/// An open scene with its edits.
#[derive(Clone, Debug)]
pub struct Document {
    opened: SceneFile,
    statistics: Option<Statistics>,
    /// Of the volume, once it is asked for; `None` in it without voxels in memory.
    joint: Arc<OnceLock<Option<JointHistogram>>>,
    now: State,
    /// The state as opened or last saved.
    saved: State,
    past: Vec<State>,
    future: Vec<State>,
    /// Kinds of edits of the current gesture; each kind is one undo step.
    gesture: Vec<Discriminant<Edit>>,
}

impl Document {
    /// A newly opened scene.
    #[must_use]
    pub fn new(file: SceneFile) -> Self {
        let now = State::new(&file);
        let saved = now.clone();
        Self {
            opened: file,
            statistics: None,
            joint: Arc::default(),
            now,
            saved,
            past: Vec::new(),
            future: Vec::new(),
            gesture: Vec::new(),
        }
    }

    /// A newly opened scene with an initial `edit`, which is part of the saved state.
    #[must_use]
    pub fn starting(file: SceneFile, edit: &Edit) -> Self {
        let mut document = Self::new(file);
        document.now.apply(edit, &document.opened);
        document.save();
        document
    }

    /// Marks the current state as saved.
    pub fn save(&mut self) {
        self.saved = self.now.clone();
    }

    /// Makes an automatic exposure this factor, that of the first picture. It is no edit.
    pub fn expose(&mut self, factor: f64) {
        let undone = self.past.iter_mut().chain(&mut self.future);
        for state in undone.chain([&mut self.now, &mut self.saved]) {
            state.scene.display.exposure.get_or_insert(factor);
        }
    }

    /// Whether the state is as opened or last saved.
    #[must_use]
    pub fn is_saved(&self) -> bool {
        self.now.writes_as(&self.saved)
    }

    /// The same document with the `statistics` of its volume's values.
    #[must_use]
    pub fn with_statistics(self, statistics: Statistics) -> Self {
        Self { statistics: Some(statistics), joint: Arc::default(), ..self }
    }

    /// Whether the volume of `scene` has the same grid.
    #[must_use]
    pub fn has_grid_of(&self, scene: &Scene) -> bool {
        scene.frame.geometry == self.opened.scene.frame.geometry
    }

    /// Switches to another volume of the same file on the same grid, with which `file` opens. State and undo history
    /// stay. An unchanged transfer function is replaced by that of `file`, unless the values of both volumes are
    /// `alike`, as those of time steps are.
    #[must_use]
    pub fn with_file(self, file: SceneFile, alike: bool) -> Self {
        let (before, scene) = (&self.opened.scene, &file.scene);
        let onto = |state: State| {
            let now = state.scene;
            let labels = match (now.labels, &scene.labels) {
                (Some(now), Some(read)) => Some(Labels { declared: now.declared, ..read.clone() }),
                (_, read) => read.clone(),
            };
            let keeps = alike || now.transfer != before.transfer;
            let scene = Scene {
                name: scene.name.clone(),
                frame: scene.frame,
                fields: scene.fields.clone(),
                labels,
                transfer: if keeps { now.transfer } else { scene.transfer.clone() },
                ..now
            };
            State { scene, ..state }
        };
        let [past, future] = [self.past, self.future].map(|states| states.into_iter().map(onto).collect());
        let [now, saved] = [self.now, self.saved].map(onto);
        Self { now, saved, past, future, statistics: None, joint: Arc::default(), gesture: Vec::new(), opened: file }
    }

    /// Statistics of the volume's values, if known.
    #[must_use]
    pub fn statistics(&self) -> Option<&Statistics> {
        self.statistics.as_ref()
    }

    /// Histogram of the values and gradient magnitudes of the volume; `None` before its statistics are known, and without voxels in
    /// memory. Of a volume that stays in a file, it is that of the coarse level.
    #[must_use]
    pub fn joint_histogram(&self) -> Option<&JointHistogram> {
        let Statistics { min, max, .. } = self.statistics()?;
        let at_hand = || self.now.scene.fields.first().at_hand().0.joint_histogram([*min, *max]);
        self.joint.get_or_init(at_hand).as_ref()
    }

    /// The scene file as opened.
    #[must_use]
    pub fn opened(&self) -> &SceneFile {
        &self.opened
    }

    /// The current state.
    #[must_use]
    pub fn state(&self) -> &State {
        &self.now
    }

    /// Index of the current dial preset: the last one chosen, otherwise the first with the same light.
    #[must_use]
    pub fn preset(&self) -> Option<usize> {
        let (light, dial) = (&self.now.light, &self.now.dial);
        let is_shown = |preset: &DialPreset| {
            let mut nodes = dial.nodes.iter().zip(&self.opened.dial.nodes);
            light.mixing == Mixing::Dial
                && preset.hand == light.hand
                && nodes.all(|(node, stated)| node.on == preset.has_on(stated) && node.place == stated.place)
        };
        let asked = light.preset.filter(|&index| index < dial.presets.len());
        asked.or_else(|| dial.presets.iter().position(is_shown))
    }

    /// Applies `edit`. Until [`Self::rest`], edits of one kind form one undo step, even with edits of other kinds
    /// between them, because the camera can be turned while a tour plays. Returns whether anything has changed.
    pub fn edit(&mut self, edit: &Edit) -> bool {
        let before = self.now.clone();
        self.now.apply(edit, &self.opened);
        if self.now.writes_as(&before) {
            return false;
        }
        let kind = edit.kind();
        if !self.gesture.contains(&kind) {
            self.gesture.push(kind);
            self.past.push(before);
            if self.past.len() > DEPTH {
                self.past.remove(0);
            }
        }
        self.future.clear();
        true
    }

    /// Returns the state after `edit`, without applying it.
    #[must_use]
    pub fn preview(&self, edit: &Edit) -> State {
        let mut state = self.now.clone();
        state.apply(edit, &self.opened);
        state
    }

    /// Ends the gesture: the next edit starts an undo step. A gesture that ends in its initial state leaves no step.
    pub fn rest(&mut self) {
        for _ in self.gesture.drain(..) {
            let nothing = |before: &State| self.now.writes_as(before);
            if self.past.last().is_some_and(nothing) {
                self.past.pop();
            }
        }
    }

    /// Ends the gesture during a tour: the next edit starts an undo step, and the tour continues its own.
    pub fn rest_during_tour(&mut self) {
        let tour = Edit::Tour(0, 0).kind();
        self.gesture.retain(|kind| *kind == tour);
    }

    /// Whether a step can be undone.
    #[must_use]
    pub fn can_undo(&self) -> bool {
        !self.past.is_empty()
    }

    /// Whether a step can be redone.
    #[must_use]
    pub fn can_redo(&self) -> bool {
        !self.future.is_empty()
    }

    /// Undoes the last step. Returns whether there was one.
    pub fn undo(&mut self) -> bool {
        let Some(before) = self.past.pop() else { return false };
        self.gesture.clear();
        self.future.push(std::mem::replace(&mut self.now, before));
        true
    }

    /// Redoes the last step undone. Returns whether there was one.
    pub fn redo(&mut self) -> bool {
        let Some(after) = self.future.pop() else { return false };
        self.gesture.clear();
        self.past.push(std::mem::replace(&mut self.now, after));
        true
    }
}
