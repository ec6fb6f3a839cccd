//! Smoothing of single series: coordinates of positions, or the measurements of a station.

use super::failure::Failure;
use crate::base::error::Result;
use crate::batch::for_each_row;
use crate::smoothing::{
    self, Degree, Noise, Output, Polynomial, Track, Workspace, fit_process_noise,
};
use crate::trajectory::measured::Record;

/// Highest degree of adaptive polynomials.
const MAX_DEGREE: usize = 3;
/// Significance of the tests of the coefficients of adaptive polynomials.
const SIGNIFICANCE: f64 = 0.05;
/// Cost of an instant (ns) with either smoother, for the choice of threads.
const INSTANT_NS: f64 = 10_000.0;

/// Local polynomials that smooth a series.
#[derive(Clone, Copy, Debug)]
pub struct Polynomials {
    /// Instants in a window, an odd number.
    pub window: usize,
    /// Degree of the polynomials; none: chosen for each window.
    pub degree: Option<usize>,
}

/// A smoothed series with its first two derivatives; values are nan and sigmas ∞ where unknown.
#[derive(Clone, Debug, Default)]
pub(in crate::trajectory) struct Series {
    pub value: [Vec<f64>; 3],
    pub sigma: [Vec<f64>; 3],
}

/// Measurements, nan where there is none, and their variances.
pub(in crate::trajectory) type Noisy = (Vec<f64>, Vec<f64>);

impl Series {
    /// Smooths all series by polynomials, or, if none are given, with white jerk of the likeliest intensity.
    pub fn smoothed(
        record: &Record<'_>,
        rows: &[Noisy],
        polynomials: Option<Polynomials>,
    ) -> std::result::Result<Vec<Self>, Failure> {
        let mut all = vec![Self::default(); rows.len()];
        let cost = INSTANT_NS * (rows.len() * record.len()) as f64;
        let (threads, items) = (record.n_threads, rows.iter().zip(&mut all));
        for_each_row(
            items,
            cost,
            threads,
            Workspace::default,
            |workspace, ((y, variance), out)| {
                *out = match polynomials {
                    Some(chosen) => Self::of_polynomials(record.time, y, Some(variance), chosen)?,
                    None => Self::of_white_jerk(record.time, y, variance, workspace)?,
                };
                Ok(())
            },
        )
        .map_err(|failed| Failure::Error(failed.error))?;
        Ok(all)
    }

    /// Smooths a series by local polynomials; without variances, all variances are assumed to be equal.
    pub fn of_polynomials(
        time: &[f64],
        y: &[f64],
        variance: Option<&[f64]>,
        Polynomials { window, degree }: Polynomials,
    ) -> Result<Self> {
        let n = time.len();
        let mut series = Self {
            value: [(); 3].map(|()| vec![f64::NAN; n]),
            sigma: [(); 3].map(|()| vec![f64::INFINITY; n]),
        };
        // a short record limits the degree, and so does a short window
        let count = y.iter().filter(|v| !v.is_nan()).count();
        let most = MAX_DEGREE.min(count.saturating_sub(1)).min(window.saturating_sub(2));
        let (top, chosen) =
            degree.map_or((most, Degree::Adaptive(most)), |degree| (degree, Degree::Fixed(degree)));
        let mut used = vec![0; n];
        let record = smoothing::Record { y, time: Some(time), variance };
        for derivative in 0..=top.min(2) {
            let (value, sigma) = (&mut series.value[derivative], &mut series.sigma[derivative]);
            let mut out = Output { value, sigma, degree: &mut used };
            Polynomial::try_new(window, chosen, derivative, SIGNIFICANCE)?
                .smooth(&record, &mut out)?;
        }
        Ok(series)
    }

    fn of_white_jerk(
        time: &[f64],
        y: &[f64],
        variance: &[f64],
        workspace: &mut Workspace,
    ) -> Result<Self> {
        let n = time.len();
        let track = Track::try_new(1, time, y, Noise::Each(variance), None)?;
        let fit = fit_process_noise(&track, workspace);
        let (mut mean, mut covariance) = (vec![0.0; 3 * n], vec![0.0; 9 * n]);
        let mut out = smoothing::Smoothed {
            mean: &mut mean,
            covariance: &mut covariance,
            innovation: &mut vec![0.0; n],
        };
        smoothing::smooth(&track, fit.motion, workspace, &mut out);
        Ok(Self {
            value: [0, 1, 2].map(|i| mean.iter().skip(i).step_by(3).copied().collect()),
            sigma: [0, 1, 2]
                .map(|i| covariance.iter().skip(4 * i).step_by(9).map(|v| v.sqrt()).collect()),
        })
    }
}
