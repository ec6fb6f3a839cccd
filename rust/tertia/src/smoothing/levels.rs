//! Times at which the noise of the positions, or the motion, is larger than at other times: reflections for some
//! seconds, turns after a straight path, a target that stands still and then moves.
//!
//! With one level for the whole track, the covariance is right on average, but far too small at such times. They are
//! found by a hidden Markov model of the squared innovations. It must explain these better than two levels that
//! alternate at random, because outliers do that.

use super::fit::Family;
use super::lasting::Found;
use super::model::{Faults, Levels, Model};
use super::search::{Candidate, Scale, Search, climb};
use super::track::Track;
use crate::base::distribution::chi_square_upper_quantile;

/// Probability above which an innovation is limited: a single outlier must not be a time of large noise.
const LIMIT: f64 = 1e-3;
/// Least gain of the log-likelihood of the innovations by levels that last.
const LASTING_GAIN: f64 = 5.0;
/// Least number of instants with each level.
const FEW: usize = 4;
const ITERATIONS: usize = 40;
/// Ratios of the levels from which their search starts.
const RATIOS: [f64; 2] = [4.0, 16.0];
/// Numbers of plots by which more motion may precede the innovations that show it.
const LEADS: [usize; 3] = [0, 2, 4];
/// Least number of instants of a track with levels.
const LEAST: usize = 30;
/// Share of the plots that repeat the one before from which on values are rounded: steps of rounding look like motion.
const ROUNDED: f64 = 0.2;
/// Largest difference of repeated values, relative to their standard deviation.
const SAME: f64 = 1e-6;

/// Squared innovations of an instant, and their number.
type Squares = (f64, f64);

/// Two levels of the variance of innovations, each of which lasts for some time.
#[derive(Clone, Copy)]
struct Hidden {
    levels: [f64; 2],
    /// Share of the instants with the higher level, and the probability that it lasts until the next instant.
    share: f64,
    stay: f64,
}

/// Expected numbers of instants, squares and innovations at each level, and of instants with the higher level
/// after which it stays or ends; the log-likelihood.
#[derive(Default)]
struct Expectation {
    instants: [f64; 2],
    squares: [f64; 2],
    counts: [f64; 2],
    stays: f64,
    ends: f64,
    log_likelihood: f64,
}

impl Hidden {
    /// Probabilities of both levels after an instant at which they have these.
    fn next(&self, now: [f64; 2]) -> [f64; 2] {
        let begin = (self.share * (1.0 - self.stay) / (1.0 - self.share)).min(1.0);
        let high = now[0] * begin + now[1] * self.stay;
        [1.0 - high, high]
    }

    /// Likelihoods of an instant, relative to the larger one, and the logarithm of that.
    fn emission(&self, (squares, count): Squares) -> ([f64; 2], f64) {
        let logs = self.levels.map(|level| -0.5 * (count * level.ln() + squares / level));
        let top = logs[0].max(logs[1]);
        (logs.map(|log| (log - top).exp()), top)
    }

    /// Filters forwards and backwards; `high` receives the probabilities of the higher level.
    fn expect(&self, all: &[Squares], high: &mut Vec<f64>) -> Expectation {
        let mut found = Expectation::default();
        let mut prior = [1.0 - self.share, self.share];
        high.clear();
        for own in all {
            let (likelihood, top) = self.emission(*own);
            let joint = [prior[0] * likelihood[0], prior[1] * likelihood[1]];
            let sum = joint[0] + joint[1];
            found.log_likelihood += top + sum.ln();
            high.push(joint[1] / sum);
            prior = self.next([joint[0] / sum, joint[1] / sum]);
        }
        let mut after: Option<f64> = None;
        for (k, &(squares, count)) in all.iter().enumerate().rev() {
            let filtered = high[k];
            let smoothed = after.map_or(filtered, |after| {
                let predicted = self.next([1.0 - filtered, filtered]);
                let stays = filtered * self.stay * after / predicted[1].max(f64::MIN_POSITIVE);
                let ends = filtered * (1.0 - self.stay) * (1.0 - after)
                    / predicted[0].max(f64::MIN_POSITIVE);
                found.stays += stays;
                found.ends += ends;
                (stays + ends).min(1.0)
            });
            high[k] = smoothed;
            after = Some(smoothed);
            for (level, p) in [1.0 - smoothed, smoothed].into_iter().enumerate() {
                found.instants[level] += p;
                found.squares[level] += p * squares;
                found.counts[level] += p * count;
            }
        }
        found
    }

    /// Returns the likeliest levels and their log-likelihood, by expectation and maximisation.
    fn fit(mut self, all: &[Squares], lasts: bool, high: &mut Vec<f64>) -> (Self, f64) {
        for _ in 0..ITERATIONS {
            let own = self.expect(all, high);
            let level = |i: usize| (own.squares[i] / own.counts[i].max(1.0)).max(1e-6);
            self.levels = [level(0), level(1).max(level(0))];
            self.share = (own.instants[1] / all.len() as f64).clamp(1e-3, 0.9);
            let stay = (own.stays + 1.0) / (own.stays + own.ends + 1.1);
            self.stay = if lasts { stay.clamp(self.share, 0.999) } else { self.share };
        }
        let value = self.expect(all, high).log_likelihood;
        (self, value)
    }
}

/// Returns at which instants innovations (N, M) of D positions are larger, and how much larger their variance is
/// then; `None` unless the levels last.
fn raised(innovation: &[f64], m: usize, d: usize) -> Option<(Vec<bool>, f64)> {
    let limits: Vec<f64> = (0..=d).map(|n| chi_square_upper_quantile(LIMIT, n.max(1))).collect();
    let of = |now: &[f64]| {
        let known = || now[..d].iter().filter(|x| !x.is_nan());
        let (squares, count) = (known().map(|x| x * x).sum::<f64>(), known().count());
        (squares.min(limits[count]), count as f64)
    };
    let all: Vec<Squares> = innovation.chunks_exact(m).map(of).collect();
    let (squares, count) = all.iter().fold((0.0, 0.0), |sum, own| (sum.0 + own.0, sum.1 + own.1));
    if count < 1.0 || squares == 0.0 {
        return None;
    }
    let mean = squares / count;
    let (mut high, mut best) = (Vec::new(), None::<(Hidden, f64)>);
    let mut random = f64::NEG_INFINITY;
    for ratio in RATIOS {
        let levels = [0.7 * mean, 0.7 * ratio * mean];
        let (_, value) = Hidden { levels, share: 0.2, stay: 0.2 }.fit(&all, false, &mut high);
        random = random.max(value);
        let own = Hidden { levels, share: 0.2, stay: 0.9 }.fit(&all, true, &mut high);
        if best.is_none_or(|best| own.1 > best.1) {
            best = Some(own);
        }
    }
    let (hidden, value) = best?;
    if value.is_nan() || value < random + LASTING_GAIN {
        return None;
    }
    hidden.expect(&all, &mut high);
    let raised: Vec<bool> = high.iter().map(|p| *p > 0.5).collect();
    let number = raised.iter().filter(|raised| **raised).count();
    (FEW..=all.len() - FEW).contains(&number).then(|| (raised, hidden.levels[1] / hidden.levels[0]))
}

/// Returns the levels that are possible for a track, one with larger noise and one with more motion, each fitted
/// without the given faults; none if the innovations of the likeliest model with white noise have one level. Cost:
/// a smoother, and hundreds of filters if there are levels.
pub(super) fn find_levels<const M: usize, const S: usize, const N: usize>(
    search: &mut Search<'_, M, N>,
    white: &Candidate,
    faults: &Faults,
) -> Vec<Levels> {
    let mut found = Found::default();
    if search.track.len() < LEAST || is_rounded(search.track) {
        return Vec::new();
    }
    if search.engine.smooth(search.track, &white.model, faults, &mut found).is_none() {
        return Vec::new();
    }
    let Some((raised, ratio)) = raised(&found.innovation, M, search.track.dimension) else {
        return Vec::new();
    };
    // jumps would explain the largest errors
    let calm = Faults { jumps: vec![false; faults.jumps.len()], ..faults.clone() };
    let levels = Levels { raised, ..Levels::default() };
    let mut all = vec![fitted(search, white, &calm, (&levels, ratio.ln()), true).0];
    if search.jerk.is_none() {
        let motion = LEADS.map(|lead| {
            let n = levels.raised.len();
            let raised = (0..n).map(|k| levels.raised[k..(k + lead + 1).min(n)].contains(&true));
            let levels = Levels { raised: raised.collect(), ..levels.clone() };
            fitted(search, white, faults, (&levels, 2.0 * ratio.ln()), false)
        });
        let best = motion.into_iter().max_by(|a, b| a.1.total_cmp(&b.1));
        all.extend(best.map(|(levels, _)| levels));
    }
    all
}

/// Whether many positions repeat the one before, on any axis.
fn is_rounded(track: &Track<'_>) -> bool {
    let same = |axis: usize| {
        let value = |k: usize| track.plot(k)[axis] + track.trend_position(axis, k);
        let limit = SAME / track.position_scale()[axis];
        (1..track.len()).filter(|&k| (value(k) - value(k - 1)).abs() < limit).count()
    };
    (0..track.dimension).any(|axis| same(axis) as f64 > ROUNDED * track.len() as f64)
}

/// Returns the likeliest levels with their likelihood, of the noise or of the motion.
fn fitted<const M: usize, const N: usize>(
    search: &Search<'_, M, N>,
    white: &Candidate,
    faults: &Faults,
    (levels, start): (&Levels, f64),
    is_noise: bool,
) -> (Levels, f64) {
    let with = |more: f64| {
        let level = (start + more).max(0.0).exp();
        let [noise, motion] = if is_noise { [level, 1.0] } else { [1.0, level] };
        Levels { noise, motion, ..levels.clone() }
    };
    let mut best = (with(0.0), f64::NEG_INFINITY);
    for family in [Family::Jerk, Family::Acceleration] {
        let motion = family.of(search.track);
        let log = match search.jerk {
            Some(jerk) => jerk.max(f64::MIN_POSITIVE).ln(),
            None if Family::that_has(white.model.motion) == family => {
                family.log(white.model.motion)
            }
            None => family.like(white.model.motion, search.track),
        };
        let log = log.max(search.low);
        let of = |[more, level]: [f64; 2]| {
            let model = Model { motion: motion(log + more), ..white.model };
            let faults = Faults { levels: with(level), ..faults.clone() };
            search.candidate(model, Scale::Larger, &faults)
        };
        let (at, found) = climb([search.jerk.is_none(), true], f64::NEG_INFINITY, of);
        if found.value > best.1 {
            best = (with(at[1]), found.value);
        }
        if search.jerk.is_some() {
            break;
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::noise;

    fn innovations(seed: usize, size: impl Fn(usize) -> f64) -> Vec<f64> {
        (0..400).map(|i| size(i / 2) * noise(1000 * seed + i)).collect()
    }

    #[test]
    fn times_of_larger_innovations_are_found() {
        let is_large = |k: usize| (60..80).contains(&k) || (150..165).contains(&k);
        let all = innovations(1, |k| if is_large(k) { 4.0 } else { 1.0 });
        let (raised, ratio) = raised(&all, 2, 2).unwrap();
        let wrong = (0..200).filter(|&k| raised[k] != is_large(k)).count();
        assert!(wrong < 10, "{wrong}");
        assert!(ratio > 4.0);
    }

    /// Neither one level nor outliers at random are times of larger innovations.
    #[test]
    fn what_does_not_last_is_no_level() {
        for seed in 1..20 {
            assert!(raised(&innovations(seed, |_| 1.3), 2, 2).is_none());
            let random = |k: usize| if (k * k * 7 + 3 * k) % 11 < 2 { 9.0 } else { 1.0 };
            assert!(raised(&innovations(seed, random), 2, 2).is_none());
        }
    }
}
