//! Contradictions between the stations, in blocks of instants, and the filter of lasting errors.

use super::instant::Instant;
use nalgebra::{DMatrix, DVector};

/// Share of its information from which a direction is determined.
const DETERMINED: f64 = 1e-9;
/// Square of a contradiction over its noise from which it is seen surely.
const SURE: f64 = 10.0;
/// Numbers that the stated noise is worth, where it is larger than what is seen.
const STATED: f64 = 8.0;

/// Contradictions of blocks of instants: rows of `y = h (c + g) + e` with e of variance 1.
pub(super) struct Blocks {
    size: usize,
    pub time: Vec<f64>,
    rows: Vec<Vec<f64>>,
    /// Numbers that contradict.
    pub count: usize,
}

/// How drifts change: in jumps, as from stop to stop, or smoothly, as with the direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Kernel {
    /// Gauss–Markov, `exp(−x)` of the time over the correlation time.
    Markov,
    /// Matérn's of order 3/2, `(1 + x) exp(−x)` of √3 times it.
    Smooth,
}

/// Variances of constants and drifts, and correlation times.
pub(super) struct Point {
    pub constant: Vec<f64>,
    pub drift: Vec<f64>,
    pub time: Vec<f64>,
    pub kernel: Kernel,
    /// The one that is far larger than the others, if one is.
    pub alone: Option<usize>,
}

impl Kernel {
    /// Variance of the mean of a drift over so many correlation times, over its own.
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

    /// Numbers of a drift, with variances alike, and what they are after so many correlation times.
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

/// What is known of the constants.
pub(super) struct Filtered {
    squares: f64,
    log_determinant: f64,
    pub mean: Vec<f64>,
    pub covariance: DMatrix<f64>,
}

impl Point {
    /// Whether nothing lasts.
    pub fn is_nothing(&self) -> bool {
        self.constant.iter().chain(&self.drift).all(|v| *v == 0.0)
    }

    /// What is known of the drifts after a time.
    fn advance(&self, step: f64, x: &mut [f64], p: &mut [f64]) {
        let (n, c) = (x.len(), self.drift.len());
        for i in 0..c {
            let (size, f) = self.kernel.transition(step / self.time[i]);
            let at: [usize; 2] = [c + i, if size == 2 { 2 * c + i } else { c + i }];
            let apply = |v: [f64; 2], a: usize| f[a][0] * v[0] + f[a][1] * v[1];
            let old = at.map(|at| x[at]);
            let mut rows = Vec::with_capacity(size * n);
            for a in 0..size {
                x[at[a]] = apply(old, a);
                rows.extend((0..n).map(|j| apply(at.map(|at| p[at * n + j]), a)));
            }
            for (a, row) in rows.chunks_exact(n).enumerate() {
                p[at[a] * n..(at[a] + 1) * n].copy_from_slice(row);
            }
            for row in p.chunks_exact_mut(n) {
                let old = at.map(|at| row[at]);
                for a in 0..size {
                    row[at[a]] = apply(old, a);
                }
            }
            for a in 0..size {
                for b in 0..size {
                    let unit = f64::from(u8::from(a == b));
                    let kept = f[a][0] * f[b][0] + f[a][1] * f[b][1];
                    p[at[a] * n + at[b]] += self.drift[i] * (unit - kept);
                }
            }
        }
    }
}

impl Blocks {
    /// `before` was removed from the measurements; `taper` is what weights make of the slope and
    /// the standard deviation of the scores.
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
            let mut weight = 0.0;
            for instant in own {
                instant.add_information(|i| instant.rows[i].1, &mut information);
                for (kept, (_, w, r, _)) in instant.kept.chunks_exact(size).zip(&instant.rows) {
                    weight += w;
                    for a in 0..size {
                        scores[a] += kept[a] * w * r;
                    }
                }
            }
            scores += &information * before * taper.0;
            let rows = factored(information, scores, weight / size as f64, taper);
            blocks.count += rows.len() / (size + 1);
            blocks.rows.push(rows);
            blocks.time.push(times.iter().sum::<f64>() / times.len() as f64);
        }
        blocks
    }

    /// The filter of constants and drifts. Cost: of a block O(P²) for each of its rows.
    pub fn filter(&self, point: &Point) -> Filtered {
        let c = self.size;
        let drifts = point.drift.iter().any(|v| *v > 0.0);
        let n = match point.kernel {
            _ if !drifts => c,
            Kernel::Markov => 2 * c,
            Kernel::Smooth => 3 * c,
        };
        let (mut x, mut p) = (vec![0.0; n], vec![0.0; n * n]);
        for i in 0..n {
            p[i * n + i] = if i < c { point.constant[i] } else { point.drift[i % c] };
        }
        let (mut squares, mut log_determinant) = (0.0, 0.0);
        let mut g = vec![0.0; n];
        for (k, rows) in self.rows.iter().enumerate() {
            if k > 0 && drifts {
                point.advance(self.time[k] - self.time[k - 1], &mut x, &mut p);
            }
            for row in rows.chunks_exact(c + 1) {
                let (h, y) = (&row[..c], row[c]);
                // constants and drifts, not the rates of drifts
                let along =
                    |v: &[f64]| v.chunks_exact(c).take(2).map(|part| dot(h, part)).sum::<f64>();
                for (g, row) in g.iter_mut().zip(p.chunks_exact(n)) {
                    *g = along(row);
                }
                let s = 1.0 + along(&g);
                let innovation = y - along(&x);
                for i in 0..n {
                    let gain = g[i] / s;
                    x[i] += gain * innovation;
                    for j in 0..n {
                        p[i * n + j] -= gain * g[j];
                    }
                }
                squares += innovation * innovation / s;
                log_determinant += s.ln();
            }
        }
        let covariance = DMatrix::from_fn(c, c, |i, j| 0.5 * (p[i * n + j] + p[j * n + i]));
        x.truncate(c);
        Filtered { squares, log_determinant, mean: x, covariance }
    }

    /// In how many independent ways constants of these standard deviations contradict surely.
    pub fn ways(&self, sigma: &[f64]) -> usize {
        let mut information = DMatrix::<f64>::zeros(self.size, self.size);
        for row in self.rows.iter().flat_map(|rows| rows.chunks_exact(self.size + 1)) {
            let h = DVector::from_fn(self.size, |i, _| row[i] * sigma[i]);
            information += &h * h.transpose();
        }
        information.symmetric_eigenvalues().iter().filter(|v| **v > SURE).count()
    }

    /// ln of the likelihood with the growth of the noise that is likeliest, and that. Below 1 it is
    /// shrunk: errors that last also show where noise is smaller than stated.
    pub fn likelihood(&self, filtered: &Filtered) -> (f64, f64) {
        let count = self.count as f64;
        let growth = if filtered.squares > count {
            filtered.squares / count.max(1.0)
        } else {
            (filtered.squares + STATED) / (count + STATED)
        };
        let sum = filtered.log_determinant + count * growth.ln() + filtered.squares / growth;
        (-0.5 * sum, growth)
    }
}

/// `y = h u + e` of information and scores, by a Cholesky factor with pivots. What is far below the
/// largest information that there could be is rounding.
fn factored(
    information: DMatrix<f64>,
    scores: DVector<f64>,
    largest: f64,
    taper: (f64, f64),
) -> Vec<f64> {
    let size = scores.len();
    let (mut matrix, mut right) = (information, scores);
    let (slope, root) = taper;
    let mut rows = Vec::new();
    for _ in 0..size {
        let pivot = matrix.diagonal().imax();
        let value = matrix[(pivot, pivot)];
        if value.is_nan() || value <= DETERMINED * largest {
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

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The filter against the normal density of all numbers at once.
    #[test]
    fn the_filter_is_the_joint_density() {
        let rows = vec![vec![1.0, -0.5, 0.3], vec![0.4, 2.0, -1.2], vec![-1.5, 0.7, 2.1]];
        let blocks = Blocks { size: 2, time: vec![0.0, 1.0, 3.5], rows: rows.clone(), count: 3 };
        for kernel in [Kernel::Markov, Kernel::Smooth] {
            check(&blocks, &rows, kernel);
        }
    }

    fn check(blocks: &Blocks, rows: &[Vec<f64>], kernel: Kernel) {
        let (constant, drift) = (vec![0.8, 1.3], vec![0.5, 2.0]);
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
        let filtered = blocks.filter(&point);
        assert!((filtered.squares - (y.transpose() * &inverse * &y)[0]).abs() < 1e-12);
        assert!((filtered.log_determinant - covariance.determinant().ln()).abs() < 1e-12);
        let mean = &cross * &inverse * y;
        let prior = DMatrix::from_diagonal(&DVector::from_vec(point.constant.clone()));
        let rest = prior - &cross * inverse * cross.transpose();
        for i in 0..2 {
            assert!((filtered.mean[i] - mean[i]).abs() < 1e-12);
            assert!((filtered.covariance[(i, i)] - rest[(i, i)]).abs() < 1e-12);
        }
    }

    /// Against sums over many points.
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

    /// Rows of a singular information have its information and its scores.
    #[test]
    fn factors_of_singular_information() {
        let design = DMatrix::from_row_slice(2, 3, &[1.0, -1.0, 0.5, 0.0, 2.0, -2.0]);
        let y = DVector::from_vec(vec![0.7, -0.4]);
        let information = design.transpose() * &design;
        let scores = design.transpose() * y;
        let rows = factored(information.clone(), scores.clone(), 1.0, (1.0, 1.0));
        assert_eq!(rows.len(), 8);
        let h = DMatrix::from_fn(2, 3, |i, j| rows[i * 4 + j]);
        let right = DVector::from_fn(2, |i, _| rows[i * 4 + 3]);
        assert!((h.transpose() * &h - information).amax() < 1e-12);
        assert!((h.transpose() * right - scores).amax() < 1e-12);
    }
}
