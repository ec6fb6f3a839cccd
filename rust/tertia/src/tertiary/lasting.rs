//! Errors of tracks that last.
//!
//! A filter expects that the errors of positions are independent from row to row. The positions of a track by
//! another system may have errors that last instead, as those of inertial navigation. Then they scatter less
//! about the filter than they should, and the filter cannot reduce the rest of their variance.

use crate::base::plane::Plane;
use crate::sensors::Radar;
use nalgebra::Matrix2;
use serde::{Deserialize, Serialize};

/// Weight of the newest row in the running mean of innovations, and the mean below which errors last: chance
/// seldom makes it so small.
const MEMORY: f64 = 0.05;
const LEAST: f64 = 0.6;

/// Mean share of the variance of the positions of a sensor that lasts, from which on its errors last.
const LASTING: f64 = 0.1;

/// Running mean of the normalised innovations squared of a track, relative to their expected value.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Scatter(f64);

impl Default for Scatter {
    fn default() -> Self {
        Self(1.0)
    }
}

impl Scatter {
    /// Adds an innovation.
    pub fn see(&mut self, square: f64) {
        self.0 += MEMORY * (square - self.0);
    }

    /// Share of the variance of positions that lasts.
    pub fn lasting(self) -> f64 {
        (1.0 - self.0 / LEAST).max(0.0)
    }
}

/// Positions of a track of a sensor.
#[derive(Clone, Copy, Debug)]
pub(super) struct Positions {
    /// Share of their variance that lasts.
    pub lasting: f64,
    pub noise: Plane,
    /// Time between them, s.
    pub period: f64,
}

/// Covariance of the error that lasts in a position that is filtered from those of several tracks. Each has
/// the weight of its information over time.
pub(super) fn lasting(parts: &[Positions]) -> Matrix2<f64> {
    if parts.iter().all(|part| part.lasting == 0.0) {
        return Matrix2::zeros();
    }
    let (mut information, mut lasting) = (Plane::default(), Plane::default());
    for part in parts {
        let own = part.noise.inverse().scaled(1.0 / part.period);
        information = information.plus(own);
        lasting = lasting.plus(own.scaled(part.lasting / part.period));
    }
    let covariance = matrix(information.inverse());
    covariance * matrix(lasting) * covariance
}

/// Raises the noise of range and azimuth of sensors to the stated one if their errors last, because the noise of
/// successive plots is only a part of them. `shares` are those of the variance of each track that last.
pub(super) fn raised(
    mut noise: Vec<[f64; 2]>,
    stated: &[Radar],
    shares: impl Iterator<Item = (usize, f64)>,
) -> Vec<[f64; 2]> {
    let mut lasting = vec![[0.0; 2]; noise.len()];
    for (sensor, share) in shares {
        let [sum, count] = &mut lasting[sensor];
        *sum += share;
        *count += 1.0;
    }
    for ((own, radar), [sum, count]) in noise.iter_mut().zip(stated).zip(lasting) {
        if sum > LASTING * count {
            *own = [own[0].max(radar.range_sigma), own[1].max(radar.azimuth_sigma)];
        }
    }
    noise
}

fn matrix(Plane { xx, xy, yy }: Plane) -> Matrix2<f64> {
    Matrix2::new(xx, xy, xy, yy)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensors::radar_of;

    #[test]
    fn what_lasts_is_averaged_over_the_sensors() {
        let noise = Plane { xx: 100.0, xy: 20.0, yy: 50.0 };
        let part = |lasting, period| Positions { lasting, noise, period };
        let alone = lasting(&[part(0.5, 4.0)]);
        assert!((alone - 0.5 * matrix(noise)).amax() < 1e-12);
        let alike = lasting(&[part(0.5, 4.0); 3]);
        assert!((alike - alone / 3.0).amax() < 1e-12);
        // a sensor of which nothing lasts, four times as often: a fifth of the weight, squared
        let rare = lasting(&[part(0.5, 4.0), part(0.0, 1.0)]);
        assert!((rare - alone / 25.0).amax() < 1e-12);
    }

    #[test]
    fn noise_is_not_smaller_than_stated_if_errors_last() {
        let stated = [radar_of([50.0, 1e-3]), radar_of([50.0, 1e-3])];
        let noise = vec![[20.0, 2e-3], [20.0, 5e-4]];
        let shares = [(0, 0.3), (0, 0.0), (1, 0.1), (1, 0.0)];
        let found = raised(noise, &stated, shares.into_iter());
        assert_eq!(found, [[50.0, 2e-3], [20.0, 5e-4]]);
    }

    #[test]
    fn small_innovations_are_errors_that_last() {
        let mut scatter = Scatter::default();
        (0..200).for_each(|k| scatter.see(if k % 2 == 0 { 0.3 } else { 1.5 }));
        assert_eq!(scatter.lasting(), 0.0);
        (0..200).for_each(|_| scatter.see(0.06));
        assert!((scatter.lasting() - 0.9).abs() < 1e-4);
    }
}
