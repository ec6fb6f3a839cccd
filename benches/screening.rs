//! Cost of the screening kernels per measurement, for lengths from 10² to 10⁷.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use std::hint::black_box;
use tertia::screening::{
    BurstRule, BurstWorkspace, Direction, KSigmaRule, LeaveOneOutRule, Replacement, Statistics,
    mask, statistics, unwrap_about_median,
};

const LENGTHS: [usize; 6] = [100, 1_000, 10_000, 100_000, 1_000_000, 10_000_000];

/// Returns approximately normal noise, in which one value in fifty is off by six standard deviations.
fn sample(n: usize) -> Vec<f64> {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut uniform = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    (0..n)
        .map(|_| {
            let noise = (0..4).map(|_| uniform()).sum::<f64>() * 3.0_f64.sqrt();
            noise + if uniform() < 0.02 { 6.0 } else { 0.0 }
        })
        .collect()
}

fn lengths(c: &mut Criterion, name: &str, longest: usize, mut run: impl FnMut(&[f64])) {
    let mut group = c.benchmark_group(name);
    for n in LENGTHS.into_iter().filter(|&n| n <= longest) {
        let y = sample(n);
        group.sample_size(if n > 100_000 { 10 } else { 50 });
        group.throughput(Throughput::Elements(n as u64));
        group.bench_with_input(BenchmarkId::from_parameter(n), &y, |b, y| {
            b.iter(|| run(black_box(y)));
        });
    }
    group.finish();
}

fn benches(c: &mut Criterion) {
    let mut flags = vec![false; 10_000_000];
    let (mut first, mut second) = (vec![0.0; 10_000_000], vec![0.0; 10_000_000]);
    let mut scratch = Vec::new();

    lengths(c, "mask", 10_000_000, |y| mask(y, 2.5, &mut flags[..y.len()]).unwrap());
    lengths(c, "statistics", 10_000_000, |y| {
        statistics(y, &mut first[..y.len()], &mut second[..y.len()]).unwrap();
    });
    let rule = LeaveOneOutRule::try_new(2.5, Statistics::Sequential, Direction::Forward, true, 1);
    let rule = rule.unwrap();
    lengths(c, "leave_one_out", 1_000_000, |y| {
        rule.screen(y, &mut flags[..y.len()], &mut first[..y.len()], &mut scratch).unwrap();
    });
    let rule = KSigmaRule::try_new(3.0, Replacement::Neighbours).unwrap();
    lengths(c, "k_sigma", 1_000_000, |y| {
        rule.screen(y, &mut flags[..y.len()], &mut first[..y.len()], &mut scratch).unwrap();
    });
    let rule = BurstRule::try_new(2.5, 3.0, (2, 20), 0.0, 0.0).unwrap();
    let mut workspace = BurstWorkspace::default();
    lengths(c, "bursts", 100_000, |y| {
        rule.screen(y, &mut flags[..y.len()], &mut first[..y.len()], &mut workspace).unwrap();
    });
    lengths(c, "unwrap_about_median", 1_000_000, |y| {
        unwrap_about_median(y, 360.0, &mut first[..y.len()], &mut scratch).unwrap();
    });
}

criterion_group!(all, benches);
criterion_main!(all);
