//! Smoothing of one track: from its plots to its states.

use super::mixture::Fix;
use super::motion::{MODELS, Movement, SPEED, STATES, TURN};
use super::movement::{Manoeuvre, likely};
use super::passes::{Innovation, Passes, Record, Solution};
use super::vertical::{self, CLIMB, LEVEL, Vertical};
use crate::base::plane::Plane;
use crate::sensors::HEIGHT_SIGMA;

/// Age at which a state is no longer changed by later plots, s.
const SETTLED: f64 = 30.0;
/// Steps to which heights are rounded (a hundred feet, and 25 ft), m, and the standard deviation of
/// such heights, m.
const STEPS: [(f64, f64); 2] = [(30.48, 10.0), (7.62, 6.0)];
/// Difference below which heights are equal, and by which a difference may fall short of a step, m.
const SAME: f64 = 1.0;

/// Sharpness of manoeuvres relative to usual ones, and the gain of the logarithm of the density of
/// the plots from which manoeuvres are that sharp.
const SHARPER: [f64; 3] = [2.0, 5.0, 12.0];
const CLEARLY: f64 = 5.0;
/// Largest share of plots that are left out by chance, and the share from which on the sharpest manoeuvres are
/// tried even if sharper ones do not help.
const CHANCE: f64 = 0.005;
const MANY: f64 = 0.05;
/// Mean of the squared normalised innovations, relative to its expected value, from which on sharper manoeuvres
/// are tried, too.
const SCATTERED: f64 = 1.3;
/// Number of standard deviations by which this mean exceeds 1, at least.
const SURE: f64 = 3.0;
/// Rates at which targets circle, rad/s, and largest turns from plot to plot that can be followed, rad.
const CIRCLING: [(f64, f64); 2] = [(0.19, 0.76), (0.31, 1.25)];

/// A plot of a track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackPlot {
    /// Time, s.
    pub time: f64,
    /// Index of its sensor.
    pub sensor: usize,
    /// East and north, m.
    pub position: [f64; 2],
    /// Covariance of the position, m².
    pub covariance: Plane,
    /// Velocity to the east and north, m/s; nan if there is none.
    pub velocity: [f64; 2],
    /// Covariance of the velocity, m²/s².
    pub velocity_covariance: Plane,
    /// Height, m; nan if there is none.
    pub height: f64,
    /// Whether the plot is used to compute states.
    pub used: bool,
}

/// A state of a track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SmoothedRow {
    /// Time, s.
    pub time: f64,
    /// Index among the plots of the track; none between plots.
    pub plot: Option<usize>,
    /// Position and velocity, m and m/s.
    pub state: [f64; 4],
    /// Their covariance.
    pub covariance: [[f64; 4]; 4],
    /// Innovation: plot less the state without this plot, m; nan if there is none.
    pub innovation: [f64; 2],
    /// Covariance of the innovation.
    pub innovation_covariance: Plane,
    /// Acceleration along the course, m/s².
    pub acceleration: f64,
    /// Rate of turn, positive to the right, rad/s.
    pub turn_rate: f64,
    /// Probability of a turn.
    pub turn_probability: f64,
    /// Probability of a change of speed.
    pub speed_change_probability: f64,
    /// Height, m; nan if none is known, as are the next two.
    pub height: f64,
    /// Standard deviation of the height, m.
    pub height_sigma: f64,
    /// Vertical rate, positive upward, m/s.
    pub vertical_rate: f64,
    /// Movement across the course.
    pub transversal: Manoeuvre,
    /// Movement along the course.
    pub longitudinal: Manoeuvre,
    /// Vertical movement.
    pub vertical: Manoeuvre,
    /// Time to the nearest plot that is used, s.
    pub gap: f64,
    /// Whether the plot is an outlier, which was left out.
    pub outlier: bool,
    /// Whether later plots would no longer change the row.
    pub is_final: bool,
}

/// Times of states in addition to those of plots.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Times {
    /// Given times, in order, s.
    pub given: Vec<f64>,
    /// Interval whose multiples are times of states, s.
    pub every: Option<f64>,
}

/// Smooths a track, whose plots are in the order of time. States extend from its first plot to the
/// last one. `guard` is the squared normalised distance beyond which plots are left out.
///
/// Cost O(plots + times), memory 1 kB per plot.
pub(super) fn smooth(
    movement: &Movement,
    plots: &[TrackPlot],
    times: &Times,
    guard: f64,
) -> Vec<SmoothedRow> {
    let wanted = wanted(plots, times);
    let mut record = Record {
        time: plots.iter().map(|plot| plot.time).collect(),
        fixes: plots.iter().map(fix).collect(),
        used: plots.iter().map(|plot| plot.used).collect(),
    };
    let found = likeliest(movement, &mut record, &wanted, guard);
    let heights = Heights::new(plots, &record.used, &wanted, guard);
    let used: Vec<f64> =
        (0..plots.len()).filter(|&i| record.used[i]).map(|i| plots[i].time).collect();
    let (mut rows, mut next) = (Vec::with_capacity(plots.len().max(wanted.len())), 0);
    for (place, &time) in wanted.iter().enumerate() {
        let begin = next;
        while next < plots.len() && plots[next].time <= time {
            next += 1;
        }
        let Some(solution) = &found.solutions[place] else {
            continue;
        };
        let mut row = heights.row(time, place, solution);
        row.gap = gap(&used, time);
        row.is_final = used.last().is_some_and(|last| last - time >= SETTLED);
        if begin == next {
            rows.push(row);
        }
        rows.extend((begin..next).map(|i| SmoothedRow {
            outlier: plots[i].used && !record.used[i],
            ..with_plot(row, i, &found)
        }));
    }
    rows
}

/// Smooths the plots, and again with sharper manoeuvres if more plots are left out, or farther off, than by chance.
/// What makes the plots clearly likelier is kept: a target that manoeuvres more sharply than most
/// would otherwise lose its plots in turns.
fn likeliest(
    movement: &Movement,
    record: &mut Record<2>,
    wanted: &[f64],
    guard: f64,
) -> Passes<STATES, MODELS, 2> {
    let given = record.clone();
    let mut found = record.smooth(movement, wanted, guard);
    let mut top = found.log_density(guard);
    let count = |used: &[bool]| used.iter().filter(|used| **used).count();
    let left_out = count(&given.used) - count(&record.used);
    let (scatter, count) = found.scatter(guard);
    let is_scattered = scatter > SCATTERED.max(1.0 + SURE / count.sqrt());
    let is_scattered = is_scattered && movement.turns();
    if left_out as f64 <= CHANCE * given.used.len() as f64 && !is_scattered {
        return found;
    }
    let mut is_better = |movement: &Movement| {
        let mut again = given.clone();
        let mut other = again.smooth(movement, wanted, guard);
        let value = other.log_density(guard);
        let is_better = value >= top + CLEARLY;
        if is_better {
            let solutions = other.solutions.iter_mut().flatten();
            solutions.for_each(|solution| solution.own[TURN] += movement.mean_rate);
            (*record, found, top) = (again, other, value);
        }
        is_better
    };
    let is_sharp = is_scattered || left_out as f64 > MANY * given.used.len() as f64;
    for factor in SHARPER {
        if !is_better(&movement.sharper(factor)) && !is_sharp {
            break;
        }
    }
    if is_sharp {
        for rate in circling(&given.time) {
            is_better(&movement.circling(rate));
        }
    }
    found
}

/// Rates of turn at which targets circle and that plots at these times can follow, rad/s.
fn circling(times: &[f64]) -> impl Iterator<Item = f64> {
    let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps.sort_by(f64::total_cmp);
    let usual = steps.get(steps.len() / 2).copied().unwrap_or(f64::INFINITY);
    CIRCLING.into_iter().map(move |(rate, angle)| rate.min(angle / usual)).flat_map(|r| [r, -r])
}

/// The times of the plots and the additional times, in order and each only once.
fn wanted(plots: &[TrackPlot], times: &Times) -> Vec<f64> {
    let mut wanted: Vec<f64> = plots.iter().map(|plot| plot.time).collect();
    if let (Some(first), Some(last)) = (wanted.first().copied(), wanted.last().copied()) {
        let begin = times.given.partition_point(|&t| t < first);
        let end = times.given.partition_point(|&t| t <= last);
        wanted.extend(&times.given[begin..end]);
        if let Some(every) = times.every {
            let (begin, end) = ((first / every).ceil(), (last / every).floor());
            let count = (end - begin).max(-1.0) as usize + usize::from(end >= begin);
            wanted.extend((0..count).map(|k| (begin + k as f64) * every));
        }
        // a multiple may be rounded beyond the end
        wanted.retain(|t| (first..=last).contains(t));
    }
    wanted.sort_by(f64::total_cmp);
    wanted.dedup();
    wanted
}

fn fix(plot: &TrackPlot) -> Fix<2> {
    let matrix = |Plane { xx, xy, yy }: Plane| [[xx, xy], [xy, yy]];
    let rate = (plot.velocity, matrix(plot.velocity_covariance));
    let rate = plot.velocity.iter().all(|v| v.is_finite()).then_some(rate);
    Fix { rate, ..Fix::new(plot.position, matrix(plot.covariance)) }
}

fn with_plot(row: SmoothedRow, i: usize, found: &Passes<STATES, MODELS, 2>) -> SmoothedRow {
    let Some(Innovation { value, covariance: s, .. }) = found.innovations[i] else {
        return SmoothedRow { plot: Some(i), ..row };
    };
    let covariance = Plane { xx: s[0][0], xy: s[0][1], yy: s[1][1] };
    SmoothedRow { plot: Some(i), innovation: value, innovation_covariance: covariance, ..row }
}

/// Time to the nearest of these times; infinite if there is none.
fn gap(times: &[f64], time: f64) -> f64 {
    let after = times.partition_point(|&t| t < time);
    let distance = |k: Option<usize>| k.and_then(|k| times.get(k)).map(|t| (t - time).abs());
    let both = [distance(after.checked_sub(1)), distance(Some(after))];
    both.into_iter().flatten().fold(f64::INFINITY, f64::min)
}

/// Heights at the wanted times.
struct Heights {
    solutions: Vec<Option<Solution<2, { vertical::MODELS }>>>,
    /// Variance of rounding, m², which is added in level flight: there, rounding is one common
    /// error and not noise that a filter averages out.
    rounding: f64,
}

impl Heights {
    fn new(plots: &[TrackPlot], used: &[bool], wanted: &[f64], guard: f64) -> Self {
        let is_known = |i: &usize| used[*i] && plots[*i].height.is_finite();
        let known: Vec<usize> = (0..plots.len()).filter(is_known).collect();
        if known.is_empty() {
            return Self { solutions: vec![None; wanted.len()], rounding: 0.0 };
        }
        let heights: Vec<f64> = known.iter().map(|&i| plots[i].height).collect();
        let (step, sigma) = rounding(&heights);
        let mut record = Record {
            time: known.iter().map(|&i| plots[i].time).collect(),
            fixes: heights.iter().map(|&h| Fix::new([h], [[sigma * sigma]])).collect(),
            used: vec![true; known.len()],
        };
        let solutions = record.smooth(&Vertical, wanted, guard).solutions;
        Self { solutions, rounding: step * step / 12.0 }
    }

    /// The row of a solution, without a plot.
    fn row(&self, time: f64, place: usize, of: &Solution<STATES, MODELS>) -> SmoothedRow {
        let (mean, p) = (&of.state.mean, &of.state.covariance);
        let (turn, speed) = (of.probability[TURN], of.probability[SPEED]);
        let (turn_rate, acceleration) = (-of.own[TURN], of.own[SPEED]);
        let nan = f64::NAN;
        let mut row = SmoothedRow {
            time,
            plot: None,
            state: std::array::from_fn(|i| mean[i]),
            // mixtures are symmetric but for rounding
            covariance: std::array::from_fn(|i| std::array::from_fn(|j| p[i.min(j)][i.max(j)])),
            innovation: [nan; 2],
            innovation_covariance: Plane { xx: nan, xy: nan, yy: nan },
            acceleration,
            turn_rate,
            turn_probability: turn,
            speed_change_probability: speed,
            height: nan,
            height_sigma: nan,
            vertical_rate: nan,
            transversal: likely(turn, turn_rate),
            longitudinal: likely(speed, acceleration),
            vertical: Manoeuvre::Undetermined,
            gap: nan,
            outlier: false,
            is_final: false,
        };
        if let Some(Solution { state, probability, own }) = &self.solutions[place] {
            let variance = state.covariance[0][0] + probability[LEVEL] * self.rounding;
            (row.height, row.vertical_rate) = (state.mean[0], own[CLIMB]);
            row.height_sigma = variance.sqrt();
            row.vertical = likely(probability[CLIMB], row.vertical_rate);
        }
        row
    }
}

/// Step to which heights are rounded, 0 if they are not, and the standard deviation of the heights.
fn rounding(heights: &[f64]) -> (f64, f64) {
    let mut sorted = heights.to_vec();
    sorted.sort_by(f64::total_cmp);
    let steps = sorted.windows(2).map(|pair| pair[1] - pair[0]).filter(|&step| step > SAME);
    let smallest = steps.fold(f64::INFINITY, f64::min);
    let found = STEPS.into_iter().find(|(step, _)| smallest > step - SAME);
    found.unwrap_or((0.0, HEIGHT_SIGMA))
}
