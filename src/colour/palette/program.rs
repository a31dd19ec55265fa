//! Convex quadratic programs, solved by an interior-point method.

use std::ops::Range;

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus, ZeroConeT};

/// Linear combination: unknowns with factors.
pub(super) type Sum = Vec<(usize, f64)>;

/// Convex quadratic program: minimises half the sum of squared residuals under linear constraints.
#[derive(Debug, Default)]
pub(super) struct Program {
    unknowns: usize,
    /// Entries of the upper triangle of the quadratic form: row, column, value. Entries at equal positions add up.
    quadratic: Vec<(usize, usize, f64)>,
    equal: Vec<(Sum, f64)>,
    at_most: Vec<(Sum, f64)>,
    residuals: usize,
}

/// Solution of a [`Program`].
#[derive(Debug)]
pub(super) struct Answer {
    /// Values of the unknowns.
    pub(super) unknowns: Vec<f64>,
    /// Lower bound of the sum of squares under the constraints, from the dual problem; 0 unless the solver reached full
    /// accuracy.
    pub(super) least: f64,
}

impl Program {
    /// Adds `count` consecutive unknowns. Returns the index of the first.
    pub(super) fn unknowns(&mut self, count: usize) -> usize {
        let first = self.unknowns;
        self.unknowns += count;
        first
    }

    /// Adds the squared residual of `sum` from `value` to the objective.
    ///
    /// The residual is an unknown of its own: normal equations would cost a digit of accuracy.
    pub(super) fn near(&mut self, mut sum: Sum, value: f64) {
        let residual = self.unknowns(1);
        self.quadratic.push((residual, residual, 1.0));
        sum.push((residual, -1.0));
        self.equal(sum, value);
        self.residuals += 1;
    }

    /// Adds the constraint `sum` = `value`.
    pub(super) fn equal(&mut self, sum: Sum, value: f64) {
        self.equal.push((sum, value));
    }

    /// Adds the constraint `sum` ≤ `value`.
    pub(super) fn at_most(&mut self, sum: Sum, value: f64) {
        self.at_most.push((sum, value));
    }

    /// Adds half of `weight` times the squared second differences of neighbouring unknowns to the objective.
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

    /// Solves the program; `None` if the solver finds no usable solution.
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
        // By default, the solver refines each step to the limit of f64, which takes half of the time.
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
