//! Costs of starting points, several of them side by side.

use super::costs::Total;
use super::lane::{LANES, Lanes};
use super::{Cost, Loss};
use crate::base::scratch::refill;
use crate::base::small;
use crate::base::vector::Vector;
use crate::sensors::{Measurement, SMALL_TANGENT};
use pulp::{Arch, Simd, WithSimd};

/// Computes the costs of states. O(M) for each.
pub(in crate::location) fn costs<const D: usize, const N: usize>(
    measurements: &[Measurement<D>],
    states: &[small::Vector<N>],
    loss: Loss,
    costs: &mut Vec<f64>,
) {
    refill(costs, states.len(), 0.0);
    Arch::new().dispatch(Costs { measurements, states, loss, costs });
}

struct Costs<'a, const D: usize, const N: usize> {
    measurements: &'a [Measurement<D>],
    states: &'a [small::Vector<N>],
    loss: Loss,
    costs: &'a mut [f64],
}

impl<const D: usize, const N: usize> WithSimd for Costs<'_, D, N> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { measurements, states, loss, costs } = self;
        // 0.99: the angle is a little smaller than its tangent
        let cut = match loss {
            Loss::Alike(Cost::Tukey(c)) => {
                let mut angles = measurements.iter().filter(|m| m.kind.is_angle());
                angles.all(|m| c < 0.99 * SMALL_TANGENT * m.precision)
            }
            _ => false,
        };
        let lanes = Lanes { simd, at: 0, cut };
        let few = S::F64_LANES;
        for (states, costs) in states.chunks(few).zip(costs.chunks_mut(few)) {
            let mut rows = [[0.0; LANES]; N];
            for (lane, state) in states.iter().enumerate() {
                for i in 0..N {
                    rows[i][lane] = state[i];
                }
            }
            let x = Vector::load_all(simd, &rows, 0);
            let mut total = Total::new(lanes, loss);
            for m in measurements {
                let (residual, _) = lanes.row_at(&lanes.repeated(m), &x);
                total.add(lanes.loss(residual, loss.of(m.kind)).1);
            }
            let mut sums = [0.0; LANES];
            total.finish().store(&mut sums, 0);
            costs.copy_from_slice(&sums[..costs.len()]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Problem, TUKEY};
    use super::*;
    use crate::sensors::Kind;

    #[test]
    fn costs_are_those_of_single_points() {
        [0.2, 0.01].into_iter().for_each(compare);
    }

    fn compare(sigma: f64) {
        let axes = [[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]];
        let measurements: Vec<Measurement<3>> = (0..12)
            .map(|i| {
                let station = [100.0 * i as f64, 300.0 - 40.0 * i as f64, 5.0];
                let kind = Kind::ALL[i % 4];
                let (value, sigma) = if kind.is_angle() { (0.3, sigma) } else { (700.0, 90.0) };
                let m = Measurement::new(kind, i, station, value, sigma);
                if i % 3 == 0 { m.about(&axes) } else { m }
            })
            .collect();
        let point = |i: usize| {
            let turn = i as f64 * 0.7;
            [900.0 * turn.sin(), 700.0 * turn.cos(), 300.0 * (0.3 * turn).sin()]
        };
        let points: Vec<_> = (0..21).map(point).collect();
        let mut found = Vec::new();
        for loss in [Loss::SQUARE, Loss::Alike(Cost::Tukey(TUKEY)), Loss::of_arrivals(true, 1.0)] {
            costs(&measurements, &points, loss, &mut found);
            let problem = Problem::<3, 3> { measurements: &measurements, extent: 1e3 };
            for (point, cost) in points.iter().zip(&found) {
                let expected = problem.cost(point, loss, 1.0);
                assert!((cost - expected).abs() < 1e-12 * (1.0 + expected), "{loss:?}");
            }
        }
    }
}
