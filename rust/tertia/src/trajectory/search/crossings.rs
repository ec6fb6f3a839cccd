//! Crossings of the plane of the stations by a path.
//!
//! If the measurements are the same on both sides of the plane, a path that comes near it may cross it or turn
//! back. The path is first found on one side, without outliers: a few wrong positions make a motion so agile
//! that a jump to the other side costs nothing. Where this path is nearest to the plane, all later positions
//! are reflected. If a path through them is not much less likely, it is fitted to all measurements anew,
//! because other measurements may be outliers about it, and the marginal likelihoods are compared.

use super::asynchronous::Candidate;
use super::fit::{Found, Setting};
use super::outliers::ROUNDS;
use crate::trajectory::instants::mixture::Mixture;
use crate::trajectory::measured::Measured;
use crate::trajectory::mirror::{AMBIGUOUS, Sides};
use crate::trajectory::path::failure::Failure;
use std::rc::Rc;

/// Gain of ln of the likelihood from which a path crosses the plane, and the largest number of crossings. A
/// path hardly ever turns back just at the plane, but one of several crossings may be likelier by chance.
const LIKELIER: f64 = 1.0;
const CROSSINGS: usize = 8;
/// Difference of ln of the likelihoods up to which either of two paths may be right: near the plane, where the
/// square of the distance is measured, likelihoods are less accurate than elsewhere.
const DOUBTFUL: f64 = 2.0 * AMBIGUOUS;
/// Fall of ln of the likelihood of positions up to which a crossing is compared with all measurements.
const FALL: f64 = 20.0;

impl<const D: usize, const N: usize> Found<D, N> {
    /// As [`Candidate::crossed`], for a path with these sizes of noise and outliers.
    pub fn crossed(
        self,
        setting: &mut Setting<'_, D, N>,
        measured: &Rc<Measured<D>>,
        mixture: Mixture,
    ) -> Result<Self, Failure> {
        if self.sides.is_none() || self.plots.count(D) < 2 {
            return Ok(self);
        }
        Ok(Candidate::new(self, mixture, setting)?.crossed(setting, measured)?.found)
    }

    /// Returns the path fitted anew on the other side of the plane.
    pub fn image(
        &self,
        setting: &mut Setting<'_, D, N>,
        measured: &Rc<Measured<D>>,
    ) -> Result<Self, Failure> {
        let Some(sides) = &self.sides else { return Ok(self.clone()) };
        self.on_the_other_side(setting, measured, sides, 0).map(|(found, _)| found)
    }

    /// Returns the path fitted anew on the other side of the plane from an instant on, by the measurements.
    fn on_the_other_side(
        &self,
        setting: &mut Setting<'_, D, N>,
        measured: &Rc<Measured<D>>,
        sides: &Sides<D>,
        start: usize,
    ) -> Result<(Self, Mixture), Failure> {
        let plots = sides.reflected_from(start, &self.plots);
        let path = setting.smoothed(&plots, setting.motion, None)?;
        let mut other =
            Self { plots, path, sides: Some(sides.flipped_from(start)), ..self.clone() };
        other.stay_beside();
        if setting.record.robust {
            return other.weighed(setting, measured, ROUNDS);
        }
        let other = other.without_outliers(setting, measured)?;
        Ok((other, Mixture::new(Vec::new())))
    }

    /// Returns the first instants on the other side, of paths with one more crossing that may be as likely.
    fn crossings(
        &self,
        setting: &mut Setting<'_, D, N>,
        sides: &Sides<D>,
    ) -> Result<Vec<usize>, Failure> {
        let nearest = sides.nearest(&self.path);
        if nearest.is_empty() {
            return Ok(nearest);
        }
        let least =
            setting.smoothed(&self.plots, setting.motion, None)?.summary.log_likelihood - FALL;
        let last = setting.record.len() - 1;
        let mut value = |after: usize| -> Result<f64, Failure> {
            let plots = sides.reflected_from(after + 1, &self.plots);
            let path = setting.smoothed(&plots, setting.motion, None)?;
            let is_other = sides.flipped_from(after + 1).crosses_at(after + 1, &path);
            Ok(if is_other { path.summary.log_likelihood } else { f64::NEG_INFINITY })
        };
        let mut all = Vec::new();
        for mut after in nearest {
            let (mut top, mut step) = (value(after)?, sides.reach());
            while step > 0 {
                let mut is_other = false;
                for at in [after.saturating_sub(step), (after + step).min(last - 1)] {
                    let own = value(at)?;
                    if own > top {
                        (after, top, is_other) = (at, own, true);
                    }
                }
                if !is_other {
                    step /= 2;
                }
            }
            if top > least && !all.contains(&(after + 1)) {
                all.push(after + 1);
            }
        }
        Ok(all)
    }
}

impl<const D: usize, const N: usize> Candidate<D, N> {
    /// Returns the path that crosses the plane of the stations where that is likelier than turning back. Above
    /// a level plane the path stays above.
    pub fn crossed(
        mut self,
        setting: &mut Setting<'_, D, N>,
        measured: &Rc<Measured<D>>,
    ) -> Result<Self, Failure> {
        let mut others = Vec::new();
        for _ in 0..CROSSINGS {
            let Some(sides) = self.found.sides.clone() else { return Ok(self) };
            let mut best: Option<Self> = None;
            for start in self.found.crossings(setting, &sides)? {
                let other = self.found.on_the_other_side(setting, measured, &sides, start);
                // a path that cannot be fitted is not likely
                let Ok(other) = other.and_then(|(own, mixture)| Self::new(own, mixture, setting))
                else {
                    continue;
                };
                others.push((sides.flipped_from(start), other.value));
                if best.as_ref().is_none_or(|best| other.value > best.value) {
                    best = Some(other);
                }
            }
            let least = if sides.mirror.is_level { AMBIGUOUS } else { LIKELIER };
            let Some(best) = best.filter(|best| best.value > self.value + least) else { break };
            if sides.mirror.is_level {
                self.found.sides.iter_mut().for_each(|sides| sides.may_cross = true);
                return Ok(self);
            }
            others.push((sides, self.value));
            self = best;
        }
        let Self { found: Found { sides, path, .. }, value, .. } = &mut self;
        if let Some(own) = sides.as_mut().filter(|own| !own.mirror.is_level) {
            let mut near = others.iter().filter(|other| other.1 > *value - DOUBTFUL);
            own.is_doubtful = near.any(|(sides, _)| own.differ(sides, &path.mean, N));
        }
        Ok(self)
    }
}
