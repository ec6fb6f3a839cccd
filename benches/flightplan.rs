//! Cost of turns, projections, scores and the monitor, for different numbers of waypoints.

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use std::hint::black_box;
use tertia::flightplan::{Monitor, Route, Sighting, Turn, score};

/// Returns a route that turns left and right in turn.
fn route(count: usize) -> Route {
    let waypoints: Vec<[f64; 2]> =
        (0..count).map(|k| [4e4 * k as f64, if k % 2 == 0 { 0.0 } else { 3e4 }]).collect();
    Route::try_new(&waypoints, &vec![220.0; count - 1], 0.0, &[], 0.44, 0.05)
        .expect("waypoints differ and speeds are positive")
}

fn run(c: &mut Criterion) {
    let mut group = c.benchmark_group("flightplan");
    group.bench_function("turn", |b| {
        b.iter(|| {
            let turn = Turn::new(black_box([0.0, 0.0]), [0.0, 5e4], [5e4, 8e4], 220.0, 0.44, 0.05);
            turn.project([500.0, 46e3])
        });
    });
    for count in [4, 16, 64] {
        let route = route(count);
        let time = 0.4 * route.times()[count - 1];
        let (position, velocity) = route.at(time);
        let seen = Sighting::new(time, position, velocity, None, f64::NAN);
        let leg = route.project(position).leg;
        let id = |name| BenchmarkId::new(name, format!("{count} waypoints"));
        group.bench_function(id("at"), |b| b.iter(|| route.at(black_box(time))));
        group.bench_function(id("project"), |b| b.iter(|| route.project(black_box(position))));
        group.bench_function(id("score"), |b| b.iter(|| score(&route, black_box(&seen))));
        group.bench_function(id("monitor"), |b| {
            b.iter(|| Monitor::new(leg).update(&route, black_box(&seen), 0.0, 10.0));
        });
    }
    group.finish();
}

criterion_group!(all, run);
criterion_main!(all);
