//! Systematic errors of radars from a whole recording.

use super::block::{Known, Unknowns};
use super::clusters::Clusters;
use super::gaussian::{excess, scaled};
use super::history::{Course, History, Said};
use super::noise::stretch_of;
use super::sighting::{AZIMUTH, ERRORS, Errors, KINDS};
use super::sums::Sums;
use super::targets::{TargetPlot, Ways, for_each, numbered, scans};
use crate::base::interrupt::poll;
use crate::sensors::Radar;
use nalgebra::{DMatrix, DVector};

/// Number of redundant measurements that the stated noise is worth.
pub(super) const STATED: f64 = 10.0;
const ROUNDS: usize = 4;
/// Least standard deviations of the coefficients of a deviation of the azimuth, if there is one, rad; those of
/// twice the azimuth are half as large.
const DEVIATION: f64 = 1e-3;
/// Standard deviations by which azimuth errors must differ between targets.
const DIFFERENT: f64 = 3.0;
/// Sudden changes that the first round allows for, in standard deviations of the prior.
const FIRST: f64 = 10.0;

/// Estimated errors of radars.
#[derive(Clone, Debug, PartialEq)]
pub struct Registered {
    /// The errors of each radar in each period.
    pub errors: Vec<Vec<Errors>>,
    /// Standard deviations of the errors.
    pub sigmas: Vec<Vec<Errors>>,
    /// Covariance of the errors of the last period, (8 K, 8 K).
    pub covariance: DMatrix<f64>,
    /// First period after each sudden change, in order of time, and the radar.
    pub changes: Vec<(usize, usize)>,
    /// Estimated over stated noise of each radar, in range and azimuth.
    pub factor: Vec<[f64; 2]>,
    /// Number of redundant measurements from which these factors are estimated.
    pub redundancy: Vec<[f64; 2]>,
    /// Variances by which errors of a radar differ between targets.
    apart: Vec<Errors>,
    /// Number of blocks of several radars that were used, and of those that fit no motion.
    pub blocks: [usize; 2],
}

/// Prior of the errors of radars for a recording.
#[derive(Clone, Copy, Debug)]
pub struct Prior<'a> {
    /// Means.
    pub mean: &'a [Errors],
    /// Standard deviations; 0 for the errors of a trusted radar.
    pub sigma: &'a [Errors],
    /// Rates at which the errors drift back to the means, 1/s; 0: constant.
    pub rate: &'a [Errors],
}

/// Periods of a recording in which errors are constant.
#[derive(Clone, Copy, Debug)]
pub struct Periods<'a> {
    /// Beginnings of the periods, and end of the last one, s.
    pub edges: &'a [f64],
    /// Errors in each period from which the search starts.
    pub start: &'a [Vec<Errors>],
}

/// Estimates the errors of radars from blocks of plots of one target. If the azimuth errors of targets differ,
/// deviations with the azimuth are estimated, too. Ranges of a radar may be `slant` if no height is known. Errors that
/// no block depends on keep their prior. If errors of one kind are clearly larger than their prior, those that cannot
/// be observed are so, too: the prior is as large as the errors found, and they are estimated again. Cost O(N log N + N
/// K² + T K³) for N plots and T periods.
///
/// # Panics
/// If there is no period, the radar of a plot does not exist, or the lengths differ.
pub fn register(
    plots: &[TargetPlot],
    radars: &[Radar],
    slant: &[bool],
    prior: Prior<'_>,
    periods: Periods<'_>,
) -> Registered {
    let mut found = estimate(plots, (radars, slant), prior, periods, &[]);
    let deviating = deviating(&found, prior);
    let prior = Prior { sigma: deviating.as_deref().unwrap_or(prior.sigma), ..prior };
    if deviating.is_some() {
        found = estimate(plots, (radars, slant), prior, periods, &[]);
    }
    match exceeded(&found, prior) {
        Some(sigma) => {
            let prior = Prior { sigma: &sigma, ..prior };
            estimate(plots, (radars, slant), prior, periods, &found.changes)
        }
        None => found,
    }
}

/// Returns standard deviations of the prior with those of deviations, if azimuth errors of targets differ.
fn deviating(found: &Registered, prior: Prior<'_>) -> Option<Vec<Errors>> {
    let mut sigma = prior.sigma.to_vec();
    for (own, apart) in sigma.iter_mut().zip(&found.apart).filter(|(_, apart)| apart[AZIMUTH] > 0.0)
    {
        own[KINDS..].copy_from_slice(&of_deviation(apart[AZIMUTH].sqrt()));
    }
    (sigma != prior.sigma).then_some(sigma)
}

/// Returns standard deviations of the coefficients of a deviation, if azimuth errors of targets differ so much.
pub(super) fn of_deviation(apart: f64) -> [f64; ERRORS - KINDS] {
    let first = DEVIATION.max(apart);
    [first, first, 0.5 * first, 0.5 * first]
}

/// Returns standard deviations of the prior as large as the errors, if these are clearly larger.
fn exceeded(found: &Registered, prior: Prior<'_>) -> Option<Vec<Errors>> {
    let mut sigma = prior.sigma.to_vec();
    for j in 0..KINDS {
        let mut factor: f64 = 1.0;
        for (errors, sigmas) in found.errors.iter().zip(&found.sigmas) {
            let (mut squares, mut expected) = (0.0, 0.0);
            for (k, own) in prior.sigma.iter().enumerate().filter(|(_, own)| own[j] > 0.0) {
                squares += ((errors[k][j] - prior.mean[k][j]) / own[j]).powi(2);
                expected += 1.0 - (sigmas[k][j] / own[j]).powi(2).min(1.0);
            }
            factor = factor.max(excess(squares, expected).sqrt());
        }
        sigma.iter_mut().for_each(|own| own[j] *= factor);
    }
    (sigma != prior.sigma).then_some(sigma)
}

fn estimate(
    plots: &[TargetPlot],
    (radars, slant): (&[Radar], &[bool]),
    prior: Prior<'_>,
    Periods { edges, start }: Periods<'_>,
    changes: &[(usize, usize)],
) -> Registered {
    assert_eq!(start.len() + 1, edges.len());
    assert!(!start.is_empty() && start.iter().all(|own| own.len() == radars.len()));
    let lengths = [prior.mean.len(), prior.sigma.len(), prior.rate.len(), slant.len()];
    assert_eq!(lengths, [radars.len(); 4]);
    let unknowns = numbered(prior.sigma);
    let order = unknowns.iter().flatten().flatten().count();
    let middles: Vec<f64> = edges.windows(2).map(|own| f64::midpoint(own[0], own[1])).collect();
    let (mut rates, mut own) = (vec![0.0; order], vec![Vec::new(); radars.len()]);
    for_each(&unknowns, |k, j, column, _| {
        rates[column] = prior.rate[k][j];
        own[k].push(column);
    });
    let course = Course { middles: &middles, rates: &rates, own: &own, changes };
    let (ways, blocks) = (Ways { radars, slant }, windows(plots, radars));
    let blocks: Vec<(usize, &[TargetPlot])> =
        blocks.iter().map(|block| (stretch_of(middle_of(block), edges), &block[..])).collect();
    let mut known = Rounds::new(start, order);
    for _ in 0..ROUNDS {
        known.improve(&blocks, &ways, (&unknowns, prior.mean), &course);
    }
    let covariances = known.of_targets();
    let Rounds { errors, changes, factor, sums, apart, .. } = known;
    let (redundancy, blocks) =
        sums.map_or_else(Default::default, |own| (own.redundancy, own.blocks));
    Registered {
        sigmas: covariances.iter().map(|own| sigmas(own, &unknowns)).collect(),
        covariance: spread(&covariances[errors.len() - 1], &unknowns),
        errors,
        apart: variances(&DMatrix::from_diagonal(&apart), &unknowns),
        changes: separate(changes),
        factor,
        redundancy,
        blocks,
    }
}

/// Estimates after some rounds.
struct Rounds {
    /// Errors of each period, and their covariance in units of the prior.
    errors: Vec<Vec<Errors>>,
    covariances: Vec<DMatrix<f64>>,
    changes: Vec<(usize, usize)>,
    factor: Vec<[f64; 2]>,
    /// Factor by which blocks overstate what is known, as errors of targets last.
    excess: f64,
    /// Variances by which errors differ between targets, in units of the prior.
    apart: DVector<f64>,
    /// Sums of the last round; none before the first one.
    sums: Option<Sums>,
}

impl Rounds {
    fn new(start: &[Vec<Errors>], order: usize) -> Self {
        let radars = start[0].len();
        // in the first round, blocks that show sudden changes are used as well
        let wide = DMatrix::from_diagonal_element(order, order, FIRST * FIRST);
        Self {
            errors: start.to_vec(),
            covariances: vec![wide; start.len()],
            changes: Vec::new(),
            factor: vec![[1.0; 2]; radars],
            excess: 1.0,
            apart: DVector::zeros(order),
            sums: None,
        }
    }

    /// Sums up all blocks, corrected for the present errors, and estimates the errors from them.
    fn improve(
        &mut self,
        blocks: &[(usize, &[TargetPlot])],
        ways: &Ways<'_>,
        (unknowns, mean): (&Unknowns, &[Errors]),
        course: &Course<'_>,
    ) {
        let (radars, order) = (ways.radars.len(), course.rates.len());
        let mut sums = vec![Sums::new(order, radars); self.errors.len()];
        let covariances = self.of_targets();
        let mut known: Vec<Known<'_>> = covariances.iter().map(Known::new).collect();
        let noise: Vec<_> = self.factor.iter().map(|own| believed(*own, self.excess)).collect();
        let (mut clusters, still) = (Clusters::default(), DVector::zeros(order));
        for (t, block) in blocks {
            poll();
            let errors = &self.errors[*t];
            sums[*t].add(block, ways, unknowns, errors, &noise, &mut known[*t]);
            clusters.add(&std::mem::take(&mut sums[*t].parts), &still, middle_of(block));
        }
        // in the first round, errors are not yet removed
        if self.sums.is_some() {
            self.widen(&clusters);
        }
        let total = Sums::total(&sums, radars);
        let said: Vec<Said> = sums
            .into_iter()
            .zip(&self.errors)
            .map(|(sums, errors)| sums.said(errors, unknowns, mean).divided(self.excess))
            .collect();
        let History { known, changes } = History::new(&said, course);
        for (own, (value, _)) in self.errors.iter_mut().zip(&known) {
            for_each(unknowns, |k, j, column, sigma| {
                own[k][j] = mean[k][j] + value[column] * sigma
            });
        }
        self.covariances = known.into_iter().map(|(_, covariance)| covariance).collect();
        self.changes = changes;
        for (k, own) in self.factor.iter_mut().enumerate() {
            for (axis, own) in own.iter_mut().enumerate() {
                let found = factor(total.square[k][axis], total.redundancy[k][axis]);
                *own = noise[k][axis] * found;
            }
        }
        self.sums = Some(total);
    }

    /// Compares the blocks of each target with what they state together, and with those of other targets.
    fn widen(&mut self, clusters: &Clusters) {
        let mean = self.covariances.iter().sum::<DMatrix<f64>>() / self.covariances.len() as f64;
        if let Some(stated) = scaled(&mean, self.excess) {
            self.apart = clusters.apart(&stated, DIFFERENT);
            self.excess = clusters.excess(&stated).unwrap_or(self.excess);
        }
    }

    /// Returns the covariances of the errors at a target instead of their means over all targets.
    fn of_targets(&self) -> Vec<DMatrix<f64>> {
        let apart = DMatrix::from_diagonal(&self.apart);
        self.covariances.iter().map(|own| own + &apart).collect()
    }
}

/// Returns the middle of the times of the plots of a block.
fn middle_of(block: &[TargetPlot]) -> f64 {
    f64::midpoint(block[0].report.time, block[block.len() - 1].report.time)
}

/// Estimated over stated noise, from the squares of residuals and their redundancy.
pub(super) fn factor(squares: f64, redundancy: f64) -> f64 {
    ((squares + STATED) / (redundancy + STATED)).sqrt()
}

/// Returns estimated over stated noise as far as it is believed. If errors of targets last, by this excess,
/// noise within a block is only a part of what is stated.
pub(super) fn believed(factor: [f64; 2], excess: f64) -> [f64; 2] {
    factor.map(|own| if excess > 1.0 { own.max(1.0) } else { own })
}

/// Divides the plots of each target, in order of time, into blocks.
fn windows(plots: &[TargetPlot], radars: &[Radar]) -> Vec<Vec<TargetPlot>> {
    let longest = scans(radars);
    let mut sorted = plots.to_vec();
    sorted.sort_by(|a, b| {
        (a.target.cmp(&b.target))
            .then(a.report.time.total_cmp(&b.report.time))
            .then(a.report.radar.cmp(&b.report.radar))
    });
    let mut blocks: Vec<Vec<TargetPlot>> = Vec::new();
    for plot in sorted {
        match blocks.last_mut() {
            Some(block)
                if block[0].target == plot.target
                    && plot.report.time - block[0].report.time <= longest =>
            {
                block.push(plot);
            }
            _ => blocks.push(vec![plot]),
        }
    }
    blocks
}

/// Returns the changes in order of time. Changes of a radar in successive periods are a single change, which
/// is in the middle of a period.
fn separate(mut changes: Vec<(usize, usize)>) -> Vec<(usize, usize)> {
    changes.sort_unstable();
    let all = changes.clone();
    changes.retain(|(t, k)| !all.iter().any(|(other, own)| own == k && other + 1 == *t));
    changes
}

/// Returns the covariance of the errors of all radars in their units.
fn spread(covariance: &DMatrix<f64>, unknowns: &Unknowns) -> DMatrix<f64> {
    let all: Vec<Option<(usize, f64)>> = unknowns.iter().flatten().copied().collect();
    DMatrix::from_fn(all.len(), all.len(), |i, j| match (all[i], all[j]) {
        (Some((row, own)), Some((column, other))) => own * other * covariance[(row, column)],
        _ => 0.0,
    })
}

/// Returns the variances of the errors of each radar.
fn variances(covariance: &DMatrix<f64>, unknowns: &Unknowns) -> Vec<Errors> {
    let mut found = vec![[0.0; ERRORS]; unknowns.len()];
    for_each(unknowns, |k, j, column, sigma| {
        found[k][j] = covariance[(column, column)].max(0.0) * sigma * sigma;
    });
    found
}

/// Returns their standard deviations.
fn sigmas(covariance: &DMatrix<f64>, unknowns: &Unknowns) -> Vec<Errors> {
    variances(covariance, unknowns).into_iter().map(|own| own.map(f64::sqrt)).collect()
}

#[cfg(test)]
mod tests;
