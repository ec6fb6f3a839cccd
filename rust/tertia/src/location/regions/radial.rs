//! Distribution of the distance of a normal error from its mean, in the plane.

use super::contour::principal;
use crate::base::exponential::exp;
use pulp::{Arch, Simd, WithSimd};
use std::f64::consts::FRAC_PI_2;
use std::sync::LazyLock;

/// Number of angles in a quarter turn. For an elongated ellipse it is [`MORE`] times the ratio of its
/// axes, with which the error of the sum is about `exp(−4 MORE)`, but at most [`MOST`].
const ANGLES: f64 = 16.0;
const MORE: f64 = 6.0;
const MOST: f64 = 12_288.0;
/// Angles that are computed side by side.
const LANES: usize = 8;
/// Number of tables of angles: for [`ANGLES`] angles, twice as many, and so on.
const TABLES: usize = 4;
/// Squares of cosines and sines at the midpoints of the equal parts of a quarter turn, one entry per
/// table.
static SQUARES: LazyLock<[Vec<[[f64; LANES]; 2]>; TABLES]> = LazyLock::new(|| {
    std::array::from_fn(|table| {
        let count = (ANGLES as usize) << table;
        let squares = |i: usize| {
            let (sine, cosine) = ((i as f64 + 0.5) * FRAC_PI_2 / count as f64).sin_cos();
            (cosine * cosine, sine * sine)
        };
        let lanes = |at: usize| -> [[f64; LANES]; 2] {
            let own: [_; LANES] = std::array::from_fn(|i| squares(at * LANES + i));
            [own.map(|(cosine, _)| cosine), own.map(|(_, sine)| sine)]
        };
        (0..count / LANES).map(lanes).collect()
    })
});
/// Smallest variance, relative to the larger one. A narrower ellipse is practically a line, for which
/// no number of angles would be sufficient.
const LINE: f64 = (MORE / MOST) * (MORE / MOST);
const STEPS: usize = 100;
const TOLERANCE: f64 = 1e-13;

/// A normal error in the plane, or an error with Student's distribution if σ is estimated.
#[derive(Clone, Copy, Debug)]
pub(in crate::location) struct Radial {
    /// Variances along the axes, the larger one first.
    large: f64,
    small: f64,
    /// Degrees of freedom of σ; infinite if σ is known.
    freedom: f64,
}

impl Radial {
    /// Error with covariance `[a, b; b, c]`; `None` if it is not positive definite.
    pub fn try_new(covariance: [f64; 3], freedom: f64) -> Option<Self> {
        let (large, small, _) = principal(covariance);
        let known = small > 0.0 && large.is_finite();
        known.then_some(Self { large, small: small.max(LINE * large), freedom })
    }

    /// Returns the larger standard deviation.
    pub fn longest(&self) -> f64 {
        self.large.sqrt()
    }

    /// Returns `P(|x| > r) = E_a[e^(−r² q/2) / q] / √(λ₁ λ₂)`, `q = cos² a/λ₁ + sin² a/λ₂`, by the
    /// midpoint rule in a, which converges geometrically. For Student's distribution,
    /// `(1 + r² q/ν)^(−ν/2)` takes the place of the exponential. The probability is 1 for r ≤ 0.
    /// O(√(λ₁/λ₂)).
    pub fn outside(&self, r: f64) -> f64 {
        if r <= 0.0 {
            return 1.0;
        }
        let count = ANGLES.max(MORE * (self.large / self.small).sqrt()).min(MOST).ceil();
        let square = r * r;
        let doublings = (count / ANGLES).log2().ceil() as usize;
        if doublings < TABLES && self.freedom.is_infinite() {
            let (along, across) = (1.0 / self.large, 1.0 / self.small);
            let tail = Tail { squares: &SQUARES[doublings], along, across, half: 0.5 * square };
            let count = ANGLES * (1 << doublings) as f64;
            return Arch::new().dispatch(tail) / count / (self.large * self.small).sqrt();
        }
        let step = FRAC_PI_2 / count;
        let term = |i: usize| {
            let (sine, cosine) = ((i as f64 + 0.5) * step).sin_cos();
            let q = cosine * cosine / self.large + sine * sine / self.small;
            let tail = if self.freedom.is_finite() {
                (-0.5 * self.freedom * (square * q / self.freedom).ln_1p()).exp()
            } else {
                (-0.5 * square * q).exp()
            };
            tail / q
        };
        let sum: f64 = (0..count as usize).map(term).sum();
        sum / count / (self.large * self.small).sqrt()
    }

    /// Returns the r with `P(|x| > r) = p`.
    pub fn quantile(&self, p: f64) -> f64 {
        falling_root(|r| self.outside(r).ln() - p.ln(), self.longest())
    }
}

/// Computes `Σ e^(−h q)/q`, `q = c² along + s² across`.
struct Tail<'a> {
    squares: &'a [[[f64; LANES]; 2]],
    along: f64,
    across: f64,
    half: f64,
}

impl WithSimd for Tail<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        let Self { squares, along, across, half } = self;
        let mut sums = [0.0; LANES];
        for [cosines, sines] in squares {
            for i in 0..LANES {
                let q = cosines[i] * along + sines[i] * across;
                sums[i] += exp(-half * q) / q;
            }
        }
        sums.iter().sum()
    }
}

/// Returns the positive argument at which a decreasing function is zero, by false position with halved
/// end values (Illinois). The search starts from `scale`. The result is infinite if the function stays
/// positive.
pub(in crate::location) fn falling_root(f: impl Fn(f64) -> f64, scale: f64) -> f64 {
    let (mut low, mut high) = (0.0, scale);
    let (mut above, mut below) = (f(0.0), f(high));
    for _ in 0..STEPS {
        if below <= 0.0 || !high.is_finite() {
            break;
        }
        (low, above) = (high, below);
        high *= 2.0;
        below = f(high);
    }
    if below.is_nan() || below > 0.0 {
        return f64::INFINITY;
    }
    if above <= 0.0 {
        return low;
    }
    let mut last = 0.0;
    for _ in 0..STEPS {
        // far in the tail, the logarithm of the probability is −∞
        let share = if below.is_finite() { above / (above - below) } else { 0.5 };
        let middle = low + share * (high - low);
        let value = f(middle);
        if value > 0.0 {
            (low, above) = (middle, value);
            below *= if last > 0.0 { 0.5 } else { 1.0 };
        } else {
            (high, below) = (middle, value);
            above *= if last < 0.0 { 0.5 } else { 1.0 };
        }
        last = value;
        if value == 0.0 || high - low <= TOLERANCE * high {
            return middle;
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;

    #[test]
    fn tails() {
        let round = Radial::try_new([4.0, 0.0, 4.0], f64::INFINITY).unwrap();
        assert_within(1e-14, round.outside(3.0), (-9.0 / 8.0_f64).exp());
        assert_within(1e-12, round.quantile(0.5), 2.0 * (2.0 * 2_f64.ln()).sqrt());
        // the sum over 256 angles, computed independently in double precision
        let long = Radial::try_new([100.0, 30.0, 64.0], f64::INFINITY).unwrap();
        assert_within(1e-12, long.outside(30.0), 0.007_498_227_201_251_222);
        // a circle with Student's errors: the squared radius has Fisher's distribution
        let few = Radial::try_new([1.0, 0.0, 1.0], 3.0).unwrap();
        assert_within(1e-12, few.outside(2.0), (1.0_f64 + 4.0 / 3.0).powf(-1.5));
        let line = Radial::try_new([1.0, 0.0, 1e-8], f64::INFINITY).unwrap();
        assert_within(1e-4, line.quantile(0.05), 1.959_963_984_540_054);
        assert!(Radial::try_new([1.0, 1.0, 1.0], 3.0).is_none());
    }
}
