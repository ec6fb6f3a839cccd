//! Cost of weights, their Jacobian and their covariance, for different dimensions and numbers of sensors.

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use std::hint::black_box;
use tertia::weights::{Quantity, weighing};

/// Returns the covariances of this number of sensors: diagonal, with a few correlations.
fn covariances(sensors: usize, m: usize) -> Vec<f64> {
    let element = |k: usize, i: usize, j: usize| match i.abs_diff(j) {
        0 => 2.0 + ((k + i) % 3) as f64,
        1 => 0.3 + 0.2 * (k % 2) as f64,
        _ => 0.0,
    };
    (0..sensors * m * m).map(|at| element(at / (m * m), at / m % m, at % m)).collect()
}

fn benches(c: &mut Criterion) {
    let mut group = c.benchmark_group("weights");
    for (sensors, m) in [(2, 1), (2, 2), (2, 3), (2, 6), (2, 9), (2, 16), (4, 3)] {
        let s = covariances(sensors, m);
        let factors = vec![1.0 / 29.0; sensors];
        let mut solver = weighing(sensors, m);
        let name = format!("{sensors} sensors, m = {m}");
        for (quantity, what) in [
            ("weights", Quantity::Weights),
            ("jacobian", Quantity::Jacobian { sensor: 1 }),
            ("covariance", Quantity::WeightCovariance { sensor: 1, c: &factors }),
        ] {
            let mut out = vec![0.0; what.shape(sensors, m).iter().product()];
            group.bench_function(BenchmarkId::new(quantity, &name), |b| {
                b.iter(|| solver.compute(&what, black_box(&s), &mut out).unwrap());
            });
        }
    }
    group.finish();
}

criterion_group!(all, benches);
criterion_main!(all);
