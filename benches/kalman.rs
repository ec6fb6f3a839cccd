//! Cost of a step of the filter, by what is stored.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use std::hint::black_box;
use std::num::NonZero;
use tertia::kalman::{
    Batch, End, Filter, PerStep, Row, Series, Singer, Steps, Table, Workspace, smooth,
};

const STEPS: usize = 10_000;

fn benches(c: &mut Criterion) {
    let model = Singer::try_new(0.05, 0.003, false).unwrap();
    let transition = model.over(5.0).unwrap();
    let z: Vec<f64> = (0..STEPS).map(|i| 0.01 * i as f64 + (i as f64 * 1.7).sin()).collect();
    let variances: Vec<f64> = (0..STEPS).map(|i| 0.01 + 1e-5 * (i % 7) as f64).collect();
    let mut mean = vec![[0.0; 3]; STEPS];
    let mut covariance = vec![[0.0; 6]; STEPS];
    let mut group = c.benchmark_group("kalman");
    group.throughput(Throughput::Elements(STEPS as u64));
    for (name, variance) in
        [("constant", PerStep::Constant(0.01)), ("varying", PerStep::Each(&variances))]
    {
        let transition = PerStep::Constant(transition);
        let series = Series { z: black_box(&z), variance, transition };
        let new = || Filter::new(model.acceleration_variance(), None);
        group.bench_function(format!("{name} noise, final state"), |b| {
            b.iter(|| series.run(new(), |_, _, _| {}));
        });
        group.bench_function(format!("{name} noise, means and covariances"), |b| {
            b.iter(|| {
                series.run(new(), |step, state, _| {
                    mean[step] = state.mean;
                    covariance[step] = state.covariance;
                })
            });
        });
        let mut workspace = Workspace::default();
        group.bench_function(format!("{name} noise, smoothed"), |b| {
            b.iter(|| {
                smooth(&series, new(), &mut workspace, |step, state| {
                    mean[step] = state.mean;
                    covariance[step] = state.covariance;
                });
            });
        });
    }
    group.finish();
    blocks(c);
}

fn blocks(c: &mut Criterion) {
    const SERIES: usize = 16;
    const N: usize = 200;
    let model = Singer::try_new(0.05, 0.003, false).unwrap();
    let plots: Vec<f64> = (0..SERIES * N)
        .map(|i| if i % 50 == 7 { f64::NAN } else { 0.01 * (i % N) as f64 + (i as f64).sin() })
        .collect();
    let (variance, dt) = (Table::new(&[0.01], 1), Table::new(&[5.0], 1));
    let batch = Batch::try_new((&plots, N, SERIES), variance, dt, None, model, None).unwrap();
    let mut mean = vec![0.0; 3 * SERIES * N];
    let mut covariance = vec![0.0; 6 * SERIES * N];
    let mut group = c.benchmark_group("kalman, blocks");
    group.throughput(Throughput::Elements((SERIES * N) as u64));
    for (name, room) in [("final state", 0), ("means and covariances", N)] {
        group.bench_function(name, |b| {
            let mut rows: Vec<_> = mean
                .chunks_mut(3 * N)
                .zip(covariance.chunks_mut(6 * N))
                .map(|(mean, covariance)| {
                    let (mean, covariance) = (&mut mean[..3 * room], &mut covariance[..6 * room]);
                    let (innovation, variance) = (&mut [][..], &mut [][..]);
                    Row { steps: Steps { mean, covariance, innovation, variance }, end: End::NONE }
                })
                .collect();
            b.iter(|| batch.filter(black_box(&mut rows), 0.0, NonZero::new(1)));
        });
    }
    group.finish();
}

criterion_group!(all, benches);
criterion_main!(all);
