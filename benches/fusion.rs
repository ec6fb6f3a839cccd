//! Cost of a plot of one radar, for different rules and numbers of radars.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use std::hint::black_box;
use tertia::fusion::{Beliefs, Centre, RadarReport, Rule};
use tertia::kalman::{Filter, Singer, Transition};

const STEPS: usize = 1_000;
const RULES: [Rule; 10] = [
    Rule::Equal,
    Rule::Static,
    Rule::Paper,
    Rule::Ewma,
    Rule::Posterior,
    Rule::Adaptive,
    Rule::AdaptiveMatrix,
    Rule::Matrix,
    Rule::CovarianceIntersection,
    Rule::Central,
];

/// Returns the plots of this number of radars, scan by scan.
fn plots(radars: usize) -> Vec<f64> {
    let plot = |at: usize| 0.01 * (at / radars) as f64 + 0.1 * (at as f64 * 1.7).sin();
    (0..radars * STEPS).map(plot).collect()
}

fn run(mut centre: Centre, transition: &Transition, plots: &[f64], r: &[f64]) -> f64 {
    let mut reports = vec![RadarReport::NONE; r.len()];
    let mut sum = 0.0;
    for scan in plots.chunks_exact(r.len()) {
        centre.predict(transition);
        sum += centre.update(scan, r, &mut reports).mean[0];
    }
    sum
}

fn benches(c: &mut Criterion) {
    let model = Singer::try_new(0.05, 0.003, false).unwrap();
    let transition = model.over(5.0).unwrap();
    let beliefs = Beliefs::try_new(0.9, 1.6, 16.0, 0.005).unwrap();
    let mut group = c.benchmark_group("fusion");
    for radars in [2, 4] {
        let (plots, r) = (plots(radars), vec![0.01; radars]);
        group.throughput(Throughput::Elements((STEPS * radars) as u64));
        for rule in RULES {
            let filters = vec![Filter::new(model.acceleration_variance(), None); radars];
            let centre = Centre::new(filters, rule, beliefs, None);
            group.bench_function(BenchmarkId::new(format!("{rule:?}"), radars), |b| {
                b.iter(|| run(centre.clone(), &transition, black_box(&plots), &r));
            });
        }
    }
    group.finish();
}

criterion_group!(all, benches);
criterion_main!(all);
