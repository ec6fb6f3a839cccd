//! Kernels whose instructions `benches/instructions.py` counts. `instructions KERNEL TIMES`
//! runs one of them this number of times; `instructions` alone prints their names.

mod traffic;

use std::f64::consts::TAU;
use std::hint::black_box;
use std::num::NonZero;
use tertia::association::gate::{Scan, pairs, threshold};
use tertia::association::{Assigner, Pair};
use tertia::bearing::{BlockOutput, Estimator, Known, Method, RobustRule};
use tertia::fusion::{Beliefs, Centre, RadarReport, Rule};
use tertia::kalman::{Batch, End, Filter, PerStep, Row, Series, Singer, Steps, Table, smooth};
use tertia::location::{Instant, Locator, Output};
use tertia::registration::{Errors, Periods, Prior, Report, TargetPlot, register};
use tertia::screening::mask;
use tertia::sensors::{Identities, KINDS};
use tertia::smoothing::{self, Noise, Options, ProcessNoise, Smoothed, Track};
use tertia::tertiary;
use tertia::tracker::{ImmModel, Motion, Settings, Tracker};
use traffic::{SPACING, radars, scans};

type Kernel = Box<dyn FnMut()>;
type Prepare = fn() -> Kernel;

const ONE: Option<NonZero<usize>> = NonZero::new(1);
const KERNELS: [(&str, Prepare); 17] = [
    ("mask", || masks(1, 100_000)),
    ("mask batch", || masks(400, 100)),
    ("estimate_bearing", bearings),
    ("weight covariance", weight_covariances),
    ("filter one series", one_series),
    ("filter block final", || blocks(0)),
    ("filter block all", || blocks(STEPS)),
    ("smooth_series", smoothed_series),
    ("fuse_series robust", fused_series),
    ("locate robust", positions),
    ("associate", associations),
    ("tracker scan", tracks),
    ("smooth", || smoothed_track(1e-3)),
    ("smooth by rows", || smoothed_track(0.0)),
    ("smooth and noise", noisy_track),
    ("register", registered),
    ("centre cycle", pictures),
];
/// Number of steps of a series in a block.
const STEPS: usize = 200;

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [name, times] = &words[..] else {
        return KERNELS.iter().for_each(|(name, _)| println!("{name}"));
    };
    let times: usize = times.parse().expect("a number of times");
    let (_, prepare) = KERNELS.iter().find(|(known, _)| known == name).expect("a name of a kernel");
    let mut kernel = prepare();
    (0..times).for_each(|_| kernel());
}

/// Reproducible noise between -1.8 and 1.8.
fn noise(i: usize) -> f64 {
    let golden = |factor: f64| (i as f64 * factor).fract() - 0.5;
    1.8 * (golden(0.618_033_988_7) + golden(0.754_877_666_2))
}

fn masks(rows: usize, n: usize) -> Kernel {
    let wrong = |i: usize| if i % 53 == 7 { 6.0 } else { 0.0 };
    let y: Vec<f64> = (0..rows * n).map(|i| noise(i) + wrong(i)).collect();
    let mut outlier = vec![false; y.len()];
    Box::new(move || {
        for (y, outlier) in black_box(&y).chunks(n).zip(outlier.chunks_mut(n)) {
            mask(y, 2.5, outlier).unwrap();
        }
    })
}

fn bearings() -> Kernel {
    const RECORDS: usize = 5;
    let anomaly = |i: usize| match i % 100 {
        17 | 80 => 15.0,
        40..47 => -14.0,
        _ => 0.0,
    };
    let theta: Vec<f64> =
        (0..100 * RECORDS).map(|i| (360.0 + 3.0 * noise(i) + anomaly(i)) % 360.0).collect();
    let method = Method::Robust(RobustRule { block_size: 10, rounding: 0.0 });
    let estimator = Estimator::try_new(method, Some(360.0), None).unwrap();
    let mut blocks = [(); 3].map(|()| vec![0.0; estimator.blocks(100)]);
    let (mut outlier, mut workspace) = ([false; 100], Default::default());
    Box::new(move || {
        for theta in black_box(&theta).chunks(100) {
            let [mean, variance, weight] = &mut blocks;
            let mut out = BlockOutput { mean, variance, weight };
            estimator
                .estimate(theta, Known::default(), &mut outlier, &mut out, &mut workspace)
                .unwrap();
        }
    })
}

fn weight_covariances() -> Kernel {
    use tertia::weights::{Quantity, weighing};
    const M: usize = 3;
    let mut solver = weighing(2, M);
    let problem = |at: usize| {
        (0..2 * M * M).map(move |i| match (i / M % M).abs_diff(i % M) {
            0 => 2.0 + ((at + i) % 3) as f64,
            1 => 0.3,
            _ => 0.1,
        })
    };
    let covariances: Vec<f64> = (0..500).flat_map(problem).collect();
    let mut out = vec![0.0; M.pow(4)];
    Box::new(move || {
        let what = Quantity::WeightCovariance { sensor: 1, c: &[1.0 / 29.0; 2] };
        out.resize(what.shape(2, M).iter().product(), 0.0);
        for covariances in black_box(&covariances).chunks(2 * M * M) {
            solver.compute(&what, covariances, &mut out).unwrap();
        }
    })
}

fn model() -> Singer {
    Singer::try_new(0.05, 0.003, false).unwrap()
}

/// Returns plots of a moving target, one in twenty missing, and their variances.
fn plots(count: usize) -> (Vec<f64>, Vec<f64>) {
    let plot = |i: usize| if i % 20 == 7 { f64::NAN } else { 0.01 * i as f64 + noise(i) / 10.0 };
    let variance = |i: usize| 0.01 + 1e-5 * (i % 7) as f64;
    ((0..count).map(plot).collect(), (0..count).map(variance).collect())
}

fn series<'a>(z: &'a [f64], variances: &'a [f64]) -> (Series<'a>, Filter) {
    let transition = PerStep::Constant(model().over(5.0).unwrap());
    let series = Series { z: black_box(z), variance: PerStep::Each(variances), transition };
    (series, Filter::new(model().acceleration_variance(), None))
}

fn one_series() -> Kernel {
    let (z, variances) = plots(10_000);
    let mut states = vec![([0.0; 3], [0.0; 6]); z.len()];
    Box::new(move || {
        let (series, filter) = series(&z, &variances);
        series.run(filter, |step, state, _| states[step] = (state.mean, state.covariance));
    })
}

fn smoothed_series() -> Kernel {
    let (z, variances) = plots(2_000);
    let mut states = vec![([0.0; 3], [0.0; 6]); z.len()];
    let mut workspace = Default::default();
    Box::new(move || {
        let (series, filter) = series(&z, &variances);
        smooth(&series, filter, &mut workspace, |step, state| {
            states[step] = (state.mean, state.covariance);
        });
    })
}

/// Filters many series, and keeps the states of this number of steps of each.
fn blocks(kept: usize) -> Kernel {
    const COUNT: usize = 256;
    let (z, variances) = plots(COUNT * STEPS);
    let [mut mean, mut covariance, mut innovation, mut variance] =
        [3, 6, 1, 1].map(|numbers| vec![0.0; numbers * COUNT * kept]);
    Box::new(move || {
        let tables = (Table::new(&variances, STEPS), Table::new(&[5.0], 1));
        let batch =
            Batch::try_new((&z, STEPS, COUNT), tables.0, tables.1, None, model(), None).unwrap();
        let [mean, covariance, innovation, variance] =
            [&mut mean, &mut covariance, &mut innovation, &mut variance]
                .map(|values| shares(values, COUNT).into_iter());
        let mut rows: Vec<Row> = mean
            .zip(covariance)
            .zip(innovation.zip(variance))
            .map(|((mean, covariance), (innovation, variance))| Row {
                steps: Steps { mean, covariance, innovation, variance },
                end: End::NONE,
            })
            .collect();
        batch.filter(black_box(&mut rows), 0.0, ONE).unwrap();
    })
}

/// Divides a slice into equal parts, which may be empty.
fn shares(mut values: &mut [f64], count: usize) -> Vec<&mut [f64]> {
    let length = values.len() / count;
    let mut next = || values.split_off_mut(..length).unwrap();
    (0..count).map(|_| next()).collect()
}

fn fused_series() -> Kernel {
    const RADARS: usize = 3;
    let (z, _) = plots(RADARS * STEPS);
    let transition = model().over(5.0).unwrap();
    let beliefs = Beliefs::try_new(0.9, 1.6, 16.0, 0.005).unwrap();
    let filters = vec![Filter::new(model().acceleration_variance(), None); RADARS];
    let start = Centre::new(filters, Rule::Robust, beliefs, None);
    let mut reports = vec![RadarReport::NONE; RADARS];
    Box::new(move || {
        let mut centre = start.clone();
        for scan in black_box(&z).chunks(RADARS) {
            centre.predict(&transition);
            black_box(centre.update(scan, &[0.01; RADARS], &mut reports));
        }
    })
}

/// Locates from ranges, azimuths and elevations of eight stations on a circle; one in twenty is wrong.
fn positions() -> Kernel {
    const COUNT: usize = 8;
    const INSTANTS: usize = 50;
    let at = |k: usize| (TAU * k as f64 / COUNT as f64).sin_cos();
    let stations: Vec<f64> =
        (0..COUNT).flat_map(|k| [2000.0 * at(k).0, 2000.0 * at(k).1, 0.0]).collect();
    let mut values = vec![f64::NAN; KINDS * COUNT * INSTANTS];
    for (t, values) in values.chunks_mut(KINDS * COUNT).enumerate() {
        for (k, station) in stations.chunks(3).enumerate() {
            let [east, north, up] = [300.0 + t as f64 - station[0], 400.0 - station[1], 500.0];
            let (i, level) = (3 * (COUNT * t + k), east.hypot(north));
            let fault = |i: usize| if i % 20 == 11 { 30.0 } else { noise(i) };
            values[k] = level.hypot(up) + 10.0 * fault(i);
            values[COUNT + k] = east.atan2(north) + 0.005 * fault(i + 1);
            values[2 * COUNT + k] = up.atan2(level) + 0.005 * fault(i + 2);
        }
    }
    let sigma = |i: usize| if i < COUNT { 10.0 } else { 0.005 };
    let sigmas: Vec<f64> = (0..KINDS * COUNT).map(sigma).collect();
    let (mut position, mut covariance) = ([0.0; 3], [0.0; 9]);
    let (mut residual, mut outlier) = ([0.0; KINDS * COUNT], [false; KINDS * COUNT]);
    let mut workspace = Default::default();
    Box::new(move || {
        for values in black_box(&values).chunks(KINDS * COUNT) {
            let instant = Instant {
                stations: &stations,
                axes: None,
                values,
                sigmas: &sigmas,
                position_sigmas: None,
                height: None,
                initial: None,
            };
            let mut out = Output {
                position: &mut position,
                covariance: &mut covariance,
                residual: &mut residual,
                outlier: &mut outlier,
            };
            let locator = Locator::new(tertia::location::Method::Robust(3));
            black_box(locator.locate::<3>(&instant, &mut out, &mut workspace));
        }
    })
}

/// Gates plots near a thousand tracks, and assigns them.
fn associations() -> Kernel {
    const COUNT: usize = 1_000;
    const EXTENT: f64 = 3e4;
    const SIGMA: f64 = 300.0;
    let place = |i: usize, factor: f64| EXTENT * (factor * i as f64).fract();
    let tracks: Vec<[f64; 2]> =
        (1..=COUNT).map(|i| [0.754_877_666_2, 0.569_840_291].map(|f| place(i, f))).collect();
    let near = |(i, track): (usize, &[f64; 2])| {
        [track[0] + SIGMA * noise(2 * i), track[1] + SIGMA * noise(2 * i + 1)]
    };
    let plots: Vec<[f64; 2]> = tracks.iter().enumerate().map(near).collect();
    let covariance = [SIGMA * SIGMA, 0.0, 0.0, SIGMA * SIGMA].repeat(COUNT);
    let threshold = threshold(0.998, 2).unwrap();
    Box::new(move || {
        let scan = Scan {
            predicted: black_box(&tracks).as_flattened(),
            covariance: &covariance,
            plots: plots.as_flattened(),
            plot_covariance: None,
        };
        let gated: Vec<Pair> = pairs::<2>(&scan, threshold)
            .unwrap()
            .iter()
            .map(|pair| Pair { row: pair.track, column: pair.plot, gain: threshold - pair.nis })
            .collect();
        black_box(Assigner::default().assign(&gated, COUNT, COUNT));
    })
}

/// Tracks eight scans of four radars, beginning with the first plot.
fn tracks() -> Kernel {
    const AIRCRAFT: usize = 200;
    let extent = SPACING * (AIRCRAFT as f64).sqrt();
    let settings = Settings::new(radars(extent), Motion::Imm(ImmModel::default()));
    let scans = scans(8, AIRCRAFT, extent, &settings.radars);
    let (mut statuses, mut rows): (_, Vec<tertia::tracker::Row>) = (Vec::new(), Vec::new());
    Box::new(move || {
        let mut tracker = Tracker::try_new(settings.clone()).unwrap();
        for plots in black_box(&scans) {
            rows.clear();
            tracker.track(&plots[..], None, &mut statuses, &mut rows, ONE).unwrap();
        }
    })
}

/// Returns plots in two axes, and their times.
fn positions_of(count: usize) -> (Vec<f64>, Vec<f64>) {
    let at = |i: usize| {
        let turned = 0.02 * i as f64;
        [200.0 * turned.cos() + noise(2 * i), 200.0 * turned.sin() + noise(2 * i + 1)]
    };
    ((0..count).flat_map(at).collect(), (0..count).map(|i| i as f64).collect())
}

/// Buffers for a smoothed track of two axes.
struct Room([Vec<f64>; 3]);

impl Room {
    fn new(count: usize) -> Self {
        Self([6, 36, 2].map(|numbers| vec![0.0; numbers * count]))
    }

    fn results(&mut self) -> Smoothed<'_> {
        let [mean, covariance, innovation] = &mut self.0;
        Smoothed { mean, covariance, innovation }
    }
}

/// Smooths a track with known jerk; without jerk, it is smoothed by rows of information.
fn smoothed_track(jerk: f64) -> Kernel {
    let (y, time) = positions_of(1_000);
    let (mut room, mut workspace) = (Room::new(time.len()), Default::default());
    Box::new(move || {
        let noise = Noise::Same(&[1.0, 0.1, 0.1, 1.0]);
        let track = Track::try_new(2, &time, black_box(&y), noise, None).unwrap();
        black_box(smoothing::smooth(
            &track,
            ProcessNoise::with_jerk(jerk),
            &mut workspace,
            &mut room.results(),
        ));
    })
}

/// Smooths ten plots without any further knowledge.
fn noisy_track() -> Kernel {
    let (y, time) = positions_of(10);
    let (mut room, mut workspace) = (Room::new(time.len()), Default::default());
    let mut outlier = vec![false; time.len()];
    let options = Options { jerk: None, correlation_time: None, robust: true };
    Box::new(move || {
        let noise = Noise::Same(&[1.0, 0.0, 0.0, 1.0]);
        let track = Track::try_new(2, &time, black_box(&y), noise, None).unwrap();
        let mut results = room.results();
        let found = &mut outlier;
        black_box(smoothing::smooth_with_noise(
            &track,
            &options,
            &mut workspace,
            &mut results,
            found,
        ));
    })
}

/// Returns position and velocity of an aircraft in straight flight.
fn flown(aircraft: usize, time: f64) -> [f64; 4] {
    let [x, y, course] = [0.618_033_988_7, 0.754_877_666_2, 0.569_840_291]
        .map(|factor| (factor * (aircraft + 1) as f64).fract());
    let (sine, cosine) = (TAU * course).sin_cos();
    let [vx, vy] = [200.0 * sine, 200.0 * cosine];
    [1e5 * x + vx * time, 1e5 * y + vy * time, vx, vy]
}

/// Prior standard deviations of systematic errors.
const UNKNOWN: Errors = [100.0, 1e-4, 0.005, 0.1, 0.0, 0.0, 0.0, 0.0];

/// Registers the plots of twenty aircraft by four radars, one of which is rotated.
fn registered() -> Kernel {
    const SCANS: usize = 20;
    let radars = radars(1e5);
    let plot = |target: usize, scan: usize, radar: usize| {
        let time = 4.0 * scan as f64 + radar as f64;
        let [x, y, ..] = flown(target, time);
        let [east, north, _] = radars[radar].position;
        let at = 8 * (SCANS * target + scan) + 2 * radar;
        let turned = if radar == 2 { 0.004 } else { 0.0 };
        let report = Report {
            radar,
            time,
            range: (x - east).hypot(y - north) + 50.0 * noise(at),
            azimuth: (x - east).atan2(y - north) + turned + 0.0014 * noise(at + 1),
            height: f64::NAN,
            place: None,
        };
        TargetPlot { report, target: target as i64, turn_probability: 0.0 }
    };
    let scan = |target, scan| (0..4).map(move |radar| (target, scan, radar));
    let plots: Vec<TargetPlot> = (0..20)
        .flat_map(|target| (0..SCANS).flat_map(move |k| scan(target, k)))
        .map(|(target, scan, radar)| plot(target, scan, radar))
        .collect();
    let (zero, sigma) = (vec![[0.0; 8]; 4], vec![UNKNOWN; 4]);
    let (edges, start) = ([0.0, 4.0 * SCANS as f64], vec![zero.clone()]);
    Box::new(move || {
        let prior = Prior { mean: &zero, sigma: &sigma, rate: &zero };
        let periods = Periods { edges: &edges, start: &start };
        black_box(register(black_box(&plots), &radars, &[false; 4], prior, periods));
    })
}

/// Makes ten pictures of a hundred aircraft from the tracks of four sensors.
fn pictures() -> Kernel {
    const CYCLES: usize = 10;
    let settings = tertiary::Settings {
        radars: radars(1e5),
        rule: tertiary::Rule::Tracklets,
        cross_correlation: [0.0; 2],
        registers: true,
        errors: vec![[[0.0; 8], UNKNOWN, [1.0 / 30_000.0; 8]]; 4],
    };
    let row = |time: f64, aircraft: usize, sensor: usize| {
        let mut state = flown(aircraft, time);
        let at = 4 * (400 * time as usize + 4 * aircraft + sensor);
        for (i, (value, sigma)) in state.iter_mut().zip([50.0, 50.0, 5.0, 5.0]).enumerate() {
            *value += sigma * noise(at + i);
        }
        let mut covariance = [0.0; 16];
        for (i, variance) in [2500.0, 2500.0, 25.0, 25.0].into_iter().enumerate() {
            covariance[5 * i] = variance;
        }
        tertiary::Row {
            sensor,
            track: aircraft as i64,
            time,
            state,
            covariance,
            height: f64::NAN,
            identities: Identities::NONE,
            turn_probability: 0.0,
        }
    };
    let cycles: Vec<Vec<tertiary::Row>> = (0..CYCLES)
        .map(|k| (0..400).map(|i| row(4.0 * k as f64, i / 4, i % 4)).collect())
        .collect();
    Box::new(move || {
        let mut centre = tertiary::Centre::new(settings.clone());
        for (k, rows) in black_box(&cycles).iter().enumerate() {
            black_box(centre.update(rows, 4.0 * k as f64, ONE).unwrap());
        }
    })
}
