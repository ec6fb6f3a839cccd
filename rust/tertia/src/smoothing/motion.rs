//! Motion of a state from one instant to the next, driven by white jerk, and by white acceleration and
//! velocity in addition.

// indices are those of the formulas
#![allow(clippy::needless_range_loop)]

use crate::base::small::{Matrix as Square, symmetrise};

/// Noise that drives a motion: the intensities of white jerk, white acceleration and white velocity.
///
/// The acceleration and the velocity of the state do not include their white noise. White acceleration alone
/// makes the velocity a random walk, white velocity alone the position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProcessNoise {
    /// Intensity of the white jerk, in position² / time⁵.
    pub jerk: f64,
    /// Intensity of the white acceleration, in position² / time³.
    pub acceleration: f64,
    /// Intensity of the white velocity, in position² / time.
    pub velocity: f64,
    /// Intensities on the last axis relative to those on the others, above 0.
    pub last_axis: f64,
}

impl ProcessNoise {
    /// Returns white jerk alone.
    pub fn with_jerk(jerk: f64) -> Self {
        Self { jerk, acceleration: 0.0, velocity: 0.0, last_axis: 1.0 }
    }

    /// Returns all intensities multiplied by a factor.
    pub(crate) fn times(self, factor: f64) -> Self {
        let Self { jerk, acceleration, velocity, last_axis } = self;
        Self {
            jerk: jerk * factor,
            acceleration: acceleration * factor,
            velocity: velocity * factor,
            last_axis,
        }
    }

    /// Intensities on one of d axes relative to those on the first.
    pub(super) fn on(self, axis: usize, d: usize) -> f64 {
        if axis > 0 && axis + 1 == d { self.last_axis } else { 1.0 }
    }

    /// Whether there is no noise.
    pub(super) fn is_certain(self) -> bool {
        self.jerk == 0.0 && self.acceleration == 0.0 && self.velocity == 0.0
    }

    /// Returns the lower triangular G with `G G^T = Q`, for the first axis over the time t.
    pub(super) fn noise_root(self, t: f64) -> [f64; 6] {
        // Q = q [[t^5/20, t^4/8, t^3/6], [., t^3/3, t^2/2], [., ., t]]
        if self.velocity > 0.0 {
            return self.wandering_root(t);
        }
        let s = (self.jerk * t).sqrt();
        if self.acceleration == 0.0 {
            return [
                s * t * t * 0.05_f64.sqrt(),
                s * t * 20_f64.sqrt() / 8.0,
                s * t / 48_f64.sqrt(),
                s * 20_f64.sqrt() / 6.0,
                s / 3_f64.sqrt(),
                s / 3.0,
            ];
        }
        // plus a [[t^3/3, t^2/2], [., t]]: without cancellation, divided by powers of t
        let (q, a) = (self.jerk * t * t * t, self.acceleration * t);
        let (first, second) = (20.0 * a + 3.0 * q, 240.0 * a * a + 104.0 * a * q + 3.0 * q * q);
        let g00 = (first / 60.0).sqrt();
        let (g10, g20) = ((q / 8.0 + a / 2.0) / g00, q / 6.0 / g00);
        let g11 = (second / (48.0 * first)).sqrt();
        let g21 = q * (20.0 * a + q) / (4.0 * first) / g11;
        let g22 = (q * (12.0 * a + q) * (60.0 * a + q) / (3.0 * second)).sqrt();
        [g00 * t, g10, g11, g20 / t, g21 / t, g22 / t]
    }

    /// The same with white velocity, computed from the root for the other noise without cancellation.
    fn wandering_root(self, t: f64) -> [f64; 6] {
        let [g00, g10, g11, g20, g21, g22] = Self { velocity: 0.0, ..self }.noise_root(t);
        // v t is added to the variance of the position in G G': the first element becomes (g00² + v t)^½
        let (added, s) = (self.velocity * t, g00.hypot((self.velocity * t).sqrt()));
        let (h10, h20) = (g10 * g00 / s, g20 * g00 / s);
        let share = added / (s * s);
        let h11 = (g11 * g11 + share * g10 * g10).sqrt();
        if h11 == 0.0 {
            return [s, h10, 0.0, h20, 0.0, g22];
        }
        let h21 = (g11 * g21 + share * g10 * g20) / h11;
        // what remains for the last element, by the identity of Lagrange
        let cross = share * (g11 * g20 - g21 * g10).powi(2) / (h11 * h11);
        [s, h10, h11, h20, h21, (g22 * g22 + cross).sqrt()]
    }
}

/// `x = F x`, `P = F P F' + Q` of the first `3 d` components: positions, velocities, accelerations.
///
/// The caller moves further components; here, only their covariances with the first ones change. `O(N²)`.
#[inline(always)]
pub(super) fn advance<const N: usize>(
    d: usize,
    x: &mut [f64; N],
    p: &mut Square<N>,
    t: f64,
    motion: ProcessNoise,
) {
    let half = 0.5 * t * t;
    advance_row(d, x, t, half);
    for row in &mut *p {
        advance_row(d, row, t, half);
    }
    for i in 0..d {
        for c in 0..N {
            let (v, a) = (p[d + i][c], p[2 * d + i][c]);
            p[i][c] += t * v + half * a;
            p[d + i][c] += t * a;
        }
    }
    symmetrise(p);
    let q = motion.jerk * t;
    let (pp, pv, pa) = (q * t * t * t * t / 20.0, q * t * t * t / 8.0, q * t * t / 6.0);
    let (vv, va) = (q * t * t / 3.0, q * t / 2.0);
    for i in 0..d {
        let own = motion.on(i, d);
        p[i][i] += own * pp;
        p[i][d + i] += own * pv;
        p[d + i][i] += own * pv;
        p[i][2 * d + i] += own * pa;
        p[2 * d + i][i] += own * pa;
        p[d + i][d + i] += own * vv;
        p[d + i][2 * d + i] += own * va;
        p[2 * d + i][d + i] += own * va;
        p[2 * d + i][2 * d + i] += own * q;
    }
    if motion.acceleration == 0.0 && motion.velocity == 0.0 {
        return;
    }
    for i in 0..d {
        let own = motion.on(i, d);
        let (a, v) = (own * motion.acceleration * t, own * motion.velocity * t);
        p[i][i] += a * t * t / 3.0 + v;
        p[i][d + i] += a * t / 2.0;
        p[d + i][i] += a * t / 2.0;
        p[d + i][d + i] += a;
    }
}

/// `F x`, where x is a row of positions, velocities and accelerations.
#[inline(always)]
pub(super) fn advance_row<const N: usize>(d: usize, row: &mut [f64; N], t: f64, half: f64) {
    for i in 0..d {
        let (v, a) = (row[d + i], row[2 * d + i]);
        row[i] += t * v + half * a;
        row[d + i] += t * a;
    }
}

/// `F' λ`
#[inline(always)]
pub(super) fn turn_row(d: usize, row: &mut [f64], t: f64, half: f64) {
    for i in 0..d {
        let (p, v) = (row[i], row[d + i]);
        row[2 * d + i] += t * v + half * p;
        row[d + i] += t * p;
    }
}

/// `F' λ` and `F' Λ F` for D axes, not yet made symmetric; other components do not change.
#[inline(always)]
pub(super) fn turn_back<const N: usize>(
    d: usize,
    t: f64,
    l: &mut [f64; N],
    big: Option<&mut Square<N>>,
) {
    let half = 0.5 * t * t;
    turn_row(d, l, t, half);
    let Some(big) = big else { return };
    big.iter_mut().for_each(|row| turn_row(d, row, t, half));
    for i in 0..d {
        for c in 0..N {
            let (p, v) = (big[i][c], big[d + i][c]);
            big[2 * d + i][c] += t * v + half * p;
            big[d + i][c] += t * p;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Only the noise of the last axis has another size.
    #[test]
    fn the_last_axis_may_have_noise_of_its_own() {
        for (jerk, acceleration, velocity) in [(2.0, 0.0, 0.0), (1e-9, 3.0, 0.0), (0.5, 0.1, 7.0)] {
            let motion = ProcessNoise { acceleration, velocity, ..ProcessNoise::with_jerk(jerk) };
            let noise = |motion: ProcessNoise| {
                let (mut x, mut q) = ([0.0; 9], [[0.0; 9]; 9]);
                advance(3, &mut x, &mut q, 1.7, motion);
                q
            };
            let (same, own) = (noise(motion), noise(ProcessNoise { last_axis: 4.0, ..motion }));
            for i in 0..9 {
                for j in 0..9 {
                    let factor = if i % 3 == 2 { 4.0 } else { 1.0 };
                    assert!((own[i][j] - factor * same[i][j]).abs() <= 1e-15 * own[i][i]);
                }
            }
        }
    }

    /// `G G'` must be what `advance` adds to a covariance of zero.
    #[test]
    fn the_root_is_that_of_the_noise() {
        let motions = [(2.0, 0.0), (1e-9, 3.0), (4.0, 1e-9), (0.7, 0.2), (1e6, 5.0)];
        let motions = motions.iter().flat_map(|&(jerk, acceleration)| {
            [0.0, 1e-9, 0.3, 1e5].map(|velocity| ProcessNoise {
                velocity,
                acceleration,
                ..ProcessNoise::with_jerk(jerk)
            })
        });
        for motion in motions {
            for t in [1e-3, 0.4, 1.0, 60.0] {
                let (mut x, mut q) = ([0.0; 3], [[0.0; 3]; 3]);
                advance(1, &mut x, &mut q, t, motion);
                let [g00, g10, g11, g20, g21, g22] = motion.noise_root(t);
                let g = [[g00, 0.0, 0.0], [g10, g11, 0.0], [g20, g21, g22]];
                for i in 0..3 {
                    for j in 0..3 {
                        let own: f64 = (0..3).map(|k| g[i][k] * g[j][k]).sum();
                        let size = (q[i][i] * q[j][j]).sqrt();
                        assert!((own - q[i][j]).abs() <= 1e-13 * size, "{motion:?} {t} {i} {j}");
                    }
                }
            }
        }
    }
}
