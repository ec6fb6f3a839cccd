//! Outliers in a batch of instants that have too few redundant measurements for a robust fit.
//!
//! With one or two degrees of freedom, a robust fit cannot tell which measurement is wrong, and a
//! least-squares fit spreads the error over the position. A batch, however, shows how frequent and how
//! large such errors are. Every measurement has normal noise with variance φ; with probability ε, it also
//! has an error with mean μ and variance s². Errors are in units of the stated sigmas. Each set of wrong
//! measurements has its own positions ([`modes`](super::modes)), each with a restricted likelihood
//! (Patterson, Thompson 1971). ε, φ, μ and s are estimated in rounds of expectation and maximisation
//! (Dempster, Laird, Rubin 1977). The result is the most probable position, and its 95 % ellipse contains
//! 95 % of the mixture of all positions.

use super::contradiction::{Contradiction, SAMPLE};
use super::modes::{Mode, Modes, is_in};
use super::normals::{Normal, growth};
use crate::base::distribution::chi_square_upper;
use crate::base::small::{Factor, Matrix, Vector, dot, quadratic};
use crate::location::search::fix::{Fix, Instant, Output, Status};
use crate::location::solver::growth::growth_of_all;
use crate::location::solver::{Locator, Workspace};
use crate::sensors::KINDS;

/// Start of the rounds: share of wrong measurements, and variance of their additional errors.
const FIRST: (f64, f64) = (0.05, 400.0);
const ROUNDS: usize = 10;
/// Smallest and largest share of wrong measurements.
const SHARES: (f64, f64) = (0.003, 0.45);
/// Smallest variance of the additional errors: smaller errors are noise.
const LEAST: f64 = 25.0;
/// Smallest ln of the likelihood ratio of wrong measurements to noise that is larger than stated, for which
/// measurements are taken to be wrong.
const CLEARLY: f64 = 10.0;
/// The most probable positions determine the shape of the ellipse until they have this probability together.
const MOST: f64 = 0.97;
/// Largest probability of a position that is left out of the ellipse.
const LEAST_WEIGHT: f64 = 1e-3;
/// A measurement that is wrong with a higher probability than this is marked as an outlier.
const WRONG: f64 = 0.5;

/// Distribution of the errors of the measurements of a batch, in units of the stated sigmas.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mixture {
    /// Share of wrong measurements.
    share: f64,
    /// Variance of the noise of each kind.
    noise: [f64; KINDS],
    /// Mean of the additional errors of wrong measurements of each kind; below, their variance.
    mean: [f64; KINDS],
    variance: [f64; KINDS],
}

/// Result of a Gauss–Newton step from the position of a mode to the maximum of its restricted likelihood.
struct Judged<const D: usize> {
    /// ln of the restricted likelihood; [`Mixture::weighed`] replaces it by the probability of the mode.
    ln: f64,
    step: Vector<D>,
    covariance: Matrix<D>,
}

/// Sums over the modes of a sample of instants in one round.
#[derive(Default)]
struct Sums {
    ln: f64,
    count: f64,
    wrong: f64,
    error: f64,
    square: f64,
    kept: [f64; KINDS],
    noise: [f64; KINDS],
    freedom: [f64; KINDS],
}

impl Mixture {
    fn of(share: f64, noise: [f64; KINDS], mean: f64, variance: f64) -> Self {
        Self { share, noise, mean: [mean; KINDS], variance: [variance; KINDS] }
    }

    /// Returns these errors in units of sigmas that are larger by the square roots of these factors.
    fn relative_to(&self, factor: &[f64; KINDS]) -> Self {
        let over = |own: &[f64; KINDS], power: f64| {
            std::array::from_fn(|kind| own[kind] / factor[kind].powf(power))
        };
        Self {
            share: self.share,
            noise: over(&self.noise, 1.0),
            mean: over(&self.mean, 0.5),
            variance: over(&self.variance, 1.0),
        }
    }

    /// Returns a contradiction whose factors are the noise variances of this mixture: for a batch in which
    /// there are hardly any instants with more redundant measurements.
    fn contradiction(&self, other: &Contradiction) -> Contradiction {
        Contradiction { growth: self.noise, factor: self.noise, common: [0.0; KINDS], ..*other }
    }

    /// Returns the mean and variance of the error of a measurement in a mode.
    fn error<const D: usize>(&self, all: &Modes<D>, mode: &Mode<D>, i: usize) -> (f64, f64) {
        match all.places[i] {
            Some((kind, _)) if is_in(mode.wrong, i) => {
                (self.mean[kind], self.noise[kind] + self.variance[kind])
            }
            Some((kind, _)) if all.free[i] => (0.0, self.noise[kind]),
            _ => (0.0, 1.0),
        }
    }

    fn judged<const D: usize>(&self, all: &Modes<D>, mode: &Mode<D>) -> Option<Judged<D>> {
        let (mut normal, mut vector) = ([[0.0; D]; D], [0.0; D]);
        let wrong = f64::from(mode.wrong.count_ones());
        let right = all.free.iter().filter(|free| **free).count() as f64 - wrong;
        let mut ln = right * (1.0 - self.share).ln();
        if wrong > 0.0 {
            ln += wrong * self.share.ln();
        }
        for (i, row) in mode.rows.iter().enumerate() {
            let (mean, variance) = self.error(all, mode, i);
            let residual = row.residual - mean;
            ln -= 0.5 * (residual * residual / variance + variance.ln());
            for a in 0..D {
                vector[a] += row.gradient[a] * residual / variance;
                for b in 0..D {
                    normal[a][b] += row.gradient[a] * row.gradient[b] / variance;
                }
            }
        }
        let factor = Factor::try_new(&normal, 0.0)?;
        let step = factor.solve(&vector);
        ln += 0.5 * (dot(&vector, &step) - factor.ln_determinant());
        (!ln.is_nan()).then(|| Judged { ln, step, covariance: factor.inverse() })
    }

    /// Returns the possible modes of an instant, with probabilities in place of ln of their likelihoods, and
    /// ln of the sum of these likelihoods.
    fn weighed<'a, const D: usize>(
        &self,
        all: &'a Modes<D>,
    ) -> (Vec<(&'a Mode<D>, Judged<D>)>, f64) {
        let likely = |mode: &&Mode<D>| self.share > 0.0 || mode.wrong == 0;
        let judged = |mode: &'a Mode<D>| Some((mode, self.judged(all, mode)?));
        let mut found: Vec<_> = all.modes.iter().filter(likely).filter_map(judged).collect();
        let top = found.iter().map(|(_, own)| own.ln).fold(f64::NEG_INFINITY, f64::max);
        let total: f64 = found.iter().map(|(_, own)| (own.ln - top).exp()).sum();
        found.iter_mut().for_each(|(_, own)| own.ln = (own.ln - top).exp() / total);
        (found, top + total.ln())
    }

    /// Computes the sums of one round (the expectation step).
    fn sums<const D: usize>(&self, sample: &[Modes<D>]) -> Sums {
        let mut sums = Sums::default();
        for all in sample {
            let (found, ln) = self.weighed(all);
            sums.ln += ln;
            sums.count += all.free.iter().filter(|free| **free).count() as f64;
            for (mode, judged) in &found {
                self.add(all, mode, judged, &mut sums);
            }
        }
        sums
    }

    fn add<const D: usize>(
        &self,
        all: &Modes<D>,
        mode: &Mode<D>,
        judged: &Judged<D>,
        sums: &mut Sums,
    ) {
        let weight = judged.ln;
        for (i, row) in mode.rows.iter().enumerate().filter(|(i, _)| all.free[*i]) {
            let Some((kind, _)) = all.places[i] else { continue };
            let error = row.residual - dot(&row.gradient, &judged.step);
            let unknown = quadratic(&judged.covariance, &row.gradient);
            if is_in(mode.wrong, i) {
                // `share` divides the deviation from the mean between the additional error and noise
                let (mean, variance, noise) =
                    (self.mean[kind], self.variance[kind], self.noise[kind]);
                let share = variance / (variance + noise);
                let wrong = mean + share * (error - mean);
                sums.wrong += weight;
                sums.error += weight * wrong;
                sums.square += weight * (wrong * wrong + share * share * unknown + share * noise);
            } else {
                sums.kept[kind] += weight;
                sums.noise[kind] += weight * (error * error + unknown);
                sums.freedom[kind] += weight * (1.0 - unknown / self.noise[kind]);
            }
        }
    }
}

impl Sums {
    /// Returns the most likely mixture for these sums (the maximisation step).
    fn next(&self) -> Mixture {
        let wrong = self.wrong.max(f64::MIN_POSITIVE);
        let mean = self.error / wrong;
        let noise = |kind: usize| match self.kept[kind] > 0.0 {
            true => (self.noise[kind] / self.kept[kind]).max(1.0),
            false => 1.0,
        };
        Mixture::of(
            (self.wrong / self.count).clamp(SHARES.0, SHARES.1),
            std::array::from_fn(noise),
            mean,
            (self.square / wrong - mean * mean).max(LEAST),
        )
    }
}

impl Locator {
    /// Returns how a batch contradicts its sigmas. If measurements of instants with few redundant
    /// measurements are wrong, also returns the distribution of their errors, in units of the enlarged
    /// sigmas; the contradiction is then estimated from the other instants if there are at least two,
    /// otherwise from the noise of this distribution.
    pub fn errors<const D: usize>(
        &self,
        instants: &[Instant<'_>],
        free: &[bool],
        pooled: bool,
        workspace: &mut Workspace<D>,
    ) -> (Contradiction, Option<Mixture>) {
        let found = self.contradiction(instants, free, pooled, workspace);
        if pooled {
            return (found, None);
        }
        let mixture = self.mixture(instants, free, &found, workspace);
        let Some(mixture) = mixture else { return (found, None) };
        let others: Vec<_> = instants.iter().filter(|own| !self.has_few(own, D)).copied().collect();
        let rest = match others.len() {
            0 | 1 => mixture.contradiction(&found),
            _ => self.contradiction(&others, free, false, workspace),
        };
        let mixture = mixture.relative_to(&rest.growth);
        (rest, Some(mixture))
    }

    /// Returns the distribution of the errors of a batch that contradicts its sigmas, if in the instants
    /// with few redundant measurements wrong measurements are a better explanation than noise that is
    /// larger than stated. O(2^M M) for each of at most 256 instants.
    fn mixture<const D: usize>(
        &self,
        instants: &[Instant<'_>],
        free: &[bool],
        found: &Contradiction,
        workspace: &mut Workspace<D>,
    ) -> Option<Mixture> {
        if !found.is_heavy {
            return None;
        }
        let few: Vec<_> = instants.iter().filter(|own| self.has_few(own, D)).collect();
        let count = few.len().min(SAMPLE);
        let evenly = (0..count).map(|i| few[i * few.len() / count]);
        let sample: Vec<Modes<D>> = evenly
            .map(|own| self.modes(own, free, workspace))
            .filter(|own| own.modes.iter().any(|mode| mode.wrong == 0))
            .collect();
        if sample.is_empty() {
            return None;
        }
        let common = Mixture::of(0.0, found.factor, 0.0, 0.0).sums(&sample).ln;
        let mut mixture = Mixture::of(FIRST.0, [1.0; KINDS], 0.0, FIRST.1);
        for _ in 0..ROUNDS {
            mixture = mixture.sums(&sample).next();
        }
        let sums = mixture.sums(&sample);
        let share = found.independent(&sums.freedom);
        if share * (sums.ln - common) < CLEARLY {
            return None;
        }
        for (noise, freedom) in mixture.noise.iter_mut().zip(sums.freedom) {
            let own = share * freedom;
            *noise = growth_of_all::<D>(*noise * own, own);
        }
        Some(mixture)
    }

    /// As [`Locator::locate_all`], for a batch whose instants with few redundant measurements have errors
    /// with this distribution. The marks in `errors` (5 K) say which measurements may be wrong.
    pub fn locate_all_mixed<const D: usize>(
        &self,
        instants: &[Instant<'_>],
        errors: (&Mixture, &[bool]),
        (out, fixes): (&mut [Output<'_>], &mut [Fix]),
        workspace: &mut Workspace<D>,
    ) {
        self.locate_all(instants, out, fixes, workspace);
        for ((instant, out), fix) in instants.iter().zip(out).zip(fixes) {
            if !self.has_few(instant, D) {
                continue;
            }
            if let Some(own) = self.locate_mixed(instant, errors, out, workspace) {
                *fix = own;
            }
        }
    }

    /// Estimates the position of an instant with few redundant measurements from the distribution of the
    /// errors of its batch. Returns `None` if no set of wrong measurements gives a position. O(2^M M).
    fn locate_mixed<const D: usize>(
        &self,
        instant: &Instant<'_>,
        (mixture, free): (&Mixture, &[bool]),
        out: &mut Output<'_>,
        workspace: &mut Workspace<D>,
    ) -> Option<Fix> {
        let all = self.modes(instant, free, workspace);
        let (found, _) = mixture.weighed(&all);
        let mut terms: Vec<Normal<D>> = found
            .iter()
            .map(|(mode, judged)| Normal {
                weight: judged.ln,
                position: std::array::from_fn(|i| mode.position[i] + judged.step[i]),
                covariance: judged.covariance,
            })
            .collect();
        let best = (0..found.len()).max_by(|&a, &b| found[a].1.ln.total_cmp(&found[b].1.ln))?;
        let mode = found[best].0;
        let fix = self.with_wrong(instant, (mixture, &all, mode), &terms[best], out, workspace);
        if fix.status != Status::None {
            return Some(fix);
        }
        let origin = &instant.stations[..D];
        for i in 0..D {
            terms[best].position[i] = out.position[i] - origin[i];
            for j in 0..D {
                terms[best].covariance[i][j] = out.covariance[i * D + j];
            }
        }
        let covariance = spread(terms, best);
        out.covariance.copy_from_slice(covariance.as_flattened());
        for (i, place) in all.places.iter().enumerate() {
            let Some((_, place)) = *place else { continue };
            let wrong = found.iter().filter(|(mode, _)| is_in(mode.wrong, i));
            out.outlier[place] = wrong.map(|(_, own)| own.ln).sum::<f64>() > WRONG;
        }
        Some(fix)
    }

    /// Estimates the position for the wrong measurements of a mode, by least squares from a start near it.
    fn with_wrong<const D: usize>(
        &self,
        instant: &Instant<'_>,
        (mixture, all, mode): (&Mixture, &Modes<D>, &Mode<D>),
        near: &Normal<D>,
        out: &mut Output<'_>,
        workspace: &mut Workspace<D>,
    ) -> Fix {
        let (mut values, mut sigmas) = (instant.values.to_vec(), instant.sigmas.to_vec());
        let errors = || {
            let known = all.places.iter().enumerate();
            known.filter_map(|(i, place)| Some((place.as_ref()?.1, mixture.error(all, mode, i))))
        };
        for (place, (mean, variance)) in errors() {
            values[place] -= mean * sigmas[place];
            sigmas[place] *= variance.sqrt();
        }
        let initial: Vec<f64> = (0..D).map(|i| near.position[i] + instant.stations[i]).collect();
        let own = Instant { values: &values, sigmas: &sigmas, initial: Some(&initial), ..*instant };
        let fix = self.plain().trusting().locate(&own, out, workspace);
        for (place, (mean, variance)) in errors() {
            out.residual[place] = out.residual[place] * variance.sqrt() + mean;
        }
        let statistic = out.residual.iter().filter(|u| !u.is_nan()).map(|u| u * u).sum();
        let pvalue = chi_square_upper(statistic, fix.degrees_of_freedom.max(0) as usize);
        match fix.status {
            Status::None => Fix { statistic, pvalue, ..fix },
            _ => fix,
        }
    }
}

/// Returns the covariance whose 95 % ellipse about the best position contains 95 % of the mixture.
fn spread<const D: usize>(mut mixture: Vec<Normal<D>>, best: usize) -> Matrix<D> {
    let position = mixture[best].position;
    mixture.sort_by(|a, b| b.weight.total_cmp(&a.weight));
    mixture.retain(|own| own.weight > LEAST_WEIGHT);
    let (mut covariance, mut total) = ([[0.0; D]; D], 0.0);
    for own in &mixture {
        if total >= MOST {
            break;
        }
        total += own.weight;
        let away: Vector<D> = std::array::from_fn(|i| own.position[i] - position[i]);
        for i in 0..D {
            for j in 0..D {
                covariance[i][j] += own.weight * (own.covariance[i][j] + away[i] * away[j]);
            }
        }
    }
    let factor = growth(mixture.iter(), &position, &covariance);
    covariance.map(|row| row.map(|v| factor * v))
}
