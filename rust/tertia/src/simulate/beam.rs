//! When the rotating beam of a radar passes flights.

use super::traffic::{State, Traffic};
use nalgebra::Complex;
use std::f64::consts::PI;

/// A step of Newton's so short that the next is below a microsecond, seconds; and how many there are
/// at most.
const MEETS: f64 = 1e-3;
const ROUNDS: usize = 20;
/// Rates of the beam relative to an aircraft, in those of the beam, for which meetings are found.
const SHARES: [f64; 2] = [0.5, 1.5];
/// Scans beyond which a meeting belongs to another scan.
const NEAR: f64 = 0.75;

/// A beam that turns clockwise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// Where the radar is, east and north, metres.
    pub position: [f64; 2],
    /// Seconds of a rotation.
    pub scan_period: f64,
    /// A time at which the beam points to the north.
    pub phase: f64,
}

/// The meetings of a beam and each flight, flights and times: scan by scan, in each scan in the order
/// of the flights. A scan later the beam is where the aircraft was; the next meeting is found from
/// there.
pub fn meetings(traffic: &Traffic<'_>, beam: &Beam) -> Vec<(usize, f64)> {
    let mut found = Vec::new();
    for flight in 0..traffic.start.len() {
        let (start, end) = (traffic.start[flight], traffic.end(flight));
        let (azimuth, _) = beam.azimuth(traffic, flight, start);
        let lag = azimuth - beam.angle(start);
        let mut guess = start + beam.scan_period * (lag / (2.0 * PI)).rem_euclid(1.0);
        for scan in 0_usize.. {
            let meeting = beam.meet(traffic, flight, guess);
            let (time, rotation) = meeting.unwrap_or((guess, beam.scan_period));
            if meeting.is_some() && time >= start && time <= end {
                found.push((scan, flight, time));
            }
            if time > end || time.is_nan() {
                break;
            }
            // whatever an aircraft right above the radar does, time goes on
            guess = (time + rotation).max(guess + 0.5 * beam.scan_period);
        }
    }
    // stable
    found.sort_by_key(|&(scan, ..)| scan);
    found.into_iter().map(|(_, flight, time)| (flight, time)).collect()
}

impl Beam {
    /// When beam and aircraft are at one azimuth, and how long until the next time. By Newton's
    /// method. Right above the radar, where an aircraft's azimuth may change as quickly as the
    /// beam's, there may be no such time.
    fn meet(&self, traffic: &Traffic<'_>, flight: usize, guess: f64) -> Option<(f64, f64)> {
        let mut time = guess;
        for _ in 0..ROUNDS {
            let (azimuth, rate) = self.azimuth(traffic, flight, time);
            let lag = (azimuth - self.angle(time)) / (2.0 * PI);
            // the aircraft runs away from the beam, or towards it
            let share = (1.0 - rate * self.scan_period / (2.0 * PI)).clamp(SHARES[0], SHARES[1]);
            let rotation = self.scan_period / share;
            let late = rotation * ((lag + 0.5).rem_euclid(1.0) - 0.5);
            time += late;
            if late.abs() < MEETS {
                let is_near = (time - guess).abs() < NEAR * self.scan_period;
                return is_near.then_some((time, rotation));
            }
        }
        None
    }

    /// Azimuth of a flight and its rate; before the start and after the end those there.
    fn azimuth(&self, traffic: &Traffic<'_>, flight: usize, time: f64) -> (f64, f64) {
        let inside = time.clamp(traffic.start[flight], traffic.end(flight));
        let State { position, velocity, .. } = traffic.state(flight, inside);
        let offset = position - Complex::new(self.position[0], self.position[1]);
        // an aircraft right above the radar has any azimuth
        let slope = velocity / if offset == Complex::ZERO { Complex::ONE } else { offset };
        (offset.re.atan2(offset.im), -slope.im)
    }

    /// Azimuth of the beam.
    fn angle(&self, time: f64) -> f64 {
        2.0 * PI / self.scan_period * (time - self.phase)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_beam_is_where_the_aircraft_is() {
        let samples = 61;
        let position: Vec<_> =
            (0..2 * samples).map(|k| [2e3 * f64::from(k % samples) - 5e4, 2e4]).collect();
        let velocity = vec![[200.0, 0.0]; position.len()];
        let (start, count) = ([0.0, 3.0], [61, 31]);
        let traffic = Traffic {
            start: &start,
            count: &count,
            step: 10.0,
            position: &position,
            velocity: &velocity,
            height: &vec![f64::NAN; position.len()],
        };
        let beam = Beam { position: [1e3, -2e3], scan_period: 4.0, phase: 1.0 };
        let found = meetings(&traffic, &beam);
        for &(flight, time) in &found {
            let p = traffic.state(flight, time).position;
            let azimuth = (p.re - 1e3).atan2(p.im + 2e3);
            let lag = (azimuth - beam.angle(time) + PI).rem_euclid(2.0 * PI) - PI;
            assert!(lag.abs() < 1e-9, "{flight} at {time}: {lag}");
        }
        let of = |flight| found.iter().filter(|(other, _)| *other == flight).count();
        assert!((150..=151).contains(&of(0)) && (75..=76).contains(&of(1)), "{} {}", of(0), of(1));
    }
}
