//! Whether a target turns for long, from the second differences of its plots.
//!
//! The second differences of a target in a turn rotate, always the same way; those of errors have no sense of
//! rotation, whatever the size and the correlation of the errors.

use serde::{Deserialize, Serialize};

/// Number of senses over which their mean is taken, and number from which on it decides.
const REMEMBERED: f64 = 100.0;
const FEWEST: f64 = 10.0;
/// Standard deviation of the mean, times the root of the number of senses, if there are only errors
/// (simulated, because differences share plots), and number of standard deviations by which it differs in a turn:
/// the plots of a target that does not turn are missed little.
const SPREAD: f64 = 1.3;
const LIKELY: f64 = 2.0;

/// In which sense the second differences of a target rotate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Turning {
    count: f64,
    mean: f64,
}

impl Turning {
    /// Updates the mean sense by two successive second differences, in sigmas, the last first.
    pub fn saw(&mut self, [a, b]: [f64; 2], [c, d]: [f64; 2]) {
        let sense = a * d - b * c;
        if sense.is_finite() {
            self.count = (self.count + 1.0).min(REMEMBERED);
            self.mean += (sense.signum() - self.mean) / self.count;
        }
    }

    /// Whether the target turns so that its differences are no measure of its errors.
    pub fn is_likely(&self) -> bool {
        let least = LIKELY * SPREAD / self.count.sqrt();
        self.count >= FEWEST && self.mean.abs() > least
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;
    use std::f64::consts::TAU;

    /// Share of the plots at which a target seems to turn; it circles by `angle` from plot to plot, with a radius
    /// of `radius` sigmas and errors of this correlation.
    fn share(angle: f64, radius: f64, correlation: f64) -> f64 {
        let (mut random, mut found) = (Random::new(11), Turning::default());
        let (mut plots, mut error, mut likely) = (Vec::new(), [0.0; 2], 0);
        for k in 0..2000 {
            let (size, phase) = (1.0 - random.uniform(), TAU * random.uniform());
            let (sine, cosine) = phase.sin_cos();
            let fresh = (-2.0 * size.ln() * (1.0 - correlation * correlation)).sqrt();
            error =
                [correlation * error[0] + fresh * cosine, correlation * error[1] + fresh * sine];
            let (sine, cosine) = (angle * f64::from(k)).sin_cos();
            plots.push([radius * sine + error[0], radius * cosine + error[1]]);
            if let [.., a, b, c, d] = plots[..] {
                let second = |x: [f64; 2], y: [f64; 2], z: [f64; 2]| {
                    [0, 1].map(|i| x[i] - 2.0 * y[i] + z[i])
                };
                found.saw(second(b, c, d), second(a, b, c));
            }
            likely += usize::from(k >= 100 && found.is_likely());
        }
        likely as f64 / 1900.0
    }

    #[test]
    fn errors_do_not_turn_but_gliders_do() {
        for correlation in [0.0, 0.5, 0.8] {
            assert!(share(0.0, 0.0, correlation) < 0.12, "{correlation}");
        }
        assert!(share(1.1, 4.0, 0.0) > 0.9 && share(-2.0, 2.0, 0.0) > 0.9);
    }
}
