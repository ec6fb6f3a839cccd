//! Accuracy with which a mixture determines the centre of its good mode.

use super::modes::{Mode, Modes, Shape};
use pulp::{Arch, Simd, WithSimd};

/// Number of parameters of the largest mixture: centre, width, and offset, width, share of two bad
/// modes.
const MOST: usize = 8;
/// Added to the diagonal of the scaled information, so that it does not become singular if the
/// parameters of a mode with a single measurement are undetermined.
const RIDGE: f64 = 1e-6;
/// Smallest square root of an information: if a single measurement forms a mode, the score of its
/// centre is the rounding error of the measurement, which must not be scaled up.
const LEAST_SCALE: f64 = 1e-6;
/// Largest factor by which the uncertainty of the other parameters may increase the variance.
const LARGEST_LOSS: f64 = 25.0;
/// With rounded measurements, this factor is divided by `1 + 5 (step/width)²`: a mixture fits a few
/// different values so well that their scores hardly differ.
const LOSS_OF_ROUNDING: f64 = 5.0;
/// Smallest sum of squares of the measurements, relative to the sum expected from the widths.
const LEAST_SQUARES: f64 = 1e-6;

/// Returns the variance of μ from the outer products of the scores of all parameters (Berndt, Hall,
/// Hall, Hausman 1974); the scores are their expected values under the probabilities of the `bad`
/// modes. If a width is at its lower limit, the scores are smaller than expected, and are scaled up.
/// `step` is the rounding step. O(N).
pub(super) fn variance_of_centre(modes: &Modes, y: &[f64], bad: &[f64], step: f64) -> f64 {
    let arch = Arch::new();
    let (sums, size) = match modes.shape {
        Shape::Wide => (arch.dispatch(Scores::<1, 4> { modes, y, bad }), 4),
        Shape::OneSided => (arch.dispatch(Scores::<1, 5> { modes, y, bad }), 5),
        Shape::TwoSided => (arch.dispatch(Scores::<2, MOST> { modes, y, bad }), MOST),
    };
    let Sums { mut products, expected, squares } = sums;
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

/// Sums over the measurements: products of the scores, and information that the widths and the squares of the
/// measurements imply.
struct Sums {
    products: [[f64; MOST]; MOST],
    expected: f64,
    squares: f64,
}

/// Computes [`Sums`] for `KINDS` bad modes and `SIZE` parameters. O(N).
struct Scores<'a, const KINDS: usize, const SIZE: usize> {
    modes: &'a Modes,
    y: &'a [f64],
    bad: &'a [f64],
}

impl<const KINDS: usize, const SIZE: usize> WithSimd for Scores<'_, KINDS, SIZE> {
    type Output = Sums;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Sums {
        let Self { modes, y, bad } = self;
        let (wide, good_share) = (modes.shape == Shape::Wide, modes.good_share());
        let mut sums = Sums { products: [[0.0; MOST]; MOST], expected: 0.0, squares: 0.0 };
        for (&y, bad) in y.iter().zip(bad.as_chunks::<KINDS>().0) {
            let mut all = 0.0;
            for g in bad {
                all += g;
            }
            let good = 1.0 - all;
            let z = (y - modes.centre) / modes.width;
            let square = modes.width * modes.width;
            sums.expected += good / square;
            sums.squares += good * z * z / square;
            let mut score = [0.0; MOST];
            score[0] = good * z / modes.width;
            score[1] = good * (z * z - 1.0) / modes.width;
            for j in 0..KINDS {
                let (Mode { offset, width, share }, g) = (modes.bad[j], bad[j]);
                let z = (y - modes.centre - offset) / width;
                let of_centre = g * z / width;
                let of_width = g * (z * z - 1.0) / width;
                let of_share = g / share - good / good_share;
                if wide {
                    sums.expected += g / (width * width);
                    sums.squares += g * z * z / (width * width);
                    score[0] += of_centre;
                    (score[2], score[3]) = (of_width, of_share);
                } else {
                    let at = 2 + 3 * j;
                    (score[at], score[at + 1], score[at + 2]) = (of_centre, of_width, of_share);
                }
            }
            for p in 0..SIZE {
                for q in 0..SIZE {
                    sums.products[p][q] += score[p] * score[q];
                }
            }
        }
        sums
    }
}

/// Returns the first element of the inverse of a positive definite matrix, given by its lower triangle.
fn inverse_first(a: &mut [[f64; MOST]; MOST], size: usize) -> f64 {
    // after elimination from the last parameter to the first, the reciprocal of that element remains
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
