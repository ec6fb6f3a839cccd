//! A track as a registrar follows it: where it is, which radars see it, and what their errors add to
//! its covariance.

use super::sighting::{ERRORS, Errors, Sighting};
use crate::base::small::Factor;
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

/// Halves of what the noise adds to a covariance that are tried.
const HALVINGS: usize = 8;

/// By each error of one radar, in units of the prior: position and velocity, or the errors of another.
type Part = [[f64; 4]; ERRORS];

/// A track after its last row.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Followed {
    /// Of the last row, and of the last plot of the confirmed track.
    pub row_time: f64,
    pub time: f64,
    pub position: [f64; 2],
    pub velocity: [f64; 2],
    /// The radars that have seen it, when last, and what their errors do to it.
    pub parts: Vec<(usize, f64, Part)>,
    /// What the noise of plots that stands for unknown errors adds to its covariance.
    excess: [[f64; 4]; 4],
    /// Variance of the noise over that which stands for errors too, at least.
    share: f64,
}

/// Covariance of the errors of radars, `K` by `K` blocks; zero for errors that there are not.
pub(super) struct Blocks {
    radars: usize,
    blocks: Vec<Part>,
}

impl Blocks {
    /// Of a covariance whose columns are the errors `columns[radar][error]`.
    pub fn new(covariance: &DMatrix<f64>, columns: &[[Option<usize>; ERRORS]]) -> Self {
        let radars = columns.len();
        let of = |row: Option<usize>, column: Option<usize>| match (row, column) {
            (Some(row), Some(column)) => covariance[(row, column)],
            _ => 0.0,
        };
        let block = |n: usize| {
            let (rows, columns) = (columns[n / radars], columns[n % radars]);
            rows.map(|row| columns.map(|column| of(row, column)))
        };
        Self { radars, blocks: (0..radars * radars).map(block).collect() }
    }

    /// Of the errors of a radar and those of another.
    fn of(&self, k: usize, other: usize) -> &Part {
        &self.blocks[k * self.radars + other]
    }
}

/// Noise with and without what is not known of the errors, where a tracker has used this: more is noise
/// that it has found.
pub(super) fn use_noise(applied: &mut [[[f64; 2]; 2]], used: &[[f64; 2]]) {
    for ([wide, own], used) in applied.iter_mut().zip(used) {
        for axis in 0..2 {
            if used[axis] > wide[axis] {
                (wide[axis], own[axis]) = (used[axis], used[axis]);
            }
        }
    }
}

impl Followed {
    /// A track that begins with a row.
    pub fn new(time: f64) -> Self {
        let never = f64::NEG_INFINITY;
        let (position, velocity, parts) = ([0.0; 2], [0.0; 2], Vec::new());
        let (excess, share) = ([[0.0; 4]; 4], 1.0);
        Self { row_time: time, time: never, position, velocity, parts, excess, share }
    }

    /// Its first row: a track that is confirmed comes from plots of this radar or others that are much
    /// the same.
    pub fn begin(
        &mut self,
        seen: &Sighting,
        [sigma, own]: [[f64; 2]; 2],
        (covariance, is_confirmed): (&[f64; 16], bool),
        velocity: [f64; 2],
        unknowns: &[Option<(usize, f64)>; ERRORS],
    ) {
        let all = [[1.0, 0.0], [0.0, 1.0], [0.0; 2], [0.0; 2]];
        self.update(seen.radar, &all, &displaced(seen, velocity, unknowns));
        let [u, v] = seen.axes;
        let wider = [0, 1].map(|axis| 1.0 - (own[axis] / sigma[axis]).powi(2));
        self.share = 1.0 - wider[0].max(wider[1]);
        let root = wider.map(|share| share.max(0.0).sqrt());
        let weight: [[f64; 2]; 2] = std::array::from_fn(|i| {
            std::array::from_fn(|j| root[0] * u[i] * u[j] + root[1] * v[i] * v[j])
        });
        // the velocity of a first plot is any
        let known = if is_confirmed { 4 } else { 2 };
        for i in 0..known {
            for j in 0..known {
                let (a, b) = (i / 2, j / 2);
                self.excess[i][j] = (0..4)
                    .map(|n| {
                        let (k, l) = (n / 2, n % 2);
                        weight[i % 2][k]
                            * covariance[4 * (2 * a + k) + 2 * b + l]
                            * weight[l][j % 2]
                    })
                    .sum();
            }
        }
    }

    /// When a radar has seen it.
    pub fn seen_by(&self, radar: usize) -> f64 {
        let own = self.parts.iter().find(|(k, ..)| *k == radar);
        own.map_or(f64::NEG_INFINITY, |(_, time, _)| *time)
    }

    /// A plot of a confirmed track.
    pub fn see(&mut self, time: f64, radar: usize, position: [f64; 2], velocity: [f64; 2]) {
        (self.time, self.position, self.velocity) = (time, position, velocity);
        self.part(radar).1 = time;
    }

    /// Moves on to the time of a row.
    pub fn advance(&mut self, time: f64) {
        let ahead = (time - self.row_time).max(0.0);
        for (_, _, part) in &mut self.parts {
            for [east, north, east_rate, north_rate] in part {
                *east += ahead * *east_rate;
                *north += ahead * *north_rate;
            }
        }
        for _ in 0..2 {
            for i in 0..2 {
                let rate = self.excess[2 + i];
                for (place, rate) in self.excess[i].iter_mut().zip(rate) {
                    *place += ahead * rate;
                }
            }
            self.excess = turned(&self.excess);
        }
        self.row_time = time;
    }

    /// A plot has updated the track, whose covariance (row by row) and velocity are these now. The
    /// radar may have such errors; `sigma` is the noise with which the gain was made, and `own` that
    /// of the plot.
    pub fn correct(
        &mut self,
        seen: &Sighting,
        [sigma, own]: [[f64; 2]; 2],
        covariance: &[f64; 16],
        velocity: [f64; 2],
        unknowns: &[Option<(usize, f64)>; ERRORS],
    ) {
        let ([u, v], weights) = (seen.axes, sigma.map(|sigma| 1.0 / (sigma * sigma)));
        let weight = |i: usize, j: usize| weights[0] * u[i] * u[j] + weights[1] * v[i] * v[j];
        let (east, both, north) = (weight(0, 0), weight(0, 1), weight(1, 1));
        let mut gain: [[f64; 2]; 4] = std::array::from_fn(|i| {
            let [a, b] = [covariance[4 * i], covariance[4 * i + 1]];
            [a * east + b * both, a * both + b * north]
        });
        // that of a filter of several models is of no one gain; a track goes to a plot at most
        let middle = 0.5 * (gain[0][0] + gain[1][1]);
        let determinant = gain[0][0] * gain[1][1] - gain[0][1] * gain[1][0];
        let most = middle + (middle * middle - determinant).max(0.0).sqrt();
        if most > 1.0 {
            gain = gain.map(|row| row.map(|value| value / most));
        }
        for (own, sigma) in own.into_iter().zip(sigma) {
            self.share = self.share.min((own / sigma).powi(2));
        }
        let wider = [0, 1].map(|axis| sigma[axis] * sigma[axis] - own[axis] * own[axis]);
        self.exceed(&gain, |i, j| wider[0] * u[i] * u[j] + wider[1] * v[i] * v[j]);
        let own = displaced(seen, velocity, unknowns);
        self.update(seen.radar, &gain, &own);
    }

    /// A plot of a radar, that a unit of each of its errors moves by `own`, updates the track with
    /// `gain`.
    pub fn update(&mut self, radar: usize, gain: &[[f64; 2]; 4], own: &[[f64; 2]; ERRORS]) {
        self.part(radar);
        for (k, _, part) in &mut self.parts {
            for (row, own) in part.iter_mut().zip(own) {
                let mut moved = [-row[0], -row[1]];
                if *k == radar {
                    moved[0] += own[0];
                    moved[1] += own[1];
                }
                for (value, gain) in row.iter_mut().zip(gain) {
                    *value += gain[0] * moved[0] + gain[1] * moved[1];
                }
            }
        }
    }

    /// A plot whose noise is taken to be larger than it is updates the track with `gain`.
    fn exceed(&mut self, gain: &[[f64; 2]; 4], wider: impl Fn(usize, usize) -> f64) {
        for _ in 0..2 {
            let [east, north, ..] = self.excess;
            for (row, gain) in self.excess.iter_mut().zip(gain) {
                for (j, value) in row.iter_mut().enumerate() {
                    *value -= gain[0] * east[j] + gain[1] * north[j];
                }
            }
            self.excess = turned(&self.excess);
        }
        for (i, row) in self.excess.iter_mut().enumerate() {
            for (j, value) in row.iter_mut().enumerate() {
                for a in 0..2 {
                    for b in 0..2 {
                        *value += gain[i][a] * wider(a, b) * gain[j][b];
                    }
                }
            }
        }
    }

    /// Leaves of the covariance of a row (row by row) at least half the share that the noise itself has: a
    /// filter of several models has no one gain, so that more may seem to be in excess.
    pub fn limit(&mut self, covariance: &[f64; 16]) {
        let most = 1.0 - 0.5 * self.share;
        for _ in 0..HALVINGS {
            let left: [[f64; 4]; 4] = std::array::from_fn(|i| {
                std::array::from_fn(|j| most * covariance[4 * i + j] - self.excess[i][j])
            });
            if Factor::try_new(&left, 0.0).is_some() {
                return;
            }
            self.excess = self.excess.map(|row| row.map(|value| 0.5 * value));
        }
        self.excess = [[0.0; 4]; 4];
    }

    /// What the errors add to its covariance, row by row: what they do to the track, without the noise
    /// that stood for them in the filter. Cost O(R²) for R radars that see it.
    pub fn added(&self, errors: &Blocks) -> [f64; 16] {
        let mut sum = [[0.0; 4]; 4];
        for (n, (k, _, part)) in self.parts.iter().enumerate() {
            // half of the diagonal block, and the whole of those above it
            let mut product = plus([[0.0; 4]; ERRORS], errors.of(*k, *k), part);
            product.as_flattened_mut().iter_mut().for_each(|value| *value *= 0.5);
            for (other, _, second) in &self.parts[n + 1..] {
                product = plus(product, errors.of(*k, *other), second);
            }
            sum = plus(sum, &turned(part), &product);
        }
        std::array::from_fn(|n| {
            let (i, j) = (n / 4, n % 4);
            sum[i][j] + sum[j][i] - 0.5 * (self.excess[i][j] + self.excess[j][i])
        })
    }

    /// By how much it moves when the errors of the radars are found to be larger by this, in units of
    /// the prior.
    pub fn moved(&self, by: &[Errors]) -> [f64; 4] {
        let mut sum = [0.0; 4];
        for (k, _, part) in &self.parts {
            for (row, by) in part.iter().zip(by[*k]) {
                for (sum, own) in sum.iter_mut().zip(row) {
                    *sum -= own * by;
                }
            }
        }
        sum
    }

    fn part(&mut self, radar: usize) -> &mut (usize, f64, Part) {
        let at = self.parts.iter().position(|(k, ..)| *k == radar);
        let at = at.unwrap_or_else(|| {
            self.parts.push((radar, f64::NEG_INFINITY, [[0.0; 4]; ERRORS]));
            self.parts.len() - 1
        });
        &mut self.parts[at]
    }
}

fn turned(matrix: &[[f64; 4]; 4]) -> [[f64; 4]; 4] {
    std::array::from_fn(|i| std::array::from_fn(|j| matrix[j][i]))
}

/// By how much a unit of each error moves a plot.
fn displaced(
    seen: &Sighting,
    velocity: [f64; 2],
    unknowns: &[Option<(usize, f64)>; ERRORS],
) -> [[f64; 2]; ERRORS] {
    let [u, v] = seen.axes;
    let [along, across] = seen.design(velocity.into());
    std::array::from_fn(|j| {
        let sigma = unknowns[j].map_or(0.0, |(_, sigma)| sigma);
        [0, 1].map(|side| sigma * (u[side] * along[j] + v[side] * across[j]))
    })
}

/// `sum + a b`
#[inline]
fn plus(mut sum: Part, a: &Part, b: &Part) -> Part {
    for i in 0..4 {
        for k in 0..4 {
            for j in 0..4 {
                sum[i][j] += a[i][k] * b[k][j];
            }
        }
    }
    sum
}

#[cfg(test)]
mod tests;
