//! Cost of the plot index, of gating and of assignment, for a scan of many tracks and plots.

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use std::hint::black_box;
use tertia::association::gate::{Scan, pairs, threshold};
use tertia::association::{Assigner, Grid, Pair};

/// Side of the area, m.
const EXTENT: f64 = 6e5;
/// Standard deviation of an innovation, m.
const SIGMA: f64 = 300.0;

/// Returns reproducible points in the area (Weyl sequences).
fn points(count: usize, step: [f64; 2]) -> Vec<[f64; 2]> {
    (1..=count).map(|i| step.map(|s| EXTENT * (s * i as f64).fract())).collect()
}

fn scene(count: usize) -> (Vec<[f64; 2]>, Vec<[f64; 2]>) {
    let plots = points(count, [0.754_877_666, 0.569_840_291]);
    let near =
        |p: &[f64; 2], i: usize| [p[0] + (i % 7) as f64 * 60.0, p[1] - (i % 5) as f64 * 60.0];
    let tracks = plots.iter().enumerate().map(|(i, p)| near(p, i)).collect();
    (tracks, plots)
}

fn grid(c: &mut Criterion) {
    let mut group = c.benchmark_group("association, index");
    for count in [1_000, 20_000] {
        let (tracks, plots) = scene(count);
        let half = SIGMA * threshold(0.998, 2).unwrap_or(0.0).sqrt();
        let mut grid = Grid::default();
        group.bench_function(BenchmarkId::new("build", count), |b| {
            b.iter(|| grid.fill(black_box(&plots), 2.0 * half));
        });
        group.bench_function(BenchmarkId::new("as many queries", count), |b| {
            b.iter(|| {
                let mut found = 0;
                for track in &tracks {
                    grid.within(*track, [half; 2], &mut |i| found += i);
                }
                found
            });
        });
    }
    group.finish();
}

fn gating(c: &mut Criterion) {
    let mut group = c.benchmark_group("association, gating");
    for count in [1_000, 20_000] {
        let (tracks, plots) = scene(count);
        let sigmas = [SIGMA * SIGMA, 0.0, 0.0, SIGMA * SIGMA].repeat(count);
        let scan = Scan {
            predicted: tracks.as_flattened(),
            covariance: &sigmas,
            plots: plots.as_flattened(),
            plot_covariance: None,
        };
        group.bench_function(BenchmarkId::new("pairs", count), |b| {
            b.iter(|| pairs::<2>(black_box(&scan), 12.43));
        });
    }
    group.finish();
}

fn assignment(c: &mut Criterion) {
    let mut group = c.benchmark_group("association, assignment");
    let mut assigner = Assigner::default();
    for count in [1_000, 20_000] {
        let (tracks, plots) = scene(count);
        let mut sparse = Vec::new();
        if let Ok(grid) = Grid::new(&plots, 2000.0) {
            for (row, track) in tracks.iter().enumerate() {
                grid.within(*track, [2000.0; 2], &mut |column| {
                    let [x, y] = [0, 1].map(|i| plots[column][i] - track[i]);
                    let gain = 4e6 - x * x - y * y;
                    sparse.push(Pair { row: row as u32, column: column as u32, gain });
                });
            }
        }
        group.bench_function(BenchmarkId::new("gnn", count), |b| {
            b.iter(|| assigner.assign(black_box(&sparse), count, count).len());
        });
        group.bench_function(BenchmarkId::new("nearest", count), |b| {
            b.iter(|| assigner.nearest(black_box(&sparse), count, count).len());
        });
    }
    for count in [10_u32, 100, 300] {
        let worth = |row, column| 1.0 + (0.618_033_989 * f64::from(row * count + column)).fract();
        let dense: Vec<Pair> = (0..count)
            .flat_map(|row| (0..count).map(move |column| (row, column)))
            .map(|(row, column)| Pair { row, column, gain: worth(row, column) })
            .collect();
        group.bench_function(BenchmarkId::new("gnn, all with all", count), |b| {
            b.iter(|| assigner.assign(black_box(&dense), count as usize, count as usize).len());
        });
    }
    group.finish();
}

criterion_group!(all, grid, gating, assignment);
criterion_main!(all);
