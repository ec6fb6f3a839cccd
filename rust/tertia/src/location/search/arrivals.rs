//! Starting points from times of arrival in metres: `z = b + |p − s|`, where b is the emission.

use crate::base::small::{Factor, Vector, add_multiple, add_outer, dot, norm};
use crate::sensors::{Kind, Measurement};

/// Rank, as a fraction, of the arrival that is taken as undisturbed: more arrivals are late than early.
const EARLY: f64 = 0.3;
/// Number of arrivals in excess of the unknowns from which on the linear system is trusted. With one
/// fewer, it leads to a wrong minimum about once in a thousand cases.
const SPARE: usize = 3;

/// From this number of measurements in excess of the unknowns on, a minimum is trusted although one
/// measurement in [`FAULTS_ONE_IN`] is a fault.
const ROBUST: usize = 9;
const FAULTS_ONE_IN: usize = 12;
/// Smallest cost of a fault among arrivals.
const COST_OF_FAULT: f64 = 8.3;

/// Solves the squared equations of the arrivals, `s·p − z b = (|s|² − z²)/2 + c`, by least squares;
/// they are linear in p, b and c. Returns `None` if there are too few arrivals or these leave the state
/// undetermined. O(M).
pub(in crate::location) fn start<const D: usize, const N: usize>(
    measurements: &[Measurement<D>],
) -> Option<Vector<N>> {
    let arrivals = || measurements.iter().filter(|m| m.kind == Kind::Arrival);
    if N == D || arrivals().count() < N + SPARE {
        return None;
    }
    // s, −z, and the right side
    let row = |m: &Measurement<D>| -> (Vector<N>, f64) {
        let s: Vector<N> = std::array::from_fn(|i| if i < D { m.station[i] } else { -m.value });
        let right = 0.5 * (dot(&m.station, &m.station) - m.value * m.value);
        (s, right)
    };
    // subtraction of the weighted means eliminates c
    let (mut mean, mut middle, mut total) = ([0.0; N], 0.0, 0.0);
    for m in arrivals() {
        let (s, right) = row(m);
        let weight = m.precision * m.precision;
        add_multiple(&mut mean, weight, &s);
        middle += weight * right;
        total += weight;
    }
    let mut matrix = [[0.0; N]; N];
    let mut vector = [0.0; N];
    for m in arrivals() {
        let (s, right) = row(m);
        let weight = m.precision * m.precision;
        let own: Vector<N> = std::array::from_fn(|i| s[i] - mean[i] / total);
        for i in 0..N {
            vector[i] += weight * own[i] * (right - middle / total);
        }
        add_outer(&mut matrix, weight, &own);
    }
    Some(Factor::try_new(&matrix, 0.0)?.solve(&vector))
}

/// Returns the emission from the arrivals at a position, some of which may be late. O(M).
pub(in crate::location) fn emission<const D: usize>(
    measurements: &[Measurement<D>],
    p: &Vector<D>,
    scratch: &mut Vec<f64>,
) -> f64 {
    scratch.clear();
    for m in measurements.iter().filter(|m| m.kind == Kind::Arrival) {
        let offset: Vector<D> = std::array::from_fn(|i| p[i] - m.station[i]);
        scratch.push(m.value - norm(&offset));
    }
    let at = (EARLY * (scratch.len().max(1) - 1) as f64).round() as usize;
    let (_, emission, _) = scratch.select_nth_unstable_by(at, f64::total_cmp);
    *emission
}

/// Returns the cost up to which a minimum of `count` measurements is accepted without other starts:
/// that of noise and of one fault in twelve measurements. Another minimum that explained as many
/// measurements would share most of them with this one.
pub(in crate::location) fn trusted_cost(count: usize, unknowns: usize, fault: f64) -> f64 {
    let noise = 0.5 * (count - unknowns) as f64 + 2.0 * (0.5 * count as f64).sqrt();
    let spare = if count < unknowns + ROBUST { 0 } else { count / FAULTS_ONE_IN };
    noise + COST_OF_FAULT.min(fault) * spare as f64
}
