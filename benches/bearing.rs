//! Cost of one bearing from 100 measurements, for each method.

use criterion::{Criterion, criterion_group, criterion_main};
use std::hint::black_box;
use tertia::bearing::{
    BlockOutput, Estimator, Known, Method, PaperRule, RobustRule, VarianceTest, Workspace,
};

/// Returns bearings about north with a burst and two single anomalies.
fn record() -> Vec<f64> {
    let noise = |i: usize| 3.4 * ((i * i * 7 + i * 3) % 97) as f64 / 28.0 - 5.9;
    let anomaly = |i: usize| match i {
        17 | 80 => 15.0,
        40..47 => -14.0,
        _ => 0.0,
    };
    (0..100).map(|i| (360.0 + noise(i) + anomaly(i)) % 360.0).collect()
}

fn benches(c: &mut Criterion) {
    let variance_test = VarianceTest::Cochran(0.05);
    let rule = PaperRule { k: 2.5, block_size: 10, variance_test };
    let theta = record();
    let mut group = c.benchmark_group("bearing of 100");
    for (name, method) in [
        ("mean", Method::Mean),
        ("k-sigma", Method::KSigma(2.5)),
        ("paper", Method::Paper(rule)),
        ("corrected", Method::Corrected(rule, 0.05)),
        ("robust", Method::Robust(RobustRule { block_size: 10, rounding: 0.0 })),
    ] {
        let estimator = Estimator::try_new(method, Some(360.0), None).unwrap();
        let mut outlier = [false; 100];
        let [mut mean, mut variance, mut weight] =
            [(); 3].map(|()| vec![0.0; estimator.blocks(theta.len())]);
        let mut workspace = Workspace::default();
        group.bench_function(name, |b| {
            b.iter(|| {
                let mut output =
                    BlockOutput { mean: &mut mean, variance: &mut variance, weight: &mut weight };
                let theta = black_box(&theta);
                estimator
                    .estimate(theta, Known::default(), &mut outlier, &mut output, &mut workspace)
                    .unwrap()
            });
        });
    }
    group.finish();
}

criterion_group!(all, benches);
criterion_main!(all);
