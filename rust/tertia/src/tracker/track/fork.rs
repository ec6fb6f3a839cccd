//! A plot far from where it was expected: either the target has accelerated, or the plot is an
//! outlier. The next plot decides, as it is nearer to what follows from one of the two.

use super::{Fork, Track};
use crate::base::plane::Plane;
use crate::tracker::motion::Motion;
use crate::tracker::motion::estimate::Estimate;
use crate::tracker::noise::outliers::{Outliers, Stray};
use crate::tracker::plot::Measured;
use crate::tracker::settings::Settings;
use crate::tracker::settings::association::{Association, paper_score};

/// Probability that a target accelerates so strongly that the guard gate is needed.
const UNNOTICED: f64 = 0.05;

/// Squared normalised distance within which the next plot is in 90 % of all cases if the
/// explanation is right, and the logarithm of the likelihood ratio from which the decision is
/// certain.
const NEAR: f64 = 4.6;
const SURE: f64 = 4.6;

/// Why a track may take a plot outside its gate.
#[derive(Clone, Copy, Debug)]
pub(in crate::tracker) struct Surprise {
    /// Score of the plot, and the odds of its radar, which the score contains.
    pub gain: f64,
    pub odds: f64,
    /// Probability that the target has accelerated, the standard deviation of this acceleration,
    /// m/s², and its duration, s.
    pub probability: f64,
    pub acceleration: f64,
    pub gap: f64,
    /// Whether turns at any rate may have begun.
    pub is_sharp: bool,
}

impl Fork {
    /// An estimate whose mean is that of the shown one and whose covariance covers both states.
    pub fn widened(&self, shown: &Estimate<4>) -> Estimate<4> {
        let other = &self.state.estimate;
        let p = 1.0 / (1.0 + (-self.log_odds).exp());
        let apart = other.mean - shown.mean;
        let spread = other.covariance + apart * apart.transpose();
        Estimate { mean: shown.mean, covariance: shown.covariance * (1.0 - p) + spread * p }
    }
}

impl Track {
    /// Score of a plot in the guard gate: either the target has accelerated since it was last seen,
    /// with the probability in the result, or the plot has a large error.
    pub fn guarded_score(
        &self,
        plot: &Measured,
        odds: f64,
        settings: &Settings,
    ) -> Option<Surprise> {
        let here = self.brought_here(plot, settings);
        let (z, r) = (here.position, here.covariance());
        let y = [z[0] - self.estimate.mean[0], z[1] - self.estimate.mean[1]];
        let (sigma, gap) = self.unnoticed(plot.radar, settings);
        let surprise = |gain: f64, probability: f64| Surprise {
            gain,
            odds,
            probability,
            acceleration: sigma,
            gap,
            is_sharp: false,
        };
        let wide = (0.5 * sigma * gap * gap).powi(2);
        let wide = Plane { xx: wide, xy: 0.0, yy: wide };
        if let Association::Paper(q) = settings.association {
            // in the paper the gate is always widened
            let score = paper_score(&self.estimate, z, r.plus(wide), q, settings.guard)?;
            return Some(surprise(score + self.also_moving(plot, settings).ln(), 1.0));
        }
        let s = self.estimate.position_covariance().plus(r).plus(wide);
        let d = s.inverse().form(y);
        if d > settings.guard || !self.may_reach(plot, z, settings) {
            return None;
        }
        let [as_before, as_accelerated] = self.velocity_ratios(plot, (sigma, gap), settings);
        let accelerated = UNNOTICED.ln() - 0.5 * (d + s.determinant().ln()) + as_accelerated.ln();
        let straight = self.density(z, r).ln() + as_before.ln();
        // the window of the paper is always widened
        let always = matches!(settings.motion, Motion::Window(_));
        let ratio = if always { f64::INFINITY } else { (accelerated - straight).exp() };
        let probability = 1.0 - 1.0 / (1.0 + ratio);
        let density = accelerated - probability.ln();
        Some(surprise(odds + density + self.also(plot, settings).ln(), probability))
    }

    /// Whether the target can have reached the place of a plot since it was last seen, if it is no
    /// faster than the fastest target or than it was. At least one scan is allowed for this: plots
    /// of other radars may have held the track to its old path.
    pub(super) fn may_reach(&self, plot: &Measured, place: [f64; 2], settings: &Settings) -> bool {
        let (x, p) = (&self.estimate.mean, self.estimate.position_covariance());
        let speed = settings.max_speed.max(f64::hypot(x[2], x[3]));
        let ahead = self.time - self.seen;
        let [east, north] = [0, 1].map(|i| place[i] - x[i] + ahead * x[i + 2]);
        let gap = (plot.time - self.seen).abs().max(settings.radars[plot.radar].scan_period);
        let errors = (2.0 * settings.guard * (p.xx + p.yy)).sqrt();
        f64::hypot(east, north) <= speed * gap + errors
    }

    /// Corrects by a plot on the assumption that the target has accelerated.
    pub fn take_guarded(&mut self, plot: &Measured, surprise: &Surprise, settings: &Settings) {
        let Surprise { acceleration, gap, probability, is_sharp, .. } = *surprise;
        let before = self.estimate.position_covariance();
        self.filter.widen(acceleration, gap, probability);
        if is_sharp {
            self.filter.free_turns();
        }
        self.estimate = self.filter.estimate();
        self.correct_widened(plot, before, settings);
    }

    /// Whether the decision may be left to the next plot. Hypotheses do that by themselves, the
    /// methods of the paper decide at once, and plans must not be assigned and removed together
    /// with alternative states.
    fn may_fork(&self, settings: &Settings) -> bool {
        self.is_free(settings) && self.plan().is_none()
    }

    /// Whether neither hypotheses nor the methods of the paper decide about plots.
    pub(super) fn is_free(&self, settings: &Settings) -> bool {
        settings.limits().is_none()
            && !matches!(settings.association, Association::Paper(_))
            && !matches!(settings.motion, Motion::Window(_))
    }

    /// Logarithm of the odds that a plot is an outlier, at the share of outliers of its radar,
    /// against an acceleration with this `gain`.
    fn outlier_odds(
        &self,
        plot: &Measured,
        (gain, odds): (f64, f64),
        outliers: &Outliers,
        settings: &Settings,
    ) -> f64 {
        let here = self.brought_here(plot, settings);
        let (z, s) = (here.position, self.estimate.position_covariance().plus(here.covariance()));
        let y = [z[0] - self.estimate.mean[0], z[1] - self.estimate.mean[1]];
        let density = outliers.density(s.inverse().form(y), s.determinant());
        let also = self.also(plot, settings) * self.velocity_ratios(plot, (0.0, 0.0), settings)[0];
        odds + (density * also).ln() - gain
    }

    /// Takes a plot as the result of an acceleration, unless it is more likely one of the outliers
    /// of the radar. Returns whether the plot is taken.
    pub fn take_or_fork(
        &mut self,
        plot: &Measured,
        surprise: &Surprise,
        outliers: &Outliers,
        settings: &Settings,
    ) -> bool {
        let Surprise { gain, odds, is_sharp, .. } = *surprise;
        let log_odds = self.outlier_odds(plot, (gain, odds), outliers, settings);
        let is_taken = log_odds < 0.0;
        if !self.may_fork(settings) {
            let is_taken = is_taken || !is_sharp;
            if is_taken {
                self.take_guarded(plot, surprise, settings);
            }
            return is_taken;
        }
        self.stray = None;
        let before = self.fork.take();
        let mut state = self.clone();
        let accelerated = if is_taken { &mut *self } else { &mut state };
        accelerated.take_guarded(plot, surprise, settings);
        let fork = Fork {
            state,
            log_odds: (-log_odds.abs()).max(-SURE),
            is_outlier: is_taken,
            radar: plot.radar,
        };
        // the state before two far plots is kept, as both may be outliers
        let both = before.filter(|one| is_taken && one.is_outlier).map(|mut one| {
            let more = one.state.outlier_odds(plot, (gain, odds), outliers, settings);
            one.log_odds = (one.log_odds + more).max(-SURE);
            one
        });
        self.fork = Some(both.unwrap_or(Box::new(fork)));
        is_taken
    }

    /// Whether a plot is as near to its expected position as most plots are.
    fn expects(&self, plot: &Measured, settings: &Settings) -> bool {
        let here = self.brought_here(plot, settings);
        self.nearest(here.position, here.covariance()) < NEAR
    }

    /// Returns the last stray plot if this plot shows that the target has gone on as before.
    pub fn gone_on(&mut self, plot: &Measured, settings: &Settings) -> Option<Stray> {
        self.stray.take().filter(|_| self.expects(plot, settings))
    }

    /// Decides by the next plot whether the far plot was due to an acceleration or was an outlier.
    /// Returns the radar of the far plot if it was certainly an outlier: a target that moves as no
    /// model does is not where it was expected either.
    pub fn decide(&mut self, plot: &Measured, settings: &Settings) -> Option<usize> {
        let Fork { state, log_odds, is_outlier, radar } = *self.fork.take()?;
        let score = |track: &Self| track.score(plot, 0.0, settings).unwrap_or(f64::NEG_INFINITY);
        let [own, other] = [score(self), score(&state) + log_odds];
        let is_other = other > own;
        let right = if is_other { &state } else { &*self };
        let is_sure = right.expects(plot, settings) && (own - other).abs() > SURE;
        if is_other && is_sure {
            (self.filter, self.estimate) = (state.filter, state.estimate);
            (self.vertical, self.lean, self.seen) = (state.vertical, state.lean, state.seen);
            self.delays = state.delays;
        }
        (is_sure && is_outlier == is_other).then_some(radar)
    }

    /// The alternative state, if there is one.
    pub fn forked(&self) -> Option<&Self> {
        self.fork.as_deref().map(|fork| &fork.state)
    }

    /// The larger of the scores of a plot in both states.
    #[inline]
    pub fn best_score(&self, plot: &Measured, odds: f64, settings: &Settings) -> Option<f64> {
        let own = self.score(plot, odds, settings);
        let Some(fork) = self.fork.as_deref() else { return own };
        let other = fork.state.score(plot, odds, settings).map(|score| score + fork.log_odds);
        own.into_iter().chain(other).max_by(f64::total_cmp)
    }
}
