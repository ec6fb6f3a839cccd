//! Turns that are sharper than the guard gate allows for: fighters turn with several g.

use super::Track;
use super::fork::Surprise;
use crate::base::plane::Plane;
use crate::tracker::plot::Measured;
use crate::tracker::settings::Settings;

/// Probability that a target turns so sharply; its acceleration relative to that of the guard gate;
/// and the standard deviation of the fastest turn rates, rad/s, which limits the acceleration.
const SHARPLY: f64 = 3e-3;
const SHARPER: f64 = 6.0;
const FASTEST: f64 = 0.15;
/// Least time for which the target may have been turning, in scans, even if other radars have seen
/// it meanwhile: at first, gates hold the track to its old path.
const SINCE: f64 = 1.3;
/// Probability from which a sharp turn is believed: noise is not often so large.
const SURE: f64 = 0.7;
/// Scans without a plot after which sharp turns are no longer searched for.
const LATELY: f64 = 3.5;

impl Track {
    /// Acceleration of a sharp turn, m/s²; none if the guard gate allows for it, or if hypotheses
    /// or the methods of the paper decide about the plots.
    pub fn sharpest(&self, settings: &Settings) -> Option<f64> {
        let (guard, _) = self.unseen(settings);
        let speed = f64::hypot(self.estimate.mean[2], self.estimate.mean[3]);
        let sharp = (SHARPER * guard).min(FASTEST * speed);
        (sharp > guard && self.is_free(settings)).then_some(sharp)
    }

    /// Whether a radar should have seen the target by `end` and has not, although the target was
    /// seen lately.
    pub fn is_overdue(&self, end: f64) -> bool {
        self.beams.all().iter().any(|expected| expected.time <= end)
            && end - self.seen < LATELY * self.period
    }

    /// Centre and half width of the box in which the target is at this time after a sharp turn.
    pub fn sharp_reach(&self, time: f64, sharp: f64, settings: &Settings) -> ([f64; 2], f64) {
        let (place, p) = self.position_at(time);
        let gap = (time - self.seen).max(SINCE * self.period);
        let wide = (0.5 * sharp * gap * gap).powi(2);
        // noise of plots is about that of the track
        (place, (settings.guard * (2.0 * p.xx.max(p.yy) + wide)).sqrt())
    }

    /// Score of a plot outside the guard gate; none unless a sharp turn is likelier than noise.
    pub fn sharp_score(
        &self,
        plot: &Measured,
        (sharp, odds): (f64, f64),
        settings: &Settings,
    ) -> Option<Surprise> {
        let here = self.brought_here(plot, settings);
        let (z, r) = (here.position, here.covariance());
        let y = [z[0] - self.estimate.mean[0], z[1] - self.estimate.mean[1]];
        let gap = (plot.time - self.seen).max(SINCE * settings.radars[plot.radar].scan_period);
        let wide = (0.5 * sharp * gap * gap).powi(2);
        let wide = Plane { xx: wide, xy: 0.0, yy: wide };
        let s = self.estimate.position_covariance().plus(r).plus(wide);
        let d = s.inverse().form(y);
        let is_possible = d <= settings.guard && self.may_reach(plot, z, settings);
        if !is_possible || self.guarded_score(plot, odds, settings).is_some() {
            return None;
        }
        let [as_before, as_turned] = self.velocity_ratios(plot, (sharp, gap), settings);
        let turned = SHARPLY.ln() - 0.5 * (d + s.determinant().ln()) + as_turned.ln();
        let before = self.density(z, r).ln() + as_before.ln();
        let probability = 1.0 / (1.0 + (before - turned).exp());
        // a target that no longer exists makes no plot
        let also = self.also(plot, settings) * self.existence.probability();
        (probability > SURE).then(|| Surprise {
            gain: odds + turned - probability.ln() + also.ln(),
            odds,
            probability,
            acceleration: sharp,
            gap,
            is_sharp: true,
        })
    }
}
