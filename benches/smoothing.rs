//! Cost of an instant: for local polynomials, and for the smoother with different numbers of axes.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use std::hint::black_box;
use tertia::smoothing::{
    Degree, Noise, Output, Polynomial, ProcessNoise, Record, Smoothed, Track, Workspace,
    fit_process_noise, smooth,
};

const STEPS: usize = 10_000;

fn series() -> Vec<f64> {
    (0..STEPS).map(|i| 0.01 * i as f64 + (i as f64 * 1.7).sin()).collect()
}

fn polynomials(c: &mut Criterion) {
    let y = series();
    let times: Vec<f64> = (0..STEPS).map(|i| i as f64 + 0.3 * (i as f64).sin()).collect();
    let (mut value, mut sigma, mut degree) = (vec![0.0; STEPS], vec![0.0; STEPS], vec![0; STEPS]);
    let mut group = c.benchmark_group("local polynomial, window 13");
    group.throughput(Throughput::Elements(STEPS as u64));
    for (name, chosen) in [("degree 2", Degree::Fixed(2)), ("adaptive", Degree::Adaptive(3))] {
        for (kind, times) in [("equal steps", None), ("irregular", Some(&times[..]))] {
            let mut polynomial = Polynomial::try_new(13, chosen, 0, 0.05).unwrap();
            let record = Record { y: black_box(&y), time: times, variance: None };
            group.bench_function(format!("{name}, {kind}"), |b| {
                b.iter(|| {
                    let mut out =
                        Output { value: &mut value, sigma: &mut sigma, degree: &mut degree };
                    polynomial.smooth(&record, &mut out).unwrap()
                });
            });
        }
    }
    group.finish();
}

fn tracks(c: &mut Criterion) {
    let times: Vec<f64> = (0..STEPS).map(|i| i as f64).collect();
    let mut group = c.benchmark_group("smoother");
    group.throughput(Throughput::Elements(STEPS as u64));
    group.sample_size(20);
    for d in 1..=3 {
        let y: Vec<f64> = series().iter().flat_map(|y| vec![*y; d]).collect();
        let mut covariance = vec![0.1; d * d];
        (0..d).for_each(|i| covariance[i * d + i] = 1.0);
        let noise = Noise::Same(&covariance);
        let mut mean = vec![0.0; STEPS * 3 * d];
        let mut matrices = vec![0.0; STEPS * 9 * d * d];
        let mut innovation = vec![0.0; STEPS * d];
        let mut workspace = Workspace::default();
        group.bench_function(format!("{d} axes"), |b| {
            b.iter(|| {
                let track = Track::try_new(d, &times, black_box(&y), noise, None).unwrap();
                let mut out = Smoothed {
                    mean: &mut mean,
                    covariance: &mut matrices,
                    innovation: &mut innovation,
                };
                smooth(&track, ProcessNoise::with_jerk(1e-3), &mut workspace, &mut out)
            });
        });
        let track = Track::try_new(d, &times, &y, noise, None).unwrap();
        group.bench_function(format!("{d} axes, fit of the motion"), |b| {
            b.iter(|| fit_process_noise(black_box(&track), &mut workspace));
        });
    }
    group.finish();
}

criterion_group!(all, polynomials, tracks);
criterion_main!(all);
