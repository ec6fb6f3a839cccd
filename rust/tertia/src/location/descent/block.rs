//! Descent of several instants from trusted starts side by side, one instant per lane of a vector.
//! Their measurements must have the same kinds in the same order.
//!
//! The steps are those of [`super`] without the safeguards: if a step goes uphill or the
//! descent takes too many steps, no minimum is returned for the lane. Lanes are independent, so the
//! result of an instant does not depend on the instants beside it.

use super::lane::{LANES, Lane, Lanes};
use super::lanes::Measured;
use super::{FAR, Loss};
use crate::base::small::{self, Matrix};
use crate::base::vector::Vector;
use crate::sensors::{Measurement, Row};
use pulp::{Arch, Simd, WithSimd};

/// State in which the descent of a lane ended, with the normal matrix and the cost there.
#[derive(Clone, Copy, Debug)]
pub(in crate::location) struct Arrival<const N: usize> {
    pub state: small::Vector<N>,
    pub matrix: Matrix<N>,
    pub cost: f64,
}

/// Instants and the states of their descents. A state is a position and, if there are arrivals, their
/// emission.
#[derive(Debug)]
pub(in crate::location) struct Block<const D: usize, const N: usize> {
    measured: Vec<Measured<D>>,
    /// Residuals and their derivatives at the states.
    rows: Vec<(Lane, [Lane; N])>,
    state: [Lane; N],
    matrix: [[Lane; N]; N],
    cost: Lane,
    /// 1 in lanes that have reached a minimum, otherwise 0.
    found: Lane,
}

impl<const D: usize, const N: usize> Default for Block<D, N> {
    fn default() -> Self {
        let zeros = [0.0; LANES];
        Self {
            measured: Vec::new(),
            rows: Vec::new(),
            state: [zeros; N],
            matrix: [[zeros; N]; N],
            cost: zeros,
            found: zeros,
        }
    }
}

impl<const D: usize, const N: usize> Block<D, N> {
    /// Starts a block: fills all lanes with one instant.
    pub fn begin(&mut self, measurements: &[Measurement<D>], start: &small::Vector<N>) {
        self.measured.clear();
        for m in measurements {
            self.measured.push(Measured {
                kind: m.kind,
                station: m.station.map(|v| [v; LANES]),
                value: [m.value; LANES],
                precision: [m.precision; LANES],
                sine: [m.sine; LANES],
                cosine: [m.cosine; LANES],
                axes: m.axes.map(|axes| axes.map(|axis| axis.map(|v| [v; LANES]))),
            });
        }
        self.state = start.map(|v| [v; LANES]);
    }

    /// Whether an instant has measurements of the same kinds in the same order as the block.
    pub fn fits(&self, measurements: &[Measurement<D>]) -> bool {
        let alike = |(own, m): (&Measured<D>, &Measurement<D>)| {
            own.kind == m.kind && own.axes.is_some() == m.axes.is_some()
        };
        self.measured.len() == measurements.len()
            && self.measured.iter().zip(measurements).all(alike)
    }

    /// Puts an instant into a lane; the instant must fit.
    pub fn set(&mut self, lane: usize, measurements: &[Measurement<D>], start: &small::Vector<N>) {
        for (own, m) in self.measured.iter_mut().zip(measurements) {
            for i in 0..D {
                own.station[i][lane] = m.station[i];
            }
            own.value[lane] = m.value;
            own.precision[lane] = m.precision;
            own.sine[lane] = m.sine;
            own.cosine[lane] = m.cosine;
            if let (Some(own), Some(axes)) = (&mut own.axes, &m.axes) {
                for i in 0..D {
                    for j in 0..D {
                        own[i][j][lane] = axes[i][j];
                    }
                }
            }
        }
        for i in 0..N {
            self.state[i][lane] = start[i];
        }
    }

    /// Descends in all lanes until steps are shorter than `tolerance` standard deviations. If the loss
    /// is not the square, up to `huber.0` steps with Huber's loss come first, until they are shorter
    /// than `huber.1` standard deviations.
    pub fn descend(&mut self, loss: Loss, huber: (usize, f64), tolerance: f64) {
        Arch::new().dispatch(Descent { block: self, loss, huber, tolerance });
    }

    /// Returns the minimum of a lane, if it reached one, and writes the rows at this minimum.
    pub fn arrival(&self, lane: usize, extent: f64, rows: &mut Vec<Row<N>>) -> Option<Arrival<N>> {
        let state = std::array::from_fn(|i| self.state[i][lane]);
        if self.found[lane] <= 0.0 || small::norm(&state) > FAR * extent {
            return None;
        }
        let mut matrix = [[0.0; N]; N];
        for i in 0..N {
            for j in 0..=i {
                matrix[i][j] = self.matrix[i][j][lane];
                matrix[j][i] = matrix[i][j];
            }
        }
        rows.clear();
        rows.extend(self.rows.iter().map(|(residual, gradient)| Row {
            residual: residual[lane],
            gradient: std::array::from_fn(|i| gradient[i][lane]),
        }));
        Some(Arrival { state, matrix, cost: self.cost[lane] })
    }
}

struct Descent<'a, const D: usize, const N: usize> {
    block: &'a mut Block<D, N>,
    loss: Loss,
    huber: (usize, f64),
    tolerance: f64,
}

impl<const D: usize, const N: usize> WithSimd for Descent<'_, D, N> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { block, loss, huber, tolerance } = self;
        block.rows.resize(block.measured.len(), ([0.0; LANES], [[0.0; LANES]; N]));
        for at in 0..LANES / S::F64_LANES {
            let lanes = Lanes { simd, at, cut: false };
            let mut p = Vector::load_all(simd, &block.state, at);
            if loss != Loss::SQUARE {
                lanes.approach(&block.measured, &mut p, huber);
            }
            let (normal, found) = lanes.descend(&block.measured, &mut p, loss, tolerance);
            Vector::store_all(&p, &mut block.state, at);
            for i in 0..N {
                Vector::store_all(&normal.matrix[i], &mut block.matrix[i], at);
            }
            normal.cost.store(&mut block.cost, at);
            found.store(&mut block.found, at);
            for (m, (residual, gradient)) in block.measured.iter().zip(&mut block.rows) {
                let (u, slope) = lanes.row_at(&lanes.loaded(m), &p);
                u.store(residual, at);
                Vector::store_all(&slope, gradient, at);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Cost, HUBER, Problem, TUKEY};
    use super::*;
    use crate::sensors::Kind;

    /// Measurements of one target by three radars, with errors.
    fn measurements(error: f64, tilted: bool) -> Vec<Measurement<3>> {
        let target = [1000.0, 1500.0, 500.0];
        let axes = [[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]];
        let mut all = Vec::new();
        for (k, station) in
            [[0.0; 3], [2000.0, 300.0, 5.0], [400.0, 2600.0, 0.0]].into_iter().enumerate()
        {
            for kind in Kind::ALL {
                let sigma = if kind.is_angle() { 0.005 } else { 10.0 };
                let zero = Measurement::new(kind, k, station, 0.0, sigma);
                let zero = if tilted { zero.about(&axes) } else { zero };
                // the residual of zero is minus the prediction, in standard deviations
                let value = -zero.row(&target).residual * sigma;
                let wrong = error * ((7 * k + kind as usize) as f64).sin();
                let m = Measurement::new(kind, k, station, value + wrong * sigma, sigma);
                all.push(if tilted { m.about(&axes) } else { m });
            }
        }
        all
    }

    #[test]
    fn lanes_arrive_where_single_steps_do() {
        let start = [980.0, 1520.0, 470.0];
        for tilted in [false, true] {
            let mut block = Block::<3, 3>::default();
            let instants: Vec<_> =
                (0..LANES).map(|lane| measurements(0.2 * lane as f64, tilted)).collect();
            block.begin(&instants[0], &start);
            for (lane, instant) in instants.iter().enumerate() {
                assert!(block.fits(instant));
                block.set(lane, instant, &start);
            }
            for loss in [Loss::SQUARE, Loss::Alike(Cost::Tukey(TUKEY))] {
                for i in 0..3 {
                    block.state[i] = [start[i]; LANES];
                }
                block.descend(loss, (8, 0.5), 1e-9);
                for (lane, instant) in instants.iter().enumerate() {
                    let problem = Problem::<3, 3> { measurements: instant, extent: 2000.0 };
                    let mut p = start;
                    let (_, normal) = problem.descend(&mut p, loss, 1.0, 50, 1e-9);
                    let mut rows = Vec::new();
                    let arrival = block.arrival(lane, 2000.0, &mut rows).unwrap();
                    for i in 0..3 {
                        assert!((arrival.state[i] - p[i]).abs() < 1e-6, "{loss:?} {lane}");
                    }
                    assert!((arrival.cost - normal.cost).abs() <= 1e-9 * (1.0 + normal.cost));
                    for (row, m) in rows.iter().zip(instant) {
                        assert!((row.residual - m.row(&p).residual).abs() < 1e-6);
                    }
                }
            }
        }
        let mut block = Block::<3, 3>::default();
        block.begin(&measurements(0.0, false), &start);
        assert!(!block.fits(&measurements(0.0, true)));
        assert!(!block.fits(&measurements(0.0, false)[1..]));
    }

    /// Times of arrival at five stations; the emission is the third unknown.
    #[test]
    fn emissions_arrive_too() {
        let stations =
            [[0.0, 0.0], [4000.0, 0.0], [0.0, 3000.0], [4200.0, 3100.0], [2000.0, -1500.0]];
        let instant = |lane: usize| -> Vec<Measurement<2>> {
            let arrival = |(k, s): (usize, [f64; 2])| {
                let range = (1500.0 - s[0]).hypot(1100.0 - s[1]);
                let wrong = 20.0 * ((7 * k + lane) as f64).sin();
                let late = if lane == 3 && k == 1 { 400.0 } else { 0.0 };
                Measurement::new(Kind::Arrival, k, s, 90.0 + range + wrong + late, 10.0)
            };
            stations.into_iter().enumerate().map(arrival).collect()
        };
        let start = [1520.0, 1090.0, 80.0];
        let mut block = Block::<2, 3>::default();
        block.begin(&instant(0), &start);
        for lane in 0..LANES {
            block.set(lane, &instant(lane), &start);
        }
        let loss = Loss::of_arrivals(true, 1.0);
        block.descend(loss, (8, 0.5), 1e-9);
        for lane in 0..LANES {
            let measurements = instant(lane);
            let problem = Problem::<2, 3> { measurements: &measurements, extent: 5e3 };
            let mut x = start;
            problem.descend(&mut x, Loss::Alike(Cost::Huber(HUBER)), 1.0, 8, 0.5);
            let (_, normal) = problem.descend(&mut x, loss, 1.0, 50, 1e-9);
            let arrival = block.arrival(lane, 5e3, &mut Vec::new()).unwrap();
            for i in 0..3 {
                assert!((arrival.state[i] - x[i]).abs() < 1e-6, "{lane}");
            }
            assert!((arrival.cost - normal.cost).abs() <= 1e-10 * (1.0 + normal.cost));
        }
    }
}
