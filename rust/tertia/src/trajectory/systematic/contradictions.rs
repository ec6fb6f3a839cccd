//! Contradictions between stations in blocks of instants, and the filter of lasting errors.

use crate::trajectory::instants::instant::Instant;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use pulp::Arch;

/// Information, relative to the largest possible one of the column, from which a direction is determined.
const DETERMINED: f64 = 1e-9;
/// Square of a contradiction over its noise from which it is certainly seen.
const SURE: f64 = 10.0;
/// Number of measurements that the stated noise is worth, if the observed noise is smaller.
const STATED: f64 = 8.0;

/// Contradictions of blocks of instants: rows of `y = h (c + g) + e` with e of variance 1.
pub(in crate::trajectory) struct Blocks {
    size: usize,
    pub time: Vec<f64>,
    rows: Vec<Vec<f64>>,
    /// Number of independent contradictions.
    pub count: usize,
}

/// How drifts change: abruptly, as from stop to stop, or smoothly, as with the direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::trajectory) enum Kernel {
    /// Gauss–Markov: `exp(−x)` of the time over the correlation time.
    Markov,
    /// Matérn of order 3/2: `(1 + x) exp(−x)` of √3 times the time over the correlation time.
    Smooth,
}

/// Variances of constants and drifts, and correlation times, for each column.
#[derive(Clone, Debug)]
pub(in crate::trajectory) struct Point {
    pub constant: Vec<f64>,
    pub drift: Vec<f64>,
    pub time: Vec<f64>,
    pub kernel: Kernel,
    /// Column whose error is far larger than the others, if there is one.
    pub alone: Option<usize>,
}

impl Kernel {
    /// Variance of the mean of a drift over this number of correlation times, relative to the variance of the
    /// drift.
    pub fn averaged(self, times: f64) -> f64 {
        match self {
            _ if times < 1e-3 => 1.0,
            Self::Markov => 2.0 / times * (1.0 + (-times).exp_m1() / times),
            Self::Smooth => {
                let x = 3_f64.sqrt() * times;
                2.0 / (x * x) * (2.0 * x - 3.0 + (x + 3.0) * (-x).exp())
            }
        }
    }

    /// Returns the number of components of a drift, scaled to equal variances, and their transition over this
    /// number of correlation times.
    fn transition(self, times: f64) -> (usize, [[f64; 2]; 2]) {
        match self {
            Self::Markov => (1, [[(-times).exp(), 0.0], [0.0, 0.0]]),
            Self::Smooth => {
                let x = 3_f64.sqrt() * times;
                let rest = (-x).exp();
                (2, [[(1.0 + x) * rest, x * rest], [-x * rest, (1.0 - x) * rest]])
            }
        }
    }
}

/// Information of the blocks about the constants, given the drifts and whatever the prior of the constants:
/// `ln p(y)` is that of normal variables with the information A, the scores b and the squares of y.
pub(in crate::trajectory) struct Sums {
    squares: f64,
    log_determinant: f64,
    information: DMatrix<f64>,
    scores: DVector<f64>,
}

impl Point {
    /// Whether there are no lasting errors.
    pub fn is_nothing(&self) -> bool {
        self.constant.iter().chain(&self.drift).all(|v| *v == 0.0)
    }

    /// Whether the drifts are the same as those of another point.
    pub fn drifts_as(&self, other: &Self) -> bool {
        let is_none = self.drift.iter().all(|v| *v == 0.0);
        let is_same = self.time == other.time && self.kernel == other.kernel;
        self.drift == other.drift && (is_none || is_same)
    }
}

/// Filter of the drifts, which runs for a value of 1 of each constant and for the measurements at once.
struct Drifts<'a> {
    point: &'a Point,
    /// Columns that drift.
    columns: Vec<usize>,
    /// Number of components of the state; the drifts come first.
    n: usize,
    /// States, one for each constant and the last for the measurements: all of their first components, then
    /// the second ones, so that vectors of the processor hold several states.
    x: Vec<f64>,
    p: Vec<f64>,
    gain: Vec<f64>,
}

impl<'a> Drifts<'a> {
    fn new(point: &'a Point) -> Self {
        let columns: Vec<usize> =
            (0..point.drift.len()).filter(|i| point.drift[*i] > 0.0).collect();
        let n = columns.len() * point.kernel.transition(0.0).0;
        let mut p = vec![0.0; n * n];
        for i in 0..n {
            p[i * n + i] = point.drift[columns[i % columns.len()]];
        }
        let x = vec![0.0; n * (point.drift.len() + 1)];
        Self { point, columns, n, x, p, gain: vec![0.0; n] }
    }

    /// Predicts the state over a time step.
    #[inline(always)]
    fn advance(&mut self, step: f64) {
        let n = self.n;
        let states = self.point.drift.len() + 1;
        for (i, &column) in self.columns.iter().enumerate() {
            let (size, f) = self.point.kernel.transition(step / self.point.time[column]);
            let at: [usize; 2] = [i, if size == 2 { self.columns.len() + i } else { i }];
            let apply = |v: [f64; 2], a: usize| f[a][0] * v[0] + f[a][1] * v[1];
            for (rows, width) in [(&mut self.p, n), (&mut self.x, states)] {
                for j in 0..width {
                    let old = at.map(|at| rows[at * width + j]);
                    for a in 0..size {
                        rows[at[a] * width + j] = apply(old, a);
                    }
                }
            }
            for row in self.p.chunks_exact_mut(n) {
                let old = at.map(|at| row[at]);
                for a in 0..size {
                    row[at[a]] = apply(old, a);
                }
            }
            for a in 0..size {
                for b in 0..size {
                    let unit = f64::from(u8::from(a == b));
                    let kept = f[a][0] * f[b][0] + f[a][1] * f[b][1];
                    self.p[at[a] * n + at[b]] += self.point.drift[column] * (unit - kept);
                }
            }
        }
    }

    /// Updates the states with a row, fills in its innovations, and returns the variance of the innovations.
    #[inline(always)]
    fn step(&mut self, row: &[f64], innovation: &mut [f64]) -> f64 {
        let (n, states) = (self.n, innovation.len());
        innovation.copy_from_slice(row);
        if n == 0 {
            return 1.0;
        }
        self.gain.fill(0.0);
        let rows = self.p.chunks_exact(n).zip(self.x.chunks_exact(states));
        for (&column, (p, x)) in self.columns.iter().zip(rows) {
            add(&mut self.gain, row[column], p);
            add(innovation, -row[column], x);
        }
        let along = self.columns.iter().zip(&self.gain).map(|(column, gain)| row[*column] * gain);
        let s = 1.0 + along.sum::<f64>();
        let rows = self.p.chunks_exact_mut(n).zip(self.x.chunks_exact_mut(states));
        for (gain, (p, x)) in self.gain.iter().zip(rows) {
            add(p, -gain / s, &self.gain);
            add(x, gain / s, innovation);
        }
        s
    }
}

/// Adds a multiple of a vector.
#[inline(always)]
fn add(sum: &mut [f64], factor: f64, vector: &[f64]) {
    sum.iter_mut().zip(vector).for_each(|(sum, v)| *sum += factor * v);
}

impl Sums {
    /// Returns the terms of the log-likelihood for constants of these variances, without the growth of the
    /// noise: the sum of the squared innovations, and ln of their determinant.
    fn innovations(&self, constant: &[f64]) -> Option<(f64, f64)> {
        let (factor, right) = self.factored(constant)?;
        let mut gained = right;
        factor.l_dirty().solve_lower_triangular_mut(&mut gained);
        let log_determinant = factor.l_dirty().diagonal().iter().map(|v| v.ln()).sum::<f64>();
        Some((self.squares - gained.norm_squared(), self.log_determinant + 2.0 * log_determinant))
    }

    /// Returns the factor of `I + R A R` and the vector `R b`, with the standard deviations R of the
    /// constants.
    fn factored(&self, constant: &[f64]) -> Option<(Cholesky<f64, Dyn>, DVector<f64>)> {
        let root = |i: usize| constant[i].sqrt();
        let right = DVector::from_fn(constant.len(), |i, _| root(i) * self.scores[i]);
        let mut whole = self.information.clone();
        for i in 0..constant.len() {
            whole.row_mut(i).scale_mut(root(i));
            whole.column_mut(i).scale_mut(root(i));
            whole[(i, i)] += 1.0;
        }
        Some((Cholesky::new(whole)?, right))
    }

    /// Returns the mean and the covariance of constants of these prior variances. O(P³).
    pub fn constants(&self, constant: &[f64]) -> (DVector<f64>, DMatrix<f64>) {
        let size = constant.len();
        let root = |i: usize| constant[i].sqrt();
        let Some((factor, right)) = self.factored(constant) else {
            return (
                DVector::zeros(size),
                DMatrix::from_diagonal(&DVector::from_row_slice(constant)),
            );
        };
        let mean = factor.solve(&right);
        let inverse = factor.inverse();
        (
            DVector::from_fn(size, |i, _| root(i) * mean[i]),
            DMatrix::from_fn(size, size, |i, j| root(i) * inverse[(i, j)] * root(j)),
        )
    }
}

impl Blocks {
    /// Collects the contradictions of blocks of `length` instants. `before` was removed from the
    /// measurements; `taper` holds the factors by which weights change the slope and the standard deviation
    /// of the scores.
    pub fn new<const D: usize>(
        time: &[f64],
        instants: &[Instant<D>],
        before: &DVector<f64>,
        length: usize,
        taper: (f64, f64),
    ) -> Self {
        let size = before.len();
        let mut blocks = Self { size, time: Vec::new(), rows: Vec::new(), count: 0 };
        for (own, times) in instants.chunks(length).zip(time.chunks(length)) {
            let (mut information, mut scores) = (DMatrix::zeros(size, size), DVector::zeros(size));
            let mut largest = vec![0.0; size];
            for instant in own {
                instant.add_information(|i| instant.rows[i].1, &mut information);
                add(&mut largest, 1.0, &instant.largest);
                for (kept, (_, w, r, ..)) in instant.kept.chunks_exact(size).zip(&instant.rows) {
                    for a in 0..size {
                        scores[a] += kept[a] * w * r;
                    }
                }
            }
            scores += &information * before * taper.0;
            let rows = factored(information, scores, &largest, taper);
            blocks.count += rows.len() / (size + 1);
            blocks.rows.push(rows);
            blocks.time.push(times.iter().sum::<f64>() / times.len() as f64);
        }
        blocks
    }

    /// Filters the drifts, for all constants at once. Cost: O(P²) for each row of a block.
    pub fn sums(&self, point: &Point) -> Sums {
        Arch::new().dispatch(|| self.filtered(point))
    }

    #[inline(always)]
    fn filtered(&self, point: &Point) -> Sums {
        let c = self.size;
        let mut drifts = Drifts::new(point);
        let (mut information, mut scores) = (DMatrix::zeros(c, c), DVector::zeros(c));
        let (mut squares, mut log_determinant) = (0.0, 0.0);
        let mut innovation = vec![0.0; c + 1];
        for (k, rows) in self.rows.iter().enumerate() {
            if k > 0 && drifts.n > 0 {
                drifts.advance(self.time[k] - self.time[k - 1]);
            }
            for row in rows.chunks_exact(c + 1) {
                let s = drifts.step(row, &mut innovation);
                let (h, y) = (&innovation[..c], innovation[c]);
                for a in 0..c {
                    scores[a] += h[a] * y / s;
                    add(&mut information.as_mut_slice()[a * c + a..(a + 1) * c], h[a] / s, &h[a..]);
                }
                squares += y * y / s;
                log_determinant += s.ln();
            }
        }
        information.fill_upper_triangle_with_lower_triangle();
        Sums { squares, log_determinant, information, scores }
    }

    /// Number of independent ways in which constants of these standard deviations certainly cause
    /// contradictions.
    pub fn ways(&self, sigma: &[f64]) -> usize {
        let mut information = DMatrix::<f64>::zeros(self.size, self.size);
        for row in self.rows.iter().flat_map(|rows| rows.chunks_exact(self.size + 1)) {
            let h = DVector::from_fn(self.size, |i, _| row[i] * sigma[i]);
            information += &h * h.transpose();
        }
        information.symmetric_eigenvalues().iter().filter(|v| **v > SURE).count()
    }

    /// Returns the error of a column, as it seems if the others are right, relative to what noise and constant
    /// errors of these standard deviations of all columns would let it seem: the largest one over parts of the
    /// record of this duration.
    pub fn excess(&self, column: usize, sigma: &[f64], duration: f64) -> f64 {
        let (mut most, mut start) = (0.0_f64, 0);
        while start < self.rows.len() {
            let own = |time: &f64| time - self.time[start] < duration;
            let end = start + self.time[start..].partition_point(own).max(1);
            let (mut score, mut information) = (0.0, vec![0.0; self.size]);
            for row in self.rows[start..end].iter().flat_map(|own| own.chunks_exact(self.size + 1))
            {
                score += row[column] * row[self.size];
                add(&mut information, row[column], &row[..self.size]);
            }
            let lasting = information.iter().zip(sigma).map(|(own, sigma)| (own * sigma).powi(2));
            let expected = information[column] + lasting.sum::<f64>();
            if expected > 0.0 {
                most = most.max(score.abs() / expected.sqrt());
            }
            start = end;
        }
        most
    }

    /// Returns ln of the likelihood with the likeliest growth of the noise, and this growth. A growth below 1
    /// is moved towards 1: lasting errors also show if the noise is smaller than stated.
    pub fn likelihood(&self, sums: &Sums, constant: &[f64]) -> Option<(f64, f64)> {
        let count = self.count as f64;
        let (squares, log_determinant) = sums.innovations(constant)?;
        let growth = if squares > count {
            squares / count.max(1.0)
        } else {
            (squares + STATED) / (count + STATED)
        };
        let sum = log_determinant + count * growth.ln() + squares / growth;
        Some((-0.5 * sum, growth))
    }
}

/// Returns rows `y = h u + e` with this information and these scores, by a Cholesky factor with pivots.
/// Pivots far below the largest possible information are rounding errors. Columns have different units: each
/// pivot is compared with the largest information of its own column.
fn factored(
    information: DMatrix<f64>,
    scores: DVector<f64>,
    largest: &[f64],
    taper: (f64, f64),
) -> Vec<f64> {
    let size = scores.len();
    let (mut matrix, mut right) = (information, scores);
    let (slope, root) = taper;
    let mut rows = Vec::new();
    for _ in 0..size {
        let share = |i: usize| if largest[i] > 0.0 { matrix[(i, i)] / largest[i] } else { 0.0 };
        let Some(pivot) = (0..size).max_by(|a, b| share(*a).total_cmp(&share(*b))) else { break };
        let value = matrix[(pivot, pivot)];
        if value.is_nan() || share(pivot) <= DETERMINED {
            break;
        }
        let h = matrix.column(pivot) / value.sqrt();
        let y = right[pivot] / value.sqrt();
        rows.extend(h.iter().map(|v| v * slope / root));
        rows.push(y / root);
        matrix -= &h * h.transpose();
        right -= h * y;
        matrix[(pivot, pivot)] = 0.0;
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compares the filter with the normal density of all numbers at once.
    #[test]
    fn the_filter_is_the_joint_density() {
        let rows = vec![vec![1.0, -0.5, 0.3], vec![0.4, 2.0, -1.2], vec![-1.5, 0.7, 2.1]];
        let blocks = Blocks { size: 2, time: vec![0.0, 1.0, 3.5], rows: rows.clone(), count: 3 };
        for kernel in [Kernel::Markov, Kernel::Smooth] {
            for drift in [[0.5, 2.0], [0.0, 2.0], [0.0, 0.0]] {
                check(&blocks, &rows, kernel, drift.to_vec());
            }
        }
    }

    fn check(blocks: &Blocks, rows: &[Vec<f64>], kernel: Kernel, drift: Vec<f64>) {
        let constant = vec![0.8, 1.3];
        let point = Point { constant, drift, time: vec![2.0, 7.0], kernel, alone: None };
        let covariance = DMatrix::from_fn(3, 3, |a, b| {
            let own = |i: usize| {
                let times = (blocks.time[a] - blocks.time[b]).abs() / point.time[i];
                let x = 3_f64.sqrt() * times;
                let rest = match kernel {
                    Kernel::Markov => (-times).exp(),
                    Kernel::Smooth => (1.0 + x) * (-x).exp(),
                };
                rows[a][i] * rows[b][i] * (point.constant[i] + point.drift[i] * rest)
            };
            own(0) + own(1) + f64::from(u8::from(a == b))
        });
        let y = DVector::from_fn(3, |a, _| rows[a][2]);
        let cross = DMatrix::from_fn(2, 3, |i, a| point.constant[i] * rows[a][i]);
        let inverse = covariance.clone().try_inverse().unwrap();
        let sums = blocks.sums(&point);
        let (squares, log_determinant) = sums.innovations(&point.constant).unwrap();
        assert!((squares - (y.transpose() * &inverse * &y)[0]).abs() < 1e-12);
        assert!((log_determinant - covariance.determinant().ln()).abs() < 1e-12);
        let (found, known) = sums.constants(&point.constant);
        let mean = &cross * &inverse * y;
        let prior = DMatrix::from_diagonal(&DVector::from_vec(point.constant.clone()));
        let rest = prior - &cross * inverse * cross.transpose();
        for i in 0..2 {
            assert!((found[i] - mean[i]).abs() < 1e-12);
            assert!((known[(i, i)] - rest[(i, i)]).abs() < 1e-12);
        }
    }

    /// Compares averages with sums over many points.
    #[test]
    fn averages_of_drifts() {
        let count = 2000;
        for (kernel, times) in [(Kernel::Markov, 1.7), (Kernel::Smooth, 0.6), (Kernel::Smooth, 5.0)]
        {
            let mut sum = 0.0;
            for i in 0..count {
                let x = times * (i as f64 + 0.5) / count as f64;
                let f = kernel.transition(x).1;
                sum += 2.0 * (1.0 - x / times) * f[0][0] / count as f64;
            }
            assert!((kernel.averaged(times) - sum).abs() < 1e-6);
        }
    }

    /// Rows of a singular information must reproduce the information and the scores.
    #[test]
    fn factors_of_singular_information() {
        let design = DMatrix::from_row_slice(2, 3, &[1.0, -1.0, 0.5, 0.0, 2.0, -2.0]);
        let y = DVector::from_vec(vec![0.7, -0.4]);
        let information = design.transpose() * &design;
        let scores = design.transpose() * y;
        let rows = factored(information.clone(), scores.clone(), &[1.0; 3], (1.0, 1.0));
        assert_eq!(rows.len(), 8);
        let h = DMatrix::from_fn(2, 3, |i, j| rows[i * 4 + j]);
        let right = DVector::from_fn(2, |i, _| rows[i * 4 + 3]);
        assert!((h.transpose() * &h - information).amax() < 1e-12);
        assert!((h.transpose() * right - scores).amax() < 1e-12);
    }

    /// Of equal errors, none exceeds what they let each other seem; a larger one does, if only for a while.
    #[test]
    fn an_error_exceeds_the_stated_sizes() {
        let kept = DMatrix::identity(4, 4) - DMatrix::from_element(4, 4, 0.25);
        let blocks = |error: &dyn Fn(usize) -> [f64; 4]| {
            let rows = |t: usize| -> Vec<f64> {
                let y = &kept * DVector::from_row_slice(&error(t)) * 30.0;
                (0..4)
                    .flat_map(|i| {
                        (0..4).map(|j| 30.0 * kept[(i, j)]).chain([y[i]]).collect::<Vec<_>>()
                    })
                    .collect()
            };
            let time = (0..8).map(f64::from).collect();
            Blocks { size: 4, time, rows: (0..8).map(rows).collect(), count: 24 }
        };
        let usual = blocks(&|_| [1.5, -1.5, 0.5, -0.5]);
        let whole = f64::INFINITY;
        assert!((0..4).all(|column| usual.excess(column, &[1.0; 4], whole) < 2.0));
        let wrong = blocks(&|_| [6.0, 0.0, 0.0, 0.0]);
        assert!((wrong.excess(0, &[1.0; 4], whole) - 6.0 * 0.75_f64.sqrt()).abs() < 0.1);
        let last = blocks(&|t| if t < 7 { [0.0; 4] } else { [20.0, 0.0, 0.0, 0.0] });
        assert!(last.excess(0, &[1.0; 4], whole) < 2.5 && last.excess(0, &[1.0; 4], 2.0) > 5.0);
    }

    /// Columns in other units, such as metres beside radians, have the same rows in these units.
    #[test]
    fn factors_do_not_depend_on_units() {
        let design =
            DMatrix::from_row_slice(3, 3, &[1.0, -1.0, 0.5, 0.0, 2.0, -2.0, 1.0, 0.3, 0.4]);
        let unit = [1.0, 1e6, 1e-6];
        let other = DMatrix::from_fn(3, 3, |i, j| design[(i, j)] * unit[j]);
        let of = |design: &DMatrix<f64>| {
            let information = design.transpose() * design;
            let largest: Vec<f64> = information.diagonal().iter().copied().collect();
            let scores = design.transpose() * DVector::from_vec(vec![0.7, -0.4, 0.2]);
            factored(information, scores, &largest, (1.0, 1.0))
        };
        let (own, scaled) = (of(&design), of(&other));
        assert_eq!((own.len(), scaled.len()), (12, 12));
        for (at, (own, scaled)) in own.iter().zip(&scaled).enumerate() {
            let unit = unit.get(at % 4).unwrap_or(&1.0);
            assert!((scaled / unit - own).abs() < 1e-9);
        }
    }
}
