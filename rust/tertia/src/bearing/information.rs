//! How well a mixture determines the centre of its good mode.

use super::modes::{Modes, Shape};

/// Parameters of the largest mixture: centre, width, and offset, width, share of two bad modes.
const MOST: usize = 8;
/// Added to the diagonal of the scaled information, so that a mode of a single measurement, whose
/// parameters nothing determines, does not make it singular.
const RIDGE: f64 = 1e-6;
/// Least root of an information: where a single measurement is a mode, the score of its centre is the
/// rounding error of the measurement, and must not be scaled up.
const LEAST_SCALE: f64 = 1e-6;
/// The other parameters may cost at most this much of the variance...
const LARGEST_LOSS: f64 = 25.0;
/// ...and less, by `1 + 5 (step/width)²`, where the measurements are rounded: a mixture fits a few
/// different values so well that their scores hardly differ.
const LOSS_OF_ROUNDING: f64 = 5.0;
/// Least squares of the measurements, over what their widths expect.
const LEAST_SQUARES: f64 = 1e-6;

/// Variance of μ from the outer products of the scores of all parameters (Berndt, Hall, Hall, Hausman
/// 1974), with the expected scores under the probabilities of the `bad` modes. Where a width is at its
/// floor, the scores are smaller than their expectation, and are scaled up. `step` is that of rounding. O(N).
pub(super) fn variance_of_centre(modes: &Modes, y: &[f64], bad: &[f64], step: f64) -> f64 {
    let (kinds, wide) = (modes.kinds(), modes.shape == Shape::Wide);
    let size = if wide { 4 } else { 2 + 3 * kinds };
    let good_share = modes.good_share();
    let mut products = [[0.0; MOST]; MOST];
    let (mut expected, mut squares) = (0.0, 0.0);
    let mut add = |share: f64, z: f64, width: f64| {
        expected += share / (width * width);
        squares += share * z * z / (width * width);
    };
    for (&y, bad) in y.iter().zip(bad.chunks_exact(kinds)) {
        let good = 1.0 - bad.iter().sum::<f64>();
        let z = (y - modes.centre) / modes.width;
        let mut score = [0.0; MOST];
        add(good, z, modes.width);
        score[0] = good * z / modes.width;
        score[1] = good * (z * z - 1.0) / modes.width;
        for (j, (mode, &g)) in modes.bad.iter().zip(bad).enumerate() {
            let z = (y - modes.centre - mode.offset) / mode.width;
            let of_width = g * (z * z - 1.0) / mode.width;
            let of_share = g / mode.share - good / good_share;
            if wide {
                add(g, z, mode.width);
                score[0] += g * z / mode.width;
                (score[2], score[3]) = (of_width, of_share);
            } else {
                let at = 2 + 3 * j;
                (score[at], score[at + 1], score[at + 2]) =
                    (g * z / mode.width, of_width, of_share);
            }
        }
        for p in 0..size {
            for q in 0..=p {
                products[p][q] += score[p] * score[q];
            }
        }
    }
    let least = LEAST_SQUARES * expected;
    let information = expected * (products[0][0] + least) / (squares + least);
    let scale: Vec<f64> = (0..size).map(|p| products[p][p].sqrt().max(LEAST_SCALE)).collect();
    for p in 0..size {
        for q in 0..=p {
            products[p][q] /= scale[p] * scale[q];
        }
        products[p][p] += RIDGE;
    }
    let rounded = 1.0 + LOSS_OF_ROUNDING * (step / modes.width).powi(2);
    let largest = (LARGEST_LOSS / rounded).max(1.0);
    inverse_first(&mut products, size).clamp(1.0, largest) / information
}

/// First element of the inverse of a positive definite matrix, given by its lower triangle.
fn inverse_first(a: &mut [[f64; MOST]; MOST], size: usize) -> f64 {
    // eliminated from the last parameter to the first, what remains is one over that element
    for p in (1..size).rev() {
        for q in 0..p {
            let factor = a[p][q] / a[p][p];
            for r in 0..=q {
                a[q][r] -= factor * a[p][r];
            }
        }
    }
    1.0 / a[0][0]
}
