//! Least squares over the last plots, of which fewer are used after a manoeuvre was detected or
//! near a turn of the flight plan (Glagovskiy, Lavina, Rudelson 2014).

use super::plan::Guide;
use crate::base::plane::Plane;
use crate::base::small::Factor;
use crate::flightplan::{Turn, capture};
use crate::tracker::motion::curve::Curve;
use crate::tracker::motion::estimate::{Estimate, VELOCITY};
use crate::tracker::motion::imm::{entered, without_rate};
use crate::tracker::motion::kinematics::{self, Arc};
use crate::tracker::motion::{SUMMED, WindowModel};
use crate::tracker::plot::Moving;
use crate::tracker::settings::Settings;
use nalgebra::{Matrix2, SMatrix, SVector, Vector2};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Number of successive hits on the same side that indicate a manoeuvre.
const SIDE_HITS: i32 = 4;
/// Longest time without plots during which the gate grows, in scans.
const LONGEST_GAP: f64 = 5.0;
/// Largest number of scans for which a quadratic is used.
const LONGEST_CURVE: usize = 12;
/// Variance of deviations from a planned turn, as a share of that of the guard gate: half its
/// acceleration.
const LATITUDE: f64 = 0.25;

/// A plot of the history.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Past {
    /// Age of the plot, s.
    age: f64,
    position: [f64; 2],
    noise: Plane,
    /// Matrix B: the target was at `p + B v` at that time if it is at p with the velocity v now.
    back: Matrix2<f64>,
    /// The velocity of the plot, and the rotation of the velocity since then.
    moving: Option<Moving>,
    turned: Matrix2<f64>,
    /// Whether the plot was made near a turn of the plan.
    near_turn: bool,
}

/// The last plots, and the line through them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Window {
    pub guide: Option<Guide>,
    plots: VecDeque<Past>,
    line: Estimate<4>,
    /// The quadratic whose tangent is the line, and the number of scans since the manoeuvre was
    /// detected.
    curve: Option<(Curve, usize)>,
    /// Covariance that is added to that of the line until the next plot.
    extra: SMatrix<f64, 4, 4>,
    /// Seconds since the last plot.
    gap: f64,
    /// Whether the next plot is from the guard gate.
    guarded: bool,
    distances: VecDeque<f64>,
    /// Number of successive hits on the left (positive) or on the right (negative).
    side: i32,
    /// Number of plots that may be used.
    length: usize,
    /// Whether the line follows from the start and all plots since then.
    whole: bool,
    /// Whether a manoeuvre was detected not more than a few plots ago.
    manoeuvre: bool,
    /// Whether the plan turns near here, and whether its arc was flown since the last plot.
    near_turn: bool,
    on_arc: bool,
    /// Whether the target deviates from its plan near a turn.
    deviates: bool,
}

impl Window {
    pub fn new(start: Estimate<4>) -> Self {
        Self {
            guide: None,
            plots: VecDeque::new(),
            line: start,
            curve: None,
            extra: SMatrix::zeros(),
            gap: 0.0,
            guarded: false,
            distances: VecDeque::new(),
            side: 0,
            length: 0,
            whole: true,
            manoeuvre: false,
            near_turn: false,
            on_arc: false,
            deviates: false,
        }
    }

    /// Whether the target turns: a turn was detected, or its plan turns here.
    pub fn turns(&self) -> bool {
        self.manoeuvre || self.on_arc
    }

    #[inline]
    pub fn estimate(&self) -> Estimate<4> {
        Estimate { mean: self.line.mean, covariance: self.line.covariance + self.extra }
    }

    /// Predicts straight flight, or flight along the arc near a turn of the plan, with the gate as
    /// wide as the guard gate.
    pub fn predict(&mut self, settings: &Settings, t: f64, period: f64) {
        if self.gap == 0.0 {
            self.on_arc = false;
        }
        self.gap += t;
        let turn = self.guide.as_ref().and_then(|guide| guide.near_turn(&self.line, settings));
        self.deviates &= turn.is_some();
        self.near_turn = turn.is_some() && !self.deviates;
        if self.near_turn {
            self.curve = None;
        }
        match turn {
            Some(turn) if self.near_turn => self.fly(&turn, t),
            _ => self.step(0.0, t),
        }
        if turn.is_some() {
            let gap = self.gap.min(LONGEST_GAP * period);
            self.extra = kinematics::unnoticed(settings.unnoticed(period), gap);
        }
    }

    /// Predicts straight flight to the start of the turn, flight along its arc, and straight flight
    /// after it.
    fn fly(&mut self, turn: &Turn, t: f64) {
        let velocity = [self.line.mean[2], self.line.mean[3]];
        let (s, _) = turn.project(self.line.position());
        let before = (-s / velocity[0].hypot(velocity[1]).max(1.0)).clamp(0.0, t);
        self.step(0.0, before);
        let arc = capture(turn, self.line.position(), velocity, t - before);
        if arc.time > 0.0 {
            self.step(arc.turn_rate, arc.time);
            self.on_arc = true;
        }
        self.step(0.0, t - before - arc.time);
    }

    /// Moves the line, and the plots relative to it, at this turn rate for the time t.
    fn step(&mut self, rate: f64, t: f64) {
        let arc = Arc::new(rate, t);
        let moved = Matrix2::new(arc.along, -arc.across, arc.across, arc.along);
        let turned = Matrix2::new(arc.cosine, -arc.sine, arc.sine, arc.cosine);
        for plot in &mut self.plots {
            plot.age += t;
            plot.back = (plot.back - moved) * turned.transpose();
            plot.turned = turned * plot.turned;
        }
        if let Some((curve, _)) = &mut self.curve {
            curve.advance(t);
            self.line = curve.line();
        } else if rate == 0.0 {
            kinematics::coast(&mut self.line, t);
        } else {
            let mut with_rate = entered(&self.line, 0.0);
            with_rate.mean[4] = rate;
            kinematics::turn(&mut with_rate, t, 0.0, 0.0);
            self.line = without_rate(&with_rate);
        }
    }

    /// Shifts the line and its plots.
    pub fn shift(&mut self, by: &SVector<f64, 4>) {
        self.line.mean += by;
        let velocity = Vector2::new(by[2], by[3]);
        for plot in &mut self.plots {
            let back = plot.back * velocity;
            for i in 0..2 {
                plot.position[i] += by[i] + back[i];
            }
        }
    }

    /// Widens the gate for a plot that indicates a manoeuvre.
    pub fn widen(&mut self, extra: &SMatrix<f64, 4, 4>) {
        self.extra += extra;
        self.guarded = true;
    }

    /// Adds a plot and fits the line again.
    pub fn correct(&mut self, model: &WindowModel, position: [f64; 2], noise: Plane) {
        let manoeuvre = self.detects(model, position, noise);
        let curved = self.curve.take().map(|(_, scans)| scans + 1);
        let curved = if manoeuvre { model.is_curved.then_some(0) } else { curved };
        if manoeuvre {
            self.deviates = self.near_turn;
            if self.near_turn {
                self.straighten();
            }
            self.distances.clear();
            self.side = 0;
            self.length = model.after_turn;
            self.manoeuvre = true;
            self.whole = false;
        } else if self.near_turn {
            self.length = model.planned_turn;
            self.manoeuvre = false;
            self.whole &= self.plots.len() < model.shortest;
        } else if curved.is_none() {
            self.length = (self.length + 1).min(model.straight);
            self.manoeuvre &= self.length <= 2 * model.shortest;
            self.deviates &= self.manoeuvre;
        }
        let (back, turned, near_turn) = (Matrix2::zeros(), Matrix2::identity(), self.near_turn);
        let moving = None;
        self.plots.push_back(Past { age: 0.0, position, noise, back, moving, turned, near_turn });
        self.forget(model);
        if let Some(scans) = curved {
            self.bend(model, scans);
        }
        let curve = self.curve.as_ref().map(|(curve, _)| curve.line());
        let line = if self.whole { None } else { curve.or_else(|| self.fitted()) };
        self.line = line.unwrap_or_else(|| {
            let mut line = self.estimate();
            line.correct(position, noise);
            line
        });
        self.extra = SMatrix::zeros();
        self.gap = 0.0;
        self.guarded = false;
    }

    /// Adds the velocity of the last plot. A quadratic is fitted to positions alone.
    pub fn take_velocity(&mut self, seen: Moving) {
        if let Some(last) = self.plots.back_mut() {
            last.moving = Some(seen);
        }
        if self.curve.is_none() {
            let line = if self.whole { None } else { self.fitted() };
            self.line = line.unwrap_or_else(|| {
                let mut line = self.line;
                line.correct_at::<VELOCITY>(seen.velocity, seen.noise);
                line
            });
        }
    }

    /// Fits a quadratic while its acceleration is significant, for a limited number of scans; then
    /// the line begins anew with the last plots.
    fn bend(&mut self, model: &WindowModel, scans: usize) {
        let plots = self.plots.iter().map(|past| (past.age, past.position, past.noise));
        let counts = |curve: &Curve| scans == 0 || curve.significance() >= model.inner;
        let curve = Curve::through(plots).filter(|_| scans < LONGEST_CURVE).filter(counts);
        self.curve = curve.map(|curve| (curve, scans));
        if self.curve.is_none() {
            self.length = model.shortest;
            self.forget(model);
        }
    }

    /// Drops the oldest plots: those beyond the length, and those of a turn that is over.
    fn forget(&mut self, model: &WindowModel) {
        let is_over = |first: &Past| first.near_turn && !self.near_turn;
        while self.plots.len() > self.length
            || self.plots.len() > model.shortest && self.plots.front().is_some_and(is_over)
        {
            self.plots.pop_front();
            self.whole = false;
        }
    }

    /// Whether this plot, with those before it, shows that the target manoeuvres.
    fn detects(&mut self, model: &WindowModel, z: [f64; 2], r: Plane) -> bool {
        let mut expected = self.line;
        if self.near_turn {
            expected.covariance += self.extra * LATITUDE;
        }
        let s = expected.position_covariance().plus(r);
        let y = [z[0] - self.line.mean[0], z[1] - self.line.mean[1]];
        let distance = s.inverse().form(y);
        self.distances.push_back(distance);
        while self.distances.len() > SUMMED {
            self.distances.pop_front();
        }
        let [vx, vy] = [self.line.mean[2], self.line.mean[3]];
        let (ahead, left) = (vx * y[0] + vy * y[1], vx * y[1] - vy * y[0]);
        self.side = match (distance > model.inner && left.abs() > ahead.abs(), left > 0.0) {
            (true, true) => self.side.max(0) + 1,
            (true, false) => self.side.min(0) - 1,
            (false, _) => 0,
        };
        let beyond = self.distances.iter().filter(|&&d| d > model.outer).count();
        let full = self.distances.len() == SUMMED;
        self.guarded
            || distance > model.guard
            || beyond >= 2
            || full && self.distances.iter().sum::<f64>() > model.sum
            || self.side.abs() >= SIDE_HITS
    }

    /// Treats a turn within the window as straight flight.
    fn straighten(&mut self) {
        self.on_arc = false;
        self.near_turn = false;
        self.curve = None;
        for plot in &mut self.plots {
            plot.back = Matrix2::identity() * -plot.age;
            plot.turned = Matrix2::identity();
            plot.near_turn = false;
        }
    }

    /// Locates the target along the plan. If the plan is blocked, the flight is treated as
    /// straight.
    pub fn follow(&mut self, settings: &Settings, time: f64, period: f64) {
        let line = self.line;
        let Some(guide) = &mut self.guide else { return };
        if guide.watch(&line, 0.0, settings, time, period).blocked {
            self.leave_plan();
        }
    }

    /// Treats the flight as straight: the plan is not followed.
    pub fn leave_plan(&mut self) {
        self.straighten();
        if let Some(line) = self.fitted().filter(|_| !self.whole) {
            self.line = line;
        }
    }

    /// The line of least squares through the plots, for the present time; none with fewer than two
    /// plots, or if they do not determine it.
    fn fitted(&self) -> Option<Estimate<4>> {
        let origin = self.plots.back().filter(|_| self.plots.len() > 1)?.position;
        let mut normal = SMatrix::<f64, 4, 4>::zeros();
        let mut right = SVector::<f64, 4>::zeros();
        for &Past { position, noise, back, moving, turned, .. } in &self.plots {
            let weight = weight_of(noise);
            let seen = weight * Vector2::new(position[0] - origin[0], position[1] - origin[1]);
            let mixed = weight * back;
            let blocks = [(0, 0, weight), (0, 2, mixed), (2, 0, mixed.transpose())];
            for (i, j, block) in blocks.into_iter().chain([(2, 2, back.transpose() * mixed)]) {
                let mut view = normal.fixed_view_mut::<2, 2>(i, j);
                view += block;
            }
            let mut view = right.fixed_rows_mut::<2>(0);
            view += seen;
            let mut view = right.fixed_rows_mut::<2>(2);
            view += back.transpose() * seen;
            if let Some(Moving { velocity, noise }) = moving {
                let weight = turned * weight_of(noise) * turned.transpose();
                let mut view = normal.fixed_view_mut::<2, 2>(2, 2);
                view += weight;
                let mut view = right.fixed_rows_mut::<2>(2);
                view += weight * turned * Vector2::from(velocity);
            }
        }
        let covariance = SMatrix::from(Factor::try_new(&normal.data.0, 0.0)?.inverse());
        let mut mean = covariance * right;
        mean[0] += origin[0];
        mean[1] += origin[1];
        Some(Estimate { mean, covariance })
    }
}

fn weight_of(noise: Plane) -> Matrix2<f64> {
    let Plane { xx, xy, yy } = noise.inverse();
    Matrix2::new(xx, xy, xy, yy)
}
