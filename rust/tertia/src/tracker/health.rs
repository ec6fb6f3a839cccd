//! Whether the noise of a radar is what it states, by the plots of its confirmed tracks.

use super::row::{Row, Rows};
use serde::{Deserialize, Serialize};

/// Plots over which the factor is found, and before which none is given.
const WINDOW: f64 = 1000.0;
const FEWEST: f64 = 100.0;
/// Median of a normalised innovation squared, and the best step of its logarithm to either side.
const MEDIAN: f64 = 1.386_294_361_119_890_6;
const STEP: f64 = std::f64::consts::LOG2_E;

/// Innovations of one radar.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Health {
    plots: f64,
    /// Logarithm of the median of their squares, relative to what is expected.
    median: f64,
}

impl Health {
    fn saw(&mut self, nis: f64) {
        self.plots = (self.plots + 1.0).min(WINDOW);
        let side = if nis > MEDIAN * self.median.exp() { 1.0 } else { -1.0 };
        // the first ones may be far off
        let step = STEP / self.plots.max(10.0);
        self.median += side * step;
    }

    /// Root of their median over what is expected; nan before there are enough.
    pub fn noise_factor(&self) -> f64 {
        if self.plots < FEWEST { f64::NAN } else { (0.5 * self.median).exp() }
    }
}

/// Passes rows on, and looks at the innovations of those that are final.
pub(super) struct Watched<'a, R> {
    pub rows: &'a mut R,
    pub health: &'a mut [Health],
}

impl<R: Rows> Rows for Watched<'_, R> {
    fn wants(&self, confirmed: bool) -> bool {
        self.rows.wants(confirmed)
    }

    fn push(&mut self, row: &Row) {
        // in turns the prediction is off, whatever the noise
        if row.is_final && row.confirmed && row.plot.is_some() && row.turn_probability < 0.5 {
            let nis = row.innovation_covariance.inverse().form(row.innovation);
            if nis.is_finite() {
                self.health[row.radar].saw(nis);
            }
        }
        self.rows.push(row);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;

    #[test]
    fn the_factor_is_that_of_the_median_whatever_outliers_there_are() {
        // quantiles of the distribution, mixed: the golden ratio is far from every fraction
        let factor = |noise: f64, outliers: f64| {
            let mut health = Health::default();
            for k in 1..20_000 {
                let u = (f64::from(k) * 0.618_033_988_749_894_9).fract();
                let v = (f64::from(k) * 0.414_213_562_373_095_1).fract();
                let nis = if v < outliers { 1e4 } else { -2.0 * noise * noise * (1.0 - u).ln() };
                health.saw(nis);
            }
            health.noise_factor()
        };
        assert_within(0.05, factor(1.0, 0.0), 1.0);
        assert_within(0.05, factor(2.0, 0.0), 2.0);
        assert_within(0.05, factor(0.5, 0.0), 0.5);
        // the median of all is the 62.5 % quantile of the others
        assert_within(0.05, factor(1.0, 0.2), ((-(0.375_f64.ln())) / 2.0_f64.ln()).sqrt());
        assert!(Health::default().noise_factor().is_nan());
    }
}
