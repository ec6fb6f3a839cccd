//! Cost of the conversion of radar plots to the system plane, with and without their derivatives.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use std::hint::black_box;
use tertia::geo::{Geodetic, LocalFrame, SystemPlane, View};

const PLOTS: usize = 10_000;

fn degrees(latitude: f64, longitude: f64, height: f64) -> Geodetic {
    Geodetic { latitude: latitude.to_radians(), longitude: longitude.to_radians(), height }
}

/// Returns reproducible ranges, azimuths and heights (Weyl sequences).
fn plots() -> Vec<[f64; 3]> {
    let step = [0.754_877_666, 0.569_840_291, 0.380_966_011];
    let low = [15e3, 0.0, 3e3];
    let span = [400e3, std::f64::consts::TAU, 9e3];
    (1..=PLOTS)
        .map(|i| std::array::from_fn(|k| low[k] + span[k] * (step[k] * i as f64).fract()))
        .collect()
}

fn earth(c: &mut Criterion) {
    let site = LocalFrame::new(degrees(50.1, 14.26, 380.0));
    let view = View::new(site, SystemPlane::new(degrees(50.0, 14.0, 0.0)));
    let plots = plots();
    let mut group = c.benchmark_group("geo, plots");
    group.throughput(Throughput::Elements(PLOTS as u64));
    group.bench_function("in the plane with covariance", |b| {
        b.iter(|| {
            for &[range, azimuth, height] in &plots {
                let seen = view.see(black_box(range), azimuth, height);
                black_box(seen.map(|seen| seen.covariance([50.0, 1e-3, 15.0])));
            }
        });
    });
    group.bench_function("as of a flat radar", |b| {
        b.iter(|| {
            for plot in &plots {
                black_box(view.flattened(*black_box(plot), 1e4));
            }
        });
    });
    group.bench_function("geodetic", |b| {
        b.iter(|| {
            for &[range, azimuth, height] in &plots {
                black_box(site.polar_to_geodetic(black_box(range), azimuth, height));
            }
        });
    });
    group.finish();
}

criterion_group!(benches, earth);
criterion_main!(benches);
