//! How few numbers carry a spectrum through a scene, and at what error.
//!
//! A colour model is a projection `P` (k × 81) and a matrix `W` (3 × k) per light. A material is carried as `P` times
//! its spectrum; everything on the way of light is componentwise; and the colour of a pixel that holds the k numbers
//! `c` is `W·c`. Which light it is enters in `W` alone.

mod chain;
mod check;
mod cloud;
mod error;
mod fit;
mod fixed;
mod kind;
mod lawson;
mod nodes;
mod peercy;
pub mod random;
mod reconstruction;
mod sharpened;
mod target;

use nalgebra::DMatrix;
use rayon::prelude::*;

use crate::spectrum::observer::Observer;
use crate::spectrum::{BANDS, Light, Spectrum, wavelength_nm};

pub use chain::ChainClass;
pub use cloud::{Cloud, LARGEST_DEPTH};
pub use error::ModelError;
pub use fit::{fit, fit_automatic, fit_cloud, fit_narrow, unseen};
pub use kind::{ModelKind, Order};
pub use peercy::Matrices;
pub use reconstruction::Reconstruction;
pub use target::ErrorSummary;

use target::Target;

/// The largest dimension of a model: the bands of 10 nm from 400 to 700 nm that spectra are tabulated in, ends included.
pub const LARGEST_DIMENSION: usize = 31;

/// The largest dimension that [`fit_automatic`] and [`fit_narrow`] take by themselves: what more could gain is below every
/// tolerance that anyone sees, and each is as dear as the ones before.
pub const LARGEST_AUTOMATIC_DIMENSION: usize = 16;

/// What the light of a scene can meet on its way: what a model must carry.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ingredients {
    /// The materials in use. Negative samples are allowed: artificial ones have them.
    pub reflectances: Vec<Spectrum>,
    /// The shapes, of peak 1, of the wavelength-dependent absorptions in use; none: all absorption is grey.
    pub absorptions: Vec<Spectrum>,
    /// What is seen through what passes.
    pub background: Option<Spectrum>,
    /// Whether white highlights are in use.
    pub highlights: bool,
    /// The scene's own lights, by name.
    pub lights: Vec<(String, Light)>,
    /// Whether they shine from several places: a pixel then adds up different spectra under each of them.
    pub mixed: bool,
    /// The largest optical depth of coloured absorption that can occur; 0 when all absorption is grey. Above
    /// [`LARGEST_DEPTH`], it counts as that.
    pub largest_depth: f64,
}

/// How the colours under one light are made of a model's coefficients.
#[derive(Clone, Debug, PartialEq)]
pub struct LightMatrix {
    /// Column i: XYZ per unit of component i.
    pub xyz: Vec<[f64; 3]>,
    /// ΔE00 over the cloud that the model was fitted on.
    pub error: ErrorSummary,
    /// ΔE00 over spectra that were not used in the fit, where that was measured.
    pub unseen: Option<ErrorSummary>,
}

impl LightMatrix {
    /// The worse of the errors on the cloud and on spectra that were not used in the fit.
    pub fn worst(&self) -> ErrorSummary {
        self.unseen.map_or(self.error, |unseen| self.error.worst(unseen))
    }
}

/// What becomes of coefficients of an absorption that are negative, which would amplify light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Amplification {
    /// They are held at 0: what pictures are made with.
    Held,
    /// They are kept, to show what the model does by itself.
    Kept,
}

/// Few numbers that stand for a spectrum: see the [module](self).
#[derive(Clone, Debug, PartialEq)]
pub struct ColourModel {
    kind: ModelKind,
    /// Whom its matrices are for.
    observer: Observer,
    projection: Vec<Spectrum>,
    cloud: Vec<Spectrum>,
    vectors: Vec<Vec<f64>>,
    /// Spectra that were not used in the fit, with their coefficients; none where nothing was checked.
    unseen: Samples,
    /// Whether it is checked on sums of different spectra under different lights, too.
    mixed: bool,
    lights: Vec<(String, Light, LightMatrix)>,
}

/// Light-independent spectra of pixels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Samples {
    /// The spectra.
    pub spectra: Vec<Spectrum>,
    /// The coefficients of each, as componentwise arithmetic makes them.
    pub vectors: Vec<Vec<f64>>,
}

/// The row of a projection that takes the sample of one band.
fn one_band(band: usize) -> Spectrum {
    Spectrum::from_samples(std::array::from_fn(|other| if other == band { 1.0 } else { 0.0 }))
}

impl ColourModel {
    /// Every band of the grid: nothing is left out, and nothing is fitted. What other models are measured against.
    pub fn full_spectrum() -> Self {
        let projection = (0..BANDS).map(one_band).collect();
        let (kind, observer) = (ModelKind::Nodes, Observer::default());
        let (cloud, vectors, unseen, lights) = (Vec::new(), Vec::new(), Samples::default(), Vec::new());
        Self { kind, observer, projection, cloud, vectors, unseen, mixed: false, lights }
    }

    /// A model of stored parts; with it, new lights are fitted as with the model that the parts were taken from.
    ///
    /// `projection` has a row per coefficient; `cloud` holds the spectra of [`Self::cloud`], and `vectors` their
    /// coefficients. Where those are left out they are the projections of the cloud's spectra, which for nodes they
    /// are anyway; for other models the errors of componentwise products are then left out too.
    ///
    /// # Errors
    ///
    /// [`ModelError::Parts`] when the numbers of rows, columns and coefficients differ, when there is nothing, or when
    /// a row of nodes is not one wavelength; [`ModelError::NotFinite`] when a part is not finite.
    pub fn from_parts(
        kind: ModelKind,
        projection: Vec<Spectrum>,
        cloud: Vec<Spectrum>,
        vectors: Option<Vec<Vec<f64>>>,
        lights: Vec<(String, Light, LightMatrix)>,
    ) -> Result<Self, ModelError> {
        let wrong = |problem: String| Err(ModelError::Parts { problem });
        let dimension = projection.len();
        if !(1..=LARGEST_DIMENSION).contains(&dimension) || kind.is_rgb() && dimension != 3 {
            return wrong(format!("the model {kind} cannot have {dimension} coefficients"));
        }
        if cloud.is_empty() {
            return wrong("the cloud has no spectra".to_owned());
        }
        let (observer, vectors_of_cloud, unseen) = (Observer::default(), Vec::new(), Samples::default());
        let mut model =
            Self { kind, observer, projection, cloud, vectors: vectors_of_cloud, unseen, mixed: false, lights };
        if kind == ModelKind::Nodes && model.nodes_nm().is_none_or(|nodes| nodes.len() != dimension) {
            return wrong("a row of the projection is not one wavelength, as a node is".to_owned());
        }
        model.vectors = model.checked_vectors(&model.cloud, vectors)?;
        if let Some((name, _, matrix)) = model.lights.iter().find(|(.., matrix)| matrix.xyz.len() != dimension) {
            return wrong(format!("the light {name:?} has {} of {dimension} columns", matrix.xyz.len()));
        }
        if model.is_finite() { Ok(model) } else { Err(ModelError::NotFinite) }
    }

    /// The same of stored parts whose matrices are those of `observer`, not of 1931: see [`Self::from_parts`].
    #[must_use]
    pub fn with_observer(self, observer: Observer) -> Self {
        Self { observer, ..self }
    }

    /// The same with stored spectra that were not used in its fit, and their coefficients: see [`Self::from_parts`].
    /// `mixed` says whether it is checked on sums of them under several lights.
    ///
    /// # Errors
    ///
    /// [`ModelError::Parts`] when their numbers differ, [`ModelError::NotFinite`] when one is not finite.
    pub fn with_unseen(
        mut self,
        spectra: Vec<Spectrum>,
        vectors: Option<Vec<Vec<f64>>>,
        mixed: bool,
    ) -> Result<Self, ModelError> {
        let vectors = self.checked_vectors(&spectra, vectors)?;
        self.mixed = mixed;
        self.unseen = Samples { spectra, vectors };
        if self.is_finite() { Ok(self) } else { Err(ModelError::NotFinite) }
    }

    /// `vectors`, or where there are none the projections of `spectra`, if there is a whole one for each of these.
    fn checked_vectors(
        &self,
        spectra: &[Spectrum],
        vectors: Option<Vec<Vec<f64>>>,
    ) -> Result<Vec<Vec<f64>>, ModelError> {
        let wrong = |problem: String| Err(ModelError::Parts { problem });
        let vectors = vectors.unwrap_or_else(|| spectra.iter().map(|spectrum| self.coefficients(spectrum)).collect());
        if vectors.len() != spectra.len() {
            return wrong(format!("{} spectra have {} vectors", spectra.len(), vectors.len()));
        }
        match vectors.iter().find(|vector| vector.len() != self.dimension()) {
            Some(vector) => wrong(format!("a vector has {} of {} coefficients", vector.len(), self.dimension())),
            None => Ok(vectors),
        }
    }

    fn is_finite(&self) -> bool {
        let cloud = self.cloud.iter().chain(&self.unseen.spectra);
        let vectors = self.vectors.iter().chain(&self.unseen.vectors);
        let spectra = self.projection.iter().chain(cloud).chain(self.lights.iter().map(|(_, l, _)| l.spectrum()));
        let matrices = self.lights.iter().flat_map(|(.., matrix)| matrix.xyz.iter().flatten());
        spectra.into_iter().all(Spectrum::is_finite) && vectors.flatten().chain(matrices).all(|part| part.is_finite())
    }

    /// What kind of model it is.
    pub const fn kind(&self) -> ModelKind {
        self.kind
    }

    /// Whom its matrices, and their errors, are for.
    pub const fn observer(&self) -> Observer {
        self.observer
    }

    /// How many coefficients it has: `k`.
    pub const fn dimension(&self) -> usize {
        self.projection.len()
    }

    /// The model in words: "8 nodes (420, 455, … nm)", "RGB, prefiltered by D65".
    pub fn description(&self) -> String {
        let k = self.dimension();
        let plural = if k == 1 { "" } else { "s" };
        match self.kind {
            ModelKind::Nodes if k == BANDS => format!("all {BANDS} wavelengths"),
            ModelKind::Nodes => {
                let nodes: Vec<String> = self.nodes_nm().iter().flatten().map(f64::to_string).collect();
                format!("{k} node{plural} ({} nm)", nodes.join(", "))
            }
            ModelKind::Sharpened(Order::Step) => format!("{k} sharpened factor{plural}, each step's light projected"),
            ModelKind::Sharpened(Order::Semigroup) => format!("{k} sharpened factor{plural}, absorption projected"),
            ModelKind::Peercy => {
                format!("{k} factor{plural} of an orthonormal basis, with matrices between them (Peercy)")
            }
            ModelKind::Bands => format!("{k} uniform band{plural} from 400 to 700 nm"),
            ModelKind::RgbFitted => "RGB, prefiltered by D65, with a matrix fitted to each light".to_owned(),
            ModelKind::Rgb | ModelKind::RgbNaive if self.projection == fixed::rgb() => {
                "RGB, not prefiltered".to_owned()
            }
            ModelKind::Rgb | ModelKind::RgbNaive | ModelKind::RgbPrefiltered => "RGB, prefiltered by D65".to_owned(),
        }
    }

    /// `P`: a row per coefficient, whose products with a spectrum's samples sum to it.
    pub fn projection(&self) -> &[Spectrum] {
        &self.projection
    }

    /// The wavelengths, ascending, whose samples are the coefficients; `None` for models that are not nodes.
    pub fn nodes_nm(&self) -> Option<Vec<f64>> {
        let bands = (self.kind == ModelKind::Nodes).then(|| self.bands())?;
        Some(bands.into_iter().map(wavelength_nm).collect())
    }

    /// The bands of rows that take one band's sample.
    fn bands(&self) -> Vec<usize> {
        let is_row = |band: &usize| self.projection.iter().any(|row| *row == one_band(*band));
        (0..BANDS).filter(is_row).collect()
    }

    /// The spectra that the model was fitted on: light-independent spectra of pixels, which f32 holds exactly.
    pub fn cloud(&self) -> &[Spectrum] {
        &self.cloud
    }

    /// The coefficients of each spectrum of the cloud, as componentwise arithmetic makes them; f32 holds them exactly.
    pub fn cloud_vectors(&self) -> &[Vec<f64>] {
        &self.vectors
    }

    /// Spectra that were not used in the fit, with their coefficients, which f32 holds exactly; none where nothing was
    /// checked.
    pub fn unseen(&self) -> &Samples {
        &self.unseen
    }

    /// Whether errors are those of sums of different spectra under different lights, too.
    pub const fn is_mixed(&self) -> bool {
        self.mixed
    }

    /// The lights the model was fitted for, in the order they were given in.
    pub fn lights(&self) -> &[(String, Light, LightMatrix)] {
        &self.lights
    }

    /// The largest of the errors under the model's lights; zeros when there are none.
    pub fn worst(&self) -> ErrorSummary {
        self.lights.iter().map(|(.., matrix)| matrix.worst()).fold(ErrorSummary::default(), ErrorSummary::worst)
    }

    /// The k coefficients of a spectrum of reflection; those of white are ones. Negative ones are kept.
    pub fn coefficients(&self, spectrum: &Spectrum) -> Vec<f64> {
        self.projection.iter().map(|row| row.dot(spectrum)).collect()
    }

    /// The k coefficients of a shape of absorption, none of them negative; see [`Self::amplification`].
    ///
    /// Times an optical depth, they are the optical depths of the components. The model
    /// [`ModelKind::Sharpened`]`(`[`Order::Step`]`)` needs [`Self::step_depths`] instead.
    pub fn absorption_coefficients(&self, absorption: &Spectrum) -> Vec<f64> {
        self.unclamped_absorption_coefficients(absorption).into_iter().map(|depth| depth.max(0.0)).collect()
    }

    /// What [`Self::absorption_coefficients`] are before negative ones are held at 0: for reports.
    pub fn unclamped_absorption_coefficients(&self, absorption: &Spectrum) -> Vec<f64> {
        self.coefficients(absorption)
    }

    /// A sentence on the coefficients of an absorption that had to be held at 0, where there are any.
    pub fn amplification(&self, absorption: &Spectrum) -> Option<String> {
        let coefficients = self.unclamped_absorption_coefficients(absorption);
        let least = coefficients.iter().copied().fold(0.0, f64::min);
        let negative = coefficients.iter().filter(|&&part| part < 0.0).count();
        (negative > 0).then(|| {
            format!(
                "{negative} of the {} components of an absorption are negative, down to {least:.3} of its peak, and \
                 would amplify light; they are held at 0",
                self.dimension()
            )
        })
    }

    /// The optical depth of each component across one step of a medium whose optical depth per wavelength is `depth`.
    ///
    /// Linear in `depth`, and so independent of how a way is cut into steps, for every model but
    /// [`ModelKind::Sharpened`]`(`[`Order::Step`]`)`, which projects the step's transmittance. Between 0 and 80 where
    /// amplification is [`Amplification::Held`].
    pub fn step_depths(&self, depth: &Spectrum, amplification: Amplification) -> Vec<f64> {
        const OPAQUE: f64 = 80.0;
        let mut depths = match self.kind {
            ModelKind::Sharpened(Order::Step) => {
                let transmittance = Spectrum::from_samples(depth.samples().map(|depth| (-depth).exp()));
                let parts = self.coefficients(&transmittance).into_iter();
                parts.map(|part| if part > 0.0 { -part.ln() } else { OPAQUE }).collect()
            }
            _ => self.coefficients(depth),
        };
        if amplification == Amplification::Held {
            for depth in &mut depths {
                *depth = depth.clamp(0.0, OPAQUE);
            }
        }
        depths
    }

    /// The coefficients that componentwise arithmetic makes of each chain of `cloud`.
    fn vectors_of(&self, cloud: &Cloud, amplification: Amplification) -> Vec<Vec<f64>> {
        // At nodes all arithmetic is that of the spectra themselves.
        if self.kind == ModelKind::Nodes {
            return nodes::sampled(&cloud.spectra, &self.bands());
        }
        if self.kind == ModelKind::Peercy {
            let matrices = Matrices::new(self);
            let depth = |absorbed: &[(usize, f64)]| cloud.depth(absorbed);
            return cloud
                .chains
                .par_iter()
                .map(|chain| chain.walk_by_matrices(&matrices, &cloud.sources, &depth))
                .collect();
        }
        let sources: Vec<Vec<f64>> = cloud.sources.iter().map(|source| self.coefficients(source)).collect();
        let absorptions: Vec<Vec<f64>> =
            cloud.absorptions.iter().map(|absorption| self.step_depths(absorption, amplification)).collect();
        let depths = |absorbed: &[(usize, f64)]| match self.kind {
            ModelKind::Sharpened(Order::Step) => self.step_depths(&cloud.depth(absorbed), amplification),
            _ => {
                let component =
                    |i: usize| absorbed.iter().map(|&(index, depth)| depth * absorptions[index][i]).sum::<f64>();
                (0..self.dimension()).map(component).collect()
            }
        };
        cloud.chains.par_iter().map(|chain| chain.walk(self.dimension(), &sources, &depths)).collect()
    }

    /// [`Self::vectors_of`] in numbers that f32 holds, so that a file of f32 brings the very same ones back.
    fn stored_vectors_of(&self, cloud: &Cloud) -> Vec<Vec<f64>> {
        let mut vectors = self.vectors_of(cloud, Amplification::Held);
        vectors.iter_mut().flatten().for_each(|part| *part = cloud::single(*part));
        vectors
    }

    /// ΔE00 of each of `cloud`'s spectra under `light`, whether it belongs to the model or is new.
    pub fn errors(&self, cloud: &Cloud, light: &Light, amplification: Amplification) -> Vec<f64> {
        let target = Target::new(&cloud.spectra, light, self.observer);
        target.errors(&self.vectors_of(cloud, amplification), &self.matrix(light).xyz)
    }

    /// The matrix of a light to `observer`: that of [`Self::matrix`] where it is the model's own observer, else a new one
    /// fitted on the cloud, which takes its time: see [`Self::seen_by`].
    pub fn matrix_for(&self, light: &Light, observer: Observer) -> LightMatrix {
        if observer == self.observer { self.matrix(light) } else { self.fitted_for(light, observer) }
    }

    /// The matrix of a light: the model's own where the light is one of its lights, else a new one fitted on the
    /// cloud.
    ///
    /// It is made of the cloud and the light alone: a model of stored parts gives the very same numbers.
    pub fn matrix(&self, light: &Light) -> LightMatrix {
        match self.lights.iter().find(|(_, known, _)| known == light) {
            Some((.., matrix)) => matrix.clone(),
            None => self.fitted(light),
        }
    }

    fn fitted(&self, light: &Light) -> LightMatrix {
        self.fitted_for(light, self.observer)
    }

    fn fitted_for(&self, light: &Light, observer: Observer) -> LightMatrix {
        if self.dimension() == BANDS {
            let (power, functions) = (light.spectrum().samples(), observer.matching());
            let colour = |band: usize| functions.each_ref().map(|matching| matching.samples()[band] * power[band]);
            let xyz = (0..BANDS).map(colour).collect();
            return LightMatrix { xyz, error: ErrorSummary::default(), unseen: None };
        }
        let target = Target::new(&self.cloud, light, observer);
        let xyz = match self.kind {
            ModelKind::Nodes | ModelKind::Bands | ModelKind::RgbFitted => {
                let fitted = lawson::fit(&self.vectors, self.dimension(), &target, &target.forms());
                return LightMatrix { xyz: fitted.matrix, error: fitted.error, unseen: None };
            }
            ModelKind::Sharpened(_) => sharpened::matrix(&self.projection, light, observer),
            ModelKind::Peercy => peercy::matrix(&self.projection, light, observer),
            ModelKind::Rgb | ModelKind::RgbNaive | ModelKind::RgbPrefiltered => fixed::rgb_matrix(light, observer),
        };
        let error = ErrorSummary::of(&target.errors(&self.vectors, &xyz));
        LightMatrix { xyz, error, unseen: None }
    }

    /// How spectra are made of coefficients again; see [`Reconstruction`].
    pub fn reconstruction(&self) -> Reconstruction {
        Reconstruction::new(self)
    }

    /// The most, in ΔE00, that storing finished coefficients in 16-bit floats can change a colour: over the cloud and
    /// the model's lights, shown `brightness` times as bright as unit lights are, where pixels may hold up to `sum`
    /// times what one surface sends. Both are 1 at least.
    ///
    /// Each coefficient is off by at most 2⁻¹¹ of itself, or 2⁻²⁵ below the normal numbers. A colour brighter than white
    /// is looked at where there is so little of it that it is white. Infinite where a coefficient is larger than such a
    /// float can be.
    pub fn half_precision_error(&self, brightness: f64, sum: f64) -> f64 {
        const LARGEST: f64 = 65504.0;
        if self.vectors.iter().flatten().any(|part| part.abs() > LARGEST) {
            return f64::INFINITY;
        }
        let least = brightness * 0.5_f64.powi(25);
        let of_light = |(_, light, matrix): &(String, Light, LightMatrix)| {
            // How much of each there can be: what makes it white, or all.
            let shown = |spectrum: &Spectrum| {
                let luminance = self.observer.matching()[1].dot(&(light.spectrum() * spectrum));
                if luminance > 0.0 { luminance.recip().max(1.0).min(brightness * sum) } else { brightness * sum }
            };
            let shown: Vec<f64> = self.cloud.iter().map(shown).collect();
            let cloud: Vec<Spectrum> = self.cloud.iter().zip(&shown).map(|(it, &shown)| it.scaled(shown)).collect();
            let forms = Target::new(&cloud, light, self.observer).forms();
            let of_colour = |((vector, &shown), form): ((&Vec<f64>, &f64), &[f64; 6])| {
                let rounding = |part: f64| (shown * part.abs() * 0.5_f64.powi(11)).max(least);
                let pairs = vector.iter().zip(&matrix.xyz);
                let along = |column: [f64; 3]| {
                    let pull = target::applied(form, column);
                    (0..3).map(|axis| pull[axis] * column[axis]).sum::<f64>().max(0.0).sqrt()
                };
                pairs.map(|(&part, &column)| rounding(part) * along(column)).sum::<f64>()
            };
            self.vectors.iter().zip(&shown).zip(&forms).map(of_colour).fold(0.0, f64::max)
        };
        self.lights.par_iter().map(of_light).reduce(|| 0.0, f64::max)
    }
}

/// The rows of `spectra` as a matrix.
fn matrix_of(spectra: &[Spectrum]) -> DMatrix<f64> {
    DMatrix::from_fn(spectra.len(), BANDS, |row, band| spectra[row].samples()[band])
}
