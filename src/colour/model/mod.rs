//! Colour models: spectra as few coefficients, with known errors.
//!
//! A colour model is a projection `P` (k × 81) and a matrix `W` (3 × k) per light. `P` times a material's spectrum
//! gives its coefficients; light transport is componentwise; and the colour of a pixel with the k coefficients `c` is
//! `W·c`. Only `W` depends on the light.

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
pub use target::{ErrorSummary, UnplannedLight};

use target::Target;

/// Largest dimension of a model: the number of 10 nm bands from 400 to 700 nm, ends included, in which spectra are
/// tabulated.
pub const LARGEST_DIMENSION: usize = 31;

/// Largest dimension that [`fit_automatic`] and [`fit_narrow`] choose. Further coefficients gain less than any visible
/// tolerance, and each costs as much as the ones before.
pub const LARGEST_AUTOMATIC_DIMENSION: usize = 16;

/// Spectra and optical depths of a scene that a model must represent.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ingredients {
    /// Reflectances of the materials in use. Negative samples are allowed: artificial materials have them.
    pub reflectances: Vec<Spectrum>,
    /// Absorption spectra in use, with a peak of 1; empty if all absorption is grey.
    pub absorptions: Vec<Spectrum>,
    /// Background, seen through the volume.
    pub background: Option<Spectrum>,
    /// Whether white highlights are in use.
    pub highlights: bool,
    /// Lights of the scene, by name.
    pub lights: Vec<(String, Light)>,
    /// Whether the lights shine from several positions: a pixel then sums different spectra under each of them.
    pub mixed: bool,
    /// Largest possible optical depth of coloured absorption; 0 if all absorption is grey. Limited to
    /// [`LARGEST_DEPTH`].
    pub largest_depth: f64,
    /// Whether light reaches samples through coloured absorption, too: twice the depths.
    pub two_ways: bool,
    /// Whether light scatters more than once: spectra of pixels are then products of any number of reflectances.
    pub scatters_often: bool,
}

/// Matrix from a model's coefficients to colours under one light, with its errors.
#[derive(Clone, Debug, PartialEq)]
pub struct LightMatrix {
    /// Column i: XYZ per unit of component i.
    pub xyz: Vec<[f64; 3]>,
    /// ΔE00 over the cloud of the fit.
    pub error: ErrorSummary,
    /// ΔE00 over spectra not used in the fit, if measured.
    pub unseen: Option<ErrorSummary>,
}

impl LightMatrix {
    /// Larger of the errors on the cloud and on spectra not used in the fit.
    pub fn worst(&self) -> ErrorSummary {
        self.unseen.map_or(self.error, |unseen| self.error.worst(unseen))
    }
}

/// Treatment of negative coefficients of an absorption, which would amplify light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Amplification {
    /// Held at 0, as in pictures.
    Held,
    /// Kept, to show the behaviour of the model itself.
    Kept,
}

/// A linear map from spectra to k coefficients; see the [module](self).
#[derive(Clone, Debug, PartialEq)]
pub struct ColourModel {
    kind: ModelKind,
    /// Observer of the matrices.
    observer: Observer,
    projection: Vec<Spectrum>,
    cloud: Vec<Spectrum>,
    vectors: Vec<Vec<f64>>,
    /// Spectra not used in the fit, with their coefficients; empty if the model was not checked.
    unseen: Samples,
    /// Whether the check includes sums of different spectra under different lights.
    mixed: bool,
    lights: Vec<(String, Light, LightMatrix)>,
}

/// Light-independent spectra of pixels, with their coefficients.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Samples {
    /// Spectra.
    pub spectra: Vec<Spectrum>,
    /// Coefficients of each spectrum, from componentwise arithmetic.
    pub vectors: Vec<Vec<f64>>,
}

/// Row of a projection that selects the sample of one band.
fn one_band(band: usize) -> Spectrum {
    Spectrum::from_samples(std::array::from_fn(|other| if other == band { 1.0 } else { 0.0 }))
}

impl ColourModel {
    /// Model of all bands, without loss or fit: the reference for the other models.
    pub fn full_spectrum() -> Self {
        let projection = (0..BANDS).map(one_band).collect();
        let (kind, observer) = (ModelKind::Nodes, Observer::default());
        let (cloud, vectors, unseen, lights) = (Vec::new(), Vec::new(), Samples::default(), Vec::new());
        Self { kind, observer, projection, cloud, vectors, unseen, mixed: false, lights }
    }

    /// Assembles a model from stored parts. New lights are fitted as with the original model.
    ///
    /// `projection` has one row per coefficient; `cloud` holds the spectra of [`Self::cloud`], and `vectors` their
    /// coefficients. Without `vectors`, the projections of the cloud's spectra are used. For nodes these are the same;
    /// for other models they omit the errors of componentwise products.
    ///
    /// # Errors
    ///
    /// [`ModelError::Parts`] when the numbers of rows, columns and coefficients differ, when parts are empty, or when a
    /// row of nodes is not a single wavelength; [`ModelError::NotFinite`] when a part is not finite.
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
            return wrong("a row of the projection of nodes does not select a single wavelength".to_owned());
        }
        model.vectors = model.checked_vectors(&model.cloud, vectors)?;
        if let Some((name, _, matrix)) = model.lights.iter().find(|(.., matrix)| matrix.xyz.len() != dimension) {
            return wrong(format!("the light {name:?} has {} of {dimension} columns", matrix.xyz.len()));
        }
        if model.is_finite() { Ok(model) } else { Err(ModelError::NotFinite) }
    }

    /// Sets the observer of stored matrices that are not for 1931; see [`Self::from_parts`].
    #[must_use]
    pub fn with_observer(self, observer: Observer) -> Self {
        Self { observer, ..self }
    }

    /// Adds stored spectra not used in the fit, and their coefficients; see [`Self::from_parts`]. `mixed` says whether
    /// the check includes sums of them under several lights.
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

    /// Returns `vectors`, by default the projections of `spectra`, after a check for one complete vector per spectrum.
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

    /// Kind of the model.
    pub const fn kind(&self) -> ModelKind {
        self.kind
    }

    /// Observer of the matrices and their errors.
    pub const fn observer(&self) -> Observer {
        self.observer
    }

    /// Number of coefficients `k`.
    pub const fn dimension(&self) -> usize {
        self.projection.len()
    }

    /// Description in words: "8 nodes (420, 455, … nm)", "RGB, prefiltered by D65".
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

    /// Projection `P`: one row per coefficient, the plain sum of the row's products with a spectrum's samples.
    pub fn projection(&self) -> &[Spectrum] {
        &self.projection
    }

    /// Wavelengths of the nodes in nm, ascending; `None` for models that are not nodes.
    pub fn nodes_nm(&self) -> Option<Vec<f64>> {
        let bands = (self.kind == ModelKind::Nodes).then(|| self.bands())?;
        Some(bands.into_iter().map(wavelength_nm).collect())
    }

    /// Bands that single rows of the projection select, ascending.
    fn bands(&self) -> Vec<usize> {
        let is_row = |band: &usize| self.projection.iter().any(|row| *row == one_band(*band));
        (0..BANDS).filter(is_row).collect()
    }

    /// Spectra that the model was fitted on: light-independent spectra of pixels, exact in f32.
    pub fn cloud(&self) -> &[Spectrum] {
        &self.cloud
    }

    /// Coefficients of each spectrum of the cloud, from componentwise arithmetic; exact in f32.
    pub fn cloud_vectors(&self) -> &[Vec<f64>] {
        &self.vectors
    }

    /// Spectra not used in the fit, with their coefficients, exact in f32; empty if the model was not checked.
    pub fn unseen(&self) -> &Samples {
        &self.unseen
    }

    /// Whether errors include sums of different spectra under different lights.
    pub const fn is_mixed(&self) -> bool {
        self.mixed
    }

    /// Lights of the fit, in their given order.
    pub fn lights(&self) -> &[(String, Light, LightMatrix)] {
        &self.lights
    }

    /// Largest errors under the model's lights; zeros if there are none.
    pub fn worst(&self) -> ErrorSummary {
        self.lights.iter().map(|(.., matrix)| matrix.worst()).fold(ErrorSummary::default(), ErrorSummary::worst)
    }

    /// Returns the k coefficients of a reflectance; those of white are ones. Negative coefficients are kept.
    pub fn coefficients(&self, spectrum: &Spectrum) -> Vec<f64> {
        self.projection.iter().map(|row| row.dot(spectrum)).collect()
    }

    /// Returns the k coefficients of an absorption spectrum, with negative ones held at 0; see [`Self::amplification`].
    ///
    /// Multiplied by an optical depth, they are the optical depths of the components. The model
    /// [`ModelKind::Sharpened`]`(`[`Order::Step`]`)` needs [`Self::step_depths`] instead.
    pub fn absorption_coefficients(&self, absorption: &Spectrum) -> Vec<f64> {
        self.unclamped_absorption_coefficients(absorption).into_iter().map(|depth| depth.max(0.0)).collect()
    }

    /// [`Self::absorption_coefficients`] with negative coefficients kept, for reports.
    pub fn unclamped_absorption_coefficients(&self, absorption: &Spectrum) -> Vec<f64> {
        self.coefficients(absorption)
    }

    /// Sentence about the coefficients of an absorption that are held at 0, if any.
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

    /// Optical depth of each component across one step of a medium with the optical depth per wavelength `depth`.
    ///
    /// Linear in `depth`, and therefore independent of the division of a path into steps, for every model except
    /// [`ModelKind::Sharpened`]`(`[`Order::Step`]`)`, which projects the step's transmittance. Between 0 and 80 with
    /// [`Amplification::Held`].
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

    /// Coefficients of each chain of `cloud`, from componentwise arithmetic (Peercy's model: matrix products).
    fn vectors_of(&self, cloud: &Cloud, amplification: Amplification) -> Vec<Vec<f64>> {
        // At nodes, the arithmetic is that of the spectra themselves.
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

    /// [`Self::vectors_of`], rounded to f32 so that a file of f32 stores them exactly.
    fn stored_vectors_of(&self, cloud: &Cloud) -> Vec<Vec<f64>> {
        let mut vectors = self.vectors_of(cloud, Amplification::Held);
        vectors.iter_mut().flatten().for_each(|part| *part = cloud::single(*part));
        vectors
    }

    /// ΔE00 of each spectrum of `cloud` under `light`, one of the model's lights or a new one.
    pub fn errors(&self, cloud: &Cloud, light: &Light, amplification: Amplification) -> Vec<f64> {
        let target = Target::new(&cloud.spectra, light, self.observer);
        target.errors(&self.vectors_of(cloud, amplification), &self.matrix(light).xyz)
    }

    /// Matrix of a light for `observer`: [`Self::matrix`] for the model's own observer, else a new fit on the cloud,
    /// which is slow; see [`Self::seen_by`].
    pub fn matrix_for(&self, light: &Light, observer: Observer) -> LightMatrix {
        if observer == self.observer { self.matrix(light) } else { self.fitted_for(light, observer) }
    }

    /// Matrix of a light: the stored matrix of one of the model's lights, else a new fit on the cloud.
    ///
    /// The fit depends on the cloud and the light alone: a model of stored parts gives identical numbers.
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

    /// Reconstruction of spectra from coefficients; see [`Reconstruction`].
    pub fn reconstruction(&self) -> Reconstruction {
        Reconstruction::new(self)
    }

    /// Largest change of a colour, in ΔE00, when finished coefficients are stored in 16-bit floats: over the cloud and
    /// the model's lights, displayed `brightness` times as bright as unit lights, in pixels of up to `sum` times the
    /// light of one surface. Both factors are at least 1.
    ///
    /// Each coefficient is off by at most 2⁻¹¹ of itself, or 2⁻²⁵ below the normal numbers. A colour that can be
    /// brighter than white is evaluated at the amount that makes it white. Infinite if a coefficient exceeds the
    /// largest 16-bit float.
    pub fn half_precision_error(&self, brightness: f64, sum: f64) -> f64 {
        const LARGEST: f64 = 65504.0;
        if self.vectors.iter().flatten().any(|part| part.abs() > LARGEST) {
            return f64::INFINITY;
        }
        let least = brightness * 0.5_f64.powi(25);
        let of_light = |(_, light, matrix): &(String, Light, LightMatrix)| {
            // Largest amount of each spectrum: up to white, or all there is.
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

/// Matrix with one spectrum per row.
fn matrix_of(spectra: &[Spectrum]) -> DMatrix<f64> {
    DMatrix::from_fn(spectra.len(), BANDS, |row, band| spectra[row].samples()[band])
}
