//! Turns that are sharper than the guard gate allows for: fighters turn with several g.

use super::Track;
use super::fork::Surprise;
use crate::base::plane::Plane;
use crate::tracker::plot::Measured;
use crate::tracker::settings::Settings;

/// Probability that a target turns so, its acceleration over that of the guard gate, and at most the rate at
/// which targets turn, a standard deviation, rad/s.
const SHARPLY: f64 = 3e-3;
const SHARPER: f64 = 6.0;
const FASTEST: f64 = 0.15;
/// Scans since which it may have turned, if other radars have seen it meanwhile: gates hold it at first.
const SINCE: f64 = 1.3;
/// Probability from which it is believed: noise is not often so large.
const SURE: f64 = 0.7;
/// Scans without a plot after which it is not looked for.
const LATELY: f64 = 3.5;

impl Track {
    /// Acceleration of a sharp turn, m/s²; none where the guard gate allows for it, and for tracks that
    /// several hypotheses or the methods of the paper decide on.
    pub fn sharpest(&self, settings: &Settings) -> Option<f64> {
        let (guard, _) = self.unseen(settings);
        let speed = f64::hypot(self.estimate.mean[2], self.estimate.mean[3]);
        let sharp = (SHARPER * guard).min(FASTEST * speed);
        (sharp > guard && self.is_free(settings)).then_some(sharp)
    }

    /// Whether a radar should have seen it until then, and has not.
    pub fn is_overdue(&self, end: f64) -> bool {
        self.beams.all().iter().any(|expected| expected.time <= end)
            && end - self.seen < LATELY * self.period
    }

    /// The middle of the box in which it is at this time after a sharp turn, and half its width.
    pub fn sharp_reach(&self, time: f64, sharp: f64, settings: &Settings) -> ([f64; 2], f64) {
        let (place, p) = self.position_at(time);
        let gap = (time - self.seen).max(SINCE * self.period);
        let wide = (0.5 * sharp * gap * gap).powi(2);
        // noise of plots is about that of the track
        (place, (settings.guard * (2.0 * p.xx.max(p.yy) + wide)).sqrt())
    }

    /// As `guarded_score`, where a sharp turn is likelier than noise.
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
        // a target that may have gone makes no plot
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
