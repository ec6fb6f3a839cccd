//! A track as a registrar follows it: its position, the radars that see it, and the effect of their errors on
//! its covariance.

use super::block::Unknown;
use super::effect::{Blocks, Effect, Part};
use super::sighting::{AZIMUTH, Errors, KINDS, Sighting, azimuth_of};
use super::unaffected::{self, Gain, Settled, restrain};
use crate::base::plane::Plane;
use serde::{Deserialize, Serialize};

/// Largest number of times that the excess of a covariance is halved.
const HALVINGS: usize = 8;

/// Least share of a variance that remains after elimination of the components before it, in a regular matrix.
const REGULAR: f64 = 1e-12;

/// Largest gain of the velocity, times the time between plots: filters of one model hardly exceed it, and
/// twice as much is the limit of stability.
const STEADY: f64 = 1.0;

/// A track after its last row.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Followed {
    /// Time of the last row, and of the last plot of the confirmed track.
    pub row_time: f64,
    pub time: f64,
    pub position: [f64; 2],
    pub velocity: [f64; 2],
    /// Radars that have seen the track, and the effects of their errors on it.
    pub parts: Vec<Effect>,
    /// Part of the covariance that is due to the additional noise of plots that stands for unknown errors.
    excess: [[f64; 4]; 4],
    /// Smallest ratio, over all plots, of the variance of the noise alone to the variance that includes the
    /// part that stands for unknown errors.
    share: f64,
}

/// Raises the noise with the uncertainty of the errors to the noise that a tracker has used, and the noise
/// without it to the noise that the tracker has found: a tracker notices errors that last from scan to scan,
/// of which a block shows only a part.
pub(super) fn use_noise(applied: &mut [[[f64; 2]; 2]], used: &[[[f64; 2]; 2]]) {
    for ([wide, own], [used, found]) in applied.iter_mut().zip(used) {
        for axis in 0..2 {
            wide[axis] = wide[axis].max(used[axis]);
            own[axis] = own[axis].max(found[axis]).min(wide[axis]);
        }
    }
}

impl Followed {
    /// A track that starts at the time of a row.
    pub fn new(time: f64) -> Self {
        let never = f64::NEG_INFINITY;
        // most tracks of false plots are seen by one radar
        let (position, velocity, parts) = ([0.0; 2], [0.0; 2], Vec::with_capacity(1));
        let (excess, share) = ([[0.0; 4]; 4], 1.0);
        Self { row_time: time, time: never, position, velocity, parts, excess, share }
    }

    /// Becomes a track that starts at the time of a row.
    pub fn restart(&mut self, time: f64) {
        let mut parts = std::mem::take(&mut self.parts);
        parts.clear();
        *self = Self { parts, ..Self::new(time) };
    }

    /// Follows the first row. If the track is already confirmed, its earlier plots are taken to be of this
    /// radar or of similar ones.
    pub fn begin(
        &mut self,
        seen: &Sighting,
        [sigma, own]: [[f64; 2]; 2],
        (covariance, is_confirmed): (&[f64; 16], bool),
        velocity: [f64; 2],
        unknowns: &Unknown,
    ) {
        let all = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]];
        self.update(seen, &all, &displaced(seen, velocity, unknowns));
        let [u, v] = seen.axes;
        let wider = [0, 1].map(|axis| 1.0 - (own[axis] / sigma[axis]).powi(2));
        self.share = 1.0 - wider[0].max(wider[1]);
        let root = wider.map(|share| share.max(0.0).sqrt());
        let weight: [[f64; 2]; 2] = std::array::from_fn(|i| {
            std::array::from_fn(|j| root[0] * u[i] * u[j] + root[1] * v[i] * v[j])
        });
        // the velocity of a track with a single plot does not depend on that plot
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

    /// Sums numbers from all parts of the track, so that it is loaded into the cache.
    #[inline(always)]
    pub fn touched(&self) -> f64 {
        let touched = |own: &Effect| own.time + own.part[1][2] + own.part[3][2];
        let parts: f64 = self.parts.iter().map(touched).sum();
        self.row_time + self.position[0] + self.excess[0][3] + self.excess[3][3] + parts
    }

    /// Whether the track was confirmed when a radar saw it.
    pub fn was_confirmed(&self) -> bool {
        self.time > f64::NEG_INFINITY
    }

    /// Time of the last plot of a radar.
    pub fn seen_by(&self, radar: usize) -> f64 {
        let own = self.parts.iter().find(|own| own.radar == radar);
        own.map_or(f64::NEG_INFINITY, |own| own.time)
    }

    /// Notes a plot of the confirmed track, and the state of the track after it.
    pub fn see(&mut self, time: f64, radar: usize, position: [f64; 2], velocity: [f64; 2]) {
        (self.time, self.position, self.velocity) = (time, position, velocity);
        self.of(radar).time = time;
    }

    /// Advances the track to the time of a row.
    #[inline(always)]
    pub fn advance(&mut self, time: f64) {
        let ahead = (time - self.row_time).max(0.0);
        for Effect { part, .. } in &mut self.parts {
            for [east, north, east_rate, north_rate] in part {
                *east += ahead * *east_rate;
                *north += ahead * *north_rate;
            }
        }
        let excess = &mut self.excess;
        for i in 0..2 {
            for j in 0..2 {
                let (both, rates) = (excess[i][2 + j] + excess[j][2 + i], excess[2 + i][2 + j]);
                excess[i][j] += ahead * (both + ahead * rates);
            }
        }
        for i in 0..2 {
            for j in 0..2 {
                excess[i][2 + j] += ahead * excess[2 + i][2 + j];
                excess[2 + j][i] = excess[i][2 + j];
            }
        }
        self.row_time = time;
    }

    /// Updates the effects of the errors after a plot and, if there is one, a velocity with the noise
    /// `reported` have updated the track. `covariance` (row by row) and `velocity` are those of the track
    /// after both; `noise` is the noise with which the gain was computed and that of the plot alone;
    /// `unknowns` are the errors that the radar may have; `interval` is the time between plots.
    #[inline(always)]
    pub fn correct(
        &mut self,
        seen: &Sighting,
        noise: [[f64; 2]; 2],
        (covariance, reported): (&[f64; 16], Option<Plane>),
        velocity: [f64; 2],
        unknowns: &Unknown,
        interval: f64,
    ) {
        let Some(moving) = reported else {
            return self.place(seen, noise, covariance, velocity, unknowns, interval);
        };
        let before = unaffected::before(covariance, moving);
        self.place(seen, noise, &before, velocity, unknowns, interval);
        self.settle(&Settled::by_velocity(covariance, moving));
    }

    /// Reduces the effects of the errors after a measurement that they do not affect has updated the track.
    #[cold]
    pub fn settle(&mut self, by: &Settled) {
        for row in self.parts.iter_mut().flat_map(|own| &mut own.part) {
            *row = by.left(*row);
        }
        // (1 − K H) E (1 − K H)'
        for _ in 0..2 {
            let rows = self.excess.map(|row| by.left(row));
            self.excess = std::array::from_fn(|i| std::array::from_fn(|j| rows[j][i]));
        }
    }

    #[inline(always)]
    fn place(
        &mut self,
        seen: &Sighting,
        [sigma, own]: [[f64; 2]; 2],
        covariance: &[f64; 16],
        velocity: [f64; 2],
        unknowns: &Unknown,
        interval: f64,
    ) {
        let [u, v] = seen.axes;
        let (a, b) = (1.0 / (sigma[0] * sigma[0]), 1.0 / (sigma[1] * sigma[1]));
        let weight = |i: usize, j: usize| a * u[i] * u[j] + b * v[i] * v[j];
        let (east, both, north) = (weight(0, 0), weight(0, 1), weight(1, 1));
        let mut gain: Gain = [[0.0; 4]; 2];
        for i in 0..4 {
            let (a, b) = (covariance[i], covariance[4 + i]);
            gain[0][i] = a * east + b * both;
            gain[1][i] = a * both + b * north;
        }
        if seen.is_late {
            across(&mut gain, velocity);
        }
        // a plot moves a track no farther than to the plot itself
        restrain(&mut gain, 0, 1.0);
        // the first plots determine the velocity
        if self.was_confirmed() {
            steady(&mut gain, interval);
        }
        for axis in 0..2 {
            let share = own[axis] / sigma[axis];
            self.share = self.share.min(share * share);
        }
        let [a, b] = [sigma[0] * sigma[0] - own[0] * own[0], sigma[1] * sigma[1] - own[1] * own[1]];
        let wide = |i: usize, j: usize| a * u[i] * u[j] + b * v[i] * v[j];
        self.exceed(&gain, [wide(0, 0), wide(0, 1), wide(1, 1)]);
        let own = displaced(seen, velocity, unknowns);
        self.update(seen, &gain, &own);
    }

    /// Updates the effects of the errors after a plot was used with this gain. A unit of each error of its radar
    /// moves the plot by `own`.
    #[inline(always)]
    pub fn update(&mut self, plot: &Sighting, [east, north]: &Gain, own: &[[f64; 2]; KINDS]) {
        self.of(plot.radar).direction = plot.axes[0].into();
        for Effect { radar, part, .. } in &mut self.parts {
            let seen = if *radar == plot.radar { own } else { &[[0.0; 2]; KINDS] };
            for j in 0..KINDS {
                let row = &mut part[j];
                let (a, b) = (seen[j][0] - row[0], seen[j][1] - row[1]);
                for i in 0..4 {
                    row[i] += east[i] * a + north[i] * b;
                }
            }
        }
    }

    /// Updates the excess after a plot was used with this gain. The assumed covariance of the plot exceeds
    /// that of its noise by these elements: east-east, east-north and north-north.
    #[inline(always)]
    fn exceed(&mut self, gain: &Gain, [xx, xy, yy]: [f64; 3]) {
        let [east, north] = gain;
        let [a, b, ..] = self.excess;
        let (xx, xy, yy) = (a[0] + xx, a[1] + xy, b[1] + yy);
        for i in 0..4 {
            let along = east[i] * xx + north[i] * xy - a[i];
            let across = east[i] * xy + north[i] * yy - b[i];
            let row = &mut self.excess[i];
            for j in 0..4 {
                let before = east[i] * a[j] + north[i] * b[j];
                row[j] += along * east[j] + across * north[j] - before;
            }
        }
    }

    /// Halves the excess until it is less than `1 − share / 2` of the covariance of a row (row by row), so
    /// that at least half the share of the noise itself remains: a filter with several models has no single
    /// gain, so the excess may be overestimated.
    #[inline(always)]
    pub fn limit(&mut self, covariance: &[f64; 16]) {
        let most = 1.0 - 0.5 * self.share;
        for _ in 0..HALVINGS {
            let mut left = [[0.0; 4]; 4];
            for i in 0..4 {
                for j in 0..4 {
                    left[i][j] = most * covariance[4 * i + j] - self.excess[i][j];
                }
            }
            if is_regular(left) {
                return;
            }
            self.excess.as_flattened_mut().iter_mut().for_each(|value| *value *= 0.5);
        }
        self.excess = [[0.0; 4]; 4];
    }

    /// Returns the change of the covariance by the errors, row by row: the covariance that the errors cause,
    /// less the excess that stood for them in the filter. Cost O(R²) for R radars that see the track.
    #[inline(always)]
    pub fn added(&self, errors: &Blocks) -> [f64; 16] {
        let mut sum = [[0.0; 4]; 4];
        for (n, own) in self.parts.iter().enumerate() {
            // half of the diagonal block, and the whole of those above it
            let mut product = with_product([[0.0; 4]; KINDS], &errors.of(own, own), &own.part);
            product.as_flattened_mut().iter_mut().for_each(|value| *value *= 0.5);
            for other in &self.parts[n + 1..] {
                product = with_product(product, &errors.of(own, other), &other.part);
            }
            let [a, b, c, d] = own.part;
            let column = |i: usize| [a[i], b[i], c[i], d[i]];
            sum = with_product(sum, &[column(0), column(1), column(2), column(3)], &product);
        }
        let mut added = [0.0; 16];
        for i in 0..4 {
            for j in 0..4 {
                let excess = 0.5 * (self.excess[i][j] + self.excess[j][i]);
                added[4 * i + j] = sum[i][j] + sum[j][i] - excess;
            }
        }
        added
    }

    /// Returns by how much the track moves if the errors of the radars increase by these values, in units of
    /// the prior; deviations in those of the azimuth.
    #[inline(always)]
    pub fn moved(&self, by: &[Errors]) -> [f64; 4] {
        let mut sum = [0.0; 4];
        for Effect { radar, direction, part, .. } in &self.parts {
            let mut by = by[*radar];
            by[AZIMUTH] = azimuth_of(&by, *direction);
            for (row, by) in part.iter().zip(by) {
                for i in 0..4 {
                    sum[i] -= row[i] * by;
                }
            }
        }
        sum
    }

    fn of(&mut self, radar: usize) -> &mut Effect {
        let at = self.parts.iter().position(|own| own.radar == radar);
        let at = at.unwrap_or_else(|| {
            self.parts.push(Effect::new(radar));
            self.parts.len() - 1
        });
        &mut self.parts[at]
    }
}

/// Limits the gain of the velocity so that the effects of the errors fade from plot to plot: a filter with
/// several models has no single gain, so the gain may be overestimated, and the effects would grow without
/// limit.
#[inline(always)]
fn steady([east, north]: &mut Gain, interval: f64) {
    let of_axis = |i: usize| east[i].abs() + north[i].abs();
    let most = of_axis(2).max(of_axis(3)) * interval / STEADY;
    if most > 1.0 {
        for gain in [east, north] {
            gain[2] /= most;
            gain[3] /= most;
        }
    }
}

/// Removes the direction of a velocity from a gain: a position that is late by an unknown time does not say
/// where the target is along its course, which other sensors decide.
#[cold]
fn across(gain: &mut Gain, [u, v]: [f64; 2]) {
    let square = u * u + v * v;
    if square > 0.0 {
        let [east, north] = gain;
        for (east, north) in east.iter_mut().zip(north) {
            let along = (*east * u + *north * v) / square;
            (*east, *north) = (*east - along * u, *north - along * v);
        }
    }
}

/// Whether a symmetric matrix is positive definite.
#[inline(always)]
fn is_regular(mut a: [[f64; 4]; 4]) -> bool {
    let variances = [a[0][0], a[1][1], a[2][2], a[3][3]];
    for k in 0..4 {
        let (pivot, own) = (a[k][k], a[k]);
        if pivot.is_nan() || pivot <= REGULAR * variances[k].abs() {
            return false;
        }
        for i in k + 1..4 {
            let share = own[i] / pivot;
            for j in i..4 {
                a[i][j] -= share * own[j];
            }
        }
    }
    true
}

/// Returns the displacement of a plot by each error, for an error of one unit of the prior.
#[inline(always)]
fn displaced(seen: &Sighting, velocity: [f64; 2], unknowns: &Unknown) -> [[f64; 2]; KINDS] {
    let [u, v] = seen.axes;
    let [along, across] = seen.constant(velocity.into());
    let mut moved = [[0.0; 2]; KINDS];
    for j in 0..KINDS {
        if let Some((_, sigma)) = unknowns[j] {
            moved[j] = [
                sigma * (u[0] * along[j] + v[0] * across[j]),
                sigma * (u[1] * along[j] + v[1] * across[j]),
            ];
        }
    }
    moved
}

/// Returns `sum + a b`, written so that compilers vectorise it.
#[inline(always)]
fn with_product(sum: Part, a: &Part, b: &Part) -> Part {
    let plus = |sum: [f64; 4], a: f64, b: &[f64; 4]| {
        [sum[0] + a * b[0], sum[1] + a * b[1], sum[2] + a * b[2], sum[3] + a * b[3]]
    };
    let row = |sum: [f64; 4], a: &[f64; KINDS]| {
        plus(plus(plus(plus(sum, a[0], &b[0]), a[1], &b[1]), a[2], &b[2]), a[3], &b[3])
    };
    [row(sum[0], &a[0]), row(sum[1], &a[1]), row(sum[2], &a[2]), row(sum[3], &a[3])]
}

#[cfg(test)]
mod tests;
