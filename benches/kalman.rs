//! Cost of a step of the filter, by what is stored.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use std::hint::black_box;
use tertia::kalman::{Filter, LANES, PerStep, Series, Singer, Steps, Workspace, run_block, smooth};

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
    const N: usize = 200;
    let model = Singer::try_new(0.05, 0.003, false).unwrap();
    let transition = PerStep::Constant(model.over(5.0).unwrap());
    let plots: Vec<f64> = (0..LANES * N)
        .map(|i| if i % 50 == 7 { f64::NAN } else { 0.01 * (i % N) as f64 + (i as f64).sin() })
        .collect();
    let rows: Vec<_> = plots.chunks_exact(N).collect();
    let variance = PerStep::Constant(0.01);
    let series: [_; LANES] = std::array::from_fn(|l| Series { z: rows[l], variance, transition });
    let filters = [Filter::new(model.acceleration_variance(), None); LANES];
    let mut mean = vec![0.0; 3 * LANES * N];
    let mut covariance = vec![0.0; 6 * LANES * N];
    let mut group = c.benchmark_group("kalman, blocks");
    group.throughput(Throughput::Elements((LANES * N) as u64));
    for (name, room) in [("final state", 0), ("means and covariances", N)] {
        group.bench_function(name, |b| {
            let mut out: Vec<_> = mean
                .chunks_mut(3 * N)
                .zip(covariance.chunks_mut(6 * N))
                .map(|(mean, covariance)| Steps {
                    mean: &mut mean[..3 * room],
                    covariance: &mut covariance[..6 * room],
                    innovation: &mut [],
                    variance: &mut [],
                })
                .collect();
            b.iter(|| {
                let mut out: Vec<_> = out.iter_mut().collect();
                run_block(&series, &filters, None, &mut out)
            });
        });
    }
    group.finish();
}

criterion_group!(all, benches);
criterion_main!(all);
