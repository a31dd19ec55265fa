//! Cases of `relume bench`: scenes and their changes.

use glam::DVec3;
use serde::Serialize;

use crate::document;
use crate::document::{Definition, SceneOptions};
use crate::model::ModelKind;
use crate::progress::Progress;
use crate::scene::{AccumulateAs, Material, Placement, Scene, SceneLight, Shading};
use crate::spectrum::{Absorption, Spectrum};

use super::{Args, CliError, figures};

/// Picture sizes of whole workloads.
const SIZES: [[usize; 2]; 3] = [[400, 400], [800, 800], [1920, 1080]];
/// Picture size where other quantities are varied.
const USUAL: [usize; 2] = SIZES[0];
/// Voxels along a side of the varied volumes.
const SIDES: [u32; 4] = [64, 128, 256, 512];
/// Varied dimensions of a colour model.
const DIMENSIONS: [u8; 8] = [1, 2, 3, 4, 6, 8, 12, 16];
/// Varied numbers of light positions.
const POSITIONS: [u8; 4] = [1, 2, 4, 8];

/// Scene of a case.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Subject {
    /// The benchmark scene for comparisons with other renderers.
    Peer,
    /// The embedded default scene.
    Default,
    /// One of the paper's figures.
    Figure(&'static str),
}

/// What pixels store.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Keeping {
    /// As stated in the scene.
    Stated,
    /// Weights of twice the number of materials.
    EightWeights,
    /// A colour model of this dimension, even where weights would be exact.
    Model(ModelKind, usize),
}

/// Eight nodes.
const K8: Keeping = Keeping::Model(ModelKind::Nodes, 8);
/// Linear RGB.
const RGB: Keeping = Keeping::Model(ModelKind::Rgb, 3);

/// One measurement.
#[derive(Clone, Debug)]
pub(super) struct Case {
    pub(super) workload: String,
    /// Name of a line in a plot or of a row in a table; empty for a single case.
    pub(super) line: &'static str,
    /// Quantity varied along the line, and its value.
    pub(super) varied: Option<Varied>,
    pub(super) subject: Subject,
    pub(super) keeping: Keeping,
    pub(super) dyed: bool,
    /// Number of light positions; `None` for the scene's own.
    pub(super) positions: Option<u8>,
    /// Voxels along each side of the volume; `None` for the scene's own.
    pub(super) side: Option<u32>,
    /// Whether shading is switched off.
    pub(super) unshaded: bool,
    pub(super) size: [usize; 2],
}

/// Value of a varied quantity.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(super) struct Varied {
    pub(super) name: &'static str,
    pub(super) value: u32,
}

impl Case {
    /// `subject` without changes.
    pub(super) fn of(workload: &str, subject: Subject, size: [usize; 2]) -> Self {
        let workload = workload.to_owned();
        Self {
            workload,
            line: "",
            varied: None,
            subject,
            keeping: Keeping::Stated,
            dyed: false,
            positions: None,
            side: None,
            unshaded: false,
            size,
        }
    }

    /// The peer scene on a line of a workload.
    fn on(workload: &str, (line, keeping, dyed): (&'static str, Keeping, bool), size: [usize; 2]) -> Self {
        Self { line, keeping, dyed, ..Self::of(workload, Subject::Peer, size) }
    }

    fn varied(self, name: &'static str, value: u32) -> Self {
        Self { varied: Some(Varied { name, value }), ..self }
    }

    /// Loads the scene.
    pub(super) fn scene(&self, args: &Args, progress: &dyn Progress) -> Result<Scene, CliError> {
        let mut options = SceneOptions {
            definitions: args.define.definitions().chain(args.accuracy.definitions()).collect(),
            ..SceneOptions::default()
        };
        if self.is_of_a_volume() {
            (options.volume, options.selection) = (args.volume.clone(), args.selection.selection());
        }
        if let Some(side) = self.side {
            // The same object in a different number of voxels, with a step of one voxel.
            let spacing = 256.0 / f64::from(side);
            let keys = [
                format!("volume.dims=[{side},{side},{side}]"),
                "volume.downsample=[1,1,1]".to_owned(),
                format!("volume.spacing=[{spacing},{spacing},{spacing}]"),
                "transfer.opacity_length=1".to_owned(),
                format!("accuracy.step={spacing}"),
            ];
            options.definitions.extend(keys.iter().map(|key| Definition::new(key)));
        }
        Ok(match self.subject {
            Subject::Peer => document::load_peer(&options, progress)?.scene,
            Subject::Default => document::load_embedded(&options, progress)?.scene,
            Subject::Figure(name) => figures::scene(name, &options, progress)?.scene,
        })
    }

    /// Whether to measure this case and `next` in turn: both belong to the same workload, scene and volume size, so
    /// that their ratio is meaningful.
    pub(super) fn is_beside(&self, next: &Self) -> bool {
        self.workload == next.workload && (self.subject, self.side) == (next.subject, next.side)
    }

    /// Whether the case shows the volume from the command line, if there is one.
    fn is_of_a_volume(&self) -> bool {
        self.subject == Subject::Peer && self.side.is_none()
    }

    /// Applies the changes to a loaded scene.
    pub(super) fn change(&self, scene: &mut Scene) -> Result<(), CliError> {
        if self.unshaded {
            scene.shading = Shading::None;
        }
        if let Some(positions) = self.positions {
            add_lights(scene, positions);
        }
        if self.dyed {
            dye(scene)?;
        }
        match self.keeping {
            Keeping::Stated => {}
            Keeping::EightWeights => {
                double_materials(scene);
                // A colour model would need fewer numbers, but eight weights are to be measured.
                if scene.accuracy.accumulate == AccumulateAs::Auto {
                    scene.accuracy.accumulate = AccumulateAs::Weights;
                }
            }
            Keeping::Model(model, dimension) => {
                scene.accuracy.accumulate = AccumulateAs::Spectral;
                scene.accuracy.model = model;
                scene.accuracy.dimension = Some(dimension);
            }
        }
        Ok(())
    }
}

/// Every embedded scene, at each size.
pub(super) fn scenes(size: Option<[usize; 2]>) -> Vec<Case> {
    let own = [("default", Subject::Default), ("peer", Subject::Peer)];
    let figures = figures::names().map(|name| (name, Subject::Figure(name)));
    let at = |(line, subject), size| Case { line, ..Case::of("scenes", subject, size) };
    own.into_iter().chain(figures).flat_map(|it| sizes(size).into_iter().map(move |size| at(it, size))).collect()
}

/// The paper's table: RGB, spectra and relighting.
pub(super) fn paper(size: Option<[usize; 2]>) -> Vec<Case> {
    let lines = [
        ("RGB", RGB, false),
        ("spectra, 4 weights", Keeping::Stated, false),
        ("spectra, k = 8", K8, false),
        ("coloured RGB", RGB, true),
        ("coloured spectra, k = 8", K8, true),
    ];
    let of_size = |size| lines.into_iter().map(move |line| Case::on("paper", line, size));
    size.map_or_else(|| vec![SIZES[0], SIZES[1]], |size| vec![size]).into_iter().flat_map(of_size).collect()
}

/// One quantity varied at a time, the others as in the peer scene. Volumes have at most `largest` voxels per side.
pub(super) fn scaling(size: Option<[usize; 2]>, largest: u32) -> Vec<Case> {
    let usual = size.unwrap_or(USUAL);
    let grey = ("grey, 4 weights", Keeping::Stated, false);
    let coloured = ("coloured, k = 8", K8, true);
    let all = [grey, ("grey, k = 8", K8, false), coloured];
    let mut cases = Vec::new();
    for (line, dyed) in [("grey", false), ("coloured", true)] {
        let keeping = |k: u8| Keeping::Model(ModelKind::Nodes, k.into());
        let of = |k: u8| Case::on("k", (line, keeping(k), dyed), usual).varied("k", k.into());
        cases.extend(DIMENSIONS.into_iter().map(of));
    }
    for line in all {
        let of = |positions| Case { positions: Some(positions), ..Case::on("positions", line, usual) };
        cases.extend(POSITIONS.map(|positions| of(positions).varied("positions", positions.into())));
    }
    for line in all {
        let pixels = |[width, height]: [usize; 2]| u32::try_from(width * height).unwrap_or(u32::MAX);
        let of = |size| Case::on("pixels", line, size).varied("pixels", pixels(size));
        cases.extend(sizes(size).into_iter().map(of));
    }
    for side in SIDES.into_iter().filter(|&side| side <= largest) {
        let of = |line| Case { side: Some(side), ..Case::on("voxels", line, usual) };
        cases.extend([grey, coloured].map(|line| of(line).varied("voxels", side.pow(3))));
    }
    cases
}

fn sizes(size: Option<[usize; 2]>) -> Vec<[usize; 2]> {
    size.map_or_else(|| SIZES.to_vec(), |size| vec![size])
}

/// Lights the peer scene from `positions` directions: its own light, the other three of the compared renderers
/// (shared/bench/peerlib.py), and more between them. Spectra do not affect a march.
fn add_lights(scene: &mut Scene, positions: u8) {
    let Some(key) = scene.lights.first().cloned() else {
        return;
    };
    let directions = [
        ("second", [0.8, -0.2, -0.5]),
        ("third", [-0.8, 0.3, -0.5]),
        ("fourth", [0.1, 0.9, -0.4]),
        ("fifth", [0.9, 0.4, 0.3]),
        ("sixth", [-0.6, -0.3, 0.7]),
        ("seventh", [0.2, -0.9, 0.3]),
        ("eighth", [0.3, 0.3, -0.9]),
    ];
    for (name, direction) in directions.into_iter().take(usize::from(positions.saturating_sub(1))) {
        let placement = Placement::Directional(DVec3::from_array(direction).normalize());
        scene.lights.push(SceneLight { name: name.to_owned(), placement, ..key.clone() });
    }
}

/// Gives every material its own dye, with an optical depth at its peak equal to that of the material's scattering.
fn dye(scene: &mut Scene) -> Result<(), CliError> {
    const PEAKS_NM: [f64; 4] = [450.0, 510.0, 570.0, 630.0];
    for (material, peak) in scene.materials.iter_mut().zip(PEAKS_NM.into_iter().cycle()) {
        let dye = Spectrum::gaussian(peak, 40.0, 1.0).and_then(Absorption::new);
        material.absorption = Some(dye.map_err(|error| CliError::Failed(error.to_string()))?);
    }
    for term in &mut scene.transfer.terms {
        term.absorption = term.opacity.iter().map(|&(value, opacity)| (value, -(-opacity).ln_1p())).collect();
    }
    Ok(())
}

/// Doubles every material, the second time under another name.
fn double_materials(scene: &mut Scene) {
    let materials = scene.materials.len();
    for material in scene.materials.clone() {
        scene.materials.push(Material { name: format!("{} again", material.name), ..material });
    }
    for mut term in scene.transfer.terms.clone() {
        for (_, material) in &mut term.material.0 {
            *material += materials;
        }
        scene.transfer.terms.push(term);
    }
}
