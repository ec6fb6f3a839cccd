//! timing (not tracked)
#![allow(missing_docs)]
use tertia::tracker::Plane;
use tertia::tracker::{Movement, Times, TrackPlot, smooth_tracks};
fn main() {
    let times: usize = std::env::var("TIMES").unwrap().parse().unwrap();
    let n = 150;
    let mut plots = Vec::new();
    let (mut p, mut c) = ([70e3, 20e3], 0.3_f64);
    let mut s = 12345_u64;
    let mut u = || {
        s = s.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (s >> 11) as f64 / (1u64 << 53) as f64
    };
    for k in 0..n {
        let g: f64 = (0..12).map(|_| u()).sum::<f64>() - 6.0;
        let h: f64 = (0..12).map(|_| u()).sum::<f64>() - 6.0;
        plots.push(TrackPlot {
            time: 4.0 * k as f64,
            position: [p[0] + 50.0 * g, p[1] + 90.0 * h],
            covariance: Plane { xx: 2500.0, xy: 0.0, yy: 8100.0 },
            height: f64::NAN,
            used: true,
        });
        if (k / 20) % 3 == 1 {
            c += 0.08;
        }
        p = [p[0] + 800.0 * c.cos(), p[1] + 800.0 * c.sin()];
    }
    let mut sum = 0.0;
    for _ in 0..times {
        let rows = smooth_tracks(
            &Movement::default(),
            &[&plots],
            &Times::default(),
            std::num::NonZero::new(1),
        );
        sum += rows[0][70].state[0];
        if times == 1 {
            println!("{} outliers", rows[0].iter().filter(|r| r.outlier).count());
        }
    }
    println!("{sum}");
}
