//! Tests that results have the same bits with the instructions of every processor.

use super::super::model::Singer;
use super::*;
use crate::base::checks::Level;
use crate::base::random::noise;

const STEPS: usize = 500;

/// Returns the bits of all results of a series.
fn bits(series: &Series<'_>, period: Option<f64>, level: Level) -> Vec<u64> {
    let filter = Filter::new(1e-4, period);
    let [mut mean, mut covariance, mut innovation, mut variance] =
        [3, 6, 1, 1].map(|numbers| vec![0.0; numbers * STEPS]);
    let mut out = Steps {
        mean: &mut mean,
        covariance: &mut covariance,
        innovation: &mut innovation,
        variance: &mut variance,
    };
    let summary = level.run(Fill { series, filter, out: &mut out });
    let all = [mean, covariance, innovation, variance, vec![summary.log_likelihood]];
    all.concat().into_iter().map(f64::to_bits).collect()
}

#[test]
fn a_series_has_the_same_bits_at_every_level() {
    let model = Singer::try_new(0.05, 0.003, false).unwrap();
    let plot = |i: usize| 359.0 + 0.01 * i as f64 + 0.1 * noise(i);
    let full: Vec<f64> = (0..STEPS).map(plot).collect();
    let gaps: Vec<f64> =
        (0..STEPS).map(|i| if i % 20 == 7 { f64::NAN } else { plot(i) % 360.0 }).collect();
    let own: Vec<f64> = (0..STEPS).map(|i| 0.01 + 1e-3 * (i % 7) as f64).collect();
    let transitions: Vec<_> =
        (1..STEPS).map(|i| model.over(1.0 + (i % 3) as f64).unwrap()).collect();
    let same = PerStep::Constant(model.over(5.0).unwrap());
    for (z, variance, transition, period) in [
        (&full, PerStep::Constant(0.01), same, None),
        (&gaps, PerStep::Constant(0.01), same, Some(360.0)),
        (&gaps, PerStep::Each(&own), same, Some(360.0)),
        (&full, PerStep::Each(&own), PerStep::Each(&transitions), None),
    ] {
        let series = Series { z, variance, transition };
        let [scalar, others @ ..] = &*Level::all() else { unreachable!() };
        let expected = bits(&series, period, *scalar);
        for level in others {
            assert!(bits(&series, period, *level) == expected);
        }
    }
}
