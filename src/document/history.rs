//! The open document: its state, the state last saved, and the steps to undo and redo.

use std::mem::Discriminant;
use std::sync::Arc;

use super::{Edit, Mixing, SceneFile, Situation, State};
use crate::scene::{Labels, Scene};
use crate::volume::Statistics;

/// Steps that can be undone.
const DEPTH: usize = 200;

/// A scene that is looked at, with what was done to it.
#[derive(Clone, Debug)]
pub struct Document {
    opened: SceneFile,
    statistics: Option<Statistics>,
    now: State,
    /// As it was opened, or saved last.
    saved: State,
    past: Vec<State>,
    future: Vec<State>,
    /// The kind of the edits that are one step back together, while a hand is at it.
    gesture: Vec<Discriminant<Edit>>,
}

impl Document {
    /// A scene that was just opened.
    #[must_use]
    pub fn new(file: SceneFile) -> Self {
        let now = State::new(&file);
        let saved = now.clone();
        Self { opened: file, statistics: None, now, saved, past: Vec::new(), future: Vec::new(), gesture: Vec::new() }
    }

    /// A scene that was just opened, with `edit` made before anybody looks.
    #[must_use]
    pub fn starting(file: SceneFile, edit: &Edit) -> Self {
        let mut document = Self::new(file);
        document.now.apply(edit, &document.opened);
        document.save();
        document
    }

    /// It is saved as it is now.
    pub fn save(&mut self) {
        self.saved = self.now.clone();
    }

    /// Whether it is as it was opened, or saved last.
    #[must_use]
    pub fn is_saved(&self) -> bool {
        self.now.writes_as(&self.saved)
    }

    /// The same, where the values of its volume are known to have `statistics`.
    #[must_use]
    pub fn with_statistics(self, statistics: Statistics) -> Self {
        Self { statistics: Some(statistics), ..self }
    }

    /// Whether the volume of `scene` lies on the same grid.
    #[must_use]
    pub fn lies_as(&self, scene: &Scene) -> bool {
        scene.volume.geometry == self.opened.scene.volume.geometry
    }

    /// Another volume of the same file, on the same grid, where `scene` opens with it: looked at as the one before, with the same
    /// steps back. A transfer function that nobody has changed gives way to that of `scene`, but where the values of both are
    /// `alike`, as those of time steps are.
    #[must_use]
    pub fn beside(self, file: SceneFile, alike: bool) -> Self {
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
                volume: Arc::clone(&scene.volume),
                labels,
                transfer: if keeps { now.transfer } else { scene.transfer.clone() },
                ..now
            };
            State { scene, ..state }
        };
        let [past, future] = [self.past, self.future].map(|states| states.into_iter().map(onto).collect());
        let [now, saved] = [self.now, self.saved].map(onto);
        Self { now, saved, past, future, statistics: None, gesture: Vec::new(), opened: file }
    }

    /// What the values of its volume are like, where that is known.
    #[must_use]
    pub fn statistics(&self) -> Option<&Statistics> {
        self.statistics.as_ref()
    }

    /// The scene file as opened.
    #[must_use]
    pub fn opened(&self) -> &SceneFile {
        &self.opened
    }

    /// How it is now.
    #[must_use]
    pub fn state(&self) -> &State {
        &self.now
    }

    /// The situation that is shown, by its index: the one that was asked for, else the first that looks the same.
    #[must_use]
    pub fn situation(&self) -> Option<usize> {
        let (light, dial) = (&self.now.light, &self.now.dial);
        let is_shown = |situation: &Situation| {
            let mut nodes = dial.nodes.iter().zip(&self.opened.dial.nodes);
            light.mixing == Mixing::Dial
                && situation.hand == light.hand
                && nodes.all(|(node, stated)| node.on == situation.has_on(stated) && node.place == stated.place)
        };
        let asked = light.situation.filter(|&index| index < dial.situations.len());
        asked.or_else(|| dial.situations.iter().position(is_shown))
    }

    /// Changes it. Until [`Self::rest`], edits of one kind are one step back, also where others come between: a camera is turned
    /// while a tour is played. Returns whether anything has changed.
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

    /// How it would be after `edit`, which is not made.
    #[must_use]
    pub fn preview(&self, edit: &Edit) -> State {
        let mut state = self.now.clone();
        state.apply(edit, &self.opened);
        state
    }

    /// The hand has let go: the next edit is a step back of its own. One that ended where it began is none.
    pub fn rest(&mut self) {
        for _ in self.gesture.drain(..) {
            let nothing = |before: &State| self.now.writes_as(before);
            if self.past.last().is_some_and(nothing) {
                self.past.pop();
            }
        }
    }

    /// The hand has let go while a tour is played: what it does next is a step back of its own, and the tour goes on as the one that
    /// it is.
    pub fn rest_beside_tour(&mut self) {
        let tour = Edit::Tour(0, 0).kind();
        self.gesture.retain(|kind| *kind == tour);
    }

    /// Whether there is a step back.
    #[must_use]
    pub fn can_undo(&self) -> bool {
        !self.past.is_empty()
    }

    /// Whether there is a step forward.
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
