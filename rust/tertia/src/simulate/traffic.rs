//! Interpolation of flights between their samples.

use nalgebra::Complex;

/// Flights sampled in equal steps. Positions (F, S) and velocities are stored flight by
/// flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Traffic<'a> {
    /// Time of the first sample of each flight, s.
    pub start: &'a [f64],
    /// Number of samples of each flight, two or more.
    pub count: &'a [i64],
    /// Time from sample to sample, s.
    pub step: f64,
    /// East and north, m.
    pub position: &'a [[f64; 2]],
    /// Velocity, m/s.
    pub velocity: &'a [[f64; 2]],
    /// Height, m; nan if flights have no heights.
    pub height: &'a [f64],
}

/// State of a flight at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// East and north, m.
    pub position: Complex<f64>,
    /// Velocity, m/s.
    pub velocity: Complex<f64>,
    /// Height, m.
    pub height: f64,
}

impl Traffic<'_> {
    /// Time of the last sample of a flight.
    pub fn end(&self, flight: usize) -> f64 {
        self.start[flight] + (self.count[flight] - 1) as f64 * self.step
    }

    /// State of a flight at a time, from the cubic through the positions and velocities of the
    /// neighbouring samples, and with linear interpolation of the height. Both are extrapolated before
    /// the first and after the last sample. nan if the time is nan.
    ///
    /// # Panics
    /// If there is no such flight, or a flight has fewer than two samples.
    pub fn state(&self, flight: usize, time: f64) -> State {
        let steps = (time - self.start[flight]) / self.step;
        let last = (self.count[flight] - 2) as f64;
        let sample = if steps.is_finite() { steps.trunc().clamp(0.0, last) } else { 0.0 };
        let u = steps - sample;
        let k = flight * (self.position.len() / self.start.len()) + sample as usize;
        let complex = |[east, north]: [f64; 2]| Complex::new(east, north);
        let (first, way) =
            (complex(self.position[k]), complex(self.position[k + 1]) - complex(self.position[k]));
        let begin = complex(self.velocity[k]) * self.step;
        let end = complex(self.velocity[k + 1]) * self.step;
        // coefficients from the derivatives at the first sample
        let (square, cube) = (way * 3.0 - begin * 2.0 - end, begin + end - way * 2.0);
        let position = first + (begin + (square + cube * u) * u) * u;
        let velocity = (begin + (square * 2.0 + cube * 3.0 * u) * u) / self.step;
        let (low, high) = (self.height[k], self.height[k + 1]);
        State { position, velocity, height: low + u * (high - low) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cubic_is_met_between_and_beyond_the_samples() {
        let at = |t: f64| ([t * t * t, 2.0 * t * t], [3.0 * t * t, 4.0 * t]);
        let (position, velocity): (Vec<_>, Vec<_>) = (0..4).map(|k| at(f64::from(k))).unzip();
        let (start, count) = ([10.0], [4]);
        let traffic = Traffic {
            start: &start,
            count: &count,
            step: 1.0,
            position: &position,
            velocity: &velocity,
            height: &[0.0, 10.0, 20.0, 40.0],
        };
        assert_eq!(traffic.state(0, 12.5).height, 30.0);
        assert_eq!(traffic.end(0), 13.0);
        for t in [-0.5, 0.0, 0.3, 1.0, 2.9, 3.0, 3.5] {
            let State { position: p, velocity: v, .. } = traffic.state(0, 10.0 + t);
            let ([x, y], [vx, vy]) = at(t);
            assert!((p - Complex::new(x, y)).norm() < 1e-12, "{t}");
            assert!((v - Complex::new(vx, vy)).norm() < 1e-12, "{t}");
        }
        assert!(traffic.state(0, f64::NAN).position.re.is_nan());
    }
}
