//! Cost of a step of the filter, depending on what is stored.

use adskalman::{
    KalmanFilterNoControl, ObservationModel, StateAndCovariance, TransitionModelLinearNoControl,
};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::{Matrix1, Matrix3, RowVector3, U1, U3, Vector3};
use std::hint::black_box;
use std::num::NonZero;
use tertia::kalman::{
    Batch, End, Filter, PerStep, Row, Series, Singer, State, Steps, Table, Workspace, smooth,
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
    side_by_side(c);
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

/// The Singer model for adskalman: H = (1, 0, 0), and the same R for all plots.
struct Peer {
    f: [Matrix3<f64>; 2],
    q: Matrix3<f64>,
    h: (RowVector3<f64>, Vector3<f64>),
    r: Matrix1<f64>,
}

impl TransitionModelLinearNoControl<f64, U3> for Peer {
    fn F(&self) -> &Matrix3<f64> {
        &self.f[0]
    }
    fn FT(&self) -> &Matrix3<f64> {
        &self.f[1]
    }
    fn Q(&self) -> &Matrix3<f64> {
        &self.q
    }
}

impl ObservationModel<f64, U3, U1> for Peer {
    fn H(&self) -> &RowVector3<f64> {
        &self.h.0
    }
    fn HT(&self) -> &Vector3<f64> {
        &self.h.1
    }
    fn R(&self) -> &Matrix1<f64> {
        &self.r
    }
}

/// Filters a series from a known state, with all states kept, in comparison with adskalman; the results
/// agree.
fn side_by_side(c: &mut Criterion) {
    let model = Singer::try_new(0.05, 0.003, false).unwrap();
    let transition = model.over(5.0).unwrap();
    let [f01, f02, f12, f22] = transition.f;
    let [q00, q01, q02, q11, q12, q22] = transition.q;
    let f = Matrix3::new(1.0, f01, f02, 0.0, 1.0, f12, 0.0, 0.0, f22);
    let peer = Peer {
        f: [f, f.transpose()],
        q: Matrix3::new(q00, q01, q02, q01, q11, q12, q02, q12, q22),
        h: (RowVector3::new(1.0, 0.0, 0.0), Vector3::x()),
        r: Matrix1::new(0.01),
    };
    let z: Vec<f64> = (0..STEPS).map(|i| 0.01 * i as f64 + (i as f64 * 1.7).sin()).collect();
    let plots: Vec<Matrix1<f64>> = z.iter().map(|&z| Matrix1::new(z)).collect();
    let before = StateAndCovariance::new(Vector3::zeros(), Matrix3::identity());
    // adskalman begins with a prediction
    let first = peer.predict(&before);
    let rows: [[f64; 3]; 3] = first.covariance().transpose().into();
    let start = State::try_new([0.0; 3], &rows).unwrap();
    let series = Series {
        z: black_box(&z),
        variance: PerStep::Constant(0.01),
        transition: PerStep::Constant(transition),
    };
    let (mut mean, mut covariance) = (vec![[0.0; 3]; STEPS], vec![[0.0; 6]; STEPS]);
    let mut states = vec![before.clone(); STEPS];
    let filter = KalmanFilterNoControl::new(&peer, &peer);
    let mut group = c.benchmark_group("kalman, one series");
    group.throughput(Throughput::Elements(STEPS as u64));
    group.bench_function("Tertia", |b| {
        b.iter(|| {
            series.run(Filter::from_state(start, None), |step, state, _| {
                mean[step] = state.mean;
                covariance[step] = state.covariance;
            })
        });
    });
    group.bench_function("adskalman", |b| {
        b.iter(|| filter.filter_inplace(&before, black_box(&plots), &mut states).unwrap());
    });
    group.finish();
    for (mean, state) in mean.iter().zip(&states) {
        assert!((mean[0] - state.state()[0]).abs() < 1e-9);
    }
}

criterion_group!(all, benches);
criterion_main!(all);
