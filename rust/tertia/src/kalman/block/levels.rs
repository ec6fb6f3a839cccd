//! Tests that results have the same bits with the instructions of every processor.

use super::super::model::Singer;
use super::super::state::State;
use super::*;
use crate::base::checks::Level;
use crate::base::random::noise;

const COUNT: usize = 50;
const STEPS: usize = 90;

struct Case<'a> {
    series: Vec<Series<'a>>,
    filters: Vec<Filter>,
    gains: Option<Gains>,
    /// Whether all states are kept.
    all: bool,
}

/// Returns the bits of all results of a block.
fn bits(case: &Case<'_>, level: Level) -> Vec<u64> {
    let kept = if case.all { STEPS } else { 0 };
    let mut numbers = [3, 6, 1, 1].map(|n| vec![0.0; n * kept * COUNT]);
    let mut rows: Vec<Steps<'_>> = {
        let [mean, covariance, innovation, variance] = &mut numbers;
        let mut rest = [&mut **mean, covariance, innovation, variance];
        let mut next = |at: usize, n: usize| rest[at].split_off_mut(..n * kept).unwrap();
        (0..COUNT)
            .map(|_| Steps {
                mean: next(0, 3),
                covariance: next(1, 6),
                innovation: next(2, 1),
                variance: next(3, 1),
            })
            .collect()
    };
    let mut out: Vec<_> = rows.iter_mut().collect();
    let (series, filters) = (&*case.series, &*case.filters);
    let start = series.iter().zip(filters).map(|(s, f)| known_from(s, f)).max().unwrap();
    let (gains, out, buffer) = (case.gains.as_ref(), &mut *out, &mut Vec::new());
    let summaries = level.run(Run { series, filters, gains, start, out, buffer }).unwrap();
    let ends = summaries.iter().flat_map(|summary| {
        let State { mean, covariance } = summary.filter.state();
        [&mean[..], &covariance, &[summary.log_likelihood]].concat()
    });
    let ends: Vec<f64> = ends.collect();
    numbers.concat().into_iter().chain(ends).map(f64::to_bits).collect()
}

#[test]
fn a_block_has_the_same_bits_at_every_level() {
    let model = Singer::try_new(0.05, 0.003, false).unwrap();
    let plot = |i: usize| 0.01 * (i % STEPS) as f64 + 0.1 * noise(i);
    let full: Vec<f64> = (0..COUNT * STEPS).map(plot).collect();
    let gaps: Vec<f64> = (0..COUNT * STEPS)
        .map(|i| if i % STEPS == 5 + i / STEPS { f64::NAN } else { plot(i) })
        .collect();
    let own: Vec<f64> = (0..STEPS).map(|i| 0.01 + 1e-3 * (i % 7) as f64).collect();
    let transition = PerStep::Constant(model.over(5.0).unwrap());
    let filter = Filter::new(model.acceleration_variance(), None);
    for (z, variance, in_common) in [
        (&full, PerStep::Constant(0.01), true),
        (&full, PerStep::Constant(0.01), false),
        (&gaps, PerStep::Each(&own), false),
    ] {
        let series: Vec<_> = z.chunks(STEPS).map(|z| Series { z, variance, transition }).collect();
        for all in [false, true] {
            let gains = in_common.then(|| Gains::new(&series[0], filter));
            let case = Case { series: series.clone(), filters: vec![filter; COUNT], gains, all };
            let [scalar, others @ ..] = &*Level::all() else { unreachable!() };
            let expected = bits(&case, *scalar);
            for level in others {
                assert!(bits(&case, *level) == expected);
            }
        }
    }
}
