//! The weights of several sensors, computed without inverting any single covariance.
//!
//! `W_k = A_k (A_k + S_k)^-1`, where A_k is the fused covariance of the others; two covariances are fused as
//! `X (X + Y)^-1 Y`. Only sums are inverted, so the covariance of a single sensor may be singular.

use super::COVARIANCES;
use crate::base::error::{Error, Result};
use crate::base::matrix::{
    Square, factorise_sum, half_solve, invert, is_regular, is_semidefinite, read_covariance,
    symmetrise, zeros,
};
use nalgebra::allocator::Allocator;
use nalgebra::{DefaultAllocator, Dim};

/// Largest relative error of a fused variance that is accepted after rounding.
const ERROR_ALLOWED: f64 = 1e-3;

/// Several covariances and the weights that result from them.
pub(crate) struct Problem<D: Dim>
where
    DefaultAllocator: Allocator<D, D>,
{
    pub covariances: Vec<Square<D>>,
    /// Factors of the covariances from [`read_covariance`].
    pub factors: Vec<Square<D>>,
    pub group: Group<D>,
}

impl<D: Dim> Problem<D>
where
    DefaultAllocator: Allocator<D, D>,
{
    pub fn new(sensors: usize, order: D) -> Self {
        let list = || vec![zeros(order); sensors];
        Self { covariances: list(), factors: list(), group: Group::new(sensors, order) }
    }

    /// Reads the covariances (K, m, m).
    pub fn read(&mut self, covariances: &[f64]) -> Result<()> {
        let size = self.group.fused.len();
        assert_eq!(covariances.len(), size * self.covariances.len(), "length of covariances");
        let outputs = self.covariances.iter_mut().zip(&mut self.factors);
        for (k, (values, (out, factor))) in covariances.chunks_exact(size).zip(outputs).enumerate()
        {
            read_covariance(COVARIANCES, &[k], values, out, factor)?;
        }
        Ok(())
    }

    /// Reads the covariances and computes the weights.
    pub fn weigh(&mut self, covariances: &[f64]) -> Result<()> {
        self.read(covariances)?;
        self.group.weigh(&self.covariances, None)
    }

    /// [`Self::weigh`] that also computes the fused covariance and requires that it is accurate.
    pub fn fuse(&mut self, covariances: &[f64]) -> Result<()> {
        self.weigh(covariances)?;
        self.group.fuse(&self.covariances, None)?;
        self.group.require_known()
    }
}

/// Weights of the members of a group, with buffers for at most as many sensors.
#[derive(Clone, Debug)]
pub(crate) struct Group<D: Dim>
where
    DefaultAllocator: Allocator<D, D>,
{
    /// W_i.
    pub weight: Vec<Square<D>>,
    /// I − W_i.
    pub complement: Vec<Square<D>>,
    /// (ΣC_i)^-1, after [`Group::fuse`].
    pub fused: Square<D>,
    /// Whether the fused variances have enough digits after rounding.
    is_known: bool,
    /// The fused covariance of members 0..=i; only used for three or more members.
    forward: Vec<Square<D>>,
    /// The fused covariance of members i..; only used for three or more members.
    backward: Vec<Square<D>>,
    others: Square<D>,
    sum: Sum<D>,
}

/// A sum of two covariances, with its factor and its inverse.
#[derive(Clone, Debug)]
pub(crate) struct Sum<D: Dim>
where
    DefaultAllocator: Allocator<D, D>,
{
    pub inverse: Square<D>,
    factor: Square<D>,
    halves: [Square<D>; 2],
}

impl<D: Dim> Sum<D>
where
    DefaultAllocator: Allocator<D, D>,
{
    pub fn new(order: D) -> Self {
        let new = || zeros(order);
        Self { inverse: new(), factor: new(), halves: [new(), new()] }
    }

    /// Computes `(x + y)^-1`; `sensor` is named in the error if the sum is singular.
    pub fn invert(&mut self, x: &Square<D>, y: &Square<D>, sensor: usize) -> Result<()> {
        if factorise_sum(x, y, &mut self.factor) {
            invert(&mut self.factor, &mut self.inverse);
            if is_regular(x, y, &self.inverse) {
                return Ok(());
            }
        }
        Err(Error::SingularSum { argument: COVARIANCES, index: vec![sensor] })
    }

    /// Computes `out = x (x + y)^-1 y` as the product of two halves. If one of the covariances were
    /// multiplied by the inverse, ill-conditioned covariances would lose digits twice. Returns whether
    /// every variance is accurate enough.
    pub fn fuse(
        &mut self,
        x: &Square<D>,
        y: &Square<D>,
        sensor: usize,
        out: &mut Square<D>,
    ) -> Result<bool> {
        if !factorise_sum(x, y, &mut self.factor) {
            return Err(Error::SingularSum { argument: COVARIANCES, index: vec![sensor] });
        }
        let [u, v] = &mut self.halves;
        u.copy_from(x);
        v.copy_from(y);
        half_solve(&self.factor, u);
        half_solve(&self.factor, v);
        u.tr_mul_to(v, out);
        symmetrise(out);
        let m = out.nrows();
        let rounding = f64::EPSILON * m as f64 / ERROR_ALLOWED;
        let terms = |i: usize| (0..m).map(|p| (u[(p, i)] * v[(p, i)]).abs()).sum::<f64>();
        Ok((0..m).all(|i| out[(i, i)] > rounding * terms(i)))
    }
}

impl<D: Dim> Group<D>
where
    DefaultAllocator: Allocator<D, D>,
{
    pub fn new(sensors: usize, order: D) -> Self {
        let list = |n| vec![zeros(order); n];
        let passes = if sensors > 2 { sensors } else { 0 };
        Self {
            weight: list(sensors),
            complement: list(sensors),
            fused: zeros(order),
            is_known: true,
            forward: list(passes),
            backward: list(passes),
            others: zeros(order),
            sum: Sum::new(order),
        }
    }

    /// Computes the weights of the sensors except `without`; the results keep the order of the sensors.
    /// Cost O(K m³).
    pub fn weigh(&mut self, covariances: &[Square<D>], without: Option<usize>) -> Result<()> {
        let sensor = members(without);
        match covariances.len() - usize::from(without.is_some()) {
            1 => {
                self.weight[0].fill_with_identity();
                self.complement[0].fill(0.0);
                Ok(())
            }
            2 => self.weigh_two(&covariances[sensor(0)], &covariances[sensor(1)], sensor(1)),
            n => self.weigh_many(covariances, n, sensor),
        }
    }

    /// Computes the fused covariance of the sensors given to [`Group::weigh`] before.
    pub fn fuse(&mut self, covariances: &[Square<D>], without: Option<usize>) -> Result<()> {
        let sensor = members(without);
        match covariances.len() - usize::from(without.is_some()) {
            1 => self.fused.copy_from(&covariances[sensor(0)]),
            2 => {
                let (x, y) = (&covariances[sensor(0)], &covariances[sensor(1)]);
                self.is_known = self.sum.fuse(x, y, sensor(1), &mut self.fused)?;
            }
            n => self.fused.copy_from(&self.forward[n - 1]),
        }
        Ok(())
    }

    /// Returns an error unless the covariance from [`Group::fuse`] is accurate and valid.
    pub fn require_known(&mut self) -> Result<()> {
        if self.is_known && is_semidefinite(&self.fused, &mut self.others) {
            Ok(())
        } else {
            Err(Error::LostToRounding { argument: COVARIANCES })
        }
    }

    fn weigh_two(&mut self, x: &Square<D>, y: &Square<D>, sensor: usize) -> Result<()> {
        self.sum.invert(x, y, sensor)?;
        y.mul_to(&self.sum.inverse, &mut self.weight[0]);
        x.mul_to(&self.sum.inverse, &mut self.weight[1]);
        self.complement[0].copy_from(&self.weight[1]);
        self.complement[1].copy_from(&self.weight[0]);
        Ok(())
    }

    fn weigh_many(
        &mut self,
        covariances: &[Square<D>],
        members: usize,
        sensor: impl Fn(usize) -> usize,
    ) -> Result<()> {
        let (last, sum) = (members - 1, &mut self.sum);
        self.is_known = true;
        self.forward[0].copy_from(&covariances[sensor(0)]);
        for i in 1..members {
            let (before, from) = self.forward.split_at_mut(i);
            let s = &covariances[sensor(i)];
            self.is_known &= sum.fuse(&before[i - 1], s, sensor(i), &mut from[0])?;
        }
        self.backward[last].copy_from(&covariances[sensor(last)]);
        for i in (0..last).rev() {
            let (to, after) = self.backward.split_at_mut(i + 1);
            sum.fuse(&after[0], &covariances[sensor(i)], sensor(i), &mut to[i])?;
        }
        for i in 0..members {
            let others = if i == 0 {
                &self.backward[1]
            } else if i == last {
                &self.forward[last - 1]
            } else {
                let (before, after) = (&self.forward[i - 1], &self.backward[i + 1]);
                sum.fuse(before, after, sensor(i), &mut self.others)?;
                &self.others
            };
            let s = &covariances[sensor(i)];
            sum.invert(others, s, sensor(i))?;
            others.mul_to(&sum.inverse, &mut self.weight[i]);
            s.mul_to(&sum.inverse, &mut self.complement[i]);
        }
        Ok(())
    }
}

/// Maps the index of a member to the index among all sensors, which include `without`.
fn members(without: Option<usize>) -> impl Fn(usize) -> usize {
    move |member| member + usize::from(without.is_some_and(|k| member >= k))
}
