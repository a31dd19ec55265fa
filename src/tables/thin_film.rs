//! Thin films of the materials, as numbers of the march (docs/theory/thin-films.md).

use crate::number::{rounded, unsigned};
use crate::plan::{LANE, Planned};
use crate::scene::Scene;
use crate::spectrum::{BANDS, FILM_ANGLES};

/// Number of angles of a [`FilmTable`].
pub const FILM_ROWS: usize = FILM_ANGLES;

/// A thin film as numbers of the plan's components.
#[derive(Clone, Debug, PartialEq)]
pub struct FilmRows {
    /// Factor of the light that it reflects.
    pub factor: f64,
    /// Exponent of its highlight.
    pub exponent: u32,
    /// Number of its material among those in use.
    pub weight: usize,
    /// Components of the reflected light at each angle, of cosines that are evenly spaced from 0 to 1.
    pub angles: Vec<Vec<f64>>,
}

impl FilmRows {
    /// The films of `planned`, those of the diffuse part first. All 81 wavelengths have more angles, as the reference of
    /// other plans.
    #[must_use]
    pub fn of_plan(scene: &Scene, planned: &Planned) -> Vec<Self> {
        let components = planned.plan.components();
        let rows = planned.films(scene).into_iter().map(|planned_film| {
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
                factor: material.film_factor(film.angle()),
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
pub struct FilmTable {
    /// [`FilmRows::factor`] of each film.
    pub factor: Vec<[f32; LANE]>,
    /// [`FilmRows::exponent`] of each film.
    pub exponent: Vec<[u32; LANE]>,
    /// [`FilmRows::weight`] of each film.
    pub weight: Vec<[u32; LANE]>,
    /// [`FilmRows::angles`] of each film, one after another.
    pub angles: Vec<[f32; LANE]>,
}

impl FilmTable {
    /// Builds the table of `planned`.
    #[must_use]
    pub fn new(scene: &Scene, planned: &Planned) -> Self {
        let films = FilmRows::of_plan(scene, planned);
        let lanes = planned.plan.film_lanes();
        let mut table = Self {
            factor: vec![[0.0; LANE]; lanes],
            exponent: vec![[0; LANE]; lanes],
            weight: vec![[0; LANE]; lanes],
            angles: Vec::new(),
        };
        for (i, film) in films.iter().enumerate() {
            let (lane, part) = (i / LANE, i % LANE);
            table.factor[lane][part] = rounded(film.factor);
            table.exponent[lane][part] = film.exponent;
            table.weight[lane][part] = unsigned(film.weight);
            for row in &film.angles {
                let lanes = row.chunks(LANE);
                table
                    .angles
                    .extend(lanes.map(|lane| std::array::from_fn(|part| lane.get(part).copied().map_or(0.0, rounded))));
            }
        }
        table
    }
}
