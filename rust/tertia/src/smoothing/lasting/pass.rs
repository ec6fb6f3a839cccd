//! A pass of the filter for lasting noise, by the widest vectors of the processor.

use super::{Fit, Step};
use crate::smoothing::model::{Faults, Model};
use crate::smoothing::track::Track;
use pulp::{Simd, WithSimd};

/// A filter that keeps nothing but the fit.
pub(super) struct Pass<'a, const M: usize, const N: usize> {
    pub first: Step<M, N>,
    pub track: &'a Track<'a>,
    pub model: &'a Model,
    pub faults: &'a Faults,
}

impl<const M: usize, const N: usize> WithSimd for Pass<'_, M, N> {
    type Output = Fit;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Fit {
        let Self { first: mut step, track, model, faults } = self;
        let (mut fit, mut faded) = (Fit::default(), Faded::default());
        for k in 0..track.len() {
            step.arrive(track, k, model, faults, &mut faded);
            step.update(track, k, model, faults, &mut fit);
        }
        fit
    }
}

/// A time, and the correlation of lasting noise over that: most steps are as long as the one before.
#[derive(Default)]
pub(super) struct Faded {
    time: f64,
    correlation: f64,
}

impl Faded {
    #[inline(always)]
    pub fn over(&mut self, time: f64, model: &Model) -> f64 {
        if time != self.time {
            *self = Self { time, correlation: model.lasting.correlation(time) };
        }
        self.correlation
    }
}
