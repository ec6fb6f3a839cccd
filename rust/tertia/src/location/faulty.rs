//! How many arrivals of a batch are wrong.
//!
//! One in a hundred is assumed where nothing tells. Where many are, some of those that agree do so by
//! chance: a fault costs less then, what is in doubt counts for more, and two positions that explain
//! the arrivals with one fault more or less cannot be told apart. So the share is that of the batch,
//! by rounds of location and counting; it is never below one in a hundred, with which healthy batches are
//! located as single instants are.

use super::fix::{Instant, Output, Status};
use super::solver::{Locator, Workspace};
use crate::base::angle::median;
use crate::sensors::{KINDS, Kind};

/// So many instants, evenly spread, tell enough of a batch.
const SAMPLE: usize = 256;
/// Rounds: each finds some of those that the one before has overlooked.
const ROUNDS: usize = 3;
/// The share where nothing tells, and the largest.
const FEW: f64 = 0.01;
const MOST: f64 = 0.4;
/// One-sided 99 % of a normal variable.
const SURELY: f64 = 2.326;

/// Instants with and without outliers.
#[derive(Default)]
struct Count {
    instants: f64,
    /// Instants with outliers, or with two positions that call others outliers.
    disturbed: f64,
    /// Those of them with a position.
    located: f64,
    /// Arrivals at each receiver, and outliers among them.
    arrivals: Vec<f64>,
    outliers: Vec<f64>,
}

/// Receivers of an emission, and which of their arrivals are outliers.
struct Heard {
    heard: Vec<bool>,
    wrong: Vec<bool>,
}

impl Locator {
    /// The same, with the share of outliers that the arrivals of these instants show, if it is more
    /// than one in a hundred. O(N M), for at most 256 instants.
    pub fn of_batch<const D: usize>(
        &self,
        instants: &[Instant<'_>],
        workspace: &mut Workspace<D>,
    ) -> Self {
        if !instants.iter().any(|instant| self.has_arrivals(instant)) {
            return *self;
        }
        let count = instants.len().min(SAMPLE);
        let sample: Vec<_> = (0..count).map(|i| instants[i * instants.len() / count]).collect();
        let mut odds = 1.0;
        for _ in 0..ROUNDS {
            let share = self.with_odds(odds).count(&sample, workspace).share();
            let next = share / (1.0 - share) * (1.0 - FEW) / FEW;
            if next <= odds {
                break;
            }
            odds = next;
        }
        self.with_odds(odds)
    }

    fn count<const D: usize>(&self, sample: &[Instant<'_>], workspace: &mut Workspace<D>) -> Count {
        let mut count = Count::default();
        let (mut position, mut covariance) = ([0.0; D], vec![0.0; D * D]);
        for instant in sample {
            let mut residual = vec![0.0; instant.values.len()];
            let mut outlier = vec![false; instant.values.len()];
            let mut out = Output {
                position: &mut position,
                covariance: &mut covariance,
                residual: &mut residual,
                outlier: &mut outlier,
            };
            let fix = self.locate(instant, &mut out, workspace);
            let known = matches!(fix.status, Status::None | Status::Ambiguous);
            if !known || fix.degrees_of_freedom < 1 {
                continue;
            }
            let Heard { heard, wrong } = self.heard(instant, &outlier);
            count.arrivals.resize(heard.len(), 0.0);
            count.outliers.resize(heard.len(), 0.0);
            for (receiver, (&heard, &wrong)) in heard.iter().zip(&wrong).enumerate() {
                count.arrivals[receiver] += f64::from(u8::from(heard));
                count.outliers[receiver] += f64::from(u8::from(wrong));
            }
            let with_outliers = wrong.contains(&true);
            let is_disturbed = with_outliers || fix.status == Status::Ambiguous;
            count.instants += 1.0;
            count.disturbed += f64::from(u8::from(is_disturbed));
            count.located += f64::from(u8::from(with_outliers));
        }
        count
    }

    /// Which receivers heard an emission, and which of their arrivals are outliers. Differences are
    /// those of arrivals: if all of them are outliers, that of the first receiver is one, and of the
    /// others nothing is known.
    fn heard(&self, instant: &Instant<'_>, outlier: &[bool]) -> Heard {
        let receivers = instant.values.len() / KINDS;
        let of = |kind: Kind| kind as usize * receivers..(kind as usize + 1) * receivers;
        let is_known = |v: &f64| !v.is_nan();
        let (arrivals, differences) = (of(Kind::Arrival), of(Kind::RangeDifference));
        let mut heard: Vec<bool> = instant.values[arrivals.clone()].iter().map(is_known).collect();
        let mut wrong = outlier[arrivals].to_vec();
        if instant.common(self.correlation).is_none() {
            return Heard { heard, wrong };
        }
        let known: Vec<bool> = instant.values[differences.clone()].iter().map(is_known).collect();
        let marks = &outlier[differences];
        if known.contains(&true) {
            let is_first = known.iter().zip(marks).all(|(&known, &mark)| mark || !known);
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
    /// The share of outliers of the receiver in the middle, as one that is always wrong says nothing of
    /// the others. Instants without a position have as many as the others with some.
    fn share(&self) -> f64 {
        let each = self.arrivals.iter().sum::<f64>() / self.instants;
        let expected = self.instants * (1.0 - (1.0 - FEW).powf(each));
        let surely = expected + SURELY * (expected + 1.0).sqrt();
        if self.instants == 0.0 || self.located == 0.0 || self.disturbed <= surely {
            return FEW;
        }
        let heard =
            self.outliers.iter().zip(&self.arrivals).filter(|(_, arrivals)| **arrivals > 0.0);
        let mut shares: Vec<f64> = heard.map(|(outliers, arrivals)| outliers / arrivals).collect();
        (median(&mut shares) * self.disturbed / self.located).clamp(FEW, MOST)
    }
}
