//! Thin films of the materials, as numbers of the march (docs/theory/thin-films.md).

use crate::Scene;
use crate::plan::{LANE, Planned};
use relume_base::number::{rounded, unsigned};
use relume_colour::spectrum::{BANDS, THIN_FILM_ANGLES};

/// Number of angles of a [`ThinFilmTable`].
pub const FILM_ROWS: usize = THIN_FILM_ANGLES;

/// A thin film as numbers of the plan's components.
#[derive(Clone, Debug, PartialEq)]
pub struct ThinFilmRows {
    /// Factor of the light that it reflects.
    pub factor: f64,
    /// Exponent of its highlight.
    pub exponent: u32,
    /// Number of its material among those in use.
    pub weight: usize,
    /// Components of the reflected light at each angle, of cosines that are evenly spaced from 0 to 1.
    pub angles: Vec<Vec<f64>>,
}

impl ThinFilmRows {
    /// The films of `planned`, those of the diffuse part first. All 81 wavelengths have more angles, as the reference of
    /// other plans.
    #[must_use]
    pub fn of_plan(scene: &Scene, planned: &Planned) -> Vec<Self> {
        let components = planned.plan.components();
        let rows = planned.thin_films(scene).into_iter().map(|planned_film| {
            let (film, material) = (planned_film.film, planned_film.material);
            let angles = match &planned.model {
                None => {
                    let of_angle = |factors: &Vec<f64>| {
                        let mut row = vec![0.0; components];
                        let own = row.iter_mut().skip(planned_film.first).take(planned_film.terms);
                        own.zip(factors).for_each(|(part, &factor)| *part = factor);
                        row
                    };
                    film.terms().factors.iter().map(of_angle).collect()
                }
                Some(model) if model.dimension() == BANDS => {
                    film.at_fine_angles().iter().map(|spectrum| spectrum.samples().to_vec()).collect()
                }
                Some(model) => film.at_angles().iter().map(|spectrum| model.coefficients(spectrum)).collect(),
            };
            Self {
                factor: material.thin_film_factor(film.angle()),
                exponent: material.exponent,
                weight: planned_film.weight,
                angles,
            }
        });
        rows.collect()
    }
}

/// Thin films in lanes; unused numbers are 0.
#[derive(Clone, Debug, PartialEq)]
pub struct ThinFilmTable {
    /// [`ThinFilmRows::factor`] of each film.
    pub factor: Vec<[f32; LANE]>,
    /// [`ThinFilmRows::exponent`] of each film.
    pub exponent: Vec<[u32; LANE]>,
    /// [`ThinFilmRows::weight`] of each film.
    pub weight: Vec<[u32; LANE]>,
    /// With weights, the film of each component of [`ScenePlan::thin_film_vectors`](crate::plan::ScenePlan::thin_film_vectors).
    pub film: Vec<[u32; LANE]>,
    /// [`ThinFilmRows::angles`] of each film, one after another. With weights, those of all films in one row per angle: each component
    /// belongs to one film.
    pub angles: Vec<[f32; LANE]>,
}

/// No film.
const NONE: u32 = u32::MAX;

impl ThinFilmTable {
    /// Builds the table of `planned`.
    #[must_use]
    pub fn new(scene: &Scene, planned: &Planned) -> Self {
        let thin_films = ThinFilmRows::of_plan(scene, planned);
        let lanes = planned.plan.thin_film_lanes();
        let mut table = Self {
            factor: vec![[0.0; LANE]; lanes],
            exponent: vec![[0; LANE]; lanes],
            weight: vec![[0; LANE]; lanes],
            film: vec![[NONE; LANE]; planned.plan.thin_film_vectors().len().max(1)],
            angles: Vec::new(),
        };
        for (i, film) in thin_films.iter().enumerate() {
            let (lane, part) = (i / LANE, i % LANE);
            table.factor[lane][part] = rounded(film.factor);
            table.exponent[lane][part] = film.exponent;
            table.weight[lane][part] = unsigned(film.weight);
        }
        let vector = |lane: &[f64]| std::array::from_fn(|part| lane.get(part).copied().map_or(0.0, rounded));
        if planned.model.is_some() {
            let rows = thin_films.iter().flat_map(|film| &film.angles);
            table.angles = rows.flat_map(|row| row.chunks(LANE)).map(vector).collect();
            return table;
        }
        let first = planned.plan.thin_film_vectors().start * LANE;
        for (i, film) in planned.thin_films(scene).iter().enumerate() {
            for component in film.first - first..film.first + film.terms - first {
                table.film[component / LANE][component % LANE] = unsigned(i);
            }
        }
        for angle in 0..thin_films.first().map_or(0, |film| film.angles.len()) {
            let component = |component| thin_films.iter().map(|film| film.angles[angle][component]).sum();
            let row: Vec<f64> = (first..planned.plan.components()).map(component).collect();
            table.angles.extend(row.chunks(LANE).map(vector));
        }
        table
    }
}
