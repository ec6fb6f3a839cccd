//! Damping of steps that are too long for their derivatives (Levenberg 1944, Marquardt 1963).
//!
//! Derivatives hold near the path. The distance of a target from close stations follows from times of arrival
//! by the curvature of its wave fronts: if the path is more than twice as far, steps without damping end beyond
//! the stations, and the next ones farther still. Where the measurements of an instant would fit much worse than
//! their derivatives promise, its position is tied to the path with a multiple of the information about the
//! path. The gradient is not changed, and so neither is the path to which the steps lead.

use super::fit::{Found, Setting};
use crate::base::small::{Factor, Matrix, Vector, dot, quadratic};
use crate::sensors::Kind;
use crate::smoothing::ProcessNoise;
use crate::trajectory::measured::{Place, Record};
use crate::trajectory::path::failure::Failure;
use crate::trajectory::path::{Path, Plots};

/// A step is too long if the cost of an instant exceeds the one that its derivatives promise by more than this
/// amount and this share of the cost before.
const WORSE: f64 = 10.0;
const SHARE: f64 = 0.5;
/// First information of the tie, relative to that about the path, its growth, and the largest number of trials.
const FIRST: f64 = 1.0;
const GROWTH: f64 = 8.0;
const TRIALS: usize = 8;

impl<const D: usize, const N: usize> Found<D, N> {
    /// Returns the plots and the path of a step from the present path, with ties where the step without them is
    /// too long, and whether there are any. Only times of arrival need them.
    pub(in crate::trajectory) fn damped(
        &self,
        setting: &mut Setting<'_, D, N>,
        motion: Option<ProcessNoise>,
        scale: f64,
        (mut plots, mut path): (Plots, Path),
    ) -> Result<(Plots, Path, bool), Failure> {
        let record = setting.record;
        let mut ties: Vec<f64> = Vec::new();
        if !self.measured.is_timed {
            return Ok((plots, path, false));
        }
        for _ in 0..TRIALS {
            let far = (0..record.len()).filter(|&t| self.is_too_far(record, t, scale, &path));
            let far: Vec<usize> = far.collect();
            if far.is_empty() {
                break;
            }
            ties.resize(record.len(), 0.0);
            for t in far {
                ties[t] = (GROWTH * ties[t]).max(FIRST);
                if let Some((spread, step)) = self.tied_step(record, t, scale, ties[t]) {
                    plots.put(t, self.path.position::<D>(t), &step, &spread);
                }
            }
            path = setting.smoothed(&plots, motion, Some(path.fit.motion))?;
        }
        Ok((plots, path, !ties.is_empty()))
    }

    /// Whether the measurements of an instant fit a new path much worse than their derivatives promise.
    fn is_too_far(&self, record: &Record<'_>, t: usize, scale: f64, path: &Path) -> bool {
        let own = Place::<D>::at(self.path.position::<D>(t)).position;
        let new = Place::<D>::at(path.position::<D>(t)).position;
        let beside = self.sides.as_ref().map_or(new, |sides| sides.beside(t, &new));
        let after = self.cost(record, t, &beside) / (scale * scale);
        // what follows takes more time, and is seldom necessary
        if after.is_nan() || after <= WORSE {
            return false;
        }
        let before = self.cost(record, t, &own) / (scale * scale);
        let most = WORSE + SHARE * before;
        if before.is_nan() || after <= most {
            return false;
        }
        let step: Vector<D> = std::array::from_fn(|i| new[i] - own[i]);
        let (normal, right) = self.information(record, t);
        let fall = (dot(&right, &step) - 0.5 * quadratic(&normal, &step)) / (scale * scale);
        after - (before - fall) > most
    }

    /// Returns the covariance of an instant's position that is tied to the path, and the step to it.
    fn tied_step(
        &self,
        record: &Record<'_>,
        t: usize,
        scale: f64,
        tie: f64,
    ) -> Option<(Matrix<D>, Vector<D>)> {
        let own = &self.path.covariance[t * D * D..][..D * D];
        let spread: Matrix<D> = std::array::from_fn(|i| std::array::from_fn(|j| own[i * D + j]));
        let known = Factor::try_new(&spread, 0.0)?.inverse();
        let (mut normal, right) = self.information(record, t);
        let unit = (scale * scale).recip();
        for i in 0..D {
            for j in 0..D {
                normal[i][j] = unit * normal[i][j] + tie * known[i][j];
            }
            normal[i][i] += unit * self.anchor[t];
        }
        let factor = Factor::try_new(&normal, 0.0)?;
        Some((factor.inverse(), factor.solve(&right.map(|v| unit * v))))
    }

    /// Half the weighted sum of the squared residuals of an instant at a position, less what the emission
    /// explains.
    fn cost(&self, record: &Record<'_>, t: usize, position: &Vector<D>) -> f64 {
        let width = record.width();
        let rows = || {
            self.measured.rows(t, Place::at(position)).map(|(m, row)| {
                let weight = self.trust[t * width + self.measured.column[m]];
                (self.measured.one(m), weight, row.residual)
            })
        };
        let (mut count, mut total, mut mean) = (0, 0.0, 0.0);
        for (one, weight, residual) in rows().filter(|(one, ..)| one.kind == Kind::Arrival) {
            count += usize::from(weight > 0.0);
            total += weight * one.precision * one.precision;
            mean += weight * one.precision * residual;
        }
        mean /= total;
        let mut sum = 0.0;
        for (one, weight, mut residual) in rows().filter(|(_, weight, _)| *weight > 0.0) {
            match one.kind {
                Kind::Arrival if count < 2 => continue,
                Kind::Arrival => residual -= mean * one.precision,
                _ => {}
            }
            sum += weight * residual * residual;
        }
        0.5 * sum
    }
}
