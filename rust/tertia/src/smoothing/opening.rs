//! The state that the first three plots determine, computed without rows of information.

// indices are those of the formulas
#![allow(clippy::needless_range_loop)]

use super::information::Logarithms;
use super::motion::ProcessNoise;
use super::seen::ENOUGH;
use super::track::Track;
use crate::base::small::Matrix;

/// Largest ratio of the two steps; beyond it, digits would be lost.
const UNEVEN: f64 = 1e2;

/// Derivatives at the third instant of the parabolas that are 1 at one of three instants and 0 at the others,
/// from the times between first and third, second and third, and first and second instant.
fn derivatives([a, b, c]: [f64; 3]) -> [[f64; 3]; 3] {
    [
        [0.0, 0.0, 1.0],
        [b / (a * c), -a / (b * c), (a + b) / (a * b)],
        [2.0 / (a * c), -2.0 / (b * c), 2.0 / (a * b)],
    ]
}

/// Returns the state after the third instant: that of the parabola through the plots.
pub(super) fn state_of_three<const M: usize, const N: usize>(track: &Track<'_>) -> [f64; N] {
    let mut x = [0.0; N];
    let &[first, second, third, ..] = track.times else { return x };
    let t = derivatives([third - first, third - second, second - first]);
    for k in 0..ENOUGH {
        for (m, t) in t.iter().enumerate() {
            for i in 0..M {
                x[m * M + i] += t[k] * track.plot(k)[i];
            }
        }
    }
    x
}

/// Returns state and covariance after the third instant, if the plots are complete positions at three
/// different times, and the contribution of the plots to the logarithm of the likelihood.
///
/// The covariance includes those of the plots and the process noise between them.
pub(super) fn of_three<const M: usize, const N: usize>(
    track: &Track<'_>,
    motion: ProcessNoise,
) -> Option<([f64; N], Matrix<N>, Logarithms)> {
    let &[first, second, third, ..] = track.times else { return None };
    let (a, b, c) = (third - first, third - second, second - first);
    let even = 3 * M == N && b > 0.0 && c > 0.0 && b.max(c) <= UNEVEN * b.min(c);
    if !even || (0..ENOUGH).any(|k| track.plot(k).iter().any(|y| y.is_nan())) {
        return None;
    }
    let t = derivatives([a, b, c]);
    let x = state_of_three::<M, N>(track);
    let (mut p, mut logarithms) = ([[0.0; N]; N], Logarithms::NONE);
    for k in 0..ENOUGH {
        let own = covariance::<M>(track.whitener(k));
        for i in 0..M {
            logarithms.add(track.whitener(k)[i * M + i]);
            for m in 0..ENOUGH {
                for (n, j) in (0..N).map(|column| (column / M, column % M)) {
                    p[m * M + i][n * M + j] += t[m][k] * t[n][k] * own[i][j];
                }
            }
        }
    }
    for state in moved([a, b, c], motion, &t) {
        for (i, m, n) in (0..N).flat_map(|r| (0..ENOUGH).map(move |n| (r % M, r / M, n))) {
            p[m * M + i][n * M + i] += motion.on(i, M) * state[m] * state[n];
        }
    }
    (0..M).for_each(|_| logarithms.add(0.5 * a * b * c));
    x.iter().all(|x| x.is_finite()).then_some((x, p, logarithms))
}

/// Change of the state of an axis, as given by its plots, by the numbers of unit variance that drive the
/// motion after the second and after the first instant.
fn moved([a, b, c]: [f64; 3], motion: ProcessNoise, t: &[[f64; 3]; 3]) -> [[f64; 3]; 6] {
    let columns = |over: f64| {
        let [g00, g10, g11, g20, g21, g22] = motion.noise_root(over);
        [[g00, g10, g20], [0.0, g11, g21], [0.0, 0.0, g22]]
    };
    // position this long before
    let before = |s: f64, g: &[f64; 3]| g[0] - s * g[1] + 0.5 * s * s * g[2];
    let late = columns(b);
    let early = if c == b { late } else { columns(c) };
    std::array::from_fn(|at| {
        let [first, second] = match at {
            0..3 => [before(a, &late[at]), before(b, &late[at])],
            _ => [before(c, &early[at - 3]), 0.0],
        };
        std::array::from_fn(|m| t[m][0] * first + t[m][1] * second)
    })
}

/// `L L'`, from the inverse of L.
fn covariance<const D: usize>(whitener: &[f64]) -> [[f64; D]; D] {
    let mut lower = [[0.0; D]; D];
    for i in 0..D {
        let reciprocal = 1.0 / whitener[i * D + i];
        lower[i][i] = reciprocal;
        for j in 0..i {
            let sum: f64 = (j..i).map(|k| whitener[i * D + k] * lower[k][j]).sum();
            lower[i][j] = -sum * reciprocal;
        }
    }
    std::array::from_fn(|i| {
        std::array::from_fn(|j| (0..D).map(|k| lower[i][k] * lower[j][k]).sum())
    })
}

#[cfg(test)]
mod tests {
    use super::super::whitener::Noise;
    use super::*;

    #[test]
    fn only_where_three_plots_are_enough() {
        let of = |times: &[f64; 3], y: &[f64; 3]| {
            let track = Track::try_new(1, times, y, Noise::Same(&[1.0]), None).unwrap();
            of_three::<1, 3>(&track, ProcessNoise::with_jerk(1.0)).is_some()
        };
        assert!(of(&[0.0, 1.0, 2.0], &[0.0, 1.0, 0.0]));
        assert!(!of(&[0.0, 1.0, 1.0], &[0.0, 1.0, 0.0]));
        assert!(!of(&[0.0, 1.0, 1e3], &[0.0, 1.0, 0.0]));
        assert!(!of(&[0.0, 1.0, 2.0], &[0.0, f64::NAN, 0.0]));
    }
}
