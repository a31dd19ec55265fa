//! Convex quadratic programs over unknown numbers, solved by an interior-point method.

use std::ops::Range;

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus, ZeroConeT};

/// A sum of unknowns, each times a factor.
pub(super) type Sum = Vec<(usize, f64)>;

/// Half the sum of squares of residuals, to be made small within linear constraints.
#[derive(Debug, Default)]
pub(super) struct Program {
    unknowns: usize,
    /// Entries of the upper triangle of the quadratic form: row, column, value; equal places add up.
    quadratic: Vec<(usize, usize, f64)>,
    equal: Vec<(Sum, f64)>,
    at_most: Vec<(Sum, f64)>,
    residuals: usize,
}

/// What solves a [`Program`].
#[derive(Debug)]
pub(super) struct Answer {
    /// The unknowns.
    pub(super) unknowns: Vec<f64>,
    /// The sum of squares that nothing within the constraints falls below, by the dual problem; 0 where the solver
    /// could not tell.
    pub(super) least: f64,
}

impl Program {
    /// New unknowns, `count` in a row; the index of the first.
    pub(super) fn unknowns(&mut self, count: usize) -> usize {
        let first = self.unknowns;
        self.unknowns += count;
        first
    }

    /// Asks that `sum` be near `value`.
    ///
    /// The residual is an unknown of its own: with the normal equations, the solution would lose a digit.
    pub(super) fn near(&mut self, mut sum: Sum, value: f64) {
        let residual = self.unknowns(1);
        self.quadratic.push((residual, residual, 1.0));
        sum.push((residual, -1.0));
        self.equal(sum, value);
        self.residuals += 1;
    }

    /// Asks that `sum` be `value`.
    pub(super) fn equal(&mut self, sum: Sum, value: f64) {
        self.equal.push((sum, value));
    }

    /// Asks that `sum` be no more than `value`.
    pub(super) fn at_most(&mut self, sum: Sum, value: f64) {
        self.at_most.push((sum, value));
    }

    /// Asks that neighbouring unknowns lie on lines: adds half of `weight` times the squares of second differences.
    pub(super) fn smooth(&mut self, unknowns: Range<usize>, weight: f64) {
        for middle in unknowns.start + 1..unknowns.end.saturating_sub(1) {
            let difference = [(middle - 1, 1.0), (middle, -2.0), (middle + 1, 1.0)];
            for (at, &(row, one)) in difference.iter().enumerate() {
                for &(column, two) in &difference[at..] {
                    self.quadratic.push((row, column, weight * one * two));
                }
            }
        }
    }

    /// The solution, where the solver finds one.
    pub(super) fn solve(&self) -> Option<Answer> {
        if self.unknowns == 0 {
            return Some(Answer { unknowns: Vec::new(), least: 0.0 });
        }
        let matrix = |rows: usize, entries: Vec<(usize, usize, f64)>| {
            let (mut at, mut across, mut values) = (Vec::new(), Vec::new(), Vec::new());
            for (row, column, value) in entries {
                at.push(row);
                across.push(column);
                values.push(value);
            }
            CscMatrix::new_from_triplets(rows, self.unknowns, at, across, values)
        };
        let constraints = || self.equal.iter().chain(&self.at_most);
        let entries = constraints()
            .enumerate()
            .flat_map(|(row, (sum, _))| sum.iter().map(move |&(unknown, factor)| (row, unknown, factor)));
        let values: Vec<f64> = constraints().map(|&(_, value)| value).collect();
        let cones = [ZeroConeT(self.equal.len()), NonnegativeConeT(self.at_most.len())];
        // Each step is refined until it could not be more exact by default, which takes half of the time.
        let settings = DefaultSettingsBuilder::default()
            .verbose(false)
            .max_threads(1)
            .iterative_refinement_reltol(1e-9)
            .iterative_refinement_abstol(1e-9)
            .build()
            .ok()?;
        let quadratic = matrix(self.unknowns, self.quadratic.clone());
        let linear = vec![0.0; self.unknowns];
        let constraints = matrix(values.len(), entries.collect());
        let mut solver = DefaultSolver::new(&quadratic, &linear, &constraints, &values, &cones, settings).ok()?;
        solver.solve();
        let solution = solver.solution;
        let solved = solution.status == SolverStatus::Solved;
        let usable = solved
            || matches!(
                solution.status,
                SolverStatus::AlmostSolved | SolverStatus::InsufficientProgress | SolverStatus::MaxIterations
            );
        let finite = solution.x.iter().all(|unknown| unknown.is_finite());
        (usable && finite).then(|| Answer {
            unknowns: solution.x,
            least: if solved { (2.0 * solution.obj_val_dual).max(0.0) } else { 0.0 },
        })
    }
}
