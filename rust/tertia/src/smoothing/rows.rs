//! Orthogonal transformations of rows of numbers, which are stored one after the other.
//!
//! Before a column is eliminated, the row with its largest element is moved to the top. In this way rows of
//! very different size keep their digits (Powell and Reid 1969; Cox and Higham 1998), such as those of
//! precise plots and of a very vague prior.

/// Eliminates `column` below row `top` by a reflection of the rows from `top` on. Columns from `from` on are
/// transformed; those before it must be zero in these rows. Returns the element that remains, 0 for a column
/// of zeros. `sums` has room for a row.
#[inline(always)]
pub(super) fn reflect(
    a: &mut [f64],
    width: usize,
    top: usize,
    column: usize,
    from: usize,
    sums: &mut [f64],
) -> f64 {
    let a = &mut a[top * width..];
    let (mut pivot, mut largest) = (0, 0.0);
    for (i, row) in a.chunks_exact(width).enumerate() {
        if row[column].abs() > largest {
            (pivot, largest) = (i, row[column].abs());
        }
    }
    if largest == 0.0 {
        return 0.0;
    }
    let (first, others) = a.split_at_mut(width);
    if pivot > 0 {
        first.swap_with_slice(&mut others[(pivot - 1) * width..pivot * width]);
    }
    let unit = 1.0 / largest;
    let square = |x: f64| (x * unit) * (x * unit);
    let below: f64 = others.chunks_exact(width).map(|row| square(row[column])).sum();
    if below == 0.0 {
        return first[column];
    }
    let head = first[column];
    let left = -(largest * (square(head) + below).sqrt()).copysign(head);
    let v0 = head - left;
    let sums = &mut sums[..width - from];
    for (sum, x) in sums.iter_mut().zip(&first[from..]) {
        *sum = v0 * x;
    }
    for row in others.chunks_exact(width) {
        let v = row[column];
        if v != 0.0 {
            for (sum, x) in sums.iter_mut().zip(&row[from..]) {
                *sum += v * x;
            }
        }
    }
    // H = I − v v^T / (v^T v / 2), v^T v / 2 = −left v0
    let factor = -1.0 / (left * v0);
    for sum in sums.iter_mut() {
        *sum *= factor;
    }
    for (x, sum) in first[from..].iter_mut().zip(&*sums) {
        *x -= v0 * sum;
    }
    for row in others.chunks_exact_mut(width) {
        let v = row[column];
        if v != 0.0 {
            for (x, sum) in row[from..].iter_mut().zip(&*sums) {
                *x -= v * sum;
            }
            row[column] = 0.0;
        }
    }
    first[column] = left;
    left
}

/// Makes the first `n` columns upper triangular.
#[inline(always)]
pub(super) fn triangularise(a: &mut [f64], width: usize, n: usize, sums: &mut [f64]) {
    for j in 0..n {
        reflect(a, width, j, j, j + 1, sums);
    }
}

/// Reduces rows that span only `rank` dimensions in the first `n` columns to `rank` rows; below them, only
/// rounding remains in these columns. Columns with the largest remaining share of their squares are
/// eliminated first.
pub(super) fn reduce(a: &mut [f64], width: usize, n: usize, rank: usize, sums: &mut [f64]) {
    let squares = |a: &[f64], column: usize, top: usize| -> f64 {
        a.chunks_exact(width).skip(top).map(|row| row[column] * row[column]).sum()
    };
    let whole: Vec<f64> = (0..n).map(|column| squares(a, column, 0)).collect();
    let mut left: Vec<usize> = (0..n).filter(|&column| whole[column] > 0.0).collect();
    for top in 0..rank {
        let share = |column: usize| squares(a, column, top) / whole[column];
        let best = left.iter().copied().max_by(|&i, &j| share(i).total_cmp(&share(j)));
        let Some(best) = best else { return };
        left.retain(|&column| column != best);
        reflect(a, width, top, best, 0, sums);
    }
}

/// Computes x with `U x = b`, where U is the upper triangle of the first `n` columns and b the column after
/// them.
#[inline(always)]
pub(super) fn solve(a: &[f64], width: usize, n: usize, x: &mut [f64]) {
    for i in (0..n).rev() {
        let row = &a[i * width..][..width];
        let mut sum = row[n];
        for j in i + 1..n {
            sum -= row[j] * x[j];
        }
        x[i] = sum / row[i];
    }
}

/// Computes the inverse of the upper triangle of the first `n` columns, row by row; elements below it are not
/// written.
#[inline(always)]
pub(super) fn invert(a: &[f64], width: usize, n: usize, inverse: &mut [f64]) {
    for i in (0..n).rev() {
        let reciprocal = 1.0 / a[i * width + i];
        inverse[i * n + i] = reciprocal;
        for j in i + 1..n {
            inverse[i * n + j] = 0.0;
        }
        for k in i + 1..n {
            let f = -a[i * width + k] * reciprocal;
            let (above, below) = inverse.split_at_mut(k * n);
            for j in k..n {
                above[i * n + j] += f * below[j];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `(A x − b)` must have the same length before and after, for any x.
    #[test]
    fn lengths_are_kept() {
        let (rows, n) = (7, 4);
        let width = n + 1;
        let a: Vec<f64> = (0..rows * width).map(|i| (i as f64 * 0.7548).sin()).collect();
        let length = |a: &[f64], x: &[f64]| -> f64 {
            let residual = |row: &[f64]| row[..n].iter().zip(x).map(|(a, x)| a * x).sum::<f64>();
            a.chunks_exact(width).map(|row| (residual(row) - row[n]).powi(2)).sum()
        };
        let (mut sums, mut triangle) = (vec![0.0; width], a.clone());
        triangularise(&mut triangle, width, n, &mut sums);
        let mut reduced = a.clone();
        reduce(&mut reduced, width, n, n, &mut sums);
        for x in [[1.0, -2.0, 0.5, 3.0], [0.0, 4.0, -1.0, 1.0]] {
            let expected = length(&a, &x);
            for found in [&triangle, &reduced] {
                assert!((length(found, &x) - expected).abs() < 1e-13 * expected);
            }
        }
        let mut inverse = vec![0.0; n * n];
        invert(&triangle, width, n, &mut inverse);
        let mut x = vec![0.0; n];
        solve(&triangle, width, n, &mut x);
        for i in 0..n {
            let row = &inverse[i * n..][..n];
            let found: f64 = (0..n).map(|j| row[j] * triangle[j * width + n]).sum();
            assert!((found - x[i]).abs() < 1e-13);
        }
    }

    /// A row of 1e12 and one of 1e-12: the small one must keep the part that the large one does not span.
    #[test]
    fn small_rows_keep_their_digits() {
        let (large, small) = (1e12, 1e-12);
        let mut a = vec![small, 2.0 * small, 0.0, large, 0.0, 0.0];
        triangularise(&mut a, 3, 2, &mut [0.0; 3]);
        assert!((a[4].abs() / (2.0 * small) - 1.0).abs() < 1e-15);
    }

    /// Rows that span only two dimensions must be left as two rows.
    #[test]
    fn what_spans_no_more_is_zero() {
        let mut a =
            vec![1.0, 2.0, 3.0, 1.0, 2.0, 4.0, 6.0, 2.0, 0.0, 1.0, 1.0, 5.0, 1.0, 1.0, 2.0, 0.0];
        reduce(&mut a, 4, 3, 2, &mut [0.0; 4]);
        for row in a.chunks_exact(4).skip(2) {
            assert!(row[..3].iter().all(|x| x.abs() < 1e-14), "{row:?}");
        }
    }
}
