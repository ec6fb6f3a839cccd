//! Cost of a position, for different numbers of stations, in the plane and in space.

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use std::hint::black_box;
use tertia::location::{Instant, Locator, Method, Output, Workspace};
use tertia::sensors::KINDS;

/// Returns stations on a circle, and their measurements of a target beside its centre.
fn instant<const D: usize>(count: usize) -> (Vec<f64>, Vec<f64>, Vec<f64>) {
    let (mut stations, mut values) = (vec![0.0; count * D], vec![f64::NAN; KINDS * count]);
    for k in 0..count {
        let (sine, cosine) = (k as f64 / count as f64 * std::f64::consts::TAU).sin_cos();
        stations[k * D] = 2000.0 * sine;
        stations[k * D + 1] = 2000.0 * cosine;
        let (east, north) = (300.0 - stations[k * D], 400.0 - stations[k * D + 1]);
        let (level, up) = (east.hypot(north), if D == 3 { 500.0 } else { 0.0 });
        values[k] = level.hypot(up) + (k % 3) as f64;
        values[count + k] = east.atan2(north) + 1e-3 * (k % 2) as f64;
        if D == 3 {
            values[2 * count + k] = up.atan2(level);
        }
    }
    let sigma = |i: usize| if i < count { 10.0 } else { 0.005 };
    (stations, values, (0..KINDS * count).map(sigma).collect())
}

fn run<const D: usize>(c: &mut Criterion) {
    let mut group = c.benchmark_group("location");
    for count in [2, 4, 8, 32] {
        let (stations, values, sigmas) = instant::<D>(count);
        let instant = Instant {
            stations: &stations,
            axes: None,
            values: &values,
            sigmas: &sigmas,
            position_sigmas: None,
            height: None,
            initial: None,
        };
        let (mut position, mut covariance) = ([0.0; D], vec![0.0; D * D]);
        let (mut residual, mut outlier) = (values.clone(), vec![false; values.len()]);
        let mut workspace = Workspace::<D>::default();
        for (name, method) in
            [("robust", Method::Robust(3)), ("least squares", Method::LeastSquares)]
        {
            let id = BenchmarkId::new(name, format!("{count} stations, D = {D}"));
            group.bench_function(id, |b| {
                b.iter(|| {
                    let mut out = Output {
                        position: &mut position,
                        covariance: &mut covariance,
                        residual: &mut residual,
                        outlier: &mut outlier,
                    };
                    Locator::new(method).locate(black_box(&instant), &mut out, &mut workspace)
                });
            });
        }
    }
    group.finish();
}

criterion_group!(all, run::<2>, run::<3>);
criterion_main!(all);
