//! Oddities of a picture, for those who would wonder at it.

use std::collections::BTreeMap;
use std::fmt;

use glam::{DVec2, DVec3};

use super::{DeviceFilm, PictureLevel, SceneRenderer};
use relume_base::number::{brief, count, readable};
use relume_scene::plan::Planned;
use relume_scene::tables::{LabelMap, Storage, VolumeFormat};
use relume_scene::{Mix, Placement, Scene, Shading};
use relume_volume::{Statistics, VoxelType};

/// An oddity of a picture. [`fmt::Display`] says it in a sentence.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum RenderWarning {
    /// The volume lies between the rays.
    Thin {
        /// Its size in the picture, in pixels.
        pixels: [f64; 2],
    },
    /// All voxels have one value, and no light reaches them: they have no gradient, and so no diffuse and specular parts.
    Homogeneous {
        /// The value.
        value: f64,
    },
    /// Voxels without a value.
    NotANumber {
        /// Their number.
        voxels: u64,
        /// The smallest value, which they get.
        smallest: f64,
    },
    /// Infinite voxels.
    Infinite {
        /// Their number.
        voxels: u64,
    },
    /// The device rounds the values of the volume visibly.
    Stored {
        /// Format of a voxel.
        format: VolumeFormat,
        /// Lowest and highest value.
        domain: [f64; 2],
        /// Largest change of a value.
        loss: f64,
    },
    /// The label map has labels that the scene does not declare.
    Undeclared {
        /// Numbers of voxels by label.
        labels: BTreeMap<i64, u64>,
    },
    /// The majority of the blocks of a coarse level outvotes labels.
    LabelsLost {
        /// The level.
        level: u32,
        /// The labels in words.
        labels: Vec<String>,
    },
    /// No material has an opacity above 0.
    NoMaterial,
    /// No value of the volume is visible.
    NoVisibleValue {
        /// Name of the volume.
        volume: String,
    },
    /// The clip planes leave nothing.
    AllClipped,
    /// No light has an intensity above 0.
    NoLight,
    /// The light grid is coarser than stated.
    LightGrid {
        /// Its spacing in voxels.
        spacing: f64,
        /// The stated one.
        stated: f64,
    },
}

impl RenderWarning {
    /// Name for programs; it does not change between versions.
    #[must_use]
    pub const fn code(&self) -> &'static str {
        match self {
            Self::Thin { .. } => "volume-thin",
            Self::Homogeneous { .. } => "volume-homogeneous",
            Self::NotANumber { .. } => "values-not-a-number",
            Self::Infinite { .. } => "values-infinite",
            Self::Stored { .. } => "values-rounded",
            Self::Undeclared { .. } => "labels-undeclared",
            Self::LabelsLost { .. } => "labels-lost",
            Self::NoMaterial => "material-none-visible",
            Self::NoVisibleValue { .. } => "value-none-visible",
            Self::AllClipped => "clip-all",
            Self::NoLight => "light-none",
            Self::LightGrid { .. } => "light-grid-coarse",
        }
    }

    /// Those of values with `statistics`.
    #[must_use]
    pub fn of_values(statistics: &Statistics) -> Vec<Self> {
        let &Statistics { not_a_number, infinite, min: smallest, .. } = statistics;
        let nan = (not_a_number > 0).then_some(Self::NotANumber { voxels: not_a_number, smallest });
        nan.into_iter().chain((infinite > 0).then_some(Self::Infinite { voxels: infinite })).collect()
    }

    /// Those of `scene`, whose values have `statistics`, in a picture of `size`.
    #[must_use]
    pub fn of_scene(scene: &Scene, statistics: &Statistics, size: [usize; 2]) -> Vec<Self> {
        homogeneous(scene, statistics).into_iter().chain(thin(scene, size)).collect()
    }

    /// Labels that a level loses.
    #[must_use]
    pub fn of_level(level: &PictureLevel) -> Option<Self> {
        let lost = level.labels.iter().filter(|label| label.is_mostly_lost());
        let labels: Vec<String> = lost.map(ToString::to_string).collect();
        (!labels.is_empty()).then_some(Self::LabelsLost { level: level.level.level, labels })
    }

    /// Those of what is stored of a `scene`.
    #[must_use]
    pub fn of_storage(scene: &Scene, storage: &Storage, labels: Option<&LabelMap>) -> Vec<Self> {
        // The limit is a sixteenth of an entry of the longest table; f32 is far more precise for most data. Integers may
        // move by at most a quarter, so that they stay distinct.
        let &Storage { domain, loss, format, .. } = storage;
        let visible = (domain[1] - domain[0]) / f64::from(1 << 20);
        let is_whole = !matches!(scene.volume().voxels.voxel_type(), VoxelType::F32 | VoxelType::F64);
        let limit = if is_whole { visible.min(0.25) } else { visible };
        let rounded = (loss > limit).then_some(Self::Stored { format, domain, loss });
        rounded.into_iter().chain(Self::of_labels(labels)).collect()
    }

    /// Those of a label map.
    #[must_use]
    pub fn of_labels(labels: Option<&LabelMap>) -> Option<Self> {
        let labels = labels.filter(|labels| !labels.undeclared.is_empty())?;
        Some(Self::Undeclared { labels: labels.undeclared.clone() })
    }

    /// The causes of a black picture of `scene` under `mix`; `occupied` is the number of macrocells that a march enters, if known.
    #[must_use]
    pub fn of_nothing(scene: &Scene, planned: &Planned, mix: &Mix, occupied: Option<usize>) -> Vec<Self> {
        let absorbs = || (0..scene.materials.len()).any(|material| scene.absorbs(material));
        let nothing = if planned.materials.is_empty() && !absorbs() {
            Some(Self::NoMaterial)
        } else {
            let volume = || scene.volume().source.clone();
            (occupied == Some(0)).then(|| Self::NoVisibleValue { volume: volume() })
        };
        let shown = scene.crop.unwrap_or_else(|| scene.frame.whole_box());
        let clipped = scene.clip.in_force().next().is_some() && scene.clip.leaves_nothing(&scene.frame, shown);
        let clipped = clipped.then_some(Self::AllClipped);
        let dark = mix.0.iter().all(|light| light.weight <= 0.0).then_some(Self::NoLight);
        nothing.into_iter().chain(clipped).chain(dark).collect()
    }

    /// Those of a film of the scene on a device, relit under `mix`.
    #[must_use]
    pub fn of_film(on_device: &SceneRenderer, film: &DeviceFilm, mix: &Mix) -> Vec<Self> {
        let (scene, planned) = (on_device.scene(), on_device.planned());
        let stated = scene.shadows.spacing;
        // A coarse level of bricks is told of by its caller.
        let is_coarse = |&spacing: &f64| spacing > stated && film.light_block.is_none();
        let grid = film.light_spacing.filter(is_coarse).map(|spacing| Self::LightGrid { spacing, stated });
        Self::of_nothing(scene, planned, mix, Some(film.occupied[0])).into_iter().chain(grid).collect()
    }
}

fn homogeneous(scene: &Scene, statistics: &Statistics) -> Option<RenderWarning> {
    let dark = |index: usize| scene.materials.get(index).is_some_and(|material| material.ambient <= 0.0);
    let medium = scene.transfer.medium(statistics.min, scene.materials.len());
    let mut shown = (0..scene.materials.len()).filter(|&index| medium.scattering[index] > 0.0).peekable();
    let is_lit = scene.lights.iter().any(|light| light.placement == Placement::Ambient);
    let is_homogeneous =
        statistics.min >= statistics.max && scene.shading == Shading::Gradient && scene.labels.is_none();
    (is_homogeneous && !is_lit && shown.peek().is_some() && shown.all(dark))
        .then_some(RenderWarning::Homogeneous { value: statistics.min })
}

fn thin(scene: &Scene, size: [usize; 2]) -> Option<RenderWarning> {
    let geometry = &scene.frame.geometry;
    let [width, height] = size.map(count);
    let view = scene.camera.view(geometry, width / height)?;
    let half = DVec3::splat(0.5);
    let [low, high] = scene.crop.unwrap_or([-half, DVec3::from_array(geometry.dims.map(count)) - half]);
    let corner = |index: u8| {
        let end = |axis: usize| if index >> axis & 1 == 0 { low[axis] } else { high[axis] };
        view.place_of(geometry.world_from_index(DVec3::new(end(0), end(1), end(2))))
    };
    let corners = (0..8).map(corner).collect::<Option<Vec<_>>>()?;
    let [least, most] = [DVec2::min, DVec2::max].map(|of| corners.iter().copied().reduce(of).unwrap_or_default());
    let [from, to] = [least, most].map(|place| place * DVec2::new(width, height));
    // Rays pass through the middles of pixels.
    let is_between = |axis: usize| (from[axis] - 0.5).ceil() > to[axis] - 0.5;
    (is_between(0) || is_between(1)).then_some(RenderWarning::Thin { pixels: (to - from).to_array() })
}

impl fmt::Display for RenderWarning {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Thin { pixels: [x, y] } => write!(
                out,
                "no ray meets the volume, which is thinner than a pixel: it takes {x:.2} × {y:.2} pixels of the picture; use \
                 another camera, or a larger picture"
            ),
            Self::Homogeneous { value } => write!(
                out,
                "all voxels have the value {}, so there is no gradient to shade, and the materials have ambient = 0: the body \
                 is black; set an ambient above 0, or shading = \"none\"",
                readable(*value)
            ),
            Self::NotANumber { voxels, smallest } => {
                write!(out, "{voxels} voxels are NaN; they get the smallest value, {}", readable(*smallest))
            }
            Self::Infinite { voxels } => {
                write!(out, "{voxels} voxels are infinite; they get the smallest or the largest finite value")
            }
            Self::Stored { format, domain: [low, high], loss } => write!(
                out,
                "the device stores the values as {format:?}, for {} to {}; rounding changes a value by up to {loss:.1e}",
                readable(*low),
                readable(*high)
            ),
            Self::Undeclared { labels } => {
                const LISTED: usize = 8;
                let one = |(label, count): (&i64, &u64)| match count {
                    1 => format!("{label} (1 voxel)"),
                    _ => format!("{label} ({count} voxels)"),
                };
                let mut listed: Vec<String> = labels.iter().take(LISTED).map(one).collect();
                match labels.len().saturating_sub(LISTED) {
                    0 => {}
                    more => listed.push(format!("and {more} more")),
                }
                write!(
                    out,
                    "the scene does not declare these labels, so their voxels follow the transfer function: {}",
                    listed.join(", ")
                )
            }
            Self::LabelsLost { level, labels } => write!(
                out,
                "level {level} has less than half of these labels, which the majority of its blocks outvotes: {}; a smaller \
                 accuracy.voxel_pixels keeps more of them",
                labels.join(", ")
            ),
            Self::NoMaterial => out
                .write_str("no material is visible; add an interval with an opacity above 0 to the transfer function"),
            Self::NoVisibleValue { volume } => write!(
                out,
                "nothing in {volume} is visible: the transfer function or the window is 0 over all its values (`relume info` \
                 prints their range)"
            ),
            Self::AllClipped => out.write_str("the clip planes leave nothing: the picture shows the background alone"),
            Self::NoLight => out.write_str("no light shines: the picture is black"),
            Self::LightGrid { spacing, stated } => write!(
                out,
                "the light grid has a node every {} voxels instead of {}: a finer one would take more than an eighth of the \
                 device's memory",
                brief(*spacing),
                brief(*stated)
            ),
        }
    }
}
