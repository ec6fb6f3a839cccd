//! Times at which the rotating beam of a radar passes flights.

use super::traffic::{State, Traffic};
use nalgebra::Complex;
use std::f64::consts::PI;

/// Newton step, s, after which the next one would be shorter than a microsecond; and largest number of steps.
const MEETS: f64 = 1e-3;
const ROUNDS: usize = 20;
/// Range of the beam's rate relative to an aircraft, as a share of the beam's own rate, in which passages
/// are found.
const SHARES: [f64; 2] = [0.5, 1.5];
/// Largest distance of a passage from its expected time, in scans; beyond, it belongs to another scan.
const NEAR: f64 = 0.75;

/// A beam that rotates clockwise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// Position of the radar, east and north, m.
    pub position: [f64; 2],
    /// Time of a rotation, s.
    pub scan_period: f64,
    /// A time at which the beam points north, s.
    pub phase: f64,
}

/// Returns the passages of the beam over each flight, as flights and times: scan by scan, and in each scan in
/// the order of the flights. The search for the next passage starts one scan later, where the beam is at the
/// last azimuth of the aircraft.
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
            // time advances even if an aircraft is directly above the radar
            guess = (time + rotation).max(guess + 0.5 * beam.scan_period);
        }
    }
    // the sort is stable
    found.sort_by_key(|&(scan, ..)| scan);
    found.into_iter().map(|(_, flight, time)| (flight, time)).collect()
}

impl Beam {
    /// Finds the time at which beam and aircraft have the same azimuth, and the time until the next
    /// passage, by Newton's method. Directly above the radar, where the azimuth of an aircraft may change
    /// as quickly as that of the beam, there may be no such time.
    fn meet(&self, traffic: &Traffic<'_>, flight: usize, guess: f64) -> Option<(f64, f64)> {
        let mut time = guess;
        for _ in 0..ROUNDS {
            let (azimuth, rate) = self.azimuth(traffic, flight, time);
            let lag = (azimuth - self.angle(time)) / (2.0 * PI);
            // the aircraft moves away from the beam, or towards it
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

    /// Azimuth of a flight and its rate; before the start and after the end, those at the start and the end.
    fn azimuth(&self, traffic: &Traffic<'_>, flight: usize, time: f64) -> (f64, f64) {
        let inside = time.clamp(traffic.start[flight], traffic.end(flight));
        let State { position, velocity, .. } = traffic.state(flight, inside);
        let offset = position - Complex::new(self.position[0], self.position[1]);
        // an aircraft directly above the radar has no particular azimuth
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
