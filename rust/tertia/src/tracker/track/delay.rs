//! A track and the delays of the positions that sensors report of its target.

use super::Track;
use super::height::Here;
use crate::base::plane::Plane;
use crate::tracker::errors::delay::Delay;
use crate::tracker::motion::estimate::Estimate;
use crate::tracker::motion::height_effect::{Lean, along};
use crate::tracker::plot::Measured;
use crate::tracker::settings::Settings;

/// Number of sigmas of a delay within which plots are searched for.
const SIGMAS: f64 = 4.5;

impl Settings {
    /// Standard deviation of the delays of the targets of a sensor, s; none if they are not sought.
    #[inline]
    pub(in crate::tracker) fn delay_sigma(&self, sensor: usize) -> Option<f64> {
        self.delays.get(sensor).copied().flatten().map(|own| own.sigma)
    }

    /// Whether the delays of targets were found to differ.
    #[inline]
    pub(in crate::tracker) fn delays_differ(&self) -> bool {
        self.delays.iter().flatten().any(|own| own.sigma > 0.0)
    }
}

impl Track {
    #[inline]
    fn velocity(&self) -> [f64; 2] {
        [self.estimate.mean[2], self.estimate.mean[3]]
    }

    /// Calls `each` with the delays that affect a plot of a sensor and differ from target to target: the
    /// estimate if the plot is late by it, its variance, and the derivative of the innovation.
    #[inline]
    fn each_delay(
        &self,
        sensor: usize,
        t: f64,
        settings: &Settings,
        mut each: impl FnMut(f64, f64, [f64; 2]),
    ) {
        let velocity = self.velocity();
        let mut is_new = true;
        for own in &self.delays {
            is_new &= own.sensor != sensor;
            if own.sigma > 0.0 {
                let late = if own.sensor == sensor { own.mean } else { 0.0 };
                each(late, own.variance(), own.of_plot(sensor, velocity, t));
            }
        }
        if let Some(sigma) = settings.delay_sigma(sensor).filter(|sigma| is_new && *sigma > 0.0) {
            each(0.0, sigma * sigma, velocity);
        }
    }

    /// By how much a plot is moved by the delay of its target, and the covariance due to what is not known of
    /// it.
    #[cold]
    pub(super) fn delayed(&self, sensor: usize, t: f64, settings: &Settings) -> ([f64; 2], Plane) {
        let (mut moved, mut covariance) = ([0.0; 2], Plane::default());
        let velocity = self.velocity();
        self.each_delay(sensor, t, settings, |late, variance, by| {
            moved = [0, 1].map(|i| moved[i] + late * velocity[i]);
            covariance = covariance.plus(along(by, variance));
        });
        (moved, covariance)
    }

    /// How far delays may move plots of a sensor, m.
    #[cold]
    pub fn delayed_by(&self, sensor: usize, settings: &Settings) -> f64 {
        let speed = self.estimate.mean[2].hypot(self.estimate.mean[3]);
        let mut most = 0.0;
        self.each_delay(sensor, 0.0, settings, |late, variance, by| {
            most += late.abs() * speed + SIGMAS * variance.sqrt() * by[0].hypot(by[1]);
        });
        most
    }

    /// Learns about the delays from a plot with this innovation; returns whether the track has moved.
    pub(super) fn learn_delays(&mut self, plot: &Measured, settings: &Settings) -> bool {
        self.meet(plot.radar, settings);
        let (t, velocity) = (plot.time - self.time, self.velocity());
        let (y, s) = self.innovation;
        let mut moved = [0.0; 4];
        for own in self.delays.iter_mut().filter(|own| !own.is_first) {
            let by = own.of_plot(plot.radar, velocity, t);
            let others = s.plus(along(by, -own.variance())).inverse();
            let score = y[0] * (others.xx * by[0] + others.xy * by[1])
                + y[1] * (others.xy * by[0] + others.yy * by[1]);
            own.learn(others.form(by), score);
            let change = own.update();
            let step = own.lean.step(change);
            (0..4).for_each(|i| moved[i] += step[i]);
        }
        let has_moved = moved != [0.0; 4];
        if has_moved {
            self.filter.shift(&moved.into());
            self.estimate = self.filter.estimate();
        }
        has_moved
    }

    /// Begins with the delays of a sensor, and of that of the first plot.
    fn meet(&mut self, sensor: usize, settings: &Settings) {
        for new in [self.first.radar, sensor] {
            let is_known = self.delays.iter().any(|own| own.sensor == new);
            if let Some(sigma) = settings.delay_sigma(new).filter(|_| !is_known) {
                self.delays.push(Delay::new(new, sigma, new == self.first.radar));
            }
        }
    }

    /// Updates, after a plot has corrected the track, how far the track depends on the delays.
    pub(super) fn lean_by_delays(&mut self, plot: &Measured, here: &Here) {
        let (t, velocity) = (plot.time - self.time, self.velocity());
        for own in &mut self.delays {
            if std::mem::take(&mut own.is_first) {
                own.lean = Lean::new(velocity);
            }
            let by = own.of_plot(plot.radar, velocity, t);
            own.lean.correct(&self.estimate, here.noise, by);
        }
    }

    /// Changes what is known of the delay of the reports by a sensor, in all states of the track.
    pub fn change_delays(&mut self, sensor: usize, change: impl Fn(&mut Delay)) {
        self.each_state(|state| {
            let fork = state.fork.iter_mut().flat_map(|fork| &mut fork.state.delays);
            state
                .delays
                .iter_mut()
                .chain(fork)
                .filter(|own| own.sensor == sensor)
                .for_each(&change);
        });
    }

    /// The estimate with the covariance that is due to the delays.
    pub(super) fn with_delays(&self, mut estimate: Estimate<4>) -> Estimate<4> {
        for own in self.delays.iter().filter(|own| own.sigma > 0.0) {
            estimate = own.lean.widened(&estimate, own.variance());
        }
        estimate
    }

    /// Variance, due to the delays, of a quantity with these derivatives with respect to the state.
    pub(super) fn delay_along(&self, row: &[f64; 4]) -> f64 {
        self.delays.iter().map(|own| own.lean.along(row).powi(2) * own.variance()).sum()
    }

    /// Delay of its target, if a sensor reports its positions.
    pub fn delay(&self, sensor: usize) -> Option<&Delay> {
        self.delays.iter().find(|own| own.sensor == sensor)
    }
}
