//! Fusion of the estimates of one vector at one instant by several sensors.

use super::effects::Effects;
use super::fused::{Agreement, Estimates, FusedEstimate, Weighting};
use super::independent::Independent;
use super::intersection::Intersection;
use super::joint::{Joint, vector};
use super::rules::shares;
use super::scalar::{Addition, Scalar};
use crate::base::angle::{nearest, principal};
use crate::base::distribution::chi_square_upper;
use crate::base::error::{Error, Result};
use crate::base::matrix::{
    ASYMMETRY, Square, assembled, is_large_semidefinite, read_covariance, symmetrise, with_order,
    write, zeros,
};
use crate::weights::COVARIANCES;
use nalgebra::allocator::Allocator;
use nalgebra::{DefaultAllocator, Dim, OVector, U1};

const CROSS: &str = "cross_covariances";
/// Largest estimate; squares of larger differences overflow.
const LARGEST: f64 = 1e150;

/// The fusion of K estimates of m components, with buffers that are reused from call to call.
pub trait Fusing: Send {
    /// Fuses estimates. Cost O(K m³); with cross covariances O(K³ m³); covariance intersection
    /// O(K m³ + K² m² + K³) for each of about ten steps. Panics if a slice has a wrong length.
    ///
    /// # Errors
    /// An estimate with some nan components but not all, an invalid covariance, or covariances whose
    /// combination is singular although its inverse is required.
    fn fuse(&mut self, estimates: &Estimates<'_>, out: &mut FusedEstimate<'_>)
    -> Result<Agreement>;

    /// Adds a scalar measurement to an estimate, with any weighting. Cost O(m³).
    ///
    /// # Errors
    /// An invalid covariance, or an estimate that is not finite or is too large.
    fn fuse_scalar(
        &mut self,
        scalar: &Scalar<'_>,
        out: &mut FusedEstimate<'_>,
    ) -> Result<Agreement>;
}

/// Returns the fusion of estimates with this many components from this many sensors. If there is a
/// period, the first component is an angle.
///
/// # Panics
/// If there is no sensor or no component.
pub fn fusing(
    sensors: usize,
    dimension: usize,
    weighting: Weighting,
    period: Option<f64>,
) -> Box<dyn Fusing> {
    assert!(sensors >= 1 && dimension >= 1, "{sensors} sensors, {dimension} dimensions");
    with_order!(dimension, |order| Box::new(Solver::new(sensors, order, weighting, period)))
}

struct Solver<D: Dim>
where
    DefaultAllocator: Allocator<D, D> + Allocator<D>,
{
    order: D,
    sensors: usize,
    weighting: Weighting,
    period: Option<f64>,
    /// Sensors that have an estimate. The following fields contain only these sensors, in this order.
    present: Vec<usize>,
    covariances: Vec<Square<D>>,
    /// cov(x_j, x_l), row by row; empty for independent errors.
    blocks: Vec<Square<D>>,
    /// Y_k (K, m) for the weights of the paper.
    corrections: Vec<f64>,
    /// Estimates minus `origin`; differences of angles are wrapped.
    relative: Vec<f64>,
    origin: OVector<f64, D>,
    weight: Vec<Square<D>>,
    fused: Square<D>,
    // created at the first use
    independent: Option<Independent<D>>,
    joint: Option<Joint<D>>,
    effects: Option<Effects<D>>,
    intersection: Option<Intersection<D>>,
    addition: Option<Addition<D>>,
}

impl<D: Dim> Fusing for Solver<D>
where
    DefaultAllocator: Allocator<D, D> + Allocator<D>,
    Square<D>: Send,
    OVector<f64, D>: Send,
{
    fn fuse(
        &mut self,
        estimates: &Estimates<'_>,
        out: &mut FusedEstimate<'_>,
    ) -> Result<Agreement> {
        self.read(estimates)?;
        out.weights.fill(0.0);
        out.bias_sigma.fill(0.0);
        let present = self.present.len();
        if present == 0 {
            self.write_unknown(out);
            return Ok(Agreement::UNKNOWN);
        }
        self.set_relative(estimates.values);
        let statistic = self.weigh()?;
        self.write(out);
        if let (Some(effects), true) = (&self.effects, present > 1) {
            out.bias_sigma.copy_from_slice(effects.bias_sigma.as_slice());
        }
        let degrees_of_freedom = (present - 1) * self.order.value();
        let pvalue = if statistic.is_nan() {
            f64::NAN
        } else {
            chi_square_upper(statistic, degrees_of_freedom)
        };
        Ok(Agreement { statistic, degrees_of_freedom, pvalue })
    }

    fn fuse_scalar(
        &mut self,
        scalar: &Scalar<'_>,
        out: &mut FusedEstimate<'_>,
    ) -> Result<Agreement> {
        require_estimates("estimate", scalar.estimate, |i| vec![i])?;
        let mut factor = zeros(self.order);
        read_covariance("covariance", &[], scalar.covariance, &mut self.fused, &mut factor)?;
        let addition = self.addition.get_or_insert_with(|| Addition::new(self.order));
        let (statistic, pvalue) = addition.add(&self.fused, scalar);
        out.mean.copy_from_slice(addition.mean.as_slice());
        out.weights.copy_from_slice(addition.gain.as_slice());
        out.bias_sigma.fill(0.0);
        write(&addition.covariance, out.covariance);
        Ok(Agreement { statistic, degrees_of_freedom: 1, pvalue })
    }
}

impl<D: Dim> Solver<D>
where
    DefaultAllocator: Allocator<D, D> + Allocator<D>,
{
    fn new(sensors: usize, order: D, weighting: Weighting, period: Option<f64>) -> Self {
        Self {
            order,
            sensors,
            weighting,
            period,
            present: Vec::with_capacity(sensors),
            covariances: Vec::with_capacity(sensors),
            blocks: Vec::new(),
            corrections: Vec::new(),
            relative: Vec::new(),
            origin: vector(order),
            weight: vec![zeros(order); sensors],
            fused: zeros(order),
            independent: None,
            joint: None,
            effects: None,
            intersection: None,
            addition: None,
        }
    }

    /// Determines which sensors have an estimate, and reads their covariances.
    fn read(&mut self, estimates: &Estimates<'_>) -> Result<()> {
        let m = self.order.value();
        self.present.clear();
        for (k, estimate) in estimates.values.chunks_exact(m).enumerate() {
            if !estimate.iter().all(|x| x.is_nan()) {
                require_estimates("estimates", estimate, |i| vec![k, i])?;
                self.present.push(k);
            }
        }
        let mut factor = zeros(self.order);
        self.covariances.resize(self.present.len(), zeros(self.order));
        for (&k, covariance) in self.present.iter().zip(&mut self.covariances) {
            let values = &estimates.covariances[k * m * m..][..m * m];
            read_covariance(COVARIANCES, &[k], values, covariance, &mut factor)?;
        }
        self.blocks.clear();
        self.corrections.clear();
        self.corrections.extend(estimates.corrections.unwrap_or_default());
        match estimates.cross {
            Some(cross) => self.read_cross(cross),
            None => Ok(()),
        }
    }

    /// Reads the blocks between sensors; the joint covariance must be valid.
    fn read_cross(&mut self, cross: &[f64]) -> Result<()> {
        let (count, m) = (self.present.len(), self.order.value());
        self.blocks.resize(count * count, zeros(self.order));
        for j in 0..count {
            self.blocks[j * count + j].copy_from(&self.covariances[j]);
            for l in j + 1..count {
                for (a, b) in (0..m).flat_map(|a| (0..m).map(move |b| (a, b))) {
                    let value = self.cross_covariance(cross, (j, a), (l, b))?;
                    self.blocks[j * count + l][(a, b)] = value;
                    self.blocks[l * count + j][(b, a)] = value;
                }
            }
        }
        let joint = assembled(&self.blocks, m);
        if is_large_semidefinite(&joint) { Ok(()) } else { Err(Error::IndefiniteJoint) }
    }

    /// Covariance of component a of estimate j and component b of estimate l, given twice in `cross`.
    fn cross_covariance(
        &self,
        cross: &[f64],
        (j, a): (usize, usize),
        (l, b): (usize, usize),
    ) -> Result<f64> {
        let m = self.order.value();
        let index = |(j, a): (usize, usize), (l, b): (usize, usize)| {
            [self.present[j], self.present[l], a, b]
        };
        let read = |place: [usize; 4]| {
            let value = cross[((place[0] * self.sensors + place[1]) * m + place[2]) * m + place[3]];
            if value.is_finite() {
                return Ok(value);
            }
            let (index, requirement) = (place.to_vec(), "every element must be a finite number");
            Err(Error::InvalidElement { argument: CROSS, index, value, requirement })
        };
        let place = index((j, a), (l, b));
        let (upper, lower) = (read(place)?, read(index((l, b), (j, a)))?);
        let scale = self.covariances[j][(a, a)].sqrt() * self.covariances[l][(b, b)].sqrt();
        if (upper - lower).abs() > ASYMMETRY * scale {
            let index = place.to_vec();
            return Err(Error::NotSymmetric { argument: CROSS, index, upper, lower });
        }
        Ok(upper + 0.5 * (lower - upper))
    }

    /// Subtracts the estimate whose first component has the smallest variance. Then neither a common
    /// offset nor a bad estimate costs digits, and angles are wrapped about it, in any order of sensors.
    fn set_relative(&mut self, estimates: &[f64]) {
        let m = self.order.value();
        let estimate = |at: usize| &estimates[self.present[at] * m..][..m];
        let variance = |at: &usize| self.covariances[*at][(0, 0)];
        let best = (0..self.present.len()).min_by(|a, b| variance(a).total_cmp(&variance(b)));
        self.origin.copy_from_slice(estimate(best.unwrap_or(0)));
        self.relative.clear();
        for at in 0..self.present.len() {
            let from_origin = estimate(at).iter().zip(&self.origin).map(|(x, o)| x - o);
            self.relative.extend(from_origin);
            if let Some(period) = self.period {
                let angle = &mut self.relative[at * m];
                *angle = nearest(*angle, 0.0, period);
            }
        }
    }

    /// Sets the weights and the covariance. Returns the statistic, nan if the rule has none.
    fn weigh(&mut self) -> Result<f64> {
        if let [_] = self.covariances[..] {
            self.weight[0].fill_with_identity();
            self.fused.copy_from(&self.covariances[0]);
            let tested = [Weighting::Matrix, Weighting::RandomEffects].contains(&self.weighting);
            return Ok(if tested { 0.0 } else { f64::NAN });
        }
        match self.weighting {
            Weighting::Matrix if self.blocks.is_empty() => self.weigh_independent(),
            Weighting::Matrix => self.weigh_joint(),
            Weighting::RandomEffects => self.weigh_effects(),
            Weighting::Intersection => self.intersect().map(|()| f64::NAN),
            _ => {
                self.weigh_components();
                self.spread_components();
                Ok(f64::NAN)
            }
        }
    }

    fn weigh_independent(&mut self) -> Result<f64> {
        let new = || Independent::new(self.sensors, self.order);
        let independent = self.independent.get_or_insert_with(new);
        let statistic = independent.combine(&self.relative, &self.covariances);
        copy(&independent.group.weight, &mut self.weight);
        self.fused.copy_from(&independent.group.fused);
        statistic.map_err(|error| error.renumbered(&self.present))
    }

    fn weigh_effects(&mut self) -> Result<f64> {
        let new = || Effects::new(self.sensors, self.order);
        let effects = self.effects.get_or_insert_with(new);
        let statistic = effects.combine(&self.relative, &self.covariances);
        copy(&effects.weight, &mut self.weight);
        self.fused.copy_from(&effects.fused);
        statistic.map_err(|error| error.renumbered(&self.present))
    }

    fn weigh_joint(&mut self) -> Result<f64> {
        let (order, m) = (self.order, self.order.value());
        let joint = self.joint.get_or_insert_with(|| Joint::new(order));
        let vectors = self.relative.chunks_exact(m);
        let mut vectors: Vec<_> =
            vectors.map(|x| OVector::from_column_slice_generic(order, U1, x)).collect();
        let statistic = joint.combine(&mut vectors, &self.blocks)?;
        copy(&joint.weight, &mut self.weight);
        self.fused.copy_from(&joint.fused);
        Ok(statistic)
    }

    fn intersect(&mut self) -> Result<()> {
        let new = || Intersection::new(self.sensors, self.order);
        let intersection = self.intersection.get_or_insert_with(new);
        let bound = intersection.intersect(&self.covariances);
        self.fused.copy_from(bound.map_err(|error| error.renumbered(&self.present))?);
        copy(&intersection.weight, &mut self.weight);
        Ok(())
    }

    /// Sets the weights of a rule that weights component by component.
    fn weigh_components(&mut self) {
        let m = self.order.value();
        let mut largest = vec![f64::MIN_POSITIVE; if self.corrections.is_empty() { 0 } else { m }];
        for &k in &self.present {
            for (component, largest) in largest.iter_mut().enumerate() {
                *largest = self.corrections[k * m + component].abs().max(*largest);
            }
        }
        for component in 0..m {
            let precision = self.present.iter().zip(&self.covariances).map(|(&k, covariance)| {
                match &self.weighting {
                    Weighting::Static(weights) => weights[k],
                    Weighting::Posterior => 1.0 / covariance[(component, component)],
                    Weighting::Paper => {
                        (self.corrections[k * m + component] / largest[component]).powi(-2)
                    }
                    _ => 1.0,
                }
            });
            for (weight, share) in self.weight.iter_mut().zip(shares(precision)) {
                weight[(component, component)] = share;
            }
        }
    }

    /// Sets `Σ W_j cov(x_j, x_l) W_l` for diagonal weights.
    fn spread_components(&mut self) {
        let (count, m) = (self.present.len(), self.order.value());
        self.fused.fill(0.0);
        for j in 0..count {
            for l in 0..count {
                let block = match self.blocks.get(j * count + l) {
                    Some(block) => block,
                    None if j == l => &self.covariances[j],
                    None => continue,
                };
                for (a, b) in (0..m).flat_map(|a| (0..m).map(move |b| (a, b))) {
                    let shares = (self.weight[j][(a, a)], self.weight[l][(b, b)]);
                    self.fused[(a, b)] += shares.0 * block[(a, b)] * shares.1;
                }
            }
        }
        symmetrise(&mut self.fused);
    }

    fn write(&mut self, out: &mut FusedEstimate<'_>) {
        let m = self.order.value();
        out.mean.copy_from_slice(self.origin.as_slice());
        for (at, &k) in self.present.iter().enumerate() {
            let weight = &self.weight[at];
            write(weight, &mut out.weights[k * m * m..][..m * m]);
            for (i, mean) in out.mean.iter_mut().enumerate() {
                let away = &self.relative[at * m..][..m];
                *mean += (0..m).map(|j| weight[(i, j)] * away[j]).sum::<f64>();
            }
        }
        if let Some(period) = self.period {
            out.mean[0] = principal(out.mean[0], period);
        }
        write(&self.fused, out.covariance);
    }

    /// Writes an unknown estimate, as before the first plot of a track.
    fn write_unknown(&self, out: &mut FusedEstimate<'_>) {
        out.mean.fill(f64::NAN);
        out.covariance.fill(0.0);
        for variance in out.covariance.iter_mut().step_by(self.order.value() + 1) {
            *variance = f64::INFINITY;
        }
    }
}

/// Copies the matrices of the sensors that have an estimate.
fn copy<D: Dim>(from: &[Square<D>], to: &mut [Square<D>])
where
    DefaultAllocator: Allocator<D, D>,
{
    for (to, from) in to.iter_mut().zip(from) {
        to.copy_from(from);
    }
}

/// Returns an error for the first element of vectors of length m that is not finite or is too large.
fn require_estimates(
    argument: &'static str,
    estimates: &[f64],
    place: impl Fn(usize) -> Vec<usize>,
) -> Result<()> {
    match estimates.iter().position(|x| x.is_nan() || x.abs() > LARGEST) {
        None => Ok(()),
        Some(i) => Err(Error::InvalidElement {
            argument,
            index: place(i),
            value: estimates[i],
            requirement: "it must be a number of at most 1e150 in size",
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_all_close;

    const TWO: [f64; 8] = [4.0, 1.0, 1.0, 2.0, 1.0, -0.5, -0.5, 3.0];
    const ESTIMATES: [f64; 4] = [10.0, 20.0, 13.0, 21.0];

    fn fused(weighting: Weighting, cross: Option<&[f64]>) -> Result<([f64; 2], [f64; 4])> {
        let estimates =
            Estimates { values: &ESTIMATES, covariances: &TWO, cross, corrections: None };
        result(weighting, &estimates)
    }

    fn result(weighting: Weighting, estimates: &Estimates<'_>) -> Result<([f64; 2], [f64; 4])> {
        let (mut mean, mut covariance, mut weights) = ([0.0; 2], [0.0; 4], [0.0; 8]);
        let mut out = FusedEstimate {
            mean: &mut mean,
            covariance: &mut covariance,
            weights: &mut weights,
            bias_sigma: &mut [0.0; 2],
        };
        fusing(2, 2, weighting, None).fuse(estimates, &mut out)?;
        Ok((mean, covariance))
    }

    #[test]
    fn independent_and_uncorrelated_are_the_same() {
        let expected = [72.0, -3.0, -3.0, 106.0].map(|s| s / 99.0);
        for cross in [None, Some(&[0.0; 16][..])] {
            let (mean, covariance) = fused(Weighting::Matrix, cross).unwrap();
            assert_all_close(&mean, &[10.0 + 246.0 / 99.0, 20.0 + 86.0 / 99.0]);
            assert_all_close(&covariance, &expected);
        }
    }

    /// A common error adds its covariance; the weights are those without this error.
    #[test]
    fn what_is_common_is_added() {
        let common = [0.5, 0.2, 0.2, 0.5];
        let cross: Vec<f64> = common.repeat(4);
        let (_, with) = fused(Weighting::Matrix, Some(&cross)).unwrap();
        let mut rest = TWO;
        rest.iter_mut().zip(common.repeat(2)).for_each(|(s, c)| *s -= c);
        let estimates =
            Estimates { values: &ESTIMATES, covariances: &rest, cross: None, corrections: None };
        let (_, mut covariance) = result(Weighting::Matrix, &estimates).unwrap();
        covariance.iter_mut().zip(common).for_each(|(s, c)| *s += c);
        assert_all_close(&with, &covariance);
    }

    #[test]
    fn impossible_correlations() {
        let found = fused(Weighting::Equal, Some(&[3.0; 16]));
        assert_eq!(found, Err(Error::IndefiniteJoint));
    }
}
