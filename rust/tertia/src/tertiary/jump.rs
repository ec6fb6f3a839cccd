//! Jumps of clocks.
//!
//! If the clock of a sensor jumps, all its tracks are ahead of the targets of the other sensors, or behind them,
//! by the same time. They are then no longer paired with these targets, so that registration cannot find the
//! jump.

use super::groups::Group;
use super::near::Sample;
use crate::base::angle::median;
use crate::base::plane::Plane;

/// Fewest tracks that show a jump, and largest number of tracks that are examined.
const FEWEST: usize = 5;
const MOST: usize = 50;
/// Largest jump, and largest difference between the delays of tracks with the same jump, s.
const LONGEST: f64 = 6.0;
const WINDOW: f64 = 1.0;
/// Least speed of a target that shows a delay, m/s.
const SLOWEST: f64 = 30.0;
/// Largest difference across the course and of the velocities, in standard deviations.
const GATE: f64 = 4.0;

/// A jump of a clock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Jump {
    pub sensor: usize,
    /// By how much the clock is fast, and the standard deviation of this estimate, s.
    pub by: f64,
    pub sigma: f64,
}

/// Finds the jumps of sensors whose tracks are no longer paired: most of those that are not, and at least a
/// third of all, must show the same delay behind targets that several sensors see.
pub(super) fn jumps(samples: &[Sample], groups: &[Group], sensors: usize) -> Vec<Jump> {
    let (mut all, mut alone) = (vec![0; sensors], vec![Vec::new(); sensors]);
    samples.iter().for_each(|one| all[one.sensor] += 1);
    for group in groups {
        if let [i] = group.members[..] {
            alone[samples[i].sensor].push(&samples[i]);
        }
    }
    let suspect = |k: &usize| alone[*k].len() >= FEWEST.max(all[*k] / 3);
    let suspects = (0..sensors).filter(suspect);
    suspects.filter_map(|k| jump(k, &alone[k], samples, groups)).collect()
}

/// Returns the jump of the clock of a sensor that these tracks show.
fn jump(sensor: usize, alone: &[&Sample], samples: &[Sample], groups: &[Group]) -> Option<Jump> {
    let is_seen = |group: &&Group| {
        group.members.len() > 1 && group.members.iter().all(|&i| samples[i].sensor != sensor)
    };
    let targets: Vec<_> =
        groups.iter().filter(is_seen).map(|group| &samples[group.members[0]]).collect();
    let mut delays: Vec<(f64, usize)> = Vec::new();
    for (at, one) in alone.iter().take(MOST).enumerate() {
        delays.extend(targets.iter().filter_map(|target| Some((delay(one, target)?, at))));
    }
    delays.sort_by(|a, b| a.0.total_cmp(&b.0));
    let within = |from: usize| -> &[(f64, usize)] {
        let own = &delays[from..];
        &own[..own.partition_point(|one| one.0 <= own[0].0 + WINDOW)]
    };
    let tracks = |from: usize| {
        let mut own: Vec<_> = within(from).iter().map(|one| one.1).collect();
        own.sort_unstable();
        own.dedup();
        own.len()
    };
    let (count, from) = (0..delays.len()).map(|from| (tracks(from), from)).max()?;
    if count < FEWEST || 2 * count <= alone.len().min(MOST) {
        return None;
    }
    let by = median(&mut within(from).iter().map(|one| one.0).collect::<Vec<_>>());
    let sigma = 0.5 * WINDOW / (count as f64).sqrt();
    (by.abs() > 0.5 * WINDOW).then_some(Jump { sensor, by, sigma })
}

/// Returns the delay of a track behind a target, if it follows the same course at the same speed.
fn delay(track: &Sample, target: &Sample) -> Option<f64> {
    let d = track.mean - target.mean;
    let p = track.whole + target.whole;
    let [u, v] = [target.mean[2], target.mean[3]];
    let square = u * u + v * v;
    let delay = -(d[0] * u + d[1] * v) / square;
    let across = Plane { xx: p[(0, 0)], xy: p[(0, 1)], yy: p[(1, 1)] }.form([v, -u]);
    let rates = Plane { xx: p[(2, 2)], xy: p[(2, 3)], yy: p[(3, 3)] };
    let is_same = (d[0] * v - d[1] * u).powi(2) < GATE * GATE * across
        && rates.inverse().form([d[2], d[3]]) < GATE * GATE;
    (square > SLOWEST * SLOWEST && delay.abs() < LONGEST && is_same).then_some(delay)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix4, Vector4};

    /// Ten targets that two sensors see, and tracks of a third one that are late by these times.
    fn found(late: impl Fn(usize) -> f64) -> Vec<Jump> {
        let (mut samples, mut groups) = (Vec::new(), Vec::new());
        let whole = Matrix4::from_diagonal(&Vector4::new(1e4, 1e4, 25.0, 25.0));
        for i in 0..10 {
            let course = 2.0 * i as f64;
            let [u, v] = [200.0 * course.sin(), 200.0 * course.cos()];
            let place = |late: f64| Vector4::new(1e4 * i as f64 - late * u, -late * v, u, v);
            for (sensor, late) in [(0, 0.1), (1, -0.1), (2, late(i))] {
                samples.push(Sample { sensor, mean: place(late), whole, ..Sample::default() });
            }
            for members in [vec![3 * i, 3 * i + 1], vec![3 * i + 2]] {
                let mut group = Group::default();
                group.members = members;
                groups.push(group);
            }
        }
        jumps(&samples, &groups, 3)
    }

    #[test]
    fn tracks_that_are_late_together() {
        let jumped = found(|i| 3.0 + 0.1 * (i % 3) as f64);
        assert!(matches!(jumped[..], [Jump { sensor: 2, by, .. }] if (by - 3.0).abs() < 0.2));
        assert_eq!(found(|i| 3.0 * (i as f64).sin()), []);
    }
}
