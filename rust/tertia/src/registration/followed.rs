//! A track as a registrar follows it: where it is, which radars see it, and what their errors add to
//! its covariance.

use super::sighting::{ERRORS, Sighting};
use nalgebra::{DMatrix, Matrix2, Matrix4, Vector2};
use serde::{Deserialize, Serialize};

/// Position and velocity by the errors of one radar, in units of the prior.
type Part = [[f64; ERRORS]; 4];

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
}

impl Followed {
    /// A track that begins with a row.
    pub fn new(time: f64) -> Self {
        let never = f64::NEG_INFINITY;
        let (position, velocity, parts) = ([0.0; 2], [0.0; 2], Vec::new());
        Self { row_time: time, time: never, position, velocity, parts }
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
        for (_, _, [east, north, east_rate, north_rate]) in &mut self.parts {
            for (place, rate) in [(east, east_rate), (north, north_rate)] {
                for (place, rate) in place.iter_mut().zip(rate) {
                    *place += ahead * *rate;
                }
            }
        }
        self.row_time = time;
    }

    /// A plot has updated the track, whose covariance (row by row) and velocity are these now. The
    /// radar may have such errors; `seen` has the noise with which the gain was made.
    pub fn correct(
        &mut self,
        seen: &Sighting,
        covariance: &[f64; 16],
        velocity: [f64; 2],
        unknowns: &[Option<(usize, f64)>; ERRORS],
    ) {
        let axes = Matrix2::from_columns(&seen.axes);
        let weights = Matrix2::from_diagonal(&seen.sigma.map(|sigma| sigma.powi(-2)).into());
        let covariance = Matrix4::from_row_slice(covariance);
        let gain = covariance.fixed_columns::<2>(0) * axes * weights * axes.transpose();
        let gain = std::array::from_fn(|i| [gain[(i, 0)], gain[(i, 1)]]);
        let design = seen.design(velocity.into());
        let mut own = [[0.0; ERRORS]; 2];
        for (j, unknown) in unknowns.iter().enumerate() {
            if let Some((_, sigma)) = *unknown {
                let moved = axes * Vector2::new(design[0][j], design[1][j]) * sigma;
                (own[0][j], own[1][j]) = (moved[0], moved[1]);
            }
        }
        self.update(seen.radar, &gain, &own);
    }

    /// A plot of a radar, that a unit of its errors moves by `own`, updates the track with `gain`.
    pub fn update(&mut self, radar: usize, gain: &[[f64; 2]; 4], own: &[[f64; ERRORS]; 2]) {
        self.part(radar);
        for (k, _, part) in &mut self.parts {
            for j in 0..ERRORS {
                let mut moved = [-part[0][j], -part[1][j]];
                if *k == radar {
                    moved[0] += own[0][j];
                    moved[1] += own[1][j];
                }
                for (row, gain) in part.iter_mut().zip(gain) {
                    row[j] += gain[0] * moved[0] + gain[1] * moved[1];
                }
            }
        }
    }

    /// What the errors add to its covariance, row by row. Cost O(R²) for R radars that see it.
    pub fn added(&self, errors: &Blocks) -> [f64; 16] {
        let mut sum = [[0.0; 4]; 4];
        for (k, _, part) in &self.parts {
            let mut product = [[0.0; ERRORS]; 4];
            for (other, _, second) in &self.parts {
                add_product(&mut product, second, &errors.blocks[other * errors.radars + k]);
            }
            for i in 0..4 {
                for j in 0..4 {
                    sum[i][j] += dot(&product[i], &part[j]);
                }
            }
        }
        std::array::from_fn(|n| 0.5 * (sum[n / 4][n % 4] + sum[n % 4][n / 4]))
    }

    fn part(&mut self, radar: usize) -> &mut (usize, f64, Part) {
        let at = self.parts.iter().position(|(k, ..)| *k == radar);
        let at = at.unwrap_or_else(|| {
            self.parts.push((radar, f64::NEG_INFINITY, [[0.0; ERRORS]; 4]));
            self.parts.len() - 1
        });
        &mut self.parts[at]
    }
}

/// Adds `a b`.
#[inline]
fn add_product(sum: &mut Part, a: &Part, b: &Part) {
    for i in 0..4 {
        for l in 0..ERRORS {
            for j in 0..ERRORS {
                sum[i][j] += a[i][l] * b[l][j];
            }
        }
    }
}

#[inline]
fn dot(a: &[f64; ERRORS], b: &[f64; ERRORS]) -> f64 {
    (a[0] * b[0] + a[1] * b[1]) + (a[2] * b[2] + a[3] * b[3])
}
