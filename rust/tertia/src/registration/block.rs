//! Information of the plots of one target by several radars within a short time about the errors of the
//! radars.
//!
//! The target moves with constant acceleration, of which only the size is known. Position, velocity and
//! acceleration are eliminated by projection, so no state of a target is needed; so is the square of the
//! height if ranges are slant and no height is known. Errors are in units of their prior standard deviations.
//! Cost O(n + q²) for n plots and q errors.

use super::sighting::{ERRORS, KINDS, Sighting};
use crate::base::matrix::solve_definite;
use crate::base::small::{Factor, rotated};
use nalgebra::{DMatrix, DVector, Vector2};
use std::collections::BTreeMap;

/// Number of parameters of the motion: position, velocity and half the acceleration, east and north each.
const MOTION: usize = 6;
/// Least number of plots of a block.
const FEWEST: usize = 3;
/// Standard deviation of the prior of the squared height, relative to the largest squared height. All blocks
/// of a target have the same height, so the prior must be wide enough that they do not gain information from
/// it together.
const WIDE: f64 = 30.0;

/// Normal equations of the errors of the radars of one block, about the errors removed before.
#[derive(Clone, Debug)]
pub(super) struct Block {
    /// Columns of the errors of its radars among those of all radars.
    pub columns: Vec<usize>,
    /// `Gᵀ M G` and `Gᵀ M y`.
    pub information: DMatrix<f64>,
    pub score: DVector<f64>,
    /// `yᵀ M y`.
    pub square: f64,
    /// Number of measurements, and of priors of the acceleration, less the number of unknowns of the motion.
    pub free: usize,
    /// The diagonal of `M`, two numbers for each plot.
    pub redundancy: Vec<[f64; 2]>,
    /// The plots in units of their standard deviations.
    seen: Vec<Seen>,
    /// Fitted motion if there are no errors, and its change by a unit of each error.
    motion: Vec<[f64; MOTION]>,
    /// Estimate of the height, if it is unknown.
    lift: Option<Lift>,
}

/// The squared height of a target, over its prior standard deviation.
#[derive(Clone, Debug)]
struct Lift {
    /// Estimate from the measurements, and its change by a unit of each error.
    value: Vec<f64>,
    /// Change of the motion by a unit of the squared height.
    motion: [f64; MOTION],
}

/// A plot of a block.
#[derive(Clone, Copy, Debug)]
struct Seen {
    /// Time from the middle of the block, in units of half its duration.
    time: f64,
    /// Along and across: direction over the standard deviation, position, and its change by each error.
    axes: [Vector2<f64>; 2],
    place: [f64; 2],
    design: [[f64; ERRORS]; 2],
    /// First of the errors of its radar in the block, and their number.
    first: usize,
    count: usize,
    /// Change along by a unit of the squared height.
    lift: f64,
}

/// For each radar, the columns of its errors among those of all radars and their prior sigmas; none for an
/// error that it cannot have.
pub(super) type Unknowns = Vec<Unknown>;

/// The same of one radar.
pub(super) type Unknown = [Option<(usize, f64)>; ERRORS];

/// Covariance of the errors of all radars before a block.
pub(super) struct Known<'a> {
    covariance: &'a DMatrix<f64>,
    /// Inverses of the parts of the covariance that have been used, by their columns.
    inverses: BTreeMap<Vec<usize>, Option<DMatrix<f64>>>,
}

impl<'a> Known<'a> {
    pub fn new(covariance: &'a DMatrix<f64>) -> Self {
        Self { covariance, inverses: BTreeMap::new() }
    }

    fn inverse(&mut self, columns: &[usize]) -> Option<&DMatrix<f64>> {
        if !self.inverses.contains_key(columns) {
            let own = self.covariance.select_rows(columns).select_columns(columns);
            let inverse = own.cholesky().map(|factor| factor.inverse());
            self.inverses.insert(columns.to_vec(), inverse);
        }
        self.inverses[columns].as_ref()
    }
}

impl Block {
    /// Sets up a block from sightings, in order of time, of a target with accelerations of about
    /// `acceleration`, m/s². Returns none if there are too few.
    pub fn new(sightings: &[Sighting], unknowns: &Unknowns, acceleration: f64) -> Option<Self> {
        Self::at_velocity(sightings, unknowns, acceleration, None)
    }

    /// As `new`, with the velocity by which a clock error displaces plots; none: that of a weighted straight
    /// line.
    fn at_velocity(
        sightings: &[Sighting],
        unknowns: &Unknowns,
        acceleration: f64,
        velocity: Option<Vector2<f64>>,
    ) -> Option<Self> {
        let n = sightings.len();
        if n < FEWEST {
            return None;
        }
        let (first, last) = (sightings[0].time, sightings[n - 1].time);
        let (middle, half) = (f64::midpoint(first, last), (0.5 * (last - first)).max(1e-3));
        let centre = sightings.iter().map(|one| one.position).sum::<Vector2<f64>>() / n as f64;
        let mut seen: Vec<Seen> =
            sightings.iter().map(|one| Seen::new(one, centre, middle, half)).collect();
        let mut is_slant = false;
        for (seen, one) in seen.iter_mut().zip(sightings) {
            if let Some(highest) = one.highest {
                seen.lift = one.lift(WIDE * highest) / one.sigma[0];
                is_slant = true;
            }
        }
        let (mut normal, right) = normal_equations(&seen);
        let velocity = match velocity {
            Some(velocity) => velocity,
            None => line(&normal, &right)? / half,
        };
        for side in 0..2 {
            // the unknown is half the acceleration times the square of half the duration
            normal[4 + side][4 + side] += (2.0 / (half * half * acceleration)).powi(2);
        }
        let spread = Factor::try_new(&normal, 0.0)?.inverse();
        let columns = columns_of(sightings, unknowns);
        // positions say little of the range, as their errors last: any bias of the directions would matter
        let has_places = sightings.iter().any(|one| one.is_placed);
        let fitted = has_places.then(|| rotated(&spread, &right));
        for (seen, one) in seen.iter_mut().zip(sightings) {
            let at = |motion| one.seen_at(centre + seen.place_in(motion));
            let one = fitted.as_ref().map_or(*one, at);
            seen.err(&one, velocity, &unknowns[one.radar], &columns);
        }
        let (mut sums, rights) = products(&seen, right, columns.len());
        let mut motion: Vec<[f64; MOTION]> =
            rights.iter().map(|one| rotated(&spread, one)).collect();
        for (j, right) in rights.iter().enumerate() {
            for (i, motion) in motion.iter().enumerate().take(j + 1) {
                let explained: f64 = right.iter().zip(motion).map(|(a, b)| a * b).sum();
                sums[(i, j)] -= explained;
                sums[(j, i)] = sums[(i, j)];
            }
        }
        let q = columns.len();
        let reach = reach(&spread);
        let mut redundancy: Vec<[f64; 2]> = seen.iter().map(|one| one.redundancy(&reach)).collect();
        let last = motion.pop()?;
        let lift = is_slant.then(|| {
            let variance = 1.0 / (1.0 + sums[(q + 1, q + 1)]);
            for (one, redundancy) in seen.iter().zip(&mut redundancy) {
                let left = one.residual_of([one.lift, 0.0], &last);
                for axis in 0..2 {
                    redundancy[axis] -= left[axis] * left[axis] * variance;
                }
            }
            let value: Vec<f64> = (0..=q).map(|j| sums[(q + 1, j)] * variance).collect();
            for i in 0..=q {
                for j in 0..=q {
                    sums[(i, j)] -= value[i] * value[j] / variance;
                }
            }
            Lift { value, motion: last }
        });
        let mut information = DMatrix::zeros(q, q);
        // iterators over a view are slow
        information.copy_from(&sums.view((1, 1), (q, q)));
        Some(Self {
            information,
            score: sums.view((1, 0), (q, 1)).column(0).into_owned(),
            square: sums[(0, 0)],
            free: 2 * n + 2 - MOTION,
            redundancy,
            columns,
            seen,
            motion,
            lift,
        })
    }

    /// Returns the errors that fit best given their prior, and the misfit that remains.
    pub fn fit(&self, known: &mut Known<'_>) -> Option<(DVector<f64>, f64)> {
        let mut step = self.score.clone();
        if !self.columns.is_empty() {
            let mut sum = known.inverse(&self.columns)? + &self.information;
            if !solve_definite(&mut sum, step.as_mut_slice()) {
                return None;
            }
        }
        let misfit = self.square - self.score.dot(&step);
        Some((step, misfit))
    }

    /// Returns the residuals after a step of the errors, two for each plot, in standard deviations.
    pub fn residuals(&self, step: &DVector<f64>) -> Vec<[f64; 2]> {
        let mut motion = self.motion[0];
        for (of_error, step) in self.motion[1..].iter().zip(step.iter()) {
            for (motion, of_error) in motion.iter_mut().zip(of_error) {
                *motion -= of_error * step;
            }
        }
        let mut high = 0.0;
        if let Some(lift) = &self.lift {
            let by_errors: f64 = lift.value[1..].iter().zip(step.iter()).map(|(a, b)| a * b).sum();
            high = lift.value[0] - by_errors;
            for (motion, by_height) in motion.iter_mut().zip(&lift.motion) {
                *motion -= by_height * high;
            }
        }
        self.seen.iter().map(|one| one.residual(&motion, step.as_slice(), high)).collect()
    }
}

impl Seen {
    fn new(one: &Sighting, centre: Vector2<f64>, middle: f64, half: f64) -> Self {
        let off = one.position - centre;
        let axes = [one.axes[0] / one.sigma[0], one.axes[1] / one.sigma[1]];
        Self {
            time: (one.time - middle) / half,
            place: [axes[0].dot(&off), axes[1].dot(&off)],
            axes,
            design: [[0.0; ERRORS]; 2],
            first: 0,
            count: 0,
            lift: 0.0,
        }
    }

    /// Sets the change of the plot by the errors that its radar may have, one after the other.
    fn err(
        &mut self,
        one: &Sighting,
        velocity: Vector2<f64>,
        unknowns: &[Option<(usize, f64)>; ERRORS],
        columns: &[usize],
    ) {
        let ([u, v], [along, across]) = (one.axes, one.design(velocity));
        for (j, unknown) in unknowns.iter().enumerate() {
            let Some((column, prior)) = *unknown else { continue };
            if self.count == 0 {
                self.first = columns.partition_point(|&other| other < column);
            }
            let moved = (u * along[j] + v * across[j]) * prior;
            for (design, axis) in self.design.iter_mut().zip(&self.axes) {
                design[self.count] = axis.dot(&moved);
            }
            self.count += 1;
        }
    }

    /// Converts a pair of numbers along and across to information about the position.
    fn in_plane(&self, along: f64, across: f64) -> [f64; 2] {
        let both = self.axes[0] * along + self.axes[1] * across;
        [both[0], both[1]]
    }

    fn residual(&self, motion: &[f64; MOTION], step: &[f64], high: f64) -> [f64; 2] {
        let mut left = self.residual_of(self.place, motion);
        for (left, design) in left.iter_mut().zip(&self.design) {
            for (design, step) in design.iter().zip(&step[self.first..][..self.count]) {
                *left -= design * step;
            }
        }
        left[0] -= self.lift * high;
        left
    }

    /// Returns the position of a motion at the time of the plot.
    fn place_in(&self, motion: &[f64; MOTION]) -> Vector2<f64> {
        let t = self.time;
        let side = |side: usize| motion[side] + t * (motion[2 + side] + t * motion[4 + side]);
        Vector2::new(side(0), side(1))
    }

    /// Returns a pair of numbers along and across less those of a motion.
    fn residual_of(&self, numbers: [f64; 2], motion: &[f64; MOTION]) -> [f64; 2] {
        let place = self.place_in(motion);
        std::array::from_fn(|axis| {
            let direction = &self.axes[axis];
            numbers[axis] - direction[0] * place[0] - direction[1] * place[1]
        })
    }

    fn redundancy(&self, reach: &[[f64; 5]; 3]) -> [f64; 2] {
        let t = self.time;
        let [east, both, north] =
            reach.map(|[a, b, c, d, e]| a + t * (b + t * (c + t * (d + t * e))));
        self.axes.map(|axis| {
            1.0 - axis[0] * (axis[0] * east + 2.0 * axis[1] * both) - axis[1] * axis[1] * north
        })
    }
}

/// Normal equations of the motion alone: `Hᵀ H` and `Hᵀ y`.
fn normal_equations(seen: &[Seen]) -> ([[f64; MOTION]; MOTION], [f64; MOTION]) {
    let (mut moments, mut right) = ([[0.0; 3]; 5], [0.0; MOTION]);
    for one in seen {
        let [u, v] = one.axes;
        let mut own = [u[0] * u[0] + v[0] * v[0], u[0] * u[1] + v[0] * v[1]];
        let mut north = u[1] * u[1] + v[1] * v[1];
        for moment in &mut moments {
            *moment = [moment[0] + own[0], moment[1] + own[1], moment[2] + north];
            own = own.map(|value| value * one.time);
            north *= one.time;
        }
        add_powers(&mut right, one.in_plane(one.place[0], one.place[1]), one.time);
    }
    let element = |i: usize, j: usize| moments[i / 2 + j / 2][i % 2 + j % 2];
    let normal = std::array::from_fn(|i| std::array::from_fn(|j| element(i, j)));
    (normal, right)
}

/// Adds the information of a plot about the position, times 1, t and t².
fn add_powers(sum: &mut [f64; MOTION], mut place: [f64; 2], time: f64) {
    for powers in sum.chunks_exact_mut(2) {
        powers[0] += place[0];
        powers[1] += place[1];
        place = place.map(|value| value * time);
    }
}

/// Velocity of a weighted straight line, per half duration.
fn line(normal: &[[f64; MOTION]; MOTION], right: &[f64; MOTION]) -> Option<Vector2<f64>> {
    let own: [[f64; 4]; 4] = std::array::from_fn(|i| std::array::from_fn(|j| normal[i][j]));
    let found = Factor::try_new(&own, 0.0)?.solve(&std::array::from_fn(|i| right[i]));
    Some(Vector2::new(found[2], found[3]))
}

/// `[y G]ᵀ [y G]`, and the columns of `Hᵀ [y G]`, the last of which is that of the height.
fn products(
    seen: &[Seen],
    right: [f64; MOTION],
    errors: usize,
) -> (DMatrix<f64>, Vec<[f64; MOTION]>) {
    let height = 1 + errors;
    let mut sums = DMatrix::<f64>::zeros(height + 1, height + 1);
    let mut rights = vec![[0.0; MOTION]; height + 1];
    rights[0] = right;
    for one in seen {
        let [along, across] = &one.design;
        sums[(0, 0)] += one.place[0] * one.place[0] + one.place[1] * one.place[1];
        for j in 0..one.count {
            let column = 1 + one.first + j;
            add_powers(&mut rights[column], one.in_plane(along[j], across[j]), one.time);
            sums[(0, column)] += one.place[0] * along[j] + one.place[1] * across[j];
            for i in 0..=j {
                sums[(1 + one.first + i, column)] += along[i] * along[j] + across[i] * across[j];
            }
            sums[(column, height)] += along[j] * one.lift;
        }
        if one.lift != 0.0 {
            add_powers(&mut rights[height], one.in_plane(one.lift, 0.0), one.time);
            sums[(0, height)] += one.place[0] * one.lift;
            sums[(height, height)] += one.lift * one.lift;
        }
    }
    (sums, rights)
}

/// Covariance of the position as a polynomial of time: east, both, north.
fn reach(spread: &[[f64; MOTION]; MOTION]) -> [[f64; 5]; 3] {
    let mut found = [[0.0; 5]; 3];
    for i in 0..3 {
        for j in 0..3 {
            for (found, (a, b)) in found.iter_mut().zip([(0, 0), (0, 1), (1, 1)]) {
                found[i + j] += spread[2 * i + a][2 * j + b];
            }
        }
    }
    found
}

/// Returns the columns of the errors of the radars of these sightings, in order.
fn columns_of(sightings: &[Sighting], unknowns: &Unknowns) -> Vec<usize> {
    let mut radars: Vec<usize> = sightings.iter().map(|one| one.radar).collect();
    radars.sort_unstable();
    radars.dedup();
    let own = |k: &usize| unknowns[*k].iter().flatten().map(|(column, _)| *column);
    let mut columns = Vec::with_capacity(KINDS * radars.len());
    columns.extend(radars.iter().flat_map(own));
    columns
}

#[cfg(test)]
mod tests {
    use super::super::sighting::Report;
    use super::super::sighting::tests::{PRIOR, close, radar};
    use super::*;

    /// Seven plots of two radars.
    fn block() -> Block {
        let radars = [radar([0.0; 3], 50.0, 0.08), radar([6e4, 0.0, 100.0], 70.0, 0.12)];
        let times = [0.0, 1.0, 4.0, 6.0, 8.0, 11.0, 12.0];
        let ranges = [44751.4, 56355.2, 45327.9, 56138.4, 46039.5, 55728.0, 46665.8];
        let azimuths = [0.46465, 5.50317, 0.47379, 5.52167, 0.48464, 5.53636, 0.4955];
        let sightings: Vec<Sighting> = (0..7)
            .map(|i| {
                let (time, range, azimuth) = (times[i], ranges[i], azimuths[i]);
                let plot =
                    Report { radar: i % 2, time, range, azimuth, height: f64::NAN, place: None };
                Sighting::new(&plot, f64::NAN, &radars[i % 2], [1.0; 2]).unwrap()
            })
            .collect();
        let unknown = |k: usize| -> [Option<(usize, f64)>; ERRORS] {
            std::array::from_fn(|j| (j < KINDS).then_some((KINDS * k + j, PRIOR[j])))
        };
        let velocity = Vector2::new(180.0, 90.0);
        let unknowns = vec![unknown(0), unknown(1)];
        Block::at_velocity(&sightings, &unknowns, 0.3, Some(velocity)).unwrap()
    }

    #[test]
    fn the_normal_equations() {
        let block = block();
        assert_eq!(block.free, 10);
        close(block.square, 11.59048620395);
        let score = [
            -0.6100307274143,
            -0.1480870254507,
            -3.822389829409,
            0.6642946142543,
            -4.335479277698,
            -1.311376141151,
            2.078598216941,
            -0.6642946142543,
        ];
        let first = [
            2.15623874783,
            0.5320854647842,
            -0.5256510146754,
            -0.2733836733516,
            -1.319354207771,
            -0.3994623665031,
            -1.789411431349,
            0.2733836733516,
        ];
        for i in 0..8 {
            close(block.score[i], score[i]);
            close(block.information[(0, i)], first[i]);
            close(block.information[(i, 0)], first[i]);
        }
        close(block.information[(4, 4)], 3.834917047892);
        close(block.redundancy[0][0], 0.3829102429999);
        close(block.redundancy[6][1], 0.5457523835922);
    }

    #[test]
    fn the_errors_that_follow() {
        let block = block();
        let (step, misfit) = block.fit(&mut Known::new(&DMatrix::identity(8, 8))).unwrap();
        let expected = [-25.95962987554, -3.324860671941e-5, -9.948045549001e-4, 0.01252980932538];
        for (j, expected) in expected.into_iter().enumerate() {
            close(step[j] * PRIOR[j], expected);
        }
        // the errors of the clocks are opposite
        close(step[3], -step[7]);
        close(block.square - misfit, 6.263994148859);
    }
}
