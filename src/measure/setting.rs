//! Settings: changes to a scene's own accuracy, knob by knob.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::LazyLock;

use serde::{Serialize, Serializer};

use relume_base::number::{count, readable, whole};
use relume_colour::model::ModelKind;
use relume_scene::key::{self, Access, Key, Kind, Stale};
use relume_scene::{AccumulateAs, Scene};

/// An option that trades speed for accuracy: a key of [`key::SCENE`] with a knob, or the scale of the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Knob(usize);

/// Marched pixels across as a fraction of those asked for; the picture is enlarged. No part of a scene.
static SCALE: Key<Scene> = Key::new(
    "scale",
    Kind::Number([0.05, 1.0], ""),
    Stale::Nothing,
    Access { get: |_| Some(key::Value::Number(1.0)), put: |_, _| {} },
)
.knob("0.25,0.5", "marched pixels across, as a share of those shown; the picture is enlarged");

/// The keys that are knobs, in the order of reports.
static KNOBS: LazyLock<Vec<&'static Key<Scene>>> =
    LazyLock::new(|| key::SCENE.iter().filter(|key| key.knob.is_some()).chain([&SCALE]).collect());

/// Value of a knob.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Value {
    /// A number.
    Number(f64),
    /// A choice by name.
    Name(&'static str),
}

/// Names of the two values of a switch.
const SWITCH: [&str; 2] = ["off", "on"];

impl Knob {
    /// All knobs.
    pub fn all() -> impl Iterator<Item = Self> {
        (0..KNOBS.len()).map(Self)
    }

    /// The knob of this name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::all().find(|knob| knob.name() == name)
    }

    /// Its key.
    pub(super) fn key(self) -> &'static Key<Scene> {
        KNOBS.get(self.0).copied().unwrap_or(&SCALE)
    }

    /// Name on the command line and in reports: that of its key, with the table if a knob before has the same.
    #[must_use]
    pub fn name(self) -> &'static str {
        let key = self.key();
        let is_taken = KNOBS.iter().take(self.0).any(|before| before.name() == key.name());
        if is_taken { key.path } else { key.name() }
    }

    /// Description for users.
    #[must_use]
    pub fn meaning(self) -> &'static str {
        self.key().knob.map_or("", |knob| knob.meaning)
    }

    /// Its names, if it is a choice.
    pub(super) fn names(self) -> Option<Vec<&'static str>> {
        match self.key().kind {
            Kind::Names(names) => Some(names()),
            Kind::Switch => Some(SWITCH.to_vec()),
            Kind::Number(..) | Kind::NumberOr(..) | Kind::Whole(..) => None,
        }
    }

    /// Its value in `scene`; `None` if the data choose it.
    #[must_use]
    pub fn value(self, scene: &Scene) -> Option<Value> {
        Some(match self.key().get(scene)? {
            key::Value::Number(number) => Value::Number(number / self.key().unit(scene)),
            key::Value::Name(name) => Value::Name(name),
            key::Value::Switch(on) => Value::Name(SWITCH[usize::from(on)]),
        })
    }

    /// Applies the knob to `scene`. A colour model has accumulators of coefficients, and a dimension.
    fn turn(self, value: Value, scene: &mut Scene) {
        /// Default dimension of a colour model.
        const USUAL: usize = 8;
        let value = match value {
            Value::Number(number) => key::Value::Number(number * self.key().unit(scene)),
            Value::Name(name) if matches!(self.key().kind, Kind::Switch) => key::Value::Switch(name == SWITCH[1]),
            Value::Name(name) => key::Value::Name(name),
        };
        // Sweeps have values in range alone.
        let is_set = self.key().set(scene, Some(value)).is_ok();
        let accuracy = &mut scene.accuracy;
        if is_set && ["model", "k"].contains(&self.name()) {
            accuracy.accumulate = AccumulateAs::Spectral;
            let usual = accuracy.dimension.unwrap_or(USUAL);
            let is_model = self.name() == "model";
            accuracy.dimension = Some(if is_model && accuracy.model.is_rgb() { 3 } else { usual });
        }
    }
}

impl fmt::Display for Knob {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.pad(self.name())
    }
}

impl fmt::Display for Value {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(number) => out.pad(&readable(*number)),
            Self::Name(name) => out.pad(name),
        }
    }
}

/// Values of some knobs; all others keep the scene's values.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Setting(BTreeMap<Knob, Value>);

impl Setting {
    /// Returns the setting with the knob of this name at `value`.
    #[must_use]
    pub(super) fn with(mut self, knob: &str, value: Value) -> Self {
        self.0.extend(Knob::named(knob).map(|knob| (knob, value)));
        self
    }

    /// The setting with the knobs of `other`, too.
    #[must_use]
    pub(super) fn and(mut self, other: Self) -> Self {
        self.0.extend(other.0);
        self
    }

    /// Value of the knob of this name, if the setting states one.
    #[must_use]
    pub fn get(&self, knob: &str) -> Option<Value> {
        self.knobs().find(|(it, _)| it.name() == knob).map(|(_, value)| value)
    }

    /// The stated knobs and their values.
    pub fn knobs(&self) -> impl Iterator<Item = (Knob, Value)> {
        self.0.iter().map(|(&knob, &value)| (knob, value))
    }

    /// The stated colour model.
    #[must_use]
    pub fn model(&self) -> Option<ModelKind> {
        match self.get("model")? {
            Value::Name(name) => name.parse().ok(),
            Value::Number(_) => None,
        }
    }

    /// Whether the setting is consistent: RGB has dimension 3.
    pub(super) fn is_possible(&self) -> bool {
        let three = self.get("k").is_none_or(|k| k == Value::Number(3.0));
        three || !self.model().is_some_and(ModelKind::is_rgb)
    }

    /// Marched pixels across as a fraction of those displayed.
    #[must_use]
    pub fn scale(&self) -> f64 {
        match self.get(SCALE.path) {
            Some(Value::Number(scale)) => scale,
            _ => 1.0,
        }
    }

    /// Marched pixels across and down for a picture of `size`.
    #[must_use]
    pub fn marched_size(&self, size: [usize; 2]) -> [usize; 2] {
        size.map(|side| whole((count(side) * self.scale()).round()).max(1))
    }

    /// Returns `scene` with this setting applied.
    #[must_use]
    pub fn applied(&self, scene: &Scene) -> Scene {
        let mut scene = scene.clone();
        for (knob, value) in self.knobs() {
            knob.turn(value, &mut scene);
        }
        scene
    }
}

impl fmt::Display for Setting {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.is_empty() {
            return out.pad("as the scene says");
        }
        let named: Vec<String> = self.knobs().map(|(knob, value)| format!("{knob}={value}")).collect();
        out.pad(&named.join(" "))
    }
}

impl Serialize for Setting {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.knobs().map(|(knob, value)| (knob.name(), value)))
    }
}
