//! An instant linearised about a position: residuals, derivatives, and the effect of biases.

use crate::base::small::{Factor, Matrix, Vector, add_multiple, add_outer, dot};
use crate::sensors::{KINDS, Kind};
use crate::trajectory::measured::{Measured, Place};
use nalgebra::{DMatrix, DVector};
use std::ops::Range;

/// Least information of an anchor, relative to that of an instant that does not determine its position.
pub(in crate::trajectory) const LEAST_ANCHOR: f64 = 1e-10;

/// An instant as it is seen from the stations: its number, and where and how fast the target is.
pub(in crate::trajectory) struct Seen<const D: usize> {
    pub t: usize,
    pub place: Place<D>,
    pub velocity: Vector<D>,
}

/// An instant with the effect of biases.
pub(in crate::trajectory) struct Instant<const D: usize> {
    /// The measurements; those that have an unknown in common are taken less their mean.
    pub rows: Vec<Single<D>>,
    /// `(J' W J)^-1`, with an anchor in directions that the instant does not determine.
    pub inverse: Option<Matrix<D>>,
    /// `A`: shift of the position by each bias.
    solution: Vec<Vector<D>>,
    /// `I − H`, a row for each measurement and a column for each bias.
    pub kept: Vec<f64>,
    /// Information about each bias if the position were known: the largest possible one.
    pub largest: Vec<f64>,
    groups: Vec<Group>,
}

impl<const D: usize> Instant<D> {
    /// Linearises an instant about a position; `weight` holds a weight over σ² for each measurement of the
    /// record.
    pub fn new(
        measured: &Measured<D>,
        own: Seen<D>,
        weight: &[f64],
        columns: &[usize],
        anchor: f64,
    ) -> Self {
        Self::of_rows(rows_of(measured, own, weight), (columns, measured.width), anchor)
    }

    /// Combines several instants into one, with an unknown shift that all of them have in common.
    pub fn together(
        measured: &Measured<D>,
        instants: impl Iterator<Item = Seen<D>>,
        weight: &[f64],
        columns: &[usize],
    ) -> Self {
        let (mut rows, mut groups) = (Vec::new(), Vec::new());
        for one in instants {
            let (own, shared) = rows_of(measured, one, weight);
            let moved =
                |(range, total): Group| (range.start + rows.len()..range.end + rows.len(), total);
            groups.extend(shared.into_iter().map(moved));
            rows.extend(own);
        }
        Self::of_rows((rows, groups), (columns, measured.width), 0.0)
    }

    fn of_rows(
        (rows, groups): (Vec<Single<D>>, Vec<Group>),
        (columns, width): (&[usize], usize),
        anchor: f64,
    ) -> Self {
        let mut normal: Matrix<D> =
            std::array::from_fn(|i| std::array::from_fn(|j| if i == j { anchor } else { 0.0 }));
        for (_, weight, _, gradient, _) in &rows {
            add_outer(&mut normal, *weight, gradient);
        }
        let inverse = inverse_of(normal);
        let own = inverse.unwrap_or([[0.0; D]; D]);
        let mut solution = vec![[0.0; D]; columns.len()];
        let mut largest = vec![0.0; columns.len()];
        for (at, column) in columns.iter().enumerate() {
            let solution = &mut solution[at];
            for (row, effect) in rows.iter().map(|row| (row, effect(row, *column, width))) {
                let (_, w, _, gradient, _) = row;
                largest[at] += w * effect * effect;
                for i in (0..D).filter(|_| effect != 0.0) {
                    solution[i] += w * dot(&own[i], gradient) * effect;
                }
            }
        }
        let mut kept = Vec::with_capacity(rows.len() * columns.len());
        for row in &rows {
            for (solution, column) in solution.iter().zip(columns) {
                kept.push(effect(row, *column, width) - dot(&row.3, solution));
            }
        }
        for (range, total) in &groups {
            for (i, column) in columns.iter().enumerate() {
                let own = rows[range.clone()].iter().find(|(own, ..)| own == column);
                let mean = own.map_or(0.0, |(_, w, ..)| w / total);
                range.clone().for_each(|at| kept[at * columns.len() + i] -= mean);
            }
        }
        Self { rows, inverse, solution, kept, largest, groups }
    }

    /// Adds `(I − H)' diag(v) (I − H)` to `sum`.
    pub fn add_information(&self, v: impl Fn(usize) -> f64, sum: &mut DMatrix<f64>) {
        let p = self.solution.len();
        for (i, kept) in self.kept.chunks_exact(p.max(1)).enumerate() {
            let v = v(i);
            for a in 0..p {
                for b in 0..p {
                    sum[(a, b)] += kept[a] * v * kept[b];
                }
            }
        }
    }

    /// Adds the scores of the biases that errors of the columns cause to `sum`.
    pub fn add_scores(&self, errors: &[f64], sum: &mut DVector<f64>) {
        let p = self.solution.len();
        for (kept, (column, w, ..)) in self.kept.chunks_exact(p.max(1)).zip(&self.rows) {
            for a in 0..p {
                sum[a] += kept[a] * w * errors[*column];
            }
        }
    }

    /// Returns errors of the columns, one for each row, less the parts that the position explains.
    pub fn unexplained(&self, errors: &[f64]) -> Vec<f64> {
        let mut own: Vec<f64> = self.rows.iter().map(|(column, ..)| errors[*column]).collect();
        for (range, total) in &self.groups {
            let sum: f64 = range.clone().map(|i| self.rows[i].1 * own[i]).sum();
            own[range.clone()].iter_mut().for_each(|v| *v -= sum / total);
        }
        let inverse = self.inverse.unwrap_or([[0.0; D]; D]);
        let mut moved = [0.0; D];
        for ((_, w, _, gradient, _), error) in self.rows.iter().zip(&own) {
            for i in 0..D {
                moved[i] += w * error * dot(&inverse[i], gradient);
            }
        }
        let rows = own.iter().zip(&self.rows);
        rows.map(|(error, (_, _, _, gradient, _))| error - dot(gradient, &moved)).collect()
    }

    /// Returns the residuals less the parts that the position and these biases explain.
    pub fn left(&self, values: &DVector<f64>) -> Vec<f64> {
        let mut moved = [0.0; D];
        let inverse = self.inverse.unwrap_or([[0.0; D]; D]);
        for (_, w, r, gradient, _) in &self.rows {
            for i in 0..D {
                moved[i] += w * r * dot(&inverse[i], gradient);
            }
        }
        let kept = self.kept.chunks_exact(values.len());
        let bias = kept.map(|kept| kept.iter().zip(values).map(|(k, b)| k * b).sum::<f64>());
        let rows = self.rows.iter().zip(bias);
        rows.map(|((_, _, r, gradient, _), bias)| r - dot(gradient, &moved) - bias).collect()
    }

    /// Share of the error of a measurement that remains in its residual: `1 − H`.
    pub fn share(&self, i: usize) -> f64 {
        let (_, w, _, gradient, _) = &self.rows[i];
        let inverse = self.inverse.unwrap_or([[0.0; D]; D]);
        let group = self.groups.iter().find(|(range, _)| range.contains(&i));
        let mean = group.map_or(0.0, |(_, total)| w / total);
        1.0 - mean - (0..D).map(|k| w * gradient[k] * dot(&inverse[k], gradient)).sum::<f64>()
    }
}

/// Column of a measurement, its weight over σ², residual and derivatives, and its change by an error of 1 of
/// the clock.
type Single<const D: usize> = (usize, f64, f64, Vector<D>, f64);

/// Change of a measurement by an error of 1 of a column or, if these are counted after the `width` columns,
/// of the clock of a station.
fn effect<const D: usize>(row: &Single<D>, column: usize, width: usize) -> f64 {
    match column.checked_sub(width) {
        Some(station) if row.0 % (width / KINDS) == station => row.4,
        Some(_) => 0.0,
        None => f64::from(u8::from(row.0 == column)),
    }
}

/// Rows that have an unknown in common, and the sum of their weights.
type Group = (Range<usize>, f64);

/// Returns the measurements of an instant, and which of them have an unknown in common: arrivals share the
/// emission. It is eliminated by subtracting means; a single arrival gives no information and is left out.
fn rows_of<const D: usize>(
    measured: &Measured<D>,
    Seen { t, place, velocity }: Seen<D>,
    weight: &[f64],
) -> (Vec<Single<D>>, Vec<Group>) {
    let mut rows = Vec::new();
    for (m, row) in measured.rows(t, place) {
        if weight[m] > 0.0 {
            let sigma = 1.0 / measured.precision(m);
            let gradient = row.gradient.map(|v| v * sigma);
            // heights are those of the instant, whatever the clocks of the stations
            let late = match measured.one(m).kind {
                Kind::Height => 0.0,
                _ => -dot(&gradient, &velocity),
            };
            rows.push((measured.column[m], weight[m], row.residual * sigma, gradient, late));
        }
    }
    let mut groups = Vec::new();
    if !measured.is_timed {
        return (rows, groups);
    }
    // arrivals together
    rows.sort_by_key(|(column, ..)| *column);
    let arrivals = arrivals_of(&rows, measured);
    if arrivals.len() > 1 {
        groups.push(centred(&mut rows, arrivals));
    } else {
        rows.drain(arrivals);
    }
    (rows, groups)
}

/// Range of the arrivals, among rows in the order of their columns.
fn arrivals_of<const D: usize>(rows: &[Single<D>], measured: &Measured<D>) -> Range<usize> {
    let k = measured.receivers();
    let before = |end: usize| rows.partition_point(|(column, ..)| *column < end * k);
    before(Kind::Arrival as usize)..before(Kind::Arrival as usize + 1)
}

/// Subtracts the mean of some rows from each.
fn centred<const D: usize>(rows: &mut [Single<D>], own: Range<usize>) -> Group {
    let (mut total, mut residual, mut gradient) = (0.0, 0.0, [0.0; D]);
    for (_, w, r, g, _) in &rows[own.clone()] {
        total += w;
        residual += w * r;
        add_multiple(&mut gradient, *w, g);
    }
    for (_, _, r, g, _) in &mut rows[own.clone()] {
        *r -= residual / total;
        for i in 0..D {
            g[i] -= gradient[i] / total;
        }
    }
    (own, total)
}

/// Returns by how much biases of 1 move the positions of the instants, (P, N, D), nan where unknown, and the
/// covariances of the positions (N, D, D).
pub(in crate::trajectory) fn responses<const D: usize>(
    instants: &[Instant<D>],
    p: usize,
) -> (Vec<Vec<f64>>, Vec<f64>) {
    let mut responses = vec![vec![f64::NAN; instants.len() * D]; p];
    let mut spread = vec![f64::NAN; instants.len() * D * D];
    for (t, instant) in instants.iter().enumerate() {
        let Some(inverse) = instant.inverse else { continue };
        for (response, solution) in responses.iter_mut().zip(&instant.solution) {
            response[t * D..][..D].copy_from_slice(solution);
        }
        for (i, row) in inverse.iter().enumerate() {
            spread[(t * D + i) * D..][..D].copy_from_slice(row);
        }
    }
    (responses, spread)
}

/// Returns the inverse, with an anchor if the inverse would be dominated by rounding errors.
fn inverse_of<const D: usize>(mut normal: Matrix<D>) -> Option<Matrix<D>> {
    let trace = |matrix: &Matrix<D>| (0..D).map(|i| matrix[i][i]).sum::<f64>();
    let total = trace(&normal);
    let own = Factor::try_new(&normal, 0.0).map(|factor| factor.inverse());
    if own.as_ref().is_some_and(|own| trace(own) * total < 1.0 / LEAST_ANCHOR) {
        return own;
    }
    (0..D).for_each(|i| normal[i][i] += LEAST_ANCHOR * total);
    Factor::try_new(&normal, 0.0).map(|factor| factor.inverse())
}
