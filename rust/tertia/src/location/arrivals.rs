//! Starts from times of arrival, in metres: `z = b + |p − s|`, b that of the emission.

use crate::base::small::{Factor, Matrix, Vector, dot, longest, norm};
use crate::sensors::{Kind, Measurement};

/// Rank of the arrival that is taken for undisturbed, as a share: more are late than early.
const EARLY: f64 = 0.3;
/// Arrivals beyond the unknowns with which the linear system is trusted: with one less, it leads to a
/// wrong minimum once in some thousand times.
const SPARE: usize = 3;

/// With so many measurements beyond the unknowns faults are trusted, one in so many.
const ROBUST: usize = 9;
const FAULTS_ONE_IN: usize = 12;
/// What the likelihood of arrivals makes of a fault at least.
const COST_OF_FAULT: f64 = 8.3;

/// The solution of `s·p − z b = (|s|² − z²)/2 + c` by least squares, which the squares of the
/// equations are, if there are enough arrivals and they determine it. O(M).
pub(super) fn start<const D: usize, const N: usize>(
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
    // c is what the means leave
    let (mut mean, mut middle, mut total) = ([0.0; N], 0.0, 0.0);
    for m in arrivals() {
        let (s, right) = row(m);
        let weight = m.precision * m.precision;
        for i in 0..N {
            mean[i] += weight * s[i];
        }
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
            for j in 0..N {
                matrix[i][j] += weight * own[i] * own[j];
            }
        }
    }
    Some(Factor::try_new(&matrix, 0.0)?.solve(&vector))
}

/// The emission that arrivals at a position tell, some of them late. O(M).
pub(super) fn emission<const D: usize>(
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

/// The cost up to which a minimum of so many measurements needs no other starts: noise, and a fault
/// in twelve of them. If another minimum explained as many, most of both would be the same ones.
pub(super) fn trusted_cost(count: usize, unknowns: usize, fault: f64) -> f64 {
    let noise = 0.5 * (count - unknowns) as f64 + 2.0 * (0.5 * count as f64).sqrt();
    let spare = if count < unknowns + ROBUST { 0 } else { count / FAULTS_ONE_IN };
    noise + COST_OF_FAULT.min(fault) * spare as f64
}

/// The axis of the larger element of a symmetric matrix in the plane.
fn across<const D: usize>(a: &Matrix<D>) -> Vector<D> {
    let (sine, cosine) = (0.5 * (2.0 * a[0][1]).atan2(a[0][0] - a[1][1])).sin_cos();
    std::array::from_fn(|i| if i == 0 { cosine } else { sine })
}

/// A state on the other side of the line or plane that stations are nearest to: if they are on it,
/// their distances are the same from there. O(M).
pub(super) fn mirrored<const D: usize, const N: usize>(
    measurements: &[Measurement<D>],
    state: &Vector<N>,
) -> Vector<N> {
    let mut mean = [0.0; D];
    for m in measurements {
        for i in 0..D {
            mean[i] += m.station[i] / measurements.len() as f64;
        }
    }
    let mut spread: Matrix<D> = [[0.0; D]; D];
    for m in measurements {
        let offset: Vector<D> = std::array::from_fn(|i| m.station[i] - mean[i]);
        let square = dot(&offset, &offset);
        for i in 0..D {
            for j in 0..D {
                let own = if i == j { square } else { 0.0 };
                spread[i][j] += own - offset[i] * offset[j];
            }
        }
    }
    let normal = if D == 2 { across(&spread) } else { longest(&spread).0 };
    let height: f64 = (0..D).map(|i| normal[i] * (state[i] - mean[i])).sum();
    std::array::from_fn(|i| if i < D { state[i] - 2.0 * height * normal[i] } else { state[i] })
}
