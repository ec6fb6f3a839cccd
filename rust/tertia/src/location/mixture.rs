//! Outliers among so few redundant measurements that robust fits do not find them.
//!
//! With one or two degrees of freedom, a robust fit cannot tell which measurement is wrong, and least
//! squares spread its error over the position. In a batch it can be told how frequent and how large
//! such errors are: a measurement has normal noise of variance φ or, with probability ε, an error of mean μ
//! and variance s² besides (in units of its variance). Each set of wrong measurements has its own
//! positions ([`modes`](super::modes)), each with a restricted likelihood (Patterson, Thompson 1971).
//! ε, φ, μ and s come from rounds of expectation and maximisation (Dempster, Laird, Rubin 1977). The
//! likeliest position counts, and the ellipse of 95 % holds 95 % of the mixture of all of them.

use super::contradiction::{Contradiction, SAMPLE};
use super::fix::{Fix, Instant, Output, Status};
use super::growth::growth_of_all;
use super::modes::{Mode, Modes, is_in};
use super::normals::{Normal, growth};
use super::solver::{Locator, Workspace};
use crate::base::distribution::chi_square_upper;
use crate::base::small::{Factor, Matrix, Vector, dot, quadratic};
use crate::sensors::KINDS;

/// Where rounds begin: share of wrong measurements, variance of their errors.
const FIRST: (f64, f64) = (0.05, 400.0);
const ROUNDS: usize = 10;
/// Least and largest share.
const SHARES: (f64, f64) = (0.003, 0.45);
/// Least variance of errors: smaller ones are noise.
const LEAST: f64 = 25.0;
/// ln of the likelihood ratio, to noise that is larger than stated, from which on measurements are wrong.
const CLEARLY: f64 = 10.0;
/// What of the mixture gives the ellipse its shape.
const MOST: f64 = 0.97;
/// Positions of less probability do not count.
const LEAST_WEIGHT: f64 = 1e-3;
/// Probability from which on a measurement is an outlier.
const WRONG: f64 = 0.5;

/// Errors of the measurements of a batch, in units of the stated sigmas.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mixture {
    /// Share of wrong measurements.
    share: f64,
    /// Variance of the noise of each kind.
    noise: [f64; KINDS],
    /// Mean and variance of what is wrong.
    mean: [f64; KINDS],
    variance: [f64; KINDS],
}

/// A position after a step to the minimum of its likelihood.
struct Judged<const D: usize> {
    ln: f64,
    step: Vector<D>,
    covariance: Matrix<D>,
}

/// What a round adds up.
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

    /// The same in units of sigmas that are larger by the roots of these factors.
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

    /// What the noise of all is, if it is all that an instant is given.
    fn contradiction(&self, other: &Contradiction) -> Contradiction {
        Contradiction { growth: self.noise, factor: self.noise, common: [0.0; KINDS], ..*other }
    }

    /// Mean and variance of the error of a measurement.
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

    /// Positions that count, with ln of their likelihoods turned into probabilities, and ln of their sum.
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

    /// A round of expectation.
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
                // of the error a share is what is wrong
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
    /// What is likeliest with these probabilities.
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
    /// How a batch contradicts its sigmas, and the errors of what has few redundant measurements, if
    /// some are wrong: then what has more of them tells of the sigmas, if there is any.
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

    /// The errors of a batch that contradicts its sigmas, if wrong measurements explain it better than
    /// noise that is larger than stated, among instants with few redundant measurements. O(2^M M), for
    /// at most 256 instants.
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

    /// [`Locator::locate_all`], of a batch in which few redundant measurements have such errors.
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

    /// Estimates the position of an instant with few redundant measurements, of a batch with such errors.
    /// None if it has no position with any of them. O(2^M M).
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

    /// The position by least squares near another one, with a set of wrong measurements.
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

/// The covariance about the best position, with an ellipse of 95 % that holds 95 % of the mixture.
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
