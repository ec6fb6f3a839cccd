//! Aircraft in straight flight, seen by four radars with a scan period of four seconds.

use std::f64::consts::TAU;
use tertia::sensors::Identities;
use tertia::tracker::{Plot, Radar};

const PERIOD: f64 = 4.0;
/// Mean distance between aircraft, m.
pub const SPACING: f64 = 4200.0;

/// Generator of reproducible uniform numbers.
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.uniform()).ln()).sqrt() * (TAU * self.uniform()).cos()
    }
}

/// Four radars in a square.
pub fn radars(extent: f64) -> Vec<Radar> {
    let at = |x: f64, y: f64| Radar {
        position: [x * extent, y * extent, 0.0],
        range_sigma: 50.0,
        azimuth_sigma: 0.0014,
        scan_period: PERIOD,
        max_range: f64::INFINITY,
        detection_probability: 0.9,
        resolution: None,
        extent: 0.0,
        ways: None,
    };
    vec![at(0.25, 0.25), at(0.75, 0.25), at(0.25, 0.75), at(0.75, 0.75)]
}

/// Returns the plots of each scan, sorted by time.
pub fn scans(count: usize, aircraft: usize, extent: f64, radars: &[Radar]) -> Vec<Vec<Plot>> {
    let mut random = Random(7);
    let fleet: Vec<[f64; 4]> = (0..aircraft)
        .map(|_| {
            let (course, speed) = (TAU * random.uniform(), 100.0 + 150.0 * random.uniform());
            let (sine, cosine) = course.sin_cos();
            [extent * random.uniform(), extent * random.uniform(), speed * sine, speed * cosine]
        })
        .collect();
    let scan = |k: usize, random: &mut Random| {
        let mut plots = Vec::new();
        for [x, y, vx, vy] in &fleet {
            for (index, radar) in radars.iter().enumerate() {
                let [east, north, _] = radar.position;
                let begin = k as f64 * PERIOD;
                let bearing = |t: f64| (x + vx * t - east).atan2(y + vy * t - north);
                let time = begin + bearing(begin).rem_euclid(TAU) / TAU * PERIOD;
                let range = (x + vx * time - east).hypot(y + vy * time - north);
                if random.uniform() < radar.detection_probability {
                    plots.push(Plot {
                        time,
                        range: range + radar.range_sigma * random.normal(),
                        azimuth: bearing(time) + radar.azimuth_sigma * random.normal(),
                        radar: index,
                        height: f64::NAN,
                        identities: Identities::NONE,
                        detection: None,
                        report: None,
                    });
                }
            }
        }
        plots.sort_by(|a, b| a.time.total_cmp(&b.time));
        plots
    };
    (0..count).map(|k| scan(k, &mut random)).collect()
}
