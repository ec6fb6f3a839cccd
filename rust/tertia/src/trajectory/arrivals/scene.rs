//! Recorded arrivals, and prior knowledge of receivers, beacons and the medium.

use super::group::Line;

/// Arrivals at receivers whose clocks are not synchronised, grouped into emissions.
#[derive(Clone, Debug)]
pub struct Scene<const D: usize> {
    /// Positions of the K receivers, then those of beacons that are not at a receiver, in metres.
    pub sites: Vec<[f64; D]>,
    /// Standard deviations of the positions in each coordinate.
    pub site_sigma: Vec<f64>,
    /// Standard deviation of each receiver's arrivals in metres, up to a common factor.
    pub sigma: Vec<f64>,
    /// Whether a receiver's clock is the time base.
    pub is_base: Vec<bool>,
    /// Approximate offsets and rates of the clocks.
    pub lines: Vec<Line>,
    /// Site of each identity that is a beacon.
    pub beacon: Vec<Option<usize>>,
    /// Arrivals; those of an emission are contiguous, and emissions are in the order of time.
    pub rows: Vec<Arrival>,
    /// Propagation speed in metres per second, and its standard deviation.
    pub speed: f64,
    /// See `speed`.
    pub speed_sigma: f64,
    /// Standard deviation, in metres, of errors that all arrivals from one beacon at one receiver share;
    /// none: estimated.
    pub path_sigma: Option<f64>,
    /// Intensity of the random walk of clock rates, in 1/sqrt(s); none: estimated.
    pub clock_drift: Option<f64>,
    /// Intensity of the white jerk of moving identities in m^2/s^5; none: estimated for each.
    pub jerk: Option<f64>,
}

/// Arrival of an emission at a receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrival {
    /// Number of the emission, from 0.
    pub emission: usize,
    /// Number of the identity that emitted.
    pub identity: usize,
    /// Number of the receiver.
    pub sensor: usize,
    /// Time of the approximately aligned clock, in seconds.
    pub time: f64,
}

/// The result. Positions are in metres, times in seconds of the time base.
#[derive(Clone, Debug, Default)]
pub struct Solution {
    /// Time of each emission.
    pub time: Vec<f64>,
    /// Standard deviations of the times.
    pub time_sigma: Vec<f64>,
    /// Numbers of emissions of moving identities, in the order of time.
    pub moving: Vec<usize>,
    /// Positions, velocities and accelerations of these emissions, 3 D each.
    pub mean: Vec<f64>,
    /// Covariances of these states, 3 D by 3 D each.
    pub covariance: Vec<f64>,
    /// Measured minus expected arrival time, in standard deviations, of each arrival.
    pub residual: Vec<f64>,
    /// Times at which the clocks are given, M.
    pub node: Vec<f64>,
    /// Reading of each clock less the time, (M, K).
    pub clock: Vec<f64>,
    /// Variance of the clock, (M, K).
    pub clock_variance: Vec<f64>,
    /// Covariance of the clock with that at the next node, (M, K); 0 at the last.
    pub clock_covariance: Vec<f64>,
    /// Positions, D for each site.
    pub site: Vec<f64>,
    /// Standard deviations of the positions, D for each site.
    pub site_sigma: Vec<f64>,
    /// Propagation speed and its standard deviation.
    pub speed: (f64, f64),
    /// Standard deviation of an arrival relative to the given one.
    pub noise_factor: f64,
    /// Standard deviation of path errors, in metres.
    pub path_sigma: f64,
    /// Intensity of the random walk of clock rates.
    pub clock_drift: f64,
    /// Intensity of the white jerk of each identity, in m^2/s^5.
    pub jerk: Vec<f64>,
    /// Intensity of the white acceleration of each identity, in m^2/s^3.
    pub acceleration: Vec<f64>,
    /// Number of measurements less that of the unknowns, as far as priors do not determine these.
    pub degrees_of_freedom: f64,
    /// Whether the mirror images of the positions at the plane of the receivers fit as well.
    pub is_mirrored: bool,
    /// Whether the last step was small.
    pub is_converged: bool,
    /// Number of steps.
    pub iterations: usize,
}

/// Why there is no solution.
#[derive(Clone, Debug, PartialEq)]
pub enum Undetermined {
    /// These receivers share too few emissions with the others.
    Apart(Vec<usize>),
    /// No emission was heard by two receivers.
    Nothing,
    /// The clock of this receiver is not determined.
    Clock(usize),
    /// The motion of this identity is not determined.
    Motion(usize),
    /// The propagation speed or positions of sites are not determined.
    Other,
}
