//! A record of bearings with a burst and two single anomalies: finds the wrong measurements, and one
//! bearing with its standard deviation. `cargo run --release --example bearing`

use tertia::Result;
use tertia::bearing::{BlockOutput, Estimator, Known, Method, RobustRule, Workspace};
use tertia::screening::{BurstRule, BurstWorkspace, unwrap_about_median};

/// Returns a hundred bearings of an emitter in the north, with noise of about 3.4 degrees.
fn record() -> Vec<f64> {
    let noise = |i: usize| 3.4 * ((i * i * 7 + i * 3) % 97) as f64 / 28.0 - 5.9;
    let anomaly = |i: usize| match i {
        17 | 80 => 25.0,
        40..47 => -24.0,
        _ => 0.0,
    };
    (0..100).map(|i| (360.0 + noise(i) + anomaly(i)).rem_euclid(360.0)).collect()
}

fn main() -> Result<()> {
    let theta = record();
    let rule = BurstRule::try_new(2.5, 3.0, (2, 20), 0.0, 0.0)?;

    // screening alone: angles must be unwrapped first
    let (mut angle, mut scratch) = (vec![0.0; theta.len()], Vec::new());
    unwrap_about_median(&theta, 360.0, &mut angle, &mut scratch)?;
    let mut outlier = vec![false; theta.len()];
    let summary = rule.detect(&angle, &mut outlier, &mut BurstWorkspace::default())?;
    let wrong: Vec<_> = (0..theta.len()).filter(|&i| outlier[i]).collect();
    println!("anomalous: {wrong:?}, mean of the others {:.2}", summary.mean);

    // the bearing, by a method that also finds the anomalies
    let method = Method::Robust(RobustRule { block_size: 10, rounding: 0.0 });
    let estimator = Estimator::try_new(method, Some(360.0), None)?;
    let [mut mean, mut variance, mut weight] =
        [(); 3].map(|()| vec![0.0; estimator.blocks(theta.len())]);
    let mut blocks = BlockOutput { mean: &mut mean, variance: &mut variance, weight: &mut weight };
    let found = estimator.estimate(
        &theta,
        Known::default(),
        &mut outlier,
        &mut blocks,
        &mut Workspace::default(),
    )?;
    println!("bearing: {:.2} ± {:.2} degrees", found.value, found.sigma);
    Ok(())
}
