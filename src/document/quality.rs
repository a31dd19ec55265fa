//! One word for step, rays, samples, shadows and sky.

use toml::{Table, Value};

use super::Definition;
use relume_scene::key::{Choices, Named};

/// Preset of samples, rays, shadows and sky.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quality {
    /// One ray a pixel and one sample a step, without shadows.
    Draft,
    /// Further samples where two differ, shadows of all lights and the light of the sky, on a grid of 4 voxels.
    Good,
    /// The same with four rays a pixel and a grid of 2 voxels.
    Best,
}

impl Named for Quality {
    /// From the fastest.
    const ALL: Choices<Self> = &[(Self::Draft, "draft"), (Self::Good, "good"), (Self::Best, "best")];
}

impl Quality {
    /// The quality of this name.
    ///
    /// # Errors
    ///
    /// The names of all, and the most similar one.
    pub fn of(name: &str) -> Result<Self, String> {
        Self::named(name, "the qualities")
    }

    /// Its changes of the scene `table`, in which the step becomes the default. It changes no interpolation, and nothing of which the scene
    /// has nothing: ambient lights cast no shadow, a sky is for grey media, and largest values have neither light nor variation.
    pub(super) fn definitions(self, table: &mut Table) -> Vec<Definition> {
        let is_extreme = table.get("blending").and_then(Value::as_str).is_some_and(|word| word != "composite");
        if let Some(accuracy) = table.get_mut("accuracy").and_then(Value::as_table_mut) {
            accuracy.remove("step");
        }
        let (rays, spacing) = if self == Self::Best { (4, 2) } else { (1, 4) };
        let mut changes = vec![format!("accuracy.rays={rays}"), "accuracy.jitter=true".to_owned()];
        if !is_extreme {
            let integration = if self == Self::Draft { "samples" } else { "adaptive" };
            changes.push(format!("accuracy.integration={integration}"));
            let casts = self != Self::Draft;
            cast(table, casts);
            let is_occluded = casts && !is_coloured(table);
            changes.push(format!("shadows.ambient={}", if is_occluded { "occluded" } else { "open" }));
            changes.push(format!("shadows.spacing={spacing}"));
        }
        let given = format!("quality {}", self.name());
        changes.into_iter().map(|text| Definition { given: given.clone(), text }).collect()
    }
}

/// Lets the lights that come from some direction cast shadows, or none.
fn cast(table: &mut Table, casts: bool) {
    let lights = table.get_mut("lights").and_then(Value::as_table_mut).into_iter().flatten();
    for (_, light) in lights {
        let is_ambient = light.get("kind").and_then(Value::as_str) == Some("ambient");
        if let Some(light) = light.as_table_mut().filter(|_| !is_ambient) {
            light.insert("shadows".to_owned(), Value::Boolean(casts));
        }
    }
}

/// True if a material absorbs some wavelengths more than others.
fn is_coloured(table: &Table) -> bool {
    let of = |part: &str| table.get(part).and_then(Value::as_table).into_iter().flatten();
    let has_spectrum = |(_, material): (&String, &Value)| {
        material
            .get("absorption")
            .is_some_and(|absorption| absorption.as_float().is_none() && absorption.as_integer().is_none())
    };
    of("materials").any(has_spectrum)
}
