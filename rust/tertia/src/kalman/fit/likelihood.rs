//! The likelihood of a recording for the best common scale of noise and motion.

use super::recording::{Limit, Recording};
use crate::base::error::{Error, Result};
use crate::base::interrupt::poll;
use crate::kalman::batch::{Batch, End, Row, Table};
use crate::kalman::model::Singer;
use crate::kalman::steps::Steps;
use std::collections::HashMap;
use std::f64::consts::{E, PI};
use std::num::NonZero;

/// Grid of α: α times the length of the recording at the first point, α times an interval at the last
/// one, and the factor between points.
const ALPHA: [f64; 3] = [0.3, 10.0, 8.0];
/// Grid of p: p for the length of the recording at the first point, p for an interval at the last one,
/// and the factor between points.
const MOTION: [f64; 3] = [0.1, 30.0, 20.0];
/// Factors by which the climb may leave the grid downward and upward: α is tiny if the acceleration
/// grows throughout a recording.
const BEYOND: [f64; 2] = [1e4, 10.0];
/// ln of an α that counts as infinite: the likelihood differs from that of the limit by about 1e-6
/// there.
pub(super) const INFINITE_ALPHA: f64 = 13.815_510_557_964_274;
/// The same for p.
const INFINITE_MOTION: f64 = 16.118_095_650_958_32;
/// Step of differences: the likelihood is accurate to about 1e-12.
pub(super) const DIFFERENCE: f64 = 2e-3;
/// Innovations smaller than this share of the plots are rounding errors of the plots.
const ROUNDING: f64 = 1e-13;
/// Time per step of the filter, for the choice of the number of threads.
const STEP_NS: f64 = 20.0;
/// Range of a product of variances; outside, its logarithm is taken and the product starts again.
const PRODUCTS: std::ops::Range<f64> = 1e-150..1e150;

/// Sums over the innovations of a series.
#[derive(Clone, Copy, Debug)]
struct Sums {
    /// Sum of ν²/S, and the rounding error that it has lost.
    squares: f64,
    lost: f64,
    /// Sum of ln S, except for those S that are in the product.
    logarithms: f64,
    product: f64,
    count: usize,
}

impl Sums {
    const NONE: Self = Self { squares: 0.0, lost: 0.0, logarithms: 0.0, product: 1.0, count: 0 };

    fn of(innovation: &[f64], variance: &[f64]) -> Self {
        let mut sums = Self::NONE;
        for (&value, &variance) in innovation.iter().zip(variance) {
            if value.is_nan() {
                continue;
            }
            // Kahan's summation, because derivatives are differences of this sum
            let term = value * value / variance - sums.lost;
            let squares = sums.squares + term;
            sums.lost = (squares - sums.squares) - term;
            sums.squares = squares;
            sums.product *= variance;
            sums.count += 1;
            if !PRODUCTS.contains(&sums.product) {
                sums.logarithms += sums.product.ln();
                sums.product = 1.0;
            }
        }
        sums
    }
}

/// The likelihood as a function of `[x, y]`; each value is computed only once.
pub(super) struct Likelihood<'a> {
    recording: Recording<'a>,
    rows: Vec<Sums>,
    /// Buffers of the filter.
    innovation: Vec<f64>,
    variance: Vec<f64>,
    n_threads: Option<NonZero<usize>>,
    /// Length of the longest series, in intervals.
    length: f64,
    /// Sum of the noise σ and the motion p σ, before the best scale is applied.
    unit: f64,
    /// The time to which the motion p refers, in intervals.
    memory: f64,
    found: HashMap<[u64; 2], (f64, [f64; 3])>,
}

impl<'a> Likelihood<'a> {
    pub fn try_new(recording: &Recording<'a>, n_threads: Option<NonZero<usize>>) -> Result<Self> {
        let Recording { z, steps, dt, .. } = *recording;
        let count = z.len() / steps;
        let own = |row: usize| match dt.row(row) {
            [single] => single * (steps - 1) as f64,
            each => each.iter().sum(),
        };
        let mut likelihood = Self {
            recording: *recording,
            rows: vec![Sums::NONE; count],
            innovation: vec![0.0; z.len()],
            variance: vec![0.0; z.len()],
            n_threads,
            length: (0..count).map(own).fold(0.0, f64::max),
            unit: 1.0,
            memory: 1.0,
            found: HashMap::new(),
        };
        let (value, _) = likelihood.at([0.1_f64.ln(); 2])?;
        // in the unit of the recording itself, sums of squares are of the order of the number of plots
        likelihood.unit =
            likelihood.spread(value, "lies on straight lines; there is no noise to be fitted")?;
        likelihood.remember(1.0);
        Ok(likelihood)
    }

    /// Returns the typical standard deviation of innovations with this log likelihood, or an error with
    /// this reason if it is a rounding error.
    pub fn spread(&self, value: f64, reason: &'static str) -> Result<f64> {
        let spread = (-value / self.count() as f64 - 0.5 * (2.0 * PI * E).ln()).exp();
        let known = self.recording.z.iter().filter(|z| !z.is_nan());
        let largest = known.fold(0.0_f64, |largest, z| largest.max(z.abs()));
        let holds = spread > ROUNDING * largest;
        holds.then_some(spread).ok_or(Error::Undetermined { argument: "z", reason })
    }

    /// Returns the number of innovations.
    pub fn count(&self) -> usize {
        self.rows.iter().map(|row| row.count).sum()
    }

    pub fn length(&self) -> f64 {
        self.length
    }

    /// Returns ln L, and the logarithms of α, σ_a and σ.
    pub fn at(&mut self, [x, y]: [f64; 2]) -> Result<(f64, [f64; 3])> {
        let key = [x.to_bits(), y.to_bits()];
        if let Some(&known) = self.found.get(&key) {
            return Ok(known);
        }
        // noise and motion together are one unit
        let noise = self.unit.ln() - (y.max(0.0) + (-y.abs()).exp().ln_1p());
        let mut logs = [x, y + self.acceleration(x) + noise, noise];
        let (value, scale) = self.run(logs.map(f64::exp))?;
        logs[1] += 0.5 * scale;
        logs[2] += 0.5 * scale;
        self.found.insert(key, (value, logs));
        Ok((value, logs))
    }

    /// Returns ln L for the best scale of the variances, and the logarithm of this scale.
    fn run(&mut self, [alpha, acceleration_sigma, sigma]: [f64; 3]) -> Result<(f64, f64)> {
        poll();
        let model = Singer::try_new(alpha, acceleration_sigma, true)?;
        let Recording { z, steps, dt, period } = self.recording;
        let (variance, count) = ([sigma * sigma], self.rows.len());
        let plots = (z, steps, count);
        let batch = Batch::try_new(plots, Table::new(&variance, 1), dt, None, model, period)?;
        let innovations = self.innovation.chunks_exact_mut(steps);
        let mut rows: Vec<_> = innovations
            .zip(self.variance.chunks_exact_mut(steps))
            .map(|(innovation, variance)| {
                let (mean, covariance) = (&mut [][..], &mut [][..]);
                Row { steps: Steps { mean, covariance, innovation, variance }, end: End::NONE }
            })
            .collect();
        batch
            .filter(&mut rows, STEP_NS * z.len() as f64, self.n_threads)
            .map_err(|failure| failure.error)?;
        for (sums, row) in self.rows.iter_mut().zip(&rows) {
            *sums = Sums::of(row.steps.innovation, row.steps.variance);
        }
        let count = self.count() as f64;
        if count == 0.0 {
            let reason = "has no series of three plots; two of each are needed to start";
            return Err(Error::Undetermined { argument: "z", reason });
        }
        let squares: f64 = self.rows.iter().map(|row| row.squares).sum();
        let logarithms: f64 = self.rows.iter().map(|row| row.logarithms + row.product.ln()).sum();
        let scale = (squares / count).ln();
        Ok((-0.5 * (logarithms + count * ((2.0 * PI * E).ln() + scale)), scale))
    }

    /// Makes p refer to the motion added within this time.
    pub fn remember(&mut self, memory: f64) {
        self.memory = memory;
        self.found.clear();
    }

    /// Returns ln (σ_a / (p σ)).
    pub fn acceleration(&self, x: f64) -> f64 {
        // p² is σ_a² τ⁴ / σ² with the memory τ, multiplied by ατ for slow manoeuvres, by 1 / ατ for
        // fast ones; if manoeuvres are slower than the recording is long, σ_a itself is determined
        let (reach, once) = (x.exp() * self.memory, self.memory / self.length);
        reach.ln_1p() - 0.5 * (reach + once).ln() - 2.0 * self.memory.ln()
    }

    /// Returns the ln p that counts as infinite.
    pub fn infinite_motion(&self) -> f64 {
        INFINITE_MOTION + self.beyond()
    }

    fn beyond(&self) -> f64 {
        2.5 * self.memory.ln()
    }

    /// Returns the ends of the grid in x and y, each with the logarithm of the factor between points.
    pub fn grid(&self) -> [[f64; 3]; 2] {
        let [[low, high, factor], [least, most, ratio]] = [ALPHA, MOTION];
        let lowest = least.ln() - 2.5 * (self.length / self.memory).ln();
        [
            [(low / self.length).ln(), high.ln(), factor.ln()],
            [lowest, most.ln() + self.beyond(), ratio.ln()],
        ]
    }

    /// Returns the smallest and the largest coordinates of the climb.
    pub fn bounds(&self) -> [[f64; 2]; 2] {
        let ([[alpha, most, _], [motion, ..]], [below, above]) = (self.grid(), BEYOND.map(f64::ln));
        [[alpha - below, most + above], [motion - below, self.infinite_motion()]]
    }

    /// Returns the limits at which a point is.
    pub fn limits(&self, [x, y]: [f64; 2]) -> Vec<Limit> {
        let none = f64::NEG_INFINITY;
        let there = [
            (Limit::WhiteAcceleration, x == INFINITE_ALPHA),
            (Limit::ConstantAcceleration, x == none && y > none),
            (Limit::ConstantRate, y == none),
            (Limit::NoNoise, y == self.infinite_motion()),
        ];
        there.into_iter().filter(|&(_, holds)| holds).map(|(limit, _)| limit).collect()
    }
}
