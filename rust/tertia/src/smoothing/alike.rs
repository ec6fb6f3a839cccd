//! Likelihood of the axes of a track whose plots are equally precise: their covariances are the same, and are
//! computed once.

use super::adjoint::{Adjoint, LOSS, Step};
use super::information::Logarithms;
use super::motion::{ProcessNoise, advance_row};
use super::opening::{of_three, state_of_three};
use super::results::Summary;
use super::seen::ENOUGH;
use super::track::Track;
use pulp::{Arch, Simd, WithSimd};

/// Whether the same instants of all axes have plots, with the same noise.
pub(super) fn are_alike(axes: &[Track<'_>]) -> bool {
    axes.windows(2).all(|pair| {
        let [a, b] = [&pair[0], &pair[1]];
        let mut plots = a.y.iter().zip(&b.y);
        a.whitener == b.whitener && plots.all(|(a, b)| a.is_nan() == b.is_nan())
    })
}

impl<const M: usize, const N: usize> Adjoint<M, N> {
    /// Returns the likelihood of axes that are alike, and all have this motion; `None` if the first three
    /// plots do not determine the state, or if digits would be lost.
    pub fn likelihood_of_alike(
        &mut self,
        axes: &[Track<'_>],
        motion: ProcessNoise,
    ) -> Option<Summary> {
        let first = axes.first().filter(|first| Self::is_for(first))?;
        let (x, p, logarithms) = of_three::<M, N>(first, motion)?;
        let step = Step::<M, N> { x, p, ..Step::new() };
        let others = axes[1..].iter().map(state_of_three::<M, N>).collect();
        let (squares, spread) = Arch::new().dispatch(Together { axes, motion, step, others })?;
        let logarithms = 2.0 * logarithms.total() + spread.total();
        let mut sum = Summary { log_likelihood: 0.0, count: 0 };
        for (axis, squares) in axes.iter().zip(squares) {
            let Summary { log_likelihood, count } = Self::summary(axis, squares, logarithms);
            sum.log_likelihood += log_likelihood;
            sum.count += count;
        }
        Some(sum)
    }
}

/// The filter of the first axis, whose gains also take the states of the others across their plots; compiled
/// for the vector instructions of the machine.
struct Together<'a, const M: usize, const N: usize> {
    axes: &'a [Track<'a>],
    motion: ProcessNoise,
    step: Step<M, N>,
    others: Vec<[f64; N]>,
}

impl<const M: usize, const N: usize> WithSimd for Together<'_, M, N> {
    /// The sums of squares of all axes, and the logarithms of the variances of the innovations of one.
    type Output = Option<(Vec<f64>, Logarithms)>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Self::Output {
        let Self { axes, motion, mut step, mut others } = self;
        let (mut squares, mut spread) = (vec![0.0; axes.len()], Logarithms::NONE);
        let first = &axes[0];
        for k in ENOUGH..first.len() {
            let t = first.times[k] - first.times[k - 1];
            step.predict(t, motion);
            squares[0] += step.update(first, k, LOSS, &mut spread)?;
            let rest = axes.iter().zip(&mut squares).skip(1);
            for ((axis, squares), x) in rest.zip(&mut others) {
                advance_row(N / 3, x, t, 0.5 * t * t);
                *squares += step.follow(axis, k, x);
            }
        }
        Some((squares, spread))
    }
}

impl<const M: usize, const N: usize> Step<M, N> {
    /// Updates the state of another axis with the gains of this one. Returns the sum of squares that its plot
    /// adds.
    #[inline(always)]
    fn follow(&self, track: &Track<'_>, k: usize, x: &mut [f64; N]) -> f64 {
        let (plot, whitener) = (track.plot(k), track.whitener(k));
        let mut squares = 0.0;
        for i in (0..M).filter(|&i| self.s[i] > 0.0) {
            let rows = whitener[i * M..][..=i].iter().zip(plot.iter().zip(&*x));
            let seen = rows.filter(|(h, _)| **h != 0.0);
            let innovation: f64 = seen.map(|(h, (y, x))| h * (y - x)).sum();
            let gain = innovation * (1.0 / self.s[i]);
            for (x, ph) in x.iter_mut().zip(&self.ph[i]) {
                *x += ph * gain;
            }
            squares += innovation * gain;
        }
        squares
    }
}

#[cfg(test)]
mod tests {
    use super::super::quick::Quick;
    use super::super::whitener::Noise;
    use super::*;
    use crate::base::random::noise;

    /// The likelihood has the bits of that of each axis alone.
    #[test]
    fn together_as_alone() {
        let times: Vec<f64> = (0..30).map(|k| f64::from(k) + 0.2 * noise(k as usize)).collect();
        let mut y: Vec<f64> =
            (0..60).map(|i| 0.1 * f64::from(i * i) + noise(7 * i as usize)).collect();
        (y[14], y[15]) = (f64::NAN, f64::NAN);
        let stated = Noise::Same(&[0.7, 0.0, 0.0, 0.7]);
        let track = Track::try_new(2, &times, &y, stated, None).unwrap();
        assert!(are_alike(&track.axes));
        let mut quick = Quick::default();
        for jerk in [1e-6, 1e-2, 3.0] {
            let motion = ProcessNoise::with_jerk(jerk);
            let mut engine = Adjoint::<1, 3>::default();
            let together = engine.likelihood_of_alike(&track.axes, motion).unwrap();
            let alone = track.axes.iter().map(|axis| engine.likelihood(axis, motion).unwrap());
            let alone: f64 = alone.map(|one| one.log_likelihood).sum();
            assert_eq!(together.log_likelihood, alone);
            assert_eq!(together.count, track.measured - 6);
            assert_eq!(quick.likelihood(&track, motion).unwrap().log_likelihood, alone);
        }
        y[18] = f64::NAN;
        let track = Track::try_new(2, &times, &y, stated, None).unwrap();
        assert!(!are_alike(&track.axes));
    }
}
