//! Polynomials that are orthogonal at the instants of a window (Forsythe 1957). No powers are formed, and
//! each additional degree adds one coefficient and leaves those of the lower degrees unchanged.

use super::scratch::refill;

/// Orthonormal polynomials on weighted points.
#[derive(Clone, Debug, Default)]
pub(crate) struct Basis {
    points: usize,
    /// Values at the points, degree by degree.
    values: Vec<f64>,
    /// Centre, ratio of the last two squared norms, and norm, for every degree.
    recursion: Vec<[f64; 3]>,
}

impl Basis {
    /// Computes the polynomials up to `degree` at the points `x` with the weights `w`; there must be more
    /// distinct points than `degree`. Cost O(points · degree).
    pub fn build(&mut self, degree: usize, x: &[f64], w: &[f64]) {
        let m = x.len();
        self.points = m;
        self.recursion.clear();
        refill(&mut self.values, (degree + 1) * m, 0.0);
        let mut last = 1.0;
        for j in 0..=degree {
            let (before, rest) = self.values.split_at_mut(j * m);
            let own = &mut rest[..m];
            let (mut square, mut moment) = (0.0, 0.0);
            for (i, own) in own.iter_mut().enumerate() {
                *own = match j {
                    0 => 1.0,
                    1 => x[i] - self.recursion[0][0],
                    _ => {
                        let [a, b, _] = self.recursion[j - 1];
                        (x[i] - a) * before[(j - 1) * m + i] - b * before[(j - 2) * m + i]
                    }
                };
                let weighted = w[i] * *own * *own;
                square += weighted;
                moment += weighted * x[i];
            }
            self.recursion.push([moment / square, square / last, square.sqrt()]);
            last = square;
        }
        for (row, [_, _, norm]) in self.values.chunks_exact_mut(m).zip(&self.recursion) {
            row.iter_mut().for_each(|value| *value /= norm);
        }
    }

    /// Returns the values of the polynomial of this degree at the points.
    pub fn row(&self, degree: usize) -> &[f64] {
        &self.values[degree * self.points..][..self.points]
    }

    /// Computes the derivatives of this order of all polynomials at x.
    pub fn derivatives(&self, derivative: usize, x: f64, out: &mut Vec<f64>) {
        let count = self.recursion.len();
        // one row for each order of derivative
        let mut table = vec![0.0; (derivative + 1) * count];
        for order in 0..=derivative {
            for j in 0..count {
                let own = order * count;
                let Some(i) = j.checked_sub(1) else {
                    table[own] = if order == 0 { 1.0 } else { 0.0 };
                    continue;
                };
                let [a, b, _] = self.recursion[i];
                let mut value = (x - a) * table[own + i];
                if order > 0 {
                    value += order as f64 * table[own - count + i];
                }
                if i > 0 {
                    value -= b * table[own + i - 1];
                }
                table[own + j] = value;
            }
        }
        out.clear();
        let last = &table[derivative * count..];
        out.extend(last.iter().zip(&self.recursion).map(|(value, [_, _, norm])| value / norm));
    }

    /// Computes the coefficients of the polynomial closest to y; returns the remaining sum of squares.
    /// `y` becomes the residuals.
    pub fn fit(&self, w: &[f64], y: &mut [f64], coefficients: &mut Vec<f64>) -> f64 {
        coefficients.clear();
        for row in self.values.chunks_exact(self.points) {
            let c: f64 = row.iter().zip(w).zip(&*y).map(|((p, w), y)| w * p * y).sum();
            y.iter_mut().zip(row).for_each(|(y, p)| *y -= c * p);
            coefficients.push(c);
        }
        w.iter().zip(&*y).map(|(w, y)| w * y * y).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orthonormal_on_weighted_points() {
        let x = [-1.0, -0.9, -0.2, 0.0, 0.0, 0.3, 0.8, 1.0];
        let w = [1.0, 2.0, 0.5, 1.0, 3.0, 1.0, 0.1, 4.0];
        let mut basis = Basis::default();
        basis.build(5, &x, &w);
        for i in 0..=5 {
            for j in 0..=5 {
                let (p, q) = (basis.row(i), basis.row(j));
                let product: f64 = (0..8).map(|k| w[k] * p[k] * q[k]).sum();
                let expected = f64::from(u8::from(i == j));
                assert!((product - expected).abs() < 1e-13, "{i} {j}: {product}");
            }
        }
        // derivatives of x^3 − 2x as a combination of the polynomials
        let y: Vec<f64> = x.iter().map(|x| x * x * x - 2.0 * x).collect();
        let (mut rest, mut c, mut at) = (y, Vec::new(), Vec::new());
        assert!(basis.fit(&w, &mut rest, &mut c) < 1e-28);
        let expected = [-0.875, -1.25, 3.0, 6.0, 0.0];
        for (order, expected) in expected.into_iter().enumerate() {
            basis.derivatives(order, 0.5, &mut at);
            let found: f64 = c.iter().zip(&at).map(|(c, p)| c * p).sum();
            assert!((found - expected).abs() < 1e-12, "{order}: {found}");
        }
    }
}
