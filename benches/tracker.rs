//! Cost of scans of plots: aircraft in straight flight, seen by four radars with a scan period of four
//! seconds.

mod traffic;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use std::hint::black_box;
use std::num::NonZero;
use tertia::tracker::{ImmModel, Motion, Settings, Tracker};
use traffic::{SPACING, radars, scans};

const SCANS: usize = 8;

fn tracker(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("tracker");
    group.sample_size(10);
    for (name, motion) in [("cv", Motion::Cv(0.1)), ("imm", Motion::Imm(ImmModel::default()))] {
        for aircraft in [100, 1000, 20_000] {
            let extent = SPACING * (aircraft as f64).sqrt();
            let settings = Settings::new(radars(extent), motion);
            let scans = scans(SCANS, aircraft, extent, &settings.radars);
            let (mut statuses, mut rows) = (Vec::new(), Vec::new());
            let mut ready = Tracker::try_new(settings).expect("they are right");
            for plots in &scans[..SCANS - 1] {
                ready
                    .track(&plots[..], None, &mut statuses, &mut rows, NonZero::new(1))
                    .expect("they are right");
            }
            let last = &scans[SCANS - 1];
            group.throughput(Throughput::Elements(last.len() as u64));
            group.bench_function(BenchmarkId::new(name, aircraft), |bencher| {
                bencher.iter_batched_ref(
                    || ready.clone(),
                    |tracker| {
                        rows.clear();
                        tracker.track(
                            black_box(&last[..]),
                            None,
                            &mut statuses,
                            &mut rows,
                            NonZero::new(1),
                        )
                    },
                    criterion::BatchSize::LargeInput,
                );
            });
        }
    }
    group.finish();
}

criterion_group!(benches, tracker);
criterion_main!(benches);
