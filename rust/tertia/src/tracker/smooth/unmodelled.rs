//! Motion that no model describes: the plots are farther from the path than their noise explains.
//!
//! What exceeds the noise is the motion about the path. Its variance is added to the covariances, and that of its
//! rate to those of the velocity.

use super::flight::{SmoothedRow, TrackPlot};
use crate::tracker::motion::agility::rate_of_misfit;

/// Plots before and after an instant over which squared normalised innovations are averaged, and least number.
const BESIDE: usize = 12;
const FEWEST: usize = 9;
/// Mean, relative to its expected value, from which on noise does not explain it.
const MISFIT: f64 = 1.8;

/// Adds the variances of motion about the path. Rows are in the order of time. `guard` limits squared normalised
/// innovations. Cost O(rows).
pub(super) fn add_unmodelled(plots: &[TrackPlot], guard: f64, rows: &mut [SmoothedRow]) {
    let of_row = |row: &SmoothedRow| {
        let s = row.innovation_covariance;
        let distance = s.inverse().form(row.innovation);
        let is_used = row.plot.is_some_and(|plot| plots[plot].used);
        (is_used && distance.is_finite())
            .then(|| [1.0, row.time, 0.5 * distance.min(guard), 0.5 * (s.xx + s.yy)])
    };
    let own: Vec<_> = rows.iter().map(of_row).collect();
    let known: Vec<[f64; 4]> = own.iter().copied().flatten().collect();
    let mut place = 0;
    for (row, own) in rows.iter_mut().zip(own) {
        place += usize::from(own.is_some());
        let beside = &known[place.saturating_sub(BESIDE + 1)..(place + BESIDE).min(known.len())];
        let [count, _, misfit, size] = beside
            .iter()
            .fold([0.0; 4], |sum: [f64; 4], own| std::array::from_fn(|i| sum[i] + own[i]));
        if beside.len() < FEWEST || misfit < MISFIT * count {
            continue;
        }
        let interval = (beside[beside.len() - 1][1] - beside[0][1]) / (count - 1.0);
        let more = (misfit / count - 1.0) * size / count;
        let rate = rate_of_misfit(interval);
        for i in 0..2 {
            row.covariance[i][i] += more;
            row.covariance[i + 2][i + 2] += more * rate * rate;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::plane::Plane;
    use crate::tracker::smooth::{Movement, Times, smooth_tracks};

    /// Plots of a target that turns by 2.6 rad from plot to plot about a place that drifts.
    fn plots(radius: f64) -> Vec<TrackPlot> {
        let covariance = Plane { xx: 900.0, xy: 0.0, yy: 900.0 };
        let plot = |k: u32| {
            let (time, (sine, cosine)) = (10.0 * f64::from(k), (2.6 * f64::from(k)).sin_cos());
            TrackPlot {
                time,
                sensor: 0,
                position: [4.0 * time + radius * sine, radius * cosine],
                covariance,
                velocity: [f64::NAN; 2],
                velocity_covariance: covariance,
                height: f64::NAN,
                used: true,
            }
        };
        (0..40).map(plot).collect()
    }

    #[test]
    fn motion_that_no_model_describes_is_in_the_covariance() {
        let sigma = |radius: f64| {
            let plots = plots(radius);
            let rows = smooth_tracks(&Movement::default(), &[&plots], &Times::default(), None);
            let p = rows[0][20].covariance;
            [p[0][0].sqrt(), p[2][2].sqrt()]
        };
        let ([place, speed], [usual, slow]) = (sigma(90.0), sigma(0.0));
        assert!(usual < 20.0 && slow < 2.0, "{usual} {slow}");
        // the target is 90 m from the path on average, and moves with 23 m/s
        assert!((50.0..130.0).contains(&place) && (12.0..40.0).contains(&speed), "{place} {speed}");
    }
}
