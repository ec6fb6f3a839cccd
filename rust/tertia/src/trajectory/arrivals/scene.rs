//! What was heard, and what is known of receivers, beacons and the medium.

use super::group::Line;

/// Arrivals at receivers whose clocks nobody synchronised, grouped into emissions.
#[derive(Clone, Debug)]
pub struct Scene<const D: usize> {
    /// Places of the K receivers, then those of beacons that are not at a receiver, in metres.
    pub sites: Vec<[f64; D]>,
    /// Their standard deviations in each coordinate.
    pub site_sigma: Vec<f64>,
    /// Standard deviation of each receiver's arrivals in metres, up to a common factor.
    pub sigma: Vec<f64>,
    /// Whether a receiver's clock is the time base.
    pub is_base: Vec<bool>,
    /// Where the clocks are, roughly.
    pub lines: Vec<Line>,
    /// Place of each identity that is a beacon.
    pub beacon: Vec<Option<usize>>,
    /// Arrivals, those of an emission in one piece, emissions in the order of time.
    pub rows: Vec<Arrival>,
    /// Speed of propagation in metres per second, and its standard deviation.
    pub speed: f64,
    /// See `speed`.
    pub speed_sigma: f64,
    /// Standard deviation, in metres, of errors that all arrivals by a path from a beacon to a
    /// receiver share; none: estimated.
    pub path_sigma: Option<f64>,
    /// Intensity of the random walk of clock rates, in 1/sqrt(s); none: estimated.
    pub clock_drift: Option<f64>,
    /// Intensity of the white jerk of moving identities in m^2/s^5; none: estimated for each.
    pub jerk: Option<f64>,
}

/// When a receiver heard an emission.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrival {
    /// Number of the emission, from 0.
    pub emission: usize,
    /// Who emitted.
    pub identity: usize,
    /// Which receiver.
    pub sensor: usize,
    /// Time by the roughly aligned clock, in seconds.
    pub time: f64,
}

/// The result. Positions are in metres, times in seconds of the time base.
#[derive(Clone, Debug, Default)]
pub struct Solution {
    /// Of each emission.
    pub time: Vec<f64>,
    /// Standard deviations.
    pub time_sigma: Vec<f64>,
    /// Numbers of emissions of moving identities, in the order of time.
    pub moving: Vec<usize>,
    /// Their positions, velocities and accelerations, 3 D each.
    pub mean: Vec<f64>,
    /// Their covariances, 3 D by 3 D each.
    pub covariance: Vec<f64>,
    /// Measured minus expected, in standard deviations, of each arrival.
    pub residual: Vec<f64>,
    /// Times at which the clocks are given, M.
    pub node: Vec<f64>,
    /// Reading of each clock less the time, (M, K).
    pub clock: Vec<f64>,
    /// Its variance, (M, K).
    pub clock_variance: Vec<f64>,
    /// Its covariance with the next node, (M, K); 0 at the last.
    pub clock_covariance: Vec<f64>,
    /// Places, D for each site.
    pub site: Vec<f64>,
    /// Their standard deviations, D for each site.
    pub site_sigma: Vec<f64>,
    /// Speed of propagation and its standard deviation.
    pub speed: (f64, f64),
    /// Standard deviation of an arrival, over the given one.
    pub noise_factor: f64,
    /// Standard deviation of path errors, in metres.
    pub path_sigma: f64,
    /// Intensity of the random walk of clock rates.
    pub clock_drift: f64,
    /// Intensity of the white jerk of each identity, in m^2/s^5.
    pub jerk: Vec<f64>,
    /// That of the white acceleration, in m^2/s^3.
    pub acceleration: Vec<f64>,
    /// Measurements less unknowns, counted by what priors leave free.
    pub degrees_of_freedom: f64,
    /// Whether the last step was small.
    pub is_converged: bool,
    /// Steps.
    pub iterations: usize,
}

/// Why there is no solution.
#[derive(Clone, Debug, PartialEq)]
pub enum Undetermined {
    /// These receivers share too few emissions with the others.
    Apart(Vec<usize>),
    /// No emission was heard by two receivers.
    Nothing,
    /// The clock of this receiver.
    Clock(usize),
    /// The motion of this identity.
    Motion(usize),
    /// The speed, or places.
    Other,
}
