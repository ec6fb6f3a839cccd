//! Deviations of azimuths with the direction, once targets show that there are any.

use super::Registrar;
use crate::registration::block::{Unknown, Unknowns};
use crate::registration::gaussian::scaled;
use crate::registration::recording::of_deviation;
use crate::registration::sighting::{AZIMUTH, CLOCK, ERRORS, Errors, KINDS};
use crate::registration::targets::for_each;
use nalgebra::{DMatrix, DVector};

/// Time between searches for deviations, s.
const LOOK: f64 = 30.0;
/// Standard deviations by which azimuth errors must differ between targets, which are compared again and again;
/// and those for differences beside the deviations, once these are estimated.
const DIFFERENT: f64 = 5.0;
const BESIDE: f64 = 3.0;
/// Ratio of the noise that a tracker has found for errors that last to the noise of blocks, from which on errors of
/// targets differ because they last for some scans.
const LASTING: f64 = 1.2;
/// Number of redundant measurements of a radar, on average, from which its noise is known.
const ENOUGH: f64 = 50.0;
/// Least standard deviation between targets, over that of the noise of azimuths: turns and other motions of which
/// blocks are not aware cause smaller differences.
const LEAST: f64 = 0.2;

impl Registrar {
    /// Starts from errors that are already known, with their covariance: (8 K, 8 K), or (4 K, 4 K) if no azimuth
    /// deviates.
    ///
    /// # Panics
    /// If the lengths differ.
    pub fn know(&mut self, errors: &[Errors], covariance: &[f64]) {
        let radars = self.radars.len();
        let kinds = if covariance.len() == (ERRORS * radars).pow(2) { ERRORS } else { KINDS };
        let order = kinds * radars;
        assert_eq!([errors.len(), covariance.len()], [radars, order * order]);
        if kinds == ERRORS {
            self.allow_deviations(|k| {
                let variance = |j: usize| covariance[(order + 1) * (ERRORS * k + j)];
                let size = |j: usize| errors[k][j].abs().max(variance(j).sqrt());
                (variance(KINDS) > 0.0).then(|| (KINDS..ERRORS).map(size).fold(0.0, f64::max))
            });
        }
        let unknowns = self.unknowns();
        for_each(&unknowns, |k, j, row, sigma| {
            self.known.mean[row] = (errors[k][j] - self.start[k][j]) / sigma;
            for_each(&unknowns, |l, i, column, other| {
                if j < kinds && i < kinds {
                    let place = order * (kinds * k + j) + kinds * l + i;
                    self.known.covariance[(row, column)] = covariance[place] / (sigma * other);
                }
            });
        });
        for (clock, own) in self.clocks.iter_mut().zip(errors) {
            *clock = own[CLOCK];
        }
    }

    /// Begins with unknown deviations of the azimuths where a later registrar has found them; returns whether there
    /// are any that were not unknown before.
    ///
    /// # Panics
    /// If the numbers of radars differ.
    pub fn expect(&mut self, later: &Self) -> bool {
        assert_eq!(self.radars.len(), later.radars.len());
        let is_new = later.deviates() && !self.deviates();
        if is_new {
            let found = |k: usize| later.sigma[k][KINDS];
            self.allow_deviations(|k| (found(k) > 0.0).then(|| found(k)));
        }
        is_new
    }

    /// Compares the azimuth errors of targets. If they differ, deviations are estimated from now on; what the
    /// blocks so far say of the errors is forgotten, as it was learnt without deviations. `used` is the noise of the
    /// tracker, as for [`Registrar::learn`].
    pub(super) fn deviate(&mut self, used: &[[[f64; 2]; 2]], time: f64) {
        if time < self.looked + LOOK {
            return;
        }
        self.looked = time;
        if !self.knows_noise {
            self.compare_from_now();
            return;
        }
        let lasts = |k: usize| used[k][1][1] > LASTING * self.own_noise(k)[1];
        if (0..used.len()).any(lasts) {
            self.forget_deviations();
            return;
        }
        let Some(stated) = scaled(&self.known.covariance, self.excess) else { return };
        if self.deviates() {
            self.apart = self.clusters.apart(&stated, BESIDE);
            return;
        }
        let sizes = self.sizes(&self.clusters.apart(&stated, DIFFERENT));
        if sizes.iter().sum::<f64>() > LEAST * self.noise_of(&sizes) {
            self.allow_deviations(|k| (sizes[k] > 0.0).then(|| sizes[k]));
            let order = self.known.mean.len();
            self.known.covariance = DMatrix::identity(order, order);
            self.excess = 1.0;
            self.clusters.clear();
            self.recent.clear();
        }
    }

    /// Compares targets from now on if the noise of azimuths is known: if it is larger than stated, the errors in
    /// the blocks so far seem to differ.
    fn compare_from_now(&mut self) {
        let known: f64 = self.redundancy.iter().map(|[_, azimuth]| azimuth).sum();
        if known > ENOUGH * self.radars.len() as f64 {
            self.knows_noise = true;
            self.clusters.clear();
        }
    }

    /// Returns the standard deviations between targets of the azimuth errors of each radar, rad.
    fn sizes(&self, apart: &DVector<f64>) -> Vec<f64> {
        let size = |own: &Unknown| {
            own[AZIMUTH].map_or(0.0, |(column, sigma)| sigma * apart[column].sqrt())
        };
        self.unknowns().iter().map(size).collect()
    }

    /// Returns the sum of the azimuth noise of the radars whose azimuth errors differ, rad.
    fn noise_of(&self, sizes: &[f64]) -> f64 {
        let differs = |k: &usize| sizes[*k] > 0.0;
        (0..sizes.len()).filter(differs).map(|k| self.own_noise(k)[1]).sum()
    }

    /// Returns a covariance of the errors, in units of the prior, at a target instead of the mean over all targets.
    pub(super) fn of_target(&self, mut covariance: DMatrix<f64>) -> DMatrix<f64> {
        for (column, variance) in self.apart.iter().enumerate() {
            covariance[(column, column)] += variance;
        }
        covariance
    }

    /// Whether deviations are estimated.
    fn deviates(&self) -> bool {
        self.sigma.iter().any(|own| own[KINDS] > 0.0)
    }

    /// Adds the deviation to the unknown errors of radars for which `size` gives its standard deviation.
    fn allow_deviations(&mut self, size: impl Fn(usize) -> Option<f64>) {
        let before = self.unknowns();
        for (k, size) in (0..before.len()).filter_map(|k| Some((k, size(k)?))) {
            self.sigma[k][KINDS..].copy_from_slice(&of_deviation(size));
        }
        self.renumber(&before);
    }

    /// Removes all deviations from the unknown errors.
    fn forget_deviations(&mut self) {
        if self.deviates() {
            let before = self.unknowns();
            self.sigma.iter_mut().for_each(|own| own[KINDS..].fill(0.0));
            self.renumber(&before);
            self.apart = DVector::zeros(0);
            self.clusters.clear();
            self.recent.clear();
        }
    }

    /// Rearranges what is known of the errors, which had these numbers before.
    fn renumber(&mut self, before: &Unknowns) {
        let (mut places, mut rates) = (Vec::new(), Vec::new());
        for_each(&self.unknowns(), |k, j, _, _| {
            let [own, azimuth] = [j, AZIMUTH].map(|j| before[k][j].map(|(column, _)| column));
            places.push(own);
            // a deviation drifts as the azimuth error does
            rates.push(own.or(azimuth).map_or(0.0, |column| self.known.rate(column)));
        });
        self.known.rearrange(&places, rates);
    }
}
