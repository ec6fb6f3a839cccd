//! What is part of the state besides the path: noise that lasts, a wandering or an oscillation.
//!
//! They have unit variance. Each axis has one such component, or two if the position oscillates: the
//! displacement of a damped oscillator and its velocity (N = 5 D).

// indices are those of the formulas
#![allow(clippy::needless_range_loop)]

use super::model::Model;
use crate::base::small::Matrix as Square;

/// Number of axes of a state of N components: four for each, or five with an oscillation.
pub(super) const fn axes(n: usize) -> usize {
    if n.is_multiple_of(5) { n / 5 } else { n / 4 }
}

/// Transition of these components over a time; without an oscillation, a multiple of the unit matrix.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Turn([[f64; 2]; 2]);

impl Turn {
    #[inline(always)]
    pub fn over(t: f64, model: &Model) -> Self {
        let fading = model.lasting.correlation(t);
        if model.frequency == 0.0 {
            return Self([[fading, 0.0], [0.0, fading]]);
        }
        let (sin, cos) = (model.frequency * t).sin_cos();
        let damping = 1.0 / (model.frequency * model.lasting.time);
        let (own, cross) = (damping * sin, damping.hypot(1.0) * sin);
        Self([[fading * (cos + own), fading * cross], [-fading * cross, fading * (cos - own)]])
    }

    pub fn transposed(self) -> Self {
        let [[a, b], [c, d]] = self.0;
        Self([[a, c], [b, d]])
    }

    /// `F x`
    #[inline(always)]
    pub fn row<const N: usize>(&self, row: &mut [f64; N]) {
        let (Self([[a, b], [c, e]]), d) = (self, axes(N));
        if N == 4 * d {
            row[3 * d..].iter_mut().for_each(|value| *value *= a);
            return;
        }
        for i in 3 * d..4 * d {
            (row[i], row[d + i]) = (a * row[i] + b * row[d + i], c * row[i] + e * row[d + i]);
        }
    }

    /// `F P`
    #[inline(always)]
    pub fn rows<const N: usize>(&self, p: &mut Square<N>) {
        let (Self([[a, b], [c, e]]), d) = (self, axes(N));
        if N == 4 * d {
            p[3 * d..].iter_mut().for_each(|row| row.iter_mut().for_each(|p| *p *= a));
            return;
        }
        for i in 3 * d..4 * d {
            for k in 0..N {
                let (u, w) = (p[i][k], p[d + i][k]);
                (p[i][k], p[d + i][k]) = (a * u + b * w, c * u + e * w);
            }
        }
    }

    /// `P + I − F F'`: the variances remain 1.
    #[inline(always)]
    pub fn add_noise<const N: usize>(&self, p: &mut Square<N>) {
        let (Self([[a, b], [c, e]]), d) = (self, axes(N));
        for i in 3 * d..4 * d {
            p[i][i] += 1.0 - a * a - b * b;
            if N > 4 * d {
                let cross = a * c + b * e;
                p[i][d + i] -= cross;
                p[d + i][i] -= cross;
                p[d + i][d + i] += 1.0 - c * c - e * e;
            }
        }
    }
}

/// The last time and the transition over it: most steps are as long as the one before.
#[derive(Default)]
pub(super) struct Faded {
    time: f64,
    turn: Turn,
}

impl Faded {
    #[inline(always)]
    pub fn over(&mut self, time: f64, model: &Model) -> &Turn {
        if time != self.time {
            *self = Self { time, turn: Turn::over(time, model) };
        }
        &self.turn
    }
}

/// What a wandering or an oscillation adds to each component of the state of the path: the coefficients of
/// its one or two components.
pub(super) struct Away<const N: usize>([[f64; 2]; N]);

impl<const N: usize> Away<N> {
    pub fn of(model: &Model) -> Self {
        let d = axes(N);
        let derivatives = model.derivatives();
        Self(std::array::from_fn(|i| match derivatives.get(i / d) {
            Some(own) => own.map(|own| own * model.wandering[i % d]),
            None => [0.0; 2],
        }))
    }

    /// `T x`, component i
    #[inline(always)]
    pub fn whole(&self, x: &[f64; N], i: usize) -> f64 {
        let (d, [displacement, velocity]) = (axes(N), self.0[i]);
        let sum = x[i] + displacement * x[3 * d + i % d];
        if N == 4 * d { sum } else { sum + velocity * x[4 * d + i % d] }
    }

    /// `T P`
    pub fn rows(&self, p: &Square<N>) -> Square<N> {
        let (d, mut rows) = (axes(N), *p);
        for i in (0..3 * d).filter(|&i| self.0[i] != [0.0; 2]) {
            rows[i] = std::array::from_fn(|c| {
                // P is symmetric
                self.whole(&p[c], i)
            });
        }
        rows
    }
}

#[cfg(test)]
mod tests {
    use super::super::model::LastingNoise;
    use super::super::motion::ProcessNoise;
    use super::*;

    /// Two steps are one of twice the time, and the variances remain 1.
    #[test]
    fn an_oscillation_is_the_same_in_steps_of_any_length() {
        let lasting = LastingNoise { time: 7.0, ..LastingNoise::NONE };
        let as_stated = Model::as_stated(ProcessNoise::with_jerk(0.0));
        let model = Model { lasting, frequency: 0.9, ..as_stated };
        let moved = |t: f64, p: &Square<5>| {
            let (turn, mut p) = (Turn::over(t, &model), *p);
            p.iter_mut().for_each(|row| turn.row(row));
            turn.rows(&mut p);
            turn.add_noise(&mut p);
            p
        };
        let start: Square<5> = std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                if i > 2 && j > 2 { [[0.5, 0.2], [0.2, 0.1]][i - 3][j - 3] } else { 0.0 }
            })
        });
        let (once, twice) = (moved(2.6, &start), moved(1.3, &moved(1.3, &start)));
        let last = moved(1e4, &start);
        for i in 3..5 {
            for j in 3..5 {
                assert!((once[i][j] - twice[i][j]).abs() < 1e-14);
                assert!((last[i][j] - f64::from(u8::from(i == j))).abs() < 1e-14);
            }
        }
    }
}
