//! What one frame computes: what the scene needs at the accuracy asked for.

use crate::scene::{Interpolation, Lookup, Placement, Position, Scene, Shading, positions};

/// Numbers in a shader's vector; accumulators and tables come in these.
pub const LANE: usize = 4;

/// What one frame computes. Discrete choices only: numbers travel beside it. Equal plans share a pipeline.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct ScenePlan {
    /// What the pixels store.
    pub accumulate: Accumulate,
    /// Light positions that shading can tell apart: one accumulator each.
    pub positions: PositionCounts,
    /// What tells light positions apart; `None` while every light arrives everywhere alike.
    pub shading: Option<ShadingTerms>,
    /// Whether labels decide over the transfer function.
    pub labels: bool,
    /// Whether anything but black is behind the volume.
    pub background: bool,
    /// How the transfer table is read.
    pub lookup: Lookup,
    /// How values between voxels are made.
    pub interpolation: Interpolation,
    /// Whether empty cells are leapt over.
    pub skipping: bool,
}

/// What the pixels store.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Accumulate {
    /// One weight per material in use (COLOUR.md A4): exact for every light, because opacity is grey and light scatters
    /// once. With specular materials one more, of white.
    Weights {
        /// Materials in use.
        materials: usize,
    },
}

/// Light positions of each kind. Ambient ones come first in the accumulators, then the headlight, directional ones and
/// points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct PositionCounts {
    /// 0 or 1: what shines from everywhere shines alike.
    pub ambient: usize,
    /// 0 or 1.
    pub headlight: usize,
    /// Lights at infinity.
    pub directional: usize,
    /// Lights at a point.
    pub point: usize,
}

/// How shading goes beyond light from everywhere. Without a diffuse and a specular part only the materials' ambient shares
/// are left of it, and no gradient is needed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ShadingTerms {
    /// Some material has a diffuse part.
    pub diffuse: bool,
    /// Some material has a specular part.
    pub specular: Option<Specular>,
}

/// How highlights are computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Specular {
    /// One power serves all materials.
    pub one_exponent: bool,
    /// Bits of the largest exponent: squarings per power.
    pub exponent_bits: u32,
}

/// A plan with what it is about: which materials and positions its components stand for.
#[derive(Clone, Debug, PartialEq)]
pub struct Planned {
    /// The choices.
    pub plan: ScenePlan,
    /// Materials in use: indices into [`Scene::materials`], in the order of the weights.
    pub materials: Vec<usize>,
    /// The light positions, in the order of the accumulators.
    pub positions: Vec<Position>,
}

impl PositionCounts {
    /// All of them.
    #[must_use]
    pub fn total(&self) -> usize {
        self.ambient + self.headlight + self.directional + self.point
    }
}

impl ScenePlan {
    /// Numbers a pixel keeps per light position.
    #[must_use]
    pub fn components(&self) -> usize {
        self.materials() + usize::from(self.specular().is_some())
    }

    /// Materials that have a weight.
    #[must_use]
    pub fn materials(&self) -> usize {
        match self.accumulate {
            Accumulate::Weights { materials } => materials,
        }
    }

    /// Vectors that hold [`Self::components`].
    #[must_use]
    pub fn lanes(&self) -> usize {
        self.components().div_ceil(LANE)
    }

    /// Vectors that hold a table entry: one weight per material.
    #[must_use]
    pub fn table_lanes(&self) -> usize {
        self.materials().div_ceil(LANE)
    }

    /// Vectors a pixel keeps: [`Self::lanes`] per position.
    #[must_use]
    pub fn layers(&self) -> usize {
        self.positions.total() * self.lanes()
    }

    /// Bytes a pixel keeps on a device.
    #[must_use]
    pub fn pixel_bytes(&self) -> u64 {
        (self.layers() * LANE * size_of::<f32>() + size_of::<f32>()) as u64
    }

    /// Whether the gradient of the data is needed.
    #[must_use]
    pub fn gradient(&self) -> bool {
        self.shading.is_some_and(|terms| terms.diffuse || terms.specular.is_some())
    }

    /// How highlights are computed, if there are any.
    #[must_use]
    pub fn specular(&self) -> Option<Specular> {
        self.shading.and_then(|terms| terms.specular)
    }
}

/// The plan of `scene`.
#[must_use]
pub fn plan(scene: &Scene) -> Planned {
    let materials: Vec<usize> = (0..scene.materials.len()).filter(|&material| scene.shows(material)).collect();
    let positions = positions(scene);
    let count = |kind: fn(&Placement) -> bool| positions.iter().filter(|position| kind(&position.placement)).count();
    let counts = PositionCounts {
        ambient: count(|placement| matches!(placement, Placement::Ambient)),
        headlight: count(|placement| matches!(placement, Placement::Headlight)),
        directional: count(|placement| matches!(placement, Placement::Directional(_))),
        point: count(|placement| matches!(placement, Placement::Point(_))),
    };
    let used = || materials.iter().filter_map(|&material| scene.materials.get(material));
    let directed = scene.shading == Shading::Gradient && counts.total() > counts.ambient;
    let diffuse = directed && used().any(|material| material.diffuse > 0.0);
    let mut exponents: Vec<u32> =
        used().filter(|material| directed && material.specular > 0.0).map(|material| material.exponent).collect();
    exponents.sort_unstable();
    exponents.dedup();
    let specular = exponents.last().map(|&largest| Specular {
        one_exponent: exponents.len() == 1,
        exponent_bits: u32::BITS - largest.leading_zeros(),
    });
    let plan = ScenePlan {
        accumulate: Accumulate::Weights { materials: materials.len() },
        positions: counts,
        shading: directed.then_some(ShadingTerms { diffuse, specular }),
        labels: scene.labels.as_ref().is_some_and(|labels| !labels.declared.is_empty()),
        background: scene.background.is_some(),
        lookup: scene.transfer.lookup,
        interpolation: scene.accuracy.interpolation,
        skipping: scene.accuracy.skipping,
    };
    Planned { plan, materials, positions }
}

impl Planned {
    /// The plan in sentences, for people who know volumes but not this program.
    #[must_use]
    pub fn explain(&self, scene: &Scene) -> Vec<String> {
        let plan = &self.plan;
        let names = |names: Vec<&str>| if names.is_empty() { "none".to_owned() } else { names.join(", ") };
        let materials =
            self.materials.iter().filter_map(|&i| scene.materials.get(i)).map(|m| m.name.as_str()).collect();
        let mut sentences = vec![format!(
            "A pixel keeps one weight per material in use ({}){} for each light position, and the light that passes: {} numbers. This is exact for every light, because opacity is grey and light scatters once.",
            names(materials),
            if plan.specular().is_some() { " and one of white for highlights" } else { "" },
            plan.components() * plan.positions.total() + 1,
        )];
        let unused: Vec<&str> = (0..scene.materials.len())
            .filter(|material| !self.materials.contains(material))
            .filter_map(|material| scene.materials.get(material))
            .map(|material| material.name.as_str())
            .collect();
        if !unused.is_empty() {
            sentences.push(format!("Materials that nothing shows are left out: {}.", unused.join(", ")));
        }
        sentences.push(match plan.positions.total() {
            0 => "There is no light: only the light that passes is computed.".to_owned(),
            1 => format!(
                "{} light{} one accumulator.",
                scene.lights.len(),
                if scene.lights.len() == 1 { " needs" } else { "s share" }
            ),
            total => format!(
                "{} lights shine from {total} positions that shading can tell apart ({}): one accumulator each.",
                scene.lights.len(),
                names(self.positions.iter().map(|position| position.name.as_str()).collect())
            ),
        });
        sentences.push(match plan.shading.filter(|_| plan.gradient()) {
            None => "Nothing is shaded by the gradient, so no gradient is computed or stored.".to_owned(),
            Some(terms) => format!(
                "The gradient is stored beside each value, for {}.",
                match (terms.diffuse, terms.specular) {
                    (true, None) => "diffuse shading",
                    (false, _) => "highlights",
                    (true, Some(_)) => "diffuse shading and highlights",
                }
            ),
        });
        if plan.labels {
            sentences.push("Labels decide what a voxel is; label 0 follows the transfer function.".to_owned());
        }
        sentences.push(
            if plan.background {
                "A background is seen through what light passes; it is added when relighting."
            } else {
                "The background is black and costs nothing."
            }
            .to_owned(),
        );
        let termination = if scene.accuracy.termination > 0.0 {
            format!("A ray ends when less than {} of light passes", scene.accuracy.termination)
        } else {
            "Every ray is followed to its end".to_owned()
        };
        let skipping =
            if plan.skipping { "cells that hold nothing are leapt over" } else { "empty cells are not leapt over" };
        sentences.push(format!("{termination}; samples are {} apart; {skipping}.", scene.accuracy.step_length));
        sentences
    }
}
