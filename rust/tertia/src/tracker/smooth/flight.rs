//! One track: its plots in, its states out.

use super::mixture::Fix;
use super::motion::{MODELS, Movement, SPEED, STATES, TURN};
use super::movement::{Manoeuvre, likely};
use super::passes::{Innovation, Passes, Record, Solution};
use super::vertical::{self, CLIMB, LEVEL, Vertical};
use crate::base::plane::Plane;
use crate::sensors::HEIGHT_SIGMA;

/// What comes later no longer changes a state that is so much older, s.
const SETTLED: f64 = 30.0;
/// Steps to which heights are rounded, hundreds of feet and 25 ft, m, with the standard deviation
/// of such heights.
const STEPS: [(f64, f64); 2] = [(30.48, 10.0), (7.62, 6.0)];
/// Heights that differ by less are the same, and steps differ by less from a multiple, m.
const SAME: f64 = 1.0;

/// A plot of a track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackPlot {
    /// s
    pub time: f64,
    /// East and north, m.
    pub position: [f64; 2],
    /// Its covariance.
    pub covariance: Plane,
    /// East and north, m/s; nan where there is none.
    pub velocity: [f64; 2],
    /// Its covariance.
    pub velocity_covariance: Plane,
    /// m; nan where there is none
    pub height: f64,
    /// Whether states are computed by it.
    pub used: bool,
}

/// A state of a track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SmoothedRow {
    /// s
    pub time: f64,
    /// Index among the plots of the track; none between them.
    pub plot: Option<usize>,
    /// Position and velocity, m and m/s.
    pub state: [f64; 4],
    /// Their covariance.
    pub covariance: [[f64; 4]; 4],
    /// Plot less the state without it, m; nan where there is none.
    pub innovation: [f64; 2],
    /// Its covariance.
    pub innovation_covariance: Plane,
    /// Along the course, m/s².
    pub acceleration: f64,
    /// Positive to the right, rad/s.
    pub turn_rate: f64,
    /// Probability of a turn, and of a change of speed.
    pub turn_probability: f64,
    /// The same of a change of speed.
    pub speed_change_probability: f64,
    /// m; nan where none is known, as the next two.
    pub height: f64,
    /// m
    pub height_sigma: f64,
    /// m/s
    pub vertical_rate: f64,
    /// How it moves: across its course, along it, and vertically.
    pub transversal: Manoeuvre,
    /// Along its course.
    pub longitudinal: Manoeuvre,
    /// Vertically.
    pub vertical: Manoeuvre,
    /// To the nearest plot that is used, s.
    pub gap: f64,
    /// Whether the plot does not fit and was left out.
    pub outlier: bool,
    /// Whether what comes later would no longer change it.
    pub is_final: bool,
}

/// Times of states besides those of plots.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Times {
    /// In order, s.
    pub given: Vec<f64>,
    /// Multiples of this, s.
    pub every: Option<f64>,
}

/// Smooths a track, of which the plots are in the order of time. States are from its first plot to
/// the last. `guard` is the distance squared beyond which plots are left out.
///
/// Cost O(plots + times), memory 1 kB a plot.
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
    let found = record.smooth(movement, &wanted, guard);
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

/// The times of plots, and those besides, once each.
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

/// Time to the nearest of these.
fn gap(times: &[f64], time: f64) -> f64 {
    let after = times.partition_point(|&t| t < time);
    let distance = |k: Option<usize>| k.and_then(|k| times.get(k)).map(|t| (t - time).abs());
    let both = [distance(after.checked_sub(1)), distance(Some(after))];
    both.into_iter().flatten().fold(f64::INFINITY, f64::min)
}

/// Heights at the wanted times.
struct Heights {
    solutions: Vec<Option<Solution<2, { vertical::MODELS }>>>,
    /// Variance of rounding, m², which is added in level flight: all its errors are one error there,
    /// and no noise that a filter takes the mean of.
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

    /// A row without its plot.
    fn row(&self, time: f64, place: usize, of: &Solution<STATES, MODELS>) -> SmoothedRow {
        let (mean, p) = (&of.state.mean, &of.state.covariance);
        let (turn, speed) = (of.probability[TURN], of.probability[SPEED]);
        let (turn_rate, acceleration) = (-of.own[TURN], of.own[SPEED]);
        let nan = f64::NAN;
        let mut row = SmoothedRow {
            time,
            plot: None,
            state: std::array::from_fn(|i| mean[i]),
            covariance: std::array::from_fn(|i| std::array::from_fn(|j| p[i][j])),
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

/// Step to which heights are rounded, 0 where they are not, and their standard deviation.
fn rounding(heights: &[f64]) -> (f64, f64) {
    let mut sorted = heights.to_vec();
    sorted.sort_by(f64::total_cmp);
    let steps = sorted.windows(2).map(|pair| pair[1] - pair[0]).filter(|&step| step > SAME);
    let smallest = steps.fold(f64::INFINITY, f64::min);
    let found = STEPS.into_iter().find(|(step, _)| smallest > step - SAME);
    found.unwrap_or((0.0, HEIGHT_SIGMA))
}
