//! A track and the height of its target: where a plot lies at this height, and what the plot says
//! about the height.

use super::super::motion::estimate::Estimate;
use super::super::motion::height_effect::{Lean, along};
use super::super::plot::{Measured, Source};
use super::super::replies::height::Vertical;
use super::super::settings::Settings;
use super::Track;
use crate::base::plane::Plane;
use crate::geo::ellipsoid::RADIUS;

/// Least information about the height in a range, as a share of what is already known: heights are
/// not learned from less.
const LEAST_INFORMATION: f64 = 0.2;
/// Variance of a position due to the error of a reported height below which a track no longer keeps
/// its dependence on the height, m².
const LEAST_LEAN: f64 = 1.0;
/// Factor by which the search for plots without a height exceeds the distance that heights move
/// them; number of sigmas of the height; steepest slope of a position with respect to the height.
const SWAY_MARGIN: f64 = 1.3;
const SWAY_SIGMAS: f64 = 4.5;
const STEEPEST_SLOPE: f64 = 3.1;
/// Largest square of a height as a share of the square of the slant range.
const HIGHEST_SHARE: f64 = 0.81;
/// A plot moved to the time of a track's estimate.
pub(super) struct Here {
    pub position: [f64; 2],
    /// Noise of the position.
    pub noise: Plane,
    /// Derivative of the innovation with respect to the height of the target, and the variance of
    /// the height.
    by_height: [f64; 2],
    variance: f64,
    /// Covariance due to the delays of the target.
    delayed: Plane,
}

impl Here {
    /// Covariance due to the noise, the height and the delays.
    pub fn covariance(&self) -> Plane {
        self.noise.plus(along(self.by_height, self.variance)).plus(self.delayed)
    }
}

impl Track {
    /// Noise of a first plot, the height at which it is placed, and the dependence of its position
    /// on this height.
    pub(super) fn first(
        plot: &Measured,
        settings: &Settings,
    ) -> (Plane, Option<Vertical>, Option<Box<Lean>>) {
        let radar = settings.radars[plot.radar].detecting(plot.detection);
        match plot.source {
            Source::Polar => {
                (radar.noise_at(plot.position, plot.height - radar.position[2]), None, None)
            }
            Source::Placed(noise) | Source::Moving(noise, _) => {
                // of its velocity, only the largest one is known
                let moved = settings.quality(plot.radar).clock * (0.5 * settings.max_speed).powi(2);
                (noise.plus(Plane { xx: moved, xy: 0.0, yy: moved }), None, None)
            }
            Source::Slant { polar, prior } => {
                let placed = settings.geometry(plot.radar).placed(radar, &polar, prior[0]);
                let vertical = Vertical::assumed(plot.time, prior);
                (placed.noise, Some(vertical), Some(Box::new(Lean::new(placed.by_height))))
            }
        }
    }

    /// Height and vertical rate at the time of the estimate; nothing where no height was reported.
    pub fn reported(&self) -> Option<Vertical> {
        self.vertical.filter(|own| own.reported).map(|own| own.at(self.time))
    }

    /// Height; not a number where none was reported.
    pub fn height(&self) -> f64 {
        self.reported().map_or(f64::NAN, |own| own.height)
    }

    /// The estimate, with a covariance that includes the uncertainty of the height, of what the
    /// target does, and of its centre.
    pub fn widened(&self) -> Estimate<4> {
        let mut own = match self.lean.as_ref().zip(self.vertical) {
            Some((lean, vertical)) => {
                lean.widened(&self.estimate, vertical.at(self.time).height_variance())
            }
            None => self.shown(),
        };
        own = self.with_delays(own);
        let unnoticed = self.filter.unnoticed();
        (0..4).for_each(|i| own.covariance[(i, i)] += unnoticed[i / 2]);
        own = self.fork.as_ref().map_or(own, |fork| fork.widened(&own));
        // errors of reports and the parts of an extended target that are seen may be the same for long
        if self.extent.xx > 0.0 || self.lasting > 0.0 || self.common.is_some() {
            let late = along([own.mean[2], own.mean[3]], self.lasting);
            let more = self.extent.plus(self.common.covariance()).plus(late);
            own.covariance[(0, 0)] += more.xx;
            own.covariance[(0, 1)] += more.xy;
            own.covariance[(1, 0)] += more.xy;
            own.covariance[(1, 1)] += more.yy;
        }
        own
    }

    /// Moves a plot to the time of the estimate; the noise of a late plot includes the error of the
    /// velocity. A plot without a height is placed at the height of the track.
    pub(super) fn brought_here(&self, plot: &Measured, settings: &Settings) -> Here {
        let t = plot.time - self.time;
        let x = &self.estimate.mean;
        let radar = settings.radars[plot.radar].detecting(plot.detection);
        let (mut place, mut by_height, mut variance) = (plot.position, [0.0; 2], 0.0);
        let mut noise = match plot.source {
            Source::Polar => {
                let height = self.height();
                let height =
                    if height.is_nan() && self.lean.is_some() { plot.height } else { height };
                let up =
                    if plot.height.is_finite() { height - radar.position[2] } else { f64::NAN };
                radar.noise_at(self.estimate.position(), up)
            }
            Source::Placed(noise) | Source::Moving(noise, _) => noise,
            Source::Slant { polar, .. } => {
                let vertical = self.vertical_for(plot);
                let placed = settings.geometry(plot.radar).placed(radar, &polar, vertical.height);
                (place, variance) = (placed.position, vertical.height_variance());
                by_height = placed.by_height.map(|slope| -slope);
                placed.noise
            }
        };
        if let Some(lean) = &self.lean {
            if !matches!(plot.source, Source::Slant { .. }) {
                variance = self.vertical_for(plot).height_variance();
            }
            let own = lean.position(t);
            by_height = [by_height[0] + own[0], by_height[1] + own[1]];
        }
        let clock = settings.quality(plot.radar).clock;
        if clock > 0.0 {
            noise = noise.plus(along([x[2], x[3]], clock));
        }
        if t < 0.0 {
            let p = &self.estimate.covariance;
            noise.xx += t * t * p[(2, 2)];
            noise.xy += t * t * p[(2, 3)];
            noise.yy += t * t * p[(3, 3)];
        }
        let mut position = [place[0] - t * x[2], place[1] - t * x[3]];
        let mut delayed = Plane::default();
        if settings.delays_differ() {
            let (moved, covariance) = self.delayed(plot.radar, t, settings);
            position = [position[0] + moved[0], position[1] + moved[1]];
            delayed = covariance;
        }
        Here { position, noise, by_height, variance, delayed }
    }

    /// Height at the time of a plot; that of the traffic if the track has none.
    fn vertical_for(&self, plot: &Measured) -> Vertical {
        match (self.vertical, plot.source) {
            (Some(vertical), _) => vertical.at(plot.time),
            (None, Source::Slant { prior, .. }) => Vertical::assumed(plot.time, prior),
            (None, _) => Vertical::new(plot.time, plot.height),
        }
    }

    /// Learns the height from a plot whose innovation depends on it: the ranges of several radars
    /// agree at one height only. Returns whether this moved the track.
    pub(super) fn infer_height(&mut self, plot: &Measured, here: &Here, y: [f64; 2]) -> bool {
        let inverse = self.estimate.position_covariance().plus(here.noise).inverse();
        let s = here.by_height;
        let information = inverse.form(s);
        if information * here.variance < LEAST_INFORMATION {
            return false;
        }
        let mut vertical = self.vertical_for(plot);
        let before = vertical.height;
        let along = inverse.xx * s[0] * y[0]
            + inverse.xy * (s[0] * y[1] + s[1] * y[0])
            + inverse.yy * s[1] * y[1];
        vertical.infer(plot.time, before + along / information, 1.0 / information);
        self.vertical = Some(vertical);
        self.move_with(vertical.height - before);
        true
    }

    /// Shifts the track and its alternative states by a position and a velocity that apply at a
    /// time.
    pub fn shift(&mut self, time: f64, [x, y, vx, vy]: [f64; 4]) {
        let ahead = self.time - time;
        self.filter.shift(&nalgebra::SVector::from([x + ahead * vx, y + ahead * vy, vx, vy]));
        self.estimate = self.filter.estimate();
        for other in self.tree.iter_mut().flat_map(|tree| &mut tree.others) {
            other.track.shift(time, [x, y, vx, vy]);
        }
        if let Some(fork) = &mut self.fork {
            fork.state.shift(time, [x, y, vx, vy]);
        }
    }

    /// Moves the track by a change of its height.
    fn move_with(&mut self, height: f64) {
        if let Some(lean) = &self.lean {
            self.filter.shift(&lean.step(height));
            self.estimate = self.filter.estimate();
        }
    }

    /// Updates by a plot how far the track depends on its height.
    pub(super) fn lean_by(&mut self, plot: &Measured, here: &Here) {
        let without = matches!(plot.source, Source::Slant { .. });
        if without || self.lean.is_some() {
            let vertical = *self.vertical.get_or_insert(self.vertical_for(plot));
            let lean = self.lean.get_or_insert_default();
            lean.correct(&self.estimate, here.noise, here.by_height);
            let [x, y] = lean.position(0.0);
            let negligible = (x * x + y * y) * vertical.height_variance() < LEAST_LEAN;
            if vertical.reported && negligible {
                self.lean = None;
            }
        }
    }

    pub(super) fn take_height(&mut self, plot: &Measured) {
        if plot.height.is_nan() {
            return;
        }
        let Some(vertical) = &mut self.vertical else {
            self.vertical = Some(Vertical::new(plot.time, plot.height));
            return;
        };
        let before = vertical.at(plot.time).height;
        vertical.correct(plot.time, plot.height);
        let moved = vertical.at(plot.time).height - before;
        self.move_with(moved);
    }

    /// How far the height of the target may move its plot of a radar, m, if plots have no heights:
    /// those were placed at heights from `lowest` to `highest`. The radar stands at the height `site`,
    /// at this distance from the target.
    #[inline]
    pub fn sway(&self, (site, distance): (f64, f64), time: f64, placed: Option<[f64; 2]>) -> f64 {
        let mut slope = self.lean.as_ref().map_or(0.0, |lean| {
            let [x, y] = lean.position(0.0);
            (x * x + y * y).sqrt()
        });
        if slope == 0.0 && placed.is_none() {
            return 0.0;
        }
        let mut shift = 0.0;
        let vertical = self.vertical.map(|vertical| vertical.at(time));
        let sigma = vertical.map_or(0.0, |vertical| vertical.height_variance().sqrt());
        if let Some([lowest, highest]) = placed {
            let up = vertical.map_or(lowest, |vertical| vertical.height) - site;
            let slant = distance * distance + up * up;
            let curved = distance / RADIUS;
            for level in [lowest - site, highest - site] {
                let ground = (slant - (level * level).min(HIGHEST_SHARE * slant)).sqrt();
                let here = (ground - distance).abs() + (level - up).abs() * curved;
                shift = f64::max(shift, here);
            }
            slope += up.abs() / distance.max(1.0) + curved;
        }
        SWAY_MARGIN * shift + SWAY_SIGMAS * sigma * slope.min(STEEPEST_SLOPE)
    }
}
