//! Targets that a radar may not resolve: two of them make one plot (Koch, van Keuk 1997).
//!
//! With the difference Δ of two targets along and across the line of sight, the radar makes one
//! plot with the probability `exp(−½ Δ' R⁻¹ Δ)`, `R = α² / (2 ln 2)`, which is a half at the size α
//! of its cell.

use super::{Filter, LEAST_DENSITY};
use crate::base::plane::Plane;
use crate::sensors::Radar;
use crate::tracker::motion::estimate::Estimate;
use crate::tracker::motion::imm::{Bank, Component, MODELS, PLAN, STRAIGHT, TURN};
use crate::tracker::motion::speed_change::SpeedChange;
use nalgebra::{Matrix2, Matrix4, SMatrix, Vector2, Vector4};

/// Standard deviation of the share that each of two targets has in their plot: a half on average.
const SHARE_SIGMA: f64 = 0.12;
/// Least probability of a common plot of two targets that counts, and the largest.
const LEAST: f64 = 1e-3;
const MOST: f64 = 0.999;

/// The separation of two targets that the radar may not resolve.
#[derive(Clone, Copy, Debug)]
pub(in crate::tracker) struct Separation {
    /// Position of the first target less that of the second, m.
    difference: [f64; 2],
    /// R, in the plane, m².
    cell: Plane,
    /// Probability that both make one common plot.
    pub probability: f64,
}

impl Separation {
    /// Separation of two estimates at the time of a scan; none if the radar resolves them.
    pub fn of(a: &Estimate<4>, b: &Estimate<4>, radar: &Radar) -> Option<Self> {
        let difference = [a.mean[0] - b.mean[0], a.mean[1] - b.mean[1]];
        let cell = cell_at(radar, a.position())?;
        // U = √(|R| / |C + R|) exp(−½ Δ' (C + R)⁻¹ Δ)
        let sum = a.position_covariance().plus(b.position_covariance()).plus(cell);
        let ratio = cell.determinant() / sum.determinant();
        let probability = ratio.sqrt() * (-0.5 * sum.inverse().form(difference)).exp();
        let probability = probability.min(MOST);
        (probability >= LEAST).then_some(Self { difference, cell, probability })
    }

    /// Logarithm of the probability that both are resolved.
    pub fn resolved(&self) -> f64 {
        (-self.probability).ln_1p()
    }

    /// Logarithm of the factor by which two missed detections are likelier because both targets may
    /// have been unresolved: then they are one missed detection.
    pub fn missed(&self, radar: &Radar) -> f64 {
        let p = self.probability;
        (p / (1.0 - radar.detection_probability) + 1.0 - p).ln()
    }

    /// Covariance of a common plot less that of a plot of one target.
    pub fn spread(&self) -> Plane {
        let [x, y] = self.difference;
        let share = SHARE_SIGMA * SHARE_SIGMA;
        Plane { xx: share * x * x, xy: share * x * y, yy: share * y * y }
    }

    /// Squared normalised distance of a plot from the middle of two estimates, and 2π times its
    /// density.
    pub fn compare(&self, [a, b]: [&Estimate<4>; 2], (z, r): ([f64; 2], Plane)) -> (f64, f64) {
        let both = a.position_covariance().plus(b.position_covariance()).scaled(0.25);
        let s = both.plus(r).plus(self.spread());
        let middle = [0, 1].map(|i| 0.5 * (a.mean[i] + b.mean[i]));
        let d = s.inverse().form([z[0] - middle[0], z[1] - middle[1]]);
        (d, (-0.5 * d).exp() / s.determinant().sqrt())
    }

    /// Corrects the filter of the first target by a common plot.
    pub fn correct(&self, own: &mut Filter, other: &Filter, (z, r): ([f64; 2], Plane)) {
        let by = shifts(&own.models(), &other.models(), (z, r.plus(self.spread())), self.cell);
        own.apply(&by);
    }
}

/// R at a position; none if the radar resolves all targets.
fn cell_at(radar: &Radar, position: [f64; 2]) -> Option<Plane> {
    let [range, azimuth] = radar.resolution?;
    let sight = [position[0] - radar.position[0], position[1] - radar.position[1]];
    let squared = sight[0] * sight[0] + sight[1] * sight[1];
    let two_ln_two = 2.0 * std::f64::consts::LN_2;
    let (along, across) = (range * range / two_ln_two, azimuth * azimuth * squared / two_ln_two);
    let [x, y] = sight;
    let share = 1.0 / squared.max(f64::MIN_POSITIVE);
    Some(Plane {
        xx: (along * x * x + across * y * y) * share,
        xy: (along - across) * x * y * share,
        yy: (along * y * y + across * x * x) * share,
    })
}

/// What a common plot says about one model: its likelihood, and the vector u and the matrix M by
/// which [`Estimate::shift`] changes the mean and the covariance.
#[derive(Clone, Copy, Debug)]
pub(in crate::tracker) struct Shift {
    pub density: f64,
    pub shift: Vector2<f64>,
    pub loss: Matrix2<f64>,
}

/// Shifts of the models of the first target by a common plot. The equations are `z = ½ (a + b) + r`
/// and `0 = a − b + u`, u ~ N(0, R), two rows each, for each model of the other target; the results
/// are mixed. Without the second equation the targets would separate while they are not resolved.
/// Cost O(models of both).
fn shifts(
    own: &[Component],
    other: &[Component],
    (z, r): ([f64; 2], Plane),
    cell: Plane,
) -> Vec<Shift> {
    let half = Matrix2::identity() * 0.5;
    let gain = SMatrix::<f64, 2, 4>::from_fn(|i, j| {
        if j < 2 { half[(i, j)] } else { f64::from(u8::from(i == j - 2)) }
    });
    let of = |a: &Component, b: &Component| {
        let (ca, cb) = (matrix(a.covariance), matrix(b.covariance));
        let mut s = Matrix4::zeros();
        s.fixed_view_mut::<2, 2>(0, 0).copy_from(&((ca + cb) * 0.25 + matrix(r)));
        s.fixed_view_mut::<2, 2>(2, 2).copy_from(&(ca + cb + matrix(cell)));
        s.fixed_view_mut::<2, 2>(0, 2).copy_from(&((ca - cb) * 0.5));
        s.fixed_view_mut::<2, 2>(2, 0).copy_from(&((ca - cb) * 0.5));
        let ([ax, ay], [bx, by]) = (a.position, b.position);
        let y = Vector4::new(z[0] - 0.5 * (ax + bx), z[1] - 0.5 * (ay + by), bx - ax, by - ay);
        let root = s.cholesky()?;
        let (solved, spread) = (root.solve(&y), root.solve(&gain.transpose()));
        let norm = (std::f64::consts::TAU * std::f64::consts::TAU) * root.determinant().sqrt();
        let density = (-0.5 * y.dot(&solved)).exp() / norm;
        Some(Shift { density, shift: gain * solved, loss: gain * spread })
    };
    own.iter()
        .map(|a| {
            let pairs: Vec<(f64, Shift)> =
                other.iter().filter_map(|b| Some((b.probability, of(a, b)?))).collect();
            let density: f64 = pairs.iter().map(|(p, pair)| p * pair.density).sum();
            let mean = |value: &dyn Fn(&Shift) -> Matrix2<f64>| {
                pairs.iter().fold(Matrix2::zeros(), |sum, (p, pair)| {
                    sum + value(pair) * (p * pair.density / density)
                })
            };
            let shift = pairs.iter().fold(Vector2::zeros(), |sum, (p, pair)| {
                sum + pair.shift * (p * pair.density / density)
            });
            let about = |pair: &Shift| (pair.shift - shift) * (pair.shift - shift).transpose();
            let loss = mean(&|pair| pair.loss) - mean(&about);
            Shift { density, shift, loss }
        })
        .collect()
}

fn matrix(p: Plane) -> Matrix2<f64> {
    Matrix2::new(p.xx, p.xy, p.xy, p.yy)
}

impl<const N: usize> Estimate<N> {
    /// Moves the mean by P H' u, and takes P H' M H P from the covariance; H selects the position.
    fn shift(&mut self, by: &Shift) {
        let columns = self.covariance.fixed_view::<N, 2>(0, 0).into_owned();
        self.mean += columns * by.shift;
        let smaller = self.covariance - columns * by.loss * columns.transpose();
        self.covariance = 0.5 * (smaller + smaller.transpose());
    }
}

impl Bank {
    fn apply(&mut self, by: &[Shift; MODELS]) {
        self.straight.shift(&by[STRAIGHT]);
        self.turn.shift(&by[TURN]);
        self.plan.shift(&by[PLAN]);
        for (probability, by) in self.probability.iter_mut().zip(by) {
            *probability *= by.density;
        }
    }
}

impl Filter {
    /// Position that each model expects, including models of probability zero.
    fn models(&self) -> Vec<Component> {
        let one = |position, covariance| vec![Component { probability: 1.0, position, covariance }];
        match self {
            Self::Straight(e) => one(e.position(), e.position_covariance()),
            Self::Singer(e) => one(e.position(), e.position_covariance()),
            Self::Window(_) | Self::Planned(_) => {
                let e = self.estimate();
                one(e.position(), e.position_covariance())
            }
            Self::Multiple(multiple) => multiple.banks().flat_map(Bank::models).collect(),
        }
    }

    /// Applies a shift to each model.
    fn apply(&mut self, by: &[Shift]) {
        match self {
            Self::Straight(estimate) => estimate.shift(&by[0]),
            Self::Singer(estimate) => estimate.shift(&by[0]),
            // the line of a window is fitted to plots of one target, and tentative tracks take no
            // common plots
            Self::Window(_) | Self::Planned(_) => {}
            Self::Multiple(multiple) => {
                let (parts, _) = by.as_chunks::<MODELS>();
                let before = multiple.bank.probability;
                let seconds = multiple.banks().nth(1).map(|bank| bank.probability);
                multiple.banks_mut().zip(parts).for_each(|(bank, by)| bank.apply(by));
                multiple.speed.iter_mut().for_each(SpeedChange::forget);
                let total: f64 = multiple.banks().map(Bank::total).sum();
                if total > LEAST_DENSITY {
                    multiple.banks_mut().for_each(|bank| bank.scale(total.recip()));
                    return;
                }
                let old = [Some(before), seconds];
                for (bank, old) in multiple.banks_mut().zip(old.into_iter().flatten()) {
                    bank.probability = old;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensors::radar_of;
    use nalgebra::SVector;

    fn estimate(mean: [f64; 4]) -> Estimate<4> {
        let mut covariance = SMatrix::from_diagonal(&SVector::from([6400.0, 2500.0, 25.0, 25.0]));
        for (i, j, value) in [(0, 2, 200.0), (1, 3, 100.0)] {
            covariance[(i, j)] = value;
            covariance[(j, i)] = value;
        }
        Estimate { mean: SVector::from(mean), covariance }
    }

    /// A worked example: cell of 150 m and 1.4 degrees, 100 km away.
    #[test]
    fn two_targets_300_m_apart() {
        let resolution = Some([150.0, 1.4_f64.to_radians()]);
        let radar = Radar { resolution, ..radar_of([50.0, 0.08_f64.to_radians()]) };
        let (a, b) = (estimate([0.0, 1e5, 200.0, 0.0]), estimate([30.0, 100_300.0, 200.0, 3.0]));
        let r = radar.noise_at([0.0, 1e5], f64::NAN);
        assert!((r.xx - 19_495.5148663).abs() < 1e-6);
        let pair = Separation::of(&a, &b, &radar).unwrap();
        assert!((pair.probability - 0.10482397447).abs() < 1e-11);
        assert!((pair.cell.xx - 4_306_806.400_77).abs() < 1e-4);
        assert!((pair.cell.yy - 16_230.319_21).abs() < 1e-5);
        let weight = |z: [f64; 2]| {
            let (_, density) = pair.compare([&a, &b], (z, r));
            pair.probability.ln() + (0.9 * density / std::f64::consts::TAU / 1e-10).ln()
        };
        assert!((weight([40.0, 100_120.0]) - 9.4449871615).abs() < 1e-9);
        assert!((weight([-60.0, 100_210.0]) - 9.06306015705).abs() < 1e-9);
        let missed = 2.0 * 0.1_f64.ln() + pair.missed(&radar);
        assert!((missed + 3.94072305484).abs() < 1e-10);
        let own = |e: &Estimate<4>| {
            vec![Component {
                probability: 1.0,
                position: e.position(),
                covariance: e.position_covariance(),
            }]
        };
        let plot = ([40.0, 100_120.0], r.plus(pair.spread()));
        let by = shifts(&own(&a), &own(&b), plot, pair.cell);
        assert!((by[0].density / 8.45750420668e-13 - 1.0).abs() < 1e-10);
        let mut after = a;
        after.shift(&by[0]);
        let mean = [3.67647249492, 100_027.858768, 200.114889765, 1.11435070997];
        let variances = [5939.51857781, 1895.91309773, 24.5503111111, 24.0334609564];
        for i in 0..4 {
            assert!((after.mean[i] - mean[i]).abs() < 1e-6, "{:?}", after.mean);
            let difference = after.covariance[(i, i)] - variances[i];
            assert!(difference.abs() < 1e-7 * variances[i], "{:?}", after.covariance);
        }
    }
}
