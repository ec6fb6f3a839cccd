//! Linear systems with two or three unknowns, on the stack.

/// Smallest share of a diagonal element that the preceding components must leave in a regular matrix:
/// their directions differ by at least 1e-6.
pub(crate) const REGULAR: f64 = 1e-12;

/// Number of iterations for the longest axis.
const TURNS: usize = 50;

/// Smallest pivot of rows of length 1 that count as not parallel.
const PARALLEL: f64 = 1e-9;

pub(crate) type Matrix<const D: usize> = [[f64; D]; D];
pub(crate) type Vector<const D: usize> = [f64; D];

#[inline(always)]
pub(crate) fn dot<const D: usize>(a: &Vector<D>, b: &Vector<D>) -> f64 {
    let mut sum = 0.0;
    for i in 0..D {
        sum += a[i] * b[i];
    }
    sum
}

/// `a + factor b` in place of a.
#[inline(always)]
pub(crate) fn add_multiple<const D: usize>(a: &mut Vector<D>, factor: f64, b: &Vector<D>) {
    for i in 0..D {
        a[i] += factor * b[i];
    }
}

/// `A + weight x x^T` in place of A.
#[inline(always)]
pub(crate) fn add_outer<const D: usize>(a: &mut Matrix<D>, weight: f64, x: &Vector<D>) {
    for i in 0..D {
        add_multiple(&mut a[i], weight * x[i], x);
    }
}

/// `A^T x`, row by row: in vectors, unlike sums of products. Also `A x` of a symmetric matrix.
#[inline(always)]
pub(crate) fn product<const D: usize>(a: &Matrix<D>, x: &Vector<D>) -> Vector<D> {
    let mut sum = [0.0; D];
    for k in 0..D {
        add_multiple(&mut sum, x[k], &a[k]);
    }
    sum
}

pub(crate) fn norm<const D: usize>(a: &Vector<D>) -> f64 {
    dot(a, a).sqrt()
}

/// `A x`
pub(crate) fn rotated<const D: usize>(a: &Matrix<D>, x: &Vector<D>) -> Vector<D> {
    std::array::from_fn(|i| dot(&a[i], x))
}

/// `A^T x` of a rotation.
pub(crate) fn rotated_back<const D: usize>(a: &Matrix<D>, x: &Vector<D>) -> Vector<D> {
    product(a, x)
}

/// `x^T A x`
pub(crate) fn quadratic<const D: usize>(a: &Matrix<D>, x: &Vector<D>) -> f64 {
    let mut sum = 0.0;
    for i in 0..D {
        sum += x[i] * dot(&a[i], x);
    }
    sum
}

/// `A + B` in place of A.
pub(crate) fn add<const D: usize>(a: &mut Matrix<D>, b: &Matrix<D>) {
    for i in 0..D {
        for j in 0..D {
            a[i][j] += b[i][j];
        }
    }
}

/// Copies the upper triangle to the lower one. In a recursion `F A F^T`, an antisymmetric part from
/// rounding grows with the powers of time in F although the measurements keep A itself small. After
/// 300 steps it cost a likelihood seven digits; after 10,000 steps a smoothed variance had no correct digit.
#[inline(always)]
pub(crate) fn symmetrise<const D: usize>(a: &mut Matrix<D>) {
    for r in 0..D {
        for c in 0..r {
            a[r][c] = a[c][r];
        }
    }
}

/// Cholesky factor of a symmetric matrix after scaling to a unit diagonal.
pub(crate) struct Factor<const D: usize> {
    lower: Matrix<D>,
    scale: Vector<D>,
}

impl<const D: usize> Factor<D> {
    /// Factorises `A + damping diag A`; `None` if it is singular to working precision.
    pub fn try_new(a: &Matrix<D>, damping: f64) -> Option<Self> {
        let mut scale = [0.0; D];
        for i in 0..D {
            if a[i][i] <= 0.0 || !a[i][i].is_finite() {
                return None;
            }
            scale[i] = 1.0 / a[i][i].sqrt();
        }
        let mut lower = [[0.0; D]; D];
        for i in 0..D {
            for j in 0..i {
                let mut sum = a[i][j] * scale[i] * scale[j];
                for k in 0..j {
                    sum -= lower[i][k] * lower[j][k];
                }
                lower[i][j] = sum / lower[j][j];
            }
            let mut pivot = 1.0 + damping;
            for k in 0..i {
                pivot -= lower[i][k] * lower[i][k];
            }
            if pivot.is_nan() || pivot <= REGULAR {
                return None;
            }
            lower[i][i] = pivot.sqrt();
        }
        Some(Self { lower, scale })
    }

    /// `A^-1 b`
    pub fn solve(&self, b: &Vector<D>) -> Vector<D> {
        let mut x = [0.0; D];
        for i in 0..D {
            let mut sum = b[i] * self.scale[i];
            for k in 0..i {
                sum -= self.lower[i][k] * x[k];
            }
            x[i] = sum / self.lower[i][i];
        }
        for i in (0..D).rev() {
            let mut sum = x[i];
            for k in i + 1..D {
                sum -= self.lower[k][i] * x[k];
            }
            x[i] = sum / self.lower[i][i];
        }
        for i in 0..D {
            x[i] *= self.scale[i];
        }
        x
    }

    /// `ln |A|`, for a factor without damping.
    pub fn ln_determinant(&self) -> f64 {
        (0..D).map(|i| 2.0 * (self.lower[i][i] / self.scale[i]).ln()).sum()
    }

    /// `A^-1 = L^-T L^-1`, symmetric to the last bit; rounding does not make it indefinite.
    pub fn inverse(&self) -> Matrix<D> {
        let mut root = [[0.0; D]; D];
        for j in 0..D {
            root[j][j] = 1.0 / self.lower[j][j];
            for i in j + 1..D {
                let sum: f64 = (j..i).map(|k| self.lower[i][k] * root[k][j]).sum();
                root[i][j] = -sum / self.lower[i][i];
            }
        }
        let mut inverse = [[0.0; D]; D];
        for i in 0..D {
            for j in 0..=i {
                let sum: f64 = (i..D).map(|k| root[k][i] * root[k][j]).sum();
                inverse[i][j] = sum * (self.scale[i] * self.scale[j]);
                inverse[j][i] = inverse[i][j];
            }
        }
        inverse
    }
}

/// Solves `N p = a + b t` for a regular N by elimination with pivoting: `p = u + v t`.
pub(crate) fn solve_line<const D: usize>(
    mut n: Matrix<D>,
    mut a: Vector<D>,
    mut b: Vector<D>,
) -> Option<(Vector<D>, Vector<D>)> {
    for column in 0..D {
        let mut pivot = column;
        for row in column + 1..D {
            if n[row][column].abs() > n[pivot][column].abs() {
                pivot = row;
            }
        }
        if n[pivot][column].is_nan() || n[pivot][column].abs() <= PARALLEL {
            return None;
        }
        n.swap(column, pivot);
        a.swap(column, pivot);
        b.swap(column, pivot);
        for row in column + 1..D {
            let factor = n[row][column] / n[column][column];
            for k in column..D {
                n[row][k] -= factor * n[column][k];
            }
            a[row] -= factor * a[column];
            b[row] -= factor * b[column];
        }
    }
    for i in (0..D).rev() {
        for k in i + 1..D {
            a[i] -= n[i][k] * a[k];
            b[i] -= n[i][k] * b[k];
        }
        a[i] /= n[i][i];
        b[i] /= n[i][i];
    }
    Some((a, b))
}

/// Real roots of `a t² + 2 b t + c`; if there are none, twice the t at which it is nearest to zero.
pub(crate) fn roots(a: f64, b: f64, c: f64) -> [f64; 2] {
    let discriminant = b * b - a * c;
    if discriminant.is_nan() || discriminant <= 0.0 {
        return [-b / a; 2];
    }
    let q = -(b + discriminant.sqrt().copysign(b));
    [q / a, c / q]
}

/// Axis of the largest variance, by power iteration.
pub(crate) fn longest<const D: usize>(covariance: &Matrix<D>) -> (Vector<D>, f64) {
    let mut largest = 0;
    for i in 1..D {
        if covariance[i][i] > covariance[largest][largest] {
            largest = i;
        }
    }
    let mut axis = covariance[largest];
    for _ in 0..TURNS {
        let length = norm(&axis);
        axis = axis.map(|v| v / length);
        axis = std::array::from_fn(|i| dot(&covariance[i], &axis));
    }
    let variance = norm(&axis);
    (axis.map(|v| v / variance), variance)
}

/// Covariance of an undetermined vector: infinite variances, and nan between them.
pub fn undetermined<const D: usize>() -> Matrix<D> {
    std::array::from_fn(|i| std::array::from_fn(|j| if i == j { f64::INFINITY } else { f64::NAN }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inverse_times_the_matrix_is_the_identity() {
        let a = [[4e6, 1e3, 2.0], [1e3, 2.0, 1e-3], [2.0, 1e-3, 3e-6]];
        let inverse = Factor::try_new(&a, 0.0).unwrap().inverse();
        for i in 0..3 {
            for j in 0..3 {
                let product: f64 = (0..3).map(|k| inverse[i][k] * a[k][j]).sum();
                let scale = (a[j][j] / a[i][i]).sqrt();
                assert!((product - f64::from(u8::from(i == j))).abs() <= 1e-14 * scale);
            }
        }
        assert!(Factor::try_new(&[[1.0, 2.0], [2.0, 4.0]], 0.0).is_none());
        assert!(Factor::try_new(&[[1.0, f64::NAN], [f64::NAN, 4.0]], 0.0).is_none());
    }

    #[test]
    fn a_line_of_solutions() {
        let (u, v) = solve_line([[0.0, 1.0], [0.6, 0.8]], [2.0, 1.0], [0.0, 3.0]).unwrap();
        assert!((u[0] + 1.0).abs() < 1e-15 && (u[1] - 2.0).abs() < 1e-15);
        assert!((v[0] - 5.0).abs() < 1e-15 && v[1].abs() < 1e-15);
        assert!(solve_line([[0.0, 1.0], [0.0, -1.0]], [1.0; 2], [0.0; 2]).is_none());
    }

    #[test]
    fn roots_do_not_cancel() {
        let [x, y] = roots(1.0, -1e9, 1.0);
        assert!((x - 2e9).abs() < 1.0 && (y * 2e9 - 1.0).abs() < 1e-12);
        assert_eq!(roots(1.0, 1.0, 5.0), [-1.0, -1.0]);
    }
}
