//! Smoother with covariances for one to three axes, where it is as accurate as that with rows.

use super::adjoint::{self, Adjoint};
use super::alike::are_alike;
use super::motion::ProcessNoise;
use super::results::{Smoothed, Summary};
use super::track::Track;

/// Largest distance of a plot from the trend, in least standard deviations, with which the state is accurate
/// enough as a single number.
const FARTHEST: f64 = 1e5;

/// Largest ratio of the longest step to the shortest with which tracing a step back is accurate enough.
const UNEVEN: f64 = 1e2;
/// Ratio of a variance to that with later plots beyond which too many digits are lost.
const LOSS: f64 = 1e3;

/// Buffers for one, two and three axes, without velocities and with them.
#[derive(Clone, Debug, Default)]
pub(super) struct Quick {
    one: Adjoint<1, 3>,
    two: Adjoint<2, 6>,
    three: Adjoint<3, 9>,
    moving_one: Adjoint<2, 3>,
    moving_two: Adjoint<4, 6>,
    moving_three: Adjoint<6, 9>,
}

/// Calls a method of the buffers that suit a track.
macro_rules! with_buffers {
    ($quick:expr, $track:expr, $method:ident($($argument:expr),*)) => {
        match ($track.dimension, $track.numbers) {
            (1, 1) => $quick.one.$method($($argument),*),
            (2, 2) => $quick.two.$method($($argument),*),
            (3, 3) => $quick.three.$method($($argument),*),
            (1, 2) => $quick.moving_one.$method($($argument),*),
            (2, 4) => $quick.moving_two.$method($($argument),*),
            (3, 6) => $quick.moving_three.$method($($argument),*),
            _ => None,
        }
    };
}

impl Quick {
    /// Returns the likelihood; `None` if digits would be lost.
    pub fn likelihood(&mut self, track: &Track<'_>, motion: ProcessNoise) -> Option<Summary> {
        if !track.axes.is_empty() {
            return self.likelihood_of_axes(track, motion);
        }
        with_buffers!(self, track, likelihood(track, motion))
    }

    fn likelihood_of_axes(&mut self, track: &Track<'_>, motion: ProcessNoise) -> Option<Summary> {
        if motion.last_axis == 1.0
            && are_alike(&track.axes)
            && let Some(sum) =
                with_buffers!(self, track.axes[0], likelihood_of_alike(&track.axes, motion))
        {
            return Some(sum);
        }
        let mut sum = Summary { log_likelihood: 0.0, count: 0 };
        for (at, axis) in track.axes.iter().enumerate() {
            let motion = motion.times(motion.on(at, track.dimension));
            let own = with_buffers!(self, axis, likelihood(axis, motion));
            let Summary { log_likelihood, count } = own?;
            sum.log_likelihood += log_likelihood;
            sum.count += count;
        }
        Some(sum)
    }

    /// Computes states, covariances and innovations; `None` if digits would be lost.
    pub fn smooth(
        &mut self,
        track: &Track<'_>,
        motion: ProcessNoise,
        out: &mut Smoothed<'_>,
    ) -> Option<Summary> {
        if motion.jerk == 0.0 || track.farthest() > FARTHEST || track.unevenness() > UNEVEN {
            return None;
        }
        let mut out = adjoint::Smoothed {
            mean: out.mean,
            covariance: out.covariance,
            components: 3 * track.dimension,
            innovation: out.innovation,
            loss: LOSS,
        };
        with_buffers!(self, track, smooth(track, motion, &mut out))
    }
}
