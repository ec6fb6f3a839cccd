//! One radar, two aircraft whose paths cross, and false plots: tracks, scan by scan.
//! `cargo run --release --example tracker`

use std::f64::consts::TAU;
use tertia::Result;
use tertia::sensors::Identities;
use tertia::tracker::{ImmModel, Motion, Plot, PlotStatus, Radar, Settings, Tracker};

const PERIOD: f64 = 4.0;
/// East, north (m) and their rates (m/s) at the start.
const AIRCRAFT: [[f64; 4]; 2] = [[-15e3, 30e3, 200.0, 50.0], [15e3, 30e3, -200.0, 60.0]];

fn settings() -> Settings {
    let radar = Radar {
        position: [0.0; 3],
        range_sigma: 50.0,
        azimuth_sigma: 0.0014,
        scan_period: PERIOD,
        max_range: 80e3,
        detection_probability: 0.95,
        resolution: None,
        extent: 0.0,
        ways: None,
    };
    Settings::new(vec![radar], Motion::Imm(ImmModel::default()))
}

/// Returns the plots of one antenna rotation: those of the aircraft, and three false plots.
fn scan(k: usize, random: &mut impl FnMut() -> f64) -> Vec<Plot> {
    let begin = k as f64 * PERIOD;
    let mut plots = Vec::new();
    for [x, y, vx, vy] in AIRCRAFT {
        let at = |t: f64| (x + vx * t, y + vy * t);
        let (east, north) = at(begin);
        let time = begin + east.atan2(north).rem_euclid(TAU) / TAU * PERIOD;
        let (east, north) = at(time);
        plots.push((time, east.hypot(north) + 80.0 * (random() - 0.5), east.atan2(north)));
    }
    for _ in 0..3 {
        let azimuth = TAU * random();
        plots.push((begin + azimuth / TAU * PERIOD, 80e3 * random().sqrt(), azimuth));
    }
    let plot = |(time, range, azimuth)| Plot {
        time,
        range,
        azimuth: azimuth + 0.002 * (time.sin() - 0.5),
        radar: 0,
        height: f64::NAN,
        identities: Identities::NONE,
        detection: None,
        report: None,
    };
    plots.into_iter().map(plot).collect()
}

fn main() -> Result<()> {
    let mut seed = 7_u64;
    let mut random = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (seed >> 11) as f64 / (1_u64 << 53) as f64
    };
    let mut tracker = Tracker::try_new(settings())?;
    let (mut statuses, mut rows): (Vec<PlotStatus>, _) = (Vec::new(), Vec::new());
    for k in 0..30 {
        rows.clear();
        tracker.track(&scan(k, &mut random)[..], None, &mut statuses, &mut rows, None)?;
        for row in rows.iter().filter(|row| row.confirmed && k % 10 == 9) {
            let (east, north) = (row.estimate.mean[0], row.estimate.mean[1]);
            let sigma = row.estimate.covariance[(0, 0)].sqrt();
            println!(
                "{:5.1} s  track {}  {:6.2} ± {sigma:.3} km east, {:5.2} km north",
                row.time,
                row.track,
                east / 1e3,
                north / 1e3,
                sigma = sigma / 1e3,
            );
        }
    }
    println!("in half a minute: {:?}", tracker.extrapolate(30.0));
    Ok(())
}
