//! Least squares over the last plots, fewer of them after a manoeuvre was detected
//! (Glagovskii, Lavina, Rudelson 2014).

use super::estimate::{Estimate, Plane};
use super::motion;
use nalgebra::SMatrix;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Distances squared that are summed, and hits that are counted.
const REMEMBERED: usize = 3;
/// So many hits in a row on the same side are a manoeuvre.
const SIDE_HITS: i32 = 4;

/// Lengths of the history, and what is a manoeuvre.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct WindowRule {
    /// Plots in straight flight.
    pub long: usize,
    /// Plots after a manoeuvre was detected.
    pub short: usize,
    /// Distance squared of the inner gate.
    pub inner: f64,
    /// That of the outer gate.
    pub outer: f64,
    /// That of the guard gate.
    pub guard: f64,
    /// Sum of three distances squared that is a manoeuvre.
    pub sum: f64,
}

/// The last plots, and the line through them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Window {
    /// Seconds before now, position, noise.
    plots: VecDeque<(f64, [f64; 2], Plane)>,
    line: Estimate<4>,
    /// Added to what the line says of its own errors, until the next plot.
    distances: VecDeque<f64>,
    /// Hits in a row on the left (positive) or on the right.
    side: i32,
    /// Plots used.
    length: usize,
    short: bool,
}

impl Window {
    pub fn new(start: Estimate<4>) -> Self {
        Self {
            plots: VecDeque::new(),
            line: start,
            distances: VecDeque::new(),
            side: 0,
            length: 0,
            short: false,
        }
    }

    pub fn is_short(&self) -> bool {
        self.short
    }

    pub fn estimate(&self) -> Estimate<4> {
        self.line
    }

    pub fn predict(&mut self, t: f64) {
        motion::coast(&mut self.line, t);
        self.plots.iter_mut().for_each(|plot| plot.0 += t);
    }

    pub fn widen(&mut self, extra: &SMatrix<f64, 4, 4>) {
        self.line.covariance += extra;
        self.short = true;
    }

    /// Adds a plot and draws the line anew.
    pub fn correct(&mut self, rule: &WindowRule, z: [f64; 2], r: Plane) {
        let manoeuvre = self.detects(rule, z, r);
        self.plots.push_back((0.0, z, r));
        if manoeuvre || self.short && self.length < rule.short {
            self.short = true;
        }
        if manoeuvre {
            self.length = rule.short;
            self.distances.clear();
            self.side = 0;
        } else {
            self.length = (self.length + 1).min(rule.long);
            self.short &= self.length <= 2 * rule.short;
        }
        while self.plots.len() > self.length {
            self.plots.pop_front();
        }
        match fitted(self.plots.make_contiguous()) {
            Some(line) => self.line = line,
            None => {
                self.line.correct(z, r);
            }
        }
    }

    /// Whether this plot, with those before it, says that the target manoeuvres.
    fn detects(&mut self, rule: &WindowRule, z: [f64; 2], r: Plane) -> bool {
        let s = self.line.position_covariance().plus(r);
        let y = [z[0] - self.line.mean[0], z[1] - self.line.mean[1]];
        let distance = s.inverse().form(y);
        self.distances.push_back(distance);
        while self.distances.len() > REMEMBERED {
            self.distances.pop_front();
        }
        let [vx, vy] = [self.line.mean[2], self.line.mean[3]];
        let (ahead, left) = (vx * y[0] + vy * y[1], vx * y[1] - vy * y[0]);
        self.side = match (distance > rule.inner && left.abs() > ahead.abs(), left > 0.0) {
            (true, true) => self.side.max(0) + 1,
            (true, false) => self.side.min(0) - 1,
            (false, _) => 0,
        };
        let beyond = self.distances.iter().filter(|&&d| d > rule.outer).count();
        let full = self.distances.len() == REMEMBERED;
        distance > rule.guard
            || beyond >= 2
            || full && self.distances.iter().sum::<f64>() > rule.sum
            || self.side.abs() >= SIDE_HITS
    }
}

/// The line of least squares through the plots, for now; none of less than two.
fn fitted(plots: &[(f64, [f64; 2], Plane)]) -> Option<Estimate<4>> {
    if plots.len() < 2 {
        return None;
    }
    let mut normal = SMatrix::<f64, 4, 4>::zeros();
    let mut right = nalgebra::SVector::<f64, 4>::zeros();
    let origin = plots[plots.len() - 1].1;
    for &(age, z, r) in plots {
        let w = r.inverse();
        let weight = [[w.xx, w.xy], [w.xy, w.yy]];
        for i in 0..2 {
            for j in 0..2 {
                normal[(i, j)] += weight[i][j];
                normal[(i, j + 2)] -= age * weight[i][j];
                normal[(i + 2, j)] -= age * weight[i][j];
                normal[(i + 2, j + 2)] += age * age * weight[i][j];
                let value = weight[i][j] * (z[j] - origin[j]);
                right[i] += value;
                right[i + 2] -= age * value;
            }
        }
    }
    let inverse = normal.cholesky()?.inverse();
    let covariance = 0.5 * (inverse + inverse.transpose());
    let mut mean = covariance * right;
    mean[0] += origin[0];
    mean[1] += origin[1];
    Some(Estimate { mean, covariance })
}
