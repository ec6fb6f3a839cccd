//! Frequency of outliers in a batch.
//!
//! One outlier in a hundred measurements is assumed if nothing else is known. If there are many
//! outliers, some of the measurements that agree do so by chance. A fault then costs less, doubtful
//! measurements add more to the covariance, and two positions that explain the measurements with one
//! fault more or less cannot be told apart. Therefore, if more instants have outliers than this
//! assumption explains, the frequency and the size of outliers are estimated from the batch in rounds
//! of location and counting. Batches with few outliers are located as single instants are.

use crate::base::angle::median;
use crate::location::descent::lane::LANES;
use crate::location::descent::{FLAT, Loss, Outliers};
use crate::location::search::fix::{Fix, Instant, Solution, Status};
use crate::location::solver::{Locator, Workspace};
use crate::sensors::{KINDS, Kind};

/// Largest number of instants of a batch, evenly spread, that are located in each round.
const SAMPLE: usize = 256;
/// Largest number of rounds: each one finds some of the outliers that the previous one missed.
const ROUNDS: usize = 3;
/// Share of outliers that is assumed if nothing is known.
const FEW: f64 = 0.01;
/// Largest share of outliers.
const MOST: f64 = 0.4;
/// Quantile of the standard normal distribution for a one-sided test at 99 %.
const SURELY: f64 = 2.326;
/// Smallest mean size of faults, in σ: smaller ones cannot be told from noise.
const SHORTEST: f64 = 10.0;
/// Smallest share of faulty ranges that are too long, and likewise too short.
const RARE: f64 = 0.05;

/// Numbers of instants and measurements with and without outliers.
#[derive(Default)]
struct Count {
    /// Number of instants.
    instants: f64,
    /// Number of instants with outliers, or with two positions for which different measurements are
    /// outliers.
    disturbed: f64,
    /// Number of instants with outliers and a position.
    located: f64,
    /// Number of measurements of each kind at each station (arrivals at each receiver).
    measured: Vec<f64>,
    /// Number of outliers among them.
    outliers: Vec<f64>,
    /// By how much outliers other than arrivals exceed the limits beyond which they are marked, in σ.
    excesses: Vec<f64>,
    /// These limits, in σ.
    limits: Vec<f64>,
    /// Number of outliers among ranges.
    ranges: f64,
    /// Number of these that are too long.
    long: f64,
}

/// What was measured, and which measurements are outliers.
struct Heard {
    heard: Vec<bool>,
    wrong: Vec<bool>,
}

impl Locator {
    /// Returns this locator with the frequency of outliers in a batch, or `None` if not more than one
    /// measurement in a hundred is an outlier. Marks and fixes are those of a first location of the
    /// batch. O(M), and the location of at most 256 instants in each round.
    pub fn of_batch<const D: usize>(
        &self,
        instants: &[Instant<'_>],
        (marks, fixes): (&[bool], &[Fix]),
        workspace: &mut Workspace<D>,
    ) -> Option<Self> {
        if !marks.contains(&true) {
            return None;
        }
        let count = instants.len().min(SAMPLE);
        let width = marks.len() / instants.len();
        let mut seen = Count::default();
        let mut sample = Vec::with_capacity(count);
        for at in (0..count).map(|i| i * instants.len() / count) {
            let (instant, fix) = (&instants[at], &fixes[at]);
            if self.expects_outliers(instant, fix) {
                let marks = &marks[at * width..(at + 1) * width];
                seen.add(&self.heard(instant, marks), fix.status);
            }
            sample.push(*instant);
        }
        if !seen.is_many() {
            return None;
        }
        let mut outliers = Outliers::FEW;
        for _ in 0..ROUNDS {
            let next = self.with_outliers(outliers).count(&sample, workspace).all();
            if next.odds <= outliers.odds {
                break;
            }
            outliers = next;
        }
        (outliers != Outliers::FEW).then(|| self.with_outliers(outliers))
    }

    /// Whether outliers of an instant would be marked, and their frequency may be taken from the batch.
    /// Without arrivals, this requires that sigmas are known and not trusted: trusted sigmas hold for
    /// each instant on its own.
    fn expects_outliers(&self, instant: &Instant<'_>, fix: &Fix) -> bool {
        let has_arrivals = self.has_arrivals(instant);
        let redundancy = usize::try_from(fix.degrees_of_freedom).unwrap_or(0);
        let known = |(v, sigma): (&f64, &f64)| v.is_nan() || !sigma.is_nan();
        let says = || self.grows && instant.values.iter().zip(instant.sigmas).all(known);
        let located = fix.status == Status::None;
        match has_arrivals {
            true => redundancy > 0 && (located || fix.status == Status::Ambiguous),
            false => located && self.loss(redundancy, false) != Loss::SQUARE && says(),
        }
    }

    fn count<const D: usize>(&self, sample: &[Instant<'_>], workspace: &mut Workspace<D>) -> Count {
        let mut count = Count::default();
        for group in sample.chunk_by(|a, b| self.has_arrivals(a) == self.has_arrivals(b)) {
            // without arrivals, the better of two equally good positions is counted; with arrivals, the
            // worse one may be right, so the instant counts as ambiguous
            let timed = self.has_arrivals(&group[0]);
            let locator = if timed { *self } else { self.deciding().trusting() };
            for block in group.chunks(LANES) {
                let mut solutions: Vec<_> = block.iter().map(Solution::<D>::of).collect();
                let mut out: Vec<_> = solutions.iter_mut().map(Solution::output).collect();
                let mut fixes = vec![Fix::UNKNOWN; block.len()];
                locator.locate_all(block, &mut out, &mut fixes, workspace);
                for ((instant, own), fix) in block.iter().zip(&solutions).zip(&fixes) {
                    if !self.expects_outliers(instant, fix) {
                        continue;
                    }
                    count.add(&self.heard(instant, &own.outlier), fix.status);
                    if !timed {
                        let loss = self.loss(fix.degrees_of_freedom as usize, false);
                        count.add_sizes(&own.residual, &own.outlier, loss);
                    }
                }
            }
        }
        count
    }

    /// Returns what was measured, and which measurements are outliers. Range differences count as
    /// arrivals: if all of them are outliers, the arrival at the first receiver is the outlier, and
    /// nothing is known about the others.
    fn heard(&self, instant: &Instant<'_>, outlier: &[bool]) -> Heard {
        let is_known = |v: &f64| !v.is_nan();
        let mut heard: Vec<bool> = instant.values.iter().map(is_known).collect();
        let mut wrong = outlier.to_vec();
        if !self.has_arrivals(instant) {
            return Heard { heard, wrong };
        }
        let receivers = instant.values.len() / KINDS;
        let of = |kind: Kind| kind as usize * receivers..(kind as usize + 1) * receivers;
        let (arrivals, differences) = (of(Kind::Arrival), of(Kind::RangeDifference));
        let known: Vec<bool> = heard[differences.clone()].to_vec();
        // other kinds do not count
        heard[..arrivals.start].fill(false);
        wrong[..arrivals.start].fill(false);
        if instant.common(self.correlation).is_none() {
            return Heard { heard, wrong };
        }
        let marks = &outlier[differences];
        if known.contains(&true) {
            let is_first = known.iter().zip(marks).all(|(&known, &mark)| mark || !known);
            let (heard, wrong) = (&mut heard[arrivals.clone()], &mut wrong[arrivals]);
            (heard[0], wrong[0]) = (true, wrong[0] || is_first);
            for (receiver, (known, mark)) in known.into_iter().zip(marks).enumerate() {
                heard[receiver] |= known && !is_first;
                wrong[receiver] |= *mark && !is_first;
            }
        }
        Heard { heard, wrong }
    }
}

impl Count {
    fn add(&mut self, instant: &Heard, status: Status) {
        let Heard { heard, wrong } = instant;
        self.measured.resize(heard.len(), 0.0);
        self.outliers.resize(heard.len(), 0.0);
        for (place, (&heard, &wrong)) in heard.iter().zip(wrong).enumerate() {
            self.measured[place] += f64::from(u8::from(heard));
            self.outliers[place] += f64::from(u8::from(wrong));
        }
        self.instants += 1.0;
        let with_outliers = wrong.contains(&true);
        let is_disturbed = with_outliers || status == Status::Ambiguous;
        self.disturbed += f64::from(u8::from(is_disturbed));
        self.located += f64::from(u8::from(with_outliers));
    }

    fn add_sizes(&mut self, residual: &[f64], outlier: &[bool], loss: Loss) {
        let stations = residual.len() / KINDS;
        let marked = residual.iter().zip(outlier).enumerate().filter(|(_, (_, mark))| **mark);
        for (place, (&residual, _)) in marked {
            let kind = Kind::ALL[place / stations];
            let limit = loss.of(kind).limit(residual);
            self.excesses.push((residual.abs() - limit).max(0.0));
            self.limits.push(limit);
            if kind == Kind::Range {
                self.ranges += 1.0;
                self.long += f64::from(u8::from(residual > 0.0));
            }
        }
    }

    /// Whether outliers are more frequent than one in a hundred.
    fn is_many(&self) -> bool {
        let each = self.measured.iter().sum::<f64>() / self.instants;
        let expected = self.instants * (1.0 - (1.0 - FEW).powf(each));
        self.located > 0.0 && self.disturbed > expected + SURELY * (expected + 1.0).sqrt()
    }

    /// Estimates the frequency of outliers. Without arrivals, it includes outliers that are too small
    /// to be marked, whose sizes are assumed to be exponentially distributed.
    fn all(&mut self) -> Outliers {
        if !self.is_many() {
            return Outliers::FEW;
        }
        let marked = self.share();
        if marked <= FEW {
            return Outliers::FEW;
        }
        let (mut mean, mut share) = (FLAT, marked);
        if !self.excesses.is_empty() {
            let excess = median(&mut self.excesses);
            mean = (excess / std::f64::consts::LN_2).clamp(SHORTEST, FLAT);
            share *= (median(&mut self.limits) / mean).exp();
        }
        let share = share.min(MOST);
        let odds = share / (1.0 - share) * (1.0 - FEW) / FEW * FLAT / mean;
        let late = ((self.long + 1.0) / (self.ranges + 2.0)).clamp(RARE, 1.0 - RARE);
        Outliers { odds, late }
    }

    /// Returns the share of outliers: the median over the measurements, because a station that is
    /// always wrong says nothing about the others. Instants without a position are assumed to have as
    /// many outliers as the instants with outliers.
    fn share(&self) -> f64 {
        let known = self.outliers.iter().zip(&self.measured).filter(|(_, count)| **count > 0.0);
        let mut shares: Vec<f64> = known.map(|(outliers, count)| outliers / count).collect();
        median(&mut shares) * self.disturbed / self.located
    }
}
